//! What the viewer knows (`state`, `actions`), what happens to it as a whole (documents, views, the kept state), and the
//! effects that it asks for.

mod actions;
pub mod document;
pub mod effects;
pub mod first_look;
mod kept;
mod own_settings;
mod state;
pub mod views;
mod wanted;

use document::Document;
use first_look::FirstLook;
use kept::Kept;

use crate::viewer::filming::Filming;
use crate::viewer::frames::Frames;
use crate::viewer::frames::auto::Auto;
use crate::viewer::loaded::Loaded;
use crate::viewer::look::reflection_figures::FigureHistory;
use crate::viewer::requests::action::Palette;
use crate::viewer::requests::columns::ColumnsDraft;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::path_prompt::PathPrompt;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::scene::Scene;
use crate::viewer::tools::Tools;
use crate::viewer::truth::sweep::Sweeps;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::TruthView;

/// What the viewer knows. `actions` and `state` change it.
pub struct Session {
    pub loaded: Loaded,
    pub scene: Scene,
    pub figure_history: FigureHistory,
    pub tools: Tools,
    pub raw_colors: bool,
    pub truth: TruthView,
    pub kept: Kept,
    pub tuning: Tuning,
    pub sweeps: Sweeps,
    pub outside: Outside,
    pub preferences: Preferences,
    pub path_prompt: Option<PathPrompt>,
    /// Tables that wait for the names of their columns, the first of which is asked about.
    pub unnamed: Vec<ColumnsDraft>,
    pub palette: Option<Palette>,
    /// What is searched for among the parameters.
    pub search: String,
    pub shortcuts_are_open: bool,
    pub interface_is_hidden: bool,
    pub is_full_screen: bool,
    /// The name of the adapter that draws; `None` until its shaders are compiled.
    pub adapter: Option<String>,
    pub frames: Frames,
    pub auto: Auto,
    pub filming: Filming,
    /// Set while the window shows what it does when nothing is named.
    pub first_look: Option<FirstLook>,
    pub document: Document,
    /// Whether a text has the keyboard: what it changes is one step of undo. The picture does not wait for its end.
    pub is_typing: bool,
    /// The reason why nothing can be drawn any more.
    pub fatal: Option<String>,
    pub wants_to_quit: bool,
    /// True while pictures are recorded: only final pictures are drawn, and none depends on the pictures before it.
    pub is_recorded: bool,
}
