//! Pictures of six faces of the points around mirrors: how they are drawn, for `cubemap_trace` and `light_field`, and how
//! those of `cubemap_trace` follow points that come and go.

use std::collections::VecDeque;
use std::num::NonZeroU64;
use std::sync::Arc;

use cloud::Bounds;
use glam::DVec3;
use scene::{MirrorSurface, Quality, Settings, Splat};

use super::environment_map::face_camera;
use super::mirror_places::{MirrorPlace, map_bytes};
use super::surfel_index::SurfelIndex;
use super::task::Task;
use crate::frame::FrameCamera;
use crate::gpu::Result;
use crate::identities::{CloudId, Identities};
use crate::inputs::Inputs;
use crate::layout::{CUBE_CELL_BYTES, CUBE_TEXEL_BYTES, CubeLevel, Cubes, NEAREST_BYTES};
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::store::draw_list::{DrawList, Selection};
use crate::targets::storage;

/// The number of maps that stand, and of those that were asked for: fewer stand where they do not fit into one binding
/// of the adapter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MapCount {
    pub drawn: u32,
    pub asked: u32,
}

/// The maps that stand.
pub struct Maps {
    pub drawn: Drawn,
    /// The middle of each map.
    pub places: Vec<DVec3>,
    pub records: wgpu::Buffer,
    pub bounds: wgpu::Buffer,
    /// The identities of the points in `records`.
    identities: Arc<Identities>,
    /// How many maps were asked for.
    pub asked: u32,
    /// The faces that lack the newest points, each as six times its map's number, plus its own; the first is drawn
    /// next.
    pub stale: VecDeque<usize>,
}

/// The inputs of the maps.
#[derive(Clone, PartialEq)]
pub struct Drawn {
    pub revision: u64,
    pub splat: Splat,
    pub surface: MirrorSurface,
    pub size: u32,
    /// For each map, the cloud that it does not show, and the two places where it may stand.
    pub wanted: Vec<(Option<CloudId>, [DVec3; 2])>,
}

/// The sizes of the parts of a map, in elements.
pub struct Layout {
    pub size: u32,
    padded_size: u32,
    pub texels_of_face: u32,
    cells_of_face: u32,
    levels: u32,
}

impl Layout {
    pub fn new(size: u32) -> Self {
        let padded_size = size.next_power_of_two();
        Self {
            size,
            padded_size,
            // Bindings must start at a multiple of 256 bytes.
            texels_of_face: (size * size).next_multiple_of(256 / CUBE_TEXEL_BYTES as u32),
            cells_of_face: (padded_size * padded_size - 1) / 3,
            levels: padded_size.ilog2(),
        }
    }

    pub fn record_bytes(&self) -> u64 {
        6 * u64::from(self.texels_of_face) * CUBE_TEXEL_BYTES
    }

    /// A bit for each texel.
    pub fn listed_bytes(&self) -> u64 {
        6 * u64::from(self.texels_of_face) / 8
    }

    fn bounds_bytes(&self) -> u64 {
        6 * u64::from(self.cells_of_face) * CUBE_CELL_BYTES
    }
}

/// The size by which distances from a mirror are measured: half of its longest edge.
pub fn radius_of(bounds: &Bounds) -> f64 {
    0.5 * bounds.size().max_element()
}

/// Uploads where the maps are.
pub fn upload_cubes(recorder: &Recorder<'_>, layout: &Layout, places: &[DVec3], eye: DVec3, lag: bool) -> wgpu::Buffer {
    let head = Cubes {
        size: layout.size,
        padded_size: layout.padded_size,
        texels_of_face: layout.texels_of_face,
        levels: layout.levels,
        maps: places.len() as u32,
        lag: u32::from(lag),
        ..Cubes::default()
    };
    // The buffer must not be empty.
    let first = if places.is_empty() { vec![eye] } else { places.to_vec() };
    let relative: Vec<glam::Vec4> = first.iter().map(|place| (*place - eye).as_vec3().extend(0.0)).collect();
    let bytes = [bytemuck::bytes_of(&head), bytemuck::cast_slice(&relative)].concat();
    let buffer = storage(&recorder.gpu.device, "cubemaps", bytes.len() as u64);
    recorder.gpu.queue.write_buffer(&buffer, 0, &bytes);
    buffer
}

/// The splats of maps, which do not depend on the picture's quality: that changes whenever the camera begins to move. One
/// point in `step` is drawn, and larger splats cover as much as all would.
pub fn splat_of_maps(settings: &Settings, step: u32) -> Splat {
    let size = settings.splat.size * (step as f32).sqrt();
    Splat { quality: Quality::Nearest, step, size, ..settings.splat.clone() }
}

/// The splats with which maps are drawn: those of the task, or those that `kept` maps are of if these show all points.
pub fn splat_of_task(task: &Task<'_>, kept: Option<&Splat>) -> Splat {
    let whole = splat_of_maps(task.settings, 1);
    if kept == Some(&whole) { whole } else { splat_of_maps(task.settings, task.supply.step) }
}

/// The splats with which the maps of a task are drawn, and the texels along an edge of a face, of which `size` are asked
/// for: those of the task, or those that `kept` maps are of if these show all points on all texels.
pub fn grain_of_task(task: &Task<'_>, size: u32, kept: Option<(&Splat, u32)>) -> (Splat, u32) {
    let whole = splat_of_maps(task.settings, 1);
    if kept == Some((&whole, size)) {
        return (whole, size);
    }
    let step = task.supply.step;
    (splat_of_maps(task.settings, step), edge_of_maps(size, step))
}

/// The texels along an edge of a face of maps of one point in `step`, where maps of all points have `size`: there are as
/// many texels for each point, as far as a quarter of the edge is left. Texels cost maps as much as points do.
fn edge_of_maps(size: u32, step: u32) -> u32 {
    let edge = f64::from(size) / f64::from(step.max(1)).sqrt();
    (edge.ceil() as u32).max(size.div_ceil(4))
}

/// The points that a map's camera sees.
pub fn draw_list(task: &Task<'_>, camera: &FrameCamera, settings: &Settings, without: Option<CloudId>) -> DrawList {
    let selection = without.map_or(Selection::Seen, Selection::SeenBesides);
    let mut list = task.store.draw_list(camera, settings, selection);
    list.thin(settings.splat.step);
    list
}

/// What faces are drawn with.
pub struct Pen<'a> {
    task: &'a Task<'a>,
    layout: &'a Layout,
    settings: Settings,
    /// The trees through which the rays of texels are traced, where faces are not drawn.
    trees: Option<&'a mut SurfelIndex>,
    /// The nearest points of the texels of the six faces of a map.
    nearest: wgpu::Buffer,
}

/// Where a map is drawn: its number among those of a buffer of records.
#[derive(Clone, Copy)]
pub struct MapRoom<'a> {
    pub records: &'a wgpu::Buffer,
    pub map: usize,
}

impl<'a> Pen<'a> {
    pub fn new(
        recorder: &Recorder<'_>,
        task: &'a Task<'a>,
        layout: &'a Layout,
        splat: &Splat,
        trees: Option<&'a mut SurfelIndex>,
    ) -> Self {
        let settings = Settings { splat: splat.clone(), ..task.settings.clone() };
        let bytes = 6 * map_bytes([layout.size; 2]);
        let nearest = storage(&recorder.gpu.device, "nearest of a cubemap", bytes);
        Self { task, layout, settings, trees, nearest }
    }

    /// Draws a map at the first of two places, or at the second if less than half of the mirror is seen from the first,
    /// because that may stand in a wall, and more from the second. Returns its place. `cloud` is not shown.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn draw_map(
        &mut self,
        recorder: &mut Recorder<'_>,
        room: MapRoom<'_>,
        wanted: [DVec3; 2],
        mirror: &MirrorPlace,
        cloud: Option<CloudId>,
    ) -> Result<DVec3> {
        let (nearest, size) = (self.nearest.clone(), self.layout.size);
        let mut draw_at = |recorder: &mut Recorder<'_>, place: DVec3| -> Result<()> {
            (0..6).try_for_each(|face| self.draw_face(recorder, room, face, place, mirror, cloud))
        };
        let seen = |recorder: &mut Recorder<'_>, place| -> Result<f64> {
            let Some(bytes) = recorder.read(&nearest)? else { return Ok(1.0) };
            Ok(share_seen(&mirror.samples, place, size, &bytes))
        };
        draw_at(recorder, wanted[0])?;
        if wanted[0] == wanted[1] {
            return Ok(wanted[0]);
        }
        let here = seen(recorder, wanted[0])?;
        if here >= 0.5 {
            return Ok(wanted[0]);
        }
        draw_at(recorder, wanted[1])?;
        if seen(recorder, wanted[1])? > here {
            return Ok(wanted[1]);
        }
        draw_at(recorder, wanted[0])?;
        Ok(wanted[0])
    }

    /// Draws a face of a map at `place`: the nearest point of each texel, then the records. `cloud` is not shown.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn draw_face(
        &mut self,
        recorder: &mut Recorder<'_>,
        MapRoom { records, map }: MapRoom<'_>,
        face: usize,
        place: DVec3,
        mirror: &MirrorPlace,
        cloud: Option<CloudId>,
    ) -> Result<()> {
        let Self { task, layout, settings, trees, nearest } = self;
        let camera = face_camera(place, radius_of(&mirror.bounds), face, layout.size);
        let list = draw_list(task, &camera, settings, cloud);
        let inputs = Inputs::new(recorder.gpu, camera, settings, &list);
        let part = |buffer, offset, bytes| {
            let size = NonZeroU64::new(bytes);
            wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
        };
        let face_bytes = map_bytes([layout.size; 2]);
        let first = face_bytes * face as u64;
        recorder.clear_part(nearest, first..first + face_bytes);
        let nearest = part(nearest, first, face_bytes);
        if let Some(trees) = trees {
            trace_face(recorder, trees, task, &inputs, nearest.clone())?;
        } else {
            let atomics64 = recorder.gpu.has_wide_atomics(&settings.splat);
            recorder.nearest_points(&[], &inputs, nearest.clone(), atomics64)?;
        }
        let record_bytes = layout.record_bytes() / 6;
        let records = part(records, record_bytes * (6 * map + face) as u64, record_bytes);
        let bindings = passes::cube_planes { nearest, records };
        recorder.over_page_pixels(&inputs, bindings, inputs.pixel_groups())
    }
}

/// Finds the nearest discs on the lines of sight of a face.
fn trace_face(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    task: &Task<'_>,
    face: &Inputs,
    nearest_points: wgpu::BindingResource<'_>,
) -> Result<()> {
    let trees = index.update(recorder, task.store, face, &face.chunks, task.settings.splat.size)?;
    for tree in &trees {
        let Some(page) = index.page(tree.page) else { continue };
        let Some(inputs) = face.pages.iter().find(|inputs| inputs.number == tree.page) else { continue };
        let bindings = passes::light_field_trace {
            tops: tree.tops.as_entire_binding(),
            nodes: page.nodes.as_entire_binding(),
            surfels: page.surfels.as_entire_binding(),
            order: page.order.as_entire_binding(),
            shown: inputs.bind_shown(),
            nearest_points: nearest_points.clone(),
        };
        let switches = [("hides_points", u32::from(face.hides_points))];
        recorder.by_rows(&switches, face, bindings, face.pixel_groups())?;
    }
    Ok(())
}

/// Draws the maps. `mirrors` has the mirror of each map.
pub fn draw(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    layout: &Layout,
    drawn: Drawn,
    mirrors: &[&MirrorPlace],
) -> Result<Maps> {
    recorder.time_as(Some(("cubemaps", PassStage::Method)));
    let device = &recorder.gpu.device;
    let count = drawn.wanted.len().max(1) as u64;
    let records = storage(device, "cubemap records", layout.record_bytes() * count);
    let bounds = storage(device, "cubemap bounds", layout.bounds_bytes() * count);
    let mut pen = Pen::new(recorder, task, layout, &drawn.splat, None);
    let mut places = Vec::new();
    for (map, (cloud, wanted)) in drawn.wanted.iter().enumerate() {
        let room = MapRoom { records: &records, map };
        places.push(pen.draw_map(recorder, room, *wanted, mirrors[map], *cloud)?);
    }
    let identities = task.store.identities().clone();
    let maps = Maps { drawn, places, records, bounds, identities, asked: 0, stale: VecDeque::new() };
    bound(recorder, task, layout, &maps)?;
    recorder.time_as(None);
    Ok(maps)
}

/// Draws some faces for points that came or went, which all faces lack if `drawn` has another revision. Maps keep their
/// sides of the mirror.
pub fn catch_up(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    layout: &Layout,
    maps: &mut Maps,
    drawn: Drawn,
    mirrors: &[&MirrorPlace],
) -> Result<()> {
    if maps.drawn != drawn {
        let fresh: Vec<usize> = (0..6 * maps.places.len()).filter(|face| !maps.stale.contains(face)).collect();
        maps.stale.extend(fresh);
        maps.drawn = drawn;
    }
    recorder.time_as(Some(("cubemaps", PassStage::Method)));
    renumber(recorder, task, &mut maps.identities, [&maps.records])?;
    let mut pen = Pen::new(recorder, task, layout, &maps.drawn.splat, None);
    let count = maps.stale.len().min(task.settings.cubemap_trace.faces_per_frame as usize);
    for face in maps.stale.drain(..count) {
        let map = face / 6;
        let room = MapRoom { records: &maps.records, map };
        pen.draw_face(recorder, room, face % 6, maps.places[map], mirrors[map], maps.drawn.wanted[map].0)?;
    }
    bound(recorder, task, layout, maps)?;
    recorder.time_as(None);
    Ok(())
}

/// Gives the points of maps the identities that they have now; `before` are those that they had.
///
/// # Errors
/// A shader is refused.
pub fn renumber<'r>(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    before: &mut Arc<Identities>,
    records: impl IntoIterator<Item = &'r wgpu::Buffer>,
) -> Result<()> {
    let identities = task.store.identities();
    let runs = before.runs_in(identities);
    *before = identities.clone();
    if runs.iter().zip(0..).all(|(now, before)| *now == before) {
        return Ok(());
    }
    let buffer = storage(&recorder.gpu.device, "runs of identities", 4 * runs.len() as u64);
    recorder.gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&runs));
    for records in records {
        let bindings = passes::cube_renumber { runs: buffer.as_entire_binding(), records: records.as_entire_binding() };
        let groups = (records.size() / CUBE_TEXEL_BYTES).div_ceil(64) as u32;
        let columns = groups.min(1024);
        recorder.over(&[], task.supply, bindings, [columns, groups.div_ceil(columns), 1])?;
    }
    Ok(())
}

/// Makes the bounds of all maps.
fn bound(recorder: &mut Recorder<'_>, task: &Task<'_>, layout: &Layout, maps: &Maps) -> Result<()> {
    // The directions of the faces do not depend on the places.
    let cubes = upload_cubes(recorder, layout, &maps.places, DVec3::ZERO, false);
    for level in 1..=layout.levels {
        let work = CubeLevel { level, ..CubeLevel::default() };
        let buffer = storage(&recorder.gpu.device, "level of cubemaps", size_of::<CubeLevel>() as u64);
        recorder.gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&work));
        let bindings = passes::cube_bounds {
            cubes: cubes.as_entire_binding(),
            records: maps.records.as_entire_binding(),
            bounds: maps.bounds.as_entire_binding(),
            work: buffer.as_entire_binding(),
        };
        let groups = layout.size.div_ceil(1 << level).div_ceil(8);
        let switches = [("from_texels", u32::from(level == 1))];
        recorder.over(&switches, task.supply, bindings, [groups, groups, 6 * maps.places.len() as u32])?;
    }
    Ok(())
}

/// The share of a mirror's samples that a map at `place` sees; `nearest` holds the nearest points of its texels.
fn share_seen(samples: &[(DVec3, DVec3)], place: DVec3, size: u32, nearest: &[u8]) -> f64 {
    let words: &[[u32; 2]] = bytemuck::cast_slice(nearest);
    let face_texels = map_bytes([size; 2]) / NEAREST_BYTES;
    let is_seen = |(sample, _): &&(DVec3, DVec3)| {
        let offset = *sample - place;
        let largest = (0..3).fold(0, |a, b| if offset[b].abs() > offset[a].abs() { b } else { a });
        let face = largest + if offset[largest] > 0.0 { 0 } else { 3 };
        let depth = offset[largest].abs();
        let slopes = [1, 2].map(|after| offset[(largest + after) % 3] / depth);
        let texel = |slope: f64| ((0.5 * f64::from(size) * (1.0 + slope)) as u32).min(size - 1);
        let [x, y] = [texel(slopes[0]), texel(-slopes[1])];
        let [_, nearness] = words[(face_texels * face as u64) as usize + (y * size + x) as usize];
        nearness == 0 || f64::from(f32::from_bits(u32::MAX - nearness)) > 0.95 * depth
    };
    samples.iter().filter(is_seen).count() as f64 / samples.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_sees_the_samples_before_which_nothing_stands() {
        let line: Vec<(DVec3, DVec3)> = (1..11).map(|i| (DVec3::X * f64::from(i), DVec3::Z)).collect();
        let size = 16;
        let empty = vec![0_u8; (6 * map_bytes([size; 2])) as usize];
        assert_eq!(share_seen(&line, DVec3::ZERO, size, &empty), 1.0);
        // Something stands halfway in each direction.
        let half = (u32::MAX - 0.5_f32.to_bits()).to_le_bytes();
        let texels = empty.len() / 8;
        let full: Vec<u8> = (0..texels).flat_map(|_| [[0; 4], half].concat()).collect();
        assert_eq!(share_seen(&line, DVec3::ZERO, size, &full), 0.0);
    }
}
