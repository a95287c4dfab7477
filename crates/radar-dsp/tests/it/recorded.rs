//! Raw frames of a real TI radar (OpenRadar's tutorials), where they are at hand.

use std::path::PathBuf;

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_radar_dsp::{ClutterFilter, DspOptions, PointExtractor};

fn shared() -> Option<PathBuf> {
    let path = std::env::var_os("RADARLLM_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        PathBuf::from,
    );
    path.is_dir().then_some(path)
}

/// Complex128 npy of raw unsigned 16-bit words; the file was made in the order loop, tx, rx, sample.
fn read_words(path: &std::path::Path) -> Vec<Complex32> {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00", "npy version 1");
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert!(String::from_utf8_lossy(&bytes[10..10 + header]).contains("'<c16'"));
    let signed = |b: &[u8]| f64::from_le_bytes(b.try_into().unwrap()) as u16 as i16;
    bytes[10 + header..]
        .chunks_exact(16)
        .map(|c| Complex32::new(signed(&c[..8]).into(), signed(&c[8..]).into()))
        .collect()
}

/// The tutorials' chirp: two transmitters, 128 loops of 128 samples.
fn radar() -> RadarConfig {
    let mut radar = RadarConfig {
        name: "openradar".into(),
        start_hz: 77.4201e9,
        slope_hz_per_s: 60e12,
        idle_s: 30e-6,
        adc_start_s: 6e-6,
        ramp_end_s: 62e-6,
        n_samples: 128,
        sample_rate_hz: 2.5e6,
        ..RadarConfig::awr1843boost()
    };
    radar.tx.truncate(2);
    radar
}

#[test]
fn a_recorded_frame_shows_its_movers_and_loses_its_static_target() {
    let Some(shared) = shared() else {
        println!("skipped: no shared data");
        return;
    };
    let data = read_words(&shared.join("data/openradar/doppler_example_1.npy"));
    let cube = RadarCube {
        n_loops: 128,
        n_tx: 2,
        n_rx: 4,
        n_samples: 128,
        time_s: 0.0,
        data,
    };
    let map = |clutter| {
        let options = DspOptions {
            clutter,
            min_range_m: 0.0,
            ..DspOptions::default()
        };
        let mut extractor = PointExtractor::new(&radar(), options).unwrap();
        (
            extractor.range_doppler_map(&cube).unwrap(),
            extractor.extract(&cube).unwrap().points,
        )
    };
    // Known from the data's description: static at bin 107, movers at bin 60, Doppler -10 and +7.
    let (all, _) = map(ClutterFilter::Off);
    let (moving, points) = map(ClutterFilter::Mean);
    let at = |map: &radarllm_radar_dsp::Map, r: usize, d: i64| {
        map.values[r * map.n_cols + (64 + d) as usize]
    };
    assert!(
        at(&moving, 107, 0) < 1e-4 * at(&all, 107, 0),
        "static target"
    );
    for d in [-10, 7] {
        let here = at(&moving, 60, d);
        // Movers stand out from the same velocity at other ranges, and clutter removal keeps them.
        let mut column: Vec<f32> = (0..128).map(|r| at(&moving, r, d)).collect();
        column.sort_by(f32::total_cmp);
        assert!(
            here > 100.0 * column[64],
            "{d}: {here} against {}",
            column[64]
        );
        assert!(here > 0.8 * at(&all, 60, d), "{d}");
        // Its point: range and velocity of that cell, within a bin for the peak's exact place.
        let radar = radar();
        let (range_m, v) = (
            60.0 * radar.range_resolution_m(),
            d as f64 * radar.velocity_resolution_mps(),
        );
        let near = |p: &&radarllm_base::RadarPoint| {
            (f64::from(p.range_m) - range_m).abs() < 1.2 * radar.range_resolution_m()
                && (f64::from(p.velocity_mps) - v).abs() < 1.2 * radar.velocity_resolution_mps()
        };
        assert!(points.iter().any(|p| near(&p)), "{d}");
    }
}
