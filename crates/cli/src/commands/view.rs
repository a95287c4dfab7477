//! `view`: one self-contained page.

use std::path::Path;

use glam::Vec3;
use radarllm_base::MovingSurface;
use radarllm_body::mesh::BodyShape;
use radarllm_render::page::{Page, PageMesh};
use radarllm_synth::synthesizer::posed_builtin;

use crate::{
    args::ViewArgs,
    commands::describe::{self, Row},
    error::CliResult,
    input::{Clip, ClipOptions},
    output,
};

/// Facet size of the drawn body, m: the coarsest there is, for a page of a few MB.
const DRAWN_FACET_EDGE_M: f32 = 0.05;

/// Runs the verb.
pub fn run(args: &ViewArgs) -> CliResult {
    output::check_free(&args.out, args.force)?;
    let options = ClipOptions {
        radar: args.radar.as_deref(),
        format: args.format.as_deref(),
        recording: &args.recording,
        radar_height_m: args.radar_height_m,
        distance_m: 3.0,
        seed: args.seed,
    };
    let clip = describe::heard(&args.input, &options)?;
    let captioner = describe::load_captioner(args.model.as_deref())?;
    let row = describe::describe(
        &captioner,
        &clip,
        describe::model_name(args.model.as_deref()),
        1,
    )?;
    write_page(&args.out, &clip, &row)?;
    output::print_line(&format!("{}: {}", args.out.display(), row.caption));
    Ok(())
}

/// Writes the page of a described clip.
pub fn write_page(path: &Path, clip: &Clip, row: &Row) -> CliResult {
    let kind = if row.provenance.synthetic {
        "simulated"
    } else {
        "recorded"
    };
    let provenance = format!(
        "{kind} radar {} · source {} · model {} · confidence {:.2}",
        row.provenance.radar, row.provenance.source, row.model, row.confidence
    );
    let body = clip
        .performed
        .as_ref()
        .map(|(performed, placement)| {
            let shape = BodyShape {
                facet_edge_m: DRAWN_FACET_EDGE_M,
                ..performed.shape
            };
            posed_builtin(&performed.motion, shape, *placement)
        })
        .transpose()?;
    let vertices: Vec<Vec<Vec3>> = body
        .as_ref()
        .map(|body| {
            clip.frames
                .iter()
                .map(|frame| {
                    let mut positions = vec![Vec3::ZERO; body.n_vertices()];
                    body.positions_at(frame.time_s, &mut positions);
                    positions
                })
                .collect()
        })
        .unwrap_or_default();
    let page = Page {
        caption: &row.caption,
        provenance: &provenance,
        frames: &clip.frames,
        frame_rate_hz: clip.frame_rate_hz,
        radar_height_m: clip.radar_height_m,
        mesh: body.as_ref().map(|body| PageMesh {
            label: "The body whose motion was simulated (the radar never sees it as such).",
            triangles: body.triangles(),
            vertices: &vertices,
        }),
    };
    output::write_atomic(path, page.to_html().as_bytes())
}
