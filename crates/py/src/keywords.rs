//! What the options of the library are called in Python.

/// Options whose keyword has another name, because in Python it has its unit.
pub(crate) const RENAMED: [(&str, &str); 6] = [
    ("background_cell", "background_cell_m"),
    ("background_velocity", "background_velocity_mps"),
    ("frame_rate", "frame_rate_hz"),
    ("frames", "max_frames"),
    ("min_speed", "min_speed_mps"),
    ("remove_leakage", "remove_leakage_m"),
];

/// The keyword that sets an option of the library, in backticks as texts of the package write it: `` `frame_rate_hz` ``
/// for `frame_rate`.
pub(crate) fn keyword(option: &str) -> String {
    match RENAMED.iter().find(|(name, _)| *name == option) {
        Some((_, keyword)) => format!("`{keyword}`"),
        None if option == "overwrite" => "`overwrite=True`".into(),
        None => format!("`{option}`"),
    }
}
