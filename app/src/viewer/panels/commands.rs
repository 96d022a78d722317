//! All rows of the command palette: actions that a key does at once and those that only panels have, what can be done with
//! the objects of the scene, tabs and parameters. Each has words that people use for it beside its name.

use scene::{ClipShape, Lighting, METHODS, PRESETS, Settings, Shape};

use crate::viewer::look::tab::Tab;
use crate::viewer::objects::PlacedProfile;
use crate::viewer::objects::clouds::short_name;
use crate::viewer::panels::{parameters, reflections, timeline};
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
        Action::SavePicture(_) => "screenshot snapshot image png export picture 4k resolution large",
        Action::Film(Film::Capture) => "screencast video capture window",
        Action::Film(Film::Keep(_) | Film::FlyTo(_)) => "bookmark viewpoint camera position save view",
        Action::Film(Film::Toggle | Film::Add(_) | Film::AskRecording) => {
            "animation movie video film path camera record"
        }
        Action::Film(Film::Play) => "animation movie preview",
        Action::PointSize(_) => "point size splat bigger smaller thicker",
        Action::FrameAll => "reset view fit extents home whole everything",
        Action::GoInside => "enter interior indoor room",
        Action::DollHouse => "outside exterior overview dollhouse",
        Action::ToggleMode => "walk navigation first person wasd",
        Action::ToggleProjection => "ortho parallel isometric plan",
        Action::LookFrom(_) => "view side elevation plan standard",
        Action::Clip(_) => "section crop cut slice box volume",
        Action::Profile(_) | Action::Measuring(Measuring::BeginProfile) => "section cross-section slice cut chart",
        Action::Measuring(Measuring::BeginNote) => "annotation comment label text",
        Action::Measuring(_) => "ruler dimension length tape",
        Action::Export(_) => "export subset las laz ply csv write",
        Action::File(Filing::Save | Filing::SaveAs) => "project session store",
        Action::File(Filing::Open(_)) | Action::Open(_) | Action::OpenDialog | Action::OpenPrompt => {
            "load import file recent project"
        }
        Action::AddSpot => "lamp light night lighting",
        Action::LightBy(_) | Action::NextLight | Action::ToggleLight => "night day shading lamp lighting shadow",
        Action::ToggleEdl => "outline edges depth shading edl",
        Action::AddMirror(_) => "reflection mirror object chrome water glass lake",
        Action::Inspect => "dentist mirror hidden behind",
        Action::ToggleChart => "tune pareto compare settings speed quality",
        Action::PinTruth | Action::KeepTruthReady(_) => "reference ground truth ray traced compare",
        Action::Undo => "back revert mistake",
        Action::Redo => "again forward repeat",
        Action::Quit => "exit close end",
        Action::ToggleShortcuts => "help keys keyboard manual hotkeys",
        Action::ToggleInterface | Action::TogglePanel => "sidebar hide clean",
        Action::ToggleFullScreen => "fullscreen maximize presentation",
        Action::ColorBy(_) => "colour color attribute scalar",
        Action::Kept(_) => "compare before after snapshot",
        Action::Compare(_) => "distance difference change cloud deviation",
        Action::Ghosts(_) => "mirror reflection pane glass window",
        Action::ListMessages(_) => "log errors warnings history",
        Action::OpenTab(Tab::Look) => "class classes classification hide filter ground vegetation",
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
            let text = format!("{}: {}", binding.section, binding.text);
            let detail = bindings::shortcut(&binding.action);
            entries.push(Entry { detail, ..Entry::new(text, "", binding.action.clone()) });
        }
    }
    entries.extend(of_panels(session));
    entries.extend(of_reflections(session));
    entries.extend(of_files(session));
    entries.extend(of_profiles(session));
    for (index, bookmark) in session.scene.objects.bookmarks.iter().enumerate() {
        let text = format!("Views: Fly to {}", bookmark.name);
        entries.push(Entry::new(text, "A kept view", Action::Film(Film::FlyTo(index))));
    }
    for tab in Tab::ALL {
        entries.push(Entry::new(format!("Tab: {}", tab.name()), tab.help(), Action::OpenTab(tab)));
    }
    for params in session.scene.settings.groups() {
        let group = params.group();
        let unused = reflections::unused(session, group);
        let unused = unused.map_or(String::new(), |row| format!(" ({} is not in use)", row.name));
        for field in &group.fields {
            let key = format!("{}.{}", group.name, field.name);
            let text = format!("{}: {}{unused}", group.section, parameters::title(field.name));
            let words = parameters::words(&key);
            let action = Action::FindParameter(key.clone());
            entries.push(Entry { detail: key, words, ..Entry::new(text, field.help, action) });
        }
    }
    entries
}

/// What panels and menus offer and no key does.
fn of_panels(session: &Session) -> Vec<Entry> {
    let mut entries = vec![
        Entry::new("Views: Keep the view as a bookmark", "Comes back by its name", Action::Film(Film::Keep(None))),
        Entry::new(
            "Parameters: Reset all parameters",
            "Gives all their defaults; undo takes that back",
            Action::ChangeSettings(Box::default()),
        ),
        Entry::new("Window: Messages", "All messages so far", Action::ListMessages(true)),
        Entry::new("Window: Panel", "Shows or hides the panel at the left", Action::TogglePanel),
        Entry::new("Measurements: Copy all", "Values of all measurements", Action::Measuring(Measuring::CopyAll)),
        Entry::new("Ghosts: Look for ghosts", "What was seen in mirrors", Action::Ghosts(Ghosting::Look)),
        Entry::new("Compare: Start", "Distances between two clouds", Action::Compare(Compare::Start)),
        Entry::new("Compare: Exchange kept state and present one", "", Action::Kept(KeptStep::Swap)),
        Entry::new("Compare: Forget the kept state", "", Action::Kept(KeptStep::LetGo)),
        Entry::new("Paths: Record the path", "Writes a film", Action::Film(Film::AskRecording)),
        Entry::new("Truth: Stop", "Frees its memory", Action::StopTruth),
        Entry::new("Files: Stop saving points", "", Action::Export(Export::Stop)),
    ];
    let shapes = [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab];
    entries.extend(shapes.map(|shape| {
        let text = format!("Clips: {} about everything", shape.name());
        Entry::new(text, "Shows the points inside of it", Action::Clip(Clipping::AroundAll(shape)))
    }));
    entries.extend(Shape::WITH_FORMULA.map(|shape| {
        let text = format!("Add a mirror: {}", shape.name());
        Entry::new(text, "At the picked point, or at the pivot", Action::AddMirror(shape))
    }));
    for (text, prompt) in [
        ("Add a mirror: the faces of a PLY file", PathPrompt::for_mesh()),
        ("Add a mirror: the points of a file", PathPrompt::for_mirror_points()),
    ] {
        entries.push(Entry::new(text, "", Action::ChangePrompt(Box::new(prompt))));
    }
    entries.extend(
        timeline::PRESETS
            .map(|(preset, name, help)| Entry::new(format!("Paths: {name}"), help, Action::Film(Film::Add(preset)))),
    );
    let lights = [Lighting::Auto, Lighting::Surroundings, Lighting::Lights, Lighting::Sun, Lighting::Headlight];
    entries.extend(lights.map(|by| {
        let name = param::Choice::name(by);
        Entry::new(format!("Light: {name}"), "What lights the points", Action::LightBy(by))
    }));
    let (truth, live) = (&session.truth, &session.truth.live);
    for (text, is_on, action) in [
        ("keep it ready", truth.keeps_ready, Action::KeepTruthReady(!truth.keeps_ready)),
        ("judge each setting", truth.judges, Action::JudgeSettings(!truth.judges)),
        ("estimate errors", live.is_on, Action::EstimateErrors(!live.is_on)),
    ] {
        let text = format!("Truth: {text}{}", if is_on { ", no longer" } else { "" });
        entries.push(Entry::new(text, "", action));
    }
    if !session.document.abandoned.is_empty() {
        entries.push(Entry::new("Files: Restore unsaved work", "Asks first", Action::File(Filing::Restore)));
    }
    if session.tools.pick.is_some() {
        entries.push(Entry::new("Picked point: Copy", "", Action::CopyPick));
        entries.push(Entry::new("Picked point: Forget", "", Action::ClearPick));
    }
    for entry in &session.loaded.clouds {
        let (name, key) = (&entry.cloud.name, entry.key);
        let show = if entry.is_visible { "Hide" } else { "Show" };
        entries.push(Entry::new(format!("Clouds: Frame {name}"), "", Action::FrameCloud(key)));
        entries.push(Entry::new(format!("Clouds: {show} {name}"), "", Action::ShowCloud(key, !entry.is_visible)));
        entries.push(Entry::new(format!("Clouds: Close {name}"), "", Action::RemoveCloud(key)));
    }
    entries
}

/// Methods, presets and sweeps.
fn of_reflections(session: &Session) -> Vec<Entry> {
    let settings: &Settings = &session.scene.settings;
    let mirrors = session.scene.objects.mirrors.iter().map(|placed| &placed.mirror);
    let method = |row: &'static scene::MethodRow| Entry {
        words: "reflection method algorithm",
        ..Entry::new(format!("Use {}", row.name), row.help, reflections::use_method(row))
    };
    let preset = |preset: &'static scene::Preset| {
        let action = Action::ChangeSettings(Box::new(preset.applied(settings, mirrors.clone())));
        Entry {
            words: "preset sscr reflection settings",
            ..Entry::new(format!("Preset: {}", preset.name), preset.help, action)
        }
    };
    let sweep = |(key, name): (String, String)| {
        let help = "Draws, times and judges this view with a range of values";
        Entry { words: "sweep range series vary", ..Entry::new(format!("Sweep: {name}"), help, Action::AskSweep(key)) }
    };
    let mut entries: Vec<Entry> = METHODS.iter().map(method).collect();
    entries.extend(PRESETS.iter().map(preset));
    entries.extend(reflections::swept(session).into_iter().map(sweep));
    if session.sweeps.under_way.is_some() {
        entries.push(Entry::new("Sweep: End the one under way", "What is judged so far is saved", Action::EndSweep));
    }
    entries
}

/// What was open before, and built-in scenes.
fn of_files(session: &Session) -> Vec<Entry> {
    let preferences = &session.preferences;
    let scene = |path: &String| {
        let help = "A scene file; closes what is open";
        Entry::new(format!("Open: {}", short_name(path)), help, Action::File(Filing::Open(path.into())))
    };
    let file = |path: &String| Entry::new(format!("Open: {}", short_name(path)), "", Action::Open(path.into()));
    let built_in = |name: String| Entry::new(format!("Open: {name}"), "A built-in scene", Action::Open(name.into()));
    let files = preferences.sessions.iter().map(scene).chain(preferences.recent.iter().map(file));
    files.chain(world::built_in_names().into_iter().map(built_in)).collect()
}

/// What can be done with the profiles of the scene, and with the one in view.
fn of_profiles(session: &Session) -> Vec<Entry> {
    let tool = &session.tools.profiles;
    let entry = |text: String, help, step| Entry::new(format!("Profiles: {text}"), help, Action::Profile(step));
    let look = |one: &PlacedProfile| {
        let help = "Shows its points by distance along and height";
        entry(format!("{} from the side", one.profile.name), help, Profiling::Look(Some(one.id)))
    };
    let mut entries: Vec<Entry> = session.scene.objects.profiles.iter().map(look).collect();
    if let Some(profile) = tool.profile(&session.scene) {
        let name = &profile.name;
        for ending in ["csv", "laz", "png", "svg"] {
            let text = format!("save {name} as {}", ending.to_uppercase());
            entries.push(entry(text, "Writes its points, or a chart of them", Profiling::Save(ending)));
        }
        let (ruler, together) = (tool.ruler.is_none(), !tool.is_together);
        entries.push(entry("ruler".into(), "Measures between two clicks", Profiling::Ruler(ruler)));
        entries.push(entry("all in one chart".into(), "Shows the others behind it", Profiling::Together(together)));
        entries.push(entry(format!("close {name}"), "Closes the chart", Profiling::Look(None)));
    }
    entries
}
