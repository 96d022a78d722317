//! Estimates normals and radii of all points of an index once it is complete.
//!
//! A neighbourhood must be seen at full density, and a place's points are spread over a node, all nodes below it and
//! its ancestors. So the tree is divided into *groups*: octants whose nodes hold a bounded number of points together. A
//! group is read whole, with the points of its ancestors that lie in it and a margin of its neighbours' points;
//! `cloud::estimate_part` estimates it, and its part of the file is written. The blocks of ancestors fill up group by
//! group.
//!
//! The file of the index (`surfel_file`) is written under another name beside a list of the finished groups, from which
//! a build that was killed goes on.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use cloud::{Bounds, Chunk, Progress, SurfelOptions, Surfels};
use glam::DVec3;
use rayon::prelude::*;

use crate::lattice::Cell;
use crate::storage::Storage;
use crate::surfel_file::{
    DONE, LOCK, MAGIC, POINT_BYTES, SURFELS, SurfelFile, UNFINISHED, VERSION, block_start, data_start, identity, pack,
    read_block, unpack,
};
use crate::{Error, Node, NodeId, Octree, Pages, Result, regular_file};

/// The size in bytes of an entry in the list of groups: group, points, checksum of both.
const DONE_BYTES: usize = 4 + 8 + 4;
/// The memory in bytes that a point takes while it is estimated: position, order, boxes, results twice (about 30
/// measured, in groups of 12.5 million points).
const WORKING_BYTES: u64 = 40;
/// The most points of a group, however much memory there is: half a minute of one core, the longest that a cancel waits
/// or a kill loses.
const MOST_POINTS: u64 = 1 << 24;
/// The least limit of a group's points: smaller groups are not worth their margin.
const FEWEST_POINTS: u64 = 1 << 16;
/// Cells at this level are not divided: points further down lie in one place.
const DEEPEST: u8 = 21;
/// The width of the margin in distances between neighbours, if the group's points lie evenly on its largest face.
/// Sixteen neighbours are within 2.3 distances, so a place may be a hundred times sparser than its group and still be
/// exact.
const MARGIN: f64 = 22.0;

/// The points of the levels nearest to the root that have up to `points` points together, but at least the root's:
/// enough of a cloud to guess from (`cloud::guess_orientation`). Of a list of nodes in several pages only the first counts.
pub fn coarsest(pages: &Pages, points: u64) -> Result<Vec<Chunk>> {
    let nodes = &pages.octree().nodes[..pages.first_nodes()];
    let mut per_level = vec![0_u64; 1 + usize::from(u8::MAX)];
    nodes.iter().for_each(|node| per_level[usize::from(node.level)] += u64::from(node.points));
    let mut total = 0;
    let levels = per_level.iter().take_while(|count| {
        total += **count;
        total <= points
    });
    let levels = levels.count().max(1);
    let wanted: Vec<NodeId> = (0_u32..)
        .map(NodeId)
        .zip(nodes)
        .filter(|(_, node)| usize::from(node.level) < levels)
        .map(|(id, _)| id)
        .collect();
    wanted.into_par_iter().map(|node| pages.read(node)).collect()
}

/// Estimates normals and radii of all points; `pages` has them when it is opened anew. Normals and radii that the files
/// have are kept. An existing estimate with the same options is not repeated. Uses about `memory` bytes; `progress`
/// counts points, including those in margins. Only one program estimates at a time: others wait and find the result.
///
/// The result is that of `cloud::estimate` over the whole cloud, except for ties between neighbours at equal distances
/// and for points whose nearest neighbours are further outside their group than the margin (docs/scale.md says how
/// many). No radius is carved (`SurfelOptions::seen_from`): that takes all points at once.
///
/// # Errors
/// `Cancelled`; finished groups are kept for the next time. `Damaged` if points are, or if the index was replaced or
/// deleted meanwhile: whatever replaces it is not touched. `Io` for a COPC file, which is not an index of ours.
/// `NotWritten`: with a full disk nothing is kept.
pub fn estimate_surfels(pages: &Pages, options: &SurfelOptions, memory: u64, progress: &Progress) -> Result<()> {
    let most = (memory / WORKING_BYTES).clamp(FEWEST_POINTS, MOST_POINTS);
    let estimated = estimate_in_groups(pages, options, most, progress);
    // An index is a folder in that of the cache.
    estimated.map_err(|error| error.of_cache(pages.folder().parent().unwrap_or(pages.folder())))
}

/// Estimates normals and radii in groups of up to `most` points.
fn estimate_in_groups(pages: &Pages, options: &SurfelOptions, most: u64, progress: &Progress) -> Result<()> {
    let folder = pages.folder();
    if pages.is_copc() {
        let problem = "a COPC file has no place for normals and radii; they are estimated node by node";
        return Err(Error::io(folder, std::io::Error::new(std::io::ErrorKind::Unsupported, problem)));
    }
    let _lock = lock(pages, progress)?;
    let octree = pages.octree();
    progress.set_total(octree.points());
    let identity = identity(pages.key(), octree, options);
    let made = SurfelFile::open(folder, pages.key(), octree);
    if made.is_ok_and(|made| crate::surfel_file::identity(pages.key(), octree, made.options()) == identity) {
        progress.add(octree.points());
        return Ok(());
    }
    let mut build = Build::start(pages, options, most, &identity)?;
    let result = build.run(progress).and_then(|()| build.finish(&identity));
    if result.as_ref().is_err_and(|error| error.is_full() || matches!(error, Error::Damaged { .. })) {
        pages.in_place(|| clear(folder))?;
    }
    result?;
    pages.keep_limit();
    Ok(())
}

/// Removes what an unfinished estimate left.
fn clear(folder: &Path) -> Result<()> {
    for name in [DONE, UNFINISHED] {
        let path = folder.join(name);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(Error::not_written(&path, error)),
            _ => {}
        }
    }
    Ok(())
}

fn lock(pages: &Pages, progress: &Progress) -> Result<File> {
    let path = &pages.folder().join(LOCK);
    let file = pages.in_place(|| {
        let file = regular_file::check_writable(path)
            .and_then(|()| File::options().create(true).truncate(false).write(true).open(path));
        file.map_err(|error| Error::not_written(path, error))
    })?;
    loop {
        let locked = file.try_lock();
        progress.set_waiting(matches!(locked, Err(std::fs::TryLockError::WouldBlock)));
        match locked {
            Ok(()) => return Ok(file),
            Err(std::fs::TryLockError::WouldBlock) if progress.is_cancelled() => return Err(Error::Cancelled),
            Err(std::fs::TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(50)),
            Err(std::fs::TryLockError::Error(error)) => return Err(Error::not_written(path, error)),
        }
    }
}

/// Octants of a node that are estimated together, or the whole tree.
#[derive(Debug, Default, PartialEq)]
struct Group {
    cells: Vec<Cell>,
    /// The nodes of the cells; a cell without a node has points of its ancestors only.
    nodes: Vec<NodeId>,
    /// The ancestors of the cells, root first.
    above: Vec<NodeId>,
}

/// Whether all points of the node and those below it lie at one place, and have no normals that could differ: then one
/// of them stands for all.
fn is_one_place(pages: &Pages, node: &Node) -> bool {
    node.bounds.min == node.bounds.max && !pages.has_normals()
}

/// For each node, the number of its points and those below it; a page whose points lie at one place counts as one.
fn weights(pages: &Pages) -> Vec<u64> {
    let nodes = &pages.octree().nodes;
    let own = |node: &Node| if is_one_place(pages, node) { 1 } else { u64::from(node.points) };
    let mut weights: Vec<u64> = nodes.iter().map(own).collect();
    for (index, node) in nodes.iter().enumerate().rev() {
        if let Some(parent) = node.parent {
            weights[parent.0 as usize] += weights[index];
        }
    }
    weights
}

/// Divides space into groups so that every point is in exactly one. The weights of a group's nodes sum to `most` at
/// most, without its ancestors' points.
fn groups(octree: &Octree, weights: &[u64], most: u64) -> Vec<Group> {
    struct Division<'a> {
        octree: &'a Octree,
        weights: &'a [u64],
        most: u64,
        groups: Vec<Group>,
    }
    fn divide(division: &mut Division<'_>, node: NodeId, cell: Cell, above: &[NodeId]) {
        let Division { octree, weights, most, .. } = *division;
        let Some(parent) = octree.nodes.get(node.0 as usize) else { return };
        if weights[node.0 as usize] <= most || cell.level >= DEEPEST {
            division.groups.push(Group { cells: vec![cell], nodes: vec![node], above: above.to_vec() });
            return;
        }
        let above = [above, &[node]].concat();
        let mut group = Group::default();
        let mut points = 0;
        for (octant, child) in parent.children.iter().enumerate() {
            let total = child.map_or(0, |child| weights[child.0 as usize]);
            if let Some(child) = child.filter(|_| total > most) {
                divide(division, child, cell.child(octant), &above);
                continue;
            }
            if points + total > most {
                division.groups.push(Group { above: above.clone(), ..std::mem::take(&mut group) });
                points = 0;
            }
            points += total;
            group.cells.push(cell.child(octant));
            group.nodes.extend(child);
        }
        if !group.cells.is_empty() {
            division.groups.push(Group { above, ..group });
        }
    }
    let mut division = Division { octree, weights, most, groups: Vec::new() };
    divide(&mut division, NodeId(0), Cell::ROOT, &[]);
    division.groups
}

/// The box of a cell in the world, without its upper sides. Neighbours share their sides to the bit, and sides that are
/// also sides of `within` are open: each position is in exactly one cell of a division of `within`, even one that
/// rounding has moved out.
fn space(octree: &Octree, cell: Cell, within: Cell) -> Bounds {
    let width = octree.width / f64::from(cell.level).exp2();
    let below = cell.level - within.level.min(cell.level);
    let side = |axis: usize, at: u64| octree.corner[axis] + at as f64 * width;
    let low = |axis: usize| {
        if cell.at[axis] == within.at[axis] << below { f64::NEG_INFINITY } else { side(axis, cell.at[axis]) }
    };
    let high = |axis: usize| {
        let end = cell.at[axis] + 1;
        if end == (within.at[axis] + 1) << below { f64::INFINITY } else { side(axis, end) }
    };
    Bounds { min: DVec3::new(low(0), low(1), low(2)), max: DVec3::new(high(0), high(1), high(2)) }
}

fn holds(space: &Bounds, position: DVec3) -> bool {
    position.cmpge(space.min).all() && position.cmplt(space.max).all()
}

/// The points of one node that a group reads.
struct NodePoints {
    node: NodeId,
    chunk: Chunk,
    own: Own,
}

/// The points of a part that belong to the group itself: the group writes their results.
enum Own {
    All,
    /// All points of the node, which lie at one place; the part contains only one of them. The number is that of the
    /// node's points.
    Equal(usize),
    /// Pairs of the index in the part's chunk and the index in the node.
    Some(Vec<(u32, u32)>),
}

struct Build<'a> {
    pages: &'a Pages,
    options: &'a SurfelOptions,
    weights: Vec<u64>,
    groups: Vec<Group>,
    most: u64,
    unfinished: Storage,
    /// For each group, whether it is done; the file `done` lists the groups that are.
    is_done: Vec<bool>,
    done: File,
    done_path: PathBuf,
    /// The number of own points of the groups that are done.
    points: u64,
}

impl<'a> Build<'a> {
    /// Continues an earlier estimate if it was made in the same way.
    fn start(pages: &'a Pages, options: &'a SurfelOptions, most: u64, identity: &[u8]) -> Result<Self> {
        let octree = pages.octree();
        let weights = weights(pages);
        let groups = groups(octree, &weights, most);
        let title = [&MAGIC, &VERSION.to_le_bytes()[..], identity, &most.to_le_bytes()].concat();
        let (path, done_path) = (pages.folder().join(UNFINISHED), pages.folder().join(DONE));
        let length = data_start(octree.nodes.len()) + POINT_BYTES * octree.points();
        pages.in_place(|| {
            let mut list = Vec::new();
            let noted = regular_file::open_regular(&done_path).and_then(|mut file| file.read_to_end(&mut list));
            let is_as_long = |file: std::fs::Metadata| file.is_file() && file.len() == length;
            let same = noted.is_ok() && list.starts_with(&title) && path.symlink_metadata().is_ok_and(is_as_long);
            if !same {
                clear(pages.folder())?;
                list = title.clone();
            }
            // An entry that was cut short is overwritten.
            let (entries, _) = list[title.len()..].as_chunks::<DONE_BYTES>();
            let (mut is_done, mut points, mut valid) = (vec![false; groups.len()], 0, title.len());
            for entry in entries {
                let Some((group, own)) = read_entry(entry).filter(|(group, _)| is_done.get(*group) == Some(&false))
                else {
                    break;
                };
                is_done[group] = true;
                points += own;
                valid += DONE_BYTES;
            }
            list.truncate(valid);
            let unfinished = Storage::sized(&path, length)?;
            let done = regular_file::check_writable(&done_path)
                .and_then(|()| File::create(&done_path))
                .and_then(|mut file| file.write_all(&list).map(|()| file));
            let done = done.map_err(|error| Error::not_written(&done_path, error))?;
            Ok(Self { pages, options, weights, groups, most, unfinished, is_done, done, done_path, points })
        })
    }

    fn run(&mut self, progress: &Progress) -> Result<()> {
        progress.add(self.points);
        for index in 0..self.groups.len() {
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            if self.is_done[index] {
                continue;
            }
            let own = self.estimate(&self.groups[index], progress)?;
            // The list must not name a group whose results are not on the disk.
            self.unfinished.sync()?;
            let noted = self.done.write_all(&write_entry(index, own)).and_then(|()| self.done.sync_data());
            noted.map_err(|error| Error::not_written(&self.done_path, error))?;
            self.points += own;
        }
        Ok(())
    }

    /// Estimates a group. Returns the number of its own points.
    fn estimate(&self, group: &Group, progress: &Progress) -> Result<u64> {
        let parts = self.load(group)?;
        let own_points = |part: &NodePoints| match &part.own {
            Own::All => part.chunk.len(),
            Own::Equal(points) => *points,
            Own::Some(own) => own.len(),
        };
        let own = parts.iter().map(|part| own_points(part) as u64).sum();
        let equal = parts.iter().map(|part| own_points(part).saturating_sub(part.chunk.len()) as u64).sum::<u64>();
        let (kept, chunks): (Vec<(NodeId, Own)>, Vec<Chunk>) =
            parts.into_iter().map(|NodePoints { node, chunk, own }| ((node, own), chunk)).unzip();
        let seen: u64 = chunks.iter().map(|chunk| chunk.len() as u64).sum();
        progress.add(equal);
        progress.set_total(progress.total() + equal + seen - own);
        let surfels = cloud::estimate_part(&chunks, self.options, progress).ok_or(Error::Cancelled)?;
        drop(chunks);
        kept.par_iter().zip(&surfels).try_for_each(|((node, own), surfels)| self.store(*node, own, surfels))?;
        Ok(own)
    }

    /// Reads the points that a group needs. Narrows its margin until it holds at most half as many points as a group
    /// may have.
    fn load(&self, group: &Group) -> Result<Vec<NodePoints>> {
        let octree = self.pages.octree();
        let points: u64 = group.nodes.iter().map(|node| self.weights[node.0 as usize]).sum();
        let width = group.cells.first().map_or(0.0, |cell| octree.width / f64::from(cell.level).exp2());
        let area = width * width * group.cells.len() as f64;
        let mut margin = (MARGIN * (area / (points + 1) as f64).sqrt()).min(width / 8.0);
        loop {
            let others = AtomicU64::new(0);
            let view = View { pages: self.pages, group, margin, others: &others, most: self.most / 2 };
            let mut wanted = Vec::new();
            view.find(NodeId(0), &mut wanted);
            // The fixed order makes sums round the same way in every run.
            wanted.sort_unstable_by_key(|(node, _)| *node);
            let parts: Option<Vec<NodePoints>> = wanted
                .into_par_iter()
                .map(|(node, role)| view.read(node, role).transpose())
                .collect::<Option<Result<_>>>()
                .transpose()?;
            match parts {
                Some(parts) => return Ok(parts),
                None => margin *= 0.5,
            }
            if margin < width / 1e6 {
                margin = 0.0;
            }
        }
    }

    fn store(&self, node: NodeId, own: &Own, surfels: &Surfels) -> Result<()> {
        let octree = self.pages.octree();
        let bytes = match own {
            Own::All => pack(surfels),
            Own::Equal(points) => {
                let Surfels { normals, radii } = surfels;
                pack(&Surfels { normals: vec![normals[0]; *points], radii: vec![radii[0]; *points] })
            }
            Own::Some(own) if own.is_empty() => return Ok(()),
            Own::Some(own) => {
                let mut block = unpack(&read_block(&self.unfinished, octree, node)?);
                for (index, place) in own {
                    block.normals[*place as usize] = surfels.normals[*index as usize];
                    block.radii[*place as usize] = surfels.radii[*index as usize];
                }
                pack(&block)
            }
        };
        self.unfinished.write(block_start(octree, node), &bytes)
    }

    /// Writes the head and gives the file its final name.
    fn finish(&self, identity: &[u8]) -> Result<()> {
        let octree = self.pages.octree();
        let path = self.unfinished.path();
        if self.points != octree.points() {
            let problem = format!("surfels of {} points of {}", self.points, octree.points());
            return Err(Error::damaged(path, problem));
        }
        let mut checksums = Vec::with_capacity(4 * octree.nodes.len());
        for (node, _) in octree.ids() {
            let bytes = read_block(&self.unfinished, octree, node)?;
            checksums.extend(crc32fast::hash(&bytes).to_le_bytes());
        }
        let body = [identity, &checksums].concat();
        let head = [&MAGIC[..], &VERSION.to_le_bytes(), &crc32fast::hash(&body).to_le_bytes(), &body].concat();
        self.unfinished.write(0, &head)?;
        self.unfinished.sync()?;
        let complete = self.pages.folder().join(SURFELS);
        self.pages.in_place(|| {
            std::fs::rename(path, &complete).map_err(|error| Error::not_written(&complete, error))?;
            clear(self.pages.folder())
        })
    }
}

fn write_entry(group: usize, points: u64) -> Vec<u8> {
    let mut entry = (group as u32).to_le_bytes().to_vec();
    entry.extend(points.to_le_bytes());
    entry.extend(crc32fast::hash(&entry).to_le_bytes());
    entry
}

/// Group and points; `None` if the entry was not written whole.
fn read_entry(entry: &[u8; DONE_BYTES]) -> Option<(usize, u64)> {
    let (group, points) = (entry.first_chunk::<4>()?, entry[4..].first_chunk::<8>()?);
    let (group, points) = (u32::from_le_bytes(*group) as usize, u64::from_le_bytes(*points));
    (write_entry(group, points) == entry).then_some((group, points))
}

/// How a node's points relate to a group.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    /// All of its points are the group's.
    Below,
    /// The points of the node that lie in the group are the group's.
    Above,
    /// The points of the node are neighbours of the group's.
    Beside,
}

/// Reads what a group needs, with a margin of some width.
struct View<'a> {
    pages: &'a Pages,
    group: &'a Group,
    /// The width of the margin in world units.
    margin: f64,
    /// The number of points in the margin so far; `most` is their limit. A margin of 0 has no limit.
    others: &'a AtomicU64,
    most: u64,
}

impl View<'_> {
    /// Finds the nodes that hold some of the points.
    fn find(&self, node: NodeId, found: &mut Vec<(NodeId, Role)>) {
        let octree = self.pages.octree();
        let Some(Node { bounds, children, .. }) = octree.nodes.get(node.0 as usize) else { return };
        let role = if self.group.nodes.contains(&node) {
            return self.find_below(node, found);
        } else if self.group.above.contains(&node) {
            Role::Above
        } else {
            Role::Beside
        };
        let touches = self.group.cells.iter().any(|cell| {
            let seen = self.widened(*cell);
            bounds.min.cmplt(seen.max).all() && bounds.max.cmpge(seen.min).all()
        });
        if role == Role::Above || touches {
            found.push((node, role));
            children.iter().flatten().for_each(|child| self.find(*child, found));
        }
    }

    fn find_below(&self, node: NodeId, found: &mut Vec<(NodeId, Role)>) {
        // A chain of nodes may be deep where points lie in one place, so this does not recurse.
        let mut open = vec![node];
        while let Some(node) = open.pop() {
            found.push((node, Role::Below));
            open.extend(self.pages.octree().node(node).children.iter().flatten());
        }
    }

    fn widened(&self, cell: Cell) -> Bounds {
        let Bounds { min, max } = space(self.pages.octree(), cell, Cell::ROOT);
        Bounds { min: min - self.margin, max: max + self.margin }
    }

    /// The part that a node gives; `None` if the margin holds too many points.
    fn read(&self, node: NodeId, role: Role) -> Result<Option<NodePoints>> {
        let mut chunk = self.pages.read_page(node)?;
        chunk.colors = None;
        chunk.columns = Vec::new();
        let octree = self.pages.octree();
        if role != Role::Above && is_one_place(self.pages, octree.node(node)) {
            let own = if role == Role::Below { Own::Equal(chunk.len()) } else { Own::Some(Vec::new()) };
            return Ok(Some(NodePoints { node, chunk: chunk.select(&[0]), own }));
        }
        if role == Role::Below {
            return Ok(Some(NodePoints { node, chunk, own: Own::All }));
        }
        let level = octree.node(node).level;
        let cells = self.group.cells.iter();
        let cells = cells.map(|cell| (space(octree, *cell, cell.ancestor(level)), self.widened(*cell)));
        let cells: Vec<(Bounds, Bounds)> = cells.collect();
        let (mut kept, mut own) = (Vec::new(), Vec::new());
        for index in 0..chunk.len() {
            let position = chunk.position(index);
            if role == Role::Above && cells.iter().any(|(space, _)| holds(space, position)) {
                own.push((kept.len() as u32, index as u32));
                kept.push(index as u32);
            } else if cells.iter().any(|(_, seen)| holds(seen, position)) {
                kept.push(index as u32);
            }
        }
        let others = (kept.len() - own.len()) as u64;
        if self.others.fetch_add(others, Ordering::Relaxed) + others > self.most && self.margin > 0.0 {
            return Ok(None);
        }
        Ok(Some(NodePoints { node, chunk: chunk.select(&kept), own: Own::Some(own) }))
    }
}

#[cfg(test)]
#[path = "surfels_tests.rs"]
mod tests;
