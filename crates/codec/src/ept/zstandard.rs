//! Decompresses the tiles of EPT that are rows of numbers in frames of Zstandard (RFC 8878).

use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

use crate::brief;
use crate::guarded::guarded;

/// The window that every decoder should support, by the specification; a frame may ask for as much as its bytes, too.
const USUAL_WINDOW: u64 = 8 << 20;

/// The most bytes that `length` bytes take when they are compressed: frames, and headers of blocks without compression.
pub fn most_compressed(length: u64) -> u64 {
    length.saturating_add(length / 64).saturating_add(64 << 10)
}

/// What a tile is when it is decompressed: `length` bytes.
///
/// # Errors
/// Says what is wrong with the tile. One that would be longer is not decompressed further than that.
pub fn decompressed(tile: &[u8], length: u64) -> Result<Vec<u8>, String> {
    let rows = guarded(|| frames(tile, length))??;
    match rows.len() as u64 == length {
        true => Ok(rows),
        false => Err(format!("{} bytes when it is decompressed, the hierarchy says {length}", rows.len())),
    }
}

fn frames(mut tile: &[u8], length: u64) -> Result<Vec<u8>, String> {
    let mut rows = Vec::new();
    while !tile.is_empty() {
        // A decoder that is used again takes the window that a frame asks for at once.
        let mut decoder = FrameDecoder::new();
        decoder.set_max_window_size(length.max(USUAL_WINDOW));
        match decoder.init(&mut tile) {
            Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                tile = tile.get(length as usize..).ok_or("a frame that is cut short")?;
                continue;
            }
            begun => begun.map_err(|error| problem(&error))?,
        }
        while !decoder.is_finished() {
            decoder.decode_blocks(&mut tile, BlockDecodingStrategy::UptoBlocks(1)).map_err(|error| problem(&error))?;
            decoder.collect_to_writer(&mut rows).map_err(|error| error.to_string())?;
            // What the decoder holds back for its window is at most that and a block.
            if rows.len() as u64 > length {
                return Err(format!("more than the {length} bytes that the hierarchy says, when it is decompressed"));
            }
        }
        if decoder.get_checksum_from_data().is_some_and(|told| decoder.get_calculated_checksum() != Some(told)) {
            return Err("its checksum is another one than that of its bytes".into());
        }
    }
    Ok(rows)
}

fn problem(error: &FrameDecoderError) -> String {
    match error {
        FrameDecoderError::WindowSizeTooBig { requested, max } => {
            format!("its frame asks for {requested} bytes of memory, expected at most {max}")
        }
        FrameDecoderError::DictNotProvided { .. } => "it needs a dictionary, which EPT has none of".into(),
        other => format!("not decompressed: {}", brief::message(other)),
    }
}

#[cfg(test)]
mod tests {
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    use super::*;

    /// The squares of 0 to 399, modulo 1000, with a space behind each, as `zstd --ultra -19 --check` compresses them.
    const SQUARES: &str = "\
        28b52ffd6403056d0c00b6a23f09c03bc46c76f9fd73063a003b003c00f618b3b6bb65fe70af35467f001f5b6bd11e349337\
        e199668f59ab633b808e963564af98273611f3b99b6b390607c0b156ef9d651333f7751c0434526ed40e5ea123c4a0dc2837\
        781ad98b464f63ad53f790b5389e5cd9fdb535065557cb5e7e875a8146f0006684ae203bc44c6e6296efadd534562bcc3eb3\
        774cd31425ef8714d58f493e7454bd43ac502374e0a83aaa24f9d45e5d83a3a996c7273e5153138f5ba8acb885ca92b5d446\
        696109cbbcfb23c40a75455d32ef5b52f2be522c891fc592ecf5ea8f158fa9a99898c7c5c4d65ca8156e855be156782ee479\
        05715ea920d35c3d7b67f615661cc08c0180f3a831c88188828282a420859d039017a53970a51ddeb8384641500a423af944\
        59e082fb6b1981f51f58d8ddec2a83d8940159d72ecb685d1eb5ee2798dd1bf819d695484350fcca64cbfdf0a0b1beb9946c\
        1d49bcc35f8220a31716f4cbea88e28e23c97510707898c78752d787d750d116cb08eac91e002b36bcec1929a7088da60e0d\
        5719283ddaad0a813c363d";

    fn squares() -> (Vec<u8>, Vec<u8>) {
        let bytes = SQUARES.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap());
        let text: String = (0..400).map(|n| format!("{} ", n * n % 1000)).collect();
        (bytes.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect(), text.into_bytes())
    }

    /// A frame with this window, in the form of its header, and blocks that repeat a byte 131,072 times.
    fn bomb(window: u8, blocks: usize) -> Vec<u8> {
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, window];
        for block in 0..blocks {
            let header = (128_u32 << 10) << 3 | 1 << 1 | u32::from(block + 1 == blocks);
            frame.extend(&header.to_le_bytes()[..3]);
            frame.push(7);
        }
        frame
    }

    /// 8 MiB.
    const WINDOW: u8 = 13 << 3;

    #[test]
    fn frames_of_the_reference_program_of_our_encoder_and_several_in_a_row_are_decompressed() {
        let (compressed, text) = squares();
        let length = text.len() as u64;
        assert_eq!(decompressed(&compressed, length), Ok(text.clone()));
        let (first, second) = text.split_at(500);
        let frame = |bytes: &[u8]| compress_to_vec(bytes, CompressionLevel::Fastest);
        // A frame that is skipped, of three bytes.
        let skipped = [0x50, 0x2a, 0x4d, 0x18, 3, 0, 0, 0, 1, 2, 3];
        let several = [frame(first).as_slice(), &skipped, &frame(second)].concat();
        assert_eq!(decompressed(&several, length), Ok(text));
        let long: Vec<u8> = (0..3_000_000_u32).map(|n| (n.wrapping_mul(n) >> 7) as u8).collect();
        assert_eq!(decompressed(&frame(&long), long.len() as u64), Ok(long.clone()));
        assert_eq!(decompressed(&bomb(WINDOW, 3), 3 << 17), Ok(vec![7; 3 << 17]));
    }

    #[test]
    fn what_is_damaged_longer_shorter_or_asks_for_too_much_is_refused() {
        let (compressed, text) = squares();
        let length = text.len() as u64;
        let mut other = compressed.clone();
        *other.last_mut().unwrap() ^= 1;
        let skipped = [0x50, 0x2a, 0x4d, 0x18, 255, 255, 255, 255, 1, 2, 3];
        let cases: [(&[u8], u64, &str); 9] = [
            (&compressed, length - 1, "more than the 1538 bytes that the hierarchy says"),
            (&compressed, length + 1, "1539 bytes when it is decompressed, the hierarchy says 1540"),
            (&compressed[..200], length, "not decompressed"),
            (&compressed[..3], length, "not decompressed"),
            (b"", length, "0 bytes when it is decompressed"),
            (&other, length, "its checksum"),
            (&skipped, length, "a frame that is cut short"),
            (&bomb(WINDOW, 20_000), 100, "more than the 100 bytes"),
            (&bomb(20 << 3, 1), 100, "asks for 1073741824 bytes of memory, expected at most 8388608"),
        ];
        for (tile, length, expected) in cases {
            let problem = decompressed(tile, length).unwrap_err();
            assert!(problem.contains(expected), "{expected}: {problem}");
        }
        // Any byte may be another one: what comes is the text or an error.
        for at in 0..compressed.len() {
            let mut damaged = compressed.clone();
            damaged[at] = damaged[at].wrapping_mul(3).wrapping_add(1);
            assert!(decompressed(&damaged, length).map_or(true, |found| found == text), "byte {at}");
        }
    }
}
