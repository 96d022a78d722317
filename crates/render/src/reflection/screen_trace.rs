//! Screen-space tracing (after Johnsson 2012, whose rays march through the camera's picture): reflected rays walk
//! through the depths of what the camera sees, mirrors included. What the picture cannot tell is left to another
//! method, from where a ray is known to be free. docs/methods/screen_trace.md has the rules.

use std::num::NonZeroU64;

use scene::{ScreenBack, ScreenCriterion, ScreenRest, Settings};

use super::cubemap_trace::CubemapTrace;
use super::environment_map::EnvironmentMap;
use super::gather::{Gather, rest_list};
use super::screen_box::{Walls, corners};
use super::surfel_index::SurfelIndex;
use super::surfel_trace::{self, Rays};
use super::task::Task;
use crate::gpu::{Error, Result};
use crate::layout::{NEAREST_BYTES, SCREEN_CELL_BYTES, SCREEN_TEXEL_BYTES, Screen};
use crate::passes;
use crate::recorder::{Recorder, two_runs};
use crate::store::PointStore;
use crate::targets::storage;

/// The picture as rays walk through it. The first bounce of a frame makes it, and all bounces use it.
#[derive(Default)]
pub(crate) struct ScreenTrace {
    picture: Option<Picture>,
    /// The rays that the picture does not resolve.
    rest: Option<wgpu::Buffer>,
    /// What rays meet that leave the picture.
    pub(super) walls: Option<Walls>,
}

struct Picture {
    size: [u32; 2],
    has_back: bool,
    /// A record for each pixel of each layer, see shaders/shared/depth_texel.wgsl.
    records: wgpu::Buffer,
    /// The nearest points of the layer behind, if there is one.
    nearest: Option<wgpu::Buffer>,
    bounds: wgpu::Buffer,
}

impl Picture {
    fn new(device: &wgpu::Device, size: [u32; 2], has_back: bool) -> Self {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let layer_bytes = layer_bytes(size);
        let cells = first_cells(size).last().copied().unwrap_or(0);
        Self {
            size,
            has_back,
            records: storage(device, "records of the picture", layer_bytes * if has_back { 2 } else { 1 }),
            nearest: has_back.then(|| storage(device, "nearest behind the picture", pixels * NEAREST_BYTES)),
            bounds: storage(device, "bounds of the picture", u64::from(cells) * SCREEN_CELL_BYTES),
        }
    }

    /// Fills it with what the camera sees.
    fn fill(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        let bindings = passes::screen_planes {
            normal_in: task.camera.normal.bind(),
            position_in: task.camera.position.bind(),
            records: self.records.as_entire_binding(),
            albedo_in: task.camera.albedo.bind(),
        };
        let is_continued =
            matches!(task.settings.screen_trace.rest, ScreenRest::SurfelTrace | ScreenRest::CubemapTrace);
        recorder.over_pixels(&[("is_continued", u32::from(is_continued))], task.supply, bindings)?;
        for level in 1..=levels(self.size) {
            let screen = upload(recorder, task, level);
            let bindings = passes::screen_bounds {
                screen: screen.as_entire_binding(),
                records: self.records.as_entire_binding(),
                bounds: self.bounds.as_entire_binding(),
            };
            let [x, y] = self.size.map(|edge| edge.div_ceil(1 << level).div_ceil(8));
            recorder.over(&[("from_texels", u32::from(level == 1))], task.supply, bindings, [x, y, 1])?;
        }
        self.fill_back(recorder, task)
    }

    /// Fills the layer behind, if there is one.
    fn fill_back(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        let Some(nearest) = &self.nearest else { return Ok(()) };
        recorder.clear(nearest);
        let part = |first: u64| {
            let (buffer, size) = (&self.records, NonZeroU64::new(layer_bytes(self.size)));
            wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: first, size })
        };
        for run in two_runs(recorder.gpu) {
            let (nearest, run) = (nearest.as_entire_binding(), run.as_entire_binding());
            recorder.over_points(&[], task.supply, passes::splat_behind { records: part(0), nearest, run })?;
        }
        let records = part(layer_bytes(self.size));
        let bindings = passes::cube_planes { nearest: nearest.as_entire_binding(), records };
        recorder.over_page_pixels(task.supply, bindings, task.supply.pixel_groups())
    }
}

impl ScreenTrace {
    pub fn bytes(&self) -> u64 {
        let picture = self
            .picture
            .iter()
            .flat_map(|picture| [&picture.records, &picture.bounds].into_iter().chain(&picture.nearest));
        picture.chain(&self.rest).map(wgpu::Buffer::size).sum::<u64>() + self.walls.as_ref().map_or(0, Walls::bytes)
    }

    /// Finds what the rays of a bounce meet.
    ///
    /// # Errors
    /// A shader is refused, there is no memory for the index, or the criterion asks for a layer that is not drawn.
    pub fn search(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        cubemaps: &mut CubemapTrace,
        gather: &Gather,
        task: &Task<'_>,
    ) -> Result<()> {
        let size = task.supply.size;
        let has_back = task.settings.screen_trace.back != ScreenBack::None;
        if task.settings.screen_trace.criterion == ScreenCriterion::Layers && !has_back {
            return Err(Error::NoSecondLayer);
        }
        let kept = self.picture.take().filter(|picture| picture.size == size && picture.has_back == has_back);
        let picture = kept.unwrap_or_else(|| Picture::new(&recorder.gpu.device, size, has_back));
        let picture = self.picture.insert(picture);
        if task.bounce == 0 {
            picture.fill(recorder, task)?;
        }
        recorder.clear(&gather.hits);
        let rest = rest_list(recorder, &mut self.rest, size);
        let screen = upload(recorder, task, 0);
        let walls = self.walls.take().filter(|walls| walls.are_for(task.settings));
        let walls = self.walls.insert(walls.unwrap_or_else(|| Walls::new(&recorder.gpu.device, task.settings)));
        if task.bounce == 0 {
            walls.fill(recorder, task, &screen)?;
        }
        let bindings = passes::screen_trace {
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            screen: screen.as_entire_binding(),
            records: picture.records.as_entire_binding(),
            bounds: picture.bounds.as_entire_binding(),
            hits: gather.hits.as_entire_binding(),
            rest: rest.as_entire_binding(),
            views_out: gather.views.bind(),
            counters: task.counters.as_entire_binding(),
            walls: walls.texels.as_entire_binding(),
        };
        let counts = [("counts", u32::from(task.bounce == 0))];
        recorder.by_rows(&counts, task.supply, bindings, task.supply.mirror_groups())?;
        match task.settings.screen_trace.rest {
            ScreenRest::SurfelTrace => {
                surfel_trace::trace(recorder, index, gather, task, &task.supply.chunks, Rays::Listed(rest))?;
            }
            ScreenRest::CubemapTrace => cubemaps.trace(recorder, index, gather, task, Some(rest))?,
            ScreenRest::None | ScreenRest::EnvironmentMap => {}
        }
        Ok(())
    }

    /// Fills the Mirror G-Buffer from the hits, and from the environment maps where they take the rest.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn resolve(
        recorder: &mut Recorder<'_>,
        environment: &mut EnvironmentMap,
        gather: &Gather,
        task: &Task<'_>,
    ) -> Result<()> {
        gather.complete(recorder, task, |recorder, found| {
            let [albedo_out, normal_out, position_out] = found.bind();
            let bindings = passes::screen_resolve {
                point_in: task.mirror.point.bind(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
                hits: gather.hits.as_entire_binding(),
                picture_albedo_in: task.camera.albedo.bind(),
                picture_normal_in: task.camera.normal.bind(),
                albedo_out,
                normal_out,
                position_out,
            };
            recorder.over_mirrors(&[], task.supply, bindings)?;
            gather.resolve_points(recorder, task, found.bind())?;
            if task.settings.screen_trace.rest == ScreenRest::EnvironmentMap {
                environment.fill(recorder, gather, task, found, true)?;
            }
            Ok(())
        })
    }
}

/// The room of a layer of records: bindings must start at a multiple of 256 bytes.
fn layer_bytes(size: [u32; 2]) -> u64 {
    (u64::from(size[0]) * u64::from(size[1]) * SCREEN_TEXEL_BYTES).next_multiple_of(256)
}

/// The number of levels of bounds, of which the last has one cell.
fn levels(size: [u32; 2]) -> u32 {
    size[0].max(size[1]).next_power_of_two().ilog2()
}

/// The first cell of each level of bounds, from level 1 on, and the end of the last one.
fn first_cells(size: [u32; 2]) -> Vec<u32> {
    let cells = |level: u32| size.map(|edge| edge.div_ceil(1 << level)).iter().product::<u32>();
    let ends = (1..=levels(size)).scan(0, |end, level| {
        *end += cells(level);
        Some(*end)
    });
    std::iter::once(0).chain(ends).collect()
}

/// Uploads how the picture is laid out, for the pass that makes a level.
fn upload(recorder: &Recorder<'_>, task: &Task<'_>, level: u32) -> wgpu::Buffer {
    let size = task.supply.size;
    let mirror_radius = largest_radius(task.store, task.settings);
    let texels_of_layer = (layer_bytes(size) / SCREEN_TEXEL_BYTES) as u32;
    let [box_low, box_high] = corners(task.store.bounds(), task.supply.camera.eye);
    let head = Screen { levels: levels(size), level, mirror_radius, texels_of_layer, box_low, box_high };
    let mut bytes = [bytemuck::bytes_of(&head), bytemuck::cast_slice(&first_cells(size))].concat();
    // A struct with corners in it takes multiples of 16 bytes.
    bytes.resize(bytes.len().next_multiple_of(16), 0);
    let buffer = storage(&recorder.gpu.device, "levels of the picture", bytes.len() as u64);
    recorder.gpu.queue.write_buffer(&buffer, 0, &bytes);
    buffer
}

/// The largest radius of a mirror's splats in world units; 0 for mirrors that are drawn by their formula.
fn largest_radius(store: &PointStore, settings: &Settings) -> f32 {
    let chunks = store.mirror_clouds(settings).into_values().flatten();
    let radius = chunks.filter_map(|chunk| store.placed(chunk)).map(|chunk| chunk.largest_radius);
    radius.fold(0.0, f32::max) * settings.splat.size
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use glam::{DVec3, Vec3};
    use scene::{Camera, Method, Mirror, Projection, ScreenSampling, Shape};

    use super::super::cubemap_trace::tests::{furnished, vectors};
    use super::super::depth_walk::{Answer, Choices, Picture, Ray, View, texel_of};
    use super::super::screen_walk::{Layers, Rule};
    use super::*;
    use crate::frame::Objects;
    use crate::gpu::Gpu;
    use crate::renderer::{Frame, Renderer};

    fn settings() -> Settings {
        let mut settings = Settings::default();
        settings.reflection.method = Method::ScreenTrace;
        settings.gi.bounces = 0;
        settings
    }

    fn vector(part: &[f32; 4]) -> Vec3 {
        Vec3::new(part[0], part[1], part[2])
    }

    #[test]
    fn levels_end_with_one_cell() {
        assert_eq!(first_cells([5, 3]), [0, 6, 8, 9]);
        assert_eq!(first_cells([1, 1]), [0]);
        assert_eq!(first_cells([1, 2]), [0, 1]);
    }

    #[test]
    fn the_gpu_walks_as_its_twin_does() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        // A parallel view has its eye outside of the room.
        let stores = [true, false].map(|has_walls| furnished(&gpu, has_walls));
        let of_room = Camera::looking(DVec3::new(0.2, 0.2, 0.0), DVec3::new(0.3, -1.0, 0.2), 1.7, DVec3::Z);
        let (perspective, parallel) = (Projection::Perspective, Projection::Orthographic);
        let (plane, thickness) = (ScreenCriterion::Plane, ScreenCriterion::Thickness);
        let cases = [
            ([96, 80], 60.0, true, perspective, plane, ScreenBack::None),
            ([101, 67], 100.0, false, perspective, plane, ScreenBack::None),
            ([160, 120], 150.0, true, perspective, plane, ScreenBack::None),
            ([90, 90], 60.0, true, parallel, plane, ScreenBack::None),
            ([96, 80], 60.0, false, perspective, plane, ScreenBack::Peeled),
            ([101, 67], 100.0, false, perspective, plane, ScreenBack::Culled),
            ([90, 90], 60.0, false, parallel, plane, ScreenBack::Peeled),
            ([96, 80], 60.0, true, perspective, ScreenCriterion::Behind, ScreenBack::None),
            ([101, 67], 100.0, true, perspective, thickness, ScreenBack::None),
            ([90, 90], 60.0, true, parallel, thickness, ScreenBack::None),
            ([96, 80], 60.0, true, perspective, ScreenCriterion::Layers, ScreenBack::Culled),
            ([90, 90], 60.0, true, parallel, ScreenCriterion::Layers, ScreenBack::Peeled),
        ];
        let (mut kinds, mut in_back) = ([0; 3], 0);
        for (picture, field_of_view, skip, projection, criterion, back) in cases {
            let store = &stores[usize::from(projection == Projection::Orthographic)];
            let mut settings = settings();
            (settings.view.field_of_view, settings.view.projection) = (field_of_view, projection);
            (settings.screen_trace.skip, settings.screen_trace.rest) = (skip, ScreenRest::None);
            (settings.screen_trace.criterion, settings.screen_trace.back) = (criterion, back);
            let stats = renderer.render(store, &Frame::new(&of_room, &settings, Objects::default(), picture)).unwrap();
            let reflections = renderer.reflections.as_ref().unwrap();
            let screen = &reflections.methods.screen;
            let records = &screen.picture.as_ref().unwrap().records;
            let records: Vec<[u32; 4]> =
                bytemuck::pod_collect_to_vec(&gpu.read_buffer(records, 0, records.size()).unwrap());
            let frame = renderer.camera.unwrap().to_gpu();
            let view = View {
                center: Vec3::ZERO,
                right: frame.right.truncate(),
                up: frame.up.truncate(),
                forward: frame.forward.truncate(),
                size: picture,
                focal: frame.focal_pixels,
                is_parallel: frame.orthographic != 0,
            };
            let pixels = (picture[0] * picture[1]) as usize;
            let layer = |first: usize| {
                Picture::new(view, records[first..][..pixels].iter().map(|record| texel_of(*record)).collect())
            };
            let layers = Layers {
                front: layer(0),
                back: (back != ScreenBack::None).then(|| layer((layer_bytes(picture) / SCREEN_TEXEL_BYTES) as usize)),
                hides_more: back == ScreenBack::Culled,
            };
            let rule = match criterion {
                ScreenCriterion::Plane => Rule::Plane,
                ScreenCriterion::Behind => Rule::Behind,
                ScreenCriterion::Thickness => Rule::Thickness(settings.screen_trace.thickness * frame.scene_radius),
                ScreenCriterion::Layers => Rule::Layers,
            };
            let choices = Choices { skip, jump: 1.0, disc_slack: 1e9, most_cells: 8192, ..Choices::DEFAULT };
            let radius = largest_radius(store, &settings);
            assert!(radius > 0.0);

            let bounce = reflections.first().unwrap();
            let targets = renderer.targets.as_ref().unwrap();
            let normals = vectors(&gpu, &targets.surface().normal);
            let [points, eyes] = [&bounce.mirror.point, &bounce.mirror.eye].map(|image| vectors(&gpu, image));
            let hits = &reflections.methods.gather.as_ref().unwrap().hits;
            let hits: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&gpu.read_buffer(hits, 0, hits.size()).unwrap());
            let rest = screen.rest.as_ref().unwrap();
            let rest: Vec<u32> = bytemuck::pod_collect_to_vec(&gpu.read_buffer(rest, 0, rest.size()).unwrap());
            let left: HashMap<u32, f32> =
                rest[1..][..2 * rest[0] as usize].chunks(2).map(|pair| (pair[0], f32::from_bits(pair[1]))).collect();

            let (mut rays, mut apart, mut hidden) = (0_u32, 0_u32, 0_u32);
            for pixel in (0..points.len()).filter(|pixel| points[*pixel][3] > 0.0) {
                let origin = vector(&points[pixel]);
                let direction = (origin - vector(&eyes[pixel])).reflect(vector(&normals[pixel])).normalize();
                let ray = Ray { origin, direction, from: 0.0, to: 1e30 };
                let own = (4.0 * radius).max(2.0 * view.width(view.forward.dot(origin).abs()));
                let found_at = layers.walk(&ray, own, frame.near, rule, choices);
                let walked = found_at.walk;
                let [key, found, distance, cells] = hits[pixel];
                let near = |t: f32, other: f32| (t - other).abs() <= 1e-5 * (1.0 + other);
                let is_same = match walked.answer {
                    Answer::Hit { t, identity } => {
                        let is_in_back = key & 0x7fff_ffff != 0x7fff_ffff;
                        is_in_back == found_at.is_in_back && found == identity + 1 && near(f32::from_bits(distance), t)
                    }
                    Answer::Open => found == 0 && !left.contains_key(&(pixel as u32)),
                    Answer::Hidden(t) => left.get(&(pixel as u32)).is_some_and(|from| near(*from, t)),
                };
                kinds[match walked.answer {
                    Answer::Hit { .. } => 0,
                    Answer::Open => 1,
                    Answer::Hidden(_) => 2,
                }] += 1;
                in_back += u32::from(found_at.is_in_back);
                hidden += u32::from(matches!(walked.answer, Answer::Hidden(_)));
                rays += 1;
                apart += u32::from(!is_same || walked.cells.abs_diff(cells) > 1);
            }
            // Rounding decides for a ray that passes through the corner of a pixel.
            println!("{picture:?} {projection:?} {criterion:?} {back:?}: {apart} of {rays} differ");
            assert!(rays > 60 && apart * 200 <= rays, "{picture:?} {criterion:?} {back:?}: {apart} of {rays} differ");
            let left_over = stats.reflection.unwrap().unresolved.unwrap() * f64::from(rays);
            assert!((left_over - f64::from(hidden)).abs() < f64::from(apart) + 1e-3, "{left_over} {hidden} {rays}");
        }
        assert!(kinds[0] > 500 && kinds[2] > 500 && in_back > 20, "{kinds:?}, {in_back} in the layer behind");
    }

    #[test]
    fn points_at_even_steps_meet_what_intervals_do_and_miss_what_is_shallower_than_a_step() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let store = furnished(&gpu, true);
        let camera = Camera::looking(DVec3::new(0.2, 0.2, 0.0), DVec3::new(0.3, -1.0, 0.2), 1.7, DVec3::Z);
        let mut found = |sampling, stride| {
            let mut settings = settings();
            let chosen = &mut settings.screen_trace;
            (chosen.criterion, chosen.rest) = (ScreenCriterion::Thickness, ScreenRest::None);
            (chosen.sampling, chosen.stride, chosen.thickness) = (sampling, stride, 0.02);
            let stats = renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), [96, 80])).unwrap();
            stats.reflection.unwrap().coverage
        };
        let [intervals, fine, coarse] = [
            found(ScreenSampling::Texel, 0.005),
            found(ScreenSampling::Even, 0.0005),
            found(ScreenSampling::Even, 0.2),
        ];
        assert!((fine - intervals).abs() < 0.05 * intervals, "{fine}, {intervals}");
        assert!(coarse < 0.5 * fine, "{coarse}, {fine}");
    }

    #[test]
    fn layers_without_a_second_layer_are_refused() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let store = furnished(&gpu, true);
        let camera = Camera::looking(DVec3::new(0.2, 0.2, 0.0), DVec3::new(0.3, -1.0, 0.2), 1.7, DVec3::Z);
        let mut settings = settings();
        settings.screen_trace.criterion = ScreenCriterion::Layers;
        let drawn = renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), [32, 32]));
        assert!(matches!(drawn, Err(Error::NoSecondLayer)));
        settings.screen_trace.back = ScreenBack::Culled;
        assert!(renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), [32, 32])).is_ok());
    }

    #[test]
    fn two_plane_mirrors_turn_a_ray_back_but_for_its_part_along_their_edge() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let store = furnished(&gpu, true);
        let plane = |position, normal| Mirror {
            position,
            ..Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, normal, DVec3::Z, 0.5)
        };
        // An upright edge at the origin, far from the store's own mirror.
        let corner = DVec3::new(1.2, -1.2, -1.0);
        let mirrors = [plane(corner + DVec3::Y * 0.5, -DVec3::X), plane(corner - DVec3::X * 0.5, DVec3::Y)];
        let camera =
            Camera::looking(corner - DVec3::X * 0.1 + DVec3::Y * 0.1, DVec3::new(-1.0, 1.2, 0.3), 0.9, DVec3::Z);
        let mut settings = settings();
        settings.reflection.bounces = 2;
        for rest in [ScreenRest::None, ScreenRest::SurfelTrace] {
            settings.screen_trace.rest = rest;
            renderer
                .render(
                    &store,
                    &Frame::new(&camera, &settings, Objects { mirrors: &mirrors, ..Objects::default() }, [96, 96]),
                )
                .unwrap();
            let bounces = &renderer.reflections.as_ref().unwrap().bounces;
            let [points, eyes] = [&bounces[1].mirror.point, &bounces[1].mirror.eye].map(|image| vectors(&gpu, image));
            let seen = vectors(&gpu, &bounces[1].seen.position);
            let (mut turned, mut found) = (0, 0);
            for pixel in (0..points.len()).filter(|pixel| points[*pixel][3] > 0.0) {
                // The mirror points of both reflections, on planes across one another.
                let [first, second] = [&eyes, &points].map(|places| vector(&places[pixel]));
                let on_planes =
                    [first, second].map(|place| (place + renderer.camera.unwrap().eye.as_vec3()) - corner.as_vec3());
                let is_on = |place: Vec3, axis: usize| place[axis].abs() < 1e-4;
                if !(is_on(on_planes[0], 0) && is_on(on_planes[1], 1)
                    || is_on(on_planes[0], 1) && is_on(on_planes[1], 0))
                {
                    continue;
                }
                turned += 1;
                if seen[pixel][3] == 1.0 {
                    found += 1;
                    let direction = (vector(&seen[pixel]) - second).normalize();
                    let incoming = first.normalize();
                    let expected = Vec3::new(-incoming.x, -incoming.y, incoming.z);
                    assert!(direction.distance(expected) < 1e-3, "{direction}, not {expected}");
                }
            }
            assert!(turned > 300, "{turned}");
            // The turned rays go back past the camera.
            assert!(rest == ScreenRest::None || found * 10 > turned * 9, "{found} of {turned}");
        }
    }
}
