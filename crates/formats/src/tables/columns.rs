//! Names and units of the columns of a points table and of the fields of a point cloud.

use crate::recordings::{Place, RecordingError, printable};

/// A quantity that is used.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Column {
    Frame,
    Time,
    X,
    Y,
    Z,
    Range,
    Azimuth,
    Elevation,
    Velocity,
    Intensity,
    Noise,
}

impl Column {
    /// The name by which messages ask for it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Time => "t_s",
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::Range => "range",
            Self::Azimuth => "azimuth",
            Self::Elevation => "elevation",
            Self::Velocity => "velocity",
            Self::Intensity => "intensity",
            Self::Noise => "noise",
        }
    }
}

/// Conversion of a value to the project's unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Unit {
    /// Multiplication by a factor.
    Scale(f64),
    /// 20 log10 of an amplitude.
    Amplitude,
    /// 10 log10 of a power.
    Power,
}

/// What a name says.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Meaning {
    pub(crate) column: Column,
    pub(crate) unit: Unit,
    /// Whether the name states the unit. Otherwise `unit` is the usual one, and values may show another.
    pub(crate) states_unit: bool,
    /// The place of the word in the list of words of its column; the first ones are preferred.
    rank: usize,
}

/// Columns of tables without column names, in order.
pub const PLAIN_COLUMNS: [&str; 7] = ["frame", "t_s", "x", "y", "z", "velocity", "intensity"];

impl Meaning {
    /// The place of the word among those of its quantity: words with smaller numbers are more usual.
    pub(crate) fn rank(self) -> usize {
        self.rank
    }
}

type Units = &'static [(&'static str, Unit)];

const NO_UNITS: Units = &[];
const LENGTHS: Units = &[
    ("m", Unit::Scale(1.0)),
    ("cm", Unit::Scale(0.01)),
    ("mm", Unit::Scale(0.001)),
];
const SPEEDS: Units = &[
    ("mps", Unit::Scale(1.0)),
    ("m_s", Unit::Scale(1.0)),
    ("cmps", Unit::Scale(0.01)),
    ("cm_s", Unit::Scale(0.01)),
    ("mm_s", Unit::Scale(0.001)),
    ("kmh", Unit::Scale(1.0 / 3.6)),
    ("km_h", Unit::Scale(1.0 / 3.6)),
];
const TIMES: Units = &[
    ("s", Unit::Scale(1.0)),
    ("sec", Unit::Scale(1.0)),
    ("seconds", Unit::Scale(1.0)),
    ("ms", Unit::Scale(1e-3)),
    ("us", Unit::Scale(1e-6)),
    ("ns", Unit::Scale(1e-9)),
];
const ANGLES: Units = &[
    ("rad", Unit::Scale(1.0)),
    ("deg", Unit::Scale(std::f64::consts::PI / 180.0)),
    ("degrees", Unit::Scale(std::f64::consts::PI / 180.0)),
];
const DECIBELS: Units = &[
    ("db", Unit::Scale(1.0)),
    ("0_1_db", Unit::Scale(0.1)),
    ("0_1db", Unit::Scale(0.1)),
    ("tenths", Unit::Scale(0.1)),
    ("tenths_db", Unit::Scale(0.1)),
    ("linear", Unit::Power),
];

/// The words of every quantity, the unit where the name states none, and the units that may follow a word.
const WORDS: [(Column, &[&str], Unit, Units); 14] = [
    (
        Column::Frame,
        &[
            "frame",
            "frame_number",
            "frame_num",
            "frame_no",
            "frame_nr",
            "frame_idx",
            "frame_index",
            "frame_count",
            "framenumber",
            "framenum",
            "frameidx",
        ],
        Unit::Scale(1.0),
        NO_UNITS,
    ),
    (
        Column::Time,
        &[
            "t",
            "time",
            "timestamp",
            "time_stamp",
            "stamp",
            "datetime",
            "date_time",
        ],
        Unit::Scale(1.0),
        TIMES,
    ),
    (Column::X, &["x", "pos_x"], Unit::Scale(1.0), LENGTHS),
    (Column::Y, &["y", "pos_y"], Unit::Scale(1.0), LENGTHS),
    (Column::Z, &["z", "pos_z"], Unit::Scale(1.0), LENGTHS),
    (
        Column::Range,
        &["range", "r", "distance"],
        Unit::Scale(1.0),
        LENGTHS,
    ),
    (
        Column::Azimuth,
        &["azimuth", "az", "azim"],
        Unit::Scale(1.0),
        ANGLES,
    ),
    (
        Column::Elevation,
        &["elevation", "el", "elev"],
        Unit::Scale(1.0),
        ANGLES,
    ),
    (
        Column::Velocity,
        &[
            "velocity",
            "v",
            "doppler",
            "radial_velocity",
            "doppler_velocity",
            "radial_speed",
            "doppler_speed",
            "vel",
            "speed",
        ],
        Unit::Scale(1.0),
        SPEEDS,
    ),
    (
        Column::Intensity,
        &["intensity", "snr"],
        Unit::Scale(1.0),
        DECIBELS,
    ),
    (Column::Intensity, &["power"], Unit::Power, DECIBELS),
    (Column::Intensity, &["amplitude"], Unit::Amplitude, DECIBELS),
    (
        Column::Intensity,
        &["peak", "magnitude"],
        Unit::Amplitude,
        DECIBELS,
    ),
    (Column::Noise, &["noise"], Unit::Scale(1.0), DECIBELS),
];

/// The name in lower case. Every run of other characters than letters and digits is equivalent to `_`.
fn key(name: &str) -> String {
    let mut key = String::new();
    for c in name
        .trim_start_matches('\u{feff}')
        .chars()
        .flat_map(char::to_lowercase)
    {
        match c {
            '\u{b0}' => key.push_str("deg"),
            '\u{b5}' | '\u{3bc}' => key.push('u'),
            c if c.is_alphanumeric() => key.push(c),
            _ if !key.ends_with('_') => key.push('_'),
            _ => {}
        }
    }
    key.trim_matches('_').to_owned()
}

/// Determines the column and unit from a name. The unit is a suffix.
pub(crate) fn meaning(name: &str) -> Option<Meaning> {
    let key = key(name);
    let mut rank = 0;
    for (column, words, usual, units) in WORDS {
        for word in words {
            rank += 1;
            let Some(rest) = key.strip_prefix(word) else {
                continue;
            };
            let found = |unit, states_unit| {
                Some(Meaning {
                    column,
                    unit,
                    states_unit,
                    rank,
                })
            };
            if rest.is_empty() {
                return found(usual, false);
            }
            let suffix = rest.strip_prefix('_');
            if let Some((_, unit)) = units.iter().find(|(name, _)| Some(*name) == suffix) {
                return found(*unit, true);
            }
        }
    }
    None
}

/// Whether a name denotes a column of a points table.
pub(crate) fn is_point_column(name: &str) -> bool {
    meaning(name).is_some_and(|m| m.column != Column::Noise)
}

/// Columns that a table or a cloud lacks, by name: three coordinates, Cartesian or spherical, and a velocity.
pub(crate) fn missing_of_point(has: impl Fn(Column) -> bool) -> Vec<&'static str> {
    let lacks = |columns: [Column; 3]| {
        let missing = columns.into_iter().filter(|c| !has(*c));
        missing.map(Column::name).collect::<Vec<_>>()
    };
    let cartesian = lacks([Column::X, Column::Y, Column::Z]);
    let spherical = lacks([Column::Range, Column::Azimuth, Column::Elevation]);
    // Somebody with two of the spherical coordinates lacks the third.
    let mut missing = match cartesian.len() <= spherical.len() && !spherical.is_empty() {
        true => cartesian,
        false => spherical,
    };
    if !has(Column::Velocity) {
        missing.push(Column::Velocity.name());
    }
    missing
}

/// Columns that a table with these names lacks, as messages name them.
///
/// Boards without an antenna above another one measure no heights, and some recorders write no velocities: a table may lack
/// either if another column shows that its rows are points of a radar, and if no column seems to be the one that is missing
/// under another name.
pub(crate) fn missing<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<&'static str> {
    let mut found = Vec::new();
    let mut others = Vec::new();
    for name in names {
        match meaning(name) {
            Some(meaning) => found.push(meaning.column),
            None => others.push(key(name)),
        }
    }
    let has = |column| found.contains(&column);
    let mut missing = missing_of_point(has);
    let is_of_radar = [
        Column::Z,
        Column::Elevation,
        Column::Velocity,
        Column::Intensity,
    ]
    .into_iter()
    .any(has);
    if is_of_radar {
        let seems = |parts: &[&str], starts: &[&str]| {
            others.iter().any(|name| {
                parts.iter().any(|part| name.contains(part))
                    || starts.iter().any(|start| name.starts_with(start))
            })
        };
        let has_height = seems(&["height", "elev"], &["z", "el", "pos_z", "posz"]);
        let has_velocity = seems(&["vel", "dop", "speed"], &["v"]);
        missing.retain(|name| match *name {
            "z" | "elevation" => has_height,
            "velocity" => has_velocity,
            _ => true,
        });
    }
    if !has(Column::Frame) && !has(Column::Time) {
        missing.push("frame or t_s");
    }
    missing
}

/// A column at its place in a table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) meaning: Meaning,
    pub(super) at: usize,
}

/// Positions of the columns in a table.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) placed: Vec<Placed>,
    /// Whether a column `DetObj#` shows that TI's example script for the out-of-box demo wrote the table.
    pub(super) is_of_ti_script: bool,
    /// The name of the time column, for messages.
    pub(super) time_name: String,
    /// The name of the intensity column, for messages.
    pub(super) intensity_name: String,
    /// What a user should know about the columns.
    pub(super) notes: Vec<String>,
}

impl Columns {
    /// Finds the columns from the column names of a table.
    ///
    /// # Errors
    /// Names the missing or duplicate columns and those that are there.
    pub(super) fn find(place: Place, names: &[&str]) -> Result<Self, RecordingError> {
        let mut placed: Vec<Placed> = Vec::new();
        let mut notes = Vec::new();
        let name_at = |at: usize| names.get(at).map_or(String::new(), |n| printable(n));
        for (at, name) in names.iter().enumerate() {
            let Some(meaning) = meaning(name) else {
                continue;
            };
            let new = Placed { meaning, at };
            let Some(old) = placed
                .iter_mut()
                .find(|p| p.meaning.column == meaning.column)
            else {
                placed.push(new);
                continue;
            };
            let rank = |m: Meaning| (m.column == Column::Time && !m.states_unit, m.rank);
            if rank(old.meaning) == rank(meaning) {
                let expected = format!("one column for {}", meaning.column.name());
                return Err(RecordingError::new(place, expected, name));
            }
            let (used, idle) = match rank(old.meaning) < rank(meaning) {
                true => (old.at, at),
                false => (at, old.at),
            };
            if used == at {
                *old = new;
            }
            notes.push(format!(
                "column `{}` is not used, because there is `{}`",
                name_at(idle),
                name_at(used)
            ));
        }
        let missing = missing(names.iter().copied());
        if !missing.is_empty() {
            return Err(RecordingError::listing(
                place,
                format!(
                    "columns {} (see docs/guides/recordings.md)",
                    missing.join(", ")
                ),
                names,
            ));
        }
        let has = |column| placed.iter().any(|p| p.meaning.column == column);
        let is_cartesian =
            has(Column::X) && has(Column::Y) && (has(Column::Z) || !has(Column::Elevation));
        placed.retain(|p| {
            let is_spherical = [Column::Range, Column::Azimuth, Column::Elevation];
            let is_flat = [Column::X, Column::Y, Column::Z];
            match is_cartesian {
                true => !is_spherical.contains(&p.meaning.column),
                false => !is_flat.contains(&p.meaning.column),
            }
        });
        let name_of = |column| {
            let found = placed.iter().find(|p| p.meaning.column == column);
            found.map_or(String::new(), |p| name_at(p.at))
        };
        Ok(Self {
            time_name: name_of(Column::Time),
            intensity_name: name_of(Column::Intensity),
            is_of_ti_script: names.iter().any(|n| key(n) == "detobj"),
            placed,
            notes,
        })
    }

    /// The column of a quantity, if the table has it.
    pub(super) fn get(&self, column: Column) -> Option<Placed> {
        let found = self.placed.iter().find(|p| p.meaning.column == column);
        found.copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_state_columns_and_units() {
        let of = |name: &str| meaning(name).map(|m| (m.column, m.unit, m.states_unit));
        let scale = Unit::Scale;
        for (name, expected) in [
            ("frame", Some((Column::Frame, scale(1.0), false))),
            ("X [m]", Some((Column::X, scale(1.0), true))),
            ("y_mm", Some((Column::Y, scale(0.001), true))),
            ("Doppler [m/s]", Some((Column::Velocity, scale(1.0), true))),
            ("Timestamp", Some((Column::Time, scale(1.0), false))),
            ("t_ms", Some((Column::Time, scale(1e-3), true))),
            ("time (\u{b5}s)", Some((Column::Time, scale(1e-6), true))),
            ("# frame", Some((Column::Frame, scale(1.0), false))),
            ("Power", Some((Column::Intensity, Unit::Power, false))),
            ("power_db", Some((Column::Intensity, scale(1.0), true))),
            ("snr (0.1 dB)", Some((Column::Intensity, scale(0.1), true))),
            ("snr_linear", Some((Column::Intensity, Unit::Power, true))),
            ("peak", Some((Column::Intensity, Unit::Amplitude, false))),
            ("noise", Some((Column::Noise, scale(1.0), false))),
            ("v_x", None),
            ("doppler_bin", None),
            ("range_idx", None),
            ("frame_id", None),
            ("", None),
        ] {
            assert_eq!(of(name), expected, "{name}");
        }
        let deg = Unit::Scale(std::f64::consts::PI / 180.0);
        assert_eq!(of("azimuth [\u{b0}]"), Some((Column::Azimuth, deg, true)));
        assert_eq!(
            of("elevation_rad"),
            Some((Column::Elevation, scale(1.0), true))
        );
    }

    #[test]
    fn what_is_missing_is_named_in_the_coordinates_of_the_table() {
        let of = |names: &str| missing(names.split(',')).join(" ");
        assert_eq!(of("frame,x,y"), "z velocity");
        assert_eq!(of("range,elevation,v"), "azimuth frame or t_s");
        assert_eq!(of("a,b"), "x y z velocity frame or t_s");
        assert_eq!(of("t,range,azimuth,elevation,doppler"), "");
    }

    #[test]
    fn heights_or_velocities_may_be_missing_unless_a_column_may_be_them() {
        let of = |names: &str| missing(names.split(',')).join(" ");
        for whole in [
            "frame,x,y,v",
            "frame,x,y,snr",
            "frame,x,y,z",
            "t,range,azimuth,v",
            "frame,range,azimuth,elevation,note",
        ] {
            assert_eq!(of(whole), "", "{whole}");
        }
        for (names, missing) in [
            ("frame,x,y,v,height", "z"),
            ("frame,x,y,v,z (m above floor)", "z"),
            ("frame,x,y,z,vx,vy,vz", "velocity"),
            ("frame,x,y,z,snr,doppler_bin", "velocity"),
            ("frame,range,azimuth,v,el_idx", "elevation"),
            ("frame,x,v", "y"),
        ] {
            assert_eq!(of(names), missing, "{names}");
        }
    }
}
