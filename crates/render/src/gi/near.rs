//! Finer shadow maps of the sky's lights about what the camera sees, in scenes that are much larger.

use std::num::NonZero;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::occluders::Occluders;
use super::region::Region;
use super::work::{Ground, Work};
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::layout::{VIRTUAL_TEXEL_BYTES, Virtual};
use crate::recorder::Recorder;
use crate::store::{PointStore, VisibleChunk};
use crate::targets::{storage, uniform_buffer};

/// The finer maps on the GPU.
pub(super) struct Near {
    /// The balls that they show, finest first.
    pub regions: Vec<Region>,
    /// What the shaders know of the maps of the scene, for each region: positions are relative to its middle.
    uniforms: Vec<Virtual>,
    /// The uniforms as an array.
    pub constants: wgpu::Buffer,
    /// For each region `bytes_of_region` with a map of each of the sky's lights.
    pub maps: wgpu::Buffer,
}

impl Near {
    /// The bytes of one region's maps, a multiple of what the beginning of a binding may be.
    pub fn bytes_of_region(of_scene: &Virtual) -> u64 {
        let texels = u64::from(of_scene.sky_lights) * u64::from(of_scene.map_stride);
        (texels * VIRTUAL_TEXEL_BYTES).next_multiple_of(256)
    }

    /// Draws the maps of the sky's lights, which are the first of `vpls`, for at least one region, unless those `before`
    /// show it. `of_scene` is what the maps of the scene share, `levels` are the edges of a map's levels in texels.
    ///
    /// # Errors
    /// A shader is refused, the frame is given up, or there is no memory.
    pub fn draw(
        recorder: &mut Recorder<'_>,
        (store, everywhere): (&PointStore, &Inputs),
        (regions, before): (Vec<Region>, Option<&Self>),
        vpls: &wgpu::Buffer,
        (of_scene, levels, per_map): (&Virtual, &[u32], u32),
    ) -> Result<Self> {
        let device = &recorder.gpu.device;
        let (count, bytes) = (regions.len() as u64, Self::bytes_of_region(of_scene));
        let maps = storage(device, "finer maps of the sky", count * bytes);
        let constants = storage(device, "finer maps", count * size_of::<Virtual>() as u64);
        let mut uniforms = Vec::new();
        for (region, offset) in regions.iter().zip((0..).step_by(bytes as usize)) {
            let known = before.and_then(|before| {
                let uniform = before.uniforms.get(uniforms.len())?;
                (before.regions[uniforms.len()] == *region).then_some((before, *uniform))
            });
            uniforms.push(if let Some((before, uniform)) = known {
                recorder.copy_part(&before.maps, &maps, offset..offset + bytes);
                uniform
            } else {
                recorder.clear_part(&maps, offset..offset + bytes);
                let part = wgpu::BufferBinding { buffer: &maps, offset, size: NonZero::new(bytes) };
                draw_region(recorder, (store, everywhere), *region, (vpls, part), (of_scene, levels, per_map))?
            });
        }
        Ok(Self { regions, uniforms, constants, maps })
    }

    /// Uploads where the camera's eye is.
    pub fn look_from(&mut self, recorder: &Recorder<'_>, eye: DVec3) {
        for (uniform, region) in self.uniforms.iter_mut().zip(&self.regions) {
            uniform.eye_radius = (eye - region.center).as_vec3().extend(region.radius as f32);
        }
        recorder.gpu.queue.write_buffer(&self.constants, 0, bytemuck::cast_slice(&self.uniforms));
    }
}

/// Draws the maps of one region, and returns what shaders know of them. Only `Near::look_from` sets the camera's eye.
///
/// What lies before the region casts shadows into it, from as far as there are points. The points are chosen from shells
/// about the region, each twice as wide as the one inside of it: discs are the larger the farther away they are.
///
/// # Errors
/// A shader is refused, the frame is given up, or there is no memory.
fn draw_region(
    recorder: &mut Recorder<'_>,
    (store, everywhere): (&PointStore, &Inputs),
    region: Region,
    (vpls, maps): (&wgpu::Buffer, wgpu::BufferBinding<'_>),
    (of_scene, levels, per_map): (&Virtual, &[u32], u32),
) -> Result<Virtual> {
    let gpu = recorder.gpu;
    let bounds = store.bounds();
    let farthest = region.center.distance(bounds.center()) + bounds.radius();
    let chunks = store.casting_chunks();
    let (mut inner, mut outer) = (0.0, region.radius);
    let mut innermost = None;
    loop {
        recorder.go_on()?;
        let is_last = outer >= farthest;
        let shell = [inner, if is_last { f64::INFINITY } else { outer }];
        let occluders = choose(&chunks, region.center, shell, per_map);
        let ground = Ground::with(gpu, store, per_map, (region.center, region.radius), occluders);
        let uniform = Virtual {
            eye_radius: Vec3::ZERO.extend(region.radius as f32),
            disc_radius: ground.occluders.radius,
            point_count: ground.occluders.points.len() as u32,
            subsets: ground.occluders.subsets.max(1),
            ..*of_scene
        };
        let constants = uniform_buffer(gpu, bytemuck::bytes_of(&uniform));
        let work = Work { constants: &constants, vpls, maps: maps.clone(), ground: &ground, levels, uniform: &uniform };
        if uniform.point_count > 0 {
            work.points(recorder, everywhere)?;
            work.splat(recorder, everywhere, 0, uniform.sky_lights)?;
        }
        if is_last {
            work.fill(recorder, everywhere, 0, uniform.sky_lights)?;
        }
        let uniform = *innermost.get_or_insert(uniform);
        if is_last {
            return Ok(uniform);
        }
        (inner, outer) = (outer, outer * 2.0);
    }
}

/// Chooses occluders from the points whose distance from `center` is at least the first of `shell` and below the second.
fn choose(chunks: &[VisibleChunk<'_>], center: DVec3, shell: [f64; 2], per_map: u32) -> Occluders {
    let [least, most] = shell.map(|distance| (distance * distance) as f32);
    let shown = |chunk: &VisibleChunk<'_>| {
        let from = (center - chunk.points.origin).as_vec3();
        let is_outside = |index: usize| {
            let squared = Vec3::from(chunk.points.positions[index]).distance_squared(from);
            // The comparison is false for NaN.
            !(squared >= least && squared < most)
        };
        chunk.shown.clone().besides(chunk.points.len(), is_outside)
    };
    let shown: Vec<_> = chunks.par_iter().map(shown).collect();
    let within: Vec<VisibleChunk<'_>> = chunks
        .iter()
        .zip(&shown)
        .map(|(chunk, shown)| VisibleChunk { shown_points: shown.indices(chunk.points.len()).count(), shown, ..*chunk })
        .collect();
    Occluders::choose(&within, center, per_map)
}
