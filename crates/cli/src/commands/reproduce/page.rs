//! The page: what was trained here beside what the paper reports.

use radarllm_eval::{
    ablation::TableReport,
    instructions::{self, InstructionReport},
    round_trip::RoundTripReport,
};
use serde_json::Value;

/// What the page shows.
pub(super) struct Parts<'a> {
    pub scale: &'a str,
    pub clips: usize,
    /// `report.json` of the whole system.
    pub report: &'a Value,
    pub tables: &'a [TableReport],
    /// The tables of the grid as Markdown.
    pub ablations: &'a str,
    pub round_trip: &'a RoundTripReport,
    pub instructions: &'a InstructionReport,
}

/// Columns of the main table: key in the reports and factor.
const COLUMNS: [(&str, &str, f64); 6] = [
    ("rouge_1", "ROUGE-1", 100.0),
    ("rouge_l", "ROUGE-L", 100.0),
    ("bleu_1", "BLEU-1", 100.0),
    ("bleu_4", "BLEU-4", 100.0),
    ("meteor", "METEOR", 100.0),
    ("cider_d", "CIDEr", 1.0),
];

/// The paper's main results (radarllm.tex, tab:main_results): on virtual and on real radar, in the order of [`COLUMNS`].
const REPORTED: [(&str, [f64; 6], [f64; 6]); 7] = [
    (
        "MotionGPT, fine-tuned",
        [31.2, 29.4, 37.6, 5.0, 26.1, 6.5],
        [28.0, 25.6, 36.1, 2.9, 21.9, 3.2],
    ),
    (
        "AvatarGPT, fine-tuned",
        [32.2, 30.0, 36.3, 5.0, 28.3, 6.8],
        [31.0, 28.8, 38.1, 4.2, 25.6, 5.6],
    ),
    (
        "Video-LLaMA2, fine-tuned",
        [30.2, 26.7, 35.2, 3.6, 30.4, 4.2],
        [31.4, 28.8, 38.3, 4.3, 28.6, 7.0],
    ),
    (
        "Video-ChatGPT, fine-tuned",
        [18.6, 16.1, 19.5, 0.8, 15.3, 1.0],
        [17.8, 15.6, 19.4, 0.1, 13.0, 1.2],
    ),
    (
        "Video-LLaVA, fine-tuned",
        [22.8, 19.2, 26.7, 1.3, 19.2, 2.1],
        [22.6, 19.3, 27.2, 1.4, 17.4, 3.5],
    ),
    (
        "VTimeLLM, fine-tuned",
        [19.1, 15.8, 19.0, 0.9, 17.7, 1.4],
        [21.3, 16.9, 24.1, 0.8, 18.0, 2.1],
    ),
    (
        "RadarLLM",
        [38.4, 36.0, 48.0, 11.4, 33.7, 8.3],
        [31.7, 28.8, 44.2, 5.0, 25.7, 4.0],
    ),
];

/// The page as Markdown.
pub(super) fn of(parts: &Parts) -> String {
    let mut text = format!(
        "# The system of the RadarLLM paper, scale `{}`\n\n{} simulated clips. Figures of the paper are on other data and at \
         another size; they stand here to be seen, and nothing is computed with them.\n\n## Captions of the test split\n\n",
        parts.scale, parts.clips
    );
    text += &main_table(parts.report);
    text += &use_of_codes(parts.report);
    text += "\n## Reported by the paper, on virtual and on real radar\n\n";
    text += &reported();
    text += "\n## Ablations\n\n";
    let n_rows: usize = parts.tables.iter().map(|table| table.rows.len()).sum();
    text += &format!("{n_rows} rows in {} tables. ", parts.tables.len());
    // The tables have headings of their own, a level below.
    text += &parts.ablations.replace("\n## ", "\n### ");
    text += &round_trip(parts.round_trip);
    text += &instructions::markdown(parts.instructions).replacen("# ", "\n## ", 1);
    text += "\n## Not run\n\n\
             - The comparison systems of the paper: `radarllm baselines run` trains systems of their kind on the same clips; \
             the video language models need their weights and a GPU.\n\
             - The paper's own recordings, which are not public.\n\
             - Errors of estimated bodies (the paper's table of pose estimation): `radarllm baselines run` measures them.\n";
    text
}

fn heading(first: &[&str]) -> String {
    let names = first.iter().copied().chain(COLUMNS.map(|c| c.1));
    let names: Vec<&str> = names.collect();
    format!(
        "| {} |\n|{}\n",
        names.join(" | "),
        "---|".repeat(names.len())
    )
}

fn number(value: Option<f64>, factor: f64) -> String {
    let digits = if factor == 1.0 { 2 } else { 1 };
    value.map_or("not run".into(), |v| format!("{:.digits$}", v * factor))
}

fn main_table(report: &Value) -> String {
    let mut text = heading(&["system"]).replace(" |\n|", " | same actions, % |\n|---|");
    for system in report["systems"].as_array().into_iter().flatten() {
        let mut cells = vec![system["what"].as_str().unwrap_or_default().to_string()];
        for (key, _, factor) in COLUMNS {
            cells.push(number(system["scores"][key].as_f64(), factor));
        }
        cells.push(number(system["same_actions"]["value"].as_f64(), 100.0));
        text += &format!("| {} |\n", cells.join(" | "));
    }
    text
}

fn use_of_codes(report: &Value) -> String {
    let codes = &report["codes"];
    let perplexity = codes["perplexity"].as_f64().unwrap_or(f64::NAN);
    format!(
        "\n{} clips; {} parameters; {:.1} clips a second; perplexity of the codes {perplexity:.0}.\n",
        report["clips"],
        report["parameters"],
        report["captions_per_s"].as_f64().unwrap_or(f64::NAN),
    )
}

fn reported() -> String {
    let mut text = heading(&["system", "radar"]);
    for (name, virtual_radar, real_radar) in REPORTED {
        for (radar, values) in [("virtual", virtual_radar), ("real", real_radar)] {
            let values = values.map(|v| format!("*{v}*"));
            text += &format!("| {name} | {radar} | {} |\n", values.join(" | "));
        }
    }
    text
}

fn round_trip(report: &RoundTripReport) -> String {
    let mut text = format!(
        "\n## Radar from sentences\n\n{} sentences of the test split to radar and back to a sentence; {} without radar, {} in which \
         no person is seen.\n\n| described | same actions, % |\n|---|---|\n",
        report.sentences, report.empty, report.abstained
    );
    for system in &report.systems {
        let same = system.same_actions.to_text(100.0, 1);
        text += &format!("| {} | {same} |\n", system.what);
    }
    text
}
