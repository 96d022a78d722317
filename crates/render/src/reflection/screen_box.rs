//! The box of six walls about all points, for rays that leave the camera's picture (after Johnsson 2012). Each wall has
//! a picture of its own: of the points beside it, or of the pixels that show it, completed where the camera does not
//! see it (docs/methods/screen_trace.md).

use std::num::NonZeroU64;

use cloud::Bounds;
use glam::{DMat3, DVec3, Vec4};
use scene::{ScreenBox, ScreenCompletion, Settings};

use super::mirror_places::map_bytes;
use super::task::Task;
use crate::frame::FrameCamera;
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::layout::{BOX_EDGE_BYTES, BOX_SCORE_BYTES, BOX_WORD_BYTES, WALL_DEPTH};
use crate::lighting::splat_of_maps;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::draw_list::Selection;
use crate::targets::storage;

/// The walls of the box; see shaders/shared/screen_box.wgsl.
pub(super) struct Walls {
    edge: u32,
    /// Two words a texel.
    pub texels: wgpu::Buffer,
    completion: Option<Completion>,
}

/// What the completion of walls works with.
struct Completion {
    edges: wgpu::Buffer,
    scores: wgpu::Buffer,
    /// The period of each wall across and down, then the number of known texels of each.
    periods: wgpu::Buffer,
}

impl Completion {
    fn new(device: &wgpu::Device, edge: u32) -> Self {
        let texels = 12 * u64::from(edge * edge).next_multiple_of(32);
        Self {
            edges: storage(device, "edges on walls", texels * BOX_EDGE_BYTES),
            scores: storage(device, "scores of walls", 12 * u64::from(edge / 2 - 1) * BOX_SCORE_BYTES),
            periods: storage(device, "periods of walls", 18 * BOX_WORD_BYTES),
        }
    }
}

impl Walls {
    /// The walls that the settings ask for; without any, of no use.
    pub fn new(device: &wgpu::Device, settings: &Settings) -> Self {
        let edge = edge_of(settings);
        Self {
            edge,
            texels: storage(device, "walls of the box", 6 * map_bytes([edge; 2])),
            completion: is_completed(settings).then(|| Completion::new(device, edge)),
        }
    }

    /// Whether these are the walls that the settings ask for.
    pub fn are_for(&self, settings: &Settings) -> bool {
        self.edge == edge_of(settings) && self.completion.is_some() == is_completed(settings)
    }

    pub fn bytes(&self) -> u64 {
        let Some(Completion { edges, scores, periods }) = &self.completion else { return self.texels.size() };
        [&self.texels, edges, scores, periods].map(wgpu::Buffer::size).iter().sum()
    }

    /// Fills them with what the settings ask for; `screen` has the box.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn fill(&self, recorder: &mut Recorder<'_>, task: &Task<'_>, screen: &wgpu::Buffer) -> Result<()> {
        match task.settings.screen_trace.box_from {
            ScreenBox::None => Ok(()),
            ScreenBox::Points => self.draw_points(recorder, task),
            ScreenBox::Picture => self.take_pixels(recorder, task, screen),
        }
    }

    /// Draws the points beside each wall, as seen from within the box.
    fn draw_points(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        recorder.clear(&self.texels);
        let settings = Settings { splat: splat_of_maps(task.settings), ..task.settings.clone() };
        let bounds = task.store.bounds();
        if bounds.is_empty() {
            return Ok(());
        }
        let deep = f64::from(WALL_DEPTH) * bounds.radius();
        let atomics64 = recorder.gpu.has_wide_atomics(&settings.splat);
        for wall in 0..6 {
            let camera = camera_of(bounds, wall, deep, self.edge);
            let list = task.store.draw_list(&camera, &settings, Selection::Seen);
            let inputs = Inputs::new(recorder.gpu, camera, &settings, &list);
            let bytes = map_bytes([self.edge; 2]);
            let nearest = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &self.texels,
                offset: bytes * wall as u64,
                size: NonZeroU64::new(bytes),
            });
            recorder.nearest_points(&[], &inputs, nearest, atomics64)?;
        }
        Ok(())
    }

    /// Puts the pixels that lie beside the walls on them, and completes what the camera does not see.
    fn take_pixels(&self, recorder: &mut Recorder<'_>, task: &Task<'_>, screen: &wgpu::Buffer) -> Result<()> {
        recorder.clear(&self.texels);
        for finds_pixel in [0, 1] {
            let bindings = passes::screen_box_pixels {
                normal_in: task.camera.normal.bind(),
                position_in: task.camera.position.bind(),
                screen: screen.as_entire_binding(),
                texels: self.texels.as_entire_binding(),
            };
            recorder.over_pixels(&[("finds_pixel", finds_pixel)], task.supply, bindings)?;
        }
        let Some(Completion { edges, scores, periods }) = &self.completion else { return Ok(()) };
        recorder.clear(periods);
        let groups = self.edge.div_ceil(8);
        let bindings = passes::screen_box_edges {
            screen: screen.as_entire_binding(),
            picture_albedo_in: task.camera.albedo.bind(),
            texels: self.texels.as_entire_binding(),
            edges: edges.as_entire_binding(),
            periods: periods.as_entire_binding(),
        };
        recorder.over(&[], task.supply, bindings, [groups, groups, 6])?;
        if task.settings.screen_trace.completion == ScreenCompletion::Repeat {
            let bindings = passes::screen_box_scores {
                screen: screen.as_entire_binding(),
                edges: edges.as_entire_binding(),
                scores: scores.as_entire_binding(),
            };
            recorder.by_rows(&[], task.supply, bindings, [self.edge / 2 - 1, 12, 1])?;
            let bindings = passes::screen_box_periods {
                screen: screen.as_entire_binding(),
                scores: scores.as_entire_binding(),
                periods: periods.as_entire_binding(),
            };
            recorder.over(&[], task.supply, bindings, [12, 1, 1])?;
        }
        let bindings = passes::screen_box_fill {
            screen: screen.as_entire_binding(),
            texels: self.texels.as_entire_binding(),
            periods: periods.as_entire_binding(),
        };
        recorder.by_rows(&[], task.supply, bindings, [groups, groups, 6])
    }
}

/// The texels along an edge of a wall's picture.
fn edge_of(settings: &Settings) -> u32 {
    if settings.screen_trace.box_from == ScreenBox::None { 1 } else { settings.screen_trace.box_size }
}

/// Whether walls are completed where the camera does not see them.
fn is_completed(settings: &Settings) -> bool {
    let chosen = &settings.screen_trace;
    chosen.box_from == ScreenBox::Picture && chosen.completion != ScreenCompletion::None
}

/// The corners of the box about all points, relative to the eye.
pub(super) fn corners(bounds: Bounds, eye: DVec3) -> [Vec4; 2] {
    if bounds.is_empty() {
        return [Vec4::ZERO; 2];
    }
    [bounds.min, bounds.max].map(|corner| (corner - eye).as_vec3().extend(0.0))
}

/// The parallel view onto a wall from so far within the box: walls 0 to 2 are where an axis is largest, 3 to 5 where it
/// is smallest, and the two axes after it point right and up.
fn camera_of(bounds: Bounds, wall: usize, deep: f64, edge: u32) -> FrameCamera {
    let axis = |index: usize| DVec3::AXES[(wall + index) % 3];
    let outward = if wall < 3 { axis(0) } else { -axis(0) };
    let reach = bounds.size() * 0.5;
    let eye = bounds.center() + outward * (reach.dot(axis(0)) - deep);
    let widest = 2.0 * reach.dot(axis(1)).max(reach.dot(axis(2)));
    FrameCamera {
        view_from_world: DMat3::from_cols(axis(1), axis(2), outward).transpose(),
        ..FrameCamera::parallel_along(
            eye,
            outward,
            f64::from(edge) / widest.max(f64::from(f32::MIN_POSITIVE)),
            [edge; 2],
        )
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Chunk, Cloud, pack_normal, pack_radius};
    use scene::{Camera, Method, Mirror, Shape};

    use super::*;
    use crate::coloring::ColorPlan;
    use crate::frame::Objects;
    use crate::gpu::Gpu;
    use crate::renderer::{Frame, Renderer};
    use crate::store::{Material, PointStore};

    /// The length of a square of the checkered wall.
    const SQUARE: f64 = 0.5;

    /// Whether a place on the checkered wall is bright; none near the edge of a square.
    fn is_bright(x: f64, z: f64) -> Option<bool> {
        let squares = [x, z].map(|along| along / SQUARE);
        let is_inside = squares.iter().all(|along| (along - along.round()).abs() * SQUARE > 0.1);
        is_inside.then(|| (squares[0].floor() + squares[1].floor()).rem_euclid(2.0) == 0.0)
    }

    /// A checkered wall of edge 4 at y = 2, and a small grey one at y = -2.
    fn walls(gpu: &Arc<Gpu>) -> PointStore {
        let steps = 120;
        let along = |step: i32| (f64::from(step) + 0.5) / f64::from(steps) * 4.0 - 2.0;
        let places = (0..steps * steps).map(|i| DVec3::new(along(i % steps), 2.0, along(i / steps)));
        let behind = (0..9).map(|i| DVec3::new(f64::from(i % 3) * 0.02, -2.0, f64::from(i / 3) * 0.02));
        let places: Vec<DVec3> = places.chain(behind).collect();
        let mut chunk = Chunk::new(0, DVec3::ZERO, places.iter().map(|place| place.as_vec3().to_array()).collect());
        let color = |place: &DVec3| {
            let squares = (place.x / SQUARE).floor() + (place.z / SQUARE).floor();
            if squares.rem_euclid(2.0) == 0.0 { [220, 220, 220, 255] } else { [30, 30, 30, 255] }
        };
        chunk.colors = Some(Arc::new(places.iter().map(color).collect()));
        chunk.radii = Some(Arc::new(vec![pack_radius(0.03); chunk.len()]));
        chunk.normals =
            Some(Arc::new(places.iter().map(|p| pack_normal(glam::Vec3::Y * -p.y.signum() as f32)).collect()));
        let mut store = PointStore::new(gpu.clone());
        let id = store.add_cloud(Material::default());
        let ids = vec![store.add_chunk(id, &chunk, None).unwrap()];
        let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        store
    }

    #[test]
    fn half_of_a_checkered_wall_is_continued_in_phase() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let store = walls(&gpu);
        // The camera sees the left half of the wall, and not the other wall, which is behind it.
        let camera = Camera::looking(DVec3::new(-1.0, 2.0, 0.0), -DVec3::Y, 2.0, DVec3::Z);
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.15);
        let mirrors = [Mirror { position: DVec3::new(-0.6, 1.0, 0.3), ..mirror }];
        let (edge, size) = (64_u32, [160, 160]);
        let mut shares = Vec::new();
        for (completion, step) in
            [(ScreenCompletion::None, 0), (ScreenCompletion::Nearest, 0), (ScreenCompletion::Repeat, 16)]
        {
            let mut settings = Settings::default();
            settings.reflection.method = Method::ScreenTrace;
            settings.gi.bounces = 0;
            (settings.screen_trace.box_from, settings.screen_trace.box_size) = (ScreenBox::Picture, edge);
            settings.screen_trace.completion = completion;
            let objects = Objects { mirrors: &mirrors, ..Objects::default() };
            renderer.render(&store, &Frame::new(&camera, &settings, objects, size)).unwrap();
            let walls = renderer.reflections.as_ref().unwrap().methods.screen.walls.as_ref().unwrap();
            let read = |buffer: &wgpu::Buffer| gpu.read_buffer(buffer, 0, buffer.size()).unwrap();
            let texels: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&read(&walls.texels));
            if let Some(Completion { periods, .. }) = &walls.completion {
                let periods: Vec<u32> = bytemuck::pod_collect_to_vec(&read(periods));
                println!("{completion:?}: {periods:?}");
                assert_eq!(periods[2..4], [step; 2], "{periods:?}");
            }
            let frame = renderer.camera.unwrap();
            let (mut told, mut right, mut filled, mut all) = (0, 0, 0, 0);
            for (index, [pixel, known]) in texels.iter().enumerate() {
                let (wall, texel) = (index as u32 / (edge * edge), index as u32 % (edge * edge));
                if wall != 1 {
                    assert_eq!(*known, 0, "wall {wall} is not seen");
                    continue;
                }
                // On this wall the z axis points right, and the x axis up.
                let place = |at: u32| (f64::from(at) + 0.5) / f64::from(edge) * 4.0 - 2.0;
                let Some(expected) = is_bright(-place(texel / edge), place(texel % edge)) else { continue };
                all += 1;
                if *known == 0 {
                    continue;
                }
                filled += u32::from(*known == 1);
                assert!(*pixel < size[0] * size[1]);
                let (x, y) = (f64::from(pixel % size[0]) + 0.5, f64::from(pixel / size[0]) + 0.5);
                let shown = frame.world_from_pixel(x, y, 2.0);
                if let Some(shown) = is_bright(shown.x, shown.z) {
                    told += 1;
                    right += u32::from(shown == expected);
                }
            }
            let share = |part: u32, whole: u32| f64::from(part) / f64::from(whole);
            println!("{completion:?}: {told} of {all} told, {filled} filled, {right} right");
            shares.push((share(told, all), share(right, told)));
            assert!(completion == ScreenCompletion::None || filled > all / 3, "{completion:?}: {filled} of {all}");
        }
        let [(seen, seen_right), (_, nearest_right), (told, right)] = shares[..] else { panic!("{shares:?}") };
        assert!(seen < 0.6 && seen_right > 0.98, "{shares:?}");
        assert!(told > 0.9 && right > 0.97 && nearest_right < 0.9, "{shares:?}");
    }

    #[test]
    fn a_wall_shows_what_is_beside_it_within_its_picture() {
        let bounds = Bounds { min: DVec3::new(3.0, -2.0, 700.0), max: DVec3::new(5.0, 3.0, 701.0) };
        for wall in 0..6 {
            let camera = camera_of(bounds, wall, 0.25, 64);
            let axis = wall % 3;
            let mut place = bounds.center() + DVec3::new(0.3, -0.7, 0.2);
            place[axis] = if wall < 3 { bounds.max[axis] - 0.1 } else { bounds.min[axis] + 0.1 };
            let view = camera.view_from_world * (place - camera.eye);
            assert!((view.z - 0.15).abs() < 1e-9, "{wall}: {view}");
            // As shaders/shared/screen_box.wgsl has it.
            let offset = place - bounds.center();
            let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
            let scale = 64.0 / bounds.size()[right].max(bounds.size()[up]);
            let [x, y] = [32.0 + scale * offset[right], 32.0 - scale * offset[up]];
            let seen = camera.world_from_pixel(x, y, view.z);
            assert!(seen.distance(place) < 1e-9, "{wall}: {seen}, not {place}");
        }
    }
}
