//! Calls the parsers as the program does, and checks what must hold of their results.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{Shutdown, TcpListener};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use cloud::{CHUNK_POINTS, Chunk, Progress};
use codec::{Selection, Source};
use glam::DVec3;
use scene::{Camera, Preferences, SceneFile};
use stream::{NodeTable, Pages};
use study::Plan;

/// A read is cancelled after this many points, since a few bytes may rightly stand for billions.
const MOST_POINTS: u64 = 1 << 20;
/// The bytes of memory that decoders may take: half of the ceiling for inputs of any length.
const DECODER_MEMORY: u64 = 32 << 20;
/// The most scans of a file that are read.
const MOST_READ: usize = 4;
/// The highest number of a record that is read alone: its compressed chunk is decoded up to it.
const MOST_RECORDS: u64 = 1 << 16;

/// Reads a file of points: all of it, its positions alone, single records, triangles, and the nodes of COPC.
pub fn cloud(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let path = folder.join("cloud");
    put(&path, bytes)?;
    let unnamed = codec::unnamed_table(&path);
    if let Some(table) = unnamed.filter(|table| table.lines.is_empty() || table.names.len() < 3) {
        return Err(format!("{} lines and {} columns of a table", table.lines.len(), table.names.len()));
    }
    let Ok(scans) = codec::open_scans(&path, DECODER_MEMORY) else { return Ok(0) };
    let mut decoded = 0;
    for source in scans.into_iter().take(MOST_READ) {
        decoded += scan(source)?;
    }
    Ok(decoded)
}

/// Reads an EPT of one page and one tile. Its three files come as one, as [`join`] puts them.
pub fn ept(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let root = folder.join("ept");
    let [description, page, tile] = split(bytes);
    for (name, bytes) in [
        ("ept.json", description),
        ("ept-hierarchy/0-0-0-0.json", page),
        ("ept-data/0-0-0-0.bin", tile),
        ("ept-data/0-0-0-0.zst", tile),
        ("ept-data/0-0-0-0.laz", tile),
    ] {
        let path = root.join(name);
        fs::create_dir_all(path.parent().unwrap_or(&root)).map_err(|error| error.to_string())?;
        put(&path, bytes)?;
    }
    let Ok(scans) = codec::open_scans(&root.join("ept.json"), DECODER_MEMORY) else { return Ok(0) };
    scans.into_iter().map(scan).sum()
}

/// Reads a catalogue, but opens none of its tiles: a changed name might be that of any file or server.
pub fn catalogue(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let path = folder.join("all.vpc");
    put(&path, bytes)?;
    let Ok(Some(tiles)) = codec::tiles_of(&path) else { return Ok(0) };
    match tiles.iter().find(|tile| tile.bounds.is_some_and(|bounds| bounds.is_empty())) {
        Some(tile) => Err(format!("the box of {} is empty", tile.path.display())),
        None if tiles.is_empty() => Err("a catalogue without tiles".into()),
        None => Ok(0),
    }
}

/// A server on this machine, and what it answers to each request.
struct Answerer {
    address: String,
    answer: Arc<Mutex<Vec<u8>>>,
}

impl Answerer {
    fn start() -> std::io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let address = format!("http://{}/a.las", listener.local_addr()?);
        let answer = Arc::<Mutex<Vec<u8>>>::default();
        let own = answer.clone();
        std::thread::spawn(move || {
            for mut stream in listener.incoming().flatten() {
                let Ok(copy) = stream.try_clone() else { continue };
                let lines = BufReader::new(copy).lines().map_while(Result::ok);
                lines.take_while(|line| !line.is_empty()).for_each(drop);
                let answer = own.lock().unwrap_or_else(PoisonError::into_inner).clone();
                // A reader that has seen enough closes the connection.
                let _ = stream.write_all(&answer);
                let _ = stream.shutdown(Shutdown::Both);
            }
        });
        // Nothing is kept on the disk, and no request is made again.
        codec::use_network(codec::Network { waits: &[], ..Default::default() }).map_err(std::io::Error::other)?;
        codec::trust_address(Path::new(&address));
        Ok(Self { address, answer })
    }
}

/// Reads a file from a server that answers each request with these bytes.
pub fn answers(_: &Path, bytes: &[u8]) -> Result<u64, String> {
    static SERVER: OnceLock<std::io::Result<Answerer>> = OnceLock::new();
    let Answerer { address, answer } = SERVER.get_or_init(Answerer::start).as_ref().map_err(ToString::to_string)?;
    *answer.lock().unwrap_or_else(PoisonError::into_inner) = bytes.to_vec();
    let Ok(scans) = codec::open_scans(Path::new(address), DECODER_MEMORY) else { return Ok(0) };
    scans.into_iter().take(MOST_READ).map(scan).sum()
}

fn scan(source: Source) -> Result<u64, String> {
    let attributes = vec![true; source.info().attributes.len()];
    let everything = Selection { positions: true, colors: true, normals: true, attributes };
    let all = read(&source, &everything)?;
    if let Some(first) = source.first_points(&everything, CHUNK_POINTS) {
        check_chunk(&first, CHUNK_POINTS)?;
    }
    let positions = read(&source, &Selection { positions: true, ..Selection::default() })?;
    let mut decoded = all + positions;
    let points = source.info().points;
    for point in [0, points / 2, points.saturating_sub(1)] {
        let point = point.min(MOST_RECORDS);
        // An error for a damaged record is as good as the record.
        let _ = source.record(point);
        decoded += point;
    }
    if source.is_mesh() {
        let _ = source.triangles();
    }
    if let Some(pages) = Pages::copc(&Arc::new(source), &BTreeSet::new()) {
        decoded += nodes(&pages)?;
        lists(&Arc::new(pages));
    }
    Ok(decoded)
}

/// Reads pages of a list of nodes, some of the latest needed by a view.
fn lists(pages: &Arc<Pages>) {
    let Some(mut table) = NodeTable::new(pages) else { return };
    let mut lost = BTreeSet::new();
    for _ in 0..MOST_READ {
        let mut unread = table.octree().paged.unread.keys().rev();
        let Some(place) = unread.find(|place| !lost.contains(*place)).copied() else { return };
        let Some(page) = table.page(place) else { return };
        match pages.read_list(page) {
            Ok(found) => {
                if !table.put(place, found) {
                    return;
                }
                table.use_nodes([place.0]);
            }
            Err(_) => drop(lost.insert(place)),
        }
    }
}

fn read(source: &Source, selection: &Selection) -> Result<u64, String> {
    let progress = Progress::default();
    let decoded = AtomicU64::new(0);
    let problem = Mutex::new(None);
    let outcome = source.read(selection, &progress, &|chunk| {
        if let Err(found) = check_chunk(&chunk, CHUNK_POINTS) {
            problem.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(found);
        }
        let before = decoded.fetch_add(chunk.len() as u64, Ordering::Relaxed);
        if before + chunk.len() as u64 >= MOST_POINTS {
            progress.cancel();
        }
    });
    if let Some(problem) = problem.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(problem);
    }
    let (decoded, promised) = (decoded.into_inner(), source.info().points);
    match outcome {
        Ok(summary) if summary.points != decoded => {
            Err(format!("a read of {decoded} points says that it read {}", summary.points))
        }
        Ok(_) if decoded > promised => Err(format!("{decoded} points were read of a file of {promised}")),
        _ => Ok(decoded),
    }
}

/// Checks that every column of a chunk has as many values as the chunk has points.
fn check_chunk(chunk: &Chunk, most: usize) -> Result<(), String> {
    let points = chunk.len();
    if points > most {
        return Err(format!("a chunk of {points} points, expected {most} at most"));
    }
    let columns = chunk.columns.iter().flatten().map(|column| column.len());
    let lengths = columns
        .chain(chunk.colors.as_ref().map(|values| values.len()))
        .chain(chunk.normals.as_ref().map(|values| values.len()))
        .chain(chunk.radii.as_ref().map(|values| values.len()))
        .chain(chunk.exact_positions.as_ref().map(|values| values.len()));
    match lengths.into_iter().find(|length| *length != points) {
        Some(length) => Err(format!("a column of {length} values in a chunk of {points} points")),
        None => Ok(()),
    }
}

/// Reads an index, whose files `nodes`, `pages` and `surfels` come as one, as [`join`] puts them.
pub fn index(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let entry = folder.join("index");
    fs::create_dir_all(&entry).map_err(|error| error.to_string())?;
    for (name, bytes) in ["nodes", "pages", "surfels"].into_iter().zip(split(bytes)) {
        put(&entry.join(name), bytes)?;
    }
    match Pages::open(&entry) {
        Ok(pages) => nodes(&pages),
        Err(_) => Ok(0),
    }
}

/// Reads all nodes of an octree, except those that are too large.
fn nodes(pages: &Pages) -> Result<u64, String> {
    let octree = pages.octree();
    let own: u64 = octree.nodes.iter().map(|node| u64::from(node.points)).sum();
    if octree.points() != own {
        return Err(format!("the root has {} points below it, its nodes have {own}", octree.points()));
    }
    let mut decoded = 0;
    for (id, node) in octree.ids() {
        let in_tree = node.parent.is_none_or(|parent| octree.node(parent).children.contains(&Some(id)));
        if !in_tree || node.bounds.is_empty() {
            return Err(format!("node {} is no child of its parent, or holds no place", id.0));
        }
        // The streamer's budget refuses larger nodes of COPC files; the reader does not.
        if node.points as usize > CHUNK_POINTS || decoded > MOST_POINTS {
            continue;
        }
        let Ok(chunk) = pages.read(id) else { continue };
        check_chunk(&chunk, node.points as usize)?;
        if chunk.len() != node.points as usize {
            return Err(format!("node {} has {} points, expected {}", id.0, chunk.len(), node.points));
        }
        decoded += chunk.len() as u64;
    }
    Ok(decoded)
}

/// Reads a scene file. What was read can be written, and is the same when it is read again.
pub fn scene(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let path = folder.join("scene.toml");
    put(&path, bytes)?;
    let Ok((file, _)) = SceneFile::read(&path) else { return Ok(0) };
    let text = file.to_text();
    match SceneFile::parse(&text) {
        Ok(again) if again.to_text() == text => Ok(0),
        Ok(_) => Err("a scene is another one once it is written and read".into()),
        Err(error) => Err(format!("a scene cannot be read once it is written: {error}")),
    }
}

/// Reads a view, as `--camera` and the clipboard give it.
pub fn view(_: &Path, bytes: &[u8]) -> Result<u64, String> {
    let Ok(file) = SceneFile::parse(&String::from_utf8_lossy(bytes)) else { return Ok(0) };
    let view = file.view();
    let level = Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z);
    let written = SceneFile::new(Vec::new(), view.camera.unwrap_or(level), &view.settings);
    match SceneFile::parse(&written.to_text()) {
        Ok(again) if again.view().settings == view.settings => Ok(0),
        Ok(_) => Err("the parameters of a view are others once it is written and read".into()),
        Err(error) => Err(format!("a view cannot be read once it is written: {error}")),
    }
}

/// Reads a plan of a study, and all of its settings.
pub fn plan(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let path = folder.join("plan.toml");
    put(&path, bytes)?;
    let Ok(plan) = Plan::read(&path) else { return Ok(0) };
    let cases = plan.cases();
    if cases.iter().enumerate().any(|(index, case)| case.index != index || case.group >= plan.groups.len()) {
        return Err("a setting is not at its place in the plan".into());
    }
    match Plan::parse("again", &plan.to_text()) {
        Ok(again) if again == plan => Ok(0),
        Ok(_) => Err("a plan is another one once it is written and read".into()),
        Err(error) => Err(format!("a plan cannot be read once it is written: {error}")),
    }
}

/// Reads preferences, and the parameters in them.
pub fn preferences(folder: &Path, bytes: &[u8]) -> Result<u64, String> {
    let path = folder.join("viewer.toml");
    put(&path, bytes)?;
    let Ok(text) = scene::whole_file::read(&path) else { return Ok(0) };
    let Ok(preferences) = Preferences::parse(&text) else { return Ok(0) };
    let (settings, _) = preferences.settings();
    let mut kept = preferences.clone();
    kept.remember_settings(&settings);
    match Preferences::parse(&kept.to_text()) {
        Ok(again) if again == kept => Ok(0),
        Ok(_) => Err("preferences are others once they are written and read".into()),
        Err(error) => Err(format!("preferences cannot be read once they are written: {error}")),
    }
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), String> {
    fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
}

/// The bytes before the three files of an index: they hold the lengths of the first two.
const LENGTHS: usize = 8;

/// Joins three files into one.
pub fn join(files: [&[u8]; 3]) -> Vec<u8> {
    let lengths = [files[0].len() as u32, files[1].len() as u32].map(u32::to_le_bytes);
    [lengths.as_flattened(), files[0], files[1], files[2]].concat()
}

/// Splits joined files. A length that is too large ends with the bytes.
pub fn split(bytes: &[u8]) -> [&[u8]; 3] {
    let (lengths, rest) = bytes.split_at(bytes.len().min(LENGTHS));
    let length = |at: usize| {
        lengths.get(at..at + 4).map_or(0, |length| u32::from_le_bytes([length[0], length[1], length[2], length[3]]))
    };
    let (nodes, rest) = rest.split_at(rest.len().min(length(0) as usize));
    let (pages, surfels) = rest.split_at(rest.len().min(length(4) as usize));
    [nodes, pages, surfels]
}
