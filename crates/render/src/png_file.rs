//! Encodes PNG files in memory.

use base64::prelude::{BASE64_STANDARD, Engine};

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
) -> Result<Vec<u8>, png::EncodingError> {
    // An image with a side beyond u32 cannot fit into memory, so the encoder rejects the mismatch.
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, side(width), side(height));
    encoder.set_depth(png::BitDepth::Eight);
    let data = match pixels {
        Pixels::Rgb(data) => {
            encoder.set_color(png::ColorType::Rgb);
            data
        }
        Pixels::Indexed { palette, indices } => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(palette.as_flattened().to_vec());
            indices
        }
    };
    for (keyword, text) in texts {
        let latin_1 = |c: char| if (c as u32) < 256 { c } else { '?' };
        let text = text.replace('\u{2212}', "-").chars().map(latin_1).collect();
        encoder.add_text_chunk((*keyword).into(), text)?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(data)?;
    writer.finish()?;
    Ok(out)
}

/// The `data:` URI of a PNG file, for `<image href="...">`.
pub(crate) fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png))
}
