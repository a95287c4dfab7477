//! Vocabularies of a language model: `tokenizer.json` and the layout of its ids, then a text in these words.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_fuzz::pieces;
use radarllm_inference::lm::vocab::Vocab;
use radarllm_inference::lm::word_piece::WordPiece;

fuzz_target!(|bytes: &[u8]| {
    let pieces = pieces(bytes);
    let piece = |i: usize| pieces.get(i).map_or(&b""[..], |(_, piece)| piece);
    let text = String::from_utf8_lossy(piece(2));
    if let Ok(words) = WordPiece::from_json(piece(0)) {
        for id in words.encode(&text) {
            assert!(words.token(id).is_some());
        }
        let again = words.to_json().expect("what was read can be written");
        assert!(WordPiece::from_json(again.as_bytes()).is_ok());
    }
    let Ok(layout) = serde_json::from_slice(piece(1)) else {
        return;
    };
    if let Ok(vocab) = Vocab::from_parts(piece(0), layout, None) {
        if let Ok(ids) = vocab.text_ids(&text) {
            let _ = vocab.text(&ids);
        }
        let _ = vocab.radar_ids(&[0, 1, u32::MAX]);
        let _ = vocab.text(&[0, 1, 2, 1_000, u32::MAX]);
    }
});
