//! A surface of triangles, and points spread evenly by area over it.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::bounds::Bounds;
use crate::random::unit;
use crate::sampling::SurfacePoint;

/// Triangles in coordinates of their own: the middle of their bounds is the origin, and the corner that is farthest
/// from it is at a distance of 1.
#[derive(Clone, Default)]
pub struct TriangleMesh {
    positions: Vec<DVec3>,
    /// The normal at each corner; zero where none is known.
    normals: Vec<Vec3>,
    /// The corners of triangles that have an area, counter-clockwise as seen from outside.
    triangles: Vec<[u32; 3]>,
    /// For each triangle, the area of all triangles up to its end.
    areas: Vec<f64>,
}

/// The steps of the additive sequence R2 of low discrepancy (Roberts 2018): 1/p and 1/p^2, where p^3 = p + 1. Points
/// that follow one another in a large triangle keep apart by it.
const R2: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

impl TriangleMesh {
    /// Moves and scales a mesh into its own coordinates. Triangles that name a corner that does not exist or is not
    /// finite, and those without an area, are left out. `normals` are those at the corners, zero where none is known;
    /// a list that is too short is filled with zeros.
    pub fn new(positions: &[DVec3], normals: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corners = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| positions.get(corner as usize).copied());
            Some([a?, b?, c?]).filter(|corners| corners.iter().all(|corner| corner.is_finite()))
        };
        let mut bounds = Bounds::EMPTY;
        triangles.iter().filter_map(corners).flatten().for_each(|corner| bounds.include(corner));
        if bounds.is_empty() {
            return Self::default();
        }
        let center = bounds.center();
        let used = triangles.iter().filter_map(corners).flatten();
        let reach = used.map(|corner| corner.distance(center)).fold(0.0, f64::max);
        let own = |position: DVec3| (position - center) / reach;
        let mut whole = 0.0;
        let (mut kept, mut areas) = (Vec::new(), Vec::new());
        for triangle in triangles {
            let Some([a, b, c]) = corners(triangle).map(|corners| corners.map(own)) else { continue };
            let area = (b - a).cross(c - a).length() / 2.0;
            if area > 0.0 && area.is_finite() {
                whole += area;
                kept.push(*triangle);
                areas.push(whole);
            }
        }
        let mut normals: Vec<Vec3> = normals.iter().map(|normal| normal.normalize_or_zero()).collect();
        normals.resize(positions.len(), Vec3::ZERO);
        Self { positions: positions.iter().map(|position| own(*position)).collect(), normals, triangles: kept, areas }
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    pub fn area(&self) -> f64 {
        self.areas.last().copied().unwrap_or(0.0)
    }

    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The least and the greatest z of the triangles' corners.
    pub fn heights(&self) -> [f64; 2] {
        let corners = self.triangles.iter().flatten().map(|corner| self.positions[*corner as usize].z);
        corners.fold([0.0; 2], |[low, high], z| [z.min(low), z.max(high)])
    }

    /// `count` points, evenly by area: each triangle has as many as its share of the area, rounded by the sum over the
    /// triangles before it. A mesh without triangles has no points. The same seed gives the same points.
    pub fn sample(&self, count: usize, seed: u64) -> Vec<SurfacePoint> {
        self.places(count, seed).map(|(triangle, shares)| self.point(triangle, shares)).collect()
    }

    /// The places of the points of `sample`: the number of the triangle, and the shares of its corners.
    pub fn places(&self, count: usize, seed: u64) -> impl IndexedParallelIterator<Item = (usize, [f64; 3])> {
        let count = if self.is_empty() { 0 } else { count };
        let share = self.area() / count.max(1) as f64;
        let shift = [unit(seed, 0), unit(seed, 1)];
        let place = move |index: usize| {
            let at = (index as f64 + unit(seed, index as u64 + 2)) * share;
            let triangle = self.areas.partition_point(|end| *end <= at).min(self.triangles.len() - 1);
            let [u, v] = [0, 1].map(|axis| (shift[axis] + R2[axis] * index as f64).fract());
            // Even numbers give points that are even by area.
            let side = u.sqrt();
            (triangle, [1.0 - side, side * (1.0 - v), side * v])
        };
        (0..count).into_par_iter().map(place)
    }

    fn point(&self, triangle: usize, shares: [f64; 3]) -> SurfacePoint {
        let corners = self.triangles[triangle].map(|corner| corner as usize);
        let [a, b, c] = corners.map(|corner| self.positions[corner]);
        let own = (b - a).cross(c - a).normalize_or(DVec3::Z);
        let normals = corners.map(|corner| self.normals[corner].as_dvec3());
        let known = normals.iter().all(|normal| *normal != DVec3::ZERO);
        let smooth: DVec3 = normals.into_iter().zip(shares).map(|(normal, share)| normal * share).sum();
        let smooth = if smooth.dot(own) < 0.0 { -smooth } else { smooth };
        SurfacePoint {
            position: a * shares[0] + b * shares[1] + c * shares[2],
            normal: if known { smooth.normalize_or(own) } else { own },
        }
    }
}

impl std::fmt::Debug for TriangleMesh {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("TriangleMesh").field("triangles", &self.triangles.len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box with the sides 2, 4 and 6, away from the origin.
    fn cuboid() -> TriangleMesh {
        let corner = |index: u32| {
            let side = |bit: u32, length: f64| if index >> bit & 1 == 1 { length } else { 0.0 };
            DVec3::new(10.0 + side(0, 2.0), side(1, 4.0), 1e6 + side(2, 6.0))
        };
        let corners: Vec<DVec3> = (0..8).map(corner).collect();
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriangleMesh::new(&corners, &[], &triangles)
    }

    #[test]
    fn a_mesh_is_moved_and_scaled_to_reach_one() {
        let mesh = cuboid();
        let reach = mesh.positions().iter().map(|position| position.length()).fold(0.0, f64::max);
        let half = 14.0_f64.sqrt();
        assert!((reach - 1.0).abs() < 1e-9 && mesh.heights()[1] == 3.0 / half, "{reach} {:?}", mesh.heights());
        assert!((mesh.area() - 88.0 / (half * half)).abs() < 1e-9, "{}", mesh.area());
    }

    #[test]
    fn points_are_even_by_area_and_have_the_normals_of_their_faces() {
        let mesh = cuboid();
        let half = DVec3::new(1.0, 2.0, 3.0) / 14.0_f64.sqrt();
        let count = 88_000;
        let mut faces = [0_usize; 6];
        // Each face of 2 x 4, 2 x 6 or 4 x 6 is also cut into four quarters.
        let mut quarters = [[0_usize; 4]; 6];
        for point in mesh.sample(count, 3) {
            let axis = (point.position / half).abs().max_position();
            assert!((point.position[axis].abs() - half[axis]).abs() < 1e-9, "{point:?}");
            let outward = DVec3::AXES[axis] * point.position[axis].signum();
            assert!(point.normal.distance(outward) < 1e-9, "{point:?}");
            let face = 2 * axis + usize::from(point.position[axis] > 0.0);
            faces[face] += 1;
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| usize::from(point.position[other] > 0.0));
            quarters[face][2 * u + v] += 1;
        }
        for (face, expected) in [24_000, 24_000, 12_000, 12_000, 8_000, 8_000].into_iter().enumerate() {
            assert!(faces[face].abs_diff(expected) <= 2, "{faces:?}");
            assert!(quarters[face].iter().all(|quarter| quarter.abs_diff(expected / 4) < 200), "{quarters:?}");
        }
    }

    #[test]
    fn normals_at_corners_are_interpolated() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let tilted = Vec3::new(0.6, 0.0, 0.8);
        let mesh = TriangleMesh::new(&corners, &[Vec3::Z * 2.0, tilted, Vec3::Z], &[[0, 1, 2]]);
        for point in mesh.sample(1000, 1) {
            assert!(point.normal.is_normalized() && point.normal.y.abs() < 1e-6 && point.normal.x > 0.0, "{point:?}");
        }
        let unknown = TriangleMesh::new(&corners, &[Vec3::Z, tilted], &[[0, 1, 2]]);
        assert!(unknown.sample(10, 1).iter().all(|point| point.normal == DVec3::Z));
    }

    #[test]
    fn triangles_without_an_area_or_a_corner_are_left_out() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::NAN, DVec3::splat(1e9)];
        let mesh = TriangleMesh::new(&corners, &[], &[[0, 1, 1], [0, 1, 3], [0, 1, 9], [2, 0, 1]]);
        assert_eq!(mesh.triangles(), [[2, 0, 1]]);
        // The corner that no triangle uses does not count.
        assert!((mesh.area() - 1.0).abs() < 1e-9, "{}", mesh.area());
        for empty in [TriangleMesh::default(), TriangleMesh::new(&corners, &[], &[[0, 1, 1]])] {
            assert!(empty.is_empty() && empty.area() == 0.0 && empty.sample(100, 1).is_empty());
        }
    }

    #[test]
    fn same_seed_gives_the_same_points_and_another_seed_others() {
        let mesh = cuboid();
        assert_eq!(mesh.sample(500, 9), mesh.sample(500, 9));
        assert_ne!(mesh.sample(500, 9), mesh.sample(500, 10));
    }
}
