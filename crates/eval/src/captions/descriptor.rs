//! A fixed vector per clip that needs no training: what the nearest-neighbour baseline compares clips by.

use radarllm_base::PointFrame;

/// Parts into which a clip's time is cut.
const N_PARTS: usize = 8;
/// Upper edges of the height bins above the floor, m: feet and lying, knees, hips, chest, head.
const HEIGHT_EDGES_M: [f32; 4] = [0.4, 0.8, 1.2, 1.6];
/// Edges of the radial velocity bins, m/s: fast and slow approach, still, slow and fast recession.
const VELOCITY_EDGES_MPS: [f32; 4] = [-0.8, -0.2, 0.2, 0.8];
const N_HEIGHTS: usize = HEIGHT_EDGES_M.len() + 1;
const N_VELOCITIES: usize = VELOCITY_EDGES_MPS.len() + 1;
/// Histogram, 5 weighted means (range, x, height, velocity, speed), 4 spreads, log point count.
const PART_DIM: usize = N_HEIGHTS * N_VELOCITIES + 5 + 4 + 1;

/// Numbers of a step of [`steps`].
pub const STEP_DIM: usize = PART_DIM;

/// Length of [`descriptor`]'s result.
pub const DESCRIPTOR_DIM: usize = N_PARTS * PART_DIM + 1 + 4;

/// Describes a clip by its points.
///
/// Per eighth of its time: the share of points per (height, radial velocity) cell; intensity-
/// weighted means of range, x and height above the floor (m), velocity and speed (m/s); weighted
/// standard deviations of x, range, height and velocity; ln(1 + points per frame). Then duration
/// (s) and the displacement of the weighted centre from the first to the last eighth that has
/// points: x, y, height (m) and its length.
///
/// Weights are linear amplitudes 10^(dB/20) relative to the strongest point, so that one flash
/// does not decide alone. Parts without points are zero. Values are finite for finite input.
pub fn descriptor(frames: &[PointFrame], radar_height_m: f32) -> Vec<f32> {
    let mut out = Vec::with_capacity(DESCRIPTOR_DIM);
    let (start_s, end_s) = match (frames.first(), frames.last()) {
        (Some(first), Some(last)) => (first.time_s, last.time_s),
        _ => (0.0, 0.0),
    };
    // The last frame also lasts one period.
    let n = frames.len().max(1) as f64;
    let duration_s = if frames.len() > 1 {
        (end_s - start_s) * n / (n - 1.0)
    } else {
        0.0
    };

    let mut parts: Vec<Part> = (0..N_PARTS).map(|_| Part::default()).collect();
    let strongest_db = strongest_db(frames);
    for frame in frames {
        let phase = if duration_s > 0.0 {
            (frame.time_s - start_s) / duration_s
        } else {
            0.0
        };
        let part = &mut parts[((phase * N_PARTS as f64) as usize).min(N_PARTS - 1)];
        part.add_frame(frame, radar_height_m, strongest_db);
    }
    for part in &parts {
        part.write(&mut out);
    }
    out.push(duration_s as f32);
    let mut seen = parts.iter().filter(|p| p.n_points > 0).map(Part::centre);
    let first = seen.next();
    let last = seen.next_back().or(first);
    let shift = match (first, last) {
        (Some(a), Some(b)) => std::array::from_fn(|axis| b[axis] - a[axis]),
        _ => [0.0; 3],
    };
    out.extend(shift.map(|v| v as f32));
    out.push(shift.iter().map(|v| v * v).sum::<f64>().sqrt() as f32);
    out
}

/// The [`STEP_DIM`] numbers of [`descriptor`] for every `frames_per_step` frames, the last of which may be fewer.
pub fn steps(
    frames: &[PointFrame],
    radar_height_m: f32,
    frames_per_step: usize,
) -> Vec<[f32; STEP_DIM]> {
    let strongest_db = strongest_db(frames);
    let of_step = |step: &[PointFrame]| {
        let mut part = Part::default();
        for frame in step {
            part.add_frame(frame, radar_height_m, strongest_db);
        }
        let mut numbers = Vec::with_capacity(STEP_DIM);
        part.write(&mut numbers);
        std::array::from_fn(|i| numbers.get(i).copied().unwrap_or_default())
    };
    frames.chunks(frames_per_step.max(1)).map(of_step).collect()
}

fn strongest_db(frames: &[PointFrame]) -> f32 {
    let all = frames
        .iter()
        .flat_map(|f| f.points.iter().map(|p| p.intensity_db));
    all.fold(f32::NEG_INFINITY, f32::max)
}

/// Sums over one part: x, y, height, range, velocity, each weighted.
#[derive(Default)]
struct Part {
    n_frames: usize,
    n_points: usize,
    cells: [[u32; N_VELOCITIES]; N_HEIGHTS],
    weight: f64,
    sums: [f64; 5],
    squares: [f64; 5],
    speed_sum: f64,
}

impl Part {
    fn add_frame(&mut self, frame: &PointFrame, radar_height_m: f32, strongest_db: f32) {
        self.n_frames += 1;
        for p in &frame.points {
            // 60 dB below the strongest weighs a thousandth; weaker points still count a little.
            let weight = 10_f64.powf(f64::from((p.intensity_db - strongest_db).max(-60.0)) / 20.0);
            let height_m = p.z_m + radar_height_m;
            self.add(weight, [p.x_m, p.y_m, height_m, p.range_m, p.velocity_mps]);
        }
    }

    fn add(&mut self, weight: f64, values: [f32; 5]) {
        self.n_points += 1;
        let bin = |edges: &[f32], v: f32| edges.iter().filter(|&&edge| v > edge).count();
        self.cells[bin(&HEIGHT_EDGES_M, values[2])][bin(&VELOCITY_EDGES_MPS, values[4])] += 1;
        self.weight += weight;
        for (i, v) in values.into_iter().enumerate() {
            let v = f64::from(v);
            self.sums[i] += weight * v;
            self.squares[i] += weight * v * v;
        }
        self.speed_sum += weight * f64::from(values[4].abs());
    }

    /// x, y, height, m.
    fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|axis| self.mean(axis))
    }

    fn mean(&self, i: usize) -> f64 {
        if self.weight > 0.0 {
            self.sums[i] / self.weight
        } else {
            0.0
        }
    }

    fn spread(&self, i: usize) -> f64 {
        if self.weight > 0.0 {
            (self.squares[i] / self.weight - self.mean(i).powi(2))
                .max(0.0)
                .sqrt()
        } else {
            0.0
        }
    }

    fn write(&self, out: &mut Vec<f32>) {
        let n = self.n_points.max(1) as f32;
        out.extend(
            self.cells
                .as_flattened()
                .iter()
                .map(|&count| count as f32 / n),
        );
        let speed = if self.weight > 0.0 {
            self.speed_sum / self.weight
        } else {
            0.0
        };
        out.extend(
            [
                self.mean(3),
                self.mean(0),
                self.mean(2),
                self.mean(4),
                speed,
            ]
            .map(|v| v as f32),
        );
        out.extend([0, 3, 2, 4].map(|i| self.spread(i) as f32));
        let per_frame = self.n_points as f64 / self.n_frames.max(1) as f64;
        out.push(per_frame.ln_1p() as f32);
    }
}
