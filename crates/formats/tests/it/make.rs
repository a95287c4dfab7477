//! Small recordings of every format, made up: for the tests, and as seeds for the fuzz targets (fuzz/src/seeds.rs).

use std::io::Write;

#[path = "make_uart.rs"]
mod make_uart;

pub use make_uart::*;

pub fn field(name: &str, value: &[u8]) -> Vec<u8> {
    let body = [name.as_bytes(), b"=", value].concat();
    [(body.len() as u32).to_le_bytes().to_vec(), body].concat()
}

pub fn block(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

pub fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header: Vec<u8> = fields.iter().flat_map(|(n, v)| field(n, v)).collect();
    [block(&header), block(data)].concat()
}

pub fn connection(id: u32, topic: &str, kind: &str) -> Vec<u8> {
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
pub struct Cloud<'a> {
    pub fields: &'a [(&'a str, u32, u8)],
    pub point_step: u32,
    /// Bytes after the points of a row.
    pub row_padding: u32,
    pub width: u32,
    pub big_endian: bool,
    pub data: Vec<u8>,
}

impl Cloud<'_> {
    pub fn message(&self, id: u32, secs: u32) -> Vec<u8> {
        message_record(id, [0; 2], &self.ros1([secs, 500_000_000]))
    }

    /// The message of ROS 1 with a stamp of seconds and nanoseconds.
    pub fn ros1(&self, stamp: [u32; 2]) -> Vec<u8> {
        let mut m = Vec::new();
        let word = |m: &mut Vec<u8>, v: u32| m.extend(v.to_le_bytes());
        word(&mut m, 0);
        word(&mut m, stamp[0]);
        word(&mut m, stamp[1]);
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
        m
    }
}

/// A message in a bag of ROS 1 that was recorded at a time of seconds and nanoseconds.
pub fn message_record(id: u32, time: [u32; 2], message: &[u8]) -> Vec<u8> {
    let time: Vec<u8> = time.into_iter().flat_map(u32::to_le_bytes).collect();
    record(
        &[("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &time)],
        message,
    )
}

/// A message `RadarScan` of TI's driver in ROS 1: a point with x, y, z, velocity and intensity.
pub fn radar_scan(stamp: [u32; 2], point_id: u16, [x, y, z, v, snr]: [f32; 5]) -> Vec<u8> {
    let mut m = 9_u32.to_le_bytes().to_vec();
    m.extend(stamp.into_iter().flat_map(u32::to_le_bytes));
    m.extend(block(b"base_radar_link"));
    m.extend(point_id.to_le_bytes());
    m.extend([x, y, z, 1.5, v].into_iter().flat_map(f32::to_le_bytes));
    m.extend(7_u16.to_le_bytes());
    m.extend([0.5, snr].into_iter().flat_map(f32::to_le_bytes));
    m
}

pub const FIELDS: [(&str, u32, u8); 5] = [
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("intensity", 16, 4),
    ("velocity", 20, 8),
];

/// Two points of 28 bytes: (1, 2, 3), 30 dB, -0.5 m/s, and a NaN.
pub fn cloud() -> Cloud<'static> {
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

/// Records in a chunk, compressed as named: none, bz2 or lz4.
pub fn chunk(compression: &str, records: &[Vec<u8>]) -> Vec<u8> {
    let plain = records.concat();
    chunk_of(compression, plain.len() as u32, &pack(compression, &plain))
}

/// A chunk whose header says what it is told.
pub fn chunk_of(compression: &str, size: u32, data: &[u8]) -> Vec<u8> {
    let fields: [(&str, &[u8]); 3] = [
        ("op", &[5]),
        ("compression", compression.as_bytes()),
        ("size", &size.to_le_bytes()),
    ];
    record(&fields, data)
}

/// Bytes compressed; under any other name as they are.
pub fn pack(compression: &str, plain: &[u8]) -> Vec<u8> {
    match compression {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
            encoder.write_all(plain).unwrap();
            encoder.finish().unwrap()
        }
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(plain).unwrap();
            encoder.finish().unwrap()
        }
        _ => plain.to_vec(),
    }
}

pub fn whole(records: &[Vec<u8>]) -> Vec<u8> {
    let header = record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 64]);
    [b"#ROSBAG V2.0\n".to_vec(), header, records.concat()].concat()
}

/// A bag with two clouds and a message of another kind, its chunk compressed as named.
pub fn bag(compression: &str) -> Vec<u8> {
    whole(&[chunk(
        compression,
        &[
            connection(0, "/radar", "sensor_msgs/PointCloud2"),
            connection(1, "/chat", "std_msgs/String"),
            cloud().message(0, 100),
            record(&[("op", &[2]), ("conn", &1_u32.to_le_bytes())], b"hello"),
            cloud().message(0, 101),
        ],
    )])
}

pub const CSV: &str =
    "frame,t_s,x,y,z,velocity,intensity\n0,0,0.5,2,0,0.25,20\n1,0.1,0.5,2,0,0.25,20\n";
/// Tables of every kind for the fuzz target, by name.
pub const TABLES: [(&str, &str); 8] = [
    ("table", CSV),
    (
        "quoted",
        "\"frame\",\"note\",\"x\",\"y\",\"z\",\"v\",\"snr\"\r\n\"0\",\"a, \"\"b\"\"\nc\",\"1\",\"2\",\"0\",\"0.1\",\"15\"\r\n",
    ),
    (
        "milliseconds",
        "timestamp,x,y,z,v,snr\n100,1,2,0,0.1,15\n200,1,2,0,0.1,NaN\n300,,,,,\n",
    ),
    (
        "dates",
        "timestamp,x,y,z,v,snr\n2024-12-16 10:00:00.100000,1,2,0,0.1,15\n2024-12-16 10:00:00.2+01:00,1,2,0,0.1,15\n",
    ),
    (
        "spherical",
        "frame,t,range,azimuth,elevation,doppler\n7,23:59:59.95,2,-30,10,0.5\n1,00:00:00.05,2,30,-10,0.5\n",
    ),
    (
        "decimal-commas",
        "frame;x;y;z;velocity;snr\n1;0,5;2;-0,25;0,125;15\n",
    ),
    (
        "tenths",
        "frame,DetObj#,x,y,z,v,snr,noise\n0,0,1,2,0,0.1,150,700\n",
    ),
    ("without-header", "1,0.0,3.0,-0.8,0.1,15,1734343200100\n"),
];
pub const MARS: &str = "Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time\n7,1,0.5,2,-1,0.356,10,1\n";
pub const RADHAR: &str =
    "point_id: 0\nx: 1\ny: -0.5\nz: 0.25\nvelocity: 0.6\nintensity: 30.5\n---\n";
pub const CALIBRATION: &str = "{'a': [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}";

/// An npy file of f4.
pub fn npy(descr: &str, shape: &str, values: &[f32]) -> Vec<u8> {
    let text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

pub fn seeds() -> Vec<Vec<u8>> {
    let named = "[('frame', '<f4'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('v', '<f4'), ('snr', '<f4')]";
    vec![
        CSV.into(),
        MARS.into(),
        RADHAR.into(),
        CALIBRATION.into(),
        npy(
            "'<f4'",
            "(2, 7)",
            &[
                0.0, 0.0, 0.5, 2.0, 0.0, 0.25, 20.0, 1.0, 0.1, 0.5, 2.0, 0.0, 0.25, 20.0,
            ],
        ),
        npy(
            named,
            "(2,)",
            &[
                0.0, 0.5, 2.0, 0.0, 0.25, 20.0, 1.0, 0.5, 2.0, 0.0, 0.25, 20.0,
            ],
        ),
        npy("'<f4'", "(1, 8, 8, 5)", &[0.5; 320]),
        npy("'<f4'", "(2, 6)", &[0.5; 12]),
        npy("'<f4'", "(2, 5)", &[0.5; 10]),
        bag("none"),
        replay(7, 3).into(),
        mars_mat(2, true),
        mat(&[("marsData", &[1, 64, 5], &[0.5; 320])], false),
    ]
}

/// Chirp file of a wall-mounted people counter, shortened: what a visualizer stores with its recordings.
pub const WALL_CFG: &str = "sensorStop\nflushCfg\ndfeDataOutputMode 1\nchannelCfg 15 7 0\nadcCfg 2 1\n\
    adcbufCfg -1 0 1 1 1\nprofileCfg 0 60.75 30.00 25.00 59.10 657930 0 54.71 1 96 2950.00 2 1 36\n\
    chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 2\nchirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 96 0 55.00 1 0\n\
    sensorPosition 2 0 15\nsensorStart\n";

/// A visualizer's JSON file with the given entries of `data`.
pub fn replay_of(demo: &str, device: &str, entries: &[String]) -> String {
    let lines: Vec<String> = WALL_CFG
        .lines()
        .map(|line| format!("\"{line}\\n\""))
        .collect();
    let lines = lines.join(", ");
    format!(
        "{{\n    \"cfg\": [{lines}],\n    \"demo\": \"{demo}\",\n    \"device\": \"{device}\",\n    \"data\": [{}]\n}}",
        entries.join(", ")
    )
}

/// One entry of `data`: a frame with rows of `pointCloud`, 55 ms after the one before it.
pub fn replay_frame(number: u32, rows: &str) -> String {
    format!(
        "{{\"frameData\": {{\"error\": 0, \"frameNum\": {number}, \"pointCloud\": [{rows}], \"numDetectedPoints\": 1}}, \
         \"timestamp\": {}}}",
        1_700_000_000_000.5 + 55.0 * f64::from(number)
    )
}

/// A file of `n` frames with a point each, a track and its height.
pub fn replay(first: u32, n: u32) -> String {
    let entries: Vec<String> = (first..first + n)
        .map(|i| {
            replay_frame(i, "[0.5, 3.0, 1.25, -0.5, 100.0, 2.0, 255.0]").replace(
                "\"numDetectedPoints\"",
                "\"trackData\": [[0, 0.5, 3, 1, 0, -0.5, 0, 0, 0, 0, 3.0, 0.9, 1]], \
                 \"heightData\": [[0, 1.75, 0.25]], \"trackIndexes\": [255], \"numDetectedPoints\"",
            )
        })
        .collect();
    replay_of("3D People Tracking", "xWR6843", &entries)
}

/// An element of a MATLAB v5 file, padded.
pub fn mat_element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = words(&[kind, data.len() as u32]);
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A MATLAB v5 file with variables of f32 (name, shape, values with the first index fastest), compressed or not.
pub fn mat(variables: &[(&str, &[u32], &[f32])], is_compressed: bool) -> Vec<u8> {
    let mut file = b"MATLAB 5.0 MAT-file, made by a test".to_vec();
    file.resize(124, b' ');
    file.extend([0, 1, b'I', b'M']);
    for (name, shape, values) in variables {
        let parts = [
            mat_element(6, &words(&[7, 0])),
            mat_element(5, &words(shape)),
            mat_element(1, name.as_bytes()),
            mat_element(7, &floats(values)),
        ];
        let matrix = mat_element(14, &parts.concat());
        if is_compressed {
            let mut encoder =
                flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
            encoder.write_all(&matrix).unwrap();
            let data = encoder.finish().unwrap();
            file.extend(words(&[15, data.len() as u32]));
            file.extend(data);
        } else {
            file.extend(matrix);
        }
    }
    file
}

/// `marsData` of frames with one point each: x = 0.25 times the frame, y = 2, z = 1, 0.5 m/s, 20 dB in the third row.
pub fn mars_mat(n_frames: usize, is_compressed: bool) -> Vec<u8> {
    let mut values = vec![0.0_f32; n_frames * 64 * 5];
    for frame in 0..n_frames {
        let point = [0.25 * frame as f32, 2.0, 1.0, 0.5, 20.0];
        for (k, value) in point.into_iter().enumerate() {
            values[frame + n_frames * (2 + 64 * k)] = value;
        }
    }
    let other: (&str, &[u32], &[f32]) = ("frameRate", &[1, 1], &[10.0]);
    let points: (&str, &[u32], &[f32]) = ("marsData", &[n_frames as u32, 64, 5], &values);
    mat(&[other, points], is_compressed)
}
