//! Tests of the bundles: against closed forms and a search of all pixels, then the GPU against the CPU.

use std::sync::Arc;

use cloud::{Bounds, Chunk, pack_normal, pack_radius};
use glam::{DVec2, DVec3, UVec2, Vec3};
use scene::five_mirrors::{Variant, camera};
use scene::{BundleCull, BundleRest, BundleSplat, JudgedBy, Mirror, SampleCameras as Parameters, Settings};

use super::SampleCameras;
use super::twin::{Bundles, Root};
use crate::Gpu;
use crate::frame::FrameCamera;
use crate::inputs::Inputs;
use crate::layout::{COUNTERS, POINTS_FOUND, POINTS_TRIED, POINTS_UNCONVERGED, RAYS_LEFT, REGIONS};
use crate::recorder::{Pipelines, Recorder};
use crate::reflection::Bounce;
use crate::reflection::forward::{Forward, SolutionKey};
use crate::reflection::gather::Gather;
use crate::reflection::sscr::exact_mirrors::{fill, picture, wall_points};
use crate::reflection::sscr::twin::{MirrorPicture, MirrorPixel, mapped_error, reflected_in_mirror_space};
use crate::reflection::surfel_index::SurfelIndex;
use crate::reflection::task::Task;
use crate::store::draw_list::Selection;
use crate::store::{Material, PointStore};
use crate::targets::{Image, storage};

const SMALL: UVec2 = UVec2::new(200, 150);
pub const RADIUS: f32 = 0.002;
/// The radius of the scene, for what is measured in it.
const SCENE_RADIUS: f32 = 2.5;

/// All points and roots, with splats as large as pixels.
pub fn all_points() -> Parameters {
    Parameters { points_per_pixel: 0.0, roots: 16, rest: BundleRest::None, ..Parameters::default() }
}

/// The box of the walls, relative to the eye.
pub fn walls() -> Bounds {
    let eye = camera().eye;
    Bounds { min: DVec3::new(-1.0, -1.0, -2.0) - eye, max: DVec3::new(1.0, 1.0, 2.0) - eye }
}

fn bundles<'a>(picture: &'a MirrorPicture, settings: &'a Parameters) -> Bundles<'a> {
    Bundles::new(picture, settings, walls(), SCENE_RADIUS.into())
}

pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// How far a root is from where the error of the law of reflection vanishes, by the pixels about it.
fn law_error(picture: &MirrorPicture, q: Vec3, root: &Root) -> Option<f64> {
    let error_at = |at: UVec2| {
        let pixel = picture.pixels.get((at.y * picture.size.x + at.x) as usize)?.as_ref()?;
        Some(mapped_error(reflected_in_mirror_space(pixel, Vec3::X, q)).as_dvec2())
    };
    let at = root.at.as_uvec2();
    let here = error_at(at)?;
    let slope = |side: UVec2| Some((error_at(at + side)? - error_at(at.wrapping_sub(side))?) * 0.5);
    let (along_x, along_y) = (slope(UVec2::X)?, slope(UVec2::Y)?);
    let determinant = along_x.perp_dot(along_y);
    let step = DVec2::new(here.perp_dot(along_y), along_x.perp_dot(here)) / determinant;
    let rest = at.as_dvec2() + 0.5 - step - root.at;
    // Beside the ray, over the width of a pixel there: finite where rays meet.
    let beside = rest.x * along_x + rest.y * along_y;
    Some(beside.length() / along_x.length().max(along_y.length()))
}

/// Whether a place and all pixels two beside it are on the mirror: beyond the outermost pixels no ray is known.
fn is_inside(picture: &MirrorPicture, at: DVec2) -> bool {
    let is_mirror = |x: f64, y: f64| {
        let (at, size) = (at + DVec2::new(x, y), picture.size.as_dvec2());
        let is_in = at.min_element() >= 0.0 && at.cmplt(size).all();
        is_in && picture.pixels[(at.y as u32 * picture.size.x + at.x as u32) as usize].is_some()
    };
    let sides = [-2.0, -1.0, 0.0, 1.0, 2.0];
    sides.into_iter().flat_map(|y| sides.map(|x| (x, y))).all(|(x, y)| is_mirror(x, y))
}

/// The cells between four pixel middles about whose root the error turns once.
fn searched_roots(picture: &MirrorPicture, q: Vec3) -> usize {
    let error_at = |x: u32, y: u32| {
        let pixel = picture.pixels[(y * picture.size.x + x) as usize].as_ref()?;
        let is_before = (q - pixel.point).dot(pixel.normal) > 0.0;
        is_before.then(|| mapped_error(reflected_in_mirror_space(pixel, Vec3::X, q)).as_dvec2())
    };
    let has_root = |(x, y): (u32, u32)| {
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(right, down)| error_at(x + right, y + down));
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return false };
        let turn = [(a, b), (b, c), (c, d), (d, a)].map(|(from, to)| from.angle_to(to)).iter().sum::<f64>();
        let is_root = (turn.abs() - std::f64::consts::TAU).abs() < 0.1;
        is_root && is_inside(picture, DVec2::new(f64::from(x), f64::from(y)) + 1.0)
    };
    (0..picture.size.y - 1)
        .flat_map(|y| (0..picture.size.x - 1).map(move |x| (x, y)))
        .filter(|at| has_root(*at))
        .count()
}

/// The place on the sphere that reflects a point to the eye: where the angles of both to the normal are equal.
pub fn place_on_sphere(center: DVec3, radius: f64, q: DVec3) -> Option<DVec3> {
    let (to_eye, to_point) = (-center, q - center);
    let (first, across) = (to_eye.normalize(), to_point.reject_from(to_eye).normalize_or_zero());
    let most = to_eye.angle_between(to_point);
    let at = |angle: f64| center + radius * (first * angle.cos() + across * angle.sin());
    let imbalance = |angle: f64| {
        let place = at(angle);
        let normal = (place - center) / radius;
        normal.angle_between(-place) - normal.angle_between(q - place)
    };
    let (mut low, mut high) = (0.0, most);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if imbalance(middle) < 0.0 { low = middle } else { high = middle }
    }
    let place = at(low);
    let normal = (place - center) / radius;
    (normal.dot(-place) > 0.0 && normal.dot(q - place) > 0.0).then_some(place)
}

/// The pixel coordinate of a place that the scene's camera sees.
pub fn on_screen(place: DVec3, size: UVec2) -> DVec2 {
    let focal = f64::from(size.y) * 0.5 / 30.0_f64.to_radians().tan();
    let size = size.as_dvec2();
    DVec2::new(size.x * 0.5 - place.x * focal / place.z, size.y * 0.5 + place.y * focal / place.z)
}

#[test]
fn roots_on_a_sphere_are_where_angles_are_equal() {
    let picture = picture(Variant::Sphere, UVec2::new(400, 300));
    let settings = all_points();
    let bundles = bundles(&picture, &settings);
    let center = -camera().eye;
    let (mut errors, mut lost) = (Vec::new(), 0);
    for q in wall_points(3000) {
        let q = q.as_dvec3();
        let roots = bundles.roots(q, RADIUS.into());
        assert!(roots.len() <= 1, "a ball reflects each point once: {roots:?}");
        let truth = place_on_sphere(center, 0.43, q).map(|place| on_screen(place, picture.size));
        match (truth, roots.first()) {
            (Some(truth), Some(root)) => errors.push(truth.distance(root.at)),
            (None, Some(root)) => panic!("{q} is not seen in the ball, but found at {root:?}"),
            (truth, None) => lost += usize::from(truth.is_some_and(|truth| is_inside(&picture, truth))),
        }
    }
    assert!(errors.len() > 2000 && lost * 200 < errors.len(), "{} found, {lost} lost", errors.len());
    let (median, most) = (quantile(errors.clone(), 0.5), quantile(errors, 0.99));
    assert!(median < 0.15 && most < 0.5, "{median} {most}");
}

/// A tilted plane through a place before the eye: the picture of the mirror, its normal, and that place.
pub fn plane_picture(size: UVec2) -> (MirrorPicture, DVec3, DVec3) {
    let distance = 1.5;
    let focal = f64::from(size.y) * 0.5 / 30.0_f64.to_radians().tan();
    let (normal, middle) = (DVec3::new(0.3, -0.2, 1.0).normalize(), DVec3::new(0.0, 0.0, -distance));
    let pixel = |index: u32| {
        let at = DVec2::new(f64::from(index % size.x), f64::from(index / size.x)) + 0.5 - size.as_dvec2() * 0.5;
        let ray = DVec3::new(at.x, -at.y, -focal).normalize();
        let point = ray * (middle.dot(normal) / ray.dot(normal));
        let (point, normal) = (point.as_vec3(), normal.as_vec3());
        Some(MirrorPixel { point, normal, toward_eye: -ray.as_vec3(), linear_depth: -point.z })
    };
    let pixels = (0..size.x * size.y).map(pixel).collect();
    (MirrorPicture { size, pixels, right: Vec3::X, up: Vec3::Y }, normal, middle)
}

#[test]
fn a_plane_projects_as_a_pinhole_at_the_mirrored_eye() {
    let size = SMALL;
    let (picture, normal, middle) = plane_picture(size);
    let mirrored = normal * (2.0 * middle.dot(normal));
    for judged_by in [JudgedBy::Solve, JudgedBy::Ray] {
        let settings = Parameters { judged_by, accuracy: 0.25, ..all_points() };
        let bundles = bundles(&picture, &settings);
        assert!(bundles.leaves.iter().all(|leaf| leaf.is_exact) && bundles.leaves.len() < 50);
        let mut errors = Vec::new();
        for q in wall_points(2000) {
            let q = q.as_dvec3();
            // On the line from the mirrored eye.
            let share = (middle - mirrored).dot(normal) / (q - mirrored).dot(normal);
            let truth = on_screen(mirrored + (q - mirrored) * share, size);
            let is_seen =
                share > 0.0 && share < 1.0 && truth.cmpgt(DVec2::ZERO).all() && truth.cmplt(size.as_dvec2()).all();
            match &bundles.roots(q, RADIUS.into())[..] {
                [root] => {
                    assert!(root.at.distance(truth) < 0.25, "{q}: {root:?}, {truth}");
                    errors.push(root.at.distance(truth));
                }
                roots => assert!(roots.is_empty() && !is_seen, "{q}: {roots:?}, {truth}"),
            }
        }
        let (found, median) = (errors.len(), quantile(errors, 0.5));
        assert!(found > 100 && median < 0.05, "{found} {median}");
    }
}

#[test]
fn all_roots_are_found_and_obey_the_law_of_reflection() {
    let points = wall_points(300);
    // The least share of points whose roots are as many as those of a search of all cells, and the bound of the error's
    // 99th percentile.
    for (mirror, least_equal, most) in [
        (Variant::Sphere, 0.95, 0.5),
        (Variant::Parabolic, 0.95, 0.5),
        (Variant::Blob, 0.85, 0.5),
        (Variant::Torus, 0.85, 0.5),
        (Variant::Coral, 0.3, 3.0),
    ] {
        let picture = picture(mirror, SMALL);
        let settings = all_points();
        let bundles = bundles(&picture, &settings);
        let (mut equal, mut errors, mut counts) = (0, Vec::new(), [0, 0]);
        for q in &points {
            let mut roots = bundles.roots(q.as_dvec3(), RADIUS.into());
            roots.retain(|root| is_inside(&picture, root.at));
            let searched = searched_roots(&picture, *q);
            equal += usize::from(roots.len() == searched);
            counts[0] += roots.len();
            counts[1] += searched;
            errors.extend(roots.iter().filter_map(|root| law_error(&picture, *q, root)));
        }
        let p99 = quantile(errors, 0.99);
        let share = equal as f64 / points.len() as f64;
        assert!(share > least_equal && p99 < most, "{mirror:?}: {share} of the points, {counts:?}, {p99} pixels");
    }
}

/// What a frame found.
pub struct Made {
    /// The places and distances of each point, in order.
    pub roots: Vec<Vec<Root>>,
    pub counters: Vec<u32>,
    /// The Mirror G-Buffer's positions, as bits.
    pub position: Vec<[u32; 4]>,
}

/// The normal of the wall on which a point lies.
fn wall_normal(q: Vec3) -> Vec3 {
    let place = (q + camera().eye.as_vec3()) / Vec3::new(1.0, 1.0, 2.0);
    let mut normal = Vec3::ZERO;
    normal[place.abs().max_position()] = 1.0;
    normal
}

/// Finds reflections of points in an exact mirror.
pub fn made(gpu: &Arc<Gpu>, picture: &MirrorPicture, points: &[Vec3], parameters: &Parameters) -> Made {
    made_of(gpu, picture, points, RADIUS, parameters)
}

fn made_of(gpu: &Arc<Gpu>, picture: &MirrorPicture, points: &[Vec3], radius: f32, parameters: &Parameters) -> Made {
    made_with(gpu, picture, &[], points, radius, parameters)
}

/// Finds reflections of points in mirrors of which some have a formula.
pub fn made_with(
    gpu: &Arc<Gpu>,
    picture: &MirrorPicture,
    mirrors: &[Mirror],
    points: &[Vec3],
    radius: f32,
    parameters: &Parameters,
) -> Made {
    let size = picture.size.to_array();
    let mut store = PointStore::new(gpu.clone());
    let cloud = store.add_cloud(Material::default());
    let mut chunk = Chunk::new(0, camera().eye, points.iter().map(Vec3::to_array).collect());
    chunk.normals = Some(Arc::new(points.iter().map(|q| pack_normal(wall_normal(*q))).collect()));
    chunk.radii = Some(Arc::new(vec![pack_radius(radius); points.len()]));
    store.add_chunk(cloud, &chunk, None).unwrap();
    let bounce = Bounce::new(&gpu.device, size);
    let normal = Image::new(&gpu.device, size, "normal", wgpu::TextureFormat::Rgba32Float);
    fill(gpu, picture, &bounce.mirror.point, |pixel| pixel.point.extend(1.0).to_array());
    fill(gpu, picture, &bounce.mirror.eye, |pixel| [0.0, 0.0, 0.0, pixel.linear_depth]);
    fill(gpu, picture, &normal, |pixel| pixel.normal.extend(1000.0).to_array());
    let counters = storage(&gpu.device, "counters", COUNTERS as u64 * 4);
    let settings = Settings { sample_cameras: parameters.clone(), ..Settings::default() };
    let camera = FrameCamera::new(&camera(), &settings.view, size, camera().pivot, SCENE_RADIUS.into());
    let list = store.draw_list(&camera, &settings, Selection::Everywhere);
    let supply = Inputs::new(gpu, camera, &settings, &list);
    let mut pipelines = Pipelines::new();
    let mut recorder = Recorder::new(gpu, &mut pipelines, &settings);
    let task = Task {
        supply: &supply,
        settings: &settings,
        store: &store,
        mirrors,
        bounce: 0,
        camera: bounce.surface(),
        mirror: &bounce.mirror,
        normal: &normal,
        seen: &bounce.seen,
        formulas: None,
        counters: &counters,
    };
    let mut forward = Forward::new(gpu, size, None).unwrap();
    let gather = Gather::new(&gpu.device, size);
    let mut index = SurfelIndex::default();
    SampleCameras::default().run(&mut recorder, &mut index, &gather, &mut forward, &task).unwrap();
    recorder.finish().unwrap();
    let read = |buffer: &wgpu::Buffer| -> Vec<u32> {
        bytemuck::pod_collect_to_vec(&gpu.read_buffer(buffer, 0, buffer.size()).unwrap())
    };
    let words = read(&forward.solutions[&SolutionKey { page: 0, round: 0, bounce: 0 }]);
    let page = words.len() / 2 / parameters.roots as usize;
    let roots = |point: usize| {
        let rounds = (0..parameters.roots as usize).map(|round| &words[2 * (point + round * page)..][..2]);
        let found = rounds.take_while(|pair| pair[1] != 0);
        let place = |word: u32| (DVec2::new(f64::from(word & 0xffff), f64::from(word >> 16)) + 0.5) / 4.0;
        found.map(|pair| Root { at: place(pair[0]), reach: f32::from_bits(pair[1]).into() }).collect()
    };
    Made {
        roots: (0..points.len()).map(roots).collect(),
        counters: read(&counters),
        position: bytemuck::pod_collect_to_vec(&gpu.read_texture(&bounce.seen.position.texture).unwrap()),
    }
}

#[test]
fn the_gpu_finds_the_roots_that_its_twin_finds() {
    let Some(gpu) = Gpu::shared() else { return };
    let points = wall_points(4000);
    for (mirror, parameters) in [
        (Variant::Sphere, all_points()),
        (Variant::Parabolic, Parameters { degree: 3, judged_by: JudgedBy::Ray, ..all_points() }),
        (Variant::Blob, all_points()),
        (Variant::Torus, Parameters { degree: 3, accuracy: 0.5, ..all_points() }),
        (Variant::Torus, Parameters { down_sampling: 2, polish: 1, near: 0.1, ..all_points() }),
        (Variant::Blob, Parameters { degree: 1, least_square: 8, largest_square: 128, ..all_points() }),
    ] {
        let picture = picture(mirror, SMALL);
        let bundles = bundles(&picture, &parameters);
        let made = made(&gpu, &picture, &points, &parameters);
        // Where an error is next to the accuracy, the last bit decides whether a square is divided.
        let leaves = bundles.leaves.len() as f64;
        let squares = f64::from(made.counters[REGIONS]);
        assert!((squares - leaves).abs() <= 0.02 * leaves + 3.0, "{mirror:?}: {squares} squares, {leaves}");
        let (mut agreeing, mut all, mut found) = (0, 0, 0);
        for (q, roots) in points.iter().zip(&made.roots) {
            let twin = bundles.roots(q.as_dvec3(), RADIUS.into());
            // Places are kept to a quarter of a pixel.
            let is_near = |a: &Root, b: &Root| {
                (a.at - b.at).abs().max_element() < 0.25 && (a.reach - b.reach).abs() < 1e-3 * a.reach
            };
            agreeing += twin.iter().filter(|root| roots.iter().any(|other| is_near(root, other))).count();
            all += twin.len().max(roots.len());
            found += usize::from(!roots.is_empty());
        }
        assert!(agreeing as f64 > 0.97 * all as f64 && all > 800, "{mirror:?}: {agreeing} of {all} roots");
        assert_eq!((made.counters[POINTS_TRIED], made.counters[POINTS_FOUND]), (4000, found as u32));
        assert_eq!(made.counters[POINTS_UNCONVERGED], 0);
    }
}

#[test]
fn what_descends_first_changes_nothing_and_roots_beyond_those_kept_are_counted() {
    let Some(gpu) = Gpu::shared() else { return };
    let points = wall_points(20_000);
    let picture = picture(Variant::Torus, SMALL);
    let all = made(&gpu, &picture, &points, &all_points());
    let alone = made(&gpu, &picture, &points, &Parameters { cull: BundleCull::None, ..all_points() });
    assert_eq!(all.position, alone.position);
    assert_eq!(all.counters, alone.counters);
    let again = made(&gpu, &picture, &points, &all_points());
    assert!(all.position == again.position, "the same frame twice");
    let first = made(&gpu, &picture, &points, &Parameters { roots: 1, ..all_points() });
    let several = all.roots.iter().filter(|roots| roots.len() > 1).count();
    assert!(several > 1000, "{several}");
    assert_eq!(first.counters[POINTS_UNCONVERGED] as usize, several);
    let is_kept =
        |(one, all): (&Vec<Root>, &Vec<Root>)| one.first().map(|root| root.at) == all.first().map(|root| root.at);
    assert!(first.roots.iter().zip(&all.roots).all(is_kept));
}

#[test]
fn pixels_that_no_bundle_stands_for_are_traced() {
    let Some(gpu) = Gpu::shared() else { return };
    let points = wall_points(200_000);
    let picture = picture(Variant::Coral, SMALL);
    let pixels = picture.pixels.iter().flatten().count() as f64;
    let coverage = |rest| {
        let parameters = Parameters { rest, ..Parameters::default() };
        let made = made_of(&gpu, &picture, &points, 0.02, &parameters);
        let found = made.position.iter().filter(|texel| f32::from_bits(texel[3]) == 1.0).count() as f64 / pixels;
        (f64::from(made.counters[RAYS_LEFT]) / pixels, found)
    };
    let [alone, chained] = [BundleRest::None, BundleRest::SurfelTrace].map(coverage);
    assert!(alone.0 == chained.0 && alone.0 > 0.5, "{alone:?} {chained:?}");
    assert!(chained.1 > 0.97 && chained.1 > alone.1, "{alone:?} {chained:?}");
}

#[test]
fn points_that_would_fall_on_a_pixel_together_are_thinned_out_without_gaps() {
    let Some(gpu) = Gpu::shared() else { return };
    let points = wall_points(100_000);
    let picture = picture(Variant::Sphere, SMALL);
    let pixels = picture.pixels.iter().flatten().count() as f64;
    // The discs of points must close the walls: only then do their sizes show how many fall on a pixel.
    let radius = 1.5 * (40.0 / (std::f32::consts::PI * points.len() as f32)).sqrt();
    let counts = [0.0, 4.0, 1.0].map(|points_per_pixel| {
        let parameters = Parameters { points_per_pixel, ..Parameters::default() };
        let made = made_of(&gpu, &picture, &points, radius, &parameters);
        let found = made.position.iter().filter(|texel| f32::from_bits(texel[3]) == 1.0).count() as f64 / pixels;
        (made.roots.iter().map(Vec::len).sum::<usize>() as f64, found)
    });
    assert!(counts[0].0 > 2.0 * counts[1].0 && counts[1].0 > 2.0 * counts[2].0, "{counts:?}");
    assert!(counts.iter().all(|(_, coverage)| *coverage > 0.9), "{counts:?}");
    let published = Parameters { splat: BundleSplat::Published, ..all_points() };
    let made = made_of(&gpu, &picture, &points, radius, &published);
    assert!(made.counters[POINTS_FOUND] > 50_000);
}
