//! Configurations in TOML, and the manifest of a data set. The first byte says which reader.
#![no_main]

use std::fs;
use std::path::Path;

use libfuzzer_sys::fuzz_target;
use radarllm::{RecordedConfidence, read_site};
use radarllm_dataset::Manifest;
use radarllm_formats::builtin_radar;
use radarllm_fuzz::temporary;
use radarllm_synth::config::DatasetConfig;
use radarllm_synth::impairments::ImpairmentsFile;
use radarllm_synth::objects::ObjectsFile;
use radarllm_synth::processing::ProcessingFile;
use radarllm_synth::scene::SceneFile;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let text = String::from_utf8_lossy(bytes);
    let radar = builtin_radar("awr1843boost").expect("a built-in radar");
    match kind % 8 {
        0 => {
            if let Ok(scene) = SceneFile::from_toml(&text) {
                let _ = scene.radar(&radar);
                let _ = scene.sim_options();
            }
        }
        1 => drop(DatasetConfig::from_toml(&text)),
        2 => {
            if let Ok(processing) = ProcessingFile::from_toml(&text) {
                let _ = processing.resolve(&radar);
            }
        }
        3 => {
            if let Ok(objects) = ObjectsFile::from_toml(&text)
                && objects.check().is_ok()
            {
                let _ = objects.draw(1.0, 7);
            }
        }
        4 => {
            if let Ok(impairments) = toml::from_str::<ImpairmentsFile>(&text) {
                let _ = impairments.resolve();
            }
        }
        5 => {
            if let Ok(zones) = radarllm_live::zones::parse(Path::new("zones.toml"), &text) {
                let _ = zones.is_door([1.8, 4.3]);
            }
        }
        6 => {
            let _ = RecordedConfidence::from_toml(&text);
            let _ = read_site(temporary(bytes).path());
        }
        _ => {
            let folder = tempfile::tempdir().expect("a temporary folder");
            fs::write(folder.path().join("manifest.json"), bytes).expect("a temporary file");
            let _ = Manifest::read(folder.path());
        }
    }
});
