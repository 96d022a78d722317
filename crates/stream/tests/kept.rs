//! Normals and radii that are kept of files in memory come back as they were, or not at all.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use cloud::{Chunk, Orientation, Progress, SurfelOptions, Surfels};
use codec::{Selection, Source};
use glam::Vec3;
use proptest::prelude::*;
use stream::{BuildOptions, Cache, Error, KeptSurfels, SurfelPlace, build};

mod made_up;
use made_up::{terrain, write_las};

const LIMIT: u64 = 1 << 30;

struct Set {
    folder: tempfile::TempDir,
    cache: Cache,
}

impl Set {
    fn new(limit: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().join("cache"), limit);
        Self { folder, cache }
    }

    fn file(&self, name: &str, points: usize) -> Arc<Source> {
        let path = self.folder.path().join(name);
        write_las(&path, &terrain(points));
        Arc::new(codec::open(&path).unwrap())
    }

    fn place(&self, file: &Arc<Source>, estimate: &str) -> SurfelPlace {
        SurfelPlace::new(&self.cache, file, estimate.into()).unwrap()
    }

    /// The files of the cache that hold normals and radii.
    fn kept(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(self.cache.folder()).unwrap().flatten();
        entries.map(|entry| entry.path().join("kept")).filter(|path| path.exists()).collect()
    }
}

fn chunks(file: &Source) -> Vec<Chunk> {
    let chunks = Mutex::new(Vec::new());
    let positions = Selection { positions: true, ..Selection::default() };
    file.read(&positions, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    chunks
}

/// Any values: what is kept does not depend on what they mean.
fn any_surfels(chunks: &[Chunk], seed: u32) -> Vec<Surfels> {
    let value = |index: usize| (index as u32).wrapping_mul(2_654_435_761) ^ seed;
    let of = |chunk: &Chunk| Surfels {
        normals: (0..chunk.len()).map(value).collect(),
        radii: (0..chunk.len()).map(|index| value(index) as u16).collect(),
    };
    chunks.iter().map(of).collect()
}

fn all_of(kept: &KeptSurfels, chunks: &[Chunk]) -> Result<Vec<Surfels>, Error> {
    chunks.iter().map(|chunk| kept.of(chunk)).collect()
}

fn flip(path: &Path, at: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    bytes[at] ^= 4;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn an_estimate_comes_back_to_the_bit() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 150_000);
    let chunks = chunks(&file);
    let surfels = cloud::estimate(&chunks, &SurfelOptions::new(Orientation::Up(Vec3::Z)), &Progress::default());
    let place = set.place(&file, "16");
    assert!(place.open().unwrap().is_none());
    place.keep(&chunks, surfels.as_ref().unwrap()).unwrap();
    let kept = place.open().unwrap().unwrap();
    assert_eq!((kept.points(), chunks.len()), (150_000, 3));
    assert_eq!(all_of(&kept, &chunks).ok(), surfels);
    let other_limits = Chunk { first_point: 1, ..chunks[0].clone() };
    assert!(matches!(kept.of(&other_limits), Err(Error::Damaged { .. })));
    assert!(matches!(kept.of(&chunks[0].select(&[0, 1])), Err(Error::Damaged { .. })));
}

#[test]
fn another_file_or_another_estimate_gets_nothing() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 1000);
    let chunks_before = chunks(&file);
    set.place(&file, "16").keep(&chunks_before, &any_surfels(&chunks_before, 1)).unwrap();
    assert!(set.place(&file, "17").open().unwrap().is_none());
    assert!(set.place(&set.file("b.las", 1000), "16").open().unwrap().is_none());
    // The later estimate of a file takes the place of the earlier one.
    set.place(&file, "17").keep(&chunks_before, &any_surfels(&chunks_before, 2)).unwrap();
    assert!(set.place(&file, "16").open().unwrap().is_none());
    let kept = set.place(&file, "17").open().unwrap().unwrap();
    assert_eq!(all_of(&kept, &chunks_before).unwrap(), any_surfels(&chunks_before, 2));
    drop(kept);
    assert_eq!(set.kept().len(), 1);
    // A file that changes between reading and keeping.
    let place = set.place(&file, "18");
    let changed = set.file("a.las", 1001);
    assert!(matches!(place.keep(&chunks_before, &any_surfels(&chunks_before, 3)), Err(Error::Changed { .. })));
    assert!(set.place(&changed, "17").open().unwrap().is_none());
}

#[test]
fn nothing_wrong_comes_of_a_damaged_file() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 70_000);
    let (chunks, place) = (chunks(&file), set.place(&file, "an estimate"));
    let surfels = any_surfels(&chunks, 1);
    place.keep(&chunks, &surfels).unwrap();
    let path = set.kept().remove(0);
    let whole = std::fs::read(&path).unwrap();
    let head = whole.len() - 6 * 70_000;
    for at in (0..head).chain((head..whole.len()).step_by(7919)) {
        flip(&path, at);
        let outcome = place.open().and_then(|kept| kept.map(|kept| all_of(&kept, &chunks)).transpose());
        // Other versions of the program count as nothing, not as damage.
        let is_refused = matches!(&outcome, Err(Error::Damaged { .. })) || (8..12).contains(&at) && outcome.is_ok();
        assert!(is_refused && !matches!(outcome, Ok(Some(_))), "byte {at} changed");
        std::fs::write(&path, &whole).unwrap();
    }
    for length in (0..head).chain([head, whole.len() - 1]) {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(matches!(place.open(), Err(Error::Damaged { .. })), "cut to {length} bytes");
    }
    std::fs::write(&path, [&whole[..], &[0]].concat()).unwrap();
    assert!(matches!(place.open(), Err(Error::Damaged { .. })), "a byte too many");
    // A damaged entry is made anew.
    place.keep(&chunks, &surfels).unwrap();
    assert_eq!(all_of(&place.open().unwrap().unwrap(), &chunks).unwrap(), surfels);
}

#[cfg(unix)]
#[test]
fn a_link_in_its_place_is_not_followed() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 1000);
    let (chunks, place) = (chunks(&file), set.place(&file, ""));
    place.keep(&chunks, &any_surfels(&chunks, 1)).unwrap();
    let path = set.kept().remove(0);
    let elsewhere = set.folder.path().join("elsewhere");
    std::fs::rename(&path, &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &path).unwrap();
    assert!(matches!(place.open(), Err(Error::Damaged { .. })));
    place.keep(&chunks, &any_surfels(&chunks, 2)).unwrap();
    assert_eq!(all_of(&place.open().unwrap().unwrap(), &chunks).unwrap(), any_surfels(&chunks, 2));
    assert!(elsewhere.exists());
}

#[test]
fn the_cache_bounds_them_and_clears_the_longest_unused() {
    let bytes = 6 * 10_000;
    let set = Set::new(2 * bytes + 2000);
    let files = ["a.las", "b.las", "c.las"].map(|name| set.file(name, 10_000));
    let chunks: Vec<Vec<Chunk>> = files.iter().map(|file| chunks(file)).collect();
    let keep = |index: usize| {
        set.place(&files[index], "").keep(&chunks[index], &any_surfels(&chunks[index], index as u32)).unwrap();
        // Two uses at one time would have no order.
        std::thread::sleep(std::time::Duration::from_millis(20));
    };
    let are_kept = || [0, 1, 2].map(|index| set.place(&files[index], "").open().unwrap().is_some());
    keep(0);
    keep(1);
    assert!(set.cache.size() <= 2 * bytes + 2000);
    let used_again = set.place(&files[0], "").open().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(20));
    drop(used_again);
    keep(2);
    assert_eq!(are_kept(), [true, false, true]);
    let too_many =
        Set { cache: Cache::new(set.cache.folder().to_owned(), bytes), folder: tempfile::tempdir().unwrap() };
    let place = too_many.place(&files[1], "");
    place.keep(&chunks[1], &any_surfels(&chunks[1], 1)).unwrap();
    assert!(place.open().unwrap().is_none(), "there is no room for it");
}

#[test]
fn an_index_and_what_is_kept_of_the_same_file_lie_side_by_side() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 30_000);
    let (chunks, place) = (chunks(&file), set.place(&file, ""));
    place.keep(&chunks, &any_surfels(&chunks, 1)).unwrap();
    // Making an index clears what builders that were killed have left.
    let inputs = [file];
    build(&inputs, &set.cache, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    assert!(set.cache.open(&inputs).unwrap().is_some() && place.open().unwrap().is_some());
    set.cache.clear();
    assert!(set.cache.open(&inputs).unwrap().is_none() && place.open().unwrap().is_none());
    assert_eq!(set.cache.size(), 0);
}

#[test]
fn what_is_open_is_neither_cleared_nor_replaced() {
    let set = Set::new(LIMIT);
    let file = set.file("a.las", 1000);
    let (chunks, place) = (chunks(&file), set.place(&file, ""));
    place.keep(&chunks, &any_surfels(&chunks, 1)).unwrap();
    let open = place.open().unwrap().unwrap();
    set.cache.clear();
    place.keep(&chunks, &any_surfels(&chunks, 2)).unwrap();
    assert_eq!(all_of(&open, &chunks).unwrap(), any_surfels(&chunks, 1));
    drop(open);
    assert_eq!(all_of(&place.open().unwrap().unwrap(), &chunks).unwrap(), any_surfels(&chunks, 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_chunks_come_back(lengths in prop::collection::vec(0_usize..300, 0..20), seed: u32, estimate in ".{0,40}") {
        let set = Set::new(LIMIT);
        let mut first_point = 0;
        let mut chunk = |length: usize| {
            let chunk = Chunk::new(first_point, glam::DVec3::ZERO, vec![[0.0; 3]; length]);
            first_point += length.max(1) as u64;
            chunk
        };
        let chunks: Vec<Chunk> = lengths.into_iter().map(&mut chunk).collect();
        let place = set.place(&set.file("a.las", 10), &estimate);
        let surfels = any_surfels(&chunks, seed);
        place.keep(&chunks, &surfels).unwrap();
        prop_assert_eq!(all_of(&place.open().unwrap().unwrap(), &chunks).unwrap(), surfels);
    }
}
