//! Builds a small radar-text data set of built-in motions and reads it again.
//!
//! `cargo run --release -p radarllm --example build_dataset -- FOLDER`

#![allow(clippy::print_stdout, reason = "an example")]

use std::path::Path;

use radarllm::{
    DatasetPlan, Error, Overwrite,
    dataset::{BuildOptions, Dataset, Split},
    synth::config::DatasetConfig,
};

const CONFIG: &str = r#"
name = "small"
[[source]]
kind = "procedural"
train = 4
val = 1
test = 1
"#;

fn main() -> Result<(), Error> {
    let folder = std::env::args().nth(1).unwrap_or("small-data".into());
    let plan = DatasetPlan::new(DatasetConfig::from_toml(CONFIG)?, Path::new(""))?;
    let options = BuildOptions {
        threads: 2,
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    plan.build(folder.as_ref(), options, |_| (), &|| false)?;
    for clip in Dataset::open(folder.as_ref())?.read_split(Split::Train)? {
        println!("{}: {}", clip.id, clip.captions[0]);
    }
    Ok(())
}
