//! A running radar, put together.

use std::any::Any;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use radarllm::{Captioner, Error, Result};
use radarllm_base::Provenance;
use radarllm_serve::Clock;
use radarllm_serve::bus::{Bus, Reader};
use radarllm_serve::http::{self, Server, Sources, Token};
use radarllm_serve::keeper::{self, Keeper, now_ms};
use radarllm_serve::messages::{self, About};
use radarllm_serve::metrics::Metrics;
use radarllm_serve::mqtt::{self, Publisher};
use radarllm_serve::pipeline::{Pipeline, PipelineOptions};
use radarllm_serve::queue::{FrameQueue, Item};
use radarllm_serve::store::{Origin, Retention};
use radarllm_serve::vitals::Vitals;
use radarllm_serve::zones::Zones;

use crate::captions::{Captions, actions};
use crate::input::Input;
use crate::local_time;
use crate::zones::kind_name;

/// Port of the page.
pub const PORT: u16 = 8_741;
/// How often the pipeline reports that it lives while no frame arrives.
const STEP: Duration = Duration::from_millis(200);
/// Falls that were acknowledged and wait for the next frame. More are refused.
const MAX_ACKNOWLEDGED: usize = 64;

/// The page and its server.
#[derive(Clone, Debug)]
pub struct Page {
    /// Address. One that is not loopback needs a token.
    pub address: SocketAddr,
    /// Secret of those who may look.
    pub token: Option<Token>,
    /// Names under which the server is reached, beside loopback and its address.
    pub allow_hosts: Vec<String>,
    /// Origins whose pages may show this one in a frame.
    pub allow_frames: Vec<String>,
}

impl Default for Page {
    fn default() -> Self {
        Self {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), PORT),
            token: None,
            allow_hosts: Vec::new(),
            allow_frames: Vec::new(),
        }
    }
}

/// An MQTT broker.
#[derive(Clone, Debug)]
pub struct Broker {
    /// Address.
    pub address: mqtt::Address,
    /// User name.
    pub user: Option<String>,
    /// Password.
    pub password: Option<mqtt::Password>,
    /// First part of the topics of discovery.
    pub discovery_prefix: String,
    /// Whether a simulated radar may be published.
    pub allow_synthetic: bool,
}

/// Options of a running radar.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// Name of this radar: `[a-z0-9_]{1,32}`.
    pub name: String,
    /// The page; `None` for none.
    pub page: Option<Page>,
    /// The database; `None` keeps nothing.
    pub database: Option<PathBuf>,
    /// What the database keeps for how long.
    pub retention: Retention,
    /// The broker; `None` for none.
    pub broker: Option<Broker>,
    /// Zones of the room.
    pub zones: Zones,
    /// Length of the windows that are described, s.
    pub window_s: f64,
    /// Time between the starts of two windows, s.
    pub stride_s: f64,
    /// Time in which the empty room is learnt, s; 0 to learn nothing.
    pub learn_empty_s: f64,
    /// Time for which somebody must be tracked before the room counts as occupied, s.
    pub occupancy_on_s: f64,
    /// Time for which occupancy is held while nobody is tracked, s.
    pub occupancy_hold_s: f64,
    /// Time for which a person must not rise before a fall is confirmed, s.
    pub fall_dwell_s: f64,
    /// Height below which somebody is down, m above the floor.
    pub fall_height_m: f64,
}

impl Default for LiveOptions {
    fn default() -> Self {
        let PipelineOptions {
            watch,
            windows,
            learn_empty_s,
            ..
        } = PipelineOptions::new(1.0);
        Self {
            name: "radar".into(),
            page: Some(Page::default()),
            database: None,
            retention: Retention::default(),
            broker: None,
            zones: Zones::default(),
            window_s: windows.window_s,
            stride_s: windows.stride_s,
            learn_empty_s,
            occupancy_on_s: watch.presence.occupancy_on_s,
            occupancy_hold_s: watch.presence.occupancy_hold_s,
            fall_dwell_s: watch.falls.fall_dwell_s,
            fall_height_m: watch.falls.fall_height_m,
        }
    }
}

/// A running radar. When it is dropped, the last windows are described, everything is written, and the broker hears
/// `offline`.
pub struct Live {
    queue: Arc<FrameQueue>,
    bus: Arc<Bus>,
    metrics: Arc<Metrics>,
    vitals: Arc<Vitals>,
    /// Why the source has ended, if it did so by an error.
    problem: Arc<Mutex<Option<Error>>>,
    pipeline: Option<JoinHandle<()>>,
    source: Option<JoinHandle<()>>,
    publisher: Option<Publisher>,
    server: Option<Server>,
    /// Where a damaged database was moved.
    damaged_database: Option<PathBuf>,
}

impl Live {
    /// Starts all threads.
    ///
    /// # Errors
    /// Options out of range, a database that cannot be opened, an address on which one cannot listen, an address other
    /// than loopback without a token, and a broker for a simulated radar that is not allowed.
    pub fn start(input: Input, captioner: Captioner, options: LiveOptions) -> Result<Self> {
        Self::start_and_listen(input, captioner, options).map(|(live, _)| live)
    }

    /// As [`Self::start`], with a reader of all messages from the first one on.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_and_listen(
        input: Input,
        captioner: Captioner,
        options: LiveOptions,
    ) -> Result<(Self, Reader)> {
        mqtt::validate_name(&options.name).map_err(Error::wrap)?;
        let stream = input.stream.clone();
        let mut pipeline_options = PipelineOptions::new(stream.radar_height_m);
        pipeline_options.watch.zones = options.zones.clone();
        if options.stride_s > options.window_s {
            let [stride_s, window_s] = [options.stride_s, options.window_s];
            return Err(Error::input(format!(
                "the stride of {stride_s} s is longer than the window of {window_s} s, so that nobody would be described in between"
            )));
        }
        pipeline_options.windows.window_s = options.window_s;
        pipeline_options.windows.least_s = options.window_s.min(pipeline_options.windows.least_s);
        pipeline_options.windows.stride_s = options.stride_s;
        pipeline_options.learn_empty_s = options.learn_empty_s;
        pipeline_options.watch.presence.occupancy_on_s = options.occupancy_on_s;
        pipeline_options.watch.presence.occupancy_hold_s = options.occupancy_hold_s;
        pipeline_options.watch.falls.fall_dwell_s = options.fall_dwell_s;
        pipeline_options.watch.falls.fall_height_m = options.fall_height_m;
        let about = about(&input, captioner.name(), &options);
        let (metrics, bus) = (Arc::<Metrics>::default(), Arc::new(Bus::new(about)));
        let vitals = Arc::new(Vitals::new(Duration::from_secs_f64(stream.frame_period_s)));
        let pipeline = Pipeline::new(
            stream,
            &pipeline_options,
            Box::new(Captions(captioner)),
            Arc::clone(&metrics),
        )
        .map_err(Error::wrap)?;
        let (store, damaged_database) = match &options.database {
            Some(path) => {
                let (store, damaged) = keeper::open(path).map_err(Error::wrap)?;
                (Some(store), damaged)
            }
            None => (None, None),
        };
        let publisher = match &options.broker {
            Some(broker) => Some(publish(broker, &bus)?),
            None => None,
        };
        let keeper = Keeper::start(
            store,
            options.retention,
            Arc::clone(&bus),
            Arc::clone(&metrics),
            publisher.as_ref().map(Publisher::status),
        )
        .map_err(Error::wrap)?;
        let (acknowledge, acknowledged) = sync_channel(MAX_ACKNOWLEDGED);
        let server = match &options.page {
            Some(page) => {
                let mut server = http::Options::new(page.address);
                server.token = page.token.clone();
                server.allow_hosts = page.allow_hosts.clone();
                server.allow_frames = page.allow_frames.clone();
                let sources = Sources {
                    bus: Arc::clone(&bus),
                    metrics: Arc::clone(&metrics),
                    vitals: Arc::clone(&vitals),
                    database: options.database.clone(),
                    forget: keeper.forget(),
                    broker: publisher.as_ref().map(Publisher::status),
                    acknowledge: Some(Arc::new(move |fall| acknowledge.try_send(fall).is_ok())),
                    clock: Arc::new(clock),
                };
                Some(Server::start(server, sources).map_err(Error::wrap)?)
            }
            None => None,
        };
        let messages = bus.subscribe();
        let queue = Arc::new(FrameQueue::new(input.when_full(), Arc::clone(&metrics)));
        let problem = Arc::new(Mutex::new(None));
        let pipeline = {
            let (queue, vitals) = (Arc::clone(&queue), Arc::clone(&vitals));
            // The keeper is dropped with the thread's last values, so that everything is written before the thread counts as
            // finished, also after a panic.
            spawn("radarllm-pipeline", move || {
                run_pipeline(pipeline, &queue, &acknowledged, &keeper, &vitals);
            })?
        };
        let source = {
            let (queue, metrics) = (Arc::clone(&queue), Arc::clone(&metrics));
            let vitals = Arc::clone(&vitals);
            let problem = Arc::clone(&problem);
            spawn("radarllm-source", move || {
                let _end = EndOnPanic(Arc::clone(&queue));
                let ended = input.run(&queue, &vitals, &metrics);
                *lock(&problem) = ended.err();
            })?
        };
        let live = Self {
            queue,
            bus,
            metrics,
            vitals,
            problem,
            pipeline: Some(pipeline),
            source: Some(source),
            publisher,
            server,
            damaged_database,
        };
        Ok((live, messages))
    }

    /// The address of the page, with the port that the operating system chose if none was asked for.
    pub fn address(&self) -> Option<SocketAddr> {
        self.server.as_ref().map(Server::address)
    }

    /// A new reader of all messages.
    pub fn subscribe(&self) -> Reader {
        self.bus.subscribe()
    }

    /// The counters.
    pub fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    /// Why the broker is not connected, if there is one and it is not.
    pub fn broker_problem(&self) -> Option<String> {
        self.publisher.as_ref()?.problem()
    }

    /// Why the memory cannot be written, if there is one and it cannot.
    pub fn memory_problem(&self) -> Option<String> {
        self.metrics.store_problem()
    }

    /// Whether the pipeline moves. A silent radar does not stop it; a supervisor should start a program anew that has
    /// stopped.
    pub fn is_moving(&self) -> bool {
        self.vitals.is_moving()
    }

    /// Where a damaged database was moved when a new one was made.
    pub fn damaged_database(&self) -> Option<&PathBuf> {
        self.damaged_database.as_ref()
    }

    /// Whether the source has ended and everything of it was described and written, or a thread panicked.
    pub fn is_over(&self) -> bool {
        self.pipeline.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Stops, as when this is dropped.
    ///
    /// # Errors
    /// Why the source has ended, if it did so by an error.
    ///
    /// # Panics
    /// If the source or the pipeline panicked.
    pub fn stop(mut self) -> Result<()> {
        if let Some(panic) = self.end() {
            resume_unwind(panic);
        }
        match lock(&self.problem).take() {
            Some(problem) => Err(problem),
            None => Ok(()),
        }
    }

    /// Ends all threads. Returns the panic of one.
    fn end(&mut self) -> Option<Box<dyn Any + Send>> {
        self.queue.close();
        let threads = [self.source.take(), self.pipeline.take()];
        let [source, pipeline] = threads.map(|thread| thread?.join().err());
        if let Some(publisher) = self.publisher.take() {
            publisher.stop();
        }
        self.bus.close();
        drop(self.server.take());
        source.or(pipeline)
    }
}

/// Ends the stream if the thread of the source panics, so that nobody waits for its frames.
struct EndOnPanic(Arc<FrameQueue>);

impl Drop for EndOnPanic {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.push(Item::End);
        }
    }
}

/// A panic of another thread while it held the lock leaves a value that is complete.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Drop for Live {
    fn drop(&mut self) {
        // A panic of a thread was printed by it.
        self.end();
    }
}

fn run_pipeline(
    mut pipeline: Pipeline,
    queue: &FrameQueue,
    acknowledged: &Receiver<u64>,
    keeper: &Keeper,
    vitals: &Vitals,
) {
    loop {
        for fall in acknowledged.try_iter() {
            let outputs = pipeline.acknowledge(fall);
            outputs.into_iter().for_each(|output| keeper.take(output));
        }
        let outputs = match queue.pop(STEP) {
            Some(Item::Frame(queued)) => {
                pipeline.frame(queued.frame, queued.arrival, !queue.is_late())
            }
            Some(Item::Lost { at_ms, reason }) => pipeline.lost(at_ms, &reason),
            Some(Item::Back { at_ms }) => pipeline.back(at_ms),
            Some(Item::End) => break,
            None if queue.is_closed() => break,
            None => Vec::new(),
        };
        vitals.step();
        outputs.into_iter().for_each(|output| keeper.take(output));
    }
    pipeline
        .end()
        .into_iter()
        .for_each(|output| keeper.take(output));
}

fn about(input: &Input, model: &str, options: &LiveOptions) -> About {
    let stream = &input.stream;
    let zone = |zone: &radarllm_serve::zones::Zone| messages::Zone {
        name: zone.name.clone(),
        kind: kind_name(zone.kind).into(),
        polygon_m: zone.polygon_m.clone(),
    };
    About {
        name: options.name.clone(),
        origin: Origin {
            source: input.name.clone(),
            radar: stream.radar.clone(),
            model: model.into(),
            decoder: "vote".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            synthetic: matches!(stream.provenance, Provenance::Simulated { .. }),
        },
        radar_height_m: stream.radar_height_m,
        frame_period_s: stream.frame_period_s,
        zones: options.zones.all().iter().map(zone).collect(),
    }
}

fn publish(broker: &Broker, bus: &Arc<Bus>) -> Result<Publisher> {
    let mut options = mqtt::Options::new(broker.address.clone());
    options.user = broker.user.clone();
    options.password = broker.password.clone();
    options.discovery_prefix = broker.discovery_prefix.clone();
    options.allow_synthetic = broker.allow_synthetic;
    options.actions = actions();
    Publisher::start(options, Arc::clone(bus)).map_err(Error::wrap)
}

fn clock() -> Clock {
    let now_ms = now_ms();
    Clock {
        now_ms,
        offset_s: local_time::offset_s(now_ms),
    }
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let thread = thread::Builder::new().name(name.into());
    thread.spawn(run).map_err(Error::wrap)
}
