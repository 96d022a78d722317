//! Points of a cloud that are turned into a mirror: water by its class, a polished floor by a box around it, a chrome
//! part by an attribute, or a whole cloud. Reflections magnify the errors of normals, so the points may get smoother
//! ones.

use cloud::{Chunk, Cloud, ValueRange};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::mirror::{one, refraction_problem};

/// A choice of points of a cloud.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PointChoice {
    #[default]
    All,
    /// The points of this class; 9 is water.
    Class(u8),
    /// The points in this box in world coordinates, bounds included.
    Box { min: DVec3, max: DVec3 },
    /// The points whose attribute is in a range, bounds included.
    Attribute { name: String, low: f64, high: f64 },
}

/// The source of the normals of a mirror's points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MirrorNormals {
    /// The points' own normals.
    #[default]
    Own,
    /// The mean of the normals around each point, within about this radius in world units.
    Smooth { radius: f64 },
    /// The normal of the plane through each point's nearest neighbours in the mirror, 3 to 64.
    Fit { neighbours: u32 },
    /// The normal of the plane through all of the points: still water.
    Flatten,
}

/// Some points of a cloud, and how they reflect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorPoints {
    /// The path of a cloud, as in `clouds`, or its name.
    pub cloud: String,
    #[serde(default)]
    pub points: PointChoice,
    /// The share of the light that is reflected, 0 to 1; the remainder is diffuse.
    #[serde(default = "one")]
    pub specular_intensity: f32,
    /// The power of the lobe, as in `Mirror`.
    #[serde(default)]
    pub specular_power: f32,
    /// Whether they are no mirror: their specular intensity is the share of a highlight of lights.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gloss: bool,
    #[serde(default)]
    pub normals: MirrorNormals,
    /// The index of refraction, as in `Mirror`: what is behind the points is seen through one interface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refraction: Option<f32>,
}

impl PointChoice {
    /// The name of the attribute that decides.
    pub fn attribute(&self) -> Option<&str> {
        match self {
            Self::All | Self::Box { .. } => None,
            Self::Class(_) => Some("classification"),
            Self::Attribute { name, .. } => Some(name),
        }
    }

    /// For each point of a chunk, whether it is chosen. Points without the deciding attribute are not.
    pub fn marks(&self, cloud: &Cloud, chunk: &Chunk) -> Vec<bool> {
        let by_attribute = |low: f64, high: f64| {
            let index = self.attribute().and_then(|name| cloud.column_of(name));
            match index.and_then(|index| chunk.columns.get(index)?.as_deref()) {
                Some(column) => {
                    let range = ValueRange::new(low, high);
                    (0..column.len()).map(|index| range.has(column, index)).collect()
                }
                None => vec![false; chunk.len()],
            }
        };
        match *self {
            Self::All => vec![true; chunk.len()],
            Self::Class(class) => by_attribute(class.into(), class.into()),
            Self::Attribute { low, high, .. } => by_attribute(low, high),
            Self::Box { min, max } => {
                let bounds = cloud::Bounds { min, max };
                (0..chunk.len()).map(|index| bounds.contains(chunk.position(index))).collect()
            }
        }
    }

    fn problem(&self) -> Option<String> {
        match self {
            Self::All | Self::Class(_) => None,
            Self::Box { min, max } => {
                let is_box = min.is_finite() && max.is_finite() && min.cmple(*max).all();
                (!is_box).then(|| format!("the box from {min} to {max} is empty"))
            }
            Self::Attribute { name, low, high } => {
                let is_range = low.is_finite() && high.is_finite() && low <= high;
                (!is_range).then(|| format!("the range of {name} from {low} to {high} is empty"))
            }
        }
    }
}

impl MirrorPoints {
    /// All points of a cloud, as a perfect mirror.
    pub fn whole(cloud: String) -> Self {
        let (points, normals) = (PointChoice::All, MirrorNormals::Own);
        Self { cloud, points, specular_intensity: one(), specular_power: 0.0, gloss: false, normals, refraction: None }
    }

    /// Whether it applies to the cloud that came from `input` (a path or a built-in name) and has the name `name`.
    pub fn is_of(&self, input: &str, name: &str) -> bool {
        self.cloud == input || self.cloud == name
    }

    /// Why it is not a valid mirror, in words.
    pub fn problem(&self) -> Option<String> {
        if !(0.0..=1.0).contains(&self.specular_intensity) {
            return Some(format!("specular_intensity is {}, expected 0 to 1", self.specular_intensity));
        }
        if !(self.specular_power >= 0.0 && self.specular_power.is_finite()) {
            return Some(format!("specular_power is {}, expected 0 or more", self.specular_power));
        }
        if self.gloss && self.specular_power == 0.0 {
            return Some("specular_power is 0, expected more where points are glossy".into());
        }
        if self.gloss && self.refraction.is_some() {
            return Some("refraction is for mirrors, and glossy points are none".into());
        }
        if let Some(problem) = refraction_problem(self.refraction) {
            return Some(problem);
        }
        match self.normals {
            MirrorNormals::Smooth { radius } if !(radius > 0.0 && radius.is_finite()) => {
                Some(format!("the radius of smoothed normals is {radius}, expected more than 0"))
            }
            MirrorNormals::Fit { neighbours } if !(3..=64).contains(&neighbours) => {
                Some(format!("a plane is fitted to {neighbours} neighbours, expected 3 to 64"))
            }
            _ => self.points.problem(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Column, ColumnType};

    use super::*;

    fn cloud() -> Cloud {
        let mut chunk = Chunk::new(0, DVec3::new(1e6, 0.0, 0.0), vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        chunk.columns =
            vec![Some(Arc::new(Column::U8(vec![2, 9, 9]))), Some(Arc::new(Column::F32(vec![0.1, f32::NAN, 0.3])))];
        let attribute = |name: &str, column_type| Attribute { name: name.into(), column_type };
        let attributes = vec![attribute("classification", ColumnType::U8), attribute("wet", ColumnType::F32)];
        Cloud { attributes, chunks: vec![chunk], ..Cloud::default() }
    }

    #[test]
    fn points_are_chosen_by_class_box_and_attribute() {
        let cloud = cloud();
        let marks = |choice: PointChoice| choice.marks(&cloud, &cloud.chunks[0]);
        assert_eq!(marks(PointChoice::All), [true; 3]);
        assert_eq!(marks(PointChoice::Class(9)), [false, true, true]);
        let (min, max) = (DVec3::new(1e6 - 0.5, -1.0, -1.0), DVec3::new(1e6 + 1.0, 1.0, 1.0));
        assert_eq!(marks(PointChoice::Box { min, max }), [true, true, false]);
        let by = |name: &str| PointChoice::Attribute { name: name.into(), low: 0.2, high: 0.4 };
        assert_eq!(marks(by("wet")), [false, false, true]);
        assert_eq!(marks(by("dry")), [false; 3]);
    }
}
