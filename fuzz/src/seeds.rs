//! Writes the seeds of the fuzz targets: `cargo run --bin seeds` in this folder fills `corpus/TARGET`.
//!
//! They are the made-up recordings that the tests read, and files that our own writers write.

#[allow(dead_code)]
#[path = "../../crates/formats/tests/it/make.rs"]
mod make;
#[allow(dead_code)]
#[path = "../../crates/formats/tests/it/make_ros2.rs"]
mod make_ros2;
mod seeds_of_files;

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
        write(
            "bag",
            &format!("clouds-{compression}"),
            &make::bag(compression),
        )?;
    }
    for (name, big_endian) in [("little", false), ("big", true)] {
        let cloud = make_ros2::cloud(
            [1, 2],
            &make_ros2::FIELDS,
            &make_ros2::points(3),
            big_endian,
        );
        write(
            "ros2_messages",
            &format!("cloud-{name}"),
            &[&[0], &cloud[..]].concat(),
        )?;
        let scan = make_ros2::scan([1, 2], 0, [1.0, 2.0, 0.5, -0.25, 20.0], big_endian);
        write(
            "ros2_messages",
            &format!("scan-{name}"),
            &[&[1], &scan[..]].concat(),
        )?;
    }
    let topics = [("/radar", "sensor_msgs/msg/PointCloud2", "cdr")];
    let message = |n: u32| {
        let cloud = make_ros2::cloud([1, n], &make_ros2::FIELDS, &make_ros2::points(n), false);
        (0, u64::from(n), cloud)
    };
    let messages: Vec<make_ros2::Message> = (1..4).map(message).collect();
    let chunk = |plain: Vec<u8>| {
        let size = (plain.len() as u64).to_le_bytes();
        let head = [&[0; 16], &size[..], &[0; 4], &make_ros2::text(""), &size];
        make_ros2::record(6, &[&head.concat(), &plain[..]].concat())
    };
    write(
        "ros2_bag",
        "plain",
        &make_ros2::mcap(&topics, &messages, |plain| plain),
    )?;
    write(
        "ros2_bag",
        "chunk",
        &make_ros2::mcap(&topics, &messages, chunk),
    )?;
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
    seeds_of_files::write_all(&write)
}
