//! Detects errors in radar descriptions, and warns about settings that give poor results.
//!
//! [`lint_ti_cfg`] and [`lint_radar_toml`] check a file and report positions in it; [`lint`] checks an existing radar.
//! Rules by module: this module checks whether a file describes a radar, [`rules`] checks the chirp and the scene,
//! [`budgets`] the load on the hardware, and [`model`] the similarity to the training data of a model.
//!
//! | rule | severity | meaning |
//! |---|---|---|
//! | `syntax`, `missing-command`, `missing-field`, `unknown-base` | error | the file cannot be read |
//! | `unsupported`, `unknown-antennas` | warning if points can be read and the file does not enable raw samples, else error | the file is readable, but no [`RadarConfig`] can express it |
//! | `tx-mask`, `undefined-chirp`, `undefined-profile`, `undefined-subframe`, `antenna-geometry` | error | chirps or antennas that do not exist |
//! | `adc-window`, `frame-period`, `radar-value` | error | an impossible radar |
//! | `band` | error for a known board, else warning | the ramp leaves the band of the part |
//! | `adc-rate` | error for a known board, else warning | the sample rate exceeds that of the part |
//! | `lvds-budget` | error if the file enables the stream, else warning or note | raw samples exceed the rate of LVDS or Ethernet |
//! | `l3-memory` | warning if the firmware must process, else note | the cube exceeds the memory of the chip |
//! | `uart-budget`, `no-points` | warning, or note if raw samples are sent | points exceed the rate of the serial port, or are not sent |
//! | `duty-cycle`, `idle-time`, `adc-start` | warning | unsuitable chirp timing |
//! | `range-resolution`, `range-ambiguity`, `velocity-resolution`, `velocity-ambiguity`, `single-loop`, `frame-rate`, `no-azimuth`, `no-elevation` | warning | insufficient for describing people |
//! | `model-frame-rate`, `model-velocity`, `model-velocity-resolution`, `model-range-resolution`, `model-array` | warning | different from all radars in the training data of the model |
//! | `dialect` | note | the dialect of the file, if it is not that of SDK 1 to 3 with simple frames |
//! | `board-guessed`, `model-radar` | note | an assumption, or a comparison that was not possible |

pub mod budgets;
pub mod model;
pub mod rules;

use std::fmt;

use radarllm_base::RadarConfig;
use radarllm_base::radar_config::RadarConfigError;

use crate::boards::Board;
use crate::point_radar::ChirpDialect;
use crate::radar_toml::{self, RadarTomlError};
use crate::span::{Places, Span};
use crate::ti_cfg::{BoardEvidence, GuiMonitor, TiCfg, TiCfgError, TiCfgReading};
pub use model::ModelExpectations;

/// Severity of a finding, worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The radar is impossible, or cannot do what its file requests.
    Error,
    /// The radar works, with poor results.
    Warning,
    /// Useful information.
    Note,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        })
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Field or group of [`RadarConfig`], or the command or key if the error is not in such a field.
    pub field: String,
    /// Stable name of the rule, kebab case.
    pub rule: &'static str,
    /// Severity.
    pub severity: Severity,
    /// What is wrong or weak, with numbers.
    pub message: String,
    /// Position in the file; `None` if no single value causes the finding.
    pub span: Option<Span>,
}

/// Input of the rules.
struct Subject<'a> {
    radar: &'a RadarConfig,
    /// The board, if known or guessed.
    board: Option<Board>,
    board_evidence: Option<BoardEvidence>,
    /// Whether raw samples are sent over LVDS; `None` if the description does not determine it.
    lvds_samples: Option<bool>,
    gui_monitor: Option<GuiMonitor>,
}

impl<'a> Subject<'a> {
    fn of(radar: &'a RadarConfig) -> Self {
        Self {
            radar,
            board: Board::ALL.into_iter().find(|b| b.name() == radar.name),
            board_evidence: None,
            lvds_samples: None,
            gui_monitor: None,
        }
    }

    /// Severity of exceeding a limit of the part. If the board is a guess, the guess may be wrong.
    fn part_severity(&self) -> Severity {
        let is_guess = self.board_evidence.as_ref();
        if is_guess.is_some_and(BoardEvidence::is_guess) || self.board.is_none() {
            Severity::Warning
        } else {
            Severity::Error
        }
    }
}

/// Findings so far, and the positions of the fields in the file.
#[derive(Default)]
struct Report {
    places: Places,
    findings: Vec<Finding>,
}

impl Report {
    /// Adds a finding on the value at `place`, which is a field of the radar or another position reported by the
    /// reader.
    fn add(
        &mut self,
        severity: Severity,
        rule: &'static str,
        place: &'static str,
        message: impl Into<String>,
    ) {
        self.findings.push(Finding {
            field: place.into(),
            rule,
            severity,
            message: message.into(),
            span: self.places.get(place).cloned(),
        });
    }

    /// Whether one of the rules has a finding.
    fn has(&self, rules: &[&str]) -> bool {
        self.findings.iter().any(|f| rules.contains(&f.rule))
    }

    fn impossible(&mut self, problem: RadarConfigError) {
        let rule = match problem.field {
            "adc_start_s" if problem.problem.contains("window") => "adc-window",
            "frame_period_s" if problem.problem.contains("chirps") => "frame-period",
            _ => "radar-value",
        };
        self.add(Severity::Error, rule, problem.field, problem.problem);
    }

    /// Applies the rules on the chirp to any radar with numbers, and the other rules only if there are no findings yet.
    fn inspect(&mut self, subject: &Subject, model: Option<&ModelExpectations>) {
        let possible = self.findings.is_empty();
        if let Some(evidence) = &subject.board_evidence {
            self.explain_board(evidence, &subject.radar.name);
        }
        rules::chirp(self, subject);
        if possible {
            rules::scene(self, subject.radar);
            budgets::memory(self, subject);
            budgets::lvds(self, subject);
            budgets::uart(self, subject, model);
            if let Some(model) = model {
                model::compare(self, subject.radar, model);
            }
        }
    }

    /// Says how the board was found, unless the file itself names it.
    fn explain_board(&mut self, evidence: &BoardEvidence, board: &str) {
        let message = match evidence {
            BoardEvidence::Stated | BoardEvidence::Geometry | BoardEvidence::Platform => return,
            BoardEvidence::FileName => {
                format!("the name of the file names the board, the file itself does not: {board}")
            }
            BoardEvidence::Family(name) => format!(
                "{name} stands for boards with different antennas (ISK, ODS, AOP), and there are no antGeometry lines: \
                 {board} is assumed"
            ),
            BoardEvidence::Guess => format!(
                "no `% Platform:` line of this band and no antGeometry lines: {board} is assumed"
            ),
        };
        self.add(Severity::Note, "board-guessed", "name", message);
    }

    /// Sorts findings by position in the file. Findings without a position are last, the most severe first.
    fn sorted(mut self) -> Vec<Finding> {
        self.findings.sort_by_key(|f| {
            let place = f.span.as_ref().map(|s| (s.line, s.columns.start));
            (place.is_none(), place, f.severity)
        });
        self.findings
    }
}

/// Findings about a radar meant for describing people; empty if there are none.
///
/// Limits of the part are known for radars whose name is that of a board ([`Board::name`]).
pub fn lint(radar: &RadarConfig, model: Option<&ModelExpectations>) -> Vec<Finding> {
    let mut report = Report::default();
    for problem in radar.problems() {
        report.impossible(problem);
    }
    report.inspect(&Subject::of(radar), model);
    report.sorted()
}

/// Findings about a chirp file of one of TI's SDKs, with positions and in the order of the file.
pub fn lint_ti_cfg(text: &str, model: Option<&ModelExpectations>) -> Vec<Finding> {
    lint_reading(TiCfg::read(text, None), text, model)
}

/// As [`lint_ti_cfg`], for a file whose name may name the board ([`TiCfg::read_named`]).
pub fn lint_ti_cfg_named(
    file_name: &str,
    text: &str,
    model: Option<&ModelExpectations>,
) -> Vec<Finding> {
    lint_reading(TiCfg::read_named(file_name, text), text, model)
}

fn lint_reading(
    reading: TiCfgReading,
    text: &str,
    model: Option<&ModelExpectations>,
) -> Vec<Finding> {
    let reason_severity = match (&reading.points, reading.lvds_samples) {
        (None, _) | (_, Some(true)) => Severity::Error,
        (Some(_), _) => Severity::Warning,
    };
    let mut report = Report {
        places: reading.places,
        findings: Vec::new(),
    };
    let has_reasons = !reading.errors.is_empty();
    let is_sound = reading.errors.iter().all(TiCfgError::is_unsupported);
    if reading.dialect != ChirpDialect::Sdk {
        let message = match &reading.points {
            Some(points) => format!(
                "a chirp file of the {}, {:.2} frames/s",
                reading.dialect,
                points.frame_rate_hz()
            ),
            None => format!("a chirp file of the {}", reading.dialect),
        };
        report.add(Severity::Note, "dialect", "frame_period_s", message);
    }
    for error in reading.errors {
        let severity = match error.is_unsupported() {
            true => reason_severity,
            false => Severity::Error,
        };
        match error {
            TiCfgError::Radar(problem) => report.impossible(problem),
            TiCfgError::Missing(command) => {
                let message = TiCfgError::Missing(command).to_string();
                report.add(Severity::Error, "missing-command", command, message);
            }
            TiCfgError::Line {
                rule,
                line,
                columns,
                text: quoted,
                problem,
            } => {
                let command = text.lines().nth(line - 1).unwrap_or("");
                let command = command.split_whitespace().next().unwrap_or("").to_owned();
                report.findings.push(Finding {
                    field: command.clone(),
                    rule,
                    severity,
                    message: format!("`{quoted}`: {problem}"),
                    span: Some(Span {
                        line,
                        columns,
                        what: command,
                    }),
                });
            }
        }
    }
    if let Some(radar) = &reading.draft {
        let subject = Subject {
            board_evidence: reading.board_evidence,
            lvds_samples: reading.lvds_samples,
            gui_monitor: reading.gui_monitor,
            ..Subject::of(radar)
        };
        report.inspect(&subject, model);
        if let Some(points) = reading.points.filter(|_| has_reasons && is_sound) {
            rules::points(&mut report, &points, rules::slow_part(radar));
        }
    } else if let Some(points) = reading.points.filter(|_| is_sound) {
        rules::points(&mut report, &points, "ramp_end_s");
        if let (Some(radar), Some(model)) = (&reading.equivalent, model) {
            model::compare(&mut report, radar, model);
        }
        if reading.board_evidence == Some(BoardEvidence::Guess) {
            let message = format!(
                "no antGeometryCfg of six virtual antennas: a simulation has those of the built-in {}",
                points.name
            );
            report.add(Severity::Note, "board-guessed", "name", message);
        }
    }
    report.sorted()
}

/// Findings about a radar in this project's format, with positions and in the order of the file.
pub fn lint_radar_toml(text: &str, model: Option<&ModelExpectations>) -> Vec<Finding> {
    let mut report = Report {
        places: radar_toml::places(text),
        findings: Vec::new(),
    };
    match radar_toml::draft(text) {
        Ok(radar) => {
            for problem in radar_toml::problems(&radar) {
                report.impossible(problem);
            }
            report.inspect(&Subject::of(&radar), model);
        }
        Err(error) => {
            let whole = error.to_string();
            match error {
                RadarTomlError::Missing(field) => {
                    report.add(Severity::Error, "missing-field", field, whole);
                }
                RadarTomlError::Base(_) | RadarTomlError::AmbiguousBase(..) => {
                    report.add(Severity::Error, "unknown-base", "base", whole);
                }
                RadarTomlError::Syntax(_) | RadarTomlError::Radar(_) => {
                    let (message, span) = radar_toml::syntax_error(text).unwrap_or((whole, None));
                    report.findings.push(Finding {
                        field: String::new(),
                        rule: "syntax",
                        severity: Severity::Error,
                        message,
                        span,
                    });
                }
            }
        }
    }
    report.sorted()
}
