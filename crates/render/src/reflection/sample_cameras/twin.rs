//! Bundles of reflected rays on the CPU, in doubles and plain code with the shaders' names: the GPU's roots are tested
//! against these, and these against closed forms. All points are kept, and no root is dropped.

use cloud::Bounds;
use glam::{DVec2, DVec3, DVec4, UVec2};
use scene::{JudgedBy, SampleCameras as Parameters};

use crate::reflection::sscr::twin::MirrorPicture;

/// A square of the picture and the polynomials that stand for its rays.
pub struct Leaf {
    pub is_exact: bool,
    middle: DVec3,
    axis: DVec3,
    across: [DVec3; 2],
    /// The bounds of z of points that are reflected.
    depths: [f64; 2],
    pub center: DVec2,
    half: f64,
    /// t and k, as factors of 1, x, y, xx, xy, yy, xxx, xxy, xyy, yyy.
    factors: [DVec4; 10],
}

/// The squares of a picture, in the order of a descent.
pub struct Bundles<'a> {
    picture: &'a MirrorPicture,
    settings: &'a Parameters,
    scene: Bounds,
    scene_radius: f64,
    pub leaves: Vec<Leaf>,
}

/// A reflected ray, and its pixel's place in a square.
struct Ray {
    is_inside: bool,
    place: DVec2,
    point: DVec3,
    direction: DVec3,
}

/// A place of the mirror that reflects a point.
#[derive(Clone, Copy, Debug)]
pub struct Root {
    /// The pixel coordinate.
    pub at: DVec2,
    /// The distance of the point from the mirror.
    pub reach: f64,
}

const LEAST_MEAN: f64 = 0.3;
const LEAST_ALONG: f64 = 0.15;
const BORDER: f64 = 0.25;
const SAME_ROOT: f64 = 1.0;
const OWN_SURFACE_RADII: f64 = 4.0;

fn across_axis(axis: DVec3) -> [DVec3; 2] {
    let size = axis.abs();
    let side = if size.x <= size.y && size.x <= size.z {
        DVec3::X
    } else if size.y <= size.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let x = axis.cross(side).normalize();
    [x, axis.cross(x)]
}

fn terms_at(p: DVec2) -> [f64; 10] {
    let second = 1.5 * p * p - 0.5;
    let third = (2.5 * p * p - 1.5) * p;
    [1.0, p.x, p.y, second.x, p.x * p.y, second.y, third.x, second.x * p.y, p.x * second.y, third.y]
}

/// The step (x, y) with x `by_x` + y `by_y` = value.
fn solved(by_x: DVec2, by_y: DVec2, value: DVec2) -> DVec2 {
    DVec2::new(value.perp_dot(by_y), by_x.perp_dot(value)) / by_x.perp_dot(by_y)
}

impl Leaf {
    /// The ray of a place: x and y of t, then of k; and their changes along x and y.
    fn at(&self, p: DVec2) -> [DVec4; 3] {
        let f = &self.factors;
        let (x, y) = (p.x, p.y);
        let powers = [1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y];
        let along_x = [0.0, 1.0, 0.0, 2.0 * x, y, 0.0, 3.0 * x * x, 2.0 * x * y, y * y, 0.0];
        let along_y = [0.0, 0.0, 1.0, 0.0, x, 2.0 * y, 0.0, x * x, 2.0 * x * y, 3.0 * y * y];
        [powers, along_x, along_y].map(|terms| f.iter().zip(terms).map(|(factor, term)| *factor * term).sum())
    }

    /// The distances from a mirror point, along the ray of its pixel, at which neighbouring rays meet: where the places of
    /// rays no longer change with the pixel in one direction. Before them, by how much they are real: the discriminant
    /// over the square of the linear part; below 0 there are none, and the double one is reported.
    pub fn foci(&self, at: DVec2, point: DVec3) -> (f64, [f64; 2]) {
        let [ray, along_x, along_y] = self.at((at - self.center) / self.half);
        let [tx, ty] = [along_x, along_y].map(|change| DVec2::new(change.x, change.y));
        let [kx, ky] = [along_x, along_y].map(|change| DVec2::new(change.z, change.w));
        let (constant, linear, square) = (tx.perp_dot(ty), tx.perp_dot(ky) + kx.perp_dot(ty), kx.perp_dot(ky));
        let discriminant = linear * linear - 4.0 * constant * square;
        let stable = -0.5 * (linear + discriminant.max(0.0).sqrt().copysign(linear));
        let per_depth = DVec3::new(ray.z, ray.w, 1.0).length();
        let (_, own) = self.in_frame(point);
        let foci = [stable / square, constant / stable].map(|z| (z - own) * per_depth);
        (discriminant / (linear * linear), foci)
    }

    fn in_frame(&self, place: DVec3) -> (DVec2, f64) {
        let offset = place - self.middle;
        (DVec2::from(self.across.map(|side| offset.dot(side))), offset.dot(self.axis))
    }

    /// The place, the error and its slopes, of a point's root, if Newton's method finds one in the square.
    fn solve(&self, q: DVec3) -> Option<(DVec2, DVec2, DVec2)> {
        let (aim, z) = self.in_frame(q);
        if z < self.depths[0] || z > self.depths[1] {
            return None;
        }
        let limit = 1.0 + BORDER / self.half;
        let mut p = DVec2::ZERO;
        for step in 0..6 {
            let [value, by_x, by_y] = self.at(p).map(|ray| ray.truncate().truncate() + z * DVec2::new(ray.z, ray.w));
            let moved = solved(by_x, by_y, value - aim);
            p -= moved;
            let is_outside = p.abs().max_element() > limit;
            if moved.abs().element_sum() < 0.01 && !is_outside {
                return Some((p, by_x, by_y));
            }
            if is_outside && step > 0 || !p.is_finite() {
                return None;
            }
            p = p.clamp(DVec2::splat(-2.5), DVec2::splat(2.5));
        }
        None
    }
}

impl<'a> Bundles<'a> {
    pub fn new(picture: &'a MirrorPicture, settings: &'a Parameters, scene: Bounds, scene_radius: f64) -> Self {
        let power = |number: u32| 1 << number.ilog2();
        let stride: u32 = power(settings.down_sampling.max(1));
        let least = power(settings.least_square).max(2 * stride);
        let largest = power(settings.largest_square).max(least);
        let mut bundles = Self { picture, settings, scene, scene_radius, leaves: Vec::new() };
        for y in (0..picture.size.y).step_by(largest as usize) {
            for x in (0..picture.size.x).step_by(largest as usize) {
                bundles.divide(UVec2::new(x, y), largest, least, stride);
            }
        }
        bundles
    }

    fn divide(&mut self, corner: UVec2, edge: u32, least: u32, stride: u32) {
        let rays = self.rays(corner, edge, stride);
        if !rays.iter().any(|ray| ray.is_inside) {
            return;
        }
        let leaf = self.fit(&rays, corner, edge);
        if leaf.as_ref().is_some_and(|leaf| leaf.is_exact) || edge == least {
            self.leaves.extend(leaf);
            return;
        }
        let half = edge / 2;
        for part in 0..4 {
            self.divide(corner + UVec2::new(part & 1, part >> 1) * half, half, least, stride);
        }
    }

    fn rays(&self, corner: UVec2, edge: u32, stride: u32) -> Vec<Ray> {
        let count = (edge / stride) as i32;
        let (size, half) = (self.picture.size.as_ivec2(), f64::from(edge) * 0.5);
        let mut rays = Vec::new();
        for (y, x) in (-1..=count).flat_map(|y| (-1..=count).map(move |x| (y, x))) {
            let pixel = corner.as_ivec2() + glam::IVec2::new(x, y) * stride as i32 + (stride / 2) as i32;
            if pixel.min_element() < 0 || pixel.x >= size.x || pixel.y >= size.y {
                continue;
            }
            let Some((point, _, direction)) = self.pixel(pixel.as_uvec2()) else { continue };
            let is_inside = (0..count).contains(&x) && (0..count).contains(&y);
            let place = (pixel.as_dvec2() + 0.5 - corner.as_dvec2() - half) / half;
            rays.push(Ray { is_inside, place, point, direction });
        }
        rays
    }

    /// Mirror point, normal and reflected direction of a pixel.
    fn pixel(&self, pixel: UVec2) -> Option<(DVec3, DVec3, DVec3)> {
        let pixel = self.picture.pixels[(pixel.y * self.picture.size.x + pixel.x) as usize]?;
        let (point, normal) = (pixel.point.as_dvec3(), pixel.normal.as_dvec3());
        let incoming = -pixel.toward_eye.as_dvec3();
        Some((point, normal, (incoming - 2.0 * normal * normal.dot(incoming)).normalize()))
    }

    fn leaves_scene(&self, point: DVec3, direction: DVec3) -> f64 {
        let side = DVec3::select(direction.cmpgt(DVec3::ZERO), self.scene.max, self.scene.min);
        ((side - point) / direction).min_element().max(0.0)
    }

    fn fit(&self, rays: &[Ray], corner: UVec2, edge: u32) -> Option<Leaf> {
        let count = rays.len() as f64;
        let mean = rays.iter().map(|ray| ray.direction).sum::<DVec3>() / count;
        let axis = mean.normalize_or_zero();
        let half = f64::from(edge) * 0.5;
        let mut leaf = Leaf {
            is_exact: false,
            middle: rays.iter().map(|ray| ray.point).sum::<DVec3>() / count,
            axis,
            across: across_axis(axis),
            depths: [f64::INFINITY, 0.0],
            center: corner.as_dvec2() + half,
            half,
            factors: [DVec4::ZERO; 10],
        };
        if mean.length() < LEAST_MEAN || rays.iter().any(|ray| ray.direction.dot(axis) < LEAST_ALONG) {
            return None;
        }
        let terms = ((self.settings.degree + 1) * (self.settings.degree + 2) / 2) as usize;
        let (mut matrix, mut right) = ([[0.0; 10]; 10], [DVec4::ZERO; 10]);
        let near = f64::from(self.settings.near) * self.scene_radius;
        let mut samples = Vec::new();
        for ray in rays {
            let truth = self.in_frame(&leaf, ray.point, ray.direction);
            let (z, along) = ((ray.point - leaf.middle).dot(axis), ray.direction.dot(axis));
            let leaves = self.leaves_scene(ray.point, ray.direction);
            let ends = [z + near.min(leaves) * along, z + leaves * along];
            leaf.depths = [leaf.depths[0].min(ends[0]), leaf.depths[1].max(ends[1])];
            let here = terms_at(ray.place);
            for row in 0..terms {
                (0..=row).for_each(|column| matrix[row][column] += here[row] * here[column]);
                right[row] += here[row] * truth;
            }
            samples.push((ray.place, truth, ends));
        }
        for (term, row) in matrix.iter_mut().enumerate() {
            let degree = [0, 1, 1, 2, 2, 2, 3, 3, 3, 3][term];
            row[term] += [0.0, 1e-6, 1e-5, 1e-4][degree] * count;
        }
        cholesky(&mut matrix, &mut right, terms).then_some(())?;
        let f = |term: usize| right[term];
        leaf.factors = [
            f(0) - 0.5 * (f(3) + f(5)),
            f(1) - 1.5 * f(6) - 0.5 * f(8),
            f(2) - 0.5 * f(7) - 1.5 * f(9),
            1.5 * f(3),
            f(4),
            1.5 * f(5),
            2.5 * f(6),
            1.5 * f(7),
            1.5 * f(8),
            2.5 * f(9),
        ];
        let error = |(place, truth, ends): &(DVec2, DVec4, [f64; 2])| self.error_of(&leaf, *place, *truth, *ends);
        let error = samples.iter().map(error).fold(0.0, f64::max) * half;
        leaf.is_exact = error <= f64::from(self.settings.accuracy);
        leaf.depths[1] = leaf.depths[1] * 1.02 + 1e-3 * self.scene_radius;
        Some(leaf)
    }

    fn in_frame(&self, leaf: &Leaf, point: DVec3, direction: DVec3) -> DVec4 {
        let (at, z) = leaf.in_frame(point);
        let slope = DVec2::from(leaf.across.map(|side| direction.dot(side))) / direction.dot(leaf.axis);
        let foot = at - z * slope;
        DVec4::new(foot.x, foot.y, slope.x, slope.y)
    }

    fn error_of(&self, leaf: &Leaf, place: DVec2, truth: DVec4, [first, last]: [f64; 2]) -> f64 {
        let [value, along_x, along_y] = leaf.at(place);
        let at = |ray: DVec4, z: f64| DVec2::new(ray.x, ray.y) + z * DVec2::new(ray.z, ray.w);
        let of_step = |step: i32| {
            let z = first + (last - first) * f64::from(step * step) / 9.0;
            let (beside, by_x, by_y) = (at(value - truth, z), at(along_x, z), at(along_y, z));
            match self.settings.judged_by {
                JudgedBy::Solve => solved(by_x, by_y, beside).length(),
                JudgedBy::Ray => beside.length() / by_x.length().max(by_y.length()),
            }
        };
        (0..4).map(of_step).map(|error| if error.is_finite() { error } else { f64::MAX }).fold(0.0, f64::max)
    }

    /// All places that reflect a point, whose disc has this radius.
    pub fn roots(&self, q: DVec3, radius: f64) -> Vec<Root> {
        let mut roots: Vec<Root> = Vec::new();
        for leaf in &self.leaves {
            let Some((p, by_x, by_y)) = leaf.solve(q) else { continue };
            let Some(root) = self.kept(leaf, q, radius, p, [by_x, by_y]) else { continue };
            if roots.iter().all(|other| other.at.distance(root.at) > SAME_ROOT) {
                roots.push(root);
            }
        }
        roots
    }

    fn kept(&self, leaf: &Leaf, q: DVec3, radius: f64, p: DVec2, [by_x, by_y]: [DVec2; 2]) -> Option<Root> {
        let (aim, z) = leaf.in_frame(q);
        let mut at = leaf.center + p * leaf.half;
        for step in 0..=self.settings.polish {
            let pixel = at.floor();
            if pixel.min_element() < 0.0 || pixel.cmpge(self.picture.size.as_dvec2()).any() {
                return None;
            }
            let (point, normal, direction) = self.pixel(pixel.as_uvec2())?;
            let reach = (q - point).length();
            if (q - point).dot(normal) <= 0.0 || reach <= OWN_SURFACE_RADII * radius {
                return None;
            }
            if direction.dot(leaf.axis) <= LEAST_ALONG {
                return None;
            }
            let ray = self.in_frame(leaf, point, direction);
            let aside = (pixel + 0.5 - at) / leaf.half;
            let beside =
                DVec2::new(ray.x, ray.y) + z * DVec2::new(ray.z, ray.w) - aim - aside.x * by_x - aside.y * by_y;
            let back = solved(by_x, by_y, beside) * leaf.half;
            if step < self.settings.polish {
                at -= back.clamp(DVec2::splat(-2.0), DVec2::splat(2.0));
                continue;
            }
            let error = match self.settings.judged_by {
                JudgedBy::Solve => back.length(),
                JudgedBy::Ray => beside.length() / by_x.length().max(by_y.length()) * leaf.half,
            };
            let is_kept = leaf.is_exact || error <= f64::from(self.settings.accuracy);
            return is_kept.then_some(Root { at, reach });
        }
        None
    }
}

/// Solves the normal equations in place; false if they have no solution.
fn cholesky(matrix: &mut [[f64; 10]; 10], right: &mut [DVec4; 10], terms: usize) -> bool {
    for column in 0..terms {
        let squares: f64 = (0..column).map(|k| matrix[column][k] * matrix[column][k]).sum();
        let diagonal = matrix[column][column] - squares;
        if diagonal <= 0.0 {
            return false;
        }
        matrix[column][column] = diagonal.sqrt();
        for row in column + 1..terms {
            let products: f64 = (0..column).map(|k| matrix[row][k] * matrix[column][k]).sum();
            matrix[row][column] = (matrix[row][column] - products) / matrix[column][column];
        }
    }
    for row in 0..terms {
        let known: DVec4 = (0..row).map(|k| matrix[row][k] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    for row in (0..terms).rev() {
        let known: DVec4 = (row + 1..terms).map(|k| matrix[k][row] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    true
}
