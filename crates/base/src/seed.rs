//! Reproducible randomness: one seed per named thing, whatever the thread count or order.

/// Derives a seed for the thing called `name` from a parent seed.
///
/// 64-bit FNV-1a over the parent's bytes and the name, finished with SplitMix64. Not
/// cryptographic; stable for ever, because data sets record only the parent seed.
pub fn derive_seed(parent: u64, name: &str) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in parent.to_le_bytes().iter().chain(name.as_bytes()) {
        hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    let mut z = hash.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::derive_seed;

    #[test]
    fn seeds_differ_by_parent_and_name_and_never_change() {
        assert_ne!(derive_seed(1, "a"), derive_seed(2, "a"));
        assert_ne!(derive_seed(1, "a"), derive_seed(1, "b"));
        // From an independent evaluation of the doc comment in Python; data sets depend on it.
        assert_eq!(derive_seed(1, "walk-000001"), 9168647581866773148);
    }
}
