//! What stays on the disk of files of servers. The test has a program of its own, because a process has one limit.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests use all of it")]
mod server;

use std::fs;
use std::path::Path;
use std::sync::Mutex;

use cloud::{Chunk, Progress};
use codec::{Selection, Source};
use server::{Habits, Server};

/// What fetched files may take, in bytes.
const LIMIT: u64 = 1 << 20;
/// The number of points of a file of 120 kB.
const POINTS: usize = 10_000;

fn write(path: &Path, value: f32) {
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    );
    let rows = std::iter::repeat_n(value.to_le_bytes(), 3 * POINTS).flatten();
    fs::write(path, head.into_bytes().into_iter().chain(rows).collect::<Vec<u8>>()).unwrap();
}

/// All coordinates that occur in a file.
fn values(source: &Source) -> Vec<f32> {
    let found = Mutex::new(Vec::new());
    let emit = |chunk: Chunk| {
        let origin = chunk.origin.as_vec3().x;
        found.lock().unwrap().extend(chunk.positions.iter().flatten().map(|value| value + origin));
    };
    let selection = Selection { positions: true, ..Selection::default() };
    assert_eq!(source.read(&selection, &Progress::default(), &emit).unwrap().points, POINTS as u64);
    let mut found = found.into_inner().unwrap();
    found.sort_by(f32::total_cmp);
    found.dedup();
    found
}

/// The bytes of the blocks that are kept in a folder, by their lists of eight bytes for 16 KiB.
fn kept(folder: &Path) -> u64 {
    let files = fs::read_dir(folder).unwrap().flatten().flat_map(|entry| fs::read_dir(entry.path()).unwrap().flatten());
    let lists = files.filter(|file| file.file_name().to_string_lossy().starts_with("blocks-"));
    lists.map(|list| list.metadata().unwrap().len() / 8 * (16 << 10)).sum()
}

#[test]
fn fetched_files_keep_their_limit_and_a_changed_file_is_never_mixed_with_what_was_there() {
    let (files, fetched) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let network = codec::Network { folder: Some(fetched.path().to_owned()), limit: LIMIT, ..Default::default() };
    codec::use_network(network).unwrap();
    let server = Server::of_folder(files.path(), Habits::default());
    codec::trust_address(&server.path(""));
    let open = |name: &str| codec::open(&server.path(name)).unwrap();
    let count = 24;
    for number in 0..count {
        let name = format!("{number}.ply");
        write(&files.path().join(&name), number as f32);
        assert_eq!(values(&open(&name)), [number as f32]);
        assert!(kept(fetched.path()) <= LIMIT, "{} bytes after {number} files", kept(fetched.path()));
    }
    assert!(kept(fetched.path()) > LIMIT / 2, "{} bytes are used", kept(fetched.path()));
    // The file that was used last is there, and the one that was unused for the longest time is not.
    let fetches = |name: &str| {
        let before = server.bytes();
        open(name);
        server.bytes() - before
    };
    assert_eq!(fetches(&format!("{}.ply", count - 1)), 0);
    assert!(fetches("0.ply") > 100_000);

    // A file that changes has other values at the same places, and the same length.
    let name = "changing.ply";
    write(&files.path().join(name), 1.0);
    let before = open(name);
    write(&files.path().join(name), 2.0);
    server.change();
    let after = open(name);
    assert_eq!((values(&before), values(&after)), (vec![1.0], vec![2.0]));
    // Nor where the answer comes after the change, while the first blocks are those from before it.
    let (mut start, path) = ([0; 16], server.path(name));
    let far = codec::Bytes::open(&path).unwrap();
    far.read_at(0, &mut start).unwrap();
    write(&files.path().join(name), 3.0);
    server.change();
    let mut all = vec![0; far.length() as usize];
    match far.read_at(0, &mut all) {
        Ok(_) => assert!(!all.ends_with(&3.0_f32.to_le_bytes())),
        Err(error) => assert!(error.to_string().contains("has changed since it was opened"), "{error}"),
    }
    assert_eq!(values(&open(name)), [3.0]);
}
