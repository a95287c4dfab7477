//! Packet headers, and iteration over TLVs.

use super::{Dialect, MAX_PACKET_BYTES, MAX_TLVS};

/// Upper bound on the padding at the end of a packet, bytes: packets are multiples of 32 bytes, or not padded.
pub(super) const PADDING: usize = 32;

/// Content of a valid header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub number: u32,
    pub subframe: u32,
    /// CPU clock of the chip when the packet was generated, cycles modulo 2^32.
    pub cycles: Option<u32>,
    pub total_len: usize,
    pub n_tlvs: usize,
    /// Number of detected objects, if the dialect states it.
    pub n_objects: Option<u32>,
    /// Number of points of minor motion (xWRL6844) or of static points (Area Scanner), if the dialect states it.
    pub n_more_objects: Option<u32>,
    /// Version of the firmware's SDK: major number in the highest byte.
    pub version: u32,
    /// Chip, for example 0xA6843.
    pub platform: u32,
}

/// Reason why no packet follows a magic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BadHeader {
    /// The length or the number of TLVs is impossible.
    Implausible,
    /// The checksum is wrong: the words do not sum to 0xFFFF.
    Checksum,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// Reads the header at the start of `bytes`; `None` if there are too few bytes.
pub(super) fn header(dialect: Dialect, bytes: &[u8]) -> Option<Result<Header, BadHeader>> {
    let words = bytes.get(..dialect.header_len())?;
    if dialect.has_checksum() && ones_complement_sum(words) != 0xFFFF {
        return Some(Err(BadHeader::Checksum));
    }
    let places = Places::of(dialect);
    let word = |at: usize| u32_at(words, at);
    let n_tlvs = match dialect.has_checksum() {
        true => u32::from(u16_at(words, places.n_tlvs)?),
        false => word(places.n_tlvs)?,
    } as usize;
    let total_len = word(places.total_len)? as usize;
    if !(words.len()..=MAX_PACKET_BYTES).contains(&total_len) || n_tlvs > MAX_TLVS {
        return Some(Err(BadHeader::Implausible));
    }
    Some(Ok(Header {
        number: word(places.number)?,
        subframe: places.subframe.and_then(word).unwrap_or(0),
        cycles: places.cycles.and_then(word),
        total_len,
        n_tlvs,
        n_objects: places.n_objects.and_then(word),
        n_more_objects: places.n_more_objects.and_then(word),
        version: word(8)?,
        platform: word(places.platform)?,
    }))
}

/// Places of the fields in a header, bytes from the magic. The version is at byte 8 in all of them.
struct Places {
    total_len: usize,
    platform: usize,
    number: usize,
    /// 16 bits in headers with a checksum, otherwise 32.
    n_tlvs: usize,
    subframe: Option<usize>,
    cycles: Option<usize>,
    n_objects: Option<usize>,
    n_more_objects: Option<usize>,
}

impl Places {
    fn of(dialect: Dialect) -> Self {
        let sdk = Self {
            total_len: 12,
            platform: 16,
            number: 20,
            n_tlvs: 32,
            subframe: Some(36),
            cycles: Some(24),
            n_objects: Some(28),
            n_more_objects: None,
        };
        match dialect {
            Dialect::Sdk3 | Dialect::Sdk2 => sdk,
            Dialect::Sdk1 => Self {
                subframe: None,
                ..sdk
            },
            Dialect::AreaScanner => Self {
                n_more_objects: Some(40),
                ..sdk
            },
            Dialect::PeopleTracking6844 => Self {
                n_more_objects: Some(32),
                n_tlvs: 36,
                subframe: Some(40),
                ..sdk
            },
            Dialect::PeopleCounting3d => Self {
                n_tlvs: 44,
                subframe: Some(24),
                cycles: None,
                n_objects: None,
                ..sdk
            },
            Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact | Dialect::Overhead3d => {
                Self {
                    total_len: 20,
                    platform: 12,
                    number: 24,
                    n_tlvs: 48,
                    subframe: Some(28),
                    cycles: Some(16),
                    n_objects: None,
                    n_more_objects: None,
                }
            }
        }
    }
}

/// Sum of the 16-bit words with end-around carry.
fn ones_complement_sum(bytes: &[u8]) -> u32 {
    let sum: u32 = bytes
        .chunks_exact(2)
        .map(|w| u32::from(u16::from_le_bytes([w[0], w[1]])))
        .sum();
    (sum & 0xFFFF) + (sum >> 16)
}

/// One TLV, or the end of the readable part of a packet.
pub(super) enum Step<'a> {
    /// Type and payload.
    Tlv(u32, &'a [u8]),
    /// The payload exceeds the bytes of the packet, so no further TLV can be located.
    Beyond {
        /// The type, if it is there.
        number: Option<u32>,
        /// Whether the payload would end within the length that the header states: the packet lacks bytes.
        is_cut: bool,
    },
}

/// Iterates over the TLVs of a packet: at most as many as its header states, and never beyond its bytes.
pub(super) struct Walk<'a> {
    dialect: Dialect,
    body: &'a [u8],
    /// Bytes from the start of `body` to the end of the packet according to its header.
    stated: usize,
    left: usize,
}

impl<'a> Walk<'a> {
    /// Creates an iterator over the bytes of a packet from its magic on, which may be fewer than the header states.
    pub(super) fn new(dialect: Dialect, head: &Header, packet: &'a [u8]) -> Self {
        let packet = &packet[..packet.len().min(head.total_len)];
        Self {
            dialect,
            body: packet.get(dialect.header_len()..).unwrap_or_default(),
            stated: head.total_len.saturating_sub(dialect.header_len()),
            left: head.n_tlvs,
        }
    }

    /// The bytes after the TLVs returned so far. After the last one, this is padding.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.body
    }

    /// Number of bytes between the TLVs returned so far and the end of the packet according to its header.
    pub(super) fn stated_rest(&self) -> usize {
        self.stated
    }
}

impl<'a> Iterator for Walk<'a> {
    type Item = Step<'a>;

    fn next(&mut self) -> Option<Step<'a>> {
        self.left = self.left.checked_sub(1)?;
        let own = match self.dialect.tlv_length_includes_header() {
            true => 8,
            false => 0,
        };
        let number = u32_at(self.body, 0);
        let end = u32_at(self.body, 4)
            .and_then(|length| (length as usize).checked_sub(own)?.checked_add(8));
        if let (Some(number), Some(end)) = (number, end)
            && let Some((tlv, rest)) = self.body.split_at_checked(end)
        {
            self.body = rest;
            self.stated -= end;
            return Some(Step::Tlv(number, &tlv[8..]));
        }
        self.left = 0;
        let is_cut = end.map_or(self.body.len() < 8, |end| end <= self.stated);
        Some(Step::Beyond { number, is_cut })
    }
}
