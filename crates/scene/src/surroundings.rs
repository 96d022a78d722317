//! Decides from the places of its points alone whether a scan has the open sky above it or is a closed room, and makes
//! a lamp for the room: light for scans without any.

use std::collections::{HashMap, HashSet};
use std::f64::consts::PI;

use cloud::Bounds;
use glam::DVec3;

use crate::{Camera, Interior, Lighting, SpotLight};

/// The surroundings of a viewer of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surroundings {
    /// Nothing hangs over it: a landscape, a street, a forest, an object on a table.
    OpenSky,
    Room(Room),
}

/// A floor and a ceiling over it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// The lamp, which hangs under the ceiling in the middle of the largest part.
    pub lamp: SpotLight,
    /// The bounds around the lamp between the room's walls, from floor to ceiling, in world units: seen from outside,
    /// the lamp lights nothing visible.
    pub inside: Bounds,
    /// Where to stand in it: at eye height between the middle of the largest part and the wall behind.
    pub eye: DVec3,
    /// What to look at from there: the other end.
    pub pivot: DVec3,
}

impl Room {
    /// A camera that stands in the room.
    pub fn camera(&self, up: DVec3) -> Camera {
        Camera::from_eye(self.eye, self.pivot, up)
    }

    /// Whether its lamp shines if it is the only light: automatically for an eye inside the room, else if it is asked
    /// for.
    pub fn lamp_shines(&self, by: Lighting, eye: DVec3) -> bool {
        by == Lighting::Lights || (matches!(by, Lighting::Auto | Lighting::Surroundings) && self.inside.contains(eye))
    }
}

/// The number of cells along the longer side of the ground plan: a cell of a room is then about as wide as a cupboard.
const CELLS: f64 = 32.0;
/// The average number of points of a cell in small clouds, which get larger cells.
const POINTS_PER_CELL: f64 = 40.0;
/// The number of widths of cells for each doubling.
const STEPS: f64 = 8.0;
/// The number of points that a column needs for its layers to be distinguishable.
const FEWEST: usize = 12;
/// The share of the points that may be stray on either side of an axis.
const STRAY: f64 = 0.01;

/// The height of the eye as a share of that of the ceiling.
const EYE_HEIGHT: f64 = 0.6;

/// The free heights that people build: in metres from a crawl space to a hall, in feet from a cupboard to a living
/// room.
const BUILT: std::ops::RangeInclusive<f64> = 1.8..=12.0;

/// In a hull, ceilings rise where floors sink: the correlation is -1 for an ellipsoid, -0.6 for the hull of a figure
/// with limbs, 0.2 for a building of several storeys.
const HULL: f64 = -0.3;

/// The radiance of a lamp's floor that reflects half of the light: less than half of the screen's white.
const FLOOR_RADIANCE: f64 = 0.4;
const FLOOR_ALBEDO: f64 = 0.5;
/// The half angles of a lamp's cone in degrees: wider ones have too few texels of their shadow map left for the floor.
const LAMP_DEGREES: (f32, f32) = (72.0, 80.0);

impl Surroundings {
    /// Judges by columns over a grid of the ground plan. A column is covered if the largest gap between its points is a sixth
    /// of the cloud's height, wider than two cells, and closed by a thin layer above it; it is open if its points stay low;
    /// walls, trunks and tree crowns, which fill their columns, say nothing. A room has covered columns, and more than twice
    /// as many as open ones. So has the hull of an object, from below and above: of a room, most gaps are equally high, or,
    /// of several storeys, as high as people build in metres or feet and not the higher the deeper they reach, as a hull's
    /// are. The hull of a box of lids is taken for a room.
    ///
    /// `positions` are world coordinates spread evenly over the points, in any order; 100 thousand take 20 ms. `up` is the
    /// axis that points up.
    pub fn of(positions: impl Iterator<Item = DVec3>, up: DVec3) -> Self {
        Self::with_interior(positions, up).0
    }

    /// Judges likewise, and returns the free space of all rooms beside it, if the points are a room.
    pub fn with_interior(positions: impl Iterator<Item = DVec3>, up: DVec3) -> (Self, Option<Interior>) {
        let frame = Frame::new(up);
        let points: Vec<DVec3> = positions.map(|position| frame.local(position)).collect();
        let plan = GroundPlan::new(&points).filter(GroundPlan::is_room);
        let room = plan.and_then(|plan| Some((plan.room(&frame)?, plan.interior(&frame))));
        room.map_or((Self::OpenSky, None), |(room, interior)| (Self::Room(room), Some(interior)))
    }
}

/// Two horizontal axes and the vertical one.
struct Frame([DVec3; 3]);

impl Frame {
    fn new(up: DVec3) -> Self {
        let up = up.normalize_or(DVec3::Z);
        let (right, forward) = up.any_orthonormal_pair();
        Self([right, forward, up])
    }

    fn local(&self, world: DVec3) -> DVec3 {
        DVec3::from(self.0.map(|axis| axis.dot(world)))
    }

    fn world(&self, local: DVec3) -> DVec3 {
        self.0[0] * local.x + self.0[1] * local.y + self.0[2] * local.z
    }
}

/// A column with a gap that a ceiling closes, with the heights of both sides of the gap.
#[derive(Clone, Copy, Debug)]
struct Gap {
    floor: f64,
    ceiling: f64,
}

impl Gap {
    fn height(&self) -> f64 {
        self.ceiling - self.floor
    }
}

enum Column {
    Covered(Gap),
    Filled,
    Open,
}

/// The ground plan of a cloud.
struct GroundPlan {
    /// The low corner of cell (0, 0).
    corner: DVec3,
    edge: f64,
    covered: HashMap<(i32, i32), Gap>,
    open: usize,
    /// The number of columns of all kinds.
    occupied: usize,
}

impl GroundPlan {
    /// `None` for clouds with almost no points or without extent. Coordinates are those of a `Frame`, as below.
    fn new(points: &[DVec3]) -> Option<Self> {
        let range = |axis: usize| {
            let mut values: Vec<f64> =
                points.iter().map(|point| point[axis]).filter(|value| value.is_finite()).collect();
            let stray = (values.len() as f64 * STRAY) as usize;
            let last = values.len().checked_sub(1 + stray)?;
            let low = *values.select_nth_unstable_by(stray, f64::total_cmp).1;
            Some((low, *values.select_nth_unstable_by(last, f64::total_cmp).1))
        };
        let (x, y, height) = (range(0)?, range(1)?, range(2)?);
        let height = height.1 - height.0;
        let cells = (points.len() as f64 / POINTS_PER_CELL).sqrt().clamp(4.0, CELLS);
        let edge = (x.1 - x.0).max(y.1 - y.0) / cells;
        if !(edge > 0.0 && height > 0.0) {
            return None;
        }
        // In steps, and in whole cells from the origin, so that a few other points make no other plan.
        let edge = ((edge.log2() * STEPS).ceil() / STEPS).exp2();
        let [low, high] = [(x.0, y.0), (x.1, y.1)].map(|(x, y)| (DVec3::new(x, y, 0.0) / edge).floor());
        let corner = low * edge;
        let last = high - low;
        let mut columns: HashMap<(i32, i32), Vec<f64>> = HashMap::new();
        for point in points {
            let cell = (*point / edge).floor() - low;
            let is_inside = (0.0..=last.x).contains(&cell.x) && (0.0..=last.y).contains(&cell.y);
            if !is_inside {
                continue;
            }
            columns.entry((cell.x as i32, cell.y as i32)).or_default().push(point.z);
        }
        let mut plan = Self { corner, edge, covered: HashMap::new(), open: 0, occupied: 0 };
        for (cell, mut heights) in columns.into_iter().filter(|(_, heights)| heights.len() >= FEWEST) {
            heights.sort_unstable_by(f64::total_cmp);
            plan.occupied += 1;
            match column(&heights, height, edge) {
                Column::Covered(gap) => drop(plan.covered.insert(cell, gap)),
                Column::Filled => {}
                Column::Open => plan.open += 1,
            }
        }
        Some(plan)
    }

    fn is_room(&self) -> bool {
        let count = self.covered.len();
        // Most of a narrow corridor may be walls.
        if count <= 2 * self.open || 3 * count <= self.occupied {
            return false;
        }
        let mut heights: Vec<f64> = self.covered.values().map(Gap::height).collect();
        heights.sort_unstable_by(f64::total_cmp);
        // A ball of any size has a third of its gaps within a fifth of one another, empty rooms nine tenths.
        let within = |low: &f64| heights.partition_point(|height| *height <= low * 1.2);
        let alike = heights.iter().enumerate().map(|(index, low)| within(low) - index).max().unwrap_or(0);
        let joined = self.floors_with_ceilings();
        5 * alike > 3 * count || (BUILT.contains(&heights[count / 2]) && joined > HULL)
    }

    /// The correlation (Pearson's, -1 to 1) between the heights of ceilings and those of the floors below them.
    fn floors_with_ceilings(&self) -> f64 {
        let count = self.covered.len() as f64;
        let mean = |value: &dyn Fn(&Gap) -> f64| self.covered.values().map(value).sum::<f64>() / count;
        let (floor, ceiling) = (mean(&|gap| gap.floor), mean(&|gap| gap.ceiling));
        let product = mean(&|gap| (gap.floor - floor) * (gap.ceiling - ceiling));
        let variances = mean(&|gap| (gap.floor - floor).powi(2)) * mean(&|gap| (gap.ceiling - ceiling).powi(2));
        if variances > 0.0 { product / variances.sqrt() } else { 0.0 }
    }

    fn room(&self, frame: &Frame) -> Option<Room> {
        let lamp = self.lamp()?;
        let mut inside = Bounds::EMPTY;
        let around = self.around(&lamp);
        let (eye, pivot) = self.stand(&lamp, &around);
        for (x, y) in around {
            let gap = self.covered[&(x, y)];
            // Including the cells of the walls.
            let corner = self.corner + DVec3::new(f64::from(x - 1), f64::from(y - 1), 0.0) * self.edge;
            let opposite = corner + DVec3::new(3.0, 3.0, 0.0) * self.edge;
            inside.include(frame.world(corner.with_z(gap.floor)));
            inside.include(frame.world(opposite.with_z(gap.ceiling)));
        }
        Some(Room { lamp: lamp.in_world(frame), inside, eye: frame.world(eye), pivot: frame.world(pivot) })
    }

    fn interior(&self, frame: &Frame) -> Interior {
        let cells = self.covered.iter().map(|(cell, gap)| (*cell, [gap.floor, gap.ceiling])).collect();
        Interior { axes: frame.0, corner: self.corner, edge: self.edge, cells }
    }

    /// Where to stand in these cells, and what to look at: from the middle, the line of sight goes to the farthest cell, and
    /// the eye steps back from it half as far as the room allows.
    fn stand(&self, lamp: &Lamp, cells: &[(i32, i32)]) -> (DVec3, DVec3) {
        let center =
            |(x, y): (i32, i32)| self.corner + DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0) * self.edge;
        let (middle, known) = (center(lamp.cell), cells.iter().copied().collect::<HashSet<_>>());
        let far = |cell: &(i32, i32)| (center(*cell).distance_squared(middle), *cell);
        let farthest = cells.iter().max_by(|a, b| {
            let ((a, of_a), (b, of_b)) = (far(a), far(b));
            a.total_cmp(&b).then(of_a.cmp(&of_b))
        });
        let target = farthest.map_or(middle + DVec3::X, |cell| center(*cell));
        let sight = (target - middle).normalize_or(DVec3::X);
        let is_free = |steps: &i32| {
            let cell = ((middle - sight * (f64::from(*steps) * self.edge) - self.corner) / self.edge).floor();
            known.contains(&(cell.x as i32, cell.y as i32))
        };
        let steps = (1..CELLS as i32).take_while(is_free).last().unwrap_or(0);
        let at = |place: DVec3, share: f64| place.with_z(lamp.floor + lamp.height * share);
        // Most ceilings are two and a half metres high, and eyes one and a half.
        let eye = at(middle - sight * (f64::from(steps) * 0.5 * self.edge), EYE_HEIGHT);
        (eye, at(middle + (target - middle) * 0.5, EYE_HEIGHT * 0.8))
    }

    /// The covered cells that are connected with the lamp's, as far as it lights the floor: walls and the dark end
    /// them.
    fn around(&self, lamp: &Lamp) -> Vec<(i32, i32)> {
        // Irradiance falls with the cube of the distance there: at twice the lamp's radius an eighth is left.
        let reach = (2.0 * lamp.radius / self.edge).powi(2);
        let is_near = |(x, y): (i32, i32)| f64::from((x - lamp.cell.0).pow(2) + (y - lamp.cell.1).pow(2)) <= reach;
        let mut found = vec![lamp.cell];
        let mut known = HashSet::from([lamp.cell]);
        let mut next = 0;
        while let Some(&(x, y)) = found.get(next) {
            next += 1;
            for cell in [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)] {
                if self.covered.contains_key(&cell) && is_near(cell) && known.insert(cell) {
                    found.push(cell);
                }
            }
        }
        found
    }

    fn lamp(&self) -> Option<Lamp> {
        // The middle of the largest room is the cell with the most covered columns around it; among several, the middle
        // one.
        let reach = (CELLS / 8.0) as i32;
        let around = |(x, y): (i32, i32)| {
            let row = move |dy: i32| (-reach..=reach).map(move |dx| (x + dx, y + dy));
            (-reach..=reach).flat_map(row).filter_map(|cell| self.covered.get(&cell))
        };
        let most = self.covered.keys().map(|cell| around(*cell).count()).max()?;
        // Cells with nearly as many count, too, so that the middle does not depend on a few points.
        let best: Vec<(i32, i32)> =
            self.covered.keys().copied().filter(|cell| 20 * around(*cell).count() >= 19 * most).collect();
        let center = |(x, y): (i32, i32)| DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0);
        let middle = best.iter().map(|cell| center(*cell)).sum::<DVec3>() / best.len() as f64;
        let off = |cell: (i32, i32)| (center(cell).distance_squared(middle), cell);
        let cell =
            best.into_iter().min_by(|a, b| off(*a).partial_cmp(&off(*b)).unwrap_or(std::cmp::Ordering::Equal))?;
        let median = |value: fn(&Gap) -> f64| {
            let mut values: Vec<f64> = around(cell).map(value).collect();
            values.sort_unstable_by(f64::total_cmp);
            values[values.len() / 2]
        };
        // In steps, so that the lamp stays where a few points are others.
        let step = self.edge / 64.0;
        let in_steps = |height: f64| (height / step).round() * step;
        let floor = in_steps(median(|gap| gap.floor));
        let ceiling = in_steps(median(|gap| gap.ceiling).min(self.covered[&cell].ceiling));
        // One lamp serves no more than twice its height around.
        let width = (self.covered.len() as f64 / PI).sqrt().round() * self.edge;
        let place = self.corner + center(cell) * self.edge;
        let height = ceiling - floor;
        (height > 0.0).then(|| Lamp { cell, place, floor, height, radius: width.min(2.0 * height) })
    }
}

/// The properties of a lamp in a `Frame`.
struct Lamp {
    /// The cell of the plan.
    cell: (i32, i32),
    place: DVec3,
    floor: f64,
    /// The height from floor to ceiling.
    height: f64,
    /// The radius of the floor that it is to light.
    radius: f64,
}

impl Lamp {
    fn in_world(&self, frame: &Frame) -> SpotLight {
        let at = |height: f64| frame.world(self.place.with_z(self.floor + height));
        // Under the ceiling, and below beams.
        let hangs = 0.9 * self.height;
        SpotLight {
            position: at(hangs),
            target: at(0.0),
            intensity: [intensity(hangs, self.radius) as f32; 3],
            inner_degrees: LAMP_DEGREES.0,
            outer_degrees: LAMP_DEGREES.1,
        }
    }
}

/// The radiant intensity of a lamp at `height` above a floor that gives a disc of it, `radius` wide, `FLOOR_RADIANCE` in the
/// mean. Irradiance of the floor is I h / (h^2 + r^2)^(3/2), its mean over the disc 2 I (1 - h / sqrt(h^2 + r^2)) / r^2.
fn intensity(height: f64, radius: f64) -> f64 {
    let mean = 2.0 * (1.0 - height / height.hypot(radius)) / (radius * radius);
    FLOOR_RADIANCE * PI / FLOOR_ALBEDO / mean
}

/// Classifies a column by its points' heights in rising order, the whole cloud's height, and the width of a cell.
fn column(heights: &[f64], whole: f64, edge: f64) -> Column {
    let count = heights.len();
    // Some points may float in the gap, and either side of it has more points than noise has.
    let (floating, side) = ((count / 25).max(1), count / 12);
    let gap = |low: &usize| heights[low + floating] - heights[*low];
    let widest = (side..count - side - floating).max_by(|a, b| gap(a).total_cmp(&gap(b)));
    if let Some(low) = widest {
        let above = &heights[low + floating..];
        let layer = above[above.len() * 3 / 4] - above[above.len() / 4];
        let width = gap(&low);
        if width > (whole / 6.0).max(2.0 * edge) && layer < 0.2 * width {
            return Column::Covered(Gap { floor: heights[low], ceiling: heights[low + floating] });
        }
    }
    let is_filled = heights[count - 1 - count / 20] - heights[count / 20] > whole / 4.0;
    if is_filled { Column::Filled } else { Column::Open }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same numbers every time, evenly in 0 to 1.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            // Multiplier and increment of MMIX (Knuth).
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        }

        fn in_box(&mut self, low: [f64; 3], high: [f64; 3]) -> DVec3 {
            let (low, high) = (DVec3::from(low), DVec3::from(high));
            low + (high - low) * DVec3::new(self.next(), self.next(), self.next())
        }
    }

    /// A room of 8 by 5 by 3 metres at coordinates of seven digits, with noise, tables of 0.7 metres and cupboards.
    fn room() -> Vec<DVec3> {
        let mut random = Random(1);
        let mut points = Vec::new();
        for _ in 0..20_000 {
            points.push(random.in_box([0.0, 0.0, -0.01], [8.0, 5.0, 0.01]));
            points.push(random.in_box([0.0, 0.0, 2.99], [8.0, 5.0, 3.01]));
        }
        for _ in 0..10_000 {
            points.push(random.in_box([0.0, 0.0, 0.0], [8.0, 0.01, 3.0]));
            points.push(random.in_box([0.0, 0.0, 0.0], [0.01, 5.0, 3.0]));
            points.push(random.in_box([1.0, 1.0, 0.69], [3.0, 2.0, 0.71]));
            points.push(random.in_box([6.0, 4.4, 0.0], [7.0, 5.0, 2.0]));
        }
        points.into_iter().map(|point| point + DVec3::new(2_635_000.0, 1_248_000.0, 410.0)).collect()
    }

    /// A room of 8 by 6 by 3 metres with a table and a cupboard, seen by a scanner: dense near it, sparse far away.
    fn scanned_room(points: usize) -> Vec<DVec3> {
        let (eye, size) = (DVec3::new(2.9, 2.6, 1.55), DVec3::new(8.0, 6.0, 3.0));
        let furniture = [([5.0, 2.0, 0.0], [6.4, 3.0, 0.75]), ([0.5, 4.8, 0.0], [1.6, 5.6, 2.0])];
        let mut random = Random(7);
        let ray = || {
            let direction = random.in_box([-1.0; 3], [1.0; 3]);
            let direction = (direction.length_squared() <= 1.0).then(|| direction.normalize_or(DVec3::X))?;
            let ends = |low: DVec3, high: DVec3| {
                let [a, b] = [low, high].map(|end| (end - eye) / direction);
                (a.min(b).max_element(), a.max(b).min_element())
            };
            let mut distance = ends(DVec3::ZERO, size).1;
            for (low, high) in furniture {
                let (near, far) = ends(low.into(), high.into());
                distance = if near > 0.0 && near < far { distance.min(near) } else { distance };
            }
            Some(eye + direction * (distance + 0.002 * (random.next() - 0.5)))
        };
        std::iter::repeat_with(ray).flatten().take(points).collect()
    }

    #[test]
    fn one_point_more_moves_neither_the_eye_nor_the_lamp_of_a_room() {
        for (count, chunk_points) in [(20_000, 65_536), (300_000, 65_536)] {
            let points = scanned_room(count);
            let found = |points: &[DVec3]| {
                let chunks: Vec<cloud::Chunk> =
                    points.chunks(chunk_points).map(|places| cloud::Chunk::of_places(0, places)).collect();
                let Surroundings::Room(Room { lamp, eye, pivot, .. }) =
                    Surroundings::of(cloud::spread_sample(&chunks), DVec3::Z)
                else {
                    panic!("no room")
                };
                (lamp, eye, pivot)
            };
            let before = found(&points);
            for index in (0..count).step_by(count / 6 + 1) {
                let near = points[index];
                let beside = near + DVec3::new(0.003, 0.0, 0.0);
                let far = [10.0, 100.0, 1000.0].map(|sizes| DVec3::new(0.6, -0.5, 0.62) * 8.0 * sizes);
                for place in [near, beside].into_iter().chain(far) {
                    let last: Vec<DVec3> = points.iter().copied().chain([place]).collect();
                    let first: Vec<DVec3> = std::iter::once(place).chain(points.iter().copied()).collect();
                    assert_eq!(found(&last), before, "{place} after {count} points");
                    assert_eq!(found(&first), before, "{place} before {count} points");
                }
            }
        }
    }

    fn room_of(points: &[DVec3], up: DVec3) -> Room {
        match Surroundings::of(points.iter().copied(), up) {
            Surroundings::Room(room) => room,
            Surroundings::OpenSky => panic!("a room has no sky"),
        }
    }

    fn is_open(points: &[DVec3]) -> bool {
        Surroundings::of(points.iter().copied(), DVec3::Z) == Surroundings::OpenSky
    }

    #[test]
    fn a_room_gets_a_lamp_under_its_ceiling_that_shines_down_in_its_middle() {
        let Room { lamp, inside, eye, pivot } = room_of(&room(), DVec3::Z);
        assert!(inside.contains(eye) && inside.contains(pivot), "{eye} {pivot}");
        // The longer side is x: one looks along it, from the far half, at eye height.
        let sight = (pivot - eye).normalize();
        assert!(sight.x.abs() > sight.y.abs() && eye.distance(pivot) > 3.0, "{eye} {pivot}");
        assert!((eye.z - inside.min.z - 0.6 * 3.0).abs() < 0.1, "{eye}");
        assert_eq!(lamp.problem(), None);
        assert!(inside.contains(lamp.position) && (inside.size() - DVec3::new(8.0, 5.0, 3.0)).length() < 0.5);
        let at = lamp.position - DVec3::new(2_635_000.0, 1_248_000.0, 410.0);
        assert!((2.0..6.0).contains(&at.x) && (1.0..4.0).contains(&at.y) && (2.5..2.9).contains(&at.z), "{at}");
        let axis = (lamp.target - lamp.position).normalize();
        assert!(axis.distance(-DVec3::Z) < 1e-9, "{axis}");
    }

    #[test]
    fn other_rooms_are_not_inside_of_the_one_that_has_the_lamp() {
        let next_door: Vec<DVec3> = room().into_iter().map(|point| point + 8.01 * DVec3::X).collect();
        let mut points = room();
        points.extend(next_door.into_iter().filter(|point| point.x < 2_635_012.0));
        let Room { lamp, inside, .. } = room_of(&points, DVec3::Z);
        assert!(lamp.position.x < 2_635_008.0 && inside.contains(lamp.position - DVec3::Z));
        assert!((7.0..8.8).contains(&inside.size().x), "{}", inside.size());
    }

    #[test]
    fn what_points_up_may_be_any_axis() {
        let turned: Vec<DVec3> = room().into_iter().map(|point| DVec3::new(point.x, point.z, -point.y)).collect();
        let (lamp, upright) = (room_of(&turned, DVec3::Y).lamp, room_of(&room(), DVec3::Z).lamp);
        assert!((lamp.position.y - upright.position.z).abs() < 0.05);
        assert!((lamp.target - lamp.position).normalize().distance(-DVec3::Y) < 1e-9);
    }

    #[test]
    fn a_lamp_gives_its_floor_the_radiance_it_is_meant_to() {
        let mut random = Random(5);
        for (height, radius) in [(2.7, 0.5), (2.7, 5.4), (50.0, 40.0)] {
            let intensity = intensity(height, radius);
            let samples = 100_000;
            let irradiance = (0..samples).map(|_| {
                let squared = height * height + radius * radius * random.next();
                intensity * height / squared.powf(1.5)
            });
            let radiance = irradiance.sum::<f64>() / f64::from(samples) * FLOOR_ALBEDO / PI;
            assert!((radiance / FLOOR_RADIANCE - 1.0).abs() < 0.02, "{height} {radius}: {radiance}");
        }
    }

    #[test]
    fn hills_with_houses_lie_under_the_sky() {
        let mut random = Random(2);
        let mut points = Vec::new();
        for _ in 0..60_000 {
            let mut point = random.in_box([0.0; 3], [500.0, 400.0, 0.3]);
            point.z += 20.0 * (point.x / 90.0).sin() * (point.y / 70.0).cos();
            // From the air only the roof of a house is visible.
            point.z += if point.x % 60.0 < 15.0 && point.y % 60.0 < 15.0 { 8.0 } else { 0.0 };
            points.push(point);
        }
        assert!(is_open(&points));
    }

    #[test]
    fn a_forest_is_no_room_though_crowns_hang_over_its_floor() {
        let mut random = Random(3);
        let mut points: Vec<DVec3> = (0..30_000).map(|_| random.in_box([0.0; 3], [20.0, 20.0, 0.2])).collect();
        for tree in 0..40 {
            let foot = random.in_box([0.0; 3], [20.0, 20.0, 0.0]);
            for _ in 0..1_500 {
                let offset = random.in_box([-2.5, -2.5, 6.0], [2.5, 2.5, 12.0 + f64::from(tree % 5)]);
                points.push(foot + offset);
            }
            points.extend((0..100).map(|_| foot + random.in_box([-0.15, -0.15, 0.0], [0.15, 0.15, 8.0])));
        }
        assert!(is_open(&points));
    }

    #[test]
    fn the_hull_of_an_object_is_no_room() {
        let mut random = Random(4);
        for radius in [0.1, 1.0, 2.0, 3.0, 5.0, 60.0] {
            let ball: Vec<DVec3> = (0..50_000)
                .map(|_| random.in_box([-1.0; 3], [1.0; 3]).normalize_or(DVec3::Z) * DVec3::new(1.0, 0.7, 1.3) * radius)
                .collect();
            assert!(is_open(&ball), "{radius}");
        }
    }

    #[test]
    fn next_to_nothing_lies_under_the_sky() {
        assert!(is_open(&[]));
        assert!(is_open(&[DVec3::ONE]));
        assert!(is_open(&vec![DVec3::ONE; 1000]));
        let mut random = Random(6);
        let level: Vec<DVec3> = (0..20_000).map(|_| random.in_box([0.0; 3], [2.0, 2.0, 0.03])).collect();
        assert!(is_open(&level), "noise is no ceiling");
        assert!(is_open(&[DVec3::NAN, DVec3::ZERO, DVec3::ONE]));
    }
}
