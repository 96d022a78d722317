//! Test: how long each dispatch of each pass takes at most on a slow GPU. The instructions, bytes and waits of a thread
//! are counted in the pass's code, as naga reads it; how often loops run, and how many threads there are, is stated here.
//!
//! The count is meant to be too high rather than too low: both branches of each condition are taken, no cache helps,
//! and no load of a thread overlaps with another of its loads.

mod code_tests;

use std::collections::BTreeSet;
use std::fmt::Write as _;

use code_tests::{Code, Work};
use naga::Module;
use naga::valid::ModuleInfo;
use rayon::prelude::*;
use scene::{METHODS, Method, Settings};

use super::{others, valid_module_of};
use crate::loads::{WITHOUT_SKIPPING, side_of_discs, windows};
use crate::passes::{ALL, Pass};
use crate::pieces::tests::longest_dispatch;

/// A tenth of an H100: instructions a second, at half of what it can do at best; bytes a second; the threads that it
/// holds at once; and the seconds that a load takes.
const INSTRUCTIONS: f64 = 6.7e12 / 2.0 / 2.0;
const BYTES: f64 = 335e9;
const THREADS_AT_ONCE: f64 = 26_000.0;
const LOAD: f64 = 0.5e-6;

/// The picture that is computed with, and the points of the cloud.
const SIZE: [f64; 2] = [3840.0, 2160.0];
const PIXELS: f64 = SIZE[0] * SIZE[1];
const TILES: f64 = PIXELS / 64.0;
const POINTS: f64 = 10e6;
/// The most virtual lights of a bounce, and the texels of the shadow map of each, by default.
const LIGHTS: f64 = 4096.0;
const MAP_TEXELS: f64 = 64.0 * 64.0;
/// The texels of a map around a mirror, the number of maps around five mirrors, and the texels of the box that is made
/// of a picture, by default.
const CUBE_TEXELS: f64 = 6.0 * 256.0 * 256.0;
const MAPS: f64 = 10.0;
const BOX_TEXELS: f64 = 6.0 * 256.0 * 256.0;

/// A pass whose threads are not the pixels of a picture, or the points of a cloud: how many, and what they are.
const THREADS: &[(&str, f64, &str)] = &[
    ("beam_lists", TILES, "tiles of 8 x 8 pixels"),
    ("cube_planes", CUBE_TEXELS, "texels of a cube"),
    ("light_field_trace", CUBE_TEXELS, "texels of a cube"),
    ("light_field_predict", PIXELS / 4.0, "pixels, by four"),
    ("cube_renumber", MAPS * CUBE_TEXELS, "texels of all cubes"),
    ("cube_bounds", MAPS * CUBE_TEXELS / 4.0, "texels of all cubes, by four"),
    ("screen_bounds", PIXELS / 4.0, "pixels, by four"),
    ("screen_box_pixels", PIXELS, "pixels"),
    ("screen_box_edges", BOX_TEXELS, "texels of a box"),
    ("screen_box_scores", 127.0 * 12.0 * 64.0, "threads: 64 for each shift of a wall"),
    ("screen_box_periods", 12.0, "threads: one for each axis of a wall"),
    ("screen_box_fill", BOX_TEXELS, "texels of a box"),
    ("curvature_smooth", 3840.0, "lines of pixels"),
    ("region_count", PIXELS / 4.0, "pixels, by four"),
    ("region_scan", 256.0, "threads"),
    ("region_number", PIXELS / 4.0, "pixels, by four"),
    ("sscr_cull", 1000.0, "chunks"),
    ("bundle_prune", TILES, "squares of 8 x 8 pixels"),
    ("pull", PIXELS / 4.0, "pixels, by four"),
    ("vpl_points", 256.0 * 8192.0, "points that cast indirect shadows"),
    ("vpl_aim", LIGHTS, "virtual lights"),
    ("vpl_place", LIGHTS, "virtual lights"),
    ("vpl_bounce", LIGHTS, "virtual lights"),
    ("vpl_photons", LIGHTS, "virtual lights"),
    ("photon_start", 256.0 * 256.0, "photons at a time"),
    ("photon_land", 256.0 * 256.0, "photons at a time"),
    ("vpl_shadow_splat", (1 << 19) as f64, "points in shadow maps at a time"),
    ("vpl_shadow_pull", LIGHTS * MAP_TEXELS / 4.0, "texels of shadow maps, by four"),
    ("vpl_shadow_push", LIGHTS * MAP_TEXELS, "texels of shadow maps"),
    ("vpl_balance", LIGHTS * 64.0, "threads: 64 for each virtual light"),
    ("exposure_fit", 1.0, "thread"),
    ("probe_pixels", 1e6, "pixels asked for"),
];

/// How often the loops of a function run in a thread, in the order in which they begin. Where several passes have a
/// function of a name, the pass's name and a dot stand before it.
const LOOPS: &[(&str, &[f64])] = &[
    // A thread's share of a block of 1024 points, and its share of 2000 pixels of a large disc.
    ("splat_block", &[8.0]),
    ("splat_discs", &[1.0]),
    ("splat_large", &[16.0]),
    // Discs of 3 x 3 pixels.
    ("splat_point", &[9.0]),
    ("splat_solution", &[3.0, 3.0]),
    ("mirror_visibility.splat_solution", &[3.0, 3.0, 3.0]),
    ("mirror_depth.splat_point", &[1.0]),
    ("mirror_visibility.splat_point", &[1.0]),
    // The neighbours of a pixel or a texel, the axes, the pixels of a thread.
    ("close_gaps", &[8.0, 8.0, 8.0, 1.0]),
    // A tenth of the pixels look above and below, and one in fifty around.
    ("close_holes", &[0.3, 0.16, 0.16, 0.16, 0.02]),
    ("gather_close", &[8.0, 8.0]),
    ("eye_dome", &[8.0]),
    ("plane_about", &[8.0]),
    ("what_is_beside", &[8.0]),
    ("is_alone", &[9.0]),
    ("share_lit", &[3.0, 3.0]),
    ("pull", &[4.0]),
    ("push", &[4.0]),
    ("region_count", &[4.0]),
    ("region_number", &[4.0, 4.0]),
    ("region_assign", &[3.0]),
    ("beam_entry", &[3.0]),
    ("bounds_of_texel", &[4.0]),
    ("bounds_of_cell", &[4.0]),
    ("vpl_shadow_pull", &[4.0]),
    ("transfer_of_square", &[4.0]),
    ("scan", &[8.0]),
    // The tile's pixels, then the boxes about all chunks of a page; and the nodes of a chunk whose box is met, a tenth
    // of them.
    ("beam_lists", &[64.0, 150.0]),
    ("list_tree", &[20.0]),
    // A ray tests 150 nodes and as many discs.
    ("surfel_trace", &[12.0]),
    ("through_trees", &[12.0]),
    ("through_tree", &[6.0, 1.0]),
    // Five mirrors with a formula, steps toward each and bisection.
    ("shape_hit", &[2.0, 100.0, 20.0, 3.0]),
    ("mirror_exact", &[5.0]),
    ("mirror_exact_seen", &[5.0]),
    ("formula_of", &[5.0]),
    ("mirror_at", &[5.0]),
    ("clear_surface", &[9.0]),
    ("surface_at", &[25.0, 5.0]),
    // The points of five mirrors, in four chunks each.
    ("mirror_methods", &[25.0]),
    ("method_of_formula", &[5.0]),
    ("method_of_point", &[20.0]),
    // Maps around a mirror: two of them in turn, two faces, forty cells of each.
    ("nearest_map", &[2.0]),
    ("through_each", &[2.0]),
    ("search_samples", &[64.0]),
    ("refine", &[1.0]),
    ("relay", &[2.0, 2.0]),
    ("walk_cube", &[2.0]),
    ("walk_picture", &[40.0]),
    ("walk_by_steps", &[200.0]),
    ("walk_by_points", &[200.0]),
    // Light fields: nine samples near a mirror point.
    ("samples_near_in", &[16.0, 9.0]),
    ("light_field_need", &[9.0]),
    ("light_field_look_up", &[9.0]),
    ("light_field_ask", &[1.0]),
    ("ask_along", &[4.0]),
    ("rank_of_look", &[9.0]),
    ("weight_of_look", &[9.0]),
    ("in_order", &[9.0, 9.0, 9.0]),
    ("look_up", &[4.0]),
    // The searches of a point: all solvers, and all of their starts, one after the other.
    ("sscr_solve.splat_point", &[4.0, 1.0]),
    ("drawn_label", &[8.0]),
    ("random_seed", &[2.0]),
    ("start_of", &[16.0]),
    ("probe_after", &[2.0]),
    ("interleaved", &[25.0]),
    ("descent", &[10.0]),
    ("nelder_mead", &[25.0]),
    ("sscr_cull", &[200.0]),
    // Bundles of rays: ten terms, two rounds, a square of 8 x 8 pixels.
    ("bundle_fit", &[2.0, 6.0, 63.0, 1.0, 2.0, 2.0, 4.0, 64.0, 64.0, 63.0, 2.0]),
    ("bundle_prune", &[4.0]),
    ("mark", &[1.0]),
    ("cholesky", &[10.0, 5.0, 5.0, 5.0, 10.0, 5.0, 10.0, 5.0]),
    ("error_of", &[10.0, 4.0]),
    ("corner_of", &[6.0]),
    ("list_leaves", &[6.0, 2.0, 1.0, 64.0]),
    // The largest squares of a picture are 2040, which 128 threads look through.
    ("sample_cameras_project", &[16.0]),
    ("sample_cameras_project.splat_point", &[3.0, 5.0, 4.0]),
    // Mirrors with a formula, steps of Newton, and the two ends of a ray.
    ("analytic_at", &[5.0]),
    ("place_on_sphere", &[5.0]),
    ("is_off_formula", &[2.0]),
    ("next_leaf", &[16.0]),
    ("descend", &[100.0, 3.0]),
    ("root_in", &[2.0]),
    ("with_root", &[2.0]),
    ("kept_root", &[2.0]),
    ("sample_cameras_mark", &[8.0, 8.0]),
    // The trees of a mirror's rays, the depth of each, and the cells of a leaf.
    ("sample_cameras_space.splat_point", &[2.0, 12.0, 1.0, 2.0]),
    ("root_of_cell", &[2.0]),
    // Regions: ways up the trees of pixels (docs/gpu.md, "Labels"), runs of 1024 pixels.
    ("label_flatten", &[8.0]),
    ("join", &[4.0]),
    ("root_of", &[4.0]),
    ("tile_root", &[4.0]),
    ("join_in_tile", &[4.0]),
    ("region_scan", &[32.0]),
    ("curvature_smooth", &[3840.0]),
    ("normal_filter", &[2.0, 8.0]),
    // Glossy rays.
    ("gloss_blur", &[16.0]),
    ("length_of", &[2.0]),
    ("gloss_normals", &[16.0]),
    ("gloss_trust", &[16.0]),
    ("lobe_numbers", &[8.0]),
    // 1024 lights for each pixel, in two bounces; the nearest neighbours that light is taken from.
    ("indirect", &[2.0]),
    ("light_of_run", &[512.0]),
    // Most places lie in one of the finer maps of a sky light alone.
    ("share_seen", &[1.0]),
    ("indirect_filter", &[16.0]),
    ("reach", &[16.0]),
    ("indirect_reuse", &[2.0, 2.0]),
    ("kept_pixel", &[20.0]),
    ("shade", &[4.0]),
    // Half of the photons that are listed for a place, in all about five times as many as shine on it: those of few places
    // are all walked by each pixel. The beams of a lamp toward five mirrors.
    ("photon_light", &[6.0, 4.0, 7.0, 4.0, 4.0]),
    ("light_of_grid", &[16.0]),
    ("photon_start", &[5.0]),
    ("show_virtual_lights", &[64.0, 1.0]),
    ("vpl_aim", &[8.0, 9.0]),
    ("vpl_shadow_splat", &[4.0, 4.0]),
    ("vpl_balance", &[MAP_TEXELS / 64.0, 63.0]),
    ("brightness_below", &[256.0]),
    ("exposure_fit", &[256.0]),
    // Walls of 256 texels along an edge.
    ("screen_box_pixels", &[6.0]),
    ("screen_box_edges", &[2.0]),
    ("screen_box_scores", &[1024.0, 64.0]),
    ("screen_box_periods", &[127.0, 127.0]),
    ("screen_box_fill", &[8.0, 17.0, 2.0, 16.0, 4.0]),
];

/// The loops of a pass that run more or less often by some settings than `LOOPS` says: function, loop, how many times as
/// often.
fn by_settings(pass: &str, settings: &Settings) -> Vec<(&'static str, usize, f64)> {
    let Settings { gi, splat, sscr, gloss, sample_cameras, cubemap_trace, screen_trace, .. } = settings;
    let ratio = |value: u32, usual: u32| f64::from(value) / f64::from(usual);
    let lights = f64::from(gi.sky_lights + gi.bounces * gi.vpls);
    let run = f64::from(gi.interleave * gi.interleave);
    let side = f64::from(sscr.max_splat_size) / 3.0;
    let rounds = if settings.reflection.method == Method::SampleCameras { sample_cameras.roots } else { 1 };
    let roots =
        [("with_root", 0, ratio(sample_cameras.roots, 4)), ("kept_root", 0, ratio(sample_cameras.polish + 1, 1))];
    match pass {
        "indirect" => vec![("light_of_run", 0, lights / run / 1024.0)],
        "indirect_filter" => vec![("indirect_filter", 0, run * windows(settings) / 16.0)],
        "show_virtual_lights" => vec![("show_virtual_lights", 0, lights / 4096.0)],
        "splat_nearest"
        | "splat_nearest_blind"
        | "splat_narrow"
        | "splat_accumulate"
        | "splat_accumulate_pairs"
        | "splat_behind" => {
            vec![("splat_point", 0, (side_of_discs(splat) / 3.0).powi(2))]
        }
        "mirror_depth" | "mirror_visibility" => {
            vec![("splat_point", 0, f64::from(rounds)), ("splat_solution", 0, side), ("splat_solution", 1, side)]
        }
        "sscr_solve" => {
            let steps = ratio(sscr.max_steps, 30);
            let mut loops: Vec<_> = ["interleaved", "descent", "nelder_mead"].map(|solver| (solver, 0, steps)).into();
            loops.push(("probe_after", 0, ratio(sscr.step_attempts, 6)));
            loops.push(("random_seed", 0, ratio(if sscr.per_region { 32 } else { sscr.seed_attempts }, 6)));
            loops
        }
        "sample_cameras_project" => {
            // Without chances, each of the leaves that may reflect a block keeps all of its points.
            let per_pixel = f64::from(sample_cameras.points_per_pixel);
            let kept = if per_pixel == 0.0 { 16.0 } else { per_pixel / 2.0 };
            let leaves = ratio(4, sample_cameras.least_square).powi(2);
            let mut loops =
                vec![("splat_point", 2, kept * leaves), ("next_leaf", 0, leaves), ("list_leaves", 3, leaves)];
            loops.extend(roots);
            loops
        }
        "sample_cameras_space" => {
            let mut loops = vec![("splat_point", 3, ratio(sample_cameras.longest_list, 64))];
            loops.extend(roots);
            loops
        }
        "cubemap_trace" => {
            let tries = ratio(cubemap_trace.tries.min(cubemap_trace.maps), 2);
            let by_step = (0.001 / f64::from(cubemap_trace.step)).max(0.25 / f64::from(cubemap_trace.angle));
            let texels = ratio(cubemap_trace.size, 256) * if cubemap_trace.skip { 1.0 } else { WITHOUT_SKIPPING };
            vec![
                ("nearest_map", 0, ratio(cubemap_trace.maps, 2)),
                ("through_each", 0, tries),
                ("relay", 1, tries),
                ("search_samples", 0, by_step),
                ("walk_picture", 0, texels),
            ]
        }
        "screen_trace" => vec![
            ("walk_picture", 0, if screen_trace.skip { 1.0 } else { WITHOUT_SKIPPING }),
            ("walk_by_points", 0, 0.005 / f64::from(screen_trace.stride)),
        ],
        "screen_box_scores" => vec![("screen_box_scores", 0, ratio(screen_trace.box_size, 256).powi(2))],
        "screen_box_periods" => [0, 1].map(|n| ("screen_box_periods", n, ratio(screen_trace.box_size, 256))).into(),
        "screen_box_fill" => vec![("screen_box_fill", 3, ratio(screen_trace.box_size, 256))],
        "normal_filter" => vec![("normal_filter", 1, ratio(sscr.normal_filter, 8))],
        "gloss_blur" => vec![("gloss_blur", 0, f64::from(gloss.blur_most) / 33.0)],
        "vpl_shadow_splat" => [0, 1].map(|axis| ("vpl_shadow_splat", axis, ratio(gi.shadow_size, 64))).into(),
        _ => Vec::new(),
    }
}

/// How many times as many threads a pass has by some settings as `THREADS` says.
fn threads_by_settings(pass: &str, settings: &Settings) -> f64 {
    let Settings { gi, cubemap_trace, light_field, screen_trace, .. } = settings;
    let ratio = |value: u32, usual: u32| f64::from(value) / f64::from(usual);
    let face = match settings.reflection.method {
        Method::LightField => ratio(light_field.size, 256),
        _ => ratio(cubemap_trace.size, 256),
    };
    match pass {
        "cube_planes" => face.powi(2),
        "cube_renumber" | "cube_bounds" => face.powi(2) * ratio(cubemap_trace.maps, 2),
        "screen_box_edges" | "screen_box_fill" => ratio(screen_trace.box_size, 256).powi(2),
        "screen_box_scores" => ratio(screen_trace.box_size, 256),
        "vpl_points" => ratio(gi.shadow_points, 8192),
        "vpl_shadow_pull" | "vpl_shadow_push" => ratio(gi.shadow_size, 64).powi(2),
        _ => 1.0,
    }
}

/// A pass and its code.
struct Parsed {
    pass: &'static Pass,
    module: &'static Module,
    info: &'static ModuleInfo,
}

/// What its threads are and how many there are, what one does, and how much more that may be by the settings.
struct Row {
    pass: &'static Pass,
    what: &'static str,
    threads: f64,
    work: Work,
    load: f64,
    /// The edge of a wall of the box that is made of a picture.
    box_edge: u32,
    taken: BTreeSet<&'static str>,
}

impl Parsed {
    fn of(pass: &'static Pass) -> Self {
        let (module, info) = valid_module_of(pass);
        Self { pass, module, info }
    }

    /// What the pass does by some settings, or as `LOOPS` and `THREADS` say.
    fn row(&self, settings: Option<&Settings>) -> Row {
        let Self { pass, module, info } = self;
        let changed = settings.map_or(Vec::new(), |settings| by_settings(pass.name, settings));
        let mut code = Code { module, info, pass: pass.name, changed, unlisted: Vec::new(), taken: BTreeSet::new() };
        let work = code.of_function(&module.entry_points[0].function, info.get_entry_point(0));
        assert!(code.unlisted.is_empty(), "{}: list how often these loops run: {:?}", pass.name, code.unlisted);
        let listed = THREADS.iter().find(|(name, ..)| *name == pass.name).map(|(_, threads, what)| (*threads, *what));
        let points = (POINTS / 8.0, "eighths of points");
        let (threads, what) = listed.unwrap_or(if pass.is_over_points { points } else { (PIXELS, "pixels") });
        let threads = threads * settings.map_or(1.0, |settings| threads_by_settings(pass.name, settings));
        let load = settings.map_or(1.0, |settings| (pass.load)(settings));
        let box_edge = settings.map_or(256, |settings| settings.screen_trace.box_size);
        Row { pass, what, threads, work, load, box_edge, taken: code.taken }
    }
}

impl Row {
    fn milliseconds(&self) -> f64 {
        self.work.milliseconds(self.threads)
    }

    /// Whether the pass is cut into dispatches: by rows and columns of workgroups, or by blocks of points.
    fn is_cut(&self) -> bool {
        let source = self.pass.source;
        self.pass.is_over_points || source.contains("whole_thread(") || source.contains("frame.first_row")
    }

    fn threads_of_group(&self) -> f64 {
        if self.pass.is_over_points { 128.0 } else { 64.0 }
    }

    /// The columns and rows of workgroups.
    fn groups(&self) -> [u32; 2] {
        let groups = (self.threads / self.threads_of_group()).ceil() as u32;
        let rows = match self.pass.name {
            _ if self.pass.is_over_points => groups,
            "screen_box_scores" => 12,
            "screen_box_fill" => self.box_edge.div_ceil(8),
            "beam_lists" => 34,
            _ => 270,
        };
        [groups.div_ceil(rows), rows]
    }

    /// The milliseconds that a workgroup takes, of all of them together.
    fn each(&self) -> f64 {
        self.milliseconds() / self.groups().map(f64::from).iter().product::<f64>()
    }

    /// The longest dispatch if a workgroup is known to take `each`, or if nobody knows.
    fn longest(&self, each: Option<f64>) -> f64 {
        if !self.is_cut() {
            return self.milliseconds();
        }
        let groups = longest_dispatch(each, self.load, self.groups());
        self.work.milliseconds(groups * self.threads_of_group())
    }

    /// The longest dispatches in the first frame, in later ones, and in one after frames of other settings.
    fn longest_ones(&self, other: &Row) -> [f64; 3] {
        let guessed = other.each() * (self.load / other.load).max(1.0);
        [None, Some(self.each()), Some(guessed)].map(|each| self.longest(each))
    }
}

/// Passes of which a single workgroup is computed to take more than 100 ms by some settings: the loads of a thread that
/// splats eight discs of 60 pixels and more, one after the other.
const NOT_CUT_FURTHER: [&str; 1] = ["splat_behind"];

/// The turns after which software Vulkan (llvmpipe) ends all loops of an invocation, without a word.
const MOST_TURNS: f64 = 65_535.0;

/// All lights that settings allow, for each pixel.
const MOST_LIGHTS: &str = "gi.vpls=4096 gi.bounces=4 gi.sky_lights=1024 gi.interleave=1";

/// The usual settings with some changed: pairs of key and value.
fn changed(pairs: &str) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs.split_whitespace().filter_map(|pair| pair.split_once('=')) {
        settings.set_text(key, value).unwrap();
        let owner = METHODS.iter().find(|row| row.group.is_some_and(|group| key.starts_with(&format!("{group}."))));
        settings.reflection.method = owner.map_or(settings.reflection.method, |row| row.method);
    }
    settings
}

#[test]
fn no_dispatch_is_computed_to_take_a_tenth_of_a_second_nor_a_thread_to_turn_too_often_at_any_end_of_any_parameter() {
    let mut ends: Vec<String> = others(|_| true).into_iter().map(|(key, value)| format!("{key}={value}")).collect();
    ends.push(MOST_LIGHTS.into());
    let ends: Vec<(String, Settings)> = ends.into_iter().map(|pairs| (pairs.clone(), changed(&pairs))).collect();
    let rows: Vec<(Row, Vec<String>)> = ALL
        .par_iter()
        .map(|pass| {
            let parsed = Parsed::of(pass);
            let (told, usual) = (parsed.row(None), parsed.row(Some(&Settings::default())));
            let mut long = Vec::new();
            let mut check = |case: &str, row: &Row, other: &Row| {
                let longest = row.longest_ones(other);
                // A workgroup cannot be cut.
                let least = if NOT_CUT_FURTHER.contains(&pass.name) { row.work.milliseconds(1.0) } else { 0.0 };
                if longest.iter().any(|longest| *longest > least.max(100.0)) {
                    long.push(format!("{}, {case}: {longest:?} of {} ms", pass.name, row.milliseconds()));
                }
                // As if each of all lights were as near as few can be.
                let is_known = pass.name == "indirect" && case.contains(MOST_LIGHTS);
                if row.work.turns > MOST_TURNS && !is_known {
                    long.push(format!("{}, {case}: {} turns", pass.name, row.work.turns));
                }
            };
            check("as told", &told, &usual);
            let does = |settings: &Settings| {
                let changes = by_settings(pass.name, settings);
                (changes, threads_by_settings(pass.name, settings), (pass.load)(settings))
            };
            let as_usual = does(&Settings::default());
            for (case, settings) in ends.iter().filter(|(_, settings)| does(settings) != as_usual) {
                let row = parsed.row(Some(settings));
                check(case, &row, &usual);
                check(&format!("as usual after {case}"), &usual, &row);
            }
            (told, long)
        })
        .collect();
    let long: Vec<&String> = rows.iter().flat_map(|(_, long)| long).collect();
    assert!(long.is_empty(), "{long:#?}");
    let taken: BTreeSet<&str> = rows.iter().flat_map(|(row, _)| row.taken.iter().copied()).collect();
    let left: Vec<&str> = LOOPS.iter().map(|(name, _)| *name).filter(|name| !taken.contains(name)).collect();
    assert!(left.is_empty(), "no pass has these: {left:?}");
    let passes: Vec<&str> = ALL.iter().map(|pass| pass.name).collect();
    assert!(THREADS.iter().all(|(name, ..)| passes.contains(name)));
}

#[test]
fn work_is_counted_by_the_code() {
    // 64 loads of an image in a loop, then nodes of 32 bytes.
    let beams = Parsed::of(ALL.iter().find(|pass| pass.name == "beam_lists").unwrap()).row(None).work;
    assert!(beams.loads > 64.0 * 3.0 + 150.0 * 20.0, "{beams:?}");
    assert!(beams.bytes > 64.0 * 3.0 * 16.0 + 150.0 * 20.0 * 32.0, "{beams:?}");
    // A pass that reads a texel and writes another.
    let position = Parsed::of(ALL.iter().find(|pass| pass.name == "camera_position").unwrap()).row(None).work;
    assert!(position.loads == 1.0 && position.bytes == 32.0, "{position:?}");
    let twice = position.milliseconds(2e7) / position.milliseconds(1e7);
    assert!((twice - 2.0).abs() < 0.01, "{twice}");
}

/// Passes that may take long, and settings with which they do.
const LONG: &[(&str, &str, &str)] = &[
    ("indirect", "1024 lights for each pixel", "gi.vpls=960 gi.interleave=1"),
    ("indirect", "17,408 lights for each pixel, the most", MOST_LIGHTS),
    ("show_virtual_lights", "17,408 lights", MOST_LIGHTS),
    ("surfel_trace", "usual settings", ""),
    ("cubemap_trace", "16 maps for each ray", "cubemap_trace.maps=16 cubemap_trace.tries=16"),
    ("screen_trace", "each pixel on the way", "screen_trace.skip=false"),
    ("sscr_solve", "100 steps", "sscr.max_steps=100"),
    ("mirror_visibility", "splats of 32 pixels", "sscr.max_splat_size=32"),
    ("sample_cameras_project", "all points are kept", "sample_cameras.points_per_pixel=0"),
    ("sample_cameras_space", "lists of 4096 gaps", "sample_cameras.longest_list=4096"),
    ("clear_surface", "glass among five shapes", ""),
    ("splat_accumulate", "discs of 64 pixels", "splat.min_pixels=64"),
    ("splat_behind", "discs of 64 pixels", "splat.min_pixels=64"),
    ("screen_box_scores", "walls of 1024 texels", "screen_trace.box_size=1024"),
];

/// The rows of the table of long passes of docs/gpu.md.
pub(super) fn long_passes() -> String {
    let mut table = String::new();
    for (name, case, pairs) in LONG {
        let parsed = Parsed::of(ALL.iter().find(|pass| pass.name == *name).unwrap());
        let row = parsed.row(Some(&changed(pairs)));
        let [first, later, changed] = row.longest_ones(&parsed.row(Some(&Settings::default()))).map(shown);
        let _ =
            writeln!(table, "| `{name}` | {case} | {} | {first} | {later} | {changed} |", shown(row.milliseconds()));
    }
    table
}

/// The table of docs/gpu.md.
pub(super) fn table() -> String {
    let mut table = String::from(
        "\n## Each pass\n\n\
         The time of each pass on a tenth of an H100, as a test computes it from the pass's code: what a thread does, times the\n\
         threads of a picture of 3840 x 2160 that a mirror fills, or of a cloud of 10 million points. The largest of three times\n\
         counts: instructions at half of the card's rate, bytes at 335 GB/s without any cache, and loads of 0.5 microseconds, one\n\
         after the other, by 26,000 threads at once. Both sides of each condition are counted. How often loops run is said in\n\
         crates/render/src/translation/work_tests.rs. So the times are too high rather than too low; none is measured. The test fails\n\
         where a dispatch takes more than 100 ms, and where the loops of a new pass are not listed.\n\n\
         | pass | threads | instructions | bytes | loads | whole, ms | longest dispatch in its first frame, ms | and later, ms |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for pass in ALL {
        let row = Parsed::of(pass).row(None);
        let Work { instructions, bytes, loads, .. } = row.work;
        let [first, later, _] = row.longest_ones(&row);
        let _ = writeln!(
            table,
            "| `{}` | {} {} | {instructions:.0} | {bytes:.0} | {loads:.0} | {} | {} | {} |",
            pass.name,
            row.threads.ceil(),
            row.what,
            shown(row.milliseconds()),
            shown(first),
            shown(later)
        );
    }
    table
}

fn shown(milliseconds: f64) -> String {
    if milliseconds < 10.0 { format!("{milliseconds:.1}") } else { format!("{milliseconds:.0}") }
}
