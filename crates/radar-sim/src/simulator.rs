//! The fast path: simulates a frame from scene to cube.
//!
//! Per segment of at most 30 ms (the whole active time of the reference radar):
//! 1. evaluate the vertices at five key times, and a depth raster at the middle one ([`crate::visibility`]);
//! 2. fit polynomials in time to the phase, range cell and gains of every visible facet (`motion`);
//! 3. sort the sources into groups of similar Doppler with a few nodes in time (`slow_time`);
//! 4. spread the groups on range grids and interpolate these to the loops (`spread`);
//! 5. compute one inverse FFT per chirp and receiver, and add noise (`transform`).
//!
//! Surfaces that stand still are computed once and added to every loop (`still.rs`).
//!
//! Echoes whose path at the middle of the segment is longer than twice the maximum range are left out, as the filter of the
//! intermediate frequency before the ADC takes them away; sampled, they would fold to near ranges.
//!
//! Compared with [`crate::reference`], the error is more than 60 dB below the cube's peak.

use std::ops::Range;
use std::time::Instant;

use glam::Vec3;
use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube, radar_config::TxMultiplexing, seed::derive_seed};

use crate::bounce::{Bounce, BouncingSurfaces, MAX_MIRRORS, Seen, n_paths};
use crate::error::SimError;
use crate::facets::{FacetJob, facet_sources};
use crate::gridding::{Kernel, grid_cells};
use crate::groups::{Band, Grouping};
use crate::link::Link;
use crate::motion::{
    N_KEYS, RangeScale, Segment, Source, chirp_time_s, max_slope, parabola, quartic,
};
use crate::noise::NoiseGenerator;
use crate::scatter::{FacetPhases, Reflection};
use crate::scene::{Noise, PointTarget, Scene};
use crate::slow_time::Level;
use crate::spread::{ChannelBlock, Reach, SpreadJob, spread};
use crate::still::{Still, StillKey};
use crate::transform::{RangeTransform, TransformJob, sample_cells, transform};
use crate::visibility::{
    DepthRaster, Sampling, ScreenTransmission, SurfaceRange, View, leave_out_beyond_range,
};
use crate::weather::{Rain, Weather};
use radarllm_simd::{Cell, LANES, SimdLevel};

/// Simulation options that are independent of the radar.
#[derive(Clone, Debug, PartialEq)]
pub struct SimOptions {
    /// Square root of the number of depth raster samples, 16..=4096.
    pub raster_size: usize,
    /// Distribution of the depth raster samples.
    pub sampling: Sampling,
    /// Maximum number of surfaces on a path, 1..=4. With 1, reflections between surfaces are not simulated.
    pub max_bounces: usize,
    /// Number of rays along each side of the field that contains mirrors, 16..=4096. Used if `max_bounces` is 2 or
    /// more.
    pub bounce_rays: usize,
    /// Minimum target range, m, at least 0.03. The radar equation is not valid at shorter ranges.
    pub min_range_m: f64,
    /// Rain and smoke.
    pub weather: Weather,
    /// Instruction set; `None` selects the machine's best. Cubes are byte-identical on one level, and equal within
    /// rounding between levels.
    pub simd: Option<SimdLevel>,
}

impl Default for SimOptions {
    fn default() -> Self {
        Self {
            raster_size: 320,
            sampling: Sampling::default(),
            max_bounces: 1,
            bounce_rays: 256,
            min_range_m: 0.05,
            weather: Weather::default(),
            simd: None,
        }
    }
}

/// Statistics of a simulated frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameStats {
    /// Triangles in the scene.
    pub n_facets: usize,
    /// Triangles of zero area, which do not scatter.
    pub n_degenerate: usize,
    /// Triangles visible within the maximum range at the centre of the frame, or of its first segment if the frame has
    /// several.
    pub n_visible: usize,
    /// Visible triangles whose extent in range exceeds half a range bin. They are too coarse for a single delay each.
    pub n_coarse: usize,
    /// Paths over two and more surfaces, over all segments.
    pub n_bounces: usize,
    /// Doppler groups over all segments, of what moves and of the changes of what stands still.
    pub n_groups: usize,
    /// Facet evaluations in slow time of the same. A direct method needs 384 per facet with the reference radar.
    pub n_nodes: usize,
    /// Mean |signal|^2 per sample, W.
    pub signal_power_w: f64,
    /// Noise power per sample, W.
    pub noise_power_w: f64,
    /// Wall time by stage. This is the only field that differs from run to run.
    pub seconds: StageSeconds,
}

/// Wall time by stage, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageSeconds {
    /// `MovingSurface::positions_at` and checks.
    pub positions: f64,
    /// Depth raster.
    pub visibility: f64,
    /// Polynomials and sorting.
    pub sources: f64,
    /// Range grids.
    pub spread: f64,
    /// FFTs and noise.
    pub transform: f64,
}

impl StageSeconds {
    fn add(&mut self, more: &Self) {
        self.positions += more.positions;
        self.visibility += more.visibility;
        self.sources += more.sources;
        self.spread += more.spread;
        self.transform += more.transform;
    }
}

/// A simulator planned for a radar. Create one per thread and call it for every frame.
///
/// # Example
/// The received power of a point target is that of the radar equation:
/// ```
/// use glam::{DVec3, Vec3};
/// use radarllm_base::RadarConfig;
/// use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator, link::Link};
///
/// let target = PointTarget::at(DVec3::new(0.3, 4.0, 0.1), 1.0);
/// let scene = Scene { surfaces: vec![], points: vec![target], noise: Noise::Off };
/// let radar = RadarConfig::awr1843boost();
/// let mut simulator = Simulator::new(&radar, SimOptions::default())?;
/// let mut cube = simulator.new_cube();
/// let stats = simulator.simulate_frame(&scene, 0, 0.0, 1, &mut cube)?;
///
/// let link = Link::new(&radar);
/// let amplitude = link.amplitude(target.position_m.as_vec3() - link.array_centre_m.as_vec3());
/// let expected_w = f64::from(amplitude * amplitude);
/// assert!((stats.signal_power_w / expected_w - 1.0).abs() < 0.01);
/// # Ok::<(), radarllm_radar_sim::SimError>(())
/// ```
pub struct Simulator {
    config: RadarConfig,
    options: SimOptions,
    link: Link,
    simd: SimdLevel,
    scale: RangeScale,
    segments: Vec<Segment>,
    /// A single loop, for what stands still.
    one_loop: Segment,
    /// Levels of all segments except the last, of the last, which may be shorter, and of `one_loop`.
    levels: [Vec<Level>; 3],
    kernel: Kernel,
    channels: Vec<ChannelBlock>,
    reach: Reach,
    raster: DepthRaster,
    rain: Option<Rain>,
    range_transform: RangeTransform,
    work: Workspace,
    /// What the surfaces of the last frame that stand still return.
    still: Option<Still>,
    /// For binary phase modulation: a simulator with exchanged transmitters, and its cube.
    exchanged: Option<Box<(Simulator, RadarCube)>>,
}

/// Index of the levels of a single loop in [`Simulator::levels`].
const ONE_LOOP: usize = 2;

/// Output of [`Simulator::write_samples`].
struct Samples<'a> {
    /// Cells that the groups use.
    first_cell: i32,
    n_cells: usize,
    /// Samples of every block of channels that are added to every loop.
    constant: Option<&'a [Vec<Cell>]>,
    /// State of the noise generator and rms of the noise.
    noise: Option<(&'a mut [[u32; 16]; 4], f32)>,
    /// `[loop][channel][sample]`.
    samples: &'a mut [Complex32],
    /// Receives the sum of |signal|^2, noise not included.
    energy: &'a mut f64,
}

/// Paths over several surfaces in a segment.
struct Bounces {
    surfaces: BouncingSurfaces,
    /// What the others change of the paths among surfaces that stand still.
    still_changes: Vec<Bounce>,
    moving: Vec<Bounce>,
}

/// Buffers that keep their capacity from frame to frame.
#[derive(Default)]
struct Workspace {
    triangles: Vec<[u32; 3]>,
    keys: [Vec<Vec3>; N_KEYS],
    surface_ranges: Vec<SurfaceRange>,
    coverage: Vec<f32>,
    transmission: ScreenTransmission,
    drops: Vec<PointTarget>,
    visible: Vec<u32>,
    sources: Vec<Source>,
    /// Sum of the sources' powers at the segment's centre.
    power_w: f64,
    tx_rows: Vec<[Vec3; N_KEYS]>,
    grouping: Grouping,
    group_grid: Vec<Cell>,
    family_grid: Vec<Cell>,
    grid: Vec<Cell>,
}

impl Workspace {
    /// Lists the visible facets of a surface, counted from its first.
    fn choose_visible(&mut self, surface_idx: usize) {
        let coverage = &self.coverage[self.facets(surface_idx)];
        self.visible.clear();
        let visible = (0..coverage.len()).filter(|&i| coverage[i] > 0.0);
        self.visible.extend(visible.map(|i| i as u32));
    }

    /// Facets of a surface.
    fn facets(&self, surface_idx: usize) -> Range<usize> {
        let facets = &self.surface_ranges[surface_idx].facets;
        facets.start as usize..facets.end as usize
    }

    fn seen(&self) -> Seen<'_> {
        Seen {
            positions: &self.keys[N_KEYS / 2],
            triangles: &self.triangles,
            coverage: &self.coverage,
            transmission: &self.transmission,
        }
    }

    /// Amplitude below which an error of any source of the segment is acceptable: such errors add up like noise 70 dB
    /// below the sources' sum.
    fn negligible(&self) -> f32 {
        (3e-4 * (self.power_w / self.sources.len().max(1) as f64).sqrt()) as f32
    }
}

/// Seed of a frame's receiver noise.
fn noise_seed(seed: u64, frame_idx: u64) -> u64 {
    derive_seed(seed, "receiver noise").wrapping_add(frame_idx.wrapping_mul(0xd6e8_feb8_6659_fd93))
}

impl Simulator {
    /// Plans `config`.
    ///
    /// # Errors
    /// Returns an error for an invalid radar or option.
    pub fn new(config: &RadarConfig, options: SimOptions) -> Result<Self, SimError> {
        config.validate()?;
        let range_error = |option, problem| Err(SimError::Option { option, problem });
        if !(16..=4096).contains(&options.raster_size) {
            return range_error(
                "raster_size",
                format!("{} is not in 16..=4096", options.raster_size),
            );
        }
        if !(0.03..=100.0).contains(&options.min_range_m) {
            return range_error(
                "min_range_m",
                format!("{} m is not in 0.03..=100", options.min_range_m),
            );
        }
        if !(1..=MAX_MIRRORS + 1).contains(&options.max_bounces) {
            return range_error(
                "max_bounces",
                format!("{} is not in 1..={}", options.max_bounces, MAX_MIRRORS + 1),
            );
        }
        if !(16..=4096).contains(&options.bounce_rays) {
            return range_error(
                "bounce_rays",
                format!("{} is not in 16..=4096", options.bounce_rays),
            );
        }
        let simd = options.simd.unwrap_or_else(SimdLevel::detect);
        options.weather.validate()?;
        let exchanged = match config.multiplexing {
            TxMultiplexing::Tdm => None,
            TxMultiplexing::Bpm => {
                let mut other = RadarConfig {
                    multiplexing: TxMultiplexing::Tdm,
                    ..config.clone()
                };
                other.tx.reverse();
                let other = Self::new(&other, options.clone())?;
                let cube = other.new_cube();
                Some(Box::new((other, cube)))
            }
        };
        let link = Link::new(config).in_weather(&options.weather);
        let n_cells = grid_cells(config.n_samples);
        let kernel = Kernel::new(n_cells as f64 / config.n_samples as f64);
        let channels = ChannelBlock::all(config, link.array_centre_m);
        let segments = Segment::all(config);
        let one_loop = Segment::of_one_loop(config);
        let loop_counts = [segments.first(), segments.last(), Some(&one_loop)]
            .map(|s| s.map_or(1, |s| s.n_loops));
        Ok(Self {
            scale: RangeScale {
                centre_hz: link.centre_hz,
                slope_hz_per_s: config.slope_hz_per_s,
                cells_per_s: n_cells as f64 * config.slope_hz_per_s / config.sample_rate_hz,
                n_cells,
                // Set for each segment, which has its own unit of time.
                advance_u: 0.0,
            },
            segments,
            one_loop,
            levels: loop_counts.map(|n| Level::all(n, config.loop_period_s())),
            reach: Reach::of(&channels),
            channels,
            rain: Rain::new(&options, config, &link),
            raster: DepthRaster::new(options.raster_size, options.sampling),
            range_transform: RangeTransform::new(simd, config.n_samples, n_cells, &kernel),
            kernel,
            simd,
            link,
            options,
            config: config.clone(),
            work: Workspace::default(),
            still: None,
            exchanged,
        })
    }

    /// The radar.
    pub fn config(&self) -> &RadarConfig {
        &self.config
    }

    /// A cube of the radar's shape, for [`Self::simulate_frame`].
    pub fn new_cube(&self) -> RadarCube {
        let c = &self.config;
        RadarCube::zeros(c.n_loops, c.tx.len(), c.rx.len(), c.n_samples)
    }

    /// Simulates the frame that starts at `time_s` into `cube`, which is overwritten. Its `time_s` is set to that of
    /// the frame.
    ///
    /// `seed` determines the phases of the facets and, together with `frame_idx`, the noise. Use one seed per clip. The
    /// same arguments give the same bytes on one [`SimdLevel`].
    ///
    /// # Errors
    /// Returns an error for anything in the scene that cannot be simulated. The content of the cube is then
    /// unspecified.
    pub fn simulate_frame(
        &mut self,
        scene: &Scene<'_>,
        frame_idx: u64,
        time_s: f64,
        seed: u64,
        cube: &mut RadarCube,
    ) -> Result<FrameStats, SimError> {
        match self.exchanged.take() {
            None => self.simulate_slots(scene, frame_idx, time_s, seed, cube),
            Some(mut other) => {
                let stats = self.simulate_bpm(&mut other, scene, frame_idx, time_s, seed, cube);
                self.exchanged = Some(other);
                stats
            }
        }
    }

    /// Simulates binary phase modulation, in which both transmitters transmit in both slots. Every slot is a weighted
    /// sum of two cubes with one transmitter per slot: one in the normal order of transmitters, one in the exchanged
    /// order.
    fn simulate_bpm(
        &mut self,
        (exchanged, other): &mut (Simulator, RadarCube),
        scene: &Scene<'_>,
        frame_idx: u64,
        time_s: f64,
        seed: u64,
        cube: &mut RadarCube,
    ) -> Result<FrameStats, SimError> {
        let quiet = Scene {
            surfaces: scene.surfaces.clone(),
            points: scene.points.clone(),
            noise: Noise::Off,
        };
        let mut stats = self.simulate_slots(&quiet, frame_idx, time_s, seed, cube)?;
        exchanged.simulate_slots(&quiet, frame_idx, time_s, seed, other)?;
        let slot_len = cube.n_rx * cube.n_samples;
        let mut energy = 0.0;
        for (chirp, (mine, theirs)) in cube
            .data
            .chunks_exact_mut(slot_len)
            .zip(other.data.chunks_exact(slot_len))
            .enumerate()
        {
            let slot = chirp % 2;
            let weight = |tx_idx| self.config.tx_weight(slot, tx_idx) as f32;
            // In the first cube, slot i has transmitter i. In the exchanged cube, it has the other one.
            let (own, changed) = (weight(slot), weight(1 - slot));
            for (a, b) in mine.iter_mut().zip(theirs) {
                *a = *a * own + b * changed;
                energy += f64::from(a.norm_sqr());
            }
        }
        stats.signal_power_w = energy / cube.data.len() as f64;
        stats.noise_power_w = match scene.noise {
            Noise::Thermal => self.link.noise_w,
            Noise::Off => 0.0,
            Noise::SnrDb(snr_db) => stats.signal_power_w * 10_f64.powf(-snr_db / 10.0),
        };
        if stats.noise_power_w > 0.0 {
            NoiseGenerator::new(noise_seed(seed, frame_idx), self.simd)
                .add(&mut cube.data, stats.noise_power_w.sqrt() as f32);
        }
        Ok(stats)
    }

    fn simulate_slots(
        &mut self,
        scene: &Scene<'_>,
        frame_idx: u64,
        time_s: f64,
        seed: u64,
        cube: &mut RadarCube,
    ) -> Result<FrameStats, SimError> {
        check_frame(&self.config, scene, time_s, cube)?;
        cube.time_s = time_s;
        let mut stats = FrameStats {
            n_facets: scene.n_facets(),
            ..Default::default()
        };
        let mut noise = NoiseGenerator::new(noise_seed(seed, frame_idx), self.simd);
        let thermal_rms = match scene.noise {
            Noise::Thermal => Some(self.link.noise_w.sqrt() as f32),
            Noise::SnrDb(_) | Noise::Off => None,
        };
        scene.concatenate_triangles(&mut self.work.triangles);
        scene.surface_ranges(&mut self.work.surface_ranges);
        if let Some(rain) = &self.rain {
            rain.draw(seed, time_s, &mut self.work.drops);
        }
        let loop_len = cube.n_tx * cube.n_rx * cube.n_samples;
        let mut energy = 0.0;
        let mut still = None;
        for i in 0..self.segments.len() {
            let segment = self.segments[i];
            let clock = Instant::now();
            scene.positions_at_times(
                segment.key_times_s().map(|key_s| time_s + key_s),
                self.link.array_centre_m.as_vec3(),
                self.options.min_range_m,
                &mut self.work.keys,
            )?;
            stats.seconds.positions += clock.elapsed().as_secs_f64();

            if i == 0 {
                still = self.still_surfaces(scene, seed, &mut stats.seconds)?;
            }
            let clock = Instant::now();
            let work = &mut self.work;
            let view = View {
                positions: &work.keys[N_KEYS / 2],
                triangles: &work.triangles,
                surfaces: &work.surface_ranges,
                centre: self.link.array_centre_m.as_vec3(),
            };
            self.raster
                .coverage(view, &mut work.coverage, &mut work.transmission);
            leave_out_beyond_range(view, self.link.max_range_m, &mut work.coverage);
            stats.seconds.visibility += clock.elapsed().as_secs_f64();

            let clock = Instant::now();
            let count = i == 0;
            let bounces = self.trace_bounces(scene, seed, still.as_ref(), &mut stats);
            stats.seconds.sources += clock.elapsed().as_secs_f64();
            let constant = still.as_ref().map(|still| {
                self.still_samples(scene, seed, still, bounces.as_ref(), count, &mut stats)
            });

            let clock = Instant::now();
            self.set_unit_of_time(&segment);
            self.clear_sources();
            self.add_moving_surfaces(scene, seed, still.as_ref(), count, &mut stats);
            if let Some(bounces) = &bounces {
                self.add_bounces(&bounces.surfaces, &bounces.moving, false);
            }
            self.add_points(scene, &segment, time_s)?;
            self.check_speeds()?;
            let levels = usize::from(i + 1 == self.segments.len());
            let (first_cell, n_cells) = self.group_sources(&segment, levels, &mut stats);
            stats.seconds.sources += clock.elapsed().as_secs_f64();

            let from = segment.first_loop * loop_len;
            let out = Samples {
                first_cell,
                n_cells,
                constant: constant.as_deref(),
                noise: thermal_rms.map(|rms| (&mut noise.state, rms)),
                samples: &mut cube.data[from..from + segment.n_loops * loop_len],
                energy: &mut energy,
            };
            self.write_samples(&segment, levels, out, &mut stats.seconds);
        }
        self.still = still;
        stats.signal_power_w = energy / cube.data.len() as f64;
        stats.noise_power_w = match scene.noise {
            Noise::Thermal => self.link.noise_w,
            Noise::Off => 0.0,
            Noise::SnrDb(snr_db) => {
                let clock = Instant::now();
                let power_w = stats.signal_power_w * 10_f64.powf(-snr_db / 10.0);
                noise.add(&mut cube.data, power_w.sqrt() as f32);
                stats.seconds.transform += clock.elapsed().as_secs_f64();
                power_w
            }
        };
        Ok(stats)
    }

    /// Takes what is kept of the surfaces that stand still, or computes it if they are others than in the last frame. `None` if
    /// there are none.
    fn still_surfaces(
        &mut self,
        scene: &Scene<'_>,
        seed: u64,
        seconds: &mut StageSeconds,
    ) -> Result<Option<Still>, SimError> {
        let positions = &self.work.keys[N_KEYS / 2];
        let triangles = &self.work.triangles;
        if let Some(still) = self.still.take()
            && still.key.is_of(scene, triangles, positions, seed)
        {
            return Ok(Some(still));
        }
        let Some(key) = StillKey::new(scene, triangles, positions, seed) else {
            return Ok(None);
        };
        let clock = Instant::now();
        let surfaces: Vec<_> = (self.work.surface_ranges.iter().zip(&key.still))
            .filter(|(_, still)| **still)
            .map(|(surface, _)| surface.clone())
            .collect();
        let view = View {
            positions,
            triangles,
            surfaces: &surfaces,
            centre: self.link.array_centre_m.as_vec3(),
        };
        let work = (&mut self.work.coverage, &mut self.work.transmission);
        self.raster.coverage(view, work.0, work.1);
        leave_out_beyond_range(view, self.link.max_range_m, &mut self.work.coverage);
        seconds.visibility += clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let one_loop = self.one_loop;
        self.set_unit_of_time(&one_loop);
        self.clear_sources();
        let mut stats = FrameStats::default();
        for (surface_idx, _) in key.still.iter().enumerate().filter(|(_, still)| **still) {
            self.work.choose_visible(surface_idx);
            stats.n_coarse += self.add_facets(scene, seed, surface_idx, None);
        }
        let mut paths = None;
        if self.options.max_bounces > 1 {
            let surfaces = BouncingSurfaces::new(scene, &self.link, seed);
            let seen = self.work.seen();
            let traced = surfaces.trace_still(&self.options, &self.link, seen, &key.still);
            if let Some((kept, bounces)) = traced {
                self.add_bounces(&surfaces, &bounces, true);
                stats.n_bounces = n_paths(&bounces);
                paths = Some(kept);
            }
        }
        seconds.sources += clock.elapsed().as_secs_f64();
        let samples = self.one_loop_samples(&mut stats);
        seconds.add(&stats.seconds);
        Ok(Some(Still {
            key,
            coverage: self.work.coverage.clone(),
            transmission: self.work.transmission.clone(),
            paths,
            n_bounces: stats.n_bounces,
            n_coarse: stats.n_coarse,
            samples,
        }))
    }

    /// Samples of the surfaces that stand still with what the others change of them, of every block of channels.
    fn still_samples(
        &mut self,
        scene: &Scene<'_>,
        seed: u64,
        still: &Still,
        bounces: Option<&Bounces>,
        count: bool,
        stats: &mut FrameStats,
    ) -> Vec<Vec<Cell>> {
        let clock = Instant::now();
        let one_loop = self.one_loop;
        self.set_unit_of_time(&one_loop);
        self.clear_sources();
        let (mut n_coarse, mut n_less_coarse) = (still.n_coarse, 0);
        let all_still = still.key.still.iter().enumerate();
        for (surface_idx, _) in all_still.filter(|(_, still)| **still) {
            let mine = self.work.facets(surface_idx);
            for taken in [Some(still), None] {
                let work = &mut self.work;
                let changed = still.changed(&work.coverage, &work.transmission, mine.clone());
                let coverage = taken.map_or(&work.coverage, |still| &still.coverage);
                work.visible.clear();
                work.visible
                    .extend(changed.filter(|&i| coverage[mine.start + i as usize] > 0.0));
                let n = self.add_facets(scene, seed, surface_idx, taken);
                match taken {
                    Some(_) => n_less_coarse += n,
                    None => n_coarse += n,
                }
            }
        }
        if count {
            stats.n_coarse += n_coarse - n_less_coarse;
        }
        if let Some(bounces) = bounces {
            self.add_bounces(&bounces.surfaces, &bounces.still_changes, true);
        }
        stats.seconds.sources += clock.elapsed().as_secs_f64();
        let mut samples = still.samples.clone();
        if !self.work.sources.is_empty() {
            let changes = self.one_loop_samples(stats);
            for (sum, change) in samples.iter_mut().flatten().zip(changes.iter().flatten()) {
                for lane in 0..LANES {
                    sum.re[lane] += change.re[lane];
                    sum.im[lane] += change.im[lane];
                }
            }
        }
        samples
    }

    /// Samples of one loop of the sources, of every block of channels.
    fn one_loop_samples(&mut self, stats: &mut FrameStats) -> Vec<Vec<Cell>> {
        let clock = Instant::now();
        let segment = self.one_loop;
        let (first_cell, n_cells) = self.group_sources(&segment, ONE_LOOP, stats);
        stats.seconds.sources += clock.elapsed().as_secs_f64();
        let n_samples = self.config.n_samples;
        let n_channels = self.config.tx.len() * self.config.rx.len();
        let mut samples = vec![Complex32::ZERO; n_channels * n_samples];
        let out = Samples {
            first_cell,
            n_cells,
            constant: None,
            noise: None,
            samples: &mut samples,
            energy: &mut 0.0,
        };
        self.write_samples(&segment, ONE_LOOP, out, &mut stats.seconds);
        let of_block = |block: &ChannelBlock| {
            let rows = block.first * n_samples..(block.first + block.len) * n_samples;
            sample_cells(&samples[rows], n_samples)
        };
        self.channels.iter().map(of_block).collect()
    }

    fn set_unit_of_time(&mut self, segment: &Segment) {
        self.scale.advance_u = self.scale.centre_hz / (self.scale.slope_hz_per_s * segment.half_s);
    }

    /// Writes the samples of a segment from its groups of sources.
    fn write_samples(
        &mut self,
        segment: &Segment,
        levels: usize,
        mut out: Samples<'_>,
        seconds: &mut StageSeconds,
    ) {
        let first_chirp_s = chirp_time_s(&self.config, segment.first_loop, 0);
        let u_first = segment.unit_time(first_chirp_s, 0.0);
        let u_per_loop = segment.unit_time(first_chirp_s, 1.0) - u_first;
        let n_channels = self.config.tx.len() * self.config.rx.len();
        for (block, channels) in self.channels.iter().enumerate() {
            let clock = Instant::now();
            spread(
                self.simd,
                SpreadJob {
                    sources: &self.work.sources,
                    negligible: self.work.negligible(),
                    tx_rows: &self.work.tx_rows,
                    order: &self.work.grouping.order,
                    groups: &self.work.grouping.groups,
                    families: &self.work.grouping.families,
                    levels: &self.levels[levels],
                    channels,
                    kernel: &self.kernel,
                    cells_per_turn: (self.scale.cells_per_s / self.scale.centre_hz) as f32,
                    half_s: segment.half_s,
                    u_first,
                    u_per_loop,
                    n_loops: segment.n_loops,
                    grid: &mut self.work.group_grid,
                    family_grid: &mut self.work.family_grid,
                    out: &mut self.work.grid,
                    first_cell: out.first_cell,
                    n_cells: out.n_cells,
                },
            );
            seconds.spread += clock.elapsed().as_secs_f64();

            let clock = Instant::now();
            transform(
                self.simd,
                TransformJob {
                    transform: &mut self.range_transform,
                    channels,
                    grid: &self.work.grid,
                    first_cell: out.first_cell,
                    n_cells: out.n_cells,
                    constant: out.constant.map(|blocks| &blocks[block][..]),
                    out: out.samples,
                    n_channels,
                    noise: out.noise.as_mut().map(|(state, rms)| (&mut **state, *rms)),
                    energy: out.energy,
                },
            );
            seconds.transform += clock.elapsed().as_secs_f64();
        }
    }

    fn clear_sources(&mut self) {
        self.work.sources.clear();
        self.work.power_w = 0.0;
        self.work.tx_rows.clear();
    }

    /// Traces the paths over several surfaces. `None` if they are not simulated.
    fn trace_bounces(
        &self,
        scene: &Scene<'_>,
        seed: u64,
        still: Option<&Still>,
        stats: &mut FrameStats,
    ) -> Option<Bounces> {
        if self.options.max_bounces < 2 || scene.surfaces.is_empty() {
            return None;
        }
        let surfaces = BouncingSurfaces::new(scene, &self.link, seed);
        let (options, link, seen) = (&self.options, &self.link, self.work.seen());
        let (still_changes, moving) = match still.and_then(|still| Some((still, still.base()?))) {
            Some((still, base)) => {
                let changes = surfaces.trace_changes(options, link, seen, &still.key.still, &base);
                stats.n_bounces += changes.n_bounces;
                (changes.of_still, changes.moving)
            }
            None => {
                let bounces = surfaces.trace(options, link, seen);
                stats.n_bounces += n_paths(&bounces);
                (Vec::new(), bounces)
            }
        };
        Some(Bounces {
            surfaces,
            still_changes,
            moving,
        })
    }

    /// Appends the visible facets of the surfaces that do not stand still.
    fn add_moving_surfaces(
        &mut self,
        scene: &Scene<'_>,
        seed: u64,
        still: Option<&Still>,
        count: bool,
        stats: &mut FrameStats,
    ) {
        for surface_idx in 0..scene.surfaces.len() {
            let mine = self.work.facets(surface_idx);
            if still.is_none_or(|still| !still.key.still[surface_idx]) {
                self.work.choose_visible(surface_idx);
                let n_coarse = self.add_facets(scene, seed, surface_idx, None);
                stats.n_coarse += if count { n_coarse } else { 0 };
            }
            if count {
                let work = &self.work;
                let middle = &work.keys[N_KEYS / 2];
                let coverage = &work.coverage[mine.clone()];
                for (&[a, b, c], &share) in work.triangles[mine.clone()].iter().zip(coverage) {
                    // A visible facet has an area, so that only the others need the check.
                    if share > 0.0 {
                        stats.n_visible += 1;
                    } else {
                        let a = middle[a as usize];
                        let normal = (middle[b as usize] - a).cross(middle[c as usize] - a);
                        stats.n_degenerate += usize::from(normal == Vec3::ZERO);
                    }
                }
            }
        }
    }

    /// Appends point targets and drops of rain.
    fn add_points(
        &mut self,
        scene: &Scene<'_>,
        segment: &Segment,
        time_s: f64,
    ) -> Result<(), SimError> {
        let centre = self.link.array_centre_m;
        let work = &mut self.work;
        for (index, point) in scene.points.iter().chain(&work.drops).enumerate() {
            let key_times_s = segment.key_times_s().map(|t| time_s + t);
            let from_centre = key_times_s.map(|t| point.position_at(t) - centre);
            for (p, time_s) in from_centre.iter().zip(key_times_s) {
                let range_m = p.length();
                if range_m < self.options.min_range_m {
                    return Err(SimError::TooClose {
                        what: "point target",
                        index,
                        range_m,
                        min_range_m: self.options.min_range_m,
                        time_s,
                    });
                }
            }
            let range_m = |key: usize| from_centre[key].length();
            let change_m = (range_m(N_KEYS - 1) - range_m(0)).abs();
            let max_m = self.link.max_range_m;
            // A jump is no echo from afar; it is refused with the other sources.
            if range_m(N_KEYS / 2) > max_m && change_m < 0.5 * max_m {
                continue;
            }
            let mut source = self.scale.source(from_centre);
            let size_m = point.rcs_m2.sqrt() as f32;
            source.rough =
                parabola([0, 2, 4].map(|k| size_m * self.link.amplitude(source.from_centre[k])));
            source.bound_change(0.0);
            work.power_w += source.power_w();
            work.sources.push(source);
        }
        Ok(())
    }

    /// Refuses sources whose range changes too fast.
    fn check_speeds(&self) -> Result<(), SimError> {
        // A range change of half the unambiguous range within a frame is treated as a jump, not as motion.
        let limit_cells = 0.5 * self.scale.n_cells as f32;
        for source in &self.work.sources {
            let (low, high) = source.cell_range(2.0);
            let change = high - low;
            // NaN counts as too fast.
            if change.is_nan() || change >= limit_cells {
                let m_per_cell = self.config.max_range_m() / self.scale.n_cells as f64;
                return Err(SimError::TooFast {
                    change_m: f64::from(change) * m_per_cell,
                    limit_m: f64::from(limit_cells) * m_per_cell,
                });
            }
        }
        Ok(())
    }

    /// Appends the facets of a surface that `work.visible` lists; returns how many of them are too coarse. With `taken`, they
    /// are appended as they are kept there, with negative amplitude.
    fn add_facets(
        &mut self,
        scene: &Scene<'_>,
        seed: u64,
        surface_idx: usize,
        taken: Option<&Still>,
    ) -> usize {
        let work = &mut self.work;
        let surface = &scene.surfaces[surface_idx];
        let mine = work.facets(surface_idx);
        let (coverage, transmission) = match taken {
            Some(still) => (&still.coverage, &still.transmission),
            None => (&work.coverage, &work.transmission),
        };
        let n_before = work.sources.len();
        let mut n_coarse = 0;
        facet_sources(
            self.simd,
            FacetJob {
                link: &self.link,
                scale: &self.scale,
                reflection: &Reflection::new(surface.material(), self.link.wavelength_m),
                phases: &FacetPhases::new(seed, surface_idx),
                keys: &work.keys,
                triangles: &work.triangles[mine.clone()],
                coverage: &coverage[mine.clone()],
                transmission,
                first_facet: mine.start,
                visible: &work.visible,
                out: &mut work.sources,
                coarse_m: 0.5 * self.config.range_resolution_m(),
                n_coarse: &mut n_coarse,
                power_w: &mut work.power_w,
            },
        );
        if taken.is_some() {
            for source in &mut work.sources[n_before..] {
                source.coherent = source.coherent.map(|c| -c);
                source.rough = source.rough.map(|c| -c);
            }
        }
        n_coarse
    }

    /// Appends paths over several surfaces, which may all stand still.
    fn add_bounces(&mut self, surfaces: &BouncingSurfaces, bounces: &[Bounce], are_still: bool) {
        let work = &mut self.work;
        for bounce in bounces {
            let at =
                |key: usize| surfaces.states(bounce, &self.link, &work.keys[key], &work.triangles);
            let keys: [_; N_KEYS] = if are_still {
                [at(0); N_KEYS]
            } else {
                std::array::from_fn(at)
            };
            for path in bounce.paths() {
                let states = keys.map(|paths| paths[path]);
                let (tx, rx) = (states.map(|s| s.seen_by_tx), states.map(|s| s.seen_by_rx));
                let mut source = self.scale.source_between(&tx, &rx);
                source.tx_row = Some(work.tx_rows.len() as u32);
                work.tx_rows.push(tx.map(|p| p.as_vec3()));
                source.corners = std::array::from_fn(|corner| {
                    let turns = states.map(|s| s.corner_path_m[corner] / self.link.wavelength_m);
                    quartic(turns).map(|c| c as f32)
                });
                source.corner_turns_per_u = source
                    .corners
                    .map(max_slope)
                    .into_iter()
                    .fold(0.0, f32::max);
                source.coherent = parabola([0, 2, 4].map(|key| states[key].coherent));
                source.rough = parabola([0, 2, 4].map(|key| states[key].rough));
                let phasor = surfaces.phasor(bounce.facet);
                source.rough_phasor = [phasor.re, phasor.im];
                // The divided difference is at most 1/2.
                source.bound_change(std::f32::consts::PI * source.corner_turns_per_u);
                work.power_w += source.power_w();
                work.sources.push(source);
            }
        }
    }

    /// Assigns the sources to Doppler groups. Returns the first cell and the number of cells that they use.
    fn group_sources(
        &mut self,
        segment: &Segment,
        levels: usize,
        stats: &mut FrameStats,
    ) -> (i32, usize) {
        let work = &mut self.work;
        let levels = &self.levels[levels];
        // Over the sweep, the frequency of a source varies by up to half the relative bandwidth (range migration).
        let sweep = (0.5 * self.config.sampled_bandwidth_hz() / self.link.centre_hz) as f32;
        let half_s = segment.half_s as f32;
        let cells_per_turn = (self.scale.cells_per_s / self.scale.centre_hz) as f32;
        work.grouping.bands.clear();
        for source in &mut work.sources {
            let (frequency, ramp) = (source.turns[1] as f32, 2.0 * source.turns[2] as f32);
            let own = source.rest_turns_per_u();
            let of_channels = self.reach.extra_band(source, ramp, half_s);
            let reach = self
                .reach
                .cells(source, &work.tx_rows, cells_per_turn, half_s);
            source.reach_cells = reach;
            source.is_flat =
                source.tx_row.is_none() && self.reach.max_bend_turns(source) < MAX_BEND_TURNS;
            let (low, high) = source.cell_range(1.0);
            work.grouping.bands.push(Band {
                frequency,
                ramp,
                rest: own + of_channels + sweep * (frequency.abs() + ramp.abs() + own),
                cells: [low - reach, high + reach],
                is_bounce: source.tx_row.is_some(),
            });
        }
        work.grouping.group(levels, segment.half_s, segment.n_loops);
        let groups = &work.grouping.groups;
        for group in groups {
            let n_sources = group.end - group.first;
            stats.n_nodes += n_sources * levels[group.grid.level].n_nodes(segment.n_loops);
        }
        stats.n_groups += groups.len();
        let grids = groups.iter().map(|g| g.grid);
        let lowest = grids.clone().map(|g| g.first_cell).min();
        let highest = grids.map(|g| g.first_cell + g.n_cells as i32).max();
        match (lowest, highest) {
            (Some(lowest), Some(highest)) => (lowest, (highest - lowest) as usize),
            _ => (0, 0),
        }
    }
}

/// Maximum change of the wavefront curvature that is neglected, turns.
const MAX_BEND_TURNS: f32 = 2e-4;

/// Checks the arguments of a frame.
pub(crate) fn check_frame(
    config: &RadarConfig,
    scene: &Scene<'_>,
    time_s: f64,
    cube: &RadarCube,
) -> Result<(), SimError> {
    if !(time_s.is_finite() && time_s.abs() < 1e9) {
        return Err(SimError::Time { time_s });
    }
    let expected = [
        config.n_loops,
        config.tx.len(),
        config.rx.len(),
        config.n_samples,
    ];
    let found = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
    let found_len = cube.data.len();
    if expected != found || found_len != expected.iter().product::<usize>() {
        return Err(SimError::CubeShape {
            expected,
            found,
            found_len,
        });
    }
    scene.validate()
}
