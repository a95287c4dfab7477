//! Sentences without motions, from which the language model learns to write.

use std::path::{Path, PathBuf};

use radarllm_files::bounded;

use crate::harness::TrainError;

/// Most bytes of a file of sentences; all sentences of HumanML3D have 3 MB.
pub(crate) const MAX_SENTENCES_BYTES: u64 = 1 << 28;

/// Reads files of sentences: UTF-8 text with a sentence on each line. Empty lines are left out.
///
/// # Errors
/// If a file cannot be read, is no UTF-8 text, is larger than 256 MiB, or has no sentence; the message has the line.
pub fn read_sentences(files: &[PathBuf]) -> Result<Vec<String>, TrainError> {
    let mut sentences = Vec::new();
    for path in files {
        let before = sentences.len();
        let text = read(path)?;
        for (i, line) in text.split(|byte| *byte == b'\n').enumerate() {
            let line = std::str::from_utf8(line)
                .map_err(|e| problem(path, format!("line {}: {e}", i + 1)))?
                .trim();
            // A byte without meaning in a sentence shows that this is another kind of file.
            if let Some(c) = line.chars().find(|c| c.is_control() && *c != '\t') {
                return Err(problem(path, format!("line {}: contains {c:?}", i + 1)));
            }
            if !line.is_empty() {
                sentences.push(line.into());
            }
        }
        if sentences.len() == before {
            return Err(problem(path, "contains no sentence".into()));
        }
    }
    Ok(sentences)
}

fn read(path: &Path) -> Result<Vec<u8>, TrainError> {
    bounded::read_bytes(path, MAX_SENTENCES_BYTES)
        .map_err(|e| problem(path, e.into_io().to_string()))
}

fn problem(path: &Path, problem: String) -> TrainError {
    TrainError::Config {
        field: "sentences".into(),
        problem: format!("{}: {problem}", path.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_are_lines_and_other_files_are_refused() {
        let dir = std::env::temp_dir().join(format!("radarllm-sentences-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = dir.join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let good = write("good.txt", b"a person walks\r\n\n  a man jumps twice  \n");
        let more = write("more.txt", "a woman dances the cha\u{2011}cha".as_bytes());
        let read = read_sentences(&[good, more]).unwrap();
        let expected = [
            "a person walks",
            "a man jumps twice",
            "a woman dances the cha\u{2011}cha",
        ];
        assert_eq!(read, expected);
        for (name, bytes, part) in [
            ("latin.txt", &b"a person walks\na caf\xe9\n"[..], "line 2"),
            ("zstd", b"walks\n\x28\x01\x02", "line 2: contains"),
            ("empty.txt", b"\n \n", "contains no sentence"),
        ] {
            let error = read_sentences(&[write(name, bytes)])
                .unwrap_err()
                .to_string();
            assert!(error.contains(part) && error.contains(name), "{error}");
        }
        let error = read_sentences(&[dir.join("missing")])
            .unwrap_err()
            .to_string();
        assert!(error.contains("missing"), "{error}");
        std::fs::remove_dir_all(dir).unwrap();
    }
}
