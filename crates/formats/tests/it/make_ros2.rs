//! Messages of ROS 2 as CDR, made up, in both byte orders.

/// The field types of a cloud that are written here: float32 and float64.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Bytes with numbers at multiples of their size.
pub struct Cdr {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Cdr {
    /// The four bytes of the representation, and nothing yet.
    pub fn new(big_endian: bool) -> Self {
        Self {
            bytes: vec![0, u8::from(!big_endian), 0, 0],
            big_endian,
        }
    }

    pub fn put<const N: usize>(&mut self, mut little_endian: [u8; N]) -> &mut Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.big_endian {
            little_endian.reverse();
        }
        self.bytes.extend(little_endian);
        self
    }

    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.put(value.to_le_bytes())
    }

    pub fn block(&mut self, bytes: &[u8]) -> &mut Self {
        self.u32(bytes.len() as u32);
        self.bytes.extend(bytes);
        self
    }

    pub fn text(&mut self, text: &str) -> &mut Self {
        self.block(&[text.as_bytes(), &[0]].concat())
    }

    pub fn header(&mut self, [secs, nsecs]: [u32; 2]) -> &mut Self {
        self.u32(secs).u32(nsecs).text("radar")
    }

    pub fn finish(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }
}

/// A `PointCloud2` with these fields: the first ones are float32, the last one is float64. Every point has them in order, with
/// three bytes after it.
pub fn cloud(stamp: [u32; 2], fields: &[&str], points: &[Vec<f64>], big_endian: bool) -> Vec<u8> {
    let mut cdr = Cdr::new(big_endian);
    cdr.header(stamp).u32(1).u32(points.len() as u32);
    cdr.u32(fields.len() as u32);
    for (n, name) in fields.iter().enumerate() {
        let is_last = n + 1 == fields.len();
        let kind = if is_last { FLOAT64 } else { FLOAT32 };
        cdr.text(name).u32(4 * n as u32).put([kind]).u32(1);
    }
    let point_step = 4 * fields.len() as u32 + 4 + 3;
    cdr.put([u8::from(big_endian)]);
    cdr.u32(point_step).u32(point_step * points.len() as u32);
    let mut data = Vec::new();
    for point in points {
        for (n, value) in point.iter().enumerate() {
            let mut bytes = match n + 1 == fields.len() {
                true => value.to_le_bytes().to_vec(),
                false => (*value as f32).to_le_bytes().to_vec(),
            };
            if big_endian {
                bytes.reverse();
            }
            data.extend(bytes);
        }
        data.extend([0xEE; 3]);
    }
    cdr.block(&data).put([1]).finish()
}

/// A `RadarScan` of TI's driver: a point with x, y, z, velocity and intensity.
pub fn scan(stamp: [u32; 2], point_id: u16, point: [f32; 5], big_endian: bool) -> Vec<u8> {
    let [x, y, z, velocity_mps, intensity_db] = point;
    let mut cdr = Cdr::new(big_endian);
    cdr.header(stamp).put(point_id.to_le_bytes());
    for value in [x, y, z, 1.5, velocity_mps] {
        cdr.put(value.to_le_bytes());
    }
    cdr.put(7_u16.to_le_bytes());
    for value in [0.5, intensity_db] {
        cdr.put(value.to_le_bytes());
    }
    cdr.finish()
}

/// A message `radar_msgs/msg/RadarScan` of returns: range, azimuth, elevation, velocity and amplitude each.
pub fn returns(stamp: [u32; 2], returns: &[[f32; 5]], big_endian: bool) -> Vec<u8> {
    let mut cdr = Cdr::new(big_endian);
    cdr.header(stamp).u32(returns.len() as u32);
    for value in returns.iter().flatten() {
        cdr.put(value.to_le_bytes());
    }
    cdr.finish()
}

/// Names of the fields of a cloud, as drivers of TI's radars send them.
pub const FIELDS: [&str; 5] = ["x", "y", "z", "intensity", "velocity"];

/// Frame `n` of a recording: two points with x forward, y left, z up, intensity and velocity.
pub fn points(n: u32) -> Vec<Vec<f64>> {
    let n = f64::from(n);
    vec![
        vec![1.0 + n / 8.0, -0.5, 0.25, 20.0 + n, 0.125],
        vec![2.0, 0.5 + n / 16.0, -0.75, 15.5, -1.0],
    ]
}

/// A topic: its name, the type of its messages and their encoding.
pub type Topic<'a> = (&'a str, &'a str, &'a str);

/// A message: the place of its topic, the time at which it was recorded, ns, and its bytes.
pub type Message = (usize, u64, Vec<u8>);

/// A record of an MCAP file.
pub fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode], &(body.len() as u64).to_le_bytes()[..], body].concat()
}

/// A string of an MCAP file.
pub fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

/// An MCAP file. `pack` makes chunks of the records of four messages each, or leaves them as they are.
pub fn mcap(
    topics: &[Topic<'_>],
    messages: &[Message],
    pack: impl Fn(Vec<u8>) -> Vec<u8>,
) -> Vec<u8> {
    let mut file = b"\x89MCAP0\r\n".to_vec();
    file.extend(record(1, &[text("ros2"), text("test")].concat()));
    let mut declared = Vec::new();
    for (n, (name, kind, encoding)) in topics.iter().enumerate() {
        let id = (n as u16 + 1).to_le_bytes();
        let schema = [&id[..], &text(kind), &text("ros2msg"), &text("")].concat();
        declared.extend(record(3, &schema));
        let channel = [&id[..], &id, &text(name), &text(encoding), &[0; 4]].concat();
        declared.extend(record(4, &channel));
    }
    let message = |(topic, time, data): &Message| {
        let id = (*topic as u16 + 1).to_le_bytes();
        let times = [time.to_le_bytes(), time.to_le_bytes()].concat();
        record(5, &[&id[..], &[0; 4], &times, data].concat())
    };
    for messages in messages.chunks(4) {
        let records: Vec<u8> = messages.iter().flat_map(message).collect();
        file.extend(pack([&declared[..], &records].concat()));
    }
    file.extend(record(0x0F, &[0; 4]));
    file.extend(record(2, &[0; 20]));
    file.extend(b"\x89MCAP0\r\n");
    file
}
