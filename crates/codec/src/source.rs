//! An opened file of any format.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Bounds, Chunk, Placement, Progress};

use crate::at_once::at_once;
use crate::bytes::Bytes;
use crate::error::{Error, Result};
use crate::info::{Info, Selection, Summary};
use crate::las::{Copc, CopcNode, CopcPage, PageNodes};
use crate::{catalogue, e57, ept, las, pcd, ply, text};

/// An opened file. It is `Sync`: one thread may read a column while another looks up a record.
#[allow(clippy::large_enum_variant, reason = "there is one per open file, and it is not moved around")]
pub enum Source {
    Las(las::LasSource),
    Rows(ply::RowSource),
    Ept(ept::EptSource),
}

/// The memory in bytes that the decoders of a file may take by default.
const DECODER_MEMORY: u64 = 1 << 30;

/// Opens a file according to its content, not its name: the first of its scans, if it holds several.
///
/// # Errors
/// Says what is wrong and where: not readable, not a known format, a header that contradicts the file.
pub fn open(path: &Path) -> Result<Source> {
    open_within(path, DECODER_MEMORY)
}

/// Opens a file as `open` does, for decoders that take no more than `memory` bytes together, besides the decoded points.
/// Fewer decoders run at a time where points are long (a decoder of LAZ takes some kilobytes for each byte of a point).
///
/// # Errors
/// Those of `open`; if a single decoder would take more.
pub fn open_within(path: &Path, memory: u64) -> Result<Source> {
    let first = open_scans(path, memory)?.into_iter().next();
    first.ok_or_else(|| Error::unsuitable(path, "a file without scans"))
}

/// All scans of a file, each a cloud of its own; one, if its format has no scans. Of a catalogue, all of its tiles.
///
/// # Errors
/// Those of `open_within`.
pub fn open_scans(path: &Path, memory: u64) -> Result<Vec<Source>> {
    Bytes::open_twice(path, Bytes::open, |bytes| {
        let mut start = [0; 64];
        let count = bytes.read_at(0, &mut start).map_err(|error| Error::io(path, error))?;
        match catalogue::is_catalogue(&start[..count], path) {
            true => open_tiles(&bytes, memory),
            false => open_file(bytes, memory),
        }
    })
}

/// The number of tiles of a catalogue that are opened at once.
const TILES_AT_ONCE: usize = 8;

/// Opens the tiles of a catalogue. `Info::lost` of the first one says which others cannot be opened.
fn open_tiles(catalogue: &Bytes, memory: u64) -> Result<Vec<Source>> {
    let entries = catalogue::read(catalogue)?;
    let opened = at_once(&entries, TILES_AT_ONCE, |entry| {
        if catalogue::is_catalogue(b"{", &entry.path) {
            return Err(Error::unsuitable(&entry.path, "a catalogue among the tiles of one"));
        }
        Bytes::open_twice(&entry.path, Bytes::open, |bytes| open_file(bytes, memory))
    });
    let (mut sources, mut lost, mut first_error) = (Vec::<Source>::new(), Vec::new(), None);
    let name = param::shown(catalogue.path());
    for (entry, opened) in entries.iter().zip(opened) {
        match opened {
            Ok(mut scans) => {
                let points: u64 = scans.iter().map(|scan| scan.info().points).sum();
                if let (Some(told), Some(first)) = (entry.points.filter(|told| *told != points), scans.first_mut()) {
                    let told = format!("the catalogue {name} says {told} points, the file has {points}");
                    first.info_mut().warnings.push(told);
                }
                sources.extend(scans);
            }
            Err(error) => {
                lost.push(format!("{name}: a tile is missing: {error}"));
                first_error.get_or_insert(error);
            }
        }
    }
    match (sources.first_mut(), first_error) {
        (Some(first), _) => {
            let info = first.info_mut();
            info.lost = param::few(lost, "tiles that are missing");
            info.warnings.extend(catalogue::repeated(&entries));
        }
        (None, Some(error)) => return Err(error),
        (None, None) => {}
    }
    Ok(sources)
}

/// The bounds of a file's points: those of its header, or of all points.
///
/// # Errors
/// If the points cannot be read.
pub fn bounds_of(source: &Source, progress: &Progress) -> Result<Option<Bounds>> {
    if let Some(bounds) = source.info().bounds {
        return Ok(Some(bounds));
    }
    let selection = Selection { positions: true, ..Selection::default() };
    Ok(source.read(&selection, progress, &|_| {})?.bounds)
}

/// Opens a file that is no catalogue.
fn open_file(bytes: Bytes, memory: u64) -> Result<Vec<Source>> {
    let path = &bytes.path().to_owned();
    let mut start = [0; 64];
    let count = bytes.read_at(0, &mut start).map_err(|error| Error::io(path, error))?;
    let start = &start[..count];
    let is_copc = start.starts_with(b"LASF") && las::is_copc(&bytes);
    let is_ept = ept::is_ept(start, path) || ept::is_ept(start, bytes.base());
    if !is_copc && !is_ept {
        // All other formats are read from end to end.
        bytes.fetch_all()?;
    }
    if start.starts_with(b"LASF") {
        return Ok(vec![las::LasSource::open(bytes, memory).map(Source::Las)?]);
    }
    if is_ept {
        return Ok(vec![ept::EptSource::open(bytes, memory).map(Source::Ept)?]);
    }
    let file = Arc::new(bytes);
    let scans = match start {
        start if ply::is_ply(start) => vec![ply::RowSource::open(file)?],
        start if e57::is_e57(start) => e57::open(&file)?,
        start if pcd::is_pcd(start) => vec![pcd::open(&file)?],
        start => match known_other(start) {
            Some(hint) => return Err(Error::UnknownFormat { path: path.to_owned(), hint: hint.into() }),
            None => text::open(&file).unwrap_or_else(|| {
                let hint = "it starts with no signature of a known one, and is no table of numbers".into();
                Err(Error::UnknownFormat { path: path.to_owned(), hint })
            })?,
        },
    };
    Ok(scans.into_iter().map(Source::Rows).collect())
}

/// What a file is that looks like a known thing without points, and what to do about it.
fn known_other(start: &[u8]) -> Option<&'static str> {
    Some(match start {
        [] => "the file is empty",
        [b'~', ..] => "this is a well log (Log ASCII Standard), which shares only the name with LAS point clouds",
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "this is text of 16 bits (UTF-16); write it as ASCII or UTF-8",
        [0x00, 0x05, 0x16, 0x07, ..] => {
            "this is what macOS keeps beside a file of the same name without `._` (AppleDouble)"
        }
        start if is_packed(start) => "this is a compressed file or an archive; unpack it, and open what is in it",
        start if is_model(start) => {
            "this is a tile of 3D Tiles or a model in glTF, which glint does not read; LAS, LAZ, COPC and PLY it reads"
        }
        start if start.trim_ascii_start().starts_with(b"{") => {
            "this is JSON, of which glint reads ept.json of an EPT, and catalogues of tiles (STAC items) if their names end \
             in .vpc; a tileset of 3D Tiles it does not read"
        }
        start if is_web_page(start) => {
            "this is a web page (HTML), as servers answer with where one has to log in first; what it says shows in a browser"
        }
        start if start.starts_with(b"version https://git-lfs") => {
            "this is a pointer of Git LFS, which stands for the file; `git lfs pull` gets the file itself"
        }
        _ => return None,
    })
}

/// Whether a file begins as those of ZIP, gzip, bzip2, XZ, Zstandard or 7-Zip do.
fn is_packed(start: &[u8]) -> bool {
    let known: [&[u8]; 6] = [b"PK\x03\x04", b"\x1f\x8b", b"BZh91AY", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf"];
    known.iter().any(|known| start.starts_with(known))
}

/// Whether a file begins as the tiles of 3D Tiles and binary models in glTF do: with a word and a version.
fn is_model(start: &[u8]) -> bool {
    let (word, version) = start.split_at(start.len().min(4));
    [&b"pnts"[..], b"b3dm", b"i3dm", b"cmpt", b"glTF"].contains(&word) && matches!(version, [1 | 2, 0, ..])
}

fn is_web_page(start: &[u8]) -> bool {
    let text = start.trim_ascii_start().to_ascii_lowercase();
    [&b"<!doctype html"[..], b"<html"].iter().any(|tag| text.starts_with(tag))
}

impl Source {
    fn info_mut(&mut self) -> &mut Info {
        match self {
            Self::Las(source) => &mut source.info,
            Self::Rows(source) => &mut source.info,
            Self::Ept(source) => &mut source.info,
        }
    }

    pub fn info(&self) -> &Info {
        match self {
            Self::Las(source) => source.info(),
            Self::Rows(source) => source.info(),
            Self::Ept(source) => &source.info,
        }
    }

    /// Notes what is wrong with other scans or tiles, which cannot be opened, where those that noted it are left out.
    pub fn lose(&mut self, lost: Vec<String>) {
        let info = match self {
            Self::Las(source) => &mut source.info,
            Self::Rows(source) => &mut source.info,
            Self::Ept(source) => &mut source.info,
        };
        info.lost = lost;
    }

    /// The same file with its points turned and moved: `read` gives them so, and `export` writes them so. `record` still
    /// says what is in the file.
    #[must_use]
    pub fn placed(mut self, placement: Placement) -> Self {
        match &mut self {
            Self::Las(source) => source.info.place(placement),
            Self::Rows(source) => source.info.place(placement),
            Self::Ept(source) => source.info.place(placement),
        }
        self
    }

    /// Whether its colours are more than bytes.
    pub fn has_wide_colors(&self) -> bool {
        match self {
            Self::Las(source) => source.has_wide_colors(),
            Self::Rows(source) => source.has_wide_colors(),
            Self::Ept(source) => source.has_wide_colors(),
        }
    }

    /// Whether its GPS times are standard time rather than seconds of a week; `None` if it has none, or does not say.
    pub(crate) fn standard_time(&self) -> Option<bool> {
        match self {
            Self::Las(source) => source.standard_time(),
            Self::Rows(_) => None,
            Self::Ept(source) => source.standard_time(),
        }
    }

    /// What the points are decoded from.
    pub fn bytes(&self) -> &Bytes {
        match self {
            Self::Las(source) => source.bytes(),
            Self::Rows(source) => source.bytes(),
            Self::Ept(source) => source.bytes(),
        }
    }

    /// The size in bytes of all that the points are read from; of EPT about.
    pub fn stored_bytes(&self) -> u64 {
        match self {
            Self::Ept(source) => source.octree().nodes.iter().map(|node| node.bytes).sum(),
            _ => self.bytes().length(),
        }
    }

    /// Reads the file in parallel and passes each chunk to `emit`, which is called from worker threads in any order
    /// (`Chunk::first_point` is its place; the limits of chunks are the same in every read of the same file).
    /// `progress` counts points; cancelling it ends the read after the chunks in progress. A file that is cut short
    /// yields the points that it has and a warning with the number of missing ones.
    ///
    /// # Errors
    /// Only if nothing at all can be read.
    pub fn read(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        let Info { placement: Some(placement), grid, .. } = self.info() else {
            return self.read_own(selection, progress, emit);
        };
        let bounds = Mutex::new(Bounds::EMPTY);
        let emit_placed = |chunk: Chunk| {
            let chunk = chunk.placed(placement, *grid);
            let own = chunk.bounds();
            let mut bounds = bounds.lock().unwrap_or_else(PoisonError::into_inner);
            *bounds = bounds.union(own);
            drop(bounds);
            emit(chunk);
        };
        let summary = self.read_own(selection, progress, &emit_placed)?;
        let bounds = bounds.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Summary { bounds: (!bounds.is_empty()).then_some(bounds), ..summary })
    }

    /// The first points of at most `most` compressed chunks of a LAZ file, which are read without decoding anything; `None` for
    /// all other files, and for files that are moved. The points are in file order, but others lie between them.
    pub fn first_points(&self, selection: &Selection, most: usize) -> Option<Chunk> {
        match self {
            Self::Las(source) if source.info.placement.is_none() => source.first_points(selection, most),
            _ => None,
        }
    }

    fn read_own(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        let read = match self {
            Self::Las(source) => source.read(selection, progress, emit),
            Self::Rows(source) => source.read(selection, progress, emit),
            Self::Ept(source) => source.read(selection, progress, emit),
        }?;
        let missing = if progress.is_cancelled() { 0 } else { self.info().points.saturating_sub(read.points) };
        Ok(Summary { missing, ..read })
    }

    /// The octree of a COPC file or of EPT; `None` for other files, and if the octree does not fit the file (a warning then says
    /// so).
    pub fn copc(&self) -> Option<&Copc> {
        match self {
            Self::Las(source) => source.copc(),
            Self::Rows(_) => None,
            Self::Ept(source) => Some(source.octree()),
        }
    }

    /// The points of one node of `copc`, in file order (`Chunk::first_point` is the file's). Several threads may read
    /// at once. A node may have up to `Copc::MOST_POINTS`, so the chunk may be larger than others.
    ///
    /// # Errors
    /// If the file is gone, changed or damaged there.
    pub fn read_copc_node(&self, node: &CopcNode, selection: &Selection) -> Result<Chunk> {
        let chunk = match self {
            Self::Las(source) => source.read_copc_node(node, selection)?,
            // A PLY file has no nodes; the node of another file is read as an empty one.
            Self::Rows(_) => Chunk::new(0, glam::DVec3::ZERO, Vec::new()),
            Self::Ept(source) => source.read_node(node, selection)?,
        };
        let Info { placement, grid, .. } = self.info();
        Ok(placement.as_ref().map_or_else(|| chunk.clone(), |placement| chunk.placed(placement, *grid)))
    }

    /// What a page of the list of nodes of `copc` says that was not read at opening.
    ///
    /// # Errors
    /// If it cannot be read, or says what no page may say.
    pub fn read_copc_page(&self, page: &CopcPage) -> Result<PageNodes> {
        match self {
            Self::Las(source) => source.read_copc_page(page),
            Self::Rows(source) => Err(Error::unsuitable(&source.info.path, "it has no list of nodes")),
            Self::Ept(source) => source.read_page(page),
        }
    }

    /// Finds all points of a file whose list of nodes is read page by page, as a read of all points does.
    pub(crate) fn check_whole(&self) -> Result<()> {
        match self {
            Self::Las(source) => source.whole().map(drop),
            Self::Rows(_) => Ok(()),
            Self::Ept(source) => source.whole().map(drop),
        }
    }

    /// All values of one point, read from the file: (property, value as text) in file order.
    ///
    /// # Errors
    /// If the file is gone, changed or too short.
    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        match self {
            Self::Las(source) => source.record(point),
            Self::Rows(source) => source.record(point),
            Self::Ept(source) => source.record(point),
        }
    }

    /// Whether the file declares faces.
    pub fn is_mesh(&self) -> bool {
        match self {
            Self::Las(_) | Self::Ept(_) => false,
            Self::Rows(source) => source.is_mesh(),
        }
    }

    /// The triangles of a mesh (polygons as fans) as indices of vertices; empty for a file without faces.
    ///
    /// # Errors
    /// If the face list cannot be parsed.
    pub fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        match self {
            Self::Las(_) | Self::Ept(_) => Ok(Vec::new()),
            Self::Rows(source) => source.triangles(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_looks_like_a_known_thing_is_named_with_a_way_out() {
        let text = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        let told = known_other(text).unwrap();
        assert!(told.contains("Git LFS") && told.contains("git lfs pull"), "{told}");
        for page in ["<!DOCTYPE html><html>", "\n <html lang=\"en\">"] {
            assert!(known_other(page.as_bytes()).is_some_and(|told| told.contains("a web page")), "{page}");
        }
        let known: [(&[u8], &str); 5] = [
            (b"PK\x03\x04", "unpack it"),
            (b"\x1f\x8b\x08", "unpack it"),
            (b"pnts\x01\0\0\0", "3D Tiles"),
            (b"glTF\x02\0\0\0", "glTF"),
            (b"\n{\"type\":\"FeatureCollection\"", "if their names end in .vpc"),
        ];
        for (start, told) in known {
            assert!(known_other(start).is_some_and(|own| own.contains(told)), "{told}");
        }
        assert_eq!(known_other(b"<points>"), None);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_regular_file_is_refused_before_it_is_opened() {
        for path in ["/dev/null", "/"] {
            let error = open(Path::new(path)).err().map(|error| error.to_string()).unwrap_or_default();
            assert!(error.contains("not a regular file"), "{error}");
        }
    }
}
