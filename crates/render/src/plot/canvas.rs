//! Pixels, lines, text and axes: what every plot is drawn with.

use super::font;

/// Text is drawn with square dots of this many pixels.
const DOT: usize = 2;
/// Width of a character with its gap, pixels.
pub const CHAR_WIDTH: usize = (font::WIDTH + 1) * DOT;
/// Height of a character, pixels.
pub const CHAR_HEIGHT: usize = font::HEIGHT * DOT;

pub const BLACK: [u8; 3] = [25, 25, 30];
pub const GRID: [u8; 3] = [222, 224, 228];
const WHITE: [u8; 3] = [255, 255, 255];

/// A rectangle of pixels: left, top, width, height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

/// Horizontal alignment of text about its x.
#[derive(Clone, Copy, PartialEq)]
pub enum Align {
    Left,
    Middle,
    Right,
}

/// Values from one end of an axis to the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    pub label: String,
    pub first: f64,
    pub last: f64,
}

impl Span {
    /// A span that holds all finite values, widened if they are equal; (0, 1) if there is none.
    pub fn around(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite()) {
            first = first.min(v);
            last = last.max(v);
        }
        if first > last {
            (first, last) = (0.0, 1.0);
        }
        if last - first < 1e-9 * first.abs().max(1e-9) {
            let half = 0.5 * first.abs().max(1.0);
            (first, last) = (first - half, last + half);
        }
        Self {
            label: label.into(),
            first,
            last,
        }
    }

    /// Where a value lies, 0 at the first end and 1 at the last.
    pub fn fraction(&self, value: f64) -> f64 {
        (value - self.first) / (self.last - self.first)
    }
}

/// An RGB picture being drawn.
pub struct Canvas {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Canvas {
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            rgb: WHITE.repeat(width * height),
        }
    }

    /// The picture as a PNG file.
    pub fn encode(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()?;
        Ok(out)
    }

    /// Sets one pixel; outside is ignored.
    pub fn set(&mut self, x: i64, y: i64, rgb: [u8; 3]) {
        let (w, h) = (self.width as i64, self.height as i64);
        if (0..w).contains(&x) && (0..h).contains(&y) {
            let i = (y * w + x) as usize * 3;
            self.rgb[i..i + 3].copy_from_slice(&rgb);
        }
    }

    pub fn fill(&mut self, area: Area, rgb: [u8; 3]) {
        for y in area.top..area.top + area.height {
            for x in area.left..area.left + area.width {
                self.set(x as i64, y as i64, rgb);
            }
        }
    }

    pub fn frame(&mut self, area: Area) {
        let (l, t) = (area.left as f64, area.top as f64);
        let (r, b) = (l + area.width as f64, t + area.height as f64);
        for (from, to) in [
            ((l, t), (r, t)),
            ((r, t), (r, b)),
            ((r, b), (l, b)),
            ((l, b), (l, t)),
        ] {
            self.line(from, to, BLACK, 1);
        }
    }

    /// A straight line of square dots.
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), rgb: [u8; 3], dot: i64) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        // Callers clip to the picture, so this is at most a few thousand.
        let n = dx.abs().max(dy.abs()).ceil().clamp(1.0, 20_000.0) as usize;
        for i in 0..=n {
            let f = i as f64 / n as f64;
            self.dot(from.0 + f * dx, from.1 + f * dy, rgb, dot);
        }
    }

    pub fn dot(&mut self, x: f64, y: f64, rgb: [u8; 3], size: i64) {
        let (left, top) = (x.round() as i64 - size / 2, y.round() as i64 - size / 2);
        for py in 0..size {
            for px in 0..size {
                self.set(left + px, top + py, rgb);
            }
        }
    }

    /// One line of text with its top at `y`.
    pub fn text(&mut self, text: &str, x: usize, y: usize, align: Align) {
        let width = text.chars().count() * CHAR_WIDTH;
        let shift = match align {
            Align::Left => 0,
            Align::Middle => width / 2,
            Align::Right => width,
        };
        let start = x as i64 - shift as i64;
        self.glyphs(text, |dx, dy| (start + dx, y as i64 + dy));
    }

    /// One line of text that reads upwards, its left edge at `x`, its middle at `y`.
    pub fn text_upwards(&mut self, text: &str, x: usize, y: usize) {
        let start = y as i64 + (text.chars().count() * CHAR_WIDTH / 2) as i64;
        self.glyphs(text, |dx, dy| (x as i64 + dy, start - dx));
    }

    fn glyphs(&mut self, text: &str, place: impl Fn(i64, i64) -> (i64, i64)) {
        for (i, c) in text.chars().enumerate() {
            // A filled box shows a missing character rather than hiding it.
            let pixels = font::glyph(c).or((c != ' ').then_some(&[b'#'; 35]));
            let Some(pixels) = pixels else { continue };
            for (p, _) in pixels.iter().enumerate().filter(|(_, v)| **v == b'#') {
                let column = i * CHAR_WIDTH + p % font::WIDTH * DOT;
                let row = p / font::WIDTH * DOT;
                for k in 0..DOT * DOT {
                    let (x, y) = place((column + k % DOT) as i64, (row + k / DOT) as i64);
                    self.set(x, y, BLACK);
                }
            }
        }
    }

    /// Ticks, numbers and label below an area.
    pub fn axis_below(&mut self, area: Area, span: &Span) {
        let bottom = area.top + area.height;
        for (value, text) in ticks(span, area.width / 90) {
            let x = area.left as f64 + span.fraction(value) * area.width as f64;
            self.line((x, bottom as f64), (x, bottom as f64 + 6.0), BLACK, 1);
            self.text(&text, x.round() as usize, bottom + 10, Align::Middle);
        }
        self.text(
            &span.label,
            area.left + area.width / 2,
            bottom + 34,
            Align::Middle,
        );
    }

    /// Ticks, numbers and label to the left of an area.
    pub fn axis_left(&mut self, area: Area, span: &Span) {
        for (value, text) in ticks(span, area.height / 50) {
            let y = area.top as f64 + (1.0 - span.fraction(value)) * area.height as f64;
            self.line((area.left as f64 - 6.0, y), (area.left as f64, y), BLACK, 1);
            let top = (y.round() as usize).saturating_sub(CHAR_HEIGHT / 2);
            self.text(&text, area.left.saturating_sub(8), top, Align::Right);
        }
        let x = area.left.saturating_sub(8 + 7 * CHAR_WIDTH);
        self.text_upwards(
            &span.label,
            x.saturating_sub(CHAR_HEIGHT),
            area.top + area.height / 2,
        );
    }

    /// Faint lines at the ticks of both axes.
    pub fn grid(&mut self, area: Area, below: &Span, left: &Span) {
        let (l, t) = (area.left as f64, area.top as f64);
        let (w, h) = (area.width as f64, area.height as f64);
        for (value, _) in ticks(below, area.width / 90) {
            let x = l + below.fraction(value) * w;
            self.line((x, t), (x, t + h), GRID, 1);
        }
        for (value, _) in ticks(left, area.height / 50) {
            let y = t + (1.0 - left.fraction(value)) * h;
            self.line((l, y), (l + w, y), GRID, 1);
        }
    }
}

/// Round values inside a span, about `n` of them, with their text: steps of 1, 2 or 5 times a power
/// of ten.
pub fn ticks(span: &Span, n: usize) -> Vec<(f64, String)> {
    let (low, high) = (span.first.min(span.last), span.first.max(span.last));
    let rough = (high - low) / n.clamp(4, 20) as f64;
    if !(rough.is_finite() && rough > 0.0) {
        return vec![];
    }
    let decade = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * decade)
        .into_iter()
        .find(|s| *s >= rough * 0.999);
    let step = step.unwrap_or(10.0 * decade);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (low / step - 1e-6).ceil();
    let last = (high / step + 1e-6).floor();
    // At most 20 steps of `rough` fit; the bound guards against rounding of huge spans.
    (0..=((last - first).clamp(0.0, 40.0) as usize))
        .map(|i| {
            let value = (first + i as f64) * step;
            // Adding zero turns -0 into 0.
            let value = value + 0.0;
            let plain = format!("{value:.decimals$}");
            let text = if plain.len() > 7 {
                format!("{value:.0e}")
            } else {
                plain
            };
            (value, text)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let span = |first, last| Span {
            label: String::new(),
            first,
            last,
        };
        let text = |s: Span, n| ticks(&s, n).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(text(span(0.0, 10.0), 5), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(text(span(-4.386, 4.317), 5), ["-4", "-2", "0", "2", "4"]);
        assert_eq!(
            text(span(0.3, 0.5), 4),
            ["0.30", "0.35", "0.40", "0.45", "0.50"]
        );
        // Falling axes have the same ticks.
        assert_eq!(text(span(10.0, 0.0), 5).len(), 6);
        assert!(ticks(&span(1.0, 1.0), 5).is_empty());
    }
}
