//! The first points of the compressed chunks of a LAZ file, which are there before anything is decoded.

use cloud::{CHUNK_POINTS, Chunk};
use glam::DVec3;
use rayon::iter::ParallelIterator as _;
use rayon::slice::ParallelSlice as _;

use super::LasSource;
use super::columns::ChunkBuilder;
use super::layout::bytes;
use crate::Selection;

/// The number of records that a thread reads in one go.
const RECORDS_AT_ONCE: usize = 256;

impl LasSource {
    /// The first points of the compressed chunks, in file order; of at most `most` chunks, which spread evenly over the file.
    /// A table may lie about where chunks are, so points outside the bounds of the header are left out.
    pub fn first_points(&self, selection: &Selection, most: usize) -> Option<Chunk> {
        let compressed = self.compressed.as_ref().filter(|compressed| compressed.has_known_chunks())?;
        let chunks = &compressed.chunks;
        let count = chunks.len().min(most).min(CHUNK_POINTS);
        let spread: Vec<usize> = (0..count).map(|index| index * chunks.len() / count).collect();
        let length = self.layout.record_length;
        let read = |some: &[usize]| {
            let mut records = Vec::new();
            let mut record = vec![0; length];
            for index in some {
                if compressed.first_record(&self.file, &chunks[*index], &mut record) && self.is_within_bounds(&record) {
                    records.extend_from_slice(&record);
                }
            }
            records
        };
        let records: Vec<Vec<u8>> = spread.par_chunks(RECORDS_AT_ONCE).map(read).collect();
        let (plan, _) = self.plan(selection);
        let mut builder = ChunkBuilder::new(&plan, 0, count);
        records.iter().for_each(|records| builder.push(records));
        Some(builder.finish().0).filter(|chunk| !chunk.is_empty())
    }

    /// Whether the point of a record is where the header says that points are.
    fn is_within_bounds(&self, record: &[u8]) -> bool {
        let raw = DVec3::from([0, 4, 8].map(|at| f64::from(i32::from_le_bytes(bytes(record, at)))));
        let place = raw * self.grid.scale + self.grid.offset;
        // Headers round.
        let slack = self.grid.scale.abs();
        let is_inside =
            |bounds: cloud::Bounds| place.cmpge(bounds.min - slack).all() && place.cmple(bounds.max + slack).all();
        self.info.bounds.map_or(place.is_finite(), is_inside)
    }
}
