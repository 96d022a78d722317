//! Tests on the CPU which points are shown; everything that is computed from points asks it. `scene::Visibility` and
//! `scene::Clip` keep and save what is hidden. The GPU reads one bit a point, which is made here
//! (shaders/shared/visibility.wgsl).

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;

use crate::cells::Cells;
use crate::{Attribute, Bounds, Chunk, Cloud, Column, Cover, Grid, ValueRange, Volume, attribute_named, stray_kind};

/// The name of the attribute that classes are.
const CLASSES: &str = "classification";
/// The name of the attribute that every cloud has whose radii mark strays, unless its file has one of this name: the kinds
/// of `stray_kind`.
pub const STRAY: &str = "stray";

/// Decides which points are shown: those that are in no hidden class, whose attributes are in the ranges of all
/// filters, and whose positions the clip volumes keep.
///
/// - A filter of `STRAY` tests the kinds that are known from radii.
/// - A point without a class is never hidden by class, and a cloud without an attribute is not filtered by it. A point
///   without a value (NaN) is in no range, not even in an endless one.
/// - Points are kept that are in at least one of the volumes that keep their inside, if there is any, and in none of
///   those that keep their outside. `within` narrows that down to a part of space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointTest {
    rule: Arc<Rule>,
}

#[derive(Debug, PartialEq)]
struct Rule {
    /// A bit for each class; 1 means shown.
    class_words: [u32; 8],
    filters: Vec<Filter>,
    volumes: Vec<ClipVolume>,
    /// A point is in one of these, too, if there are any.
    within: Vec<Volume>,
    hides_strays: bool,
}

impl Default for Rule {
    fn default() -> Self {
        Self {
            class_words: [u32::MAX; 8],
            filters: Vec::new(),
            volumes: Vec::new(),
            within: Vec::new(),
            hides_strays: false,
        }
    }
}

/// Shows the points whose attribute is in a range, ends included.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    pub attribute: String,
    pub low: f64,
    pub high: f64,
}

/// A volume that keeps the points on one side of its border. The border counts as inside.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipVolume {
    pub volume: Volume,
    pub keeps_inside: bool,
}

/// The larger part of the two.
fn most(a: Cover, b: Cover) -> Cover {
    match (a, b) {
        (Cover::Inside, _) | (_, Cover::Inside) => Cover::Inside,
        (Cover::Partly, _) | (_, Cover::Partly) => Cover::Partly,
        _ => Cover::Outside,
    }
}

impl PointTest {
    pub fn new(hidden: impl IntoIterator<Item = u8>, filters: Vec<Filter>, volumes: Vec<ClipVolume>) -> Self {
        let mut rule = Rule { filters, volumes, ..Rule::default() };
        hidden.into_iter().for_each(|class| rule.class_words[usize::from(class >> 5)] &= !(1 << (class & 31)));
        Self { rule: Arc::new(rule) }
    }

    pub fn hiding(classes: impl IntoIterator<Item = u8>) -> Self {
        Self::new(classes, Vec::new(), Vec::new())
    }

    /// The same test by classes and filters alone, but for filters of `STRAY`: strays are found among the points that are
    /// left.
    pub fn of_attributes(&self) -> Self {
        let Rule { class_words, filters, volumes: _, within: _, hides_strays: _ } = &*self.rule;
        let filters = filters.iter().filter(|filter| filter.attribute != STRAY).cloned().collect();
        let rule = Rule { class_words: *class_words, filters, ..Rule::default() };
        Self { rule: Arc::new(rule) }
    }

    /// The same test, which also hides points that are known to be stray if `hides_strays` is set.
    pub fn hiding_strays(&self, hides_strays: bool) -> Self {
        let Rule { class_words, filters, volumes, within, hides_strays: _ } = &*self.rule;
        let (filters, volumes, within) = (filters.clone(), volumes.clone(), within.clone());
        Self { rule: Arc::new(Rule { class_words: *class_words, filters, volumes, within, hides_strays }) }
    }

    /// The same test, which also hides all points that are in none of some volumes.
    pub fn within(&self, within: Vec<Volume>) -> Self {
        let Rule { class_words, filters, volumes, within: _, hides_strays } = &*self.rule;
        let (class_words, filters, volumes) = (*class_words, filters.clone(), volumes.clone());
        Self { rule: Arc::new(Rule { class_words, filters, volumes, within, hides_strays: *hides_strays }) }
    }

    pub fn shows_all(&self) -> bool {
        *self.rule == Rule::default()
    }

    pub fn shows_class(&self, class: u8) -> bool {
        self.rule.class_words[usize::from(class >> 5)] & (1 << (class & 31)) != 0
    }

    pub fn hides_classes(&self) -> bool {
        self.rule.class_words != [u32::MAX; 8]
    }

    /// Whether classes or filters may hide points.
    pub fn tests_attributes(&self) -> bool {
        self.hides_classes() || !self.rule.filters.is_empty()
    }

    /// For each of a cloud's attributes, whether it is tested.
    pub fn reads(&self, attributes: &[Attribute]) -> Vec<bool> {
        let mut reads = vec![false; attributes.len()];
        let classes = self.hides_classes().then_some(CLASSES);
        let columns = self.filtered().chain(classes).filter_map(|name| attribute_named(attributes, name));
        columns.for_each(|column| reads[column] = true);
        reads
    }

    /// Which of the kinds of `stray_kind` are hidden in a cloud with these attributes.
    pub fn hidden_kinds(&self, attributes: &[Attribute]) -> [bool; 3] {
        let is_known = attribute_named(attributes, STRAY).is_none();
        let of_kinds = || self.rule.filters.iter().filter(|filter| is_known && filter.attribute == STRAY);
        [0, 1, 2].map(|kind| {
            let is_out = of_kinds().any(|filter| !(filter.low..=filter.high).contains(&f64::from(kind)));
            is_out || self.rule.hides_strays && kind > 0
        })
    }

    /// The names in its filters of what a cloud with these attributes lacks.
    pub fn idle_filters<'a>(&'a self, attributes: &[Attribute]) -> impl Iterator<Item = &'a str> {
        self.filtered().filter(|name| attribute_named(attributes, name).is_none())
    }

    /// The names of the attributes that the filters test.
    pub fn filtered(&self) -> impl Iterator<Item = &str> {
        self.rule.filters.iter().map(|filter| filter.attribute.as_str())
    }

    /// How many of the points in a box the clip volumes keep.
    pub fn cover(&self, bounds: Bounds) -> Cover {
        // Whether a volume that keeps its outside hides a part; and how much the fullest of those contains that keep
        // their inside, if there is any.
        let (mut is_cut, mut inside) = (false, None);
        for ClipVolume { volume, keeps_inside } in &self.rule.volumes {
            match (volume.cover(bounds), keeps_inside) {
                (Cover::Inside, false) => return Cover::Outside,
                (cover, false) => is_cut |= cover == Cover::Partly,
                (cover, true) => {
                    inside = match (inside, cover) {
                        (Some(Cover::Inside), _) | (_, Cover::Inside) => Some(Cover::Inside),
                        (Some(Cover::Partly), _) | (_, Cover::Partly) => Some(Cover::Partly),
                        _ => Some(Cover::Outside),
                    };
                }
            }
        }
        let cover = match inside.unwrap_or(Cover::Inside) {
            Cover::Inside if is_cut => Cover::Partly,
            cover => cover,
        };
        let covers = self.rule.within.iter().map(|volume| volume.cover(bounds));
        match (cover, covers.reduce(most)) {
            (Cover::Outside, _) | (_, Some(Cover::Outside)) => Cover::Outside,
            (Cover::Inside, None | Some(Cover::Inside)) => Cover::Inside,
            _ => Cover::Partly,
        }
    }

    fn has_volumes(&self) -> bool {
        !(self.rule.volumes.is_empty() && self.rule.within.is_empty())
    }

    fn keeps(&self, place: DVec3) -> bool {
        let (mut wants, mut is_wanted) = (false, false);
        for ClipVolume { volume, keeps_inside } in &self.rule.volumes {
            if *keeps_inside && is_wanted {
                continue;
            }
            let is_in = volume.contains(place);
            if is_in && !keeps_inside {
                return false;
            }
            wants |= *keeps_inside;
            is_wanted |= is_in && *keeps_inside;
        }
        let within = &self.rule.within;
        (is_wanted || !wants) && (within.is_empty() || within.iter().any(|volume| volume.contains(place)))
    }

    /// The test of the chunks of a cloud.
    pub fn of(&self, layout: &CloudLayout) -> ChunkTest {
        let filters = self.rule.filters.iter().filter_map(|filter| {
            let column = attribute_named(&layout.attributes, &filter.attribute)?;
            Some((column, ValueRange::new(filter.low, filter.high)))
        });
        let (filters, classes) = (filters.collect(), layout.class_column().filter(|_| self.hides_classes()));
        let (hidden_kinds, grid) = (self.hidden_kinds(&layout.attributes), layout.grid);
        ChunkTest { test: self.clone(), classes, filters, hidden_kinds, grid }
    }
}

/// What a test has to know of a cloud besides its chunks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudLayout {
    /// The attributes that the columns of chunks hold, in order.
    pub attributes: Vec<Attribute>,
    /// The grid on which the points lie, if they do.
    pub grid: Option<Grid>,
}

impl CloudLayout {
    /// The index of the column that holds the classes of the points.
    pub fn class_column(&self) -> Option<usize> {
        attribute_named(&self.attributes, CLASSES)
    }
}

/// The test of the points of one cloud.
#[derive(Clone, Debug)]
pub struct ChunkTest {
    test: PointTest,
    /// The column with the classes, if any class is hidden.
    classes: Option<usize>,
    /// Columns and the ranges of their values.
    filters: Vec<(usize, ValueRange)>,
    /// Which kinds of `stray_kind` are hidden.
    hidden_kinds: [bool; 3],
    grid: Option<Grid>,
}

impl ChunkTest {
    /// Whether a point of a chunk is shown. A column that has not been read yet hides nothing.
    pub fn shows(&self, chunk: &Chunk, index: usize) -> bool {
        self.passes(chunk, index) && (!self.test.has_volumes() || self.keeps(chunk, index))
    }

    /// Whether the clip volumes keep a point.
    fn keeps(&self, chunk: &Chunk, index: usize) -> bool {
        self.test.keeps(crate::chunk::world_position(self.grid.as_ref(), chunk, index))
    }

    /// Whether a point is shown as far as clip volumes are not concerned.
    fn passes(&self, chunk: &Chunk, index: usize) -> bool {
        let column = |column: usize| chunk.columns.get(column)?.as_deref();
        let is_hidden = |radii: &Arc<Vec<u16>>| self.hidden_kinds[usize::from(stray_kind(radii[index]))];
        chunk.class(self.classes, index).is_none_or(|class| self.test.shows_class(class))
            && !(self.hidden_kinds != [false; 3] && chunk.radii.as_ref().is_some_and(is_hidden))
            && self
                .filters
                .iter()
                .all(|(filtered, range)| column(*filtered).is_none_or(|column| range.has(column, index)))
    }

    /// Which points of a chunk are shown; `bounds` are those of its points.
    pub fn shown(&self, chunk: &Chunk, bounds: Bounds) -> ShownPoints {
        let tests_columns = self.classes.is_some_and(|column| chunk.columns.get(column).is_some_and(Option::is_some))
            || self.filters.iter().any(|(column, ..)| chunk.columns.get(*column).is_some_and(Option::is_some))
            || self.hidden_kinds != [false; 3] && chunk.radii.is_some();
        let cover = if !self.test.has_volumes() { Cover::Inside } else { self.test.cover(self.widened(chunk, bounds)) };
        match cover {
            Cover::Outside => ShownPoints::None,
            Cover::Inside if !tests_columns => ShownPoints::All,
            Cover::Inside => ShownPoints::of(chunk.len(), |index| self.passes(chunk, index)),
            Cover::Partly => {
                let mut cells = Cells::new(chunk, bounds, |cell| self.test.cover(self.widened(chunk, cell)));
                ShownPoints::of(chunk.len(), |index| {
                    let is_kept = match cells.cover(index) {
                        Cover::Inside => true,
                        Cover::Outside => false,
                        Cover::Partly => self.keeps(chunk, index),
                    };
                    is_kept && (!tests_columns || self.passes(chunk, index))
                })
            }
        }
    }

    /// The bounds of the file's own coordinates, which f32 offsets round.
    fn widened(&self, chunk: &Chunk, bounds: Bounds) -> Bounds {
        if bounds.is_empty() {
            return bounds;
        }
        let reach = (bounds.min - chunk.origin).abs().max((bounds.max - chunk.origin).abs()).max_element();
        let by = self.grid.as_ref().map_or(DVec3::ZERO, Grid::reach) + reach * f64::from(f32::EPSILON);
        Bounds { min: bounds.min - by, max: bounds.max + by }
    }
}

/// Which points of a chunk are shown.
#[derive(Clone, Debug, PartialEq)]
pub enum ShownPoints {
    All,
    None,
    /// Point `i` is shown if bit `i % 32` of word `i / 32` is set.
    Some(Vec<u32>),
}

impl ShownPoints {
    fn of(points: usize, mut shows: impl FnMut(usize) -> bool) -> Self {
        let mut words = vec![0; points.div_ceil(32)];
        (0..points).filter(|index| shows(*index)).for_each(|index| words[index / 32] |= 1 << (index % 32));
        let count: u32 = words.iter().map(|word: &u32| word.count_ones()).sum();
        match count as usize {
            0 => Self::None,
            count if count == points => Self::All,
            _ => Self::Some(words),
        }
    }

    /// Which of `points` points are shown and not left out.
    pub fn besides(self, points: usize, is_left_out: impl Fn(usize) -> bool) -> Self {
        if (0..points).any(&is_left_out) {
            Self::of(points, |index| self.has(index) && !is_left_out(index))
        } else {
            self
        }
    }

    pub fn has(&self, index: usize) -> bool {
        match self {
            Self::All => true,
            Self::None => false,
            Self::Some(words) => words[index / 32] & (1 << (index % 32)) != 0,
        }
    }

    /// The indices of the shown ones among the first `points`.
    pub fn indices(&self, points: usize) -> impl Iterator<Item = usize> {
        (0..points).filter(|index| self.has(*index))
    }
}

impl Chunk {
    /// The classes of the points, if column `index` has been read. Files of other programs have them as floats or wider
    /// integers; what is no class there counts as class 0.
    pub fn classes(&self, index: Option<usize>) -> Option<Cow<'_, [u8]>> {
        Some(match self.columns.get(index?)?.as_deref()? {
            Column::U8(classes) => Cow::Borrowed(classes.as_slice()),
            column => Cow::Owned((0..column.len()).map(|index| class_of(column.value(index)).unwrap_or(0)).collect()),
        })
    }

    /// The class of one point, if it has one.
    fn class(&self, column: Option<usize>, index: usize) -> Option<u8> {
        match self.columns.get(column?)?.as_deref()? {
            Column::U8(classes) => Some(classes[index]),
            column => class_of(column.value(index)),
        }
    }

    /// The points that are shown.
    pub fn shown(&self, test: &ChunkTest) -> Self {
        match test.shown(self, self.bounds()) {
            ShownPoints::All => self.clone(),
            shown => self.select(&shown.indices(self.len()).map(|index| index as u32).collect::<Vec<_>>()),
        }
    }
}

/// The class that a number stands for.
fn class_of(value: f64) -> Option<u8> {
    (value.fract() == 0.0 && (0.0..256.0).contains(&value)).then_some(value as u8)
}

impl Cloud {
    /// The index of the column that holds the classes of the points.
    pub fn class_column(&self) -> Option<usize> {
        self.column_of("classification")
    }

    pub fn layout(&self) -> CloudLayout {
        CloudLayout { attributes: self.attributes.clone(), grid: self.grid }
    }

    /// The test of its points.
    pub fn test(&self, test: &PointTest) -> ChunkTest {
        test.of(&self.layout())
    }

    /// The columns that a test reads and some chunk lacks.
    pub fn lacks(&self, test: &PointTest) -> Vec<usize> {
        let lacks =
            |column: &usize| self.chunks.iter().any(|chunk| chunk.columns.get(*column).is_none_or(Option::is_none));
        let columns: BTreeSet<usize> = test.filtered().filter_map(|name| self.column_of(name)).collect();
        columns.into_iter().filter(lacks).collect()
    }

    /// The points that are shown, in chunks of which none is empty.
    pub fn shown(&self, test: &PointTest) -> Self {
        let test = (!test.shows_all()).then(|| self.test(test));
        let shown = |chunk: &Chunk| test.as_ref().map_or_else(|| chunk.clone(), |test| chunk.shown(test));
        let chunks = self.chunks.iter().map(shown).filter(|chunk| !chunk.is_empty()).collect();
        Self { name: self.name.clone(), attributes: self.attributes.clone(), grid: self.grid, chunks }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::{ColumnType, VolumeShape};

    #[test]
    fn classes_are_hidden_where_other_programs_have_them_as_floats() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 5]);
        chunk.columns = vec![Some(Arc::new(Column::F32(vec![2.0, 7.0, 7.5, 300.0, f32::NAN])))];
        let attributes = vec![Attribute { name: "scalar_Classification".into(), column_type: ColumnType::F32 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        assert_eq!(cloud.chunks[0].classes(cloud.class_column()).as_deref(), Some(&[2, 7, 0, 0, 0][..]));
        assert_eq!(cloud.shown(&PointTest::hiding([7])).len(), 4);
        assert_eq!(cloud.shown(&PointTest::hiding([0, 7])).len(), 4, "what is no class is not hidden");
    }

    #[test]
    fn strays_are_counted_and_hidden_where_they_are_known() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3], [2.0; 3]]);
        let cloud = |chunk: &Chunk| Cloud { chunks: vec![chunk.clone()], ..Cloud::default() };
        let hiding = PointTest::default().hiding_strays(true);
        assert!(!hiding.shows_all() && hiding.of_attributes().shows_all() && hiding.hiding_strays(false).shows_all());
        assert_eq!((cloud(&chunk).strays(), cloud(&chunk).shown(&hiding).len()), (None, 3));
        chunk.radii = Some(Arc::new(vec![500, crate::STRAY_RADIUS, crate::NO_RADIUS]));
        assert_eq!((cloud(&chunk).strays(), cloud(&chunk).shown(&PointTest::default()).len()), (Some([1, 0]), 3));
        assert_eq!(cloud(&chunk).shown(&hiding).chunks[0].positions[..], [[0.0; 3], [2.0; 3]]);
        chunk.radii = Some(Arc::new(vec![500, crate::STRAY_RADIUS, crate::MIXED_RADIUS]));
        assert_eq!((cloud(&chunk).strays(), cloud(&chunk).shown(&hiding).len()), (Some([1, 1]), 1));
    }

    #[test]
    fn filters_of_strays_test_what_radii_tell_unless_a_file_has_an_attribute_of_this_name() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3], [2.0; 3]]);
        let cloud = |chunk: &Chunk| Cloud { chunks: vec![chunk.clone()], ..Cloud::default() };
        let test =
            |low: f64, high: f64| PointTest::new([], vec![Filter { attribute: STRAY.into(), low, high }], Vec::new());
        assert_eq!(cloud(&chunk).shown(&test(1.0, 2.0)).len(), 3, "nobody has looked yet");
        assert!(test(0.0, 0.0).tests_attributes() && test(0.0, 0.0).of_attributes().shows_all());
        chunk.radii = Some(Arc::new(vec![500, crate::STRAY_RADIUS, crate::MIXED_RADIUS]));
        for (low, high, expected) in
            [(0.0, 0.0, vec![0]), (0.0, 1.0, vec![0, 1]), (1.0, 2.0, vec![1, 2]), (3.0, 9.0, vec![])]
        {
            let shown = cloud(&chunk).shown(&test(low, high)).chunks;
            let places: Vec<i32> =
                shown.iter().flat_map(|chunk| chunk.positions.iter().map(|at| at[0] as i32)).collect();
            assert_eq!(places, expected, "{low} to {high}");
        }
        chunk.columns = vec![Some(Arc::new(Column::U8(vec![0, 0, 7])))];
        let attributes = vec![Attribute { name: STRAY.into(), column_type: ColumnType::U8 }];
        let own = Cloud { attributes, ..cloud(&chunk) };
        assert_eq!((own.shown(&test(0.0, 0.0)).len(), own.shown(&test(7.0, 7.0)).len()), (2, 1));
    }

    #[test]
    fn a_point_without_a_value_is_in_no_range() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 4]);
        chunk.columns = vec![Some(Arc::new(Column::F32(vec![-1.0, f32::NAN, 5.0, f32::INFINITY])))];
        let attributes = vec![Attribute { name: "height".into(), column_type: ColumnType::F32 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        let shown = |low: f64, high: f64| {
            let filter = Filter { attribute: "height".into(), low, high };
            let test = PointTest::new([], vec![filter], Vec::new());
            assert!(test.tests_attributes() && test.idle_filters(&cloud.attributes).next().is_none());
            assert_eq!((test.reads(&cloud.attributes), test.idle_filters(&[]).collect()), (vec![true], vec!["height"]));
            cloud.shown(&test).len()
        };
        assert_eq!((shown(f64::NEG_INFINITY, f64::INFINITY), shown(-2.0, f64::INFINITY), shown(0.0, 9.0)), (3, 3, 1));
        assert!(PointTest::hiding([7]).tests_attributes() && !PointTest::default().tests_attributes());
        assert_eq!(PointTest::hiding([7]).reads(&cloud.attributes), [false]);
    }

    #[test]
    fn points_outside_of_a_part_of_space_are_hidden_besides_what_else_is() {
        let slab = |x: f64, size: f64| {
            let rotation = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
            Volume::new(VolumeShape::Slab, DVec3::X * x, rotation, DVec3::splat(size))
        };
        // A little thicker than whole numbers, so that no point and no bounds end at a border, which rounding may move.
        let clip = ClipVolume { volume: slab(2.0, 3.01), keeps_inside: true };
        let test = PointTest::new([], Vec::new(), vec![clip]).within(vec![slab(0.0, 2.01), slab(5.0, 4.01)]);
        let chunk = Chunk::new(0, DVec3::ZERO, (-2..8).map(|x| [x as f32, 0.0, 0.0]).collect());
        let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
        let shown = cloud.shown(&test.hiding_strays(true));
        // The clip volume shows 1 to 3, and of these 2 is in neither part.
        assert_eq!(shown.chunks[0].positions[..], [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
        assert_eq!(cloud.shown(&test.of_attributes()).len(), 10);
        for low in -2..7 {
            let x = f64::from(low);
            let of = |test: &PointTest| test.cover(Bounds { min: DVec3::X * x, max: DVec3::new(x + 0.5, 0.0, 0.0) });
            let inside = |x: f64| (0.5..=3.5).contains(&x) && (x <= 1.0 || x >= 3.0);
            let expected = match (inside(x), inside(x + 0.5)) {
                (true, true) => Cover::Inside,
                (false, false) => Cover::Outside,
                _ => Cover::Partly,
            };
            assert_eq!(of(&test), expected, "{x}");
        }
    }

    #[test]
    fn every_class_is_told_from_every_other() {
        for hidden in 0..=255 {
            let test = PointTest::hiding([hidden]);
            assert!((0..=255).all(|class| test.shows_class(class) == (class != hidden)), "{hidden}");
            assert!(!test.shows_all());
        }
        assert!(PointTest::hiding([]).shows_all());
    }

    #[test]
    fn a_cloud_shows_the_points_of_other_classes_and_all_points_without_a_class() {
        let chunk = |column| {
            let mut chunk = Chunk::new(0, DVec3::ZERO, (0..4).map(|at| [at as f32; 3]).collect());
            chunk.columns = vec![Some(Arc::new(column))];
            chunk
        };
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let chunks =
            vec![chunk(Column::U8(vec![2, 6, 2, 7])), chunk(Column::U8(vec![7; 4])), chunk(Column::F32(vec![7.5; 4]))];
        let cloud = Cloud { attributes, chunks, ..Cloud::default() };
        let shown = cloud.shown(&PointTest::hiding([6, 7]));
        assert_eq!(shown.chunks.iter().map(Chunk::len).collect::<Vec<_>>(), [2, 4], "none is empty");
        assert_eq!(*shown.chunks[0].positions, [[0.0; 3], [2.0; 3]]);
        assert_eq!(cloud.shown(&PointTest::default()).len(), 12);
        let unnamed = Cloud { attributes: Vec::new(), ..cloud };
        assert_eq!(unnamed.shown(&PointTest::hiding([2, 6, 7])).len(), 12);
    }

    /// Points on a line, with an attribute.
    fn line(values: Vec<f32>) -> Cloud {
        let mut chunk = Chunk::new(0, DVec3::X * 5e5, (0..values.len()).map(|at| [at as f32, 0.0, 0.0]).collect());
        chunk.columns = vec![Some(Arc::new(Column::F32(values)))];
        let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::F32 }];
        Cloud { attributes, chunks: vec![chunk], ..Cloud::default() }
    }

    fn places(cloud: &Cloud) -> Vec<f64> {
        let place = |chunk: &Chunk| (0..chunk.len()).map(|i| chunk.position(i).x - 5e5).collect::<Vec<_>>();
        cloud.chunks.iter().flat_map(place).collect()
    }

    #[test]
    fn filters_show_what_is_in_all_ranges_and_what_lacks_the_attribute() {
        let cloud = line(vec![1.0, 2.0, f32::NAN, 3.0, f32::INFINITY]);
        let filter = |attribute: &str, low, high| Filter { attribute: attribute.into(), low, high };
        let shown = |filters| places(&cloud.shown(&PointTest::new([], filters, Vec::new())));
        assert_eq!(shown(vec![filter("intensity", 2.0, 3.0)]), [1.0, 3.0]);
        assert_eq!(shown(vec![filter("intensity", 2.0, 9.0), filter("intensity", 0.0, 2.0)]), [1.0]);
        assert_eq!(shown(vec![filter("intensity", f64::NEG_INFINITY, f64::INFINITY)]), [0.0, 1.0, 3.0, 4.0]);
        assert_eq!(shown(vec![filter("amplitude", 2.0, 3.0)]).len(), 5, "no point has it");
        assert_eq!(shown(vec![filter("intensity", 7.0, 8.0)]).len(), 0);
        let of_intensity =
            PointTest::new([], vec![filter("amplitude", 2.0, 3.0), filter("intensity", 2.0, 3.0)], Vec::new());
        assert_eq!(cloud.lacks(&of_intensity), [0; 0]);
        let mut unread = cloud.clone();
        unread.chunks[0].columns[0] = None;
        assert_eq!(unread.lacks(&of_intensity), [0]);
        assert_eq!(unread.shown(&PointTest::new([], vec![filter("intensity", 2.0, 3.0)], Vec::new())).len(), 5);
    }

    #[test]
    fn points_are_kept_in_any_inside_and_in_no_outside() {
        let cloud = line(vec![0.0; 20]);
        let slab = |middle: f64, width: f64, keeps_inside| {
            let (at, size) = (DVec3::new(5e5 + middle, 0.0, 0.0), DVec3::new(width, 1.0, 1.0));
            ClipVolume { volume: Volume::new(VolumeShape::Box, at, DQuat::IDENTITY, size), keeps_inside }
        };
        let shown = |volumes: &[ClipVolume]| {
            let test = PointTest::new([], Vec::new(), volumes.to_vec());
            let chunk = &cloud.chunks[0];
            let one_by_one = cloud.test(&test);
            let places = places(&cloud.shown(&test));
            assert_eq!((0..20).filter(|i| one_by_one.shows(chunk, *i)).map(|i| i as f64).collect::<Vec<_>>(), places);
            places
        };
        assert_eq!(shown(&[slab(3.0, 4.0, true)]), [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(shown(&[slab(3.0, 4.0, true), slab(10.0, 2.0, true)]), [1.0, 2.0, 3.0, 4.0, 5.0, 9.0, 10.0, 11.0]);
        assert_eq!(shown(&[slab(3.0, 4.0, true), slab(4.0, 2.0, false)]), [1.0, 2.0]);
        assert_eq!(shown(&[slab(10.0, 18.0, false)]), [0.0]);
        assert_eq!(shown(&[slab(10.0, 90.0, false)]), [0.0; 0]);
        assert_eq!(shown(&[slab(90.0, 9.0, true)]), [0.0; 0]);
        assert_eq!(shown(&[slab(90.0, 9.0, false)]).len(), 20);
        assert_eq!(shown(&[slab(10.0, 90.0, true), slab(90.0, 9.0, true)]).len(), 20);
    }

    #[test]
    fn what_is_kept_of_a_box_is_kept_of_every_point_in_it() {
        let mut drawn = 0;
        let mut unit = || {
            drawn += 1;
            crate::random::unit(5, drawn)
        };
        let mut seen = [0; 3];
        for _ in 0..3000 {
            let volumes = [true, false, true].map(|keeps_inside| {
                let at = DVec3::new(unit(), unit(), unit()) * 4.0;
                let turn = DQuat::from_xyzw(unit(), unit(), unit(), 0.5).normalize();
                let shape = if unit() < 0.5 { VolumeShape::Box } else { VolumeShape::Sphere };
                ClipVolume { volume: Volume::new(shape, at, turn, DVec3::splat(1.0 + 3.0 * unit())), keeps_inside }
            });
            let test = PointTest::new([], Vec::new(), volumes.to_vec());
            let corner = DVec3::new(unit(), unit(), unit()) * 4.0;
            let bounds = Bounds { min: corner, max: corner + unit() * 0.8 };
            let cover = test.cover(bounds);
            seen[cover as usize] += 1;
            for place in bounds.corners() {
                match cover {
                    Cover::Inside => assert!(test.keeps(place)),
                    Cover::Outside => assert!(!test.keeps(place)),
                    Cover::Partly => {}
                }
            }
        }
        assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
    }

    #[test]
    fn a_chunk_shows_what_its_points_show_one_by_one() {
        let mut drawn = 0;
        let mut unit = || {
            drawn += 1;
            crate::random::unit(8, drawn)
        };
        let mut cut = 0;
        for round in 0..300 {
            let volumes = [true, false, true].map(|keeps_inside| {
                let at = DVec3::new(5e5, -4e6, 100.0) + DVec3::new(unit(), unit(), unit()) * 4.0;
                let turn = DQuat::from_xyzw(unit(), unit(), unit(), 0.5).normalize();
                let l = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.0], [0.0, 0.0], [0.0, 0.5], [-0.5, 0.5]];
                let points = l.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
                let prism = VolumeShape::Prism { points, direction: DVec3::Z, eye: None };
                let shape = match (4.0 * unit()) as u32 {
                    0 => VolumeShape::Box,
                    1 => VolumeShape::Sphere,
                    2 => VolumeShape::Slab,
                    _ => prism,
                };
                ClipVolume { volume: Volume::new(shape, at, turn, DVec3::splat(1.0 + 3.0 * unit())), keeps_inside }
            });
            let test = PointTest::new([3], Vec::new(), volumes.to_vec());
            // Flat ones, and ones whose offsets are rounded to more than a cell's width.
            let (flat, far) = (round % 3 == 0, if round % 5 == 0 { 1e6 } else { 0.0 });
            let origin = DVec3::new(5e5 + far, -4e6, 100.0);
            let mut place = || {
                let [x, y, z] = [unit() * 4.0, unit() * 4.0, if flat { 2.0 } else { unit() * 4.0 }];
                [(x - far) as f32, y as f32, z as f32]
            };
            let mut positions: Vec<[f32; 3]> = (0..400).map(|_| place()).collect();
            positions.push([f32::NAN, 1.0, 1.0]);
            let mut chunk = Chunk::new(0, origin, positions);
            chunk.columns = vec![Some(Arc::new(Column::U8((0..401).map(|at| (at % 5) as u8).collect())))];
            let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
            let grid = (round % 2 == 0).then(|| Grid::new(DVec3::splat(0.001), DVec3::ZERO));
            let cloud = Cloud { grid, attributes, chunks: vec![chunk], ..Cloud::default() };
            let one_by_one = cloud.test(&test);
            let chunk = &cloud.chunks[0];
            let shown = one_by_one.shown(chunk, chunk.bounds());
            let expected: Vec<usize> = (0..401).filter(|index| one_by_one.shows(chunk, *index)).collect();
            assert_eq!(shown.indices(401).collect::<Vec<_>>(), expected, "{round}");
            cut += usize::from(matches!(shown, ShownPoints::Some(_)));
        }
        assert!(cut > 100, "{cut}");
    }

    #[test]
    fn a_border_holds_the_file_s_own_coordinates() {
        // A millimetre grid, and offsets that f32 rounds to either side.
        let grid = Grid::new(DVec3::splat(0.001), DVec3::ZERO);
        let (origin, border) = (DVec3::X * 300.7, 333.333);
        for steps in [-1_i32, 0, 1] {
            let x = f64::from(333_333 + steps) * 0.001;
            let chunk = Chunk::new(0, origin, vec![[(x - origin.x) as f32, 0.0, 0.0]]);
            assert!(steps != 0 || chunk.position(0).x != x, "the f32 offset alone is exact: the test proves nothing");
            let cloud = Cloud { grid: Some(grid), chunks: vec![chunk], ..Cloud::default() };
            let size = DVec3::new(2.0 * border, 1.0, 1.0);
            let volume = Volume::new(VolumeShape::Box, DVec3::ZERO, DQuat::IDENTITY, size);
            let test = PointTest::new([], Vec::new(), vec![ClipVolume { volume, keeps_inside: true }]);
            assert_eq!(cloud.shown(&test).len(), u64::from(steps <= 0), "{steps}");
        }
    }
}
