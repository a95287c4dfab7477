//! The virtual array: which channels form the azimuth row and which give elevation.

use radarllm_base::RadarConfig;
use radarllm_base::radar_config::Antenna;

/// Positions closer than this are treated as equal, m. The value is far below the spacing of any board.
const SAME_M: f64 = 2e-5;
/// Maximum number of distinct spacings that are tried per row. Boards have one or two.
const MAX_SPACINGS: usize = 16;

/// One virtual element: the channel index `slot * n_rx + rx` and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Channel, `slot * n_rx + rx`.
    pub channel: usize,
    /// Sum of the transmitter's and the receiver's x, m.
    pub x_m: f64,
    /// Sum of the transmitter's and the receiver's z, m.
    pub z_m: f64,
}

/// The parts of a radar's antenna array that angle estimation uses.
///
/// A far target with direction cosines (u_x, u_z) adds the phase -2 pi / lambda (x u_x + z u_z) at the virtual element
/// (x, z), because the delay is shorter at elements that are nearer to the target.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualArray {
    /// Longest uniform horizontal row, in ascending order of x. A single element means no azimuth.
    pub azimuth_row: Vec<Element>,
    /// Spacing of the row, m (0 for a single element).
    pub spacing_m: f64,
    /// Elements of the nearest other height; empty means no elevation.
    pub elevation_row: Vec<Element>,
    /// Height of the elevation row above the azimuth row, m, either sign (0 if there is none).
    pub height_m: f64,
}

impl VirtualArray {
    /// Derives the array of a valid radar. The azimuth row is the longest uniform row; in a tie, the one with the
    /// finest spacing and then the lowest height. The elevation row is at the nearest other height; in a tie, the one
    /// with the most elements.
    pub fn new(radar: &RadarConfig) -> Self {
        let mut rows = rows_by_height(&radar.tx, &radar.rx);
        let mut best: Option<(usize, Vec<Element>, f64)> = None;
        for (row_idx, row) in rows.iter().enumerate() {
            let (run, spacing_m) = longest_uniform_run(row);
            let better = best.as_ref().is_none_or(|(_, old, old_spacing_m)| {
                run.len() > old.len()
                    || (run.len() == old.len() && spacing_m < old_spacing_m - SAME_M)
            });
            if better {
                best = Some((row_idx, run, spacing_m));
            }
        }
        let Some((row_idx, azimuth_row, spacing_m)) = best else {
            // A valid radar has at least one antenna of each kind, so that this is not reached.
            return Self {
                azimuth_row: vec![],
                spacing_m: 0.0,
                elevation_row: vec![],
                height_m: 0.0,
            };
        };
        let z_m = rows[row_idx][0].z_m;
        rows.remove(row_idx);
        rows.sort_by(|a, b| {
            let (da, db) = ((a[0].z_m - z_m).abs(), (b[0].z_m - z_m).abs());
            if (da - db).abs() > SAME_M {
                da.total_cmp(&db)
            } else {
                b.len().cmp(&a.len())
            }
        });
        let elevation_row = rows.into_iter().next().unwrap_or_default();
        let height_m = elevation_row.first().map_or(0.0, |e| e.z_m - z_m);
        Self {
            azimuth_row,
            spacing_m,
            elevation_row,
            height_m,
        }
    }

    /// Whether x is measured. Otherwise, points are on the boresight plane x = 0.
    pub fn has_azimuth(&self) -> bool {
        self.azimuth_row.len() >= 2
    }

    /// Whether z is measured. Otherwise, points have z = 0.
    pub fn has_elevation(&self) -> bool {
        !self.elevation_row.is_empty()
    }
}

/// The virtual element of every channel, in the order of the channels.
pub(crate) fn elements(tx: &[Antenna], rx: &[Antenna]) -> Vec<Element> {
    let of_slot = |(slot, t): (usize, &Antenna)| {
        let (x_m, z_m) = (t.x_m, t.z_m);
        let of = move |(r, receiver): (usize, &Antenna)| Element {
            channel: slot * rx.len() + r,
            x_m: x_m + receiver.x_m,
            z_m: z_m + receiver.z_m,
        };
        rx.iter().enumerate().map(of)
    };
    tx.iter().enumerate().flat_map(of_slot).collect()
}

/// All virtual elements in rows of equal height, lowest first and with x ascending. Of several elements at one position
/// only the first channel is kept, because the choice does not matter for a calibrated array.
fn rows_by_height(tx: &[Antenna], rx: &[Antenna]) -> Vec<Vec<Element>> {
    let mut all = elements(tx, rx);
    all.sort_by(|a, b| a.z_m.total_cmp(&b.z_m).then(a.x_m.total_cmp(&b.x_m)));
    let mut rows: Vec<Vec<Element>> = Vec::new();
    for element in all {
        match rows.last_mut() {
            Some(row) if element.z_m - row[0].z_m < SAME_M => row.push(element),
            _ => rows.push(vec![element]),
        }
    }
    for row in &mut rows {
        row.sort_by(|a, b| a.x_m.total_cmp(&b.x_m).then(a.channel.cmp(&b.channel)));
        row.dedup_by(|later, kept| later.x_m - kept.x_m < SAME_M);
    }
    rows
}

fn longest_uniform_run(row: &[Element]) -> (Vec<Element>, f64) {
    let mut gaps: Vec<f64> = row.windows(2).map(|w| w[1].x_m - w[0].x_m).collect();
    gaps.sort_by(f64::total_cmp);
    gaps.dedup_by(|a, b| (*a - *b).abs() < SAME_M);
    gaps.truncate(MAX_SPACINGS);
    let mut best = (row[..1].to_vec(), 0.0);
    for gap in gaps {
        for start in 0..row.len() {
            if row.len() - start <= best.0.len() {
                break;
            }
            let mut run = vec![row[start]];
            for &element in &row[start + 1..] {
                let next_m = row[start].x_m + run.len() as f64 * gap;
                if (element.x_m - next_m).abs() < SAME_M {
                    run.push(element);
                }
            }
            if run.len() > best.0.len() {
                best = (run, gap);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_board_gives_eight_in_a_row_and_four_above() {
        let array = VirtualArray::new(&RadarConfig::awr1843boost());
        let half_m = 0.5 * radarllm_base::SPEED_OF_LIGHT_MPS / 77e9;
        // The slots transmit with TX1, TX3, TX2: channels 0..8 are the row, 8..12 the raised elements.
        let channels: Vec<_> = array.azimuth_row.iter().map(|e| e.channel).collect();
        assert_eq!(channels, [0, 1, 2, 3, 4, 5, 6, 7]);
        let raised: Vec<_> = array.elevation_row.iter().map(|e| e.channel).collect();
        assert_eq!(raised, [8, 9, 10, 11]);
        // Sums of f64 metres: rounding only.
        assert!(
            (array.spacing_m - half_m).abs() < 1e-12 && (array.height_m - half_m).abs() < 1e-12
        );
        assert!((array.elevation_row[0].x_m - 2.0 * half_m).abs() < 1e-12);
    }

    #[test]
    fn flat_and_single_arrays_say_what_they_lack() {
        let mut radar = RadarConfig::awr1843boost();
        radar.tx.truncate(2);
        let flat = VirtualArray::new(&radar);
        assert!(flat.has_azimuth() && !flat.has_elevation());
        radar.tx.truncate(1);
        radar.rx.truncate(1);
        let single = VirtualArray::new(&radar);
        assert!(!single.has_azimuth() && !single.has_elevation());
    }

    #[test]
    fn firing_order_and_direction_do_not_matter() {
        let mut radar = RadarConfig::awr1843boost();
        radar.tx.swap(0, 2);
        radar.rx.reverse();
        let array = VirtualArray::new(&radar);
        assert_eq!(array.azimuth_row.len(), 8);
        assert!(array.azimuth_row.windows(2).all(|w| w[1].x_m > w[0].x_m));
        assert!(array.height_m > 0.0);
    }
}
