//! What there is of the truth of the view in the window, and what is under way for it. `truth.rs` decides what is done next.

use std::cell::OnceCell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use cloud::Progress;
use egui::{ColorImage, TextureHandle, TextureOptions};
use serde_json::json;
use study::{Accuracy, Drawn, Refinement, TracedScene};

use crate::viewer::theme::grouped;
use crate::viewer::truth::tasks::{Answer, Kind, Measure, Pass, SceneKey};
use crate::viewer::window::render_thread::FrameRequest;

/// What a pinned truth shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    #[default]
    Truth,
    /// The picture on the left, the truth on the right.
    Split,
    Difference,
}

/// Most points that are traced: the tree takes 300 bytes a point while it is made, which is 9 GB for these.
pub const MOST_POINTS: u64 = 30_000_000;
/// Bytes a point that a scene to trace takes, beside the points themselves; as `trace::Surfels` has it.
pub const BYTES_PER_POINT: u64 = 45;
/// The same while it is made.
pub const PEAK_BYTES_PER_POINT: u64 = 300;
/// Bytes a pixel of the images that a frame is judged by: six of its surface (48), what was found (16), colours (12).
const BYTES_PER_CAPTURED_PIXEL: u64 = 76;
/// Bytes a pixel of what is traced: what is seen, colours twice (24), how many paths (4), and whether it is a mirror.
const BYTES_PER_TRACED_PIXEL: u64 = size_of::<<study::Seen as IntoIterator>::Item>() as u64 + 29;

/// Pixels for the screen, and egui's texture of them, which is made when they are first shown.
pub struct Picture {
    size: [u32; 2],
    pub rgba: Vec<u8>,
    texture: OnceCell<TextureHandle>,
}

impl Picture {
    pub fn new(size: [u32; 2], rgba: Vec<u8>) -> Self {
        Self { size, rgba, texture: OnceCell::new() }
    }

    pub fn texture(&self, context: &egui::Context) -> egui::TextureId {
        let (size, rgba) = (self.size.map(|side| side as usize), &self.rgba);
        let load = || {
            let image = ColorImage::from_rgba_unmultiplied(size, rgba);
            // As the picture itself, pixel for pixel.
            context.load_texture("truth", image, TextureOptions::LINEAR)
        };
        self.texture.get_or_init(load).id()
    }
}

/// What a picture of the truth is of.
#[derive(Clone, PartialEq)]
pub struct Label {
    pub request: FrameRequest,
    pub pass: u32,
    /// Of a heat map.
    pub measure: Option<Measure>,
}

/// Tracing under way.
pub struct Tracing {
    pub basis: FrameRequest,
    pub progress: Arc<Progress>,
    pub mirrors_alone: Arc<AtomicBool>,
}

/// What was traced last.
pub struct Traced {
    pub pass: Pass,
    /// Counts what was traced in this session.
    pub number: u32,
    /// Of the mirrors, and of all.
    pub is_done: [bool; 2],
    pub refinement: Option<Box<Refinement>>,
}

/// How right a frame is.
pub struct Verdict {
    pub request: FrameRequest,
    pub figures: Accuracy,
}

#[derive(Default)]
pub struct TruthView {
    /// The key is down.
    pub is_held: bool,
    pub is_pinned: bool,
    pub look: Look,
    pub measure: Measure,
    /// Where the split stands, 0 to 1 from the left.
    pub split: f32,
    /// Trace while nobody asks for it.
    pub keeps_ready: bool,
    pub judges: bool,
    /// The frame that stands still, and since when.
    pub still: Option<(FrameRequest, Instant)>,
    /// The view that the key was pressed for: it is traced on when the key is up.
    pub asked_for: Option<FrameRequest>,
    pub building: Option<(SceneKey, Arc<Progress>)>,
    pub scene: Option<(SceneKey, Arc<TracedScene>)>,
    pub capturing: Option<FrameRequest>,
    pub captured: Option<(FrameRequest, Arc<Drawn>)>,
    pub tracing: Option<Tracing>,
    pub traced: Option<Traced>,
    pub presenting: Option<Label>,
    pub presented: Option<(Label, Picture)>,
    pub drawing: Option<(Label, Arc<Progress>)>,
    pub difference: Option<(Label, Picture)>,
    pub judging: Option<(FrameRequest, Arc<Progress>)>,
    pub comparing: Option<(FrameRequest, Arc<Progress>)>,
    pub verdict: Option<Verdict>,
    /// There are too many points, which was said.
    pub is_too_large: bool,
}

/// Why nothing is traced.
pub fn too_many_points() -> String {
    format!(
        "The truth is traced for {} points at most; more are shown. Hide or close clouds to see it",
        grouped(MOST_POINTS)
    )
}

/// What is under way.
pub enum Activity {
    Building,
    /// Paths of the mirrors, of all pixels, and how many are wanted.
    Tracing {
        samples: [u32; 2],
        wanted: u32,
    },
}

impl TruthView {
    pub fn new() -> Self {
        Self { split: 0.5, ..Self::default() }
    }

    /// Whether the truth is to be in the picture.
    pub fn is_asked_for(&self) -> bool {
        self.is_held || self.is_pinned
    }

    /// What is shown where the truth is asked for: the key shows it whole.
    pub fn shown_look(&self) -> Look {
        if self.is_held { Look::Truth } else { self.look }
    }

    /// The truth of a frame for the screen.
    pub fn picture(&self, request: &FrameRequest) -> Option<&Picture> {
        let (label, picture) = self.presented.as_ref()?;
        // Another method, say, has the same truth, and it is on its way.
        let is_of_view = label.request == *request || label.request.truth_basis() == request.truth_basis();
        is_of_view.then_some(picture)
    }

    /// The heat map of a frame.
    pub fn difference(&self, request: &FrameRequest) -> Option<&Picture> {
        let measure = Some(self.measure);
        let (label, picture) = self.difference.as_ref()?;
        (label.request == *request && label.measure == measure).then_some(picture)
    }

    /// How far the truth of a frame is traced: paths behind mirrors, behind all pixels, and how many are wanted.
    pub fn samples(&self, request: &FrameRequest) -> Option<([u32; 2], u32)> {
        let pass = &self.traced.as_ref()?.pass;
        (pass.basis == request.truth_basis()).then_some((pass.samples, pass.wanted_samples))
    }

    /// Figures of a frame.
    pub fn figures(&self, request: &FrameRequest) -> Option<&Accuracy> {
        self.verdict.as_ref().filter(|verdict| verdict.request == *request).map(|verdict| &verdict.figures)
    }

    pub fn activity(&self) -> Option<Activity> {
        if self.building.is_some() {
            return Some(Activity::Building);
        }
        let tracing = self.tracing.as_ref()?;
        let pass = self.traced.as_ref().map(|traced| &traced.pass).filter(|pass| pass.basis == tracing.basis);
        let (samples, wanted) = pass.map_or(([0, 0], 0), |pass| (pass.samples, pass.wanted_samples));
        Some(Activity::Tracing { samples, wanted })
    }

    /// Bytes of what is kept, beside the points: the scene, images and pictures.
    pub fn bytes(&self) -> u64 {
        let scene = self.scene.as_ref().map_or(0, |(_, scene)| scene.surfels.len() as u64 * BYTES_PER_POINT);
        let pixels = |request: &FrameRequest| request.size.map(u64::from).iter().product::<u64>();
        let captured = self.captured.as_ref().map_or(0, |(request, _)| pixels(request) * BYTES_PER_CAPTURED_PIXEL);
        let traced = self.traced.as_ref().map_or(0, |traced| pixels(&traced.pass.basis) * BYTES_PER_TRACED_PIXEL);
        let pictures = self.presented.iter().chain(&self.difference).map(|(_, picture)| picture.rgba.len() as u64);
        scene + captured + traced + pictures.sum::<u64>()
    }

    /// The scene for frames of these points, if it is ready.
    pub fn scene(&self, key: SceneKey) -> Option<Arc<TracedScene>> {
        self.scene.as_ref().filter(|(known, _)| *known == key).map(|(_, scene)| scene.clone())
    }

    pub fn is_wanted(&self) -> bool {
        self.is_asked_for() || self.keeps_ready || self.judges || self.asked_for.is_some()
    }

    /// Ends tracing for now; it goes on where it was. Whether nothing is under way any more that would take time from others.
    pub fn is_quiet(&mut self) -> bool {
        self.cancel();
        let is_judging = self.judging.is_some() || self.comparing.is_some() || self.drawing.is_some();
        self.tracing.is_none() && self.building.is_none() && !is_judging
    }

    /// Gives the memory back of the scene and of all that was made of it.
    pub fn free(&mut self) {
        (self.scene, self.captured, self.traced) = (None, None, None);
        (self.presented, self.difference) = (None, None);
    }

    pub fn wants_picture(&self, basis: &FrameRequest) -> bool {
        self.is_asked_for() || self.keeps_ready || self.asked_for.as_ref() == Some(basis)
    }

    pub fn cancel(&mut self) {
        self.building.iter().for_each(|(_, progress)| progress.cancel());
        self.tracing.iter().for_each(|tracing| tracing.progress.cancel());
        self.judging.iter().chain(&self.comparing).for_each(|(_, progress)| progress.cancel());
        self.drawing.iter().for_each(|(_, progress)| progress.cancel());
    }

    /// Ends what is under way for other frames than these: one that stands still, and one that is asked for.
    pub fn cancel_others(&mut self, request: Option<&FrameRequest>, basis: Option<&FrameRequest>) {
        self.tracing
            .iter()
            .filter(|tracing| basis != Some(&tracing.basis))
            .for_each(|tracing| tracing.progress.cancel());
        let judging = self.judging.iter().chain(&self.comparing);
        judging.filter(|(known, _)| request != Some(known)).for_each(|(_, progress)| progress.cancel());
        let drawing = self.drawing.iter().filter(|(label, _)| request != Some(&label.request));
        drawing.for_each(|(_, progress)| progress.cancel());
    }

    /// Ends all that is under way, gives the memory back, and asks for nothing more.
    pub fn stop(&mut self) {
        self.cancel();
        self.free();
        (self.is_pinned, self.keeps_ready, self.judges, self.asked_for) = (false, false, false, None);
    }
}

/// What an answer comes to outside of what is kept of the truth.
pub enum Taken {
    Nothing,
    Log(serde_json::Value),
    /// A value of a sweep is judged.
    Swept {
        request: Box<FrameRequest>,
        figures: Box<Accuracy>,
        picture: Vec<u8>,
    },
    Failed(String),
}

impl TruthView {
    /// Takes in what a worker thread found. `is_current`: what it is about is still shown.
    pub fn take(&mut self, answer: Answer, is_current: bool) -> Taken {
        let is_cancelled = |(_, progress): (FrameRequest, Arc<Progress>)| progress.is_cancelled();
        match answer {
            Answer::Built { key, scene } => {
                let is_kept = self.building.take().is_some_and(|(_, progress)| !progress.is_cancelled());
                self.scene = scene.map(|scene| (key, scene)).filter(|_| is_kept && is_current);
                if let Some((_, scene)) = &self.scene {
                    return Taken::Log(json!({ "event": "truth_scene", "points": scene.surfels.len() }));
                }
            }
            Answer::Pass(_) if !is_current => {}
            Answer::Pass(pass) => {
                let number = self.traced.as_ref().map_or(0, |before| before.number) + 1;
                self.traced = Some(Traced { pass, number, is_done: [false; 2], refinement: None });
            }
            Answer::TraceEnded { basis, refinement, is_done } => {
                self.tracing = None;
                if !is_current {
                    return Taken::Nothing;
                }
                if let Some(traced) = self.traced.as_mut().filter(|traced| traced.pass.basis == basis) {
                    (traced.refinement, traced.is_done) = (Some(refinement), is_done);
                } else if is_done.contains(&true) {
                    // There was nothing to trace.
                    let pass = Pass::of(basis, &refinement);
                    let number = self.traced.as_ref().map_or(0, |traced| traced.number) + 1;
                    self.traced = Some(Traced { pass, number, is_done, refinement: Some(refinement) });
                }
            }
            Answer::Judged { request, result } => {
                let is_cancelled = self.judging.take().is_none_or(is_cancelled);
                match result {
                    // Of no use any more, and its error may be that it was cancelled.
                    _ if is_cancelled || !is_current => {}
                    Ok(figures) => self.verdict = Some(Verdict { request, figures: *figures }),
                    Err(error) => return Taken::Failed(error),
                }
            }
            Answer::Compared { request, error } => {
                self.comparing = None;
                let verdict = self.verdict.as_mut().filter(|verdict| is_current && verdict.request == request);
                if let Some(verdict) = verdict {
                    verdict.figures.image = Some(error);
                    return Taken::Log(json!({ "event": "judged" }));
                }
            }
            Answer::JudgedAlone { request, result, picture } => match result {
                _ if !is_current => {}
                Ok(figures) => return Taken::Swept { request: Box::new(request), figures, picture },
                Err(error) => return Taken::Failed(error),
            },
            Answer::Failed(kind) => {
                match kind {
                    Kind::Build => self.building = None,
                    Kind::Trace => self.tracing = None,
                    Kind::Judge => self.judging = None,
                    Kind::Compare => self.comparing = None,
                    Kind::Difference => self.drawing = None,
                    Kind::JudgeAlone => {}
                }
                return Taken::Failed("the ray tracer stopped unexpectedly".into());
            }
            Answer::Difference { request, measure, pass, result } => {
                let is_cancelled = self.drawing.take().is_none_or(|(_, progress)| progress.is_cancelled());
                match result {
                    _ if is_cancelled || !is_current => {}
                    Ok(rgba) => {
                        let (size, label) = (request.size, Label { request, pass, measure: Some(measure) });
                        self.difference = Some((label, Picture::new(size, rgba)));
                    }
                    Err(error) => return Taken::Failed(error),
                }
            }
        }
        Taken::Nothing
    }
}
