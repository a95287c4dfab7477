//! What geometry says: a point target, a walking body and a still body through the whole chain.

use std::fs;

use crate::command::{json, json_lines, radarllm, refused};

/// Columns of a points file: x, y, z, range, velocity, intensity.
fn points(path: &std::path::Path) -> Vec<radarllm_base::PointFrame> {
    radarllm_dataset::read_points(path)
        .expect("a valid points file")
        .frames
}

fn simulate(input: &str, extra: &[&str]) -> Vec<radarllm_base::PointFrame> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("points.parquet");
    let mut args = vec!["simulate", input, "--out", out.to_str().unwrap(), "--json"];
    args.extend(extra);
    json(&args);
    points(&out)
}

#[test]
fn a_moving_point_is_where_geometry_says() {
    // 2.5 m away at 20 degrees right and 0.3 m up, receding at 1 m/s along its line of sight.
    let position = [0.8_f32, 2.3, 0.3];
    let range = position.iter().map(|v| v * v).sum::<f32>().sqrt();
    let velocity = position.map(|v| v / range);
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(
        &scene,
        format!(
            "duration_s = 0.3\n[[target]]\nkind = \"point\"\nposition_m = {position:?}\nvelocity_mps = {velocity:?}\nrcs_m2 = 1.0\n"
        ),
    )
    .unwrap();
    let frames = simulate(scene.to_str().unwrap(), &[]);
    assert_eq!(frames.len(), 3);
    for frame in &frames {
        let strongest = frame.points.first().expect("a point target is seen");
        // The frame's middle is 13.8 ms after its start.
        let range_now = range + frame.time_s as f32 + 0.0138;
        // Half of a bin of 4.293 cm and 1.3 mm of coupling, which the chain takes off a target that
        // the simulator keeps still during a chirp; half of a bin of 6.854 cm/s.
        assert!(
            (strongest.range_m - range_now).abs() < 0.0235,
            "range: {strongest:?}"
        );
        assert!(
            (strongest.velocity_mps - 1.0).abs() < 0.035,
            "velocity: {strongest:?}"
        );
        let scale = range_now / range;
        // Direction cosines within 0.0025 and 0.007 (radar-dsp, tests/it/geometry.rs) times 2.8 m, and
        // the range's error times the cosines 0.33 and 0.12.
        assert!(
            (strongest.x_m - position[0] * scale).abs() < 0.007 + 0.008,
            "x: {strongest:?}"
        );
        assert!(
            (strongest.z_m - position[2] * scale).abs() < 0.020 + 0.003,
            "z: {strongest:?}"
        );
    }
}

#[test]
fn a_corner_reflector_has_its_textbook_strength_and_only_over_three_bounces() {
    // Relative to a point of the textbook's 4 pi a^4 / (3 lambda^2): 6 cm legs, 3.79 mm.
    let expected_m2 = 4.0 * std::f64::consts::PI * 0.06_f64.powi(4) / (3.0 * 0.003_789_f64.powi(2));
    let folder = tempfile::tempdir().unwrap();
    let power = |target: &str, max_bounces: usize| {
        let scene = folder.path().join("scene.toml");
        let out = folder.path().join("raw.npy");
        let text = format!(
            "duration_s = 0.1\nmax_bounces = {max_bounces}\n[noise]\nnone = true\n[[target]]\n\
             position_m = [0.0, 9.0, 0.0]\n{target}"
        );
        fs::write(&scene, text).unwrap();
        let (scene, out) = (scene.to_str().unwrap(), out.to_str().unwrap());
        json(&[
            "simulate", scene, "--emit", "adc", "--out", out, "--json", "--force",
        ]);
        let bytes = fs::read(out).unwrap();
        // Little-endian complex64 behind the header, whose length stands in bytes 8 and 9.
        let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let parts = bytes[start..].chunks_exact(4);
        let square = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])).powi(2);
        parts.map(square).sum::<f64>()
    };
    let point = power(&format!("kind = \"point\"\nrcs_m2 = {expected_m2}\n"), 1);
    let corner = "kind = \"trihedral\"\nsize_m = [0.06, 0.06]\n";
    let db = |bounces: usize| 10.0 * (power(corner, bounces) / point).log10();
    let (single, triple) = (db(1), db(3));
    // The flash of the faces' outer edges: 5 % of the field (radar-sim, tests/it/bounces.rs).
    assert!(single < -26.0, "single bounce: {single} dB");
    // Half a dB as there. At 9 m (far field from 2 D^2 / lambda = 3.8 m, D = 8.5 cm) the wave front
    // bends by k D^2 / 8 R = 0.17 rad to the rim, 0.01 dB; over the band 1 / lambda^2 averages to its
    // middle within 0.02 %.
    assert!(triple.abs() < 0.5, "triple bounce: {triple} dB");
}

#[test]
fn a_walker_approaches_and_a_still_body_is_nearly_invisible() {
    let walking = simulate(
        "builtin:walk?direction=forward&distance_m=2",
        &["--distance-m", "4"],
    );
    let middle = &walking[walking.len() / 2];
    let mean_velocity =
        middle.points.iter().map(|p| p.velocity_mps).sum::<f32>() / middle.points.len() as f32;
    // Facing the radar and walking forward means approaching: negative velocities.
    assert!(
        (-2.0..-0.4).contains(&mean_velocity),
        "mean radial velocity {mean_velocity} m/s"
    );
    let first = median_range(&walking[2..6]);
    let last = median_range(&walking[walking.len() - 6..walking.len() - 2]);
    assert!(
        first - last > 0.8,
        "the walker comes nearer: {first} m to {last} m"
    );

    let standing = simulate("builtin:stand_still", &["--distance-m", "3"]);
    let fast = standing
        .iter()
        .flat_map(|f| &f.points)
        .filter(|p| p.velocity_mps.abs() > 0.4)
        .count();
    let all = standing
        .iter()
        .map(|f| f.points.len())
        .sum::<usize>()
        .max(1);
    assert!(
        (fast as f32) < 0.1 * all as f32,
        "a still body has few fast points: {fast} of {all}"
    );
}

fn median_range(frames: &[radarllm_base::PointFrame]) -> f32 {
    let mut ranges: Vec<f32> = frames
        .iter()
        .flat_map(|f| &f.points)
        .map(|p| p.range_m)
        .collect();
    ranges.sort_by(f32::total_cmp);
    ranges[ranges.len() / 2]
}

#[test]
fn a_still_body_stands_where_it_was_put() {
    // Without clutter removal's help there is only breathing and sway: points, if any, lie on the body.
    let standing = simulate("builtin:stand_still", &["--distance-m", "3"]);
    let ranges: Vec<f32> = standing
        .iter()
        .flat_map(|f| &f.points)
        .map(|p| p.range_m)
        .collect();
    if !ranges.is_empty() {
        let near = ranges.iter().filter(|r| (2.4..3.4).contains(*r)).count();
        assert!(
            near * 10 >= ranges.len() * 8,
            "{near} of {} points lie at the body",
            ranges.len()
        );
    }
}

#[test]
fn an_empty_room_is_said_so() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("empty.toml");
    fs::write(&scene, "duration_s = 3.0\n").unwrap();
    let out = folder.path().join("empty.parquet");
    let done = radarllm(&[
        "simulate",
        scene.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let described = json_lines(&["describe", out.to_str().unwrap(), "--json"]);
    assert_eq!(described[0]["caption"], "no person seen");
}

/// A radar that is faster than the model: its frames are joined, and the clip keeps its length.
#[test]
fn a_faster_radar_is_described_too() {
    let motion = "builtin:clap?repetitions=2";
    let row =
        |radar: &str| json_lines(&["describe", motion, "--radar", radar, "--json"])[0].clone();
    let (slow, fast) = (row("awr1843boost"), row("iwr6843isk"));
    assert_eq!(fast["radar"], "iwr6843isk");
    let seconds = |row: &serde_json::Value| row["clip_seconds"].as_f64().unwrap();
    assert!((seconds(&slow) - seconds(&fast)).abs() <= 0.1 + 1e-9);
    assert!((fast["frames"].as_f64().unwrap() / seconds(&fast) - 10.0).abs() < 0.1);
}

/// A folder: shards share the work, a bad file does not stop the others, `--resume` does only what
/// is missing, and a motion's bytes are the same alone and in company.
#[test]
fn folders_are_simulated_file_by_file() {
    let folder = tempfile::tempdir().unwrap();
    let (takes, out) = (folder.path().join("takes"), folder.path().join("out"));
    fs::create_dir(&takes).unwrap();
    // A skeleton of ten joints, 1.7 m tall, standing for three frames.
    let bvh = |lift: f32| {
        format!(
            "HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
             JOINT Spine\n{{\nOFFSET 0 40 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n\
             JOINT Head\n{{\nOFFSET 0 20 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{{\nOFFSET 0 20 0\n}}\n}}\n}}\n\
             JOINT LeftUpLeg\n{{\nOFFSET 10 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n\
             JOINT LeftLeg\n{{\nOFFSET 0 -45 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n\
             JOINT LeftFoot\n{{\nOFFSET 0 -45 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{{\nOFFSET 0 0 15\n}}\n}}\n}}\n}}\n\
             JOINT RightUpLeg\n{{\nOFFSET -10 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n\
             JOINT RightLeg\n{{\nOFFSET 0 -45 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n\
             JOINT RightFoot\n{{\nOFFSET 0 -45 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{{\nOFFSET 0 0 15\n}}\n}}\n}}\n}}\n}}\n\
             MOTION\nFrames: 3\nFrame Time: 0.1\n{}",
            format!("0 {} 0 {}\n", 90.0 + lift, "0 ".repeat(30).trim_end()).repeat(3)
        )
    };
    for (name, lift) in [("a", 0.0), ("b", 1.0), ("c", 2.0)] {
        fs::write(takes.join(format!("{name}.bvh")), bvh(lift)).unwrap();
    }
    fs::write(takes.join("broken.bvh"), "HIERARCHY\nROOT").unwrap();
    let (takes, out) = (takes.to_str().unwrap(), out.to_str().unwrap());
    let run = |extra: &[&str]| {
        let mut args = vec!["simulate", takes, "--out", out, "--json"];
        args.extend(extra);
        let output = radarllm(&args);
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (output.status.code(), report)
    };
    // Sorted: a, b, broken, c. The second half of two is b and c.
    let (code, report) = run(&["--shard", "2/2"]);
    assert_eq!(code, Some(0), "{report}");
    assert_eq!(report["inputs"], 2);
    let again = refused(&["simulate", takes, "--out", out]);
    assert!(again.contains("exists already") && again.contains("--resume"));
    let (code, report) = run(&["--resume"]);
    assert_eq!(code, Some(1), "a file failed");
    assert_eq!(
        (&report["inputs"], &report["skipped"]),
        (&4.into(), &2.into())
    );
    assert_eq!(report["failed"].as_array().unwrap().len(), 1);
    assert!(
        report["failed"][0]["input"]
            .as_str()
            .unwrap()
            .contains("broken")
    );
    let alone = folder.path().join("alone.parquet");
    let input = format!("{takes}/b.bvh");
    json(&[
        "simulate",
        &input,
        "--out",
        alone.to_str().unwrap(),
        "--json",
    ]);
    let together = points(std::path::Path::new(&format!("{out}/b.parquet")));
    assert_eq!(points(&alone), together);
}

#[test]
fn people_are_where_they_were_asked_to_be_or_refused() {
    for distance_m in ["2.5", "8", "9.5"] {
        let walk = "builtin:walk?direction=forward&distance_m=1";
        let frames = simulate(walk, &["--distance-m", distance_m]);
        let expected_m: f32 = distance_m.parse().unwrap();
        // Half a step of the path, and half of a body's depth.
        let found_m = median_range(&frames);
        assert!(
            (found_m - expected_m).abs() < 0.5,
            "{distance_m}: {found_m}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let out = path("points.parquet");
    for distance_m in ["0.2", "12"] {
        let args = ["simulate", "builtin:walk", "--out", &out];
        let error = refused(&[&args[..], &["--distance-m", distance_m]].concat());
        for word in ["--distance-m", "1.3 m", "10.99 m"] {
            assert!(error.contains(word), "{error}");
        }
    }
    // Half of the path is beyond the maximum range of 6.66 m.
    let args = ["builtin:walk?distance_m=2", "--radar", "iwrl6432"];
    let done = radarllm(
        &[
            &["simulate", "--json", "--distance-m", "6.6", "--out", &out],
            &args[..],
        ]
        .concat(),
    );
    let error = String::from_utf8_lossy(&done.stderr);
    assert!(error.contains("6.66 m"), "{error}");
    let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert!(report["frames_beyond_range"].as_u64().unwrap() > 0);

    let scene = path("scene.toml");
    fs::write(
        &scene,
        "duration_s = 0.1\nmax_bounces = 1\n[room]\nradar_height_m = 1.8\nfacet_edge_m = 0.5\n",
    )
    .unwrap();
    for (options, words) in [
        (
            &["--distance-m", "3"][..],
            &["--distance-m", "scene.toml"][..],
        ),
        (&["--body", "absent.npz"], &["--body", "scene.toml"]),
        (&["--radar-height-m", "0.7"], &["1.8 m", "0.7 m"]),
        (&["--radar-height-m", "1"], &["1.8 m", "1 m"]),
        (&["--tracks", "t.svg"], &["--tracks"]),
    ] {
        let error = refused(&[&["simulate", &scene, "--out", &out, "--force"], options].concat());
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    json(&["simulate", &scene, "--out", &out, "--force", "--json"]);
    let meta = radarllm_dataset::read_points(std::path::Path::new(&out))
        .unwrap()
        .meta;
    assert_eq!(meta.radar_height_m, Some(1.8));
}
