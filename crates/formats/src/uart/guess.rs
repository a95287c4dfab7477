//! Detects the dialect of a stream from its first packets.

use super::{
    Dialect, MAX_PACKET_BYTES, find_magic,
    packet::{Header, Step, Walk, header},
    tlv::Kind,
};

/// Number of packets that are examined.
pub const GUESS_PACKETS: usize = 8;
/// Upper bound on the padding at the end of a packet, bytes.
const PADDING: usize = 32;
/// Minimum lead over the second-best dialect, as a fraction of the best score.
const MIN_LEAD: f32 = 0.05;
/// Minimum mean score per packet: a plausible header and at least one known TLV type.
const MIN_SCORE: f32 = 1.25;

/// Evidence for one dialect.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// The dialect.
    pub dialect: Dialect,
    /// Packets with a plausible header.
    pub headers: usize,
    /// Packets with a correct checksum, for dialects that have one.
    pub checksums: usize,
    /// Packets whose length equals that in the header.
    pub lengths: usize,
    /// Packets whose TLVs end at the end of the packet, apart from padding.
    pub walks: usize,
    /// Mean fraction of known TLVs. A known type counts half; the other half requires a valid length and content.
    pub known: f32,
    /// Sum over packets: 1 for the header, 2 each for the checksum, the length and the end of the TLVs, and 2 times the
    /// fraction of known TLVs.
    pub score: f32,
}

/// The detected dialect with the evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    /// The dialect with the highest score.
    pub dialect: Dialect,
    /// Lead over the second-best dialect as a fraction of the best score, 0..=1.
    pub certainty: f32,
    /// Number of packets examined.
    pub packets: usize,
    /// Evidence for all dialects, best first.
    pub evidence: Vec<Evidence>,
}

impl std::fmt::Display for Guess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, certainty {:.2}: of {} packets",
            self.dialect.name(),
            self.certainty,
            self.packets
        )?;
        for e in self.evidence.iter().take(2) {
            write!(
                f,
                " [{}: {} headers, {} checksums, {} lengths, {} walks, {:.0} % of TLVs known]",
                e.dialect.name(),
                e.headers,
                e.checksums,
                e.lengths,
                e.walks,
                100.0 * e.known
            )?;
        }
        Ok(())
    }
}

/// Detects the dialect from the first [`GUESS_PACKETS`] packets in `bytes`.
///
/// # Errors
/// The evidence, if no dialect explains the packets or two explain them equally well. Empty if there is no packet.
pub fn guess(bytes: &[u8]) -> Result<Guess, Vec<Evidence>> {
    let mut spans = Vec::new();
    let mut start = find_magic(bytes);
    while let Some(at) = start {
        let next = find_magic(&bytes[at + 8..]).map(|n| at + 8 + n);
        let end = next.unwrap_or(bytes.len()).min(at + MAX_PACKET_BYTES);
        spans.push((&bytes[at..end], next.is_some()));
        if spans.len() > GUESS_PACKETS {
            break;
        }
        start = next;
    }
    // The last packet may be truncated by the end of the data. It is used only if it is the only one.
    if spans.len() > 1 {
        spans.pop();
    }
    if spans.is_empty() {
        return Err(Vec::new());
    }
    let mut evidence: Vec<Evidence> = Dialect::ALL.iter().map(|d| weigh(*d, &spans)).collect();
    // The sort is stable: equal scores remain in the order of `ALL`.
    evidence.sort_by(|a, b| b.score.total_cmp(&a.score));
    let (best, next) = (&evidence[0], &evidence[1]);
    let certainty = if best.score > 0.0 {
        (best.score - next.score) / best.score
    } else {
        0.0
    };
    if best.score < MIN_SCORE * spans.len() as f32 || certainty < MIN_LEAD {
        return Err(evidence);
    }
    Ok(Guess {
        dialect: best.dialect,
        certainty,
        packets: spans.len(),
        evidence,
    })
}

fn weigh(dialect: Dialect, spans: &[(&[u8], bool)]) -> Evidence {
    let mut e = Evidence {
        dialect,
        headers: 0,
        checksums: 0,
        lengths: 0,
        walks: 0,
        known: 0.0,
        score: 0.0,
    };
    for (span, followed) in spans {
        let Some(Ok(head)) = header(dialect, span) else {
            continue;
        };
        e.headers += 1;
        let mut score = 1.0;
        if dialect.has_checksum() {
            e.checksums += 1;
            score += 2.0;
        }
        if head.total_len == span.len() || !followed && head.total_len < span.len() {
            e.lengths += 1;
            score += 2.0;
        }
        let (known, ends) = walk(dialect, &head, span);
        if ends {
            e.walks += 1;
            score += 2.0;
        }
        e.known += known / spans.len() as f32;
        e.score += score + 2.0 * known;
    }
    e
}

/// Fraction of known TLVs, and whether the TLVs end at the end of the packet.
fn walk(dialect: Dialect, head: &Header, span: &[u8]) -> (f32, bool) {
    let body = &span[dialect.header_len()..head.total_len.min(span.len())];
    let mut steps = Walk::new(dialect, body, head.n_tlvs);
    let mut known = 0.0;
    let mut whole = true;
    for step in steps.by_ref() {
        match step {
            Step::Tlv(number, payload) => {
                if let Some(kind) = Kind::of(dialect, number) {
                    let has_content = kind
                        .split(payload)
                        .is_some_and(|(_, items)| kind.is_single() || items.len() > 0);
                    known += if has_content { 1.0 } else { 0.5 };
                }
            }
            Step::WrongLength(number) => {
                whole = false;
                if number.is_some_and(|n| Kind::of(dialect, n).is_some()) {
                    known += 0.5;
                }
            }
        }
    }
    let share = known / head.n_tlvs.max(1) as f32;
    let ends = whole && head.n_tlvs > 0 && steps.rest().len() < PADDING;
    (share, ends)
}
