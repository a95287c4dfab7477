//! Recordings of raw samples: detection of the file format, and frames one by one.

use std::{
    fs::File,
    io::{BufReader, Read},
    path::PathBuf,
};

use radarllm_base::{RadarConfig, RadarCube, message::option};
use radarllm_formats::{
    RecordingFormat,
    adc::{
        AdcError, AdcReader, Chained, CubeShape, FrameDecoder, FrameIntegrity, FrameSource,
        SampleLayout,
    },
    dca1000::{
        PacketFrames, PacketSource, PcapPackets, RecordReader, TransferSummary, starts_with_record,
    },
    pcap,
};

use crate::{
    error::{Error, Result},
    npy_cubes::NpyFrames,
    options::CaptureFormat,
    udp::{self, UdpPackets},
};

/// Storage format of raw samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFormat {
    /// A NumPy array.
    Npy,
    /// Sample words without packets: `adc_data.bin`.
    Adc,
    /// DCA1000 packets in a file, each preceded by a header of 14 bytes.
    Records,
    /// DCA1000 packets in a pcap or pcapng file.
    Pcap,
    /// DCA1000 packets from the network.
    Udp,
}

impl SampleFormat {
    /// Name of the format for reports.
    pub fn name(self) -> &'static str {
        match self {
            SampleFormat::Npy => "npy",
            SampleFormat::Adc => "adc",
            SampleFormat::Records => "dca1000 records",
            SampleFormat::Pcap => "dca1000 pcap",
            SampleFormat::Udp => "dca1000 live",
        }
    }
}

/// Returns the format of raw samples, as named or as detected from the first bytes.
///
/// # Errors
/// A file that cannot be read, that does not begin like the named format, or that is in none of the known formats.
pub fn sample_format(captures: &[PathBuf], named: Option<CaptureFormat>) -> Result<SampleFormat> {
    let first = captures
        .first()
        .ok_or_else(|| Error::input("no capture is named"))?;
    if udp::address(&first.to_string_lossy()).is_some() {
        return Ok(SampleFormat::Udp);
    }
    let mut start = Vec::new();
    File::open(first)
        .and_then(|file| file.take(16).read_to_end(&mut start))
        .map_err(|e| Error::io(first, e))?;
    let found = if start.starts_with(b"\x93NUMPY") {
        Some(SampleFormat::Npy)
    } else if starts_with_record(&start) {
        Some(SampleFormat::Records)
    } else if pcap::is_magic(&start) {
        Some(SampleFormat::Pcap)
    } else {
        None
    };
    let unlike = |format: &str| Error::in_file(first, format!("does not begin like {format}"));
    let format_reads = |read: &'static str| option("format").text(read);
    match (named, found) {
        (Some(CaptureFormat::Npy), Some(SampleFormat::Npy)) => Ok(SampleFormat::Npy),
        (Some(CaptureFormat::Npy), _) => Err(unlike("an npy file")),
        (Some(CaptureFormat::Format(RecordingFormat::Adc)), found) => match found {
            Some(SampleFormat::Npy) => {
                Err(unlike("raw words, but an npy file").with_hint(format_reads(" npy reads it")))
            }
            Some(SampleFormat::Records) => Ok(SampleFormat::Records),
            _ => Ok(SampleFormat::Adc),
        },
        (Some(CaptureFormat::Format(RecordingFormat::Dca1000)), found) => match found {
            Some(format @ (SampleFormat::Records | SampleFormat::Pcap)) => Ok(format),
            _ => Err(
                unlike("packets: neither pcap nor records").with_hint(format_reads(
                    " adc reads adc_data.bin; udp:PORT listens to the card",
                )),
            ),
        },
        (Some(other), _) => Err(Error::input(
            option("format").text(format!(" {}: not a format of raw samples", other.name())),
        )
        .with_hint("adc, dca1000 and npy are")),
        (None, Some(format)) => Ok(format),
        (None, None) => match first.extension().and_then(|e| e.to_str()) {
            Some("bin") => Ok(SampleFormat::Adc),
            _ => Err(Error::in_file(
                first,
                "neither npy nor pcap nor records of packets, and not named .bin",
            )
            .with_hint(format_reads(" adc reads any file as raw words"))),
        },
    }
}

/// Frames of a recording of raw samples, in their order.
pub enum SampleFrames {
    /// Frames of a NumPy array.
    Npy(Box<NpyFrames>),
    /// Frames of raw words.
    Adc(AdcReader<Input>),
    /// Frames of packets in a file.
    Records(PacketFrames<RecordReader<Input>>),
    /// Frames of packets in a pcap file.
    Pcap(PacketFrames<PcapPackets<Input>>),
    /// Frames of packets from the network.
    Udp(PacketFrames<UdpPackets>),
}

/// Several files read as one stream.
pub type Input = BufReader<Chained<File>>;

fn open_files(captures: &[PathBuf]) -> Result<Input> {
    let mut files = Vec::new();
    for path in captures {
        files.push(File::open(path).map_err(|e| Error::io(path, e))?);
    }
    Ok(BufReader::with_capacity(1 << 18, Chained::new(files)))
}

impl SampleFrames {
    /// Opens a NumPy array whose axes are `axes`, or `frame,loop,tx,rx,sample` if `None`.
    ///
    /// # Errors
    /// A file that cannot be read, or an array that does not fit the radar.
    pub fn open_npy(captures: &[PathBuf], radar: &RadarConfig, axes: Option<&str>) -> Result<Self> {
        let [path] = captures else {
            return Err(Error::input("npy arrays are read one at a time"));
        };
        Ok(Self::Npy(Box::new(NpyFrames::open(path, radar, axes)?)))
    }

    /// Opens raw words or packets with a known layout.
    ///
    /// # Errors
    /// A file that cannot be read, an address that cannot be bound, or a layout that does not fit the shape.
    pub fn open_raw(
        format: SampleFormat,
        captures: &[PathBuf],
        shape: CubeShape,
        layout: SampleLayout,
    ) -> Result<Self> {
        let decoder = FrameDecoder::new(shape, layout)?;
        Ok(match format {
            SampleFormat::Adc => Self::Adc(AdcReader::new(open_files(captures)?, decoder)),
            SampleFormat::Records => {
                let records = RecordReader::new(open_files(captures)?);
                Self::Records(PacketFrames::new(records, decoder)?)
            }
            SampleFormat::Pcap => {
                only_one(captures)?;
                let packets = PcapPackets::new(open_files(captures)?)?;
                Self::Pcap(PacketFrames::new(packets, decoder)?)
            }
            SampleFormat::Udp => {
                only_one(captures)?;
                let input = captures[0].to_string_lossy();
                let address = udp::address(&input)
                    .ok_or_else(|| Error::input(format!("{input}: no address")))?
                    .map_err(Error::input)?;
                let packets = UdpPackets::bind(address).map_err(|e| Error::io(&captures[0], e))?;
                Self::Udp(PacketFrames::new(packets, decoder)?)
            }
            SampleFormat::Npy => return Err(Error::input("an npy array has no raw words")),
        })
    }

    /// Local address at which packets are received, for live captures.
    pub fn listening_address(&self) -> Option<std::net::SocketAddr> {
        match self {
            Self::Udp(f) => Some(f.source().local_address()),
            _ => None,
        }
    }

    /// Number of live packets that were lost because they arrived faster than they were processed.
    pub fn overruns(&self) -> u64 {
        match self {
            Self::Udp(f) => f.source().overruns(),
            _ => 0,
        }
    }

    /// Statistics of the packets, if the recording has any, and the number of datagrams or records that were not
    /// packets.
    pub fn transfer(&self) -> Option<(&TransferSummary, u64)> {
        match self {
            Self::Npy(_) | Self::Adc(_) => None,
            Self::Records(f) => Some((f.summary(), f.source().skipped())),
            Self::Pcap(f) => {
                let cut = u64::from(f.source().pcap().cut_bytes() > 0);
                Some((f.summary(), f.source().skipped() + cut))
            }
            Self::Udp(f) => Some((f.summary(), f.source().skipped())),
        }
    }
}

impl FrameSource for SampleFrames {
    fn next_frame(
        &mut self,
        cube: &mut RadarCube,
    ) -> std::result::Result<Option<FrameIntegrity>, AdcError> {
        match self {
            Self::Npy(f) => f.next_frame(cube),
            Self::Adc(f) => f.next_frame(cube),
            Self::Records(f) => f.next_frame(cube),
            Self::Pcap(f) => f.next_frame(cube),
            Self::Udp(f) => f.next_frame(cube),
        }
    }

    fn trailing_bytes(&self) -> usize {
        match self {
            Self::Npy(f) => f.trailing_bytes(),
            Self::Adc(f) => f.trailing_bytes(),
            Self::Records(f) => f.trailing_bytes(),
            Self::Pcap(f) => f.trailing_bytes(),
            Self::Udp(f) => f.trailing_bytes(),
        }
    }
}

fn only_one(captures: &[PathBuf]) -> Result {
    match captures {
        [_] => Ok(()),
        _ => Err(Error::input(format!(
            "{} captures: only raw words and records can be split over files",
            captures.len()
        ))),
    }
}
