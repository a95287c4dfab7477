//! BLEU-1..4 from additive statistics, by the rules of several packages. The packages agree on
//! the n-gram matches and differ in everything else.

use crate::grams::{Grams, Vocabulary, intersect};

/// Values of BLEU-1, BLEU-2, BLEU-3, BLEU-4.
pub type Bleu = [f64; 4];

/// How a value is computed from the matches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rules {
    /// COCO caption evaluation and nlg-eval (pycocoevalcap's `bleu_scorer`, option `closest`).
    Coco,
    /// TensorFlow's NMT script, which HF evaluate and nlg-metricverse use: the brevity penalty refers to the shortest
    /// reference, and an order without matches has precision 0.
    Nmt,
    /// As [`Rules::Nmt`], with Lin and Och's smoothing, +1 for n > 1.
    NmtSmoothed,
    /// nltk without smoothing: an order without matches has the smallest positive number as its precision.
    Nltk,
    /// nltk with smoothing `method1`: an order without matches counts as 0.1 matches.
    NltkMethod1,
    /// sacrebleu with its `exp` smoothing, scaled to 0..1. It agrees with sacrebleu for 13a tokens.
    Sacrebleu,
}

/// Additive statistics of one item, or of a sum of items.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct BleuStats {
    /// Clipped n-gram matches, n = 1..4.
    pub correct: [f64; 4],
    /// N-grams of the candidate.
    pub guess: [f64; 4],
    /// Words of the candidate.
    pub candidate_len: f64,
    /// Words of the reference closest in length, the shorter one on a tie.
    pub reference_len: f64,
    /// Words of the shortest reference.
    pub shortest_len: f64,
    /// As `guess`, but at least one per item and n, which is how nltk counts.
    pub guess_or_one: [f64; 4],
}

/// Statistics of tokenised sentences: one candidate and its references (at least one).
pub fn stats<S: AsRef<str>>(candidate: &[S], references: &[Vec<S>]) -> BleuStats {
    let mut vocabulary = Vocabulary::default();
    let mut grams = |words: &[S]| Grams::of(&vocabulary.numbers(words.iter().map(AsRef::as_ref)));
    let candidate = grams(candidate);
    let references: Vec<Grams> = references.iter().map(|r| grams(r)).collect();
    BleuStats::of(&candidate, &references)
}

impl BleuStats {
    /// Statistics of one candidate against its references (at least one).
    pub(crate) fn of(candidate: &Grams, references: &[Grams]) -> Self {
        let mut stats = Self {
            candidate_len: candidate.len as f64,
            ..Self::default()
        };
        let closest = references
            .iter()
            .map(|r| (r.len.abs_diff(candidate.len), r.len))
            .min();
        stats.reference_len = closest.map_or(0.0, |(_, len)| len as f64);
        let shortest = references.iter().map(|r| r.len).min();
        stats.shortest_len = shortest.unwrap_or(0) as f64;
        for i in 0..4 {
            stats.guess[i] = f64::from(candidate.total(i));
            stats.guess_or_one[i] = stats.guess[i].max(1.0);
            let mut max: Vec<u32> = vec![0; candidate.counts[i].len()];
            for reference in references {
                // The value of an n-gram is its position in the candidate's list.
                let indexed: Vec<_> = candidate.counts[i]
                    .iter()
                    .enumerate()
                    .map(|(k, &(gram, _))| (gram, k))
                    .collect();
                intersect(&indexed, &reference.counts[i], |_, k, count| {
                    max[k] = max[k].max(count)
                });
            }
            let matches = candidate.counts[i]
                .iter()
                .zip(max)
                .map(|(&(_, count), max)| count.min(max));
            stats.correct[i] = f64::from(matches.sum::<u32>());
        }
        stats
    }

    /// Adds another item.
    pub fn add(&mut self, other: &Self) {
        for i in 0..4 {
            self.correct[i] += other.correct[i];
            self.guess[i] += other.guess[i];
            self.guess_or_one[i] += other.guess_or_one[i];
        }
        self.candidate_len += other.candidate_len;
        self.reference_len += other.reference_len;
        self.shortest_len += other.shortest_len;
    }

    /// BLEU-1..4 by the given rules.
    pub fn by(&self, rules: Rules) -> Bleu {
        match rules {
            Rules::Coco => self.bleu(),
            Rules::Nmt => self.nmt(false),
            Rules::NmtSmoothed => self.nmt(true),
            Rules::Nltk => self.nltk(f64::MIN_POSITIVE),
            Rules::NltkMethod1 => self.nltk(f64::NAN),
            Rules::Sacrebleu => self.sacrebleu(),
        }
    }

    fn nmt(&self, smoothed: bool) -> Bleu {
        let ratio = self.candidate_len / self.shortest_len;
        let penalty = if ratio > 1.0 {
            1.0
        } else {
            (1.0 - 1.0 / ratio).exp()
        };
        let precision = |i: usize| match (smoothed && i > 0, self.guess[i]) {
            (true, guess) => (self.correct[i] + 1.0) / (guess + 1.0),
            (false, 0.0) => 0.0,
            (false, guess) => self.correct[i] / guess,
        };
        // A precision of 0 makes the geometric mean 0, because its logarithm is negative infinity.
        geometric_means(precision).map(|mean| if mean > 0.0 { mean * penalty } else { 0.0 })
    }

    /// `of_none` is the precision of an order without matches. NaN means that 0.1 matches are counted instead.
    fn nltk(&self, of_none: f64) -> Bleu {
        if self.correct[0] == 0.0 {
            return [0.0; 4];
        }
        let penalty = brevity(self.candidate_len, self.reference_len);
        let precision = |i: usize| match (self.correct[i], of_none.is_nan()) {
            (0.0, true) => 0.1 / self.guess_or_one[i],
            (0.0, false) => of_none,
            (correct, _) => correct / self.guess_or_one[i],
        };
        geometric_means(precision).map(|mean| mean * penalty)
    }

    fn sacrebleu(&self) -> Bleu {
        if self.correct.iter().all(|c| *c == 0.0) {
            return [0.0; 4];
        }
        let penalty = brevity(self.candidate_len, self.reference_len);
        let mut halvings = 1.0;
        let precisions: [f64; 4] =
            std::array::from_fn(|i| match (self.correct[i], self.guess[i]) {
                (_, 0.0) => 0.0,
                (0.0, guess) => {
                    halvings *= 2.0;
                    1.0 / (halvings * guess)
                }
                (correct, guess) => correct / guess,
            });
        geometric_means(|i| precisions[i]).map(|mean| mean * penalty)
    }

    /// BLEU-1..4 by COCO's rules. The only smoothing is COCO's: 1e-15 is added to numerators and 1e-9 to denominators,
    /// so that 0/0 is about 0.
    pub fn bleu(&self) -> Bleu {
        const SMALL: f64 = 1e-9;
        const TINY: f64 = 1e-15;
        let ratio = (self.candidate_len + TINY) / (self.reference_len + SMALL);
        let penalty = if ratio < 1.0 {
            (1.0 - 1.0 / ratio).exp()
        } else {
            1.0
        };
        let mut product = 1.0;
        std::array::from_fn(|i| {
            product *= (self.correct[i] + TINY) / (self.guess[i] + SMALL);
            product.powf(1.0 / (i + 1) as f64) * penalty
        })
    }
}

fn brevity(candidate_len: f64, reference_len: f64) -> f64 {
    if candidate_len > reference_len {
        1.0
    } else if candidate_len == 0.0 {
        0.0
    } else {
        (1.0 - reference_len / candidate_len).exp()
    }
}

/// Geometric means of the first 1, 2, 3 and 4 precisions.
fn geometric_means(precision: impl Fn(usize) -> f64) -> Bleu {
    let mut ln = 0.0;
    std::array::from_fn(|i| {
        ln += precision(i).ln();
        (ln / (i + 1) as f64).exp()
    })
}
