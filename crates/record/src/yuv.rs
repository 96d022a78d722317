//! Colours as films keep them: BT.709 luma and chroma in limited range, chroma at half the resolution.

/// The planes of a picture, rows from the top.
pub struct Planes {
    pub y: Vec<u8>,
    pub u: Vec<u8>,
    pub v: Vec<u8>,
}

/// The shares of red and blue in luma, by ITU-R BT.709.
const RED: f32 = 0.2126;
const BLUE: f32 = 0.0722;

impl Planes {
    /// Converts rows of red, green and blue. Chroma is the mean of up to four pixels.
    pub fn from_rgb(rgb: &[u8], [width, height]: [usize; 2]) -> Self {
        let pixel = |x: usize, y: usize| {
            let at = 3 * (y * width + x);
            [rgb[at], rgb[at + 1], rgb[at + 2]].map(f32::from)
        };
        let luma = |[red, green, blue]: [f32; 3]| RED * red + (1.0 - RED - BLUE) * green + BLUE * blue;
        let scaled = |value: f32, range: f32, middle: f32| (middle + value * range / 255.0).round() as u8;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let y = places.map(|(x, y)| scaled(luma(pixel(x, y)), 219.0, 16.0)).collect();
        let (mut u, mut v) = (Vec::new(), Vec::new());
        for row in (0..height).step_by(2) {
            for column in (0..width).step_by(2) {
                let [right, below] = [(column + 1).min(width - 1), (row + 1).min(height - 1)];
                let four = [pixel(column, row), pixel(right, row), pixel(column, below), pixel(right, below)];
                let mean = [0, 1, 2].map(|channel| four.iter().map(|pixel| pixel[channel]).sum::<f32>() / 4.0);
                let y = luma(mean);
                u.push(scaled((mean[2] - y) / (2.0 * (1.0 - BLUE)), 224.0, 128.0));
                v.push(scaled((mean[0] - y) / (2.0 * (1.0 - RED)), 224.0, 128.0));
            }
        }
        Self { y, u, v }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_white_and_pure_colours_have_the_values_of_the_standard() {
        for (rgb, expected) in [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
        ] {
            let planes = Planes::from_rgb(&rgb.repeat(6), [3, 2]);
            assert_eq!((planes.y.len(), planes.u.len(), planes.v.len()), (6, 2, 2));
            assert!(planes.y.iter().all(|value| *value == expected[0]), "{rgb:?}: {:?}", planes.y);
            assert_eq!([planes.u[1], planes.v[1]], [expected[1], expected[2]], "{rgb:?}");
        }
    }
}
