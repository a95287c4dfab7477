//! Prints `docs/pictures/points-person-sentence.svg`: a person, radar points and the sentence of the bundled model, all of
//! them output of the `radarllm` command in the same target folder: `describe` and `view`.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "an example"
)]

use base64::prelude::{BASE64_STANDARD, Engine};
use glam::Vec3;
use radarllm_render::plot::{Aspect, Axis, ColourMap, ScatterPanel, ScatterPlot};
use radarllm_render::raster::{Camera, render_mesh};
use serde_json::{Value, from_str, from_value};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const INPUT: &str = "builtin:throw";
/// Distances from the radar and heights that are shown, m.
const EXTENT_M: [[f64; 2]; 2] = [[1.8, 4.0], [-0.1, 1.9]];

fn radarllm(args: &[&str]) -> Result<String> {
    let program = std::env::current_exe()?.with_file_name("../radarllm");
    let output = std::process::Command::new(program).args(args).output()?;
    Ok(String::from_utf8(output.stdout)?)
}

fn main() -> Result<()> {
    let described = radarllm(&["describe", INPUT])?;
    let [_, sentence, source] = described.lines().collect::<Vec<_>>()[..] else {
        return Err("`radarllm describe` prints input, sentence and source".into());
    };
    let path = std::env::temp_dir().join("sentence-figure.html");
    radarllm(&["view", INPUT, "--force", "--out", &path.to_string_lossy()])?;
    let html = std::fs::read_to_string(&path)?;
    let json = html.split("type=\"application/json\">").nth(1);
    let json = json.and_then(|rest| rest.split("</script>").next());
    let mut page: Value = from_str(json.ok_or("a page without data")?)?;
    let frames: Vec<Vec<[f64; 5]>> = from_value(page["frames"].take())?;
    let radar_height_m: f64 = from_value(page["radar_height_m"].take())?;
    let triangles: Vec<[u32; 3]> = from_value(page["mesh"]["triangles"].take())?;
    let bytes = BASE64_STANDARD.decode(page["mesh"]["vertices_mm"].as_str().unwrap_or(""))?;

    // The body in the frame in which it is nearest to the radar, from so far to the side that the view is nearly parallel.
    let metres = |b: &[u8]| f32::from(i16::from_le_bytes([b[0], b[1]])) / 1000.0;
    let place = |b: &[u8]| Vec3::new(metres(b), metres(&b[2..]), metres(&b[4..]));
    let vertices: Vec<Vec3> = bytes.chunks_exact(6).map(place).collect();
    let bodies: Vec<&[Vec3]> = vertices.chunks(vertices.len() / frames.len()).collect();
    let nearest_m = |i: &usize| bodies[*i].iter().map(|v| v.y).fold(f32::INFINITY, f32::min);
    let last = (0..bodies.len()).min_by(|a, b| nearest_m(a).total_cmp(&nearest_m(b)));
    let last = last.ok_or("no frames")?;
    let floor = Vec3::Z * radar_height_m as f32;
    let body: Vec<Vec3> = bodies[last].iter().map(|v| *v + floor).collect();
    let [y, z] = EXTENT_M.map(|ends| 0.5 * (ends[0] + ends[1]) as f32);
    let camera = Camera {
        field_of_view_rad: (EXTENT_M[1][1] - EXTENT_M[1][0]) as f32 / 50.0,
        ..Camera::orbit(Vec3::new(0.0, y, z), 50.0, std::f32::consts::FRAC_PI_2, 0.0)
    };
    let body = render_mesh(&body, &triangles, &camera, [458, 416]).to_data_uri()?;

    // The points of the five frames up to then, from the same side.
    let points = frames[last.saturating_sub(4)..=last].iter().flatten();
    let points = points.map(|p| [p[1], p[2] + radar_height_m, p[3]]);
    let axis = |label, ends: [f64; 2]| Axis::new(label, "m").with_limits(ends[0], ends[1]);
    let panel = ScatterPanel {
        x: axis("Distance from the radar", EXTENT_M[0]),
        y: axis("Height", EXTENT_M[1]),
        points: points.collect(),
        aspect: Aspect::Equal,
        ..ScatterPanel::default()
    };
    let plot = ScatterPlot {
        title: "Radar points of 0.5 s".into(),
        panels: vec![panel],
        colour_bar: Axis::new("Radial velocity", "m/s").with_limits(-4.0, 4.0),
        colours: ColourMap::BlueRed,
        ..ScatterPlot::default()
    };
    let plot = plot.to_svg().replacen("<svg ", "<svg x=\"300\" ", 1);
    let (sentence, source) = (sentence.trim(), source.trim());
    print!(
        include_str!("sentence_figure.svg"),
        sentence, source, body, plot
    );
    Ok(())
}
