//! Animated GIF, which every page shows: 256 colours a picture, and no more than 50 pictures a second.

use std::io::Write;

use gif::{Encoder, Frame, Repeat};

use crate::{Error, Result};

/// The most pictures a second: browsers show each for two hundredths of a second at least.
pub const MOST_FPS: u32 = 50;
/// How many of the pixels the choice of colours looks at: every third, which shows no difference.
const SAMPLED: i32 = 3;

/// Checks that there are GIFs of this size and rate, and returns the size as they keep it.
///
/// # Errors
/// There are none.
pub fn check(size: [u32; 2], fps: u32) -> Result<[u16; 2]> {
    if fps > MOST_FPS {
        let reason = format!("a GIF shows at most {MOST_FPS} pictures a second, {fps} are asked for");
        return Err(Error::Encoder { reason });
    }
    let [Ok(width), Ok(height)] = size.map(u16::try_from) else {
        return Err(Error::Encoder { reason: format!("a GIF has at most {} pixels a side", u16::MAX) });
    };
    Ok([width, height])
}

/// A GIF that is being written.
pub struct Gif<File: Write> {
    encoder: Encoder<File>,
    size: [u16; 2],
    fps: u32,
    count: u32,
}

impl<File: Write> Gif<File> {
    /// Begins a GIF that is shown again and again.
    ///
    /// # Errors
    /// It cannot have this size or rate, or the file cannot be written.
    pub fn new(file: File, size: [u32; 2], fps: u32) -> Result<Self> {
        let [width, height] = check(size, fps)?;
        let mut encoder = Encoder::new(file, width, height, &[]).map_err(gif_error)?;
        encoder.set_repeat(Repeat::Infinite).map_err(gif_error)?;
        Ok(Self { encoder, size: [width, height], fps, count: 0 })
    }

    /// Adds a picture: rows of sRGB red, green and blue, the top row first.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&mut self, rgb: &[u8]) -> Result<()> {
        let mut frame = Frame::from_rgb_speed(self.size[0], self.size[1], rgb, SAMPLED);
        // Times are in hundredths of a second; rounded ends keep the whole in time.
        let end = |count: u32| (f64::from(count) * 100.0 / f64::from(self.fps)).round() as u16;
        let place = self.count % self.fps;
        frame.delay = end(place + 1) - end(place);
        self.count += 1;
        self.encoder.write_frame(&frame).map_err(gif_error)
    }

    /// Ends the GIF.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn end(self) -> Result<()> {
        self.encoder.into_inner().map_err(gif_error)?.flush().map_err(Error::Io)
    }
}

fn gif_error(error: gif::EncodingError) -> Error {
    match error {
        gif::EncodingError::Io(reason) => Error::Io(reason),
        other => Error::Encoder { reason: other.to_string() },
    }
}
