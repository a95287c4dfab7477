//! Waits for the packets that show the dialect of a stream.

use std::collections::VecDeque;

use super::{
    Dialect, Evidence, GUESS_PACKETS, MAGIC, MAX_PACKET_BYTES, StreamEnd, UartError, UartFrame,
    UartParser, find_magic,
    guess::{Packet, QuietPackets, decide, decide_at_end},
};

/// Maximum number of bytes kept while the dialect is being detected.
const MAX_GUESS_BYTES: usize = 4 * MAX_PACKET_BYTES;
/// Maximum number of packets with content kept while the dialect is being detected: some seconds.
const MAX_GUESS_PACKETS: usize = 8 * GUESS_PACKETS;
/// Few packets with content decide if there are this many times as many packets: they wait for the decision.
const PACKETS_PER_CONTENT: usize = 4;
/// Maximum number of sub-frames of a frame.
const MAX_SUBFRAMES: u32 = 4;

/// State of the detection. Its steps depend on the packets alone, not on the sizes of the pieces.
#[derive(Debug, Default)]
pub(super) struct Detection {
    /// Number of magics found.
    pub n_begun: usize,
    /// The evidence, best first, if the dialect was not clear when it was last decided.
    pub unclear: Option<Vec<Evidence>>,
    /// Finished packets in the buffer, from the first one with content on.
    spans: VecDeque<Span>,
    /// Number of them with content.
    n_content: usize,
    /// Number of them at which the dialect is decided next.
    stage: usize,
    /// Start of the last packet, which is not finished.
    begun: Option<usize>,
    /// Bytes of the buffer that were searched for magics.
    searched: usize,
    /// Packets that were returned already: without content, or with one that several dialects read alike.
    quiet: QuietPackets,
}

/// A packet in the buffer.
#[derive(Clone, Copy, Debug)]
struct Span {
    start: usize,
    end: usize,
    is_followed: bool,
    has_content: bool,
}

impl Span {
    fn packet(self, buffer: &[u8]) -> Packet<'_> {
        Packet {
            bytes: &buffer[self.start..self.end],
            is_followed: self.is_followed,
        }
    }
}

impl Detection {
    /// The packets with content.
    fn packets<'a>(&self, buffer: &'a [u8]) -> Vec<Packet<'a>> {
        let with_content = self.spans.iter().filter(|span| span.has_content);
        with_content.map(|span| span.packet(buffer)).collect()
    }

    /// The next finished packet in the buffer.
    fn next_span(&mut self, buffer: &[u8], end: StreamEnd) -> Option<Span> {
        loop {
            let unseen = self.searched.saturating_sub(MAGIC.len() - 1);
            let from = self.begun.map_or(unseen, |at| unseen.max(at + MAGIC.len()));
            let next = buffer
                .get(from..)
                .and_then(find_magic)
                .map(|gap| from + gap);
            let Some(start) = self.begun else {
                self.searched = next.map_or(buffer.len(), |at| at + MAGIC.len());
                self.begun = Some(next?);
                self.n_begun += 1;
                continue;
            };
            let limit = start + MAX_PACKET_BYTES;
            let stop = match next {
                Some(next) => next.min(limit),
                None if buffer.len() >= limit + MAGIC.len() - 1 => limit,
                None if end == StreamEnd::Reached => buffer.len(),
                None => {
                    self.searched = buffer.len();
                    return None;
                }
            };
            self.begun = next;
            self.n_begun += usize::from(next.is_some());
            self.searched = next.map_or(buffer.len(), |at| at + MAGIC.len());
            return Some(Span {
                start,
                end: stop,
                is_followed: next == Some(stop),
                has_content: true,
            });
        }
    }

    /// Subtracts bytes that were removed from the start of the buffer.
    fn shift(&mut self, n_bytes: usize) {
        for span in &mut self.spans {
            span.start -= n_bytes;
            span.end -= n_bytes;
        }
        self.begun = self.begun.map(|at| at - n_bytes);
        self.searched = self.searched.saturating_sub(n_bytes);
    }
}

impl UartParser {
    /// Returns packets without content, keeps those with content and decides the dialect when there are enough of them.
    pub(super) fn detect(&mut self, end: StreamEnd, frames: &mut Vec<UartFrame>) {
        let mut buffer = std::mem::take(&mut self.buffer);
        let mut taken = 0;
        while self.dialect.is_none() {
            let Some(mut span) = self.detection.next_span(&buffer, end) else {
                break;
            };
            let packet = span.packet(&buffer);
            let quiet = packet.quiet_dialect();
            if let Some(dialect) = quiet {
                self.detection.quiet.add(packet);
                if self.detection.spans.is_empty() {
                    taken = self.take_span(dialect, span, taken, &buffer, end, frames);
                    continue;
                }
            }
            span.has_content = quiet.is_none();
            self.detection.spans.push_back(span);
            self.detection.n_content += usize::from(span.has_content);
            if end == StreamEnd::Reached && !span.is_followed {
                // The rest of the stream is decided by `decide_at_end`.
                continue;
            }
            let (n_content, n_spans) = (self.detection.n_content, self.detection.spans.len());
            let stage = self.detection.stage.max(GUESS_PACKETS);
            let is_full = span.end - taken > MAX_GUESS_BYTES;
            if n_content < stage && n_spans < PACKETS_PER_CONTENT * stage && !is_full {
                continue;
            }
            let packets = self.detection.packets(&buffer);
            match decide(&packets, false) {
                Ok(guess) => {
                    self.dialect = Some(guess.dialect);
                    self.guess = Some(guess);
                }
                Err(evidence) => {
                    // Packets that tied dialects read alike need not wait for those that they read differently.
                    let alike = decide(&packets, true).ok().map(|guess| guess.dialect);
                    if let Some(dialect) = alike {
                        taken =
                            self.give_out(n_content, Some(dialect), taken, &buffer, end, frames);
                        self.detection.stage = GUESS_PACKETS;
                        continue;
                    }
                    self.detection.unclear = Some(evidence);
                    self.detection.stage = (2 * stage).min(MAX_GUESS_PACKETS);
                    if is_full || stage >= MAX_GUESS_PACKETS {
                        let n = n_content.div_ceil(2);
                        taken = self.give_out(n, None, taken, &buffer, end, frames);
                    }
                }
            }
        }
        if self.dialect.is_none() && self.detection.spans.is_empty() {
            // Nothing is needed but the packet that has begun, or the start of a magic.
            let kept = (self.detection.begun)
                .unwrap_or(buffer.len().saturating_sub(MAGIC.len() - 1).max(taken));
            self.skip(kept - taken);
            taken = kept;
        }
        buffer.drain(..taken);
        self.buffer = buffer;
        self.searched = 0;
        match self.dialect {
            None => self.detection.shift(taken),
            Some(_) => self.detection.spans = VecDeque::new(),
        }
    }

    /// Reads a packet as one of a dialect and skips the bytes before and behind it. Returns where the next bytes begin.
    fn take_span(
        &mut self,
        dialect: Dialect,
        span: Span,
        taken: usize,
        buffer: &[u8],
        end: StreamEnd,
        frames: &mut Vec<UartFrame>,
    ) -> usize {
        self.skip(span.start - taken);
        self.searched = 0;
        let n_own = span.end - span.start;
        if span.is_followed && n_own < dialect.header_len() {
            // Its header ends in the next packet, of which not all may be there yet.
            self.report.bad_headers += 1;
            self.skip(n_own);
            return span.end;
        }
        let n_frames = frames.len();
        let Some(n_bytes) = self.take_packet(dialect, &buffer[span.start..], end, frames) else {
            // Bytes are missing at the end of the stream.
            return span.start;
        };
        for frame in &mut frames[n_frames..] {
            // In another dialect it may be a byte of padding.
            if frame.subframe >= MAX_SUBFRAMES {
                frame.subframe = 0;
            }
        }
        let next = (span.start + n_bytes).max(span.end);
        self.skip(next - span.start - n_bytes);
        next
    }

    /// Removes the first `n` packets with content, and those without content before and behind them. They are read as
    /// packets of a dialect, or skipped without one.
    fn give_out(
        &mut self,
        n: usize,
        dialect: Option<Dialect>,
        mut taken: usize,
        buffer: &[u8],
        end: StreamEnd,
        frames: &mut Vec<UartFrame>,
    ) -> usize {
        let n_left = self.detection.n_content - n;
        while let Some(span) = self.detection.spans.front().copied() {
            if span.has_content && self.detection.n_content == n_left {
                break;
            }
            self.detection.spans.pop_front();
            let packet = span.packet(buffer);
            let dialect = match span.has_content {
                true => dialect,
                false => packet.quiet_dialect(),
            };
            if span.has_content {
                self.detection.n_content -= 1;
                match dialect {
                    Some(_) => self.detection.quiet.add(packet),
                    None => self.report.unclear_packets += 1,
                }
            }
            taken = match dialect {
                Some(dialect) => self.take_span(dialect, span, taken, buffer, end, frames),
                None => {
                    self.skip(span.end - taken);
                    span.end
                }
            };
        }
        taken
    }

    /// Decides the dialect of a stream that has ended.
    ///
    /// # Errors
    /// If it is not clear, or there is no packet.
    pub(super) fn decide_at_end(&mut self) -> Result<(), UartError> {
        let packets = self.detection.packets(&self.buffer);
        let guess =
            decide_at_end(&packets, &self.detection.quiet).map_err(|evidence| {
                match self.detection.n_begun {
                    0 => UartError::NoPacket(self.report.bytes as usize),
                    _ => UartError::Unclear(evidence),
                }
            })?;
        self.dialect = Some(guess.dialect);
        self.guess = Some(guess);
        Ok(())
    }
}
