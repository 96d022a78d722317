//! What is known of the truth of the view in the window, and what is under way for it. `mod.rs` decides what is done
//! next.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::Instant;

use cloud::Progress;
use egui::{ColorImage, TextureHandle, TextureOptions};
use scene::Camera;
use serde_json::json;
use study::{Accuracy, Drawn, Refinement, TracedScene};

use crate::shared::language::text;
use crate::viewer::frames::Frames;
use crate::viewer::jobs::tasks::{Answer, Kind, Measure, Pass, SceneKey};
use crate::viewer::look::theme::grouped;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::requests::action::Look;
use crate::viewer::truth::live::LiveEstimate;
use crate::viewer::truth::tracing::Tracing;

/// The most points that are traced. Building the tree takes 300 bytes for each point, which is 9 GB for this many.
pub const MOST_POINTS: u64 = 30_000_000;
/// The bytes that a traced scene takes for each point, beside the points themselves; as in `trace::Surfels`.
pub const BYTES_PER_POINT: u64 = 45;
/// The bytes for each point while the scene is being made.
pub const PEAK_BYTES_PER_POINT: u64 = 300;
/// The bytes for each pixel of the images that a frame is judged by: six images of its surface (48), what was found
/// (16), and colours (12).
const BYTES_PER_CAPTURED_PIXEL: u64 = 76;
/// The bytes for each traced pixel: what is seen, colours twice (24), the number of paths (4), and whether it is a
/// mirror.
const BYTES_PER_TRACED_PIXEL: u64 = size_of::<<study::Seen as IntoIterator>::Item>() as u64 + 29;

/// Pixels for the screen, and egui's texture of them, which is made when they are first shown.
pub struct Picture {
    size: [u32; 2],
    pub rgba: Vec<u8>,
    texture: RefCell<Option<(egui::Context, TextureHandle)>>,
}

impl Picture {
    pub fn new(size: [u32; 2], rgba: Vec<u8>) -> Self {
        Self { size, rgba, texture: RefCell::default() }
    }

    pub fn texture(&self, context: &egui::Context) -> egui::TextureId {
        let mut texture = self.texture.borrow_mut();
        // The window has another context after its device was lost.
        if let Some((_, known)) = texture.as_ref().filter(|(of, _)| of == context) {
            return known.id();
        }
        let image = ColorImage::from_rgba_unmultiplied(self.size.map(|side| side as usize), &self.rgba);
        // The filter is that of the picture itself.
        let loaded = context.load_texture("truth", image, TextureOptions::LINEAR);
        texture.insert((context.clone(), loaded)).1.id()
    }
}

/// The frame, pass and measure that a picture of the truth belongs to.
#[derive(Clone, PartialEq)]
pub struct Label {
    pub request: FrameRequest,
    pub pass: u32,
    /// The measure of a heat map.
    pub measure: Option<Measure>,
}

/// What was traced last.
pub struct Traced {
    pub pass: Pass,
    /// A counter of the tracing results of this session.
    pub number: u32,
    /// Whether the mirrors are complete, and whether all pixels are.
    pub is_done: [bool; 2],
    pub refinement: Option<Box<Refinement>>,
}

/// The accuracy of a frame.
pub struct Verdict {
    pub request: FrameRequest,
    pub figures: Accuracy,
}

#[derive(Default)]
pub struct TruthView {
    /// True while the key is down.
    pub is_held: bool,
    pub is_pinned: bool,
    pub look: Look,
    pub measure: Measure,
    /// The position of the split, from 0 at the left to 1.
    pub split: f32,
    /// True if the truth is traced even while nobody asks for it.
    pub keeps_ready: bool,
    pub judges: bool,
    /// The frame that stands still, and since when.
    pub still: Option<(FrameRequest, Instant)>,
    /// The view for which the key was pressed: tracing goes on when the key is released.
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
    /// True if there are too many points and a message has said so.
    pub is_too_large: bool,
    pub live: LiveEstimate,
}

/// The message that nothing is traced, and why.
pub fn too_many_points() -> String {
    text!(
        "The truth is traced for {most} points at most; more are shown. Hide or close clouds to see it",
        most = grouped(MOST_POINTS)
    )
}

/// The work that is under way.
pub enum Activity {
    Building,
    /// The paths of the mirrors, the paths of all pixels, the number that is wanted, and how far it is:
    /// `34 %, 50 s left`.
    Tracing {
        samples: [u32; 2],
        wanted: u32,
        progress: String,
    },
}

impl TruthView {
    pub fn new() -> Self {
        Self { split: 0.5, ..Self::default() }
    }

    /// Whether the picture shall show the truth.
    pub fn is_asked_for(&self) -> bool {
        self.is_held || self.is_pinned
    }

    /// The frame whose truth belongs in a picture of this size that `camera` sees. `None` if the view has changed and its
    /// picture is not drawn yet: the traced truth belongs to the view before.
    pub fn frame(&self, frames: &Frames, camera: Camera, size: [u32; 2]) -> Option<FrameRequest> {
        let request = &frames.shown.as_ref().filter(|_| self.is_asked_for())?.request;
        let is_current = request.camera == camera && request.size == size && !request.hurried;
        is_current.then(|| request.clone())
    }

    /// What is shown if the truth is asked for: the key shows the whole truth.
    pub fn shown_look(&self) -> Look {
        if self.is_held { Look::Truth } else { self.look }
    }

    /// The picture of the truth of a frame.
    pub fn picture(&self, request: &FrameRequest) -> Option<&Picture> {
        let (label, picture) = self.presented.as_ref()?;
        // For example, another method has the same truth; its own picture is under way.
        let is_of_view = label.request == *request || label.request.truth_basis() == request.truth_basis();
        is_of_view.then_some(picture)
    }

    /// The heat map of a frame.
    pub fn difference(&self, request: &FrameRequest) -> Option<&Picture> {
        let measure = Some(self.measure);
        let (label, picture) = self.difference.as_ref()?;
        (label.request == *request && label.measure == measure).then_some(picture)
    }

    /// How far the truth of a frame is traced: paths for mirrors, paths for all pixels, and the number that is wanted.
    pub fn samples(&self, request: &FrameRequest) -> Option<([u32; 2], u32)> {
        let pass = &self.traced.as_ref()?.pass;
        (pass.basis == request.truth_basis()).then_some((pass.samples, pass.wanted_samples))
    }

    /// The figures of a frame.
    pub fn figures(&self, request: &FrameRequest) -> Option<&Accuracy> {
        self.verdict.as_ref().filter(|verdict| verdict.request == *request).map(|verdict| &verdict.figures)
    }

    pub fn activity(&self, now: Instant) -> Option<Activity> {
        if self.building.is_some() {
            return Some(Activity::Building);
        }
        let tracing = self.tracing.as_ref()?;
        let pass = self.traced.as_ref().map(|traced| &traced.pass).filter(|pass| pass.basis == tracing.basis);
        let (samples, wanted) = pass.map_or(([0, 0], 0), |pass| (pass.samples, pass.wanted_samples));
        Some(Activity::Tracing { samples, wanted, progress: tracing.text(pass.map(|pass| pass.work), now) })
    }

    /// The bytes of all that is kept, beside the points: the scene, images and pictures.
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

    /// Stops tracing for now; it continues later where it stopped. Returns whether no work is under way any more that
    /// would take time from others.
    pub fn is_quiet(&mut self) -> bool {
        self.cancel();
        let is_judging = self.judging.is_some() || self.comparing.is_some() || self.drawing.is_some();
        self.tracing.is_none() && self.building.is_none() && !is_judging
    }

    /// Frees the memory of the scene and of everything made from it.
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

    /// Cancels judging and drawing for frames other than `request`, and tracing of truths other than `basis`.
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

    /// Cancels all that is under way, frees the memory, and asks for nothing more.
    pub fn stop(&mut self) {
        self.cancel();
        self.free();
        (self.is_pinned, self.keeps_ready, self.judges, self.asked_for) = (false, false, false, None);
    }
}

/// What an answer means outside of the truth.
pub enum Taken {
    Nothing,
    Log(serde_json::Value),
    /// A value of a sweep has been judged.
    Swept(Swept),
    Failed(String),
}

/// What is found of a value of a sweep.
pub struct Swept {
    pub request: Box<FrameRequest>,
    pub figures: Box<Accuracy>,
    /// RGBA pixels in the size of a tile.
    pub picture: Vec<u8>,
}

impl TruthView {
    /// Takes in a worker's answer. `is_current` says that its frame is still shown.
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
                    let pass = Pass::of(basis, &refinement, false);
                    let number = self.traced.as_ref().map_or(0, |traced| traced.number) + 1;
                    self.traced = Some(Traced { pass, number, is_done, refinement: Some(refinement) });
                }
            }
            Answer::Judged { request, result } => {
                let is_cancelled = self.judging.take().is_none_or(is_cancelled);
                match result {
                    // The answer is no longer needed, and its error may only say that it was cancelled.
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
                Ok(figures) => return Taken::Swept(Swept { request: Box::new(request), figures, picture }),
                Err(error) => return Taken::Failed(error),
            },
            Answer::Failed(kind) => {
                match kind {
                    Kind::Build => self.building = None,
                    Kind::Trace => self.tracing = None,
                    Kind::Judge => self.judging = None,
                    Kind::Compare => self.comparing = None,
                    Kind::Difference => self.drawing = None,
                    Kind::JudgeAlone | Kind::RayTrace => {}
                }
                return Taken::Failed(text!("the ray tracer stopped unexpectedly").into());
            }
            // A wipe asked for it, and has gone on.
            Answer::RayTraced { .. } => {}
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
