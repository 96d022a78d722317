//! The thread that draws the points, so that the window never waits for them.
//!
//! The thread owns the renderer and the points on the GPU, on a device of its own. Waiting for a device holds a lock that
//! presenting on the same device needs. Whichever of the two is lost is opened again: some systems reset both where one
//! takes too long. Commands are carried out in order; of several waiting frames only the latest is drawn, and of several
//! tests of points only the latest is applied. Another thread writes a finished picture into a texture of the window's
//! device (picture_writer.rs). The window's next frame shows it, either whole or not at all.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cloud::{PointTest, Progress};
use render::{Effort, FrameStats, Gpu, IsGivenUp, Objects, PictureRows, Renderer};
use scene::Settings;
use study::{Choice, CostModel, Drawn, Judged, Target, auto};
use world::{Change, Resident};

use crate::overlays;
use crate::system::picture_file;
use crate::viewer::picture::beginning::Beginning;
use crate::viewer::picture::frame_request::{FrameRequest, frame_of};
use crate::viewer::picture::judging::{self, MovingJudge};
use crate::viewer::picture::messages::{Captured, Command, PickedPoint, Picture, Report};
use crate::viewer::picture::moving::MovingPictures;
use crate::viewer::picture::picture_writer::{self, DrawnFrame, Finished};

/// The window's handle to the thread. When it is dropped, the thread ends after the frame that it is drawing.
pub struct RenderThread {
    /// The shaders that are compiled, as `Renderer::prepare` counts them.
    pub shaders: Arc<Progress>,
    commands: Sender<Command>,
    thread: JoinHandle<()>,
    /// Set when a hurried frame waits, so that the thread gives up a frame in full quality for it.
    is_urgent: Arc<AtomicBool>,
    /// Set when any command waits, so that the thread gives up choosing for it.
    is_waited_for: Arc<AtomicBool>,
}

/// The most samples of glossy mirrors that are added before the picture in the window is renewed.
const MOST_SAMPLES: u32 = 16;
/// How long a coarse frame is worked at before the next moving picture is drawn.
const COARSE_SLICE: Duration = Duration::from_millis(50);
/// The longest time for which points are uploaded before a waiting frame is drawn, if the frame before took no longer.
const UPLOAD_SLICE: Duration = Duration::from_millis(50);

impl RenderThread {
    /// Starts the thread. `window_gpu` is the device that shows the pictures; `open` opens the one that draws them, on the
    /// thread. `report` is called on another thread.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn start(
        window_gpu: Arc<Gpu>,
        open: impl FnOnce(&Gpu) -> render::Result<Arc<Gpu>> + Send + 'static,
        report: impl Fn(Report) + Send + 'static,
    ) -> std::io::Result<Self> {
        let (commands, receiver) = channel();
        let is_urgent = Arc::new(AtomicBool::new(false));
        let shaders = Arc::<Progress>::default();
        let compiled = shaders.clone();
        let is_waited_for = Arc::new(AtomicBool::new(false));
        let (urgent, waiting) = (is_urgent.clone(), is_waited_for.clone());
        let (finished, writer) = picture_writer::start(report)?;
        let work = move || {
            // The writer ends early only after it has reported the reason.
            let finish = |done| drop(finished.send(done));
            let opened = || {
                let gpu = open(&window_gpu)?;
                Worker::new(gpu, window_gpu, compiled, &receiver, &finish)
            };
            let draw = || match opened() {
                Ok((mut worker, first)) => {
                    finish(Finished::Told(Report::Ready { adapter: worker.gpu.info.name.clone() }));
                    worker.run(first, &receiver, &urgent, &waiting, &finish);
                }
                Err(error) => finish(Finished::Told(Report::Lost(error.to_string()))),
            };
            // wgpu panics when a driver violates its contract. The window survives to report it.
            if std::panic::catch_unwind(std::panic::AssertUnwindSafe(draw)).is_err() {
                finish(Finished::Told(Report::Lost("the renderer stopped unexpectedly".into())));
            }
            drop(finished);
            // The writer catches its own panics.
            let _ = writer.join();
        };
        let thread = std::thread::Builder::new().name("render".into()).spawn(work)?;
        Ok(Self { shaders, commands, thread, is_urgent, is_waited_for })
    }

    pub fn send(&self, command: Command) {
        let is_urgent = matches!(&command, Command::Frame(request) if request.hurried);
        // A thread that has ended has already reported the reason.
        let waits = matches!(&command, Command::Estimate { .. } | Command::Choose { .. });
        let _ = self.commands.send(command);
        self.is_waited_for.fetch_or(!waits, Ordering::Relaxed);
        if is_urgent {
            self.is_urgent.store(true, Ordering::Relaxed);
        }
    }

    /// Ends the thread, and waits for the frame that it is drawing.
    pub fn end(self) {
        drop(self.commands);
        self.is_urgent.store(true, Ordering::Relaxed);
        self.is_waited_for.store(true, Ordering::Relaxed);
        // The thread catches its own panics.
        let _ = self.thread.join();
    }
}

struct Worker {
    gpu: Arc<Gpu>,
    window_gpu: Arc<Gpu>,
    renderer: Renderer,
    shaders: Arc<Progress>,
    resident: Resident,
    /// The last test of points that came, while it is not applied: it changes as fast as the mouse moves.
    test: Option<PointTest>,
    /// The frame that the renderer holds, and whether the picture is the whole frame's, made from its own colours.
    held: Option<(FrameRequest, bool)>,
    /// The frame whose surface the renderer holds, though further samples or rays of it may have been given up.
    surface: Option<FrameRequest>,
    /// The samples of glossy mirrors in the last frame that was drawn for the window.
    summed: u32,
    /// The frame in the window; points are picked from it.
    on_screen: Option<FrameRequest>,
    moving: MovingPictures,
    judge: MovingJudge,
    /// When the device was last lost.
    lost_at: Option<Instant>,
}

/// A device that is lost twice within this time would be lost again.
const LOST_AGAIN: Duration = Duration::from_secs(60);

impl Worker {
    /// Compiles what every picture needs. Returns the commands that came meanwhile and were not carried out, too.
    fn new(
        gpu: Arc<Gpu>,
        window_gpu: Arc<Gpu>,
        shaders: Arc<Progress>,
        commands: &Receiver<Command>,
        finish: &impl Fn(Finished),
    ) -> render::Result<(Self, VecDeque<Command>)> {
        let mut beginning = Beginning::new(gpu, window_gpu);
        let renderer = beginning.compile(commands, &shaders, finish)?;
        let Beginning { gpu, window_gpu, resident, moving, on_screen, waiting, .. } = beginning;
        let worker = Self {
            renderer,
            shaders,
            resident,
            gpu,
            window_gpu,
            test: None,
            held: None,
            surface: None,
            summed: 0,
            on_screen,
            moving,
            judge: MovingJudge::from_environment(),
            lost_at: None,
        };
        Ok((worker, waiting))
    }

    /// Makes the device anew after a loss, and uploads the points again. Other errors pass.
    ///
    /// # Errors
    /// The error itself if the device was lost shortly before, or what kept a new one from being made.
    fn survive(&mut self, error: render::Error, report: &impl Fn(Report)) -> render::Result<()> {
        if self.lost_at.is_some_and(|at| at.elapsed() < LOST_AGAIN) {
            return Err(error);
        }
        self.lost_at = Some(Instant::now());
        report(Report::Problem(format!("{error}; it is opened again")));
        let gpu = Gpu::on_same_adapter(&self.gpu.info)?;
        self.renderer = Renderer::with_progress(gpu.clone(), &self.shaders)?;
        self.gpu = gpu.clone();
        (self.held, self.surface, self.on_screen, self.summed) = (None, None, None, 0);
        self.resident.store.move_to(gpu)
    }

    fn run(
        &mut self,
        mut first: VecDeque<Command>,
        commands: &Receiver<Command>,
        urgent: &Arc<AtomicBool>,
        waiting: &Arc<AtomicBool>,
        finish: &impl Fn(Finished),
    ) {
        let report = &|told| finish(Finished::Told(told));
        // A frame that was given up is drawn after all if no other was requested.
        let mut frame: Option<Box<FrameRequest>> = None;
        // An estimate waits until nothing else is to be done.
        let mut estimate: Option<(Box<FrameRequest>, u64)> = None;
        // Where frames take long, points come in half of the time.
        let mut upload_slice = UPLOAD_SLICE;
        // Choosing waits, too, and ends once anything else is to be done.
        let mut choose = None;
        // Whether the passes for what comes after the picture on the screen are compiled.
        let mut is_prepared = true;
        // When a frame that came during a coarse frame began to wait, at the earliest.
        let mut waits_since = None;
        loop {
            // Whatever is sent from here on is either received below or waits.
            waiting.store(false, Ordering::Relaxed);
            let is_idle = frame.is_none() && estimate.is_none() && choose.is_none();
            let received = match first.pop_front() {
                Some(command) => Ok(command),
                None if is_idle && is_prepared => commands.recv().map_err(|_| TryRecvError::Disconnected),
                None => commands.try_recv(),
            };
            let mut next = match received {
                Err(TryRecvError::Disconnected) => return,
                received => received.ok(),
            };
            if is_idle && next.is_none() && !is_prepared {
                // A frame that needs what cannot be compiled reports it.
                let outcome = self.prepare_moving(waiting);
                is_prepared = *outcome.as_ref().unwrap_or(&true);
                if let Err(error) = outcome
                    && is_fatal(&error)
                    && let Err(error) = self.survive(error, report)
                {
                    return report(Report::Lost(error.to_string()));
                }
                continue;
            }
            urgent.store(false, Ordering::Relaxed);
            waiting.store(false, Ordering::Relaxed);
            let started = Instant::now();
            let waits = waits_since.take().filter(|_| next.is_some());
            while let Some(command) = next {
                let result = match command {
                    Command::Frame(request) => {
                        frame = Some(request);
                        Ok(())
                    }
                    Command::Estimate { request, seed } => {
                        estimate = Some((request, seed));
                        Ok(())
                    }
                    Command::Choose { request, target, is_first, model } => {
                        choose = Some((request, target, is_first, model));
                        Ok(())
                    }
                    Command::ShowOn(window_gpu) => {
                        self.window_gpu = window_gpu;
                        frame = frame.or_else(|| self.on_screen.clone().map(Box::new));
                        Ok(())
                    }
                    Command::Change(change) => {
                        self.moving.learn(&change);
                        if let Change::Visibility { test } = change {
                            self.test = Some(test);
                            Ok(())
                        } else {
                            self.resident.apply(change)
                        }
                    }
                    Command::Arrived(pass) => {
                        drop(pass);
                        Ok(())
                    }
                    other => {
                        self.apply_test();
                        self.obey(other, report)
                    }
                };
                match result {
                    Err(error) if is_fatal(&error) => {
                        if let Err(error) = self.survive(error, report) {
                            return report(Report::Lost(error.to_string()));
                        }
                    }
                    Err(error) => report(Report::Problem(error.to_string())),
                    Ok(()) => {}
                }
                if frame.is_some() && started.elapsed() > upload_slice {
                    break;
                }
                next = first.pop_front().or_else(|| commands.try_recv().ok());
            }
            self.apply_test();
            if let Some(request) = frame.take() {
                self.renderer.give_up_when((!request.hurried).then(|| once_set(urgent)));
                let is_new = self.on_screen.as_ref() != Some(&*request);
                // A picture at rest waits for no coarse frame.
                let began = waits.filter(|_| request.hurried).unwrap_or_else(Instant::now);
                let drawn = self.draw((*request).clone(), began);
                self.renderer.give_up_when(None);
                match drawn {
                    Ok(drawn) => {
                        upload_slice = UPLOAD_SLICE.max(drawn.started.elapsed());
                        let is_whole = request.is_whole(&drawn.stats);
                        finish(Finished::Drawn(Box::new(drawn)));
                        is_prepared = false;
                        let outcome = match request.hurried {
                            true => self.renew_coarse(&request, commands, &mut first, COARSE_SLICE, finish),
                            // Of the steps between, nothing is kept.
                            false if is_new || is_whole => self.keep_light(&request).map(|()| None),
                            false => Ok(None),
                        };
                        if !is_whole {
                            // The samples that are left come next, unless another frame is requested.
                            frame = Some(request);
                        }
                        match outcome {
                            Ok(since) => waits_since = since,
                            Err(error) if is_fatal(&error) => {
                                if let Err(error) = self.survive(error, report) {
                                    return report(Report::Lost(error.to_string()));
                                }
                            }
                            Err(error) => {
                                let told = error.to_string();
                                if self.moving.put_off(&told) {
                                    report(Report::Problem(told));
                                }
                            }
                        }
                    }
                    Err(render::Error::GivenUp) => frame = Some(request),
                    Err(error) if is_fatal(&error) => match self.survive(error, report) {
                        Ok(()) => frame = Some(request),
                        Err(error) => return report(Report::Lost(error.to_string())),
                    },
                    Err(error) => report(Report::NotDrawn(error.to_string())),
                }
            } else if let Some((request, seed)) = estimate.take() {
                self.renderer.give_up_when(Some(once_set(urgent)));
                let answer = self.estimate(&request, seed);
                self.renderer.give_up_when(None);
                let answer = match answer {
                    Err(error) if is_fatal(&error) => match self.survive(error, report) {
                        Ok(()) => Ok(None),
                        Err(error) => return report(Report::Lost(error.to_string())),
                    },
                    Err(render::Error::GivenUp) => Ok(None),
                    answer => answer.map_err(|error| error.to_string()),
                };
                report(Report::Estimated { request, answer });
            } else if let Some((request, target, is_first, mut model)) = choose.take() {
                self.renderer.give_up_when(Some(once_set(waiting)));
                let choice = self.choose(&request, (target, is_first), &mut model);
                self.renderer.give_up_when(None);
                let choice = match choice.map_err(|error| error.downcast::<render::Error>()) {
                    Ok(choice) => Ok(Some(choice)),
                    Err(Ok(error)) if is_fatal(&error) => match self.survive(error, report) {
                        Ok(()) => Ok(None),
                        Err(error) => return report(Report::Lost(error.to_string())),
                    },
                    Err(Ok(render::Error::GivenUp)) => Ok(None),
                    Err(Ok(error)) => Err(error.to_string()),
                    Err(Err(error)) => Err(format!("{error:#}")),
                };
                report(Report::Chosen { request, choice: Box::new(choice), model });
            }
        }
    }

    fn apply_test(&mut self) {
        if let Some(test) = self.test.take() {
            let started = Instant::now();
            self.resident.store.set_visibility(&test);
            tracing::debug!(milliseconds = started.elapsed().as_secs_f64() * 1e3, "points tested");
        }
    }

    fn obey(&mut self, command: Command, report: &impl Fn(Report)) -> render::Result<()> {
        match command {
            Command::Pick { pixel, purpose } => {
                let point = self.pick(pixel);
                // What waits for an answer goes on without a point.
                let found = point.as_ref().map_or(None, |point| *point);
                report(Report::Picked { pixel, purpose, point: found });
                point?;
            }
            Command::Save { request, path, facts } => {
                self.hold(&request, true)?;
                let mut pixels = self.renderer.read_picture()?;
                overlays::draw(&mut pixels, request.size, &request.camera, &request.settings, &facts);
                let adapter = picture_file::adapter(&self.gpu);
                report(match picture_file::write_png(&path, request.size, &pixels, Some(&adapter)) {
                    Ok(()) => Report::Saved(path.to_path_buf()),
                    Err(error) => Report::Problem(format!("{error:#}")),
                });
            }
            Command::Read { request, images } => {
                self.hold(&request, true)?;
                let rgba = self.renderer.read_picture()?;
                let origin = picture_file::origin(&request.camera);
                let read = |image| self.renderer.read_aov_from(image, origin);
                let images = images.into_iter().map(read).collect::<Result<_, _>>()?;
                report(Report::Read(Box::new(Picture {
                    camera: request.camera,
                    revision: request.revision,
                    rgba,
                    images,
                })));
            }
            Command::Capture { .. } | Command::Measure(_) | Command::Present { .. } => {
                match self.judge(command, report) {
                    Err(error) if !is_fatal(&error) => report(Report::NotJudged(error.to_string())),
                    result => return result,
                }
            }
            Command::Change(_)
            | Command::Arrived(_)
            | Command::Frame(_)
            | Command::ShowOn(_)
            | Command::Estimate { .. }
            | Command::Choose { .. } => {}
        }
        Ok(())
    }

    /// The point of a cloud that is seen under a pixel.
    fn pick(&mut self, pixel: [u32; 2]) -> render::Result<Option<PickedPoint>> {
        match self.on_screen.clone() {
            Some(request) if !self.moving.is_shown => {
                let surface = request.surface_alone();
                let is_there = |held: &FrameRequest| *held == request || *held == surface;
                if !self.surface.as_ref().is_some_and(is_there) {
                    self.render(&surface, None)?;
                }
                let (drawn, radius) = request.picked(pixel);
                let picked = self.renderer.pick(&self.resident.store, drawn, radius)?;
                Ok(picked.and_then(|picked| PickedPoint::new(&self.resident, picked)))
            }
            shown => Ok(self.moving.pick(&self.resident, shown.as_ref(), pixel)),
        }
    }

    /// Carries out a command for the truth.
    fn judge(&mut self, command: Command, report: &impl Fn(Report)) -> render::Result<()> {
        match command {
            Command::Capture { request, origin } => {
                self.hold(&request, true)?;
                let drawn = Drawn::read(&self.renderer, &request.settings, origin)?;
                let picture = self.renderer.read_picture()?;
                report(Report::Captured(Box::new(Captured { request: *request, drawn, picture })));
            }
            Command::Measure(request) => {
                self.renderer.forget();
                (self.held, self.surface) = (None, None);
                let stats = Box::new(self.render(&request, None)?);
                report(Report::Measured { request, stats });
            }
            Command::Present { request, colors, pass, fits_exposure } => {
                self.hold(&request, false)?;
                self.renderer.present(&request.settings, &colors, fits_exposure)?;
                self.held = self.held.take().map(|(request, _)| (request, false));
                let rgba = self.renderer.read_picture()?;
                report(Report::Presented { request, pass, rgba });
            }
            _ => {}
        }
        Ok(())
    }

    /// Judges random pixels of a frame, if it is the one in the window.
    fn estimate(&mut self, request: &FrameRequest, seed: u64) -> render::Result<Option<Judged>> {
        if self.on_screen.as_ref() != Some(request) {
            return Ok(None);
        }
        let started = Instant::now();
        self.hold(request, false)?;
        let there = (self.held.take(), self.surface.take());
        let judged = study::judge(&mut self.renderer, &self.resident.store, frame_of(request), study::RAYS, seed)?;
        (self.held, self.surface) = there;
        tracing::debug!(milliseconds = started.elapsed().as_secs_f64() * 1e3, "estimate");
        Ok(Some(judged))
    }

    /// Lets `auto` choose: first by what is known of other views, if `is_first` is set and that is enough. Pictures of
    /// the window are never enlarged.
    fn choose(
        &mut self,
        request: &FrameRequest,
        (target, is_first): (Target, bool),
        model: &mut CostModel,
    ) -> anyhow::Result<Choice> {
        let FrameRequest { mirrors, lights, clues, camera, settings, size, .. } = request;
        let objects = Objects { mirrors, lights, clues: *clues };
        (self.held, self.surface) = (None, None);
        let Self { renderer, resident, .. } = self;
        let mut draw = |renderer: &mut Renderer, settings: &Settings, size: [u32; 2]| {
            Ok(renderer.render(&resident.store, &render::Frame::new(camera, settings, objects, size))?)
        };
        let mut hands = auto::Hands { renderer, draw: &mut draw, model };
        let fixed = ["view.resolution".to_owned()];
        let mut explored = auto::Explored::new(settings, &fixed, (camera, *size), true, &mut hands)?;
        let first = if is_first { explored.first(target, &mut hands)? } else { None };
        first.map_or_else(|| explored.choose(target, &mut hands), Ok)
    }

    fn is_held(&self, request: &FrameRequest) -> bool {
        self.held.as_ref().is_some_and(|(held, _)| held == request)
    }

    /// Draws a frame unless the renderer holds it, and also its picture if `with_picture` is set.
    fn hold(&mut self, request: &FrameRequest, with_picture: bool) -> render::Result<()> {
        let is_held = |(held, has_picture): &(FrameRequest, bool)| held == request && (*has_picture || !with_picture);
        if !self.held.as_ref().is_some_and(is_held) {
            self.render(request, None)?;
        }
        Ok(())
    }

    /// The frame of a request, which takes the place of the one that is held; `samples` as for `render`.
    fn begin<'a>(&mut self, request: &'a FrameRequest, samples: Option<u32>) -> render::Frame<'a> {
        let stands = self.is_held(request) && request.settings.reflection.keep;
        self.surface = self.surface.take().filter(|_| stands);
        self.held = None;
        let adaptation = self.moving.adaptation(request.hurried).filter(|_| samples.is_some());
        let frame = frame_of(request);
        let effort = Effort { most_samples: samples, adaptation, ..frame.effort };
        render::Frame { effort, ..frame }
    }

    /// Renders a frame for the window, if `samples` is given: of glossy mirrors, and of rays of light, it adds at most so
    /// many to those of the frame before, if that was the same, and its exposure follows that of the frame before. Other
    /// frames are final.
    fn render(&mut self, request: &FrameRequest, samples: Option<u32>) -> render::Result<FrameStats> {
        let frame = self.begin(request, samples);
        self.renderer.prepare(&self.resident.store, &frame, &self.shaders)?;
        self.moving.can_reflect |= !request.mirrors.is_empty() || self.resident.store.has_mirrors();
        let stats = self.renderer.render(&self.resident.store, &frame)?;
        let [summed, asked] = stats.samples();
        let adapts = stats.exposure.is_some_and(|exposure| exposure.adapts);
        self.held = Some((request.clone(), summed == asked && !adapts));
        self.surface = Some(request.clone());
        Ok(stats)
    }

    /// Draws a frame, which was begun, or waited for, at a time.
    fn draw(&mut self, request: FrameRequest, started: Instant) -> render::Result<DrawnFrame> {
        let began = Instant::now();
        let (mut stats, rows) = match request.hurried {
            true => self.draw_moving(&request)?,
            false => self.draw_by_passes(&request)?,
        };
        tracing::debug!(hurried = request.hurried, points = stats.points_drawn, passes = ?stats.passes, "frame");
        self.moving.is_shown = stats.is_quick;
        self.moving.keep_exposure(&request, &stats, began);
        if !request.hurried {
            self.judge.on_still(&request);
        }
        if let Some(still) = self.judge.still_of(&request) {
            self.render(&still, None)?;
            stats.flip = Some(judging::flip_to_still(&rows, request.drawn_size(), &self.renderer, request.size)?);
        }
        self.on_screen = Some(request.clone());
        Ok(DrawnFrame { request, stats, rows, started, window_gpu: self.window_gpu.clone() })
    }

    /// Keeps what moving pictures take over from the picture at rest that the renderer holds.
    fn keep_light(&mut self, request: &FrameRequest) -> render::Result<()> {
        self.moving.keep_light(&self.gpu, &self.renderer, &self.resident.store, request)
    }

    /// Draws a hurried frame: as a quick picture, if that can be.
    fn draw_moving(&mut self, request: &FrameRequest) -> render::Result<(FrameStats, PictureRows)> {
        if let Some(coarse) = self.moving.lacks(&self.gpu, &self.resident.store, request) {
            let (stats, _) = self.draw_by_passes(&coarse)?;
            let (milliseconds, has_compiled) = (stats.frame_milliseconds, stats.has_compiled);
            tracing::debug!(milliseconds, has_compiled, "coarse frame");
            self.moving.keep_coarse(&self.renderer, &self.resident.store, &coarse, Instant::now(), &stats)?;
        }
        match self.moving.draw(&self.gpu, &self.resident.store, request) {
            Some(drawn) => Ok(drawn),
            None => self.draw_by_passes(request),
        }
    }

    /// Draws the coarse frame that is due after a quick picture. Each time it was worked at for a `slice`, the quick picture
    /// that waits is drawn between its passes, with the coarse frame before; commands of other kinds wait in `queue`.
    /// Returns since when a picture that waits now may have done so.
    fn renew_coarse(
        &mut self,
        shown: &FrameRequest,
        commands: &Receiver<Command>,
        queue: &mut VecDeque<Command>,
        slice: Duration,
        finish: &impl Fn(Finished),
    ) -> render::Result<Option<Instant>> {
        let Some(coarse) = self.moving.is_due(&self.gpu, &self.resident.store, shown).filter(|_| queue.is_empty())
        else {
            return Ok(None);
        };
        let began = Instant::now();
        let frame = self.begin(&coarse, Some(1));
        self.renderer.prepare(&self.resident.store, &frame, &self.shaders)?;
        let Self { gpu, window_gpu, renderer, resident, moving, judge, on_screen, .. } = self;
        let store = &resident.store;
        let going_on = RefCell::new((moving, judge, queue, on_screen, began));
        let is_given_up = || {
            let (moving, judge, queue, on_screen, since) = &mut *going_on.borrow_mut();
            if since.elapsed() < slice {
                return false;
            }
            // Of several waiting frames only the latest is drawn, and none before a change that was sent before it.
            let mut latest = None;
            while let Ok(command) = commands.try_recv() {
                match command {
                    Command::Frame(request) if request.hurried && queue.is_empty() => latest = Some(request),
                    other => queue.push_back(other),
                }
            }
            if let Some(request) = latest {
                // The coarse frame would take the place of the picture at rest to which a picture is compared.
                let is_judged = judge.is_next(&request);
                let drawn = if is_judged { None } else { moving.draw(gpu, store, &request) };
                match drawn {
                    Some((stats, rows)) => {
                        judge.still_of(&request);
                        **on_screen = Some((*request).clone());
                        // What was done for the coarse frame meanwhile counts.
                        let (request, started, window_gpu) = (*request, *since, window_gpu.clone());
                        finish(Finished::Drawn(Box::new(DrawnFrame { request, stats, rows, started, window_gpu })));
                        *since = Instant::now();
                    }
                    None => {
                        queue.push_front(Command::Frame(request));
                        // It needs another coarse frame, or the renderer.
                        return !is_judged;
                    }
                }
            }
            // A picture at rest needs no coarse frame.
            queue.iter().any(|command| matches!(command, Command::Frame(request) if !request.hurried))
        };
        let outcome = renderer.render_asking(store, &frame, &is_given_up);
        let since = going_on.into_inner().4;
        match outcome {
            Ok(stats) => {
                tracing::debug!(milliseconds = stats.frame_milliseconds, "coarse frame, between pictures");
                self.moving.keep_coarse(&self.renderer, &self.resident.store, &coarse, began, &stats)?;
            }
            Err(render::Error::GivenUp) => {}
            Err(error) => return Err(error),
        }
        Ok(Some(since))
    }

    /// Makes the most of a rest: prepares the frames that come when something begins to move in the picture on the screen, and
    /// gives that up for whatever is `waiting`. Whether nothing is left to be done.
    fn prepare_moving(&mut self, waiting: &Arc<AtomicBool>) -> render::Result<bool> {
        let Some(request) = self.on_screen.clone().filter(|request| !request.hurried) else { return Ok(true) };
        let Self { gpu, resident, renderer, shaders, .. } = self;
        let prepared = self.moving.prepare(gpu, renderer, &resident.store, &request, shaders);
        if prepared.is_err() {
            // The renderer may have given up the picture that it held.
            (self.held, self.surface) = (None, None);
        }
        if !prepared? {
            return Ok(true);
        }
        self.renderer.give_up_when(Some(once_set(waiting)));
        let looked = self.moving.look_around(&mut self.renderer, &self.resident.store, &request);
        self.renderer.give_up_when(None);
        match looked {
            Err(render::Error::GivenUp) => Ok(false),
            looked => looked,
        }
    }

    /// Draws a frame by the passes of the renderer.
    fn draw_by_passes(&mut self, request: &FrameRequest) -> render::Result<(FrameStats, PictureRows)> {
        // At rest, the samples of glossy mirrors and the rays of light come in steps that grow, so that the first picture
        // comes soon.
        let summed = if self.is_held(request) { self.summed } else { 0 };
        let stats = self.render(request, Some(summed.clamp(1, MOST_SAMPLES)))?;
        self.summed = stats.glossy_samples[0].max(stats.light_rays[0]);
        Ok((stats, self.renderer.picture_rows()?))
    }
}

/// Gives a frame up once a flag is set.
fn once_set(flag: &Arc<AtomicBool>) -> Arc<IsGivenUp> {
    let flag = flag.clone();
    Arc::new(move || flag.load(Ordering::Relaxed))
}

/// Whether no further frame can be drawn on the device after this error.
fn is_fatal(error: &render::Error) -> bool {
    matches!(error, render::Error::Lost(_))
}

#[cfg(test)]
#[path = "render_thread_tests.rs"]
mod tests;
