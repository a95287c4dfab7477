//! What builds without the feature `parquet` say of points files.

use std::{convert::Infallible, fs::File, path::Path};

use radarllm_base::PointFrame;

use crate::{DatasetError, PointsFile, PointsMeta};

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

/// Reads no points file.
pub struct PointsReader(Infallible);

impl PointsReader {
    /// As [`read_points`].
    ///
    /// # Errors
    /// [`DatasetError::WithoutParquet`], always.
    pub fn open(_: File, path: &Path) -> Result<Option<Self>, DatasetError> {
        Err(DatasetError::WithoutParquet { path: path.into() })
    }

    /// Is never called.
    pub fn meta(&self) -> &PointsMeta {
        match self.0 {}
    }

    /// Is never called.
    pub fn share_read(&self) -> f64 {
        match self.0 {}
    }

    /// Is never called.
    ///
    /// # Errors
    /// None.
    pub fn next_frame(&mut self) -> Result<Option<PointFrame>, DatasetError> {
        match self.0 {}
    }
}
