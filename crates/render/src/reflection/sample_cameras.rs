//! Sample-based cameras (after Popescu, Sacks and Mei 2006): the reflected rays of a square of the mirror's picture are
//! a bundle, a pair of polynomials, and project points as a camera does. Bundles are fitted anew each frame, so the
//! method needs no tree over the points and keeps nothing. Or, as published, trees of pinholes and lists of rays part
//! space (`space`), and are kept while camera and mirrors stand. docs/methods/sample_cameras.md says what became of
//! the paper.

#[cfg(test)]
mod analytic_tests;
mod pinhole;
#[cfg(test)]
mod ray_tests;
mod space;
#[cfg(test)]
mod space_tests;
#[cfg(test)]
mod tests;
mod tree;
#[cfg(test)]
mod twin;

use cloud::Bounds;
use scene::{BundleCull, BundleRest, BundleSplat, CameraCells, Mirror, SampleCameras as Parameters};

use super::formula::{analytic, exact, upload_analytic};
use super::forward::{Forward, Splats, picture_buffer};
use super::gather::{Gather, rest_list};
use super::surfel_index::SurfelIndex;
use super::surfel_trace::{self, Rays};
use super::task::Task;
use crate::gpu::{Gpu, Result};
use crate::layout::{BUNDLE_BYTES, BUNDLE_NODE_BYTES, BundleGrid, SOLUTION_BYTES};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::uniform_buffer;
pub use space::CameraCount;
use space::Space;

/// The state of the method that is kept from frame to frame: room, and the trees of cells of space.
#[derive(Default)]
pub(crate) struct SampleCameras {
    squares: Option<Squares>,
    space: Space,
    /// The rays that no bundle stands for.
    rest: Option<wgpu::Buffer>,
}

/// Room for the squares of a grid.
struct Squares {
    count: u64,
    nodes: wgpu::Buffer,
    bundles: wgpu::Buffer,
}

impl Squares {
    fn new(gpu: &Gpu, count: u64) -> Result<Self> {
        Ok(Self {
            count,
            nodes: picture_buffer(gpu, "squares of a mirror", count * BUNDLE_NODE_BYTES)?,
            bundles: picture_buffer(gpu, "bundles of rays", count * BUNDLE_BYTES)?,
        })
    }
}

impl BundleGrid {
    /// The squares about the part of a picture in which mirrors may be seen, given by its first pixel and the one
    /// beyond its last; `scene` is the box about all points, relative to the eye.
    fn new(settings: &Parameters, [first, end]: [[u32; 2]; 2], scene: Bounds) -> Self {
        let stride = power_below(settings.down_sampling.max(1));
        let least = power_below(settings.least_square).max(2 * stride);
        let largest = power_below(settings.largest_square).max(least);
        let [first_x, first_y] = first.map(|edge| edge / largest * largest);
        let [columns, rows] = [end[0] - first_x, end[1] - first_y].map(|edge| edge.div_ceil(largest));
        let [scene_low, scene_high] = [scene.min, scene.max].map(|corner| corner.as_vec3().extend(0.0));
        let last_level = (largest / least).ilog2();
        Self { first_x, first_y, columns, rows, last_level, level: 0, largest, stride, scene_low, scene_high }
    }

    /// The number of squares of a level.
    fn squares(&self, level: u32) -> u64 {
        u64::from(self.columns * self.rows) << (2 * level)
    }

    fn all_squares(&self) -> u64 {
        (0..=self.last_level).map(|level| self.squares(level)).sum()
    }
}

impl SampleCameras {
    pub fn bytes(&self) -> u64 {
        let squares = self.squares.as_ref().map_or(0, |squares| squares.nodes.size() + squares.bundles.size());
        squares + self.space.bytes() + self.rest.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// Begins a frame. With `may_lag` it may show trees of an earlier view while its own are made.
    pub fn begin(&mut self, may_lag: bool) {
        self.space.begin(may_lag);
    }

    /// Whether the frame showed trees of an earlier view.
    pub fn lags(&self) -> bool {
        self.space.lags()
    }

    /// The trees of cells of space.
    pub fn count(&self) -> Option<CameraCount> {
        self.space.count()
    }

    /// Fills the Mirror G-Buffer of one bounce.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        gather: &Gather,
        forward: &mut Forward,
        task: &Task<'_>,
    ) -> Result<()> {
        let gpu = recorder.gpu;
        let settings = &task.settings.sample_cameras;
        let rounds = rounds_of(gpu, task);
        forward.reserve(gpu, task, 1, rounds, [0, 1])?;
        let rest = rest_list(recorder, &mut self.rest, task.supply.size);
        match settings.cells {
            CameraCells::Image => {
                let mut grid = grid_of(task);
                if all_analytic(task) {
                    grid.last_level = 0;
                }
                let count = grid.all_squares().max(1);
                let kept = self.squares.take().filter(|squares| squares.count >= count);
                let squares = match kept {
                    Some(squares) => squares,
                    None => Squares::new(gpu, count)?,
                };
                let squares = &*self.squares.insert(squares);
                let analytic = upload_analytic(gpu, task.settings, analytic_of(task), task.supply.camera.eye);
                fit(recorder, task, squares, grid, [&gather.hits, rest, &analytic])?;
                forward.clear(recorder);
                project(recorder, forward, task, (squares, &analytic), grid, rounds)?;
            }
            CameraCells::Space => {
                forward.clear(recorder);
                self.space.project(recorder, forward, task, rounds, [&gather.hits, rest])?;
            }
        }
        let own_sides = settings.splat == BundleSplat::Footprint;
        let splats = Splats { rounds, own_sides };
        forward.depth(recorder, task, splats, [0, 0])?;
        forward.visibility(recorder, task, splats, [0, 0])?;
        let traces_rest = settings.rest == BundleRest::SurfelTrace;
        if traces_rest {
            surfel_trace::trace(recorder, index, gather, task, &task.supply.chunks, Rays::Listed(rest))?;
        }
        let fill = |recorder: &mut Recorder<'_>, found: [wgpu::BindingResource<'_>; 3]| {
            if traces_rest { gather.resolve_points(recorder, task, found) } else { Ok(()) }
        };
        let Some(formulas) = task.formulas else {
            return forward.close(recorder, task, fill);
        };
        forward.close(recorder, &Task { seen: &gather.found, ..*task }, fill)?;
        gather.found.show_formulas(recorder, task, formulas)
    }
}

/// The squares of a bounce.
fn grid_of(task: &Task<'_>) -> BundleGrid {
    let (bounds, eye) = (scene_of(task), task.supply.camera.eye);
    let scene = Bounds { min: bounds.min - eye, max: bounds.max - eye };
    BundleGrid::new(&task.settings.sample_cameras, part_of(task), scene)
}

/// The mirrors whose reflections of points follow from their formula. Only rays from the camera's eye do, and only
/// those of perfect mirrors: glossy ones, and rays from several places of a pixel, have normals of their own.
fn analytic_of<'a>(task: &Task<'a>) -> impl Iterator<Item = &'a Mirror> {
    let settings = task.settings;
    let is_plain = task.bounce == 0 && settings.sample_cameras.analytic && settings.reflection.samples <= 1;
    let is_wanted = move |mirror: &&Mirror| is_plain && (settings.gloss.samples == 0 || mirror.specular_power <= 0.0);
    analytic(task.mirrors.iter().filter(is_wanted), task.supply.camera.eye)
}

/// Whether a formula stands for all mirrors, so that no square has a ray: none is drawn as points, and all others are
/// such ones.
fn all_analytic(task: &Task<'_>) -> bool {
    let reflects = |mirror: &&Mirror| mirror.specular_intensity > 0.0;
    let mut drawn = exact(task.settings, task.mirrors).filter(reflects).peekable();
    let has_formula = |mirror: &Mirror| analytic_of(task).any(|other| std::ptr::eq(other, mirror));
    drawn.peek().is_some() && drawn.all(has_formula) && task.store.mirror_clouds(task.settings).is_empty()
}

/// The first pixel of the part of the picture in which mirrors may be seen, and the one beyond its last.
fn part_of(task: &Task<'_>) -> [[u32; 2]; 2] {
    let tiles = task.supply.camera.mirror_tiles;
    let end = |axis: usize| ((tiles.first[axis] + tiles.count[axis]) * 8).min(task.supply.size[axis]);
    [tiles.first.map(|tile| tile * 8), [end(0), end(1)]]
}

/// The box about all points without strays; the eye if there are none.
fn scene_of(task: &Task<'_>) -> Bounds {
    let placed = task.supply.chunks.iter().filter_map(|chunk| task.store.placed(*chunk));
    let all = placed.fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds));
    let scene = task.store.bounds();
    let bounds = Bounds { min: all.min.max(scene.min), max: all.max.min(scene.max) };
    let eye = task.supply.camera.eye;
    if bounds.is_empty() { Bounds { min: eye, max: eye } } else { bounds }
}

fn power_below(number: u32) -> u32 {
    1 << number.ilog2()
}

/// The number of places that are kept of each point: as many as are asked for, or fit into a binding.
fn rounds_of(gpu: &Gpu, task: &Task<'_>) -> u32 {
    let points = task.store.page_capacities().into_iter().map(u64::from).max().unwrap_or(0).max(1);
    let most = gpu.device.limits().max_storage_buffer_binding_size / (points * SOLUTION_BYTES);
    task.settings.sample_cameras.roots.min(most.try_into().unwrap_or(u32::MAX)).max(1)
}

/// Fits the bundles, one dispatch a level: a level divides the squares of the one before. Squares without a bundle are
/// emptied from the finest level up.
fn fit(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    squares: &Squares,
    grid: BundleGrid,
    [hits, rest, analytic]: [&wgpu::Buffer; 3],
) -> Result<()> {
    let traces_rest = task.settings.sample_cameras.rest == BundleRest::SurfelTrace;
    for level in 0..=grid.last_level {
        let uniform = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&BundleGrid { level, ..grid }));
        let bindings = passes::bundle_fit {
            grid: uniform.as_entire_binding(),
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            nodes: squares.nodes.as_entire_binding(),
            bundles: squares.bundles.as_entire_binding(),
            counters: task.counters.as_entire_binding(),
            hits: hits.as_entire_binding(),
            rest: rest.as_entire_binding(),
            analytic: analytic.as_entire_binding(),
        };
        let groups = grid.squares(level).max(1) as u32;
        // Rows, by which the pass is cut, of about as many workgroups as there are rows.
        let columns = groups.isqrt().next_multiple_of(64).min(groups);
        let switches = [("count_squares", u32::from(task.bounce == 0)), ("traces_rest", u32::from(traces_rest))];
        recorder.by_rows(&switches, task.supply, bindings, [columns, groups.div_ceil(columns), 1])?;
    }
    // Squares whose rays are all traced would be looked through for every point.
    for level in (0..grid.last_level).rev().filter(|_| traces_rest) {
        let uniform = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&BundleGrid { level, ..grid }));
        let bindings =
            passes::bundle_prune { grid: uniform.as_entire_binding(), nodes: squares.nodes.as_entire_binding() };
        let groups = grid.squares(level).div_ceil(64).max(1) as u32;
        let columns = groups.min(1024);
        recorder.over(&[], task.supply, bindings, [columns, groups.div_ceil(columns), 1])?;
    }
    Ok(())
}

/// Finds where the points are reflected.
fn project(
    recorder: &mut Recorder<'_>,
    forward: &Forward,
    task: &Task<'_>,
    (squares, analytic): (&Squares, &wgpu::Buffer),
    grid: BundleGrid,
    rounds: u32,
) -> Result<()> {
    let settings = &task.settings.sample_cameras;
    let switches = [
        ("degree", settings.degree),
        ("roots", rounds),
        ("by_blocks", u32::from(settings.cull == BundleCull::Blocks)),
        ("count_points", u32::from(task.bounce == 0)),
    ];
    let uniform = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&grid));
    recorder.over_points_by_page(&switches, task.supply, |page| {
        Some(passes::sample_cameras_project {
            grid: uniform.as_entire_binding(),
            nodes: squares.nodes.as_entire_binding(),
            bundles: squares.bundles.as_entire_binding(),
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            solutions: forward.bind_solutions(page, 0, 0)?,
            counters: task.counters.as_entire_binding(),
            analytic: analytic.as_entire_binding(),
        })
    })
}
