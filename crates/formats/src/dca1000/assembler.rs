//! Assembles packets into frames. A packet's byte count determines where its bytes belong, not the order of arrival.
//!
//! Memory is limited to one frame and the reordering window, whatever values the counters have: a packet beyond the
//! window is accepted only after a second consistent packet, and frames without any packet are counted but not
//! produced.

use std::collections::{BTreeMap, VecDeque};

use super::{DataPacket, MAX_PAYLOAD};
use crate::adc::{AdcError, FrameIntegrity, layout::MAX_FRAME_BYTES};

/// Size of the window within which packets are reordered, packets.
const WINDOW_PACKETS: usize = 64;

/// A frame as far as it was received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssembledFrame {
    /// Missing data.
    pub integrity: FrameIntegrity,
    /// The frame; missing bytes are zero.
    pub bytes: Vec<u8>,
}

/// Statistics of a transfer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TransferSummary {
    /// Packets passed to the assembler.
    pub packets: u64,
    /// Lowest packet number used. If it exceeds 1, the recording began after the start of the transfer.
    pub first_sequence: Option<u32>,
    /// Highest packet number used.
    pub last_sequence: Option<u32>,
    /// Numbers between the two that never arrived.
    pub lost: u64,
    /// Packets that arrived after one with a higher number.
    pub out_of_order: u64,
    /// Packets whose bytes had all arrived before.
    pub duplicates: u64,
    /// Packets of a frame that was already returned: they are late, or belong to another recording.
    pub late: u64,
    /// Packets far ahead of all others that no second packet confirmed.
    pub refused: u64,
    /// Number of frames returned.
    pub frames: u64,
    /// Number of these frames with missing bytes.
    pub damaged_frames: u64,
    /// Number of frames between the first and the last of which no byte arrived.
    pub lost_frames: u64,
    /// Number of bytes after the last complete frame.
    pub trailing_bytes: usize,
}

/// A packet that waits for another one to confirm it.
struct Waiting {
    sequence: u32,
    byte_count: u64,
    payload: Vec<u8>,
}

impl Waiting {
    fn packet(&self) -> DataPacket<'_> {
        DataPacket {
            sequence: self.sequence,
            byte_count: self.byte_count,
            payload: &self.payload,
        }
    }

    /// Whether the counters of both packets can belong to one transfer, in which only the last packet is shorter than
    /// the others.
    fn fits(&self, other: &DataPacket) -> bool {
        let steps = i64::from(other.sequence) - i64::from(self.sequence);
        let bytes = other.byte_count as i64 - self.byte_count as i64;
        let step_bytes = self.payload.len().max(other.payload.len()) as i64;
        steps != 0 && steps.unsigned_abs() <= WINDOW_PACKETS as u64 && bytes == steps * step_bytes
    }
}

/// Packet counts of a frame that is still open.
#[derive(Default)]
struct Counts {
    packets: u32,
    out_of_order: u32,
    duplicates: u32,
}

/// Places packets into frames.
pub struct Assembler {
    frame_bytes: usize,
    window_bytes: usize,
    /// Byte count of the first byte of the oldest open frame; `None` before the first confirmed packet.
    base: Option<u64>,
    /// Bytes from `base` on, and whether they arrived.
    data: VecDeque<u8>,
    arrived: VecDeque<bool>,
    counts: BTreeMap<u64, Counts>,
    waiting: Option<Waiting>,
    /// Number of packets with new data.
    used: u64,
    summary: TransferSummary,
}

impl Assembler {
    /// For frames of `frame_bytes`.
    ///
    /// # Errors
    /// [`AdcError::Layout`] if the frame is empty or too large.
    pub fn new(frame_bytes: usize) -> Result<Self, AdcError> {
        if !(1..=MAX_FRAME_BYTES).contains(&frame_bytes) {
            return Err(AdcError::Layout(format!(
                "a frame must have 1 to {MAX_FRAME_BYTES} bytes, not {frame_bytes}"
            )));
        }
        Ok(Self {
            frame_bytes,
            window_bytes: WINDOW_PACKETS * MAX_PAYLOAD,
            base: None,
            data: VecDeque::new(),
            arrived: VecDeque::new(),
            counts: BTreeMap::new(),
            waiting: None,
            used: 0,
            summary: TransferSummary::default(),
        })
    }

    /// Statistics up to now; complete after [`Self::finish`].
    pub fn summary(&self) -> &TransferSummary {
        &self.summary
    }

    /// Adds a packet and returns the frames that cannot receive further data.
    pub fn push(&mut self, packet: &DataPacket) -> Vec<AssembledFrame> {
        self.summary.packets += 1;
        let mut frames = Vec::new();
        if packet.byte_count >= 1 << 48 || packet.payload.len() > MAX_PAYLOAD {
            self.summary.refused += 1;
            return frames;
        }
        let is_jump = match self.base {
            None => true,
            Some(base) => packet.byte_count > base + (self.data.len() + self.window_bytes) as u64,
        };
        if !is_jump {
            self.place(packet);
            self.close_passed(&mut frames);
            return frames;
        }
        match self.waiting.take() {
            Some(first) if first.fits(packet) => {
                let start = first.byte_count.min(packet.byte_count);
                self.move_to(start, &mut frames);
                for packet in [&first.packet(), packet] {
                    self.place(packet);
                }
                self.close_passed(&mut frames);
            }
            other => {
                self.summary.refused += u64::from(other.is_some());
                self.waiting = Some(Waiting {
                    sequence: packet.sequence,
                    byte_count: packet.byte_count,
                    payload: packet.payload.to_vec(),
                });
            }
        }
        frames
    }

    /// Returns the oldest open frames of which every byte has arrived, without waiting for the packets after them. A
    /// second copy of one of their packets is then counted as late.
    pub fn take_complete(&mut self) -> Vec<AssembledFrame> {
        let mut frames = Vec::new();
        while self.data.len() >= self.frame_bytes
            && self.arrived.range(..self.frame_bytes).all(|a| *a)
        {
            self.close_oldest(&mut frames);
        }
        frames
    }

    /// Ends the transfer and returns the frames that are complete or that later packets have passed. The bytes of an
    /// incomplete last frame are counted in [`TransferSummary::trailing_bytes`].
    pub fn finish(&mut self) -> Vec<AssembledFrame> {
        let mut frames = Vec::new();
        if let Some(last) = self.waiting.take() {
            if self.base.is_none() {
                self.move_to(last.byte_count, &mut frames);
                self.place(&last.packet());
            } else {
                self.summary.refused += 1;
            }
        }
        while self.data.len() >= self.frame_bytes {
            self.close_oldest(&mut frames);
        }
        self.summary.trailing_bytes = self.arrived.iter().filter(|a| **a).count();
        self.data.clear();
        self.arrived.clear();
        frames
    }

    /// Makes the frame that contains byte `count` the oldest open one.
    fn move_to(&mut self, count: u64, frames: &mut Vec<AssembledFrame>) {
        let frame_bytes = self.frame_bytes as u64;
        let start = count - count % frame_bytes;
        if let Some(base) = self.base {
            let mut skipped = start.saturating_sub(base) / frame_bytes;
            while !self.data.is_empty() && skipped > 0 {
                self.close_oldest(frames);
                skipped -= 1;
            }
            self.summary.lost_frames += skipped;
        }
        self.base = Some(start);
    }

    fn place(&mut self, packet: &DataPacket) {
        let Some(base) = self.base else { return };
        let end = packet.byte_count + packet.payload.len() as u64;
        if end <= base {
            self.summary.late += 1;
            return;
        }
        // The first bytes may belong to a frame that was already returned.
        let gone = base.saturating_sub(packet.byte_count) as usize;
        let payload = &packet.payload[gone..];
        let start = (packet.byte_count + gone as u64 - base) as usize;
        let stop = start + payload.len();
        if self.data.len() < stop {
            self.data.resize(stop, 0);
            self.arrived.resize(stop, false);
        }
        let mut is_new = false;
        for ((byte, arrived), new) in self
            .data
            .range_mut(start..stop)
            .zip(self.arrived.range_mut(start..stop))
            .zip(payload)
        {
            // The first copy is kept: a second copy can only be identical or forged.
            if !*arrived {
                (*byte, *arrived) = (*new, true);
                is_new = true;
            }
        }
        let frame = (base + start as u64) / self.frame_bytes as u64;
        let counts = self.counts.entry(frame).or_default();
        counts.packets += 1;
        if !is_new {
            counts.duplicates += 1;
            self.summary.duplicates += 1;
            return;
        }
        self.used += 1;
        let sequence = packet.sequence;
        if self.summary.last_sequence.is_some_and(|s| sequence < s) {
            counts.out_of_order += 1;
            self.summary.out_of_order += 1;
        }
        let first = self
            .summary
            .first_sequence
            .map_or(sequence, |s| s.min(sequence));
        let last = self
            .summary
            .last_sequence
            .map_or(sequence, |s| s.max(sequence));
        self.summary.first_sequence = Some(first);
        self.summary.last_sequence = Some(last);
        self.summary.lost = (u64::from(last - first) + 1).saturating_sub(self.used);
    }

    fn close_passed(&mut self, frames: &mut Vec<AssembledFrame>) {
        while self.data.len() >= self.frame_bytes + self.window_bytes {
            self.close_oldest(frames);
        }
    }

    fn close_oldest(&mut self, frames: &mut Vec<AssembledFrame>) {
        let Some(base) = self.base else { return };
        let n = self.frame_bytes.min(self.data.len());
        let mut bytes: Vec<u8> = self.data.drain(..n).collect();
        bytes.resize(self.frame_bytes, 0);
        let mut missing: Vec<std::ops::Range<usize>> = Vec::new();
        let mut gap_start = None;
        for (i, arrived) in self.arrived.drain(..n).enumerate() {
            match (arrived, gap_start) {
                (false, None) => gap_start = Some(i),
                (true, Some(start)) => {
                    missing.push(start..i);
                    gap_start = None;
                }
                _ => {}
            }
        }
        if gap_start.is_some() || n < self.frame_bytes {
            missing.push(gap_start.unwrap_or(n)..self.frame_bytes);
        }
        let frame = base / self.frame_bytes as u64;
        let counts = self.counts.remove(&frame).unwrap_or_default();
        self.base = Some(base + self.frame_bytes as u64);
        if missing
            .first()
            .is_some_and(|gap| gap.len() == self.frame_bytes)
        {
            self.summary.lost_frames += 1;
            return;
        }
        self.summary.frames += 1;
        self.summary.damaged_frames += u64::from(!missing.is_empty());
        frames.push(AssembledFrame {
            integrity: FrameIntegrity {
                frame,
                frame_bytes: self.frame_bytes,
                missing,
                packets: counts.packets,
                out_of_order: counts.out_of_order,
                duplicates: counts.duplicates,
            },
            bytes,
        });
    }
}
