//! Finds how far a picked point may be off the surface, by the points of its cloud that are loaded.

use std::sync::Arc;

use cloud::{Bounds, Cloud, Placement};
use glam::DVec3;
use stream::{NodeId, Octree};
use world::Part;

use crate::shared::measuring::{PointError, point_error};
use crate::viewer::picture::messages::PickedPoint;

/// A picked point, and what is loaded of its cloud.
pub struct PointWork {
    pub picked: PickedPoint,
    pub world: DVec3,
    /// The unit direction of the line of sight.
    pub sight: DVec3,
    pub cloud: Cloud,
    /// The parts of the cloud that are loaded, in order, with their bounds.
    pub parts: Vec<(Part, Bounds)>,
    /// The index of a streamed cloud, once there is one, and how its points are moved.
    pub streamed: Option<(Option<Arc<Octree>>, Option<Placement>)>,
}

impl PointWork {
    pub fn run(self) -> Option<PointError> {
        let bounds = self.parts.iter().map(|(_, bounds)| *bounds).collect();
        let error = point_error(self.world, self.sight, self.cloud, bounds)?;
        let is_loaded = |part: Part| self.parts.binary_search_by_key(&part, |(part, _)| *part).is_ok();
        let is_thinned = self.streamed.is_some_and(|(octree, placement)| {
            // Of a cloud whose index is being made there is a preview.
            let Some(octree) = octree else { return true };
            let own = placement.map_or(self.world, |placement| placement.own_point(self.world));
            let is_near = |bounds: Bounds| own.distance(own.clamp(bounds.min, bounds.max)) <= error.reach;
            if octree.paged.tiles.is_empty() {
                return lacks_points(&octree, NodeId(0), &is_near, &|id| is_loaded(Part::Node(id)));
            }
            let mut closed = octree.paged.unread.values();
            let lacks = |(tile, octree): (&u32, &Arc<Octree>)| {
                lacks_points(octree, NodeId(0), &is_near, &|id| is_loaded(Part::Tile(*tile, id)))
            };
            closed.any(|bounds| is_near(*bounds)) || octree.paged.tiles.iter().any(lacks)
        });
        Some(PointError { is_thinned, ..error })
    }
}

/// Whether a node that is near, or one below it, is not loaded.
fn lacks_points(
    octree: &Octree,
    id: NodeId,
    is_near: &impl Fn(Bounds) -> bool,
    is_loaded: &impl Fn(NodeId) -> bool,
) -> bool {
    let Some(node) = octree.get(id).filter(|node| !node.bounds.is_empty() && is_near(node.bounds)) else {
        return false;
    };
    // What the page of a list of nodes has that is not there is not loaded.
    let mut unread = octree.paged.unread.range((id, 0)..=(id, u8::MAX));
    let is_missing = node.points > 0 && !is_loaded(id) || unread.any(|(_, bounds)| is_near(*bounds));
    is_missing || node.children.iter().flatten().any(|child| lacks_points(octree, *child, is_near, is_loaded))
}

#[cfg(test)]
mod tests {
    use cloud::Chunk;
    use glam::DQuat;
    use stream::Node;
    use world::CloudKey;

    use super::*;

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
            parts: loaded.iter().map(|node| (part(*node), chunks[*node].bounds())).collect(),
            cloud: Cloud { chunks: loaded.iter().map(|node| chunks[*node].clone()).collect(), ..Cloud::default() },
            streamed: Some((octree.then(|| Arc::new(tree)), placement)),
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
}
