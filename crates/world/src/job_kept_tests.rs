//! Tests that a file held in memory gets its normals and radii from the cache when it is opened again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cloud::Surfels;

use super::*;

const POINTS: u32 = 500_000;

/// A wavy square as binary PLY, with points in an order that mixes all places.
fn write_waves(path: &Path, height: f32) {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    )
    .into_bytes();
    for index in 0..POINTS {
        let [x, y] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract() as f32);
        file.extend([x, y, height * (9.0 * x).sin()].iter().flat_map(|value| value.to_le_bytes()));
    }
    std::fs::write(path, file).unwrap();
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Received {
    /// The normals and radii of all chunks by their first points.
    surfels: BTreeMap<u64, Surfels>,
    /// Whether they had to be estimated.
    is_estimated: bool,
    warnings: Vec<String>,
}

fn open(path: &Path, cache: &Path, settings: &Settings) -> Received {
    let cache = Ok(Cache::new(cache.to_owned(), 1 << 30));
    let job = start_with(vec![Input::File(path.to_owned())], settings, BTreeSet::new(), true, cache);
    let mut received = Received::default();
    for event in &job.events {
        match event {
            Event::Chunk { chunk, .. } => {
                let surfels = chunk
                    .normals
                    .zip(chunk.radii)
                    .map(|(normals, radii)| Surfels { normals: normals.to_vec(), radii: radii.to_vec() });
                let none = Surfels { normals: Vec::new(), radii: Vec::new() };
                received.surfels.insert(chunk.first_point, surfels.unwrap_or(none));
            }
            Event::Surfels { surfels, .. } => {
                received.is_estimated = true;
                received.surfels.values_mut().zip(surfels).for_each(|(of_chunk, surfels)| *of_chunk = surfels);
            }
            Event::Read { summary, .. } => received.warnings.extend(summary.warnings),
            Event::Failed { error, .. } => panic!("{error}"),
            _ => {}
        }
    }
    received
}

fn kept_files(cache: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(cache).into_iter().flatten().flatten();
    entries.map(|entry| entry.path().join("kept")).filter(|path| path.exists()).collect()
}

#[test]
fn normals_and_radii_are_estimated_once_for_each_file_and_setting() {
    let folder = tempfile::tempdir().unwrap();
    let (path, cache) = (folder.path().join("waves.ply"), folder.path().join("cache"));
    let settings = Settings::default();
    write_waves(&path, 0.05);
    let first = open(&path, &cache, &settings);
    assert!(first.is_estimated && first.warnings.is_empty());
    assert_eq!(first.surfels.values().map(|surfels| surfels.radii.len()).sum::<usize>(), POINTS as usize);
    let again = open(&path, &cache, &settings);
    assert_eq!(again, Received { is_estimated: false, ..first });

    let mut other = settings.clone();
    other.surface.neighbours = 8;
    let others = open(&path, &cache, &other);
    assert!(others.is_estimated && others.surfels != again.surfels);
    let mut turned = other.clone();
    turned.surface.orientation = scene::SurfaceOrientation::Inward;
    assert!(open(&path, &cache, &turned).is_estimated);
    turned.surface.radii = scene::SurfaceRadii::Narrow;
    assert!(open(&path, &cache, &turned).is_estimated);
    turned.surface.carve = false;
    assert!(open(&path, &cache, &turned).is_estimated);
    turned.view.up = scene::UpAxis::Y;
    assert!(open(&path, &cache, &turned).is_estimated);
    assert!(!open(&path, &cache, &turned).is_estimated);

    write_waves(&path, 0.06);
    let changed = open(&path, &cache, &turned);
    assert!(changed.is_estimated && changed.warnings.is_empty());
}

#[test]
fn damaged_normals_and_radii_are_told_and_estimated_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (path, cache) = (folder.path().join("waves.ply"), folder.path().join("cache"));
    let settings = Settings::default();
    write_waves(&path, 0.05);
    let whole = open(&path, &cache, &settings);
    let kept = kept_files(&cache).remove(0);
    let bytes = std::fs::read(&kept).unwrap();
    // In the table; in the data of a chunk in the middle, which is found when the others are on their way.
    for at in [100, bytes.len() / 2] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        std::fs::write(&kept, &damaged).unwrap();
        let received = open(&path, &cache, &settings);
        assert_eq!((received.is_estimated, received.warnings.len()), (true, 1), "byte {at}");
        assert!(received.warnings[0].contains("damaged"), "{}", received.warnings[0]);
        assert!(received.surfels == whole.surfels, "byte {at}: other normals and radii");
        assert_eq!(open(&path, &cache, &settings), Received { is_estimated: false, ..whole.clone() });
    }
}

#[test]
fn small_files_and_stopped_estimates_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (path, cache) = (folder.path().join("waves.ply"), folder.path().join("cache"));
    write_waves(&path, 0.05);
    let job = start_with(
        vec![Input::File(path.clone())],
        &Settings::default(),
        BTreeSet::new(),
        true,
        Ok(Cache::new(cache.clone(), 1 << 30)),
    );
    job.mailbox.stop_all();
    assert!(job.events.iter().all(|event| !matches!(event, Event::Surfels { .. })));
    std::fs::write(
        &path,
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n",
    )
    .unwrap();
    assert!(open(&path, &cache, &Settings::default()).is_estimated);
    assert!(kept_files(&cache).is_empty());
}
