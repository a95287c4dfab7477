//! Opens untrusted Parquet files safely.
//!
//! The Parquet decoder allocates memory by sizes that it reads from page headers, and may panic on inconsistent
//! files. Before it reads any page, this module checks everything that determines an allocation: footer
//! length, chunk positions, every page header (parsed with a reader of our own) and codecs. The
//! decoder then runs under `catch_unwind`.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use parquet::basic::{Compression, Type};
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::reader::FileReader as _;
use parquet::file::serialized_reader::SerializedFileReader;

use crate::DatasetError;

/// Limits of a reader.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Size of the whole file, bytes.
    pub file_bytes: u64,
    /// Number of rows of the file.
    pub rows: u64,
    /// Leaf values of one column chunk, including nulls.
    pub chunk_values: u64,
}

/// Maximum size of the serialised footer, bytes. A shard of 10,000 clips needs well under 1 MiB.
const MAX_FOOTER_BYTES: u64 = 16 << 20;
/// Maximum size of one page before compression, bytes. Writers aim at 1 MiB; rows are never split.
const MAX_PAGE_BYTES: u64 = 256 << 20;
/// Maximum size of one page header, bytes: dozens, plus statistics that writers truncate to 64 bytes each.
const MAX_PAGE_HEADER_BYTES: u64 = 1 << 20;
/// Maximum size of the text that one column chunk can expand to through its dictionary, bytes.
const MAX_DICTIONARY_EXPANSION_BYTES: u64 = 1 << 30;

/// Opens `path` and checks every size in it.
pub(crate) fn open(
    path: &Path,
    limits: Limits,
) -> Result<SerializedFileReader<File>, DatasetError> {
    let file = File::open(path).map_err(DatasetError::io(path, "open"))?;
    open_file(path, file, limits)
}

/// As [`open`], from a file that is open; `path` names it in errors.
pub(crate) fn open_file(
    path: &Path,
    mut file: File,
    limits: Limits,
) -> Result<SerializedFileReader<File>, DatasetError> {
    let info = file.metadata().map_err(DatasetError::io(path, "open"))?;
    if !info.is_file() {
        return Err(DatasetError::corrupt(path, "not a regular file"));
    }
    let file_bytes = info.len();
    check_limit(path, "file size in bytes", file_bytes, limits.file_bytes)?;
    check_footer(path, &mut file, file_bytes)?;

    let to_read = file.try_clone().map_err(DatasetError::io(path, "open"))?;
    let reader = isolated(path, || {
        SerializedFileReader::new(to_read).map_err(|e| DatasetError::corrupt(path, e))
    })?;
    let mut rows = 0_u64;
    for group in reader.metadata().row_groups() {
        let group_rows = u64::try_from(group.num_rows()).map_err(|_| {
            DatasetError::corrupt(path, "a row group has a negative number of rows")
        })?;
        rows = rows.saturating_add(group_rows);
        for column in group.columns() {
            check_chunk(path, &mut file, file_bytes, column, limits)?;
        }
    }
    check_limit(path, "number of rows", rows, limits.rows)?;
    Ok(reader)
}

/// Runs a decoder step. A panic in it becomes [`DatasetError::Corrupt`].
pub(crate) fn isolated<T>(
    path: &Path,
    step: impl FnOnce() -> Result<T, DatasetError>,
) -> Result<T, DatasetError> {
    // No data that outlives the closure can be left inconsistent: on a panic, the reader is dropped.
    catch_unwind(AssertUnwindSafe(step)).unwrap_or_else(|panic| {
        let what = panic_message(&*panic);
        Err(DatasetError::corrupt(
            path,
            format!("the Parquet decoder gave up: {what}"),
        ))
    })
}

/// Text of a caught panic.
pub(crate) fn panic_message(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("unknown panic")
}

fn check_limit(path: &Path, what: &str, found: u64, max: u64) -> Result<(), DatasetError> {
    if found > max {
        return Err(DatasetError::Limit {
            path: path.to_path_buf(),
            what: what.into(),
            found,
            max,
        });
    }
    Ok(())
}

fn check_footer(path: &Path, file: &mut File, file_bytes: u64) -> Result<(), DatasetError> {
    // "PAR1", ..., footer, u32 length of the footer, "PAR1".
    if file_bytes < 12 {
        return Err(DatasetError::corrupt(
            path,
            format!("{file_bytes} bytes are too few for Parquet"),
        ));
    }
    let mut tail = [0_u8; 8];
    file.seek(SeekFrom::End(-8))
        .and_then(|_| file.read_exact(&mut tail))
        .map_err(DatasetError::io(path, "read the end of"))?;
    if &tail[4..] != b"PAR1" {
        return Err(DatasetError::corrupt(
            path,
            "no Parquet magic `PAR1` at the end",
        ));
    }
    let footer_bytes = u64::from(u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]));
    check_limit(
        path,
        "footer length in bytes",
        footer_bytes,
        MAX_FOOTER_BYTES.min(file_bytes - 12),
    )
}

fn check_chunk(
    path: &Path,
    file: &mut File,
    file_bytes: u64,
    column: &ColumnChunkMetaData,
    limits: Limits,
) -> Result<(), DatasetError> {
    let name = column.column_path().string();
    let bad = |problem: String| DatasetError::corrupt(path, format!("column `{name}`: {problem}"));
    if !matches!(
        column.compression(),
        Compression::UNCOMPRESSED | Compression::SNAPPY
    ) {
        return Err(bad(format!(
            "compression {} is not supported; write it with snappy or none",
            column.compression()
        )));
    }
    let first = column
        .dictionary_page_offset()
        .unwrap_or_else(|| column.data_page_offset());
    let start = u64::try_from(first).map_err(|_| bad(format!("pages start at offset {first}")))?;
    let size = u64::try_from(column.compressed_size())
        .map_err(|_| bad(format!("size is {} bytes", column.compressed_size())))?;
    let end = start
        .checked_add(size)
        .filter(|&end| end <= file_bytes)
        .ok_or_else(|| {
            bad(format!(
                "{size} bytes at offset {start} lie outside the file"
            ))
        })?;
    let declared = u64::try_from(column.num_values())
        .map_err(|_| bad(format!("number of values is {}", column.num_values())))?;
    check_limit(
        path,
        &format!("number of values of column `{name}`"),
        declared,
        limits.chunk_values,
    )?;

    let mut at = start;
    let mut values = 0_u64;
    let mut dictionary_bytes = 0_u64;
    while at < end {
        let page = read_page_header(file, at, end)
            .map_err(|problem| bad(format!("page header at offset {at}: {problem}")))?;
        if page.uncompressed_bytes > MAX_PAGE_BYTES {
            return Err(bad(format!(
                "page at offset {at} claims {} bytes",
                page.uncompressed_bytes
            )));
        }
        if page.is_dictionary {
            dictionary_bytes = dictionary_bytes.max(page.uncompressed_bytes);
        } else {
            values = values.saturating_add(page.n_values);
        }
        check_limit(
            path,
            &format!("number of values of column `{name}`"),
            values,
            limits.chunk_values,
        )?;
        at = page.end;
    }
    if column.column_type() == Type::BYTE_ARRAY
        && dictionary_bytes.saturating_mul(values)
            > MAX_DICTIONARY_EXPANSION_BYTES.max(dictionary_bytes)
    {
        return Err(bad(format!(
            "{values} entries of a dictionary of {dictionary_bytes} bytes are too much text"
        )));
    }
    Ok(())
}

/// The fields of a Parquet `PageHeader` that determine allocations.
#[derive(Default)]
struct PageHeader {
    uncompressed_bytes: u64,
    n_values: u64,
    is_dictionary: bool,
    /// End offset of the page's data.
    end: u64,
}

/// Parses the header at `at`; the page must end at or before `end`.
///
/// Thrift compact protocol, `PageHeader` of parquet.thrift: 2 = uncompressed size, 3 = compressed
/// size, 5 / 7 / 8 = data, dictionary and v2 data page headers, whose field 1 is the value count.
fn read_page_header(file: &mut File, at: u64, end: u64) -> Result<PageHeader, String> {
    file.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
    let budget = (end - at).min(MAX_PAGE_HEADER_BYTES);
    // Headers are short; a small buffer avoids reading the page's data as well.
    let mut input = Compact {
        inner: std::io::BufReader::with_capacity(256, &*file),
        left: budget,
    };
    let mut page = PageHeader::default();
    let mut compressed = None;
    let mut uncompressed = None;
    let mut id = 0;
    while let Some((field, kind)) = input.field(&mut id)? {
        match (field, kind) {
            (2, 5) => uncompressed = Some(input.zigzag()?),
            (3, 5) => compressed = Some(input.zigzag()?),
            (5 | 7 | 8, 12) => {
                page.is_dictionary = field == 7;
                let mut inner_id = 0;
                while let Some((inner, kind)) = input.field(&mut inner_id)? {
                    if (inner, kind) == (1, 5) {
                        let n = input.zigzag()?;
                        page.n_values = u64::try_from(n).map_err(|_| format!("value count {n}"))?;
                    } else {
                        input.skip(kind, 0)?;
                    }
                }
            }
            _ => input.skip(kind, 0)?,
        }
    }
    let size = |name: &str, value: Option<i64>| {
        let value = value.ok_or_else(|| format!("no {name} size"))?;
        u64::try_from(value).map_err(|_| format!("{name} size {value}"))
    };
    page.uncompressed_bytes = size("uncompressed", uncompressed)?;
    let compressed = size("compressed", compressed)?;
    page.end = at + (budget - input.left);
    page.end = page
        .end
        .checked_add(compressed)
        .filter(|&page_end| page_end <= end)
        .ok_or_else(|| format!("{compressed} bytes reach past the column's end at {end}"))?;
    Ok(page)
}

/// Reader of the Thrift compact protocol with a byte budget.
struct Compact<R> {
    inner: R,
    left: u64,
}

impl<R: Read> Compact<R> {
    fn byte(&mut self) -> Result<u8, String> {
        self.left = self.left.checked_sub(1).ok_or("too long")?;
        let mut byte = [0];
        self.inner
            .read_exact(&mut byte)
            .map_err(|e| e.to_string())?;
        Ok(byte[0])
    }

    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("number of more than 64 bits".into())
    }

    fn zigzag(&mut self) -> Result<i64, String> {
        let raw = self.varint()?;
        Ok((raw >> 1) as i64 ^ -((raw & 1) as i64))
    }

    /// Next field of a struct as (id, type), or `None` at its end.
    fn field(&mut self, last_id: &mut i64) -> Result<Option<(i64, u8)>, String> {
        let head = self.byte()?;
        if head & 0x0f == 0 {
            return Ok(None);
        }
        *last_id = match head >> 4 {
            0 => self.zigzag()?,
            delta => last_id.wrapping_add(i64::from(delta)),
        };
        Ok(Some((*last_id, head & 0x0f)))
    }

    fn skip(&mut self, kind: u8, depth: u32) -> Result<(), String> {
        if depth > 8 {
            return Err("nested too deeply".into());
        }
        match kind {
            1 | 2 => {}
            3 => {
                self.byte()?;
            }
            4..=6 => {
                self.varint()?;
            }
            7 => self.skip_bytes(8)?,
            8 => {
                let n = self.varint()?;
                self.skip_bytes(n)?;
            }
            9 | 10 => {
                let head = self.byte()?;
                let n = if head >> 4 == 15 {
                    self.varint()?
                } else {
                    u64::from(head >> 4)
                };
                let element = head & 0x0f;
                for _ in 0..n {
                    // In lists, a boolean takes a byte; in structs, it is part of the field header.
                    if matches!(element, 1 | 2) {
                        self.byte()?;
                    } else {
                        // Every element costs at least one byte of the budget, except empty kinds,
                        // which do not exist. The loop therefore ends with the budget.
                        self.skip(element, depth + 1)?;
                    }
                }
            }
            12 => {
                let mut id = 0;
                while let Some((_, kind)) = self.field(&mut id)? {
                    self.skip(kind, depth + 1)?;
                }
            }
            // Maps do not occur in page headers.
            other => return Err(format!("unknown Thrift type {other}")),
        }
        Ok(())
    }

    fn skip_bytes(&mut self, n: u64) -> Result<(), String> {
        if n > self.left {
            return Err(format!("{n} bytes reach past the end"));
        }
        for _ in 0..n {
            self.byte()?;
        }
        Ok(())
    }
}
