//! Procedural motions of this project, drawn at random from a seed.

use radarllm_base::{Motion, seed::derive_seed};
use radarllm_body::sample::canonicalize;
use radarllm_dataset::record::Split;
use radarllm_facts::{Facts, facts, score::compare};
use radarllm_motions::{
    PeopleRequest, once_request, pair_request, people_request, random_request, side_request,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Corpus, CorpusError, CorpusItem, recipe_of};

/// Draws of one motion until it states none of [`ProceduralConfig::held_out`].
const MAX_DRAWS: usize = 1000;

/// What a data set draws from the motions of this project.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProceduralConfig {
    /// Number of training motions.
    pub train: usize,
    /// Number of validation motions.
    pub val: usize,
    /// Number of test motions.
    pub test: usize,
    /// How motions are drawn.
    #[serde(default, skip_serializing_if = "Draw::is_library")]
    pub draw: Draw,
    /// Sentences. No training or validation motion has a caption that states all that one of them states; test motions
    /// may: kinds of motion (`a person kicks`), combinations (`a person walks and then waves`) and attributes
    /// (`a person squats quickly`) that judge a model which has not learned them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held_out: Vec<String>,
}

impl ProceduralConfig {
    /// # Errors
    /// A held-out sentence that states no action.
    pub(crate) fn check(&self) -> Result<(), String> {
        let empty = |text: &&String| facts(text).actions().next().is_none();
        match self.held_out.iter().find(empty) {
            Some(text) => Err(format!("held_out: `{text}` states no known action")),
            None => Ok(()),
        }
    }
}

/// Randomly drawn built-in motions. Every item is its own group: parameters are drawn
/// independently, so a test item's parameters are unseen in training.
pub struct ProceduralCorpus {
    how: Draw,
    items: Vec<CorpusItem>,
    /// Seed of every item.
    seeds: Vec<u64>,
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
    /// Short motions that people make once, such as raising a hand: [`once_request`].
    Once,
    /// Two motions in sequence: [`pair_request`].
    Pairs,
    /// One motion of the left, the right or both sides, each equally often: [`side_request`].
    Sides,
}

impl Draw {
    fn is_library(&self) -> bool {
        *self == Self::Library
    }
}

impl ProceduralCorpus {
    /// Draws the items of a configuration.
    ///
    /// # Errors
    /// `held_out` leaves hardly anything to draw.
    pub fn new(config: &ProceduralConfig, seed: u64) -> Result<Self, CorpusError> {
        Self::new_until(config, seed, &|| false)
    }

    /// As [`Self::new`], but ends early once `stop` returns `true`, which is asked before every motion. The corpus lacks
    /// motions then.
    pub(crate) fn new_until(
        config: &ProceduralConfig,
        seed: u64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, CorpusError> {
        let held_out: Vec<Facts> = config.held_out.iter().map(|text| facts(text)).collect();
        let mut items = Vec::new();
        let mut seeds = Vec::new();
        for (split, count, prefix) in [
            (Split::Train, config.train, "train"),
            (Split::Val, config.val, "val"),
            (Split::Test, config.test, "test"),
        ] {
            let held_out = match split {
                Split::Test => &[][..],
                Split::Train | Split::Val => &held_out,
            };
            let item = |i: usize| {
                // Data sets of the same motions before different radars share ids; trainings refuse different motions
                // of one id, so that those of another seed need their own.
                let motion_id = match config.draw {
                    Draw::Library => format!("{prefix}-{i:06}"),
                    Draw::People => format!("people{seed}-{prefix}-{i:06}"),
                    Draw::Once => format!("once{seed}-{prefix}-{i:06}"),
                    Draw::Pairs => format!("pairs{seed}-{prefix}-{i:06}"),
                    Draw::Sides => format!("sides{seed}-{prefix}-{i:06}"),
                };
                let Some((people, item_seed)) = draw(config.draw, &motion_id, seed, held_out)
                else {
                    return Err(CorpusError::Motion {
                        id: motion_id,
                        problem: format!(
                            "{MAX_DRAWS} draws state what `held_out` names: it leaves too little"
                        ),
                    });
                };
                let PeopleRequest {
                    request,
                    is_continuous,
                } = people;
                // Motions are rendered when their clips are made.
                let item = CorpusItem {
                    group: motion_id.clone(),
                    motion_id,
                    split,
                    action: request.action(),
                    captions: request.captions(item_seed),
                    is_continuous,
                };
                Ok((item, item_seed))
            };
            let drawn: Vec<(CorpusItem, u64)> = (0..count)
                .into_par_iter()
                .filter(|_| !stop())
                .map(item)
                .collect::<Result<_, _>>()?;
            for (item, item_seed) in drawn {
                items.push(item);
                seeds.push(item_seed);
            }
        }
        Ok(Self {
            how: config.draw,
            items,
            seeds,
        })
    }

    /// Items that were drawn before.
    ///
    /// # Errors
    /// A recipe of another source.
    pub(crate) fn of_items(
        how: Draw,
        drawn: Vec<(CorpusItem, Value)>,
    ) -> Result<Self, CorpusError> {
        let (mut items, mut seeds) = (Vec::new(), Vec::new());
        for (item, recipe) in drawn {
            seeds.push(recipe_of(&item, recipe)?);
            items.push(item);
        }
        Ok(Self { how, items, seeds })
    }
}

/// A motion whose captions state nothing that is held out, with its seed.
fn draw(how: Draw, id: &str, seed: u64, held_out: &[Facts]) -> Option<(PeopleRequest, u64)> {
    (0..MAX_DRAWS).find_map(|n| {
        let item_seed = match n {
            0 => derive_seed(seed, id),
            _ => derive_seed(seed, &format!("{id}, draw {n}")),
        };
        let drawn = request(how, item_seed);
        let is_held_out = !held_out.is_empty()
            && drawn.request.captions(item_seed).iter().any(|text| {
                let stated = facts(text);
                held_out.iter().any(|fact| states_all(&stated, fact))
            });
        (!is_held_out).then_some((drawn, item_seed))
    })
}

/// The motion of a seed.
fn request(how: Draw, item_seed: u64) -> PeopleRequest {
    let not_continuous = |request| PeopleRequest {
        request,
        is_continuous: false,
    };
    match how {
        Draw::Library => not_continuous(random_request(item_seed)),
        Draw::People => people_request(item_seed),
        Draw::Once => not_continuous(once_request(item_seed)),
        Draw::Pairs => not_continuous(pair_request(item_seed)),
        Draw::Sides => side_request(item_seed),
    }
}

/// Whether a sentence states the actions of another in their order, with the attributes that are stated there.
fn states_all(sentence: &Facts, other: &Facts) -> bool {
    let all = compare(sentence, other).all();
    all.common == all.reference
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
        let seed = self.seeds[item_idx];
        let mut motion = request(self.how, seed).request.render(seed).motion;
        canonicalize(&mut motion);
        Ok(motion)
    }

    fn recipe(&self, item_idx: usize) -> Value {
        self.seeds[item_idx].into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corpus(held_out: &[&str]) -> ProceduralCorpus {
        let config = ProceduralConfig {
            train: 150,
            val: 10,
            test: 150,
            held_out: held_out.iter().map(|&text| text.into()).collect(),
            ..Default::default()
        };
        ProceduralCorpus::new(&config, 3).unwrap()
    }

    fn count(corpus: &ProceduralCorpus, is_test: bool, states: impl Fn(&Facts) -> bool) -> usize {
        let own = corpus.items.iter();
        own.filter(|item| (item.split == Split::Test) == is_test)
            .filter(|item| item.captions.iter().any(|text| states(&facts(text))))
            .count()
    }

    #[test]
    fn held_out_facts_are_in_test_motions_only() {
        let names = |f: &Facts| f.actions().map(|a| a.name).collect::<Vec<_>>();
        let kicks = |f: &Facts| names(f).contains(&"kick");
        let slow_walk = |f: &Facts| states_all(f, &facts("a person walks slowly"));
        let walks = |f: &Facts| names(f).contains(&"walk");
        let [without, with] = [&["a person kicks", "a person walks slowly"][..], &[]].map(corpus);
        for states in [&kicks as &dyn Fn(&Facts) -> bool, &slow_walk] {
            assert_eq!(count(&without, false, states), 0);
            assert!(count(&without, true, states) > 0);
            assert!(count(&with, false, states) > 0);
        }
        // Only the combination of action and attribute is left out.
        assert!(count(&without, false, walks) > 0);
        // Nothing else changes: motions that state nothing of that are the same in both.
        let same = |a: &CorpusItem, b: &CorpusItem| a == b;
        let pairs = || without.items.iter().zip(&with.items);
        assert!(pairs().all(|(a, b)| {
            let kept = !b.captions.iter().any(|text| {
                let stated = facts(text);
                kicks(&stated) || slow_walk(&stated)
            });
            a.split != Split::Test && !kept || same(a, b)
        }));
    }

    #[test]
    fn a_config_that_leaves_nothing_is_refused() {
        let config = |held_out: &str| ProceduralConfig {
            held_out: vec![held_out.into()],
            ..Default::default()
        };
        let problem = config("a person").check().unwrap_err();
        assert!(
            problem.contains("`a person` states no known action"),
            "{problem}"
        );
        assert_eq!(config("a person kicks").check(), Ok(()));
    }
}
