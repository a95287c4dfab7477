//! What the demo shows, here and in the command `radarllm demo`: built-in motions, and the recording of a simulated board
//! with what was performed in front of it.
//!
//! The files are in the folder `recording` of this crate, with a README that says how they were made. Simulating,
//! describing and printing are absent: `main.rs` is the shortest program that does it.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

/// Motions in front of a simulated radar.
pub const MOTIONS: [&str; 3] = [
    "builtin:walk?direction=backward",
    "builtin:sit_down",
    "builtin:wave?side=left",
];

/// Says what the recording is.
pub const BOARD: &str = "One minute in front of a board. The board is simulated, too: simulated-uart.dat is what the serial port of an
AWR1843BOOST with out-of-box firmware would send.
";

/// A file of the recording: its name and its bytes.
macro_rules! file {
    ($name:literal) => {
        ($name, include_bytes!(concat!("../recording/", $name)))
    };
}

/// The stream of the board's serial port.
pub const STREAM: (&str, &[u8]) = file!("simulated-uart.dat");
/// Seed of the simulated recording.
pub const SEED: u64 = 1;
/// The chirp configuration of the board.
pub const CHIRPS: (&str, &[u8]) = file!("simulated-uart.cfg");
/// What the person of the recording did: first and last second, sentence.
const PERFORMED: &str = include_str!("../recording/simulated-uart.txt");

/// What the person of the recording did for most of the time between two times, s.
pub fn performed_in(start_s: f64, end_s: f64) -> &'static str {
    let shared_s = |line: &&str| {
        let mut words = line.split(' ');
        let mut second = || words.next()?.parse::<f64>().ok();
        let (from_s, to_s) = (second().unwrap_or(0.0), second().unwrap_or(0.0));
        to_s.min(end_s) - from_s.max(start_s)
    };
    let best = PERFORMED
        .lines()
        .max_by(|a, b| shared_s(a).total_cmp(&shared_s(b)));
    best.and_then(|line| line.splitn(3, ' ').nth(2))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_of_the_recording_has_a_sentence() {
        for line in PERFORMED.lines() {
            let words: Vec<&str> = line.splitn(3, ' ').collect();
            let [from_s, to_s] = [words[0], words[1]].map(|w| w.parse::<f64>().unwrap());
            assert_eq!(performed_in(from_s + 0.1, to_s + 0.05), words[2]);
        }
    }
}
