//! Reads clouds from a server on this machine: one with good habits, and hostile ones.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/copc_lists.rs"]
mod copc_lists;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;
#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests use the rest of it")]
mod server;

use std::collections::BTreeSet;
use std::fs;
use std::io::{Cursor, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use cloud::{Chunk, Progress};
use codec::{Selection, Source};
use e57::{E57Reader, E57Writer, Record, RecordValue};
use server::{Habits, Request, Server};

/// The longest file that these tests fetch as a whole.
const LIMIT: u64 = 32 << 20;

/// The name of files whose fetch is stopped at the first report of bytes, and how many had come by then at most.
const STOPPED: &str = "stopped.ply";
static STOPPED_AT: AtomicU64 = AtomicU64::new(0);
/// The name of a file whose opening is stopped while it waits, and the number of waits whose end was told.
const WAITS: &str = "waits.ply";
static WAITS_ENDED: AtomicU64 = AtomicU64::new(0);
/// The name of a file of which the fetch of a part is stopped while it waits.
const PART_WAITS: &str = "part_waits.ply";
/// The name of a file whose fetch is stopped at the first report of bytes, and then no more.
const STOPPED_ONCE: &str = "stopped_once.ply";
static IS_STOPPED: AtomicBool = AtomicBool::new(false);
/// The name of a file whose first report of bytes panics.
const PANICS: &str = "panics.ply";
static HAS_PANICKED: AtomicBool = AtomicBool::new(false);

/// The folder of the cache of this process, which all tests share.
fn cache() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let authorization = Some("Bearer secret".to_owned());
        let watch = Box::new(|path: &Path, bytes: Option<(u64, u64)>| {
            let Some((done, total)) = bytes else { return !path.ends_with(PART_WAITS) };
            if path.ends_with(PANICS) && done > 0 {
                assert!(HAS_PANICKED.swap(true, Ordering::Relaxed), "a report that panics");
            }
            if path.ends_with(WAITS) && total == 1 {
                WAITS_ENDED.fetch_add(done, Ordering::Relaxed);
                return false;
            }
            if path.ends_with(STOPPED_ONCE) && (1..total).contains(&done) {
                return IS_STOPPED.swap(true, Ordering::Relaxed);
            }
            let is_stopped = path.ends_with(STOPPED) && (1..total).contains(&done);
            if is_stopped {
                STOPPED_AT.fetch_max(done, Ordering::Relaxed);
            }
            !is_stopped
        });
        let network = codec::Network {
            folder: Some(folder.path().to_owned()),
            limit: LIMIT,
            authorization,
            watch,
            ..Default::default()
        };
        codec::use_network(network).unwrap();
        folder
    });
    folder.path()
}

/// Opens an address as if a person had typed it.
fn open(path: &Path) -> Result<Source, String> {
    cache();
    codec::trust_address(path);
    codec::open(path).map_err(|error| error.to_string())
}

fn message(path: &Path) -> String {
    open(path).err().unwrap_or_default()
}

/// A point: the number of the first one of its chunk, its place and its colour.
type Point = (u64, [u64; 3], [u8; 4]);

/// All places and colours in the order of the file.
fn points(source: &Source) -> Vec<Point> {
    let (points, warnings) = read(source);
    assert!(warnings.is_empty(), "{warnings:?}");
    points
}

/// All points that can be read, and what is said of the others.
fn read(source: &Source) -> (Vec<Point>, Vec<String>) {
    let selection = Selection { positions: true, colors: true, ..Selection::default() };
    let chunks = Mutex::new(Vec::new());
    let emit = |chunk: Chunk| chunks.lock().unwrap().push(chunk);
    let summary = source.read(&selection, &Progress::default(), &emit);
    let warnings = summary.map_or_else(|error| vec![error.to_string()], |summary| summary.warnings);
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    let of_chunk = |chunk: &Chunk| {
        let color = |index: usize| chunk.colors.as_ref().map_or([0; 4], |colors| colors[index]);
        let place = |index: usize| chunk.position(index).to_array().map(f64::to_bits);
        (0..chunk.len()).map(|index| (chunk.first_point, place(index), color(index))).collect::<Vec<_>>()
    };
    (chunks.iter().flat_map(of_chunk).collect(), warnings)
}

fn data() -> Option<PathBuf> {
    real_data::test_data()
}

/// The files of the test data that these tests fetch.
const FILES: [&str; 6] = [
    "copc/ellipsoid_las14_pf7.copc.laz",
    "ept/1.2-with-color/ept.json",
    "ept/lone-star-laszip/ept.json",
    "copc/ellipsoid_las14_pf7_plain.laz",
    "e57/bunny_double.e57",
    "text/1.2-with-color.ptx",
];

#[test]
fn what_an_address_holds_is_what_the_file_holds_although_one_request_in_seven_fails() {
    let Some(data) = data() else { return };
    for fails in [0, 7] {
        let server = Server::of_folder(&data, Habits { fails, ..Habits::default() });
        for name in FILES {
            let expected = points(&codec::open(&data.join(name)).unwrap());
            let source = open(&server.path(name)).unwrap();
            assert_eq!(source.info().name(), codec::open(&data.join(name)).unwrap().info().name());
            assert!(points(&source) == expected, "{name}, of {fails} requests one fails");
        }
    }
}

#[test]
fn a_second_opening_fetches_nothing_that_is_there() {
    let Some(data) = data() else { return };
    let server = Server::of_folder(&data, Habits::default());
    for name in FILES {
        let first = points(&open(&server.path(name)).unwrap());
        let before = server.bytes();
        assert!(points(&open(&server.path(name)).unwrap()) == first, "{name}");
        assert_eq!(server.bytes() - before, 0, "{name}");
    }
    // A file that has changed is fetched again.
    server.change();
    let before = server.bytes();
    points(&open(&server.path(FILES[0])).unwrap());
    assert!(server.bytes() > before);
}

#[test]
fn a_node_is_fetched_alone() {
    let Some(data) = data() else { return };
    let name = "copc/lone_star_las14_pf6.copc.laz";
    let server = Server::of_folder(&data, Habits::default());
    let source = open(&server.path(name)).unwrap();
    let node = source.copc().unwrap().nodes.iter().rev().find(|node| node.points > 1000).unwrap().clone();
    let before = server.bytes();
    let selection = Selection { positions: true, ..Selection::default() };
    assert_eq!(source.read_copc_node(&node, &selection).unwrap().len() as u32, node.points);
    let fetched = server.bytes() - before;
    let size = fs::metadata(data.join(name)).unwrap().len();
    assert!(fetched <= node.bytes + (96 << 10) && before < size / 2, "{fetched} of {}, {before} of {size}", node.bytes);
}

#[test]
fn a_tile_that_was_opened_is_not_asked_for_again() {
    let Some(data) = data() else { return };
    let server = Server::of_folder(&data, Habits::default());
    let source = open(&server.path("ept/lone-star-laszip/ept.json")).unwrap();
    let node = source.copc().unwrap().nodes.last().unwrap().clone();
    let read = || source.read_copc_node(&node, &Selection { positions: true, ..Selection::default() }).unwrap();
    let first = read();
    let asked = server.requests();
    assert_eq!((read().positions, server.requests()), (first.positions, asked));
}

#[test]
fn what_the_cache_has_is_used_only_if_it_is_as_it_was() {
    let Some(data) = data() else { return };
    let server = Server::of_folder(&data, Habits::default());
    let path = server.path("copc/ellipsoid_las14_pf7_plain.laz");
    let expected = points(&open(&path).unwrap());
    let mut damaged = 0;
    for folder in fs::read_dir(cache()).unwrap().flatten() {
        for file in fs::read_dir(folder.path()).unwrap().flatten() {
            let is_data = file.file_name().to_string_lossy().starts_with("data-");
            let own = fs::metadata(data.join("copc/ellipsoid_las14_pf7_plain.laz")).unwrap().len();
            if is_data && file.metadata().unwrap().len() == own {
                let mut bytes = fs::read(file.path()).unwrap();
                bytes[100_000..100_100].fill(0x55);
                fs::write(file.path(), bytes).unwrap();
                damaged += 1;
            }
        }
    }
    assert!(damaged > 0);
    assert!(points(&open(&path).unwrap()) == expected);
}

/// Sends files whose blocks of 16 KiB are damaged where `is_damaged` says so of the path and the number of a block; the first
/// five, which have the heads, never are.
fn damaging(root: PathBuf, is_damaged: impl Fn(&str, usize) -> bool + Send + Sync + 'static) -> Server {
    Server::new(move |request, stream| {
        let Ok(file) = fs::read(root.join(request.path.trim_start_matches('/'))) else {
            return write!(stream, "HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n");
        };
        let last = file.len() - 1;
        let (first, last) = request.range().map_or((0, last), |(first, end)| (first as usize, last.min(end as usize)));
        let mut bytes = file[first..=last].to_vec();
        for (at, block) in bytes.chunks_mut(1 << 14).enumerate() {
            let number = (first >> 14) + at;
            if number > 4 && is_damaged(&request.path, number) {
                block.iter_mut().for_each(|byte| *byte ^= 0x5a);
            }
        }
        let (total, count) = (file.len(), bytes.len());
        let head = match request.range() {
            Some(_) => format!("206 Part\r\ncontent-range: bytes {first}-{last}/{total}"),
            None => "200 OK".to_owned(),
        };
        write!(stream, "HTTP/1.1 {head}\r\netag: \"{total}\"\r\ncontent-length: {count}\r\n\r\n")?;
        stream.write_all(&bytes)
    })
}

#[test]
fn bytes_that_came_damaged_do_not_stay_in_the_cache() {
    let Some(data) = data() else { return };
    for name in [FILES[0], "copc/lone_star_las14_pf6.copc.laz", FILES[2], FILES[3], FILES[4]] {
        let expected = points(&codec::open(&data.join(name)).unwrap());
        let is_bad = Arc::new(AtomicBool::new(true));
        let now = is_bad.clone();
        let path = damaging(data.clone(), move |_, _| now.load(Ordering::Relaxed)).path(name);
        let told = open(&path).map_or_else(
            |error| error,
            |source| {
                let (first, warnings) = read(&source);
                assert!(first != expected, "{name}: nothing was damaged");
                [warnings, source.info().warnings.clone()].concat().join("\n")
            },
        );
        assert!(told.contains("twice, and the same"), "{name}: {told}");
        is_bad.store(false, Ordering::Relaxed);
        let (again, warnings) = read(&open(&path).unwrap());
        assert!(again == expected, "{name}: {} of {} points, {warnings:?}", again.len(), expected.len());
    }
}

#[test]
fn a_node_or_tile_that_came_damaged_is_fetched_once_more() {
    let Some(data) = data() else { return };
    for name in ["copc/lone_star_las14_pf6.copc.laz", FILES[2]] {
        let sent: Mutex<BTreeSet<(String, usize)>> = Mutex::default();
        let is_bad = Arc::new(AtomicBool::new(false));
        let now = is_bad.clone();
        let is_first = move |path: &str, block: usize| {
            now.load(Ordering::Relaxed) && sent.lock().unwrap().insert((path.to_owned(), block))
        };
        let server = damaging(data.clone(), is_first);
        let source = open(&server.path(name)).unwrap();
        is_bad.store(true, Ordering::Relaxed);
        let before = server.requests();
        let local = codec::open(&data.join(name)).unwrap();
        let selection = Selection { positions: true, ..Selection::default() };
        for node in source.copc().unwrap().nodes.iter().filter(|node| node.points > 0).rev().take(3) {
            let [own, expected] = [&source, &local].map(|source| source.read_copc_node(node, &selection).unwrap());
            assert!(own.positions == expected.positions, "{name}");
        }
        assert!(server.requests() > before + 3, "{name}: nothing was fetched twice");
    }
}

/// An E57 file of two scans, the hall and the attic, and the place of the attic's points in it.
fn two_scans() -> (Vec<u8>, usize) {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    for name in ["hall", "attic"] {
        let axes = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
        let mut scan = writer.add_pointcloud(name, axes).unwrap();
        scan.set_name(Some(name.into()));
        for at in 0..8000 {
            scan.add_point([0.1, 0.2, 0.3].map(|step| RecordValue::Double(step * f64::from(at))).to_vec()).unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    let attic = E57Reader::new(&mut bytes).unwrap().pointclouds()[1].file_offset as usize;
    (bytes.into_inner(), attic)
}

#[test]
fn a_scan_that_came_damaged_is_fetched_once_more_before_it_is_said_to_be_lost() {
    cache();
    let (bytes, attic) = two_scans();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("house.e57"), bytes).unwrap();
    let local = codec::open_scans(&folder.path().join("house.e57"), 1 << 28).unwrap();
    // The last points of the hall with the head of the attic, and points of the hall alone.
    for block in [attic >> 14, 5] {
        for is_always in [false, true] {
            let is_first = AtomicBool::new(true);
            let is_damaged =
                move |_: &str, own: usize| own == block && (is_first.swap(false, Ordering::Relaxed) || is_always);
            let path = damaging(folder.path().to_owned(), is_damaged).path("house.e57");
            codec::trust_address(&path);
            let scans = codec::open_scans(&path, 1 << 28).unwrap();
            let told: Vec<String> =
                scans.iter().flat_map(|scan| [read(scan).1, scan.info().lost.clone()].concat()).collect();
            if is_always {
                assert!(told.iter().all(|told| told.contains("wrong checksum")), "{block}: {told:?}");
                let is_lost = |told: &String| told.contains("scan attic: ") && told.contains("twice, and the same");
                let is_whole = block != attic >> 14;
                assert_eq!((scans.len() == 2, told.iter().any(is_lost)), (is_whole, !is_whole), "{block}: {told:?}");
            } else {
                assert!(told.is_empty() && scans.len() == 2, "{block}: {told:?}");
                assert!(std::iter::zip(&scans, &local).all(|(own, local)| points(own) == points(local)));
            }
        }
    }
}

#[test]
fn a_file_that_changes_while_it_is_open_is_no_longer_read() {
    let Some(data) = data() else { return };
    let server = Server::of_folder(&data, Habits::default());
    let source = open(&server.path("copc/lone_star_las14_pf6.copc.laz")).unwrap();
    let node = source.copc().unwrap().nodes.last().unwrap().clone();
    server.change();
    let selection = Selection { positions: true, ..Selection::default() };
    let told = source.read_copc_node(&node, &selection).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(told.contains("has changed since it was opened"), "{told}");
}

#[test]
fn a_file_that_has_become_shorter_has_changed() {
    cache();
    let files = [ply(80_000, 1.0), ply(10_000, 1.0)];
    let server = Server::new(move |request, stream| {
        let file = &files[usize::from(request.number > 1)];
        match request.range() {
            Some((first, _)) if first >= file.len() as u64 => {
                let range = format!("content-range: bytes */{}", file.len());
                write!(stream, "HTTP/1.1 416 No Such Range\r\n{range}\r\ncontent-length: 0\r\n\r\n")
            }
            _ => send_part(file, "etag: \"1\"\r\n", request, stream),
        }
    });
    let path = server.path("a.ply");
    codec::trust_address(&path);
    let told = codec::Bytes::open(&path).unwrap().read_at(900_000, &mut [0; 100]).unwrap_err().to_string();
    assert!(told.contains("has changed since it was opened"), "{told}");
}

#[test]
fn a_list_of_nodes_that_cannot_be_fetched_is_no_damaged_one() {
    let Some(data) = data() else { return };
    let file = fs::read(data.join("copc/lone_star_las14_pf6.copc.laz")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let copc_lists::Listed { mut bytes, pages, entries } = copc_lists::in_pages(&file, 1, 20_000);
    // One page lies at the end of the list, apart from the others, which come with the first one.
    let (key, (start, length)) = pages.into_iter().nth(1).unwrap();
    let apart = bytes.len() - length;
    bytes.copy_within(start..start + length, apart);
    let offset = entries[&(key, true)] + 16;
    bytes[offset..offset + 8].copy_from_slice(&(apart as u64).to_le_bytes());
    fs::write(folder.path().join("paged.copc.laz"), bytes).unwrap();
    let server = Server::of_folder(folder.path(), Habits::default());
    let path = server.path("paged.copc.laz");
    cache();
    codec::trust_address(&path);
    let source = codec::open_within(&path, 4 << 20).unwrap();
    server.change();
    let failed = source.copc().unwrap().further.iter().filter_map(|page| source.read_copc_page(page).err());
    let failed: Vec<codec::Error> = failed.collect();
    assert!(!failed.is_empty() && failed.iter().all(|error| matches!(error, codec::Error::Io { .. })), "{failed:?}");
}

#[test]
fn a_private_server_is_asked_only_where_its_address_was_typed() {
    cache();
    let server = Server::new(|_, stream| write!(stream, "HTTP/1.1 404 No\r\ncontent-length: 0\r\n\r\n"));
    let path = server.path("a.laz");
    let told = codec::open(&path).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(told.contains("only asked where a person has typed its address"), "{told}");
    assert_eq!(server.requests(), 0);
    // Nor where a server that was typed sends on to it.
    let target = path.display().to_string();
    let other = Server::new(move |_, stream| {
        write!(stream, "HTTP/1.1 302 Found\r\nlocation: {target}\r\ncontent-length: 0\r\n\r\n")
    });
    let told = message(&other.path("a.laz"));
    assert!(told.contains("only asked where a person has typed its address"), "{told}");
    assert_eq!((server.requests(), other.requests()), (0, 1));
    assert!(message(&path).contains("no such file on the server"));
}

#[test]
fn credentials_go_to_servers_that_were_typed() {
    let server = Server::new(|_, stream| write!(stream, "HTTP/1.1 401 No\r\ncontent-length: 0\r\n\r\n"));
    let told = message(&server.path("a.laz"));
    assert!(told.contains("GLINT_AUTHORIZATION") && !told.contains("secret"), "{told}");
    assert_eq!(server.asked()[0].header("authorization"), Some("Bearer secret"));
    let told = message(Path::new("http://user:password@127.0.0.1/a.laz"));
    assert!(told.contains("a password in an address is not sent"), "{told}");
}

type Answer = fn(&Request, &mut TcpStream) -> std::io::Result<()>;

#[test]
fn hostile_servers_end_with_a_clear_error() {
    let hostile: [(&str, Answer, u64); 14] = [
        (
            "sends on more than 5 times",
            |request, stream| {
                let count = request.path.len();
                write!(stream, "HTTP/1.1 302 Found\r\nlocation: /{}\r\ncontent-length: 0\r\n\r\n", "a".repeat(count))
            },
            6,
        ),
        (
            "sends on to `file:///etc/passwd`",
            |_, stream| {
                write!(stream, "HTTP/1.1 302 Found\r\nlocation: file:///etc/passwd\r\ncontent-length: 0\r\n\r\n")
            },
            1,
        ),
        (
            "a wrong part: `bytes 5-10/100`",
            |_, stream| {
                write!(stream, "HTTP/1.1 206 Part\r\ncontent-range: bytes 5-10/100\r\ncontent-length: 6\r\n\r\nabcdef")
            },
            1,
        ),
        (
            "a wrong part: `bytes 0-65535/18446744073709551616`",
            |_, stream| {
                write!(stream, "HTTP/1.1 206 Part\r\ncontent-range: bytes 0-65535/18446744073709551616\r\n\r\n")
            },
            1,
        ),
        (
            "a wrong part: `bytes 0-9/100`",
            |_, stream| {
                write!(
                    stream,
                    "HTTP/1.1 206 Part\r\ncontent-range: bytes 0-9/100\r\ncontent-length: 10\r\n\r\n0123456789"
                )
            },
            1,
        ),
        (
            "sends 1010 bytes as the part `bytes 0-9/10`",
            |_, stream| {
                write!(stream, "HTTP/1.1 206 Part\r\ncontent-range: bytes 0-9/10\r\ncontent-length: 1010\r\n\r\n")
            },
            1,
        ),
        (
            "this is a web page (HTML)",
            |_, stream| write!(stream, "HTTP/1.1 200 OK\r\ncontent-length: 28\r\n\r\n<!DOCTYPE html><html></html>"),
            3,
        ),
        (
            "more than it said",
            |_, stream| {
                write!(
                    stream,
                    "HTTP/1.1 206 Part\r\ncontent-range: bytes 0-9/10\r\ntransfer-encoding: chunked\r\n\r\n"
                )?;
                loop {
                    write!(stream, "1000\r\n{}\r\n", "a".repeat(0x1000))?;
                }
            },
            1,
        ),
        (
            "does not say how long the file is",
            |_, stream| {
                write!(stream, "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n")?;
                loop {
                    write!(stream, "1000\r\n{}\r\n", "a".repeat(0x1000))?;
                }
            },
            1,
        ),
        (
            "more than the 34 MB that GLINT_FETCHED_BYTES allows",
            |_, stream| {
                write!(stream, "HTTP/1.1 200 OK\r\ncontent-length: 1000000000000\r\n\r\n")?;
                loop {
                    stream.write_all(&[b'a'; 4096])?;
                }
            },
            1,
        ),
        (
            "more than the 34 MB that GLINT_FETCHED_BYTES allows",
            |_, stream| {
                write!(
                    stream,
                    "HTTP/1.1 206 Part\r\ncontent-range: bytes 0-16383/1000000000000\r\ncontent-length: 16384\r\n\r\n"
                )?;
                stream.write_all(&[b'a'; 16384])
            },
            1,
        ),
        (
            "the answer is compressed (`gzip`)",
            |_, stream| {
                write!(stream, "HTTP/1.1 200 OK\r\ncontent-encoding: gzip\r\ncontent-length: 10\r\n\r\n0123456789")
            },
            1,
        ),
        ("answers with status 418", |_, stream| write!(stream, "HTTP/1.1 418 Teapot\r\ncontent-length: 0\r\n\r\n"), 1),
        ("(tried 5 times)", |_, _| Err(std::io::Error::other("the connection is cut")), 5),
    ];
    for (problem, answer, most) in hostile {
        let server = Server::new(answer);
        let told = message(&server.path("a.laz"));
        assert!(told.contains(problem), "{problem}: {told}");
        assert!(server.requests() <= most, "{problem}: {} requests", server.requests());
    }
    // Nobody listens there: the port was free a moment ago.
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let told = message(Path::new(&format!("http://{free}/a.laz")));
    assert!(told.contains("no server answers there (tried 5 times)"), "{told}");
}

#[test]
fn a_head_without_end_is_not_read_to_its_end() {
    let server = Server::new(|_, stream| {
        write!(stream, "HTTP/1.1 200 OK\r\n")?;
        loop {
            write!(stream, "a-header: {}\r\n", "a".repeat(100))?;
        }
    });
    let told = message(&server.path("a.laz"));
    assert!(!told.is_empty() && told.len() < 400, "{told}");
}

#[test]
fn a_tile_of_an_ept_that_is_not_there_is_missed_and_the_others_are_read() {
    let Some(data) = data() else { return };
    let root = data.join("ept/lone-star-laszip");
    let folder = tempfile::tempdir().unwrap();
    for name in ["ept.json", "ept-hierarchy/0-0-0-0.json", "ept-data/0-0-0-0.laz", "ept-data/1-0-0-0.laz"] {
        let own = folder.path().join(name);
        fs::create_dir_all(own.parent().unwrap()).unwrap();
        fs::write(own, fs::read(root.join(name)).unwrap()).unwrap();
    }
    let server = Server::of_folder(folder.path(), Habits::default());
    let source = open(&server.path("ept.json")).unwrap();
    // Pages below the first one are read when their nodes are needed.
    assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
    let summary = source.read(&Selection::default(), &Progress::default(), &|_| {}).unwrap();
    assert_eq!((summary.points, summary.missing), (41_998 + 22_108, 518_862 - 41_998 - 22_108));
    let told = summary.warnings.join("\n");
    assert!(told.contains("below node 2-2-2-1 is missing") && told.contains("no such file on the server"), "{told}");
}

/// A file of as many points as asked for, 12 bytes each, all of them at this place on each axis.
fn ply(points: usize, place: f32) -> Vec<u8> {
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    );
    head.into_bytes().into_iter().chain(std::iter::repeat_n(place.to_le_bytes(), 3 * points).flatten()).collect()
}

/// Sends the part of a file that is asked for, with these further lines of the head.
fn send_part(file: &[u8], lines: &str, request: &Request, stream: &mut TcpStream) -> std::io::Result<()> {
    let last = file.len() as u64 - 1;
    let (first, end) = request.range().map_or((0, last), |(first, end)| (first, end.min(last)));
    let (total, count) = (file.len(), end + 1 - first);
    let status = match request.range() {
        Some(_) => format!("206 Part\r\ncontent-range: bytes {first}-{end}/{total}"),
        None => "200 OK".to_owned(),
    };
    let head = format!("{status}\r\n{lines}content-length: {count}");
    write!(stream, "HTTP/1.1 {head}\r\n\r\n")?;
    stream.write_all(&file[first as usize..=end as usize])
}

/// Sends a whole file, or its first bytes alone, whatever part is asked for.
fn send_all(file: &[u8], sent: usize, stream: &mut TcpStream) -> std::io::Result<()> {
    let modified = "last-modified: Mon, 30 Nov 2026 10:00:00 GMT";
    write!(stream, "HTTP/1.1 200 OK\r\n{modified}\r\ncontent-length: {}\r\n\r\n", file.len())?;
    stream.write_all(&file[..sent.min(file.len())])?;
    if sent < file.len() { Err(std::io::Error::other("cut")) } else { Ok(()) }
}

#[test]
fn a_file_whose_weak_tag_changes_is_not_mixed_with_what_was_there() {
    let files = [ply(300_000, 1.0), ply(300_000, 2.0)];
    let server = Server::new(move |request, stream| {
        let version = usize::from(request.number > 2);
        send_part(&files[version], &format!("etag: W/\"{version}\"\r\n"), request, stream)
    });
    let told = message(&server.path("a.ply"));
    assert!(told.contains("has changed since it was opened"), "{told}");
}

#[test]
fn a_server_without_parts_is_read_from_the_start_after_a_cut() {
    let file = ply(100_000, 1.0);
    let is_bad = Arc::new(AtomicBool::new(true));
    let now = is_bad.clone();
    let server = Server::new(move |request, stream| {
        if request.header("if-modified-since").is_some() {
            return write!(stream, "HTTP/1.1 304 Not Modified\r\n\r\n");
        }
        send_all(&file, if now.load(Ordering::Relaxed) { 500_000 } else { usize::MAX }, stream)
    });
    let path = server.path("a.ply");
    let told = message(&path);
    assert!(told.contains("was cut"), "{told}");
    is_bad.store(false, Ordering::Relaxed);
    let before = server.requests();
    assert_eq!(points(&open(&path).unwrap()).len(), 100_000);
    // One answer brings all of it, whoever asks for a part meanwhile.
    assert!(server.requests() - before <= 5, "{} requests", server.requests() - before);
}

#[test]
fn a_part_that_was_cut_goes_on_where_it_was_cut() {
    let file = ply(80_000, 1.0);
    let length = file.len() as u64;
    let sent = Arc::new(AtomicU64::new(0));
    let own = sent.clone();
    let server = Server::new(move |request, stream| {
        let (first, end) = request.range().unwrap_or((0, length - 1));
        let end = end.min(length - 1);
        let count = end + 1 - first;
        // Nine tenths come of each answer but the last ones.
        let now = if count > 10_000 { count * 9 / 10 } else { count };
        write!(
            stream,
            "HTTP/1.1 206 Part\r\netag: \"1\"\r\ncontent-range: bytes {first}-{end}/{length}\r\n\
             content-length: {count}\r\n\r\n"
        )?;
        stream.write_all(&file[first as usize..(first + now) as usize])?;
        own.fetch_add(now, Ordering::Relaxed);
        if now < count { Err(std::io::Error::other("cut")) } else { Ok(()) }
    });
    assert_eq!(points(&open(&server.path("a.ply")).unwrap()).len(), 80_000);
    assert!(sent.load(Ordering::Relaxed) < length + (64 << 10), "{} of {length}", sent.load(Ordering::Relaxed));
}

#[test]
fn a_server_that_asks_to_wait_is_waited_for() {
    let file = ply(100, 1.0);
    let began = std::time::Instant::now();
    let server = Server::new(move |request, stream| match began.elapsed().as_secs() {
        ..4 => write!(stream, "HTTP/1.1 429 Busy\r\nretry-after: 1\r\ncontent-length: 0\r\n\r\n"),
        _ => send_part(&file, "etag: \"1\"\r\n", request, stream),
    });
    assert_eq!(points(&open(&server.path("a.ply")).unwrap()).len(), 100);
    assert!(server.requests() < 8, "{} requests", server.requests());
    // One that asks for more patience than a person has is not asked again at once.
    for (asked, told_as, first) in [("3600", "3600", "3600"), ("18446744073709551615", "86400", "1")] {
        let server = Server::new(move |request, stream| {
            let time = if request.number == 1 { first } else { asked };
            write!(stream, "HTTP/1.1 503 Busy\r\nretry-after: {time}\r\ncontent-length: 0\r\n\r\n")
        });
        let requests = if first == asked { 1 } else { 2 };
        for _ in 0..2 {
            let told = message(&server.path("a.ply"));
            assert!(told.contains(&format!("asks to wait for {told_as} s")), "{told}");
        }
        assert_eq!(server.requests(), requests);
    }
}

#[test]
fn a_server_that_has_no_answer_is_asked_again_and_again_for_one_part_and_not_for_all() {
    const PARTS: u64 = 30;
    cache();
    let file = ply(400_000, 1.0);
    let whole = file.clone();
    let is_bad = Arc::new(AtomicBool::new(false));
    let now = is_bad.clone();
    let server = Server::new(move |request, stream| match now.load(Ordering::Relaxed) {
        true => write!(stream, "HTTP/1.1 503 Busy\r\ncontent-length: 0\r\n\r\n"),
        false => send_part(&whole, "etag: \"1\"\r\n", request, stream),
    });
    let path = server.path("a.ply");
    codec::trust_address(&path);
    let bytes = codec::Bytes::open(&path).unwrap();
    is_bad.store(true, Ordering::Relaxed);
    let (began, asked) = (std::time::Instant::now(), server.requests());
    let read = |part: u64| {
        let mut bytes_of_part = [0; 100];
        bytes.read_at(part * 128_000, &mut bytes_of_part).map(|_| bytes_of_part).map_err(|error| error.to_string())
    };
    let told: Vec<String> = (1..PARTS).filter_map(|part| read(part).err()).collect();
    assert_eq!(told.len() as u64, PARTS - 1);
    assert!(told[0].ends_with("(status 503) (tried 5 times)") && told[1].ends_with("is not asked yet"), "{told:?}");
    assert!(server.requests() - asked <= 10, "{} requests", server.requests() - asked);
    assert!(began.elapsed().as_secs() < 10, "{:?}", began.elapsed());
    // Other files of that server may be well; once several are not, the server is not.
    let others: Vec<String> = (0..6).map(|number| message(&server.path(&format!("{number}.ply")))).collect();
    let tried = others.iter().filter(|told| told.contains("(tried 5 times)") && !told.contains("not asked yet"));
    assert!((1..=3).contains(&tried.count()), "{others:?}");
    is_bad.store(false, Ordering::Relaxed);
    let until = std::time::Instant::now() + std::time::Duration::from_secs(10);
    let come = std::iter::from_fn(|| {
        std::thread::sleep(std::time::Duration::from_millis(200));
        (std::time::Instant::now() < until).then(|| read(PARTS).ok())
    });
    assert_eq!(come.flatten().next().as_ref().map(|part| &part[..]), Some(&file[3_840_000..3_840_100]));
}

#[test]
fn one_file_that_a_server_has_no_answer_for_does_not_keep_others_from_coming() {
    let file = ply(100, 1.0);
    let server = Server::new(move |request, stream| match request.path.contains("bad") {
        true => write!(stream, "HTTP/1.1 500 Oh\r\ncontent-length: 0\r\n\r\n"),
        false => send_part(&file, "etag: \"1\"\r\n", request, stream),
    });
    for number in 0..3 {
        assert!(message(&server.path(&format!("bad{number}.ply"))).contains("(tried 5 times)"));
        assert_eq!(points(&open(&server.path(&format!("good{number}.ply"))).unwrap()).len(), 100);
    }
}

#[test]
fn the_wait_of_an_opening_can_be_stopped() {
    let server = Server::new(move |_, stream| {
        write!(stream, "HTTP/1.1 503 Busy\r\nretry-after: 20\r\ncontent-length: 0\r\n\r\n")
    });
    let began = std::time::Instant::now();
    let told = message(&server.path(WAITS));
    assert!(told.contains("stopped while it was fetched") && began.elapsed().as_secs() < 10, "{told}");
    assert_eq!((server.requests(), WAITS_ENDED.load(Ordering::Relaxed)), (1, 1));
}

#[test]
fn the_wait_for_a_part_can_be_stopped() {
    cache();
    let file = ply(80_000, 1.0);
    let server = Server::new(move |request, stream| match request.number {
        1 => send_part(&file, "etag: \"1\"\r\n", request, stream),
        _ => write!(stream, "HTTP/1.1 503 Busy\r\nretry-after: 20\r\ncontent-length: 0\r\n\r\n"),
    });
    let path = server.path(PART_WAITS);
    codec::trust_address(&path);
    let opened = codec::Bytes::open(&path).unwrap();
    let began = std::time::Instant::now();
    let told = opened.read_at(900_000, &mut [0; 100]).unwrap_err().to_string();
    assert!(told.contains("stopped while it was fetched") && began.elapsed().as_secs() < 10, "{told}");
}

#[test]
fn nobody_waits_for_blocks_whose_fetch_has_panicked() {
    cache();
    let file = ply(80_000, 1.0);
    let whole = file.clone();
    // The first answer is a part, and all others have all of the file, which is reported.
    let server = Server::new(move |request, stream| match request.number {
        1 => send_part(&whole, "etag: \"1\"\r\n", request, stream),
        _ => send_part(&whole, "etag: \"1\"\r\n", &Request::default(), stream),
    });
    let path = server.path(PANICS);
    codec::trust_address(&path);
    let bytes = Arc::new(codec::Bytes::open(&path).unwrap());
    let own = bytes.clone();
    let first = std::thread::spawn(move || own.read_at(500_000, &mut [0; 100]).is_ok());
    assert!(first.join().is_err(), "the report has not panicked");
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut part = [0; 100];
        let read = bytes.read_at(500_000, &mut part);
        sender.send((read.unwrap(), part)).unwrap();
    });
    let (read, part) = receiver.recv_timeout(std::time::Duration::from_secs(20)).unwrap();
    assert_eq!((read, &part[..]), (100, &file[500_000..500_100]));
}

#[test]
fn the_fetch_of_a_file_stops_within_some_blocks() {
    let files = tempfile::tempdir().unwrap();
    fs::write(files.path().join(STOPPED), ply(300_000, 1.0)).unwrap();
    let server = Server::of_folder(files.path(), Habits { rate: 1 << 20, ..Habits::default() });
    let told = message(&server.path(STOPPED));
    assert!(told.contains("stopped while it was fetched"), "{told}");
    let at = STOPPED_AT.load(Ordering::Relaxed);
    assert!((1..1 << 20).contains(&at), "at {at} bytes");
}

#[test]
fn who_waits_for_a_fetch_that_is_stopped_is_stopped_too() {
    cache();
    let file = ply(300_000, 1.0);
    let all_ask = std::sync::Barrier::new(4);
    let server = Server::new(move |request, stream| {
        if request.number == 1 {
            return send_part(&file, "etag: \"1\"\r\n", request, stream);
        }
        all_ask.wait();
        send_part(&file, "etag: \"1\"\r\n", &Request::default(), stream)
    });
    let path = server.path(STOPPED_ONCE);
    codec::trust_address(&path);
    let bytes = codec::Bytes::open(&path).unwrap();
    let read = |part: u64| bytes.read_at(part * 500_000, &mut [0; 100]).err().map(|error| error.to_string());
    let told: Vec<Option<String>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (1..5).map(|part| scope.spawn(move || read(part))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(told.iter().flatten().filter(|told| told.contains("stopped while")).count(), 4, "{told:?}");
    assert_eq!(server.requests(), 5);
}

#[test]
fn a_long_file_is_not_fetched_whole_for_one_answer_that_has_all_of_it() {
    const LENGTH: u64 = 5 << 30;
    cache();
    let server = Server::new(|request, stream| {
        let (first, last) = request.range().unwrap();
        if request.number == 2 {
            write!(stream, "HTTP/1.1 200 OK\r\netag: \"1\"\r\ncontent-length: {LENGTH}\r\n\r\n")?;
            return (0..1000).try_for_each(|_| stream.write_all(&[7; 4096]));
        }
        let (last, etag) = (last.min(LENGTH - 1), "etag: \"1\"");
        let count = last + 1 - first;
        let range = format!("content-range: bytes {first}-{last}/{LENGTH}");
        write!(stream, "HTTP/1.1 206 Part\r\n{etag}\r\n{range}\r\ncontent-length: {count}\r\n\r\n")?;
        stream.write_all(&vec![7; count as usize])
    });
    let path = server.path("a.ply");
    codec::trust_address(&path);
    let mut part = [0; 100];
    codec::Bytes::open(&path).unwrap().read_at(1 << 30, &mut part).unwrap();
    assert_eq!((part, server.requests()), ([7; 100], 3));
}

#[test]
fn parts_behind_a_redirect_lie_beside_its_target() {
    let Some(data) = data() else { return };
    let root = data.join("ept/1.2-with-color");
    let server = Server::new(move |request, stream| {
        let (path, query) = request.path.split_once('?').unwrap_or((&request.path, ""));
        let target = match (path, query) {
            ("/short/ept.json", "token=abc") => "/long//1/?token=def",
            ("/long//1/", "token=def") => "ept.json?token=def",
            _ => "",
        };
        if !target.is_empty() {
            return write!(stream, "HTTP/1.1 302 Found\r\nlocation: {target}\r\ncontent-length: 0\r\n\r\n");
        }
        let name = path.strip_prefix("/long//1/").filter(|_| query == "token=def").unwrap_or("nothing");
        match fs::read(root.join(name)) {
            Ok(file) => send_part(&file, "etag: \"1\"\r\n", request, stream),
            Err(_) => write!(stream, "HTTP/1.1 404 No\r\ncontent-length: 0\r\n\r\n"),
        }
    });
    let expected = points(&codec::open(&data.join("ept/1.2-with-color/ept.json")).unwrap());
    let source = open(&server.path("short/ept.json?token=abc")).unwrap();
    assert!(points(&source) == expected);
}

#[test]
fn files_that_a_server_sends_on_one_by_one_open_with_their_parts() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tile.ply"), ply(100, 1.0)).unwrap();
    let item = r#"{"assets":{"data":{"href":"./tile.ply"}}}"#;
    let catalogue = format!(r#"{{"type":"FeatureCollection","features":[{item}]}}"#);
    fs::write(folder.path().join("all.vpc"), catalogue).unwrap();
    for (root, name) in [(data.join("ept/1.2-with-color"), "ept.json"), (folder.path().to_owned(), "all.vpc")] {
        let own = root.clone();
        // A store, which has each file under a number, with a key that opens it alone.
        let names: Mutex<Vec<String>> = Mutex::default();
        let server = Server::new(move |request, stream| {
            let mut names = names.lock().unwrap();
            if let Some(name) = request.path.strip_prefix("/dl/") {
                names.push(name.to_owned());
                let number = names.len() - 1;
                let target = format!("/blob/uuid{number}?sig={number}");
                return write!(stream, "HTTP/1.1 302 Found\r\nlocation: {target}\r\ncontent-length: 0\r\n\r\n");
            }
            let number = request.path.rsplit_once('=').and_then(|(_, number)| number.parse::<usize>().ok());
            let number = number.filter(|number| request.path == format!("/blob/uuid{number}?sig={number}"));
            let file = number.and_then(|number| fs::read(own.join(names.get(number)?)).ok());
            drop(names);
            match file {
                Some(file) => send_part(&file, "etag: \"1\"\r\n", request, stream),
                None => write!(stream, "HTTP/1.1 403 No\r\ncontent-length: 0\r\n\r\n"),
            }
        });
        let expected = points(&codec::open(&root.join(name)).unwrap());
        let source = open(&server.path(&format!("dl/{name}"))).unwrap();
        assert!(points(&source) == expected, "{name}");
        // Each part is asked for under its own name, with credentials.
        let asked = server.asked();
        let named: Vec<_> = asked.iter().filter(|request| request.path.starts_with("/dl/")).collect();
        assert!(named.len() > 1 && named.iter().all(|request| request.header("authorization").is_some()), "{name}");
    }
}

#[test]
fn what_a_server_is_no_server_of_is_said_at_once() {
    let told = message(Path::new(&format!("http://{}.invalid/a.laz", "a".repeat(64))));
    assert!(told.contains("no such server"), "{told}");
    assert!(message(Path::new("http://127.0.0.1:99999/a.laz")).contains("`99999` is no port"));
    // One that does not speak https.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, asked) = (listener.local_addr().unwrap(), Arc::new(AtomicU64::new(0)));
    let own = asked.clone();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            own.fetch_add(1, Ordering::Relaxed);
            let mut hello = [0; 64];
            let _ = std::io::Read::read(&mut stream, &mut hello);
            let _ = write!(stream, "HTTP/1.1 400 Bad Request\r\ncontent-length: 0\r\n\r\n");
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
    });
    let told = message(Path::new(&format!("https://{address}/a.laz")));
    assert!(told.contains("does not speak https"), "{told}");
    assert_eq!(asked.load(Ordering::Relaxed), 1);
}
