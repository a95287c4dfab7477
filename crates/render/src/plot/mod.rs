//! Plots as figures for papers and web pages: SVG with real text, one column (85 mm) wide.
//!
//! A plot is a struct of plain data with `to_svg`, which always succeeds. A figure without data shows "no data"; values
//! that are not finite are omitted or grey. Equal plots give equal bytes. Text uses the viewer's sans-serif font and
//! can therefore be searched and edited. One unit of the drawing is one point on paper.
//!
//! | data | plot |
//! |---|---|
//! | a matrix of values, such as a range-Doppler map or a micro-Doppler spectrogram | [`Heatmap`] |
//! | points, each with a colour | [`ScatterPlot`]; for radar points [`point_cloud`], [`points_over_time`], [`timeline`] |
//! | curves with or without intervals, and paths | [`LinePlot`] |
//! | frequencies of values | [`Histogram`] |
//!
//! [`Heatmap::to_png`] and [`ScatterPlot::to_png`] give only the image inside the axes, for programs that draw axes
//! themselves. The extents of the axes are in the tEXt chunks. Text is not rasterised, because this would require a
//! font, either from the machine, so that the result would depend on it, or embedded.

mod axis;
mod colours;
mod figure;
mod heatmap;
mod histogram;
mod line_plot;
mod radar_points;
mod scatter_plot;
mod series;
mod svg;
#[cfg(test)]
mod tests;

pub use axis::{Axis, AxisScale};
pub use colours::ColourMap;
pub use figure::Aspect;
pub use heatmap::{Grid, Heatmap};
pub use histogram::Histogram;
pub use line_plot::{CurvePoint, LinePlot, Markers, Series};
pub use radar_points::{point_cloud, points_over_time, timeline};
pub use scatter_plot::{ScatterPanel, ScatterPlot, Span};

use axis::Scale;

use crate::PngError;

/// Reason why a plot cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The number of values does not match the size of the grid.
    #[error("a grid of {n_rows} x {n_cols} needs as many values, found {found}")]
    Shape {
        /// Rows.
        n_rows: usize,
        /// Columns.
        n_cols: usize,
        /// Number of values.
        found: usize,
    },
    /// The image cannot be a PNG file, for example because it has no pixels.
    #[error("png: {0}")]
    Encode(#[from] PngError),
}

/// Text chunks of an image: its title and, by keyword, the quantity and the two ends of each axis (left to right,
/// bottom to top).
fn png_texts<'a>(title: &str, axes: &[(&'a str, &Axis, &Scale)]) -> Vec<(&'a str, String)> {
    let mut texts = vec![("Title", title.to_owned())];
    for (keyword, axis, scale) in axes {
        let [first, last] = scale.ends().map(|v| match v.abs() {
            0.0 | 1e-3..1e9 => format!("{v:.6}"),
            _ => format!("{v:.6e}"),
        });
        texts.push((keyword, format!("{} from {first} to {last}", axis.title(0))));
    }
    texts
}
