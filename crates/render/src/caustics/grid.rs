//! Photons in grids of cells, as shading reads them (shaders/photon_light.wgsl, whose twin is `Grid::irradiance`).
//!
//! Each photon spreads its light over a radius of its own, in which its nearest neighbours lie (Breiman, Meisel and Purcell
//! 1977): so light is smooth where it is thin and sharp where it is focused, and a place reads about as many photons
//! everywhere. Where a surface ends at another one, the part of a photon's light beyond is folded back (Silverman 1986,
//! 2.10). There is a grid for each range of radii, and a photon is listed in all cells that it reaches: so a place reads
//! one cell of each grid.

use glam::{DVec3, DVec4, IVec3, Vec3, Vec4};

use super::near::{SAME_SIDE, Spread, Tree};
use crate::layout::Landed;

/// The most grids; each has cells half as wide as the one before.
const LEVELS: usize = 8;
/// Discs of points go on beyond the line where their surface ends: up to this share of its radius a photon shines there.
const OVER_END: f32 = 0.2;
/// Photons of the least radius in a cube of this share of it that have landed on the same side are merged: so the brightest
/// spot is no longer loop than others.
const MERGED: f32 = 0.25;
/// The most photons: the buffers of so many are bound by every GPU.
const MOST: usize = 1 << 20;
/// The balls of photons are listed as if they were larger by this factor, since a GPU rounds the cell of a place otherwise.
const LISTED: f32 = 1.002;

/// The photons of a scene.
pub(super) struct Grid {
    /// The edge of the cells of the first grid, which no radius exceeds.
    edge: f32,
    /// The number of grids, from the coarsest to the finest that list photons.
    levels: usize,
    photons: Vec<Photon>,
    /// The number of lists of a grid, a power of two.
    lists: u32,
    /// For each list of each grid where it begins, the end of the last one, and then all lists: indices of photons.
    pub cells: Vec<u32>,
}

/// A photon, or several, relative to the photons' origin.
#[derive(Clone, Copy)]
struct Photon {
    position: Vec3,
    normal: Vec3,
    power: Vec3,
    spread: Spread,
}

/// The cell of a place in a grid; saturated far outside.
fn cell_of(place: Vec3, edge: f32) -> IVec3 {
    (place / edge).floor().clamp(Vec3::splat(-1e9), Vec3::splat(1e9)).as_ivec3()
}

impl Grid {
    /// Sorts photons so that those that lie close together follow each other, and lists them by cells. No radius is larger
    /// than `most`.
    pub fn new(most: f32, landed: &mut Vec<Landed>) -> Self {
        thin(landed, MOST);
        let least = most / (1 << LEVELS) as f32;
        let spreads = Tree::new(landed).spreads([least, most]);
        let photons = merged(landed, &spreads, least);
        let lists = photons.len().next_power_of_two() as u32;
        let mut grid = Self { edge: most, levels: LEVELS, photons, lists, cells: Vec::new() };
        let levels = || grid.photons.iter().map(|photon| grid.level_of(photon));
        let first = levels().min().unwrap_or(0);
        (grid.edge, grid.levels) = (grid.edge_of(first), levels().max().map_or(0, |last| last + 1 - first));
        grid.list();
        grid
    }

    /// Fills the lists.
    fn list(&mut self) {
        let all = self.levels * self.lists as usize;
        let mut cells = vec![0_u32; all + 1];
        let mut reached = Vec::new();
        for photon in &self.photons {
            self.reached(photon, &mut reached);
            reached.iter().for_each(|list| cells[list + 1] += 1);
        }
        cells[0] = all as u32 + 1;
        for index in 0..all {
            cells[index + 1] += cells[index];
        }
        let mut next = cells.clone();
        cells.resize(cells[all] as usize, 0);
        for (index, photon) in self.photons.iter().enumerate() {
            self.reached(photon, &mut reached);
            for list in &reached {
                cells[next[*list] as usize] = index as u32;
                next[*list] += 1;
            }
        }
        self.cells = cells;
    }

    /// The lists of the cells that the ball of a photon reaches, each once.
    fn reached(&self, photon: &Photon, lists: &mut Vec<usize>) {
        let radius = photon.spread.radius * LISTED;
        let level = self.level_of(photon);
        let edge = self.edge_of(level);
        let [low, high] = [-radius, radius].map(|reach| cell_of(photon.position + reach, edge));
        lists.clear();
        for (z, y) in (low.z..=high.z).flat_map(|z| (low.y..=high.y).map(move |y| (z, y))) {
            for cell in (low.x..=high.x).map(|x| IVec3::new(x, y, z)) {
                let corner = cell.as_vec3() * edge;
                let nearest = photon.position.clamp(corner, corner + edge);
                if nearest.distance_squared(photon.position) <= radius * radius {
                    lists.push(self.list_of(level, cell));
                }
            }
        }
        // Several cells may share a list.
        lists.sort_unstable();
        lists.dedup();
    }

    /// The finest grid that a photon fits in.
    fn level_of(&self, photon: &Photon) -> usize {
        (0..self.levels).rev().find(|level| self.edge_of(*level) >= photon.spread.radius).unwrap_or(0)
    }

    fn edge_of(&self, level: usize) -> f32 {
        self.edge / (1 << level) as f32
    }

    /// The list of a cell: a hash (Teschner and others 2003).
    fn list_of(&self, level: usize, cell: IVec3) -> usize {
        let [x, y, z] = cell.as_uvec3().to_array();
        let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        level * self.lists as usize + (hash & (self.lists - 1)) as usize
    }

    /// The first elements of the photons' buffer; `origin` is that of the photons relative to the eye.
    pub fn header(&self, origin: Vec3) -> [Vec4; 2] {
        [origin.extend(self.edge), Vec4::new(self.lists as f32, self.levels as f32, 0.0, 0.0)]
    }

    /// The other elements.
    pub fn vectors(&self) -> impl Iterator<Item = Vec4> {
        self.photons.iter().flat_map(|photon| {
            let (squared, peak) = photon.squared_and_peak();
            let end = photon.spread.end;
            [photon.position.extend(squared), photon.normal.extend(end.w), peak.extend(0.0), end]
        })
    }

    /// The irradiance at a place relative to the photons' origin.
    pub fn irradiance(&self, place: Vec3, normal: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for level in 0..self.levels {
            let list = self.list_of(level, cell_of(place, self.edge_of(level)));
            for index in self.cells[list]..self.cells[list + 1] {
                let photon = &self.photons[self.cells[index as usize] as usize];
                let ((squared, peak), end) = (photon.squared_and_peak(), photon.spread.end);
                let offset = place - photon.position;
                let weight = 1.0 - offset.length_squared() / squared;
                let before = end.w - offset.dot(end.truncate());
                let is_before = before >= 0.0 || before * before < OVER_END * OVER_END * squared;
                if weight > 0.0 && is_before && photon.normal.dot(normal) > SAME_SIDE {
                    let folded = (weight - 4.0 * end.w * before.max(0.0) / squared).max(0.0);
                    sum += peak * (weight * weight + folded * folded);
                }
            }
        }
        sum
    }
}

impl Photon {
    /// The squared radius, and the irradiance amid the light that is spread.
    fn squared_and_peak(&self) -> (f32, Vec3) {
        let squared = self.spread.radius * self.spread.radius;
        (squared, self.power * (3.0 / (std::f32::consts::PI * squared)))
    }

    /// All power of photons that lie close together, at the mean of their places by their power.
    fn merged(run: &[(&Landed, &Spread)]) -> Self {
        let (mut position, mut normal, mut power, mut weights) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
        for (photon, _) in run {
            let own = photon.power.truncate().as_dvec3();
            // Photons without power count a little, so that there is a mean.
            let weight = own.element_sum() + f64::MIN_POSITIVE;
            position += photon.position.truncate().as_dvec3() * weight;
            normal += photon.normal.truncate().as_dvec3() * weight;
            power += own;
            weights += weight;
        }
        Self {
            position: (position / weights).as_vec3(),
            normal: normal.normalize_or(DVec3::Z).as_vec3(),
            power: power.as_vec3(),
            spread: *run[0].1,
        }
    }
}

/// The photons, of which those of the least radius are merged.
fn merged(landed: &[Landed], spreads: &[Spread], least: f32) -> Vec<Photon> {
    let key = |(photon, _): &(&Landed, &Spread)| {
        let normal = photon.normal.truncate();
        let axis = normal.abs().max_position();
        ((photon.position.truncate() / (least * MERGED)).floor().as_i64vec3().to_array(), axis, normal[axis] > 0.0)
    };
    let (mut close, wide): (Vec<_>, Vec<_>) =
        landed.iter().zip(spreads).partition(|(_, spread)| spread.radius <= least);
    close.sort_by_cached_key(key);
    let close = close.chunk_by(|one, other| key(one) == key(other)).map(Photon::merged);
    wide.iter().map(|photon| Photon::merged(std::slice::from_ref(photon))).chain(close).collect()
}

/// Leaves no more photons than `most`, which carry the power of all: one of so many that follow each other, drawn by a hash,
/// since every n-th one of a spiral can lie on its arms.
pub(super) fn thin(landed: &mut Vec<Landed>, most: usize) {
    let each = landed.len().div_ceil(most);
    if each > 1 {
        let power = |photons: &[Landed]| photons.iter().map(|photon| photon.power.as_dvec4()).sum::<DVec4>();
        let before = power(landed);
        let drawn = |(number, run): (usize, &[Landed])| run[cloud::hash(number as u64) as usize % run.len()];
        *landed = landed.chunks(each).enumerate().map(drawn).collect();
        let after = power(landed);
        let factor = DVec4::select(after.cmpgt(DVec4::ZERO), before / after, DVec4::ONE);
        landed.iter_mut().for_each(|photon| photon.power *= factor.as_vec4());
    }
}
