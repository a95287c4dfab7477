//! Falls before a board that sends points alone, as a running radar notices them: by the heights of somebody's points above
//! the floor.

use radarllm_base::PointFrame;
use radarllm_measure::{
    Site,
    falls::{Fall, MIN_DISTANCE_M},
};
use radarllm_monitor::{
    falls::FallState,
    watch::{Watch, WatchOptions},
};
use radarllm_tracking::TrackOptions;

/// Share of such falls before virtual radars that are falls: docs/results/falls.md.
const SURE: f32 = 0.9;

/// A fall, and until when the person is down, s.
pub(crate) struct FallByHeight {
    pub fall: Fall,
    pub until_s: f64,
}

/// The falls after which nobody is up again within the dwell of a running radar, of frames of a radar at a stated height above
/// the floor, m.
pub(crate) fn falls_by_height(
    frames: &[PointFrame],
    site: &Site,
    radar_height_m: f32,
    track: TrackOptions,
) -> Vec<FallByHeight> {
    let options = WatchOptions {
        track,
        ..WatchOptions::default()
    };
    let Ok(mut watch) = Watch::new(&options, radar_height_m.into()) else {
        return Vec::new();
    };
    let mut falls: Vec<(u64, FallByHeight)> = Vec::new();
    for frame in frames {
        let mut level = frame.clone();
        for point in &mut level.points {
            [point.y_m, point.z_m] = site.level([point.y_m, point.z_m]);
        }
        for event in watch.push(&level).falls {
            match event.state {
                FallState::Suspected => {
                    let fall = Fall {
                        t_s: event.at_s,
                        place_m: event.place_m.map(|v| v as f32),
                        probability: SURE,
                    };
                    let until_s = f64::INFINITY;
                    falls.push((event.fall, FallByHeight { fall, until_s }));
                }
                FallState::Confirmed => {}
                FallState::Recovered => {
                    let own = falls.iter_mut().filter(|(fall, _)| *fall == event.fall);
                    own.for_each(|(_, fall)| fall.until_s = event.at_s);
                }
                FallState::Dismissed => falls.retain(|(fall, _)| *fall != event.fall),
            }
        }
    }
    let falls = falls.into_iter().map(|(_, fall)| fall);
    falls
        .filter(|one| one.fall.place_m[0].hypot(one.fall.place_m[1]) >= MIN_DISTANCE_M)
        .collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use radarllm_base::RadarPoint;

    use super::*;

    /// Height of the radar above the floor, m.
    pub(crate) const RADAR_M: f32 = 1.2;

    /// Frames at 10 Hz with ten points of a body 3 m away whose highest point is at a height above the floor, m, as a function
    /// of the time; where there is none, nobody is seen.
    pub(crate) fn body(n_frames: u32, top_m: impl Fn(f64) -> Option<f32>) -> Vec<PointFrame> {
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let point = |top_m: f32, k: u16| {
                let z_m = top_m * f32::from(k) / 9.0 - RADAR_M;
                RadarPoint {
                    x_m: 0.02 * f32::from(k),
                    y_m: 3.0,
                    z_m,
                    range_m: 3.0_f32.hypot(z_m),
                    velocity_mps: 0.3,
                    intensity_db: 20.0,
                }
            };
            let of_body = |top_m| (0..10).map(move |k| point(top_m, k));
            PointFrame {
                frame: i,
                time_s,
                points: top_m(time_s).into_iter().flat_map(of_body).collect(),
                board: None,
            }
        };
        (0..n_frames).map(frame).collect()
    }

    /// When falls are found in 12 s of a body, s.
    fn falls(top_m: impl Fn(f64) -> f32) -> Vec<f64> {
        let frames = body(120, |t_s| Some(top_m(t_s)));
        let site = Site::unlearned("board", RADAR_M);
        let found = falls_by_height(&frames, &site, RADAR_M, TrackOptions::default());
        found.iter().map(|one| one.fall.t_s).collect()
    }

    #[test]
    fn who_drops_to_the_floor_and_stays_there_has_fallen() {
        let drops = |t_s: f64| (1.7 - 2.0 * (t_s - 5.0).max(0.0) as f32).max(0.3);
        let [at_s] = falls(drops)[..] else {
            panic!("{:?}", falls(drops))
        };
        assert!((5.0..7.0).contains(&at_s), "{at_s}");
        // Up again within the dwell, sitting down, and lying down slowly.
        let rises = |t_s: f64| if t_s > 8.0 { 1.7 } else { drops(t_s) };
        let sits = |t_s: f64| drops(t_s).max(1.2);
        let lies_down = |t_s: f64| (1.7 - 0.3 * (t_s - 3.0).max(0.0) as f32).max(0.3);
        for stated in [falls(rises), falls(sits), falls(lies_down)] {
            assert!(stated.is_empty(), "{stated:?}");
        }
    }
}
