//! What has drawn a picture, as its PNG file says: the text `Source`, which the PNG specification has for the device that
//! made a picture. It stands right behind the header.

/// Where the header ends: a signature of 8 bytes, and a chunk of 13 bytes with 12 around them.
const HEADER_END: usize = 8 + 12 + 13;
/// The kind of the chunk, and the keyword with its end.
const BEGIN: &[u8] = b"tEXtSource\0";

/// Adds a text to a PNG file.
pub fn name_source(png: &mut Vec<u8>, source: &str) {
    // Texts are in Latin-1.
    let text = source.chars().map(|letter| u8::try_from(letter).unwrap_or(b'?'));
    let chunk: Vec<u8> = BEGIN.iter().copied().chain(text).collect();
    let length = (chunk.len() - 4) as u32;
    let sum = crc32fast::hash(&chunk);
    let bytes = length.to_be_bytes().into_iter().chain(chunk).chain(sum.to_be_bytes());
    png.splice(HEADER_END..HEADER_END, bytes);
}

/// The text of a PNG file, of which `head` is the beginning.
pub fn source(head: &[u8]) -> Option<String> {
    let (length, rest) = head.get(HEADER_END..)?.split_at_checked(4)?;
    let length = u32::from_be_bytes(length.try_into().ok()?) as usize;
    let text = rest.get(..length.checked_add(4)?)?.strip_prefix(BEGIN)?;
    Some(text.iter().map(|byte| char::from(*byte)).collect())
}

#[cfg(test)]
mod tests {
    use image::ImageEncoder as _;

    use super::*;

    #[test]
    fn the_source_comes_back_and_the_picture_stays() {
        let picture = image::RgbImage::from_fn(20, 10, |x, y| image::Rgb([x as u8, y as u8, 7]));
        let mut png = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.write_image(&picture, 20, 10, image::ExtendedColorType::Rgb8).unwrap();
        assert_eq!(source(&png), None);
        name_source(&mut png, "Card\u{2122} \u{e9} (Vulkan, 1.2)");
        let told = "Card? \u{e9} (Vulkan, 1.2)";
        assert_eq!(source(&png).as_deref(), Some(told));
        assert!(image::load_from_memory(&png).unwrap().into_rgb8() == picture);
        // Of a beginning, all of it or nothing.
        assert!((0..png.len()).all(|length| source(&png[..length]).is_none_or(|text| text == told)));
    }
}
