//! Reads arrays of an npz archive by name.

use std::io::{Read, Seek};

use super::{MAX_HEADER_BYTES, NpyArray, NpyError, read_npy_header, wrong};

/// Maximum size of a member, bytes. Forty minutes of AMASS at 120 frames/s are 360 MB.
const MAX_MEMBER_BYTES: u64 = 512 << 20;
/// Maximum number of members of an archive. AMASS has about ten.
const MAX_MEMBERS: usize = 256;

/// The requested arrays of an archive.
#[derive(Debug)]
pub struct Npz {
    /// Arrays with their names, in the archive's order.
    pub arrays: Vec<(String, NpyArray<'static>)>,
    /// Members that were not read.
    pub skipped: Vec<Skipped>,
}

/// Reason why a member was not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// It contains Python objects, which are never read.
    Pickled(String),
    /// It was not requested.
    NotNeeded(String),
    /// It is not an npy file.
    NotAnArray(String),
}

/// Reason why an archive cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// Not a zip archive, or one with too many members.
    #[error("expected {expected}, found {found}")]
    Archive {
        /// What the format requires.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A requested member is damaged or too large.
    #[error("{member}: {source}")]
    Member {
        /// Name of the array.
        member: String,
        /// The problem with the member.
        source: NpyError,
    },
}

impl Npz {
    /// Reads the members named in `wanted`. Of other members, only the header is decompressed, to distinguish pickles
    /// from arrays.
    ///
    /// # Errors
    /// [`NpzError`]. A requested member with Python objects is not an error; it is listed in [`Npz::skipped`].
    pub fn read(source: impl Read + Seek, wanted: &[&str]) -> Result<Self, NpzError> {
        let mut archive = zip::ZipArchive::new(source).map_err(|e| NpzError::Archive {
            expected: "an npz (zip) archive".into(),
            found: e.to_string(),
        })?;
        if archive.len() > MAX_MEMBERS {
            return Err(NpzError::Archive {
                expected: format!("at most {MAX_MEMBERS} members"),
                found: archive.len().to_string(),
            });
        }
        let (mut arrays, mut skipped) = (Vec::new(), Vec::new());
        for index in 0..archive.len() {
            let unreadable = |e: zip::result::ZipError| NpzError::Archive {
                expected: format!("a readable member {index}"),
                found: e.to_string(),
            };
            let mut entry = archive.by_index(index).map_err(unreadable)?;
            let full = entry.name().map_err(unreadable)?;
            let full: String = full.chars().filter(|c| !c.is_control()).take(80).collect();
            let Some(name) = full.strip_suffix(".npy") else {
                skipped.push(Skipped::NotAnArray(full));
                continue;
            };
            if !wanted.contains(&name) {
                let mut head = Vec::new();
                // A read error is ignored because this member was not requested.
                let _ = (&mut entry)
                    .take(MAX_HEADER_BYTES as u64 + 12)
                    .read_to_end(&mut head);
                let is_pickled = read_npy_header(&head).is_err_and(|e| e.is_pickled);
                skipped.push(if is_pickled {
                    Skipped::Pickled(name.into())
                } else {
                    Skipped::NotNeeded(name.into())
                });
                continue;
            }
            let fail = |source| NpzError::Member {
                member: name.into(),
                source,
            };
            // The declared size is not trusted: the vector grows with the decompressed bytes.
            let mut bytes = Vec::new();
            (&mut entry)
                .take(MAX_MEMBER_BYTES + 1)
                .read_to_end(&mut bytes)
                .map_err(|e| fail(wrong(bytes.len(), "a readable member", &e.to_string())))?;
            if bytes.len() as u64 > MAX_MEMBER_BYTES {
                let expected = format!("at most {MAX_MEMBER_BYTES} bytes");
                return Err(fail(wrong(MAX_MEMBER_BYTES as usize, expected, "more")));
            }
            match NpyArray::of_any_type(bytes) {
                Ok(array) => arrays.push((name.to_owned(), array)),
                Err(e) if e.is_pickled => skipped.push(Skipped::Pickled(name.into())),
                Err(e) => return Err(fail(e)),
            }
        }
        Ok(Self { arrays, skipped })
    }

    /// Removes an array and returns it; `None` if it is absent or was skipped.
    pub fn take(&mut self, name: &str) -> Option<NpyArray<'static>> {
        let at = self.arrays.iter().position(|(n, _)| n == name)?;
        Some(self.arrays.swap_remove(at).1)
    }

    /// Names of the members that contain Python objects.
    pub fn pickled(&self) -> impl Iterator<Item = &str> {
        self.skipped.iter().filter_map(|member| match member {
            Skipped::Pickled(name) => Some(name.as_str()),
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::npy;
    use super::*;
    use std::io::{Cursor, Write};

    fn archive(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in members {
            let options = zip::write::SimpleFileOptions::default();
            writer.start_file(*name, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }

    #[test]
    fn wanted_arrays_are_read_and_the_others_named() {
        let bytes = archive(&[
            ("a.npy", npy("'|u1'", "False", "(2,)", &[3, 4])),
            ("b.npy", npy("'|u1'", "False", "(1,)", &[5])),
            ("c.npy", npy("'|O'", "False", "(1,)", b"\x80\x04K\x01.")),
            ("d.npy", npy("'|O'", "False", "(1,)", b"\x80\x04K\x01.")),
            ("readme.txt", b"text".to_vec()),
        ]);
        let mut npz = Npz::read(Cursor::new(&bytes), &["a", "d", "e"]).unwrap();
        assert_eq!(npz.take("a").unwrap().numbers(), Some(vec![3.0, 4.0]));
        assert!(npz.take("d").is_none() && npz.take("b").is_none());
        assert_eq!(npz.pickled().collect::<Vec<_>>(), ["c", "d"]);
        assert!(npz.skipped.contains(&Skipped::NotNeeded("b".into())));
        assert!(
            npz.skipped
                .contains(&Skipped::NotAnArray("readme.txt".into()))
        );
    }

    #[test]
    fn damage_is_refused() {
        for bytes in [&b""[..], b"not a zip"] {
            let error = Npz::read(Cursor::new(bytes), &[]).unwrap_err();
            assert!(matches!(error, NpzError::Archive { .. }), "{error}");
        }
        let bytes = archive(&[("a.npy", npy("'<f4'", "False", "(9,)", &[0; 8]))]);
        let error = Npz::read(Cursor::new(&bytes), &["a"])
            .unwrap_err()
            .to_string();
        assert!(
            error.starts_with("a: byte ") && error.contains("[9]"),
            "{error}"
        );
        for end in 0..bytes.len() {
            let _ = Npz::read(Cursor::new(&bytes[..end]), &["a"]);
        }
    }
}
