//! The last seconds of each person's points.
//!
//! While one person is there, all points of the room are this person's: a tracker misses some of them, and loses who moves
//! little. Two people and more have the points of their tracks. While nobody is tracked, all points of the room may be those
//! of somebody who moves too little for a track; whether they are is decided by whoever describes them.

use std::collections::{BTreeMap, VecDeque};

use radarllm_base::{BoardReport, PointFrame, RadarPoint, stats::median_upper};

use crate::options::{OptionError, within};
use crate::people::{PersonFrame, UNTRACKED};

/// Rounding of times of frames, s.
const ROUNDING_S: f64 = 1e-6;

/// Options of windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowOptions {
    /// Length of a window, s.
    pub window_s: f64,
    /// Time between the starts of two windows, s.
    pub stride_s: f64,
    /// Time for which a person is tracked before the first window, s; the length of a window if that is less.
    pub min_tracked_s: f64,
    /// Time before a window that comes with it, s.
    pub earlier_s: f64,
}

impl Default for WindowOptions {
    fn default() -> Self {
        Self {
            window_s: 6.0,
            stride_s: 2.0,
            min_tracked_s: 3.0,
            earlier_s: 30.0,
        }
    }
}

/// A person's points over a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Number of the track, or [`UNTRACKED`].
    pub person: u32,
    /// All frames of the window, with this person's points; without points where the person was not detected.
    pub frames: Vec<PointFrame>,
    /// The frames before the window.
    pub earlier: Vec<PointFrame>,
    /// Where the person is, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
}

impl Window {
    /// Time of the first frame, s.
    pub fn start_s(&self) -> f64 {
        self.frames.first().map_or(0.0, |f| f.time_s)
    }

    /// Time of the last frame, s.
    pub fn end_s(&self) -> f64 {
        self.frames.last().map_or(0.0, |f| f.time_s)
    }

    /// Number of points.
    pub fn n_points(&self) -> u32 {
        let n = self.frames.iter().map(|f| f.points.len()).sum::<usize>();
        u32::try_from(n).unwrap_or(u32::MAX)
    }
}

/// Changes of the tracks from one frame to the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrackChanges {
    /// People who are not tracked any more.
    pub ended: Vec<u32>,
    /// Somebody who was alone in the room and lost, and the number of whoever appeared then, alone as well: the same
    /// person.
    pub renamed: Option<[u32; 2]>,
}

/// The last seconds of everybody.
#[derive(Debug)]
pub struct Windows {
    options: WindowOptions,
    people: BTreeMap<u32, Track>,
    /// All points of the last seconds: of the windows, and of the time before them.
    room: VecDeque<PointFrame>,
    /// What the radar reported in this time, static points as well; empty if there is no static clutter.
    reported: VecDeque<PointFrame>,
    /// Whoever is not tracked any more, but has not left: number of the track, and what is known of it.
    lingering: Option<(u32, Track)>,
    /// Whether somebody has been there for long enough for a window.
    is_settled: bool,
    /// Number of the last stride that was described.
    stride: Option<f64>,
    /// Whether frames came after the last windows were taken.
    is_partly_new: bool,
}

#[derive(Debug, Default)]
struct Track {
    frames: VecDeque<PointFrame>,
    place_m: [f64; 2],
}

impl Windows {
    /// Nobody has been seen.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(mut options: WindowOptions) -> Result<Self, OptionError> {
        within("window_s", options.window_s, [1.0, 9.6], "1 to 9.6 s")?;
        within("stride_s", options.stride_s, [0.1, 60.0], "0.1 to 60 s")?;
        within(
            "min_tracked_s",
            options.min_tracked_s,
            [0.0, 9.6],
            "0 to 9.6 s",
        )?;
        within("earlier_s", options.earlier_s, [0.0, 60.0], "0 to 60 s")?;
        options.min_tracked_s = options.min_tracked_s.min(options.window_s);
        Ok(Self {
            options,
            people: BTreeMap::new(),
            room: VecDeque::new(),
            reported: VecDeque::new(),
            lingering: None,
            is_settled: false,
            stride: None,
            is_partly_new: false,
        })
    }

    /// The points of the next frame, and of the people who are tracked in it. `is_occupied` tells whether somebody is in
    /// the room, also if nobody is tracked. Returns whose tracks changed.
    pub fn push(
        &mut self,
        frame: &PointFrame,
        people: &[PersonFrame],
        is_occupied: bool,
    ) -> TrackChanges {
        let oldest_s = self.begins_s(frame.time_s) - self.options.earlier_s;
        keep(&mut self.room, frame.clone(), oldest_s);
        for person in people {
            let track = self.people.entry(person.person).or_default();
            track.place_m = person.place_m;
            let own = PointFrame {
                frame: frame.frame,
                time_s: frame.time_s,
                points: person.points.clone(),
                board: person.board.map(|track| BoardReport {
                    tracks: vec![track],
                    is_present: None,
                }),
            };
            keep(&mut track.frames, own, oldest_s);
            self.is_settled |= self.options.min_tracked_s - ROUNDING_S <= length_s(&track.frames);
        }
        self.is_partly_new |= !people.is_empty() || !frame.points.is_empty();
        let is_gone = |id: &u32| people.iter().all(|p| p.person != *id);
        let ended = self.people.extract_if(.., |id, _| is_gone(id));
        let mut ended: Vec<(u32, Track)> = ended.collect();
        let lost = self.lingering.take().filter(|(id, _)| is_gone(id));
        let mut renamed = None;
        match (lost, people) {
            (Some((person, mut before)), [one]) => {
                renamed = Some([person, one.person]);
                if let Some(track) = self.people.get_mut(&one.person) {
                    // The same person, who has the time before as well.
                    before.frames.append(&mut track.frames);
                    track.frames = before.frames;
                }
            }
            (lost, _) => ended.extend(lost),
        }
        if people.is_empty() && is_occupied {
            // Of several, the newest: the last one in the room.
            ended.sort_by_key(|(id, _)| *id);
            self.lingering = ended.pop();
        }
        self.is_settled &= is_occupied || !people.is_empty();
        if !is_occupied && people.is_empty() && !ended.is_empty() {
            // Whoever has left must not be described as somebody who is there untracked.
            self.room.clear();
        }
        TrackChanges {
            ended: ended.into_iter().map(|(id, _)| id).collect(),
            renamed,
        }
    }

    /// Everything that the radar reported in the next frame, before it is pushed.
    pub fn report(&mut self, frame: PointFrame) {
        let oldest_s = self.begins_s(frame.time_s);
        keep(&mut self.reported, frame, oldest_s);
    }

    /// When a window begins that ends at a time, s.
    fn begins_s(&self, end_s: f64) -> f64 {
        end_s - self.options.window_s + ROUNDING_S
    }

    /// The window of the only person of the room: all points are this person's. Where the board tracks people, its tracks of
    /// somebody else who was there before are not.
    fn window_of_room(&self, person: u32, track: &Track) -> Window {
        let mut window = self.window(person, track.place_m, &self.room);
        let mut own = track.frames.iter().peekable();
        for frame in window.earlier.iter_mut().chain(&mut window.frames) {
            while own.next_if(|own| own.time_s < frame.time_s).is_some() {}
            let own = own.peek().filter(|own| own.time_s == frame.time_s);
            if let Some(board) = &mut frame.board {
                let tracks = own.and_then(|own| Some(own.board.as_ref()?.tracks.clone()));
                board.tracks = tracks.unwrap_or_default();
            }
        }
        window
    }

    /// The window of a person, of these frames.
    fn window(&self, person: u32, place_m: [f64; 2], frames: &VecDeque<PointFrame>) -> Window {
        let end_s = frames.back().map_or(0.0, |f| f.time_s);
        let begins_s = self.begins_s(end_s);
        let n_earlier = frames.partition_point(|f| f.time_s < begins_s);
        Window {
            person,
            frames: frames.range(n_earlier..).cloned().collect(),
            earlier: frames.range(..n_earlier).cloned().collect(),
            place_m,
        }
    }

    /// What the radar reported in the time of the windows that end with the last frame, if that is kept.
    pub fn reported(&self) -> Option<Vec<PointFrame>> {
        (!self.reported.is_empty()).then(|| self.reported.iter().cloned().collect())
    }

    /// Removes points from the last seconds.
    pub fn remove(&mut self, is_removed: impl Fn(&RadarPoint) -> bool) {
        let tracks = self.people.values_mut().flat_map(|t| &mut t.frames);
        for frame in tracks.chain(&mut self.room) {
            frame.points.retain(|p| !is_removed(p));
        }
    }

    /// Whether somebody is in the room who is not tracked.
    pub fn is_lingering(&self) -> bool {
        self.lingering.is_some()
    }

    /// Whether windows end with the frame at `t_s`: the first one in every stride of the stream.
    pub fn is_due(&mut self, t_s: f64) -> bool {
        let stride = self.stride_at(t_s);
        self.stride.replace(stride) != Some(stride)
    }

    /// Changes the time between the starts of two windows, s. The next windows end with the next stride after `t_s`.
    pub fn set_stride(&mut self, stride_s: f64, t_s: f64) {
        self.options.stride_s = stride_s;
        self.stride = Some(self.stride_at(t_s));
    }

    fn stride_at(&self, t_s: f64) -> f64 {
        ((t_s + ROUNDING_S) / self.options.stride_s).floor()
    }

    /// Whether there were points after the last windows were taken.
    pub fn is_partly_new(&self) -> bool {
        self.is_partly_new
    }

    /// The windows that end with the last frame, of all who have been there for long enough.
    pub fn take(&mut self) -> Vec<Window> {
        self.is_partly_new = false;
        let lingering = self.lingering.as_ref().map(|(id, track)| (id, track));
        let mut there = self.people.iter().chain(lingering);
        let windows: Vec<Window> = match (there.next(), there.next()) {
            (Some((person, track)), None) if self.is_settled => {
                vec![self.window_of_room(*person, track)]
            }
            (Some(_), None) => Vec::new(),
            (None, _) => self.untracked().into_iter().collect(),
            _ => (self.people.iter())
                .map(|(person, track)| self.window(*person, track.place_m, &track.frames))
                .collect(),
        };
        let is_long =
            |w: &Window| w.end_s() - w.start_s() >= self.options.min_tracked_s - ROUNDING_S;
        windows.into_iter().filter(is_long).collect()
    }

    /// All points of the room, as those of somebody who cannot be tracked, if there are any.
    fn untracked(&self) -> Option<Window> {
        let mut window = self.window(UNTRACKED, [0.0; 2], &self.room);
        let middle = |axis: fn(&RadarPoint) -> f32| {
            let points = window.frames.iter().flat_map(|f| &f.points);
            median_upper(points.map(axis)).map(f64::from)
        };
        window.place_m = [middle(|p| p.x_m)?, middle(|p| p.y_m)?];
        Some(window)
    }

    /// Forgets everybody.
    pub fn clear(&mut self) {
        self.people.clear();
        self.room.clear();
        self.reported.clear();
        self.lingering = None;
        self.is_settled = false;
        self.is_partly_new = false;
    }
}

/// Adds a frame, and removes those before a time.
fn keep(frames: &mut VecDeque<PointFrame>, frame: PointFrame, oldest_s: f64) {
    frames.push_back(frame);
    while frames.front().is_some_and(|f| f.time_s < oldest_s) {
        frames.pop_front();
    }
}

/// Time from the first to the last frame, s.
fn length_s(frames: &VecDeque<PointFrame>) -> f64 {
    let ends = frames.front().zip(frames.back());
    ends.map_or(0.0, |(first, last)| last.time_s - first.time_s)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use radarllm_base::BoardTrack;

    use super::*;

    /// A frame with five points.
    fn frame(n: u32) -> PointFrame {
        PointFrame {
            frame: n,
            time_s: f64::from(n) / 10.0,
            points: vec![RadarPoint::default(); 5],
            board: None,
        }
    }

    fn person(person: u32, n_points: usize) -> PersonFrame {
        PersonFrame {
            person,
            place_m: [0.5, 2.0],
            points: vec![RadarPoint::default(); n_points],
            board: None,
        }
    }

    #[test]
    fn windows_are_six_seconds_long_and_begin_every_two() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        let mut found = Vec::new();
        for n in 0..121 {
            let gone = windows.push(&frame(n), &[person(1, 3)], true).ended;
            assert!(gone.is_empty());
            if windows.is_due(f64::from(n) / 10.0) {
                found.extend(windows.take());
            }
        }
        let spans: Vec<(f64, f64, usize)> = found
            .iter()
            .map(|w| (w.start_s(), w.end_s(), w.frames.len()))
            .collect();
        let expected = [
            (0.0, 4.0, 41),
            (0.1, 6.0, 60),
            (2.1, 8.0, 60),
            (4.1, 10.0, 60),
            (6.1, 12.0, 60),
        ];
        assert_eq!(spans, expected);
        // With the time before it, up to half a minute.
        let earlier = |w: &Window| (w.earlier.len(), w.earlier.last().map(|f| f.frame));
        assert_eq!(earlier(&found[1]), (1, Some(0)));
        assert_eq!(earlier(&found[4]), (61, Some(60)));
        for n in 121..500 {
            windows.push(&frame(n), &[person(1, 3)], true);
        }
        assert_eq!(earlier(&windows.take()[0]), (300, Some(439)));
        // One person has all points of the room.
        assert_eq!((found[1].n_points(), found[1].place_m), (300, [0.5, 2.0]));
        assert!(!windows.is_partly_new());
    }

    #[test]
    fn two_people_have_their_own_points() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        for n in 0..50 {
            windows.push(&frame(n), &[person(1, 3), person(2, 0)], true);
        }
        let both = windows.take();
        let points: Vec<(u32, u32)> = both.iter().map(|w| (w.person, w.n_points())).collect();
        assert_eq!(points, [(1, 150), (2, 0)]);
        assert_eq!(windows.push(&frame(50), &[person(2, 0)], true).ended, [1]);
        assert!(windows.is_partly_new());
        let left = windows.take();
        assert_eq!((left.len(), left[0].person), (1, 2));
        windows.remove(|_| true);
        assert_eq!(windows.take()[0].n_points(), 0);
        windows.clear();
        assert!(windows.take().is_empty());
    }

    #[test]
    fn whoever_is_lost_but_has_not_left_is_described_further() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        // Tracked for 2.9 s: too short for a window.
        for n in 0..30 {
            windows.push(&frame(n), &[person(1, 3)], true);
        }
        assert!(windows.take().is_empty());
        for n in 30..40 {
            windows.push(&frame(n), &[person(1, 3)], true);
        }
        for n in 40..60 {
            assert_eq!(windows.push(&frame(n), &[], true), TrackChanges::default());
            assert!(windows.is_lingering());
        }
        let window = &windows.take()[0];
        assert_eq!((window.person, window.n_points()), (1, 300));
        // Found again under the same number, then lost and found under another one.
        let same = windows.push(&frame(60), &[person(1, 3)], true);
        assert_eq!(same, TrackChanges::default());
        assert!(!windows.is_lingering());
        assert_eq!(windows.take()[0].person, 1);
        assert_eq!(windows.push(&frame(61), &[], true), TrackChanges::default());
        // Alone as the one before: the same person.
        let new = windows.push(&frame(62), &[person(2, 3)], true);
        assert_eq!((new.ended, new.renamed), (Vec::new(), Some([1, 2])));
        assert_eq!(windows.take()[0].person, 2);
        // Gone.
        assert_eq!(windows.push(&frame(63), &[], false).ended, [2]);
        assert!(windows.take().is_empty());
    }

    /// Somebody who was tracked by the board is lost while somebody else is there.
    #[test]
    fn who_is_left_alone_does_not_have_the_track_of_somebody_else() {
        let track = |id: u32| BoardTrack {
            id,
            place_m: [id as f32, 2.0],
            height_m: None,
            velocity_mps: [0.0; 3],
        };
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        // 1 is there until 8 s, 2 comes at 5 s, and goes on as 3 from 12 s on.
        for n in 0..140 {
            let there = [(1, 0..80), (2, 50..120), (3, 121..140)];
            let there = there.into_iter().filter(|(_, times)| times.contains(&n));
            let ids: Vec<u32> = there.map(|(id, _)| id).collect();
            let people: Vec<PersonFrame> = (ids.iter())
                .map(|id| PersonFrame {
                    board: Some(track(*id)),
                    ..person(*id, 3)
                })
                .collect();
            let frame = PointFrame {
                board: Some(BoardReport {
                    tracks: ids.iter().map(|id| track(*id)).collect(),
                    is_present: None,
                }),
                ..frame(n)
            };
            windows.push(&frame, &people, true);
        }
        let window = &windows.take()[0];
        assert_eq!((window.person, window.n_points()), (3, 300));
        let ids = |frames: &[PointFrame]| -> BTreeSet<u32> {
            let tracks = frames.iter().flat_map(|f| &f.board).flat_map(|b| &b.tracks);
            tracks.map(|track| track.id).collect()
        };
        assert_eq!(ids(&window.frames), BTreeSet::from([2, 3]));
        assert_eq!(ids(&window.earlier), BTreeSet::from([2]));
    }

    #[test]
    fn while_nobody_is_tracked_the_points_of_the_room_may_be_somebody() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        let at = |n: u32| {
            let mut frame = frame(n);
            for (i, point) in (0u8..).zip(&mut frame.points) {
                (point.x_m, point.y_m) = (f32::from(i), 2.0);
            }
            frame
        };
        for n in 0..30 {
            windows.push(&at(n), &[], false);
        }
        // Shorter than a window may be.
        assert!(windows.take().is_empty());
        for n in 30..50 {
            windows.push(&at(n), &[], false);
        }
        let window = &windows.take()[0];
        assert_eq!((window.person, window.n_points()), (UNTRACKED, 250));
        assert_eq!(window.place_m, [2.0, 2.0]);
        // Without points there is no window.
        windows.remove(|_| true);
        assert!(windows.take().is_empty());
        // What belonged to a person who left is not somebody else's.
        for n in 50..80 {
            windows.push(&at(n), &[person(1, 3)], true);
        }
        assert_eq!(windows.push(&at(80), &[], false).ended, [1]);
        assert!(windows.take().is_empty());
    }

    #[test]
    fn options_are_checked() {
        let long = WindowOptions {
            window_s: 10.0,
            ..WindowOptions::default()
        };
        assert_eq!(Windows::new(long).unwrap_err().field, "window_s");
    }
}
