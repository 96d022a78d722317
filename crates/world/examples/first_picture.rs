//! Measures how soon a folder of LAZ tiles is seen while its index is made: the time, and the bytes that were read, until the
//! first points of compressed chunks show each tile, until the tile that is read last in the order of files shows decoded
//! points while a view looks at it from then on, and until all of them do.
//!
//! ```
//! cargo run --release -p stream --example make_scan -- 3000000 tile.laz
//! GLINT_CACHE_DIR=/some/new/folder cargo run --release -p world --example first_picture -- tile.laz 20 FOLDER
//! ```
//!
//! FOLDER gets 20 x 20 tiles side by side, unless it has some: copies of the scan whose headers state other places. The bytes
//! are those that the system counts (Linux). `docs/streaming.md` has the figures.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cloud::PointTest;
use glam::{DVec2, DVec3, IVec2};
use scene::{Camera, Settings};
use world::{Event, Input, StreamView};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The places in a header of the offsets of x and y, of their greatest values and of their least ones.
const PLACES: [[usize; 2]; 3] = [[155, 163], [179, 195], [187, 203]];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scan, side, folder] = arguments.as_slice() else {
        return Err("usage: first_picture SCAN.laz TILES_ALONG_A_SIDE FOLDER".into());
    };
    measure(&fs::read(scan)?, side.parse()?, Path::new(folder))
}

/// Two numbers of a header.
fn pair(file: &[u8], places: [usize; 2]) -> Result<DVec2> {
    let number = |at: usize| Some(f64::from_le_bytes(*file.get(at..)?.first_chunk()?));
    let [x, y] = places.map(number);
    Ok(DVec2::new(x.ok_or("no header")?, y.ok_or("no header")?))
}

/// The tiles of a folder, which are written if they are missing.
fn tiles(scan: &[u8], side: usize, width: DVec2, folder: &Path) -> Result<Vec<PathBuf>> {
    fs::create_dir_all(folder)?;
    let mut file = scan.to_vec();
    let mut files = Vec::new();
    for index in 0..side * side {
        let path = folder.join(format!("{index:05}.laz"));
        if !path.exists() {
            let moved = width * DVec2::new((index % side) as f64, (index / side) as f64);
            for places in PLACES {
                let values = pair(scan, places)? + moved;
                for (at, value) in places.into_iter().zip(values.to_array()) {
                    file[at..at + 8].copy_from_slice(&value.to_le_bytes());
                }
            }
            fs::write(&path, &file)?;
        }
        files.push(path);
    }
    Ok(files)
}

fn bytes_read() -> Result<f64> {
    let counts = fs::read_to_string("/proc/self/io")?;
    let count = counts.lines().find_map(|line| line.strip_prefix("rchar: ")).ok_or("no count of bytes")?;
    Ok(count.parse()?)
}

/// A view of a tile from above.
fn above(settings: &Settings, middle: DVec2, width: f64) -> StreamView {
    StreamView {
        camera: Camera::looking(middle.extend(0.0), DVec3::Z, 2.0 * width, DVec3::Y),
        size: [1400, 900],
        view: settings.view.clone(),
        stream: settings.stream.clone(),
        mirrors: Vec::new(),
        hidden: BTreeSet::new(),
        placed: BTreeMap::new(),
        test: PointTest::default(),
        asked: BTreeSet::new(),
        share: 1.0,
        is_alone: false,
    }
}

fn measure(scan: &[u8], side: usize, folder: &Path) -> Result<()> {
    let least = pair(scan, PLACES[2])?;
    // Whole metres keep all tiles on one grid.
    let width = (pair(scan, PLACES[1])? - least).ceil();
    let files = tiles(scan, side, width, folder)?;
    let (start, before) = (Instant::now(), bytes_read()?);
    let say = |what: &str, points: usize| -> Result<()> {
        let (seconds, bytes) = (start.elapsed().as_secs_f64(), (bytes_read()? - before) / 1e6);
        println!("{what}: {seconds:.2} s, {bytes:.1} MB read, {points} points");
        Ok(())
    };
    let input = Input::Tiles { folder: folder.to_owned(), files };
    let settings = Settings::default();
    let job = world::start(vec![input], &settings, BTreeSet::new());
    // The tiles that are seen, and the points: first those of compressed chunks, then decoded ones.
    let mut seen = [BTreeSet::new(), BTreeSet::new()];
    let mut points = [0, 0];
    for event in &job.events {
        match event {
            Event::Opened { opened, .. } => say(&format!("opened, {} points in all", opened.expected_points), 0)?,
            Event::Failed { error, .. } => return Err(error.into()),
            Event::Chunk { chunk, .. } => {
                let is_decoded = usize::from(chunk.radii.is_none());
                if points[is_decoded] == 0 {
                    say(["first chunk of first points", "first chunk of decoded points"][is_decoded], chunk.len())?;
                }
                points[is_decoded] += chunk.len();
                let last = IVec2::splat(side as i32 - 1);
                let place = |index| (chunk.position(index).truncate() - least) / width;
                let tile = |index| place(index).as_ivec2().clamp(IVec2::ZERO, last).to_array();
                let known = seen[is_decoded].len();
                let is_new = is_decoded == 1 && !seen[1].contains(&last.to_array());
                seen[is_decoded].extend((0..chunk.len()).map(tile));
                if is_new && seen[1].contains(&last.to_array()) {
                    say("the tile that is looked at has decoded points", points[1])?;
                }
                if known < side * side && seen[is_decoded].len() >= side * side {
                    let what = ["each tile has first points", "each tile has decoded points"][is_decoded];
                    say(what, points[is_decoded])?;
                    if is_decoded == 0 {
                        job.mailbox.set_view(above(
                            &settings,
                            least + width * DVec2::splat(side as f64 - 0.5),
                            width.x,
                        ));
                    }
                    if is_decoded == 1 {
                        return Ok(());
                    }
                }
            }
            _ => {}
        }
    }
    Err("not all tiles were seen".into())
}
