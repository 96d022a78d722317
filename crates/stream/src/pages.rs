//! A readable index: the octree of a cloud and the points of each of its nodes. A COPC file is an index as it is; for
//! all other files one is made:
//!
//! A folder holds two files. `pages` contains the points, one page per node. `nodes` describes them: the lattice, the
//! attributes and, for each node, the offset of its page and its checksum. `nodes` is written last and renamed into
//! place, so an index is either whole or absent. Both files are checked when they are read: sizes against the files
//! before anything is allocated, contents against checksums.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::{Attribute, Bounds, Chunk, ColumnType, Grid, SurfelOptions, Surfels, attribute_named};
use codec::{CopcPage, PageNodes, Source};
use glam::DVec3;
use rayon::prelude::*;

use crate::cache::Cache;
use crate::copc::{self, CopcPages, Frame};
use crate::entry::{MAGIC, NODES, PAGES, UNFINISHED};
use crate::lattice::{Cell, Lattice};
use crate::page::{self, Place};
use crate::records::{Layout, is_believable};
use crate::storage::Storage;
use crate::surfel_file::SurfelFile;
use crate::{Error, Node, NodeId, Octree, Result, plan, regular_file};

/// The number of the builder of indexes: indexes with another one are made again. It grows with each change of the form
/// of an index, of how points are shared out among nodes, and of what readers make of a file. A test holds it
/// (tests/builder.rs).
pub const BUILDER: u32 = 4;
/// Bytes before the body: magic, version, checksum of the body.
const HEAD_BYTES: usize = 16;
/// The size of a node's row in the table, in bytes.
const NODE_BYTES: usize = 4 + 4 + 4 + 8 + 4 + 2 * 24;
/// The largest size of the table without its nodes in bytes: attributes and warnings.
const MOST_TABLE_BYTES: u64 = 16 << 20;
/// More levels than any builder makes.
const MOST_LEVELS: u8 = 63;
/// The number of distances between neighbouring points of a node across its width.
pub(crate) const SPACINGS_PER_WIDTH: f64 = 128.0;

/// An index that many threads can read at once.
pub struct Pages {
    folder: PathBuf,
    summary: Summary,
    octree: Octree,
    points: Points,
    surfels: Option<SurfelFile>,
    /// The cache that holds it, if it was opened there.
    cache: Option<Cache>,
    /// A shared lock for as long as the index is open, so that nobody clears it.
    _lock: Option<File>,
}

/// Where the points of nodes are read from.
enum Points {
    Own { places: Vec<Page>, pages: Storage },
    Copc(CopcPages),
}

/// What an index says of itself besides its nodes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Summary {
    /// The identity of the files that it was made from.
    pub key: u128,
    /// Whether the lattice is the finest of the files' own grids.
    pub on_grid: bool,
    pub lattice: Lattice,
    pub layout: Layout,
    /// The number of points left out because they are not finite.
    pub skipped: u64,
    pub warnings: Vec<String>,
}

/// Where the points of a node are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Page {
    pub place: Place,
    pub offset: u64,
    pub checksum: u32,
}

/// A node as a builder writes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Written {
    pub cell: Cell,
    pub points: u32,
    pub page: Page,
}

impl Pages {
    /// Opens the index in a folder.
    ///
    /// # Errors
    /// `Damaged` if it is not whole or of another version, `Io` if it cannot be read.
    pub fn open(entry: &Path) -> Result<Self> {
        let lock =
            regular_file::open_regular(&crate::cache::lock_path(entry)).ok().filter(|lock| lock.lock_shared().is_ok());
        Self::open_locked(entry, lock)
    }

    pub(crate) fn open_locked(entry: &Path, lock: Option<File>) -> Result<Self> {
        let path = entry.join(NODES);
        let pages = Storage::open(&entry.join(PAGES))?;
        let table = Storage::open(&path)?;
        // Every node has a point at least, so the pages bound the length of the table.
        if table.length() > MOST_TABLE_BYTES.saturating_add(pages.length().saturating_mul(NODE_BYTES as u64)) {
            return Err(Error::damaged(&path, "longer than a table of the nodes of these pages"));
        }
        let mut bytes = vec![0; table.length() as usize];
        table.read(0, &mut bytes)?;
        let damaged = |problem: String| Error::damaged(&path, problem);
        let (summary, octree, places) = parse(&bytes, pages.length()).map_err(damaged)?;
        // If the file of normals and radii cannot be used for whatever reason, they are estimated again.
        let surfels = SurfelFile::open(entry, summary.key, &octree).ok();
        let points = Points::Own { places, pages };
        Ok(Self { folder: entry.to_owned(), summary, octree, points, surfels, cache: None, _lock: lock })
    }

    pub(crate) fn locked_by(self, lock: Option<File>) -> Self {
        Self { _lock: lock, ..self }
    }

    pub(crate) fn kept_in(self, cache: &Cache) -> Self {
        Self { cache: Some(cache.clone()), ..self }
    }

    /// Clears others from the cache if this one has grown.
    pub(crate) fn keep_limit(&self) {
        if let Some(cache) = &self.cache {
            cache.make_room(0);
        }
    }

    /// Runs `change` on the folder if it still belongs to this index.
    ///
    /// # Errors
    /// `Damaged` if the index was set aside, made anew or deleted since it was opened.
    pub(crate) fn in_place<T>(&self, change: impl FnOnce() -> Result<T>) -> Result<T> {
        let _turn = self.cache.as_ref().and_then(Cache::no_setting_aside);
        match &self.points {
            Points::Own { pages, .. } if !pages.is_in_place() => Err(Error::damaged(
                &self.folder,
                "the index was replaced or deleted while it was in use; open it again",
            )),
            _ => change(),
        }
    }

    /// Whether the normals and radii are damaged but the points are not. Reads all of them.
    pub(crate) fn has_bad_surfels_only(&self) -> bool {
        let Some(surfels) = &self.surfels else { return false };
        let nodes = || (0..self.octree.nodes.len() as u32).into_par_iter().map(NodeId);
        let bad = |error: Option<Error>| matches!(error, Some(Error::Damaged { .. }));
        nodes().any(|node| bad(surfels.read(&self.octree, node).err()))
            && nodes().all(|node| self.read_page(node).is_ok())
    }

    /// The index that a COPC file contains; `None` for other files. Chunks have the attributes that every index keeps,
    /// and those of `also`. Its nodes may have no points of their own, or more points than a chunk has elsewhere, up to
    /// `codec::Copc::MOST_POINTS`.
    pub fn copc(source: &Arc<Source>, also: &BTreeSet<String>) -> Option<Self> {
        let copc = source.copc()?;
        let info = source.info();
        let grid = info.grid?;
        let octree = copc::octree(copc, &Frame::new(copc, grid, info.bounds), info.points);
        let attributes = plan::index_attributes(std::slice::from_ref(source), also);
        let column = |kept: &Attribute| attribute_named(&info.attributes, &kept.name);
        let columns = attributes.iter().filter_map(column).collect();
        let color_bytes = if info.has_colors { 3 } else { 0 };
        let lattice = Lattice { grid, corner: octree.corner, width: octree.width };
        let summary = Summary {
            key: 0,
            on_grid: true,
            lattice,
            layout: Layout { wide: false, color_bytes, normals: false, attributes },
            skipped: 0,
            warnings: info.warnings.clone(),
        };
        let points = Points::Copc(CopcPages::new(source.clone(), copc.nodes.clone(), columns));
        Some(Self { folder: info.path.clone(), summary, octree, points, surfels: None, cache: None, _lock: None })
    }

    /// The COPC file that the index is, or the EPT; `None` for an index of ours.
    pub(crate) fn of_copc(&self) -> Option<&CopcPages> {
        match &self.points {
            Points::Copc(copc) => Some(copc),
            Points::Own { .. } => None,
        }
    }

    /// One page of the list of nodes of a COPC file or of EPT.
    ///
    /// # Errors
    /// If it cannot be read, or says what no page may say.
    pub fn read_list(&self, page: &CopcPage) -> Result<PageNodes> {
        match &self.points {
            Points::Copc(copc) => Ok(copc.source.read_copc_page(page)?),
            Points::Own { .. } => Err(Error::damaged(&self.folder, "an index of ours has one list of nodes")),
        }
    }

    /// The nodes that are known from the opening, whichever others are in memory: those of the first page.
    pub(crate) fn first_nodes(&self) -> usize {
        let copc = self.of_copc().and_then(|copc| copc.source.copc());
        copc.map_or(self.octree.nodes.len(), |copc| copc.first)
    }

    /// Whether the index is a COPC file itself.
    pub fn is_copc(&self) -> bool {
        matches!(self.points, Points::Copc(_))
    }

    /// The folder of the index, or the COPC file.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The size of the index on the disk in bytes.
    pub fn bytes(&self) -> u64 {
        if self.is_copc() {
            std::fs::metadata(&self.folder).map_or(0, |file| file.len())
        } else {
            crate::cache::bytes_in(&self.folder)
        }
    }

    /// The identity of the files that it was made from: equal for the same, unchanged files. 0 for a COPC file.
    pub fn key(&self) -> u128 {
        self.summary.key
    }

    pub fn octree(&self) -> &Octree {
        &self.octree
    }

    /// The attributes in the order of the chunks' columns.
    pub fn attributes(&self) -> &[Attribute] {
        &self.summary.layout.attributes
    }

    /// The files' own grid, the finest if they have several; `None` if a file has none.
    pub fn grid(&self) -> Option<Grid> {
        self.summary.on_grid.then_some(self.summary.lattice.grid)
    }

    pub fn has_colors(&self) -> bool {
        self.summary.layout.color_bytes > 0
    }

    /// Whether the files had normals.
    pub fn has_normals(&self) -> bool {
        self.summary.layout.normals
    }

    /// Whether normals and radii of all points are known.
    pub fn has_surfels(&self) -> bool {
        self.surfels.is_some()
    }

    /// How normals and radii were estimated, if they are known.
    pub fn surfel_options(&self) -> Option<&SurfelOptions> {
        self.surfels.as_ref().map(SurfelFile::options)
    }

    /// The number of points of the files that are in no node because they are not finite.
    pub fn skipped_points(&self) -> u64 {
        self.summary.skipped
    }

    /// The warnings about the files from when the index was made.
    pub fn warnings(&self) -> &[String] {
        &self.summary.warnings
    }

    /// The size of a decoded point in bytes, with its normal and radius; larger in a node that [`Node::is_exact`].
    pub fn point_bytes(&self) -> u64 {
        let columns: usize = self.attributes().iter().map(|attribute| attribute.column_type.size()).sum();
        // Position, normal and radius; colour; attributes.
        (12 + 4 + 2 + 4 * usize::from(self.has_colors()) + columns) as u64
    }

    /// The size of a page on disk in bytes.
    pub fn page_bytes(&self, node: NodeId) -> usize {
        let index = node.0 as usize;
        match &self.points {
            Points::Own { places, .. } => self.own_page_bytes(index, &places[index]),
            Points::Copc(copc) => copc.page_bytes(node),
        }
    }

    fn own_page_bytes(&self, index: usize, page: &Page) -> usize {
        page.place.length(&self.summary.layout, self.octree.nodes[index].points as usize)
    }

    /// All points of a node in batch order, with all columns of the index. The first `prefix` of them are an even
    /// subset.
    ///
    /// # Errors
    /// `Damaged` if the page is not what was written, `Io` if it cannot be read, `Input` for a COPC file.
    pub fn read(&self, node: NodeId) -> Result<Chunk> {
        let mut chunk = self.read_page(node)?;
        if let Some(surfels) = &self.surfels {
            let Surfels { normals, radii } = surfels.read(&self.octree, node)?;
            (chunk.normals, chunk.radii) = (Some(Arc::new(normals)), Some(Arc::new(radii)));
        }
        Ok(chunk)
    }

    /// The points as the files had them, without estimates.
    pub(crate) fn read_page(&self, node: NodeId) -> Result<Chunk> {
        let index = node.0 as usize;
        let (places, pages) = match &self.points {
            Points::Own { places, pages } => (places, pages),
            Points::Copc(copc) => return copc.read(node, &self.octree),
        };
        let page @ Page { place, offset, checksum } = &places[index];
        let Node { points, first_point, .. } = self.octree.nodes[index];
        let mut bytes = vec![0; self.own_page_bytes(index, page)];
        pages.read(*offset, &mut bytes)?;
        if crc32fast::hash(&bytes) != *checksum {
            return Err(Error::damaged(pages.path(), format!("the page of node {index} has changed")));
        }
        let Summary { layout, lattice, on_grid, .. } = &self.summary;
        Ok(page::decode(layout, lattice, place, points as usize, first_point, *on_grid, &bytes))
    }
}

/// Writes `nodes` and renames it into place.
pub(crate) fn write(folder: &Path, summary: &Summary, nodes: Vec<Written>) -> Result<()> {
    let mut body = Vec::new();
    write_summary(&mut body, summary);
    write_nodes(&mut body, nodes);
    let path = folder.join(NODES);
    let unfinished = folder.join(UNFINISHED);
    let written =
        regular_file::check_writable(&unfinished).and_then(|()| File::create(&unfinished)).and_then(|mut file| {
            file.write_all(&MAGIC)?;
            file.write_all(&BUILDER.to_le_bytes())?;
            file.write_all(&crc32fast::hash(&body).to_le_bytes())?;
            file.write_all(&body)?;
            file.sync_data()?;
            std::fs::rename(&unfinished, &path)
        });
    written.map_err(|error| Error::not_written(&path, error))
}

fn write_summary(body: &mut Vec<u8>, summary: &Summary) {
    let Summary { key, on_grid, lattice, layout, skipped, warnings } = summary;
    body.extend(key.to_le_bytes());
    body.extend([u8::from(*on_grid), u8::from(layout.wide), layout.color_bytes as u8, u8::from(layout.normals)]);
    for value in [lattice.grid.scale, lattice.grid.offset, lattice.corner].iter().flat_map(DVec3::to_array) {
        body.extend(value.to_le_bytes());
    }
    body.extend(lattice.width.to_le_bytes());
    body.extend(skipped.to_le_bytes());
    body.extend((layout.attributes.len() as u32).to_le_bytes());
    for attribute in &layout.attributes {
        write_text(body, attribute.column_type.name());
        write_text(body, &attribute.name);
    }
    body.extend((warnings.len() as u32).to_le_bytes());
    warnings.iter().for_each(|warning| write_text(body, warning));
}

fn write_text(body: &mut Vec<u8>, text: &str) {
    body.extend((text.len() as u32).to_le_bytes());
    body.extend(text.as_bytes());
}

/// Sorts parents before children: by level, then by position.
fn write_nodes(body: &mut Vec<u8>, mut nodes: Vec<Written>) {
    let order = |cell: &Cell| (cell.level, cell.at[2], cell.at[1], cell.at[0]);
    nodes.sort_unstable_by_key(|node| order(&node.cell));
    body.extend((nodes.len() as u32).to_le_bytes());
    for node in &nodes {
        let parent = node
            .cell
            .parent()
            .map_or(Ok(0), |parent| nodes.binary_search_by_key(&order(&parent), |node| order(&node.cell)));
        debug_assert!(parent.is_ok(), "{:?} has no parent", node.cell);
        let Page { place, offset, checksum } = node.page;
        body.extend([node.cell.level, node.cell.octant() as u8, 0, 0]);
        body.extend((parent.unwrap_or(0) as u32).to_le_bytes());
        body.extend(node.points.to_le_bytes());
        body.extend(offset.to_le_bytes());
        body.extend(checksum.to_le_bytes());
        for value in place.corner.into_iter().chain(place.far) {
            body.extend(value.to_le_bytes());
        }
    }
}

/// Takes a body apart, never past its end.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (bytes, rest) = self.0.split_at_checked(count).ok_or("the file is cut short")?;
        self.0 = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    fn vector(&mut self) -> Result<DVec3, String> {
        let vector = DVec3::new(self.f64()?, self.f64()?, self.f64()?);
        if vector.is_finite() { Ok(vector) } else { Err("a number is not finite".into()) }
    }

    fn text(&mut self) -> Result<String, String> {
        let length = self.u32()? as usize;
        String::from_utf8(self.bytes(length)?.to_vec()).map_err(|error| error.to_string())
    }
}

type Parsed = (Summary, Octree, Vec<Page>);

fn parse(bytes: &[u8], pages_length: u64) -> Result<Parsed, String> {
    let mut reader = Reader(bytes);
    if reader.bytes(HEAD_BYTES).is_ok_and(|head| head[..8] != MAGIC) {
        return Err("not the node table of an index".into());
    }
    reader = Reader(bytes);
    reader.bytes(8)?;
    let version = reader.u32()?;
    if version != BUILDER {
        return Err(format!("an index of version {version}, expected {BUILDER}"));
    }
    if reader.u32()? != crc32fast::hash(reader.0) {
        return Err("the file has changed or is cut short".into());
    }
    let summary = parse_summary(&mut reader)?;
    let (octree, places) = parse_nodes(&mut reader, &summary, pages_length)?;
    Ok((summary, octree, places))
}

fn parse_summary(reader: &mut Reader<'_>) -> Result<Summary, String> {
    let key = u128::from_le_bytes(reader.array()?);
    let [on_grid, wide, color_bytes, normals] = reader.array()?.map(usize::from);
    if ![0, 3, 4].contains(&color_bytes) {
        return Err(format!("colours of {color_bytes} bytes"));
    }
    let grid = Grid::new(reader.vector()?, reader.vector()?);
    let (corner, width) = (reader.vector()?, reader.f64()?);
    if !(width > 0.0 && width.is_finite()) {
        return Err(format!("a root {width} wide"));
    }
    let skipped = reader.u64()?;
    let mut attributes = Vec::new();
    for _ in 0..reader.u32()? {
        let type_name = reader.text()?;
        let column_type = column_type(&type_name).ok_or_else(|| format!("an attribute of type {type_name}"))?;
        attributes.push(Attribute { name: reader.text()?, column_type });
    }
    let mut warnings = Vec::new();
    for _ in 0..reader.u32()? {
        warnings.push(reader.text()?);
    }
    let layout = Layout { wide: wide != 0, color_bytes, normals: normals != 0, attributes };
    Ok(Summary { key, on_grid: on_grid != 0, lattice: Lattice { grid, corner, width }, layout, skipped, warnings })
}

fn column_type(name: &str) -> Option<ColumnType> {
    use ColumnType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64].into_iter().find(|column_type| column_type.name() == name)
}

fn parse_nodes(reader: &mut Reader<'_>, summary: &Summary, pages_length: u64) -> Result<(Octree, Vec<Page>), String> {
    let count = reader.u32()? as usize;
    if count == 0 || count.checked_mul(NODE_BYTES) != Some(reader.0.len()) {
        return Err(format!("{count} nodes in {} bytes", reader.0.len()));
    }
    let mut nodes: Vec<Node> = Vec::with_capacity(count);
    let mut places = Vec::with_capacity(count);
    let mut first_point = 0;
    for index in 0..count {
        let wrong = |what: &str| format!("node {index} {what}");
        let [level, octant, _, _] = reader.array()?;
        let parent = reader.u32()? as usize;
        let points = reader.u32()?;
        let (offset, checksum) = (reader.u64()?, reader.u32()?);
        let mut integers = || reader.array().map(i64::from_le_bytes);
        let corner = [integers()?, integers()?, integers()?];
        let far = [integers()?, integers()?, integers()?];

        let place = Place { corner, far };
        if (0..3).any(|axis| corner[axis] > far[axis]) {
            return Err(wrong("ends before it starts"));
        }
        if points == 0 || points as usize > cloud::CHUNK_POINTS {
            return Err(wrong(&format!("has {points} points")));
        }
        let length = place.length(&summary.layout, points as usize) as u64;
        if offset.checked_add(length).is_none_or(|end| end > pages_length) {
            return Err(wrong("lies outside of the pages"));
        }
        let parent = (index > 0).then_some(parent);
        if let Some(parent) = parent {
            let above = nodes.get_mut(parent).ok_or_else(|| wrong("comes before its parent"))?;
            let slot = above.children.get_mut(usize::from(octant)).ok_or_else(|| wrong("is in no octant"))?;
            if above.level + 1 != level || level > MOST_LEVELS || slot.is_some() {
                return Err(wrong("is not where its parent says"));
            }
            *slot = Some(NodeId(index as u32));
        } else if level != 0 {
            return Err(wrong("is not the root"));
        }
        let ends = [corner, far].map(|end| summary.lattice.world(end));
        if !ends.into_iter().all(is_believable) {
            return Err(wrong("lies nowhere"));
        }
        let mut bounds = Bounds::EMPTY;
        ends.into_iter().for_each(|end| bounds.include(end));
        nodes.push(Node {
            level,
            bounds,
            points,
            is_exact: summary.on_grid && !place.fits_f32(),
            total: u64::from(points),
            first_point,
            parent: parent.map(|parent| NodeId(parent as u32)),
            children: [None; 8],
        });
        places.push(Page { place, offset, checksum });
        first_point += u64::from(points);
    }
    for index in (1..count).rev() {
        let (bounds, total) = (nodes[index].bounds, nodes[index].total);
        if let Some(NodeId(parent)) = nodes[index].parent {
            let above = &mut nodes[parent as usize];
            above.bounds = above.bounds.union(bounds);
            above.total += total;
        }
    }
    let Lattice { corner, width, .. } = summary.lattice;
    Ok((Octree::new(corner, width, width / SPACINGS_PER_WIDTH, nodes), places))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(cell: Cell) -> Written {
        let place = Place { corner: [0; 3], far: [100; 3] };
        Written { cell, points: 10, page: Page { place, offset: 0, checksum: 0 } }
    }

    /// A table of three nodes, without its head.
    fn table() -> Vec<u8> {
        table_on(Grid::new(DVec3::splat(0.001), DVec3::ZERO))
    }

    fn table_on(grid: Grid) -> Vec<u8> {
        let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::U16 }];
        let summary = Summary {
            key: 7,
            on_grid: true,
            lattice: Lattice { grid, corner: DVec3::ZERO, width: 1.0 },
            layout: Layout { wide: false, color_bytes: 3, normals: true, attributes },
            skipped: 1,
            warnings: vec!["one".into()],
        };
        let mut body = Vec::new();
        write_summary(&mut body, &summary);
        let child = Cell::ROOT.child(5);
        write_nodes(&mut body, vec![node(child.child(2)), node(child), node(Cell::ROOT)]);
        body
    }

    fn parse_body(body: &[u8]) -> Result<Parsed, String> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(BUILDER.to_le_bytes());
        bytes.extend(crc32fast::hash(body).to_le_bytes());
        bytes.extend(body);
        parse(&bytes, 1_000)
    }

    #[test]
    fn tables_that_lie_with_a_good_checksum_are_refused_or_harmless() {
        let body = table();
        let (_, octree, _) = parse_body(&body).unwrap();
        assert_eq!((octree.nodes.len(), octree.points()), (3, 30));
        assert_eq!(octree.nodes[0].children[5], Some(NodeId(1)));
        assert_eq!((octree.nodes[1].children[2], octree.nodes[2].parent), (Some(NodeId(2)), Some(NodeId(1))));
        for at in 0..body.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff, body[at].wrapping_add(1)] {
                let mut body = body.clone();
                body[at] = value;
                if let Ok((_, octree, _)) = parse_body(&body) {
                    assert!(octree.nodes.iter().all(|node| node.points as usize <= cloud::CHUNK_POINTS));
                }
            }
            assert!(parse_body(&body[..at]).is_err());
        }
    }

    #[test]
    fn nodes_beyond_all_numbers_are_refused() {
        for (scale, offset) in [(1e307, 0.0), (1e307, -1e308), (0.001, 1e31)] {
            let grid = Grid::new(DVec3::splat(scale), DVec3::splat(offset));
            let refused = parse_body(&table_on(grid)).unwrap_err();
            assert!(refused.ends_with("lies nowhere"), "{scale} {offset}: {refused}");
        }
    }
}
