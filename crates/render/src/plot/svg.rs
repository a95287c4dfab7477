//! Vector shapes and text of a figure.
//!
//! One unit is one point (1/72 inch) on paper. No element has an id, so several figures can be part of one document.

use crate::markup::{coordinate, escape};
use crate::png_file;

/// Width of every figure, pt: 85 mm, one column of a paper.
pub(super) const WIDTH_PT: f64 = 240.94;
const MM_PER_PT: f64 = 25.4 / 72.0;
const FONTS: &str = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif";

/// Colour of text and axes.
pub(super) const INK: &str = "#222";
/// Colour of the grid lines.
pub(super) const GRID: &str = "#e3e3e3";

/// A rectangle on paper, pt, y downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }
}

/// Which part of a text is at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke<'a> {
    pub colour: &'a str,
    pub width_pt: f64,
    /// Lengths of dashes and gaps; empty for a solid line.
    pub dashes: &'a str,
}

/// A figure under construction.
#[derive(Default)]
pub(super) struct Svg {
    body: String,
}

impl Svg {
    /// Returns the SVG file with a white background.
    pub(super) fn finish(self, title: &str, height_pt: f64) -> String {
        let (width, height) = (coordinate(WIDTH_PT), coordinate(height_pt));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}mm\" height=\"{}mm\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"{FONTS}\" fill=\"{INK}\" role=\"img\">\n<title>{}</title>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n{}</svg>\n",
            coordinate(WIDTH_PT * MM_PER_PT),
            coordinate(height_pt * MM_PER_PT),
            escape(title),
            self.body
        )
    }

    /// Text that is vertically centred at `y`: its baseline is 0.35 of its size below.
    pub(super) fn text(&mut self, x: f64, y: f64, size_pt: f64, anchor: Anchor, text: &str) {
        self.styled_text(x, y, size_pt, anchor, "", text);
    }

    pub(super) fn bold_text(&mut self, x: f64, y: f64, size_pt: f64, anchor: Anchor, text: &str) {
        self.styled_text(x, y, size_pt, anchor, " font-weight=\"bold\"", text);
    }

    /// Text that is rotated to read upwards, centred at a position.
    pub(super) fn upward_text(&mut self, x: f64, y: f64, size_pt: f64, text: &str) {
        let turn = format!(
            " transform=\"rotate(-90 {} {})\"",
            coordinate(x),
            coordinate(y)
        );
        self.styled_text(x, y, size_pt, Anchor::Middle, &turn, text);
    }

    fn styled_text(
        &mut self,
        x: f64,
        y: f64,
        size_pt: f64,
        anchor: Anchor,
        style: &str,
        text: &str,
    ) {
        if text.is_empty() {
            return;
        }
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        self.body += &format!(
            "<text x=\"{}\" y=\"{}\" font-size=\"{}\"{anchor}{style}>",
            coordinate(x),
            coordinate(y + 0.35 * size_pt),
            coordinate(size_pt)
        );
        let raise = coordinate(0.35 * size_pt);
        let mut is_raised = false;
        for (part, superscript) in split_superscripts(text) {
            let part = escape(&part.replace('-', if superscript { "\u{2212}" } else { "-" }));
            // A shift applies to all following text, so the text after an exponent is shifted back.
            self.body += &match (superscript, is_raised) {
                (true, _) => format!(
                    "<tspan dy=\"-{raise}\" font-size=\"{}\">{part}</tspan>",
                    coordinate(0.72 * size_pt)
                ),
                (false, true) => format!("<tspan dy=\"{raise}\">{part}</tspan>"),
                (false, false) => part,
            };
            is_raised = superscript;
        }
        self.body += "</text>\n";
    }

    /// A path of SVG commands without fill.
    pub(super) fn path(&mut self, commands: &str, stroke: Stroke) {
        let dashes = match stroke.dashes {
            "" => String::new(),
            dashes => format!(" stroke-dasharray=\"{dashes}\""),
        };
        self.body += &format!(
            "<path d=\"{commands}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"{dashes}/>\n",
            stroke.colour,
            coordinate(stroke.width_pt)
        );
    }

    /// A filled path of SVG commands.
    pub(super) fn filled_path(&mut self, commands: &str, colour: &str) {
        self.body += &format!("<path d=\"{commands}\" fill=\"{colour}\"/>\n");
    }

    pub(super) fn frame(&mut self, area: Rect, stroke: Stroke) {
        self.path(
            &format!(
                "M{} {}H{}V{}H{}Z",
                coordinate(area.left),
                coordinate(area.top),
                coordinate(area.right()),
                coordinate(area.bottom()),
                coordinate(area.left)
            ),
            stroke,
        );
    }

    /// Discs of one colour, slightly transparent.
    pub(super) fn discs(&mut self, centres: &[[f64; 2]], radius_pt: f64, colour: &str) {
        self.body += &format!("<g fill=\"{colour}\" fill-opacity=\"{DISC_OPACITY}\">\n");
        let radius = coordinate(radius_pt);
        for [x, y] in centres {
            let (x, y) = (coordinate(*x), coordinate(*y));
            self.body += &format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>\n");
        }
        self.body += "</g>\n";
    }

    /// A PNG file stretched over an area, without interpolation between pixels.
    pub(super) fn image(&mut self, area: Rect, png: &[u8]) {
        self.body += &format!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
             style=\"image-rendering:pixelated\" href=\"{}\"/>\n",
            coordinate(area.left),
            coordinate(area.top),
            coordinate(area.width),
            coordinate(area.height),
            png_file::data_uri(png)
        );
    }

    /// Clips the shapes drawn by `draw` to an area. Coordinates remain those of the figure.
    pub(super) fn clipped(&mut self, area: Rect, draw: impl FnOnce(&mut Self)) {
        let [x, y, width, height] = [area.left, area.top, area.width, area.height].map(coordinate);
        self.body += &format!(
            "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"{x} {y} {width} {height}\">\n"
        );
        draw(self);
        self.body += "</svg>\n";
    }
}

/// Opacity of a disc.
pub(super) const DISC_OPACITY: f64 = 0.75;

/// Splits a text into parts and marks the exponents, which are integers after a caret.
fn split_superscripts(text: &str) -> Vec<(String, bool)> {
    let mut parts = Vec::new();
    let mut plain = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('^') {
        plain += before;
        let sign = usize::from(after.starts_with('-'));
        let digits = after[sign..].bytes().take_while(u8::is_ascii_digit).count();
        if digits == 0 {
            plain.push('^');
            rest = after;
            continue;
        }
        parts.push((std::mem::take(&mut plain), false));
        parts.push((after[..sign + digits].into(), true));
        rest = &after[sign + digits..];
    }
    parts.push((plain + rest, false));
    parts.retain(|(part, _)| !part.is_empty());
    parts
}

/// Approximate width of a text in Helvetica, pt. Other fonts differ by a few percent.
pub(super) fn text_width(text: &str, size_pt: f64) -> f64 {
    let widths = split_superscripts(text).into_iter().map(|(part, raised)| {
        let width: f64 = part.chars().map(character_width).sum();
        if raised { 0.72 * width } else { width }
    });
    size_pt * widths.sum::<f64>()
}

/// Advance width relative to the font size.
fn character_width(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | '\'' | '|' => 0.22,
        'I' | '.' | ',' | ':' | ';' | '!' | ' ' | '/' | 'f' | 't' => 0.28,
        'r' | '(' | ')' | '[' | ']' | '-' | '"' | '`' => 0.34,
        'm' | 'M' => 0.84,
        'W' | '%' | '@' => 0.94,
        'w' => 0.72,
        'A'..='Z' => 0.68,
        'c' | 'k' | 's' | 'v' | 'x' | 'y' | 'z' => 0.5,
        '\u{2212}' | '+' | '<' | '>' | '=' | '~' => 0.58,
        c if c.is_ascii() => 0.556,
        // Characters of other scripts may be as wide as high.
        c if (c as u32) < 0x2000 => 0.62,
        _ => 1.0,
    }
}

/// Breaks a text between words into lines of a maximum width, pt, as far as the words allow.
pub(super) fn wrapped(text: &str, size_pt: f64, width_pt: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size_pt) <= width_pt => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

/// Shortens a text to a maximum width, pt. An ellipsis marks the omission.
pub(super) fn shortened(text: &str, size_pt: f64, width_pt: f64) -> String {
    if text_width(text, size_pt) <= width_pt {
        return text.into();
    }
    let mut width = text_width("\u{2026}", size_pt);
    let fits = text.chars().take_while(|c| {
        width += size_pt * character_width(*c);
        width <= width_pt
    });
    fits.chain(['\u{2026}']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_after_a_caret_are_raised() {
        let mut svg = Svg::default();
        svg.text(0.0, 0.0, 10.0, Anchor::Start, "dB m^2/m^-3 ^x");
        assert_eq!(
            svg.body,
            "<text x=\"0\" y=\"3.5\" font-size=\"10\">dB m<tspan dy=\"-3.5\" font-size=\"7.2\">2</tspan>\
             <tspan dy=\"3.5\">/m</tspan><tspan dy=\"-3.5\" font-size=\"7.2\">\u{2212}3</tspan>\
             <tspan dy=\"3.5\"> ^x</tspan></text>\n"
        );
    }

    #[test]
    fn long_texts_are_wrapped_or_shortened() {
        let text = "a title that is longer than its figure";
        let lines = wrapped(text, 8.0, 70.0);
        assert!(lines.len() == 2 || lines.len() == 3, "{lines:?}");
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| text_width(line, 8.0) <= 70.0));
        let short = shortened(text, 8.0, 70.0);
        assert!(short.ends_with('\u{2026}') && text_width(&short, 8.0) <= 70.0);
        assert_eq!(shortened("short", 8.0, 70.0), "short");
        assert!(wrapped("", 8.0, 70.0).is_empty());
    }
}
