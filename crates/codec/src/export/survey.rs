//! Looks through the points of files before they are written to LAS: at the coordinates of those that are on no grid,
//! and at the values of properties that a field of LAS may hold.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Bounds, Grid};
use glam::DVec3;

use super::columns::{Colors, Field, Meaning, Piece};
use super::grid::{Axis, UNSEEN, finest, grid_of};
use super::standard::{Standard, Values, standard};
use super::{Job, OwnFields, las};
use crate::Source;
use crate::error::Result;
use crate::in_order::InOrder;

/// What the points are like.
pub struct Survey {
    pub grid: Grid,
    /// For each file and column what its values are like, where that was looked at.
    pub values: Vec<Vec<Option<Values>>>,
    /// For each file whether its times are standard time, by their values; `None` if these do not say.
    pub standard_times: Vec<Option<bool>>,
    /// The extent of most of the points that are on no grid.
    bulk: f64,
}

impl Survey {
    /// Whether coordinates that are moved that far are seen to be elsewhere.
    pub fn is_seen(&self, moved: DVec3) -> bool {
        moved.max_element() > self.bulk * UNSEEN
    }
}

/// Gives a brightness one scale in all scans of a file: a scan that is dark would get its own else.
fn share_scales(sources: &[Arc<Source>], own: &[OwnFields], values: &mut [Vec<Option<Values>>]) {
    let mut of_files: HashMap<(&Path, &str), Values> = HashMap::new();
    for is_given in [false, true] {
        for ((source, own), values) in sources.iter().zip(own).zip(values.iter_mut()) {
            let has_scale = |field: &Field| standard(field.name()).is_some_and(Standard::has_scale);
            let is_of_scan = source.info().scan.is_some();
            for (field, values) in own.fields.iter().zip(values).filter(|(field, _)| is_of_scan && has_scale(field)) {
                let Some(values) = values else { continue };
                let shared = of_files.entry((&source.info().path, field.name())).or_default();
                if is_given { values.share_scale(shared) } else { shared.merge(values) }
            }
        }
    }
}

impl Job<'_> {
    /// Returns `None` if it was cancelled. What could not be read is said when it is written.
    pub fn survey(&self, own: &[OwnFields]) -> Result<Option<Survey>> {
        let grids = self.sources.iter().filter_map(|source| source.info().grid);
        let grid = finest(grids);
        let new_axes = || [0, 1, 2].map(|axis| Axis::new(grid.map(|grid| (grid.offset[axis], grid.scale[axis].abs()))));
        let all = Mutex::new(new_axes());
        let mut values: Vec<Vec<Option<Values>>> = vec![Vec::new(); self.sources.len()];
        let mut bounds = Bounds::EMPTY;
        for (number, source) in self.sources.iter().enumerate() {
            if let (Some(_), Some(of_header)) = (las(source), source.info().bounds) {
                bounds = bounds.union(of_header);
                continue;
            }
            let fields = &own[number].fields;
            let is_tried = |field: &Field| field.meaning == Meaning::Other && standard(field.name()).is_some();
            let of_file: Vec<Option<Values>> =
                fields.iter().map(|field| is_tried(field).then(Values::default)).collect();
            let axis = |name: &str| {
                fields.iter().position(|field| field.meaning == Meaning::Coordinate && field.name() == name)
            };
            let coordinates = ["x", "y", "z"].map(axis);
            let needed: Vec<bool> =
                fields.iter().map(|field| is_tried(field) || field.meaning == Meaning::Coordinate).collect();
            let of_file = Mutex::new(of_file);
            let look = |piece: &Piece| {
                let mut axes = new_axes();
                for (axis, column) in axes.iter_mut().zip(coordinates) {
                    if let Some(column) = column.and_then(|column| piece.columns.get(column)) {
                        axis.add(column, &piece.kept);
                    }
                }
                let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
                all.iter_mut().zip(axes).for_each(|(all, own)| all.merge(own));
                drop(all);
                for (column, _) in fields.iter().enumerate().filter(|(_, field)| is_tried(field)) {
                    let mut own = Values::default();
                    own.add(&piece.columns[column], &piece.kept);
                    let mut of_file = of_file.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some(Some(all)) = of_file.get_mut(column) {
                        all.merge(&own);
                    }
                }
                Vec::new()
            };
            self.progress.set_total(self.progress.total() + source.info().points);
            let (encode, is_cancelled) = (|rows: Vec<u8>| Ok(rows), || self.progress.is_cancelled());
            let mut write = |_: Vec<u8>| Ok(());
            let order = InOrder::new(1, &encode, &mut write, &is_cancelled);
            self.read_one(number, &own[number], Colors::Words, Some(&needed), &order, &look);
            if self.progress.is_cancelled() {
                return Ok(None);
            }
            values[number] = of_file.into_inner().unwrap_or_else(PoisonError::into_inner);
        }
        share_scales(self.sources, own, &mut values);
        let axes = all.into_inner().unwrap_or_else(PoisonError::into_inner);
        let end = |of: fn(&Axis) -> f64| DVec3::from(axes.each_ref().map(of));
        let own_bounds = Bounds { min: end(|axis| axis.least), max: end(|axis| axis.greatest) };
        if !own_bounds.is_empty() {
            bounds = bounds.union(own_bounds);
        }
        let bounds = if bounds.is_empty() { Bounds { min: DVec3::ZERO, max: DVec3::ZERO } } else { bounds };
        let is_time = |field: &Field| standard(field.name()).is_some_and(|own| own.name == "gps_time");
        let standard_time = |(own, values): (&OwnFields, &Vec<Option<Values>>)| {
            let mut times = own.fields.iter().zip(values).filter(|(field, _)| is_time(field));
            times.find_map(|(_, values)| values.as_ref()?.is_standard_time())
        };
        let standard_times = own.iter().zip(&values).map(standard_time).collect();
        let (grid, bulk) = grid_of(axes, bounds, grid);
        Ok(Some(Survey { grid, values, standard_times, bulk }))
    }
}
