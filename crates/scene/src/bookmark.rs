//! Kept views.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Camera;

/// The most bookmarks of a scene.
pub const MOST_BOOKMARKS: usize = 256;

/// A kept view, as `[[bookmarks]]` of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bookmark {
    pub name: String,
    /// What is to be seen there.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// The digit that flies there with Shift, 0 to 9.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digit: Option<u8>,
    /// The eye in world units.
    pub eye: DVec3,
    /// The point that the camera looks at, in world units.
    pub pivot: DVec3,
    /// The up direction, of any length but zero.
    pub up: DVec3,
}

impl Bookmark {
    pub fn new(name: String, digit: Option<u8>, Camera { eye, pivot, up }: Camera) -> Self {
        Self { name, note: String::new(), digit, eye, pivot, up }
    }

    pub fn camera(&self) -> Camera {
        Camera::from_eye(self.eye, self.pivot, self.up)
    }

    /// Why it is not valid, if it is not.
    pub(crate) fn problem(&self) -> Option<String> {
        let Self { eye, pivot, up, .. } = *self;
        let odd_digit = self.digit.filter(|digit| *digit > 9);
        let odd_camera = Camera { eye, pivot, up }.problem().map(|(key, problem)| format!("{key} is {problem}"));
        odd_camera.or_else(|| odd_digit.map(|digit| format!("digit is {digit}, expected 0 to 9")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    #[test]
    fn bookmarks_survive_the_text_and_impossible_ones_are_refused_by_number() {
        let camera = Camera::from_eye(DVec3::new(635_619.123_456_7, 0.1, 1.0 / 3.0), DVec3::ZERO, DVec3::Z);
        let mut door = Bookmark::new("door".into(), Some(3), camera);
        door.note = "the crack above it".into();
        let file =
            SceneFile { bookmarks: vec![door, Bookmark::new(String::new(), None, camera)], ..SceneFile::default() };
        assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file);
        let refused = |change: &dyn Fn(&mut Bookmark)| {
            let mut file = file.clone();
            change(&mut file.bookmarks[1]);
            SceneFile::parse(&file.to_text()).unwrap_err().to_string()
        };
        assert!(refused(&|odd| odd.up = DVec3::ZERO).contains("bookmark 2: up is no direction"));
        assert!(refused(&|odd| odd.digit = Some(10)).contains("bookmark 2: digit is 10, expected 0 to 9"));
        assert!(refused(&|odd| odd.eye.x = 1e300).contains("bookmark 2: eye is not finite, or beyond"));
    }
}
