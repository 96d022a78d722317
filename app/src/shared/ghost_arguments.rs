//! What the command line says of ghosts and of scans that are made to have some.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use crate::shared::command_line::parse_pair;
use crate::shared::numbers::{parse_place, parse_seed};

#[derive(Debug, Args)]
pub struct GhostsArguments {
    /// Files of points (.las, .laz, .e57, .ply, .pts, .ptx, .pcd, .xyz, .csv, .txt), folders of them, - for standard input, or a scene file (`.toml`) for its clouds and mirrors
    #[arg(required = true)]
    pub inputs: Vec<OsString>,
    /// Scene file with the mirrors; a mirror with `refraction` is a pane, through which points are seen. Without mirrors, they are
    /// looked for
    #[arg(long, value_name = "FILE.toml")]
    pub scene: Option<PathBuf>,
    /// A place of the scanner, in the coordinates of the file; those that the files give if not given
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_place, allow_hyphen_values = true)]
    pub station: Vec<DVec3>,
    /// File to write: all points in their order with `ghost` (0 real, 1 ghost, 2 undecided) and `ghost_mirror` (the number of the
    /// mirror); .laz, .las, .copc.laz, .e57, .ply or .csv by the end of its name; a file that is there is not replaced
    #[arg(short, long, value_name = "OUT.laz")]
    pub output: Option<PathBuf>,
    /// Add each ghost again after all points, at the place that the scanner saw in the mirror, with `ghost` 0, the number of the
    /// mirror, and `ghost_error`: how far it may be off in 95 of 100 cases
    #[arg(long)]
    pub put_back: bool,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
    /// Set a parameter, as in `--set stream.host_bytes=1GiB`; `glint methods` lists them
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_pair)]
    pub set: Vec<(String, String)>,
}

#[derive(Debug, Args)]
pub struct ScanArguments {
    /// The made scan whose surfaces are scanned (`tripod/room`); `glint scenes` lists them
    #[arg(value_name = "NAME", default_value = "tripod/room")]
    pub subject: String,
    /// Scene file with the mirrors; those of the made scan if not given. A mirror with `refraction` is a pane, which lets through
    /// what it does not reflect
    #[arg(long, value_name = "FILE.toml")]
    pub scene: Option<PathBuf>,
    /// A place of the scanner; those of the made scan if not given
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_place, allow_hyphen_values = true)]
    pub station: Vec<DVec3>,
    /// File to write, by the end of its name: .laz, .las, .copc.laz, .e57 (with the places of the scanner), .ply or .csv; a file
    /// that is there is not replaced
    #[arg(short, long, value_name = "OUT.laz")]
    pub output: PathBuf,
    /// Standard deviation of ranges, metres
    #[arg(long, value_name = "LENGTH", default_value = "0.002", allow_negative_numbers = true, value_parser = parse_noise)]
    pub noise: f64,
    /// Share of the rays that are mixed pixels, split by an edge
    #[arg(long, value_name = "SHARE", default_value = "0.001", allow_negative_numbers = true, value_parser = parse_part)]
    pub mixed: f64,
    /// Share of the rays that measure nothing that is there
    #[arg(long, value_name = "SHARE", default_value = "0", allow_negative_numbers = true, value_parser = parse_part)]
    pub strays: f64,
    /// Rays of each station
    #[arg(long, value_name = "N", default_value = "1350000", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    pub rays: u32,
    /// Seed of the noise and all other draws
    #[arg(long, value_name = "N", default_value = "1", allow_negative_numbers = true, value_parser = parse_seed)]
    pub seed: u64,
    /// Write JSON
    #[arg(long)]
    pub json: bool,
}

fn parse_noise(text: &str) -> Result<f64, String> {
    let noise = text.parse().ok().filter(|noise: &f64| noise.is_finite() && *noise >= 0.0);
    noise.ok_or_else(|| "expected a length of at least 0, as in 0.002".into())
}

fn parse_part(text: &str) -> Result<f64, String> {
    let part = text.parse().ok().filter(|part: &f64| (0.0..=1.0).contains(part));
    part.ok_or_else(|| "expected a share from 0 to 1".into())
}
