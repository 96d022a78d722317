//! Environment maps (Blinn, Newell 1976; as cubes Greene 1986), the cheap baseline: a mirror shows in a direction what
//! is seen in that direction from its middle. That is right for distant points; near ones are seen from the wrong
//! place.
//!
//! A map is six pictures, splatted from the points around a mirror by the passes that make the camera's picture. It
//! does not depend on the camera and is kept until points, mirrors or splats change. A texel holds the identity of the
//! nearest point, so colours may change. The position reported for a pixel is on that point's disc, however far from
//! the reflected ray. With the box proxy a direction is first turned to where the reflected ray leaves the box about
//! all points (Lagarde, Zanuttini 2012), which is exact for an empty box.

use glam::{DMat3, DVec3};
use scene::{MirrorSurface, Settings, Splat};

use super::cubemaps::{draw_list, grain_of_task};
use super::gather::Gather;
use super::mirror_places::{MirrorMap, MirrorPlace, map_bytes, own_places, upload};
use super::task::{MirrorGBuffer, Task};
use crate::frame::FrameCamera;
use crate::gpu::Result;
use crate::identities::CloudId;
use crate::inputs::Inputs;
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::targets::storage;

/// The most maps of a frame; more would not fit in memory at the largest size. Further mirrors use the map whose middle
/// is nearest to their own.
const MOST_MAPS: u64 = 8;

/// The maps, with the inputs from which they were drawn.
#[derive(Default)]
pub(crate) struct EnvironmentMap {
    /// Six faces a map, each laid out as the camera's `nearest`.
    maps: Option<wgpu::Buffer>,
    drawn: Option<Drawn>,
    /// Whether the frame has drawn them.
    is_new: bool,
}

/// The inputs of the maps.
#[derive(PartialEq)]
struct Drawn {
    revision: u64,
    splat: Splat,
    surface: MirrorSurface,
    size: u32,
    /// For each map, the cloud that it does not show, and its middle.
    maps: Vec<(Option<CloudId>, DVec3)>,
}

impl EnvironmentMap {
    pub fn bytes(&self) -> u64 {
        self.maps.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// What one of how many points the maps show, and the texels along an edge of theirs.
    pub fn grain(&self) -> Option<[u32; 2]> {
        self.drawn.as_ref().map(|drawn| [drawn.splat.step, drawn.size])
    }

    /// Makes the next frame draw the maps anew.
    pub fn forget(&mut self) {
        self.drawn = None;
    }

    /// Begins a frame. If the one before was given up, maps that it has drawn are not kept.
    pub fn begin(&mut self, was_unfinished: bool) {
        if std::mem::take(&mut self.is_new) && was_unfinished {
            self.forget();
        }
    }

    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(&mut self, recorder: &mut Recorder<'_>, gather: &Gather, task: &Task<'_>) -> Result<()> {
        gather.complete(recorder, task, |recorder, found| self.fill(recorder, gather, task, found, false))
    }

    /// Writes what the maps show; `only_rest`: of the rays of which the hits say that nothing is known.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn fill(
        &mut self,
        recorder: &mut Recorder<'_>,
        gather: &Gather,
        task: &Task<'_>,
        found: &MirrorGBuffer,
        only_rest: bool,
    ) -> Result<()> {
        let places = own_places(task);
        let kept = self.drawn.as_ref().map(|drawn| (&drawn.splat, drawn.size));
        let (splat, size) = grain_of_task(task, task.settings.environment_map.size, kept);
        let face_bytes = map_bytes([size; 2]);
        let most = (recorder.gpu.device.limits().max_storage_buffer_binding_size / (6 * face_bytes)).min(MOST_MAPS);
        let mapped = &places[..places.len().min(most as usize)];
        let drawn = Drawn {
            revision: task.store.geometry_revision(),
            splat,
            surface: task.settings.mirror.surface,
            size,
            maps: mapped.iter().map(|place| (place.cloud, place.bounds.center())).collect(),
        };
        let bytes = 6 * face_bytes * mapped.len().max(1) as u64;
        let (maps, was_drawn) = match self.maps.take().filter(|maps| maps.size() == bytes) {
            Some(maps) => (maps, self.drawn.take()),
            None => (storage(&recorder.gpu.device, "environment maps", bytes), None),
        };
        if was_drawn.as_ref() != Some(&drawn) {
            self.is_new = true;
            draw(recorder, task, mapped, &drawn, &maps)?;
        }
        self.drawn = Some(drawn);
        let maps = self.maps.insert(maps);

        let eye = task.supply.camera.eye;
        let map_of = |index: usize| {
            let distance = |map: usize| mapped[map].bounds.center().distance_squared(places[index].bounds.center());
            let map = (0..mapped.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
            Some(MirrorMap { map, view: (mapped[map].bounds.center() - eye).as_vec3().extend(size as f32) })
        };
        let mirrors = upload(recorder.gpu, &places, task.store.bounds(), eye, map_of);
        let [albedo_out, normal_out, position_out] = found.bind();
        let bindings = passes::environment_look_up {
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            maps: maps.as_entire_binding(),
            mirrors: mirrors.as_entire_binding(),
            hits: gather.hits.as_entire_binding(),
            albedo_out,
            normal_out,
            position_out,
            views_out: gather.views.bind(),
        };
        let switches = [("only_rest", u32::from(only_rest))];
        recorder.over_pages(&switches, task.supply, bindings, task.supply.mirror_groups())
    }
}

/// Splats the points around each mirror, all but the mirror's own.
fn draw(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    mapped: &[MirrorPlace],
    drawn: &Drawn,
    maps: &wgpu::Buffer,
) -> Result<()> {
    recorder.time_as(Some(("environment_map", PassStage::Method)));
    recorder.clear(maps);
    let settings = Settings { splat: drawn.splat.clone(), ..task.settings.clone() };
    let face_bytes = maps.size() / (6 * mapped.len().max(1) as u64);
    for (index, place) in mapped.iter().enumerate() {
        for face in 0..6 {
            let camera = face_camera(place.bounds.center(), place.bounds.radius(), face, drawn.size);
            let list = draw_list(task, &camera, &settings, place.cloud);
            let inputs = Inputs::new(recorder.gpu, camera, &settings, &list);
            let binding = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: maps,
                offset: face_bytes * (index * 6 + face) as u64,
                size: std::num::NonZeroU64::new(face_bytes),
            });
            let atomics64 = recorder.gpu.has_wide_atomics(&settings.splat);
            recorder.nearest_points(&[], &inputs, binding, atomics64)?;
        }
    }
    recorder.time_as(None);
    Ok(())
}

/// The camera of a face of a map, at the map's middle: faces 0 to 2 look along an axis, 3 to 5 against it; the two axes
/// after it point right and up.
pub(super) fn face_camera(center: DVec3, mirror_radius: f64, face: usize, size: u32) -> FrameCamera {
    let axis = |index: usize| DVec3::AXES[(face + index) % 3];
    let forward = if face < 3 { axis(0) } else { -axis(0) };
    FrameCamera {
        view_from_world: DMat3::from_cols(axis(1), axis(2), forward).transpose(),
        // Only the mirror itself is this near. A mirror without extent must not cause a division by a depth of zero.
        near: (mirror_radius * 1e-4).max(f64::from(f32::MIN_POSITIVE)),
        ..FrameCamera::along(center, forward, f64::from(size) * 0.5, [size; 2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_direction_is_in_the_picture_of_the_face_of_its_largest_part() {
        let center = DVec3::new(3.0, -2.0, 700.0);
        for i in 0..500_u32 {
            let part = |k: u32| f64::from((i * 7919 + k * 104_729) % 1000) / 500.0 - 0.999;
            let direction = DVec3::new(part(1), part(2), part(3));
            let largest = (0..3).fold(0, |a, b| if direction[b].abs() > direction[a].abs() { b } else { a });
            let face = largest + if direction[largest] > 0.0 { 0 } else { 3 };
            let camera = face_camera(center, 1.0, face, 64);
            let view = camera.view_from_world * direction;
            assert!((view.length() - direction.length()).abs() < 1e-12);
            // The two functions of the shader: the depth is the largest component, and the slopes are those of the
            // components after it.
            assert!((view.z - direction[largest].abs()).abs() < 1e-12);
            let slopes = [1, 2].map(|after| direction[(largest + after) % 3] / direction[largest].abs());
            assert!(slopes.iter().all(|slope| slope.abs() <= 1.0));
            let seen = camera.world_from_pixel(32.0 * (1.0 + slopes[0]), 32.0 * (1.0 - slopes[1]), view.z);
            assert!((seen - center).distance(direction) < 1e-9, "{seen}");
        }
    }
}
