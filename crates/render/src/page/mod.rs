//! The self-contained page of a clip: points over time in 3D, the mesh beside them, the caption and a play bar.
//!
//! The page is one HTML file that loads no other resources, so that it can be mailed or archived.

use base64::prelude::{BASE64_STANDARD as STANDARD, Engine};
use glam::Vec3;
use radarllm_base::{PointFrame, stats::quantile_lower};
use serde::Serialize;

const TEMPLATE: &str = include_str!("template.html");
/// Style sheet of all pages.
pub(crate) const STYLE: &str = include_str!("style.css");
/// Script of all pages that plays one clip.
pub(crate) const PLAYER: &str = include_str!("player.js");

/// Content of a page.
///
/// ```
/// use radarllm_base::{PointFrame, RadarPoint};
/// use radarllm_render::page::Page;
///
/// let point = RadarPoint { y_m: 3.0, range_m: 3.0, velocity_mps: -1.0, ..RadarPoint::default() };
/// let frames = [PointFrame { points: vec![point], ..PointFrame::default() }];
/// let page = Page {
///     caption: "a person walks forward",
///     segments: Vec::new(),
///     provenance: "recorded radar awr1843boost",
///     frames: &frames,
///     frame_rate_hz: 10.0,
///     radar_height_m: 1.0,
///     mesh: None,
/// };
/// assert!(page.to_html().starts_with("<!doctype html>"));
/// ```
pub struct Page<'a> {
    /// The generated caption.
    pub caption: &'a str,
    /// Sentences with their times; listed if there are several.
    pub segments: Vec<PageSegment<'a>>,
    /// Origin of points and caption: source, model, radar, and whether the points are synthetic or recorded.
    pub provenance: &'a str,
    /// Radar frames, with points in radar axes.
    pub frames: &'a [PointFrame],
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// The body, if it is known.
    pub mesh: Option<PageMesh<'a>>,
}

/// A sentence and its time, from the first frame.
#[derive(Clone, Debug, Serialize)]
pub struct PageSegment<'a> {
    /// Start, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The sentence.
    pub caption: &'a str,
    /// Confidence, 0..=1.
    pub confidence: f32,
}

/// A moving body.
pub struct PageMesh<'a> {
    /// Text below the mesh.
    pub label: &'a str,
    /// Vertex indices.
    pub triangles: &'a [[u32; 3]],
    /// Vertices in radar axes, m: one vector per radar frame, all of the same length.
    pub vertices: &'a [Vec<Vec3>],
}

#[derive(Serialize)]
pub(crate) struct PageData<'a> {
    caption: &'a str,
    segments: &'a [PageSegment<'a>],
    provenance: &'a str,
    frame_rate_hz: f64,
    radar_height_m: f32,
    centre_m: [f32; 3],
    velocity_scale_mps: f32,
    intensity_db: [f32; 2],
    /// Per point: x, y, z, velocity, intensity.
    frames: Vec<Vec<[f32; 5]>>,
    mesh: Option<MeshData<'a>>,
}

#[derive(Serialize)]
struct MeshData<'a> {
    label: &'a str,
    n_vertices: usize,
    triangles: &'a [[u32; 3]],
    vertices_mm: String,
}

impl Page<'_> {
    /// The page as HTML text.
    pub fn to_html(&self) -> String {
        fill(
            TEMPLATE,
            &[
                ("/*STYLE*/", STYLE),
                ("/*DATA*/", &json_in_html(&self.data())),
                ("/*PLAYER*/", PLAYER),
            ],
        )
    }

    pub(crate) fn data(&self) -> PageData<'_> {
        let points = || self.frames.iter().flat_map(|f| f.points.iter());
        let mut centre_m = match &self.mesh {
            Some(mesh) => median_position(mesh.vertices.iter().flatten().copied()),
            None => median_position(points().map(|p| Vec3::new(p.x_m, p.y_m, p.z_m))),
        };
        centre_m[2] = 0.9 - self.radar_height_m;
        let intensity_db = |share| quantile(points().map(|p| p.intensity_db), share);
        PageData {
            caption: self.caption,
            segments: &self.segments,
            provenance: self.provenance,
            frame_rate_hz: self.frame_rate_hz,
            radar_height_m: self.radar_height_m,
            centre_m,
            velocity_scale_mps: quantile(points().map(|p| p.velocity_mps.abs()), 0.95).max(0.5),
            intensity_db: [intensity_db(0.02), intensity_db(0.98)],
            frames: self
                .frames
                .iter()
                .map(|f| {
                    f.points
                        .iter()
                        .map(|p| {
                            [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db].map(round_mm)
                        })
                        .collect()
                })
                .collect(),
            mesh: self.mesh.as_ref().map(|mesh| MeshData {
                label: mesh.label,
                n_vertices: mesh.vertices.first().map_or(0, Vec::len),
                triangles: mesh.triangles,
                vertices_mm: STANDARD.encode(int16_mm(mesh.vertices)),
            }),
        }
    }
}

/// JSON for a script element. `</script>` inside a caption must not end the element.
pub(crate) fn json_in_html(value: &impl Serialize) -> String {
    let json = serde_json::to_string(value).unwrap_or_else(|_| "null".into());
    json.replace('<', "\\u003c")
}

/// Replaces the placeholders of a template, which must occur in the given order. Only the template is searched, so the
/// inserted texts may contain anything.
pub(crate) fn fill(template: &str, parts: &[(&str, &str)]) -> String {
    let mut out =
        String::with_capacity(template.len() + parts.iter().map(|p| p.1.len()).sum::<usize>());
    let mut rest = template;
    for (place, text) in parts {
        let (before, after) = rest.split_once(place).unwrap_or((rest, ""));
        out += before;
        out += text;
        rest = after;
    }
    out + rest
}

fn round_mm(value: f32) -> f32 {
    (value * 1000.0).round() / 1000.0
}

/// 0 without values.
fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    quantile_lower(values, share).unwrap_or(0.0)
}

fn median_position(positions: impl Iterator<Item = Vec3>) -> [f32; 3] {
    let positions: Vec<Vec3> = positions.collect();
    [0, 1, 2].map(|axis| quantile(positions.iter().map(|p| p[axis]), 0.5))
}

/// Coordinates in millimetres, clamped to +-32.767 m, little-endian.
fn int16_mm(frames: &[Vec<Vec3>]) -> Vec<u8> {
    let millimetres = |v: f32| (v * 1000.0).round().clamp(-32767.0, 32767.0) as i16;
    frames
        .iter()
        .flatten()
        .flat_map(|v| v.to_array())
        .flat_map(|v| millimetres(v).to_le_bytes())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caption_cannot_leave_the_data_block() {
        let page = Page {
            caption: "</script><script>alert(1)</script>",
            segments: vec![PageSegment {
                start_s: 0.0,
                end_s: 1.0,
                caption: "</script><script>alert(2)</script>",
                confidence: 0.5,
            }],
            provenance: "test",
            frames: &[],
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            mesh: None,
        };
        assert!(!page.to_html().contains("<script>alert"));
    }
}
