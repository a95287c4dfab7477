//! Networks drawn at random, without the crate that trains them.

#![allow(dead_code)] // Each program uses a part.

use radarllm_engine::{HostTensor, NamedTensors, Shape, Source};

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform with this standard deviation.
    pub fn value(&mut self, std: f32) -> f32 {
        ((self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0) * std * 3f32.sqrt()
    }
}

/// T5-small, the original: 6 + 6 layers, 8 heads of 64, ReLU, tied.
pub fn t5_small() -> Shape {
    Shape {
        vocab_size: 32_128,
        d_model: 512,
        d_kv: 64,
        n_heads: 8,
        d_ff: 2048,
        n_encoder_layers: 6,
        n_decoder_layers: 6,
        gated: false,
        tied: true,
        scaled: true,
        relative_buckets: 32,
        relative_max_distance: 128,
        norm_eps: 1e-6,
        bypass: None,
    }
}

/// Weights of a shape, with the spread that training starts from.
pub fn weights(s: &Shape, seed: u64) -> NamedTensors {
    let mut random = Random(seed);
    let mut out = NamedTensors::new();
    let mut add = |name: String, shape: &[usize], std: f32| {
        let n = shape.iter().product();
        let values = (0..n).map(|_| random.value(std)).collect();
        let shape = shape.to_vec();
        out.insert(name, HostTensor { shape, values });
    };
    let (d, inner) = (s.d_model, s.n_heads * s.d_kv);
    let narrow = (d as f32).powf(-0.5);
    add("t5.shared".into(), &[s.vocab_size, d], 1.0);
    if !s.tied {
        add("t5.head".into(), &[s.vocab_size, d], narrow);
    }
    if let Some(code_dim) = s.bypass {
        add(
            "bypass".into(),
            &[code_dim, d],
            (code_dim as f32).powf(-0.5),
        );
    }
    for (stack, n_layers) in [
        ("encoder", s.n_encoder_layers),
        ("decoder", s.n_decoder_layers),
    ] {
        let buckets = [s.relative_buckets, s.n_heads];
        add(format!("t5.{stack}.position_bias"), &buckets, 0.5);
        add(format!("t5.{stack}.norm"), &[d], 1.0);
        for i in 0..n_layers {
            let block = format!("t5.{stack}.blocks.{i}");
            let mut attentions = vec!["attention"];
            if stack == "decoder" {
                attentions.push("cross");
            }
            for attention in attentions {
                let queries = ((d * s.d_kv) as f32).powf(-0.5);
                add(format!("{block}.{attention}_norm"), &[d], 1.0);
                add(format!("{block}.{attention}.q"), &[d, inner], queries);
                add(format!("{block}.{attention}.k"), &[d, inner], narrow);
                add(format!("{block}.{attention}.v"), &[d, inner], narrow);
                let std = (inner as f32).powf(-0.5);
                add(format!("{block}.{attention}.o"), &[inner, d], std);
            }
            add(format!("{block}.feed_norm"), &[d], 1.0);
            add(format!("{block}.feed.wi"), &[d, s.d_ff], narrow);
            if s.gated {
                add(format!("{block}.feed.gate"), &[d, s.d_ff], narrow);
            }
            let std = (s.d_ff as f32).powf(-0.5);
            add(format!("{block}.feed.wo"), &[s.d_ff, d], std);
        }
    }
    out
}

/// Inputs of the given lengths.
pub fn sources(vocab_size: usize, lengths: &[usize], seed: u64) -> Vec<Source> {
    let mut random = Random(seed);
    lengths
        .iter()
        .map(|n| Source {
            ids: (0..*n)
                .map(|_| (random.next() % vocab_size as u64) as u32)
                .collect(),
            ..Source::default()
        })
        .collect()
}
