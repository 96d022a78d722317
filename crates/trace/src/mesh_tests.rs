//! Tests meshes whose surface is also known in another form.

use cloud::sampling::{Placement, Surface};
use scene::{Mirror, Shape};

use super::*;
use crate::exact::{Albedo, Object};
use crate::{Exact, Geometry};

fn unit(seed: u64) -> f64 {
    let mixed =
        (seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bf0_3635).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Each coordinate is from -1 to 1.
fn random_vector(seed: u64) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| 2.0 * unit(3 * seed + axis) - 1.0))
}

fn random_ray(index: u64, reach: f64) -> Ray {
    Ray::from_eye(random_vector(2 * index) * reach, random_vector(2 * index + 1).normalize_or(DVec3::X))
}

fn vertex(position: DVec3) -> Vertex {
    Vertex { position, albedo: Vec3::splat(0.5), normal: Vec3::ZERO }
}

fn mesh(positions: &[DVec3], triangles: &[[u32; 3]]) -> Mesh {
    Mesh::new(&positions.iter().map(|position| vertex(*position)).collect::<Vec<_>>(), triangles)
}

fn exact(mesh: Mesh) -> Exact {
    Exact::new(Vec::new()).with_meshes(vec![mesh])
}

/// A cuboid of half widths `half` about `center`.
fn cuboid(center: DVec3, half: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let sign = |corner: u32, axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let corners = (0..8).map(|corner| center + half * DVec3::new(sign(corner, 0), sign(corner, 1), sign(corner, 2)));
    let mut triangles = Vec::new();
    for (axis, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
        let (u, v, from) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3), side << axis);
        triangles.extend([[from, from + u, from + u + v], [from, from + u + v, from + v]]);
    }
    (corners.collect(), triangles)
}

/// An octahedron whose edges are halved `levels` times, with its corners moved onto the unit sphere.
fn ball(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut corners = vec![DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let mut triangles = Vec::new();
    for octant in 0..8 {
        triangles.push([0, 1, 2].map(|axis| axis + 3 * (octant >> axis & 1)));
    }
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                corners.push((corners[a as usize] + corners[b as usize]).normalize());
                corners.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (corners, triangles)
}

#[test]
fn twelve_triangles_are_the_six_sides_of_their_box() {
    let half = DVec3::new(1.0, 0.7, 2.3);
    let (corners, triangles) = cuboid(DVec3::ZERO, half);
    let triangles = exact(mesh(&corners, &triangles));
    let sides = DVec3::AXES.into_iter().enumerate().flat_map(|(axis, normal)| {
        let [u, v] = [DVec3::AXES[(axis + 1) % 3] * half, DVec3::AXES[(axis + 2) % 3] * half];
        [normal, -normal].map(|normal| {
            let surface = Surface::Rectangle { corner: normal * half - u - v, edges: [u * 2.0, v * 2.0] };
            Object::new(surface, Placement::ORIGIN, Albedo::Even([0.5; 3]), 0.0)
        })
    });
    let sides = Exact::new(sides.collect());
    // Rays from inside, from outside, from afar.
    let (mut hits, mut misses) = (0, 0);
    for (reach, aimed) in [(0.99, false), (10.0, true), (1e4, true)] {
        for index in 0..4000 {
            let mut ray = random_ray(index, reach);
            ray.origin *= if aimed { DVec3::ONE } else { half };
            if aimed {
                ray.direction = (random_vector(index + 77_777) * 2.5 - ray.origin).normalize();
            }
            let (found, expected) = (triangles.nearest(&ray), sides.nearest(&ray));
            assert_eq!(found.is_some(), expected.is_some(), "{ray:?}");
            let (Some(found), Some(expected)) = (found, expected) else {
                misses += 1;
                continue;
            };
            hits += 1;
            let tolerance = 1e-9 * reach.max(1.0);
            assert!((found.distance - expected.distance).abs() < tolerance, "{found:?} instead of {expected:?}");
            assert!(found.normal.distance(expected.normal) < 1e-12, "{found:?} instead of {expected:?}");
            assert!(triangles.is_blocked(&ray, expected.distance + tolerance));
            assert!(!triangles.is_blocked(&ray, expected.distance - tolerance));
        }
    }
    assert!(hits > 6000 && misses > 1000, "{hits} {misses}");
}

#[test]
fn a_finer_sphere_of_triangles_comes_closer_by_the_square_of_its_edges() {
    let worst = |levels: u32| {
        let (corners, triangles) = ball(levels);
        let scene = exact(mesh(&corners, &triangles));
        let [mut place, mut normal] = [0.0_f64; 2];
        for index in 0..20_000 {
            let hit = scene.nearest(&random_ray(index, 0.3)).expect("the sphere is closed");
            place = place.max((hit.position.length() - 1.0).abs());
            normal = normal.max((hit.normal + hit.position.normalize()).length());
        }
        (place, normal)
    };
    let errors = [3, 4, 5, 6].map(worst);
    for pair in errors.windows(2) {
        let (places, normals) = (pair[0].0 / pair[1].0, pair[0].1 / pair[1].1);
        assert!((3.5..4.5).contains(&places), "{errors:?}");
        // The normal is the triangle's own: its error decreases linearly with the edges.
        assert!((1.7..2.3).contains(&normals), "{errors:?}");
    }
    assert!(errors[3].0 < 2e-3, "{errors:?}");
}

/// Shoots rays from inside a closed mesh at its edges, its corners and anywhere.
fn assert_closed(corners: &[DVec3], triangles: &[[u32; 3]], center: DVec3, rays: u64) {
    let scene = exact(mesh(corners, triangles)).seen_from(center);
    for index in 0..rays {
        let inside = random_vector(2 * index) * 0.2;
        let [a, b, c] = triangles[(unit(index + 1_000_003) * triangles.len() as f64) as usize]
            .map(|corner| corners[corner as usize]);
        let share = unit(index + 5_000_011);
        let target = match index % 4 {
            0 => a.lerp(b, share),
            1 => a,
            2 => a.lerp(b, 0.5),
            _ => a.lerp(b, share).lerp(c, unit(index + 9_000_011)),
        } - center;
        let direction = (target - inside).normalize();
        for ray in [Ray::from_eye(inside, direction), Ray::from_surface(inside, direction)] {
            let hit = scene.nearest(&ray).unwrap_or_else(|| panic!("ray {index} leaves through {target}"));
            assert!(hit.position.distance(target) < 1e-6, "ray {index}: {hit:?} instead of {target}");
            assert!(scene.is_blocked(&ray, hit.distance * 1.001));
        }
        // A ray that leaves the surface inwards hits the other side, not its own.
        let hit = scene.nearest(&Ray::from_surface(target, -direction)).expect("the other side");
        assert!(hit.distance > 0.5, "ray {index} hits where it starts, {hit:?}");
    }
}

#[test]
fn no_ray_leaves_a_closed_mesh_through_its_edges_and_corners() {
    let (corners, triangles) = ball(5);
    // Uneven: all triangles differ.
    let uneven: Vec<DVec3> =
        corners.iter().zip(0..).map(|(corner, index)| *corner * (1.0 + 2e-3 * unit(index))).collect();
    assert_closed(&uneven, &triangles, DVec3::ZERO, 100_000);
    // Large triangles along the axes, where edges lie exactly in the rays' planes.
    let (corners, triangles) = cuboid(DVec3::ZERO, DVec3::ONE);
    assert_closed(&corners, &triangles, DVec3::ZERO, 20_000);
    // In the coordinates of a survey.
    let center = DVec3::new(631_000.0, 5_077_000.0, 100.0);
    let moved: Vec<DVec3> = uneven.iter().map(|corner| *corner + center).collect();
    assert_closed(&moved, &ball(5).1, center, 20_000);
}

#[test]
fn the_tree_finds_what_trying_every_triangle_finds() {
    let corners: Vec<DVec3> = (0..900).map(random_vector).collect();
    // A soup that intersects itself, with some triangles twice.
    let mut triangles: Vec<[u32; 3]> = (0..300).map(|index| [index * 3, index * 3 + 1, index * 3 + 2]).collect();
    triangles.extend_from_within(..50);
    let mesh = mesh(&corners, &triangles);
    let mut hits = 0;
    for index in 0..5000 {
        let ray = random_ray(index, 1.5);
        let local = Local::of(&mesh, &ray, DVec3::ZERO);
        let tried = mesh.triangles.iter().filter_map(|triangle| {
            let crossing = local.as_ref()?.crossing(mesh.positions(triangle))?;
            Some((local.as_ref()?.skipped + crossing.distance, triangle.number))
        });
        let expected = tried.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let found = mesh.nearest(&ray, DVec3::ZERO).map(|hit| (hit.distance, hit.triangle));
        assert_eq!(found, expected, "{ray:?}");
        hits += usize::from(found.is_some());
    }
    assert!(hits > 1000, "{hits}");
}

#[test]
fn what_is_no_triangle_is_left_out_and_counted() {
    let (mut corners, mut triangles) = cuboid(DVec3::ZERO, DVec3::ONE);
    let nowhere = corners.len() as u32;
    // Vertices that no triangle uses do not matter, wherever they are.
    corners.extend([DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e300), DVec3::ZERO]);
    let zero = nowhere + 3;
    let bad = [
        [0, 1, nowhere],
        [0, 1, nowhere + 1],
        [0, 1, 1],
        [0, 7, zero],
        [zero; 3],
        [0, 1, nowhere + 4],
        [u32::MAX, 0, 1],
    ];
    triangles.splice(0..0, bad);
    let mesh = mesh(&corners, &triangles);
    assert_eq!((mesh.len(), mesh.left_out()), (12, bad.len()));
    let scene = exact(mesh);
    for index in 0..2000 {
        let hit = scene.nearest(&random_ray(index, 0.9)).expect("the box is closed");
        assert!((hit.position.abs().max_element() - 1.0).abs() < 1e-12, "{hit:?}");
        assert!(hit.point >= bad.len() as u32, "triangles keep their places: {hit:?}");
    }
}

#[test]
fn an_empty_mesh_and_one_of_a_single_triangle_many_times_are_traced() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| corner + DVec3::splat(0.25));
    let ray = Ray::from_eye(DVec3::new(0.4, 0.4, 3.0), DVec3::NEG_Z);
    for (corners, triangles) in [(&corners[..], &[][..]), (&[], &[[0, 1, 2]])] {
        let mesh = mesh(corners, triangles);
        assert!(mesh.is_empty() && mesh.left_out() == triangles.len());
        let scene = exact(mesh);
        assert!(scene.nearest(&ray).is_none() && !scene.is_blocked(&ray, f64::INFINITY));
    }
    for count in [1, 20_000] {
        let scene = exact(mesh(&corners, &vec![[0, 1, 2]; count]));
        let hit = scene.nearest(&ray).expect("above the triangle");
        assert_eq!((hit.distance, hit.point, hit.normal), (2.75, 0, DVec3::Z));
        assert!(scene.nearest(&Ray { direction: DVec3::NAN, ..ray }).is_none());
        assert!(scene.nearest(&Ray { origin: DVec3::INFINITY, ..ray }).is_none());
    }
}

#[test]
fn colours_and_normals_of_the_corners_are_interpolated() {
    let [red, green, blue] = [Vec3::X, Vec3::Y, Vec3::Z];
    let normals = [Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, -0.6, 0.8), Vec3::Z];
    let corner = |position, albedo, normal| Vertex { position, albedo, normal };
    let mut corners =
        [corner(DVec3::ZERO, red, normals[0]), corner(DVec3::X, green, normals[1]), corner(DVec3::Y, blue, normals[2])];
    let at = |corners: &[Vertex; 3], z: f64| {
        let ray = Ray::from_eye(DVec3::new(0.25, 0.125, z), DVec3::NEG_Z * z.signum());
        exact(Mesh::new(corners, &[[0, 1, 2]])).nearest(&ray).expect("over the triangle")
    };
    let shares = [0.625, 0.25, 0.125];
    let smooth: DVec3 = normals.iter().zip(shares).map(|(normal, share)| normal.as_dvec3() * share).sum();
    for side in [1.0, -1.0] {
        let hit = at(&corners, side);
        assert!(hit.albedo.distance(DVec3::from(shares)) < 1e-12, "{hit:?}");
        assert!(hit.normal.distance(smooth.normalize() * side) < 1e-6, "on the side of the ray: {hit:?}");
    }
    // Wound or turned the other way, it is the same surface.
    corners.iter_mut().for_each(|corner| corner.normal = -corner.normal);
    assert!(at(&corners, 1.0).normal.distance(smooth.normalize()) < 1e-6);
    // As soon as one corner's normal is unknown, the triangle's own counts.
    corners[1].normal = Vec3::ZERO;
    assert_eq!(at(&corners, 1.0).normal, DVec3::Z);
}

#[test]
fn formulas_stand_among_triangles_anywhere_in_the_world() {
    let center = DVec3::new(500_000.0, 5_000_000.0, 300.0);
    let (corners, triangles) = cuboid(center, DVec3::splat(3.0));
    let sphere = Mirror::standing(Shape::Sphere, center, DVec3::Z, DVec3::Z, 1.0);
    let scene = Exact::of_mirrors(std::slice::from_ref(&sphere)).with_meshes(vec![mesh(&corners, &triangles)]);
    let scene = scene.seen_from(center);
    for index in 0..2000 {
        let direction = random_vector(index).normalize();
        let from = direction * 2.9;
        let top = sphere.position - center;
        let hit = scene.nearest(&Ray::from_eye(from, (top - from).normalize())).expect("the sphere");
        assert!((hit.position.distance(top) - 1.0).abs() < 1e-9 && hit.specular_intensity == 1.0, "{hit:?}");
        assert_eq!(hit.surface, 0);
        // From the mirror to the box about it.
        let out = scene.nearest(&Ray::from_surface(hit.position, hit.normal)).expect("the box");
        assert!((out.position.abs().max_element() - 3.0).abs() < 1e-9 && out.specular_intensity == 0.0, "{out:?}");
        assert_eq!(out.surface, 1);
        assert!(scene.is_blocked(&Ray::from_surface(out.position, -hit.normal), 6.0));
    }
}
