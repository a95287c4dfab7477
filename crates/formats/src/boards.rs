//! Evaluation boards: antenna positions and radiated power.

use radarllm_base::SPEED_OF_LIGHT_MPS;
use radarllm_base::radar_config::Antenna;

/// Sign of x for increasing element numbers. It is left to right, as in [`radarllm_base::RadarConfig`] for the
/// AWR1843BOOST. TI's demos compute x = +R wx / pi, which numbers elements right to left under the phase +2 pi f0 tau;
/// the `antGeometry0` lines of its people-counting files agree with the demos. Which of the two holds for raw samples
/// of a given board, and thus whether they are mirrored, was not verified on hardware. This constant is the only place
/// to change.
///
/// The x reported by TI's firmware does point to the radar's right. In MARS (An and Ogras, 2021; IWR1443, people facing
/// the radar), the mean x of points faster than 0.5 m/s follows the Kinect's moving wrist, with the left wrist at +x,
/// with a correlation of 0.85 (subject 1) and 0.75 (subject 3).
pub(crate) const X_PER_ELEMENT: f64 = 1.0;

/// A board with known antenna positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// xWR1443BOOST: three transmitters, the second raised.
    Xwr1443Boost,
    /// xWR1642BOOST: two transmitters, azimuth only.
    Xwr1642Boost,
    /// xWR1843BOOST: three transmitters, the second raised.
    Xwr1843Boost,
    /// xWR6843ISK: the layout of the 1843 board at 60 GHz.
    Xwr6843Isk,
    /// xWR6843ISK-ODS: a square of antennas.
    Xwr6843IskOds,
    /// xWR6843AOP: antennas on the package.
    Xwr6843Aop,
    /// MMWCAS-RF-EVM: four AWR2243 in cascade, 86 azimuth elements.
    Awr2243Cascade,
    /// IWRL6432's small reference design: two transmitters, three receivers.
    Iwrl6432,
}

/// Maximum length of the name of a platform that is quoted, characters.
const MAX_NAME: usize = 40;
/// Words after the name of a device that name the board.
const BOARD_WORDS: [&str; 5] = ["isk", "ods", "aop", "boost", "evm"];

/// Device or board that a name of TI stands for, such as `xWR68xx_AOP`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Platform {
    /// A single board.
    Board(Board),
    /// A device on several boards with different antennas, which the name does not distinguish.
    Family {
        /// The name as written.
        name: String,
        /// The most common of its boards.
        assumed: Board,
    },
    /// A device or board whose antenna positions are not known to this project.
    UnknownAntennas {
        /// The name as written.
        name: String,
    },
}

impl Platform {
    /// Reads the name of a device or board: `xWR` (also `AWR`, `IWR`), the device, and the board or package, which may be
    /// separated by `_` or `-`. Case is ignored. `None` if it is no such name.
    ///
    /// The AWR1843AOP, whose antennas TI's SDK 3.5 does not list beside those of the IWR6843AOP, counts as unknown.
    ///
    /// ```
    /// use radarllm_formats::{Board, boards::Platform};
    ///
    /// assert_eq!(Platform::from_name("xWR68xx_AOP"), Some(Platform::Board(Board::Xwr6843Aop)));
    /// assert!(matches!(Platform::from_name("xWR68xx"), Some(Platform::Family { .. })));
    /// assert!(matches!(Platform::from_name("xWR18xx_AOP"), Some(Platform::UnknownAntennas { .. })));
    /// ```
    pub fn from_name(name: &str) -> Option<Self> {
        let mut words = name.split_whitespace();
        let mut written: String = words
            .next()?
            .chars()
            .take_while(|c| c.is_ascii_alphanumeric() || "_-+".contains(*c))
            .take(MAX_NAME)
            .collect();
        // The board may be a word of its own.
        for word in words
            .take(2)
            .take_while(|w| BOARD_WORDS.contains(&w.to_ascii_lowercase().as_str()))
        {
            written = format!("{written}_{word}");
        }
        let lower = written.to_ascii_lowercase();
        let device = ["xwr", "awr", "iwr"]
            .iter()
            .find_map(|prefix| lower.strip_prefix(prefix))?;
        // Low-power devices have an L before their number.
        let digits = device.strip_prefix('l').unwrap_or(device);
        let number = digits.get(..4)?;
        let is_number = number.starts_with(|c: char| c.is_ascii_digit())
            && number.chars().all(|c| c.is_ascii_digit() || c == 'x');
        if !is_number {
            return None;
        }
        let suffix: String = digits[4..]
            .chars()
            .filter(|c| c.is_ascii_alphanumeric() || *c == '+')
            .collect();
        // The evaluation module of a board is the board.
        let suffix = suffix.strip_suffix("evm").unwrap_or(&suffix);
        let is_low_power = digits.len() < device.len();
        let board = match (is_low_power, number, suffix) {
            (false, "14xx" | "1443", "" | "boost") => Board::Xwr1443Boost,
            (false, "16xx" | "1642", "" | "boost") => Board::Xwr1642Boost,
            (false, "18xx" | "1843", "" | "boost") => Board::Xwr1843Boost,
            (false, "68xx" | "6843" | "64xx" | "6443", "") => {
                return Some(Self::Family {
                    name: written,
                    assumed: Board::Xwr6843Isk,
                });
            }
            (false, "68xx" | "6843" | "64xx" | "6443", "isk") => Board::Xwr6843Isk,
            (false, "68xx" | "6843" | "64xx" | "6443", "ods" | "iskods") => Board::Xwr6843IskOds,
            (false, "68xx" | "6843" | "64xx" | "6443", "aop") => Board::Xwr6843Aop,
            _ => return Some(Self::UnknownAntennas { name: written }),
        };
        Some(Self::Board(board))
    }

    /// Reads the name that TI's visualizer gives to a chirp file, such as `xwr68xx_AOP_profile_2021_02_03T04_05_06_789.cfg`.
    /// `None` if the name has another form.
    pub fn from_file_name(name: &str) -> Option<Self> {
        let lower = name.to_ascii_lowercase();
        let (platform, _) = lower.split_once("_profile")?;
        Self::from_name(name.get(..platform.len())?)
    }
}

/// Column (azimuth) and row (downwards) of an antenna, in half wavelengths.
type Place = (i8, i8);

/// Antennas and link budget of a board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardFigures {
    /// Transmitters TX1, TX2, ... of the device, m.
    pub tx: Vec<Antenna>,
    /// Receivers RX1, RX2, ..., m.
    pub rx: Vec<Antenna>,
    /// Transmit power without back-off, dBm.
    pub tx_power_dbm: f64,
    /// Gain of each antenna at boresight, dBi.
    pub antenna_gain_dbi: f64,
    /// Half-power half-width in azimuth, rad.
    pub azimuth_half_width_rad: f64,
    /// Half-power half-width in elevation, rad.
    pub elevation_half_width_rad: f64,
    /// Receiver noise figure, dB.
    pub noise_figure_db: f64,
}

/// Limits of a board's radar chip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceLimits {
    /// Maximum rate of complex samples, samples/s.
    pub max_sample_rate_hz: f64,
    /// Memory that TI's demos use for the radar cube and the detection matrix, bytes.
    pub l3_bytes: u64,
    /// Number of LVDS lanes that carry samples.
    pub lvds_lanes: u32,
}

impl Board {
    /// All supported boards.
    pub const ALL: [Board; 8] = [
        Board::Xwr1443Boost,
        Board::Xwr1642Boost,
        Board::Xwr1843Boost,
        Board::Xwr6843Isk,
        Board::Xwr6843IskOds,
        Board::Xwr6843Aop,
        Board::Awr2243Cascade,
        Board::Iwrl6432,
    ];

    /// Name used in reports and by [`crate::builtin_radar`].
    pub fn name(self) -> &'static str {
        match self {
            Board::Xwr1443Boost => "iwr1443boost",
            Board::Xwr1642Boost => "awr1642boost",
            Board::Xwr1843Boost => "awr1843boost",
            Board::Xwr6843Isk => "iwr6843isk",
            Board::Xwr6843IskOds => "iwr6843isk-ods",
            Board::Xwr6843Aop => "iwr6843aop",
            Board::Awr2243Cascade => "awr2243-cascade",
            Board::Iwrl6432 => "iwrl6432",
        }
    }

    /// Returns whether the board operates at 60 to 64 GHz (otherwise 76 to 81 GHz).
    pub fn is_60_ghz(self) -> bool {
        matches!(
            self,
            Board::Xwr6843Isk | Board::Xwr6843IskOds | Board::Xwr6843Aop | Board::Iwrl6432
        )
    }

    /// Band in which the chip may transmit, Hz (features page of the data sheets: SWRS211, SWRS212, SWRS228, SWRS219,
    /// SWRS223, SWRS297).
    pub fn band_hz(self) -> (f64, f64) {
        match self {
            Board::Iwrl6432 => (57e9, 64e9),
            _ if self.is_60_ghz() => (60e9, 64e9),
            _ => (76e9, 81e9),
        }
    }

    /// Limits of the chip; `None` for the two boards that do not send samples through the DCA1000 and whose limits are
    /// unknown.
    ///
    /// Sample rates: 1/0.8 of the IF bandwidth in "Receive Subsystem" of the data sheets, 5 MHz
    /// (IWR1642, SWRS212B), 10 MHz (IWR1843, SWRS228B; IWR6843, SWRS219F); for the IWR1443 TI's
    /// answer in its forum (thread 613071), 18.75 Msps. Memory: the makefiles of TI's SDK 2.0
    /// (`MMWAVE_L3RAM_SIZE` 0x40000 and 0xC0000) and 3 (8 and 6 banks of 128 KiB). Lanes: TI SWRA581B.
    pub fn limits(self) -> Option<DeviceLimits> {
        let (max_sample_rate_hz, l3_kib, lvds_lanes) = match self {
            Board::Xwr1443Boost => (18.75e6, 256, 4),
            Board::Xwr1642Boost => (6.25e6, 768, 2),
            Board::Xwr1843Boost => (12.5e6, 1024, 2),
            Board::Xwr6843Isk | Board::Xwr6843IskOds | Board::Xwr6843Aop => (12.5e6, 768, 2),
            Board::Awr2243Cascade | Board::Iwrl6432 => return None,
        };
        Some(DeviceLimits {
            max_sample_rate_hz,
            l3_bytes: l3_kib * 1024,
            lvds_lanes,
        })
    }

    /// The board's figures.
    ///
    /// Antenna positions: TI mmWave SDK 3.5 `ti/board/antenna_geometry.c` (columns and rows in half wavelengths), which
    /// the `antGeometry` lines of the 3D people-counting files repeat. The 1443 board has the layout of the 1843,
    /// because the demos use one formula for both. Half a wavelength is that at 77 GHz and at 62 GHz (TI SWRU585 for
    /// its 60 GHz boards).
    ///
    /// Positions of the cascade: the parameter modules of TI's cascade post-processing scripts (mmWave Studio 3,
    /// `TI_Cascade_TX_position_azi` and its siblings; 76.8 GHz), whose elevations are assumed to increase upwards.
    /// Positions of the IWRL6432: TI TIDUFB9, section 3.1 (one transmitter half a wavelength below and one wavelength
    /// beside the other; receivers in a row).
    ///
    /// Power: 12 dBm for the 77 GHz parts and the 6843 (data sheets). Noise figure: 15 dB and 12 dB. Gain and widths:
    /// those of the reference radar for the BOOST boards, and nominal values for the 60 GHz boards (ISK about 7 dBi;
    /// AOP 5.2 dBi in TI's sensing estimator; wide elements). The nominal values should be replaced by measurements
    /// where intensity matters. This also applies to all figures of the cascade and the IWRL6432 except their antenna
    /// positions.
    pub fn figures(self) -> BoardFigures {
        const ROW: [Place; 4] = [(0, 0), (1, 0), (2, 0), (3, 0)];
        const THREE: [Place; 3] = [(0, 1), (2, 0), (4, 1)];
        const CASCADE_TX: [Place; 12] = [
            (11, -6),
            (10, -4),
            (9, -1),
            (32, 0),
            (28, 0),
            (24, 0),
            (20, 0),
            (16, 0),
            (12, 0),
            (8, 0),
            (4, 0),
            (0, 0),
        ];
        const CASCADE_RX: [Place; 16] = [
            (11, 0),
            (12, 0),
            (13, 0),
            (14, 0),
            (50, 0),
            (51, 0),
            (52, 0),
            (53, 0),
            (46, 0),
            (47, 0),
            (48, 0),
            (49, 0),
            (0, 0),
            (1, 0),
            (2, 0),
            (3, 0),
        ];
        let (tx, rx): (&[Place], &[Place]) = match self {
            Board::Xwr1642Boost => (&[(0, 0), (4, 0)], &ROW),
            Board::Xwr1443Boost | Board::Xwr1843Boost | Board::Xwr6843Isk => (&THREE, &ROW),
            Board::Xwr6843IskOds => (&[(0, 0), (2, 0), (2, 2)], &[(0, 0), (0, 1), (1, 1), (1, 0)]),
            Board::Xwr6843Aop => (&[(0, 0), (2, 2), (0, 2)], &[(1, 1), (1, 0), (0, 1), (0, 0)]),
            Board::Awr2243Cascade => (&CASCADE_TX, &CASCADE_RX),
            Board::Iwrl6432 => (&[(0, 0), (2, 1)], &ROW[..3]),
        };
        let design_hz = match self {
            Board::Awr2243Cascade => 76.8e9,
            _ if self.is_60_ghz() => 62e9,
            _ => 77e9,
        };
        let half_m = 0.5 * SPEED_OF_LIGHT_MPS / design_hz;
        // As in the reference radar, the lowest row of transmitters is at height 0.
        let lowest = tx.iter().map(|p| p.1).max().unwrap_or(0);
        // Long arrays are centred, because directions refer to the middle of the row.
        let [middle_tx, middle_rx] = match self {
            Board::Awr2243Cascade => [16.0, 26.5],
            _ => [0.0; 2],
        };
        let place = |p: &Place, bottom: i8, middle: f64| Antenna {
            x_m: X_PER_ELEMENT * (f64::from(p.0) - middle) * half_m,
            z_m: f64::from(bottom - p.1) * half_m,
        };
        let (gain, azimuth_deg, elevation_deg): (f64, f64, f64) = match self {
            Board::Xwr6843Isk => (7.0, 45.0, 15.0),
            Board::Xwr6843IskOds | Board::Xwr6843Aop | Board::Iwrl6432 => (5.2, 55.0, 55.0),
            _ => (10.5, 28.0, 14.0),
        };
        BoardFigures {
            tx: tx.iter().map(|p| place(p, lowest, middle_tx)).collect(),
            rx: rx.iter().map(|p| place(p, 0, middle_rx)).collect(),
            tx_power_dbm: 12.0,
            antenna_gain_dbi: gain,
            azimuth_half_width_rad: azimuth_deg.to_radians(),
            elevation_half_width_rad: elevation_deg.to_radians(),
            noise_figure_db: if self.is_60_ghz() { 12.0 } else { 15.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns and rows of the people-counting files' `antGeometry0/1` lines, TX1..TX3 x RX1..RX4.
    #[test]
    fn virtual_arrays_are_those_of_the_people_counting_files() {
        let files: [(Board, [i8; 12], [i8; 12]); 3] = [
            (
                Board::Xwr6843Isk,
                [0, -1, -2, -3, -2, -3, -4, -5, -4, -5, -6, -7],
                [-1, -1, -1, -1, 0, 0, 0, 0, -1, -1, -1, -1],
            ),
            (
                Board::Xwr6843IskOds,
                [0, 0, -1, -1, -2, -2, -3, -3, -2, -2, -3, -3],
                [0, -1, -1, 0, 0, -1, -1, 0, -2, -3, -3, -2],
            ),
            (
                Board::Xwr6843Aop,
                [-1, -1, 0, 0, -3, -3, -2, -2, -1, -1, 0, 0],
                [-1, 0, -1, 0, -3, -2, -3, -2, -3, -2, -3, -2],
            ),
        ];
        let half_m = 0.5 * SPEED_OF_LIGHT_MPS / 62e9;
        for (board, columns, rows) in files {
            let f = board.figures();
            let z0 = f.tx[0].z_m + f.rx[0].z_m - f64::from(rows[0]) * half_m;
            for i in 0..12 {
                let (t, r) = (f.tx[i / 4], f.rx[i % 4]);
                // Column numbers in those files are negative; only relative heights matter.
                let x = -f64::from(columns[i]) * half_m * X_PER_ELEMENT;
                assert!((t.x_m + r.x_m - x).abs() < 1e-12, "{board:?} x of {i}");
                let z = f64::from(rows[i]) * half_m + z0;
                assert!((t.z_m + r.z_m - z).abs() < 1e-12, "{board:?} z of {i}");
            }
        }
    }

    #[test]
    fn platforms_are_told_apart_by_their_whole_names() {
        let of = |name| Platform::from_name(name);
        for (name, board) in [
            ("xWR14xx", Board::Xwr1443Boost),
            ("xWR16xx", Board::Xwr1642Boost),
            ("xWR18xx", Board::Xwr1843Boost),
            ("AWR1843BOOST", Board::Xwr1843Boost),
            ("xWR68xx_ISK", Board::Xwr6843Isk),
            ("xWR68xx_ODS", Board::Xwr6843IskOds),
            ("IWR6843ISK-ODS", Board::Xwr6843IskOds),
            ("xWR68xx_AOP ", Board::Xwr6843Aop),
            ("IWR6843AOPEVM", Board::Xwr6843Aop),
            ("xwr64xx_aop", Board::Xwr6843Aop),
            ("IWR6843 AOP EVM", Board::Xwr6843Aop),
            ("xWR18xx (on a tripod)", Board::Xwr1843Boost),
        ] {
            assert_eq!(of(name), Some(Platform::Board(board)), "{name}");
        }
        for name in ["xWR68xx", "xWR64xx", "xWR6443", "IWR6843"] {
            let expected = Platform::Family {
                name: name.into(),
                assumed: Board::Xwr6843Isk,
            };
            assert_eq!(of(name), Some(expected));
        }
        for name in [
            "xWR18xx_AOP",
            "xWR16xx_ODS",
            "xWR2944",
            "xWR2x44P",
            "xWRL6432",
            "xWRL1432",
            "xWRL6844",
            "xWR68xx_XYZ",
        ] {
            assert_eq!(
                of(name),
                Some(Platform::UnknownAntennas { name: name.into() })
            );
        }
        for name in [
            "",
            "xWR",
            "xWR18",
            "xWRabcd",
            "AOP",
            "xWR\u{b5}\u{b5}\u{b5}",
        ] {
            assert_eq!(of(name), None, "{name}");
        }
        let long = format!("xWR6843{}", "9".repeat(1000));
        assert!(matches!(of(&long), Some(Platform::UnknownAntennas { name }) if name.len() == 40));
    }

    #[test]
    fn names_of_files_of_the_visualizer_state_the_platform() {
        let of = Platform::from_file_name;
        assert_eq!(
            of("xwr68xx_AOP_profile_2021_02_03T04_05_06_789.cfg"),
            Some(Platform::Board(Board::Xwr6843Aop))
        );
        assert!(matches!(
            of("xwr68xx_profile_3d.cfg"),
            Some(Platform::Family { .. })
        ));
        for name in [
            "AOP_6m_default.cfg",
            "profile_2d.cfg",
            "xwr68xx_AOP.cfg",
            "\u{130}_profile",
        ] {
            assert_eq!(of(name), None, "{name}");
        }
    }

    #[test]
    fn the_cascade_has_86_azimuth_elements_in_a_row() {
        let f = Board::Awr2243Cascade.figures();
        let half_m = 0.5 * SPEED_OF_LIGHT_MPS / 76.8e9;
        let mut columns: Vec<i64> =
            f.tx.iter()
                .filter(|t| t.z_m == 0.0)
                .flat_map(|t| {
                    f.rx.iter()
                        .map(move |r| ((t.x_m + r.x_m) / half_m + 42.5).round() as i64)
                })
                .collect();
        columns.sort_unstable();
        columns.dedup();
        assert_eq!(columns, (0..86).collect::<Vec<_>>());
        // Raised transmitters are 1, 4 and 6 half wavelengths above the row.
        let mut heights: Vec<i64> =
            f.tx.iter()
                .map(|t| (t.z_m / half_m).round() as i64)
                .collect();
        heights.sort_unstable();
        assert_eq!(heights[9..], [1, 4, 6]);
    }

    #[test]
    fn the_1843_board_is_the_reference_radar() {
        let (board, radar) = (
            Board::Xwr1843Boost.figures(),
            radarllm_base::RadarConfig::awr1843boost(),
        );
        let by_slot = [board.tx[0], board.tx[2], board.tx[1]];
        for (a, b) in by_slot
            .iter()
            .chain(&board.rx)
            .zip(radar.tx.iter().chain(&radar.rx))
        {
            assert!((a.x_m - b.x_m).abs() < 1e-12 && (a.z_m - b.z_m).abs() < 1e-12);
        }
    }
}
