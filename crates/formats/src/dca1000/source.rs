//! Sources of packets, and the frames assembled from them.

use std::{collections::VecDeque, io::Read};

use radarllm_base::RadarCube;

use super::{AssembledFrame, Assembler, DATA_PORT, DataPacket, TransferSummary};
use crate::{
    adc::{AdcError, FrameDecoder, FrameIntegrity, FrameSource},
    pcap::{CapturedUdp, PcapReader},
};

/// A source of consecutive packets: a file of records, a pcap file, a socket.
pub trait PacketSource {
    /// Returns the next packet; `None` at the end.
    ///
    /// # Errors
    /// [`AdcError`] with the place in the input.
    fn next_packet(&mut self) -> Result<Option<DataPacket<'_>>, AdcError>;

    /// Number of items received that were not sample packets: truncated ones or ones of another length.
    fn skipped(&self) -> u64;
}

/// Packets of a pcap or pcapng file: every datagram to the card's data port.
pub struct PcapPackets<R> {
    pcap: PcapReader<R>,
    datagram: Vec<u8>,
    skipped: u64,
}

impl<R: Read> PcapPackets<R> {
    /// Opens the file.
    ///
    /// # Errors
    /// [`AdcError`] if the file is not a pcap file.
    pub fn new(input: R) -> Result<Self, AdcError> {
        Ok(Self {
            pcap: PcapReader::new(input)?,
            datagram: Vec::new(),
            skipped: 0,
        })
    }

    /// The underlying reader, for its counts.
    pub fn pcap(&self) -> &PcapReader<R> {
        &self.pcap
    }
}

impl<R: Read> PacketSource for PcapPackets<R> {
    fn next_packet(&mut self) -> Result<Option<DataPacket<'_>>, AdcError> {
        loop {
            match self.pcap.next_udp(&mut self.datagram)? {
                None => return Ok(None),
                Some(CapturedUdp {
                    destination_port,
                    is_whole,
                }) => {
                    if destination_port != DATA_PORT {
                        continue;
                    }
                    if is_whole && DataPacket::parse(&self.datagram).is_ok() {
                        break;
                    }
                    self.skipped += 1;
                }
            }
        }
        // The datagram is parsed twice, because a loop cannot return a borrow of its own iteration.
        Ok(DataPacket::parse(&self.datagram).ok())
    }

    fn skipped(&self) -> u64 {
        self.skipped
    }
}

/// Frames decoded from packets that the caller adds one by one.
pub struct FrameBuilder {
    assembler: Assembler,
    decoder: FrameDecoder,
    ready: VecDeque<AssembledFrame>,
}

impl FrameBuilder {
    /// Creates a builder of frames for `decoder`.
    ///
    /// # Errors
    /// As [`Assembler::new`].
    pub fn new(decoder: FrameDecoder) -> Result<Self, AdcError> {
        Ok(Self {
            assembler: Assembler::new(decoder.frame_bytes())?,
            decoder,
            ready: VecDeque::new(),
        })
    }

    /// Statistics of the transfer up to now.
    pub fn summary(&self) -> &TransferSummary {
        self.assembler.summary()
    }

    /// Adds a packet. Frames that cannot receive further data are ready afterwards.
    pub fn push(&mut self, packet: &DataPacket) {
        self.ready.extend(self.assembler.push(packet));
    }

    /// Makes frames ready of which every byte has arrived: [`Assembler::take_complete`].
    pub fn take_complete(&mut self) {
        self.ready.extend(self.assembler.take_complete());
    }

    /// Ends the transfer: [`Assembler::finish`].
    pub fn finish(&mut self) {
        self.ready.extend(self.assembler.finish());
    }

    /// Decodes the oldest frame that is ready.
    ///
    /// # Errors
    /// A cube of another shape than the decoder's.
    pub fn next_ready(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError> {
        let Some(frame) = self.ready.pop_front() else {
            return Ok(None);
        };
        self.decoder.decode(&frame.bytes, cube)?;
        Ok(Some(frame.integrity))
    }
}

/// Frames assembled from the packets of a source.
pub struct PacketFrames<S> {
    source: S,
    builder: FrameBuilder,
    is_finished: bool,
}

impl<S: PacketSource> PacketFrames<S> {
    /// Creates a source of frames for `decoder`.
    ///
    /// # Errors
    /// As [`Assembler::new`].
    pub fn new(source: S, decoder: FrameDecoder) -> Result<Self, AdcError> {
        Ok(Self {
            source,
            builder: FrameBuilder::new(decoder)?,
            is_finished: false,
        })
    }

    /// Statistics of the transfer up to now.
    pub fn summary(&self) -> &TransferSummary {
        self.builder.summary()
    }

    /// Source of the packets.
    pub fn source(&self) -> &S {
        &self.source
    }
}

impl<S: PacketSource> FrameSource for PacketFrames<S> {
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError> {
        loop {
            if let Some(integrity) = self.builder.next_ready(cube)? {
                return Ok(Some(integrity));
            }
            if self.is_finished {
                return Ok(None);
            }
            match self.source.next_packet()? {
                Some(packet) => self.builder.push(&packet),
                None => {
                    self.is_finished = true;
                    self.builder.finish();
                }
            }
        }
    }

    fn trailing_bytes(&self) -> usize {
        self.summary().trailing_bytes
    }
}
