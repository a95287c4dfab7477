//! Clips of an evaluation to look at: best, median and worst captions, and one of each frequent action.

use std::collections::BTreeMap;

use super::CaptionedClip;

/// Examples of each of best, median and worst.
const PER_GROUP: usize = 4;
/// Actions with an example; each adds about 0.1 MB to a page.
const MAX_ACTIONS: usize = 24;

/// Clips that are shown together.
#[derive(Clone, Debug)]
pub struct ExampleGroup {
    /// Heading.
    pub title: &'static str,
    /// How they were chosen.
    pub about: String,
    /// Indices of the clips.
    pub members: Vec<usize>,
}

/// Chooses examples by ROUGE-L; the choice depends on captions and ids alone.
pub fn choose(clips: &[CaptionedClip]) -> Vec<ExampleGroup> {
    let mut order: Vec<usize> = (0..clips.len()).collect();
    order.sort_by(|&a, &b| {
        let (x, y) = (&clips[a], &clips[b]);
        y.rouge_l
            .total_cmp(&x.rouge_l)
            .then_with(|| x.id.cmp(&y.id))
    });
    let n = order.len();
    let per_group = PER_GROUP.min(n);
    let middle = (n - per_group) / 2;
    let mut by_action: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for &i in &order {
        by_action.entry(&clips[i].action).or_default().push(i);
    }
    let mut actions: Vec<(&str, Vec<usize>)> = by_action.into_iter().collect();
    actions.sort_by_key(|(_, members)| std::cmp::Reverse(members.len()));
    let n_actions = actions.len();
    actions.truncate(MAX_ACTIONS);
    let medians = actions
        .iter()
        .map(|(_, members)| members[members.len() / 2]);
    let by_rouge = |title, which: &str, members: &[usize]| ExampleGroup {
        title,
        about: format!(
            "The {per_group} clips whose captions have the {which} ROUGE-L; equal ones are ordered by id."
        ),
        members: members.to_vec(),
    };
    vec![
        by_rouge("Best", "highest", &order[..per_group]),
        by_rouge("Median", "median", &order[middle..middle + per_group]),
        by_rouge("Worst", "lowest", &order[n - per_group..]),
        ExampleGroup {
            title: "Examples by action",
            about: format!(
                "One clip of each of the {} most frequent actions of {n_actions}: the one with the median ROUGE-L.",
                actions.len()
            ),
            members: medians.collect(),
        },
    ]
}

impl CaptionedClip {
    /// Heading of an example.
    pub fn heading(&self) -> String {
        format!("{} · {}", self.action, self.id)
    }

    /// Where points and caption come from; `data` and `model` name data set and model.
    pub fn provenance_line(&self, data: &str, model: &str) -> String {
        format!(
            "points of `{data}` · source {} · radar {} · model {model} · confidence {:.2}",
            self.source, self.clip.radar, self.description.confidence
        )
    }

    /// Score, classified action and nearest training caption.
    pub fn notes(&self) -> Vec<String> {
        vec![
            format!(
                "ROUGE-L {:.1} · the caption is classified as: {}{}",
                self.rouge_l * 100.0,
                self.classified_as.as_deref().unwrap_or("unknown"),
                if self.is_action_correct() {
                    " (correct)"
                } else {
                    ""
                }
            ),
            format!("Caption of the nearest training clip: {}", self.nearest),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captions::tests::captioned;

    #[test]
    fn examples_are_ordered_by_score_and_every_action_has_its_median() {
        let clips: Vec<CaptionedClip> = (0..9)
            .map(|i| CaptionedClip {
                rouge_l: f64::from(i) / 10.0,
                ..captioned(&format!("m{i}#0"), if i < 6 { "walk" } else { "sit" }, None)
            })
            .collect();
        let groups = choose(&clips);
        let members: Vec<&[usize]> = groups.iter().map(|g| g.members.as_slice()).collect();
        let expected: [&[usize]; 4] = [&[8, 7, 6, 5], &[6, 5, 4, 3], &[3, 2, 1, 0], &[2, 7]];
        assert_eq!(members, expected);
        // Fewer clips than a group has places.
        assert!(
            choose(&clips[..2])
                .iter()
                .take(3)
                .all(|g| g.members.len() == 2)
        );
    }
}
