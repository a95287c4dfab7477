//! Rebuilds the binary when the embedded model changes: the embedding macro cannot say so itself.
fn main() {
    println!("cargo:rerun-if-changed=../../models/default");
}
