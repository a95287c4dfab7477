//! Encodes PNG files in memory (W3C, Portable Network Graphics, third edition): one compressed stream of rows without
//! filters. Another encoder would save a few bytes of these small images and costs five crates; tests read what is
//! written here with the crate `minipng`.

use std::io::Write;

use base64::prelude::{BASE64_STANDARD, Engine};
use flate2::{Compression, Crc, write::ZlibEncoder};

/// Bytes with which every PNG file begins.
const SIGNATURE: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Maximum length of a side in pixels, and of a chunk in bytes, by the standard.
const MAX: u32 = (1 << 31) - 1;

/// Reason why an image cannot be a PNG file.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The sides do not fit the pixels, or are zero or too long.
    #[error(
        "{width} x {height} pixels of {bytes_per_pixel} bytes do not fit {found} bytes of data"
    )]
    Size {
        /// Pixels of a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes of a pixel.
        bytes_per_pixel: usize,
        /// Bytes of all pixels.
        found: usize,
    },
    /// The compressed data are longer than a chunk can be.
    #[error("an image of {0} compressed bytes is too large")]
    TooLarge(usize),
    /// The compression failed.
    #[error(transparent)]
    Compression(#[from] std::io::Error),
}

/// Pixels of an image, rows from the top.
pub(crate) enum Pixels<'a> {
    /// Three bytes per pixel.
    Rgb(&'a [u8]),
    /// One byte per pixel: an index into a palette of red, green and blue.
    Indexed {
        palette: &'a [[u8; 3]],
        indices: &'a [u8],
    },
}

/// Encodes an image with text chunks, each a keyword and a text. Characters outside Latin-1, which these chunks cannot
/// represent, become question marks.
///
/// # Errors
/// An image without pixels, or a size that does not match the pixels.
pub(crate) fn encode(
    width: usize,
    height: usize,
    pixels: &Pixels,
    texts: &[(&str, String)],
) -> Result<Vec<u8>, PngError> {
    // Colour types 2 (red, green, blue) and 3 (palette).
    let (data, bytes_per_pixel, colour_type) = match pixels {
        Pixels::Rgb(data) => (*data, 3, 2),
        Pixels::Indexed { indices, .. } => (*indices, 1, 3),
    };
    let size = || PngError::Size {
        width,
        height,
        bytes_per_pixel,
        found: data.len(),
    };
    let side = |n: usize| u32::try_from(n).ok().filter(|n| (1..=MAX).contains(n));
    let (Some(columns), Some(rows)) = (side(width), side(height)) else {
        return Err(size());
    };
    let bytes_per_row = width.checked_mul(bytes_per_pixel).ok_or_else(size)?;
    if bytes_per_row.checked_mul(height) != Some(data.len()) {
        return Err(size());
    }
    let mut file = SIGNATURE.to_vec();
    let [c, r] = [columns, rows].map(u32::to_be_bytes);
    // Eight bits a sample; the only compression and filter method; not interlaced.
    let header = [&c[..], &r[..], &[8, colour_type, 0, 0, 0]].concat();
    push_chunk(&mut file, b"IHDR", &header)?;
    if let Pixels::Indexed { palette, .. } = pixels {
        push_chunk(&mut file, b"PLTE", palette.as_flattened())?;
    }
    for (keyword, text) in texts {
        let latin_1 = |c: char| u8::try_from(c).unwrap_or(b'?');
        let text = text.replace('\u{2212}', "-");
        let chunk: Vec<u8> = keyword
            .chars()
            .chain(['\0'])
            .chain(text.chars())
            .map(latin_1)
            .collect();
        push_chunk(&mut file, b"tEXt", &chunk)?;
    }
    let mut compressed = ZlibEncoder::new(Vec::new(), Compression::default());
    for row in data.chunks_exact(bytes_per_row) {
        // Filter type 0: the bytes as they are.
        compressed.write_all(&[0])?;
        compressed.write_all(row)?;
    }
    push_chunk(&mut file, b"IDAT", &compressed.finish()?)?;
    push_chunk(&mut file, b"IEND", &[])?;
    Ok(file)
}

/// Appends a chunk: length, type, data and checksum of type and data.
fn push_chunk(file: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) -> Result<(), PngError> {
    let length = u32::try_from(data.len()).ok().filter(|n| *n <= MAX);
    let length = length.ok_or(PngError::TooLarge(data.len()))?;
    let mut crc = Crc::new();
    crc.update(kind);
    crc.update(data);
    file.extend(length.to_be_bytes());
    file.extend(kind);
    file.extend(data);
    file.extend(crc.sum().to_be_bytes());
    Ok(())
}

/// The `data:` URI of a PNG file, for `<image href="...">`.
pub(crate) fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Width, height and pixels, decoded by an implementation of others.
    pub fn decoded(png: &[u8]) -> (usize, usize, Vec<[u8; 3]>) {
        let header = minipng::decode_png_header(png).unwrap();
        let mut buffer = vec![0; header.required_bytes_rgba8bpc()];
        let mut image = minipng::decode_png(png, &mut buffer).unwrap();
        image.convert_to_rgba8bpc().unwrap();
        let (pixels, _) = image.pixels().as_chunks::<4>();
        let rgb = pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        (image.width() as usize, image.height() as usize, rgb)
    }

    #[test]
    fn pixels_come_back() {
        let rgb: Vec<u8> = (0..2 * 3 * 3).collect();
        let png = encode(3, 2, &Pixels::Rgb(&rgb), &[]).unwrap();
        let (pixels, _) = rgb.as_chunks::<3>();
        assert_eq!(decoded(&png), (3, 2, pixels.to_vec()));
        let palette = [[1, 2, 3], [250, 251, 252]];
        let indexed = Pixels::Indexed {
            palette: &palette,
            indices: &[1, 0, 1],
        };
        let png = encode(1, 3, &indexed, &[("Title", "a − b".into())]).unwrap();
        assert_eq!(
            decoded(&png),
            (1, 3, [1, 0, 1].map(|i| palette[i]).to_vec())
        );
    }

    /// The bytes and the checksum of the last chunk are those of every PNG file.
    #[test]
    fn the_file_ends_as_the_standard_says() {
        let png = encode(1, 1, &Pixels::Rgb(&[0, 0, 0]), &[]).unwrap();
        assert_eq!(png[..8], SIGNATURE);
        assert!(png.ends_with(&[0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82]));
    }

    #[test]
    fn sizes_that_do_not_fit_are_errors() {
        for (width, height) in [(0, 1), (1, 0), (2, 1), (usize::MAX, 3)] {
            assert!(encode(width, height, &Pixels::Rgb(&[0; 3]), &[]).is_err());
        }
    }
}
