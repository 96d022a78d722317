//! A frame: which passes run in which order, on which images; pass times; what is read back.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use scene::{Atomics, Camera, Quality, Settings};

use crate::frame::{Block, FrameCamera, Page};
use crate::gpu::{Clock, Error, Gpu, Result};
use crate::image::{Aov, AovImage};
use crate::passes::{self, Compiled, Pass};
use crate::store::{ChunkId, CloudId, DrawList, PageDraw, PointStore};

/// Time of one pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTime {
    /// The pass's shader, or `clear`.
    pub name: &'static str,
    pub milliseconds: f64,
}

/// What a frame cost and drew.
#[derive(Clone, Debug)]
pub struct FrameStats {
    /// In order; a pass that runs once a page is summed.
    pub passes: Vec<PassTime>,
    /// From the first pass to the last.
    pub frame_milliseconds: f64,
    pub points_drawn: u64,
    pub points_resident: u64,
    pub gpu_bytes: u64,
    pub clock: Clock,
}

/// The point under a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    pub cloud: CloudId,
    pub chunk: ChunkId,
    /// In the chunk.
    pub index: usize,
    pub linear_depth: f32,
    pub pixel: [u32; 2],
}

/// Renders frames. One at a time, on any thread.
pub struct Renderer {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
    targets: Option<Targets>,
    /// Camera of the last frame.
    camera: Option<FrameCamera>,
}

/// The passes over pixels, and those over points as they come to be needed.
struct Pipelines {
    /// By shader, `pixels_only` and `filter_classes`.
    over_points: HashMap<(&'static str, bool, bool), Compiled>,
    splat_average: Compiled,
    splat_resolve: Compiled,
    close_gaps: Compiled,
    shade: Compiled,
    present: Compiled,
}

/// Images and buffers of one picture size.
struct Targets {
    size: [u32; 2],
    /// Two words a pixel: identity of the nearest point, nearness (0: empty).
    nearest: wgpu::Buffer,
    /// Sums of the high quality and their carries, made when it is first asked for.
    sums: Option<[wgpu::Buffer; 4]>,
    /// As splatted.
    splatted: GBuffer,
    /// With its gaps closed, where that is asked for.
    closed: GBuffer,
    gaps_are_closed: bool,
    color: wgpu::Texture,
    picture: wgpu::Texture,
}

/// What is seen at each pixel.
struct GBuffer {
    /// Linear albedo; specular intensity.
    albedo: wgpu::Texture,
    /// World normal towards the eye; specular power.
    normal: wgpu::Texture,
    /// Linear depth, world units; 0: empty.
    depth: wgpu::Texture,
}

impl GBuffer {
    fn views(&self) -> [wgpu::TextureView; 3] {
        [&self.albedo, &self.normal, &self.depth].map(|texture| texture.create_view(&Default::default()))
    }
}

impl Renderer {
    /// Compiles every pass the adapter needs and runs each once on a tiny picture: drivers compile at the first dispatch, on
    /// software Vulkan for seconds, so call this off the window's thread.
    ///
    /// # Errors
    /// A shader is refused, or the device is lost.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self> {
        let compile = |pass| Compiled::new(&gpu.device, pass, &[]).map_err(Error::Shader);
        let pipelines = Pipelines {
            over_points: HashMap::new(),
            splat_average: compile(&passes::SPLAT_AVERAGE)?,
            splat_resolve: compile(&passes::SPLAT_RESOLVE)?,
            close_gaps: compile(&passes::CLOSE_GAPS)?,
            shade: compile(&passes::SHADE)?,
            present: compile(&passes::PRESENT)?,
        };
        let mut renderer = Self { gpu: gpu.clone(), pipelines, targets: None, camera: None };
        renderer.warm_up()?;
        Ok(renderer)
    }

    fn warm_up(&mut self) -> Result<()> {
        let mut store = PointStore::new(self.gpu.clone());
        let cloud = store.add_cloud(Default::default());
        // One chunk of single pixels, one of discs.
        store.add_chunk(cloud, &cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]]), None)?;
        let mut disc = cloud::Chunk::new(1, DVec3::ZERO, vec![[0.0; 3]]);
        disc.radii = Some(Arc::new(vec![cloud::pack_radius(1.0)]));
        store.add_chunk(cloud, &disc, None)?;
        let camera = Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z);
        for quality in [Quality::Nearest, Quality::High] {
            let mut settings = Settings::default();
            settings.splat.quality = quality;
            self.render(&store, &camera, &settings, [8, 8])?;
        }
        self.targets = None;
        Ok(())
    }

    /// Renders a frame and waits for it.
    ///
    /// # Errors
    /// A picture too large for the adapter, no more memory, or the device was lost.
    pub fn render(
        &mut self,
        store: &PointStore,
        camera: &Camera,
        settings: &Settings,
        size: [u32; 2],
    ) -> Result<FrameStats> {
        self.resize(size, settings.splat.quality)?;
        let atomics64 = self.gpu.atomics64 && settings.splat.atomics != Atomics::Bits32;
        let bounds = store.bounds();
        let (center, radius) = if bounds.is_empty() { (camera.pivot, 1.0) } else { (bounds.center(), bounds.radius()) };
        let frame_camera = FrameCamera::new(camera, &settings.view, size, center, radius);
        let list = store.draw_list(&frame_camera, &settings.splat);
        let nearest_passes: &[&Pass] =
            if atomics64 { &[&passes::SPLAT_NEAREST] } else { &[&passes::SPLAT_DEPTH, &passes::SPLAT_IDENTITY] };
        for pass in nearest_passes.iter().copied().chain([&passes::SPLAT_ACCUMULATE]) {
            if pass.name != passes::SPLAT_ACCUMULATE.name || settings.splat.quality == Quality::High {
                self.compile_over_points(pass, &list)?;
            }
        }
        let inputs = Inputs::new(&self.gpu, frame_camera, settings, store, &list);
        let targets = self.targets.as_ref().ok_or_else(nothing_rendered)?;
        let mut recorder = Recorder::new(&self.gpu);

        recorder.clear(&targets.nearest);
        let nearest = targets.nearest.as_entire_binding();
        for pass in nearest_passes {
            self.each_page(&mut recorder, pass, &inputs, std::slice::from_ref(&nearest));
        }
        let splatted = targets.splatted.views();
        let splatted = splatted.each_ref().map(wgpu::BindingResource::TextureView);
        match (settings.splat.quality, &targets.sums) {
            (Quality::High, Some(sums)) => {
                for buffer in sums {
                    recorder.clear(buffer);
                }
                let [color_sums, surface_sums, specular_sums, carries] =
                    sums.each_ref().map(|sums| sums.as_entire_binding());
                let sums = [nearest, color_sums, surface_sums, specular_sums, carries];
                self.each_page(&mut recorder, &passes::SPLAT_ACCUMULATE, &inputs, &sums);
                let resources: Vec<_> = sums.iter().chain(&splatted).cloned().collect();
                self.each_pixel(&mut recorder, &self.pipelines.splat_average, &inputs, &resources);
            }
            _ => {
                let resources: Vec<_> = std::iter::once(&nearest).chain(&splatted).cloned().collect();
                self.each_page_pixel(&mut recorder, &self.pipelines.splat_resolve, &inputs, &resources);
            }
        }
        let closed = targets.closed.views();
        let closed = closed.each_ref().map(wgpu::BindingResource::TextureView);
        if settings.splat.close_gaps {
            let resources: Vec<_> = splatted.iter().chain(&closed).cloned().collect();
            self.each_pixel(&mut recorder, &self.pipelines.close_gaps, &inputs, &resources);
        }
        let [albedo, normal, depth] = if settings.splat.close_gaps { closed } else { splatted };
        let [color, picture] =
            [&targets.color, &targets.picture].map(|texture| texture.create_view(&Default::default()));
        let [color, picture] = [&color, &picture].map(wgpu::BindingResource::TextureView);
        self.each_pixel(&mut recorder, &self.pipelines.shade, &inputs, &[albedo, normal, depth.clone(), color.clone()]);
        self.each_pixel(&mut recorder, &self.pipelines.present, &inputs, &[color, depth, picture]);

        let (passes, frame_milliseconds) = recorder.finish()?;
        let gpu_bytes = store.gpu_bytes() + targets.bytes();
        if let Some(targets) = &mut self.targets {
            targets.gaps_are_closed = settings.splat.close_gaps;
        }
        self.camera = Some(frame_camera);
        Ok(FrameStats {
            passes,
            frame_milliseconds,
            points_drawn: list.points,
            points_resident: store.points(),
            gpu_bytes,
            clock: self.gpu.clock,
        })
    }

    /// The last frame's picture: Rgba8Unorm holding sRGB values. Another texture after a change of size.
    pub fn picture(&self) -> Option<&wgpu::Texture> {
        self.targets.as_ref().map(|targets| &targets.picture)
    }

    /// The last frame's picture, RGBA8 sRGB, rows top to bottom.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read_picture(&self) -> Result<Vec<u8>> {
        self.gpu.read_texture(&self.rendered()?.picture)
    }

    /// One of the last frame's linear images.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read_aov(&self, aov: Aov) -> Result<AovImage> {
        let targets = self.rendered()?;
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let surface = targets.surface();
        let depth = floats32(&self.gpu.read_texture(&surface.depth)?);
        let per_pixel: Vec<f32> = match aov {
            Aov::Depth => depth.clone(),
            Aov::Normal => floats32(&self.gpu.read_texture(&surface.normal)?),
            Aov::Albedo | Aov::Mirror => floats16(&self.gpu.read_texture(&surface.albedo)?),
            Aov::Color => floats16(&self.gpu.read_texture(&targets.color)?),
            Aov::Position => Vec::new(),
        };
        let width = targets.size[0] as usize;
        let channels = aov.channels();
        let mut data = Vec::with_capacity(depth.len() * channels.len());
        for (pixel, &depth) in depth.iter().enumerate() {
            if depth == 0.0 {
                data.extend(channels.iter().map(|_| f32::NAN));
                continue;
            }
            match aov {
                Aov::Depth => data.push((f64::from(depth) - camera.moved_back) as f32),
                Aov::Mirror => data.push(if per_pixel[pixel * 4 + 3] > 0.0 { 1.0 } else { 0.0 }),
                Aov::Position => {
                    let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                    data.extend(camera.world_from_pixel(x, y, f64::from(depth)).as_vec3().to_array());
                }
                Aov::Normal | Aov::Albedo | Aov::Color => data.extend(&per_pixel[pixel * 4..pixel * 4 + 3]),
            }
        }
        Ok(AovImage { size: targets.size, channels, data })
    }

    /// The point drawn nearest to a pixel, at most `radius` pixels from it; where a gap was closed, one beside it.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn pick(&self, store: &PointStore, pixel: [u32; 2], radius: u32) -> Result<Option<Picked>> {
        let targets = self.rendered()?;
        let [width, height] = targets.size;
        if pixel[0] >= width || pixel[1] >= height {
            return Ok(None);
        }
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let radius = radius.max(1);
        let (top, bottom) = (pixel[1].saturating_sub(radius), (pixel[1] + radius).min(height - 1));
        let row_bytes = u64::from(width) * 8;
        let rows = u64::from(bottom - top + 1);
        let bytes = self.gpu.read_buffer(&targets.nearest, u64::from(top) * row_bytes, rows * row_bytes)?;
        let words: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
        let shown = floats32(&self.gpu.read_rows(&targets.surface().depth, top, bottom - top + 1)?);
        let (left, right) = (pixel[0].saturating_sub(radius), (pixel[0] + radius).min(width - 1));
        let mut best: Option<(u32, [u32; 2], [u32; 2])> = None;
        for y in top..=bottom {
            for x in left..=right {
                let place = ((y - top) * width + x) as usize;
                let word = words[place];
                // Behind a closed gap lies a point that is not seen.
                let same =
                    SAME_SURFACE * if camera.orthographic { camera.reference_depth as f32 } else { shown[place] };
                let is_seen = word[1] != 0 && f32::from_bits(u32::MAX - word[1]) <= shown[place] + same;
                let distance = x.abs_diff(pixel[0]).pow(2) + y.abs_diff(pixel[1]).pow(2);
                if is_seen && best.is_none_or(|(least, ..)| distance < least) {
                    best = Some((distance, [x, y], word));
                }
            }
        }
        let Some((_, pixel, [identity, nearness])) = best else { return Ok(None) };
        let linear_depth = f32::from_bits(u32::MAX - nearness);
        Ok(store.find(identity).map(|(cloud, chunk, index)| Picked { cloud, chunk, index, linear_depth, pixel }))
    }

    fn rendered(&self) -> Result<&Targets> {
        self.targets.as_ref().ok_or_else(nothing_rendered)
    }

    fn resize(&mut self, size: [u32; 2], quality: Quality) -> Result<()> {
        let size = size.map(|edge| edge.max(1));
        let limits = self.gpu.device.limits();
        let too_large = |what, bytes: u64, limit: u64| Error::TooLarge {
            what,
            bytes,
            limit,
            adapter: self.gpu.info.name.clone(),
            advice: "; ask for a smaller picture",
        };
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let edge = size[0].max(size[1]);
        if edge > limits.max_texture_dimension_2d {
            return Err(too_large("an edge of the picture", edge.into(), limits.max_texture_dimension_2d.into()));
        }
        if pixels * 16 > limits.max_storage_buffer_binding_size {
            return Err(too_large("the picture", pixels * 16, limits.max_storage_buffer_binding_size));
        }
        if self.targets.as_ref().is_none_or(|targets| targets.size != size) {
            self.targets = Some(Targets::new(&self.gpu.device, size));
        }
        if let Some(targets) =
            self.targets.as_mut().filter(|targets| quality == Quality::High && targets.sums.is_none())
        {
            targets.sums = Some([16, 16, 12, 16].map(|bytes| storage(&self.gpu.device, "sums", pixels * bytes)));
        }
        Ok(())
    }

    /// Compiles the variants of a pass over points that a frame needs.
    fn compile_over_points(&mut self, pass: &Pass, list: &DrawList) -> Result<()> {
        let kinds = |page: &PageDraw| [0, 1].map(|kind| (!page.blocks[kind].is_empty()).then_some(kind == 1));
        for pixels_only in list.pages.iter().flat_map(kinds).flatten() {
            let key = (pass.name, pixels_only, list.filter_classes);
            if !self.pipelines.over_points.contains_key(&key) {
                let switches = [("pixels_only", pixels_only), ("filter_classes", list.filter_classes)];
                let compiled = Compiled::new(&self.gpu.device, pass, &switches).map_err(Error::Shader)?;
                self.pipelines.over_points.insert(key, compiled);
            }
        }
        Ok(())
    }

    /// Runs a pass over the blocks of each page.
    fn each_page(
        &self,
        recorder: &mut Recorder<'_>,
        pass: &Pass,
        inputs: &Inputs,
        outputs: &[wgpu::BindingResource<'_>],
    ) {
        let lists = inputs.pages.iter().flat_map(|page| page.lists.iter().map(move |list| (page, list)));
        let dispatches = lists.filter_map(|(page, list)| {
            let compiled = self.pipelines.over_points.get(&(pass.name, list.pixels_only, inputs.filter_classes))?;
            // At most 65,535 groups a dimension.
            let x = list.block_count.clamp(1, 32_768);
            Some((
                compiled,
                inputs.page_resources(page, &list.page, &list.blocks),
                [x, list.block_count.div_ceil(x), 1],
            ))
        });
        self.dispatch(recorder, pass.name, dispatches, inputs, outputs);
    }

    /// Runs a pass over the pixels, once for each page.
    fn each_page_pixel(
        &self,
        recorder: &mut Recorder<'_>,
        pass: &Compiled,
        inputs: &Inputs,
        outputs: &[wgpu::BindingResource<'_>],
    ) {
        let resources = |page| inputs.page_resources(page, &page.page, &page.items_of_runs);
        let dispatches = inputs.pages.iter().map(|page| (pass, resources(page), inputs.pixel_groups()));
        self.dispatch(recorder, pass.name, dispatches, inputs, outputs);
    }

    fn dispatch<'a>(
        &self,
        recorder: &mut Recorder<'_>,
        name: &'static str,
        dispatches: impl Iterator<Item = (&'a Compiled, [wgpu::BindingResource<'a>; 8], [u32; 3])>,
        inputs: &Inputs,
        outputs: &[wgpu::BindingResource<'_>],
    ) {
        let device = &self.gpu.device;
        let bind = |(pass, page, groups): (&'a Compiled, [wgpu::BindingResource<'a>; 8], [u32; 3])| {
            let frame = pass.bind(device, 0, &inputs.frame_resources());
            (pass, [frame, pass.bind(device, 1, &page), pass.bind(device, 2, outputs)], groups)
        };
        let bound: Vec<_> = dispatches.map(bind).collect();
        recorder.pass(name, |compute| {
            for (pass, groups, [x, y, z]) in &bound {
                compute.set_pipeline(&pass.pipeline);
                for (index, group) in groups.iter().enumerate() {
                    compute.set_bind_group(index as u32, group, &[]);
                }
                compute.dispatch_workgroups(*x, *y, *z);
            }
        });
    }

    /// Runs a pass over the pixels.
    fn each_pixel(
        &self,
        recorder: &mut Recorder<'_>,
        pass: &Compiled,
        inputs: &Inputs,
        resources: &[wgpu::BindingResource<'_>],
    ) {
        let frame = pass.bind(&self.gpu.device, 0, &inputs.frame_resources());
        let resources = pass.bind(&self.gpu.device, 1, resources);
        let [x, y, z] = inputs.pixel_groups();
        recorder.pass(pass.name, |compute| {
            compute.set_pipeline(&pass.pipeline);
            compute.set_bind_group(0, &frame, &[]);
            compute.set_bind_group(1, &resources, &[]);
            compute.dispatch_workgroups(x, y, z);
        });
    }
}

/// Depths that differ by this share or less are of one surface: the constant of close_gaps.wgsl.
const SAME_SURFACE: f32 = 0.02;

fn nothing_rendered() -> Error {
    Error::Shader("nothing has been rendered yet".into())
}

impl Targets {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let texture = |label, format| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            })
        };
        let surface = || GBuffer {
            albedo: texture("albedo", wgpu::TextureFormat::Rgba16Float),
            normal: texture("normal", wgpu::TextureFormat::Rgba32Float),
            depth: texture("depth", wgpu::TextureFormat::R32Float),
        };
        Self {
            size,
            nearest: storage(device, "nearest", u64::from(size[0]) * u64::from(size[1]) * 8),
            sums: None,
            splatted: surface(),
            closed: surface(),
            gaps_are_closed: false,
            color: texture("color", wgpu::TextureFormat::Rgba16Float),
            picture: texture("picture", wgpu::TextureFormat::Rgba8Unorm),
        }
    }

    /// What the picture was made from.
    fn surface(&self) -> &GBuffer {
        if self.gaps_are_closed { &self.closed } else { &self.splatted }
    }

    fn bytes(&self) -> u64 {
        let sums = if self.sums.is_some() { 60 } else { 0 };
        u64::from(self.size[0]) * u64::from(self.size[1]) * (8 + sums + 2 * (8 + 16 + 4) + 8 + 4)
    }
}

fn storage(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn floats32(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

fn floats16(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(2).map(|b| half_to_f32(u16::from_le_bytes([b[0], b[1]]))).collect()
}

/// IEEE 754 binary16 to binary32.
fn half_to_f32(half: u16) -> f32 {
    let sign = if half & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(half >> 10 & 31), f32::from(half & 1023));
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f32.powi(exponent - 15),
    }
}

/// What a frame uploads.
struct Inputs {
    size: [u32; 2],
    frame: wgpu::Buffer,
    settings: wgpu::Buffer,
    items: wgpu::Buffer,
    class_masks: wgpu::Buffer,
    palette: wgpu::Buffer,
    filter_classes: bool,
    pages: Vec<PageInputs>,
}

struct PageInputs {
    page: wgpu::Buffer,
    points: wgpu::Buffer,
    attributes: wgpu::Buffer,
    scalars: wgpu::Buffer,
    items_of_runs: wgpu::Buffer,
    lists: Vec<ListInputs>,
}

/// Blocks of one page that one kernel draws.
struct ListInputs {
    page: wgpu::Buffer,
    blocks: wgpu::Buffer,
    block_count: u32,
    pixels_only: bool,
}

impl Inputs {
    fn new(gpu: &Gpu, camera: FrameCamera, settings: &Settings, store: &PointStore, list: &DrawList) -> Self {
        let upload = |label, usage, bytes: &[u8]| {
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: (bytes.len() as u64).max(128),
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
        let words: Vec<u32> = settings.groups().iter().flat_map(|group| group.words()).collect();
        let page = |first_identity, point_count, is_first, block_count: usize| {
            let page =
                Page { first_identity, block_count: block_count as u32, point_count, is_first: u32::from(is_first) };
            upload("page", uniform, bytemuck::bytes_of(&page))
        };
        let lists = |draw: &PageDraw| {
            let list = |(kind, blocks): (usize, &Vec<Block>)| ListInputs {
                page: page(draw.first_identity, draw.capacity, false, blocks.len()),
                blocks: upload("blocks", storage, bytemuck::cast_slice(blocks)),
                block_count: blocks.len() as u32,
                pixels_only: kind == 1,
            };
            draw.blocks.iter().enumerate().filter(|(_, blocks)| !blocks.is_empty()).map(list).collect()
        };
        let mut pages: Vec<PageInputs> = list
            .pages
            .iter()
            .enumerate()
            .map(|(index, draw)| PageInputs {
                page: page(draw.first_identity, draw.capacity, index == 0, 0),
                points: draw.points.clone(),
                attributes: draw.attributes.clone(),
                scalars: draw.scalars.clone(),
                items_of_runs: upload("items of runs", storage, bytemuck::cast_slice(&draw.items_of_runs)),
                lists: lists(draw),
            })
            .collect();
        if pages.is_empty() {
            // The passes over pixels still have to write "empty".
            let nothing = upload("nothing", storage, &[]);
            pages.push(PageInputs {
                page: page(0, 0, true, 0),
                points: nothing.clone(),
                attributes: nothing.clone(),
                scalars: nothing.clone(),
                items_of_runs: nothing,
                lists: Vec::new(),
            });
        }
        Self {
            size: camera.size,
            frame: upload("frame", uniform, bytemuck::bytes_of(&camera.to_gpu())),
            settings: upload("settings", storage, bytemuck::cast_slice(&words)),
            items: upload("items", storage, bytemuck::cast_slice(&list.items)),
            class_masks: upload("class masks", storage, bytemuck::cast_slice(&list.class_masks)),
            palette: upload("palette", storage, bytemuck::cast_slice(&store.palette())),
            filter_classes: list.filter_classes,
            pages,
        }
    }

    fn frame_resources(&self) -> [wgpu::BindingResource<'_>; 2] {
        [self.frame.as_entire_binding(), self.settings.as_entire_binding()]
    }

    /// Group 1 of the passes over points, in slot order; `runs` is the list of blocks, or that of the items of runs.
    fn page_resources<'a>(
        &'a self,
        page: &'a PageInputs,
        uniform: &'a wgpu::Buffer,
        runs: &'a wgpu::Buffer,
    ) -> [wgpu::BindingResource<'a>; 8] {
        [uniform, &page.points, &page.attributes, &page.scalars, &self.items, runs, &self.class_masks, &self.palette]
            .map(|buffer| buffer.as_entire_binding())
    }

    fn pixel_groups(&self) -> [u32; 3] {
        [self.size[0].div_ceil(8), self.size[1].div_ceil(8), 1]
    }
}

/// Records passes and times each of them: by GPU timestamps in one submit, or by the host's clock around a submit each.
struct Recorder<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    queries: Option<wgpu::QuerySet>,
    names: Vec<&'static str>,
    host_times: Vec<PassTime>,
    failure: Option<Error>,
}

/// Passes of a frame at most: a timestamp pair each.
const MOST_PASSES: u32 = 64;

impl<'a> Recorder<'a> {
    fn new(gpu: &'a Gpu) -> Self {
        let queries = (gpu.clock == Clock::Gpu).then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST_PASSES * 2,
            })
        });
        let encoder = gpu.device.create_command_encoder(&Default::default());
        Self { gpu, encoder, queries, names: Vec::new(), host_times: Vec::new(), failure: None }
    }

    fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.encoder.clear_buffer(buffer, 0, None);
        if self.queries.is_none() {
            self.submit("clear");
        }
    }

    fn pass(&mut self, name: &'static str, record: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        let first = self.names.len() as u32 * 2;
        let timestamp_writes = self.queries.as_ref().map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        });
        record(
            &mut self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes }),
        );
        self.names.push(name);
        if self.queries.is_none() {
            self.submit(name);
        }
    }

    fn submit(&mut self, name: &'static str) {
        let encoder = std::mem::replace(&mut self.encoder, self.gpu.device.create_command_encoder(&Default::default()));
        let commands = encoder.finish();
        let start = Instant::now();
        self.gpu.queue.submit([commands]);
        if let Err(error) = self.gpu.wait() {
            self.failure.get_or_insert(error);
        }
        let milliseconds = start.elapsed().as_secs_f64() * 1000.0;
        match self.host_times.iter_mut().find(|time| time.name == name) {
            Some(time) => time.milliseconds += milliseconds,
            None => self.host_times.push(PassTime { name, milliseconds }),
        }
    }

    /// Waits for the frame. Pass times in order, and the frame's.
    fn finish(self) -> Result<(Vec<PassTime>, f64)> {
        if let Some(error) = self.failure {
            return Err(error);
        }
        let Some(queries) = self.queries else {
            let total = self.host_times.iter().map(|time| time.milliseconds).sum();
            return Ok((self.host_times, total));
        };
        let count = self.names.len() as u32 * 2;
        let size = u64::from(count) * 8;
        let resolved = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pass times"),
            size,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = self.encoder;
        encoder.resolve_query_set(&queries, 0..count, &resolved, 0);
        self.gpu.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&self.gpu.read_buffer(&resolved, 0, size)?);
        let to_milliseconds = f64::from(self.gpu.queue.get_timestamp_period()) * 1e-6;
        let span = |from: u64, to: u64| to.saturating_sub(from) as f64 * to_milliseconds;
        let pairs = self.names.iter().zip(ticks.chunks_exact(2));
        let times = pairs.map(|(name, pair)| PassTime { name, milliseconds: span(pair[0], pair[1]) }).collect();
        let total = ticks.first().zip(ticks.last()).map_or(0.0, |(first, last)| span(*first, *last));
        Ok((times, total))
    }
}
