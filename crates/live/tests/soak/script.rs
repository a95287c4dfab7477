//! What happens during the day, and the radar that sees it.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use radarllm_base::{Clutter, PointFrame, Provenance, RadarPoint, SourceInfo, seed};
use radarllm_io::live::{LiveCounts, LiveEvent, LiveSource};

use crate::motions::{self, Clip, Elsewhere, RADAR_M, RATE_HZ};

/// Frames by which the radar may be ahead of whoever listens.
const AHEAD: u32 = 16;
/// Frames that are sent at once, as after a computer was busy.
pub const BURST: u32 = 200;
/// Every so many frames of an empty room there is a point that is nothing.
const SPECKLE: u32 = 97;

/// For how long the computer is suspended, ms.
const SUSPENDED_MS: i64 = 600_000;

pub const fn frames(seconds: u32) -> u32 {
    seconds * RATE_HZ as u32
}

/// A clip at a place from a frame on.
#[derive(Clone, Copy)]
struct Part {
    first: u32,
    n_frames: u32,
    clip: usize,
    elsewhere: Elsewhere,
}

/// A random number generator of a line.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f32 {
        self.0 = seed::derive_seed(self.0, "soak");
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.roll()
    }
}

/// What a visitor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Visit {
    /// One clip of those that begin and end upright.
    Clip(usize),
    /// Sits down, sits still and gets up.
    Sit,
    /// Lies down, lies and gets up.
    Lie,
    /// Falls, lies and gets up.
    Fall,
}

/// How long the script is and what it contains.
pub struct Plan {
    /// Seed of motions, places and times.
    pub seed: u64,
    pub n_hours: u32,
    /// Hours in which somebody comes.
    pub is_busy: fn(u32) -> bool,
    pub n_visits_an_hour: u32,
    pub n_falls: u32,
    pub n_outages: u32,
    /// Built-in motions that are simulated: those that begin and end upright, and falls.
    pub upright: &'static [&'static str],
    pub falls: &'static [&'static str],
    /// Hour in which the computer is suspended for ten minutes.
    pub suspended: Option<u32>,
}

/// What happens.
pub struct Script {
    requests: Vec<&'static str>,
    clips: Vec<Clip>,
    parts: Vec<Part>,
    pub n_frames: u32,
    /// Frames in which somebody hits the floor.
    pub falls: Vec<u32>,
    /// Frames in which somebody begins to get up.
    pub get_ups: Vec<u32>,
    /// First frame and number of frames in which the radar is not heard.
    outages: Vec<[u32; 2]>,
    bursts: Vec<u32>,
    suspended: Option<u32>,
    /// First frames of visits in which nobody falls or gets up.
    pub quiet: Vec<u32>,
    pub n_visits: u32,
}

const SIT: &str = "walk+then+sit_down";
const STAND: &str = "stand_up+then+walk";
const LIE: &str = "walk+then+lie_down?after_s=10";
const RISE: &str = "stand_up+then+walk?stand_up.from=floor";

impl Script {
    pub fn new(plan: &Plan) -> Self {
        let radar = motions::radar();
        let requests = plan.upright.iter().chain(&[SIT, STAND, LIE, RISE]);
        let requests: Vec<&'static str> = requests.chain(plan.falls).copied().collect();
        let simulated = requests.iter().enumerate().map(|(i, request)| {
            motions::simulate(
                &radar,
                request,
                seed::derive_seed(plan.seed, &format!("clip {i}")),
            )
        });
        let mut script = Self {
            clips: simulated.collect(),
            requests: requests.clone(),
            parts: Vec::new(),
            n_frames: frames(3_600 * plan.n_hours),
            falls: Vec::new(),
            get_ups: Vec::new(),
            outages: Vec::new(),
            bursts: Vec::new(),
            suspended: plan.suspended.map(|hour| frames(3_600 * hour + 600)),
            quiet: Vec::new(),
            n_visits: 0,
        };
        script.fill(plan);
        script
    }

    /// Time of day of a frame, milliseconds since 1970 in UTC.
    pub fn utc_ms(&self, start_ms: i64, frame: u32) -> i64 {
        let is_after = self.suspended.is_some_and(|at| frame >= at);
        start_ms + 100 * i64::from(frame) + if is_after { SUSPENDED_MS } else { 0 }
    }

    /// The frame at a time of day.
    pub fn frame_at(&self, start_ms: i64, utc_ms: i64) -> u32 {
        let frame = |ms: i64| u32::try_from((utc_ms - start_ms - ms) / 100).unwrap_or(0);
        match self.suspended {
            Some(at) if frame(SUSPENDED_MS) >= at => frame(SUSPENDED_MS),
            _ => frame(0),
        }
    }

    /// What happens in a frame, or happened last before it.
    pub fn what(&self, frame: u32) -> String {
        let after = self.parts.partition_point(|part| part.first <= frame);
        let Some(part) = self.parts[..after].last() else {
            return "nothing yet".into();
        };
        let s = (frame - part.first) / 10;
        let length_s = part.n_frames / 10;
        format!("{} ({s} s of {length_s} s)", self.requests[part.clip])
    }

    fn fill(&mut self, plan: &Plan) {
        let mut dice = Dice(plan.seed);
        let busy: Vec<u32> = (0..plan.n_hours).filter(|h| (plan.is_busy)(*h)).collect();
        let n_busy = busy.len() as u32;
        let n_upright = plan.upright.len();
        let everyday = |n: u32| match n % 5 {
            1 => Visit::Sit,
            3 => Visit::Lie,
            _ => Visit::Clip(n as usize * 7 % n_upright),
        };
        let (mut n_everyday, mut n_fallen) = (0, 0);
        for (i, hour) in busy.into_iter().enumerate() {
            let n_falls = (i as u32 + 1) * plan.n_falls / n_busy - n_fallen;
            let n_visits = plan.n_visits_an_hour + n_falls;
            let room = frames(3_400) / n_visits;
            for n in 0..n_visits {
                // Falls are spread among the others.
                let is_fall = (n + 1) * n_falls / n_visits > n * n_falls / n_visits;
                let visit = if is_fall {
                    n_fallen += 1;
                    Visit::Fall
                } else {
                    n_everyday += 1;
                    everyday(n_everyday)
                };
                let earliest = frames(3_600 * hour + 40) + n * room;
                let first = earliest + dice.between(0.0, frames(15) as f32) as u32;
                let end = self.visit(visit, first, &mut dice, plan);
                // Longer than somebody is taken to be there unseen.
                assert!(
                    end + frames(35) < earliest + room,
                    "{visit:?} takes too long"
                );
            }
        }
        // Half of the outages begin while somebody is there, the others in an empty room.
        for n in 0..plan.n_outages {
            let at = self.quiet.len() * (2 * n as usize + 1) / (2 * plan.n_outages as usize);
            let n_frames = frames(dice.between(6.0, 20.0) as u32);
            let first = match n % 2 {
                0 => self.quiet[at] + 40,
                _ => self.quiet[at] - n_frames - 20,
            };
            self.outages.push([first, n_frames]);
        }
        self.outages.sort_unstable();
        self.bursts
            .extend(self.quiet.last().map(|first| first - BURST - 40));
    }

    /// Adds a visit. Returns its last frame.
    fn visit(&mut self, visit: Visit, first: u32, dice: &mut Dice, plan: &Plan) -> u32 {
        self.n_visits += 1;
        let somewhere = Elsewhere {
            is_mirrored: dice.roll() < 0.5,
            turn_rad: dice.between(-0.35, 0.35),
            away_m: dice.between(-0.5, 0.7),
        };
        let n = plan.upright.len();
        let [sit, stand, lie, rise] = [n, n + 1, n + 2, n + 3];
        match visit {
            Visit::Clip(clip) => {
                self.quiet.push(first);
                self.play(clip, first, 0, somewhere)
            }
            Visit::Sit => {
                let end = self.play(sit, first, 0, somewhere);
                self.get_up(
                    sit,
                    stand,
                    end + frames(dice.between(5.0, 25.0) as u32),
                    somewhere,
                )
            }
            Visit::Lie => {
                let held = frames(dice.between(5.0, 30.0) as u32);
                let end = self.play(lie, first, held, somewhere);
                self.get_up(lie, rise, end, somewhere)
            }
            Visit::Fall => {
                let fall = rise + 1 + self.falls.len() % plan.falls.len();
                let held = frames(dice.between(30.0, 60.0) as u32);
                let end = self.play(fall, first, held, somewhere);
                self.falls.push(first + self.clips[fall].impact);
                self.get_up(fall, rise, end, somewhere)
            }
        }
    }

    fn get_up(&mut self, from: usize, clip: usize, first: u32, elsewhere: Elsewhere) -> u32 {
        self.get_ups.push(first);
        let at_m = elsewhere.of(self.clips[from].end_m);
        let start_m = self.clips[clip].start_m;
        let elsewhere = Elsewhere::from(at_m, start_m, elsewhere.is_mirrored);
        self.play(clip, first, 0, elsewhere)
    }

    fn play(&mut self, clip: usize, first: u32, held: u32, elsewhere: Elsewhere) -> u32 {
        let n_frames = self.clips[clip].len() + held;
        self.parts.push(Part {
            first,
            n_frames,
            clip,
            elsewhere,
        });
        first + n_frames
    }

    fn points(&self, n: u32) -> Vec<RadarPoint> {
        let after = self.parts.partition_point(|part| part.first <= n);
        let part = self.parts[..after].last();
        if let Some(part) = part.filter(|part| n < part.first + part.n_frames) {
            return self.clips[part.clip].points(n - part.first, &part.elsewhere);
        }
        if !n.is_multiple_of(SPECKLE) {
            return Vec::new();
        }
        let mut dice = Dice(n.into());
        let (x_m, y_m) = (dice.between(-2.0, 2.0), dice.between(1.0, 6.0));
        vec![RadarPoint {
            x_m,
            y_m,
            z_m: dice.between(-1.0, 1.0),
            range_m: x_m.hypot(y_m),
            velocity_mps: dice.between(-1.0, 1.0),
            intensity_db: 12.0,
        }]
    }
}

/// How far whoever listens is, so that the radar does not run away.
#[derive(Default)]
pub struct Progress {
    seen: Mutex<u32>,
    changed: Condvar,
}

impl Progress {
    /// A frame was told.
    pub fn tell(&self, frame: u32) {
        let mut seen = self.seen.lock().unwrap();
        *seen = frame.max(*seen);
        drop(seen);
        self.changed.notify_all();
    }

    fn is_near(&self, frame: u32, timeout: Duration) -> bool {
        let is_far = |seen: &mut u32| frame > *seen + AHEAD;
        let seen = self.seen.lock().unwrap();
        let waited = self.changed.wait_timeout_while(seen, timeout, is_far);
        !waited.unwrap().1.timed_out()
    }
}

/// The radar. It sets the clock.
pub struct Radar {
    script: Arc<Script>,
    progress: Arc<Progress>,
    clock_ms: Arc<AtomicI64>,
    start_ms: i64,
    next: u32,
    pending: VecDeque<LiveEvent>,
    n_outages: usize,
}

impl Radar {
    pub fn new(
        script: Arc<Script>,
        progress: Arc<Progress>,
        clock_ms: Arc<AtomicI64>,
        start_ms: i64,
    ) -> Self {
        Self {
            script,
            progress,
            clock_ms,
            start_ms,
            next: 0,
            pending: VecDeque::new(),
            n_outages: 0,
        }
    }

    fn set_clock(&self) {
        let now_ms = self.script.utc_ms(self.start_ms, self.next);
        self.clock_ms.store(now_ms, Ordering::Relaxed);
    }
}

impl LiveSource for Radar {
    fn next(&mut self, timeout: Duration) -> radarllm_io::Result<Option<LiveEvent>> {
        if let Some(event) = self.pending.pop_front() {
            return Ok(Some(event));
        }
        let script = Arc::clone(&self.script);
        // The radar does not send every frame, but it sends the last one.
        let is_lost = self.next % 1_013 == 500 && self.next + 1 < script.n_frames;
        self.next += u32::from(is_lost);
        if self.next >= script.n_frames {
            return Ok(Some(LiveEvent::End));
        }
        let is_burst = script
            .bursts
            .iter()
            .any(|b| (*b..b + BURST).contains(&self.next));
        if !is_burst && !self.progress.is_near(self.next, timeout) {
            return Ok(None);
        }
        let outage = script.outages.get(self.n_outages);
        if let Some([_, n_frames]) = outage.filter(|[first, _]| self.next >= *first) {
            self.n_outages += 1;
            self.next += n_frames;
            // Nobody is told the frames that are missing.
            self.progress.tell(self.next);
            self.set_clock();
            self.pending.push_back(LiveEvent::Back);
            return Ok(Some(LiveEvent::Lost {
                reason: "unplugged by the script".into(),
            }));
        }
        self.set_clock();
        let frame = PointFrame {
            frame: self.next,
            time_s: f64::from(self.next) / RATE_HZ,
            points: script.points(self.next),
            board: None,
        };
        self.next += 1;
        Ok(Some(LiveEvent::Frame(frame)))
    }

    fn about(&self) -> SourceInfo {
        SourceInfo {
            frame_period_s: 1.0 / RATE_HZ,
            radar: radarllm::DEFAULT_RADAR.into(),
            radar_height_m: RADAR_M,
            is_height_assumed: false,
            clutter: Clutter::Settled,
            provenance: Provenance::simulated("soak", 23),
        }
    }

    fn counts(&self) -> LiveCounts {
        LiveCounts {
            reconnects: self.n_outages as u64,
            ..LiveCounts::default()
        }
    }
}
