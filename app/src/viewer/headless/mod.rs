//! The viewer without a window, for recordings. It drives the same session with the same step, by a clock that the
//! caller hands in. Each picture equals the one that the window shows at rest.

mod wiped;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use cloud::Bounds;
use render::{Aov, FrameStats, Gpu};
use scene::{Camera, CameraPath, ExposureFit, PathPlace, Settings, StandardView, Strays, Tone};
use serde::Serialize;
use study::TracedScene;
use world::{Event, Request, StreamStats};

use self::wiped::StatePicture;
use crate::overlays::{self, Facts};
use crate::shared::measuring::ROUGH_LABELS;
use crate::system::failure::{FAILED, UNUSABLE};
use crate::system::interrupt;
use crate::system::peak_memory::host_peak_bytes;
use crate::system::progress_bar::Bar;
use crate::system::terminal;
use crate::viewer::jobs::tasks::SceneKey;
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Picture, Report};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::News;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::session::Session;
use crate::viewer::session::effects::Effects;
use crate::viewer::tools::facts::facts;

pub struct Headless {
    session: Session,
    effects: Effects,
    news: Receiver<News>,
    /// The exit status for failed inputs; 0 if none failed.
    status: u8,
    /// The number of messages that were handled so far.
    told: usize,
    /// The tone that the scene asks for now.
    pub tone: Tone,
    /// The stops of `lock_exposure`, if the pictures have them.
    locked: Option<f32>,
    /// The scene that was last prepared for the ray tracer.
    traced: Option<(SceneKey, Arc<TracedScene>)>,
    /// What the states of the last picture were drawn from, if it shows several.
    states: Vec<PictureStats>,
    /// The pictures of these states.
    made: Vec<StatePicture>,
    /// How many pixels across are drawn for one of the final picture.
    pub supersample: u32,
    /// Whether it was said that labels are of loaded points.
    is_rough: bool,
    /// Whether a picture lacks points, since the opening, that could not be read and may come later.
    pub is_cut_off: bool,
}

/// What is drawn over a picture.
pub struct Over {
    camera: Camera,
    settings: Settings,
    facts: Facts,
}

impl Over {
    /// Draws it over a picture of `size`: rows of sRGB red, green, blue and opacity.
    pub fn draw(&self, rgba: &mut [u8], size: [u32; 2]) {
        overlays::draw(rgba, size, &self.camera, &self.settings, &self.facts);
    }
}

/// What a picture was drawn from, as `frame-000000.json`.
#[derive(Clone, Debug, Serialize)]
pub struct PictureStats {
    /// The time on the path, in seconds.
    time: f64,
    /// The method of each state of a wipe that is in the picture, with ` | ` between them.
    method: String,
    /// The points on the GPU, and those that were drawn.
    points: u64,
    points_drawn: u64,
    /// Null if all clouds are held in memory.
    stream: Option<Streamed>,
    gpu_bytes: u64,
    /// The most memory that the process has held so far; null where the system does not say.
    host_peak_bytes: Option<u64>,
}

/// What of streamed clouds was loaded for a picture.
#[derive(Clone, Copy, Debug, Serialize)]
struct Streamed {
    /// Whether all nodes that the view needs were loaded, within the budgets.
    settled: bool,
    nodes: usize,
    /// The nodes that were not there yet, or cannot be read, and the points of the latter.
    nodes_missing: usize,
    points_missing: u64,
    points_resident: u64,
    points_total: u64,
    /// The memory of decoded points.
    host_bytes: u64,
}

/// The longest wait for news. Ctrl-C is checked after each wait.
const INTERVAL: Duration = Duration::from_millis(100);

impl Headless {
    /// Opens a scene for pictures of `size` pixels. `wanted` has the meaning of the parameter of `Gpu::headless`.
    ///
    /// # Errors
    /// The thread of the renderer cannot be started.
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
        let tone = session.scene.settings.tone.clone();
        let mut headless = Self {
            session,
            effects,
            news,
            status: 0,
            told: 0,
            tone,
            locked: None,
            traced: None,
            states: Vec::new(),
            made: Vec::new(),
            supersample: 1,
            is_rough: false,
            is_cut_off: false,
        };
        headless.do_effects();
        Ok(headless)
    }

    /// Returns the exit status for failed inputs. Their errors have been printed.
    pub fn status(&self) -> u8 {
        self.status
    }

    /// Returns the picture that the camera sees with these float images of it, and what is to be drawn over it; `None` if
    /// there is nothing to show. `now` and `bar` have the meaning of those of `settle`.
    ///
    /// # Errors
    /// Somebody pressed Ctrl-C, or the picture cannot be drawn.
    pub fn picture(
        &mut self,
        camera: Camera,
        now: Instant,
        images: &[Aov],
        bar: &Bar,
    ) -> anyhow::Result<Option<(Picture, Over)>> {
        self.states.clear();
        let Some(picture) = self.drawn(camera, now, images, bar)? else { return Ok(None) };
        let scene = &self.session.scene;
        let over = Over { camera: scene.camera, settings: scene.settings.clone(), facts: self.facts() };
        Ok(Some((picture, over)))
    }

    /// Returns the picture without overlays, and float images of it. The arguments are those of `picture`.
    fn drawn(&mut self, camera: Camera, now: Instant, images: &[Aov], bar: &Bar) -> anyhow::Result<Option<Picture>> {
        let Some(request) = self.settle(Some(camera), now, bar)? else { return Ok(None) };
        let command = Command::Read { request: Box::new(request), images: images.to_vec() };
        let take = |report| if let Report::Read(picture) = report { Ok(*picture) } else { Err(report) };
        self.answer(command, take).map(Some)
    }

    /// Has the render thread carry out a command, and returns what `take` makes of its answer; it gives other reports
    /// back.
    fn answer<T>(&mut self, command: Command, take: impl Fn(Report) -> Result<T, Report>) -> anyhow::Result<T> {
        self.session.outside.render(command);
        self.do_effects();
        loop {
            match self.news.recv()? {
                News::Report(report) => match take(report) {
                    Ok(answer) => return Ok(answer),
                    Err(other) => self.take(News::Report(other))?,
                },
                news => self.take(news)?,
            }
        }
    }

    fn facts(&self) -> Facts {
        let Session { scene, loaded, tools, .. } = &self.session;
        facts(scene, loaded, &tools.measurements)
    }

    /// The number of points in the picture that was drawn last.
    pub fn points_drawn(&self) -> u64 {
        self.session.frames.shown.as_ref().map_or(0, |shown| shown.stats.points_drawn)
    }

    /// What the picture that was made last was drawn from; `time` is that of its frame. Of several states in it, the
    /// nodes are those of the state that lacked most.
    pub fn stats(&self, time: f64) -> PictureStats {
        let Some(last) = self.states.last() else { return self.stats_of_drawn(time) };
        let methods: Vec<&str> = self.states.iter().map(|state| state.method.as_str()).collect();
        let stream = self.states.iter().filter_map(|state| state.stream);
        let stream = stream.max_by_key(|stream| (!stream.settled, stream.nodes_missing));
        PictureStats { time, method: methods.join(" | "), stream, ..last.clone() }
    }

    fn stats_of_drawn(&self, time: f64) -> PictureStats {
        let Session { frames, loaded, .. } = &self.session;
        let shown = frames.shown.as_ref();
        let count = |of: fn(&FrameStats) -> u64| shown.map_or(0, |shown| of(&shown.stats));
        let jobs: Vec<_> = loaded.jobs.iter().filter(|job| job.has_streamed).collect();
        let sum = |of: fn(&StreamStats) -> u64| jobs.iter().map(|job| of(&job.stream)).sum();
        let stream = Streamed {
            settled: jobs.iter().all(|job| !job.is_streaming() && job.stream.nodes_missing == 0),
            nodes: jobs.iter().map(|job| job.stream.nodes).sum(),
            nodes_missing: jobs.iter().map(|job| job.stream.nodes_waiting + job.stream.nodes_missing).sum(),
            points_missing: sum(|stats| stats.points_missing),
            points_resident: sum(|stats| stats.points_resident),
            points_total: sum(|stats| stats.points_total),
            host_bytes: sum(|stats| stats.host_bytes),
        };
        PictureStats {
            time,
            method: shown.map_or("none", |shown| shown.request.settings.reflection.method.row().name).into(),
            points: count(|stats| stats.points_resident),
            points_drawn: count(|stats| stats.points_drawn),
            stream: (!jobs.is_empty()).then_some(stream),
            gpu_bytes: count(|stats| stats.gpu_bytes),
            host_peak_bytes: host_peak_bytes(),
        }
    }

    /// Whether the scene hides all points of the clouds that are open.
    pub fn hides_all(&self) -> bool {
        let Session { scene, loaded, .. } = &self.session;
        let test = scene.objects.test().hiding_strays(scene.settings.splat.strays == Strays::Hidden);
        let is_hidden = |entry: &CloudEntry| !entry.is_visible || entry.cloud.shown(&test).is_empty();
        loaded.points() > 0 && loaded.clouds.iter().all(is_hidden)
    }

    /// What a built-in path follows from, once everything is loaded.
    pub fn place(&self) -> PathPlace {
        let Session { scene, loaded, .. } = &self.session;
        let (mut view, mut bounds) = (scene.camera, self.session.bounds());
        // Which points of a streamed cloud are there, and so what is known of its strays, differs from run to run. The
        // bounds in its index do not.
        let visible = || loaded.clouds.iter().filter(|entry| entry.is_visible);
        if visible().any(CloudEntry::is_indexed) {
            bounds = visible().fold(Bounds::EMPTY, |all, entry| all.union(entry.bounds));
            if !scene.camera_is_placed {
                let side = scene.first_side.unwrap_or(StandardView::Isometric);
                view = scene.framed(&bounds.corners(), side, &loaded.clouds);
            }
        }
        PathPlace { view, bounds, up: self.session.up() }
    }

    /// Sets parameters and objects as the tracks of a path have them at a time of it, in seconds, and shows its
    /// captions.
    ///
    /// # Errors
    /// A track names nothing in the scene, or gives it a value that it cannot have: with the number of the track.
    pub fn pose(&mut self, path: &CameraPath, time: f64) -> Result<(), (usize, String)> {
        self.session.scene.pose(path, time)?;
        (self.tone, self.locked) = (self.session.scene.settings.tone.clone(), None);
        Ok(())
    }

    /// Returns the stops that are fitted to the final picture that the camera sees, without those of `tone.exposure`; 0
    /// if none are fitted. `now` and `bar` have the meaning of those of `settle`.
    ///
    /// # Errors
    /// Those of `settle`.
    pub fn fitted_stops(&mut self, camera: Camera, now: Instant, bar: &Bar) -> anyhow::Result<f32> {
        self.settle(Some(camera), now, bar)?;
        let fitted = self.session.frames.shown.as_ref().and_then(|shown| shown.stats.exposure);
        Ok(fitted.map_or(0.0, |fitted| fitted.stops - self.tone.exposure))
    }

    /// Gives the pictures that follow these stops and those of `tone.exposure`, until the next pose.
    pub fn lock_exposure(&mut self, stops: f32) {
        self.locked = Some(stops);
        lock(&mut self.session.scene.settings.tone, stops);
    }

    /// Puts the camera where a recording has it at time `now`, without a hurried frame. Streamed clouds load at once.
    fn stand(&mut self, camera: Camera, now: Instant) {
        self.session.outside.now = now;
        (self.session.scene.camera, self.session.scene.camera_is_placed) = (camera, true);
        self.session.with_loaded(Loaded::look_around);
    }

    /// Steps the session until the picture that the camera sees is final; without a camera, until everything is loaded
    /// and seen from where the scene opens. Returns `None` if there is nothing to show. `now` is the time by the recording's clock. `bar` shows the progress while files are loaded.
    ///
    /// # Errors
    /// Somebody pressed Ctrl-C, or the picture cannot be drawn.
    pub fn settle(&mut self, camera: Option<Camera>, now: Instant, bar: &Bar) -> anyhow::Result<Option<FrameRequest>> {
        match camera {
            Some(camera) => self.stand(camera, now),
            None => self.session.outside.now = now,
        }
        loop {
            interrupt::check()?;
            self.session.step(now, false);
            let is_quiet = self.session.outside.effects.is_empty();
            self.do_effects();
            self.tell_messages(bar);
            let request = self.session.still_frame().filter(|_| self.marks_are_known()).cloned();
            if request.is_some() {
                self.warn_of_rough_labels(bar);
                self.is_cut_off |= self.session.loaded.jobs.iter().any(|job| job.stream.may_come);
                return Ok(request);
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

    /// Whether the values are known that the labels of measurements show, if there are any.
    fn marks_are_known(&self) -> bool {
        let Session { scene, tools, .. } = &self.session;
        !scene.settings.overlay.labels || tools.measurements.are_known(scene)
    }

    /// Says once that labels are of points of which the files have more.
    fn warn_of_rough_labels(&mut self, bar: &Bar) {
        let Session { scene, tools, outside, .. } = &mut self.session;
        let is_rough = scene.settings.overlay.labels && tools.measurements.are_of_loaded(scene);
        if is_rough && !std::mem::replace(&mut self.is_rough, true) {
            outside.warning(ROUGH_LABELS);
            self.tell_messages(bar);
        }
    }

    /// Hands news of other threads to the session. A failure of the renderer is an error; the failure of an input only
    /// changes the exit status.
    fn take(&mut self, news: News) -> anyhow::Result<()> {
        match &news {
            News::Report(
                Report::Problem(problem)
                | Report::NotDrawn(problem)
                | Report::NotJudged(problem)
                | Report::Lost(problem),
            ) => {
                return Err(anyhow!(problem.clone()));
            }
            News::Loading(_, Event::Failed { is_usage, .. }, _) => {
                // `FAILED` outranks `UNUSABLE`, which only says that other inputs are needed.
                self.status = if *is_usage && self.status != FAILED { UNUSABLE } else { FAILED };
            }
            _ => {}
        }
        self.session.on_news(news);
        Ok(())
    }

    /// Carries out the session's effects. The clipboard, dialogs and the event log belong to the window, so requests
    /// for them are dropped.
    fn do_effects(&mut self) {
        for effect in std::mem::take(&mut self.session.outside.effects) {
            drop(self.effects.run(&mut self.session, effect));
        }
    }

    /// Prints new warnings and errors. Notes are only for people at the window.
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

/// Adds stops to an exposure, which is fitted to no picture any more.
fn lock(tone: &mut Tone, stops: f32) {
    (tone.fit, tone.exposure) = (ExposureFit::Locked, tone.exposure + stops);
}

impl Drop for Headless {
    /// Stops all threads, which remove their unfinished files.
    fn drop(&mut self) {
        // A waiting chunk blocks the thread that loads it. Dropping the receiver releases them all.
        self.news = channel().1;
        self.effects.end(&self.session);
    }
}
