//! Every example runs, on inputs that the test makes itself.

#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// Runs an example, which `cargo test` has built, and returns what it printed.
fn run(example: &str, args: &[&Path]) -> String {
    let test = std::env::current_exe().unwrap();
    let folder = test.parent().unwrap().parent().unwrap().join("examples");
    let program = folder
        .join(example)
        .with_extension(std::env::consts::EXE_EXTENSION);
    assert!(
        program.exists(),
        "{}: `cargo test -p radarllm` builds the examples too",
        program.display()
    );
    let output = Command::new(program).args(args).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success(),
        "{example}: {text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

fn scratch(name: &str) -> PathBuf {
    let folder =
        std::env::temp_dir().join(format!("radarllm-example-{}-{name}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn simulated_points_are_tracked_and_described() {
    let folder = scratch("points");
    let points = folder.join("points.parquet");
    let text = run("simulate_motion", &[&points]);
    assert!(text.contains("range resolution 8.6 cm"), "{text}");
    let text = run("track_people", &[&points]);
    assert!(text.starts_with("person 1: "), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    let text = run("describe_recording", &[&points]);
    let stated = radarllm::inference::lm::captioner::actions(&text);
    assert_eq!(stated, ["walk"], "{text}");
    assert!(text.contains("backward"), "{text}");
    fs::remove_dir_all(folder).unwrap();
}

/// Samples as npy complex64 `[frame, loop, tx, rx, sample]`: a person who walks, two frames.
fn raw_samples(path: &Path) {
    use radarllm::synth::{Method, Synthesizer, simulate::place, synthesizer::posed_builtin};
    let radar = radarllm::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let walk = radarllm::open_motion("builtin:walk", 1).unwrap();
    let placement = place(&walk.motion, 3.0, 1.0);
    let body = posed_builtin(&walk.motion, walk.shape, placement).unwrap();
    let scene = radarllm::radar_sim::Scene {
        surfaces: vec![&body],
        ..Default::default()
    };
    let mut chain = Synthesizer::new(&radar, Method::Fast, Default::default()).unwrap();
    let shape = [
        2,
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    ];
    let header = format!("{{'descr': '<c8', 'fortran_order': False, 'shape': {shape:?}, }}")
        .replace('[', "(")
        .replace(']', ")");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len() + 1).unwrap().to_le_bytes());
    bytes.extend(header.bytes());
    bytes.push(b'\n');
    for frame in 10..12 {
        for z in &chain.simulate(&scene, frame, 1).unwrap().data {
            bytes.extend(z.re.to_le_bytes().iter().chain(&z.im.to_le_bytes()));
        }
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn raw_samples_become_points_and_a_picture() {
    let folder = scratch("samples");
    let [samples, picture] = ["raw.npy", "points.svg"].map(|name| folder.join(name));
    raw_samples(&samples);
    let text = run(
        "samples_to_picture",
        &[&samples, Path::new("iwr6843isk"), &picture],
    );
    assert_eq!(text.lines().count(), 2, "{text}");
    let svg = fs::read_to_string(picture).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("Points of all frames"));
    fs::remove_dir_all(folder).unwrap();
}

/// A recording of a UART stream and one of a visualizer: what people own.
#[test]
fn recordings_of_firmware_are_opened() {
    let folder = scratch("uart");
    let uart = folder.join("uart.dat");
    let packets: Vec<u8> = (0..40).flat_map(packet).collect();
    fs::write(&uart, packets).unwrap();
    // Forty frames of one point: nobody is tracked, and nothing is said about anybody.
    let text = run("describe_recording", &[&uart, Path::new("awr1843boost")]);
    assert_eq!(text, "");
    fs::remove_dir_all(folder).unwrap();
}

/// A packet of TI's out-of-box demo with one point.
fn packet(number: u32) -> Vec<u8> {
    let mut bytes = vec![2, 1, 4, 3, 6, 5, 8, 7];
    let words = [0x0306_0000, 64, 0xA6843, number, 0, 1, 1, 0, 1, 16];
    bytes.extend(words.iter().flat_map(|w: &u32| w.to_le_bytes()));
    bytes.extend(
        [0.5_f32, 2.0, 0.25, -0.5]
            .iter()
            .flat_map(|v| v.to_le_bytes()),
    );
    bytes.resize(64, 0);
    bytes
}

#[test]
fn captions_are_scored() {
    let text = run("caption_metrics", &[]);
    assert!(text.contains("BLEU-1 0.917"), "{text}");
}

#[test]
fn a_data_set_is_built_and_read() {
    let folder = scratch("data");
    let text = run("build_dataset", &[&folder.join("small")]);
    assert_eq!(text.lines().count(), 4, "{text}");
    fs::remove_dir_all(folder).unwrap();
}
