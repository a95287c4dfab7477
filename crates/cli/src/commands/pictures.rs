//! PNG pictures of radar frames: for `simulate` and `process`.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_base::{PointFrame, RadarCube, RadarPoint};
use radarllm_radar_dsp::{Map, MicroDoppler, PointExtractor};
use radarllm_view::plot::{self, Series};

use crate::{
    error::{CliError, CliResult},
    output,
};

/// Which pictures to write.
#[derive(Args, Clone, Debug, Default)]
pub struct PictureArgs {
    /// Also draw range over velocity, of the frame with the most movement.
    #[arg(long, value_name = "F.png")]
    pub range_doppler: Option<PathBuf>,
    /// Also draw range over azimuth, of the frame with the most movement.
    #[arg(long, value_name = "F.png")]
    pub range_azimuth: Option<PathBuf>,
    /// Also draw velocity over time.
    #[arg(long, value_name = "F.png")]
    pub micro_doppler: Option<PathBuf>,
    /// Also draw mean power over range, still targets included.
    #[arg(long, value_name = "F.png")]
    pub range_profile: Option<PathBuf>,
    /// Also draw the points of all frames, from above and from the side.
    #[arg(long, value_name = "F.png")]
    pub point_cloud: Option<PathBuf>,
}

impl PictureArgs {
    /// Paths that will be written.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        [
            &self.range_doppler,
            &self.range_azimuth,
            &self.micro_doppler,
            &self.range_profile,
            &self.point_cloud,
        ]
        .into_iter()
        .flatten()
    }
}

/// Depth of heat maps below their strongest cell, dB.
const DEPTH_DB: f32 = 45.0;
/// Range shown on either side of the strongest cell, m.
const SHOWN_RANGE_M: f64 = 1.5;

/// Collects frames and draws them at the end.
pub struct Pictures<'a> {
    args: &'a PictureArgs,
    /// Sum of speeds of the frame that has most of it, and its maps.
    most: f32,
    range_doppler: Option<Map>,
    range_azimuth: Option<Map>,
    micro_doppler: MicroDoppler,
    /// Sum over frames.
    range_profile: Option<Map>,
    points: Vec<RadarPoint>,
}

impl<'a> Pictures<'a> {
    /// Nothing yet.
    pub fn new(args: &'a PictureArgs) -> Self {
        Self {
            args,
            most: f32::NEG_INFINITY,
            range_doppler: None,
            range_azimuth: None,
            micro_doppler: MicroDoppler::default(),
            range_profile: None,
            points: Vec::new(),
        }
    }

    /// Adds a frame: its cube and the points that came of it.
    pub fn push(
        &mut self,
        extractor: &mut PointExtractor,
        cube: &RadarCube,
        frame: &PointFrame,
    ) -> CliResult {
        let movement: f32 = frame.points.iter().map(|p| p.velocity_mps.abs()).sum();
        if movement > self.most {
            self.most = movement;
            if self.args.range_doppler.is_some() {
                self.range_doppler = Some(extractor.range_doppler_map(cube)?);
            }
            if self.args.range_azimuth.is_some() {
                self.range_azimuth = Some(extractor.range_azimuth_map(cube)?);
            }
        }
        if self.args.micro_doppler.is_some() {
            self.micro_doppler.push(extractor, cube)?;
        }
        if self.args.range_profile.is_some() {
            let profile = extractor.range_profile(cube)?;
            match &mut self.range_profile {
                None => self.range_profile = Some(profile),
                Some(sum) => {
                    let values = sum.values.iter_mut().zip(&profile.values);
                    values.for_each(|(sum, value)| *sum += value);
                }
            }
        }
        if self.args.point_cloud.is_some() {
            self.points.extend_from_slice(&frame.points);
        }
        Ok(())
    }

    /// Writes what was asked for.
    pub fn finish(self) -> CliResult {
        let args = self.args;
        draw_map(
            &args.range_doppler,
            self.range_doppler,
            Rows::AroundStrongest,
            "Range-Doppler, dB below the strongest cell",
        )?;
        draw_map(
            &args.range_azimuth,
            self.range_azimuth,
            Rows::AroundStrongest,
            "Range-azimuth, dB below the strongest cell",
        )?;
        draw_map(
            &args.micro_doppler,
            self.micro_doppler.finish(),
            Rows::All,
            "Micro-Doppler, dB below the strongest cell",
        )?;
        if let Some(path) = &args.range_profile {
            let map = self.range_profile.ok_or_else(no_frame)?;
            let x: Vec<f64> = (0..map.n_cols).map(|i| map.cols.at(i)).collect();
            let db = map.to_db(-120.0);
            let strongest = db.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let y: Vec<f64> = db.iter().map(|v| f64::from(v - strongest)).collect();
            let series = [Series {
                name: "",
                x: &x,
                y: &y,
                intervals: &[],
            }];
            let png = plot::lines_png(
                &series,
                "range (m)",
                "power (dB)",
                "Range profile, mean of all chirps and channels",
            )?;
            output::write_atomic(path, &png)?;
        }
        if let Some(path) = &args.point_cloud {
            let png = plot::points_png(&self.points, "Points of all frames, by velocity")?;
            output::write_atomic(path, &png)?;
        }
        Ok(())
    }
}

/// Rows of a map that are shown.
#[derive(Clone, Copy)]
enum Rows {
    All,
    AroundStrongest,
}

fn no_frame() -> CliError {
    CliError::new("no frame to draw")
}

fn draw_map(path: &Option<PathBuf>, map: Option<Map>, rows: Rows, title: &str) -> CliResult {
    let Some(path): Option<&Path> = path.as_deref() else {
        return Ok(());
    };
    let map = map.ok_or_else(no_frame)?;
    output::write_atomic(path, &plot::map_png(&heatmap(&map, rows), title)?)
}

/// A map in dB relative to its strongest cell.
fn heatmap(map: &Map, rows: Rows) -> plot::Heatmap {
    let values = map.to_db(-DEPTH_DB);
    let strongest = (0..values.len())
        .max_by(|a, b| values[*a].total_cmp(&values[*b]))
        .unwrap_or(0);
    let (mut first, mut last) = (0, map.n_rows.saturating_sub(1));
    if let Rows::AroundStrongest = rows {
        let margin = (SHOWN_RANGE_M / map.rows.step.abs().max(1e-6)) as usize;
        let row = strongest / map.n_cols.max(1);
        (first, last) = (row.saturating_sub(margin), (row + margin).min(last));
    }
    let shown = values[first * map.n_cols..(last + 1) * map.n_cols]
        .iter()
        .map(|v| v - values[strongest])
        .collect();
    let label = |axis: &radarllm_radar_dsp::Axis| match axis.unit {
        "" => axis.label.to_owned(),
        unit => format!("{} ({unit})", axis.label),
    };
    plot::Heatmap::new(last + 1 - first, map.n_cols, shown)
        .rows(&label(&map.rows), map.rows.at(first), map.rows.at(last))
        .cols(
            &label(&map.cols),
            map.cols.start,
            map.cols.at(map.n_cols.saturating_sub(1)),
        )
}
