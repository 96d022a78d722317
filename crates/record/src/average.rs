//! Pictures that are the average of several: over the time that the shutter is open, and over the pixels of a larger
//! picture. Light adds up, so the averages are those of linear values.

use serde::{Deserialize, Serialize};

/// What each picture of a recording is averaged from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Averaging {
    /// How many pictures are drawn while the shutter is open.
    pub subframes: u32,
    /// The share of a frame's time for which the shutter is open, from the frame's own time on.
    pub shutter: f64,
    /// By how much a picture that is drawn has more pixels in each direction.
    pub supersample: u32,
}

impl Averaging {
    pub const NONE: Self = Self { subframes: 1, shutter: 0.5, supersample: 1 };
    /// Sums of so many values of `Average` fit.
    pub const MOST_SUBFRAMES: u32 = 256;
    pub const MOST_SUPERSAMPLE: u32 = 8;

    /// The shutter has no effect on a single picture, and then is that of `NONE`.
    pub fn new(subframes: u32, shutter: f64, supersample: u32) -> Self {
        let shutter = if subframes > 1 { shutter } else { Self::NONE.shutter };
        Self { subframes, shutter, supersample }
    }

    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// The times of the pictures that a frame is averaged from, in seconds; the first is the frame's own. `fps` is how
    /// many frames a second has.
    pub fn times(self, time: f64, fps: u32) -> impl Iterator<Item = f64> {
        let step = self.shutter / f64::from(fps) / f64::from(self.subframes);
        (0..self.subframes).map(move |index| time + step * f64::from(index))
    }

    /// The size of the pictures that are drawn, for pictures of `size`.
    pub fn drawn_size(&self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| side.saturating_mul(self.supersample))
    }
}

impl Default for Averaging {
    fn default() -> Self {
        Self::NONE
    }
}

/// Full light in the sums: below a 32nd of the darkest step of sRGB lies nothing that is seen, and the sums of 256
/// pictures with 64 pixels each fit in 32 bits.
const FULL: u32 = (1 << 17) - 1;

/// An average of pictures.
pub struct Average {
    size: [u32; 2],
    supersample: u32,
    /// Sums of linear red, green and blue, rows from the top.
    sums: Vec<u32>,
    count: u32,
    /// The linear value of each value of sRGB.
    linear: [u32; 256],
}

impl Average {
    /// `size` is that of the average; the pictures have `supersample` times as many pixels in each direction.
    pub fn new(size: [u32; 2], supersample: u32) -> Self {
        let count = size.map(|side| side as usize).iter().product::<usize>() * 3;
        let linear = std::array::from_fn(|value| (to_linear(value as f64 / 255.0) * f64::from(FULL)).round() as u32);
        Self { size, supersample, sums: vec![0; count], count: 0, linear }
    }

    /// Adds a picture: rows of sRGB red, green, blue and opacity, the top row first. The opacity is left out.
    pub fn add(&mut self, rgba: &[u8]) {
        let [width, supersample] = [self.size[0], self.supersample].map(|count| count as usize);
        for (row, pixels) in rgba.chunks_exact(width * supersample * 4).enumerate() {
            let sums = &mut self.sums[row / supersample * width * 3..][..width * 3];
            for (sum, pixels) in sums.chunks_exact_mut(3).zip(pixels.chunks_exact(supersample * 4)) {
                for pixel in pixels.chunks_exact(4) {
                    (0..3).for_each(|channel| sum[channel] += self.linear[usize::from(pixel[channel])]);
                }
            }
        }
        self.count += 1;
    }

    /// The average of the pictures: rows of sRGB red, green, blue and full opacity.
    pub fn end(self) -> Vec<u8> {
        let whole = f64::from(FULL) * f64::from(self.count.max(1)) * f64::from(self.supersample).powi(2);
        let encode = |sum: &u32| (from_linear(f64::from(*sum) / whole) * 255.0).round() as u8;
        self.sums.chunks_exact(3).flat_map(|sum| [encode(&sum[0]), encode(&sum[1]), encode(&sum[2]), 255]).collect()
    }
}

/// The light of a value of sRGB (IEC 61966-2-1), both from 0 to 1.
fn to_linear(value: f64) -> f64 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn from_linear(light: f64) -> f64 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn averaged(size: [u32; 2], supersample: u32, pictures: &[Vec<u8>]) -> Vec<u8> {
        let mut average = Average::new(size, supersample);
        pictures.iter().for_each(|picture| average.add(picture));
        average.end()
    }

    #[test]
    fn pictures_that_are_equal_are_their_average_to_the_bit() {
        let picture: Vec<u8> = (0..=255).flat_map(|value: u8| [value, 255 - value, value / 2, 255]).collect();
        for count in [1, 2, 3, 7, 256] {
            assert!(averaged([16, 16], 1, &vec![picture.clone(); count]) == picture, "{count}");
        }
        let enlarged: Vec<u8> = (0..64 * 64)
            .flat_map(|pixel| picture[(pixel / 64 / 4 * 16 + pixel % 64 / 4) * 4..][..4].to_vec())
            .collect();
        assert!(averaged([16, 16], 4, &[enlarged]) == picture);
    }

    #[test]
    fn black_and_white_average_to_half_of_the_light() {
        let [black, white] = [[0, 0, 0, 255], [255; 4]];
        assert_eq!(averaged([1, 1], 1, &[black.to_vec(), white.to_vec()]), [188, 188, 188, 255]);
        let chequered = [black, white, white, black].concat();
        assert_eq!(averaged([1, 1], 2, &[chequered]), [188, 188, 188, 255]);
        // The brightest sum that there is fits.
        let most = Averaging::MOST_SUPERSAMPLE;
        let pictures = vec![vec![255; (most * most * 4) as usize]; Averaging::MOST_SUBFRAMES as usize];
        assert_eq!(averaged([1, 1], most, &pictures), [255; 4]);
    }

    #[test]
    fn the_shutter_opens_at_the_time_of_the_frame() {
        let times: Vec<f64> = Averaging::new(4, 0.5, 1).times(2.0, 10).collect();
        let expected = [2.0, 2.0125, 2.025, 2.0375];
        assert!(times.iter().zip(expected).all(|(time, expected)| (time - expected).abs() < 1e-12), "{times:?}");
        assert_eq!(Averaging::NONE.times(2.3, 30).collect::<Vec<_>>(), [2.3]);
        assert!(Averaging::new(1, 1.0, 1).is_none());
    }
}
