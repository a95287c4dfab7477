//! Figures about the human sentences of HumanML3D and KIT-ML.
//!
//! `cargo run --release -p radarllm-facts --example human_sentences -- COMMAND`, with one of these commands:
//!
//! - `draw`: ids of the 300 annotated sentences, with `text` the sentences too,
//! - `unknown`: words that the lexicon does not know, most frequent first,
//! - `mix`: the table `data/mix.tsv`,
//! - `variety`: written sentences beside human ones,
//! - `write`: twenty written sentences,
//! - `attach`: human sentences that describe built-in motions.

#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    unreachable_pub,
    reason = "an example"
)]

#[path = "../tests/corpora/mod.rs"]
mod corpora;

use std::collections::{BTreeMap, HashMap};

use corpora::Sentence;
use radarllm_base::seed::derive_seed;
use radarllm_facts::{
    Facts,
    attach::{Disagreement, agrees},
    facts, lexicon,
    words::words,
    write::{Mix, Writer},
};
use radarllm_metrics::variety::variety;
use radarllm_motions::random_request;

/// Built-in motions to which sentences are attached.
const N_MOTIONS: u64 = 2000;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let command = arguments.next().unwrap_or_default();
    let Some(all) = corpora::sentences() else {
        println!(
            "skipped: no human sentences in {}",
            corpora::folder().display()
        );
        return;
    };
    match command.as_str() {
        "draw" => {
            let with_text = arguments.next().as_deref() == Some("text");
            for sentence in corpora::shuffled(all, corpora::SEED).iter().take(300) {
                match with_text {
                    true => println!("{}\t{}", sentence.id, sentence.text),
                    false => println!("{}", sentence.id),
                }
            }
        }
        "unknown" => unknown(&all),
        "mix" => mix(&all),
        "variety" => print_variety(all),
        "write" => write(all),
        "attach" => attach(&all),
        _ => println!("commands: draw, unknown, mix, variety, write, attach"),
    }
}

fn unknown(all: &[Sentence]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for sentence in all {
        for word in words(&sentence.text.to_lowercase()) {
            *counts.entry(word.text).or_default() += 1;
        }
    }
    let n_all: usize = counts.values().sum();
    let n_words = counts.len();
    let mut unknown: Vec<(String, usize)> = counts
        .into_iter()
        .filter(|(word, _)| !lexicon::knows(word))
        .collect();
    unknown.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let n_unknown: usize = unknown.iter().map(|(_, n)| n).sum();
    println!(
        "{} sentences, {n_all} words, {n_words} different",
        all.len()
    );
    println!(
        "unknown: {n_unknown} words ({:.1} %), {} different",
        100.0 * n_unknown as f64 / n_all as f64,
        unknown.len()
    );
    for (word, n) in unknown.iter().take(100) {
        println!("{n}\t{word}");
    }
}

fn mix(all: &[Sentence]) {
    let mut mix = Mix::default();
    for sentence in all {
        mix.add(&sentence.text, &facts(&sentence.text));
    }
    println!(
        "# How often people mention what, counted by the parser of this crate over {} human sentences",
        all.len()
    );
    println!(
        "# of HumanML3D (Guo et al., CVPR 2022) and the KIT Motion-Language Dataset (Plappert et al., Big Data 2016,"
    );
    println!("# without mirrored copies). Numbers only. Made by:");
    println!(
        "# cargo run --release -p radarllm-facts --example human_sentences -- mix > crates/facts/data/mix.tsv"
    );
    print!("{}", mix.table());
}

fn print_variety(all: Vec<Sentence>) {
    let writer = Writer::new();
    // Other sentences than the annotated ones, each of which states something.
    let drawn: Vec<(String, Facts)> = corpora::shuffled(all, corpora::SEED)
        .into_iter()
        .skip(300)
        .map(|s| (facts(&s.text), s.text))
        .filter(|(facts, _)| !facts.stretches.is_empty())
        .map(|(facts, text)| (text, facts))
        .collect();
    let human: Vec<String> = drawn
        .iter()
        .take(1000)
        .map(|d| d.0.to_lowercase())
        .collect();
    let rewritten: Vec<String> = drawn
        .iter()
        .enumerate()
        .filter_map(|(n, d)| writer.write(&d.1, n as u64))
        .map(|w| w.text)
        .take(1000)
        .collect();
    let (mut of_motions, mut templates) = (Vec::new(), Vec::new());
    for index in 0..4000 {
        let request = random_request(derive_seed(index, "variety"));
        let mut motion = request.facts();
        motion.subject = Some(radarllm_facts::Subject::Person);
        if let Some(written) = writer.write(&motion, index) {
            of_motions.push(written.text);
            templates.extend(request.captions(index).into_iter().next());
        }
    }
    of_motions.truncate(1000);
    templates.truncate(1000);
    println!(
        "sentences                 n  words  length  Self-BLEU  distinct-1  distinct-2  distinct-3  distinct-4"
    );
    for (name, sentences) in [
        ("human", &human),
        ("written, facts of human", &rewritten),
        ("written, built-in motions", &of_motions),
        ("templates, same motions", &templates),
    ] {
        let found = variety(sentences);
        let n_words: usize = sentences.iter().map(|s| s.split_whitespace().count()).sum();
        println!(
            "{name:25} {} {:5} {:6.1} {:9.3} {}",
            sentences.len(),
            found.words,
            n_words as f64 / sentences.len() as f64,
            found.self_bleu.unwrap_or(f64::NAN),
            found.distinct.map(|d| format!("{d:11.3}")).join(" ")
        );
    }
    let (mut words, mut n_written) = (std::collections::BTreeSet::new(), 0);
    for (n, (_, facts)) in drawn.iter().enumerate() {
        if let Some(written) = writer.write(facts, n as u64) {
            n_written += 1;
            words.extend(written.text.split([' ', ',', '.', ';']).map(String::from));
        }
    }
    println!(
        "{n_written} of {} sets of facts written, {} different words",
        drawn.len(),
        words.len()
    );
}

fn write(all: Vec<Sentence>) {
    let writer = Writer::new();
    for (n, sentence) in corpora::shuffled(all, corpora::SEED)
        .iter()
        .skip(300)
        .take(20)
        .enumerate()
    {
        let stated = facts(&sentence.text);
        println!("{stated}");
        match writer.write(&stated, n as u64) {
            Some(written) => println!("    {}", written.text),
            None => println!("    (no wording)"),
        }
    }
}

fn attach(all: &[Sentence]) {
    let stated: Vec<Facts> = all.iter().map(|s| facts(&s.text)).collect();
    // Equal facts agree with the same motions.
    let mut by_facts: HashMap<String, (Facts, usize)> = HashMap::new();
    for facts in &stated {
        let mut facts = facts.clone();
        facts.subject = None;
        by_facts.entry(facts.to_string()).or_insert((facts, 0)).1 += 1;
    }
    let mut attached: HashMap<&str, bool> = by_facts.keys().map(|k| (k.as_str(), false)).collect();
    // Per action: motions, motions with a sentence, sentences of all motions.
    let mut rows: BTreeMap<String, (usize, usize, usize)> = BTreeMap::new();
    let mut reasons: BTreeMap<Disagreement, usize> = BTreeMap::new();
    for index in 0..N_MOTIONS {
        let request = random_request(derive_seed(index, "attach"));
        let motion = request.facts();
        let mut n_sentences = 0;
        for (key, (facts, n)) in &by_facts {
            match agrees(facts, &motion) {
                Ok(()) => {
                    n_sentences += n;
                    attached.insert(key, true);
                }
                Err(reason) => *reasons.entry(reason).or_default() += n,
            }
        }
        let action = request.action();
        let name = match action.contains(' ') {
            true => "(several actions)".to_string(),
            false => action,
        };
        let row = rows.entry(name).or_default();
        row.0 += 1;
        row.1 += usize::from(n_sentences > 0);
        row.2 += n_sentences;
    }
    println!("action              motions  with a sentence  sentences per motion");
    for (action, (n, with, sentences)) in &rows {
        println!(
            "{action:20} {n:6} {with:16} {:21.1}",
            *sentences as f64 / *n as f64
        );
    }
    let (n, with): (usize, usize) = rows.values().fold((0, 0), |a, r| (a.0 + r.0, a.1 + r.1));
    println!("{with} of {n} motions have a human sentence");
    let n_attached: usize = by_facts
        .iter()
        .filter(|(k, _)| attached[k.as_str()])
        .map(|(_, v)| v.1)
        .sum();
    let n_stating = stated.iter().filter(|f| !f.stretches.is_empty()).count();
    println!(
        "{n_attached} of {} human sentences describe at least one of them ({n_stating} state an action)",
        all.len()
    );
    let pairs: usize = reasons.values().sum();
    for (reason, n) in reasons {
        println!(
            "{:.2} % of the other pairs: {reason:?}",
            100.0 * n as f64 / pairs as f64
        );
    }
}
