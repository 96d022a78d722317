//! Reflections on the GPU against closed forms, and the laws that they obey. All tests share one renderer: software
//! Vulkan compiles each pass for half a second. The methods tested are those that trace reflected rays; they share
//! everything except where a ray starts. SSCR has tests of its own beside its code.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::sampling::Surface;
use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::{DMat3, DQuat, DVec3, Vec3};
use render::{Aov, ColorPlan, Frame, FrameStats, Material, Objects, PassStage, PassTime, PointStore};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, Mirror, Settings, Shape, SpotLight};

use stage::Stage;

const SIZE: [u32; 2] = [160, 120];
/// The share of pixels at structures as narrow as a pixel: outlines and bumps.
const LARGE: [u32; 2] = [320, 240];
const TRACING: [&str; 3] = ["sscr_hierarchical", "surfel_trace", "screen_trace"];

/// Points of one colour, with normals and radii.
fn chunk(points: &[(DVec3, DVec3)], color: [u8; 3], radius: f64) -> Chunk {
    let mut chunk = Chunk::new(0, DVec3::ZERO, points.iter().map(|(at, _)| at.as_vec3().to_array()).collect());
    chunk.colors = Some(Arc::new(vec![[color[0], color[1], color[2], 255]; points.len()]));
    chunk.normals = Some(Arc::new(points.iter().map(|(_, normal)| pack_normal(normal.as_vec3())).collect()));
    chunk.radii = Some(Arc::new(vec![pack_radius(radius as f32); points.len()]));
    chunk
}

/// A rectangle, sampled so that discs of this radius close it.
fn rectangle(corner: DVec3, edges: [DVec3; 2], color: [u8; 3], radius: f64) -> Chunk {
    chunk(&rectangle_points(corner, edges, radius), color, radius)
}

fn rectangle_points(corner: DVec3, edges: [DVec3; 2], radius: f64) -> Vec<(DVec3, DVec3)> {
    // In a square grid of this step a point is at most 0.71 steps from the nearest disc's middle.
    let counts = edges.map(|edge| (edge.length() / radius).ceil() as u32);
    let normal = edges[0].cross(edges[1]).normalize();
    let at = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count);
    let point = |i: u32| {
        let (u, v) = (at(i % counts[0], counts[0]), at(i / counts[0], counts[1]));
        (corner + edges[0] * u + edges[1] * v, normal)
    };
    (0..counts[0] * counts[1]).map(point).collect()
}

/// The scene that is rendered.
struct Scene {
    store: PointStore,
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    camera: Camera,
}

impl Scene {
    fn new(stage: &Stage, camera: Camera) -> Self {
        Self { store: PointStore::new(stage.gpu.clone()), mirrors: Vec::new(), lights: Vec::new(), camera }
    }

    /// Adds a cloud with its own colours.
    fn add(&mut self, chunks: Vec<Chunk>, material: Material) -> render::CloudId {
        let id = self.store.add_cloud(material);
        let ids: Vec<_> = chunks.iter().map(|chunk| self.store.add_chunk(id, chunk, None).unwrap()).collect();
        let cloud = Cloud { chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
        self.store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        id
    }

    fn render(&self, stage: &mut Stage, settings: &Settings) -> FrameStats {
        self.render_sized(stage, settings, SIZE)
    }

    fn render_sized(&self, stage: &mut Stage, settings: &Settings, size: [u32; 2]) -> FrameStats {
        let objects = Objects { mirrors: &self.mirrors, lights: &self.lights, ..Objects::default() };
        stage.renderer.render(&self.store, &Frame::new(&self.camera, settings, objects, size)).unwrap()
    }
}

fn mirror(shape: Shape, position: DVec3, rotation: DQuat, size: f64) -> Mirror {
    Mirror { position, rotation, ..Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Y, size) }
}

/// The rotation that turns z to a direction.
fn facing(direction: DVec3) -> DQuat {
    DQuat::from_rotation_arc(DVec3::Z, direction.normalize())
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}

fn by_method(method: &str) -> Settings {
    settings(&[("reflection.method", method)])
}

fn front_camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::new(0.3, -1.0, 0.4), 3.0, DVec3::Z)
}

/// The direction of the ray through a place of the picture, pixel centres at halves, by the pinhole formula.
fn direction_through(camera: &Camera, size: [u32; 2], x: f64, y: f64) -> DVec3 {
    let [width, height] = size.map(f64::from);
    let view = DVec3::new(x - width * 0.5, height * 0.5 - y, height * 0.5 / 30_f64.to_radians().tan());
    (camera.view_from_world().transpose() * view).normalize()
}

fn pixel_direction(camera: &Camera, size: [u32; 2], pixel: usize) -> DVec3 {
    let width = size[0] as usize;
    direction_through(camera, size, (pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// The first intersection of a ray with a sphere about `center`, from outside.
fn sphere_hit(origin: DVec3, direction: DVec3, center: DVec3, radius: f64) -> Option<DVec3> {
    let offset = origin - center;
    let half = offset.dot(direction);
    let discriminant = half * half - offset.length_squared() + radius * radius;
    let distance = -half - discriminant.max(0.0).sqrt();
    (discriminant >= 0.0 && distance > 0.0).then(|| origin + direction * distance)
}

fn reflected(direction: DVec3, normal: DVec3) -> DVec3 {
    direction - normal * (2.0 * direction.dot(normal))
}

fn read(stage: &Stage, aov: Aov) -> Vec<f32> {
    stage.renderer.read_aov(aov).unwrap().data
}

/// For each pixel, whether it shows a mirror.
fn mask(stage: &Stage) -> Vec<bool> {
    read(stage, Aov::Mirror).iter().map(|value| *value > 0.0).collect()
}

/// What each mirror pixel sees, and whether it was found there (not closed from its neighbours).
fn seen(stage: &Stage) -> Vec<Option<(DVec3, bool)>> {
    let data = read(stage, Aov::MirrorPosition);
    let point = |p: &[f32; 4]| (p[3] > 0.0).then(|| (Vec3::new(p[0], p[1], p[2]).as_dvec3(), p[3] == 1.0));
    data.as_chunks::<4>().0.iter().map(point).collect()
}

fn bits(data: &[f32]) -> Vec<u32> {
    data.iter().map(|value| value.to_bits()).collect()
}

/// Checks that all colours are numbers where something is seen, and all positions where something is seen in a mirror.
fn assert_finite(stage: &Stage, what: &str) {
    let depth = read(stage, Aov::Depth);
    for aov in [Aov::Color, Aov::Direct] {
        let image = read(stage, aov);
        for (depth, color) in depth.iter().zip(image.as_chunks::<3>().0) {
            assert!(depth.is_nan() || color.iter().all(|value| value.is_finite()), "{what}: {aov:?}");
        }
    }
    for (at, _) in seen(stage).into_iter().flatten() {
        assert!(at.is_finite(), "{what}: sees {at}");
    }
}

/// The value that this share of the sorted values does not exceed.
fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// The pixels of `mask` and those around them.
fn dilated(mask: &[bool], size: [u32; 2]) -> Vec<bool> {
    let [width, height] = size.map(|edge| edge as i32);
    let at = |x: i32, y: i32| x >= 0 && y >= 0 && x < width && y < height && mask[(y * width + x) as usize];
    let any = |i: i32| (-1..2).any(|dy| (-1..2).any(|dx| at(i % width + dx, i / width + dy)));
    (0..width * height).map(any).collect()
}

const SPHERE_CENTER: DVec3 = DVec3::new(0.0, 0.0, 0.2);
const SPHERE_RADIUS: f64 = 0.7;
const FLOOR: f64 = -1.0;
const FLOOR_HALF: f64 = 4.0;
const DISC: f64 = 0.05;

/// An exact sphere over a sampled floor.
fn sphere_over_floor(stage: &Stage) -> Scene {
    let mut scene = Scene::new(stage, front_camera());
    let corner = DVec3::new(-FLOOR_HALF, -FLOOR_HALF, FLOOR);
    let edges = [DVec3::X, DVec3::Y].map(|axis| axis * (2.0 * FLOOR_HALF));
    scene.add(vec![rectangle(corner, edges, [200; 3], DISC)], Material::default());
    scene.mirrors.push(mirror(Shape::Sphere, SPHERE_CENTER, DQuat::IDENTITY, SPHERE_RADIUS));
    scene
}

#[test]
fn root_lines_of_a_point_cross_where_the_mirror_shows_it() {
    let mut stage = stage_or_skip!();
    let scene = sphere_over_floor(&stage);
    scene.render(&mut stage, &by_method("surfel_trace"));
    let shown: Vec<(usize, DVec3)> =
        seen(&stage).into_iter().enumerate().filter_map(|(pixel, seen)| Some((pixel, seen?.0))).collect();
    let place = |pixel: usize| DVec3::new((pixel % SIZE[0] as usize) as f64, (pixel / SIZE[0] as usize) as f64, 0.0);
    let (mut asked, mut crossed, mut long) = (0, 0, 0);
    for (pixel, point) in shown.iter().step_by(shown.len() / 12) {
        let text = point.to_array().map(|value| value.to_string()).join(", ");
        let settings = settings(&[
            ("reflection.method", "surfel_trace"),
            ("reflection.show", "error"),
            ("reflection.point", &text),
        ]);
        scene.render(&mut stage, &settings);
        let picture = stage.renderer.read_picture().unwrap();
        let colors = picture.as_chunks::<4>().0;
        let lines = |line: [u8; 3]| colors.iter().filter(|color| color[..3] == line).count();
        let (red, blue) = (lines([255, 38, 26]), lines([26, 230, 255]));
        long += usize::from(red > 5 && blue > 5);
        let roots: Vec<usize> = (0..colors.len()).filter(|pixel| colors[*pixel][..3] == [255; 3]).collect();
        for root in &roots {
            // Near the rim, the lines run close together.
            assert!(place(*root).distance(place(*pixel)) < 4.0, "{point} has a root at {}", place(*root));
        }
        asked += 1;
        crossed += usize::from(!roots.is_empty());
    }
    assert!(asked >= 12 && crossed * 3 > asked * 2, "{crossed} of {asked} points have a root");
    // Near the rim, a root's lines are short.
    assert!(long * 2 > asked, "{long} of {asked} points have two lines");
}

/// Compares a frame of `sphere_over_floor` with the closed form, pixel by pixel. Returns the distances between the
/// positions found and the true ones, where the floor must be seen.
fn errors_over_floor(stage: &Stage, scene: &Scene, size: [u32; 2], method: &str) -> Vec<f64> {
    let (mask, seen) = (mask(stage), seen(stage));
    assert_eq!(mask.len(), (size[0] * size[1]) as usize);
    let mut errors = Vec::new();
    for pixel in 0..mask.len() {
        let direction = pixel_direction(&scene.camera, size, pixel);
        let hit = sphere_hit(scene.camera.eye, direction, SPHERE_CENTER, SPHERE_RADIUS);
        if !mask[pixel] {
            assert!(seen[pixel].is_none());
            continue;
        }
        // Pixels on the silhouette may round either way.
        let Some(hit) = hit else { continue };
        let ray = reflected(direction, (hit - SPHERE_CENTER) / SPHERE_RADIUS);
        let distance = (FLOOR - hit.z) / ray.z;
        let truth = hit + ray * distance;
        let outside = truth.x.abs().max(truth.y.abs()) - FLOOR_HALF;
        if distance > 0.0 && outside < -2.0 * DISC {
            let (at, is_found) = seen[pixel].unwrap();
            assert!(is_found, "discs leave no gap");
            errors.push(at.distance(truth));
        } else if distance < 0.0 || outside > 2.0 * DISC / ray.z.abs() {
            assert!(seen[pixel].is_none(), "{method}: sees {:?} in the sky", seen[pixel]);
        }
    }
    errors
}

#[test]
fn a_mirror_sphere_shows_a_plane_where_the_closed_form_does_within_a_splat() {
    let mut stage = stage_or_skip!();
    let scene = sphere_over_floor(&stage);
    for method in TRACING {
        let stats = scene.render(&mut stage, &by_method(method));
        let errors = errors_over_floor(&stage, &scene, SIZE, method);
        assert!(errors.len() > 500, "{}", errors.len());
        let (most, median) = (percentile(errors.clone(), 1.0), percentile(errors, 0.5));
        assert!(most < DISC && median < DISC / 50.0, "{method}: {most} at most, {median} in the middle");
        // The counters count the same.
        let (mask, seen) = (mask(&stage), seen(&stage));
        let found = stats.reflection.unwrap();
        assert_eq!(found.mirror_pixels as usize, mask.iter().filter(|is_mirror| **is_mirror).count());
        let counted = |is_found: bool| {
            let pixels = seen.iter().flatten().filter(|(_, found)| *found || !is_found).count();
            pixels as f64 / f64::from(found.mirror_pixels)
        };
        assert_eq!((found.coverage, found.closed_coverage), (counted(true), counted(false)));
    }
}

/// One pixel; a row longer than a texture's customary 4096; no multiple of a tile.
const ODD_SIZES: [[u32; 2]; 3] = [[1, 1], [4097, 3], [17, 9]];

#[test]
fn pictures_of_odd_sizes_are_right_to_the_last_pixel() {
    let mut stage = stage_or_skip!();
    let mut scene = sphere_over_floor(&stage);
    // From below, so that the one pixel of the smallest picture sees the floor too.
    scene.camera = Camera::looking(SPHERE_CENTER, DVec3::new(0.3, -1.0, -0.5), 2.2, DVec3::Z);
    for size in ODD_SIZES {
        let mut masks = Vec::new();
        for method in TRACING {
            scene.render_sized(&mut stage, &by_method(method), size);
            let errors = errors_over_floor(&stage, &scene, size, method);
            assert!(!errors.is_empty() && percentile(errors, 1.0) < DISC, "{method} {size:?}");
            masks.push(mask(&stage));
        }
        scene.render_sized(&mut stage, &by_method("sscr"), size);
        masks.push(mask(&stage));
        assert!(masks.iter().all(|mask| *mask == masks[0]), "{size:?}");
        assert_finite(&stage, &format!("sscr {size:?}"));
    }
}

#[test]
fn a_parallel_projection_is_reflected_in_a_plane_as_the_closed_form_says() {
    let mut stage = stage_or_skip!();
    let back = DVec3::new(0.1, -1.0, 0.5);
    let mut scene = Scene::new(&stage, Camera::looking(DVec3::ZERO, back, 4.0, DVec3::Z));
    const HALF: [f64; 2] = [1.5, 1.2];
    const WALL: f64 = 3.0;
    scene.mirrors.push(mirror(Shape::Plane { height: HALF[1] / HALF[0] }, DVec3::ZERO, DQuat::IDENTITY, HALF[0]));
    let wall = rectangle(DVec3::new(-1.0, WALL, 0.1), [DVec3::X * 3.0, DVec3::Z * 2.0], [200; 3], DISC);
    scene.add(vec![wall], Material::default());
    let camera = scene.camera;
    // The field of view of 60 degrees spans half of the picture's height at the pivot.
    let step = camera.distance() * 30_f64.to_radians().tan() * 2.0 / f64::from(SIZE[1]);
    let on_plane = |pixel: usize| {
        let (x, y) = ((pixel as u32 % SIZE[0]) as f64 + 0.5, (pixel as u32 / SIZE[0]) as f64 + 0.5);
        let offset = DVec3::new(x - f64::from(SIZE[0]) * 0.5, f64::from(SIZE[1]) * 0.5 - y, 0.0) * step;
        let through = camera.view_from_world().transpose() * offset;
        through - camera.forward() * (through.z / camera.forward().z)
    };
    let ray = reflected(camera.forward(), DVec3::Z);
    for method in TRACING {
        let mut settings = by_method(method);
        settings.set_text("view.projection", "orthographic").unwrap();
        scene.render(&mut stage, &settings);
        let (mask, seen) = (mask(&stage), seen(&stage));
        let (mut errors, mut empty) = (Vec::new(), 0);
        for pixel in 0..mask.len() {
            let at = on_plane(pixel);
            // Above 0: outside the mirror. The wall itself is in front of no part of it.
            let beyond = (at.x.abs() - HALF[0]).max(at.y.abs() - HALF[1]);
            if beyond.abs() < 1e-4 {
                continue;
            }
            assert_eq!(mask[pixel], beyond < 0.0, "{method}: {at}");
            let truth = at + ray * ((WALL - at.y) / ray.y);
            let outside = (truth.x - 0.5).abs() - 1.5;
            let outside = outside.max((truth.z - 1.1).abs() - 1.0);
            if beyond < 0.0 && outside < 0.0 {
                errors.push(seen[pixel].unwrap().0.distance(truth));
            } else if beyond < 0.0 && outside > DISC {
                empty += 1;
                assert!(seen[pixel].is_none(), "{method}: {truth}");
            }
        }
        assert!(errors.len() > 1000 && empty > 300, "{} see the wall, {empty} nothing", errors.len());
        // Positions have a precision of a thousandth of a leaf, which is some four discs wide.
        let most = percentile(errors, 1.0);
        assert!(most < DISC / 100.0, "{method}: {most}");
    }
}

/// 0..count in an order far from any spatial one.
fn shuffled(count: usize) -> Vec<usize> {
    // A prime that does not divide the count meets each once.
    let step = 7_919;
    assert!(!count.is_multiple_of(step));
    (0..count).map(|i| i * step % count).collect()
}

#[test]
fn how_points_are_parted_into_chunks_changes_nothing() {
    let mut stage = stage_or_skip!();
    const RADIUS: f64 = 0.1;
    // Less than the distance by which a disc's rim is moved back where discs overlap, more than the margin of a flat
    // leaf's box: the visible layer must not depend on which one is met first.
    const APART: f64 = 0.012 * RADIUS;
    // Two layers below the sphere and two above it, so that in whatever direction a tree is walked, one pair is met
    // from behind.
    let layer = |z: f64, shift: f64| {
        let corner = DVec3::new(-3.0 + shift, -3.0 + shift, z);
        rectangle_points(corner, [DVec3::X, DVec3::Y].map(|axis| axis * 6.0), RADIUS)
    };
    let half_step = RADIUS * 0.5;
    let layers = [layer(-1.2 - APART, half_step), layer(-1.2, 0.0), layer(1.6, 0.0), layer(1.6 + APART, half_step)];
    let all: Vec<(DVec3, DVec3)> = layers.concat();
    let mixed: Vec<_> = shuffled(all.len()).into_iter().map(|index| all[index]).collect();
    let partings: [Vec<Vec<(DVec3, DVec3)>>; 3] = [
        vec![mixed.clone()],
        layers.to_vec(),
        layers.iter().rev().flat_map(|layer| layer.chunks(1000).rev().map(<[_]>::to_vec)).collect(),
    ];
    for method in TRACING {
        let pictures = partings.each_ref().map(|parts| {
            let mut scene = Scene::new(&stage, front_camera());
            scene.mirrors.push(mirror(Shape::Sphere, SPHERE_CENTER, DQuat::IDENTITY, SPHERE_RADIUS));
            let chunks = parts.iter().map(|points| chunk(points, [200; 3], RADIUS)).collect();
            scene.add(chunks, Material::default());
            scene.render(&mut stage, &by_method(method));
            seen(&stage)
        });
        let filled = pictures[0].iter().flatten().count();
        assert!(filled > 1000, "{filled}");
        for (parting, other) in pictures.iter().enumerate().skip(1) {
            let differs = |pixel: &usize| match (pictures[0][*pixel], other[*pixel]) {
                (Some((a, _)), Some((b, _))) => a.distance(b) > APART / 2.0,
                (a, b) => a.is_some() != b.is_some(),
            };
            let differing = (0..other.len()).filter(differs).count();
            // Where two discs are equally near, to the thousandth of a leaf, which is the precision of positions.
            assert!(differing * 50 < filled, "{method}, parting {parting}: {differing} of {filled}");
        }
    }
}

/// Discs some three pixels wide: narrower ones are drawn as single pixels, which have no slope.
const WALL_DISC: f64 = 0.12;

/// Walls of a room that is open above and towards -y, and a screen in it, each of its own colour.
fn room(turn: DMat3) -> Vec<Chunk> {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let walls = [
        (DVec3::new(-2.0, -2.0, -1.2), [x * 4.0, y * 4.0], [200; 3]),
        (DVec3::new(-2.0, -2.0, -1.2), [y * 4.0, z * 2.4], [200, 40, 40]),
        (DVec3::new(1.8, -2.0, -1.0), [(y + x * 0.1) * 3.5, z * 1.4], [40, 200, 40]),
        (DVec3::new(-0.5, -0.3, -1.0), [x * 0.6 + y * 0.4, z * 0.9], [40, 40, 200]),
    ];
    let wall = |(corner, edges, color): (DVec3, [DVec3; 2], _)| {
        rectangle(turn * corner, edges.map(|edge| turn * edge), color, WALL_DISC)
    };
    walls.map(wall).to_vec()
}

/// The room with an exact blob in it, all turned with the camera and the light.
fn room_with_blob(stage: &Stage, turn: DMat3) -> Scene {
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(-0.2, -1.0, 0.35), 3.2, DVec3::Z);
    let camera = Camera { eye: turn * camera.eye, pivot: turn * camera.pivot, up: turn * camera.up };
    let mut scene = Scene::new(stage, camera);
    scene.add(room(turn), Material::default());
    let at = turn * DVec3::new(0.4, 0.5, 0.0);
    scene.mirrors.push(mirror(Shape::Blob, at, DQuat::from_mat3(&turn), 0.8));
    scene.lights.push(SpotLight {
        position: turn * DVec3::new(-1.0, -2.0, 3.0),
        target: DVec3::ZERO,
        intensity: [40.0; 3],
        inner_degrees: 30.0,
        outer_degrees: 40.0,
    });
    scene
}

#[test]
fn an_exact_planar_mirror_shows_what_a_mirrored_camera_sees() {
    let mut stage = stage_or_skip!();
    let normal = DVec3::new(0.1, -1.0, -0.25).normalize();
    let at = DVec3::Y * 2.6;
    let mirrored = |point: DVec3| point - normal * (2.0 * normal.dot(point - at));
    let camera = Camera::looking(DVec3::new(0.0, 2.0, 0.0), DVec3::new(-0.2, -1.0, 0.35), 3.2, DVec3::Z);
    let mut scene = Scene::new(&stage, camera);
    scene.add(room(DMat3::IDENTITY), Material::default());
    let mut through = Scene::new(&stage, camera);
    through.add(room(DMat3::IDENTITY), Material::default());
    through.camera =
        Camera { eye: mirrored(camera.eye), pivot: mirrored(camera.pivot), up: mirrored(at + camera.up) - at };
    scene.mirrors.push(mirror(Shape::Plane { height: 0.8 }, at, facing(normal), 1.3));
    through.render(&mut stage, &by_method("none"));
    let expected = read(&stage, Aov::Position);
    let (width, empty) = (SIZE[0] as usize, [f32::NAN; 3]);
    for method in TRACING {
        scene.render(&mut stage, &by_method(method));
        let (mask, seen) = (mask(&stage), seen(&stage));
        let (mut pixels, mut differing, mut errors) = (0, 0, Vec::new());
        for pixel in (0..mask.len()).filter(|pixel| mask[*pixel]) {
            // A mirror swaps left and right.
            let flipped = pixel - pixel % width + width - 1 - pixel % width;
            let expected = expected.as_chunks::<3>().0.get(flipped).unwrap_or(&empty);
            pixels += 1;
            match seen[pixel] {
                Some((at, _)) if !expected[0].is_nan() => {
                    let error = at.distance(Vec3::from(*expected).as_dvec3());
                    errors.push(error);
                    differing += usize::from(error > WALL_DISC);
                }
                None if expected[0].is_nan() => {}
                _ => differing += 1,
            }
        }
        let median = percentile(errors.clone(), 0.5);
        assert!(errors.len() > 1500 && pixels - errors.len() > 50, "{} of {pixels} see something", errors.len());
        // At outlines one picture draws a splat's rim over the pixel's centre and the other does not. In the camera's
        // picture, outlines are as wide as its pixels.
        let share = if method == "screen_trace" { 20 } else { 50 };
        assert!(differing * share < pixels && median < WALL_DISC / 50.0, "{method}: {differing} of {pixels}, {median}");
    }
}

#[test]
fn turning_scene_and_camera_together_changes_nothing() {
    let mut stage = stage_or_skip!();
    let turn = DMat3::from_rotation_z(1.1) * DMat3::from_rotation_x(0.4);
    for method in TRACING {
        room_with_blob(&stage, DMat3::IDENTITY).render(&mut stage, &by_method(method));
        let (mask_here, here) = (mask(&stage), seen(&stage));
        room_with_blob(&stage, turn).render(&mut stage, &by_method(method));
        let (mask_there, there) = (mask(&stage), seen(&stage));
        let mirrors = mask_here.iter().filter(|is_mirror| **is_mirror).count();
        // Single precision at the blob's outline.
        let masks_differ = mask_here.iter().zip(&mask_there).filter(|(a, b)| a != b).count();
        let pairs = || (0..here.len()).filter(|pixel| mask_here[*pixel] && mask_there[*pixel]);
        let seen_differ = pairs().filter(|pixel| here[*pixel].is_some() != there[*pixel].is_some()).count();
        let moved = |pixel: usize| Some((turn * here[pixel]?.0).distance(there[pixel]?.0));
        let errors: Vec<f64> = pairs().filter_map(moved).collect();
        let (p99, median) = (percentile(errors.clone(), 0.99), percentile(errors.clone(), 0.5));
        assert!(mirrors > 1000 && errors.len() * 3 > mirrors, "{mirrors} {}", errors.len());
        assert!(masks_differ <= 5 && seen_differ * 200 < mirrors, "{method}: {masks_differ}, {seen_differ}");
        // Normals are packed along the world's axes (0.06 degrees of a disc's radius), positions along the leaves'
        // boxes.
        assert!(p99 < WALL_DISC / 10.0 && median < WALL_DISC / 100.0, "{method}: {p99}, {median}");
    }
}

#[test]
fn a_mirror_that_reflects_nothing_gives_the_same_picture_as_no_reflections() {
    let mut stage = stage_or_skip!();
    let mut scene = room_with_blob(&stage, DMat3::IDENTITY);
    let mut picture = |scene: &Scene, method| {
        let mut settings = by_method(method);
        // Polished surfaces would reflect more the flatter they are seen; surfaces that reflect nothing stay unchanged.
        settings.set_text("mirror.fresnel", "1").unwrap();
        settings.set_text("mirror.tint", "1").unwrap();
        scene.render(&mut stage, &settings);
        (stage.renderer.read_picture().unwrap(), bits(&read(&stage, Aov::Color)))
    };
    let reflecting = picture(&scene, TRACING[0]);
    scene.mirrors[0].specular_intensity = 0.0;
    let none = picture(&scene, "none");
    assert!(reflecting != none);
    for method in [TRACING[0], TRACING[1], "sscr"] {
        let with = picture(&scene, method);
        // Two compilations of one shader may differ in the last bit of a half float.
        let furthest = none.1.iter().zip(&with.1).map(|(a, b)| f32::from_bits(*a) / f32::from_bits(*b));
        let furthest =
            furthest.filter(|ratio| !ratio.is_nan()).fold(0.0, |most: f32, ratio| most.max((ratio - 1.0).abs()));
        assert!(
            furthest < 1e-3 && with.0.iter().zip(&none.0).all(|(a, b)| a.abs_diff(*b) <= 1),
            "{method}: {furthest}"
        );
    }
}

/// Whether reflections were searched in a frame.
fn finds_anew(stats: &FrameStats) -> bool {
    stats.passes.iter().any(|pass| pass.name == "surfel_trace")
}

/// Whether points were splatted in a frame as the camera sees them.
fn splats_anew(stats: &FrameStats) -> bool {
    stats.passes.iter().any(|pass| pass.name == "splat_resolve" || pass.name == "splat_average")
}

#[test]
fn reflections_are_kept_until_something_they_depend_on_changes() {
    let mut stage = stage_or_skip!();
    let mut scene = room_with_blob(&stage, DMat3::IDENTITY);
    let mut settings = by_method("sscr_hierarchical");
    let first = scene.render(&mut stage, &settings);
    assert!(finds_anew(&first));
    let picture = stage.renderer.read_picture().unwrap();
    let color = bits(&read(&stage, Aov::Color));
    let second = scene.render(&mut stage, &settings);
    let is_kept = |pass: &PassTime| matches!(pass.stage, PassStage::Light | PassStage::View) || pass.name == "clear";
    assert!(second.passes.iter().all(is_kept), "{:?}", second.passes);
    assert!(stage.renderer.read_picture().unwrap() == picture && bits(&read(&stage, Aov::Color)) == color);
    assert_eq!(second.reflection, first.reflection);

    type Change = fn(&mut Scene, &mut Settings);
    let only_shading: [(&str, Change); 8] = [
        ("a brighter light", |scene, _| scene.lights[0].intensity = [60.0, 20.0, 20.0]),
        ("a light elsewhere", |scene, _| scene.lights[0].position.x = 1.0),
        ("the tint", |_, settings| settings.mirror.tint = 0.7),
        ("fresnel", |_, settings| settings.mirror.fresnel = 0.5),
        ("shadows", |_, settings| settings.light.shadow_bias = 0.5),
        ("the headlight", |_, settings| settings.set_text("light.by", "headlight").unwrap()),
        ("what is shown", |_, settings| settings.set_text("reflection.show", "distance").unwrap()),
        ("the picture again", |_, settings| settings.set_text("reflection.show", "picture").unwrap()),
    ];
    let only_found: [(&str, Change); 4] = [
        ("the mirror's place", |scene, _| scene.mirrors[0].position.x += 0.01),
        ("the mirror's turn", |scene, _| scene.mirrors[0].rotation *= DQuat::from_rotation_x(0.1)),
        ("the mirror's intensity", |scene, _| scene.mirrors[0].specular_intensity = 0.5),
        ("the bounces", |_, settings| settings.reflection.bounces = 2),
    ];
    let anew: [(&str, Change); 3] = [
        ("the camera", |scene, _| scene.camera.orbit(0.01, 0.0)),
        ("the splats", |_, settings| settings.splat.size = 1.2),
        ("more points", |scene, _| {
            let screen = [DVec3::X * 0.8, DVec3::Z * 0.8];
            scene.add(vec![rectangle(DVec3::new(-1.4, -0.8, -0.6), screen, [250; 3], 0.1)], Material::default());
        }),
    ];
    let changes = only_shading.iter().map(|change| (change, [false, false]));
    let changes = changes.chain(only_found.iter().map(|change| (change, [true, false])));
    let changes = changes.chain(anew.iter().map(|change| (change, [true, true])));
    for ((name, change), is_anew) in changes {
        let before = stage.renderer.read_picture().unwrap();
        change(&mut scene, &mut settings);
        let stats = scene.render(&mut stage, &settings);
        assert_eq!([finds_anew(&stats), splats_anew(&stats)], is_anew, "{name}");
        let after = stage.renderer.read_picture().unwrap();
        assert!(after != before, "{name} changes the picture");
        stage.renderer.forget();
        let forgotten = scene.render(&mut stage, &settings);
        assert!(finds_anew(&forgotten) && splats_anew(&forgotten), "{name}, forgotten");
        assert!(stage.renderer.read_picture().unwrap() == after, "{name}: kept parts fit those made anew");
    }
    settings.reflection.keep = false;
    assert!(finds_anew(&scene.render(&mut stage, &settings)));
}

#[test]
fn an_open_side_stays_open() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, five_mirrors::camera());
    // The last wall is the one behind the camera. The discs are small: they reach out of the box by half their radius.
    let walls = five_mirrors::walls().into_iter().take(5).map(|(surface, _)| match surface {
        Surface::Rectangle { corner, edges } => rectangle(corner, edges, [200; 3], 0.02),
        other => panic!("{other:?} is no wall"),
    });
    scene.add(walls.collect(), Material::default());
    scene.mirrors = Variant::Sphere.mirrors();
    for method in TRACING {
        let settings = settings(&[("reflection.method", method), ("mirror.surface", "exact")]);
        scene.render_sized(&mut stage, &settings, LARGE);
        let (mask, seen) = (mask(&stage), seen(&stage));
        let (mut mirrors, mut open, mut filled, mut missed) = (0, 0, 0, 0);
        for pixel in (0..mask.len()).filter(|pixel| mask[*pixel]) {
            let direction = pixel_direction(&scene.camera, LARGE, pixel);
            let Some(hit) = sphere_hit(scene.camera.eye, direction, DVec3::ZERO, 0.43) else { continue };
            let ray = reflected(direction, hit / 0.43);
            // The side through which the ray leaves the box x, y in [-1, 1], z in [-2, 2].
            let exits = (DVec3::new(1.0, 1.0, 2.0).copysign(ray) - hit) / ray;
            let is_open = ray.z > 0.0 && exits.z < exits.x.min(exits.y);
            mirrors += 1;
            open += usize::from(is_open);
            filled += usize::from(is_open && seen[pixel].is_some());
            missed += usize::from(!is_open && seen[pixel].is_none());
        }
        assert!(mirrors > 4000 && open * 20 > mirrors && open * 2 < mirrors, "{open} of {mirrors}");
        assert!(filled * 200 < mirrors && missed * 200 < mirrors, "{method}: {filled} filled, {missed} missed");
    }
}

/// The hit of a ray between two facing mirrors.
#[derive(Clone, Copy, PartialEq)]
enum Met {
    Left,
    Right,
    Patch,
    Nothing,
}

/// What facing mirrors reflect, and their own colour.
const INTENSITY: f64 = 0.75;
const GREY: f64 = 0.5;
/// Half the edge of facing mirrors.
const HALF: f64 = 2.0;
/// The borders of the patch between facing mirrors: low and high y, low and high z.
const PATCH: [f64; 4] = [1.2, 1.9, -0.4, 0.9];

/// Mirrors in x = -1 and x = 1, and a red patch between them.
fn facing_mirrors(stage: &Stage) -> Scene {
    let camera = Camera::looking(DVec3::new(1.0, 0.2, 0.1), DVec3::new(-1.5, -0.45, 0.2), 1.7, DVec3::Z);
    let mut scene = Scene::new(stage, camera);
    let [low_y, high_y, low_z, high_z] = PATCH;
    let edges = [DVec3::Y * (high_y - low_y), DVec3::Z * (high_z - low_z)];
    scene.add(vec![rectangle(DVec3::new(0.0, low_y, low_z), edges, [255, 0, 0], 0.02)], Material::default());
    for side in [-1.0, 1.0] {
        let plane = mirror(Shape::Plane { height: 1.0 }, DVec3::X * side, facing(-DVec3::X * side), HALF);
        let (color, specular_intensity) = ([GREY as f32; 3], INTENSITY as f32);
        scene.mirrors.push(Mirror { color, specular_intensity, ..plane });
    }
    scene
}

#[test]
fn as_many_reflections_are_followed_as_are_asked_for() {
    let mut stage = stage_or_skip!();
    // Blue is behind everything. Colours are shown as they are.
    let scene = facing_mirrors(&stage);
    let (camera, [low_y, high_y, low_z, high_z]) = (scene.camera, PATCH);
    let meet = |origin: DVec3, direction: DVec3| {
        let at = |x: f64| {
            let distance = (x - origin.x) / direction.x;
            (distance > 1e-6).then(|| (distance, origin + direction * distance))
        };
        let patch = at(0.0).filter(|(_, p)| (low_y..high_y).contains(&p.y) && (low_z..high_z).contains(&p.z));
        let is_on_mirror = |p: DVec3| p.y.abs() < HALF && p.z.abs() < HALF;
        let [left, right] = [-1.0, 1.0].map(|x| at(x).filter(|(_, p)| is_on_mirror(*p)));
        let candidates = [(Met::Patch, patch), (Met::Left, left), (Met::Right, right)];
        let hits = candidates.into_iter().filter_map(|(met, hit)| Some((met, hit?)));
        hits.min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0)).map_or((Met::Nothing, origin), |(met, (_, p))| (met, p))
    };
    // The hits of the ray through a place of the picture, one reflection after the other.
    let path = |x: f64, y: f64| {
        let (mut origin, mut direction) = (camera.eye, direction_through(&camera, SIZE, x, y));
        let mut met = [Met::Nothing; 5];
        for step in &mut met {
            (*step, origin) = meet(origin, direction);
            if matches!(*step, Met::Patch | Met::Nothing) {
                break;
            }
            direction.x = -direction.x;
        }
        met
    };
    // `last` is what a mirror shows that the last reflection meets.
    fn color(path: &[Met], bounces: usize, last: f64) -> DVec3 {
        match path[0] {
            Met::Patch => DVec3::X,
            Met::Nothing => DVec3::Z,
            Met::Left | Met::Right if bounces == 0 => DVec3::splat(last),
            Met::Left | Met::Right => DVec3::splat(GREY).lerp(color(&path[1..], bounces - 1, last), INTENSITY),
        }
    }
    for (bounces, last) in [(0, "matt"), (1, "matt"), (2, "matt"), (3, "matt"), (0, "dark"), (1, "dark"), (2, "dark")] {
        let settings = settings(&[
            ("reflection.bounces", &bounces.to_string()),
            ("mirror.last", last),
            ("light.by", "colors"),
            ("view.background", "#0000ff"),
        ]);
        scene.render(&mut stage, &settings);
        let image = read(&stage, Aov::Color);
        let (mut compared, mut patches) = (0, [0; 4]);
        for (pixel, shown) in image.as_chunks::<3>().0.iter().enumerate() {
            let (x, y) = ((pixel as u32 % SIZE[0]) as f64 + 0.5, (pixel as u32 / SIZE[0]) as f64 + 0.5);
            let path_here = path(x, y);
            // Away from outlines, which are as wide as a splat.
            let around = [-2.0, 0.0, 2.0].map(|dx| [-2.0, 0.0, 2.0].map(|dy| path(x + dx, y + dy)));
            if path_here[0] == Met::Nothing || around.iter().flatten().any(|path| *path != path_here) {
                continue;
            }
            let is_dark = last == "dark" && bounces > 0;
            let expected = color(&path_here, bounces, if is_dark { GREY * (1.0 - INTENSITY) } else { GREY });
            let error = (Vec3::from(*shown).as_dvec3() - expected).abs().max_element();
            // Half floats have three digits; the error occurs once a bounce.
            assert!(error < 3e-3, "{bounces} bounces at {x} {y}: {shown:?}, expected {expected}");
            compared += 1;
            let order = path_here.iter().position(|met| *met == Met::Patch);
            if let Some(count) = order.and_then(|order| patches.get_mut(order)) {
                *count += 1;
            }
        }
        assert!(compared > 10_000 && patches[1..].iter().all(|count| *count > 20), "{compared}, {patches:?}");
    }
}

#[test]
fn a_reflection_that_weighs_too_little_is_not_followed_and_its_mirror_shows_what_the_last_ones_show() {
    let mut stage = stage_or_skip!();
    let mut scene = facing_mirrors(&stage);
    scene.lights = vec![SpotLight {
        position: DVec3::new(0.5, -1.0, 1.0),
        target: DVec3::new(-0.5, 1.0, 0.0),
        intensity: [10.0; 3],
        inner_degrees: 50.0,
        outer_degrees: 60.0,
    }];
    // The weight of the second reflection is the square of the share, that of the third its cube.
    let [second, third] = [2, 3].map(|power| INTENSITY.powi(power));
    let cases = [(0.99 * third, 3), (1.01 * third, 2), (1.01 * second, 1), (1.0, 1)];
    for (light, last, method) in [
        ("colors", "matt", "surfel_trace"),
        ("lights", "matt", "surfel_trace"),
        ("colors", "dark", "surfel_trace"),
        ("lights", "dark", "sscr_hierarchical"),
        ("colors", "matt", "cubemap_trace"),
    ] {
        let mut settings = settings(&[("light.by", light), ("mirror.last", last), ("reflection.method", method)]);
        (settings.gi.bounces, settings.gi.vpls) = (1, 16);
        let picture = |stage: &mut Stage, settings: &Settings| {
            scene.render(stage, settings);
            bits(&read(stage, Aov::Color))
        };
        let [one, two, three] = [1, 2, 3].map(|bounces| {
            (settings.reflection.bounces, settings.reflection.least_weight) = (bounces, 0.0);
            picture(&mut stage, &settings)
        });
        assert!(one != two && two != three, "{light} {last} {method}");
        for (least, followed) in cases {
            settings.reflection.least_weight = least as f32;
            let expected = [&one, &two, &three][followed - 1];
            assert!(picture(&mut stage, &settings) == *expected, "{light} {last} {method}: {least}");
        }
        // Another law of the angle changes weights: what was found before it does not stay.
        settings.reflection.least_weight = 1.01 * third as f32;
        settings.mirror.fresnel = 1.0;
        let kept = picture(&mut stage, &settings);
        stage.renderer.forget();
        assert!(picture(&mut stage, &settings) == kept, "{light} {last} {method}: kept");
        assert!(kept != two, "{light} {last} {method}");
    }
}

#[test]
fn beams_lose_nothing() {
    let mut stage = stage_or_skip!();
    for variant in [Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral] {
        let mut scene = Scene::new(&stage, five_mirrors::camera());
        for part in five_mirrors::sample(variant, 60_000, 1) {
            let specular_intensity = if part.mirror.is_some() { 1.0 } else { 0.0 };
            scene.add(part.chunks, Material { specular_intensity, ..Material::default() });
        }
        let images = TRACING.map(|method| {
            scene.render_sized(&mut stage, &by_method(method), [200, 150]);
            read(&stage, Aov::MirrorPosition)
        });
        let filled = images[0].as_chunks::<4>().0.iter().filter(|p| p[3] > 0.0).count();
        let differing = images[0].iter().zip(&images[1]).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert!(filled > 1000, "{variant:?}: {filled}");
        assert_eq!(differing, 0, "{variant:?}");
    }
}

#[test]
fn points_of_unknown_spacing_are_reflected_as_discs_that_face_the_ray() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, Camera::looking(DVec3::ZERO, DVec3::new(0.1, -1.0, 0.5), 4.0, DVec3::Z));
    scene.mirrors.push(mirror(Shape::Plane { height: 1.0 }, DVec3::ZERO, DQuat::IDENTITY, 1.5));
    let full = rectangle(DVec3::new(-4.0, 3.0, 0.1), [DVec3::X * 8.0, DVec3::Z * 5.0], [200; 3], 0.1);
    let bare = Chunk { normals: None, radii: None, ..full.clone() };
    let cloud = scene.store.add_cloud(Material::default());
    let id = scene.store.add_chunk(cloud, &bare, None).unwrap();
    // The camera's picture has discs that face the camera.
    for method in &TRACING[..2] {
        scene.store.update_chunk(id, &bare, None).unwrap();
        scene.store.set_provisional_radius(cloud, 0.1);
        // The share of the mirror that sees the wall, the largest distance from the closed form's hit, and the share of
        // the normals that point back along the ray.
        let mut measure = |scene: &Scene| {
            scene.render(&mut stage, &by_method(method));
            let (mask, seen, position) = (mask(&stage), seen(&stage), read(&stage, Aov::Position));
            let normal = read(&stage, Aov::MirrorNormal);
            let (mut inside, mut found, mut most, mut back) = (0, 0, 0.0_f64, 1.0_f64);
            for pixel in (0..mask.len()).filter(|pixel| mask[*pixel]) {
                let at = Vec3::from(position.as_chunks::<3>().0[pixel]).as_dvec3();
                let ray = reflected((at - scene.camera.eye).normalize(), DVec3::Z);
                let truth = at + ray * ((3.0 - at.y) / ray.y);
                if truth.x.abs() < 3.8 && (0.3..4.9).contains(&truth.z) {
                    inside += 1;
                    if let Some((at, true)) = seen[pixel] {
                        found += 1;
                        most = most.max(at.distance(truth));
                        back = back.min(-Vec3::from(normal.as_chunks::<3>().0[pixel]).as_dvec3().dot(ray));
                    }
                }
            }
            assert!(inside > 1000, "{inside}");
            (f64::from(found) / f64::from(inside), most, back)
        };
        let provisional = measure(&scene);
        // Radii have a precision of 2.2 %, rounded up, positions of a thousandth of a leaf.
        assert!(provisional.0 == 1.0 && provisional.1 <= 0.103 && provisional.2 > 0.9999, "{method}: {provisional:?}");
        scene.store.set_provisional_radius(cloud, 0.01);
        let small = measure(&scene);
        assert!(small.0 < 0.1 && small.1 <= 0.0103, "{method}: {small:?}");
        scene.store.update_chunk(id, &full, None).unwrap();
        let known = measure(&scene);
        assert!(known.0 == 1.0 && known.1 < 1e-3 && known.2 < 0.99, "{method}: {known:?}");
    }
}

#[test]
fn two_stores_in_turn_show_each_its_own_points() {
    let mut stage = stage_or_skip!();
    let scene = |color, x: f64| {
        let mut scene = Scene::new(&stage, front_camera());
        let corner = DVec3::new(x, -2.0, FLOOR);
        // Chunks of different numbers, so that the same chunk lies elsewhere.
        let parts = if x < 0.0 { 3 } else { 1 };
        let part = |i: i32| {
            let width = 2.0 / f64::from(parts);
            rectangle(corner + DVec3::X * (width * f64::from(i)), [DVec3::X * width, DVec3::Y * 4.0], color, DISC)
        };
        scene.add((0..parts).map(part).collect(), Material::default());
        scene.mirrors.push(mirror(Shape::Sphere, SPHERE_CENTER, DQuat::IDENTITY, SPHERE_RADIUS));
        scene
    };
    let scenes = [scene([250, 0, 0], -2.0), scene([0, 250, 0], 0.0)];
    for method in TRACING {
        let settings = by_method(method);
        let mut frames = [0, 1, 0, 1].map(|index| {
            scenes[index].render(&mut stage, &settings);
            (bits(&read(&stage, Aov::MirrorPosition)), bits(&read(&stage, Aov::MirrorAlbedo)))
        });
        let [a, b, again_a, again_b] = frames.each_mut();
        assert!(a != b && a == again_a && b == again_b, "{method}");
    }
}

/// A scene that extends beyond the picture's right edge.
const OFF_CENTER: DVec3 = DVec3::new(0.9, 0.2, 0.3);

fn shapes_and_projections() -> impl Iterator<Item = (Shape, &'static str)> {
    let torus = (Shape::Torus { tube: 0.4 }, "orthographic");
    Shape::WITH_FORMULA.into_iter().map(|shape| (shape, "perspective")).chain([torus])
}

/// The number of pixels of one mask that are not beside any of the other, both ways.
fn beyond_silhouette(a: &[bool], b: &[bool]) -> usize {
    let (wide_a, wide_b) = (dilated(a, LARGE), dilated(b, LARGE));
    (0..a.len()).filter(|pixel| a[*pixel] && !wide_b[*pixel] || b[*pixel] && !wide_a[*pixel]).count()
}

/// The distance from a mirror's surface and the unit normal there, for a nearby place in the mirror's own coordinates.
fn surface_at(shape: &Shape, p: DVec3) -> (f64, DVec3) {
    match (shape, mirror(shape.clone(), DVec3::ZERO, DQuat::IDENTITY, 1.0).surface().0) {
        (Shape::Plane { .. }, _) => (p.z, DVec3::Z),
        (Shape::Sphere, _) => (p.length() - 1.0, p.normalize()),
        (Shape::Paraboloid { focal_length }, _) => {
            let normal = DVec3::new(-p.x, -p.y, 2.0 * focal_length).normalize();
            ((p.z - (p.x * p.x + p.y * p.y) / (4.0 * focal_length)) * normal.z, normal)
        }
        (Shape::Cylinder { .. }, _) => (p.x.hypot(p.y) - 1.0, DVec3::new(p.x, p.y, 0.0).normalize()),
        (Shape::Torus { tube }, _) => {
            let from_ring = p - DVec3::new(p.x, p.y, 0.0).normalize();
            (from_ring.length() - tube, from_ring.normalize())
        }
        (_, Surface::Star(star)) => {
            let point = star.point(p.normalize());
            ((p - point.position).dot(point.normal), point.normal)
        }
        (shape, surface) => panic!("{shape:?} is no {surface:?}"),
    }
}

#[test]
fn mirrors_by_their_formula_lie_on_their_surface() {
    let mut stage = stage_or_skip!();
    let turn = DQuat::from_rotation_x(0.5) * DQuat::from_rotation_z(0.8);
    for (shape, projection) in shapes_and_projections() {
        let mut scene = Scene::new(&stage, front_camera());
        scene.mirrors.push(mirror(shape.clone(), OFF_CENTER, turn, 0.8));
        let settings = settings(&[("view.projection", projection), ("reflection.method", "none")]);
        scene.render(&mut stage, &settings);
        let (mask, position, normal) = (mask(&stage), read(&stage, Aov::Position), read(&stage, Aov::Normal));
        let (mut offsets, mut angles) = (Vec::new(), Vec::new());
        for pixel in (0..mask.len()).filter(|pixel| mask[*pixel]) {
            let at = |image: &[f32]| Vec3::from(image.as_chunks::<3>().0[pixel]).as_dvec3();
            let (off, expected) = surface_at(&shape, turn.inverse() * (at(&position) - OFF_CENTER) / 0.8);
            offsets.push(off.abs());
            // Normals are turned to the eye.
            let angle = at(&normal).angle_between(turn * expected).to_degrees();
            angles.push(angle.min(180.0 - angle));
        }
        let off = percentile(offsets, 1.0);
        let [median, most] = [0.5, 1.0].map(|share| percentile(angles.clone(), share));
        assert!(angles.len() > 800 && off < 1e-5, "{shape:?} {projection}: {} pixels, {off} off", angles.len());
        assert!(median < 0.02 && most < 0.1, "{shape:?} {projection}: {median} {most} degrees");
    }
}

#[test]
fn mirrors_by_their_formula_agree_with_their_samples() {
    let mut stage = stage_or_skip!();
    let turn = DQuat::from_rotation_x(0.5) * DQuat::from_rotation_z(0.8);
    for (shape, projection) in shapes_and_projections() {
        let place = mirror(shape.clone(), OFF_CENTER, turn, 0.8);
        let settings = settings(&[("view.projection", projection), ("reflection.method", "none")]);
        let mut exact = Scene::new(&stage, front_camera());
        exact.mirrors.push(place.clone());
        let mut sampled = Scene::new(&stage, front_camera());
        sampled.add(place.sample(200_000, 1), Material { specular_intensity: 1.0, ..Material::default() });
        let [a, b] = [exact, sampled].map(|scene| {
            scene.render_sized(&mut stage, &settings, LARGE);
            (mask(&stage), read(&stage, Aov::Position), read(&stage, Aov::Normal))
        });
        let pixels = a.0.iter().filter(|is_mirror| **is_mirror).count();
        let inside: Vec<usize> = (0..a.0.len()).filter(|pixel| a.0[*pixel] && b.0[*pixel]).collect();
        let at = |image: &[f32], pixel: &usize| Vec3::from(image.as_chunks::<3>().0[*pixel]).as_dvec3();
        let off = |pixel| (at(&b.1, pixel) - at(&a.1, pixel)).dot(at(&a.2, pixel)).abs();
        let offsets = inside.iter().map(off).collect();
        let angle = |pixel| at(&a.2, pixel).angle_between(at(&b.2, pixel)).to_degrees();
        let angles: Vec<f64> = inside.iter().map(angle).collect();
        let beyond = beyond_silhouette(&a.0, &b.0);
        let off = percentile(offsets, 0.95);
        let [median, p95] = [0.5, 0.95].map(|share| percentile(angles.clone(), share));
        assert!(pixels > 800 && beyond == 0, "{shape:?} {projection}: {pixels} pixels, {beyond} beyond the outline");
        // A splat is a pixel wide and takes the mean of its surroundings: outlines of round things are a few degrees
        // off. A bump of the coral is seven pixels wide: normals change by ten degrees from one pixel to the next.
        let most = if shape == Shape::Coral { [0.01, 3.0, 25.0] } else { [0.001, 0.5, 4.0] };
        assert!(
            off < most[0] && median < most[1] && p95 < most[2],
            "{shape:?} {projection}: {off}, {median} {p95} degrees"
        );
    }
}
