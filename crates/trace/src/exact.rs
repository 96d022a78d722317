//! Analytic surfaces and triangles, hit in f64: the surfaces that a cloud of points samples.
//!
//! Rectangle, sphere, paraboloid and cylinder have closed forms. Torus and star-shaped surfaces are zeros of a function
//! f along the ray: marching brackets the first change of sign with steps of |f| over a bound of its slope (sphere
//! tracing; Hart 1996), which cannot skip one, and bisection refines it to the last digit.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use cloud::sampling::{Placement, StarShape, Surface};
use glam::{DVec2, DVec3};
use scene::Mirror;
use scene::five_mirrors::Variant;
use scene::solid::{self, Solid};

use crate::{Clear, Geometry, Hit, Medium, Mesh, Ray};

/// A surface in the world and its material.
#[derive(Clone, Debug)]
pub struct Object {
    surface: Surface,
    placement: Placement,
    /// The linear albedo at a world position.
    albedo: Albedo,
    specular_intensity: f64,
    specular_power: f64,
    /// Set if light goes through the surface.
    clear: Option<Clear>,
    /// The bounds of a star-shaped surface; unused for others.
    reach: Reach,
}

/// The linear albedo of a surface's diffuse part.
#[derive(Clone, Copy, Debug)]
pub enum Albedo {
    Even([f64; 3]),
    /// A function of the world position.
    At(fn(DVec3) -> [f64; 3]),
}

/// The bounds of a star-shaped surface r(d).
#[derive(Clone, Copy, Debug)]
struct Reach {
    largest_radius: f64,
    /// A bound of the slope of |p| - r(p / |p|) outside the surface.
    slope: f64,
}

impl Object {
    /// `specular_intensity` is the share of the light that is reflected, 0 to 1. The surface shows no highlights of
    /// lights. A ray meets no mesh: [`Mesh`] is the object for that.
    pub fn new(surface: Surface, placement: Placement, albedo: Albedo, specular_intensity: f64) -> Self {
        let reach = match &surface {
            Surface::Star(shape) => Reach::of(shape),
            _ => Reach { largest_radius: 0.0, slope: 1.0 },
        };
        Self { surface, placement, albedo, specular_intensity, specular_power: 0.0, clear: None, reach }
    }

    /// The object of a mirror that has a formula.
    fn of_mirror(mirror: &Mirror) -> Self {
        let (surface, placement) = mirror.surface();
        let albedo = Albedo::Even(mirror.color.map(f64::from));
        let object = Self::new(surface, placement, albedo, f64::from(mirror.specular_intensity))
            .with_specular_power(f64::from(mirror.specular_power));
        match mirror.refraction {
            Some(index) => object.with_refraction(f64::from(index)),
            None => object,
        }
    }

    /// The object with highlights of this exponent, if it is a mirror.
    pub fn with_specular_power(self, specular_power: f64) -> Self {
        Self { specular_power, ..self }
    }

    /// The object through whose surface light goes, if it is a mirror, into a medium of this index of refraction: into a
    /// solid if the surface is closed.
    pub fn with_refraction(self, index: f64) -> Self {
        let is_solid = matches!(self.surface, Surface::Sphere { .. } | Surface::Torus { .. } | Surface::Star(_));
        Self { clear: (self.specular_intensity > 0.0).then_some(Clear { index, is_solid }), ..self }
    }

    /// What lies behind the surface for a ray in this direction; `normal` is the surface's own.
    fn medium(&self, direction: DVec3, normal: DVec3) -> Option<Medium> {
        self.clear.map(|clear| clear.medium(direction, normal))
    }

    /// The first hit and the surface's own normal there.
    fn nearest(&self, ray: &Ray) -> Option<(f64, DVec3)> {
        let Placement { rotation, scale, translation } = self.placement;
        let into_own = rotation.transpose();
        let origin = into_own * (ray.origin - translation) / scale;
        let direction = into_own * ray.direction;
        let from = if ray.leaves_surface { CLEARANCE } else { 0.0 };
        let (distance, normal) = match self.surface {
            Surface::Rectangle { corner, edges } => rectangle(corner, edges, origin, direction, from),
            Surface::Sphere { radius } => sphere(radius, origin, direction, from),
            Surface::Paraboloid { focal_length, rim_radius } => {
                paraboloid(focal_length, rim_radius, origin, direction, from)
            }
            Surface::Cylinder { radius, half_height } => cylinder(radius, half_height, origin, direction, from),
            Surface::Torus { ring, tube } => torus(ring, tube, origin, direction, from),
            Surface::Star(shape) => star(&shape, &self.reach, origin, direction, from),
            Surface::Mesh(_) => None,
        }?;
        Some((distance * scale, rotation * normal))
    }
}

/// Objects and meshes in which rays are traced.
#[derive(Clone, Debug)]
pub struct Exact {
    objects: Vec<Object>,
    meshes: Vec<Arc<Mesh>>,
    /// What a made scan is of, in world coordinates. None of it mirrors.
    solids: Vec<Solid>,
    /// The origin of rays and hits in world coordinates. Objects have been moved there.
    origin: DVec3,
}

impl Exact {
    pub fn new(objects: Vec<Object>) -> Self {
        Self { objects, meshes: Vec::new(), solids: Vec::new(), origin: DVec3::ZERO }
    }

    /// The surfaces of mirrors: those with a formula first, then the meshes.
    pub fn of_mirrors(mirrors: &[Mirror]) -> Self {
        let with_formula = mirrors.iter().filter(|mirror| mirror.shape.has_formula());
        Self::new(with_formula.map(Object::of_mirror).collect())
            .with_meshes(mirrors.iter().filter_map(Mesh::of_mirror).collect())
    }

    /// Adds the triangles of meshes.
    pub fn with_meshes(mut self, meshes: Vec<Mesh>) -> Self {
        self.meshes.extend(meshes.into_iter().map(Arc::new));
        self
    }

    /// Adds solids in world coordinates. None of them mirrors.
    pub fn with_solids(mut self, solids: Vec<Solid>) -> Self {
        self.solids.extend(solids);
        self
    }

    /// Takes rays in coordinates relative to `origin` from now on; before, they were in world coordinates.
    pub fn seen_from(mut self, origin: DVec3) -> Self {
        for object in &mut self.objects {
            object.placement.translation -= origin - self.origin;
        }
        Self { origin, ..self }
    }

    /// The reference scene: walls first, then the mirrors with a formula from left to right, then the meshes, then
    /// solids.
    pub fn five_mirrors(variant: Variant) -> Self {
        let wall = |(surface, albedo)| Object::new(surface, Placement::ORIGIN, Albedo::At(albedo), 0.0);
        let mut scene = Self::of_mirrors(&variant.mirrors());
        scene.objects.splice(..0, variant.walls().into_iter().map(wall));
        if let Variant::Tripod(scan) = variant {
            scene.solids = scan.solids();
        }
        scene
    }

    fn nearest_object(&self, ray: &Ray) -> Option<Hit> {
        let hits = self.objects.iter().enumerate().filter_map(|(index, object)| {
            object
                .nearest(ray)
                .filter(|(_, normal)| !ray.passes(object.medium(ray.direction, *normal)))
                .map(|(distance, normal)| (distance, normal, index, object))
        });
        let (distance, normal, index, object) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let position = ray.at(distance);
        let albedo = match object.albedo {
            Albedo::Even(albedo) => albedo,
            Albedo::At(albedo) => albedo(position + self.origin),
        };
        Some(Hit {
            distance,
            position,
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            albedo: DVec3::from(albedo),
            specular_intensity: object.specular_intensity,
            specular_power: object.specular_power,
            medium: object.medium(ray.direction, normal),
            surface: index as u32,
            point: 0,
        })
    }

    fn nearest_triangle(&self, ray: &Ray) -> Option<Hit> {
        let hits =
            self.meshes.iter().enumerate().filter_map(|(index, mesh)| Some((index, mesh.nearest(ray, self.origin)?)));
        let (index, hit) = hits.min_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance))?;
        let [specular_intensity, specular_power] = self.meshes[index].specular();
        Some(Hit {
            distance: hit.distance,
            position: ray.at(hit.distance),
            normal: hit.normal,
            albedo: hit.albedo,
            specular_intensity,
            specular_power,
            medium: None,
            surface: (self.objects.len() + index) as u32,
            point: hit.triangle,
        })
    }
}

impl Exact {
    fn nearest_solid(&self, ray: &Ray) -> Option<Hit> {
        let hit = solid::nearest(&self.solids, ray.origin + self.origin, ray.direction)?;
        let position = ray.at(hit.distance);
        Some(Hit {
            distance: hit.distance,
            position,
            normal: hit.normal,
            albedo: self.solids[hit.solid].albedo_at(position + self.origin).into(),
            specular_intensity: 0.0,
            specular_power: 0.0,
            medium: None,
            surface: (self.objects.len() + self.meshes.len() + hit.solid) as u32,
            point: 0,
        })
    }
}

impl Geometry for Exact {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let hits = [self.nearest_object(ray), self.nearest_triangle(ray), self.nearest_solid(ray)];
        hits.into_iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool {
        let is_in_front = |object: &Object| object.nearest(ray).is_some_and(|(hit, _)| hit < distance);
        self.objects.iter().filter(|object| object.clear.is_none()).any(is_in_front)
            || self.meshes.iter().any(|mesh| mesh.is_blocked(ray, self.origin, distance))
            || self.nearest_solid(ray).is_some_and(|hit| hit.distance < distance)
    }
}

// From here on in a surface's own coordinates, where its size is about 1.

/// The least distance of a hit from the surface that a ray leaves: far above the rounding of its origin.
const CLEARANCE: f64 = 1e-9;

/// A hit may exceed an edge by as much as rounding may carry it, so that a box has no cracks.
const EDGE: f64 = 1e-12;

fn rectangle(corner: DVec3, [u, v]: [DVec3; 2], origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let normal = u.cross(v).normalize_or_zero();
    let distance = (corner - origin).dot(normal) / direction.dot(normal);
    let offset = origin + direction * distance - corner;
    let is_in = |edge: DVec3| (-EDGE..=1.0 + EDGE).contains(&(offset.dot(edge) / edge.length_squared()));
    (distance > from && is_in(u) && is_in(v)).then_some((distance, normal))
}

/// The two solutions of a t^2 + 2 b t + c = 0, the smaller first, without cancellation; one solution and infinity if
/// `a` is 0.
fn quadratic(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = b * b - a * c;
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    let [one, other] = [c / q, q / a];
    Some(if one <= other || other.is_nan() { [one, other] } else { [other, one] })
}

fn sphere(radius: f64, origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let c = (origin.length() - radius) * (origin.length() + radius);
    let distance = quadratic(1.0, origin.dot(direction), c)?.into_iter().find(|distance| *distance > from)?;
    Some((distance, (origin + direction * distance) / radius))
}

fn paraboloid(focal_length: f64, rim_radius: f64, origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let (o, d) = (origin.truncate(), direction.truncate());
    let b = o.dot(d) - 2.0 * focal_length * direction.z;
    let c = o.length_squared() - 4.0 * focal_length * origin.z;
    let is_in = |distance: f64| distance.is_finite() && (o + d * distance).length() <= rim_radius;
    let distance = quadratic(d.length_squared(), b, c)?.into_iter().find(|&t| t > from && is_in(t))?;
    let DVec2 { x, y } = o + d * distance;
    Some((distance, DVec3::new(-x, -y, 2.0 * focal_length).normalize()))
}

fn cylinder(radius: f64, half_height: f64, origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let (o, d) = (origin.truncate(), direction.truncate());
    let c = (o.length() - radius) * (o.length() + radius);
    // A ray along the axis has no finite root.
    let is_in = |t: f64| t.is_finite() && (origin.z + direction.z * t).abs() <= half_height;
    let distance = quadratic(d.length_squared(), o.dot(d), c)?.into_iter().find(|&t| t > from && is_in(t))?;
    Some((distance, ((o + d * distance) / radius).extend(0.0)))
}

fn torus(ring: f64, tube: f64, origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let range = ball(ring + tube, origin, direction, from)?;
    // The distance from the tube's middle changes by no more than the step along the ray.
    let distance = first_zero(range, 1.0, |distance| {
        let p = origin + direction * distance;
        (p.x.hypot(p.y) - ring).hypot(p.z) - tube
    })?;
    let p = origin + direction * distance;
    let middle = p.truncate().normalize_or_zero() * ring;
    Some((distance, (p - middle.extend(0.0)).normalize()))
}

fn star(shape: &StarShape, reach: &Reach, origin: DVec3, direction: DVec3, from: f64) -> Option<(f64, DVec3)> {
    let range = ball(reach.largest_radius, origin, direction, from)?;
    let distance = first_zero(range, reach.slope, |distance| {
        let p = origin + direction * distance;
        p.length() - (shape.radius)(p.normalize_or(DVec3::X))
    })?;
    let position = origin + direction * distance;
    Some((distance, shape.point(position.normalize_or(DVec3::X)).normal))
}

/// The part of a ray inside a ball about the origin.
fn ball(radius: f64, origin: DVec3, direction: DVec3, from: f64) -> Option<[f64; 2]> {
    let c = origin.length_squared() - radius * radius;
    let [near, far] = quadratic(1.0, origin.dot(direction), c)?;
    (far > from).then_some([near.max(from), far])
}

/// The least step of the march. It may skip a chord of this length: with bumps of a fiftieth of the surface's size,
/// that lies less than 1e-9 deep.
const LEAST_STEP: f64 = 1e-5;

/// The first change of sign of `f`, whose slope is at most `slope`, to the last digit.
fn first_zero([from, to]: [f64; 2], slope: f64, f: impl Fn(f64) -> f64) -> Option<f64> {
    let (mut before, mut value) = (from, f(from));
    let is_outside = value > 0.0;
    while before < to {
        let after = before + (value.abs() / slope).max(LEAST_STEP);
        value = f(after);
        if (value > 0.0) != is_outside {
            let (mut low, mut high) = (before, after);
            loop {
                let middle = (low + high) / 2.0;
                if middle <= low || middle >= high {
                    return Some(high);
                }
                if (f(middle) > 0.0) == is_outside { low = middle } else { high = middle }
            }
        }
        before = after;
    }
    None
}

/// The number of directions from pole to pole in which a star-shaped surface is sampled, half of those around: 0.35
/// degrees apart, a tenth of the narrowest bump of the built-in shapes.
const REACH_STEPS: usize = 512;

/// The factor by which the bounds are widened: between two directions, the slopes of the built-in shapes grow by less.
const REACH_MARGIN: f64 = 1.05;

impl Reach {
    fn of(shape: &StarShape) -> Self {
        let (mut smallest, mut largest, mut steepest) = (f64::INFINITY, 0.0_f64, 0.0_f64);
        for row in 0..=REACH_STEPS {
            let (ring, z) = (PI * row as f64 / REACH_STEPS as f64).sin_cos();
            for column in 0..2 * REACH_STEPS {
                let (sin, cos) = (TAU * column as f64 / (2 * REACH_STEPS) as f64).sin_cos();
                let direction = DVec3::new(ring * cos, ring * sin, z);
                let radius = (shape.radius)(direction);
                let gradient = (shape.gradient)(direction);
                smallest = smallest.min(radius);
                largest = largest.max(radius);
                steepest = steepest.max((gradient - direction * gradient.dot(direction)).length());
            }
        }
        // grad f|^2 = 1 + |slope of r|^2 / |p|^2, largest where |p| is least.
        let slope = (1.0 + (steepest * REACH_MARGIN / smallest).powi(2)).sqrt();
        Self { largest_radius: largest * REACH_MARGIN, slope }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MirrorPoint, PixelRays, primary, reflected};
    use cloud::Progress;
    use scene::ViewSettings;
    use scene::five_mirrors::camera;

    fn pixels(size: [u32; 2]) -> PixelRays {
        PixelRays::new(&camera(), &ViewSettings::default(), size, 0.0)
    }

    /// Where a ray from a point inside leaves the box of the scene.
    fn leaves_box(origin: DVec3, direction: DVec3) -> DVec3 {
        let wall = DVec3::new(1.0, 1.0, 2.0);
        let distances = (wall * DVec3::ONE.copysign(direction) - origin) / direction;
        origin + direction * distances.min_element()
    }

    #[test]
    fn a_mesh_as_a_mirror_is_hit_where_its_points_are_and_reflects() {
        let scene = Exact::five_mirrors(Variant::Bunny);
        let (mut points, mut apart) = (0, 0);
        for part in scene::five_mirrors::sample(Variant::Bunny, 200_000, 3).iter().skip(1) {
            for chunk in &part.chunks {
                let normals = chunk.normals.as_ref().unwrap();
                for index in 0..chunk.len() {
                    let (at, normal) =
                        (chunk.position(index), cloud::unpack_normal(normals[index]).unwrap().as_dvec3());
                    let ray = Ray::from_eye(at + normal * 1e-4, -normal);
                    let hit = scene.nearest(&ray).expect("the hare or a wall behind it");
                    points += 1;
                    // Interpolated normals are not those of the triangles, so a few rays pass beside the fur.
                    let is_there = hit.position.distance(at) < 1e-4 && hit.normal.dot(normal) > 0.999;
                    apart += usize::from(!(is_there && hit.specular_intensity == 1.0));
                }
            }
        }
        assert!(points > 2000 && apart * 100 < points, "{apart} of {points}");
    }

    #[test]
    fn the_open_box_has_no_wall_behind_the_camera() {
        let behind = Ray::from_eye(DVec3::new(0.0, 0.0, 1.9), DVec3::Z);
        assert!(Exact::five_mirrors(Variant::OpenBox).nearest(&behind).is_none());
        assert!(Exact::five_mirrors(Variant::Bowl).nearest(&behind).is_some());
    }

    #[test]
    fn sphere_in_a_box_reflects_as_its_closed_form() {
        let rays = pixels([160, 120]);
        let scene = Exact::five_mirrors(Variant::Sphere);
        let seen = primary(&scene, &rays, &Progress::default()).unwrap();
        let (mut mirrors, mut worst) = (0, 0.0_f64);
        for (pixel, hit) in seen.iter().enumerate() {
            let (ray, hit) = (rays.ray(pixel), hit.expect("the box is closed"));
            // Computed from the foot of the perpendicular from the centre.
            let along = -ray.origin.dot(ray.direction);
            let off = (ray.origin + ray.direction * along).length();
            assert_eq!(hit.specular_intensity > 0.0, off < 0.43, "pixel {pixel} passes the centre at {off}");
            if off >= 0.43 {
                worst = worst.max(hit.position.distance(leaves_box(ray.origin, ray.direction)));
                continue;
            }
            mirrors += 1;
            let position = ray.origin + ray.direction * (along - (0.43_f64.powi(2) - off * off).sqrt());
            let normal = position / 0.43;
            let direction = ray.direction - 2.0 * normal * normal.dot(ray.direction);
            let point = MirrorPoint { position: hit.position, normal: hit.normal, incoming: ray.direction };
            let reflection = reflected(&scene, &[point], 1, &Progress::default()).unwrap()[0];
            let end = reflection.first.expect("the box is closed").position;
            worst = worst.max(end.distance(leaves_box(position, direction)));
        }
        assert!(mirrors > 1000 && worst < 1e-9, "{worst} among {mirrors} mirror pixels");
    }

    /// Zero on a mirror's surface, positive on the side of the camera; the scene's own definition.
    fn field(mirror: Variant, p: DVec3) -> f64 {
        let d = p.normalize_or(DVec3::X);
        match mirror {
            Variant::Sphere => p.length() - 0.43,
            Variant::Parabolic => p.z - (p.x * p.x + p.y * p.y - 0.2),
            Variant::Blob => {
                let r = 0.40 * (1.0 + 0.10 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin());
                p.length() - r
            }
            Variant::Torus => {
                let (sin, cos) = 55.0_f64.to_radians().sin_cos();
                let along = p.dot(DVec3::new(0.0, sin, cos));
                (p.reject_from_normalized(DVec3::new(0.0, sin, cos)).length() - 0.33).hypot(along) - 0.14
            }
            Variant::Coral => {
                let bumps = 0.08 * (19.0 * d.x).sin() * (17.0 * d.y).sin() * (23.0 * d.z).sin();
                p.length() - 0.36 * (1.0 + bumps + 0.03 * (41.0 * d.x + 3.0 * d.y).sin())
            }
            _ => unreachable!("no single surface"),
        }
    }

    /// Whether a place belongs to a mirror's field: the paraboloid has a rim.
    fn is_within(mirror: Variant, p: DVec3) -> bool {
        mirror != Variant::Parabolic || p.x.hypot(p.y) <= 0.45
    }

    /// Walks along the ray in small steps and asserts that the field changes its sign nowhere before `end`, except at
    /// bumps that the steps of the tracer may miss as well.
    fn assert_nothing_before(mirror: Variant, ray: &Ray, from: f64, end: f64) {
        let start = field(mirror, ray.at(from));
        for step in 1..3000 {
            let p = ray.at(from + (end - from) * f64::from(step) / 3000.0);
            let value = field(mirror, p);
            let crossed = value * start < 0.0 && value.abs() > 1e-8 && is_within(mirror, p);
            // The paraboloid's field changes sign outside its rim, where there is no mirror.
            assert!(!crossed || mirror == Variant::Parabolic, "{mirror:?}: missed before {end} at {p}");
        }
    }

    #[test]
    fn mirrors_are_hit_on_their_surface_and_first() {
        for mirror in [Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral] {
            let scene = Exact::five_mirrors(mirror);
            let rays = pixels([64, 48]);
            let seen = primary(&scene, &rays, &Progress::default()).unwrap();
            let (mut hits, mut own) = (0, 0);
            for (pixel, hit) in seen.into_iter().enumerate() {
                let (ray, hit) = (rays.ray(pixel), hit.expect("the box is closed"));
                assert_nothing_before(mirror, &ray, 0.0, hit.distance - 1e-6);
                if hit.specular_intensity == 0.0 {
                    continue;
                }
                hits += 1;
                let off = field(mirror, hit.position).abs();
                assert!(off < 1e-12 && is_within(mirror, hit.position), "{mirror:?}: {off} off at {}", hit.position);
                assert!(hit.normal.dot(ray.direction) <= 0.0);
                let gradient = DVec3::from_array(DVec3::AXES.map(|axis| {
                    (field(mirror, hit.position + axis * 1e-6) - field(mirror, hit.position - axis * 1e-6)) / 2e-6
                }));
                let sine = gradient.normalize().cross(hit.normal).length();
                assert!(sine < 1e-6, "{mirror:?}: the normal is {sine} off");
                // The reflected ray leaves the mirror, and its first hit is checked, too.
                let point = MirrorPoint { position: hit.position, normal: hit.normal, incoming: ray.direction };
                let next = point.reflected().unwrap();
                let end = scene.nearest(&next).expect("the box is closed");
                assert!(end.distance > 1e-4, "{mirror:?}: hits itself at once, {}", end.distance);
                assert_nothing_before(mirror, &next, 1e-4, end.distance - 1e-6);
                own += usize::from(end.specular_intensity > 0.0);
            }
            assert!(hits > 150, "{mirror:?}: {hits}");
            let sees_itself = !matches!(mirror, Variant::Sphere | Variant::Parabolic);
            assert!(!sees_itself || own > 0, "{mirror:?} never sees itself");
        }
    }

    /// Rays at chosen points of a column, from outside, through an open end onto its inner side, and beside it.
    #[test]
    fn a_column_is_met_on_its_mantle_from_outside_and_through_its_open_ends() {
        let rotation = glam::DQuat::from_rotation_x(0.7) * glam::DQuat::from_rotation_y(-0.3);
        let position = DVec3::new(635_000.0, 12.0, -3.0);
        let standing = Mirror::standing(scene::Shape::Cylinder { height: 2.0 }, position, DVec3::Z, DVec3::Y, 0.5);
        let column = Exact::of_mirrors(&[Mirror { position, rotation, ..standing }]);
        let hit = |from: DVec3, to: DVec3| {
            let [from, to] = [from, to].map(|place| rotation * place * 0.5 + position);
            let hit = column.nearest(&Ray::from_eye(from, (to - from).normalize()))?;
            Some((
                rotation.inverse() * (hit.position - position) / 0.5,
                rotation.inverse() * hit.normal,
                to - hit.position,
            ))
        };
        for step in 0..40 {
            let (sin, cos) = (f64::from(step) * 0.31).sin_cos();
            let at = DVec3::new(cos, sin, f64::from(step) * 0.1 - 1.95);
            let outward = at.with_z(0.0);
            let (_, normal, off) = hit(at + outward * 3.0 + DVec3::Z * 0.7, at).expect("the mantle");
            assert!(off.length() < 1e-8 && normal.distance(outward) < 1e-8, "{at}: {normal} {off}");
            // From above the upper end, the far side is seen from within if the way to it passes the opening.
            let above = DVec3::new(-0.9 * cos, -0.9 * sin, 2.5);
            let (met, normal, off) = hit(above, at).expect("the inner side");
            assert!(off.length() < 1e-8 && normal.distance(-outward) < 1e-8, "{at}: {met} {normal}");
            assert!(hit(at * 1.01, at * 1.01 + DVec3::Z).is_none() && hit(DVec3::Z * 5.0, DVec3::ZERO).is_none());
            assert!(hit(outward * 3.0 + DVec3::Z * 2.01, DVec3::Z * 2.01).is_none(), "past the end");
        }
    }

    #[test]
    fn mirrors_are_as_large_as_their_points_say() {
        // Every sampled point is seen by a ray that comes in along its normal, at the point itself.
        for part in scene::five_mirrors::sample(Variant::All, 20_000, 3).iter().skip(1) {
            let scene = Exact::five_mirrors(Variant::All);
            for chunk in &part.chunks {
                let normals = chunk.normals.as_ref().unwrap();
                for index in (0..chunk.len()).step_by(7) {
                    let normal = cloud::unpack_normal(normals[index]).unwrap().as_dvec3().normalize();
                    let ray = Ray::from_eye(chunk.position(index) + normal * 1e-3, -normal);
                    let hit = scene.nearest(&ray).expect("a mirror");
                    assert!((hit.distance - 1e-3).abs() < 1e-5 && hit.specular_intensity == 1.0, "{hit:?}");
                }
            }
        }
    }

    #[test]
    fn rays_into_edges_and_corners_of_the_box_do_not_escape() {
        let scene = Exact::five_mirrors(Variant::None);
        for corner in 0..8_u8 {
            let side = |bit: u8| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            let corner = DVec3::new(side(0), side(1), 2.0 * side(2));
            for target in [corner, corner * DVec3::new(1.0, 1.0, 0.3), corner * DVec3::new(0.1, 1.0, 1.0)] {
                let origin = DVec3::new(0.3, -0.2, 0.7);
                let hit = scene.nearest(&Ray::from_eye(origin, (target - origin).normalize()));
                assert!(hit.is_some_and(|hit| hit.position.distance(target) < 1e-12), "{target}: {hit:?}");
            }
        }
    }
}
