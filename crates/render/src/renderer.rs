//! A frame: which passes run in which order, on which images; pass times; what is read back.

use std::sync::Arc;

use glam::DVec3;
use scene::{Camera, Curve, LightView, Lighting, Method, Mirror, Quality, Settings, Show};

use crate::frame::{FrameCamera, Objects};
use crate::gi::{GlobalIllumination, Receiver, Sky};
use crate::gpu::{Clock, Error, Gpu, Result};
use crate::identities::Identities;
use crate::image::{Aov, AovImage};
use crate::inputs::Inputs;
use crate::layout::{CARRY_BYTES, COLOR_SUM_BYTES, SAME_SURFACE, SPECULAR_WORDS, SURFACE_SUM_BYTES};
use crate::light_views;
use crate::lighting::{DrawnMap, Lights};
use crate::method::{self, Views};
use crate::passes;
use crate::recorder::{PassTime, Pipelines, Recorder};
use crate::reflection::{self, ReflectionStats, Reflections, SurfaceImages};
use crate::store::{ChunkId, CloudId, DrawList, PointStore, Selection};
use crate::targets::{Image, Targets, storage};

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
    /// Where reflections were asked for.
    pub reflection: Option<ReflectionStats>,
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
    reflections: Option<Reflections>,
    lights: Lights,
    /// What the surfaces and reflections at hand were made from.
    kept: Option<Kept>,
    kept_shadows: Vec<DrawnMap>,
    pub(crate) gi: GlobalIllumination,
    /// There was some in the last frame.
    has_indirect: bool,
    /// Of the last frame.
    camera: Option<FrameCamera>,
    /// Whether the last frame's picture was mapped by the filmic curve.
    is_filmic: bool,
    /// The numbers that points had when the last frame was drawn.
    drawn: Arc<Identities>,
}

/// All that the surfaces and the reflected points of a frame depend on.
#[derive(Clone, PartialEq)]
struct Kept {
    camera: FrameCamera,
    /// Those that affect what is found; the others at their defaults.
    settings: Settings,
    /// Steps are counted, which are shown.
    counts_steps: bool,
    revision: u64,
    mirrors: Vec<Mirror>,
}

impl Kept {
    fn new(camera: FrameCamera, settings: &Settings, store: &PointStore, objects: Objects<'_>) -> Self {
        Self {
            camera,
            settings: settings.only(|field| field.affects.found),
            counts_steps: matches!(settings.reflection.show, Show::Steps | Show::Unconverged),
            revision: store.revision(),
            mirrors: objects.mirrors.to_vec(),
        }
    }
}

impl Renderer {
    /// Compiles the passes that every picture needs and runs each once on a tiny one: drivers compile at the first dispatch,
    /// on software Vulkan for seconds, so call this off the window's thread. Passes of reflections are compiled when they are
    /// first asked for.
    ///
    /// # Errors
    /// A shader is refused, or the device is lost.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self> {
        let lights = Lights::new(&gpu);
        let mut renderer = Self {
            gpu,
            pipelines: Pipelines::new(),
            targets: None,
            reflections: None,
            lights,
            kept: None,
            kept_shadows: Vec::new(),
            gi: GlobalIllumination::default(),
            has_indirect: false,
            camera: None,
            is_filmic: false,
            drawn: Arc::default(),
        };
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
            settings.reflection.method = Method::None;
            self.render(&store, &camera, &settings, Objects::default(), [8, 8])?;
        }
        (self.targets, self.reflections, self.kept) = (None, None, None);
        Ok(())
    }

    /// Forgets what is kept while nothing changes, so that the next frame is made from scratch. For measurements.
    pub fn forget(&mut self) {
        (self.kept, self.kept_shadows) = (None, Vec::new());
        if let Some(reflections) = &mut self.reflections {
            reflections.forget();
        }
        self.gi.forget();
    }

    /// Whether the frames that follow may be lit by the virtual lights at hand although points have come or gone since: all
    /// points are looked through to place them, which is for pictures that stay.
    pub fn let_light_lag(&mut self, may_lag: bool) {
        self.gi.may_lag = may_lag;
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
        objects: Objects<'_>,
        size: [u32; 2],
    ) -> Result<FrameStats> {
        self.resize(size, settings.splat.quality)?;
        let atomics64 = self.gpu.has_wide_atomics(&settings.splat);
        let bounds = store.bounds();
        let (center, radius) = if bounds.is_empty() { (camera.pivot, 1.0) } else { (bounds.center(), bounds.radius()) };
        let mut frame_camera = FrameCamera::new(camera, &settings.view, size, center, radius);
        let spheres = store.mirror_spheres(settings).chain(reflection::mirror_spheres(settings, objects.mirrors));
        // Splats reach at least as far as their smallest size, and closing a gap two pixels further.
        frame_camera.mirror_tiles = frame_camera.tiles_of(spheres, f64::from(settings.splat.min_pixels) * 0.5 + 2.0);
        let lights = Lights::mapped(settings, objects, camera, size, bounds);
        let asks = Kept::new(frame_camera, settings, store, objects);
        let is_kept = settings.reflection.keep && self.kept.as_ref() == Some(&asks);
        // Half a frame must not be kept if an error leaves it so, nor what methods drew in it.
        if let Some(reflections) = self.reflections.as_mut().filter(|_| self.kept.is_none()) {
            reflections.forget();
        }
        self.kept = None;
        self.drawn = store.identities().clone();
        let points_drawn = store.draw_list(&frame_camera, settings, Selection::Seen);

        let Self { gpu, targets, reflections, .. } = self;
        let (Some(targets), Some(reflections)) = (targets, reflections) else { return Err(nothing_rendered()) };
        let mut recorder = Recorder::new(gpu, &mut self.pipelines);
        let nothing = DrawList::default();
        let list = if is_kept { &nothing } else { &points_drawn };
        let inputs = Inputs::new(gpu, frame_camera, settings, store, list);
        if !is_kept {
            self.gi.surfaces_changed();
            let formulas = reflection::upload(gpu, settings, objects.mirrors, frame_camera.eye);
            draw_surface(&mut recorder, &inputs, settings, targets, formulas.as_ref(), atomics64)?;
            let camera_surface = SurfaceImages {
                albedo: &targets.surfaces[targets.shown].albedo,
                normal: &targets.surfaces[targets.shown].normal,
                position: &targets.position,
            };
            // What no mirror on the screen needs is not made ready.
            if Reflections::asked(settings) > 0 && !frame_camera.mirror_tiles.is_empty() {
                let everywhere = store.draw_list(&frame_camera, settings, method::supply(settings));
                let supply = Inputs::new(gpu, frame_camera, settings, store, &everywhere);
                reflections.find(
                    &mut recorder,
                    &supply,
                    settings,
                    store,
                    objects.mirrors,
                    formulas.as_ref(),
                    camera_surface,
                )?;
            } else {
                reflections.none();
            }
        }
        self.lights.upload(gpu, &lights, frame_camera.eye);
        let at_hand = std::mem::take(&mut self.kept_shadows);
        let kept_shadows = self.lights.draw_shadows(&mut recorder, store, settings, &lights, at_hand, atomics64)?;
        let shading = Shading::new(settings, store, objects, lights.len());
        let sky = (shading.lighting == Lighting::Sun).then_some(Sky { up: camera.up, irradiance: settings.sun.sky });
        let has_indirect = GlobalIllumination::is_asked(settings, &lights, sky);
        if has_indirect {
            let shadows = &self.lights.shadows;
            self.gi.place(&mut recorder, frame_camera, store, settings, &lights, sky, shadows)?;
        }
        let gi = has_indirect.then_some(&mut self.gi);
        shade(&mut recorder, &inputs, settings, targets, reflections, &self.lights, gi, shading)?;
        let is_filmic = match settings.tone.curve {
            // Data colours stay as they are.
            Curve::Auto => matches!(shading.lighting, Lighting::Lights | Lighting::Sun),
            curve => curve == Curve::Filmic,
        };
        match (reflections.views(), reflections.first()) {
            _ if settings.light.show != LightView::Picture => {
                let shown = light_views::FrameInputs {
                    targets,
                    lights: &self.lights,
                    mapped: &lights,
                    virtual_lights: self.gi.lights().filter(|_| has_indirect),
                    indirect: self.gi.radiance(0).filter(|_| has_indirect),
                    bounds,
                    is_filmic,
                };
                light_views::show(&mut recorder, &inputs, settings, &shown)?;
            }
            (views, Some(bounce)) if shows_more(settings, views.as_ref()) => {
                let [albedo_in, normal_in, position_in] = bounce.seen.bind();
                let bindings = passes::show {
                    color_in: targets.color.bind(),
                    point_in: bounce.mirror.point.bind(),
                    albedo_in,
                    normal_in,
                    position_in,
                    // What looks for views of a method that has none is not shown.
                    views_in: views.as_ref().map_or(&reflections.doubt, |views| views.image).bind(),
                    doubt_in: reflections.doubt.bind(),
                    picture_out: targets.picture.bind(),
                };
                let most_steps = views.as_ref().map_or(1, |views| views.most_steps);
                let switches = [("most_steps", most_steps), ("is_filmic", u32::from(is_filmic))];
                recorder.over_pixels(&switches, &inputs, bindings)?;
            }
            _ => {
                let bindings = targets.presented(&targets.color);
                recorder.over_pixels(&[("is_filmic", u32::from(is_filmic))], &inputs, bindings)?;
            }
        }

        let (passes, frame_milliseconds) = recorder.finish()?;
        let gpu_bytes =
            store.gpu_bytes() + targets.bytes() + reflections.bytes() + self.lights.shadows.size() + self.gi.bytes();
        let reflection = if Reflections::asked(settings) > 0 { Some(reflections.stats(gpu, settings)?) } else { None };
        self.has_indirect = has_indirect;
        (self.camera, self.kept, self.kept_shadows) = (Some(frame_camera), Some(asks), kept_shadows);
        self.is_filmic = is_filmic;
        Ok(FrameStats {
            passes,
            frame_milliseconds,
            points_drawn: points_drawn.points,
            points_resident: store.points(),
            gpu_bytes,
            clock: self.gpu.clock,
            reflection,
        })
    }

    /// The last frame's picture: Rgba8Unorm holding sRGB values. Another texture after a change of size.
    pub fn picture(&self) -> Option<&wgpu::Texture> {
        self.targets.as_ref().map(|targets| &targets.picture.texture)
    }

    /// The last frame's picture, RGBA8 sRGB, rows top to bottom.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read_picture(&self) -> Result<Vec<u8>> {
        self.gpu.read_texture(&self.rendered()?.picture.texture)
    }

    /// Makes the last frame's picture anew, of other colours: linear red, green and blue of each pixel, rows top to bottom.
    /// `store` and `settings` are those of the frame.
    ///
    /// # Errors
    /// Nothing was rendered yet, not a colour for each pixel, or the device was lost.
    pub fn present(&mut self, store: &PointStore, settings: &Settings, color: &[[f32; 3]]) -> Result<()> {
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let Self { gpu, targets: Some(targets), .. } = self else { return Err(nothing_rendered()) };
        let [width, height] = targets.size;
        if color.len() != width as usize * height as usize {
            return Err(Error::NotRendered(format!("{} colours for a picture of {width} x {height}", color.len())));
        }
        let image = Image::new(&gpu.device, targets.size, "color", wgpu::TextureFormat::Rgba32Float);
        let texels: Vec<[f32; 4]> = color.iter().map(|[red, green, blue]| [*red, *green, *blue, 1.0]).collect();
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 16), rows_per_image: Some(height) };
        let texture = &image.texture;
        gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, texture.size());
        let inputs = Inputs::new(gpu, camera, settings, store, &DrawList::default());
        let mut recorder = Recorder::new(gpu, &mut self.pipelines);
        let switches = [("is_filmic", u32::from(self.is_filmic))];
        recorder.over_pixels(&switches, &inputs, targets.presented(&image))?;
        recorder.finish()?;
        Ok(())
    }

    /// One of the last frame's linear images.
    ///
    /// # Errors
    /// Nothing was rendered yet, no reflections for an image of them, or the device was lost.
    pub fn read_aov(&self, aov: Aov) -> Result<AovImage> {
        self.read_aov_from(aov, DVec3::ZERO)
    }

    /// The same with positions from `origin`: 32-bit world coordinates of a survey are no finer than half a metre.
    ///
    /// # Errors
    /// As `read_aov`.
    pub fn read_aov_from(&self, aov: Aov, origin: DVec3) -> Result<AovImage> {
        let targets = self.rendered()?;
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let surface = targets.surface();
        let read = |image: &Image| self.gpu.read_texture(&image.texture);
        let depth = floats32(&read(&surface.depth)?);
        let bounce = self.reflections.as_ref().and_then(Reflections::first);
        if bounce.is_none() && aov.is_of_mirrors() {
            // No mirror could be seen.
            let values = depth.len() * aov.channels().len();
            return Ok(AovImage { size: targets.size, channels: aov.channels(), data: vec![f32::NAN; values] });
        }
        let first = || bounce.ok_or_else(nothing_rendered);
        let per_pixel: Vec<f32> = match aov {
            Aov::Depth => depth.clone(),
            Aov::Normal | Aov::SpecularPower => floats32(&read(&surface.normal)?),
            Aov::Albedo | Aov::Mirror | Aov::SpecularIntensity => floats16(&read(&surface.albedo)?),
            Aov::Color => floats16(&read(&targets.color)?),
            Aov::Direct => floats16(&read(&targets.direct)?),
            Aov::Indirect => match self.gi.radiance(0).filter(|_| self.has_indirect) {
                Some(radiance) => floats16(&read(radiance)?),
                None => vec![0.0; depth.len() * 4],
            },
            Aov::Position => Vec::new(),
            Aov::MirrorPosition => floats32(&read(&first()?.seen.position)?),
            Aov::MirrorAlbedo => floats16(&read(&first()?.seen.albedo)?),
            Aov::MirrorNormal => floats32(&read(&first()?.seen.normal)?),
            Aov::Curvature | Aov::Regions => floats32(&read(self.regions()?)?),
            // Four values a pixel, as the others have.
            Aov::Uncertain => {
                floats32(&read(self.doubt()?)?).into_iter().flat_map(|doubt| [doubt, 0.0, 0.0, 0.0]).collect()
            }
        };
        let coverage = match aov {
            Aov::MirrorAlbedo | Aov::MirrorNormal => floats32(&read(&first()?.seen.position)?),
            _ => Vec::new(),
        };
        let mirror = if aov.is_of_mirrors() { floats32(&read(&first()?.mirror.point)?) } else { Vec::new() };
        let is_mirror = |pixel: usize| mirror[pixel * 4 + 3] > 0.0;
        let width = targets.size[0] as usize;
        let channels = aov.channels();
        let mut data = Vec::with_capacity(depth.len() * channels.len());
        for (pixel, &depth) in depth.iter().enumerate() {
            let four = || &per_pixel[pixel * 4..pixel * 4 + 4];
            let is_empty = match aov {
                Aov::MirrorPosition => !is_mirror(pixel) || four()[3] == 0.0,
                Aov::MirrorAlbedo | Aov::MirrorNormal => !is_mirror(pixel) || coverage[pixel * 4 + 3] == 0.0,
                Aov::Curvature | Aov::Regions | Aov::Uncertain => !is_mirror(pixel),
                _ => depth == 0.0,
            };
            if is_empty {
                data.extend(channels.iter().map(|_| f32::NAN));
                continue;
            }
            match aov {
                Aov::Depth => data.push((f64::from(depth) - camera.moved_back) as f32),
                Aov::Mirror => data.push(if four()[3] > 0.0 { 1.0 } else { 0.0 }),
                Aov::SpecularIntensity | Aov::SpecularPower => data.push(four()[3]),
                Aov::Position => {
                    let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                    data.extend((camera.world_from_pixel(x, y, f64::from(depth)) - origin).as_vec3().to_array());
                }
                Aov::MirrorPosition => {
                    let from = camera.eye - origin;
                    let [x, y, z] = [0, 1, 2].map(|axis| (f64::from(four()[axis]) + from[axis]) as f32);
                    data.extend([x, y, z, four()[3]]);
                }
                // The highest bit only says that there is a mirror.
                Aov::Curvature => data.push(four()[0] - 128.0),
                Aov::Regions => data.push(four()[1]),
                Aov::Uncertain => data.push(four()[0]),
                _ => data.extend(&four()[..3]),
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
        let shown = floats32(&self.gpu.read_rows(&targets.surface().depth.texture, top, bottom - top + 1)?);
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
        Ok(store.find(identity, &self.drawn).map(|(cloud, chunk, index)| Picked {
            cloud,
            chunk,
            index,
            linear_depth,
            pixel,
        }))
    }

    /// Curvature and regions of the mirror pixels of the last frame.
    fn regions(&self) -> Result<&Image> {
        let views = self.reflections.as_ref().and_then(Reflections::views).filter(|views| views.has_regions);
        let image = views.map(|views| views.image);
        image.ok_or_else(|| Error::NotRendered("only the method sscr has a curvature map and regions".into()))
    }

    fn doubt(&self) -> Result<&Image> {
        self.reflections.as_ref().map(|reflections| &reflections.doubt).ok_or_else(nothing_rendered)
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
            self.reflections = Some(Reflections::new(&self.gpu.device, size));
            self.kept = None;
        }
        if let Some(targets) =
            self.targets.as_mut().filter(|targets| quality == Quality::High && targets.sums.is_none())
        {
            targets.sums = Some(
                [COLOR_SUM_BYTES, SURFACE_SUM_BYTES, SPECULAR_WORDS * 4, CARRY_BYTES]
                    .map(|bytes| storage(&self.gpu.device, "sums", pixels * bytes)),
            );
        }
        Ok(())
    }
}

/// Splats the points as the camera sees them, closes gaps, and places each pixel in the world.
fn draw_surface(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    settings: &Settings,
    targets: &mut Targets,
    formulas: Option<&wgpu::Buffer>,
    atomics64: bool,
) -> Result<()> {
    recorder.clear(&targets.nearest);
    let nearest = targets.nearest.as_entire_binding();
    recorder.nearest_points(&[], inputs, nearest.clone(), atomics64)?;
    let [albedo, normal, depth] = targets.surfaces[0].bind();
    match (settings.splat.quality, &targets.sums) {
        (Quality::High, Some(sums)) => {
            for buffer in sums {
                recorder.clear(buffer);
            }
            let [color_sums, surface_sums, specular_sums, carries] =
                sums.each_ref().map(|sums| sums.as_entire_binding());
            let bindings = passes::splat_accumulate {
                nearest: nearest.clone(),
                color_sums: color_sums.clone(),
                surface_sums: surface_sums.clone(),
                specular_sums: specular_sums.clone(),
                carries: carries.clone(),
            };
            recorder.over_points(&[], inputs, bindings)?;
            let bindings = passes::splat_average {
                nearest,
                color_sums,
                surface_sums,
                specular_sums,
                carries,
                albedo_out: albedo.clone(),
                normal_out: normal.clone(),
                depth_out: depth.clone(),
            };
            recorder.over_pixels(&[], inputs, bindings)?;
        }
        _ => {
            let bindings = passes::splat_resolve {
                nearest,
                albedo_out: albedo.clone(),
                normal_out: normal.clone(),
                depth_out: depth.clone(),
            };
            recorder.over_page_pixels(inputs, bindings, inputs.pixel_groups())?;
        }
    }
    targets.shown = 0;
    if settings.splat.close_gaps {
        let [albedo_out, normal_out, depth_out] = targets.surfaces[1].bind();
        let bindings = passes::close_gaps {
            albedo_in: albedo,
            normal_in: normal,
            depth_in: depth,
            albedo_out,
            normal_out,
            depth_out,
        };
        recorder.over_pixels(&[], inputs, bindings)?;
        targets.shown = 1;
    }
    if let Some(formulas) = formulas {
        let (from, to) = (targets.surface(), &targets.surfaces[1 - targets.shown]);
        for (from, to) in [(&from.albedo, &to.albedo), (&from.normal, &to.normal), (&from.depth, &to.depth)] {
            recorder.copy(from, to);
        }
        let [albedo_out, normal_out, depth_out] = to.bind();
        let bindings = passes::mirror_exact {
            depth_in: from.depth.bind(),
            mirrors: formulas.as_entire_binding(),
            albedo_out,
            normal_out,
            depth_out,
        };
        recorder.over_mirrors(&[], inputs, bindings)?;
        targets.shown = 1 - targets.shown;
    }
    let bindings =
        passes::camera_position { depth_in: targets.surface().depth.bind(), position_out: targets.position.bind() };
    recorder.over_pixels(&[], inputs, bindings)
}

/// What decides how surfaces are shaded, beside the parameters.
#[derive(Clone, Copy)]
struct Shading {
    /// Not auto.
    lighting: Lighting,
    /// With shadow maps; of a sun, its maps.
    light_count: u32,
    has_highlights: bool,
}

impl Shading {
    fn new(settings: &Settings, store: &PointStore, objects: Objects<'_>, light_count: usize) -> Self {
        let lighting = Lights::chosen(settings, objects);
        let is_lit = matches!(lighting, Lighting::Lights | Lighting::Sun);
        let shows_highlights = |mirror: &Mirror| mirror.specular_intensity > 0.0 && mirror.specular_power > 0.0;
        let is_glossy =
            settings.light.gloss > 0.0 || store.has_highlights() || objects.mirrors.iter().any(shows_highlights);
        Self { lighting, light_count: light_count as u32, has_highlights: is_lit && is_glossy }
    }
}

/// Shades what the camera sees and what each bounce sees, and blends them from the last bounce to the camera.
fn shade(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    settings: &Settings,
    targets: &Targets,
    reflections: &Reflections,
    lights: &Lights,
    mut gi: Option<&mut GlobalIllumination>,
    shading: Shading,
) -> Result<()> {
    let camera = SurfaceImages {
        albedo: &targets.surface().albedo,
        normal: &targets.surface().normal,
        position: &targets.position,
    };
    let bounces = &reflections.bounces[..reflections.count];
    let surfaces: Vec<SurfaceImages<'_>> =
        std::iter::once(camera).chain(bounces.iter().map(|bounce| bounce.surface())).collect();
    let radiance: Vec<&Image> =
        std::iter::once(&targets.direct).chain(bounces.iter().map(|bounce| &bounce.radiance)).collect();
    for (index, (surface, radiance)) in surfaces.iter().zip(&radiance).enumerate() {
        // Seen from the camera, or from the mirror point before.
        let from = if index == 0 { &targets.position } else { &bounces[index - 1].mirror.point };
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("lighting", shading.lighting as u32),
            ("light_count", shading.light_count),
            ("is_mixed", u32::from(index < bounces.len())),
            ("has_highlights", u32::from(shading.has_highlights)),
        ];
        let bindings = passes::shade {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            lights: lights.lights.as_entire_binding(),
            shadows: lights.shadows.as_entire_binding(),
            radiance_out: radiance.bind(),
        };
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        recorder.over(&switches, inputs, bindings, groups)?;
        if let Some(gi) = &mut gi {
            let receiver = Receiver {
                index,
                surface: *surface,
                from,
                is_mixed: index < bounces.len(),
                is_glossy: shading.has_highlights,
            };
            gi.shade(recorder, inputs, settings, &receiver)?;
        }
    }
    // From the last bounce on, what is reflected is added to what reflects it.
    let mut reflected: Option<&Image> = None;
    for index in (0..surfaces.len()).rev() {
        let surface = surfaces[index];
        let from = if index == 0 { &targets.position } else { &bounces[index - 1].mirror.point };
        let target = match index {
            0 => &targets.color,
            _ => &bounces[index - 1].blended,
        };
        let indirect = gi.as_ref().and_then(|gi| gi.radiance(index));
        let seen = bounces.get(index).map_or(surface.position, |bounce| &bounce.seen.position);
        let bindings = passes::blend {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            radiance_in: radiance[index].bind(),
            seen_in: seen.bind(),
            reflected_in: reflected.unwrap_or(radiance[index]).bind(),
            indirect_in: indirect.unwrap_or(radiance[index]).bind(),
            color_out: target.bind(),
        };
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("has_reflection", u32::from(reflected.is_some())),
            ("has_indirect", u32::from(indirect.is_some())),
        ];
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        recorder.over(&switches, inputs, bindings, groups)?;
        reflected = Some(target);
    }
    Ok(())
}

/// Whether something is shown instead of the picture. Not all methods have views of their work.
fn shows_more(settings: &Settings, views: Option<&Views<'_>>) -> bool {
    match settings.reflection.show {
        Show::Picture => false,
        Show::Curvature | Show::Regions | Show::Steps | Show::Unconverged => views.is_some(),
        Show::Uncertain | Show::Coverage | Show::Distance | Show::Albedo | Show::Normal | Show::Position => true,
    }
}

fn nothing_rendered() -> Error {
    Error::NotRendered("nothing has been rendered yet".into())
}

fn floats32(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

fn floats16(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
}
