//! The scene file that a person works on: where it is saved, whether something is unsaved, and what waits until the
//! person has decided about that. Unsaved work is kept on disk after changes (`autosave.rs`).

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use scene::Settings;
use serde_json::json;
use world::{CloudKey, Event};

use crate::shared::language::text;
use crate::system::picture_file;
use crate::viewer::loaded::Loaded;
use crate::viewer::look::theme::grouped;
use crate::viewer::objects::Objects;
use crate::viewer::objects::clouds::short_name;
use crate::viewer::objects::history::{History, Marks};
use crate::viewer::requests::action::Filing;
use crate::viewer::requests::autosave::{Abandoned, Home, Keeper};
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::requests::file_names::{free_path, picture_name};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Asked, Effect, Outside};
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::requests::work::{Work, checksum};
use crate::viewer::scene::Scene;
use crate::viewer::scene::confines::Confines;
use crate::viewer::scene::past_views::PastViews;

/// Unsaved work is written at most this often.
const INTERVAL: Duration = Duration::from_secs(3);
/// Where it cannot be written, it is tried again after this time.
const PATIENCE: Duration = Duration::from_secs(30);

/// What would lose unsaved work.
#[derive(Clone, Debug, PartialEq)]
pub enum Leaving {
    Quit,
    /// Closes everything and opens a scene.
    Open(PathBuf),
    /// Closes everything and opens the work of a program that has ended unexpectedly.
    Restore,
    /// Closes the last cloud, and with it all objects.
    Close(CloudKey),
}

/// All that a scene file holds, in a form that shows quickly whether it has changed.
#[derive(Clone, Debug, Default, PartialEq)]
struct State {
    marks: Marks,
    inputs: Vec<String>,
}

/// What follows from a person's decision.
pub enum Next {
    /// To be done, unless unsaved work would be lost.
    Leave(Leaving),
    Go(Leaving),
}

pub struct Document {
    /// Where the scene is saved; `None` until a person has chosen a place.
    pub place: Option<PathBuf>,
    /// The checksum of the file there when this window last read or wrote it.
    known: u32,
    /// What was saved or opened; `None` if nothing of it was.
    saved: Option<State>,
    /// The words that would open all clouds of the scene, also of those that are still to come or cannot be read.
    inputs: Vec<String>,
    /// The words that were restored: one whose disk is missing today stays in the work.
    restored_inputs: Vec<String>,
    saving: Option<(PathBuf, State)>,
    /// What waits for the person's decision about unsaved work.
    pub asked: Option<Leaving>,
    /// Whether the person is asked about replacing the file, which another program has changed.
    pub asks_to_replace: bool,
    /// What follows when the scene is saved.
    then: Option<Leaving>,
    /// Keeps unsaved work; `None` where nothing is kept.
    pub keeper: Option<Arc<Keeper>>,
    kept: Option<State>,
    kept_at: Option<Instant>,
    is_being_kept: bool,
    /// When unsaved work could last not be written, until it can be again.
    failed_at: Option<Instant>,
    /// Work of programs that have ended unexpectedly, the newest last.
    pub abandoned: Vec<Abandoned>,
    /// Whether the newest of it is offered: not where a person has named something else to open.
    pub offers: bool,
    /// The one of them that was restored. It is deleted once this program keeps the work.
    restored: Option<Abandoned>,
}

impl Default for Document {
    fn default() -> Self {
        Self {
            place: None,
            known: 0,
            saved: Some(State::default()),
            inputs: Vec::new(),
            restored_inputs: Vec::new(),
            saving: None,
            asked: None,
            asks_to_replace: false,
            then: None,
            keeper: None,
            kept: None,
            kept_at: None,
            is_being_kept: false,
            failed_at: None,
            abandoned: Vec::new(),
            offers: false,
            restored: None,
        }
    }
}

impl Scene {
    /// Forgets everything that belongs to what was open; `own` are the person's own parameters.
    pub fn clear(&mut self, own: Settings) {
        self.rewrite_objects(|objects| *objects = Objects::default());
        (self.settings, self.brought, self.selected, self.room) = (own, None, None, None);
        self.confines = Confines::default();
        (self.history, self.past_views) = (History::default(), PastViews::default());
        self.camera_is_placed = false;
    }
}

/// The folder from which a scene file at a path names its clouds; `None` where whole paths are needed, because a link in
/// one folder leads to a file in another, and both are opened.
fn folder_of_names(path: &Path) -> Option<&Path> {
    let folder = path.parent()?;
    let is_there = |real: PathBuf| picture_file::place(path).parent() == Some(&real);
    folder.canonicalize().map_or(true, is_there).then_some(folder)
}

impl Document {
    /// Notes that words were opened beside what is open.
    pub fn add_inputs(&mut self, names: impl IntoIterator<Item = String>) {
        for name in names {
            if !self.inputs.contains(&name) {
                self.inputs.push(name);
            }
        }
    }

    /// Notes that everything which is open comes from these scene files, by the texts that were read. A single one is where
    /// the scene is saved.
    pub fn opened(&mut self, scene_files: &[(PathBuf, Arc<str>)], scene: &Scene, preferences: &mut Preferences) {
        let one = if let [(path, text)] = scene_files { Some((path, text)) } else { None };
        let place = one.and_then(|(path, _)| std::path::absolute(path).ok());
        if let (Some(place), Some((_, text))) = (&place, one) {
            preferences.remember_session(&place.display().to_string());
            self.known = checksum(text);
        }
        (self.place, self.asks_to_replace) = (place, false);
        self.saved = Some(self.state(scene));
    }

    /// Notes that what has been changed since the last time is no work of a person's.
    pub fn take_as_saved(&mut self, scene: &Scene) {
        if self.saved.is_some() {
            self.saved = Some(self.state(scene));
        }
    }

    /// Notes that a cloud was closed; forgets the file with the last one.
    pub fn closed(&mut self, input: &str, loaded: &Loaded) {
        if loaded.clouds.iter().all(|entry| entry.input != input) {
            self.inputs.retain(|known| known != input);
            self.restored_inputs.retain(|known| known != input);
        }
        if loaded.is_empty() {
            (self.place, self.saved, self.asks_to_replace) = (None, Some(State::default()), false);
            self.inputs.clear();
            self.restored_inputs.clear();
        }
    }

    /// Forgets an input that could not be opened. A scene file, and work that was restored, go on naming it: its disk may
    /// be back tomorrow.
    pub fn on_event(&mut self, event: &Event, loaded: &Loaded) {
        let Event::Failed { input, .. } = event else { return };
        let is_known = self.place.is_some() || self.restored_inputs.contains(input);
        if !is_known && loaded.clouds.iter().all(|entry| entry.input != *input) {
            self.inputs.retain(|known| known != input);
        }
    }

    fn state(&self, scene: &Scene) -> State {
        State { marks: scene.history.marks(), inputs: self.inputs.clone() }
    }

    /// Whether a person's work would be lost. Of a scene file it is all that differs from the file, but for the camera.
    /// Without a file it is what the person has made: who has only looked at clouds, in whatever colours, loses nothing.
    pub fn is_unsaved(&self, scene: &Scene, loaded: &Loaded) -> bool {
        if loaded.clouds.is_empty() {
            return false;
        }
        let Some(saved) = &self.saved else { return true };
        let marks = scene.history.marks();
        let is_changed = scene.history.is_changing() && self.place.is_some();
        match &self.place {
            None => marks.made != saved.marks.made && scene.objects.has_more_than(&loaded.inputs()),
            Some(_) => is_changed || marks != saved.marks || self.inputs != saved.inputs,
        }
    }

    /// Whether a question waits for the person's answer.
    pub fn asks(&self) -> bool {
        self.asked.is_some() || self.asks_to_replace
    }

    /// The window's title: what is open, a star if something is unsaved, and the number of points.
    pub fn title(&self, is_unsaved: bool, loaded: &Loaded) -> String {
        let star = if is_unsaved { "*" } else { "" };
        let inputs = loaded.inputs();
        let name = match (&self.place, inputs.as_slice()) {
            (Some(place), _) => short_name(&place.display().to_string()).to_owned(),
            (None, []) => return "glint".into(),
            (None, [one]) => short_name(one).to_owned(),
            (None, several) => format!("{} clouds", several.len()),
        };
        format!("{name}{star} - {} points - glint", grouped(loaded.all_points()))
    }

    pub fn act(
        &mut self,
        filing: Filing,
        scene: &Scene,
        loaded: &Loaded,
        preferences: &mut Preferences,
        outside: &mut Outside,
    ) -> Option<Next> {
        match filing {
            Filing::Save => self.save(scene, loaded, outside),
            Filing::Replace => {
                self.asks_to_replace = false;
                if let Some(place) = self.place.clone() {
                    self.save_to(place, None, scene, loaded, outside);
                }
            }
            Filing::SaveAs => {
                self.asks_to_replace = false;
                self.ask_place(loaded, outside);
            }
            Filing::SaveTo(path) => self.save_to(path, None, scene, loaded, outside),
            Filing::NoPlace => self.on_no_place(),
            Filing::SaveAndLeave => {
                self.then = self.asked.take();
                self.save(scene, loaded, outside);
            }
            Filing::Discard => return self.asked.take().map(Next::Go),
            // Of two questions, the one that is shown is answered.
            Filing::Stay if self.asked.is_some() => self.asked = None,
            Filing::Stay => (self.asks_to_replace, self.then) = (false, None),
            Filing::Open(path) => return Some(Next::Leave(Leaving::Open(path))),
            Filing::Restore => return Some(Next::Leave(Leaving::Restore)),
            Filing::DeleteLeft => self.delete_abandoned(),
            Filing::Offer => self.offers = !self.abandoned.is_empty(),
            Filing::Later => self.offers = false,
            Filing::Reopen(is_on) => preferences.reopens = is_on,
        }
        None
    }

    // ---- saving ----

    /// Saves the scene where it was saved before, or asks for a place.
    fn save(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        self.asks_to_replace = false;
        match self.place.clone() {
            Some(place) => self.save_to(place, Some(self.known), scene, loaded, outside),
            None => self.ask_place(loaded, outside),
        }
    }

    /// Asks where to save the scene.
    fn ask_place(&mut self, loaded: &Loaded, outside: &mut Outside) {
        if loaded.clouds.is_empty() {
            self.then = None;
            return outside.note(text!("There is no scene to save yet"));
        }
        let name = loaded.inputs().first().map_or("scene".into(), |input| picture_name(input));
        let folder = self.place.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
        outside.push(Effect::AskPlace(Asked::Scene, free_path(folder, &name, "toml")));
    }

    /// Saves the scene to a file; only if that is as it was `known`, where a person has not decided to replace it.
    fn save_to(&mut self, path: PathBuf, known: Option<u32>, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        if self.saving.is_some() {
            return outside.note(text!("The scene is being saved already"));
        }
        let has_kind = path.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("toml"));
        let named = if has_kind { path.clone() } else { PathBuf::from(format!("{}.toml", path.display())) };
        // Nobody was asked whether that file may be replaced.
        if !has_kind && named.exists() {
            self.then = None;
            let text = format!("{}: a file of this name is there; name it in full to replace it", named.display());
            return outside.say(Level::Error, text);
        }
        let path = std::path::absolute(&named).unwrap_or(named);
        let text = match scene.session_text(&self.inputs, loaded, folder_of_names(&path)) {
            Ok(text) => text,
            Err(problem) => {
                self.then = None;
                return outside.error(text!("{path}: not saved: {problem}", path = path.display(), problem));
            }
        };
        if loaded.clouds.iter().any(|entry| !entry.added.is_empty()) {
            outside.note(text!(
                "The scene file does not hold distances and ghosts; {COMMAND}+E saves the points with them",
                COMMAND
            ));
        }
        self.saving = Some((path.clone(), self.state(scene)));
        outside.work(Work::SaveScene { path, text, known });
    }

    /// Takes in that the file is not as this window knows it: the person decides whether it is replaced. What was to
    /// follow waits.
    pub fn on_changed(&mut self, path: &Path, outside: &mut Outside) {
        if self.saving.take_if(|(place, _)| place == path).is_some() {
            self.asks_to_replace = true;
            outside.log(json!({ "event": "asked" }));
        }
    }

    /// Takes in whether the scene was written. Returns what was to follow. Where it could not be written to a new place,
    /// a person is asked for the place again.
    pub fn on_saved(
        &mut self,
        path: &Path,
        result: &Result<u32, String>,
        preferences: &mut Preferences,
        outside: &mut Outside,
    ) -> Option<Leaving> {
        let (place, state) = self.saving.take().filter(|(place, _)| place == path)?;
        let then = self.then.take();
        let Ok(known) = result else {
            if self.place.as_ref() != Some(&place) {
                self.then = then;
                outside.push(Effect::AskPlace(Asked::Scene, place));
            }
            return None;
        };
        self.known = *known;
        preferences.remember_session(&place.display().to_string());
        (self.place, self.saved) = (Some(place), Some(state));
        then
    }

    /// Takes in that no place was chosen.
    pub fn on_no_place(&mut self) {
        self.then = None;
    }

    // ---- leaving ----

    /// Forgets the file and everything about it, since all is closed.
    pub fn forget(&mut self) {
        (self.place, self.saved, self.saving, self.then) = (None, Some(State::default()), None, None);
        self.asks_to_replace = false;
        self.inputs.clear();
        self.restored_inputs.clear();
    }

    // ---- unsaved work on disk ----

    /// Keeps unsaved work on disk, or removes it there. Returns the time after which to call this again.
    pub fn sync(
        &mut self,
        is_unsaved: bool,
        scene: &Scene,
        loaded: &Loaded,
        outside: &mut Outside,
    ) -> Option<Duration> {
        let keeper = self.keeper.clone()?;
        if self.is_being_kept {
            return None;
        }
        let state = self.state(scene);
        if !is_unsaved {
            if self.kept.take().is_some() {
                self.is_being_kept = true;
                outside.work(Work::Keep { keeper, text: None, home: None });
            }
            return None;
        }
        // What is being dragged is kept when it is released, and what a film has moved when it is back. Built-in scenes
        // bring their mirrors in a moment.
        let is_in_motion = scene.history.is_changing() || scene.posed.is_some() || loaded.is_loading_built_in();
        if self.kept.as_ref() == Some(&state) && self.failed_at.is_none() || is_in_motion {
            return None;
        }
        let failed = self.failed_at.map(|at| outside.now.saturating_duration_since(at));
        if let Some(left) = failed.and_then(|since| PATIENCE.checked_sub(since)).filter(|left| !left.is_zero()) {
            return Some(left);
        }
        let since = self.kept_at.map(|at| outside.now.saturating_duration_since(at));
        if let Some(left) = since.and_then(|since| INTERVAL.checked_sub(since)).filter(|left| !left.is_zero()) {
            return Some(left);
        }
        let text = match scene.session_text(&self.inputs, loaded, None) {
            Ok(text) => text,
            Err(problem) => {
                self.on_kept(Err(problem), outside);
                return None;
            }
        };
        (self.kept, self.kept_at, self.is_being_kept) = (Some(state), Some(outside.now), true);
        outside.work(Work::Keep { keeper, text: Some(text), home: self.home() });
        None
    }

    /// The file that unsaved work belongs to.
    fn home(&self) -> Option<Home> {
        self.place.clone().map(|path| Home { path, known: self.known })
    }

    /// Ends keeping unsaved work: writes it for the last time if it stays for the next start, else removes it.
    pub fn end(&mut self, stays: bool, scene: &Scene, loaded: &Loaded) {
        let Some(keeper) = self.keeper.take() else { return };
        if stays {
            let text = scene.session_text(&self.inputs, loaded, None).map_err(anyhow::Error::msg);
            if let Err(error) = text.and_then(|text| keeper.keep(Some((&text, self.home().as_ref())))) {
                tracing::error!("unsaved work: {error:#}");
            }
        }
        keeper.end(stays);
    }

    /// Takes in whether unsaved work was written.
    pub fn on_kept(&mut self, result: Result<(), String>, outside: &mut Outside) {
        self.is_being_kept = false;
        match result {
            Ok(()) => {
                outside.log(json!({ "event": "kept", "unsaved": self.kept.is_some() }));
                if self.failed_at.take().is_some() && self.kept.is_some() {
                    outside.say(Level::Note, text!("Unsaved work is kept against a crash again"));
                }
                if let Some(restored) = self.restored.take_if(|_| self.kept.is_some()) {
                    restored.delete();
                }
            }
            Err(problem) => {
                if self.failed_at.replace(outside.now).is_none() {
                    let again = text!("it is tried again every {seconds} s", seconds = PATIENCE.as_secs());
                    outside.say(
                        Level::Warning,
                        text!("Unsaved work is not kept against a crash ({again}): {problem}", again, problem),
                    );
                }
            }
        }
    }

    /// Takes in the work of programs that have ended before it was saved. The newest is offered, unless a person has named
    /// something else to open: that is not to be replaced.
    pub fn find_abandoned(&mut self, abandoned: Vec<Abandoned>, named: &[PathBuf], outside: &mut Outside) {
        outside.log(json!({ "event": "left", "count": abandoned.len() }));
        self.abandoned = abandoned;
        let Some(newest) = self.abandoned.last() else { return };
        let is_named =
            |place: &PathBuf| named.iter().any(|name| std::path::absolute(name).is_ok_and(|name| name == *place));
        self.offers = named.is_empty() || newest.home.as_ref().is_some_and(|home| is_named(&home.path));
        if !self.offers {
            let what = newest.name();
            outside.note(text!("Unsaved work on {what}, {age}, is kept: Recent has it", what, age = newest.age()));
        }
    }

    /// The file with the work to restore, and the scene file that it belongs to.
    pub fn restore(&mut self) -> Option<(PathBuf, Option<Home>)> {
        let abandoned = self.abandoned.pop()?;
        let work = (abandoned.path.clone(), abandoned.home.clone());
        self.restored = Some(abandoned);
        Some(work)
    }

    /// Deletes the offered work.
    fn delete_abandoned(&mut self) {
        if let Some(abandoned) = self.abandoned.pop() {
            abandoned.delete();
        }
    }

    /// Notes that what is open was restored: nothing of it is saved at `place`.
    pub fn on_restored(&mut self, home: Option<Home>) {
        (self.known, self.place) = home.map_or((0, None), |home| (home.known, Some(home.path)));
        (self.saved, self.restored_inputs) = (None, self.inputs.clone());
    }
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
