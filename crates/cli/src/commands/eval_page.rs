//! report.html of `eval`: what report.json says as tables, and clips to look at.

use std::collections::BTreeMap;

use radarllm_dataset::ClipRecord;
use radarllm_inference::lm::Description;
use radarllm_render::{
    page::Page,
    report::{Example, Group, ReportPage, Table},
};

use crate::commands::eval::{Report, SYSTEM_HEAD, Slice, model_line, slice_row, system_row};

/// Examples of each of best, median and worst.
const PER_GROUP: usize = 4;
/// Actions with an example; each adds about 0.1 MB to the page.
const MAX_ACTIONS: usize = 24;

/// One clip and what became of it.
pub struct Shown<'a> {
    pub clip: &'a ClipRecord,
    pub description: &'a Description,
    /// First caption of the nearest training clip.
    pub nearest: &'a str,
    /// ROUGE-L of the caption, 0..1.
    pub rouge_l: f64,
    /// Action that the caption names.
    pub named: Option<&'a str>,
}

/// The page.
pub fn html(report: &Report, shown: &[Shown], frame_rate_hz: f64) -> String {
    let provenance: Vec<String> = shown
        .iter()
        .map(|s| {
            format!(
                "points of `{}` · source {} · radar {} · model {} · confidence {:.2}",
                report.data, s.clip.source, s.clip.radar, report.model, s.description.confidence
            )
        })
        .collect();
    let example = |&i: &usize| {
        let s = &shown[i];
        Example {
            page: Page {
                caption: &s.description.caption,
                provenance: &provenance[i],
                frames: &s.clip.frames,
                frame_rate_hz,
                radar_height_m: s.clip.radar_height_m,
                mesh: None,
            },
            heading: format!("{} · {}", s.clip.action, s.clip.id),
            references: &s.clip.captions,
            notes: vec![
                format!(
                    "ROUGE-L {:.1} · the caption names: {}{}",
                    s.rouge_l * 100.0,
                    s.named.unwrap_or("nothing known"),
                    if s.named == Some(&s.clip.action) {
                        " (right)"
                    } else {
                        ""
                    }
                ),
                format!("Nearest training clip says: {}", s.nearest),
            ],
        }
    };
    let groups = choose(shown)
        .into_iter()
        .map(|(title, about, members)| Group {
            title: title.into(),
            about,
            examples: members.iter().map(example).collect(),
        })
        .collect();
    let title = format!("Captions of {}, split {}", report.data, report.split);
    ReportPage {
        title: &title,
        about: about(report),
        tables: tables(report),
        groups,
    }
    .to_html()
}

fn about(report: &Report) -> Vec<String> {
    let mut lines = vec![
        model_line(report),
        format!(
            "On the machine that made this page, with whatever else it did: {:.1} captions/s, {:.0} radar frames/s, {:.0} \
             tokens/s, from points to sentences.",
            report.captions_per_s, report.radar_frames_per_s, report.tokens_per_s
        ),
    ];
    if let Some(mb) = report.peak_memory_mb {
        lines.push(format!("Peak memory {mb:.0} MB."));
    }
    lines
}

fn tables(report: &Report) -> Vec<Table> {
    let head = |names: &[&str]| names.iter().map(|n| (*n).to_string()).collect::<Vec<_>>();
    let slices = |title: &str, slices: &[Slice], first: &str, about: &str| Table {
        title: title.into(),
        about: about.into(),
        head: head(&[first, "clips", "right action", "ROUGE-L"]),
        rows: slices.iter().map(slice_row).collect(),
    };
    let mut tables = vec![
        Table {
            title: "Scores".into(),
            about: format!(
                "Protocol {}, at most {} references; x100, CIDEr-D in its own scale; 95 % bootstrap intervals over motions. \
                 Right action: a classifier of words, learned from training captions, reads the clip's action in the caption; \
                 on this split's own references it is right in {:.1} %.",
                report.protocol,
                report.max_references,
                report.action_namer_on_references * 100.0
            ),
            head: head(&SYSTEM_HEAD),
            rows: report.systems.iter().map(system_row).collect(),
        },
        slices(
            "By length",
            &report.by_length,
            "clip length",
            "The model, by length of the clip; x100 with 95 % intervals.",
        ),
    ];
    if !report.by_n_actions.is_empty() {
        tables.push(slices(
            "By number of actions",
            &report.by_n_actions,
            "actions",
            "The model, by how many actions a clip is composed of; x100 with 95 % intervals.",
        ));
    }
    tables.push(Table {
        title: "By action".into(),
        about: "Clips of each action, and how many captions name it.".into(),
        head: head(&["action", "clips", "right action %"]),
        rows: report
            .right_action_by_action
            .iter()
            .map(|(action, (clips, share))| {
                vec![
                    action.clone(),
                    clips.to_string(),
                    format!("{:.0}", share * 100.0),
                ]
            })
            .collect(),
    });
    if !report.confusions.is_empty() {
        tables.push(Table {
            title: "Confusions".into(),
            about: format!(
                "Captions that name another action, the {} most frequent.",
                report.confusions.len()
            ),
            head: head(&["action", "the caption names", "clips"]),
            rows: report
                .confusions
                .iter()
                .map(|c| {
                    let named = c.named.as_deref().unwrap_or("nothing known");
                    vec![c.action.clone(), named.into(), c.clips.to_string()]
                })
                .collect(),
        });
    }
    tables
}

/// Title, sentence and members of each group of examples.
fn choose(shown: &[Shown]) -> Vec<(&'static str, String, Vec<usize>)> {
    let mut order: Vec<usize> = (0..shown.len()).collect();
    // Best first; equal ones by id, so that the choice depends on nothing else.
    order.sort_by(|&a, &b| {
        let (x, y) = (&shown[a], &shown[b]);
        y.rouge_l
            .total_cmp(&x.rouge_l)
            .then_with(|| x.clip.id.cmp(&y.clip.id))
    });
    let n = order.len();
    let most = PER_GROUP.min(n);
    let middle = (n - most) / 2;
    let mut by_action: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for &i in &order {
        by_action.entry(&shown[i].clip.action).or_default().push(i);
    }
    let mut actions: Vec<(&str, Vec<usize>)> = by_action.into_iter().collect();
    actions.sort_by_key(|(_, members)| std::cmp::Reverse(members.len()));
    let n_actions = actions.len();
    actions.truncate(MAX_ACTIONS);
    let medians = actions
        .iter()
        .map(|(_, members)| members[members.len() / 2]);
    let by_rouge = |which: &str| {
        format!(
            "The {most} clips whose captions have the {which} ROUGE-L; equal ones in the order of their ids."
        )
    };
    vec![
        ("Best", by_rouge("highest"), order[..most].to_vec()),
        (
            "Median",
            by_rouge("middle"),
            order[middle..middle + most].to_vec(),
        ),
        ("Worst", by_rouge("lowest"), order[n - most..].to_vec()),
        (
            "Examples by action",
            format!(
                "One clip of each of the {} most frequent actions of {n_actions}: the one with the middle ROUGE-L.",
                actions.len()
            ),
            medians.collect(),
        ),
    ]
}
