//! Where a cloud stands, if not where its file has it: turned about a point and moved, as a whole.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};

use crate::chunk::world_position;
use crate::{Bounds, Chunk, Grid, pack_normal, unpack_normal};

/// Turns points about a point, then moves them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    turn: DMat3,
    about: DVec3,
    shift: DVec3,
}

impl Placement {
    /// `turn` is a unit quaternion that leaves `about` where it is; `shift` is in world units.
    pub fn new(turn: DQuat, about: DVec3, shift: DVec3) -> Self {
        Self { turn: DMat3::from_quat(turn), about, shift }
    }

    fn turns(&self) -> bool {
        self.turn != DMat3::IDENTITY
    }

    /// The place of a point that the file has at `own`.
    pub fn point(&self, own: DVec3) -> DVec3 {
        // A move alone rounds once.
        if self.turns() { self.about + self.turn * (own - self.about) + self.shift } else { own + self.shift }
    }

    /// The place that the file has for the point at `placed`.
    pub fn own_point(&self, placed: DVec3) -> DVec3 {
        let moved_back = placed - self.shift;
        if self.turns() { self.about + self.turn.transpose() * (moved_back - self.about) } else { moved_back }
    }

    /// The direction that `own` has after the turn.
    pub fn direction(&self, own: DVec3) -> DVec3 {
        self.turn * own
    }

    /// The box, with level axes, about a box that is turned and moved.
    pub fn bounds(&self, own: Bounds) -> Bounds {
        if own.is_empty() {
            return own;
        }
        if !self.turns() {
            return Bounds { min: own.min + self.shift, max: own.max + self.shift };
        }
        let mut bounds = Bounds::EMPTY;
        own.corners().into_iter().for_each(|corner| bounds.include(self.point(corner)));
        bounds
    }

    /// The same normals, packed, after the turn.
    pub fn normals(&self, own: &Arc<Vec<u32>>) -> Arc<Vec<u32>> {
        if !self.turns() {
            return own.clone();
        }
        let turned = |normal: &u32| {
            let own = unpack_normal(*normal);
            own.map_or(*normal, |own| pack_normal(self.direction(own.as_dvec3()).as_vec3()))
        };
        Arc::new(own.iter().map(turned).collect())
    }
}

impl Chunk {
    /// Turns and moves the points, with their normals and their station; everything else is shared. `grid` is that of
    /// the file, so that coordinates are as exact as in the file before they are rounded to offsets.
    pub fn placed(&self, placement: &Placement, grid: Option<Grid>) -> Self {
        let grid = grid.map(Grid::of_file);
        let origin = placement.point(self.origin);
        let exact = |exact: &Arc<Vec<[f64; 3]>>| {
            Arc::new(exact.iter().map(|own| placement.point(DVec3::from(*own)).to_array()).collect())
        };
        let offset =
            |index| (placement.point(world_position(grid.as_ref(), self, index)) - origin).as_vec3().to_array();
        let positions = match placement.turns() {
            true => Arc::new((0..self.len()).map(offset).collect()),
            false => self.positions.clone(),
        };
        Self {
            origin,
            positions,
            exact_positions: self.exact_positions.as_ref().map(exact),
            normals: self.normals.as_ref().map(|normals| placement.normals(normals)),
            station: self.station.map(|station| placement.point(station)),
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::Cloud;

    const ABOUT: DVec3 = DVec3::new(631_200.0, 5_077_100.0, 120.0);

    fn quarter() -> Placement {
        Placement::new(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2), ABOUT, DVec3::new(0.05, -2.0, 0.5))
    }

    #[test]
    fn a_quarter_turn_about_a_point_and_a_move_are_as_the_closed_form_says_and_can_be_undone() {
        let own = ABOUT + DVec3::new(3.0, 1.0, 7.0);
        let placed = quarter().point(own);
        assert!((placed - (ABOUT + DVec3::new(-0.95, 1.0, 7.5))).abs().max_element() < 1e-9, "{placed}");
        assert!((quarter().own_point(placed) - own).abs().max_element() < 1e-9);
        let chunk = Chunk { station: Some(own), ..Chunk::new(0, ABOUT, vec![[0.0; 3]]) };
        assert_eq!(chunk.placed(&quarter(), None).station, Some(placed), "the place of its scanner");
        assert!((quarter().direction(DVec3::X) - DVec3::Y).length() < 1e-15);
        let moved = Placement::new(DQuat::IDENTITY, ABOUT, DVec3::X);
        assert_eq!((moved.point(own), moved.own_point(own)), (own + DVec3::X, own - DVec3::X));
    }

    #[test]
    fn turned_bounds_hold_all_that_the_box_held_and_an_empty_box_stays_empty() {
        let own = Bounds { min: ABOUT - 1.0, max: ABOUT + DVec3::new(4.0, 1.0, 1.0) };
        let placed = quarter().bounds(own);
        let expected = Bounds { min: ABOUT + DVec3::new(-0.95, -3.0, -0.5), max: ABOUT + DVec3::new(1.05, 2.0, 1.5) };
        assert!((placed.min - expected.min).abs().max_element() < 1e-9, "{placed:?}");
        assert!((placed.max - expected.max).abs().max_element() < 1e-9, "{placed:?}");
        assert!(quarter().bounds(Bounds::EMPTY).is_empty());
    }

    #[test]
    fn placed_points_of_a_georeferenced_file_keep_its_precision_and_normals_turn_with_them() {
        let grid = Grid::new(DVec3::splat(0.001), DVec3::new(600_000.0, 5_000_000.0, 0.0));
        let raw = |index: i64| DVec3::new((31_200_001 + 7919 * index) as f64, 77_100_003.0, (120_001 - index) as f64);
        let own: Vec<DVec3> = (0..100).map(|index| raw(index) * grid.scale + grid.offset).collect();
        let origin = DVec3::new(631_000.0, 5_077_000.0, 0.0);
        let mut chunk = Chunk::new(0, origin, own.iter().map(|own| (*own - origin).as_vec3().to_array()).collect());
        chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::X); 100]));
        chunk.positions = Arc::new([&chunk.positions[..99], &[[f32::NAN; 3]]].concat());
        for placement in [quarter(), Placement::new(DQuat::from_rotation_y(0.3), ABOUT, DVec3::new(1e6, 0.05, 0.0))] {
            let grid = grid.placed(placement);
            let cloud =
                Cloud { grid: Some(grid), chunks: vec![chunk.placed(&placement, Some(grid))], ..Cloud::default() };
            let placed = &cloud.chunks[0];
            for (index, own) in own[..99].iter().enumerate() {
                let (expected, exact) = (placement.point(*own), cloud.world_position(placed, index));
                assert!((exact - expected).abs().max_element() < 1e-8, "{exact} {expected}");
                assert!((placed.position(index) - expected).abs().max_element() < 1e-4, "{}", placed.position(index));
            }
            assert!(!placed.position(99).is_finite());
            let normal = unpack_normal(placed.normals.as_ref().unwrap()[0]).unwrap().as_dvec3();
            assert!((normal - placement.direction(DVec3::X)).length() < 1e-4, "{normal}");
        }
    }

    #[test]
    fn exact_positions_move_along_and_a_move_alone_shares_the_offsets() {
        let mut chunk = Chunk::new(5, ABOUT, vec![[1.0, 0.0, 0.0]]);
        chunk.exact_positions = Some(Arc::new(vec![(ABOUT + DVec3::X * 1.000_000_1).to_array()]));
        let moved = chunk.placed(&Placement::new(DQuat::IDENTITY, DVec3::ZERO, DVec3::Z), None);
        assert!(Arc::ptr_eq(&moved.positions, &chunk.positions) && moved.origin == ABOUT + DVec3::Z);
        let turned = chunk.placed(&quarter(), None);
        let exact = DVec3::from(turned.exact_positions.unwrap()[0]);
        let expected = ABOUT + DVec3::new(0.05, -2.0 + 1.000_000_1, 0.5);
        assert!((exact - expected).abs().max_element() < 1e-9 && turned.first_point == 5, "{exact}");
    }
}
