//! Numeric members of an `.npz` archive.
//!
//! Only plain little- or big-endian integers and floats are read. Members that hold Python
//! objects (pickles) are named and skipped, never executed.

use super::BodyError;
use npyz::{DType, NpyFile, Order, TypeChar};
use std::io::{Read, Seek};

/// Most values one member may have: SMPL-X's largest (10,475 x 3 x 486) has 15 million.
const MAX_VALUES: u64 = 64 << 20;
/// Most members of an archive.
const MAX_MEMBERS: usize = 256;

/// One member, in C order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// The wanted members of an archive.
pub(super) struct Npz {
    members: Vec<(String, Array)>,
    /// Names of pickled members that were passed over.
    pub skipped: Vec<String>,
}

impl Npz {
    /// Reads those of the `wanted` members that are numeric; other members are only looked at to
    /// name the pickles.
    pub fn read(source: impl Read + Seek, wanted: &[&str]) -> Result<Self, BodyError> {
        let archive_error = |e: zip::result::ZipError| BodyError::Archive {
            reason: e.to_string(),
        };
        let mut archive = zip::ZipArchive::new(source).map_err(archive_error)?;
        if archive.len() > MAX_MEMBERS {
            return Err(BodyError::Archive {
                reason: format!("{} members, at most {MAX_MEMBERS}", archive.len()),
            });
        }
        let mut npz = Self {
            members: Vec::new(),
            skipped: Vec::new(),
        };
        for index in 0..archive.len() {
            let entry = archive.by_index(index).map_err(archive_error)?;
            let file_name = entry.name().map_err(archive_error)?.to_string();
            let Some(name) = file_name.strip_suffix(".npy") else {
                continue;
            };
            let is_wanted = wanted.contains(&name);
            // Headers are a few hundred bytes; whatever claims more is cut off there.
            let byte_limit = if is_wanted {
                8 * MAX_VALUES + (1 << 16)
            } else {
                1 << 16
            };
            let file = match NpyFile::new(entry.take(byte_limit)) {
                Ok(file) => file,
                Err(_) if !is_wanted => continue,
                Err(e) => {
                    return Err(BodyError::Member {
                        member: name.into(),
                        reason: e.to_string(),
                    });
                }
            };
            if file.uses_pickled_array() {
                npz.skipped.push(name.into());
            } else if is_wanted {
                let array = read_array(file).map_err(|reason| BodyError::Member {
                    member: name.into(),
                    reason,
                })?;
                npz.members.push((name.into(), array));
            }
        }
        Ok(npz)
    }

    /// Takes a member out; `None` if it is absent or was pickled.
    pub fn take(&mut self, name: &str) -> Option<Array> {
        let at = self.members.iter().position(|(n, _)| n == name)?;
        Some(self.members.swap_remove(at).1)
    }
}

fn read_array(file: NpyFile<impl Read>) -> Result<Array, String> {
    let mut n_values = 1u64;
    let mut shape = Vec::with_capacity(file.shape().len().min(8));
    for &n in file.shape() {
        n_values = n_values
            .checked_mul(n)
            .filter(|&n| n <= MAX_VALUES)
            .ok_or("too many values")?;
        shape.push(n as usize);
    }
    if shape.len() > 3 {
        return Err(format!("{} axes, at most 3", shape.len()));
    }
    let order = file.order();
    let DType::Plain(kind) = file.dtype() else {
        return Err("a structured type".into());
    };
    let bytes = kind.size_field();
    let values = match (kind.type_char(), bytes) {
        (TypeChar::Float, 8) => collect::<f64>(file, n_values, |v| v as f32),
        (TypeChar::Float, 4) => collect::<f32>(file, n_values, |v| v),
        (TypeChar::Int, 8) => collect::<i64>(file, n_values, |v| v as f32),
        (TypeChar::Int, 4) => collect::<i32>(file, n_values, |v| v as f32),
        (TypeChar::Int, 2) => collect::<i16>(file, n_values, f32::from),
        (TypeChar::Uint, 8) => collect::<u64>(file, n_values, |v| v as f32),
        (TypeChar::Uint, 4) => collect::<u32>(file, n_values, |v| v as f32),
        (TypeChar::Uint, 2) => collect::<u16>(file, n_values, f32::from),
        _ => Err(format!(
            "numbers of type {kind}; floats of 32 or 64 and integers of 16 to 64 bits are read"
        )),
    }?;
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        return Err(format!("entry {at} is {}", values[at]));
    }
    let values = if order == Order::Fortran {
        to_c_order(&shape, &values)
    } else {
        values
    };
    Ok(Array { shape, values })
}

/// Reads exactly `n_values`; memory grows with what is really there.
fn collect<T: npyz::Deserialize>(
    file: NpyFile<impl Read>,
    n_values: u64,
    to_f32: fn(T) -> f32,
) -> Result<Vec<f32>, String> {
    let mut values = Vec::new();
    for value in file.data::<T>().map_err(|e| e.to_string())? {
        values.push(to_f32(value.map_err(|e| {
            format!("after {} of {n_values} values: {e}", values.len())
        })?));
    }
    if values.len() as u64 == n_values {
        Ok(values)
    } else {
        Err(format!("{} of {n_values} values", values.len()))
    }
}

/// Reorders values stored with the first axis fastest.
fn to_c_order(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut at = vec![0usize; shape.len()];
    (0..values.len())
        .map(|_| {
            let (mut index, mut stride) = (0, 1);
            for (k, &n) in shape.iter().enumerate() {
                index += at[k] * stride;
                stride *= n;
            }
            for k in (0..shape.len()).rev() {
                at[k] += 1;
                if at[k] < shape[k] {
                    break;
                }
                at[k] = 0;
            }
            values[index]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fortran_order_is_undone() {
        // [[0, 1, 2], [3, 4, 5]] stored by columns.
        assert_eq!(
            to_c_order(&[2, 3], &[0.0, 3.0, 1.0, 4.0, 2.0, 5.0]),
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        );
    }

    #[test]
    fn garbage_is_refused() {
        let read = |bytes: &[u8]| Npz::read(std::io::Cursor::new(bytes.to_vec()), &["f"]);
        assert!(matches!(read(b"not a zip"), Err(BodyError::Archive { .. })));
        assert!(matches!(read(b""), Err(BodyError::Archive { .. })));
    }
}
