//! All rows of the command palette: actions that a key does at once and those that only panels have, what can be done with
//! the objects of the scene, tabs and parameters. Each has words that people use for it beside its name.

use scene::{ClipShape, Lighting, METHODS, PRESETS, Settings, Shape};

use crate::shared::language::{text, translated};
use crate::viewer::look::tab::Tab;
use crate::viewer::objects::PlacedProfile;
use crate::viewer::objects::clouds::short_name;
use crate::viewer::panels::{parameters, reflections, side, timeline};
use crate::viewer::requests::action::{
    Action, Clipping, Compare, Export, Filing, Film, Ghosting, KeptStep, Measuring, Profiling,
};
use crate::viewer::requests::bindings::{self, BINDINGS, Trigger};
use crate::viewer::requests::path_prompt::PathPrompt;
use crate::viewer::session::Session;

/// A row of the palette.
pub struct Entry {
    pub text: String,
    /// What stands at its right end: the key of an action, the name of a parameter.
    pub detail: String,
    /// What the search looks into besides.
    pub help: &'static str,
    /// Words that people use for it.
    pub words: &'static str,
    pub action: Action,
}

impl Entry {
    fn new(text: impl Into<String>, help: &'static str, action: Action) -> Self {
        Self { text: text.into(), detail: String::new(), help, words: words(&action), action }
    }
}

/// Words that people use for an action and that do not stand in its name.
fn words(action: &Action) -> &'static str {
    match action {
        Action::SavePicture(_) => text!("screenshot snapshot image png export picture 4k resolution large"),
        Action::Film(Film::Capture) => text!("screencast video capture window"),
        Action::Film(Film::Keep(_) | Film::FlyTo(_)) => text!("bookmark viewpoint camera position save view"),
        Action::Film(Film::Toggle | Film::Add(_) | Film::AskRecording) => {
            text!("animation movie video film path camera record")
        }
        Action::Film(Film::Play) => text!("animation movie preview"),
        Action::PointSize(_) => text!("point size splat bigger smaller thicker"),
        Action::FrameAll => text!("reset view fit extents home whole everything"),
        Action::GoInside => text!("enter interior indoor room"),
        Action::DollHouse => text!("outside exterior overview dollhouse"),
        Action::ToggleMode => text!("walk navigation first person wasd"),
        Action::ToggleProjection => text!("ortho parallel isometric plan"),
        Action::LookFrom(_) => text!("view side elevation plan standard"),
        Action::Clip(_) => text!("section crop cut slice box volume"),
        Action::Profile(_) | Action::Measuring(Measuring::BeginProfile) => {
            text!("section cross-section slice cut chart")
        }
        Action::Measuring(Measuring::BeginNote) => text!("annotation comment label text"),
        Action::Measuring(_) => text!("ruler dimension length tape"),
        Action::Export(_) => text!("export subset las laz ply csv write"),
        Action::File(Filing::Save | Filing::SaveAs) => text!("project session store"),
        Action::File(Filing::Open(_)) | Action::Open(_) | Action::OpenDialog | Action::OpenPrompt => {
            text!("load import file recent project")
        }
        Action::AddSpot => text!("lamp light night lighting"),
        Action::LightBy(_) | Action::NextLight | Action::ToggleLight => text!("night day shading lamp lighting shadow"),
        Action::ToggleEdl => text!("outline edges depth shading edl"),
        Action::AddMirror(_) => text!("reflection mirror object chrome water glass lake"),
        Action::Inspect => text!("dentist mirror hidden behind"),
        Action::ToggleChart => text!("tune pareto compare settings speed quality"),
        Action::PinTruth | Action::KeepTruthReady(_) => text!("reference ground truth ray traced compare"),
        Action::Undo => text!("back revert mistake"),
        Action::Redo => text!("again forward repeat"),
        Action::Quit => text!("exit close end"),
        Action::ToggleShortcuts => text!("help keys keyboard manual hotkeys"),
        Action::ToggleInterface | Action::TogglePanel => text!("sidebar hide clean"),
        Action::ToggleFullScreen => text!("fullscreen maximize presentation"),
        Action::ColorBy(_) => text!("colour color attribute scalar"),
        Action::Kept(_) => text!("compare before after snapshot"),
        Action::Compare(_) => text!("distance difference change cloud deviation"),
        Action::Ghosts(_) => text!("mirror reflection pane glass window"),
        Action::ListMessages(_) => text!("log errors warnings history"),
        Action::OpenTab(Tab::Look) => text!("class classes classification hide filter ground vegetation"),
        _ => "",
    }
}

/// All rows.
pub fn entries(session: &Session) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for binding in BINDINGS {
        let is_at_once = matches!(binding.trigger, Trigger::Key(..) | Trigger::Numpad(..));
        // The text of the clipboard comes with the keys for pasting alone.
        let is_left_out = matches!(binding.action, Action::PasteView | Action::TogglePalette);
        if is_at_once && !is_left_out && entries.iter().all(|entry| entry.action != binding.action) {
            let text = format!("{}: {}", translated(binding.section), translated(binding.text));
            let detail = bindings::shortcut(&binding.action);
            entries.push(Entry { detail, ..Entry::new(text, "", binding.action.clone()) });
        }
    }
    entries.extend(of_panels(session));
    entries.extend(of_reflections(session));
    entries.extend(of_files(session));
    entries.extend(of_profiles(session));
    for (index, bookmark) in session.scene.objects.bookmarks.iter().enumerate() {
        let text = text!("Views: Fly to {bookmark}", bookmark = bookmark.name);
        entries.push(Entry::new(text, text!("A kept view"), Action::Film(Film::FlyTo(index))));
    }
    for tab in Tab::ALL {
        entries.push(Entry::new(text!("Tab: {tab}", tab = translated(tab.name())), tab.help(), Action::OpenTab(tab)));
    }
    for params in session.scene.settings.groups() {
        let group = params.group();
        let unused = reflections::unused(session, group);
        let unused = unused.map_or(String::new(), |row| text!(" ({row} is not in use)", row = row.name));
        for field in &group.fields {
            let key = format!("{}.{}", group.name, field.name);
            let text = format!("{}: {}{unused}", translated(group.section), parameters::title(field.name));
            let words = parameters::words(&key);
            let action = Action::FindParameter(key.clone());
            entries.push(Entry { detail: key, words, ..Entry::new(text, translated(field.help), action) });
        }
    }
    entries
}

/// What panels and menus offer and no key does.
fn of_panels(session: &Session) -> Vec<Entry> {
    let mut entries = vec![
        Entry::new(
            text!("Views: Keep the view as a bookmark"),
            text!("Comes back by its name"),
            Action::Film(Film::Keep(None)),
        ),
        Entry::new(
            text!("Parameters: Reset all parameters"),
            text!("Gives all their defaults; undo takes that back"),
            Action::ChangeSettings(Box::default()),
        ),
        Entry::new(text!("Window: Messages"), text!("All messages so far"), Action::ListMessages(true)),
        Entry::new(text!("Window: Panel"), text!("Shows or hides the panel at the left"), Action::TogglePanel),
        Entry::new(
            text!("Measurements: Copy all"),
            text!("Values of all measurements"),
            Action::Measuring(Measuring::CopyAll),
        ),
        Entry::new(text!("Ghosts: Look for ghosts"), text!("What was seen in mirrors"), Action::Ghosts(Ghosting::Look)),
        Entry::new(text!("Compare: Start"), text!("Distances between two clouds"), Action::Compare(Compare::Start)),
        Entry::new(text!("Compare: Exchange kept state and present one"), "", Action::Kept(KeptStep::Swap)),
        Entry::new(text!("Compare: Forget the kept state"), "", Action::Kept(KeptStep::LetGo)),
        Entry::new(text!("Paths: Record the path"), text!("Writes a film"), Action::Film(Film::AskRecording)),
        Entry::new(text!("Truth: Stop"), text!("Frees its memory"), Action::StopTruth),
        Entry::new(text!("Files: Stop saving points"), "", Action::Export(Export::Stop)),
    ];
    entries.extend(side::languages().map(|(language, name)| Entry {
        words: text!("language german"),
        ..Entry::new(text!("Window: Language {name}", name), "", Action::Speak(language))
    }));
    let shapes = [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab];
    entries.extend(shapes.map(|shape| {
        let text = text!("Clips: {shape} about everything", shape = translated(shape.name()));
        Entry::new(text, text!("Shows the points inside of it"), Action::Clip(Clipping::AroundAll(shape)))
    }));
    entries.extend(Shape::WITH_FORMULA.map(|shape| {
        let text = text!("Add a mirror: {shape}", shape = translated(shape.name()));
        Entry::new(text, text!("At the picked point, or at the pivot"), Action::AddMirror(shape))
    }));
    for (text, prompt) in [
        (text!("Add a mirror: the faces of a PLY file"), PathPrompt::for_mesh()),
        (text!("Add a mirror: the points of a file"), PathPrompt::for_mirror_points()),
    ] {
        entries.push(Entry::new(text, "", Action::ChangePrompt(Box::new(prompt))));
    }
    entries.extend(timeline::PRESETS.map(|(preset, name, help)| {
        Entry::new(text!("Paths: {name}", name = translated(name)), translated(help), Action::Film(Film::Add(preset)))
    }));
    let lights = [Lighting::Auto, Lighting::Surroundings, Lighting::Lights, Lighting::Sun, Lighting::Headlight];
    entries.extend(lights.map(|by| {
        let name = translated(param::Choice::name(by));
        Entry::new(text!("Light: {name}", name), text!("What lights the points"), Action::LightBy(by))
    }));
    let (truth, live) = (&session.truth, &session.truth.live);
    for (text, is_on, action) in [
        (text!("keep it ready"), truth.keeps_ready, Action::KeepTruthReady(!truth.keeps_ready)),
        (text!("judge each setting"), truth.judges, Action::JudgeSettings(!truth.judges)),
        (text!("estimate errors"), live.is_on, Action::EstimateErrors(!live.is_on)),
    ] {
        let text = if is_on { text!("Truth: {text}, no longer", text) } else { text!("Truth: {text}", text) };
        entries.push(Entry::new(text, "", action));
    }
    if !session.document.abandoned.is_empty() {
        entries.push(Entry::new(
            text!("Files: Restore unsaved work"),
            text!("Asks first"),
            Action::File(Filing::Restore),
        ));
    }
    if session.tools.pick.is_some() {
        entries.push(Entry::new(text!("Picked point: Copy"), "", Action::CopyPick));
        entries.push(Entry::new(text!("Picked point: Forget"), "", Action::ClearPick));
    }
    for entry in &session.loaded.clouds {
        let (name, key) = (&entry.cloud.name, entry.key);
        let show = if entry.is_visible { text!("Hide") } else { text!("Show") };
        entries.push(Entry::new(text!("Clouds: Frame {name}", name), "", Action::FrameCloud(key)));
        entries.push(Entry::new(
            text!("Clouds: {show} {name}", show, name),
            "",
            Action::ShowCloud(key, !entry.is_visible),
        ));
        entries.push(Entry::new(text!("Clouds: Close {name}", name), "", Action::RemoveCloud(key)));
    }
    entries
}

/// Methods, presets and sweeps.
fn of_reflections(session: &Session) -> Vec<Entry> {
    let settings: &Settings = &session.scene.settings;
    let mirrors = session.scene.objects.mirrors.iter().map(|placed| &placed.mirror);
    let method = |row: &'static scene::MethodRow| Entry {
        words: text!("reflection method algorithm"),
        ..Entry::new(text!("Use {row}", row = row.name), translated(row.help), reflections::use_method(row))
    };
    let preset = |preset: &'static scene::Preset| {
        let action = Action::ChangeSettings(Box::new(preset.applied(settings, mirrors.clone())));
        Entry {
            words: text!("preset sscr reflection settings"),
            ..Entry::new(text!("Preset: {preset}", preset = translated(preset.name)), translated(preset.help), action)
        }
    };
    let sweep = |(key, name): (String, String)| {
        let help = text!("Draws, times and judges this view with a range of values");
        Entry {
            words: text!("sweep range series vary"),
            ..Entry::new(text!("Sweep: {name}", name), help, Action::AskSweep(key))
        }
    };
    let mut entries: Vec<Entry> = METHODS.iter().map(method).collect();
    entries.extend(PRESETS.iter().map(preset));
    entries.extend(reflections::swept(session).into_iter().map(sweep));
    if session.sweeps.under_way.is_some() {
        entries.push(Entry::new(
            text!("Sweep: End the one under way"),
            text!("What is judged so far is saved"),
            Action::EndSweep,
        ));
    }
    entries
}

/// What was open before, and built-in scenes.
fn of_files(session: &Session) -> Vec<Entry> {
    let preferences = &session.preferences;
    let scene = |path: &String| {
        let help = text!("A scene file; closes what is open");
        Entry::new(text!("Open: {path}", path = short_name(path)), help, Action::File(Filing::Open(path.into())))
    };
    let file = |path: &String| {
        let help = text!("Comes beside what is open");
        Entry::new(text!("Open: {path}", path = short_name(path)), help, Action::Open(path.into()))
    };
    let built_in = |name: &String| {
        let help = text!("A built-in scene; closes what is open");
        Entry::new(text!("Open: {name}", name), help, Action::File(Filing::Open(name.into())))
    };
    let names = world::built_in_names();
    let recent = preferences.recent.iter().filter(|recent| !names.contains(recent));
    preferences.sessions.iter().map(scene).chain(recent.map(file)).chain(names.iter().map(built_in)).collect()
}

/// What can be done with the profiles of the scene, and with the one in view.
fn of_profiles(session: &Session) -> Vec<Entry> {
    let tool = &session.tools.profiles;
    let entry = |text: String, help, step| Entry::new(text!("Profiles: {text}", text), help, Action::Profile(step));
    let look = |one: &PlacedProfile| {
        let help = text!("Shows its points by distance along and height");
        entry(text!("{profile} from the side", profile = one.profile.name), help, Profiling::Look(Some(one.id)))
    };
    let mut entries: Vec<Entry> = session.scene.objects.profiles.iter().map(look).collect();
    if let Some(profile) = tool.profile(&session.scene) {
        let name = &profile.name;
        for ending in ["csv", "laz", "png", "svg"] {
            let text = text!("save {name} as {ending}", name, ending = ending.to_uppercase());
            entries.push(entry(text, text!("Writes its points, or a chart of them"), Profiling::Save(ending)));
        }
        let (ruler, together) = (tool.ruler.is_none(), !tool.is_together);
        entries.push(entry(text!("ruler").into(), text!("Measures between two clicks"), Profiling::Ruler(ruler)));
        entries.push(entry(
            text!("all in one chart").into(),
            text!("Shows the others behind it"),
            Profiling::Together(together),
        ));
        entries.push(entry(text!("close {name}", name), text!("Closes the chart"), Profiling::Look(None)));
    }
    entries
}
