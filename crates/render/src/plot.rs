//! Plots as PNG: heat maps, point scatters, lines, bars; axes with numbers and units.
//!
//! Plain pictures for documents and reports, drawn without any font or plotting library.

mod canvas;
mod font;

use canvas::{Align, Area, BLACK, CHAR_HEIGHT, CHAR_WIDTH, Canvas, Span};
use radarllm_base::{PointFrame, RadarPoint};

/// Picture size, pixels.
const WIDTH: usize = 960;
const HEIGHT: usize = 640;
/// Room for axis numbers and labels, pixels.
const LEFT: usize = 120;
const BELOW: usize = 64;
const ABOVE: usize = 44;

/// Why a plot cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The values do not fill the rectangle.
    #[error("a map of {n_rows} x {n_cols} needs as many values and at least one, found {found}")]
    Shape {
        /// Rows.
        n_rows: usize,
        /// Columns.
        n_cols: usize,
        /// Values given.
        found: usize,
    },
    /// Labels and values, or the values of two axes, do not pair up.
    #[error("{what}: {left} against {right}")]
    Pairs {
        /// What should pair up.
        what: &'static str,
        /// Length of the first.
        left: usize,
        /// Length of the second.
        right: usize,
    },
    /// An axis end is not a number, or both ends are equal.
    #[error("axis `{label}` from {first} to {last}")]
    Axis {
        /// Label of the axis.
        label: String,
        /// First end.
        first: f64,
        /// Last end.
        last: f64,
    },
    /// The PNG encoder failed.
    #[error("png: {0}")]
    Encode(#[from] png::EncodingError),
}

/// A rectangle of values with its axes.
#[derive(Clone, Debug)]
pub struct Heatmap {
    n_rows: usize,
    n_cols: usize,
    values: Vec<f32>,
    rows: Span,
    cols: Span,
    value_label: String,
}

impl Heatmap {
    /// Values `[row, column]`, column fastest. Row 0 is drawn at the bottom, column 0 at the left;
    /// values that are not finite are drawn grey.
    pub fn new(n_rows: usize, n_cols: usize, values: Vec<f32>) -> Self {
        let axis = |label: &str, n: usize| Span {
            label: label.into(),
            first: 0.0,
            last: n as f64,
        };
        Self {
            n_rows,
            n_cols,
            values,
            rows: axis("row", n_rows.saturating_sub(1)),
            cols: axis("column", n_cols.saturating_sub(1)),
            value_label: "dB".into(),
        }
    }

    /// Label of the row axis and the values at the centres of the first and the last row.
    pub fn rows(mut self, label: &str, first: f64, last: f64) -> Self {
        self.rows = Span {
            label: label.into(),
            first,
            last,
        };
        self
    }

    /// Label of the column axis and the values at the centres of the first and the last column.
    pub fn cols(mut self, label: &str, first: f64, last: f64) -> Self {
        self.cols = Span {
            label: label.into(),
            first,
            last,
        };
        self
    }

    /// Unit shown at the colour bar; "dB" if not called.
    pub fn value_label(mut self, label: &str) -> Self {
        self.value_label = label.into();
        self
    }
}

/// A named curve.
#[derive(Clone, Debug)]
pub struct Series<'a> {
    /// Name in the legend; empty for none.
    pub name: &'a str,
    /// Horizontal values.
    pub x: &'a [f64],
    /// Vertical values, as many; not finite leaves a gap.
    pub y: &'a [f64],
    /// Lower and upper end of an interval around each value, drawn as a bar; none if empty.
    pub intervals: &'a [[f64; 2]],
}

/// Draws a heat map with a colour bar.
///
/// # Errors
/// Values that do not fill the map, or an axis without extent.
pub fn map_png(map: &Heatmap, title: &str) -> Result<Vec<u8>, PlotError> {
    let n = map.n_rows.checked_mul(map.n_cols);
    if n != Some(map.values.len()) || map.values.is_empty() {
        let (n_rows, n_cols, found) = (map.n_rows, map.n_cols, map.values.len());
        return Err(PlotError::Shape {
            n_rows,
            n_cols,
            found,
        });
    }
    let (rows, cols) = (
        cell_edges(&map.rows, map.n_rows)?,
        cell_edges(&map.cols, map.n_cols)?,
    );
    let colours = Span::around(&map.value_label, map.values.iter().map(|v| f64::from(*v)));
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let area = Area {
        left: LEFT,
        top: ABOVE,
        width: WIDTH - LEFT - 150,
        height: HEIGHT - ABOVE - BELOW,
    };
    for py in 0..area.height {
        let row = (area.height - 1 - py) * map.n_rows / area.height;
        for px in 0..area.width {
            let value = f64::from(map.values[row * map.n_cols + px * map.n_cols / area.width]);
            let rgb = if value.is_finite() {
                viridis(colours.fraction(value))
            } else {
                [128; 3]
            };
            canvas.set((area.left + px) as i64, (area.top + py) as i64, rgb);
        }
    }
    axes(&mut canvas, area, &cols, &rows, title);

    // The bar's numbers stand on its right: a left axis of an area shifted by their width.
    let bar = Area {
        left: WIDTH - 130,
        width: 22,
        ..area
    };
    for py in 0..bar.height {
        let rgb = viridis(1.0 - py as f64 / (bar.height - 1) as f64);
        canvas.fill(
            Area {
                top: bar.top + py,
                height: 1,
                ..bar
            },
            rgb,
        );
    }
    canvas.frame(bar);
    for (value, text) in canvas::ticks(&colours, bar.height / 60) {
        let y = bar.top as f64 + (1.0 - colours.fraction(value)) * bar.height as f64;
        let right = (bar.left + bar.width) as f64;
        canvas.line((right, y), (right + 6.0, y), BLACK, 1);
        let top = (y.round() as usize).saturating_sub(CHAR_HEIGHT / 2);
        canvas.text(&text, bar.left + bar.width + 10, top, Align::Left);
    }
    let below = bar.top + bar.height + 10;
    canvas.text(
        &map.value_label,
        bar.left + bar.width / 2,
        below,
        Align::Middle,
    );
    Ok(canvas.encode()?)
}

/// Draws points from above (x to the right, y upwards in the picture) and from the side (y to the
/// right, z upwards), coloured by radial velocity: blue approaches, red recedes.
///
/// # Errors
/// Only from the PNG encoder; points that are not finite are left out.
pub fn points_png(points: &[RadarPoint], title: &str) -> Result<Vec<u8>, PlotError> {
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let gap = LEFT + 10;
    let width = (WIDTH - LEFT - gap - 30) / 2;
    let height = HEIGHT - ABOVE - BELOW - CHAR_HEIGHT - 12;
    let top = ABOVE + CHAR_HEIGHT + 12;
    let xyz = |p: &RadarPoint| [p.x_m, p.y_m, p.z_m].map(f64::from);
    let fastest = points
        .iter()
        .map(|p| p.velocity_mps.abs())
        .filter(|v| v.is_finite());
    let fastest = f64::from(fastest.fold(0.1_f32, f32::max));
    for (panel, (a, b, names, heading)) in [
        (0, 1, ["x (m)", "y (m)"], "from above"),
        (1, 2, ["y (m)", "z (m)"], "from the side"),
    ]
    .into_iter()
    .enumerate()
    {
        let area = Area {
            left: LEFT + panel * (width + gap),
            top,
            width,
            height,
        };
        let [below, left] = equal_scale(
            Span::around(names[0], points.iter().map(|p| xyz(p)[a])),
            Span::around(names[1], points.iter().map(|p| xyz(p)[b])),
            area,
        );
        canvas.grid(area, &below, &left);
        for point in points {
            let (u, v) = (below.fraction(xyz(point)[a]), left.fraction(xyz(point)[b]));
            if u.is_finite() && v.is_finite() {
                let x = area.left as f64 + u * area.width as f64;
                let y = area.top as f64 + (1.0 - v) * area.height as f64;
                let speed = f64::from(point.velocity_mps) / fastest;
                canvas.dot(x, y, blue_red(speed), 5);
            }
        }
        let label = if panel == 0 { title } else { "" };
        axes(&mut canvas, area, &below, &left, "");
        canvas.text(label, WIDTH / 2, 12, Align::Middle);
        canvas.text(heading, area.left + area.width / 2, ABOVE, Align::Middle);
    }
    Ok(canvas.encode()?)
}

/// Draws points over time: range on the left, x (to the right of the radar) on the right, coloured by radial velocity as in
/// [`points_png`].
///
/// # Errors
/// Only from the PNG encoder; points that are not finite are left out.
pub fn points_over_time_png(frames: &[PointFrame], title: &str) -> Result<Vec<u8>, PlotError> {
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let gap = LEFT + 10;
    let width = (WIDTH - LEFT - gap - 30) / 2;
    let points = || {
        let of_frame = |f: &'_ PointFrame| f.points.iter().map(|p| (f.time_s, *p)).collect();
        frames
            .iter()
            .flat_map(move |f| -> Vec<(f64, RadarPoint)> { of_frame(f) })
    };
    let fastest = points().map(|(_, p)| p.velocity_mps.abs());
    let fastest = fastest.filter(|v| v.is_finite()).fold(0.1_f32, f32::max);
    let below = Span::around("time (s)", frames.iter().map(|f| f.time_s));
    for (panel, label) in ["range (m)", "x (m)"].into_iter().enumerate() {
        let value = |p: &RadarPoint| if panel == 0 { p.range_m } else { p.x_m };
        let area = Area {
            left: LEFT + panel * (width + gap),
            top: ABOVE,
            width,
            height: HEIGHT - ABOVE - BELOW,
        };
        let left = padded(Span::around(
            label,
            points().map(|(_, p)| f64::from(value(&p))),
        ));
        canvas.grid(area, &below, &left);
        for (time_s, point) in points() {
            let (u, v) = (
                below.fraction(time_s),
                left.fraction(f64::from(value(&point))),
            );
            if u.is_finite() && v.is_finite() {
                let x = area.left as f64 + u * area.width as f64;
                let y = area.top as f64 + (1.0 - v) * area.height as f64;
                let speed = f64::from(point.velocity_mps / fastest);
                canvas.dot(x, y, blue_red(speed), 3);
            }
        }
        axes(&mut canvas, area, &below, &left, "");
    }
    canvas.text(title, WIDTH / 2, 12, Align::Middle);
    Ok(canvas.encode()?)
}

/// Draws curves over one pair of axes, with a legend for the named ones.
///
/// # Errors
/// A series with unlike numbers of x, y and intervals.
pub fn lines_png(
    series: &[Series<'_>],
    x_label: &str,
    y_label: &str,
    title: &str,
) -> Result<Vec<u8>, PlotError> {
    if let Some(s) = series.iter().find(|s| s.x.len() != s.y.len()) {
        return Err(PlotError::Pairs {
            what: "x and y of a series",
            left: s.x.len(),
            right: s.y.len(),
        });
    }
    let unlike = |s: &&Series| !s.intervals.is_empty() && s.intervals.len() != s.y.len();
    if let Some(s) = series.iter().find(unlike) {
        return Err(PlotError::Pairs {
            what: "y and intervals of a series",
            left: s.y.len(),
            right: s.intervals.len(),
        });
    }
    let below = Span::around(x_label, series.iter().flat_map(|s| s.x.iter().copied()));
    let has_bars = series.iter().any(|s| !s.intervals.is_empty());
    let below = if has_bars { padded(below) } else { below };
    let heights = series
        .iter()
        .flat_map(|s| s.y.iter().chain(s.intervals.as_flattened()).copied());
    let left = padded(Span::around(y_label, heights));
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let area = Area {
        left: LEFT,
        top: ABOVE,
        width: WIDTH - LEFT - 30,
        height: HEIGHT - ABOVE - BELOW,
    };
    canvas.grid(area, &below, &left);
    for (i, s) in series.iter().enumerate() {
        let mut last: Option<(f64, f64)> = None;
        for (x, y) in s.x.iter().zip(s.y) {
            let (u, v) = (below.fraction(*x), left.fraction(*y));
            if !(u.is_finite() && v.is_finite()) {
                last = None;
                continue;
            }
            let here = (
                area.left as f64 + u * area.width as f64,
                area.top as f64 + (1.0 - v) * area.height as f64,
            );
            canvas.line(last.unwrap_or(here), here, PALETTE[i % PALETTE.len()], 2);
            last = Some(here);
        }
        for (x, ends) in s.x.iter().zip(s.intervals) {
            // Bars of several curves at one place stand side by side.
            let x = area.left as f64 + below.fraction(*x) * area.width as f64 + 4.0 * i as f64;
            let [low, high] =
                ends.map(|y| area.top as f64 + (1.0 - left.fraction(y)) * area.height as f64);
            if x.is_finite() && low.is_finite() && high.is_finite() {
                canvas.line((x, low), (x, high), PALETTE[i % PALETTE.len()], 1);
            }
        }
    }
    let named = series
        .iter()
        .enumerate()
        .filter(|(_, s)| !s.name.is_empty());
    for (line, (i, s)) in named.enumerate() {
        let y = area.top + 12 + line * (CHAR_HEIGHT + 6);
        let x = area.left + area.width - 12;
        canvas.text(s.name, x, y, Align::Right);
        let start = x.saturating_sub(s.name.chars().count() * CHAR_WIDTH + 40) as f64;
        let middle = (y + CHAR_HEIGHT / 2) as f64;
        canvas.line(
            (start, middle),
            (start + 30.0, middle),
            PALETTE[i % PALETTE.len()],
            4,
        );
    }
    axes(&mut canvas, area, &below, &left, title);
    Ok(canvas.encode()?)
}

/// Draws one bar per label, from zero.
///
/// # Errors
/// Unlike numbers of labels and values.
pub fn bars_png(
    labels: &[&str],
    values: &[f64],
    y_label: &str,
    title: &str,
) -> Result<Vec<u8>, PlotError> {
    if labels.len() != values.len() {
        let (left, right) = (labels.len(), values.len());
        return Err(PlotError::Pairs {
            what: "labels and values",
            left,
            right,
        });
    }
    let left = padded(Span::around(y_label, values.iter().copied().chain([0.0])));
    let below = Span {
        label: String::new(),
        first: 0.0,
        last: 1.0,
    };
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let area = Area {
        left: LEFT,
        top: ABOVE,
        width: WIDTH - LEFT - 30,
        height: HEIGHT - ABOVE - BELOW,
    };
    canvas.grid(area, &Span { last: 0.0, ..below }, &left);
    let slot = area.width as f64 / labels.len().max(1) as f64;
    let y_of = |v: f64| area.top as f64 + (1.0 - left.fraction(v)) * area.height as f64;
    for (i, (label, value)) in labels.iter().zip(values).enumerate() {
        let x = area.left as f64 + (i as f64 + 0.5) * slot;
        if value.is_finite() {
            let (top, bottom) = (y_of(value.max(0.0)), y_of(value.min(0.0)));
            let bar = Area {
                left: (x - 0.35 * slot).round() as usize,
                top: top.round() as usize,
                width: (0.7 * slot).round().max(1.0) as usize,
                height: (bottom - top).round() as usize,
            };
            canvas.fill(bar, PALETTE[0]);
        }
        // Long labels are cut to their slot rather than written over each other.
        let fits = (slot as usize / CHAR_WIDTH).max(1);
        let label: String = label.chars().take(fits).collect();
        canvas.text(
            &label,
            x.round() as usize,
            area.top + area.height + 10,
            Align::Middle,
        );
    }
    canvas.frame(area);
    canvas.axis_left(area, &left);
    canvas.text(title, WIDTH / 2, 12, Align::Middle);
    Ok(canvas.encode()?)
}

/// Distinct colours for curves; distinguishable without colour vision by lightness.
const PALETTE: [[u8; 3]; 6] = [
    [31, 90, 160],
    [214, 96, 20],
    [30, 130, 76],
    [120, 60, 150],
    [170, 30, 50],
    [90, 90, 90],
];

fn axes(canvas: &mut Canvas, area: Area, below: &Span, left: &Span, title: &str) {
    canvas.frame(area);
    canvas.axis_below(area, below);
    canvas.axis_left(area, left);
    canvas.text(title, WIDTH / 2, 12, Align::Middle);
}

/// From the centres of the first and last cell to their outer edges.
fn cell_edges(span: &Span, n: usize) -> Result<Span, PlotError> {
    let (first, last) = (span.first, span.last);
    let step = if n > 1 {
        (last - first) / (n - 1) as f64
    } else {
        1.0
    };
    if !(first.is_finite() && last.is_finite() && step != 0.0) {
        return Err(PlotError::Axis {
            label: span.label.clone(),
            first,
            last,
        });
    }
    Ok(Span {
        label: span.label.clone(),
        first: first - 0.5 * step,
        last: last + 0.5 * step,
    })
}

fn padded(span: Span) -> Span {
    let extra = 0.05 * (span.last - span.first);
    Span {
        first: span.first - extra,
        last: span.last + extra,
        ..span
    }
}

/// Widens one of two spans so that a metre is as long on both axes, with some room around.
fn equal_scale(below: Span, left: Span, area: Area) -> [Span; 2] {
    let (w, h) = (area.width as f64, area.height as f64);
    let per_pixel = 1.1 * ((below.last - below.first) / w).max((left.last - left.first) / h);
    let widen = |s: Span, pixels: f64| {
        let (middle, half) = (0.5 * (s.first + s.last), 0.5 * per_pixel * pixels);
        Span {
            first: middle - half,
            last: middle + half,
            ..s
        }
    };
    [widen(below, w), widen(left, h)]
}

/// Colour of 0..=1 from dark violet to yellow: nine anchors of the viridis map, linear between.
fn viridis(fraction: f64) -> [u8; 3] {
    const ANCHORS: [[u8; 3]; 9] = [
        [68, 1, 84],
        [71, 44, 122],
        [59, 81, 139],
        [44, 113, 142],
        [33, 144, 141],
        [39, 173, 129],
        [92, 200, 99],
        [170, 220, 50],
        [253, 231, 37],
    ];
    let place = fraction.clamp(0.0, 1.0) * 8.0;
    let i = (place as usize).min(7);
    mix(ANCHORS[i], ANCHORS[i + 1], place - i as f64)
}

/// Colour of -1..=1: blue, grey, red.
fn blue_red(value: f64) -> [u8; 3] {
    let value = if value.is_finite() {
        value.clamp(-1.0, 1.0)
    } else {
        0.0
    };
    let end = if value < 0.0 {
        [20, 80, 200]
    } else {
        [200, 40, 30]
    };
    mix([150, 150, 150], end, value.abs())
}

fn mix(a: [u8; 3], b: [u8; 3], f: f64) -> [u8; 3] {
    [0, 1, 2].map(|i| (f64::from(a[i]) * (1.0 - f) + f64::from(b[i]) * f).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(png: &[u8]) -> (usize, usize, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .unwrap();
        let mut data = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut data).unwrap();
        (info.width as usize, info.height as usize, data)
    }

    #[test]
    fn maps_put_row_zero_at_the_bottom_and_column_zero_at_the_left() {
        let mut values = vec![0.0; 12];
        values[2] = 1.0; // row 0, column 2 of 3: bottom right
        let map = Heatmap::new(4, 3, values)
            .rows("r (m)", 0.0, 3.0)
            .cols("v (m/s)", -1.0, 1.0);
        let (w, h, data) = pixels(&map_png(&map, "title").unwrap());
        assert_eq!((w, h), (WIDTH, HEIGHT));
        let yellow: Vec<usize> = (0..w * h)
            .filter(|i| data[i * 3..i * 3 + 3] == [253, 231, 37] && i % w < WIDTH - 140)
            .collect();
        // A third of the width times a quarter of the height, exactly, less the frame's line.
        let (width, height) = (WIDTH - LEFT - 150, HEIGHT - ABOVE - BELOW);
        assert!(
            yellow.len().abs_diff(width * height / 12) < 2 * (width + height),
            "{}",
            yellow.len()
        );
        let right_of = LEFT + width * 2 / 3 - 1;
        let below = ABOVE + height * 3 / 4 - 1;
        assert!(yellow.iter().all(|i| i % w >= right_of && i / w >= below));
    }

    #[test]
    fn points_to_the_right_are_drawn_to_the_right() {
        let point = |x_m, velocity_mps| RadarPoint {
            x_m,
            y_m: 3.0,
            velocity_mps,
            ..Default::default()
        };
        let (w, _, data) = pixels(&points_png(&[point(-1.0, -1.0), point(1.0, 1.0)], "p").unwrap());
        let mean_x = |rgb: [u8; 3]| {
            let xs: Vec<usize> = (0..data.len() / 3)
                .filter(|i| data[i * 3..i * 3 + 3] == rgb && i % w < w / 2)
                .map(|i| i % w)
                .collect();
            assert!(!xs.is_empty());
            xs.iter().sum::<usize>() / xs.len()
        };
        assert!(mean_x([200, 40, 30]) > mean_x([20, 80, 200]) + 100);
    }

    #[test]
    fn later_points_are_drawn_to_the_right_and_farther_ones_higher() {
        let frame = |time_s: f64, range_m: f32, velocity_mps: f32| PointFrame {
            time_s,
            points: vec![RadarPoint {
                range_m,
                velocity_mps,
                ..RadarPoint::default()
            }],
            ..PointFrame::default()
        };
        let frames = [frame(0.0, 2.0, -1.0), frame(1.0, 4.0, 1.0)];
        let (w, _, data) = pixels(&points_over_time_png(&frames, "t").unwrap());
        let mean = |rgb: [u8; 3]| {
            let places: Vec<(usize, usize)> = (0..data.len() / 3)
                .filter(|i| data[i * 3..i * 3 + 3] == rgb && i % w < w / 2)
                .map(|i| (i % w, i / w))
                .collect();
            assert!(!places.is_empty());
            let n = places.len();
            (
                places.iter().map(|p| p.0).sum::<usize>() / n,
                places.iter().map(|p| p.1).sum::<usize>() / n,
            )
        };
        let (early, late) = (mean([20, 80, 200]), mean([200, 40, 30]));
        assert!(
            late.0 > early.0 + 100 && late.1 + 100 < early.1,
            "{early:?} {late:?}"
        );
    }

    #[test]
    fn bad_input_is_refused_or_left_out_and_never_a_panic() {
        assert!(map_png(&Heatmap::new(2, 2, vec![0.0; 3]), "").is_err());
        assert!(map_png(&Heatmap::new(0, 0, vec![]), "").is_err());
        assert!(map_png(&Heatmap::new(usize::MAX, 2, vec![0.0]), "").is_err());
        let map = Heatmap::new(2, 2, vec![0.0; 4]);
        assert!(map_png(&map.clone().rows("r", f64::NAN, 1.0), "").is_err());
        assert!(map_png(&map.rows("r", 1.0, 1.0), "").is_err());
        assert!(map_png(&Heatmap::new(1, 2, vec![f32::NAN, f32::INFINITY]), "").is_ok());
        assert!(map_png(&Heatmap::new(1, 1, vec![3.0]), "\u{1F600}").is_ok());
        let odd = RadarPoint {
            x_m: f32::NAN,
            y_m: f32::INFINITY,
            ..Default::default()
        };
        assert!(points_png(&[odd], "").is_ok() && points_png(&[], "").is_ok());
        let frame = PointFrame {
            time_s: f64::NAN,
            points: vec![odd, RadarPoint::default()],
            ..PointFrame::default()
        };
        assert!(points_over_time_png(&[frame, PointFrame::default()], "").is_ok());
        assert!(points_over_time_png(&[], "").is_ok());
        let far = RadarPoint {
            x_m: f32::MAX,
            y_m: -f32::MAX,
            ..Default::default()
        };
        assert!(points_png(&[far, RadarPoint::default()], "").is_ok());
        let s = |y| {
            [Series {
                name: "s",
                x: &[0.0, 1.0, 2.0],
                y,
                intervals: &[],
            }]
        };
        assert!(lines_png(&s(&[1.0]), "", "", "").is_err());
        assert!(lines_png(&s(&[1.0, f64::NAN, 2.0]), "", "", "").is_ok());
        assert!(lines_png(&[], "", "", "").is_ok());
        let mut with_bars = s(&[1.0, 2.0, 3.0]);
        with_bars[0].intervals = &[[0.0, f64::NAN], [1.5, 4.0], [3.0, 3.0]];
        assert!(lines_png(&with_bars, "", "", "").is_ok());
        with_bars[0].intervals = &[[0.0, 1.0]];
        assert!(lines_png(&with_bars, "", "", "").is_err());
        assert!(bars_png(&["a"], &[], "", "").is_err() && bars_png(&[], &[], "", "").is_ok());
        assert!(bars_png(&["a", "b"], &[-1.0, f64::NAN], "", "").is_ok());
    }
}
