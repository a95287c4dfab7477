//! ROS 2 bags. Every bag here has the frames of `make_ros2::points`, at 4 frames/s.

#[cfg(not(feature = "ros2"))]
#[test]
fn without_the_feature_a_bag_is_an_error_that_names_it() {
    use radarllm_io::{CaptureOptions, ErrorKind, read_recording};
    let folder = tempfile::tempdir().unwrap();
    for (name, start) in [
        ("a.db3", &b"SQLite format 3\0"[..]),
        ("a", b"\x89MCAP0\r\n"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, start).unwrap();
        let error = read_recording(&[path], &CaptureOptions::default()).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Unsupported);
        assert!(error.to_string().contains("feature `ros2`"), "{error}");
    }
}

#[cfg(feature = "ros2")]
mod with_feature {
    use std::{
        fs,
        path::{Path, PathBuf},
    };

    use radarllm_io::{CaptureOptions, Error, PointOptions, Recording, read_recording};
    use rusqlite::Connection;

    use crate::make_ros2::{self, FIELDS, Message, Topic, cloud, points, record, scan, text};

    const CLOUD: &str = "sensor_msgs/msg/PointCloud2";
    const N_FRAMES: u32 = 8;
    const START_NS: u64 = 1_734_343_200_000_000_000;

    fn time_ns(n: u32) -> u64 {
        START_NS + 250_000_000 * u64::from(n)
    }

    fn stamp(n: u32) -> [u32; 2] {
        let time = time_ns(n);
        [(time / 1_000_000_000) as u32, (time % 1_000_000_000) as u32]
    }

    fn clouds(frames: std::ops::Range<u32>, big_endian: bool) -> Vec<Message> {
        frames
            .map(|n| {
                (
                    0,
                    time_ns(n) + 3_000_000,
                    cloud(stamp(n), &FIELDS, &points(n), big_endian),
                )
            })
            .collect()
    }

    const ONE_TOPIC: [Topic<'_>; 1] = [("/radar", CLOUD, "cdr")];

    /// The database that `ros2 bag record` writes, as far as it is read.
    fn write_db3(path: &Path, topics: &[Topic<'_>], messages: &[Message]) {
        let db = Connection::open(path).unwrap();
        db.execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                 serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                 timestamp INTEGER NOT NULL, data BLOB NOT NULL);
             CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
        )
        .unwrap();
        for (n, (name, kind, format)) in topics.iter().enumerate() {
            db.execute(
                "INSERT INTO topics VALUES (?1, ?2, ?3, ?4, '')",
                (n as i64 + 1, name, kind, format),
            )
            .unwrap();
        }
        for (topic, time, data) in messages {
            db.execute(
                "INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)",
                (*topic as i64 + 1, *time as i64, data),
            )
            .unwrap();
        }
    }

    fn chunk_of(compression: &str, size: u64, crc: u32, data: &[u8]) -> Vec<u8> {
        let body = [
            &[0; 16],
            &size.to_le_bytes()[..],
            &crc.to_le_bytes(),
            &text(compression),
            &(data.len() as u64).to_le_bytes(),
            data,
        ]
        .concat();
        record(6, &body)
    }

    fn pack(compression: &str, plain: &[u8]) -> Vec<u8> {
        match compression {
            "lz4" => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                std::io::Write::write_all(&mut encoder, plain).unwrap();
                encoder.finish().unwrap()
            }
            "zstd" => ruzstd::encoding::compress_to_vec(
                plain,
                ruzstd::encoding::CompressionLevel::Fastest,
            ),
            _ => plain.to_vec(),
        }
    }

    /// An MCAP file with a chunk for every four messages, or without chunks.
    fn mcap(topics: &[Topic<'_>], messages: &[Message], compression: Option<&str>) -> Vec<u8> {
        make_ros2::mcap(topics, messages, |plain| match compression {
            None => plain,
            Some(name) => chunk_of(
                name,
                plain.len() as u64,
                crc32fast::hash(&plain),
                &pack(name, &plain),
            ),
        })
    }

    fn read_with(path: &Path, points: PointOptions) -> Result<Recording, Error> {
        let options = CaptureOptions {
            points,
            ..CaptureOptions::default()
        };
        read_recording(&[path.to_path_buf()], &options)
    }

    fn read(path: &Path) -> Result<Recording, Error> {
        read_with(path, PointOptions::default())
    }

    /// Writes bytes as a file and reads them as a recording.
    fn read_bytes(bytes: &[u8]) -> Result<Recording, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        fs::write(&path, bytes).unwrap();
        read(&path)
    }

    fn assert_whole(recording: &Recording) {
        let clip = &recording.clip;
        assert_eq!(clip.frames.len(), N_FRAMES as usize);
        assert!((clip.frame_rate_hz - 4.0).abs() < 1e-5);
        for (n, frame) in clip.frames.iter().enumerate() {
            assert!((frame.time_s - 0.25 * n as f64).abs() < 1e-6);
            // The strongest points come first, as written.
            for (p, expected) in frame.points.iter().zip(points(n as u32)) {
                let found = [p.y_m, -p.x_m, p.z_m, p.intensity_db, p.velocity_mps];
                assert_eq!(found.map(f64::from).to_vec(), expected);
            }
        }
    }

    #[test]
    fn databases_and_mcap_files_say_the_same_in_both_byte_orders() {
        let folder = tempfile::tempdir().unwrap();
        for big_endian in [false, true] {
            let messages = clouds(0..N_FRAMES, big_endian);
            let path = folder.path().join(format!("a #{big_endian}?.db3"));
            write_db3(&path, &ONE_TOPIC, &messages);
            assert_whole(&read(&path).unwrap());
            for compression in [None, Some(""), Some("lz4"), Some("zstd")] {
                let bytes = mcap(&ONE_TOPIC, &messages, compression);
                let recording = read_bytes(&bytes).unwrap();
                assert_whole(&recording);
                assert_eq!(recording.warnings, [""; 0]);
            }
        }
        // Nothing is made beside a database.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn the_files_of_a_bag_are_one_recording() {
        for extension in ["db3", "mcap"] {
            let folder = tempfile::tempdir().unwrap();
            let bag = folder.path().join("walk");
            fs::create_dir(&bag).unwrap();
            // The frames of the second file lie between those of the first one.
            let (mut first, mut second) = (Vec::new(), Vec::new());
            for (n, message) in clouds(0..N_FRAMES, false).into_iter().enumerate() {
                match n % 3 {
                    1 => second.push(message),
                    _ => first.push(message),
                }
            }
            for (n, messages) in [(0, first), (1, second)] {
                let path = bag.join(format!("walk_{n}.{extension}"));
                match extension {
                    "db3" => write_db3(&path, &ONE_TOPIC, &messages),
                    _ => fs::write(path, mcap(&ONE_TOPIC, &messages, Some("lz4"))).unwrap(),
                }
            }
            fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
            for path in [&bag, &folder.path().to_path_buf()] {
                assert_whole(&read(path).unwrap());
            }
            fs::create_dir(folder.path().join("sit")).unwrap();
            fs::write(folder.path().join("sit/sit_0.mcap"), "").unwrap();
            let error = read(folder.path()).unwrap_err().to_string();
            assert!(
                error.contains("several recordings: sit, walk; name one of them"),
                "{error}"
            );
        }
    }

    /// Frames of returns, as drivers of other radars send them; the azimuth grows to the left.
    #[test]
    fn frames_of_returns_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("returns.db3");
        for big_endian in [false, true] {
            let messages: Vec<Message> = (0..N_FRAMES)
                .map(|n| {
                    let returns: Vec<[f32; 5]> = points(n)
                        .into_iter()
                        .map(|point| {
                            let [x, y, z, intensity_db, velocity_mps] =
                                [0, 1, 2, 3, 4].map(|at| point[at]);
                            let range_m = x.hypot(y).hypot(z);
                            [
                                range_m,
                                y.atan2(x),
                                (z / range_m).asin(),
                                velocity_mps,
                                intensity_db,
                            ]
                            .map(|value| value as f32)
                        })
                        .collect();
                    let data = make_ros2::returns(stamp(n), &returns, big_endian);
                    (0, time_ns(n) + 3_000_000, data)
                })
                .collect();
            let _ = fs::remove_file(&path);
            write_db3(
                &path,
                &[("/radar", "radar_msgs/msg/RadarScan", "cdr")],
                &messages,
            );
            let recording = read(&path).unwrap();
            assert_eq!(recording.clip.frames.len(), N_FRAMES as usize);
            for (n, frame) in recording.clip.frames.iter().enumerate() {
                for (p, expected) in frame.points.iter().zip(points(n as u32)) {
                    let found = [p.y_m, -p.x_m, p.z_m, p.intensity_db, p.velocity_mps];
                    for (found, expected) in found.into_iter().zip(expected) {
                        assert!((f64::from(found) - expected).abs() < 1e-5, "{n}: {p:?}");
                    }
                }
            }
            let cut = messages[0].2.len() - 3;
            let short = vec![(0, time_ns(0), messages[0].2[..cut].to_vec())];
            let _ = fs::remove_file(&path);
            write_db3(
                &path,
                &[("/radar", "radar_msgs/msg/RadarScan", "cdr")],
                &short,
            );
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains("a whole message"), "{error}");
        }
    }

    /// `ros2 bag record --compression-mode file` compresses every file as a whole.
    #[test]
    fn files_that_are_compressed_as_a_whole_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let bag = folder.path().join("walk");
        fs::create_dir(&bag).unwrap();
        let messages = clouds(0..N_FRAMES, false);
        let (first, second) = messages.split_at(5);
        let plain = folder.path().join("plain.db3");
        write_db3(&plain, &ONE_TOPIC, first);
        let packed = pack("zstd", &fs::read(&plain).unwrap());
        fs::write(bag.join("walk_0.db3.zstd"), packed).unwrap();
        let packed = pack("zstd", &mcap(&ONE_TOPIC, second, Some("lz4")));
        fs::write(bag.join("walk_1.mcap.zstd"), packed).unwrap();
        fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
        assert_whole(&read(&bag).unwrap());
        let all = folder.path().join("all.db3");
        write_db3(&all, &ONE_TOPIC, &messages);
        let one = folder.path().join("all.db3.ZST");
        fs::write(&one, pack("zstd", &fs::read(&all).unwrap())).unwrap();
        assert_whole(&read(&one).unwrap());
    }

    #[test]
    fn topics_are_chosen_as_in_bags_of_ros_1() {
        let topics = [
            ("/imu", "sensor_msgs/msg/Imu", "cdr"),
            ("/radar/front", CLOUD, "cdr"),
            ("/radar/scan", "ti_mmwave_rospkg_msgs/msg/RadarScan", "cdr"),
            ("/other", CLOUD, "json"),
        ];
        let mut messages = Vec::new();
        for (_, time, data) in clouds(0..N_FRAMES, false) {
            messages.push((0, time, b"anything".to_vec()));
            messages.push((1, time, data));
            messages.push((3, time, b"{}".to_vec()));
        }
        for n in 0..N_FRAMES {
            let [x, y, z, snr, v] = points(n)[0][..] else {
                panic!()
            };
            let point = [x, y, z, v, snr].map(|v| v as f32);
            messages.push((2, time_ns(n), scan(stamp(n), 0, point, false)));
        }
        let folder = tempfile::tempdir().unwrap();
        let db3: PathBuf = folder.path().join("a.db3");
        write_db3(&db3, &topics, &messages);
        let file = folder.path().join("a.mcap");
        fs::write(&file, mcap(&topics, &messages, Some("zstd"))).unwrap();
        let topic = |name: &str| PointOptions {
            topic: Some(name.into()),
            ..PointOptions::default()
        };
        for path in [&db3, &file] {
            assert_whole(&read(path).unwrap());
            let scans = read_with(path, topic("/radar/scan")).unwrap();
            assert_eq!(scans.clip.frames.len(), N_FRAMES as usize);
            assert_eq!(scans.clip.frames[3].points.len(), 1);
            assert_eq!(
                f64::from(scans.clip.frames[3].points[0].y_m),
                points(3)[0][0]
            );
            let error = read_with(path, topic("/imu")).unwrap_err();
            for part in [
                "on /imu",
                "`/imu (sensor_msgs/msg/Imu)`",
                &format!("`/radar/front ({CLOUD})`"),
            ] {
                assert!(error.to_string().contains(part), "{error}");
            }
        }
        // Without a topic of points the types are named, and no topic is asked for.
        let alone = mcap(&topics[..1], &[(0, 1, b"any".to_vec())], None);
        let error = read_bytes(&alone).unwrap_err();
        assert!(
            error.to_string().contains("`/imu (sensor_msgs/msg/Imu)`"),
            "{error}"
        );
        assert!(error.hint.is_none());
    }

    #[test]
    fn the_recorder_gives_times_and_may_compress_messages() {
        let messages: Vec<Message> = (0..N_FRAMES)
            .map(|n| {
                let message = cloud([0, 0], &FIELDS, &points(n), false);
                (0, time_ns(n), pack("zstd", &message))
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.db3");
        write_db3(&path, &ONE_TOPIC, &messages);
        for recording in [
            read(&path).unwrap(),
            read_bytes(&mcap(&ONE_TOPIC, &messages, None)).unwrap(),
        ] {
            assert_whole(&recording);
            assert!(
                recording
                    .notes
                    .iter()
                    .any(|n| n.contains("times are those of the recorder"))
            );
        }
    }

    /// A recorder that is stopped leaves no summary, and half a record.
    #[test]
    fn cut_files_give_the_frames_before_the_cut() {
        let messages = clouds(0..N_FRAMES, false);
        for compression in [None, Some("lz4"), Some("zstd")] {
            let bytes = mcap(&ONE_TOPIC, &messages, compression);
            let mut n_read = 0;
            for end in 0..bytes.len() {
                if let Ok(recording) = read_bytes(&bytes[..end]) {
                    n_read += 1;
                    let n_frames = recording.clip.frames.len();
                    assert!(n_frames > 1 && n_frames <= N_FRAMES as usize);
                    let is_warned = recording
                        .warnings
                        .iter()
                        .any(|w| w.contains("the recorder was stopped"));
                    // The last eight bytes and the footer before them are no record of points.
                    assert!(is_warned || end >= bytes.len() - 8, "{end}");
                }
            }
            assert!(n_read > 100, "{n_read}");
        }
    }

    #[test]
    fn damage_is_an_error_or_frames_and_never_a_panic() {
        let messages = clouds(0..4, false);
        for compression in [None, Some(""), Some("lz4"), Some("zstd")] {
            let bytes = mcap(&ONE_TOPIC, &messages, compression);
            for at in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[at] ^= 0xFF;
                let _ = read_bytes(&damaged);
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.db3");
        write_db3(&path, &ONE_TOPIC, &messages);
        let bytes = fs::read(&path).unwrap();
        let other = folder.path().join("b.db3");
        for at in (0..bytes.len()).step_by(7) {
            fs::write(&other, &bytes[..at]).unwrap();
            let _ = read(&other);
            let mut damaged = bytes.clone();
            damaged[at] ^= 0xFF;
            fs::write(&other, &damaged).unwrap();
            let _ = read(&other);
        }
    }

    #[test]
    fn false_sizes_and_other_files_are_refused() {
        let start = b"\x89MCAP0\r\n".to_vec();
        let with = |record: Vec<u8>| {
            read_bytes(&[start.clone(), record].concat())
                .unwrap_err()
                .to_string()
        };
        let zeros = vec![0; 1 << 20];
        for compression in ["lz4", "zstd"] {
            let packed = pack(compression, &zeros);
            let of = |size: u64| with(chunk_of(compression, size, 0, &packed));
            assert!(of(100).contains("unpacks to 100 bytes, as its header says, found `more`"));
            assert!(of(2 << 20).contains("found `1048576`"));
            assert!(of(u64::MAX).contains("a chunk of at most"));
        }
        let plain = record(5, &[0; 22]);
        let crc = with(chunk_of("", plain.len() as u64, 1, &plain));
        assert!(crc.contains("checksum"), "{crc}");
        assert!(with(chunk_of("brotli", 1, 0, &[0])).contains("compression lz4, zstd or none"));
        assert!(with(plain).contains("a message of a known connection"));
        let huge = [&[1][..], &u64::MAX.to_le_bytes()].concat();
        assert!(with(huge).contains("before byte"));

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.db");
        let db = Connection::open(&path).unwrap();
        db.execute_batch("CREATE TABLE topics(a); CREATE VIEW messages AS SELECT 1")
            .unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(
            error.contains("an SQLite database without a table `messages`"),
            "{error}"
        );
        // A file whose name is that of a compressed one, and whose bytes are not.
        let packed = folder.path().join("a.db3.zstd");
        fs::write(&packed, "any").unwrap();
        assert!(
            read(&packed)
                .unwrap_err()
                .to_string()
                .contains("neither its first bytes nor its name")
        );
    }
}
