//! The viewer's window. `session` holds what the viewer knows, `interface` draws it, `input` turns keys and mouse into
//! actions, `picture::render_thread` draws the points, and `screen` is the surface. This file connects them:
//! events from the system, from loading, from the render thread and from workers change the session, and then the
//! effects that the session has queued are carried out.
//!
//! Nothing here blocks: other threads read files, look up columns, compute figures and draw points. They wake the event
//! loop when they have results.

#[cfg(test)]
mod assistive_tests;
#[cfg(test)]
pub mod bench;
mod filming;
mod frames;
mod headless;
mod input;
mod interface;
mod jobs;
#[cfg(test)]
mod keyboard_tests;
#[cfg(test)]
mod language_tests;
mod loaded;
mod look;
mod lost_device;
mod objects;
mod panels;
mod picture;
mod requests;
mod scene;
mod screen;
mod session;
mod tools;
mod truth;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ::scene::{CaptureFormat, Settings, StandardView, View};
use anyhow::Context as _;
use egui_winit::accesskit_winit;
pub use headless::{Headless, Over, PictureStats};
use picture::capture::{self, Capture, Captured};
use picture::event_log::EventLog;
pub use picture::messages::Picture;
use picture::messages::Report;
use picture::pace;
use picture::window_texture::NO_MEMORY;
use requests::action::{Action, Export, Filing, PictureDraft, SavePicture};
use requests::messages::Level;
use requests::outside::{Asked, Effect, News};
use requests::path_prompt::PathPrompt;
use requests::work::Found;
use requests::{autosave, bindings, preferences};
use screen::{Painted, Screen};
use serde_json::json;
use session::Session;
use session::effects::{self, Effects};
use winit::application::ApplicationHandler;
use winit::event::{ElementState, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::WindowId;
use world::Request;

use crate::shared::command_line::ViewArguments;
use crate::shared::export;
use crate::shared::language::{self, text};
use crate::shared::viewpoint::Viewpoint;
use crate::system::failure::{Interrupted, NoScreen, usage};
use crate::system::interrupt;

/// A message from another thread to the window.
enum Wake {
    News(Box<News>),
    /// The files chosen in the system's dialog, and how long the dialog was open.
    Chosen(Option<Vec<PathBuf>>, Duration),
    /// What a place was asked for, the place that was chosen, how long the dialog was open, and the place that was
    /// proposed.
    Placed(Asked, Option<PathBuf>, Duration, PathBuf),
    /// Ctrl-C was pressed in the terminal.
    Interrupted,
    /// The window's own device is lost.
    Lost,
    /// The window's device has no memory left, and why it says so.
    NoMemory(String),
    /// An assistive program, such as a screen reader, asks for something.
    Assistive(accesskit_winit::WindowEvent),
}

impl From<accesskit_winit::Event> for Wake {
    fn from(event: accesskit_winit::Event) -> Self {
        Self::Assistive(event.window_event)
    }
}

/// What the command line says of the first view, besides the inputs.
#[derive(Default)]
pub struct Start {
    /// Parameters that are set, by key.
    set: Vec<(String, String)>,
    /// The side from which everything is seen at first.
    side: Option<StandardView>,
}

impl Start {
    /// Reads `--camera` and checks `--set`. A camera file's view goes into `request`.
    ///
    /// # Errors
    /// Bad usage, or the file cannot be read.
    pub fn new(arguments: &ViewArguments, request: &mut Request) -> anyhow::Result<Self> {
        let mut start = Self { set: arguments.set.clone(), side: None };
        let mut checked = Settings::default();
        for (key, value) in &start.set {
            checked.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
        }
        let Some(word) = arguments.camera.as_deref() else { return Ok(start) };
        if request.inputs.is_empty() {
            return Err(usage("--camera: there is nothing to look at, name an input".to_owned()));
        }
        let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
        let viewpoint = Viewpoint::new(Some(word), request, &mut settings)?;
        let camera = match viewpoint {
            Viewpoint::Camera(camera) => Some(camera),
            Viewpoint::Start => None,
            Viewpoint::Framing(side) => {
                start.side = Some(side);
                None
            }
        };
        request.view = Some(View { camera, settings, warnings: Vec::new() });
        Ok(start)
    }

    fn apply(&self, session: &mut Session) {
        for (key, value) in &self.set {
            if let Err(error) = session.scene.settings.set_text(key, value) {
                session.outside.say(Level::Warning, error.to_string());
            }
        }
        session.scene.first_side = self.side;
        // What the command line asks for is no step of undo.
        let scene = &mut session.scene;
        scene.history.after_jump(&scene.settings, &scene.objects);
    }
}

/// Opens the window with the clouds of `request`, and returns when it is closed. `gpu` is as in `Gpu::headless`.
///
/// # Errors
/// There is no display or adapter (`NoScreen`, `render::Error::NoAdapter`), or the graphics device was lost.
pub fn run(request: Request, start: Start, gpu: Option<String>) -> anyhow::Result<()> {
    let event_loop = EventLoop::<Wake>::with_user_event().build().map_err(|error| no_screen(&error))?;
    let wake = event_loop.create_proxy();
    interrupt::catch(move || drop(wake.send_event(Wake::Interrupted)));
    let (preferences, problem) = preferences::load();
    language::speak(preferences.language);
    let mut session = Session::new(preferences);
    session.auto.is_kept = true;
    if let Some(folder) = preferences::unsaved_folder() {
        let named = request.inputs.iter().map(|input| PathBuf::from(input.name()));
        let scenes = request.scene_files.iter().map(|(path, _)| path.clone());
        let named: Vec<PathBuf> = scenes.chain(named).collect();
        session.document.find_abandoned(autosave::abandoned(&folder), &named, &mut session.outside);
        session.document.keeper = Some(autosave::Keeper::new(folder));
    }
    if let Some(problem) = problem {
        session.outside.say(Level::Warning, problem);
    }
    let wake = event_loop.create_proxy();
    let tell = move |news| wake.send_event(Wake::News(Box::new(news))).is_ok();
    let mut viewer = Viewer {
        wake: event_loop.create_proxy(),
        session,
        request: Some((request, start)),
        before_set: Settings::default(),
        after_set: Settings::default(),
        wanted_gpu: gpu,
        screen: None,
        effects: Effects::new(world::start, Arc::new(tell)),
        log: EventLog::from_environment()?,
        next_paint: None,
        is_asked: Cell::new(false),
        idle_paint: None,
        title: String::new(),
        captures: Vec::new(),
        modifiers: egui::Modifiers::NONE,
        device_lost: Arc::default(),
        lost_at: None,
        loses_device: render::acts_like("lost-window"),
        failure: None,
    };
    let ended = event_loop.run_app(&mut viewer);
    viewer.end_captures();
    viewer.screen = None;
    viewer.effects.close(&viewer.session);
    // Nobody was asked about unsaved work where something else than a person ended the program.
    let stays = (viewer.failure.is_some() || ended.is_err()) && viewer.session.is_unsaved();
    viewer.session.scene.unpose();
    viewer.session.document.end(stays, &viewer.session.scene, &viewer.session.loaded);
    if let Err(error) = ended {
        // winit's own text names places in its source code, which does not help the user.
        tracing::error!("window: {error}");
        return Err(viewer.failure.unwrap_or_else(|| anyhow::anyhow!("the connection to the desktop was lost")));
    }
    viewer.failure.map_or(Ok(()), Err)
}

/// winit's own text only goes to the log: it names places in its source code and does not say what to do.
fn no_screen(error: &dyn std::error::Error) -> NoScreen {
    tracing::error!("window: {error}");
    NoScreen(
        "no window can be opened on this display; check DISPLAY and WAYLAND_DISPLAY; \
         `glint render` writes a picture without one"
            .into(),
    )
}

struct Viewer {
    wake: EventLoopProxy<Wake>,
    session: Session,
    /// What to open, until the window exists.
    request: Option<(Request, Start)>,
    /// The person's own parameters before and after `--set`.
    before_set: Settings,
    after_set: Settings,
    wanted_gpu: Option<String>,
    screen: Option<Screen>,
    effects: Effects,
    log: EventLog,
    next_paint: Option<Instant>,
    /// Whether the program itself asked the window for a paint, and the system did not.
    is_asked: Cell<bool>,
    /// When the window was painted last, if the next paint may wait.
    idle_paint: Option<Instant>,
    title: String,
    /// Recordings of the window; of the last one the window may still take pictures.
    captures: Vec<Capture>,
    /// The modifier keys that are held down now.
    modifiers: egui::Modifiers,
    /// True when the window's own device or its surface is lost: nothing can be shown before it is opened again.
    device_lost: Arc<AtomicBool>,
    /// When it was last lost.
    lost_at: Option<Instant>,
    /// For tests: whether it is lost after the first picture.
    loses_device: bool,
    /// The reason why the program ends.
    failure: Option<anyhow::Error>,
}

/// The window is painted at most this often while chunks are loaded.
const LOADING_PAINT_INTERVAL: Duration = Duration::from_millis(50);
/// After a paint that changed nothing, moves of the mouse, animations and what they have changed cause the next one no
/// sooner than this: no screen holds back such paints. While a frame is drawn they can wait longer. Where the processors
/// draw it, they wait after every paint, because the window is painted as soon as the frame comes.
const IDLE_PAINT_INTERVALS: [Duration; 2] = [Duration::from_millis(12), Duration::from_millis(30)];
/// A dialog that ends sooner than this was never shown: the system has no service that shows dialogs.
const QUICKEST_HAND: Duration = Duration::from_millis(400);

impl ApplicationHandler<Wake> for Viewer {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.screen.is_some() {
            return;
        }
        if let Err(error) = self.open(event_loop) {
            self.failure = Some(error);
            event_loop.exit();
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. }) {
            self.next_paint = None;
            self.request_paint();
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: Wake) {
        self.session.outside.now = Instant::now();
        let is_of_chunk = |news: &News| {
            matches!(news, News::Loading(_, world::Event::Chunk { .. } | world::Event::Dropped { .. }, _))
        };
        let is_chunk = matches!(&event, Wake::News(news) if is_of_chunk(news));
        match event {
            Wake::News(news) => self.on_news(*news),
            Wake::Interrupted => {
                self.keep_preferences();
                self.failure = Some(Interrupted.into());
                event_loop.exit();
            }
            // What follows is done before the event loop waits.
            Wake::Lost => {}
            Wake::NoMemory(problem) => {
                tracing::error!("window: {problem}");
                self.session.outside.error(NO_MEMORY);
            }
            Wake::Assistive(event) => {
                if let Some(screen) = &mut self.screen {
                    screen.assist(event);
                }
            }
            Wake::Chosen(Some(paths), _) => {
                self.session.open_by_hand(paths);
            }
            Wake::Placed(asked, chosen, took, proposed) => self.on_placed(asked, chosen, took, proposed),
            Wake::Chosen(None, took) => {
                if took < QUICKEST_HAND {
                    self.session.outside.log(json!({ "event": "prompt" }));
                    let reason = text!("No file dialog answers on this desktop: type the path.");
                    self.session.path_prompt = Some(PathPrompt::because(reason));
                }
            }
        }
        self.do_effects();
        if is_chunk {
            self.paint_within(LOADING_PAINT_INTERVAL);
        } else {
            self.request_paint();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.session.outside.now = Instant::now();
        let Some(screen) = &mut self.screen else { return };
        if is_input(&event) {
            self.session.outside.input_at = Some(self.session.outside.now);
        }
        match &event {
            WindowEvent::CloseRequested => {
                self.session.act(Action::Quit);
                // A window that is hidden is not painted, so it must not wait for a paint.
                if self.session.wants_to_quit {
                    self.keep_preferences();
                    return event_loop.exit();
                }
                return self.request_paint();
            }
            WindowEvent::Resized(size) => {
                if let Err(error) = screen.resize(*size) {
                    tracing::error!("window: {error}");
                    self.session.outside.error(NO_MEMORY);
                }
                screen.show_again();
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let keys = modifiers.state();
                let command = if cfg!(target_os = "macos") { keys.super_key() } else { keys.control_key() };
                let (alt, shift) = (keys.alt_key(), keys.shift_key());
                self.modifiers = egui::Modifiers { alt, shift, command, ..egui::Modifiers::NONE };
            }
            WindowEvent::RedrawRequested => {
                if !self.is_asked.replace(false) {
                    screen.show_again();
                }
                return self.paint(event_loop);
            }
            WindowEvent::Occluded(_) | WindowEvent::Focused(_) | WindowEvent::Moved(_) => screen.show_again(),
            WindowEvent::KeyboardInput { event: key, .. } if !screen.context.text_edit_focused() => {
                if let Some(trigger) = own_key(key, self.modifiers) {
                    let action = bindings::action(trigger, self.session.scene.mode);
                    if let (Some(action), ElementState::Pressed, false) = (action, key.state, key.repeat) {
                        self.session.act(action);
                        self.do_effects();
                    }
                    return self.request_paint();
                }
            }
            _ => {}
        }
        if screen.input.on_window_event(&screen.window, &event).repaint {
            let moves = matches!(event, WindowEvent::CursorMoved { .. } | WindowEvent::MouseWheel { .. });
            let idle = self.idle_paint.filter(|_| moves);
            let since = idle.map(|at| self.session.outside.now.saturating_duration_since(at));
            match since.map_or(Duration::ZERO, |since| idle_interval(&self.session).saturating_sub(since)) {
                Duration::ZERO => self.request_paint(),
                wait => self.paint_within(wait),
            }
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if self.device_lost.load(Ordering::Relaxed)
            && self.failure.is_none()
            && let Err(error) = self.open_again(event_loop)
        {
            self.failure = Some(error.context("the graphics device was lost"));
            return event_loop.exit();
        }
        event_loop.set_control_flow(self.next_paint.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}

/// The shortest time between a paint that changed nothing and the next one.
fn idle_interval(session: &Session) -> Duration {
    IDLE_PAINT_INTERVALS[usize::from(session.frames.under_way > 0)]
}

/// Whether a person's hand caused the event.
fn is_input(event: &WindowEvent) -> bool {
    matches!(
        event,
        WindowEvent::CursorMoved { .. }
            | WindowEvent::MouseInput { .. }
            | WindowEvent::MouseWheel { .. }
            | WindowEvent::KeyboardInput { .. }
            | WindowEvent::Ime(_)
            | WindowEvent::Touch(_)
    )
}

/// Finds keys that egui does not pass on unchanged: it reports number pad keys as the number row.
fn own_key(key: &winit::event::KeyEvent, modifiers: egui::Modifiers) -> Option<bindings::Trigger> {
    use requests::bindings::Trigger;
    let PhysicalKey::Code(code) = key.physical_key else { return None };
    match code {
        KeyCode::Numpad1 => Some(Trigger::Numpad(modifiers.into(), 1)),
        KeyCode::Numpad3 => Some(Trigger::Numpad(modifiers.into(), 3)),
        KeyCode::Numpad5 => Some(Trigger::Numpad(modifiers.into(), 5)),
        KeyCode::Numpad7 => Some(Trigger::Numpad(modifiers.into(), 7)),
        _ => None,
    }
}

impl Viewer {
    fn open(&mut self, event_loop: &ActiveEventLoop) -> anyhow::Result<()> {
        let size = self.session.preferences.window;
        let screen = Screen::open(event_loop, size, self.wanted_gpu.as_deref(), self.wake.clone())?;
        self.watch(&screen);
        let started = self.effects.draw_for(screen.gpu.clone(), self.wanted_gpu.clone());
        self.session.frames.shaders = started.context("no thread for the renderer")?;
        self.screen = Some(screen);
        self.log.write(&json!({ "event": "window" }));
        if let Some((request, start)) = self.request.take() {
            let is_empty = request.inputs.is_empty() && request.view.is_none();
            let request = if is_empty { self.unnamed() } else { request };
            self.session.open_at_start(request);
            self.before_set = self.session.scene.own_settings();
            start.apply(&mut self.session);
            self.after_set = self.session.scene.own_settings();
            self.session.document.take_as_saved(&self.session.scene);
        }
        self.do_effects();
        self.request_paint();
        Ok(())
    }

    /// What to open where nothing is named: the last scene file, if the person wants that and it is there, or else the
    /// first look.
    fn unnamed(&self) -> Request {
        let preferences = &self.session.preferences;
        let last = preferences.sessions.first().filter(|_| preferences.reopens);
        let last = last.map(|path| world::resolve(&[path])).filter(|request| request.check().is_ok());
        last.unwrap_or_else(|| world::resolve(&[world::first_scene()]))
    }

    fn request_paint(&self) {
        if let Some(screen) = &self.screen {
            self.is_asked.set(true);
            screen.window.request_redraw();
        }
    }

    fn paint_within(&mut self, delay: Duration) {
        let at = Instant::now() + delay;
        self.next_paint = Some(self.next_paint.map_or(at, |next| next.min(at)));
    }

    fn paint(&mut self, event_loop: &ActiveEventLoop) {
        let Some(screen) = &mut self.screen else { return };
        let (session, mut actions) = (&mut self.session, Vec::new());
        language::speak(session.preferences.language);
        let picture = screen.picture();
        let painted = screen.paint(event_loop, |ui| actions.extend(interface::show(ui, session, picture.as_ref())));
        if let Painted::Next { is_shown: true, .. } = painted
            && let Some(event) = session.frames.present(Instant::now())
        {
            self.log.write(&event);
            if std::mem::take(&mut self.loses_device) {
                screen.gpu.device.destroy();
            }
        }
        // The result of actions becomes visible in the next paint.
        let is_changed = !actions.is_empty();
        session.act_all(actions);
        let is_held = screen.context.input(|input| input.pointer.any_down());
        session.is_typing = screen.context.text_edit_focused();
        let again = session.step(Instant::now(), is_held);
        let capture = match (self.captures.last_mut(), &painted) {
            (Some(capture), Painted::Next { is_new, .. }) => {
                if *is_new {
                    capture.changed();
                }
                capture.step(Instant::now(), || screen.pixels())
            }
            _ => None,
        };
        let must_follow;
        match painted {
            Painted::Next { delay, is_new, .. } => {
                self.log.on_painted();
                let needs_processors = session.frames.under_way > 0 && screen.gpu.is_processor();
                let pause = (!is_new || needs_processors).then(|| idle_interval(session));
                self.idle_paint = pause.map(|_| Instant::now());
                let delay = again.map_or(delay, |again| delay.min(again));
                let delay = pace::next_paint(delay, is_changed, pause);
                let delay = capture.map_or(delay, |capture| delay.min(capture));
                self.next_paint = Instant::now().checked_add(delay);
                must_follow = delay.is_zero();
            }
            Painted::Again => must_follow = true,
            Painted::Lost => {
                self.device_lost.store(true, Ordering::Relaxed);
                must_follow = false;
            }
        }
        if must_follow {
            self.is_asked.set(true);
            screen.window.request_redraw();
        }
        let title = self.session.document.title(self.session.is_unsaved(), &self.session.loaded);
        if title != self.title {
            screen.window.set_title(&title);
            self.title = title;
        }
        self.do_effects();
        if self.session.wants_to_quit {
            self.keep_preferences();
            self.failure = self.session.fatal.take().map(anyhow::Error::msg);
            event_loop.exit();
        }
    }

    /// Takes in the answer of a dialog that asked for a place; `proposed` is the place that it proposed.
    fn on_placed(&mut self, asked: Asked, chosen: Option<PathBuf>, took: Duration, proposed: PathBuf) {
        let has_no_dialog = chosen.is_none() && took < QUICKEST_HAND;
        let session = &mut self.session;
        match (asked, chosen) {
            (Asked::Points, Some(path)) => session.act(Action::Export(Export::To(path))),
            (Asked::Points, None) if has_no_dialog => {
                session.outside.log(json!({ "event": "prompt" }));
                let reason = text!("No file dialog answers on this desktop: type the path.");
                session.path_prompt = Some(PathPrompt::to_save_points(&proposed, reason));
            }
            (Asked::Points, None) => {}
            (Asked::Scene, Some(path)) => session.act(Action::File(Filing::SaveTo(path))),
            (Asked::Scene, None) if has_no_dialog => {
                session.outside.log(json!({ "event": "prompt" }));
                let reason = text!("No file dialog answers on this desktop: type the path.");
                session.path_prompt = Some(PathPrompt::to_save_scene(&proposed, reason));
            }
            (Asked::Scene, None) => session.act(Action::File(Filing::NoPlace)),
            (Asked::Picture, Some(path)) => {
                let path = path.display().to_string();
                let draft = session.tools.picture_draft.clone().map(|draft| Box::new(PictureDraft { path, ..draft }));
                session.act(Action::SavePicture(SavePicture::Change(draft)));
            }
            (Asked::Picture, None) if has_no_dialog => {
                session.outside.note(text!("No file dialog answers on this desktop: type the path."));
            }
            (Asked::Picture, None) => {}
        }
    }

    fn on_news(&mut self, news: News) {
        if let (News::Report(Report::Frame(frame)), Some(screen)) = (&news, &mut self.screen) {
            // The session decides whether the frame is shown. One of a device that was lost since is not.
            if Arc::ptr_eq(&frame.window_gpu, &screen.gpu) {
                screen.set_picture(&frame.texture);
            }
        }
        let is_saved = matches!(news, News::Found(requests::work::Found::SceneSaved { .. }));
        let is_loaded = matches!(news, News::Loading(_, world::Event::Finished, _));
        self.session.on_news(news);
        if is_loaded || is_saved {
            self.keep_preferences();
        }
    }

    fn keep_preferences(&mut self) {
        if let Some(screen) = self.screen.as_ref().filter(|_| !self.session.is_full_screen) {
            self.session.preferences.window = screen.size();
        }
        // What the command line has set is not kept.
        let settings = self.session.scene.own_settings();
        let settings = self.before_set.with_changes(&self.after_set, &settings);
        self.session.preferences.remember_settings(&settings);
        if let Err(error) = preferences::save(&self.session.preferences) {
            self.session.outside.warning(text!("settings are not kept: {error}", error = format_args!("{error:#}")));
        }
        self.session.auto.keep(&mut self.session.outside);
    }

    fn begin_capture(&mut self, name: &Path, format: CaptureFormat, dropped: Arc<AtomicU64>) {
        let Some(screen) = &self.screen else { return };
        let wake = self.wake.clone();
        let tell = move |captured| drop(wake.send_event(Wake::News(Box::new(News::Found(Found::Captured(captured))))));
        match Capture::new(name, format, screen.pixel_size(), dropped, tell) {
            Ok(capture) => {
                self.session.outside.note(text!("Recording the window: {file}", file = name.display()));
                self.captures.push(capture);
            }
            Err(error) => {
                let captured = Captured { result: Err(format!("{error:#}")) };
                self.session.on_found(Found::Captured(captured));
            }
        }
    }

    /// Keeps the pictures of recordings of the window whose films are not made.
    fn end_captures(&mut self) {
        for capture in self.captures.drain(..) {
            capture.give_up();
        }
        if let Some(live) = &self.session.filming.live {
            let (name, folder) = (live.name.display(), capture::folder_of(&live.name));
            let told =
                format!("the window was closed before {name} was made; its pictures are in {}", folder.display());
            crate::system::terminal::warn([told]);
        }
    }

    /// Carries out the effects that the session has queued.
    fn do_effects(&mut self) {
        for effect in std::mem::take(&mut self.session.outside.effects) {
            match self.effects.run(&mut self.session, effect) {
                Some(Effect::OpenDialog) => {
                    let wake = self.wake.clone();
                    let [title, known, all] =
                        [text!("Open point clouds"), text!("Point clouds and scenes"), text!("All files")];
                    let choose = move || {
                        let asked = Instant::now();
                        let endings: Vec<&str> = codec::Format::all_endings().chain(["toml"]).collect();
                        let dialog =
                            rfd::FileDialog::new().set_title(title).add_filter(known, &endings).add_filter(all, &["*"]);
                        let chosen = dialog.pick_files();
                        let _ = wake.send_event(Wake::Chosen(chosen, asked.elapsed()));
                    };
                    effects::begin(&mut self.session, "dialog", choose);
                }
                Some(Effect::AskPlace(asked, proposed)) => {
                    let wake = self.wake.clone();
                    let (title, ending): (_, (&str, &[&str])) = match asked {
                        Asked::Points => (text!("Save the points that are shown"), export::FORMATS),
                        Asked::Picture => (text!("Save the picture"), ("PNG", &["png"])),
                        Asked::Scene => (text!("Save the scene"), (text!("Scene"), &["toml"])),
                    };
                    let choose = move || {
                        let opened = Instant::now();
                        let name = proposed.file_name().unwrap_or_default().to_string_lossy().into_owned();
                        let dialog = rfd::FileDialog::new().set_file_name(name).set_title(title);
                        let dialog = dialog.add_filter(ending.0, ending.1);
                        let folder = proposed.parent().filter(|folder| folder.is_absolute());
                        let dialog = folder.map_or(dialog.clone(), |folder| dialog.set_directory(folder));
                        let chosen = dialog.save_file();
                        let _ = wake.send_event(Wake::Placed(asked, chosen, opened.elapsed(), proposed));
                    };
                    effects::begin(&mut self.session, "dialog", choose);
                }
                Some(Effect::Copy(text)) => {
                    self.log.write(&json!({ "event": "copied", "text": text }));
                    if let Some(screen) = &mut self.screen {
                        screen.input.set_clipboard_text(text);
                    }
                }
                Some(Effect::SetFullScreen(on)) => {
                    if let Some(screen) = &self.screen {
                        let borderless = winit::window::Fullscreen::Borderless(None);
                        screen.window.set_fullscreen(on.then_some(borderless));
                    }
                }
                Some(Effect::Capture(Some((name, format, dropped)))) => self.begin_capture(&name, format, dropped),
                Some(Effect::Capture(None)) => {
                    self.captures.iter_mut().for_each(|capture| capture.end(Instant::now()));
                }
                Some(Effect::Log(event)) => self.log.write(&event),
                Some(Effect::Render(_) | Effect::Load { .. } | Effect::Work(_)) | None => {}
            }
        }
        if self.log.has_news() {
            self.request_paint();
        }
    }
}
