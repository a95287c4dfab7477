//! Heat maps, for example range-Doppler, range-azimuth, micro-Doppler and detection maps.

use super::{
    PlotError,
    axis::{Axis, AxisScale, Scale},
    colours::ColourMap,
    figure::{Aspect, ColourBar, Figure, Panel},
    png_texts,
};
use crate::png_file::{self, Pixels};

/// Height of the plot, pt.
const HEIGHT_PT: f64 = 128.0;
/// Maximum side of the image, pixels. In larger grids, each pixel shows the maximum of its cells.
const MAX_SIDE: usize = 4096;

/// A matrix of values, `[row, column]`, column fastest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grid {
    n_rows: usize,
    n_cols: usize,
    values: Vec<f32>,
}

impl Grid {
    /// Creates a grid, which may be empty.
    ///
    /// # Errors
    /// [`PlotError::Shape`] if the number of values is not `n_rows * n_cols`.
    pub fn new(n_rows: usize, n_cols: usize, values: Vec<f32>) -> Result<Self, PlotError> {
        if n_rows.checked_mul(n_cols) != Some(values.len()) {
            return Err(PlotError::Shape {
                n_rows,
                n_cols,
                found: values.len(),
            });
        }
        Ok(Self {
            n_rows,
            n_cols,
            values,
        })
    }

    /// The grid reduced to sides of at most [`MAX_SIDE`].
    fn reduced(&self) -> std::borrow::Cow<'_, Self> {
        let (by_row, by_col) = (
            self.n_rows.div_ceil(MAX_SIDE),
            self.n_cols.div_ceil(MAX_SIDE),
        );
        if by_row <= 1 && by_col <= 1 {
            return std::borrow::Cow::Borrowed(self);
        }
        let (n_rows, n_cols) = (self.n_rows.div_ceil(by_row), self.n_cols.div_ceil(by_col));
        // `f32::max` ignores NaN if the other operand is a number.
        let mut values = vec![f32::NAN; n_rows * n_cols];
        for (row, cells) in self.values.chunks_exact(self.n_cols).enumerate() {
            for (col, cell) in cells.iter().enumerate() {
                let value = &mut values[row / by_row * n_cols + col / by_col];
                *value = value.max(*cell);
            }
        }
        std::borrow::Cow::Owned(Self {
            n_rows,
            n_cols,
            values,
        })
    }
}

/// A function of two quantities, shown as colours.
///
/// ```
/// use radarllm_render::plot::{Axis, Grid, Heatmap};
///
/// let map = Heatmap {
///     title: "Range-Doppler map".into(),
///     // Three velocities 0.5 m/s apart, two ranges 0.1 m apart.
///     x: Axis::new("Velocity", "m/s").with_cells(-0.5, 0.5, 3),
///     y: Axis::new("Range", "m").with_cells(2.0, 0.1, 2),
///     values: Grid::new(2, 3, vec![-40.0, -3.0, -42.0, -38.0, 0.0, -12.0])?,
///     colour_bar: Axis::new("Power", "dB").with_limits(-45.0, 0.0),
/// };
/// assert!(map.to_svg().starts_with("<svg"));
/// assert!(map.to_png()?.starts_with(b"\x89PNG"));
/// # Ok::<(), radarllm_render::plot::PlotError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heatmap {
    /// Title above the plot.
    pub title: String,
    /// Quantity of the columns, linear. The limits are the outer edges of the first and the last column.
    pub x: Axis,
    /// Quantity of the rows, linear. The limits are the outer edges of the first and the last row. Row 0 is at the
    /// bottom.
    pub y: Axis,
    /// The values. Values that are not finite are grey.
    pub values: Grid,
    /// Quantity of the values. Values beyond the limits have the colour of the nearer end.
    pub colour_bar: Axis,
}

impl Heatmap {
    /// The figure: axes as vector shapes around the embedded image of [`Heatmap::to_png`].
    pub fn to_svg(&self) -> String {
        let (x_axis, y_axis) = self.axes();
        let is_empty = self.values.values.is_empty();
        // Encoding fails only for an empty grid, whose image has no pixels and is omitted.
        let png = self.to_png().ok();
        let figure = Figure {
            title: &self.title,
            panels: vec![Panel {
                heading: "",
                x: Scale::new(&x_axis, [], 0.0),
                y: Scale::new(&y_axis, [], 0.0),
                x_axis: &x_axis,
                y_axis: &y_axis,
                aspect: Aspect::Fill,
                height_pt: HEIGHT_PT,
                is_empty,
                has_grid: false,
            }],
            colour_bar: Some(ColourBar {
                axis: &self.colour_bar,
                scale: self.colour_scale(),
                colours: ColourMap::Viridis,
            }),
            legend: Vec::new(),
            notes: Vec::new(),
        };
        figure.to_svg(|svg, _, placed| {
            if let Some(png) = &png {
                svg.image(placed.area, png);
            }
        })
    }

    /// The image only, one pixel per cell and without text. The extents of the axes and of the colour bar are in its
    /// tEXt chunks.
    ///
    /// # Errors
    /// [`PlotError::Encode`] for an empty grid.
    pub fn to_png(&self) -> Result<Vec<u8>, PlotError> {
        let (x_axis, y_axis) = self.axes();
        let scale = self.colour_scale();
        let grid = self.values.reduced();
        let rows = grid.values.chunks(grid.n_cols.max(1)).rev();
        let indices: Vec<u8> = rows
            .flatten()
            .map(|value| ColourMap::index(scale.fraction(f64::from(*value))))
            .collect();
        let pixels = Pixels::Indexed {
            palette: &ColourMap::Viridis.palette(),
            indices: &indices,
        };
        let texts = png_texts(
            &self.title,
            &[
                ("x-axis", &x_axis, &Scale::new(&x_axis, [], 0.0)),
                ("y-axis", &y_axis, &Scale::new(&y_axis, [], 0.0)),
                ("colour", &self.colour_bar, &scale),
            ],
        );
        Ok(png_file::encode(grid.n_cols, grid.n_rows, &pixels, &texts)?)
    }

    /// The two axes, both linear. Without limits, an axis shows cell numbers from 0.
    fn axes(&self) -> (Axis, Axis) {
        let of_cells = |axis: &Axis, n: usize| {
            let axis = axis.clone().with_scale(AxisScale::Linear);
            match axis.limits {
                Some([a, b]) if a.is_finite() && b.is_finite() && a != b => axis,
                _ => axis.with_cells(0.0, 1.0, n.max(1)),
            }
        };
        (
            of_cells(&self.x, self.values.n_cols),
            of_cells(&self.y, self.values.n_rows),
        )
    }

    fn colour_scale(&self) -> Scale {
        let values = self.values.values.iter().map(|v| f64::from(*v));
        Scale::new(&self.colour_bar, values, 0.0)
    }
}
