//! The states of a wipe in the window. The window draws one of them, and once its picture is final, that is kept and
//! the next state in the picture has its turn. So all are there while nothing but the line moves.

use std::sync::Arc;

use cloud::{PointTest, Progress};
use scene::{Camera, CameraPath, Mirror, Settings, SpotLight, WipeState};
use serde_json::json;
use study::TracedScene;

use crate::viewer::jobs::tasks::{Answer, Kind, SceneKey, Task};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Report};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;
use crate::viewer::truth::Around;
use crate::viewer::truth::view::{MOST_POINTS, Picture, TruthView, too_many_points};

/// The number of a pass that no picture of the truth has.
const PASS: u32 = u32::MAX;
/// The most pictures that are kept: twice as many as a wipe has states, for two places of the camera.
const MOST_KEPT: usize = 2 * scene::MOST_STATES;

#[derive(Default)]
pub struct Wiping {
    /// The number of the state that the window draws.
    pub turn: usize,
    /// What the window shows, if it is a state of a wipe.
    shown: Option<View>,
    /// Pictures of states, those that were made last at the end.
    made: Vec<(View, Picture)>,
    job: Option<Job>,
    /// A view whose picture cannot be made, or was stopped.
    refused: Option<View>,
}

/// What a picture of a state follows from.
#[derive(Clone, PartialEq)]
pub struct View {
    state: WipeState,
    /// The settings of the path, without those of the state.
    settings: Settings,
    camera: Camera,
    size: [u32; 2],
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    test: PointTest,
}

impl View {
    /// `None` where no path is shown.
    pub fn of(scene: &Scene, state: &WipeState) -> Option<Self> {
        Some(Self {
            state: WipeState { name: String::new(), ..state.clone() },
            settings: scene.posed.as_ref()?.of_path.clone(),
            camera: scene.camera,
            size: scene.view_size,
            mirrors: scene.objects.mirrors.iter().map(|placed| placed.mirror.clone()).collect(),
            lights: scene.objects.lights.iter().map(|placed| placed.light).collect(),
            test: scene.objects.test(),
        })
    }
}

/// A picture that is being made.
struct Job {
    view: View,
    request: FrameRequest,
    stage: Stage,
}

enum Stage {
    /// The frame is read back.
    Read,
    /// The points are to be prepared for the ray tracer, or are being prepared.
    Wanted {
        is_asked: bool,
    },
    Captured(Arc<TracedScene>),
    Traced(Arc<Progress>),
    Presented,
}

impl Wiping {
    /// Forgets all pictures.
    pub fn end(&mut self) {
        if let Some(Job { stage: Stage::Traced(progress), .. }) = &self.job {
            progress.cancel();
        }
        *self = Self::default();
    }

    /// The picture of a state as the path is shown now, if it is made.
    pub fn picture(&self, scene: &Scene, state: &WipeState) -> Option<&Picture> {
        let view = View::of(scene, state)?;
        self.made.iter().find(|(known, _)| *known == view).map(|(_, picture)| picture)
    }

    /// Whether the picture of a state cannot be made as the path is shown now.
    pub fn is_refused(&self, scene: &Scene, state: &WipeState) -> bool {
        self.refused.is_some() && self.refused == View::of(scene, state)
    }

    /// Whether the ray tracer works on a state, or is about to.
    pub fn is_tracing(&self) -> bool {
        self.job.as_ref().is_some_and(|job| !matches!(job.stage, Stage::Read))
    }

    /// Decides which state of a path that is shown at a time is drawn next.
    pub fn choose(&mut self, scene: &Scene, path: &CameraPath, time: f64) {
        let shown: Vec<usize> = path.parts(time, scene.view_size[0]).into_iter().map(|(state, _)| state).collect();
        let lacks = |state: &usize| View::of(scene, &path.states[*state]).is_some_and(|view| !self.is_known(&view));
        if shown.contains(&self.turn) && (self.job.is_some() || lacks(&self.turn)) {
            return;
        }
        let next = shown.iter().copied().find(lacks);
        let stays = shown.contains(&self.turn).then_some(self.turn);
        self.turn = next.or(stays).or(shown.first().copied()).unwrap_or(0);
    }

    /// Notes that the scene is as the path has it, with the state whose turn it is.
    pub fn show(&mut self, scene: &Scene, path: &CameraPath) {
        self.shown = path.states.get(self.turn).and_then(|state| View::of(scene, state));
    }

    /// Has the picture of the state made whose turn it is, once the frame on the screen is final. Called every frame of
    /// the window.
    pub fn sync(&mut self, around: &Around<'_>, truth: &mut TruthView, outside: &mut Outside) {
        if let (None, Some(view), Some(still)) = (&self.job, &self.shown, &around.still) {
            let is_present = still.camera == view.camera && still.size == view.size;
            if is_present && !self.is_known(view) {
                let stage = if view.state.is_traced() { Stage::Wanted { is_asked: false } } else { Stage::Read };
                if matches!(stage, Stage::Read) {
                    outside.render(Command::Read { request: Box::new(still.clone()), images: Vec::new() });
                }
                self.job = Some(Job { view: view.clone(), request: still.clone(), stage });
            }
        }
        let Some(job) = &mut self.job else { return };
        let Stage::Wanted { is_asked } = &mut job.stage else { return };
        if job.request.revision != around.frames.revision {
            // The points have changed meanwhile.
            self.job = None;
        } else if around.points() > MOST_POINTS {
            outside.say(Level::Warning, too_many_points());
            self.refused = self.job.take().map(|job| job.view);
        } else {
            let key = SceneKey::of(&job.request);
            match truth.scene(key) {
                Some(scene) => {
                    let request = Box::new(job.request.clone());
                    outside.render(Command::Capture { request, origin: scene.origin });
                    job.stage = Stage::Captured(scene);
                }
                // Somebody has stopped it.
                None if *is_asked && truth.building.is_none() => self.refused = self.job.take().map(|job| job.view),
                None => {
                    truth.build(key, || around.sources(), outside);
                    *is_asked = truth.building.as_ref().is_some_and(|(known, _)| *known == key);
                }
            }
        }
    }

    /// Whether the picture of a view is made, or cannot be.
    fn is_known(&self, view: &View) -> bool {
        self.refused.as_ref() == Some(view) || self.made.iter().any(|(known, _)| known == view)
    }

    /// Takes a report that this waits for; returns any other.
    pub fn take(&mut self, report: Report, outside: &mut Outside) -> Option<Report> {
        let Some(mut job) = self.job.take() else { return Some(report) };
        match (report, &job.stage) {
            (Report::Read(picture), Stage::Read)
                // Frames of the kept state have another revision, and small pictures of bookmarks another size.
                if picture.camera == job.request.camera
                    && picture.revision == job.request.revision
                    && picture.rgba.len() == bytes(&job.request) =>
            {
                self.keep(job.view, picture.rgba, outside);
            }
            (Report::Presented { pass: PASS, rgba, .. }, Stage::Presented) => self.keep(job.view, rgba, outside),
            (Report::Captured(captured), Stage::Captured(scene)) if captured.request == job.request => {
                let (request, scene, progress) = (job.request.clone(), scene.clone(), Arc::<Progress>::default());
                let drawn = Box::new(captured.drawn);
                let task = Task::RayTrace { request, scene, drawn, progress: progress.clone() };
                outside.work(Work::Truth(Box::new(task)));
                job.stage = Stage::Traced(progress);
                self.job = Some(job);
            }
            (
                report @ (Report::NotJudged(_) | Report::Problem(_)),
                Stage::Read | Stage::Captured(_) | Stage::Presented,
            ) => {
                self.refused = Some(job.view);
                return Some(report);
            }
            (report, _) => {
                self.job = Some(job);
                return Some(report);
            }
        }
        None
    }

    /// Takes an answer of the ray tracer that this waits for; returns any other.
    pub fn take_answer(&mut self, answer: Answer, outside: &mut Outside) -> Option<Answer> {
        match answer {
            Answer::RayTraced { request, colors } => {
                let job = self.job.as_mut().filter(|job| job.request == request);
                match (job, colors) {
                    (Some(job), Some(colors)) => {
                        let (request, colors) = (Box::new(request), Arc::new(colors));
                        outside.render(Command::Present { request, colors, pass: PASS, fits_exposure: true });
                        job.stage = Stage::Presented;
                    }
                    (Some(_), None) => self.job = None,
                    (None, _) => {}
                }
                None
            }
            Answer::Failed(Kind::RayTrace) => {
                self.refused = self.job.take().map(|job| job.view);
                Some(answer)
            }
            answer => Some(answer),
        }
    }

    fn keep(&mut self, view: View, rgba: Vec<u8>, outside: &mut Outside) {
        outside.log(json!({ "event": "wipe_state", "traced": view.state.is_traced() }));
        if self.made.len() >= MOST_KEPT {
            self.made.remove(0);
        }
        let size = view.size;
        self.made.push((view, Picture::new(size, rgba)));
    }
}

/// The bytes of the picture of a frame.
fn bytes(request: &FrameRequest) -> usize {
    request.size.map(|side| side as usize).iter().product::<usize>() * 4
}
