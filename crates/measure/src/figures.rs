//! Figures of corners: they have closed forms and need no cloud.

use glam::DVec3;

use crate::fit::plane;

/// The length of a line through corners.
pub fn length(corners: &[DVec3]) -> f64 {
    corners.windows(2).map(|ends| ends[0].distance(ends[1])).sum()
}

/// How much higher the last corner is than the first; `up` is a unit vector.
pub fn height(corners: &[DVec3], up: DVec3) -> f64 {
    let ends = corners.first().zip(corners.last());
    ends.map_or(0.0, |(first, last)| (*last - *first).dot(up))
}

/// The angle at `corner` between the directions to two ends, in radians.
pub fn angle(from: DVec3, corner: DVec3, to: DVec3) -> f64 {
    let (a, b) = (from - corner, to - corner);
    // The arc tangent keeps its digits where the cosine is flat.
    a.cross(b).length().atan2(a.dot(b))
}

/// The area of a polygon, each side once: that of its picture on the plane on which the picture is largest. Where the
/// polygon crosses itself, parts that it goes around in opposite directions cancel out.
pub fn area(corners: &[DVec3]) -> f64 {
    vector_area(corners).length()
}

/// Whether two sides of a polygon cross, as seen across the plane through its corners.
pub fn crosses_itself(corners: &[DVec3]) -> bool {
    plane(corners).is_ok_and(|plane| sides_cross(corners, plane.normal))
}

/// Whether two sides of a polygon cross, as seen along a unit vector.
pub(crate) fn sides_cross(corners: &[DVec3], along: DVec3) -> bool {
    let side = |a: usize| [corners[a], corners[(a + 1) % corners.len()]];
    // On which side of a line a point is.
    let turn = |[from, to]: [DVec3; 2], point: DVec3| (to - from).cross(point - from).dot(along);
    let parts = |line: [DVec3; 2], other: [DVec3; 2]| turn(line, other[0]) * turn(line, other[1]) < 0.0;
    let cross = |a: usize, b: usize| parts(side(a), side(b)) && parts(side(b), side(a));
    (0..corners.len()).any(|a| (a + 2..corners.len()).any(|b| cross(a, b)))
}

/// Half of the sum of the cross products of neighbouring corners, relative to the first, so that large coordinates lose
/// no digits.
pub(crate) fn vector_area(corners: &[DVec3]) -> DVec3 {
    let Some(first) = corners.first() else { return DVec3::ZERO };
    corners.windows(2).map(|ends| (ends[0] - *first).cross(ends[1] - *first)).sum::<DVec3>() * 0.5
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::DQuat;

    use super::*;

    #[test]
    fn a_regular_polygon_has_the_length_area_and_angles_of_its_formulas() {
        let (place, turn) =
            (DVec3::new(635_000.0, 5_077_000.0, 120.0), DQuat::from_axis_angle(DVec3::ONE.normalize(), 0.4));
        for sides in [3_u32, 4, 6, 97] {
            let (count, radius) = (f64::from(sides), 2.5);
            let corner = |index: u32| {
                let (sine, cosine) = (f64::from(index) / count * 2.0 * PI).sin_cos();
                place + turn * DVec3::new(cosine, sine, 0.0) * radius
            };
            let corners: Vec<DVec3> = (0..sides).map(corner).collect();
            let side = 2.0 * radius * (PI / count).sin();
            assert!((length(&corners) - side * (count - 1.0)).abs() < 1e-8);
            assert!((area(&corners) - 0.5 * count * radius * radius * (2.0 * PI / count).sin()).abs() < 1e-7);
            let inner = PI * (count - 2.0) / count;
            assert!((angle(corners[0], corners[1], corners[2]) - inner).abs() < 1e-8);
            assert!(!crosses_itself(&corners));
            let mut crossed = corners;
            crossed.swap(0, 1);
            assert_eq!(crosses_itself(&crossed), sides > 3, "two neighbours in the other order");
        }
    }

    #[test]
    fn heights_are_signed_and_angles_exact_where_they_are_flat() {
        let corners = [DVec3::new(0.0, 0.0, 3.0), DVec3::new(9.0, 9.0, 9.0), DVec3::new(4.0, 0.0, 1.5)];
        assert_eq!(height(&corners, DVec3::Z), -1.5);
        assert_eq!((height(&[], DVec3::Z), length(&[]), area(&[])), (0.0, 0.0, 0.0));
        let nearly = DVec3::new(-1.0, 1e-9, 0.0);
        assert!((angle(DVec3::X, DVec3::ZERO, nearly) - (PI - 1e-9)).abs() < 1e-15);
        assert_eq!(angle(DVec3::X, DVec3::ZERO, DVec3::Y * 7.0), PI / 2.0);
    }
}
