//! What every crate does with files, once: reading NumPy arrays, writing atomically, reading no more than expected.
//!
//! Bytes from outside are hostile until they are checked: every reader has a limit, allocates by what is there and not by
//! what a header claims, and says which byte is wrong. Every writer leaves the old file, or none, under the final name
//! until the new one is whole.
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
//! Reading order: [`bounded`], [`atomic`], [`npy`] (arrays in memory, as streams and in archives), [`literal`] (the
//! Python literals of npy headers and calibration files).
//!
//! Deliberately absent: what the files mean. No other crate of the project is known here.
#![forbid(unsafe_code)]

pub mod atomic;
pub mod bounded;
pub mod literal;
pub mod npy;
