//! Greedy search, beam search and draws over any network that provides log-probabilities of the next token.
//!
//! [`DecodingBackend`] is the interface that a network implements. A [`Session`] of this engine implements it, and so
//! do the networks of `radarllm-nn`. Scores are log-probabilities among the allowed tokens only, so that tokens that a
//! sentence cannot contain do not reduce its confidence. In a tie the smaller id wins.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::EngineError;
use crate::matrix::padded;
use crate::rows::argmax;
use crate::session::{MAX_STEPS, Session, Source};
use radarllm_simd::SimdLevel;

/// Maximum of [`SearchOptions::max_new_tokens`].
pub const MAX_NEW_TOKENS: usize = MAX_STEPS;

/// Decoding options.
#[derive(Clone, Debug)]
pub struct SearchOptions<'a> {
    /// Maximum number of tokens produced, including the end token, 1..=512.
    pub max_new_tokens: usize,
    /// Number of beams, 1..=64; 1 is greedy search.
    pub beam: usize,
    /// Length penalty: finished beams are compared by their log-probability divided by length to this power.
    pub length_penalty: f32,
    /// Number of rows decoded together, including beams.
    pub batch: usize,
    /// Start token, the first input of the decoder.
    pub start: u32,
    /// End token, which ends a sentence.
    pub end: u32,
    /// Whether each id may be produced, from id 0 on. Ids beyond the end of the slice are forbidden. If the end token
    /// is forbidden, every sentence has the maximum length.
    pub allowed: &'a [bool],
}

/// A decoded sequence.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Generated {
    /// Tokens, without the start and end tokens.
    pub ids: Vec<u32>,
    /// Sum of the log-probabilities of the tokens, including the end token.
    pub log_prob: f32,
    /// exp(mean log-probability), in 0..=1.
    pub confidence: f32,
}

impl Generated {
    /// Creates a result whose log-probability is the sum over `n_scored` tokens.
    pub fn new(ids: Vec<u32>, log_prob: f32, n_scored: usize) -> Self {
        let confidence = (log_prob / n_scored.max(1) as f32).exp();
        Self {
            ids,
            log_prob,
            confidence,
        }
    }
}

/// Receives progress of decoding, and can cancel it.
pub struct Watch<'a> {
    /// Called with the index of a source and its next token. Greedy search calls it immediately, beam search once the
    /// best beam is known.
    pub on_token: &'a mut dyn FnMut(usize, u32),
    /// Once this returns true, decoding stops with [`EngineError::Cancelled`] before the next step.
    pub cancel: &'a AtomicBool,
}

/// Runs `work` with a watch that ignores tokens and never cancels.
pub fn unwatched<R>(work: impl FnOnce(&mut Watch) -> R) -> R {
    work(&mut Watch {
        on_token: &mut |_, _| {},
        cancel: &AtomicBool::new(false),
    })
}

/// A network that decodes step by step, with one row for each unfinished sentence or beam.
pub trait DecodingBackend {
    /// Error type of the network.
    type Error: From<EngineError>;

    /// Number of token ids.
    fn vocab_size(&self) -> usize;

    /// Instruction set for the comparison of scores. It does not affect results.
    fn level(&self) -> SimdLevel {
        SimdLevel::detect()
    }

    /// Checks a source. `index` is its index in the caller's list.
    ///
    /// # Errors
    /// If the source does not fit the network.
    fn check(&self, index: usize, source: &Source) -> Result<(), Self::Error>;

    /// Encodes `sources` and opens `options.beam` rows for each, with the rows of one source side by side, for at most
    /// `options.max_new_tokens` steps. `last` is empty on entry and receives the first decoder input of each row.
    ///
    /// # Errors
    /// If the sources do not fit the network.
    fn start(
        &mut self,
        sources: &[&Source],
        options: &SearchOptions,
        last: &mut Vec<u32>,
    ) -> Result<(), Self::Error>;

    /// Runs one decoding step. The input is the last token of every row. The output is `[rows][mask.len()]`, the
    /// log-probabilities of the next token among the ids whose mask is 0. The other ids have a mask of negative
    /// infinity, which is also their log-probability. The length of `mask` is a multiple of 16 and at most the
    /// vocabulary size, rounded up to 16.
    fn log_probs(&mut self, last: &[u32], mask: &[f32]) -> &[f32];

    /// Continues with the given rows, in this order. Rows may repeat, and there may be fewer than before. If their
    /// number is unchanged, each new row has the same source as the row that it replaces.
    fn keep(&mut self, rows: &[usize]);
}

impl DecodingBackend for Session<'_> {
    type Error = EngineError;

    fn vocab_size(&self) -> usize {
        self.engine().shape().vocab_size
    }

    fn level(&self) -> SimdLevel {
        self.engine().level()
    }

    fn check(&self, index: usize, source: &Source) -> Result<(), EngineError> {
        self.engine().check(index, source)
    }

    fn start(
        &mut self,
        sources: &[&Source],
        options: &SearchOptions,
        last: &mut Vec<u32>,
    ) -> Result<(), EngineError> {
        Session::start(self, sources, options.beam, options.max_new_tokens)?;
        last.resize(self.n_rows(), options.start);
        Ok(())
    }

    fn log_probs(&mut self, last: &[u32], mask: &[f32]) -> &[f32] {
        Session::log_probs(self, last, mask)
    }

    fn keep(&mut self, rows: &[usize]) {
        Session::keep(self, rows);
    }
}

impl Session<'_> {
    /// Decodes every source.
    ///
    /// # Errors
    /// If a source or an option does not fit the network.
    pub fn generate(
        &mut self,
        sources: &[Source],
        options: &SearchOptions,
    ) -> Result<Vec<Generated>, EngineError> {
        unwatched(|watch| self.generate_watched(sources, options, watch))
    }

    /// Like [`Self::generate`], and reports every token to the watch.
    ///
    /// # Errors
    /// Those of [`Self::generate`], and [`EngineError::Cancelled`].
    pub fn generate_watched(
        &mut self,
        sources: &[Source],
        options: &SearchOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Generated>, EngineError> {
        search(self, sources, options, watch)
    }
}

/// Decodes every source, and reports every token to the watch.
///
/// # Errors
/// If a source or an option does not fit the network; [`EngineError::Cancelled`] if the watch cancels.
pub fn search<D: DecodingBackend>(
    backend: &mut D,
    sources: &[Source],
    options: &SearchOptions,
    watch: &mut Watch,
) -> Result<Vec<Generated>, D::Error> {
    let mask = check_options(options, backend.vocab_size())?;
    for (index, source) in sources.iter().enumerate() {
        backend.check(index, source)?;
    }
    let batch = (options.batch / options.beam).clamp(1, 1024);
    // Sources of similar length tend to finish together, and batches of them contain little padding.
    let mut order: Vec<usize> = (0..sources.len()).collect();
    order.sort_by_key(|i| sources[*i].ids.len());
    let mut out = vec![Generated::default(); sources.len()];
    for chunk in order.chunks(batch) {
        let picked: Vec<&Source> = chunk.iter().map(|i| &sources[*i]).collect();
        check_cancelled(watch.cancel)?;
        let mut last = Vec::with_capacity(chunk.len() * options.beam);
        backend.start(&picked, options, &mut last)?;
        let results = if options.beam == 1 {
            greedy(backend, chunk, last, options, &mask, watch)?
        } else {
            beam(backend, chunk.len(), last, options, &mask, watch)?
        };
        for (i, result) in chunk.iter().zip(results) {
            if options.beam > 1 {
                result.ids.iter().for_each(|id| (watch.on_token)(*i, *id));
            }
            out[*i] = result;
        }
    }
    Ok(out)
}

/// Log-probability of every target given a source: the sum over its tokens and the end token, as [`search`] would score
/// them. A target with a token that is not allowed has negative infinity. Targets contain neither start nor end token.
///
/// Beam, length penalty and maximum number of tokens of the options are ignored; `batch` limits the number of targets that
/// are scored together.
///
/// # Errors
/// If the source or an option does not fit the network, or a target is too long.
pub fn score<D: DecodingBackend>(
    backend: &mut D,
    source: &Source,
    targets: &[Vec<u32>],
    options: &SearchOptions,
) -> Result<Vec<f32>, D::Error> {
    backend.check(0, source)?;
    let mut sums = vec![0.0; targets.len()];
    let rows = options.batch.clamp(1, 64);
    for (targets, sums) in targets.chunks(rows).zip(sums.chunks_mut(rows)) {
        let longest = targets.iter().map(Vec::len).max().unwrap_or(0);
        let options = SearchOptions {
            beam: targets.len(),
            max_new_tokens: longest + 1,
            ..options.clone()
        };
        let mask = check_options(&options, backend.vocab_size())?;
        let mut last = Vec::with_capacity(targets.len());
        backend.start(&[source], &options, &mut last)?;
        let mut alive: Vec<usize> = (0..targets.len()).collect();
        for step in 0..=longest {
            let scores = backend.log_probs(&last, &mask);
            let mut kept = Vec::with_capacity(alive.len());
            for (row, scores) in scores.chunks_exact(mask.len()).enumerate() {
                let target = alive[row];
                let next = targets[target].get(step).copied();
                let id = next.unwrap_or(options.end) as usize;
                sums[target] += scores.get(id).copied().unwrap_or(f32::NEG_INFINITY);
                if next.is_some() && sums[target].is_finite() {
                    last[kept.len()] = id as u32;
                    kept.push(row);
                }
            }
            if kept.is_empty() {
                break;
            }
            if kept.len() < alive.len() {
                backend.keep(&kept);
                alive = kept.iter().map(|row| alive[*row]).collect();
                last.truncate(alive.len());
            }
        }
    }
    Ok(sums)
}

/// Draws `n` sequences for every source from the distribution of the network: `[sources][n]`.
///
/// Arithmetic sampling (Vilnis et al., 2023, arXiv:2210.15458): all sequences, in the order of their ids, divide the
/// interval from 0 to 1 in parts as long as their probabilities, and draw `k` is the sequence at `(k + 0.5) / n`. Draws are
/// the same each time, and the share of the draws of any set of sequences that are neighbours in this order differs from its
/// probability by at most `1 / n`.
///
/// Beam and length penalty of the options are ignored; `batch` limits the number of draws that are decoded together.
///
/// # Errors
/// If a source or an option does not fit the network; [`EngineError::Cancelled`] if `cancel` is set.
pub fn draw<D: DecodingBackend>(
    backend: &mut D,
    sources: &[Source],
    n: usize,
    options: &SearchOptions,
    cancel: &AtomicBool,
) -> Result<Vec<Vec<Generated>>, D::Error> {
    let options = SearchOptions {
        beam: n,
        ..options.clone()
    };
    let mask = check_options(&options, backend.vocab_size())?;
    for (index, source) in sources.iter().enumerate() {
        backend.check(index, source)?;
    }
    let mut out = Vec::with_capacity(sources.len());
    for chunk in sources.chunks((options.batch / n).clamp(1, 1024)) {
        let picked: Vec<&Source> = chunk.iter().collect();
        check_cancelled(cancel)?;
        let mut last = Vec::with_capacity(chunk.len() * n);
        backend.start(&picked, &options, &mut last)?;
        let draws = draws(backend, chunk.len() * n, last, &options, &mask, cancel)?;
        out.extend(draws.chunks(n).map(<[Generated]>::to_vec));
    }
    Ok(out)
}

/// One draw from each of `n` rows, `options.beam` of which belong to each source.
fn draws<D: DecodingBackend>(
    backend: &mut D,
    n: usize,
    last: Vec<u32>,
    options: &SearchOptions,
    mask: &[f32],
    cancel: &AtomicBool,
) -> Result<Vec<Generated>, D::Error> {
    let per_source = options.beam;
    // For each draw, its place in the interval of the tokens so far.
    let place = |k: usize| ((k % per_source) as f64 + 0.5) / per_source as f64;
    let mut places: Vec<f64> = (0..n).map(place).collect();
    let pick = |draw: usize, scores: &[f32]| at_place(scores, &mut places[draw]);
    let mut silent = Watch {
        on_token: &mut |_, _| {},
        cancel,
    };
    token_by_token(backend, n, last, options, mask, &mut silent, pick)
}

/// The id whose part of the interval from 0 to 1 contains `place`, and its score. `place` becomes the place within that
/// part. None if no score is finite.
fn at_place(scores: &[f32], place: &mut f64) -> Option<(u32, f32)> {
    let possible = scores.iter().enumerate().filter(|(_, s)| s.is_finite());
    let mut begin = 0.0;
    let mut found = None;
    for (id, score) in possible {
        let probability = f64::from(score.exp());
        found = Some((id as u32, *score));
        if *place < begin + probability {
            *place = (*place - begin) / probability;
            return found;
        }
        begin += probability;
    }
    // Probabilities may add up to a little less than 1.
    *place = 0.5;
    found
}

fn check_cancelled(cancel: &AtomicBool) -> Result<(), EngineError> {
    match cancel.load(Ordering::Relaxed) {
        true => Err(EngineError::Cancelled),
        false => Ok(()),
    }
}

/// Checks the options and returns the mask: 0 for allowed ids and negative infinity for the others, padded.
fn check_options(options: &SearchOptions, vocab_size: usize) -> Result<Vec<f32>, EngineError> {
    let n = options.allowed.len();
    for (field, value, min, max) in [
        ("max_new_tokens", options.max_new_tokens, 1, MAX_STEPS),
        ("beam", options.beam, 1, 64),
        ("start", options.start as usize, 0, vocab_size - 1),
        ("end", options.end as usize, 0, vocab_size - 1),
        ("allowed", n, 1, vocab_size),
    ] {
        if value < min || value > max {
            let problem = format!("must be in {min}..={max}, found {value}");
            return Err(EngineError::Option { field, problem });
        }
    }
    let mut mask = vec![f32::NEG_INFINITY; padded(n)];
    for (mask, allowed) in mask.iter_mut().zip(options.allowed) {
        if *allowed {
            *mask = 0.0;
        }
    }
    Ok(mask)
}

fn greedy<D: DecodingBackend>(
    backend: &mut D,
    chunk: &[usize],
    last: Vec<u32>,
    options: &SearchOptions,
    mask: &[f32],
    watch: &mut Watch,
) -> Result<Vec<Generated>, D::Error> {
    let level = backend.level();
    let pick = |_: usize, scores: &[f32]| argmax(level, scores).map(|(id, s)| (id as u32, s));
    let on_token = &mut *watch.on_token;
    let mut watch = Watch {
        on_token: &mut |row, id| on_token(chunk[row], id),
        cancel: watch.cancel,
    };
    token_by_token(backend, chunk.len(), last, options, mask, &mut watch, pick)
}

/// Continues `n` sentences by the token that `pick` chooses from the scores of each, until all of them end or are as long
/// as they may be. If it chooses none, because no score is finite (weights whose sums overflow), the sentence ends.
fn token_by_token<D: DecodingBackend>(
    backend: &mut D,
    n: usize,
    mut last: Vec<u32>,
    options: &SearchOptions,
    mask: &[f32],
    watch: &mut Watch,
    mut pick: impl FnMut(usize, &[f32]) -> Option<(u32, f32)>,
) -> Result<Vec<Generated>, D::Error> {
    let steps = options.max_new_tokens;
    // For each sentence: tokens, sum of log-probabilities, number of scored tokens.
    let mut out: Vec<(Vec<u32>, f32, usize)> = (0..n)
        .map(|_| (Vec::with_capacity(steps), 0.0, 0))
        .collect();
    let mut alive: Vec<usize> = (0..n).collect();
    let mut kept = Vec::with_capacity(n);
    // The code below does not allocate.
    for step in 0..steps {
        check_cancelled(watch.cancel)?;
        kept.clear();
        let scores = backend.log_probs(&last, mask);
        for (row, scores) in scores.chunks_exact(mask.len()).enumerate() {
            let sentence = alive[row];
            let (id, score) = pick(sentence, scores).unwrap_or((options.end, f32::NEG_INFINITY));
            let (ids, sum, scored) = &mut out[sentence];
            *sum += score;
            *scored += 1;
            if id != options.end {
                ids.push(id);
                (watch.on_token)(sentence, id);
                last[kept.len()] = id;
                kept.push(row);
            }
        }
        if kept.is_empty() || step + 1 == steps {
            break;
        }
        // Finished sentences are removed from the batch, so that later steps compute only the unfinished ones.
        if kept.len() < alive.len() {
            backend.keep(&kept);
            for (to, from) in kept.iter().enumerate() {
                alive[to] = alive[*from];
            }
            alive.truncate(kept.len());
            last.truncate(kept.len());
        }
    }
    Ok(out
        .into_iter()
        .map(|(ids, sum, scored)| Generated::new(ids, sum, scored))
        .collect())
}

/// Beam search over one source.
struct Search {
    /// Open beams, best first. There are `width` of them; unused ones have a sum of negative infinity.
    open: Vec<Sentence>,
    /// Receives the next generation of `open`.
    next: Vec<Sentence>,
    /// Finished sentences, best first.
    done: Vec<Done>,
    /// Sentences dropped from `done`, whose buffers are reused.
    spare: Vec<Done>,
    finished: bool,
}

#[derive(Default)]
struct Sentence {
    ids: Vec<u32>,
    sum: f32,
}

#[derive(Default)]
struct Done {
    score: f32,
    sentence: Sentence,
}

/// An extension of an open beam by one token.
#[derive(Clone, Copy)]
struct Candidate {
    sum: f32,
    beam: usize,
    id: u32,
}

impl Search {
    fn new(width: usize, steps: usize) -> Self {
        // All beams are equal at the start, so that only the first one may be extended at the first step.
        let sentences = || -> Vec<Sentence> {
            (0..width)
                .map(|b| Sentence {
                    ids: Vec::with_capacity(steps),
                    sum: if b == 0 { 0.0 } else { f32::NEG_INFINITY },
                })
                .collect()
        };
        let spare = || Done {
            score: 0.0,
            sentence: Sentence {
                ids: Vec::with_capacity(steps),
                sum: 0.0,
            },
        };
        Self {
            open: sentences(),
            next: sentences(),
            // In one step at most `width` sentences finish before the worst ones are dropped.
            done: Vec::with_capacity(2 * width),
            spare: (0..2 * width).map(|_| spare()).collect(),
            finished: false,
        }
    }

    /// Inserts a finished sentence after those of equal score.
    fn end(&mut self, beam: usize, sum: f32, score: f32) {
        let mut done = self.spare.pop().unwrap_or_default();
        done.sentence.ids.clear();
        done.sentence.ids.extend_from_slice(&self.open[beam].ids);
        done.sentence.sum = sum;
        done.score = score;
        let at = self
            .done
            .partition_point(|d| d.score.total_cmp(&score).is_ge());
        self.done.insert(at, done);
    }
}

fn beam<D: DecodingBackend>(
    backend: &mut D,
    n: usize,
    mut last: Vec<u32>,
    options: &SearchOptions,
    mask: &[f32],
    watch: &mut Watch,
) -> Result<Vec<Generated>, D::Error> {
    let (width, steps) = (options.beam, options.max_new_tokens);
    let level = backend.level();
    let normal = |sum: f32, len: usize| sum / (len as f32).powf(options.length_penalty);
    let mut searches: Vec<Search> = (0..n).map(|_| Search::new(width, steps)).collect();
    let mut parents = Vec::with_capacity(n * width);
    let mut candidates = Vec::with_capacity(2 * width * width);
    let mut best = Vec::with_capacity(2 * width);
    // The code below does not allocate.
    for step in 0..steps {
        check_cancelled(watch.cancel)?;
        let scores = backend.log_probs(&last, mask);
        parents.clear();
        last.clear();
        let mut first = 0;
        // Rows belong to the unfinished searches, in their order.
        for search in searches.iter_mut().filter(|s| !s.finished) {
            candidates.clear();
            for (beam, sentence) in search.open.iter().enumerate() {
                if sentence.sum == f32::NEG_INFINITY {
                    continue;
                }
                let row = &scores[(first + beam) * mask.len()..(first + beam + 1) * mask.len()];
                // Twice the width, so that enough beams continue even if every beam ends.
                top(level, row, 2 * width, &mut best);
                candidates.extend(best.iter().map(|(id, score)| Candidate {
                    sum: sentence.sum + score,
                    beam,
                    id: *id,
                }));
            }
            candidates.sort_unstable_by(|a, b| {
                (b.sum.total_cmp(&a.sum))
                    .then(a.beam.cmp(&b.beam))
                    .then(a.id.cmp(&b.id))
            });
            let mut n_open = 0;
            for (rank, candidate) in candidates.iter().enumerate() {
                let Candidate { sum, beam, id } = *candidate;
                if id == options.end {
                    // An ending outside the best `width` candidates would not have been a beam.
                    if rank < width {
                        let score = normal(sum, search.open[beam].ids.len() + 1);
                        search.end(beam, sum, score);
                    }
                } else if n_open < width && sum > f32::NEG_INFINITY {
                    let next = &mut search.next[n_open];
                    next.ids.clear();
                    next.ids.extend_from_slice(&search.open[beam].ids);
                    next.ids.push(id);
                    next.sum = sum;
                    parents.push(first + beam);
                    last.push(id);
                    n_open += 1;
                }
            }
            for unused in &mut search.next[n_open..] {
                unused.ids.clear();
                unused.sum = f32::NEG_INFINITY;
                parents.push(first);
                last.push(options.end);
            }
            std::mem::swap(&mut search.open, &mut search.next);
            while search.done.len() > width {
                search.spare.extend(search.done.pop());
            }
            // The score that the best open beam would have if it ended now approximates the upper bound of its final
            // score for a length penalty of at most 1. The beam search of Hugging Face uses the same stopping rule.
            let best_open = normal(search.open[0].sum, step + 1);
            let worst_done = search.done.last().map_or(f32::NEG_INFINITY, |d| d.score);
            search.finished = search.done.len() >= width && worst_done >= best_open;
            if search.finished {
                // Its rows are removed from the batch.
                parents.truncate(parents.len() - width);
                last.truncate(last.len() - width);
            }
            first += width;
        }
        if parents.is_empty() || step + 1 == steps {
            break;
        }
        backend.keep(&parents);
    }
    Ok(searches
        .into_iter()
        .map(|search| choose(search, &normal))
        .collect())
}

/// The best finished sentence, or the best open one if none finished within the limit. In a tie the last one wins.
fn choose(search: Search, normal: &dyn Fn(f32, usize) -> f32) -> Generated {
    let by_score = |a: &Done, b: &Done| a.score.total_cmp(&b.score);
    if let Some(best) = search.done.into_iter().max_by(by_score) {
        let Sentence { ids, sum } = best.sentence;
        let n_scored = ids.len() + 1;
        return Generated::new(ids, sum, n_scored);
    }
    let open = search
        .open
        .into_iter()
        .filter(|s| s.sum > f32::NEG_INFINITY);
    let scored = open.map(|sentence| Done {
        score: normal(sentence.sum, sentence.ids.len()),
        sentence,
    });
    scored
        .max_by(by_score)
        .map_or_else(Generated::default, |best| {
            let Sentence { ids, sum } = best.sentence;
            let n_scored = ids.len();
            Generated::new(ids, sum, n_scored)
        })
}

/// Ids and values of the `k` largest finite entries, largest first. In a tie the smaller id comes first.
///
/// `best` must have room for `k` entries.
fn top(level: SimdLevel, scores: &[f32], k: usize, best: &mut Vec<(u32, f32)>) {
    best.clear();
    let mut lowest = f32::NEG_INFINITY;
    for (block, values) in scores.chunks(BLOCK).enumerate() {
        // Most blocks contain no entry that is larger than those found already.
        match argmax(level, values) {
            Some((_, highest)) if highest > lowest => {}
            _ => continue,
        }
        for (i, value) in values.iter().enumerate() {
            if *value > lowest {
                if best.len() == k {
                    best.pop();
                }
                let at = best.partition_point(|(_, v)| v >= value);
                best.insert(at, ((block * BLOCK + i) as u32, *value));
                if best.len() == k {
                    lowest = best[k - 1].1;
                }
            }
        }
    }
}

/// Number of entries compared together; a multiple of 16.
const BLOCK: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::Random;

    #[test]
    fn places_divide_the_interval_by_the_probabilities() {
        let log = |p: f32| p.ln();
        // The second id is forbidden; the probabilities add up to a little less than 1.
        let scores = [log(0.25), f32::NEG_INFINITY, log(0.5), log(0.2499)];
        let at = |mut place: f64| {
            let (id, score) = at_place(&scores, &mut place).unwrap();
            assert_eq!(score, scores[id as usize]);
            (id, (place * 100.0).round())
        };
        assert_eq!(at(0.0), (0, 0.0));
        assert_eq!(at(0.125), (0, 50.0));
        assert_eq!(at(0.26), (2, 2.0));
        assert_eq!(at(0.7499), (2, 100.0));
        assert_eq!(at(0.875), (3, 50.0));
        assert_eq!(at(0.99999), (3, 50.0), "beyond the last part");
        assert_eq!(at_place(&[f32::NEG_INFINITY, f32::NAN], &mut 0.5), None);
    }

    /// A network of two tokens and the end token 0, whose next token depends on the last one.
    struct Chain {
        probabilities: [[f32; 3]; 3],
        n_rows: usize,
        out: Vec<f32>,
    }

    impl DecodingBackend for Chain {
        type Error = EngineError;

        fn vocab_size(&self) -> usize {
            16
        }

        fn check(&self, _index: usize, _source: &Source) -> Result<(), EngineError> {
            Ok(())
        }

        fn start(
            &mut self,
            sources: &[&Source],
            options: &SearchOptions,
            last: &mut Vec<u32>,
        ) -> Result<(), EngineError> {
            self.n_rows = sources.len() * options.beam;
            last.resize(self.n_rows, options.start);
            Ok(())
        }

        fn log_probs(&mut self, last: &[u32], mask: &[f32]) -> &[f32] {
            assert_eq!(last.len(), self.n_rows);
            self.out = vec![f32::NEG_INFINITY; last.len() * mask.len()];
            for (row, id) in self.out.chunks_exact_mut(mask.len()).zip(last) {
                let next = self.probabilities[*id as usize];
                row.iter_mut().zip(next).for_each(|(out, p)| *out = p.ln());
            }
            &self.out
        }

        fn keep(&mut self, rows: &[usize]) {
            self.n_rows = rows.len();
        }
    }

    #[test]
    fn shares_of_draws_are_the_probabilities_of_sequences() {
        let mut chain = Chain {
            probabilities: [[0.0, 0.7, 0.3], [0.6, 0.0, 0.4], [0.5, 0.25, 0.25]],
            n_rows: 0,
            out: Vec::new(),
        };
        let options = |max_new_tokens| SearchOptions {
            max_new_tokens,
            beam: 1,
            length_penalty: 1.0,
            batch: 50,
            start: 0,
            end: 0,
            allowed: &[true; 3],
        };
        let sources = vec![Source::default(); 3];
        let go = AtomicBool::new(false);
        let all = draw(&mut chain, &sources, 40, &options(12), &go).unwrap();
        assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [40; 3]);
        assert!(
            all.iter().all(|draws| draws == &all[0]),
            "sources are alike"
        );
        for (ids, probability) in [
            (&[1][..], 0.7 * 0.6),
            (&[2], 0.3 * 0.5),
            (&[1, 2], 0.7 * 0.4 * 0.5),
            (&[2, 1], 0.3 * 0.25 * 0.6),
        ] {
            let own: Vec<&Generated> = all[0].iter().filter(|g| g.ids == ids).collect();
            let share = own.len() as f32 / 40.0;
            assert!(
                (share - probability).abs() <= 1.0 / 40.0,
                "{ids:?}: {share}"
            );
            let log_prob = own[0].log_prob;
            assert!((log_prob - f32::ln(probability)).abs() < 1e-5, "{ids:?}");
        }
        // The limit ends a sequence.
        let short = draw(&mut chain, &sources[..1], 40, &options(2), &go).unwrap();
        assert!(short[0].iter().all(|g| g.ids.len() <= 2));
        let none: [Source; 0] = [];
        assert!(
            draw(&mut chain, &none, 4, &options(2), &go)
                .unwrap()
                .is_empty()
        );
        let stop = AtomicBool::new(true);
        let stopped = draw(&mut chain, &sources, 4, &options(2), &stop);
        assert!(matches!(stopped, Err(EngineError::Cancelled)));
        for n in [0, 65] {
            let refused = draw(&mut chain, &sources, n, &options(2), &go);
            assert!(matches!(refused, Err(EngineError::Option { .. })), "{n}");
        }
    }

    #[test]
    fn the_largest_are_those_of_sorting() {
        let mut random = Random(6);
        for n in [16, 256, 272, 2000_usize.next_multiple_of(16)] {
            if cfg!(miri) && n > 272 {
                continue; // Miri is some thousand times slower.
            }
            for k in [1, 2, 8, 128] {
                // Coarse values, so that many of them are equal. Some ids are forbidden. There is no negative zero.
                let mut scores: Vec<f32> = (0..n)
                    .map(|_| (random.normal() * 4.0).round() + 0.0)
                    .collect();
                scores[3] = f32::NEG_INFINITY;
                scores[n - 1] = f32::NEG_INFINITY;
                let mut expected: Vec<(u32, f32)> =
                    (0..n as u32).zip(scores.iter().copied()).collect();
                expected.retain(|(_, v)| *v > f32::NEG_INFINITY);
                expected.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                expected.truncate(k);
                let mut found = Vec::with_capacity(k);
                top(SimdLevel::detect(), &scores, k, &mut found);
                assert_eq!(found, expected, "{k} of {n}");
            }
        }
    }
}
