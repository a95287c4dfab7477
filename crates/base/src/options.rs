//! Options that are numbers.

/// An option that is out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("option `{field}`: expected {expected}, found {found}")]
pub struct OptionError {
    /// Name of the option.
    pub field: &'static str,
    /// Permitted values.
    pub expected: &'static str,
    /// Value found.
    pub found: f64,
}

/// Checks a value.
///
/// # Errors
/// A value outside `low..=high`, or NaN.
pub fn within(
    field: &'static str,
    found: f64,
    [low, high]: [f64; 2],
    expected: &'static str,
) -> Result<(), OptionError> {
    match (low..=high).contains(&found) {
        true => Ok(()),
        false => Err(OptionError {
            field,
            expected,
            found,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_within_and_nan_is_not() {
        let check = |found| within("share", found, [0.0, 1.0], "0 to 1");
        assert_eq!(check(0.0), Ok(()));
        assert_eq!(check(1.0), Ok(()));
        assert!(check(f64::NAN).is_err());
        assert_eq!(
            check(1.5).unwrap_err().to_string(),
            "option `share`: expected 0 to 1, found 1.5"
        );
    }
}
