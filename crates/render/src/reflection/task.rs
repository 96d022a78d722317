//! The input and the output of a reflection method: the mirror pixels of a bounce, and the Mirror G-Buffer.

use scene::{Mirror, Settings};

use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::{GBuffer, Image, Targets};

/// A surface that light bounces off: the camera's G-buffer, or the Mirror G-Buffer of the bounce before.
#[derive(Clone, Copy)]
pub(crate) struct SurfaceImages<'a> {
    pub albedo: &'a Image,
    pub normal: &'a Image,
    pub position: &'a Image,
}

impl<'a> SurfaceImages<'a> {
    /// The surface that the camera sees.
    pub fn of_camera(targets: &'a Targets) -> Self {
        let GBuffer { albedo, normal, .. } = targets.surface();
        Self { albedo, normal, position: &targets.position }
    }
}

/// The mirror pixels of one bounce, as the methods see them. All images are picture-sized.
pub(crate) struct MirrorSurface {
    /// xyz: P relative to the camera's eye, world axes. w: specular intensity; 0 where there is no mirror.
    pub point: Image,
    /// xyz: the origin of the ray to P, relative to the camera's eye. w: the linear depth of P as seen from there.
    pub eye: Image,
}

impl MirrorSurface {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            point: Image::new(device, size, "mirror point", wgpu::TextureFormat::Rgba32Float),
            eye: Image::new(device, size, "mirror eye", wgpu::TextureFormat::Rgba32Float),
        }
    }

    pub fn bytes(&self) -> u64 {
        self.point.bytes() + self.eye.bytes()
    }
}

/// The points seen by reflection at each pixel: the Mirror G-Buffer.
pub(crate) struct MirrorGBuffer {
    /// Linear albedo of Q; its specular intensity.
    pub albedo: Image,
    /// World normal at Q towards P; specular power.
    pub normal: Image,
    /// Q relative to the camera's eye, world axes. w: coverage; 0 none, 1 found, 0.75 found but not proven, below: closed from neighbours.
    pub position: Image,
}

impl MirrorGBuffer {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            albedo: Image::new(device, size, "mirror albedo", wgpu::TextureFormat::Rgba16Float),
            normal: Image::new(device, size, "mirror normal", wgpu::TextureFormat::Rgba32Float),
            position: Image::new(device, size, "mirror position", wgpu::TextureFormat::Rgba32Float),
        }
    }

    pub fn bind(&self) -> [wgpu::BindingResource<'_>; 3] {
        [self.albedo.bind(), self.normal.bind(), self.position.bind()]
    }

    /// Fills the task's Mirror G-Buffer with what this one holds, and puts mirrors with a formula in front.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn show_formulas(&self, recorder: &mut Recorder<'_>, task: &Task<'_>, formulas: &wgpu::Buffer) -> Result<()> {
        let [albedo_in, normal_in, position_in] = self.bind();
        let [albedo_out, normal_out, position_out] = task.seen.bind();
        let bindings = passes::mirror_exact_seen {
            point_in: task.mirror.point.bind(),
            mirror_normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            mirrors: formulas.as_entire_binding(),
            albedo_in,
            normal_in,
            position_in,
            albedo_out,
            normal_out,
            position_out,
        };
        recorder.by_rows(&[], task.supply, bindings, task.supply.mirror_groups())
    }

    pub fn bytes(&self) -> u64 {
        [&self.albedo, &self.normal, &self.position].map(Image::bytes).iter().sum()
    }
}

/// The inputs and outputs of a method.
pub(crate) struct Task<'a> {
    /// All visible points, whether or not the camera sees them.
    pub supply: &'a Inputs,
    pub settings: &'a Settings,
    pub store: &'a PointStore,
    /// All mirrors that have a formula.
    pub mirrors: &'a [Mirror],
    /// The number of the bounce; 0 for what the camera sees by one reflection.
    pub bounce: usize,
    /// What the camera sees.
    pub camera: SurfaceImages<'a>,
    pub mirror: &'a MirrorSurface,
    /// xyz: unit normal towards the origin of the ray. w: specular power.
    pub normal: &'a Image,
    pub seen: &'a MirrorGBuffer,
    /// The mirrors that are drawn by their formula.
    pub formulas: Option<&'a wgpu::Buffer>,
    /// `COUNTERS` words that the methods increment; they are read when the frame is done.
    pub counters: &'a wgpu::Buffer,
}
