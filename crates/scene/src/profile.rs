//! Profiles that a scene keeps: an upright slice of its points along a line.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Camera;

/// The most profiles of a scene.
pub const MOST_PROFILES: usize = 1000;

/// The most corners of a profile's line.
pub const MOST_LINE_CORNERS: usize = 1000;
/// The thinnest and the thickest slice in world units.
const WIDTHS: std::ops::RangeInclusive<f64> = 1e-9..=1e12;
/// Sky blue, as on the screen.
const BLUE: [f32; 3] = [0.35, 0.85, 1.0];

/// A profile, as `[[profiles]]` of a scene file: the points in an upright slice along a line, seen from the side. The
/// line counts as seen from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    #[serde(default)]
    pub name: String,
    /// Whether its line is drawn over the picture.
    #[serde(default = "yes")]
    pub on: bool,
    /// Red, green and blue as on the screen, 0 to 1.
    #[serde(default = "blue")]
    pub color: [f32; 3],
    /// The corners of the line in world units.
    pub line: Vec<DVec3>,
    /// The whole thickness of the slice in world units.
    pub width: f64,
}

fn yes() -> bool {
    true
}

fn blue() -> [f32; 3] {
    BLUE
}

impl Profile {
    pub fn new(line: Vec<DVec3>, width: f64) -> Self {
        Self { name: String::new(), on: true, color: BLUE, line, width }
    }

    /// The middle of the box around its line.
    pub fn middle(&self) -> DVec3 {
        let low = self.line.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = self.line.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        (low + high) * 0.5
    }

    /// The same profile moved sideways: to the left of the way from the first corner to the last one, seen from above.
    pub fn beside(&self, up: DVec3, distance: f64) -> Self {
        let way = self.line.last().copied().unwrap_or_default() - self.line.first().copied().unwrap_or_default();
        let left = up.cross(way).normalize_or(up.any_orthonormal_vector());
        Self { line: self.line.iter().map(|corner| *corner + left * distance).collect(), ..self.clone() }
    }

    /// What makes it none, in words, if anything does. Whether two corners are above one another depends on the
    /// direction up, which is not known here.
    pub fn problem(&self) -> Option<String> {
        let count = self.line.len();
        if !(2..=MOST_LINE_CORNERS).contains(&count) {
            return Some(format!("line has {count} corners, expected 2 to {MOST_LINE_CORNERS}"));
        }
        if !self.line.iter().all(|corner| Camera::is_near(*corner)) {
            return Some("line is not finite, or too far away".into());
        }
        if self.line.windows(2).any(|ends| ends[0] == ends[1]) {
            return Some("line has two equal corners one after the other".into());
        }
        if !WIDTHS.contains(&self.width) {
            return Some(format!("width is {}, expected {:e} to {:e}", self.width, WIDTHS.start(), WIDTHS.end()));
        }
        let is_share = |value: &f32| (0.0..=1.0).contains(value);
        (!self.color.iter().all(is_share)).then(|| format!("color is {:?}, expected shares from 0 to 1", self.color))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_profile_is_told() {
        let good = Profile::new(vec![DVec3::ZERO, DVec3::X], 0.5);
        assert_eq!(good.problem(), None);
        let told = |change: &dyn Fn(&mut Profile)| {
            let mut profile = good.clone();
            change(&mut profile);
            profile.problem().expect("a problem")
        };
        assert!(told(&|profile| profile.line.truncate(1)).contains("1 corners"));
        assert!(told(&|profile| profile.line[1] = DVec3::ZERO).contains("two equal corners"));
        assert!(told(&|profile| profile.line[1].x = f64::NAN).contains("not finite"));
        assert!(told(&|profile| profile.width = f64::NAN).contains("width is NaN"));
        assert!(told(&|profile| profile.width = 0.0).contains("width is 0"));
        assert!(told(&|profile| profile.color[0] = 2.0).contains("color"));
    }

    #[test]
    fn a_profile_beside_another_lies_to_its_left_at_the_distance() {
        let profile = Profile::new(vec![DVec3::ZERO, DVec3::new(3.0, 4.0, 9.0)], 0.5);
        let beside = profile.beside(DVec3::Z, 10.0);
        assert!((beside.line[0] - DVec3::new(-8.0, 6.0, 0.0)).length() < 1e-12, "{:?}", beside.line);
        assert!((beside.line[1] - profile.line[1] - beside.line[0]).length() < 1e-12);
    }
}
