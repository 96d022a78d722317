use proptest::prelude::*;

use super::*;
use crate::test_trees::{page, random, terrain, terrain_page};

/// Draws all points of the nodes that `is_drawn` accepts.
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
        // The bounds of synthetic nodes are their cubes.
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

/// The growths in a node's octants that no child covers.
fn growths(octree: &Octree, drawn: &BTreeMap<NodeId, Drawn>, id: NodeId) -> [Growth; 8] {
    let field = Field::new(octree, drawn);
    field.cells[field.indices[&id] as usize].growths
}

/// Draws all points of nodes of [`terrain`].
fn whole(octree: &Octree, ids: impl IntoIterator<Item = NodeId>) -> BTreeMap<NodeId, Drawn> {
    let whole = |id| {
        let own = count_octants(&terrain_page(octree, id), cube_center(octree, id));
        (id, Drawn { own, drawn: own })
    };
    ids.into_iter().map(whole).collect()
}

/// The growth at a position, found from the root.
fn growth_at(field: &Field, position: DVec3) -> Growth {
    field.growth(0, position)
}

#[test]
fn radii_are_as_they_were_where_all_is_drawn() {
    for seed in 0..20 {
        let octree = random(seed, 100);
        let field = Field::new(&octree, &drawn(&octree, |_| true));
        assert_eq!(field.cells.len(), octree.nodes.len());
        for (id, _) in octree.ids() {
            let chunk = page(&octree, id);
            let radii = field.radii(id, &chunk);
            assert!(Arc::ptr_eq(chunk.radii.as_ref().unwrap(), radii.as_ref().unwrap()), "seed {seed}");
        }
    }
}

#[test]
fn a_root_alone_stands_for_all_points_of_each_octant() {
    let octree = random(4, 200);
    let drawn = drawn(&octree, |id| id.0 == 0);
    let growths = growths(&octree, &drawn, NodeId(0));
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
fn points_of_all_levels_grow_alike_at_a_place() {
    let octree = terrain(2);
    let [first, second, third, fourth] = std::array::from_fn(|octant| octree.nodes[0].children[octant].unwrap());
    // The first octant of the root is drawn whole, the second without the last level, the third a quarter of that, and
    // the fourth not at all.
    let leaves = octree.node(first).children.into_iter().flatten();
    let mut drawn = whole(&octree, [NodeId(0), first, second, third].into_iter().chain(leaves));
    drawn.get_mut(&third).unwrap().drawn = [16, 16, 16, 16, 0, 0, 0, 0];
    let field = Field::new(&octree, &drawn);
    let place = |id: NodeId| growth_at(&field, octree.node(id).bounds.center() - DVec3::splat(1e-3));
    assert_eq!(place(first), Growth::default());
    // A square of 16 points a side has 5 times as many in it and below it as itself; a quarter of the root's are in it.
    let spacing = octree.spacing;
    let expected = |all: f64, drawn: f64, spacing: f64| Growth {
        eighths: (4.0 * (all / drawn).log2()).round() as u8,
        largest: pack_radius((LARGEST_SPACINGS * spacing) as f32),
        smallest: pack_radius((SMALLEST_SPACINGS * spacing) as f32),
    };
    assert_eq!(place(second), expected(256.0 * 5.25, 256.0 * 1.25, spacing / 2.0));
    assert_eq!(place(third), expected(256.0 * 5.25, 256.0 * 0.5, spacing));
    assert_eq!(place(fourth), expected(256.0 * 5.25, 64.0, spacing));
    for id in [NodeId(0), second] {
        let chunk = terrain_page(&octree, id);
        let (full, radii) = (chunk.radii.as_ref().unwrap(), field.radii(id, &chunk).unwrap());
        for index in 0..chunk.len() {
            let growth = growth_at(&field, chunk.position(index));
            assert_eq!(radii[index], growth.apply(full[index]));
        }
    }
}

#[test]
fn what_lies_below_a_node_that_is_not_drawn_counts() {
    let octree = terrain(2);
    // As when the page of the node between cannot be read.
    let child = octree.nodes[0].children[0].unwrap();
    let grandchild = octree.node(child).children[0].unwrap();
    let with = Field::new(&octree, &whole(&octree, [NodeId(0), grandchild]));
    let without = Field::new(&octree, &whole(&octree, [NodeId(0)]));
    assert_eq!((with.cells.len(), without.cells.len()), (3, 1));
    let at = |field: &Field, id: NodeId| growth_at(field, octree.node(id).bounds.center() - DVec3::splat(1e-3));
    assert_eq!(at(&with, grandchild), Growth::default(), "a leaf, and there is more than enough above it");
    for other in octree.node(child).children.into_iter().flatten().filter(|other| *other != grandchild) {
        let (with, without) = (at(&with, other), at(&without, other));
        assert_eq!((with.largest, with.smallest), (without.largest, without.smallest));
    }
}

#[test]
fn a_field_changes_for_the_nodes_that_have_points_in_what_changed() {
    let octree = terrain(3);
    let child = octree.nodes[0].children[1].unwrap();
    let grandchild = octree.node(child).children[2].unwrap();
    let level = |most: u8| octree.ids().filter(move |(_, node)| node.level <= most).map(|(id, _)| id);
    let before = Field::new(&octree, &whole(&octree, level(2)));
    assert!(before.changed(&before, &octree).is_empty());
    let one_more = octree.node(grandchild).children[0].unwrap();
    let after = Field::new(&octree, &whole(&octree, level(2).chain([one_more])));
    let path = BTreeSet::from([NodeId(0), child, grandchild, one_more]);
    assert_eq!((after.changed(&before, &octree), before.changed(&after, &octree)), (path.clone(), path));
}

proptest! {
    #[test]
    fn the_scale_is_the_nearest_eighth_of_an_octave(total in 1_u64..1 << 40, share in 0.0..1.0) {
        let drawn = ((total as f64 * share) as u64).clamp(1, total);
        let place = Above { all: drawn as f64, drawn: drawn as f64, spacing: 1.0 };
        let growth = Growth::new(place, Some(total - drawn));
        let octaves = 0.5 * (total as f64 / drawn as f64).log2();
        prop_assert!((f64::from(growth.eighths) / 8.0 - octaves).abs() <= 0.0625 + 1e-9);
    }

    #[test]
    fn fields_of_any_part_of_a_tree_make_nothing_smaller(seed in 0_u64..200, salt in 0_u64..1000) {
        let octree = random(seed, 60);
        let is_drawn = |id: NodeId| cloud::hash(salt << 32 | u64::from(id.0)).is_multiple_of(3);
        let drawn = drawn(&octree, is_drawn);
        let field = Field::new(&octree, &drawn);
        for id in drawn.keys() {
            let chunk = page(&octree, *id);
            let radii = field.radii(*id, &chunk).unwrap();
            prop_assert!(radii.iter().zip(chunk.radii.unwrap().iter()).all(|(grown, radius)| grown >= radius));
        }
    }
}

#[test]
fn extreme_counts_have_a_scale() {
    let eighths = |all: f64, drawn: f64, hidden| Growth::new(Above { all, drawn, spacing: 1.0 }, hidden).eighths;
    assert_eq!((eighths(0.0, 0.0, None), eighths(5.0, 0.0, Some(3)), eighths(3.0, 5.0, None)), (0, 0, 0));
    assert_eq!(eighths(1.0, 1.0, Some(u64::MAX)), 255);
}

/// Applies a growth to a radius in world units.
fn apply(growth: Growth, radius: f32) -> f32 {
    cloud::unpack_radius(growth.apply(pack_radius(radius))).unwrap()
}

#[test]
fn radii_grow_to_the_bounds_and_none_shrinks() {
    let growth = Growth { eighths: 16, largest: pack_radius(4.0), smallest: pack_radius(0.1) };
    for (radius, expected) in [(0.02, 0.1), (0.4, 1.6), (1.5, 4.0), (30.0, 30.0)] {
        assert!((apply(growth, radius) / expected - 1.0).abs() < 0.012, "{radius}");
    }
    let radius = pack_radius(0.5);
    assert_eq!(growth.apply(radius + 7) % RADIUS_SHAPES, 7, "an ellipse stays one");
}

#[test]
fn points_without_a_radius_get_none() {
    let octree = terrain(1);
    let mut chunk = terrain_page(&octree, NodeId(0));
    let mut radii = chunk.radii.take().unwrap().to_vec();
    let field = Field::new(&octree, &whole(&octree, [NodeId(0)]));
    assert_eq!(field.radii(NodeId(0), &chunk), None);
    radii[3] = NO_RADIUS;
    chunk.radii = Some(Arc::new(radii));
    let grown = field.radii(NodeId(0), &chunk).unwrap();
    assert!(grown[3] == NO_RADIUS && grown[4] > chunk.radii.unwrap()[4]);
}

#[test]
fn the_larger_radii_are_those_of_each_point() {
    let radii = |radii: &[u16]| Some(Arc::new(radii.to_vec()));
    let first = radii(&[5, 1, 3]);
    assert_eq!(larger(&first, &radii(&[2, 4])), radii(&[5, 4, 3]));
    let same = larger(&first, &radii(&[5, 0, 2, 9]));
    assert!(Arc::ptr_eq(same.as_ref().unwrap(), first.as_ref().unwrap()));
    let near = |radius: f32, other: f32| is_near(&radii(&[pack_radius(radius)]), &radii(&[pack_radius(other)]));
    for size in [1e-8, 1e-6, 1.0] {
        assert!(
            near(size, size) && near(1.15 * size, size) && near(size, 9.0 * size) && !near(1.7 * size, size),
            "{size}"
        );
    }
    assert!(is_near(&radii(&[0, u16::MAX]), &radii(&[9, u16::MAX])) && !is_near(&radii(&[0, 40_000]), &radii(&[9, 0])));
}

/// The chunk of a node of [`terrain`] with radii of its own density, and its points by octant.
fn estimated(octree: &Octree, id: NodeId) -> (Chunk, Octants) {
    let chunk = terrain_page(octree, id);
    let spacing = octree.spacing_at(octree.node(id).level);
    let mut radii = vec![cloud::pack_radius(spacing as f32); chunk.len()];
    radii[7] = NO_RADIUS;
    let chunk = Chunk { radii: Some(Arc::new(radii)), ..chunk };
    let own = count_octants(&chunk, cube_center(octree, id));
    (chunk, own)
}

#[test]
fn estimated_radii_are_as_they_were_where_the_node_is_alone() {
    let octree = terrain(3);
    let (chunk, own) = estimated(&octree, NodeId(0));
    let field = Field::new(&octree, &BTreeMap::from([(NodeId(0), Drawn { own, drawn: own })]));
    let radii = field.radii_of_density(NodeId(0), &chunk, &own).unwrap();
    assert_eq!(radii[7], NO_RADIUS);
    for (radius, before) in radii.iter().zip(chunk.radii.unwrap().iter()).filter(|(radius, _)| **radius != NO_RADIUS) {
        assert!(
            (i32::from(*radius) - i32::from(*before)).unsigned_abs()
                <= (EIGHTH * i32::from(RADIUS_SHAPES) / 2 + 1).unsigned_abs(),
            "{radius}"
        );
    }
}

#[test]
fn estimated_radii_shrink_to_the_density_of_all_that_is_drawn_whatever_lies_below() {
    // The second tree has a level more, which is not drawn.
    for levels in [2, 3] {
        let octree = terrain(levels);
        let field =
            Field::new(&octree, &whole(&octree, octree.ids().filter(|(_, node)| node.level <= 2).map(|(id, _)| id)));
        for (id, node) in octree.ids().filter(|(_, node)| node.level <= 2) {
            let (chunk, own) = estimated(&octree, id);
            let radii = field.radii_of_density(id, &chunk, &own).unwrap();
            // A square of n points, one of 4 n and one of 16 n.
            let expected = octree.spacing_at(node.level) * (4_f64.powi(i32::from(node.level)) / 21.0).sqrt();
            for radius in radii.iter().filter_map(|radius| cloud::unpack_radius(*radius)) {
                assert!((f64::from(radius) / expected - 1.0).abs() < 0.12, "{id:?}: {radius}, expected {expected}");
            }
        }
    }
}
