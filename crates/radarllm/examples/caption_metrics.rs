//! Scores generated captions against references: BLEU, ROUGE, METEOR, CIDEr, with bootstrap intervals.
//!
//! `cargo run --release -p radarllm --example caption_metrics`

#![allow(clippy::print_stdout, reason = "an example")]

use radarllm::metrics::{Candidate, Reference, ScoreOptions, score};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pairs = [
        (
            "a person walks forward slowly",
            ["a person walks forward", "somebody slowly walks ahead"],
        ),
        (
            "a person waves with the left hand",
            ["a person waves with the right hand", "someone is waving"],
        ),
    ];
    let (mut candidates, mut references) = (Vec::new(), Vec::new());
    for (i, (text, texts)) in pairs.into_iter().enumerate() {
        let id = format!("clip-{i}");
        candidates.push(Candidate {
            id: id.clone(),
            text: text.into(),
        });
        references.push(Reference {
            id,
            texts: texts.map(String::from).into(),
        });
    }
    let scores = score(&candidates, &references, &ScoreOptions::default())?;
    println!("BLEU-1 {:.3}, BLEU-4 {:.3}", scores.bleu_1, scores.bleu_4);
    println!(
        "ROUGE-L {:.3}, CIDEr-D {:.3}",
        scores.rouge_l, scores.cider_d
    );
    Ok(())
}
