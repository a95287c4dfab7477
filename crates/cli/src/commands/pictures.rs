//! Plots of radar frames: for `simulate` and `process`.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_base::{PointFrame, RadarCube, RadarPoint};
use radarllm_formats::adc::{AdcStats, HISTOGRAM_BINS};
use radarllm_radar_dsp::{Map, MicroDoppler, PointExtractor};
use radarllm_render::plot::{
    Aspect, Axis, AxisScale, Grid, Heatmap, Histogram, LinePlot, Markers, PlotError, Series,
    point_cloud, points_over_time,
};
use radarllm_tracking::Track;

use crate::{
    error::{CliError, CliResult},
    output,
};

/// Heading of plots in help texts.
pub(crate) const PICTURES_HEADING: &str = "Plots to write (.svg: figure with axes and units; .png: image inside the axes only, extents in its tEXt chunks)";

/// Plots to write.
///
/// A name that ends in .svg gives a figure with axes, units and text. A name that ends in .png gives the image inside the
/// axes alone, without text (its extents are in tEXt chunks); line plots and histograms have none.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PictureArgs {
    /// Range-Doppler map of the frame with the most movement; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub range_doppler: Option<PathBuf>,
    /// Range-azimuth map of the frame with the most movement; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub range_azimuth: Option<PathBuf>,
    /// Micro-Doppler spectrogram: velocity over time; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub micro_doppler: Option<PathBuf>,
    /// Mean power over range, static targets included; .svg.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub range_profile: Option<PathBuf>,
    /// Mean power over range of every virtual channel, static targets included; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub channel_profiles: Option<PathBuf>,
    /// Points of all frames from above and from the side, coloured by radial velocity; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub point_cloud: Option<PathBuf>,
    /// Range and x of all points over time, coloured by radial velocity; .svg or .png.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub points_over_time: Option<PathBuf>,
    /// Tracks of people from above, of `process` with --people; .svg.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub tracks: Option<PathBuf>,
}

impl PictureArgs {
    /// Paths that will be written.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.paths_and_kinds().into_iter().map(|(path, _)| path)
    }

    fn paths_and_kinds(&self) -> Vec<(&PathBuf, PlotKind)> {
        [
            (&self.range_doppler, PlotKind::Picture),
            (&self.range_azimuth, PlotKind::Picture),
            (&self.micro_doppler, PlotKind::Picture),
            (&self.range_profile, PlotKind::Vector),
            (&self.channel_profiles, PlotKind::Picture),
            (&self.point_cloud, PlotKind::Picture),
            (&self.points_over_time, PlotKind::Picture),
            (&self.tracks, PlotKind::Vector),
        ]
        .into_iter()
        .filter_map(|(path, kind)| Some((path.as_ref()?, kind)))
        .collect()
    }

    /// Checks the file names before anything is computed.
    ///
    /// # Errors
    /// An extension other than .svg and .png, or .png for a plot that consists of vector shapes only.
    pub(crate) fn check(&self) -> CliResult {
        for (path, kind) in self.paths_and_kinds() {
            file_type(path, kind)?;
        }
        Ok(())
    }

    /// Whether a plot is requested that needs raw samples, not only points.
    pub(crate) fn need_samples(&self) -> bool {
        let from_points = [&self.point_cloud, &self.points_over_time, &self.tracks];
        self.paths().count() > from_points.into_iter().flatten().count()
    }

    /// Adds all other plots to a folder, if one is given: those of samples and of tracks only if there are any.
    pub(crate) fn in_folder(
        &self,
        folder: Option<&Path>,
        has_samples: bool,
        has_people: bool,
    ) -> Self {
        let mut all = self.clone();
        let Some(folder) = folder else {
            return all;
        };
        let fill = |path: &mut Option<PathBuf>, name: &str| {
            path.get_or_insert_with(|| folder.join(name));
        };
        if has_samples {
            fill(&mut all.range_doppler, "range-doppler.svg");
            fill(&mut all.range_azimuth, "range-azimuth.svg");
            fill(&mut all.micro_doppler, "micro-doppler.svg");
            fill(&mut all.range_profile, "range-profile.svg");
            fill(&mut all.channel_profiles, "channel-profiles.svg");
        }
        fill(&mut all.point_cloud, "point-cloud.svg");
        fill(&mut all.points_over_time, "points-over-time.svg");
        if has_people {
            fill(&mut all.tracks, "tracks.svg");
        }
        all
    }
}

/// Whether a plot contains an image or consists of vector shapes only.
#[derive(Clone, Copy)]
enum PlotKind {
    Picture,
    Vector,
}

/// File type requested by the extension of a path.
#[derive(Clone, Copy)]
enum FileType {
    Svg,
    Png,
}

fn file_type(path: &Path, kind: PlotKind) -> CliResult<FileType> {
    let extension = path.extension().and_then(|e| e.to_str());
    match (extension.unwrap_or_default().to_lowercase().as_str(), kind) {
        ("svg", _) => Ok(FileType::Svg),
        ("png", PlotKind::Picture) => Ok(FileType::Png),
        ("png", PlotKind::Vector) => Err(CliError::new(format!(
            "{}: this plot consists of vector shapes and is not written as PNG",
            path.display()
        ))
        .hint("end the name in .svg")),
        (_, kind) => Err(
            CliError::new(format!("{}: unknown file type of a plot", path.display())).hint(
                match kind {
                    PlotKind::Picture => {
                        "end the name in .svg, or in .png for the picture without axes"
                    }
                    PlotKind::Vector => "end the name in .svg",
                },
            ),
        ),
    }
}

/// Checks that a path is suitable for an ADC histogram.
///
/// # Errors
/// An extension other than .svg.
pub(crate) fn check_adc_statistics(path: &Path) -> CliResult {
    file_type(path, PlotKind::Vector).map(|_| ())
}

/// Writes a plot that contains an image, as SVG or PNG.
fn write_plot(
    path: &Path,
    svg: impl FnOnce() -> String,
    png: impl FnOnce() -> Result<Vec<u8>, PlotError>,
) -> CliResult {
    match file_type(path, PlotKind::Picture)? {
        FileType::Svg => output::write_atomic(path, svg().as_bytes()),
        FileType::Png => {
            let png = png().map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
            output::write_atomic(path, &png)
        }
    }
}

/// Writes a plot that consists of vector shapes.
fn write_figure(path: &Path, svg: &str) -> CliResult {
    file_type(path, PlotKind::Vector)?;
    output::write_atomic(path, svg.as_bytes())
}

/// Dynamic range of heat maps below their maximum, dB.
const DEPTH_DB: f32 = 45.0;
/// Range shown on either side of the maximum, m.
const SHOWN_RANGE_M: f64 = 1.5;

/// Collects frames and plots them at the end.
pub(crate) struct Pictures<'a> {
    args: &'a PictureArgs,
    /// Maximum over frames of the sum of the speeds of the points. The maps are those of that frame.
    max_movement: f32,
    range_doppler: Option<Map>,
    range_azimuth: Option<Map>,
    micro_doppler: MicroDoppler,
    /// Sums over frames, one row per channel.
    profiles: Option<Map>,
}

impl<'a> Pictures<'a> {
    /// Creates a collection without frames.
    pub(crate) fn new(args: &'a PictureArgs) -> Self {
        Self {
            args,
            max_movement: f32::NEG_INFINITY,
            range_doppler: None,
            range_azimuth: None,
            micro_doppler: MicroDoppler::default(),
            profiles: None,
        }
    }

    /// Adds a frame: its cube and the points extracted from it.
    pub(crate) fn push(
        &mut self,
        extractor: &mut PointExtractor,
        cube: &RadarCube,
        frame: &PointFrame,
    ) -> CliResult {
        let movement: f32 = frame.points.iter().map(|p| p.velocity_mps.abs()).sum();
        if movement > self.max_movement {
            self.max_movement = movement;
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

    /// Writes the requested plots. `frames` contain all points; `tracks` are the people among them, if people were
    /// tracked.
    pub(crate) fn finish(self, frames: &[PointFrame], tracks: Option<&[Track]>) -> CliResult {
        let args = self.args;
        write_map(
            &args.range_doppler,
            self.range_doppler,
            RowRange::AroundMaximum,
            "Range-Doppler map",
        )?;
        write_map(
            &args.range_azimuth,
            self.range_azimuth,
            RowRange::AroundMaximum,
            "Range-azimuth map",
        )?;
        write_map(
            &args.micro_doppler,
            self.micro_doppler.finish(),
            RowRange::All,
            "Micro-Doppler spectrogram",
        )?;
        if let Some(path) = &args.range_profile {
            let profiles = self.profiles.as_ref().ok_or_else(no_frame)?;
            write_figure(path, &range_profile(profiles).to_svg())?;
        }
        write_map(
            &args.channel_profiles,
            self.profiles,
            RowRange::All,
            "Range profiles of the virtual channels",
        )?;
        if let Some(path) = &args.point_cloud {
            let points: Vec<RadarPoint> = frames
                .iter()
                .flat_map(|f| f.points.iter().copied())
                .collect();
            let plot = point_cloud(&points, "Points of all frames");
            write_plot(path, || plot.to_svg(), || plot.to_png())?;
        }
        if let Some(path) = &args.points_over_time {
            let plot = points_over_time(frames, "Points over time");
            write_plot(path, || plot.to_svg(), || plot.to_png())?;
        }
        if let Some(path) = &args.tracks {
            let tracks = tracks.ok_or_else(|| {
                CliError::new("--tracks needs --people: nobody was tracked")
                    .hint("`radarllm process CAPTURE --people auto --tracks F.svg`")
            })?;
            write_figure(path, &track_plot(tracks).to_svg())?;
        }
        Ok(())
    }
}

/// Tracks seen from above, one line per person, interrupted where the person was not detected.
fn track_plot(tracks: &[Track]) -> LinePlot {
    let series = tracks.iter().map(|track| {
        let places = track.frames.iter().map(|frame| match frame.points[..] {
            [] => [f64::NAN; 2],
            _ => frame.place_m,
        });
        Series::new(format!("person {}", track.id), places)
    });
    LinePlot {
        title: "Tracks of people from above".into(),
        x: Axis::new("x", "m"),
        y: Axis::new("y", "m"),
        series: series.collect(),
        markers: Markers::FirstPoint,
        aspect: Aspect::Equal,
    }
}

/// Mean over all chirps and channels; `profiles` has one row per channel.
fn range_profile(profiles: &Map) -> LinePlot {
    let mut sums = vec![0.0_f32; profiles.n_cols];
    for row in profiles.values.chunks_exact(profiles.n_cols.max(1)) {
        sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
    }
    let mean = Map {
        n_rows: 1,
        values: sums,
        ..profiles.clone()
    };
    let db = mean.to_db(-120.0);
    let maximum = db.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let points = db
        .iter()
        .enumerate()
        .map(|(i, v)| [profiles.cols.at(i), f64::from(v - maximum)]);
    LinePlot {
        title: "Range profile, mean of chirps and channels".into(),
        x: plot_axis(&profiles.cols, 0, profiles.n_cols),
        y: Axis::new(RELATIVE_POWER, "dB"),
        series: vec![Series::new("", points)],
        ..LinePlot::default()
    }
}

/// Writes a histogram of ADC values, with the statistics of each receiver.
pub(crate) fn write_adc_statistics(path: &Path, stats: &AdcStats) -> CliResult {
    // Bins are half octaves of 1 + |value|, see `AdcStats::histogram`; these are their edges.
    let edges = (0..=HISTOGRAM_BINS).map(|i| {
        let half_octaves = i as f64 - 0.5 * HISTOGRAM_BINS as f64;
        half_octaves.signum() * (2_f64.powf(0.5 * half_octaves.abs() + 0.25) - 1.0)
    });
    let channels = stats.channels();
    let series = channels.iter().enumerate().filter_map(|(i, c)| {
        let counts = stats.histogram(i)?;
        let total = counts.iter().sum::<u64>().max(1) as f64;
        let shares = counts.iter().map(|n| *n as f64 / total).collect();
        let name = format!(
            "RX{}: {:.2} % saturated, offset {:+.1}{:+.1}j, I/Q {:+.2} dB {:+.1}\u{b0}",
            i + 1,
            100.0 * c.saturated,
            c.mean[0],
            c.mean[1],
            c.gain_imbalance_db,
            c.phase_imbalance_rad.to_degrees()
        );
        Some((name.replace('-', "\u{2212}"), shares))
    });
    let plot = Histogram {
        title: "ADC values of each receiver".into(),
        x: Axis::new("Value of I or Q", "counts").with_scale(AxisScale::SignedLog),
        y: Axis::new("Share of values", "").with_scale(AxisScale::Log10),
        edges: edges.collect(),
        series: series.collect(),
    };
    write_figure(path, &plot.to_svg())
}

/// Label for decibels relative to the maximum of a map.
const RELATIVE_POWER: &str = "Power relative to maximum";

/// Rows of a map to plot.
#[derive(Clone, Copy)]
enum RowRange {
    All,
    AroundMaximum,
}

fn no_frame() -> CliError {
    CliError::new("no frame to plot")
}

fn write_map(path: &Option<PathBuf>, map: Option<Map>, rows: RowRange, title: &str) -> CliResult {
    let Some(path): Option<&Path> = path.as_deref() else {
        return Ok(());
    };
    let map = heatmap(&map.ok_or_else(no_frame)?, rows, title)
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
    write_plot(path, || map.to_svg(), || map.to_png())
}

/// A map in dB relative to its maximum.
fn heatmap(map: &Map, rows: RowRange, title: &str) -> Result<Heatmap, PlotError> {
    let values = map.to_db(-DEPTH_DB);
    let strongest = (0..values.len())
        .max_by(|a, b| values[*a].total_cmp(&values[*b]))
        .unwrap_or(0);
    let (mut first, mut last) = (0, map.n_rows.saturating_sub(1));
    if let RowRange::AroundMaximum = rows {
        let margin = (SHOWN_RANGE_M / map.rows.step.abs().max(1e-6)) as usize;
        let row = strongest / map.n_cols.max(1);
        (first, last) = (row.saturating_sub(margin), (row + margin).min(last));
    }
    let shown = values[first * map.n_cols..(last + 1) * map.n_cols]
        .iter()
        .map(|v| v - values[strongest])
        .collect();
    let n_rows = last + 1 - first;
    Ok(Heatmap {
        title: title.into(),
        x: plot_axis(&map.cols, 0, map.n_cols),
        y: plot_axis(&map.rows, first, n_rows),
        values: Grid::new(n_rows, map.n_cols, shown)?,
        colour_bar: Axis::new(RELATIVE_POWER, "dB").with_limits(-f64::from(DEPTH_DB), 0.0),
    })
}

/// The axis of `n` cells of a map, starting at `first`. The initial of a quantity is capitalised; a symbol is
/// unchanged.
fn plot_axis(axis: &radarllm_radar_dsp::Axis, first: usize, n: usize) -> Axis {
    let mut label = axis.label.to_owned();
    if !axis.label.contains('/') {
        label[..1].make_ascii_uppercase();
    }
    Axis::new(label, axis.unit).with_cells(axis.at(first), axis.step, n)
}
