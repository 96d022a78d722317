//! Finds how far a picked point may be off the surface, by the points of its cloud that are loaded.

use cloud::{Bounds, Cloud};
use glam::DVec3;
use world::LoadedParts;

use crate::shared::measuring::{PointError, point_error};
use crate::viewer::picture::messages::PickedPoint;

/// A picked point, and what is loaded of its cloud.
pub struct PointWork {
    pub picked: PickedPoint,
    pub world: DVec3,
    /// The unit direction of the line of sight.
    pub sight: DVec3,
    pub cloud: Cloud,
    pub loaded: LoadedParts,
}

impl PointWork {
    pub fn run(self) -> Option<PointError> {
        let LoadedParts { parts, placement, .. } = &self.loaded;
        let bounds = parts.iter().map(|(_, bounds)| *bounds).collect();
        let error = point_error(self.world, self.sight, self.cloud, bounds)?;
        let own = placement.map_or(self.world, |placement| placement.own_point(self.world));
        let is_near = |bounds: Bounds| own.distance(own.clamp(bounds.min, bounds.max)) <= error.reach;
        Some(PointError { is_thinned: self.loaded.lack(&is_near), ..error })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::PointTest;
    use cloud::{Chunk, Placement};
    use glam::DQuat;
    use scene::{Measurement, MeasurementKind};
    use stream::{Node, NodeId, Octree};
    use world::{CloudKey, Part};

    use super::*;
    use crate::shared::measuring::{self, Figure, LOADED_POINTS};

    /// A floor of 2 x 1 in two leaves, at points 0.05 apart; a tenth of them are in the root.
    fn floor() -> (Octree, Vec<Chunk>) {
        let places = |part: usize| -> Vec<[f32; 3]> {
            let place = |index: usize| [(index % 40) as f32 * 0.05, (index / 40) as f32 * 0.05, 0.0];
            let part_of = |index: &usize| match (index.is_multiple_of(10), index % 40 < 20) {
                (true, _) => 0,
                (false, true) => 1,
                (false, false) => 2,
            };
            (0..800).filter(|index| part_of(index) == part).map(place).collect()
        };
        let chunks = [0, 1, 2].map(|part| Chunk::new(part as u64 * 1000, DVec3::ZERO, places(part))).to_vec();
        let node = |part: usize, bounds: Bounds| Node {
            level: u8::from(part > 0),
            bounds,
            points: chunks[part].len() as u32,
            is_exact: false,
            total: chunks[part].len() as u64,
            first_point: chunks[part].first_point,
            parent: (part > 0).then_some(NodeId(0)),
            children: [None; 8],
        };
        let all = chunks.iter().map(Chunk::bounds).fold(Bounds::EMPTY, Bounds::union);
        let mut nodes = vec![node(0, all), node(1, chunks[1].bounds()), node(2, chunks[2].bounds())];
        (nodes[0].children[0], nodes[0].children[1]) = (Some(NodeId(1)), Some(NodeId(2)));
        (Octree::new(DVec3::ZERO, 2.0, 0.1, nodes), chunks)
    }

    /// The error of the point of the root that is nearest to a place of the file, while these nodes are loaded.
    fn error(place: DVec3, loaded: &[usize], octree: bool, placement: Option<Placement>) -> PointError {
        let (tree, chunks) = floor();
        let moved = |chunk: &Chunk| placement.map_or_else(|| chunk.clone(), |placement| chunk.placed(&placement, None));
        let chunks: Vec<Chunk> = chunks.iter().map(moved).collect();
        let own = |index: &usize| floor().1[0].position(*index).distance(place);
        let index = (0..chunks[0].len()).min_by(|a, b| own(a).total_cmp(&own(b))).expect("points");
        let part = |node: usize| Part::Node(NodeId(node as u32));
        let work = PointWork {
            picked: PickedPoint { chunk: CloudKey(0).chunk(part(0)), index },
            world: chunks[0].position(index),
            sight: DVec3::NEG_Z,
            cloud: Cloud { chunks: loaded.iter().map(|node| chunks[*node].clone()).collect(), ..Cloud::default() },
            loaded: LoadedParts {
                parts: loaded.iter().map(|node| (part(*node), chunks[*node].bounds())).collect(),
                streamed: Some(octree.then(|| Arc::new(tree))),
                is_cut: false,
                placement,
            },
        };
        work.run().expect("a surface")
    }

    #[test]
    fn a_point_is_as_certain_as_the_loaded_points_around_it_say_and_it_is_told_where_these_are_not_all() {
        let turned = Placement::new(DQuat::from_rotation_y(1.0), DVec3::ZERO, DVec3::new(500.0, 40.0, 3.0));
        for placement in [None, Some(turned)] {
            // Far in the half whose leaf is loaded, nothing is missing.
            let left = |x: f64| DVec3::new(x, 0.5, 0.0);
            let whole = error(left(0.3), &[0, 1], true, placement);
            assert!(!whole.is_thinned && (0.1..0.2).contains(&whole.reach), "{whole:?}");
            assert!(error(left(0.95), &[0, 1], true, placement).is_thinned, "points beyond the border count");
            let thinned = error(left(1.7), &[0, 1], true, placement);
            assert!(thinned.is_thinned && thinned.reach > 2.0 * whole.reach, "{thinned:?}");
            // A place is read off as exactly as points are close together.
            let along = |error: &PointError| {
                let axis = placement.map_or(DVec3::Y, |placement| placement.direction(DVec3::Y));
                axis.dot(error.scatter.covariance() * axis).sqrt()
            };
            assert!(along(&thinned) > 2.0 * along(&whole));
            assert!(!error(left(1.7), &[0, 1, 2], true, placement).is_thinned);
            assert!(error(left(0.3), &[0, 1], false, placement).is_thinned, "a preview has few of the points");
        }
    }

    #[test]
    fn a_fit_to_a_choice_of_the_points_states_no_interval_and_says_so() {
        let (tree, chunks) = floor();
        let tree = Arc::new(tree);
        let figures = |kind: MeasurementKind, [x, reach]: [f64; 2], nodes: &[usize], octree: Option<&Arc<Octree>>| {
            let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
            let around = [corner(x - reach, 0.3), corner(x + reach, 0.3), corner(x, 0.7)].to_vec();
            let points = if kind == MeasurementKind::Volume { around } else { vec![corner(x, 0.5)] };
            let reach = kind.has_reach().then_some(reach);
            let (name, level) = (String::new(), Some(-1.0));
            let measurement = Measurement { name, kind, on: true, color: [0.0; 3], points, reach, level };
            let part = |node: &usize| (Part::Node(NodeId(*node as u32)), chunks[*node].bounds());
            let parts = nodes.iter().map(part).collect();
            let loaded = LoadedParts { parts, streamed: Some(octree.cloned()), ..LoadedParts::default() };
            let chunks = nodes.iter().map(|node| chunks[*node].clone()).collect();
            let clouds = vec![(Cloud { chunks, ..Cloud::default() }, loaded)];
            measuring::of_clouds(&measurement, DVec3::Z, clouds, &PointTest::default())
        };
        let has_interval = |figures: &[Figure]| figures.iter().any(|figure| figure.deviation.is_some());
        let is_told = |figures: &[Figure]| figures.iter().any(|figure| figure.name == LOADED_POINTS);
        for kind in [MeasurementKind::Plane, MeasurementKind::Volume] {
            let whole = figures(kind, [0.4, 0.2], &[0, 1], Some(&tree)).expect("figures");
            assert!(has_interval(&whole) && !is_told(&whole), "{kind:?}: all points within reach are there: {whole:?}");
            for thinned in [figures(kind, [1.4, 0.6], &[0, 1], Some(&tree)), figures(kind, [0.6, 0.6], &[0], None)] {
                let thinned = thinned.expect("figures");
                assert!(!has_interval(&thinned) && is_told(&thinned), "{kind:?}: {thinned:?}");
            }
        }
        // The points of the root are 0.5 apart along x, all of them 0.05.
        let problem = |[x, reach]: [f64; 2], nodes: &[usize]| {
            figures(MeasurementKind::Volume, [x, reach], nodes, Some(&tree)).expect_err("no points there")
        };
        let told = "no points lie above or below its corners";
        assert_eq!(problem([0.25, 0.15], &[0]), format!("of the loaded points: {told}"));
        assert_eq!(problem([0.025, 0.015], &[0, 1, 2]), told);
    }
}
