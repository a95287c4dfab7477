//! The whole signal chain from cube to points.

use radarllm_base::{PointFrame, RadarConfig, RadarCube, RadarPoint};

use crate::array::VirtualArray;
use crate::capon::CaponDetector;
use crate::detect::Selector;
use crate::direction::DirectionFinder;
use crate::error::DspError;
use crate::options::{DspOptions, ImpossibleDirection, MapKind};
use crate::spectrum::{Spectrum, signed_doppler};

/// Number of cells by which the cache prefetch runs ahead.
const CELLS_AHEAD: usize = 2;

/// Turns cubes of one radar into points; see radar-dsp's crate page for the chain.
///
/// # Example
/// ```
/// use radarllm_base::{RadarConfig, RadarCube};
/// use radarllm_radar_dsp::{DspOptions, PointExtractor};
///
/// let radar = RadarConfig::awr1843boost();
/// let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
/// let frame = extractor.extract(&RadarCube::zeros(128, 3, 4, 256))?;
/// assert!(frame.points.is_empty());
/// # Ok::<(), radarllm_radar_dsp::DspError>(())
/// ```
pub struct PointExtractor {
    pub(crate) radar: RadarConfig,
    pub(crate) options: DspOptions,
    pub(crate) spectrum: Spectrum,
    pub(crate) directions: DirectionFinder,
    selector: Selector,
    capon: Option<CaponDetector>,
}

impl PointExtractor {
    /// Plans the chain for one radar.
    ///
    /// # Errors
    /// Returns an error for an invalid radar, or an option that cannot be used with it.
    pub fn new(radar: &RadarConfig, options: DspOptions) -> Result<Self, DspError> {
        radar.validate()?;
        if options.max_points == 0 {
            let problem = "must be at least 1".into();
            return Err(DspError::Option {
                field: "max_points",
                problem,
            });
        }
        let spectrum = Spectrum::new(radar, &options)?;
        let n_channels = spectrum.n_channels();
        let selector = Selector::new(
            spectrum.gate.len(),
            spectrum.n_doppler(),
            n_channels,
            &options,
        )?;
        if let Some(db) = options
            .azimuth_step_db
            .filter(|db| !(-1000.0..=1000.0).contains(db))
        {
            return Err(DspError::Option {
                field: "azimuth_step_db",
                problem: format!("must be within +-1000, found {db}"),
            });
        }
        let directions = DirectionFinder::new(radar, &options);
        let capon = options.capon.as_ref();
        let capon = capon.map(|capon| CaponDetector::new(radar, capon));
        let capon = capon.transpose()?;
        Ok(Self {
            radar: radar.clone(),
            options,
            spectrum,
            directions,
            selector,
            capon,
        })
    }

    /// Extracts the points of one frame, strongest first, at most [`DspOptions::max_points`].
    ///
    /// - range: bin centre, minus the range-Doppler coupling if that correction is enabled. velocity: centre of the
    ///   Doppler bin, positive when receding, relative to [`RadarConfig::carrier_hz`]. Both refer to the middle of the
    ///   frame's active time. `time_s` is the time of the first chirp, taken from the cube.
    /// - x = R u_x, z = R u_z, y = sqrt(R^2 - x^2 - z^2): targets are assumed to be in front of the radar.
    /// - intensity: with [`DspOptions::capon`] the ratio to the noise along range in dB, otherwise 10 log10 D, with D of [`MapKind`] and unnormalised FFTs. It is relative to a D of one squared
    ///   sample unit (non-coherent) or one sample unit (coherent, the paper's 10 log10 |D|).
    /// - `frame` is the cube's time in frame periods, rounded.
    ///
    /// # Errors
    /// Returns an error for a cube of another shape, or with values that are not finite.
    pub fn extract(&mut self, cube: &RadarCube) -> Result<PointFrame, DspError> {
        self.spectrum.run(cube)?;
        let frame = (cube.time_s / self.radar.frame_period_s).round() as u32;
        if let Some(capon) = &mut self.capon {
            return Ok(PointFrame {
                frame,
                time_s: cube.time_s,
                points: capon.points(
                    &self.spectrum,
                    &self.directions,
                    self.radar.velocity_resolution_mps(),
                    self.options.max_points,
                ),
                board: None,
            });
        }
        let n_loops = self.spectrum.n_doppler();
        let map = &self.spectrum.map;
        let candidates = self.selector.select(map);
        let mut points = Vec::with_capacity(self.options.max_points.min(candidates.len()));

        // Strongest first. Ties are resolved by position, so that the order never depends on the sort. Only as many
        // cells as needed are sorted. Sorting continues if directions are dropped.
        let order = |a: &u32, b: &u32| map[*b as usize].total_cmp(&map[*a as usize]).then(a.cmp(b));
        let mut rest: &mut [u32] = candidates;
        while !rest.is_empty() && points.len() < self.options.max_points {
            let n = (2 * self.options.max_points).min(rest.len());
            if n < rest.len() {
                rest.select_nth_unstable_by(n, order);
            }
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(n);
            head.sort_unstable_by(order);
            for (i, &cell) in head.iter().enumerate() {
                if let Some(&soon) = head.get(i + CELLS_AHEAD) {
                    self.spectrum.prefetch(soon as usize);
                }
                if points.len() == self.options.max_points {
                    break;
                }
                let point = locate(
                    &self.radar,
                    &self.options,
                    &self.spectrum,
                    &mut self.directions,
                    cell as usize,
                    n_loops,
                );
                points.extend(point);
            }
            rest = tail;
        }
        Ok(PointFrame {
            frame,
            time_s: cube.time_s,
            points,
            board: None,
        })
    }

    /// The radar of the plan.
    pub fn radar(&self) -> &RadarConfig {
        &self.radar
    }

    /// The options of the plan.
    pub fn options(&self) -> &DspOptions {
        &self.options
    }

    /// The virtual array in use. [`VirtualArray::has_elevation`] is true if z is measured, and z is 0 otherwise.
    pub fn array(&self) -> &VirtualArray {
        self.directions.array()
    }

    /// Mean noise power per channel and cell of the last frame, in squared sample units after
    /// unnormalised FFTs; `None` unless the detector is [`crate::Detector::NoiseFloor`].
    pub fn noise_floor(&self) -> Option<f32> {
        self.selector.noise_floor()
    }
}

/// Returns the point of one cell, or `None` if its direction is impossible and such cells are dropped.
fn locate(
    radar: &RadarConfig,
    options: &DspOptions,
    spectrum: &Spectrum,
    directions: &mut DirectionFinder,
    cell: usize,
    n_loops: usize,
) -> Option<RadarPoint> {
    let doppler = signed_doppler(cell % n_loops, n_loops);
    let range_bin = spectrum.gate.start + cell / n_loops;
    let direction = directions.direction(doppler, |channel| spectrum.value(channel, cell));

    let velocity_mps = doppler as f64 * radar.velocity_resolution_mps();
    let mut range_m = range_bin as f64 * spectrum.range_step_m;
    if options.correct_range_doppler_coupling {
        // Beat frequency = 2 S R / c + 2 v f_c / c: a receding target appears farther away.
        range_m -= velocity_mps * radar.carrier_hz() / radar.slope_hz_per_s;
        range_m = range_m.max(0.0);
    }
    let (mut u_x, mut u_z) = (direction.u_x, direction.u_z);
    let outside = u_x * u_x + u_z * u_z;
    if outside > 1.0 {
        match options.impossible_direction {
            ImpossibleDirection::Drop => return None,
            ImpossibleDirection::Clamp => {
                u_x /= outside.sqrt();
                u_z /= outside.sqrt();
            }
        }
    }
    let u_y = (1.0 - u_x * u_x - u_z * u_z).max(0.0).sqrt();
    let power = f64::from(spectrum.map[cell].max(f32::MIN_POSITIVE));
    let intensity_db = match options.map {
        MapKind::NonCoherent | MapKind::MeanLog => 10.0 * power.log10(),
        // D is the modulus of the complex sum: half of its power in dB.
        MapKind::Coherent => 5.0 * power.log10(),
    };
    Some(RadarPoint {
        x_m: (range_m * u_x) as f32,
        y_m: (range_m * u_y) as f32,
        z_m: (range_m * u_z) as f32,
        range_m: range_m as f32,
        velocity_mps: velocity_mps as f32,
        intensity_db: intensity_db as f32,
    })
}
