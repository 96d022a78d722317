//! Lists the mirrors of a scene, for methods that look at the scene from each of them, and uploads them so that shaders
//! find the mirror on which a place lies.

use cloud::{Bounds, Chunk, ShownPoints, unpack_normal, unpack_radius};
use glam::{DVec3, Vec4};

use scene::{Method, Mirror, Settings};

use super::task::Task;
use crate::gpu::Gpu;
use crate::identities::{ChunkId, CloudId};
use crate::layout::{MappedMirror, MappedMirrors, NEAREST_BYTES};
use crate::store::PointStore;
use crate::targets::storage;

/// The most points that represent a mirror: enough for a mean that is right to a few hundredths of the mirror's size.
const MOST_SAMPLES: usize = 1024;

/// A mirror of the scene.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MirrorPlace {
    /// The cloud of its points; `None` if it is drawn by its formula.
    pub cloud: Option<CloudId>,
    /// The method that it has for itself.
    pub own: Option<Method>,
    /// The bounds of its splats in world coordinates.
    pub bounds: Bounds,
    /// The places and unit normals of some of its points, spread over it.
    pub samples: Vec<(DVec3, DVec3)>,
}

/// All mirrors that reflect and are shown: first the clouds, in their order, then those that are drawn by their
/// formula.
pub(crate) fn mirror_places(task: &Task<'_>) -> Vec<MirrorPlace> {
    let splat_size = f64::from(task.settings.splat.size);
    let of_cloud = |(cloud, ids): (CloudId, Vec<_>)| {
        let placed: Vec<_> = ids.iter().filter_map(|id| task.store.placed(*id)).collect();
        let bounds = placed.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds));
        let radius = placed.iter().map(|chunk| chunk.largest_radius).fold(0.0, f32::max);
        let chunks: Vec<_> = placed.iter().map(|chunk| (chunk.points, chunk.shown)).collect();
        let bounds = widened(bounds, f64::from(radius) * splat_size);
        MirrorPlace { cloud: Some(cloud), own: task.store.own_method(cloud), bounds, samples: samples(&chunks) }
    };
    let mut places: Vec<MirrorPlace> = task.store.mirror_clouds(task.settings).into_iter().map(of_cloud).collect();
    let exact = task.mirrors.iter().filter(|mirror| mirror.is_exact(task.settings.mirror.surface));
    places.extend(exact.filter(|mirror| mirror.specular_intensity > 0.0).map(|mirror| {
        let sampled = mirror.sample(MOST_SAMPLES, 1);
        let bounds = sampled.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
        let radii = sampled.iter().flat_map(|chunk| chunk.radii.iter().flat_map(|radii| radii.iter()));
        let radius = radii.filter_map(|radius| unpack_radius(*radius)).fold(0.0, f32::max);
        let bounds = widened(bounds, f64::from(radius));
        MirrorPlace { cloud: None, own: mirror.method, bounds, samples: samples(&whole(&sampled)) }
    }));
    places
}

/// The mirrors that rays of a task's method may leave: after the first reflection, they may leave every mirror.
pub(crate) fn own_places(task: &Task<'_>) -> Vec<MirrorPlace> {
    let Task { settings, .. } = task;
    let mut places = mirror_places(task);
    if settings.reflection.bounces <= 1 {
        places.retain(|place| settings.reflection.method_of(place.own) == settings.reflection.method.chosen());
    }
    places
}

/// The boxes about the points of all mirrors, in the order of `mirror_places`, in world coordinates.
pub(crate) fn mirror_boxes(store: &PointStore, settings: &Settings, mirrors: &[Mirror]) -> Vec<Bounds> {
    let of_cloud = |ids: Vec<ChunkId>| {
        let placed = ids.iter().filter_map(|id| store.placed(*id));
        placed.fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds))
    };
    let mut boxes: Vec<Bounds> = store.mirror_clouds(settings).into_values().map(of_cloud).collect();
    let exact = mirrors.iter().filter(|mirror| mirror.is_exact(settings.mirror.surface));
    boxes.extend(exact.filter(|mirror| mirror.specular_intensity > 0.0).map(|mirror| {
        let sampled = mirror.sample(MOST_SAMPLES, 1);
        sampled.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()))
    }));
    boxes
}

fn widened(bounds: Bounds, by: f64) -> Bounds {
    Bounds { min: bounds.min - by, max: bounds.max + by }
}

/// Chunks whose points are all shown.
pub(crate) fn whole(chunks: &[Chunk]) -> Vec<(&Chunk, &ShownPoints)> {
    chunks.iter().map(|chunk| (chunk, &ShownPoints::All)).collect()
}

/// At most `MOST_SAMPLES` points, evenly among those of the chunks, without those that are hidden or have no normal.
pub(crate) fn samples(chunks: &[(&Chunk, &ShownPoints)]) -> Vec<(DVec3, DVec3)> {
    let count: usize = chunks.iter().map(|(chunk, _)| chunk.len()).sum();
    let step = count.div_ceil(MOST_SAMPLES).max(1);
    let mut samples = Vec::new();
    let mut next = 0;
    for (chunk, shown) in chunks {
        while next < chunk.len() {
            let normals = chunk.normals.as_ref().filter(|_| shown.has(next));
            let normal = normals.and_then(|normals| unpack_normal(normals[next]));
            samples.extend(normal.map(|normal| (chunk.position(next), normal.as_dvec3())));
            next += step;
        }
        next -= chunk.len();
    }
    samples
}

/// The size in bytes of a picture of texels that are laid out as the camera's `nearest`, such that several may follow
/// one another in a buffer: adapters require that a binding starts at a multiple of 256 bytes, which are 32 texels.
pub(crate) fn map_bytes([width, height]: [u32; 2]) -> u64 {
    (u64::from(width) * u64::from(height)).next_multiple_of(32) * NEAREST_BYTES
}

/// A shader's data of a mirror besides its box: the number of its map and from where, or how, that is seen.
pub(crate) struct MirrorMap {
    pub map: usize,
    pub view: Vec4,
}

/// Uploads the mirrors in the layout of shaders/shared/mirror_places.wgsl, with their maps. `scene` is the box of all
/// points. `map_of` returns a mirror's map by its index in `places`; a mirror without one shows nothing.
pub(crate) fn upload(
    gpu: &Gpu,
    places: &[MirrorPlace],
    scene: Bounds,
    eye: DVec3,
    map_of: impl Fn(usize) -> Option<MirrorMap>,
) -> wgpu::Buffer {
    let relative = |place: DVec3| (place - eye).as_vec3();
    let head =
        MappedMirrors { scene_low: relative(scene.min).extend(0.0), scene_high: relative(scene.max).extend(0.0) };
    let mut mirrors = Vec::new();
    for (index, place) in places.iter().enumerate() {
        let (map, view) = map_of(index).map_or((-1.0, Vec4::ZERO), |map| (map.map as f32, map.view));
        let low_map = relative(place.bounds.min).extend(map);
        mirrors.push(MappedMirror { low_map, high: relative(place.bounds.max).extend(0.0), view });
    }
    if places.is_empty() {
        // The buffer must not be empty, so a mirror without a map fills it.
        mirrors.push(MappedMirror { low_map: Vec4::NEG_ONE, ..Default::default() });
    }
    let bytes = [bytemuck::bytes_of(&head), bytemuck::cast_slice(&mirrors)].concat();
    let buffer = storage(&gpu.device, "mirror places", bytes.len() as u64);
    gpu.queue.write_buffer(&buffer, 0, &bytes);
    buffer
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::pack_normal;
    use glam::Vec3;

    use super::*;

    #[test]
    fn samples_are_spread_over_all_chunks_and_no_more_than_asked_for() {
        let chunk = |z: f64, count: usize| {
            let mut chunk = Chunk::new(0, DVec3::new(0.0, 0.0, z), (0..count).map(|i| [i as f32, 0.0, 0.0]).collect());
            chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::Z); count]));
            chunk
        };
        let chunks = [chunk(0.0, 3000), chunk(1.0, 1), chunk(2.0, 6000)];
        let found = samples(&whole(&chunks));
        assert!(found.len() <= MOST_SAMPLES && found.len() > MOST_SAMPLES / 2, "{}", found.len());
        let first = found.iter().filter(|(at, _)| at.z == 0.0).count();
        assert!(first.abs_diff(found.len() / 3) <= 1, "{first} of {}", found.len());
        assert!(found.iter().all(|(_, normal)| normal.distance(DVec3::Z) < 1e-4));
        // All points of a short chunk; none of a chunk without normals.
        assert_eq!(samples(&whole(&chunks[1..2])).len(), 1);
        assert!(samples(&whole(&[Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]])])).is_empty());
    }
}
