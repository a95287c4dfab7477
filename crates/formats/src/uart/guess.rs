//! Detects the dialect of a stream from its first packets.

use super::{
    Dialect, MAX_PACKET_BYTES, UartReport, find_magic,
    packet::{Header, PADDING, Step, Walk, header},
    tlv::{Belief, Content, Kind, decode},
};

/// Number of packets with content that are examined at first. Unclear streams are examined again when there are twice as
/// many.
pub const GUESS_PACKETS: usize = 8;
/// Minimum lead over the second-best dialect, as a fraction of the best score.
const MIN_LEAD: f32 = 0.05;
/// A lead that is enough, whatever fraction it is: two packets in which half of the TLVs fit one dialect alone. In a
/// stream of hundreds of packets that two dialects read alike, few are different.
const ENOUGH_LEAD: f32 = 1.5;
/// Minimum mean score per packet: a plausible header and at least one known TLV type.
const MIN_SCORE: f32 = 1.25;
/// Minimum share of known TLVs if the TLVs of most packets do not end with the packet.
const MIN_KNOWN: f32 = 0.2;
/// Score of a version or platform of the header that belongs to the dialect. It decides between dialects that read the
/// same content, and not against content.
const HEADER_WORDS: f32 = 0.5;

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
    /// Mean fraction of known TLVs. A known type counts half if nothing shows that its content is another one, and a
    /// possible content counts 1, an impossible one -1.
    pub known: f32,
    /// Sum over packets: 1 for the header, 0.5 for its version and platform, 2 each for the checksum, the length and the
    /// end of the TLVs, and 2 times the fraction of known TLVs.
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
    /// Other dialects explain the packets equally well, and read the same from them. The dialect is the most common one.
    pub is_assumed: bool,
}

impl std::fmt::Display for Guess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let assumed = if self.is_assumed { " (assumed)" } else { "" };
        write!(
            f,
            "{}{assumed}, certainty {:.2}: of {} packets",
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

/// Detects the dialect from the first [`GUESS_PACKETS`] packets with content in `bytes`. Packets without TLVs, of an empty
/// room, are no evidence; if there are no others, the dialect is assumed.
///
/// # Errors
/// The evidence, if no dialect explains the packets or two explain them equally well. Empty if there is no packet.
pub fn guess(bytes: &[u8]) -> Result<Guess, Vec<Evidence>> {
    let mut spans = Vec::new();
    let mut quiet = QuietPackets::default();
    let mut start = find_magic(bytes);
    while let Some(at) = start {
        let next = find_magic(&bytes[at + 8..]).map(|n| at + 8 + n);
        let end = next.unwrap_or(bytes.len()).min(at + MAX_PACKET_BYTES);
        let packet = Packet {
            bytes: &bytes[at..end],
            is_followed: next.is_some(),
        };
        match packet.quiet_dialect() {
            Some(_) => quiet.add(packet),
            None => spans.push(packet),
        }
        if spans.len() > GUESS_PACKETS {
            break;
        }
        start = next;
    }
    decide_at_end(&spans, &quiet)
}

/// The dialect of a whole stream: of the packets with content if there are any, otherwise of the others.
pub(super) fn decide_at_end(
    spans: &[Packet],
    quiet: &QuietPackets,
) -> Result<Guess, Vec<Evidence>> {
    // The last packet may be truncated by the end of the data. It is used only if it is the only one.
    let spans = match spans {
        [first @ .., last] if !last.is_followed && (!first.is_empty() || quiet.n > 0) => first,
        spans => spans,
    };
    match spans.is_empty() {
        true => quiet.decide(),
        false => decide(spans, true),
    }
}

/// A packet of a stream whose dialect is not known: from its magic to the next one.
#[derive(Clone, Copy)]
pub(super) struct Packet<'a> {
    pub bytes: &'a [u8],
    /// Whether another packet follows. If not, the bytes may be fewer than were sent.
    pub is_followed: bool,
}

impl Packet<'_> {
    /// The first dialect in which this packet has only known TLVs, if no dialect sees points, tracks or presence in it:
    /// it shows no dialect and contains nothing.
    pub(super) fn quiet_dialect(self) -> Option<Dialect> {
        let mut found = None;
        for dialect in Dialect::ALL {
            let Some(Ok(head)) = header(dialect, self.bytes) else {
                continue;
            };
            let seen = look(dialect, &head, self.bytes);
            if !(seen.is_whole || head.n_tlvs == 0 && seen.padding < PADDING) {
                continue;
            }
            if seen.content.has_scene() || seen.n_unknown > 0 || seen.n_impossible > 0 {
                return None;
            }
            found = found.or(Some(dialect));
        }
        found
    }
}

/// Packets without points, tracks and presence.
#[derive(Debug, Default)]
pub(super) struct QuietPackets {
    n: usize,
    /// In the order of [`Dialect::ALL`].
    evidence: Vec<Evidence>,
}

impl QuietPackets {
    pub(super) fn add(&mut self, packet: Packet) {
        self.n += 1;
        if self.evidence.is_empty() {
            self.evidence = Dialect::ALL.map(Evidence::none).into();
        }
        for evidence in &mut self.evidence {
            evidence.add(packet);
        }
    }

    /// The dialect of a stream of such packets.
    fn decide(&self) -> Result<Guess, Vec<Evidence>> {
        if self.n == 0 {
            return Err(Vec::new());
        }
        let evidence = self.evidence.iter().map(|e| e.over(self.n)).collect();
        let ranked = Ranked::new(evidence);
        let is_assumed = !ranked.leads(1);
        Ok(ranked.into_guess(self.n, is_assumed))
    }
}

/// The dialect of packets with content. At the end of a stream, dialects that read the same from all packets need not be
/// told apart.
///
/// # Errors
/// The evidence, best first, if it is not clear.
pub(super) fn decide(spans: &[Packet], is_end: bool) -> Result<Guess, Vec<Evidence>> {
    let weigh = |dialect| {
        let mut evidence = Evidence::none(dialect);
        spans.iter().for_each(|packet| evidence.add(*packet));
        evidence.over(spans.len())
    };
    let mut ranked = Ranked::new(Dialect::ALL.map(weigh).into());
    let best = &ranked.evidence[0];
    let is_explained = best.score >= MIN_SCORE * spans.len() as f32
        && (2 * best.walks >= spans.len() || best.known >= MIN_KNOWN);
    if !is_explained {
        return Err(ranked.evidence);
    }
    if ranked.leads(1) {
        return Ok(ranked.into_guess(spans.len(), false));
    }
    let read = |dialect| -> Vec<Option<Content>> {
        let content = |packet: &Packet| match header(dialect, packet.bytes) {
            Some(Ok(head)) => Some(look(dialect, &head, packet.bytes).content),
            _ => None,
        };
        spans.iter().map(content).collect()
    };
    let tied = ranked.n_tied();
    let first = read(ranked.evidence[0].dialect);
    if !is_end
        || !ranked.evidence[1..tied]
            .iter()
            .all(|e| read(e.dialect) == first)
    {
        return Err(ranked.evidence);
    }
    // The most common one of them.
    ranked.evidence[..tied].sort_by_key(|e| Dialect::ALL.iter().position(|d| *d == e.dialect));
    Ok(ranked.into_guess(spans.len(), true))
}

/// Evidence for all dialects, best first.
struct Ranked {
    evidence: Vec<Evidence>,
}

impl Ranked {
    fn new(mut evidence: Vec<Evidence>) -> Self {
        // The sort is stable: equal scores remain in the order of `ALL`.
        evidence.sort_by(|a, b| b.score.total_cmp(&a.score));
        Self { evidence }
    }

    /// Lead of the best one over another one as a fraction of its score.
    fn lead(&self, other: usize) -> f32 {
        let [best, other] = [0, other].map(|i| self.evidence[i].score);
        match best > 0.0 {
            true => ((best - other) / best).clamp(0.0, 1.0),
            false => 0.0,
        }
    }

    /// Whether the best one is clearly better than another one.
    fn leads(&self, other: usize) -> bool {
        let scores = [0, other].map(|i| self.evidence[i].score);
        self.lead(other) >= MIN_LEAD || scores[0] - scores[1] >= ENOUGH_LEAD
    }

    /// Number of dialects, the best one among them, that it does not lead.
    fn n_tied(&self) -> usize {
        (1..self.evidence.len())
            .find(|i| self.leads(*i))
            .unwrap_or(self.evidence.len())
    }

    fn into_guess(self, n_packets: usize, is_assumed: bool) -> Guess {
        Guess {
            dialect: self.evidence[0].dialect,
            certainty: match is_assumed {
                true => 0.0,
                false => self.lead(1),
            },
            packets: n_packets,
            evidence: self.evidence,
            is_assumed,
        }
    }
}

impl Evidence {
    fn none(dialect: Dialect) -> Self {
        Self {
            dialect,
            headers: 0,
            checksums: 0,
            lengths: 0,
            walks: 0,
            known: 0.0,
            score: 0.0,
        }
    }

    /// Turns the sum of shares into their mean.
    fn over(&self, n_packets: usize) -> Self {
        Self {
            known: self.known / n_packets.max(1) as f32,
            ..*self
        }
    }

    /// Adds a packet; `known` is a sum until [`Self::over`].
    fn add(&mut self, packet: Packet) {
        let Packet { bytes, is_followed } = packet;
        let dialect = self.dialect;
        let Some(Ok(head)) = header(dialect, bytes) else {
            return;
        };
        self.headers += 1;
        self.score += 1.0;
        if has_words_of(dialect, &head) {
            self.score += HEADER_WORDS;
        }
        if dialect.has_checksum() {
            self.checksums += 1;
            self.score += 2.0;
        }
        if head.total_len == bytes.len() || !is_followed && head.total_len < bytes.len() {
            self.lengths += 1;
            self.score += 2.0;
        }
        let seen = look(dialect, &head, bytes);
        if seen.is_whole {
            self.walks += 1;
            self.score += 2.0;
        }
        self.known += seen.known;
        self.score += 2.0 * seen.known;
    }
}

/// Whether version and platform in the header are those of the dialect's firmware. Not every firmware states its SDK.
fn has_words_of(dialect: Dialect, head: &Header) -> bool {
    let is_6844 = head.platform & 0xF_FFFF == 0xA_6844;
    let major = head.version >> 24;
    match dialect {
        Dialect::Sdk3 | Dialect::AreaScanner => major >= 3 && !is_6844,
        Dialect::Sdk2 | Dialect::Sdk1 => matches!(major, 1 | 2) && !is_6844,
        Dialect::PeopleTracking6844 => is_6844,
        _ => false,
    }
}

/// A packet as a dialect reads it.
struct Look {
    /// Mean over the TLVs: see [`Evidence::known`].
    known: f32,
    /// There are TLVs, and they end at the end of the packet apart from padding.
    is_whole: bool,
    /// Bytes after the TLVs.
    padding: usize,
    n_unknown: usize,
    n_impossible: usize,
    content: Content,
}

fn look(dialect: Dialect, head: &Header, bytes: &[u8]) -> Look {
    let mut steps = Walk::new(dialect, head, bytes);
    let mut content = Content::default();
    let mut known = 0.0;
    let (mut is_whole, mut n_unknown, mut n_impossible) = (head.n_tlvs > 0, 0, 0);
    for step in steps.by_ref() {
        let (number, payload) = match step {
            Step::Tlv(number, payload) => (number, payload),
            Step::Beyond { number, .. } => {
                is_whole = false;
                if number.is_some_and(|n| Kind::of(dialect, n).is_some()) {
                    known += 0.5;
                }
                continue;
            }
        };
        let Some(kind) = Kind::of(dialect, number) else {
            n_unknown += 1;
            continue;
        };
        let Some((units, items)) = kind.split(payload) else {
            n_impossible += 1;
            continue;
        };
        // The counts of what is tried here belong to no report.
        let dropped = &mut UartReport::default();
        let belief = decode(kind, units, items, 0.0, &mut content, dropped);
        n_impossible += usize::from(!belief.is_believed());
        known += known_share(kind, belief);
    }
    if !content.agrees_with(head) {
        known -= 0.5;
    }
    let padding = steps.rest().len();
    Look {
        known: known / head.n_tlvs.max(1) as f32,
        is_whole: is_whole && padding < PADDING,
        padding,
        n_unknown,
        n_impossible,
        content,
    }
}

/// What a TLV of a known type and a valid length adds to [`Evidence::known`].
fn known_share(kind: Kind, belief: Belief) -> f32 {
    match belief.items {
        _ if kind == Kind::Unused => 0.5,
        _ if !belief.is_believed() => -1.0,
        0 if !kind.is_single() => 0.5,
        n => 1.0 - belief.impossible as f32 / n.max(1) as f32,
    }
}
