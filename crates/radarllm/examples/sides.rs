//! How often is the side right? Built-in motions of the left, the right or both sides, simulated and described.
//!
//! `cargo run --release -p radarllm --example sides -- [FIRST_SEED] [N_SEEDS]` prints the table of
//! `docs/results/sides.md`.

#![allow(clippy::print_stdout, reason = "an example")]

use radarllm::facts::{Side, parse};
use radarllm::{Captioner, Error, SimulateOptions, open_radar, simulate_motion};

/// Ten motions of one side; those with `true` can be made with both sides, too.
const MOTIONS: [(&str, bool); 10] = [
    ("wave", true),
    ("raise_arms", true),
    ("punch", true),
    ("throw", true),
    ("pull", true),
    ("pick_up", true),
    ("knock", false),
    ("point", false),
    ("kick", false),
    ("lunge", false),
];
/// A wrong sentence with at least this confidence misleads.
const SURE: f32 = 0.9;

/// What was performed and said about one clip.
struct Row {
    name: &'static str,
    side: Side,
    /// The side that was said, if any; `None` if the action was not named.
    said: Option<Option<Side>>,
    confidence: f32,
}

fn main() -> Result<(), Error> {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse());
    let mut number = |default: u64| match numbers.next() {
        Some(number) => number.map_err(|e| Error::input(format!("a seed: {e}"))),
        None => Ok(default),
    };
    let (first, n) = (number(1)?, number(50)?);
    let radar = open_radar(radarllm::DEFAULT_RADAR)?.into_config()?;
    let captioner = Captioner::bundled()?;
    let mut rows = Vec::new();
    for seed in first..first + n {
        let options = SimulateOptions {
            seed,
            ..SimulateOptions::default()
        };
        for (name, has_both) in MOTIONS {
            // The sides take turns with the seeds.
            let n_sides = if has_both { 3 } else { 2 };
            let side = [Side::Left, Side::Right, Side::Both][(seed % n_sides) as usize];
            let input = format!("builtin:{name}?side={}", side.word());
            let clip = simulate_motion(&input, &radar, &options)?.clip;
            let described = captioner.describe(&clip)?;
            let clauses = parse(&described.caption);
            let mut actions = clauses.iter().flat_map(|clause| &clause.actions);
            rows.push(Row {
                name,
                side,
                said: actions.find(|a| a.name == name).map(|a| a.side),
                confidence: described.confidence,
            });
        }
    }
    println!(
        "| performed | clips | action | side | left for right | both for one | one for both | no side \
         | confidence: right | wrong | wrong, at min {SURE} |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for (name, _) in MOTIONS {
        print(name, &rows, |row| row.name == name);
    }
    for side in [Side::Left, Side::Right, Side::Both] {
        print(&format!("all, {}", side.word()), &rows, |row| {
            row.side == side
        });
    }
    print("all", &rows, |_| true);
    Ok(())
}

fn print(title: &str, rows: &[Row], is_shown: impl Fn(&Row) -> bool) {
    let rows: Vec<&Row> = rows.iter().filter(|row| is_shown(row)).collect();
    let count = |is: &dyn Fn(&Row, Side) -> bool| {
        let said = rows.iter().filter_map(|r| Some((r, r.said??)));
        said.filter(|(row, said)| is(row, *said)).count()
    };
    let (is_both, not_both) = (|s: Side| s == Side::Both, |s: Side| s != Side::Both);
    let counts = [
        rows.len(),
        rows.iter().filter(|r| r.said.is_some()).count(),
        count(&|row, said| said == row.side),
        count(&|row, said| said != row.side && not_both(said) && not_both(row.side)),
        count(&|row, said| is_both(said) && not_both(row.side)),
        count(&|row, said| not_both(said) && is_both(row.side)),
        rows.iter().filter(|r| r.said == Some(None)).count(),
    ];
    let counts = counts.map(|n| n.to_string()).join(" | ");
    // A sentence that leaves out the side is not wrong.
    let is_right = |r: &Row| matches!(r.said, Some(said) if said.is_none_or(|s| s == r.side));
    let (right, wrong): (Vec<&Row>, Vec<&Row>) = rows.into_iter().partition(|r| is_right(r));
    let mean = |rows: &[&Row]| match rows.len() {
        0 => "-".to_string(),
        n => {
            let sum: f32 = rows.iter().map(|r| r.confidence).sum();
            format!("{:.2}", sum / n as f32)
        }
    };
    let sure = wrong.iter().filter(|r| r.confidence >= SURE).count();
    println!(
        "| {title} | {counts} | {} | {} | {sure} |",
        mean(&right),
        mean(&wrong)
    );
}
