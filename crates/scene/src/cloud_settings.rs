//! What a scene says of one of its clouds alone: whether it is shown, how it is coloured, and how large its points are.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use param::Params as _;
use serde::{Deserialize, Serialize};

use crate::Color;
use crate::parameter_text::{text_of, value_of};

/// The settings of one cloud. What they leave open is as the parameters of the view have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CloudSettings {
    /// The path of a cloud, as in `clouds`, or its name.
    pub cloud: String,
    /// Whether the cloud is shown.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub on: bool,
    /// The radii of its points, relative to those that they would have.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub size: f32,
    /// Parameters of the group `color`, by their names in the group.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub color: BTreeMap<String, toml::Value>,
}

fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_yes(on: &bool) -> bool {
    *on
}

fn one() -> f32 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_one(size: &f32) -> bool {
    *size == 1.0
}

impl CloudSettings {
    /// The sizes that points may have; `splat.size` has the same.
    pub const SIZES: RangeInclusive<f32> = 0.05..=20.0;

    /// Settings that leave everything open.
    pub fn of(cloud: String) -> Self {
        Self { cloud, on: true, size: 1.0, color: BTreeMap::new() }
    }

    /// Whether they leave everything open.
    pub fn say_nothing(&self) -> bool {
        let Self { cloud: _, on, size, color } = self;
        *on && *size == 1.0 && color.is_empty()
    }

    /// Whether they are for the cloud that came from `input` (a path or a built-in name) and has the name `name`.
    pub fn is_of(&self, input: &str, name: &str) -> bool {
        self.cloud == input || self.cloud == name
    }

    /// The colour parameters of the cloud, where the view has `all`.
    pub fn color_of(&self, all: &Color) -> Color {
        let mut color = all.clone();
        for (name, value) in &self.color {
            // A value that cannot be read has been refused with the scene.
            let _ = color.set_text(name, &text_of(value));
        }
        color
    }

    /// Sets a colour parameter from text.
    pub fn set_color(&mut self, name: &str, text: &str) {
        self.color.insert(name.to_owned(), value_of(&format!("color.{name}"), text));
    }

    /// Why they are not valid, in words.
    pub fn problem(&self) -> Option<String> {
        let (least, most) = (Self::SIZES.start(), Self::SIZES.end());
        if !Self::SIZES.contains(&self.size) {
            return Some(format!("size is {}, expected {least} to {most}", self.size));
        }
        let mut color = Color::default();
        self.color.iter().find_map(|(name, value)| color.set_text(name, &text_of(value)).err().map(|e| e.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColorBy, Ramp, SceneFile};

    #[test]
    fn what_a_cloud_has_of_its_own_survives_the_text_and_the_rest_is_as_the_view_has_it() {
        let mut own = CloudSettings { on: false, size: 1.5, ..CloudSettings::of("a.laz".into()) };
        for (name, text) in [("by", "attribute"), ("attribute", "1"), ("ramp", "viridis"), ("low", "0.25")] {
            own.set_color(name, text);
        }
        let file = SceneFile { cloud_settings: vec![own.clone()], ..SceneFile::default() };
        let back = SceneFile::parse(&file.to_text()).unwrap();
        assert_eq!(back, file, "{}", file.to_text());
        let all = Color { high: 0.75, ramp: Ramp::Gray, ..Color::default() };
        let color = back.cloud_settings[0].color_of(&all);
        let wanted = Color {
            by: ColorBy::Attribute,
            attribute: "1".into(),
            ramp: Ramp::Viridis,
            low: 0.25,
            high: 0.75,
            ..Color::default()
        };
        assert_eq!(color, wanted);
        assert!(!own.say_nothing() && CloudSettings::of("a.laz".into()).say_nothing());
        assert!(own.is_of("a.laz", "x") && own.is_of("y", "a.laz") && !own.is_of("b.laz", "b"));
    }

    #[test]
    fn odd_settings_of_a_cloud_are_refused_with_what_is_expected() {
        let refusal = |line: &str| {
            SceneFile::parse(&format!("[[cloud_settings]]\ncloud = \"a.laz\"\n{line}")).unwrap_err().to_string()
        };
        assert_eq!(refusal("size = 0"), "not a scene: cloud settings 1 (`a.laz`): size is 0, expected 0.05 to 20");
        assert!(refusal("size = nan").contains("size is NaN"));
        let by = refusal("color = { by = \"hight\" }");
        assert!(by.contains("cloud settings 1 (`a.laz`): color.by") && by.contains("height"), "{by}");
        assert!(refusal("color = { low = 2 }").contains("color.low: 2 is out of range, expected 0 to 1"));
        assert!(refusal("color = { lows = 0.5 }").contains("color.lows: no such parameter"));
        assert!(refusal("colour = 1").contains("colour"));
        let twice = "[[cloud_settings]]\ncloud = \"a.laz\"\n".repeat(2);
        let twice = SceneFile::parse(&twice).unwrap_err().to_string();
        assert!(twice.contains("cloud settings 2 (`a.laz`): the cloud has settings already"), "{twice}");
    }
}
