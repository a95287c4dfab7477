//! A board with a demo of TI on serial ports: sends it the chirp file, reads its packets, survives unplugging.

use std::{
    io::{ErrorKind, Read as _},
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

use radarllm_base::{Provenance, RecordedFrame, SourceInfo, TimelineError, message::option};
use radarllm_formats::{
    ChirpDialect, Mounting, RecordingFormat, UartParser,
    uart::{Dialect, SubframeJoiner, UartFrame},
};

use super::{
    LiveCounts, LiveEvent, LiveSource, LiveTimeouts,
    cli::{self, CliError, Sending},
    deadline,
    output::{Clock, FrameContent, Output},
};
use crate::{
    cleaning,
    error::{Error, Result},
    options::{
        CaptureFormat, CaptureOptions, DEFAULT_RADAR_HEIGHT_M, NEEDS_SAMPLES, refuse_options,
    },
    placing::Placing,
    points::{explain_reasons, mounting, radar_name},
    radar::RadarSource,
    serial::Terminal,
};

/// Maximum number of bytes read at once.
const PIECE_BYTES: usize = 16 << 10;

/// Time between two calls of the caller that counts as silence of the board. During a longer one, nobody listened.
const MAX_PAUSE: Duration = Duration::from_secs(1);

/// Packets without points after which it is asked whether they mean anything.
const N_SUSPICIOUS_PACKETS: u64 = 50;

/// Options of a [`TiBoard`].
#[derive(Clone, Debug, Default)]
pub struct TiBoardOptions {
    /// Port of the packets.
    pub data: PathBuf,
    /// Port of the command line. With it, the chirp file of `capture.radar` is sent when the board is opened, after
    /// every interruption, and to a board that sends nothing.
    pub cli: Option<PathBuf>,
    /// Radar, mounting, dialect and baud rate, as for a recording.
    pub capture: CaptureOptions,
    /// After how long the source acts.
    pub timeouts: LiveTimeouts,
}

/// A board with a demo of TI.
pub struct TiBoard {
    data: PathBuf,
    cli: Option<Cli>,
    baud: u32,
    timeouts: LiveTimeouts,
    about: SourceInfo,
    notes: Vec<String>,
    /// Whether a frame waits for sub-frames until the next packet. Only chirp files with advanced frames have some.
    waits_for_subframes: bool,

    link: Link,
    parser: UartParser,
    /// Dialect of the stream, which does not change when the board is lost.
    dialect: Option<Dialect>,
    /// Velocity of a Doppler bin, m/s, if the chirp is known.
    doppler_step_mps: Option<f32>,
    /// See [`LiveSource::problem`].
    problem: Option<String>,
    joiner: SubframeJoiner,
    /// The radar's number of the frame that was given out last.
    last_number: Option<u64>,
    output: Output,
    piece: Vec<u8>,

    /// The chirp file was sent again since the last packet.
    was_sent_again: bool,
    /// Time of the last packet, or of opening.
    last_packet: Instant,
    /// Time since which the open port is silent: the last packet, or the end of a chirp file.
    silent_since: Instant,
    /// End of the caller's last wait.
    listened_until: Instant,
    /// Bytes received since the last packet.
    unread_bytes: u64,
    refused_lines: u64,
    /// Searches for packets in the streams before the present one.
    earlier_searches: u64,
}

/// The board's command line and what is sent to it.
struct Cli {
    path: PathBuf,
    commands: Arc<[cli::Command]>,
}

impl Cli {
    fn send(&self, timeouts: &LiveTimeouts) -> std::io::Result<Sending> {
        Sending::open(&self.path, Arc::clone(&self.commands), timeouts.answer)
    }
}

/// State of the ports.
enum Link {
    /// Waits to be opened.
    Closed { reopen_at: Instant },
    /// The chirp file is being sent.
    Sending { data: Terminal, sending: Sending },
    /// Packets are read.
    Open { data: Terminal },
}

impl TiBoard {
    /// Opens the ports. With a command line, returns once the board has accepted every line of the chirp file.
    ///
    /// # Errors
    /// Options that do not fit, a port that cannot be opened, or a line that the board refuses, with its number and
    /// the board's words.
    pub fn open(options: TiBoardOptions) -> Result<Self> {
        let TiBoardOptions {
            data,
            cli,
            capture,
            timeouts,
        } = options;
        check_options(&capture)?;
        let points = &capture.points;
        let radar = capture.radar.as_ref();
        let frame_rate_hz = points
            .frame_rate_hz
            .or_else(|| radar.map(|r| r.points.frame_rate_hz()))
            .ok_or_else(|| {
                Error::wrap_in_file(&data, TimelineError::NoRate).with_hint(
                    option("frame_rate")
                        .text(" HZ, or ")
                        .option("radar")
                        .text(" with the chirp file of the board"),
                )
            })?;
        if !(frame_rate_hz > 0.0 && frame_rate_hz <= 1000.0) {
            return Err(Error::wrap_in_file(
                &data,
                TimelineError::Rate(frame_rate_hz),
            ));
        }
        let cfg = radar.and_then(|r| match &r.source {
            RadarSource::TiCfg(text) => Some(text.as_str()),
            _ => None,
        });
        let dialect = radar.and_then(|r| r.points.dialect);
        let cli = match cli {
            Some(path) => Some(Cli {
                commands: commands_for(&path, &data, cfg, dialect)?,
                path,
            }),
            None => None,
        };
        let may_have_subframes = cfg.is_none() || dialect == Some(ChirpDialect::AdvancedFrames);
        let mut notes = Vec::new();
        if let Some(radar) = radar {
            explain_reasons(radar, &mut notes, &mut Vec::new());
        }
        let position = radar.and_then(|r| r.points.position);
        let mounting: Mounting = mounting(points, position, &mut notes)?;
        let background = cleaning::point_background(&capture)?;
        let height_m = capture
            .radar_height_m
            .or(position.map(|p| p.height_m as f32));
        let about = SourceInfo {
            frame_period_s: 1.0 / frame_rate_hz,
            radar: radar_name(RecordingFormat::Uart, radar),
            radar_height_m: height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: height_m.is_none(),
            clutter: points.clutter(),
            provenance: Provenance::recorded(RecordingFormat::Uart.name(), data.display()),
        };
        let port = Terminal::open(&data, points.baud).map_err(|e| Error::io(&data, e))?;
        if let Some(cli) = &cli {
            send_whole(cli, &port, &timeouts)?;
        }
        let placing = Placing::new(points, mounting, frame_rate_hz, background)?;
        let doppler_step_mps = radar
            .and_then(|r| r.points.velocity_resolution_mps)
            .map(|v| v as f32);
        let now = Instant::now();
        Ok(Self {
            output: Output::new(Clock::RateHz(frame_rate_hz), placing, &timeouts),
            baud: points.baud,
            dialect: points.dialect,
            parser: parser(points.dialect, doppler_step_mps),
            doppler_step_mps,
            problem: None,
            data,
            cli,
            timeouts,
            about,
            notes,
            waits_for_subframes: may_have_subframes,
            link: Link::Open { data: port },
            joiner: SubframeJoiner::default(),
            last_number: None,
            piece: vec![0; PIECE_BYTES],
            was_sent_again: false,
            last_packet: now,
            silent_since: now,
            listened_until: now,
            unread_bytes: 0,
            refused_lines: 0,
            earlier_searches: 0,
        })
    }

    /// A caller that was busy for long finds the bytes of that time in the system's buffer, so it was no silence.
    fn leave_out_pause(&mut self) {
        let pause = Instant::now().saturating_duration_since(self.listened_until);
        if pause > MAX_PAUSE {
            self.last_packet += pause;
            self.silent_since += pause;
        }
    }

    /// Does what is due, waiting until `until` at most.
    fn step(&mut self, until: Instant) {
        let reopen_at = Instant::now();
        match std::mem::replace(&mut self.link, Link::Closed { reopen_at }) {
            Link::Closed { reopen_at } => self.step_closed(reopen_at, until),
            Link::Sending { data, sending } => self.step_sending(data, sending, until),
            Link::Open { data } => self.step_open(data, until),
        }
    }

    fn step_closed(&mut self, reopen_at: Instant, until: Instant) {
        let now = Instant::now();
        if now < reopen_at {
            self.link = Link::Closed { reopen_at };
            std::thread::sleep(reopen_at.min(until).saturating_duration_since(now));
            return;
        }
        match Terminal::open(&self.data, self.baud) {
            Ok(data) => self.send_or_listen(data),
            Err(error) => self.lose(&error.to_string()),
        }
    }

    /// Sends the chirp file to a board whose data port is open, or listens if there is none.
    fn send_or_listen(&mut self, data: Terminal) {
        self.silent_since = Instant::now();
        self.link = match self.cli.as_ref().map(|cli| cli.send(&self.timeouts)) {
            None => Link::Open { data },
            Some(Ok(sending)) => Link::Sending { data, sending },
            Some(Err(error)) => return self.lose(&error.to_string()),
        };
    }

    fn step_sending(&mut self, data: Terminal, mut sending: Sending, until: Instant) {
        let lost_at = self.lost_at();
        if lost_at.is_some_and(|at| Instant::now() >= at) {
            self.output.lose(self.data.display(), &self.silence());
        }
        let until = lost_at.map_or(until, |at| at.min(until));
        match sending.step(until) {
            Ok(false) => self.link = Link::Sending { data, sending },
            Ok(true) => {
                self.silent_since = Instant::now();
                self.link = Link::Open { data };
            }
            Err(error) => {
                if matches!(error, CliError::Refused { .. }) {
                    self.refused_lines += 1;
                }
                self.lose(&error.to_string());
            }
        }
    }

    fn step_open(&mut self, mut data: Terminal, until: Instant) {
        let until = [self.close_at(), self.send_again_at(), self.lost_at()]
            .into_iter()
            .flatten()
            .fold(until, Instant::min);
        // Bytes that wait in the system come before a decision about silence.
        match data.wait(until.saturating_duration_since(Instant::now())) {
            Ok(true) => match data.read(&mut self.piece) {
                Ok(0) => self.lose("the port is gone"),
                Ok(n) => {
                    self.link = Link::Open { data };
                    self.read_bytes(n);
                }
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                    self.link = Link::Open { data };
                }
                Err(e) => self.lose(&e.to_string()),
            },
            Ok(false) => self.link = Link::Open { data },
            Err(e) if e.kind() == ErrorKind::Interrupted => {
                self.link = Link::Open { data };
                return;
            }
            Err(e) => self.lose(&e.to_string()),
        }
        self.act_on_silence();
    }

    /// When an open port without packets is closed and opened again.
    fn close_at(&self) -> Option<Instant> {
        self.silent_since.checked_add(self.timeouts.lost)
    }

    /// When the chirp file is sent again.
    fn send_again_at(&self) -> Option<Instant> {
        let is_possible = self.cli.is_some() && !self.was_sent_again;
        let at = self.silent_since.checked_add(self.timeouts.send_again);
        at.filter(|_| is_possible)
    }

    /// When the board counts as lost.
    fn lost_at(&self) -> Option<Instant> {
        let at = self.last_packet.checked_add(self.timeouts.lost);
        at.filter(|_| !self.output.is_lost())
    }

    fn act_on_silence(&mut self) {
        if !matches!(self.link, Link::Open { .. }) {
            return;
        }
        let now = Instant::now();
        let is_due = |at: Option<Instant>| at.is_some_and(|at| now >= at);
        if is_due(self.send_again_at()) {
            self.was_sent_again = true;
            self.end_stream();
            let reopen_at = now;
            if let Link::Open { data } =
                std::mem::replace(&mut self.link, Link::Closed { reopen_at })
            {
                match data.discard_input() {
                    Ok(()) => self.send_or_listen(data),
                    Err(e) => self.lose(&e.to_string()),
                }
            }
        } else if is_due(self.close_at()) {
            self.lose(&self.silence());
        } else if is_due(self.lost_at()) {
            self.output.lose(self.data.display(), &self.silence());
        }
    }

    /// Why nothing was read, for the user.
    fn silence(&self) -> String {
        let seconds = self.timeouts.lost.as_secs_f64();
        match self.unread_bytes {
            0 => format!("the board sent nothing for {seconds} s"),
            n => format!(
                "{n} bytes and no packet in {seconds} s: is {} the baud rate of the data port?",
                self.baud
            ),
        }
    }

    /// Closes the ports, to be opened again later.
    fn lose(&mut self, reason: &str) {
        self.end_stream();
        self.output.lose(self.data.display(), reason);
        self.was_sent_again = false;
        let reopen_at = self.output.next_try();
        self.link = Link::Closed { reopen_at };
    }

    /// Ends the present stream. Frames that waited for more bytes are given out.
    fn end_stream(&mut self) {
        let next = parser(self.dialect, self.doppler_step_mps);
        let parser = std::mem::replace(&mut self.parser, next);
        let n_searches = parser.report().resynchronisations;
        // Bytes that do not show their dialect are no frames. The few packets of a short stream do not determine the
        // dialect of the next one.
        match parser.finish() {
            Ok((packets, report, _)) => {
                self.earlier_searches += report.resynchronisations;
                self.receive(packets);
            }
            Err(_) => self.earlier_searches += n_searches,
        }
        if let Some(frame) = self.joiner.finish() {
            self.give(frame);
        }
        self.output.interrupt();
        self.unread_bytes = 0;
    }

    /// Parses the first `n` bytes of the piece.
    fn read_bytes(&mut self, n: usize) {
        let n_begun = self.parser.n_begun();
        let packets = match self.parser.push(&self.piece[..n]) {
            Ok(packets) => packets,
            // Later bytes may be read.
            Err(error) => {
                self.problem = Some(format!("{}: {error}", self.data.display()));
                self.end_stream();
                return;
            }
        };
        // Without a known dialect, packets are not yet complete.
        if packets.is_empty() && self.parser.n_begun() == n_begun {
            self.unread_bytes += n as u64;
        } else {
            let now = Instant::now();
            (self.last_packet, self.silent_since) = (now, now);
            self.was_sent_again = false;
            self.unread_bytes = 0;
        }
        if let (Some(guess), None) = (self.parser.guess(), self.dialect) {
            self.dialect = Some(guess.dialect);
            self.notes.push(format!("dialect {guess}"));
        }
        self.look_for_problems();
        self.receive(packets);
    }

    /// Whether packets arrive that tell nothing.
    fn look_for_problems(&mut self) {
        let report = self.parser.report();
        let n_packets = report.packets + report.short_packets + report.unclear_packets;
        let is_telling = report.points > 0 && report.points_of_doppler_bins == 0;
        let problem = if let Some(error) = self.parser.unclear() {
            Some(error.to_string())
        } else if is_telling || n_packets < N_SUSPICIOUS_PACKETS {
            None
        } else if report.points_of_doppler_bins > 0 {
            let is_lacking = self.doppler_step_mps.is_none();
            is_lacking.then(|| {
                "the demo sends Doppler bins instead of speeds, which need the chirp file".into()
            })
        } else {
            report.no_points_because()
        };
        self.problem = problem.map(|problem| format!("{}: {problem}", self.data.display()));
    }

    /// Joins packets to frames.
    fn receive(&mut self, packets: Vec<UartFrame>) {
        for packet in packets.into_iter().filter(|p| p.complete) {
            if packet.subframe > 0 {
                let is_late =
                    !self.waits_for_subframes && self.last_number == Some(packet.number.into());
                self.waits_for_subframes = true;
                if is_late {
                    continue;
                }
            }
            let ended = self.joiner.push(packet);
            let last = match self.waits_for_subframes {
                true => None,
                false => self.joiner.finish(),
            };
            for frame in ended.into_iter().chain(last) {
                self.give(frame);
            }
        }
    }

    fn give(&mut self, frame: RecordedFrame) {
        self.last_number = Some(frame.number);
        let content = FrameContent {
            points: frame.points,
            board: frame.board,
        };
        self.output.give(frame.number, content);
    }
}

impl LiveSource for TiBoard {
    fn next(&mut self, timeout: Duration) -> Result<Option<LiveEvent>> {
        let until = deadline(timeout);
        self.leave_out_pause();
        let mut event = self.output.next_event();
        while event.is_none() {
            self.step(until);
            event = self.output.next_event();
            if Instant::now() >= until {
                break;
            }
        }
        self.listened_until = Instant::now();
        Ok(event)
    }

    fn about(&self) -> SourceInfo {
        self.about.clone()
    }

    fn counts(&self) -> LiveCounts {
        let counts = self.output.counts();
        let searches = self.earlier_searches + self.parser.report().resynchronisations;
        LiveCounts {
            resynchronisations: searches + counts.resynchronisations,
            refused_lines: self.refused_lines,
            ..counts
        }
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn problem(&self) -> Option<String> {
        self.problem.clone()
    }
}

fn parser(dialect: Option<Dialect>, doppler_step_mps: Option<f32>) -> UartParser {
    UartParser::new(dialect).with_doppler_step(doppler_step_mps.unwrap_or(0.0))
}

/// Refuses options that packets of a board do not use. Otherwise they would be ignored silently.
fn check_options(capture: &CaptureOptions) -> Result {
    capture.points.check_for_format(RecordingFormat::Uart)?;
    refuse_options(
        &[
            ("processing", capture.processing.is_some()),
            ("frames", capture.max_frames.is_some()),
            ("iq", capture.layout.is_given()),
        ],
        NEEDS_SAMPLES,
    )?;
    let has_other_format = capture
        .format
        .is_some_and(|f| f != CaptureFormat::Format(RecordingFormat::Uart));
    refuse_options(
        &[
            ("format", has_other_format),
            ("seconds", capture.points.seconds.is_some()),
        ],
        "has no meaning for a running board",
    )
}

/// The commands of the chirp file for the command line at `path`.
fn commands_for(
    path: &Path,
    data: &Path,
    cfg: Option<&str>,
    dialect: Option<ChirpDialect>,
) -> Result<Arc<[cli::Command]>> {
    // A board of the low-power SDK has one port for both.
    if path == data && cfg.is_some() && dialect != Some(ChirpDialect::LowPower) {
        return Err(Error::in_file(path, "both the data port and the CLI port"));
    }
    let Some(cfg) = cfg else {
        return Err(Error::in_file(path, "there is no chirp file to send")
            .with_hint(option("radar").text(" with the .cfg of the board")));
    };
    Ok(cli::commands(cfg).into())
}

/// Sends the chirp file and waits until the board has accepted it.
fn send_whole(cli: &Cli, data: &Terminal, timeouts: &LiveTimeouts) -> Result {
    // Packets of an earlier run are not part of this one.
    data.discard_input()
        .and_then(|()| cli.send(timeouts))
        .map_err(|e| Error::io(&cli.path, e))
        .and_then(|mut sending| {
            loop {
                match sending.step(Instant::now() + timeouts.answer) {
                    Ok(true) => return Ok(()),
                    Ok(false) => {}
                    Err(CliError::Port(e)) => return Err(Error::io(&cli.path, e)),
                    Err(error) => {
                        return Err(Error::wrap_in_file(&cli.path, error).with_hint(option("radar").text(
                            " must be the .cfg of the demo that runs on the board; a reset of the board clears its state",
                        )));
                    }
                }
            }
        })
}
