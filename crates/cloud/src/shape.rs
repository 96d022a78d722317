//! The shape of the neighbours of a point: how flat, how long and how much on one side they are.

use glam::{DMat3, DVec3, Vec3};

use crate::neighbours::Neighbourhood;

/// A point whose neighbours are spread by less than this is stray: it is further away from them than 1.7 times the radius
/// of the disc that they fill. On a straight border they are spread by 0.80, in a corner by 0.53.
const STRAY_SPREAD: f32 = 0.5;
/// Fewer neighbours than this lie on one side by chance.
const FEWEST_AROUND: f32 = 8.0;
/// Neighbourhoods narrower than this times their length (in variance: squared) are in a line, or in rows: beside a
/// straight border it is 0.28.
const NARROW_VARIANCE: f64 = 0.15;
/// Neighbourhoods narrower than this times their length (in variance: squared) are lines, which have no normal; below
/// it f32 rounding of the covariance would turn the normal by a degree.
const THINNEST: f64 = 1e-5;

/// The shape of a point and its neighbours, in units of the distance to the last of them, so that nothing under- or
/// overflows.
pub(crate) struct Shape {
    covariance: DMat3,
    /// Of the covariance; none for a place, a ball and numbers that are not finite.
    eigenvalues: Option<Eigenvalues>,
    /// How far the neighbours are spread about their own middle: the root of twice the trace of their covariance, which
    /// is 1 for an even disc about the point.
    pub spread: f32,
    /// The number of neighbours.
    neighbours: f32,
}

impl Shape {
    pub(crate) fn of(neighbourhood: &Neighbourhood) -> Option<Self> {
        if neighbourhood.count < 2 {
            return None;
        }
        let scale = neighbourhood.distance_squared.sqrt().recip();
        let (mut members, mut sum, mut diagonal, mut mixed) = (1.0_f32, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for offset in neighbourhood.offsets() {
            let offset = offset * scale;
            members += 1.0;
            sum += offset;
            diagonal += offset * offset;
            mixed += Vec3::new(offset.y * offset.z, offset.z * offset.x, offset.x * offset.y);
        }
        let neighbours = members - 1.0;
        let squares = diagonal.element_sum() / neighbours - (sum / neighbours).length_squared();
        let mean = sum / members;
        let diagonal = (diagonal / members - mean * mean).as_dvec3();
        let mixed = (mixed / members - Vec3::new(mean.y * mean.z, mean.z * mean.x, mean.x * mean.y)).as_dvec3();
        let covariance = DMat3::from_cols(
            DVec3::new(diagonal.x, mixed.z, mixed.y),
            DVec3::new(mixed.z, diagonal.y, mixed.x),
            DVec3::new(mixed.y, mixed.x, diagonal.z),
        );
        let eigenvalues = Eigenvalues::of(covariance);
        Some(Self { covariance, eigenvalues, spread: (2.0 * squares).max(0.0).sqrt(), neighbours })
    }

    /// The direction in which the points are thinnest; its sign is arbitrary.
    pub(crate) fn normal(&self) -> Option<Vec3> {
        self.eigenvalues.as_ref()?.smallest_eigenvector(self.covariance).map(|normal| normal.as_vec3())
    }

    /// Whether the points lie in more than one direction.
    pub(crate) fn is_wide(&self) -> bool {
        self.eigenvalues.as_ref().is_none_or(|values| values.middle >= NARROW_VARIANCE * values.largest)
    }

    /// The unit direction of the line in which the points lie; `None` where they are wide.
    pub(crate) fn line(&self) -> Option<Vec3> {
        let values = self.eigenvalues.as_ref().filter(|_| !self.is_wide())?;
        let shifted = self.covariance - DMat3::from_diagonal(DVec3::splat(values.largest));
        longest_cross_product(shifted).map(|line| line.as_vec3())
    }

    /// Whether the point is far from all of its neighbours, and so on no surface.
    pub(crate) fn is_stray(&self) -> bool {
        self.neighbours >= FEWEST_AROUND && self.spread < STRAY_SPREAD
    }

    /// The variance of the points in the direction in which they are thinnest.
    pub(crate) fn thinnest(&self) -> f64 {
        self.eigenvalues.as_ref().map_or(0.0, |values| values.smallest.max(0.0))
    }

    /// How thick the points are relative to their width: 0 for a surface, 1 for a ball.
    pub(crate) fn roughness(&self) -> f32 {
        self.eigenvalues.as_ref().map_or(1.0, Eigenvalues::roughness)
    }
}

/// How thick points with this covariance are relative to their width: 0 for a surface, 1 for a ball.
pub(crate) fn thickness(covariance: DMat3) -> f32 {
    Eigenvalues::of(covariance).map_or(1.0, |values| values.roughness())
}

/// The eigenvalues of a covariance. They have a closed form (Smith 1961); it is in f64 because two nearly equal ones
/// lose half the digits.
struct Eigenvalues {
    smallest: f64,
    middle: f64,
    largest: f64,
}

impl Eigenvalues {
    /// `None` where all are equal, or not finite.
    fn of(covariance: DMat3) -> Option<Self> {
        let mean = (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z) / 3.0;
        let centred = covariance - DMat3::from_diagonal(DVec3::splat(mean));
        let squares =
            centred.x_axis.length_squared() + centred.y_axis.length_squared() + centred.z_axis.length_squared();
        let spread = (squares / 6.0).sqrt();
        if !(spread > 0.0 && spread.is_finite()) {
            return None;
        }
        let angle = ((centred * (1.0 / spread)).determinant() / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
        let largest = mean + 2.0 * spread * angle.cos();
        let smallest = mean + 2.0 * spread * (angle + std::f64::consts::TAU / 3.0).cos();
        Some(Self { smallest, middle: 3.0 * mean - largest - smallest, largest })
    }

    /// How thick the points are relative to their width.
    fn roughness(&self) -> f32 {
        (2.0 * self.smallest.max(0.0) / (self.middle + self.largest)).sqrt() as f32
    }

    /// The unit eigenvector of the smallest one, if the two smaller ones differ and the points are not on a line.
    fn smallest_eigenvector(&self, covariance: DMat3) -> Option<DVec3> {
        if self.middle <= THINNEST * self.largest {
            return None;
        }
        longest_cross_product(covariance - DMat3::from_diagonal(DVec3::splat(self.smallest)))
    }
}

/// The unit eigenvector of an eigenvalue that was taken off a symmetric matrix. The rows of what is left span the other
/// two eigenvectors; the longest of their cross products is the exact one.
fn longest_cross_product(shifted: DMat3) -> Option<DVec3> {
    let [x, y, z] = [shifted.x_axis, shifted.y_axis, shifted.z_axis];
    let crosses = [x.cross(y), y.cross(z), z.cross(x)];
    let longest = crosses.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
    longest.try_normalize()
}

/// The direction in which points with this covariance are thinnest, as a unit vector whose sign is arbitrary. `None` if
/// the points are on a line, or even in all directions.
pub fn smallest_eigenvector(covariance: DMat3) -> Option<DVec3> {
    Eigenvalues::of(covariance)?.smallest_eigenvector(covariance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smallest_eigenvector_of_known_matrices() {
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
        for eigenvalues in [[1.0, 0.5, 0.0], [1.0, 1.0, 1e-9], [1.0, 1e-3, 1e-6], [4e-20, 3e-20, 1e-20]] {
            let covariance = rotation * DMat3::from_diagonal(DVec3::from(eigenvalues)) * rotation.transpose();
            let normal = smallest_eigenvector(covariance).unwrap();
            let angle = normal.dot(rotation.z_axis).abs().min(1.0).acos().to_degrees();
            assert!(angle < 0.05, "{eigenvalues:?}: {angle} degrees off");
        }
    }

    #[test]
    fn lines_and_balls_have_no_smallest_eigenvector() {
        for eigenvalues in [[1.0, 0.0, 0.0], [1.0, 1e-7, 1e-9], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [f64::NAN, 1.0, 1.0]]
        {
            assert_eq!(smallest_eigenvector(DMat3::from_diagonal(DVec3::from(eigenvalues))), None, "{eigenvalues:?}");
        }
    }
}
