//! How this machine rounds.
//!
//! The same program gives the same bytes on one machine, whatever the number of threads. Between machines two things
//! make a difference in the last bit: the vector instructions of the processor, and the sine, logarithm and so on of the
//! C library, which also chooses by the processor. Data sets are built on several machines only if these agree.

use radarllm_base::seed::derive_seed;
use radarllm_simd::{InstructionSet, SimdLevel};

/// A name for how this machine rounds: the instructions, and a hash of values of the C library's functions.
///
/// Machines with the same name are expected to compute the same bytes.
pub(crate) fn arithmetic() -> String {
    let instructions = match SimdLevel::detect().instruction_set() {
        // They differ in byte products only, which the simulator does not use.
        InstructionSet::Avx512Vnni | InstructionSet::Avx512 => "avx512",
        InstructionSet::Avx2 => "avx2",
        InstructionSet::Portable => std::env::consts::ARCH,
    };
    // One character per byte, because the hash takes text.
    let values: String = library_values()
        .into_iter()
        .flat_map(|value| value.to_bits().to_le_bytes())
        .map(char::from)
        .collect();
    format!("{instructions}-{:08x}", derive_seed(0, &values) as u32)
}

/// Values of the C library's functions at arguments of all sizes.
fn library_values() -> Vec<f64> {
    /// Arguments of each function; a different rounding is rare, so there are many.
    const N_ARGUMENTS: u32 = 2000;
    let mut values = Vec::new();
    for i in 1..=N_ARGUMENTS {
        // Irrational steps, from 1.4 to 2828 and from 0.0014 to 2.8, so that no argument is special.
        let x = std::hint::black_box(f64::from(i) * std::f64::consts::SQRT_2);
        let y = std::hint::black_box(x * 1e-3);
        values.extend([
            x.sin(),
            x.cos(),
            y.tan(),
            y.exp(),
            y.tanh(),
            x.ln(),
            x.log10(),
            x.powf(0.3),
            y.atan2(1.3),
            (y / 3.0).asin(),
            (y / 3.0).acos(),
            x.hypot(y),
            x.cbrt(),
        ]);
        let [x, y] = [x as f32, y as f32];
        let single = [
            x.sin(),
            x.cos(),
            y.tan(),
            y.exp(),
            x.ln(),
            x.log10(),
            x.powf(0.3),
            y.atan2(1.3),
            (y / 3.0).asin(),
            (y / 3.0).acos(),
            x.hypot(y),
        ];
        values.extend(single.map(f64::from));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_one_name() {
        let name = arithmetic();
        assert_eq!(name, arithmetic());
        let (_, hash) = name.rsplit_once('-').unwrap();
        assert!(
            hash.len() == 8 && u32::from_str_radix(hash, 16).is_ok(),
            "{name}"
        );
        // A value that is not a number would hide differences.
        let values = library_values();
        assert!(values.iter().all(|v| v.is_finite()), "{values:?}");
    }
}
