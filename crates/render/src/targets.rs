//! The images and buffers in which a picture is made.

use crate::allocation;
use crate::gpu::Gpu;
use crate::layout::NEAREST_BYTES;
use crate::passes;

/// A picture-sized image; a clone is the same image.
#[derive(Clone)]
pub(crate) struct Image {
    pub texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Image {
    pub fn new(device: &wgpu::Device, size: [u32; 2], label: &str, format: wgpu::TextureFormat) -> Self {
        let texture = allocation::texture(
            device,
            &wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC
                    | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            },
        );
        let view = texture.create_view(&Default::default());
        Self { texture, view }
    }

    pub fn bind(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(&self.view)
    }

    pub fn size(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.height()]
    }

    pub fn bytes(&self) -> u64 {
        let pixels = u64::from(self.texture.width()) * u64::from(self.texture.height());
        pixels * u64::from(self.texture.format().block_copy_size(None).unwrap_or(0))
    }
}

/// The surface that the camera sees at each pixel.
pub(crate) struct GBuffer {
    /// Linear albedo; specular intensity.
    pub albedo: Image,
    /// World normal towards the eye; specular power.
    pub normal: Image,
    /// The linear depth in world units; 0 if empty.
    pub depth: Image,
}

impl GBuffer {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            albedo: Image::new(device, size, "albedo", wgpu::TextureFormat::Rgba16Float),
            normal: Image::new(device, size, "normal", wgpu::TextureFormat::Rgba32Float),
            depth: Image::new(device, size, "depth", wgpu::TextureFormat::R32Float),
        }
    }

    pub fn bind(&self) -> [wgpu::BindingResource<'_>; 3] {
        [self.albedo.bind(), self.normal.bind(), self.depth.bind()]
    }

    fn bytes(&self) -> u64 {
        self.albedo.bytes() + self.normal.bytes() + self.depth.bytes()
    }
}

/// The images and buffers of one picture size.
pub(crate) struct Targets {
    pub size: [u32; 2],
    /// Two words a pixel: the identity of the nearest point and its nearness (0: empty).
    pub nearest: wgpu::Buffer,
    /// The sums of the high quality and their carries, made when they are first needed.
    pub sums: Option<[wgpu::Buffer; 4]>,
    /// The splat radius of each pixel's nearest point, made when eye-dome lighting first asks for it.
    pub radii: Option<Image>,
    /// The index of refraction of each pixel's nearest point, made when light first goes through points.
    pub clear_points: Option<Image>,
    /// Two surfaces: passes over pixels read one and write the other.
    pub surfaces: [GBuffer; 2],
    /// The index of the surface that the points make. Mirrors that are drawn by their formula are laid over a copy of
    /// it, so that it stays as it is while they move.
    pub splatted: usize,
    /// The index of the surface from which the picture was made.
    pub shown: usize,
    /// The positions of the shown surface relative to the eye, world axes; w: 1, or 0 where it is empty.
    pub position: Image,
    /// The light of lamps and the sun that the shown surface reflects; for a mirror, the part that remains beside its
    /// reflection.
    pub direct: Image,
    /// The colour with reflections.
    pub color: Image,
    pub picture: Image,
}

impl Targets {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let image = |label, format| Image::new(device, size, label, format);
        Self {
            size,
            nearest: storage(device, "nearest", u64::from(size[0]) * u64::from(size[1]) * NEAREST_BYTES),
            sums: None,
            radii: None,
            clear_points: None,
            surfaces: [GBuffer::new(device, size), GBuffer::new(device, size)],
            splatted: 0,
            shown: 0,
            position: image("position", wgpu::TextureFormat::Rgba32Float),
            direct: image("direct", wgpu::TextureFormat::Rgba16Float),
            color: image("color", wgpu::TextureFormat::Rgba16Float),
            picture: image("picture", wgpu::TextureFormat::Rgba8Unorm),
        }
    }

    /// The surface from which the picture was made.
    pub fn surface(&self) -> &GBuffer {
        &self.surfaces[self.shown]
    }

    /// The bindings of `present`, which makes the picture. Without radii its settings do not ask for them.
    pub fn presented<'r>(&'r self, color: &'r Image) -> passes::present<'r> {
        let GBuffer { depth, normal, .. } = self.surface();
        passes::present {
            color_in: color.bind(),
            depth_in: depth.bind(),
            radius_in: self.radii.as_ref().unwrap_or(depth).bind(),
            normal_in: normal.bind(),
            picture_out: self.picture.bind(),
        }
    }

    pub fn bytes(&self) -> u64 {
        let sums = self.sums.iter().flatten().map(wgpu::Buffer::size).sum::<u64>();
        let images = [&self.position, &self.direct, &self.color, &self.picture].map(Image::bytes).iter().sum::<u64>();
        let made = [&self.radii, &self.clear_points].into_iter().flatten().map(Image::bytes).sum::<u64>();
        self.nearest.size() + sums + images + made + self.surfaces.iter().map(GBuffer::bytes).sum::<u64>()
    }
}

pub(crate) fn storage(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    allocation::buffer(
        device,
        &wgpu::BufferDescriptor {
            label: Some(label),
            size: size.max(16),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        },
    )
}

pub(crate) fn uniform_buffer(gpu: &Gpu, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = allocation::buffer(
        &gpu.device,
        &wgpu::BufferDescriptor {
            label: Some("uniform"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        },
    );
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}
