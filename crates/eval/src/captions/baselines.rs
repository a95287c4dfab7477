//! Baselines that a caption model must beat: the most frequent caption, captions of other clips, and the caption of
//! the nearest training clip.
//!
//! ```
//! use radarllm_eval::baselines::{NearestNeighbour, majority_caption, shuffled_assignment};
//!
//! // The best constant answer. Case and punctuation do not count.
//! let training = ["a person walks", "A person walks.", "a person sits down"];
//! assert_eq!(majority_caption(&training), Some("a person walks"));
//!
//! // Every clip gets the caption of another clip.
//! let order = shuffled_assignment(4, 1).unwrap();
//! assert!(order.iter().enumerate().all(|(clip, &other)| clip != other));
//!
//! // Retrieval without a trained model: the training clip with the nearest descriptor.
//! let descriptors = [[0.0, 1.0], [10.0, 3.0], [20.0, 2.0]];
//! let neighbours = NearestNeighbour::fit(&descriptors).unwrap();
//! assert_eq!(neighbours.nearest(&[19.0, 2.2]).unwrap(), 2);
//! ```

use std::collections::HashMap;

use radarllm_base::random::SplitMix64;
use radarllm_metrics::tokens;

/// The most frequent caption by its plain tokens; the first seen on a tie. `None` without captions.
pub fn majority_caption<'a>(captions: &[&'a str]) -> Option<&'a str> {
    // Normalised text -> (count, first index).
    let mut counts: HashMap<String, (usize, usize)> = HashMap::new();
    for (i, caption) in captions.iter().enumerate() {
        counts
            .entry(tokens::plain(caption).join(" "))
            .or_insert((0, i))
            .0 += 1;
    }
    let best = counts
        .into_values()
        .max_by_key(|&(count, first)| (count, std::cmp::Reverse(first)));
    best.map(|(_, first)| captions[first])
}

/// A random assignment of n captions to n items in which no item keeps its own: item `i` gets
/// caption `result[i]`. One cycle through all items (Sattolo 1986); with n = 1 there is none.
pub fn shuffled_assignment(n: usize, seed: u64) -> Option<Vec<usize>> {
    if n == 1 {
        return None;
    }
    let mut rng = SplitMix64::new(seed);
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, rng.below(i));
    }
    Some(order)
}

/// Nearest neighbour in L2 after standardising every dimension by the training vectors.
#[derive(Clone, Debug)]
pub struct NearestNeighbour {
    mean: Vec<f32>,
    /// 1 / standard deviation; 0 for constant dimensions, which then do not count.
    scale: Vec<f32>,
    /// `[vector][dimension]`, standardised.
    vectors: Vec<f32>,
}

/// Why vectors cannot be searched.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("descriptor {index}: {problem}")]
pub struct DescriptorError {
    /// Which vector.
    pub index: usize,
    /// What is wrong.
    pub problem: String,
}

impl NearestNeighbour {
    /// Takes training vectors of one width.
    ///
    /// # Errors
    /// No vectors, different widths, values that are not finite.
    pub fn fit<V: AsRef<[f32]>>(vectors: &[V]) -> Result<Self, DescriptorError> {
        let width = match vectors.first() {
            Some(first) => first.as_ref().len(),
            None => {
                return Err(DescriptorError {
                    index: 0,
                    problem: "there are none".into(),
                });
            }
        };
        let (mut sums, mut squares) = (vec![0.0_f64; width], vec![0.0_f64; width]);
        for (index, v) in vectors.iter().enumerate() {
            check(v.as_ref(), width, index)?;
            for (d, &x) in v.as_ref().iter().enumerate() {
                sums[d] += f64::from(x);
            }
        }
        let n = vectors.len() as f64;
        let mean: Vec<f64> = sums.iter().map(|s| s / n).collect();
        for v in vectors {
            for (d, &x) in v.as_ref().iter().enumerate() {
                squares[d] += (f64::from(x) - mean[d]).powi(2);
            }
        }
        let scale = squares.iter().map(|s| {
            if *s > 0.0 {
                (1.0 / (s / n).sqrt()) as f32
            } else {
                0.0
            }
        });
        let scale: Vec<f32> = scale.map(|s| if s.is_finite() { s } else { 0.0 }).collect();
        let mut fitted = Self {
            mean: mean.iter().map(|&m| m as f32).collect(),
            scale,
            vectors: Vec::new(),
        };
        fitted.vectors = vectors
            .iter()
            .flat_map(|v| fitted.standardise(v.as_ref()))
            .collect();
        Ok(fitted)
    }

    /// Index of the closest training vector, the first on a tie.
    ///
    /// # Errors
    /// Another width than in training, values that are not finite.
    pub fn nearest(&self, query: &[f32]) -> Result<usize, DescriptorError> {
        let width = self.mean.len();
        check(query, width, 0)?;
        let query = self.standardise(query);
        let mut best = (f32::INFINITY, 0);
        for (i, v) in self.vectors.chunks_exact(width.max(1)).enumerate() {
            let mut distance = 0.0;
            // Most candidates are out after a few blocks.
            for (a, b) in v.chunks(32).zip(query.chunks(32)) {
                distance += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
                if distance >= best.0 {
                    break;
                }
            }
            if distance < best.0 {
                best = (distance, i);
            }
        }
        Ok(best.1)
    }

    fn standardise(&self, v: &[f32]) -> Vec<f32> {
        v.iter()
            .zip(&self.mean)
            .zip(&self.scale)
            .map(|((x, m), s)| (x - m) * s)
            .collect()
    }
}

fn check(v: &[f32], width: usize, index: usize) -> Result<(), DescriptorError> {
    if v.len() != width {
        return Err(DescriptorError {
            index,
            problem: format!("has {} values, expected {width}", v.len()),
        });
    }
    match v.iter().position(|x| !x.is_finite()) {
        Some(d) => Err(DescriptorError {
            index,
            problem: format!("value {d} is {}", v[d]),
        }),
        None => Ok(()),
    }
}
