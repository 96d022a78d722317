//! What a person can ask for, by a key, a gesture or a panel. Panels read the session and push actions; `Session::act` has the parts
//! of the session carry them out.

use std::path::PathBuf;

use glam::{DVec2, DVec3};
use scene::{ColorBy, Lighting, MirrorPoints, Object, Settings, Shape, StandardView};
use world::CloudKey;

use crate::viewer::objects::{Marking, ObjectId};
use crate::viewer::panels::path_prompt::PathPrompt;
use crate::viewer::tools::draft::Draft;
use crate::viewer::tools::inspection::Pose;
use crate::viewer::truth::sweep_range::SweepRange;
use crate::viewer::truth::tasks::Measure;
use crate::viewer::truth::view::Look;

/// How the mouse moves the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    #[default]
    Orbit,
    Fly,
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

#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    // ---- camera ----
    /// A drag, in points of the window.
    Orbit(DVec2),
    Look(DVec2),
    /// A drag, in pixels of the picture.
    Pan(DVec2),
    /// In wheel notches, as are the other wheel actions; positive is nearer, larger, wider, faster.
    Zoom(f32),
    FieldOfView(f32),
    FlySpeed(f32),
    /// A key that is held: right, up, forward. The keys of a frame together give `Travel`.
    Fly([i8; 3]),
    Fast,
    Slow,
    /// World units right, up, forward.
    Travel(DVec3),
    PivotHere,
    FrameAll,
    FrameCloud(CloudKey),
    ToggleMode,
    LookFrom(StandardView),
    LookAlong {
        eye: DVec3,
        pivot: DVec3,
    },
    ToggleProjection,
    /// The pixel under the cursor; `None` where the cursor is not over the picture.
    PointAt(Option<[u32; 2]>),
    /// Looks up which point is under the cursor.
    AskHover,

    // ---- parameters ----
    SetParameter {
        key: String,
        value: param::Value,
    },
    /// All parameters at once.
    ChangeSettings(Box<Settings>),
    PointSize(f32),
    ColorBy(ColorBy),
    ShowClasses(Vec<u8>, bool),
    ToggleEdl,
    /// The data's own colours while the key is held; the held keys of a frame together give `Hold`.
    RawColors,
    Hold {
        raw_colors: bool,
        truth: bool,
    },
    /// The data's own colours and back.
    ToggleLight,
    NextLight,
    LightBy(Lighting),
    Undo,
    Redo,

    // ---- files ----
    /// What a path, or the name of a built-in scene, names.
    Open(PathBuf),
    OpenDialog,
    OpenPrompt,
    /// Asks for a file whose points are to be a mirror.
    PromptForMirror,
    ChangePrompt(Box<PathPrompt>),
    /// Opens what was typed; the prompt stays if it names nothing.
    OpenPrompted(String),
    ClosePrompt,
    Copy(String),
    CopyView,
    /// The key; the clipboard's text comes as `Paste`.
    PasteView,
    Paste(String),
    CopyCommandLine,
    SaveScene,
    SavePicture,
    StopLoading,
    ShowCloud(CloudKey, bool),
    RemoveCloud(CloudKey),
    StopMaking(CloudKey),
    ResumeMaking(CloudKey),
    DeleteIndex(CloudKey),

    // ---- mirrors and lights ----
    AddMirror(Shape),
    AddSpot,
    Select(Option<ObjectId>),
    ChangeObject(ObjectId, Box<Object>),
    Gizmo(Handles),
    /// A handle of the gizmo was grabbed, or let go.
    GrabHandle(bool),
    Duplicate,
    Delete,
    /// Lights are being looked after: they are shown in the picture.
    ShowLights(bool),
    Inspect,
    /// In wheel notches.
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
    /// The click before a double-click was not meant as a pick.
    UndoPick,
    PickTool,
    CopyPicks,
    ClearPicks,

    // ---- truth ----
    /// The ray-traced truth in place of the picture, while the key is held.
    ShowTruth,
    PinTruth,
    LookAtTruth(Look),
    MeasureTruth(Measure),
    SplitTruth(f32),
    KeepTruthReady(bool),
    JudgeSettings(bool),
    StopTruth,
    ToggleChart,
    /// Goes back to the parameters of a setting that was tried.
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
    ToggleFullScreen,
    ToggleShortcuts,
    ListMessages(bool),
    /// By its place in the list.
    DismissMessage(usize),
    /// Pixels of the picture.
    Resize([u32; 2]),
    Quit,
}

impl Action {
    /// A wheel action for `notches` of the wheel.
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

    /// A drag action for a drag by `delta` points of the window, which has `scale` pixels a point.
    pub fn dragged(self, delta: DVec2, scale: f64) -> Self {
        match self {
            Self::Orbit(_) => Self::Orbit(delta),
            Self::Look(_) => Self::Look(delta),
            Self::Pan(_) => Self::Pan(delta * scale),
            other => other,
        }
    }

    /// One parameter of a group.
    pub fn set(group: &str, name: &str, value: param::Value) -> Self {
        Self::SetParameter { key: format!("{group}.{name}"), value }
    }
}
