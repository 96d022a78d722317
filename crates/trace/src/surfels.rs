//! Points as oriented discs in a bounding volume hierarchy: the surface that the renderer splats.
//!
//! Among equal distances the first point wins. So the hits do not depend on the shape of the tree.
//!
//! Splats of scattered points leave gaps (a hundredth of the reference scene's walls), which the renderer closes. A ray
//! that meets no disc is in a gap, not in the open, if surfaces are all around it.

use cloud::{
    Bounds, Chunk, NO_RADIUS, Progress, provisional_radius, stretch_ratio, unpack_normal, unpack_radius, unpack_stretch,
};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::RayHit;
use rayon::prelude::*;

use crate::tree::{self, BOX_MARGIN, round_up};
use crate::{Clear, Geometry, Hit, Medium, Ray, SELF_DISTANCE};

/// Points of one material.
#[derive(Clone, Copy, Debug)]
pub struct MaterialPoints<'a> {
    pub chunks: &'a [Chunk],
    /// The share of the light that is reflected, 0 to 1; the remainder is diffuse.
    pub specular_intensity: f32,
    /// The exponent of highlights of a mirror; 0 for none.
    pub specular_power: f32,
    /// Set if they are a mirror through which light goes.
    pub clear: Option<Clear>,
    /// The linear albedo of points without a colour.
    pub plain: [f32; 3],
}

/// A point in the form for tracing.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// The position relative to `Surfels::center`.
    position: Vec3,
    radius: f32,
    /// The normal; zero if the disc faces the ray.
    normal: Vec3,
    /// The packed radius, which has the shape (`unpack_stretch`).
    packed_radius: u16,
    /// The running number of the point, counting points that were left out.
    point: u32,
}

/// Discs in which rays are traced: the points of a scene with their normals and radii; a point without a normal is a
/// disc that faces the ray. Points that are not finite are left out.
pub struct Surfels {
    /// The world position of the middle.
    center: DVec3,
    /// The discs in the order of the tree's leaves.
    discs: Vec<Disc>,
    tree: CwBvh,
    surfaces: Vec<Surface>,
    median_radius: f64,
    splat_size: f32,
    has_clear: bool,
}

/// A chunk, and the material of its points.
struct Surface {
    chunk: Chunk,
    /// The running number of its first point.
    first: u32,
    /// The radius of points whose own is not known, before `splat_size`.
    unknown_radius: f32,
    specular_intensity: f64,
    specular_power: f64,
    clear: Option<Clear>,
    plain: DVec3,
}

impl Surfels {
    /// Builds the tree. `splat_size` scales all radii, as `splat.size` does. Points whose radius is not known yet get
    /// that of points spread evenly over their part's bounds. `progress` is checked only between steps. `None` when
    /// cancelled.
    ///
    /// Needs some 49 bytes a point, and 300 while the tree is built. Points beyond the 2^32nd are left out.
    pub fn new(parts: &[MaterialPoints], splat_size: f32, progress: &Progress) -> Option<Self> {
        let bounds =
            parts.iter().flat_map(|part| part.chunks).fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
        let center = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
        let (mut surfaces, mut discs, mut first) = (Vec::new(), Vec::new(), 0_u32);
        for part in parts {
            let points = part.chunks.iter().map(|chunk| chunk.len() as u64).sum();
            let extent = part.chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
            let unknown_radius = provisional_radius(extent, points);
            for chunk in part.chunks {
                let Some(end) = u32::try_from(chunk.len()).ok().and_then(|len| first.checked_add(len)) else {
                    break;
                };
                let disc = |index: usize| {
                    let packed_radius = chunk.radii.as_ref().map_or(NO_RADIUS, |radii| radii[index]);
                    let normal = chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[index]));
                    Disc {
                        position: (chunk.position(index) - center).as_vec3(),
                        radius: unpack_radius(packed_radius).unwrap_or(unknown_radius) * splat_size,
                        normal: normal.unwrap_or(Vec3::ZERO),
                        packed_radius,
                        point: first + index as u32,
                    }
                };
                discs.extend((0..chunk.len()).map(disc).filter(|disc| disc.position.is_finite()));
                surfaces.push(Surface {
                    chunk: chunk.clone(),
                    first,
                    unknown_radius,
                    specular_intensity: f64::from(part.specular_intensity),
                    specular_power: f64::from(part.specular_power),
                    clear: part.clear.filter(|_| part.specular_intensity > 0.0),
                    plain: Vec3::from(part.plain).as_dvec3(),
                });
                first = end;
            }
            if progress.is_cancelled() {
                return None;
            }
        }
        let scene_margin = BOX_MARGIN * bounds.radius() as f32;
        let boxes: Vec<Aabb> = discs.par_iter().map(|disc| disc.bounds(scene_margin)).collect();
        let tree = tree::build(&boxes);
        let discs: Vec<Disc> = tree.primitive_indices.iter().map(|&index| discs[index as usize]).collect();
        let mut radii: Vec<f32> = discs.iter().map(|disc| disc.radius).collect();
        radii.sort_unstable_by(f32::total_cmp);
        let median_radius = radii.get(radii.len() / 2).copied().map_or(0.0, f64::from);
        let has_clear = surfaces.iter().any(|surface| surface.clear.is_some());
        (!progress.is_cancelled()).then_some(Self {
            center,
            discs,
            tree,
            surfaces,
            median_radius,
            splat_size,
            has_clear,
        })
    }

    /// The number of discs.
    pub fn len(&self) -> usize {
        self.discs.len()
    }

    pub fn is_empty(&self) -> bool {
        self.discs.is_empty()
    }

    /// The world centre and the radius of the disc that was hit.
    pub fn disc(&self, hit: &Hit) -> (DVec3, f64) {
        let Surface { chunk, unknown_radius, .. } = &self.surfaces[hit.surface as usize];
        let point = hit.point as usize;
        let radius = chunk.radii.as_ref().and_then(|radii| unpack_radius(radii[point])).unwrap_or(*unknown_radius);
        (chunk.position(point), f64::from(radius * self.splat_size))
    }

    fn first_disc(&self, ray: &Ray) -> Option<(f64, &Disc)> {
        let tree_ray = self.tree_ray(ray, f64::INFINITY)?;
        let origin = self.centered_origin(ray);
        let mut best: Option<(f64, &Disc)> = None;
        self.tree.ray_traverse(tree_ray, &mut RayHit::none(), |_, index| {
            let disc = &self.discs[index];
            let Some(distance) = disc.distance(origin, ray) else {
                return f32::INFINITY;
            };
            if ray.is_beneath && self.has_clear && ray.passes(self.surface_of(disc).medium(ray, disc)) {
                return f32::INFINITY;
            }
            let is_first = best
                .is_none_or(|(nearest, first)| distance < nearest || distance == nearest && disc.point < first.point);
            if is_first {
                best = Some((distance, disc));
            }
            round_up(distance)
        });
        best
    }

    /// For a ray that meets no disc: the surface beside it, if three of four parallel rays at a distance of a median
    /// radius meet one. Beside a straight silhouette at most two do.
    fn around_gap(&self, ray: &Ray) -> Option<(f64, &Disc)> {
        let side = ray.direction.any_orthonormal_vector();
        let sides = [side, ray.direction.cross(side)];
        let beside = sides
            .into_iter()
            .flat_map(|side| [side, -side])
            .filter_map(|side| self.first_disc(&Ray { origin: ray.origin + side * self.median_radius, ..*ray }));
        let mut beside: Vec<(f64, &Disc)> = beside.collect();
        beside.sort_by(|a, b| a.0.total_cmp(&b.0));
        let &[(nearest, _), (_, disc), .., (farthest, _)] = beside.as_slice() else {
            return None;
        };
        // The disc's plane continues into the gap.
        Some((disc.plane_distance(self.centered_origin(ray), ray).max(nearest).min(farthest), disc))
    }

    fn index_of_surface(&self, disc: &Disc) -> usize {
        self.surfaces.partition_point(|surface| surface.first <= disc.point) - 1
    }

    fn surface_of(&self, disc: &Disc) -> &Surface {
        &self.surfaces[self.index_of_surface(disc)]
    }

    fn hit(&self, ray: &Ray, disc: &Disc, distance: f64) -> Hit {
        let surface = self.surface_of(disc);
        let point = disc.point - surface.first;
        let normal = disc.normal.as_dvec3().normalize_or(-ray.direction);
        let albedo = surface.chunk.colors.as_ref().map(|colors| {
            let [red, green, blue, _] = colors[point as usize].map(linear_from_srgb);
            DVec3::new(red, green, blue)
        });
        Hit {
            distance,
            position: ray.at(distance),
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            albedo: albedo.unwrap_or(surface.plain),
            specular_intensity: surface.specular_intensity,
            specular_power: surface.specular_power,
            medium: surface.medium(ray, disc),
            surface: self.index_of_surface(disc) as u32,
            point,
        }
    }

    /// The ray in the tree's form; none if it cannot be traced.
    fn tree_ray(&self, ray: &Ray, most: f64) -> Option<obvhs::ray::Ray> {
        if self.is_empty() {
            return None;
        }
        tree::ray(self.centered_origin(ray), ray.direction, most)
    }

    fn centered_origin(&self, ray: &Ray) -> DVec3 {
        ray.origin - self.center
    }
}

impl Geometry for Surfels {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let (distance, disc) = self.first_disc(ray).or_else(|| self.around_gap(ray))?;
        Some(self.hit(ray, disc, distance))
    }

    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool {
        let Some(tree_ray) = self.tree_ray(ray, distance) else {
            return false;
        };
        let origin = self.centered_origin(ray);
        !self.tree.ray_traverse_miss(tree_ray, |_, index| {
            let disc = &self.discs[index];
            match disc.distance(origin, ray) {
                Some(hit) if hit < distance && !(self.has_clear && self.surface_of(disc).clear.is_some()) => 0.0,
                _ => f32::INFINITY,
            }
        })
    }
}

impl Surface {
    /// What lies behind a disc for a ray.
    fn medium(&self, ray: &Ray, disc: &Disc) -> Option<Medium> {
        self.clear.map(|clear| clear.medium(ray.direction, disc.normal.as_dvec3()))
    }
}

impl Disc {
    fn bounds(&self, scene_margin: f32) -> Aabb {
        // The rounding of large discs is a share of their own radius.
        let margin = scene_margin + self.radius * BOX_MARGIN;
        // A disc with the unit normal n reaches r sqrt(1 - n_x^2) along x; without one it may face any way.
        let reach = self.radius * (Vec3::ONE - self.normal * self.normal).max(Vec3::ZERO).map(f32::sqrt);
        let reach = Vec3A::from(reach * (1.0 + BOX_MARGIN)) + margin;
        let position = Vec3A::from(self.position) + tree::apart(self.point) * margin;
        Aabb::new(position - reach - margin, position + reach + margin)
    }

    /// Where the ray meets the disc; `origin` is the ray's, relative to the same centre as the disc's position.
    fn distance(&self, origin: DVec3, ray: &Ray) -> Option<f64> {
        let radius = f64::from(self.radius);
        let distance = self.plane_distance(origin, ray);
        let offset = self.position.as_dvec3() - origin;
        let narrow = radius / f64::from(stretch_ratio(self.packed_radius));
        let nearest = if ray.leaves_surface { SELF_DISTANCE * narrow } else { 0.0 };
        let across = ray.direction * distance - offset;
        // The comparison is false for the NaN of a ray within the disc's plane.
        let is_hit = distance > nearest && across.length_squared() <= radius * radius && self.is_inside(across);
        is_hit.then_some(distance)
    }

    /// Whether a place of its plane within its radius, relative to its middle, is inside of the ellipse, if it is one.
    fn is_inside(&self, across: DVec3) -> bool {
        let stretch = unpack_stretch(self.packed_radius, self.normal).filter(|_| self.normal != Vec3::ZERO);
        stretch.is_none_or(|stretch| {
            let along = across.dot(stretch.axis.as_dvec3());
            let beside = (across.length_squared() - along * along).max(0.0) * f64::from(stretch.ratio).powi(2);
            along * along + beside <= f64::from(self.radius).powi(2)
        })
    }

    /// Where the ray meets the disc's plane.
    fn plane_distance(&self, origin: DVec3, ray: &Ray) -> f64 {
        let offset = self.position.as_dvec3() - origin;
        if self.normal == Vec3::ZERO {
            return offset.dot(ray.direction);
        }
        let normal = self.normal.as_dvec3();
        offset.dot(normal) / ray.direction.dot(normal)
    }
}

/// 8-bit sRGB to linear (IEC 61966-2-1).
pub fn linear_from_srgb(value: u8) -> f64 {
    let value = f64::from(value) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cloud::sampling::Surface as Shape;
    use cloud::{NO_NORMAL, pack_normal, pack_radius};
    use scene::five_mirrors::{Variant, sample};
    use std::sync::Arc;

    fn chunk(origin: DVec3, points: &[(DVec3, Option<Vec3>)], radius: f32) -> Chunk {
        let positions = points.iter().map(|(position, _)| (*position - origin).as_vec3().to_array()).collect();
        Chunk {
            normals: Some(Arc::new(points.iter().map(|(_, n)| n.map_or(NO_NORMAL, pack_normal)).collect())),
            radii: Some(Arc::new(vec![pack_radius(radius); points.len()])),
            ..Chunk::new(0, origin, positions)
        }
    }

    fn surfels(chunks: &[Chunk]) -> Surfels {
        let part =
            MaterialPoints { chunks, specular_intensity: 0.0, specular_power: 0.0, clear: None, plain: [0.5; 3] };
        Surfels::new(&[part], 1.0, &Progress::default()).unwrap()
    }

    fn unit(seed: u64) -> f64 {
        let mixed = (seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bf0_3635)
            .wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn random_ray(index: u64, center: DVec3, leaves_surface: bool) -> Ray {
        let random = |n: u64| 2.0 * unit(8 * index + n) - 1.0;
        let direction = DVec3::new(random(0), random(1), random(2)).normalize_or(DVec3::X);
        let origin = center + DVec3::new(random(3), random(4), 2.0 * random(5)) * 0.99;
        Ray { origin, direction, leaves_surface, is_beneath: false }
    }

    #[test]
    fn the_tree_finds_what_trying_every_disc_finds() {
        // Once at the origin, once where f32 has a precision of 6 cm.
        for center in [DVec3::ZERO, DVec3::new(631_000.0, 5_077_000.0, 100.0)] {
            let mut points: Vec<(DVec3, Option<Vec3>)> = Vec::new();
            for part in sample(Variant::Blob, 6000, 1) {
                for part in part.chunks {
                    let normals = part.normals.as_ref().unwrap();
                    points.extend(
                        (0..part.len())
                            .map(|i| (center + part.position(i), unpack_normal(normals[i]).filter(|_| i % 9 > 0))),
                    );
                }
            }
            let surfels = surfels(&[chunk(center + DVec3::ONE, &points, 0.05)]);
            let mut hits = 0;
            for index in 0..600 {
                let ray = random_ray(index, center, index % 2 == 0);
                let origin = surfels.centered_origin(&ray);
                let all = surfels.discs.iter().filter_map(|disc| Some((disc.distance(origin, &ray)?, disc.point)));
                let expected = all.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let found = surfels.first_disc(&ray).map(|(distance, disc)| (distance, disc.point));
                assert_eq!(found, expected, "{ray:?}");
                hits += usize::from(found.is_some());
                if let Some((distance, _)) = found {
                    assert!(surfels.is_blocked(&ray, distance * 1.001) && !surfels.is_blocked(&ray, distance * 0.999));
                }
            }
            assert!(hits > 400, "{hits}");
        }
    }

    #[test]
    fn discs_of_a_plane_are_hit_where_the_plane_is() {
        let shape = Shape::Rectangle { corner: DVec3::new(-1.0, -1.0, 0.0), edges: [DVec3::X * 2.0, DVec3::Y * 2.0] };
        // About an axis of the packed normal, which is then exact.
        let points: Vec<_> = shape.sample(20_000, 1).into_iter().map(|p| (p.position, Some(Vec3::Z))).collect();
        let surfels = surfels(&[chunk(DVec3::ZERO, &points, 0.012)]);
        for index in 0..500 {
            let target = DVec3::new(unit(2 * index) * 1.8 - 0.9, unit(2 * index + 1) * 1.8 - 0.9, 0.0);
            let origin = DVec3::new(0.4, -0.3, if index % 2 == 0 { 1.5 } else { -1.5 });
            let ray = Ray::from_eye(origin, (target - origin).normalize());
            let hit = surfels.nearest(&ray).expect("the plane has no gaps that are not closed");
            assert!(hit.position.distance(target) < 1e-7 && hit.normal.dot(ray.direction) < 0.0, "{hit:?}, {target}");
        }
    }

    #[test]
    fn rays_that_leave_a_surface_pass_its_own_discs() {
        let points = [(DVec3::Z * 0.3, Some(Vec3::Z)), (DVec3::Z * 0.5, Some(-Vec3::Z))];
        let surfels = surfels(&[chunk(DVec3::ZERO, &points, 0.1)]);
        let from = |leaves_surface| surfels.nearest(&Ray { leaves_surface, ..Ray::from_eye(DVec3::ZERO, DVec3::Z) });
        assert_eq!(from(false).unwrap().point, 0);
        assert_eq!(from(true).unwrap().point, 1, "0.3 is less than {SELF_DISTANCE} radii of 0.1");
    }

    #[test]
    fn a_gap_among_discs_is_closed_and_a_silhouette_is_not() {
        let grid = |keep: fn(i32, i32) -> bool| {
            let points: Vec<_> = (-10..=10)
                .flat_map(|x| (-10..=10).map(move |y| (x, y)))
                .filter(|&(x, y)| keep(x, y))
                .map(|(x, y)| (DVec3::new(f64::from(x), f64::from(y), 0.0), Some(Vec3::Z)))
                .collect();
            surfels(&[chunk(DVec3::ZERO, &points, 0.75)])
        };
        let down = |x: f64, y: f64| Ray::from_eye(DVec3::new(x, y, 5.0), -DVec3::Z);
        let pierced = grid(|x, y| (x, y) != (0, 0));
        assert!(pierced.first_disc(&down(0.1, 0.05)).is_none(), "there is a gap to close");
        assert!(pierced.nearest(&down(0.1, 0.05)).is_some_and(|hit| (hit.distance - 5.0).abs() < 1e-6));
        let half = grid(|x, _| x <= 0);
        for index in 0..200 {
            let x = 0.76 + unit(index);
            assert!(half.nearest(&down(x, unit(index + 1000))).is_none(), "the surface ends at 0.75, seen at {x}");
        }
    }

    #[test]
    fn colours_come_from_the_point_that_is_hit_as_linear_light() {
        let plain = chunk(DVec3::ZERO, &[(DVec3::ZERO, Some(Vec3::Z))], 0.1);
        let colored = Chunk {
            colors: Some(Arc::new(vec![[0, 0, 0, 255], [255, 188, 10, 255]])),
            ..chunk(DVec3::ZERO, &[(DVec3::X, Some(Vec3::Z)), (DVec3::X * 2.0, Some(Vec3::Z))], 0.1)
        };
        let mirror = MaterialPoints {
            chunks: &[colored],
            specular_intensity: 0.8,
            specular_power: 70.0,
            clear: None,
            plain: [0.0; 3],
        };
        let parts = [
            MaterialPoints {
                chunks: &[plain],
                specular_intensity: 0.0,
                specular_power: 0.0,
                clear: None,
                plain: [0.1, 0.2, 0.3],
            },
            mirror,
        ];
        let surfels = Surfels::new(&parts, 1.0, &Progress::default()).unwrap();
        let down = |x: f64| surfels.nearest(&Ray::from_eye(DVec3::new(x, 0.0, 1.0), -DVec3::Z)).unwrap();
        assert!(down(0.0).albedo.distance(DVec3::new(0.1, 0.2, 0.3)) < 1e-7);
        let hit = down(2.0);
        assert_eq!((hit.surface, hit.point), (1, 1));
        assert_eq!((hit.specular_intensity, hit.specular_power), (f64::from(0.8_f32), 70.0));
        // The sRGB of one half is 187.5; 10 is on the straight part of the curve.
        assert!(
            (hit.albedo - DVec3::new(1.0, 0.503, 10.0 / 255.0 / 12.92)).abs().max_element() < 1e-3,
            "{}",
            hit.albedo
        );
    }

    #[test]
    fn clouds_without_sense_are_traced_without_harm() {
        let ray = Ray::from_eye(DVec3::Z * 3.0, -DVec3::Z);
        assert_eq!(surfels(&[]).nearest(&ray), None);
        let lost = [(DVec3::NAN, Some(Vec3::Z)), (DVec3::INFINITY, None)];
        assert!(surfels(&[chunk(DVec3::ZERO, &lost, 0.1)]).is_empty());
        // More points in one place than the tree could separate, and ever closer ones.
        let mut points = vec![(DVec3::ZERO, Some(Vec3::Z)); 100_000];
        points.push((DVec3::X * 1000.0, Some(Vec3::Z)));
        let heap = surfels(&[chunk(DVec3::ZERO, &points, 0.1)]);
        assert_eq!(heap.nearest(&ray).map(|hit| hit.point), Some(0));
        let closer: Vec<_> = (0..120).map(|i| (DVec3::X * 0.5_f64.powi(i), None)).collect();
        assert!(surfels(&[chunk(DVec3::ZERO, &closer, 1e-5)]).nearest(&ray).is_some());
        assert_eq!(heap.nearest(&Ray::from_eye(DVec3::NAN, DVec3::Z)), None);
        assert_eq!(heap.nearest(&Ray::from_eye(DVec3::ZERO, DVec3::NAN)), None);
    }

    #[test]
    fn points_without_a_radius_close_the_surface_they_are_spread_over() {
        let shape = Shape::Rectangle { corner: DVec3::ZERO, edges: [DVec3::X, DVec3::Y] };
        let positions = shape.sample(5000, 1).into_iter().map(|p| p.position.as_vec3().to_array()).collect();
        let surfels = surfels(&[Chunk::new(0, DVec3::ZERO, positions)]);
        let is_hit = |index: &u64| {
            let origin = DVec3::new(0.1 + 0.8 * unit(2 * index), 0.1 + 0.8 * unit(2 * index + 1), 1.0);
            surfels.nearest(&Ray::from_eye(origin, -DVec3::Z)).is_some_and(|hit| (hit.distance - 1.0).abs() < 1e-6)
        };
        assert_eq!((0..1000).filter(is_hit).count(), 1000);
    }
}
