//! What builds without the feature `parquet` say of points files.

use std::{fs::File, path::Path};

use crate::{DatasetError, PointsFile};

/// Reads no points file.
///
/// # Errors
/// [`DatasetError::WithoutParquet`], always.
pub fn read_points(path: &Path) -> Result<PointsFile, DatasetError> {
    Err(DatasetError::WithoutParquet { path: path.into() })
}

/// As [`read_points`], from a file that is open.
///
/// # Errors
/// [`DatasetError::WithoutParquet`], always.
pub fn read_points_from(_: File, path: &Path) -> Result<PointsFile, DatasetError> {
    read_points(path)
}
