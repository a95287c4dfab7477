//! Asking for memory before it is needed.

/// Asks the cache for a slice that is read soon.
///
/// Processors follow a stream of addresses by themselves, but not over a jump to another page, where the read would wait
/// for memory. Does nothing where there is no such instruction.
#[inline]
pub fn prefetch<T>(soon: &[T]) {
    // Every x86-64 processor has the instruction. Miri does not interpret it.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        const LINE_BYTES: usize = 64;
        let start = soon.as_ptr().cast::<i8>();
        for offset in (0..size_of_val(soon)).step_by(LINE_BYTES) {
            // SAFETY: the address lies within the slice; the instruction reads no value and never faults.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.add(offset)) };
        }
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = soon;
}
