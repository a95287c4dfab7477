//! Detects the format of a capture from its first bytes and its name, and gives the reason.

use radarllm_files::npy::{NPY_MAGIC, NpyHeader, read_npy_header};

use crate::{
    dca1000::starts_with_record,
    folder::{ros2_bag_folder, visualizer_folder},
    pcap,
    recordings::{bag::BAG_MAGIC, listed, matlab, mmfi, printable, track_table::is_track_table},
    tables::{self, is_point_column},
    uart,
};

/// Magic bytes at the start of an SQLite database.
const SQLITE_MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Magic bytes at the start of an MCAP file.
const MCAP_MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Number of bytes at the start of a file that detection uses.
pub const HEAD_BYTES: usize = 64 << 10;

/// Format of a recording or capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RecordingFormat {
    /// Raw samples: `adc_data.bin` of a capture card, or npy cubes of complex numbers.
    Adc,
    /// UDP packets of a DCA1000.
    Dca1000,
    /// UART output of a TI demo.
    Uart,
    /// RadHAR text.
    RadHar,
    /// MARS tables and feature maps.
    Mars,
    /// mmBody frames.
    MmBody,
    /// MM-Fi frames.
    MmFi,
    /// Points table, CSV.
    Csv,
    /// Points table, npy.
    NpyPoints,
    /// Table of a board's tracks with the points of each frame, CSV.
    TrackCsv,
    /// Windows of points, JSON.
    WindowsJson,
    /// ROS 1 bag.
    Bag,
    /// ROS 2 bag: SQLite or MCAP, a file or a folder of them.
    Ros2Bag,
    /// Files `replay_N.json` of a TI visualizer, one or a folder of them.
    VisualizerJson,
    /// A folder of `pHistBytes_N.bin` of a TI visualizer; one such file is [`Self::Uart`].
    VisualizerBinary,
    /// MATLAB v5 or v7.3 file with points of MARS or of MARS-like recorders.
    Mat,
    /// This project's points file.
    Points,
}

impl RecordingFormat {
    /// All formats.
    pub const ALL: [Self; 17] = [
        Self::Adc,
        Self::Dca1000,
        Self::Uart,
        Self::RadHar,
        Self::Mars,
        Self::MmBody,
        Self::MmFi,
        Self::Csv,
        Self::NpyPoints,
        Self::TrackCsv,
        Self::WindowsJson,
        Self::Bag,
        Self::Ros2Bag,
        Self::VisualizerJson,
        Self::VisualizerBinary,
        Self::Mat,
        Self::Points,
    ];

    /// Name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Adc => "adc",
            Self::Dca1000 => "dca1000",
            Self::Uart => "uart",
            Self::RadHar => "radhar",
            Self::Mars => "mars",
            Self::MmBody => "mmbody",
            Self::MmFi => "mmfi",
            Self::Csv => "csv",
            Self::NpyPoints => "npy-points",
            Self::TrackCsv => "track-csv",
            Self::WindowsJson => "windows-json",
            Self::Bag => "bag",
            Self::Ros2Bag => "ros2-bag",
            Self::VisualizerJson => "visualizer-json",
            Self::VisualizerBinary => "visualizer-binary",
            Self::Mat => "mat",
            Self::Points => "points",
        }
    }

    /// The format with the given [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// Storage format of raw samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFormat {
    /// A NumPy array.
    Npy,
    /// Sample words without packets: `adc_data.bin`.
    Adc,
    /// DCA1000 packets in a file, each preceded by a header of 14 bytes.
    Records,
    /// DCA1000 packets in a pcap or pcapng file.
    Pcap,
    /// DCA1000 packets from the network.
    Udp,
}

impl SampleFormat {
    /// Number of bytes at the start of a file that [`Self::of_start`] uses.
    pub const HEAD_BYTES: usize = 16;

    /// Name of the format for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Adc => "adc",
            Self::Records => "dca1000 records",
            Self::Pcap => "dca1000 pcap",
            Self::Udp => "dca1000 live",
        }
    }

    /// The format of a file that begins so. Raw words have no beginning of their own.
    pub fn of_start(start: &[u8]) -> Option<Self> {
        if start.starts_with(NPY_MAGIC) {
            Some(Self::Npy)
        } else if starts_with_record(start) {
            Some(Self::Records)
        } else if pcap::is_magic(start) {
            Some(Self::Pcap)
        } else {
            None
        }
    }
}

/// A format with the reason for its detection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Detected {
    /// The format.
    pub format: RecordingFormat,
    /// Evidence from which it was recognised.
    pub reason: String,
}

/// Reasons why a format cannot be detected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DetectError {
    /// Several formats are possible.
    #[error("the format is not clear ({reason}); it can be {}", list(.choices))]
    Ambiguous {
        /// Evidence found.
        reason: String,
        /// Possible formats.
        choices: Vec<RecordingFormat>,
    },
    /// A Python pickle, which can execute arbitrary code when it is opened.
    #[error(
        "a Python pickle ({reason}), which is never read, because opening one can run any code. Open it in a sandbox \
         that you trust with it, and save the numbers alone: numpy.save(\"frame_0001.npy\", numpy.asarray(points, \
         dtype=\"f4\")) for each frame, or one CSV with frame,t_s,x,y,z,velocity,intensity"
    )]
    Pickle {
        /// Evidence found.
        reason: String,
    },
    /// A folder with several recordings.
    #[error("several recordings: {}; name one of them", .0.join(", "))]
    SeveralRecordings(Vec<String>),
    /// A known format that is not supported.
    #[error("{0}")]
    Refused(String),
    /// A table of which too few columns are known, or one without a header.
    #[error("{}", unknown_table(.first_row, .missing, *.has_header))]
    UnknownTable {
        /// The cells of the first row.
        first_row: Vec<String>,
        /// Columns that a table of points needs and this one lacks.
        missing: Vec<&'static str>,
        /// Whether the first row names the columns.
        has_header: bool,
    },
    /// The format is unknown.
    #[error("no known capture format ({0})")]
    Unknown(String),
}

fn list(formats: &[RecordingFormat]) -> String {
    let names: Vec<&str> = formats.iter().map(|f| f.name()).collect();
    names.join(", ")
}

fn unknown_table(first_row: &[String], missing: &[&str], has_header: bool) -> String {
    let cells: Vec<&str> = first_row.iter().map(String::as_str).collect();
    let (n, listed, missing) = (cells.len(), listed(&cells), missing.join(", "));
    match has_header {
        true => format!("a table without the columns {missing}; it has {n}: {listed}"),
        false => format!("a table without a header: its first row has {n} cells, {listed}"),
    }
}

fn sure(format: RecordingFormat, reason: impl Into<String>) -> Result<Detected, DetectError> {
    Ok(Detected {
        format,
        reason: reason.into(),
    })
}

/// Detects the format of a file from its name (the last part of its path) and its first [`HEAD_BYTES`] bytes.
///
/// # Errors
/// [`DetectError`]: several formats fit, the file is a pickle, or the format is unknown.
pub fn detect(name: &str, head: &[u8]) -> Result<Detected, DetectError> {
    let head = &head[..head.len().min(HEAD_BYTES)];
    let lower = name.to_lowercase();
    let extension = lower.rsplit_once('.').map_or("", |(_, e)| e);
    if head.starts_with(b"#ROSBAG") {
        return if head.starts_with(BAG_MAGIC) {
            sure(RecordingFormat::Bag, "#ROSBAG V2.0")
        } else {
            Err(DetectError::Refused(
                "a ROS bag of another version than 2.0: `rosbag fix` converts it".into(),
            ))
        };
    }
    if head.starts_with(SQLITE_MAGIC) {
        return sure(RecordingFormat::Ros2Bag, "an SQLite database");
    }
    if head.starts_with(MCAP_MAGIC) {
        return sure(RecordingFormat::Ros2Bag, "an MCAP file");
    }
    if head.starts_with(b"PAR1") {
        return sure(RecordingFormat::Points, "PAR1, a Parquet file");
    }
    if head.starts_with(NPY_MAGIC) {
        return npy(&lower, head);
    }
    if head.starts_with(matlab::MAT_MAGIC) {
        return sure(RecordingFormat::Mat, "a MATLAB v5 file");
    }
    if head.starts_with(matlab::MAT_73_MAGIC)
        || extension == "mat" && head.starts_with(matlab::HDF5_MAGIC)
    {
        return match cfg!(feature = "hdf5") {
            true => sure(RecordingFormat::Mat, "a MATLAB v7.3 file"),
            false => Err(DetectError::Refused(matlab::MAT_73_ADVICE.into())),
        };
    }
    let packets = match SampleFormat::of_start(head) {
        Some(SampleFormat::Records) => Some("the numbers before a capture card's first packet"),
        Some(SampleFormat::Pcap) => Some("a pcap file"),
        _ => None,
    };
    if let Some(reason) = packets {
        return sure(RecordingFormat::Dca1000, reason);
    }
    if head.starts_with(b"PK\x03\x04") {
        return Err(DetectError::Unknown("a zip archive".into()));
    }
    let packets = head
        .windows(uart::MAGIC.len())
        .filter(|w| *w == uart::MAGIC);
    let n_packets = packets.count();
    if n_packets > 0 {
        return sure(
            RecordingFormat::Uart,
            format!("{n_packets} UART magics in its head"),
        );
    }
    if ["cpl", "pkl", "pickle"].contains(&extension) {
        return Err(DetectError::Pickle {
            reason: format!("the name ends in .{extension}"),
        });
    }
    if let [0x80, protocol @ 2..=5, ..] = head {
        return Err(DetectError::Pickle {
            reason: format!("it starts with 80 {protocol:02x}, pickle protocol {protocol}"),
        });
    }
    if let Ok(text) = std::str::from_utf8(trim_cut_character(head)) {
        if let Some(detected) = text_format(text) {
            return Ok(detected);
        }
        let first = tables::first_row(text);
        if ["csv", "tsv"].contains(&extension) && !first.cells.is_empty() {
            let has_header = !first.is_of_numbers();
            return Err(DetectError::UnknownTable {
                missing: tables::missing(first.cells.iter().map(String::as_str)),
                first_row: first.cells.iter().map(|c| printable(c)).collect(),
                has_header,
            });
        }
    }
    if numbered(&lower, "frame").is_some() && extension == "bin" && head.len().is_multiple_of(40) {
        return sure(RecordingFormat::MmFi, "named frame*.bin, rows of 40 bytes");
    }
    if extension == "bin" && (lower.starts_with("adc_data") || lower.contains("_raw_")) {
        return sure(
            RecordingFormat::Adc,
            "named as mmWave Studio names raw words",
        );
    }
    if ["bin", "raw", "dat"].contains(&extension) {
        return Err(DetectError::Ambiguous {
            reason: format!("a .{extension} without UART magics"),
            choices: vec![
                RecordingFormat::Adc,
                RecordingFormat::Dca1000,
                RecordingFormat::MmFi,
            ],
        });
    }
    Err(DetectError::Unknown(if head.is_empty() {
        "an empty file".into()
    } else if extension == "json" {
        "JSON without `frameData` or `sequences` at its beginning: neither a recording of a TI visualizer nor windows of points".into()
    } else if extension == "mat" {
        "a .mat file of another version than 5 and 7.3: save(file, 'marsData', '-v7') writes the first"
            .into()
    } else {
        "neither its first bytes nor its name identify a format".into()
    }))
}

/// Detects the format of a folder from the names of its files and of those in its subfolders, with `/` between folder
/// and file: see [`visualizer_folder`].
///
/// # Errors
/// [`DetectError`] if no format or several formats use these names, or if the folder contains several recordings.
pub fn detect_folder<'a>(
    names: impl IntoIterator<Item = &'a str>,
) -> Result<Detected, DetectError> {
    let names: Vec<&str> = names.into_iter().collect();
    let visualizer = visualizer_folder(&names, None)?;
    let ros2 = ros2_bag_folder(&names)?;
    let (mut mmfi, mut npy) = (0, 0);
    for name in names {
        let name = name.to_lowercase();
        let is_npy = name.ends_with(".npy");
        if is_npy && numbered(&name, "frame_").is_some() {
            npy += 1;
        } else if (is_npy || name.ends_with(".bin")) && numbered(&name, "frame").is_some() {
            mmfi += 1;
        }
    }
    if let Some(files) = ros2 {
        if visualizer.is_none() && mmfi + npy == 0 {
            let reason = format!("{} files of a ROS 2 bag", files.len());
            return sure(RecordingFormat::Ros2Bag, reason);
        }
        return Err(DetectError::Ambiguous {
            reason: "files of a ROS 2 bag beside others".into(),
            choices: vec![
                RecordingFormat::Ros2Bag,
                visualizer.map_or(RecordingFormat::MmFi, |v| v.format),
            ],
        });
    }
    if let Some(folder) = visualizer {
        if mmfi + npy == 0 {
            return sure(folder.format, folder.reason());
        }
        let mut choices = vec![folder.format];
        choices.extend((mmfi > 0).then_some(RecordingFormat::MmFi));
        choices.extend((npy > 0).then_some(RecordingFormat::MmBody));
        return Err(DetectError::Ambiguous {
            reason: format!("{}, and frames of a data set", folder.reason()),
            choices,
        });
    }
    match (mmfi, npy) {
        (0, 0) => Err(DetectError::Unknown(
            "a folder without replay_N.json, pHistBytes_N.bin, *.db3, *.mcap, frame*.bin or frame_N.npy"
                .into(),
        )),
        (n, 0) => sure(
            RecordingFormat::MmFi,
            format!("{n} files frame*.bin or frame*.npy"),
        ),
        (0, n) => sure(RecordingFormat::MmBody, format!("{n} files frame_N.npy")),
        _ => Err(DetectError::Ambiguous {
            reason: "files of two data sets".into(),
            choices: vec![RecordingFormat::MmFi, RecordingFormat::MmBody],
        }),
    }
}

/// The number in a name of the form `prefixNUMBER.extension`.
pub fn numbered(name: &str, prefix: &str) -> Option<u64> {
    let stem = name.rsplit_once('.')?.0;
    let digits = stem.strip_prefix(prefix)?;
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    digits.parse().ok()
}

/// A head that ends within a character still counts as text.
fn trim_cut_character(head: &[u8]) -> &[u8] {
    match std::str::from_utf8(head) {
        Err(e) if e.error_len().is_none() => &head[..e.valid_up_to()],
        _ => head,
    }
}

fn text_format(text: &str) -> Option<Detected> {
    let first = text.lines().find(|l| !l.trim().is_empty())?;
    let found = |format, reason: &str| {
        Some(Detected {
            format,
            reason: reason.into(),
        })
    };
    if first.trim_end() == "header:" && text.contains("point_id:") {
        return found(
            RecordingFormat::RadHar,
            "records of `header:` and `point_id:`",
        );
    }
    let row = tables::first_row(text);
    let cells: Vec<&str> = row.cells.iter().map(|c| c.trim()).collect();
    if cells.contains(&"Frame #") && cells.contains(&"Doppler") {
        return found(
            RecordingFormat::Mars,
            "a header with `Frame #` and `Doppler`",
        );
    }
    if first
        .trim_start_matches(['\u{feff}', ' ', '\t'])
        .starts_with('{')
        && text.contains("\"frameData\"")
    {
        return found(RecordingFormat::VisualizerJson, "JSON with `frameData`");
    }
    if first.trim_start().starts_with('{') && text.contains("\"sequences\"") {
        return found(RecordingFormat::WindowsJson, "JSON with `sequences`");
    }
    if is_track_table(cells.iter().copied()) {
        return found(
            RecordingFormat::TrackCsv,
            "a header with `tid`, `posy` and `posz`",
        );
    }
    if cells.iter().filter(|c| is_point_column(c)).count() >= 3 {
        return found(RecordingFormat::Csv, "a header with columns of points");
    }
    None
}

fn npy(name: &str, head: &[u8]) -> Result<Detected, DetectError> {
    let NpyHeader { shape, fields, .. } = read_npy_header(head).map_err(|e| {
        if e.is_pickled {
            DetectError::Pickle {
                reason: "an npy array of Python objects".into(),
            }
        } else {
            DetectError::Refused(e.to_string())
        }
    })?;
    if fields.first().is_some_and(|f| !f.name.is_empty()) {
        return sure(
            RecordingFormat::NpyPoints,
            "an npy array with named columns",
        );
    }
    if fields.first().is_some_and(|f| f.code.starts_with('c')) {
        return sure(
            RecordingFormat::Adc,
            format!("complex npy of shape {shape:?}"),
        );
    }
    match shape.as_slice() {
        [_, 8, 8, 5] => sure(RecordingFormat::Mars, format!("npy feature maps {shape:?}")),
        // Feature maps of MARS that were flattened, or frames of any board that were filled up.
        [_, 64, 5] => Err(DetectError::Ambiguous {
            reason: format!("npy of shape {shape:?}"),
            choices: vec![RecordingFormat::Mars, RecordingFormat::NpyPoints],
        }),
        [_, _, 5] => sure(
            RecordingFormat::NpyPoints,
            "npy of frames with five columns",
        ),
        [_, 7] => sure(RecordingFormat::NpyPoints, "npy of seven columns"),
        [_, 6] if numbered(name, "frame_").is_some() => {
            sure(RecordingFormat::MmBody, "frame_N.npy of six columns")
        }
        [_, 5] if numbered(name, "frame").is_some() => {
            sure(RecordingFormat::MmFi, "frame*.npy of five columns")
        }
        [_, 5 | 6] => Err(DetectError::Ambiguous {
            reason: format!("npy of shape {shape:?}, named {}", short(name)),
            choices: vec![
                RecordingFormat::MmBody,
                RecordingFormat::MmFi,
                RecordingFormat::NpyPoints,
            ],
        }),
        _ => Err(DetectError::Unknown(format!("npy of shape {shape:?}"))),
    }
}

fn short(name: &str) -> String {
    name.chars().filter(|c| !c.is_control()).take(40).collect()
}

/// Frame rate stated by a data set whose files have no time stamps.
pub fn stated_rate_hz(format: RecordingFormat) -> Option<f64> {
    match format {
        // An and Ogras, ACM TECS 2021.
        RecordingFormat::Mars => Some(10.0),
        RecordingFormat::MmFi => Some(mmfi::FRAME_RATE_HZ),
        RecordingFormat::Mat => Some(matlab::FRAME_RATE_HZ),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(name: &str, head: &[u8]) -> RecordingFormat {
        detect(name, head).unwrap().format
    }

    fn npy_head(descr: &str, shape: &str) -> Vec<u8> {
        let text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes
    }

    #[test]
    fn first_bytes_and_names_tell_the_format() {
        let uart = [b"junk".to_vec(), uart::MAGIC.to_vec(), vec![0; 40]].concat();
        assert_eq!(format("x.dat", &uart), RecordingFormat::Uart);
        assert_eq!(format("x.bag", b"#ROSBAG V2.0\nmore"), RecordingFormat::Bag);
        assert_eq!(format("x", b"PAR1"), RecordingFormat::Points);
        assert_eq!(
            format("a.txt", b"header: \n  seq: 1\npoint_id: 0\n"),
            RecordingFormat::RadHar
        );
        assert_eq!(
            format("a.csv", b"Frame #,# Obj,X,Y,Z,Doppler,Intensity\n"),
            RecordingFormat::Mars
        );
        assert_eq!(
            format("a.csv", b"frame;x_m;y_m;z_m;v;snr\n"),
            RecordingFormat::Csv
        );
        assert_eq!(format("frame001.bin", &[0; 80]), RecordingFormat::MmFi);
        assert_eq!(
            format("a.npy", &npy_head("'<f8'", "(3, 8, 8, 5)")),
            RecordingFormat::Mars
        );
        assert_eq!(
            format("a.npy", &npy_head("[('x', '<f4')]", "(3,)")),
            RecordingFormat::NpyPoints
        );
        assert_eq!(
            format("a.npy", &npy_head("'<c8'", "(1, 2, 3, 4, 5)")),
            RecordingFormat::Adc
        );
        assert_eq!(
            format("frame_7.npy", &npy_head("'<f8'", "(900, 6)")),
            RecordingFormat::MmBody
        );
        assert_eq!(
            format("frame007.npy", &npy_head("'<f8'", "(9, 5)")),
            RecordingFormat::MmFi
        );
        let folder = detect_folder(["pHistBytes_1.bin", "profile.cfg"]).unwrap();
        assert_eq!(folder.format, RecordingFormat::VisualizerBinary);
        let folder = detect_folder(["frame_1.npy", "frame_2.npy"]).unwrap();
        assert_eq!(folder.format, RecordingFormat::MmBody);
        assert_eq!(
            detect_folder(["frame001.bin"]).unwrap().format,
            RecordingFormat::MmFi
        );
        assert_eq!(format("adc_data_Raw_0.bin", &[7; 64]), RecordingFormat::Adc);
        assert_eq!(
            format("x.pcap", &[0xd4, 0xc3, 0xb2, 0xa1]),
            RecordingFormat::Dca1000
        );
        assert_eq!(
            format(
                "replay_3.json",
                b"{\n \"cfg\": [], \"data\": [{\"frameData\": {}}]}"
            ),
            RecordingFormat::VisualizerJson
        );
        assert_eq!(
            format("x.mat", b"MATLAB 5.0 MAT-file, Platform: PCWIN64"),
            RecordingFormat::Mat
        );
        for format in RecordingFormat::ALL {
            assert_eq!(RecordingFormat::from_name(format.name()), Some(format));
        }
    }

    #[test]
    fn bags_of_ros_2_are_known_by_their_files() {
        let of = |name: &str, head: &[u8]| detect(name, head).map(|d| d.format);
        for (name, head) in [
            ("walk_0.db3", &b"SQLite format 3\0\x10"[..]),
            ("any", b"\x89MCAP0\r\n\x01"),
        ] {
            assert_eq!(of(name, head), Ok(RecordingFormat::Ros2Bag), "{name}");
        }
        let folder = detect_folder(["walk/metadata.yaml", "walk/walk_0.db3"]).unwrap();
        assert_eq!(folder.format, RecordingFormat::Ros2Bag);
        let packed = detect_folder(["walk_0.db3.zstd", "metadata.yaml"]).unwrap();
        assert_eq!(packed.format, RecordingFormat::Ros2Bag);
        let error = detect_folder(["walk_0.mcap", "replay_1.json"]).unwrap_err();
        assert!(
            error.to_string().contains("ros2-bag, visualizer-json"),
            "{error}"
        );
    }

    #[test]
    fn doubt_is_an_error_with_the_choices() {
        let error = detect("capture.bin", &[7; 64]).unwrap_err();
        assert!(error.to_string().contains("adc, dca1000, mmfi"), "{error}");
        let error = detect("points.npy", &npy_head("'<f8'", "(9, 6)")).unwrap_err();
        assert!(
            error.to_string().contains("mmbody, mmfi, npy-points"),
            "{error}"
        );
        assert!(detect_folder(["frame_1.npy", "frame001.bin"]).is_err());
        assert!(matches!(
            detect("a.txt", b"hello"),
            Err(DetectError::Unknown(_))
        ));
        assert!(matches!(detect("x", b""), Err(DetectError::Unknown(_))));
        let old_bag = detect("x.bag", b"#ROSBAG V1.2\n");
        assert!(matches!(old_bag, Err(DetectError::Refused(_))));
        for (name, head) in [
            ("x", &b"MATLAB 7.3 MAT-file, Platform"[..]),
            ("x.mat", b"\x89HDF\r\n\x1a\n"),
        ] {
            match detect(name, head) {
                Ok(found) if cfg!(feature = "hdf5") => {
                    assert_eq!(found.format, RecordingFormat::Mat)
                }
                Err(DetectError::Refused(text)) if !cfg!(feature = "hdf5") => {
                    assert!(text.contains("'-v7'") && text.contains("savemat"), "{text}");
                }
                other => panic!("{name}: {other:?}"),
            }
        }
        let other = detect("replay_1.json", b"{\"score\": 7}").unwrap_err();
        assert!(other.to_string().contains("without `frameData`"), "{other}");
        let error = detect_folder(["replay_1.json", "frame001.bin"]).unwrap_err();
        assert!(
            error.to_string().contains("visualizer-json, mmfi"),
            "{error}"
        );
    }

    #[test]
    fn pickles_are_refused_with_the_way_out() {
        for (name, head) in [
            ("mri.cpl", b"anything".to_vec()),
            ("x.bin", vec![0x80, 3, b'}']),
            ("a.npy", npy_head("'|O'", "(3,)")),
        ] {
            let error = detect(name, &head).unwrap_err();
            assert!(
                matches!(error, DetectError::Pickle { .. }),
                "{name}: {error}"
            );
            assert!(error.to_string().contains("numpy.save"), "{error}");
        }
    }
}
