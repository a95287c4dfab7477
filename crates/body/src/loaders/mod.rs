//! Motion file loaders: BVH, ASF with AMC, AMASS npz, HumanML3D npy, tables of Kinect joints.
//!
//! Every loader returns the motion on the 22 joints of SMPL-X in the world frame (z up, floor at z
//! = 0), reports the unit and the height, and lists the content that it did not use.

mod amass;
mod asf;
mod bvh;
mod humanml3d;
pub mod kinect;
pub(crate) mod names;
pub(crate) mod source;
mod text;

use crate::error::{MotionError, excerpt};
use crate::proportions::standing_height_m;
use crate::retarget::retarget;
use radarllm_base::Motion;
use radarllm_files::bounded;
use radarllm_files::npy::{NPY_MAGIC, NpyArray, Npz, NpzError, Skipped};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Maximum file size, bytes. The longest clip of the CMU database takes 60 MB as BVH.
pub const MAX_FILE_BYTES: u64 = 512 << 20;

/// A motion with metadata of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMotion {
    /// The motion on 22 joints, world z up, floor at z = 0. Position and heading are those of the
    /// file; see [`crate::sample::canonicalize`].
    pub motion: Motion,
    /// `bvh`, `asf-amc`, `amass-npz`, `humanml3d-npy` or `kinect-csv`.
    pub format: &'static str,
    /// Number of poses in the motion.
    pub frames: usize,
    /// Poses per second.
    pub fps: f64,
    /// Number of joints in the skeleton of the file.
    pub n_source_joints: usize,
    /// Length unit of the file.
    pub unit: String,
    /// Metres per file unit.
    pub metres_per_unit: f64,
    /// Standing height of the person estimated from the bones, including soles and crown, m.
    pub height_m: f32,
    /// Channels, joints, end sites and members that were not used.
    pub skipped: Vec<String>,
    /// Assumptions made and values filled in.
    pub warnings: Vec<String>,
}

impl LoadedMotion {
    fn new(
        motion: Motion,
        format: &'static str,
        n_source_joints: usize,
        (unit, metres_per_unit): (String, f64),
        skipped: Vec<String>,
        warnings: Vec<String>,
    ) -> Self {
        let height_m = standing_height_m(&motion.skeleton);
        let (frames, fps) = (motion.len(), motion.fps);
        Self {
            motion,
            format,
            frames,
            fps,
            n_source_joints,
            unit,
            metres_per_unit,
            height_m,
            skipped,
            warnings,
        }
    }
}

/// A named array of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberArray {
    /// Member name in the archive; empty for an npy file.
    pub name: String,
    /// Length of every dimension.
    pub shape: Vec<usize>,
    /// Values in C order; their number matches the shape.
    pub values: Vec<f64>,
}

/// Reads numeric arrays: from an npz archive those of `wanted` that exist, from an npy file its
/// only array.
///
/// # Errors
/// [`MotionError`], never a panic, for any content: unreadable, too large, damaged, pickled or not
/// numeric.
pub fn load_arrays(path: &Path, wanted: &[&str]) -> Result<Vec<NumberArray>, MotionError> {
    let file = path.display().to_string();
    let bytes = read_capped(path)?;
    let problem = |member: &str, expected: String, found: String| MotionError::Member {
        file: file.clone(),
        member: member.into(),
        expected,
        found,
    };
    let arrays = if bytes.starts_with(NPY_MAGIC) {
        vec![(String::new(), read_array(&file, bytes)?)]
    } else {
        read_archive(&file, &bytes, wanted)?.0
    };
    arrays
        .into_iter()
        .map(|(name, array)| {
            let values = array.numbers().ok_or_else(|| {
                problem(&name, "an array of numbers".into(), array.header.descr())
            })?;
            Ok(NumberArray {
                name,
                shape: array.shape(),
                values,
            })
        })
        .collect()
}

/// Reads a motion file from disk. For an AMC file, the ASF skeleton is searched for beside it.
///
/// # Errors
/// [`MotionError`], never a panic, for any content.
pub fn load_motion_file(path: &Path) -> Result<LoadedMotion, MotionError> {
    load_motion(path, &read_capped(path)?)
}

/// Reads a motion from `bytes`. `path` names the file in messages, and its extension distinguishes
/// AMC from ASF. A second file is opened for AMC only: the ASF of the same subject (for
/// `01_02.amc`: `01_02.asf` or `01.asf`), else the only ASF of the folder, else that whose name
/// begins like the AMC's.
///
/// # Errors
/// [`MotionError`], never a panic, for any content.
pub fn load_motion(path: &Path, bytes: &[u8]) -> Result<LoadedMotion, MotionError> {
    let file = path.display().to_string();
    check_size(&file, bytes.len() as u64, MAX_FILE_BYTES)?;
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let text = bytes
        .strip_prefix(b"\xef\xbb\xbf")
        .unwrap_or(bytes)
        .trim_ascii_start();
    let starts = |word: &[u8]| {
        text.get(..word.len())
            .is_some_and(|head| head.eq_ignore_ascii_case(word))
    };
    let unknown = |reason: String| {
        Err(MotionError::UnknownFormat {
            file: file.clone(),
            reason,
        })
    };
    if bytes.starts_with(NPY_MAGIC) {
        return humanml3d::load_humanml3d(&file, bytes);
    }
    if bytes.starts_with(b"PK\x03\x04") {
        return amass::load_amass(&file, bytes);
    }
    if starts(kinect::FIRST_COLUMN) {
        return kinect::load_kinect(&file, text);
    }
    if starts(b"HIERARCHY") || extension == "bvh" {
        let (mut source, mut skipped, mut warnings) = bvh::parse_bvh(&file, bytes)?;
        warnings.extend(bvh::restore_thorax(&mut source));
        let result = retarget(&file, &source, None)?;
        skipped.extend(result.skipped);
        warnings.extend(result.warnings);
        let unit = (result.unit, result.metres_per_unit);
        return Ok(LoadedMotion::new(
            result.motion,
            "bvh",
            source.joints.len(),
            unit,
            skipped,
            warnings,
        ));
    }
    if extension == "amc" {
        let (asf_path, asf_bytes) = find_asf(path)?;
        return load_named_asf_amc(&asf_path.display().to_string(), &asf_bytes, &file, bytes);
    }
    if extension == "asf" || starts(b":version") {
        return unknown("an ASF file holds a skeleton without motion: give the AMC file".into());
    }
    if let Some(reason) = other_format(bytes, &extension) {
        return unknown(reason.into());
    }
    if bytes.len() >= 2 && bytes[0] == 0x80 && bytes[1] <= 5 {
        return unknown("a Python pickle, which is never executed: save the arrays as npz".into());
    }
    unknown(format!(
        "it starts with {}",
        excerpt(&String::from_utf8_lossy(&bytes[..bytes.len().min(60)]))
    ))
}

/// What a file in a format that is not read has to be converted to; `None` for an unknown one.
///
/// C3D files hold the places of markers on the skin. Which joint moves how follows from the marker set and the measures of
/// the person, which the program of the cameras knows; a reader of the markers alone would not give a motion.
fn other_format(bytes: &[u8], extension: &str) -> Option<&'static str> {
    // The first byte of a C3D file is the number of the block with its parameters, the second one its mark.
    let is_c3d = matches!(bytes, [1..=31, 0x50, ..]) || extension == "c3d";
    let known = [
        (
            is_c3d,
            "a C3D file, which holds the places of markers and no skeleton: solve a skeleton in the program that recorded \
             them (Nexus, Motive, Qualisys Track Manager) or with SOMA and MoSh++, and save it as BVH, ASF with AMC, or AMASS npz",
        ),
        (
            bytes.starts_with(b"Kaydara FBX Binary") || extension == "fbx",
            "an FBX file: import it into Blender and export the skeleton as BVH",
        ),
        (
            bytes.starts_with(b"glTF") || ["gltf", "glb", "vrm"].contains(&extension),
            "a glTF or VRM file: import it into Blender and export the skeleton as BVH",
        ),
        (
            bytes.starts_with(b"Vocaloid Motion Data"),
            "a VMD file, which holds no skeleton: import it with its model into Blender and export the skeleton as BVH",
        ),
    ];
    known
        .into_iter()
        .find(|(is_it, _)| *is_it)
        .map(|(_, reason)| reason)
}

/// Reads an ASF skeleton and an AMC motion of this skeleton.
///
/// # Errors
/// [`MotionError`], never a panic, for any content.
pub fn load_asf_amc(asf: &[u8], amc: &[u8]) -> Result<LoadedMotion, MotionError> {
    load_named_asf_amc("skeleton.asf", asf, "motion.amc", amc)
}

fn load_named_asf_amc(
    asf_file: &str,
    asf: &[u8],
    amc_file: &str,
    amc: &[u8],
) -> Result<LoadedMotion, MotionError> {
    // A skeleton takes 10 kB; its text is stored as words, which use more memory than their bytes.
    check_size(asf_file, asf.len() as u64, MAX_FILE_BYTES / 32)?;
    check_size(amc_file, amc.len() as u64, MAX_FILE_BYTES)?;
    let skeleton = asf::parse_asf(asf_file, asf)?;
    let unit = (
        skeleton.metres_per_unit,
        format!(
            "1/{} inch ({:.4} cm)",
            skeleton.length_factor,
            skeleton.metres_per_unit * 100.0
        ),
    );
    let (source, mut skipped, mut warnings) = asf::parse_amc(amc_file, amc, skeleton)?;
    let result = retarget(amc_file, &source, Some(unit))?;
    skipped.extend(result.skipped);
    warnings.extend(result.warnings);
    let unit = (result.unit, result.metres_per_unit);
    Ok(LoadedMotion::new(
        result.motion,
        "asf-amc",
        source.joints.len(),
        unit,
        skipped,
        warnings,
    ))
}

/// Most files of a folder that are looked at for a skeleton.
const MAX_FOLDER_FILES: usize = 10_000;

/// Finds the skeleton beside an AMC file: the same name, or otherwise the part before the first
/// `_`, or otherwise the only skeleton of the folder or the one with the longest common prefix.
fn find_asf(amc: &Path) -> Result<(PathBuf, Vec<u8>), MotionError> {
    let stem = amc
        .file_stem()
        .map(|s| s.to_string_lossy().into_owned())
        .unwrap_or_default();
    let subject = stem.split('_').next().unwrap_or(&stem);
    let mut tried = Vec::new();
    for name in [&stem, subject] {
        for extension in ["asf", "ASF"] {
            let candidate = amc.with_file_name(format!("{name}.{extension}"));
            if candidate.is_file() {
                let bytes = read_capped(&candidate)?;
                return Ok((candidate, bytes));
            }
            tried.push(format!("{name}.{extension}"));
        }
    }
    tried.dedup();
    let all = skeletons_beside(amc);
    if let Some(candidate) = most_alike(&all, &stem) {
        let bytes = read_capped(candidate)?;
        return Ok((candidate.clone(), bytes));
    }
    if !all.is_empty() {
        tried.push(format!("one of the {} others", all.len()));
    }
    Err(MotionError::MissingSkeleton {
        file: amc.display().to_string(),
        looked_for: tried.join(", "),
    })
}

/// All ASF files in the folder of a file, by name.
fn skeletons_beside(amc: &Path) -> Vec<PathBuf> {
    let folder = match amc.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let paths = entries.take(MAX_FOLDER_FILES).flatten().map(|e| e.path());
    let is_asf = |path: &PathBuf| {
        let extension = path.extension();
        extension.is_some_and(|e| e.eq_ignore_ascii_case("asf")) && path.is_file()
    };
    let mut found: Vec<PathBuf> = paths.filter(is_asf).collect();
    found.sort();
    found
}

/// The only skeleton, or the one whose name has the longest common prefix with `stem`.
fn most_alike<'a>(skeletons: &'a [PathBuf], stem: &str) -> Option<&'a PathBuf> {
    if let [only] = skeletons {
        return Some(only);
    }
    let common = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let pairs = name.chars().zip(stem.chars());
        pairs.take_while(|(a, b)| a == b).count()
    };
    let longest = skeletons.iter().map(common).max().filter(|n| *n > 0)?;
    let mut alike = skeletons.iter().filter(|path| common(path) == longest);
    match (alike.next(), alike.next()) {
        (Some(one), None) => Some(one),
        _ => None,
    }
}

/// The array of an npy file.
fn read_array<'a>(
    file: &str,
    bytes: impl Into<Cow<'a, [u8]>>,
) -> Result<NpyArray<'a>, MotionError> {
    NpyArray::of_any_type(bytes).map_err(|e| MotionError::Member {
        file: file.into(),
        member: format!("array, byte {}", e.byte),
        expected: e.expected,
        found: e.found,
    })
}

/// Arrays with their names.
type NamedArrays = Vec<(String, NpyArray<'static>)>;

/// Arrays of an npz archive by name, and the skipped members with the reasons.
fn read_archive(
    file: &str,
    bytes: &[u8],
    wanted: &[&str],
) -> Result<(NamedArrays, Vec<String>), MotionError> {
    let npz = Npz::read(std::io::Cursor::new(bytes), wanted).map_err(|e| {
        let (member, expected, found) = match e {
            NpzError::Archive { expected, found } => ("archive".into(), expected, found),
            NpzError::Member { member, source } => (
                format!("{member}, byte {}", source.byte),
                source.expected,
                source.found,
            ),
        };
        MotionError::Member {
            file: file.into(),
            member,
            expected,
            found,
        }
    })?;
    let skipped = npz.skipped.into_iter().map(|member| match member {
        Skipped::Pickled(name) => format!("{name} (pickled objects, never read)"),
        Skipped::NotNeeded(name) => format!("{name} (not needed)"),
        Skipped::NotAnArray(name) => format!("{name} (not an array)"),
    });
    Ok((npz.arrays, skipped.collect()))
}

fn read_capped(path: &Path) -> Result<Vec<u8>, MotionError> {
    let file = path.display().to_string();
    let io = |source| MotionError::Io {
        file: file.clone(),
        source,
    };
    let size_bytes = std::fs::metadata(path).map_err(io)?.len();
    check_size(&file, size_bytes, MAX_FILE_BYTES)?;
    bounded::read_bytes(path, MAX_FILE_BYTES).map_err(|e| io(e.into_io()))
}

fn check_size(file: &str, size_bytes: u64, limit_bytes: u64) -> Result<(), MotionError> {
    if size_bytes > limit_bytes {
        return Err(MotionError::TooLarge {
            file: file.into(),
            size_bytes,
            limit_bytes,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
