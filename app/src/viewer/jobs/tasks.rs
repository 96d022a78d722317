//! The ray tracer's work for the window. Each task runs on a thread of its own: preparing a scene for tracing, tracing
//! a frame ever finer, and judging what was drawn.

use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use cloud::{Chunk, Cloud, PointTest, Progress};
use glam::DVec3;
use render::{ColorPlan, Material, Objects};
use scene::{Mirror, Settings};
use study::{Accuracy, Drawn, ImageError, Refinement, SubjectPart, TracedScene, Tracer, Truth, View, mirrors_of};
use world::mirrors::{self, Marked};

use crate::viewer::jobs::contact_sheet;
use crate::viewer::objects::clouds::{CloudEntry, Samples};
use crate::viewer::picture::frame_request::FrameRequest;

/// What a traced scene depends on: the points, their colours, and the size of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneKey {
    pub revision: u64,
    /// The bits of `splat.size`.
    pub splat_size: u32,
}

impl SceneKey {
    pub fn of(request: &FrameRequest) -> Self {
        Self { revision: request.revision, splat_size: request.settings.splat.size.to_bits() }
    }
}

/// Points of the window, before they are divided into those that reflect and those that do not.
pub enum Source {
    Cloud { cloud: Cloud, plan: ColorPlan, up: DVec3, marked: Arc<Vec<Marked>>, test: PointTest },
    Mirror { mirror: Mirror, chunks: Vec<Chunk> },
}

pub enum Task {
    Build {
        key: SceneKey,
        sources: Vec<Source>,
        progress: Arc<Progress>,
    },
    Trace(Box<Trace>),
    Judge(Judge),
    /// Compares the mirrors' colours with traced ones.
    Compare {
        judge: Judge,
        colors: Arc<Vec<[f32; 3]>>,
    },
    /// Judges a frame by a truth that is traced only for it. The answer contains the figures and `picture` shrunk to a
    /// tile.
    JudgeAlone {
        judge: Judge,
        picture: Vec<u8>,
    },
    /// Finds what the mirrors of a frame show, which is drawn without reflections: the method `ray_trace`.
    RayTrace {
        request: FrameRequest,
        scene: Arc<TracedScene>,
        drawn: Box<Drawn>,
        progress: Arc<Progress>,
    },
    /// Draws a heat map of the errors in a picture.
    Difference {
        judge: Judge,
        measure: Measure,
        colors: Arc<Vec<[f32; 3]>>,
        pass: u32,
    },
}

/// The kinds of [`Task`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Build,
    Trace,
    Judge,
    Compare,
    JudgeAlone,
    Difference,
    RayTrace,
}

pub struct Trace {
    /// The frame's basis as [`FrameRequest::truth_basis`] gives it.
    pub basis: FrameRequest,
    pub scene: Arc<TracedScene>,
    pub drawn: Arc<Drawn>,
    /// What was traced before.
    pub refinement: Option<Box<Refinement>>,
    /// True while only the mirrors are needed, because nobody looks at the rest of the picture.
    pub mirrors_alone: Arc<AtomicBool>,
    pub progress: Arc<Progress>,
}

/// A frame to judge.
#[derive(Clone)]
pub struct Judge {
    pub request: FrameRequest,
    pub scene: Arc<TracedScene>,
    pub drawn: Arc<Drawn>,
    pub progress: Arc<Progress>,
}

/// What a heat map shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// The CIEDE2000 difference of the colours.
    #[default]
    Color,
    /// The distance in pixels from the right position, over the mirrors.
    Place,
}

/// A traced picture so far.
#[derive(Clone)]
pub struct Pass {
    pub basis: FrameRequest,
    /// Linear red, green and blue.
    pub colors: Arc<Vec<[f32; 3]>>,
    /// The number of paths for every mirror pixel and for every pixel.
    pub samples: [u32; 2],
    pub wanted_samples: u32,
    /// The estimates that are taken, those of the next step, and those that are wanted in all, as `Refinement::work` has
    /// them of what was traced: mirrors alone, or the picture.
    pub work: [u64; 3],
    /// True if all pixels were traced, not only mirrors.
    pub is_whole: bool,
}

impl Pass {
    pub fn of(basis: FrameRequest, refinement: &Refinement, mirrors_alone: bool) -> Self {
        Self {
            basis,
            colors: Arc::new(refinement.picture()),
            samples: refinement.samples(),
            wanted_samples: refinement.wanted(),
            work: refinement.work(mirrors_alone),
            is_whole: refinement.is_whole(),
        }
    }
}

pub enum Answer {
    /// The traced scene; `None` if the task was cancelled.
    Built {
        key: SceneKey,
        scene: Option<Arc<TracedScene>>,
    },
    Pass(Pass),
    /// Tracing has ended, complete or cancelled. `is_done` says whether the mirrors are complete, and whether all
    /// pixels are.
    TraceEnded {
        basis: FrameRequest,
        refinement: Box<Refinement>,
        is_done: [bool; 2],
    },
    Judged {
        request: FrameRequest,
        result: Result<Box<Accuracy>, String>,
    },
    Compared {
        request: FrameRequest,
        error: ImageError,
    },
    JudgedAlone {
        request: FrameRequest,
        result: Result<Box<Accuracy>, String>,
        picture: Vec<u8>,
    },
    /// Rows of sRGB red, green, blue and opacity, transparent where nothing is measured.
    Difference {
        request: FrameRequest,
        measure: Measure,
        pass: u32,
        result: Result<Vec<u8>, String>,
    },
    /// Linear red, green and blue of all pixels; `None` if the task was cancelled.
    RayTraced {
        request: FrameRequest,
        colors: Option<Vec<[f32; 3]>>,
    },
    /// A task has stopped without an answer.
    Failed(Kind),
}

impl Answer {
    /// The frame that an answer belongs to.
    pub fn request(&self) -> Option<&FrameRequest> {
        match self {
            Self::Pass(Pass { basis: request, .. })
            | Self::TraceEnded { basis: request, .. }
            | Self::Judged { request, .. }
            | Self::Compared { request, .. }
            | Self::Difference { request, .. }
            | Self::RayTraced { request, .. }
            | Self::JudgedAlone { request, .. } => Some(request),
            Self::Built { .. } | Self::Failed(_) => None,
        }
    }

    /// The revision of the points that a scene was made from.
    pub fn revision(&self) -> Option<u64> {
        match self {
            Self::Built { key, .. } => Some(key.revision),
            _ => None,
        }
    }
}

impl FrameRequest {
    /// The request reduced to what its truth depends on, so that it is equal for all frames with one truth. It leaves
    /// out all parameters of methods, and those that only say how the renderer shades and shows things.
    pub fn truth_basis(&self) -> Self {
        Self { settings: self.settings.only(|field| field.affects.truth), ..self.clone() }
    }

    /// The colours of this frame, linear red, green and blue, where the mirrors show what the ray tracer finds: the
    /// method `ray_trace`. `drawn` is the frame without reflections.
    ///
    /// # Errors
    /// Cancelled.
    pub fn ray_traced(
        &self,
        scene: &TracedScene,
        mut drawn: Drawn,
        progress: &Progress,
    ) -> study::Result<Vec<[f32; 3]>> {
        Tracer::new(scene, self.view()).ray_trace(&mut drawn, progress)?;
        Ok(drawn.color)
    }

    fn view(&self) -> View<'_> {
        let Self { camera, settings, mirrors, lights, clues, size, .. } = self;
        let objects = Objects { mirrors, lights, clues: *clues };
        View { camera, settings, objects, size: *size }
    }
}

impl Source {
    /// Everything that is visible. `test` says which points are.
    pub fn all(clouds: &[CloudEntry], samples: &Samples, settings: &Settings, test: &PointTest) -> Vec<Self> {
        let clouds = clouds.iter().filter(|entry| entry.is_visible).map(|entry| {
            let (cloud, up) = (entry.cloud.resized(entry.size), entry.up);
            let plan = entry.figures.as_ref().map(|figures| figures.plan.clone());
            let plan = plan.unwrap_or_else(|| ColorPlan::new(&cloud, &settings.color, up).0);
            Self::Cloud { cloud, plan, up, marked: entry.marks.clone(), test: test.clone() }
        });
        // Where two points are equally near, the order decides.
        let mut samples: Vec<_> = samples.of.iter().collect();
        samples.sort_by_key(|(id, _)| **id);
        let mirrors = samples.into_iter().map(|(_, sample)| {
            let chunks = sample.chunks.iter().map(|(chunk, _)| chunk.clone()).collect();
            Self::Mirror { mirror: sample.mirror.clone(), chunks }
        });
        clouds.chain(mirrors).collect()
    }

    fn parts(self) -> Vec<SubjectPart> {
        match self {
            Self::Mirror { mirror, chunks } => {
                let cloud = Cloud { name: mirror.name.clone(), chunks, ..Cloud::default() };
                vec![SubjectPart::of_mirror(&mirror, cloud)]
            }
            Self::Cloud { cloud, plan, up, marked, test } => {
                let part = |(material, chunks): (Material, Vec<Chunk>)| SubjectPart {
                    cloud: Cloud { chunks, ..cloud.clone() },
                    specular_intensity: material.specular_intensity,
                    specular_power: material.specular_power,
                    clear: study::clear_points(&material),
                    plan: plan.clone(),
                    up,
                };
                mirrors::parts(&cloud, &marked, &test).into_iter().map(part).collect()
            }
        }
    }
}

impl Task {
    pub fn kind(&self) -> Kind {
        match self {
            Self::Build { .. } => Kind::Build,
            Self::Trace(_) => Kind::Trace,
            Self::Judge(_) => Kind::Judge,
            Self::Compare { .. } => Kind::Compare,
            Self::JudgeAlone { .. } => Kind::JudgeAlone,
            Self::Difference { .. } => Kind::Difference,
            Self::RayTrace { .. } => Kind::RayTrace,
        }
    }

    /// Does the work and calls `answer` with each result.
    pub fn run(self, answer: impl Fn(Answer)) {
        let kind = self.kind();
        // Without an answer the session would wait forever.
        if std::panic::catch_unwind(AssertUnwindSafe(|| self.work(&answer))).is_err() {
            answer(Answer::Failed(kind));
        }
    }

    fn work(self, answer: &impl Fn(Answer)) {
        match self {
            Self::Build { key, sources, progress } => {
                let parts: Vec<SubjectPart> = sources.into_iter().flat_map(Source::parts).collect();
                let splat_size = f32::from_bits(key.splat_size);
                // The only possible error is that the task was cancelled.
                let scene = TracedScene::new(&parts, None, splat_size, &progress).ok().map(Arc::new);
                answer(Answer::Built { key, scene });
            }
            Self::Trace(trace) => trace.run(answer),
            Self::Judge(judge) => {
                let result = on_spare_cores(|| judge.figures());
                let result = result.map(Box::new).map_err(|error| error.to_string());
                answer(Answer::Judged { request: judge.request, result });
            }
            Self::Compare { judge, colors } => {
                let error = on_spare_cores(|| judge.image_error(&colors));
                answer(Answer::Compared { request: judge.request, error });
            }
            Self::JudgeAlone { judge, picture } => {
                let result = on_spare_cores(|| judge.alone());
                let result = result.map(Box::new).map_err(|error| error.to_string());
                // Whoever cancelled the task does not wait for an answer.
                if !judge.progress.is_cancelled() {
                    let picture = contact_sheet::shrunk(judge.request.size, picture);
                    answer(Answer::JudgedAlone { request: judge.request, result, picture });
                }
            }
            Self::RayTrace { request, scene, drawn, progress } => {
                // The only possible error is that the task was cancelled.
                let colors = on_spare_cores(|| request.ray_traced(&scene, *drawn, &progress)).ok();
                answer(Answer::RayTraced { request, colors });
            }
            Self::Difference { judge, measure, colors, pass } => {
                let result = on_spare_cores(|| judge.heat_map(measure, &colors)).map_err(|error| error.to_string());
                answer(Answer::Difference { request: judge.request, measure, pass, result });
            }
        }
    }
}

/// Does work on all cores but one, which is left to the window. The work has a thread pool of its own, so that other
/// parallel work does not wait behind it.
fn on_spare_cores<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    static POOL: OnceLock<Option<rayon::ThreadPool>> = OnceLock::new();
    let make = || {
        let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
        rayon::ThreadPoolBuilder::new().num_threads(cores.saturating_sub(1).max(1)).build().ok()
    };
    match POOL.get_or_init(make) {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

impl Trace {
    fn run(self, answer: &impl Fn(Answer)) {
        let Self { basis, scene, drawn, refinement, mirrors_alone, progress } = self;
        let tracer = Tracer::new(&scene, basis.view());
        let mut refinement = refinement.unwrap_or_else(|| Box::new(Refinement::new(&tracer, &drawn.surface)));
        loop {
            let alone = mirrors_alone.load(Ordering::Relaxed);
            let is_traced = on_spare_cores(|| refinement.step(&tracer, alone, &progress));
            if !matches!(is_traced, Ok(true)) {
                break;
            }
            answer(Answer::Pass(Pass::of(basis.clone(), &refinement, alone)));
        }
        let is_done = [refinement.is_done(true), refinement.is_done(false)];
        answer(Answer::TraceEnded { basis, refinement, is_done });
    }
}

impl Judge {
    /// A copy to judge the same frame again, with new progress.
    pub fn anew(&self) -> Self {
        Self { progress: Arc::default(), ..self.clone() }
    }

    fn figures(&self) -> study::Result<Accuracy> {
        let tracer = Tracer::new(&self.scene, self.request.view());
        tracer.judge(Truth::SameInput, &self.drawn, &self.progress)
    }

    fn image_error(&self, colors: &[[f32; 3]]) -> ImageError {
        let tracer = Tracer::new(&self.scene, self.request.view());
        tracer.image_error(&self.drawn, &tracer.seen(&self.drawn.surface), colors)
    }

    /// Figures and colours by a truth that is traced only for this frame.
    fn alone(&self) -> study::Result<Accuracy> {
        let tracer = Tracer::new(&self.scene, self.request.view());
        let seen = tracer.seen(&self.drawn.surface);
        let colors = tracer.colors(Truth::SameInput, &mirrors_of(&seen), &self.progress)?;
        let image = tracer.image_error(&self.drawn, &seen, &colors);
        let figures = tracer.judge(Truth::SameInput, &self.drawn, &self.progress)?;
        Ok(Accuracy { image: Some(image), ..figures })
    }

    fn heat_map(&self, measure: Measure, colors: &[[f32; 3]]) -> study::Result<Vec<u8>> {
        let tracer = Tracer::new(&self.scene, self.request.view());
        let values = match measure {
            Measure::Color => {
                let mut values = study::delta_e(&self.drawn.color, colors);
                let nothing = |color: &[f32; 3]| color.iter().any(|value| value.is_nan());
                let unseen = values.iter_mut().zip(colors).filter(|(_, color)| nothing(color));
                unseen.for_each(|(value, _)| *value = f32::NAN);
                values
            }
            Measure::Place => {
                let errors = tracer.pixel_errors(&self.drawn, &self.progress)?;
                let found = self.drawn.found.as_chunks::<4>().0.iter().map(|found| found[3]);
                let is_mirror = (0..errors.len()).map(|pixel| self.drawn.surface.is_mirror(pixel));
                errors
                    .into_iter()
                    .zip(found)
                    .zip(is_mirror)
                    .map(|((error, found), is)| place(error, found, is))
                    .collect()
            }
        };
        let ramp = render::ramp_colors(RAMP);
        let color = |value: f32| match value {
            _ if value.is_nan() => [0; 4],
            ASTRAY => [ASTRAY_COLOR[0], ASTRAY_COLOR[1], ASTRAY_COLOR[2], 255],
            _ => ramp[((value / measure.most()).clamp(0.0, 1.0) * 255.0).round() as usize],
        };
        Ok(values.into_iter().flat_map(color).collect())
    }
}

/// Marks a mirror pixel that shows nothing although it should, or something although nothing is there: no distance in
/// pixels describes this error.
const ASTRAY: f32 = -1.0;
/// The colour of such pixels: cyan, which does not occur in the ramp.
pub const ASTRAY_COLOR: [u8; 3] = [0, 255, 255];

/// The distance in pixels from the right position, [`ASTRAY`], or NaN if nothing is measured. `found` is the coverage
/// of what the method found; 0 or NaN if it found nothing.
fn place(error: Option<study::PixelError>, found: f32, is_mirror: bool) -> f32 {
    match error {
        None if is_mirror && (found.is_nan() || found <= 0.0) => ASTRAY,
        Some(error) if error.is_other_surface.is_none() => ASTRAY,
        Some(error) => match (error.pixels, error.is_off) {
            (Some(pixels), _) => pixels as f32,
            // Where reflections do not change from pixel to pixel, nothing is between right and wrong.
            (None, Some(is_off)) => {
                if is_off {
                    Measure::Place.most()
                } else {
                    0.0
                }
            }
            (None, None) => f32::NAN,
        },
        None => f32::NAN,
    }
}

/// The ramp of heat maps: black means no error.
pub const RAMP: scene::Ramp = scene::Ramp::Magma;

impl Measure {
    /// The bright end of the heat map. Colours that differ by 10 differ clearly side by side. A displacement of 4
    /// pixels is the least that filters over the mirror no longer hide.
    pub fn most(self) -> f32 {
        match self {
            Self::Color => 10.0,
            Self::Place => 4.0,
        }
    }
}

#[cfg(test)]
impl FrameRequest {
    /// A small default frame for tests.
    pub fn any() -> Self {
        Self {
            camera: scene::five_mirrors::camera(),
            settings: scene::Settings::default(),
            mirrors: Vec::new(),
            lights: Vec::new(),
            clues: scene::LightClues::default(),
            size: [8, 6],
            test: PointTest::default(),
            revision: 1,
            spared: None,
            hurried: false,
            light_may_lag: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use cloud::{Attribute, Column, ColumnType};
    use scene::{Method, Quality};

    use super::*;
    use crate::viewer::picture::frame_request::hurried;

    #[test]
    fn how_the_renderer_finds_things_does_not_change_the_truth_and_what_is_seen_does() {
        let basis = FrameRequest::any().truth_basis();
        let with = |change: fn(&mut Settings)| {
            let mut request = FrameRequest::any();
            change(&mut request.settings);
            request.truth_basis()
        };
        assert_eq!(with(|settings| settings.reflection.method = Method::Sscr), basis);
        assert_eq!(with(|settings| settings.sscr.seed_attempts = 1), basis);
        assert_eq!(with(|settings| settings.tone.exposure = 2.0), basis);
        assert_eq!(with(|settings| settings.gi.vpls = 16), basis);
        assert_ne!(with(|settings| settings.gi.bounces = 0), basis);
        assert_ne!(with(|settings| settings.splat.size = 2.0), basis);
        assert_ne!(with(|settings| settings.reflection.bounces = 2), basis);
        assert_ne!(with(|settings| settings.splat.quality = Quality::Nearest), basis);
        assert_ne!(with(|settings| *settings = hurried(settings, true)), basis);
        assert_ne!(FrameRequest { revision: 2, ..FrameRequest::any() }.truth_basis(), basis);
    }

    #[test]
    fn what_is_missing_and_what_should_not_be_there_have_a_colour_of_their_own() {
        let of =
            |pixels, is_off, is_other_surface| Some(study::PixelError { angle: 1.0, pixels, is_off, is_other_surface });
        let error = |is_other_surface| of(Some(2.0), Some(true), is_other_surface);
        let steady = [Some(false), Some(true), None].map(|is_off| place(of(None, is_off, Some(false)), 1.0, true));
        assert!(steady[..2] == [0.0, Measure::Place.most()] && steady[2].is_nan(), "{steady:?}");
        assert_eq!(place(error(Some(false)), 1.0, true), 2.0);
        assert_eq!(place(error(None), 1.0, true), ASTRAY, "a false fill");
        assert_eq!([place(None, 0.0, true), place(None, f32::NAN, true)], [ASTRAY; 2], "nothing was found");
        assert!(place(None, f32::NAN, false).is_nan(), "no mirror");
        let ramp = render::ramp_colors(RAMP);
        assert!(ramp.iter().all(|color| color[..3] != ASTRAY_COLOR));
    }

    #[test]
    fn a_task_that_panics_answers_so() {
        let answers = std::cell::RefCell::new(Vec::new());
        let answer = |answer| {
            answers.borrow_mut().push(matches!(answer, Answer::Failed(Kind::Build)));
            // Fails at the end, as a task would.
            assert!(answers.borrow().len() > 1, "the first answer fails");
        };
        let key = SceneKey { revision: 1, splat_size: 0 };
        Task::Build { key, sources: Vec::new(), progress: Arc::default() }.run(answer);
        assert_eq!(answers.into_inner(), [false, true]);
    }

    #[test]
    fn hidden_classes_are_hidden_from_the_truth_too() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 4]);
        chunk.columns = vec![Some(Arc::new(Column::U8(vec![2, 6, 2, 9])))];
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &scene::Color::default(), DVec3::Z);
        let points = |test| {
            let (cloud, plan, marked) = (cloud.clone(), plan.clone(), Arc::default());
            let parts = Source::Cloud { cloud, plan, up: DVec3::Z, marked, test }.parts();
            parts.iter().map(|part| part.cloud.len()).sum::<u64>()
        };
        assert_eq!(points(PointTest::default()), 4);
        assert_eq!(points(PointTest::hiding([2])), 2);
        assert_eq!(points(PointTest::hiding(0..=255)), 0);
    }
}
