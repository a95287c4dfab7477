//! Runs the trained networks on a CPU without a learning framework: the radar tokenizer, the decoder of its codes, and
//! the T5 encoder-decoder that generates sentences.
//!
//! Weights are packed once for the processor in use, as f32 or as int8. Many sessions on many threads then share them.
//!
//! ```
//! use radarllm_engine::{Engine, NamedTensors, Precision, SearchOptions, Shape, Source};
//! # use radarllm_engine::HostTensor;
//! # /// Every weight 0.01: what the sentence is does not matter here.
//! # fn load_weights(s: &Shape) -> NamedTensors {
//! #     let mut out = NamedTensors::new();
//! #     let mut add = |name: String, shape: &[usize]| {
//! #         let values = vec![0.01; shape.iter().product()];
//! #         out.insert(name, HostTensor { shape: shape.to_vec(), values });
//! #     };
//! #     let (d, inner) = (s.d_model, s.inner());
//! #     add("t5.shared".into(), &[s.vocab_size, d]);
//! #     for (stack, attentions) in [("encoder", &["attention"][..]), ("decoder", &["attention", "cross"])] {
//! #         add(format!("t5.{stack}.position_bias"), &[s.relative_buckets, s.n_heads]);
//! #         add(format!("t5.{stack}.norm"), &[d]);
//! #         let block = format!("t5.{stack}.blocks.0");
//! #         for attention in attentions {
//! #             add(format!("{block}.{attention}_norm"), &[d]);
//! #             for part in ["q", "k", "v"] {
//! #                 add(format!("{block}.{attention}.{part}"), &[d, inner]);
//! #             }
//! #             add(format!("{block}.{attention}.o"), &[inner, d]);
//! #         }
//! #         add(format!("{block}.feed_norm"), &[d]);
//! #         add(format!("{block}.feed.wi"), &[d, s.d_ff]);
//! #         add(format!("{block}.feed.wo"), &[s.d_ff, d]);
//! #     }
//! #     out
//! # }
//!
//! // A T5 of one block each way; real shapes come with a checkpoint.
//! let shape = Shape {
//!     vocab_size: 40,
//!     d_model: 16,
//!     d_kv: 8,
//!     n_heads: 2,
//!     d_ff: 32,
//!     n_encoder_layers: 1,
//!     n_decoder_layers: 1,
//!     gated: false,
//!     tied: true,
//!     scaled: true,
//!     relative_buckets: 8,
//!     relative_max_distance: 16,
//!     norm_eps: 1e-6,
//!     bypass: None,
//! };
//! let weights: NamedTensors = load_weights(&shape);
//! let engine = Engine::new(shape, Precision::Int8, weights)?;
//!
//! // A session has the buffers and threads of one caller.
//! let mut session = engine.session(2);
//! let prompts = [
//!     Source { ids: vec![7, 8, 9], ..Source::default() },
//!     Source { ids: vec![5], ..Source::default() },
//! ];
//! let options = SearchOptions {
//!     max_new_tokens: 4,
//!     beam: 2,
//!     length_penalty: 1.0,
//!     batch: 32,
//!     start: 0,
//!     end: 1,
//!     allowed: &[true; 40],
//! };
//! let sentences = session.generate(&prompts, &options)?;
//! assert_eq!(sentences.len(), prompts.len());
//! assert!(sentences.iter().all(|s| s.ids.len() <= 4 && s.confidence <= 1.0));
//! # Ok::<(), radarllm_engine::EngineError>(())
//! ```
//!
//! The networks, the names of their weights and the rules of decoding are those of `radarllm-nn`, which trains the
//! networks. This crate opens no files. It allocates no memory between tokens or between clips.
//!
//! The vector instructions are chosen once per engine ([`SimdLevel`]): AVX-512 with VNNI, AVX-512, AVX2, or portable
//! code. Sentences depend neither on the number of threads nor on the other members of the batch.
//!
//! Reading order: [`tokenizer`] (tubes of points to codes); [`point_decoder`] (codes to points); [`evidence`] (what the points say by themselves);
//! for the T5, [`weights`] (names and shapes), [`Engine`]
//! (packed weights), [`Session`] (buffers and threads of one caller) and [`search`](mod@search) (greedy and beam
//! search, also used by other networks). Internal modules: `matrix` (matrix products), `dense` (layers of small networks), `rows` (norms, attention,
//! softmax) and `pool` (threads).
//!
//! Out of scope: text and points. The inputs are tubes and token ids, the outputs are codes and token ids.
//! `radarllm-inference` interprets them.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

mod dense;
mod error;
pub mod evidence;
mod matrix;
mod network;
pub mod point_decoder;
mod pool;
pub mod position;
mod rows;
pub mod search;
mod session;

pub mod tokenizer;
pub mod weights;

pub use error::EngineError;
pub use network::{Engine, Precision};
pub use radarllm_simd::{InstructionSet, SimdLevel};
pub use search::{DecodingBackend, Generated, SearchOptions, Watch};
pub use session::{MAX_SOURCE, MAX_STEPS, Session, Source};
pub use weights::{HostTensor, NamedTensors, Shape};

#[cfg(test)]
mod tests {
    use radarllm_base::random::step;

    /// Random numbers for tests.
    pub struct Random(pub u64);

    impl Random {
        pub fn uniform(&mut self) -> f32 {
            (step(&mut self.0) >> 40) as f32 / (1 << 24) as f32
        }

        /// Approximately normal: the sum of twelve uniform numbers minus 6.
        pub fn normal(&mut self) -> f32 {
            (0..12).map(|_| self.uniform()).sum::<f32>() - 6.0
        }
    }
}
