//! `log.jsonl`: one JSON object per line.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use crate::error::TrainError;

/// The log of a run.
pub(crate) struct Log {
    pub(crate) path: PathBuf,
}

impl Log {
    fn io(&self, source: std::io::Error) -> TrainError {
        TrainError::Io {
            path: self.path.clone(),
            source,
        }
    }

    pub(crate) fn append(
        &self,
        line: &serde_json::Map<String, serde_json::Value>,
    ) -> Result<(), TrainError> {
        let mut file = fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&self.path)
            .map_err(|e| self.io(e))?;
        let text = serde_json::Value::Object(line.clone()).to_string() + "\n";
        file.write_all(text.as_bytes()).map_err(|e| self.io(e))
    }

    /// Drops lines written after the checkpoint that a run resumes from.
    pub(crate) fn truncate_after(&self, step: u64) -> Result<(), TrainError> {
        if !self.path.exists() {
            return Ok(());
        }
        let text = fs::read_to_string(&self.path).map_err(|e| self.io(e))?;
        let kept: String = text
            .lines()
            .filter(|line| {
                serde_json::from_str::<serde_json::Value>(line)
                    .ok()
                    .and_then(|v| v.get("step").and_then(serde_json::Value::as_u64))
                    .is_some_and(|s| s <= step)
            })
            .flat_map(|line| [line, "\n"])
            .collect();
        fs::write(&self.path, kept).map_err(|e| self.io(e))
    }
}

/// JSON has no NaN; null says "not a number".
pub(crate) fn json_number(value: f64) -> serde_json::Value {
    serde_json::Number::from_f64(value).map_or(serde_json::Value::Null, Into::into)
}
