//! Multi-target tracking over time: clusters to tracks.

use radarllm_base::{PointFrame, RadarPoint, options::within};

use crate::OptionError;
use crate::assignment::assign;
use crate::cluster::{Cluster, ClusterOptions, clusters};
use crate::kalman::Estimate;

/// Gate of the data association: 99 % of a person's measurements of position on the floor are within this squared
/// Mahalanobis distance (chi-squared with two degrees of freedom).
const GATE: f64 = 9.21;
/// Maximum contribution of a radial velocity to an association cost. Ambiguous (folded) velocities and swinging limbs
/// must not separate a track from its cluster.
const VELOCITY_COST: f64 = 4.0;
/// Standard deviation of a cluster's median radial velocity about that of the body, m/s.
const SIGMA_MPS: f64 = 0.4;
/// Initial standard deviation of a person's velocity, m/s.
const FIRST_SIGMA_MPS: f64 = 1.5;
/// Additional standard deviation, m, of a position that is measured from a share of the points of a cluster of two
/// people. It is about the size of a body.
const SHARED_SIGMA_M: f64 = 0.5;
/// Scales, m and m/s, of the distance that assigns the points of such a cluster to one person or the other.
const SHARED_UNITS: [f64; 2] = [0.5, 0.5];

/// Options of the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackOptions {
    /// Options of the clustering.
    pub cluster: ClusterOptions,
    /// Standard deviation of a cluster's mean position about that of the body, m.
    pub sigma_m: f64,
    /// Process noise: standard deviation of the change of velocity after one second, m/s.
    pub acceleration_mps2: f64,
    /// Number of frames with a cluster that confirms a track as a person.
    pub confirm_frames: usize,
    /// Minimum number of these frames in which a third of the points move. A track that never moves is not a person.
    pub confirm_moving_frames: usize,
    /// Minimum time from the first to the last of these frames, s. Radars with a high frame rate have many frames
    /// within one flicker.
    pub confirm_s: f64,
    /// Minimum speed of a moving point, m/s.
    pub moving_mps: f64,
    /// Maximum time without measurements before a tentative track is deleted, s.
    pub tentative_s: f64,
    /// Maximum time without measurements before a confirmed track is deleted, s. A person who stands still is not
    /// detected.
    pub coast_s: f64,
    /// Time constant of the decay of the velocity while a person is not detected, s.
    pub fade_s: f64,
    /// Maximum gap, s, after which a person who is detected again keeps the track number; 0 disables this. See
    /// [`track`].
    pub rejoin_s: f64,
    /// Maximum distance between the positions of the last detection before the gap and the first one after it, m.
    pub rejoin_m: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            cluster: ClusterOptions::default(),
            sigma_m: 0.2,
            acceleration_mps2: 1.0,
            confirm_frames: 8,
            confirm_moving_frames: 5,
            confirm_s: 0.6,
            moving_mps: 0.1,
            tentative_s: 0.35,
            coast_s: 2.0,
            fade_s: 1.0,
            rejoin_s: 10.0,
            rejoin_m: 1.0,
        }
    }
}

impl TrackOptions {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        self.cluster.validate()?;
        for (field, value) in [
            ("sigma_m", self.sigma_m),
            ("acceleration_mps2", self.acceleration_mps2),
            ("tentative_s", self.tentative_s),
            ("coast_s", self.coast_s),
            ("fade_s", self.fade_s),
            ("rejoin_m", self.rejoin_m),
        ] {
            within(field, value, [1e-3, 1e3], "0.001 to 1000")?;
        }
        within("confirm_s", self.confirm_s, [0.0, 1e3], "0 to 1000")?;
        within("rejoin_s", self.rejoin_s, [0.0, 1e3], "0 to 1000")?;
        within("moving_mps", self.moving_mps, [0.0, 100.0], "0 to 100 m/s")?;
        within(
            "confirm_frames",
            self.confirm_frames as f64,
            [1.0, 1e6],
            "at least 1",
        )
    }
}

/// A person in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackFrame {
    /// Index of the frame in the clip.
    pub frame: usize,
    /// Estimated position, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
    /// Estimated velocity, m/s.
    pub velocity_mps: [f64; 2],
    /// Indices of this person's points in the frame; empty if the person was not detected.
    pub points: Vec<u32>,
    /// Whether the points are a share of a cluster that was assigned to another person's track.
    pub is_shared: bool,
}

/// The track of one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Number, from 1, in the order in which people were first seen.
    pub id: u32,
    /// All frames from the first one with points to the last one with points, without gaps.
    pub frames: Vec<TrackFrame>,
}

impl Track {
    /// Points of this person over time: the frames from the first to the last in which the person was detected.
    pub fn points(&self, frames: &[PointFrame]) -> Vec<PointFrame> {
        self.frames
            .iter()
            .filter_map(|at| {
                let frame = frames.get(at.frame)?;
                Some(PointFrame {
                    frame: frame.frame,
                    time_s: frame.time_s,
                    points: at
                        .points
                        .iter()
                        .filter_map(|i| frame.points.get(*i as usize).copied())
                        .collect(),
                    board: None,
                })
            })
            .collect()
    }

    /// Appends a track that begins later. In the gap nothing was detected, and the position is interpolated linearly.
    fn append(&mut self, later: Self) {
        if let (Some(end), Some(start)) = (self.frames.last().cloned(), later.frames.first()) {
            let n = (start.frame - end.frame) as f64;
            let way_m = [0, 1].map(|i| start.place_m[i] - end.place_m[i]);
            self.frames
                .extend((end.frame + 1..start.frame).map(|frame| {
                    let share = (frame - end.frame) as f64 / n;
                    TrackFrame {
                        frame,
                        place_m: [0, 1].map(|i| end.place_m[i] + share * way_m[i]),
                        velocity_mps: [0.0; 2],
                        points: Vec::new(),
                        is_shared: false,
                    }
                }));
        }
        self.frames.extend(later.frames);
    }

    /// Number of points over all frames.
    pub fn n_points(&self) -> usize {
        self.frames.iter().map(|f| f.points.len()).sum()
    }
}

/// A person in the newest frame of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveTrack {
    /// Number of the person, from 1, in the order in which people were confirmed.
    pub id: u32,
    /// Estimated position, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
    /// Estimated velocity, m/s.
    pub velocity_mps: [f64; 2],
    /// Indices of this person's points in the frame; empty if the person is not detected in it.
    pub points: Vec<u32>,
}

impl LiveTrack {
    /// The points of this person in the frame that was pushed.
    pub fn points_of(&self, frame: &PointFrame) -> Vec<RadarPoint> {
        let indices = self.points.iter();
        indices
            .filter_map(|i| frame.points.get(*i as usize).copied())
            .collect()
    }
}

/// Detects people and tracks them, one frame at a time.
///
/// The steps for each frame are:
/// - Points are clustered.
/// - A Kalman filter with a constant-velocity model predicts the position of every person.
/// - Data association assigns clusters to confirmed tracks so that the sum of squared Mahalanobis distances is minimal.
///   No assignment is made outside the 99 % gate.
/// - The remaining clusters are assigned to tentative tracks in the same way.
/// - Every cluster that is still unassigned starts a tentative track.
///
/// People who form a single cluster share its points: each point belongs to the person who is nearer in position and
/// radial velocity. Such a share changes its track little. Only the person to whom the cluster is assigned counts as
/// detected, so two people who remain a single cluster become one track.
///
/// A person has a number from confirmation on and keeps it. Whoever disappeared and is confirmed again has the former
/// number if the match is unambiguous by what is known at that moment; [`track`] also knows what comes later, so that
/// the two may number people differently. Memory does not grow with time.
#[derive(Clone, Debug)]
pub struct Tracker {
    options: TrackOptions,
    live: Vec<Live>,
    /// People with a number who disappeared and may return.
    vanished: Vec<Path>,
    n_frames: usize,
    n_started: u64,
    n_people: u32,
    last_s: Option<f64>,
}

impl Tracker {
    /// A tracker that has seen nothing yet.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(options: TrackOptions) -> Result<Self, OptionError> {
        options.validate()?;
        Ok(Self {
            options,
            live: Vec::new(),
            vanished: Vec::new(),
            n_frames: 0,
            n_started: 0,
            n_people: 0,
            last_s: None,
        })
    }

    /// Tracks people into the next frame. Returns those who are confirmed, also those who are not detected in this frame
    /// but were so within [`TrackOptions::coast_s`].
    pub fn push(&mut self, frame: &PointFrame) -> Vec<LiveTrack> {
        self.step(frame);
        self.number();
        self.forget(frame.time_s);
        let people = self.live.iter();
        people
            .filter_map(|one| {
                Some(LiveTrack {
                    id: one.path.id?,
                    place_m: one.now.place_m,
                    velocity_mps: one.now.velocity_mps,
                    points: one.now.points.clone(),
                })
            })
            .collect()
    }

    fn step(&mut self, frame: &PointFrame) {
        let options = &self.options;
        let live = &mut self.live;
        let at = Sight {
            frame: self.n_frames,
            time_s: frame.time_s,
            place_m: [0.0; 2],
        };
        self.n_frames += 1;
        let dt_s = self
            .last_s
            .map_or(0.0, |last_s| (frame.time_s - last_s).max(0.0));
        self.last_s = Some(frame.time_s);
        let found = clusters(&frame.points, &options.cluster);
        for one in &mut *live {
            one.predict(dt_s, options);
        }
        let mut free: Vec<usize> = (0..found.len()).collect();
        // Confirmed tracks are associated before tentative tracks.
        let mut given: Vec<Option<usize>> = vec![None; live.len()];
        for people in [true, false] {
            let who: Vec<usize> = (0..live.len())
                .filter(|&i| live[i].is_person(options) == people)
                .collect();
            for (i, cluster) in associate(live, &who, &found, &free, options) {
                given[i] = Some(cluster);
            }
            free.retain(|c| !given.contains(&Some(*c)));
        }
        let shares = shares(live, &given, &found, &frame.points, options);
        for (i, one) in live.iter_mut().enumerate() {
            match (&shares[i], given[i]) {
                (Some(share), owned) => one.share(at, share, owned.is_some(), options),
                (None, Some(cluster)) => one.see(at, &found[cluster], &frame.points, options),
                (None, None) => one.miss(at),
            }
        }
        let vanished = &mut self.vanished;
        live.retain(|one| {
            let lives = one.lives(options);
            if !lives && one.path.id.is_some() {
                vanished.push(one.path);
            }
            lives
        });
        for cluster in free {
            let number = self.n_started;
            live.push(Live::new(
                number,
                at,
                &found[cluster],
                &frame.points,
                options,
            ));
            self.n_started += 1;
        }
    }

    /// Gives numbers to those who have just been confirmed.
    fn number(&mut self) {
        let is_new = |one: &Live| one.path.id.is_none() && one.is_person(&self.options);
        let new: Vec<usize> = (0..self.live.len())
            .filter(|&i| is_new(&self.live[i]))
            .collect();
        if new.is_empty() {
            return;
        }
        // Everybody known, those with a new number last. Nobody who is tracked has ended.
        let mut paths: Vec<Path> = self.vanished.clone();
        paths.extend(self.live.iter().filter_map(|one| {
            let is_known = one.path.id.is_some() || is_new(one);
            is_known.then_some(one.path)
        }));
        let n_vanished = self.vanished.len();
        let mut taken = Vec::new();
        for i in new {
            let path = self.live[i].path;
            let mut before =
                (0..n_vanished).filter(|&v| paths[v].is_followed_by(&path, &self.options));
            let only = before.next().filter(|&v| {
                let after = paths
                    .iter()
                    .filter(|p| paths[v].is_followed_by(p, &self.options));
                before.next().is_none() && after.count() == 1
            });
            self.live[i].path.id = match only {
                Some(v) => {
                    taken.push(paths[v].id);
                    paths[v].id
                }
                None => {
                    self.n_people = self.n_people.saturating_add(1);
                    Some(self.n_people)
                }
            };
        }
        self.vanished.retain(|path| !taken.contains(&path.id));
    }

    /// Forgets those who cannot return any more: for everybody who appears now it is too late, and nobody who appeared
    /// in time is still to be confirmed.
    fn forget(&mut self, time_s: f64) {
        let (live, options) = (&self.live, &self.options);
        self.vanished.retain(|path| {
            time_s - path.last.time_s <= options.rejoin_s
                || live
                    .iter()
                    .any(|one| one.path.id.is_none() && path.is_followed_by(&one.path, options))
        });
    }
}

/// Detects people and tracks them through a recording: [`Tracker`], and what is known at the end.
///
/// The result does not contain tracks that were never confirmed, nor the frames of a track after its last points. A
/// person who disappears and is detected again keeps the track number if the match is unambiguous: within `rejoin_s`
/// and `rejoin_m`, no other person disappeared there and no other person appears there.
///
/// # Errors
/// If an option is out of range.
pub fn track(frames: &[PointFrame], options: &TrackOptions) -> Result<Vec<Track>, OptionError> {
    let mut tracker = Tracker::new(*options)?;
    // Frames of every track, by the number of its start, and whether it was confirmed.
    let mut histories: Vec<(Vec<TrackFrame>, bool)> = Vec::new();
    for frame in frames {
        tracker.push(frame);
        // A track that ended with this frame had no points of its own in it.
        for one in &tracker.live {
            let number = one.number as usize;
            if number >= histories.len() {
                histories.resize_with(number + 1, Default::default);
            }
            let (history, is_person) = &mut histories[number];
            history.push(one.now.clone());
            *is_person = one.is_person(options);
        }
    }
    let mut tracks: Vec<Track> = histories
        .into_iter()
        .filter(|(_, is_person)| *is_person)
        .map(|(history, _)| Track {
            id: 0,
            frames: until_last_seen(history),
        })
        .filter(|track| !track.frames.is_empty())
        .collect();
    tracks.sort_by_key(|t| (t.frames[0].frame, t.frames[0].points.first().copied()));
    let mut tracks = rejoin(tracks, frames, options);
    for (i, track) in tracks.iter_mut().enumerate() {
        track.id = i as u32 + 1;
    }
    Ok(tracks)
}

fn until_last_seen(mut frames: Vec<TrackFrame>) -> Vec<TrackFrame> {
    let is_seen = |f: &TrackFrame| !f.points.is_empty() && !f.is_shared;
    let end = frames.iter().rposition(is_seen).map_or(0, |i| i + 1);
    frames.truncate(end);
    frames
}

/// Joins the tracks of a person before and after a gap. `tracks` are sorted by their start.
fn rejoin(tracks: Vec<Track>, frames: &[PointFrame], options: &TrackOptions) -> Vec<Track> {
    let follows = |before: &Track, after: &Track| {
        let (Some(end), Some(start)) = (before.frames.last(), after.frames.first()) else {
            return false;
        };
        let sight = |at: &TrackFrame| Sight {
            frame: at.frame,
            time_s: frames[at.frame].time_s,
            place_m: at.place_m,
        };
        sight(start).may_continue(&sight(end), options)
    };
    // Returns the track for which `fits` holds if it is the only one.
    let only = |fits: &dyn Fn(&Track) -> bool| {
        let mut fitting = (0..tracks.len()).filter(|&i| fits(&tracks[i]));
        fitting.next().filter(|_| fitting.next().is_none())
    };
    let predecessor: Vec<Option<usize>> = tracks
        .iter()
        .enumerate()
        .map(|(i, track)| {
            only(&|other| follows(other, track))
                .filter(|&before| only(&|other| follows(&tracks[before], other)) == Some(i))
        })
        .collect();
    let mut joined: Vec<Track> = Vec::new();
    // Index of each track in the joined list.
    let mut place: Vec<usize> = Vec::with_capacity(tracks.len());
    for (track, predecessor) in tracks.into_iter().zip(predecessor) {
        match predecessor {
            Some(before) => {
                let at = place[before];
                place.push(at);
                joined[at].append(track);
            }
            None => {
                place.push(joined.len());
                joined.push(track);
            }
        }
    }
    joined
}

/// When and where a person was detected.
#[derive(Clone, Copy, Debug)]
struct Sight {
    frame: usize,
    time_s: f64,
    place_m: [f64; 2],
}

impl Sight {
    /// Whether a track that begins here may continue one that ended at `end`.
    fn may_continue(&self, end: &Self, options: &TrackOptions) -> bool {
        let [dx, dy] = [0, 1].map(|i| self.place_m[i] - end.place_m[i]);
        // Without rejoining, not even a gap of 0 s is bridged: the times of two frames may be equal.
        options.rejoin_s > 0.0
            && end.frame < self.frame
            && self.time_s - end.time_s <= options.rejoin_s
            && dx.hypot(dy) <= options.rejoin_m
    }
}

/// The ends of a track.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Number of the person, from confirmation on.
    id: Option<u32>,
    first: Sight,
    last: Sight,
}

impl Path {
    /// Whether the other track may be the continuation of this one after a gap.
    fn is_followed_by(&self, later: &Self, options: &TrackOptions) -> bool {
        later.first.may_continue(&self.last, options)
    }
}

/// State of a track while it is being tracked.
#[derive(Clone, Debug)]
struct Live {
    /// Number of tracks that were started before, tentative ones included.
    number: u64,
    estimate: Estimate,
    path: Path,
    /// The newest frame.
    now: TrackFrame,
    n_seen: usize,
    n_moving: usize,
    /// Time since the first cluster, and until the last one, s.
    age_s: f64,
    seen_s: f64,
    unseen_s: f64,
}

impl Live {
    fn new(
        number: u64,
        at: Sight,
        cluster: &Cluster,
        points: &[RadarPoint],
        options: &TrackOptions,
    ) -> Self {
        let mut one = Self {
            number,
            estimate: Estimate::new(cluster.place_m, options.sigma_m, FIRST_SIGMA_MPS),
            path: Path {
                id: None,
                first: at,
                last: at,
            },
            now: TrackFrame {
                frame: at.frame,
                place_m: cluster.place_m,
                velocity_mps: [0.0; 2],
                points: Vec::new(),
                is_shared: false,
            },
            n_seen: 0,
            n_moving: 0,
            age_s: 0.0,
            seen_s: 0.0,
            unseen_s: 0.0,
        };
        one.estimate
            .update_velocity(cluster.velocity_mps, SIGMA_MPS);
        one.count(cluster, points, options);
        one.write(at, cluster.points.clone(), false);
        one.path.first = one.path.last;
        one
    }

    fn is_person(&self, options: &TrackOptions) -> bool {
        self.n_seen >= options.confirm_frames
            && self.n_moving >= options.confirm_moving_frames
            && self.seen_s >= options.confirm_s
    }

    fn lives(&self, options: &TrackOptions) -> bool {
        let max_s = match self.is_person(options) {
            true => options.coast_s,
            false => options.tentative_s,
        };
        self.unseen_s <= max_s
    }

    fn predict(&mut self, dt_s: f64, options: &TrackOptions) {
        // The velocity is constant as long as clusters are assigned, and decays afterwards: most people who disappear
        // have stopped.
        let kept = match self.unseen_s > 0.0 {
            true => (-dt_s / options.fade_s).exp(),
            false => 1.0,
        };
        self.estimate.predict(dt_s, kept, options.acceleration_mps2);
        self.unseen_s += dt_s;
        self.age_s += dt_s;
    }

    fn count(&mut self, cluster: &Cluster, points: &[RadarPoint], options: &TrackOptions) {
        let is_moving =
            |i: &&u32| f64::from(points[**i as usize].velocity_mps.abs()) >= options.moving_mps;
        let n_moving = cluster.points.iter().filter(is_moving).count();
        self.n_seen += 1;
        self.n_moving += usize::from(3 * n_moving >= cluster.points.len());
        self.unseen_s = 0.0;
        self.seen_s = self.age_s;
    }

    fn see(&mut self, at: Sight, cluster: &Cluster, points: &[RadarPoint], options: &TrackOptions) {
        self.estimate.update_place(cluster.place_m, options.sigma_m);
        self.learn_velocity(cluster.velocity_mps);
        self.count(cluster, points, options);
        self.write(at, cluster.points.clone(), false);
    }

    fn share(&mut self, at: Sight, share: &Cluster, is_owner: bool, options: &TrackOptions) {
        let sigma_m = options.sigma_m.hypot(SHARED_SIGMA_M);
        self.estimate.update_place(share.place_m, sigma_m);
        self.learn_velocity(share.velocity_mps);
        if is_owner {
            self.unseen_s = 0.0;
        }
        self.write(at, share.points.clone(), !is_owner);
    }

    fn miss(&mut self, at: Sight) {
        self.write(at, Vec::new(), false);
    }

    /// Updates the velocity. A measurement far from the velocity that the positions imply is ignored: it is that of a
    /// limb, or ambiguous (folded).
    fn learn_velocity(&mut self, velocity_mps: f64) {
        if self.estimate.velocity_distance(velocity_mps, SIGMA_MPS) < VELOCITY_COST {
            self.estimate.update_velocity(velocity_mps, SIGMA_MPS);
        }
    }

    fn write(&mut self, at: Sight, points: Vec<u32>, is_shared: bool) {
        let [x, y, vx, vy] = self.estimate.mean;
        if !points.is_empty() && !is_shared {
            self.path.last = Sight {
                place_m: [x, y],
                ..at
            };
        }
        self.now = TrackFrame {
            frame: at.frame,
            place_m: [x, y],
            velocity_mps: [vx, vy],
            points,
            is_shared,
        };
    }

    /// Association cost of a cluster; `None` if the cluster is outside the gate.
    fn cost(&self, cluster: &Cluster, options: &TrackOptions) -> Option<f64> {
        let place = self
            .estimate
            .place_distance(cluster.place_m, options.sigma_m);
        let velocity = self
            .estimate
            .velocity_distance(cluster.velocity_mps, SIGMA_MPS);
        (place < GATE).then_some(place + velocity.min(VELOCITY_COST))
    }
}

/// Assigns clusters to the tracks `who` at the minimum sum of costs. Leaving a track unassigned costs more than any
/// cluster within its gate.
fn associate(
    live: &[Live],
    who: &[usize],
    found: &[Cluster],
    free: &[usize],
    options: &TrackOptions,
) -> Vec<(usize, usize)> {
    const NONE: f64 = GATE + VELOCITY_COST;
    const NEVER: f64 = 1e6;
    let costs: Vec<Vec<f64>> = who
        .iter()
        .enumerate()
        .map(|(row, &i)| {
            let clusters = free
                .iter()
                .map(|&c| live[i].cost(&found[c], options).unwrap_or(NEVER));
            // One additional column for each track, which leaves the track unassigned.
            let without = (0..who.len()).map(|col| if col == row { NONE } else { NEVER });
            clusters.chain(without).collect()
        })
        .collect();
    assign(&costs)
        .into_iter()
        .zip(who)
        .filter_map(|(column, &i)| Some((i, *free.get(column)?)))
        .collect()
}

/// Divides clusters that contain two or more people: the person to whom the cluster is assigned, and people without a
/// cluster of their own whose gate contains it.
fn shares(
    live: &[Live],
    given: &[Option<usize>],
    found: &[Cluster],
    points: &[RadarPoint],
    options: &TrackOptions,
) -> Vec<Option<Cluster>> {
    let mut shares: Vec<Option<Cluster>> = vec![None; live.len()];
    for (owner, cluster) in given.iter().enumerate() {
        let Some(cluster) = *cluster else { continue };
        if !live[owner].is_person(options) {
            continue;
        }
        let mut people = vec![owner];
        people.extend((0..live.len()).filter(|&i| {
            given[i].is_none()
                && live[i].is_person(options)
                && live[i].cost(&found[cluster], options).is_some()
        }));
        if people.len() == 1 {
            continue;
        }
        let mut parts = vec![Vec::new(); people.len()];
        for &index in &found[cluster].points {
            let point = &points[index as usize];
            let apart = |who: usize| {
                let [x, y, ..] = live[who].estimate.mean;
                let (v, _) = live[who].estimate.radial_mps();
                let place = (f64::from(point.x_m) - x).hypot(f64::from(point.y_m) - y);
                let speed = f64::from(point.velocity_mps) - v;
                (place / SHARED_UNITS[0]).powi(2) + (speed / SHARED_UNITS[1]).powi(2)
            };
            let nearest = (0..people.len())
                .min_by(|&a, &b| apart(people[a]).total_cmp(&apart(people[b])))
                .unwrap_or(0);
            parts[nearest].push(index);
        }
        for (who, part) in people.into_iter().zip(parts) {
            // A person without any of the points is not detected in this frame.
            shares[who] = Cluster::of(points, part);
        }
    }
    shares
}
