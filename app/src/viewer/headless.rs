//! The viewer without a window, for recordings: the same session, driven by the same step, with a clock that is handed in. Each
//! picture is the one that the window shows at rest.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use render::Gpu;
use scene::Camera;
use world::{Event, Request};

use crate::failure::{FAILED, UNUSABLE};
use crate::interrupt;
use crate::progress_bar::Bar;
use crate::terminal;
use crate::viewer::messages::Level;
use crate::viewer::outside::News;
use crate::viewer::preferences::Preferences;
use crate::viewer::session::Session;
use crate::viewer::window::effects::Effects;
use crate::viewer::window::render_thread::{Command, FrameRequest, Report};

pub struct Headless {
    session: Session,
    effects: Effects,
    news: Receiver<News>,
    /// What the inputs leave of the exit status.
    status: u8,
    /// Messages that were told.
    told: usize,
}

/// How long news are waited for before Ctrl-C is looked for again.
const INTERVAL: Duration = Duration::from_millis(100);

impl Headless {
    /// Opens a scene for pictures of `size` pixels; `wanted` as in `Gpu::headless`.
    ///
    /// # Errors
    /// If there is no thread for the renderer.
    pub fn open(
        gpu: Arc<Gpu>,
        wanted: Option<String>,
        size: [u32; 2],
        request: Request,
        now: Instant,
    ) -> anyhow::Result<Self> {
        let (sender, news) = channel();
        let tell = move |news| sender.send(news).is_ok();
        let mut effects = Effects::new(world::start_unseen, Arc::new(tell));
        effects.draw_for(gpu, wanted)?;
        let mut session = Session::new(Preferences::default());
        (session.outside.now, session.is_recorded) = (now, true);
        session.set_view_size(size);
        session.open_request(request);
        let mut headless = Self { session, effects, news, status: 0, told: 0 };
        headless.do_effects();
        Ok(headless)
    }

    /// The exit status that the inputs leave: those that failed have been reported.
    pub fn status(&self) -> u8 {
        self.status
    }

    /// Writes the final picture that the camera sees, as a PNG file; how many points were drawn for it, or `None` if there is
    /// nothing to show. `now` and `bar` as in `settle`.
    ///
    /// # Errors
    /// Ctrl-C, a picture that cannot be drawn or written.
    pub fn write(&mut self, path: &Path, camera: Camera, now: Instant, bar: &Bar) -> anyhow::Result<Option<u64>> {
        let Some(request) = self.settle(camera, now, bar)? else { return Ok(None) };
        let points = self.session.frames.shown.as_ref().map_or(0, |shown| shown.stats.points_drawn);
        self.session.outside.render(Command::Save { request: Box::new(request), path: path.to_owned() });
        self.do_effects();
        loop {
            // A file that is being written becomes whole, whatever happens.
            let news = self.news.recv()?;
            let is_saved = matches!(news, News::Report(Report::Saved(_)));
            self.take(news)?;
            if is_saved {
                return Ok(Some(points));
            }
        }
    }

    /// Goes on until the picture from there is the final one; `None` if there is nothing to show. `now` is the time by the clock of
    /// the recording; `bar` shows how far loading is, as long as that goes on.
    ///
    /// # Errors
    /// Ctrl-C, a picture that cannot be drawn.
    pub fn settle(&mut self, camera: Camera, now: Instant, bar: &Bar) -> anyhow::Result<Option<FrameRequest>> {
        self.session.stand(camera, now);
        loop {
            interrupt::check()?;
            self.session.step(now, false);
            let is_quiet = self.session.outside.effects.is_empty();
            self.do_effects();
            self.tell_messages(bar);
            if let Some(request) = self.session.still_frame() {
                return Ok(Some(request.clone()));
            }
            if self.session.loaded.is_loading() {
                self.show_loading(bar);
            } else if self.session.loaded.clouds.is_empty() {
                return Ok(None);
            }
            match self.news.recv_timeout(if is_quiet { INTERVAL } else { Duration::ZERO }) {
                Ok(news) => self.take(news)?,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => return Err(anyhow!("the renderer stopped unexpectedly")),
            }
            while let Ok(news) = self.news.try_recv() {
                self.take(news)?;
            }
        }
    }

    /// Takes in what other threads tell; what a picture cannot do without is an error.
    fn take(&mut self, news: News) -> anyhow::Result<()> {
        match &news {
            News::Report(Report::Problem(problem) | Report::NotDrawn(problem) | Report::Lost(problem)) => {
                return Err(anyhow!(problem.clone()));
            }
            News::Loading(_, Event::Failed { is_usage, .. }, _) => {
                // What can be mended by other inputs comes second to what cannot.
                self.status = if *is_usage && self.status != FAILED { UNUSABLE } else { FAILED };
            }
            _ => {}
        }
        self.session.on_news(news);
        Ok(())
    }

    /// The clipboard, dialogs and the event log are the window's.
    fn do_effects(&mut self) {
        for effect in std::mem::take(&mut self.session.outside.effects) {
            drop(self.effects.run(&mut self.session, effect));
        }
    }

    /// Warnings and errors; notes are for who looks on.
    fn tell_messages(&mut self, bar: &Bar) {
        let messages = &self.session.outside.messages.all;
        for message in &messages[self.told..] {
            bar.suspend(|| match message.level {
                Level::Note => {}
                Level::Warning => terminal::warn([&message.text]),
                Level::Error => terminal::complain(&message.text),
            });
        }
        self.told = messages.len();
    }

    fn show_loading(&self, bar: &Bar) {
        let Some(job) = self.session.loaded.jobs.iter().find(|job| !job.is_loaded) else { return };
        match self.session.loaded.stage_of(job) {
            Some((_, stage)) => bar.show(stage, ""),
            None if job.has_streamed => {
                bar.set_task("pages");
                bar.set(job.stream.points_resident, job.stream.points_total);
            }
            None => bar.update(&job.progress),
        }
    }
}

impl Drop for Headless {
    /// Files that are half written are cleared away.
    fn drop(&mut self) {
        // Chunks that wait to be taken in hold the loading threads back.
        self.news = channel().1;
        self.effects.end(&self.session);
    }
}
