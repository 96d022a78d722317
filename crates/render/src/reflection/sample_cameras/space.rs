//! Cells of space: takes the ray map from the GPU, has trees made of it on other threads, and keeps them while the rays
//! and the box about all points stay as they are. Which points there are, and where, does not matter.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cloud::Bounds;
use glam::DVec3;
use scene::{BundleRest, SampleCameras as Parameters};

use super::tree::{RayMap, Rules, Trees, plant};
use super::{part_of, power_below, scene_of};
use crate::gpu::{Error, Gpu, Result};
use crate::layout::{CameraLeaf, CameraNode, CameraRay, CameraTrees, POINTS_LISTED};
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::forward::{Forward, picture_buffer};
use crate::reflection::mirror_places::mirror_places;
use crate::reflection::task::Task;
use crate::targets::uniform_buffer;

/// The distance of rays in pixels unless the settings ask for another.
const USUAL_DISTANCE: u32 = 4;
/// The box about all points is widened to steps of this share of its size, so that points that move a little leave it.
const BOX_STEP: f64 = 1.0 / 16.0;
/// How long to wait for trees before asking again whether the frame is given up.
const MOMENT: Duration = Duration::from_millis(1);

/// The trees of one bounce of a frame's reflections.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraCount {
    pub pinholes: u32,
    pub lists: u32,
    /// How many copies of each ray there are in all leaves together.
    pub copies: f32,
    /// The share of the points found that a list projects.
    pub listed: f32,
    /// The bytes that the trees take on the GPU.
    pub bytes: u64,
    /// The time that making the trees took, in milliseconds.
    pub milliseconds: f32,
    /// Whether these are the trees of an earlier view, while those of this one are made.
    pub is_late: bool,
}

/// What trees are made from. All else follows from it.
#[derive(Clone, PartialEq)]
struct Asked {
    grid: [u32; 5],
    rays: Vec<u8>,
    eye: DVec3,
    /// The line of sight, of rays that come from the eye.
    forward: Option<DVec3>,
    scene: Bounds,
    mirrors: Vec<Bounds>,
    rules: Rules,
}

/// Trees that are made.
struct Making {
    asked: Arc<Asked>,
    /// Ends the thread when it is dropped.
    _flag: Flag,
    /// Returns the trees, and the milliseconds that they took; `None` if it was ended.
    thread: JoinHandle<Option<(Trees, f64)>>,
}

struct Flag(Arc<AtomicBool>);

impl Drop for Flag {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Trees on the GPU.
struct Planted {
    asked: Arc<Asked>,
    trees: u32,
    node_count: u32,
    /// The nodes, then the gaps between rays.
    nodes: wgpu::Buffer,
    leaves: wgpu::Buffer,
    rays: wgpu::Buffer,
    standing: wgpu::Buffer,
    count: CameraCount,
}

/// The trees of a bounce.
#[derive(Default)]
struct OfBounce {
    planted: Option<Planted>,
    making: Option<Making>,
    map: Option<wgpu::Buffer>,
}

#[derive(Default)]
pub(super) struct Space {
    bounces: Vec<OfBounce>,
    may_lag: bool,
    lags: bool,
}

impl Planted {
    fn new(gpu: &Gpu, asked: Arc<Asked>, trees: &Trees, milliseconds: f64) -> Result<Self> {
        let filled = |label: &'static str, bytes: &[u8], least: usize| {
            let buffer = picture_buffer(gpu, label, bytes.len().max(least) as u64)?;
            gpu.queue.write_buffer(&buffer, 0, bytes);
            Result::Ok(buffer)
        };
        let (planes, gaps): (&[u8], &[u8]) = (bytemuck::cast_slice(&trees.nodes), bytemuck::cast_slice(&trees.gaps));
        let nodes = filled("planes of cameras", &[planes, gaps].concat(), size_of::<CameraNode>())?;
        let leaves = filled("cameras", bytemuck::cast_slice(&trees.leaves), size_of::<CameraLeaf>())?;
        let rays = filled("rays of cameras", &asked.rays, size_of::<CameraRay>())?;
        let standing = filled("rays with a camera", bytemuck::cast_slice(&trees.standing), 4)?;
        let count = CameraCount {
            pinholes: trees.pinholes as u32,
            lists: trees.lists as u32,
            copies: trees.copies as f32 / trees.rays.max(1) as f32,
            listed: 0.0,
            bytes: [&nodes, &leaves, &rays, &standing].map(wgpu::Buffer::size).iter().sum(),
            milliseconds: milliseconds as f32,
            is_late: false,
        };
        let node_count = trees.nodes.len() as u32;
        Ok(Self { asked, trees: trees.count as u32, node_count, nodes, leaves, rays, standing, count })
    }
}

impl Making {
    fn begin(gpu: &Gpu, asked: Arc<Asked>) -> Result<Self> {
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let (given, flag) = (asked.clone(), Flag(is_cancelled.clone()));
        let make = move || {
            let start = Instant::now();
            let rays: Vec<CameraRay> = bytemuck::pod_collect_to_vec(&given.rays);
            let volume = |bounds: &Bounds| bounds.size().element_product();
            let away = |bounds: &Bounds, place: DVec3| place.distance_squared(place.clamp(bounds.min, bounds.max));
            // The nearest mirror's box, the smallest if the place is in several.
            let mirror_of = |tail: DVec3| {
                let place = tail + given.eye;
                let order = |(_, a): &(usize, &Bounds), (_, b): &(usize, &Bounds)| {
                    away(a, place).total_cmp(&away(b, place)).then(volume(a).total_cmp(&volume(b)))
                };
                given.mirrors.iter().enumerate().min_by(order).map_or(0, |(number, _)| number)
            };
            let scene = Bounds { min: given.scene.min - given.eye, max: given.scene.max - given.eye };
            let map = RayMap::new(given.grid[2] as usize, &rays, scene, given.forward, mirror_of);
            plant(&map, &given.rules, &is_cancelled).map(|trees| (trees, start.elapsed().as_secs_f64() * 1000.0))
        };
        let thread = std::thread::Builder::new().name("cameras".into()).spawn(make).map_err(|error| {
            let problem = format!("no thread for the cameras of reflected rays: {error}");
            Error::Device { adapter: gpu.info.name.clone(), problem }
        })?;
        Ok(Self { asked, _flag: flag, thread })
    }
}

impl OfBounce {
    /// Takes up what was made meanwhile.
    fn take_up(&mut self, gpu: &Gpu) -> Result<()> {
        let Some(Making { asked, thread, .. }) = self.making.take() else { return Ok(()) };
        let made = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        if let Some((trees, milliseconds)) = made {
            self.planted = Some(Planted::new(gpu, asked, &trees, milliseconds)?);
        }
        Ok(())
    }
}

impl Space {
    pub fn bytes(&self) -> u64 {
        let of_bounce = |bounce: &OfBounce| {
            let map = bounce.map.as_ref().map_or(0, wgpu::Buffer::size);
            map + bounce.planted.as_ref().map_or(0, |planted| planted.count.bytes)
        };
        self.bounces.iter().map(of_bounce).sum()
    }

    /// Begins a frame. With `may_lag` it does with the trees of an earlier view while its own are made.
    pub fn begin(&mut self, may_lag: bool) {
        (self.may_lag, self.lags) = (may_lag, false);
    }

    /// Whether the frame did with trees of an earlier view.
    pub fn lags(&self) -> bool {
        self.lags
    }

    /// The trees of the first bounce.
    pub fn count(&self) -> Option<CameraCount> {
        let planted = self.bounces.first().and_then(|bounce| bounce.planted.as_ref());
        planted.map(|planted| CameraCount { is_late: self.lags, ..planted.count })
    }

    /// Finds where the points are reflected, and lists the rays that no leaf stands for.
    ///
    /// # Errors
    /// A shader is refused, there is no memory, or the frame is given up while it waits.
    pub fn project(
        &mut self,
        recorder: &mut Recorder<'_>,
        forward: &Forward,
        task: &Task<'_>,
        rounds: u32,
        [hits, rest]: [&wgpu::Buffer; 2],
    ) -> Result<()> {
        if self.bounces.len() <= task.bounce {
            self.bounces.resize_with(task.bounce + 1, OfBounce::default);
        }
        let grid = grid_of(task);
        let asked = self.ask(recorder, task, grid)?;
        self.provide(recorder, task, asked)?;
        let bounce = &self.bounces[task.bounce];
        let nothing;
        let planted = match &bounce.planted {
            Some(planted) => planted,
            // Nothing is made yet: all rays are left.
            None => {
                nothing = Planted::nothing(recorder.gpu)?;
                &nothing
            }
        };
        let [first_x, first_y, columns, rows, stride] = planted.asked.grid;
        let shift = (task.supply.camera.eye - planted.asked.eye).as_vec3().extend(0.0);
        let (trees, nodes) = (planted.trees, planted.node_count);
        let trees = CameraTrees { first_x, first_y, columns, rows, stride, trees, nodes, shift, unused: 0 };
        let uniform = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&trees));
        if task.bounce == 0 {
            let listed = POINTS_LISTED as u64 * 4;
            recorder.clear_part(task.counters, listed..listed + 4);
        }
        let bindings = passes::sample_cameras_mark {
            trees: uniform.as_entire_binding(),
            standing: planted.standing.as_entire_binding(),
            point_in: task.mirror.point.bind(),
            hits: hits.as_entire_binding(),
            rest: rest.as_entire_binding(),
            counters: task.counters.as_entire_binding(),
        };
        let settings = &task.settings.sample_cameras;
        let counts = u32::from(task.bounce == 0);
        let traces_rest = u32::from(settings.rest == BundleRest::SurfelTrace);
        recorder.over_mirrors(&[("count_rays", counts), ("traces_rest", traces_rest)], task.supply, bindings)?;
        let switches = [("roots", rounds), ("count_points", counts)];
        recorder.over_points_by_page(&switches, task.supply, |page| {
            Some(passes::sample_cameras_space {
                trees: uniform.as_entire_binding(),
                nodes: planted.nodes.as_entire_binding(),
                leaves: planted.leaves.as_entire_binding(),
                rays: planted.rays.as_entire_binding(),
                point_in: task.mirror.point.bind(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
                solutions: forward.bind_solutions(page, 0, 0)?,
                counters: task.counters.as_entire_binding(),
            })
        })
    }

    /// Reads the reflected rays; `None` in a rehearsal that runs nothing.
    fn ask(&mut self, recorder: &mut Recorder<'_>, task: &Task<'_>, grid: [u32; 5]) -> Result<Option<Asked>> {
        let gpu = recorder.gpu;
        let [first_x, first_y, columns, rows, stride] = grid;
        let bytes = u64::from(columns) * u64::from(rows) * size_of::<CameraRay>() as u64;
        let map = &mut self.bounces[task.bounce].map;
        if map.as_ref().is_none_or(|map| map.size() != bytes) {
            *map = Some(picture_buffer(gpu, "a map of reflected rays", bytes)?);
        }
        let Some(map) = map else { return Ok(None) };
        let trees = CameraTrees { first_x, first_y, columns, rows, stride, ..CameraTrees::default() };
        let uniform = uniform_buffer(gpu, bytemuck::bytes_of(&trees));
        let bindings = passes::sample_cameras_rays {
            trees: uniform.as_entire_binding(),
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            rays: map.as_entire_binding(),
        };
        recorder.over(&[], task.supply, bindings, [columns.div_ceil(8), rows.div_ceil(8), 1])?;
        let Some(rays) = recorder.read(map)? else { return Ok(None) };
        Ok(Some(Asked {
            grid,
            rays,
            eye: task.supply.camera.eye,
            forward: (task.bounce == 0 && !task.supply.camera.orthographic)
                .then(|| task.supply.camera.view_from_world.row(2)),
            scene: stepped(scene_of(task)),
            mirrors: mirror_places(task).into_iter().map(|mirror| mirror.bounds).collect(),
            rules: rules_of(task),
        }))
    }

    /// Provides the trees that are asked for, or, if the frame may lag, has them made.
    fn provide(&mut self, recorder: &Recorder<'_>, task: &Task<'_>, asked: Option<Asked>) -> Result<()> {
        let Some(asked) = asked else { return Ok(()) };
        let bounce = &mut self.bounces[task.bounce];
        if bounce.making.as_ref().is_some_and(|making| making.thread.is_finished()) {
            bounce.take_up(recorder.gpu)?;
        }
        if bounce.planted.as_ref().is_some_and(|planted| *planted.asked == asked) {
            bounce.making = None;
            return Ok(());
        }
        let is_made = bounce.making.as_ref().is_some_and(|making| *making.asked == asked);
        // While something moves, what is being made is finished first: else nothing would ever be.
        if !is_made && (!self.may_lag || bounce.making.is_none()) {
            bounce.making = Some(Making::begin(recorder.gpu, Arc::new(asked))?);
        }
        if self.may_lag {
            self.lags = true;
            return Ok(());
        }
        while bounce.making.as_ref().is_some_and(|making| !making.thread.is_finished()) {
            recorder.go_on()?;
            std::thread::sleep(MOMENT);
        }
        bounce.take_up(recorder.gpu)
    }
}

impl Planted {
    fn nothing(gpu: &Gpu) -> Result<Self> {
        let nowhere = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
        let rules = Rules { accuracy: 0.0, near: 0.0, split_gain: 0.0, longest_list: 0 };
        let (rays, mirrors) = (Vec::new(), Vec::new());
        let eye = DVec3::ZERO;
        let asked = Asked { grid: [0, 0, 0, 0, 1], rays, eye, forward: None, scene: nowhere, mirrors, rules };
        Self::new(gpu, Arc::new(asked), &Trees::default(), 0.0)
    }
}

/// The first pixel with a ray, the numbers of columns and rows, and the distance of rays in pixels.
fn grid_of(task: &Task<'_>) -> [u32; 5] {
    let [first, end] = part_of(task);
    let stride = distance_of_rays(&task.settings.sample_cameras);
    // Places are multiples of the distance, so that mirrors that move over the picture keep their rays' pixels.
    let first = first.map(|edge| edge / stride * stride);
    let [columns, rows] = [0, 1].map(|axis| (end[axis].saturating_sub(first[axis])).div_ceil(stride).max(1));
    [first[0] + stride / 2, first[1] + stride / 2, columns, rows, stride]
}

fn distance_of_rays(settings: &Parameters) -> u32 {
    if settings.down_sampling == 0 { USUAL_DISTANCE } else { power_below(settings.down_sampling) }
}

fn rules_of(task: &Task<'_>) -> Rules {
    let settings = &task.settings.sample_cameras;
    Rules {
        accuracy: settings.accuracy.into(),
        near: f64::from(settings.near) * task.supply.camera.scene_radius,
        split_gain: settings.split_gain.into(),
        longest_list: settings.longest_list as usize,
    }
}

/// The box, widened to whole steps.
fn stepped(bounds: Bounds) -> Bounds {
    let size = bounds.size().max_element();
    if size.is_nan() || size <= 0.0 {
        return bounds;
    }
    let step = size.log2().floor().exp2() * BOX_STEP;
    Bounds { min: (bounds.min / step).floor() * step, max: (bounds.max / step).ceil() * step }
}
