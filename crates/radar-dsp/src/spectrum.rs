//! Range-Doppler processing of samples: windows, FFTs, clutter removal, detection map.

use std::ops::Range;

use num_complex::Complex32;
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_simd::{Cell, LANES, SimdLevel, prefetch};

use crate::doppler_fft::DopplerFft;
use crate::error::DspError;
use crate::kernels::{add, add_power, peak, rows_of_bins};
use crate::options::{ClutterFilter, DspOptions, MapKind};
use crate::row_fft::{Blocks, RowFft, SampleRows};

/// Maximum length of the range FFT: eight times the maximum number of samples per chirp of the supported parts.
const MAX_RANGE_FFT: usize = 1 << 16;

/// Plan and workspace of the range-Doppler stage.
///
/// The map is `[gated range bin, doppler]`. The position of a cell in the map is its index everywhere. The range FFTs
/// work row by row and write blocks of sixteen range bins that start at a multiple of sixteen. The Doppler FFTs process
/// a block at once, which needs no transposition.
///
/// Doppler is kept in FFT order (bin 0 first); [`signed_doppler`] turns an index into the signed bin.
/// All FFTs are forward, e^{-j...}, unnormalised.
pub struct Spectrum {
    shape: [usize; 4],
    /// Range bins of the FFT: at least the number of samples.
    pub n_range: usize,
    /// Range from one bin to the next, m.
    pub range_step_m: f64,
    /// Range bins inside the range gate.
    pub gate: Range<usize>,
    map_kind: MapKind,
    subtract_receiver_mean: bool,
    /// Factor per Doppler index that shifts slot 1 to the time of slot 0. Empty without binary phase modulation.
    bpm_factors: Vec<Complex32>,
    /// Range FFT, including the window.
    range_fft: RowFft,
    doppler_fft: DopplerFft,
    simd: SimdLevel,
    /// One channel's chirps, `[block, loop]`, for the blocks that contain gated bins.
    chirps: Vec<Cell>,
    /// Cells from one block to the next in `chirps`.
    stride: usize,
    /// Spectra of the last cube, `[channel, block, doppler]`.
    spectra: Vec<Cell>,
    /// Sum of all channels' spectra for [`MapKind::Coherent`], else empty.
    coherent: Vec<Cell>,
    /// Detection power, `[block, doppler][bin of the block]`.
    powers: Vec<[f32; LANES]>,
    /// Detection power of the last cube: sum of |.|^2, or |sum|^2 for the coherent kind.
    pub map: Vec<f32>,
}

/// The signed Doppler bin of FFT index `index`: 0, 1, .., then negative, as after an fftshift.
pub fn signed_doppler(index: usize, n_loops: usize) -> i64 {
    if index < n_loops.div_ceil(2) {
        index as i64
    } else {
        index as i64 - n_loops as i64
    }
}

impl Spectrum {
    /// Plans for a valid radar.
    ///
    /// # Errors
    /// [`DspError::Option`] if the range gate holds no bin, or clutter removal has a single loop.
    pub fn new(radar: &RadarConfig, options: &DspOptions) -> Result<Self, DspError> {
        let (n_loops, n_samples) = (radar.n_loops, radar.n_samples);
        if options.clutter.removes_static() && n_loops < 2 {
            return Err(DspError::Option {
                field: "clutter",
                problem: "the radar has a single loop per frame: nothing can be seen to move"
                    .into(),
            });
        }
        if options.clutter == ClutterFilter::ReceiverMean && radar.rx.len() < 2 {
            return Err(DspError::Option {
                field: "clutter",
                problem: "`receiver_mean` leaves nothing of a radar with a single receiver".into(),
            });
        }
        let n_range = options.range_fft_len.unwrap_or(n_samples);
        if !(n_samples..=MAX_RANGE_FFT.max(n_samples)).contains(&n_range) {
            return Err(DspError::Option {
                field: "range_fft_len",
                problem: format!(
                    "must be from the {n_samples} samples of a chirp to {MAX_RANGE_FFT}, found {n_range}"
                ),
            });
        }
        let range_step_m = radar.range_resolution_m() * n_samples as f64 / n_range as f64;
        let gate = range_gate(options, range_step_m, n_range)?;
        let n_channels = radar.tx.len() * radar.rx.len();
        let doppler_window = options.doppler_window.weights(n_loops);
        let simd = SimdLevel::detect();
        let range_fft = RowFft::new(simd, options.range_window.weights(n_samples), n_range);
        let n_blocks = gate.end.div_ceil(LANES) - gate.start / LANES;
        // With a power-of-two stride between blocks, all blocks of a chirp would share a few sets of the cache.
        let stride = n_loops + 1;
        let n_coherent = if options.map == MapKind::Coherent {
            n_blocks * n_loops
        } else {
            0
        };
        Ok(Self {
            shape: [n_loops, radar.tx.len(), radar.rx.len(), n_samples],
            n_range,
            range_step_m,
            map_kind: options.map,
            subtract_receiver_mean: options.clutter == ClutterFilter::ReceiverMean,
            bpm_factors: bpm_factors(radar, options),
            range_fft,
            doppler_fft: DopplerFft::new(
                simd,
                mean_weights(options.clutter, &doppler_window),
                doppler_window,
            ),
            simd,
            chirps: vec![Cell::ZERO; n_blocks * stride],
            stride,
            coherent: vec![Cell::ZERO; n_coherent],
            spectra: vec![Cell::ZERO; n_channels * n_blocks * n_loops],
            powers: vec![[0.0; LANES]; n_blocks * n_loops],
            map: vec![0.0; gate.len() * n_loops],
            gate,
        })
    }

    /// Number of Doppler bins.
    pub fn n_doppler(&self) -> usize {
        self.shape[0]
    }

    /// Channels, slots times receivers.
    pub fn n_channels(&self) -> usize {
        self.shape[1] * self.shape[2]
    }

    /// The last cube's spectrum in one channel, `tx * n_rx + rx`, and cell of the map.
    pub fn value(&self, channel: usize, cell: usize) -> Complex32 {
        let (place, lane) = self.place(cell);
        self.spectra[channel * self.powers.len() + place].number(lane)
    }

    /// Position of a cell of the map in a channel's spectra: index of the spectrum cell, and its lane.
    fn place(&self, cell: usize) -> (usize, usize) {
        let n_loops = self.shape[0];
        let (bin, doppler) = (self.gate.start % LANES + cell / n_loops, cell % n_loops);
        (bin / LANES * n_loops + doppler, bin % LANES)
    }

    /// Prefetches a cell of the map in all channels, so that a later [`Self::value`] does not wait for memory.
    pub(crate) fn prefetch(&self, cell: usize) {
        let (place, _) = self.place(cell);
        for spectra in self.spectra.chunks_exact(self.powers.len()) {
            prefetch(std::slice::from_ref(&spectra[place]));
        }
    }

    /// Computes the spectra and [`Self::map`] of a cube.
    ///
    /// # Errors
    /// Wrong shape, a sample that is not finite, or power beyond `f32`.
    pub fn run(&mut self, cube: &RadarCube) -> Result<(), DspError> {
        self.check_shape(cube)?;
        self.powers.fill([0.0; LANES]);
        self.coherent.fill(Cell::ZERO);
        let is_bpm = !self.bpm_factors.is_empty();
        // Both need the spectra of several channels before the powers are known.
        let is_joint = is_bpm || self.subtract_receiver_mean;
        // In this case, the last pass of the Doppler FFTs also adds the powers.
        let measure = self.map_kind == MapKind::NonCoherent && !is_joint;
        for channel in 0..self.n_channels() {
            self.transform_chirps(cube, channel);
            self.doppler_spectra(channel, measure);
            if !measure && !is_joint {
                self.add_to_powers(channel);
            }
        }
        if is_bpm {
            self.decode_bpm();
        }
        if self.subtract_receiver_mean {
            self.subtract_mean_over_receivers();
        }
        if is_joint {
            for channel in 0..self.n_channels() {
                self.add_to_powers(channel);
            }
        }
        self.fill_map();
        let mut largest = 0.0;
        peak(self.simd, &self.map, &mut largest);
        if !largest.is_nan() {
            return Ok(());
        }
        // If a sample is not finite, no cell of the map is. Samples are therefore checked before the map.
        (0..self.n_channels()).try_for_each(|channel| check_finite(cube, channel))?;
        let cell = self.map.iter().position(|p| !p.is_finite());
        let cell = cell.unwrap_or_default();
        Err(DspError::Overflow {
            range_bin: self.gate.start + cell / self.shape[0],
            doppler_bin: signed_doppler(cell % self.shape[0], self.shape[0]),
        })
    }

    /// Computes one channel of `spectra` from `chirps`, and adds to `powers` if `measure`.
    fn doppler_spectra(&mut self, channel: usize, measure: bool) {
        let n_channel = self.powers.len();
        let spectra = &mut self.spectra[channel * n_channel..][..n_channel];
        let powers = measure.then_some(&mut self.powers[..]);
        self.doppler_fft
            .process(&self.chirps, self.stride, spectra, powers);
    }

    fn add_to_powers(&mut self, channel: usize) {
        let n_channel = self.powers.len();
        let spectra = &self.spectra[channel * n_channel..][..n_channel];
        match self.map_kind {
            MapKind::NonCoherent => add_power(self.simd, &mut self.powers, spectra),
            MapKind::MeanLog => add_log_power(&mut self.powers, spectra),
            MapKind::Coherent => add(self.simd, &mut self.coherent, spectra),
        }
    }

    /// Computes the map from the sums over all channels.
    fn fill_map(&mut self) {
        match self.map_kind {
            MapKind::NonCoherent => (),
            MapKind::MeanLog => {
                let per_channel = 1.0 / self.n_channels() as f32;
                for value in self.powers.as_flattened_mut() {
                    *value = (*value * per_channel).exp();
                }
            }
            MapKind::Coherent => add_power(self.simd, &mut self.powers, &self.coherent),
        }
        let n_loops = self.shape[0];
        let mut rest = &mut self.map[..];
        let mut first = self.gate.start % LANES;
        for powers in self.powers.chunks_exact(n_loops) {
            let n_values = ((LANES - first) * n_loops).min(rest.len());
            let (rows, behind) = std::mem::take(&mut rest).split_at_mut(n_values);
            rows_of_bins(self.simd, powers, first, rows);
            (rest, first) = (behind, 0);
        }
    }

    /// Converts the spectra of the slots to those of the transmitters, both referred to slot 0. With A = S1 + S2 and
    /// the later slot B = (S1 - S2) e^{j phi}, S1 = (A + B e^{-j phi}) / 2 and S2 = (A - B e^{-j phi}) / 2. The echoes
    /// are as strong as with time division, and the noise of two slots is averaged.
    fn decode_bpm(&mut self) {
        let (first, second) = self.spectra.split_at_mut(self.shape[2] * self.powers.len());
        let factors = self.bpm_factors.iter().cycle();
        for ((a, b), factor) in first.iter_mut().zip(second).zip(factors) {
            for i in 0..LANES {
                let sum = Complex32::new(a.re[i], a.im[i]);
                let difference = Complex32::new(b.re[i], b.im[i]) * factor;
                let (one, other) = ((sum + difference) * 0.5, (sum - difference) * 0.5);
                (a.re[i], a.im[i]) = (one.re, one.im);
                (b.re[i], b.im[i]) = (other.re, other.im);
            }
        }
    }

    /// Subtracts the mean over the receivers of each transmitter from each cell.
    fn subtract_mean_over_receivers(&mut self) {
        let (n_rx, n_channel) = (self.shape[2], self.powers.len());
        let share = 1.0 / n_rx as f32;
        for of_transmitter in self.spectra.chunks_exact_mut(n_rx * n_channel) {
            for place in 0..n_channel {
                let mut mean = Cell::ZERO;
                for rx in 0..n_rx {
                    let cell = &of_transmitter[rx * n_channel + place];
                    for i in 0..LANES {
                        mean.re[i] += cell.re[i] * share;
                        mean.im[i] += cell.im[i] * share;
                    }
                }
                for rx in 0..n_rx {
                    let cell = &mut of_transmitter[rx * n_channel + place];
                    for i in 0..LANES {
                        cell.re[i] -= mean.re[i];
                        cell.im[i] -= mean.im[i];
                    }
                }
            }
        }
    }

    /// Windowed range FFTs of all chirps of one channel, all [`Self::n_range`] bins, loop by loop. With
    /// binary phase modulation these are the slots', not the transmitters'.
    ///
    /// # Errors
    /// [`DspError::NotFinite`].
    pub fn range_spectra(
        &mut self,
        cube: &RadarCube,
        channel: usize,
    ) -> Result<impl Iterator<Item = Vec<Complex32>>, DspError> {
        check_finite(cube, channel)?;
        let n_loops = self.shape[0];
        let mut cells = vec![Cell::ZERO; self.range_fft.n_blocks() * n_loops];
        let blocks = Blocks {
            cells: &mut cells,
            first: 0,
            stride: n_loops,
        };
        transform_chirps(&mut self.range_fft, cube, channel, blocks);
        let n_range = self.n_range;
        Ok((0..n_loops).map(move |loop_idx| {
            let blocks = cells[loop_idx..].iter().step_by(n_loops);
            blocks.flat_map(Cell::numbers).take(n_range).collect()
        }))
    }

    /// Fills `chirps` with one channel.
    fn transform_chirps(&mut self, cube: &RadarCube, channel: usize) {
        let blocks = Blocks {
            cells: &mut self.chirps,
            first: self.gate.start / LANES,
            stride: self.stride,
        };
        transform_chirps(&mut self.range_fft, cube, channel, blocks);
    }

    /// Refuses a cube of another shape, or one whose data does not fill its shape.
    ///
    /// # Errors
    /// [`DspError::Shape`], [`DspError::Length`], [`DspError::Time`].
    pub fn check_shape(&self, cube: &RadarCube) -> Result<(), DspError> {
        let found = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
        if found != self.shape {
            return Err(DspError::Shape {
                expected: self.shape,
                found,
            });
        }
        let expected = self.shape.iter().product();
        if cube.data.len() != expected {
            return Err(DspError::Length {
                shape: found,
                expected,
                found: cube.data.len(),
            });
        }
        if !cube.time_s.is_finite() {
            return Err(DspError::Time);
        }
        Ok(())
    }
}

/// Windowed range FFTs of one channel's chirps.
fn transform_chirps(fft: &mut RowFft, cube: &RadarCube, channel: usize, out: Blocks<'_>) {
    let rows = SampleRows {
        data: &cube.data[channel * cube.n_samples..],
        stride: cube.n_tx * cube.n_rx * cube.n_samples,
        n_rows: cube.n_loops,
    };
    fft.process(rows, out);
}

/// Refuses samples that are not finite.
fn check_finite(cube: &RadarCube, channel: usize) -> Result<(), DspError> {
    let (slot, rx) = (channel / cube.n_rx, channel % cube.n_rx);
    for loop_idx in 0..cube.n_loops {
        let mut samples = cube.chirp(loop_idx, slot, rx).iter();
        if let Some(i) = samples.position(|s| !(s.re.is_finite() && s.im.is_finite())) {
            return Err(DspError::NotFinite {
                index: [loop_idx, slot, rx, i],
            });
        }
    }
    Ok(())
}

/// A target in Doppler bin k gains the phase 2 pi k / (2 n_loops) in half a loop. For frequencies within the bin, the
/// error is up to pi / (2 n_loops), which leaves -44 dB of one transmitter in the other with 128 loops.
fn bpm_factors(radar: &RadarConfig, options: &DspOptions) -> Vec<Complex32> {
    if radar.multiplexing != TxMultiplexing::Bpm {
        return vec![];
    }
    let n_loops = radar.n_loops;
    (0..n_loops)
        .map(|index| {
            if !options.compensate_tdm {
                return Complex32::ONE;
            }
            let turns = signed_doppler(index, n_loops) as f64 / (2 * n_loops) as f64;
            let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
            Complex32::new(cos as f32, -sin as f32)
        })
        .collect()
}

fn range_gate(options: &DspOptions, bin_m: f64, n_range: usize) -> Result<Range<usize>, DspError> {
    for (field, value) in [
        ("min_range_m", options.min_range_m),
        ("max_range_m", options.max_range_m),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            let problem = format!("must be finite and not negative, found {value}");
            return Err(DspError::Option { field, problem });
        }
    }
    // The casts saturate. A gate beyond the last bin ends at the last bin.
    let first = (options.min_range_m / bin_m).ceil() as usize;
    let end = ((options.max_range_m / bin_m).floor() as usize)
        .saturating_add(1)
        .min(n_range);
    if first >= end {
        return Err(DspError::Option {
            field: "min_range_m",
            problem: format!(
                "no range bin between {} m and {} m: bins are {bin_m:.4} m wide and end at {:.2} m",
                options.min_range_m,
                options.max_range_m,
                bin_m * n_range as f64
            ),
        });
    }
    Ok(first..end)
}

/// Slow-time weights of the mean, which sum to one. Empty for filters that do not remove static echoes.
fn mean_weights(clutter: ClutterFilter, window: &[f32]) -> Vec<f32> {
    let weights: Vec<f64> = match clutter {
        ClutterFilter::Off | ClutterFilter::ReceiverMean => vec![],
        ClutterFilter::Mean => vec![1.0; window.len()],
        ClutterFilter::WeightedMean => window.iter().map(|w| f64::from(*w)).collect(),
    };
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

/// Adds ln |.|^2. An exact zero counts as the smallest positive number, and NaN remains NaN.
fn add_log_power(sums: &mut [[f32; LANES]], spectra: &[Cell]) {
    for (sums, cell) in sums.iter_mut().zip(spectra) {
        for ((sum, re), im) in sums.iter_mut().zip(cell.re).zip(cell.im) {
            let power = re * re + im * im;
            *sum += if power < f32::MIN_POSITIVE {
                f32::MIN_POSITIVE.ln()
            } else {
                power.ln()
            };
        }
    }
}
