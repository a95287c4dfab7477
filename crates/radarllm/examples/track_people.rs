//! Tracks the people in a recording and prints when and where each of them was seen.
//!
//! `cargo run --release -p radarllm --example track_people -- RECORDING`

#![allow(clippy::print_stdout, reason = "an example")]

use radarllm::{Error, PeopleOptions};

fn main() -> Result<(), Error> {
    let path = std::env::args()
        .nth(1)
        .ok_or_else(|| Error::input("usage: track_people RECORDING"))?;
    let options = PeopleOptions {
        remove_ghosts: true,
        ..PeopleOptions::default()
    };
    for person in radarllm::open(path).points()?.track_people(&options)? {
        let n = person.n_points.max(1) as f32;
        let points = person.clip.frames.iter().flat_map(|f| &f.points);
        let (x_m, y_m) = points.fold((0.0, 0.0), |(x, y), p| (x + p.x_m / n, y + p.y_m / n));
        println!(
            "person {}: {:.1} s to {:.1} s, {} points about ({x_m:.1}, {y_m:.1}) m",
            person.id, person.start_s, person.end_s, person.n_points
        );
    }
    Ok(())
}
