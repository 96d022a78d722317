//! Decodes times of points: the item `GPSTIME11` of LASzip in version 2, and the times of its item `POINT14`.
//!
//! A time belongs to one of four sequences and is coded as a multiple of the last difference in it; a symbol switches
//! to another sequence. The decoder of `laz` calls itself for each switch. Such a symbol costs next to nothing once the
//! model has learned it, so some bytes of a damaged file would use up the stack. This one reads in a loop, and ends it.
//! It decodes the same values. The coding is that of LASzip (Isenburg 2013), and the code follows laz-rs (Apache-2.0).

use std::io::{self, Read};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;

/// The number of sequences, a power of two.
const SEQUENCES: usize = 4;
/// The most switches for one time. An encoder switches once, to the sequence of the time.
const MOST_SWITCHES: usize = SEQUENCES;
/// The greatest multiple of the last difference that has a symbol; it stands for all greater ones.
const GREATEST_MULTIPLE: u32 = 500;
/// The least multiple that has a symbol; it stands for all smaller ones.
const LEAST_MULTIPLE: i32 = -10;
/// The symbol after those of the multiples: the time is that of before.
const UNCHANGED: u32 = GREATEST_MULTIPLE + LEAST_MULTIPLE.unsigned_abs() + 1;
/// The symbol of a time that starts a sequence. Greater ones switch to another.
const START: u32 = UNCHANGED + 1;
/// The number of multiples in a row that have no symbol of their own, after which the difference is taken anew.
const MOST_EXTREMES: u32 = 3;

/// Decodes one time after the other.
pub struct GpsTimes {
    /// Whether there is a symbol for a time that does not change. `POINT14` says so elsewhere.
    has_unchanged: bool,
    /// The sequence of the last time, and the one that was started last.
    last: usize,
    started: usize,
    /// For each sequence: the bits of the last time, the last difference of such bits, the number of extreme multiples.
    times: [i64; SEQUENCES],
    differences: [i32; SEQUENCES],
    extremes: [u32; SEQUENCES],
    /// The symbols where the last difference is 0, and elsewhere.
    without_difference: ArithmeticModel,
    with_difference: ArithmeticModel,
    values: IntegerDecompressor,
}

impl GpsTimes {
    /// The times of an item `POINT14` after that of these bits.
    pub fn of_layers(first: i64) -> Self {
        Self::new(first, false)
    }

    /// The times of an item `GPSTIME11` of version 2.
    pub fn of_records() -> Self {
        Self::new(0, true)
    }

    fn new(first: i64, has_unchanged: bool) -> Self {
        let more = u32::from(has_unchanged);
        Self {
            has_unchanged,
            last: 0,
            started: 0,
            times: [first, 0, 0, 0],
            differences: [0; SEQUENCES],
            extremes: [0; SEQUENCES],
            without_difference: ArithmeticModelBuilder::new(SEQUENCES as u32 + 1 + more).build(),
            with_difference: ArithmeticModelBuilder::new(UNCHANGED + SEQUENCES as u32 + more).build(),
            values: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
        }
    }

    /// Decodes the bits of the next time.
    pub fn decode<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<i64> {
        for _ in 0..=MOST_SWITCHES {
            let switch = if self.differences[self.last] == 0 {
                self.decode_without_difference(decoder)?
            } else {
                self.decode_with_difference(decoder)?
            };
            if switch == 0 {
                return Ok(self.times[self.last]);
            }
            self.last = (self.last + switch as usize) % SEQUENCES;
        }
        let problem =
            format!("not valid compressed data: a time switches its sequence more than {MOST_SWITCHES} times");
        Err(io::Error::new(io::ErrorKind::InvalidData, problem))
    }

    /// Decodes a time where the last difference is 0. Returns by how much the sequence changes; then the time is still
    /// to be decoded.
    fn decode_without_difference<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<u32> {
        let symbol = decoder.decode_symbol(&mut self.without_difference)?;
        match symbol + u32::from(!self.has_unchanged) {
            0 => {}
            1 => {
                let difference = self.values.decompress(decoder, 0, 0)?;
                self.differences[self.last] = difference;
                self.advance(difference);
                self.extremes[self.last] = 0;
            }
            2 => self.start(decoder)?,
            other => return Ok(other - 2),
        }
        Ok(0)
    }

    /// Decodes a time where the last difference is not 0. Returns what `decode_without_difference` does.
    fn decode_with_difference<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<u32> {
        let mut symbol = decoder.decode_symbol(&mut self.with_difference)?;
        if symbol >= UNCHANGED {
            symbol += u32::from(!self.has_unchanged);
            match symbol {
                UNCHANGED => {}
                START => self.start(decoder)?,
                other => return Ok(other - START),
            }
            return Ok(0);
        }
        let multiple =
            if symbol <= GREATEST_MULTIPLE { symbol as i32 } else { (GREATEST_MULTIPLE as i32) - symbol as i32 };
        let (context, is_extreme) = match symbol {
            0 => (7, true),
            1 => (1, false),
            2..10 => (2, false),
            10..GREATEST_MULTIPLE => (3, false),
            GREATEST_MULTIPLE => (4, true),
            _ if multiple > LEAST_MULTIPLE => (5, false),
            _ => (6, true),
        };
        let expected = multiple.wrapping_mul(self.differences[self.last]);
        let difference = self.values.decompress(decoder, expected, context)?;
        if symbol == 1 {
            self.extremes[self.last] = 0;
        } else if is_extreme {
            self.extremes[self.last] += 1;
            if self.extremes[self.last] > MOST_EXTREMES {
                self.differences[self.last] = difference;
                self.extremes[self.last] = 0;
            }
        }
        self.advance(difference);
        Ok(0)
    }

    #[inline]
    fn advance(&mut self, difference: i32) {
        self.times[self.last] = self.times[self.last].wrapping_add(i64::from(difference));
    }

    /// Decodes a time that starts a sequence, in the place of the oldest one.
    fn start<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        let high = self.values.decompress(decoder, (self.times[self.last] >> 32) as i32, 8)?;
        let low = decoder.read_int()?;
        self.started = (self.started + 1) % SEQUENCES;
        self.last = self.started;
        self.times[self.last] = i64::from(high) << 32 | i64::from(low);
        self.differences[self.last] = 0;
        self.extremes[self.last] = 0;
        Ok(())
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTimes {
    fn size_of_field(&self) -> usize {
        size_of::<i64>()
    }

    fn decompress_first(&mut self, source: &mut R, time: &mut [u8]) -> io::Result<()> {
        let mut bytes = [0; size_of::<i64>()];
        source.read_exact(&mut bytes)?;
        self.times[0] = i64::from_le_bytes(bytes);
        time.copy_from_slice(&bytes);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, time: &mut [u8]) -> io::Result<()> {
        time.copy_from_slice(&self.decode(decoder)?.to_le_bytes());
        Ok(())
    }
}

#[cfg(test)]
pub mod tests {
    use cloud::Random;

    /// Bits of times of up to six sequences, each of which goes on by multiples of a difference of its own. All symbols
    /// come: equal times, every multiple, extreme ones in a row, switches and starts of sequences.
    pub fn times(count: usize, seed: u64) -> Vec<i64> {
        let mut noise = Random(seed);
        let mut sequences: Vec<(i64, i64)> =
            (0..6).map(|_| ((noise.below(1 << 60)) as i64, 1 + noise.below(5_000) as i64)).collect();
        let (mut sequence, mut run) = (0, 0);
        let mut kind = 0;
        let mut next = || {
            if noise.below(12) == 0 {
                sequence = noise.below(6) as usize;
            }
            if run == 0 {
                (run, kind) = (1 + noise.below(6), noise.below(6));
            }
            run -= 1;
            let (time, difference) = &mut sequences[sequence];
            *time += match kind {
                0 => 0,
                1 => *difference + noise.below(3) as i64 - 1,
                2 => *difference * (noise.below(530) as i64 - 15),
                3 => *difference * 2_000,
                4 => *difference * -40,
                _ => noise.below(9) as i64 - 4,
            };
            *time
        };
        (0..count).map(|_| next()).collect()
    }
}
