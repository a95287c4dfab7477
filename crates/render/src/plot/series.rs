//! Style that distinguishes a series from others: colour, dashes, marker.

use super::{
    colours::{DASHES, SERIES},
    figure::segment,
    svg::{Stroke, Svg},
};
use crate::markup::coordinate;

/// Style of one of several series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SeriesStyle {
    index: usize,
    width_pt: f64,
    has_markers: bool,
}

const MARKER_RADIUS_PT: f64 = 1.9;

impl SeriesStyle {
    pub(super) fn new(index: usize, width_pt: f64, has_markers: bool) -> Self {
        Self {
            index,
            width_pt,
            has_markers,
        }
    }

    pub(super) fn colour(&self) -> &'static str {
        SERIES[self.index % SERIES.len()]
    }

    pub(super) fn stroke(&self) -> Stroke<'static> {
        Stroke {
            colour: self.colour(),
            width_pt: self.width_pt,
            dashes: DASHES[self.index / SERIES.len() % DASHES.len()],
        }
    }

    /// SVG commands of a marker: a disc, square, triangle or diamond.
    pub(super) fn marker(&self, [x, y]: [f64; 2]) -> String {
        let r = MARKER_RADIUS_PT;
        let corners: &[[f64; 2]] = match self.index % 4 {
            0 => {
                let [left, y, radius] = [x - r, y, r].map(coordinate);
                let diameter = coordinate(2.0 * r);
                return format!(
                    "M{left} {y}a{radius} {radius} 0 1 0 {diameter} 0a{radius} {radius} 0 1 0 -{diameter} 0Z"
                );
            }
            1 => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
            2 => &[[0.0, -1.25], [1.15, 0.8], [-1.15, 0.8]],
            _ => &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
        };
        let places = corners
            .iter()
            .map(|[dx, dy]| format!("{} {}", coordinate(x + dx * r), coordinate(y + dy * r)));
        format!("M{}Z", places.collect::<Vec<_>>().join("L"))
    }

    /// Draws a short sample of the series for a legend, from a position to the right.
    pub(super) fn draw_sample(&self, svg: &mut Svg, [x, y]: [f64; 2], length_pt: f64) {
        svg.path(&segment([x, y], [x + length_pt, y]), self.stroke());
        if self.has_markers {
            svg.filled_path(&self.marker([x + 0.5 * length_pt, y]), self.colour());
        }
    }
}
