//! A pinhole for reflected rays (Popescu, Sacks and Mei 2006): the place that is nearest to all of them in the sense of
//! least squares, and two polynomials of the second degree from its picture to the mirror's pixels.
//!
//! The fit differs from the paper in three ways. The image plane lies across the mirrored line of sight, because a plane
//! fitted to the tails may hold the centre; parts of flat mirrors have an exact picture on it. Parallel rays have no centre: their picture is their place across the mean direction.
//! And the error counts all along a ray, not at its two ends alone, by a closed form.

use glam::{DMat3, DVec2, DVec3, DVec4};

use super::tree::{LEAST_ALONG, Ray};
use crate::layout::{CAMERA_PINHOLE, CameraLeaf};

/// Rays are parallel if the smallest eigenvalue of their normal equations is below this share of the largest.
const PARALLEL: f64 = 1e-6;
/// The least number of rays that determine six factors with some to spare.
pub const LEAST_RAYS: usize = 6;

/// A vector with a constant part.
type Row = DVec4;

#[derive(Clone, Debug)]
pub struct Pinhole {
    /// `None` if the rays are parallel.
    #[cfg(test)]
    pub center: Option<DVec3>,
    /// The middle of the tails, and the axis of the picture.
    middle: DVec3,
    axis: DVec3,
    /// The place (u, v) in the picture, from -1 to 1, of a point p beside the middle: with q = (p, 1), u is
    /// `across[0].q / depth.q`.
    across: [Row; 2],
    depth: Row,
    /// Pixels by the powers 1, u, v, uu, uv, vv.
    factors: [DVec2; 6],
    /// The largest error on the rays, pixels.
    pub error: f64,
}

/// The vectors across a direction that span its frame: `across_axis` of shaders/shared/bundle.wgsl.
pub fn across_axis(axis: DVec3) -> [DVec3; 2] {
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

/// The mean of unit vectors; `None` if they point anywhere.
pub fn mean_direction(rays: &[Ray], of: impl Fn(&Ray) -> DVec3) -> Option<DVec3> {
    /// A mean direction shorter than this is none.
    const LEAST_MEAN: f64 = 1e-6;
    let mean = rays.iter().map(of).sum::<DVec3>() / rays.len().max(1) as f64;
    (mean.length() > LEAST_MEAN).then(|| mean.normalize())
}

/// The axis of the picture of rays: the mirrored line of sight, or their mean direction where that is nearly across them.
fn picture_axis(rays: &[Ray]) -> Option<DVec3> {
    let goes_along = |axis: &DVec3| rays.iter().all(|ray| ray.direction.dot(*axis) >= LEAST_ALONG);
    let [sight, mean] = [mean_direction(rays, |ray| ray.sight), mean_direction(rays, |ray| ray.direction)];
    sight.filter(goes_along).or_else(|| mean.filter(goes_along))
}

/// The eigenvalues of a symmetric matrix, the least first (by the roots of its cubic as cosines).
fn eigenvalues(m: DMat3) -> [f64; 3] {
    let mean = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
    let rest = m - DMat3::from_diagonal(DVec3::splat(mean));
    let squares = [rest.x_axis, rest.y_axis, rest.z_axis].map(DVec3::length_squared).iter().sum::<f64>();
    let size = (squares / 6.0).sqrt();
    if size <= f64::MIN_POSITIVE {
        return [mean; 3];
    }
    let angle = ((rest * (1.0 / size)).determinant() * 0.5).clamp(-1.0, 1.0).acos() / 3.0;
    let third = std::f64::consts::TAU / 3.0;
    let largest = mean + 2.0 * size * angle.cos();
    let least = mean + 2.0 * size * (angle + third).cos();
    [least, 3.0 * mean - largest - least, largest]
}

/// The place nearest to all lines in the sense of least squares; `None` if they are parallel.
fn center_of(rays: &[Ray], middle: DVec3) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for ray in rays {
        let d = ray.direction;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        normal += across;
        right += across * (ray.tail - middle);
    }
    let [least, _, largest] = eigenvalues(normal);
    let center = (least > PARALLEL * largest).then(|| normal.inverse() * right)?;
    center.is_finite().then_some(middle + center)
}

fn powers([u, v]: [f64; 2]) -> [f64; 6] {
    [1.0, u, v, u * u, u * v, v * v]
}

/// Solves the normal equations of six powers by Cholesky's method; a trace of each diagonal keeps them regular where
/// the places do not determine all factors.
fn least_squares(mut matrix: [[f64; 6]; 6], mut right: [DVec2; 6]) -> Option<[DVec2; 6]> {
    const TRACE: f64 = 1e-12;
    let count = matrix[0][0];
    for column in 0..6 {
        let known: f64 = matrix[column][..column].iter().map(|value| value * value).sum();
        let diagonal = matrix[column][column] + TRACE * count - known;
        if diagonal.is_nan() || diagonal <= 0.0 {
            return None;
        }
        let root = diagonal.sqrt();
        matrix[column][column] = root;
        for row in column + 1..6 {
            let known: f64 = (0..column).map(|k| matrix[row][k] * matrix[column][k]).sum();
            matrix[row][column] = (matrix[row][column] - known) / root;
        }
    }
    for row in 0..6 {
        let known: DVec2 = (0..row).map(|k| matrix[row][k] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    for row in (0..6).rev() {
        let known: DVec2 = (row + 1..6).map(|k| matrix[k][row] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    Some(right)
}

impl Pinhole {
    /// Fits a pinhole to rays, of which the first `near` units of length do not count. `None` if there is none for them:
    /// too few rays, or they go apart too far, or meet between their tails and heads.
    pub fn fit(rays: &[Ray], near: f64) -> Option<Self> {
        /// The rays must be before the centre by more than this share of its distance.
        const LEAST_DEPTH: f64 = 1e-3;
        let axis = picture_axis(rays).filter(|_| rays.len() >= LEAST_RAYS)?;
        let middle = rays.iter().map(|ray| ray.tail).sum::<DVec3>() / rays.len() as f64;
        let center = center_of(rays, middle);
        // A centre in the image plane has no picture on it.
        let behind = center.map(|center| (middle - center, (middle - center).dot(axis)));
        let sides = across_axis(axis);
        let (depth, plain) = match behind {
            Some((from_center, distance)) => {
                if distance == 0.0 {
                    return None;
                }
                let plain = sides.map(|side| side.extend(from_center.dot(side)));
                ((axis / distance).extend(1.0), plain)
            }
            None => (DVec4::W, sides.map(|side| side.extend(0.0))),
        };
        let ends = |ray: &Ray| [ray.tail + ray.direction * near.min(ray.reach * 0.9), ray.head()];
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        let mut places = Vec::with_capacity(2 * rays.len());
        for point in rays.iter().flat_map(ends) {
            let q = (point - middle).extend(1.0);
            let far = depth.dot(q);
            if far.is_nan() || far <= LEAST_DEPTH {
                return None;
            }
            let place = DVec2::from(plain.map(|row| row.dot(q) / far));
            low = low.min(place);
            high = high.max(place);
            places.push(place);
        }
        let offset = (low + high) * 0.5;
        let scale = ((high - low) * 0.5).max(DVec2::splat(1e-300));
        // Over the depth, (row - offset depth) / scale is the place from -1 to 1, without the difference of large numbers.
        let across = [0, 1].map(|side| (plain[side] - depth * offset[side]) / scale[side]);
        let (mut matrix, mut right) = ([[0.0; 6]; 6], [DVec2::ZERO; 6]);
        for (place, ray) in places.iter_mut().zip(rays.iter().flat_map(|ray| [ray, ray])) {
            *place = (*place - offset) / scale;
            let terms = powers(place.to_array());
            for row in 0..6 {
                right[row] += terms[row] * ray.at;
                for column in 0..=row {
                    matrix[row][column] += terms[row] * terms[column];
                }
            }
        }
        let factors = least_squares(matrix, right)?;
        let mut fitted = Self {
            #[cfg(test)]
            center,
            middle,
            axis,
            across,
            depth,
            factors,
            error: 0.0,
        };
        fitted.error = places
            .chunks_exact(2)
            .zip(rays)
            .map(|(ends, ray)| fitted.error_along(ends[0], ends[1], ray.at))
            .fold(0.0, f64::max);
        fitted.error.is_finite().then_some(fitted)
    }

    /// The largest error between two places of one ray: the error is a polynomial of the second degree along it, and at a
    /// share l it is (1 - l) of that at the first and l of that at the last, less l (1 - l) of the quadratic part.
    fn error_along(&self, first: DVec2, last: DVec2, at: DVec2) -> f64 {
        let f = &self.factors;
        let step = last - first;
        let bend = step.x * step.x * f[3] + step.x * step.y * f[4] + step.y * step.y * f[5];
        let [first, last] = [first, last].map(|place| self.pixel(place).distance(at));
        first.max(last) + 0.25 * bend.length()
    }

    /// The pixel of a place of the picture.
    pub fn pixel(&self, place: DVec2) -> DVec2 {
        powers(place.to_array()).into_iter().zip(self.factors).map(|(power, factor)| power * factor).sum()
    }

    /// The place of a point in the picture; `None` if it is behind the centre.
    #[cfg(test)]
    pub fn place(&self, point: DVec3) -> Option<DVec2> {
        let q = (point - self.middle).extend(1.0);
        let depth = self.depth.dot(q);
        (depth > 0.0).then(|| DVec2::from(self.across.map(|row| row.dot(q) / depth)))
    }

    pub fn to_gpu(&self) -> CameraLeaf {
        let [one, u, v, uu, uv, vv] = self.factors.map(|factor| factor.as_vec2());
        let pair = |a: glam::Vec2, b: glam::Vec2| glam::Vec4::new(a.x, a.y, b.x, b.y);
        CameraLeaf {
            kind: CAMERA_PINHOLE,
            middle: self.middle.as_vec3().extend(0.0),
            axis: self.axis.as_vec3().extend(0.0),
            by_u: self.across[0].as_vec4(),
            by_v: self.across[1].as_vec4(),
            depth: self.depth.as_vec4(),
            factors_0: pair(one, u),
            factors_1: pair(v, uu),
            factors_2: pair(uv, vv),
            ..CameraLeaf::default()
        }
    }
}
