//! Inference on packed weights: the radar tokenizer, and the radar-language model's T5.
//!
//! The networks, their weights' names and what decoding means are those of `radarllm-inference`, which trains
//! them; this crate runs them faster and without a learning framework. It opens no files and allocates
//! nothing between tokens nor between clips.
//!
//! Reading order: [`tokenizer`] (tubes of points to codes); for the T5 [`weights`] (names and shapes),
//! [`Engine`] (weights packed once), [`Session`] (buffers and threads of one caller), [`search`] (greedy
//! and beam decoding). Below them: `matrix` (products), `rows` (norms, attention, probabilities), `simd`
//! (instruction sets), `pool` (threads).
//!
//! Deliberately absent: text and points. Tubes and ids enter, codes and ids leave; `radarllm-inference` knows
//! what they mean.

mod error;
mod matrix;
mod network;
mod pool;
pub mod position;
mod rows;
pub mod search;
mod session;
mod simd;
pub mod tokenizer;
pub mod weights;

pub use error::EngineError;
pub use network::{Engine, Precision};
pub use search::{Generated, SearchOptions};
pub use session::{MAX_SOURCE, MAX_STEPS, Session, Source};
pub use simd::SimdLevel;
pub use weights::{HostTensor, NamedTensors, Shape};

#[cfg(test)]
mod tests {
    /// Numbers for tests: SplitMix64.
    pub struct Random(pub u64);

    impl Random {
        pub fn uniform(&mut self) -> f32 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
        }

        /// About normal: the sum of twelve uniform numbers less 6.
        pub fn normal(&mut self) -> f32 {
            (0..12).map(|_| self.uniform()).sum::<f32>() - 6.0
        }
    }
}
