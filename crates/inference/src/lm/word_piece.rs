//! The text tokenizer of a vocabulary learned from captions: words and their parts (WordPiece).
//!
//! It reads and writes the `tokenizer.json` of the crate `tokenizers` with one normalizer (BERT's: lower case, no accents,
//! no control characters), one pre-tokenizer (BERT's: words and punctuation marks) and the model WordPiece. For such a
//! file it gives the ids that `tokenizers` gives; `crates/nn/tests/it/word_piece.rs` compares the two. That crate and
//! what it needs are a sixth of the time that a build without training would take.

use std::collections::{BTreeMap, HashMap};

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use unicode_categories::UnicodeCategories;
use unicode_normalization_alignments::UnicodeNormalization;

use super::LmError;

/// Maximum length of a word in characters; a longer one is unknown.
const MAX_WORD_CHARS: usize = 100;
/// Spelling of the unknown token.
const UNKNOWN_TOKEN: &str = "<unk>";
/// Begins a part that continues a word.
const CONTINUES: &str = "##";

/// Words, parts of words and punctuation marks with their ids.
#[derive(Clone, Debug)]
pub struct WordPiece {
    ids: HashMap<String, u32>,
    tokens: Vec<String>,
    unknown: u32,
}

impl WordPiece {
    /// A vocabulary whose ids are the positions in `tokens`.
    ///
    /// # Errors
    /// If a token occurs twice, or `<unk>` is missing.
    pub fn new(tokens: Vec<String>) -> Result<Self, LmError> {
        let ids: HashMap<String, u32> = tokens.iter().cloned().zip(0..).collect();
        if ids.len() != tokens.len() {
            return Err(problem("a token occurs twice in `vocab`"));
        }
        let unknown = *ids
            .get(UNKNOWN_TOKEN)
            .ok_or_else(|| problem("`vocab` lacks the unknown token <unk>"))?;
        Ok(Self {
            ids,
            tokens,
            unknown,
        })
    }

    /// Reads `tokenizer.json`.
    ///
    /// # Errors
    /// If it is not JSON, has other parts than those that this module implements, or its ids have gaps.
    pub fn from_json(json: &[u8]) -> Result<Self, LmError> {
        let file: File = serde_json::from_slice(json).map_err(|e| LmError::Tokenizer(e.into()))?;
        if !file.is_implemented() {
            return Err(problem(
                "expected a BertNormalizer (lower case, without accents), a BertPreTokenizer and a WordPiece model \
                 with the prefix ## and nothing else",
            ));
        }
        let n = file.model.vocab.0.len();
        let mut tokens = vec![String::new(); n];
        for (token, id) in file.model.vocab.0 {
            match tokens.get_mut(id as usize) {
                Some(slot) if slot.is_empty() && !token.is_empty() => *slot = token,
                _ => {
                    return Err(problem(&format!(
                        "`vocab` gives `{token}` the id {id}: ids must be 0..{n}, each once, of tokens that are not empty"
                    )));
                }
            }
        }
        Self::new(tokens)
    }

    /// `tokenizer.json`, which [`Self::from_json`] and the crate `tokenizers` read.
    ///
    /// # Errors
    /// If it cannot be serialized as JSON.
    pub fn to_json(&self) -> Result<String, LmError> {
        let vocab = self.tokens.iter().cloned().zip(0..).collect();
        let file = File {
            model: Model {
                vocab: Tokens(vocab),
                ..Model::default()
            },
            ..File::default()
        };
        serde_json::to_string_pretty(&file).map_err(|e| LmError::Tokenizer(e.into()))
    }

    /// Ids of a text. A word that is not in the vocabulary is split into its longest known parts from the left; if a
    /// part is unknown, so is the word.
    pub fn encode(&self, text: &str) -> Vec<u32> {
        let mut ids = Vec::new();
        for word in words(text) {
            match self.parts(&word) {
                Some(parts) => ids.extend(parts),
                None => ids.push(self.unknown),
            }
        }
        ids
    }

    /// The longest known parts of a word from the left; `None` if one is unknown or the word too long.
    fn parts(&self, word: &str) -> Option<Vec<u32>> {
        if word.chars().count() > MAX_WORD_CHARS {
            return None;
        }
        let (mut ids, mut start) = (Vec::new(), 0);
        while start < word.len() {
            let prefix = if start == 0 { "" } else { CONTINUES };
            let rest = &word[start..];
            let mut ends = rest.char_indices().map(|(at, c)| at + c.len_utf8()).rev();
            let (end, id) = ends.find_map(|end| {
                Some((end, *self.ids.get(&format!("{prefix}{}", &rest[..end]))?))
            })?;
            ids.push(id);
            start += end;
        }
        Some(ids)
    }

    /// Spelling of a token.
    pub fn token(&self, id: u32) -> Option<&str> {
        self.tokens.get(id as usize).map(String::as_str)
    }
}

fn problem(what: &str) -> LmError {
    LmError::Tokenizer(what.into())
}

/// The words and punctuation marks of a text, in lower case, without accents and control characters.
pub fn words(text: &str) -> Vec<String> {
    // Control characters, characters of format and those without a meaning go, but three of them are spaces.
    let clean = text.chars().filter_map(|c| match c {
        '\t' | '\n' | '\r' => Some(' '),
        '\0' | '\u{fffd}' => None,
        c if c.is_other() => None,
        c if c.is_whitespace() => Some(' '),
        c => Some(c),
    });
    let clean: String = clean.collect();
    let plain = clean
        .nfd()
        .map(|(c, _)| c)
        .filter(|c| !c.is_mark_nonspacing())
        .flat_map(char::to_lowercase);
    let mut words = Vec::new();
    let mut word = String::new();
    for c in plain {
        let is_mark = c.is_ascii_punctuation() || c.is_punctuation();
        if (is_mark || c.is_whitespace()) && !word.is_empty() {
            words.push(std::mem::take(&mut word));
        }
        if is_mark {
            words.push(c.to_string());
        } else if !c.is_whitespace() {
            word.push(c);
        }
    }
    if !word.is_empty() {
        words.push(word);
    }
    words
}

/// `tokenizer.json`, in the order in which `tokenizers` writes its fields. What is always the same is a default here.
#[derive(Serialize, Deserialize)]
struct File {
    version: String,
    truncation: (),
    padding: (),
    added_tokens: Vec<()>,
    normalizer: BertNormalizer,
    pre_tokenizer: BertPreTokenizer,
    post_processor: (),
    decoder: (),
    model: Model,
}

impl File {
    /// Whether everything but the tokens is as this module has it.
    fn is_implemented(&self) -> bool {
        let (own, model) = (Self::default(), &self.model);
        self.version == own.version
            && self.added_tokens.is_empty()
            && self.normalizer == own.normalizer
            && self.pre_tokenizer == own.pre_tokenizer
            && model.r#type == own.model.r#type
            && model.unk_token == own.model.unk_token
            && model.continuing_subword_prefix == own.model.continuing_subword_prefix
            && model.max_input_chars_per_word == own.model.max_input_chars_per_word
    }
}

#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct BertNormalizer {
    r#type: String,
    clean_text: bool,
    handle_chinese_chars: bool,
    strip_accents: Option<bool>,
    lowercase: bool,
}

#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct BertPreTokenizer {
    r#type: String,
}

#[derive(Serialize, Deserialize)]
struct Model {
    r#type: String,
    unk_token: String,
    continuing_subword_prefix: String,
    max_input_chars_per_word: usize,
    vocab: Tokens,
}

/// Tokens with their ids, written in the order of the list.
struct Tokens(Vec<(String, u32)>);

impl Serialize for Tokens {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (token, id) in &self.0 {
            map.serialize_entry(token, id)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for Tokens {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = BTreeMap::<String, u32>::deserialize(deserializer)?;
        Ok(Self(map.into_iter().collect()))
    }
}

impl Default for File {
    fn default() -> Self {
        Self {
            version: "1.0".into(),
            truncation: (),
            padding: (),
            added_tokens: Vec::new(),
            normalizer: BertNormalizer {
                r#type: "BertNormalizer".into(),
                clean_text: true,
                handle_chinese_chars: false,
                strip_accents: Some(true),
                lowercase: true,
            },
            pre_tokenizer: BertPreTokenizer {
                r#type: "BertPreTokenizer".into(),
            },
            post_processor: (),
            decoder: (),
            model: Model::default(),
        }
    }
}

impl Default for Model {
    fn default() -> Self {
        Self {
            r#type: "WordPiece".into(),
            unk_token: UNKNOWN_TOKEN.into(),
            continuing_subword_prefix: CONTINUES.into(),
            max_input_chars_per_word: MAX_WORD_CHARS,
            vocab: Tokens(Vec::new()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens(list: &[&str]) -> WordPiece {
        WordPiece::new(list.iter().map(ToString::to_string).collect()).unwrap()
    }

    #[test]
    fn words_are_lower_case_without_accents_and_marks_stand_alone() {
        assert_eq!(
            words("A  Café,\tit's\u{200b} r\u{0308}ight—here\u{7}!"),
            ["a", "cafe", ",", "it", "'", "s", "right", "—", "here", "!"]
        );
        assert!(words(" \n").is_empty());
    }

    #[test]
    fn a_word_is_its_longest_known_parts_from_the_left() {
        let t = tokens(&["<unk>", "walk", "wal", "##k", "##king", "##ing", "s"]);
        assert_eq!(t.encode("walking"), [1, 5]);
        assert_eq!(t.encode("walk walkk"), [1, 1, 3]);
        // One unknown part makes the whole word unknown.
        assert_eq!(t.encode("walks s"), [0, 6]);
        assert_eq!(t.encode(&"s".repeat(101)), [0]);
        assert_eq!(t.token(4), Some("##king"));
        assert_eq!(t.token(7), None);
    }

    #[test]
    fn the_bundled_file_is_written_as_it_was_read() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../model-default/weights/lm/");
        let bytes = std::fs::read(format!("{folder}tokenizer.json")).unwrap();
        let read = WordPiece::from_json(&bytes).unwrap();
        assert_eq!(read.to_json().unwrap().as_bytes(), bytes);
        assert_eq!(read.tokens.len(), 532);
    }

    #[test]
    fn files_that_are_not_read_as_they_are_meant_are_refused() {
        let json = tokens(&["<unk>", "a"]).to_json().unwrap();
        assert!(WordPiece::from_json(json.as_bytes()).is_ok());
        for (find, put) in [
            ("\"lowercase\": true", "\"lowercase\": false"),
            ("\"version\": \"1.0\"", "\"version\": \"2.0\""),
            ("BertPreTokenizer", "Whitespace"),
            ("WordPiece", "BPE"),
            ("\"##\"", "\"@@\""),
            ("\"padding\": null", "\"padding\": {}"),
            ("\"<unk>\": 0", "\"<unk>\": 1"),
            ("\"<unk>\": 0", "\"other\": 0"),
            ("\"a\": 1", "\"a\": 4294967295"),
            ("\"a\": 1", "\"\": 1"),
        ] {
            let changed = json.replacen(find, put, 1);
            assert_ne!(changed, json, "{find}");
            assert!(WordPiece::from_json(changed.as_bytes()).is_err(), "{put}");
        }
    }
}
