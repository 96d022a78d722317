//! Reflections. A method answers one question for every mirror pixel: which scene point does the reflected eye ray see? It
//! answers by filling a Mirror G-Buffer. What comes after that, shading and blending, and the next bounce, knows nothing of
//! the method.
//!
//! Forward methods take points to pixels and share the splatting of `forward`; gather methods take pixels to points and share
//! `gather`. To add a method: a module with a `run` function, its shaders, and a line in `Methods::run` and `Reflections::views`.

#[cfg(test)]
mod beam;
mod environment_map;
mod formula;
mod forward;
mod gather;
mod mirror_places;
mod mirrored_viewpoint;
mod sscr;
mod surfel_index;
mod surfel_trace;
mod surfel_tree;

use scene::{Method, Mirror, Settings};

use environment_map::EnvironmentMap;
pub(crate) use formula::{mirror_spheres, upload};
use forward::Forward;
use gather::Gather;
use mirrored_viewpoint::MirroredViewpoint;
use sscr::Sscr;
use surfel_index::SurfelIndex;

use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::layout::{
    CLOSED_PIXELS, COUNTERS, DISCS_TESTED, DOUBTED_PIXELS, FOUND_PIXELS, MIRROR_PIXELS, NODES_TESTED, POINTS_FOUND,
    POINTS_TRIED, POINTS_UNCONVERGED, REGIONS,
};
use crate::passes;
use crate::recorder::Recorder;
use crate::store::{PointStore, Selection};
use crate::targets::{Image, storage};

/// The mirror pixels of one bounce, as the methods see them. All images are picture-sized.
pub(crate) struct MirrorSurface {
    /// xyz: P relative to the camera's eye, world axes. w: specular intensity; 0 where there is no mirror.
    pub point: Image,
    /// xyz: where the ray to P came from, relative to the camera's eye. w: linear depth of P as seen from there.
    pub eye: Image,
}

/// What is seen by reflection at each pixel: the Mirror G-Buffer.
pub(crate) struct MirrorGBuffer {
    /// Linear albedo of Q; its specular intensity.
    pub albedo: Image,
    /// World normal at Q towards P; specular power.
    pub normal: Image,
    /// Q relative to the camera's eye, world axes. w: coverage; 0 none, 1 found, between: closed from neighbours.
    pub position: Image,
}

impl MirrorGBuffer {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            albedo: Image::new(device, size, "mirror albedo", wgpu::TextureFormat::Rgba16Float),
            normal: Image::new(device, size, "mirror normal", wgpu::TextureFormat::Rgba32Float),
            position: Image::new(device, size, "mirror position", wgpu::TextureFormat::Rgba32Float),
        }
    }

    pub fn bind(&self) -> [wgpu::BindingResource<'_>; 3] {
        [self.albedo.bind(), self.normal.bind(), self.position.bind()]
    }

    pub fn bytes(&self) -> u64 {
        [&self.albedo, &self.normal, &self.position].map(Image::bytes).iter().sum()
    }
}

/// One bounce.
pub(crate) struct Bounce {
    pub mirror: MirrorSurface,
    pub seen: MirrorGBuffer,
    /// Radiance of what is seen, before and after further reflections are added.
    pub radiance: Image,
    pub blended: Image,
}

/// A surface that light bounces off: the camera's G-buffer, or the Mirror G-Buffer of the bounce before.
#[derive(Clone, Copy)]
pub(crate) struct SurfaceImages<'a> {
    pub albedo: &'a Image,
    pub normal: &'a Image,
    pub position: &'a Image,
}

impl Bounce {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let image = |label, format| Image::new(device, size, label, format);
        Self {
            mirror: MirrorSurface {
                point: image("mirror point", wgpu::TextureFormat::Rgba32Float),
                eye: image("mirror eye", wgpu::TextureFormat::Rgba32Float),
            },
            seen: MirrorGBuffer::new(device, size),
            radiance: image("mirror radiance", wgpu::TextureFormat::Rgba16Float),
            blended: image("mirror blended", wgpu::TextureFormat::Rgba16Float),
        }
    }

    pub fn surface(&self) -> SurfaceImages<'_> {
        SurfaceImages { albedo: &self.seen.albedo, normal: &self.seen.normal, position: &self.seen.position }
    }

    fn bytes(&self) -> u64 {
        let Self { mirror, seen, radiance, blended } = self;
        seen.bytes() + [&mirror.point, &mirror.eye, radiance, blended].map(Image::bytes).iter().sum::<u64>()
    }
}

/// What a frame's reflections found, of the first bounce.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReflectionStats {
    pub mirror_pixels: u32,
    /// Share of the mirror pixels in which a point was found.
    pub coverage: f64,
    /// With those closed from their neighbours.
    pub closed_coverage: f64,
    /// Share of the points that were tried and found a pixel (forward methods).
    pub hit_rate: Option<f64>,
    /// Share of the points that were tried whose search ran out of steps (SSCR).
    pub unconverged: Option<f64>,
    /// Regions of the mirror pixels (SSCR).
    pub regions: Option<u32>,
    /// Nodes and discs that a ray was tested against, on average; known while steps are shown.
    pub tests_per_ray: Option<[f64; 2]>,
    /// Share of the mirror pixels that were filled by something that is not to be trusted: closed from neighbours, more than a pixel
    /// beside the reflected ray, or alone among neighbours that show other surfaces.
    pub uncertain: f64,
    pub bounces: u32,
}

/// What a method works on and with.
pub(crate) struct Task<'a> {
    /// All visible points, whether or not the camera sees them.
    pub supply: &'a Inputs,
    pub settings: &'a Settings,
    pub store: &'a PointStore,
    /// All that have a formula.
    pub mirrors: &'a [Mirror],
    /// 0 for what the camera sees by one reflection.
    pub bounce: usize,
    pub mirror: &'a MirrorSurface,
    /// xyz: unit normal towards where the ray came from. w: specular power.
    pub normal: &'a Image,
    pub seen: &'a MirrorGBuffer,
    /// Mirrors that are drawn by their formula.
    pub formulas: Option<&'a wgpu::Buffer>,
    /// `COUNTERS` words, counted up by the methods, read when the frame is done.
    pub counters: &'a wgpu::Buffer,
}

/// The methods, with what each keeps from frame to frame.
#[derive(Default)]
struct Methods {
    size: [u32; 2],
    index: SurfelIndex,
    environment: EnvironmentMap,
    mirrored: MirroredViewpoint,
    gather: Option<Gather>,
    forward: Option<Forward>,
    sscr: Option<Sscr>,
}

impl Methods {
    fn bytes(&self) -> u64 {
        let Self { size: _, index, environment, mirrored, gather, forward, sscr } = self;
        index.bytes()
            + environment.bytes()
            + mirrored.bytes()
            + gather.as_ref().map_or(0, Gather::bytes)
            + forward.as_ref().map_or(0, Forward::bytes)
            + sscr.as_ref().map_or(0, Sscr::bytes)
    }

    /// # Errors
    /// A shader is refused, or there is no memory.
    fn run(&mut self, recorder: &mut Recorder<'_>, method: Method, task: &Task<'_>) -> Result<()> {
        match method {
            Method::None | Method::Auto => Ok(()),
            Method::EnvironmentMap => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.environment.run(recorder, gather, task)
            }
            Method::MirroredViewpoint => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.mirrored.run(recorder, gather, task)
            }
            Method::SurfelTrace | Method::SscrHierarchical => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                let use_beams = method == Method::SscrHierarchical;
                surfel_trace::run(recorder, &mut self.index, gather, task, use_beams)
            }
            Method::Sscr => {
                let forward = made(&mut self.forward, || Forward::new(recorder.gpu, self.size))?;
                let sscr = made(&mut self.sscr, || Sscr::new(recorder.gpu, self.size))?;
                sscr.run(recorder, forward, task)
            }
        }
    }
}

/// What is in `place`, made if it is empty.
fn made<T>(place: &mut Option<T>, make: impl FnOnce() -> Result<T>) -> Result<&mut T> {
    let value = match place.take() {
        Some(value) => value,
        None => make()?,
    };
    Ok(place.insert(value))
}

/// What `auto` stands for.
fn chosen(method: Method) -> Method {
    if method == Method::Auto { Method::SscrHierarchical } else { method }
}

/// What a frame's method needs of the points. Forward methods see mirrors only by their samples; gather methods meet the
/// formula where there is one.
pub(crate) fn supply(settings: &Settings) -> Selection {
    match chosen(settings.reflection.method) {
        Method::Sscr => Selection::EverywhereWithMirrors,
        _ => Selection::Everywhere,
    }
}

/// The bounces of a frame and what finds them.
pub(crate) struct Reflections {
    size: [u32; 2],
    pub bounces: Vec<Bounce>,
    /// Those of the last frame that reflections were looked for in.
    pub count: usize,
    methods: Methods,
    counters: wgpu::Buffer,
    /// Which pixels of the first bounce are not to be trusted; see shaders/mirror_doubt.wgsl.
    pub doubt: Image,
}

impl Reflections {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let counters = storage(device, "counters", COUNTERS as u64 * 4);
        let doubt = Image::new(device, size, "doubt", wgpu::TextureFormat::R32Float);
        Self { size, bounces: Vec::new(), count: 0, methods: Methods { size, ..Default::default() }, counters, doubt }
    }

    /// How many bounces the settings ask for.
    pub fn asked(settings: &Settings) -> usize {
        if settings.reflection.method == Method::None { 0 } else { settings.reflection.bounces as usize }
    }

    /// Forgets what methods keep from frame to frame.
    pub fn forget(&mut self) {
        self.methods.environment.forget();
        self.methods.sscr.iter_mut().for_each(Sscr::forget);
    }

    /// For a frame in which no mirror can be seen.
    pub fn none(&mut self) {
        self.count = 0;
    }

    /// Fills the Mirror G-Buffer of each bounce.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn find(
        &mut self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        settings: &Settings,
        store: &PointStore,
        mirrors: &[Mirror],
        formulas: Option<&wgpu::Buffer>,
        camera: SurfaceImages<'_>,
    ) -> Result<()> {
        let method = chosen(settings.reflection.method);
        self.count = Self::asked(settings);
        while self.bounces.len() < self.count {
            self.bounces.push(Bounce::new(&recorder.gpu.device, self.size));
        }
        self.bounces.truncate(self.count);
        recorder.clear(&self.counters);
        for index in 0..self.count {
            let (before, rest) = self.bounces.split_at(index);
            let bounce = &rest[0];
            let surface = before.last().map_or(camera, Bounce::surface);
            // Where the rays came from: the camera, or the mirror points of the bounce before.
            let from = before.last().map_or(camera.position, |before| &before.mirror.point);
            let bindings = passes::mirror_surface {
                albedo_in: surface.albedo.bind(),
                position_in: surface.position.bind(),
                from_in: from.bind(),
                point_out: bounce.mirror.point.bind(),
                eye_out: bounce.mirror.eye.bind(),
            };
            let first = [("from_camera", u32::from(index == 0))];
            recorder.over_pixels(&first, supply, bindings)?;
            let task = Task {
                supply,
                settings,
                store,
                mirrors,
                bounce: index,
                mirror: &bounce.mirror,
                normal: surface.normal,
                seen: &bounce.seen,
                formulas,
                counters: &self.counters,
            };
            self.methods.run(recorder, method, &task)?;
            if index == 0 {
                let bindings = passes::mirror_doubt {
                    point_in: bounce.mirror.point.bind(),
                    normal_in: surface.normal.bind(),
                    eye_in: bounce.mirror.eye.bind(),
                    seen_in: bounce.seen.position.bind(),
                    seen_normal_in: bounce.seen.normal.bind(),
                    doubt_out: self.doubt.bind(),
                    counters: self.counters.as_entire_binding(),
                };
                recorder.over_mirrors(&[], supply, bindings)?;
            }
        }
        Ok(())
    }

    /// # Errors
    /// The device was lost.
    pub fn stats(&self, gpu: &crate::Gpu, settings: &Settings) -> Result<ReflectionStats> {
        let bounces = Self::asked(settings) as u32;
        if self.count == 0 {
            return Ok(ReflectionStats { bounces, ..Default::default() });
        }
        let bytes = gpu.read_buffer(&self.counters, 0, COUNTERS as u64 * 4)?;
        let counters: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        let share = |part: u32, whole: u32| if whole == 0 { 0.0 } else { f64::from(part) / f64::from(whole) };
        let pixels = counters[MIRROR_PIXELS];
        let tried = counters[POINTS_TRIED];
        Ok(ReflectionStats {
            mirror_pixels: pixels,
            coverage: share(counters[FOUND_PIXELS], pixels),
            closed_coverage: share(counters[FOUND_PIXELS] + counters[CLOSED_PIXELS], pixels),
            hit_rate: (tried > 0).then(|| share(counters[POINTS_FOUND], tried)),
            unconverged: (tried > 0).then(|| share(counters[POINTS_UNCONVERGED], tried)),
            tests_per_ray: (counters[NODES_TESTED] > 0)
                .then(|| [counters[NODES_TESTED], counters[DISCS_TESTED]].map(|tests| share(tests, pixels))),
            uncertain: share(counters[DOUBTED_PIXELS], pixels),
            regions: (counters[REGIONS] > 0).then_some(counters[REGIONS]),
            bounces,
        })
    }

    pub fn bytes(&self) -> u64 {
        self.bounces.iter().map(Bounce::bytes).sum::<u64>() + self.methods.bytes() + self.doubt.bytes()
    }

    /// How the last frame's method came to its result; x and y (curvature, label) only of SSCR.
    pub fn views(&self, settings: &Settings) -> Option<&Image> {
        match chosen(settings.reflection.method) {
            Method::None | Method::Auto => None,
            Method::Sscr => self.methods.sscr.as_ref().map(|sscr| &sscr.views),
            Method::EnvironmentMap | Method::MirroredViewpoint | Method::SurfelTrace | Method::SscrHierarchical => {
                self.methods.gather.as_ref().map(|gather| &gather.views)
            }
        }
    }

    /// Of the last frame; none where no mirror could be seen.
    pub fn first(&self) -> Option<&Bounce> {
        self.bounces[..self.count].first()
    }
}
