//! The draft of a mirror made of points: which points of a cloud will reflect, and how.

use scene::{MirrorNormals, MirrorPoints, PointChoice, WATER};
use world::CloudKey;

use crate::shared::language::english;
use crate::viewer::objects::clouds::CloudEntry;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Way {
    #[default]
    Class,
    Box,
    Attribute,
    All,
}

pub const WAYS: [(Way, &str); 4] = [
    (Way::Class, english!("a class")),
    (Way::Box, english!("a box around the picked point")),
    (Way::Attribute, english!("a range of an attribute")),
    (Way::All, english!("the whole cloud")),
];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NormalsWay {
    Own,
    Smooth,
    Fit,
    Flatten,
}

pub const NORMALS_WAYS: [(NormalsWay, &str, &str); 4] = [
    (NormalsWay::Own, english!("as they are"), english!("The points keep their normals")),
    (NormalsWay::Smooth, english!("smoothed"), english!("The mean of the normals around each point")),
    (
        NormalsWay::Fit,
        english!("fitted planes"),
        english!("The plane through the nearest neighbours among these points"),
    ),
    (NormalsWay::Flatten, english!("one plane"), english!("The plane through all of them: still water")),
];

/// What the user is choosing. No point reflects before the draft is applied.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
    pub cloud: Option<CloudKey>,
    pub way: Way,
    pub class: u8,
    /// The edge of the box, in world units; 0 if not chosen yet.
    pub edge: f64,
    pub attribute: String,
    pub low: f64,
    pub high: f64,
    pub normals: NormalsWay,
    /// The radius around a point within which normals are averaged, in world units; 0 if not chosen yet.
    pub radius: f64,
    pub neighbours: u32,
    pub specular_intensity: f32,
    pub specular_power: f32,
    /// The index of refraction, if light goes through the points.
    pub refraction: Option<f32>,
    /// Whether the points show highlights of lights and reflect nothing else.
    pub gloss: bool,
    /// The choice that was counted last, and how many points it has.
    pub counted: Option<(MirrorPoints, Result<u64, String>)>,
    pub is_counting: bool,
}

impl Default for Draft {
    fn default() -> Self {
        Self {
            cloud: None,
            way: Way::default(),
            class: WATER_CLASS,
            edge: 0.0,
            attribute: String::new(),
            low: 0.0,
            high: 1.0,
            normals: NormalsWay::Smooth,
            radius: 0.0,
            neighbours: 32,
            specular_intensity: CLEAR,
            specular_power: 0.0,
            refraction: Some(WATER),
            gloss: false,
            counted: None,
            is_counting: false,
        }
    }
}

/// The class of water in LAS files.
const WATER_CLASS: u8 = 9;

/// The specular intensity of clear points, for which Fresnel's equations say what they reflect.
const CLEAR: f32 = 1.0;
/// The specular intensity of opaque points: reflections are bright, and the points' own colour still shines through.
const OPAQUE: f32 = 0.8;

impl Draft {
    fn is_water(&self) -> bool {
        self.way == Way::Class && self.class == WATER_CLASS
    }

    /// Makes water clear and all else opaque when the choice of points has changed from one to the other.
    pub fn suit_material(&mut self, before: &Self) {
        if self.is_water() != before.is_water() {
            let is_water = self.is_water();
            self.refraction = is_water.then_some(WATER);
            self.specular_intensity = if is_water { CLEAR } else { OPAQUE };
        }
    }

    pub fn on_counted(&mut self, wanted: MirrorPoints, result: Result<u64, String>) {
        self.is_counting = false;
        self.counted = Some((wanted, result));
    }

    pub fn wanted(&self, entry: &CloudEntry, picked: Option<glam::DVec3>) -> Option<MirrorPoints> {
        let points = match self.way {
            Way::All => PointChoice::All,
            Way::Class => PointChoice::Class(self.class),
            Way::Box => {
                let half = glam::DVec3::splat(self.edge * 0.5);
                picked.map(|center| PointChoice::Box { min: center - half, max: center + half })?
            }
            Way::Attribute if self.attribute.is_empty() => return None,
            Way::Attribute => {
                PointChoice::Attribute { name: self.attribute.clone(), low: self.low, high: self.high.max(self.low) }
            }
        };
        let normals = match self.normals {
            NormalsWay::Own => MirrorNormals::Own,
            NormalsWay::Smooth => MirrorNormals::Smooth { radius: self.radius },
            NormalsWay::Fit => MirrorNormals::Fit { neighbours: self.neighbours },
            NormalsWay::Flatten => MirrorNormals::Flatten,
        };
        Some(MirrorPoints {
            cloud: entry.input.clone(),
            points,
            specular_intensity: self.specular_intensity,
            specular_power: self.specular_power,
            gloss: self.is_gloss(),
            normals,
            refraction: self.refraction.filter(|_| !self.is_gloss()),
        })
    }

    /// Whether the points show highlights of lights and are no mirror.
    fn is_gloss(&self) -> bool {
        self.gloss && self.specular_power > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_is_clear_and_other_points_are_opaque_unless_a_person_says_otherwise() {
        let water = Draft::default();
        assert_eq!((water.refraction, water.specular_intensity), (Some(WATER), CLEAR));
        let mut floor = Draft { way: Way::Box, ..water.clone() };
        floor.suit_material(&water);
        assert_eq!((floor.refraction, floor.specular_intensity), (None, OPAQUE));
        // A choice stays while the points stay of one kind.
        let mut glass = Draft { refraction: Some(1.5), ..floor.clone() };
        glass.suit_material(&floor);
        assert_eq!(glass.refraction, Some(1.5));
        let mut again = Draft { way: Way::Class, ..glass.clone() };
        again.suit_material(&glass);
        assert_eq!(again.refraction, Some(WATER));
    }
}
