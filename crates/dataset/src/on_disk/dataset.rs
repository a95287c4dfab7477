//! Reads a data set directory.

use std::path::{Path, PathBuf};

use super::manifest::{MANIFEST_NAME, ShardEntry, hash_file};
use super::shard::{self, BatchReader, ShardReader};
use super::table::Table;
use crate::{ClipRecord, Columns, DatasetError, Manifest, Split, check_record};

/// An opened data set. Its manifest has been read and checked; its shards have not been read yet.
#[derive(Clone, Debug)]
pub struct Dataset {
    dir: PathBuf,
    manifest: Manifest,
    checks_hashes: bool,
}

impl Dataset {
    /// Opens a finished data set.
    ///
    /// # Errors
    /// No manifest (not a data set, or a build that has not finished), or an invalid one.
    pub fn open(dir: &Path) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(dir)?;
        Ok(Self {
            dir: dir.into(),
            manifest,
            checks_hashes: false,
        })
    }

    /// Compares the bytes of every shard with the manifest before its rows are read, each time that it is read.
    #[must_use]
    pub fn checking_hashes(mut self) -> Self {
        self.checks_hashes = true;
        self
    }

    /// Directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The manifest of the directory.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Number of clips of a split, from the manifest.
    pub fn n_clips(&self, split: Split) -> u64 {
        self.shards(split).map(|s| s.rows).sum()
    }

    /// Shards of a split, in order.
    pub fn shards(&self, split: Split) -> impl Iterator<Item = &ShardEntry> {
        self.manifest
            .shards
            .iter()
            .filter(move |s| s.split == split.name())
    }

    /// All clips of a split in memory.
    ///
    /// # Errors
    /// As [`ClipIter`]'s items.
    pub fn read_split(&self, split: Split) -> Result<Vec<ClipRecord>, DatasetError> {
        self.iter_split(split, Columns::All).collect()
    }

    /// Iterates over the rows of a split as tables, with one row group in memory at a time.
    pub fn iter_batches(&self, split: Split) -> BatchIter {
        self.batches_of(self.shards(split), Columns::All)
    }

    /// As [`Self::iter_batches`], for one shard, with only the columns that are asked for.
    ///
    /// # Errors
    /// A shard that the split does not have; they are numbered from 0.
    pub fn iter_shard_batches(
        &self,
        split: Split,
        shard: usize,
        columns: Columns,
    ) -> Result<BatchIter, DatasetError> {
        let entry = self.shard(split, shard)?;
        Ok(self.batches_of([entry], columns))
    }

    /// Iterates over the clips of a split, with one row group in memory at a time.
    pub fn iter_split(&self, split: Split, columns: Columns) -> ClipIter {
        self.clips_of(self.shards(split), split, columns)
    }

    /// As [`Self::iter_split`], for one shard.
    ///
    /// # Errors
    /// A shard that the split does not have; they are numbered from 0.
    pub fn iter_shard(
        &self,
        split: Split,
        shard: usize,
        columns: Columns,
    ) -> Result<ClipIter, DatasetError> {
        let entry = self.shard(split, shard)?;
        Ok(self.clips_of([entry], split, columns))
    }

    fn shard(&self, split: Split, shard: usize) -> Result<&ShardEntry, DatasetError> {
        let found = self.shards(split).nth(shard);
        found.ok_or_else(|| DatasetError::Metadata {
            path: self.dir.join(MANIFEST_NAME),
            field: "shards".into(),
            problem: format!(
                "{split} has no shard {shard}: it has {}, numbered from 0",
                self.shards(split).count()
            ),
        })
    }

    fn batches_of<'a>(
        &self,
        entries: impl IntoIterator<Item = &'a ShardEntry>,
        columns: Columns,
    ) -> BatchIter {
        BatchIter {
            columns,
            shards: self.files(entries),
            open: None,
            failed: false,
        }
    }

    fn clips_of<'a>(
        &self,
        entries: impl IntoIterator<Item = &'a ShardEntry>,
        split: Split,
        columns: Columns,
    ) -> ClipIter {
        ClipIter {
            split,
            columns,
            shards: self.files(entries),
            open: None,
            failed: false,
        }
    }

    /// The files of shards, last first.
    fn files<'a>(&self, entries: impl IntoIterator<Item = &'a ShardEntry>) -> Vec<ShardFile> {
        let file = |entry: &ShardEntry| ShardFile {
            path: entry.path(&self.dir),
            rows: entry.rows,
            hash: self
                .checks_hashes
                .then(|| (entry.blake3.clone(), entry.bytes)),
        };
        let mut files: Vec<ShardFile> = entries.into_iter().map(file).collect();
        files.reverse();
        files
    }
}

/// A shard that is to be read.
struct ShardFile {
    path: PathBuf,
    /// Rows by the manifest.
    rows: u64,
    /// BLAKE3 and length by the manifest, where they are to be compared.
    hash: Option<(String, u64)>,
}

impl ShardFile {
    fn check_hash(&self) -> Result<(), DatasetError> {
        let Some((blake3, bytes)) = &self.hash else {
            return Ok(());
        };
        let (found, found_bytes) = hash_file(&self.path)?;
        if found_bytes != *bytes {
            let problem = format!("{found_bytes} bytes, the manifest says {bytes}");
            return Err(self.changed(problem));
        }
        if found != *blake3 {
            let problem = format!("BLAKE3 is {found}, the manifest says {blake3}");
            return Err(self.changed(problem));
        }
        Ok(())
    }

    fn changed(&self, problem: String) -> DatasetError {
        DatasetError::Changed {
            path: self.path.clone(),
            problem,
        }
    }
}

/// Streams the rows of a split as tables of at most 32 clips, without looking at the values. The iterator ends
/// after an error.
pub struct BatchIter {
    columns: Columns,
    /// Remaining shards, last first.
    shards: Vec<ShardFile>,
    open: Option<BatchReader>,
    failed: bool,
}

impl BatchIter {
    /// The columns of every table, unless fewer were asked for, without rows: see [`crate::shard`].
    pub fn no_rows() -> Table {
        shard::no_rows(Columns::All)
    }

    fn advance(&mut self) -> Result<Option<Table>, DatasetError> {
        loop {
            if let Some(reader) = &mut self.open {
                if let Some(batch) = reader.next_batch()? {
                    return Ok(Some(batch));
                }
                self.open = None;
            }
            let Some(file) = self.shards.pop() else {
                return Ok(None);
            };
            file.check_hash()?;
            self.open = Some(BatchReader::open(&file.path, self.columns)?);
        }
    }
}

impl Iterator for BatchIter {
    type Item = Result<Table, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let item = self.advance().transpose();
        self.failed = matches!(item, Some(Err(_)));
        item
    }
}

/// Streams the clips of a split. Every clip satisfies [`check_record`]. The iterator ends after an error.
pub struct ClipIter {
    split: Split,
    columns: Columns,
    /// Remaining shards, last first.
    shards: Vec<ShardFile>,
    open: Option<ShardReader>,
    failed: bool,
}

impl ClipIter {
    fn advance(&mut self) -> Result<Option<ClipRecord>, DatasetError> {
        loop {
            if let Some(reader) = &mut self.open {
                if let Some(record) = reader.next().transpose()? {
                    check_record(&record)?;
                    if record.split != self.split {
                        let problem =
                            format!("is in {}, but its shard is {}", record.split, self.split);
                        return Err(DatasetError::Record {
                            id: record.id,
                            problem,
                        });
                    }
                    return Ok(Some(record));
                }
                self.open = None;
            }
            let Some(file) = self.shards.pop() else {
                return Ok(None);
            };
            file.check_hash()?;
            let reader = ShardReader::open(&file.path, self.columns)?;
            if reader.n_rows() != file.rows {
                let (found, rows) = (reader.n_rows(), file.rows);
                let problem = format!("{found} rows, but the manifest says {rows}");
                return Err(DatasetError::corrupt(&file.path, problem));
            }
            self.open = Some(reader);
        }
    }
}

impl Iterator for ClipIter {
    type Item = Result<ClipRecord, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let item = self.advance().transpose();
        self.failed = matches!(item, Some(Err(_)));
        item
    }
}
