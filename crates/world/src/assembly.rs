//! Puts a cloud together from the events of its job, and says what to change on the GPU. The window and headless
//! pictures put their clouds together here.

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Bounds, Chunk, Cloud, CloudLayout, Column, PointTest, Surfels};
use glam::DVec3;
use stream::Octree;

use crate::apart::Place;
use crate::change::Change;
use crate::chunk_key::{CloudKey, Part};
use crate::event::{IndexState, Opened};
use crate::source::column_of;
use crate::task::CloudTask;

pub struct Assembly {
    pub key: CloudKey,
    /// The cloud; its chunks are in the order of `parts`.
    pub cloud: Cloud,
    /// The parts of the chunks that have been loaded, in order.
    parts: Vec<Part>,
    chunk_bounds: Vec<Bounds>,
    /// The word of the command line that the cloud came from; several clouds of a built-in scene share it.
    pub input: String,
    /// The file, if all of its points are in memory.
    pub source: Option<Arc<codec::Source>>,
    /// The coordinate system, as the file names it.
    pub crs: Option<String>,
    /// The units of the coordinates, as far as the file tells them.
    pub units: codec::Units,
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// The radius of points whose own is not known yet, in world units.
    pub provisional_radius: f32,
    /// The number of points that a full read should yield.
    pub expected_points: u64,
    /// The number of points that have been loaded.
    pub points: u64,
    /// Whether no more chunks will come.
    pub is_read: bool,
    /// The bounds of the points loaded so far, stray points included; with an index, those of all its points.
    pub bounds: Bounds,
    /// The state of the index, if the cloud is streamed.
    pub pages: Option<IndexState>,
    /// The last task planned for the cloud: its index, or normals and radii.
    pub task: Option<Arc<CloudTask>>,
    /// The columns that were read after the points, also for chunks that are still to come.
    late_columns: BTreeMap<usize, BTreeMap<u64, Arc<Column>>>,
    /// The radii from all points, while others stand for the points that are shown (`put_radii`).
    full_radii: Option<Vec<Arc<Vec<u16>>>>,
    /// The warnings about the file from when it was opened.
    warnings: Vec<String>,
}

impl Assembly {
    /// A cloud without points yet. The caller shows `opened.warnings`.
    pub fn open(key: CloudKey, opened: Opened) -> (Self, Change) {
        let Opened {
            name,
            input,
            source,
            attributes,
            grid,
            crs,
            units,
            expected_points,
            up,
            provisional_radius,
            warnings,
        } = opened;
        let assembly = Self {
            key,
            cloud: Cloud { name, attributes, grid, chunks: Vec::new() },
            parts: Vec::new(),
            chunk_bounds: Vec::new(),
            input,
            source,
            crs,
            units,
            up,
            provisional_radius,
            expected_points,
            points: 0,
            is_read: false,
            bounds: Bounds::EMPTY,
            pages: None,
            task: None,
            late_columns: BTreeMap::new(),
            full_radii: None,
            warnings,
        };
        (assembly, Change::Open { cloud: key, provisional_radius })
    }

    /// Adds a chunk, or replaces that of the same part.
    pub fn put(&mut self, part: Part, mut chunk: Chunk) -> Change {
        for (attribute, columns) in &self.late_columns {
            put_column(&mut chunk, *attribute, columns);
        }
        let bounds = chunk.bounds();
        self.points += chunk.len() as u64;
        self.bounds = self.bounds.union(bounds);
        match self.parts.binary_search(&part) {
            Ok(index) => {
                self.points -= self.cloud.chunks[index].len() as u64;
                self.cloud.chunks[index] = chunk.clone();
                self.chunk_bounds[index] = bounds;
            }
            Err(index) => {
                self.parts.insert(index, part);
                self.cloud.chunks.insert(index, chunk.clone());
                self.chunk_bounds.insert(index, bounds);
            }
        }
        Change::Put { key: self.key.chunk(part), chunk, layout: self.layout() }
    }

    /// Removes a chunk; returns `None` if the cloud does not have it.
    pub fn take_out(&mut self, part: Part) -> Option<Change> {
        let index = self.parts.binary_search(&part).ok()?;
        self.parts.remove(index);
        self.chunk_bounds.remove(index);
        self.points -= self.cloud.chunks.remove(index).len() as u64;
        // The index's bounds contain all points that may come.
        if self.octree().is_none() {
            self.bounds = self.chunk_bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        }
        Some(Change::TakeOut { key: self.key.chunk(part) })
    }

    /// Takes over the state of the cloud's index.
    pub fn page(&mut self, mut pages: IndexState) -> Change {
        let was_built_before = self.was_built();
        if let IndexState::Indexed { grid, was_built, .. } = &mut pages {
            self.cloud.grid = *grid;
            *was_built |= was_built_before;
        } else {
            self.task = None;
        }
        self.pages = Some(pages);
        let bounds = self.index_bounds().unwrap_or(Bounds::EMPTY);
        self.bounds = self.bounds.union(bounds);
        Change::Bounds { cloud: self.key, bounds }
    }

    /// Ends the reading. Returns the file's warnings that were not known when it was opened.
    pub fn end(&mut self, summary: &codec::Summary) -> Vec<String> {
        self.is_read = true;
        let new = summary.warnings.iter().filter(|warning| !self.warnings.contains(warning));
        new.cloned().collect()
    }

    /// Sets normals and radii, one list for each chunk.
    pub fn put_surfels(&mut self, surfels: Vec<Surfels>) -> Vec<Change> {
        self.full_radii = None;
        for (chunk, surfels) in self.cloud.chunks.iter_mut().zip(surfels) {
            chunk.normals = Some(Arc::new(surfels.normals));
            chunk.radii = Some(Arc::new(surfels.radii));
        }
        self.puts()
    }

    /// Whether the radii of all points are there, and were estimated from them.
    pub fn has_estimated_radii(&self) -> bool {
        let is_estimated = |chunk: &Chunk| chunk.radii.is_some() && chunk.corners.is_none();
        self.is_read && self.source.is_some() && self.pages.is_none() && self.cloud.chunks.iter().all(is_estimated)
    }

    /// The cloud with the radii that follow from all points.
    pub fn with_full_radii(&self) -> Cloud {
        let mut cloud = self.cloud.clone();
        for (chunk, radii) in cloud.chunks.iter_mut().zip(self.full_radii.iter().flatten()) {
            chunk.radii = Some(radii.clone());
        }
        cloud
    }

    /// Sets the radii for the points that are shown, one list for each chunk, or those from all points again.
    pub fn put_radii(&mut self, radii: Option<Vec<Arc<Vec<u16>>>>) -> Vec<Change> {
        let full = match self.full_radii.take() {
            Some(full) => full,
            None => self.cloud.chunks.iter().filter_map(|chunk| chunk.radii.clone()).collect(),
        };
        for (chunk, radii) in self.cloud.chunks.iter_mut().zip(radii.as_ref().unwrap_or(&full)) {
            chunk.radii = Some(radii.clone());
        }
        self.full_radii = radii.is_some().then_some(full);
        self.puts()
    }

    /// Adds a column that was read after the points, by the first records of the chunks. The changes tell the GPU of it;
    /// its colours are shown by the next `Change::Color`.
    pub fn put_late_column(&mut self, attribute: usize, columns: BTreeMap<u64, Arc<Column>>) -> Vec<Change> {
        for chunk in &mut self.cloud.chunks {
            put_column(chunk, attribute, &columns);
        }
        self.late_columns.insert(attribute, columns);
        self.puts()
    }

    pub fn puts(&self) -> Vec<Change> {
        let layout = self.layout();
        let put = |(part, chunk)| Change::Put { key: self.key.chunk(part), chunk, layout: layout.clone() };
        self.chunks().into_iter().map(put).collect()
    }

    /// What the test of its points needs to know.
    pub fn layout(&self) -> Arc<CloudLayout> {
        Arc::new(self.cloud.layout())
    }

    /// All changes that put the cloud on the GPU, in a fixed order.
    pub fn changes(&self) -> Vec<Change> {
        let open = Change::Open { cloud: self.key, provisional_radius: self.provisional_radius };
        let bounds = self.index_bounds().map(|bounds| Change::Bounds { cloud: self.key, bounds });
        std::iter::once(open).chain(bounds).chain(self.puts()).collect()
    }

    /// Where the cloud lies, by its `bounds` without stray points.
    pub fn place(&self, bounds: Bounds) -> Place<'_> {
        Place { name: &self.cloud.name, bounds, points: self.points, system: self.crs.as_deref() }
    }

    /// Warnings about the filters of a test that hide nothing here, because the cloud lacks their attribute.
    pub fn idle_filters(&self, test: &PointTest) -> Vec<String> {
        let name = &self.cloud.name;
        let idle = test.filtered().filter(|filtered| self.cloud.column_of(filtered).is_none());
        idle.map(|filtered| format!("{name}: no attribute `{filtered}`, so its filter hides nothing there")).collect()
    }

    pub fn chunks(&self) -> Vec<(Part, Chunk)> {
        self.parts.iter().copied().zip(self.cloud.chunks.iter().cloned()).collect()
    }

    pub fn chunk(&self, part: Part) -> Option<&Chunk> {
        self.parts.binary_search(&part).ok().map(|index| &self.cloud.chunks[index])
    }

    /// The point of the file that a point is, or the corner that one spread over a mesh is nearest to.
    pub fn point_in_file(&self, part: Part, index: usize) -> Option<(Part, usize)> {
        let chunk = self.chunk(part)?;
        if chunk.corners.is_none() {
            return Some((part, index));
        }
        let corner = chunk.point_in_file(index);
        let place = |chunk: &Chunk| corner.checked_sub(chunk.first_point).filter(|at| *at < chunk.len() as u64);
        let mut places = self.parts.iter().zip(&self.cloud.chunks).filter(|(_, chunk)| chunk.corners.is_none());
        places.find_map(|(part, chunk)| Some((*part, place(chunk)? as usize)))
    }

    /// The parts that have been loaded, with the bounds of their points, in order.
    pub fn chunk_bounds(&self) -> impl ExactSizeIterator<Item = (Part, Bounds)> {
        self.parts.iter().copied().zip(self.chunk_bounds.iter().copied())
    }

    pub fn bounds_of(&self, part: Part) -> Option<Bounds> {
        self.parts.binary_search(&part).ok().map(|index| self.chunk_bounds[index])
    }

    /// The number of columns that were read after the points.
    pub fn late_columns(&self) -> usize {
        self.late_columns.len()
    }

    /// The number of all points of the cloud, loaded or not.
    pub fn total(&self) -> u64 {
        self.octree().map_or(self.expected_points, |octree| octree.points()).max(self.points)
    }

    pub fn octree(&self) -> Option<&Arc<Octree>> {
        match &self.pages {
            Some(IndexState::Indexed { octree, .. }) => Some(octree),
            Some(IndexState::Indexing) | None => None,
        }
    }

    /// The bounds of all points, if an index states them.
    pub fn index_bounds(&self) -> Option<Bounds> {
        Some(self.octree()?.nodes.first()?.bounds)
    }

    /// Whether its index was made by this job instead of found.
    pub fn was_built(&self) -> bool {
        matches!(self.pages, Some(IndexState::Indexed { was_built: true, .. }))
    }
}

fn put_column(chunk: &mut Chunk, attribute: usize, columns: &BTreeMap<u64, Arc<Column>>) {
    let Some(column) = column_of(chunk, columns) else { return };
    if chunk.columns.len() <= attribute {
        chunk.columns.resize(attribute + 1, None);
    }
    chunk.columns[attribute] = Some(column);
}

#[cfg(test)]
mod tests {
    use cloud::{Attribute, ColumnType};
    use stream::NodeId;

    use super::*;

    fn classes(first_point: u64, values: &[u8]) -> Chunk {
        let mut chunk = Chunk::new(first_point, DVec3::ZERO, values.iter().map(|at| [f32::from(*at); 3]).collect());
        chunk.columns = vec![Some(Arc::new(Column::U8(values.to_vec())))];
        chunk
    }

    fn opened() -> Assembly {
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let warnings = vec!["said at once".to_owned()];
        Assembly::open(CloudKey(3), Opened { attributes, expected_points: 9, warnings, ..Opened::default() }).0
    }

    #[test]
    fn chunks_are_in_the_order_of_their_parts_however_they_come() {
        let mut cloud = opened();
        for part in [Part::Node(NodeId(2)), Part::Preview(0), Part::Node(NodeId(0))] {
            let change = cloud.put(part, classes(0, &[1, 2]));
            assert!(matches!(change, Change::Put { key, layout, .. }
                if key == CloudKey(3).chunk(part) && layout.class_column() == Some(0)));
        }
        let parts = |cloud: &Assembly| cloud.chunk_bounds().map(|(part, _)| part).collect::<Vec<_>>();
        assert_eq!(parts(&cloud), [Part::Preview(0), Part::Node(NodeId(0)), Part::Node(NodeId(2))]);
        cloud.put(Part::Node(NodeId(0)), classes(0, &[8]));
        assert_eq!((cloud.points, cloud.total()), (5, 9));
        assert_eq!(cloud.chunk(Part::Node(NodeId(0))).map(Chunk::len), Some(1));
        assert!(cloud.take_out(Part::Node(NodeId(0))).is_some() && cloud.take_out(Part::Node(NodeId(0))).is_none());
        assert_eq!((cloud.points, cloud.bounds.max), (4, DVec3::splat(2.0)));
        assert_eq!(cloud.changes().len(), 3, "the cloud and two chunks");
    }

    #[test]
    fn a_column_that_comes_late_reaches_chunks_from_before_and_after_it() {
        let mut cloud = opened();
        let bare = |first_point| Chunk { columns: Vec::new(), ..classes(first_point, &[0]) };
        cloud.put(Part::Block(0), bare(0));
        let columns = [0, 1].map(|first| (first, Arc::new(Column::U8(vec![first as u8 + 7]))));
        assert_eq!(cloud.put_late_column(0, columns.into()).len(), 1, "the chunk is sent again");
        cloud.put(Part::Block(1), bare(1));
        for (block, class) in [(0, 7), (1, 8)] {
            let column = cloud.chunk(Part::Block(block)).and_then(|chunk| chunk.columns[0].clone());
            assert_eq!(column.map(|column| column.value(0)), Some(f64::from(class)));
        }
    }

    #[test]
    fn a_point_on_a_mesh_stands_for_a_corner_of_the_file() {
        let mut cloud = opened();
        cloud.put(Part::Block(0), classes(0, &[1, 2]));
        cloud.put(Part::Block(2), classes(2, &[3]));
        let on_faces = Chunk { corners: Some(Arc::new(vec![2, 1])), ..classes(3, &[3, 2]) };
        cloud.put(Part::Block(3), on_faces);
        let found = [0, 1].map(|index| cloud.point_in_file(Part::Block(3), index));
        assert_eq!(found, [Some((Part::Block(2), 0)), Some((Part::Block(0), 1))]);
        assert_eq!(cloud.point_in_file(Part::Block(0), 1), Some((Part::Block(0), 1)));
        // A column of the file reaches them by their corners, unless it ends before one of them.
        let values = |cloud: &mut Assembly, column: usize, last: Vec<u8>| {
            let columns = [(0, Column::U8(vec![7, 8])), (2, Column::U8(last))];
            cloud.put_late_column(column, columns.map(|(first, column)| (first, Arc::new(column))).into());
            let column = cloud.chunk(Part::Block(3))?.columns.get(column)?.clone()?;
            Some([0, 1].map(|index| column.value(index)))
        };
        assert_eq!(values(&mut cloud, 1, vec![9]), Some([9.0, 8.0]));
        assert_eq!(values(&mut cloud, 2, Vec::new()), None);
    }

    #[test]
    fn radii_of_shown_points_give_way_to_those_from_all_points_again() {
        let mut cloud = opened();
        cloud.put(Part::Block(0), classes(0, &[1, 2]));
        cloud.put(Part::Block(2), classes(2, &[3]));
        let surfels = |points: usize| Surfels { normals: vec![0; points], radii: vec![7; points] };
        cloud.put_surfels(vec![surfels(2), surfels(1)]);
        let radii = |cloud: &Cloud| -> Vec<u16> {
            cloud.chunks.iter().flat_map(|chunk| chunk.radii.iter().flat_map(|radii| radii.to_vec())).collect()
        };
        for shown in [[8, 7, 7], [9, 7, 9]] {
            let lists = vec![Arc::new(shown[..2].to_vec()), Arc::new(shown[2..].to_vec())];
            assert_eq!(cloud.put_radii(Some(lists)).len(), 2);
            assert_eq!((radii(&cloud.cloud), radii(&cloud.with_full_radii())), (shown.to_vec(), vec![7; 3]));
        }
        cloud.put_radii(None);
        assert_eq!(radii(&cloud.cloud), [7; 3]);
    }

    #[test]
    fn what_was_said_when_a_file_was_opened_is_not_said_when_it_is_read() {
        let warnings = vec!["said at once".to_owned(), "found on the way".to_owned()];
        let mut cloud = opened();
        assert_eq!(cloud.end(&codec::Summary { warnings, ..Default::default() }), ["found on the way"]);
        assert!(cloud.is_read);
    }
}
