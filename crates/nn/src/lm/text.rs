//! Text tokenizers of pretrained language models, on the crate `tokenizers`.

use std::sync::Arc;

use radarllm_inference::checkpoint::Checkpoint;
use radarllm_inference::lm::LmError;
use radarllm_inference::lm::card::LmFiles;
use radarllm_inference::lm::vocab::{EOS, Layout, PAD, PretrainedText, TextKind, Vocab};
use tokenizers::Tokenizer;

/// Reads all files of a language model except the weights, also those of one that began as a pretrained model.
///
/// # Errors
/// As [`LmFiles::of`].
pub fn read_files(checkpoint: Checkpoint) -> Result<LmFiles, LmError> {
    LmFiles::of_any(checkpoint, Some(read_text))
}

/// An error of the crate `tokenizers`.
pub fn text_error(error: tokenizers::Error) -> LmError {
    LmError::Tokenizer(error)
}

/// `tokenizer.json` of any model that the crate `tokenizers` reads.
struct HfText(Tokenizer);

impl PretrainedText for HfText {
    fn encode(&self, text: &str) -> Result<Vec<u32>, LmError> {
        let encoding = self.0.encode_fast(text, false).map_err(text_error)?;
        Ok(encoding.get_ids().to_vec())
    }

    fn decode(&self, ids: &[u32]) -> String {
        self.0.decode(ids, true).unwrap_or_default()
    }

    fn to_json(&self) -> Result<String, LmError> {
        self.0.to_string(true).map_err(text_error)
    }
}

/// Reads `tokenizer.json`.
///
/// # Errors
/// If `tokenizers` cannot read it.
pub fn read_text(json: &[u8]) -> Result<Arc<dyn PretrainedText>, LmError> {
    let text = Tokenizer::from_bytes(json).map_err(text_error)?;
    Ok(Arc::new(HfText(text)))
}

/// The vocabulary of a pretrained T5 with `n_rows` embedding rows, plus radar rows after them.
///
/// # Errors
/// If the tokenizer is not that of T5, which must contain `<pad>` 0, `</s>` 1 and `<extra_id_0>`.
pub fn extend_pretrained(
    tokenizer_json: &[u8],
    n_rows: usize,
    n_codes: usize,
) -> Result<Vocab, LmError> {
    let text = Tokenizer::from_bytes(tokenizer_json).map_err(text_error)?;
    let id = |token: &str| text.token_to_id(token);
    let mut n_sentinels = 0;
    while id(&format!("<extra_id_{n_sentinels}>")).is_some() && n_sentinels < 1000 {
        n_sentinels += 1;
    }
    let first = id("<extra_id_0>");
    let (Some(first_sentinel), Some(PAD), Some(EOS)) = (first, id("<pad>"), id("</s>")) else {
        return Err(LmError::Tokenizer(
            "not a T5 tokenizer: <pad> must be 0, </s> 1, and <extra_id_0> must exist".into(),
        ));
    };
    let layout = Layout {
        kind: TextKind::Pretrained,
        n_text: (first_sentinel + 1).saturating_sub(n_sentinels),
        first_sentinel,
        n_sentinels,
        first_code: n_rows as u32,
        n_codes: n_codes as u32,
        n_context: 0,
        end: EOS,
    };
    Vocab::pretrained(Arc::new(HfText(text)), layout)
}

/// The vocabulary of a pretrained decoder-only model with `n_rows` embedding rows, plus sentinels and radar rows
/// after them. `end` is the checkpoint's end token. Without it, `<|endoftext|>` is used.
///
/// # Errors
/// If special tokens are among the words, or there is no end token.
pub fn extend_decoder(
    tokenizer_json: &[u8],
    n_rows: usize,
    end: Option<u32>,
    n_sentinels: usize,
    n_codes: usize,
) -> Result<Vocab, LmError> {
    let text = Tokenizer::from_bytes(tokenizer_json).map_err(text_error)?;
    let added = text.get_added_tokens_decoder();
    let special = added.iter().filter(|(_, token)| token.special);
    let n_text = special.map(|(id, _)| *id).min();
    let end = end.or_else(|| text.token_to_id("<|endoftext|>"));
    let Some(n_text) = n_text else {
        return Err(LmError::Tokenizer(
            "tokenizer.json marks no token as special, so words cannot be told from others".into(),
        ));
    };
    let Some(end) = end else {
        return Err(LmError::Tokenizer(
            "no end token: neither eos_token_id in config.json nor <|endoftext|>".into(),
        ));
    };
    let n_rows = u32::try_from(n_rows).unwrap_or(u32::MAX);
    if !(n_text..n_rows).contains(&end) {
        let problem =
            format!("the end token {end} must be one of the special tokens, {n_text}..{n_rows}");
        return Err(LmError::Tokenizer(problem.into()));
    }
    let layout = Layout {
        kind: TextKind::Decoder,
        n_text,
        first_sentinel: n_rows,
        n_sentinels: n_sentinels as u32,
        first_code: n_rows.saturating_add(n_sentinels as u32),
        n_codes: n_codes as u32,
        n_context: 0,
        end,
    };
    Vocab::pretrained(Arc::new(HfText(text)), layout)
}

#[cfg(test)]
mod tests {
    use radarllm_inference::lm::word_piece::WordPiece;

    use super::*;

    /// The vocabulary of the bundled model, read here by `tokenizers`.
    fn both() -> (WordPiece, Tokenizer) {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../model-default/weights/lm/tokenizer.json"
        );
        let json = std::fs::read(path).unwrap();
        (
            WordPiece::from_json(&json).unwrap(),
            Tokenizer::from_bytes(&json).unwrap(),
        )
    }

    fn same(ours: &WordPiece, theirs: &Tokenizer, text: &str) {
        let expected = theirs.encode_fast(text, false).unwrap();
        assert_eq!(ours.encode(text), expected.get_ids(), "{text:?}");
    }

    #[test]
    fn our_word_pieces_are_those_of_tokenizers_for_every_character() {
        let (ours, theirs) = both();
        for c in '\0'..=char::MAX {
            same(&ours, &theirs, &format!("walk{c}s"));
        }
    }

    #[test]
    fn our_word_pieces_are_those_of_tokenizers_for_random_texts() {
        let (ours, theirs) = both();
        let parts = [
            "a person", " ", "walks", "-", "ing", "##s", "\u{301}", "Ä", "ß", "İ", "\t", "left,",
            "<unk>", "</s>", "9", "…", "forward", "\u{200d}", "中", "squats'", "ﬁ",
        ];
        let mut state = 1_u64;
        for _ in 0..20_000 {
            let mut text = String::new();
            for _ in 0..12 {
                // A linear congruential generator (Knuth, MMIX).
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                text.push_str(parts[(state >> 33) as usize % parts.len()]);
            }
            same(&ours, &theirs, &text);
        }
        same(&ours, &theirs, &"walk".repeat(30));
    }

    #[test]
    fn our_file_is_that_of_tokenizers() {
        let (ours, theirs) = both();
        assert_eq!(ours.to_json().unwrap(), theirs.to_string(true).unwrap());
    }
}
