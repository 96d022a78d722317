//! Points without a colour in clouds that have colours. Scanners write black for them, and they are told from points that
//! are black by how often exact black occurs.

/// Colours of which no channel is larger are nearly black.
const NEARLY_BLACK: u8 = 4;
/// A photo has about as many points of each of the darkest shades. Black that occurs so many times as often as all that
/// is nearly black is none of them.
const TIMES: u64 = 8;
/// Clouds with fewer shades, of five bits a channel, were coloured by a person or a program: their black is black.
const FEWEST_SHADES: u32 = 256;

/// Counts the colours of a cloud.
#[derive(Clone)]
pub struct ColorCount {
    black: u64,
    nearly_black: u64,
    /// A bit for each shade that occurs.
    shades: Vec<u64>,
}

impl Default for ColorCount {
    fn default() -> Self {
        Self { black: 0, nearly_black: 0, shades: vec![0; 512] }
    }
}

impl ColorCount {
    /// Counts some colours.
    pub fn add(&mut self, colors: &[[u8; 4]]) {
        for color @ [red, green, blue, _] in colors {
            self.black += u64::from(is_black(*color));
            self.nearly_black += u64::from(!is_black(*color) && *red.max(green).max(blue) <= NEARLY_BLACK);
            let bits = |channel: &u8| usize::from(channel >> 3);
            let shade = bits(red) << 10 | bits(green) << 5 | bits(blue);
            self.shades[shade / 64] |= 1 << (shade % 64);
        }
    }

    /// The number of points without a colour: those that are black, or none if these are black indeed.
    pub fn blanks(&self) -> u64 {
        let shades: u32 = self.shades.iter().map(|word| word.count_ones()).sum();
        if shades >= FEWEST_SHADES && self.black > TIMES * self.nearly_black { self.black } else { 0 }
    }
}

/// Whether a colour is exactly black.
pub fn is_black(color: [u8; 4]) -> bool {
    color[..3] == [0; 3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash;

    /// So many points of evenly spread colours, beside black ones.
    fn blanks(points: u64, black: usize) -> u64 {
        let channel = |i: u64, at: u64| (hash(3 * i + at) >> 56) as u8;
        let mut count = ColorCount::default();
        count.add(&(0..points).map(|i| [channel(i, 0), channel(i, 1), channel(i, 2), 255]).collect::<Vec<_>>());
        count.add(&vec![[0, 0, 0, 255]; black]);
        count.blanks()
    }

    #[test]
    fn black_is_no_colour_where_hardly_any_point_is_nearly_black() {
        // One in 134 thousand of random colours has no channel above 4.
        assert_eq!(blanks(100_000, 3000), 3000);
        assert_eq!(blanks(100_000, 0), 0);
        assert_eq!(blanks(100, 3000), 0, "too few shades for a photo");
    }

    #[test]
    fn black_among_shades_of_nearly_black_is_black() {
        // Of 32 thousand colours one is black, and 24 are nearly.
        let color = |i: u64| {
            let (red, blue) = ((hash(i) >> 57) as u8, (hash(i + (1 << 40)) >> 56) as u8);
            [red, red / 2, blue, 255]
        };
        let mut count = ColorCount::default();
        count.add(&(0..300_000).map(color).collect::<Vec<_>>());
        assert!(count.black > 0 && count.blanks() == 0, "{} of {}", count.black, count.nearly_black);
        count.add(&[[0, 0, 0, 255]; 5000]);
        assert_eq!(count.blanks(), count.black);
    }
}
