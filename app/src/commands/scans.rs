//! Reads scans in memory, to judge the surfaces that are made of them.

use std::path::Path;

use cloud::{Cloud, PointTest, Progress};
use glam::DVec3;
use scene::{Settings, five_mirrors, shown};
use study::Scan;
use world::Input;

use crate::system::failure::usage;
use crate::system::{progress_bar, terminal};

/// A scan, and the number of its points that cannot be read.
pub type Found = anyhow::Result<(Scan, u64)>;

/// The attributes that tell where a scan was taken from.
const OF_SCANNER: [&str; 2] = ["return_number", "gps_time"];

/// The memory in bytes that a point takes while its surface is made: most of it for the tree of discs.
const BYTES_A_POINT: u64 = 400;

/// The scans of an input with their names: a file each, or a built-in scene. A made scan is seen from its stations,
/// which see no mirrors, and any other scene from its camera.
///
/// # Errors
/// If one cannot be read or is larger than the memory that clouds may take.
pub fn of_input(input: &Input, test: &PointTest, settings: &Settings) -> Vec<(String, Found)> {
    match input {
        Input::File(_) | Input::Tiles { .. } => {
            input.files().iter().flat_map(|path| of_file(path, test, settings)).collect()
        }
        Input::BuiltIn { variant, .. } => {
            let scene::SceneSettings { points, seed } = settings.scene;
            let mut cloud = Cloud { name: input.name(), ..Cloud::default() };
            let camera = variant.camera();
            let (places, sees_mirrors) = match variant {
                five_mirrors::Variant::Tripod(scan) => (scan.stations(), false),
                _ => (vec![camera.eye], true),
            };
            let parts = five_mirrors::sample(*variant, points.into(), seed.into()).into_iter();
            let seen = parts.filter(|part| sees_mirrors || part.mirror.is_none());
            cloud.chunks.extend(seen.flat_map(|part| part.chunks));
            vec![(input.name(), Ok((Scan { cloud, up: camera.up, places }, 0)))]
        }
        Input::Unknown { name, error } => vec![(name.clone(), Err(usage(error.clone())))],
    }
}

fn of_file(path: &Path, test: &PointTest, settings: &Settings) -> Vec<(String, Found)> {
    let sources = match world::open_file(path, world::half_of(settings.stream.host_bytes)) {
        Ok(sources) => sources,
        Err(error) => return vec![(shown(path), Err(usage(error)))],
    };
    let name = |info: &codec::Info| match &info.scan {
        Some(scan) if scan.of > 1 => format!("{}, {}", shown(path), scan.name),
        _ => shown(path),
    };
    let lost = world::lost_tiles(&sources).map(|error| (shown(path), Err(usage(error.clone()))));
    lost.chain(sources.iter().map(|source| (name(source.info()), of_source(source, test, settings)))).collect()
}

fn of_source(source: &codec::Source, test: &PointTest, settings: &Settings) -> Found {
    let info = source.info();
    let path = &info.path;
    let (points, most) = (info.points, settings.stream.host_bytes.0 / BYTES_A_POINT);
    if points > most {
        return Err(usage(format!(
            "{}: {points} points, at most {most} fit into stream.host_bytes = {}; raise it, or take a part of the scan",
            shown(path),
            settings.stream.host_bytes
        )));
    }
    let progress = Progress::default();
    let attributes: Vec<&str> = OF_SCANNER.into_iter().chain(test.filtered()).collect();
    let read = || world::read_cloud(source, &attributes, settings, &progress);
    let (cloud, summary) = progress_bar::watch("reading", &progress, read)?;
    crate::system::interrupt::check()?;
    let of_points = summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(path)));
    terminal::warn(world::file_warnings(info).chain(of_points));
    if cloud.chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|at| chunk.position(at))).all(|at| !at.is_finite()) {
        return Err(usage(format!("{}: no points in it", shown(path))));
    }
    let up: DVec3 = world::up_of(info, settings);
    let places = info.scanner().into_iter().collect();
    Ok((Scan { cloud: cloud.shown(test), up, places }, info.missing.saturating_add(summary.missing)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_made_scan_is_seen_from_its_stations_which_see_no_mirrors() {
        let variant = five_mirrors::Variant::Tripod(scene::Tripod::Mixed);
        let mut settings = Settings::default();
        settings.scene.points = 2000;
        let input = Input::BuiltIn { variant, without: Vec::new() };
        let (_, scan) = of_input(&input, &PointTest::default(), &settings).remove(0);
        let (scan, _) = scan.unwrap();
        assert_eq!((scan.places.len(), scan.up), (2, DVec3::Z));
        // A mirror has 20,000 points at least.
        assert!((1500..2500).contains(&scan.cloud.len()), "{}", scan.cloud.len());
    }
}
