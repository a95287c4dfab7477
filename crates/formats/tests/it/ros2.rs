//! Messages of ROS 2, one after the other, without the files that hold them.

use proptest::prelude::*;
use radarllm_formats::recordings::{Axes, Bag, BagError, Place, RosEncoding, RosMessages};

use crate::make_ros2::{FIELDS, cloud, points, scan};

const CLOUD: &str = "sensor_msgs/msg/PointCloud2";

fn read(kind: &str, messages: &[Vec<u8>]) -> Result<Bag, BagError> {
    let mut bag = RosMessages::new(None, Axes::ForwardLeftUp);
    let at = Place::Byte(0);
    bag.connect(at, 7, "/radar", kind, Some(RosEncoding::Cdr), None)?;
    for (n, message) in messages.iter().enumerate() {
        bag.message(at, 7, Some(50.0 + n as f64), message)?;
    }
    bag.finish(at)
}

#[test]
fn clouds_say_the_same_in_both_byte_orders() {
    let messages = |big_endian| -> Vec<Vec<u8>> {
        (0..4)
            .map(|n| cloud([100, 250_000_000 * n], &FIELDS, &points(n), big_endian))
            .collect()
    };
    let little = read(CLOUD, &messages(false)).unwrap();
    assert_eq!(little, read(CLOUD, &messages(true)).unwrap());
    assert_eq!((little.topic.as_str(), little.frames.len()), ("/radar", 4));
    for (n, frame) in little.frames.iter().enumerate() {
        assert_eq!(frame.stamp_s, Some(100.0 + 0.25 * n as f64));
        for (p, expected) in frame.points.iter().zip(points(n as u32)) {
            let found = [p.y_m, -p.x_m, p.z_m, p.intensity_db, p.velocity_mps];
            assert_eq!(found.map(f64::from).to_vec(), expected);
        }
    }
}

#[test]
fn scans_are_frames_in_both_byte_orders() {
    for kind in [
        "ti_mmwave_rospkg_msgs/msg/RadarScan",
        "ti_mmwave_rospkg/msg/RadarScan",
    ] {
        for big_endian in [false, true] {
            let scan = |id, x| scan([100, 0], id, [x, -0.5, 0.25, 0.125, 20.0], big_endian);
            let bag = read(kind, &[scan(0, 1.0), scan(1, 2.0), scan(0, 3.0)]).unwrap();
            let sizes: Vec<usize> = bag.frames.iter().map(|f| f.points.len()).collect();
            assert_eq!(sizes, [2, 1]);
            let p = bag.frames[0].points[1];
            assert_eq!(
                [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
                [0.5, 2.0, 0.25, 0.125, 20.0]
            );
            // The stamps stand still, so that the times are those of the recorder, of the first point of each frame.
            assert_eq!(bag.frames[1].stamp_s, Some(52.0));
        }
    }
}

#[test]
fn damaged_messages_are_errors() {
    let whole = [
        cloud([100, 0], &FIELDS, &points(0), false),
        cloud([100, 0], &FIELDS, &points(0), true),
    ];
    for message in &whole {
        // The last byte says whether the cloud is dense, which is not read.
        for end in 0..message.len() - 1 {
            assert!(read(CLOUD, &[message[..end].to_vec()]).is_err(), "{end}");
        }
        for at in 0..message.len() {
            let mut damaged = message.clone();
            damaged[at] ^= 0xFF;
            let _ = read(CLOUD, &[damaged]);
        }
    }
    let mut other = whole[0].clone();
    other[1] = 3;
    let error = read(CLOUD, &[other]).unwrap_err().to_string();
    assert!(
        error.contains("CDR in plain representation, 0, 1, 6 or 7, found `3`"),
        "{error}"
    );
    let bare = cloud([1, 0], &FIELDS[..3], &[vec![1.0, 2.0, 3.0]], false);
    let error = read(CLOUD, &[bare]).unwrap_err().to_string();
    assert!(
        error.ends_with("expected fields `velocity`, found `x`, `y`, `z`"),
        "{error}"
    );
    let error = read("sensor_msgs/msg/Imu", &[whole[0].clone()])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("found `/radar (sensor_msgs/msg/Imu)`"),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn noise_is_no_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), low in 0_u8..8) {
        for kind in [CLOUD, "ti_mmwave_rospkg/msg/RadarScan"] {
            let _ = read(kind, std::slice::from_ref(&bytes));
            let _ = read(kind, &[[&[0, low, 0, 0], &bytes[..]].concat()]);
        }
    }
}
