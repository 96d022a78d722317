//! Test: how long each dispatch of each pass takes at most on a slow GPU. The instructions, bytes and waits of a thread
//! are counted in the pass's code, as naga reads it; how often loops run, and how many threads there are, is told here.
//!
//! The count is meant to be too high rather than too low: both branches of each condition are taken, no cache helps,
//! and no load of a thread overlaps with another of its loads.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use naga::valid::{FunctionInfo, ModuleInfo};
use naga::{AddressSpace, Block, Expression, Function, Handle, MathFunction, Module, Statement, TypeInner};

use super::valid_module_of;
use crate::passes::{ALL, Pass};
use crate::recorder::tests::longest_dispatches;

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
    ("pull", PIXELS / 4.0, "pixels, by four"),
    ("vpl_points", 256.0 * 8192.0, "points that cast indirect shadows"),
    ("vpl_aim", LIGHTS, "virtual lights"),
    ("vpl_place", LIGHTS, "virtual lights"),
    ("vpl_bounce", LIGHTS, "virtual lights"),
    ("vpl_shadow_splat", (1 << 19) as f64, "points in shadow maps at a time"),
    ("vpl_shadow_pull", LIGHTS * MAP_TEXELS / 4.0, "texels of shadow maps, by four"),
    ("vpl_shadow_push", LIGHTS * MAP_TEXELS, "texels of shadow maps"),
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
    ("splat_point", &[3.0, 3.0]),
    ("splat_solution", &[3.0, 3.0]),
    ("mirror_visibility.splat_solution", &[3.0, 3.0, 3.0]),
    ("mirror_depth.splat_point", &[1.0]),
    ("mirror_visibility.splat_point", &[1.0]),
    // The neighbours of a pixel or a texel, the axes, the pixels of a thread.
    ("close_gaps", &[8.0, 8.0, 8.0]),
    ("gather_close", &[8.0, 8.0]),
    ("eye_dome", &[8.0]),
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
    ("surfel_trace", &[12.0, 12.0]),
    ("through_tree", &[6.0, 1.0]),
    // Five mirrors with a formula, steps toward each and bisection.
    ("shape_hit", &[2.0, 100.0, 20.0, 3.0]),
    ("mirror_exact", &[5.0]),
    ("mirror_exact_seen", &[5.0]),
    ("formula_of", &[5.0]),
    ("mirror_at", &[5.0]),
    ("clear_surface", &[9.0]),
    ("surface_at", &[25.0, 5.0]),
    // Maps around a mirror: two of them in turn, two faces, forty cells of each.
    ("nearest_map", &[2.0]),
    ("through_each", &[2.0]),
    ("search_samples", &[64.0]),
    ("refine", &[1.0]),
    ("relay", &[2.0, 2.0]),
    ("walk_cube", &[2.0]),
    ("walk_picture", &[40.0]),
    ("walk_by_steps", &[200.0]),
    // Light fields: nine samples near a mirror point.
    ("samples_near", &[16.0, 9.0]),
    ("light_field_need", &[9.0]),
    ("light_field_look_up", &[9.0]),
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
    ("indirect_filter", &[16.0]),
    ("indirect_reuse", &[2.0, 2.0]),
    ("light_of", &[20.0]),
    ("shade", &[4.0]),
    ("show_virtual_lights", &[64.0, 1.0]),
    ("vpl_aim", &[8.0, 9.0]),
    ("vpl_shadow_splat", &[4.0, 4.0]),
    ("brightness_below", &[256.0]),
    ("exposure_fit", &[256.0]),
    // Walls of 256 texels along an edge.
    ("screen_box_pixels", &[6.0]),
    ("screen_box_edges", &[2.0]),
    ("screen_box_scores", &[1024.0, 64.0]),
    ("screen_box_periods", &[127.0, 127.0]),
    ("screen_box_fill", &[8.0, 17.0, 2.0, 16.0, 4.0]),
];

/// What a thread does.
#[derive(Clone, Copy, Debug, Default)]
struct Work {
    instructions: f64,
    bytes: f64,
    loads: f64,
}

impl Work {
    fn add(&mut self, more: Self, times: f64) {
        self.instructions += more.instructions * times;
        self.bytes += more.bytes * times;
        self.loads += more.loads * times;
    }

    /// The milliseconds that so many threads take.
    fn milliseconds(self, threads: f64) -> f64 {
        let waves = (threads / THREADS_AT_ONCE).ceil();
        let seconds = (self.instructions * threads / INSTRUCTIONS)
            .max(self.bytes * threads / BYTES)
            .max(self.loads * LOAD * waves);
        seconds * 1e3
    }
}

/// The code of a pass.
struct Code<'a> {
    module: &'a Module,
    info: &'a ModuleInfo,
    pass: &'static str,
    /// The functions whose loops are not told.
    untold: Vec<String>,
    /// The rows of `LOOPS` that were taken.
    taken: BTreeSet<&'static str>,
}

impl Code<'_> {
    fn of_function(&mut self, function: &Function, info: &FunctionInfo) -> Work {
        let name = function.name.clone().unwrap_or_default();
        let own = format!("{}.{name}", self.pass);
        let row = |name: &str| LOOPS.iter().find(|(known, _)| *known == name);
        let row = row(&own).or_else(|| row(&name)).filter(|_| has_loops(&function.body));
        self.taken.extend(row.map(|(name, _)| *name));
        let mut loops = row.map_or(&[][..], |(_, times)| times);
        let mut work = Work::default();
        self.of_block(&function.body, (function, info), &mut loops, &mut work);
        if !loops.is_empty() {
            self.untold.push(format!("{name} has fewer loops"));
        }
        work
    }

    fn of_block(&mut self, block: &Block, place: (&Function, &FunctionInfo), loops: &mut &[f64], work: &mut Work) {
        let (function, info) = place;
        for statement in block {
            match statement {
                Statement::Emit(range) => {
                    for expression in range.clone() {
                        self.of_expression(expression, place, work);
                    }
                }
                Statement::Block(block) => self.of_block(block, place, loops, work),
                Statement::If { accept, reject, .. } => {
                    work.instructions += 1.0;
                    self.of_block(accept, place, loops, work);
                    self.of_block(reject, place, loops, work);
                }
                Statement::Switch { cases, .. } => {
                    work.instructions += cases.len() as f64;
                    cases.iter().for_each(|case| self.of_block(&case.body, place, loops, work));
                }
                Statement::Loop { body, continuing, .. } => {
                    let times = loops.split_off_first().copied().unwrap_or_else(|| {
                        self.untold.push(function.name.clone().unwrap_or_default());
                        1.0
                    });
                    let mut turn = Work { instructions: 1.0, ..Work::default() };
                    self.of_block(body, place, loops, &mut turn);
                    self.of_block(continuing, place, loops, &mut turn);
                    work.add(turn, times);
                }
                Statement::Call { function, .. } => {
                    let called = self.of_function(&self.module.functions[*function], &self.info[*function]);
                    work.add(called, 1.0);
                }
                Statement::Store { pointer, value } => {
                    let (lanes, bytes) = self.size_of(*value, info);
                    match self.space_of(*pointer, function) {
                        AddressSpace::Storage { .. } => work.bytes += bytes,
                        _ => work.instructions += lanes,
                    }
                }
                Statement::ImageStore { value, .. } => {
                    work.instructions += 1.0;
                    work.bytes += self.size_of(*value, info).1;
                }
                // A sector of memory is read and written.
                Statement::Atomic { pointer, .. } => match self.space_of(*pointer, function) {
                    AddressSpace::WorkGroup => work.instructions += 8.0,
                    _ => work.add(Work { instructions: 1.0, bytes: 64.0, loads: 0.0 }, 1.0),
                },
                Statement::ControlBarrier(_) | Statement::MemoryBarrier(_) => work.instructions += 16.0,
                _ => work.instructions += 1.0,
            }
        }
    }

    fn of_expression(&self, handle: Handle<Expression>, (function, info): (&Function, &FunctionInfo), work: &mut Work) {
        let lanes = || self.size_of(handle, info).0;
        work.instructions += match &function.expressions[handle] {
            Expression::Load { pointer } => {
                match self.space_of(*pointer, function) {
                    AddressSpace::Storage { .. } => {
                        work.bytes += self.size_of(handle, info).1;
                        work.loads += 1.0;
                        1.0
                    }
                    // What is the same for all threads, and registers.
                    AddressSpace::Uniform | AddressSpace::Function | AddressSpace::Private => 0.0,
                    _ => 1.0,
                }
            }
            Expression::ImageLoad { .. } => {
                work.bytes += 16.0;
                work.loads += 1.0;
                4.0
            }
            Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Select { .. }
            | Expression::As { .. } => lanes(),
            Expression::Relational { argument, .. } => self.size_of(*argument, info).0,
            Expression::Math { fun, arg, .. } => {
                let lanes = self.size_of(*arg, info).0;
                match fun {
                    MathFunction::Sqrt
                    | MathFunction::InverseSqrt
                    | MathFunction::Exp
                    | MathFunction::Exp2
                    | MathFunction::Log
                    | MathFunction::Log2
                    | MathFunction::Sin
                    | MathFunction::Cos => 4.0 * lanes,
                    MathFunction::Pow
                    | MathFunction::Tan
                    | MathFunction::Acos
                    | MathFunction::Asin
                    | MathFunction::Atan
                    | MathFunction::Atan2 => 16.0 * lanes,
                    MathFunction::Normalize | MathFunction::Length | MathFunction::Distance => 3.0 * lanes + 4.0,
                    MathFunction::Cross | MathFunction::Mix | MathFunction::Reflect => 3.0 * lanes,
                    _ => lanes,
                }
            }
            _ => 0.0,
        };
    }

    /// The numbers and the bytes of a value.
    fn size_of(&self, value: Handle<Expression>, info: &FunctionInfo) -> (f64, f64) {
        let inner = info[value].ty.inner_with(&self.module.types);
        let lanes = match inner {
            TypeInner::Vector { size, .. } => f64::from(*size as u8),
            TypeInner::Matrix { columns, rows, .. } => f64::from(*columns as u8 * *rows as u8),
            _ => 1.0,
        };
        (lanes, f64::from(inner.size(self.module.to_ctx())))
    }

    /// Where what a pointer points to lies.
    fn space_of(&self, pointer: Handle<Expression>, function: &Function) -> AddressSpace {
        match &function.expressions[pointer] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => self.space_of(*base, function),
            Expression::GlobalVariable(variable) => self.module.global_variables[*variable].space,
            _ => AddressSpace::Function,
        }
    }
}

/// Whether a block has loops of its own.
fn has_loops(block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Loop { .. } => true,
        Statement::Block(block) => has_loops(block),
        Statement::If { accept, reject, .. } => has_loops(accept) || has_loops(reject),
        Statement::Switch { cases, .. } => cases.iter().any(|case| has_loops(&case.body)),
        _ => false,
    })
}

/// A pass, what its threads are and how many there are, and what one does.
struct Row {
    pass: &'static Pass,
    what: &'static str,
    threads: f64,
    work: Work,
    taken: BTreeSet<&'static str>,
}

impl Row {
    fn of(pass: &'static Pass) -> Self {
        let (module, info) = valid_module_of(pass);
        let mut code =
            Code { module: &module, info: &info, pass: pass.name, untold: Vec::new(), taken: BTreeSet::new() };
        let work = code.of_function(&module.entry_points[0].function, info.get_entry_point(0));
        assert!(code.untold.is_empty(), "{}: tell how often these loops run: {:?}", pass.name, code.untold);
        let told = THREADS.iter().find(|(name, ..)| *name == pass.name).map(|(_, threads, what)| (*threads, *what));
        let points = (POINTS / 8.0, "eighths of points");
        let (threads, what) = told.unwrap_or(if pass.is_over_points() { points } else { (PIXELS, "pixels") });
        Self { pass, what, threads, work, taken: code.taken }
    }

    fn milliseconds(&self) -> f64 {
        self.work.milliseconds(self.threads)
    }

    /// Whether the pass is cut into dispatches: by rows of workgroups, or by blocks of points.
    fn is_cut(&self) -> bool {
        let source = self.pass.source;
        self.pass.is_over_points() || source.contains("whole_thread(") || source.contains("frame.first_row")
    }

    /// The longest dispatch in the first frame, and in later ones.
    fn longest(&self) -> [f64; 2] {
        let whole = self.milliseconds();
        if !self.is_cut() {
            return [whole; 2];
        }
        let threads = if self.pass.is_over_points() { 128.0 } else { 64.0 };
        longest_dispatches((self.threads / threads).ceil(), whole)
    }
}

#[test]
fn no_dispatch_of_any_pass_is_computed_to_take_a_tenth_of_a_second() {
    let rows: Vec<Row> = ALL.iter().map(|pass| Row::of(pass)).collect();
    let long = rows.iter().filter(|row| row.longest().iter().any(|longest| *longest > 100.0));
    let long: Vec<String> = long.map(|row| format!("{}: {:?} ms", row.pass.name, row.longest())).collect();
    assert!(long.is_empty(), "{long:#?}");
    let taken: BTreeSet<&str> = rows.iter().flat_map(|row| row.taken.iter().copied()).collect();
    let left: Vec<&str> = LOOPS.iter().map(|(name, _)| *name).filter(|name| !taken.contains(name)).collect();
    assert!(left.is_empty(), "no pass has these: {left:?}");
    let passes: Vec<&str> = ALL.iter().map(|pass| pass.name).collect();
    assert!(THREADS.iter().all(|(name, ..)| passes.contains(name)));
}

#[test]
fn work_is_counted_by_the_code() {
    // 64 loads of an image in a loop, then nodes of 32 bytes.
    let beams = Row::of(ALL.iter().find(|pass| pass.name == "beam_lists").unwrap()).work;
    assert!(beams.loads > 64.0 * 3.0 + 150.0 * 20.0, "{beams:?}");
    assert!(beams.bytes > 64.0 * 3.0 * 16.0 + 150.0 * 20.0 * 32.0, "{beams:?}");
    // A pass that reads a texel and writes another.
    let position = Row::of(ALL.iter().find(|pass| pass.name == "camera_position").unwrap()).work;
    assert!(position.loads == 1.0 && position.bytes == 32.0, "{position:?}");
    let twice = position.milliseconds(2e7) / position.milliseconds(1e7);
    assert!((twice - 2.0).abs() < 0.01, "{twice}");
}

/// The table of docs/gpu.md.
pub(super) fn table() -> String {
    let mut table = String::from(
        "\n## Each pass\n\n\
         The time of each pass on a tenth of an H100, as a test computes it from the pass's code: what a thread does, times the\n\
         threads of a picture of 3840 x 2160 that a mirror fills, or of a cloud of 10 million points. The largest of three times\n\
         counts: instructions at half of the card's rate, bytes at 335 GB/s without any cache, and loads of 0.5 microseconds, one\n\
         after the other, by 26,000 threads at once. Both sides of each condition are counted. How often loops run is told in\n\
         crates/render/src/translation/work_tests.rs. So the times are too high rather than too low; none is measured. The test fails\n\
         where a dispatch takes more than 100 ms, and where the loops of a new pass are not told.\n\n\
         | pass | threads | instructions | bytes | loads | whole, ms | longest dispatch in its first frame, ms | and later, ms |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for pass in ALL {
        let row = Row::of(pass);
        let Work { instructions, bytes, loads } = row.work;
        let [first, later] = row.longest();
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
