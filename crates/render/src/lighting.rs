//! The lights of a frame and their shadow maps, which the same passes splat as the picture.
//!
//! A sun has two maps if one of the whole scene would be coarse compared with the camera's view. The second is fitted
//! to the view, in steps, and its texels are fixed in the world, so that shadows do not swim when the camera moves.

use cloud::Bounds;
use glam::{DVec3, Vec4};
use scene::{Camera, Lighting, Quality, ResolvedLight, Settings, Splat, SpotLight};

use crate::frame::{FrameCamera, Objects};
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{LightSource, SHADOW_SIZE, SHADOW_TEXEL_BYTES};
use crate::passes::PassStage;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::store::draw_list::Selection;
use crate::targets::storage;

/// The most lights of a scene; more would not fit the shadow maps' buffer on small adapters.
pub const MOST_LIGHTS: usize = 4;
const SHADOW_BYTES: u64 = SHADOW_SIZE as u64 * SHADOW_SIZE as u64 * SHADOW_TEXEL_BYTES;
/// The number of texels from the middle of a shadow map to the edge of the lit area: all but one for the filter, and
/// one into which the rim may be rounded.
const HALF_TEXELS: f64 = (SHADOW_SIZE / 2 - 2) as f64;

/// A light with its shadow map. A sun with two maps is two of these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MappedLight {
    /// The camera of the shadow map.
    pub camera: FrameCamera,
    /// The radiant intensity of a spot light within its inner cone; for a sun, the irradiance across its light.
    pub intensity: [f32; 3],
    /// The angles of a spot light's cones in radians; 0 for a sun.
    pub inner: f32,
    pub outer: f32,
}

/// The points, splats and view from which a shadow map was drawn.
#[derive(Clone, PartialEq)]
pub(crate) struct DrawnMap {
    revision: u64,
    splat: Splat,
    camera: FrameCamera,
}

/// The lights on the GPU, and their shadow maps.
pub(crate) struct Lights {
    /// The lights in the layout of shaders/shared/light.wgsl.
    pub lights: wgpu::Buffer,
    /// `SHADOW_SIZE` squared texels a light, one light after the other, each laid out as the camera's `nearest`: rows
    /// from top to bottom of two words, the identity of the nearest point and its nearness (0: empty). A sun has first
    /// the map of the whole scene and then, if there is one, that of the view.
    pub shadows: wgpu::Buffer,
}

impl Lights {
    pub fn new(gpu: &Gpu) -> Self {
        let lights = storage(&gpu.device, "lights", (MOST_LIGHTS * size_of::<LightSource>()) as u64);
        Self { lights, shadows: storage(&gpu.device, "shadows", 16) }
    }

    /// The light that the settings choose, with everything automatic resolved.
    pub fn chosen(settings: &Settings, objects: Objects<'_>) -> ResolvedLight {
        settings.resolved_light(!objects.lights.is_empty(), objects.clues)
    }

    /// The lights that shine, each with the camera of its shadow map. `bounds` are those of the scene.
    pub fn mapped(
        settings: &Settings,
        objects: Objects<'_>,
        camera: &Camera,
        size: [u32; 2],
        bounds: Bounds,
    ) -> Vec<MappedLight> {
        match Self::chosen(settings, objects).by {
            Lighting::Lights => objects.lights.iter().take(MOST_LIGHTS).map(MappedLight::spot).collect(),
            Lighting::Sun => MappedLight::sun(settings, camera, size, bounds),
            Lighting::Auto | Lighting::Surroundings | Lighting::Headlight | Lighting::Colors => Vec::new(),
        }
    }

    /// Splats the points as each light sees them, except for maps in `at_hand`, which are drawn already; with `may_lag`,
    /// they stay while only the points change. Returns what the maps were drawn from.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn draw_shadows(
        &mut self,
        recorder: &mut Recorder<'_>,
        store: &PointStore,
        settings: &Settings,
        lights: &[MappedLight],
        mut at_hand: Vec<DrawnMap>,
        may_lag: bool,
        atomics64: bool,
    ) -> Result<Vec<DrawnMap>> {
        if lights.is_empty() {
            return Ok(at_hand);
        }
        let bytes = SHADOW_BYTES * lights.len() as u64;
        if self.shadows.size() < bytes {
            self.shadows = storage(&recorder.gpu.device, "shadows", bytes);
            at_hand.clear();
        }
        // Surfaces close to a lamp stay closed: only few splats are as wide as its map.
        let splat = Splat { max_pixels: SHADOW_SIZE as f32, ..splat_of_maps(settings) };
        let wide = Settings { splat, ..settings.clone() };
        let mut drawn = Vec::with_capacity(lights.len());
        for (index, light) in lights.iter().enumerate() {
            let before = at_hand.get(index);
            let revision = before.filter(|_| may_lag).map_or(store.geometry_revision(), |before| before.revision);
            let map = DrawnMap { revision, splat: wide.splat.clone(), camera: light.camera };
            let is_kept = before == Some(&map);
            let map = DrawnMap { revision: if is_kept { revision } else { store.geometry_revision() }, ..map };
            if !is_kept {
                let texels = SHADOW_BYTES * index as u64..SHADOW_BYTES * (index as u64 + 1);
                recorder.clear_part(&self.shadows, texels.clone());
                let list = store.draw_list(&light.camera, &wide, Selection::Casting);
                let inputs = Inputs::new(recorder.gpu, light.camera, &wide, &list);
                let binding = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &self.shadows,
                    offset: texels.start,
                    size: std::num::NonZeroU64::new(SHADOW_BYTES),
                });
                recorder.time_as(Some(("shadow_maps", PassStage::Light)));
                recorder.nearest_points(&[], &inputs, binding, atomics64)?;
                recorder.time_as(None);
            }
            drawn.push(map);
        }
        Ok(drawn)
    }

    /// Uploads the lights relative to `eye`.
    pub fn upload(&self, gpu: &Gpu, lights: &[MappedLight], eye: DVec3) {
        let lights: Vec<LightSource> = lights.iter().map(|light| light.to_gpu(eye)).collect();
        gpu.queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(&lights));
    }
}

/// The settings by which points are splatted into shadow maps.
pub(crate) fn splat_of_maps(settings: &Settings) -> Splat {
    Splat {
        // Light must not leak between splats: each is at least three texels wide.
        min_pixels: settings.splat.min_pixels.max(3.0),
        // The maps do not depend on the picture's quality, which changes whenever the camera begins to move.
        quality: Quality::Nearest,
        // Light sees all points.
        step: 1,
        ..settings.splat.clone()
    }
}

/// The radius of the camera's view at the pivot's distance, corners included, in world units.
pub(crate) fn radius_seen(camera: &Camera, settings: &Settings, size: [u32; 2]) -> f64 {
    let tangent = (f64::from(settings.view.field_of_view).to_radians() * 0.5).tan();
    let [width, height] = size.map(|edge| f64::from(edge.max(1)));
    camera.distance() * tangent * (1.0 + (width / height).powi(2)).sqrt()
}

impl MappedLight {
    fn spot(light: &SpotLight) -> Self {
        let tangent = f64::from(light.outer_degrees).clamp(0.1, 85.0).to_radians().tan();
        let axis = light.target - light.position;
        Self {
            camera: FrameCamera::along(light.position, axis, HALF_TEXELS / tangent, [SHADOW_SIZE; 2]),
            intensity: light.intensity,
            inner: light.inner_degrees.to_radians(),
            outer: light.outer_degrees.to_radians(),
        }
    }

    /// The sun with the map of the whole scene, and with that of the view if it is finer.
    fn sun(settings: &Settings, camera: &Camera, size: [u32; 2], bounds: Bounds) -> Vec<Self> {
        let (center, radius) = if bounds.is_empty() { (camera.pivot, 1.0) } else { (bounds.center(), bounds.radius()) };
        let radius = if radius > 0.0 { radius } else { 1.0 };
        let along = -settings.sun.direction(camera.up);
        // In front of the scene, splats included.
        let start = center - along * (radius * 1.1);
        let map = |center: DVec3, radius: f64, skipped: f64| {
            let (eye, per_unit) = (center - along * ((center - start).dot(along) - skipped), HALF_TEXELS / radius);
            // What lies behind the eye, far before the scene, casts shadows as if it lay at the eye.
            let near = -0.01 / per_unit;
            Self {
                camera: FrameCamera { near, ..FrameCamera::parallel_along(eye, along, per_unit, [SHADOW_SIZE; 2]) },
                intensity: [settings.sun.irradiance; 3],
                inner: 0.0,
                outer: 0.0,
            }
        };
        let whole = map(center, radius, 0.0);
        let seen = radius_seen(camera, settings, size);
        // The radius makes up for snapping, and changes in steps, so that it stays the same over small moves.
        let seen = (seen * HALF_TEXELS / (HALF_TEXELS - SNAP)).max(f64::MIN_POSITIVE);
        let seen = 2_f64.powf(0.5 * (2.0 * seen.log2()).ceil());
        if seen > radius * FINER {
            return vec![whole];
        }
        let step = SNAP * seen / HALF_TEXELS;
        let [right, up] = [0, 1].map(|row| whole.camera.view_from_world.row(row));
        // Whole steps away from a place that does not move with the camera.
        let snapped = |axis: DVec3| axis * (((camera.pivot - center).dot(axis) / step).round() * step);
        // Single precision would be too coarse for depths from far before the view.
        let depth = ((camera.pivot - start).dot(along) / seen).round() * seen;
        let skipped = (depth - FARTHEST * seen).max(0.0);
        vec![whole, map(center + snapped(right) + snapped(up), seen, skipped)]
    }

    fn to_gpu(self, eye: DVec3) -> LightSource {
        let row = |index| self.camera.view_from_world.row(index).as_vec3();
        let [red, green, blue] = self.intensity;
        LightSource {
            position_inner: (self.camera.eye - eye).as_vec3().extend(self.inner),
            axis_outer: row(2).extend(self.outer),
            intensity_focal: Vec4::new(red, green, blue, self.camera.focal_pixels as f32),
            right: row(0).extend(0.0),
            up: row(1).extend(0.0),
        }
    }
}

/// The sun gets a map of the view if it is at most this fraction of the size of the scene's map.
const FINER: f64 = 0.7;
/// The most radii of the map of the view from which it is drawn before the camera's pivot; a step of a depth in single
/// precision is a sixteenth of a texel there.
const FARTHEST: f64 = 1000.0;
/// The step in texels by which the map of the view moves: an eighth of half of it, so that it is seldom drawn anew
/// while the camera moves.
const SNAP: f64 = 64.0;

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds { min: DVec3::new(-50.0, -40.0, -3.0), max: DVec3::new(70.0, 60.0, 9.0) };

    fn maps(camera: &Camera) -> Vec<MappedLight> {
        MappedLight::sun(&Settings::default(), camera, [800, 600], BOUNDS)
    }

    fn camera(distance: f64) -> Camera {
        Camera::looking(DVec3::new(3.0, 4.0, 0.0), DVec3::new(0.5, -1.0, 0.6), distance, DVec3::Z)
    }

    #[test]
    fn a_map_of_the_view_is_made_where_it_is_finer_and_shows_what_the_camera_sees_at_the_pivot() {
        assert_eq!(maps(&camera(200.0)).len(), 1);
        for distance in [0.5, 3.0, 5.0, 20.0] {
            let camera = camera(distance);
            let found = maps(&camera);
            let [whole, view] = found[..] else { panic!("{} maps at {distance}", found.len()) };
            assert!(view.camera.focal_pixels * FINER >= whole.camera.focal_pixels);
            let seen = FrameCamera::new(&camera, &Settings::default().view, [800, 600], BOUNDS.center(), 1.0);
            for (x, y) in [(0.0, 0.0), (800.0, 0.0), (0.0, 600.0), (800.0, 600.0)] {
                let corner = seen.world_from_pixel(x, y, distance);
                assert!(view.camera.sees(corner, 0.0, -1.0), "{corner} at {distance}");
            }
            for (x, y, z) in [(0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1)] {
                let pick = |axis: usize, high: i32| if high == 1 { BOUNDS.max[axis] } else { BOUNDS.min[axis] };
                let corner = DVec3::new(pick(0, x), pick(1, y), pick(2, z));
                assert!(whole.camera.sees(corner, 0.0, -1.0), "{corner}");
                // Points that cast shadows from above the view are in front of the map's eye.
                assert!((view.camera.view_from_world * (corner - view.camera.eye)).z > 0.0, "{corner}");
            }
        }
    }

    #[test]
    fn a_map_of_the_sun_takes_what_lies_far_before_the_scene() {
        let whole = maps(&camera(200.0))[0].camera;
        let toward_sun = Settings::default().sun.direction(DVec3::Z);
        assert!(whole.sees(BOUNDS.center() + toward_sun * 1e5, 0.0, 0.0));
        assert!(!whole.sees(BOUNDS.center() + toward_sun.any_orthonormal_vector() * 1e5, 0.0, 0.0));
    }

    #[test]
    fn the_map_of_the_view_is_drawn_from_near_it_in_a_scene_that_is_far_larger() {
        let camera = camera(20.0);
        let wide = Bounds { max: BOUNDS.max + DVec3::new(5e6, 3e6, 0.0), ..BOUNDS };
        let view = MappedLight::sun(&Settings::default(), &camera, [800, 600], wide)[1].camera;
        let depth = (view.view_from_world * (camera.pivot - view.eye)).z;
        let step = f64::from(f32::from_bits((depth as f32).to_bits() + 1) - depth as f32);
        assert!(depth > 0.0 && step * view.focal_pixels < 0.1, "{depth}: {} texels", step * view.focal_pixels);
        // What stands farther before it casts shadows all the same.
        let toward_sun = Settings::default().sun.direction(DVec3::Z);
        assert!(view.sees(camera.pivot + toward_sun * 1e5, 0.0, 0.0));
    }

    #[test]
    fn the_map_of_the_view_moves_in_whole_texels_and_seldom() {
        let camera = camera(5.0);
        let mut kept = 0;
        for step in 1..=50 {
            let shift = DVec3::new(0.011, 0.007, 0.0) * f64::from(step);
            let moved = maps(&Camera { eye: camera.eye + shift, pivot: camera.pivot + shift, ..camera });
            let (was, is) = (maps(&camera), moved);
            assert_eq!(was[0], is[0]);
            kept += u32::from(was[1] == is[1]);
            let texels =
                is[1].camera.view_from_world * (is[1].camera.eye - was[1].camera.eye) * is[1].camera.focal_pixels;
            assert!((texels - texels.round()).abs().max_element() < 1e-6 && texels.z.abs() < 1e-6, "{texels}");
        }
        assert!(kept > 5, "{kept} of 50");
    }
}
