//! Parses the command line with clap into plain values. The commands decide what the values mean.

use std::ffi::OsString;
use std::ops::Range;
use std::path::PathBuf;

use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::error::{ContextKind, ContextValue};
use clap::{Args, Parser, Subcommand};
use glam::DVec3;
use scene::{CameraPath, Preset};
use study::Target;

use crate::shared::ghost_arguments::{GhostsArguments, ScanArguments};
use crate::shared::numbers::{parse_place, parse_seed};
use crate::system::film::Codec;
use crate::system::terminal::escaped;

/// Views, lights and measures point clouds (LAS, LAZ, E57, PLY, PTS, PTX, PCD, XYZ, CSV, EPT).
#[derive(Debug, Parser)]
#[command(
    name = "glint",
    version = env!("GLINT_VERSION"),
    args_conflicts_with_subcommands = true,
    disable_help_subcommand = true,
    after_help = "Exit status: 0 done, 1 the work failed, 2 bad usage or unreadable input, 3 no display or no adapter, 130 \
                  interrupted (143 by SIGTERM, 129 by SIGHUP)"
)]
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub view: ViewArguments,
    /// Names of the columns of tables, where the first line does not name them: x,y,z,intensity,r,g,b; skip leaves one out
    #[arg(long, global = true, value_name = "NAMES", value_delimiter = ',')]
    pub columns: Vec<String>,
    /// Value of the header Authorization for addresses that are typed, such as `Bearer ...`
    #[arg(long, global = true, value_name = "VALUE", env = "GLINT_AUTHORIZATION", hide_env_values = true)]
    pub authorization: Option<String>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Open the viewer; the same as without a command
    View(ViewArguments),
    /// List what files hold: format, points, extent, attributes, coordinate system
    Info(InfoArguments),
    /// Write the picture the viewer would show
    Render(RenderArguments),
    /// Write a film or pictures along a path of the camera
    Record(RecordArguments),
    /// Make the index that large clouds are streamed from ahead of time, or write it as COPC; the viewer makes it by itself
    Index(IndexArguments),
    /// List the reflection methods and every parameter
    Methods(ListingArguments),
    /// List the built-in scenes
    Scenes(ListingArguments),
    /// Measure settings of a plan against one another: time, error, charts
    Study(StudyArguments),
    /// Measure how far the surface that is drawn is from the scan that it is made of
    Surfaces(SurfacesArguments),
    /// Write the points of a section along a line: distance along, height, coordinates, attributes; or draw them
    Profile(ProfileArguments),
    /// Write the points that a scene shows to a new file, with all attributes: LAS, LAZ, COPC, E57, PLY or a table
    Export(ExportArguments),
    /// Print the measurements that a scene file keeps: values, units, uncertainty
    Measure(MeasureArguments),
    /// Measure how far the points of a cloud are from another cloud
    Compare(CompareArguments),
    /// Find points that a scanner saw in mirrors and panes, and put them back
    Ghosts(GhostsArguments),
    /// Say which adapter and display will be used, and why
    Doctor(DoctorArguments),
}

#[derive(Debug, Args)]
pub struct ViewArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, a scene file (`.toml`), names of built-in scenes
    pub inputs: Vec<OsString>,
    /// Set a parameter, as in `--set splat.size=2`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
    /// File with a view (as "copy view" gives it), - for standard input, or front, back, left, right, top, bottom, iso, or scene for the scene's own
    #[arg(long, value_name = "FILE|NAME")]
    pub camera: Option<OsString>,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

#[derive(Debug, Args)]
pub struct GpuArgument {
    /// Adapter to use: part of its name, `cpu`, or the backend (`vulkan`, `dx12`, `metal`); the fastest if not given
    #[arg(long, value_name = "NAME")]
    pub gpu: Option<String>,
}

#[derive(Debug, Args)]
pub struct InfoArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, or a scene file (`.toml`) for its clouds
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    /// Read all points of large files too, to make sure of their number and extent (up to 64 MB that is always done)
    #[arg(long)]
    pub scan: bool,
}

#[derive(Debug, Args)]
pub struct RenderArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, a scene file (`.toml`), names of built-in scenes
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// PNG file to write
    #[arg(short, long, value_name = "OUT.png")]
    pub output: PathBuf,
    /// Width and height of the picture, pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", allow_hyphen_values = true, default_value = "800x600", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Take the values of screen-space curved reflections that belong together: published (by the shape of the mirror), fast
    /// or accurate. Other parameters are set after it
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    pub preset: Option<&'static Preset>,
    /// Reflection method; `glint methods` lists them. Short for --set reflection.method=NAME
    #[arg(long, value_name = "NAME")]
    pub method: Option<String>,
    /// Set a parameter, as in `--set splat.size=2`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
    /// File with a view (as "copy view" gives it), - for standard input, or front, back, left, right, top, bottom, iso, or scene for the scene's own
    #[arg(long, value_name = "FILE|NAME")]
    pub camera: Option<OsString>,
    /// Path of the camera, for --time: of the scene file, or turntable, orbit or flight; the scene's only one if not given
    #[arg(long, value_name = "NAME", requires = "time")]
    pub path: Option<String>,
    /// Write the picture of a path at this time, which is the frame that `glint record` has then
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = parse_time,
        conflicts_with_all = ["camera", "stats", "frames", "budget", "error"])]
    pub time: Option<f64>,
    /// Reflections that are followed, one after the other. Short for --set reflection.bounces=N
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub bounces: Option<u32>,
    /// Also write a linear float image: depth, normal, albedo, mirror, position, direct, indirect, color, mirror_position,
    /// mirror_albedo, mirror_normal, specular_intensity, specular_power, refraction, regions, curvature, uncertain; surface_error,
    /// how far the surface may be off along the pixel's ray; reference_position, reference_color and reference_indirect are
    /// traced on the CPU. Depth is measured along the direction of view, in world units. Light that is drawn, and not
    /// traced, ends at 65504. Positions are in world coordinates; where float32 would round these to more than a millimetre,
    /// relative to the attribute `origin` of the file
    #[arg(long, value_name = "NAME=FILE.exr", value_parser = OsStringValueParser::new().try_map(parse_image))]
    pub aov: Vec<(String, PathBuf)>,
    /// Write times, counts and memory as JSON
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Measure how accurate the picture's reflections are, for --stats, by rays through the same points (same_input), or through
    /// the surfaces behind them (exact): the formulas of a built-in scene, or the triangles of PLY meshes
    #[arg(long, value_name = "same_input|exact", value_parser = parse_truth, requires = "stats")]
    pub truth: Option<study::Truth>,
    /// Estimate the errors of reflections and indirect light, for --stats, from exact answers at random pixels, with intervals of
    /// 95 %; needs no model of the scene
    #[arg(long, requires = "stats")]
    pub estimate: bool,
    /// Frames whose times --stats takes the median of, after one to warm up; 1 if not given
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: Option<u32>,
    /// Seed of the built-in scenes' points; short for --set scene.seed=N
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<u32>,
    #[command(flatten)]
    pub target: TargetArguments,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

/// What `auto` is to keep to.
#[derive(Debug, Args)]
pub struct TargetArguments {
    /// Let `auto` choose method, light, points and resolution for a frame of this time, as in 50ms or 1.5s, with the
    /// smallest error; parameters that are named stay as they are
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, value_parser = parse_budget, conflicts_with = "error")]
    pub budget: Option<Target>,
    /// Let `auto` choose them for this error, as in 1px of reflections or 2dE of colours (CIEDE2000, of mirrors and of the
    /// rest alike), with the smallest time; the error is that against the picture at full resolution with all points, 1024
    /// virtual lights and surfel_trace
    #[arg(long, value_name = "ERROR", allow_hyphen_values = true, value_parser = parse_error)]
    pub error: Option<Target>,
}

#[derive(Debug, Args)]
pub struct RecordArguments {
    /// A scene file (`.toml`), a file of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), a folder or an http(s) address of such files, or the name of a built-in scene
    pub scene: OsString,
    /// Path of the camera: of the scene file, or turntable, orbit or flight; the scene's only one if not given
    #[arg(long, value_name = "NAME")]
    pub path: Option<String>,
    /// Film to write (.mp4 or .gif), with its pictures in a folder beside it; any other name is that of a folder for the
    /// pictures, frame-000000.png and so on. Pictures that are there are kept: a recording that was stopped goes on
    #[arg(short, long, value_name = "OUT.mp4|OUT.gif|DIR")]
    pub output: PathBuf,
    /// Width and height of the pictures, pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", allow_hyphen_values = true, default_value = "1280x720", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Pictures a second of the path
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "30", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub fps: u32,
    /// Frames of the path to record, from A to before B; all if not given
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = parse_frames)]
    pub frames: Option<Range<u32>>,
    /// Average so many pictures over the time that the shutter is open: motion blur
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "1", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub subframes: u32,
    /// Share of a frame's time for which the shutter of --subframes is open, from the time of the frame on
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, default_value = "0.5", value_parser = parse_shutter)]
    pub shutter: f64,
    /// Draw pictures with so many times as many pixels in each direction, and average them; overlays keep their size
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "1", value_parser = clap::value_parser!(u32).range(1..=8))]
    pub supersample: u32,
    /// Write float images of each frame, too, as frame-000000.NAME.exr: depth, normal and others that `glint render` makes
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub aov: Vec<String>,
    /// Write what each picture was drawn from, too, as frame-000000.json: counts of points and pages, memory
    #[arg(long)]
    pub stats: bool,
    /// Encoder of an .mp4
    #[arg(long, value_name = "NAME")]
    pub codec: Option<Codec>,
    /// Record every N-th frame, from the K-th, into the same folder as the other shards
    #[arg(long, value_name = "K/N", allow_hyphen_values = true)]
    pub shard: Option<study::Shard>,
    /// Add pictures to a folder whose pictures another adapter or driver has drawn, which rounds otherwise
    #[arg(long)]
    pub mixed: bool,
    /// Take the values of screen-space curved reflections that belong together: published (by the shape of the mirror), fast
    /// or accurate. Other parameters are set after it
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    pub preset: Option<&'static Preset>,
    /// Set a parameter, as in `--set splat.size=2`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
    #[command(flatten)]
    pub target: TargetArguments,
    /// Write the progress to standard output as lines of JSON, and stop when standard input ends: for programs that
    /// start this one
    #[arg(long)]
    pub report: bool,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

#[derive(Debug, Args)]
pub struct IndexArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, or a scene file (`.toml`) for its clouds
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// Write all inputs as one cloud that can be streamed as it is (COPC); without, each gets its place in the cache folder
    #[arg(short, long, value_name = "OUT.copc.laz")]
    pub output: Option<PathBuf>,
    /// Write a catalogue of the files instead (OUT.vpc, STAC items), which opens them as one cloud
    #[arg(long, requires = "output")]
    pub catalogue: bool,
    /// Set a parameter, as in `--set stream.host_bytes=1GiB`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
}

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct StudyArguments {
    #[command(subcommand)]
    pub command: Option<StudyCommand>,
    /// Plan file (`.toml`), or the name of a built-in plan
    #[arg(value_name = "PLAN.toml|NAME", required_unless_present = "list")]
    pub plan: Option<OsString>,
    /// Folder for results, charts and report; a study that was stopped goes on there
    #[arg(short, long, value_name = "DIR", required_unless_present = "list")]
    pub output: Option<PathBuf>,
    /// List the built-in plans
    #[arg(long)]
    pub list: bool,
    /// Width and height of the pictures in place of the plan's, pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", allow_hyphen_values = true, value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Timed frames of each setting in place of the plan's
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeats: Option<u32>,
    /// Preset of screen-space curved reflections in place of the plan's: published, fast or accurate
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    pub preset: Option<&'static Preset>,
    /// Set a parameter of all settings; what a group sweeps stays
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
    /// Measure these inputs of `glint render`, too, in all groups of the plan whose scenes have no variables
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub input: Vec<OsString>,
    /// Run every N-th setting, from the K-th; `glint study merge` joins the shards
    #[arg(long, value_name = "K/N", allow_hyphen_values = true)]
    pub shard: Option<study::Shard>,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

#[derive(Debug, Subcommand)]
pub enum StudyCommand {
    /// Join the results of shards
    Merge(MergeArguments),
    /// Make a scan with mirrors and panes, in which everything is known of each point
    Scan(ScanArguments),
}

#[derive(Debug, Args)]
pub struct MergeArguments {
    /// Folders of shards of one plan
    #[arg(required = true, value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Folder for the joined results
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

#[derive(Debug, Args)]
pub struct SurfacesArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, a scene file (`.toml`) for its clouds, names of built-in scenes; made scans (`tripod/hall`) are judged by their exact surfaces, too, with all their points
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// A place of the scanner, in the coordinates of the file; of several places, each point was seen from one at least
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_place, allow_hyphen_values = true)]
    pub scanner: Vec<DVec3>,
    /// Share of the points that is held out, to judge the surface of the others by
    #[arg(long, value_name = "SHARE", default_value = "0.5", value_parser = parse_share, allow_hyphen_values = true)]
    pub holdout: f64,
    /// Seed by which points are held out
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "1", value_parser = parse_seed)]
    pub seed: u64,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    /// Set a parameter, as in `--set splat.size=2`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

#[derive(Debug, Args)]
pub struct ProfileArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, or a scene file (`.toml`) for its clouds and what it hides
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// Two or more corners of the line, in the coordinates of the file, as in 1,2,0:5,2,0; only their places seen from above count; the profiles of the scene file that are switched on if not given
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = parse_line, allow_hyphen_values = true, requires = "width")]
    pub line: Option<Line>,
    /// Thickness of the section, world units
    #[arg(long, value_name = "WIDTH", allow_hyphen_values = true, requires = "line")]
    pub width: Option<f64>,
    /// Take so many parallel sections more, each farther to the left of the line
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=100), requires = "spacing")]
    pub copies: u32,
    /// How far each of the copies is from the one before, world units
    #[arg(long, value_name = "DISTANCE", allow_hyphen_values = true, requires_all = ["line", "copies"])]
    pub spacing: Option<f64>,
    /// File to write, by the end of its name: .csv, .svg or .png for a chart, or .laz, .las, .copc.laz, .e57, .ply for the points; the table goes to standard output if not given
    #[arg(short, long, value_name = "OUT.csv|.svg|.png|.laz")]
    pub output: Option<PathBuf>,
    /// Write a report as JSON to standard output, with the number of points and the extent of each section; without a file to write, no table is made
    #[arg(long)]
    pub json: bool,
    /// Set a parameter, as in `--set color.by=height` or `--set splat.strays=hidden`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
}

#[derive(Debug, Args)]
pub struct ExportArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt, ept.json, .vpc), folders or http(s) addresses of them, - for standard input, or a scene file (`.toml`) for its clouds and what it hides
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// File to write, by the end of its name: .las, .laz, .copc.laz, .e57, .ply or .csv; a file that is there is not replaced
    #[arg(short, long, value_name = "OUT.laz")]
    pub output: PathBuf,
    /// Scene file whose clips, filters, hidden classes and hidden strays decide which points are shown
    #[arg(long, value_name = "FILE.toml")]
    pub scene: Option<PathBuf>,
    /// Write a report on the new file as JSON: its points, their bounds and attributes, and the number of points left out
    #[arg(long)]
    pub json: bool,
    /// Set a parameter, as in `--set stream.host_bytes=1GiB`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
}

#[derive(Debug, Args)]
pub struct MeasureArguments {
    /// A scene file (`.toml`) with measurements
    pub scene: OsString,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    /// Write a table (CSV) with a row for each value
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
}

#[derive(Debug, Args)]
pub struct CompareArguments {
    /// The cloud whose points are measured: a `.las`, `.laz` or `.ply` file, a folder of them, or a scene file (`.toml`) for its
    /// clouds and what it hides
    pub first: OsString,
    /// The cloud that they are measured to
    pub second: OsString,
    /// File to write: the points of the first cloud with their distances; .laz, .las, .copc.laz, .e57, .ply or .csv by the end of its
    /// name; a file that is there is not replaced
    #[arg(short, long, value_name = "OUT.laz")]
    pub output: Option<PathBuf>,
    /// What is measured: the distance to the nearest point, or m3c2: the distance along the normal of the first cloud, between
    /// the mean places of both in a cylinder, with its level of detection (95 %)
    #[arg(long, value_name = "nearest|m3c2", default_value = "nearest", value_parser = ["nearest", "m3c2"])]
    pub method: String,
    /// Diameter of the neighbourhood that gives a normal, for m3c2; 10 distances between neighbouring points if not given
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub normal_scale: Option<f64>,
    /// Diameter of the cylinder, for m3c2; 8 distances between neighbouring points if not given
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub cylinder_scale: Option<f64>,
    /// How far the cylinder reaches to either side, for m3c2; 10 of its diameters if not given
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub reach: Option<f64>,
    /// Standard deviation of how far the clouds are off as a whole, for m3c2: each level of detection gets 1.96 times as much
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub registration: Option<f64>,
    /// Measure one point only of those in each cube with edges of this length, the one nearest to its middle; the others in the
    /// cube get its distance, and the figures are those of the points that are measured
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub core: Option<f64>,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    /// Set a parameter, as in `--set stream.host_bytes=1GiB`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
}

/// The corners of a line, as one value of the command line.
#[derive(Clone, Debug)]
pub struct Line(pub Vec<DVec3>);

#[derive(Debug, Args)]
pub struct ListingArguments {
    /// Write JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct DoctorArguments {
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub gpu: GpuArgument,
}

/// The largest side of a picture, in pixels. Every adapter of WebGPU's class can hold 8192, common ones 16384 or more.
/// An adapter that can hold less refuses a picture later, with its own limit in the message.
pub const LARGEST_SIDE: u32 = 32_768;

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides =
        text.split_once(['x', 'X']).and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    let size = sides.ok_or("expected WIDTHxHEIGHT in pixels, as in 1280x720")?;
    if size.iter().all(|side| (1..=LARGEST_SIDE).contains(side)) {
        Ok(size)
    } else {
        Err(format!("each side must be from 1 to {LARGEST_SIDE} pixels"))
    }
}

fn parse_frames(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(start, end)| Some((start.parse().ok()?, end.parse().ok()?)));
    let (start, end) = ends.ok_or("expected the first frame and the one after the last, as in 0..300")?;
    if start < end { Ok(start..end) } else { Err("the second number must be larger than the first".into()) }
}

fn parse_time(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (0.0..=CameraPath::MOST_SECONDS).contains(seconds));
    seconds.ok_or_else(|| format!("expected seconds from 0 to {:e}, as in 2.5", CameraPath::MOST_SECONDS))
}

fn parse_shutter(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share: &f64| *share > 0.0 && *share <= 1.0);
    share.ok_or_else(|| "expected a share above 0, at most 1, as in 0.5".into())
}

fn parse_budget(text: &str) -> Result<Target, String> {
    match text.parse() {
        Ok(target @ Target::Milliseconds(_)) => Ok(target),
        _ => Err("expected a time above 0, as in 50ms or 1.5s".into()),
    }
}

fn parse_error(text: &str) -> Result<Target, String> {
    match text.parse() {
        Ok(target @ (Target::Pixels(_) | Target::DeltaE(_))) => Ok(target),
        _ => Err("expected an error above 0, as in 1px or 2dE".into()),
    }
}

fn parse_line(text: &str) -> Result<Line, String> {
    text.split(':').map(parse_place).collect::<Result<_, _>>().map(Line)
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| *share > 0.0 && *share < 1.0);
    share.ok_or_else(|| "expected a share above 0 and below 1".into())
}

fn parse_truth(text: &str) -> Result<study::Truth, String> {
    match text {
        "same_input" => Ok(study::Truth::SameInput),
        "exact" => Ok(study::Truth::Exact),
        _ => Err("expected same_input or exact".into()),
    }
}

fn parse_preset(name: &str) -> Result<&'static Preset, String> {
    Preset::named(name)
}

pub fn parse_pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
        _ => Err("expected NAME=VALUE".into()),
    }
}

/// Splits `NAME=FILE.exr`. The name is text; the path may hold any bytes, since file names need not be UTF-8.
fn parse_image(pair: OsString) -> Result<(String, PathBuf), String> {
    let bytes = pair.as_encoded_bytes();
    let at = bytes.iter().position(|byte| *byte == b'=').filter(|at| *at > 0);
    let name = at.and_then(|at| std::str::from_utf8(&bytes[..at]).ok()).map(str::to_owned);
    match (name, at) {
        (Some(name), Some(at)) => Ok((name, after(&pair, at + 1).into())),
        _ => Err("expected NAME=FILE.exr".into()),
    }
}

/// Returns the text behind its first `bytes` bytes, the last of which must be an ASCII character.
#[cfg(unix)]
fn after(text: &std::ffi::OsStr, bytes: usize) -> OsString {
    use std::os::unix::ffi::OsStrExt as _;
    std::ffi::OsStr::from_bytes(&text.as_bytes()[bytes..]).to_owned()
}

#[cfg(not(unix))]
fn after(text: &std::ffi::OsStr, bytes: usize) -> OsString {
    String::from_utf8_lossy(&text.as_encoded_bytes()[bytes..]).into_owned().into()
}

/// Shortens clap's message to one line that says what is wrong and what to do.
pub fn brief(mut error: clap::Error) -> String {
    // Escape the words that the message quotes before clap puts it together: afterwards their line breaks look like
    // clap's own, and clap has removed their escape codes.
    let escape = |(kind, value): (ContextKind, &ContextValue)| match value {
        ContextValue::String(text) => Some((kind, ContextValue::String(escaped(text).into_owned()))),
        ContextValue::Strings(texts) => {
            Some((kind, ContextValue::Strings(texts.iter().map(|text| escaped(text).into_owned()).collect())))
        }
        _ => None,
    };
    let context: Vec<_> = error.context().filter_map(escape).collect();
    for (kind, value) in context {
        error.insert(kind, value);
    }
    let word = |kind| if let Some(ContextValue::String(text)) = error.get(kind) { Some(text) } else { None };
    let [option, value] = [ContextKind::InvalidArg, ContextKind::InvalidValue].map(word);
    // Values may begin with a hyphen, as numbers do, so the next option was taken for one.
    let is_option =
        |value: &str| value.starts_with("--") || matches!(value.as_bytes(), [b'-', b'a'..=b'z' | b'A'..=b'Z']);
    if let (Some(option), Some(_)) = (option, value.filter(|value| is_option(value))) {
        return format!("a value is required for '{option}' but none was supplied; --help lists what there is");
    }
    let text = error.render().to_string();
    let mut paragraphs = text.split("\n\n").map(|lines| lines.split_whitespace().collect::<Vec<_>>().join(" "));
    let problem = paragraphs.next().unwrap_or_default();
    let problem = problem.strip_prefix("error: ").unwrap_or(&problem).to_owned();
    let tip = paragraphs.find_map(|line| line.strip_prefix("tip: ").map(str::to_owned));
    format!("{problem}; {}", tip.unwrap_or_else(|| "--help lists what there is".into()))
}

/// Quotes a word for a POSIX shell, in single quotes unless all its characters are plain.
pub fn quoted(word: &str) -> String {
    let is_plain = |character: char| character.is_ascii_alphanumeric() || "_-./=,:+@%".contains(character);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
#[path = "command_line_tests.rs"]
mod tests;
