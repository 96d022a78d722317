//! Puts a cloud together from the events of its job, and says what to change on the GPU. The window and headless
//! pictures put their clouds together here.

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Attribute, Bounds, Chunk, Cloud, CloudLayout, Column, Grid, Placement, Surfels};
use glam::DVec3;
use rayon::prelude::*;
use scene::Settings;
use stream::Octree;

use crate::apart::Place;
use crate::change::Change;
use crate::chunk_key::{CloudKey, Part};
use crate::event::{IndexState, Opened};
use crate::filters::Offer;
use crate::loaded_parts::LoadedParts;
use crate::source::column_of;
use crate::task::CloudTask;

pub struct Assembly {
    pub key: CloudKey,
    /// The cloud; its chunks are in the order of `parts`.
    pub cloud: Cloud,
    /// The parts of the chunks that have been loaded, in order.
    parts: Vec<Part>,
    chunk_bounds: Vec<Bounds>,
    /// The places and normals of the same chunks as the file has them.
    own: Vec<Chunk>,
    /// How the points of `cloud` have been moved.
    placement: Option<Placement>,
    /// The word of the command line that the cloud came from; several clouds of a built-in scene share it.
    pub input: String,
    /// The file, if all of its points are in memory.
    pub source: Option<Arc<codec::Source>>,
    files: Arc<Vec<codec::NamedFile>>,
    /// The attributes that the files have.
    offered: Vec<Attribute>,
    /// The coordinate system, as the file names it.
    pub crs: Option<String>,
    /// The units of the coordinates, as far as the file names them.
    pub units: codec::Units,
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// Where the scanner stood, in the coordinates of the file, if one place is known.
    pub scanner: Option<DVec3>,
    /// The radius of points whose own is not known yet, in world units.
    pub provisional_radius: f32,
    /// The number of points that a full read should yield.
    pub expected_points: u64,
    /// The number of points that have been loaded.
    pub points: u64,
    /// Whether no more chunks will come.
    pub is_read: bool,
    /// Whether no more of its file's points come although some are missing: they cannot be read, or reading was stopped.
    pub is_cut: bool,
    /// Whether reading was stopped: opened again, the file has all of its points.
    pub was_stopped: bool,
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
    /// Says which of its files is another one than it was, and so are its points where it is read again by its name.
    ///
    /// # Errors
    /// If there is one.
    pub fn check_unchanged(&self) -> codec::Result<()> {
        self.files.iter().try_for_each(codec::NamedFile::check_unchanged)
    }

    /// A cloud without points yet. The caller shows `opened.warnings`.
    pub fn open(key: CloudKey, opened: Opened) -> (Self, Change) {
        let Opened {
            name,
            input,
            source,
            files,
            attributes,
            offered,
            grid,
            crs,
            units,
            expected_points,
            up,
            scanner,
            provisional_radius,
            warnings,
        } = opened;
        let assembly = Self {
            key,
            cloud: Cloud { name, attributes, grid, chunks: Vec::new() },
            parts: Vec::new(),
            chunk_bounds: Vec::new(),
            own: Vec::new(),
            placement: None,
            input,
            source,
            files,
            offered,
            crs,
            units,
            up,
            scanner,
            provisional_radius,
            expected_points,
            points: 0,
            is_read: false,
            is_cut: false,
            was_stopped: false,
            bounds: Bounds::EMPTY,
            pages: None,
            task: None,
            late_columns: BTreeMap::new(),
            full_radii: None,
            warnings,
        };
        (assembly, Change::Open { cloud: key, provisional_radius })
    }

    /// Adds a chunk as the file has it, or replaces that of the same part.
    pub fn put(&mut self, part: Part, chunk: Chunk) -> Change {
        let own = places_of(&chunk);
        let mut chunk = match &self.placement {
            Some(placement) => chunk.placed(placement, self.cloud.grid),
            None => chunk,
        };
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
                self.own[index] = own;
                self.chunk_bounds[index] = bounds;
            }
            Err(index) => {
                self.parts.insert(index, part);
                self.cloud.chunks.insert(index, chunk.clone());
                self.own.insert(index, own);
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
        self.own.remove(index);
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
        if let IndexState::Indexed { attributes, grid, was_built, .. } = &mut pages {
            let attributes = attributes.clone();
            self.cloud.grid = grid.map(|grid| Grid { placement: self.placement, ..grid });
            *was_built |= was_built_before;
            self.rearrange(attributes);
        } else {
            self.task = None;
        }
        self.pages = Some(pages);
        let loaded = self.chunk_bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        self.bounds = loaded.union(self.index_bounds().unwrap_or(Bounds::EMPTY));
        Change::Bounds { cloud: self.key, bounds: self.scene_bounds().unwrap_or(Bounds::EMPTY) }
    }

    /// Puts the columns of the chunks in the order of other attributes. Those that are new have no values yet.
    fn rearrange(&mut self, attributes: Vec<Attribute>) {
        let old = std::mem::replace(&mut self.cloud.attributes, attributes);
        if old == self.cloud.attributes {
            return;
        }
        let column = |attribute: &Attribute| old.iter().position(|known| known.name == attribute.name);
        let columns: Vec<Option<usize>> = self.cloud.attributes.iter().map(column).collect();
        for chunk in &mut self.cloud.chunks {
            let of = |column: &Option<usize>| chunk.columns.get((*column)?)?.clone();
            chunk.columns = columns.iter().map(of).collect();
        }
    }

    /// The attributes that the cloud has, and then those that it would have if it was asked for them.
    pub fn offered(&self) -> impl Iterator<Item = &Attribute> {
        let is_had = |attribute: &Attribute| self.cloud.attributes.iter().any(|known| known.name == attribute.name);
        let further = self.offered.iter().filter(move |attribute| !is_had(attribute));
        self.cloud.attributes.iter().chain(further)
    }

    /// Ends the reading. Returns the file's warnings that were not known when it was opened.
    pub fn end(&mut self, summary: &codec::Summary) -> Vec<String> {
        self.is_read = true;
        self.was_stopped = summary.cancelled;
        self.is_cut = summary.cancelled || summary.missing > 0 || self.missing() > 0;
        let new = summary.warnings.iter().filter(|warning| !self.warnings.contains(warning));
        new.cloned().collect()
    }

    /// Sets normals and radii, one list for each chunk, for the points as the file has them.
    pub fn put_surfels(&mut self, surfels: Vec<Surfels>) -> Vec<Change> {
        self.full_radii = None;
        for ((chunk, own), surfels) in self.cloud.chunks.iter_mut().zip(&mut self.own).zip(surfels) {
            let normals = Arc::new(surfels.normals);
            chunk.normals = Some(self.placement.map_or_else(|| normals.clone(), |placed| placed.normals(&normals)));
            own.normals = Some(normals);
            chunk.radii = Some(Arc::new(surfels.radii));
        }
        self.puts()
    }

    /// Whether the radii of all points are there, and were estimated from them.
    pub fn has_estimated_radii(&self) -> bool {
        let is_estimated = |chunk: &Chunk| chunk.radii.is_some() && chunk.corners.is_none();
        self.is_read && self.source.is_some() && self.pages.is_none() && self.cloud.chunks.iter().all(is_estimated)
    }

    /// The cloud as its file has it, with the radii that follow from all points.
    pub fn with_full_radii(&self) -> Cloud {
        let mut cloud = self.cloud.clone();
        for (chunk, own) in cloud.chunks.iter_mut().zip(&self.own) {
            put_places(chunk, own.clone());
        }
        cloud.grid = cloud.grid.map(Grid::of_file);
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

    /// Adds a column that was read after the points, by the first records of the chunks. The changes bring it to the GPU;
    /// its colours are shown by the next `Change::Color`.
    pub fn put_late_column(&mut self, attribute: usize, columns: BTreeMap<u64, Arc<Column>>) -> Vec<Change> {
        for chunk in &mut self.cloud.chunks {
            put_column(chunk, attribute, &columns);
        }
        self.late_columns.insert(attribute, columns);
        self.puts()
    }

    /// How the points have been moved.
    pub fn placement(&self) -> Option<Placement> {
        self.placement
    }

    /// What `Moved` needs, to move the points somewhere else.
    pub fn own(&self) -> Own {
        Own { chunks: self.parts.iter().copied().zip(self.own.iter().cloned()).collect(), grid: self.cloud.grid }
    }

    /// Takes over points that were moved. Those that came or changed meanwhile are moved here.
    pub fn put_moved(&mut self, moved: Moved) -> Vec<Change> {
        let Moved { placement, chunks } = moved;
        self.placement = placement;
        self.cloud.grid = self.cloud.grid.map(|grid| Grid { placement, ..grid });
        let mut chunks: BTreeMap<Part, (Chunk, Chunk)> = chunks.into_iter().collect();
        for (index, part) in self.parts.iter().enumerate() {
            let own = &self.own[index];
            let is_same = |known: &Chunk| {
                let normals = [&known.normals, &own.normals].map(|normals| normals.as_ref().map(Arc::as_ptr));
                Arc::ptr_eq(&known.positions, &own.positions) && normals[0] == normals[1]
            };
            let placed = match chunks.remove(part) {
                Some((known, placed)) if is_same(&known) => placed,
                _ => placement.map_or_else(|| own.clone(), |placement| own.placed(&placement, self.cloud.grid)),
            };
            put_places(&mut self.cloud.chunks[index], placed);
            self.chunk_bounds[index] = self.cloud.chunks[index].bounds();
        }
        let loaded = self.chunk_bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        let index_bounds = self.index_bounds();
        self.bounds = index_bounds.map_or(loaded, |bounds| bounds.union(loaded));
        let bounds = self.scene_bounds().map(|bounds| Change::Bounds { cloud: self.key, bounds });
        bounds.into_iter().chain(self.puts()).collect()
    }

    pub fn puts(&self) -> Vec<Change> {
        let layout = self.layout();
        let put = |(part, chunk)| Change::Put { key: self.key.chunk(part), chunk, layout: layout.clone() };
        self.chunks().into_iter().map(put).collect()
    }

    /// The chunks as they would be with another placement, and what the test of their points needs to know then.
    pub fn standing(&self, placement: Option<Placement>) -> (Vec<(Part, Chunk)>, Arc<CloudLayout>) {
        let mut chunks = self.chunks();
        let grid = self.cloud.grid.map(|grid| Grid { placement, ..grid });
        if placement != self.placement {
            let moved = self.own().placed(placement).chunks;
            chunks.iter_mut().zip(moved).for_each(|((_, chunk), (_, (_, placed)))| put_places(chunk, placed));
        }
        (chunks, Arc::new(CloudLayout { grid, ..self.cloud.layout() }))
    }

    /// What the test of its points needs to know.
    pub fn layout(&self) -> Arc<CloudLayout> {
        Arc::new(self.cloud.layout())
    }

    /// All changes that put the cloud on the GPU, in a fixed order.
    pub fn changes(&self) -> Vec<Change> {
        let open = Change::Open { cloud: self.key, provisional_radius: self.provisional_radius };
        let bounds = self.scene_bounds().map(|bounds| Change::Bounds { cloud: self.key, bounds });
        std::iter::once(open).chain(bounds).chain(self.puts()).collect()
    }

    /// Where the cloud lies, by its `bounds` without stray points.
    pub fn place(&self, bounds: Bounds) -> Place<'_> {
        Place { name: &self.cloud.name, bounds, points: self.points, system: self.crs.as_deref(), units: self.units }
    }

    /// What filters may test of it.
    pub fn offer(&self, settings: &Settings) -> Offer {
        Offer::new(self.cloud.name.clone(), self.offered().cloned().collect(), settings)
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

    /// Which of its parts are loaded, for what asks whether points are missing somewhere.
    pub fn loaded_parts(&self) -> LoadedParts {
        LoadedParts {
            parts: self.chunk_bounds().collect(),
            streamed: self.pages.as_ref().map(|_| self.octree().cloned()),
            is_cut: self.is_cut,
            placement: self.placement,
        }
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
        let of_file = self.expected_points.saturating_add(if self.is_cut { self.missing() } else { 0 });
        self.octree().map_or(of_file, |octree| octree.points()).max(self.points)
    }

    /// The number of points that its file promises and does not have.
    fn missing(&self) -> u64 {
        self.source.as_ref().map_or(0, |source| source.info().missing)
    }

    pub fn octree(&self) -> Option<&Arc<Octree>> {
        match &self.pages {
            Some(IndexState::Indexed { octree, .. }) => Some(octree),
            Some(IndexState::Indexing) | None => None,
        }
    }

    /// The bounds of all points, if an index states them; where the points are turned, of the turned box.
    pub fn index_bounds(&self) -> Option<Bounds> {
        Some(self.in_scene(self.octree()?.nodes.first()?.bounds))
    }

    /// The bounds of all points but strays, if there is an index.
    fn scene_bounds(&self) -> Option<Bounds> {
        Some(self.in_scene(self.octree()?.scene_bounds()))
    }

    fn in_scene(&self, own: Bounds) -> Bounds {
        self.placement.map_or(own, |placement| placement.bounds(own))
    }

    /// Whether its index was made by this job instead of found.
    pub fn was_built(&self) -> bool {
        matches!(self.pages, Some(IndexState::Indexed { was_built: true, .. }))
    }
}

/// The places and normals of a chunk.
fn places_of(chunk: &Chunk) -> Chunk {
    let Chunk { first_point, origin, positions, exact_positions, normals, .. } = chunk.clone();
    Chunk { positions, exact_positions, normals, ..Chunk::new(first_point, origin, Vec::new()) }
}

fn put_places(chunk: &mut Chunk, places: Chunk) {
    let Chunk { origin, positions, exact_positions, normals, .. } = places;
    (chunk.origin, chunk.positions) = (origin, positions);
    (chunk.exact_positions, chunk.normals) = (exact_positions, normals);
}

/// The places and normals of the points of a cloud as its file has them.
#[derive(Clone)]
pub struct Own {
    chunks: Vec<(Part, Chunk)>,
    grid: Option<Grid>,
}

/// The points of a cloud, turned and moved, for `Assembly::put_moved`.
pub struct Moved {
    pub placement: Option<Placement>,
    /// The chunks as the file has them, and as they are placed.
    chunks: Vec<(Part, (Chunk, Chunk))>,
}

impl Own {
    /// Moves all points, on all cores.
    pub fn placed(self, placement: Option<Placement>) -> Moved {
        let Self { chunks, grid } = self;
        let place = |(part, own): (Part, Chunk)| {
            let placed = placement.map_or_else(|| own.clone(), |placement| own.placed(&placement, grid));
            (part, (own, placed))
        };
        Moved { placement, chunks: chunks.into_par_iter().map(place).collect() }
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
    use cloud::{Attribute, ColumnType, PointTest};
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
    fn points_are_moved_from_where_the_file_has_them_whenever_they_come() {
        let turn = |degrees: f64| {
            let turn = glam::DQuat::from_rotation_z(degrees.to_radians());
            Some(Placement::new(turn, DVec3::ONE, DVec3::new(0.0, 0.0, 10.0)))
        };
        let (mut before, mut after) = (opened(), opened());
        before.put(Part::Block(0), classes(0, &[1, 2]));
        let own = before.own();
        // A chunk that comes while the others are moved is moved, too.
        before.put(Part::Block(2), classes(2, &[3]));
        assert_eq!(before.put_moved(own.placed(turn(33.0))).len(), 2, "both chunks are sent");
        drop(after.put_moved(after.own().placed(turn(33.0))));
        after.put(Part::Block(2), classes(2, &[3]));
        after.put(Part::Block(0), classes(0, &[1, 2]));
        let places = |cloud: &Assembly| -> Vec<DVec3> {
            let of = |chunk: &Chunk| (0..chunk.len()).map(|index| chunk.position(index)).collect::<Vec<_>>();
            cloud.cloud.chunks.iter().flat_map(of).collect()
        };
        assert_eq!((places(&before), before.bounds), (places(&after), after.bounds));
        // Moves do not add up: each starts from the file.
        for degrees in (0..50).map(|step| f64::from(step) * 7.3).chain([90.0]) {
            drop(before.put_moved(before.own().placed(turn(degrees))));
        }
        let expected = [[1.0, 1.0, 11.0], [0.0, 2.0, 12.0], [-1.0, 3.0, 13.0]].map(DVec3::from);
        let off = places(&before).into_iter().zip(expected).map(|(place, expected)| place.distance(expected));
        assert!(off.fold(0.0, f64::max) < 1e-6, "{:?}", places(&before));
        let up = cloud::pack_normal(glam::Vec3::X);
        drop(
            before
                .put_surfels([2, 1].map(|points| Surfels { normals: vec![up; points], radii: vec![7; points] }).into()),
        );
        let normal = |cloud: &Assembly| cloud::unpack_normal(cloud.cloud.chunks[1].normals.as_ref().unwrap()[0]);
        assert!(normal(&before).unwrap().distance(glam::Vec3::Y) < 1e-3);
        let full = before.with_full_radii();
        assert_eq!((full.chunks[1].position(0), full.chunks[1].radii.is_some()), (DVec3::splat(3.0), true));
        drop(before.put_moved(before.own().placed(None)));
        assert_eq!((places(&before)[2], normal(&before)), (DVec3::splat(3.0), Some(glam::Vec3::X)));
        assert_eq!(before.bounds.max, DVec3::splat(3.0));
    }

    #[test]
    fn columns_follow_the_attributes_of_another_index() {
        let attribute = |name: &str| Attribute { name: name.into(), column_type: ColumnType::U8 };
        let offered = ["gps_time", "classification", "angle"].map(attribute).into();
        let attributes = vec![attribute("classification")];
        let mut cloud =
            Assembly::open(CloudKey(3), Opened { attributes, offered, expected_points: 9, ..Opened::default() }).0;
        cloud.put(Part::Node(NodeId(0)), classes(0, &[1, 2]));
        let names = |cloud: &Assembly| cloud.offered().map(|known| known.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&cloud), ["classification", "gps_time", "angle"]);
        let filter = |name: &str| cloud::Filter { attribute: name.into(), low: 0.0, high: 1.0 };
        let test = PointTest::new([], ["gps_time", "of_no_file"].map(filter).into(), Vec::new());
        let offer = cloud.offer(&Settings::default());
        let idle: Vec<&str> = test.idle_filters(&offer.attributes).collect();
        assert_eq!(idle, ["of_no_file"], "what the file has may come");
        let octree = Arc::new(Octree::new(DVec3::ZERO, 1.0, 0.1, Vec::new()));
        let attributes = ["angle", "classification"].map(attribute).to_vec();
        let (grid, entry) = (None, None);
        cloud.page(IndexState::Indexed { octree, attributes, grid, was_built: true, has_surfels: false, entry });
        let columns = &cloud.cloud.chunks[0].columns;
        assert!(columns[0].is_none() && columns[1].as_ref().unwrap().value(1) == 2.0);
        assert_eq!(names(&cloud), ["angle", "classification", "gps_time"]);
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
