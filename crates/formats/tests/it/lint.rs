//! Every rule of lint fires once, at the value that is to blame, and a good file is clean.

use radarllm_base::RadarConfig;
use radarllm_formats::{Finding, ModelExpectations, Severity, lint, lint_radar_toml, lint_ti_cfg};

use crate::made::CLEAN_CFG as CLEAN;

fn model() -> ModelExpectations {
    ModelExpectations {
        model: "the model".into(),
        frame_rate_hz: 10.0,
        max_points: 128,
        radars: vec![RadarConfig::awr1843boost()],
    }
}

fn changed(changes: &[(&str, &str)]) -> String {
    let mut text = CLEAN.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    text
}

/// Rule, severity, line, column and length of everything that is said.
type Row = (&'static str, Severity, usize, usize, usize);
/// Texts to replace in [`CLEAN`].
type Changes = &'static [(&'static str, &'static str)];

fn rows(findings: &[Finding]) -> Vec<Row> {
    findings
        .iter()
        .map(|f| {
            let (line, column, length) = f
                .span
                .as_ref()
                .map_or((0, 0, 0), |s| (s.line, s.columns.start, s.columns.len()));
            (f.rule, f.severity, line, column, length)
        })
        .collect()
}

use Severity::{Error, Note, Warning};

#[test]
fn a_good_file_is_clean() {
    assert_eq!(lint_ti_cfg(CLEAN, None), []);
    // Its velocity bins are four times those of the training: nothing else differs.
    let with_model = lint_ti_cfg(CLEAN, Some(&model()));
    let expected = [("model-velocity-resolution", Warning, 10, 14, 2)];
    assert_eq!(rows(&with_model), expected, "{with_model:?}");
}

#[test]
fn every_rule_on_a_file_points_at_the_value_to_blame() {
    let cases: &[(Changes, &[Row])] = &[
        // What makes it no radar.
        (&[("7 7 58", "7 six 58")], &[("syntax", Error, 6, 19, 3)]),
        (
            &[("frameCfg 0 2", "%frameCfg 0 2")],
            &[("missing-command", Error, 0, 0, 0)],
        ),
        (
            // Points can be read. A file that enables raw samples asks for more.
            &[("adcCfg 2 1", "adcCfg 2 0")],
            &[("unsupported", Warning, 4, 10, 1)],
        ),
        (
            &[("adcCfg 2 1", "adcCfg 2 0"), ("-1 0 0 0", "-1 0 1 0")],
            &[("unsupported", Error, 4, 10, 1)],
        ),
        (
            &[("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 0")],
            &[("tx-mask", Error, 8, 24, 1)],
        ),
        (
            &[("frameCfg 0 2", "frameCfg 0 5")],
            &[("undefined-chirp", Error, 10, 12, 1)],
        ),
        (
            &[("0 0 0 0 0 0 0 1", "0 0 3 0 0 0 0 1")],
            // A chirp that differs is named as well: it is the first that is taken for right.
            &[
                ("undefined-profile", Error, 7, 14, 1),
                ("unsupported", Warning, 8, 24, 1),
                ("unsupported", Warning, 9, 24, 1),
            ],
        ),
        (
            &[("sensorStart", "antGeometry0 0 0\nantGeometry1 0 0")],
            &[("antenna-geometry", Error, 13, 1, 12)],
        ),
        (&[("7 7 58", "7 7 50")], &[("adc-window", Error, 6, 19, 1)]),
        (
            &[(" 100 1 0", " 5 1 0")],
            &[("frame-period", Error, 10, 19, 1)],
        ),
        (&[(" 5500 ", " 0 ")], &[("radar-value", Error, 6, 37, 1)]),
        // The chirp.
        (&[("0 77 7", "0 78 7")], &[("band", Error, 6, 28, 2)]),
        (&[("0 77 7", "0 75.5 7")], &[("band", Error, 6, 14, 4)]),
        (&[("7 7 58", "7 2 58")], &[("adc-start", Warning, 6, 19, 1)]),
        (
            &[("0 77 7 7", "0 77 5 7")],
            &[("idle-time", Warning, 6, 17, 1)],
        ),
        (
            &[(" 256 5500 ", " 350 14000 ")],
            &[("adc-rate", Error, 6, 37, 5)],
        ),
        // The scene.
        (
            &[(" 100 1 0", " 10 1 0"), (" -1 1 0", " -1 2 0")],
            &[
                ("duty-cycle", Warning, 10, 19, 2),
                ("uart-budget", Warning, 10, 19, 2),
                ("lvds-budget", Note, 10, 19, 2),
            ],
        ),
        (
            &[(" 256 5500", " 100 5500")],
            &[("range-resolution", Warning, 6, 33, 3)],
        ),
        (
            &[(" 256 5500", " 50 1080")],
            &[("range-ambiguity", Warning, 6, 36, 4)],
        ),
        (
            &[("0 77 7 7", "0 77 70 7")],
            &[("velocity-ambiguity", Warning, 6, 17, 2)],
        ),
        (
            &[("frameCfg 0 2 40", "frameCfg 0 2 16")],
            &[("velocity-resolution", Warning, 10, 14, 2)],
        ),
        (
            &[("frameCfg 0 2 40", "frameCfg 0 2 1")],
            &[("single-loop", Warning, 10, 14, 1)],
        ),
        (
            &[(" 100 1 0", " 250 1 0")],
            &[("frame-rate", Warning, 10, 19, 3)],
        ),
        (
            &[
                ("channelCfg 15", "channelCfg 1"),
                ("frameCfg 0 2 40", "frameCfg 0 0 120"),
            ],
            &[
                ("no-azimuth", Warning, 3, 12, 1),
                ("no-elevation", Warning, 10, 12, 1),
            ],
        ),
        // Budgets.
        (
            &[("frameCfg 0 2 40", "frameCfg 0 2 128")],
            &[("l3-memory", Warning, 10, 14, 3)],
        ),
        (
            &[
                ("-1 0 0 0", "-1 0 1 0"),
                ("frameCfg 0 2 40", "frameCfg 0 2 128"),
            ],
            &[("l3-memory", Note, 10, 14, 3)],
        ),
        (
            // 256 samples of four receivers in 27 us: 1,214 Mbit/s.
            &[
                ("0 77 7 7 58 0 0 67", "0 77 3.5 3 23.5 0 0 80"),
                (" 5500 ", " 12500 "),
                ("frameCfg 0 2 40", "frameCfg 0 2 80"),
                ("-1 0 0 0", "-1 0 1 0"),
            ],
            &[("lvds-budget", Error, 6, 37, 3)],
        ),
        (
            // 240 chirps of 32,768 bits in 11 ms: 715 Mbit/s.
            &[
                ("0 77 7 7 58 0 0 67", "0 77 6 3 23.5 0 0 80"),
                (" 5500 ", " 12500 "),
                ("frameCfg 0 2 40 0 100", "frameCfg 0 2 80 0 11"),
                ("-1 0 0 0", "-1 0 1 0"),
            ],
            &[
                ("lvds-budget", Error, 10, 19, 2),
                ("duty-cycle", Warning, 10, 19, 2),
                ("uart-budget", Note, 10, 19, 2),
            ],
        ),
        (
            // The same in 20 ms: 393 Mbit/s.
            &[
                ("0 77 7 7 58 0 0 67", "0 77 6 3 23.5 0 0 80"),
                (" 5500 ", " 12500 "),
                ("frameCfg 0 2 40 0 100", "frameCfg 0 2 80 0 20"),
                ("-1 0 0 0", "-1 0 1 0"),
            ],
            &[
                ("lvds-budget", Warning, 10, 19, 2),
                ("uart-budget", Note, 10, 19, 2),
            ],
        ),
        (
            &[
                ("-1 1 0 0 0 0 0", "-1 1 0 0 0 1 0"),
                (" 100 1 0", " 50 1 0"),
            ],
            &[("uart-budget", Warning, 11, 23, 1)],
        ),
        (
            &[("-1 1 0 0 0 0 0", "-1 0 0 0 0 0 0")],
            &[("no-points", Warning, 11, 15, 1)],
        ),
        (
            &[("% Platform:xWR18xx", "")],
            &[("board-guessed", Note, 0, 0, 0)],
        ),
    ];
    for (changes, expected) in cases {
        let findings = lint_ti_cfg(&changed(changes), None);
        assert_eq!(rows(&findings), *expected, "{changes:?}: {findings:#?}");
    }
}

#[test]
fn all_mistakes_of_a_file_are_told_at_once() {
    let text = changed(&[
        ("7 7 58", "7 7 50"),
        (" 100 1 0", " 5 1 0"),
        ("0 77 7", "0 80 7"),
    ]);
    let expected = [
        ("adc-window", Error, 6, 19, 1),
        ("band", Error, 6, 28, 2),
        ("frame-period", Error, 10, 19, 1),
    ];
    assert_eq!(rows(&lint_ti_cfg(&text, None)), expected);
    // One unreadable line does not hide the next, nor count twice as a missing command.
    let text = changed(&[
        ("profileCfg 0 77", "profileCfg 0 x"),
        ("0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 y"),
        ("2 2 0 0 0 0 0 2", "2 2 0 0 0 0 0 6"),
    ]);
    let expected = [
        ("syntax", Error, 6, 14, 1),
        ("syntax", Error, 7, 24, 1),
        ("tx-mask", Error, 9, 24, 1),
    ];
    assert_eq!(rows(&lint_ti_cfg(&text, None)), expected);
}

#[test]
fn limits_of_a_guessed_board_are_no_errors() {
    let text = changed(&[
        ("% Platform:xWR18xx", ""),
        ("0 77 7", "0 78 7"),
        ("1 256 5500", "1 350 14000"),
    ]);
    let expected = [
        ("band", Warning, 6, 28, 2),
        ("adc-rate", Warning, 6, 37, 5),
        ("board-guessed", Note, 0, 0, 0),
    ];
    let findings = lint_ti_cfg(&text, None);
    let found: Vec<Row> = rows(&findings).into_iter().take(3).collect();
    assert_eq!(found, expected, "{findings:#?}");
}

#[test]
fn spans_name_the_command_and_value() {
    let findings = lint_ti_cfg(&changed(&[("0 77 7 7", "0 77 70 7")]), None);
    let span = findings[0].span.as_ref().unwrap();
    assert_eq!(span.what, "profileCfg idle time, us");
    assert!(findings[0].message.contains("2.47 m/s"), "{findings:?}");
}

#[test]
fn models_are_told_what_they_have_not_seen() {
    let cases: &[(Changes, Row)] = &[
        (
            &[(" 100 1 0", " 55 1 0")],
            ("model-frame-rate", Note, 10, 19, 2),
        ),
        (
            &[(" 100 1 0", " 300 1 0")],
            ("model-frame-rate", Warning, 10, 19, 3),
        ),
        (
            &[("0 77 7 7", "0 77 40 7")],
            ("model-velocity", Warning, 6, 22, 2),
        ),
        (
            &[("256 5500", "130 5500")],
            ("model-range-resolution", Warning, 6, 28, 2),
        ),
        (
            &[("frameCfg 0 2 40", "frameCfg 0 1 64")],
            ("model-array", Warning, 10, 12, 1),
        ),
        (
            &[("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 1")],
            ("model-array", Warning, 10, 12, 1),
        ),
    ];
    for (changes, expected) in cases {
        let text = changed(changes);
        let found = lint_ti_cfg(&text, Some(&model()));
        assert!(rows(&found).contains(expected), "{changes:?}: {found:#?}");
        // Without a model, nothing is compared.
        let alone = lint_ti_cfg(&text, None);
        assert!(alone.iter().all(|f| !f.rule.starts_with("model")));
    }
    let unknown = ModelExpectations {
        radars: Vec::new(),
        ..model()
    };
    let findings = lint_ti_cfg(CLEAN, Some(&unknown));
    assert_eq!(rows(&findings), [("model-radar", Note, 0, 0, 0)]);
    // Of several radars the one most like it counts.
    let mut other = RadarConfig::awr1843boost();
    other.n_samples = 1024;
    other.n_loops = 512;
    let two = ModelExpectations {
        radars: vec![other.clone(), RadarConfig::awr1843boost()],
        ..model()
    };
    let like_own = rows(&lint_ti_cfg(CLEAN, Some(&model())));
    assert_eq!(rows(&lint_ti_cfg(CLEAN, Some(&two))), like_own);
    let one = ModelExpectations {
        radars: vec![other],
        ..model()
    };
    assert!(lint_ti_cfg(CLEAN, Some(&one)).len() > like_own.len());
    // A model that reads 400 points would need 8 kB more than the serial port has.
    let greedy = ModelExpectations {
        max_points: 500,
        ..unknown
    };
    let rules: Vec<_> = lint_ti_cfg(CLEAN, Some(&greedy))
        .iter()
        .map(|f| f.rule)
        .collect();
    assert_eq!(rules, ["uart-budget", "model-radar"]);
}

#[test]
fn our_own_format_is_pointed_into_too() {
    let toml = |lines: &str| {
        let text = format!("base = \"awr1843boost\"\nname = \"mine\"\n{lines}\n");
        rows(&lint_radar_toml(&text, None))
    };
    assert_eq!(toml(""), []);
    assert_eq!(
        toml("idle_s = 1e-4"),
        [("velocity-ambiguity", Warning, 3, 10, 4)]
    );
    assert_eq!(
        toml("# \u{b5}s\nadc_start_s = 1e-5\nframe_period_s = 0.01"),
        [
            ("adc-window", Error, 4, 15, 4),
            ("frame-period", Error, 5, 18, 4)
        ]
    );
    assert_eq!(toml("loops = 3"), [("syntax", Error, 3, 1, 5)]);
    assert_eq!(toml("n_loops = -1"), [("syntax", Error, 3, 11, 2)]);
    assert_eq!(toml("n_loops = "), [("syntax", Error, 3, 11, 1)]);
    assert_eq!(
        toml("tx = [{ x_m = 99.0, z_m = 0.0 }]").first(),
        Some(&("radar-value", Error, 3, 6, 27))
    );
    assert_eq!(
        rows(&lint_radar_toml("base = \"none\"", None)),
        [("unknown-base", Error, 1, 8, 6)]
    );
    assert_eq!(
        rows(&lint_radar_toml("name = \"x\"", None)),
        [("missing-field", Error, 0, 0, 0)]
    );
}

fn fields(radar: RadarConfig) -> Vec<(&'static str, String)> {
    lint(&radar, None)
        .into_iter()
        .map(|f| (f.rule, f.field))
        .collect()
}

#[test]
fn the_reference_radar_only_works_raw_and_each_weakness_is_named() {
    let good = RadarConfig::awr1843boost;
    // 256 bins x 128 loops x 12 channels x 4 bytes and 64 KiB of map, 1600 of 1024 KiB: recordings of
    // it are raw.
    let findings = lint(&good(), Some(&model()));
    assert_eq!(rows(&findings), [("l3-memory", Note, 0, 0, 0)]);
    assert!(findings[0].message.contains("1600 KiB"), "{findings:?}");
    let anonymous = || RadarConfig {
        name: "mine".into(),
        ..good()
    };
    assert_eq!(fields(anonymous()), []);
    let cases = [
        (
            RadarConfig {
                frame_period_s: 0.03,
                ..anonymous()
            },
            ("duty-cycle", "frame_period_s"),
        ),
        (
            RadarConfig {
                start_hz: 77.5e9,
                ..anonymous()
            },
            ("band", "slope_hz_per_s"),
        ),
        (
            RadarConfig {
                n_samples: 60,
                ..anonymous()
            },
            ("range-resolution", "n_samples"),
        ),
        (
            RadarConfig {
                n_samples: 0,
                ..anonymous()
            },
            ("radar-value", "n_samples"),
        ),
        (
            RadarConfig {
                slope_hz_per_s: f64::NAN,
                ..anonymous()
            },
            ("radar-value", "slope_hz_per_s"),
        ),
    ];
    for (radar, (rule, field)) in cases {
        assert_eq!(fields(radar), [(rule, field.to_owned())]);
    }
    let mut flat = anonymous();
    flat.tx.truncate(2);
    assert_eq!(fields(flat), [("no-elevation", "tx".to_owned())]);
}

#[test]
fn files_that_people_use_have_no_errors() {
    let Some(shared) = crate::ti_files::shared() else {
        println!("skipped: no shared data");
        return;
    };
    let mut n_files = 0;
    for folder in ["data/ti-mmwave-toolbox/cfg", "data/cfg-other"] {
        for entry in std::fs::read_dir(shared.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let text = std::fs::read_to_string(&path).unwrap();
            for finding in lint_ti_cfg(&text, Some(&model())) {
                assert_ne!(finding.severity, Error, "{}: {finding:?}", path.display());
            }
            n_files += 1;
        }
    }
    assert!(n_files > 0);
}

/// Random damage: no panic, and every span lies in the text.
#[test]
fn damaged_files_are_reported_with_places_that_exist() {
    let toml = radarllm_formats::radar_to_toml(&RadarConfig::awr1843boost()).unwrap();
    let pieces: [&[u8]; 12] = [
        b" ",
        b"-",
        b"9",
        b"e99",
        b"\n",
        b"%",
        b"\xc2\xb5",
        b"\xff",
        b"\t",
        b"=",
        b"[",
        b"nan",
    ];
    let mut n_errors = 0;
    for round in 0..4000 {
        let draw = |name: &str, below: usize| {
            (radarllm_base::seed::derive_seed(round, name) % below as u64) as usize
        };
        let source = if round % 4 == 3 { toml.as_str() } else { CLEAN };
        let mut bytes = source.as_bytes().to_vec();
        for i in 0..=draw("changes", 4) {
            let at = draw(&format!("at {i}"), bytes.len());
            let end = (at + draw(&format!("cut {i}"), 6)).min(bytes.len());
            let piece = pieces[draw(&format!("piece {i}"), pieces.len())];
            bytes.splice(at..end, piece.iter().copied());
        }
        let text = String::from_utf8_lossy(&bytes);
        let findings = if round % 4 == 3 {
            lint_radar_toml(&text, Some(&model()))
        } else {
            lint_ti_cfg(&text, Some(&model()))
        };
        n_errors += usize::from(findings.iter().any(|f| f.severity == Error));
        for finding in &findings {
            let Some(span) = &finding.span else { continue };
            let line = text.split('\n').nth(span.line - 1).unwrap_or_default();
            let width = line.chars().count();
            assert!(
                span.columns.start >= 1 && span.columns.end <= width + 2,
                "{finding:?} in {line:?}"
            );
            assert!(span.columns.start < span.columns.end, "{finding:?}");
        }
    }
    assert!((1000..4000).contains(&n_errors), "{n_errors}");
}
