//! `*_Raw_LogFile.csv`: the statistics that the recorder of the DCA1000 writes about its own recording.
//!
//! The file consists of a few lines of settings as `Name : value`, followed by lines of `Name - number`, in blocks
//! headed by the kind of data (`Raw Data :`, `ADC Header Data :`). Names are those that TI's recorder prints; other
//! lines are ignored. A recorder that was killed leaves an empty file. Then the counts are unknown, which differs from
//! zero. In the samples, zero-filled bytes cannot be distinguished from silence; the counts in this file are their only
//! trace.

/// Maximum length of a line, in bytes.
const MAX_LINE: usize = 1024;
/// Blocks of one file; the recorder has five kinds.
const MAX_BLOCKS: usize = 16;

/// Content of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordLog {
    /// Number of LVDS lanes in the settings.
    pub lanes: Option<u32>,
    /// Counts, block by block.
    pub blocks: Vec<RecordCounts>,
}

/// Counts of one kind of data; `None` where the log has no such line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordCounts {
    /// Kind of data, as written.
    pub name: String,
    /// Packets out of sequence.
    pub out_of_sequence: Option<u64>,
    /// Number of the first packet.
    pub first_packet: Option<u64>,
    /// Number of the last packet.
    pub last_packet: Option<u64>,
    /// Packets received.
    pub received: Option<u64>,
    /// Packets that were lost and replaced by zeros.
    pub zero_filled_packets: Option<u64>,
    /// Number of bytes of these packets.
    pub zero_filled_bytes: Option<u64>,
    /// Length of the recording, s.
    pub duration_s: Option<u64>,
}

/// A line with a known count that lacks a readable number.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {name} must be a whole number")]
pub struct RecordLogError {
    /// Line, from 1.
    pub line: usize,
    /// Which count.
    pub name: &'static str,
}

impl RecordLog {
    /// Reads a log.
    ///
    /// # Errors
    /// [`RecordLogError`] for a known count without a number.
    pub fn parse(text: &str) -> Result<Self, RecordLogError> {
        let mut log = Self::default();
        for (i, raw) in text.lines().enumerate() {
            let line = raw.trim_matches(|c: char| c.is_whitespace() || c == ',' || c == '"');
            if line.is_empty() || line.len() > MAX_LINE {
                continue;
            }
            if let Some(value) = line.strip_prefix("LVDS lane mode") {
                let digits = value.trim_start_matches([' ', ':', '-']);
                log.lanes = digits
                    .split_whitespace()
                    .next()
                    .and_then(|word| word.parse().ok());
                continue;
            }
            if let Some(name) = line.strip_suffix(':').map(str::trim_end)
                && name.ends_with("Data")
            {
                if log.blocks.len() < MAX_BLOCKS {
                    log.blocks.push(RecordCounts {
                        name: name.into(),
                        ..RecordCounts::default()
                    });
                }
                continue;
            }
            log.count(i + 1, line)?;
        }
        Ok(log)
    }

    fn count(&mut self, line: usize, text: &str) -> Result<(), RecordLogError> {
        let Some((name, value)) = text.split_once(" - ") else {
            return Ok(());
        };
        const NAMES: [&str; 7] = [
            "Out of sequence count",
            "First Packet ID",
            "Last Packet ID",
            "Number of received packets",
            "Number of zero filled packets",
            "Number of zero filled bytes",
            "Duration(sec)",
        ];
        let Some(index) = NAMES.iter().position(|n| *n == name.trim()) else {
            return Ok(());
        };
        // A recorder that received nothing was observed to write a negative duration.
        let value: i128 = value.trim().parse().map_err(|_| RecordLogError {
            line,
            name: NAMES[index],
        })?;
        let value = Some(u64::try_from(value.max(0)).unwrap_or(u64::MAX));
        if self.blocks.is_empty() {
            self.blocks.push(RecordCounts::default());
        }
        if let Some(counts) = self.blocks.last_mut() {
            *match index {
                0 => &mut counts.out_of_sequence,
                1 => &mut counts.first_packet,
                2 => &mut counts.last_packet,
                3 => &mut counts.received,
                4 => &mut counts.zero_filled_packets,
                5 => &mut counts.zero_filled_bytes,
                _ => &mut counts.duration_s,
            } = value;
        }
        Ok(())
    }

    /// Describes in words the problems in the log that affect the samples; empty if there are none.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if self.blocks.is_empty() {
            problems.push("the log has no counts: the recorder did not end in order".into());
        }
        for counts in &self.blocks {
            let sum =
                |a: Option<u64>, b: Option<u64>| a.unwrap_or(0).saturating_add(b.unwrap_or(0));
            if let Some(n) = counts.zero_filled_packets.filter(|n| *n > 0) {
                let all = sum(counts.received, Some(n));
                problems.push(format!(
                    "{n} of {all} packets were lost and filled with zeros ({:.2} %)",
                    100.0 * n as f64 / all as f64
                ));
            }
            if let Some(n) = counts.out_of_sequence.filter(|n| *n > 0) {
                problems.push(format!("{n} packets came out of sequence"));
            }
            if counts.received == Some(0) {
                problems.push(format!("no packet of {} was received", counts.name));
            }
        }
        problems
    }
}
