//! NumPy arrays of numbers, alone (npy) or in an archive (npz). Pickled objects are never read.

use crate::error::{MotionError, excerpt};
use std::io::Read;

/// Largest array member accepted, bytes: forty minutes of AMASS at 120 fps are 360 MB.
const MAX_MEMBER_BYTES: u64 = 512 << 20;
/// Most members looked at in an archive; AMASS has about ten.
const MAX_MEMBERS: usize = 256;

/// A numeric array, C order, widened to f64 lazily by [`NpyArray::numbers`].
#[derive(Clone, Debug)]
pub(crate) struct NpyArray {
    pub shape: Vec<usize>,
    descr: String,
    fortran: bool,
    data: Vec<u8>,
}

/// Why a member gave no array.
pub(crate) enum NpyProblem {
    /// Holds pickled Python objects.
    Pickled,
    /// Anything else, as (expected, found).
    Wrong(String, String),
}

/// Parses an npy file held in memory.
pub(crate) fn parse_npy(bytes: Vec<u8>) -> Result<NpyArray, NpyProblem> {
    let wrong = |expected: &str, found: String| NpyProblem::Wrong(expected.into(), found);
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(wrong(
            "an npy array",
            excerpt(&String::from_utf8_lossy(&bytes[..bytes.len().min(12)])),
        ));
    }
    let (header_len, start): (usize, usize) = match (bytes.get(6), bytes.len()) {
        (Some(1), 10..) => (usize::from(u16::from_le_bytes([bytes[8], bytes[9]])), 10),
        (Some(2 | 3), 12..) => (
            u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize,
            12,
        ),
        _ => {
            return Err(wrong(
                "npy version 1 to 3",
                "another version or a cut header".into(),
            ));
        }
    };
    let Some(header) = bytes.get(start..start.saturating_add(header_len)) else {
        return Err(wrong(
            "a whole npy header",
            format!("a file of {} bytes", bytes.len()),
        ));
    };
    let header = String::from_utf8_lossy(header).into_owned();
    let field = |name: &str| -> Option<&str> {
        let at = header.find(&format!("'{name}'"))? + name.len() + 2;
        Some(header[at..].trim_start().strip_prefix(':')?.trim_start())
    };
    let descr = field("descr").unwrap_or("");
    if descr.starts_with("'|O") || descr.starts_with('[') && descr.contains("O'") {
        return Err(NpyProblem::Pickled);
    }
    let descr = descr
        .strip_prefix('\'')
        .and_then(|d| d.split('\'').next())
        .unwrap_or("")
        .to_owned();
    let fortran = field("fortran_order").is_some_and(|f| f.starts_with("True"));
    let shape: Option<Vec<usize>> = field("shape")
        .and_then(|s| s.strip_prefix('('))
        .and_then(|s| s.split(')').next())
        .and_then(|s| {
            s.split(',')
                .map(str::trim)
                .filter(|d| !d.is_empty())
                .map(|d| d.parse().ok())
                .collect()
        });
    let Some(shape) = shape else {
        return Err(wrong("a shape", excerpt(&header)));
    };
    // Strings and other kinds parse too (AMASS stores the gender so); only numbers() needs a type.
    let item_bytes: Option<usize> = match descr.get(1..2) {
        Some("U") => descr[2..]
            .parse::<usize>()
            .ok()
            .and_then(|n| n.checked_mul(4)),
        Some(_) if descr.is_char_boundary(2) => descr[2..].parse().ok(),
        _ => None,
    };
    let Some(item_bytes) = item_bytes.filter(|_| shape.len() <= 8) else {
        return Err(wrong("a type of fixed size", excerpt(&descr)));
    };
    let count = shape.iter().try_fold(1_usize, |a, b| a.checked_mul(*b));
    let wanted = count.and_then(|c| c.checked_mul(item_bytes));
    let data = bytes[start + header_len..].to_vec();
    if wanted != Some(data.len()) {
        return Err(wrong(
            "as many bytes as shape and type say",
            format!("{} bytes for shape {shape:?} of {descr}", data.len()),
        ));
    }
    Ok(NpyArray {
        shape,
        descr,
        fortran,
        data,
    })
}

impl NpyArray {
    /// All values in C order as f64; `None` if the array holds no real numbers.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        fn read<const N: usize>(data: &[u8], big: bool, f: impl Fn([u8; N]) -> f64) -> Vec<f64> {
            data.chunks_exact(N)
                .map(|chunk| {
                    let mut word = [0; N];
                    word.copy_from_slice(chunk);
                    if big {
                        word.reverse();
                    }
                    f(word)
                })
                .collect()
        }
        let big = self.descr.starts_with('>');
        let values = match self.descr.get(1..)? {
            "f8" => read(&self.data, big, f64::from_le_bytes),
            "f4" => read(&self.data, big, |w| f64::from(f32::from_le_bytes(w))),
            "i8" => read(&self.data, big, |w| i64::from_le_bytes(w) as f64),
            "i4" => read(&self.data, big, |w| f64::from(i32::from_le_bytes(w))),
            "i2" => read(&self.data, big, |w| f64::from(i16::from_le_bytes(w))),
            "u8" => read(&self.data, big, |w| u64::from_le_bytes(w) as f64),
            "u4" => read(&self.data, big, |w| f64::from(u32::from_le_bytes(w))),
            "u1" | "b1" => self.data.iter().map(|b| f64::from(*b)).collect(),
            _ => return None,
        };
        Some(if self.fortran && self.shape.len() > 1 {
            c_order(&values, &self.shape)
        } else {
            values
        })
    }

    /// Text of a string array of one element.
    pub fn text(&self) -> Option<String> {
        let text: String = match self.descr.get(1..2)? {
            "U" => self
                .data
                .chunks_exact(4)
                .filter_map(|c| char::from_u32(u32::from_le_bytes([c[0], c[1], c[2], c[3]])))
                .collect(),
            "S" => String::from_utf8_lossy(&self.data).into_owned(),
            _ => return None,
        };
        // AMASS also writes b'male' through str().
        Some(
            text.trim_matches(['\0', ' ', '\''])
                .trim_start_matches("b'")
                .chars()
                .take(40)
                .collect(),
        )
    }

    /// Element type as NumPy writes it.
    pub fn descr(&self) -> &str {
        &self.descr
    }
}

/// Fortran order to C order.
fn c_order(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let mut index = vec![0_usize; shape.len()];
    let mut out = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        let mut at = 0;
        for (i, n) in index.iter().zip(shape).rev() {
            at = at * n + i;
        }
        out.push(values[at]);
        for (i, n) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < *n {
                break;
            }
            *i = 0;
        }
    }
    out
}

/// Arrays with their names.
pub(crate) type NamedArrays = Vec<(String, NpyArray)>;

/// Arrays of an npz archive by name, and what was passed over with the reason.
pub(crate) fn read_npz(
    file: &str,
    bytes: &[u8],
    wanted: &[&str],
) -> Result<(NamedArrays, Vec<String>), MotionError> {
    let member_error = |member: &str, expected: String, found: String| MotionError::Member {
        file: file.into(),
        member: member.into(),
        expected,
        found,
    };
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes))
        .map_err(|e| member_error("archive", "an npz (zip) archive".into(), e.to_string()))?;
    if archive.len() > MAX_MEMBERS {
        return Err(member_error(
            "archive",
            format!("at most {MAX_MEMBERS} members"),
            archive.len().to_string(),
        ));
    }
    let mut arrays = Vec::new();
    let mut skipped = Vec::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).map_err(|e| {
            member_error(
                &format!("member {i}"),
                "a readable member".into(),
                e.to_string(),
            )
        })?;
        let full = entry.name().map_err(|e| {
            member_error(
                &format!("member {i}"),
                "a readable name".into(),
                e.to_string(),
            )
        })?;
        let full: String = full.chars().filter(|c| !c.is_control()).take(80).collect();
        let Some(name) = full.strip_suffix(".npy") else {
            skipped.push(format!("{full} (not an array)"));
            continue;
        };
        if !wanted.contains(&name) {
            // The head shows whether the member is a pickle; the rest is not even inflated.
            let mut head = Vec::new();
            let _ = entry.by_ref().take(4096).read_to_end(&mut head);
            let pickled = String::from_utf8_lossy(&head).contains("'|O'");
            skipped.push(format!(
                "{name} ({})",
                if pickled {
                    "pickled objects, never read"
                } else {
                    "not needed"
                }
            ));
            continue;
        }
        // The stated size may lie: the vector grows with what really comes out.
        let mut data = Vec::new();
        let n = entry
            .by_ref()
            .take(MAX_MEMBER_BYTES + 1)
            .read_to_end(&mut data)
            .map_err(|e| member_error(name, "a readable member".into(), e.to_string()))?;
        if n as u64 > MAX_MEMBER_BYTES {
            return Err(member_error(
                name,
                format!("at most {MAX_MEMBER_BYTES} bytes"),
                "more".into(),
            ));
        }
        match parse_npy(data) {
            Ok(array) => arrays.push((name.to_owned(), array)),
            Err(NpyProblem::Pickled) => {
                skipped.push(format!("{name} (pickled objects, never read)"))
            }
            Err(NpyProblem::Wrong(expected, found)) => {
                return Err(member_error(name, expected, found));
            }
        }
    }
    Ok((arrays, skipped))
}
