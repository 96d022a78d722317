//! What the render thread does while its shaders are compiled: it takes in points, and shows them in quick pictures where
//! the adapter is a processor.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use cloud::Progress;
use render::{Gpu, Renderer};
use world::{Change, Resident};

use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Report};
use crate::viewer::picture::moving::MovingPictures;
use crate::viewer::picture::picture_writer::{DrawnFrame, Finished};

/// A render thread whose renderer is not ready.
pub struct Beginning {
    pub gpu: Arc<Gpu>,
    pub window_gpu: Arc<Gpu>,
    pub resident: Resident,
    pub moving: MovingPictures,
    /// The frame in the window.
    pub on_screen: Option<FrameRequest>,
    /// The commands that wait for the renderer, in their order.
    pub waiting: VecDeque<Command>,
    /// Whether something was opened, and whether a picture of points was drawn.
    has_opened: bool,
    shows_points: bool,
}

/// How often it is looked whether the shaders are compiled.
const STEP: Duration = Duration::from_millis(20);
/// The longest time for which points are uploaded before a waiting frame is drawn.
const UPLOAD_SLICE: Duration = Duration::from_millis(50);
/// How long compiling waits for the first points of what is opened: without the driver's cache it keeps all cores from
/// reading them. And how long it waits for something to be opened.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);
const WAIT_FOR_OPENING: Duration = Duration::from_millis(800);

impl Beginning {
    pub fn new(gpu: Arc<Gpu>, window_gpu: Arc<Gpu>) -> Self {
        let resident = Resident::new(gpu.clone());
        let (moving, on_screen, waiting) = Default::default();
        Self { gpu, window_gpu, resident, moving, on_screen, waiting, has_opened: false, shows_points: false }
    }

    /// Compiles the passes that every picture needs, after the first quick picture of points where there is one soon.
    ///
    /// # Errors
    /// Those of `Renderer::with_progress`; the device was lost.
    pub fn compile(
        &mut self,
        commands: &Receiver<Command>,
        shaders: &Arc<Progress>,
        finish: &impl Fn(Finished),
    ) -> render::Result<Renderer> {
        let gpu = self.gpu.clone();
        let (began, mut frame) = (Instant::now(), None);
        let longest = |opens: bool| if opens { LONGEST_WAIT } else { WAIT_FOR_OPENING };
        while began.elapsed() < longest(self.has_opened) && self.may_wait(frame.as_deref()) {
            if !self.step(commands, &mut frame, finish)? {
                break;
            }
        }
        std::thread::scope(|scope| {
            let compiling = scope.spawn(move || Renderer::with_progress(gpu, shaders));
            while self.gpu.is_processor() && !compiling.is_finished() && self.step(commands, &mut frame, finish)? {}
            self.waiting.extend(frame.map(Command::Frame));
            // A panic goes on in this thread, which reports it.
            compiling.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// Whether nothing needs the renderer as long as no points are shown; `frame` is the one that is asked for.
    fn may_wait(&self, frame: Option<&FrameRequest>) -> bool {
        let is_quick = frame.is_none_or(|frame| frame.hurried);
        self.gpu.is_processor() && !self.shows_points && self.waiting.is_empty() && is_quick
    }

    /// Carries out the commands that have come, and draws the last frame among them if it can be a quick picture. Other
    /// frames are left in `frame`. Returns false when nobody sends commands any more.
    ///
    /// # Errors
    /// The device was lost.
    fn step(
        &mut self,
        commands: &Receiver<Command>,
        frame: &mut Option<Box<FrameRequest>>,
        finish: &impl Fn(Finished),
    ) -> render::Result<bool> {
        let started = Instant::now();
        let mut next = match commands.recv_timeout(STEP) {
            Err(RecvTimeoutError::Disconnected) => return Ok(false),
            next => next.ok(),
        };
        while let Some(command) = next {
            if let Command::Frame(request) = command {
                *frame = Some(request);
            } else if let Some(command) = self.obey(command, finish)? {
                self.waiting.push_back(command);
            }
            if frame.is_some() && started.elapsed() > UPLOAD_SLICE {
                break;
            }
            next = commands.try_recv().ok();
        }
        let hurried = frame.as_ref().filter(|frame| frame.hurried && self.waiting.is_empty());
        let started = Instant::now();
        let drawn = hurried.and_then(|request| self.moving.draw(&self.gpu, &self.resident.store, request));
        if let Some((stats, rows)) = drawn
            && let Some(request) = frame.take()
        {
            self.on_screen = Some((*request).clone());
            self.shows_points |= stats.points_drawn > 0;
            let window_gpu = self.window_gpu.clone();
            finish(Finished::Drawn(Box::new(DrawnFrame { request: *request, stats, rows, started, window_gpu })));
        }
        Ok(true)
    }

    /// Carries out a command that needs no renderer, unless others wait before it; returns those that must wait.
    fn obey(&mut self, command: Command, finish: &impl Fn(Finished)) -> render::Result<Option<Command>> {
        if !self.waiting.is_empty() {
            return Ok(Some(command));
        }
        match command {
            Command::Change(Change::Visibility { test }) => self.resident.store.set_visibility(&test),
            Command::Change(change) => {
                self.has_opened = true;
                match self.resident.apply(change) {
                    Err(error @ render::Error::Lost(_)) => return Err(error),
                    Err(error) => finish(Finished::Told(Report::Problem(error.to_string()))),
                    Ok(()) => {}
                }
            }
            Command::Arrived(pass) => drop(pass),
            Command::ShowOn(window_gpu) => self.window_gpu = window_gpu,
            Command::Pick { pixel, purpose } if self.moving.is_shown => {
                let point = self.moving.pick(&self.resident, self.on_screen.as_ref(), pixel);
                finish(Finished::Told(Report::Picked { pixel, purpose, point }));
            }
            other => return Ok(Some(other)),
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::sync::mpsc::channel;

    use cloud::{Chunk, PointTest, pack_normal, pack_radius};
    use glam::{DVec3, Vec3};
    use scene::{Camera, LightClues, Settings};
    use world::{CloudKey, Part};

    use super::*;
    use crate::viewer::bench::own_device;
    use crate::viewer::picture::messages::PickPurpose;
    use crate::viewer::picture::pace::Spared;

    /// A wall of points without colours at x = 2.
    fn wall() -> Chunk {
        let place = |i: u32| DVec3::new(2.0, f64::from(i % 64) / 16.0 - 2.0, f64::from(i / 64) / 16.0 - 2.0);
        let places: Vec<DVec3> = (0..4096).map(place).collect();
        let mut chunk = Chunk::of_places(0, &places);
        chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::NEG_X); places.len()]));
        chunk.radii = Some(Arc::new(vec![pack_radius(0.1); places.len()]));
        chunk
    }

    /// A picture at rest, and a quick one.
    fn requests() -> [FrameRequest; 2] {
        let mut settings = Settings::default();
        // Light is not known yet.
        settings.set_text("light.by", "sun").unwrap();
        let still = FrameRequest {
            camera: Camera::from_eye(DVec3::ZERO, DVec3::X, DVec3::Z),
            settings,
            mirrors: Vec::new(),
            lights: Vec::new(),
            clues: LightClues::default(),
            size: [64, 48],
            test: PointTest::default(),
            revision: 1,
            spared: None,
            hurried: false,
            light_may_lag: false,
        };
        let spared = Some(Spared { divisor: 2, ..Spared::NOTHING });
        [still.clone(), FrameRequest { spared, hurried: true, ..still }]
    }

    #[test]
    fn points_are_shown_and_picked_before_the_shaders_are_compiled_and_what_needs_them_waits_in_order() {
        let Some(gpu) = own_device() else { return };
        if !gpu.is_processor() {
            return eprintln!("skipped: the adapter is no processor");
        }
        let mut beginning = Beginning::new(gpu.clone(), gpu);
        let (commands, received) = channel();
        let finished = RefCell::new(Vec::new());
        let finish = |done| finished.borrow_mut().push(done);
        let mut frame = None;
        let [still, quick] = requests();
        let (cloud, key) = (CloudKey(0), CloudKey(0).chunk(Part::Block(0)));
        let mut send = |command| {
            commands.send(command).unwrap();
            assert!(beginning.step(&received, &mut frame, &finish).unwrap());
        };
        send(Command::Change(Change::Open { cloud, provisional_radius: 0.1 }));
        send(Command::Change(Change::Put { key, chunk: wall(), layout: Arc::default() }));
        send(Command::Frame(Box::new(quick.clone())));
        send(Command::Pick { pixel: [32, 24], purpose: PickPurpose::Hover });
        let Ok([Finished::Drawn(drawn), Finished::Told(Report::Picked { point, .. })]) =
            <[Finished; 2]>::try_from(finished.take())
        else {
            panic!("no picture, or no answer to the pick")
        };
        assert!(drawn.stats.is_quick && drawn.request == quick);
        let middle = &drawn.rows.tight()[(12 * 32 + 16) * 4..][..4];
        assert_eq!(middle, Settings::default().color.plain.bytes(), "the wall in the colour of points without another");
        assert_eq!(point.map(|point| point.chunk), Some(key));

        // A picture at rest and what it is read for wait, and so do later changes.
        send(Command::Frame(Box::new(still)));
        send(Command::Read { request: Box::new(quick.clone()), images: Vec::new() });
        send(Command::Change(Change::TakeOut { key }));
        send(Command::Frame(Box::new(quick)));
        assert!(finished.take().is_empty());
        assert!(matches!(beginning.waiting.pop_front(), Some(Command::Read { .. })));
        assert!(matches!(beginning.waiting.pop_front(), Some(Command::Change(Change::TakeOut { .. }))));
        drop(commands);
        assert!(!beginning.step(&received, &mut frame, &finish).unwrap(), "nobody sends commands any more");
        assert!(frame.is_some_and(|frame| frame.hurried), "the last frame is kept");
    }

    #[test]
    fn nothing_is_compiled_before_the_first_points_are_shown() {
        let Some(gpu) = own_device() else { return };
        if !gpu.is_processor() {
            return eprintln!("skipped: the adapter is no processor");
        }
        let mut beginning = Beginning::new(gpu.clone(), gpu);
        let (commands, received) = channel();
        let (cloud, key) = (CloudKey(0), CloudKey(0).chunk(Part::Block(0)));
        commands.send(Command::Change(Change::Open { cloud, provisional_radius: 0.1 })).unwrap();
        let sender = std::thread::spawn(move || {
            // Compiling would have begun long ago.
            std::thread::sleep(Duration::from_millis(100));
            commands.send(Command::Change(Change::Put { key, chunk: wall(), layout: Arc::default() })).unwrap();
            commands.send(Command::Frame(Box::new(requests()[1].clone()))).unwrap();
            commands
        });
        let shaders = Arc::<Progress>::default();
        let compiled = RefCell::new(Vec::new());
        let finish = |done| {
            if matches!(done, Finished::Drawn(_)) {
                compiled.borrow_mut().push(shaders.total());
            }
        };
        beginning.compile(&received, &shaders, &finish).unwrap();
        drop(sender.join());
        assert_eq!(compiled.take(), [0]);
        assert!(shaders.total() > 0);
    }
}
