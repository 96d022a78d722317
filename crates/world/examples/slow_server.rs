//! Measures clouds behind a slow server: the time until the first points and until all points of the first picture are
//! there, the requests, and the bytes that were fetched for each byte of points that the picture needs.
//!
//! ```
//! cargo run --release -p stream --example make_scan -- 20000000 scan.las
//! cargo run --release -p world --example slow_server -- scan.las FOLDER
//! ```
//!
//! FOLDER gets the scan as COPC and as EPT, and 200 small COPC tiles with a catalogue, unless it has them. A server on this
//! machine answers each request after 80 ms and sends 20 Mbit a second, first as it should, then with one request in ten that
//! fails. `docs/streaming.md` has the figures.

#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "tests use all of it")]
mod server;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::Progress;
use codec::{Copc, Selection, Source};
use scene::Settings;
use server::{Habits, Server};
use world::{Event, Input, Part};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const MEMORY: u64 = 1 << 30;
const LATENCY: Duration = Duration::from_millis(80);
/// 20 Mbit a second, in bytes.
const RATE: u64 = 2_500_000;
/// The number of points in the picture.
const BUDGET: u32 = 1_000_000;
/// The tiles of the catalogue along x and y, and the points of each.
const TILES: [u32; 2] = [20, 10];
const TILE_POINTS: u64 = 20_000;
/// The levels of nodes that a page of the hierarchy has.
const PAGE_LEVELS: u32 = 4;
/// The offsets of the centre in a COPC file, of the offset of coordinates and of the greatest and least x, y and z.
const CENTER: usize = 375 + 54;
const OFFSET: usize = 155;
const GREATEST: usize = 179;

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [scan, folder] = arguments.as_slice() else {
        return Err("usage: slow_server SCAN.las FOLDER".into());
    };
    prepare(scan, folder)?;
    let fetched = tempfile::tempdir()?;
    codec::use_network(codec::Network { folder: Some(fetched.path().to_owned()), ..Default::default() })?;
    println!("| cloud | failing | opening | first points | whole picture | requests | fetched | needed | ratio |");
    println!("|---|---|---|---|---|---|---|---|---|");
    for fails in [0, 10] {
        for name in ["scan.copc.laz", "ept/ept.json", "tiles/all.vpc"] {
            let server = Server::of_folder(folder, Habits { latency: LATENCY, rate: RATE, fails });
            let path = server.path(name);
            codec::trust_address(&path);
            let sources = world::open_file(&folder.join(name), MEMORY)?;
            for opening in ["first", "second"] {
                let (requests, bytes) = (server.requests(), server.bytes());
                let found = open(&path)?;
                let (requests, bytes) = (server.requests() - requests, server.bytes() - bytes);
                let needed: u64 = found.nodes.iter().map(|node| bytes_of(&sources, node)).sum();
                let failing = if fails > 0 { format!("1 in {fails}") } else { "none".into() };
                println!(
                    "| {name} | {failing} | {opening} | {:.1} s | {:.1} s | {requests} | {:.1} MB | {:.1} MB | {:.2} |",
                    found.first.as_secs_f64(),
                    found.whole.as_secs_f64(),
                    bytes as f64 / 1e6,
                    needed as f64 / 1e6,
                    bytes as f64 / needed.max(1) as f64,
                );
            }
        }
    }
    Ok(())
}

/// What an opening has come to.
struct Found {
    first: Duration,
    whole: Duration,
    /// The nodes in the picture: the number of the tile, and that of the node.
    nodes: BTreeSet<(usize, usize)>,
}

/// Opens a cloud, and waits until all points of its first picture are there.
fn open(path: &Path) -> Result<Found> {
    let mut settings = Settings::default();
    settings.stream.pages = scene::Paging::Always;
    settings.view.point_budget = BUDGET;
    let start = Instant::now();
    let job = world::start(vec![Input::File(path.to_owned())], &settings, BTreeSet::new());
    let mut first = None;
    let mut nodes = BTreeSet::new();
    for event in &job.events {
        match event {
            Event::Chunk { part, .. } => {
                first.get_or_insert_with(|| start.elapsed());
                nodes.extend(node_of(part));
            }
            Event::Dropped { part, .. } => {
                node_of(part).map(|node| nodes.remove(&node));
            }
            Event::Stream(stats) if stats.is_settled => break,
            Event::Failed { error, .. } => eprintln!("{error}"),
            Event::Finished => break,
            _ => {}
        }
    }
    let whole = start.elapsed();
    job.stop();
    // The files are closed when the job has ended.
    for _ in job.events.iter() {}
    Ok(Found { first: first.ok_or("no points came")?, whole, nodes })
}

/// The tile and the node of a part.
fn node_of(part: Part) -> Option<(usize, usize)> {
    match part {
        Part::Node(node) => Some((0, node.0 as usize)),
        Part::Tile(tile, node) => Some((tile as usize, node.0 as usize)),
        Part::Preview(_) | Part::Block(_) => None,
    }
}

fn bytes_of(sources: &[Arc<Source>], (cloud, node): &(usize, usize)) -> u64 {
    let copc = sources.get(*cloud).and_then(|source| source.copc());
    copc.and_then(|copc| copc.nodes.get(*node)).map_or(0, |node| node.bytes)
}

/// Makes what is measured, unless it is there.
fn prepare(scan: &Path, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let copc = folder.join("scan.copc.laz");
    if !copc.exists() {
        codec::write_copc(&[scan.to_owned()], &copc, MEMORY, &Progress::default())?;
    }
    if !folder.join("ept").exists() {
        write_ept(&codec::open(&copc)?, &folder.join("ept"))?;
    }
    if !folder.join("tiles").exists() {
        write_tiles(scan, &folder.join("tiles"))?;
    }
    Ok(())
}

/// Writes a COPC file as EPT with binary tiles.
fn write_ept(source: &Source, folder: &Path) -> Result<()> {
    let copc: &Copc = source.copc().ok_or("not COPC")?;
    let grid = source.info().grid.ok_or("a COPC file has a grid")?;
    for part in ["ept-data", "ept-hierarchy"] {
        fs::create_dir_all(folder.join(part))?;
    }
    let name = |level: u32, [x, y, z]: [u32; 3]| format!("{level}-{x}-{y}-{z}");
    let selection = Selection { positions: true, colors: true, ..Selection::default() };
    let mut pages: std::collections::BTreeMap<String, Vec<String>> = Default::default();
    for node in &copc.nodes {
        let own = name(node.level, node.cell);
        let page_of = |level: u32| {
            let top = level / PAGE_LEVELS * PAGE_LEVELS;
            name(top, node.cell.map(|cell| cell >> (node.level - top)))
        };
        if node.level > 0 && node.level.is_multiple_of(PAGE_LEVELS) {
            pages.entry(page_of(node.level - 1)).or_default().push(format!("\"{own}\": -1"));
        }
        pages.entry(page_of(node.level)).or_default().push(format!("\"{own}\": {}", node.points));
        if node.points == 0 {
            continue;
        }
        let chunk = source.read_copc_node(node, &selection)?;
        let colors = chunk.colors.clone().ok_or("the scan has colours")?;
        let mut bytes = Vec::with_capacity(18 * chunk.len());
        for (index, color) in colors.iter().enumerate() {
            let steps = ((chunk.position(index) - grid.offset) / grid.scale).round();
            bytes.extend(steps.to_array().iter().flat_map(|step| (*step as i32).to_le_bytes()));
            bytes.extend(color[..3].iter().flat_map(|value| (u16::from(*value) * 257).to_le_bytes()));
        }
        fs::write(folder.join(format!("ept-data/{own}.bin")), bytes)?;
    }
    for (top, entries) in pages {
        fs::write(folder.join(format!("ept-hierarchy/{top}.json")), format!("{{{}}}", entries.join(",")))?;
    }
    let axis = |axis: usize, name: &str| {
        let (scale, offset) = (grid.scale[axis], grid.offset[axis]);
        format!("{{\"name\":\"{name}\",\"type\":\"signed\",\"size\":4,\"scale\":{scale},\"offset\":{offset}}}")
    };
    let color = |name: &str| format!("{{\"name\":\"{name}\",\"type\":\"unsigned\",\"size\":2}}");
    let schema = [axis(0, "X"), axis(1, "Y"), axis(2, "Z"), color("Red"), color("Green"), color("Blue")].join(",");
    let bounds = source.info().bounds.ok_or("a COPC file has bounds")?;
    let corners = |min: [f64; 3], max: [f64; 3]| format!("{:?}", [min, max].as_flattened());
    let cube = corners(copc.corner.to_array(), (copc.corner + copc.width).to_array());
    let conforming = corners(bounds.min.to_array(), bounds.max.to_array());
    let (points, span) = (source.info().points, (copc.width / copc.spacing).round());
    let text = format!(
        "{{\"bounds\":{cube},\"boundsConforming\":{conforming},\"dataType\":\"binary\",\"hierarchyType\":\"json\",\
         \"points\":{points},\"schema\":[{schema}],\"span\":{span},\"version\":\"1.0.0\"}}"
    );
    Ok(fs::write(folder.join("ept.json"), text)?)
}

/// Writes the first points of a scan as many tiles beside one another, each at its own place.
fn write_tiles(scan: &Path, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let (part, model) = (folder.join("part.las"), folder.join("model.copc.laz"));
    // The head of the LAS file that has only some of its points: the file is cut behind them.
    let source = codec::open(scan)?;
    let bytes = fs::read(scan)?;
    let start = u32::from_le_bytes(bytes[96..100].try_into()?) as usize;
    let length = usize::from(u16::from_le_bytes(bytes[105..107].try_into()?));
    let mut own = bytes[..(start + length * TILE_POINTS as usize).min(bytes.len())].to_vec();
    own[247..255].copy_from_slice(&TILE_POINTS.min(source.info().points).to_le_bytes());
    fs::write(&part, own)?;
    codec::write_copc(std::slice::from_ref(&part), &model, MEMORY, &Progress::default())?;
    let bytes = fs::read(&model)?;
    let copc = codec::open(&model)?;
    let width = copc.copc().ok_or("not COPC")?.width;
    let mut paths = Vec::new();
    for (x, y) in (0..TILES[0]).flat_map(|x| (0..TILES[1]).map(move |y| (x, y))) {
        let mut own = bytes.clone();
        for (axis, step) in [(0, x), (1, y)] {
            let moved = f64::from(step) * width.ceil();
            for at in [CENTER + 8 * axis, OFFSET + 8 * axis, GREATEST + 16 * axis, GREATEST + 16 * axis + 8] {
                let value = f64::from_le_bytes(own[at..at + 8].try_into()?) + moved;
                own[at..at + 8].copy_from_slice(&value.to_le_bytes());
            }
        }
        paths.push(folder.join(format!("{x}-{y}.copc.laz")));
        fs::write(&paths[paths.len() - 1], own)?;
    }
    for path in [part, model] {
        fs::remove_file(path)?;
    }
    let sources: Vec<Source> = paths.iter().map(|path| codec::open(path)).collect::<codec::Result<_>>()?;
    let tile = |source| {
        let info = Source::info(source);
        let bounds = info.bounds.ok_or("a COPC file has bounds")?;
        Ok(codec::CatalogueTile { info, points: info.points, bounds })
    };
    let tiles: Vec<_> = sources.iter().map(tile).collect::<Result<_>>()?;
    codec::write_catalogue(&tiles, &folder.join("all.vpc"))?;
    Ok(())
}
