//! Line plots: profiles, scores with intervals, tracks.

use super::{
    axis::{Axis, Scale},
    figure::{Aspect, Figure, Panel, segment},
    series::SeriesStyle,
    svg::{Stroke, Svg},
};
use crate::markup::coordinate;

/// Height of a plot with [`Aspect::Fill`], pt.
const HEIGHT_PT: f64 = 118.0;
const LINE_PT: f64 = 1.1;
const INTERVAL_LINE_PT: f64 = 0.7;
/// Half the length of the cap of an interval, pt.
const CAP_PT: f64 = 1.6;
/// Distance between the intervals of neighbouring series at the same position, pt.
const DODGE_PT: f64 = 3.2;
/// Margin between data and axis ends, as a fraction of the axis extent.
const PADDING: f64 = 0.05;

/// A point of a curve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CurvePoint {
    /// Horizontal value.
    pub x: f64,
    /// Vertical value; a value that is not finite interrupts the curve.
    pub y: f64,
    /// Lower and upper end of an interval around `y`.
    pub interval: Option<[f64; 2]>,
}

impl From<[f64; 2]> for CurvePoint {
    fn from([x, y]: [f64; 2]) -> Self {
        Self {
            x,
            y,
            interval: None,
        }
    }
}

/// A curve.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name in the legend; empty for none.
    pub name: String,
    /// The points, in the order in which they are connected.
    pub points: Vec<CurvePoint>,
}

impl Series {
    /// A curve through the given points.
    pub fn new(
        name: impl Into<String>,
        points: impl IntoIterator<Item = impl Into<CurvePoint>>,
    ) -> Self {
        Self {
            name: name.into(),
            points: points.into_iter().map(Into::into).collect(),
        }
    }
}

/// Which points of a curve have markers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Markers {
    /// No markers: for curves of many points.
    #[default]
    None,
    /// A marker at every point, with a different shape for each curve.
    EveryPoint,
    /// A marker at the first point only, which shows the direction of a path.
    FirstPoint,
}

/// Curves on one pair of axes, with a legend of the curves that have a name.
///
/// ```
/// use radarllm_render::plot::{Axis, CurvePoint, LinePlot, Markers, Series};
///
/// let accuracy = |x, y, low, high| CurvePoint { x, y, interval: Some([low, high]) };
/// let plot = LinePlot {
///     title: "Accuracy under noise".into(),
///     x: Axis::new("Added noise", "dB"),
///     y: Axis::new("Accuracy", "%").with_limits(0.0, 100.0),
///     series: vec![Series::new(
///         "action",
///         [accuracy(0.0, 80.0, 67.5, 90.0), accuracy(30.0, 55.0, 40.0, 70.0)],
///     )],
///     markers: Markers::EveryPoint,
///     ..LinePlot::default()
/// };
/// assert!(plot.to_svg().contains("Added noise (dB)"));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinePlot {
    /// Title above the plot.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The curves.
    pub series: Vec<Series>,
    /// Which points have markers.
    pub markers: Markers,
    /// Relation between the scales of the axes.
    pub aspect: Aspect,
}

impl LinePlot {
    /// The figure.
    pub fn to_svg(&self) -> String {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let has_intervals = points().any(|p| p.interval.is_some());
        let is_curve = self.markers == Markers::None && self.aspect == Aspect::Fill;
        let x_padding = if is_curve { 0.0 } else { PADDING };
        let heights =
            points().flat_map(|p| [p.y].into_iter().chain(p.interval.into_iter().flatten()));
        let x = Scale::new(&self.x, points().map(|p| p.x), x_padding);
        let y = Scale::new(&self.y, heights, PADDING);
        let is_drawn = |p: &CurvePoint| (x.fraction(p.x) + y.fraction(p.y)).is_finite();
        let style = |i| SeriesStyle::new(i, LINE_PT, self.markers == Markers::EveryPoint);
        let figure = Figure {
            title: &self.title,
            panels: vec![Panel {
                heading: "",
                is_empty: !points().any(is_drawn),
                x,
                y,
                x_axis: &self.x,
                y_axis: &self.y,
                aspect: self.aspect,
                height_pt: HEIGHT_PT,
                has_grid: true,
            }],
            colour_bar: None,
            legend: self
                .series
                .iter()
                .enumerate()
                .map(|(i, s)| (s.name.as_str(), style(i)))
                .collect(),
            notes: Vec::new(),
        };
        figure.to_svg(|svg, _, placed| {
            for (i, series) in self.series.iter().enumerate() {
                // Intervals of several curves at the same position are drawn side by side.
                let dodge = match has_intervals {
                    true => DODGE_PT * (i as f64 - 0.5 * (self.series.len() - 1) as f64),
                    false => 0.0,
                };
                let points: Vec<[f64; 2]> = series
                    .points
                    .iter()
                    .map(|p| placed.at(p.x, p.y))
                    .map(|[x, y]| [x + dodge, y])
                    .collect();
                draw_curve(svg, &points, style(i));
                for (point, [x, _]) in series.points.iter().zip(&points) {
                    if let Some(ends) = point.interval {
                        let ends = ends.map(|y| placed.y.to_pt(y));
                        draw_interval(svg, *x, ends, style(i).colour());
                    }
                }
                let n_marked = match self.markers {
                    Markers::None => 0,
                    Markers::FirstPoint => 1,
                    Markers::EveryPoint => points.len(),
                };
                let seen = points.iter().filter(|p| is_place(p)).take(n_marked);
                let markers: String = seen.map(|p| style(i).marker(*p)).collect();
                if !markers.is_empty() {
                    svg.filled_path(&markers, style(i).colour());
                }
            }
        })
    }
}

fn is_place([x, y]: &[f64; 2]) -> bool {
    x.is_finite() && y.is_finite()
}

/// Draws a curve, interrupted where a position is missing. An isolated position becomes a dot.
pub(super) fn draw_curve(svg: &mut Svg, places: &[[f64; 2]], style: SeriesStyle) {
    let mut commands = String::new();
    for run in places.split(|p| !is_place(p)) {
        let mut written: Vec<String> = run
            .iter()
            .map(|[x, y]| format!("{} {}", coordinate(*x), coordinate(*y)))
            .collect();
        // In long recordings, many points coincide on paper.
        written.dedup();
        match &written[..] {
            [] => {}
            [_] => {
                let [x, y] = run[0];
                let half = 0.5 * style.stroke().width_pt;
                commands += &segment([x - half, y], [x + half, y]);
            }
            several => {
                commands.push('M');
                commands += &several.join("L");
            }
        }
    }
    if !commands.is_empty() {
        svg.path(&commands, style.stroke());
    }
}

fn draw_interval(svg: &mut Svg, x: f64, [low, high]: [f64; 2], colour: &str) {
    if !(x.is_finite() && low.is_finite() && high.is_finite()) {
        return;
    }
    let cap = |y| segment([x - CAP_PT, y], [x + CAP_PT, y]);
    svg.path(
        &(segment([x, low], [x, high]) + &cap(low) + &cap(high)),
        Stroke {
            colour,
            width_pt: INTERVAL_LINE_PT,
            dashes: "",
        },
    );
}
