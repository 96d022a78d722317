//! A chunk's points as a tree of oriented discs through which the GPU traces rays. It is built when the chunk arrives
//! and never changed.
//!
//! The tree is binary, split at the median along the longest axis, and laid out in preorder with skip links, so that a
//! ray walks it without a stack (Smits 1998). Leaves hold up to `LEAF` discs of eight bytes: position in 1024 steps of
//! the leaf's box, octahedral normal in 11 + 11 bits, radius in steps of 2 % relative to the box. On a leaf some four
//! discs wide, a step is a hundredth of a disc's radius. An ellipse has 10 + 10 bits of the normal and 5 of its shape.

use cloud::{Chunk, NO_RADIUS, STRAY_RADIUS, Stretch, pack_ellipse, unpack_normal, unpack_radius, unpack_stretch};
use glam::Vec3;

use crate::layout::{INNER, Node};

/// The most discs of a leaf. Fewer make more nodes, more make more disc tests.
pub(crate) const LEAF: usize = 8;
/// The number of points per node. A tree over a multiple of this many points has fewer nodes than that: all leaves but
/// one are full, and inner nodes are one fewer than leaves.
pub(crate) const POINTS_PER_NODE: u64 = LEAF as u64 / 2;
/// The number of bits of a leaf's count of discs.
const COUNT_BITS: u32 = 8;

pub(crate) struct SurfelTree {
    pub nodes: Vec<Node>,
    pub surfels: Vec<[u32; 2]>,
    /// The index in the chunk of each disc. Points that are nowhere have none, nor have those that would cost the others
    /// of their leaf their places (`APART`).
    pub order: Vec<u32>,
}

struct Disc {
    position: Vec3,
    radius: f32,
    normal: Option<Vec3>,
    stretch: Option<Stretch>,
}

impl SurfelTree {
    /// Builds the tree. `provisional_radius` is that of points whose own is not known yet, in world units.
    pub fn new(chunk: &Chunk, provisional_radius: f32) -> Self {
        let is_finite = |index: &u32| chunk.positions[*index as usize].iter().all(|v| v.is_finite());
        let mut order: Vec<u32> = (0..chunk.len() as u32).filter(is_finite).collect();
        let disc = |index: usize| {
            let radius = chunk.radii.as_ref().map_or(NO_RADIUS, |radii| radii[index]);
            let normal = chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[index]));
            Disc {
                position: Vec3::from(chunk.positions[index]),
                radius: unpack_radius(radius).unwrap_or(provisional_radius),
                normal,
                stretch: normal.and_then(|normal| unpack_stretch(radius, normal)),
            }
        };
        let discs: Vec<Disc> = (0..chunk.len()).map(disc).collect();
        let room = order.len();
        let mut tree = Self { nodes: Vec::new(), surfels: Vec::with_capacity(room), order: Vec::with_capacity(room) };
        if !order.is_empty() {
            tree.build(&mut order, &discs);
        }
        tree
    }

    /// Builds a node and those below it. Returns the box of the discs.
    fn build(&mut self, order: &mut [u32], discs: &[Disc]) -> (Vec3, Vec3) {
        let node = self.nodes.len();
        self.nodes.push(Node { low: Vec3::ZERO, skip: 0, high: Vec3::ZERO, leaf: INNER });
        let (low, high) = if order.len() <= LEAF {
            let order = near_one_another(order, discs);
            let join = |(low, high): (Vec3, Vec3), index: &u32| {
                let Disc { position, radius, normal, .. } = &discs[*index as usize];
                // A disc reaches r sqrt(1 - n^2) along each axis.
                let reach = normal.map_or(Vec3::ONE, |n| (Vec3::ONE - n * n).max(Vec3::ZERO).map(f32::sqrt)) * radius;
                (low.min(position - reach), high.max(position + reach))
            };
            let (low, high) = order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), join);
            // For rounding in the shader, and for flat boxes: a ray must not slip between a wall's two faces.
            let margin = (high - low).max_element() * 1e-3 + low.abs().max(high.abs()).max_element() * 1e-6;
            let (low, high) = (low - margin, high + margin);
            self.nodes[node].leaf = (self.surfels.len() as u32) << COUNT_BITS | order.len() as u32;
            self.surfels.extend(order.iter().map(|&index| pack(&discs[index as usize], low, high)));
            self.order.extend_from_slice(order);
            (low, high)
        } else {
            let spread = |(least, most): (Vec3, Vec3), index: &u32| {
                let position = discs[*index as usize].position;
                (least.min(position), most.max(position))
            };
            let (least, most) = order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), spread);
            let axis = (most - least).max_position();
            // Left halves of whole leaves keep the leaves full.
            let half = (order.len() / 2).next_multiple_of(LEAF).min(order.len() - 1);
            let key = |index: u32| discs[index as usize].position[axis];
            order.select_nth_unstable_by(half, |a, b| key(*a).total_cmp(&key(*b)).then(a.cmp(b)));
            let (left, right) = order.split_at_mut(half);
            let (left, right) = (self.build(left, discs), self.build(right, discs));
            (left.0.min(right.0), left.1.max(right.1))
        };
        (self.nodes[node].low, self.nodes[node].high) = (low, high);
        self.nodes[node].skip = self.nodes.len() as u32;
        (low, high)
    }
}

/// The discs of a leaf without those that are too far away from the one in their middle.
fn near_one_another<'a>(order: &'a mut [u32], discs: &[Disc]) -> &'a [u32] {
    let disc = |index: &u32| &discs[*index as usize];
    let largest = order.iter().map(|index| disc(index).radius).fold(0.0, f32::max);
    let median = |axis: usize| {
        let mut values: Vec<f32> = order.iter().map(|index| disc(index).position[axis]).collect();
        values.sort_unstable_by(f32::total_cmp);
        values[values.len() / 2]
    };
    let apart = |index: &u32, place: Vec3| (disc(index).position - place).abs().max_element();
    let reach = order.iter().map(|index| apart(index, disc(&order[0]).position)).fold(0.0, f32::max);
    let stray = unpack_radius(STRAY_RADIUS).unwrap_or(0.0);
    if largest <= stray || reach <= APART * largest {
        return order;
    }
    let median = Vec3::new(median(0), median(1), median(2));
    let middle = order.iter().min_by(|a, b| apart(a, median).total_cmp(&apart(b, median)));
    let middle = middle.map_or(median, |index| disc(index).position);
    order.sort_by_key(|index| apart(index, middle) > APART * largest);
    let kept = order.partition_point(|index| apart(index, middle) <= APART * largest);
    &order[..kept]
}

/// How many times as far as the largest disc of a leaf is wide another one may be: beyond this, the diagonal of the leaf
/// would be more than 250 times as long as its discs are wide, the smallest radius that is packed, and all of these would
/// be too large.
const APART: f32 = 128.0;
/// The number of steps of a position along each axis of its leaf's box.
const STEPS: f32 = 1023.0;
/// Radius = diagonal of the leaf's box x 2^(-k / 32): k is a byte, a step 2 %.
const RADIUS_STEPS: f32 = 32.0;
const HAS_NORMAL: u32 = 1 << 30;
const IS_STRETCHED: u32 = 1 << 31;

fn pack(disc: &Disc, low: Vec3, high: Vec3) -> [u32; 2] {
    let extent = high - low;
    let place = (disc.position - low) / extent.max(Vec3::splat(f32::MIN_POSITIVE));
    let [x, y, z] = (place * STEPS).round().clamp(Vec3::ZERO, Vec3::splat(STEPS)).to_array().map(|v| v as u32);
    let ratio = (extent.length() / disc.radius.max(f32::MIN_POSITIVE)).log2() * RADIUS_STEPS;
    // Rounded down, to the larger radius.
    let radius = ratio.clamp(0.0, 255.0) as u32;
    let place = x | y << 10 | z << 20;
    match disc.normal.zip(disc.stretch) {
        Some((normal, stretch)) => {
            let coarse = octahedral(normal, 10);
            // The shape is that in the plane that the shader sees.
            let shape = u32::from(pack_ellipse(1.0, stretch, unpack_octahedral(coarse, 10)) % 32);
            [place | shape << 30, IS_STRETCHED | (shape >> 2) << 28 | coarse << 8 | radius]
        }
        None => [place, disc.normal.map_or(0, |normal| HAS_NORMAL | octahedral(normal, 11) << 8) | radius],
    }
}

/// The octahedral normal in two numbers of so many bits.
fn octahedral(normal: Vec3, bits: u32) -> u32 {
    let flat = normal / (normal.x.abs() + normal.y.abs() + normal.z.abs());
    let (x, y) = if flat.z >= 0.0 {
        (flat.x, flat.y)
    } else {
        ((1.0 - flat.y.abs()).copysign(flat.x), (1.0 - flat.x.abs()).copysign(flat.y))
    };
    let most = ((1 << bits) - 1) as f32;
    let [x, y] = [x, y].map(|v| ((v * 0.5 + 0.5) * most).round().clamp(0.0, most) as u32);
    x | y << bits
}

/// The unit normal of two such numbers.
fn unpack_octahedral(packed: u32, bits: u32) -> Vec3 {
    let most = (1 << bits) - 1;
    let [x, y] = [packed & most, packed >> bits & most].map(|v| v as f32 * 2.0 / most as f32 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let [x, y] = if z >= 0.0 { [x, y] } else { [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)] };
    Vec3::new(x, y, z).normalize()
}

/// A tree over boxes (lower and upper corners), in the same layout; a leaf is the index of a box.
pub(crate) fn tree_over_boxes(boxes: &[(Vec3, Vec3)]) -> Vec<Node> {
    fn build(nodes: &mut Vec<Node>, order: &mut [u32], boxes: &[(Vec3, Vec3)]) {
        let join = |(low, high): (Vec3, Vec3), index: &u32| {
            let (other_low, other_high) = boxes[*index as usize];
            (low.min(other_low), high.max(other_high))
        };
        let (low, high) = order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), join);
        let node = nodes.len();
        let leaf = if let [index] = order { *index } else { INNER };
        nodes.push(Node { low, skip: 0, high, leaf });
        if order.len() > 1 {
            let middle = |index: u32| boxes[index as usize].0 + boxes[index as usize].1;
            let extent = high - low;
            let axis = (0..3).max_by(|a, b| extent[*a].total_cmp(&extent[*b])).unwrap_or(0);
            let half = order.len() / 2;
            order.select_nth_unstable_by(half, |a, b| middle(*a)[axis].total_cmp(&middle(*b)[axis]).then(a.cmp(b)));
            let (left, right) = order.split_at_mut(half);
            build(nodes, left, boxes);
            build(nodes, right, boxes);
        }
        nodes[node].skip = nodes.len() as u32;
    }
    let mut nodes = Vec::new();
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    if !order.is_empty() {
        build(&mut nodes, &mut order, boxes);
    }
    nodes
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{NO_NORMAL, pack_normal, pack_radius};
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    /// The room for the nodes of this many points: the store gives chunks whole blocks of 1024.
    fn room(points: usize) -> usize {
        points.next_multiple_of(1024) / POINTS_PER_NODE as usize
    }

    fn chunk(points: &[(Vec3, Vec3, f32)]) -> Chunk {
        let mut chunk = Chunk::new(0, DVec3::ZERO, points.iter().map(|(position, ..)| position.to_array()).collect());
        chunk.normals = Some(Arc::new(points.iter().map(|(_, normal, _)| pack_normal(*normal)).collect()));
        chunk.radii = Some(Arc::new(points.iter().map(|(.., radius)| pack_radius(*radius)).collect()));
        chunk
    }

    /// The leaves in order: box, first disc, count.
    fn leaves(tree: &SurfelTree) -> impl Iterator<Item = (Node, usize, usize)> {
        let leaves = tree.nodes.iter().filter(|node| node.leaf != INNER);
        leaves.map(|node| (*node, (node.leaf >> COUNT_BITS) as usize, (node.leaf & 255) as usize))
    }

    /// Checks that each finite point is in one leaf, if no other one lies too far away from it, that each node's parts
    /// follow it and lie in its box, and that skips lead past them.
    fn check_layout(tree: &SurfelTree, chunk: &Chunk) -> Result<(), TestCaseError> {
        let mut next = 0;
        for (_, first, count) in leaves(tree) {
            prop_assert!(first == next && (1..=LEAF).contains(&count));
            next += count;
        }
        prop_assert_eq!((tree.surfels.len(), tree.order.len()), (next, next));
        let mut order = tree.order.clone();
        order.sort_unstable();
        let place = |index: &u32| Vec3::from(chunk.positions[*index as usize]);
        let finite: Vec<u32> = (0..chunk.len() as u32).filter(|index| place(index).is_finite()).collect();
        let is_apart = |index: &u32| {
            let radius = chunk.radii.as_ref().and_then(|radii| unpack_radius(radii[*index as usize])).unwrap_or(0.0);
            let reach =
                finite.iter().map(|other| (place(index) - place(other)).abs().max_element()).fold(0.0, f32::max);
            reach > APART * radius
        };
        let left_out: Vec<u32> = finite.iter().copied().filter(|index| order.binary_search(index).is_err()).collect();
        prop_assert!(left_out.iter().all(is_apart), "{:?} are left out", left_out);
        prop_assert!(order.len() + left_out.len() == finite.len() && order.is_sorted_by(|one, other| one < other));
        prop_assert!(tree.nodes.len() <= room(chunk.len()), "{} nodes of {}", tree.nodes.len(), chunk.len());
        // A preorder: a leaf skips to the next node, an inner node's first part follows it and its second ends where it
        // does.
        for (index, node) in tree.nodes.iter().enumerate() {
            if node.leaf != INNER {
                prop_assert_eq!(node.skip as usize, index + 1);
                continue;
            }
            let first = index + 1;
            let second = tree.nodes[first].skip as usize;
            prop_assert!(second > first && second < tree.nodes.len() && tree.nodes[second].skip == node.skip);
            for part in [tree.nodes[first], tree.nodes[second]] {
                prop_assert!(part.low.cmpge(node.low).all() && part.high.cmple(node.high).all());
            }
        }
        prop_assert_eq!(tree.nodes.first().map_or(0, |root| root.skip as usize), tree.nodes.len());
        Ok(())
    }

    /// Checks that each leaf holds its discs, and that unpacking as in shaders/shared/surfel_tree.wgsl restores them.
    fn check_discs(tree: &SurfelTree, chunk: &Chunk, provisional_radius: f32) -> Result<(), TestCaseError> {
        for (Node { low, high, .. }, first, count) in leaves(tree) {
            for disc in first..first + count {
                let index = tree.order[disc] as usize;
                let position = Vec3::from(chunk.positions[index]);
                let radius = chunk.radii.as_ref().and_then(|radii| unpack_radius(radii[index]));
                let radius = radius.unwrap_or(provisional_radius);
                let normal = chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[index]));
                let reach = normal.map_or(Vec3::ONE, |n| (1.0 - n * n).max(Vec3::ZERO).map(f32::sqrt)) * radius;
                prop_assert!((position - reach).cmpge(low).all() && (position + reach).cmple(high).all());

                let [place, rest] = tree.surfels[disc];
                let extent = high - low;
                let place = Vec3::new((place & 1023) as f32, (place >> 10 & 1023) as f32, (place >> 20) as f32);
                let unpacked = low + place * (extent / STEPS);
                // Half a step, and the rounding of positions.
                let off = (unpacked - position).abs();
                let most = extent * (0.502 / STEPS) + position.abs().max(low.abs()) * 2e-7;
                prop_assert!(off.cmple(most).all(), "{} off, {} is a step", off, extent / STEPS);

                let unpacked = extent.length() * ((rest & 255) as f32 / -RADIUS_STEPS).exp2();
                prop_assert!(unpacked >= radius * 0.99999, "{} shrank to {}", radius, unpacked);
                // 2^(1/32) = 1.0219; the least radius is 2^(-255/32) of the box.
                prop_assert!(unpacked <= radius * 1.0221 || rest & 255 == 255, "{} grew to {}", radius, unpacked);

                prop_assert_eq!(rest & HAS_NORMAL != 0, normal.is_some());
                if let Some(normal) = normal {
                    let folded = Vec3::new((rest >> 8 & 2047) as f32, (rest >> 19 & 2047) as f32, 0.0);
                    let folded = folded * (2.0 / 2047.0) - 1.0;
                    let z = 1.0 - folded.x.abs() - folded.y.abs();
                    let side = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
                    let unpacked = if z >= 0.0 {
                        Vec3::new(folded.x, folded.y, z)
                    } else {
                        let (x, y) = (1.0 - folded.y.abs(), 1.0 - folded.x.abs());
                        Vec3::new(x * side(folded.x), y * side(folded.y), z)
                    };
                    let angle = unpacked.normalize().cross(normal).length().asin().to_degrees();
                    // Half a step e along both folded axes is (e, e, -2e) on a face whose middle is 1/sqrt(3) from the
                    // origin: 3 sqrt(2) e, e = 1/2047.
                    prop_assert!(angle < 0.12 && unpacked.dot(normal) > 0.0, "{} degrees", angle);
                }
            }
        }
        Ok(())
    }

    fn points() -> impl Strategy<Value = Vec<(Vec3, Vec3, f32)>> {
        let vector = || [-1.0_f32..1.0, -1.0..1.0, -1.0..1.0].prop_map(Vec3::from);
        // Flat, small and far clouds; points without normal or radius; points on top of one another.
        let form = (vector(), prop::sample::select(vec![1e-3, 1.0, 1e4]), prop::bool::weighted(0.3));
        let point = (vector(), vector(), 1e-3_f32..0.2, 0..8);
        (form, prop::collection::vec(point, 0..300)).prop_map(|((shift, scale, is_flat), points)| {
            let place = |(position, normal, radius, odd)| {
                let position = if is_flat { position * Vec3::new(1.0, 1.0, 0.0) } else { position };
                let position = if odd == 0 { Vec3::ZERO } else { position };
                let normal = if odd == 1 { Vec3::ZERO } else { normal };
                let radius = if odd == 2 { 0.0 } else { radius * scale };
                ((position + shift * 3.0) * scale, normal, radius)
            };
            points.into_iter().map(place).collect()
        })
    }

    proptest! {
        #[test]
        fn every_point_is_in_one_leaf_that_holds_its_disc(points in points()) {
            let chunk = chunk(&points);
            let tree = SurfelTree::new(&chunk, 1.0);
            check_layout(&tree, &chunk)?;
            check_discs(&tree, &chunk, 1.0)?;
        }
    }

    #[test]
    fn points_that_are_nowhere_are_left_out_and_the_others_keep_their_index() {
        let mut points = vec![(Vec3::ZERO, Vec3::Z, 0.1); 20];
        for (index, (position, ..)) in points.iter_mut().enumerate() {
            position.x = index as f32;
        }
        for (index, value) in [(0, f32::NAN), (7, f32::INFINITY), (19, f32::NEG_INFINITY)] {
            points[index].0.y = value;
        }
        let chunk = chunk(&points);
        let tree = SurfelTree::new(&chunk, 0.0);
        assert_eq!(tree.surfels.len(), 17);
        check_layout(&tree, &chunk).unwrap();
        check_discs(&tree, &chunk, 0.0).unwrap();
    }

    #[test]
    fn a_stray_five_thousand_kilometres_away_costs_the_discs_of_its_leaf_nothing() {
        let mut points: Vec<_> = (0..20).map(|index| (Vec3::X * (index as f32 * 0.1), Vec3::Z, 0.1)).collect();
        points[3].0 = Vec3::new(-455_000.0, -5_482_000.0, -110.0);
        points[11].0 = Vec3::new(5e6, 0.0, 0.0);
        let chunk = chunk(&points);
        let tree = SurfelTree::new(&chunk, 0.0);
        assert_eq!(tree.order.len(), 18);
        check_discs(&tree, &chunk, 0.0).unwrap();
        let (low, high) = (tree.nodes[0].low, tree.nodes[0].high);
        assert!(low.cmpge(Vec3::splat(-1.0)).all() && high.cmple(Vec3::splat(3.0)).all(), "{low} {high}");
    }

    #[test]
    fn one_point_is_a_leaf_and_no_point_no_tree() {
        let one = chunk(&[(Vec3::ONE, Vec3::Z, 0.1)]);
        let tree = SurfelTree::new(&one, 0.0);
        assert_eq!((tree.nodes.len(), tree.surfels.len(), &tree.order[..]), (1, 1, &[0][..]));
        check_discs(&tree, &one, 0.0).unwrap();
        for none in [chunk(&[]), chunk(&[(Vec3::NAN, Vec3::Z, 0.1)])] {
            let tree = SurfelTree::new(&none, 0.0);
            assert!(tree.nodes.is_empty() && tree.surfels.is_empty() && tree.order.is_empty());
        }
        assert!(tree_over_boxes(&[]).is_empty());
    }

    #[test]
    fn points_of_unknown_spacing_are_discs_of_the_provisional_radius_that_face_the_ray() {
        let bare = Chunk::new(0, DVec3::ZERO, (0..30).map(|i| [i as f32 * 0.1, 0.0, 0.0]).collect());
        let tree = SurfelTree::new(&bare, 0.25);
        assert!(tree.surfels.iter().all(|[_, rest]| rest & HAS_NORMAL == 0));
        check_discs(&tree, &bare, 0.25).unwrap();
        assert_eq!(pack_normal(Vec3::ZERO), NO_NORMAL);
    }

    #[test]
    fn nodes_fit_the_room_that_the_store_gives_for_any_number_of_points() {
        for count in [1, 7, 8, 9, 17, 1023, 1024, 1025, 2047, 2048, 4097, 65_535, 65_536] {
            let spiral = |i: usize| {
                let angle = i as f32 * 2.4;
                (Vec3::new(angle.cos(), angle.sin(), 0.01) * (i as f32).sqrt(), Vec3::Z, 0.5)
            };
            let points: Vec<_> = (0..count).map(spiral).collect();
            let tree = SurfelTree::new(&chunk(&points), 0.0);
            assert!(tree.nodes.len() <= room(count), "{count}: {} of {}", tree.nodes.len(), room(count));
            assert_eq!(leaves(&tree).filter(|(.., count)| *count < LEAF).count(), usize::from(count % LEAF > 0));
        }
    }

    #[test]
    fn a_tree_over_boxes_has_each_box_in_one_leaf_and_in_all_nodes_above_it() {
        for count in [1, 2, 3, 10, 257] {
            let corner = |i: usize| Vec3::new((i * 37 % 101) as f32, (i * 53 % 97) as f32, (i * 11 % 7) as f32);
            let boxes: Vec<_> = (0..count).map(|i| (corner(i), corner(i) + 1.0 + corner(i + 5) * 0.1)).collect();
            let nodes = tree_over_boxes(&boxes);
            let mut seen: Vec<u32> = nodes.iter().filter(|node| node.leaf != INNER).map(|node| node.leaf).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..count as u32).collect::<Vec<_>>());
            for (index, node) in nodes.iter().enumerate() {
                for below in &nodes[index..node.skip as usize] {
                    assert!(below.skip <= node.skip);
                    assert!(below.low.cmpge(node.low).all() && below.high.cmple(node.high).all());
                }
            }
        }
    }
}
