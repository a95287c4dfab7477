//! Pictures and the self-contained page: points over time, mesh, range-Doppler, PNG.

pub mod page;
pub mod plot;
pub mod raster;
