//! Opens untrusted Parquet files safely.
//!
//! The Parquet decoder allocates memory by sizes that it reads from page headers, and may panic on inconsistent
//! files. Before it reads any page, this module checks everything that determines an allocation: footer
//! length, depth of the schema, chunk positions, every page header (parsed with a reader of our own) and codecs. The
//! decoder then runs under `catch_unwind`. What the decoder would read in another way than this module is refused: fields
//! that occur twice, have another type than the format states or have no number of the format.

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
/// Maximum size of the text that one column chunk can expand to, bytes: through its dictionary, or through values that begin
/// as the one before.
const MAX_TEXT_BYTES: u64 = 1 << 30;
/// Maximum depth of the schema: ours has fewer than ten levels. The decoder calls itself for every level, and a stack that is
/// full ends the process.
const MAX_SCHEMA_DEPTH: usize = 32;
/// Number of `DELTA_BYTE_ARRAY` in the `Encoding` of parquet.thrift: values as the length of what they have in common with
/// the one before, and the rest.
const DELTA_BYTE_ARRAY: i64 = 7;

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
    let footer_bytes = check_footer(path, &mut file, file_bytes)?;
    check_schema(&mut file, file_bytes - 8 - footer_bytes, footer_bytes)
        .map_err(|problem| DatasetError::corrupt(path, format!("footer: {problem}")))?;

    let to_read = file.try_clone().map_err(DatasetError::io(path, "open"))?;
    let reader = isolated(path, || {
        SerializedFileReader::new(to_read).map_err(|e| DatasetError::corrupt(path, e))
    })?;
    let mut rows = 0_u64;
    for group in reader.metadata().row_groups() {
        let mut list_values = 0_u64;
        let group_rows = u64::try_from(group.num_rows()).map_err(|_| {
            DatasetError::corrupt(path, "a row group has a negative number of rows")
        })?;
        rows = rows.saturating_add(group_rows);
        for column in group.columns() {
            let values = check_chunk(path, &mut file, file_bytes, column, limits)?;
            if column.column_descr().max_rep_level() > 0 {
                list_values = list_values.saturating_add(values);
            }
        }
        // A reader holds all lists of some rows, and these may be in one row.
        check_limit(
            path,
            "number of values of the lists of a row group",
            list_values,
            2 * limits.chunk_values,
        )?;
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

/// Length of the footer.
fn check_footer(path: &Path, file: &mut File, file_bytes: u64) -> Result<u64, DatasetError> {
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
    )?;
    Ok(footer_bytes)
}

/// Checks the depth of the schema in the footer at `at`, before the decoder follows it.
///
/// Thrift compact protocol, `FileMetaData` of parquet.thrift: 2 = list of `SchemaElement`, the nodes of the schema in order
/// of depth first, of which field 5 is the number of children.
fn check_schema(file: &mut File, at: u64, footer_bytes: u64) -> Result<(), String> {
    file.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
    let mut input = Compact {
        inner: std::io::BufReader::new(&*file),
        left: footer_bytes,
    };
    let mut fields = Fields::default();
    while let Some((field, kind)) = input.field(&mut fields)? {
        if field != 2 {
            input.skip(kind, 0)?;
            continue;
        }
        let n = input.list_of_structs(kind)?;
        // Children that are still to come of the nodes above.
        let mut open: Vec<i64> = Vec::new();
        let mut stated = 0_u64;
        for _ in 0..n {
            let n_children = input.schema_element()?;
            // The decoder allocates a place for every child that a node states.
            stated = stated.saturating_add(u64::try_from(n_children).unwrap_or(u64::MAX));
            if stated >= n {
                return Err(format!("the schema states {stated} children in {n} nodes"));
            }
            while open.pop_if(|left| *left == 0).is_some() {}
            if let Some(left) = open.last_mut() {
                *left -= 1;
            }
            if n_children > 0 {
                open.push(n_children);
            }
            if open.len() > MAX_SCHEMA_DEPTH {
                return Err(format!(
                    "the schema has more than {MAX_SCHEMA_DEPTH} levels"
                ));
            }
        }
    }
    Ok(())
}

/// Number of values of a column chunk.
fn check_chunk(
    path: &Path,
    file: &mut File,
    file_bytes: u64,
    column: &ColumnChunkMetaData,
    limits: Limits,
) -> Result<u64, DatasetError> {
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
    let mut delta_bytes = 0_u64;
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
            if page.encoding == Some(DELTA_BYTE_ARRAY) {
                // No value is longer than all of the page.
                let bytes = page.n_values.saturating_mul(page.uncompressed_bytes);
                delta_bytes = delta_bytes.saturating_add(bytes);
            }
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
        && dictionary_bytes.saturating_mul(values) > MAX_TEXT_BYTES.max(dictionary_bytes)
    {
        return Err(bad(format!(
            "{values} entries of a dictionary of {dictionary_bytes} bytes are too much text"
        )));
    }
    if delta_bytes > MAX_TEXT_BYTES {
        return Err(bad(format!(
            "{values} values that begin as the one before are too much text"
        )));
    }
    Ok(values)
}

/// The fields of a Parquet `PageHeader` that determine allocations.
#[derive(Default)]
struct PageHeader {
    uncompressed_bytes: u64,
    n_values: u64,
    encoding: Option<i64>,
    is_dictionary: bool,
    /// End offset of the page's data.
    end: u64,
}

/// Parses the header at `at`; the page must end at or before `end`.
///
/// Thrift compact protocol, `PageHeader` of parquet.thrift: 1 = kind, 2 = uncompressed size, 3 = compressed
/// size, 5 / 7 / 8 = data, dictionary and v2 data page headers, whose field 1 is the value count; field 2, in v2 field 4, is
/// the encoding.
fn read_page_header(file: &mut File, at: u64, end: u64) -> Result<PageHeader, String> {
    file.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
    let budget = (end - at).min(MAX_PAGE_HEADER_BYTES);
    // Headers are short; a small buffer avoids reading the page's data as well.
    let mut input = Compact {
        inner: std::io::BufReader::with_capacity(256, &*file),
        left: budget,
    };
    let mut page = PageHeader::default();
    let mut kind_of_page = None;
    let mut header = None;
    let mut compressed = None;
    let mut uncompressed = None;
    let mut fields = Fields::default();
    while let Some((field, kind)) = input.field(&mut fields)? {
        match (field, kind) {
            (1, 5) => kind_of_page = Some(input.i32()?),
            (2, 5) => uncompressed = Some(input.i32()?),
            (3, 5) => compressed = Some(input.i32()?),
            (5 | 7 | 8, 12) => {
                if header.replace(field).is_some() {
                    return Err("a page of two kinds".into());
                }
                let encoding = if field == 8 { 4 } else { 2 };
                let mut inner_fields = Fields::default();
                while let Some((inner, kind)) = input.field(&mut inner_fields)? {
                    match (inner, kind) {
                        (1, 5) => {
                            let n = input.i32()?;
                            page.n_values =
                                u64::try_from(n).map_err(|_| format!("value count {n}"))?;
                        }
                        (inner, 5) if inner == encoding => page.encoding = Some(input.i32()?),
                        (1, _) => return Err("value count of another type".into()),
                        (inner, _) if inner == encoding => {
                            return Err("encoding of another type".into());
                        }
                        _ => input.skip(kind, 0)?,
                    }
                }
            }
            (1..=3 | 5 | 7 | 8, _) => return Err(format!("field {field} has type {kind}")),
            _ => input.skip(kind, 0)?,
        }
    }
    // `PageType`: 0 = data, 2 = dictionary, 3 = data of version 2. Others have no values that anybody reads.
    let expected = match kind_of_page {
        Some(0) => Some(5),
        Some(2) => Some(7),
        Some(3) => Some(8),
        _ => None,
    };
    if header != expected {
        return Err("a page of another kind than it states".into());
    }
    page.is_dictionary = header == Some(7);
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

/// Fields of a struct that were read. Those of the format have numbers below 64.
#[derive(Default)]
struct Fields {
    last: i64,
    seen: u64,
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

    /// A number of 32 bits, of which the decoder would cut off others.
    fn i32(&mut self) -> Result<i64, String> {
        let value = self.zigzag()?;
        match i32::try_from(value) {
            Ok(_) => Ok(value),
            Err(_) => Err(format!("{value} has more than 32 bits")),
        }
    }

    /// Next field of a struct as (id, type), or `None` at its end.
    fn field(&mut self, fields: &mut Fields) -> Result<Option<(i64, u8)>, String> {
        let head = self.byte()?;
        if head & 0x0f == 0 {
            return Ok(None);
        }
        let id = match head >> 4 {
            0 => self.zigzag()?,
            delta => fields.last + i64::from(delta),
        };
        // The decoder would take the number by its last 16 bits, and the last of two fields.
        let bit = u32::try_from(id).ok().and_then(|id| 1_u64.checked_shl(id));
        let bit = bit.ok_or_else(|| format!("field {id}"))?;
        if fields.seen & bit != 0 {
            return Err(format!("field {id} occurs twice"));
        }
        fields.seen |= bit;
        fields.last = id;
        Ok(Some((id, head & 0x0f)))
    }

    /// The number of elements of a list of structs, whose type is `kind`.
    fn list_of_structs(&mut self, kind: u8) -> Result<u64, String> {
        if kind != 9 {
            return Err(format!("a list has type {kind}"));
        }
        let head = self.byte()?;
        let n = match head >> 4 {
            15 => self.varint()?,
            n => u64::from(n),
        };
        match head & 0x0f {
            12 => Ok(n),
            _ if n == 0 => Ok(0),
            other => Err(format!("elements of a list have type {other}")),
        }
    }

    /// The number of children of a node of the schema.
    fn schema_element(&mut self) -> Result<i64, String> {
        let mut n_children = 0;
        let mut fields = Fields::default();
        while let Some((field, kind)) = self.field(&mut fields)? {
            match (field, kind) {
                (5, 5) => n_children = self.i32()?,
                (5, _) => return Err("number of children of another type".into()),
                _ => self.skip(kind, 0)?,
            }
        }
        Ok(n_children)
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
                let mut fields = Fields::default();
                while let Some((_, kind)) = self.field(&mut fields)? {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::sync::Arc;

    use parquet::basic::Encoding;
    use parquet::data_type::{ByteArray, ByteArrayType};
    use parquet::file::properties::{EnabledStatistics, WriterProperties};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    fn file_of(bytes: &[u8]) -> File {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    /// A field of a number below 64, by its distance from the one before.
    fn number(distance: u8, value: u8) -> [u8; 2] {
        [distance << 4 | 5, value << 1]
    }

    /// Header and no bytes of a data page: `kind` of the page, 7 bytes of data, and the header of data or of a dictionary.
    fn page(kind: u8, headers: &[&[u8]]) -> std::result::Result<PageHeader, String> {
        let mut bytes = [number(1, kind), number(1, 9), number(1, 7)].concat();
        headers.iter().for_each(|header| bytes.extend(*header));
        bytes.push(0);
        let end = bytes.len() as u64 + 7;
        read_page_header(&mut file_of(&bytes), 0, end)
    }

    #[test]
    fn pages_that_a_decoder_could_read_in_another_way_are_refused() {
        // Field 5: 3 values, encoding 0, levels in encoding 3.
        let data = [0x2c, 0x15, 6, 0x15, 0, 0x15, 6, 0x15, 6, 0];
        let read = page(0, &[&data]).unwrap();
        assert_eq!((read.n_values, read.uncompressed_bytes), (3, 9));
        assert_eq!((read.encoding, read.is_dictionary), (Some(0), false));
        // Field 7: 2 values, encoding 0.
        let dictionary = [0x4c, 0x15, 4, 0x15, 0, 0];
        assert!(page(2, &[&dictionary]).unwrap().is_dictionary);
        // Behind field 5, field 7 is two further.
        let both = [0x2c, 0x15, 4, 0x15, 0, 0];
        // A number of 64 bits where the format has 32.
        let wide = [0x2c, 0x16, 6, 0x15, 0, 0];
        // Field 65,541, of which 16 bits are 5.
        let far = [0x0c, 0x8a, 0x80, 0x08, 0x15, 6, 0x15, 0, 0];
        // 2^32 + 3 values.
        let many = [0x2c, 0x15, 0x86, 0x80, 0x80, 0x80, 0x20, 0x15, 0, 0];
        // The number of values twice.
        let twice = [0x2c, 0x15, 6, 0x05, 2, 6, 0];
        for (kind, headers) in [
            (2, &[&data[..]][..]),
            (0, &[&dictionary]),
            (0, &[&data, &both]),
            (0, &[&wide]),
            (0, &[&far]),
            (0, &[&many]),
            (0, &[&twice]),
            (0, &[]),
        ] {
            assert!(page(kind, headers).is_err(), "{headers:?}");
        }
    }

    /// The footer of a schema of groups inside each other around a number, each of which states a number of children.
    fn nested(n_groups: u8, n_children: u8) -> Vec<u8> {
        let group = [0x35, 0, 0x18, 1, b'a', 0x15, n_children << 1, 0];
        let leaf = [0x15, 2, 0x25, 0, 0x18, 1, b'a', 0];
        let mut footer = vec![0x15, 4, 0x19, 0xfc, n_groups + 1];
        footer.extend(group.repeat(n_groups.into()));
        footer.extend(leaf);
        footer.extend([0x16, 0, 0x19, 0x0c, 0]);
        footer
    }

    #[test]
    fn schemas_are_followed_to_a_depth_only() {
        for n_groups in [1, MAX_SCHEMA_DEPTH as u8, MAX_SCHEMA_DEPTH as u8 + 1] {
            let footer = nested(n_groups, 1);
            let checked = check_schema(&mut file_of(&footer), 0, footer.len() as u64);
            let is_deep = usize::from(n_groups) > MAX_SCHEMA_DEPTH;
            assert_eq!(checked.is_err(), is_deep, "{n_groups}: {checked:?}");
            let mut bytes = b"PAR1".to_vec();
            bytes.extend(&footer);
            bytes.extend((footer.len() as u32).to_le_bytes());
            bytes.extend(b"PAR1");
            let limits = Limits {
                file_bytes: 1_000,
                rows: 10,
                chunk_values: 10,
            };
            let opened = open_file(Path::new("deep"), file_of(&bytes), limits);
            assert_eq!(opened.is_err(), is_deep, "{n_groups}");
        }
    }

    #[test]
    fn nodes_have_no_more_children_than_nodes_follow() {
        for (n_groups, n_children, is_right) in [(1, 1, true), (1, 2, false), (9, 60, false)] {
            let footer = nested(n_groups, n_children);
            let checked = check_schema(&mut file_of(&footer), 0, footer.len() as u64);
            assert_eq!(checked.is_ok(), is_right, "{checked:?}");
        }
    }

    /// A file of one column with `n` equal texts, of which all but the first are stored as "like the one before".
    fn repeated(n: usize) -> File {
        let schema = parse_message_type("message m { required binary a (UTF8); }").unwrap();
        let properties = WriterProperties::builder()
            .set_encoding(Encoding::DELTA_BYTE_ARRAY)
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None);
        let mut file = tempfile::tempfile().unwrap();
        let to = file.try_clone().unwrap();
        let mut writer =
            SerializedFileWriter::new(to, Arc::new(schema), Arc::new(properties.build())).unwrap();
        let mut group = writer.next_row_group().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let text = ByteArray::from(vec![b'a'; 4 << 20]);
        column
            .typed::<ByteArrayType>()
            .write_batch(&vec![text; n], None, None)
            .unwrap();
        column.close().unwrap();
        group.close().unwrap();
        writer.close().unwrap();
        file.rewind().unwrap();
        file
    }

    #[test]
    fn texts_that_repeat_the_one_before_are_bounded() {
        let limits = Limits {
            file_bytes: 16 << 20,
            rows: 1_000,
            chunk_values: 1_000,
        };
        assert!(open_file(Path::new("few"), repeated(3), limits).is_ok());
        // 1.2 GB of text in a file of 4 MB.
        let error = open_file(Path::new("many"), repeated(300), limits).err();
        let error = error.unwrap().to_string();
        assert!(error.contains("too much text"), "{error}");
    }
}
