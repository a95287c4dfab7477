//! Recordings that are compressed as a whole.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use flate2::{Compression, write::GzEncoder};
use radarllm_io::{CaptureFormat, CaptureOptions, Error, Recording, read_recording};

fn table(n_frames: u32) -> String {
    let mut text = "frame,t_s,x,y,z,v,snr\n".to_owned();
    for n in 0..n_frames {
        text += &format!(
            "{n},{},0.5,{},0.25,-0.5,12\n",
            0.1 * f64::from(n),
            2 + n % 3
        );
    }
    text
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[cfg(feature = "ros2")]
fn zstd(bytes: &[u8]) -> Vec<u8> {
    ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
}

fn read(path: &Path) -> Result<Recording, Error> {
    read_recording(&[path.to_path_buf()], &CaptureOptions::default())
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    }
}

/// Everything but the path is that of the plain file.
fn assert_same(packed: Recording, plain: &Recording) {
    let mut packed = packed;
    packed.clip.provenance = plain.clip.provenance.clone();
    assert_eq!(packed, *plain);
}

#[test]
fn a_compressed_recording_is_that_of_the_plain_file() {
    let folder = Folder::new();
    let text = table(200);
    let bytes = text.as_bytes();
    let plain = read(&folder.write("walk.csv", bytes)).unwrap();
    assert_eq!(plain.clip.frames.len(), 200);
    assert_same(
        read(&folder.write("walk.csv.gz", &gzip(bytes))).unwrap(),
        &plain,
    );
    // Joined, as `cat a.gz b.gz` does.
    let joined = [gzip(&bytes[..3_000]), gzip(&bytes[3_000..])].concat();
    assert_same(
        read(&folder.write("joined.csv.GZ", &joined)).unwrap(),
        &plain,
    );
    // A file whose name is wrong is read as it is.
    assert_same(read(&folder.write("plain.csv.gz", bytes)).unwrap(), &plain);
    // The format may be named, and then the file is not looked at before.
    let options = CaptureOptions {
        format: CaptureFormat::from_name("csv").ok(),
        ..CaptureOptions::default()
    };
    let named = read_recording(&[folder.0.path().join("walk.csv.gz")], &options).unwrap();
    assert_eq!(named.clip.frames, plain.clip.frames);
}

#[cfg(feature = "ros2")]
#[test]
fn frames_of_zstandard_follow_each_other() {
    let folder = Folder::new();
    let text = table(200);
    let (first, rest) = text.as_bytes().split_at(2_500);
    let plain = read(&folder.write("walk.csv", text.as_bytes())).unwrap();
    assert_same(
        read(&folder.write("walk.csv.zst", &zstd(text.as_bytes()))).unwrap(),
        &plain,
    );
    // Skippable frames of 3 bytes, as `pzstd` writes them.
    let skipped = [&[0x50, 0x2A, 0x4D, 0x18, 3, 0, 0, 0][..], b"abc"].concat();
    let joined = [
        skipped.clone(),
        zstd(first),
        skipped.clone(),
        zstd(rest),
        skipped,
    ]
    .concat();
    assert_same(
        read(&folder.write("joined.csv.zst", &joined)).unwrap(),
        &plain,
    );
}

/// Nothing of a file that is damaged is taken for the whole.
#[test]
fn damaged_and_short_files_are_refused() {
    let folder = Folder::new();
    let text = table(3_000);
    let mut files = vec![("a.csv.gz", gzip(text.as_bytes()))];
    #[cfg(feature = "ros2")]
    files.push(("a.csv.zst", zstd(text.as_bytes())));
    for (name, packed) in files {
        for n in (5..packed.len()).step_by(packed.len() / 40) {
            let error = read(&folder.write(name, &packed[..n]))
                .unwrap_err()
                .to_string();
            assert!(error.contains("damaged or cut short"), "{n}: {error}");
        }
        // The checksum at the end tells what the rest does not.
        let mut wrong = packed.clone();
        let at = packed.len() - if name.ends_with("gz") { 8 } else { 4 };
        wrong[at] ^= 1;
        let result = read(&folder.write(name, &wrong));
        let error = result.map(|_| name).unwrap_err().to_string();
        assert!(error.contains("damaged or cut short"), "{error}");
    }
}

/// A small file that becomes large is no recording.
#[test]
fn a_file_of_zeros_does_not_fill_the_disk() {
    let folder = Folder::new();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let zeros = vec![0; 1 << 20];
    for _ in 0..1_100 {
        encoder.write_all(&zeros).unwrap();
    }
    let path = folder.write("zeros.bin.gz", &encoder.finish().unwrap());
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("as no recording does"), "{error}");
}
