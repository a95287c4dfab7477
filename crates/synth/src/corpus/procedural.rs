//! Procedural motions of this project, drawn at random from a seed.

use radarllm_base::{Motion, seed::derive_seed};
use radarllm_body::sample::canonicalize;
use radarllm_dataset::record::Split;
use radarllm_motions::{BuiltinRequest, PeopleRequest, people_request, random_request};
use serde::{Deserialize, Serialize};

use super::{Corpus, CorpusError, CorpusItem};

/// Randomly drawn built-in motions. Every item is its own group: parameters are drawn
/// independently, so a test item's parameters are unseen in training.
pub struct ProceduralCorpus {
    items: Vec<CorpusItem>,
    requests: Vec<(BuiltinRequest, u64)>,
}

/// How motions are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Draw {
    /// Evenly from the library, mostly as a whole: [`random_request`].
    #[default]
    Library,
    /// With the pace and size of people's own motions, most of them continuous: [`people_request`].
    People,
}

impl ProceduralCorpus {
    /// Draws `[train, val, test]` items.
    pub fn new(counts: [usize; 3], seed: u64, draw: Draw) -> Self {
        Self::new_until(counts, seed, draw, &|| false)
    }

    /// As [`Self::new`], but ends early once `stop` returns `true`, which is asked before every motion. The corpus lacks
    /// motions then.
    pub(crate) fn new_until(
        counts: [usize; 3],
        seed: u64,
        draw: Draw,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Self {
        let mut items = Vec::new();
        let mut requests = Vec::new();
        for (split, count, prefix) in [
            (Split::Train, counts[0], "train"),
            (Split::Val, counts[1], "val"),
            (Split::Test, counts[2], "test"),
        ] {
            for i in (0..count).take_while(|_| !stop()) {
                // Data sets of the same motions before different radars share ids; trainings refuse different motions
                // of one id, so that those of another seed need their own.
                let motion_id = match draw {
                    Draw::Library => format!("{prefix}-{i:06}"),
                    Draw::People => format!("people{seed}-{prefix}-{i:06}"),
                };
                let item_seed = derive_seed(seed, &motion_id);
                let PeopleRequest {
                    request,
                    is_continuous,
                } = match draw {
                    Draw::Library => PeopleRequest {
                        request: random_request(item_seed),
                        is_continuous: false,
                    },
                    Draw::People => people_request(item_seed),
                };
                // Motions are rendered when their clips are made: every process opens the whole plan.
                items.push(CorpusItem {
                    group: motion_id.clone(),
                    motion_id,
                    split,
                    action: request.action(),
                    captions: request.captions(item_seed),
                    is_continuous,
                });
                requests.push((request, item_seed));
            }
        }
        Self { items, requests }
    }
}

impl Corpus for ProceduralCorpus {
    fn name(&self) -> &str {
        "procedural"
    }

    fn licence(&self) -> &str {
        "MIT OR Apache-2.0"
    }

    fn attribution(&self) -> &str {
        "procedural motions of the RadarLLM project"
    }

    fn items(&self) -> &[CorpusItem] {
        &self.items
    }

    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError> {
        let (request, seed) = &self.requests[item_idx];
        let mut motion = request.render(*seed).motion;
        canonicalize(&mut motion);
        Ok(motion)
    }
}
