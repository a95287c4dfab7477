//! Descriptions with taught activities in them.

use radarllm_base::Clip;
use radarllm_inference::{Description, Segment};
use radarllm_teach::{Recognised, Recogniser};

/// What is left of a segment beside a taught one is kept if it is at least this long, s.
const MIN_REST_S: f64 = 1.0;

/// Actions that are measured where the board tracks people. Of two of them at most one is so at a time.
const MEASURED: [&str; 5] = ["stand_still", "sit_still", "lie_still", "walk", "fall"];

/// Replaces what the description of a clip says about the times in which taught activities are recognised. The clip is
/// that of [`crate::PreparedClip::moving`].
///
/// Where the description is of what is measured, a taught activity that contradicts it is not told: heights of tracks tell
/// sitting from falling better than a few examples do.
pub fn insert_taught(description: &mut Description, clip: &Clip, recogniser: &Recogniser) {
    insert_taught_segments(description, taught_segments(clip, recogniser));
}

/// The taught activities that are recognised in a clip.
pub(crate) fn taught_segments(clip: &Clip, recogniser: &Recogniser) -> Vec<Segment> {
    let recognised = recogniser.recognise(clip).into_iter();
    let segment = |part: Recognised| Segment {
        start_s: part.start_s,
        end_s: part.end_s,
        actions: radarllm_inference::actions(&part.says),
        caption: part.says,
        confidence: part.fit,
        side_confidence: None,
        taught: Some(part.name),
        guess: None,
    };
    recognised.map(segment).collect()
}

/// [`insert_taught`] of what was recognised.
pub(crate) fn insert_taught_segments(description: &mut Description, mut parts: Vec<Segment>) {
    // The model reads windows. Where there are none, what is done is measured, and nothing is done where nobody is.
    if description.windows == 0 {
        parts.retain(|part| {
            is_somebody_there(part, &description.segments)
                && !contradicts(part, &description.segments)
        });
    }
    insert(description, parts);
}

/// Whether somebody is stated for at least half of the time of a taught activity.
fn is_somebody_there(part: &Segment, stated: &[Segment]) -> bool {
    2.0 * shared_s(part, stated.iter()) >= part.end_s - part.start_s
}

/// The time that segments share with another one, s.
fn shared_s<'a>(part: &Segment, others: impl Iterator<Item = &'a Segment>) -> f64 {
    let overlap_s = |s: &Segment| (s.end_s.min(part.end_s) - s.start_s.max(part.start_s)).max(0.0);
    others.map(overlap_s).sum()
}

/// Whether measured actions other than that of a taught activity take at least half of its time.
fn contradicts(part: &Segment, measured: &[Segment]) -> bool {
    let of = |segment: &Segment| {
        segment
            .actions
            .iter()
            .copied()
            .find(|a| MEASURED.contains(a))
    };
    let Some(action) = of(part) else {
        return false;
    };
    let others = measured
        .iter()
        .filter(|s| of(s).is_some_and(|a| a != action));
    shared_s(part, others) >= 0.5 * (part.end_s - part.start_s)
}

/// Puts segments in the place of what the description says about their times.
pub(crate) fn insert(description: &mut Description, inserted: Vec<Segment>) {
    if inserted.is_empty() {
        return;
    }
    let mut segments = std::mem::take(&mut description.segments);
    for part in inserted {
        segments = segments
            .into_iter()
            .flat_map(|s| without(s, part.start_s, part.end_s))
            .collect();
        segments.push(part);
    }
    segments.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    description.set_segments(segments);
}

/// What is left of a segment without a time.
fn without(segment: Segment, start_s: f64, end_s: f64) -> Vec<Segment> {
    if segment.taught.is_some() || end_s <= segment.start_s || segment.end_s <= start_s {
        return vec![segment];
    }
    let rest = [(segment.start_s, start_s), (end_s, segment.end_s)];
    rest.into_iter()
        .filter(|(from_s, to_s)| to_s - from_s >= MIN_REST_S)
        .map(|(start_s, end_s)| Segment {
            start_s,
            end_s,
            ..segment.clone()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(start_s: f64, end_s: f64) -> Segment {
        Segment {
            start_s,
            end_s,
            caption: "a person walks".into(),
            actions: vec!["walk"],
            confidence: 0.5,
            side_confidence: None,
            taught: None,
            guess: None,
        }
    }

    #[test]
    fn what_is_measured_is_not_contradicted() {
        let of = |actions: &[&'static str], start_s, end_s| Segment {
            actions: actions.to_vec(),
            ..segment(start_s, end_s)
        };
        let measured = [of(&["sit_still"], 0.0, 6.0), of(&["walk"], 6.0, 10.0)];
        for (actions, start_s, end_s, expected) in [
            (&["fall"][..], 1.0, 3.0, true),
            (&["sit_still"], 1.0, 3.0, false),
            (&["sit_still"], 5.0, 7.5, true),
            (&["walk"], 5.0, 8.0, false),
            (&["squat"], 1.0, 3.0, false),
            (&["fall"], 11.0, 12.0, false),
        ] {
            let part = of(actions, start_s, end_s);
            assert_eq!(contradicts(&part, &measured), expected, "{part:?}");
        }
    }

    #[test]
    fn nothing_is_done_where_nobody_is() {
        let taught = |start_s, end_s| Segment {
            caption: "a person reads a book".into(),
            actions: Vec::new(),
            taught: Some("reading".into()),
            ..segment(start_s, end_s)
        };
        let there = Segment {
            caption: "a person is there".into(),
            actions: Vec::new(),
            ..segment(10.0, 20.0)
        };
        let mut description = Description::default();
        description.set_segments(vec![there]);
        insert_taught_segments(&mut description, vec![taught(0.0, 8.0), taught(12.0, 18.0)]);
        let taught = description.segments.iter().filter(|s| s.taught.is_some());
        assert_eq!(taught.map(|s| s.start_s).collect::<Vec<_>>(), [12.0]);
        // An empty room.
        let mut nobody = Description::default();
        insert_taught_segments(&mut nobody, vec![self::segment(0.0, 8.0)]);
        assert!(nobody.segments.is_empty());
    }

    #[test]
    fn taught_times_are_cut_out_of_segments() {
        let times = |rest: Vec<Segment>| {
            rest.iter()
                .map(|s| (s.start_s, s.end_s))
                .collect::<Vec<_>>()
        };
        let cut = |start_s, end_s| times(without(segment(0.0, 10.0), start_s, end_s));
        assert_eq!(cut(3.0, 6.0), [(0.0, 3.0), (6.0, 10.0)]);
        assert_eq!(cut(0.0, 10.0), []);
        assert_eq!(cut(0.5, 9.5), []);
        assert_eq!(cut(5.0, 12.0), [(0.0, 5.0)]);
        assert_eq!(cut(10.0, 12.0), [(0.0, 10.0)]);
    }
}
