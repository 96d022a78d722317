//! Faults are reported, leave nothing behind, and never leave a wrong index.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use cloud::{Orientation, Progress, SurfelOptions};
use codec::Source;
use glam::Vec3;
use stream::{BuildOptions, Cache, Error, NodeId, Pages, Previewed, Result, build, estimate_surfels};

mod made_up;
use made_up::{Point, terrain, write_las};

const OPTIONS: BuildOptions = BuildOptions { memory: 1 << 20, preview_points: 10_000 };

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

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn cloud(&self, name: &str, count: usize) -> Arc<Source> {
        write_las(&self.path(name), &terrain(count));
        Arc::new(codec::open(&self.path(name)).unwrap())
    }

    fn build(&self, inputs: &[Arc<Source>]) -> Result<Pages> {
        build(inputs, &self.cache, &OPTIONS, &Progress::default(), &|_| ())
    }

    /// The folders of indexes, whole or not.
    fn entries(&self) -> Vec<PathBuf> {
        let Ok(folder) = std::fs::read_dir(self.cache.folder()) else { return Vec::new() };
        folder.flatten().map(|item| item.path()).filter(|path| path.is_dir()).collect()
    }
}

fn points(pages: &Pages) -> u64 {
    pages.octree().ids().map(|(id, _)| pages.read(id).unwrap().len() as u64).sum()
}

fn flip(path: &Path, at: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    bytes[at] ^= 4;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn an_index_is_made_once() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 100_000)];
    assert!(set.cache.open(&inputs).unwrap().is_none());
    assert_eq!(points(&set.build(&inputs).unwrap()), 100_000);
    let progress = Progress::default();
    let again = build(&inputs, &set.cache, &OPTIONS, &progress, &|_| panic!("read again")).unwrap();
    assert_eq!((again.octree().points(), progress.done()), (100_000, 0));
    assert!(set.cache.open(&inputs).unwrap().is_some());
    // Not when the file is another one.
    let other = [set.cloud("a.las", 100_001)];
    assert!(set.cache.open(&other).unwrap().is_none());
    assert_eq!(points(&set.build(&other).unwrap()), 100_001);
    assert_eq!(set.entries().len(), 2);
    let names: Vec<_> = std::fs::read_dir(again.folder()).unwrap().flatten().map(|item| item.file_name()).collect();
    assert_eq!(names.len(), 3, "pages, nodes and the marker, nothing else: {names:?}");
}

#[test]
fn a_damaged_page_is_told() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 100_000)];
    let pages = set.build(&inputs).unwrap();
    let count = pages.octree().nodes.len();
    let path = pages.folder().join("pages");
    let length = std::fs::metadata(&path).unwrap().len() as usize;
    flip(&path, length / 2);
    let damaged: Vec<String> = (0..count as u32)
        .filter_map(|id| match pages.read(NodeId(id)) {
            Err(Error::Damaged { problem, .. }) => Some(problem),
            Err(error) => panic!("{error}"),
            Ok(_) => None,
        })
        .collect();
    assert_eq!(damaged.len(), 1, "{damaged:?}");
}

#[test]
fn damaged_tables_are_told_and_made_again() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 60_000)];
    let entry = set.build(&inputs).unwrap().folder().to_owned();
    let (nodes, pages) = (entry.join("nodes"), entry.join("pages"));
    let whole = std::fs::read(&nodes).unwrap();
    let all_pages = std::fs::read(&pages).unwrap();
    let told = |what: &str| match Pages::open(&entry) {
        Err(Error::Damaged { problem, .. }) => problem,
        Err(error) => panic!("{what}: {error}"),
        Ok(_) => panic!("{what}: opened"),
    };
    for at in 0..whole.len() {
        flip(&nodes, at);
        told(&format!("byte {at} changed"));
        std::fs::write(&nodes, &whole).unwrap();
    }
    for length in 0..whole.len() {
        std::fs::write(&nodes, &whole[..length]).unwrap();
        told(&format!("cut to {length} bytes"));
    }
    let mut other_version = whole.clone();
    other_version[8] += 1;
    std::fs::write(&nodes, &other_version).unwrap();
    assert!(told("another version").contains("version"));
    std::fs::write(&nodes, &whole).unwrap();
    std::fs::write(&pages, &all_pages[..all_pages.len() - 1]).unwrap();
    assert!(told("pages cut short").contains("outside"));
    assert!(set.cache.open(&inputs).unwrap().is_none());
    assert_eq!(points(&set.build(&inputs).unwrap()), 60_000);
}

#[test]
fn a_killed_builder_is_cleared_up_after() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 60_000)];
    let entry = set.build(&inputs).unwrap().folder().to_owned();
    std::fs::remove_file(entry.join("nodes")).unwrap();
    std::fs::create_dir(entry.join("building")).unwrap();
    std::fs::write(entry.join("building/records"), "half a record").unwrap();
    std::fs::write(entry.join("building/pages"), "half a page").unwrap();
    let pages = set.build(&inputs).unwrap();
    assert_eq!(points(&pages), 60_000);
    assert!(!entry.join("building").exists());
}

/// Runs a build during which `happens` is called once.
fn disturbed(set: &Set, inputs: &[Arc<Source>], progress: &Progress, happens: impl Fn() + Sync) -> Result<Pages> {
    let calls = AtomicU64::new(0);
    let once = |_: Previewed| {
        if calls.fetch_add(1, Ordering::Relaxed) == 0 {
            happens();
        }
    };
    build(inputs, &set.cache, &OPTIONS, progress, &once)
}

#[test]
fn a_file_that_changes_meanwhile_leaves_no_index() {
    let set = Set::new(u64::MAX);
    let path = set.path("a.las");
    let open = || std::fs::File::options().append(true).open(&path).unwrap();
    let inputs = [set.cloud("a.las", 300_000)];
    let cut = || open().set_len(1_000_000).unwrap();
    let grown = || std::io::Write::write_all(&mut open(), b"more").unwrap();
    let removed = || std::fs::remove_file(&path).unwrap();
    for change in [&grown as &(dyn Fn() + Sync), &cut, &removed] {
        let inputs = if path.exists() { [set.cloud("a.las", 300_000)] } else { inputs.clone() };
        let error = disturbed(&set, &inputs, &Progress::default(), change).err().unwrap();
        assert!(matches!(&error, Error::Changed { path: changed } if *changed == path), "{error}");
        assert!(set.entries().is_empty());
    }
}

#[test]
fn a_cancelled_build_leaves_nothing() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 300_000)];
    let progress = Progress::default();
    let error = disturbed(&set, &inputs, &progress, || progress.cancel()).err().unwrap();
    assert!(matches!(error, Error::Cancelled), "{error}");
    assert!(set.entries().is_empty());
    // While nodes are made, too.
    let progress = Progress::default();
    let built = std::thread::scope(|scope| {
        let builder = scope.spawn(|| build(&inputs, &set.cache, &OPTIONS, &progress, &|_| ()));
        while progress.done() <= 300_000 && !builder.is_finished() {
            std::hint::spin_loop();
        }
        progress.cancel();
        builder.join().unwrap()
    });
    match built {
        Err(Error::Cancelled) => assert!(set.entries().is_empty()),
        Err(error) => panic!("{error}"),
        // The build was faster than the cancel.
        Ok(pages) => assert_eq!(points(&pages), 300_000),
    }
}

#[test]
fn a_file_that_cannot_be_read_is_left_out() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 50_000), set.cloud("bad.las", 50_000), set.cloud("b.las", 60_000)];
    // Only its header is left.
    std::fs::File::options().write(true).open(set.path("bad.las")).unwrap().set_len(227).unwrap();
    let pages = set.build(&inputs).unwrap();
    assert_eq!(points(&pages), 110_000);
    assert!(pages.warnings().iter().any(|warning| warning.contains("bad.las")), "{:?}", pages.warnings());
    let error = set.build(&inputs[1..2]).err().unwrap();
    assert!(matches!(error, Error::Input(_)) && error.to_string().contains("bad.las"), "{error}");
    assert_eq!(set.entries().len(), 1);
}

#[test]
fn a_file_without_points_is_an_error() {
    let set = Set::new(u64::MAX);
    write_las(&set.path("none.las"), &[]);
    let none = Arc::new(codec::open(&set.path("none.las")).unwrap());
    let error = set.build(std::slice::from_ref(&none)).err().unwrap();
    assert!(matches!(error, Error::Empty { .. }), "{error}");
    assert!(set.entries().is_empty());
    write_las(&set.path("one.las"), &[Point::default()]);
    let one = Arc::new(codec::open(&set.path("one.las")).unwrap());
    assert_eq!(points(&set.build(&[none, one]).unwrap()), 1);
}

#[test]
fn two_builders_make_one_index() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 300_000)];
    let read = AtomicU64::new(0);
    let count = |change: Previewed| {
        if let Previewed::Share(chunk) = change {
            read.fetch_add(chunk.len() as u64, Ordering::Relaxed);
        }
    };
    let options = BuildOptions { memory: 1 << 20, preview_points: u64::MAX };
    let run = || build(&inputs, &set.cache, &options, &Progress::default(), &count).unwrap();
    let both = std::thread::scope(|scope| [scope.spawn(run), scope.spawn(run)].map(|thread| thread.join().unwrap()));
    assert_eq!(both[0].octree(), both[1].octree());
    assert_eq!(both.iter().map(points).collect::<Vec<_>>(), [300_000; 2]);
    assert_eq!((read.into_inner(), set.entries().len()), (300_000, 1), "read once");
}

#[test]
fn waiting_for_another_builder_can_be_cancelled() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 10_000)];
    let entry = set.build(&inputs).unwrap().folder().to_owned();
    let lock = std::fs::File::open(entry.with_extension("lock")).unwrap();
    lock.lock().unwrap();
    let progress = Progress::default();
    let waited = std::thread::scope(|scope| {
        let builder = scope.spawn(|| build(&inputs, &set.cache, &OPTIONS, &progress, &|_| ()));
        std::thread::sleep(Duration::from_millis(100));
        assert!(!builder.is_finished());
        progress.cancel();
        builder.join().unwrap()
    });
    assert!(matches!(waited, Err(Error::Cancelled)));
    assert!(entry.exists(), "what another has locked stays");
}

#[test]
fn the_least_recently_opened_goes_first_but_never_what_is_open() {
    let set = Set::new(3_000_000);
    let names = ["a.las", "b.las", "c.las", "d.las"];
    let inputs = names.map(|name| [set.cloud(name, 70_000)]);
    let size = |pages: &Pages| std::fs::read_dir(pages.folder()).unwrap().map(|f| f.unwrap().metadata().unwrap().len());
    let open = set.build(&inputs[0]).unwrap();
    let bytes: u64 = size(&open).sum();
    assert!((800_000..1_400_000).contains(&bytes), "two fit, four do not: {bytes}");
    let pause = || std::thread::sleep(Duration::from_millis(20));
    for index in [1, 2, 3] {
        pause();
        set.build(&inputs[index]).unwrap();
    }
    let kept = Mutex::new([false; 4]);
    for index in 0..4 {
        kept.lock().unwrap()[index] = set.cache.open(&inputs[index]).unwrap().is_some();
    }
    let kept = kept.into_inner().unwrap();
    assert!(kept[0] && !kept[1] && kept[3], "{kept:?}");
    assert!(set.cache.size() <= 3_000_000);
    assert_eq!(points(&open), 70_000);
    set.cache.clear();
    assert_eq!(set.entries().len(), 1, "the open one");
    drop(open);
    set.cache.clear();
    assert_eq!((set.entries().len(), set.cache.size()), (0, 0));
}

/// The files below a folder with their contents; links are not followed.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for path in std::fs::read_dir(folder).unwrap().map(|item| item.unwrap().path()) {
        let metadata = path.symlink_metadata().unwrap();
        found.push((path.clone(), if metadata.is_file() { std::fs::read(&path).unwrap() } else { Vec::new() }));
        if metadata.is_dir() {
            found.extend(contents(&path));
        }
    }
    found.sort();
    found
}

#[test]
#[cfg(unix)]
fn what_another_has_made_is_left_alone_wherever_the_cache_lies() {
    use std::os::unix::fs::symlink;
    let set = Set::new(1);
    let inputs = [set.cloud("a.las", 60_000)];
    let others = set.path("others");
    let key = |digit: char| set.cache.folder().join(String::from(digit).repeat(32));
    let with_files = |folder: &Path, names: &[&str]| {
        std::fs::create_dir_all(folder).unwrap();
        names.iter().for_each(|name| std::fs::write(folder.join(name), "of another").unwrap());
    };
    with_files(&others, &["nodes", "pages", "glint-index", "letter"]);
    with_files(&key('0'), &["letter"]);
    with_files(&key('1'), &["nodes", "pages"]);
    with_files(&key('2'), &[]);
    // An index folder of ours, but in another place.
    let own = set.build(&inputs).unwrap().folder().to_owned();
    for name in ["nodes", "pages", "glint-index"] {
        std::fs::copy(own.join(name), others.join(name)).unwrap();
    }
    symlink(&others, key('3')).unwrap();
    symlink(others.join("letter"), key('4').with_extension("lock")).unwrap();
    with_files(set.cache.folder(), &["letter", "55555555555555555555555555555555.lock"]);
    let before = contents(&others);
    let all_others = |path: &Path| !path.starts_with(&own) && path.extension().is_none_or(|e| e != "lock");
    let in_cache = || contents(set.cache.folder()).into_iter().filter(|(path, _)| all_others(path)).collect::<Vec<_>>();
    let before_in_cache = in_cache();
    // `build` makes room and `clear` empties the cache, as the limit is far exceeded.
    set.build(&[set.cloud("b.las", 1_000)]).unwrap();
    set.cache.clear();
    assert!(!own.exists(), "the first index went");
    assert_eq!(contents(&others), before);
    assert_eq!(in_cache(), before_in_cache);
    assert!(key('4').with_extension("lock").symlink_metadata().is_ok());
    assert_eq!(std::fs::read(key('5').with_extension("lock")).unwrap(), b"of another");
    assert!((0..4).all(|digit| !set.cache.remove(&key(char::from(b'0' + digit)))));
    assert_eq!(contents(&others), before);
}

#[test]
#[cfg(unix)]
fn what_is_in_the_place_of_an_index_is_named_and_stays() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 10_000)];
    let entry = set.build(&inputs).unwrap().folder().to_owned();
    let aside = set.path("aside");
    std::fs::rename(&entry, &aside).unwrap();
    let refused = || {
        assert!(set.cache.open(&inputs).unwrap().is_none());
        let error = set.build(&inputs).err().unwrap();
        assert!(matches!(&error, Error::InTheWay { path } if *path == entry), "{error}");
    };
    // A link to an otherwise valid index, a folder with content, and a file.
    std::os::unix::fs::symlink(&aside, &entry).unwrap();
    refused();
    std::fs::remove_file(&entry).unwrap();
    std::fs::create_dir(&entry).unwrap();
    std::fs::write(entry.join("letter"), "of another").unwrap();
    refused();
    assert_eq!(std::fs::read(entry.join("letter")).unwrap(), b"of another");
    std::fs::remove_dir_all(&entry).unwrap();
    std::fs::write(&entry, "of another").unwrap();
    refused();
    assert_eq!(std::fs::read(&entry).unwrap(), b"of another");
    assert!(aside.join("nodes").exists());
}

#[test]
#[cfg(unix)]
fn what_is_no_file_in_an_index_is_set_aside_and_the_index_made_again() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let make_pipe = |path: &Path| assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    let make_full_folder = |path: &Path| {
        std::fs::create_dir(path).unwrap();
        std::fs::write(path.join("letter"), "of another").unwrap();
    };
    let make_unreadable = |path: &Path| {
        std::fs::write(path, "cannot be read").unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o000)).unwrap();
    };
    let make_link = |path: &Path| symlink("/dev/zero", path).unwrap();
    let make_huge = |path: &Path| std::fs::File::create(path).unwrap().set_len(1 << 40).unwrap();
    let all: [&dyn Fn(&Path); 5] = [&make_pipe, &make_full_folder, &make_unreadable, &make_link, &make_huge];
    for (kind, make) in all.into_iter().enumerate() {
        // Pages that are too long are recognised by their checksums when they are read.
        for name in ["nodes", "surfels", "glint-index", "pages"].into_iter().take(if kind == 4 { 3 } else { 4 }) {
            let set = Set::new(u64::MAX);
            let inputs = [set.cloud("a.las", 5_000)];
            let entry = set.build(&inputs).unwrap().folder().to_owned();
            let _ = std::fs::remove_file(entry.join(name));
            make(&entry.join(name));
            let pages = set.build(&inputs).unwrap_or_else(|error| panic!("{kind} {name}: {error}"));
            assert_eq!((pages.folder(), points(&pages)), (entry.as_path(), 5_000), "{kind} {name}");
            let options = SurfelOptions {
                neighbours: 8,
                orientation: Orientation::Up(Vec3::Z),
                radii: cloud::RadiusRule::Full,
                seen_from: None,
            };
            let estimated = estimate_surfels(&pages, &options, 1 << 30, &Progress::default());
            let is_lost = name == "surfels" && kind == 1;
            assert!(estimated.is_ok() || is_lost, "{kind} {name}: {estimated:?}");
            drop(pages);
            set.cache.clear();
            let letters = contents(set.cache.folder()).into_iter().filter(|(path, _)| path.ends_with("letter")).count();
            assert_eq!(letters, usize::from(kind == 1), "{kind} {name}: what another has put in is kept");
        }
    }
}

#[test]
fn an_index_without_a_marker_is_known_by_its_table() {
    let set = Set::new(u64::MAX);
    let inputs = [set.cloud("a.las", 10_000)];
    let entry = set.build(&inputs).unwrap().folder().to_owned();
    std::fs::remove_file(entry.join("glint-index")).unwrap();
    let pages = set.cache.open(&inputs).unwrap().unwrap();
    assert_eq!(points(&pages), 10_000);
    assert!(set.cache.size() > 10_000);
    drop(pages);
    set.cache.clear();
    assert!(!entry.exists());
}

#[test]
fn a_folder_that_cannot_be_written_to_is_named_once_with_what_helps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    write_las(&path, &terrain(1_000));
    // Not even root can make a folder below a file.
    let cache = Cache::new(path.join("cache"), u64::MAX);
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let error = build(&inputs, &cache, &OPTIONS, &Progress::default(), &|_| ()).err().unwrap();
    assert!(matches!(&error, Error::NotWritten { .. }), "{error}");
    let text = error.to_string();
    let name = cache.folder().display().to_string();
    assert!(text.starts_with(&format!("{name}: ")) && text.matches(&name).count() == 1, "{text}");
    assert!(text.contains("GLINT_CACHE_DIR") && !text.contains(".lock") && !text.contains("building"), "{text}");
}
