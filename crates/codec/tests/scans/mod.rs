//! Reads the scans of files whole.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

use std::path::Path;
use std::sync::Mutex;

use cloud::{Chunk, Progress};
use codec::{Selection, Source, Summary};
use glam::DVec3;

/// The memory of decoders in bytes.
pub const MEMORY: u64 = 1 << 28;

pub fn scans(path: &Path) -> Vec<Source> {
    codec::open_scans(path, MEMORY).unwrap()
}

/// All chunks with all columns, in the order of the file.
pub fn read(source: &Source) -> (Vec<Chunk>, Summary) {
    let attributes = vec![true; source.info().attributes.len()];
    let selection = Selection { positions: true, colors: true, normals: true, attributes };
    let chunks = Mutex::new(Vec::new());
    let summary = source.read(&selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    (chunks, summary)
}

pub fn places(chunks: &[Chunk]) -> Vec<DVec3> {
    chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect()
}

/// The values of an attribute.
pub fn values(source: &Source, chunks: &[Chunk], name: &str) -> Vec<f64> {
    let place = source.info().attributes.iter().position(|attribute| attribute.name == name);
    let place = place.unwrap_or_else(|| panic!("{name} is not among {:?}", source.info().attributes));
    let of_chunk = |chunk: &Chunk| -> Vec<f64> {
        let column = chunk.columns[place].as_ref().unwrap();
        (0..chunk.len()).map(|at| column.value(at)).collect()
    };
    chunks.iter().flat_map(of_chunk).collect()
}
