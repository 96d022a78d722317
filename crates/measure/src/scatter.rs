//! How certain a place on a scan is, and what follows from it for a figure.

use cloud::{HalfWidths, half_widths};
use glam::{DMat3, DVec3};

use crate::fit::plane;

/// The number of neighbours that show how far a point is off the surface.
const NEAREST: usize = 16;
/// A normal distribution holds 95 % within this many standard deviations of its mean.
pub const IN_95_PERCENT: f64 = 1.959_964;
/// The variance, in each direction along a surface, of the way from a place to the nearest point, as a share of the area
/// of a point. On a square lattice it is 1/12 and for points at random 1/(2 pi); this holds for scans of one to four
/// stations.
pub(crate) const SNAPPED: f64 = 1.0 / 8.0;

/// How the points around a place scatter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// The distance between neighbouring points.
    pub spacing: f64,
    /// The standard deviation of points from the plane through them.
    pub noise: f64,
    /// The normal of the plane through the place and its nearest points, as of a disc there.
    pub normal: DVec3,
    /// The half widths of intervals of 95 % along that normal.
    pub half_widths: HalfWidths,
}

impl Scatter {
    /// From the points nearest to a place; `None` if they are too few, have no plane or lie elsewhere: those around the
    /// place may be hidden.
    pub fn around(place: DVec3, nearest: &[DVec3]) -> Option<Self> {
        let plane = plane(nearest).ok()?;
        let distances = || nearest.iter().map(|point| point.distance(place));
        let radius = distances().fold(0.0, f64::max);
        // Points that lie evenly around the place have a quarter of them within half of the radius.
        if distances().all(|distance| distance > radius * 0.5) {
            return None;
        }
        // Each point has a share of the disc that they cover.
        let spacing = radius * (std::f64::consts::PI / nearest.len() as f64).sqrt();
        let others = nearest.iter().filter(|point| **point != place);
        let mut others: Vec<DVec3> = others.map(|point| point - place).collect();
        others.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        others.truncate(NEAREST);
        let disc: Vec<DVec3> = others.iter().copied().chain([DVec3::ZERO]).collect();
        let normal = crate::fit::plane(&disc).map_or(plane.normal, |disc| disc.normal);
        Some(Self { spacing, noise: plane.noise(), normal, half_widths: half_widths(&others, normal) })
    }

    /// The covariance of a place that a person chose on the surface: the error of the point across it; along it, how
    /// far the nearest point is from the place that is meant.
    pub fn covariance(&self) -> DMat3 {
        let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        let across = outer(self.normal);
        across * (self.half_widths.point / IN_95_PERCENT).powi(2)
            + (DMat3::IDENTITY - across) * (self.spacing * self.spacing * SNAPPED)
    }
}

/// The standard deviation of a figure of places that deviate from where they are, independently of one another, with
/// these covariances. The figure counts as linear within their reach.
pub fn spread(figure: impl Fn(&[DVec3]) -> f64, places: &[DVec3], covariances: &[DMat3]) -> f64 {
    let mut moved = places.to_vec();
    let mut variance = 0.0;
    for (index, covariance) in covariances.iter().enumerate().take(places.len()) {
        let reach = (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt();
        if reach == 0.0 {
            continue;
        }
        let slope = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let mut at = |place: DVec3| {
                moved[index] = place;
                figure(&moved)
            };
            (at(places[index] + axis * reach) - at(places[index] - axis * reach)) / (2.0 * reach)
        });
        moved[index] = places[index];
        let slope = DVec3::from(slope);
        variance += slope.dot(*covariance * slope);
    }
    variance.sqrt()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Chunk, Orientation, Progress, SurfelOptions, estimate, surface_errors};
    use glam::Vec3;

    use super::*;
    use crate::figures::{angle, area, height, length};
    use crate::fit::tests::{Dice, wall};

    #[test]
    fn the_scatter_of_a_noisy_wall_is_its_spacing_and_noise() {
        let mut dice = Dice::new(5);
        let (axis, points) = wall(&mut dice, 40_000, 2.0, 0.003);
        let place = points[0];
        let mut nearest = points;
        nearest.sort_by(|a, b| a.distance(place).total_cmp(&b.distance(place)));
        let scatter = Scatter::around(place, &nearest[..400]).unwrap();
        // 40,000 points on 4 square metres.
        assert!((scatter.spacing / 0.01 - 1.0).abs() < 0.1, "{scatter:?}");
        assert!((scatter.noise / 0.003 - 1.0).abs() < 0.1, "{scatter:?}");
        assert!(scatter.normal.dot(axis).abs() > 0.99);
        assert_eq!(Scatter::around(place, &nearest[..3]), None);
        // Nothing is known of a place whose surroundings are hidden, whatever the wall beyond them is like.
        let beyond: Vec<DVec3> = nearest.iter().filter(|point| point.distance(place) > 0.5).take(24).copied().collect();
        assert_eq!(Scatter::around(place, &beyond), None);
    }

    #[test]
    fn the_half_widths_of_a_place_are_those_of_the_disc_there() {
        let mut dice = Dice::new(6);
        let (_, points) = wall(&mut dice, 4000, 2.0, 0.003);
        let origin = points[0];
        let positions = points.iter().map(|point| (point - origin).as_vec3().to_array()).collect();
        let mut chunk = Chunk::new(0, origin, positions);
        let options = SurfelOptions::new(Orientation::Up(Vec3::Z));
        let surfels = estimate(std::slice::from_ref(&chunk), &options, &Progress::default()).unwrap().remove(0);
        chunk.normals = Some(Arc::new(surfels.normals));
        let errors = surface_errors(&[chunk], &Progress::default()).unwrap().remove(0);
        let mut off = Vec::new();
        for (place, error) in points.iter().zip(errors).step_by(97) {
            let mut nearest = points.clone();
            nearest.sort_by(|a, b| a.distance(*place).total_cmp(&b.distance(*place)));
            let scatter = Scatter::around(*place, &nearest[..24]).unwrap();
            off.push((scatter.half_widths.further / f64::from(error) - 1.0).abs());
            let across = spread(|places| places[0].dot(scatter.normal), &[*place], &[scatter.covariance()]);
            assert!((IN_95_PERCENT * across / scatter.half_widths.point - 1.0).abs() < 1e-6, "{scatter:?}");
        }
        off.sort_by(f64::total_cmp);
        // A normal of the disc that is packed, or that of a row, moves some of them by a little.
        assert!(off[off.len() * 9 / 10] < 0.05, "{off:?}");
    }

    #[test]
    fn spreads_are_those_of_error_propagation_by_hand() {
        let still = DMat3::ZERO;
        let round = |noise: f64| DMat3::from_diagonal(DVec3::splat(noise * noise));
        let base = DVec3::new(5e6, 6e5, 100.0);
        let ends = [base, base + DVec3::new(3.0, 4.0, 0.0)];
        let distance = spread(length, &ends, &[round(0.03), round(0.04)]);
        assert!((distance - 0.05).abs() < 1e-5, "{distance}");
        let level = spread(|corners| height(corners, DVec3::Z), &ends, &[still, round(0.02)]);
        assert!((level - 0.02).abs() < 1e-9);
        // Noise across a distance does not change it.
        let across = DMat3::from_diagonal(DVec3::new(0.0, 0.0, 1e-4));
        assert!(spread(length, &ends, &[across, across]) < 1e-6);
        // A right angle between legs of 3 and 4: each end turns it by its noise over its leg.
        let corners = [base + DVec3::X * 3.0, base, base + DVec3::Y * 4.0];
        let turn = spread(|c| angle(c[0], c[1], c[2]), &corners, &[round(0.03), still, round(0.04)]);
        assert!((turn - 0.01 * 2.0_f64.sqrt()).abs() < 1e-5, "{turn}");
        // A corner of a square of edge 2 moves half of its diagonal: dA = 0.5 * sqrt(8) * noise.
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y].map(|corner| base + corner * 2.0);
        let areas = spread(area, &square, &[round(0.01), still, still, still]);
        assert!((areas - 0.5 * 8.0_f64.sqrt() * 0.01).abs() < 1e-5, "{areas}");
    }
}
