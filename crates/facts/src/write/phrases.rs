//! Words of the writer that belong to no action.

/// Objects that people handle.
pub(super) const THINGS: &str = include_str!("../../data/things.txt");

/// Adjectives of objects.
pub(super) const ADJECTIVES: &str = include_str!("../../data/adjectives.txt");
