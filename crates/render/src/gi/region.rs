//! What the sky's lights see more finely than the scene.

use cloud::Bounds;
use glam::DVec3;
use scene::{Camera, Settings};

use crate::lighting::radius_seen;

/// The share of a region's radius up to which the finer maps alone count, as in shaders/indirect.wgsl.
const WHOLE_SHARE: f64 = 0.75;
/// The step of a region's middle along each axis as a share of its radius: regions stay the same over small moves.
const SNAP: f64 = 0.125;
/// The radius of a region over that of the next finer one about the same pivot.
const WIDER: f64 = 4.0;
/// Finer maps are drawn where a region's radius is at most this share of the scene's.
const FINER: f64 = 0.5;
/// A region's radius is at least this share of the scene's: the eye may be at the pivot.
const LEAST: f64 = 1.0 / 1024.0;

/// A ball in the world that finer maps show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Region {
    pub center: DVec3,
    pub radius: f64,
}

impl Region {
    /// The region about the camera's pivot that holds the eye and what the camera sees at the pivot's distance; `None` if
    /// maps of the scene, whose points have these `bounds`, are nearly as fine, or if the region lies beside the bounds.
    ///
    /// It does not depend on the direction of the view, so turning around the pivot keeps it.
    pub fn seen(camera: &Camera, settings: &Settings, size: [u32; 2], bounds: Bounds) -> Option<Self> {
        let seen = radius_seen(camera, settings, size).max(camera.distance());
        let least = (seen / (WHOLE_SHARE - SNAP * 3_f64.sqrt() / 2.0)).max(bounds.radius() * LEAST);
        let radius = 2_f64.powf(0.5 * (2.0 * least.log2()).ceil());
        let found = Self::about(camera.pivot, radius);
        let center = found.center;
        // The comparisons are false for NaN.
        let is_beside = || center.distance(center.clamp(bounds.min, bounds.max)) > radius;
        let is_small = radius <= bounds.radius() * FINER && center.is_finite();
        (!bounds.is_empty() && is_small && !is_beside()).then_some(found)
    }

    /// The region and wider ones about it, finest first, as long as maps of the scene, whose points have these `bounds`, are
    /// not nearly as fine. Each lies in the part of the next one in which that one's maps alone count.
    pub fn balls(self, bounds: Bounds) -> Vec<Self> {
        let wider = |finer: &Self| {
            let radius = finer.radius * WIDER;
            (radius <= bounds.radius() * FINER).then(|| Self::about(finer.center, radius))
        };
        std::iter::successors(Some(self), wider).collect()
    }

    fn about(place: DVec3, radius: f64) -> Self {
        let step = radius * SNAP;
        Self { center: (place / step).round() * step, radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOWN: Bounds = Bounds { min: DVec3::new(-500.0, -400.0, 0.0), max: DVec3::new(500.0, 400.0, 30.0) };

    fn region(pivot: DVec3, back: DVec3, distance: f64) -> Option<Region> {
        let camera = Camera::looking(pivot, back, distance, DVec3::Z);
        Region::seen(&camera, &Settings::default(), [800, 600], TOWN)
    }

    #[test]
    fn a_region_holds_the_eye_and_what_it_looks_at_and_is_only_made_where_it_is_small() {
        assert_eq!(region(DVec3::ZERO, DVec3::X, 300.0), None);
        for (step, distance) in [0.5, 2.0, 10.0, 70.0].into_iter().enumerate() {
            let pivot = DVec3::new(3.7, -8.1, 1.3) * step as f64;
            let camera = Camera::looking(pivot, DVec3::new(1.0, 2.0, 0.5), distance, DVec3::Z);
            let found = region(pivot, camera.eye - pivot, distance).unwrap();
            let seen = found.center.distance(pivot) + radius_seen(&camera, &Settings::default(), [800, 600]);
            assert!(found.center.distance(camera.eye).max(seen) <= found.radius * WHOLE_SHARE, "{found:?}");
            assert!(found.radius < distance * 2.5 && found.radius <= TOWN.radius() * FINER, "{found:?}");
        }
    }

    #[test]
    fn balls_of_regions_lie_in_one_another_up_to_half_of_the_scene() {
        for (distance, count) in [(0.0, 5), (3.0, 3), (10.0, 3), (70.0, 1)] {
            let balls = region(DVec3::new(3.7, -8.1, 1.3), DVec3::X, distance).unwrap().balls(TOWN);
            assert_eq!(balls.len(), count, "{balls:?}");
            assert!(balls.iter().all(|ball| ball.radius <= TOWN.radius() * FINER), "{balls:?}");
            for pair in balls.windows(2) {
                let reach = pair[0].center.distance(pair[1].center) + pair[0].radius;
                assert!(pair[1].radius == WIDER * pair[0].radius && reach <= pair[1].radius * WHOLE_SHARE, "{pair:?}");
            }
        }
    }

    #[test]
    fn an_eye_at_the_pivot_has_a_region_and_one_beside_all_points_has_none() {
        for distance in [0.0, 1e-300, 1e-9] {
            let found = region(DVec3::new(300.0, -20.0, 5.0), DVec3::X, distance).unwrap();
            assert!(found.radius >= TOWN.radius() * LEAST && found.radius < 2.0 * TOWN.radius() * LEAST, "{found:?}");
        }
        assert_eq!(region(DVec3::new(600.0, 0.0, 0.0), DVec3::X, 2.0), None);
        assert_eq!(region(DVec3::splat(f64::NAN), DVec3::X, 2.0), None);
        assert_eq!(region(DVec3::X * 1e300, DVec3::X, 2.0), None);
    }

    #[test]
    fn a_region_is_kept_while_the_camera_turns_and_moves_a_little() {
        let pivot = DVec3::new(3.0, 4.0, 1.0);
        let mut kept = 0;
        for step in 1..=50 {
            let turned = DVec3::new((0.1 * f64::from(step)).cos(), (0.1 * f64::from(step)).sin(), 0.3);
            assert_eq!(region(pivot, turned, 12.0), region(pivot, DVec3::X, 12.0));
            let moved = region(pivot + DVec3::new(0.05, 0.02, 0.0) * f64::from(step), DVec3::X, 12.0);
            kept += u32::from(moved == region(pivot, DVec3::X, 12.0));
        }
        assert!((5..50).contains(&kept), "{kept} of 50");
    }
}
