//! TI's DCA1000 capture card: assembles its packets into frames.
//!
//! The card sends raw samples as UDP datagrams to port [`DATA_PORT`]: a packet number (u32, from 1), the
//! number of sample bytes sent before (u48) and up to [`MAX_PAYLOAD`] bytes, all little-endian. Frames
//! begin and end anywhere in a packet. mmWave Studio can write the same packets to a file, with a
//! length in between ([`records`]); network tools write them as pcap ([`crate::pcap`]).
//!
//! Reading order: this module (packets), [`assembler`] (packets into frames), [`source`] (sources of packets, and
//! [`FrameBuilder`] and [`PacketFrames`], which decode what the assembler joins), [`records`]. Source: TI SPRUIJ4 "DCA1000EVM Data
//! Capture Card", section on the Ethernet data format.

pub mod assembler;
pub mod records;
pub mod source;

pub use assembler::{AssembledFrame, Assembler, TransferSummary};
pub use records::{RecordReader, starts_with_record};
pub use source::{FrameBuilder, PacketFrames, PacketSource, PcapPackets};

/// UDP port of the samples.
pub const DATA_PORT: u16 = 4098;
/// Maximum number of sample bytes in a packet.
pub const MAX_PAYLOAD: usize = 1456;
/// Bytes before the samples.
pub const HEADER_BYTES: usize = 10;

/// One packet of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataPacket<'a> {
    /// Number of the packet, from 1.
    pub sequence: u32,
    /// Sample bytes sent before this packet; below 2^48.
    pub byte_count: u64,
    /// Sample bytes, 1 to [`MAX_PAYLOAD`].
    pub payload: &'a [u8],
}

/// Reasons why a datagram is not a packet of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a datagram of {0} bytes; packets of samples have 11 to 1466")]
pub struct PacketError(pub usize);

impl<'a> DataPacket<'a> {
    /// Parses a datagram.
    ///
    /// # Errors
    /// [`PacketError`] for a datagram without samples or too long for one packet.
    pub fn parse(datagram: &'a [u8]) -> Result<Self, PacketError> {
        let error = PacketError(datagram.len());
        let (header, payload) = datagram.split_first_chunk::<HEADER_BYTES>().ok_or(error)?;
        let [s0, s1, s2, s3, count @ ..] = *header;
        if payload.is_empty() || payload.len() > MAX_PAYLOAD {
            return Err(error);
        }
        Ok(Self {
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            byte_count: u48(count),
            payload,
        })
    }
}

/// Little-endian number of 48 bits.
fn u48(b: [u8; 6]) -> u64 {
    u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], 0, 0])
}
