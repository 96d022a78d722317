//! What a scene says of one of its clouds alone: whether it is shown, where it stands, how it is coloured, and how large
//! its points are.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use cloud::Placement;
use glam::{DQuat, DVec3};
use param::Params as _;
use serde::{Deserialize, Serialize};

use crate::parameter_text::{text_of, value_of};
use crate::{Camera, Color, ColorBy};

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
    /// How far the cloud is moved in world units, after it is turned. Its file stays as it is.
    #[serde(rename = "move", default, skip_serializing_if = "is_zero")]
    pub shift: DVec3,
    /// How far it is turned about the world's x axis, then about its y axis, then about its z axis, in degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn: DVec3,
    /// The point that the turn leaves where it is, in the file's coordinates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<DVec3>,
    /// The names of the columns of a table, as `--columns` takes them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<String>,
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

fn is_zero(vector: &DVec3) -> bool {
    *vector == DVec3::ZERO
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_one(size: &f32) -> bool {
    *size == 1.0
}

impl CloudSettings {
    /// The sizes that points may have; `splat.size` has the same.
    pub const SIZES: RangeInclusive<f32> = 0.05..=20.0;

    /// The largest angle of a turn in degrees.
    pub const MOST_TURN: f64 = 360.0;

    /// Settings that leave everything open.
    pub fn of(cloud: String) -> Self {
        Self {
            cloud,
            on: true,
            size: 1.0,
            shift: DVec3::ZERO,
            turn: DVec3::ZERO,
            about: None,
            columns: None,
            color: BTreeMap::new(),
        }
    }

    /// Whether they leave everything open.
    pub fn say_nothing(&self) -> bool {
        let Self { cloud: _, on, size, shift, turn, about: _, columns, color } = self;
        *on && *size == 1.0 && is_zero(shift) && is_zero(turn) && columns.is_none() && color.is_empty()
    }

    /// How the cloud is turned and moved; `None` where it stays in its place.
    pub fn placement(&self) -> Option<Placement> {
        if is_zero(&self.shift) && is_zero(&self.turn) {
            return None;
        }
        let [x, y, z] = self.turn.to_array().map(f64::to_radians);
        let turn = DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
        Some(Placement::new(turn, self.about.unwrap_or_default(), self.shift))
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

    /// By what the cloud is coloured, if it has that of its own.
    pub fn color_by(&self) -> Option<ColorBy> {
        self.color.contains_key("by").then(|| self.color_of(&Color::default()).by)
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
        let most = Camera::MOST_COORDINATE;
        if !Camera::is_near(self.shift) {
            return Some(format!("move is {}, expected lengths of at most {most:e}", self.shift));
        }
        // A comparison that NaN fails.
        let is_angle = |angle: f64| angle.abs() <= Self::MOST_TURN;
        if !self.turn.to_array().into_iter().all(is_angle) {
            let most = Self::MOST_TURN;
            return Some(format!("turn is {}, expected degrees from -{most} to {most}", self.turn));
        }
        if let Some(about) = self.about.filter(|about| !Camera::is_near(*about)) {
            return Some(format!("about is {about}, expected coordinates of at most {most:e}"));
        }
        if !is_zero(&self.turn) && self.about.is_none() {
            return Some("turn has no `about = [x, y, z]` beside it, the point that stays where it is".into());
        }
        let mut color = Color::default();
        self.color.iter().find_map(|(name, value)| color.set_text(name, &text_of(value)).err().map(|e| e.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ramp, SceneFile};

    #[test]
    fn what_a_cloud_has_of_its_own_survives_the_text_and_the_rest_is_as_the_view_has_it() {
        let columns = Some("x,y,z,skip".to_owned());
        let mut own = CloudSettings { on: false, size: 1.5, columns, ..CloudSettings::of("a.laz".into()) };
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
        assert!(!CloudSettings { columns: own.columns.clone(), ..CloudSettings::of("a.laz".into()) }.say_nothing());
        assert!(own.is_of("a.laz", "x") && own.is_of("y", "a.laz") && !own.is_of("b.laz", "b"));
    }

    #[test]
    fn a_cloud_is_turned_about_the_axes_in_turn_and_then_moved_and_the_text_keeps_every_digit() {
        let about = DVec3::new(635_619.123_456_7, 4_100_000.25, 1.0 / 3.0);
        let placed = |shift: DVec3, turn: DVec3| {
            let own = CloudSettings { shift, turn, about: Some(about), ..CloudSettings::of("a.laz".into()) };
            let file = SceneFile { cloud_settings: vec![own], ..SceneFile::default() };
            assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file, "{}", file.to_text());
            file.cloud_settings[0].clone()
        };
        // About x, y goes to z; about y, z goes to x; about z, x goes to y.
        let own = placed(DVec3::new(0.05, 0.0, 0.1), DVec3::new(90.0, 90.0, 90.0));
        let place = own.placement().unwrap().point(about + DVec3::Y);
        assert!((place - (about + DVec3::new(0.05, 1.0, 0.1))).abs().max_element() < 1e-9, "{place}");
        assert!(!own.say_nothing());
        let still = placed(DVec3::ZERO, DVec3::ZERO);
        assert!(still.placement().is_none() && still.say_nothing());
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
        assert!(refusal("move = [0, nan, 0]").contains("cloud settings 1 (`a.laz`): move is [0, NaN, 0], expected"));
        assert!(refusal("move = [0, 1e300, 0]").contains("move is"));
        assert!(refusal("move = [0, 1]").contains("line 3"));
        assert!(
            refusal("turn = [0, 361, 0]\nabout = [0, 0, 0]")
                .contains("turn is [0, 361, 0], expected degrees from -360")
        );
        assert!(refusal("turn = [0, nan, 0]\nabout = [0, 0, 0]").contains("turn is [0, NaN, 0]"));
        assert!(refusal("turn = [0, 0, 1]\nabout = [inf, 0, 0]").contains("about is [inf, 0, 0]"));
        assert!(refusal("turn = [0, 0, 1]").contains("turn has no `about = [x, y, z]`"));
        let twice = "[[cloud_settings]]\ncloud = \"a.laz\"\n".repeat(2);
        let twice = SceneFile::parse(&twice).unwrap_err().to_string();
        assert!(twice.contains("cloud settings 2 (`a.laz`): the cloud has settings already"), "{twice}");
    }
}
