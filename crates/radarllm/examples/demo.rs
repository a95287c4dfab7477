//! The demo: three motions before a simulated radar, and a minute of a simulated board, in sentences.
//!
//! `cargo run --release --locked -p radarllm --example demo`

use radarllm::{Captioner, Error, PeopleOptions, Verdict};

const MOTIONS: [&str; 3] = [
    "builtin:walk?direction=backward",
    "builtin:sit_down",
    "builtin:wave?side=left",
];
const RECORDING: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/examples/recordings/simulated-uart"
);
/// What the person of the recording did: first and last second, sentence.
const PERFORMED: &str = include_str!("recordings/simulated-uart.txt");

fn main() -> Result<(), Error> {
    let captioner = Captioner::bundled()?;
    let mut verdicts = Vec::new();
    println!("Three motions before a simulated radar; the model sees nothing but the points.\n");
    for motion in MOTIONS {
        let recording = radarllm::open(motion).points()?;
        let described = captioner.describe(&recording.clip)?;
        let performed = recording.performed.map(|p| p.motion.info.captions);
        let performed = performed.and_then(|captions| captions.into_iter().next());
        let performed = performed.unwrap_or_default();
        verdicts.push(print(&performed, &described.caption, described.confidence));
    }

    println!(
        "One minute before a board. The board is simulated, too: simulated-uart.dat is what the serial port of an\n\
         AWR1843BOOST with out-of-box firmware would send. The model knows no recording of this firmware, so its\n\
         confidence is set low.\n"
    );
    let source = radarllm::open(format!("{RECORDING}.dat")).radar(&format!("{RECORDING}.cfg"))?;
    let one_person = PeopleOptions {
        max_people: Some(1),
        ..PeopleOptions::default()
    };
    for person in source.points()?.track_people(&one_person)? {
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

/// What was done for most of a time.
fn performed_in(start_s: f64, end_s: f64) -> &'static str {
    let shared_s = |line: &&str| {
        let mut seconds = line
            .split(' ')
            .map(|word| word.parse::<f64>().unwrap_or(0.0));
        let (from_s, to_s) = (seconds.next().unwrap_or(0.0), seconds.next().unwrap_or(0.0));
        to_s.min(end_s) - from_s.max(start_s)
    };
    let best = PERFORMED
        .lines()
        .max_by(|a, b| shared_s(a).total_cmp(&shared_s(b)));
    best.and_then(|line| line.splitn(3, ' ').nth(2))
        .unwrap_or_default()
}
