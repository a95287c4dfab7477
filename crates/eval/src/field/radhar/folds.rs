//! Which windows are trained on and which are tested.

use std::collections::BTreeSet;

use radarllm_base::{random::SplitMix64, seed::derive_seed};
use serde::{Deserialize, Serialize};

/// A rule that divides windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// All windows of a recording are in one fold, and every activity is in all folds in equal parts.
    Recording,
    /// All recordings of a session are tested by those of the other sessions, where these have the activity.
    Session,
    /// Windows are drawn at random: windows that overlap are trained on and tested. This leaks.
    Window,
}

impl Protocol {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recording => "by recording",
            Self::Session => "by session",
            Self::Window => "by window (leaks)",
        }
    }
}

/// What the division of a recording depends on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Index of the activity.
    pub activity: usize,
    /// Session.
    pub session: String,
}

/// Indices of windows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fold {
    /// Windows to train on.
    pub train: Vec<usize>,
    /// Windows to test.
    pub test: Vec<usize>,
}

/// The folds of windows, each of which is from a recording in `origins`. Folds without test windows are left out.
pub fn folds(
    protocol: Protocol,
    origins: &[Origin],
    windows: &[usize],
    n_folds: usize,
    seed: u64,
) -> Vec<Fold> {
    let divided = |is_test: &dyn Fn(usize) -> bool, is_train: &dyn Fn(usize) -> bool| {
        let all = 0..windows.len();
        Fold {
            train: all.clone().filter(|i| is_train(*i)).collect(),
            test: all.filter(|i| is_test(*i)).collect(),
        }
    };
    let of = |fold_of: &dyn Fn(usize) -> usize| -> Vec<Fold> {
        (0..n_folds)
            .map(|fold| divided(&|i| fold_of(i) == fold, &|i| fold_of(i) != fold))
            .collect()
    };
    let mut folds = match protocol {
        Protocol::Recording => {
            let fold_of = stratified(origins, n_folds, seed);
            of(&|i| fold_of[windows[i]])
        }
        Protocol::Window => {
            let order = shuffled(windows.len(), derive_seed(seed, "windows"));
            let mut fold_of = vec![0; windows.len()];
            for (place, window) in order.into_iter().enumerate() {
                fold_of[window] = place % n_folds;
            }
            of(&|i| fold_of[i])
        }
        Protocol::Session => {
            let sessions: BTreeSet<&str> = origins.iter().map(|o| o.session.as_str()).collect();
            let fold = |session: &str| {
                let elsewhere = origins.iter().filter(|o| o.session != session);
                let known: BTreeSet<usize> = elsewhere.map(|o| o.activity).collect();
                let origin = |i: usize| &origins[windows[i]];
                divided(
                    &|i| origin(i).session == session && known.contains(&origin(i).activity),
                    &|i| origin(i).session != session,
                )
            };
            sessions.into_iter().map(fold).collect()
        }
    };
    folds.retain(|fold| !fold.test.is_empty() && !fold.train.is_empty());
    folds
}

/// The fold of each recording: the recordings of an activity, in random order, are dealt out in turn, and the next activity
/// goes on where the last one ended.
fn stratified(origins: &[Origin], n_folds: usize, seed: u64) -> Vec<usize> {
    let mut fold_of = vec![0; origins.len()];
    let mut next = 0;
    let activities: BTreeSet<usize> = origins.iter().map(|o| o.activity).collect();
    let order = shuffled(origins.len(), derive_seed(seed, "recordings"));
    for activity in activities {
        for recording in order.iter().filter(|i| origins[**i].activity == activity) {
            fold_of[*recording] = next % n_folds;
            next += 1;
        }
    }
    fold_of
}

/// The numbers below `n` in random order.
pub(super) fn shuffled(n: usize, seed: u64) -> Vec<usize> {
    let mut rng = SplitMix64::new(seed);
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, rng.below(i + 1));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origins() -> Vec<Origin> {
        let origin = |(activity, session): (usize, &str)| Origin {
            activity,
            session: session.into(),
        };
        // Activity 0 has one session, activity 1 two, activity 2 three.
        let counts = [
            (0, "a", 9),
            (1, "a", 4),
            (1, "b", 6),
            (2, "a", 3),
            (2, "b", 3),
            (2, "c", 5),
        ];
        counts
            .into_iter()
            .flat_map(|(activity, session, n)| vec![(activity, session); n])
            .map(origin)
            .collect()
    }

    /// Seven windows of each recording.
    fn windows() -> Vec<usize> {
        (0..30).flat_map(|recording| [recording; 7]).collect()
    }

    #[test]
    fn recordings_are_whole_and_activities_in_all_folds() {
        let (origins, windows) = (origins(), windows());
        let all = folds(Protocol::Recording, &origins, &windows, 5, 1);
        assert_eq!(all.len(), 5);
        let mut tested: Vec<usize> = Vec::new();
        for fold in &all {
            assert_eq!(fold.train.len() + fold.test.len(), windows.len());
            let of =
                |part: &[usize]| -> BTreeSet<usize> { part.iter().map(|i| windows[*i]).collect() };
            assert!(of(&fold.train).is_disjoint(&of(&fold.test)));
            // 30 recordings in five folds, and 9, 10 and 11 of the activities.
            assert_eq!(of(&fold.test).len(), 6);
            for activity in 0..3 {
                let recordings = of(&fold.test);
                let n = recordings
                    .iter()
                    .filter(|r| origins[**r].activity == activity);
                assert!((1..=3).contains(&n.count()));
            }
            tested.extend(&fold.test);
        }
        tested.sort_unstable();
        assert_eq!(tested, (0..windows.len()).collect::<Vec<_>>());
        assert_ne!(all, folds(Protocol::Recording, &origins, &windows, 5, 2));
    }

    #[test]
    fn sessions_are_tested_by_others_that_have_the_activity() {
        let (origins, windows) = (origins(), windows());
        let all = folds(Protocol::Session, &origins, &windows, 5, 1);
        // Session a is tested in activities 1 and 2, b in the same, c in activity 2.
        let sizes: Vec<usize> = all.iter().map(|fold| fold.test.len() / 7).collect();
        assert_eq!(sizes, [7, 9, 5]);
        for (fold, session) in all.iter().zip(["a", "b", "c"]) {
            assert!(
                fold.train
                    .iter()
                    .all(|i| origins[windows[*i]].session != session)
            );
            assert!(
                fold.test
                    .iter()
                    .all(|i| origins[windows[*i]].session == session)
            );
        }
    }

    #[test]
    fn windows_of_a_recording_are_on_both_sides_of_the_leaking_split() {
        let (origins, windows) = (origins(), windows());
        let all = folds(Protocol::Window, &origins, &windows, 5, 1);
        let mut tested: Vec<usize> = all.iter().flat_map(|fold| fold.test.clone()).collect();
        tested.sort_unstable();
        assert_eq!(tested, (0..windows.len()).collect::<Vec<_>>());
        let trained: BTreeSet<usize> = all[0].train.iter().map(|i| windows[*i]).collect();
        let shared = all[0]
            .test
            .iter()
            .filter(|i| trained.contains(&windows[**i]));
        assert_eq!(shared.count(), all[0].test.len());
    }
}
