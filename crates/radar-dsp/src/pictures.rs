//! Maps for pictures: range-Doppler, range-azimuth, range profile, micro-Doppler.

use radarllm_base::{RadarConfig, RadarCube};

use crate::error::DspError;
use crate::extractor::PointExtractor;
use crate::spectrum::signed_doppler;

/// Meaning of one axis of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity, for example "velocity".
    pub label: &'static str,
    /// Unit, for example "m/s".
    pub unit: &'static str,
    /// Value at index 0.
    pub start: f64,
    /// Step to the next index.
    pub step: f64,
}

impl Axis {
    /// Value at an index.
    pub fn at(&self, index: usize) -> f64 {
        self.start + self.step * index as f64
    }
}

/// A rectangle of linear power, `[row, column]`, column fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Rows.
    pub n_rows: usize,
    /// Columns.
    pub n_cols: usize,
    /// `n_rows * n_cols` powers, squared sample units after unnormalised FFTs.
    pub values: Vec<f32>,
    /// Meaning of the row index.
    pub rows: Axis,
    /// Meaning of the column index.
    pub cols: Axis,
}

impl Map {
    /// 10 log10 of every value, not below `floor_db` relative to the largest.
    pub fn to_db(&self, floor_db: f32) -> Vec<f32> {
        let peak = self
            .values
            .iter()
            .copied()
            .fold(f32::MIN_POSITIVE, f32::max);
        let peak_db = 10.0 * peak.log10();
        self.values
            .iter()
            .map(|v| (10.0 * v.max(f32::MIN_POSITIVE).log10()).max(peak_db + floor_db))
            .collect()
    }
}

impl PointExtractor {
    /// Detection map of a frame: rows are the gated ranges, columns velocities from -v_max up.
    ///
    /// # Example
    /// ```
    /// use radarllm_base::{RadarConfig, RadarCube};
    /// use radarllm_radar_dsp::{DspOptions, PointExtractor};
    ///
    /// let radar = RadarConfig::awr1843boost();
    /// let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
    /// let map = extractor.range_doppler_map(&RadarCube::zeros(128, 3, 4, 256))?;
    /// // Velocity zero is in the middle; an empty map is flat at any floor.
    /// assert_eq!((map.n_cols, map.cols.at(64)), (128, 0.0));
    /// assert!(map.to_db(-60.0).windows(2).all(|db| db[0] == db[1]));
    /// # Ok::<(), radarllm_radar_dsp::DspError>(())
    /// ```
    ///
    /// # Errors
    /// As [`PointExtractor::extract`].
    pub fn range_doppler_map(&mut self, cube: &RadarCube) -> Result<Map, DspError> {
        self.spectrum.run(cube)?;
        let n = self.spectrum.n_doppler();
        let mut values = Vec::with_capacity(self.spectrum.map.len());
        for row in self.spectrum.map.chunks_exact(n) {
            let (positive, negative) = row.split_at(n.div_ceil(2));
            values.extend_from_slice(negative);
            values.extend_from_slice(positive);
        }
        Ok(Map {
            n_rows: self.spectrum.gate.len(),
            n_cols: n,
            values,
            rows: range_axis(self.spectrum.range_step_m, self.spectrum.gate.start),
            cols: velocity_axis(&self.radar),
        })
    }

    /// Power over range and azimuth, summed over Doppler. Rows are gated ranges, columns the direction cosine x/R in
    /// ascending order. The spectrum is TDM-compensated. The azimuth row alone does not resolve elevation. A radar
    /// without azimuth gives one column per FFT bin, all with equal values.
    ///
    /// # Errors
    /// As [`PointExtractor::extract`].
    pub fn range_azimuth_map(&mut self, cube: &RadarCube) -> Result<Map, DspError> {
        self.spectrum.run(cube)?;
        let (n_doppler, n_cells) = (self.spectrum.n_doppler(), self.spectrum.map.len());
        let n_azimuth = self.directions.n_azimuth();
        let n_rows = self.spectrum.gate.len();
        let mut values = vec![0.0_f32; n_rows * n_azimuth];
        for cell in 0..n_cells {
            let doppler = signed_doppler(cell % n_doppler, n_doppler);
            let spectrum = &self.spectrum;
            let bins = self
                .directions
                .azimuth_spectrum(doppler, |channel| spectrum.value(channel, cell));
            let row = &mut values[cell / n_doppler * n_azimuth..][..n_azimuth];
            for (k, value) in bins.iter().enumerate() {
                // Phase steps from +pi down to -pi correspond to x/R from left to right. The length of the FFT is even.
                row[(n_azimuth / 2 + n_azimuth - k) % n_azimuth] += value.norm_sqr();
            }
        }
        let step_rad = std::f64::consts::TAU / n_azimuth as f64;
        let (start, step) = if self.array().has_azimuth() {
            let u = |phase_rad: f64| self.directions.u_x_of_phase_step(phase_rad);
            (u(std::f64::consts::PI), u(-step_rad))
        } else {
            (-1.0, 2.0 / n_azimuth as f64)
        };
        Ok(Map {
            n_rows,
            n_cols: n_azimuth,
            values,
            rows: range_axis(self.spectrum.range_step_m, self.spectrum.gate.start),
            cols: Axis {
                label: "x / range",
                unit: "",
                start,
                step,
            },
        })
    }

    /// Mean power per chirp and channel over range, all bins, static targets included. One row.
    ///
    /// # Errors
    /// As [`PointExtractor::extract`].
    pub fn range_profile(&mut self, cube: &RadarCube) -> Result<Map, DspError> {
        let all = self.channel_profiles(cube)?;
        let mut values = vec![0.0_f32; all.n_cols];
        for row in all.values.chunks_exact(all.n_cols) {
            for (sum, value) in values.iter_mut().zip(row) {
                *sum += value / all.n_rows as f32;
            }
        }
        Ok(Map {
            n_rows: 1,
            values,
            ..all
        })
    }

    /// Mean power per chirp over range of every channel, one row per channel `slot * n_rx + rx`, for all bins and with
    /// static targets.
    ///
    /// # Errors
    /// As [`PointExtractor::extract`].
    pub fn channel_profiles(&mut self, cube: &RadarCube) -> Result<Map, DspError> {
        self.spectrum.check_shape(cube)?;
        let n_range = self.spectrum.n_range;
        let (n_channels, n_loops) = (self.spectrum.n_channels(), self.spectrum.n_doppler());
        let mut values = Vec::with_capacity(n_channels * n_range);
        for channel in 0..n_channels {
            let mut sums = vec![0.0_f64; n_range];
            for chirp in self.spectrum.range_spectra(cube, channel)? {
                for (sum, value) in sums.iter_mut().zip(chirp) {
                    *sum += f64::from(value.norm_sqr());
                }
            }
            values.extend(sums.iter().map(|s| (s / n_loops as f64) as f32));
        }
        Ok(Map {
            n_rows: n_channels,
            n_cols: n_range,
            values,
            rows: Axis {
                label: "channel",
                unit: "",
                start: 1.0,
                step: 1.0,
            },
            cols: range_axis(self.spectrum.range_step_m, 0),
        })
    }
}

/// Doppler spectrum over frames: the gated detection map summed over range, one column per frame.
#[derive(Clone, Debug, Default)]
pub struct MicroDoppler {
    columns: Vec<Vec<f32>>,
    velocity: Option<Axis>,
    frame_period_s: f64,
}

impl MicroDoppler {
    /// Adds one frame. All frames of a spectrogram must come from the same extractor.
    ///
    /// # Errors
    /// As [`PointExtractor::extract`]; [`DspError::Shape`] when the extractor's Doppler size changed.
    pub fn push(
        &mut self,
        extractor: &mut PointExtractor,
        cube: &RadarCube,
    ) -> Result<(), DspError> {
        let map = extractor.range_doppler_map(cube)?;
        if let Some(first) = self.columns.first()
            && first.len() != map.n_cols
        {
            let found = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
            return Err(DspError::Shape {
                expected: [first.len(), found[1], found[2], found[3]],
                found,
            });
        }
        let mut column = vec![0.0_f32; map.n_cols];
        for row in map.values.chunks_exact(map.n_cols) {
            for (sum, value) in column.iter_mut().zip(row) {
                *sum += value;
            }
        }
        self.columns.push(column);
        self.velocity = Some(map.cols);
        self.frame_period_s = extractor.radar().frame_period_s;
        Ok(())
    }

    /// The spectrogram: rows are velocities from -v_max up, columns frames. `None` without frames.
    pub fn finish(self) -> Option<Map> {
        let rows = self.velocity?;
        let (n_rows, n_cols) = (self.columns.first()?.len(), self.columns.len());
        let values = (0..n_rows)
            .flat_map(|r| self.columns.iter().map(move |c| c[r]))
            .collect();
        let cols = Axis {
            label: "time",
            unit: "s",
            start: 0.0,
            step: self.frame_period_s,
        };
        Some(Map {
            n_rows,
            n_cols,
            values,
            rows,
            cols,
        })
    }
}

fn range_axis(step: f64, first_bin: usize) -> Axis {
    Axis {
        label: "range",
        unit: "m",
        start: first_bin as f64 * step,
        step,
    }
}

fn velocity_axis(radar: &RadarConfig) -> Axis {
    let step = radar.velocity_resolution_mps();
    Axis {
        label: "velocity",
        unit: "m/s",
        start: -((radar.n_loops / 2) as f64) * step,
        step,
    }
}
