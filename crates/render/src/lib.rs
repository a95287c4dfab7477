//! Visualisation of radar data: figures for papers, self-contained HTML pages and images of bodies.
//!
//! Inputs are plain structs; outputs are text or bytes. This crate opens no file. [`plot`] draws figures as SVG (heat
//! maps, point clouds, curves, histograms), [`page`] and [`report`] write self-contained HTML, [`raster`] renders
//! meshes to PNG.
//!
//! ```
//! use radarllm_render::plot::{Axis, LinePlot, Series};
//!
//! // Power over range: a target at 1.2 m.
//! let power_db = |range_m: f64| -40.0 * (range_m - 1.2).abs().min(1.0);
//! let ranges_m = (0..60).map(|bin| f64::from(bin) * 0.043);
//! let svg = LinePlot {
//!     title: "Range profile".into(),
//!     x: Axis::new("Range", "m"),
//!     y: Axis::new("Power", "dB"),
//!     series: vec![Series::new("", ranges_m.map(|r| [r, power_db(r)]))],
//!     ..LinePlot::default()
//! }
//! .to_svg();
//! assert!(svg.starts_with("<svg") && svg.contains(">Range (m)</text>"));
//! ```

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

#[cfg(feature = "video")]
pub mod avi;
mod markup;
pub mod page;
pub mod plot;
mod png_file;
pub mod raster;
pub mod report;

pub use png_file::PngError;
