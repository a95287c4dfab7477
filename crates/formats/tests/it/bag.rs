//! ROS bags, written by our own generator as the format's page describes them.

use radarllm_formats::recordings::{Axes, Place, read_bag};

use crate::make::{Cloud, FIELDS, bag, chunk, chunk_of, cloud, connection, pack, whole};

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
            assert_eq!(error.at, Place::Byte(whole(&[]).len() as u64));
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
    assert!(error(&two, None).contains("/a /b"));
    assert!(error(&[link.clone(), cloud().message(0, 1)], Some("/c")).contains("/c"));
    let bare = Cloud {
        fields: &FIELDS[..4],
        ..cloud()
    };
    assert!(error(&[link.clone(), bare.message(0, 1)], None).contains("`velocity`"));
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
    assert!(error(&[link], None).contains("a topic with PointCloud2 messages"));
    let huge = [b"#ROSBAG V2.0\n".as_slice(), &[0xFF; 4]].concat();
    let huge = read_bag(huge.as_slice(), None, Axes::ForwardLeftUp).unwrap_err();
    assert_eq!(huge.at, Place::Byte(13));
}
