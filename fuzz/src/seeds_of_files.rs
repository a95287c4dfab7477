//! Seeds of the targets of motion files, body models, models, Parquet, configurations and the live server. Everything is
//! made here or by our own writers.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, Encoding, Type};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{
    BoolType, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type,
};
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use radarllm_base::{BoardReport, BoardTrack, Joint, PointFrame, RadarPoint};
use radarllm_dataset::{
    BuildOptions, BuildPlan, ClipRecord, DatasetError, ItemId, MOTION_FEATURE_DIM, Overwrite,
    PointsMeta, SourceLicence, Split, build, write_points,
};
use radarllm_engine::{HostTensor, NamedTensors};
use radarllm_files::npy::{NpyElement, NpyWriter};
use radarllm_fuzz::{NOW_MS, archive, moving_up_and_down, pack, write_memory};
use radarllm_inference::checkpoint::{CheckpointError, CheckpointFiles};
use radarllm_inference::lm::card::LmCard;
use radarllm_inference::lm::{
    EngineLm, FeedForward, LmConfig, LmError, NetworkConfig, Precision, T5Config, Vocab,
};
use radarllm_inference::tokenizer::encode::TokenizerFile;
use radarllm_inference::tokenizer::{RadarTokenizer, TokenizerConfig};
use radarllm_teach::Memory;

/// Where seeds are written: target, name, bytes.
pub type Write<'a> = &'a dyn Fn(&str, &str, &[u8]) -> io::Result<()>;

/// All seeds of this file.
pub fn write_all(write: Write) -> io::Result<()> {
    points(write)?;
    shards(write)?;
    motions(write)?;
    smplx(write)?;
    model(write)?;
    tokenizer(write)?;
    configurations(write)?;
    server(write)?;
    broker(write)?;
    taught(write)?;
    database(write)
}

fn wave(i: usize) -> f32 {
    (i as f32 * 0.37).sin()
}

fn frames(n: u32) -> Vec<PointFrame> {
    let frame = |frame: u32| PointFrame {
        frame,
        time_s: f64::from(frame) * 0.1,
        points: (0..frame % 4)
            .map(|k| RadarPoint {
                x_m: wave(k as usize),
                y_m: 2.0 + 0.1 * frame as f32,
                z_m: 0.5 * wave(frame as usize),
                range_m: 2.5,
                velocity_mps: 0.5,
                intensity_db: 20.0 + k as f32,
            })
            .collect(),
        board: None,
    };
    (0..n).map(frame).collect()
}

fn points(write: Write) -> io::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("points.parquet");
    let meta = |source: &str| PointsMeta {
        radar: "awr1843boost".into(),
        source: source.into(),
        seed: None,
        version: "0.1.0".into(),
        radar_height_m: Some(1.0),
        frame_rate_hz: 10.0,
        has_speeds: true,
    };
    let mut with_board = frames(6);
    for frame in &mut with_board {
        frame.board = Some(BoardReport {
            tracks: (0..frame.frame % 3)
                .map(|id| BoardTrack {
                    id,
                    place_m: [0.1, 2.0],
                    height_m: (id == 1).then_some(0.3),
                    velocity_mps: [0.0, 0.5, 0.0],
                })
                .collect(),
            is_present: Some(frame.frame > 1),
        });
    }
    let mut lost = frames(8);
    lost.remove(3);
    for (name, source, frames) in [
        ("plain", "recorded:csv:a.csv", frames(6)),
        ("board", "recorded:uart:a.dat", with_board),
        ("lost", "recorded:csv:a.csv", lost),
        ("none", "recorded:csv:a.csv", Vec::new()),
    ] {
        write_points(&path, &meta(source), &frames, Overwrite::Replace).expect("points");
        write("points_parquet", name, &fs::read(&path)?)?;
        for (kind, bytes) in rewritten(&path) {
            write("points_parquet", &format!("{name}-{kind}"), &bytes)?;
        }
    }
    Ok(())
}

fn shards(write: Write) -> io::Result<()> {
    let folder = tempfile::tempdir()?;
    let item = |id: &str| ItemId {
        id: id.into(),
        group: "walks".into(),
        split: Split::Train,
    };
    let clip = |n_frames: u32, n_poses: usize, n_captions: usize| {
        move |item: &ItemId| -> Result<ClipRecord, DatasetError> {
            Ok(ClipRecord {
                id: item.id.clone(),
                motion_id: "walk".into(),
                group: item.group.clone(),
                split: item.split,
                action: "walk".into(),
                captions: (0..n_captions)
                    .map(|i| format!("a person walks {i}"))
                    .collect(),
                source: "procedural".into(),
                radar: "awr1843boost".into(),
                radar_height_m: 1.0,
                seed: 7,
                frames: frames(n_frames),
                motion_fps: 20.0,
                joints: vec![[[0.5, 1.0, 1.5]; 22]; n_poses],
                motion_features: vec![0.25; n_poses * MOTION_FEATURE_DIM],
                rotations6d: vec![[[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]; 22]; n_poses],
                body_height_m: 1.75,
            })
        }
    };
    for (name, n_frames, n_poses) in [("points", 4, 0), ("poses", 2, 1)] {
        let dir = folder.path().join(name);
        let plan = BuildPlan {
            name: "fuzz".into(),
            tool_version: "0".into(),
            arithmetic: "fuzz".into(),
            radar: "awr1843boost".into(),
            frame_rate_hz: 10.0,
            seed: 7,
            config_toml: String::new(),
            skipped: Vec::new(),
            licences: vec![SourceLicence {
                source: "procedural".into(),
                licence: "MIT OR Apache-2.0".into(),
                attribution: "made here".into(),
                synthetic: true,
            }],
            shard_size: 8,
            items: vec![item("walk#0"), item("walk#1")],
        };
        let make = clip(n_frames, n_poses, 2);
        build(
            &dir,
            &plan,
            BuildOptions {
                threads: 1,
                overwrite: Overwrite::Refuse,
                retry_failed: false,
            },
            make,
            |_| (),
        )
        .expect("a data set");
        let path = dir.join("data/train-00000-of-00001.parquet");
        write("shards", name, &fs::read(&path)?)?;
        for (kind, bytes) in rewritten(&path) {
            write("shards", &format!("{name}-{kind}"), &bytes)?;
        }
        if name == "points" {
            let manifest = fs::read(dir.join("manifest.json"))?;
            write("toml", "manifest", &[&[7], &manifest[..]].concat())?;
        }
    }
    Ok(())
}

/// The same columns without compression, whose bytes a fuzzer can change: with and without dictionaries, with pages of both
/// versions.
fn rewritten(path: &Path) -> Vec<(&'static str, Vec<u8>)> {
    let kinds = [
        ("v1", WriterVersion::PARQUET_1_0, true),
        ("v2", WriterVersion::PARQUET_2_0, true),
        ("v2-plain", WriterVersion::PARQUET_2_0, false),
    ];
    kinds
        .map(|(name, version, dictionary)| {
            let properties = WriterProperties::builder()
                .set_compression(Compression::UNCOMPRESSED)
                .set_writer_version(version)
                .set_dictionary_enabled(dictionary);
            let properties = match dictionary {
                true => properties,
                false => properties.set_encoding(Encoding::PLAIN),
            };
            (name, rewrite(path, properties.build()))
        })
        .into()
}

fn rewrite(path: &Path, properties: WriterProperties) -> Vec<u8> {
    let reader = SerializedFileReader::new(File::open(path).expect("a file")).expect("Parquet");
    let file = reader.metadata().file_metadata();
    let schema = file.schema_descr().root_schema_ptr();
    let mut properties = properties.into_builder();
    if let Some(pairs) = file.key_value_metadata() {
        properties = properties.set_key_value_metadata(Some(pairs.clone()));
    }
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties.build()))
        .expect("Parquet");
    for i in 0..reader.num_row_groups() {
        let group = reader.get_row_group(i).expect("a row group");
        let mut to = writer.next_row_group().expect("a row group");
        for column in 0..group.num_columns() {
            let from = group.get_column_reader(column).expect("a column");
            let to = to.next_column().expect("a column").expect("a column");
            copy(from, to);
        }
        to.close().expect("a row group");
    }
    writer.close().expect("Parquet");
    bytes
}

fn copy(from: ColumnReader, to: SerializedColumnWriter<'_>) {
    match from {
        ColumnReader::BoolColumnReader(r) => copy_as::<BoolType>(r, to),
        ColumnReader::Int32ColumnReader(r) => copy_as::<Int32Type>(r, to),
        ColumnReader::Int64ColumnReader(r) => copy_as::<Int64Type>(r, to),
        ColumnReader::FloatColumnReader(r) => copy_as::<FloatType>(r, to),
        ColumnReader::DoubleColumnReader(r) => copy_as::<DoubleType>(r, to),
        ColumnReader::ByteArrayColumnReader(r) => copy_as::<ByteArrayType>(r, to),
        _ => panic!("no column of ours has type {:?}", Type::INT96),
    }
}

fn copy_as<T: DataType>(
    mut from: parquet::column::reader::ColumnReaderImpl<T>,
    mut to: SerializedColumnWriter<'_>,
) {
    let (mut values, mut definitions, mut repetitions) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let (rows, ..) = from
            .read_records(
                1_000,
                Some(&mut definitions),
                Some(&mut repetitions),
                &mut values,
            )
            .expect("a column");
        if rows == 0 {
            break;
        }
    }
    let some = |levels: &'_ [i16]| (!levels.is_empty()).then(|| levels.to_vec());
    to.typed::<T>()
        .write_batch(
            &values,
            some(&definitions).as_deref(),
            some(&repetitions).as_deref(),
        )
        .expect("a column");
    to.close().expect("a column");
}

/// A T-pose person in centimetres: name, parent, offset (y up, facing z, left at +x).
const PERSON: [(&str, Option<usize>, [f32; 3]); 18] = [
    ("Hips", None, [0.0, 95.0, 0.0]),
    ("LeftUpLeg", Some(0), [9.0, -5.0, 0.0]),
    ("LeftLeg", Some(1), [0.0, -42.0, 0.0]),
    ("LeftFoot", Some(2), [0.0, -40.0, 0.0]),
    ("LeftToeBase", Some(3), [0.0, -5.0, 13.0]),
    ("RightUpLeg", Some(0), [-9.0, -5.0, 0.0]),
    ("RightLeg", Some(5), [0.0, -42.0, 0.0]),
    ("RightFoot", Some(6), [0.0, -40.0, 0.0]),
    ("RightToeBase", Some(7), [0.0, -5.0, 13.0]),
    ("Spine", Some(0), [0.0, 12.0, 0.0]),
    ("Spine1", Some(9), [0.0, 25.0, 0.0]),
    ("Head", Some(10), [0.0, 25.0, 2.0]),
    ("LeftArm", Some(10), [17.0, 12.0, 0.0]),
    ("LeftForeArm", Some(12), [27.0, 0.0, 0.0]),
    ("LeftHand", Some(13), [25.0, 0.0, 0.0]),
    ("RightArm", Some(10), [-17.0, 12.0, 0.0]),
    ("RightForeArm", Some(15), [-27.0, 0.0, 0.0]),
    ("RightHand", Some(16), [-25.0, 0.0, 0.0]),
];
const N_FRAMES: usize = 5;

fn bvh_joint(text: &mut String, i: usize) {
    let (name, parent, [x, y, z]) = PERSON[i];
    let (kind, channels) = match parent {
        None => ("ROOT", "6 Xposition Yposition Zposition"),
        Some(_) => ("JOINT", "3"),
    };
    let _ = writeln!(
        text,
        "{kind} {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS {channels} Zrotation Xrotation Yrotation"
    );
    let children = (0..PERSON.len()).filter(|k| PERSON[*k].1 == Some(i));
    let children: Vec<usize> = children.collect();
    if children.is_empty() {
        text.push_str("End Site\n{\nOFFSET 0 0 1\n}\n");
    }
    children.into_iter().for_each(|k| bvh_joint(text, k));
    text.push_str("}\n");
}

fn bvh() -> String {
    let mut text = String::from("HIERARCHY\n");
    bvh_joint(&mut text, 0);
    let _ = writeln!(text, "MOTION\nFrames: {N_FRAMES}\nFrame Time: 0.05");
    for t in 0..N_FRAMES {
        let _ = write!(text, "{t} 95 7");
        for i in 0..3 * PERSON.len() {
            let _ = write!(text, " {}", (10.0 * wave(t + i)).round());
        }
        text.push('\n');
    }
    text
}

/// A skeleton and a motion, separated by a zero.
fn asf_amc() -> String {
    let mut text = String::from(
        ":version 1.10\n:name test\n:units\n mass 1.0\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n \
         axis XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n",
    );
    let mut hierarchy = String::from(":hierarchy\n begin\n");
    for (i, (name, parent, [x, y, z])) in PERSON.iter().enumerate().skip(1) {
        let length = (x * x + y * y + z * z).sqrt();
        let [x, y, z] = [x / length, y / length, z / length];
        let _ = writeln!(
            text,
            " begin\n id {i}\n name to{i}\n direction {x} {y} {z}\n length {}\n axis 0 0 0 XYZ\n end",
            length / 5.64
        );
        let _ = writeln!(
            text,
            " begin\n id {}\n name {name}\n direction 0 1 0\n length 0\n axis 20 30 40 XYZ\n dof rx ry rz\n \
             limits (0 1)\n end",
            i + 100
        );
        let above = match parent {
            None | Some(0) => "root",
            Some(p) => PERSON[*p].0,
        };
        let _ = writeln!(hierarchy, " {above} to{i}\n to{i} {name}");
    }
    text.push_str(&hierarchy);
    text.push_str(" end\n\0:FULLY-SPECIFIED\n:DEGREES\n");
    for t in 1..=N_FRAMES {
        let _ = writeln!(text, "{t}\nroot 0 17 {t} 0 0 0");
        for (name, ..) in &PERSON[1..] {
            let _ = writeln!(text, "{name} {} 0 5", t * 2);
        }
    }
    text
}

fn npy<T: NpyElement>(shape: &[usize], value: impl Fn(usize) -> T) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = NpyWriter::new(&mut bytes, shape).expect("memory");
    writer
        .extend((0..shape.iter().product()).map(value))
        .expect("memory");
    writer.finish().expect("memory");
    bytes
}

fn text_npy(text: &str) -> Vec<u8> {
    let mut header = format!(
        "{{'descr': '<U{}', 'fortran_order': False, 'shape': (), }}",
        text.len()
    )
    .into_bytes();
    header.resize(117, b' ');
    header.push(b'\n');
    let values = text.chars().flat_map(|c| u32::from(c).to_le_bytes());
    [&b"\x93NUMPY\x01\x00v\x00"[..], &header]
        .concat()
        .into_iter()
        .chain(values)
        .collect()
}

/// The members of an npz file as pieces, and both kinds of archive with them.
fn write_npz(
    write: Write,
    target: &str,
    name: &str,
    members: &[(String, Vec<u8>)],
    kinds: [u8; 3],
) -> io::Result<()> {
    let pieces: Vec<(String, &[u8])> = members.iter().map(|(n, b)| (n.clone(), &b[..])).collect();
    let packed = pack(pieces.iter().map(|(n, b)| (&n[..], *b)));
    let [raw, stored, deflated] = kinds;
    write(
        target,
        &format!("{name}-stored"),
        &[&[stored], &packed[..]].concat(),
    )?;
    write(
        target,
        &format!("{name}-deflated"),
        &[&[deflated], &packed[..]].concat(),
    )?;
    let npz = archive(&pieces, true).expect("an archive");
    write(target, &format!("{name}-raw"), &[&[raw], &npz[..]].concat())
}

fn motions(write: Write) -> io::Result<()> {
    write("motions", "bvh", &[&[0], bvh().as_bytes()].concat())?;
    write("motions", "asf-amc", &[&[1], asf_amc().as_bytes()].concat())?;
    let members = |poses: &str, rate: &str, n_values: usize| {
        vec![
            (
                format!("{poses}.npy"),
                npy(&[N_FRAMES, n_values], |i| 0.2 * wave(i) as f64),
            ),
            (
                "trans.npy".into(),
                npy(&[N_FRAMES, 3], |i| if i % 3 == 2 { 0.9 } else { 0.1_f64 }),
            ),
            (format!("{rate}.npy"), npy(&[], |_| 20.0_f64)),
            ("gender.npy".into(), text_npy("neutral")),
            ("betas.npy".into(), npy(&[16], |i| 0.1 * wave(i) as f64)),
        ]
    };
    write_npz(
        write,
        "motions",
        "amass",
        &members("poses", "mocap_framerate", 66),
        [2, 3, 4],
    )?;
    write_npz(
        write,
        "motions",
        "smplx",
        &members("poses", "mocap_frame_rate", 165),
        [2, 3, 4],
    )?;
    let features = npy(&[N_FRAMES, 263], |i| 0.1 * wave(i));
    write("motions", "features", &[&[5], &features[..]].concat())?;
    let joints = npy(&[N_FRAMES, 22, 3], |i| wave(i));
    write("motions", "joints", &[&[5], &joints[..]].concat())
}

fn smplx(write: Write) -> io::Result<()> {
    const V: usize = 4;
    const J: usize = 22;
    let parent = |j: usize| match Joint::ALL[j].parent() {
        Some(parent) => parent as i64,
        None => 4_294_967_295,
    };
    let members = vec![
        ("v_template.npy".to_string(), npy(&[V, 3], wave)),
        ("f.npy".into(), npy(&[2, 3], |i| [0, 1, 2, 1, 2, 3][i])),
        ("shapedirs.npy".into(), npy(&[V, 3, 2], |i| 0.05 * wave(i))),
        (
            "posedirs.npy".into(),
            npy(&[V, 3, 9 * (J - 1)], |i| f32::from(u8::from(i % 50 == 0))),
        ),
        (
            "J_regressor.npy".into(),
            npy(&[J, V], |i| 0.25 + 0.01 * wave(i / V)),
        ),
        (
            "weights.npy".into(),
            npy(&[V, J], |i| f32::from(u8::from(i % J == i / J))),
        ),
        (
            "kintree_table.npy".into(),
            npy(&[2, J], |i| if i < J { parent(i) } else { (i - J) as i64 }),
        ),
    ];
    write_npz(write, "smplx", "model", &members, [0, 1, 2])
}

/// Weights of every tensor that loading misses.
fn weights(mut load: impl FnMut(NamedTensors) -> Result<(), CheckpointError>) -> NamedTensors {
    let mut tensors = NamedTensors::new();
    loop {
        match load(tensors.clone()) {
            Ok(()) => return tensors,
            Err(CheckpointError::MissingTensor {
                tensor, expected, ..
            }) => {
                let n = expected.iter().product();
                let values = (0..n).map(|i| 0.1 * wave(i)).collect();
                tensors.insert(
                    tensor,
                    HostTensor {
                        shape: expected,
                        values,
                    },
                );
            }
            Err(e) => panic!("{e}"),
        }
    }
}

fn vocab(n_codes: usize) -> Vocab {
    let captions = ["a person walks away", "someone sits down"];
    let always = ["describe what the person does ."];
    Vocab::learn(captions.into_iter(), always.into_iter(), 200, 4, n_codes)
        .expect("a vocabulary")
        .with_context()
}

fn model(write: Write) -> io::Result<()> {
    let mut config = TokenizerConfig {
        width: 4,
        layers: 1,
        heads: 1,
        ffn_ratio: 1,
        pool_queries: 1,
        pool_per_anchor: 1,
        code_dim: 4,
        codebook_size: 8,
        reconstruction_points: 1,
        guidance_dim: 0,
        ..TokenizerConfig::small()
    };
    config.grouping.counts = [1, 1, 2];
    let path = Path::new("model.safetensors");
    let tokenizer = weights(|w| RadarTokenizer::from_weights(config.clone(), w, path).map(drop));
    let vocab = vocab(8);
    let lm = LmConfig {
        network: NetworkConfig::T5(T5Config {
            vocab_size: vocab.layout().size(),
            d_model: 4,
            d_kv: 4,
            n_heads: 1,
            d_ff: 4,
            n_encoder_layers: 1,
            n_decoder_layers: 1,
            feed_forward: FeedForward::GatedGelu,
            tie_embeddings: true,
            scale_outputs: None,
            relative_buckets: 4,
            relative_max_distance: 8,
            dropout: 0.0,
            norm_eps: 1e-6,
        }),
        max_text_vocab: 200,
        n_sentinels: 4,
        n_codes: 8,
        code_dim: 4,
        bypass: true,
        projected: false,
    };
    let lm_weights = weights(|w| {
        match EngineLm::from_weights(lm.clone(), vocab.clone(), w, Precision::F32, path) {
            Ok(_) => Ok(()),
            Err(LmError::Checkpoint(e)) => Err(e),
            Err(e) => panic!("{e}"),
        }
    });
    let card = LmCard {
        lm,
        vocab: vocab.layout().clone(),
        weights: "model.safetensors".into(),
        base_blake3: None,
        learned: None,
    };
    let file = TokenizerFile {
        kind: "radar_tokenizer".into(),
        model: config,
        training: serde_json::Value::Null,
    };
    let folder = tempfile::tempdir()?;
    for is_byte in [false, true] {
        let mut pieces = Vec::new();
        for part in ["tokenizer", "lm"] {
            let mut files = CheckpointFiles::default();
            let tensors = match part {
                "lm" => {
                    files.json("config.json", &card).expect("JSON");
                    files.bytes(
                        "tokenizer.json",
                        vocab.tokenizer_json().expect("JSON").into_bytes(),
                    );
                    &lm_weights
                }
                _ => {
                    files.json("config.json", &file).expect("JSON");
                    &tokenizer
                }
            };
            match is_byte && part == "lm" {
                true => files.tensors_as_bytes("model.safetensors", tensors),
                false => files.tensors("model.safetensors", tensors),
            }
            .expect("tensors");
            let dir = folder.path().join(part);
            files.write(&dir).expect("a checkpoint");
            for name in ["config.json", "tokenizer.json", "model.safetensors"] {
                if let Ok(bytes) = fs::read(dir.join(name)) {
                    pieces.push((format!("{part}/{name}"), bytes));
                }
            }
        }
        let pieces = pieces.iter().map(|(name, bytes)| (&name[..], &bytes[..]));
        let name = if is_byte { "bytes" } else { "floats" };
        write("model", name, &pack(pieces))?;
    }
    Ok(())
}

fn tokenizer(write: Write) -> io::Result<()> {
    let vocab = vocab(8);
    let json = vocab.tokenizer_json().expect("JSON");
    let layout = serde_json::to_vec(vocab.layout())?;
    let text = "A person walks away, 2 metres; someone sits <Motion Tokens> down!";
    write(
        "tokenizer",
        "words",
        &pack([
            ("", json.as_bytes()),
            ("", &layout[..]),
            ("", text.as_bytes()),
        ]),
    )
}

fn configurations(write: Write) -> io::Result<()> {
    let seeds: [(u8, &str, &str); 9] = [
        (
            0,
            "scene",
            "duration_s = 1.0\n\n[[target]]\nkind = \"sphere\"\nposition_m = [0.5, 3.0, 1.0]\nradius_m = 0.2\nmaterial = \"metal\"\n\n[noise]\nsnr_db = 20.0\n",
        ),
        (
            1,
            "data",
            "name = \"walks\"\nseed = 7\nradar = \"awr1843boost\"\ntrain_variants = 1\n\n[[source]]\nkind = \"procedural\"\ntrain = 5\nval = 1\ntest = 2\n",
        ),
        (
            2,
            "processing",
            "[processing]\nmax_points = 64\nmin_range_m = 0.4\ncompensate_tdm = true\n",
        ),
        (
            3,
            "objects",
            "[objects]\nn_clutter = 20\nn_strong = [1, 3]\nstrong_dbsm = [-25.0, 0.0]\n",
        ),
        (
            4,
            "impairments",
            "off = [\"packet-loss\"]\nphase_noise_dbc_per_hz_at_1_mhz = -90.0\nadc_bits = 12\n",
        ),
        (
            5,
            "zones",
            "[[zone]]\nname = 'hall'\nkind = 'door'\npolygon_m = [[1, 4], [2, 4], [2, 5]]\n",
        ),
        (
            5,
            "zone-low",
            "[[zone]]\nname = 'fan'\nkind = 'ignore'\nbelow_m = 0.3\npolygon_m = [[1, 4], [2, 4], [2, 5]]\n",
        ),
        (
            6,
            "site",
            "radar = \"iwr6843isk\"\ntilt_deg = 11.5\nstanding_m = -0.3\nwalking_s = 42.0\nstated_height_m = 1.5\n",
        ),
        (
            6,
            "confidence",
            "unsure_below = 0.5\n[others]\nwindow = { slope = 1.0, offset = 0.1 }\nrecording = { slope = 1.0, offset = 0.1 }\n",
        ),
    ];
    for (kind, name, text) in seeds {
        write("toml", name, &[&[kind], text.as_bytes()].concat())?;
    }
    Ok(())
}

fn server(write: Write) -> io::Result<()> {
    let token = "0123456789abcdef0123456789abcdef";
    let requests = [
        ("page", "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n".to_string()),
        ("live", "GET /api/live HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n".into()),
        ("state", "GET /api/state HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".into()),
        (
            "history",
            format!(
                "GET /api/history?from=0&to={NOW_MS}&person=1&action=walk&q=walks%20away&limit=10&before=1795455492000-1 HTTP/1.1\r\nHost: localhost\r\n\r\n"
            ),
        ),
        ("forget", "DELETE /api/history?from=0&to=5 HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nContent-Length: 2\r\n\r\n{}".into()),
        ("ask", "GET /api/ask?q=how+often+did+she+get+up+today%3F HTTP/1.1\r\nHost: localhost\r\n\r\n".into()),
        ("points", "GET /api/activity/1/points HTTP/1.1\r\nHost: localhost\r\n\r\nGET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n".into()),
        ("lanes", format!("GET /api/lanes?from=0&to={NOW_MS} HTTP/1.1\r\nHost: localhost\r\n\r\n")),
        ("acknowledge", "POST /api/falls/3/acknowledge HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n".into()),
        ("metrics", "GET /metrics HTTP/1.1\r\nHost: [::1]\r\n\r\nGET /api/bug-bundle HTTP/1.0\r\nHost: localhost\r\n\r\n".into()),
    ];
    for (name, request) in requests {
        write("http", name, &[&[0], request.as_bytes()].concat())?;
    }
    let head = format!(
        "GET /api/state HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n"
    );
    write("http", "bearer", &[&[1], head.as_bytes()].concat())?;
    let head = format!(
        "GET /?token={token} HTTP/1.1\r\nHost: localhost\r\nCookie: a=b; radarllm={token}\r\n\r\n"
    );
    write("http", "cookie", &[&[1], head.as_bytes()].concat())
}

/// A packet of a broker: kind and flags, and what follows its length.
fn packet(head: u8, rest: &[u8]) -> Vec<u8> {
    let n = u8::try_from(rest.len()).expect("a short packet");
    assert!(n < 128, "a length of one byte");
    [&[head, n], rest].concat()
}

fn broker(write: Write) -> io::Result<()> {
    let accepted = packet(0x20, &[0, 0]);
    let topic = "homeassistant/status";
    let mut message = vec![0, topic.len() as u8];
    message.extend(topic.as_bytes());
    message.extend(b"online");
    let mut numbered = vec![0, topic.len() as u8];
    numbered.extend(topic.as_bytes());
    numbered.extend([0, 9]);
    numbered.extend(b"offline");
    let acknowledged = |n: u8| packet(0x40, &[0, n]);
    let subscribed = packet(0x90, &[0, 1, 1]);
    let seeds = [
        ("refused", packet(0x20, &[0, 5])),
        ("accepted", accepted.clone()),
        (
            "status",
            [accepted.clone(), subscribed.clone(), packet(0x30, &message)].concat(),
        ),
        (
            "acknowledged",
            [
                accepted.clone(),
                acknowledged(1),
                subscribed,
                acknowledged(2),
                acknowledged(3),
                packet(0xd0, &[]),
            ]
            .concat(),
        ),
        (
            "numbered",
            [accepted, packet(0x32, &numbered), packet(0x62, &[0, 9])].concat(),
        ),
    ];
    seeds
        .iter()
        .try_for_each(|(name, bytes)| write("mqtt", name, bytes))
}

fn taught(write: Write) -> io::Result<()> {
    let mut memory = Memory::default();
    for (name, says, rate_hz) in [
        ("rocking", "a person rocks in the chair", 0.5),
        ("shaking", "a person shakes the head", 2.0),
    ] {
        memory
            .teach(name, says, &moving_up_and_down(6.283 * rate_hz, 0.0))
            .expect("enough points");
    }
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("memory.json");
    memory.save(&path).expect("a memory");
    write("memory", "two", &fs::read(&path)?)?;
    Memory::default().save(&path).expect("a memory");
    write("memory", "empty", &fs::read(&path)?)
}

fn database(write: Write) -> io::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("live.db");
    write_memory(&path);
    // Small pages, so that the seed is small.
    let small = "PRAGMA journal_mode = DELETE; PRAGMA page_size = 512; VACUUM;";
    let connection = rusqlite::Connection::open(&path).expect("a memory");
    connection.execute_batch(small).expect("a memory");
    drop(connection);
    write(
        "live_db",
        "database",
        &[&[0], &fs::read(&path)?[..]].concat(),
    )?;
    let changes = [
        (
            "times",
            pack([
                ("\u{3}\u{1}", &i64::MAX.to_le_bytes()[..]),
                ("\u{4}\u{2}", &[0xff; 8][..]),
            ]),
        ),
        (
            "texts",
            pack([
                ("\u{b}\u{3}", &b"[1e999, 2]"[..]),
                ("\u{10}\u{3}", &b"{\"a\": [1]}"[..]),
            ]),
        ),
        (
            "blob",
            pack([("\u{16}\u{4}", &[1, 2, 3, 4, 5, 6, 7, 8][..])]),
        ),
        (
            "runs",
            pack([
                ("\u{17}\u{1}", &[0xff; 8][..]),
                ("\u{1a}\u{1}", &[1; 8][..]),
            ]),
        ),
    ];
    for (name, change) in changes {
        write("live_db", name, &[&[1], &change[..]].concat())?;
    }
    let point = RadarPoint {
        y_m: 2.0,
        ..RadarPoint::default()
    };
    let frame = radarllm_monitor::points::FramePoints {
        offset_ms: 100,
        points: vec![point; 3],
    };
    let packed = radarllm_monitor::points::encode(&[frame.clone(), frame]).expect("few points");
    write("live_db", "points", &[&[2], &packed.blob[..]].concat())?;
    for (name, question) in [
        ("often", "How often did she get up today?"),
        (
            "when",
            "When did somebody fall between 2026-11-20 08:00 and yesterday evening?",
        ),
        ("long", "How long did he sit on Monday in the last 3 weeks?"),
    ] {
        write("live_db", name, &[&[3], question.as_bytes()].concat())?;
    }
    Ok(())
}
