//! `demo`: runs built-in motions through the whole chain with the default model.

use radarllm::{DescribeOptions, SimulateOptions};
use serde::Serialize;

use crate::{
    args::DemoArgs,
    commands::{
        describe::{self, Row},
        view,
    },
    error::CliResult,
    output,
};

/// Motions that are used if none is given.
const MOTIONS: [&str; 3] = [
    "builtin:walk?direction=backward",
    "builtin:sit_down",
    "builtin:wave?side=left",
];

#[derive(Serialize)]
struct DemoRow {
    #[serde(flatten)]
    described: Row,
    /// A caption that the motion's own parameters imply.
    reference: String,
    points_per_frame: f64,
    /// Path of the page, if `--out` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    page: Option<String>,
}

/// Runs the command.
pub fn run(args: &DemoArgs) -> CliResult {
    let motions: Vec<&str> = if args.motions.is_empty() {
        MOTIONS.to_vec()
    } else {
        args.motions.iter().map(String::as_str).collect()
    };
    let captioner = describe::load_captioner(args.model.as_deref())?;
    let simulation = SimulateOptions {
        seed: args.seed,
        ..SimulateOptions::default()
    };
    let mut rows = Vec::new();
    for (index, motion) in motions.iter().enumerate() {
        let recording = radarllm::open(motion)
            .with_simulation(simulation.clone())
            .points()?;
        let clip = &recording.clip;
        let described = describe::describe(&captioner, motion, clip, &DescribeOptions::default())?;
        let performed = recording.performed.as_ref();
        let reference = performed
            .and_then(|p| p.motion.info.captions.first().cloned())
            .unwrap_or_default();
        let page = match &args.out {
            Some(folder) => {
                let path = folder.join(format!("demo-{}.html", index + 1));
                output::check_free(&path, args.force)?;
                view::write_page(&path, clip, performed, &described)?;
                Some(path.display().to_string())
            }
            None => None,
        };
        let row = DemoRow {
            points_per_frame: clip.points_per_frame(),
            described,
            reference,
            page,
        };
        if !args.json {
            describe::print_row(&row.described);
            output::print_line(&format!(
                "    what was performed: {} ({:.0} points a frame)",
                row.reference, row.points_per_frame
            ));
            if let Some(page) = &row.page {
                output::print_line(&format!("    page: {page}"));
            }
        }
        rows.push(row);
    }
    if args.json {
        return output::print_json(&rows);
    }
    Ok(())
}
