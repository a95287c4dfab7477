//! The inputs of the stored outputs: every byte of them is made here, from formulas and a generator of whole numbers.
//!
//! Only formats that users own appear here, and no type of the workspace, so that moving code cannot change an input.

use std::{f64::consts::TAU, fmt::Write as _};

/// Whole numbers that are the same everywhere: MMIX's generator, Knuth 1997.
struct Random(u64);

impl Random {
    /// A multiple of 0.001 in `-1.0..1.0`.
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % 2000) as f64 / 1000.0 - 1.0
    }
}

/// x, y, z in m, radial velocity in m/s, intensity in dB.
pub type Point = [f64; 5];

fn to_thousandths(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}

/// Frames at 10 Hz with the points of people who walk straight on.
///
/// A person is `(x at the start, y at the start, speed along y)` in m and m/s.
pub fn cloud(n_frames: usize, people: &[(f64, f64, f64)]) -> Vec<Vec<Point>> {
    let mut random = Random(7);
    let frame = |i: usize| {
        let mut points = Vec::new();
        for &(x, y, speed) in people {
            let t = 0.1 * i as f64;
            for k in 0..16 {
                // The last four points are a leg and an arm that swing.
                let swing = if k < 12 { 0.0 } else { 0.8 * (TAU * t).sin() };
                let point = [
                    x + 0.2 * random.next(),
                    y + speed * t + 0.1 * random.next() + 0.3 * swing,
                    0.8 * random.next(),
                    speed + swing + 0.1 * random.next(),
                    20.0 + 5.0 * random.next(),
                ];
                points.push(point.map(to_thousandths));
            }
        }
        points
    };
    (0..n_frames).map(frame).collect()
}

/// Points as a table with named columns.
pub fn csv(frames: &[Vec<Point>]) -> String {
    let mut text = String::from("frame,t_s,x,y,z,velocity,intensity\n");
    for (i, points) in frames.iter().enumerate() {
        for [x, y, z, v, db] in points {
            let t = i as f64 / 10.0;
            writeln!(text, "{i},{t},{x},{y},{z},{v},{db}").unwrap();
        }
    }
    text
}

/// Points as RadHAR's text: x forward, y left.
pub fn radhar(frames: &[Vec<Point>]) -> String {
    let mut text = String::new();
    for (i, points) in frames.iter().enumerate() {
        let (secs, nsecs) = (10 + i / 10, i % 10 * 100_000_000);
        for (id, [x, y, z, v, db]) in points.iter().enumerate() {
            let range = to_thousandths((x * x + y * y + z * z).sqrt());
            write!(
                text,
                "header: \n  seq: {i}\n  stamp: \n    secs: {secs}\n    nsecs: {nsecs}\n  frame_id: \"r\"\n\
                 point_id: {id}\nx: {y}\ny: {}\nz: {z}\nrange: {range}\nvelocity: {v}\nintensity: {db}\n---\n",
                -x
            )
            .unwrap();
        }
    }
    text
}

/// Points as a table of MARS; intensities are peaks.
pub fn mars(frames: &[Vec<Point>]) -> String {
    let mut text = String::from("Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time\n");
    for (i, points) in frames.iter().enumerate() {
        for (k, [x, y, z, v, db]) in points.iter().enumerate() {
            writeln!(text, "{i},{k},{x},{y},{z},{v},{},1", db * 10.0).unwrap();
        }
    }
    text
}

/// MARS's feature maps: 64 points a frame, (N, 8, 8, 5).
pub fn mars_features(frames: &[Vec<Point>]) -> Vec<u8> {
    let mut values = Vec::new();
    for points in frames {
        for k in 0..64 {
            values.extend(points.get(k).copied().unwrap_or([0.0; 5]));
        }
    }
    npy(&format!("({}, 8, 8, 5)", frames.len()), &values)
}

/// Points as rows of seven numbers.
pub fn npy_table(frames: &[Vec<Point>]) -> Vec<u8> {
    let mut values = Vec::new();
    for (i, points) in frames.iter().enumerate() {
        for p in points {
            values.extend([i as f64, i as f64 / 10.0]);
            values.extend(p);
        }
    }
    npy(&format!("({}, 7)", values.len() / 7), &values)
}

/// A frame of MM-Fi: five doubles a point, x forward, y left.
pub fn mmfi(points: &[Point]) -> Vec<u8> {
    let rows = points.iter().map(|[x, y, z, v, db]| [*y, -x, *z, *v, *db]);
    rows.flatten().flat_map(f64::to_le_bytes).collect()
}

/// A frame of mmBody: six numbers a point.
pub fn mmbody(points: &[Point]) -> Vec<u8> {
    let rows = points.iter().map(|[x, y, z, v, db]| {
        let range = to_thousandths((x * x + y * y + z * z).sqrt());
        [*x, *y, *z, *v, range, *db]
    });
    npy(
        &format!("({}, 6)", points.len()),
        &rows.flatten().collect::<Vec<f64>>(),
    )
}

/// Points as the stream of TI's out-of-box demo: points, then SNR and noise in tenths of a decibel.
pub fn uart(frames: &[Vec<Point>]) -> Vec<u8> {
    let mut stream = Vec::new();
    for (i, points) in frames.iter().enumerate() {
        let n = points.len() as u32;
        let length = (40 + 8 + 16 * n + 8 + 4 * n).next_multiple_of(32);
        let start = stream.len();
        stream.extend([2, 1, 4, 3, 6, 5, 8, 7]);
        let words = [
            0x0306_0000,
            length,
            0xA6843,
            i as u32 + 1,
            0,
            n,
            2,
            0,
            1,
            16 * n,
        ];
        stream.extend(words.iter().flat_map(|w: &u32| w.to_le_bytes()));
        let places = points.iter().flat_map(|p| &p[..4]);
        stream.extend(places.flat_map(|v| (*v as f32).to_le_bytes()));
        stream.extend([7, 4 * n].iter().flat_map(|w: &u32| w.to_le_bytes()));
        for p in points {
            let snr = (p[4] * 10.0).round() as i16;
            stream.extend([snr, 45].iter().flat_map(|v| v.to_le_bytes()));
        }
        stream.resize(start + length as usize, 0);
    }
    stream
}

/// An npy file of `f32`.
pub fn npy(shape: &str, values: &[f64]) -> Vec<u8> {
    let mut header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}").into_bytes();
    // Header, magic and lengths fill whole blocks of 64 bytes, the last of which is a line end.
    while !(header.len() + 11).is_multiple_of(64) {
        header.push(b' ');
    }
    header.push(b'\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((header.len() as u16).to_le_bytes());
    file.extend(header);
    file.extend(values.iter().flat_map(|v| (*v as f32).to_le_bytes()));
    file
}

/// A small radar of three transmitters: 32 loops, 64 samples, 17 cm a bin, two lanes.
pub const SMALL_CFG: &str = "% Platform:xWR18xx
dfeDataOutputMode 1
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 7 58 0 0 15 1 64 1375 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 2 0 0 0 0 0 2
frameCfg 0 2 32 0 100 1 0
guiMonitor -1 1 0 0 0 0 0
lvdsStreamCfg -1 0 0 0
sensorStart
";

/// Raw words of [`SMALL_CFG`] as two lanes write them, I first: two moving echoes and noise.
pub fn raw_words(n_frames: usize) -> Vec<u8> {
    let mut random = Random(11);
    let mut words = Vec::new();
    for frame in 0..n_frames {
        for chirp in 0..32 * 3 {
            for rx in 0..4 {
                let mut samples = Vec::new();
                for s in 0..64 {
                    let (mut re, mut im) = (40.0 * random.next(), 40.0 * random.next());
                    // Cycles a chirp, cycles a chirp period, cycles a receiver, counts.
                    for (bin, doppler, angle, counts) in
                        [(14.3, 0.041, 0.11, 900.0), (22.6, -0.027, -0.07, 400.0)]
                    {
                        let bin = bin + 0.2 * frame as f64 * f64::signum(doppler);
                        let turns = bin * f64::from(s) / 64.0
                            + doppler * f64::from(chirp)
                            + angle * f64::from(rx);
                        re += counts * (TAU * turns).cos();
                        im += counts * (TAU * turns).sin();
                    }
                    samples.push([re.round() as i16, im.round() as i16]);
                }
                for pair in samples.chunks(2) {
                    words.extend([pair[0][0], pair[1][0], pair[0][1], pair[1][1]]);
                }
            }
        }
    }
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// A person in centimetres: name, parent, offset (y up, facing z, left at positive x).
const PERSON: [(&str, usize, [f64; 3]); 18] = [
    ("Hips", 0, [0.0, 95.0, 0.0]),
    ("LeftUpLeg", 0, [9.0, -5.0, 0.0]),
    ("LeftLeg", 1, [0.0, -42.0, 0.0]),
    ("LeftFoot", 2, [0.0, -40.0, 0.0]),
    ("LeftToeBase", 3, [0.0, -5.0, 13.0]),
    ("RightUpLeg", 0, [-9.0, -5.0, 0.0]),
    ("RightLeg", 5, [0.0, -42.0, 0.0]),
    ("RightFoot", 6, [0.0, -40.0, 0.0]),
    ("RightToeBase", 7, [0.0, -5.0, 13.0]),
    ("Spine", 0, [0.0, 12.0, 0.0]),
    ("Spine1", 9, [0.0, 25.0, 0.0]),
    ("Head", 10, [0.0, 25.0, 2.0]),
    ("LeftArm", 10, [17.0, 12.0, 0.0]),
    ("LeftForeArm", 12, [27.0, 0.0, 0.0]),
    ("LeftHand", 13, [25.0, 0.0, 0.0]),
    ("RightArm", 10, [-17.0, 12.0, 0.0]),
    ("RightForeArm", 15, [-27.0, 0.0, 0.0]),
    ("RightHand", 16, [-25.0, 0.0, 0.0]),
];

/// Degrees about x, y and z of a joint of somebody who strides with hanging arms.
fn angles_deg(joint: usize, t_s: f64) -> [f64; 3] {
    let stride = (TAU * 0.9 * t_s).sin();
    let angles = match joint {
        1 => [-25.0 * stride, 0.0, 0.0],
        5 => [25.0 * stride, 0.0, 0.0],
        2 => [20.0 + 20.0 * stride, 0.0, 0.0],
        6 => [20.0 - 20.0 * stride, 0.0, 0.0],
        12 => [0.0, 0.0, -70.0],
        15 => [0.0, 0.0, 70.0],
        13 => [0.0, -30.0 - 20.0 * stride, 0.0],
        16 => [0.0, 30.0 - 20.0 * stride, 0.0],
        _ => [0.0; 3],
    };
    angles.map(to_thousandths)
}

/// Somebody who strides forward at 0.8 m/s, as BVH at 30 Hz.
pub fn bvh(n_frames: usize) -> String {
    let mut text = String::from("HIERARCHY\n");
    let mut open: Vec<usize> = Vec::new();
    for (i, (name, parent, [x, y, z])) in PERSON.iter().enumerate() {
        while open.last().is_some_and(|last| last != parent) {
            text.push_str("}\n");
            open.pop();
        }
        let (kind, channels) = match i {
            0 => ("ROOT", "6 Xposition Yposition Zposition"),
            _ => ("JOINT", "3"),
        };
        writeln!(
            text,
            "{kind} {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS {channels} Zrotation Xrotation Yrotation"
        )
        .unwrap();
        if !PERSON.iter().skip(1).any(|(_, p, _)| *p == i) {
            text.push_str("End Site\n{\nOFFSET 0 0 1\n}\n");
        }
        open.push(i);
    }
    text.push_str(&"}\n".repeat(open.len()));
    writeln!(text, "MOTION\nFrames: {n_frames}\nFrame Time: 0.0333333").unwrap();
    for frame in 0..n_frames {
        let t_s = frame as f64 / 30.0;
        write!(text, "0 95 {}", to_thousandths(80.0 * t_s)).unwrap();
        for joint in 0..PERSON.len() {
            let [x, y, z] = angles_deg(joint, t_s);
            write!(text, " {z} {x} {y}").unwrap();
        }
        text.push('\n');
    }
    text
}

/// The same as ASF and AMC, in CMU's units.
pub fn asf_amc(n_frames: usize) -> (String, String) {
    let unit_cm = 2.54 / 0.45;
    let bone = |i: usize| if i == 0 { "root" } else { PERSON[i].0 };
    let mut asf = String::from(
        ":version 1.10\n:name test\n:units\n mass 1.0\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n \
         axis XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n",
    );
    let mut hierarchy = String::from(":hierarchy\n begin\n");
    for (i, (name, parent, offset)) in PERSON.iter().enumerate().skip(1) {
        let length = offset.iter().map(|v| v * v).sum::<f64>().sqrt();
        let [x, y, z] = offset.map(|v| v / length);
        // A helper from the parent's joint to this one, then the joint as a bone without length.
        writeln!(
            asf,
            " begin\n id {i}\n name to{i}\n direction {x:.6} {y:.6} {z:.6}\n length {:.6}\n axis 0 0 0 XYZ\n end\n \
             begin\n id {}\n name {name}\n direction 0 1 0\n length 0\n axis 0 0 0 XYZ\n dof rx ry rz\n limits (0 1)\n end",
            length / unit_cm,
            i + 100
        )
        .unwrap();
        writeln!(hierarchy, " {} to{i}\n to{i} {name}", bone(*parent)).unwrap();
    }
    asf.push_str(&hierarchy);
    asf.push_str(" end\n");
    let mut amc = String::from("#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n");
    for frame in 0..n_frames {
        let t_s = frame as f64 / 120.0;
        let z = 80.0 * t_s / unit_cm;
        writeln!(
            amc,
            "{}\nroot 0 {:.5} {z:.5} 0 0 0",
            frame + 1,
            95.0 / unit_cm
        )
        .unwrap();
        for joint in 1..PERSON.len() {
            let [x, y, z] = angles_deg(joint, t_s);
            writeln!(amc, "{} {x} {y} {z}", bone(joint)).unwrap();
        }
    }
    (asf, amc)
}

/// A room with a walker, a corner reflector and reflections over two surfaces.
pub const ROOM: &str = "duration_s = 1.0
max_bounces = 2
bounce_rays = 64
[room]
facet_edge_m = 0.05
[impairments]
preset = \"typical\"
[[target]]
kind = \"motion\"
file = \"builtin:walk?distance_m=1\"
position_m = [-0.6, 3.5, -1.0]
facet_edge_m = 0.05
[[target]]
kind = \"trihedral\"
position_m = [0.8, 4.5, 0.0]
size_m = [0.1, 0.1]
facet_edge_m = 0.05
";

/// Two people in free space: one comes, one leaves.
pub const TWO_PEOPLE: &str = "duration_s = 3.0
max_bounces = 1
[[target]]
kind = \"motion\"
file = \"builtin:walk?duration_s=3\"
position_m = [-1.0, 4.5, -1.0]
[[target]]
kind = \"motion\"
file = \"builtin:walk?direction=backward&duration_s=3\"
position_m = [1.0, 2.5, -1.0]
";

/// A point that moves past one that stands still, and the latter alone.
pub const LAMP: &str = "[[target]]\nkind = \"point\"\nposition_m = [0.5, 2.5, 0.0]\nvelocity_mps = [0.0, 0.0, 0.0]\n\
     rcs_m2 = 10.0\n";
pub const PASSER_BY: &str = "[[target]]\nkind = \"point\"\nposition_m = [-0.4, 3.6, 0.0]\nvelocity_mps = [0.2, 1.0, 0.0]\n\
     rcs_m2 = 1.0\n";

pub const CANDIDATES: &str = r#"{"id": "a", "text": "a person walks backwards slowly"}
{"id": "b", "text": "the man is waving his left hand"}
{"id": "c", "text": "somebody sits down on a chair, then stands up"}
{"id": "d", "text": "a person jumps"}
{"id": "e", "text": "this person doesn't move"}
"#;
pub const REFERENCES: &str = r#"{"id": "a", "texts": ["a person is walking backwards", "someone walks in reverse slowly", "a man walks backward"]}
{"id": "b", "texts": ["a person waves the left hand", "a man waves with his left arm", "he is waving"]}
{"id": "c", "texts": ["a person sits down on a chair and stands up", "someone sits, then gets up", "a person takes a seat and rises"]}
{"id": "d", "texts": ["a person falls to the floor", "somebody collapses", "a person drops down"]}
{"id": "e", "texts": ["a person stands still", "this person doesn't move", "nobody moves; they are standing"]}
"#;

pub const DATA_SET: &str = "name = \"tiny\"\nseed = 5\nshard_clips = 2\nmax_frames = 12\n[[source]]\nkind = \"procedural\"\n\
     train = 3\nval = 1\ntest = 1\n";
