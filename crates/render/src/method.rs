//! Runs the rows of `scene::METHODS`: an arm of `Methods::run` for each, which also says where the views of its work
//! are.

use scene::{CameraCells, Method, ScreenRest, Settings, Show, Supply};

use crate::gpu::{Error, Gpu, Result};
use crate::identities::ChunkId;
use crate::recorder::Recorder;
use crate::reflection::cubemap_trace::CubemapTrace;
use crate::reflection::environment_map::EnvironmentMap;
use crate::reflection::forward::Forward;
use crate::reflection::gather::Gather;
use crate::reflection::kept_hits::KnownRays;
use crate::reflection::light_field::{self, LightField};
use crate::reflection::mirrored_viewpoint::MirroredViewpoint;
use crate::reflection::sample_cameras::SampleCameras;
use crate::reflection::screen_trace::ScreenTrace;
use crate::reflection::sscr::Sscr;
use crate::reflection::surfel_index::SurfelIndex;
use crate::reflection::surfel_trace::{self, Rays};
use crate::reflection::task::Task;
use crate::store::draw_list::Selection;
use crate::targets::Image;

/// What mirrors of a hurried frame reflect, as shares of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReflectedShare {
    /// The share of the points that a method searches for or draws into maps.
    pub points: f64,
    /// The share of the texels of maps.
    pub texels: f64,
    /// The share of the mirror pixels; the others take over what these show.
    pub pixels: f64,
}

impl ReflectedShare {
    pub const ALL: Self = Self { points: 1.0, texels: 1.0, pixels: 1.0 };
}

/// The methods, with the state that each keeps from frame to frame.
#[derive(Default)]
pub(crate) struct Methods {
    size: [u32; 2],
    pub index: SurfelIndex,
    pub(crate) environment: EnvironmentMap,
    pub(crate) cubemaps: CubemapTrace,
    pub(crate) screen: ScreenTrace,
    mirrored: MirroredViewpoint,
    pub(crate) gather: Option<Gather>,
    forward: Option<Forward>,
    /// Buffers of four words a pixel that nobody else needs while reflections are searched, if there are any.
    pub(crate) lent: Option<[wgpu::Buffer; 3]>,
    sscr: Option<Sscr>,
    pub(crate) cameras: SampleCameras,
    pub(crate) light_field: LightField,
    /// The views of the method that ran last.
    views: Option<Origin>,
    /// Whether the method that ran last keeps the hits of its rays.
    keeps_hits: bool,
    /// Whether the method that ran last counts rays that it does not resolve.
    leaves_rays: bool,
    /// Whether one of several methods does.
    any_leaves_rays: bool,
}

/// The method that made the views.
#[derive(Clone, Copy)]
enum Origin {
    Gather,
    Sscr,
}

/// Images that show how a method came to its result, pixel by pixel.
pub(crate) struct Views<'a> {
    /// x and y: curvature and label, if there are regions. z: steps, or tests of a ray. w: share of searches that were
    /// given up.
    pub image: &'a Image,
    /// The number of steps that is shown as the maximum.
    pub most_steps: u32,
    /// Whether there are a curvature map and regions.
    pub has_regions: bool,
}

impl Methods {
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, ..Self::default() }
    }

    /// Empty methods for pictures of another size. The trees over the points and the maps around mirrors do not depend on
    /// the size: they are kept.
    pub fn resized(self, size: [u32; 2]) -> Self {
        let Self { index, environment, cubemaps, light_field, .. } = self;
        Self { size, index, environment, cubemaps, light_field, ..Self::default() }
    }

    /// Gives up the images and buffers of the picture's size that none of these methods needs: at 3840 x 2160 they are
    /// gigabytes. The trees over the points and the maps around mirrors stay, because making them takes long.
    pub fn keep_images_of(&mut self, methods: &[Method]) {
        let uses = |any: &[Method]| methods.iter().any(|method| any.contains(method));
        if !uses(&[Method::Sscr]) {
            self.sscr = None;
        }
        if !uses(&[Method::Sscr, Method::SampleCameras]) {
            self.forward = None;
        }
        if !uses(&[Method::SampleCameras]) {
            self.cameras = SampleCameras::default();
        }
        if !uses(&[Method::ScreenTrace]) {
            self.screen = ScreenTrace::default();
        }
        if !uses(&[Method::CubemapTrace, Method::ScreenTrace]) {
            self.cubemaps.rest = None;
        }
        if !uses(&[Method::LightField]) {
            self.light_field.rest = None;
        }
        if !uses(&[Method::MirroredViewpoint]) {
            self.mirrored = MirroredViewpoint::default();
        }
        if methods.iter().all(|method| matches!(method, Method::Sscr | Method::None | Method::Auto)) {
            self.gather = None;
        }
    }

    /// Fills the Mirror G-Buffer of a task of its own, whose rays are not those of the frame, with what they meet of
    /// `chunks`, as `surfel_trace` does.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory for the index.
    pub fn trace(
        &mut self,
        recorder: &mut Recorder<'_>,
        gather: &Gather,
        task: &Task<'_>,
        chunks: &[ChunkId],
        rays: Rays<'_>,
    ) -> Result<()> {
        surfel_trace::search(recorder, &mut self.index, gather, task, chunks, rays)?;
        gather.resolve(recorder, task)
    }

    /// Finds what the mirror pixels of a bounce see; `known` says what some rays meet.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        method: Method,
        task: &Task<'_>,
        known: Option<&KnownRays<'_>>,
    ) -> Result<()> {
        self.keeps_hits = matches!(method, Method::CubemapTrace | Method::SurfelTrace | Method::SscrHierarchical);
        self.leaves_rays =
            matches!(method, Method::CubemapTrace | Method::ScreenTrace | Method::SampleCameras | Method::LightField);
        self.views = match method {
            // The method that `auto` resolves to runs in its place.
            Method::Auto | Method::None => None,
            Method::EnvironmentMap => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.environment.run(recorder, gather, task)?;
                Some(Origin::Gather)
            }
            Method::MirroredViewpoint => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.mirrored.run(recorder, gather, task)?;
                Some(Origin::Gather)
            }
            Method::CubemapTrace | Method::ScreenTrace | Method::SurfelTrace | Method::SscrHierarchical => {
                let Self { index, cubemaps, screen, environment, gather, .. } = self;
                let gather = gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                if !known.is_some_and(|known| known.all) {
                    let task = &Task { mirror: known.and_then(|known| known.unknown).unwrap_or(task.mirror), ..*task };
                    match method {
                        Method::CubemapTrace => cubemaps.search(recorder, index, gather, task)?,
                        Method::ScreenTrace => screen.search(recorder, index, cubemaps, gather, task)?,
                        _ => {
                            let rays = if method == Method::SscrHierarchical { Rays::InBeams } else { Rays::All };
                            surfel_trace::search(recorder, index, gather, task, &task.supply.chunks, rays)?;
                        }
                    }
                }
                if let Some(known) = known {
                    known.exchange(recorder, gather, task)?;
                }
                if method == Method::ScreenTrace {
                    ScreenTrace::resolve(recorder, environment, gather, task)?;
                } else {
                    gather.resolve(recorder, task)?;
                }
                Some(Origin::Gather)
            }
            Method::Sscr => {
                let forward = forward_of(&mut self.forward, recorder.gpu, self.size, self.lent.as_ref())?;
                let sscr = made(&mut self.sscr, || Sscr::new(recorder.gpu, self.size))?;
                sscr.run(recorder, forward, task)?;
                Some(Origin::Sscr)
            }
            Method::SampleCameras => {
                let forward = forward_of(&mut self.forward, recorder.gpu, self.size, self.lent.as_ref())?;
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.cameras.run(recorder, &mut self.index, gather, forward, task)?;
                // The places in `forward` are no longer those of its last frame.
                self.sscr.iter_mut().for_each(Sscr::forget);
                None
            }
            Method::LightField => {
                let gather = self.gather.get_or_insert_with(|| Gather::new(&recorder.gpu.device, self.size));
                self.light_field.run(recorder, &mut self.index, &mut self.environment, gather, task)?;
                Some(Origin::Gather)
            }
        };
        Ok(())
    }

    /// Begins a bounce whose pixels several methods share.
    pub fn begin_parts(&mut self) {
        self.any_leaves_rays = false;
    }

    /// Runs the method of a task that has some of the pixels.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run_part(&mut self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        self.run(recorder, task.settings.reflection.method, task, None)?;
        self.any_leaves_rays |= self.leaves_rays;
        Ok(())
    }

    /// Ends such a bounce: no method's hits and views are those of all pixels.
    pub fn end_parts(&mut self) {
        (self.keeps_hits, self.views, self.leaves_rays) = (false, None, self.any_leaves_rays);
    }

    /// The hits of the method that ran last, see shaders/surfel_trace.wgsl; `None` if it keeps none.
    pub fn hits(&self) -> Option<&wgpu::Buffer> {
        self.gather.as_ref().filter(|_| self.keeps_hits).map(|gather| &gather.hits)
    }

    /// The hits of the method that ran last, if it marks the rays of which nothing is known (shaders/shared/hit.wgsl).
    pub fn marked_hits(&self) -> Option<&wgpu::Buffer> {
        self.gather.as_ref().filter(|_| self.leaves_rays()).map(|gather| &gather.hits)
    }

    /// The views of the method that ran last.
    pub fn views(&self) -> Option<Views<'_>> {
        match self.views? {
            Origin::Gather => {
                let image = &self.gather.as_ref()?.views;
                Some(Views { image, most_steps: 400, has_regions: false })
            }
            // Twice the steps after which a search gives up by default; rays are tested against more nodes and discs.
            Origin::Sscr => Some(Views { image: &self.sscr.as_ref()?.views, most_steps: 60, has_regions: true }),
        }
    }

    /// The weights of the looks of the method that ran last, if several are blended.
    pub fn looks(&self, settings: &Settings) -> Option<&Image> {
        let is_blended = settings.reflection.method == Method::LightField && light_field::looks(settings) > 1;
        self.gather.as_ref().filter(|_| is_blended).map(|gather| &gather.views)
    }

    /// Whether the method that ran last counts rays that it does not resolve.
    pub fn leaves_rays(&self) -> bool {
        self.leaves_rays
    }

    /// What a method in use reflects where one point in `step` is searched for, or drawn into maps that are not at hand.
    pub fn reflected_share(&self, settings: &Settings, method: Method, step: u32) -> Option<ReflectedShare> {
        let whole = settings.environment_map.size;
        let [step, texels, whole] = match method {
            Method::Sscr | Method::SampleCameras => [step, 1, 1],
            Method::LightField => [self.light_field.step().unwrap_or(1), 1, 1],
            Method::EnvironmentMap => self.environment.grain().map_or([1; 3], |[step, size]| [step, size, whole]),
            Method::CubemapTrace => {
                let whole = settings.cubemap_trace.size;
                self.cubemaps.grain().map_or([1; 3], |[step, size]| [step, size, whole])
            }
            _ => [1; 3],
        };
        let texels = (f64::from(texels) / f64::from(whole.max(1))).powi(2);
        let share = ReflectedShare { points: 1.0 / f64::from(step.max(1)), texels, ..ReflectedShare::ALL };
        Some(share).filter(|share| *share != ReflectedShare::ALL)
    }

    /// Forgets what methods keep from frame to frame.
    pub fn forget(&mut self) {
        self.light_field.forget();
        self.environment.forget();
        self.cubemaps.forget();
        self.forget_unfinished();
    }

    /// Forgets what a frame that was given up may have left half done; those that draw maps know which it has drawn.
    pub fn forget_unfinished(&mut self) {
        self.sscr.iter_mut().for_each(Sscr::forget);
    }

    pub fn bytes(&self) -> u64 {
        let Self {
            index, environment, cubemaps, screen, mirrored, gather, forward, sscr, cameras, light_field, ..
        } = self;
        index.bytes()
            + environment.bytes()
            + cubemaps.bytes()
            + screen.bytes()
            + mirrored.bytes()
            + gather.as_ref().map_or(0, Gather::bytes)
            + forward.as_ref().map_or(0, Forward::bytes)
            + sscr.as_ref().map_or(0, Sscr::bytes)
            + cameras.bytes()
            + light_field.bytes()
    }
}

/// The value in `place`, which is made if it is empty.
fn made<T>(place: &mut Option<T>, make: impl FnOnce() -> Result<T>) -> Result<&mut T> {
    let value = match place.take() {
        Some(value) => value,
        None => make()?,
    };
    Ok(place.insert(value))
}

/// The back end of forward methods, with the sums that are lent to it.
fn forward_of<'a>(
    place: &'a mut Option<Forward>,
    gpu: &Gpu,
    size: [u32; 2],
    lent: Option<&[wgpu::Buffer; 3]>,
) -> Result<&'a mut Forward> {
    let forward = made(place, || Forward::new(gpu, size, lent.cloned()))?;
    lent.into_iter().for_each(|lent| forward.lend(lent.clone()));
    Ok(forward)
}

/// The points that a frame's method needs.
pub(crate) fn supply(settings: &Settings) -> Selection {
    supply_of(settings.reflection.method)
}

/// The points that a method needs.
pub(crate) fn supply_of(method: Method) -> Selection {
    match method.row().supply {
        Supply::Nothing | Supply::Everything => Selection::Everywhere,
        Supply::WithMirrors => Selection::EverywhereWithMirrors,
    }
}

/// Whether a frame's method finds the mirror pixels of points, which takes neighbouring pixels for one surface.
pub(crate) fn is_forward(settings: &Settings) -> bool {
    matches!(settings.reflection.method.chosen(), Method::Sscr | Method::SampleCameras)
}

/// Whether a frame's method follows a ray for each mirror pixel, and so has hits that may be kept.
pub(crate) fn follows_rays(settings: &Settings) -> bool {
    use Method::{CubemapTrace, ScreenTrace, SscrHierarchical, SurfelTrace};
    matches!(settings.reflection.method.chosen(), SurfelTrace | SscrHierarchical | CubemapTrace | ScreenTrace)
}

/// Whether a method lets rays walk through the maps around mirrors.
pub(crate) fn walks_maps(settings: &Settings, method: Method) -> bool {
    match method {
        Method::CubemapTrace => true,
        Method::ScreenTrace => settings.screen_trace.rest == ScreenRest::CubemapTrace,
        _ => false,
    }
}

/// Whether cameras of rays stand for cells of space in a method.
pub(crate) fn has_cells(settings: &Settings, method: Method) -> bool {
    method == Method::SampleCameras && settings.sample_cameras.cells == CameraCells::Space
}

/// The method that finds what is seen through clear surfaces: the frame's, unless that traces no rays of any kind, or
/// traces them through the camera's picture, which shows clear surfaces and not what is behind them, or looks them up in
/// maps that stand before mirrors.
pub(crate) fn behind_clear(settings: &Settings) -> Method {
    match settings.reflection.method.chosen() {
        Method::Sscr | Method::SampleCameras | Method::MirroredViewpoint | Method::ScreenTrace | Method::LightField => {
            Method::SurfelTrace
        }
        method => method,
    }
}

/// Whether something is shown instead of the picture. Not all methods have views of their work.
pub fn shows_more(settings: &Settings, views: Option<&Views<'_>>) -> bool {
    match settings.reflection.show {
        // A search is shown by the picture that its points make.
        Show::Picture | Show::Search | Show::Error => false,
        Show::Borders | Show::Curvature | Show::Regions | Show::Steps | Show::Unconverged => views.is_some(),
        Show::Uncertain | Show::Coverage | Show::Distance | Show::Albedo | Show::Normal | Show::Position => true,
    }
}

/// Checks that a frame may have these methods.
///
/// # Errors
/// Something in the frame has room for one method alone.
pub(crate) fn check(settings: &Settings, methods: &[Method], has_clear: bool, is_glossy: bool) -> Result<()> {
    if methods.len() < 2 {
        return Ok(());
    }
    let has = |method| methods.contains(&method);
    let with = |method| {
        let mut settings = settings.clone();
        settings.reflection.method = method;
        settings
    };
    let because = if has_clear {
        "glass and water are drawn by one method"
    } else if has(Method::LightField) && light_field::looks(&with(Method::LightField)) > 1 {
        "light_field blends several looks at each ray (light_field.rule), which no other method does"
    } else if has(Method::MirroredViewpoint) && settings.reflection.samples > 1 {
        "mirrored_viewpoint has one ray for each pixel, and reflection.samples is more than 1"
    } else if is_glossy && methods.iter().any(|method| is_forward(&with(*method))) {
        "sscr and sample_cameras take one draw for all pixels of glossy mirrors, and others one for each"
    } else {
        return Ok(());
    };
    let names: Vec<&str> = methods.iter().map(|method| method.row().name).collect();
    Err(Error::OneMethodOnly { because, methods: names.join(", ") })
}
