//! Packet headers, and iteration over TLVs.

use super::{Dialect, MAX_PACKET_BYTES, MAX_TLVS};

/// Content of a valid header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub number: u32,
    pub subframe: u32,
    /// CPU clock of the chip when the packet was generated, cycles modulo 2^32.
    pub cycles: Option<u32>,
    pub total_len: usize,
    pub n_tlvs: usize,
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
    let (length_at, number_at, subframe_at, cycles_at) = match dialect {
        Dialect::Sdk3 | Dialect::AreaScanner => (12, 20, 36, Some(24)),
        Dialect::PeopleCounting3d => (12, 20, 24, None),
        Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact => (20, 24, 28, Some(16)),
    };
    let n_tlvs = match dialect {
        Dialect::Sdk3 | Dialect::AreaScanner => u32_at(words, 32)?,
        Dialect::PeopleCounting3d => u32::from(u16_at(words, 44)?),
        Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact => {
            u32::from(u16_at(words, 48)?)
        }
    } as usize;
    let total_len = u32_at(words, length_at)? as usize;
    if !(words.len()..=MAX_PACKET_BYTES).contains(&total_len) || n_tlvs > MAX_TLVS {
        return Some(Err(BadHeader::Implausible));
    }
    Some(Ok(Header {
        number: u32_at(words, number_at)?,
        subframe: u32_at(words, subframe_at)?,
        cycles: cycles_at.and_then(|at| u32_at(words, at)),
        total_len,
        n_tlvs,
    }))
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
    /// The length exceeds the packet, so no further TLV can be located. Contains the type, if it is known.
    WrongLength(Option<u32>),
}

/// Iterates over the TLVs of a packet: at most `n_tlvs`, and never beyond `body`.
pub(super) struct Walk<'a> {
    dialect: Dialect,
    body: &'a [u8],
    left: usize,
}

impl<'a> Walk<'a> {
    /// Creates an iterator over `body`, the packet without its header.
    pub(super) fn new(dialect: Dialect, body: &'a [u8], n_tlvs: usize) -> Self {
        Self {
            dialect,
            body,
            left: n_tlvs,
        }
    }

    /// The bytes after the TLVs returned so far. After the last one, this is padding.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.body
    }
}

impl<'a> Iterator for Walk<'a> {
    type Item = Step<'a>;

    fn next(&mut self) -> Option<Step<'a>> {
        self.left = self.left.checked_sub(1)?;
        let own = if self.dialect.tlv_length_includes_header() {
            8
        } else {
            0
        };
        let step = || {
            let number = u32_at(self.body, 0)?;
            let length = (u32_at(self.body, 4)? as usize).checked_sub(own)?;
            let payload = self.body.get(8..length.checked_add(8)?)?;
            Some((number, payload))
        };
        match step() {
            Some((number, payload)) => {
                self.body = &self.body[8 + payload.len()..];
                Some(Step::Tlv(number, payload))
            }
            None => {
                self.left = 0;
                Some(Step::WrongLength(u32_at(self.body, 0)))
            }
        }
    }
}
