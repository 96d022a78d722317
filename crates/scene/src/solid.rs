//! Solids that rays meet by closed forms: what the made scans of `tripod` are scans of.

use glam::DVec3;

/// A solid body, or the inner side of one, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    pub form: Form,
    /// The linear albedo of its light squares; the dark ones have a part of it.
    pub albedo: [f64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A box along the axes, seen from outside.
    Block { low: DVec3, high: DVec3 },
    /// The outer side of an upright cylinder without its ends. `middle` is the middle of its lower end.
    Column { middle: DVec3, radius: f64, height: f64 },
    /// The inner side of the upper half of a cylinder along the x axis. `start` is the end of its axis where x is least.
    Vault { start: DVec3, radius: f64, length: f64 },
}

/// Where a ray meets a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidHit {
    /// The distance from the ray's origin in world units.
    pub distance: f64,
    /// The unit normal on the side from which the ray comes.
    pub normal: DVec3,
    /// The index of the solid.
    pub solid: usize,
}

/// The width of the squares on all solids, and the share of the albedo that the dark ones have.
const SQUARE: f64 = 0.25;
const DARK: f64 = 0.15;
/// Squares begin a little before the planes of the solids, which rounding would give to either side.
const SQUARE_START: f64 = 1e-4;
/// The least distance of a hit from the origin of its ray, far above rounding.
const CLEARANCE: f64 = 1e-9;

impl Solid {
    pub fn block(low: [f64; 3], high: [f64; 3], albedo: [f64; 3]) -> Self {
        Self { form: Form::Block { low: low.into(), high: high.into() }, albedo }
    }

    /// The linear albedo at a place on its surface.
    pub fn albedo_at(&self, place: DVec3) -> [f64; 3] {
        let squares = (place / SQUARE + DVec3::splat(SQUARE_START)).floor();
        let is_dark = squares.element_sum().rem_euclid(2.0) == 1.0;
        self.albedo.map(|value| if is_dark { DARK * value } else { value })
    }

    /// The distance at which a ray in the direction of a unit vector meets it first, and the normal there.
    fn nearest(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        match self.form {
            Form::Block { low, high } => block(low - origin, high - origin, direction),
            Form::Column { middle, radius, height } => {
                let from = origin - middle;
                let [near, _] = across(from.x, from.y, direction.x, direction.y, radius)?;
                let at = from + direction * near;
                let normal = DVec3::new(at.x, at.y, 0.0) / radius;
                (near > CLEARANCE && (0.0..=height).contains(&at.z)).then_some((near, normal))
            }
            Form::Vault { start, radius, length } => {
                let from = origin - start;
                let [_, far] = across(from.y, from.z, direction.y, direction.z, radius)?;
                let at = from + direction * far;
                let normal = -DVec3::new(0.0, at.y, at.z) / radius;
                (far > CLEARANCE && at.z >= 0.0 && (0.0..=length).contains(&at.x)).then_some((far, normal))
            }
        }
    }
}

/// The first hit of a ray in the direction of a unit vector with any of these solids.
pub fn nearest(solids: &[Solid], origin: DVec3, direction: DVec3) -> Option<SolidHit> {
    let hit = |(solid, own): (usize, &Solid)| {
        let (distance, normal) = own.nearest(origin, direction)?;
        Some(SolidHit { distance, normal, solid })
    };
    solids.iter().enumerate().filter_map(hit).min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// Where a ray from the origin enters a box (the slabs of Kay and Kajiya 1986).
fn block(low: DVec3, high: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
    let (mut enter, mut leave, mut entered) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if low[axis] > 0.0 || high[axis] < 0.0 {
                return None;
            }
            continue;
        }
        let [one, other] = [low[axis] / direction[axis], high[axis] / direction[axis]];
        if one.min(other) > enter {
            (enter, entered) = (one.min(other), axis);
        }
        leave = leave.min(one.max(other));
    }
    let mut normal = DVec3::ZERO;
    normal[entered] = -direction[entered].signum();
    (enter < leave && enter > CLEARANCE).then_some((enter, normal))
}

/// Where the line through (x, y) along (dx, dy) crosses the circle about the origin: near and far.
fn across(x: f64, y: f64, dx: f64, dy: f64, radius: f64) -> Option<[f64; 2]> {
    let (a, b, c) = (dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius);
    let discriminant = b * b - a * c;
    (discriminant > 0.0 && a > 0.0).then(|| [-1.0, 1.0].map(|sign| (-b + sign * discriminant.sqrt()) / a))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: [f64; 3] = [0.5; 3];

    fn hit(form: Form, origin: [f64; 3], toward: [f64; 3]) -> Option<(f64, DVec3)> {
        Solid { form, albedo: GREY }.nearest(origin.into(), DVec3::from(toward).normalize())
    }

    #[test]
    fn rays_meet_solids_at_the_distances_of_geometry() {
        let block = Form::Block { low: DVec3::ONE, high: DVec3::splat(3.0) };
        assert_eq!(hit(block, [0.0, 2.0, 2.0], [1.0, 0.0, 0.0]), Some((1.0, DVec3::NEG_X)));
        assert_eq!(hit(block, [0.0, 4.0, 2.0], [1.0, 0.0, 0.0]), None);
        assert_eq!(hit(block, [2.0, 2.0, 5.0], [0.0, 0.0, -1.0]), Some((2.0, DVec3::Z)));
        assert_eq!(hit(block, [2.0, 2.0, 3.0], [0.0, 0.0, 1.0]), None, "a ray leaves the box that it starts on");
        let column = Form::Column { middle: DVec3::new(4.0, 0.0, 0.0), radius: 1.0, height: 2.0 };
        assert_eq!(hit(column, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]), Some((3.0, DVec3::NEG_X)));
        assert_eq!(hit(column, [0.0, 0.0, 2.5], [1.0, 0.0, 0.0]), None);
        // The side of 3, 4, 5: the vault is met 4 above its axis at 3 beside it.
        let vault = Form::Vault { start: DVec3::ZERO, radius: 5.0, length: 10.0 };
        let (distance, normal) = hit(vault, [5.0, 3.0, -1.0], [0.0, 0.0, 1.0]).unwrap();
        assert!((distance - 5.0).abs() < 1e-12 && normal.distance(DVec3::new(0.0, -0.6, -0.8)) < 1e-12);
        assert_eq!(hit(vault, [11.0, 3.0, -1.0], [0.0, 0.0, 1.0]), None);
        let solids = [block, column].map(|form| Solid { form, albedo: GREY });
        assert_eq!(nearest(&solids, DVec3::new(0.0, 0.0, 1.0), DVec3::X).unwrap().solid, 1);
    }
}
