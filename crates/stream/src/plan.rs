//! What an index of some files keeps of them, and the lattice and cube it puts them in.

use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Attribute, Bounds, Chunk, Cloud, Grid, Progress};
use codec::{Format, Selection, Source};
use glam::DVec3;

use crate::lattice::Lattice;
use crate::records::{Layout, MOST_STEPS, is_believable};
use crate::{Error, Result};

/// Attributes that are kept, if a file has them.
const KEPT: [&str; 3] = ["intensity", "classification", "return_number"];
/// Of the bulk of the points of files without a grid: the step of their lattice as a part of it. Finer than what f32
/// coordinates in the same place tell apart.
const STEPS: f64 = (1_u64 << 30) as f64;
/// Room about the bounds, as a part of them: headers round.
const MARGIN: f64 = 1e-3;
/// World units: narrower, numbers lose their precision.
const LEAST_WIDTH: f64 = 1e-30;
/// World units from the bulk of the points within which all are kept. Beyond, a point that is also further than `STEPS`
/// times the bulk's size would make the lattice too coarse for all others: it is left out.
const FARTHEST: f64 = 1e12;
/// Points of a sample of which the farthest one at each end may be a stray.
const FEWEST_SAMPLES: usize = 16;
/// Points of a chunk that are looked at to see where the bulk lies.
const SAMPLES_PER_CHUNK: usize = 64;

/// What an index keeps of its files.
pub struct IndexPlan {
    pub layout: Layout,
    pub lattice: Lattice,
    /// The lattice is the finest of the files' own grids.
    pub on_grid: bool,
    /// Per file: what is read, and which of its columns is which of the layout's attributes.
    pub inputs: Vec<(Selection, Vec<Option<usize>>)>,
}

/// What reading all positions tells.
pub struct Extent {
    pub bounds: Bounds,
    /// Without the points that lie farthest out.
    pub bulk: Bounds,
}

impl IndexPlan {
    /// `extent`: what is known better than from the headers.
    pub fn new(inputs: &[Arc<Source>], extent: Option<&Extent>, wide: bool) -> Option<Self> {
        let infos = || inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
        let header_bounds =
            || infos().map(|info| info.bounds).try_fold(Bounds::EMPTY, |all, bounds| Some(all.union(bounds?)));
        let is_known = |bounds: &Bounds| !bounds.is_empty() && is_believable(bounds.min) && is_believable(bounds.max);
        let bounds = extent.map(|extent| extent.bounds).or_else(header_bounds).filter(is_known)?;
        let grid = finest_grid(infos().map(|info| info.grid))
            .filter(|grid| is_sane(grid) && is_within(&bounds, grid, MOST_STEPS));
        let step = grid.map_or(0.0, |grid| grid.scale.abs().max_element());
        let width = (bounds.size().max_element() * (1.0 + 2.0 * MARGIN)).max(256.0 * step);
        let width = if width > 0.0 { width.max(LEAST_WIDTH) } else { 1.0 };
        // Without a grid the bulk must be known, too.
        let lattice_grid = match (grid, extent) {
            (Some(grid), _) => grid,
            (None, Some(extent)) => lattice_for(extent),
            (None, None) => return None,
        };
        let corner = bounds.center() - DVec3::splat(width / 2.0);
        // Height is mostly the least extent: then the ground is in the lower half, not cut by the middle of the cube.
        let corner = corner.with_z(bounds.min.z - width * MARGIN);
        let is_narrow = grid.is_some_and(|grid| is_within(&bounds, &grid, f64::from(i32::MAX)));
        let layout = layout(inputs, wide || !is_narrow);
        let inputs = inputs.iter().map(|input| selection(input, &layout)).collect();
        let lattice = Lattice { grid: lattice_grid, corner, width };
        Some(Self { layout, lattice, on_grid: grid.is_some(), inputs })
    }

    /// A chunk of a file with this grid as it can be put on the lattice: where that is another grid, what f32 offsets have lost
    /// comes back first.
    pub fn exact(&self, chunk: Chunk, grid: Option<Grid>) -> Chunk {
        let Some(grid) = grid.filter(|grid| self.on_grid && !is_one_grid(grid, &self.lattice.grid)) else {
            return chunk;
        };
        let file = Cloud { grid: Some(grid), ..Cloud::default() };
        let places = (0..chunk.len()).map(|index| file.world_position(&chunk, index).to_array());
        Chunk { exact_positions: Some(Arc::new(places.collect())), ..chunk }
    }
}

/// What records of some files hold.
pub fn layout(inputs: &[Arc<Source>], wide: bool) -> Layout {
    let infos = || inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
    let has_colors = infos().any(|info| info.has_colors);
    let opacity = infos().any(|info| info.has_colors && info.format == Format::Ply);
    Layout {
        wide,
        color_bytes: if opacity { 4 } else { 3 * usize::from(has_colors) },
        normals: infos().any(|info| info.has_normals),
        attributes: kept_attributes(infos().map(|info| info.attributes.as_slice())),
    }
}

/// On each axis the finest grid of any file, if all have one: coordinates on it, and on coarser ones of which it is a part, are
/// kept as they are, all others to half of its step.
fn finest_grid(mut grids: impl Iterator<Item = Option<Grid>>) -> Option<Grid> {
    let first = grids.next()??;
    grids.try_fold(first, |finest, grid| {
        let grid = grid?;
        let finer = grid.scale.abs().cmplt(finest.scale.abs());
        let pick = |a: DVec3, b: DVec3| DVec3::select(finer, a, b);
        Some(Grid { scale: pick(grid.scale, finest.scale), offset: pick(grid.offset, finest.offset) })
    })
}

/// What lies on one of these grids lies on the other: the same steps, and offsets whole steps apart.
fn is_one_grid(a: &Grid, b: &Grid) -> bool {
    let shift = (a.offset - b.offset) / b.scale;
    a.scale == b.scale && (shift - shift.round()).abs().max_element() < 1e-3
}

/// All of these places are so few steps from the grid's offset.
fn is_within(bounds: &Bounds, grid: &Grid, steps: f64) -> bool {
    let reach = |corner: DVec3| ((corner - grid.offset) / grid.scale).abs().max_element();
    reach(bounds.min).max(reach(bounds.max)) < steps
}

fn lattice_for(extent: &Extent) -> Grid {
    let bulk = [extent.bulk, extent.bounds].map(|bounds| bounds.size().max_element());
    let size = bulk.into_iter().find(|size| *size > 0.0 && size.is_finite()).unwrap_or(1.0).max(LEAST_WIDTH);
    // Integers of the farthest points have 61 bits.
    let step = (size.log2().floor().exp2() / STEPS).max(extent.bounds.size().max_element() / 61_f64.exp2());
    Grid { scale: DVec3::splat(step), offset: extent.bulk.center() }
}

/// Attributes that the index of some files has: what the columns of its chunks will be.
pub fn index_attributes(inputs: &[Arc<Source>]) -> Vec<Attribute> {
    let infos = inputs.iter().map(|input| input.info()).filter(|info| info.points > 0);
    kept_attributes(infos.map(|info| info.attributes.as_slice()))
}

/// Of what files offer, the attributes that pages have.
pub fn kept_attributes<'a>(offered: impl Iterator<Item = &'a [Attribute]> + Clone) -> Vec<Attribute> {
    let find = |name: &&str| offered.clone().flatten().find(|attribute| attribute.name == **name).cloned();
    KEPT.iter().filter_map(find).collect()
}

/// What is read of a file, and which of its columns is which of the layout's attributes.
pub fn selection(input: &Source, layout: &Layout) -> (Selection, Vec<Option<usize>>) {
    let offered = &input.info().attributes;
    let column = |kept: &Attribute| offered.iter().position(|attribute| attribute.name == kept.name);
    let columns: Vec<Option<usize>> = layout.attributes.iter().map(column).collect();
    let attributes = (0..offered.len()).map(|index| columns.contains(&Some(index))).collect();
    let selection = Selection { positions: true, colors: layout.color_bytes > 0, normals: layout.normals, attributes };
    (selection, columns)
}

/// Reads the positions of all files, and what else `selections` ask for. `seen` gets all chunks, each with the number of its
/// file.
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
        // What cannot be read is said when it is read for good.
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

/// Where the file says that a point is.
fn place_of(chunk: &Chunk, index: usize) -> DVec3 {
    chunk.exact_positions.as_ref().map_or_else(|| chunk.position(index), |exact| DVec3::from(exact[index]))
}

/// Of the points that may be true.
fn bounds_of(chunk: &Chunk) -> Bounds {
    let places = (0..chunk.len()).map(|index| place_of(chunk, index));
    places.filter(|place| is_believable(*place)).fold(Bounds::EMPTY, |mut bounds, place| {
        bounds.include(place);
        bounds
    })
}

/// Numbers that can be computed with.
fn is_sane(grid: &Grid) -> bool {
    let scale = grid.scale.abs();
    scale.min_element() >= LEAST_WIDTH && is_believable(scale) && is_believable(grid.offset)
}

/// Indices spread evenly over `count`, at most `most` or so.
pub fn spread(count: usize, most: usize) -> Vec<u32> {
    let most = most.min(count);
    (0..most).map(|index| (index * count / most) as u32).collect()
}

/// Bounds without the hundredth part of the points at either end of each axis.
fn bulk(sample: &[DVec3]) -> Bounds {
    let stray = if sample.len() < FEWEST_SAMPLES { 0 } else { (sample.len() / 100).max(1) };
    let axis = |axis: usize| {
        let mut values: Vec<f64> = sample.iter().map(|place| place[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        match values.as_slice() {
            [] => (0.0, 0.0),
            values => (values[stray], values[values.len() - 1 - stray]),
        }
    };
    let [x, y, z] = [axis(0), axis(1), axis(2)];
    Bounds { min: DVec3::new(x.0, y.0, z.0), max: DVec3::new(x.1, y.1, z.1) }
}
