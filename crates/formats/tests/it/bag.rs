//! ROS bags, written by our own generator as the format's page describes them.

use radarllm_formats::recordings::{Axes, Place, read_bag};

use crate::make::{
    Cloud, FIELDS, bag, chunk, chunk_of, cloud, connection, message_record, pack, radar_scan, whole,
};

#[test]
fn clouds_come_out_by_declared_fields() {
    let read = read_bag(bag("none").as_slice(), None, Axes::ForwardLeftUp).unwrap();
    assert_eq!(
        (
            read.topic.as_str(),
            read.points_dropped,
            read.other_messages
        ),
        ("/radar", 2, 1)
    );
    assert_eq!(read.frames.len(), 2);
    assert_eq!(
        (read.frames[1].number, read.frames[1].stamp_s),
        (1, Some(101.5))
    );
    let p = read.frames[0].points[0];
    assert_eq!(
        [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
        [-2.0, 1.0, 3.0, -0.5, 30.0]
    );
}

#[test]
fn compressed_chunks_hold_the_same_clouds() {
    let read = |bytes: &[u8]| read_bag(bytes, None, Axes::ForwardLeftUp);
    let plain = read(&bag("none")).unwrap();
    for compression in ["bz2", "lz4"] {
        let bytes = bag(compression);
        assert!(bytes.windows(3).any(|w| w == compression.as_bytes()));
        assert_eq!(read(&bytes).unwrap(), plain, "{compression}");
        // Every cut and every changed byte of the chunk ends in an error or in clouds, never beyond belief.
        for end in 0..bytes.len() {
            let _ = read(&bytes[..end]);
            let mut damaged = bytes.clone();
            damaged[end] ^= 0x55;
            let _ = read(&damaged);
        }
    }
}

/// A chunk unpacks to what its header says or not at all: a small one cannot fill the memory.
#[test]
fn chunks_that_unpack_to_another_size_are_refused() {
    let zeros = vec![0; 1 << 20];
    for compression in ["bz2", "lz4"] {
        let packed = pack(compression, &zeros);
        assert!(packed.len() < 8192);
        let error = |size: u32, data: &[u8]| {
            let bytes = whole(&[chunk_of(compression, size, data)]);
            let error = read_bag(bytes.as_slice(), None, Axes::ForwardLeftUp).unwrap_err();
            // The magic, 13 bytes, and the bag's header record.
            assert_eq!(error.error.at, Place::Byte(whole(&[]).len() as u64));
            error.to_string()
        };
        assert!(
            error(100, &packed).contains("unpacks to 100 bytes, as its header says, found `more`")
        );
        assert!(error(2 << 20, &packed).contains("found `1048576`"));
        assert!(error(u32::MAX, &packed).contains("a chunk of at most"));
        assert!(error(1 << 20, &packed[..packed.len() / 2]).contains("a whole compressed chunk"));
        assert!(error(7, b"not packed").contains("a whole compressed chunk"));
    }
}

#[test]
fn big_endian_clouds_say_the_same() {
    let mut data = Vec::new();
    for v in [1.0_f32, 2.0, 3.0, 9.0] {
        data.extend(v.to_be_bytes());
    }
    data.extend(30_u16.to_be_bytes());
    data.extend([0; 2]);
    data.extend((-0.5_f64).to_be_bytes());
    let cloud = Cloud {
        width: 1,
        row_padding: 0,
        big_endian: true,
        data,
        ..cloud()
    };
    let bytes = whole(&[
        connection(0, "/r", "sensor_msgs/PointCloud2"),
        cloud.message(0, 1),
    ]);
    let read = read_bag(bytes.as_slice(), Some("/r"), Axes::RightForwardUp).unwrap();
    let p = read.frames[0].points[0];
    assert_eq!(
        [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
        [1.0, 2.0, 3.0, -0.5, 30.0]
    );
}

#[test]
fn what_cannot_be_read_is_said() {
    let error = |records: &[Vec<u8>], topic: Option<&str>| {
        read_bag(whole(records).as_slice(), topic, Axes::ForwardLeftUp)
            .unwrap_err()
            .to_string()
    };
    let link = connection(0, "/a", "sensor_msgs/PointCloud2");
    let other = connection(1, "/b", "sensor_msgs/PointCloud2");
    assert!(error(&[chunk("zstd", &[])], None).contains("none, bz2 or lz4, found `zstd`"));
    let two = [
        link.clone(),
        other,
        cloud().message(0, 1),
        cloud().message(1, 1),
    ];
    assert!(error(&two, None).contains("found `/a`, `/b`"));
    assert!(error(&[link.clone(), cloud().message(0, 1)], Some("/c")).contains("/c"));
    let bare = Cloud {
        fields: &FIELDS[..4],
        ..cloud()
    };
    let bare = error(&[link.clone(), bare.message(0, 1)], None);
    assert!(
        bare.ends_with("expected fields `velocity`, found `x`, `y`, `z`, `intensity`"),
        "{bare}"
    );
    let outside = [
        FIELDS[0],
        FIELDS[1],
        FIELDS[2],
        FIELDS[3],
        ("velocity", 24, 8),
    ];
    let outside = Cloud {
        fields: &outside,
        ..cloud()
    };
    assert!(error(&[link.clone(), outside.message(0, 1)], None).contains("within point_step 28"));
    let overflowing = [
        FIELDS[0],
        FIELDS[1],
        FIELDS[2],
        FIELDS[3],
        ("velocity", u32::MAX, 8),
    ];
    let overflowing = Cloud {
        fields: &overflowing,
        ..cloud()
    };
    assert!(error(&[link.clone(), overflowing.message(0, 1)], None).contains("point_step"));
    let wide = Cloud {
        width: 3,
        row_padding: 0,
        ..cloud()
    };
    assert!(error(&[link.clone(), wide.message(0, 1)], None).contains("row_step"));
    assert!(error(&[link], None).contains(
        "a topic with PointCloud2 messages, or RadarScan messages of radar_msgs or of TI's driver, of a radar"
    ));
    let huge = [b"#ROSBAG V2.0\n".as_slice(), &[0xFF; 4]].concat();
    let huge = read_bag(huge.as_slice(), None, Axes::ForwardLeftUp).unwrap_err();
    assert_eq!(huge.error.at, Place::Byte(13));
}

/// Names of fields as drivers of other radars write them, and units in them.
#[test]
fn fields_are_known_by_the_names_of_tables_in_any_case() {
    let values = [1.0_f32, 2.0, 3.0, -0.5, 30.0];
    let data: Vec<u8> = values.into_iter().flat_map(f32::to_le_bytes).collect();
    let read = |names: [&str; 5]| {
        let fields: Vec<(&str, u32, u8)> = names
            .into_iter()
            .enumerate()
            .map(|(n, name)| (name, 4 * n as u32, 7))
            .collect();
        let cloud = Cloud {
            fields: &fields,
            point_step: 20,
            row_padding: 0,
            width: 1,
            big_endian: false,
            data: data.clone(),
        };
        let bytes = whole(&[
            connection(0, "/r", "sensor_msgs/PointCloud2"),
            cloud.message(0, 1),
        ]);
        let bag = read_bag(bytes.as_slice(), None, Axes::RightForwardUp).unwrap();
        let p = bag.frames[0].points[0];
        let values = [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db];
        (values, bag.points_without_intensity)
    };
    for names in [
        ["x", "y", "z", "Doppler", "Power"],
        ["X", "Y", "Z", "VELOCITY", "SNR"],
        ["x", "y", "z", "doppler_mps", "snr_db"],
        ["x", "y", "z", "radial_velocity", "intensity"],
        ["x", "y", "z", "radial_speed", "power_db"],
    ] {
        assert_eq!(read(names), (values, 0), "{names:?}");
    }
    // The usual name before others, in either order.
    let (found, _) = read(["x", "y", "z", "velocity", "speed"]);
    assert_eq!(found, [1.0, 2.0, 3.0, -0.5, 0.0]);
    let (found, without) = read(["x", "y", "z", "speed", "velocity"]);
    assert_eq!((found, without), ([1.0, 2.0, 3.0, 30.0, 0.0], 1));
    let (found, _) = read(["x_mm", "y", "z", "v", "snr_tenths"]);
    assert_eq!(found, [0.001, 2.0, 3.0, -0.5, 3.0]);
    // Range 1 m, azimuth 2 rad, elevation 3 rad.
    let (found, _) = read(["range", "azimuth", "elevation", "v", "snr"]);
    let expected = [
        3.0_f32.cos() * 2.0_f32.sin(),
        3.0_f32.cos() * 2.0_f32.cos(),
        3.0_f32.sin(),
    ];
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn the_time_of_the_record_stands_in_for_stamps_that_are_zero_or_stand_still() {
    let link = connection(0, "/r", "sensor_msgs/PointCloud2");
    let read = |stamps: [[u32; 2]; 3], times: [[u32; 2]; 3]| {
        let messages = stamps
            .into_iter()
            .zip(times)
            .map(|(stamp, time)| message_record(0, time, &cloud().ros1(stamp)));
        let records: Vec<Vec<u8>> = [link.clone()].into_iter().chain(messages).collect();
        let bag = read_bag(whole(&records).as_slice(), None, Axes::ForwardLeftUp).unwrap();
        let stamps: Vec<Option<f64>> = bag.frames.iter().map(|f| f.stamp_s).collect();
        (stamps, bag.notes.len())
    };
    let advancing = [[7, 0], [7, 500_000_000], [8, 0]];
    let seconds = vec![Some(7.0), Some(7.5), Some(8.0)];
    for stamps in [[[0; 2]; 3], [[5, 0]; 3], [[6, 0], [0, 0], [6, 2]]] {
        assert_eq!(read(stamps, advancing), (seconds.clone(), 1), "{stamps:?}");
    }
    assert_eq!(read(advancing, [[99, 0]; 3]), (seconds.clone(), 0));
    assert_eq!(read(advancing, advancing), (seconds, 0));
    assert_eq!(read([[0; 2]; 3], [[0; 2]; 3]), (vec![None; 3], 1));
}

/// The driver of TI sends a message for each point; point 0 starts a frame, as in RadHAR's text of them.
#[test]
fn scans_of_the_driver_are_frames() {
    let link = connection(3, "/ti_mmwave/radar_scan", "ti_mmwave_rospkg/RadarScan");
    let scan = |n: u32, id: u16, x: f32| {
        let point = [x, -0.5, 0.25, 0.125 * f32::from(id), 20.0 + n as f32];
        message_record(3, [50, 0], &radar_scan([100, 250_000_000 * n], id, point))
    };
    let records = [
        link.clone(),
        scan(0, 0, 1.0),
        scan(0, 1, 2.0),
        scan(1, 0, f32::NAN),
        scan(1, 1, 3.0),
        scan(2, 0, 4.0),
    ];
    let bag = read_bag(whole(&records).as_slice(), None, Axes::ForwardLeftUp).unwrap();
    assert_eq!(
        (bag.topic.as_str(), bag.points_dropped),
        ("/ti_mmwave/radar_scan", 1)
    );
    let sizes: Vec<usize> = bag.frames.iter().map(|f| f.points.len()).collect();
    assert_eq!(sizes, [2, 1, 1]);
    let stamps: Vec<_> = bag.frames.iter().map(|f| f.stamp_s.unwrap()).collect();
    assert_eq!(stamps, [100.0, 100.25, 100.5]);
    let p = bag.frames[1].points[0];
    assert_eq!(
        [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
        [0.5, 3.0, 0.25, 0.125, 21.0]
    );
    // The driver sends its clouds beside them, which are read then.
    let both = [
        &records[..],
        &[
            connection(0, "/ti_mmwave/radar_scan_pcl", "sensor_msgs/PointCloud2"),
            cloud().message(0, 1),
        ],
    ]
    .concat();
    let read = |topic| read_bag(whole(&both).as_slice(), topic, Axes::ForwardLeftUp);
    let clouds = read(None).unwrap();
    assert_eq!((clouds.frames.len(), clouds.other_messages), (1, 5));
    assert_eq!(
        read(Some("/ti_mmwave/radar_scan")).unwrap().frames,
        bag.frames
    );
    // Truncated at every byte: an error or frames.
    for end in 0..whole(&both).len() {
        let _ = read_bag(&whole(&both)[..end], None, Axes::ForwardLeftUp);
    }
    let short = message_record(3, [0; 2], &radar_scan([1, 1], 0, [0.0; 5])[..40]);
    let error = read_bag(whole(&[link, short]).as_slice(), None, Axes::ForwardLeftUp);
    assert!(error.unwrap_err().to_string().contains("a whole message"));
}

/// A camera's clouds beside those of the radar are no reason to ask.
#[test]
fn clouds_that_no_radar_sends_are_passed_over() {
    let camera = Cloud {
        fields: &FIELDS[..3],
        ..cloud()
    };
    let records = [
        connection(0, "/camera", "sensor_msgs/PointCloud2"),
        connection(1, "/radar", "sensor_msgs/PointCloud2"),
        connection(2, "/imu", "sensor_msgs/Imu"),
        camera.message(0, 1),
        cloud().message(1, 2),
        message_record(2, [0; 2], b"anything"),
    ];
    let read = |topic| read_bag(whole(&records).as_slice(), topic, Axes::ForwardLeftUp);
    let bag = read(None).unwrap();
    assert_eq!((bag.topic.as_str(), bag.other_messages), ("/radar", 2));
    assert!(
        bag.notes[0].starts_with("topic /camera is not read: "),
        "{:?}",
        bag.notes
    );
    // A choice is offered only where there is one.
    let error = read(Some("/camera")).unwrap_err();
    assert!(
        error.to_string().contains("expected fields `velocity`"),
        "{error}"
    );
    assert_eq!(error.choices, ["/camera", "/radar"]);
    let error = read(Some("/lidar")).unwrap_err();
    assert!(
        error.to_string().contains("`/imu (sensor_msgs/Imu)`"),
        "{error}"
    );
    let alone = whole(&[records[0].clone(), records[3].clone()]);
    let error = read_bag(alone.as_slice(), None, Axes::ForwardLeftUp).unwrap_err();
    assert_eq!(error.choices, [""; 0]);
}
