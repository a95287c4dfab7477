//! Recordings, and a radar that runs: does a model name what people did, and does it notice falls?

pub mod boards;
pub mod falls;
pub mod features;
pub mod forest;
pub mod proxy;
pub mod radhar;
pub mod recordings;
