//! The reference scene "five mirrors": a box with coloured walls and a mirror in the middle, as points. Its numbers are
//! the definition on which an independent ray tracer is run.
//!
//! The box is x, y in [-1, 1] and z in [-2, 2], seen from inside; the mirror is at the origin, its hollow or outer side
//! towards the camera at z = 1.9. All surfaces of a scene together share the points evenly by area. The box also holds
//! a mesh as a mirror and two scenes of several mirrors, after figures of Preiner's thesis (2010). The other built-in
//! scenes are variants, too: a courtyard, and the made scans of `tripod`.

use std::f64::consts::FRAC_PI_2;

use cloud::Chunk;
use cloud::sampling::Surface;
use glam::{DQuat, DVec3};

use crate::mirror::MIRROR_GREY;
use crate::surface_points::{Albedo, append, splat_radius};
use crate::{Camera, Mirror, MirrorMesh, Settings, Shape, SpotLight, Tripod, pool, tripod};

/// The first part of the names of scenes in the box.
pub const BOX: &str = "five-mirrors";

/// The objects in the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    None,
    Sphere,
    Parabolic,
    Blob,
    Torus,
    Coral,
    All,
    Bunny,
    Bowl,
    OpenBox,
    /// The courtyard of `pool`, which is no box.
    Pool,
    /// A made scan, which is no box.
    Tripod(Tripod),
}

impl Variant {
    pub const ALL: [Self; 20] = [
        Self::None,
        Self::Sphere,
        Self::Parabolic,
        Self::Blob,
        Self::Torus,
        Self::Coral,
        Self::All,
        Self::Bunny,
        Self::Bowl,
        Self::OpenBox,
        Self::Pool,
        Self::Tripod(Tripod::Even),
        Self::Tripod(Tripod::Room),
        Self::Tripod(Tripod::Mixed),
        Self::Tripod(Tripod::Four),
        Self::Tripod(Tripod::Hall),
        Self::Tripod(Tripod::Hall30),
        Self::Tripod(Tripod::Hall40),
        Self::Tripod(Tripod::Street),
        Self::Tripod(Tripod::Church),
    ];
    /// The mirrors that `All` shows, from left to right.
    const SINGLE: [Self; 5] = [Self::Sphere, Self::Parabolic, Self::Blob, Self::Torus, Self::Coral];

    /// The first part of the name.
    pub fn family(self) -> &'static str {
        match self {
            Self::Pool => "courtyard",
            Self::Tripod(_) => "tripod",
            _ => BOX,
        }
    }

    /// The second part of the name, as in `five-mirrors/sphere`.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Sphere => "sphere",
            Self::Parabolic => "parabolic",
            Self::Blob => "blob",
            Self::Torus => "torus",
            Self::Coral => "coral",
            Self::All => "all",
            Self::Bunny => "bunny",
            Self::Bowl => "bowl",
            Self::OpenBox => "open-box",
            Self::Pool => "pool",
            Self::Tripod(scan) => scan.name(),
        }
    }

    pub fn help(self) -> &'static str {
        match self {
            Self::None => "the box alone",
            Self::Sphere => "a convex mirror without surprises",
            Self::Parabolic => "a hollow mirror whose focus lies in the box: several reflections of one point",
            Self::Blob => "convex and hollow patches side by side",
            Self::Torus => "a ring that sees itself",
            Self::Coral => "hundreds of small bumps",
            Self::All => "the five side by side",
            Self::Bunny => "a hare as a mesh, in place of the Stanford bunny",
            Self::Bowl => "a sphere that is partly diffuse, and a bowl",
            Self::OpenBox => "a hare, and a sphere on a torus, in a box that is open behind the camera",
            Self::Pool => "a ball, a ring and water in the sun: what opens when nothing is named",
            Self::Tripod(scan) => scan.help(),
        }
    }

    /// The mirrors, from left to right, those of `All` scaled so that they do not touch.
    pub fn mirrors(self) -> Vec<Mirror> {
        let (shape, size) = match self {
            Self::None => return Vec::new(),
            Self::Bunny => return vec![hare(DVec3::ZERO)],
            Self::Bowl => return bowl(),
            Self::OpenBox => return open_box(),
            Self::Pool => return pool::mirrors(),
            Self::Tripod(scan) => return scan.mirrors(),
            Self::All => {
                let place = |(index, variant): (usize, Self)| {
                    let aside = DVec3::X * 0.36 * (index as f64 - 2.0);
                    variant.mirrors().into_iter().map(move |mirror| Mirror {
                        position: mirror.position * ALL_SCALE + aside,
                        size: mirror.size * ALL_SCALE,
                        ..mirror
                    })
                };
                return Self::SINGLE.into_iter().enumerate().flat_map(place).collect();
            }
            Self::Sphere => (Shape::Sphere, 0.43),
            Self::Parabolic => (Shape::Paraboloid { focal_length: 0.25 / 0.45 }, 0.45),
            Self::Blob => (Shape::Blob, 0.40),
            Self::Torus => (Shape::Torus { tube: 0.14 / 0.33 }, 0.33),
            Self::Coral => (Shape::Coral, 0.36),
        };
        vec![Mirror {
            position: if self == Self::Parabolic { DVec3::Z * -0.2 } else { DVec3::ZERO },
            // The torus' axis z turned to (0, sin 55, cos 55 degrees).
            rotation: if self == Self::Torus {
                DQuat::from_rotation_x(-55.0_f64.to_radians())
            } else {
                DQuat::IDENTITY
            },
            ..perfect(self.name(), shape, size)
        }]
    }

    /// The walls of the box, or whatever else is no mirror; none of a made scan, which is of solids.
    pub fn walls(self) -> Vec<(Surface, Albedo)> {
        let mut walls = match self {
            Self::Pool => return pool::walls(),
            Self::Tripod(_) => return Vec::new(),
            _ => walls().to_vec(),
        };
        if self == Self::OpenBox {
            walls.pop();
        }
        walls
    }
}

impl Variant {
    pub fn camera(self) -> Camera {
        match self {
            Self::Pool => pool::camera(),
            Self::Tripod(scan) => scan.camera(),
            _ => camera(),
        }
    }

    /// The place of the scanner, if all points were measured from one.
    pub fn scanner(self) -> Option<DVec3> {
        let Self::Tripod(scan) = self else { return None };
        <[DVec3; 1]>::try_from(scan.stations()).ok().map(|[station]| station)
    }

    /// The scene's only light; none under the sun, and none of a made scan, which brings its colours.
    pub fn light(self) -> Option<SpotLight> {
        (!matches!(self, Self::Pool | Self::Tripod(_))).then(light)
    }

    /// The height of the ground, if the scene has one: beneath it there is nothing to see.
    pub fn ground(self) -> Option<f64> {
        (self == Self::Pool).then_some(pool::FLOOR)
    }

    /// The parameters that belong to the scene.
    pub fn settings(self) -> Settings {
        match self {
            Self::Pool => pool::settings(),
            Self::Tripod(scan) => scan.settings(),
            _ => Settings::default(),
        }
    }
}

/// A perfect mirror in the middle of the box.
fn perfect(name: &str, shape: Shape, size: f64) -> Mirror {
    Mirror {
        name: name.to_owned(),
        shape,
        position: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        size,
        color: [MIRROR_GREY; 3],
        specular_intensity: 1.0,
        specular_power: 0.0,
        refraction: None,
        as_points: true,
        method: None,
    }
}

/// The rotation that turns a shape's z to the box's y, and its -y to the camera.
fn upright() -> DQuat {
    DQuat::from_rotation_x(-FRAC_PI_2)
}

/// The hare, 0.8 high like the definition's bunny, with its middle at `position`.
fn hare(position: DVec3) -> Mirror {
    let mesh = MirrorMesh::hare();
    let [low, high] = mesh.surface.heights();
    let size = 0.8 / (high - low);
    Mirror { position, rotation: upright(), ..perfect("bunny", Shape::Mesh(mesh), size) }
}

/// The first demo scene of Preiner's thesis (2010, figure 3.8), in spirit: a mirroring sphere with a diffuse part on the
/// left, on the floor, and a hollow mirror without one on the right, turned a little towards the sphere.
fn bowl() -> Vec<Mirror> {
    let sphere = Mirror {
        position: DVec3::new(-0.48, -0.6, -0.3),
        color: [0.2, 0.35, 0.6],
        specular_intensity: 0.7,
        ..perfect("sphere", Shape::Sphere, 0.4)
    };
    let bowl = Mirror {
        position: DVec3::new(0.45, -0.15, -0.7),
        rotation: DQuat::from_rotation_y(-0.3),
        ..perfect("bowl", Shape::Paraboloid { focal_length: 0.25 / 0.45 }, 0.45)
    };
    vec![sphere, bowl]
}

/// The second demo scene of the thesis (figure 3.25), in spirit: mirrors of different complexity on the floor, of which
/// the sphere rests in the ring of the torus.
fn open_box() -> Vec<Mirror> {
    const RING: f64 = 0.34;
    const TUBE: f64 = 0.14;
    const BALL: f64 = 0.3;
    let middle = DVec3::new(0.42, TUBE - 1.0, -0.3);
    let torus =
        Mirror { position: middle, rotation: upright(), ..perfect("torus", Shape::Torus { tube: TUBE / RING }, RING) };
    // The ball touches the tube all around.
    let height = ((TUBE + BALL).powi(2) - RING * RING).sqrt();
    let sphere = Mirror { position: middle + DVec3::Y * height, ..perfect("sphere", Shape::Sphere, BALL) };
    vec![hare(DVec3::new(-0.45, -0.6, -0.4)), torus, sphere]
}

/// The size of a mirror among five relative to that of one alone.
const ALL_SCALE: f64 = 0.38;

const LEFT: [f64; 3] = [0.63, 0.065, 0.05];
const RIGHT: [f64; 3] = [0.14, 0.45, 0.091];
const PALE: [f64; 3] = [0.725, 0.71, 0.68];
const DARK: [f64; 3] = [0.2, 0.2, 0.2];
/// The width of the floor's squares.
const CHECK: f64 = 0.25;

/// The walls of the closed box, with their normals towards the inside, and their albedo; the last is behind the camera.
pub fn walls() -> [(Surface, Albedo); 6] {
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 4.0);
    let near = DVec3::new(-1.0, -1.0, -2.0);
    let wall = |corner, edges| Surface::Rectangle { corner, edges };
    let floor = |position: DVec3| {
        let square = (position.x / CHECK).floor() + (position.z / CHECK).floor();
        if square.rem_euclid(2.0) == 0.0 { PALE } else { DARK }
    };
    [
        (wall(near, [y, z]), |_| LEFT),
        (wall(near + x, [z, y]), |_| RIGHT),
        (wall(near, [z, x]), floor),
        (wall(near + y, [x, z]), |_| PALE),
        (wall(near, [x, y]), |_| PALE),
        (wall(near + z, [y, x]), |_| PALE),
    ]
}

/// The area of a point of the mirrors beside a made scan: a square of 1 cm.
const MIRROR_AREA: f64 = 1e-4;

/// The points of one material.
pub struct SampledPart {
    /// Positions, normals, radii and colours; each chunk's points are close together. Those of a made scan are in the
    /// order of its rays, and lack normals and radii.
    pub chunks: Vec<Chunk>,
    /// The mirror that they sample; `None` for the walls.
    pub mirror: Option<Mirror>,
}

/// The scene's points, exactly `points` of them: the walls, then a part for each mirror. The same seed gives the same
/// points. Of a made scan, `points` are its rays, not all of which meet something, and mirrors have points of their own.
///
/// Colours are albedos as 8-bit sRGB, as in all chunks: they differ from the linear values by at most 0.004, and the
/// darkest (0.05) by at most 3 %.
pub fn sample(variant: Variant, points: u64, seed: u64) -> Vec<SampledPart> {
    let (walls, mirrors) = (variant.walls(), variant.mirrors());
    if let Variant::Tripod(scan) = variant {
        let scanned = SampledPart { chunks: tripod::scan(scan, points, seed), mirror: None };
        let mirrored = |mirror: Mirror| {
            let chunks = mirror.sample(mirror.sample_count(MIRROR_AREA), seed);
            SampledPart { chunks, mirror: Some(mirror) }
        };
        return std::iter::once(scanned).chain(mirrors.into_iter().map(mirrored)).collect();
    }
    let areas: Vec<f64> = walls
        .iter()
        .map(|(surface, _)| surface.area())
        .chain(mirrors.iter().map(|mirror| mirror.surface().0.area() * mirror.size * mirror.size))
        .collect();
    let total_area: f64 = areas.iter().sum();
    let radius = splat_radius(total_area, points);
    // Shares rounded by their running sum add up to the whole.
    let mut counts = Vec::with_capacity(areas.len());
    let (mut area, mut before) = (0.0, 0);
    for share in areas {
        area += share;
        let after = (area / total_area * points as f64).round() as u64;
        counts.push((after - before) as usize);
        before = after;
    }
    let mut parts = vec![SampledPart { chunks: Vec::new(), mirror: None }];
    let walls_count = walls.len();
    for (index, (surface, albedo)) in walls.into_iter().enumerate() {
        let points = surface.sample(counts[index], seed.wrapping_add(index as u64));
        append(&mut parts[0].chunks, points, radius, albedo);
    }
    for (index, mirror) in mirrors.into_iter().enumerate() {
        let index = walls_count + index;
        let (surface, at) = mirror.surface();
        let mut points = surface.sample(counts[index], seed.wrapping_add(index as u64));
        points.iter_mut().for_each(|point| *point = at.place(*point));
        let mut chunks = Vec::new();
        append(&mut chunks, points, radius, |_| mirror.color.map(f64::from));
        parts.push(SampledPart { chunks, mirror: Some(mirror) });
    }
    parts
}

/// The scene's only light.
pub fn light() -> SpotLight {
    SpotLight {
        position: DVec3::new(-0.6, 0.9, 1.6),
        target: DVec3::new(1.0, -1.0, -2.0),
        intensity: [10.0; 3],
        inner_degrees: 20.0,
        outer_degrees: 25.0,
    }
}

/// A camera at (0, 0, 1.9) that looks along -z with +y up; the definition's vertical field of view, 60 degrees, is a
/// view setting.
pub fn camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::Z, 1.9, DVec3::Y)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use cloud::sampling::SurfacePoint;
    use cloud::{CHUNK_POINTS, unpack_normal, unpack_radius};

    use super::*;

    const FEW: u64 = 100_000;

    fn points(part: &SampledPart) -> impl Iterator<Item = (DVec3, DVec3)> {
        part.chunks.iter().flat_map(|chunk| {
            let normals = chunk.normals.as_ref().expect("normals");
            (0..chunk.len())
                .map(|index| (chunk.position(index), unpack_normal(normals[index]).expect("a normal").as_dvec3()))
        })
    }

    fn count(part: &SampledPart) -> u64 {
        part.chunks.iter().map(|chunk| chunk.len() as u64).sum()
    }

    /// Zero on the mirror's surface, growing by about one per unit outwards (for the paraboloid: on the hollow side).
    /// These are the definition's own formulas, in coordinates where the mirror is alone at the origin.
    fn distance(mirror: Variant, p: DVec3) -> f64 {
        let d = p.normalize_or_zero();
        match mirror {
            Variant::Sphere => p.length() - 0.43,
            Variant::Parabolic => p.z - ((p.x * p.x + p.y * p.y) / (4.0 * 0.25) - 0.2),
            Variant::Blob => {
                let r = 0.40 * (1.0 + 0.10 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin());
                p.length() - r
            }
            Variant::Torus => {
                let (sin, cos) = 55.0_f64.to_radians().sin_cos();
                let along = p.dot(DVec3::new(0.0, sin, cos));
                let across = (p.length_squared() - along * along).max(0.0).sqrt();
                (across - 0.33).hypot(along) - 0.14
            }
            Variant::Coral => {
                let bumps = 0.08 * (19.0 * d.x).sin() * (17.0 * d.y).sin() * (23.0 * d.z).sin();
                p.length() - 0.36 * (1.0 + bumps + 0.03 * (41.0 * d.x + 3.0 * d.y).sin())
            }
            _ => unreachable!("no single surface"),
        }
    }

    fn assert_on_surface(mirror: Variant, position: DVec3, normal: DVec3) {
        let off = distance(mirror, position);
        assert!(off.abs() < 1e-6, "{mirror:?}: {position} is {off} off");
        // The gradient by differences, of the definition and not of the sampler.
        let step = 1e-6;
        let slope = |axis: DVec3| {
            (distance(mirror, position + axis * step) - distance(mirror, position - axis * step)) / (2.0 * step)
        };
        let gradient = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize();
        let angle = gradient.cross(normal).length().atan2(gradient.dot(normal)).to_degrees();
        assert!(angle < 0.02, "{mirror:?}: the normal at {position} is {angle} degrees off");
    }

    #[test]
    fn points_and_normals_of_each_mirror_are_those_of_its_definition() {
        for mirror in Variant::SINGLE {
            let parts = sample(mirror, FEW, 1);
            assert_eq!(parts.len(), 2);
            let placed = parts[1].mirror.as_ref().expect("a mirror");
            assert_eq!((placed.name.as_str(), placed.specular_intensity), (mirror.name(), 1.0));
            assert!(count(&parts[1]) > 1000);
            for (position, normal) in points(&parts[1]) {
                assert_on_surface(mirror, position, normal);
                if mirror == Variant::Parabolic {
                    assert!(position.x.hypot(position.y) <= 0.45 + 1e-6 && normal.z > 0.0, "{position} {normal}");
                }
            }
        }
    }

    #[test]
    fn five_mirrors_side_by_side_are_the_single_ones_scaled() {
        let parts = sample(Variant::All, FEW, 1);
        assert_eq!(parts.len(), 6);
        for ((part, mirror), x) in parts[1..].iter().zip(Variant::SINGLE).zip([-0.72, -0.36, 0.0, 0.36, 0.72]) {
            assert_eq!(part.mirror.as_ref().expect("a mirror").name, mirror.name());
            for (position, normal) in points(part) {
                assert_on_surface(mirror, (position - DVec3::X * x) / 0.38, normal);
            }
        }
    }

    #[test]
    fn mirrors_of_the_demo_scenes_stand_in_the_box_and_apart() {
        for variant in [Variant::Bunny, Variant::Bowl, Variant::OpenBox] {
            let parts = sample(variant, FEW, 1);
            assert!(parts.len() == 1 + variant.mirrors().len() && parts[1..].iter().all(|part| count(part) > 500));
            for (position, _) in parts[1..].iter().flat_map(points) {
                let is_inside = (position / DVec3::new(1.0, 1.0, 2.0)).abs().max_element() <= 1.0 + 1e-6;
                assert!(is_inside, "{variant:?}: {position}");
            }
        }
        let hare = sample(Variant::Bunny, FEW, 1).remove(1);
        let heights = points(&hare).map(|(position, _)| position.y);
        let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), y| (y.min(low), y.max(high)));
        assert!((high - low - 0.8).abs() < 0.02, "{low} to {high}");
        // The sphere of the open box touches the torus and does not cut it.
        let [_, torus, sphere] = &Variant::OpenBox.mirrors()[..] else { panic!("not three mirrors") };
        let tube = torus.surface().0.sample(10_000, 1);
        let gap =
            |point: &SurfacePoint| torus.surface().1.place(*point).position.distance(sphere.position) - sphere.size;
        let nearest = tube.iter().map(gap).fold(f64::INFINITY, f64::min);
        assert!((-1e-9..0.01).contains(&nearest), "{nearest}");
        assert!(Variant::Bowl.mirrors()[0].specular_intensity < 1.0, "no diffuse part");
    }

    #[test]
    fn walls_close_the_box_and_face_its_inside() {
        let parts = sample(Variant::None, FEW, 1);
        assert!(parts.len() == 1 && parts[0].mirror.is_none());
        let mut seen = [0_u64; 6];
        for (position, normal) in points(&parts[0]) {
            let walls = [
                position.x + 1.0,
                1.0 - position.x,
                position.y + 1.0,
                1.0 - position.y,
                position.z + 2.0,
                2.0 - position.z,
            ];
            assert!(walls.iter().all(|distance| *distance > -1e-6), "{position} is outside");
            let inward = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
            let wall = (0..6).find(|&wall| walls[wall].abs() < 1e-6 && normal == inward[wall]);
            seen[wall.unwrap_or_else(|| panic!("{position} with {normal} is on no wall"))] += 1;
        }
        assert_eq!(seen, [20_000, 20_000, 20_000, 20_000, 10_000, 10_000]);
    }

    #[test]
    fn colours_are_those_of_the_definition() {
        let parts = sample(Variant::None, FEW, 1);
        let linear = |v: u8| {
            let v = f64::from(v) / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        let mut dark = 0;
        for chunk in &parts[0].chunks {
            let colors = chunk.colors.as_ref().expect("colours");
            for index in 0..chunk.len() {
                let p = chunk.position(index);
                let expected = if p.x == -1.0 {
                    [0.63, 0.065, 0.05]
                } else if p.x == 1.0 {
                    [0.14, 0.45, 0.091]
                } else if p.y == -1.0 {
                    // Squares are counted from the corner at (-1, -1, -2), which is pale.
                    let square = ((p.x + 1.0) * 4.0) as i64 + ((p.z + 2.0) * 4.0) as i64;
                    if square % 2 == 0 { [0.725, 0.71, 0.68] } else { [0.2, 0.2, 0.2] }
                } else {
                    [0.725, 0.71, 0.68]
                };
                dark += u64::from(expected[0] == 0.2);
                let [red, green, blue, opacity] = colors[index];
                assert_eq!(opacity, 255);
                for (value, expected) in [red, green, blue].into_iter().zip(expected) {
                    assert!((linear(value) - expected).abs() < 0.004, "{p}: {value} for {expected}");
                }
            }
        }
        assert!((dark as f64 / 10_000.0 - 1.0).abs() < 0.02, "{dark} dark points on a floor of 20000");
    }

    #[test]
    fn points_are_shared_by_area_and_add_up() {
        for mirror in Variant::ALL.into_iter().filter(|variant| !matches!(variant, Variant::Tripod(_))) {
            for points in [0, 1, 10, 12_345, FEW] {
                let parts = sample(mirror, points, 1);
                assert_eq!(parts.iter().map(count).sum::<u64>(), points, "{mirror:?}");
            }
        }
        // The walls' area is 40, the sphere's 4 pi 0.43^2, the torus' 4 pi^2 0.33 0.14.
        for (mirror, area) in [(Variant::Sphere, 4.0 * PI * 0.43 * 0.43), (Variant::Torus, 4.0 * PI * PI * 0.33 * 0.14)]
        {
            let parts = sample(mirror, FEW, 1);
            let expected = area / (40.0 + area) * FEW as f64;
            assert!((count(&parts[1]) as f64 - expected).abs() <= 1.0, "{mirror:?}");
            let radius = 1.5 * ((40.0 + area) / (PI * FEW as f64)).sqrt();
            for chunk in parts.iter().flat_map(|part| &part.chunks) {
                let radii = chunk.radii.as_ref().expect("radii");
                assert!(
                    radii.iter().all(|&r| (f64::from(unpack_radius(r).expect("a radius")) / radius - 1.0).abs() < 6e-3)
                );
            }
        }
    }

    #[test]
    fn chunks_are_small_in_space_and_number_their_points() {
        for part in sample(Variant::All, 1_600_000, 1) {
            let mut first_point = 0;
            for chunk in &part.chunks {
                assert_eq!(chunk.first_point, first_point);
                assert!(chunk.len() <= CHUNK_POINTS);
                first_point += chunk.len() as u64;
                // A wall's half diagonal is 2.2; a run along the curve covers half of the wall at most.
                assert!(chunk.bounds().radius() < 1.7, "{:?}", chunk.bounds());
            }
        }
    }

    #[test]
    fn same_seed_gives_the_same_scene_and_another_seed_another() {
        let positions = |seed| {
            sample(Variant::Blob, FEW, seed)
                .iter()
                .flat_map(|part| points(part).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        };
        assert_eq!(positions(5), positions(5));
        assert_ne!(positions(5), positions(6));
    }

    #[test]
    fn the_camera_stands_and_looks_as_defined() {
        let camera = camera();
        assert!(camera.eye.distance(DVec3::new(0.0, 0.0, 1.9)) < 1e-12);
        assert!(camera.forward().distance(-DVec3::Z) < 1e-12 && camera.up.distance(DVec3::Y) < 1e-12);
    }
}
