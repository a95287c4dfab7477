//! The UART output of TI's demos: parses a byte stream into frames.
//!
//! Packets start with [`MAGIC`], followed by a header and TLVs (type, length, value) that differ between firmware
//! versions: see [`Dialect`]. [`UartParser`] accepts bytes in pieces of any size. It detects the dialect from several
//! packets unless it is given ([`mod@guess`]), resynchronises on the next magic after damage, and counts all dropped
//! data in a [`UartReport`].
//!
//! A serial line loses bytes. A packet that is shorter than its header states is used if it lacks only padding, or if
//! its points end before the loss; then the TLVs after the loss are dropped. A payload whose values are impossible, or
//! that has not as many points as the header counts, is not believed.
//!
//! Points are in the axes of the sensor with the project's orientation: x right, y away, z up, m; the velocity is
//! positive when receding. Whether a given board mirrors x is unknown: see "Handedness of boards" in CONVENTIONS.md.
//! `intensity_db` is the SNR of the firmware in dB: from the side information (type 7, in 0.1 dB), from type 301, or 10
//! log10 of the linear SNR of the people counting labs. If the firmware sends no SNR, the intensity is 0 and the point
//! is counted in the report. The intensity is not an absolute power.

mod detection;
pub mod dialect;
pub mod guess;
mod packet;
mod tlv;

use std::{collections::BTreeMap, fmt::Write as _, sync::LazyLock};

use memchr::memmem::Finder;
use radarllm_base::{BoardReport, RadarPoint, RecordedFrame};

use detection::Detection;
pub use dialect::Dialect;
pub use guess::{Evidence, GUESS_PACKETS, Guess};
use packet::{BadHeader, Header, PADDING, Step, Walk, header};
use tlv::{Content, Kind, decode, tlv_name, with_snr};
pub use tlv::{Stats, Target, TargetHeight, Temperatures};

/// First bytes of every packet.
pub const MAGIC: [u8; 8] = [2, 1, 4, 3, 6, 5, 8, 7];
/// Maximum length of a packet, bytes: a 256 x 128 heat map of 16 bits is 64 KiB.
pub const MAX_PACKET_BYTES: usize = 256 << 10;
/// Maximum number of TLVs in a packet.
pub const MAX_TLVS: usize = 64;
/// Maximum number of TLV types that are counted individually.
const MAX_LISTED_NUMBERS: usize = 32;
/// Largest step between two frame numbers that needs no confirmation: 5 s at 10 frames/s.
const NEAR_NUMBERS: u32 = 50;
/// Largest type that is taken for one. Bytes of a payload that are read as a type are nearly always larger.
const MAX_TLV_NUMBER: u32 = 16_384;

/// One packet.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct UartFrame {
    /// Frame number of the firmware.
    pub number: u32,
    /// Sub-frame; 0 for most configurations.
    pub subframe: u32,
    /// CPU clock of the chip, cycles modulo 2^32, if the dialect reports it.
    pub cycles: Option<u32>,
    /// False if bytes of this packet were lost, or its points are not as many as the header counts, so that the points
    /// are not certain. In that case, only the header is used.
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
    /// Zones in which the low-power demo detects somebody, one bit each (type 315). It does so without tracking.
    pub occupied_zones: Option<u32>,
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
    /// Those among them that are used: only padding or what follows the points is missing.
    pub short_packets_used: u64,
    /// Packets that were skipped because their dialect was not clear.
    pub unclear_packets: u64,
    /// Magics followed by an impossible header.
    pub bad_headers: u64,
    /// Magics with a header whose checksum is wrong.
    pub bad_checksums: u64,
    /// TLVs used.
    pub tlvs: u64,
    /// TLVs of known types whose content is not used (heat maps).
    pub tlvs_unused: u64,
    /// The first 32 types among them, with their counts.
    pub unused_numbers: BTreeMap<u32, u64>,
    /// TLVs whose type the dialect does not know.
    pub tlvs_unknown: u64,
    /// The first 32 types among them, with their counts.
    pub unknown_numbers: BTreeMap<u32, u64>,
    /// TLVs whose length does not match their type or exceeds the packet.
    pub tlvs_wrong_length: u64,
    /// TLVs not used because more than half of their values are impossible.
    pub tlvs_impossible: u64,
    /// TLVs not used because bytes before their end were lost.
    pub tlvs_uncertain: u64,
    /// Objects according to the headers of complete packets, for dialects that count them.
    pub header_objects: u64,
    /// Packets among them with objects.
    pub packets_with_objects: u64,
    /// Packets whose points were dropped because the header counts another number of them, although it agreed before.
    pub count_mismatches: u64,
    /// Packets whose header has always counted another number of objects than there are points.
    pub counts_never_right: u64,
    /// Points kept.
    pub points: u64,
    /// Points dropped because of NaN or infinity.
    pub points_not_finite: u64,
    /// Points dropped because they are farther than 300 m or faster than 60 m/s, or have another impossible value.
    pub points_out_of_range: u64,
    /// Points kept without SNR: intensity 0 dB.
    pub points_without_snr: u64,
    /// Points kept whose velocity is a number of Doppler bins: see [`UartParser::with_doppler_step`].
    pub points_of_doppler_bins: u64,
    /// Side information that does not have one entry per point, and was not used.
    pub side_info_mismatches: u64,
    /// Targets and heights dropped for the same reasons as points.
    pub targets_dropped: u64,
    /// Complete packets without points.
    pub frames_without_points: u64,
    /// Frame numbers that are missing between packets that are used.
    pub lost_frames: u64,
    /// Decreases of the frame number: the device was restarted.
    pub restarts: u64,
}

impl UartReport {
    /// Why there are no points, if this does not mean that the scene was empty: the firmware detected objects, or the
    /// TLVs were misread. `None` if there are points, or nothing speaks against an empty scene.
    pub fn no_points_because(&self) -> Option<String> {
        // Single headers may be damaged.
        let has_objects = 100 * self.packets_with_objects > self.packets;
        if self.points > 0 || !(has_objects || self.is_misread()) {
            return None;
        }
        let mut text = format!("no point could be read from {} packets", self.packets);
        let _ = match self.header_objects {
            0 => Ok(()),
            n => write!(text, ", although their headers count {n} objects"),
        };
        let found = [
            ("unknown TLVs", self.unknown_tlvs()),
            ("TLVs that are known and not used", self.unused_tlvs()),
        ];
        for (what, numbers) in found {
            let _ = numbers.map_or(Ok(()), |numbers| write!(text, "; {what}: {numbers}"));
        }
        let counts = [
            (self.tlvs_wrong_length, "of wrong length"),
            (self.tlvs_impossible, "with impossible values"),
        ];
        for (n, what) in counts.into_iter().filter(|(n, _)| *n > 0) {
            let _ = write!(text, "; {n} TLVs {what}");
        }
        Some(text)
    }

    /// Whether more TLVs have a wrong length or impossible values than are used, and not by single damages: the dialect is
    /// another one.
    pub fn is_misread(&self) -> bool {
        let n_bad = self.tlvs_wrong_length + self.tlvs_impossible;
        n_bad > self.tlvs && 10 * n_bad > self.packets
    }

    /// The unknown TLV types with their counts; `None` if there are none.
    pub fn unknown_tlvs(&self) -> Option<String> {
        numbers(&self.unknown_numbers)
    }

    /// The TLV types that are known and not used, with their names and counts; `None` if there are none.
    pub fn unused_tlvs(&self) -> Option<String> {
        numbers(&self.unused_numbers)
    }
}

/// Types with names and counts, as `1040 (vital signs, 60 times)`.
fn numbers(counts: &BTreeMap<u32, u64>) -> Option<String> {
    let parts = counts.iter().map(|(number, n)| match tlv_name(*number) {
        Some(name) => format!("{number} ({name}, {n} times)"),
        None => format!("{number} ({n} times)"),
    });
    let parts: Vec<String> = parts.collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

fn count_number(counts: &mut BTreeMap<u32, u64>, number: u32) {
    if counts.len() < MAX_LISTED_NUMBERS || counts.contains_key(&number) {
        *counts.entry(number).or_default() += 1;
    }
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
    doppler_step_mps: f32,
    buffer: Vec<u8>,
    /// Bytes at the start of the buffer that contain no magic but the first one.
    searched: usize,
    detection: Detection,
    /// What was read of a packet; its memory is used again.
    content: Content,
    last_number: Option<u32>,
    /// A number that the next one confirms or not.
    doubtful_number: Option<u32>,
    /// Bytes that the last packet lacked.
    last_missing: Option<usize>,
    /// Packets with as many points as the header counts, and with another number.
    count_agreements: u64,
    count_differences: u64,
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
            doppler_step_mps: 0.0,
            buffer: Vec::new(),
            searched: 0,
            detection: Detection::default(),
            content: Content::default(),
            last_number: None,
            doubtful_number: None,
            last_missing: None,
            count_agreements: 0,
            count_differences: 0,
            is_synchronised: false,
            report: UartReport::default(),
        }
    }

    /// The velocity of a Doppler bin, m/s, for dialects that send bins
    /// ([`Dialect::has_doppler_bins`]). Without it, their points have a velocity of 0.
    #[must_use]
    pub fn with_doppler_step(self, doppler_step_mps: f32) -> Self {
        Self {
            doppler_step_mps,
            ..self
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
        self.detection.n_begun
    }

    /// Returns how the dialect was detected, if it was not given.
    pub fn guess(&self) -> Option<&Guess> {
        self.guess.as_ref()
    }

    /// Why the dialect is not known yet, if several packets with content did not show it.
    pub fn unclear(&self) -> Option<UartError> {
        let evidence = self.detection.unclear.as_ref()?;
        (self.dialect.is_none()).then(|| UartError::Unclear(evidence.clone()))
    }

    /// Parses the next bytes and returns the packets that they complete. While the dialect is not known, packets of an
    /// empty room are returned, and packets with content are kept: 1 MiB of them, later ones push out the earlier ones.
    ///
    /// # Errors
    /// None at present: what does not show its dialect is an error of [`Self::finish`].
    pub fn push(&mut self, bytes: &[u8]) -> Result<Vec<UartFrame>, UartError> {
        self.report.bytes += bytes.len() as u64;
        let mut frames = Vec::new();
        // The bytes are processed in pieces, so that the buffer remains small regardless of their number.
        for piece in bytes.chunks(MAX_PACKET_BYTES) {
            self.buffer.extend_from_slice(piece);
            if self.dialect.is_none() {
                self.detect(StreamEnd::Open, &mut frames);
            }
            self.drain(StreamEnd::Open, &mut frames);
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
            self.detect(StreamEnd::Reached, &mut frames);
            if self.dialect.is_none() {
                self.decide_at_end()?;
            }
        }
        self.drain(StreamEnd::Reached, &mut frames);
        if let Some(number) = self.doubtful_number.take() {
            self.accept_number(number);
        }
        self.report.trailing_bytes = self.buffer.len() as u64;
        Ok((frames, self.report, self.guess))
    }

    /// Takes all finished packets out of the buffer.
    fn drain(&mut self, end: StreamEnd, frames: &mut Vec<UartFrame>) {
        let Some(dialect) = self.dialect else {
            return;
        };
        let mut buffer = std::mem::take(&mut self.buffer);
        let mut at = 0;
        loop {
            let rest = &buffer[at..];
            if !rest.starts_with(&MAGIC) {
                let found = find_magic(rest);
                // The last 7 bytes may be the start of a magic.
                let gap = found.unwrap_or(rest.len().saturating_sub(MAGIC.len() - 1));
                self.skip(gap);
                at += gap;
                if found.is_none() {
                    break;
                }
                continue;
            }
            let Some(taken) = self.take_packet(dialect, rest, end, frames) else {
                break;
            };
            at += taken;
        }
        buffer.drain(..at);
        self.buffer = buffer;
    }

    /// Reads the packet at the start of `rest`, which begins with a magic, and returns its number of bytes; `None` if
    /// more bytes are needed.
    fn take_packet(
        &mut self,
        dialect: Dialect,
        rest: &[u8],
        end: StreamEnd,
        frames: &mut Vec<UartFrame>,
    ) -> Option<usize> {
        let head = match header(dialect, rest)? {
            Ok(head) => head,
            Err(why) => {
                match why {
                    BadHeader::Implausible => self.report.bad_headers += 1,
                    BadHeader::Checksum => self.report.bad_checksums += 1,
                }
                self.searched = 0;
                self.skip(MAGIC.len());
                return Some(MAGIC.len());
            }
        };
        // A magic that begins within this packet may end up to 7 bytes behind it.
        let from = self
            .searched
            .saturating_sub(MAGIC.len() - 1)
            .max(MAGIC.len());
        let window = &rest[..rest.len().min(head.total_len + MAGIC.len() - 1)];
        let next = window.get(from..).and_then(find_magic).map(|at| from + at);
        let is_open = end == StreamEnd::Open;
        let is_waiting = next.is_none()
            && (rest.len() < head.total_len || is_open && ends_in_magic(window, head.total_len));
        if is_waiting && is_open {
            self.searched = window.len();
            return None;
        }
        let packet = match next {
            Some(next) => &rest[..next],
            None => &rest[..rest.len().min(head.total_len)],
        };
        if packet.len() < dialect.header_len() {
            // The header itself is truncated: its end was read from the start of the next packet.
            self.report.bad_headers += 1;
            self.searched = 0;
            self.skip(packet.len());
            return Some(packet.len());
        }
        let is_short = packet.len() < head.total_len;
        let certain = self.certain_tlvs(dialect, &head, packet, next.is_some());
        if is_short && next.is_none() && certain != CertainTlvs::All {
            // The end of the data, not a loss.
            return None;
        }
        self.searched = 0;
        let frame = self.frame(dialect, &head, packet, certain);
        self.report.packet_bytes += packet.len() as u64;
        self.last_missing = Some(head.total_len - packet.len());
        match is_short {
            true => {
                self.report.short_packets += 1;
                self.report.short_packets_used += u64::from(frame.complete);
            }
            false => self.report.packets += 1,
        }
        match frame.complete {
            true => {
                self.is_synchronised = true;
                self.count_number(head.number);
            }
            // Its number may be damaged, too.
            false => self.count_search(),
        }
        frames.push(frame);
        Some(packet.len())
    }

    /// The TLVs of a packet that can be believed. `is_followed` says that the next packet begins where the bytes of this
    /// one end.
    fn certain_tlvs(
        &self,
        dialect: Dialect,
        head: &Header,
        packet: &[u8],
        is_followed: bool,
    ) -> CertainTlvs {
        let missing = head.total_len - packet.len();
        let mut walk = Walk::new(dialect, head, packet);
        let mut last_payload: &[u8] = &[];
        // TLVs from the first one on whose types and lengths are possible.
        let (mut n_aligned, mut is_aligned, mut is_whole) = (0, true, true);
        for step in walk.by_ref() {
            let is_possible = match step {
                Step::Tlv(number, payload) => {
                    last_payload = payload;
                    match Kind::of(dialect, number) {
                        Some(kind) => kind.split(payload).is_some(),
                        None => number <= MAX_TLV_NUMBER,
                    }
                }
                Step::Beyond { number, is_cut } => {
                    is_whole = false;
                    is_cut && number.is_some_and(|n| Kind::of(dialect, n).is_some())
                }
            };
            is_aligned &= is_possible;
            n_aligned += usize::from(is_aligned);
        }
        let ends_with_packet = walk.stated_rest() < PADDING;
        let is_certain = if head.n_tlvs == 0 || missing == 0 && !is_whole {
            // A header that counts no TLVs before a long content is damaged. One that counts more than there are is usual.
            ends_with_packet
        } else if missing == 0 || !is_followed {
            is_whole
        } else {
            // Only padding is missing, or bytes of the last payload, which then ends with padding. What every packet
            // lacks is padding.
            let padding = walk.rest();
            let lost = &last_payload[last_payload.len().saturating_sub(missing)..];
            let ends_in_padding = padding
                .first()
                .is_none_or(|first| padding.iter().chain(lost).all(|b| b == first));
            let is_usual = self.last_missing.is_none_or(|usual| usual == missing);
            is_whole && ends_with_packet && is_aligned && (is_usual || !ends_in_padding)
        };
        match is_certain {
            true => CertainTlvs::All,
            // A TLV is certain if the next one begins where it should.
            false => CertainTlvs::First(n_aligned.saturating_sub(1)),
        }
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

    /// Counts lost frames and restarts. A number that is far from the last one is counted when the next number confirms it;
    /// if that follows the last one instead, the number in between was damaged.
    fn count_number(&mut self, number: u32) {
        let step_from = |last: Option<u32>| last.and_then(|last| number.checked_sub(last));
        if let Some(doubtful) = self.doubtful_number.take() {
            let follows_last = step_from(self.last_number).is_some_and(|step| step <= NEAR_NUMBERS);
            if follows_last {
                // The damaged frame is there, so that it is not one of those between.
                let step = step_from(self.last_number).unwrap_or_default();
                self.report.lost_frames += u64::from(step.saturating_sub(2));
                self.last_number = Some(number);
                return;
            }
            self.accept_number(doubtful);
        }
        let is_near = step_from(self.last_number).is_some_and(|step| step <= NEAR_NUMBERS);
        match self.last_number.is_none() || is_near {
            true => self.accept_number(number),
            false => self.doubtful_number = Some(number),
        }
    }

    fn accept_number(&mut self, number: u32) {
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

    /// Reads the TLVs of a packet that are certain.
    fn frame(
        &mut self,
        dialect: Dialect,
        head: &Header,
        packet: &[u8],
        certain: CertainTlvs,
    ) -> UartFrame {
        let mut content = std::mem::take(&mut self.content);
        content.clear();
        let mut n_bins = 0;
        let report = &mut self.report;
        let is_short = packet.len() < head.total_len;
        for (i, step) in Walk::new(dialect, head, packet).enumerate() {
            let Step::Tlv(number, payload) = step else {
                match is_short {
                    true => report.tlvs_uncertain += 1,
                    false => report.tlvs_wrong_length += 1,
                }
                continue;
            };
            if matches!(certain, CertainTlvs::First(n) if i >= n) {
                report.tlvs_uncertain += 1;
                continue;
            }
            let Some(kind) = Kind::of(dialect, number) else {
                report.tlvs_unknown += 1;
                count_number(&mut report.unknown_numbers, number);
                continue;
            };
            if kind == Kind::Unused {
                report.tlvs_unused += 1;
                count_number(&mut report.unused_numbers, number);
                continue;
            }
            let Some((units, items)) = kind.split(payload) else {
                report.tlvs_wrong_length += 1;
                continue;
            };
            let belief = decode(
                kind,
                units,
                items,
                self.doppler_step_mps,
                &mut content,
                report,
            );
            match belief.is_believed() {
                true => report.tlvs += 1,
                false => report.tlvs_impossible += 1,
            }
            if kind == Kind::DetectedObjects && belief.is_believed() {
                n_bins += belief.items - belief.impossible;
            }
        }
        // Of a packet that lost bytes, points are used if their SNR came before the loss.
        let is_certain =
            certain == CertainTlvs::All || !content.points.is_empty() && content.has_snr();
        let is_complete = is_certain && self.agrees_with_count(head, &content);
        let mut frame = UartFrame {
            number: head.number,
            subframe: head.subframe,
            cycles: head.cycles,
            complete: is_complete,
            ..UartFrame::default()
        };
        if is_complete {
            let report = &mut self.report;
            if !content.points.is_empty() {
                report.points_of_doppler_bins += n_bins as u64;
            }
            frame.points = with_snr(&content.points, &content.side_info, report);
            if frame.points.is_empty() {
                report.frames_without_points += 1;
            }
            frame.static_points =
                with_snr(&content.static_points, &content.static_side_info, report);
            frame.range_profile = std::mem::take(&mut content.range_profile);
            frame.stats = content.stats;
            frame.temperatures = content.temperatures;
            frame.targets = std::mem::take(&mut content.targets);
            frame.heights = std::mem::take(&mut content.heights);
            frame.indices = std::mem::take(&mut content.indices);
            frame.presence = content.presence;
            frame.occupied_zones = content.occupied_zones;
        }
        self.content = content;
        frame
    }

    /// Whether there are as many points as the header counts. Firmware that has counted something else up to now is not
    /// held to it.
    fn agrees_with_count(&mut self, head: &Header, content: &Content) -> bool {
        let n_objects = u64::from(head.n_objects.unwrap_or(0));
        self.report.header_objects += n_objects;
        self.report.packets_with_objects += u64::from(n_objects > 0);
        if n_objects == 0 || content.points.is_empty() {
            return true;
        }
        if content.agrees_with(head) {
            self.count_agreements += 1;
            return true;
        }
        self.count_differences += 1;
        let is_damage = self.count_agreements >= self.count_differences;
        match is_damage {
            true => self.report.count_mismatches += 1,
            false => self.report.counts_never_right += 1,
        }
        !is_damage
    }
}

/// The TLVs of a packet before whose end no byte was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CertainTlvs {
    All,
    /// As many from the first one on.
    First(usize),
}

/// Whether more bytes of a stream may follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StreamEnd {
    Open,
    Reached,
}

/// Whether a magic may begin among the last 7 bytes, before `limit`.
fn ends_in_magic(bytes: &[u8], limit: usize) -> bool {
    (1..MAGIC.len()).any(|n| {
        bytes.len() >= MAGIC.len() + n && bytes.len() - n < limit && bytes.ends_with(&MAGIC[..n])
    })
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
        let mut points = frame.points;
        points.extend(frame.static_points);
        match &mut self.open {
            Some(open) if open.number == number && frame.subframe > 0 => {
                open.points.extend(points);
                open.board = board.or(open.board.take());
                None
            }
            open => open.replace(RecordedFrame {
                number,
                stamp_s: None,
                points,
                board,
            }),
        }
    }

    /// Returns the last frame. It does not wait for further sub-frames.
    pub fn finish(&mut self) -> Option<RecordedFrame> {
        self.open.take()
    }
}

/// Place of the first magic.
fn find_magic(bytes: &[u8]) -> Option<usize> {
    // To prepare the search takes about as long as to search a small packet.
    static FINDER: LazyLock<Finder> = LazyLock::new(|| Finder::new(&MAGIC));
    FINDER.find(bytes)
}
