//! `score`.

use pyo3::{
    prelude::*,
    types::{PyDict, PyDictMethods, PyString},
};
use radarllm::{
    CaptionScores, Error,
    metrics::{Candidate, Protocol, Reference, ScoreOptions, score as score_all},
};
use serde::Serialize;

use crate::{errors, work};

/// A value as Python objects, with the fields in their order.
pub(crate) fn to_python<'py>(
    py: Python<'py>,
    value: &impl Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(errors::system)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Caption metrics: BLEU-1 to 4, ROUGE, METEOR, CIDEr and others, with 95 % bootstrap intervals.
///
/// `candidates` are sentences and `references` lists of sentences, both in the same order, or both dictionaries by id.
/// `protocol` is "plain", "nlg-eval", "coco" or "motiongpt": how texts become words, and the rules of a known scoring
/// program. Of each item the first `max_references` references count; 0 counts all. `resamples` are those of the bootstrap,
/// `seed` is its seed.
///
/// Returns the dictionary that `radarllm score` prints; what cannot be computed is None, with the reason under "reason".
///
/// >>> scores = score(["a person walks"], [["a person walks", "somebody is walking"]])
/// >>> round(scores["bleu_1"], 6), list(scores)[:2]
/// (1.0, ['protocol', 'tokenisation'])
#[pyfunction]
#[pyo3(signature = (candidates, references, *, protocol="plain", max_references=3, resamples=1000, seed=1))]
pub(crate) fn score<'py>(
    candidates: &Bound<'py, PyAny>,
    references: &Bound<'py, PyAny>,
    protocol: &str,
    max_references: usize,
    resamples: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyAny>> {
    let py = candidates.py();
    let protocol = Protocol::from_name(protocol).ok_or_else(|| {
        errors::input_with_hint(
            format!("`protocol` {protocol:?}: unknown"),
            "plain, nlg-eval, coco or motiongpt",
        )
    })?;
    let candidates: Vec<Candidate> = by_id(candidates)?
        .into_iter()
        .map(|(id, text)| {
            Ok(Candidate {
                text: text.extract()?,
                id,
            })
        })
        .collect::<PyResult<_>>()?;
    let references: Vec<Reference> = by_id(references)?
        .into_iter()
        .map(|(id, texts)| {
            // A text is a sequence of letters, which nobody means.
            if texts.is_instance_of::<PyString>() {
                return Err(errors::input_with_hint(
                    format!("references: those of {id:?} are one text"),
                    "a list of texts for each item",
                ));
            }
            Ok(Reference {
                texts: texts.extract()?,
                id,
            })
        })
        .collect::<PyResult<_>>()?;
    let options = ScoreOptions {
        protocol,
        max_references,
        n_resamples: resamples,
        seed,
    };
    let scores = work::run(py, |_| {
        let scores = score_all(&candidates, &references, &options).map_err(Error::wrap)?;
        Ok(CaptionScores::new(scores, &candidates, &references))
    })?;
    to_python(py, &scores)
}

/// Items of a dictionary by id, or of a sequence by their number.
fn by_id<'py>(items: &Bound<'py, PyAny>) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
    if let Ok(items) = items.cast::<PyDict>() {
        return items
            .iter()
            .map(|(id, value)| Ok((id.str()?.to_string(), value)))
            .collect();
    }
    items
        .try_iter()?
        .enumerate()
        .map(|(index, value)| Ok((index.to_string(), value?)))
        .collect()
}
