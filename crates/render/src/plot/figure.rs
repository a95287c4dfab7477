//! The layout shared by all plots: title, panels one below the other with their axes, colour bar, legend, notes.

use super::{
    axis::{Axis, Scale, Tick},
    colours::{ColourMap, LAST},
    series::SeriesStyle,
    svg::{Anchor, GRID, INK, Rect, Stroke, Svg, WIDTH_PT, shortened, text_width, wrapped},
};
use crate::png_file::{self, Pixels};

/// Font sizes, pt. The minimum that journals require is 6 to 8.
const TITLE_PT: f64 = 8.5;
const LABEL_PT: f64 = 8.0;
const TICK_PT: f64 = 7.0;
/// Upper bound on the width of bold text relative to plain text.
const BOLD: f64 = 1.1;
/// Line height relative to the font size.
const LINE: f64 = 1.25;
/// Margin around the figure, pt.
const MARGIN_PT: f64 = 3.0;
const TICK_LENGTH_PT: f64 = 2.5;
/// Distance between a tick and its number, and between numbers and label, pt.
const GAP_PT: f64 = 2.0;
const BAR_WIDTH_PT: f64 = 7.0;
/// Distance between plot area and colour bar, and between panels, pt.
const SPACE_PT: f64 = 6.0;
/// Length of the sample of a series in the legend, and distance to the next entry, pt.
const SAMPLE_PT: f64 = 16.0;
const ENTRY_SPACE_PT: f64 = 10.0;
/// Minimum and maximum height of a panel with equal scales on both axes, pt.
const EQUAL_HEIGHTS_PT: [f64; 2] = [56.0, 170.0];

const AXIS_LINE: Stroke = Stroke {
    colour: INK,
    width_pt: 0.6,
    dashes: "",
};
const GRID_LINE: Stroke = Stroke {
    colour: GRID,
    width_pt: 0.5,
    dashes: "",
};

/// Relation between the scales of the two axes of a plot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Aspect {
    /// Each axis fills its side of the plot.
    #[default]
    Fill,
    /// A unit has the same length on both axes, as on a map; axes are extended as needed. For linear axes.
    Equal,
}

/// One pair of axes.
pub(super) struct Panel<'a> {
    /// Text above the panel; empty for none.
    pub heading: &'a str,
    pub x_axis: &'a Axis,
    pub y_axis: &'a Axis,
    pub x: Scale,
    pub y: Scale,
    pub aspect: Aspect,
    /// Height of a panel with [`Aspect::Fill`], pt.
    pub height_pt: f64,
    pub is_empty: bool,
    /// Whether faint lines are drawn at the ticks.
    pub has_grid: bool,
}

/// A panel with its position on paper.
pub(super) struct Placed {
    pub area: Rect,
    pub x: Scale,
    pub y: Scale,
}

impl Placed {
    pub(super) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [self.x.to_pt(x), self.y.to_pt(y)]
    }
}

/// Colour bar, to the right of all panels.
pub(super) struct ColourBar<'a> {
    pub axis: &'a Axis,
    pub scale: Scale,
    pub colours: ColourMap,
}

/// A figure without the content of its panels.
pub(super) struct Figure<'a> {
    pub title: &'a str,
    pub panels: Vec<Panel<'a>>,
    pub colour_bar: Option<ColourBar<'a>>,
    /// Names and styles of the series; series without a name are omitted.
    pub legend: Vec<(&'a str, SeriesStyle)>,
    /// Texts below everything else.
    pub notes: Vec<String>,
}

impl Figure<'_> {
    /// Draws the figure; `draw` fills the panel with the given index.
    pub(super) fn to_svg(&self, draw: impl Fn(&mut Svg, usize, &Placed)) -> String {
        let mut svg = Svg::default();
        let (placed, mut bottom) = self.place();
        let first = placed.first().map_or(
            Rect {
                left: MARGIN_PT,
                top: MARGIN_PT,
                width: WIDTH_PT - 2.0 * MARGIN_PT,
                height: 0.0,
            },
            |p| p.area,
        );
        let middle = first.left + 0.5 * first.width;
        for (i, line) in self.title_lines().iter().enumerate() {
            let half = 0.5 * BOLD * text_width(line, TITLE_PT);
            // The title is centred over the plot, as far as the edges of the figure allow.
            let centre = middle
                .min(WIDTH_PT - MARGIN_PT - half)
                .max(MARGIN_PT + half);
            let y = MARGIN_PT + (i as f64 + 0.5) * LINE * TITLE_PT;
            svg.bold_text(centre, y, TITLE_PT, Anchor::Middle, line);
        }
        for (index, (panel, placed)) in self.panels.iter().zip(&placed).enumerate() {
            panel.draw(&mut svg, placed, |svg| draw(svg, index, placed));
        }
        if let Some(bar) = &self.colour_bar {
            let last = placed.last().map_or(first, |p| p.area);
            bar.draw(
                &mut svg,
                Rect {
                    left: first.right() + SPACE_PT,
                    top: first.top,
                    width: BAR_WIDTH_PT,
                    height: last.bottom() - first.top,
                },
            );
        }
        let (rows, widths) = self.legend_rows();
        for row in rows {
            let mut x = 0.5 * (WIDTH_PT - widths.iter().sum::<f64>() + ENTRY_SPACE_PT);
            let y = bottom + 0.5 * LINE * TICK_PT;
            for ((name, style), width) in row.iter().zip(&widths) {
                style.draw_sample(&mut svg, [x, y], SAMPLE_PT);
                svg.text(x + SAMPLE_PT + GAP_PT, y, TICK_PT, Anchor::Start, name);
                x += width;
            }
            bottom += LINE * TICK_PT;
        }
        let room = WIDTH_PT - 2.0 * MARGIN_PT;
        for line in self.notes.iter().flat_map(|n| wrapped(n, TICK_PT, room)) {
            let y = bottom + 0.5 * LINE * TICK_PT;
            svg.text(MARGIN_PT, y, TICK_PT, Anchor::Start, &line);
            bottom += LINE * TICK_PT;
        }
        svg.finish(self.title, bottom + MARGIN_PT)
    }

    /// Positions of the panels.
    pub(super) fn placed_panels(&self) -> Vec<Placed> {
        self.place().0
    }

    /// Positions of the panels, and the upper edge of whatever is below them.
    fn place(&self) -> (Vec<Placed>, f64) {
        // The numbers at the axes depend on the size of the panels, and that size on the width of the numbers. Both are
        // therefore computed iteratively.
        let mut left = 30.0;
        let mut right = 30.0;
        let mut placed = Vec::new();
        let mut bottom = MARGIN_PT;
        for _ in 0..3 {
            (placed, bottom) = self.place_between(left, WIDTH_PT - right);
            let numbers = self.panels.iter().zip(&placed);
            left = numbers.fold(MARGIN_PT + TICK_PT, |left: f64, (panel, placed)| {
                left.max(margin(panel.y_axis, &placed.y, placed.area.height))
            });
            right = match &self.colour_bar {
                None => {
                    let numbers = self.panels.iter().zip(&placed);
                    numbers.fold(MARGIN_PT, |room: f64, (_, p)| room.max(beyond_right_end(p)))
                }
                Some(bar) => {
                    let top = placed.first().map_or(0.0, |p| p.area.top);
                    let end = placed.last().map_or(top, |p| p.area.bottom());
                    SPACE_PT + BAR_WIDTH_PT + margin(bar.axis, &bar.scale, end - top)
                }
            };
        }
        (placed, bottom)
    }

    fn place_between(&self, left: f64, right: f64) -> (Vec<Placed>, f64) {
        let mut top = MARGIN_PT + self.title_lines().len() as f64 * LINE * TITLE_PT + GAP_PT;
        let mut all = Vec::new();
        for panel in &self.panels {
            if !panel.heading.is_empty() {
                top += LINE * LABEL_PT;
            }
            let width = right - left;
            let (height, x, y) = match panel.aspect {
                Aspect::Fill => (panel.height_pt, panel.x.clone(), panel.y.clone()),
                Aspect::Equal => equal_scales(&panel.x, &panel.y, width),
            };
            let area = Rect {
                left,
                top,
                width,
                height,
            };
            top = area.bottom() + TICK_LENGTH_PT + GAP_PT + LINE * TICK_PT;
            if !panel.x_axis.title(0).is_empty() {
                top += LINE * LABEL_PT;
            }
            top += GAP_PT;
            all.push(Placed {
                area,
                x: x.between(area.left, area.right()),
                y: y.between(area.bottom(), area.top),
            });
        }
        (all, top)
    }

    fn title_lines(&self) -> Vec<String> {
        let room = WIDTH_PT - 2.0 * MARGIN_PT;
        let lines = wrapped(self.title, BOLD * TITLE_PT, room).into_iter();
        // A word may be wider than the figure.
        lines
            .map(|line| shortened(&line, BOLD * TITLE_PT, room))
            .collect()
    }

    /// Rows of the legend, as few as possible and of similar length, and the widths of its columns.
    fn legend_rows(&self) -> (Vec<Vec<(String, SeriesStyle)>>, Vec<f64>) {
        let room = WIDTH_PT - 2.0 * MARGIN_PT;
        let entries: Vec<(String, SeriesStyle)> = self
            .legend
            .iter()
            .filter(|(name, _)| !name.is_empty())
            .map(|(name, style)| {
                let name = shortened(name, TICK_PT, room - SAMPLE_PT - GAP_PT);
                (name, *style)
            })
            .collect();
        let widths = |n_columns: usize| -> Vec<f64> {
            let column = |i| entries.iter().skip(i).step_by(n_columns);
            let width = |i| column(i).fold(0.0, |w: f64, (name, _)| w.max(entry_width(name)));
            (0..n_columns).map(width).collect()
        };
        let fits = |n: &usize| {
            let n_rows = entries.len().div_ceil(*n);
            *n == entries.len().div_ceil(n_rows)
                && widths(*n).iter().sum::<f64>() - ENTRY_SPACE_PT <= room
        };
        // One column always fits. A row has at most 20 entries.
        let n_columns = (1..=entries.len().min(20)).rev().find(fits).unwrap_or(1);
        let rows = entries.chunks(n_columns).map(<[_]>::to_vec).collect();
        (rows, widths(n_columns))
    }
}

/// Height and scales of a panel with equal scales on both axes.
fn equal_scales(x: &Scale, y: &Scale, width: f64) -> (f64, Scale, Scale) {
    let [min, max] = EQUAL_HEIGHTS_PT;
    let height = (width * (y.extent() / x.extent())).clamp(min, max);
    let per_pt = (x.extent() / width).max(y.extent() / height);
    let widened = |scale: &Scale, pt: f64| scale.clone().with_extent(per_pt * pt);
    (height, widened(x, width), widened(y, height))
}

fn entry_width(name: &str) -> f64 {
    SAMPLE_PT + GAP_PT + text_width(name, TICK_PT) + ENTRY_SPACE_PT
}

/// Ticks of a vertical axis.
fn upright_ticks(scale: &Scale, height: f64) -> (Vec<Tick>, i32) {
    scale.ticks((height / 20.0) as usize)
}

/// Ticks of a horizontal axis, few enough that their numbers do not touch.
fn level_ticks(scale: &Scale, width: f64) -> (Vec<Tick>, i32) {
    let mut n = (width / 24.0) as usize;
    loop {
        let (ticks, exponent) = scale.ticks(n);
        let widths = ticks.iter().map(|t| text_width(&t.text, TICK_PT));
        if n <= 2 || widths.sum::<f64>() + 5.0 * ticks.len() as f64 <= width {
            return (ticks, exponent);
        }
        n -= 1;
    }
}

/// Distance by which the last number of a horizontal axis extends beyond its right end, with a margin.
fn beyond_right_end(placed: &Placed) -> f64 {
    let (ticks, _) = level_ticks(&placed.x, placed.area.width);
    let ends = ticks.iter().map(|t| {
        let middle = placed.x.to_pt(t.value);
        middle + 0.5 * text_width(&t.text, TICK_PT) - placed.area.right()
    });
    MARGIN_PT + ends.fold(0.0, f64::max)
}

/// Width of the ticks, numbers and label of a vertical axis.
fn margin(axis: &Axis, scale: &Scale, height: f64) -> f64 {
    let (ticks, exponent) = upright_ticks(scale, height);
    let widest = ticks
        .iter()
        .fold(0.0, |w: f64, t| w.max(text_width(&t.text, TICK_PT)));
    let label = match axis.title(exponent).is_empty() {
        true => 0.0,
        false => GAP_PT + LINE * LABEL_PT,
    };
    TICK_LENGTH_PT + GAP_PT + widest + label + MARGIN_PT
}

impl Panel<'_> {
    fn draw(&self, svg: &mut Svg, placed: &Placed, content: impl FnOnce(&mut Svg)) {
        let area = placed.area;
        let middle = area.left + 0.5 * area.width;
        let (x_ticks, x_exponent) = level_ticks(&placed.x, area.width);
        let (y_ticks, y_exponent) = upright_ticks(&placed.y, area.height);
        let y = area.top - 0.5 * LINE * LABEL_PT - 0.5;
        svg.text(middle, y, LABEL_PT, Anchor::Middle, self.heading);
        if self.has_grid {
            let [left, right, top, bottom] = [area.left, area.right(), area.top, area.bottom()];
            let x_lines = x_ticks.iter().map(|t| {
                let x = placed.x.to_pt(t.value);
                segment([x, top], [x, bottom])
            });
            let y_lines = y_ticks.iter().map(|t| {
                let y = placed.y.to_pt(t.value);
                segment([left, y], [right, y])
            });
            let lines: String = x_lines.chain(y_lines).collect();
            if !lines.is_empty() {
                svg.path(&lines, GRID_LINE);
            }
        }
        svg.clipped(area, content);
        if self.is_empty {
            let y = area.top + 0.5 * area.height;
            svg.text(middle, y, LABEL_PT, Anchor::Middle, "no data");
        }
        svg.frame(area, AXIS_LINE);
        let mut marks = String::new();
        for tick in &x_ticks {
            let x = placed.x.to_pt(tick.value);
            marks += &segment([x, area.bottom()], [x, area.bottom() + TICK_LENGTH_PT]);
            let y = area.bottom() + TICK_LENGTH_PT + GAP_PT + 0.5 * TICK_PT;
            svg.text(x, y, TICK_PT, Anchor::Middle, &tick.text);
        }
        for tick in &y_ticks {
            let y = placed.y.to_pt(tick.value);
            marks += &segment([area.left - TICK_LENGTH_PT, y], [area.left, y]);
            let x = area.left - TICK_LENGTH_PT - GAP_PT;
            svg.text(x, y, TICK_PT, Anchor::End, &tick.text);
        }
        if !marks.is_empty() {
            svg.path(&marks, AXIS_LINE);
        }
        let below = area.bottom() + TICK_LENGTH_PT + GAP_PT + LINE * TICK_PT + 0.5 * LABEL_PT;
        svg.text(
            middle,
            below,
            LABEL_PT,
            Anchor::Middle,
            &self.x_axis.title(x_exponent),
        );
        svg.upward_text(
            MARGIN_PT + 0.5 * LABEL_PT,
            area.top + 0.5 * area.height,
            LABEL_PT,
            &self.y_axis.title(y_exponent),
        );
    }
}

impl ColourBar<'_> {
    fn draw(&self, svg: &mut Svg, bar: Rect) {
        let indices: Vec<u8> = (0..=LAST).rev().collect();
        let pixels = Pixels::Indexed {
            palette: &self.colours.palette(),
            indices: &indices,
        };
        // Encoding a column of fixed size into memory cannot fail.
        if let Ok(png) = png_file::encode(1, indices.len(), &pixels, &[]) {
            svg.image(bar, &png);
        }
        svg.frame(bar, AXIS_LINE);
        let scale = self.scale.clone().between(bar.bottom(), bar.top);
        let (ticks, exponent) = upright_ticks(&scale, bar.height);
        let mut marks = String::new();
        for tick in &ticks {
            let y = scale.to_pt(tick.value);
            marks += &segment([bar.right(), y], [bar.right() + TICK_LENGTH_PT, y]);
            let x = bar.right() + TICK_LENGTH_PT + GAP_PT;
            svg.text(x, y, TICK_PT, Anchor::Start, &tick.text);
        }
        if !marks.is_empty() {
            svg.path(&marks, AXIS_LINE);
        }
        svg.upward_text(
            WIDTH_PT - MARGIN_PT - 0.5 * LABEL_PT,
            bar.top + 0.5 * bar.height,
            LABEL_PT,
            &self.axis.title(exponent),
        );
    }
}

/// SVG commands of a straight line segment.
pub(super) fn segment(from: [f64; 2], to: [f64; 2]) -> String {
    let [x1, y1, x2, y2] = [from[0], from[1], to[0], to[1]].map(crate::markup::coordinate);
    format!("M{x1} {y1}L{x2} {y2}")
}
