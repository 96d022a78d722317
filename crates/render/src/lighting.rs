//! Light: which lights there are, and what each of them sees (its shadow map, splatted by the same passes as the picture).

use glam::{DVec3, Vec4};
use scene::{Lighting, Settings, SpotLight};

use crate::frame::FrameCamera;
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::{PointStore, Selection};
use crate::targets::storage;

/// Lights of a scene that count; more would not fit the shadow maps' buffer on small adapters.
pub(crate) const MOST_LIGHTS: usize = 4;
/// Texels along an edge of a shadow map: two to a pixel of a usual picture, so that a texel is about as fine as a splat.
const SHADOW_SIZE: u32 = 1024;
const SHADOW_BYTES: u64 = SHADOW_SIZE as u64 * SHADOW_SIZE as u64 * 8;

/// As shaders/shared/light.wgsl has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct GpuLight {
    /// Relative to the eye; w: cosine is not enough for a falloff in angle, so the inner angle itself, radians.
    position_inner: Vec4,
    /// Unit axis; w: outer angle, radians.
    axis_outer: Vec4,
    /// w: texels per unit of tangent in the shadow map.
    intensity_focal: Vec4,
    right: Vec4,
    up: Vec4,
}

/// The lights on the GPU, and their shadow maps.
pub(crate) struct Lights {
    pub lights: wgpu::Buffer,
    /// `SHADOW_SIZE` squared texels a light, laid out as the camera's `nearest`.
    pub shadows: wgpu::Buffer,
}

impl Lights {
    pub fn new(gpu: &Gpu) -> Self {
        let lights = storage(&gpu.device, "lights", (MOST_LIGHTS * size_of::<GpuLight>()) as u64);
        Self { lights, shadows: storage(&gpu.device, "shadows", 16) }
    }

    /// What `auto` stands for.
    pub fn chosen(settings: &Settings, lights: &[SpotLight]) -> Lighting {
        match settings.light.by {
            Lighting::Auto if lights.is_empty() => Lighting::Headlight,
            Lighting::Auto => Lighting::Lights,
            chosen => chosen,
        }
    }

    /// Splats the points as each light sees them.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn draw_shadows(
        &mut self,
        recorder: &mut Recorder<'_>,
        store: &PointStore,
        settings: &Settings,
        lights: &[SpotLight],
        atomics64: bool,
    ) -> Result<()> {
        let bytes = SHADOW_BYTES * lights.len().max(1) as u64;
        if self.shadows.size() != bytes {
            self.shadows = storage(&recorder.gpu.device, "shadows", bytes);
        }
        recorder.clear(&self.shadows);
        // Light must not leak between splats: each is at least three texels wide.
        let mut wide = settings.clone();
        wide.splat.min_pixels = wide.splat.min_pixels.max(3.0);
        for (index, light) in lights.iter().enumerate() {
            let camera = shadow_camera(light);
            let list = store.draw_list(&camera, &wide, Selection::SeenWithMirrors);
            let inputs = Inputs::new(recorder.gpu, camera, &wide, store, &list);
            let map = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &self.shadows,
                offset: SHADOW_BYTES * index as u64,
                size: std::num::NonZeroU64::new(SHADOW_BYTES),
            });
            // Without 64-bit atomics the depths alone are enough: nobody asks whose shadow it is.
            let pass = if atomics64 { &passes::SPLAT_NEAREST } else { &passes::SPLAT_DEPTH };
            recorder.over_points(pass, &[], &inputs, &[map])?;
        }
        Ok(())
    }

    /// Uploads the lights as seen from `eye`.
    pub fn upload(&self, gpu: &Gpu, lights: &[SpotLight], eye: DVec3) {
        let lights: Vec<GpuLight> = lights.iter().map(|light| gpu_light(light, eye)).collect();
        gpu.queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(&lights));
    }
}

fn shadow_camera(light: &SpotLight) -> FrameCamera {
    let axis = light.target - light.position;
    // The cone's rim, and a texel beside it for the filter.
    let tangent = f64::from(light.outer_degrees).clamp(0.1, 85.0).to_radians().tan();
    FrameCamera::along(light.position, axis, f64::from(SHADOW_SIZE / 2 - 2) / tangent, [SHADOW_SIZE; 2])
}

fn gpu_light(light: &SpotLight, eye: DVec3) -> GpuLight {
    let camera = shadow_camera(light);
    let row = |index| camera.view_from_world.row(index).as_vec3();
    let [red, green, blue] = light.intensity;
    GpuLight {
        position_inner: (light.position - eye).as_vec3().extend(light.inner_degrees.to_radians()),
        axis_outer: row(2).extend(light.outer_degrees.to_radians()),
        intensity_focal: Vec4::new(red, green, blue, camera.focal_pixels as f32),
        right: row(0).extend(0.0),
        up: row(1).extend(0.0),
    }
}
