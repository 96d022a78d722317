//! Takes an even share of the points of some files, which is shown while their index is made.

use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cloud::{Chunk, Column, Progress, pack_radius, provisional_radius};
use codec::Source;
use glam::DVec3;
use rayon::iter::{IndexedParallelIterator as _, IntoParallelRefIterator as _, ParallelIterator as _};

use crate::plan::{selection, spread};
use crate::records::{Layout, joined};

/// The least number of points of a preview chunk: the share of one read can be a few points, and each chunk costs
/// memory and time where it is drawn.
const CHUNK_POINTS: usize = 8192;
/// The first points of compressed chunks may be one in this number of the preview's points.
const FIRST_SHARE: u64 = 4;
/// The largest number of groups of files whose first points are shown and replaced together.
const MOST_GROUPS: usize = 256;
/// The colour of points without one among others that have one.
const WHITE: [u8; 4] = [255; 4];

/// A change of what is shown while an index is made.
pub enum Previewed {
    /// Points that stay until the index is there.
    Share(Chunk),
    /// The first points of the compressed chunks of the files of a group, with radii that fit how far apart they are.
    First(u32, Chunk),
    /// The first points of a group go: a share of the points of its files follows, which may have some of them.
    FirstGone(u32),
}

pub struct Preview<'a> {
    /// The largest number of points in the preview.
    most: u64,
    /// The number of points of all files, as far as their headers can be believed.
    total: u64,
    show: &'a (dyn Fn(Previewed) + Sync),
    taken: Mutex<Taken>,
}

#[derive(Default)]
struct Taken {
    /// The chunks that gave their share, by their first point among all files.
    chunks: HashSet<u64>,
    /// The number of points of these shares.
    points: u64,
    /// The number of first points of compressed chunks, those that have gone among them.
    first_points: u64,
    /// The chunks that are not shown yet, by the groups of their files, with columns in the layout's order.
    waiting: BTreeMap<usize, Vec<Chunk>>,
    groups: Vec<Group>,
}

/// Some files that follow one another.
struct Group {
    /// The number of its first point among all files.
    start: u64,
    /// The number of first points of compressed chunks that are shown of it.
    first_points: usize,
}

impl Taken {
    /// The group of a point; there is one of all files where no first points are shown.
    fn group_of(&self, point: u64) -> usize {
        self.groups.partition_point(|group| group.start <= point).saturating_sub(1)
    }

    /// The number of first points that are shown of a group.
    fn first_points(&self, group: usize) -> usize {
        self.groups.get(group).map_or(0, |group| group.first_points)
    }
}

impl<'a> Preview<'a> {
    /// `show` is called from many threads at once.
    pub fn new(most: u64, total: u64, show: &'a (dyn Fn(Previewed) + Sync)) -> Self {
        Self { most, total, show, taken: Mutex::default() }
    }

    pub fn is_wanted(&self) -> bool {
        self.most > 0
    }

    /// Shows the first points of the compressed chunks of all files, which need no decoding. They go group by group as soon as
    /// as many others are there. `starts` are the numbers of the files' first points among the points of all files.
    pub fn show_first(&self, layout: &Layout, inputs: &[Arc<Source>], starts: &[u64], progress: &Progress) {
        if !self.is_wanted() {
            return;
        }
        let files = inputs.len().div_ceil(MOST_GROUPS).max(1);
        let share = (self.most / FIRST_SHARE) as f64 / self.total.max(1) as f64;
        let before = |point: u64| (point as f64 * share.min(1.0)) as u64;
        let read = |(input, start): (&Arc<Source>, &u64)| {
            let end = start.saturating_add(input.info().points);
            let most = ((before(end) - before(*start)) as usize).min(cloud::CHUNK_POINTS / files);
            let (selection, columns) = selection(input, layout);
            let mut chunk = input.first_points(&selection, most).filter(|_| !progress.is_cancelled())?;
            chunk.first_point = *start;
            chunk.columns = in_layout(&chunk, &columns);
            let bounds = input.info().bounds.unwrap_or_else(|| chunk.bounds());
            let radius = pack_radius(provisional_radius(bounds, chunk.len() as u64));
            chunk.radii = Some(Arc::new(vec![radius; chunk.len()]));
            Some(chunk)
        };
        let read: Vec<Option<Chunk>> = inputs.par_iter().zip(starts).map(read).collect();
        for (group, (read, starts)) in (0..).zip(read.chunks(files).zip(starts.chunks(files))) {
            let chunks: Vec<Chunk> = read.iter().flatten().cloned().collect();
            let first_points = chunks.iter().map(Chunk::len).sum();
            let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
            taken.first_points += first_points as u64;
            taken.groups.push(Group { start: starts[0], first_points });
            drop(taken);
            if !chunks.is_empty() {
                (self.show)(Previewed::First(group, one_of(layout, &chunks)));
            }
        }
    }

    /// Takes the share of a chunk, once however often it is read. `columns` are those that hold the layout's
    /// attributes; `first_point` is the number of its file's first point among all files.
    pub fn add(&self, layout: &Layout, chunk: &Chunk, columns: &[Option<usize>], first_point: u64) {
        let first = first_point.saturating_add(chunk.first_point);
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let most = self.most - taken.first_points;
        let share = (most as f64 / self.total.max(1) as f64).min(1.0);
        let before = |point: u64| (point as f64 * share) as u64;
        let wanted = before(first.saturating_add(chunk.len() as u64)) - before(first);
        let count = wanted.min(most - taken.points) as usize;
        if count == 0 || !taken.chunks.insert(first) {
            return;
        }
        let mut some = chunk.select(&spread(chunk.len(), count));
        some.first_point = first;
        some.columns = in_layout(&some, columns);
        taken.points += some.len() as u64;
        let group = taken.group_of(first);
        let waiting = taken.waiting.entry(group).or_default();
        waiting.push(some);
        let waiting: usize = waiting.iter().map(Chunk::len).sum();
        if waiting >= taken.first_points(group).max(CHUNK_POINTS) {
            self.show_waiting(layout, taken, group);
        }
    }

    /// Shows the chunks that still wait.
    pub fn finish(&self, layout: &Layout) {
        loop {
            let taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(group) = taken.waiting.keys().next().copied() else { return };
            self.show_waiting(layout, taken, group);
        }
    }

    /// Shows the chunks of a group that wait, in place of its first points.
    fn show_waiting(&self, layout: &Layout, mut taken: MutexGuard<'_, Taken>, group: usize) {
        let waiting = taken.waiting.remove(&group).unwrap_or_default();
        let first = taken.groups.get_mut(group).map_or(0, |group| std::mem::take(&mut group.first_points));
        if first > 0 {
            // Before another thread can show more of the group.
            (self.show)(Previewed::FirstGone(group as u32));
        }
        drop(taken);
        let mut rest = waiting.as_slice();
        while !rest.is_empty() {
            let mut points = 0;
            let is_full = |chunk: &Chunk| {
                points += chunk.len();
                points >= CHUNK_POINTS
            };
            let count = rest.iter().position(is_full).map_or(rest.len(), |last| last + 1);
            let (some, others) = rest.split_at(count);
            (self.show)(Previewed::Share(one_of(layout, some)));
            rest = others;
        }
    }
}

/// The columns of a chunk in the order of a layout.
fn in_layout(chunk: &Chunk, columns: &[Option<usize>]) -> Vec<Option<Arc<Column>>> {
    columns.iter().map(|column| chunk.columns.get((*column)?)?.clone()).collect()
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
    one.radii = all(chunks.iter().map(|chunk| chunk.radii.as_ref()));
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
