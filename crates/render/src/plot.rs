//! Plots as figures for papers and pages: SVG with real text, one column (85 mm) wide.
//!
//! A plot is a struct of plain data with `to_svg`, which always gives a figure: without data it says "no data", and values
//! that are not finite are left out or grey. The same plot gives the same bytes. Text uses the viewer's sans-serif font, so
//! that it can be searched and edited; one unit of the drawing is one point on paper.
//!
//! | data | plot |
//! |---|---|
//! | a rectangle of values: range-Doppler, micro-Doppler | [`Heatmap`] |
//! | points with a colour each | [`ScatterPlot`]; of radar points [`point_cloud`], [`points_over_time`] |
//! | curves, with intervals or without, and paths | [`LinePlot`] |
//! | how often values occur | [`Histogram`] |
//!
//! [`Heatmap::to_png`] and [`ScatterPlot::to_png`] give the picture inside the axes alone, for programs that draw axes
//! themselves; what its sides mean stands in its tEXt chunks. Text is not turned into pixels: that would need a font, and
//! the result would depend on the fonts of the machine or carry one along.

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
pub use radar_points::{point_cloud, points_over_time};
pub use scatter_plot::{ScatterPanel, ScatterPlot};

use axis::Scale;

/// Why a plot cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The values do not fill the rectangle.
    #[error("a grid of {n_rows} x {n_cols} needs as many values, found {found}")]
    Shape {
        /// Rows.
        n_rows: usize,
        /// Columns.
        n_cols: usize,
        /// Values given.
        found: usize,
    },
    /// The PNG encoder failed; a picture without pixels is no PNG file.
    #[error("png: {0}")]
    Encode(#[from] png::EncodingError),
}

/// Text chunks of a picture: its title and, by keyword, what each axis shows from its first to its last end (left to
/// right, bottom to top).
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
