//! Chooses which columns an index keeps of its files, and the lattice and the cube in which it places the points.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Attribute, Bounds, COMPARED, Chunk, Cloud, ColumnType, Grid, Progress, attribute_named, is_numbered};
use codec::{Format, Selection, Source};
use glam::DVec3;

use crate::lattice::Lattice;
use crate::records::{Layout, MOST_STEPS, is_believable};
use crate::{Error, Result};

/// The attributes that an index keeps if a file has them.
const KEPT: [&str; 3] = ["intensity", "classification", "return_number"];
/// The number of lattice steps across the middle half of the points, for files without a grid. The steps are finer than the
/// differences that f32 coordinates can hold there.
const STEPS: f64 = (1_u64 << 29) as f64;
/// The margin around the bounds as a fraction of their size: headers round.
const MARGIN: f64 = 1e-3;
/// The least width of the cube in world units; below it numbers lose their precision.
const LEAST_WIDTH: f64 = 1e-30;
/// The distance in world units from the bulk of the points within which all points are kept. A point that is further
/// away than this and than `STEPS` times the bulk's size would make the lattice too coarse for all others: it is left
/// out.
const FARTHEST: f64 = 1e12;
/// The smallest sample in which the farthest point at each end of an axis is taken for a stray.
const FEWEST_SAMPLES: usize = 16;
/// The cube of the tree leaves out strays, which count to the cells at its sides, where a cube about them would be this
/// many times as wide: nodes of many levels would have one child.
const FAR: f64 = 4.0;
/// How far the cube then reaches beyond a sample of the others, as a share of its width.
const SCENE_MARGIN: f64 = 0.1;
/// The number of points per chunk that are sampled to find the bulk.
const SAMPLES_PER_CHUNK: usize = 64;

/// What an index keeps of its files, and where it places their points.
pub struct IndexPlan {
    pub layout: Layout,
    pub lattice: Lattice,
    /// Whether the lattice is the finest of the files' own grids.
    pub on_grid: bool,
    /// For each file: the selection to read, and for each attribute of the layout its column in the file.
    pub inputs: Vec<(Selection, Vec<Option<usize>>)>,
}

/// The extent of the points, found by reading all positions.
pub struct Extent {
    pub bounds: Bounds,
    /// The bounds of the middle of the points, which strays do not widen.
    pub bulk: Bounds,
}

impl IndexPlan {
    /// `also` names attributes that are kept besides the usual ones. `extent` is the measured extent, where it is known
    /// better than from the headers. `scene` is where all but strays are, if these are far away.
    pub fn new(
        inputs: &[Arc<Source>],
        also: &BTreeSet<String>,
        extent: Option<&Extent>,
        wide: bool,
        scene: Option<Bounds>,
    ) -> Option<Self> {
        let infos = || inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
        let header_bounds =
            || infos().map(|info| info.bounds).try_fold(Bounds::EMPTY, |all, bounds| Some(all.union(bounds?)));
        let is_known = |bounds: &Bounds| !bounds.is_empty() && is_believable(bounds.min) && is_believable(bounds.max);
        let bounds = extent.map(|extent| extent.bounds).or_else(header_bounds).filter(is_known)?;
        let grid = finest_grid(infos().map(|info| info.grid))
            .filter(|grid| is_sane(grid) && is_within(&bounds, grid, MOST_STEPS));
        let step = grid.map_or(0.0, |grid| grid.scale.abs().max_element());
        let is_narrow = grid.is_some_and(|grid| is_within(&bounds, &grid, f64::from(i32::MAX)));
        let bounds = scene.unwrap_or(bounds);
        let width = (bounds.size().max_element() * (1.0 + 2.0 * MARGIN)).max(256.0 * step);
        let width = if width > 0.0 { width.max(LEAST_WIDTH) } else { 1.0 };
        // Without a grid the bulk must be known, too.
        let lattice_grid = match (grid, extent) {
            (Some(grid), _) => grid,
            (None, Some(extent)) => lattice_for(extent),
            (None, None) => return None,
        };
        let corner = bounds.center() - DVec3::splat(width / 2.0);
        // Height is usually the least extent. With the cube's floor at the lowest point, the ground lies in the lower
        // half and is not cut by the middle of the cube.
        let corner = corner.with_z(bounds.min.z - width * MARGIN);
        let layout = layout(inputs, also, wide || !is_narrow);
        let inputs = inputs.iter().map(|input| selection(input, &layout)).collect();
        let lattice = Lattice { grid: lattice_grid, corner, width };
        Some(Self { layout, lattice, on_grid: grid.is_some(), inputs })
    }

    /// Prepares a chunk of a file with this grid for the lattice. Where the lattice has another grid, the precision
    /// that f32 offsets have lost is restored first.
    pub fn exact(&self, chunk: Chunk, grid: Option<Grid>) -> Chunk {
        let Some(grid) = grid.filter(|grid| self.on_grid && !is_one_grid(grid, &self.lattice.grid)) else {
            return chunk;
        };
        let file = Cloud { grid: Some(grid), ..Cloud::default() };
        let places = (0..chunk.len()).map(|index| file.world_position(&chunk, index).to_array());
        Chunk { exact_positions: Some(Arc::new(places.collect())), ..chunk }
    }
}

/// The layout of the records of some files.
pub fn layout(inputs: &[Arc<Source>], also: &BTreeSet<String>, wide: bool) -> Layout {
    let infos = || inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
    let has_colors = infos().any(|info| info.has_colors);
    let opacity = infos().any(|info| info.has_colors && info.format == Format::Ply);
    Layout {
        wide,
        color_bytes: if opacity { 4 } else { 3 * usize::from(has_colors) },
        normals: infos().any(|info| info.has_normals),
        attributes: index_attributes(inputs, also),
    }
}

/// The finest grid of any file on each axis, if all files have one. Coordinates on it, and on coarser grids that are
/// part of it, are kept exactly; all others are rounded by half of its step at most.
fn finest_grid(mut grids: impl Iterator<Item = Option<Grid>>) -> Option<Grid> {
    let first = grids.next()??;
    grids.try_fold(first, |finest, grid| {
        let grid = grid?;
        let finer = grid.scale.abs().cmplt(finest.scale.abs());
        let pick = |a: DVec3, b: DVec3| DVec3::select(finer, a, b);
        Some(Grid::new(pick(grid.scale, finest.scale), pick(grid.offset, finest.offset)))
    })
}

/// Whether points on one of these grids also lie on the other: the steps are equal and the offsets differ by whole
/// steps.
pub fn is_one_grid(a: &Grid, b: &Grid) -> bool {
    let shift = (a.offset - b.offset) / b.scale;
    a.scale == b.scale && (shift - shift.round()).abs().max_element() < 1e-3
}

/// Whether all of these places are within `steps` steps of the grid's offset.
fn is_within(bounds: &Bounds, grid: &Grid, steps: f64) -> bool {
    let reach = |corner: DVec3| ((corner - grid.offset) / grid.scale).abs().max_element();
    reach(bounds.min).max(reach(bounds.max)) < steps
}

fn lattice_for(extent: &Extent) -> Grid {
    let bulk = [extent.bulk, extent.bounds].map(|bounds| bounds.size().max_element());
    let size = bulk.into_iter().find(|size| *size > 0.0 && size.is_finite()).unwrap_or(1.0).max(LEAST_WIDTH);
    // The integers of the farthest points have 61 bits.
    let step = (size.log2().floor().exp2() / STEPS).max(extent.bounds.size().max_element() / 61_f64.exp2());
    Grid::new(DVec3::splat(step), extent.bulk.center())
}

/// The attributes that the index of some files has, in the order of its chunks' columns: the usual ones, and those of
/// `also` that a file has. Their types hold the numbers of all files, and NaN where one of the files lacks the
/// attribute; classes have their own number for that.
pub fn index_attributes(inputs: &[Arc<Source>], also: &BTreeSet<String>) -> Vec<Attribute> {
    let infos = inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
    let offered = infos.map(|info| info.attributes.as_slice());
    let mut kept = usual_attributes(offered.clone());
    for name in also {
        if attribute_named(&kept, name).is_none() {
            kept.extend(first_named(offered.clone(), name));
        }
    }
    for Attribute { name, column_type } in kept.iter_mut().filter(|attribute| attribute.name != "classification") {
        let own = |file: &[Attribute]| attribute_named(file, name).map(|index| file[index].column_type);
        *column_type = offered.clone().filter_map(own).fold(*column_type, ColumnType::with);
        if offered.clone().any(|file| own(file).is_none()) {
            *column_type = column_type.with_none();
        }
    }
    kept
}

/// The attribute of the first file that has one of this name, or of another name of the same.
fn first_named<'a>(mut offered: impl Iterator<Item = &'a [Attribute]>, name: &str) -> Option<Attribute> {
    offered.find_map(|attributes| Some(attributes[attribute_named(attributes, name)?].clone()))
}

/// The attributes that every index keeps, among those that some files offer: the usual ones, and the last of each that
/// comparisons have added.
fn usual_attributes<'a>(offered: impl Iterator<Item = &'a [Attribute]> + Clone) -> Vec<Attribute> {
    let find = |name: &&str| first_named(offered.clone(), name);
    let last = |name: &&str| offered.clone().flatten().filter(|kept| is_numbered(&kept.name, name)).last().cloned();
    KEPT.iter().filter_map(find).chain(COMPARED.iter().filter_map(last)).collect()
}

/// The selection to read of a file, and for each attribute of the layout its column in the file.
pub fn selection(input: &Source, layout: &Layout) -> (Selection, Vec<Option<usize>>) {
    let offered = &input.info().attributes;
    let column = |kept: &Attribute| attribute_named(offered, &kept.name);
    let columns: Vec<Option<usize>> = layout.attributes.iter().map(column).collect();
    let attributes = (0..offered.len()).map(|index| columns.contains(&Some(index))).collect();
    let selection = Selection { positions: true, colors: layout.color_bytes > 0, normals: layout.normals, attributes };
    (selection, columns)
}

/// Reads the positions of all files and the columns that `selections` name. `seen` receives all chunks, each with the
/// number of its file.
pub fn measure(
    inputs: &[Arc<Source>],
    selections: &[Selection],
    progress: &Progress,
    seen: &(dyn Fn(usize, Chunk) + Sync),
) -> Result<Extent> {
    let bounds = Mutex::new(Bounds::EMPTY);
    let sample = Mutex::new(Vec::new());
    for (file, (input, selection)) in inputs.iter().zip(selections).enumerate() {
        let reading = Progress::default();
        let look = |chunk: Chunk| {
            if progress.is_cancelled() {
                reading.cancel();
            }
            let some = spread(chunk.len(), SAMPLES_PER_CHUNK);
            let chunk_bounds = bounds_of(&chunk);
            let mut bounds = bounds.lock().unwrap_or_else(PoisonError::into_inner);
            *bounds = bounds.union(chunk_bounds);
            let places =
                some.iter().map(|index| place_of(&chunk, *index as usize)).filter(|place| is_believable(*place));
            sample.lock().unwrap_or_else(PoisonError::into_inner).extend(places);
            drop(bounds);
            seen(file, chunk);
        };
        // Errors are ignored here: the real read of the file reports them.
        let _ = input.read(selection, &reading, &look);
        if progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
    }
    let bounds = bounds.into_inner().unwrap_or_else(PoisonError::into_inner);
    let sample = sample.into_inner().unwrap_or_else(PoisonError::into_inner);
    let bulk = bulk(&sample);
    let reach = FARTHEST.max(bulk.size().max_element() * STEPS);
    let near = Bounds { min: bulk.min - reach, max: bulk.max + reach };
    Ok(Extent { bounds: Bounds { min: bounds.min.max(near.min), max: bounds.max.min(near.max) }, bulk })
}

/// Some of the points that are read, each with the number of points that it stands for.
#[derive(Default)]
pub struct Places(Mutex<Vec<(DVec3, f64)>>);

impl Places {
    pub fn add(&self, chunk: &Chunk) {
        let some = spread(chunk.len(), SAMPLES_PER_CHUNK);
        let weight = chunk.len() as f64 / some.len().max(1) as f64;
        let places = some.iter().map(|index| place_of(chunk, *index as usize)).filter(|place| is_believable(*place));
        let mut sample = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        sample.extend(places.map(|place| (place, weight)));
    }

    /// Where all but strays are, if a cube of this width about all of them is many times as wide.
    pub fn scene_within(&self, width: f64) -> Option<Bounds> {
        let sample = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        let fence = cloud::scene_fence(sample.clone())?;
        let mut scene = Bounds::EMPTY;
        sample.iter().filter(|(place, _)| fence.contains(*place)).for_each(|(place, _)| scene.include(*place));
        // Points between those of the sample.
        let margin = SCENE_MARGIN * scene.size().max_element();
        let scene = Bounds { min: scene.min - margin, max: scene.max + margin };
        let own = scene.size().max_element();
        (own > 0.0 && width > FAR * own).then_some(scene)
    }
}

/// The position of a point as the file states it.
fn place_of(chunk: &Chunk, index: usize) -> DVec3 {
    chunk.exact_positions.as_ref().map_or_else(|| chunk.position(index), |exact| DVec3::from(exact[index]))
}

/// The bounds of the points with believable positions.
fn bounds_of(chunk: &Chunk) -> Bounds {
    let places = (0..chunk.len()).map(|index| place_of(chunk, index));
    places.filter(|place| is_believable(*place)).fold(Bounds::EMPTY, |mut bounds, place| {
        bounds.include(place);
        bounds
    })
}

/// Whether the grid's numbers can be computed with.
fn is_sane(grid: &Grid) -> bool {
    let scale = grid.scale.abs();
    scale.min_element() >= LEAST_WIDTH && is_believable(scale) && is_believable(grid.offset)
}

/// Up to about `most` indices, spread evenly over `count`.
pub fn spread(count: usize, most: usize) -> Vec<u32> {
    let most = most.min(count);
    (0..most).map(|index| (index * count / most) as u32).collect()
}

/// The bounds without the outermost quarter of the points at either end of each axis; points at one coordinate, such as
/// pulses without an echo at 0, 0, 0, count once.
fn bulk(sample: &[DVec3]) -> Bounds {
    let axis = |axis: usize| {
        let mut values: Vec<f64> = sample.iter().map(|place| place[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.dedup();
        let stray = if values.len() < FEWEST_SAMPLES { 0 } else { values.len() / 4 };
        match values.as_slice() {
            [] => (0.0, 0.0),
            values => (values[stray], values[values.len() - 1 - stray]),
        }
    };
    let [x, y, z] = [axis(0), axis(1), axis(2)];
    Bounds { min: DVec3::new(x.0, y.0, z.0), max: DVec3::new(x.1, y.1, z.1) }
}
