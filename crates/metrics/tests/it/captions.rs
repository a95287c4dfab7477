//! goldens/captions.json, made by goldens/captions.py.

use std::collections::BTreeMap;

use serde::Deserialize;

#[derive(Deserialize)]
pub struct Captions {
    pub tokens: Vec<Tokens>,
    pub items: Vec<Item>,
    /// ROUGE-1 and ROUGE-L F1 with stemming, per item.
    pub rouge_stemmed: Vec<[f64; 2]>,
    pub bleu: Bleu,
    /// Lines of the paraphrase table.
    pub paraphrases: Vec<String>,
    /// By matchers.
    pub meteor: BTreeMap<String, MeteorValues>,
    pub meteor_texts: MeteorTexts,
    /// Corpus values by protocol and field.
    pub protocols: BTreeMap<String, BTreeMap<String, f64>>,
    pub meteor_nltk: Vec<f64>,
    pub porter: BTreeMap<String, String>,
}

#[derive(Deserialize)]
pub struct Tokens {
    pub text: String,
    pub ptb: String,
    #[serde(rename = "13a")]
    pub thirteen_a: String,
}

#[derive(Deserialize)]
pub struct Item {
    pub candidate: String,
    pub references: Vec<String>,
}

/// BLEU-1..4.
#[derive(Deserialize)]
pub struct Bleu {
    pub nltk: [f64; 4],
    pub nltk_sentences: Vec<[f64; 4]>,
    pub nltk_sentences_method1: Vec<[f64; 4]>,
    pub nmt: [f64; 4],
    pub nmt_sentences: Vec<[f64; 4]>,
    pub nmt_smoothed: [f64; 4],
    pub sacrebleu: [f64; 4],
    pub coco_sentences: Vec<[f64; 4]>,
}

#[derive(Deserialize)]
pub struct MeteorValues {
    pub corpus: f64,
    pub items: Vec<f64>,
}

#[derive(Deserialize)]
pub struct MeteorTexts {
    pub items: Vec<(String, Vec<String>)>,
    #[serde(rename = "exact stem synonym")]
    pub values: MeteorValues,
}

impl Captions {
    pub fn load() -> Self {
        serde_json::from_str(include_str!("../goldens/captions.json")).unwrap()
    }

    /// (candidate, references).
    pub fn pairs(&self) -> Vec<(String, Vec<String>)> {
        let pair = |i: &Item| (i.candidate.clone(), i.references.clone());
        self.items.iter().map(pair).collect()
    }
}
