//! METEOR 1.5's aligner, which determines the matching words of candidate and reference.
//!
//! All possible matches are listed. Those without a competing match are fixed. For the others, a beam search
//! processes the reference from left to right. Its peculiarities are kept, because values depend on them.

use super::{N_MODULES, Word, paraphrase::Paraphrases};

/// Beam width: number of paths that are followed at the same time.
const BEAM: usize = 40;
/// Weight of a match in the search, by module. The weights of the score are different.
const SEARCH_WEIGHTS: [f64; N_MODULES] = [1.0, 0.5, 0.5, 0.5];

/// Matching words of the candidate and of the reference.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    pub module: usize,
    /// First word and number of words in the reference.
    pub reference: (usize, usize),
    /// First word and number of words in the candidate.
    pub candidate: (usize, usize),
}

/// The chosen matches, ordered by their first word in the reference, and the number of chunks.
pub(super) struct Alignment {
    pub matches: Vec<Match>,
    pub chunks: usize,
}

/// The possible matches that start at each word of the reference, and the number of matches that cover each word of
/// candidate and reference.
struct Stage {
    matches: Vec<Vec<Match>>,
    candidate_coverage: Vec<u32>,
    reference_coverage: Vec<u32>,
}

impl Stage {
    fn add(&mut self, m: Match) {
        self.matches[m.reference.0].push(m);
        range(m.candidate).for_each(|i| self.candidate_coverage[i] += 1);
        range(m.reference).for_each(|i| self.reference_coverage[i] += 1);
    }

    fn add_single(&mut self, module: usize, candidate: usize, reference: usize) {
        self.add(Match {
            module,
            reference: (reference, 1),
            candidate: (candidate, 1),
        });
    }

    /// Whether no other match covers any of its words.
    fn is_alone(&self, m: Match) -> bool {
        range(m.candidate).all(|i| self.candidate_coverage[i] == 1)
            && range(m.reference).all(|i| self.reference_coverage[i] == 1)
    }
}

fn range((start, n): (usize, usize)) -> std::ops::Range<usize> {
    start..start + n
}

/// Aligns two sentences. `synonyms` enables the synonym matcher.
pub(super) fn align(
    candidate: &[&Word],
    reference: &[&Word],
    synonyms: bool,
    paraphrases: Option<&Paraphrases>,
) -> Alignment {
    let mut stage = Stage {
        matches: vec![Vec::new(); reference.len()],
        candidate_coverage: vec![0; candidate.len()],
        reference_coverage: vec![0; reference.len()],
    };
    let mut add_where = |module, fits: &dyn Fn(&Word, &Word) -> bool| {
        for (j, r) in reference.iter().enumerate() {
            for (i, c) in candidate.iter().enumerate() {
                if fits(c, r) {
                    stage.add_single(module, i, j);
                }
            }
        }
    };
    add_where(0, &|c, r| c.number == r.number);
    // Identical sentences use exact matches only.
    let identical = candidate
        .iter()
        .map(|w| w.number)
        .eq(reference.iter().map(|w| w.number));
    if !identical {
        add_where(1, &|c, r| c.stem == r.stem && c.number != r.number);
        if synonyms {
            add_where(2, &|c, r| {
                c.number != r.number && share(&c.synsets, &r.synsets)
            });
        }
        if let Some(paraphrases) = paraphrases {
            let (c, r): (Vec<_>, Vec<_>) = (
                candidate.iter().map(|w| w.paraphrase_word).collect(),
                reference.iter().map(|w| w.paraphrase_word).collect(),
            );
            paraphrases.matches(&r, &c, |reference, candidate| {
                stage.add(Match {
                    module: 3,
                    reference,
                    candidate,
                })
            });
            paraphrases.matches(&c, &r, |candidate, reference| {
                stage.add(Match {
                    module: 3,
                    reference,
                    candidate,
                })
            });
        }
    }
    let mut start = Path::new(candidate.len(), reference.len());
    for list in &stage.matches {
        if let [m] = list[..]
            && stage.is_alone(m)
        {
            start.choose(m, 0);
        }
    }
    let best = search(&stage, start);
    let chosen: Vec<Option<Match>> = (0..reference.len())
        .map(|at| best.choice(&stage, at))
        .collect();
    finish(&chosen)
}

/// Whether two sorted lists have an element in common.
fn share(a: &[u32], b: &[u32]) -> bool {
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        match a[i].cmp(&b[j]) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => return true,
        }
    }
    false
}

/// The ranking criteria of a partial alignment.
#[derive(Clone, Copy, Default)]
struct State {
    /// Numbers of matched words in candidate and reference, weighted by module. Each sum is truncated to an integer
    /// after each addition, so that a single stem or synonym adds nothing.
    weighted: [i64; 2],
    chunks: i64,
    /// Index of the first word of the reference that has not been processed yet.
    next: usize,
    /// End of the last match in the candidate, if that match ends directly before the current word of the reference.
    last_end: Option<usize>,
    distance: i64,
}

impl State {
    fn count(&mut self, m: Match) {
        let weight = SEARCH_WEIGHTS[m.module];
        let lengths = [m.candidate.1, m.reference.1];
        for (sum, n) in self.weighted.iter_mut().zip(lengths) {
            *sum = (*sum as f64 + n as f64 * weight) as i64;
        }
        if self.last_end.is_some_and(|end| end != m.candidate.0) {
            self.chunks += 1;
        }
        self.next = m.reference.0 + m.reference.1;
        self.last_end = Some(m.candidate.0 + m.candidate.1);
    }

    /// Smaller is better.
    fn rank(&self) -> (i64, i64, i64) {
        let weighted = self.weighted[0] + self.weighted[1];
        (-weighted, self.chunks, self.distance)
    }
}

/// A partial alignment.
#[derive(Clone)]
struct Path {
    state: State,
    /// For each word of the reference, the index of the match that starts there in the stage's list, or [`NONE`].
    chosen: Vec<u32>,
    /// Bit set of the words that chosen matches cover: first those of the candidate, then those of the reference.
    used: Vec<u64>,
    /// Index of the first bit of the reference.
    reference_bit: usize,
}

/// No match chosen.
const NONE: u32 = u32::MAX;

impl Path {
    fn new(n_candidate: usize, n_reference: usize) -> Self {
        Self {
            state: State::default(),
            chosen: vec![NONE; n_reference],
            used: vec![0; (n_candidate + n_reference).div_ceil(64)],
            reference_bit: n_candidate,
        }
    }

    fn is_used(&self, bit: usize) -> bool {
        (self.used[bit / 64] >> (bit % 64)) & 1 == 1
    }

    /// Indices of the bits of a match's words.
    fn bits(&self, m: Match) -> impl Iterator<Item = usize> + use<> {
        let reference_bit = self.reference_bit;
        range(m.candidate).chain(range(m.reference).map(move |i| reference_bit + i))
    }

    /// Marks match `m`, number `i` in its list, as chosen. The ranking criteria do not change.
    fn choose(&mut self, m: Match, i: usize) {
        self.chosen[m.reference.0] = i as u32;
        for bit in self.bits(m) {
            self.used[bit / 64] |= 1 << (bit % 64);
        }
    }

    fn is_free(&self, m: Match) -> bool {
        self.bits(m).all(|bit| !self.is_used(bit))
    }

    /// The match that was chosen at a word of the reference.
    fn choice(&self, stage: &Stage, at: usize) -> Option<Match> {
        let i = *self.chosen.get(at)?;
        stage.matches[at].get(i as usize).copied()
    }
}

fn distance(m: Match) -> i64 {
    m.reference.0.abs_diff(m.candidate.0) as i64
}

fn search(stage: &Stage, start: Path) -> Path {
    let mut paths = vec![start];
    for (current, list) in stage.matches.iter().enumerate() {
        // Candidates for the next beam: state, index of the path, and the match that is chosen here. Paths are copied
        // only for the best candidates.
        let mut steps: Vec<(State, usize, Option<usize>)> = Vec::new();
        for (origin, path) in paths.iter().enumerate() {
            let mut state = path.state;
            if path.is_used(path.reference_bit + current) {
                if current < state.next {
                    steps.push((state, origin, None));
                } else if let Some(m) = path.choice(stage, state.next) {
                    state.count(m);
                    state.distance += distance(m);
                    steps.push((state, origin, None));
                }
                continue;
            }
            for (i, &m) in list.iter().enumerate().filter(|(_, m)| path.is_free(**m)) {
                let mut with = state;
                with.count(m);
                steps.push((with, origin, Some(i)));
                // The original implementation adds this distance to the path that continues without the match.
                state.distance += distance(m);
            }
            if state.last_end.take().is_some() {
                state.chunks += 1;
            }
            state.next += 1;
            steps.push((state, origin, None));
        }
        if steps.is_empty() {
            // If no path can continue, the best one is kept unchanged.
            steps.extend(paths.first().map(|p| (p.state, 0, None)));
        }
        // Stable sort: equal elements keep the order in which they were found.
        steps.sort_by_key(|(state, ..)| state.rank());
        steps.truncate(BEAM);
        let go_on = |(state, origin, choice): (State, usize, Option<usize>)| {
            let mut path = paths[origin].clone();
            path.state = state;
            if let Some(i) = choice {
                path.choose(list[i], i);
            }
            path
        };
        paths = steps.into_iter().map(go_on).collect();
    }
    for path in &mut paths {
        if path.state.last_end.is_some() {
            path.state.chunks += 1;
        }
    }
    paths.sort_by_key(|path| path.state.rank());
    // The list is never empty: it starts with one path, and each step keeps at least one.
    paths.into_iter().next().unwrap_or_else(|| Path::new(0, 0))
}

/// Counts the chunks of the chosen matches.
fn finish(chosen: &[Option<Match>]) -> Alignment {
    let mut out = Alignment {
        matches: chosen.iter().copied().flatten().collect(),
        chunks: 0,
    };
    let (mut at, mut last_end) = (0, None);
    while at < chosen.len() {
        match chosen[at] {
            None => {
                out.chunks += usize::from(last_end.take().is_some());
                at += 1;
            }
            Some(m) => {
                out.chunks += usize::from(last_end.is_some_and(|end| end != m.candidate.0));
                at = m.reference.0 + m.reference.1;
                last_end = Some(m.candidate.0 + m.candidate.1);
            }
        }
    }
    out.chunks += usize::from(last_end.is_some());
    out
}
