//! UDP datagrams in capture files of network tools: pcap and pcapng.
//!
//! Supported are the classic format in both byte orders with microseconds and nanoseconds, and pcapng sections with
//! enhanced and simple packet blocks. Link types: Ethernet (with VLAN tags), raw IP, Linux cooked (1 and 2) and BSD
//! loopback. Network protocol: IPv4. Fragments and packets other than UDP over IPv4 are counted in
//! [`PcapReader::others`]. Sources: RFC drafts `draft-ietf-opsawg-pcap` and `-pcapng`; link type numbers of
//! tcpdump.org. Packet times are not used because the counters of the capture card are more accurate.

use std::io::Read;

use crate::adc::{AdcError, reader::fill};

/// Maximum length of a packet, bytes, as in tcpdump.
const MAX_PACKET: u32 = 262_144;
/// Maximum length of a pcapng block, bytes. Longer blocks of unknown types are skipped without buffering.
const MAX_BLOCK: u32 = MAX_PACKET + 65_536;
/// Maximum number of interfaces of a pcapng section.
const MAX_INTERFACES: usize = 1024;

/// First word of a pcapng section header, the same in both byte orders.
const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const BYTE_ORDER_MAGIC: u32 = 0x1a2b_3c4d;

/// Whether a file starts like a pcap or pcapng file.
pub fn is_magic(head: &[u8]) -> bool {
    let magic = head.first_chunk::<4>().map(|m| u32::from_le_bytes(*m));
    matches!(
        magic,
        Some(0xa1b2_c3d4 | 0xd4c3_b2a1 | 0xa1b2_3c4d | 0x4d3c_b2a1 | SECTION_HEADER)
    )
}

/// Metadata of a datagram whose bytes are in the caller's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CapturedUdp {
    /// Destination port.
    pub destination_port: u16,
    /// False if the recorder stored only the beginning of the datagram.
    pub is_whole: bool,
}

/// Layout of the file.
enum FileLayout {
    Classic {
        link: u32,
    },
    /// Link types of the interfaces of the section.
    Sections {
        links: Vec<u32>,
    },
}

/// Reads datagrams sequentially.
pub struct PcapReader<R> {
    input: R,
    is_big_endian: bool,
    format: FileLayout,
    /// Number of bytes read.
    offset: u64,
    buffer: Vec<u8>,
    others: u64,
    cut_bytes: usize,
}

impl<R: Read> PcapReader<R> {
    /// Reads the header of the file.
    ///
    /// # Errors
    /// [`AdcError`] if the file is neither pcap nor pcapng.
    pub fn new(input: R) -> Result<Self, AdcError> {
        let mut reader = Self {
            input,
            is_big_endian: false,
            format: FileLayout::Classic { link: 0 },
            offset: 0,
            buffer: Vec::new(),
            others: 0,
            cut_bytes: 0,
        };
        let expected = "the first bytes of a pcap or pcapng file";
        if !reader.fill(4)? {
            return Err(AdcError::format(0, expected, "an end"));
        }
        let magic = reader.word(0);
        match magic {
            0xa1b2_c3d4 | 0xa1b2_3c4d => {}
            0xd4c3_b2a1 | 0x4d3c_b2a1 => reader.is_big_endian = true,
            SECTION_HEADER => {
                reader.format = FileLayout::Sections { links: Vec::new() };
                reader.section_header()?;
                return Ok(reader);
            }
            _ => return Err(AdcError::format(0, expected, format!("{magic:#010x}"))),
        }
        if !reader.fill(20)? {
            return Err(AdcError::format(
                4,
                "20 more bytes of the file header",
                "an end",
            ));
        }
        // The upper bits contain the length of a frame check sequence.
        let link = reader.word(16) & 0x0fff_ffff;
        check_link(link, 20)?;
        reader.format = FileLayout::Classic { link };
        Ok(reader)
    }

    /// Number of packets that are fragments or not UDP over IPv4.
    pub fn others(&self) -> u64 {
        self.others
    }

    /// Number of bytes of an incomplete last packet, which occurs if the recorder is stopped while it writes.
    pub fn cut_bytes(&self) -> usize {
        self.cut_bytes
    }

    /// Writes the payload of the next datagram to `datagram`; `None` at the end.
    ///
    /// # Errors
    /// [`AdcError`] with the offset of an impossible length.
    pub fn next_udp(&mut self, datagram: &mut Vec<u8>) -> Result<Option<CapturedUdp>, AdcError> {
        loop {
            let found = match &self.format {
                FileLayout::Classic { link } => {
                    let link = *link;
                    self.next_classic()?
                        .map(|()| Some((link, 0, self.buffer.len())))
                }
                FileLayout::Sections { .. } => self.next_block()?,
            };
            let Some(packet) = found else {
                return Ok(None);
            };
            // Skips blocks that contain no packet.
            let Some((link, start, stop)) = packet else {
                continue;
            };
            match find_udp(link, &self.buffer[start..stop]) {
                Some((udp, payload)) => {
                    datagram.clear();
                    datagram.extend_from_slice(payload);
                    return Ok(Some(udp));
                }
                None => self.others += 1,
            }
        }
    }

    /// Reads the next packet into the buffer; `None` at the end.
    fn next_classic(&mut self) -> Result<Option<()>, AdcError> {
        let start = self.offset;
        if !self.fill(16)? {
            self.cut_bytes = self.buffer.len();
            return Ok(None);
        }
        let length = self.word(8);
        if length > MAX_PACKET {
            return Err(AdcError::format(
                start + 8,
                format!("the length of a packet, at most {MAX_PACKET} bytes"),
                length.to_string(),
            ));
        }
        if !self.fill(length as usize)? {
            self.cut_bytes = 16 + self.buffer.len();
            return Ok(None);
        }
        Ok(Some(()))
    }

    /// Reads the body of the next block into the buffer. Returns the link type and the position of its packet, if it
    /// contains one.
    #[allow(clippy::type_complexity)]
    fn next_block(&mut self) -> Result<Option<Option<(u32, usize, usize)>>, AdcError> {
        let start = self.offset;
        if !self.fill(4)? {
            self.cut_bytes = self.buffer.len();
            return Ok(None);
        }
        let kind = self.word(0);
        if kind == SECTION_HEADER {
            self.section_header()?;
            return Ok(Some(None));
        }
        if !self.fill(4)? {
            self.cut_bytes = 4 + self.buffer.len();
            return Ok(None);
        }
        let total = self.word(0);
        if total < 12 || !total.is_multiple_of(4) {
            return Err(AdcError::format(
                start + 4,
                "the length of a block, a multiple of 4 from 12",
                total.to_string(),
            ));
        }
        let is_known = matches!(kind, 1 | 3 | 6);
        if is_known && total > MAX_BLOCK {
            return Err(AdcError::format(
                start + 4,
                format!("the length of a block, at most {MAX_BLOCK} bytes"),
                total.to_string(),
            ));
        }
        if !is_known {
            let n = self.skip(u64::from(total) - 8)?;
            if n < u64::from(total) - 8 {
                self.cut_bytes = 8 + n as usize;
                return Ok(None);
            }
            return Ok(Some(None));
        }
        if !self.fill(total as usize - 8)? {
            self.cut_bytes = 8 + self.buffer.len();
            return Ok(None);
        }
        // The block length is repeated at the end of the block.
        let body = self.buffer.len() - 4;
        let too_short = || AdcError::format(start + 4, "a longer block", total.to_string());
        let half = |at: usize| {
            let bytes = [self.buffer[at], self.buffer[at + 1]];
            match self.is_big_endian {
                true => u16::from_be_bytes(bytes),
                false => u16::from_le_bytes(bytes),
            }
        };
        match kind {
            1 => {
                if body < 8 {
                    return Err(too_short());
                }
                let link = u32::from(half(0));
                check_link(link, start + 8)?;
                if let FileLayout::Sections { links } = &mut self.format {
                    if links.len() == MAX_INTERFACES {
                        return Err(AdcError::format(
                            start,
                            format!("at most {MAX_INTERFACES} interfaces"),
                            "one more",
                        ));
                    }
                    links.push(link);
                }
                Ok(Some(None))
            }
            6 => {
                if body < 20 {
                    return Err(too_short());
                }
                let (interface, length) = (self.word(0) as usize, self.word(12) as usize);
                if length > body - 20 {
                    return Err(AdcError::format(
                        start + 20,
                        format!("a packet of at most {} bytes in this block", body - 20),
                        length.to_string(),
                    ));
                }
                let link = self.link_of(interface, start + 8)?;
                Ok(Some(Some((link, 20, 20 + length))))
            }
            _ => {
                if body < 4 {
                    return Err(too_short());
                }
                let link = self.link_of(0, start + 8)?;
                // The packet is padded to four bytes. Its original length determines its end, unless the packet was
                // truncated.
                let length = (self.word(0) as usize).min(body - 4);
                Ok(Some(Some((link, 4, 4 + length))))
            }
        }
    }

    fn link_of(&self, interface: usize, offset: u64) -> Result<u32, AdcError> {
        let links: &[u32] = match &self.format {
            FileLayout::Sections { links } => links,
            FileLayout::Classic { .. } => &[],
        };
        links.get(interface).copied().ok_or_else(|| {
            AdcError::format(
                offset,
                format!("one of {} interfaces", links.len()),
                format!("interface {interface}"),
            )
        })
    }

    /// Reads the rest of a section header whose first word has been read.
    fn section_header(&mut self) -> Result<(), AdcError> {
        let start = self.offset - 4;
        if !self.fill(8)? {
            return Err(AdcError::format(start, "a section header", "an end"));
        }
        self.is_big_endian = false;
        self.is_big_endian = match self.word(4) {
            BYTE_ORDER_MAGIC => false,
            word if word.swap_bytes() == BYTE_ORDER_MAGIC => true,
            other => {
                let found = format!("{other:#010x}");
                return Err(AdcError::format(start + 8, "a byte order magic", found));
            }
        };
        let total = self.word(0);
        if total < 28 || !total.is_multiple_of(4) {
            return Err(AdcError::format(
                start + 4,
                "the length of a section header, a multiple of 4 from 28",
                total.to_string(),
            ));
        }
        self.format = FileLayout::Sections { links: Vec::new() };
        let rest = u64::from(total) - 12;
        if self.skip(rest)? < rest {
            return Err(AdcError::format(start, "a whole section header", "an end"));
        }
        Ok(())
    }

    /// Reads `n` bytes into the buffer; false if the input ends early.
    fn fill(&mut self, n: usize) -> Result<bool, AdcError> {
        fill(&mut self.input, n, &mut self.buffer, &mut self.offset)
    }

    /// Skips `n` bytes and returns the number of bytes skipped.
    fn skip(&mut self, n: u64) -> Result<u64, AdcError> {
        let skipped = std::io::copy(&mut (&mut self.input).take(n), &mut std::io::sink()).map_err(
            |source| AdcError::Read {
                offset: self.offset,
                source,
            },
        )?;
        self.offset += skipped;
        Ok(skipped)
    }

    /// Decodes the 32-bit word at offset `at` of the buffer, which must contain it.
    fn word(&self, at: usize) -> u32 {
        let b = &self.buffer;
        let bytes = [b[at], b[at + 1], b[at + 2], b[at + 3]];
        match self.is_big_endian {
            true => u32::from_be_bytes(bytes),
            false => u32::from_le_bytes(bytes),
        }
    }
}

const NULL: u32 = 0;
const ETHERNET: u32 = 1;
const RAW_OLD: u32 = 12;
const RAW: u32 = 101;
const LOOP: u32 = 108;
const LINUX_SLL: u32 = 113;
const IPV4: u32 = 228;
const LINUX_SLL2: u32 = 276;
/// EtherType of IPv4.
const TYPE_IPV4: u16 = 0x0800;

fn check_link(link: u32, offset: u64) -> Result<(), AdcError> {
    match link {
        NULL | ETHERNET | RAW_OLD | RAW | LOOP | LINUX_SLL | IPV4 | LINUX_SLL2 => Ok(()),
        _ => Err(AdcError::format(
            offset,
            "a link type of Ethernet, raw IP, Linux cooked or loopback",
            link.to_string(),
        )),
    }
}

fn be16(bytes: &[u8], at: usize) -> Option<u16> {
    let pair = bytes.get(at..at.checked_add(2)?)?;
    Some(u16::from_be_bytes([pair[0], pair[1]]))
}

/// Finds the datagram in a packet; `None` for fragments and other protocols.
fn find_udp(link: u32, packet: &[u8]) -> Option<(CapturedUdp, &[u8])> {
    let ip = match link {
        ETHERNET => {
            let mut at = 12;
            // Skips at most two VLAN tags.
            for _ in 0..2 {
                if matches!(be16(packet, at)?, 0x8100 | 0x88a8) {
                    at += 4;
                }
            }
            (be16(packet, at)? == TYPE_IPV4).then(|| packet.get(at + 2..))??
        }
        NULL | LOOP => packet.get(4..)?,
        LINUX_SLL => (be16(packet, 14)? == TYPE_IPV4).then(|| packet.get(16..))??,
        LINUX_SLL2 => (be16(packet, 0)? == TYPE_IPV4).then(|| packet.get(20..))??,
        _ => packet,
    };
    let version_length = *ip.first()?;
    let header = usize::from(version_length & 0x0f) * 4;
    let (protocol, fragment) = (*ip.get(9)?, be16(ip, 6)?);
    // Rejects fragments: more fragments follow, or this is not the first one.
    if version_length >> 4 != 4 || header < 20 || protocol != 17 || fragment & 0x3fff != 0 {
        return None;
    }
    let udp = ip.get(header..)?;
    let destination_port = be16(udp, 2)?;
    let length = usize::from(be16(udp, 4)?).checked_sub(8)?;
    let rest = udp.get(8..)?;
    let is_whole = rest.len() >= length;
    let udp = CapturedUdp {
        destination_port,
        is_whole,
    };
    Some((udp, &rest[..length.min(rest.len())]))
}
