//! Pictures and self-contained pages: points over time, mesh, range-Doppler, PNG.

pub mod page;
pub mod plot;
pub mod raster;
pub mod report;
