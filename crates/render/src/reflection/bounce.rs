//! One bounce of a frame's reflections, and what the rays of all of them are searched in.

use scene::{Method, Mirror, Settings};

use super::task::{MirrorGBuffer, MirrorSurface, SurfaceImages};
use crate::gpu::Gpu;
use crate::inputs::Inputs;
use crate::store::PointStore;
use crate::targets::Image;

/// One bounce.
pub(crate) struct Bounce {
    pub mirror: MirrorSurface,
    pub seen: MirrorGBuffer,
    /// The radiance of the reflected surfaces, before and after further reflections are added.
    pub radiance: Image,
    pub blended: Image,
    /// How far the rays go, in radii of their mirrors; `None` until reflections fade (shaders/mirror_reach.wgsl).
    pub reach: Option<Image>,
    /// How much of what the rays receive is reflected; `None` until a lobe says so (shaders/gloss_reflectance.wgsl).
    pub reflectance: Option<Image>,
    /// How much the rays count; `None` if all are followed (shaders/mirror_weight.wgsl).
    pub weight: Option<Image>,
}

impl Bounce {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let image = |label, format| Image::new(device, size, label, format);
        Self {
            mirror: MirrorSurface::new(device, size),
            seen: MirrorGBuffer::new(device, size),
            radiance: image("mirror radiance", wgpu::TextureFormat::Rgba16Float),
            blended: image("mirror blended", wgpu::TextureFormat::Rgba16Float),
            reach: None,
            reflectance: None,
            weight: None,
        }
    }

    /// Makes what this bounce needs if reflections fade, if a lobe does not reflect all that rays receive, and if rays that
    /// count little are not followed, or gives it up.
    pub fn provide(&mut self, device: &wgpu::Device, [fades, has_reflectance, is_weighed]: [bool; 3]) {
        let size = self.radiance.size();
        let provide = |image: &mut Option<Image>, label, is_asked: bool| {
            let new = || Image::new(device, size, label, wgpu::TextureFormat::R32Float);
            *image = image.take().filter(|_| is_asked).or_else(|| is_asked.then(new));
        };
        provide(&mut self.reach, "mirror reach", fades);
        provide(&mut self.reflectance, "mirror reflectance", has_reflectance);
        provide(&mut self.weight, "mirror weight", is_weighed);
    }

    pub fn surface(&self) -> SurfaceImages<'_> {
        SurfaceImages { albedo: &self.seen.albedo, normal: &self.seen.normal, position: &self.seen.position }
    }

    pub fn bytes(&self) -> u64 {
        let Self { mirror, seen, radiance, blended, reach, reflectance, weight } = self;
        let asked: u64 = [reach, reflectance, weight].into_iter().flatten().map(Image::bytes).sum();
        seen.bytes() + mirror.bytes() + radiance.bytes() + blended.bytes() + asked
    }
}

/// One of several methods of a frame.
pub(crate) struct Part {
    /// The frame's, with this method.
    pub settings: Settings,
    /// The points in which the method searches.
    pub supply: Inputs,
}

/// The methods of a frame that has several.
pub(crate) struct Parts<'a> {
    pub each: Vec<Part>,
    /// The identity of the point that each pixel of the camera shows.
    pub nearest: &'a wgpu::Buffer,
}

impl Parts<'_> {
    /// The number of the part of a mirror that may have its own method.
    pub fn number_of(&self, settings: &Settings, own: Option<Method>) -> u32 {
        let method = settings.reflection.method_of(own);
        // A mirror out of the picture may have a method that the frame does not have.
        self.each.iter().position(|part| part.settings.reflection.method == method).unwrap_or(0) as u32
    }
}

/// What a frame's mirror rays are searched in, and the surface that they leave.
pub(crate) struct Search<'a> {
    /// All visible points, whether or not the camera sees them.
    pub supply: Inputs,
    pub settings: &'a Settings,
    pub store: &'a PointStore,
    /// All mirrors that have a formula.
    pub mirrors: &'a [Mirror],
    /// The mirrors that are drawn by their formula.
    pub formulas: Option<wgpu::Buffer>,
    pub camera: SurfaceImages<'a>,
    /// The methods of a frame that has several; else `settings` have its method.
    pub parts: Option<Parts<'a>>,
}

impl Search<'_> {
    /// Lets the passes that are recorded from now on work for a sample, given as in `Inputs::sample`.
    pub fn set_sample(&mut self, gpu: &Gpu, sample: Option<[u32; 3]>) {
        let parts = self.parts.iter_mut().flat_map(|parts| &mut parts.each);
        std::iter::once(&mut self.supply).chain(parts.map(|part| &mut part.supply)).for_each(|supply| {
            supply.set_sample(gpu, sample);
        });
    }
}
