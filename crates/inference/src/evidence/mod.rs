//! What the points of a window say by themselves: which actions they show, and which hand or leg moves.
//!
//! The language model reads codes of 0.4 s, features beside them and a context of tokens, and puts what it reads into
//! words. Two small networks read the same points as numbers of the whole window ([`values`]), which takes them seconds to
//! learn: one tells the actions, and one the side of a given action, because a fist approaches beside the body to which it
//! belongs, and the shoulder of a throwing arm recedes first. They know no words and err differently, so that the captioner
//! weighs the sentences that the language model draws with what they say (`lm/ensemble.rs`).
//!
//! Both networks see the mirror image, too, so that what they say of left and right is the same.

pub mod values;

use radarllm_engine::EngineError;
use radarllm_engine::evidence as engine;
use radarllm_facts::{Action, Side, parse};
use serde::{Deserialize, Serialize};

use crate::checkpoint::{CONFIG_FILE, Checkpoint, CheckpointError, MODEL_FILE};

pub use radarllm_engine::evidence::N_SIDES;
pub use values::{N_VALUES, WindowValues};

/// `kind` in the `config.json` of the networks.
pub const EVIDENCE_KIND: &str = "evidence";
/// Name of all contents with several actions that have no name of their own.
pub const SEVERAL: &str = "several";
/// Standardised values are limited to this many standard deviations.
const LIMIT: f32 = 5.0;

/// The sides in the order of the network's outputs.
pub const SIDES: [Side; N_SIDES] = [Side::Left, Side::Right, Side::Both];

/// What a window can show.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Content {
    /// Names of the actions ([`content_of`]), or [`SEVERAL`].
    pub name: String,
    /// Sentences that state it, one for each side and direction that it can have; none of [`SEVERAL`].
    pub sentences: Vec<String>,
}

/// An action that is made with one side, or with both.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SidedAction {
    /// Name, as [`radarllm_facts`] has it.
    pub name: String,
    /// Whether it can be made with both sides.
    pub has_both: bool,
}

/// `config.json` of the networks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvidenceFile {
    /// [`EVIDENCE_KIND`].
    pub kind: String,
    /// What the network of actions tells apart, in the order of its outputs.
    pub contents: Vec<Content>,
    /// Actions whose side the network of sides knows.
    pub sided: Vec<SidedAction>,
    /// Widths of the two hidden layers.
    pub hidden: [usize; 2],
    /// Mean of each value, `[N_VALUES]`.
    pub mean: Vec<f32>,
    /// Standard deviation of each value, `[N_VALUES]`.
    pub deviation: Vec<f32>,
    /// Training settings, for the record; not read.
    #[serde(default)]
    pub training: serde_json::Value,
}

impl EvidenceFile {
    /// Shape of the networks.
    pub fn shape(&self) -> engine::EvidenceShape {
        engine::EvidenceShape {
            values: N_VALUES,
            contents: self.contents.len(),
            sided: self.sided.len(),
            hidden: self.hidden,
        }
    }

    /// # Errors
    /// Names the first value that cannot be used.
    fn check(&self) -> Result<(), String> {
        for (field, values) in [("mean", &self.mean), ("deviation", &self.deviation)] {
            if values.len() != N_VALUES {
                let n = values.len();
                return Err(format!("{field}: {n} values, expected {N_VALUES}"));
            }
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(format!("{field}: value {i} is not finite"));
            }
        }
        if let Some(i) = self.deviation.iter().position(|v| *v <= 0.0) {
            return Err(format!("deviation: value {i} is not positive"));
        }
        self.shape().validate().map_err(|e| e.to_string())
    }

    /// Standardised values, as the networks read them.
    pub fn standardised(&self, values: &[f32]) -> Vec<f32> {
        let moments = self.mean.iter().zip(&self.deviation);
        let standard = |(value, (mean, deviation)): (&f32, (&f32, &f32))| {
            ((value - mean) / deviation).clamp(-LIMIT, LIMIT)
        };
        values.iter().zip(moments).map(standard).collect()
    }

    /// Index of the content that a sentence states; `None` if it states none of them.
    pub fn index_of(&self, text: &str) -> Option<usize> {
        let name = content_of(text)?;
        let index = |name: &str| self.contents.iter().position(|c| c.name == name);
        index(&name).or_else(|| match name.contains(' ') {
            true => index(SEVERAL),
            false => None,
        })
    }
}

/// Trained networks.
pub struct Evidence {
    file: EvidenceFile,
    networks: engine::EvidenceNetworks,
}

impl Evidence {
    /// The networks of an opened checkpoint.
    ///
    /// # Errors
    /// If it is damaged or contains something else.
    pub fn of(checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        let file: EvidenceFile = checkpoint.config(
            EVIDENCE_KIND,
            |f: &EvidenceFile| &f.kind,
            EvidenceFile::check,
        )?;
        let weights = checkpoint.tensors(MODEL_FILE)?;
        let networks = engine::EvidenceNetworks::new(file.shape(), weights).map_err(|e| {
            let named = match e {
                EngineError::Shape { .. } => CONFIG_FILE,
                _ => MODEL_FILE,
            };
            CheckpointError::from_engine(e, &checkpoint.dir().join(named))
        })?;
        Ok(Self { file, networks })
    }

    /// Number of weights of both networks.
    pub fn n_params(&self) -> usize {
        self.file.shape().n_params()
    }

    /// What the networks tell apart.
    pub fn file(&self) -> &EvidenceFile {
        &self.file
    }

    /// Removes sentences, such as those with words that a language model does not know.
    pub fn keep_sentences(&mut self, keep: impl Fn(&str) -> bool) {
        for content in &mut self.file.contents {
            content.sentences.retain(|text| keep(text));
        }
    }

    /// Probabilities of the contents, in their order.
    pub fn contents(&self, values: &WindowValues) -> Vec<f32> {
        let of = |values: &[f32]| softmax(self.networks.actions(&self.file.standardised(values)));
        let (seen, mirrored) = (of(values.seen()), of(values.mirrored()));
        let mean = seen.iter().zip(mirrored).map(|(a, b)| 0.5 * (a + b));
        mean.collect()
    }

    /// Probabilities of [`SIDES`] for an action of which it is known that it has a side; `None` if the network does not know
    /// the side of this action.
    pub fn sides(&self, values: &WindowValues, action: &str) -> Option<[f32; N_SIDES]> {
        let index = self.file.sided.iter().position(|a| a.name == action)?;
        let n = match self.file.sided[index].has_both {
            true => N_SIDES,
            false => N_SIDES - 1,
        };
        let of = |values: &[f32]| {
            let logits = self.networks.sides(&self.file.standardised(values), index);
            let mut all = softmax(logits[..n].to_vec());
            all.resize(N_SIDES, 0.0);
            all
        };
        let (seen, mirrored) = (of(values.seen()), of(values.mirrored()));
        let exchanged = [mirrored[1], mirrored[0], mirrored[2]];
        Some(std::array::from_fn(|i| 0.5 * (seen[i] + exchanged[i])))
    }
}

fn softmax(logits: Vec<f32>) -> Vec<f32> {
    let max = logits.iter().copied().fold(f32::MIN, f32::max);
    let all: Vec<f32> = logits.into_iter().map(|v| (v - max).exp()).collect();
    let sum: f32 = all.iter().sum();
    all.into_iter().map(|v| v / sum).collect()
}

/// The names of the actions that a sentence states, in order: several at once are joined by ` while `, several after each
/// other by ` then `. `None` if it states none.
pub fn content_of(text: &str) -> Option<String> {
    let clauses = parse(text);
    let names = |actions: &[Action]| {
        let names: Vec<&str> = actions.iter().map(|a| a.name).collect();
        names.join(" while ")
    };
    let stating = clauses.iter().filter(|c| !c.actions.is_empty());
    let all: Vec<String> = stating.map(|c| names(&c.actions)).collect();
    (!all.is_empty()).then(|| all.join(" then "))
}

/// The only action of a sentence that states a side, and that side; `None` if several do, or none.
pub fn only_side(text: &str) -> Option<(&'static str, Side)> {
    let clauses = parse(text);
    let sided = |a: &Action| a.side.map(|side| (a.name, side));
    let mut all = clauses.iter().flat_map(|c| &c.actions).filter_map(sided);
    match (all.next(), all.next()) {
        (Some(only), None) => Some(only),
        _ => None,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::values::tests::of_cell_index;
    pub(crate) use super::values::tests::punches;
    use super::*;
    use radarllm_engine::{HostTensor, NamedTensors};

    pub(crate) fn file(contents: &[&str], sided: &[(&str, bool)]) -> EvidenceFile {
        let action = |(name, has_both): &(&str, bool)| SidedAction {
            name: (*name).into(),
            has_both: *has_both,
        };
        let content = |name: &&str| Content {
            name: (*name).into(),
            sentences: Vec::new(),
        };
        EvidenceFile {
            kind: EVIDENCE_KIND.into(),
            contents: contents.iter().map(content).collect(),
            sided: sided.iter().map(action).collect(),
            hidden: [2, 2],
            mean: vec![0.0; N_VALUES],
            deviation: vec![1.0; N_VALUES],
            training: serde_json::Value::Null,
        }
    }

    /// Networks that decide by the mean offset of the fast approaching points above the legs: the farther, the rather the
    /// first content, and the left hand at positive offsets.
    pub(crate) fn networks(file: EvidenceFile) -> Evidence {
        let value = of_cell_index(1, 2, 0);
        let tensor = |shape: [usize; 2], values: Vec<f32>| HostTensor {
            shape: shape.into(),
            values,
        };
        let mut weights = NamedTensors::new();
        let shape = file.shape();
        let mut add = |name: &str, inputs: usize, out: Vec<f32>, bias: Vec<f32>| {
            let mut widen = vec![0.0; 2 * inputs];
            (widen[2 * value], widen[2 * value + 1]) = (10.0, -10.0);
            let identity = vec![1.0, 0.0, 0.0, 1.0];
            for (part, values) in [
                ("widen.weight", tensor([inputs, 2], widen)),
                ("widen.bias", HostTensor::vector(vec![0.0; 2])),
                ("middle.weight", tensor([2, 2], identity)),
                ("middle.bias", HostTensor::vector(vec![0.0; 2])),
                ("out.weight", tensor([2, bias.len()], out)),
                ("out.bias", HostTensor::vector(bias)),
            ] {
                weights.insert(format!("{name}.{part}"), values);
            }
        };
        // A hand at positive offsets is the left one of these networks.
        let out = vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        add("sides", N_VALUES + shape.sided, out, vec![0.0, 0.0, 5.0]);
        add(
            "actions",
            N_VALUES,
            vec![1.0, 0.0, 1.0, 0.0],
            vec![0.0, 1.0],
        );
        Evidence {
            networks: engine::EvidenceNetworks::new(shape, weights).unwrap(),
            file,
        }
    }

    #[test]
    fn left_and_right_are_told_alike_and_both_only_where_there_can_be_both() {
        let file = file(&["punch", "walk"], &[("punch", true), ("kick", false)]);
        let networks = networks(file);
        let [left, right] = [0.3, -0.3].map(|m| WindowValues::of(&punches(m, 1.0), 1.0).unwrap());
        let of = |values, action| networks.sides(values, action).unwrap();
        let (kicks, mirrored) = (of(&left, "kick"), of(&right, "kick"));
        assert!(kicks[0] > 0.8 && kicks[2] == 0.0, "{kicks:?}");
        // The random body is another one on the other side.
        assert!((kicks[0] - mirrored[1]).abs() < 0.1, "{mirrored:?}");
        let punches = of(&left, "punch");
        assert!(punches[2] > 0.5 && punches[0] > punches[1]);
        for p in [kicks, punches] {
            assert!((p.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
        assert_eq!(networks.sides(&left, "walk"), None);
        // The hand is 0.3 m beside the body: a logit of 3 against 1, with either hand.
        for values in [&left, &right] {
            let contents = networks.contents(values);
            assert!((contents[0] - 0.88).abs() < 0.06, "{contents:?}");
            assert!((contents.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_configuration_that_does_not_fit_is_refused() {
        let of = |change: &dyn Fn(&mut EvidenceFile)| {
            let mut file = file(&["kick", "walk"], &[("kick", false)]);
            change(&mut file);
            file.check()
        };
        assert_eq!(of(&|_| {}), Ok(()));
        type Change = dyn Fn(&mut EvidenceFile);
        for (change, named) in [
            (
                &(|f: &mut EvidenceFile| f.mean.truncate(5)) as &Change,
                "mean",
            ),
            (&|f| f.deviation[3] = 0.0, "deviation: value 3"),
            (&|f| f.mean[1] = f32::NAN, "mean: value 1"),
            (&|f| f.contents.clear(), "contents"),
            (&|f| f.sided.clear(), "sided"),
            (&|f| f.hidden[1] = 0, "hidden"),
        ] {
            assert!(of(change).unwrap_err().contains(named), "{named}");
        }
    }

    #[test]
    fn contents_and_the_only_side_of_a_sentence_are_found() {
        let of = |text: &str| content_of(text);
        assert_eq!(
            of("a person kicks with the left leg").as_deref(),
            Some("kick")
        );
        let while_walking = "a person walks forward while waving with the right hand";
        assert_eq!(of(while_walking).as_deref(), Some("walk while wave"));
        let two = "a person waves with the left hand and then kicks with the right leg";
        assert_eq!(of(two).as_deref(), Some("wave then kick"));
        assert_eq!(of("a person ponders"), None);
        assert_eq!(only_side(while_walking), Some(("wave", Side::Right)));
        assert_eq!(only_side("a person walks forward"), None);
        assert_eq!(only_side(two), None);
        let file = file(&["kick", "walk while wave", SEVERAL], &[("kick", false)]);
        let index = |text| file.index_of(text);
        assert_eq!(index("a person kicks"), Some(0));
        assert_eq!(index(while_walking), Some(1));
        assert_eq!(index(two), Some(2));
        assert_eq!(index("a person walks"), None);
    }
}
