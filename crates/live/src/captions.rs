//! The model as the pipeline uses it.

use radarllm::{Captioner, Clip};
use radarllm_monitor::activities::actions_of;
use radarllm_monitor::pipeline::{Describe, Described};

/// Describes windows with a trained model.
pub struct Captions(pub Captioner);

impl Describe for Captions {
    fn describe(&mut self, clip: &Clip) -> Described {
        match self.0.describe(clip) {
            Ok(description) => match description.abstained {
                Some(reason) => Described::Abstained {
                    reason: reason.to_string(),
                },
                None => Described::Sentence {
                    actions: actions_of(&description.caption),
                    confidence: description.confidence.into(),
                    caption: description.caption,
                },
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
    use radarllm::{Clutter, Provenance};
    use radarllm_base::{PointFrame, RadarPoint};

    use super::*;

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
            radar: "test".into(),
            provenance: Provenance::simulated("test", 0),
            clutter: Clutter::Settled,
        };
        let described = Captions(Captioner::bundled().unwrap()).describe(&clip);
        assert!(
            matches!(&described, Described::Failed { error } if !error.is_empty()),
            "{described:?}"
        );
    }
}
