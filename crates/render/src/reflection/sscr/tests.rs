//! Tests of the searches: against closed forms, then the GPU against the CPU.

mod error_tests;

use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use cloud::{Chunk, pack_normal, pack_radius};
use glam::{UVec2, Vec2, Vec3};
use param::{Kind, Params as _};
use scene::five_mirrors::{Variant, camera};
use scene::{Reading, Seeds, Settings, Show, Solver, Sscr as Parameters};

use error_tests::{error, random_vector};

use super::exact_mirrors::{fill, picture, wall_points};
use super::twin::{self, MirrorPicture, MirrorPixel, Outcome, Random, Regions, Search};
use super::{Forward, Sscr, Task};
use crate::frame::FrameCamera;
use crate::inputs::Inputs;
use crate::recorder::{Pipelines, Recorder};
use crate::reflection::forward::SolutionKey;
use crate::reflection::{Bounce, COUNTERS};
use crate::store::draw_list::Selection;
use crate::store::{Material, PointStore};
use crate::targets::{Image, storage};
use crate::{ChunkId, Gpu};

const SMALL: UVec2 = UVec2::new(400, 300);

/// The share of points for which a pixel is found.
fn hit_rate(picture: &MirrorPicture, settings: &Parameters, points: &[Vec3]) -> f32 {
    use rayon::prelude::*;
    let regions = Regions::new(picture, settings);
    let search = Search { picture, regions: &regions, settings };
    let is_found =
        |(index, q): (usize, &Vec3)| matches!(search.solve(index as u32, *q, Vec3::ZERO, 0.0), (Outcome::Found(_), _));
    points.par_iter().enumerate().filter(|point| is_found(*point)).count() as f32 / points.len() as f32
}

#[test]
fn the_text_of_the_paper_gives_its_hit_rates_and_its_listing_a_third_of_them() {
    let points = wall_points(20_000);
    // The published rates, and the thresholds with which they were published.
    let published = [
        (Variant::Sphere, 0.35, 2.0),
        (Variant::Parabolic, 0.19, 4.0),
        (Variant::Blob, 0.25, 4.0),
        (Variant::Torus, 0.17, 3.0),
    ];
    for (mirror, rate, threshold) in published {
        let picture = picture(mirror, SMALL);
        let with = |reading| hit_rate(&picture, &Parameters { reading, threshold, ..Parameters::default() }, &points);
        let (text, listing) = (with(Reading::Text), with(Reading::Listing));
        // Neither the objects nor the camera are the paper's.
        assert!((0.5..2.0).contains(&(text / rate)), "{mirror:?}: {text}, published {rate}");
        assert!(listing < 0.45 * text, "{mirror:?}: {listing} by the listing, {text} by the text");
    }
}

#[test]
fn on_the_twin_root_lines_at_45_degrees_lose_interleaved_a_quarter_and_newton_nothing() {
    let points = wall_points(20_000);
    let mut picture = picture(Variant::Sphere, SMALL);
    let mut rate = |solver, degrees: f32| {
        // The error's frame is turned against the screen, as at the corners of a wide field of view.
        picture.right = Vec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0);
        let regions = Regions::new(&MirrorPicture { right: Vec3::X, ..picture.clone() }, &Parameters::default());
        let settings = Parameters { solver, ..Parameters::default() };
        let search = Search { picture: &picture, regions: &regions, settings: &settings };
        let found = (0..points.len()).filter(|&index| {
            matches!(search.solve(index as u32, points[index], Vec3::ZERO, 0.0), (Outcome::Found(_), _))
        });
        found.count() as f32
    };
    let interleaved = [0.0, 45.0].map(|degrees| rate(Solver::Interleaved, degrees));
    let newton = [0.0, 45.0].map(|degrees| rate(Solver::Newton, degrees));
    assert!(interleaved[1] < 0.75 * interleaved[0], "{interleaved:?}");
    assert!(newton[1] > 0.98 * newton[0] && newton[0] > 2.0 * interleaved[0], "{newton:?} {interleaved:?}");
}

/// The GPU that the tests share: drivers take a while to compile each pass.
struct TestGpu {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
}

static STAGE: LazyLock<Option<Mutex<TestGpu>>> =
    LazyLock::new(|| Some(Mutex::new(TestGpu { gpu: Gpu::shared()?, pipelines: Pipelines::new() })));

fn stage() -> Option<MutexGuard<'static, TestGpu>> {
    STAGE.as_ref().map(|stage| stage.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// An exact mirror and the walls' points, on the GPU.
struct Scene {
    picture: MirrorPicture,
    points: Vec<Vec3>,
    store: PointStore,
    bounce: Bounce,
    normal: Image,
    sscr: Sscr,
    forward: Forward,
    counters: wgpu::Buffer,
}

/// The results of a frame that are compared.
struct Made {
    curvature: Vec<u32>,
    labels: Vec<u32>,
    /// First x and y, last x and y, pixels, accumulated pixels.
    regions: Vec<[u32; 6]>,
    /// The pixel coordinate and the distance of points that were found.
    solutions: Vec<Option<(Vec2, f32)>>,
    counters: Vec<u32>,
    /// The Mirror G-Buffer.
    position: Vec<[f32; 4]>,
    albedo: Vec<u8>,
}

const RADIUS: f32 = 0.002;
/// The normal of all points: many turn their back to the mirror, and only algorithm 3.1 leaves those out.
const NORMAL: Vec3 = Vec3::Z;

impl Scene {
    fn new(gpu: &Arc<Gpu>, mirror: Variant, size: UVec2, count: u32) -> Self {
        Self::of_points(gpu, mirror, size, wall_points(count))
    }

    fn of_points(gpu: &Arc<Gpu>, mirror: Variant, size: UVec2, points: Vec<Vec3>) -> Self {
        let count = points.len();
        Self::of_chunks(gpu, picture(mirror, size), points, count)
    }

    /// Chunks of so many points each.
    fn of_chunks(gpu: &Arc<Gpu>, picture: MirrorPicture, points: Vec<Vec3>, count: usize) -> Self {
        let mut store = PointStore::new(gpu.clone());
        let cloud = store.add_cloud(Material::default());
        for points in points.chunks(count) {
            let mut chunk = Chunk::new(0, camera().eye, points.iter().map(Vec3::to_array).collect());
            chunk.normals = Some(Arc::new(vec![pack_normal(NORMAL); points.len()]));
            chunk.radii = Some(Arc::new(vec![pack_radius(RADIUS); points.len()]));
            let _: ChunkId = store.add_chunk(cloud, &chunk, None).unwrap();
        }
        let size = picture.size.to_array();
        let bounce = Bounce::new(&gpu.device, size);
        let normal = Image::new(&gpu.device, size, "normal", wgpu::TextureFormat::Rgba32Float);
        fill(gpu, &picture, &bounce.mirror.point, |pixel| pixel.point.extend(1.0).to_array());
        fill(gpu, &picture, &bounce.mirror.eye, |pixel| [0.0, 0.0, 0.0, pixel.linear_depth]);
        fill(gpu, &picture, &normal, |pixel| pixel.normal.extend(1000.0).to_array());
        Self {
            picture,
            points,
            store,
            bounce,
            normal,
            sscr: Sscr::new(gpu, size).unwrap(),
            forward: Forward::new(gpu, size, None).unwrap(),
            counters: storage(&gpu.device, "counters", COUNTERS as u64 * 4),
        }
    }

    fn make(&mut self, stage: &mut TestGpu, parameters: &Parameters) -> Made {
        self.make_with(stage, &Settings { sscr: parameters.clone(), ..Settings::default() })
    }

    fn make_with(&mut self, stage: &mut TestGpu, settings: &Settings) -> Made {
        let size = self.picture.size.to_array();
        let camera = FrameCamera::new(&camera(), &settings.view, size, camera().pivot, 2.5);
        let list = self.store.draw_list(&camera, settings, Selection::EverywhereWithMirrors);
        let supply = Inputs::new(&stage.gpu, camera, settings, &list);
        let mut recorder = Recorder::new(&stage.gpu, &mut stage.pipelines, settings);
        recorder.clear(&self.counters);
        let task = Task {
            supply: &supply,
            settings,
            store: &self.store,
            mirrors: &[],
            bounce: 0,
            camera: self.bounce.surface(),
            mirror: &self.bounce.mirror,
            normal: &self.normal,
            seen: &self.bounce.seen,
            formulas: None,
            counters: &self.counters,
        };
        self.sscr.run(&mut recorder, &mut self.forward, &task).unwrap();
        recorder.finish().unwrap();
        let read = |buffer: &wgpu::Buffer| -> Vec<u32> {
            bytemuck::pod_collect_to_vec(&stage.gpu.read_buffer(buffer, 0, buffer.size()).unwrap())
        };
        let words = read(&self.sscr.regions);
        let mut regions = words.chunks(super::REGION_BYTES as usize / 4);
        let count = regions.next().map_or(0, |all| all[6]) as usize;
        let regions = regions.take(count);
        let solutions = read(&self.forward.solutions[&SolutionKey { page: 0, round: 0, bounce: 0 }]);
        let place = |word: u32| (Vec2::new((word & 0xffff) as f32, (word >> 16) as f32) + 0.5) / 4.0;
        let found = |pair: &[u32]| (pair[1] != 0).then(|| (place(pair[0]), f32::from_bits(pair[1])));
        let texels = |image: &Image| stage.gpu.read_texture(&image.texture).unwrap();
        Made {
            curvature: read(&self.sscr.curvature),
            labels: read(&self.sscr.mirror_pixels).chunks(8).map(|pixel| pixel[3]).collect(),
            regions: regions.map(|words| words[..6].try_into().unwrap()).collect(),
            solutions: solutions.chunks(2).take(self.points.len()).map(found).collect(),
            counters: read(&self.counters),
            position: bytemuck::pod_collect_to_vec(&texels(&self.bounce.seen.position)),
            albedo: texels(&self.bounce.seen.albedo),
        }
    }
}

fn share(of: impl Iterator<Item = bool>) -> f32 {
    let (mut yes, mut all) = (0, 0);
    of.for_each(|is| (yes, all) = (yes + i32::from(is), all + 1));
    yes as f32 / all as f32
}

#[test]
fn the_gpu_finds_the_regions_and_the_pixels_that_its_twin_finds() {
    let Some(mut stage) = stage() else { return };
    for (mirror, solver, normal_filter, reading) in [
        (Variant::Sphere, Solver::Interleaved, 0, Reading::Text),
        (Variant::Sphere, Solver::Interleaved, 0, Reading::Listing),
        (Variant::Blob, Solver::Interleaved, 0, Reading::Text),
        (Variant::Coral, Solver::Interleaved, 3, Reading::Text),
        (Variant::Torus, Solver::Interleaved, 5, Reading::Listing),
        (Variant::Torus, Solver::Newton, 5, Reading::Listing),
    ] {
        let parameters = Parameters { solver, normal_filter, reading, ..Parameters::default() };
        let mut scene = Scene::new(&stage.gpu, mirror, SMALL, 20_000);
        let made = scene.make(&mut stage, &parameters);
        // Where the normal hardly changes, the last bit decides.
        let mut curvature = scene.picture.curvature(&parameters);
        twin::smooth(&mut curvature, SMALL);
        // Before planar pixels were smoothed, and then the map itself.
        let open = scene.picture.curvature(&parameters);
        let flags = curvature.iter().zip(&open).map(|(flags, open)| flags | (open & 15) << 8);
        let agreeing = share(flags.zip(&made.curvature).map(|(twin, gpu)| twin == *gpu));
        assert!(agreeing > 0.999, "{mirror:?}: {agreeing} of the curvature map");
        // Everything else is integers: equal for equal maps.
        let mut smoothed: Vec<u32> = made.curvature.iter().map(|flags| flags & 0xf0 | flags >> 8 & 15).collect();
        twin::smooth(&mut smoothed, SMALL);
        assert!(made.curvature.iter().map(|flags| flags & 0xff).eq(smoothed), "{mirror:?}: planar pixels");
        let flags: Vec<u32> = made.curvature.iter().map(|flags| flags & 0xff).collect();
        let regions = Regions::of_curvature(&flags, SMALL);
        assert_eq!(regions.labels, made.labels, "{mirror:?}");
        let expected: Vec<[u32; 6]> = regions
            .regions
            .iter()
            .map(|region| {
                let [first, last] = [region.first, region.last];
                [first.x, first.y, last.x, last.y, region.pixels, region.accumulated]
            })
            .collect();
        assert_eq!(expected, made.regions, "{mirror:?}");
        assert_eq!(made.counters[5] as usize, expected.len());
        let search = Search { picture: &scene.picture, regions: &regions, settings: &parameters };
        let twin: Vec<(Outcome, f32)> =
            scene.points.iter().enumerate().map(|(index, q)| search.solve(index as u32, *q, NORMAL, RADIUS)).collect();
        // A walk with a tie, or with a turn that its last bit decides, goes another way.
        let agreeing = share(twin.iter().zip(&made.solutions).map(|(twin, gpu)| match (twin, gpu) {
            ((Outcome::Found(at), distance), Some((place, reach))) => {
                at.distance(*place) < 0.5 && (distance - reach).abs() < 0.01
            }
            ((Outcome::Found(_), _), None) | (_, Some(_)) => false,
            (_, None) => true,
        }));
        assert!(agreeing > 0.98, "{mirror:?}: {agreeing} of the points");
        let found = made.solutions.iter().flatten().count() as u32;
        assert_eq!((made.counters[3], made.counters[4]), (20_000, found));
        let unconverged = twin.iter().filter(|(outcome, _)| *outcome == Outcome::Unconverged).count() as f32;
        assert!((made.counters[6] as f32 - unconverged).abs() <= 200.0, "{} {unconverged}", made.counters[6]);
    }
}

/// Whether the pixel of a solution contains its root: the error there is no larger than its change to the next pixels.
fn is_root(scene: &Scene, (at, _): (Vec2, f32), q: Vec3) -> bool {
    let error_at = |at: UVec2| {
        let pixel = scene.picture.pixels.get((at.y * SMALL.x + at.x) as usize)?.as_ref()?;
        Some(error(pixel, q))
    };
    let at = at.as_uvec2();
    let Some(own) = error_at(at) else { return false };
    let nearby =
        [UVec2::X, UVec2::Y].into_iter().flat_map(|side| [error_at(at + side), error_at(at.wrapping_sub(side))]);
    let change = nearby.flatten().map(|other| (other - own).length()).fold(0.0, f32::max);
    own.length() < 2.0 * change
}

#[test]
fn every_solver_finds_roots_and_newton_nearly_all() {
    let Some(mut stage) = stage() else { return };
    let mut rates = Vec::new();
    for solver in [Solver::Interleaved, Solver::Newton, Solver::Broyden, Solver::NelderMead, Solver::ConjugateGradient]
    {
        let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 20_000);
        let made = scene.make(&mut stage, &Parameters { solver, ..Parameters::default() });
        let found = made.solutions.iter().zip(&scene.points).filter_map(|(solution, q)| Some(((*solution)?, *q)));
        let roots = share(found.map(|(solution, q)| is_root(&scene, solution, q)));
        let rate = made.counters[4] as f32 / made.counters[3] as f32;
        assert!(roots > 0.99 && rate > 0.25, "{solver:?}: {roots} are roots, of {rate} of the points");
        rates.push(rate);
    }
    // 77 % of the points have a root (docs/methods/sscr.md).
    assert!(rates[1] > 0.7 && rates[1] > 2.0 * rates[0], "{rates:?}");
}

#[test]
fn the_filter_of_normals_gives_noisy_mirrors_about_the_regions_of_smooth_ones() {
    let mut random = Random(13);
    for mirror in [Variant::Blob, Variant::Torus] {
        let smooth = picture(mirror, SMALL);
        let mut noisy = smooth.clone();
        for pixel in noisy.pixels.iter_mut().flatten() {
            // About the turn of these mirrors from pixel to pixel.
            pixel.normal = (pixel.normal + random_vector(&mut random) * 0.03).normalize();
        }
        let count = |picture: &MirrorPicture, normal_filter| {
            let parameters = Parameters { normal_filter, planar_normal_threshold: 0.006, ..Parameters::default() };
            Regions::new(picture, &parameters).regions.len()
        };
        let [exact, open, filtered] = [count(&smooth, 0), count(&noisy, 0), count(&noisy, 4)];
        assert!(open > 3 * exact && filtered <= 2 * exact.max(4), "{mirror:?}: {exact} {open} {filtered}");
    }
}

#[test]
fn solving_once_gives_the_same_picture_to_the_bit() {
    let Some(mut stage) = stage() else { return };
    for regions_per_point in [1, 3] {
        let mut pictures = [false, true].map(|solve_once| {
            let mut scene = Scene::new(&stage.gpu, Variant::Blob, SMALL, 20_000);
            scene.make(&mut stage, &Parameters { solve_once, regions_per_point, ..Parameters::default() })
        });
        let found = |made: &Made| made.position.iter().filter(|position| position[3] == 1.0).count();
        assert!(found(&pictures[0]) > 1000);
        pictures.iter_mut().for_each(|made| made.position.iter_mut().for_each(|p| *p = p.map(|v| v + 0.0)));
        assert_eq!(pictures[0].position, pictures[1].position);
        assert_eq!(pictures[0].albedo, pictures[1].albedo);
        assert_eq!(pictures[0].counters, pictures[1].counters);
    }
}

#[test]
fn the_last_step_that_is_allowed_may_end_in_a_bracket() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 20_000);
    // Steps of two and a half pixels at most: every pair is near.
    let parameters = Parameters { threshold: 16.0, max_steps: 1, ..Parameters::default() };
    let made = scene.make(&mut stage, &parameters);
    let regions = Regions::new(&scene.picture, &parameters);
    let search = Search { picture: &scene.picture, regions: &regions, settings: &parameters };
    let count = |max_steps: u32| {
        let search = Search { settings: &Parameters { max_steps, ..parameters.clone() }, ..search };
        let is_found = |(index, q): (usize, &Vec3)| {
            matches!(search.solve(index as u32, *q, Vec3::ZERO, RADIUS).0, Outcome::Found(_))
        };
        scene.points.iter().enumerate().filter(|point| is_found(*point)).count()
    };
    let (start, first_step) = (count(0), count(1));
    assert!(first_step > start + 20, "{start} {first_step}");
    assert!(made.counters[4].abs_diff(first_step as u32) < 10, "{} {first_step}", made.counters[4]);
}

#[test]
fn a_search_is_shown_where_it_stands_and_ends_in_the_picture() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 20_000);
    let mut settings = Settings::default();
    let end = scene.make_with(&mut stage, &settings).solutions;
    settings.reflection.show = Show::Search;
    let mut standing = |steps: u32| {
        settings.sscr.search_steps = steps;
        scene.make_with(&mut stage, &settings).solutions
    };
    // The median distance in pixels to where the search ends, of the points that it finds.
    let apart = |standing: &[Option<(Vec2, f32)>]| {
        let pairs = end.iter().zip(standing).filter_map(|(end, standing)| end.zip(*standing));
        let mut apart: Vec<f32> = pairs.map(|(end, standing)| end.0.distance(standing.0)).collect();
        apart.sort_by(f32::total_cmp);
        apart[apart.len() / 2]
    };
    let distances = [0, 4, 8, 16].map(|steps| apart(&standing(steps)));
    assert!(distances.is_sorted_by(|a, b| a > b || *b == 0.0), "{distances:?}");
    assert!(distances[0] > 20.0 && distances[3] < 1.0, "{distances:?}");
    // Where it cannot take a step more, all are found that were found.
    let all = standing(100);
    let lost = end.iter().zip(&all).filter(|(end, all)| end.is_some() && end != all).count();
    assert_eq!(lost, 0);
}

#[test]
fn more_regions_a_point_and_last_frames_pixels_find_more() {
    let Some(mut stage) = stage() else { return };
    let rate = |made: &Made| made.counters[4] as f32 / made.counters[3] as f32;
    let covered = |made: &Made| made.position.iter().filter(|position| position[3] == 1.0).count();
    let mut scene = Scene::new(&stage.gpu, Variant::Blob, SMALL, 20_000);
    let one = scene.make(&mut stage, &Parameters::default());
    let four = scene.make(&mut stage, &Parameters { regions_per_point: 4, ..Parameters::default() });
    assert!(covered(&four) as f32 > 1.5 * covered(&one) as f32, "{} {}", covered(&one), covered(&four));
    let parameters = Parameters { seeds: Seeds::LastFrame, ..Parameters::default() };
    let frames = [0; 4].map(|_| rate(&scene.make(&mut stage, &parameters)));
    assert!(frames[3] > 1.3 * frames[0] && frames.is_sorted(), "{frames:?}");
    let grid = scene.make(&mut stage, &Parameters { seeds: Seeds::Grid, ..Parameters::default() });
    assert!(rate(&grid) > rate(&one), "{} {}", rate(&grid), rate(&one));
}

#[test]
fn culling_loses_next_to_no_point_and_regions_of_their_own_parameters_gain_some() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Coral, SMALL, 20_000);
    let all = scene.make(&mut stage, &Parameters::default());
    let culled = scene.make(&mut stage, &Parameters { cull_points: true, ..Parameters::default() });
    let lost = |index: &usize| all.solutions[*index].is_some() && culled.solutions[*index].is_none();
    let lost: Vec<usize> = (0..scene.points.len()).filter(lost).collect();
    // A search ends within pixels of its root, and the coral's pixels turn the ray by half a radian.
    assert!(lost.len() * 200 < all.counters[4] as usize, "{} lost of {}", lost.len(), all.counters[4]);
    // Points that the drawn region cannot reflect are tried in another one.
    assert!(culled.counters[4] * 100 > all.counters[4] * 103, "{} {}", culled.counters[4], all.counters[4]);
    let own = scene.make(&mut stage, &Parameters { per_region: true, ..Parameters::default() });
    assert!(own.counters[4] > all.counters[4], "{} {}", own.counters[4], all.counters[4]);
}

#[test]
fn chunks_that_no_region_reflects_are_not_searched_and_hold_next_to_no_point_that_is_found() {
    let Some(mut stage) = stage() else { return };
    // A block of points for each of the cells of the box that hold so many.
    let mut cells = std::collections::BTreeMap::<[i32; 3], Vec<Vec3>>::new();
    for point in wall_points(400_000) {
        cells.entry((point / 0.5).floor().as_ivec3().to_array()).or_default().push(point);
    }
    let block = 1024;
    let points: Vec<Vec3> =
        cells.into_values().filter(|cell| cell.len() >= block).flat_map(|cell| cell[..block].to_vec()).collect();
    for (mirror, is_flat) in [(Variant::Sphere, false), (Variant::Sphere, true), (Variant::Coral, false)] {
        let mut picture = picture(mirror, SMALL);
        if is_flat {
            // Where the lines of sight meet a plane through the sphere's middle.
            let middle = (Variant::Sphere.mirrors()[0].position - camera().eye).as_vec3();
            let normal = (Vec3::new(0.3, 0.2, 0.0) - middle.normalize()).normalize();
            for pixel in picture.pixels.iter_mut().flatten() {
                let scale = normal.dot(middle) / normal.dot(pixel.point);
                pixel.point *= scale;
                pixel.linear_depth *= scale;
                pixel.normal = normal;
            }
        }
        let mut scene = Scene::of_chunks(&stage.gpu, picture, points.clone(), block);
        let all = scene.make(&mut stage, &Parameters::default());
        let culled = scene.make(&mut stage, &Parameters { cull_chunks: true, ..Parameters::default() });
        let (from, count) = (super::ending_bytes(SMALL.to_array()), points.len() / block);
        let reached = stage.gpu.read_buffer(&scene.sscr.endings, from.next_multiple_of(256), count as u64 * 4).unwrap();
        let reached: Vec<u32> = bytemuck::pod_collect_to_vec(&reached);
        let mut lost = 0;
        for (chunk, is_reached) in reached.iter().enumerate() {
            let of = |made: &Made| made.solutions[chunk * block..][..block].to_vec();
            if *is_reached == 1 {
                assert_eq!(of(&all), of(&culled), "{mirror:?}");
            } else {
                assert!(of(&culled).iter().all(Option::is_none), "{mirror:?}");
                lost += of(&all).iter().flatten().count();
            }
        }
        let left_out = reached.iter().filter(|is_reached| **is_reached == 0).count();
        println!("{mirror:?}: {left_out} of {} chunks, {lost} of {} points", reached.len(), all.counters[4]);
        // Only rays that leave a flat mirror all go one way.
        assert_eq!(left_out * 2 > reached.len(), is_flat, "{mirror:?}: {left_out} of {}", reached.len());
        // What a search finds outside of all cones is no root.
        assert!(lost * 500 < all.counters[4] as usize, "{mirror:?}: {lost} of {}", all.counters[4]);
        assert_eq!(all.counters[3], culled.counters[3], "{mirror:?}");
    }
}

#[test]
fn a_share_of_the_points_goes_by_the_pixels_of_the_mirror_and_lies_evenly() {
    let Some(mut stage) = stage() else { return };
    // Seven whole blocks and a part of one.
    let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 8000);
    let mut of = |point_share| scene.make(&mut stage, &Parameters { point_share, ..Parameters::default() });
    let (all, half, quarter) = (of(1.0), of(0.4), of(0.2));
    let tried = |made: &Made| made.counters[3] as f32;
    let covered = all.labels.iter().filter(|label| **label != 0).count() as f32 / all.labels.len() as f32;
    assert!((0.05..0.25).contains(&covered), "{covered}");
    for (made, share) in [(&half, 0.4), (&quarter, 0.2)] {
        let expected = tried(&all) * share * covered / 0.1;
        assert!((tried(made) / expected - 1.0).abs() < 0.05, "{} tried, expected {expected}", tried(made));
        // A point that is searched for is found where it was found among all.
        let kept = made.solutions.iter().zip(&all.solutions).filter(|(few, _)| few.is_some());
        assert!(kept.clone().count() > 100 && kept.clone().all(|(few, all)| few == all));
        // Each eighth of a block has its part of those that are found.
        let eighths = made.solutions[..7 * 1024].chunks(128).zip(all.solutions.chunks(128));
        let found = |run: &[Option<(Vec2, f32)>]| run.iter().flatten().count() as f32;
        let off = eighths.map(|(few, all)| (found(few) - found(all) * share * covered / 0.1).abs());
        assert!(off.fold(0.0, f32::max) < 15.0);
    }
    let is_more = half.solutions.iter().zip(&quarter.solutions).all(|(more, fewer)| fewer.is_none() || more == fewer);
    assert!(is_more, "fewer points are not among more");
    // Regions are drawn for fewer points as for all.
    let mut scene = Scene::new(&stage.gpu, Variant::Coral, SMALL, 60_000);
    let mut rate = |point_share| {
        let made = scene.make(&mut stage, &Parameters { point_share, ..Parameters::default() });
        made.counters[4] as f32 / made.counters[3] as f32
    };
    let rates = [1.0, 0.5, 0.2, 0.1].map(&mut rate);
    assert!(rates.iter().all(|few| (few / rates[0] - 1.0).abs() < 0.15), "{rates:?}");
}

#[test]
fn what_lies_far_behind_the_nearest_point_counts_where_it_is() {
    let Some(mut stage) = stage() else { return };
    // A patch close to the mirror and one behind it, at many times the distance.
    let places: Vec<Vec3> = picture(Variant::Sphere, SMALL)
        .pixels
        .iter()
        .flatten()
        .flat_map(|pixel| [0.1, 1.5].map(|distance| pixel.point + reflected(pixel) * distance))
        .collect();
    let mut scene = Scene::of_points(&stage.gpu, Variant::Sphere, SMALL, places);
    // Each point in one pixel, and an offset larger than all distances.
    let parameters =
        Parameters { mirror_depth_offset: 1.0, max_splat_size: 1.0, solver: Solver::Newton, ..Parameters::default() };
    let made = scene.make(&mut stage, &parameters);
    let mut found = vec![(Vec3::ZERO, 0.0_f32, 0.0_f32); made.position.len()];
    for (solution, q) in made.solutions.iter().zip(&scene.points) {
        if let Some((at, reach)) = solution {
            let (sum, count, farthest) = &mut found[at.y as usize * SMALL.x as usize + at.x as usize];
            (*sum, *count, *farthest) = (*sum + q, *count + 1.0, farthest.max(*reach));
        }
    }
    let mut mixed = 0;
    for ((sum, count, farthest), position) in found.into_iter().zip(&made.position).filter(|(found, _)| found.1 > 0.0) {
        let at = Vec3::new(position[0], position[1], position[2]);
        assert!(at.distance(sum / count) < 1e-4, "{at} for {}", sum / count);
        mixed += usize::from(farthest > 1.0 && count > 1.0);
    }
    assert!(mixed > 1000, "{mixed} pixels see both patches");
}

#[test]
fn in_parallel_views_depth_steps_are_the_same_wherever_the_eye_is() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Coral, SMALL, 100);
    let mut settings = Settings::default();
    settings.view.projection = scene::Projection::Orthographic;
    settings.sscr.depth_step_threshold = 0.01;
    let mut steps = |moved_back: f32| {
        let eye = &scene.bounce.mirror.eye;
        fill(&stage.gpu, &scene.picture, eye, |pixel| [0.0, 0.0, 0.0, pixel.linear_depth + moved_back]);
        let made = scene.make_with(&mut stage, &settings);
        made.curvature.iter().filter(|flags| *flags & (twin::STEP[0] | twin::STEP[1]) != 0).count()
    };
    let [near, far] = [0.0, 100.0].map(&mut steps);
    // The last bits of a hundredfold depth are worth a thousandth of the step.
    assert!(near > 100 && near.abs_diff(far) * 50 < near, "{near} {far}");
}

#[test]
fn points_without_a_place_are_not_tried() {
    let Some(mut stage) = stage() else { return };
    let mut points = wall_points(2000);
    points.iter_mut().step_by(4).for_each(|point| *point = Vec3::NAN);
    let made = Scene::of_points(&stage.gpu, Variant::Sphere, SMALL, points).make(&mut stage, &Parameters::default());
    assert_eq!(made.counters[3], 1500);
}

#[test]
fn solutions_of_bounces_that_are_no_more_go() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 2000);
    scene.make(&mut stage, &Parameters::default());
    let first = SolutionKey { page: 0, round: 0, bounce: 0 };
    let second = SolutionKey { bounce: 1, ..first };
    for seeds in [Seeds::LastFrame, Seeds::Random] {
        let bytes = scene.forward.solutions[&first].size();
        scene.forward.solutions.insert(second, storage(&stage.gpu.device, "solutions", bytes));
        scene.make(&mut stage, &Parameters { seeds, ..Parameters::default() });
        assert_eq!(scene.forward.solutions.keys().collect::<Vec<_>>(), [&first], "{seeds:?}");
    }
}

#[test]
fn pictures_with_more_pixels_than_can_be_numbered_are_refused() {
    let Some(stage) = stage() else { return };
    let too_large = |error: Option<crate::Error>| match error {
        Some(crate::Error::TooLarge { what, .. }) => what,
        other => panic!("{other:?}"),
    };
    assert_eq!(too_large(Forward::new(&stage.gpu, [16_385, 1], None).err()), "a row of reflections");
    assert_eq!(too_large(Sscr::new(&stage.gpu, [16_384, 4096]).err()), "runs of pixels");
}

/// The reflected eye ray, a unit vector.
fn reflected(pixel: &MirrorPixel) -> Vec3 {
    pixel.normal * 2.0 * pixel.normal.dot(pixel.toward_eye) - pixel.toward_eye
}

#[test]
fn what_is_seen_in_a_pixel_lies_along_its_reflected_ray() {
    let Some(mut stage) = stage() else { return };
    for visibility in [scene::KeptPoints::Accumulated, scene::KeptPoints::Nearest] {
        let mut scene = Scene::new(&stage.gpu, Variant::Sphere, SMALL, 200_000);
        let made = scene.make(&mut stage, &Parameters { visibility, ..Parameters::default() });
        // In pixels: relative to the change of the reflected direction to the next pixels.
        let mut errors: Vec<f32> = Vec::new();
        let (mut mirror, mut closed) = (0, 0);
        let width = SMALL.x as usize;
        for (index, (pixel, position)) in scene.picture.pixels.iter().zip(&made.position).enumerate() {
            let Some(pixel) = pixel else {
                assert_eq!(*position, [0.0; 4]);
                continue;
            };
            mirror += 1;
            closed += usize::from(position[3] > 0.0);
            if position[3] == 1.0 {
                let [x, y, z, _] = *position;
                let angle = (Vec3::new(x, y, z) - pixel.point).angle_between(reflected(pixel));
                let nearby = [index - 1, index + 1, index - width, index + width];
                let change = nearby
                    .iter()
                    .filter_map(|&other| scene.picture.pixels[other].as_ref())
                    .map(|other| reflected(other).angle_between(reflected(pixel)))
                    .fold(1e-6, f32::max);
                errors.push(angle / change);
            }
        }
        errors.sort_by(f32::total_cmp);
        let [median, p95] = [errors.len() / 2, errors.len() * 95 / 100].map(|place| errors[place]);
        assert!(median < 1.5 && p95 < 5.0, "{median} and {p95} pixels over {}", errors.len());
        assert!(closed as f32 > 0.98 * mirror as f32 && errors.len() as f32 > 0.8 * mirror as f32, "{closed} {mirror}");
    }
}

#[test]
fn every_end_of_every_parameter_gives_a_finite_picture() {
    let Some(mut stage) = stage() else { return };
    let mut scene = Scene::new(&stage.gpu, Variant::Coral, UVec2::new(80, 60), 20_000);
    let defaults = Settings::default();
    let fields = &defaults.sscr.group().fields;
    for field in fields {
        let ends: Vec<String> = match &field.kind {
            Kind::F32 { min, max, .. } => vec![min.to_string(), max.to_string()],
            Kind::U32 { min, max, .. } => vec![min.to_string(), max.to_string()],
            _ => continue,
        };
        for end in ends {
            let mut settings = defaults.clone();
            settings.set_text(&format!("sscr.{}", field.name), &end).unwrap();
            let made = scene.make(&mut stage, &settings.sscr);
            let seen = made.position.iter().filter(|position| position[3] > 0.0).count();
            assert!(made.position.iter().flatten().all(|v| v.is_finite()), "{} = {end}", field.name);
            assert!(made.position.iter().all(|position| (0.0..=1.0).contains(&position[3])), "{} = {end}", field.name);
            // Steps of a pixel, one step at most, or borders everywhere find almost nothing.
            let finds = !matches!(field.name, "threshold" | "initial_step" | "max_steps" | "depth_step_threshold");
            assert!(seen > 5 || !finds, "{} = {end}: {seen} pixels", field.name);
        }
    }
}
