//! One vocabulary for words, masks and radar codes.
//!
//! A vocabulary learned from captions has padding 0, end 1 and unknown 2, followed by characters and words. After the
//! text ids come the sentinels, the radar codes `<radar_0..K-1>`, `/som` and `/eom`, and the context tokens if the model is
//! told the context. With a pretrained T5, text and
//! sentinels keep their ids, and the radar rows follow the last row of its embedding. With a pretrained decoder-only
//! model (GPT-2, Qwen2), the sentinels follow the last row too.
//!
//! Text never produces the id of a sentinel or a radar code, because these rows have no spelling.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use radarllm_engine::Source;
use serde::{Deserialize, Serialize};

use super::templates::{Piece, pieces};
use super::word_piece::{WordPiece, words};
use super::{InputError, LmError};
use crate::tokenizer::{Encoded, context::N_CONTEXT};

/// Padding, and the decoder's start token.
pub const PAD: u32 = 0;
/// End of a target.
pub const EOS: u32 = 1;
/// A character that is not in the vocabulary.
pub const UNKNOWN: u32 = 2;

/// Maximum length of a text, in bytes: far above any caption.
const MAX_TEXT_BYTES: usize = 16 << 10;

/// Origin of the text ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TextKind {
    /// Learned from captions by [`Vocab::learn`].
    Learned,
    /// The tokenizer of a pretrained T5.
    Pretrained,
    /// The tokenizer of a pretrained decoder-only model, whose special tokens follow its words.
    Decoder,
}

/// Layout of the token ids.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Origin of the text ids.
    pub kind: TextKind,
    /// Ids below this value are text.
    pub n_text: u32,
    /// Id of the first sentinel.
    pub first_sentinel: u32,
    /// Number of sentinels. Those of a pretrained T5 count down from the first.
    pub n_sentinels: u32,
    /// Id of radar code 0.
    pub first_code: u32,
    /// Number of radar codes.
    pub n_codes: u32,
    /// Number of context tokens ([`crate::tokenizer::context`]): 0 for a model that is not told the context.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub n_context: u32,
    /// Token that ends a target and a prompt.
    #[serde(default = "t5_end")]
    pub end: u32,
}

fn is_zero(n: &u32) -> bool {
    *n == 0
}

fn t5_end() -> u32 {
    EOS
}

impl Layout {
    /// Marks the start of radar codes in a prompt.
    pub fn som(&self) -> u32 {
        self.first_code + self.n_codes
    }

    /// Marks the end of radar codes in a prompt.
    pub fn eom(&self) -> u32 {
        self.som() + 1
    }

    /// Id of a context token.
    pub fn context(&self, token: u32) -> u32 {
        self.eom() + 1 + token
    }

    /// Number of rows of the embedding.
    pub fn size(&self) -> usize {
        self.context(self.n_context) as usize
    }

    /// Id of a sentinel, counted from 0.
    pub fn sentinel(&self, index: u32) -> u32 {
        match self.kind {
            TextKind::Learned | TextKind::Decoder => self.first_sentinel + index,
            TextKind::Pretrained => self.first_sentinel - index,
        }
    }

    /// Id of a radar code.
    pub fn code(&self, code: u32) -> u32 {
        self.first_code + code
    }

    /// The radar code of an id, if it is one.
    pub fn code_of(&self, id: u32) -> Option<u32> {
        id.checked_sub(self.first_code)
            .filter(|code| *code < self.n_codes)
    }

    /// Returns whether an id is a word or a part of one.
    pub fn is_word(&self, id: u32) -> bool {
        id < self.n_text && (self.kind == TextKind::Decoder || id > UNKNOWN)
    }

    fn validate(&self) -> Result<(), LmError> {
        let problem = |field, problem: &str| {
            Err(LmError::Config {
                field,
                problem: problem.into(),
            })
        };
        let sentinels_fit = match self.kind {
            TextKind::Learned => {
                self.first_sentinel == self.n_text
                    && u64::from(self.n_text) + u64::from(self.n_sentinels)
                        == u64::from(self.first_code)
            }
            TextKind::Pretrained => {
                u64::from(self.first_sentinel) + 1
                    == u64::from(self.n_text) + u64::from(self.n_sentinels)
                    && self.first_sentinel < self.first_code
            }
            TextKind::Decoder => {
                self.n_text <= self.first_sentinel
                    && u64::from(self.first_sentinel) + u64::from(self.n_sentinels)
                        == u64::from(self.first_code)
            }
        };
        let end_fits = match self.kind {
            TextKind::Learned | TextKind::Pretrained => self.end == EOS,
            TextKind::Decoder => (self.n_text..self.first_sentinel).contains(&self.end),
        };
        if !end_fits {
            return problem("end", "must be 1, or follow a decoder's words");
        }
        if self.n_text <= UNKNOWN || self.n_text > 1 << 20 {
            return problem("n_text", "out of range");
        }
        if self.n_sentinels == 0 || !sentinels_fit {
            return problem("first_sentinel", "sentinels must follow the text ids");
        }
        if self.n_codes == 0 || self.n_codes > 1 << 20 || self.first_code > 1 << 21 {
            return problem("n_codes", "out of range");
        }
        if self.n_context > N_CONTEXT as u32 {
            return problem("n_context", "is larger than that of this version");
        }
        Ok(())
    }
}

/// The text tokenizer of a pretrained language model. `radarllm-nn` implements it on the crate `tokenizers`, which only
/// builds with training link.
pub trait PretrainedText: Send + Sync {
    /// Ids of a text, without special tokens.
    ///
    /// # Errors
    /// If the tokenizer refuses the text.
    fn encode(&self, text: &str) -> Result<Vec<u32>, LmError>;

    /// The text of ids.
    fn decode(&self, ids: &[u32]) -> String;

    /// `tokenizer.json`.
    ///
    /// # Errors
    /// If it cannot be serialized as JSON.
    fn to_json(&self) -> Result<String, LmError>;
}

/// Reads `tokenizer.json` of a pretrained language model.
pub type ReadPretrainedText = fn(&[u8]) -> Result<Arc<dyn PretrainedText>, LmError>;

/// Text, sentinels, codes and markers.
#[derive(Clone)]
pub struct Vocab {
    text: Text,
    layout: Layout,
}

#[derive(Clone)]
enum Text {
    Learned(Arc<WordPiece>),
    Pretrained(Arc<dyn PretrainedText>),
}

impl Vocab {
    /// Learns a word vocabulary.
    ///
    /// The vocabulary contains `always` words and every character first, then the words of `captions` in descending
    /// order of frequency (ties by spelling) until `max_text` ids are used. Other words are split into their longest
    /// known parts, down to characters.
    ///
    /// # Errors
    /// If `max_text` cannot hold the `always` words and characters.
    pub fn learn<'a, 'b>(
        captions: impl Iterator<Item = &'a str>,
        always: impl Iterator<Item = &'b str>,
        max_text: usize,
        n_sentinels: usize,
        n_codes: usize,
    ) -> Result<Self, LmError> {
        let mut counts = BTreeMap::<String, usize>::new();
        let mut fixed = BTreeSet::new();
        for caption in captions {
            for word in words(caption) {
                *counts.entry(word).or_default() += 1;
            }
        }
        for text in always {
            for piece in pieces(text) {
                if let Piece::Words(text) = piece {
                    fixed.extend(words(text));
                }
            }
        }
        let plain = (b'a'..=b'z').chain(b'0'..=b'9').map(char::from);
        let mut characters: BTreeSet<char> = plain.chain(".,:;?!'-/()\"&%+".chars()).collect();
        characters.extend(counts.keys().flat_map(|w| w.chars()));
        let mut list: Vec<String> = ["<pad>", "</s>", "<unk>"].map(String::from).to_vec();
        let mut seen: BTreeSet<String> = list.iter().cloned().collect();
        let mut push = |word: String| {
            if seen.insert(word.clone()) {
                list.push(word);
            }
            list.len()
        };
        let mut len = 0;
        for c in &characters {
            len = push(c.to_string());
            if c.is_alphanumeric() {
                len = push(format!("##{c}"));
            }
        }
        for word in fixed {
            len = push(word);
        }
        if len > max_text {
            let problem = format!("characters and prompts alone need {len} ids, found {max_text}");
            return Err(LmError::Config {
                field: "max_text_vocab",
                problem,
            });
        }
        let mut by_count: Vec<(String, usize)> = counts.into_iter().collect();
        by_count.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        for (word, _) in by_count {
            if len >= max_text {
                break;
            }
            len = push(word);
        }
        let n_text = list.len() as u32;
        let text = Text::Learned(Arc::new(WordPiece::new(list)?));
        let layout = Layout {
            kind: TextKind::Learned,
            n_text,
            first_sentinel: n_text,
            n_sentinels: n_sentinels as u32,
            first_code: n_text + n_sentinels as u32,
            n_codes: n_codes as u32,
            n_context: 0,
            end: EOS,
        };
        Self::new(text, layout)
    }

    /// The vocabulary of a pretrained language model, whose layout begins with the ids of its text.
    ///
    /// # Errors
    /// If the layout is invalid.
    pub fn pretrained(text: Arc<dyn PretrainedText>, layout: Layout) -> Result<Self, LmError> {
        Self::new(Text::Pretrained(text), layout)
    }

    /// Reads a vocabulary from its two files. That of a pretrained language model needs `read`.
    ///
    /// # Errors
    /// If the tokenizer cannot be parsed or the layout is invalid; [`LmError::PretrainedText`] without `read`.
    pub fn from_parts(
        tokenizer_json: &[u8],
        layout: Layout,
        read: Option<ReadPretrainedText>,
    ) -> Result<Self, LmError> {
        let text = match (layout.kind, read) {
            (TextKind::Learned, _) => {
                Text::Learned(Arc::new(WordPiece::from_json(tokenizer_json)?))
            }
            (_, Some(read)) => Text::Pretrained(read(tokenizer_json)?),
            (_, None) => return Err(LmError::PretrainedText),
        };
        Self::new(text, layout)
    }

    fn new(text: Text, layout: Layout) -> Result<Self, LmError> {
        layout.validate()?;
        Ok(Self { text, layout })
    }

    /// The vocabulary with context tokens after all others.
    #[must_use]
    pub fn with_context(mut self) -> Self {
        self.layout.n_context = N_CONTEXT as u32;
        self
    }

    /// The vocabulary without context tokens.
    #[must_use]
    pub fn without_context(mut self) -> Self {
        self.layout.n_context = 0;
        self
    }

    /// Layout of the token ids.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// `tokenizer.json`.
    ///
    /// # Errors
    /// If it cannot be serialized as JSON.
    pub fn tokenizer_json(&self) -> Result<String, LmError> {
        match &self.text {
            Text::Learned(text) => text.to_json(),
            Text::Pretrained(text) => text.to_json(),
        }
    }

    /// Encodes a text as ids, without an end token. Ids beyond the text rows become [`UNKNOWN`], or are dropped if a
    /// decoder's vocabulary has no such id, so that no text can inject a sentinel or a radar code.
    ///
    /// # Errors
    /// If the text is longer than any caption could be, or the tokenizer refuses it.
    pub fn text_ids(&self, text: &str) -> Result<Vec<u32>, LmError> {
        if text.len() > MAX_TEXT_BYTES {
            let (found, max) = (text.len(), MAX_TEXT_BYTES);
            return Err(InputError::TextTooLong { found, max }.into());
        }
        let ids = match &self.text {
            Text::Learned(words) => words.encode(text),
            Text::Pretrained(pieces) => pieces.encode(text)?,
        };
        let n_text = self.layout.n_text;
        let unknown = (self.layout.kind != TextKind::Decoder).then_some(UNKNOWN);
        Ok(ids
            .into_iter()
            .filter_map(|id| if id < n_text { Some(id) } else { unknown })
            .collect())
    }

    /// Decodes ids to text; other ids and markers are omitted.
    pub fn text(&self, ids: &[u32]) -> String {
        let kept: Vec<u32> = ids
            .iter()
            .copied()
            .filter(|id| self.layout.is_word(*id))
            .collect();
        match &self.text {
            Text::Pretrained(text) => text.decode(&kept),
            Text::Learned(text) => join_words(kept.iter().filter_map(|id| text.token(*id))),
        }
    }

    /// Creates a prompt with its placeholders filled. It ends with the end token.
    ///
    /// Codes stand between `/som` and `/eom` and carry their continuous features.
    ///
    /// # Errors
    /// If a placeholder has no value, a code is beyond the codebook, or features do not fit codes.
    pub fn prompt(
        &self,
        template: &str,
        radar: Option<&Encoded>,
        caption: Option<&str>,
    ) -> Result<Source, LmError> {
        let mut source = Source::default();
        for piece in pieces(template) {
            match (piece, radar, caption) {
                (Piece::Words(words), ..) => source.ids.extend(self.text_ids(words)?),
                (Piece::Placeholder("{radar}"), Some(radar), _) => {
                    self.push_radar(&mut source, radar)?;
                }
                (Piece::Placeholder("{caption}"), _, Some(caption)) => {
                    source.ids.extend(self.text_ids(caption)?);
                }
                (Piece::Placeholder(name), ..) => {
                    return Err(InputError::Placeholder { name: name.into() }.into());
                }
            }
        }
        source.ids.push(self.layout.end);
        Ok(source)
    }

    /// Appends codes between markers, with their features, and the context.
    ///
    /// # Errors
    /// If a code is beyond the codebook, features do not fit codes, or the context is missing.
    pub fn push_radar(&self, source: &mut Source, radar: &Encoded) -> Result<(), LmError> {
        source.ids.push(self.layout.som());
        for code in self.radar_ids(&radar.codes)? {
            source.feature_positions.push(source.ids.len() as u32);
            source.ids.push(code);
        }
        source.features.extend_from_slice(&radar.features);
        source.ids.push(self.layout.eom());
        source.ids.extend(self.context_ids(radar)?);
        Ok(())
    }

    /// Whether prompts with radar codes contain the context of the clip.
    pub fn has_context(&self) -> bool {
        self.layout.n_context > 0
    }

    /// Ids of a clip's context; none if the model is not told the context, and the first ones if it is of an earlier
    /// version, which stated less.
    ///
    /// # Errors
    /// If the model is told the context and it was not measured.
    pub fn context_ids(&self, radar: &Encoded) -> Result<Vec<u32>, LmError> {
        if !self.has_context() {
            return Ok(Vec::new());
        }
        let context = radar.context.ok_or(InputError::NoContext)?;
        let known = |token: &u32| *token < self.layout.n_context;
        Ok(context
            .into_iter()
            .filter(known)
            .map(|token| self.layout.context(token))
            .collect())
    }

    /// Ids of radar codes.
    ///
    /// # Errors
    /// If a code is beyond the codebook.
    pub fn radar_ids(&self, codes: &[u32]) -> Result<Vec<u32>, LmError> {
        let n_codes = self.layout.n_codes;
        match codes.iter().find(|code| **code >= n_codes) {
            Some(&code) => Err(InputError::Code { code, n_codes }.into()),
            None => Ok(codes.iter().map(|code| self.layout.code(*code)).collect()),
        }
    }
}

/// Joins word pieces. `##` continues a word, and punctuation is attached as in English text.
fn join_words<'a>(tokens: impl Iterator<Item = &'a str>) -> String {
    let mut out = String::new();
    let mut glue = true;
    for token in tokens {
        if let Some(rest) = token.strip_prefix("##") {
            out.push_str(rest);
            glue = false;
            continue;
        }
        let attaches = matches!(token, "." | "," | ";" | ":" | "!" | "?" | ")" | "%");
        let links = matches!(token, "-" | "'" | "/");
        if !(glue || attaches || links) {
            out.push(' ');
        }
        out.push_str(token);
        glue = links || token == "(";
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lm::templates;

    const CAPTIONS: [&str; 3] = [
        "A person walks forward, then turns left.",
        "the man's right-handed throw",
        "A person jumps twice",
    ];

    fn vocab() -> Vocab {
        Vocab::learn(CAPTIONS.into_iter(), templates::all_text(), 500, 4, 8).unwrap()
    }

    #[test]
    fn captions_come_back_in_lower_case() {
        let vocab = vocab();
        for caption in CAPTIONS {
            let ids = vocab.text_ids(caption).unwrap();
            assert!(!ids.contains(&UNKNOWN), "{caption}");
            assert_eq!(vocab.text(&ids), caption.to_lowercase());
        }
    }

    #[test]
    fn unknown_words_are_spelled_and_come_back() {
        let vocab = vocab();
        let ids = vocab.text_ids("somersaults 12.8 seconds").unwrap();
        assert!(!ids.contains(&UNKNOWN));
        assert_eq!(
            vocab.text(&ids).replace(". ", "."),
            "somersaults 12.8 seconds"
        );
    }

    #[test]
    fn ids_are_laid_out_text_sentinels_codes_markers() {
        let vocab = vocab();
        let l = vocab.layout();
        assert_eq!(l.sentinel(0), l.n_text);
        assert_eq!(l.code(0), l.n_text + 4);
        assert_eq!(l.som(), l.code(7) + 1);
        assert_eq!(l.size(), l.eom() as usize + 1);
        assert_eq!(l.code_of(l.code(3)), Some(3));
        assert_eq!(l.code_of(l.som()), None);
        assert_eq!(l.code_of(0), None);
    }

    #[test]
    fn text_cannot_smuggle_in_codes() {
        let vocab = vocab();
        for text in ["<radar_3>", "/som", "<extra_id_0>", "</s>", "<pad>"] {
            let ids = vocab.text_ids(text).unwrap();
            let text_only = |id: &u32| *id >= UNKNOWN && *id < vocab.layout().n_text;
            assert!(ids.iter().all(text_only), "{text}");
        }
    }

    #[test]
    fn files_bring_back_the_same_vocabulary() {
        let vocab = vocab();
        let json = vocab.tokenizer_json().unwrap();
        let back = Vocab::from_parts(json.as_bytes(), vocab.layout().clone(), None).unwrap();
        for caption in CAPTIONS {
            assert_eq!(
                vocab.text_ids(caption).unwrap(),
                back.text_ids(caption).unwrap()
            );
        }
        assert!(Vocab::from_parts(b"{}", vocab.layout().clone(), None).is_err());
        let bad = Layout {
            first_code: 0,
            ..vocab.layout().clone()
        };
        assert!(Vocab::from_parts(json.as_bytes(), bad, None).is_err());
        // The tokenizer of a pretrained model is not read without what reads it.
        let pretrained = Layout {
            kind: TextKind::Pretrained,
            ..vocab.layout().clone()
        };
        let refused = Vocab::from_parts(json.as_bytes(), pretrained, None);
        assert!(matches!(refused, Err(LmError::PretrainedText)));
    }

    #[test]
    fn a_context_follows_the_codes_of_a_model_that_is_told_it() {
        let (without, with) = (vocab(), vocab().with_context());
        let radar = Encoded {
            codes: vec![5],
            features: vec![1.0],
            context: Some(std::array::from_fn(|i| [1, 17, 34, 51, 68, 80, 89][i % 7])),
            ..Encoded::default()
        };
        let template = "what does {radar} show?";
        let plain = without.prompt(template, Some(&radar), None).unwrap();
        let with_context = with.prompt(template, Some(&radar), None).unwrap();
        let (l, n) = (with.layout(), plain.ids.len());
        assert_eq!(l.size(), without.layout().size() + N_CONTEXT);
        let eom = with_context
            .ids
            .iter()
            .position(|id| *id == l.eom())
            .unwrap();
        let context = radar.context.unwrap().map(|token| l.context(token));
        assert_eq!(with_context.ids[eom + 1..][..context.len()], context);
        assert_eq!(with_context.ids.len(), n + context.len());
        assert_eq!(with_context.feature_positions, plain.feature_positions);
        let not_measured = Encoded {
            context: None,
            ..radar.clone()
        };
        assert!(with.prompt(template, Some(&not_measured), None).is_err());
        // The files of a model without context do not mention it; a model with a larger context is refused.
        let json = serde_json::to_value(without.layout()).unwrap();
        assert!(json.get("n_context").is_none());
        assert_eq!(
            serde_json::from_value::<Layout>(json).unwrap(),
            *without.layout()
        );
        let of_size = |n_context: u32| {
            let text = with.tokenizer_json().unwrap();
            let layout = Layout {
                n_context,
                ..l.clone()
            };
            Vocab::from_parts(text.as_bytes(), layout, None)
        };
        assert!(of_size(l.n_context + 1).is_err());
        // One that knows fewer tokens is told those.
        let earlier = of_size(70).unwrap().context_ids(&radar).unwrap();
        assert!(
            earlier
                .iter()
                .all(|id| (*id as usize) < l.context(70) as usize)
        );
        let known = radar.context.unwrap().iter().filter(|t| **t < 70).count();
        assert!(earlier.len() == known && known < context.len());
    }

    #[test]
    fn prompts_carry_features_at_their_codes() {
        let vocab = vocab();
        let radar = Encoded {
            codes: vec![5, 0],
            features: vec![1.0, 2.0, 3.0, 4.0],
            ..Encoded::default()
        };
        let source = vocab
            .prompt("what does {radar} show?", Some(&radar), None)
            .unwrap();
        let l = vocab.layout();
        assert_eq!(source.ids[2..6], [l.som(), l.code(5), l.code(0), l.eom()]);
        assert_eq!(source.feature_positions, [3, 4]);
        assert_eq!(source.features, radar.features);
        assert_eq!(source.ids.last(), Some(&EOS));
        let bad = Encoded {
            codes: vec![8],
            features: vec![0.0, 0.0],
            ..Encoded::default()
        };
        assert!(vocab.prompt("describe {radar}", Some(&bad), None).is_err());
        assert!(vocab.prompt("describe {radar}", None, None).is_err());
    }
}
