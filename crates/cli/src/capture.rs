//! Raw captures that a user names: which format they have, how their words lie, and frames of them.

use std::{
    fs::File,
    io::{self, BufReader, Read},
    path::{Path, PathBuf},
};

use clap::{Args, ValueEnum};
use num_complex::{Complex32, Complex64};
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_formats::{
    Board, Severity, TiCfg,
    adc::{
        AdcError, AdcReader, AxisOrder, Chained, CubeShape, FrameDecoder, FrameIntegrity,
        FrameLayout, FrameSource, IqAnswer, IqCheck, IqOrder, IqVerdict, Lanes, RecordLog,
        SampleKind, SampleLayout, StudioCapture, axes, check_capture,
    },
    dca1000::{
        PacketFrames, PacketSource, PcapPackets, RecordReader, TransferSummary, starts_with_record,
    },
    pcap,
};
use radarllm_synth::synthesizer::{RadarSource, read_radar};

use crate::{
    error::{CliError, CliResult},
    udp::{self, UdpPackets},
};

/// Frames from which the order of I and Q is judged.
const JUDGED_FRAMES: usize = 4;
/// Longest recorder's log read, bytes.
const MAX_LOG_BYTES: u64 = 1 << 20;

/// How the samples of a capture lie; for raw words and packets.
#[derive(Args, Clone, Debug, Default)]
pub struct LayoutArgs {
    /// Which of I and Q comes first: mmWave Studio writes I, SDK firmware with SampleSwap 1 writes Q.
    /// `auto` takes what the samples say, if they say it clearly.
    #[arg(long, value_enum, value_name = "ORDER")]
    pub iq: Option<IqChoice>,
    /// LVDS lanes: 4 for xWR12xx and 14xx, 2 for the others; known for boards that have a name.
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=4))]
    pub lanes: Option<u8>,
    /// Samples are real numbers, not I and Q.
    #[arg(long, conflicts_with = "iq")]
    pub real: bool,
    /// Axes of an npy array, slowest first: frame, loop, tx, chirp, rx, virtual, sample, iq.
    #[arg(long, value_name = "A,B,...")]
    pub axes: Option<String>,
}

impl LayoutArgs {
    /// Whether anything is said about how samples lie: then the capture holds samples.
    pub fn is_given(&self) -> bool {
        self.iq.is_some() || self.lanes.is_some() || self.real || self.axes.is_some()
    }
}

/// `--iq`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum IqChoice {
    /// I, then Q.
    IFirst,
    /// Q, then I.
    QFirst,
    /// As the samples say.
    Auto,
}

/// What a capture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A NumPy array.
    Npy,
    /// Words alone: adc_data.bin.
    Adc,
    /// Packets in a file, each with 14 bytes before it.
    Records,
    /// Packets in a pcap or pcapng file.
    Pcap,
    /// Packets from the network.
    Udp,
}

impl Format {
    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self {
            Format::Npy => "npy",
            Format::Adc => "adc",
            Format::Records => "dca1000 records",
            Format::Pcap => "dca1000 pcap",
            Format::Udp => "dca1000 live",
        }
    }
}

/// The format that a user named, or that the capture's beginning shows.
pub fn format_of(captures: &[PathBuf], named: Option<&str>) -> CliResult<Format> {
    let first = captures
        .first()
        .ok_or_else(|| CliError::new("no capture is named"))?;
    let mut start = Vec::new();
    if udp::address(&first.to_string_lossy()).is_none() {
        let file = File::open(first).map_err(|e| CliError::io(first, e))?;
        file.take(16)
            .read_to_end(&mut start)
            .map_err(|e| CliError::io(first, e))?;
    } else {
        return Ok(Format::Udp);
    }
    let found = if start.starts_with(b"\x93NUMPY") {
        Some(Format::Npy)
    } else if starts_with_record(&start) {
        Some(Format::Records)
    } else if pcap::is_magic(&start) {
        Some(Format::Pcap)
    } else {
        None
    };
    let unlike = |format: &str| {
        Err(CliError::new(format!(
            "{}: does not begin like {format}",
            first.display()
        )))
    };
    match (named, found) {
        (Some("npy"), Some(Format::Npy)) => Ok(Format::Npy),
        (Some("npy"), _) => unlike("an npy file"),
        (Some("adc"), Some(Format::Npy)) => unlike("raw words, but an npy file (--format npy)"),
        (Some("adc"), Some(Format::Records)) => Ok(Format::Records),
        (Some("adc"), _) => Ok(Format::Adc),
        (Some("dca1000"), Some(format @ (Format::Records | Format::Pcap))) => Ok(format),
        (Some("dca1000"), _) => {
            unlike("packets: neither pcap nor records").map_err(|e: CliError| {
                e.hint("--format adc reads adc_data.bin; udp:PORT listens to the card")
            })
        }
        (Some(other), _) => Err(
            CliError::new(format!("--format {other}: not supported yet"))
                .hint("adc, dca1000 and npy are"),
        ),
        (None, Some(format)) => Ok(format),
        (None, None) => match first.extension().and_then(|e| e.to_str()) {
            Some("bin") => Ok(Format::Adc),
            _ => Err(CliError::new(format!(
                "{}: neither npy nor pcap nor records of packets, and not named .bin",
                first.display()
            ))
            .hint("--format adc reads any file as raw words")),
        },
    }
}

/// Where frames come from.
pub enum Frames {
    /// Of a NumPy array.
    Npy(Box<NpyFrames>),
    /// Of raw words.
    Adc(AdcReader<Input>),
    /// Of packets in a file.
    Records(PacketFrames<RecordReader<Input>>),
    /// Of packets in a pcap file.
    Pcap(PacketFrames<PcapPackets<Input>>),
    /// Of packets from the network.
    Udp(PacketFrames<UdpPackets>),
}

/// Files as one stream.
pub type Input = BufReader<Chained<File>>;

fn open_files(captures: &[PathBuf]) -> CliResult<Input> {
    let mut files = Vec::new();
    for path in captures {
        files.push(File::open(path).map_err(|e| CliError::io(path, e))?);
    }
    Ok(BufReader::with_capacity(1 << 18, Chained::new(files)))
}

impl Frames {
    /// Opens a capture of raw samples whose layout is settled on the way; remarks go to `notes`.
    pub fn open(
        format: Format,
        captures: &[PathBuf],
        radar: &RadarConfig,
        radar_name: &str,
        layout: &LayoutArgs,
        notes: &mut Vec<String>,
    ) -> CliResult<Self> {
        if format == Format::Npy {
            let [path] = captures else {
                return Err(CliError::new("npy arrays are read one at a time"));
            };
            let frames = NpyFrames::open(path, radar, layout.axes.as_deref())?;
            return Ok(Self::Npy(Box::new(frames)));
        }
        let chosen = choose_layout(format, captures, radar, radar_name, layout)?;
        notes.extend(chosen.notes);
        if let (SampleKind::Complex { order }, Some(verdict)) = (chosen.layout.data, chosen.verdict)
        {
            notes.push(format!(
                "read with {}; {}",
                order.name(),
                explain(chosen.tried, &verdict)
            ));
        }
        if format != Format::Udp {
            notes.extend(log_notes(&captures[0])?);
        }
        Self::open_raw(format, captures, CubeShape::of(radar), chosen.layout)
    }

    /// Opens a capture of raw words or packets.
    pub fn open_raw(
        format: Format,
        captures: &[PathBuf],
        shape: CubeShape,
        layout: SampleLayout,
    ) -> CliResult<Self> {
        let decoder = FrameDecoder::new(shape, layout)?;
        Ok(match format {
            Format::Adc => Self::Adc(AdcReader::new(open_files(captures)?, decoder)),
            Format::Records => {
                let records = RecordReader::new(open_files(captures)?);
                Self::Records(PacketFrames::new(records, decoder)?)
            }
            Format::Pcap => {
                only_one(captures)?;
                let packets = PcapPackets::new(open_files(captures)?)?;
                Self::Pcap(PacketFrames::new(packets, decoder)?)
            }
            Format::Udp => {
                only_one(captures)?;
                let input = captures[0].to_string_lossy();
                let address = udp::address(&input)
                    .ok_or_else(|| CliError::new(format!("{input}: no address")))?
                    .map_err(CliError::new)?;
                let packets = UdpPackets::bind(address)
                    .map_err(|e| CliError::new(format!("{input}: {e}")))?;
                eprintln!("listening at {}", packets.local_address());
                Self::Udp(PacketFrames::new(packets, decoder)?)
            }
            Format::Npy => return Err(CliError::new("an npy array has no raw words")),
        })
    }

    /// Live packets that came faster than they were processed.
    pub fn overruns(&self) -> u64 {
        match self {
            Frames::Udp(f) => f.source().overruns(),
            _ => 0,
        }
    }

    /// What happened to the packets, if there were any, and how many datagrams or records were none.
    pub fn transfer(&self) -> Option<(&TransferSummary, u64)> {
        match self {
            Frames::Npy(_) | Frames::Adc(_) => None,
            Frames::Records(f) => Some((f.summary(), f.source().skipped())),
            Frames::Pcap(f) => {
                let cut = u64::from(f.source().pcap().cut_bytes() > 0);
                Some((f.summary(), f.source().skipped() + cut))
            }
            Frames::Udp(f) => Some((f.summary(), f.source().skipped())),
        }
    }
}

impl FrameSource for Frames {
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError> {
        match self {
            Frames::Npy(f) => f.next_frame(cube),
            Frames::Adc(f) => f.next_frame(cube),
            Frames::Records(f) => f.next_frame(cube),
            Frames::Pcap(f) => f.next_frame(cube),
            Frames::Udp(f) => f.next_frame(cube),
        }
    }

    fn trailing_bytes(&self) -> usize {
        match self {
            Frames::Npy(f) => f.trailing_bytes(),
            Frames::Adc(f) => f.trailing_bytes(),
            Frames::Records(f) => f.trailing_bytes(),
            Frames::Pcap(f) => f.trailing_bytes(),
            Frames::Udp(f) => f.trailing_bytes(),
        }
    }
}

fn only_one(captures: &[PathBuf]) -> CliResult {
    match captures {
        [_] => Ok(()),
        _ => Err(CliError::new(format!(
            "{} captures: only raw words and records can be split over files",
            captures.len()
        ))),
    }
}

/// How the words of a raw capture lie, what the samples say about it, and what was noticed.
pub struct ChosenLayout {
    /// The layout.
    pub layout: SampleLayout,
    /// What the first frames say when read with [`Self::tried`]; `None` for real samples and live captures.
    pub verdict: Option<IqVerdict>,
    /// The order that the verdict is about.
    pub tried: IqOrder,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

/// Settles the layout of a raw capture before anything runs.
pub fn choose_layout(
    format: Format,
    captures: &[PathBuf],
    radar: &RadarConfig,
    radar_name: &str,
    args: &LayoutArgs,
) -> CliResult<ChosenLayout> {
    let said = said_by_radar(radar_name)?;
    let studio = said.layout;
    let lanes = lanes(radar, args.lanes, studio, said.receivers)?;
    let named = match (args.real, args.iq, studio.map(|l| l.data)) {
        (true, _, _) | (_, None, Some(SampleKind::Real)) => Some(SampleKind::Real),
        (_, Some(IqChoice::IFirst), _) => Some(complex(IqOrder::IFirst)),
        (_, Some(IqChoice::QFirst), _) => Some(complex(IqOrder::QFirst)),
        (_, Some(IqChoice::Auto), _) => None,
        (_, None, data) => data,
    };
    let tried = SampleLayout {
        lanes,
        data: named.unwrap_or(complex(IqOrder::IFirst)),
    };
    let mut notes = Vec::new();
    if matches!(format, Format::Adc) {
        let mut n_bytes = 0_u64;
        for path in captures {
            let file = std::fs::metadata(path).map_err(|e| CliError::io(path, e))?;
            n_bytes = n_bytes.saturating_add(file.len());
        }
        for finding in check_capture(radar, n_bytes, tried) {
            if finding.severity == Severity::Error {
                return Err(CliError::new(format!(
                    "{}: {}",
                    captures[0].display(),
                    finding.message
                ))
                .hint("--radar, --lanes and --real say what a frame is"));
            }
            notes.push(finding.message);
        }
    }
    let SampleKind::Complex { order } = tried.data else {
        return Ok(ChosenLayout {
            layout: tried,
            verdict: None,
            tried: IqOrder::IFirst,
            notes,
        });
    };
    if format == Format::Udp {
        if named.is_none() {
            return Err(CliError::new("live packets need the order of I and Q")
                .hint("--iq i-first or --iq q-first"));
        }
        return Ok(ChosenLayout {
            layout: tried,
            verdict: None,
            tried: IqOrder::IFirst,
            notes,
        });
    }
    let verdict = judge(format, captures, radar, tried)?;
    let best = match verdict.answer {
        IqAnswer::AsRead => Some(order),
        IqAnswer::Swapped => Some(order.swapped()),
        IqAnswer::Unclear => None,
    };
    let layout = match (named, args.iq, best) {
        (Some(_), _, best) => {
            if best.is_some_and(|best| best != order) {
                notes.push(format!(
                    "I/Q order looks swapped: read with {}, but {}",
                    order.name(),
                    explain(order, &verdict)
                ));
            }
            tried
        }
        (None, Some(IqChoice::Auto), Some(best)) => SampleLayout {
            lanes,
            data: complex(best),
        },
        (None, Some(_), _) => {
            return Err(CliError::new(format!(
                "the samples do not say clearly which of I and Q comes first: {}",
                explain(order, &verdict)
            ))
            .hint(
                "--iq i-first (mmWave Studio) or --iq q-first (SDK firmware with SampleSwap 1)",
            ));
        }
        (None, None, _) => {
            return Err(CliError::new(format!(
                "--iq is needed: recorders differ in which of I and Q they write first; here {}",
                explain(order, &verdict)
            ))
            .hint(format!(
                "--iq i-first (mmWave Studio), q-first (SDK firmware with SampleSwap 1) or auto{}",
                match said.q_first {
                    Some(true) => "; adcbufCfg says SampleSwap 1",
                    Some(false) => "; adcbufCfg says SampleSwap 0",
                    None => "",
                }
            )));
        }
    };
    Ok(ChosenLayout {
        layout,
        verdict: Some(verdict),
        tried: order,
        notes,
    })
}

fn complex(order: IqOrder) -> SampleKind {
    SampleKind::Complex { order }
}

/// A verdict of samples read with `order`, in words.
pub fn explain(order: IqOrder, verdict: &IqVerdict) -> String {
    let says = match verdict.answer {
        IqAnswer::AsRead => format!("the samples say {}", order.name()),
        IqAnswer::Swapped => format!("the samples say {}", order.swapped().name()),
        IqAnswer::Unclear => "the samples do not say".into(),
    };
    format!(
        "{says} ({:+.1} dB at positive against negative range read with {}, in {:.0} % of {} chirps)",
        verdict.positive_over_negative_db,
        order.name(),
        100.0 * verdict.positive_share,
        verdict.n_chirps
    )
}

/// Looks at the first frames.
fn judge(
    format: Format,
    captures: &[PathBuf],
    radar: &RadarConfig,
    layout: SampleLayout,
) -> CliResult<IqVerdict> {
    let shape = CubeShape::of(radar);
    let mut frames = Frames::open_raw(format, captures, shape, layout)?;
    let mut cube = shape.zeros()?;
    let mut check = IqCheck::new(shape.n_samples);
    for _ in 0..JUDGED_FRAMES {
        match frames.next_frame(&mut cube) {
            Ok(Some(_)) => check.push(&cube),
            Ok(None) => break,
            Err(e) => return Err(naming(&captures[0], e)),
        }
    }
    Ok(check.verdict())
}

/// An error with the file's name.
pub fn naming(path: &Path, error: AdcError) -> CliError {
    CliError::new(format!("{}: {error}", path.display()))
}

/// What the radar's file says about captures.
#[derive(Default)]
struct Said {
    layout: Option<SampleLayout>,
    /// Receivers from 1.
    receivers: Option<Vec<u8>>,
    /// `SampleSwap` of a chirp file: what SDK firmware does, not mmWave Studio.
    q_first: Option<bool>,
}

fn said_by_radar(name: &str) -> CliResult<Said> {
    Ok(match read_radar(name, Path::new(""))? {
        RadarSource::TiCfg(text) => {
            let cfg = TiCfg::parse(&text, None)?;
            Said {
                layout: None,
                receivers: Some(cfg.receivers),
                q_first: cfg.q_first,
            }
        }
        RadarSource::Studio { text, board } => Said {
            layout: StudioCapture::parse(&text, board)?.layout,
            ..Said::default()
        },
        RadarSource::BuiltIn(_) | RadarSource::Toml(_) => Said::default(),
    })
}

fn lanes(
    radar: &RadarConfig,
    named: Option<u8>,
    studio: Option<SampleLayout>,
    receivers: Option<Vec<u8>>,
) -> CliResult<Lanes> {
    if let (None, Some(layout)) = (named, studio) {
        return Ok(layout.lanes);
    }
    let board = Board::ALL.into_iter().find(|b| b.name() == radar.name);
    let n = match (named, board.and_then(Board::limits)) {
        (Some(n), _) => u32::from(n),
        (None, Some(limits)) => limits.lvds_lanes,
        (None, None) => {
            let cause = format!("the lanes of radar `{}` are not known", radar.name);
            return Err(CliError::new(cause)
                .hint("--lanes 4 for xWR12xx and 14xx, --lanes 2 for xWR16xx, 18xx and 68xx"));
        }
    };
    match n {
        2 => Ok(Lanes::Two),
        4 => {
            let mask = match receivers {
                Some(receivers) => receivers.iter().fold(0_u8, |mask, r| {
                    mask | 1_u8.checked_shl(u32::from(*r) - 1).unwrap_or(0)
                }),
                None if radar.rx.len() == 4 => 0b1111,
                None => {
                    return Err(CliError::new(format!(
                        "four lanes, {} receivers: which of the four are on?",
                        radar.rx.len()
                    ))
                    .hint("a TI .cfg or an export of mmWave Studio as --radar says so"));
                }
            };
            Ok(Lanes::Four { receivers: mask })
        }
        n => Err(CliError::new(format!("--lanes {n}: devices have 2 or 4"))),
    }
}

/// Remarks of the recorder's log beside a capture, if there is one: `X_Raw_LogFile.csv` beside
/// `X_Raw_0.bin` or `X.bin`.
pub fn log_notes(capture: &Path) -> CliResult<Vec<String>> {
    let Some(stem) = capture.file_stem().and_then(|s| s.to_str()) else {
        return Ok(Vec::new());
    };
    let base = match stem.rsplit_once("_Raw_") {
        Some((base, number)) if number.chars().all(|c| c.is_ascii_digit()) => base,
        _ => stem,
    };
    let path = capture.with_file_name(format!("{base}_Raw_LogFile.csv"));
    let Ok(file) = File::open(&path) else {
        return Ok(Vec::new());
    };
    let mut bytes = Vec::new();
    file.take(MAX_LOG_BYTES)
        .read_to_end(&mut bytes)
        .map_err(|e| CliError::io(&path, e))?;
    let log = RecordLog::parse(&String::from_utf8_lossy(&bytes))
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(log
        .problems()
        .into_iter()
        .map(|problem| format!("{name}: {problem}"))
        .collect())
}

type Npy = npyz::NpyFile<BufReader<File>>;

/// Opens an npy file and reads its head.
pub fn open_npy(path: &Path) -> CliResult<Npy> {
    let file = File::open(path).map_err(|e| CliError::io(path, e))?;
    npyz::NpyFile::new(BufReader::new(file)).map_err(|e| CliError::io(path, e))
}

/// Frames of an npy array; memory holds one frame, whatever the file claims.
pub struct NpyFrames {
    numbers: Box<dyn Iterator<Item = io::Result<Complex32>>>,
    is_real: bool,
    layout: FrameLayout,
    buffer: Vec<Complex32>,
    next: u64,
    /// Whether numbers are unsigned words; known after the first frame.
    words: Option<bool>,
}

impl NpyFrames {
    /// Opens an array whose axes are `axes`, or ours.
    pub fn open(path: &Path, radar: &RadarConfig, axes: Option<&str>) -> CliResult<Self> {
        let order = AxisOrder::parse(axes.unwrap_or("frame,loop,tx,rx,sample"))
            .map_err(|e| CliError::new(e).hint("--axes frame,chirp,rx,sample, for example"))?;
        let npy = open_npy(path)?;
        let is_fortran = npy.order() == npyz::Order::Fortran;
        let layout = order
            .fit(npy.shape(), is_fortran, CubeShape::of(radar))
            .map_err(|e| {
                naming(path, e).hint(format!(
                    "--radar names the radar that recorded the file (here `{}`), --axes the order of its axes",
                    radar.name
                ))
            })?;
        let descr = npy.dtype().descr();
        let fail = |e: &dyn std::fmt::Display| CliError::new(format!("{}: {e}", path.display()));
        let kind = descr.trim_matches('\'');
        let kind = kind.get(1..).unwrap_or_default();
        let is_real = !kind.starts_with('c');
        /// Every element kind, in its own type.
        macro_rules! numbers {
            ($kind:ty, $convert:expr) => {{
                let data = npy.data::<$kind>().map_err(|e| fail(&e))?;
                Box::new(data.map(|value| value.map($convert)))
            }};
        }
        let numbers: Box<dyn Iterator<Item = io::Result<Complex32>>> = match kind {
            "c8" => numbers!(Complex32, |z| z),
            "c16" => numbers!(Complex64, |z: Complex64| Complex32::new(
                z.re as f32,
                z.im as f32
            )),
            "i2" => numbers!(i16, |v| Complex32::from(f32::from(v))),
            "u2" => numbers!(u16, |v| Complex32::from(f32::from(v as i16))),
            "f4" => numbers!(f32, Complex32::from),
            "f8" => numbers!(f64, |v| Complex32::from(v as f32)),
            _ => {
                return Err(CliError::new(format!(
                    "{}: elements {descr}, expected complex64, complex128, int16, uint16, float32 or float64",
                    path.display()
                )));
            }
        };
        Ok(Self {
            numbers,
            is_real,
            layout,
            buffer: Vec::new(),
            next: 0,
            words: None,
        })
    }

    /// Frames of the array.
    pub fn n_frames(&self) -> u64 {
        self.layout.n_frames()
    }

    /// Whether the numbers were unsigned words and got their sign back; known after the first frame.
    pub fn were_words(&self) -> bool {
        self.words == Some(true)
    }
}

impl FrameSource for NpyFrames {
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError> {
        if self.next == self.layout.n_frames() {
            return Ok(None);
        }
        let n = self.layout.n_numbers();
        self.buffer.clear();
        for i in 0..n {
            match self.numbers.next() {
                Some(Ok(number)) => self.buffer.push(number),
                Some(Err(e)) => {
                    return Err(AdcError::Layout(format!(
                        "frame {}, number {i}: {e}",
                        self.next
                    )));
                }
                None => {
                    return Err(AdcError::Layout(format!(
                        "ends in frame {} of {}, at number {i} of {n}",
                        self.next,
                        self.layout.n_frames()
                    )));
                }
            }
        }
        let are_words = *self
            .words
            .get_or_insert_with(|| !self.is_real && axes::are_unsigned_words(&self.buffer));
        if are_words {
            axes::sign_words(&mut self.buffer)?;
        }
        self.layout.fill(&self.buffer, self.is_real, cube)?;
        let integrity = FrameIntegrity {
            frame: self.next,
            ..FrameIntegrity::default()
        };
        self.next += 1;
        Ok(Some(integrity))
    }

    fn trailing_bytes(&self) -> usize {
        0
    }
}
