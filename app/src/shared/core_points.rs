//! The core points of a comparison of clouds: one in each cube of space, whose distance the others in the cube take.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use cloud::Progress;
use glam::{DVec3, I64Vec3};
use rayon::prelude::*;

use crate::shared::comparing::Value;

/// Core points that one task measures.
const CORES_AT_ONCE: usize = 1 << 14;

/// Core points: of the points in a cube, that which is nearest to its middle. The order in which points come does not
/// matter.
pub struct CorePoints {
    edge: f64,
    /// The squared distance from the middle, and the point.
    found: HashMap<I64Vec3, (f64, DVec3)>,
}

impl CorePoints {
    pub fn new(edge: f64) -> Self {
        Self { edge, found: HashMap::new() }
    }

    pub fn len(&self) -> usize {
        self.found.len()
    }

    pub fn add(&mut self, point: DVec3) {
        if !point.is_finite() {
            return;
        }
        let cell = cell_of(point, self.edge);
        let off = point.distance_squared((cell.as_dvec3() + 0.5) * self.edge);
        let key = |(off, point): (f64, DVec3)| [off, point.x, point.y, point.z];
        match self.found.entry(cell) {
            Entry::Vacant(place) => drop(place.insert((off, point))),
            Entry::Occupied(mut place) if key((off, point)) < key(*place.get()) => drop(place.insert((off, point))),
            Entry::Occupied(_) => {}
        }
    }

    /// Measures them. `points` is the number of all points, by which `progress` counts.
    pub fn measured(
        self,
        values: &(impl Fn(&[DVec3]) -> Vec<Value> + Sync),
        progress: &Progress,
        points: u64,
    ) -> Cores {
        let edge = self.edge;
        let mut cores: Vec<(I64Vec3, DVec3)> = self.found.into_iter().map(|(cell, (_, point))| (cell, point)).collect();
        cores.sort_unstable_by_key(|(cell, _)| cell.to_array());
        let share = points as f64 / cores.len().max(1) as f64;
        let measured = cores.par_chunks(CORES_AT_ONCE).filter(|_| !progress.is_cancelled()).flat_map_iter(|cores| {
            let places: Vec<DVec3> = cores.iter().map(|(_, point)| *point).collect();
            let values = values(&places);
            progress.add((share * cores.len() as f64) as u64);
            cores.iter().map(|(cell, _)| *cell).zip(values)
        });
        Cores { edge, values: measured.collect() }
    }
}

/// Cubes with edges of a length, and what was measured at the core point of each.
pub struct Cores {
    edge: f64,
    values: HashMap<I64Vec3, Value>,
}

impl Cores {
    pub fn value(&self, place: DVec3) -> Value {
        self.values.get(&cell_of(place, self.edge)).copied().unwrap_or([f64::NAN; 2])
    }

    /// What was measured, in the order of the cubes, so that sums come out the same each time.
    pub fn in_order(self) -> Vec<Value> {
        let mut cores: Vec<(I64Vec3, Value)> = self.values.into_iter().collect();
        cores.sort_unstable_by_key(|(cell, _)| cell.to_array());
        cores.into_iter().map(|(_, value)| value).collect()
    }
}

fn cell_of(place: DVec3, edge: f64) -> I64Vec3 {
    (place / edge).floor().as_i64vec3()
}
