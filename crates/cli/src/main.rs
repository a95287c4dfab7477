//! The `radarllm` command.
fn main() {}
