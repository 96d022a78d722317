//! The viewer without its window, for tests. It has a session and a render thread, and does the work that the session
//! asks for on the test's own thread.

use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use egui::Ui;
use render::Gpu;

use crate::viewer::interface;
use crate::viewer::jobs::sweep_files::SweepResult;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Report};
use crate::viewer::picture::render_thread::RenderThread;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::outside::Effect;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::requests::work::Work;
use crate::viewer::session::Session;

pub struct Bench {
    pub session: Session,
    /// The last sweep result that the session asked to save. The bench writes no files.
    pub swept: Option<Box<SweepResult>>,
    /// The events of the session.
    pub log: Vec<serde_json::Value>,
    /// Whether the adapter is a processor.
    pub is_processor: bool,
    thread: RenderThread,
    reports: Receiver<Report>,
    /// How far the session's clock is ahead of the real one.
    ahead: Duration,
}

/// The longest wait for a report. Software Vulkan compiles for a minute on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);

/// The window's device and the one that draws, which tests share, so that each pass is compiled once for all of them. A
/// test that loses its device, is refused something by it, or waits while it compiles, opens one with `own_device`.
pub fn devices() -> Option<[Arc<Gpu>; 2]> {
    static SHARED: LazyLock<Option<[Arc<Gpu>; 2]>> = LazyLock::new(|| Some([own_device()?, own_device()?]));
    SHARED.clone()
}

/// A device of a test's own. Without an adapter a test is skipped, with a note, or fails where `GLINT_REQUIRE_GPU` is set.
pub fn own_device() -> Option<Arc<Gpu>> {
    match Gpu::headless(None) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

impl Bench {
    /// Opens the built-in scene of a mirror ball.
    pub fn with_sphere() -> Option<Self> {
        Self::with_scene("five-mirrors/sphere")
    }

    /// Opens a built-in scene with few points and a small picture. Returns `None`, and prints a note, if there is no
    /// adapter.
    pub fn with_scene(name: &str) -> Option<Self> {
        let [window_gpu, gpu] = devices()?;
        let is_processor = gpu.is_processor();
        let (sender, reports) = channel();
        let thread = RenderThread::start(window_gpu, |_| Ok(gpu), move |report| drop(sender.send(report))).unwrap();
        let mut session = Session::new(Preferences::default());
        (session.scene.settings.scene.points, session.scene.settings.trace.samples) = (3000, 4);
        // Few lights and bounces leave few passes to compile.
        (session.scene.settings.gi.vpls, session.scene.settings.gi.bounces) = (4, 1);
        session.set_view_size([64, 48]);
        assert!(session.open(&[name]));
        let (swept, log, ahead) = (None, Vec::new(), Duration::ZERO);
        let mut bench = Self { session, swept, log, is_processor, thread, reports, ahead };
        let Report::Ready { adapter } = bench.report() else { panic!("no renderer") };
        bench.session.on_report(Report::Ready { adapter });
        Some(bench)
    }

    fn report(&self) -> Report {
        self.reports.recv_timeout(PATIENCE).expect("the render thread answers")
    }

    /// Draws the window's contents. The picture keeps its size, whatever the size of the window.
    pub fn show(&mut self, ui: &mut Ui) {
        let mut actions = interface::show(ui, &self.session, None);
        actions.retain(|action| !matches!(action, Action::Resize(_)));
        self.session.act_all(actions);
    }

    /// Steps the session once, at a time that is `time` later than it would be without this call.
    pub fn skip(&mut self, time: Duration) {
        self.ahead += time;
        self.session.step(Instant::now() + self.ahead, false);
    }

    /// Steps the session and does what it asks for until nothing is left to do.
    pub fn settle(&mut self) {
        let started = Instant::now();
        loop {
            let wait = self.session.step(Instant::now() + self.ahead, false);
            let effects = std::mem::take(&mut self.session.outside.effects);
            if let (Some(wait), true) = (wait, effects.is_empty()) {
                // Other threads work meanwhile, and may be done sooner than the session expects.
                std::thread::sleep(wait.min(Duration::from_millis(1)));
            }
            let mut is_done = wait.is_none();
            for effect in effects {
                is_done &= matches!(effect, Effect::Log(_));
                self.work(effect);
            }
            if is_done {
                return;
            }
            assert!(started.elapsed() < PATIENCE, "there is no end to it");
        }
    }

    /// The picture of the frame on the screen.
    pub fn read(&mut self) -> Vec<u8> {
        self.read_of(self.session.frames.shown.as_ref().expect("a frame").request.clone())
    }

    /// The picture of any frame of the points that are there.
    pub fn read_of(&mut self, request: FrameRequest) -> Vec<u8> {
        self.thread.send(Command::Read { request: Box::new(request), images: Vec::new() });
        match self.report() {
            Report::Read(picture) => picture.rgba,
            _ => panic!("no picture"),
        }
    }

    fn work(&mut self, effect: Effect) {
        match effect {
            Effect::Render(command) => {
                let is_answered = matches!(
                    command,
                    Command::Frame(_)
                        | Command::Read { .. }
                        | Command::Capture { .. }
                        | Command::Measure(_)
                        | Command::Present { .. }
                        | Command::Estimate { .. }
                        | Command::Choose { .. }
                );
                self.thread.send(command);
                if is_answered {
                    let report = self.report();
                    self.session.on_report(report);
                }
            }
            Effect::Load { inputs } => {
                let asked = self.session.loaded.asked_attributes(&self.session.scene);
                let job = world::start(inputs.clone(), &self.session.scene.settings, asked);
                let id = self.session.loaded.add_job(
                    &inputs,
                    job.progress.clone(),
                    job.mailbox.clone(),
                    self.session.outside.now,
                );
                job.events
                    .iter()
                    .for_each(|event| self.session.with_loaded(|loaded, beside| loaded.on_loading(id, event, beside)));
            }
            Effect::Work(Work::SaveSweep(sweep)) => self.swept = Some(sweep),
            Effect::Work(work) => {
                let found = std::cell::RefCell::new(Vec::new());
                work.run(&self.session.scene.settings.stream.clone(), |news| found.borrow_mut().push(news));
                found.into_inner().into_iter().for_each(|news| self.session.on_found(news));
            }
            // The effects below need a window.
            Effect::OpenDialog
            | Effect::AskPlace(..)
            | Effect::Copy(_)
            | Effect::SetFullScreen(_)
            | Effect::Capture(_) => {}
            Effect::Log(event) => self.log.push(event),
        }
    }
}
