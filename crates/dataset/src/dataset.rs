//! Reads a data set directory.

use std::path::{Path, PathBuf};

use crate::manifest::ShardEntry;
use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;

use crate::shard::{self, BatchReader, ShardReader};
use crate::{ClipRecord, Columns, DatasetError, Manifest, Split, check_record};

/// An opened data set. Its manifest has been read and checked; its shards have not been read yet.
#[derive(Clone, Debug)]
pub struct Dataset {
    dir: PathBuf,
    manifest: Manifest,
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
        })
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

    /// Iterates over the rows of a split as Arrow batches, with one row group in memory at a time.
    pub fn iter_batches(&self, split: Split) -> BatchIter {
        let mut shards: Vec<PathBuf> = self.shards(split).map(|s| s.path(&self.dir)).collect();
        shards.reverse();
        BatchIter {
            shards,
            open: None,
            failed: false,
        }
    }

    /// Iterates over the clips of a split, with one row group in memory at a time.
    pub fn iter_split(&self, split: Split, columns: Columns) -> ClipIter {
        let mut shards: Vec<(PathBuf, u64)> = self
            .shards(split)
            .map(|s| (s.path(&self.dir), s.rows))
            .collect();
        shards.reverse();
        ClipIter {
            split,
            columns,
            shards,
            open: None,
            failed: false,
        }
    }
}

/// Streams the rows of a split as Arrow batches of at most 32 clips, without looking at the values. The iterator ends
/// after an error.
pub struct BatchIter {
    /// Remaining shards, last first.
    shards: Vec<PathBuf>,
    open: Option<BatchReader>,
    failed: bool,
}

impl BatchIter {
    /// Columns of every batch: see [`crate::shard`].
    pub fn schema() -> SchemaRef {
        shard::schema()
    }

    fn advance(&mut self) -> Result<Option<RecordBatch>, DatasetError> {
        loop {
            if let Some(reader) = &mut self.open {
                if let Some(batch) = reader.next_batch()? {
                    return Ok(Some(batch));
                }
                self.open = None;
            }
            let Some(path) = self.shards.pop() else {
                return Ok(None);
            };
            self.open = Some(BatchReader::open(&path)?);
        }
    }
}

impl Iterator for BatchIter {
    type Item = Result<RecordBatch, DatasetError>;

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
    /// Remaining shards with their number of rows, last first.
    shards: Vec<(PathBuf, u64)>,
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
            let Some((path, rows)) = self.shards.pop() else {
                return Ok(None);
            };
            let reader = ShardReader::open(&path, self.columns)?;
            if reader.n_rows() != rows {
                let problem = format!("{} rows, but the manifest says {rows}", reader.n_rows());
                return Err(DatasetError::corrupt(&path, problem));
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
