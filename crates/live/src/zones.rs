//! Zones of a room from a TOML file.

use std::path::Path;

use radarllm::{Error, Result};
use radarllm_monitor::zones::{Zone, ZoneKind, Zones};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ZonesFile {
    #[serde(default)]
    zone: Vec<ZoneEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ZoneEntry {
    name: String,
    kind: Kind,
    polygon_m: Vec<[f64; 2]>,
    below_m: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Room,
    Ignore,
    Door,
    Bed,
}

/// Reads zones: `[[zone]]` with `name`, `kind` (`room`, `ignore`, `door` or `bed`), `polygon_m` (corners to the right of the
/// radar and away from it, m) and, for the kind `ignore`, `below_m` (height above the floor below which it ignores, m).
///
/// ```
/// let text = "[[zone]]\nname = 'hall'\nkind = 'door'\npolygon_m = [[1, 4], [2, 4], [2, 5]]\n";
/// let zones = radarllm_live::zones::parse(std::path::Path::new("room.toml"), text)?;
/// assert!(zones.is_door([1.8, 4.3]));
/// # Ok::<(), radarllm::Error>(())
/// ```
///
/// # Errors
/// Text that is no such file, and polygons that are none.
pub fn parse(path: &Path, text: &str) -> Result<Zones> {
    let file: ZonesFile = toml::from_str(text).map_err(|e| Error::wrap_in_file(path, e))?;
    let zone = |entry: ZoneEntry| Zone {
        name: entry.name,
        kind: match entry.kind {
            Kind::Room => ZoneKind::Room,
            Kind::Ignore => ZoneKind::Ignore,
            Kind::Door => ZoneKind::Door,
            Kind::Bed => ZoneKind::Bed,
        },
        polygon_m: entry.polygon_m,
        below_m: entry.below_m,
    };
    Zones::new(file.zone.into_iter().map(zone).collect()).map_err(|e| Error::wrap_in_file(path, e))
}

/// The name of a kind of zone in messages.
pub(crate) fn kind_name(kind: ZoneKind) -> &'static str {
    match kind {
        ZoneKind::Room => "room",
        ZoneKind::Ignore => "ignore",
        ZoneKind::Door => "door",
        ZoneKind::Bed => "bed",
    }
}
