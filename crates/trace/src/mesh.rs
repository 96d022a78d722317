//! Triangles as a surface: the surface that the vertices of a mesh sample.
//!
//! A tree proposes triangles in f32, and each is then tested in f64 by signs that are equal for both triangles of an
//! edge (Woop, Benthin and Wald 2013), so that no ray passes between two triangles that share it. Among equal distances
//! the first triangle of the mesh wins. So the hits do not depend on the shape of the tree.

use cloud::Bounds;
use cloud::sampling::{Surface, SurfacePoint};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::RayHit;
use rayon::prelude::*;
use scene::Mirror;

use crate::Ray;
use crate::tree::{self, BOX_MARGIN, round_up};

/// A corner of triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// The world position.
    pub position: DVec3,
    /// The linear albedo; interpolated between the corners of a triangle.
    pub albedo: Vec3,
    /// The normal of the surface that the triangles approximate, if somebody measured or modelled it; else zero, and
    /// light falls on the flat triangle. A normal averaged from triangles is a guess about that surface: it belongs to
    /// the pictures that are judged, not to the truth.
    pub normal: Vec3,
}

/// A corner in the form for tracing.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// The position relative to `Mesh::center`.
    position: DVec3,
    albedo: Vec3,
    normal: Vec3,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    corners: [u32; 3],
    /// The index of the triangle in the mesh, counting triangles that were left out.
    number: u32,
}

/// Triangles in which rays are traced. Both of their sides are visible.
pub struct Mesh {
    /// The world position of the middle.
    center: DVec3,
    /// The radius of a ball about the middle that contains all triangles.
    radius: f64,
    corners: Vec<Corner>,
    /// The triangles in the order of the tree's leaves.
    triangles: Vec<Triangle>,
    tree: CwBvh,
    left_out: usize,
    /// The share of the light that is reflected, and the exponent of highlights of lights, of all triangles.
    specular: [f64; 2],
}

/// Where a ray ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TriangleHit {
    pub distance: f64,
    /// The unit normal on the side from which the ray comes.
    pub normal: DVec3,
    pub albedo: DVec3,
    pub triangle: u32,
}

/// The least distance of a hit from the surface that a ray leaves, as a share of the mesh's radius: far above the
/// rounding of its origin.
const CLEARANCE: f64 = 1e-9;

/// From more than this many radii away, a ray is followed from where it comes near, so that all numbers in the
/// computation are as small as the mesh.
const NEAR: f64 = 2.0;

impl Mesh {
    /// Builds the tree. Triangles that name a vertex that does not exist or is not finite, and those without an area,
    /// are left out.
    ///
    /// Needs some 50 bytes a vertex and 35 a triangle, and 150 a triangle while the tree is built.
    pub fn new(vertices: &[Vertex], triangles: &[[u32; 3]]) -> Self {
        let positions = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| vertices.get(corner as usize).map(|vertex| vertex.position));
            Some([a?, b?, c?]).filter(|corners| corners.iter().all(|corner| corner.is_finite()))
        };
        let mut bounds = Bounds::EMPTY;
        triangles.iter().filter_map(positions).flatten().for_each(|corner| bounds.include(corner));
        let center = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
        let has_area = |[a, b, c]: [DVec3; 3]| {
            let area = (b - a).cross(c - a);
            area.is_finite() && area != DVec3::ZERO
        };
        let radius = if bounds.is_empty() { 0.0 } else { bounds.radius() };
        let is_kept = |corners: &[u32; 3]| radius < f64::from(f32::MAX) && positions(corners).is_some_and(has_area);
        let kept = (0..).zip(triangles).filter(|(_, corners)| is_kept(corners));
        let kept: Vec<Triangle> = kept.map(|(number, corners)| Triangle { corners: *corners, number }).collect();
        let corner = |vertex: &Vertex| {
            let Vertex { position, albedo, normal } = *vertex;
            Corner { position: position - center, albedo, normal }
        };
        let corners: Vec<Corner> = vertices.par_iter().map(corner).collect();
        let margin = BOX_MARGIN * radius as f32;
        let boxes: Vec<Aabb> = kept.par_iter().map(|triangle| triangle.bounds(&corners, margin)).collect();
        let tree = tree::build(&boxes);
        let left_out = triangles.len() - kept.len();
        let triangles = tree.primitive_indices.iter().map(|&index| kept[index as usize]).collect();
        Self { center, radius, corners, triangles, tree, left_out, specular: [0.0; 2] }
    }

    /// The triangles of a mirror that is a mesh, with the normals of its corners; `None` if it has a formula.
    pub fn of_mirror(mirror: &Mirror) -> Option<Self> {
        let (Surface::Mesh(mesh), placement) = mirror.surface() else { return None };
        let corners = mesh.positions().iter().zip(mesh.normals()).map(|(position, normal)| {
            let placed = placement.place(SurfacePoint { position: *position, normal: normal.as_dvec3() });
            Vertex { position: placed.position, albedo: Vec3::from(mirror.color), normal: placed.normal.as_vec3() }
        });
        let specular = [mirror.specular_intensity, mirror.specular_power].map(f64::from);
        Some(Self { specular, ..Self::new(&corners.collect::<Vec<_>>(), mesh.triangles()) })
    }

    /// The share of the light that is reflected, 0 to 1, and the exponent of highlights of lights.
    pub(crate) fn specular(&self) -> [f64; 2] {
        self.specular
    }

    /// The number of triangles that rays can hit.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The number of triangles that were left out.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// The first hit of a ray in coordinates relative to `origin`.
    pub(crate) fn nearest(&self, ray: &Ray, origin: DVec3) -> Option<TriangleHit> {
        let local = Local::of(self, ray, origin)?;
        let tree_ray = tree::ray(local.origin, ray.direction, f64::INFINITY)?;
        let mut best: Option<(Crossing, &Triangle)> = None;
        self.tree.ray_traverse(tree_ray, &mut RayHit::none(), |_, index| {
            let triangle = &self.triangles[index];
            let Some(crossing) = local.crossing(self.positions(triangle)) else {
                return f32::INFINITY;
            };
            let is_first = best.is_none_or(|(nearest, first)| {
                let order = crossing.distance.total_cmp(&nearest.distance);
                order.then(triangle.number.cmp(&first.number)).is_lt()
            });
            if is_first {
                best = Some((crossing, triangle));
            }
            round_up(crossing.distance)
        });
        let (crossing, triangle) = best?;
        Some(self.hit(ray, local.skipped, crossing, triangle))
    }

    /// Whether a ray in coordinates relative to `origin` hits anything before `distance`.
    pub(crate) fn is_blocked(&self, ray: &Ray, origin: DVec3, distance: f64) -> bool {
        let Some(local) = Local::of(self, ray, origin) else { return false };
        let rest = distance - local.skipped;
        let Some(tree_ray) = tree::ray(local.origin, ray.direction, rest).filter(|_| rest > 0.0) else {
            return false;
        };
        !self.tree.ray_traverse_miss(tree_ray, |_, index| {
            match local.crossing(self.positions(&self.triangles[index])) {
                Some(crossing) if crossing.distance < rest => 0.0,
                _ => f32::INFINITY,
            }
        })
    }

    fn positions(&self, triangle: &Triangle) -> [DVec3; 3] {
        triangle.corners.map(|corner| self.corners[corner as usize].position)
    }

    fn hit(&self, ray: &Ray, skipped: f64, crossing: Crossing, triangle: &Triangle) -> TriangleHit {
        let facing = |normal: DVec3| if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        let [a, b, c] = self.positions(triangle);
        let own = (b - a).cross(c - a).normalize_or(-ray.direction);
        let corners = triangle.corners.map(|corner| self.corners[corner as usize]);
        let mean = |of: fn(&Corner) -> Vec3| -> DVec3 {
            corners.iter().zip(crossing.shares).map(|(corner, share)| of(corner).as_dvec3() * share).sum()
        };
        let known = corners.iter().all(|corner| corner.normal != Vec3::ZERO);
        let smooth = if known { mean(|corner| corner.normal).normalize_or_zero() } else { DVec3::ZERO };
        // If the smooth surface turns its back on a ray that sees the triangle's front, the triangle's normal counts.
        let smooth = if smooth.dot(own) < 0.0 { -smooth } else { smooth };
        let is_seen = smooth.dot(ray.direction) * own.dot(ray.direction) > 0.0;
        TriangleHit {
            distance: skipped + crossing.distance,
            normal: facing(if is_seen { smooth } else { own }),
            albedo: mean(|corner| corner.albedo),
            triangle: triangle.number,
        }
    }
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Mesh").field("center", &self.center).field("triangles", &self.len()).finish()
    }
}

impl Triangle {
    fn bounds(&self, corners: &[Corner], margin: f32) -> Aabb {
        let [a, b, c] = self.corners.map(|corner| Vec3A::from(corners[corner as usize].position.as_vec3()));
        let shift = tree::apart(self.number) * margin;
        Aabb::new(a.min(b).min(c) + shift - 2.0 * margin, a.max(b).max(c) + shift + 2.0 * margin)
    }
}

/// Where a ray crosses a triangle.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    /// The distance from the local origin.
    distance: f64,
    /// The barycentric shares of the corners; their sum is 1.
    shares: [f64; 3],
}

/// A ray near a mesh, and the shear that turns its direction into an axis.
struct Local {
    /// The origin relative to the mesh's middle.
    origin: DVec3,
    /// The length of the ray before the local origin.
    skipped: f64,
    /// The least distance of a hit for a ray that leaves a surface.
    from: f64,
    /// The axes; the ray mostly runs along the last.
    axes: [usize; 3],
    /// The factors by which the other two axes are sheared, and the last is scaled.
    shear: [f64; 3],
}

impl Local {
    /// `None` if the ray misses the mesh or is not valid.
    fn of(mesh: &Mesh, ray: &Ray, origin: DVec3) -> Option<Self> {
        if mesh.is_empty() {
            return None;
        }
        let from_middle = ray.origin + (origin - mesh.center);
        let (near, from) = (NEAR * mesh.radius, if ray.leaves_surface { CLEARANCE * mesh.radius } else { 0.0 });
        let mut skipped = 0.0;
        if from_middle.length_squared() > near * near {
            let along = from_middle.dot(ray.direction);
            let beside = (from_middle - ray.direction * along).length();
            if along > 0.0 || beside > near {
                return None;
            }
            skipped = (-along - near).max(0.0);
        }
        let direction = ray.direction;
        let last = direction.abs().max_position();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let [x, y, z] = axes.map(|axis| direction[axis]);
        let shear = [x / z, y / z, 1.0 / z];
        shear.iter().all(|value| value.is_finite()).then(|| Self {
            origin: from_middle + direction * skipped,
            skipped,
            from: from - skipped,
            axes,
            shear,
        })
    }

    fn crossing(&self, corners: [DVec3; 3]) -> Option<Crossing> {
        let [kx, ky, kz] = self.axes;
        // Each corner is computed on its own, so that it is in the same place for all its triangles.
        let [a, b, c] = corners.map(|corner| {
            let offset = corner - self.origin;
            let along = offset[kz];
            [offset[kx] - self.shear[0] * along, offset[ky] - self.shear[1] * along, self.shear[2] * along]
        });
        // The neighbour across an edge computes the same products with the other sign.
        let side = |[ax, ay, _]: [f64; 3], [bx, by, _]: [f64; 3]| ax * by - ay * bx;
        let areas = [side(b, c), side(c, a), side(a, b)];
        if areas.iter().any(|area| *area < 0.0) && areas.iter().any(|area| *area > 0.0) {
            return None;
        }
        let whole: f64 = areas.iter().sum();
        // NaN if the ray lies in the triangle's plane, which is no hit.
        let shares = areas.map(|area| area / whole);
        let distance = shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2];
        (distance > self.from.max(0.0)).then_some(Crossing { distance, shares })
    }
}

#[cfg(test)]
#[path = "mesh_tests.rs"]
mod tests;
