//! The file of a site: what its radar's mounting was found to be, in TOML.

use std::path::Path;

use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{Error, Result};
use radarllm_measure::{Site, SiteDeviation};
use serde::{Deserialize, Serialize};

/// Angles are at most this large, degrees, and heights this far from the radar, m.
const MAX_TILT_DEG: f32 = 90.0;
const MAX_HEIGHT_M: f32 = 10.0;
const MAX_DISTANCE_M: f32 = 300.0;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SiteToml {
    /// Name of the radar.
    radar: String,
    /// Tilt to be added to the stated one, degrees.
    tilt_deg: f32,
    /// Height at which a standing person is tracked, m above the radar.
    standing_m: f32,
    /// Time of walking by which it was learned, s.
    walking_s: f32,
    /// Standard deviations of the tilt, degrees, and of the standing height at a distance, m.
    tilt_error_deg: f32,
    standing_error_m: f32,
    known_at_m: f32,
    /// Stated height of the radar above the floor where it was learned, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stated_height_m: Option<f32>,
}

/// The text of a site's file.
///
/// # Errors
/// Never for a site that was learned: its values are finite.
pub fn site_to_toml(site: &Site) -> Result<String> {
    let file = SiteToml {
        radar: site.radar.clone(),
        tilt_deg: site.tilt_rad.to_degrees(),
        standing_m: site.standing_m,
        walking_s: site.walking_s,
        tilt_error_deg: site.error.tilt_rad.to_degrees(),
        standing_error_m: site.error.standing_m,
        known_at_m: site.error.distance_m,
        stated_height_m: site.stated_height_m,
    };
    toml::to_string(&file).map_err(Error::wrap)
}

/// Reads the file of a site.
///
/// # Errors
/// A file that cannot be read or is no site's, and values that no mounting has.
pub fn read_site(path: &Path) -> Result<Site> {
    let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    let file: SiteToml = toml::from_str(&text).map_err(|e| Error::wrap_in_file(path, e))?;
    let limits = [
        ("tilt_deg", file.tilt_deg, MAX_TILT_DEG),
        ("standing_m", file.standing_m, MAX_HEIGHT_M),
        ("tilt_error_deg", file.tilt_error_deg, MAX_TILT_DEG),
        ("standing_error_m", file.standing_error_m, MAX_HEIGHT_M),
        ("known_at_m", file.known_at_m, MAX_DISTANCE_M),
        (
            "stated_height_m",
            file.stated_height_m.unwrap_or_default(),
            MAX_HEIGHT_M,
        ),
    ];
    for (name, value, limit) in limits {
        if value.is_nan() || value.abs() > limit {
            return Err(Error::in_file(
                path,
                format!("{name} = {value}: must be within +-{limit}"),
            ));
        }
    }
    let signless = [
        ("walking_s", file.walking_s),
        ("tilt_error_deg", file.tilt_error_deg),
        ("standing_error_m", file.standing_error_m),
        ("known_at_m", file.known_at_m),
    ];
    for (name, value) in signless {
        if value.is_nan() || value < 0.0 {
            return Err(Error::in_file(
                path,
                format!("{name} = {value}: must not be negative"),
            ));
        }
    }
    Ok(Site {
        radar: file.radar,
        tilt_rad: file.tilt_deg.to_radians(),
        standing_m: file.standing_m,
        walking_s: file.walking_s,
        error: SiteDeviation {
            tilt_rad: file.tilt_error_deg.to_radians(),
            standing_m: file.standing_error_m,
            distance_m: file.known_at_m,
        },
        is_height_assumed: false,
        stated_height_m: file.stated_height_m,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_is_read_as_it_was_written_and_impossible_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("site.toml");
        let site = Site {
            radar: "iwr6843".into(),
            tilt_rad: 0.2,
            standing_m: -0.3,
            walking_s: 42.0,
            error: SiteDeviation {
                tilt_rad: 0.01,
                standing_m: 0.03,
                distance_m: 2.5,
            },
            is_height_assumed: false,
            stated_height_m: Some(1.5),
        };
        let text = site_to_toml(&site).unwrap();
        std::fs::write(&path, &text).unwrap();
        let read = read_site(&path).unwrap();
        assert!((read.tilt_rad - 0.2).abs() < 1e-6);
        assert_eq!((read.radar, read.standing_m), (site.radar, -0.3));
        assert_eq!(read.stated_height_m, Some(1.5));
        for broken in ["tilt_deg = nan", "tilt_deg = 1e9"] {
            let line = text.lines().find(|l| l.starts_with("tilt")).unwrap();
            std::fs::write(&path, text.replace(line, broken)).unwrap();
            let error = read_site(&path).unwrap_err().to_string();
            assert!(error.contains("site.toml: tilt_deg"), "{error}");
        }
        for name in [
            "walking_s",
            "tilt_error_deg",
            "standing_error_m",
            "known_at_m",
        ] {
            let line = text.lines().find(|l| l.starts_with(name)).unwrap();
            std::fs::write(&path, text.replace(line, &format!("{name} = -1.0"))).unwrap();
            let error = read_site(&path).unwrap_err().to_string();
            assert!(
                error.contains(&format!("site.toml: {name} = -1")),
                "{error}"
            );
        }
    }
}
