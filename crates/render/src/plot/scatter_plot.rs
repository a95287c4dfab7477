//! Scatter plots: points, each with a colour.

use super::{
    PlotError,
    axis::{Axis, Scale},
    colours::{ColourMap, LAST, NOTHING, hex},
    figure::{Aspect, ColourBar, Figure, Panel, Placed, segment},
    png_texts,
    svg::{Anchor, INK, Stroke, Svg, text_width},
};
use crate::{
    markup::coordinate,
    png_file::{self, Pixels},
};

/// Height of a panel with [`Aspect::Fill`], pt.
const HEIGHT_PT: f64 = 100.0;
const RADIUS_PT: f64 = 1.2;
/// Font size of the numbers of spans, pt.
const NUMBER_PT: f64 = 7.0;
/// Line between spans.
const BORDER: Stroke = Stroke {
    colour: INK,
    width_pt: 0.5,
    dashes: "2 1.5",
};
/// Lines over the points.
const LINE: Stroke = Stroke {
    colour: INK,
    width_pt: 0.8,
    dashes: "",
};
/// Vertices of a line that are nearer to the last one, pt, are left out: a night has hundreds of thousands.
const VERTEX_PT: f64 = 0.3;
/// Maximum number of points drawn as vector shapes. More points become an embedded image.
const MAX_VECTOR_POINTS: usize = 20_000;
/// Resolution of the image, pixels per point on paper: 288 dpi.
const PIXELS_PER_PT: f64 = 4.0;
/// Blank rows between the panels of an image, pixels.
const PICTURE_GAP: usize = 24;
/// Margin between data and axis ends, as a fraction of the axis extent.
const PADDING: f64 = 0.05;
/// Number of colour steps of vector shapes, which are grouped by colour.
const COLOUR_STEPS: f64 = 22.0;

/// Points on one pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScatterPanel {
    /// Text above the panel; empty for none.
    pub heading: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Horizontal value, vertical value and colour value of each point. Points without a finite position are omitted.
    pub points: Vec<[f64; 3]>,
    /// Lines over the points: horizontal and vertical values. For SVG only.
    pub lines: Vec<Vec<[f64; 2]>>,
    /// Relation between the scales of the axes.
    pub aspect: Aspect,
}

/// A part of the horizontal axis and what is said of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Span {
    /// Where it begins, in units of the axis.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// What is said of it.
    pub text: String,
}

/// Points coloured by a value, in panels one below the other.
///
/// Points are drawn in increasing order of the value or, with [`ColourMap::BlueRed`], of its distance from the middle.
///
/// ```
/// use radarllm_render::plot::{Axis, ColourMap, ScatterPanel, ScatterPlot};
///
/// let plot = ScatterPlot {
///     title: "Radar points".into(),
///     panels: vec![ScatterPanel {
///         x: Axis::new("x", "m"),
///         y: Axis::new("y", "m"),
///         points: vec![[0.1, 3.0, -0.8], [0.2, 3.1, 1.4]],
///         ..ScatterPanel::default()
///     }],
///     colour_bar: Axis::new("Radial velocity", "m/s").with_limits(-2.0, 2.0),
///     colours: ColourMap::BlueRed,
///     ..ScatterPlot::default()
/// };
/// assert_eq!(plot.to_svg().matches("<circle").count(), 2);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScatterPlot {
    /// Title above the panels.
    pub title: String,
    /// The panels, from top to bottom.
    pub panels: Vec<ScatterPanel>,
    /// Parts of the horizontal axis: lines between them in all panels, their numbers in the first panel, and their texts
    /// below the figure. For SVG only.
    pub spans: Vec<Span>,
    /// Quantity shown by the colours.
    pub colour_bar: Axis,
    /// Colour map.
    pub colours: ColourMap,
}

impl ScatterPlot {
    /// The figure.
    pub fn to_svg(&self) -> String {
        let n_points: usize = self.panels.iter().map(|p| p.points.len()).sum();
        let colours = self.colour_scale();
        self.figure().to_svg(|svg, index, placed| {
            let points = self.placed_points(index, placed, &colours);
            if n_points <= MAX_VECTOR_POINTS {
                draw_discs(svg, &points, self.colours);
                self.draw_lines(svg, index, placed);
                self.draw_spans(svg, index, placed);
                return;
            }
            let (width, height, indices) = self.picture(placed, &points);
            let pixels = Pixels::Indexed {
                palette: &self.colours.palette(),
                indices: &indices,
            };
            // A panel has a positive size, so encoding its image into memory cannot fail.
            if let Ok(png) = png_file::encode(width, height, &pixels, &[]) {
                svg.image(placed.area, &png);
            }
            self.draw_lines(svg, index, placed);
            self.draw_spans(svg, index, placed);
        })
    }

    /// Draws the lines of a panel.
    fn draw_lines(&self, svg: &mut Svg, index: usize, placed: &Placed) {
        let lines = self.panels.get(index).into_iter().flat_map(|p| &p.lines);
        for line in lines {
            let mut commands = String::new();
            let mut last: Option<[f64; 2]> = None;
            for [x, y] in line.iter().map(|[x, y]| placed.at(*x, *y)) {
                let is_near = |[a, b]: [f64; 2]| (x - a).hypot(y - b) < VERTEX_PT;
                if !(x.is_finite() && y.is_finite()) || last.is_some_and(is_near) {
                    continue;
                }
                commands += if last.is_none() { "M" } else { "L" };
                commands += &format!("{} {}", coordinate(x), coordinate(y));
                last = Some([x, y]);
            }
            if !commands.is_empty() {
                svg.path(&commands, LINE);
            }
        }
    }

    /// Draws a line between every two spans, and into the first panel their numbers, as far as they are wide enough.
    fn draw_spans(&self, svg: &mut Svg, index: usize, placed: &Placed) {
        let [top, bottom] = [placed.area.top, placed.area.bottom()];
        for span in self.spans.iter().skip(1) {
            let x = placed.x.to_pt(span.from);
            svg.path(&segment([x, top], [x, bottom]), BORDER);
        }
        if index > 0 {
            return;
        }
        for (i, span) in self.spans.iter().enumerate() {
            let [left, right] = [span.from, span.to].map(|x| placed.x.to_pt(x));
            let number = (i + 1).to_string();
            if text_width(&number, NUMBER_PT) <= right - left {
                let (x, y) = (0.5 * (left + right), placed.area.top + NUMBER_PT);
                svg.bold_text(x, y, NUMBER_PT, Anchor::Middle, &number);
            }
        }
    }

    /// An image of the panels only, without text. The extents of the axes and of the colour bar are in its tEXt chunks.
    ///
    /// # Errors
    /// [`PlotError::Encode`] if there is no panel.
    pub fn to_png(&self) -> Result<Vec<u8>, PlotError> {
        let colours = self.colour_scale();
        let placed = self.figure().placed_panels();
        let mut indices: Vec<u8> = Vec::new();
        let mut image_width = 0;
        for (index, panel) in placed.iter().enumerate() {
            let points = self.placed_points(index, panel, &colours);
            let (width, _, picture) = self.picture(panel, &points);
            if index > 0 {
                indices.extend(vec![NOTHING; PICTURE_GAP * width]);
            }
            // All panels have the same width.
            image_width = width;
            indices.extend(picture);
        }
        let names: Vec<[String; 2]> = (1..=placed.len())
            .map(|n| {
                [
                    format!("x-axis of panel {n}"),
                    format!("y-axis of panel {n}"),
                ]
            })
            .collect();
        let mut axes = Vec::new();
        for ((panel, [x, y]), placed) in self.panels.iter().zip(&names).zip(&placed) {
            axes.push((x.as_str(), &panel.x, &placed.x));
            axes.push((y.as_str(), &panel.y, &placed.y));
        }
        axes.push(("colour", &self.colour_bar, &colours));
        let pixels = Pixels::Indexed {
            palette: &self.colours.palette(),
            indices: &indices,
        };
        let height = indices.len() / image_width.max(1);
        let texts = png_texts(&self.title, &axes);
        Ok(png_file::encode(image_width, height, &pixels, &texts)?)
    }

    fn figure(&self) -> Figure<'_> {
        let panels = self.panels.iter().map(|panel| {
            let axis = |axis, i: usize| {
                let of_points = panel.points.iter().map(|p| p[i]);
                let of_lines = panel.lines.iter().flatten().map(|p| p[i]);
                Scale::new(axis, of_points.chain(of_lines), PADDING)
            };
            let (x, y) = (axis(&panel.x, 0), axis(&panel.y, 1));
            let is_drawn = |p: &[f64; 3]| (x.fraction(p[0]) + y.fraction(p[1])).is_finite();
            Panel {
                heading: &panel.heading,
                is_empty: !panel.points.iter().any(is_drawn) && panel.lines.is_empty(),
                x,
                y,
                x_axis: &panel.x,
                y_axis: &panel.y,
                aspect: panel.aspect,
                height_pt: HEIGHT_PT,
                has_grid: true,
            }
        });
        Figure {
            title: &self.title,
            panels: panels.collect(),
            colour_bar: Some(ColourBar {
                axis: &self.colour_bar,
                scale: self.colour_scale(),
                colours: self.colours,
            }),
            legend: Vec::new(),
            notes: self.notes(),
        }
    }

    /// The texts of the spans with their numbers.
    fn notes(&self) -> Vec<String> {
        let numbered = self.spans.iter().enumerate();
        numbered
            .map(|(i, span)| format!("{} {}", i + 1, span.text))
            .collect()
    }

    fn colour_scale(&self) -> Scale {
        let values = self.panels.iter().flat_map(|p| &p.points).map(|p| p[2]);
        Scale::new(&self.colour_bar, values, 0.0)
    }

    /// Positions of the points and their relative positions on the colour bar, in drawing order. Points without a
    /// position are omitted.
    fn placed_points(
        &self,
        index: usize,
        placed: &Placed,
        colours: &Scale,
    ) -> Vec<([f64; 2], f64)> {
        let Some(panel) = self.panels.get(index) else {
            return Vec::new();
        };
        let points = panel.points.iter().map(|[x, y, value]| {
            let share = colours.fraction(*value);
            // A point without a colour value gets the middle colour.
            let share = if share.is_nan() { 0.5 } else { share };
            (placed.at(*x, *y), share.clamp(0.0, 1.0))
        });
        let mut points: Vec<([f64; 2], f64)> = points
            .filter(|([x, y], _)| x.is_finite() && y.is_finite())
            .collect();
        let rank = |share: f64| match self.colours {
            ColourMap::Viridis => share,
            ColourMap::BlueRed => (share - 0.5).abs(),
        };
        points.sort_by(|a, b| rank(a.1).total_cmp(&rank(b.1)));
        points
    }

    /// Width, height and pixels of the image of a panel.
    fn picture(&self, placed: &Placed, points: &[([f64; 2], f64)]) -> (usize, usize, Vec<u8>) {
        let area = placed.area;
        let side = |pt: f64| (pt * PIXELS_PER_PT).round().max(1.0) as usize;
        let (width, height) = (side(area.width), side(area.height));
        let mut pixels = vec![NOTHING; width * height];
        let radius = RADIUS_PT * PIXELS_PER_PT;
        for ([x, y], share) in points {
            let centre = [
                (x - area.left) * PIXELS_PER_PT,
                (y - area.top) * PIXELS_PER_PT,
            ];
            let colour = ColourMap::index(*share);
            for row in pixels_within(centre[1], radius, height) {
                for col in pixels_within(centre[0], radius, width) {
                    let (dx, dy) = (col as f64 + 0.5 - centre[0], row as f64 + 0.5 - centre[1]);
                    if dx * dx + dy * dy <= radius * radius {
                        pixels[row * width + col] = colour;
                    }
                }
            }
        }
        (width, height, pixels)
    }
}

/// Range of pixels whose centres may lie within a radius.
fn pixels_within(centre: f64, radius: f64, n: usize) -> std::ops::Range<usize> {
    // Casts saturate, so positions outside give an empty range.
    let first = (centre - radius).floor().max(0.0) as usize;
    let end = ((centre + radius).ceil().max(0.0) as usize).min(n);
    first.min(end)..end
}

/// Draws discs, one group for each run of equal colour.
fn draw_discs(svg: &mut Svg, points: &[([f64; 2], f64)], colours: ColourMap) {
    let palette = colours.palette();
    let step = |share: f64| (share * COLOUR_STEPS).round();
    for run in points.chunk_by(|a, b| step(a.1) == step(b.1)) {
        let index = (step(run[0].1) / COLOUR_STEPS * f64::from(LAST)).round() as usize;
        let centres: Vec<[f64; 2]> = run.iter().map(|(place, _)| *place).collect();
        svg.discs(
            &centres,
            RADIUS_PT,
            &hex(palette[index.min(usize::from(LAST))]),
        );
    }
}
