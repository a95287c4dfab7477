//! Prefetching of memory.

/// Prefetches a slice that will be read soon.
///
/// The hardware prefetcher follows a stream of addresses but not a jump to another page, where the read would wait for
/// memory. Does nothing on targets without such an instruction.
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
