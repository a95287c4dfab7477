//! The log of a run: `log.jsonl`, one JSON object per line, and the same numbers for TensorBoard.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use radarllm_files::atomic::{self, Existing};
use radarllm_files::bounded;
use serde_json::{Map, Value};

use crate::error::TrainError;
use crate::event_file;

/// Maximum size of a log, bytes: a line of 200 bytes for each of five million updates.
const MAX_LOG_BYTES: u64 = 1 << 30;
const LOG_FILE: &str = "log.jsonl";
/// TensorBoard reads files whose names contain `tfevents`.
const EVENT_FILE: &str = "events.out.tfevents.radarllm";

/// The log of a run.
pub(crate) struct Log {
    lines: PathBuf,
    events: PathBuf,
}

impl Log {
    /// The log in the folder of a run.
    pub(crate) fn of(out_dir: &Path) -> Self {
        Self {
            lines: out_dir.join(LOG_FILE),
            events: out_dir.join(EVENT_FILE),
        }
    }

    /// Whether a line has been written.
    pub(crate) fn exists(&self) -> bool {
        self.lines.exists()
    }

    pub(crate) fn append(&self, line: &Map<String, Value>) -> Result<(), TrainError> {
        let text = Value::Object(line.clone()).to_string() + "\n";
        append_to(&self.lines, text.as_bytes())?;
        let now_s = now_s();
        let mut records = Vec::new();
        if !self.events.exists() {
            records.extend(event_file::header(now_s));
        }
        records.extend(event(line, now_s));
        append_to(&self.events, &records)
    }

    /// Removes the lines written after the checkpoint from which a run resumes.
    pub(crate) fn truncate_after(&self, step: u64) -> Result<(), TrainError> {
        if !self.lines.exists() {
            return Ok(());
        }
        let io = |path: &Path, source| TrainError::Io {
            path: path.into(),
            source,
        };
        let text = bounded::read_text(&self.lines, MAX_LOG_BYTES)
            .map_err(|e| io(&self.lines, e.into_io()))?;
        let kept: Vec<(&str, Map<String, Value>)> = text
            .lines()
            .filter_map(|line| Some((line, serde_json::from_str(line).ok()?)))
            .filter(|(_, line)| number(line, "step").is_some_and(|s| s <= step as f64))
            .collect();
        let lines: String = kept.iter().flat_map(|(line, _)| [*line, "\n"]).collect();
        // The time continues as if the run had not been interrupted.
        let seconds = |line: &Map<String, Value>| number(line, "seconds").unwrap_or(0.0);
        let last_s = kept.last().map_or(0.0, |(_, line)| seconds(line));
        let begin_s = now_s() - last_s;
        let mut records = event_file::header(begin_s);
        for (_, line) in &kept {
            records.extend(event(line, begin_s + seconds(line)));
        }
        for (path, bytes) in [(&self.lines, lines.as_bytes()), (&self.events, &records)] {
            atomic::write_bytes(path, Existing::Replace, bytes)
                .map_err(|e| io(path, std::io::Error::other(e)))?;
        }
        Ok(())
    }

    /// Removes the log.
    pub(crate) fn remove(&self) -> Result<(), TrainError> {
        for path in [&self.lines, &self.events] {
            match fs::remove_file(path) {
                Err(source) if source.kind() != ErrorKind::NotFound => {
                    let path = path.clone();
                    return Err(TrainError::Io { path, source });
                }
                _ => {}
            }
        }
        Ok(())
    }
}

fn append_to(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .and_then(|mut file| file.write_all(bytes))
        .map_err(|source| TrainError::Io {
            path: path.into(),
            source,
        })
}

/// Record of the numbers of a line, named `train/...` or `validation/...`.
fn event(line: &Map<String, Value>, wall_time_s: f64) -> Vec<u8> {
    let kind = match line.contains_key("validation") {
        true => "validation",
        false => "train",
    };
    let values: Vec<(String, f64)> = line
        .keys()
        .filter(|key| *key != "step")
        .filter_map(|key| Some((format!("{kind}/{key}"), number(line, key)?)))
        .collect();
    let step = line.get("step").and_then(Value::as_u64).unwrap_or(0);
    event_file::scalars(wall_time_s, step, &values)
}

fn number(line: &Map<String, Value>, key: &str) -> Option<f64> {
    line.get(key).and_then(Value::as_f64)
}

/// Seconds since 1970-01-01.
fn now_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |s| s.as_secs_f64())
}

/// JSON has no NaN; null is written instead.
pub(crate) fn json_number(value: f64) -> Value {
    serde_json::Number::from_f64(value).map_or(Value::Null, Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> Map<String, Value> {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn a_resumed_log_has_what_was_before_the_checkpoint_in_both_files() {
        let dir = std::env::temp_dir().join(format!("radarllm-log-{}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        let log = Log::of(&dir);
        log.append(&line(r#"{"step":1,"loss":2.5,"seconds":1.0}"#))
            .unwrap();
        log.append(&line(
            r#"{"validation":true,"step":2,"score":0.5,"best":true}"#,
        ))
        .unwrap();
        let before = fs::read(&log.events).unwrap();
        log.append(&line(r#"{"step":3,"loss":null,"seconds":9.0}"#))
            .unwrap();
        log.truncate_after(2).unwrap();
        let text = fs::read_to_string(&log.lines).unwrap();
        assert_eq!(text.lines().count(), 2);
        // Only the times, and therefore the checksums, differ.
        let after = fs::read(&log.events).unwrap();
        assert_eq!(after.len(), before.len());
        let tags = ["train/loss", "train/seconds", "validation/score"];
        for tag in tags {
            let found = |bytes: &[u8]| {
                bytes
                    .windows(tag.len())
                    .filter(|w| *w == tag.as_bytes())
                    .count()
            };
            assert_eq!((found(&before), found(&after)), (1, 1), "{tag}");
        }
        log.remove().unwrap();
        assert_eq!(fs::read_dir(&dir).unwrap().count(), 0);
        fs::remove_dir_all(dir).unwrap();
    }
}
