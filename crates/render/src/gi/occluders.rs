//! Chooses the points that cast indirect shadows: a subset of a store's points, chosen by the area that each
//! represents, so that a scan's dense parts do not take the samples of its sparse ones (Ritschel et al. 2008 sample
//! meshes evenly by area).
//!
//! The choice depends on the points' places: the same points give the same subset in whatever order and chunks (pages
//! have another order than files), and points that come or go in one place change almost nothing elsewhere.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::LazyLock;

use cloud::{NO_RADIUS, SPLAT_OVERLAP, stretch_ratio, unpack_radius};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::store::VisibleChunk;

/// The number of subsets. Shadow maps take turns at them, so that points that one subset lacks are not missing from all
/// maps.
const MOST_SUBSETS: usize = 8;
/// The identity that fills a subset that has no more points.
const NO_POINT: u32 = u32::MAX;

/// The chosen points, for shaders/vpl_shadow_splat.wgsl.
#[derive(Default)]
pub(crate) struct Occluders {
    /// The bits of the position from the origin, and the identity in the store. Point `slot * subsets + subset` is
    /// number `slot` of a subset; subsets with fewer points than others end with some that have `NO_POINT`.
    pub points: Vec<[u32; 4]>,
    pub subsets: u32,
    /// The radius of a disc in world units, such that the discs of one subset overlap as the points' own discs do at
    /// splat.size 1.
    pub radius: f32,
    /// The area of all surfaces in square world units; discs are taken to overlap as those of scans do.
    pub area: f64,
}

impl Occluders {
    /// Chooses from the shown points about `per_subset` for each subset, up to an eighth fewer, with positions relative
    /// to `origin`; if there are fewer points, one per cell.
    ///
    /// Cells at most as wide as the distance between samples offer one point each. Tile by tile of 8 x 8 x 8 cells, the
    /// chosen ones are a systematic sample over the summed areas of the splats, along the tile's Morton curve.
    pub fn choose(chunks: &[VisibleChunk<'_>], origin: DVec3, per_subset: u32) -> Self {
        let squares = &*SQUARES;
        let weight = |chunk: &VisibleChunk<'_>, index: usize| {
            let packed = chunk.points.radii.as_ref().map_or(NO_RADIUS, |radii| radii[index]);
            if packed == NO_RADIUS { square(chunk.provisional_radius) } else { squares[usize::from(packed)] }
        };
        let is_somewhere = |chunk: &VisibleChunk<'_>, index: &usize| {
            chunk.shown.has(*index) && Vec3::from(chunk.points.positions[*index]).is_finite()
        };
        let weight_of = |chunk: &VisibleChunk<'_>| -> f64 {
            (0..chunk.points.len()).filter(|index| is_somewhere(chunk, index)).map(|index| weight(chunk, index)).sum()
        };
        let total: f64 = chunks.par_iter().map(weight_of).sum();
        if !(total > 0.0 && total.is_finite()) {
            return Self { subsets: 1, ..Self::default() };
        }
        let points: usize = chunks.iter().map(|chunk| chunk.shown_points).sum();
        let subsets = (points / per_subset.max(1) as usize).clamp(1, MOST_SUBSETS);
        let count = (subsets * per_subset as usize).min(points);
        // In eighths of an octave, so that it stays the same while a few points come and go.
        let step = (((total / count as f64).log2() * 8.0).ceil() / 8.0).exp2();
        let lattice = Lattice::new(step);
        let units = STEP as f64 / step;
        let cells_of = |cells: &mut Cells, (number, chunk): (usize, &VisibleChunk<'_>)| -> Vec<(u64, Cell)> {
            let place = lattice.placing(chunk.points.origin);
            for (index, position) in
                chunk.points.positions.iter().enumerate().filter(|(index, _)| chunk.shown.has(*index))
            {
                let Some((key, distance)) = place(*position) else { continue };
                let area = (weight(chunk, index) * units) as u64;
                cells.add(chunks, key, Cell { area, distance, chunk: number as u32, index: index as u32 });
            }
            cells.0.drain().collect()
        };
        let of_chunks: Vec<Vec<(u64, Cell)>> =
            chunks.par_iter().enumerate().map_init(Cells::default, cells_of).collect();
        let mut cells = Cells::default();
        of_chunks.into_iter().flatten().for_each(|(key, cell)| cells.add(chunks, key, cell));
        let mut cells: Vec<(u64, Cell)> = cells.0.into_iter().map(|(key, cell)| (morton(key), cell)).collect();
        cells.par_sort_unstable_by_key(|(rank, _)| *rank);

        let tile = |rank: u64| rank >> (3 * TILE_BITS);
        let mut chosen: Vec<Vec<[u32; 4]>> = vec![Vec::new(); subsets];
        for cells in cells.chunk_by(|(a, _), (b, _)| tile(*a) == tile(*b)) {
            let start = cloud::hash(tile(cells[0].0));
            let (mut sum, mut subset, mut owed) = (start % STEP, (start >> 32) as usize, 0);
            for (_, cell) in cells {
                let before = sum;
                sum += cell.area;
                // A cell that represents more than a step gives one point, and so does the next; further ones are
                // skipped instead of accumulating.
                owed = (owed + sum / STEP - before / STEP).min(2);
                if owed > 0 || (points <= per_subset as usize && cell.area > 0) {
                    owed = owed.saturating_sub(1);
                    chosen[subset % subsets].push(cell.point(chunks, origin));
                    subset += 1;
                }
            }
        }
        let area = cells.iter().map(|(_, cell)| cell.area).sum::<u64>() as f64 / units;
        let in_each = (chosen.iter().map(Vec::len).sum::<usize>() as f64 / subsets as f64).max(1.0);
        let slots = chosen.iter().map(Vec::len).max().unwrap_or(0);
        let at = |index: usize| chosen[index % subsets].get(index / subsets).copied().unwrap_or([0, 0, 0, NO_POINT]);
        Self {
            points: (0..slots * subsets).map(at).collect(),
            subsets: subsets as u32,
            radius: (area / in_each).sqrt() as f32,
            area: area * PI / f64::from(SPLAT_OVERLAP).powi(2),
        }
    }
}

/// The squared radius, in square world units, of each packed radius, over the stretch of its ellipse: a table of all is
/// faster than one by one.
static SQUARES: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let area = |packed: u16| unpack_radius(packed).map_or(0.0, square) / f64::from(stretch_ratio(packed));
    (0..=u16::MAX).map(area).collect()
});

fn square(radius: f32) -> f64 {
    f64::from(radius) * f64::from(radius)
}

/// The units of area per step from one sample to the next: integers, whose sums do not depend on their order.
const STEP: u64 = 1 << 32;
/// The binary logarithm of the number of cells along a tile.
const TILE_BITS: u32 = 3;
/// The binary logarithm of the number of cells along an axis; further cells are identified with those at the beginning.
const KEY_BITS: u32 = 21;
const KEY_MASK: u64 = (1 << KEY_BITS) - 1;

/// The world's origin in cells, and the place in a cell whose nearest point it offers. The numbers are not round:
/// points on a grid, and floors at round heights, are neither on the sides of cells, where rounding would move them,
/// nor at equal distances.
const SHIFT: DVec3 = DVec3::new(3.180_34, 4.414_21, 5.732_05);
const MIDDLE: [f64; 3] = [0.414_2, 0.532_1, 0.618_0];

/// The cells of the world. Their width is a power of two, from half the distance between samples up to twice that.
struct Lattice {
    cells_per_unit: f64,
}

impl Lattice {
    /// `step` is the sum of squared splat radii from one sample to the next.
    fn new(step: f64) -> Self {
        let apart = (PI * step).sqrt() / f64::from(SPLAT_OVERLAP);
        Self { cells_per_unit: (-apart.log2().floor()).exp2() }
    }

    /// Maps the offset of a chunk's point to its cell and the squared distance from the cell's middle; `None` for a
    /// position that is not finite.
    fn placing(&self, origin: DVec3) -> impl Fn([f32; 3]) -> Option<(u64, f32)> {
        // The bias makes rounding toward zero the same as rounding down.
        const BIAS: f64 = (1 << 30) as f64;
        let cells_per_unit = self.cells_per_unit;
        let start = origin * cells_per_unit + SHIFT;
        let first = start.floor().to_array().map(|cell| (cell as i64 - (1 << 30)) as u64);
        let start = start.to_array().map(|cell| cell - cell.floor() + BIAS);
        move |position| {
            let at: [f64; 3] = std::array::from_fn(|axis| start[axis] + f64::from(position[axis]) * cells_per_unit);
            let cell = at.map(|place| place as i32);
            let off: [f64; 3] = std::array::from_fn(|axis| at[axis] - f64::from(cell[axis]) - MIDDLE[axis]);
            let squared = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) as f32;
            let [x, y, z]: [u64; 3] =
                std::array::from_fn(|axis| first[axis].wrapping_add(cell[axis] as u64) & KEY_MASK);
            // The comparison is false for NaN.
            (squared < 3.0).then_some((x | y << KEY_BITS | z << (2 * KEY_BITS), squared))
        }
    }
}

/// What is known of the points of a cell.
#[derive(Clone, Copy)]
struct Cell {
    /// The area that all of them represent.
    area: u64,
    /// The squared distance from the middle to the nearest of them, in cells.
    distance: f32,
    chunk: u32,
    index: u32,
}

impl Cell {
    fn point(&self, chunks: &[VisibleChunk<'_>], origin: DVec3) -> [u32; 4] {
        let chunk = &chunks[self.chunk as usize];
        let [x, y, z] = (chunk.points.position(self.index as usize) - origin).as_vec3().to_array().map(f32::to_bits);
        [x, y, z, chunk.first_identity + self.index]
    }

    /// The normal and the colour, which distinguish points at one place if they differ.
    fn look(&self, chunks: &[VisibleChunk<'_>]) -> (Option<u32>, Option<[u8; 4]>) {
        let (chunk, index) = (chunks[self.chunk as usize].points, self.index as usize);
        (chunk.normals.as_ref().map(|normals| normals[index]), chunk.colors.as_ref().map(|colors| colors[index]))
    }
}

#[derive(Default)]
struct Cells(HashMap<u64, Cell, BuildHasherDefault<KeyHasher>>);

impl Cells {
    fn add(&mut self, chunks: &[VisibleChunk<'_>], key: u64, cell: Cell) {
        let known = self.0.entry(key).or_insert(Cell { area: 0, ..cell });
        known.area += cell.area;
        let is_nearer = cell.distance < known.distance
            || (cell.distance == known.distance && cell.look(chunks) < known.look(chunks));
        if is_nearer {
            *known = Cell { area: known.area, ..cell };
        }
    }
}

/// The standard library's hash takes longer than everything else here.
#[derive(Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u64(&mut self, key: u64) {
        // A multiplicative hash (Knuth) of both halves.
        let mixed = (self.0 ^ key ^ key >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 32;
    }
}

/// The rank of a cell along the Morton curve.
fn morton(key: u64) -> u64 {
    let spread = |axis: u32| {
        let mut bits = key >> (axis * KEY_BITS) & KEY_MASK;
        bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        ((bits | bits << 2) & 0x1249_2492_4924_9249) << axis
    };
    spread(0) | spread(1) | spread(2)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Chunk, Cloud, Column, ColumnType, PointTest, ShownPoints, pack_radius};

    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Point {
        at: DVec3,
        /// The area that it represents.
        area: f64,
        color: [u8; 4],
    }

    fn unit(index: u64) -> f64 {
        cloud::hash(index) as f64 / u64::MAX as f64
    }

    /// Hills of 100 by 100 at coordinates of seven digits, on a grid of millimetres, in rows. Beyond the middle there
    /// are four times as many points.
    fn hills(points: u64) -> Vec<Point> {
        let point = |index: u64| {
            let (x, is_dense) = (unit(3 * index), !index.is_multiple_of(5));
            let x = 50.0 * x + if is_dense { 50.0 } else { 0.0 };
            let y = 100.0 * index as f64 / points as f64;
            let at = DVec3::new(x, y, 2.0 * (x / 9.0).sin() * (y / 14.0).cos());
            let area = 5000.0 / points as f64 / if is_dense { 0.8 } else { 0.2 };
            let color = [(x * 2.0) as u8, (y * 2.0) as u8, 0, 255];
            Point { at: ((at + DVec3::new(431_000.0, 5_412_000.0, 7.0)) * 1e3).round() / 1e3, area, color }
        };
        (0..points).map(point).collect()
    }

    fn shuffled(mut points: Vec<Point>) -> Vec<Point> {
        for index in (1..points.len()).rev() {
            points.swap(index, (cloud::hash(index as u64) % (index as u64 + 1)) as usize);
        }
        points
    }

    /// Chunks of `size` points, each with its first point as the origin.
    fn chunks(points: &[Point], size: usize) -> Vec<Chunk> {
        let chunk = |points: &[Point]| {
            let origin = points[0].at.round();
            let radius = |area: f64| pack_radius(SPLAT_OVERLAP * (area / PI).sqrt() as f32);
            Chunk {
                colors: Some(Arc::new(points.iter().map(|point| point.color).collect())),
                radii: Some(Arc::new(points.iter().map(|point| radius(point.area)).collect())),
                ..Chunk::new(0, origin, points.iter().map(|p| (p.at - origin).as_vec3().to_array()).collect())
            }
        };
        points.chunks(size).map(chunk).collect()
    }

    fn choose(chunks: &[Chunk], per_subset: u32) -> Occluders {
        choose_shown(chunks, per_subset, &PointTest::default())
    }

    /// A cloud whose first column holds classes.
    fn classified(chunks: Vec<Chunk>) -> Cloud {
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        Cloud { attributes, chunks, ..Cloud::default() }
    }

    fn choose_shown(chunks: &[Chunk], per_subset: u32, test: &PointTest) -> Occluders {
        let mut first_identity = 0;
        let test = classified(Vec::new()).test(test);
        let shown: Vec<ShownPoints> = chunks.iter().map(|chunk| test.shown(chunk, chunk.bounds())).collect();
        let visible: Vec<VisibleChunk<'_>> = chunks
            .iter()
            .zip(&shown)
            .map(|(points, shown)| {
                let shown_points = shown.indices(points.len()).count();
                let chunk = VisibleChunk { points, first_identity, provisional_radius: 0.0, shown_points, shown };
                first_identity += points.len() as u32;
                chunk
            })
            .collect();
        Occluders::choose(&visible, DVec3::ZERO, per_subset)
    }

    /// The points of each slot of `chosen`, taken from the points that it was chosen from.
    fn points_of(chosen: &Occluders, points: &[Point]) -> Vec<Option<Point>> {
        chosen.points.iter().map(|[.., identity]| points.get(*identity as usize).copied()).collect()
    }

    #[test]
    fn neither_order_nor_chunks_of_the_points_change_the_choice() {
        let mut points = hills(300_000);
        // Some places have two points.
        let twins: Vec<Point> = points.iter().step_by(10).map(|point| Point { color: [9; 4], ..*point }).collect();
        points.extend(twins);
        let other = shuffled(points.clone());
        for per_subset in [500, 8192] {
            let (one, two) =
                (choose(&chunks(&points, 65_536), per_subset), choose(&chunks(&other, 10_000), per_subset));
            assert_eq!((one.subsets, one.radius, one.area), (two.subsets, two.radius, two.area));
            let (one, two) = (points_of(&one, &points), points_of(&two, &other));
            assert_eq!(one.len(), two.len());
            let places = |points: &[Option<Point>]| points.iter().map(|point| point.map(|point| point.at)).collect();
            let (places_of_one, places_of_two): (Vec<_>, Vec<_>) = (places(&one), places(&two));
            let moved = places_of_one.iter().zip(&places_of_two).filter(|(one, two)| one != two).count();
            // Offsets in other chunks are rounded differently.
            assert!(moved * 1000 <= one.len(), "{moved} of {} points are others", one.len());
        }
        let together = chunks(&points, points.len());
        let reversed: Vec<Point> = points.iter().copied().rev().collect();
        let mut turned = chunks(&reversed, points.len());
        turned[0].origin = together[0].origin;
        turned[0].positions = Arc::new(together[0].positions.iter().rev().copied().collect());
        let (one, two) = (choose(&together, 8192), choose(&turned, 8192));
        assert_eq!(points_of(&one, &points), points_of(&two, &reversed), "also of points at one place");
    }

    #[test]
    fn each_subset_covers_all_of_a_surface_whatever_its_density() {
        let points = hills(300_000);
        for per_subset in [2000, 2800, 4000] {
            let chosen = choose(&chunks(&points, 65_536), per_subset);
            assert_eq!(chosen.subsets, 8);
            let chosen_points = points_of(&chosen, &points);
            for subset in 0..8 {
                let own: Vec<DVec3> =
                    chosen_points.iter().skip(subset).step_by(8).flatten().map(|point| point.at).collect();
                assert!((per_subset * 7 / 8..=per_subset * 101 / 100).contains(&(own.len() as u32)), "{}", own.len());
                let dense = own.iter().filter(|at| at.x > 431_050.0).count() as f64 / own.len() as f64;
                assert!((dense - 0.5).abs() < 0.02, "{dense} of the points lie in the dense half");
                let seen = points
                    .iter()
                    .step_by(307)
                    .filter(|point| own.iter().any(|other| point.at.distance(*other) < f64::from(chosen.radius)));
                let (seen, all) = (seen.count() as f64, points.iter().step_by(307).count() as f64);
                // Random points would leave 2 % uncovered.
                assert!(seen / all > 0.995, "{} of the surface is covered", seen / all);
            }
        }
    }

    #[test]
    fn points_that_come_change_next_to_nothing_elsewhere() {
        let points = hills(300_000);
        let mut more = points.clone();
        more.extend((0..5000).map(|index| Point {
            at: DVec3::new(430_980.0 + 5.0 * unit(index), 5_411_980.0 + 5.0 * unit(index + 5000), 7.0),
            area: 0.005,
            color: [0; 4],
        }));
        let (before, after) = (choose(&chunks(&points, 65_536), 2000), choose(&chunks(&more, 65_536), 2000));
        let of_subset = |chosen: &Occluders, points: &[Point], subset: usize| {
            let own = points_of(chosen, points).into_iter().skip(subset).step_by(8).flatten();
            own.filter(|point| point.at.x > 430_999.0).map(|point| point.at).collect::<Vec<_>>()
        };
        for subset in 0..8 {
            let (before, after) = (of_subset(&before, &points, subset), of_subset(&after, &more, subset));
            assert_eq!(before, after);
        }
        assert!(points_of(&after, &more).iter().flatten().any(|point| point.at.x < 430_990.0));
    }

    #[test]
    fn hidden_points_take_the_places_of_no_others() {
        let points = hills(300_000);
        // Every other point is of class 7.
        let classes = |points: usize| (0..points).map(|index| if index % 2 == 0 { 2 } else { 7 }).collect();
        let mut all = chunks(&points, 65_536);
        for chunk in &mut all {
            chunk.columns = vec![Some(Arc::new(Column::U8(classes(chunk.len()))))];
        }
        let test = PointTest::hiding([7]);
        let rest = classified(all.clone()).shown(&test).chunks;
        for per_subset in [2000, 100_000] {
            let (hidden, absent) = (choose_shown(&all, per_subset, &test), choose(&rest, per_subset));
            assert_eq!((hidden.subsets, hidden.radius, hidden.area), (absent.subsets, absent.radius, absent.area));
            let places = |chosen: &Occluders| -> Vec<[u32; 3]> {
                let taken = chosen.points.iter().filter(|[.., identity]| *identity != NO_POINT);
                taken.map(|[x, y, z, _]| [*x, *y, *z]).collect()
            };
            assert!(places(&hidden).len() > 1000 && places(&hidden) == places(&absent));
        }
    }

    #[test]
    fn few_points_are_all_taken_and_those_that_are_nowhere_are_not() {
        let mut chunk = Chunk::new(0, DVec3::X, vec![[0.0; 3], [f32::NAN; 3], [40.0, 0.0, 0.0], [f32::INFINITY; 3]]);
        let identities = |chosen: &Occluders| {
            let mut identities: Vec<u32> = chosen.points.iter().map(|[.., identity]| *identity).collect();
            identities.sort_unstable();
            identities
        };
        assert!(choose(&[chunk.clone()], 10).points.is_empty(), "no point has a radius");
        chunk.radii = Some(Arc::new(vec![pack_radius(1.0); 4]));
        let chosen = choose(&[chunk.clone()], 10);
        assert_eq!((identities(&chosen), chosen.subsets, chosen.radius), (vec![0, 2], 1, 1.0));
        assert!((chosen.area / (2.0 * PI / f64::from(SPLAT_OVERLAP).powi(2)) - 1.0).abs() < 1e-6);
        assert!(choose(&[], 10).points.is_empty());
        chunk.radii = Some(Arc::new(vec![0; 4]));
        assert!(choose(&[chunk], 10).points.is_empty());
    }
}
