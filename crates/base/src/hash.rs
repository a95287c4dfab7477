//! 64-bit FNV-1a: fingerprints that name folders and distinguish models. The hash gives no cryptographic protection.
//!
//! ```
//! use radarllm_base::hash::{Fnv1a, fnv_1a};
//!
//! let mut hash = Fnv1a::new();
//! hash.write(b"radar");
//! hash.write(b"LLM");
//! assert_eq!(hash.finish(), fnv_1a(b"radarLLM"));
//! ```
//!
//! Source: Fowler, Noll, Vo and Eastlake, "The FNV non-cryptographic hash algorithm".

/// Incremental hash state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fnv1a(u64);

impl Default for Fnv1a {
    fn default() -> Self {
        Self::new()
    }
}

impl Fnv1a {
    /// The hash of empty input.
    pub const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    /// Adds bytes. The hash does not depend on how the input is divided into calls.
    pub fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// The hash of all bytes written so far.
    pub const fn finish(self) -> u64 {
        self.0
    }
}

/// The hash of a byte slice.
pub fn fnv_1a(bytes: &[u8]) -> u64 {
    let mut hash = Fnv1a::new();
    hash.write(bytes);
    hash.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_the_published_ones() {
        // From the authors' test vectors.
        assert_eq!(fnv_1a(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv_1a(b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv_1a(b"foobar"), 0x8594_4171_f739_67e8);
    }
}
