//! Folders as recordings: selects the files that belong to a recording and its chirp file. Only names are used.

use std::collections::BTreeMap;

use crate::{
    detect::{DetectError, RecordingFormat, numbered},
    recordings::{visualizer_binary, visualizer_json},
};

/// The files of one recording of a TI visualizer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisualizerFolder {
    /// [`RecordingFormat::VisualizerJson`] or [`RecordingFormat::VisualizerBinary`].
    pub format: RecordingFormat,
    /// Subfolder that contains the files; empty for the given folder itself.
    pub folder: String,
    /// Number and name of each file, in the order of the numbers.
    pub files: Vec<(u64, String)>,
}

impl VisualizerFolder {
    pub(crate) fn reason(&self) -> String {
        let place = match self.folder.as_str() {
            "" => String::new(),
            folder => format!(" in {folder}"),
        };
        format!("{} files {}{place}", self.files.len(), pattern(self.format))
    }
}

fn pattern(format: RecordingFormat) -> &'static str {
    match format {
        RecordingFormat::VisualizerJson => "replay_N.json",
        _ => "pHistBytes_N.bin",
    }
}

/// Format and number of a piece, from its name without folders.
fn piece(name: &str) -> Option<(RecordingFormat, u64)> {
    let lower = name.to_lowercase();
    let number = |prefix: &str, extension: &str| {
        numbered(&lower, &prefix.to_lowercase()).filter(|_| lower.ends_with(extension))
    };
    number(visualizer_json::PREFIX, ".json")
        .map(|n| (RecordingFormat::VisualizerJson, n))
        .or_else(|| {
            let n = number(visualizer_binary::PREFIX, ".bin")?;
            Some((RecordingFormat::VisualizerBinary, n))
        })
}

/// Finds the recording of a TI visualizer from the names of the files in a folder and its subfolders, down to
/// `binData/<time>/`. Names are relative to the folder, with `/` between folder and file. `None` if there is no
/// recording. `format` selects between JSON and binary recordings in the same folder.
///
/// ```
/// use radarllm_formats::{RecordingFormat, visualizer_folder};
///
/// let names = ["profile.cfg", "binData/03_19_2025_16_53_08/replay_10.json", "binData/03_19_2025_16_53_08/replay_9.json"];
/// let found = visualizer_folder(&names, None)?.unwrap();
/// assert_eq!(found.format, RecordingFormat::VisualizerJson);
/// assert_eq!(found.folder, "binData/03_19_2025_16_53_08");
/// assert_eq!(found.files[0], (9, names[2].to_owned()));
/// # Ok::<(), radarllm_formats::DetectError>(())
/// ```
///
/// # Errors
/// [`DetectError::SeveralRecordings`] for files in several folders, [`DetectError::Ambiguous`] for both formats in one
/// folder, [`DetectError::Refused`] for `replay_N.json` beside other JSON files, which may or may not belong to the
/// recording.
pub fn visualizer_folder(
    names: &[&str],
    format: Option<RecordingFormat>,
) -> Result<Option<VisualizerFolder>, DetectError> {
    /// Maximum number of folder levels above a file: `binData` and the time.
    const MAX_DEPTH: usize = 2;
    /// Maximum number of names listed in an error.
    const MAX_LISTED: usize = 8;
    let mut groups: BTreeMap<(&str, RecordingFormat), Vec<(u64, String)>> = BTreeMap::new();
    let mut other_json: Vec<&str> = Vec::new();
    for name in names {
        let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
        if name.matches('/').count() > MAX_DEPTH || is_hidden(file) {
            continue;
        }
        match piece(file) {
            Some((kind, number)) if format.is_none_or(|f| f == kind) => {
                let files = groups.entry((folder, kind)).or_default();
                files.push((number, (*name).to_owned()));
            }
            None if file.to_lowercase().ends_with(".json") => other_json.push(name),
            _ => {}
        }
    }
    let folders: Vec<VisualizerFolder> = groups
        .into_iter()
        .map(|((folder, format), mut files)| {
            files.sort();
            VisualizerFolder {
                format,
                folder: folder.to_owned(),
                files,
            }
        })
        .collect();
    match folders.as_slice() {
        [] => Ok(None),
        [one] => {
            let folder_of = |name: &str| name.rsplit_once('/').map_or("", |(f, _)| f).to_owned();
            let beside: Vec<&str> = other_json
                .into_iter()
                .filter(|name| {
                    one.format == RecordingFormat::VisualizerJson && folder_of(name) == one.folder
                })
                .collect();
            if let Some(first) = beside.first() {
                return Err(DetectError::Refused(format!(
                    "{} beside {} other JSON files, such as {}: move those out of the folder, or name one file",
                    one.reason(),
                    beside.len(),
                    shown(first)
                )));
            }
            Ok(folders.into_iter().next())
        }
        [a, b] if a.folder == b.folder => Err(DetectError::Ambiguous {
            reason: format!("{} and {}", a.reason(), b.reason()),
            choices: vec![a.format, b.format],
        }),
        several => {
            let mut list: Vec<String> = several
                .iter()
                .take(MAX_LISTED)
                .map(|f| {
                    let folder = match f.folder.as_str() {
                        "" => ".",
                        folder => folder,
                    };
                    let n = f.files.len();
                    format!("{} ({n} files {})", shown(folder), pattern(f.format))
                })
                .collect();
            if several.len() > MAX_LISTED {
                list.push(format!("{} more", several.len() - MAX_LISTED));
            }
            Err(DetectError::SeveralRecordings(list))
        }
    }
}

/// A name for an error, shortened and without control characters.
fn shown(name: &str) -> String {
    let clean = |c: char| if c.is_control() { '?' } else { c };
    name.chars().take(80).map(clean).collect()
}

/// Whether a file was created by macOS or an editor.
fn is_hidden(file: &str) -> bool {
    file.starts_with('.') || file.starts_with('~')
}

/// Chirp file of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CfgChoice {
    /// A single chirp file.
    One {
        /// Its name.
        name: String,
        /// True if it is in the parent folder of the recording.
        is_in_parent: bool,
    },
    /// No chirp file in either folder.
    None,
    /// Several in one folder: the user has to choose.
    Several {
        /// Their names, sorted.
        names: Vec<String>,
        /// True if they are in the parent folder of the recording.
        is_in_parent: bool,
    },
}

/// Selects the chirp file (`.cfg`) of a recording: the only one in the recording's folder, or else the only one in the
/// parent folder. Both lists contain names without folders.
pub fn choose_cfg<'a>(
    names_in_folder: impl IntoIterator<Item = &'a str>,
    names_in_parent: impl IntoIterator<Item = &'a str>,
) -> CfgChoice {
    fn chirp_files<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
        let mut names: Vec<String> = names
            .into_iter()
            .filter(|name| name.to_lowercase().ends_with(".cfg") && !is_hidden(name))
            .map(str::to_owned)
            .collect();
        names.sort();
        names
    }
    let mut names = chirp_files(names_in_folder);
    let is_in_parent = names.is_empty();
    if is_in_parent {
        names = chirp_files(names_in_parent);
    }
    match names.len() {
        0 => CfgChoice::None,
        1 => CfgChoice::One {
            name: names.swap_remove(0),
            is_in_parent,
        },
        _ => CfgChoice::Several {
            names,
            is_in_parent,
        },
    }
}

/// What the parts of a raw capture have in common, and the number of a part, if a file has the name that mmWave Studio gives
/// one: `NAME_Raw_0.bin`.
pub fn raw_part(name: &str) -> Option<(&str, u64)> {
    const MARK: &str = "_raw_";
    let at = name.to_ascii_lowercase().rfind(MARK)?;
    let (common, rest) = name.split_at(at + MARK.len());
    let (number, extension) = rest.split_once('.')?;
    let is_part = extension.eq_ignore_ascii_case("bin") && !number.is_empty();
    is_part.then_some((common, number.parse().ok()?))
}

/// The files of a raw capture in a folder, in order: `adc_data.bin`, or the parts `NAME_Raw_0.bin`, `NAME_Raw_1.bin` and so on;
/// `None` if there are none.
///
/// # Errors
/// [`DetectError::SeveralRecordings`] if there are several captures.
pub fn raw_capture_folder(names: &[&str]) -> Result<Option<Vec<String>>, DetectError> {
    let mut captures: BTreeMap<&str, Vec<(u64, &str)>> = BTreeMap::new();
    for &name in names {
        if let Some((common, number)) = raw_part(name) {
            captures.entry(common).or_default().push((number, name));
        } else if name.eq_ignore_ascii_case("adc_data.bin") {
            captures.entry(name).or_default().push((0, name));
        }
    }
    let mut captures = captures.into_values();
    let (Some(mut parts), next) = (captures.next(), captures.next()) else {
        return Ok(None);
    };
    if let Some(other) = next {
        let firsts = [Some(parts), Some(other), captures.next()];
        let firsts = firsts
            .into_iter()
            .flatten()
            .filter_map(|parts| parts.into_iter().next());
        let firsts = firsts.map(|(_, name)| name.to_owned()).collect();
        return Err(DetectError::SeveralRecordings(firsts));
    }
    parts.sort_unstable();
    Ok(Some(
        parts.into_iter().map(|(_, name)| name.to_owned()).collect(),
    ))
}

/// The extension of a file of a ROS 2 bag, and its name without that and without the number that `ros2 bag` appends. The
/// recorder may have compressed the file as a whole.
fn bag_file(name: &str) -> Option<(&str, &str)> {
    let (mut stem, mut extension) = name.rsplit_once('.')?;
    if ["zstd", "zst"]
        .iter()
        .any(|e| extension.eq_ignore_ascii_case(e))
    {
        (stem, extension) = stem.rsplit_once('.')?;
    }
    if !["db3", "mcap"]
        .iter()
        .any(|e| extension.eq_ignore_ascii_case(e))
    {
        return None;
    }
    let without_number = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let stem = match without_number.strip_suffix('_') {
        Some(without) if without_number.len() < stem.len() => without,
        _ => stem,
    };
    Some((extension, stem))
}

/// Finds the files of a ROS 2 bag by the names of the files in a folder and its subfolders, with `/` between folder and file.
/// They lie in one folder and differ in their numbers alone, unless a `metadata.yaml` beside them says that they are one bag.
/// `None` if there is none.
///
/// ```
/// let names = ["walk/metadata.yaml", "walk/walk_0.mcap", "walk/walk_1.mcap"];
/// let files = radarllm_formats::folder::ros2_bag_folder(&names)?;
/// assert_eq!(files, Some(vec!["walk/walk_0.mcap".to_owned(), "walk/walk_1.mcap".to_owned()]));
/// # Ok::<(), radarllm_formats::DetectError>(())
/// ```
///
/// # Errors
/// [`DetectError::SeveralRecordings`] for files of several bags.
pub fn ros2_bag_folder(names: &[&str]) -> Result<Option<Vec<String>>, DetectError> {
    let folder_of = |name: &str| {
        name.rsplit_once('/')
            .map_or(String::new(), |(f, _)| f.into())
    };
    let mut bags: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for &name in names {
        if bag_file(name).is_some() {
            bags.entry(folder_of(name)).or_default().push(name);
        }
    }
    let mut bags: Vec<(String, Vec<&str>)> = bags.into_iter().collect();
    let Some((folder, mut files)) = bags.pop() else {
        return Ok(None);
    };
    files.sort_unstable();
    if !bags.is_empty() {
        let mut folders: Vec<String> = bags.into_iter().map(|(folder, _)| folder).collect();
        folders.push(folder);
        for folder in &mut folders {
            if folder.is_empty() {
                *folder = ".".into();
            }
        }
        return Err(DetectError::SeveralRecordings(folders));
    }
    let is_one = names
        .iter()
        .any(|n| folder_of(n) == folder && n.ends_with("metadata.yaml"));
    let first = files.first().copied().and_then(bag_file);
    if !is_one && files.iter().any(|name| bag_file(name) != first) {
        let files = files.into_iter().map(str::to_owned).collect();
        return Err(DetectError::SeveralRecordings(files));
    }
    Ok(Some(files.into_iter().map(str::to_owned).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(names: &[&str]) -> String {
        visualizer_folder(names, None).unwrap_err().to_string()
    }

    #[test]
    fn files_are_listed_by_number_wherever_they_lie() {
        for (names, folder, format) in [
            (
                &["replay_10.json", "REPLAY_9.JSON", "x.cfg", ".replay_1.json"][..],
                "",
                RecordingFormat::VisualizerJson,
            ),
            (
                &[
                    "binData/t/pHistBytes_10.bin",
                    "binData/t/pHistBytes_9.bin",
                    "notes.json",
                ],
                "binData/t",
                RecordingFormat::VisualizerBinary,
            ),
            (
                &["t/replay_10.json", "t/replay_9.json", "labels.json"],
                "t",
                RecordingFormat::VisualizerJson,
            ),
        ] {
            let found = visualizer_folder(names, None).unwrap().unwrap();
            assert_eq!((found.folder.as_str(), found.format), (folder, format));
            let numbers: Vec<u64> = found.files.iter().map(|f| f.0).collect();
            assert_eq!(numbers, [9, 10]);
            assert!(found.files.iter().all(|f| names.contains(&f.1.as_str())));
        }
        for names in [
            &[
                "replay.json",
                "replay_x.json",
                "replay_1.txt",
                "pHistBytes_1.npy",
            ][..],
            &["a/b/c/replay_1.json"],
            &["replay_99999999999999999999999.json"],
            &[],
        ] {
            assert_eq!(visualizer_folder(names, None), Ok(None), "{names:?}");
        }
    }

    #[test]
    fn several_recordings_are_named_with_the_way_to_choose() {
        let two = [
            "walk/replay_1.json",
            "walk/replay_2.json",
            "squat/replay_1.json",
        ];
        assert_eq!(
            error(&two),
            "several recordings: squat (1 files replay_N.json), walk (2 files replay_N.json); name one of them"
        );
        let nested = error(&["replay_1.json", "binData/t/replay_1.json"]);
        assert!(
            nested.contains(". (1 files") && nested.contains("binData/t (1 files"),
            "{nested}"
        );
        let names: Vec<String> = (0..50).map(|i| format!("t{i:02}/replay_1.json")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        assert!(
            error(&names).contains("t07 (1 files replay_N.json), 42 more"),
            "{}",
            error(&names)
        );

        let both = ["replay_1.json", "pHistBytes_1.bin", "pHistBytes_2.bin"];
        let text = error(&both);
        assert!(
            text.contains("1 files replay_N.json and 2 files pHistBytes_N.bin"),
            "{text}"
        );
        assert!(
            text.ends_with("visualizer-json, visualizer-binary"),
            "{text}"
        );
        let chosen = visualizer_folder(&both, Some(RecordingFormat::VisualizerBinary));
        assert_eq!(chosen.unwrap().unwrap().files.len(), 2);

        let text = error(&["replay_1.json", "package.json", "a\u{1b}.json"]);
        assert!(
            text.contains("beside 2 other JSON files, such as package.json"),
            "{text}"
        );
        assert!(!error(&["replay_1.json", "a\u{1b}.json"]).contains('\u{1b}'));
    }

    #[test]
    fn a_single_chirp_file_belongs_to_the_recording() {
        let one = |name: &str, is_in_parent| CfgChoice::One {
            name: name.into(),
            is_in_parent,
        };
        assert_eq!(
            choose_cfg(["a.cfg", "replay_1.json"], ["b.cfg"]),
            one("a.cfg", false)
        );
        assert_eq!(
            choose_cfg(["x.dat"], ["B.CFG", "._B.CFG"]),
            one("B.CFG", true)
        );
        assert_eq!(choose_cfg(["x.dat"], ["y"]), CfgChoice::None);
        assert_eq!(
            choose_cfg(["b.cfg", "a.cfg"], ["c.cfg"]),
            CfgChoice::Several {
                names: vec!["a.cfg".into(), "b.cfg".into()],
                is_in_parent: false
            }
        );
        assert_eq!(
            choose_cfg([], ["b.cfg", "a.cfg"]),
            CfgChoice::Several {
                names: vec!["a.cfg".into(), "b.cfg".into()],
                is_in_parent: true
            }
        );
    }

    #[test]
    fn the_parts_of_a_raw_capture_are_in_the_order_of_their_numbers() {
        assert_eq!(raw_part("adc_data_Raw_10.bin"), Some(("adc_data_Raw_", 10)));
        for name in [
            "adc_data.bin",
            "x_Raw_.bin",
            "x_Raw_1.csv",
            "x_Raw_LogFile.csv",
            "x_raw_1a.bin",
        ] {
            assert_eq!(raw_part(name), None, "{name}");
        }
        let of = |names: &[&str]| raw_capture_folder(names).unwrap();
        let names = ["a_Raw_10.bin", "a_Raw_2.bin", "a_LogFile.csv", "a.cfg"];
        assert_eq!(of(&names).unwrap(), ["a_Raw_2.bin", "a_Raw_10.bin"]);
        assert_eq!(
            of(&["ADC_Data.bin", "notes.txt"]).unwrap(),
            ["ADC_Data.bin"]
        );
        assert_eq!(of(&["notes.txt"]), None);
        let error = raw_capture_folder(&["a_Raw_0.bin", "b_Raw_0.bin"]).unwrap_err();
        assert!(
            error.to_string().contains("a_Raw_0.bin, b_Raw_0.bin"),
            "{error}"
        );
    }

    #[test]
    fn the_files_of_a_ros2_bag_differ_in_their_numbers() {
        let of = |names: &[&str]| ros2_bag_folder(names).map_err(|e| e.to_string());
        assert_eq!(of(&["a.cfg", "frame_1.npy"]), Ok(None));
        assert_eq!(
            of(&["a_0.db3", "a_1.db3", "a.txt"]).unwrap().unwrap().len(),
            2
        );
        assert_eq!(of(&["bag/only.mcap"]).unwrap().unwrap(), ["bag/only.mcap"]);
        assert_eq!(
            of(&["a_0.db3", "b_0.db3", "metadata.yaml"])
                .unwrap()
                .unwrap()
                .len(),
            2
        );
        for (names, expected) in [
            (
                ["a_0.db3", "b_0.db3"],
                "several recordings: a_0.db3, b_0.db3; name one of them",
            ),
            (
                ["a_0.db3", "a_0.mcap"],
                "several recordings: a_0.db3, a_0.mcap; name one of them",
            ),
            (
                ["x/a_0.db3", "y/a_1.db3"],
                "several recordings: x, y; name one of them",
            ),
            (
                ["a_0.db3", "y/a_1.db3"],
                "several recordings: ., y; name one of them",
            ),
        ] {
            assert_eq!(of(&names), Err(expected.into()));
        }
    }
}
