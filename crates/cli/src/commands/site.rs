//! `site`: what a site reveals about the mounting of its radar while people walk.

use std::path::PathBuf;

use clap::Args;
use radarllm::{Clip, Site, site_to_toml};
use serde::Serialize;

use crate::{
    error::{CliError, CliResult},
    output,
    recording_args::InputArgs,
};

/// `site`.
#[derive(Args)]
pub(crate) struct SiteArgs {
    /// Recordings of the site in which people walk. Where the board does not track them, their points show them.
    #[arg(required = true)]
    pub recordings: Vec<PathBuf>,
    /// Output file, TOML, for `describe --site`.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// How to read the recordings.
    #[command(flatten)]
    pub input: InputArgs,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

#[derive(Serialize)]
struct Report {
    radar: String,
    tilt_deg: f32,
    standing_m: f32,
    radar_height_m: f32,
    walking_s: f32,
    /// Standard deviations: of the tilt, degrees, and of the standing height, m, at a distance from the radar, m.
    tilt_error_deg: f32,
    standing_error_m: f32,
    known_at_m: f32,
}

/// The radar of recordings that do not name theirs.
const UNNAMED: &str = "unknown";
/// Time between recordings that are learned from together, s: nobody is tracked from one into the next.
const BETWEEN_S: f64 = 10.0;

fn stated_height_m(clip: &Clip) -> Option<f32> {
    (!clip.is_height_assumed).then_some(clip.radar_height_m)
}

/// Learns a site from recordings of one radar.
pub(crate) fn learn(clips: impl IntoIterator<Item = CliResult<Clip>>) -> CliResult<Site> {
    let mut all: Option<Clip> = None;
    for clip in clips {
        let clip = clip?;
        let Some(all) = &mut all else {
            all = Some(clip);
            continue;
        };
        if all.radar != clip.radar {
            return Err(CliError::new(format!(
                "the recordings are of two radars, `{}` and `{}`",
                all.radar, clip.radar
            )));
        }
        if let (Some(one_m), Some(other_m)) = (stated_height_m(all), stated_height_m(&clip))
            && one_m != other_m
        {
            return Err(CliError::new(format!(
                "the recordings are of a radar at two heights above the floor, {one_m} m and {other_m} m"
            )));
        }
        let shift_s = all.frames.last().map_or(0.0, |f| f.time_s + BETWEEN_S);
        all.frames.extend(clip.frames.into_iter().map(|mut frame| {
            frame.time_s += shift_s;
            frame
        }));
    }
    let all = all.ok_or_else(|| CliError::new("no recordings"))?;
    let mut site = radarllm::learn_site(&all.radar, &all.frames)
        .map_err(|e| CliError::new(format!("the site cannot be learned: {e}")))?;
    site.stated_height_m = stated_height_m(&all);
    Ok(site)
}

/// Runs the command.
pub(crate) fn run(args: &SiteArgs) -> CliResult {
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let options = args.input.options()?;
    let open = |path: &PathBuf| -> CliResult<Clip> {
        let source = radarllm::open(path).with_options(options.clone());
        Ok(source.points()?.clip)
    };
    let site = learn(args.recordings.iter().map(open))?;
    if site.radar == UNNAMED {
        note!(
            "warning: the recordings do not name their radar: this site will be taken for that of every recording that \
             does not, either; --radar names it"
        );
    }
    if let Some(out) = &args.out {
        output::write_atomic(out, site_to_toml(&site)?.as_bytes())?;
    }
    let report = Report {
        radar: site.radar.clone(),
        tilt_deg: site.tilt_rad.to_degrees(),
        standing_m: site.standing_m,
        radar_height_m: site.radar_height_m(),
        walking_s: site.walking_s,
        tilt_error_deg: site.error.tilt_rad.to_degrees(),
        standing_error_m: site.error.standing_m,
        known_at_m: site.error.distance_m,
    };
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: by {:.0} s of walking\n    tilt: {:+.1} ± {:.1} degrees more than stated\n    a standing person is tracked \
         {:.2} ± {:.2} m above the radar, so that the radar is {:.2} m above the floor",
        report.radar,
        report.walking_s,
        report.tilt_deg,
        report.tilt_error_deg,
        report.standing_m,
        report.standing_error_m,
        report.radar_height_m
    ));
    Ok(())
}
