//! PNG pictures of radar frames: for `simulate` and `process`.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_base::{PointFrame, RadarCube, RadarPoint};
use radarllm_formats::adc::{AdcStats, HISTOGRAM_BINS};
use radarllm_radar_dsp::{Map, MicroDoppler, PointExtractor};
use radarllm_render::plot::{self, Series};
use radarllm_tracking::Track;

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
    /// Also draw mean power over range of every virtual channel, still targets included.
    #[arg(long, value_name = "F.png")]
    pub channel_profiles: Option<PathBuf>,
    /// Also draw the points of all frames, from above and from the side.
    #[arg(long, value_name = "F.png")]
    pub point_cloud: Option<PathBuf>,
    /// Also draw range and x of all points over time.
    #[arg(long, value_name = "F.png")]
    pub points_over_time: Option<PathBuf>,
    /// Also draw the paths of people from above; of `process` with --people.
    #[arg(long, value_name = "F.png")]
    pub tracks: Option<PathBuf>,
}

impl PictureArgs {
    /// Paths that will be written.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        [
            &self.range_doppler,
            &self.range_azimuth,
            &self.micro_doppler,
            &self.range_profile,
            &self.channel_profiles,
            &self.point_cloud,
            &self.points_over_time,
            &self.tracks,
        ]
        .into_iter()
        .flatten()
    }

    /// Whether a picture is asked for that points alone do not give.
    pub fn need_samples(&self) -> bool {
        let from_points = [&self.point_cloud, &self.points_over_time, &self.tracks];
        self.paths().count() > from_points.into_iter().flatten().count()
    }

    /// The same, and all others in a folder, if there is one: those made from samples and from people only where
    /// there are any.
    pub fn in_folder(&self, folder: Option<&Path>, has_samples: bool, has_people: bool) -> Self {
        let mut all = self.clone();
        let Some(folder) = folder else {
            return all;
        };
        let fill = |path: &mut Option<PathBuf>, name: &str| {
            path.get_or_insert_with(|| folder.join(name));
        };
        if has_samples {
            fill(&mut all.range_doppler, "range-doppler.png");
            fill(&mut all.range_azimuth, "range-azimuth.png");
            fill(&mut all.micro_doppler, "micro-doppler.png");
            fill(&mut all.range_profile, "range-profile.png");
            fill(&mut all.channel_profiles, "channel-profiles.png");
        }
        fill(&mut all.point_cloud, "point-cloud.png");
        fill(&mut all.points_over_time, "points-over-time.png");
        if has_people {
            fill(&mut all.tracks, "tracks.png");
        }
        all
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
    /// Sums over frames, a row a channel.
    profiles: Option<Map>,
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
            profiles: None,
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
        if self.args.range_profile.is_some() || self.args.channel_profiles.is_some() {
            let profiles = extractor.channel_profiles(cube)?;
            match &mut self.profiles {
                None => self.profiles = Some(profiles),
                Some(sum) => {
                    let values = sum.values.iter_mut().zip(&profiles.values);
                    values.for_each(|(sum, value)| *sum += value);
                }
            }
        }
        Ok(())
    }

    /// Writes what was asked for; `frames` are all points, `tracks` the people among them, if anybody looked for some.
    pub fn finish(self, frames: &[PointFrame], tracks: Option<&[Track]>) -> CliResult {
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
            let map = self.profiles.as_ref().ok_or_else(no_frame)?;
            let x: Vec<f64> = (0..map.n_cols).map(|i| map.cols.at(i)).collect();
            let mut sums = vec![0.0_f32; map.n_cols];
            for row in map.values.chunks_exact(map.n_cols.max(1)) {
                sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
            }
            let mean = Map {
                n_rows: 1,
                values: sums,
                ..map.clone()
            };
            let db = mean.to_db(-120.0);
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
        draw_map(
            &args.channel_profiles,
            self.profiles,
            Rows::All,
            "Range profile of every virtual channel, dB below the strongest cell",
        )?;
        if let Some(path) = &args.point_cloud {
            let points: Vec<RadarPoint> = frames
                .iter()
                .flat_map(|f| f.points.iter().copied())
                .collect();
            let png = plot::points_png(&points, "Points of all frames, by velocity")?;
            output::write_atomic(path, &png)?;
        }
        if let Some(path) = &args.points_over_time {
            let png = plot::points_over_time_png(frames, "Points over time, by velocity")?;
            output::write_atomic(path, &png)?;
        }
        if let Some(path) = &args.tracks {
            let tracks = tracks.ok_or_else(|| {
                CliError::new("--tracks draws people, and none were looked for")
                    .hint("`radarllm process CAPTURE --people auto --tracks F.png`")
            })?;
            draw_tracks(path, tracks)?;
        }
        Ok(())
    }
}

/// Paths from above, a line a person, broken where the person was not seen.
fn draw_tracks(path: &Path, tracks: &[Track]) -> CliResult {
    let named: Vec<(String, Vec<f64>, Vec<f64>)> = tracks
        .iter()
        .map(|t| {
            let place = |axis: usize| {
                let frames = t.frames.iter();
                let seen = frames.map(move |f| (!f.points.is_empty()).then(|| f.place_m[axis]));
                seen.map(|v| v.unwrap_or(f64::NAN)).collect()
            };
            (format!("person {}", t.id), place(0), place(1))
        })
        .collect();
    let series: Vec<Series> = named
        .iter()
        .map(|(name, x, y)| Series {
            name,
            x,
            y,
            intervals: &[],
        })
        .collect();
    let png = plot::lines_png(&series, "x (m)", "y (m)", "Paths of people from above")?;
    output::write_atomic(path, &png)
}

/// Draws how often each value of the ADC came, and the figures of each receiver.
pub fn draw_adc_statistics(path: &Path, stats: &AdcStats) -> CliResult {
    let middle = (HISTOGRAM_BINS / 2) as f64;
    let x: Vec<f64> = (0..HISTOGRAM_BINS)
        .map(|i| 0.5 * (i as f64 - middle))
        .collect();
    let mut curves: Vec<(String, Vec<f64>)> = Vec::new();
    for (i, c) in stats.channels().iter().enumerate() {
        let Some(counts) = stats.histogram(i) else {
            continue;
        };
        let total = counts.iter().sum::<u64>().max(1) as f64;
        // What never came leaves a gap.
        let share = |n: &u64| match n {
            0 => f64::NAN,
            n => (*n as f64 / total).log10(),
        };
        let name = format!(
            "RX{}: {:.2} % full, DC {:+.1}{:+.1}j, I/Q {:+.2} dB {:+.1} deg",
            i + 1,
            100.0 * c.saturated,
            c.mean[0],
            c.mean[1],
            c.gain_imbalance_db,
            c.phase_imbalance_rad.to_degrees()
        );
        curves.push((name, counts.iter().map(share).collect()));
    }
    let series: Vec<Series> = curves
        .iter()
        .map(|(name, y)| Series {
            name,
            x: &x,
            y,
            intervals: &[],
        })
        .collect();
    let png = plot::lines_png(
        &series,
        "sign of I or Q x log2(1 + counts); full scale is 15",
        "log10 of the share of values",
        "ADC values of each receiver",
    )?;
    output::write_atomic(path, &png)
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
