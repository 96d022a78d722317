//! The truth through the real program: the ray tracer's images against closed forms, the figures that come from them, and the
//! ray tracer as a method.

use std::f64::consts::PI;
use std::path::Path;

use exr::prelude::read_first_flat_layer_from_file;
use serde_json::Value;
use tests::{Folder, Outcome};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const SCENE: &str = "five-mirrors/sphere";
/// At 160x120 a splat is three pixels wide at the back wall.
const POINTS: &str = "scene.points=60000";

type Vector = [f64; 3];

/// `glint render ARGUMENTS` at 160x120. None, with a note, where there is no adapter to draw with and none is required.
fn render<'a>(folder: &Folder, arguments: impl IntoIterator<Item = &'a str>) -> Option<Outcome> {
    let common = ["render", "-o", "picture.png", "--size", "160x120"];
    let outcome = folder.glint(common.into_iter().chain(arguments));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    assert_eq!(outcome.status, Some(0), "{outcome}");
    Some(outcome)
}

/// The sphere with few points, in direct light; `arguments` in words.
fn render_sphere(folder: &Folder, arguments: &str) -> Option<Outcome> {
    let scene = [SCENE, "--set", POINTS, "--set", "gi.bounces=0"];
    render(folder, scene.into_iter().chain(arguments.split_whitespace()))
}

fn stats(folder: &Folder) -> Value {
    let text = std::fs::read_to_string(folder.path("stats.json")).expect("the statistics");
    serde_json::from_str(&text).expect("JSON")
}

fn accuracy(folder: &Folder) -> Value {
    stats(folder)["accuracy"].clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// Pixels of a float image from the top, of channels X, Y, Z or R, G, B or the only one; NaN where it has fewer.
fn pixels(folder: &Folder, name: &str) -> Vec<Vector> {
    let path = folder.path(name);
    let image = read_first_flat_layer_from_file(Path::new(&path)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let channels = image.layer_data.channel_data.list;
    let values = |names: [&str; 3]| {
        let channel = channels.iter().find(|channel| names.iter().any(|name| channel.name.eq(name)));
        let values = channel.map(|channel| channel.sample_data.values_as_f32().map(f64::from).collect());
        values.unwrap_or_else(|| vec![f64::NAN; WIDTH * HEIGHT])
    };
    let [first, second, third]: [Vec<f64>; 3] = [["X", "R", "Y"], ["Y", "G", ""], ["Z", "B", ""]].map(values);
    assert_eq!(first.len(), WIDTH * HEIGHT);
    first.into_iter().zip(second).zip(third).map(|((x, y), z)| [x, y, z]).collect()
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn along(from: Vector, direction: Vector, distance: f64) -> Vector {
    [0, 1, 2].map(|axis| from[axis] + direction[axis] * distance)
}

fn unit(vector: Vector) -> Vector {
    vector.map(|value| value / dot(vector, vector).sqrt())
}

const EYE: Vector = [0.0, 0.0, 1.9];
const SPHERE_RADIUS: f64 = 0.43;

/// Where the ray through a pixel's centre meets the sphere; the camera looks along -z with 60 degrees of view.
fn on_sphere(pixel: usize) -> Option<Vector> {
    let slope = 30_f64.to_radians().tan() / (HEIGHT as f64 / 2.0);
    let right = ((pixel % WIDTH) as f64 + 0.5 - WIDTH as f64 / 2.0) * slope;
    let up = (HEIGHT as f64 / 2.0 - (pixel / WIDTH) as f64 - 0.5) * slope;
    let direction = unit([right, up, -1.0]);
    let middle = -dot(EYE, direction);
    let root = middle * middle - dot(EYE, EYE) + SPHERE_RADIUS * SPHERE_RADIUS;
    (root > 0.0).then(|| along(EYE, direction, middle - root.sqrt()))
}

/// Where the eye's ray to `point`, reflected there, meets the box |x|, |y| <= 1, |z| <= 2.
fn in_box(point: Vector, normal: Vector) -> Vector {
    let incoming = unit(minus(point, EYE));
    let direction = along(incoming, normal, -2.0 * dot(incoming, normal));
    let walls = [1.0, 1.0, 2.0];
    let to_wall = [0, 1, 2].map(|axis| (walls[axis] * direction[axis].signum() - point[axis]) / direction[axis]);
    along(point, direction, to_wall.into_iter().fold(f64::INFINITY, f64::min))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[test]
fn the_reference_is_where_sphere_and_box_put_it() {
    let folder = Folder::new();
    let images = "--aov reference_position=truth.exr --aov position=position.exr --aov normal=normal.exr";
    // A splat's radius: 1.5 times that of a disc with a point's share of the 40 of the box and 2.3 of the sphere.
    let footprint = 1.5 * (42.3 / (std::f64::consts::PI * 60_000.0)).sqrt();
    for surface in ["exact", "points"] {
        let Some(_) = render_sphere(&folder, &format!("{images} --set mirror.surface={surface}")) else { return };
        let [truth, position, normal] = ["truth.exr", "position.exr", "normal.exr"].map(|name| pixels(&folder, name));
        let (mut from_frame, mut from_sphere) = (Vec::new(), Vec::new());
        for (pixel, seen) in truth.iter().enumerate() {
            if seen[0].is_nan() {
                continue;
            }
            let distance = |expected: Vector| dot(minus(*seen, expected), minus(*seen, expected)).sqrt();
            from_frame.push(distance(in_box(position[pixel], unit(normal[pixel]))));
            if let Some(point) = on_sphere(pixel) {
                from_sphere.push(distance(in_box(point, point.map(|along| along / SPHERE_RADIUS))));
            }
        }
        // The outline is a disc of radius 24.1 pixels.
        assert!((1700..2000).contains(&from_frame.len()), "{} pixels", from_frame.len());
        // Normals of discs have 16 bits a coordinate, positions 24.
        assert!(median(from_frame) < 1e-4, "{surface}, from the frame's own surface");
        // Splats turn the normal by a share of their width over the sphere's radius; the reflected ray by twice as much, and
        // carry it on to the walls.
        let bound = if surface == "exact" { 1e-5 } else { footprint * 2.0 / SPHERE_RADIUS };
        let found = median(from_sphere);
        assert!(found < bound, "{surface}: {found} from the exact sphere");
    }
}

#[test]
fn figures_tell_how_good_a_method_is_by_either_truth() {
    let folder = Folder::new();
    let judged = |method: &str, truth: &str| {
        let words = format!("--method {method} --truth {truth} --stats stats.json");
        render_sphere(&folder, &words).map(|_| accuracy(&folder))
    };
    let Some(found) = judged("sscr_hierarchical", "same_input") else { return };
    assert_eq!(found["truth"], "same_input");
    assert!(number(&found["mirror_pixels"]) > 1700.0, "{found}");
    assert!(number(&found["closed_coverage"]) > 0.98 && number(&found["false_fill"]) < 0.01, "{found}");
    assert!(number(&found["pixel_error"]["median"]) < 0.5 && number(&found["pixel_error"]["p95"]) < 2.0, "{found}");
    assert!(number(&found["occlusion_error"]) < 0.05 && number(&found["recall"]) > 0.95, "{found}");
    let image = &found["image"];
    assert!(number(&image["rmse"]) < 0.05 && number(&image["delta_e"]) < 2.0, "{found}");
    assert!(number(&image["flip"]) < 0.1, "{found}");

    // What the points are off by comes on top.
    let Some(exact) = judged("sscr_hierarchical", "exact") else { return };
    assert_eq!(exact["truth"], "exact");
    let [points_off, off] = [&found, &exact].map(|figures| number(&figures["angle_error"]["median"]));
    assert!(off > 10.0 * points_off && number(&exact["pixel_error"]["median"]) < 1.0, "{exact}");
    assert!(number(&exact["image"]["delta_e"]) > number(&image["delta_e"]), "{exact}");

    let Some(none) = judged("none", "same_input") else { return };
    assert!(number(&none["closed_coverage"]) == 0.0 && none["pixel_error"]["median"].is_null(), "{none}");
    assert!(number(&none["image"]["delta_e"]) > 10.0, "{none}");
}

#[test]
fn a_reference_image_brings_the_figures_along() {
    let folder = Folder::new();
    let Some(_) = render_sphere(&folder, "--stats stats.json") else { return };
    assert!(accuracy(&folder).is_null());
    let Some(_) = render_sphere(&folder, "--aov reference_color=truth.exr --stats stats.json") else { return };
    assert_eq!(accuracy(&folder)["truth"], "same_input");
}

/// The box alone with few points; `arguments` in words. Only its truth counts, which knows no virtual lights.
fn render_box(folder: &Folder, arguments: &str) -> Option<Outcome> {
    let scene = ["five-mirrors/none", "--set", POINTS, "--set", "gi.vpls=16"];
    render(folder, scene.into_iter().chain(arguments.split_whitespace()))
}

/// Over the pixels that have any.
fn mean(image: &[Vector]) -> f64 {
    let values: Vec<f64> = image.iter().flatten().copied().filter(|value| value.is_finite()).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn estimates_have_their_names_and_hold_the_figures_of_the_truth() {
    let folder = Folder::new();
    let words =
        "--method sscr --truth same_input --estimate --seed 7 --stats stats.json --set gi.bounces=1 --set gi.vpls=64";
    if render_sphere(&folder, words).is_none() {
        return;
    }
    let found = stats(&folder);
    let (estimate, figures) = (&found["estimate"], &found["accuracy"]);
    assert_eq!(estimate["rays"], 500);
    for (interval, figure) in [
        (&estimate["wrong_interval"], &figures["wrong"]),
        (&estimate["pixel_error"]["median_interval"], &figures["pixel_error"]["median"]),
        (&estimate["pixel_error"]["p95_interval"], &figures["pixel_error"]["p95"]),
    ] {
        let [low, high] = [&interval[0], &interval[1]].map(number);
        assert!(low <= number(figure) && number(figure) <= high, "{estimate}, {figures}");
    }
    for share in [&estimate["wrong"], &estimate["indirect"]["relative_rmse"]] {
        assert!((0.01..0.99).contains(&number(share)), "{estimate}");
    }
    // Reflections without indirect light, and neither.
    render_sphere(&folder, "--method surfel_trace --estimate --stats stats.json");
    let estimate = &stats(&folder)["estimate"];
    assert!(estimate["indirect"].is_null() && number(&estimate["pixel_error"]["median"]) < 0.01, "{estimate}");
    render_sphere(&folder, "--method none --estimate --stats stats.json");
    assert!(stats(&folder)["estimate"].is_null());
}

#[test]
fn reference_indirect_is_what_reference_color_has_beside_direct_light() {
    let folder = Folder::new();
    let images = "--set trace.samples=3 --aov reference_color=full.exr --aov reference_indirect=indirect.exr";
    let Some(_) = render_box(&folder, images) else { return };
    let Some(_) = render_box(&folder, "--set gi.bounces=0 --aov reference_color=direct.exr") else { return };
    let [full, indirect, direct] = ["full.exr", "indirect.exr", "direct.exr"].map(|name| pixels(&folder, name));
    let mut lit = 0;
    for ((full, indirect), direct) in
        full.iter().zip(&indirect).zip(&direct).filter(|(_, direct)| direct[0].is_finite())
    {
        let off = minus(minus(*full, *direct), *indirect);
        assert!(dot(off, off).sqrt() < 1e-5, "{full:?} {direct:?} {indirect:?}");
        lit += usize::from(indirect[0] > 0.0);
    }
    assert!(lit > 5000, "{lit}");
    // One seed always gives the same paths, another one others.
    let Some(_) = render_box(&folder, &format!("{images} --set trace.seed=2")) else { return };
    assert!(pixels(&folder, "indirect.exr") != indirect);
    let Some(_) = render_box(&folder, images) else { return };
    // NaN differs from itself.
    let bits = |image: &[Vector]| image.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&pixels(&folder, "indirect.exr")), bits(&indirect));
}

#[test]
fn indirect_light_of_the_points_is_that_of_the_exact_box() {
    let folder = Folder::new();
    let traced = |words: &str| {
        let image = "--set trace.samples=16 --aov reference_indirect=indirect.exr";
        render_box(&folder, &format!("{image} {words}")).map(|_| pixels(&folder, "indirect.exr"))
    };
    let (Some(points), Some(exact)) = (traced(""), traced("--truth exact --stats a.json")) else { return };
    let ratio = mean(&points) / mean(&exact);
    assert!(mean(&exact) > 0.005 && (ratio - 1.0).abs() < 0.03, "{ratio}");
    // Neither sun nor sky shines into a closed box; but some pixels' rays end on its very edges, in two walls at once.
    let Some(sun) = traced("--set light.by=sun --truth exact --stats a.json") else { return };
    assert!(mean(&sun) < 1e-3, "{}", mean(&sun));
    assert!(median(sun.into_iter().flatten().collect()) == 0.0);
    // A lamp at the eye has no indirect light.
    for light in ["headlight", "colors"] {
        let Some(image) = traced(&format!("--set light.by={light} --truth exact --stats a.json")) else { return };
        assert_eq!(mean(&image), 0.0, "{light}");
    }
}

#[test]
fn light_of_formulas_in_other_colours_is_refused() {
    let folder = Folder::new();
    let words =
        ["--set", "color.by=height", "--aov", "reference_indirect=a.exr", "--truth", "exact", "--stats", "a.json"];
    let outcome = folder.glint(["render", SCENE, "-o", "a.png"].into_iter().chain(words));
    assert_eq!(outcome.status, Some(2), "{outcome}");
    for word in ["--truth exact", "reference_indirect", "color.by", "height", "same_input"] {
        assert!(outcome.messages.contains(word), "`{word}` is not mentioned: {outcome}");
    }
    assert_eq!(outcome.messages.trim().lines().count(), 1, "{outcome}");
}

#[test]
fn the_exact_truth_of_a_file_is_refused() {
    let folder = Folder::new();
    let cloud = folder.write("cloud.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n");
    let cloud = cloud.display().to_string();
    let outcome = folder.glint(["render", &cloud, "-o", "a.png", "--truth", "exact", "--stats", "a.json"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    for word in ["--truth exact", "built-in scene", "meshes", "cloud.ply", "same_input"] {
        assert!(outcome.messages.contains(word), "`{word}` is not mentioned: {outcome}");
    }
    assert_eq!(outcome.messages.trim().lines().count(), 1, "{outcome}");
}

/// Points on one side of a wall of the box.
const ROWS: usize = 60;

/// The places of a grid of `rows` x `rows` on each wall of the box |x|, |y| <= 1, |z| <= 2, in rows, and the wall's normal.
fn walls(rows: usize) -> Vec<(Vector, Vector)> {
    let mut points = Vec::new();
    let half = [1.0, 1.0, 2.0];
    for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0), (2, -1.0), (2, 1.0)] {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let mut normal = [0.0; 3];
        normal[axis] = -side;
        for place in 0..rows * rows {
            let mut point = half.map(|half| half * side);
            point[u] = half[u] * (2.0 * (place % rows) as f64 / (rows - 1) as f64 - 1.0);
            point[v] = half[v] * (2.0 * (place / rows) as f64 / (rows - 1) as f64 - 1.0);
            points.push((point, normal));
        }
    }
    points
}

/// The two triangles of each cell of such grids, whose points follow `first`.
fn cells(rows: usize, first: usize) -> Vec<[usize; 3]> {
    let corners = (0..6 * rows * rows).filter(|point| point % rows < rows - 1 && point / rows % rows < rows - 1);
    corners
        .flat_map(|point| [[point, point + 1, point + rows + 1], [point, point + rows + 1, point + rows]])
        .map(|triangle| triangle.map(|corner| corner + first))
        .collect()
}

/// A mesh whose vertices have the colours of three waves; normals where `has_normals`.
fn write_mesh(folder: &Folder, points: &[(Vector, Vector)], triangles: &[[usize; 3]], has_normals: bool) {
    let normals = if has_normals { "property float nx\nproperty float ny\nproperty float nz\n" } else { "" };
    let mut mesh = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{normals}\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        points.len(),
        triangles.len()
    );
    let words = |vector: Vector| vector.map(|value| value.to_string()).join(" ");
    for (point, normal) in points {
        let normal = if has_normals { words(*normal) + " " } else { String::new() };
        let color = point.map(|value| ((128.0 + 100.0 * (value * 6.0).sin()) as u8).to_string()).join(" ");
        mesh.push_str(&format!("{} {normal}{color}\n", words(*point)));
    }
    for [a, b, c] in triangles {
        mesh.push_str(&format!("3 {a} {b} {c}\n"));
    }
    folder.write("room.ply", mesh);
}

/// The mesh with a sphere in its middle, by the exact truth.
fn judge_mesh(folder: &Folder, arguments: &str) -> Option<Value> {
    folder.write(
        "scene.toml",
        "clouds = [\"room.ply\"]\n[camera]\neye = [0, 0, 1.9]\npivot = [0, 0, 0]\nup = [0, 1, 0]\n\
         [[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 0.43\n",
    );
    let words = "scene.toml --method surfel_trace --truth exact --stats stats.json --set light.by=colors";
    render(folder, words.split_whitespace().chain(arguments.split_whitespace())).map(|_| accuracy(folder))
}

#[test]
fn the_exact_truth_of_a_mesh_is_its_triangles() {
    let folder = Folder::new();
    write_mesh(&folder, &walls(ROWS), &cells(ROWS, 0), false);
    for arguments in ["", "--set color.by=height"] {
        let Some(found) = judge_mesh(&folder, arguments) else { return };
        assert_eq!(found["truth"], "exact");
        assert!(number(&found["mirror_pixels"]) > 1700.0, "{found}");
        assert!(number(&found["closed_coverage"]) > 0.99 && number(&found["false_fill"]) == 0.0, "{found}");
        assert!(number(&found["pixel_error"]["median"]) < 0.5 && number(&found["pixel_error"]["p95"]) < 2.0, "{found}");
        assert!(number(&found["occlusion_error"]) < 0.02, "{found}");
        assert!(number(&found["image"]["delta_e"]) < 5.0, "{found}");
        // The room's half width is 1.
        let surface = &found["surface"];
        assert!(number(&surface["position_error"]["median"]) < 1e-3, "{found}");
        assert!(number(&surface["missing"]) < 0.01 && number(&surface["false_fill"]) == 0.0, "{found}");
    }
}

/// The sphere of `judge_mesh` as a mesh: rings of corners from pole to pole, two triangles between each four.
fn write_ball(folder: &Folder) {
    const RINGS: usize = 24;
    let mut mesh = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (RINGS + 1) * 2 * RINGS,
        2 * RINGS * RINGS
    );
    for (ring, turn) in (0..=RINGS).flat_map(|ring| (0..2 * RINGS).map(move |turn| (ring, turn))) {
        let (down, around) = (PI * ring as f64 / RINGS as f64, PI * turn as f64 / RINGS as f64);
        let [x, y, z] = [down.sin() * around.cos(), down.sin() * around.sin(), down.cos()].map(|value| 7.0 * value);
        mesh.push_str(&format!("{} {} {}\n", 90.0 + x, y, z));
    }
    for (ring, turn) in (0..RINGS).flat_map(|ring| (0..2 * RINGS).map(move |turn| (ring, turn))) {
        let corner = |ring: usize, turn: usize| ring * 2 * RINGS + turn % (2 * RINGS);
        let [a, b] = [turn, turn + 1].map(|turn| corner(ring, turn));
        let [c, d] = [turn + 1, turn].map(|turn| corner(ring + 1, turn));
        mesh.push_str(&format!("4 {d} {c} {b} {a}\n"));
    }
    folder.write("ball.ply", mesh);
}

#[test]
fn a_mesh_as_a_mirror_reflects_by_its_points_as_its_triangles_do() {
    let folder = Folder::new();
    write_mesh(&folder, &walls(ROWS), &cells(ROWS, 0), false);
    write_ball(&folder);
    folder.write(
        "scene.toml",
        "clouds = [\"room.ply\"]\n[camera]\neye = [0, 0, 1.9]\npivot = [0, 0, 0]\nup = [0, 1, 0]\n\
         [[mirrors]]\nshape = { mesh = \"ball.ply\" }\nposition = [0, 0, 0]\nsize = 0.43\n",
    );
    for method in ["sscr_hierarchical", "surfel_trace"] {
        let words = format!("scene.toml --method {method} --truth exact --stats stats.json --set light.by=colors");
        let Some(_) = render(&folder, words.split_whitespace()) else { return };
        let found = accuracy(&folder);
        assert!(number(&found["mirror_pixels"]) > 1700.0, "{found}");
        assert!(number(&found["closed_coverage"]) > 0.98, "{found}");
        assert!(number(&found["pixel_error"]["median"]) < 1.0, "{found}");
        assert!(number(&found["surface"]["position_error"]["median"]) < 2e-3, "{found}");
    }
}

#[test]
fn a_mesh_that_is_missing_is_told_and_the_rest_is_shown() {
    let folder = Folder::new();
    let mirror = |name: &str| {
        format!(
            "[[mirrors]]\nname = \"{name}\"\nshape = {{ mesh = \"{name}.ply\" }}\nposition = [0, 0, 0]\nsize = 0.4\n"
        )
    };
    folder.write("points.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n");
    folder.write("scene.toml", format!("clouds = [\"five-mirrors/none\"]\n{}{}", mirror("gone"), mirror("points")));
    let outcome = folder.glint(["render", "scene.toml", "-o", "picture.png", "--size", "160x120", "--set", POINTS]);
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        return println!("skipped: no adapter: {}", outcome.messages.trim());
    }
    assert_eq!(outcome.status, Some(2), "{outcome}");
    for told in ["mirror `gone`: ", "gone.ply", "mirror `points`: ", "has no faces"] {
        assert!(outcome.messages.contains(told), "{told}: {outcome}");
    }
    assert!(folder.path("picture.png").exists());
}

#[test]
fn points_that_do_not_lie_on_their_triangles_are_caught() {
    let folder = Folder::new();
    let judged = |scale: f64| {
        // Points that are drawn and no corners of triangles, and two triangles a wall.
        let mut points = walls(ROWS);
        points.iter_mut().for_each(|(point, _)| *point = point.map(|value| value * scale));
        let first = points.len();
        points.extend(walls(2));
        write_mesh(&folder, &points, &cells(2, first), true);
        judge_mesh(&folder, "")
    };
    let (Some(right), Some(wrong)) = (judged(1.0), judged(1.05)) else { return };
    assert!(number(&right["pixel_error"]["median"]) < 0.5 && number(&right["occlusion_error"]) < 0.02, "{right}");
    assert!(number(&right["surface"]["position_error"]["median"]) < 1e-3, "{right}");
    // Beside the sphere, of the radius 0.43, a wall that is moved from 1 to 1.05 is more than 5 % farther away.
    assert!(number(&wrong["occlusion_error"]) > 0.5, "{wrong}");
    assert!(number(&wrong["surface"]["position_error"]["median"]) > 0.03, "{wrong}");
}

#[test]
fn the_ray_tracer_as_a_method_is_its_own_truth() {
    let folder = Folder::new();
    let images = "--aov mirror_position=found.exr --aov reference_position=truth.exr --aov color=color.exr \
        --aov reference_color=lit.exr --aov mirror=mirror.exr";
    let words = format!("--method ray_trace --truth same_input --stats stats.json {images}");
    let Some(_) = render_sphere(&folder, &words) else { return };
    let stats: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path("stats.json")).expect("the statistics"))
            .expect("JSON");
    assert_eq!(stats["method"], "ray_trace");
    assert!(stats["set"].get("reflection.method").is_none(), "{stats}");
    let passes = stats["passes"].as_array().expect("passes");
    let own: Vec<&Value> = passes.iter().filter(|pass| pass["name"] == "ray_trace").collect();
    assert!(own.len() == 1 && number(&own[0]["ms"]) > 0.0 && passes.len() > 3, "{stats}");
    let found = &stats["accuracy"];
    assert_eq!((number(&found["coverage"]), number(&found["false_fill"])), (1.0, 0.0));
    // 32-bit positions are some millionths of a pixel off.
    assert!(number(&found["pixel_error"]["p99"]) < 1e-4 && number(&found["image"]["rmse"]) == 0.0, "{found}");
    assert_eq!(number(&found["recall"]), 1.0);
    let [found, truth, color, lit, mirror] =
        ["found.exr", "truth.exr", "color.exr", "lit.exr", "mirror.exr"].map(|name| pixels(&folder, name));
    let mut mirrors = 0;
    for pixel in (0..WIDTH * HEIGHT).filter(|pixel| mirror[*pixel][0] == 1.0) {
        assert_eq!((found[pixel], color[pixel]), (truth[pixel], lit[pixel]));
        mirrors += 1;
    }
    assert!(mirrors > 1700);
    // The picture in the file is made of these colours, by the same passes as that of a method on the GPU.
    let picture = || image::open(folder.path("picture.png")).expect("a PNG").into_rgb8().into_raw();
    let traced = picture();
    let differences = |method: &str| {
        render_sphere(&folder, &format!("--method {method}"))?;
        let pairs = picture().into_iter().zip(&traced).enumerate().map(|(byte, (a, b))| (byte / 3, a.abs_diff(*b)));
        Some(median(pairs.filter(|(pixel, _)| mirror[*pixel][0] == 1.0).map(|(_, off)| f64::from(off)).collect()))
    };
    let (Some(same), Some(other)) = (differences("surfel_trace"), differences("none")) else { return };
    assert!(same <= 1.0 && other > 20.0, "{same} {other} of 255");
}

#[test]
fn the_ray_tracer_as_a_method_is_exposed_for_what_it_has_found() {
    let folder = Folder::new();
    let stops = |method: &str| {
        let words = format!("--method {method} --set tone.fit=always --stats stats.json --aov color=color.exr");
        render_sphere(&folder, &words).map(|_| number(&stats(&folder)["exposure"]))
    };
    let (Some(traced), Some(found), Some(bare)) = (stops("ray_trace"), stops("surfel_trace"), stops("none")) else {
        return;
    };
    assert!((traced - found).abs() < 0.05, "{traced} instead of {found}");
    assert!((traced - bare).abs() > 0.1, "{bare} without reflections is too close to tell anything");
    // A fit that is not asked for is not made.
    render_sphere(&folder, "--method ray_trace --set tone.fit=locked --stats stats.json");
    assert!(stats(&folder)["exposure"].is_null());
}

#[test]
fn points_are_traced_in_the_colours_and_the_light_that_they_are_drawn_in() {
    let folder = Folder::new();
    for color in ["rgb", "height", "normal", "plain"] {
        let seen_by = |method: &str| {
            let words = format!("--method {method} --set color.by={color} --aov mirror_albedo=albedo.exr");
            render_sphere(&folder, &words).map(|_| pixels(&folder, "albedo.exr"))
        };
        let (Some(drawn), Some(traced)) = (seen_by("surfel_trace"), seen_by("ray_trace")) else { return };
        let pairs = drawn.iter().zip(&traced).filter(|(drawn, traced)| drawn[0].is_finite() && traced[0].is_finite());
        let off: Vec<f64> =
            pairs.map(|(drawn, traced)| dot(minus(*drawn, *traced), minus(*drawn, *traced)).sqrt()).collect();
        assert!(off.len() > 1700, "{color}");
        // Half floats, and a colour's rounding to 8 bits.
        assert!(median(off.clone()) < 0.005, "{color}: {}", median(off));
    }
    for light in ["headlight", "colors", "lights"] {
        let words = format!("--set light.by={light} --aov color=color.exr --aov reference_color=lit.exr");
        let Some(_) = render_sphere(&folder, &words) else { return };
        let (drawn, traced) = (pixels(&folder, "color.exr"), pixels(&folder, "lit.exr"));
        let off: Vec<f64> = drawn
            .iter()
            .zip(&traced)
            .map(|(drawn, traced)| dot(minus(*drawn, *traced), minus(*drawn, *traced)).sqrt())
            .collect();
        assert!(median(off.clone()) < 0.002, "{light}: {}", median(off));
    }
}

/// A survey's coordinates, of which 32-bit floats hold half metres.
#[test]
fn far_from_the_origin_the_truth_is_as_fine() {
    let folder = Folder::new();
    let mut cloud = String::from(
        "ply\nformat ascii 1.0\nelement vertex 40000\nproperty double x\nproperty double y\nproperty double z\n\
         property float nx\nproperty float ny\nproperty float nz\nend_header\n",
    );
    for point in 0..40_000 {
        let (column, row) = (f64::from(point % 200), f64::from(point / 200));
        let line = format!("{} {} 100 0 0 1\n", 500_000.0 + column * 0.05, 5_000_000.0 + row * 0.05);
        cloud.push_str(&line);
    }
    folder.write("ground.ply", cloud);
    folder.write(
        "scene.toml",
        "clouds = [\"ground.ply\"]\n[camera]\neye = [500005, 4999995, 105]\npivot = [500005, 5000005, 101]\nup = [0, 0, 1]\n\
         [[mirrors]]\nshape = \"sphere\"\nposition = [500005, 5000005, 102]\nsize = 2\n",
    );
    for method in ["ray_trace", "surfel_trace"] {
        let mut words = vec!["scene.toml", "--method", method, "--truth", "same_input", "--stats", "stats.json"];
        words.extend(["--set", "light.by=headlight"]);
        let Some(_) = render(&folder, words) else { return };
        let found = accuracy(&folder);
        // A quarter of the sphere sees the ground.
        assert!(number(&found["coverage"]) > 0.2, "{method}: {found}");
        assert!(number(&found["pixel_error"]["p95"]) < 0.01, "{method}: {found}");
        assert!(number(&found["image"]["rmse"]) < 0.05, "{method}: {found}");
    }
}
