//! Writes the seeds of the fuzz targets: `cargo run --bin seeds` in this folder fills `corpus/TARGET`.
//!
//! They are the made-up recordings that the tests read.

#[allow(dead_code)]
#[path = "../../crates/formats/tests/it/make.rs"]
mod make;

use std::{fs, io, path::Path};

use radarllm_formats::uart::Dialect;

fn main() -> io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let write = |target: &str, name: &str, bytes: &[u8]| -> io::Result<()> {
        let folder = corpus.join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)
    };
    for dialect in Dialect::ALL {
        write("uart", dialect.name(), &make::stream(dialect, 10))?;
    }
    for compression in ["none", "bz2", "lz4"] {
        write("bag", &format!("clouds-{compression}"), &make::bag(compression))?;
    }
    for (name, table) in make::TABLES {
        write("points_csv", name, table.as_bytes())?;
    }
    write("radhar", "record", make::RADHAR.as_bytes())?;
    write("mars", "table", make::MARS.as_bytes())?;
    write("calib", "matrix", make::CALIBRATION.as_bytes())?;
    write("visualizer_json", "people", make::replay(7, 3).as_bytes())?;
    let frame = make::replay_frame(1, "[1, 2, NaN, 0.5, 30, 1, 255]");
    let json = make::replay_of("x843 Out of Box Demo", "xWR6843", &[frame]);
    write("visualizer_json", "out-of-box", json.as_bytes())?;
    for dialect in [Dialect::Sdk3, Dialect::PeopleCounting3d] {
        let stream = make::stream(dialect, 10);
        write("visualizer_binary", dialect.name(), &stream)?;
    }
    for (name, is_compressed) in [("compressed", true), ("plain", false)] {
        write("matlab", name, &make::mars_mat(2, is_compressed))?;
    }
    let names = "replay_1.json\nbinData/t/pHistBytes_2.bin\nprofile.cfg\nframe001.bin";
    write("folder", "names", names.as_bytes())?;
    for (i, seed) in make::seeds().iter().enumerate() {
        if seed.starts_with(b"\x93NUMPY") {
            write("points_npy", &format!("array-{i}"), seed)?;
            write("mars", &format!("array-{i}"), seed)?;
        }
    }
    Ok(())
}
