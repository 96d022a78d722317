use proptest::prelude::*;

use super::*;
use crate::test_trees::{page, random, terrain, terrain_page};

/// Of the nodes that `is_drawn` says, all points.
fn drawn(octree: &Octree, is_drawn: impl Fn(NodeId) -> bool) -> BTreeMap<NodeId, Drawn> {
    let ids = octree.ids().map(|(id, _)| id).filter(|id| is_drawn(*id));
    ids.map(|id| {
        let own = count_octants(&page(octree, id), cube_center(octree, id));
        (id, Drawn { own, drawn: own })
    })
    .collect()
}

#[test]
fn middles_of_cubes_are_those_of_their_boxes() {
    let octree = random(9, 200);
    for (id, node) in octree.ids() {
        // Bounds of synthetic nodes are their cubes.
        assert_eq!(cube_center(&octree, id), node.bounds.center(), "{id:?}");
    }
}

#[test]
fn octants_are_those_of_the_children() {
    let octree = random(9, 200);
    for (id, node) in octree.ids() {
        for (octant, child) in node.children.iter().enumerate() {
            let Some(child) = child else { continue };
            let counts = count_octants(&page(&octree, *child), cube_center(&octree, id));
            assert_eq!(counts[octant], octree.node(*child).points, "{id:?}");
        }
    }
}

#[test]
fn a_point_that_is_not_finite_is_counted_once() {
    let chunk = Chunk::new(0, DVec3::ZERO, vec![[f32::NAN; 3], [1.0; 3], [f32::INFINITY, -1.0, -1.0]]);
    assert_eq!(count_octants(&chunk, DVec3::ZERO), [1, 1, 0, 0, 0, 0, 0, 1]);
}

#[test]
fn radii_are_as_they_were_where_all_is_drawn() {
    for seed in 0..20 {
        let octree = random(seed, 100);
        let growths = growths(&octree, &drawn(&octree, |_| true));
        assert_eq!(growths.len(), octree.nodes.len());
        assert!(growths.values().all(|growths| *growths == Growths::default()), "seed {seed}");
    }
    let octree = random(1, 10);
    let (id, chunk) = (NodeId(0), page(&octree, NodeId(0)));
    let same = scaled(&chunk, cube_center(&octree, id), &Growths::default());
    assert!(Arc::ptr_eq(chunk.radii.as_ref().unwrap(), same.radii.as_ref().unwrap()));
}

#[test]
fn a_root_alone_stands_for_all_points_of_each_octant() {
    let octree = random(4, 200);
    let drawn = drawn(&octree, |id| id.0 == 0);
    let growths = growths(&octree, &drawn)[&NodeId(0)];
    let mut grown = 0;
    for octant in 0..8 {
        let own = f64::from(drawn[&NodeId(0)].own[octant]);
        let below = octree.nodes[0].children[octant].map_or(0, |child| octree.node(child).total) as f64;
        let scale = ((own + below) / own).sqrt();
        assert_eq!(f64::from(growths[octant].eighths), (8.0 * scale.log2()).round(), "octant {octant}");
        grown += usize::from(growths[octant].eighths > 0);
    }
    assert!(grown >= 3, "the test would prove nothing");
}

#[test]
fn an_octant_counts_all_that_is_drawn_below_it() {
    let octree = terrain(2);
    // The root, one child and one of its children: of the first octant's 256/4 + 256 + 4 * 256 points, 64 + 256 + 256 are drawn.
    let child = octree.nodes[0].children[0].unwrap();
    let grandchild = octree.node(child).children[3].unwrap();
    let mut all = BTreeMap::new();
    for id in [NodeId(0), child, grandchild] {
        let own = count_octants(&terrain_page(&octree, id), cube_center(&octree, id));
        all.insert(id, Drawn { own, drawn: own });
    }
    let growths = growths(&octree, &all);
    let eighths = |id: NodeId| growths[&id].map(|growth| growth.eighths);
    let of = |total: f64, drawn: f64| (4.0 * (total / drawn).log2()).round() as u8;
    let nothing_below = of(64.0 + 1280.0, 64.0);
    assert_eq!(eighths(NodeId(0))[..4], [of(64.0 + 1280.0, 64.0 + 512.0), nothing_below, nothing_below, nothing_below]);
    let nothing_below = of(64.0 + 256.0, 64.0);
    assert_eq!(eighths(child)[..4], [nothing_below, nothing_below, nothing_below, 0]);
    assert_eq!(growths[&grandchild], Growths::default());
}

#[test]
fn what_lies_below_a_node_that_is_not_drawn_counts() {
    let octree = terrain(2);
    let whole = |id| {
        let own = count_octants(&terrain_page(&octree, id), cube_center(&octree, id));
        (id, Drawn { own, drawn: own })
    };
    // As when the page of the node between cannot be read.
    let grandchild = octree.node(octree.nodes[0].children[0].unwrap()).children[0].unwrap();
    let with = growths(&octree, &BTreeMap::from([whole(NodeId(0)), whole(grandchild)]));
    let without = growths(&octree, &BTreeMap::from([whole(NodeId(0))]));
    assert_eq!(with.len(), 2);
    let (with_it, without_it) = (with[&NodeId(0)][0], without[&NodeId(0)][0]);
    assert!(with_it.eighths < without_it.eighths);
    assert_eq!(with_it.largest, without_it.largest, "in most of the octant nothing else is drawn");
    assert_eq!(with[&NodeId(0)][1..], without[&NodeId(0)][1..]);
}

#[test]
fn radii_that_grow_stay_within_the_spacing_of_what_is_drawn_there() {
    let octree = terrain(2);
    let whole = |id| {
        let own = count_octants(&terrain_page(&octree, id), cube_center(&octree, id));
        (id, Drawn { own, drawn: own })
    };
    let [first, second, third, _] = std::array::from_fn(|octant| octree.nodes[0].children[octant].unwrap());
    let leaves = octree.node(first).children.into_iter().flatten();
    // In the first octant all that there is, in the second all but its last level, in the third a quarter of that, in the fourth nothing.
    let mut all: BTreeMap<NodeId, Drawn> =
        [NodeId(0), first, second, third].into_iter().chain(leaves).map(whole).collect();
    all.get_mut(&third).unwrap().drawn = [16, 16, 16, 16, 0, 0, 0, 0];
    let growths = growths(&octree, &all)[&NodeId(0)];
    let spacing = octree.spacing;
    let expected = [(0.0, 0.0), (spacing / 2.0, spacing / 2.0), (spacing, spacing), (spacing, spacing)];
    for (octant, (largest, smallest)) in expected.into_iter().enumerate() {
        let packed = |spacings: f64, share: f64| pack_radius((share * spacings) as f32);
        let growth = growths[octant];
        let bounds = (packed(largest, LARGEST_SPACINGS), packed(smallest, SMALLEST_SPACINGS));
        assert_eq!((growth.largest, growth.smallest), bounds, "octant {octant}");
    }
}

proptest! {
    #[test]
    fn the_scale_is_the_nearest_eighth_of_an_octave(total in 1_u64..1 << 40, share in 0.0..1.0) {
        let drawn = ((total as f64 * share) as u64).clamp(1, total);
        let growth = Growth::new(total, drawn, Spacings::default());
        let octaves = 0.5 * (total as f64 / drawn as f64).log2();
        prop_assert!((f64::from(growth.eighths) / 8.0 - octaves).abs() <= 0.0625 + 1e-9);
    }

    #[test]
    fn more_drawn_never_makes_radii_larger(seed in 0_u64..200, first in 0_u64..1000, second in 0_u64..1000) {
        let octree = random(seed, 60);
        let is_drawn = |salt: u64, id: NodeId| cloud::hash(salt << 32 | u64::from(id.0)).is_multiple_of(3);
        let few = growths(&octree, &drawn(&octree, |id| is_drawn(first, id)));
        let many = growths(&octree, &drawn(&octree, |id| is_drawn(first, id) || is_drawn(second, id)));
        for (id, few) in few {
            prop_assert!((0..8).all(|octant| many[&id][octant].larger(few[octant]) == few[octant]));
        }
    }
}

#[test]
fn extreme_counts_have_a_scale() {
    let eighths = |total, drawn| Growth::new(total, drawn, Spacings::default()).eighths;
    assert_eq!((eighths(0, 0), eighths(5, 0), eighths(3, 5)), (0, 0, 0), "nothing drawn, or too much");
    assert_eq!(eighths(u64::MAX, u64::MAX), 0);
    assert_eq!(eighths(u64::MAX, 1), 255);
}

/// Without bounds.
fn eighths(eighths: u8) -> Growth {
    Growth { eighths, ..Growth::default() }.unbounded()
}

#[test]
fn scaled_radii_are_larger_by_so_many_eighths_of_an_octave() {
    let mut chunk =
        Chunk::new(0, DVec3::new(5.0, 0.0, 0.0), vec![[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [1.0; 3], [1.0; 3]]);
    let radius = cloud::pack_radius(0.5);
    chunk.radii = Some(Arc::new(vec![radius, radius, NO_RADIUS, u16::MAX]));
    let growths = [8, 16, 0, 0, 0, 0, 0, 8].map(eighths);
    let radii = scaled(&chunk, DVec3::new(5.0, 0.0, 0.0), &growths).radii.unwrap();
    assert_eq!(cloud::unpack_radius(radii[0]), Some(1.0));
    assert_eq!(cloud::unpack_radius(radii[1]), Some(2.0));
    assert_eq!(radii[2..], [NO_RADIUS, u16::MAX]);
}

#[test]
fn radii_grow_to_the_bounds_and_none_shrinks() {
    let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[-1.0; 3]; 4]);
    let packed = [0.02, 0.4, 1.5, 30.0].map(cloud::pack_radius);
    chunk.radii = Some(Arc::new(packed.to_vec()));
    let growth = Growth { eighths: 16, largest: cloud::pack_radius(4.0), smallest: cloud::pack_radius(0.1) };
    let radii = scaled(&chunk, DVec3::ZERO, &[growth; 8]).radii.unwrap();
    let radii: Vec<f32> = radii.iter().map(|radius| cloud::unpack_radius(*radius).unwrap()).collect();
    for (radius, expected) in radii.iter().zip([0.1, 1.6, 4.0, 30.0]) {
        assert!((radius / expected - 1.0).abs() < 1e-3, "{radii:?}");
    }
}

#[test]
fn estimated_radii_come_back_when_the_node_is_alone() {
    let octree = terrain(3);
    let (id, chunk) = (NodeId(0), terrain_page(&octree, NodeId(0)));
    let estimated = cloud::pack_radius(30.0);
    let mut radii = vec![estimated; chunk.len()];
    radii[7] = NO_RADIUS;
    to_full_density(&mut radii, &chunk, &octree, id);
    let chunk = Chunk { radii: Some(Arc::new(radii)), ..chunk };
    let center = cube_center(&octree, id);
    let own = count_octants(&chunk, center);
    let growths = growths(&octree, &BTreeMap::from([(id, Drawn { own, drawn: own })]))[&id];
    let radii = scaled(&chunk, center, &growths.map(Growth::unbounded)).radii.unwrap();
    assert_eq!(radii[7], NO_RADIUS);
    for radius in radii.iter().filter(|radius| **radius != NO_RADIUS) {
        assert!((i32::from(*radius) - i32::from(estimated)).unsigned_abs() <= u32::from(EIGHTH / 2 + 1), "{radius}");
    }
}
