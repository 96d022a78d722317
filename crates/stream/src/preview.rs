//! Takes an even share of the points of some files, which is shown while their index is made.

use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Chunk, Column};
use glam::DVec3;

use crate::plan::spread;
use crate::records::{Layout, joined};

/// The least number of points of a preview chunk: the share of one read can be a few points, and each chunk costs
/// memory and time where it is drawn.
const CHUNK_POINTS: usize = 8192;
/// The colour of points without one among others that have one.
const WHITE: [u8; 4] = [255; 4];

pub struct Preview<'a> {
    /// The largest number of points in the preview.
    most: u64,
    /// The number of points of all files, as far as their headers can be believed.
    total: u64,
    show: &'a (dyn Fn(Chunk) + Sync),
    taken: Mutex<Taken>,
}

#[derive(Default)]
struct Taken {
    /// The chunks that gave their share, by their first point among all files.
    chunks: HashSet<u64>,
    points: u64,
    /// The chunks that are not shown yet, with columns in the layout's order.
    waiting: Vec<Chunk>,
}

impl<'a> Preview<'a> {
    /// `show` is called from many threads at once.
    pub fn new(most: u64, total: u64, show: &'a (dyn Fn(Chunk) + Sync)) -> Self {
        Self { most, total, show, taken: Mutex::default() }
    }

    pub fn is_wanted(&self) -> bool {
        self.most > 0
    }

    /// Takes the share of a chunk, once however often it is read. `columns` are those that hold the layout's
    /// attributes; `first_point` is the number of its file's first point among all files.
    pub fn add(&self, layout: &Layout, chunk: &Chunk, columns: &[Option<usize>], first_point: u64) {
        let first = first_point.saturating_add(chunk.first_point);
        let share = (self.most as f64 / self.total.max(1) as f64).min(1.0);
        let before = |point: u64| (point as f64 * share) as u64;
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = before(first.saturating_add(chunk.len() as u64)) - before(first);
        let count = wanted.min(self.most - taken.points) as usize;
        if count == 0 || !taken.chunks.insert(first) {
            return;
        }
        let mut some = chunk.select(&spread(chunk.len(), count));
        some.first_point = first;
        some.columns = columns.iter().map(|column| some.columns.get((*column)?)?.clone()).collect();
        taken.points += some.len() as u64;
        taken.waiting.push(some);
        if taken.waiting.iter().map(Chunk::len).sum::<usize>() >= CHUNK_POINTS {
            let waiting = std::mem::take(&mut taken.waiting);
            drop(taken);
            (self.show)(one_of(layout, &waiting));
        }
    }

    /// Shows the chunks that still wait.
    pub fn finish(&self, layout: &Layout) {
        let waiting = std::mem::take(&mut self.taken.lock().unwrap_or_else(PoisonError::into_inner).waiting);
        if !waiting.is_empty() {
            (self.show)(one_of(layout, &waiting));
        }
    }
}

/// Joins chunks into one, which begins where the first does.
fn one_of(layout: &Layout, chunks: &[Chunk]) -> Chunk {
    fn all<'a, T: Copy + 'a>(parts: impl Iterator<Item = Option<&'a Arc<Vec<T>>>>) -> Option<Arc<Vec<T>>> {
        let parts = parts.collect::<Option<Vec<_>>>()?;
        Some(Arc::new(parts.into_iter().flat_map(|part| part.iter().copied()).collect()))
    }
    let places: Vec<DVec3> =
        chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect();
    let mut one = Chunk::of_places(chunks[0].first_point, &places);
    one.exact_positions = all(chunks.iter().map(|chunk| chunk.exact_positions.as_ref()));
    one.normals = all(chunks.iter().map(|chunk| chunk.normals.as_ref()));
    if chunks.iter().any(|chunk| chunk.colors.is_some()) {
        let colors = |chunk: &Chunk| match &chunk.colors {
            Some(colors) => colors.to_vec(),
            None => vec![WHITE; chunk.len()],
        };
        one.colors = Some(Arc::new(chunks.iter().flat_map(colors).collect()));
    }
    let column = |(index, attribute): (usize, &cloud::Attribute)| {
        let parts: Option<Vec<&Column>> = chunks.iter().map(|chunk| chunk.columns[index].as_deref()).collect();
        Some(Arc::new(joined(&parts?, attribute.column_type)))
    };
    one.columns = layout.attributes.iter().enumerate().map(column).collect();
    one
}
