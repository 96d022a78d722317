//! What a PNG file says of a picture, in texts right behind its header: `Source`, which the PNG specification has for the
//! device that made a picture, is what has drawn it; `Recording` says of which recording it is, and which frame.

pub const SOURCE: &str = "Source";
pub const RECORDING: &str = "Recording";

/// Where the header ends: a signature of 8 bytes, and a chunk of 13 bytes with 12 around them.
const HEADER_END: usize = 8 + 12 + 13;
/// The kind of chunks of texts.
const KIND: &[u8] = b"tEXt";

/// Adds a text to a PNG file.
pub fn add_text(png: &mut Vec<u8>, keyword: &str, text: &str) {
    // Texts are in Latin-1.
    let text = text.chars().map(|letter| u8::try_from(letter).unwrap_or(b'?'));
    let chunk: Vec<u8> = KIND.iter().copied().chain(keyword.bytes()).chain([0]).chain(text).collect();
    let length = (chunk.len() - KIND.len()) as u32;
    let sum = crc32fast::hash(&chunk);
    let bytes = length.to_be_bytes().into_iter().chain(chunk).chain(sum.to_be_bytes());
    png.splice(HEADER_END..HEADER_END, bytes);
}

/// The text of a PNG file, of which `head` is the beginning.
pub fn text(head: &[u8], keyword: &str) -> Option<String> {
    let mut rest = head.get(HEADER_END..)?;
    loop {
        let (length, chunk) = rest.split_at_checked(4)?;
        let length = u32::from_be_bytes(length.try_into().ok()?) as usize;
        let (chunk, after) = chunk.split_at_checked(KIND.len().checked_add(length)?)?;
        let own = chunk.strip_prefix(KIND)?.strip_prefix(keyword.as_bytes());
        if let Some(text) = own.and_then(|own| own.strip_prefix(&[0])) {
            return Some(text.iter().map(|byte| char::from(*byte)).collect());
        }
        // A checksum of 4 bytes ends a chunk.
        rest = after.get(4..)?;
    }
}

#[cfg(test)]
mod tests {
    use image::ImageEncoder as _;

    use super::*;

    #[test]
    fn texts_come_back_and_the_picture_stays() {
        let picture = image::RgbImage::from_fn(20, 10, |x, y| image::Rgb([x as u8, y as u8, 7]));
        let mut png = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.write_image(&picture, 20, 10, image::ExtendedColorType::Rgb8).unwrap();
        assert_eq!(text(&png, SOURCE), None);
        add_text(&mut png, SOURCE, "Card\u{2122} \u{e9} (Vulkan, 1.2)");
        add_text(&mut png, RECORDING, "of a tour");
        let told = [(SOURCE, "Card? \u{e9} (Vulkan, 1.2)"), (RECORDING, "of a tour")];
        assert!(image::load_from_memory(&png).unwrap().into_rgb8() == picture);
        for (keyword, told) in told {
            assert_eq!(text(&png, keyword).as_deref(), Some(told));
            // Of a beginning, all of it or nothing.
            assert!((0..png.len()).all(|length| text(&png[..length], keyword).is_none_or(|text| text == told)));
        }
        assert_eq!(text(&png, "Title"), None);
    }
}
