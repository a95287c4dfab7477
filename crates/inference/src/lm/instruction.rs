//! Instructions in a user's own words.
//!
//! Instruction tuning asks for each task in the words of many templates. An instruction in other words reaches the model as
//! it is; the task, and so the kind of the answer, is that of the template whose words are most alike.

use std::collections::BTreeSet;

use super::InputError;
use super::templates::{Piece, Task, pieces};

/// Tasks whose prompts contain radar codes and that instruction tuning teaches.
const TASKS: [Task; 3] = [Task::RadarToText, Task::RadarToLength, Task::Continuation];
const RADAR: &str = "{radar}";
/// Least likeness to a template, as [`likeness`] measures it: two of seven different words in common.
const MIN_ALIKE: f32 = 0.25;
/// Maximum length, bytes. Templates have at most twelve words.
const MAX_BYTES: usize = 500;

/// An instruction about a radar recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Instruction {
    prompt: String,
    task: Task,
    nearest: &'static str,
    likeness: f32,
}

impl Instruction {
    /// Reads an instruction. The radar codes take the place of `{radar}`, or follow the words.
    ///
    /// # Errors
    /// If the text has no words, is very long, has other placeholders, or is like no template.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let refused = |problem: String| Err(InputError::Instruction { problem });
        if text.len() > MAX_BYTES {
            return refused(format!("{} bytes, at most {MAX_BYTES}", text.len()));
        }
        let (mut n_radar, mut others) = (0, Vec::new());
        for piece in pieces(text) {
            match piece {
                Piece::Placeholder(RADAR) => n_radar += 1,
                Piece::Placeholder(other) => others.push(other),
                Piece::Words(words) if words.contains(['{', '}']) => others.push(words),
                Piece::Words(_) => {}
            }
        }
        if let Some(other) = others.first() {
            return refused(format!("`{other}`: the only placeholder is {RADAR}"));
        }
        if n_radar > 1 {
            return refused(format!("{RADAR} occurs {n_radar} times, at most once"));
        }
        let own = words(text);
        if own.is_empty() {
            return refused("it has no words".into());
        }
        let templates = TASKS
            .into_iter()
            .flat_map(|task| task.prompts().iter().map(move |prompt| (task, *prompt)));
        let rated = templates.map(|(task, prompt)| (likeness(&own, &words(prompt)), task, prompt));
        // Of equally likely ones the first is taken.
        let best = rated.reduce(|best, next| if next.0 > best.0 { next } else { best });
        let Some((likeness, task, nearest)) = best.filter(|best| best.0 >= MIN_ALIKE) else {
            return refused(format!(
                "`{text}` is like none of the instructions for describing, timing or continuing a motion, for example \
                 `{}`",
                Task::RadarToText.prompts()[17]
            ));
        };
        let prompt = match n_radar {
            0 => format!("{} {RADAR}", text.trim()),
            _ => text.trim().to_string(),
        };
        Ok(Self {
            prompt,
            task,
            nearest,
            likeness,
        })
    }

    /// The prompt, with `{radar}` in the place of the radar codes.
    pub fn prompt(&self) -> &str {
        &self.prompt
    }

    /// Task that is asked for.
    pub fn task(&self) -> Task {
        self.task
    }

    /// The most similar template.
    pub fn nearest(&self) -> &'static str {
        self.nearest
    }

    /// Likeness to the most similar template, 0..=1; 1 for the same words.
    pub fn likeness(&self) -> f32 {
        self.likeness
    }

    /// Whether these are the words of pretraining.
    pub(super) fn is_of_pretraining(&self) -> bool {
        self.task.prompts()[0] == self.nearest && self.likeness == 1.0
    }
}

fn words(text: &str) -> BTreeSet<String> {
    let text = text.replace(RADAR, " ").to_lowercase();
    let words = text.split(|c: char| !c.is_alphanumeric());
    words.filter(|w| !w.is_empty()).map(String::from).collect()
}

/// Number of common words in relation to the mean number of different words (Dice's coefficient).
fn likeness(a: &BTreeSet<String>, b: &BTreeSet<String>) -> f32 {
    let n_common = a.intersection(b).count();
    2.0 * n_common as f32 / (a.len() + b.len()).max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_get_the_task_that_they_ask_for() {
        for (text, task) in [
            ("Where does the person go?", Task::RadarToText),
            ("What is she doing?", Task::RadarToText),
            ("Describe the movement, please", Task::RadarToText),
            ("How long does the recording last?", Task::RadarToLength),
            ("How many seconds is it?", Task::RadarToLength),
            ("what happens next?", Task::Continuation),
            ("Continue the motion", Task::Continuation),
        ] {
            let instruction = Instruction::parse(text).unwrap();
            assert_eq!(
                instruction.task(),
                task,
                "{text}: {}",
                instruction.nearest()
            );
            assert_eq!(instruction.prompt(), format!("{text} {{radar}}"));
        }
    }

    #[test]
    fn every_template_is_its_own_nearest() {
        for task in TASKS {
            for prompt in task.prompts() {
                let instruction = Instruction::parse(prompt).unwrap();
                assert_eq!(instruction.likeness(), 1.0, "{prompt}");
                assert_eq!(instruction.prompt(), *prompt);
                assert_eq!(instruction.task(), task, "{prompt}");
            }
            assert!(
                Instruction::parse(task.prompts()[0])
                    .unwrap()
                    .is_of_pretraining()
            );
            assert!(
                !Instruction::parse(task.prompts()[1])
                    .unwrap()
                    .is_of_pretraining()
            );
        }
    }

    #[test]
    fn other_texts_are_refused_with_their_reason() {
        let long = "word ".repeat(200);
        for (text, reason) in [
            ("", "no words"),
            (" ?! {radar}", "no words"),
            ("colorless green ideas", "is like none"),
            ("describe {caption}", "{caption}"),
            ("describe {radar} and {radar}", "2 times"),
            ("describe { this", "{ this"),
            (long.as_str(), "at most 500"),
        ] {
            let error = Instruction::parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
