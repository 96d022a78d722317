//! What a mirror shows is filtered to the footprint of a pixel: the mean of what rays meet from several places within
//! it. A sample moves the mirror points that the camera sees, and their normals, along the mirror, so that every method
//! that follows a mirror pixel's ray finds it as it finds that of the pixel's centre.

use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::FormulaMirror;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, storage};

use super::task::MirrorSurface;

/// The images of moved mirror points.
pub(crate) struct Footprint {
    /// The mirror points at the centres of pixels, as in `MirrorSurface`.
    pub centers: Image,
    /// The moved normals; w: specular power.
    pub normal: Image,
    /// Stands for the mirrors that are drawn by their formula where there are none.
    no_formula: wgpu::Buffer,
}

impl Footprint {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let image = |label| Image::new(&gpu.device, size, label, wgpu::TextureFormat::Rgba32Float);
        let no_formula = storage(&gpu.device, "no formula", size_of::<FormulaMirror>() as u64);
        Self { centers: image("mirror centers"), normal: image("moved normals"), no_formula }
    }

    pub fn bytes(&self) -> u64 {
        self.centers.bytes() + self.normal.bytes() + self.no_formula.size()
    }

    /// Moves the mirror points of `centers` by the sample of `inputs`; `formulas` are the mirrors that are drawn by
    /// theirs.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn move_points(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        normal: &Image,
        formulas: Option<&wgpu::Buffer>,
        mirror: &MirrorSurface,
    ) -> Result<()> {
        let bindings = passes::mirror_move {
            point_in: self.centers.bind(),
            normal_in: normal.bind(),
            mirrors: formulas.unwrap_or(&self.no_formula).as_entire_binding(),
            point_out: mirror.point.bind(),
            eye_out: mirror.eye.bind(),
            normal_out: self.normal.bind(),
        };
        let switches = [("has_formulas", u32::from(formulas.is_some()))];
        recorder.by_rows(&switches, inputs, bindings, inputs.pixel_groups())
    }
}
