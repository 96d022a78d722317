//! Carries out the effects that need no window: threads of their own draw points, read files and do work, and report
//! the results. The window and recordings use it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::Progress;
use render::Gpu;
use scene::Settings;
use world::{Event, Input, Job};

use crate::shared::language::text;
use crate::viewer::jobs::tasks::Answer;
use crate::viewer::objects::clouds::JobEntry;
use crate::viewer::picture::messages::Command;
use crate::viewer::picture::render_thread::RenderThread;
use crate::viewer::picture::under_way::UnderWay;
use crate::viewer::requests::outside::{Effect, News};
use crate::viewer::requests::work::Work;
use crate::viewer::session::Session;

/// Sends news from any thread to the code that drives the session; returns false once nobody receives them.
pub type Tell = Arc<dyn Fn(News) -> bool + Send + Sync>;

/// Starts jobs: `world::start`, or `world::start_unseen`.
type StartJob = fn(Vec<Input>, &Settings, BTreeSet<String>) -> Job;

pub struct Effects {
    tell: Tell,
    start: StartJob,
    render_thread: Option<RenderThread>,
    under_way: Arc<UnderWay>,
}

/// After the window closes, the program waits at most this long for jobs and work to end.
const CLOSING_TIME: Duration = Duration::from_secs(3);

impl Effects {
    pub fn new(start: StartJob, tell: Tell) -> Self {
        Self { tell, start, render_thread: None, under_way: Arc::default() }
    }

    /// Starts drawing points for the window of a device, on the adapter that `wanted` names as in `Gpu::headless`. Returns
    /// `RenderThread::shaders`.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn draw_for(&mut self, window_gpu: Arc<Gpu>, wanted: Option<String>) -> std::io::Result<Arc<Progress>> {
        let tell = self.tell.clone();
        // Takes the window's adapter, unless another is wanted: the adapter that presents is the one that has the
        // screen.
        let open = move |window_gpu: &Gpu| match wanted {
            Some(wanted) => Gpu::headless(Some(&wanted)),
            None => Gpu::on_same_adapter(&window_gpu.info),
        };
        // A closed window needs no reports.
        let thread = RenderThread::start(window_gpu, open, move |report| {
            let _ = tell(News::Report(report));
        })?;
        let shaders = thread.shaders.clone();
        self.render_thread = Some(thread);
        Ok(shaders)
    }

    /// Shows the pictures on another device of the window.
    pub fn show_on(&mut self, window_gpu: Arc<Gpu>) {
        if let Some(thread) = &self.render_thread {
            thread.send(Command::ShowOn(window_gpu));
        }
    }

    /// Carries out an effect; returns it if it needs a window.
    pub fn run(&mut self, session: &mut Session, effect: Effect) -> Option<Effect> {
        match effect {
            Effect::Render(command) => {
                if let Some(thread) = &self.render_thread {
                    thread.send(command);
                }
            }
            Effect::Load { inputs } => {
                let (loaded, scene) = (&session.loaded, &session.scene);
                let settings = loaded.settings_of_next_job(&scene.settings);
                let job = (self.start)(inputs.clone(), &settings, loaded.asked_attributes(scene));
                let id =
                    session.loaded.add_job(&inputs, job.progress.clone(), job.mailbox.clone(), session.outside.now);
                let (under_way, tell) = (self.under_way.clone(), self.tell.clone());
                begin(session, "loading events", move || forward(&job, id, &under_way, &tell));
            }
            Effect::Work(work) => {
                let truth = if let Work::Truth(task) = &work { Some(task.kind()) } else { None };
                let (stream, tell) = (session.scene.settings.stream.clone(), self.tell.clone());
                let found = move |found| {
                    let _ = tell(News::Found(found));
                };
                let is_begun = begin(session, work.name(), move || work.run(&stream, found));
                if let Some(kind) = truth.filter(|_| !is_begun) {
                    session.on_truth(Answer::Failed(kind));
                }
            }
            needs_window => return Some(needs_window),
        }
        None
    }

    /// Stops drawing, loading and work. Waits until unfinished files are removed, but for at most `CLOSING_TIME`.
    pub fn close(&mut self, session: &Session) {
        self.render_thread = None;
        for job in &session.loaded.jobs {
            job.progress.cancel();
            job.mailbox.end();
        }
        let running = session.loaded.running();
        running.iter().for_each(|work| work.progress.cancel());
        let start = Instant::now();
        let is_over = |job: &JobEntry| Arc::strong_count(&job.mailbox) == 1;
        let is_at_rest = || {
            session.loaded.jobs.iter().all(is_over) && running.iter().all(|work| Arc::strong_count(work.progress) == 1)
        };
        while !is_at_rest() && start.elapsed() < CLOSING_TIME {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Ends all work in the background, and waits for the frame that is being drawn, however long that takes.
    pub fn end(&mut self, session: &Session) {
        let thread = self.render_thread.take();
        self.close(session);
        if let Some(thread) = thread {
            thread.end();
        }
    }
}

/// Runs `task` on a new thread; reports an error and returns false if no thread can be started.
pub fn begin(session: &mut Session, name: &str, task: impl FnOnce() + Send + 'static) -> bool {
    let started = std::thread::Builder::new().name(name.into()).spawn(task);
    if let Err(error) = &started {
        session.outside.error(text!("{name}: no thread: {error}", name, error));
    }
    started.is_ok()
}

/// Forwards the events of a job until the job ends; it also ends if its loading thread panics.
fn forward(job: &Job, id: u32, under_way: &Arc<UnderWay>, tell: &Tell) {
    for event in &job.events {
        let is_end = matches!(event, Event::Finished);
        let pass = match &event {
            Event::Chunk { chunk, .. } => Some(under_way.enter(chunk.size_in_bytes() as u64)),
            _ => None,
        };
        if !tell(News::Loading(id, event, pass)) || is_end {
            return;
        }
    }
    let error = "loading stopped unexpectedly".to_string();
    tell(News::Loading(id, Event::Failed { input: String::new(), error, is_usage: false }, None));
    tell(News::Loading(id, Event::Finished, None));
}
