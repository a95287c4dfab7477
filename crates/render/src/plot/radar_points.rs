//! Plots of radar points.

use std::collections::BTreeMap;

use radarllm_base::{BoardTrack, PointFrame, RadarPoint};

use super::{
    axis::Axis,
    colours::ColourMap,
    figure::Aspect,
    scatter_plot::{ScatterPanel, ScatterPlot, Span},
};

/// Minimum end of a velocity axis, m/s, so that the noise of a static scene remains grey.
const MIN_SPEED_MPS: f64 = 0.1;

/// Minimum length of an axis of places over time, m: its ticks would be finer than any radar resolves.
const MIN_EXTENT_M: f64 = 0.5;

/// Margin before and after a recording, as a fraction of its duration.
const TIME_PADDING: f64 = 0.02;

/// Points seen from above (x to the right, y upwards) and from the side (y to the right, z upwards), coloured by radial
/// velocity: blue approaches, red recedes. Points without a finite position are omitted.
///
/// ```
/// use radarllm_base::RadarPoint;
/// use radarllm_render::plot::point_cloud;
///
/// let point = RadarPoint { x_m: 0.2, y_m: 3.0, velocity_mps: -0.7, ..RadarPoint::default() };
/// let svg = point_cloud(&[point], "A hand").to_svg();
/// assert!(svg.contains("Radial velocity (m/s)"));
/// ```
pub fn point_cloud(points: &[RadarPoint], title: &str) -> ScatterPlot {
    let panel = |heading: &str, axes: [usize; 2]| {
        let label = |axis| Axis::new(["x", "y", "z"][axis], "m");
        let placed = points.iter().map(|p| {
            let place_m = [p.x_m, p.y_m, p.z_m];
            let [a, b] = axes.map(|axis| f64::from(place_m[axis]));
            [a, b, f64::from(p.velocity_mps)]
        });
        ScatterPanel {
            heading: heading.into(),
            x: label(axes[0]),
            y: label(axes[1]),
            points: placed.collect(),
            lines: Vec::new(),
            aspect: Aspect::Equal,
        }
    };
    let panels = vec![panel("From above", [0, 1]), panel("From the side", [1, 2])];
    coloured_by_velocity(title, panels)
}

/// Range and x (to the right of the radar) of points over time, coloured as in [`point_cloud`].
pub fn points_over_time(frames: &[PointFrame], title: &str) -> ScatterPlot {
    let mut plot = over_time(frames, title, &[RANGE, ACROSS]);
    plot.panels.iter_mut().for_each(extend);
    plot
}

/// Range, x and z (above the radar) of points over time with what is said of them, coloured as in [`point_cloud`]. Tracks of
/// the board are lines. Leakage of the radar is not drawn, unless there is nothing else; a heading says so then.
pub fn timeline(frames: &[PointFrame], said: Vec<Span>, title: &str) -> ScatterPlot {
    let received = |frame: &PointFrame| {
        let points = frame.points.iter().filter(|p| !p.is_leakage());
        frame.with_points(points.copied().collect())
    };
    let without_leakage: Vec<PointFrame> = frames.iter().map(received).collect();
    let has_points = without_leakage.iter().any(|f| !f.points.is_empty());
    let drawn = if has_points { &without_leakage } else { frames };
    let mut plot = over_time(drawn, title, &[RANGE, ACROSS, UP]);
    for (panel, value) in plot.panels.iter_mut().zip(OF_TRACK) {
        panel.lines = tracks(frames, value);
        extend(panel);
    }
    if !has_points && frames.iter().any(|f| !f.points.is_empty()) {
        plot.panels[0].heading = "Leakage of the radar alone".into();
    }
    ScatterPlot {
        spans: said,
        ..plot
    }
}

/// A coordinate of a track of the board, if it has one.
type OfTrack = fn(&BoardTrack) -> Option<f32>;

/// Range, x and z of a track of the board, in the order of the panels of a timeline.
const OF_TRACK: [OfTrack; 3] = [
    |t| {
        Some(
            t.place_m[0]
                .hypot(t.place_m[1])
                .hypot(t.height_m.unwrap_or(0.0)),
        )
    },
    |t| Some(t.place_m[0]),
    |t| t.height_m,
];

/// A line for each track of the board, and a new one after a time without it.
fn tracks(frames: &[PointFrame], value: OfTrack) -> Vec<Vec<[f64; 2]>> {
    /// Time without a track after which another line begins, s.
    const GAP_S: f64 = 1.0;
    let mut lines: Vec<Vec<[f64; 2]>> = Vec::new();
    // Line and last time of each track.
    let mut open: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
    for frame in frames {
        for track in frame.board.iter().flat_map(|board| &board.tracks) {
            let Some(value) = value(track) else {
                continue;
            };
            let known = open.get(&track.id).copied();
            let line = match known.filter(|(_, last_s)| frame.time_s - last_s <= GAP_S) {
                Some((line, _)) => line,
                None => {
                    lines.push(Vec::new());
                    lines.len() - 1
                }
            };
            open.insert(track.id, (line, frame.time_s));
            if let Some(line) = lines.get_mut(line) {
                line.push([frame.time_s, f64::from(value)]);
            }
        }
    }
    lines
}

/// A coordinate of a point with its name.
type Coordinate = (&'static str, fn(&RadarPoint) -> f32);

const RANGE: Coordinate = ("Range", |p| p.range_m);
const ACROSS: Coordinate = ("x", |p| p.x_m);
const UP: Coordinate = ("z", |p| p.z_m);

/// Coordinates of points over time, each in its own panel.
fn over_time(frames: &[PointFrame], title: &str, coordinates: &[Coordinate]) -> ScatterPlot {
    let panel = |label: &str, time: Axis, value: fn(&RadarPoint) -> f32| {
        let points = frames.iter().flat_map(|frame| {
            let at = |p| [frame.time_s, f64::from(value(p)), f64::from(p.velocity_mps)];
            frame.points.iter().map(at)
        });
        ScatterPanel {
            heading: String::new(),
            x: time,
            y: Axis::new(label, "m"),
            points: points.collect(),
            lines: Vec::new(),
            aspect: Aspect::Fill,
        }
    };
    // The time axis includes frames without points.
    let times = || frames.iter().map(|f| f.time_s).filter(|t| t.is_finite());
    let first = times().fold(f64::INFINITY, f64::min);
    let last = times().fold(f64::NEG_INFINITY, f64::max);
    let padding = TIME_PADDING * (last - first);
    let time = |label: &str, unit: &str| {
        Axis::new(label, unit).with_limits(first - padding, last + padding)
    };
    let lowest = coordinates.len().saturating_sub(1);
    let panels = coordinates.iter().enumerate().map(|(i, (label, value))| {
        let axis = if i == lowest {
            time("Time", "s")
        } else {
            time("", "")
        };
        panel(label, axis, *value)
    });
    coloured_by_velocity(title, panels.collect())
}

/// Makes the axis of places at least [`MIN_EXTENT_M`] long.
fn extend(panel: &mut ScatterPanel) {
    let of_points = panel.points.iter().map(|[_, value_m, _]| *value_m);
    let of_lines = panel.lines.iter().flatten().map(|[_, value_m]| *value_m);
    let values = of_points
        .chain(of_lines)
        .filter(|value_m| value_m.is_finite());
    let ends = values.fold(
        [f64::INFINITY, f64::NEG_INFINITY],
        |[first, last], value_m| [first.min(value_m), last.max(value_m)],
    );
    let [first_m, last_m] = ends;
    if first_m <= last_m && last_m - first_m < MIN_EXTENT_M {
        let middle_m = f64::midpoint(first_m, last_m);
        let half_m = MIN_EXTENT_M / 2.0;
        panel.y.limits = Some([middle_m - half_m, middle_m + half_m]);
    }
}

fn coloured_by_velocity(title: &str, panels: Vec<ScatterPanel>) -> ScatterPlot {
    let speeds = panels.iter().flat_map(|p| &p.points).map(|p| p[2].abs());
    let fastest = speeds
        .filter(|v| v.is_finite())
        .fold(MIN_SPEED_MPS, f64::max);
    ScatterPlot {
        title: title.into(),
        panels,
        colour_bar: Axis::new("Radial velocity", "m/s").with_limits(-fastest, fastest),
        colours: ColourMap::BlueRed,
        ..ScatterPlot::default()
    }
}
