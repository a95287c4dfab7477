//! Zones of a room: polygons on the floor.

use serde::{Deserialize, Serialize};

/// Most zones.
pub const MAX_ZONES: usize = 64;
/// Most corners of a zone.
pub const MAX_CORNERS: usize = 256;
/// Largest coordinate of a corner, m.
pub const MAX_CORNER_M: f64 = 1_000.0;
/// Smallest and largest height below which a zone ignores what moves, m.
pub const BELOW_M: [f64; 2] = [0.05, 2.0];
/// Longest name, bytes.
pub const MAX_NAME_BYTES: usize = 100;
/// Smallest area of a zone, m².
const MIN_AREA_M2: f64 = 1e-4;

/// Kind of a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ZoneKind {
    /// People count here. If a room is given, nobody counts outside of rooms and doors.
    Room,
    /// Nobody counts here, for example at a fan or a curtain; with a height ([`Zone::below_m`]), nobody who was never higher,
    /// such as pets and robot vacuums. This has precedence over the other kinds.
    Ignore,
    /// People leave here. People count here, too.
    Door,
    /// People lie here, as in a bed or on a sofa: they count, and going down is no fall.
    Bed,
}

/// A zone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Name of the zone, for people.
    pub name: String,
    /// Kind of the zone.
    pub kind: ZoneKind,
    /// Corners, m, to the right of the radar and away from it. The last one is joined to the first one.
    pub polygon_m: Vec<[f64; 2]>,
    /// Of an ignored zone: height above the floor, m, below which it ignores. Whoever was higher anywhere counts here, also
    /// lying on the floor. `None`: nobody counts, at any height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub below_m: Option<f64>,
}

/// What is wrong with zones.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ZoneError {
    /// More than [`MAX_ZONES`].
    #[error("{found} zones, at most {MAX_ZONES} are possible")]
    TooMany {
        /// Number of zones.
        found: usize,
    },
    /// A name that is empty or longer than [`MAX_NAME_BYTES`].
    #[error("zone {number}: expected a name of 1 to {MAX_NAME_BYTES} bytes, found {found}")]
    Name {
        /// Number of the zone, from 1.
        number: usize,
        /// Bytes of the name.
        found: usize,
    },
    /// Too few or too many corners.
    #[error("zone `{name}`: expected 3 to {MAX_CORNERS} corners, found {found}")]
    Corners {
        /// Name of the zone.
        name: String,
        /// Number of corners.
        found: usize,
    },
    /// A coordinate that is no number or larger than [`MAX_CORNER_M`].
    #[error("zone `{name}`: corner {corner} is not within {MAX_CORNER_M} m")]
    Corner {
        /// Name of the zone.
        name: String,
        /// Number of the corner, from 1.
        corner: usize,
    },
    /// A height of a zone that is not of the kind [`ZoneKind::Ignore`].
    #[error("zone `{name}`: `below_m` belongs to zones of the kind `ignore`")]
    HeightOfKind {
        /// Name of the zone.
        name: String,
    },
    /// A height that is no number or outside of [`BELOW_M`].
    #[error(
        "zone `{name}`: `below_m` is {found}, expected {} to {} m above the floor",
        BELOW_M[0],
        BELOW_M[1]
    )]
    Height {
        /// Name of the zone.
        name: String,
        /// What was found.
        found: f64,
    },
    /// Corners on a line.
    #[error("zone `{name}`: its corners enclose no area")]
    NoArea {
        /// Name of the zone.
        name: String,
    },
}

/// The zones of a room. Without any, people count everywhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Zones(Vec<Zone>);

impl Zones {
    /// Checks zones.
    ///
    /// # Errors
    /// [`ZoneError`] for the first one that is no polygon.
    pub fn new(zones: Vec<Zone>) -> Result<Self, ZoneError> {
        if zones.len() > MAX_ZONES {
            return Err(ZoneError::TooMany { found: zones.len() });
        }
        for (i, zone) in zones.iter().enumerate() {
            zone.check(i + 1)?;
        }
        Ok(Self(zones))
    }

    /// All zones.
    pub fn all(&self) -> &[Zone] {
        &self.0
    }

    /// Whether a person at a place counts.
    pub fn counts(&self, place_m: [f64; 2]) -> bool {
        let mut ignored = self.ignoring(place_m);
        if !place_m.iter().all(|v| v.is_finite()) || ignored.any(|zone| zone.below_m.is_none()) {
            return false;
        }
        let has_room = self.0.iter().any(|z| z.kind == ZoneKind::Room);
        !has_room
            || [ZoneKind::Room, ZoneKind::Door, ZoneKind::Bed]
                .into_iter()
                .any(|kind| self.is_in(kind, place_m))
    }

    /// Whether whoever was never higher than this above the floor, m, is no person at a place: a pet or a robot vacuum.
    pub fn is_low(&self, place_m: [f64; 2], highest_m: f64) -> bool {
        let mut heights_m = self.ignoring(place_m).filter_map(|zone| zone.below_m);
        heights_m.any(|below_m| highest_m < below_m)
    }

    /// Whether a zone has a height, so that heights decide who counts.
    pub fn have_heights(&self) -> bool {
        self.0.iter().any(|zone| zone.below_m.is_some())
    }

    fn ignoring(&self, place_m: [f64; 2]) -> impl Iterator<Item = &Zone> {
        let ignored = self.0.iter().filter(|z| z.kind == ZoneKind::Ignore);
        ignored.filter(move |zone| zone.contains(place_m))
    }

    /// Whether a place is in a door.
    pub fn is_door(&self, place_m: [f64; 2]) -> bool {
        self.is_in(ZoneKind::Door, place_m)
    }

    /// Whether people lie at a place without having fallen.
    pub fn is_bed(&self, place_m: [f64; 2]) -> bool {
        self.is_in(ZoneKind::Bed, place_m)
    }

    fn is_in(&self, kind: ZoneKind, place_m: [f64; 2]) -> bool {
        let mut zones = self.0.iter().filter(|z| z.kind == kind);
        zones.any(|z| z.contains(place_m))
    }
}

impl Zone {
    /// Whether a place is in the zone, by the even-odd rule: a ray from the place crosses its edges an odd number of
    /// times. Of two zones that share an edge, a place on it is in one.
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let mut is_inside = false;
        for ([ax, ay], [bx, by]) in self.edges() {
            if (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) {
                is_inside = !is_inside;
            }
        }
        is_inside
    }

    fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let corners = self.polygon_m.iter().copied();
        corners.clone().zip(corners.cycle().skip(1))
    }

    fn check(&self, number: usize) -> Result<(), ZoneError> {
        let name = || self.name.clone();
        let found = self.name.len();
        if !(1..=MAX_NAME_BYTES).contains(&found) {
            return Err(ZoneError::Name { number, found });
        }
        let found = self.polygon_m.len();
        if !(3..=MAX_CORNERS).contains(&found) {
            return Err(ZoneError::Corners {
                name: name(),
                found,
            });
        }
        // `false` for what is no number.
        let is_near = |v: &f64| v.abs() <= MAX_CORNER_M;
        if let Some(i) = self.polygon_m.iter().position(|c| !c.iter().all(is_near)) {
            return Err(ZoneError::Corner {
                name: name(),
                corner: i + 1,
            });
        }
        if let Some(found) = self.below_m {
            if self.kind != ZoneKind::Ignore {
                return Err(ZoneError::HeightOfKind { name: name() });
            }
            if !(BELOW_M[0]..=BELOW_M[1]).contains(&found) {
                return Err(ZoneError::Height {
                    name: name(),
                    found,
                });
            }
        }
        let twice_m2: f64 = self.edges().map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
        match twice_m2.abs() >= 2.0 * MIN_AREA_M2 {
            true => Ok(()),
            false => Err(ZoneError::NoArea { name: name() }),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A rectangle from one corner to the opposite one.
    pub fn rectangle(kind: ZoneKind, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> Zone {
        Zone {
            name: format!("{kind:?}"),
            kind,
            polygon_m: vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
            below_m: None,
        }
    }

    #[test]
    fn a_place_is_inside_or_outside_also_of_bent_polygons() {
        // An L: the square of 2 m without its upper right quarter.
        let zone = Zone {
            name: "L".into(),
            kind: ZoneKind::Room,
            polygon_m: vec![
                [0.0, 0.0],
                [2.0, 0.0],
                [2.0, 1.0],
                [1.0, 1.0],
                [1.0, 2.0],
                [0.0, 2.0],
            ],
            below_m: None,
        };
        for (place, is_inside) in [
            ([0.5, 0.5], true),
            ([1.5, 0.5], true),
            ([0.5, 1.5], true),
            ([1.5, 1.5], false),
            ([-0.1, 0.5], false),
            ([0.5, 2.1], false),
            ([f64::NAN, 0.5], false),
            ([0.5, f64::NAN], false),
            ([f64::INFINITY, 0.5], false),
        ] {
            assert_eq!(zone.contains(place), is_inside, "{place:?}");
        }
        // Neighbours share no place and leave none out.
        let left = rectangle(ZoneKind::Room, [0.0, 0.0], [1.0, 1.0]);
        let right = rectangle(ZoneKind::Room, [1.0, 0.0], [2.0, 1.0]);
        for y in [0.0, 0.3, 0.9] {
            assert!(left.contains([1.0, y]) != right.contains([1.0, y]));
        }
    }

    #[test]
    fn rooms_doors_and_ignored_places() {
        let zones = Zones::new(vec![
            rectangle(ZoneKind::Room, [-2.0, 0.0], [2.0, 5.0]),
            rectangle(ZoneKind::Door, [2.0, 2.0], [2.5, 3.0]),
            rectangle(ZoneKind::Ignore, [-2.0, 4.0], [-1.0, 5.0]),
            rectangle(ZoneKind::Bed, [-4.0, 0.0], [-2.0, 2.0]),
        ])
        .unwrap();
        assert!(zones.is_bed([-3.0, 1.0]) && !zones.is_bed([0.0, 1.0]));
        for (place, counts) in [
            ([-3.0, 1.0], true),
            ([0.0, 2.0], true),
            ([2.2, 2.5], true),
            ([-1.5, 4.5], false),
            ([3.0, 2.5], false),
            ([f64::NAN, 2.5], false),
        ] {
            assert_eq!(zones.counts(place), counts, "{place:?}");
        }
        assert!(zones.is_door([2.2, 2.5]) && !zones.is_door([0.0, 2.0]));
        let none = Zones::default();
        assert!(none.counts([50.0, 50.0]) && !none.is_door([0.0, 0.0]));
        assert!(!none.counts([f64::NAN, 0.0]));
        // Without a room, people count outside of a door as well.
        let door = Zones::new(vec![rectangle(ZoneKind::Door, [2.0, 2.0], [2.5, 3.0])]).unwrap();
        assert!(door.counts([9.0, 9.0]));
    }

    #[test]
    fn a_zone_with_a_height_ignores_who_was_never_higher() {
        let with = |below_m: f64, kind: ZoneKind| Zone {
            below_m: Some(below_m),
            ..rectangle(kind, [0.0, 0.0], [2.0, 2.0])
        };
        let zones = Zones::new(vec![with(0.5, ZoneKind::Ignore)]).unwrap();
        assert!(zones.have_heights() && zones.counts([1.0, 1.0]));
        assert!(zones.is_low([1.0, 1.0], 0.49) && !zones.is_low([1.0, 1.0], 0.5));
        assert!(!zones.is_low([3.0, 1.0], 0.1));
        // Who is nowhere, and whose height is unknown, is not low.
        assert!(!zones.is_low([f64::NAN, 1.0], 0.1) && !zones.is_low([1.0, 1.0], f64::NAN));
        // A zone without a height ignores everybody, also within one that has a height.
        let both = vec![
            with(0.5, ZoneKind::Ignore),
            rectangle(ZoneKind::Ignore, [0.0, 0.0], [1.0, 1.0]),
        ];
        let both = Zones::new(both).unwrap();
        assert!(!both.counts([0.5, 0.5]) && both.counts([1.5, 1.5]));

        let error = |zone: Zone| Zones::new(vec![zone]).unwrap_err().to_string();
        assert!(error(with(0.5, ZoneKind::Bed)).contains("belongs to zones of the kind `ignore`"));
        for wrong in [0.04, 2.1, f64::NAN, -1.0] {
            assert!(error(with(wrong, ZoneKind::Ignore)).contains("0.05 to 2 m above the floor"));
        }
    }

    #[test]
    fn what_is_no_polygon_is_refused() {
        let good = rectangle(ZoneKind::Room, [0.0, 0.0], [1.0, 1.0]);
        let with = |change: &dyn Fn(&mut Zone)| {
            let mut zone = good.clone();
            change(&mut zone);
            Zones::new(vec![good.clone(), zone]).unwrap_err()
        };
        let error = with(&|z| z.name.clear());
        assert_eq!(
            error,
            ZoneError::Name {
                number: 2,
                found: 0
            }
        );
        let error = with(&|z| z.polygon_m.truncate(2));
        assert!(matches!(error, ZoneError::Corners { found: 2, .. }));
        let error = with(&|z| z.polygon_m[1][0] = f64::NAN);
        assert!(matches!(error, ZoneError::Corner { corner: 2, .. }));
        let error = with(&|z| z.polygon_m[3][1] = -1_000.1);
        assert!(matches!(error, ZoneError::Corner { corner: 4, .. }));
        let error = with(&|z| z.polygon_m = vec![[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]);
        assert!(matches!(error, ZoneError::NoArea { .. }));
        let error = Zones::new(vec![good.clone(); 65]).unwrap_err();
        assert_eq!(error, ZoneError::TooMany { found: 65 });
    }

    #[test]
    fn zones_are_read_by_name_and_strangers_refused() {
        let text = r#"{"name": "hall", "kind": "door", "polygon_m": [[0, 0], [1, 0], [1, 1]]}"#;
        let zone: Zone = serde_json::from_str(text).unwrap();
        assert_eq!(zone.kind, ZoneKind::Door);
        let wrong = text.replace("\"kind\"", "\"sort\"");
        assert!(serde_json::from_str::<Zone>(&wrong).is_err());
    }
}
