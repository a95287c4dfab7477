//! File access that several crates share: NumPy arrays, atomic writing and bounded reading.
//!
//! External bytes are untrusted until they are checked. Every reader has a size limit, allocates according to the
//! available bytes rather than to a header, and names the invalid byte in its errors. Every writer is atomic: until the
//! new file is complete, the old one, if any, remains under the final name.
//!
//! ```
//! use radarllm_files::{atomic, bounded, npy::NpyArray};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("points.npy");
//! let mut npy = b"\x93NUMPY\x01\x00\x3a\x00".to_vec();
//! npy.extend(format!("{:<58}", "{'descr': '<f4', 'fortran_order': False, 'shape': (2,)}").bytes());
//! npy.extend([1.5_f32, -2.0].iter().flat_map(|v| v.to_le_bytes()));
//! atomic::write_bytes(&path, atomic::Existing::Refuse, &npy)?;
//!
//! let bytes = bounded::read_bytes(&path, 1 << 20)?;
//! let array = NpyArray::new(&bytes)?;
//! assert_eq!(array.header.shape, [2]);
//! assert_eq!(array.numbers(), Some(vec![1.5, -2.0]));
//! # Ok(())
//! # }
//! ```
//!
//! Reading order: [`bounded`], [`atomic`], [`lock`] (files that several processes change), [`npy`] (arrays in memory, as streams and in archives), [`literal`] (the
//! Python literals of npy headers and calibration files).
//!
//! This crate does not interpret the content of files, and depends on no other crate of the project.

#![cfg_attr(test, allow(unreachable_pub, reason = "tests"))]
#![allow(
    clippy::disallowed_methods,
    reason = "this crate opens files for the others"
)]
#![forbid(unsafe_code)]

pub mod atomic;
pub mod bounded;
pub mod literal;
pub mod lock;
pub mod npy;
