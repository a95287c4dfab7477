//! Recordings of raw samples: their files, and frames one by one.

use std::{
    fs::File,
    io::{BufReader, Seek},
    path::{Path, PathBuf},
};

use radarllm_base::{RadarConfig, RadarCube};
use radarllm_formats::{
    SampleFormat,
    adc::{
        AdcError, AdcReader, Chained, CubeShape, FrameDecoder, FrameIntegrity, FrameSource,
        SampleLayout,
    },
    dca1000::{PacketFrames, PacketSource, PcapPackets, RecordReader, TransferSummary},
};

use crate::{
    error::{Error, Result},
    npy_cubes::NpyFrames,
    opened::Opened,
    udp::{self, UdpPackets},
};

/// The files of a recording of raw samples, each opened once and read as often as needed.
pub struct SampleFiles {
    format: SampleFormat,
    captures: Vec<PathBuf>,
    /// None of packets from the network.
    files: Vec<File>,
}

impl SampleFiles {
    /// Opens the files that are not open yet.
    ///
    /// # Errors
    /// A file that cannot be read, or a capture that holds points.
    pub fn new(mut opened: Opened) -> Result<Self> {
        let format = opened.sample_format()?;
        Ok(Self {
            format,
            files: match format {
                SampleFormat::Udp => Vec::new(),
                _ => opened.take_all()?,
            },
            captures: opened.captures().to_vec(),
        })
    }

    /// The storage format.
    pub fn format(&self) -> SampleFormat {
        self.format
    }

    /// The path of the first file.
    pub fn path(&self) -> &Path {
        self.captures
            .first()
            .map_or(Path::new(""), PathBuf::as_path)
    }

    /// Size of all files, bytes.
    pub(crate) fn n_bytes(&self) -> Result<u64> {
        let mut n_bytes = 0_u64;
        for (path, file) in self.captures.iter().zip(&self.files) {
            let info = file.metadata().map_err(|e| Error::io(path, e))?;
            n_bytes = n_bytes.saturating_add(info.len());
        }
        Ok(n_bytes)
    }

    /// The only file, at its first byte.
    fn one(&self) -> Result<File> {
        let [file] = &self.files[..] else {
            return Err(Error::input("npy arrays are read one at a time"));
        };
        rewound(self.path(), file)
    }

    /// All files as one stream, from the first byte. Streams of the same files share their place, so that one must be
    /// done before the next begins.
    fn stream(&self) -> Result<Input> {
        let files = self.captures.iter().zip(&self.files);
        let files = files.map(|(path, file)| rewound(path, file));
        let files = files.collect::<Result<Vec<File>>>()?;
        Ok(BufReader::with_capacity(1 << 18, Chained::new(files)))
    }
}

/// The same file at its first byte.
fn rewound(path: &Path, file: &File) -> Result<File> {
    let mut same = file.try_clone().map_err(|e| Error::io(path, e))?;
    same.rewind().map_err(|e| Error::io(path, e))?;
    Ok(same)
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

impl SampleFrames {
    /// Begins to read a NumPy array whose axes are `axes`, or `frame,loop,tx,rx,sample` if `None`.
    ///
    /// # Errors
    /// A file that cannot be read, or an array that does not fit the radar.
    pub fn open_npy(files: &SampleFiles, radar: &RadarConfig, axes: Option<&str>) -> Result<Self> {
        let frames = NpyFrames::open(files.one()?, files.path(), radar, axes)?;
        Ok(Self::Npy(Box::new(frames)))
    }

    /// Begins to read raw words or packets with a known layout.
    ///
    /// # Errors
    /// A file that cannot be read, an address that cannot be bound, or a layout that does not fit the shape.
    pub fn open_raw(files: &SampleFiles, shape: CubeShape, layout: SampleLayout) -> Result<Self> {
        let decoder = FrameDecoder::new(shape, layout)?;
        let captures = &files.captures;
        Ok(match files.format {
            SampleFormat::Adc => Self::Adc(AdcReader::new(files.stream()?, decoder)),
            SampleFormat::Records => {
                let records = RecordReader::new(files.stream()?);
                Self::Records(PacketFrames::new(records, decoder)?)
            }
            SampleFormat::Pcap => {
                only_one(captures)?;
                let packets = PcapPackets::new(files.stream()?)?;
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
