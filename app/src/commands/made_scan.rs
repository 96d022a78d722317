//! `glint study scan`: a made scan with mirrors, in which everything is known of each point.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use cloud::{Column, PointTest, Progress};
use codec::{Added, ExportFormat, Runs};
use glam::DVec3;
use scene::five_mirrors::Variant;
use scene::tripod::{Disturbance, Measured};
use scene::{Mirror, SceneFile, shown};
use trace::Exact;
use trace::scan::{self, Echo};
use world::Input;

use crate::shared::ghost_arguments::ScanArguments;
use crate::system::failure::usage;
use crate::system::{picture_file, progress_bar, terminal};

/// The memory that writing the file may take.
const MEMORY: u64 = 1 << 30;

/// Scans a built-in scene with mirrors and writes the points with the truth of each.
///
/// # Errors
/// Bad usage, a scene that is no made scan, or the file cannot be written.
pub fn run(arguments: &ScanArguments) -> anyhow::Result<u8> {
    let ScanArguments { subject, scene, output, noise, mixed, strays, rays, seed, .. } = arguments;
    if ExportFormat::of(output).is_none() {
        let expected = "the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv, which is what will be in it";
        return Err(usage(format!("{}: {expected}", shown(output))));
    }
    picture_file::check_place(output)?;
    let request = world::resolve(&[subject]);
    let [Input::BuiltIn { variant: Variant::Tripod(tripod), .. }] = request.inputs.as_slice() else {
        return Err(usage(format!("{subject}: no made scan; `glint scenes` lists them, as in tripod/room")));
    };
    let mut mirrors = match scene {
        Some(path) => SceneFile::read(path)?.0.mirrors,
        None => tripod.mirrors(),
    };
    // The order of the surfaces of `Exact::of_mirrors`.
    mirrors.sort_by_key(|mirror| !mirror.shape.has_formula());
    let stations = if arguments.station.is_empty() { tripod.stations() } else { arguments.station.clone() };
    let disturbance = Disturbance { noise: *noise, mixed: *mixed, strays: *strays };
    let exact = Exact::of_mirrors(&mirrors).with_solids(tripod.solids());
    let scan = |(number, station): (usize, &DVec3)| {
        scan::scan(&exact, &disturbance, *station, f64::from(*rays), *seed, number)
    };
    let scans: Vec<Vec<Measured<Echo>>> = stations.iter().enumerate().map(scan).collect();
    if scans.iter().any(Vec::is_empty) {
        return Err(usage("a station measures nothing: is it inside of a wall?"));
    }
    let temporary = output.with_file_name(format!(".{}.scans.ptx", name_of(output)));
    let written = write_ptx(&temporary, &stations, &scans)
        .with_context(|| shown(&temporary))
        .and_then(|()| export(&temporary, output, &scans));
    // What is left of it does no harm.
    let _ = std::fs::remove_file(&temporary);
    let points = written?;
    let ghosts = scans.iter().flatten().filter(|point| point.met.is_ghost()).count();
    let of = |mirror: &Mirror| format!("{} {}", mirror.shape.name(), mirror.name);
    let names: Vec<String> = mirrors.iter().map(of).collect();
    if arguments.json {
        let stations: Vec<[f64; 3]> = stations.iter().map(|station| station.to_array()).collect();
        let report = serde_json::json!({
            "path": shown(output), "points": points, "ghosts": ghosts, "stations": stations, "mirrors": names,
        });
        return terminal::print_json(&report).map(|()| 0);
    }
    let places: Vec<String> = stations.iter().map(|place| format!("{},{},{}", place.x, place.y, place.z)).collect();
    terminal::print([
        format!("{}: {points} points, {ghosts} of them ghosts in {}", shown(output), names.join(", ")),
        format!("  stations  {}", places.join("  ")),
    ])?;
    Ok(0)
}

pub fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Writes scans with the places of their stations, one row of the scanner's grid each.
fn write_ptx(path: &Path, stations: &[DVec3], scans: &[Vec<Measured<Echo>>]) -> std::io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    for (station, points) in stations.iter().zip(scans) {
        let DVec3 { x, y, z } = *station;
        write!(out, "{}\n1\n{x} {y} {z}\n1 0 0\n0 1 0\n0 0 1\n", points.len())?;
        write!(out, "1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} {z} 1\n")?;
        for Measured { direction, range, met, .. } in points {
            let DVec3 { x, y, z } = *direction * *range;
            let [red, green, blue] = met.albedo.to_array().map(|value| (value.powf(1.0 / 2.2) * 255.0).round());
            // A point of the strength of a white wall at 1 m has the intensity 1.
            let intensity = met.strength.sqrt().min(1.0);
            writeln!(out, "{x:.6} {y:.6} {z:.6} {intensity:.4} {red} {green} {blue}")?;
        }
    }
    out.flush()
}

/// Writes the points of the scans with what is true of each: whether it is a ghost (2: neither, as the range is of no
/// one surface), the number of the first mirror, and the place that sent the light back.
fn export(scans_path: &Path, output: &Path, scans: &[Vec<Measured<Echo>>]) -> anyhow::Result<u64> {
    let sources: Vec<Arc<codec::Source>> = codec::open_scans(scans_path, MEMORY)?.into_iter().map(Arc::new).collect();
    let column = |name: &str, value: &dyn Fn(&Measured<Echo>) -> f64| {
        let runs = scans.iter().map(|points| {
            let values = Column::F64(points.iter().map(value).collect());
            Runs::from(BTreeMap::from([(0, Arc::new(values))]))
        });
        Added::new(name.to_owned(), runs.collect())
    };
    let added = [
        column("true_ghost", &|point| match point.is_whole {
            true => f64::from(u8::from(point.met.is_ghost())),
            false => 2.0,
        }),
        column("true_mirror", &|point| f64::from(point.met.mirrors[0])),
        column("true_x", &|point| point.met.place.x),
        column("true_y", &|point| point.met.place.y),
        column("true_z", &|point| point.met.place.z),
    ];
    let (test, progress) = (PointTest::default(), Progress::default());
    let write = || codec::export(&sources, &test, &added, output, MEMORY, &progress);
    let written = progress_bar::watch("writing", &progress, write)?.ok_or(stream::Error::Cancelled)?;
    Ok(written.points)
}
