//! Points in plain tables: CSV with or without a header, and npy with named columns or with seven unnamed ones.
//!
//! Columns are identified by name, in any order; other columns are ignored. The names are `frame` and `t_s` (one of the
//! two is sufficient), `x, y, z` in m, `velocity` in m/s and `intensity` in dB. Common alternatives such as `x_mm`,
//! `t_ms`, `doppler`, `snr_db`, `amplitude`, `range`, `azimuth` and `elevation` are accepted; `WORDS` in `columns.rs` lists
//! them. A plain npy array has the columns of [`PLAIN_COLUMNS`], or those that the caller names.
//!
//! Where a name states no unit, the values decide: times by their size and steps (`clock.rs`), whole numbers beyond any SNR
//! are tenths of dB, and angles beyond 6.3 are degrees. What was decided is a note.

mod clock;
mod columns;
mod frames;

use std::cell::Cell as Shared;

use columns::Columns;
pub use columns::PLAIN_COLUMNS;
pub(crate) use columns::{
    Column, Meaning, Unit, is_point_column, meaning, missing, missing_of_point,
};
pub(crate) use frames::angles_to_position;
pub use frames::unlikely_snr;
use frames::{Cell, FrameBuilder};
use radarllm_files::npy::NpyArray;

use crate::recordings::{Axes, Place, RecordedFrame, RecordingError, printable};

/// Content of a points table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointsTable {
    /// Frames in order. Times are in s and do not decrease.
    pub frames: Vec<RecordedFrame>,
    /// How often the frame numbers went back. Their frames follow on.
    pub number_restarts: u64,
    /// Notes for the user: what the values show about units, what was left out.
    pub notes: Vec<String>,
    /// The notes of which a user should know before trusting the points.
    pub warnings: Vec<String>,
    /// Why the times of the table cannot be used, if it has times. The frames have none then.
    pub clock_error: Option<RecordingError>,
}

impl PointsTable {
    fn warn(&mut self, text: String) {
        self.notes.push(text.clone());
        self.warnings.push(text);
    }
}

/// Names in a list by which a caller skips a column.
const SKIPPED: [&str; 3] = ["-", "_", ""];

/// The names of columns in a list such as `frame,-,x,y,z,v,snr`.
fn named_columns(list: &str) -> Vec<&str> {
    let names = list.split(',').map(str::trim);
    names
        .map(|name| if SKIPPED.contains(&name) { "" } else { name })
        .collect()
}

/// Checks names that a caller gave: each one must be that of a column.
fn check_named(place: Place, names: &[&str]) -> Result<(), RecordingError> {
    match names.iter().find(|n| !n.is_empty() && meaning(n).is_none()) {
        Some(name) => Err(RecordingError::new(
            place,
            "names of columns such as frame, t_s, x, y, z, velocity and intensity, or `-` for a column to skip",
            name,
        )),
        None => Ok(()),
    }
}

/// The character between the cells of a table, and its first row.
pub(crate) struct FirstRow {
    pub(crate) separator: u8,
    pub(crate) cells: Vec<String>,
    /// Number of bytes before the row: a line `sep=;`, which Excel reads, and comments.
    start: usize,
}

impl FirstRow {
    /// Whether no cell is the name of a column, and as many are numbers as are not.
    pub(crate) fn is_of_numbers(&self) -> bool {
        let is_number = |cell: &&String| cell.trim().parse::<f64>().is_ok();
        2 * self.cells.iter().filter(is_number).count() >= self.cells.len()
    }
}

/// Reads the first row of a text. Cells are separated by `,`, `;` or tab, whichever the row has most of outside of quotes.
pub(crate) fn first_row(text: &str) -> FirstRow {
    let body = text.trim_start_matches('\u{feff}');
    let mut start = text.len() - body.len();
    let line = body.lines().next().unwrap_or_default();
    let mut separator = None;
    if let Some(&[named]) = line.trim().strip_prefix("sep=").map(str::as_bytes)
        && b",;\t|".contains(&named)
    {
        separator = Some(named);
        start += body.find('\n').map_or(body.len(), |n| n + 1);
    }
    start += comments_before(&text[start..]);
    let row = text[start..].lines().find(|l| !l.trim().is_empty());
    let mut is_quoted = false;
    let mut counts = [(b',', 0), (b';', 0), (b'\t', 0)];
    for byte in row.unwrap_or_default().bytes() {
        is_quoted ^= byte == b'"';
        for (separator, n) in &mut counts {
            *n += usize::from(!is_quoted && byte == *separator);
        }
    }
    let usual = counts.iter().rev().max_by_key(|(_, n)| *n);
    let separator = separator.or(usual.map(|(s, _)| *s)).unwrap_or(b',');
    let mut record = csv::StringRecord::new();
    let _ = rows(&text.as_bytes()[start..], separator).read_record(&mut record);
    FirstRow {
        separator,
        cells: record.iter().map(str::to_owned).collect(),
        start,
    }
}

/// Number of bytes of the lines before a table that begin with `#` and are no header, as recorders write notes there. A line
/// that names columns is a header, as `numpy.savetxt` writes it.
fn comments_before(text: &str) -> usize {
    let mut n_bytes = 0;
    for line in text.split_inclusive('\n') {
        let content = line.trim();
        let names = content.split([',', ';', '\t']);
        let is_header = names.filter(|name| is_point_column(name)).count() >= 2;
        if !content.is_empty() && (!content.starts_with('#') || is_header) {
            return n_bytes;
        }
        n_bytes += line.len();
    }
    // Nothing but comments.
    0
}

/// A reader of rows of any length with cells that may be quoted (RFC 4180).
fn rows(bytes: &[u8], separator: u8) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new()
        .delimiter(separator)
        .has_headers(false)
        .flexible(true)
        .from_reader(bytes)
}

/// The line, from 1, of the first character after the line breaks at a byte of a text.
fn line_of(text: &[u8], byte: usize) -> Place {
    let breaks = |b: &&u8| matches!(b, b'\n' | b'\r');
    let rest = text.get(byte..).unwrap_or_default();
    let start = byte + rest.iter().take_while(breaks).count();
    let before = text.get(..start.min(text.len())).unwrap_or_default();
    Place::Line(1 + before.iter().filter(|b| **b == b'\n').count())
}

/// How the cells of a table are written.
struct Cells {
    separator: u8,
    /// The first decimal mark: a table has points or commas, never both.
    decimal: Shared<Option<u8>>,
}

impl Cells {
    /// The content of a cell; `Err` with what was expected.
    fn read(&self, column: Column, name: &str, cell: &str) -> Result<Cell, String> {
        let cell = cell.trim();
        let is_nothing = ["", "na", "n/a", "null", "none", "-"];
        if is_nothing.iter().any(|n| cell.eq_ignore_ascii_case(n)) {
            return Ok(Cell::Empty);
        }
        if let Some(value) = self.number(cell)? {
            return Ok(match value.is_finite() {
                true => Cell::Number(value),
                false => Cell::Empty,
            });
        }
        let what = match column {
            Column::Time => match clock::parse_date(cell) {
                Some(time) => return Ok(Cell::Time(time)),
                None => "a number or a date with time",
            },
            _ => "a number",
        };
        Err(format!("{what} for `{}`", printable(name)))
    }

    /// A number with a decimal point, or with a decimal comma where semicolons separate the cells, as spreadsheets write
    /// them in much of Europe. A comma between thousands would read the same, so that both marks in one table are an error.
    fn number(&self, cell: &str) -> Result<Option<f64>, String> {
        let commas = cell.bytes().filter(|b| *b == b',').count();
        let mark = match (self.separator == b';', commas, cell.contains('.')) {
            (true, 1, false) => b',',
            (true, 0, true) => b'.',
            _ => return Ok(cell.parse().ok()),
        };
        let Ok(value) = cell.replace(',', ".").parse() else {
            return Ok(None);
        };
        match self.decimal.get() {
            Some(first) if first != mark => Err(format!(
                "a decimal `{}` as in the rows before",
                char::from(first)
            )),
            _ => {
                self.decimal.set(Some(mark));
                Ok(Some(value))
            }
        }
    }
}

/// Reads a CSV table. Its first row names the columns, unless `columns` does: a list of names with `-` or `_` for columns to
/// skip. Cells are separated by `,`, `;` or tab and may be quoted (RFC 4180).
///
/// Points with an empty cell are left out and counted, and so is a last row that is cut short. Rows that repeat the first
/// one are skipped.
///
/// # Errors
/// [`RecordingError`] with the line: missing columns by name, rows of another length, or values that are not numbers.
pub fn read_points_csv(
    text: &str,
    axes: Axes,
    columns: Option<&str>,
) -> Result<PointsTable, RecordingError> {
    let first = first_row(text);
    let body = &text.as_bytes()[first.start..];
    let in_text = |byte: u64| line_of(text.as_bytes(), first.start + byte as usize);
    let header: Vec<&str> = first.cells.iter().map(String::as_str).collect();
    let names = columns.map_or_else(|| header.clone(), named_columns);
    if columns.is_some() {
        check_named(in_text(0), &names)?;
    }
    let columns_by_name = Columns::find(in_text(0), &names)?;
    let used: Vec<usize> = columns_by_name.placed.iter().map(|p| p.at).collect();
    let cells = Cells {
        separator: first.separator,
        decimal: Shared::new(None),
    };
    let mut builder = FrameBuilder::new(columns_by_name, axes);
    let mut record = csv::StringRecord::new();
    let mut reader = rows(body, first.separator);
    // Whether the first row is a header is seen at that row, if the caller names the columns.
    let mut has_header = columns.is_none();
    let (mut n_rows, mut n_headers) = (0, 0);
    let mut is_cut = false;
    loop {
        let at = reader.position().byte();
        let wrong =
            |expected: String, found: &str| RecordingError::new(in_text(at), expected, found);
        match reader.read_record(&mut record) {
            Ok(true) => {}
            Ok(false) => break,
            Err(e) => return Err(wrong("a row of a table".into(), &e.to_string())),
        }
        let cell = |column: usize| record.get(column).unwrap_or_default();
        let is_name = |&at: &usize| {
            let cell = cell(at).trim();
            let is_number = cells.number(cell).is_ok_and(|value| value.is_some());
            !cell.is_empty() && !is_number && clock::parse_date(cell).is_none()
        };
        has_header |= n_rows == 0 && used.iter().all(is_name);
        n_rows += 1;
        if has_header && record.iter().eq(header.iter().copied()) {
            n_headers += 1;
            continue;
        }
        if record.iter().all(|c| c.trim().is_empty()) && record.len() != names.len() {
            continue;
        }
        let surplus = record.iter().skip(names.len());
        if record.len() < names.len() || surplus.into_iter().any(|c| !c.trim().is_empty()) {
            // The recorder was stopped while it wrote.
            if reader.position().byte() >= body.len() as u64
                && !text.ends_with(['\n', '\r'])
                && record.len() < names.len()
            {
                is_cut = true;
                break;
            }
            let row: Vec<&str> = record.iter().collect();
            let row = row.join(&char::from(first.separator).to_string());
            return Err(wrong(format!("{} cells", names.len()), &row));
        }
        builder
            .push(Place::Byte(at), |at_column, column| {
                let name = names.get(at_column).copied().unwrap_or_default();
                cells
                    .read(column, name, cell(at_column))
                    .map_err(|expected| wrong(expected, cell(at_column)))
            })
            .map_err(|e| match e.at {
                Place::Byte(byte) => RecordingError {
                    at: in_text(byte),
                    ..e
                },
                _ => e,
            })?;
    }
    let mut table = builder.finish(in_text(0))?;
    if n_headers > 1 {
        table.notes.push(format!(
            "the header stands {n_headers} times in the table: it was written by several runs"
        ));
    }
    if columns.is_some() && n_headers > 0 {
        table
            .notes
            .push("the first row holds no numbers and was left out, because the columns are named by the caller".into());
    }
    if is_cut {
        table.warn("the last row is cut short and was left out".into());
    }
    if cells.decimal.get() == Some(b',') {
        table
            .notes
            .push("cells are separated by `;`: a comma is the decimal mark".into());
    }
    Ok(table)
}

/// Reads an npy table: a structured array with named columns, or a plain array of shape (rows, 7) or, with `columns` as in
/// [`read_points_csv`], of as many columns as these are; or frames that were filled up with zeros, of shape (frames, points,
/// 5) with [`FRAME_COLUMNS`].
///
/// # Errors
/// [`RecordingError`] with the byte or row, as for [`read_points_csv`]; also for pickled arrays.
pub fn read_points_npy(
    bytes: &[u8],
    axes: Axes,
    columns: Option<&str>,
) -> Result<PointsTable, RecordingError> {
    let array = NpyArray::new(bytes)?;
    let shape = array.header.shape.clone();
    let fields = &array.header.fields;
    let has_names = fields.first().is_some_and(|f| !f.name.is_empty());
    if let ([n_frames, n_points, 5], false, None) = (shape.as_slice(), has_names, columns) {
        return read_frames(&array, *n_frames as usize, *n_points as usize, axes);
    }
    let names: Vec<&str> = match columns {
        Some(list) => named_columns(list),
        None if has_names => fields.iter().map(|f| f.name.as_str()).collect(),
        None => PLAIN_COLUMNS.to_vec(),
    };
    check_named(Place::Byte(0), if columns.is_some() { &names } else { &[] })?;
    let n = names.len();
    let n_rows = match (has_names, shape.as_slice()) {
        (true, [_]) if n == fields.len() => array.len(),
        (false, [_, width]) if *width == n as u64 => array.len() / n,
        _ => {
            return Err(RecordingError::new(
                Place::Byte(0),
                format!("named columns and one dimension, or shape (rows, {n})"),
                &format!("{shape:?}"),
            ));
        }
    };
    let mut builder = FrameBuilder::new(Columns::find(Place::Byte(0), &names)?, axes);
    for row in 0..n_rows {
        builder.push(Place::Row(row), |column, _| {
            let value = match has_names {
                true => array.value(row, column),
                false => array.value(row * n + column, 0),
            };
            Ok(match value.is_finite() {
                true => Cell::Number(value),
                false => Cell::Empty,
            })
        })?;
    }
    builder.finish(Place::Byte(0))
}

/// Columns of the points of frames that were filled up to one number of points.
pub const FRAME_COLUMNS: [&str; 5] = ["x", "y", "z", "velocity", "intensity"];

/// Reads an array of shape (frames, points, 5).
fn read_frames(
    array: &NpyArray<'_>,
    n_frames: usize,
    n_points: usize,
    axes: Axes,
) -> Result<PointsTable, RecordingError> {
    let mut names = vec!["frame"];
    names.extend(FRAME_COLUMNS);
    let mut builder = FrameBuilder::new(Columns::find(Place::Byte(0), &names)?, axes);
    for row in 0..n_frames.saturating_mul(n_points).min(array.len() / 5) {
        builder.push(Place::Row(row), |column, _| {
            let value = match column.checked_sub(1) {
                None => (row / n_points) as f64,
                Some(column) => array.value(row * FRAME_COLUMNS.len() + column, 0),
            };
            Ok(match value.is_finite() {
                true => Cell::Number(value),
                false => Cell::Empty,
            })
        })?;
    }
    builder.finish(Place::Byte(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "frame,t_ms,X [m],y_mm,z,Doppler (m/s),snr_db,note\n\
                        3,100,0.5,2000,-1,0.25,20,a\n\
                        3,100,0,1000,0,0,10,b\n\
                        5,300,0,1000,0,0,10,c\n";

    fn read(text: &str) -> Result<PointsTable, RecordingError> {
        read_points_csv(text, Axes::RightForwardUp, None)
    }

    #[test]
    fn names_and_units_are_understood() {
        let frames = read(GOOD).unwrap().frames;
        assert_eq!(frames.len(), 2);
        assert_eq!((frames[0].number, frames[0].stamp_s), (3, Some(0.1)));
        let p = frames[0].points[0];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
            [0.5, 2.0, -1.0, 0.25, 20.0]
        );
        let turned = read_points_csv(GOOD, Axes::ForwardLeftUp, None)
            .unwrap()
            .frames;
        assert_eq!(
            (turned[0].points[0].x_m, turned[0].points[0].y_m),
            (-2.0, 0.5)
        );
        let semicolons = GOOD.replace(',', ";");
        assert_eq!(read(&semicolons).unwrap().frames, frames);
    }

    /// TI's example script for the out-of-box demo writes SNR and noise as the firmware sends them.
    #[test]
    fn tables_with_detobj_have_tenths_of_decibels() {
        let text = "frame,DetObj#,x,y,z,v,snr,noise\n0,0,0,3,-0.8,0.1,150,700\n";
        let frames = read(text).unwrap().frames;
        assert_eq!(frames[0].points[0].intensity_db, 15.0);
    }

    #[test]
    fn missing_columns_are_named() {
        let error = read("frame,x,y\n").unwrap_err();
        assert!(
            error.to_string().contains("columns z, velocity (see"),
            "{error}"
        );
        let error = read("x,y,z,v,snr\n").unwrap_err();
        assert!(error.to_string().contains("frame or t_s"), "{error}");
        let error = read("frame,x,y,z,v,snr,x_mm\n").unwrap_err();
        assert!(error.to_string().contains("one column for x"), "{error}");
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let at = |text: String| read(&text).unwrap_err().at;
        assert_eq!(at(GOOD.replace("2000", "far")), Place::Line(2));
        assert_eq!(at(GOOD.replace("10,b", "10")), Place::Line(3));
        assert_eq!(at(GOOD.replace("5,300", "5.5,300")), Place::Line(4));
        let crlf = GOOD.replace('\n', "\r\n\r\n").replace("5,300", "5.5,300");
        assert_eq!(at(crlf), Place::Line(7));
    }
}
