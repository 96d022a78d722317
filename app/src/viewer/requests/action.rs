//! What a person can ask for with a key, a gesture or a panel. Panels read the session and push actions. `Session::act`
//! passes each action to the part of the session that carries it out.

use std::path::PathBuf;

use glam::{DVec2, DVec3};
use scene::{
    Bookmark, CameraPath, CaptureFormat, ClipShape, CloudSettings, ColorBy, Filter, Language, Lighting,
    MeasurementKind, MirrorPoints, Object, Settings, Shape, StandardView,
};
use world::CloudKey;

use crate::viewer::jobs::comparisons::CompareDraft;
use crate::viewer::jobs::ghosts::GhostsDraft;
use crate::viewer::jobs::sweep_range::SweepRange;
use crate::viewer::jobs::tasks::Measure;
use crate::viewer::look::tab::Tab;
use crate::viewer::objects::inspection::Pose;
use crate::viewer::objects::{Marking, ObjectId};
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::requests::columns::Naming;
use crate::viewer::requests::draft::Draft;
use crate::viewer::requests::path_prompt::{PathPrompt, Purpose};
use crate::viewer::requests::recording::Wanted;

/// What a pinned truth shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    #[default]
    Truth,
    /// The picture on the left, the truth on the right.
    Split,
    Difference,
}

/// How the mouse moves the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    #[default]
    Orbit,
    Fly,
}

/// What a person does with clip volumes and filters, besides what can be done with every object.
#[derive(Clone, Debug, PartialEq)]
pub enum Clipping {
    /// Adds a volume around all that is shown.
    AroundAll(ClipShape),
    /// Adds a box around the last picked point.
    AroundPick,
    /// Adds a box around the points in the picture.
    AroundView,
    /// Begins to draw the polygon of a prism; again: gives it up.
    DrawPrism,
    /// Makes a prism of the polygon.
    EndPrism,
    Filter(Vec<Filter>),
}

/// What a person does with measurements and notes, besides what can be done with every object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measuring {
    /// Begins a measurement, whose points are clicked; again: gives it up.
    Begin(MeasurementKind),
    /// Begins one of the kind that was measured last; again: gives it up.
    Again,
    /// Begins a note, whose place is clicked; again: gives it up.
    BeginNote,
    /// Begins a profile, whose line is clicked; again: gives it up.
    BeginProfile,
    RemoveCorner,
    End,
    FlyTo(ObjectId),
    /// Goes to the next note (1), or to the one before (-1).
    StepNote(i32),
    /// Copies the values of all measurements.
    CopyAll,
}

/// A path that begins with something in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathPreset {
    /// One keyframe: the view.
    View,
    /// All bookmarks, in their order, two seconds apart.
    Bookmarks,
    Turntable,
    /// Around the selected object, rising and sinking.
    Orbit,
    /// Above the points of the selected measurement.
    Polyline,
    /// The view, across which the selected mirror moves and back.
    MirrorSweep,
    /// The view, with every method for two seconds.
    MethodTour,
    /// The view, wiped from the present method to the ray tracer.
    WipeToTruth,
    /// The view, wiped from the kept state of the picture to the present one.
    WipeFromKept,
}

/// What a person does with kept views and with paths of the camera.
#[derive(Clone, Debug, PartialEq)]
pub enum Film {
    /// Keeps the view. A digit takes the place of the view that it flew to before.
    Keep(Option<u8>),
    FlyToDigit(u8),
    /// Flies to the bookmark with this index.
    FlyTo(usize),
    ChangeBookmark(usize, Box<Bookmark>),
    RemoveBookmark(usize),
    /// Opens or closes the timeline.
    Toggle,
    /// Shows the path of this name in the timeline.
    Choose(String),
    Add(PathPreset),
    /// Changes the path in the timeline.
    Change(Box<CameraPath>),
    Remove,
    /// Keeps what a parameter or a value of an object is now, as a key of a track at the time of the timeline.
    Key(String),
    /// Shows the path at a time, in seconds.
    Scrub(f64),
    /// Plays the path, or pauses.
    Play,
    Repeat(bool),
    /// How high above a measurement new paths fly, in world units.
    FlyAt(f64),
    /// Opens the dialog of recordings for the path in the timeline.
    AskRecording,
    /// Changes the dialog; `None` closes it.
    ChangeRecording(Option<Box<Wanted>>),
    StartRecording,
    StopRecording,
    /// Records the window; again: ends that.
    Capture,
    /// What the window is recorded into from now on.
    CaptureAs(CaptureFormat),
}

/// What a person does with the scene file.
#[derive(Clone, Debug, PartialEq)]
pub enum Filing {
    Save,
    /// Asks for a place first.
    SaveAs,
    SaveTo(PathBuf),
    /// Saves the scene in its place, though another program has changed the file.
    Replace,
    /// No place was chosen.
    NoPlace,
    /// Closes everything and opens another scene file.
    Open(PathBuf),
    /// The answers to the question about unsaved work.
    SaveAndLeave,
    Discard,
    Stay,
    /// Offers work that a program has left which ended before it was saved.
    Offer,
    /// The answers to that offer.
    Restore,
    DeleteLeft,
    Later,
    /// Whether the last scene file is opened at the start.
    Reopen(bool),
}

/// What a person does with profiles, besides what can be done with every object.
#[derive(Clone, Debug, PartialEq)]
pub enum Profiling {
    /// Shows the points of a profile from the side, or no longer.
    Look(Option<ObjectId>),
    /// The point of the profile under the cursor.
    Hover(Option<PickedPoint>),
    /// Picks a point of the profile, as a click into the picture does.
    Pick(PickedPoint),
    /// Begins or ends to measure between places of the profile.
    Ruler(bool),
    /// An end of what is measured: the distance along the line, the height, and the point that it snapped to.
    Rule([f64; 2], Option<PickedPoint>),
    /// Shows the points of the other profiles that are switched on behind those of the one in view, or no longer.
    Together(bool),
    /// Adds so many copies of the profile in view, each so far to the left of the one before.
    Stack(u32, f64),
    /// Writes the profile in view to a new file with this ending.
    Save(&'static str),
}

/// A step of writing the points that are shown to a new file.
#[derive(Clone, Debug, PartialEq)]
pub enum Export {
    /// Asks for the place.
    Ask,
    To(PathBuf),
    /// Gives the file up.
    Stop,
}

/// A step of measuring the distances between two clouds.
#[derive(Clone, Debug, PartialEq)]
pub enum Compare {
    Change(Box<CompareDraft>),
    Start,
    Stop,
}

/// A step of looking for ghosts.
#[derive(Clone, Debug, PartialEq)]
pub enum Ghosting {
    Change(Box<GhostsDraft>),
    Look,
    Stop,
    /// Makes the mirror of this index an object of the scene.
    Accept(usize),
    /// Refuses the mirror of this index: its ghosts count as real points.
    Refuse(usize),
    Hide(bool),
    /// Moves a mirror of the scene from where it stands to where the points that were seen in it fit best.
    Fit(ObjectId),
    /// Opens the ghosts of accepted mirrors at the places that were seen.
    PutBack,
}

/// What a person does with the kept state of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeptStep {
    /// Keeps the present state, in place of one kept before.
    Keep,
    LetGo,
    /// Makes the kept state the present one, and the other way around.
    Swap,
    ToggleSplit,
    /// Shows the kept state and the present one side by side; again: the present one alone.
    ToggleBeside,
    /// The position of the split, from 0 at the left to 1.
    SplitAt(f32),
}

/// Which handles of the gizmo are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Handles {
    #[default]
    All,
    Move,
    Turn,
    Scale,
}

/// What is typed into the command palette, and which of the rows that it finds is chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Palette {
    pub text: String,
    pub chosen: usize,
    /// Whether its field has the keyboard already.
    pub is_shown: bool,
}

/// What a person has entered about a picture to save.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureDraft {
    pub path: String,
    /// The size in pixels.
    pub size: [u32; 2],
    /// Whether its field has the keyboard already.
    pub is_shown: bool,
}

/// A step of saving the picture.
#[derive(Clone, Debug, PartialEq)]
pub enum SavePicture {
    /// As it is shown, under the next free name.
    AtOnce,
    /// Asks for size, name and place.
    Ask,
    /// Changes what is entered; `None` closes the window.
    Change(Option<Box<PictureDraft>>),
    /// Asks for the place in the system's dialog; this one is proposed.
    Browse(PathBuf),
    To(Box<PictureDraft>),
}

impl PictureDraft {
    /// The path with its extension.
    pub fn place(&self) -> String {
        let path = self.path.trim();
        if path.to_lowercase().ends_with(".png") { path.to_owned() } else { format!("{path}.png") }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    // ---- camera ----
    /// A drag over the picture begins, or has ended: what is under the cursor decides what it turns.
    BeginDrag,
    EndDrag,
    /// The distance of a drag, in points of the window; `Look` has the same unit.
    Orbit(DVec2),
    Look(DVec2),
    /// The distance of a drag, in pixels of the picture.
    Pan(DVec2),
    /// A number of wheel notches, as in all wheel actions. Positive numbers zoom in, or make things larger, wider or
    /// faster.
    Zoom(f32),
    FieldOfView(f32),
    FlySpeed(f32),
    /// A held key and its directions: right, up, forward. The input handler adds up all keys held in a frame to one
    /// `Travel`.
    Fly([i8; 3]),
    Fast,
    Slow,
    /// The way to fly, in world units: right, up, forward.
    Travel(DVec3),
    PivotHere,
    FrameAll,
    /// Into the room.
    GoInside,
    /// Out of the room, which is then seen without the backs of its walls.
    DollHouse,
    FrameCloud(CloudKey),
    ToggleMode,
    LookFrom(StandardView),
    LookAlong {
        eye: DVec3,
        pivot: DVec3,
    },
    ToggleProjection,
    /// Goes back to where the camera rested before.
    LastView,
    /// Takes that back.
    NextView,
    /// Says which pixel the cursor is over; `None` if it is outside of the picture.
    PointAt(Option<[u32; 2]>),
    /// Asks the render thread which point is under the cursor.
    AskHover,

    // ---- parameters ----
    SetParameter {
        key: String,
        value: param::Value,
    },
    /// Gives the parameter of this key its default.
    Reset(String),
    /// Replaces all parameters at once.
    ChangeSettings(Box<Settings>),
    PointSize(f32),
    ColorBy(ColorBy),
    ShowClasses(Vec<u8>, bool),
    ToggleEdl,
    /// A held key that shows the data's own colours. The input handler gathers the held keys of a frame into one
    /// `Hold`.
    RawColors,
    Hold {
        raw_colors: bool,
        truth: bool,
        kept: bool,
    },
    /// Switches to the data's own colours, or back to the light before.
    ToggleLight,
    NextLight,
    LightBy(Lighting),
    Undo,
    Redo,

    // ---- files ----
    /// Opens a path or a built-in scene.
    Open(PathBuf),
    OpenDialog,
    /// Names the columns of a table that waits for that.
    Name(Naming),
    OpenPrompt,
    /// Asks for a file whose points will be a mirror.
    ChangePrompt(Box<PathPrompt>),
    /// Opens the path that was typed. The prompt stays open if nothing has that name.
    OpenPrompted(String),
    ClosePrompt,
    Copy(String),
    CopyView,
    /// The key for pasting. The text of the clipboard follows as `Paste`.
    PasteView,
    Paste(String),
    CopyCommandLine,
    File(Filing),
    SavePicture(SavePicture),
    Export(Export),
    Compare(Compare),
    Ghosts(Ghosting),
    StopLoading,
    /// Stops what is loaded, and saving, comparing and the search for ghosts.
    StopAll,
    ShowCloud(CloudKey, bool),
    /// Sets what a cloud has of its own.
    ChangeCloud(CloudKey, Box<CloudSettings>),
    RemoveCloud(CloudKey),
    StopMaking(CloudKey),
    ResumeMaking(CloudKey),
    DeleteIndex(CloudKey),

    // ---- mirrors, lights and clip volumes ----
    AddMirror(Shape),
    AddSpot,
    Clip(Clipping),
    Select(Option<ObjectId>),
    ChangeObject(ObjectId, Box<Object>),
    Gizmo(Handles),
    /// Says whether a handle of the gizmo was grabbed (true) or released.
    GrabHandle(bool),
    Duplicate,
    Delete,
    /// Says whether the light panel is open: the picture shows symbols of the lights while it is.
    ShowLights(bool),
    Inspect,
    /// A number of wheel notches, as in `Zoom`.
    InspectDistance(f32),
    InspectTilt(f32),
    ChangeInspection(Pose),
    ChangeDraft(Box<Draft>),
    CountPoints(CloudKey, Box<MirrorPoints>),
    Mark(Box<Marking>),
    Unmark(Box<Marking>),
    StopMarking(CloudKey),

    // ---- picking ----
    Pick,
    /// A pick in the middle of the picture, wherever the cursor is.
    PickMiddle,
    /// Undoes the pick by the first click of a double-click, which was meant for something else.
    UndoPick,
    CopyPick,
    ClearPick,
    Measuring(Measuring),
    Profile(Profiling),

    // ---- the kept state ----
    /// A held key that shows the kept state in place of the picture.
    ShowKept,
    Kept(KeptStep),
    Film(Film),

    // ---- truth ----
    /// A held key that shows the ray-traced truth in place of the picture.
    ShowTruth,
    PinTruth,
    LookAtTruth(Look),
    MeasureTruth(Measure),
    SplitTruth(f32),
    KeepTruthReady(bool),
    JudgeSettings(bool),
    EstimateErrors(bool),
    StopTruth,
    ToggleChart,
    /// Restores the parameters of a trial.
    ReturnTo(Box<Settings>),
    ForgetTrials,
    AddToStudy,
    AskSweep(String),
    ChangeSweep(Option<Box<SweepRange>>),
    StartSweep {
        key: String,
        values: Vec<String>,
    },
    EndSweep,

    // ---- window ----
    EndTool,
    ToggleInterface,
    TogglePanel,
    OpenTab(Tab),
    /// Gives the window another language.
    Speak(Language),
    /// Searches the parameters of all tabs; an empty text shows the tab again.
    Search(String),
    /// Searches for a parameter from outside of the panel, which is then shown.
    FindParameter(String),
    TogglePalette,
    ChangePalette(Option<Box<Palette>>),
    ToggleFullScreen,
    ToggleShortcuts,
    /// Tells a person that something that they typed is not taken.
    Warn(String),
    ListMessages(bool),
    /// The index of the message in the list.
    DismissMessage(usize),
    /// The size of the picture in pixels.
    Resize([u32; 2]),
    Quit,
}

impl Action {
    /// What saves under this path, if that is the purpose of a prompt.
    pub fn saving(purpose: Purpose, path: &str) -> Option<Self> {
        match purpose {
            Purpose::SaveScene => Some(Self::File(Filing::SaveTo(path.into()))),
            Purpose::SavePoints => Some(Self::Export(Export::To(path.into()))),
            Purpose::Open | Purpose::MirrorPoints | Purpose::Mesh => None,
        }
    }

    /// Multiplies a wheel action by the number of notches; other actions stay as they are.
    pub fn scaled(self, notches: f32) -> Self {
        match self {
            Self::Zoom(step) => Self::Zoom(step * notches),
            Self::PointSize(step) => Self::PointSize(step * notches),
            Self::FieldOfView(step) => Self::FieldOfView(step * notches),
            Self::FlySpeed(step) => Self::FlySpeed(step * notches),
            Self::InspectDistance(step) => Self::InspectDistance(step * notches),
            Self::InspectTilt(step) => Self::InspectTilt(step * notches),
            other => other,
        }
    }

    /// Gives the actions of the digit keys their digit. Other actions stay as they are.
    pub fn with_digit(self, digit: u8) -> Self {
        match self {
            Self::Film(Film::Keep(_)) => Self::Film(Film::Keep(Some(digit))),
            Self::Film(Film::FlyToDigit(_)) => Self::Film(Film::FlyToDigit(digit)),
            other => other,
        }
    }

    /// Gives a drag action its distance. `delta` is in points of the window, and `scale` is the number of pixels per
    /// point. Other actions stay as they are.
    pub fn dragged(self, delta: DVec2, scale: f64) -> Self {
        match self {
            Self::Orbit(_) => Self::Orbit(delta),
            Self::Look(_) => Self::Look(delta),
            Self::Pan(_) => Self::Pan(delta * scale),
            other => other,
        }
    }

    /// Returns the action that sets one parameter of a group.
    pub fn set(group: &str, name: &str, value: param::Value) -> Self {
        Self::SetParameter { key: format!("{group}.{name}"), value }
    }
}
