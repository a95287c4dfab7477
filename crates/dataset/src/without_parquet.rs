//! What builds without the feature `parquet` say of points files.

use std::path::Path;

use crate::{DatasetError, PointsFile};

/// Reads no points file.
///
/// # Errors
/// [`DatasetError::WithoutParquet`], always.
pub fn read_points(path: &Path) -> Result<PointsFile, DatasetError> {
    Err(DatasetError::WithoutParquet { path: path.into() })
}
