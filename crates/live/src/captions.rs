//! The model as the pipeline uses it.

use radarllm::{Captioner, Clip, Description, SiteLearner};
use radarllm_monitor::activities::actions_of;
use radarllm_monitor::pipeline::{Describe, Described};

/// Describes windows with a trained model. The site is learned of people whom the board tracks while they walk, unless it is
/// given.
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
        if first_s < self.learned_until_s || clip.frames.iter().all(|f| f.board.is_none()) {
            return;
        }
        self.learned_until_s = last_s;
        learner.add(&clip.frames);
        if let Ok(site) = learner.site(&clip.radar) {
            self.captioner.set_site(Some(site));
        }
    }
}

impl Captions {
    /// A sentence with its actions. Where they are measured, changes of posture are actions, too.
    fn sentence(&self, clip: &Clip, description: Description) -> Described {
        let mut actions = actions_of(&description.caption);
        let mut measured = Vec::new();
        if self.captioner.measures(clip) {
            actions = with_changes(actions);
            let taught = description.segments.iter().filter(|s| s.taught.is_some());
            let taught: Vec<&str> = taught.flat_map(|s| s.actions.iter().copied()).collect();
            let is_measured = |action: &&String| !taught.contains(&action.as_str());
            measured = actions.iter().filter(is_measured).cloned().collect();
        }
        Described::Sentence {
            actions,
            measured,
            confidence: description.confidence.into(),
            caption: description.caption,
        }
    }
}

/// Measured actions with the changes between them: who walks or stands after sitting or lying has got up, and who sits or
/// lies afterwards has sat or lain down, unless by a fall.
fn with_changes(actions: Vec<String>) -> Vec<String> {
    let is_up = |action: &str| ["walk", "pace", "stand_still"].contains(&action);
    let mut all: Vec<String> = Vec::with_capacity(actions.len());
    for action in actions {
        let change = match (all.last().map(String::as_str), action.as_str()) {
            (Some("sit_still" | "lie_still"), now) if is_up(now) => Some("stand_up"),
            (Some(before), "sit_still") if is_up(before) => Some("sit_down"),
            (Some(before), "lie_still") if is_up(before) => Some("lie_down"),
            _ => None,
        };
        all.extend(change.map(String::from));
        all.push(action);
    }
    all
}

impl Describe for Captions {
    fn describe(&mut self, clip: &Clip) -> Described {
        self.learn(clip);
        match self.captioner.describe(clip) {
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

/// All actions that a sentence can state, in alphabetical order.
pub fn actions() -> Vec<String> {
    let actions = radarllm_facts::tables::stated_actions();
    actions.map(str::to_string).collect()
}

#[cfg(test)]
mod tests {
    use radarllm::{Clutter, Provenance, Site};
    use radarllm_base::{BoardReport, BoardTrack, PointFrame, RadarPoint};

    use super::*;

    #[test]
    fn changes_of_measured_postures_are_actions() {
        let of = |actions: &[&str]| with_changes(actions.iter().map(|a| (*a).into()).collect());
        let day = ["walk", "sit_still", "pace", "lie_still", "stand_still"];
        let expected = [
            "walk",
            "sit_down",
            "sit_still",
            "stand_up",
            "pace",
            "lie_down",
            "lie_still",
            "stand_up",
            "stand_still",
        ];
        assert_eq!(of(&day), expected);
        // A fall is no lying down, and a pause no change.
        assert_eq!(
            of(&["walk", "fall", "lie_still"]),
            ["walk", "fall", "lie_still"]
        );
        assert_eq!(
            of(&["walk", "stand_still", "walk"]),
            ["walk", "stand_still", "walk"]
        );
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
        let described = Captions::new(Captioner::bundled().unwrap()).describe(&clip);
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
        match captions.describe(clip) {
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
        let standing = window(100.0, |_| 4.0);
        let mut captions = Captions::new(Captioner::bundled().unwrap());
        // With the stated tilt, the person seems to be 0.8 m lower.
        let before = caption(&mut captions, &standing);
        assert!(!before.contains("stands"), "{before}");
        let mut captions = Captions::new(Captioner::bundled().unwrap());
        for i in 0..12 {
            captions.describe(&window(f64::from(i) * 2.0, walk));
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
            captions.describe(&window(f64::from(i) * 2.0, walk));
        }
        assert_eq!(captions.captioner.site(), Some(&given));
    }
}
