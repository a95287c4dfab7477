//! `view`: one self-contained page, or a figure of the timeline.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::Vec3;
use radarllm::{Clip, DescribeOptions, Performed, Segment, SimulateOptions, page_segments};
use radarllm_base::MovingSurface;
use radarllm_body::mesh::BodyShape;
use radarllm_io::options::DEFAULT_RADAR_HEIGHT_M;
use radarllm_render::page::{Page, PageMesh};
use radarllm_render::plot::{Span, timeline};
use radarllm_synth::synthesizer::posed_builtin;

use crate::{
    commands::describe::{self, Detail, Row},
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
    output,
    recording_args::InputArgs,
};

/// `view`.
#[derive(Args)]
pub(crate) struct ViewArgs {
    /// Recording of any format, points file, motion file or builtin:NAME?key=value.
    #[arg(value_name = "INPUT")]
    pub input_file: String,
    /// Output: a page with the points in motion (.html), or a figure of the points over time with the sentences (.svg).
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// File of the site, by `radarllm site`. Learned from the recording if somebody walks in it and no file is named.
    #[arg(long, value_name = "FILE")]
    pub site: Option<PathBuf>,
    /// How to read the input.
    #[command(flatten)]
    pub input: InputArgs,
    /// Seed of simulated inputs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// Facet size of the drawn body, m: the coarsest there is, for a page of a few MB.
const DRAWN_FACET_EDGE_M: f32 = 0.05;

/// What is written, by the extension of its path.
#[derive(Clone, Copy)]
enum Kind {
    Page,
    Figure,
}

impl Kind {
    fn of(path: &Path) -> CliResult<Self> {
        let extension = path.extension().and_then(|e| e.to_str());
        match extension.unwrap_or_default().to_lowercase().as_str() {
            "html" | "htm" => Ok(Self::Page),
            "svg" => Ok(Self::Figure),
            _ => Err(
                CliError::new(format!("{}: unknown file type of a view", path.display())).hint(
                    "end the name in .html for a page with the points in motion, or in .svg for a figure",
                ),
            ),
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &ViewArgs) -> CliResult {
    let kind = Kind::of(&args.out)?;
    output::check_free(&args.out, args.force)?;
    let options = args.input.options()?;
    let radar_height_m = options.radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M);
    let recording = radarllm::open(&args.input_file)
        .with_options(options)
        .with_simulation(SimulateOptions {
            seed: args.seed,
            radar_height_m,
            ..SimulateOptions::default()
        })
        .points()?;
    let (clip, _) = describe::prepared(&args.input_file, &recording, Detail::All)?;
    let site = args.site.as_deref().map(radarllm::read_site).transpose()?;
    let captioner = model::captioner(args.model.as_deref(), DecoderName::F32)?.with_site(site);
    let row = describe::describe(
        &captioner,
        &args.input_file,
        &clip,
        &DescribeOptions::default(),
    )?;
    match kind {
        Kind::Page => write_page(&args.out, &clip, recording.performed.as_ref(), &row)?,
        Kind::Figure => write_timeline(&args.out, &clip, &row)?,
    }
    output::print_line(&format!("{}: {}", args.out.display(), row.caption));
    Ok(())
}

/// Writes a figure of the points of a described clip over time, with its sentences.
fn write_timeline(path: &Path, clip: &Clip, row: &Row) -> CliResult {
    let span = |from: f64, to: f64, text: String| Span {
        from,
        to,
        text: format!("{from:.1}-{to:.1} s: {text}"),
    };
    let of_segment = |s: &Segment| {
        let text = format!("{} ({:.2})", s.caption, s.confidence);
        span(s.start_s, s.end_s, text)
    };
    let mut said: Vec<Span> = row.segments.iter().map(of_segment).collect();
    if let (true, Some(first), Some(last)) =
        (said.is_empty(), clip.frames.first(), clip.frames.last())
    {
        said.push(span(first.time_s, last.time_s, row.caption.clone()));
    }
    // The folders of a path would make the title wider than the figure.
    let source = Path::new(&row.source.source);
    let name = source.file_name().unwrap_or(source.as_os_str());
    let title = format!("{} ({})", name.to_string_lossy(), row.source.provenance);
    let plot = timeline(&clip.frames, said, &title);
    output::write_atomic(path, plot.to_svg().as_bytes())
}

/// Writes the page of a described clip, with the body if its motion was simulated just now.
pub(crate) fn write_page(
    path: &Path,
    clip: &Clip,
    performed: Option<&Performed>,
    row: &Row,
) -> CliResult {
    let provenance = format!(
        "{} radar {} · source {} · model {} · confidence {:.2}",
        row.source.provenance, row.source.radar, row.source.source, row.model, row.confidence
    );
    let body = performed
        .map(|performed| {
            let shape = BodyShape {
                facet_edge_m: DRAWN_FACET_EDGE_M,
                ..performed.motion.shape
            };
            posed_builtin(&performed.motion.motion, shape, performed.placement)
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
        segments: page_segments(&row.segments, clip),
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
