//! report.html of `eval captions`: the tables of the report and example clips.

use radarllm_eval::captions::{
    CaptionReport, CaptionedClip,
    examples::choose,
    report::{summary, tables},
};
use radarllm_render::{
    page::Page,
    report::{Example, Group, ReportPage, Table},
};

/// The page.
pub(super) fn html(report: &CaptionReport, clips: &[CaptionedClip]) -> String {
    let provenance: Vec<String> = clips
        .iter()
        .map(|c| c.provenance_line(&report.data, &report.model))
        .collect();
    let example = |&i: &usize| {
        let c = &clips[i];
        Example {
            page: Page {
                caption: &c.description.caption,
                segments: Vec::new(),
                provenance: &provenance[i],
                frames: &c.clip.frames,
                frame_rate_hz: c.clip.frame_rate_hz,
                radar_height_m: c.clip.radar_height_m,
                mesh: None,
            },
            heading: c.heading(),
            references: &c.references,
            notes: c.notes(),
        }
    };
    let groups = choose(clips)
        .into_iter()
        .map(|group| Group {
            title: group.title.into(),
            about: group.about,
            examples: group.members.iter().map(example).collect(),
        })
        .collect();
    let tables = tables(report)
        .into_iter()
        .map(|table| Table {
            title: table.title,
            about: table.about,
            head: table.head,
            rows: table.rows,
        })
        .collect();
    ReportPage {
        title: &format!("Captions of {}, split {}", report.data, report.split),
        about: summary(report),
        tables,
        groups,
    }
    .to_html()
}
