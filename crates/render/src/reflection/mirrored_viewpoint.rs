//! Planar reflection, the cheap baseline for flat mirrors: the scene is splatted once more for each mirror, from the
//! eye mirrored at the mirror's plane, and a mirror pixel takes what that picture shows at the same pixel. It is exact,
//! up to the splats, for a flat mirror. A curved one is approximated by the plane through the middle of its parts that
//! face the eye.
//!
//! Reflections of reflections would need a picture for each sequence of mirrors: later bounces are left empty.

use glam::DVec3;

use super::gather::Gather;
use super::mirror_places::{MirrorMap, MirrorPlace, map_bytes, own_places, upload};
use super::task::{MirrorGBuffer, Task};
use crate::frame::{FrameCamera, Plane};
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::store::draw_list::Selection;
use crate::targets::storage;

/// The most mirrors of a frame; each costs another splatting of the scene. Further ones stay empty.
const MOST_VIEWS: u64 = 4;

/// The pictures of the mirrored eyes, one for each mirror.
#[derive(Default)]
pub(crate) struct MirroredViewpoint {
    /// Pictures as large as the frame's, laid out as the camera's `nearest`.
    views: Option<wgpu::Buffer>,
}

/// A mirror and the plane that approximates it.
struct View {
    /// The index among all mirrors.
    mirror: usize,
    plane: Plane,
}

impl MirroredViewpoint {
    pub fn bytes(&self) -> u64 {
        self.views.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(&mut self, recorder: &mut Recorder<'_>, gather: &Gather, task: &Task<'_>) -> Result<()> {
        let camera = task.supply.camera;
        let places = own_places(task);
        let view_bytes = map_bytes(camera.size);
        let most = (recorder.gpu.device.limits().max_storage_buffer_binding_size / view_bytes).min(MOST_VIEWS);
        let views: Vec<View> = if task.bounce > 0 {
            Vec::new()
        } else {
            let seen = |place: &MirrorPlace| camera.sees(place.bounds.center(), place.bounds.radius(), 0.0);
            let numbered = places.iter().enumerate().filter(|(_, place)| seen(place));
            let view =
                |(mirror, place): (_, &MirrorPlace)| Some(View { mirror, plane: plane_of(&place.samples, &camera)? });
            numbered.filter_map(view).take(most as usize).collect()
        };
        let bytes = view_bytes * views.len().max(1) as u64;
        let kept = self.views.take().filter(|views| views.size() >= bytes);
        let pictures = kept.unwrap_or_else(|| storage(&recorder.gpu.device, "mirrored viewpoints", bytes));
        let pictures = self.views.insert(pictures);
        draw(recorder, task, &places, &views, pictures)?;

        let map_of = |mirror: usize| {
            let map = views.iter().position(|view| view.mirror == mirror)?;
            let Plane { normal, offset } = views[map].plane;
            Some(MirrorMap { map, view: normal.as_vec3().extend((offset - normal.dot(camera.eye)) as f32) })
        };
        let mirrors = upload(recorder.gpu, &places, task.store.bounds(), camera.eye, map_of);
        let fill = |recorder: &mut Recorder<'_>, found: &MirrorGBuffer| {
            let [albedo_out, normal_out, position_out] = found.bind();
            let bindings = passes::mirrored_look_up {
                point_in: task.mirror.point.bind(),
                maps: pictures.as_entire_binding(),
                mirrors: mirrors.as_entire_binding(),
                albedo_out,
                normal_out,
                position_out,
                views_out: gather.views.bind(),
            };
            recorder.over_page_pixels(task.supply, bindings, task.supply.mirror_groups())
        };
        // A later bounce finds nothing: there is nothing to close, and mirrors with a formula stay as empty as others.
        if task.bounce > 0 { fill(recorder, task.seen) } else { gather.complete(recorder, task, fill) }
    }
}

/// Splats what each mirrored eye sees in front of its mirror's plane, all but the mirror itself.
fn draw(
    recorder: &mut Recorder<'_>,
    task: &Task<'_>,
    places: &[MirrorPlace],
    views: &[View],
    pictures: &wgpu::Buffer,
) -> Result<()> {
    let view_bytes = map_bytes(task.supply.size);
    recorder.time_as(Some(("mirrored_viewpoint", PassStage::Method)));
    for (index, view) in views.iter().enumerate() {
        let camera = task.supply.camera.mirrored(view.plane);
        let selection = places[view.mirror].cloud.map_or(Selection::Seen, Selection::SeenBesides);
        let list = task.store.draw_list(&camera, task.settings, selection);
        let inputs = Inputs::new(recorder.gpu, camera, task.settings, &list);
        let texels = view_bytes * index as u64..view_bytes * (index as u64 + 1);
        recorder.clear_part(pictures, texels.clone());
        let binding = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: pictures,
            offset: texels.start,
            size: std::num::NonZeroU64::new(view_bytes),
        });
        let atomics64 = recorder.gpu.has_wide_atomics(&task.settings.splat);
        recorder.nearest_points(&[("clips", 1)], &inputs, binding, atomics64)?;
    }
    recorder.time_as(None);
    Ok(())
}

/// The plane through the middle of the samples that face the eye, along their mean normal; if none does, of all samples
/// with their normals turned round. `None` if they face all ways, or if the eye does not see the plane's front.
fn plane_of(samples: &[(DVec3, DVec3)], camera: &FrameCamera) -> Option<Plane> {
    let forward = camera.view_from_world.row(2);
    let toward_eye = |at: DVec3| if camera.orthographic { -forward } else { camera.eye - at };
    let facing: Vec<(DVec3, DVec3)> =
        samples.iter().copied().filter(|(at, normal)| normal.dot(toward_eye(*at)) > 0.0).collect();
    let chosen = if facing.is_empty() { samples.iter().map(|(at, normal)| (*at, -*normal)).collect() } else { facing };
    let (places, normals) = chosen.iter().fold((DVec3::ZERO, DVec3::ZERO), |sum, (at, normal)| {
        // Sums of places near the eye lose no digits in the coordinates of a survey.
        (sum.0 + (*at - camera.eye), sum.1 + *normal)
    });
    let normal = normals.try_normalize()?;
    let middle = camera.eye + places / chosen.len() as f64;
    (normal.dot(toward_eye(middle)) > 0.0).then(|| Plane { normal, offset: normal.dot(middle) })
}

#[cfg(test)]
mod tests {
    use scene::{Camera, Mirror, Projection, Shape, ViewSettings};

    use super::*;
    use crate::reflection::mirror_places::{samples, whole};

    fn frame_camera(projection: Projection) -> FrameCamera {
        let camera = Camera::looking(DVec3::new(500_000.0, 0.0, 0.0), DVec3::new(0.2, -0.5, 1.0), 4.0, DVec3::Y);
        let view = ViewSettings { projection, ..ViewSettings::default() };
        FrameCamera::new(&camera, &view, [64, 48], camera.pivot, 3.0)
    }

    fn plane_of_mirror(shape: Shape, normal: DVec3, camera: &FrameCamera) -> Option<Plane> {
        let at = DVec3::new(500_000.0, 0.0, 0.0);
        let mirror = Mirror { position: at, ..Mirror::standing(shape, at, normal, DVec3::Y, 0.5) };
        let chunks = mirror.sample(3000, 1);
        plane_of(&samples(&whole(&chunks)), camera)
    }

    #[test]
    fn a_flat_mirror_is_taken_for_its_own_plane_by_either_side() {
        let normal = DVec3::new(0.3, -0.2, 0.9).normalize();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = frame_camera(projection);
            for side in [1.0, -1.0] {
                let plane = plane_of_mirror(Shape::Plane { height: 0.6 }, normal * side, &camera).unwrap();
                assert!(plane.normal.distance(normal) < 1e-4, "{plane:?}");
                let through = plane.normal.dot(DVec3::new(500_000.0, 0.0, 0.0));
                assert!((plane.offset - through).abs() < 1e-4, "{plane:?}, not through {through}");
            }
        }
    }

    #[test]
    fn a_sphere_is_taken_for_a_plane_through_its_front() {
        let camera = frame_camera(Projection::Perspective);
        let plane = plane_of_mirror(Shape::Sphere, DVec3::Y, &camera).unwrap();
        let center = DVec3::new(500_000.0, 0.0, 0.0);
        assert!(plane.normal.dot((camera.eye - center).normalize()) > 0.999, "{plane:?}");
        // The middle of half a sphere's surface is half a radius in front of its centre.
        let before = plane.offset - plane.normal.dot(center);
        assert!((0.2..0.32).contains(&before), "{before}");
        assert!(plane_of(&[], &camera).is_none());
    }
}
