//! Copies a finished data set as a repository of the Hugging Face Hub: card, manifest and shards, and nothing of the
//! state of the build.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::atomic::sync_dir;
use super::card;
use super::file_system::{Access, check_place, try_lock};
use super::folder::{
    DATA_DIR, STATE_DIR, is_shard_name, remove_if_there, remove_matching, write_json, write_text,
};
use super::manifest::MANIFEST_NAME;
use crate::{DatasetError, Manifest, Overwrite, ShardEntry};

const CARD_NAME: &str = "README.md";
/// In a folder whose data set is being replaced. It stays if that is interrupted, so that the folder is recognised.
const UNFINISHED_NAME: &str = ".export.unfinished";

/// Copies the data set in `dir` to the folder `to` and returns its manifest. The hash of every shard is checked while it
/// is copied. The card is written from the manifest.
///
/// The copy is made beside `to` and appears under its name when it is complete. In a folder that exists, the files are
/// replaced one by one when all of them are copied, the manifest last; shards of another data set in it are removed, and
/// its other files (`.git`, for example) stay. If that is interrupted, the folder has no manifest, and the next export
/// with [`Overwrite::Replace`] completes it.
///
/// # Errors
/// A data set that is not finished, or whose shards do not have the hashes of the manifest; a folder `to` that exists
/// and is not empty (unless [`Overwrite::Replace`]), that holds a build or something else, or that contains `dir` or is
/// in it; an object store; another export to the same folder; a file system error.
pub fn export(dir: &Path, to: &Path, overwrite: Overwrite) -> Result<Manifest, DatasetError> {
    let manifest = Manifest::read(dir)?;
    check_counts(dir, &manifest)?;
    check_place(to)?;
    let is_new = check_target(dir, to, overwrite)?;
    // A folder that exists may be given as `.`, which has no name.
    let resolved = fs::canonicalize(to);
    let to = resolved.as_deref().unwrap_or(to);

    let staging = Staging::create(to)?;
    staging.fill(dir, &manifest)?;
    if is_new {
        staging.become_folder(to)?;
    } else {
        staging.move_files(to, &manifest)?;
    }
    Ok(manifest)
}

/// What a change of the manifest alone would break.
fn check_counts(dir: &Path, manifest: &Manifest) -> Result<(), DatasetError> {
    let path = dir.join(MANIFEST_NAME);
    let mut files: Vec<&str> = manifest.shards.iter().map(|s| s.file.as_str()).collect();
    files.sort_unstable();
    if let Some(twice) = files.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(DatasetError::corrupt(
            &path,
            format!("`{}` is listed twice", twice[0]),
        ));
    }
    if let Some(shard) = manifest
        .shards
        .iter()
        .find(|s| s.ids.len() as u64 != s.rows)
    {
        let problem = format!("`{}` has {} ids", shard.file, shard.ids.len());
        return Err(DatasetError::corrupt(&path, problem));
    }
    let n_rows: u64 = manifest.shards.iter().map(|s| s.ids.len() as u64).sum();
    if n_rows != manifest.n_clips {
        let problem = format!("n_clips is {}, the shards have {n_rows}", manifest.n_clips);
        return Err(DatasetError::corrupt(&path, problem));
    }
    Ok(())
}

/// Whether `to` does not exist yet. Refuses folders into which nothing may be copied.
fn check_target(dir: &Path, to: &Path, overwrite: Overwrite) -> Result<bool, DatasetError> {
    // Also a link to nothing exists.
    if to.symlink_metadata().is_err() {
        let inside = fs::canonicalize(folder_of(to))
            .and_then(|parent| Ok(parent.starts_with(fs::canonicalize(dir)?)))
            .map_err(DatasetError::io(to, "open the folder above"))?;
        return match inside {
            true => Err(refused(to, "is in the folder of the data set")),
            false => Ok(true),
        };
    }
    let mut entries = fs::read_dir(to).map_err(DatasetError::io(to, "list"))?;
    if entries.next().is_none() {
        // Nothing is lost.
    } else if overwrite == Overwrite::Refuse {
        return Err(DatasetError::Exists { path: to.into() });
    } else if to.join(STATE_DIR).exists() {
        return Err(refused(to, "is the folder of a build"));
    } else if ![MANIFEST_NAME, UNFINISHED_NAME, ".git"]
        .iter()
        .any(|name| to.join(name).exists())
    {
        return Err(DatasetError::NotADataset { dir: to.into() });
    }
    let [from, target] =
        [dir, to].map(|p| fs::canonicalize(p).map_err(DatasetError::io(p, "open")));
    let (from, target) = (from?, target?);
    if from.starts_with(&target) || target.starts_with(&from) {
        return Err(refused(to, "contains the data set or is in it"));
    }
    Ok(false)
}

fn refused(to: &Path, problem: &str) -> DatasetError {
    DatasetError::Target {
        dir: to.into(),
        problem: problem.into(),
    }
}

/// The folder that holds `path`.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A folder beside the target that holds a lock and the copy. It is removed in the end.
struct Staging {
    dir: PathBuf,
    copy: PathBuf,
    /// Held until the folder is removed.
    _lock: File,
}

impl Staging {
    fn create(to: &Path) -> Result<Self, DatasetError> {
        // Every export to this folder has the same one, so that the next one removes what a killed one has left.
        let Some(name) = to.file_name() else {
            return Err(refused(to, "has no name of its own"));
        };
        let name = format!(".{}.export.tmp", name.to_string_lossy());
        let dir = folder_of(to).join(name);
        fs::create_dir_all(&dir).map_err(DatasetError::io(&dir, "create"))?;
        // What is behind a link is not ours to remove.
        if dir.is_symlink() {
            return Err(refused(&dir, "is a link"));
        }
        let lock = try_lock(&dir.join("lock"), to, Access::Exclusive)?;
        let staging = Self {
            copy: dir.join("copy"),
            dir,
            _lock: lock,
        };
        match fs::remove_dir_all(&staging.copy) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                return Err(DatasetError::io(&staging.copy, "remove")(e));
            }
            _ => {}
        }
        let data_dir = staging.copy.join(DATA_DIR);
        fs::create_dir_all(&data_dir).map_err(DatasetError::io(&data_dir, "create"))?;
        Ok(staging)
    }

    fn fill(&self, dir: &Path, manifest: &Manifest) -> Result<(), DatasetError> {
        for shard in &manifest.shards {
            copy_checked(&shard.path(dir), &shard.path(&self.copy), shard)?;
        }
        write_text(&self.copy.join(CARD_NAME), &card::dataset_card(manifest))?;
        write_json(&self.copy.join(MANIFEST_NAME), manifest)?;
        sync_dir(&self.copy.join(DATA_DIR))
    }

    /// Gives the copy its final name.
    fn become_folder(&self, to: &Path) -> Result<(), DatasetError> {
        fs::rename(&self.copy, to).map_err(DatasetError::io(to, "rename into place"))?;
        sync_dir(folder_of(to))
    }

    /// Moves the files into a folder that exists.
    fn move_files(&self, to: &Path, manifest: &Manifest) -> Result<(), DatasetError> {
        let unfinished = to.join(UNFINISHED_NAME);
        write_text(&unfinished, "")?;
        // Without its manifest the folder does not claim to be complete.
        remove_if_there(&to.join(MANIFEST_NAME))?;
        let data_dir = to.join(DATA_DIR);
        fs::create_dir_all(&data_dir).map_err(DatasetError::io(&data_dir, "create"))?;
        remove_matching(&data_dir, is_shard_name)?;
        let place = |file: &str| {
            let target = to.join(file);
            fs::rename(self.copy.join(file), &target)
                .map_err(DatasetError::io(&target, "rename into place"))
        };
        for shard in &manifest.shards {
            place(&shard.file)?;
        }
        sync_dir(&data_dir)?;
        place(CARD_NAME)?;
        place(MANIFEST_NAME)?;
        sync_dir(to)?;
        remove_if_there(&unfinished)?;
        sync_dir(to)
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // Best effort: the next export removes what stays.
        let _ = fs::remove_dir_all(&self.dir);
    }
}

/// Copies a shard and refuses it if its bytes are not those of the manifest.
fn copy_checked(from: &Path, to: &Path, shard: &ShardEntry) -> Result<(), DatasetError> {
    let mut source = File::open(from).map_err(DatasetError::io(from, "open"))?;
    let mut copy = File::create(to).map_err(DatasetError::io(to, "create"))?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0_u8; 1 << 20];
    let mut bytes = 0_u64;
    loop {
        let n = source
            .read(&mut buffer)
            .map_err(DatasetError::io(from, "read"))?;
        if n == 0 {
            break;
        }
        bytes += n as u64;
        if bytes > shard.bytes {
            break;
        }
        hasher.update(&buffer[..n]);
        copy.write_all(&buffer[..n])
            .map_err(DatasetError::io(to, "write"))?;
    }
    if bytes != shard.bytes || hasher.finalize().to_hex().as_str() != shard.blake3 {
        return Err(DatasetError::corrupt(
            from,
            "its bytes are not those that the manifest lists; `radarllm dataset build` makes it again",
        ));
    }
    copy.sync_all().map_err(DatasetError::io(to, "sync"))
}
