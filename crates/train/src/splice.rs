//! Clips of two actions, made of clips of one.
//!
//! The pairs of actions that a data set shows in sequence are few of those that there are, so that a language model learns
//! which pairs there are rather than that one action follows another. Spliced clips show any pair. Nothing is simulated:
//! the second clip is turned about the radar and moved along the line of sight until it begins where the first one ends,
//! which leaves its velocities as they are.

use std::collections::BTreeMap;

use radarllm_base::{PointFrame, RadarPoint, seed::derive_seed};
use radarllm_dataset::ClipRecord;
use radarllm_facts::parse;
use radarllm_inference::{FRAME_RATE_HZ, tokenizer::MAX_FRAMES};

/// Draws until two clips fit together.
const MAX_DRAWS: u64 = 20;
/// Frames at the seam that show where a person is.
const SEAM_FRAMES: usize = 5;
/// Actions after which a person does not stand, or before which it does not.
const NOT_STANDING_AFTER: [&str; 5] = ["sit_down", "lie_down", "fall", "kneel", "crouch"];
const NOT_STANDING_BEFORE: [&str; 4] = ["stand_up", "sit_still", "lie_still", "crawl"];

/// A clip of one action, with its captions that state it in one clause.
struct Part<'a> {
    clip: &'a ClipRecord,
    captions: Vec<(&'a str, String)>,
}

impl<'a> Part<'a> {
    fn of(clip: &'a ClipRecord) -> Option<Self> {
        let of_caption = |text: &'a String| match parse(text).as_slice() {
            [clause] if !clause.actions.is_empty() => {
                let sentence = clause.sentence();
                let predicate = sentence.strip_prefix("a person ")?.to_owned();
                Some((text.as_str(), predicate))
            }
            _ => None,
        };
        let captions: Vec<_> = clip.captions.iter().filter_map(of_caption).collect();
        (!captions.is_empty()).then_some(Self { clip, captions })
    }

    fn states_any(&self, actions: &[&str]) -> bool {
        let clauses = parse(self.captions[0].0);
        let mut stated = clauses.iter().flat_map(|clause| &clause.actions);
        stated.any(|action| actions.contains(&action.name))
    }

    fn n_frames(&self) -> usize {
        self.clip.frames.len()
    }
}

/// Clips of two actions, `count` of them or fewer if hardly any clips fit together.
pub(crate) fn spliced(clips: &[ClipRecord], count: usize, seed: u64) -> Vec<ClipRecord> {
    // Both parts are seen by one radar at one height.
    let mut by_radar: BTreeMap<(&str, u32), Vec<Part>> = BTreeMap::new();
    for part in clips.iter().filter_map(Part::of) {
        let place = (part.clip.radar.as_str(), part.clip.radar_height_m.to_bits());
        by_radar.entry(place).or_default().push(part);
    }
    let groups: Vec<&Vec<Part>> = by_radar.values().collect();
    let n_parts: usize = groups.iter().map(|group| group.len()).sum();
    if n_parts < 2 {
        return Vec::new();
    }
    let one = |i: usize| {
        (0..MAX_DRAWS).find_map(|draw| {
            let pick = |name: &str, n: usize| {
                let drawn = derive_seed(seed, &format!("splice/{i}/{draw}/{name}"));
                (drawn % n as u64) as usize
            };
            let mut at = pick("first", n_parts);
            let group = groups.iter().find(|group| {
                let is_own = at < group.len();
                at -= if is_own { 0 } else { group.len() };
                is_own
            })?;
            let (first, second) = (&group[at], &group[pick("second", group.len())]);
            splice(first, second, &format!("spliced-{i:06}"))
        })
    };
    (0..count).filter_map(one).collect()
}

fn splice(first: &Part, second: &Part, id: &str) -> Option<ClipRecord> {
    let n_frames = first.n_frames() + second.n_frames();
    if first.clip.action == second.clip.action
        || n_frames > MAX_FRAMES
        || first.states_any(&NOT_STANDING_AFTER)
        || second.states_any(&NOT_STANDING_BEFORE)
    {
        return None;
    }
    let (a, b) = (&first.clip.frames, &second.clip.frames);
    let from = centre(b.iter())?;
    let to = centre(a.iter().rev())?;
    let start_s = a.last()?.time_s + 1.0 / f64::from(FRAME_RATE_HZ);
    let own_start_s = b.first()?.time_s;
    let number = a.last()?.frame + 1;
    let moved = b.iter().enumerate().map(|(i, frame)| PointFrame {
        frame: number + i as u32,
        time_s: start_s + (frame.time_s - own_start_s),
        points: frame.points.iter().map(|p| moved(*p, from, to)).collect(),
    });
    let frames: Vec<PointFrame> = a.iter().cloned().chain(moved).collect();
    let pairs = first.captions.iter().zip(&second.captions);
    let joined = pairs.zip([", then", " and then"].iter().cycle());
    let captions = joined.map(|(((text, _), (_, predicate)), then)| {
        format!("{}{then} {predicate}", text.trim_end_matches('.'))
    });
    Some(ClipRecord {
        id: format!("{id}#0"),
        motion_id: id.into(),
        group: id.into(),
        action: format!("{} then {}", first.clip.action, second.clip.action),
        captions: captions.collect(),
        frames,
        joints: Vec::new(),
        motion_features: Vec::new(),
        ..(*first.clip).clone()
    })
}

/// Bearing and distance of the person in the first frames with points: radians from the boresight to the right, and m.
fn centre<'a>(frames: impl Iterator<Item = &'a PointFrame>) -> Option<[f32; 2]> {
    let seen = frames.filter(|f| !f.points.is_empty()).take(SEAM_FRAMES);
    let points: Vec<&RadarPoint> = seen.flat_map(|f| &f.points).collect();
    let n = points.len() as f32;
    let x_m = points.iter().map(|p| p.x_m).sum::<f32>() / n;
    let y_m = points.iter().map(|p| p.y_m).sum::<f32>() / n;
    (!points.is_empty()).then(|| [x_m.atan2(y_m), x_m.hypot(y_m)])
}

/// A point of a person who stands elsewhere: turned about the radar and moved along its bearing.
fn moved(p: RadarPoint, from: [f32; 2], to: [f32; 2]) -> RadarPoint {
    let bearing_rad = p.x_m.atan2(p.y_m) + to[0] - from[0];
    let distance_m = (p.x_m.hypot(p.y_m) + to[1] - from[1]).max(0.1);
    let range_m = distance_m.hypot(p.z_m);
    let old_range_m = p.range_m.max(0.1);
    RadarPoint {
        x_m: distance_m * bearing_rad.sin(),
        y_m: distance_m * bearing_rad.cos(),
        range_m,
        // The power of an echo falls with the fourth power of the range.
        intensity_db: p.intensity_db - 40.0 * (range_m / old_range_m).log10(),
        ..p
    }
}

#[cfg(test)]
mod tests {
    use radarllm_dataset::Split;

    use super::*;

    /// A person at a place who recedes, with one point a frame.
    fn clip(name: &str, action: &str, captions: &[&str], n_frames: u32, x_m: f32) -> ClipRecord {
        let frame = |i: u32| {
            let y_m = 2.0 + 0.01 * i as f32;
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: vec![RadarPoint {
                    x_m,
                    y_m,
                    z_m: 0.5,
                    range_m: x_m.hypot(y_m).hypot(0.5),
                    velocity_mps: 0.1,
                    intensity_db: 20.0,
                }],
            }
        };
        ClipRecord {
            id: format!("{name}#0"),
            motion_id: name.into(),
            group: name.into(),
            split: Split::Train,
            action: action.into(),
            captions: captions.iter().map(|&text| text.into()).collect(),
            source: "procedural".into(),
            radar: "board".into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: (0..n_frames).map(frame).collect(),
            motion_fps: 20.0,
            joints: Vec::new(),
            motion_features: Vec::new(),
        }
    }

    #[test]
    fn two_actions_follow_one_another_in_one_place() {
        let walk = clip(
            "a",
            "walk",
            &["a person walks", "someone walks, then bows"],
            40,
            0.0,
        );
        let wave = clip("b", "wave", &["the person waves twice"], 30, 1.5);
        let all = spliced(&[walk.clone(), wave.clone()], 8, 1);
        assert!(!all.is_empty());
        for clip in &all {
            let walks_first = clip.captions == ["a person walks, then waves twice"];
            assert!(walks_first || clip.captions == ["the person waves twice, then walks"]);
            assert_eq!(clip.frames.len(), 70);
            assert!(clip.frames.windows(2).all(|w| w[0].frame + 1 == w[1].frame));
            assert!(
                clip.frames
                    .windows(2)
                    .all(|w| (w[1].time_s - w[0].time_s - 0.1).abs() < 1e-9)
            );
            let seam = if walks_first { 40 } else { 30 };
            let [before, after] = [seam - 1, seam].map(|i| clip.frames[i].points[0]);
            let step_m = (before.x_m - after.x_m).hypot(before.y_m - after.y_m);
            assert!(step_m < 0.1, "{step_m} m from one frame to the next");
            for p in clip.frames.iter().flat_map(|f| &f.points) {
                let range_m = p.x_m.hypot(p.y_m).hypot(p.z_m);
                assert!((range_m - p.range_m).abs() < 1e-4);
                assert_eq!(p.velocity_mps, 0.1);
            }
        }
        assert_eq!(
            spliced(&[walk, wave], 8, 1),
            all,
            "the same seed gives the same clips"
        );
    }

    #[test]
    fn what_does_not_fit_is_not_spliced() {
        let wave = || clip("b", "wave", &["a person waves"], 30, 0.0);
        let none = |other: ClipRecord| assert_eq!(spliced(&[other, wave()], 8, 1), []);
        none(clip("a", "wave", &["a person waves"], 30, 0.0));
        none(clip("a", "walk", &["a person walks, then bows"], 30, 0.0));
        none(clip("a", "walk", &["a person walks"], 90, 0.0));
        none(clip("a", "stop", &["a person does something"], 30, 0.0));
        none(ClipRecord {
            radar: "another".into(),
            ..clip("a", "walk", &["a person walks"], 30, 0.0)
        });
        // Somebody who lies does not wave next, but somebody who waves may lie down.
        let falls = clip("a", "fall", &["a person falls to the floor"], 30, 0.0);
        let all = spliced(&[falls, wave()], 8, 1);
        assert!(!all.is_empty());
        assert!(all.iter().all(|c| c.action == "wave then fall"));
        assert_eq!(spliced(&[], 8, 1), []);
    }
}
