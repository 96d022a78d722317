//! An opened file of any format.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use cloud::{Bounds, Chunk, Placement, Progress};

use crate::bytes::Bytes;
use crate::error::{Error, Result};
use crate::info::{Info, Selection, Summary};
use crate::las::{Copc, CopcNode};
use crate::{las, ply};

/// An opened file. It is `Sync`: one thread may read a column while another looks up a record.
#[allow(clippy::large_enum_variant, reason = "there is one per open file, and it is not moved around")]
pub enum Source {
    Las(las::LasSource),
    Ply(ply::PlySource),
}

/// The memory in bytes that the decoders of a file may take by default.
const DECODER_MEMORY: u64 = 1 << 30;

/// Opens a file according to its content, not its name.
///
/// # Errors
/// Says what is wrong and where: not readable, not a known format, a header that contradicts the file.
pub fn open(path: &Path) -> Result<Source> {
    open_within(path, DECODER_MEMORY)
}

/// The same as `open`, for reads whose decoders take no more than `memory` bytes together, besides the decoded points.
/// Fewer decoders run at a time where points are long (a decoder of LAZ takes some kilobytes for each byte of a point).
///
/// # Errors
/// Those of `open`; if a single decoder would take more.
pub fn open_within(path: &Path, memory: u64) -> Result<Source> {
    let bytes = Bytes::open(path)?;
    let mut start = [0; 64];
    let count = bytes.read_at(0, &mut start).map_err(|error| Error::io(path, error))?;
    match &start[..count] {
        start if start.starts_with(b"LASF") => las::LasSource::open(bytes, memory).map(Source::Las),
        start if ply::is_ply(start) => ply::PlySource::open(bytes).map(Source::Ply),
        start => Err(Error::UnknownFormat { path: path.to_owned(), hint: hint(start) }),
    }
}

/// What a file of an unknown format looks like, and what to do about it.
fn hint(start: &[u8]) -> String {
    match start {
        [] => "the file is empty".into(),
        [b'A', b'S', b'T', b'M', ..] => "this is an E57 file; convert it to LAZ or PLY first".into(),
        [b'~', ..] => {
            "this is a well log (Log ASCII Standard), which shares only the name with LAS point clouds".into()
        }
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "this is text of 16 bits (UTF-16); write it as ASCII or UTF-8".into(),
        [0x00, 0x05, 0x16, 0x07, ..] => {
            "this is what macOS keeps beside a file of the same name without `._` (AppleDouble)".into()
        }
        start if start.starts_with(b"version https://git-lfs") => {
            "this is a pointer of Git LFS, which stands for the file; `git lfs pull` gets the file itself".into()
        }
        start if is_table(start) => {
            "this looks like a table of numbers (XYZ, PTS, PTX, CSV), which is not read; convert it to LAZ or PLY first"
                .into()
        }
        _ => "it starts with none of their signatures (\"LASF\", \"ply\")".into(),
    }
}

/// Whether a file begins with a line of numbers.
fn is_table(start: &[u8]) -> bool {
    let line = start.split(|byte| matches!(byte, b'\n' | b'\r')).next().unwrap_or_default();
    let is_part = |byte: &u8| byte.is_ascii_digit() || b" \t,;.+-eE".contains(byte);
    line.iter().any(u8::is_ascii_digit) && line.iter().all(is_part)
}

impl Source {
    pub fn info(&self) -> &Info {
        match self {
            Self::Las(source) => source.info(),
            Self::Ply(source) => source.info(),
        }
    }

    /// The same file with its points turned and moved: `read` gives them so, and `export` writes them so. `record` still
    /// tells what is in the file.
    #[must_use]
    pub fn placed(mut self, placement: Placement) -> Self {
        match &mut self {
            Self::Las(source) => source.info.place(placement),
            Self::Ply(source) => source.info.place(placement),
        }
        self
    }

    /// What the points are decoded from.
    pub fn bytes(&self) -> &Bytes {
        match self {
            Self::Las(source) => source.bytes(),
            Self::Ply(source) => source.bytes(),
        }
    }

    /// Reads the file in parallel and passes each chunk to `emit`, which is called from worker threads in any order
    /// (`Chunk::first_point` tells its place; the limits of chunks are the same in every read of the same file).
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

    fn read_own(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        match self {
            Self::Las(source) => source.read(selection, progress, emit),
            Self::Ply(source) => source.read(selection, progress, emit),
        }
    }

    /// The octree of a COPC file; `None` for other files, and if the octree does not fit the file (a warning then says
    /// so).
    pub fn copc(&self) -> Option<&Copc> {
        match self {
            Self::Las(source) => source.copc(),
            Self::Ply(_) => None,
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
            Self::Ply(_) => Chunk::new(0, glam::DVec3::ZERO, Vec::new()),
        };
        let Info { placement, grid, .. } = self.info();
        Ok(placement.as_ref().map_or_else(|| chunk.clone(), |placement| chunk.placed(placement, *grid)))
    }

    /// All values of one point, read from the file: (property, value as text) in file order.
    ///
    /// # Errors
    /// If the file is gone, changed or too short.
    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        match self {
            Self::Las(source) => source.record(point),
            Self::Ply(source) => source.record(point),
        }
    }

    /// Whether the file declares faces.
    pub fn is_mesh(&self) -> bool {
        match self {
            Self::Las(_) => false,
            Self::Ply(source) => source.is_mesh(),
        }
    }

    /// The triangles of a mesh (polygons as fans) as indices of vertices; empty for a file without faces.
    ///
    /// # Errors
    /// If the face list cannot be parsed.
    pub fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        match self {
            Self::Las(_) => Ok(Vec::new()),
            Self::Ply(source) => source.triangles(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_looks_like_a_known_thing_is_named_with_a_way_out() {
        let text = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        let told = hint(text);
        assert!(hint(b"1024\n768\n0 0 0\n").contains("table of numbers"), "a PTX begins with its columns");
        assert!(hint(b"3.5 -1.25e3 7\n").contains("table of numbers") && !hint(b"name 1\n").contains("table"));
        assert!(told.contains("Git LFS") && told.contains("git lfs pull"), "{told}");
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
