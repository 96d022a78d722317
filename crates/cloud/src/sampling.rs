//! Spreads points evenly by area over analytic surfaces, with exact normals, and over meshes: for the built-in scenes,
//! and for clouds whose truth is known.
//!
//! A surface is cut into as many cells of equal area as points are asked for, and each cell gets one point at a place
//! drawn by hash (stratified sampling), so a surface has no clumps and no holes and the same seed gives the same
//! points. Positions and normals are in the surface's own coordinates; `Placement` moves them.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::random::{hash, unit};
use crate::triangle_mesh::TriangleMesh;

/// A surface in its own coordinates. Areas are in squared world units.
#[derive(Clone, Debug)]
pub enum Surface {
    /// `corner + u edges[0] + v edges[1]`, 0 <= u, v <= 1, edges at right angles; the normal is along their cross
    /// product.
    Rectangle { corner: DVec3, edges: [DVec3; 2] },
    /// A sphere about the origin with outward normals.
    Sphere { radius: f64 },
    /// z = (x^2 + y^2) / (4 focal_length) inside x^2 + y^2 <= rim_radius^2; normals on the hollow side, towards the
    /// focus.
    Paraboloid { focal_length: f64, rim_radius: f64 },
    /// x^2 + y^2 = radius^2 for |z| <= half_height, with both ends open; normals away from the axis.
    Cylinder { radius: f64, half_height: f64 },
    /// A tube of radius `tube` whose middle is the circle of radius `ring` in z = 0; `tube < ring`; normals outwards.
    Torus { ring: f64, tube: f64 },
    /// The points r(d) d for all unit vectors d; normals outwards.
    Star(StarShape),
    /// Triangles, with the normals of the mesh.
    Mesh(Arc<TriangleMesh>),
}

/// A star-shaped surface, given by its radius as a function of the direction. `radius` is any smooth positive function
/// of the three components of the direction, and `gradient` its derivatives by these, as if they were independent.
#[derive(Clone, Copy, Debug)]
pub struct StarShape {
    pub radius: fn(DVec3) -> f64,
    pub gradient: fn(DVec3) -> DVec3,
}

impl StarShape {
    /// The gradient of the radius along the unit sphere: its part across `direction`.
    fn slope(&self, direction: DVec3) -> DVec3 {
        let gradient = (self.gradient)(direction);
        gradient - direction * gradient.dot(direction)
    }

    /// Area over solid angle: the surface grows by r^2 with the distance and by the secant of the angle between normal
    /// and direction, sqrt(r^2 + |slope|^2) / r.
    pub fn area_per_solid_angle(&self, direction: DVec3) -> f64 {
        let radius = (self.radius)(direction);
        radius * (radius * radius + self.slope(direction).length_squared()).sqrt()
    }

    /// The point and the normal in a direction. f(p) = |p| - r(p / |p|) has the gradient d - slope / r.
    pub fn point(&self, direction: DVec3) -> SurfacePoint {
        let radius = (self.radius)(direction);
        SurfacePoint {
            position: direction * radius,
            normal: (direction - self.slope(direction) / radius).normalize_or(direction),
        }
    }
}

/// A point of a surface and the unit normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub position: DVec3,
    pub normal: DVec3,
}

/// The placement of a surface in the world: it is turned, scaled and moved, in this order.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    pub rotation: DMat3,
    pub scale: f64,
    pub translation: DVec3,
}

impl Placement {
    pub const ORIGIN: Self = Self { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    pub fn place(&self, point: SurfacePoint) -> SurfacePoint {
        SurfacePoint {
            position: self.rotation * point.position * self.scale + self.translation,
            normal: self.rotation * point.normal,
        }
    }
}

impl Surface {
    pub fn area(&self) -> f64 {
        match *self {
            Self::Rectangle { edges: [u, v], .. } => u.cross(v).length(),
            Self::Sphere { radius } => 4.0 * PI * radius * radius,
            Self::Paraboloid { focal_length, rim_radius } => paraboloid_area(focal_length, rim_radius),
            Self::Cylinder { radius, half_height } => TAU * radius * 2.0 * half_height,
            // Pappus: the tube's circumference times the path of its middle.
            Self::Torus { ring, tube } => TAU * ring * TAU * tube,
            Self::Star(shape) => star_area(&shape),
            Self::Mesh(ref mesh) => mesh.area(),
        }
    }

    /// `count` points, spread evenly by area; none on a mesh without triangles.
    pub fn sample(&self, count: usize, seed: u64) -> Vec<SurfacePoint> {
        match *self {
            Self::Rectangle { corner, edges: [u, v] } => {
                let normal = u.cross(v).normalize_or(DVec3::Z);
                sample_rows(
                    count,
                    seed,
                    u.length(),
                    v.length(),
                    |down| down,
                    |_| 1.0,
                    |across, down| SurfacePoint { position: corner + u * across + v * down, normal },
                )
            }
            // Archimedes: area is even in z.
            Self::Sphere { radius } => {
                let height = |down: f64| (1.0 - 2.0 * down).clamp(-1.0, 1.0);
                sample_rows(
                    count,
                    seed,
                    TAU * radius,
                    PI * radius,
                    |arc| (1.0 - (PI * arc).cos()) / 2.0,
                    |down| (1.0 - height(down).powi(2)).sqrt(),
                    |across, down| {
                        let direction = on_sphere(across, height(down));
                        SurfacePoint { position: direction * radius, normal: direction }
                    },
                )
            }
            Self::Paraboloid { focal_length, rim_radius } => {
                let area = paraboloid_area(focal_length, rim_radius);
                let radius = |down: f64| paraboloid_radius(focal_length, area * down).min(rim_radius);
                sample_rows(
                    count,
                    seed,
                    TAU * rim_radius,
                    rim_radius,
                    |out| paraboloid_area(focal_length, rim_radius * out) / area,
                    |down| radius(down) / rim_radius,
                    |across, down| {
                        let radius = radius(down);
                        let (sin, cos) = (TAU * across).sin_cos();
                        let (x, y) = (radius * cos, radius * sin);
                        SurfacePoint {
                            position: DVec3::new(x, y, radius * radius / (4.0 * focal_length)),
                            normal: DVec3::new(-x, -y, 2.0 * focal_length).normalize_or(DVec3::Z),
                        }
                    },
                )
            }
            Self::Cylinder { radius, half_height } => sample_rows(
                count,
                seed,
                TAU * radius,
                2.0 * half_height,
                |down| down,
                |_| 1.0,
                |across, down| {
                    let (sin, cos) = (TAU * across).sin_cos();
                    let normal = DVec3::new(cos, sin, 0.0);
                    SurfacePoint { position: normal * radius + DVec3::Z * (half_height * (2.0 * down - 1.0)), normal }
                },
            ),
            Self::Torus { ring, tube } => {
                // The area up to the angle a around the tube is proportional to ring a + tube sin a.
                let share = |angle: f64| (ring * angle + tube * angle.sin()) / (TAU * ring);
                let angle = |down: f64| {
                    // Newton from the middle of the two bounds of the solution; the slope is at least ring - tube.
                    let mut angle = TAU * down;
                    for _ in 0..50 {
                        let step = (share(angle) - down) * TAU * ring / (ring + tube * angle.cos());
                        angle -= step;
                        if step.abs() < 1e-14 {
                            break;
                        }
                    }
                    angle
                };
                sample_rows(
                    count,
                    seed,
                    TAU * (ring + tube),
                    TAU * tube,
                    |turn| share(TAU * turn),
                    |down| (ring + tube * angle(down).cos()) / (ring + tube),
                    |across, down| {
                        let (sin, cos) = angle(down).sin_cos();
                        let (sin_around, cos_around) = (TAU * across).sin_cos();
                        let normal = DVec3::new(cos * cos_around, cos * sin_around, sin);
                        let middle = DVec3::new(cos_around, sin_around, 0.0) * ring;
                        SurfacePoint { position: middle + normal * tube, normal }
                    },
                )
            }
            Self::Star(shape) => sample_star(&shape, count, seed),
            Self::Mesh(ref mesh) => mesh.sample(count, seed),
        }
    }
}

/// Cuts a surface into rows of about the height of a cell and every row into cells, all of the same area, and places a
/// point in each. `down` = 0 ..= 1 is the place of a row and even in area; so is `across` within a row.
///
/// `width` is the length of the longest row and `relative_width(down)` that of others relative to it; `height` is the
/// length across the rows, and `down(part)` the share of the area before a part of it.
fn sample_rows(
    count: usize,
    seed: u64,
    width: f64,
    height: f64,
    down: impl Fn(f64) -> f64,
    relative_width: impl Fn(f64) -> f64 + Sync,
    point: impl Fn(f64, f64) -> SurfacePoint + Sync,
) -> Vec<SurfacePoint> {
    if count == 0 {
        return Vec::new();
    }
    // The number of rows makes cells square at the mean width.
    let mean_width = (0..64).map(|i| relative_width(down((f64::from(i) + 0.5) / 64.0))).sum::<f64>() / 64.0;
    let rows = (count as f64 * height / (width * mean_width)).sqrt().round().clamp(1.0, count as f64) as usize;
    // The first cell of every row; rows end where whole cells end, so that all cells are equal.
    let firsts: Vec<usize> =
        (0..=rows).map(|row| (down(row as f64 / rows as f64) * count as f64).round() as usize).collect();
    let row_points = |row: usize| {
        let (first, end) = (firsts[row].min(count), firsts[row + 1].min(count));
        let (top, bottom) = (first as f64 / count as f64, end as f64 / count as f64);
        let point = &point;
        (first..end).map(move |cell| {
            let across = (cell - first) as f64 + unit(seed, 2 * cell as u64);
            point(across / (end - first) as f64, top + (bottom - top) * unit(seed, 2 * cell as u64 + 1))
        })
    };
    (0..rows).into_par_iter().flat_map_iter(row_points).collect()
}

/// The unit vector at height z, `turn` of the way round.
fn on_sphere(turn: f64, z: f64) -> DVec3 {
    let ring = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * turn).sin_cos();
    DVec3::new(ring * cos, ring * sin, z)
}

/// The area of the paraboloid inside a radius: the integral of 2 pi s sqrt(1 + (s / 2f)^2).
fn paraboloid_area(focal_length: f64, radius: f64) -> f64 {
    let slope = radius / (2.0 * focal_length);
    8.0 / 3.0 * PI * focal_length * focal_length * ((1.0 + slope * slope).powf(1.5) - 1.0)
}

/// The radius that encloses an area.
fn paraboloid_radius(focal_length: f64, area: f64) -> f64 {
    let growth = 1.0 + 3.0 * area / (8.0 * PI * focal_length * focal_length);
    2.0 * focal_length * (growth.powf(2.0 / 3.0) - 1.0).max(0.0).sqrt()
}

/// The number of steps of the quadrature from pole to pole, and half the number around. The midpoint rule's error at
/// the poles is (pi / steps)^2 / 12, about 1e-5; around, the integrand is periodic and the rule exact up to 256 waves.
const AREA_STEPS: usize = 256;

fn star_area(shape: &StarShape) -> f64 {
    let (down, around) = (PI / AREA_STEPS as f64, 2 * AREA_STEPS);
    let ring = |row: usize| {
        let (sin, cos) = ((row as f64 + 0.5) * down).sin_cos();
        let sum: f64 = (0..around)
            .map(|step| shape.area_per_solid_angle(on_sphere((step as f64 + 0.5) / around as f64, cos)))
            .sum();
        sum * sin
    };
    // Collected before they are summed: the order of the sum, and so its last digit, must not depend on the threads.
    let rings: Vec<f64> = (0..AREA_STEPS).into_par_iter().map(ring).collect();
    rings.iter().sum::<f64>() * down * TAU / around as f64
}

/// The number of directions drawn per point of a star-shaped surface. A direction is chosen at most once while the area
/// per solid angle stays below this many times its mean.
const DIRECTIONS_PER_POINT: usize = 6;

/// Draws directions evenly by solid angle and chooses each with a probability proportional to the surface's area per
/// solid angle there. It goes through them along a Morton curve and chooses one whenever the area behind has grown by
/// one point's share (systematic sampling), so that nearby points keep apart.
fn sample_star(shape: &StarShape, count: usize, seed: u64) -> Vec<SurfacePoint> {
    let mut directions = Surface::Sphere { radius: 1.0 }.sample(count * DIRECTIONS_PER_POINT, hash(seed));
    sort_along_curve(&mut directions);
    let areas: Vec<f64> = directions.par_iter().map(|point| shape.area_per_solid_angle(point.normal)).collect();
    let share = areas.iter().sum::<f64>() / count as f64;
    let mut chosen = Vec::with_capacity(count);
    let mut behind = 0.0;
    for (direction, area) in directions.iter().zip(&areas) {
        behind += area;
        // Half a share ahead, so that rounding of the last sum can neither lose nor add a point.
        while chosen.len() < count && behind > (chosen.len() as f64 + 0.5) * share {
            chosen.push(direction.normal);
        }
    }
    chosen.into_par_iter().map(|direction| shape.point(direction)).collect()
}

/// Sorts points along a Morton curve through their bounding cube, so that any run of them lies together.
pub fn sort_along_curve(points: &mut Vec<SurfacePoint>) {
    let (min, max) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), point| {
        (min.min(point.position), max.max(point.position))
    });
    // 1024 steps a side: cells far smaller than a chunk.
    let scale = 1023.0 / (max - min).max_element().max(f64::MIN_POSITIVE);
    let mut keys: Vec<(u32, u32)> = points
        .par_iter()
        .enumerate()
        .map(|(index, point)| {
            let cell = ((point.position - min) * scale).as_uvec3();
            (spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2, index as u32)
        })
        .collect();
    keys.par_sort_unstable();
    *points = keys.into_par_iter().map(|(_, index)| points[index as usize]).collect();
}

/// Ten bits with two zeros after each.
fn spread(value: u32) -> u32 {
    let mut bits = value & 0x3ff;
    bits = (bits | bits << 16) & 0x0300_00ff;
    bits = (bits | bits << 8) & 0x0300_f00f;
    bits = (bits | bits << 4) & 0x030c_30c3;
    (bits | bits << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bumpy_radius(d: DVec3) -> f64 {
        0.4 * (1.0 + 0.1 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin())
    }

    fn bumpy_gradient(d: DVec3) -> DVec3 {
        0.4 * DVec3::new(
            0.6 * (6.0 * d.x + 1.0).cos() * (5.0 * d.y).sin(),
            0.5 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).cos(),
            0.42 * (7.0 * d.z).cos(),
        )
    }

    const BUMPY: StarShape = StarShape { radius: bumpy_radius, gradient: bumpy_gradient };
    /// An ellipsoid as a star: its area and normals are known otherwise.
    const SPHEROID: StarShape = StarShape {
        radius: |d| (d.x * d.x + d.y * d.y + 4.0 * d.z * d.z).sqrt().recip(),
        gradient: |d| -DVec3::new(d.x, d.y, 4.0 * d.z) * (d.x * d.x + d.y * d.y + 4.0 * d.z * d.z).powf(-1.5),
    };

    fn surfaces() -> Vec<Surface> {
        vec![
            Surface::Rectangle { corner: DVec3::new(1.0, 2.0, 3.0), edges: [DVec3::X * 3.0, DVec3::Z * 0.5] },
            Surface::Sphere { radius: 0.7 },
            Surface::Paraboloid { focal_length: 0.25, rim_radius: 0.45 },
            Surface::Cylinder { radius: 0.2, half_height: 1.1 },
            Surface::Torus { ring: 0.33, tube: 0.14 },
            Surface::Star(BUMPY),
            Surface::Star(SPHEROID),
        ]
    }

    /// The sum over cells of (seen - expected)^2 / expected, and the number of cells less one.
    fn chi_square(counts: &[f64], expected: &[f64]) -> (f64, f64) {
        let sum = counts.iter().zip(expected).map(|(seen, expected)| (seen - expected).powi(2) / expected).sum();
        (sum, counts.len() as f64 - 1.0)
    }

    /// The limit is far above the 99.9 % quantile for independent points; stratified ones stay far below it.
    fn assert_uniform(counts: &[f64], expected: &[f64], what: &str) {
        let (statistic, freedom) = chi_square(counts, expected);
        assert!(statistic < freedom + 3.1 * (2.0 * freedom).sqrt(), "{what}: {statistic} for {freedom} degrees");
    }

    #[test]
    fn samples_are_as_many_as_asked_for_and_finite() {
        for surface in surfaces() {
            for count in [0, 1, 2, 7, 1000, 12_345] {
                let points = surface.sample(count, 3);
                assert_eq!(points.len(), count, "{surface:?}");
                assert!(points.iter().all(|point| point.position.is_finite() && point.normal.is_normalized()));
            }
        }
    }

    #[test]
    fn same_seed_gives_the_same_points_and_another_seed_others() {
        for surface in surfaces() {
            assert_eq!(surface.sample(500, 9), surface.sample(500, 9));
            assert_ne!(surface.sample(500, 9), surface.sample(500, 10));
        }
    }

    #[test]
    fn sphere_points_are_uniform_by_area() {
        // 12 x 12 cells of equal area: even in z and in azimuth.
        let mut counts = [0.0; 144];
        for point in (Surface::Sphere { radius: 2.0 }).sample(100_000, 1) {
            let d = point.position / 2.0;
            let row = ((d.z + 1.0) * 6.0).min(11.0) as usize;
            let column = ((d.y.atan2(d.x) / TAU).rem_euclid(1.0) * 12.0).min(11.0) as usize;
            counts[12 * row + column] += 1.0;
        }
        assert_uniform(&counts, &[100_000.0 / 144.0; 144], "sphere");
    }

    #[test]
    fn torus_points_are_uniform_by_area() {
        let (ring, tube, count) = (0.33, 0.14, 100_000);
        let (mut counts, mut expected) = ([0.0; 96], [0.0; 96]);
        for point in (Surface::Torus { ring, tube }).sample(count, 1) {
            let p = point.position;
            let angle = p.z.atan2(p.x.hypot(p.y) - ring).rem_euclid(TAU);
            let turn = (p.y.atan2(p.x) / TAU).rem_euclid(1.0);
            counts[8 * ((angle / TAU * 12.0).min(11.0) as usize) + (turn * 8.0).min(7.0) as usize] += 1.0;
        }
        for cell in 0..96 {
            let [a, b] = [cell / 8, cell / 8 + 1].map(|row| row as f64 / 12.0 * TAU);
            let share = (ring * (b - a) + tube * (b.sin() - a.sin())) / (TAU * ring) / 8.0;
            expected[cell] = share * count as f64;
        }
        assert_uniform(&counts, &expected, "torus");
    }

    #[test]
    fn paraboloid_points_are_uniform_by_area() {
        let surface = Surface::Paraboloid { focal_length: 0.25, rim_radius: 0.45 };
        let (mut counts, mut expected) = ([0.0; 80], [0.0; 80]);
        for point in surface.sample(100_000, 1) {
            let p = point.position;
            let turn = (p.y.atan2(p.x) / TAU).rem_euclid(1.0);
            let ring = (p.x.hypot(p.y) / 0.45 * 10.0).min(9.0) as usize;
            counts[8 * ring + (turn * 8.0).min(7.0) as usize] += 1.0;
        }
        for cell in 0..80 {
            // The integral by small steps, not by the closed form under test.
            let steps = 1000;
            let area: f64 = (0..steps)
                .map(|step| 0.045 * ((cell / 8) as f64 + (f64::from(step) + 0.5) / f64::from(steps)))
                .map(|radius| TAU * radius * (1.0 + (radius / 0.5).powi(2)).sqrt() * 0.045 / f64::from(steps))
                .sum();
            expected[cell] = area / 8.0 / surface.area() * 100_000.0;
        }
        assert!((expected.iter().sum::<f64>() - 100_000.0).abs() < 1.0, "the area disagrees with its integral");
        assert_uniform(&counts, &expected, "paraboloid");
    }

    #[test]
    fn cylinder_points_are_uniform_by_area() {
        let surface = Surface::Cylinder { radius: 0.2, half_height: 1.1 };
        assert!((surface.area() - TAU * 0.2 * 2.2).abs() < 1e-12);
        let mut counts = [0.0; 96];
        for point in surface.sample(100_000, 1) {
            let p = point.position;
            assert!((p.x.hypot(p.y) - 0.2).abs() < 1e-12 && p.z.abs() <= 1.1 && point.normal.z == 0.0);
            let turn = (p.y.atan2(p.x) / TAU).rem_euclid(1.0);
            counts[8 * (((p.z + 1.1) / 2.2 * 12.0).min(11.0) as usize) + (turn * 8.0).min(7.0) as usize] += 1.0;
        }
        assert_uniform(&counts, &[100_000.0 / 96.0; 96], "cylinder");
    }

    #[test]
    fn star_points_are_uniform_by_area() {
        for (shape, what) in [(BUMPY, "bumpy"), (SPHEROID, "spheroid")] {
            let count = 100_000;
            let (mut counts, mut expected) = ([0.0; 144], [0.0; 144]);
            for point in Surface::Star(shape).sample(count, 1) {
                let d = point.position.normalize();
                let row = ((d.z + 1.0) * 6.0).min(11.0) as usize;
                let column = ((d.y.atan2(d.x) / TAU).rem_euclid(1.0) * 12.0).min(11.0) as usize;
                counts[12 * row + column] += 1.0;
            }
            // Areas of flat triangles over a fine grid of directions, without the density under test.
            let fine = 40;
            let place = |row: usize, column: usize| {
                let d = on_sphere(column as f64 / (12 * fine) as f64, (row as f64 / (6 * fine) as f64 - 1.0).min(1.0));
                d * (shape.radius)(d)
            };
            for row in 0..12 * fine {
                for column in 0..12 * fine {
                    let [a, b] = [place(row, column), place(row, column + 1)];
                    let [c, d] = [place(row + 1, column), place(row + 1, column + 1)];
                    let area = ((b - a).cross(c - a).length() + (b - d).cross(c - d).length()) / 2.0;
                    expected[12 * (row / fine) + column / fine] += area;
                }
            }
            let area: f64 = expected.iter().sum();
            let ratio = Surface::Star(shape).area() / area;
            assert!((ratio - 1.0).abs() < 2e-3, "{what}: area over that of triangles is {ratio}");
            expected.iter_mut().for_each(|expected| *expected *= count as f64 / area);
            assert_uniform(&counts, &expected, what);
        }
    }

    #[test]
    fn spheroid_as_a_star_has_its_area_and_normals() {
        // Oblate, half axes 1, 1, 1/2: 2 pi (1 + (1 - e^2) / e atanh e), e^2 = 3/4.
        let e = 0.75_f64.sqrt();
        let exact = TAU * (1.0 + 0.25 / e * e.atanh());
        let area = Surface::Star(SPHEROID).area();
        assert!((area / exact - 1.0).abs() < 2e-5, "{area} instead of {exact}");
        for point in Surface::Star(SPHEROID).sample(1000, 5) {
            let p = point.position;
            assert!((p.x * p.x + p.y * p.y + 4.0 * p.z * p.z - 1.0).abs() < 1e-12);
            let normal = DVec3::new(p.x, p.y, 4.0 * p.z).normalize();
            assert!(point.normal.distance(normal) < 1e-12, "{} instead of {normal}", point.normal);
        }
    }

    #[test]
    fn normals_agree_with_the_surface_close_by() {
        // Neighbouring points lie in the tangent plane up to the curvature.
        for surface in surfaces() {
            let points = surface.sample(20_000, 2);
            let spacing = (surface.area() / 20_000.0).sqrt();
            let mut pairs = 0;
            for pair in points.windows(2) {
                let step = pair[1].position - pair[0].position;
                if step.length() < 2.0 * spacing && step.length() > 0.1 * spacing {
                    let lift = step.normalize().dot(pair[0].normal).abs();
                    assert!(lift < 0.15, "{surface:?}: {} degrees", lift.asin().to_degrees());
                    pairs += 1;
                }
            }
            assert!(pairs > 5_000, "{surface:?}: only {pairs} pairs");
        }
    }

    #[test]
    fn stratified_points_leave_no_clumps() {
        // The mean distance to the nearest other is 0.5 spacings for independent points, near 1 for a grid.
        for surface in surfaces() {
            let points = surface.sample(2000, 4);
            let spacing = (surface.area() / 2000.0).sqrt();
            let nearest = |p: &SurfacePoint| {
                let others = points.iter().map(|q| q.position.distance(p.position)).filter(|d| *d > 0.0);
                others.fold(f64::INFINITY, f64::min)
            };
            let mean = points.iter().map(nearest).sum::<f64>() / 2000.0 / spacing;
            assert!(mean > 0.54, "{surface:?}: {mean} spacings");
        }
    }

    #[test]
    fn placement_turns_then_scales_then_moves() {
        let placement = Placement {
            rotation: DMat3::from_rotation_z(PI / 2.0),
            scale: 2.0,
            translation: DVec3::new(0.0, 0.0, 5.0),
        };
        let placed = placement.place(SurfacePoint { position: DVec3::X, normal: DVec3::X });
        assert!(placed.position.distance(DVec3::new(0.0, 2.0, 5.0)) < 1e-15);
        assert!(placed.normal.distance(DVec3::Y) < 1e-15);
    }

    #[test]
    fn sorting_along_the_curve_keeps_every_point_and_shortens_the_way() {
        let mut points = Surface::Sphere { radius: 1.0 }.sample(10_000, 1);
        let way =
            |points: &[SurfacePoint]| points.windows(2).map(|p| p[0].position.distance(p[1].position)).sum::<f64>();
        // Taking every 37th point in turn puts them out of order.
        points = (0..10_000).map(|i| points[i * 37 % 10_000]).collect();
        let mut sorted = points.clone();
        sort_along_curve(&mut sorted);
        assert!(way(&sorted) < 0.5 * way(&points), "{} of {}", way(&sorted), way(&points));
        let key = |p: &SurfacePoint| p.position.to_array().map(f64::to_bits);
        let [mut a, mut b] = [points, sorted].map(|points| points.iter().map(key).collect::<Vec<_>>());
        a.sort_unstable();
        b.sort_unstable();
        assert_eq!(a, b);
    }
}
