//! Clip volumes: parts of space whose points are shown, or hidden.

use cloud::{Bounds, ClipVolume, Volume, VolumeShape};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::Camera;
use crate::mirror::{UNIT_TOLERANCE, identity};

/// The most clip volumes of a scene: every point is tested against each.
pub const MOST_CLIPS: usize = 64;

/// The most corners of a prism.
const MOST_CORNERS: usize = 1000;
/// The smallest and the largest size in world units; within them f64 neither over- nor underflows.
const SIZES: std::ops::RangeInclusive<f64> = 1e-9..=1e12;

/// The number of pieces of a circle that is drawn.
const RING_STEPS: u32 = 48;
/// The least share of its size that one move of a side leaves of a clip volume.
const THINNEST: f64 = 1e-3;

/// The shape of a clip volume.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ClipShape {
    #[default]
    Box,
    /// An ellipsoid whose three diameters are the size.
    Sphere,
    /// All within half of the size's third component of its middle plane.
    Slab,
    /// The points on the lines through a polygon.
    Prism(Prism),
}

/// A polygon in space, and the lines through it. The lines are parallel, or rays from an eye, as a polygon that is
/// drawn over a picture in perspective needs them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prism {
    /// The corners.
    pub points: Vec<DVec3>,
    /// The direction of the lines, or that in which the rays go.
    pub direction: DVec3,
    /// The place from which rays go.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eye: Option<DVec3>,
}

/// The side of a clip volume whose points are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    #[default]
    Inside,
    Outside,
}

/// A clip volume, as `[[clips]]` of a scene file. Lines of a prism and the other shapes are placed in the same way: its
/// own coordinates are scaled by the size, then rotated, then moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clip {
    #[serde(default)]
    pub name: String,
    #[serde(default)]
    pub shape: ClipShape,
    #[serde(default = "yes")]
    pub on: bool,
    /// The position of its middle in world units.
    #[serde(default)]
    pub position: DVec3,
    /// Rotates its own axes into the world's.
    #[serde(default = "identity")]
    pub rotation: DQuat,
    /// The full lengths along its own axes in world units; for a prism the scale of its coordinates.
    #[serde(default = "ones")]
    pub size: DVec3,
    #[serde(default)]
    pub keep: Keep,
}

fn yes() -> bool {
    true
}

fn ones() -> DVec3 {
    DVec3::ONE
}

impl ClipShape {
    /// The name in a scene file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Sphere => "sphere",
            Self::Slab => "slab",
            Self::Prism(_) => "prism",
        }
    }

    /// Why it is no valid shape of this size, in words.
    fn problem(&self, size: DVec3) -> Option<String> {
        let Self::Prism(Prism { points, direction, eye }) = self else { return None };
        let is_near = |place: &DVec3| Camera::is_near(*place);
        if !(3..=MOST_CORNERS).contains(&points.len()) {
            return Some(format!("points are {}, expected 3 to {MOST_CORNERS}", points.len()));
        }
        if !points.iter().chain(eye).all(is_near) {
            return Some("points or eye are not finite, or too far away".into());
        }
        if direction.try_normalize().is_none() {
            return Some(format!("direction is {direction}, expected a direction"));
        }
        let is_before = |eye: &DVec3| points.iter().all(|point| ((*point - *eye) * size).dot(*direction) > 0.0);
        (!eye.iter().all(is_before)).then(|| "a point lies behind the eye, expected all of them before it".into())
    }
}

impl Clip {
    /// A volume that keeps its inside, with level axes.
    pub fn around(shape: ClipShape, bounds: Bounds) -> Self {
        let name = shape.name().into();
        let (position, rotation) = (bounds.center(), DQuat::IDENTITY);
        let size =
            bounds.size().max(DVec3::splat(bounds.size().max_element() * 1e-3)).max(DVec3::splat(*SIZES.start()));
        Self { name, shape, on: true, position, rotation, size, keep: Keep::Inside }
    }

    /// The volume that points are tested against.
    pub fn volume(&self) -> ClipVolume {
        let shape = match &self.shape {
            ClipShape::Box => VolumeShape::Box,
            ClipShape::Sphere => VolumeShape::Sphere,
            ClipShape::Slab => VolumeShape::Slab,
            ClipShape::Prism(Prism { points, direction, eye }) => {
                VolumeShape::Prism { points: points.clone(), direction: *direction, eye: *eye }
            }
        };
        let volume = Volume::new(shape, self.position, self.rotation, self.size);
        ClipVolume { volume, keeps_inside: self.keep == Keep::Inside }
    }

    /// The clip's own axes in the world.
    fn axes(&self) -> DMat3 {
        DMat3::from_quat(self.rotation.normalize())
    }

    /// The middles of its sides, relative to its position: pairs of opposite sides, the lower one first. Only the
    /// sides across the third axis for a slab, none for a prism.
    pub(crate) fn sides(&self) -> Vec<DVec3> {
        let axes = match self.shape {
            ClipShape::Box | ClipShape::Sphere => 0..3,
            ClipShape::Slab => 2..3,
            ClipShape::Prism(_) => 0..0,
        };
        let half = |axis: usize| self.axes().col(axis) * (self.size[axis] * 0.5);
        axes.flat_map(|axis| [-half(axis), half(axis)]).collect()
    }

    /// Moves one of its sides along its own axis; the opposite side stays.
    pub(crate) fn move_side(&mut self, side: usize, shift: DVec3) {
        let Some(outward) = self.sides().get(side).and_then(|middle| middle.try_normalize()) else { return };
        let axis = if self.shape == ClipShape::Slab { 2 } else { side / 2 };
        let before = self.size[axis];
        self.size[axis] = (before + outward.dot(shift)).max(before * THINNEST).max(*SIZES.start());
        self.position += outward * ((self.size[axis] - before) * 0.5);
    }

    /// Lines that show where its border is, in world coordinates. A slab is drawn as wide as its size says, and a prism
    /// as long as it is wide.
    pub fn outline(&self) -> Vec<[DVec3; 2]> {
        let world = |own: DVec3| self.position + self.axes() * (own * self.size);
        let ring = |place: &dyn Fn(f64, f64) -> DVec3| -> Vec<[DVec3; 2]> {
            let at = |step: u32| {
                let (sine, cosine) = (f64::from(step) / f64::from(RING_STEPS) * std::f64::consts::TAU).sin_cos();
                world(place(cosine * 0.5, sine * 0.5))
            };
            (0..RING_STEPS).map(|step| [at(step), at(step + 1)]).collect()
        };
        match &self.shape {
            ClipShape::Box | ClipShape::Slab => {
                let corners = Bounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) }.corners().map(world);
                let edges = (0..8).flat_map(|corner| [1, 2, 4].map(|step| (corner, corner | step)));
                edges.filter(|(from, to)| from != to).map(|(from, to)| [corners[from], corners[to]]).collect()
            }
            ClipShape::Sphere => [
                ring(&|a, b| DVec3::new(a, b, 0.0)),
                ring(&|a, b| DVec3::new(0.0, a, b)),
                ring(&|a, b| DVec3::new(b, 0.0, a)),
            ]
            .concat(),
            ClipShape::Prism(Prism { points, direction, eye }) => {
                let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
                let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
                let along = direction.normalize_or_zero() * (high - low).length() * 0.5;
                let ends = |point: DVec3| match eye {
                    // Seen from the eye itself, where the polygon was drawn, a side is a point: near the eye, rounding
                    // would lead it anywhere.
                    Some(eye) => [0.001, 1.5].map(|share| world(*eye + (point - *eye) * share)),
                    None => [point - along, point + along].map(world),
                };
                let sides = points.iter().zip(points.iter().cycle().skip(1));
                let sides = sides.map(|(from, to)| [world(*from), world(*to)]);
                sides.chain(points.iter().map(|point| ends(*point))).collect()
            }
        }
    }

    /// Why it is not a valid clip volume, in words.
    pub fn problem(&self) -> Option<String> {
        let length = self.rotation.length();
        let is_unit = (length - 1.0).abs() < UNIT_TOLERANCE;
        if !Camera::is_near(self.position) {
            return Some(format!("position is {}, expected finite coordinates", self.position));
        }
        if !is_unit {
            return Some(format!("rotation is a quaternion of length {length}, expected 1"));
        }
        if !self.size.to_array().iter().all(|size| SIZES.contains(size)) {
            let (least, most) = (SIZES.start(), SIZES.end());
            return Some(format!("size is {}, expected lengths from {least:e} to {most:e}", self.size));
        }
        self.shape.problem(self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    fn prism(eye: Option<DVec3>) -> ClipShape {
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.1, 1.0 / 3.0, 0.0)];
        ClipShape::Prism(Prism { points, direction: DVec3::Z, eye })
    }

    #[test]
    fn clips_survive_the_text_to_the_last_digit() {
        let shapes = [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab, prism(None), prism(Some(-DVec3::Z))];
        let clip = |(number, shape): (usize, ClipShape)| Clip {
            name: format!("{} {number}", shape.name()),
            shape,
            on: number % 2 == 0,
            position: DVec3::new(635_619.123_456_7, 0.1, 1.0 / 3.0),
            rotation: DQuat::from_rotation_z(0.3),
            size: DVec3::new(1.0, 2.0 / 3.0, 0.7),
            keep: if number == 1 { Keep::Outside } else { Keep::Inside },
        };
        let file = SceneFile { clips: shapes.into_iter().enumerate().map(clip).collect(), ..SceneFile::default() };
        assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file, "{}", file.to_text());
        let short =
            "[[clips]]\nshape = { prism = { points = [[0, 0, 0], [1, 0, 0], [1, 1, 0.5]], direction = [0, 0, 1] } }\n";
        let short = SceneFile::parse(short).unwrap().clips.remove(0);
        assert!(short.on && short.keep == Keep::Inside && short.size == DVec3::ONE && short.position == DVec3::ZERO);
    }

    #[test]
    fn what_is_no_clip_is_refused_with_its_number_and_name() {
        let refusal = |line: &str| {
            let text = format!("[[clips]]\nshape = \"box\"\n[[clips]]\nname = \"room\"\n{line}\n");
            SceneFile::parse(&text).unwrap_err().to_string()
        };
        let expect = |line: &str, part: &str| {
            let error = refusal(line);
            assert!(error.contains("clip 2 (`room`)") && error.contains(part), "{line}: {error}");
        };
        expect("size = [1.0, 0.0, 1.0]", "size is [1, 0, 1]");
        expect("size = [1.0, nan, 1.0]", "size is");
        expect("position = [1e300, 0.0, 1.0]", "position is");
        expect("rotation = [0.0, 0.0, 0.0, 2.0]", "length 2");
        let prism = |points: &str, rest: &str| format!("shape = {{ prism = {{ points = {points}, {rest} }} }}");
        let three = "[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]";
        expect(&prism("[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]", "direction = [0, 0, 1]"), "points are 2, expected 3 to");
        expect(&prism("[[0.0, 0.0, inf], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]", "direction = [0, 0, 1]"), "not finite");
        expect(&prism(three, "direction = [0, 0, 0]"), "direction is");
        expect(&prism(three, "direction = [0, 0, 1], eye = [0, 0, 1]"), "behind the eye");
        // The size moves corners to behind the eye, too.
        let slanted = prism(three, "direction = [-1, 0, 1.5], eye = [0, 0, -1]");
        expect(&format!("{slanted}\nsize = [9, 1, 1]"), "behind the eye");
        assert!(SceneFile::parse(&format!("[[clips]]\n{slanted}\n")).is_ok());
        assert!(refusal("shape = \"cone\"").contains("line 5"));
        assert!(refusal("keep = \"both\"").contains("line 5"));
        let many = "[[clips]]\n".repeat(65);
        assert!(SceneFile::parse(&many).unwrap_err().to_string().contains("65 clips, expected at most 64"));
    }
}
