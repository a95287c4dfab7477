//! `motion info|mesh|list`.

use std::{
    io::{Cursor, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

use clap::Subcommand;
use glam::{Mat3, Vec3};
use radarllm::{MotionInput, open_motion};
use radarllm_body::mesh::{BodyModel, BuiltinBody, SmplxBody, pose_on_body};
use radarllm_files::npy::{NpyElement, NpyWriter};
use radarllm_motions::spec::{GLOBAL_KEYS, KeySpec};
use serde::Serialize;

use crate::{
    error::{CliError, CliResult},
    output,
};

/// `motion ...`.
#[derive(Subcommand)]
pub(crate) enum MotionVerb {
    /// Print format, length, unit and skipped data of a motion.
    Info {
        /// BVH, AMC (with its ASF), AMASS npz, HumanML3D npy, or builtin:NAME?key=value.
        input: String,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of the variations of a built-in motion.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Write the moving body as npz (vertices, faces, joints, rotations), obj (first pose) or png (contact sheet).
    Mesh {
        /// Motion file or builtin:NAME?key=value.
        input: String,
        /// F.npz, F.obj or F.png.
        #[arg(long)]
        out: PathBuf,
        /// A user's own SMPL-X .npz; the built-in body if omitted.
        #[arg(long)]
        body: Option<PathBuf>,
        /// Replace an existing file.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of the variations of a built-in motion.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// List the built-in motions with their keys.
    List {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

/// Maximum size of a mesh sequence, bytes of vertices.
const MAX_MESH_BYTES: usize = 4 << 30;

/// Runs the command.
pub(crate) fn run(verb: &MotionVerb) -> CliResult {
    match verb {
        MotionVerb::Info { input, json, seed } => info(input, *json, *seed),
        MotionVerb::Mesh {
            input,
            out,
            body,
            force,
            json,
            seed,
        } => mesh(input, out, body.as_deref(), *force, *json, *seed),
        MotionVerb::List { json } => list(*json),
    }
}

fn info(input: &str, json: bool, seed: u64) -> CliResult {
    let info = open_motion(input, seed)?.info;
    if json {
        return output::print_json(&info);
    }
    output::print_line(&format!("{input}: {}", info.format));
    output::print_line(&format!(
        "  {} frames at {:.2} fps, {:.2} s; {} joints; unit {}; height {:.2} m",
        info.frames, info.fps, info.duration_s, info.joints, info.unit, info.height_m
    ));
    for (title, lines) in [
        ("skipped", &info.skipped),
        ("warning", &info.warnings),
        ("caption", &info.captions),
    ] {
        for line in lines {
            output::print_line(&format!("  {title}: {line}"));
        }
    }
    Ok(())
}

fn list(json: bool) -> CliResult {
    let specs = radarllm_motions::specs();
    let print_keys = |keys: &[KeySpec]| {
        for key in keys {
            output::print_line(&format!("    {:<14} {}", key.name, key.kind.describe()));
        }
    };
    if json {
        let rows: Vec<_> = specs
            .iter()
            .map(|spec| {
                let keys: std::collections::BTreeMap<_, _> = spec
                    .keys
                    .iter()
                    .chain(GLOBAL_KEYS)
                    .map(|key| (key.name, key.kind.describe()))
                    .collect();
                serde_json::json!({ "name": spec.name, "about": spec.about, "keys": keys })
            })
            .collect();
        return output::print_json(&rows);
    }
    for spec in specs {
        output::print_line(&format!("builtin:{:<14} {}", spec.name, spec.about));
        print_keys(spec.keys);
    }
    output::print_line("every request, once for all of its motions");
    print_keys(GLOBAL_KEYS);
    Ok(())
}

#[derive(Serialize)]
struct MeshReport {
    out: String,
    frames: usize,
    vertices: usize,
    faces: usize,
    body: String,
}

fn mesh(
    input: &str,
    out: &Path,
    body: Option<&Path>,
    force: bool,
    json: bool,
    seed: u64,
) -> CliResult {
    output::check_free(out, force)?;
    let motion = open_motion(input, seed)?;
    let body = open_body(body, &motion)?;
    let n_frames = motion.motion.len();
    let bytes = n_frames
        .saturating_mul(body.n_vertices())
        .saturating_mul(12);
    if bytes > MAX_MESH_BYTES {
        return Err(CliError::new(format!(
            "{input}: {n_frames} frames need {} GiB of vertices",
            bytes >> 30
        ))
        .hint("cut the motion, or render it to .png"));
    }
    let extension = out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let file = match extension {
        "npz" => npz(&motion, body.as_ref())?,
        "obj" => obj(&motion, body.as_ref()),
        "png" => radarllm_render::raster::contact_sheet(
            &(0..8)
                .map(|i| posed(&motion, body.as_ref(), i * (n_frames - 1) / 7))
                .collect::<Vec<_>>(),
            body.triangles(),
        )
        .map_err(CliError::new)?,
        _ => {
            return Err(
                CliError::new(format!("{}: unknown mesh format", out.display()))
                    .hint("end the name in .npz, .obj or .png"),
            );
        }
    };
    output::write_atomic(out, &file)?;
    let report = MeshReport {
        out: out.display().to_string(),
        frames: n_frames,
        vertices: body.n_vertices(),
        faces: body.triangles().len(),
        body: body.name().to_string(),
    };
    if json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: {} frames, {} vertices, {} faces, body {}",
        report.out, report.frames, report.vertices, report.faces, report.body
    ));
    Ok(())
}

/// The SMPL-X file of the user, or the built-in body with the shape of the motion.
fn open_body(path: Option<&Path>, motion: &MotionInput) -> CliResult<Arc<dyn BodyModel>> {
    Ok(match path {
        Some(path) => Arc::new(SmplxBody::open(path, &[]).map_err(|e| {
            CliError::new(e).hint("--body wants an SMPL-X .npz with numeric members")
        })?),
        None => Arc::new(BuiltinBody::new(&motion.shape)?),
    })
}

fn posed(motion: &MotionInput, body: &dyn BodyModel, frame_idx: usize) -> Vec<Vec3> {
    let mut vertices = vec![Vec3::ZERO; body.n_vertices()];
    let pose = pose_on_body(
        &motion.motion.poses[frame_idx],
        &motion.motion.skeleton,
        body,
    );
    body.pose_into(&pose, &mut vertices);
    vertices
}

/// Encodes an npz archive: `vertices` f32 (T, V, 3), `faces` i32 (F, 3), `joints` f32 (T, J, 3), in metres and world
/// axes; `rotations` f32 (T, J, 3, 3), from the axes of a joint to those of its parent, for the root to the world.
fn npz(motion: &MotionInput, body: &dyn BodyModel) -> CliResult<Vec<u8>> {
    let n_frames = motion.motion.len();
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let vertices = (0..n_frames)
        .flat_map(|i| posed(motion, body, i))
        .flat_map(|v| v.to_array());
    array(
        &mut zip,
        "vertices",
        &[n_frames, body.n_vertices(), 3],
        vertices,
    )?;
    let faces = body.triangles().iter().flatten().map(|i| *i as i32);
    array(&mut zip, "faces", &[body.triangles().len(), 3], faces)?;
    let joints = motion.motion.poses.iter().flat_map(|pose| {
        let pose = pose_on_body(pose, &motion.motion.skeleton, body);
        body.skeleton()
            .forward(&pose)
            .0
            .into_iter()
            .flat_map(|j| j.to_array())
    });
    array(
        &mut zip,
        "joints",
        &[n_frames, radarllm_base::skeleton::N_JOINTS, 3],
        joints,
    )?;
    let rotations = motion.motion.poses.iter().flat_map(|pose| {
        let pose = pose_on_body(pose, &motion.motion.skeleton, body);
        pose.rotations.into_iter().flat_map(|rotation| {
            // glam stores matrices by column, NumPy by row.
            Mat3::from_quat(rotation).transpose().to_cols_array()
        })
    });
    array(
        &mut zip,
        "rotations",
        &[n_frames, radarllm_base::skeleton::N_JOINTS, 3, 3],
        rotations,
    )?;
    Ok(zip.finish()?.into_inner())
}

/// Adds `name.npy` to an npz archive.
fn array<T: NpyElement>(
    zip: &mut zip::ZipWriter<Cursor<Vec<u8>>>,
    name: &str,
    shape: &[usize],
    values: impl Iterator<Item = T>,
) -> CliResult {
    let options = zip::write::SimpleFileOptions::default().large_file(true);
    zip.start_file(format!("{name}.npy"), options)?;
    let mut writer = NpyWriter::new(zip, shape)?;
    writer.extend(values)?;
    writer.finish()?;
    Ok(())
}

fn obj(motion: &MotionInput, body: &dyn BodyModel) -> Vec<u8> {
    let mut text = Vec::new();
    let _ = writeln!(text, "# metres, z up; first pose");
    for v in posed(motion, body, 0) {
        let _ = writeln!(text, "v {} {} {}", v.x, v.y, v.z);
    }
    for [a, b, c] in body.triangles() {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text
}
