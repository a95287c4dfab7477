//! Points of scene files.

use std::path::Path;

use radarllm_base::{PointFrame, RadarConfig, SPEED_OF_LIGHT_MPS};
use radarllm_synth::scene::{OwnedScene, SceneFile};
use radarllm_synth::{Method, Synthesizer};
use radarllm_tracking::Track;

/// Points of a scene as the reference radar sees it.
pub fn points(toml: &str) -> Vec<PointFrame> {
    let radar = RadarConfig::awr1843boost();
    let file = SceneFile::from_toml(toml).unwrap();
    let frequency_hz = SPEED_OF_LIGHT_MPS / radar.wavelength_m();
    let owned = OwnedScene::open(&file, Path::new(""), frequency_hz).unwrap();
    let mut synthesizer = Synthesizer::with_simulation(
        &file.radar(&radar),
        Method::Fast,
        file.processing.resolve(&radar),
        file.sim_options(),
    )
    .unwrap();
    let n_frames = synthesizer.radar().frames_in(file.duration_s);
    synthesizer
        .scene_to_points(&owned.scene(), n_frames, 1)
        .unwrap()
}

/// A `[[target]]` who walks from a place on the floor into a direction, degrees counter-clockwise from facing the radar.
pub fn walker(place_m: [f64; 2], heading_deg: f64, distance_m: f64) -> String {
    let [x, y] = place_m;
    format!(
        "[[target]]\nkind = \"motion\"\nposition_m = [{x}, {y}, -1.0]\n\
         file = \"builtin:walk?heading_deg={heading_deg}&distance_m={distance_m}\"\n"
    )
}

/// Distance of a place from the line through `start` into the walker's direction, m.
pub fn off_line(place_m: [f64; 2], start_m: [f64; 2], heading_deg: f64) -> f64 {
    let (sin, cos) = heading_deg.to_radians().sin_cos();
    // Facing (sin, -cos); its normal is (cos, sin).
    ((place_m[0] - start_m[0]) * cos + (place_m[1] - start_m[1]) * sin).abs()
}

/// What a failing test shows.
pub fn summary(tracks: &[Track]) -> Vec<String> {
    tracks
        .iter()
        .map(|t| {
            let place = |i: usize| t.frames[i].place_m.map(|v| (v * 100.0).round() / 100.0);
            let (first, last) = (&t.frames[0], t.frames.len() - 1);
            format!(
                "track {}: frames {} to {}, {} points, from {:?} over {:?} to {:?}",
                t.id,
                first.frame,
                t.frames[last].frame,
                t.n_points(),
                place(0),
                place(last / 2),
                place(last)
            )
        })
        .collect()
}
