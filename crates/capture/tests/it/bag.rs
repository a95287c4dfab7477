//! ROS bags, written by the generator below as the format's page describes them.

use radarllm_capture::recordings::{Axes, Place, read_bag};

fn field(name: &str, value: &[u8]) -> Vec<u8> {
    let body = [name.as_bytes(), b"=", value].concat();
    [(body.len() as u32).to_le_bytes().to_vec(), body].concat()
}

fn block(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header: Vec<u8> = fields.iter().flat_map(|(n, v)| field(n, v)).collect();
    [block(&header), block(data)].concat()
}

fn connection(id: u32, topic: &str, kind: &str) -> Vec<u8> {
    let data = [
        field("topic", topic.as_bytes()),
        field("type", kind.as_bytes()),
    ]
    .concat();
    record(
        &[
            ("op", &[7]),
            ("conn", &id.to_le_bytes()),
            ("topic", topic.as_bytes()),
        ],
        &data,
    )
}

/// Fields as (name, offset, datatype).
struct Cloud<'a> {
    fields: &'a [(&'a str, u32, u8)],
    point_step: u32,
    /// Bytes after the points of a row.
    row_padding: u32,
    width: u32,
    big_endian: bool,
    data: Vec<u8>,
}

impl Cloud<'_> {
    fn message(&self, id: u32, secs: u32) -> Vec<u8> {
        let mut m = Vec::new();
        let word = |m: &mut Vec<u8>, v: u32| m.extend(v.to_le_bytes());
        word(&mut m, 0);
        word(&mut m, secs);
        word(&mut m, 500_000_000);
        m.extend(block(b"radar"));
        let row_step = self.width * self.point_step + self.row_padding;
        word(&mut m, self.data.len() as u32 / row_step.max(1));
        word(&mut m, self.width);
        word(&mut m, self.fields.len() as u32);
        for (name, offset, datatype) in self.fields {
            m.extend(block(name.as_bytes()));
            word(&mut m, *offset);
            m.push(*datatype);
            word(&mut m, 1);
        }
        m.push(u8::from(self.big_endian));
        word(&mut m, self.point_step);
        word(&mut m, row_step);
        m.extend(block(&self.data));
        m.push(1);
        record(
            &[("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &[0; 8])],
            &m,
        )
    }
}

const FIELDS: [(&str, u32, u8); 5] = [
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("intensity", 16, 4),
    ("velocity", 20, 8),
];

/// Two points of 28 bytes: (1, 2, 3), 30 dB, -0.5 m/s, and a NaN.
fn cloud() -> Cloud<'static> {
    let mut data = Vec::new();
    for x in [1.0_f32, f32::NAN] {
        for v in [x, 2.0, 3.0, 9.0] {
            data.extend(v.to_le_bytes());
        }
        data.extend(30_u16.to_le_bytes());
        data.extend([0; 2]);
        data.extend((-0.5_f64).to_le_bytes());
    }
    data.extend([0xEE; 4]);
    Cloud {
        fields: &FIELDS,
        point_step: 28,
        row_padding: 4,
        width: 2,
        big_endian: false,
        data,
    }
}

fn chunk(compression: &str, records: &[Vec<u8>]) -> Vec<u8> {
    record(
        &[
            ("op", &[5]),
            ("compression", compression.as_bytes()),
            ("size", &[0; 4]),
        ],
        &records.concat(),
    )
}

fn whole(records: &[Vec<u8>]) -> Vec<u8> {
    let header = record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 64]);
    [b"#ROSBAG V2.0\n".to_vec(), header, records.concat()].concat()
}

/// A bag with two clouds and a message of another kind.
pub fn bag() -> Vec<u8> {
    whole(&[chunk(
        "none",
        &[
            connection(0, "/radar", "sensor_msgs/PointCloud2"),
            connection(1, "/chat", "std_msgs/String"),
            cloud().message(0, 100),
            record(&[("op", &[2]), ("conn", &1_u32.to_le_bytes())], b"hello"),
            cloud().message(0, 101),
        ],
    )])
}

#[test]
fn clouds_come_out_by_declared_fields() {
    let read = read_bag(bag().as_slice(), None, Axes::ForwardLeftUp).unwrap();
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
    assert!(error(&[chunk("bz2", &[])], None).contains("rosbag decompress"));
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
