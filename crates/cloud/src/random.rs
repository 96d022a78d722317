//! Reproducible random numbers: SplitMix64 (Steele, Lea, Flood 2014).

/// The increment of SplitMix64's state: 2^64 over the golden ratio.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Hashes a number so that close numbers give unrelated results.
#[inline]
pub fn hash(value: u64) -> u64 {
    let mut mixed = value.wrapping_add(STEP);
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

/// A uniform number in 0 .. 1 from a seed and a running number.
pub fn unit(seed: u64, number: u64) -> f64 {
    // 53 bits: the digits of an f64.
    (hash(hash(seed).wrapping_add(number)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A sequence of random numbers. The field is the state, which is the seed at first.
pub struct Random(pub u64);

impl Random {
    pub fn draw(&mut self) -> u64 {
        let number = hash(self.0);
        self.0 = self.0.wrapping_add(STEP);
        number
    }

    /// Draws a number below `end`, which is not 0. Small ends give an even distribution.
    pub fn below(&mut self, end: u64) -> u64 {
        self.draw() % end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_of_splitmix64() {
        // The reference implementation (Vigna 2015) gives these for the seed 1234567.
        let mut random = Random(1_234_567);
        let drawn: [u64; 3] = std::array::from_fn(|_| random.draw());
        assert_eq!(drawn, [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]);
    }
}
