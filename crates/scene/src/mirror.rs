//! Mirrors with a formula or of a mesh: their material, their place, and the points that represent them.

use cloud::Chunk;
use cloud::sampling::{Placement, StarShape, Surface};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use param::Choice as _;

use crate::{METHODS, Method, MirrorMesh, MirrorSurface, surface_points};

/// The most mirrors of a scene. Each brings at least 20,000 points, and the reflection of each in each is searched for.
pub const MOST_MIRRORS: usize = 64;

impl MirrorSurface {
    /// Whether a mirror with a formula is drawn by it. `as_points` is the mirror's own preference.
    pub fn is_exact(self, as_points: bool) -> bool {
        match self {
            Self::Exact => true,
            Self::Points => false,
            Self::Auto => !as_points,
        }
    }
}

/// The shape of a mirror whose size is 1, in its own coordinates. Lengths are relative to the mirror's size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// In z = 0, x from -1 to 1 and y from -height to height.
    Plane { height: f64 },
    /// A sphere of radius 1.
    Sphere,
    /// z = (x^2 + y^2) / (4 focal_length) up to the rim of radius 1; hollow towards +z.
    Paraboloid { focal_length: f64 },
    /// A column or pipe: the mantle of radius 1 about the z axis, from -height to height. Both ends are open, so that
    /// it encloses nothing, and its inner side can be seen.
    Cylinder { height: f64 },
    /// A tube of this radius about the circle of radius 1 in z = 0.
    Torus { tube: f64 },
    /// Star-shaped, with convex and hollow patches; its mean radius is 1.
    Blob,
    /// Star-shaped, with hundreds of small bumps.
    Coral,
    /// Triangles: the middle of their bounds is the origin, and they reach to a distance of 1.
    Mesh(MirrorMesh),
}

impl Shape {
    /// One of each that has a formula, in typical proportions.
    pub const WITH_FORMULA: [Self; 7] = [
        Self::Plane { height: 0.75 },
        Self::Sphere,
        Self::Paraboloid { focal_length: 0.6 },
        Self::Cylinder { height: 1.5 },
        Self::Torus { tube: 0.4 },
        Self::Blob,
        Self::Coral,
    ];

    /// The name in a scene file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Plane { .. } => "plane",
            Self::Sphere => "sphere",
            Self::Paraboloid { .. } => "paraboloid",
            Self::Cylinder { .. } => "cylinder",
            Self::Torus { .. } => "torus",
            Self::Blob => "blob",
            Self::Coral => "coral",
            Self::Mesh(_) => "mesh",
        }
    }

    /// Whether it encloses a solid, out of which its normals point.
    pub fn is_closed(&self) -> bool {
        !matches!(self, Self::Plane { .. } | Self::Paraboloid { .. } | Self::Cylinder { .. })
    }

    /// Whether a formula says where a ray meets it. Without one, it is drawn as points.
    pub fn has_formula(&self) -> bool {
        !matches!(self, Self::Mesh(_))
    }

    /// How far its surface reaches from the origin in the direction of -z, where it stands on something.
    fn foot(&self) -> f64 {
        match *self {
            // Two hundredths off, so that it does not fight for pixels with the surface under it.
            Self::Plane { .. } => 0.02,
            Self::Sphere => 1.0,
            Self::Paraboloid { .. } => 0.0,
            Self::Cylinder { height } => height,
            Self::Torus { tube } => tube,
            Self::Blob => blob_radius(-DVec3::Z),
            Self::Coral => coral_radius(-DVec3::Z),
            Self::Mesh(ref mesh) => -mesh.surface.heights()[0],
        }
    }

    /// The radius of a ball about the origin that contains the surface.
    pub fn reach(&self) -> f64 {
        match *self {
            Self::Plane { height } | Self::Cylinder { height } => 1.0_f64.hypot(height),
            Self::Sphere | Self::Mesh(_) => 1.0,
            Self::Paraboloid { focal_length } => 1.0_f64.hypot(1.0 / (4.0 * focal_length)),
            Self::Torus { tube } => 1.0 + tube,
            // The sums of the amplitudes below.
            Self::Blob => 1.16,
            Self::Coral => 1.11,
        }
    }

    fn problem(&self) -> Option<String> {
        let (name, value, most) = match *self {
            Self::Plane { height } | Self::Cylinder { height } => ("height", height, 1e3),
            Self::Paraboloid { focal_length } => ("focal_length", focal_length, 1e6),
            Self::Torus { tube } => ("tube", tube, 1.0),
            Self::Sphere | Self::Blob | Self::Coral => return None,
            Self::Mesh(ref mesh) => return mesh.name.is_empty().then(|| "the mesh has no name".to_owned()),
        };
        let is_fine = value > 0.0 && value < most;
        (!is_fine).then(|| format!("{name} is {value}, expected more than 0 and less than {most}"))
    }
}

/// The linear grey of mirrors without a colour of their own, as seen where they do not reflect.
pub const MIRROR_GREY: f32 = 0.5;

pub(crate) fn identity() -> DQuat {
    DQuat::IDENTITY
}

fn grey() -> [f32; 3] {
    [MIRROR_GREY; 3]
}

pub(crate) fn one() -> f32 {
    1.0
}

/// A mirror in the scene. In a scene file only shape, position and size are needed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    #[serde(default)]
    pub name: String,
    pub shape: Shape,
    /// The position of its middle, or of a paraboloid's vertex, in world units.
    pub position: DVec3,
    /// Rotates the shape's own axes into the world's.
    #[serde(default = "identity")]
    pub rotation: DQuat,
    /// The size in world units.
    pub size: f64,
    /// The linear albedo of its diffuse part, and the tint of its reflections.
    #[serde(default = "grey")]
    pub color: [f32; 3],
    /// The share of the light that is reflected, 0 to 1; the remainder is diffuse.
    #[serde(default = "one")]
    pub specular_intensity: f32,
    /// The exponent of its highlights of lights; 0 for none, as a perfect mirror shows no lamp without size.
    #[serde(default)]
    pub specular_power: f32,
    /// The index of refraction of what is behind its surface, if light goes through it; else it is opaque. Fresnel's
    /// equations split the share that is reflected between what it reflects and what is seen through it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refraction: Option<f32>,
    /// Whether it is drawn as sampled points unless `mirror.surface` says otherwise: the published condition of the
    /// built-in scenes.
    #[serde(default)]
    pub as_points: bool,
    /// The method that finds what it shows to the camera, by name; `None` for `reflection.method`.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "method_name")]
    pub method: Option<Method>,
}

/// A method as scene files name it.
mod method_name {
    use serde::{Deserialize as _, Deserializer, Serializer, de::Error};

    use super::*;

    pub fn serialize<S: Serializer>(method: &Option<Method>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_some(method.map_or("", Method::name))
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<Option<Method>, D::Error> {
        let name = String::deserialize(deserializer)?;
        // `auto` and `none` are known names, which `Mirror::problem` refuses for one mirror.
        let rows = METHODS.iter().filter(|row| !matches!(row.method, Method::Auto | Method::None));
        let names = || rows.map(|row| row.name).collect::<Vec<_>>().join(", ");
        let expected = || D::Error::custom(format!("`{name}` is no method; expected one of {}", names()));
        Method::from_name(&name).map(Some).ok_or_else(expected)
    }
}

/// The tolerance of the length of a written quaternion: the precision of eight printed digits.
pub(crate) const UNIT_TOLERANCE: f64 = 1e-4;

/// The indices of refraction that are taken: from no other medium to one beyond every clear material.
pub const REFRACTION: std::ops::RangeInclusive<f32> = 1.0..=4.0;

/// The index of refraction of water.
pub const WATER: f32 = 1.33;

pub(crate) fn refraction_problem(refraction: Option<f32>) -> Option<String> {
    let odd = refraction.filter(|index| !REFRACTION.contains(index))?;
    Some(format!("refraction is {odd}, expected {} to {}", REFRACTION.start(), REFRACTION.end()))
}

/// The fewest and the most points that represent a mirror: enough for its outline, and never the larger part of a
/// scene.
const SAMPLES: std::ops::RangeInclusive<f64> = 20_000.0..=200_000.0;

impl Mirror {
    /// A perfect mirror that stands on a surface at `point` and points away from it along `normal`; the shape's x axis
    /// is level. A plane lies on the surface.
    pub fn standing(shape: Shape, point: DVec3, normal: DVec3, up: DVec3, size: f64) -> Self {
        let z = normal.normalize_or(up.normalize_or(DVec3::Z));
        let x = up.cross(z).normalize_or(z.any_orthonormal_vector());
        Self {
            name: shape.name().to_string(),
            position: point + z * (shape.foot() * size),
            shape,
            rotation: DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z)),
            size,
            color: grey(),
            specular_intensity: one(),
            specular_power: 0.0,
            refraction: None,
            as_points: false,
            method: None,
        }
    }

    /// Whether it is drawn by its formula.
    pub fn is_exact(&self, surface: MirrorSurface) -> bool {
        self.shape.has_formula() && surface.is_exact(self.as_points)
    }

    /// Why it is not a valid mirror, in words.
    pub fn problem(&self) -> Option<String> {
        let length = self.rotation.length();
        let is_unit = (length - 1.0).abs() < UNIT_TOLERANCE;
        let out_of_range = |name: &str, values: &[f32]| {
            let odd = values.iter().find(|value| !(0.0..=1.0).contains(*value))?;
            Some(format!("{name} is {odd}, expected 0 to 1"))
        };
        if !self.position.is_finite() {
            return Some(format!("position is {}, expected finite coordinates", self.position));
        }
        if !is_unit {
            return Some(format!("rotation is a quaternion of length {length}, expected 1"));
        }
        if !(self.size > 0.0 && self.size.is_finite()) {
            return Some(format!("size is {}, expected more than 0", self.size));
        }
        if !(self.specular_power >= 0.0 && self.specular_power.is_finite()) {
            return Some(format!("specular_power is {}, expected 0 or more", self.specular_power));
        }
        if let (Some(_), Shape::Mesh(_)) = (self.refraction, &self.shape) {
            return Some("refraction is for shapes with a formula, and a mesh has none".into());
        }
        match self.method {
            Some(Method::None) => {
                return Some("method is none, which is for all mirrors: set specular_intensity to 0 instead".into());
            }
            Some(Method::Auto) => {
                return Some("method is auto, which is for all mirrors: leave it out instead".into());
            }
            _ => {}
        }
        out_of_range("specular_intensity", &[self.specular_intensity])
            .or_else(|| out_of_range("color", &self.color))
            .or_else(|| refraction_problem(self.refraction))
            .or_else(|| self.shape.problem())
    }

    /// The number of points that represent it next to a cloud in which a point takes `area_per_point` squared world
    /// units: equally dense, but neither too few nor too many.
    pub fn sample_count(&self, area_per_point: f64) -> usize {
        let wanted = self.surface().0.area() * self.size * self.size / area_per_point;
        let wanted = if wanted.is_finite() { wanted } else { *SAMPLES.end() };
        wanted.clamp(*SAMPLES.start(), *SAMPLES.end()) as usize
    }

    /// `count` points on it, evenly by area, with normals, radii and colour; none on a mesh whose file is not read. The
    /// same seed gives the same points.
    pub fn sample(&self, count: usize, seed: u64) -> Vec<Chunk> {
        let (surface, at) = self.surface();
        // Relative to the mirror's own position, so that coordinates of seven digits lose no precision.
        let at = Placement { translation: DVec3::ZERO, ..at };
        let mut points = surface.sample(count, seed);
        points.iter_mut().for_each(|point| *point = at.place(*point));
        let area = surface.area() * self.size * self.size;
        let radius = surface_points::splat_radius(area, count as u64);
        let mut chunks = Vec::new();
        surface_points::append(&mut chunks, points, radius, |_| self.color.map(f64::from));
        chunks.iter_mut().for_each(|chunk| chunk.origin += self.position);
        chunks
    }

    /// Whether another mirror is represented by the same points: they differ in nothing but name, material and method.
    pub fn has_points_of(&self, other: &Self) -> bool {
        let form = |mirror: &Self| (mirror.position, mirror.rotation, mirror.size, mirror.color);
        form(self) == form(other) && self.shape == other.shape
    }

    /// The surface and its placement.
    pub fn surface(&self) -> (Surface, Placement) {
        let surface = match self.shape {
            Shape::Plane { height } => Surface::Rectangle {
                corner: DVec3::new(-1.0, -height, 0.0),
                edges: [DVec3::X * 2.0, DVec3::Y * (2.0 * height)],
            },
            Shape::Sphere => Surface::Sphere { radius: 1.0 },
            Shape::Paraboloid { focal_length } => Surface::Paraboloid { focal_length, rim_radius: 1.0 },
            Shape::Cylinder { height } => Surface::Cylinder { radius: 1.0, half_height: height },
            Shape::Torus { tube } => Surface::Torus { ring: 1.0, tube },
            Shape::Blob => Surface::Star(StarShape { radius: blob_radius, gradient: blob_gradient }),
            Shape::Coral => Surface::Star(StarShape { radius: coral_radius, gradient: coral_gradient }),
            Shape::Mesh(ref mesh) => Surface::Mesh(mesh.surface.clone()),
        };
        let rotation = DMat3::from_quat(self.rotation.normalize());
        (surface, Placement { rotation, scale: self.size, translation: self.position })
    }
}

fn blob_radius(d: DVec3) -> f64 {
    1.0 + 0.10 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin()
}

fn blob_gradient(d: DVec3) -> DVec3 {
    let ((sin_x, cos_x), (sin_y, cos_y)) = ((6.0 * d.x + 1.0).sin_cos(), (5.0 * d.y).sin_cos());
    DVec3::new(0.10 * 6.0 * cos_x * sin_y, 0.10 * 5.0 * sin_x * cos_y, 0.06 * 7.0 * (7.0 * d.z).cos())
}

fn coral_radius(d: DVec3) -> f64 {
    let bumps = (19.0 * d.x).sin() * (17.0 * d.y).sin() * (23.0 * d.z).sin();
    1.0 + 0.08 * bumps + 0.03 * (41.0 * d.x + 3.0 * d.y).sin()
}

fn coral_gradient(d: DVec3) -> DVec3 {
    let [(sin_x, cos_x), (sin_y, cos_y), (sin_z, cos_z)] = [19.0 * d.x, 17.0 * d.y, 23.0 * d.z].map(f64::sin_cos);
    let ripple = 0.03 * (41.0 * d.x + 3.0 * d.y).cos();
    let bumps = DVec3::new(19.0 * cos_x * sin_y * sin_z, 17.0 * sin_x * cos_y * sin_z, 23.0 * sin_x * sin_y * cos_z);
    0.08 * bumps + ripple * DVec3::new(41.0, 3.0, 0.0)
}

#[cfg(test)]
mod tests {
    use cloud::unpack_normal;

    use super::*;

    /// On a slope, at coordinates of seven digits.
    fn standing(shape: Shape) -> (Mirror, DVec3, DVec3) {
        let (point, normal) = (DVec3::new(635_000.0, 5_077_000.0, 120.0), DVec3::new(0.3, -0.2, 0.9).normalize());
        (Mirror::standing(shape, point, normal, DVec3::Z, 2.5), point, normal)
    }

    fn all() -> impl Iterator<Item = Shape> {
        Shape::WITH_FORMULA.into_iter().chain([Shape::Mesh(MirrorMesh::hare())])
    }

    #[test]
    fn a_mirror_that_is_added_stands_on_the_surface_and_not_in_it() {
        for shape in all() {
            let (mirror, point, normal) = standing(shape.clone());
            assert_eq!(mirror.problem(), None, "{shape:?}");
            let heights = mirror
                .sample(20_000, 1)
                .iter()
                .flat_map(|chunk| {
                    (0..chunk.len()).map(|index| (chunk.position(index) - point).dot(normal)).collect::<Vec<_>>()
                })
                .fold(f64::INFINITY, f64::min);
            // The bumps beside a star's foot may reach a little lower.
            assert!((-0.2 * mirror.size..0.03 * mirror.size).contains(&heights), "{shape:?} is {heights} above");
        }
    }

    #[test]
    fn samples_keep_the_precision_of_the_mirror_and_lie_within_its_reach() {
        for shape in all() {
            let (mirror, _, _) = standing(shape.clone());
            let chunks = mirror.sample(5000, 3);
            assert_eq!(chunks.iter().map(Chunk::len).sum::<usize>(), 5000);
            let mut farthest: f64 = 0.0;
            for chunk in &chunks {
                for index in 0..chunk.len() {
                    farthest = farthest.max(chunk.position(index).distance(mirror.position));
                }
                assert!(chunk.normals.iter().flat_map(|normals| normals.iter()).all(|n| unpack_normal(*n).is_some()));
            }
            let reach = shape.reach() * mirror.size;
            assert!(farthest <= reach * (1.0 + 1e-6) && farthest > reach * 0.8, "{shape:?}: {farthest} of {reach}");
        }
        let (sphere, _, _) = standing(Shape::Sphere);
        for chunk in sphere.sample(1000, 1) {
            for index in 0..chunk.len() {
                let off = chunk.position(index).distance(sphere.position) - sphere.size;
                assert!(off.abs() < 1e-6, "{off}");
            }
        }
    }

    #[test]
    fn a_mirror_has_as_many_points_as_its_surroundings_within_limits() {
        let (mirror, _, _) = standing(Shape::Sphere);
        let area = 4.0 * std::f64::consts::PI * 2.5 * 2.5;
        assert_eq!(mirror.sample_count(area / 60_000.4), 60_000);
        assert_eq!(mirror.sample_count(1e9), 20_000);
        for too_dense in [1e-9, 0.0, f64::NAN] {
            assert_eq!(mirror.sample_count(too_dense), 200_000);
        }
    }

    #[test]
    fn mirrors_have_the_same_points_unless_form_place_or_colour_differ() {
        let (mirror, ..) = standing(Shape::Sphere);
        let kept: [fn(&mut Mirror); 6] = [
            |mirror| mirror.name = "ball".into(),
            |mirror| mirror.specular_intensity = 0.5,
            |mirror| mirror.specular_power = 30.0,
            |mirror| mirror.refraction = Some(WATER),
            |mirror| mirror.as_points = true,
            |mirror| mirror.method = Some(Method::EnvironmentMap),
        ];
        let other: [fn(&mut Mirror); 5] = [
            |mirror| mirror.shape = Shape::Torus { tube: 0.4 },
            |mirror| mirror.position.z += 0.1,
            |mirror| mirror.rotation *= DQuat::from_rotation_x(0.1),
            |mirror| mirror.size *= 1.1,
            |mirror| mirror.color = [0.9, 0.5, 0.5],
        ];
        let points = |mirror: &Mirror| {
            let chunks = mirror.sample(100, 1);
            let places = |chunk: &Chunk| (0..chunk.len()).map(|at| chunk.position(at)).collect::<Vec<_>>();
            chunks.iter().map(|chunk| (places(chunk), chunk.normals.clone(), chunk.colors.clone())).collect::<Vec<_>>()
        };
        for (number, change) in kept.iter().chain(&other).enumerate() {
            let is_same = number < kept.len();
            let mut changed = mirror.clone();
            change(&mut changed);
            assert_eq!(mirror.has_points_of(&changed), is_same, "change {number}");
            assert_eq!(points(&mirror) == points(&changed), is_same, "change {number}");
        }
    }

    #[test]
    fn odd_values_are_named() {
        let (good, _, _) = standing(Shape::Torus { tube: 0.4 });
        let problem = |change: fn(&mut Mirror)| {
            let mut mirror = good.clone();
            change(&mut mirror);
            mirror.problem().unwrap_or_default()
        };
        assert!(problem(|mirror| mirror.position.y = f64::NAN).contains("position"));
        assert!(problem(|mirror| mirror.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.1)).contains("length 1.1"));
        assert!(problem(|mirror| mirror.rotation.x = f64::NAN).contains("rotation"));
        assert!(problem(|mirror| mirror.size = 0.0).contains("size is 0"));
        assert!(problem(|mirror| mirror.refraction = Some(0.9)).contains("refraction is 0.9, expected 1 to 4"));
        assert!(problem(|mirror| mirror.refraction = Some(f32::NAN)).contains("refraction is NaN"));
        assert!(
            problem(|mirror| {
                mirror.shape = Shape::Mesh(MirrorMesh::hare());
                mirror.refraction = Some(1.5);
            })
            .contains("a mesh has none")
        );
        assert!(problem(|mirror| mirror.size = f64::INFINITY).contains("size is inf"));
        assert!(problem(|mirror| mirror.method = Some(Method::None)).contains("specular_intensity to 0"));
        assert!(problem(|mirror| mirror.method = Some(Method::Auto)).contains("leave it out"));
        assert!(problem(|mirror| mirror.specular_intensity = 1.5).contains("specular_intensity is 1.5"));
        assert!(problem(|mirror| mirror.specular_intensity = f32::NAN).contains("NaN"));
        assert!(problem(|mirror| mirror.specular_power = -1.0).contains("specular_power"));
        assert!(problem(|mirror| mirror.color[1] = -0.1).contains("color is -0.1"));
        assert!(problem(|mirror| mirror.shape = Shape::Torus { tube: 1.0 }).contains("tube is 1"));
        assert!(problem(|mirror| mirror.shape = Shape::Plane { height: 0.0 }).contains("height"));
        assert!(problem(|mirror| mirror.shape = Shape::Cylinder { height: f64::NAN }).contains("height is NaN"));
        assert!(problem(|mirror| mirror.shape = Shape::Mesh(String::new().into())).contains("has no name"));
    }
}
