//! Descriptions with taught activities in them.

use radarllm_base::Clip;
use radarllm_inference::{Description, Segment};
use radarllm_teach::{Recognised, Recogniser};

/// What is left of a segment beside a taught one is kept if it is at least this long, s.
const MIN_REST_S: f64 = 1.0;

/// Replaces what the description of a clip says about the times in which taught activities are recognised. The clip is
/// prepared for the model.
pub fn insert_taught(description: &mut Description, clip: &Clip, recogniser: &Recogniser) {
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
    insert(description, recognised.map(segment).collect());
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
