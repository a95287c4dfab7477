//! A running radar, put together.

use std::any::Any;
use std::net::SocketAddr;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use radarllm::{Captioner, Error, Result};
use radarllm_base::Provenance;
use radarllm_memory::Clock;
use radarllm_memory::store::Retention;
use radarllm_monitor::liveness::Liveness;
use radarllm_monitor::messages::{self, About};
use radarllm_monitor::pipeline::{Output, Pipeline, PipelineOptions};
use radarllm_monitor::queue::{FrameQueue, Item, WhenFull};
use radarllm_monitor::rows::Origin;

use crate::bus::{Bus, Reader};
use crate::captions::{Captions, actions, without_frames};
use crate::http::{self, Server, Sources};
use crate::input::Input;
use crate::local_time::{self, now_ms};
use crate::metrics::Metrics;
use crate::mqtt::{self, Publisher};
use crate::store_writer::{self, StoreWriter};
use crate::zones::kind_name;

/// How often the pipeline reports that it lives while no frame arrives.
const STEP: Duration = Duration::from_millis(200);
/// Falls that were acknowledged and wait for the next frame. More are refused.
const MAX_ACKNOWLEDGED: usize = 64;

/// Options of a running radar.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// Name of this radar: `[a-z0-9_]{1,32}`.
    pub name: String,
    /// Options of the pipeline, and the zones of the room.
    pub pipeline: PipelineOptions,
    /// The page and its server; `None` for none.
    pub page: Option<http::Options>,
    /// The database; `None` keeps nothing.
    pub database: Option<PathBuf>,
    /// What the database keeps for how long.
    pub retention: Retention,
    /// The MQTT broker; `None` for none. Its `actions` are replaced by those that a sentence can state.
    pub broker: Option<mqtt::Options>,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            name: "radar".into(),
            pipeline: PipelineOptions::default(),
            page: Some(http::Options::default()),
            database: None,
            retention: Retention::default(),
            broker: None,
        }
    }
}

/// A running radar. When it is dropped, the last windows are described, everything is written, and the broker hears
/// `offline`.
pub struct Live {
    queue: Arc<FrameQueue>,
    bus: Arc<Bus>,
    metrics: Arc<Metrics>,
    liveness: Arc<Liveness>,
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
        let [stride_s, window_s] = [
            options.pipeline.windows.stride_s,
            options.pipeline.windows.window_s,
        ];
        if stride_s > window_s {
            return Err(Error::input(format!(
                "the stride of {stride_s} s is longer than the window of {window_s} s, so that nobody would be described in between"
            )));
        }
        captioner.check_site(&without_frames(&stream))?;
        let about = about(&input, captioner.name(), &options);
        let actions = actions(&captioner);
        let (metrics, bus) = (Arc::<Metrics>::default(), Arc::new(Bus::new(about)));
        let liveness = Arc::new(Liveness::new(Duration::from_secs_f64(
            stream.frame_period_s,
        )));
        let mut pipeline = Pipeline::new(
            stream,
            &options.pipeline,
            Box::new(Captions::new(captioner)),
            Arc::clone(&metrics.monitor),
        )
        .map_err(Error::wrap)?;
        let (store, damaged_database) = match &options.database {
            Some(path) => {
                let (store, damaged) = store_writer::open(path).map_err(Error::wrap)?;
                (Some(store), damaged)
            }
            None => (None, None),
        };
        // A recording is not the room as it is now.
        let is_running = input.when_full() == WhenFull::DropOldest;
        let restored = match store.as_ref().filter(|_| is_running) {
            Some(store) => {
                let now_ms = now_ms();
                // A memory that cannot be read is found when it is written.
                let origin = bus.about().origin;
                let falls = store_writer::open_falls(store.timeline(), &origin, now_ms);
                pipeline.restore(&falls.unwrap_or_default(), now_ms)
            }
            None => Vec::new(),
        };
        // Before anybody listens: they are a state, and no news.
        let mut events = Vec::new();
        for output in restored {
            match output {
                Output::Message(stamp, body) => bus.publish(stamp, body),
                other => events.push(other),
            }
        }
        let publish = |broker| {
            let broker = mqtt::Options { actions, ..broker };
            Publisher::start(broker, Arc::clone(&bus)).map_err(Error::wrap)
        };
        let publisher = options.broker.map(publish).transpose()?;
        let writer = StoreWriter::start(
            store,
            options.retention,
            Arc::clone(&bus),
            Arc::clone(&metrics),
            publisher.as_ref().map(Publisher::status),
        )
        .map_err(Error::wrap)?;
        events.into_iter().for_each(|event| writer.accept(event));
        let (acknowledge, acknowledged) = sync_channel(MAX_ACKNOWLEDGED);
        let server = match options.page {
            Some(page) => {
                let sources = Sources {
                    bus: Arc::clone(&bus),
                    metrics: Arc::clone(&metrics),
                    liveness: Arc::clone(&liveness),
                    database: options.database.clone(),
                    forget: writer.forget(),
                    broker: publisher.as_ref().map(Publisher::status),
                    acknowledge: Some(Arc::new(move |fall| acknowledge.try_send(fall).is_ok())),
                    clock: Arc::new(clock),
                };
                Some(Server::start(page, sources).map_err(Error::wrap)?)
            }
            None => None,
        };
        // A replay waits for the caller, as its source waits for the pipeline.
        let messages = match input.when_full() {
            WhenFull::Wait => bus.subscribe_awaited(),
            WhenFull::DropOldest => bus.subscribe(),
        };
        let queue = Arc::new(FrameQueue::new(
            input.when_full(),
            Arc::clone(&metrics.monitor),
        ));
        let problem = Arc::new(Mutex::new(None));
        let pipeline = {
            let (queue, liveness) = (Arc::clone(&queue), Arc::clone(&liveness));
            // The writer is dropped with the thread's last values, so that everything is written before the thread counts as
            // finished, also after a panic.
            spawn("radarllm-pipeline", move || {
                run_pipeline(pipeline, &queue, &acknowledged, &writer, &liveness);
            })?
        };
        let source = {
            let (queue, metrics) = (Arc::clone(&queue), Arc::clone(&metrics));
            let liveness = Arc::clone(&liveness);
            let problem = Arc::clone(&problem);
            spawn("radarllm-source", move || {
                let _end = EndOnPanic(Arc::clone(&queue));
                let ended = input.run(&queue, &liveness, &metrics);
                *lock(&problem) = ended.err();
            })?
        };
        let live = Self {
            queue,
            bus,
            metrics,
            liveness,
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
        self.metrics.store_problem.get()
    }

    /// Why the model could not describe the newest window, if it could not.
    pub fn model_problem(&self) -> Option<String> {
        self.metrics.monitor.model_problem.get()
    }

    /// What was learnt of the empty room, in words, if it was and learning has ended.
    pub fn room_learnt(&self) -> Option<&str> {
        self.metrics.monitor.room_learnt.get().map(String::as_str)
    }

    /// Why what arrives from the radar tells nothing, if it does not.
    pub fn source_problem(&self) -> Option<String> {
        self.metrics.source_problem.get()
    }

    /// Whether the pipeline moves. A silent radar does not stop it; a supervisor should start a program anew that has
    /// stopped.
    pub fn is_moving(&self) -> bool {
        self.liveness.is_moving()
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
        self.bus.stop_waiting();
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
    writer: &StoreWriter,
    liveness: &Liveness,
) {
    loop {
        for fall in acknowledged.try_iter() {
            let outputs = pipeline.acknowledge(fall);
            outputs.into_iter().for_each(|output| writer.accept(output));
        }
        let outputs = match queue.pop(STEP) {
            Some(Item::Frame(queued)) => {
                pipeline.push_frame(queued.frame, queued.arrival, !queue.is_late())
            }
            Some(Item::Lost { at_ms, reason }) => pipeline.source_lost(at_ms, &reason),
            Some(Item::Back { at_ms }) => pipeline.source_back(at_ms),
            Some(Item::End) => break,
            None if queue.is_closed() => break,
            None => Vec::new(),
        };
        liveness.step_finished();
        outputs.into_iter().for_each(|output| writer.accept(output));
    }
    pipeline
        .finish()
        .into_iter()
        .for_each(|output| writer.accept(output));
}

fn about(input: &Input, model: &str, options: &LiveOptions) -> About {
    let stream = &input.stream;
    let zone = |zone: &radarllm_monitor::zones::Zone| messages::Zone {
        name: zone.name.clone(),
        kind: kind_name(zone.kind).into(),
        polygon_m: zone.polygon_m.clone(),
        below_m: zone.below_m,
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
        zones: options
            .pipeline
            .watch
            .zones
            .all()
            .iter()
            .map(zone)
            .collect(),
    }
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
