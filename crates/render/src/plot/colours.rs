//! Colour maps that remain distinguishable in greyscale and for readers with colour-vision deficiency.

/// Colour map for values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourMap {
    /// Viridis: dark violet to yellow with uniformly increasing lightness. For magnitudes.
    #[default]
    Viridis,
    /// Blue, grey, red: for signed values.
    BlueRed,
}

/// Number of colours in a palette: 254 of a map, white for the background, and one for values that are not finite.
pub(super) const N_COLOURS: usize = 256;
/// Palette index of the background.
pub(super) const NOTHING: u8 = 254;
/// Palette index of values that are not finite.
const NOT_FINITE: u8 = 255;
/// Largest palette index of a colour of the map.
pub(super) const LAST: u8 = 253;

impl ColourMap {
    /// The palette of an indexed image.
    pub(super) fn palette(self) -> [[u8; 3]; N_COLOURS] {
        let mut palette = [[255; 3]; N_COLOURS];
        for index in 0..=LAST {
            palette[usize::from(index)] = self.rgb(f64::from(index) / f64::from(LAST));
        }
        palette[usize::from(NOT_FINITE)] = [128; 3];
        palette
    }

    /// Palette index of a value at 0..=1 of the map; values beyond it get the nearest end.
    pub(super) fn index(fraction: f64) -> u8 {
        if fraction.is_nan() {
            return NOT_FINITE;
        }
        // The value is in 0..=253, so the cast is exact.
        (fraction.clamp(0.0, 1.0) * f64::from(LAST)).round() as u8
    }

    fn rgb(self, fraction: f64) -> [u8; 3] {
        let anchors: &[[u8; 3]] = match self {
            Self::Viridis => &VIRIDIS,
            Self::BlueRed => &BLUE_RED,
        };
        let place = fraction.clamp(0.0, 1.0) * (anchors.len() - 1) as f64;
        let i = (place as usize).min(anchors.len() - 2);
        let f = place - i as f64;
        let mix = |a: u8, b: u8| (f64::from(a) * (1.0 - f) + f64::from(b) * f).round() as u8;
        [0, 1, 2].map(|c| mix(anchors[i][c], anchors[i + 1][c]))
    }
}

/// A colour in the hexadecimal notation of SVG.
pub(super) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Seventeen evenly spaced colours of matplotlib's viridis (van der Walt and Smith, 2015, CC0).
const VIRIDIS: [[u8; 3]; 17] = [
    [68, 1, 84],
    [72, 24, 106],
    [71, 45, 123],
    [66, 64, 134],
    [59, 82, 139],
    [51, 99, 141],
    [44, 114, 142],
    [38, 130, 142],
    [33, 145, 140],
    [31, 160, 136],
    [40, 174, 128],
    [63, 188, 115],
    [94, 201, 98],
    [132, 212, 75],
    [173, 220, 48],
    [216, 226, 25],
    [253, 231, 37],
];

/// Blue and red that are distinguishable with all kinds of colour vision. The grey middle is visible on white.
const BLUE_RED: [[u8; 3]; 5] = [
    [0, 66, 157],
    [70, 130, 200],
    [176, 176, 176],
    [222, 110, 80],
    [176, 20, 40],
];

/// Colours of series: those of Okabe and Ito (2008) that are visible on white.
pub(super) const SERIES: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];
/// Dash patterns of series. The next one is used whenever the colours are exhausted.
pub(super) const DASHES: [&str; 3] = ["", "4 1.5", "1.2 1.2"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_of_viridis_rises() {
        let palette = ColourMap::Viridis.palette();
        let lightness = |[r, g, b]: [u8; 3]| {
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        let map = &palette[..=usize::from(LAST)];
        assert!(map.windows(8).all(|w| lightness(w[7]) > lightness(w[0])));
    }

    #[test]
    fn ends_of_a_map_are_ends_of_its_palette() {
        assert_eq!(ColourMap::index(-3.0), 0);
        assert_eq!(ColourMap::index(f64::INFINITY), LAST);
        assert_eq!(ColourMap::index(f64::NAN), NOT_FINITE);
        let palette = ColourMap::BlueRed.palette();
        assert_eq!(palette[0], BLUE_RED[0]);
        assert_eq!(palette[usize::from(LAST)], BLUE_RED[4]);
        assert_eq!(hex(palette[usize::from(NOTHING)]), "#ffffff");
    }
}
