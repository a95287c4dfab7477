//! Histograms: frequencies of values in bins.

use super::{
    axis::{Axis, Scale},
    figure::{Aspect, Figure, Panel},
    line_plot::{Series, draw_curve},
    series::SeriesStyle,
};

/// Height of the plot, pt.
const HEIGHT_PT: f64 = 118.0;
const LINE_PT: f64 = 0.9;

/// Frequencies of values in bins, drawn as one stepped outline per series.
///
/// ```
/// use radarllm_render::plot::{Axis, AxisScale, Histogram};
///
/// let plot = Histogram {
///     title: "ADC values".into(),
///     x: Axis::new("Value", "counts"),
///     y: Axis::new("Share of samples", "").with_scale(AxisScale::Log10),
///     edges: vec![-1.5, -0.5, 0.5, 1.5],
///     series: vec![("RX1".into(), vec![0.01, 0.9, 0.09])],
/// };
/// assert!(plot.to_svg().contains("Value (counts)"));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Title above the plot.
    pub title: String,
    /// Quantity that is binned.
    pub x: Axis,
    /// Frequency.
    pub y: Axis,
    /// Bin edges in increasing order, one more than bins.
    pub edges: Vec<f64>,
    /// Name and one value per bin for each series. An empty name is omitted from the legend. Surplus values are not
    /// drawn.
    pub series: Vec<(String, Vec<f64>)>,
}

impl Histogram {
    /// The figure. On a logarithmic axis, empty bins are gaps.
    pub fn to_svg(&self) -> String {
        let outlines: Vec<Series> = self
            .series
            .iter()
            .map(|(name, values)| {
                let bins = self.edges.windows(2).zip(values);
                let steps =
                    bins.flat_map(|(edges, value)| [[edges[0], *value], [edges[1], *value]]);
                Series::new(name.as_str(), steps)
            })
            .collect();
        let points = || outlines.iter().flat_map(|s| &s.points);
        let x = Scale::new(&self.x, self.edges.iter().copied(), 0.0);
        // The vertical axis includes zero, unless it is logarithmic.
        let y = Scale::new(&self.y, points().map(|p| p.y).chain([0.0]), 0.0);
        let y = match self.y.limits {
            Some(_) => y,
            None => Scale::new(
                &self.y,
                points().map(|p| p.y).chain([0.0, y.to_value(1.05)]),
                0.0,
            ),
        };
        let is_empty = !points().any(|p| (x.fraction(p.x) + y.fraction(p.y)).is_finite());
        let style = |i| SeriesStyle::new(i, LINE_PT, false);
        let figure = Figure {
            title: &self.title,
            panels: vec![Panel {
                heading: "",
                x,
                y,
                x_axis: &self.x,
                y_axis: &self.y,
                aspect: Aspect::Fill,
                height_pt: HEIGHT_PT,
                is_empty,
                has_grid: true,
            }],
            colour_bar: None,
            legend: outlines
                .iter()
                .enumerate()
                .map(|(i, s)| (s.name.as_str(), style(i)))
                .collect(),
            notes: Vec::new(),
        };
        figure.to_svg(|svg, _, placed| {
            for (i, outline) in outlines.iter().enumerate() {
                let places: Vec<[f64; 2]> =
                    outline.points.iter().map(|p| placed.at(p.x, p.y)).collect();
                draw_curve(svg, &places, style(i));
            }
        })
    }
}
