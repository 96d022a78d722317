//! A scene and how it is shown: camera, parameters, scene files, built-in scenes.

mod bookmark;
mod built_in_path;
mod camera;
mod camera_path;
mod caption;
mod clip;
mod cloud_settings;
mod comments;
mod curve;
mod file;
pub mod five_mirrors;
mod interior;
mod light;
mod measurement;
mod method;
mod methods_read;
mod mirror;
mod mirror_mesh;
mod mirror_points;
mod motion;
mod object;
mod parameter_text;
mod path_edit;
mod path_wipe;
pub mod pool;
mod preferences;
mod preset;
mod profile;
mod settings;
pub mod solid;
pub mod surface_points;
mod surroundings;
mod track;
pub mod tripod;
mod visibility;
pub mod whole_file;
mod wipe;

pub use bookmark::{Bookmark, MOST_BOOKMARKS};
pub use built_in_path::{BuiltInPath, PathPlace};
pub use camera::{Camera, Projection, StandardView};
pub use camera_path::{CameraPath, Keyframe};
pub use caption::{Caption, Place};
pub use clip::{Clip, ClipShape, Keep, MOST_CLIPS, Prism};
pub use cloud_settings::CloudSettings;
pub use comments::with_comments;
pub use file::{Error, SceneFile, View};
pub use interior::Interior;
pub use light::{LightClues, ResolvedLight, SpotLight};
pub use measurement::{MOST_MEASUREMENTS, MOST_NOTES, Measurement, MeasurementKind, Note};
pub use method::{METHODS, Method, MethodRow, RAY_TRACE, Supply};
pub use mirror::{MOST_MIRRORS, Mirror, REFRACTION, Shape, WATER};
pub use mirror_mesh::MirrorMesh;
pub use mirror_points::{MirrorNormals, MirrorPoints, PointChoice};
pub use motion::Motion;
pub use object::{Object, ObjectKind};
pub use param::shown;
pub use path_edit::LEAST_GAP;
pub use path_wipe::line_value;
pub use preferences::{CaptureFormat, Language, Preferences};
pub use preset::{PRESETS, Preset};
pub use profile::{MOST_PROFILES, Profile};
pub use settings::{
    Atomics, Blank, BundleCull, BundleRest, BundleSplat, CameraCells, Color, ColorBy, CubeCriterion, CubeHit,
    CubePlacement, CubeRest, CubeSampling, Curve, Edl, ExposureFit, FresnelLaw, Gi, GlossLobe, GlossPattern,
    GlossSettings, Highlight, IndirectBy, JudgedBy, KeptPoints, LargeDiscs, LastMirror, Light, LightField, LightView,
    Lighting, MapFill, MirrorSettings, MirrorSurface, Occluder, Overlay, OwnPoints, Paging, Quality, Ramp, Reading,
    Reflection, SampleCameras, SampleRest, SampleRule, SampleVisibility, SceneSettings, ScreenBack, ScreenBox,
    ScreenCompletion, ScreenCriterion, ScreenRest, ScreenSampling, Seeds, Settings, Show, Solver, Splat, Sscr, Start,
    Strays, Stream, Sun, Surface, SurfaceOrientation, SurfaceRadii, Tone, Trace, UpAxis, ViewSettings, VirtualLight,
};
pub use surroundings::{Room, Surroundings};
pub use track::{Ease, Handle, Track, WIPE};
pub use tripod::Tripod;
pub use visibility::{Filter, Visibility};
pub use wipe::{MOST_STATES, WipeMarks, WipeState};
