//! The UART output of TI's demos: parses a byte stream into frames.
//!
//! Packets start with [`MAGIC`], followed by a header and TLVs (type, length, value) that differ between firmware
//! versions: see [`Dialect`]. [`UartParser`] accepts bytes in pieces of any size. It detects the dialect from several
//! packets unless it is given ([`mod@guess`]), resynchronises on the next magic after damage, and counts all dropped
//! data in a [`UartReport`].
//!
//! Points are in the axes of the sensor with the project's orientation: x right, y away, z up, m; the velocity is
//! positive when receding. Whether a given board mirrors x is unknown: see "Handedness of boards" in CONVENTIONS.md.
//! `intensity_db` is the SNR of the firmware in dB: from the side information (type 7, in 0.1 dB), from type 301, or 10
//! log10 of the linear SNR of the people counting labs. If the firmware sends no SNR, the intensity is 0 and the point
//! is counted in the report. The intensity is not an absolute power.

pub mod dialect;
pub mod guess;
mod packet;
mod tlv;

use std::collections::BTreeMap;

use radarllm_base::{BoardReport, RadarPoint, RecordedFrame};

pub use dialect::Dialect;
pub use guess::{Evidence, GUESS_PACKETS, Guess};
use packet::{BadHeader, Header, Step, Walk, header};
use tlv::{Content, Kind, decode, with_snr};
pub use tlv::{Stats, Target, TargetHeight, Temperatures};

/// First bytes of every packet.
pub const MAGIC: [u8; 8] = [2, 1, 4, 3, 6, 5, 8, 7];
/// Maximum length of a packet, bytes: a 256 x 128 heat map of 16 bits is 64 KiB.
pub const MAX_PACKET_BYTES: usize = 256 << 10;
/// Maximum number of TLVs in a packet.
pub const MAX_TLVS: usize = 64;
/// Maximum number of bytes kept while the dialect is being detected.
const MAX_GUESS_BYTES: usize = 4 * MAX_PACKET_BYTES;
/// Maximum number of unknown TLV types that are counted individually.
const MAX_UNKNOWN_NUMBERS: usize = 32;

/// One packet.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct UartFrame {
    /// Frame number of the firmware.
    pub number: u32,
    /// Sub-frame; 0 for most configurations.
    pub subframe: u32,
    /// CPU clock of the chip, cycles modulo 2^32, if the dialect reports it.
    pub cycles: Option<u32>,
    /// False if the next packet starts before the stated end of this one. In that case, only the header is used.
    pub complete: bool,
    /// Moving points, in the firmware's order.
    pub points: Vec<RadarPoint>,
    /// Points without motion (Area Scanner).
    pub static_points: Vec<RadarPoint>,
    /// Range profile as sent. The out-of-box demo sends the log2 magnitude in steps of 1/512.
    pub range_profile: Vec<u16>,
    /// Processing times.
    pub stats: Option<Stats>,
    /// Chip temperatures.
    pub temperatures: Option<Temperatures>,
    /// Tracked objects.
    pub targets: Vec<Target>,
    /// Vertical extents of the tracked objects.
    pub heights: Vec<TargetHeight>,
    /// Track of every point **of the previous frame**, in the firmware's order and including dropped points. Values
    /// from 253 on mean no track.
    pub indices: Vec<u8>,
    /// Presence flags.
    pub presence: Option<u32>,
}

/// Counts of the data that were read and dropped.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct UartReport {
    /// Bytes pushed: the sum of the next three counts.
    pub bytes: u64,
    /// Bytes of packets, complete or truncated.
    pub packet_bytes: u64,
    /// Bytes between packets.
    pub skipped_bytes: u64,
    /// Bytes of the unfinished packet at the end.
    pub trailing_bytes: u64,
    /// Searches for the next packet after the first one: after foreign bytes, a bad header or a truncated packet.
    /// Damage without a whole packet in between is one search.
    pub resynchronisations: u64,
    /// Complete packets.
    pub packets: u64,
    /// Packets truncated by the magic of the next one.
    pub short_packets: u64,
    /// Magics followed by an impossible header.
    pub bad_headers: u64,
    /// Magics with a header whose checksum is wrong.
    pub bad_checksums: u64,
    /// TLVs used.
    pub tlvs: u64,
    /// TLVs of known types whose content is not used (heat maps).
    pub tlvs_unused: u64,
    /// TLVs whose type the dialect does not know.
    pub tlvs_unknown: u64,
    /// The first 32 types among them, with their counts.
    pub unknown_numbers: BTreeMap<u32, u64>,
    /// TLVs whose length does not match their type or exceeds the packet.
    pub tlvs_wrong_length: u64,
    /// Points kept.
    pub points: u64,
    /// Points dropped because of NaN or infinity.
    pub points_not_finite: u64,
    /// Points dropped because they are farther than 1 km or faster than 1 km/s.
    pub points_out_of_range: u64,
    /// Points kept without SNR: intensity 0 dB.
    pub points_without_snr: u64,
    /// Side information that does not have one entry per point, and was not used.
    pub side_info_mismatches: u64,
    /// Targets and heights dropped for the same reasons as points.
    pub targets_dropped: u64,
    /// Complete packets without points.
    pub frames_without_points: u64,
    /// Frame numbers that are missing between packets.
    pub lost_frames: u64,
    /// Decreases of the frame number: the device was restarted.
    pub restarts: u64,
}

/// Reason why a stream cannot be read: its dialect cannot be detected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UartError {
    /// The bytes contain no magic.
    #[error("no UART packet in {0} bytes: expected the magic 02 01 04 03 06 05 08 07")]
    NoPacket(usize),
    /// Two dialects explain the packets equally well, or none does.
    #[error("the dialect of the UART stream is not clear: name one of {}; seen: {}", names(), scores(.0))]
    Unclear(Vec<Evidence>),
}

fn names() -> String {
    Dialect::ALL.map(Dialect::name).join(", ")
}

fn scores(evidence: &[Evidence]) -> String {
    let parts: Vec<String> = evidence
        .iter()
        .map(|e| format!("{} {:.1}", e.dialect.name(), e.score))
        .collect();
    parts.join(", ")
}

/// An incremental parser that accepts bytes as they arrive.
#[derive(Debug)]
pub struct UartParser {
    dialect: Option<Dialect>,
    guess: Option<Guess>,
    buffer: Vec<u8>,
    /// Number of magics found while the dialect is unknown.
    magics: usize,
    last_number: Option<u32>,
    /// False from damage to the next complete packet, and before the first one.
    is_synchronised: bool,
    report: UartReport,
}

impl UartParser {
    /// Creates a parser for one dialect, or one that detects the dialect from the first packets.
    pub fn new(dialect: Option<Dialect>) -> Self {
        Self {
            dialect,
            guess: None,
            buffer: Vec::new(),
            magics: 0,
            last_number: None,
            is_synchronised: false,
            report: UartReport::default(),
        }
    }

    /// Returns the counts up to now.
    pub fn report(&self) -> &UartReport {
        &self.report
    }

    /// Returns the dialect, once it is known.
    pub fn dialect(&self) -> Option<Dialect> {
        self.dialect
    }

    /// Returns the number of packets that began while the dialect was unknown.
    pub fn n_begun(&self) -> usize {
        self.magics
    }

    /// Returns how the dialect was detected, if it was not given.
    pub fn guess(&self) -> Option<&Guess> {
        self.guess.as_ref()
    }

    /// Parses the next bytes and returns the packets that they complete.
    ///
    /// # Errors
    /// If the dialect cannot be detected.
    pub fn push(&mut self, bytes: &[u8]) -> Result<Vec<UartFrame>, UartError> {
        self.report.bytes += bytes.len() as u64;
        let mut frames = Vec::new();
        // The bytes are processed in pieces, so that the buffer remains small regardless of their number.
        for piece in bytes.chunks(MAX_PACKET_BYTES) {
            let unseen = self.buffer.len().saturating_sub(MAGIC.len() - 1);
            self.buffer.extend_from_slice(piece);
            if self.dialect.is_none() {
                self.magics += count_magics(&self.buffer[unseen..]);
                if self.magics <= GUESS_PACKETS && self.buffer.len() < MAX_GUESS_BYTES {
                    continue;
                }
                self.decide()?;
            }
            self.drain(&mut frames);
        }
        Ok(frames)
    }

    /// Ends the stream. Returns the packets that were waiting for detection of the dialect, and the counts.
    ///
    /// # Errors
    /// If the dialect cannot be detected from the bytes received.
    pub fn finish(mut self) -> Result<(Vec<UartFrame>, UartReport, Option<Guess>), UartError> {
        let mut frames = Vec::new();
        if self.dialect.is_none() {
            self.decide()?;
            self.drain(&mut frames);
        }
        self.report.trailing_bytes = self.buffer.len() as u64;
        Ok((frames, self.report, self.guess))
    }

    fn decide(&mut self) -> Result<(), UartError> {
        let guess = guess::guess(&self.buffer).map_err(|evidence| {
            if evidence.is_empty() {
                UartError::NoPacket(self.buffer.len())
            } else {
                UartError::Unclear(evidence)
            }
        })?;
        self.dialect = Some(guess.dialect);
        self.guess = Some(guess);
        Ok(())
    }

    /// Takes all finished packets out of the buffer.
    fn drain(&mut self, frames: &mut Vec<UartFrame>) {
        let Some(dialect) = self.dialect else {
            return;
        };
        let buffer = std::mem::take(&mut self.buffer);
        let mut at = 0;
        loop {
            let Some(gap) = find_magic(&buffer[at..]) else {
                // The last 7 bytes may be the start of a magic.
                let keep = (buffer.len() - at).min(MAGIC.len() - 1);
                let gap = buffer.len() - at - keep;
                self.skip(gap);
                at += gap;
                break;
            };
            self.skip(gap);
            at += gap;
            let rest = &buffer[at..];
            let head = match header(dialect, rest) {
                None => break,
                Some(Ok(head)) => head,
                Some(Err(why)) => {
                    match why {
                        BadHeader::Implausible => self.report.bad_headers += 1,
                        BadHeader::Checksum => self.report.bad_checksums += 1,
                    }
                    self.skip(MAGIC.len());
                    at += MAGIC.len();
                    continue;
                }
            };
            let seen = &rest[..head.total_len.min(rest.len())];
            if let Some(next) = find_magic(&seen[MAGIC.len()..]) {
                let short = MAGIC.len() + next;
                if short < dialect.header_len() {
                    // The header itself is truncated: its end was read from the start of the next packet.
                    self.report.bad_headers += 1;
                    self.skip(short);
                    at += short;
                    continue;
                }
                self.report.short_packets += 1;
                self.count_search();
                self.report.packet_bytes += short as u64;
                at += short;
                self.count_number(head.number);
                frames.push(UartFrame {
                    number: head.number,
                    subframe: head.subframe,
                    cycles: head.cycles,
                    ..UartFrame::default()
                });
                continue;
            }
            if rest.len() < head.total_len {
                break;
            }
            self.report.packets += 1;
            self.is_synchronised = true;
            self.report.packet_bytes += head.total_len as u64;
            at += head.total_len;
            self.count_number(head.number);
            frames.push(self.frame(dialect, &head, seen));
        }
        self.buffer = buffer;
        self.buffer.drain(..at);
    }

    /// Counts bytes that belong to no packet.
    fn skip(&mut self, n_bytes: usize) {
        if n_bytes > 0 {
            self.report.skipped_bytes += n_bytes as u64;
            self.count_search();
        }
    }

    fn count_search(&mut self) {
        self.report.resynchronisations += u64::from(self.is_synchronised);
        self.is_synchronised = false;
    }

    fn count_number(&mut self, number: u32) {
        if let Some(last) = self.last_number {
            match number.checked_sub(last) {
                // A repeated number is another sub-frame.
                Some(0 | 1) => {}
                Some(step) => self.report.lost_frames += u64::from(step) - 1,
                None => self.report.restarts += 1,
            }
        }
        self.last_number = Some(number);
    }

    fn frame(&mut self, dialect: Dialect, head: &Header, packet: &[u8]) -> UartFrame {
        let mut content = Content::default();
        let report = &mut self.report;
        for step in Walk::new(dialect, &packet[dialect.header_len()..], head.n_tlvs) {
            let Step::Tlv(number, payload) = step else {
                report.tlvs_wrong_length += 1;
                continue;
            };
            match Kind::of(dialect, number) {
                None => {
                    report.tlvs_unknown += 1;
                    let listed = &mut report.unknown_numbers;
                    if listed.len() < MAX_UNKNOWN_NUMBERS || listed.contains_key(&number) {
                        *listed.entry(number).or_default() += 1;
                    }
                }
                Some(Kind::Unused) => report.tlvs_unused += 1,
                Some(kind) => match kind.split(payload) {
                    None => report.tlvs_wrong_length += 1,
                    Some((units, items)) => {
                        report.tlvs += 1;
                        decode(kind, units, items, &mut content, report);
                    }
                },
            }
        }
        let points = with_snr(content.points, &content.side_info, report);
        if points.is_empty() {
            report.frames_without_points += 1;
        }
        UartFrame {
            number: head.number,
            subframe: head.subframe,
            cycles: head.cycles,
            complete: true,
            points,
            static_points: with_snr(content.static_points, &content.static_side_info, report),
            range_profile: content.range_profile,
            stats: content.stats,
            temperatures: content.temperatures,
            targets: content.targets,
            heights: content.heights,
            indices: content.indices,
            presence: content.presence,
        }
    }
}

/// Moving and static points of complete packets, with sub-frames of one number combined. Truncated packets are omitted:
/// they are lost frames, not empty ones.
pub fn recorded_frames(frames: Vec<UartFrame>) -> Vec<RecordedFrame> {
    let mut joiner = SubframeJoiner::default();
    let mut out: Vec<RecordedFrame> = frames.into_iter().filter_map(|f| joiner.push(f)).collect();
    out.extend(joiner.finish());
    out
}

/// [`recorded_frames`] for packets that arrive one by one.
#[derive(Debug, Default)]
pub struct SubframeJoiner {
    /// The frame that the next packet may still extend.
    open: Option<RecordedFrame>,
    /// Whether a packet had tracks or presence.
    reports: bool,
}

impl SubframeJoiner {
    /// Adds a packet and returns the frame that it ends: the one before, unless the packet is a sub-frame of it.
    pub fn push(&mut self, frame: UartFrame) -> Option<RecordedFrame> {
        if !frame.complete {
            return None;
        }
        let number = u64::from(frame.number);
        self.reports |= !frame.targets.is_empty() || frame.presence.is_some();
        // Firmware that tracks leaves the block out when it tracks nobody.
        let board = self.reports.then(|| BoardReport {
            tracks: frame.targets.iter().map(Target::track).collect(),
            is_present: frame.presence.map(|zones| zones != 0),
        });
        let points = frame.points.into_iter().chain(frame.static_points);
        match &mut self.open {
            Some(open) if open.number == number && frame.subframe > 0 => {
                open.points.extend(points);
                open.board = board.or(open.board.take());
                None
            }
            open => open.replace(RecordedFrame {
                number,
                stamp_s: None,
                points: points.collect(),
                board,
            }),
        }
    }

    /// Returns the last frame. It does not wait for further sub-frames.
    pub fn finish(&mut self) -> Option<RecordedFrame> {
        self.open.take()
    }
}

fn find_magic(bytes: &[u8]) -> Option<usize> {
    bytes.windows(MAGIC.len()).position(|w| w == MAGIC)
}

fn count_magics(bytes: &[u8]) -> usize {
    bytes.windows(MAGIC.len()).filter(|w| *w == MAGIC).count()
}
