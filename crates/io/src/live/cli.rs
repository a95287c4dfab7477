//! The command line of a TI demo: sends a chirp file line by line and checks every answer.

use std::{
    fmt,
    io::{ErrorKind, Read as _},
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

use crate::serial::Terminal;

/// Baud rate of the command line of TI's demos.
const BAUD: u32 = 115_200;
/// Maximum length of an answer, bytes. No demo sends as much.
const MAX_ANSWER_BYTES: usize = 8 << 10;
/// Maximum number of characters of an answer in a message.
const MAX_WORDS: usize = 200;
/// Time that a board takes to change its baud rate after it has accepted the command.
const BAUD_CHANGE: Duration = Duration::from_millis(100);
/// How long the rest of an error's text is awaited.
const REST_OF_ERROR: Duration = Duration::from_millis(100);

/// A command of a chirp file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Command {
    /// Line in the file, from 1.
    pub line: usize,
    pub text: String,
}

/// The commands of a chirp file, without comments and empty lines.
pub(super) fn commands(cfg: &str) -> Vec<Command> {
    let code = |line: &str| {
        let code = line.split_once('%').map_or(line, |(code, _)| code);
        code.trim().to_string()
    };
    let lines = cfg.lines().enumerate().map(|(i, line)| Command {
        line: i + 1,
        text: code(line),
    });
    lines.filter(|c| !c.text.is_empty()).collect()
}

/// Why a chirp file was not accepted.
#[derive(Debug)]
pub(super) enum CliError {
    /// The port failed.
    Port(std::io::Error),
    /// The board refused a command, or did not answer.
    Refused { command: Command, words: String },
}

impl fmt::Display for CliError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(error) => error.fmt(f),
            Self::Refused { command, words } => {
                write!(
                    f,
                    "line {} of the chirp file, `{}`: {words}",
                    command.line, command.text
                )
            }
        }
    }
}

impl std::error::Error for CliError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Port(error) => Some(error),
            Self::Refused { .. } => None,
        }
    }
}

/// A chirp file on its way to the board.
pub(super) struct Sending {
    port: Terminal,
    commands: Arc<[Command]>,
    next: usize,
    /// The answer to the command that was sent last, and when it must be complete; `None` between commands.
    open: Option<(Vec<u8>, Instant)>,
    answer_time: Duration,
}

impl Sending {
    pub(super) fn open(
        path: &Path,
        commands: Arc<[Command]>,
        answer_time: Duration,
    ) -> std::io::Result<Self> {
        Ok(Self {
            port: Terminal::open(path, BAUD)?,
            commands,
            next: 0,
            open: None,
            answer_time,
        })
    }

    /// Goes on until `until`. Returns true once the board has accepted every command.
    pub(super) fn step(&mut self, until: Instant) -> Result<bool, CliError> {
        let mut piece = [0; 512];
        loop {
            let Some(command) = self.commands.get(self.next) else {
                return Ok(true);
            };
            let Some((answer, deadline)) = &mut self.open else {
                // What is left of the answer before, such as the prompt, is not part of the next one.
                self.port.discard_input().map_err(CliError::Port)?;
                let deadline = Instant::now() + self.answer_time;
                let line = format!("{}\n", command.text);
                match self.port.write_until(line.as_bytes(), deadline) {
                    Err(e) if e.kind() == ErrorKind::TimedOut => {
                        return Err(refused(command, "the port takes no bytes"));
                    }
                    sent => sent.map_err(CliError::Port)?,
                }
                self.open = Some((Vec::new(), deadline));
                continue;
            };
            let now = Instant::now();
            let verdict = Verdict::of(answer, &command.text);
            match verdict {
                Verdict::Done => {
                    if let Some(baud) = new_baud(&command.text) {
                        std::thread::sleep(BAUD_CHANGE);
                        let changed = self.port.set_baud(baud);
                        changed.map_err(|e| refused(command, &e.to_string()))?;
                    }
                    self.open = None;
                    self.next += 1;
                    continue;
                }
                Verdict::Error { is_whole: true } => {
                    return Err(refused(command, &words(answer, &command.text)));
                }
                Verdict::Error { is_whole: false } => {
                    *deadline = (*deadline).min(now + REST_OF_ERROR);
                }
                Verdict::Open => {}
            }
            if now >= *deadline || answer.len() > MAX_ANSWER_BYTES {
                let words = match words(answer, &command.text) {
                    words if matches!(verdict, Verdict::Error { .. }) => words,
                    words if words.is_empty() => {
                        format!("no answer in {:.1} s", self.answer_time.as_secs_f64())
                    }
                    words => format!(
                        "no `Done` in {:.1} s, but `{words}`",
                        self.answer_time.as_secs_f64()
                    ),
                };
                return Err(refused(command, &words));
            }
            if now >= until {
                return Ok(false);
            }
            let left = until.min(*deadline).saturating_duration_since(now);
            let read = match self.port.wait(left) {
                Ok(false) => continue,
                Ok(true) => self.port.read(&mut piece),
                Err(e) => Err(e),
            };
            match read {
                Ok(0) => return Err(CliError::Port(ErrorKind::UnexpectedEof.into())),
                Ok(n) => answer.extend_from_slice(&piece[..n]),
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                Err(e) => return Err(CliError::Port(e)),
            }
        }
    }
}

/// The baud rate that a command gives to the port. The low-power SDK has such a command, because its command line and
/// its packets share one port.
fn new_baud(command: &str) -> Option<u32> {
    let mut words = command.split_whitespace();
    if words.next() != Some("baudRate") {
        return None;
    }
    words.next()?.parse().ok()
}

fn refused(command: &Command, words: &str) -> CliError {
    CliError::Refused {
        command: command.clone(),
        words: words.into(),
    }
}

/// What an answer says so far.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    /// Not yet decided.
    Open,
    Done,
    /// An error. Its text is whole once the board prompts for the next command.
    Error {
        is_whole: bool,
    },
}

impl Verdict {
    fn of(answer: &[u8], command: &str) -> Self {
        let text = String::from_utf8_lossy(answer);
        // The last line may be incomplete.
        let Some(end) = text.rfind(['\r', '\n']) else {
            return Self::Open;
        };
        let mut verdict = Self::Open;
        for line in lines(&text[..end], command) {
            let lower = line.to_lowercase();
            if lower.starts_with("error") || lower.contains("not recognized") {
                let is_whole = text[end..].trim_end().ends_with(":/>");
                return Self::Error { is_whole };
            }
            if lower == "done" {
                verdict = Self::Done;
            }
        }
        verdict
    }
}

/// Lines of an answer without prompts and without the echo of the command.
fn lines<'a>(text: &'a str, command: &'a str) -> impl Iterator<Item = &'a str> {
    text.split(['\r', '\n'])
        .map(|line| {
            line.rsplit_once(":/>")
                .map_or(line, |(_, rest)| rest)
                .trim()
        })
        .filter(move |line| !line.is_empty() && *line != command)
}

/// The answer as one line of printable text.
fn words(answer: &[u8], command: &str) -> String {
    let text = String::from_utf8_lossy(answer);
    let lines: Vec<&str> = lines(&text, command).collect();
    let printable = lines.join("; ").replace(char::is_control, " ");
    printable.chars().take(MAX_WORDS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_empty_lines_are_not_sent() {
        let found = commands("% a comment\r\n\r\nsensorStop\n  flushCfg % all\n\t\n");
        let command = |line, text: &str| Command {
            line,
            text: text.into(),
        };
        assert_eq!(found, [command(3, "sensorStop"), command(4, "flushCfg")]);
    }

    #[test]
    fn only_the_command_of_the_baud_rate_changes_it() {
        assert_eq!(new_baud("baudRate 1250000"), Some(1_250_000));
        assert_eq!(new_baud("baudRate\t115200  1"), Some(115_200));
        for other in [
            "",
            "baudRate",
            "baudRate -1",
            "baudRate 1e6",
            "baudRates 1250000",
        ] {
            assert_eq!(new_baud(other), None, "{other:?}");
        }
    }

    #[test]
    fn answers_are_judged_by_whole_lines() {
        let verdict = |answer: &str| Verdict::of(answer.as_bytes(), "sensorStart");
        for open in ["", "sensorStart\r\n", "Done", "Debug: 3\nDo", "Doneness\n"] {
            assert_eq!(verdict(open), Verdict::Open, "{open:?}");
        }
        for done in [
            "Done\n",
            "sensorStart\n\rDone\n\rmmwDemo:/>",
            "mmwDemo:/>sensorStart\r\nIgnored: Sensor is already started\r\nDone\r\n",
        ] {
            assert_eq!(verdict(done), Verdict::Done, "{done:?}");
        }
        let is_whole = false;
        assert_eq!(verdict("Error -1\r\n"), Verdict::Error { is_whole });
        let is_whole = true;
        for error in [
            "sensorStart\r\nError: not configured\r\nError -1\r\nmmwDemo:/>",
            "'sensorStart' is not recognized as a CLI command\r\nmmwDemo:/>",
            // A demo that closes its errors like everything else.
            "Error -1\nDone\n\rmmwDemo:/>",
        ] {
            assert_eq!(verdict(error), Verdict::Error { is_whole }, "{error:?}");
        }
        let said = "sensorStart\r\nError: \u{7}not configured\r\nError -1\r\nmmwDemo:/>";
        assert_eq!(
            words(said.as_bytes(), "sensorStart"),
            "Error:  not configured; Error -1"
        );
        assert!(words(&[0xFF; 9000], "sensorStart").chars().count() <= MAX_WORDS);
    }
}
