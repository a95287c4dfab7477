//! A message of ROS 2. The first byte chooses its type.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{Axes, Place, RosEncoding, RosMessages};

fuzz_target!(|bytes: &[u8]| {
    let Some((which, message)) = bytes.split_first() else {
        return;
    };
    let kind = match which % 2 {
        0 => "sensor_msgs/msg/PointCloud2",
        _ => "ti_mmwave_rospkg/msg/RadarScan",
    };
    let at = Place::Byte(0);
    let mut bag = RosMessages::new(None, Axes::ForwardLeftUp);
    let _ = bag.connect(at, 0, "/radar", kind, Some(RosEncoding::Cdr), None);
    let _ = bag.message(at, 0, Some(1.0), message);
    let _ = bag.finish(at);
});
