//! Reads Entwine Point Tiles (EPT 1, entwine.io): a folder with `ept.json`, pages of a hierarchy (`hierarchy`) and a file of
//! points for each node of an octree (`tiles`): LAZ, or rows of numbers, which may be compressed (`zstandard`).
//!
//! `ept.json` and the hierarchy are claims: a tile with another number of points, other attributes or another grid than
//! they and the first tile say is not read, and the others are. A hierarchy that is larger than the memory for it, or has
//! several pages on a server, is read page by page, as views need its nodes. What is read stays within the tree, since all
//! names of files are made from the numbers of nodes.

pub(crate) mod hierarchy;
mod tiles;
mod zstandard;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use cloud::{Bounds, Chunk, Progress};
use glam::DVec3;
use rayon::prelude::*;
use serde::Deserialize;

use crate::address::{beside, last_part};
use crate::brief;
use crate::bytes::Bytes;
use crate::export::columns::{Colors, Field, Piece, Reading};
use crate::format::Format;
use crate::in_order::InOrder;
use crate::info::{Info, Selection, Summary};
use crate::las::{Copc, CopcNode, CopcPage, Key, PageNodes, most_nodes};
use crate::remote::Stamp;
use crate::units::wkt;
use crate::{Error, Result};
use hierarchy::{Entries, Hierarchy, name};
use tiles::{Dimension, Tile, TileRows};

/// The longest `ept.json`: a coordinate system has some kilobytes.
const MOST_DESCRIPTION: u64 = 4 << 20;
/// The number of tiles that are tried before a cloud is said to be unreadable.
const TRIED: usize = 8;

/// An octree of tiles.
pub struct EptSource {
    pub(crate) info: Info,
    file: Bytes,
    octree: Copc,
    /// The number of points before each node that is known from the opening.
    first_points: Vec<u64>,
    /// The cloud with its whole hierarchy, once it is read from end to end, if the hierarchy is read page by page.
    whole: OnceLock<std::result::Result<Box<EptSource>, String>>,
    /// The bytes of a point in the tiles, about.
    bytes_each: f64,
    /// How tiles of rows are read; `None` for LAZ.
    rows: Option<TileRows>,
    /// Whether the rows are compressed by Zstandard.
    is_compressed: bool,
    /// The tile whose columns, colours and grid all others have; `None` for a cloud without points.
    model: Option<Tile>,
    memory: u64,
    /// The stamps of the tiles at addresses that were opened, by their nodes: each stays the one that it was.
    opened: Mutex<HashMap<Key, Stamp>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Description {
    bounds: [f64; 6],
    bounds_conforming: Option<[f64; 6]>,
    data_type: String,
    #[serde(default)]
    hierarchy_type: String,
    #[serde(default)]
    points: u64,
    schema: Vec<Dimension>,
    /// The number of cells of a node along an axis, by its name of today and of before.
    span: Option<u32>,
    ticks: Option<u32>,
    #[serde(default)]
    srs: System,
    #[serde(default)]
    version: String,
}

#[derive(Default, Deserialize)]
struct System {
    wkt: Option<String>,
}

/// Whether a file is the description of an EPT, by its start.
pub fn is_ept(start: &[u8], path: &Path) -> bool {
    let text = start.trim_ascii_start();
    text.starts_with(b"{") && last_part(path) == "ept.json"
}

impl EptSource {
    /// `memory` bounds what decoders and the tables of nodes take, in bytes.
    ///
    /// # Errors
    /// If the description, the first page of the hierarchy or the first tiles cannot be used.
    pub fn open(file: Bytes, memory: u64) -> Result<Self> {
        // Each page of a hierarchy on a server is a request, and most views need few of them.
        let most = if file.is_remote() { 0 } else { most_nodes(memory) };
        Self::open_up_to(file, memory, most)
    }

    /// Reads a hierarchy of more than `most_whole` nodes page by page.
    fn open_up_to(file: Bytes, memory: u64, most_whole: usize) -> Result<Self> {
        let path = file.path().to_owned();
        let fail = |problem: String| Error::malformed(&path, "description", problem);
        let text = file.all(MOST_DESCRIPTION)?;
        let told: Description = serde_json::from_slice(&text)
            .map_err(|error| fail(format!("not one of EPT: {}", brief::message(&error))))?;
        let is_compressed = told.data_type == "zstandard";
        let rows = match told.data_type.as_str() {
            "laszip" => None,
            "binary" | "zstandard" => Some(TileRows::new(&told.schema).map_err(fail)?),
            other => {
                let other = brief::brief(other);
                return Err(fail(format!("tiles of type `{other}`, expected laszip, binary or zstandard")));
            }
        };
        if !matches!(told.hierarchy_type.as_str(), "" | "json") {
            let other = brief::brief(&told.hierarchy_type);
            return Err(fail(format!("a hierarchy of type `{other}`, expected json")));
        }
        let (corner, width, spacing) = told.cube().map_err(fail)?;
        let most = most_nodes(memory);
        let octree = Copc::of_tiles(corner, width, spacing, most);
        let first = hierarchy::page(file.base(), (0, [0; 3]))?;
        let (octree, warnings) = match first_page(&path, &first, told.points, most_whole, most)? {
            Some(first) => (octree.with_first_page(first), Vec::new()),
            None => whole_octree(octree, hierarchy::read(file.base(), first, most)).map_err(fail)?,
        };
        let is_paged = !octree.further.is_empty();
        let counted = octree.nodes.iter().map(|node| u64::from(node.points)).sum();
        let mut info = Info::of_rows(&path, Format::Ept, format!("{} {}", told.version, told.data_type));
        info.points = if is_paged { told.points } else { counted };
        info.bounds = told.points_bounds(corner, width).filter(|_| info.points > 0);
        info.crs = told.srs.wkt.as_deref().map(str::trim).filter(|wkt| !wkt.is_empty()).map(str::to_owned);
        info.epsg = info.crs.as_deref().and_then(wkt::level_code);
        info.units = info.crs.as_deref().map(wkt::units).unwrap_or_default();
        info.warnings = warnings;
        info.missing = told.points.saturating_sub(info.points);
        if told.points != info.points {
            info.warnings.push(format!("it says {} points, its hierarchy has {}", told.points, info.points));
        }
        let mut points = 0;
        let first_points = octree.nodes.iter().map(|node| {
            points += u64::from(node.points);
            points - u64::from(node.points)
        });
        let first_points = first_points.collect();
        info.grid = rows.as_ref().and_then(|_| TileRows::grid(&told.schema));
        let (whole, bytes_each, opened) = (OnceLock::new(), 0.0, Mutex::default());
        let mut source = Self {
            info,
            file,
            octree,
            first_points,
            whole,
            bytes_each,
            rows,
            is_compressed,
            model: None,
            memory,
            opened,
        };
        source.find_model()?;
        Ok(source)
    }

    /// Opens the first tile, whose columns, colours and grid all others have.
    fn find_model(&mut self) -> Result<()> {
        let mut first_error = None;
        let filled: Vec<usize> = (0..self.octree.first).filter(|node| self.octree.nodes[*node].points > 0).collect();
        for node in filled.iter().take(TRIED) {
            match self.open_tile(&self.octree.nodes[*node]) {
                Ok((tile, length)) => {
                    let own = tile.info();
                    self.info.point_format = own.point_format;
                    self.info.properties = own.properties.clone();
                    self.info.attributes = own.attributes.clone();
                    self.info.grid = own.grid;
                    (self.info.has_colors, self.info.has_normals) = (own.has_colors, own.has_normals);
                    if self.info.crs.is_none() {
                        (self.info.crs, self.info.epsg, self.info.units) = (own.crs.clone(), own.epsg, own.units);
                    }
                    // The lengths of other tiles are not known before they are opened.
                    let bytes_each = length as f64 / own.points.max(1) as f64;
                    self.bytes_each = bytes_each;
                    self.octree
                        .nodes
                        .iter_mut()
                        .for_each(|node| node.bytes = (f64::from(node.points) * bytes_each) as u64);
                    self.model = Some(tile);
                    return Ok(());
                }
                Err(error) => drop(first_error.get_or_insert(error)),
            }
        }
        first_error.map_or(Ok(()), Err)
    }

    /// The path of the file with the points of a node.
    fn tile_path(&self, node: &CopcNode) -> PathBuf {
        let CopcNode { level, cell, .. } = *node;
        let ending = match &self.rows {
            None => "laz",
            Some(_) if self.is_compressed => "zst",
            Some(_) => "bin",
        };
        beside(self.file.base(), &format!("ept-data/{}.{ending}", name((level, cell))))
    }

    /// The points of a node.
    ///
    /// # Errors
    /// If its file is not there, or is not as the hierarchy and the first tile say.
    fn tile(&self, node: &CopcNode) -> Result<Tile> {
        self.open_tile(node).map(|(tile, _)| tile)
    }

    /// Opens the file with the points of a node. Returns the length of the file, too.
    fn open_tile(&self, node: &CopcNode) -> Result<(Tile, u64)> {
        let path = self.tile_path(node);
        Bytes::open_twice(&path, |path| self.open_bytes(node, path), |file| self.tile_of(file, node))
    }

    /// Opens the file of a node, which is the one that it was.
    fn open_bytes(&self, node: &CopcNode, path: &Path) -> Result<Bytes> {
        let key = (node.level, node.cell);
        let opened = || self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let before = opened().get(&key).cloned();
        let file = Bytes::open_small_again(path, before.as_ref())?;
        if let (None, Some(stamp)) = (before, file.stamp()) {
            opened().insert(key, stamp.clone());
        }
        Ok(file)
    }

    fn tile_of(&self, file: Bytes, node: &CopcNode) -> Result<(Tile, u64)> {
        let (path, length) = (file.path().to_owned(), file.length());
        let memory = self.memory / rayon::current_num_threads().max(1) as u64;
        let mut tile = match &self.rows {
            None => Tile::open_las(file, memory, self.model.as_ref())?,
            Some(rows) => {
                let file = if self.is_compressed { rows.decompressed(&file, node.points, memory)? } else { file };
                let info = Info { grid: self.info.grid, ..Info::of_rows(&path, Format::Ept, String::new()) };
                Tile::open_rows(file, rows, info, self.model.as_ref())?
            }
        };
        let fail = |problem: String| Error::malformed(&path, "tile", problem);
        let (points, expected) = (tile.info().points, u64::from(node.points));
        if points != expected {
            return Err(fail(format!("{points} points, the hierarchy says {expected}")));
        }
        if let Some(difference) = self.model.as_ref().and_then(|model| model.difference(&tile)) {
            return Err(fail(format!("its points have {difference} than those of the first tile")));
        }
        if let Some(placement) = self.info.placement {
            tile.info_mut().place(placement);
        }
        Ok((tile, length))
    }

    pub fn bytes(&self) -> &Bytes {
        &self.file
    }

    pub fn octree(&self) -> &Copc {
        &self.octree
    }

    pub fn has_wide_colors(&self) -> bool {
        self.model.as_ref().is_some_and(Tile::has_wide_colors)
    }

    pub fn standard_time(&self) -> Option<bool> {
        match self.model.as_ref()? {
            Tile::Las(model) => model.standard_time(),
            Tile::Rows(_) => None,
        }
    }

    /// The tiles that have points, the coarse ones first.
    fn filled(&self) -> Vec<usize> {
        (0..self.octree.nodes.len()).filter(|node| self.octree.nodes[*node].points > 0).collect()
    }

    /// One page of the hierarchy.
    pub fn read_page(&self, page: &CopcPage) -> Result<PageNodes> {
        let top = (page.level, page.cell);
        let entries = hierarchy::page(self.file.base(), top)?;
        let mut found = page_nodes(self.file.path(), top, &entries, self.octree.most_nodes)?;
        found.nodes.iter_mut().for_each(|node| node.bytes = (f64::from(node.points) * self.bytes_each) as u64);
        Ok(found)
    }

    /// The cloud with its whole hierarchy, as far as that fits in memory.
    pub fn whole(&self) -> Result<&Self> {
        if self.octree.further.is_empty() {
            return Ok(self);
        }
        let open = || {
            let opened =
                Bytes::open_small(self.file.path()).and_then(|file| Self::open_up_to(file, self.memory, usize::MAX));
            opened.map(Box::new).map_err(|error| error.to_string())
        };
        match self.whole.get_or_init(open) {
            Ok(whole) => Ok(whole),
            Err(problem) => Err(Error::unsuitable(self.file.path(), format!("it cannot be read whole: {problem}"))),
        }
    }

    pub fn read(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        let whole = self.whole()?;
        let mut summary = whole.read_tiles(selection, progress, emit)?;
        // What is wrong with the pages that were read only now.
        if !std::ptr::eq(whole, self) {
            summary.warnings.splice(0..0, whole.info.warnings.iter().cloned());
        }
        Ok(summary)
    }

    fn read_tiles(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        progress.set_total(self.info.points);
        let total = Mutex::new((0, Bounds::EMPTY, Vec::new(), None));
        let filled = self.filled();
        filled.par_iter().with_max_len(1).for_each(|node| {
            if progress.is_cancelled() {
                return;
            }
            let own = Progress::default();
            let first_point = self.first_points[*node];
            let emit = |mut chunk: Chunk| {
                chunk.first_point += first_point;
                progress.add(chunk.len() as u64);
                emit(chunk);
                if progress.is_cancelled() {
                    own.cancel();
                }
            };
            let read = self.tile(&self.octree.nodes[*node]).and_then(|tile| tile.read(selection, &own, &emit));
            let mut total = total.lock().unwrap_or_else(PoisonError::into_inner);
            match read {
                Ok(summary) => {
                    total.0 += summary.points;
                    total.1 = total.1.union(summary.bounds.unwrap_or(Bounds::EMPTY));
                    let key = self.key(*node);
                    total.2.extend(summary.warnings.into_iter().map(|told| format!("tile {}: {told}", name(key))));
                }
                Err(error) => {
                    let points = self.octree.nodes[*node].points;
                    total.2.push(format!("{points} points are missing: {error}"));
                    total.3.get_or_insert(error);
                }
            }
        });
        let (points, bounds, warnings, error) = total.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = error.filter(|_| points == 0) {
            return Err(error);
        }
        let warnings = param::few(warnings, "tiles with problems");
        let bounds = (!bounds.is_empty()).then_some(bounds);
        Ok(Summary { points, missing: 0, bounds, warnings, cancelled: progress.is_cancelled() })
    }

    fn key(&self, node: usize) -> Key {
        let CopcNode { level, cell, .. } = self.octree.nodes[node];
        (level, cell)
    }

    /// All points of one node.
    ///
    /// # Errors
    /// If its tile is missing or damaged.
    pub fn read_node(&self, node: &CopcNode, selection: &Selection) -> Result<Chunk> {
        if node.points == 0 {
            return Ok(Chunk::new(0, DVec3::ZERO, Vec::new()));
        }
        let mut chunk = self.tile(node)?.read_whole(selection)?;
        chunk.first_point += self.octree.place_of(node).map_or(0, |place| self.first_points[place]);
        Ok(chunk)
    }

    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        let whole = self.whole()?;
        if !std::ptr::eq(whole, self) {
            return whole.record(point);
        }
        if point >= self.info.points {
            let problem = format!("the cloud has {} points, counted from 0", self.info.points);
            return Err(Error::malformed(self.file.path(), format!("point {point}"), problem));
        }
        // Nodes without points have the same first point as the node after them.
        let node = self.first_points.partition_point(|first| *first <= point) - 1;
        self.tile(&self.octree.nodes[node])?.record(point - self.first_points[node])
    }

    pub fn column_fields(&self, colors: Colors) -> Vec<Field> {
        self.model.as_ref().map(|model| model.column_fields(colors)).unwrap_or_default()
    }

    /// Passes the columns of all tiles to `rows_of`, tile by tile. Returns what could not be read.
    pub fn read_columns_in_order(
        &self,
        wish: &Reading<'_>,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let mut problems = Vec::new();
        match self.whole() {
            Ok(whole) if !std::ptr::eq(whole, self) => {
                return whole.read_columns_in_order(wish, progress, order, rows_of);
            }
            Ok(_) => {}
            Err(error) => return vec![error.to_string()],
        }
        for node in self.filled() {
            if order.is_stopped() {
                break;
            }
            let first_point = self.first_points[node];
            let rows_of = |piece: Piece| rows_of(Piece { first_point: piece.first_point + first_point, ..piece });
            match self.tile(&self.octree.nodes[node]) {
                Ok(tile) => problems.append(&mut tile.read_columns_in_order(wish, progress, order, &rows_of)),
                Err(error) => problems.push(format!("{} points are missing: {error}", self.octree.nodes[node].points)),
            }
        }
        param::few(problems, "tiles with problems")
    }
}

impl Description {
    /// The lower corner of the cube, its width and the distance of neighbouring points in the root.
    fn cube(&self) -> std::result::Result<(DVec3, f64, f64), String> {
        let (min, max) = corners(self.bounds);
        let width = (max - min).max_element();
        let is_cube = min.is_finite() && max.is_finite() && width > 0.0 && (max - min).min_element() > 0.0;
        let span = self.span.or(self.ticks).unwrap_or(128);
        if !is_cube || !(1..=65_536).contains(&span) {
            let [min, max] = [min, max].map(brief::vector);
            return Err(format!("no cube: from {min} to {max}, {span} cells wide"));
        }
        Ok((min, width, width / f64::from(span)))
    }

    /// Where the points are, if it says so and that is believable.
    fn points_bounds(&self, corner: DVec3, width: f64) -> Option<Bounds> {
        let (min, max) = corners(self.bounds_conforming?);
        let bounds = Bounds { min: min.max(corner), max: max.min(corner + width) };
        (min.is_finite() && max.is_finite() && !bounds.is_empty()).then_some(bounds)
    }
}

fn corners(bounds: [f64; 6]) -> (DVec3, DVec3) {
    let [x, y, z, far_x, far_y, far_z] = bounds;
    (DVec3::new(x, y, z), DVec3::new(far_x, far_y, far_z))
}

/// What the first page of a hierarchy says, if it has more than `most_whole` nodes, so that the others are read page by page.
///
/// # Errors
/// If the page cannot be used.
fn first_page(
    path: &Path,
    entries: &Entries,
    points: u64,
    most_whole: usize,
    most: usize,
) -> Result<Option<PageNodes>> {
    let own = entries.iter().filter_map(|(_, points)| *points).filter(|points| *points > 0);
    let (count, sum) = own.fold((0_u64, 0_u64), |(count, sum), points| (count + 1, sum + u64::from(points)));
    // As many nodes as the description claims if all have as many points as those of the first page.
    let claimed = points.saturating_mul(count) / sum.max(1);
    let is_divided = entries.iter().any(|(_, points)| points.is_none());
    if !is_divided || claimed <= most_whole as u64 || entries.len() > most {
        return Ok(None);
    }
    page_nodes(path, (0, [0; 3]), entries, most).map(Some)
}

fn page_nodes(path: &Path, top: Key, entries: &Entries, most: usize) -> Result<PageNodes> {
    let nodes = entries.iter().filter_map(|(key, points)| {
        let points = points.filter(|points| *points > 0)?;
        Some(CopcNode::of_tile(*key, points, 0))
    });
    let further = entries.iter().filter(|(_, points)| points.is_none()).map(|(key, _)| CopcPage::of_file(*key));
    PageNodes::of(top, nodes.collect(), further.collect(), most)
        .map_err(|problem| Error::malformed(path, format!("page {}", name(top)), problem))
}

/// The octree of all nodes of a hierarchy and of those above them, and what is wrong with the hierarchy.
fn whole_octree(octree: Copc, found: Hierarchy) -> std::result::Result<(Copc, Vec<String>), String> {
    let Hierarchy { nodes, first, warnings } = found;
    let all = nodes.into_iter().map(|(key, points)| (key, CopcNode::of_tile(key, points, 0)));
    // A tree has no more nodes without points than 30 above each.
    let most = octree.most_nodes.saturating_mul(4).saturating_add(1024);
    let octree = octree.with_nodes(all.collect(), first, most);
    let octree = octree.ok_or_else(|| format!("more than {most} nodes, most of them without points"))?;
    Ok((octree, warnings))
}
