//! The demo: three motions in front of a simulated radar, and a minute of a simulated board, in sentences.
//!
//! `cargo run --release --locked -p radarllm-demo`

#![expect(clippy::print_stdout, reason = "a demo prints")]

use radarllm::{Captioner, Error, PeopleOptions, Provenance, Verdict};
use radarllm_demo::{BOARD, MOTIONS, SEED, performed_in};

/// Where the recording lies, without the ending of its files.
const RECORDING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/recording/simulated-uart");

fn main() -> Result<(), Error> {
    let captioner = Captioner::bundled()?;
    let mut verdicts = Vec::new();
    println!(
        "Three motions in front of a simulated radar; the model sees nothing but the points.\n"
    );
    for motion in MOTIONS {
        let recording = radarllm::open(motion).points()?;
        let described = captioner.describe(&recording.clip)?;
        let performed = recording.performed.map(|p| p.motion.info.captions);
        let performed = performed.and_then(|captions| captions.into_iter().next());
        let performed = performed.unwrap_or_default();
        verdicts.push(print(&performed, &described.caption, described.confidence));
    }

    println!("{BOARD}");
    let source = radarllm::open(format!("{RECORDING}.dat")).radar(&format!("{RECORDING}.cfg"))?;
    let one_person = PeopleOptions {
        max_people: Some(1),
        ..PeopleOptions::default()
    };
    let mut recording = source.points()?;
    // The stream does not say that its board was simulated.
    recording.clip.provenance = Provenance::simulated("simulated-uart.dat", SEED);
    for person in recording.track_people(&one_person)? {
        for part in captioner.describe(&person.clip)?.segments {
            println!(
                "person {}, {:.0} to {:.0} s",
                person.id, part.start_s, part.end_s
            );
            let performed = performed_in(part.start_s, part.end_s);
            verdicts.push(print(performed, &part.caption, part.confidence));
        }
    }
    let n_right = verdicts.iter().filter(|v| **v == Verdict::Right).count();
    println!("{n_right} of {} sentences are right.", verdicts.len());
    Ok(())
}

fn print(performed: &str, described: &str, confidence: f32) -> Verdict {
    let verdict = Verdict::of(described, performed);
    println!("    performed: {performed}");
    println!("    described: {described}");
    println!("    {verdict}, confidence {confidence:.2}\n");
    verdict
}
