//! Ctrl-C during a training: the first ends it cleanly, the second at once.

#![expect(
    clippy::disallowed_methods,
    reason = "Ctrl-C ends the program, whose files are complete"
)]

use std::process;

use radarllm_train::harness::StopToken;

use crate::error::{CliError, CliResult};

/// Exit code of a program that was interrupted, as shells have it: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

/// A token that the first Ctrl-C stops. To be called once.
///
/// # Errors
/// If the system refuses the handler.
pub(crate) fn stop_on_ctrl_c() -> CliResult<StopToken> {
    let token = StopToken::default();
    let stop = token.clone();
    ctrlc::set_handler(move || {
        if stop.is_stopped() {
            process::exit(INTERRUPTED);
        }
        stop.stop();
        note!("stopping after the present update; Ctrl-C again ends at once");
    })
    .map_err(|e| CliError::new(format!("Ctrl-C: {e}")))?;
    Ok(token)
}

/// Ends an interrupted program whose files are complete.
pub(crate) fn exit() -> ! {
    process::exit(INTERRUPTED)
}
