//! Low-discrepancy numbers that place virtual lights, and the directions of a spot light's flux.

use glam::{DVec2, DVec3};

/// The radical inverse of `index` (Halton 1960), 0 to 1.
pub(crate) fn radical_inverse(base: u32, mut index: u32) -> f64 {
    let (mut value, mut scale) = (0.0, 1.0);
    while index > 0 {
        scale /= f64::from(base);
        value += f64::from(index % base) * scale;
        index /= base;
    }
    value
}

/// Point `index` of the plane's Halton sequence. Any run of neighbours is spread over the unit square: interleaved
/// pixels are lit by such runs.
pub(crate) fn halton(index: u32) -> DVec2 {
    // The sequence's first point, in the corner (0, 0), is left out.
    DVec2::new(radical_inverse(2, index + 1), radical_inverse(3, index + 1))
}

/// Point `index` of the plane's R2 sequence (Roberts 2018). It keeps its points farther apart than Halton's does, and a
/// surface near to a lit one shows how evenly the lights are spread. Any run of neighbours is spread over the unit
/// square, too.
pub(crate) fn even(index: u32) -> DVec2 {
    // Powers of 1 over the root of x^3 = x + 1.
    let steps = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3);
    (steps * f64::from(index) + 0.5).fract()
}

/// Maps numbers to directions distributed like a spot light's flux.
pub(crate) struct SpotFlux {
    /// The cumulated flux over equal steps of the angle; the last entry is the whole flux, for an intensity of 1.
    sums: Vec<f64>,
    outer: f64,
}

impl SpotFlux {
    /// The number of steps of the angle; within a step the flux is taken to be even.
    const STEPS: usize = 1024;

    /// The flux of a light that is even within the angle `inner` from the axis and falls linearly to nothing at
    /// `outer`; radians.
    pub fn new(inner: f64, outer: f64) -> Self {
        let mut sum = 0.0;
        let sums = (0..Self::STEPS)
            .map(|step| {
                let angle = (step as f64 + 0.5) / Self::STEPS as f64 * outer;
                let share = ((outer - angle) / (outer - inner).max(1e-6)).clamp(0.0, 1.0);
                sum += share * angle.sin() * std::f64::consts::TAU * outer / Self::STEPS as f64;
                sum
            })
            .collect();
        Self { sums, outer }
    }

    /// The flux of a light of intensity 1.
    pub fn total(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The direction for two numbers, a unit vector; z is along the axis.
    pub fn direction(&self, numbers: DVec2) -> DVec3 {
        // From square to disc with little distortion (Shirley and Chiu 1997): even distributions stay even.
        let side = numbers * 2.0 - 1.0;
        let is_wide = side.x.abs() > side.y.abs();
        let (radius, other) = if is_wide { (side.x, side.y) } else { (side.y, side.x) };
        let eighth = if radius == 0.0 { 0.0 } else { std::f64::consts::FRAC_PI_4 * other / radius };
        let turn = if is_wide { eighth } else { std::f64::consts::FRAC_PI_2 - eighth };
        let turn = if radius < 0.0 { turn + std::f64::consts::PI } else { turn };
        let wanted = radius * radius * self.total();
        let step = self.sums.partition_point(|sum| *sum <= wanted).min(Self::STEPS - 1);
        let before = if step == 0 { 0.0 } else { self.sums[step - 1] };
        let within = ((wanted - before) / (self.sums[step] - before).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let angle = (step as f64 + within) / Self::STEPS as f64 * self.outer;
        DVec3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flux_is_that_of_the_closed_form_and_directions_follow_it() {
        let (inner, outer) = (20f64.to_radians(), 25f64.to_radians());
        let flux = SpotFlux::new(inner, outer);
        // The integral of sin a within the inner cone, and of (outer - a) / (outer - inner) sin a beyond.
        let ring = inner.cos() - (outer.sin() - inner.sin()) / (outer - inner);
        let expected = std::f64::consts::TAU * ((1.0 - inner.cos()) + ring);
        assert!((flux.total() / expected - 1.0).abs() < 1e-4, "{} instead of {expected}", flux.total());
        let angles: Vec<f64> = (0..4096).map(|index| flux.direction(halton(index)).z.acos()).collect();
        let within = angles.iter().filter(|angle| **angle < inner).count() as f64 / 4096.0;
        let share = (1.0 - inner.cos()) / ((1.0 - inner.cos()) + ring);
        assert!((within - share).abs() < 0.002, "{within} of the directions instead of {share}");
        assert!(angles.iter().all(|angle| *angle <= outer));
    }

    #[test]
    fn runs_of_the_sequences_are_spread_over_the_square() {
        for (sequence, most) in [(halton as fn(u32) -> DVec2, 8), (even, 6)] {
            for first in [0, 16, 240, 1000] {
                let mut cells = [0; 16];
                for index in first..first + 64 {
                    let cell = (sequence(index) * 4.0).as_uvec2();
                    cells[(cell.y * 4 + cell.x) as usize] += 1;
                }
                assert!(cells.iter().all(|count| (1..=most).contains(count)), "from {first}: {cells:?}");
            }
        }
    }
}
