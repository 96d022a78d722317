//! Axis-aligned boxes in world coordinates.

use glam::DVec3;

/// An axis-aligned box in f64 world units. It is empty when any `min` exceeds its `max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    /// The box that contains nothing and is neutral in a union.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Grows the box to contain `point`; a point that is not finite is ignored.
    pub fn include(&mut self, point: DVec3) {
        if point.is_finite() {
            self.min = self.min.min(point);
            self.max = self.max.max(point);
        }
    }

    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all())
    }

    pub fn center(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Edge lengths; zero for an empty box.
    pub fn size(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.max - self.min }
    }

    /// Half the diagonal: the radius of the sphere about `center` that holds the box.
    pub fn radius(&self) -> f64 {
        self.size().length() * 0.5
    }

    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            DVec3::new(
                if i & 1 == 0 { self.min.x } else { self.max.x },
                if i & 2 == 0 { self.min.y } else { self.max.y },
                if i & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_bounds_are_neutral_in_a_union() {
        let unit = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        assert_eq!(Bounds::EMPTY.union(unit), unit);
        assert!(Bounds::EMPTY.is_empty());
        assert_eq!(Bounds::EMPTY.size(), DVec3::ZERO);
    }

    #[test]
    fn points_that_are_not_finite_do_not_grow_bounds() {
        let mut bounds = Bounds::EMPTY;
        bounds.include(DVec3::new(1.0, 2.0, 3.0));
        bounds.include(DVec3::new(f64::NAN, 0.0, 0.0));
        bounds.include(DVec3::new(0.0, f64::INFINITY, 0.0));
        assert_eq!(bounds, Bounds { min: DVec3::new(1.0, 2.0, 3.0), max: DVec3::new(1.0, 2.0, 3.0) });
    }
}
