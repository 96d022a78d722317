//! Decompresses LZF (M. Lehmann, liblzf 3.6), as PCD files have it.

use std::io::{self, Read, Write};

/// The farthest that a copy reaches back in bytes.
const WINDOW: usize = 1 << 13;

/// Decompresses `length` bytes from `input` to `output`. The memory does not depend on the length.
///
/// # Errors
/// If the input ends before, or is no LZF; in words of this crate.
pub fn decompress(input: &mut impl Read, output: &mut impl Write, length: u64) -> io::Result<()> {
    let invalid = |problem: &'static str| io::Error::new(io::ErrorKind::InvalidData, problem);
    let mut window = vec![0_u8; WINDOW];
    let mut written = 0_u64;
    let mut byte = || {
        let mut one = [0];
        input.read_exact(&mut one).map(|()| usize::from(one[0]))
    };
    let mut put = |window: &mut [u8], written: &mut u64, byte: u8| {
        window[(*written % WINDOW as u64) as usize] = byte;
        *written += 1;
        output.write_all(&[byte])
    };
    while written < length {
        let control = byte()?;
        if control < 32 {
            if written + control as u64 + 1 > length {
                return Err(invalid("a compressed run is longer than the points"));
            }
            for _ in 0..=control {
                let own = byte()? as u8;
                put(&mut window, &mut written, own)?;
            }
            continue;
        }
        let count = match control >> 5 {
            7 => 7 + byte()?,
            short => short,
        } + 2;
        let back = ((control & 31) << 8 | byte()?) as u64 + 1;
        if back > written {
            return Err(invalid("a compressed copy reaches to before the points"));
        }
        if written + count as u64 > length {
            return Err(invalid("a compressed copy is longer than the points"));
        }
        for _ in 0..count {
            let own = window[((written - back) % WINDOW as u64) as usize];
            put(&mut window, &mut written, own)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decompressed(input: &[u8], length: u64) -> io::Result<Vec<u8>> {
        let mut output = Vec::new();
        decompress(&mut &input[..], &mut output, length).map(|()| output)
    }

    #[test]
    fn runs_and_copies_that_overlap_are_decompressed() {
        assert_eq!(decompressed(&[2, b'a', b'b', b'c'], 3).unwrap(), b"abc");
        // Three bytes from one byte back, and 9 + 2 + 1 by the long form.
        assert_eq!(decompressed(&[0, b'a', 1 << 5, 0], 4).unwrap(), b"aaaa");
        assert_eq!(decompressed(&[1, b'a', b'b', 7 << 5, 3, 1], 14).unwrap(), b"abababababababab"[..14].to_vec());
    }

    #[test]
    fn what_is_no_lzf_is_refused() {
        for (input, length) in
            [(&[][..], 1), (&[1 << 5, 0], 3), (&[0, 7, 1 << 5, 1], 4), (&[31, 1, 2], 3), (&[0, 7, 7 << 5, 255, 0], 9)]
        {
            assert!(decompressed(input, length).is_err(), "{input:?}");
        }
    }
}
