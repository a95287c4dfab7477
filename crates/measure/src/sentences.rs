//! States as sentences.

use crate::{
    posture::Posture,
    states::{Activity, State},
};

/// Share of a path that leads toward or away from the radar, from which on the direction is stated.
const RADIAL: f32 = 0.6;
/// Shorter paths, m, have no direction.
const MIN_PATH_M: f32 = 0.7;

/// The sentence of a state: what the person does and where, with one digit after the point.
///
/// ```
/// use radarllm_measure::{Activity, Posture, State, sentence};
///
/// let state = State {
///     track: 0,
///     start_s: 0.0,
///     end_s: 8.0,
///     activity: Activity::Stays(Posture::Sitting),
///     probability: 0.9,
///     places_m: [[0.3, 2.1], [0.3, 2.1]],
///     between_m: [2.1, 2.1],
///     turns: 0,
/// };
/// assert_eq!(sentence(&state), "a person sits 2.1 m away");
/// ```
pub fn sentence(state: &State) -> String {
    let [from_m, to_m] = state.distances_m();
    let [[x0, y0], [x1, y1]] = state.places_m;
    let path_m = (x1 - x0).hypot(y1 - y0);
    let [nearest_m, farthest_m] = state.between_m;
    // How much farther the person went than from the first place to the last one.
    let more_m = farthest_m - nearest_m - (to_m - from_m).abs();
    let verb = match state.activity {
        Activity::Walks if more_m >= MIN_PATH_M || state.turns >= 2 => {
            return format!("a person walks to and fro, {nearest_m:.1} to {farthest_m:.1} m away");
        }
        Activity::Walks if path_m < MIN_PATH_M => {
            return format!("a person walks about {to_m:.1} m away");
        }
        Activity::Walks if (to_m - from_m).abs() < RADIAL * path_m => {
            return format!("a person walks past, from {from_m:.1} to {to_m:.1} m away");
        }
        Activity::Walks if to_m < from_m => {
            return format!(
                "a person walks toward the radar, from {from_m:.1} to {to_m:.1} m away"
            );
        }
        Activity::Walks => {
            return format!(
                "a person walks away from the radar, from {from_m:.1} to {to_m:.1} m away"
            );
        }
        Activity::Stays(Posture::Standing) => "stands still",
        Activity::Stays(Posture::Sitting) => "sits",
        Activity::Stays(Posture::Lying) => "lies",
        Activity::StaysSomehow => return format!("a person is there, {to_m:.1} m away"),
        Activity::Falls => "falls",
    };
    format!("a person {verb} {to_m:.1} m away")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(activity: Activity, places_m: [[f32; 2]; 2]) -> State {
        let mut state = State {
            track: 0,
            start_s: 0.0,
            end_s: 5.0,
            activity,
            probability: 0.9,
            places_m,
            between_m: [0.0; 2],
            turns: 0,
        };
        let [from_m, to_m] = state.distances_m();
        state.between_m = [from_m.min(to_m), from_m.max(to_m)];
        state
    }

    /// The actions that a sentence states to those who judge sentences.
    fn actions(text: &str) -> Vec<&'static str> {
        let clauses = radarllm_facts::parse(text);
        clauses
            .iter()
            .flat_map(|c| &c.actions)
            .map(|a| a.name)
            .collect()
    }

    /// Every sentence states its action to those who judge sentences.
    #[test]
    fn sentences_are_read_as_they_are_meant() {
        let still = [[0.0, 2.0], [0.0, 2.0]];
        for (activity, places_m, actions) in [
            (
                Activity::Stays(Posture::Standing),
                still,
                &["stand_still"][..],
            ),
            (Activity::Stays(Posture::Sitting), still, &["sit_still"]),
            (Activity::Stays(Posture::Lying), still, &["lie_still"]),
            (Activity::Falls, still, &["fall"]),
            (Activity::StaysSomehow, still, &[]),
            (Activity::Walks, still, &["walk"]),
            (Activity::Walks, [[0.0, 5.0], [0.0, 2.0]], &["walk"]),
            (Activity::Walks, [[0.0, 2.0], [0.0, 5.0]], &["walk"]),
            (Activity::Walks, [[-2.0, 3.0], [2.0, 3.0]], &["walk"]),
        ] {
            let text = sentence(&state(activity, places_m));
            assert_eq!(self::actions(&text), actions, "{text}");
        }
    }

    #[test]
    fn directions_are_those_of_the_path() {
        let text = |places_m| sentence(&state(Activity::Walks, places_m));
        assert_eq!(
            text([[0.0, 5.0], [0.0, 2.0]]),
            "a person walks toward the radar, from 5.0 to 2.0 m away"
        );
        assert_eq!(
            text([[0.0, 2.0], [0.0, 5.0]]),
            "a person walks away from the radar, from 2.0 to 5.0 m away"
        );
        assert_eq!(
            text([[-2.0, 3.0], [2.0, 3.0]]),
            "a person walks past, from 3.6 to 3.6 m away"
        );
    }

    #[test]
    fn who_turns_back_walks_to_and_fro() {
        let mut state = state(Activity::Walks, [[0.0, 1.4], [0.0, 2.6]]);
        // From 1.4 m to 3.0 m and back to 2.6 m: hardly more than from the first place to the last.
        state.between_m = [1.4, 3.0];
        assert!(sentence(&state).starts_with("a person walks away from the radar"));
        state.between_m = [0.9, 3.6];
        let text = sentence(&state);
        assert_eq!(text, "a person walks to and fro, 0.9 to 3.6 m away");
        assert_eq!(actions(&text), ["pace"]);
        // Away, back, and away again.
        state.between_m = [1.4, 2.6];
        state.turns = 2;
        assert_eq!(
            sentence(&state),
            "a person walks to and fro, 1.4 to 2.6 m away"
        );
    }
}
