//! A DCA1000 capture card on the network: packets to cubes to points, frame by frame.

use std::{
    net::{IpAddr, SocketAddr},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use radarllm_base::{Provenance, RadarCube, SourceInfo, message::text};
use radarllm_formats::{
    adc::{CubeShape, FrameDecoder, LvdsLanes, SampleLayout},
    dca1000::{FrameBuilder, TransferSummary},
};
use radarllm_radar_dsp::{Corrector, PointExtractor};

use super::{
    LiveCounts, LiveEvent, LiveSource, LiveTimeouts,
    card::{CONTROL_PORT, Starting},
    deadline,
    output::{Clock, FrameContent, Output},
};
use crate::{
    cleaning,
    error::{Error, Result},
    layout::choose_layout,
    opened::Opened,
    options::{CaptureOptions, DEFAULT_RADAR_HEIGHT_M, refuse_options},
    placing::Placing,
    samples::SampleFiles,
    udp::{self, SYSTEM_BUFFER_BYTES, UdpPackets},
};

/// Number of late packets in a row after which the card has started to count anew: all that can be reordered.
const LATE_PACKETS: u32 = 64;

/// Options of a [`Dca1000`].
#[derive(Clone, Debug, Default)]
pub struct DcaOptions {
    /// Where packets arrive: `udp:`, `udp:PORT` or `udp:ADDRESS:PORT` of this machine.
    pub input: String,
    /// Address of the card, the only sender whose packets are used. Without it, that is the first sender.
    pub card: Option<IpAddr>,
    /// Configures the card and starts it, when it is opened and whenever it was lost. Needs `card`.
    pub configure: bool,
    /// Radar, layout and signal chain, as for a recording of raw samples.
    pub capture: CaptureOptions,
    /// After how long the source acts.
    pub timeouts: LiveTimeouts,
}

/// A DCA1000 capture card.
pub struct Dca1000 {
    input: PathBuf,
    address: SocketAddr,
    card: Option<IpAddr>,
    /// Addresses of the commands: the card's and ours. `None` if the card is not configured by us.
    control: Option<[SocketAddr; 2]>,
    timeouts: LiveTimeouts,
    about: SourceInfo,
    notes: Vec<String>,
    shape: CubeShape,
    layout: SampleLayout,
    corrector: Corrector,
    extractor: PointExtractor,

    link: Link,
    builder: FrameBuilder,
    cube: RadarCube,
    output: Output,
    /// Configuration of the card while it is lost.
    setup: Option<Setup>,
    /// Number of packets in a row that were too late for any open frame.
    n_late: u32,
    last_packet: Instant,
    /// How often the card began to count anew.
    n_restarts: u64,
    /// How often the card refused a command, or did not answer, after it was lost.
    n_refused: u64,
    /// Datagrams skipped by the sockets before the present one.
    skipped_before: u64,
}

/// How a lost card is started again.
enum Setup {
    Waiting { start_at: Instant },
    Running(Box<Starting>),
}

/// State of the socket.
enum Link {
    Closed { reopen_at: Instant },
    Open(UdpPackets),
}

impl Dca1000 {
    /// Plans the signal chain and binds the socket.
    ///
    /// # Errors
    /// A missing radar, an unknown order of I and Q, options that do not fit, or an address that cannot be bound.
    pub fn open(options: DcaOptions) -> Result<Self> {
        let DcaOptions {
            input,
            card,
            configure,
            capture,
            timeouts,
        } = options;
        let address = udp::address(&input)
            .ok_or_else(|| Error::input(format!("{input}: no address of packets")))?
            .map_err(Error::input)?;
        let input = PathBuf::from(input);
        let radar = capture.radar.as_ref().ok_or_else(|| {
            Error::input(text("raw samples need ").option("radar"))
                .with_hint("the radar that sends them")
        })?;
        let config = radar.sample_config()?;
        let points = &capture.points;
        points.check_for_samples()?;
        refuse_options(
            &[("frames", capture.max_frames.is_some())],
            "has no meaning for a running card",
        )?;
        let mut notes = Vec::new();
        let corrector = cleaning::corrector(
            &capture.cleaning,
            radar,
            capture.format,
            &capture.layout,
            &mut notes,
        )?;
        let dsp = capture.processing.clone().unwrap_or_default();
        let extractor = PointExtractor::new(config, cleaning::chain(&capture.cleaning, dsp))?;
        let inputs = std::slice::from_ref(&input);
        let files = SampleFiles::new(Opened::samples(inputs, None)?)?;
        let chosen = choose_layout(&files, radar, &capture.layout)?;
        notes.extend(chosen.notes);
        let shape = CubeShape::of(config);
        let packets = bind(&input, address, card)?;
        if let Some(granted) = packets.system_buffer_bytes()
            && granted < SYSTEM_BUFFER_BYTES
        {
            notes.push(format!(
                "the system buffers {granted} bytes of packets; `sysctl -w net.core.rmem_max={SYSTEM_BUFFER_BYTES}` allows enough for pauses"
            ));
        }
        let control = match (configure, card) {
            (false, _) => None,
            (true, Some(card)) => Some([
                SocketAddr::new(card, CONTROL_PORT),
                SocketAddr::new(address.ip(), CONTROL_PORT),
            ]),
            (true, None) => {
                return Err(Error::input("a card that is configured needs its address"));
            }
        };
        if let Some([card, here]) = control {
            start_whole(card, here, chosen.layout.lanes, &timeouts)
                .map_err(|e| Error::input(format!("the card at {card}: {e}")).caused_by(e))?;
        }
        let placing = Placing::new(points, points.mounting()?, config.frame_rate_hz(), None)?;
        Ok(Self {
            address: packets.local_address(),
            card,
            control,
            timeouts,
            about: SourceInfo {
                frame_period_s: config.frame_period_s,
                radar: config.name.clone(),
                radar_height_m: capture.radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
                is_height_assumed: capture.radar_height_m.is_none(),
                clutter: points.clutter(),
                provenance: Provenance::Recorded {
                    format: None,
                    path: input.display().to_string(),
                },
            },
            input,
            notes,
            shape,
            layout: chosen.layout,
            corrector,
            extractor,
            output: Output::new(Clock::PeriodS(config.frame_period_s), placing, &timeouts),
            link: Link::Open(packets),
            builder: FrameBuilder::new(FrameDecoder::new(shape, chosen.layout)?)?,
            cube: shape.zeros()?,
            setup: None,
            n_late: 0,
            last_packet: Instant::now(),
            n_restarts: 0,
            n_refused: 0,
            skipped_before: 0,
        })
    }

    /// Local address at which packets are received.
    pub fn local_address(&self) -> SocketAddr {
        self.address
    }

    /// Does what is due, waiting until `until` at most.
    fn step(&mut self, until: Instant) -> Result {
        let until = self.step_setup(until);
        let now = Instant::now();
        let lost_at = self.last_packet.checked_add(self.timeouts.lost);
        let lost_at = lost_at.filter(|_| !self.output.is_lost());
        let packets = match &mut self.link {
            Link::Open(packets) => packets,
            Link::Closed { reopen_at } if now < *reopen_at => {
                let wait = until.min(*reopen_at).saturating_duration_since(now);
                std::thread::sleep(wait);
                return Ok(());
            }
            Link::Closed { .. } => {
                match bind(&self.input, self.address, self.card) {
                    Ok(packets) => self.link = Link::Open(packets),
                    Err(error) => self.close(&error.to_string())?,
                }
                return Ok(());
            }
        };
        let wait = lost_at.map_or(until, |at| at.min(until));
        match packets.receive(wait.saturating_duration_since(now)) {
            Ok(Some(packet)) => {
                let before = self.builder.summary();
                let (late, unused) = (before.late, n_unused(before));
                self.builder.push(&packet);
                self.builder.take_complete();
                let after = self.builder.summary();
                self.n_late = match after.late > late {
                    true => self.n_late + 1,
                    false => 0,
                };
                if n_unused(after) == unused {
                    self.last_packet = Instant::now();
                }
                self.give_ready()?;
                if self.n_late >= LATE_PACKETS {
                    self.n_restarts += 1;
                    self.end_transfer()?;
                }
            }
            Ok(None) => {}
            Err(error) => return self.close(&error.to_string()),
        }
        let lost_at = self.last_packet.checked_add(self.timeouts.lost);
        if !self.output.is_lost() && lost_at.is_some_and(|at| Instant::now() >= at) {
            let seconds = self.timeouts.lost.as_secs_f64();
            self.lose(&format!("no packets of a card for {seconds} s"))?;
        }
        Ok(())
    }

    fn lose(&mut self, reason: &str) -> Result {
        self.end_transfer()?;
        if !self.output.is_lost() && self.control.is_some() {
            let start_at = self.output.next_try();
            self.setup = Some(Setup::Waiting { start_at });
        }
        self.output.lose(self.input.display(), reason);
        if let Link::Open(packets) = &self.link {
            packets.forget_sender();
        }
        Ok(())
    }

    /// Starts a lost card again. Returns when to go on at the latest.
    fn step_setup(&mut self, until: Instant) -> Instant {
        let Some([card, here]) = self.control.filter(|_| self.output.is_lost()) else {
            self.setup = None;
            return until;
        };
        match self.setup.take() {
            None => return until,
            Some(Setup::Waiting { start_at }) if Instant::now() < start_at => {
                self.setup = Some(Setup::Waiting { start_at });
                return until.min(start_at);
            }
            Some(Setup::Waiting { .. }) => {
                let (lanes, answer) = (self.layout.lanes, self.timeouts.answer);
                if let Ok(starting) = Starting::open(card, here, lanes, answer) {
                    self.setup = Some(Setup::Running(starting.into()));
                    return until;
                }
            }
            Some(Setup::Running(mut starting)) => match starting.step(until) {
                Ok(false) => {
                    self.setup = Some(Setup::Running(starting));
                    return until;
                }
                Ok(true) => {
                    // Unless packets follow, the card is started again.
                    let now = Instant::now();
                    let start_at = now.checked_add(self.timeouts.lost).unwrap_or(now);
                    self.setup = Some(Setup::Waiting { start_at });
                    return until.min(start_at);
                }
                Err(_) => self.n_refused += 1,
            },
        }
        let start_at = self.output.next_try();
        self.setup = Some(Setup::Waiting { start_at });
        until.min(start_at)
    }

    /// Closes a socket that failed, to be bound again later.
    fn close(&mut self, reason: &str) -> Result {
        self.skipped_before = self.skipped();
        let reopen_at = self.output.next_try();
        self.link = Link::Closed { reopen_at };
        self.lose(reason)
    }

    fn skipped(&self) -> u64 {
        use radarllm_formats::dca1000::PacketSource as _;
        self.skipped_before
            + match &self.link {
                Link::Open(packets) => packets.skipped(),
                Link::Closed { .. } => 0,
            }
    }

    /// Gives out what is complete. The next packet may count from anywhere, as after a restart of the card.
    fn end_transfer(&mut self) -> Result {
        self.builder.finish();
        self.give_ready()?;
        self.builder = FrameBuilder::new(FrameDecoder::new(self.shape, self.layout)?)?;
        self.n_late = 0;
        self.output.interrupt();
        Ok(())
    }

    /// Processes the frames that are ready.
    fn give_ready(&mut self) -> Result {
        while let Some(integrity) = self.builder.next_ready(&mut self.cube)? {
            self.corrector.apply(&mut self.cube)?;
            let frame = self.extractor.extract(&self.cube)?;
            let content = FrameContent {
                points: frame.points,
                board: None,
            };
            self.output.give(integrity.frame, content);
        }
        Ok(())
    }
}

impl LiveSource for Dca1000 {
    fn next(&mut self, timeout: Duration) -> Result<Option<LiveEvent>> {
        let until = deadline(timeout);
        loop {
            if let Some(event) = self.output.next_event() {
                return Ok(Some(event));
            }
            self.step(until)?;
            if Instant::now() >= until {
                return Ok(self.output.next_event());
            }
        }
    }

    fn about(&self) -> SourceInfo {
        self.about.clone()
    }

    fn counts(&self) -> LiveCounts {
        let counts = self.output.counts();
        LiveCounts {
            resynchronisations: self.n_restarts + counts.resynchronisations,
            foreign_datagrams: self.skipped(),
            refused_lines: self.n_refused,
            ..counts
        }
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}

/// Configures and starts the card.
fn start_whole(
    card: SocketAddr,
    here: SocketAddr,
    lanes: LvdsLanes,
    timeouts: &LiveTimeouts,
) -> std::io::Result<()> {
    let mut starting = Starting::open(card, here, lanes, timeouts.answer)?;
    while !starting.step(Instant::now() + timeouts.answer)? {}
    Ok(())
}

/// Number of packets that added nothing to a frame.
fn n_unused(summary: &TransferSummary) -> u64 {
    summary.late + summary.refused + summary.duplicates
}

fn bind(input: &Path, address: SocketAddr, card: Option<IpAddr>) -> Result<UdpPackets> {
    UdpPackets::bind_for(address, card).map_err(|e| Error::io(input, e))
}
