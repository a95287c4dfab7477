//! Motion files, as they are read before a simulation. The first byte says which kind.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use radarllm_body::sample::resample;
use radarllm_body::{load_asf_amc, load_motion};
use radarllm_fuzz::{archive, pieces};

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let load = |name: &str, bytes: &[u8]| load_motion(Path::new(name), bytes);
    let loaded = match kind % 6 {
        0 => load("motion.bvh", bytes),
        1 => {
            let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
            let (asf, amc) = bytes.split_at(end);
            load_asf_amc(asf, amc.get(1..).unwrap_or_default())
        }
        2 => load("motion.npz", bytes),
        3 | 4 => match archive(&pieces(bytes), kind % 6 == 4) {
            Some(npz) => load("motion.npz", &npz),
            None => return,
        },
        _ => load("motion", bytes),
    };
    if let Ok(loaded) = loaded {
        let _ = resample(&loaded.motion, 20.0);
    }
});
