//! Frames per second of the chain on the reference radar, one core: noise plus 40 movers.
//!
//! `cargo run --release -p radarllm-radar-dsp --example bench`

use std::time::Instant;

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_radar_dsp::{Detector, DspOptions, PointExtractor};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let radar = RadarConfig::awr1843boost();
    let cube = busy_cube(&radar);
    for (name, options) in [
        ("default", DspOptions::default()),
        ("mmmesh", DspOptions::mmmesh()),
        (
            "ca-cfar",
            DspOptions {
                detector: Detector::CaCfar {
                    guard: 4,
                    train: 8,
                    false_alarm_probability: 1e-4,
                },
                ..DspOptions::default()
            },
        ),
        (
            "up to 5 m",
            DspOptions {
                max_range_m: 5.0,
                ..DspOptions::default()
            },
        ),
    ] {
        let mut extractor = PointExtractor::new(&radar, options)?;
        let n_points = extractor.extract(&cube)?.points.len();
        // Best of several batches, by time on the CPU where the system tells it: the machine may be
        // shared. Neighbours still take cache and clock, so a quiet machine gives more.
        let best_s = (0..10)
            .map(|_| {
                let start = Clock::now();
                for _ in 0..20 {
                    std::hint::black_box(extractor.extract(std::hint::black_box(&cube)).is_ok());
                }
                start.elapsed_s() / 20.0
            })
            .fold(f64::INFINITY, f64::min);
        println!("{name:10} {:7.1} frames/s, {n_points} points", 1.0 / best_s);
    }
    Ok(())
}

/// This thread's time on the CPU (Linux), or else the wall clock.
enum Clock {
    Cpu(f64),
    Wall(Instant),
}

impl Clock {
    fn now() -> Self {
        cpu_s().map_or_else(|| Clock::Wall(Instant::now()), Clock::Cpu)
    }

    fn elapsed_s(&self) -> f64 {
        match self {
            Clock::Cpu(start_s) => cpu_s().unwrap_or(f64::NAN) - start_s,
            Clock::Wall(start) => start.elapsed().as_secs_f64(),
        }
    }
}

/// First field of the scheduler's statistics: nanoseconds this thread ran.
fn cpu_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

/// White noise and 40 moving targets as plane-wave tones: exact physics does not matter to speed.
fn busy_cube(radar: &RadarConfig) -> RadarCube {
    let mut cube = RadarCube::zeros(
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    );
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    for value in &mut cube.data {
        *value = Complex32::new(uniform() - 0.5, uniform() - 0.5);
    }
    let n_channels = cube.n_tx * cube.n_rx;
    for _ in 0..40 {
        let (range, doppler, angle) = (uniform(), uniform() - 0.5, uniform() - 0.5);
        for (i, value) in cube.data.iter_mut().enumerate() {
            let (row, sample) = (i / cube.n_samples, i % cube.n_samples);
            let (l, channel) = (row / n_channels, row % n_channels);
            let turns = range * sample as f32 + doppler * l as f32 + angle * channel as f32;
            *value += Complex32::from_polar(0.3, std::f32::consts::TAU * turns.fract());
        }
    }
    cube
}
