//! Renders points on the GPU: splatting into a camera G-buffer, shading, tone mapping; pass times, read-back, picking.
//!
//! Everything here is synchronous and may be called from any thread: `Renderer::render` returns when the GPU is done.
//! The window calls it from a thread of its own, so that the window never waits; the command line calls it directly.

mod allocation;
mod caustics;
mod coloring;
mod dead_branches;
mod exposure;
mod frame;
mod gi;
mod gpu;
mod handed;
mod identities;
mod image;
mod inputs;
mod kept_pipelines;
mod layout;
mod light_rays;
mod light_views;
mod lighting;
mod loads;
#[cfg(test)]
mod memory;
mod method;
mod page_space;
mod pass_times;
mod passes;
mod pieces;
mod probe;
mod quick;
mod read_back;
mod recorder;
mod reflection;
mod rehearsal;
mod renderer;
mod shader;
mod shading;
mod store;
mod surface;
mod targets;
mod together;
#[cfg(test)]
mod translation;

pub use coloring::{ColorPlan, ColorSource, STRAY_KINDS, VERDICT, class_color, class_name, ramp_colors};
pub use exposure::{Adaptation, Exposure};
pub use frame::Objects;
pub use gi::LightReuse;
pub use gpu::{
    AdapterReport, Clock, Error, Gpu, Need, Result, Verdict, acts_like, adapters, keep_pipelines_in, kind_name,
};
pub use handed::PictureRows;
pub use identities::{ChunkId, CloudId};
pub use image::{Aov, AovImage};
pub use lighting::MOST_LIGHTS;
pub use method::ReflectedShare;
pub use pass_times::PassTime;
pub use passes::PassStage;
pub use probe::{LightProbe, MirrorProbe, Probe, SeenMirror, Shown};
pub use quick::{Detail, EarlierLight, Known, KnownLight, QuickPicture};
pub use read_back::Picked;
pub use recorder::IsGivenUp;
pub use reflection::kept_hits::GlossCache;
pub use reflection::{CameraCount, MapCount, MapLimit, MapUse, ReflectionStats};
pub use renderer::{Effort, Frame, FrameStats, Renderer};
pub use store::{Material, PointStore};
