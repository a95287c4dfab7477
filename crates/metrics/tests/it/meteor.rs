//! METEOR against the jar and against nltk; see goldens/captions.py for versions and options.

use radarllm_metrics::meteor::{Meteor, MeteorStats, Paraphrases, Resources, nltk::meteor_nltk};
use radarllm_metrics::tokens;

use super::captions::{Captions, MeteorValues};

fn compare(
    name: &str,
    items: &[(String, Vec<String>)],
    golden: &MeteorValues,
    resources: &Resources,
) {
    let mut meteor = Meteor::new(resources);
    let mut corpus = MeteorStats::default();
    let mut largest = 0.0_f64;
    assert_eq!(items.len(), golden.items.len());
    for ((candidate, references), expected) in items.iter().zip(&golden.items) {
        let stats = meteor.stats(candidate, references);
        let difference = (stats.score() - expected).abs();
        assert!(
            difference < 1e-9,
            "{name}: {candidate:?} against {references:?}: {} but {expected}",
            stats.score()
        );
        largest = largest.max(difference);
        corpus.add(&stats);
    }
    let difference = (corpus.score() - golden.corpus).abs();
    assert!(
        difference < 1e-9,
        "{name}: {} but {}",
        corpus.score(),
        golden.corpus
    );
    println!(
        "{name}: {} items, largest difference {:.1e}",
        items.len(),
        largest.max(difference)
    );
}

fn resources(name: &str, goldens: &Captions) -> Resources {
    let resources = Resources::default();
    let resources = if name.contains("synonym") {
        resources
    } else {
        resources.without_synonyms()
    };
    if name.contains("paraphrase") {
        let table = goldens.paraphrases.join("\n");
        resources.with_paraphrases(Paraphrases::read(table.as_bytes()).unwrap())
    } else {
        resources
    }
}

#[test]
fn agrees_with_the_jar_on_captions_and_texts() {
    let goldens = Captions::load();
    let items = goldens.pairs();
    assert!(items.len() > 250);
    for name in [
        "exact stem",
        "exact stem synonym",
        "exact stem synonym paraphrase",
    ] {
        compare(
            name,
            &items,
            &goldens.meteor[name],
            &resources(name, &goldens),
        );
    }
    let texts = &goldens.meteor_texts;
    let name = "exact stem synonym";
    compare(
        "texts",
        &texts.items,
        &texts.values,
        &resources(name, &goldens),
    );
}

#[test]
fn nltk_meteor_agrees() {
    let goldens = Captions::load();
    let mut largest = 0.0_f64;
    for ((candidate, references), expected) in goldens.pairs().iter().zip(&goldens.meteor_nltk) {
        let references: Vec<_> = references.iter().map(|r| tokens::plain(r)).collect();
        let found = meteor_nltk(&tokens::plain(candidate), &references);
        assert!(
            (found - expected).abs() < 1e-9,
            "{candidate:?} {references:?}: {found} but {expected}"
        );
        largest = largest.max((found - expected).abs());
    }
    println!(
        "{} items, largest difference {largest:.1e}",
        goldens.meteor_nltk.len()
    );
}
