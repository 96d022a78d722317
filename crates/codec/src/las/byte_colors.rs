//! Decodes colours of the item `RGB12` of LASzip in version 1: a symbol says which of the six bytes have changed, and each
//! of those is coded by its difference.
//!
//! The decoder of `laz` 0.13 keeps the bits that the upper byte of a channel had before. The coding is that of LASzip
//! (Isenburg 2013, `LASreadItemCompressed_RGB12_v1`).

use std::io::{self, Read};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;

/// The bytes of red, green and blue.
const BYTES: usize = 6;

/// Decodes one colour after the other.
pub struct ByteColors {
    last: [u8; BYTES],
    /// A bit for each byte that has changed.
    changes: ArithmeticModel,
    values: IntegerDecompressor,
}

impl Default for ByteColors {
    fn default() -> Self {
        Self {
            last: [0; BYTES],
            changes: ArithmeticModelBuilder::new(1 << BYTES).build(),
            values: IntegerDecompressorBuilder::new().bits(8).contexts(BYTES as u32).build_initialized(),
        }
    }
}

impl<R: Read> FieldDecompressor<R> for ByteColors {
    fn size_of_field(&self) -> usize {
        BYTES
    }

    fn decompress_first(&mut self, source: &mut R, color: &mut [u8]) -> io::Result<()> {
        source.read_exact(&mut self.last)?;
        color.copy_from_slice(&self.last);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, color: &mut [u8]) -> io::Result<()> {
        let changes = decoder.decode_symbol(&mut self.changes)?;
        for (byte, context) in self.last.iter_mut().zip(0_u32..) {
            if changes >> context & 1 == 1 {
                *byte = self.values.decompress(decoder, i32::from(*byte), context)? as u8;
            }
        }
        color.copy_from_slice(&self.last);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use cloud::Random;
    use laz::las::v1::LasRGBCompressor;
    use laz::record::{
        RecordCompressor as _, RecordDecompressor as _, SequentialPointRecordCompressor,
        SequentialPointRecordDecompressor,
    };

    use super::*;

    #[test]
    fn colours_of_sixteen_bits_come_back() {
        let mut noise = Random(5);
        let mut last = [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc];
        let mut next = || {
            // The encoder of `laz` confuses the contexts of the upper bytes of green and blue, so that of blue stays.
            for byte in &mut last[..BYTES - 1] {
                *byte = if noise.below(3) == 0 { noise.draw() as u8 } else { byte.wrapping_add(noise.below(4) as u8) };
            }
            last
        };
        let colors: Vec<[u8; BYTES]> = (0..2000).map(|_| next()).collect();
        let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
        encoder.add_field_compressor(LasRGBCompressor::default());
        colors.iter().for_each(|color| encoder.compress_next(color).unwrap());
        encoder.done().unwrap();
        let mut decoder = SequentialPointRecordDecompressor::new(Cursor::new(encoder.into_inner()));
        decoder.add_field_decompressor(ByteColors::default());
        for color in colors {
            let mut found = [0; BYTES];
            decoder.decompress_next(&mut found).unwrap();
            assert_eq!(found, color);
        }
    }
}
