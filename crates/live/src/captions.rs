//! The model as the pipeline uses it.

use radarllm::{
    Captioner, Clip, DescribeOptions, Description, Error, PreparedClip, Segment, SiteLearner,
    is_general, learn_from, measure::Posture,
};
use radarllm_monitor::activities::{WindowCaption, actions_of};
use radarllm_monitor::measured::MeasuredSpan;
use radarllm_monitor::pipeline::{Describe, Described, StreamInfo, WindowContext};

/// Actions of measured postures.
const STANDS: &str = "stand_still";
const SITS: &str = "sit_still";
const LIES: &str = "lie_still";

/// The posture of a measured action.
fn posture_of(action: &str) -> Option<Posture> {
    match action {
        STANDS => Some(Posture::Standing),
        SITS => Some(Posture::Sitting),
        LIES => Some(Posture::Lying),
        _ => None,
    }
}

/// Describes windows with a trained model. The site is learned of people while they walk, whom the board tracks or the points
/// show, unless it is given.
pub struct Captions {
    captioner: Captioner,
    /// `None` if the site is given.
    learner: Option<SiteLearner>,
    /// End of what was learned, s.
    learned_until_s: f64,
}

impl Captions {
    /// Describes with this model, and with its site if it has one.
    pub fn new(captioner: Captioner) -> Self {
        Self {
            learner: captioner.site().is_none().then(SiteLearner::default),
            captioner,
            learned_until_s: f64::MIN,
        }
    }

    /// Learns of a window, unless another one had a part of its time: windows overlap.
    fn learn(&mut self, clip: &Clip) {
        let (Some(learner), Some([first_s, last_s])) = (
            &mut self.learner,
            (clip.frames.first().zip(clip.frames.last())).map(|(a, b)| [a.time_s, b.time_s]),
        ) else {
            return;
        };
        if first_s < self.learned_until_s || !self.captioner.measures(clip) {
            return;
        }
        self.learned_until_s = last_s;
        learn_from(learner, &clip.frames);
        if let Ok(site) = learner.site(&clip.radar) {
            self.captioner.set_site(Some(site));
        }
    }
}

impl Captions {
    /// A sentence with its actions, and those of them that are measured.
    fn sentence(&self, clip: &Clip, description: Description) -> Described {
        let actions = stated(&description);
        let measured = match self.captioner.measures(clip) {
            true => measured_spans(&description),
            false => Vec::new(),
        };
        Described::Sentence {
            actions,
            measured,
            confidence: (!description.segments.iter().all(is_general))
                .then(|| description.confidence.into()),
            caption: description.caption,
        }
    }
}

/// What a description says that is measured: all but taught activities, and actions that a taught one states as well.
fn measured_spans(description: &Description) -> Vec<MeasuredSpan> {
    let taught = description.segments.iter().filter_map(|s| {
        let name = s.taught.as_deref()?;
        Some(s.actions.iter().copied().chain([name]))
    });
    let taught: Vec<&str> = taught.flatten().collect();
    let measured = description.segments.iter().filter(|s| s.taught.is_none());
    let span = |s: &Segment| MeasuredSpan {
        start_s: s.start_s,
        end_s: s.end_s,
        action: s.actions.last().map(|action| (*action).into()),
        caption: WindowCaption {
            text: s.caption.clone(),
            confidence: (!is_general(s)).then(|| s.confidence.into()),
            place_m: None,
        },
    };
    measured
        .map(span)
        .filter(|span| (span.action.as_deref()).is_none_or(|action| !taught.contains(&action)))
        .collect()
}

/// What is known of a stream before its first frame.
pub(crate) fn without_frames(stream: &StreamInfo) -> Clip {
    Clip {
        frames: Vec::new(),
        frame_rate_hz: 1.0 / stream.frame_period_s,
        radar_height_m: stream.radar_height_m as f32,
        is_height_assumed: stream.is_height_assumed,
        radar: stream.radar.clone(),
        provenance: stream.provenance.clone(),
        clutter: stream.clutter,
    }
}

/// The actions of a description, in order of time. A taught sentence that states none that is known has the name under which
/// it was taught.
fn stated(description: &Description) -> Vec<String> {
    let is_unknown = |s: &Segment| s.taught.is_some() && s.actions.is_empty();
    if !description.segments.iter().any(is_unknown) {
        return actions_of(&description.caption);
    }
    let of_segment = |segment: &Segment| match &segment.taught {
        Some(name) if segment.actions.is_empty() => vec![name.clone()],
        _ => actions_of(&segment.caption),
    };
    description.segments.iter().flat_map(of_segment).collect()
}

impl Describe for Captions {
    fn measures_falls(&self, stream: &StreamInfo) -> bool {
        self.captioner.measures(&without_frames(stream))
    }

    fn describe(&mut self, clip: &Clip, context: WindowContext) -> Described {
        self.learn(clip);
        // Guesses about boards that the model did not learn are not shown.
        let options = DescribeOptions {
            guesses: false,
            ..DescribeOptions::default()
        };
        let described = PreparedClip::of(clip)
            .map_err(Error::wrap)
            .and_then(|clip| {
                let clip = match context.reported {
                    Some(reported) => clip.with_reported(reported),
                    None => clip,
                };
                let before = context.before.as_deref().and_then(posture_of);
                self.captioner
                    .describe_window(&clip, &options, &context.earlier, before)
            });
        match described {
            Ok(description) => match description.abstained {
                Some(reason) => Described::Abstained {
                    reason: reason.to_string(),
                },
                None => self.sentence(clip, description),
            },
            Err(error) => Described::Failed {
                error: error.to_string(),
            },
        }
    }
}

/// All actions that a sentence can state, in alphabetical order, and then the taught activities.
pub fn actions(captioner: &Captioner) -> Vec<String> {
    let actions = radarllm_facts::tables::stated_actions();
    let mut all: Vec<String> = actions.map(str::to_string).collect();
    all.extend(captioner.taught_names().into_iter().map(String::from));
    all
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use radarllm::{Clutter, Provenance, Site};
    use radarllm_base::{BoardReport, BoardTrack, PointFrame, RadarPoint, random::SplitMix64};
    use radarllm_monitor::messages::{Body, FallState, PresenceState};
    use radarllm_monitor::pipeline::{Arrival, Output, Pipeline, PipelineOptions};
    use radarllm_monitor::rows::Activity;

    use super::*;

    fn segment(caption: &str, taught: Option<&str>) -> Segment {
        Segment {
            start_s: 0.0,
            end_s: 3.0,
            caption: caption.into(),
            actions: radarllm_facts::parse(caption)
                .iter()
                .filter_map(|clause| clause.actions.first().map(|action| action.name))
                .collect(),
            confidence: 0.9,
            side_confidence: None,
            taught: taught.map(String::from),
            guess: None,
        }
    }

    #[test]
    fn a_taught_sentence_without_a_known_action_has_the_name_under_which_it_was_taught() {
        let of = |segments: Vec<Segment>| {
            let captions: Vec<&str> = segments.iter().map(|s| s.caption.as_str()).collect();
            stated(&Description {
                caption: captions.join(", then "),
                segments,
                ..Description::default()
            })
        };
        let walks = segment("a person walks forward", None);
        let patrols = segment("a nurse patrols the room", Some("patrol"));
        assert!(patrols.actions.is_empty());
        assert_eq!(of(vec![walks.clone(), patrols]), ["walk", "patrol"]);
        // Where it states one that is known, that one is used.
        let sits = segment("a person sits down in the wheelchair", Some("wheelchair"));
        assert_eq!(of(vec![walks, sits]), ["walk", "sit_down"]);
    }

    #[test]
    fn an_error_of_the_model_is_no_abstention() {
        let frame = PointFrame {
            frame: 0,
            time_s: 0.0,
            points: vec![RadarPoint::default()],
            board: None,
        };
        let clip = Clip {
            frames: vec![frame; 60],
            frame_rate_hz: f64::NAN,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::simulated("test", 0),
            clutter: Clutter::Settled,
        };
        let described =
            Captions::new(Captioner::bundled().unwrap()).describe(&clip, WindowContext::default());
        assert!(
            matches!(&described, Described::Failed { error } if !error.is_empty()),
            "{described:?}"
        );
    }

    /// A window of 6 s of a board that looks 12 degrees farther down than it states. A person is tracked there at these
    /// distances, 0.3 m below the radar.
    fn window(start_s: f64, at_m: impl Fn(f64) -> f32) -> Clip {
        let (sin, cos) = 12_f32.to_radians().sin_cos();
        let frame = |i: u32| {
            let time_s = start_s + f64::from(i) / 10.0;
            let (y_m, z_m) = (at_m(time_s), -0.3);
            PointFrame {
                frame: (time_s * 10.0).round() as u32,
                time_s,
                points: Vec::new(),
                board: Some(BoardReport {
                    tracks: vec![BoardTrack {
                        id: 1,
                        place_m: [0.0, y_m * cos + z_m * sin],
                        height_m: Some(z_m * cos - y_m * sin),
                        velocity_mps: [0.0; 3],
                    }],
                    is_present: Some(true),
                }),
            }
        };
        Clip {
            frames: (0..60).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.95,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:uart:x".parse().unwrap(),
            clutter: Clutter::Settled,
        }
    }

    fn caption(captions: &mut Captions, clip: &Clip) -> String {
        match captions.describe(clip, WindowContext::default()) {
            Described::Sentence { caption, .. } => caption,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_site_is_learned_while_people_walk() {
        let walk = |t: f64| {
            let phase = (t as f32 * 0.8).rem_euclid(6.0);
            1.0 + if phase < 3.0 { phase } else { 6.0 - phase }
        };
        let standing = window(100.0, |_| 3.0);
        let mut captions = Captions::new(Captioner::bundled().unwrap());
        // With the stated tilt, the person seems to be 0.6 m lower.
        let before = caption(&mut captions, &standing);
        assert!(!before.contains("stands"), "{before}");
        let mut captions = Captions::new(Captioner::bundled().unwrap());
        for i in 0..12 {
            captions.describe(&window(f64::from(i) * 2.0, walk), WindowContext::default());
        }
        let site = captions.captioner.site().unwrap();
        assert!((site.tilt_rad.to_degrees() - 12.0).abs() < 2.0, "{site:?}");
        // Windows begin every 2 s and last 6 s: a third of them has new time only.
        assert!((10.0..26.0).contains(&site.walking_s), "{site:?}");
        let after = caption(&mut captions, &standing);
        assert!(after.contains("stands still"), "{after}");
        // A site that is given stays.
        let given = Site::unlearned("board", 1.95);
        let mut captions =
            Captions::new(Captioner::bundled().unwrap().with_site(Some(given.clone())));
        for i in 0..12 {
            captions.describe(&window(f64::from(i) * 2.0, walk), WindowContext::default());
        }
        assert_eq!(captions.captioner.site(), Some(&given));
    }

    /// A board that sends points alone, among them those of what keeps still.
    #[test]
    fn a_fall_below_the_beam_is_stated_by_what_the_board_reports() {
        let point = |y_m: f32, velocity_mps: f32, intensity_db: f32| RadarPoint {
            y_m,
            range_m: y_m,
            velocity_mps,
            intensity_db,
            ..RadarPoint::default()
        };
        let frame = |i: u32, is_static: bool| {
            let moving = if i < 40 { 3 } else { 0 };
            let mut points = vec![point(1.2, 0.2, 40.0); moving];
            if is_static {
                points.push(point(3.0, 0.0, 15.0));
            } else {
                points.push(point(3.0, 0.1, 12.0));
            }
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points,
                board: None,
            }
        };
        let clip = |is_static: bool| Clip {
            frames: (0..60).map(|i| frame(i, is_static)).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "unknown".into(),
            provenance: "recorded:uart:x".parse().unwrap(),
            clutter: Clutter::Settled,
        };
        let mut captions = Captions::new(Captioner::bundled().unwrap());
        let mut stated = |reported: Option<Clip>| {
            let context = WindowContext {
                reported,
                ..WindowContext::default()
            };
            match captions.describe(&clip(false), context) {
                Described::Sentence {
                    actions, measured, ..
                } => (actions, measured),
                other => panic!("{other:?}"),
            }
        };
        let (actions, measured) = stated(Some(clip(true)));
        assert!(actions.contains(&"fall".to_string()), "{actions:?}");
        let is_fall = |span: &MeasuredSpan| span.action.as_deref() == Some("fall");
        assert!(measured.iter().any(is_fall), "{measured:?}");
        assert!(!stated(None).0.contains(&"fall".to_string()));
    }

    /// Frames of somebody who does one thing after another before a board that tracks: walks, crawls, stands, sits, lies, falls,
    /// is lost, and is found again under the same number or another one.
    fn tracked_frames(random: &mut SplitMix64) -> Vec<PointFrame> {
        const STANDS_M: f64 = 0.2;
        let (mut id, mut is_seen) = (1, true);
        let (mut place_m, mut height_m) = ([0.0, 3.0], STANDS_M);
        let mut frames: Vec<PointFrame> = Vec::new();
        while frames.len() < 1_500 {
            let to_m = [
                random.uniform_f64() * 4.0 - 2.0,
                1.0 + random.uniform_f64() * 4.0,
            ];
            let (mut goes, mut to_height_m, mut fall_s) = (false, STANDS_M, 0.5);
            match random.below(8) {
                0 | 1 => goes = true,
                2 => (goes, to_height_m) = (true, -1.1),
                3 => {}
                4 => to_height_m = -0.4,
                5 => to_height_m = -1.2,
                6 => (to_height_m, fall_s) = (-1.2, 0.2),
                _ => {
                    is_seen = !is_seen;
                    id += random.below(2) as u32;
                }
            }
            let n = 10 + random.below(150);
            let from_m = place_m;
            for k in 0..n {
                let share = k as f64 / n as f64;
                if goes {
                    place_m = [0, 1].map(|axis| from_m[axis] + share * (to_m[axis] - from_m[axis]));
                }
                let step_m = (to_height_m - height_m) * 0.05 / fall_s;
                height_m += step_m;
                let i = frames.len() as u32;
                let trembles = |random: &mut SplitMix64| 0.1 * (random.uniform_f64() - 0.5);
                let track = BoardTrack {
                    id,
                    place_m: place_m.map(|m| (m + trembles(random)) as f32),
                    height_m: Some((height_m + trembles(random)) as f32),
                    velocity_mps: [0.0, 0.0, 10.0 * step_m as f32],
                };
                frames.push(PointFrame {
                    frame: i,
                    time_s: f64::from(i) / 10.0,
                    points: Vec::new(),
                    board: Some(BoardReport {
                        tracks: is_seen.then_some(track).into_iter().collect(),
                        is_present: None,
                    }),
                });
            }
        }
        frames
    }

    /// The postures of actions; those that do not exclude each other have the same one.
    fn is_up(action: &str) -> Option<bool> {
        match action {
            "walk" | "pace" | STANDS => Some(true),
            SITS | LIES | "fall" => Some(false),
            _ => None,
        }
    }

    #[test]
    fn what_is_said_at_one_moment_does_not_contradict_itself() {
        let (mut n_falls, mut n_rows) = (0, 0);
        for seed in 0..24 {
            let mut random = SplitMix64::new(seed);
            let stream = StreamInfo {
                frame_period_s: 0.1,
                radar_height_m: 1.5,
                is_height_assumed: seed % 3 == 0,
                radar: "board".into(),
                provenance: "recorded:uart:x".parse().unwrap(),
                clutter: Clutter::Settled,
            };
            let describe = Box::new(Captions::new(Captioner::bundled().unwrap()));
            let options = PipelineOptions::default();
            let mut pipeline = Pipeline::new(stream, &options, describe, Arc::default()).unwrap();
            let (mut fallen, mut presence) = (BTreeMap::new(), PresenceState::Absent);
            let mut rows: BTreeMap<u64, Activity> = BTreeMap::new();
            let mut outputs: Vec<Vec<Output>> = (tracked_frames(&mut random).into_iter())
                .map(|frame| pipeline.push_frame(frame, Arrival::Replayed(0), true))
                .collect();
            outputs.push(pipeline.finish());
            for output in outputs {
                let mut said = Vec::new();
                for one in output {
                    match one {
                        Output::Row { row, activity, .. } => {
                            rows.insert(row, activity);
                        }
                        Output::Message(_, Body::Presence(now)) => presence = now.state,
                        Output::Message(_, Body::Fall(fall)) => {
                            match fall.state {
                                FallState::Suspected => fallen.insert(fall.id, fall.person),
                                FallState::Confirmed => None,
                                _ => fallen.remove(&fall.id),
                            };
                            n_falls += usize::from(fall.state == FallState::Suspected);
                        }
                        Output::Message(stamp, Body::Now(now)) => said.push((stamp.t_s, now)),
                        _ => {}
                    }
                }
                for (t_s, now) in said {
                    let Some(caption) = &now.caption else {
                        continue;
                    };
                    let what = format!("seed {seed}, {t_s} s: {caption:?}, label {}", now.label);
                    assert_ne!(presence, PresenceState::Absent, "{what}");
                    let last = caption.rsplit(", then ").next().map(actions_of);
                    let last = last.and_then(|actions| actions.last().cloned());
                    if now.label != "unsure" {
                        assert_eq!(last.as_deref(), Some(&now.label[..]), "{what}");
                    }
                    let has_fallen = fallen.values().any(|person| *person == now.person);
                    let is_up = last.as_deref().and_then(is_up) == Some(true);
                    assert!(!(has_fallen && is_up), "{what}, and has fallen");
                }
            }
            let rows: Vec<Activity> = rows.into_values().collect();
            for (i, one) in rows.iter().enumerate() {
                for other in &rows[i + 1..] {
                    let both_ms = one.end_ms.min(other.end_ms) - one.start_ms.max(other.start_ms);
                    let postures = [one, other].map(|row| is_up(&row.action));
                    let is_one = one.person != other.person || postures.contains(&None);
                    assert!(is_one || both_ms <= 0, "seed {seed}: {one:?} and {other:?}");
                }
            }
            n_rows += rows.len();
        }
        assert!(
            n_falls > 10 && n_rows > 100,
            "{n_falls} falls, {n_rows} rows"
        );
    }
}
