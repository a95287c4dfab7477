//! Are taught activities recognised, and only they?

use radarllm_base::{Clip, seed::derive_seed};
use radarllm_inference::{Description, PreparedClip};
use radarllm_teach::{Memory, Recogniser};
use serde::Serialize;

use super::{
    LabelledRecording, RecordingsConfig, RecordingsReport, Role, check_recorded, described, report,
};
use crate::EvalError;

/// How activities are taught.
#[derive(Clone, Copy, Debug)]
pub struct TeachOptions {
    /// Examples of each activity.
    pub n_examples: usize,
    /// Draws of examples.
    pub draws: u64,
    /// Role of the evaluated recordings.
    pub role: Role,
}

/// Counts over all draws.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TaughtReport {
    /// Draws of examples.
    pub draws: u64,
    /// Examples of each activity.
    pub examples: usize,
    /// Recordings of taught activities.
    pub recordings: usize,
    /// Those that are described right.
    pub right: usize,
    /// Recordings of activities that were not taught.
    pub others: usize,
    /// Those in which a taught activity is recognised for at least half of the time.
    pub falsely_recognised: usize,
}

/// Teaches every activity by examples of `pool`, drawn at random, and evaluates the recordings that are no examples.
/// Then each activity in turn is left out of the teaching, and its recordings are evaluated.
///
/// `describe` describes a clip without a memory, once for each recording; `recognise` replaces what a description says
/// about the times in which a taught activity is recognised in [`PreparedClip::moving`]. Also returns the report of the last
/// draw in which all activities were taught.
///
/// # Errors
/// An activity without a sentence, no draws, simulated points, or an error of `describe`.
pub fn evaluate_taught<E: From<EvalError>>(
    describe: impl Fn(&PreparedClip) -> Result<Description, E>,
    recognise: impl Fn(&mut Description, &Clip, &Recogniser),
    model: &str,
    config: &RecordingsConfig,
    options: &TeachOptions,
    pool: &[LabelledRecording],
    recordings: &[LabelledRecording],
) -> Result<(TaughtReport, RecordingsReport), E> {
    let mut counts = TaughtReport {
        draws: options.draws,
        examples: options.n_examples,
        ..TaughtReport::default()
    };
    let descriptions = recordings.iter().map(|recording| {
        check_recorded(config, &recording.clip)?;
        describe(&recording.clip)
    });
    let descriptions = descriptions.collect::<Result<Vec<Description>, E>>()?;
    let mut last = None;
    for draw in 0..options.draws {
        let left_out = config.activity.iter().map(|a| Some(a.name.as_str()));
        for left_out in std::iter::once(None).chain(left_out) {
            let (memory, examples) = memory(config, pool, options.n_examples, draw, left_out)?;
            let recogniser = Recogniser::new(&memory);
            let evaluated = recordings
                .iter()
                .zip(&descriptions)
                .filter(|(r, _)| !examples.contains(&r.name.as_str()))
                .filter(|(r, _)| left_out.is_none_or(|name| r.activity == name));
            let rows = evaluated.map(|(recording, description)| {
                let mut description = description.clone();
                if let Some(recogniser) = &recogniser {
                    recognise(&mut description, recording.clip.moving(), recogniser);
                }
                described(config, recording, &description)
            });
            let report = report(model.into(), config, options.role, rows.collect());
            if left_out.is_some() {
                counts.others += report.recordings;
                counts.falsely_recognised +=
                    report.rows.iter().filter(|r| r.is_recognised()).count();
            } else {
                counts.recordings += report.recordings;
                counts.right += report.right;
                last = Some(report);
            }
        }
    }
    let last = last.ok_or_else(|| EvalError::Config("no draws of taught recordings".into()))?;
    Ok((counts, last))
}

/// A memory of all activities but one, and the names of the recordings in it.
fn memory<'a>(
    config: &RecordingsConfig,
    pool: &'a [LabelledRecording],
    n_examples: usize,
    draw: u64,
    left_out: Option<&str>,
) -> Result<(Memory, Vec<&'a str>), EvalError> {
    let mut memory = Memory::default();
    let mut names = Vec::new();
    let taught = config.activity.iter();
    for activity in taught.filter(|a| Some(a.name.as_str()) != left_out) {
        let says = activity.says.as_deref().ok_or_else(|| {
            let problem = format!(
                "activity `{}`: no `says` by which it is taught",
                activity.name
            );
            EvalError::Config(problem)
        })?;
        let own = pool.iter().filter(|r| r.activity == activity.name);
        let mut drawn: Vec<&LabelledRecording> = own.collect();
        drawn.sort_by_key(|r| derive_seed(draw, &r.name));
        let mut n = 0;
        for recording in drawn {
            // A recording with too few points is refused by `teach`, and a user takes another one.
            let taught = n < n_examples
                && memory
                    .teach(&activity.name, says, recording.clip.moving())
                    .is_ok();
            if taught {
                names.push(recording.name.as_str());
                n += 1;
            }
        }
    }
    Ok((memory, names))
}

impl TaughtReport {
    /// The counts as a sentence.
    pub fn to_text(&self) -> String {
        let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        format!(
            "taught by {} recordings an activity, {} draws: {} of {} recordings described right ({:.1} %); a taught activity \
             recognised in {} of {} recordings that show none of them ({:.1} %)",
            self.examples,
            self.draws,
            self.right,
            self.recordings,
            percent(self.right, self.recordings),
            self.falsely_recognised,
            self.others,
            percent(self.falsely_recognised, self.others)
        )
    }
}
