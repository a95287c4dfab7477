//! Compares the bundled weights with `checksums.txt`, so that no program is built of damaged or exchanged ones.

#![allow(
    clippy::disallowed_methods,
    reason = "a build script reads files and speaks to Cargo on standard output"
)]

use std::{error::Error, fs};

const CHECKSUMS: &str = "checksums.txt";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={CHECKSUMS}");
    for line in fs::read_to_string(CHECKSUMS)?.lines() {
        let (expected, path) = line
            .split_once("  ")
            .ok_or_else(|| format!("{CHECKSUMS}: `{line}` is no checksum and path"))?;
        println!("cargo::rerun-if-changed={path}");
        let bytes = fs::read(path).map_err(|e| format!("{path}: {e}"))?;
        let found = blake3::hash(&bytes).to_hex();
        if found.as_str() != expected {
            let text = format!(
                "{path} ({} bytes) has the BLAKE3 {found}, and {CHECKSUMS} states {expected}: the file is damaged or another \
                 one. Clone again, or state its checksum if it was changed on purpose.",
                bytes.len()
            );
            return Err(text.into());
        }
    }
    Ok(())
}
