//! Measures how accurate reflections and indirect light are.
//!
//! [`metrics`] holds the figures by which one picture is judged, [`flip`] the difference that a person would see,
//! [`light`] the figures of indirect light. A [`Subject`] is a scene of which pictures are made; a [`Tracer`] compares
//! one of them with the truth of `trace`.
//!
//! A [`Ruler`] says how far the surface of a scan is from the scan itself.
//!
//! A [`Plan`] lists the settings to measure, [`runner`] measures them and journals each run in a [`Folder`],
//! [`results`] makes a table of the runs, and [`chart`] and [`report`] present it.

mod accuracy;
pub mod auto;
mod builtin;
pub mod chart;
pub mod cost;
pub mod estimate;
mod file_name;
mod five_mirrors;
mod flicker;
pub mod flip;
mod intervals;
mod journal;
pub mod light;
mod loaded;
pub mod metrics;
pub mod pages;
pub mod picture;
pub mod plan;
pub mod referee;
mod refine;
pub mod report;
pub mod results;
pub mod runner;
mod scanner;
pub mod sightlines;
pub mod ssim;
pub mod stability;
mod still;
mod subject;
pub mod table;
pub mod targets;
mod truth;

pub use accuracy::{Error, MirrorImage, Result, accuracy_exact, accuracy_same_input, pixel_errors_same_input};
pub use auto::Choice;
pub use builtin::{names as plan_names, plan as built_in_plan};
pub use cost::{CostModel, Slowest};
pub use estimate::{Estimate, Judged, RAYS, estimate, judge};
pub use file_name::file_name;
pub use five_mirrors::{FiveMirrors, IndirectTruth, JudgedLight, TracedLight};
pub use flicker::{Flicker, flicker};
pub use intervals::Interval;
pub use journal::{Folder, FolderError, OF_TILES, SceneFiles};
pub use light::{LightError, light_error};
pub use metrics::{
    Accuracy, ImageError, Percentiles, PixelError, SurfaceError, Truth, delta_e, image_error, surface_error,
};
pub use plan::{Bound, Case, Group, Plan, PlanError, RAY_TRACE};
pub use referee::Referee;
pub use refine::Refinement;
pub use results::{Figure, Row};
pub use runner::{Scenes, Shard};
pub use scanner::{Scanner, ScannerFrom};
pub use sightlines::{HoldOut, Ruler, Scan, SightlineError, Sightlines};
pub use still::{ColorError, STILL_LIGHTS, Still, StillError, Target, drawn_size, still_settings};
pub use subject::{Faces, Subject, SubjectPart, clear_points};
pub use trace::Exact;
pub use truth::{Drawn, RayTraced, Seen, Surface, TracedScene, Tracer, View, mirrors_of};
