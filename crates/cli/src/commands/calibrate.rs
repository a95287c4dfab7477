//! `radar calibrate`: gains of the virtual channels from a corner reflector.

use std::path::PathBuf;

use clap::Args;
use radarllm_base::Provenance;
use radarllm_formats::{Calibration, adc::AdcStats, calibration::CalibratedChannel};
use radarllm_io::{
    CaptureFormat, CleaningOptions, Opened, RecordingKind, SampleFormat,
    cleaning::{corrector, each_whole_frame},
    layout::open_samples,
};
use radarllm_radar_dsp::{CornerCalibrator, Reflector};
use serde::Serialize;

use crate::{
    error::{CliError, CliResult},
    output, radar_file,
    recording_args::LayoutArgs,
};

/// `radar calibrate`.
#[derive(Args)]
pub(crate) struct CalibrateArgs {
    /// Raw samples of a static corner reflector, in any format that `process` reads.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Radar: a built-in name, a TI .cfg, an export of mmWave Studio (.json) or a radar .toml.
    #[arg(long)]
    pub radar: String,
    /// Distance of the reflector, m. Its echo is searched within --search-m of it.
    #[arg(long)]
    pub range_m: f64,
    /// Half-width of the search interval around --range-m, m.
    #[arg(long, default_value_t = 0.3)]
    pub search_m: f64,
    /// Direction of the reflector, degrees to the right of boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub azimuth_deg: f64,
    /// Direction of the reflector, degrees above boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub elevation_deg: f64,
    /// Output file with the channel gains, TOML.
    #[arg(long)]
    pub out: PathBuf,
    /// adc, dca1000 or npy; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Recording of the same scene without the reflector, whose mean is subtracted.
    #[arg(long, value_name = "EMPTY")]
    pub background: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Minimum power of the reflector relative to other static echoes near it, dB. Below it, they change the gains by a
/// relative 0.1 or more.
const ALONE_DB: f64 = 20.0;
/// Minimum power relative to another static echo, dB. Below it, the detected echo may be a sidelobe of the other one.
const LOUDEST_DB: f64 = 3.0;
/// Fraction of samples at full scale above which a channel counts as saturated. A short loud event stays below it.
const SATURATED_SHARE: f64 = 1e-3;

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    calibration: &'a Calibration,
    notes: &'a [String],
    out: String,
}

/// Runs the command.
pub(crate) fn run(args: &CalibrateArgs) -> CliResult {
    output::check_free(&args.out, args.force)?;
    let radar = radar_file::open(&args.radar)?;
    let named = args.format.as_deref().map(CaptureFormat::from_name);
    let named = named.transpose()?;
    let opened = Opened::samples(&args.capture, named)?;
    let is_array = *opened.kind() == RecordingKind::Samples(SampleFormat::Npy);
    let layout = args.layout.options();
    let mut notes = Vec::new();
    let reflector = Reflector {
        range_m: args.range_m,
        azimuth_rad: args.azimuth_deg.to_radians(),
        elevation_rad: args.elevation_deg.to_radians(),
        search_m: args.search_m,
    };
    let mut calibrator = CornerCalibrator::new(radar.sample_config()?, reflector)?;
    let cleaning = CleaningOptions {
        background: args.background.clone(),
        ..CleaningOptions::default()
    };
    let corrector = corrector(&cleaning, &radar, named, &layout, &mut notes)?;
    let mut frames = open_samples(opened, &radar, &layout, &mut notes, &mut Vec::new())?;
    let radar = radar.into_config()?;
    let first = &args.capture[0];
    let mut stats = AdcStats::new(radar.rx.len(), 16);
    let n_damaged = each_whole_frame(&mut frames, first, &radar, |cube| {
        stats.push(cube);
        let mut cube = cube.clone();
        corrector.apply(&mut cube)?;
        Ok(calibrator.push(&cube)?)
    })?;
    if n_damaged > 0 {
        notes.push(format!("{n_damaged} frames with missing bytes left out"));
    }
    // Saturation is only defined for ADC counts; the values of an array may have any scale.
    if !is_array {
        for (i, channel) in stats.channels().iter().enumerate() {
            if channel.saturated > SATURATED_SHARE {
                return Err(CliError::new(format!(
                    "{}: ADC saturated in {:.1} % of the samples of channel {}",
                    first.display(),
                    100.0 * channel.saturated,
                    i + 1
                ))
                .hint("clipped samples have other phases: less receiver gain, or the reflector farther away"));
            }
        }
    }
    let found = calibrator.finish().map_err(|e| {
        CliError::new(format!("{}: {e}", first.display())).hint(
            "--range-m says where the reflector stands, --background what the place is without it",
        )
    })?;
    if found.above_surroundings_db < LOUDEST_DB {
        return Err(CliError::new(format!(
            "{}: the echo at {:.2} m is no reflector that stands alone: {:+.1} dB against another still echo beside it",
            first.display(),
            found.range_m,
            found.above_surroundings_db
        ))
        .hint("--background takes off what the place is without the reflector"));
    }
    if found.above_surroundings_db < ALONE_DB {
        notes.push(format!(
            "another still echo is only {:.1} dB weaker than the reflector and bends the gains: --background takes it off",
            found.above_surroundings_db
        ));
    }
    let names: Vec<String> = args
        .capture
        .iter()
        .map(|p| p.display().to_string())
        .collect();
    let calibration = Calibration {
        radar: radar.name.clone(),
        source: Provenance::Recorded {
            format: None,
            path: names.join("+"),
        }
        .to_string(),
        range_m: found.range_m,
        azimuth_deg: args.azimuth_deg,
        elevation_deg: args.elevation_deg,
        snr_db: found.snr_db,
        above_surroundings_db: found.above_surroundings_db,
        residual: found.residual,
        frames: found.n_frames,
        channel: CalibratedChannel::all(&radar, &found.gains),
    };
    output::write_atomic(&args.out, calibration.to_toml()?.as_bytes())?;
    for note in &notes {
        note!("note: {note}");
    }
    if args.json {
        return output::print_json(&Report {
            calibration: &calibration,
            notes: &notes,
            out: args.out.display().to_string(),
        });
    }
    output::print_line("slot receiver  gain (dB)  phase (degrees)");
    for c in &calibration.channel {
        output::print_line(&format!(
            "{:>4} {:>8} {:>+10.2} {:>+16.2}",
            c.slot, c.receiver, c.gain_db, c.phase_deg
        ));
    }
    output::print_line(&format!(
        "{}: reflector at {:.3} m, {} frames, signal over noise {:.1} dB, {:.1} dB over its surroundings, gains repeat \
         to {:.4}",
        args.out.display(),
        calibration.range_m,
        calibration.frames,
        calibration.snr_db,
        calibration.above_surroundings_db,
        calibration.residual
    ));
    Ok(())
}
