//! Static objects of data sets.

use radarllm_radar_dsp::{ClutterFilter, DspOptions};
use radarllm_radar_sim::{Noise, Scene};
use radarllm_synth::{Method, Synthesizer, objects::ObjectsFile};

#[test]
fn static_objects_give_the_points_that_they_give_in_the_scene() {
    let radar = radarllm_io::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let dsp = DspOptions {
        clutter: ClutterFilter::Off,
        ..DspOptions::default()
    };
    let plan = || Synthesizer::new(&radar, Method::Fast, dsp.clone()).unwrap();
    let objects = ObjectsFile {
        n_clutter: 20,
        n_strong: [5, 5],
        ..ObjectsFile::default()
    }
    .draw(1.0, 3);
    let moving = radarllm_radar_sim::PointTarget {
        velocity_mps: glam::DVec3::new(0.0, -1.0, 0.0),
        rcs_m2: 1.0,
        ..objects[20]
    };
    let scene = |points| Scene {
        points,
        noise: Noise::Thermal,
        ..Scene::default()
    };
    let mut all = objects.clone();
    all.push(moving);
    let expected = plan().scene_to_points(&scene(all), 3, 1).unwrap();
    let mut synthesizer = plan();
    synthesizer.set_objects(objects).unwrap();
    let found = synthesizer
        .scene_to_points(&scene(vec![moving]), 3, 1)
        .unwrap();
    assert!(found.iter().all(|f| !f.points.is_empty()));
    for (a, b) in found.iter().zip(&expected) {
        assert_eq!(a.points.len(), b.points.len());
        for (a, b) in a.points.iter().zip(&b.points) {
            assert!((a.range_m - b.range_m).abs() < 1e-3, "{a:?} {b:?}");
            assert!(
                (a.velocity_mps - b.velocity_mps).abs() < 1e-3,
                "{a:?} {b:?}"
            );
            assert!(
                (a.intensity_db - b.intensity_db).abs() < 0.01,
                "{a:?} {b:?}"
            );
        }
    }
    // Without objects again, fewer points are left.
    synthesizer.set_objects(Vec::new()).unwrap();
    let alone = synthesizer
        .scene_to_points(&scene(vec![moving]), 1, 1)
        .unwrap();
    assert!(alone[0].points.len() < found[0].points.len());
}
