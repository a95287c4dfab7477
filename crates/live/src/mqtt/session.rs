//! The loop that keeps a broker up to date, over any number of connections.
//!
//! Nothing waits for the broker: messages of the bus change a [`Room`], and what differs from what the broker has is sent,
//! one message at a time. While the broker is away nothing is queued but transitions of falls.

use std::future::{pending, poll_fn};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use futures_core::Stream;
use tokio::sync::watch;
use tokio::time::{sleep_until, timeout_at};

use super::discovery::Topics;
use super::link::{Link, LinkEvent, Will};
use super::options::Options;
use super::room::Room;
use crate::bus::{Bus, Published, Reader};

/// Shortest time between two states, and between two sentences.
const INTERVAL: Duration = Duration::from_secs(1);
/// How long the broker may take for an acknowledgement.
const ACKNOWLEDGE_TIME: Duration = Duration::from_secs(10);
/// How long it may take to publish `offline` at the end.
const FAREWELL_TIME: Duration = Duration::from_millis(1_500);
/// A connection that lasted for so long is a good one: after it the time between attempts begins anew.
const GOOD_TIME: Duration = Duration::from_secs(10);
/// Limits of the time between two attempts to connect.
const SHORTEST_RETRY: Duration = Duration::from_millis(1);
const LONGEST_RETRY: Duration = Duration::from_secs(3_600);
/// How often `online` is published again: the will of a connection that ended without a farewell, of an earlier run or of
/// another radar of the same name, comes up to a quarter of a minute later.
const REFRESH: Duration = Duration::from_secs(30);
/// How often the values are looked at when nothing happens, because sentences grow old.
const TICK: Duration = Duration::from_secs(1);

/// Counters that others read while the loop runs.
#[derive(Debug, Default)]
pub(super) struct Shared {
    pub is_connected: AtomicBool,
    pub connections: AtomicU64,
    pub published: AtomicU64,
    pub dropped: AtomicU64,
    pub is_status_ignored: AtomicBool,
    problem: Mutex<Option<String>>,
}

impl Shared {
    pub(super) fn problem(&self) -> Option<String> {
        let problem = self.problem.lock();
        problem.unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_problem(&self, problem: Option<String>) {
        *self.problem.lock().unwrap_or_else(PoisonError::into_inner) = problem;
    }
}

/// What the broker is kept up to date with, beside the transitions of falls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    Discovery,
    Availability,
    Source,
    State,
    Caption,
}

/// The value of a slot that the broker has, or gets.
#[derive(Debug)]
struct Sent {
    slot: Slot,
    payload: Option<String>,
    not_before: Instant,
}

/// A message that is on its way.
#[derive(Debug)]
struct InFlight {
    is_transition: bool,
    acknowledge_by: Instant,
}

/// Something that happened.
enum Input {
    Link(LinkEvent),
    Bus(Option<Arc<Published>>),
    Tick,
    Stop,
}

/// The loop.
pub(super) struct Session {
    options: Options,
    topics: Topics,
    description: String,
    room: Room,
    bus: Arc<Bus>,
    reader: Reader,
    shared: Arc<Shared>,
    /// Of this process alone: a broker ends the connection of a client when another one comes with the same number.
    client_id: String,
    link: Option<Link>,
    connected_since: Option<Instant>,
    retry_at: Instant,
    retry: [Duration; 2],
    retry_after: Duration,
    sent: [Sent; 5],
    in_flight: Option<InFlight>,
    /// When everything is published again because Home Assistant came online, and when it last was.
    again: [Option<Instant>; 2],
}

impl Session {
    pub(super) fn new(
        options: Options,
        topics: Topics,
        description: String,
        room: Room,
        bus: Arc<Bus>,
        shared: Arc<Shared>,
    ) -> Self {
        let now = Instant::now();
        let retry = options
            .retry
            .map(|time| time.clamp(SHORTEST_RETRY, LONGEST_RETRY));
        let slots = [
            Slot::Discovery,
            Slot::Availability,
            Slot::Source,
            Slot::State,
            Slot::Caption,
        ];
        let own = RandomState::new().build_hasher().finish();
        Self {
            client_id: format!("radarllm_{}_{own:016x}", room.about().name),
            retry,
            retry_after: retry[0],
            options,
            topics,
            description,
            room,
            reader: bus.subscribe(),
            bus,
            shared,
            link: None,
            connected_since: None,
            retry_at: now,
            sent: slots.map(|slot| Sent {
                slot,
                payload: None,
                not_before: now,
            }),
            in_flight: None,
            again: [None; 2],
        }
    }

    /// Runs until it is stopped or the bus is closed. Returns whether the broker took `offline`.
    pub(super) async fn run(mut self, mut stopping: watch::Receiver<bool>) -> bool {
        loop {
            let now = Instant::now();
            self.check_acknowledgement(now);
            if self.link.is_none() && now >= self.retry_at {
                self.open();
            }
            self.publish_next(now);
            self.count();
            let wake_at = self.wake_at(now);
            let input = tokio::select! {
                event = next_event(&mut self.link) => Input::Link(event),
                message = next_message(&mut self.reader) => Input::Bus(message),
                () = sleep_until(wake_at.into()) => Input::Tick,
                // An error means that the owner is gone, which is a stop as well.
                _ = stopping.wait_for(|stop| *stop) => Input::Stop,
            };
            let now = Instant::now();
            match input {
                Input::Link(event) => self.take_event(event, now),
                Input::Bus(Some(message)) => self.room.take(&message.json, now),
                Input::Bus(None) if self.resubscribe(now) => {}
                Input::Bus(None) | Input::Stop => break,
                Input::Tick => {}
            }
        }
        let is_offline = self.farewell().await;
        self.count();
        self.shared.is_connected.store(false, Ordering::Relaxed);
        is_offline
    }

    fn open(&mut self) {
        let will = Will {
            topic: &self.topics.availability,
            payload: "offline",
        };
        self.link = Some(Link::open(&self.options, &self.client_id, &will));
    }

    fn take_event(&mut self, event: LinkEvent, now: Instant) {
        match event {
            LinkEvent::Connected => self.connected(now),
            LinkEvent::Acknowledged => {
                if let Some(in_flight) = self.in_flight.take() {
                    self.shared.published.fetch_add(1, Ordering::Relaxed);
                    if in_flight.is_transition {
                        self.room.transition_is_sent();
                    }
                }
            }
            LinkEvent::Message {
                topic,
                payload,
                retained,
            } => {
                // A retained message is older than the connection, at whose beginning everything was published.
                if topic == self.topics.status && payload == b"online" && !retained {
                    let [next, last] = self.again;
                    let earliest = last.map_or(now, |last| now.max(last + INTERVAL));
                    self.again[0] = Some(next.unwrap_or(earliest));
                }
            }
            LinkEvent::Lost { reason, oversized } => self.lost(reason, oversized, now),
        }
    }

    fn connected(&mut self, now: Instant) {
        self.connected_since = Some(now);
        self.shared.connections.fetch_add(1, Ordering::Relaxed);
        self.shared.is_connected.store(true, Ordering::Relaxed);
        self.shared.set_problem(None);
        self.room
            .drop_old_transitions(self.options.max_fall_age, now);
        self.forget_sent(now);
        // An empty queue takes the subscription.
        if let Some(link) = &self.link
            && !self.shared.is_status_ignored.load(Ordering::Relaxed)
        {
            link.subscribe(&self.topics.status);
        }
    }

    /// Gives the connection up and plans the next one.
    fn lost(&mut self, reason: String, oversized: bool, now: Instant) {
        self.link = None;
        self.in_flight = None;
        self.shared.is_connected.store(false, Ordering::Relaxed);
        self.shared.set_problem(Some(reason));
        if oversized {
            // Somebody writes what Home Assistant never does, and if it is retained, it comes again with each
            // subscription. Home Assistant gets the retained messages in any case.
            self.shared.is_status_ignored.store(true, Ordering::Relaxed);
        }
        let [first, longest] = self.retry;
        let since = self.connected_since.take();
        if since.is_some_and(|since| now.saturating_duration_since(since) >= GOOD_TIME) {
            self.retry_after = first;
        }
        self.retry_at = now + self.retry_after;
        self.retry_after = self.retry_after.saturating_mul(2).min(longest);
    }

    fn check_acknowledgement(&mut self, now: Instant) {
        let is_late = |in_flight: &InFlight| now >= in_flight.acknowledge_by;
        if self.in_flight.as_ref().is_some_and(is_late) {
            self.lost("the broker acknowledges nothing".into(), false, now);
        }
    }

    /// A new reader after the old one ended, because it was too slow. False if the bus is closed.
    fn resubscribe(&mut self, now: Instant) -> bool {
        self.reader = self.bus.subscribe();
        // `hello` waits in a new reader, unless the bus is closed.
        match self.reader.recv_timeout(Duration::ZERO) {
            Ok(hello) => {
                self.room.take(&hello.json, now);
                true
            }
            Err(_) => false,
        }
    }

    /// Everything is to be published, as if the broker had nothing.
    fn forget_sent(&mut self, now: Instant) {
        for sent in &mut self.sent {
            sent.payload = None;
            sent.not_before = now;
        }
        self.again = [None, Some(now)];
    }

    /// Sends the next message, if the broker has all others and something changed.
    fn publish_next(&mut self, now: Instant) {
        if self.connected_since.is_none() || self.in_flight.is_some() {
            return;
        }
        if self.again[0].is_some_and(|at| now >= at) {
            self.forget_sent(now);
        }
        let is_old =
            |sent: &&mut Sent| sent.slot == Slot::Availability && now >= sent.not_before + REFRESH;
        if let Some(sent) = self.sent.iter_mut().find(is_old) {
            sent.payload = None;
        }
        let Some(link) = &self.link else { return };
        // The description, availability, falls, and then the rest.
        let next = self.changed(now).find(|(_, at)| *at <= now);
        let next = next.map(|(at, _)| at);
        let is_transition = match next.map(|i| self.sent[i].slot) {
            Some(Slot::Discovery | Slot::Availability | Slot::Source) => false,
            Some(Slot::State | Slot::Caption) | None => self.room.transition().is_some(),
        };
        let is_taken = if let (true, Some(payload)) = (is_transition, self.room.transition()) {
            link.publish(&self.topics.fall, payload, false)
        } else if let Some(i) = next {
            let slot = self.sent[i].slot;
            let payload = self.payload(slot, now);
            let is_taken = link.publish(self.topic(slot), &payload, true);
            if is_taken {
                let is_limited = matches!(slot, Slot::State | Slot::Caption);
                let interval = if is_limited { INTERVAL } else { Duration::ZERO };
                self.sent[i].payload = Some(payload);
                self.sent[i].not_before = now + interval;
            }
            is_taken
        } else {
            false
        };
        if is_taken {
            self.in_flight = Some(InFlight {
                is_transition,
                acknowledge_by: now + ACKNOWLEDGE_TIME,
            });
        }
    }

    /// Indices of the slots that changed, and from when they may be sent.
    fn changed(&self, now: Instant) -> impl Iterator<Item = (usize, Instant)> {
        let slots = self.sent.iter().enumerate();
        let changed = slots
            .filter(move |(_, sent)| sent.payload.as_ref() != Some(&self.payload(sent.slot, now)));
        changed.map(|(i, sent)| (i, sent.not_before))
    }

    fn payload(&self, slot: Slot, now: Instant) -> String {
        match slot {
            Slot::Discovery => self.description.clone(),
            Slot::Availability => "online".into(),
            Slot::Source => self.room.source().into(),
            Slot::State => self.room.state(now),
            Slot::Caption => self.room.caption(now),
        }
    }

    fn topic(&self, slot: Slot) -> &str {
        match slot {
            Slot::Discovery => &self.topics.discovery,
            Slot::Availability => &self.topics.availability,
            Slot::Source => &self.topics.source,
            Slot::State => &self.topics.state,
            Slot::Caption => &self.topics.caption,
        }
    }

    /// When something is to be done although nothing happens.
    fn wake_at(&self, now: Instant) -> Instant {
        let tick = now + TICK;
        if self.link.is_none() {
            return tick.min(self.retry_at);
        }
        if self.connected_since.is_none() || self.in_flight.is_some() {
            return tick;
        }
        let changes = self.changed(now).map(|(_, at)| at);
        let due = changes.chain(self.again[0]).min();
        // What could not be sent although it is due is tried again with the tick.
        let due = due.filter(|at| *at > now);
        due.map_or(tick, |at| at.min(tick))
    }

    fn count(&self) {
        let dropped = self.room.n_dropped();
        self.shared.dropped.store(dropped, Ordering::Relaxed);
    }

    /// Sends the transitions that wait and `offline`. Returns whether the broker took it.
    async fn farewell(&mut self) -> bool {
        let end = tokio::time::Instant::now() + FAREWELL_TIME;
        let in_flight = self.in_flight.take();
        let Some(link) = self
            .link
            .as_mut()
            .filter(|_| self.connected_since.is_some())
        else {
            return false;
        };
        let mut n_open = usize::from(in_flight.is_some());
        let on_its_way = in_flight.is_some_and(|in_flight| in_flight.is_transition);
        for payload in self.room.transitions().skip(usize::from(on_its_way)) {
            n_open += usize::from(link.publish(&self.topics.fall, payload, false));
        }
        if !link.publish(&self.topics.availability, "offline", true) {
            return false;
        }
        n_open += 1;
        while n_open > 0 {
            match timeout_at(end, link.next()).await {
                Ok(LinkEvent::Acknowledged) => {
                    n_open -= 1;
                    self.shared.published.fetch_add(1, Ordering::Relaxed);
                }
                Ok(LinkEvent::Lost { .. }) | Err(_) => return false,
                Ok(LinkEvent::Connected | LinkEvent::Message { .. }) => {}
            }
        }
        if let Some(link) = self.link.take() {
            link.close().await;
        }
        true
    }
}

/// The next message of the bus; `None` after the last one.
async fn next_message(reader: &mut Reader) -> Option<Arc<Published>> {
    poll_fn(|context| Pin::new(&mut *reader).poll_next(context)).await
}

/// The next event, or none ever without a link.
async fn next_event(link: &mut Option<Link>) -> LinkEvent {
    match link {
        Some(link) => link.next().await,
        None => pending().await,
    }
}
