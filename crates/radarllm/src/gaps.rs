//! Times without frames.

use radarllm_base::{Clip, PointFrame};
use radarllm_inference::{Captioner, DescribeOptions, Description, PreparedClip};
use radarllm_io::{Error, Result};

/// Longer times without a frame, s, are gaps: what was done before says nothing of what is done after.
const MAX_STEP_S: f64 = 2.0;

/// The times of a clip in which no frame came for more than two seconds, s: of the frames before and after.
pub fn gaps(clip: &Clip) -> Vec<[f64; 2]> {
    let pairs = clip.frames.windows(2);
    pairs
        .filter(|pair| !follows(&pair[0], &pair[1]))
        .map(|pair| [pair[0].time_s, pair[1].time_s])
        .collect()
}

/// Whether a frame comes soon after another one.
pub(crate) fn follows(before: &PointFrame, after: &PointFrame) -> bool {
    after.time_s - before.time_s <= MAX_STEP_S
}

/// The description of a clip by a model, which reads frames without their times: what lies between two gaps is described by
/// itself.
pub(crate) fn describe_between_gaps(
    networks: &Captioner,
    clip: &PreparedClip,
    options: &DescribeOptions,
) -> Result<Description> {
    let describe = |clip: &PreparedClip| -> Result<Description> {
        networks.describe(clip, options).map_err(Error::wrap)
    };
    let mut runs = clip.frames.chunk_by(follows).peekable();
    let mut whole: Option<Description> = None;
    let mut segments = Vec::new();
    while let Some(frames) = runs.next() {
        if whole.is_none() && runs.peek().is_none() {
            break;
        }
        let run = clip.with_frames(frames.to_vec());
        let mut part = describe(&PreparedClip::of(&run).map_err(Error::wrap)?)?;
        segments.append(&mut part.segments);
        match &mut whole {
            Some(whole) => {
                whole.tokens.append(&mut part.tokens);
                whole.seconds += part.seconds;
                whole.windows += part.windows;
            }
            None => whole = Some(part),
        }
    }
    let Some(mut whole) = whole else {
        return describe(clip);
    };
    whole.set_segments(segments);
    Ok(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_said_of_a_time_without_frames() {
        let captioner = crate::Captioner::bundled().unwrap();
        let mut clip = crate::open("builtin:walk?direction=backward")
            .points()
            .unwrap()
            .clip;
        assert_eq!(gaps(&clip), Vec::<[f64; 2]>::new());
        let n = clip.frames.len();
        let mut later = clip.frames.clone();
        for (i, frame) in later.iter_mut().enumerate() {
            frame.frame += n as u32;
            frame.time_s = 3_600.0 + i as f64 / clip.frame_rate_hz;
        }
        let end_s = clip.frames[n - 1].time_s;
        clip.frames.append(&mut later);
        assert_eq!(gaps(&clip), [[end_s, 3_600.0]]);
        let description = captioner.describe(&clip).unwrap();
        let [before, after] = &description.segments[..] else {
            panic!("{:?}", description.segments)
        };
        assert_eq!([&before.actions, &after.actions], [&["walk"], &["walk"]]);
        assert!(before.end_s < end_s + 1.0 && after.start_s >= 3_599.0);
        assert!((f64::from(description.seconds) - clip.duration_s()).abs() < 0.5);
    }
}
