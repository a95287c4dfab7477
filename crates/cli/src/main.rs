//! The binary of the `radarllm` command.

use std::process::ExitCode;

/// burn frees and asks for large tensors all the time; an allocator that keeps pages is worth
/// about a third of the training time there.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(radarllm_cli::run(std::env::args_os()))
}
