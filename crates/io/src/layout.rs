//! Determines the layout of raw samples from the options, the radar's description and the samples themselves.

use std::{fs::File, io::Read, path::Path};

use radarllm_base::{
    RadarConfig,
    message::{option, text},
};
use radarllm_formats::{
    Board, SampleFormat, Severity,
    adc::{
        CubeShape, FrameSource, IqAnswer, IqCheck, IqOrder, IqVerdict, LvdsLanes, RecordLog,
        SampleKind, SampleLayout, check_capture,
    },
};

use crate::{
    error::{Error, Result},
    opened::Opened,
    options::{IqChoice, LayoutOptions},
    radar::OpenedRadar,
    samples::{SampleFiles, SampleFrames},
};

/// Number of frames from which the order of I and Q is judged.
const JUDGED_FRAMES: usize = 4;
/// Maximum size of a recorder's log, in bytes.
const MAX_LOG_BYTES: u64 = 1 << 20;

/// The layout of a raw capture, the evidence in its samples, and remarks.
pub struct ChosenLayout {
    /// The layout.
    pub layout: SampleLayout,
    /// Verdict on the first frames, read in the order [`Self::tried`]; `None` for real samples and live captures.
    pub verdict: Option<IqVerdict>,
    /// The order of I and Q to which the verdict applies.
    pub tried: IqOrder,
    /// Remarks for the user.
    pub notes: Vec<String>,
    /// Those of which a user should know before trusting the points: files whose size is not that of whole frames.
    pub warnings: Vec<String>,
}

/// Opens a recording of raw samples and determines its layout. Remarks are added to `notes`, and those of which a user should
/// know before trusting the points to `warnings`, too.
///
/// # Errors
/// A file that cannot be read, or a layout that neither the options nor the radar's description determine.
pub fn open_samples(
    opened: Opened,
    radar: &OpenedRadar,
    options: &LayoutOptions,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<SampleFrames> {
    let files = SampleFiles::new(opened)?;
    if files.format() == SampleFormat::Npy {
        return SampleFrames::open_npy(&files, radar.config()?, options.axes.as_deref());
    }
    let chosen = choose_layout(&files, radar, options)?;
    notes.extend(chosen.notes);
    warnings.extend(chosen.warnings);
    if let (SampleKind::Complex { order }, Some(verdict)) = (chosen.layout.data, chosen.verdict) {
        notes.push(format!(
            "read with {}; {}",
            order.name(),
            explain(chosen.tried, &verdict)
        ));
    }
    if files.format() != SampleFormat::Udp {
        notes.extend(log_notes(files.path())?);
    }
    SampleFrames::open_raw(&files, CubeShape::of(radar.sample_config()?), chosen.layout)
}

/// Determines the layout of a raw capture before the capture is processed.
///
/// The order of I and Q comes from the options, from an export of mmWave Studio, or from a chirp configuration whose
/// `SampleSwap` agrees with the samples. It is never guessed.
///
/// # Errors
/// A layout that cannot be determined, or a file that does not fit it.
pub fn choose_layout(
    files: &SampleFiles,
    opened: &OpenedRadar,
    options: &LayoutOptions,
) -> Result<ChosenLayout> {
    let format = files.format();
    let radar = opened.sample_config()?;
    let studio = opened.hints.layout;
    let lanes = lanes(
        radar,
        options.lanes,
        studio,
        opened.hints.receivers.as_deref(),
    )?;
    let named = match (options.real, options.iq, studio.map(|l| l.data)) {
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
    let (mut notes, mut warnings) = (Vec::new(), Vec::new());
    if format == SampleFormat::Adc {
        for finding in check_capture(radar, files.n_bytes()?, tried) {
            if finding.severity == Severity::Error {
                return Err(Error::input(format!(
                    "{}: {}",
                    files.path().display(),
                    finding.message
                ))
                .with_hint(
                    option("radar")
                        .text(", ")
                        .option("lanes")
                        .text(" and ")
                        .option("real")
                        .text(" define the size of a frame"),
                ));
            }
            if finding.severity == Severity::Warning {
                warnings.push(finding.message.clone());
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
            warnings,
        });
    };
    if format == SampleFormat::Udp {
        if named.is_none() {
            return Err(
                Error::input("live packets need the order of I and Q").with_hint(
                    option("iq")
                        .text(" i-first or ")
                        .option("iq")
                        .text(" q-first"),
                ),
            );
        }
        return Ok(ChosenLayout {
            layout: tried,
            verdict: None,
            tried: IqOrder::IFirst,
            notes,
            warnings,
        });
    }
    let verdict = judge(files, radar, tried)?;
    let best = match verdict.answer {
        IqAnswer::AsRead => Some(order),
        IqAnswer::Swapped => Some(order.swapped()),
        IqAnswer::Unclear => None,
    };
    let layout = match (named, options.iq, best) {
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
        (None, None, Some(best)) if opened.hints.q_first == Some(best == IqOrder::QFirst) => {
            notes.push(format!(
                "{}: adcbufCfg of the chirp file and the samples agree",
                best.name()
            ));
            SampleLayout {
                lanes,
                data: complex(best),
            }
        }
        (None, Some(_), _) => {
            return Err(Error::input(format!(
                "the samples do not say clearly which of I and Q comes first: {}",
                explain(order, &verdict)
            ))
            .with_hint(
                option("iq")
                    .text(" i-first (mmWave Studio) or ")
                    .option("iq")
                    .text(" q-first (SDK firmware with SampleSwap 1)"),
            ));
        }
        (None, None, _) => {
            return Err(Error::input(option("iq").text(format!(
                " is needed: recorders differ in which of I and Q they write first; here {}",
                explain(order, &verdict)
            )))
            .with_hint(option("iq").text(format!(
                " i-first (mmWave Studio), q-first (SDK firmware with SampleSwap 1) or auto{}",
                match opened.hints.q_first {
                    Some(true) => "; adcbufCfg says SampleSwap 1",
                    Some(false) => "; adcbufCfg says SampleSwap 0",
                    None => "",
                }
            ))));
        }
    };
    Ok(ChosenLayout {
        layout,
        verdict: Some(verdict),
        tried: order,
        notes,
        warnings,
    })
}

fn complex(order: IqOrder) -> SampleKind {
    SampleKind::Complex { order }
}

/// Describes in words the verdict on samples that were read with `order`.
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

/// Analyses the first frames.
fn judge(files: &SampleFiles, radar: &RadarConfig, layout: SampleLayout) -> Result<IqVerdict> {
    let shape = CubeShape::of(radar);
    let mut frames = SampleFrames::open_raw(files, shape, layout)?;
    let mut cube = shape.zeros()?;
    let mut check = IqCheck::new(shape.n_samples);
    for _ in 0..JUDGED_FRAMES {
        match frames.next_frame(&mut cube) {
            Ok(Some(_)) => check.push(&cube),
            Ok(None) => break,
            Err(e) => return Err(Error::wrap_in_file(files.path(), e)),
        }
    }
    Ok(check.verdict())
}

fn lanes(
    radar: &RadarConfig,
    named: Option<u8>,
    studio: Option<SampleLayout>,
    receivers: Option<&[u8]>,
) -> Result<LvdsLanes> {
    if let (None, Some(layout)) = (named, studio) {
        return Ok(layout.lanes);
    }
    let board = Board::ALL.into_iter().find(|b| b.name() == radar.name);
    let n = match (named, board.and_then(Board::limits)) {
        (Some(n), _) => u32::from(n),
        (None, Some(limits)) => limits.lvds_lanes,
        (None, None) => {
            let cause = format!("the lanes of radar `{}` are not known", radar.name);
            return Err(Error::input(cause).with_hint(
                option("lanes")
                    .text(" 4 for xWR12xx and 14xx, ")
                    .option("lanes")
                    .text(" 2 for xWR16xx, 18xx and 68xx"),
            ));
        }
    };
    match n {
        2 => Ok(LvdsLanes::Two),
        4 => {
            let mask = match receivers {
                Some(receivers) => receivers.iter().fold(0_u8, |mask, r| {
                    mask | 1_u8.checked_shl(u32::from(*r) - 1).unwrap_or(0)
                }),
                None if radar.rx.len() == 4 => 0b1111,
                None => {
                    return Err(Error::input(format!(
                        "four lanes, {} receivers: which of the four are on?",
                        radar.rx.len()
                    ))
                    .with_hint(
                        text("a TI .cfg or an export of mmWave Studio as ")
                            .option("radar")
                            .text(" says so"),
                    ));
                }
            };
            Ok(LvdsLanes::Four { receivers: mask })
        }
        n => Err(Error::input(
            option("lanes").text(format!(" {n}: devices have 2 or 4")),
        )),
    }
}

/// Returns remarks from the recorder's log if it exists: `X_Raw_LogFile.csv` beside `X_Raw_0.bin` or `X.bin`.
pub fn log_notes(capture: &Path) -> Result<Vec<String>> {
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
        .map_err(|e| Error::io(&path, e))?;
    let log = RecordLog::parse(&String::from_utf8_lossy(&bytes))
        .map_err(|e| Error::wrap_in_file(&path, e))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(log
        .problems()
        .into_iter()
        .map(|problem| format!("{name}: {problem}"))
        .collect())
}
