use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::test_trees::{filled, random};

/// What a cut wants of trees whose nodes are all there.
fn choose(trees: &[Tree], measure: impl Fn(usize, &Octree, &Node) -> f64, budget: Budget, finest: f64) -> Vec<Wanted> {
    let cut = super::choose(trees, measure, budget, finest);
    assert!(cut.unread.is_empty());
    cut.wanted
}

const EVERYTHING: Budget = Budget { points: u64::MAX, bytes: u64::MAX };

fn trees(octrees: &[Octree]) -> Vec<Tree<'_>> {
    octrees.iter().enumerate().map(|(cloud, octree)| Tree { cloud, octree, point_bytes: 20 }).collect()
}

/// A view down -z from `eye`, above the corner of a cube of width 1024.
fn view(eye: DVec3, unseen: f64) -> ViewMeasure {
    let down = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::NEG_Z).transpose();
    ViewMeasure::perspective(eye, down, DVec2::new(1.0, 1.0), 1000.0, unseen)
}

fn by_view(view: &ViewMeasure) -> impl Fn(usize, &Octree, &Node) -> f64 {
    |_, octree, node| view.pixels(octree, node)
}

fn used(octrees: &[Octree], cut: &[Wanted]) -> Budget {
    let points =
        cut.iter().map(|w| prefix(octrees[w.cloud].node(w.node).points as usize, w.batches) as u64).sum::<u64>();
    Budget { points, bytes: points * 20 }
}

proptest! {
    #[test]
    fn budgets_hold_and_parents_come_first(
        seed in 0_u64..1000, points in 0_u64..200_000, bytes in 0_u64..4_000_000, eye in prop::array::uniform3(-200.0..1300.0),
        finest in 0.0..20.0,
    ) {
        let octrees = [random(seed, 300), random(seed + 1, 30)];
        let view = view(eye.into(), 0.25);
        let budget = Budget { points, bytes };
        let cut = choose(&trees(&octrees), by_view(&view), budget, finest);
        let used = used(&octrees, &cut);
        prop_assert!(used.points <= points && used.bytes <= bytes);
        for (place, wanted) in cut.iter().enumerate() {
            let is_same = |other: &Wanted, node| other.cloud == wanted.cloud && other.node == node;
            prop_assert!((1..=BATCHES).contains(&wanted.batches));
            prop_assert!(!cut[..place].iter().any(|other| is_same(other, wanted.node)), "twice");
            if let Some(parent) = octrees[wanted.cloud].node(wanted.node).parent {
                prop_assert!(cut[..place].iter().any(|other| is_same(other, parent) && other.batches == BATCHES));
            }
        }
    }

    #[test]
    fn more_budget_never_shows_less_of_any_place(
        seed in 0_u64..1000, points in 0_u64..400_000, more in 0_u64..100_000, bytes in 0_u64..8_000_000, eye in prop::array::uniform3(-200.0..1300.0),
    ) {
        let octrees = [random(seed, 300), random(seed + 1, 30), random(seed + 2, 5)];
        let view = view(eye.into(), 0.25);
        let cut = |points, bytes| -> BTreeMap<(usize, NodeId), usize> {
            choose(&trees(&octrees), by_view(&view), Budget { points, bytes }, 0.5)
                .into_iter().map(|w| ((w.cloud, w.node), w.batches)).collect()
        };
        for larger in [cut(points + more, bytes), cut(points, bytes + more * 20)] {
            for (node, batches) in cut(points, bytes) {
                prop_assert!(larger.get(&node).is_some_and(|other| *other >= batches), "{node:?}");
            }
        }
    }

    #[test]
    fn the_same_view_gives_the_same_cut(seed in 0_u64..1000, eye in prop::array::uniform3(-200.0..1300.0)) {
        let octrees = [random(seed, 300)];
        let view = view(eye.into(), 0.25);
        let budget = Budget { points: 100_000, bytes: u64::MAX };
        let cut = || choose(&trees(&octrees), by_view(&view), budget, 1.0);
        prop_assert_eq!(cut(), cut());
    }
}

#[test]
fn everything_is_chosen_where_nothing_is_limited() {
    let octrees = [filled(4, 1000), random(3, 200)];
    let view = view(DVec3::new(500.0, 500.0, 3000.0), 0.25);
    let cut = choose(&trees(&octrees), by_view(&view), EVERYTHING, 0.0);
    assert_eq!(cut.len(), octrees.iter().map(|octree| octree.nodes.len()).sum::<usize>());
    assert!(cut.iter().all(|wanted| wanted.batches == BATCHES));
}

#[test]
fn a_node_is_wanted_where_its_parents_points_lie_too_far_apart() {
    let octrees = [filled(5, 1000)];
    let view = view(DVec3::new(500.0, 500.0, 1500.0), 0.25);
    let finest = 4.0;
    let cut = choose(&trees(&octrees), by_view(&view), EVERYTHING, finest);
    let chosen = |id| cut.iter().any(|wanted| wanted.node == id);
    let mut coarse = 0;
    for (id, node) in octrees[0].ids().skip(1) {
        // The tree is regular and the measure falls towards the leaves: every parent of a wanted node is wanted.
        assert_eq!(chosen(id), 2.0 * view.pixels(&octrees[0], node) > finest, "{id:?}");
        coarse += usize::from(!chosen(id));
    }
    assert!(coarse > 100, "the test would prove nothing");
}

#[test]
fn the_nearest_and_the_seen_are_finest() {
    let octrees = [filled(5, 1000)];
    // The eye is over the corner at the origin and looks down: places at x or y above 600 are out of the picture.
    let eye = DVec3::new(100.0, 100.0, 1500.0);
    let view = view(eye, 0.25);
    let cut = choose(&trees(&octrees), by_view(&view), Budget { points: 400_000, bytes: u64::MAX }, 0.0);
    let last = cut.last().unwrap();
    let pixels = |id: NodeId| view.pixels(&octrees[0], octrees[0].node(id));
    for wanted in &cut {
        assert!(pixels(wanted.node) >= pixels(last.node), "coarse to fine");
    }
    for (id, node) in octrees[0].ids() {
        let parent_is_in =
            node.parent.is_some_and(|parent| cut.iter().any(|w| w.node == parent && w.batches == BATCHES));
        if parent_is_in && !cut.iter().any(|wanted| wanted.node == id) {
            assert!(pixels(id) <= pixels(last.node), "{id:?} matters more than what was chosen");
        }
    }
}

#[test]
fn unseen_nodes_count_as_much_as_they_are_told_to() {
    let octree = filled(3, 1000);
    let eye = DVec3::new(100.0, 100.0, 2000.0);
    let behind = octree.nodes.iter().position(|node| node.level == 2 && node.bounds.min.z == 0.0).unwrap();
    let up = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::Z).transpose();
    let seen = view(eye, 0.3).pixels(&octree, &octree.nodes[behind]);
    let unseen = |weight| {
        let view = ViewMeasure::perspective(eye, up, DVec2::ONE, 1000.0, weight);
        view.pixels(&octree, &octree.nodes[behind])
    };
    assert!(seen > 0.0);
    assert!((unseen(0.3) / seen - 0.3).abs() < 1e-12);
    assert_eq!(unseen(0.0), 0.0);
    // A tree out of view gives only its root, but that always.
    let view = ViewMeasure::perspective(eye, up, DVec2::ONE, 1000.0, 0.0);
    let octrees = [octree];
    assert_eq!(choose(&trees(&octrees), by_view(&view), EVERYTHING, 0.0).len(), 1);
}

#[test]
fn spacing_on_the_screen_is_that_of_the_projection() {
    let octree = filled(3, 1000);
    let down = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::NEG_Z).transpose();
    let eye = DVec3::new(512.0, 512.0, 2024.0);
    // The root's points are 8 apart; 1000 pixels over 2 * 1000 units at a distance of 1000.
    assert_eq!(octree.spacing, 8.0);
    let pixels = view(eye, 1.0).pixels(&octree, &octree.nodes[0]);
    assert!((pixels - 4.0).abs() < 1e-9, "{pixels}");
    let parallel = ViewMeasure::parallel(eye, down, DVec2::new(100.0, 50.0), 1000.0, 0.5);
    assert!((parallel.pixels(&octree, &octree.nodes[0]) - 80.0).abs() < 1e-9);
    let corner = octree.nodes.iter().find(|node| node.level == 2 && node.bounds.min == DVec3::ZERO).unwrap();
    assert!((parallel.pixels(&octree, corner) - 0.5 * 20.0).abs() < 1e-9, "out of the picture");
}

#[test]
fn a_picture_sees_boxes_that_reach_into_it() {
    let view = view(DVec3::new(0.0, 0.0, 10.0), 0.25);
    let is_seen = |min: [f64; 3], max: [f64; 3]| view.sees(Bounds { min: min.into(), max: max.into() });
    assert!(is_seen([-1.0; 3], [1.0; 3]));
    assert!(is_seen([-100.0; 3], [100.0; 3]), "the eye is in it");
    assert!(is_seen([9.0, -1.0, -1.0], [20.0, 1.0, 1.0]), "over the edge");
    assert!(!is_seen([12.0, -1.0, -1.0], [20.0, 1.0, 1.0]), "beside");
    assert!(!is_seen([-1.0, -1.0, 11.0], [1.0, 1.0, 12.0]), "behind");
}

#[test]
fn another_measure_chooses_other_nodes() {
    // The view in a mirror in the plane x = 0: from the eye's mirror image, without nodes that are not seen in it.
    let octrees = [filled(4, 1000)];
    let budget = Budget { points: 60_000, bytes: u64::MAX };
    let finest_near = |eye: DVec3| {
        let measure = |_: usize, octree: &Octree, node: &Node| {
            let nearest = eye.clamp(node.bounds.min, node.bounds.max).distance(eye);
            1000.0 * octree.spacing_at(node.level) / nearest.max(1.0)
        };
        let cut = choose(&trees(&octrees), measure, budget, 0.0);
        let deepest: Vec<DVec3> = (cut.iter().map(|wanted| octrees[0].node(wanted.node)))
            .filter(|node| node.level == 4)
            .map(|node| node.bounds.center())
            .collect();
        deepest.iter().sum::<DVec3>() / deepest.len() as f64
    };
    assert!(finest_near(DVec3::new(-10.0, 0.0, 0.0)).x < 350.0);
    assert!(finest_near(DVec3::new(1034.0, 0.0, 0.0)).x > 674.0);
}

#[test]
fn measures_that_are_no_numbers_choose_nothing_but_roots() {
    let octrees = [filled(3, 1000)];
    for value in [f64::NAN, 0.0, -1.0] {
        assert_eq!(choose(&trees(&octrees), |_, _, _| value, EVERYTHING, 0.0).len(), 1, "{value}");
    }
    assert_eq!(choose(&trees(&octrees), |_, _, _| f64::INFINITY, EVERYTHING, 1.0).len(), octrees[0].nodes.len());
}

#[test]
fn roots_share_a_budget_that_is_too_small_for_them() {
    let octrees = [filled(2, 1600), filled(2, 800), filled(2, 400)];
    let view = view(DVec3::new(500.0, 500.0, 3000.0), 0.25);
    let cut = |points| choose(&trees(&octrees), by_view(&view), Budget { points, bytes: u64::MAX }, 0.0);
    assert_eq!(cut(1400).iter().map(|w| w.batches).collect::<Vec<_>>(), [8, 8, 8]);
    assert_eq!(cut(100).len(), 1, "the first batch of the first");
    assert_eq!(cut(99).len(), 0);
    assert_eq!(cut(2800).len(), 3);
    assert!(cut(2900).len() > 3);
}

#[test]
fn trees_without_nodes_are_left_out() {
    let empty = Octree { nodes: Vec::new(), ..filled(0, 10) };
    let octrees = [empty, filled(0, 10)];
    let cut = choose(&trees(&octrees), |_, _, _| 1.0, EVERYTHING, 0.0);
    assert_eq!(cut, [Wanted { cloud: 1, node: NodeId(0), batches: BATCHES }]);
}

#[test]
fn a_camera_that_moves_a_little_changes_little() {
    let octrees = [filled(6, 1000)];
    let budget = Budget { points: 500_000, bytes: u64::MAX };
    let cut = |x: f64| -> std::collections::BTreeSet<NodeId> {
        let view = view(DVec3::new(x, 500.0, 1200.0), 0.25);
        choose(&trees(&octrees), by_view(&view), budget, 0.0).into_iter().map(|wanted| wanted.node).collect()
    };
    let before = cut(400.0);
    // The eye moves by a tenth of a percent of its distance.
    let after = cut(400.2);
    let changed = before.symmetric_difference(&after).count();
    assert!(before.len() > 400 && changed * 20 < before.len(), "{changed} of {}", before.len());
}

#[test]
#[ignore = "prints how long a cut takes"]
fn time_of_a_cut() {
    let octrees = [filled(8, 30_000)];
    let nodes = octrees[0].nodes.len();
    let view = view(DVec3::new(400.0, 500.0, 1100.0), 0.25);
    for (points, finest) in [(u64::MAX, 0.0), (300_000_000, 0.0), (30_000_000, 0.0), (10_000_000, 1.0)] {
        let budget = Budget { points, bytes: u64::MAX };
        let mut times: Vec<f64> = Vec::new();
        let mut chosen = 0;
        for _ in 0..21 {
            let started = std::time::Instant::now();
            chosen = choose(&trees(&octrees), by_view(&view), budget, finest).len();
            times.push(started.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        println!("{chosen} of {nodes} nodes chosen in {:.2} ms (median of 21), {:.2} at best", times[10], times[0]);
    }
}

/// A view from the corner of the world along +z, away from everything else in these tests.
fn away(eye: DVec3) -> ViewMeasure {
    let up = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::Z).transpose();
    ViewMeasure::perspective(eye, up, DVec2::ONE, 1000.0, 0.0)
}

fn mirror(center: DVec3, radius: f64, form: MirrorForm) -> MirrorBound {
    MirrorBound { center, radius, form }
}

#[test]
fn a_flat_mirror_asks_for_what_it_shows_as_a_camera_behind_it_would() {
    let octree = filled(3, 1000);
    let eye = DVec3::new(500.0, 500.0, 2000.0);
    let flat = mirror(DVec3::new(500.0, 500.0, 3000.0), 800.0, MirrorForm::Flat(DVec3::NEG_Z));
    let image = view(DVec3::new(500.0, 500.0, 4000.0), 0.0);
    let (bare, reflected) = (away(eye), away(eye).with_mirrors([flat]));
    for (_, node) in octree.ids() {
        assert_eq!(bare.pixels(&octree, node), 0.0);
        assert_eq!(reflected.pixels(&octree, node), image.pixels(&octree, node));
    }
    // Not what lies behind it, nor what lies beside its frame, nor anything once it has left the picture.
    let behind = MirrorBound { center: DVec3::new(500.0, 500.0, -10.0), ..flat };
    let aside = MirrorBound { form: MirrorForm::Flat(DVec3::new(0.6, 0.0, -0.8)), radius: 10.0, ..flat };
    let out = MirrorBound { center: DVec3::new(500.0, 9000.0, 2500.0), ..flat };
    for useless in [behind, aside, out] {
        let measure = away(eye).with_mirrors([useless]);
        assert!(octree.ids().all(|(_, node)| measure.pixels(&octree, node) == 0.0), "{useless:?}");
    }
}

#[test]
fn what_a_mirror_shows_counts_no_less_than_the_share_and_no_more_than_in_the_picture() {
    let octree = filled(3, 1000);
    let eye = DVec3::new(500.0, 500.0, 2000.0);
    let at = DVec3::new(500.0, 500.0, 2600.0);
    let root = octree.node(NodeId(0));
    let pixels = |mirrors: &[MirrorBound]| away(eye).with_mirrors(mirrors.iter().copied()).pixels(&octree, root);
    let [small, large, other] = [(100.0, MirrorForm::Sphere), (400.0, MirrorForm::Sphere), (100.0, MirrorForm::Other)]
        .map(|(radius, form)| pixels(&[mirror(at, radius, form)]));
    assert!(0.0 < small && small < large && large < other, "{small} {large} {other}");
    assert_eq!(pixels(&[mirror(at, 100.0, MirrorForm::Sphere), mirror(at, 100.0, MirrorForm::Other)]), other);
    assert!(other < view(eye, 0.0).pixels(&octree, root));
    let shared = ViewMeasure { unseen: 0.25, ..away(eye) };
    let share = shared.pixels(&octree, root);
    assert_eq!(shared.with_mirrors([mirror(at, 100.0, MirrorForm::Sphere)]).pixels(&octree, root), share.max(small));
}

/// Where a ray from `eye` meets a sphere or the plane of a flat mirror, and its direction after that.
fn reflect(mirror: &MirrorBound, eye: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
    let offset = eye - mirror.center;
    let (distance, normal) = match mirror.form {
        MirrorForm::Flat(normal) => (-normal.dot(offset) / normal.dot(direction), normal),
        _ => {
            let half = offset.dot(direction);
            let root = half * half - offset.length_squared() + mirror.radius * mirror.radius;
            let distance = -half - (root >= 0.0).then(|| root.sqrt())?;
            (distance, (offset + distance * direction) / mirror.radius)
        }
    };
    let is_met = distance > 0.0 && (offset + distance * direction).length() <= mirror.radius * (1.0 + 1e-9);
    is_met.then(|| (eye + distance * direction, direction - 2.0 * normal.dot(direction) * normal))
}

proptest! {
    /// The area that a pixel shows in a mirror, by rays: the measure never takes it for larger than it is.
    #[test]
    fn nothing_in_a_mirror_is_taken_for_smaller_than_rays_find_it(
        is_flat: bool, radius in 0.1..5.0, distance in 5.5..30.0, place in prop::array::uniform2(-0.95..0.95),
        tilt in prop::array::uniform2(-0.9..0.9), way in 0.1..40.0,
    ) {
        let eye = DVec3::new(3.0, -2.0, 1.0);
        let normal = DVec3::new(tilt[0], tilt[1], -1.0).normalize();
        let form = if is_flat { MirrorForm::Flat(normal) } else { MirrorForm::Sphere };
        let mirror = mirror(eye + DVec3::Z * distance, radius, form);
        let toward = |x: f64, y: f64| DVec3::new(x, y, distance / radius).normalize();
        let ray = |x, y| reflect(&mirror, eye, toward(x, y));
        let Some((hit, direction)) = ray(place[0], place[1]) else { return Ok(()) };
        let seen: DVec3 = hit + way * direction;
        // Where rays a little beside it meet the plane across it, by the angle between them.
        let mut across = [DVec3::ZERO; 2];
        for (step, across) in [[1e-5, 0.0], [0.0, 1e-5]].into_iter().zip(&mut across) {
            let (x, y) = (place[0] + step[0], place[1] + step[1]);
            let Some((hit, turned)) = ray(x, y) else { return Ok(()) };
            let along = (seen - hit).dot(direction) / turned.dot(direction);
            *across = hit + along * turned - seen;
        }
        let [a, b] = [[1e-5, 0.0], [0.0, 1e-5]].map(|step| toward(place[0] + step[0], place[1] + step[1]));
        let angle = (a - toward(place[0], place[1])).cross(b - toward(place[0], place[1])).length();
        let footprint = (across[0].cross(across[1]).length() / angle).sqrt();
        let spacing = 1e-6;
        let measure = away(eye).with_mirrors([mirror]);
        prop_assert_eq!(measure.mirrors.len(), 1);
        let pixels = measure.reflected_pixels(&mirror, Bounds { min: seen, max: seen }, spacing);
        prop_assert!(pixels >= 500.0 * spacing / footprint * 0.999, "{pixels} of {}", 500.0 * spacing / footprint);
    }
}
