//! Networks drawn at random, without the crate that trains them.

#![allow(dead_code)] // Each program uses a part.

use radarllm_base::random::step;
use radarllm_engine::tokenizer::{
    NEIGHBOUR_DIM, STEP_DIM, TUBE_DIM, TokenizerShape, Tube, TubeClip,
};
use radarllm_engine::{HostTensor, NamedTensors, Shape, Source};

/// Numbers for tests.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        step(&mut self.0)
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

/// A small tokenizer of odd widths with every part.
pub fn tokenizer_shape() -> TokenizerShape {
    TokenizerShape {
        n_anchors: 7,
        max_steps: 12,
        width: 20,
        n_layers: 2,
        n_heads: 4,
        d_ff: 50,
        pool_queries: 3,
        per_anchor: 5,
        profile: Some(18),
        tube_statistics: true,
        code_dim: 11,
        n_codes: 37,
    }
}

/// Weights of a tokenizer, about as large as training makes them.
pub fn tokenizer_weights(s: &TokenizerShape, seed: u64) -> NamedTensors {
    let mut random = Random(seed);
    let mut out = NamedTensors::new();
    let mut add = |name: String, shape: &[usize], std: f32, mean: f32| {
        let n = shape.iter().product();
        let values = (0..n).map(|_| mean + random.value(std)).collect();
        let shape = shape.to_vec();
        out.insert(name, HostTensor { shape, values });
    };
    let c = s.width;
    let mut linears = vec![
        ("point_conv".to_string(), NEIGHBOUR_DIM, c),
        ("tube_mlp".into(), c, c),
        ("anchor_in".into(), 3, c),
        ("anchor_out".into(), c, c),
        ("step_in".into(), STEP_DIM, c),
        ("pool_scores".into(), c, s.pool_queries),
        ("pool_out".into(), s.pool_queries * c, 2 * c),
        ("pool_step".into(), STEP_DIM, 2 * c),
        ("merge".into(), 4 * c, 4 * c),
        ("code_out".into(), 4 * c, s.code_dim),
    ];
    if s.tube_statistics {
        linears.push(("tube_statistics".into(), TUBE_DIM, c));
    }
    if s.per_anchor > 0 {
        linears.push(("per_anchor.0".into(), c, s.per_anchor));
        linears.push(("per_anchor.1".into(), s.per_anchor * s.n_anchors, 2 * c));
    }
    if let Some(values) = s.profile {
        linears.push(("pool_profile.0".into(), values, 2 * c));
        linears.push(("pool_profile.1".into(), 2 * c, 2 * c));
    }
    let mut norms = vec!["norm".to_string()];
    for i in 0..s.n_layers {
        norms.push(format!("layers.{i}.norm"));
        for axis in ["space", "time"] {
            norms.push(format!("layers.{i}.{axis}.norm"));
            for part in ["query", "key", "value", "out"] {
                linears.push((format!("layers.{i}.{axis}.{part}"), c, c));
            }
        }
        linears.push((format!("layers.{i}.widen"), c, s.d_ff));
        linears.push((format!("layers.{i}.narrow"), s.d_ff, c));
    }
    for (name, from, to) in linears {
        add(
            format!("{name}.weight"),
            &[from, to],
            (from as f32).powf(-0.5),
            0.0,
        );
        add(format!("{name}.bias"), &[to], 0.1, 0.0);
    }
    for name in norms {
        add(format!("{name}.gamma"), &[c], 0.2, 1.0);
        add(format!("{name}.beta"), &[c], 0.1, 0.0);
    }
    add("empty".into(), &[1, c], 0.3, 0.0);
    add("time".into(), &[s.max_steps, c], 0.3, 0.0);
    add("codebook".into(), &[s.n_codes, s.code_dim], 0.5, 0.0);
    out
}

/// A clip that owns its arrays.
#[derive(Clone)]
pub struct OwnedClip {
    pub tubes: Vec<Tube>,
    pub neighbours: Vec<[f32; NEIGHBOUR_DIM]>,
    pub steps: Vec<[f32; STEP_DIM]>,
    pub profiles: Vec<f32>,
    pub anchors: Vec<[f32; 3]>,
}

impl OwnedClip {
    pub fn view(&self) -> TubeClip<'_> {
        TubeClip {
            tubes: &self.tubes,
            neighbours: &self.neighbours,
            steps: &self.steps,
            profiles: &self.profiles,
            anchors: &self.anchors,
        }
    }
}

/// A clip of random tubes of one to five points, in about half of the cells.
pub fn tube_clip(s: &TokenizerShape, n_steps: usize, seed: u64) -> OwnedClip {
    let mut random = Random(seed);
    let mut clip = OwnedClip {
        tubes: Vec::new(),
        neighbours: Vec::new(),
        steps: Vec::new(),
        profiles: Vec::new(),
        anchors: Vec::new(),
    };
    for step in 0..n_steps {
        for anchor in 0..s.n_anchors {
            if random.next().is_multiple_of(2) {
                continue;
            }
            let start = clip.neighbours.len() as u32;
            for _ in 0..=random.next() % 5 {
                let point = std::array::from_fn(|_| random.value(0.5));
                clip.neighbours.push(point);
            }
            clip.tubes.push(Tube {
                step: step as u32,
                anchor: anchor as u32,
                start,
                end: clip.neighbours.len() as u32,
                statistics: std::array::from_fn(|_| random.value(0.5)),
            });
        }
        clip.steps.push(std::array::from_fn(|_| random.value(0.5)));
    }
    let n_profiles = n_steps * s.profile.unwrap_or(0);
    clip.profiles = (0..n_profiles).map(|_| random.value(0.5)).collect();
    let anchor = |_| std::array::from_fn(|_| random.value(0.5));
    clip.anchors = (0..s.n_anchors).map(anchor).collect();
    clip
}
