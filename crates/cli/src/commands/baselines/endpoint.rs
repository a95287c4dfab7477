//! Asks a server with the interface of OpenAI's chat completions about videos: frames as images, then the prompt.

use std::{path::Path, time::Duration};

use base64::prelude::{BASE64_STANDARD, Engine};
use radarllm_io::http::{HttpUrl, Limits, post_json};
use serde::Deserialize;
use serde_json::json;

use super::prompts::{Answer, FrameKind, Prompt, Renders, hash_of, read_answers};
use crate::{
    error::{CliError, CliResult},
    output,
};

/// Variable of the environment with the bearer token of the server.
pub(super) const TOKEN_VARIABLE: &str = "RADARLLM_ENDPOINT_TOKEN";
/// Limits of an answer: large models on a CPU take minutes.
const LIMITS: Limits = Limits {
    max_bytes: 4 << 20,
    timeout: Duration::from_secs(600),
};
/// Path of the interface.
const CHAT: &str = "chat/completions";
/// [`Answer::commit`] where the server states none.
const NOT_STATED: &str = "not stated by the server";

/// A server, and how it is asked.
#[derive(Debug)]
pub(super) struct Endpoint {
    url: HttpUrl,
    model: Option<String>,
    n_frames: usize,
    token: Option<String>,
}

/// The part of a reply that is used.
#[derive(Deserialize)]
struct Reply {
    model: Option<String>,
    system_fingerprint: Option<String>,
    choices: Vec<Choice>,
}

#[derive(Deserialize)]
struct Choice {
    message: Message,
    finish_reason: Option<String>,
}

#[derive(Deserialize)]
struct Message {
    content: Option<String>,
}

impl Endpoint {
    /// A server by its address, with or without the path of the interface. The token is that of [`TOKEN_VARIABLE`].
    pub(super) fn new(url: &str, model: Option<&str>, n_frames: usize) -> CliResult<Self> {
        let parsed = HttpUrl::parse(url)?;
        Ok(Self {
            url: match url.trim_end_matches('/').ends_with(CHAT) {
                true => parsed,
                false => parsed.join(CHAT),
            },
            model: model.map(Into::into),
            n_frames,
            token: std::env::var(TOKEN_VARIABLE).ok().filter(|t| !t.is_empty()),
        })
    }

    /// Asks about every video. Answers are kept in `out` as they come, and those that are there already are not asked for
    /// again.
    pub(super) fn ask_all(&self, renders: &Renders, out: &Path) -> CliResult<Vec<(usize, Answer)>> {
        let asked = format!(
            "{} {:?} {} {}",
            self.url, self.model, self.n_frames, renders.blake3
        );
        let name = format!("endpoint-{}.jsonl", &hash_of(asked.as_bytes())[..16]);
        let path = out.join("answers").join(name);
        let mut answers: Vec<Answer> = match path.is_file() {
            true => read_answers(&path)?.into_iter().map(|(_, a)| a).collect(),
            false => Vec::new(),
        };
        if !answers.is_empty() {
            note!(
                "{}: {} answers are there already; delete it to ask again",
                path.display(),
                answers.len()
            );
        }
        for (i, prompt) in renders.prompts.iter().enumerate() {
            if answers.iter().any(|answer| answer.id == prompt.id) {
                continue;
            }
            answers.push(self.ask(renders, prompt)?);
            output::write_atomic(&path, output::json_lines(&answers)?.as_bytes())?;
            note!("{} of {} videos", i + 1, renders.prompts.len());
        }
        Ok((1..).zip(answers).collect())
    }

    /// Asks about one video.
    fn ask(&self, renders: &Renders, prompt: &Prompt) -> CliResult<Answer> {
        let frames = renders.frames_of(prompt)?;
        let mime = match renders.render.frames {
            FrameKind::Avi => "image/jpeg",
            FrameKind::Png => "image/png",
        };
        let mut content: Vec<serde_json::Value> = evenly(frames.len(), self.n_frames)
            .into_iter()
            .filter_map(|i| frames.get(i))
            .map(|frame| {
                let url = format!("data:{mime};base64,{}", BASE64_STANDARD.encode(frame));
                json!({ "type": "image_url", "image_url": { "url": url } })
            })
            .collect();
        content.push(json!({ "type": "text", "text": prompt.prompt }));
        let mut body = json!({
            "messages": [{ "role": "user", "content": content }],
            "temperature": 0,
        });
        if let Some(model) = &self.model {
            body["model"] = json!(model);
        }
        let reply = post_json(
            &self.url,
            self.token.as_deref(),
            &serde_json::to_vec(&body)?,
            LIMITS,
        )
        .map_err(|e| {
            let mut error = CliError::from(e);
            error.cause = format!("clip `{}`: {}", prompt.id, error.cause);
            match (&error.hint, &self.model) {
                (None, None) => {
                    error.hint("--endpoint-model names the model, which some servers require")
                }
                _ => error,
            }
        })?;
        self.answer(prompt, &reply)
    }

    /// The answer in a reply.
    fn answer(&self, prompt: &Prompt, reply: &[u8]) -> CliResult<Answer> {
        let fail = |problem: String| {
            CliError::new(format!("clip `{}`: {}: {problem}", prompt.id, self.url))
        };
        let reply: Reply = serde_json::from_slice(reply)
            .map_err(|e| fail(format!("not a chat completion: {e}")))?;
        let model = reply
            .model
            .filter(|model| !model.trim().is_empty())
            .ok_or_else(|| fail("the reply does not name its model".into()))?;
        let choice = reply.choices.into_iter().next();
        let choice = choice.ok_or_else(|| fail("a reply without choices".into()))?;
        if choice.finish_reason.as_deref() == Some("length") {
            note!(
                "clip `{}`: the server cut the answer at its own limit of length",
                prompt.id
            );
        }
        let text = choice.message.content.unwrap_or_default();
        if text.trim().is_empty() {
            return Err(fail("the answer is empty".into()));
        }
        Ok(Answer {
            id: prompt.id.clone(),
            text,
            blake3: prompt.blake3.clone(),
            weights: format!(
                "{model}, as {} serves it, {} frames a video",
                self.url, self.n_frames
            ),
            model,
            commit: reply
                .system_fingerprint
                .unwrap_or_else(|| NOT_STATED.into()),
        })
    }
}

/// Indices of `n` of `total` frames, evenly spaced from the first to the last; all of them if there are fewer.
fn evenly(total: usize, n: usize) -> Vec<usize> {
    match n {
        _ if n >= total => (0..total).collect(),
        0 => Vec::new(),
        1 => vec![total / 2],
        _ => (0..n)
            .map(|i| (i * (total - 1) + (n - 1) / 2) / (n - 1))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_evenly_spaced_from_first_to_last() {
        assert_eq!(evenly(101, 5), [0, 25, 50, 75, 100]);
        assert_eq!(evenly(8, 3), [0, 4, 7]);
        assert_eq!(evenly(3, 8), [0, 1, 2]);
        assert_eq!(evenly(9, 1), [4]);
        assert!(evenly(0, 8).is_empty() && evenly(5, 0).is_empty());
    }

    #[test]
    fn replies_are_answers_or_say_what_is_missing() {
        let endpoint = Endpoint::new("http://localhost:8000/v1", None, 8).unwrap();
        assert_eq!(
            endpoint.url.to_string(),
            "http://localhost:8000/v1/chat/completions"
        );
        let whole = Endpoint::new("http://h/v1/chat/completions", None, 8).unwrap();
        assert_eq!(whole.url.to_string(), "http://h:80/v1/chat/completions");
        let prompt = Prompt {
            id: "a#0".into(),
            video: "0.avi".into(),
            prompt: "?".into(),
            blake3: "hash".into(),
        };
        let of = |reply: &str| endpoint.answer(&prompt, reply.as_bytes());
        let answer =
            of(r#"{"model": "m", "choices": [{"message": {"content": " A.\n"}}], "x": 1}"#);
        let answer = answer.unwrap();
        // Nothing is cleaned.
        assert_eq!(
            (answer.text.as_str(), answer.model.as_str()),
            (" A.\n", "m")
        );
        assert!(answer.weights.contains("8 frames") && answer.commit == NOT_STATED);
        for (reply, expected) in [
            ("[]", "not a chat completion"),
            (
                r#"{"choices": [{"message": {"content": "A"}}]}"#,
                "does not name its model",
            ),
            (r#"{"model": "m", "choices": []}"#, "without choices"),
            (
                r#"{"model": "m", "choices": [{"message": {"content": null}}]}"#,
                "empty",
            ),
        ] {
            let cause = of(reply).unwrap_err().cause;
            assert!(cause.contains(expected) && cause.contains("a#0"), "{cause}");
        }
    }
}
