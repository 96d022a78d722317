//! What a worker thread computes for a cloud: its colours, the histogram, its classes, and the box to frame.

use cloud::{Bounds, Cloud, PointTest};
use glam::DVec3;
use render::ColorPlan;

/// What the figures depend on. When it changes, new figures are requested.
#[derive(Clone, Debug, PartialEq)]
pub struct Basis {
    pub color: scene::Color,
    pub test: PointTest,
    /// How often the number of points has doubled while loading. Figures are renewed at each doubling, not for each
    /// chunk.
    pub doublings: u32,
    pub is_read: bool,
    /// The number of columns that were read after the points.
    pub late_columns: usize,
    /// The number of attributes that all loaded points of a streamed cloud have.
    pub columns: usize,
    /// How often normals and radii have come.
    pub surfels: u32,
    /// How often a view has been fully loaded, for a streamed cloud.
    pub rests: u32,
}

#[derive(Clone, Debug)]
pub struct Figures {
    pub plan: ColorPlan,
    /// The reason why the plan differs from the requested one.
    pub warning: Option<String>,
    /// The number of visible points.
    pub shown: u64,
    /// The histogram of the visible points over this range; empty for colours without a ramp.
    pub histogram: Vec<u32>,
    pub histogram_range: (f64, f64),
    /// The number of points of each class that occurs, in the order of classes; hidden points count too.
    pub classes: Vec<(u8, u64)>,
    /// The same without points that are hidden.
    pub shown_classes: Vec<(u8, u64)>,
    /// The bounds of the visible points, without stray points.
    pub bounds: Bounds,
    /// The points that framing must keep in the picture.
    pub outline: Vec<DVec3>,
    /// The numbers of lone strays and of mixed pixels, if they are known.
    pub strays: Option<[u64; 2]>,
    /// The noise of the points, in world units; `None` until it is measured, then whether there is a surface.
    pub noise: Option<Option<f64>>,
}

/// As many bins as the panel can show.
const HISTOGRAM_BINS: usize = 128;

impl Figures {
    pub fn of(cloud: &Cloud, color: &scene::Color, test: &PointTest, up: DVec3) -> Self {
        let shown = cloud.shown(test);
        let (plan, warning) = ColorPlan::of_shown(cloud, &shown, color, up);
        let (histogram, histogram_range) = plan.histogram(&shown, up, HISTOGRAM_BINS);
        let (bounds, outline) = cloud::robust_extent(&shown.chunks);
        let (shown_classes, classes, strays) = (classes(&shown), classes(cloud), cloud.strays());
        let shown = shown.len();
        Self {
            plan,
            warning,
            shown,
            histogram,
            histogram_range,
            classes,
            shown_classes,
            bounds,
            outline,
            strays,
            noise: None,
        }
    }

    /// Counts the loaded points of a cloud again; colours and bounds stay.
    pub fn recounted(self, cloud: &Cloud, test: &PointTest, up: DVec3) -> Self {
        let points = cloud.shown(test);
        let (histogram, histogram_range) = self.plan.histogram(&points, up, HISTOGRAM_BINS);
        let (shown, shown_classes) = (points.len(), classes(&points));
        let (classes, strays) = (classes(cloud), cloud.strays());
        Self { shown, histogram, histogram_range, classes, shown_classes, strays, ..self }
    }
}

fn classes(cloud: &Cloud) -> Vec<(u8, u64)> {
    let column = cloud.class_column();
    let mut counts = [0_u64; 256];
    for classes in cloud.chunks.iter().filter_map(|chunk| chunk.classes(column)) {
        for class in classes.iter() {
            counts[usize::from(*class)] += 1;
        }
    }
    (0..=255).zip(counts).filter(|(_, count)| *count > 0).collect()
}

/// The share of points below the position `place` (0 ..= 1) of the histogram, and the inverse; the range handles need
/// both. The share grows with the place, so the two functions are inverse to each other up to the width of an empty
/// bin.
pub fn share_below(histogram: &[u32], place: f64) -> f64 {
    let total: u64 = histogram.iter().map(|count| u64::from(*count)).sum();
    if total == 0 {
        return place;
    }
    let at = place.clamp(0.0, 1.0) * histogram.len() as f64;
    let whole = (at as usize).min(histogram.len());
    let below: u64 = histogram[..whole].iter().map(|count| u64::from(*count)).sum();
    let part = histogram.get(whole).map_or(0.0, |count| f64::from(*count) * at.fract());
    (below as f64 + part) / total as f64
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Chunk, Column, ColumnType};

    use super::*;

    #[test]
    fn shares_grow_with_the_place_in_the_histogram() {
        let histogram = [10, 0, 30, 60];
        assert_eq!(share_below(&histogram, 0.0), 0.0);
        assert_eq!(share_below(&histogram, 0.25), 0.1);
        assert_eq!(share_below(&histogram, 0.5), 0.1);
        assert_eq!(share_below(&histogram, 0.625), 0.25);
        assert_eq!(share_below(&histogram, 1.0), 1.0);
        assert_eq!(share_below(&[], 0.3), 0.3);
    }

    #[test]
    fn classes_that_occur_are_counted() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 4]);
        chunk.columns = vec![Some(Arc::new(Column::U8(vec![2, 6, 2, 255])))];
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        assert_eq!(classes(&cloud), [(2, 2), (6, 1), (255, 1)]);
    }

    #[test]
    fn figures_are_of_what_is_shown_but_hidden_classes_are_counted() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, (0..40).map(|at| [at as f32; 3]).collect());
        chunk.columns = vec![Some(Arc::new(Column::U8((0..40).map(|at| if at < 30 { 2 } else { 7 }).collect())))];
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        let color = scene::Color { by: scene::ColorBy::Height, ..scene::Color::default() };
        let of = |hidden_classes: &[u8]| {
            Figures::of(&cloud, &color, &PointTest::hiding(hidden_classes.iter().copied()), DVec3::Z)
        };
        let (all, some, none) = (of(&[]), of(&[7]), of(&[2, 7]));
        assert_eq!((all.bounds.max, some.bounds.max), (DVec3::splat(39.0), DVec3::splat(29.0)));
        assert_eq!((all.plan.full_range.1, some.plan.full_range.1), (39.0, 29.0));
        assert!(none.bounds.is_empty() && none.outline.is_empty());
        assert_eq!(some.classes, [(2, 30), (7, 10)]);
        assert_eq!(some.shown_classes, [(2, 30)]);
        assert_eq!([all.shown, some.shown, none.shown], [40, 30, 0]);
        let again = all.recounted(&cloud, &PointTest::hiding([2]), DVec3::Z);
        assert_eq!((again.histogram.iter().sum::<u32>(), again.shown), (10, 10));
        assert_eq!(again.shown_classes, [(7, 10)]);
    }

    #[test]
    fn a_chosen_colour_stays_where_hidden_classes_leave_one_or_none() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, (0..30).map(|at| [at as f32; 3]).collect());
        let column = |of: fn(usize) -> u8| Some(Arc::new(Column::U8((0..30).map(of).collect())));
        chunk.colors = Some(Arc::new(vec![[200, 100, 50, 255]; 30]));
        chunk.columns = vec![column(|at| [1, 2, 9][at % 3]), column(|at| 5 * [1, 2, 9][at % 3])];
        let attribute = |name: &str| Attribute { name: name.into(), column_type: ColumnType::U8 };
        let attributes = vec![attribute("classification"), attribute("intensity")];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        for label in ["class", "intensity", "RGB"] {
            let mut settings = scene::Settings::default();
            settings.set_text("color.by", &label.to_lowercase()).unwrap();
            let color = settings.color;
            for hidden in [&[][..], &[1], &[1, 9], &[1, 2, 9]] {
                let test = PointTest::hiding(hidden.iter().copied());
                let Figures { plan, warning, .. } = Figures::of(&cloud, &color, &test, DVec3::Z);
                assert_eq!((plan.label.as_str(), warning), (label, None), "{hidden:?}");
                assert!(plan.low < plan.high, "{hidden:?}");
            }
        }
    }

    #[test]
    fn a_scan_of_one_height_is_plain_unless_its_intensity_varies() {
        let label = |intensity: fn(usize) -> u8| {
            let place = |at: usize| [(at % 20) as f32 * 20.0, (at / 20) as f32 * 20.0, 5.0];
            let mut chunk = Chunk::new(0, DVec3::ZERO, (0..400).map(place).collect());
            chunk.columns = vec![Some(Arc::new(Column::U8((0..400).map(intensity).collect())))];
            let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::U8 }];
            let grid = Some(cloud::Grid { scale: DVec3::splat(0.001), offset: DVec3::ZERO, placement: None });
            let cloud = Cloud { attributes, grid, chunks: vec![chunk], ..Cloud::default() };
            Figures::of(&cloud, &scene::Color::default(), &PointTest::default(), DVec3::Z).plan.label
        };
        assert_eq!((label(|_| 0), label(|at| at as u8)), ("plain".into(), "intensity".into()));
    }

    #[test]
    fn automatic_colours_stay_whatever_a_box_leaves() {
        let column = |of: fn(usize) -> u8| vec![Some(Arc::new(Column::U8((0..400).map(of).collect())))];
        let cloud = |width: f32, intensity: fn(usize) -> u8| {
            let place = |at: usize| [(at % 20) as f32 * width / 20.0, (at / 20) as f32 * width / 20.0, (at % 3) as f32];
            let mut chunk = Chunk::new(0, DVec3::ZERO, (0..400).map(place).collect());
            chunk.columns = column(intensity);
            let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::U8 }];
            let grid = Some(cloud::Grid { scale: DVec3::splat(0.001), offset: DVec3::ZERO, placement: None });
            Cloud { attributes, grid, chunks: vec![chunk], ..Cloud::default() }
        };
        // A landscape, a corner of which is as small as a room, and a room, in whose corner all intensities are one.
        let scans = [(400.0, cloud(400.0, |at| at as u8), "height")];
        let scans = scans.into_iter().chain([(10.0, cloud(10.0, |at| (at / 100) as u8), "intensity")]);
        for (width, cloud, label) in scans {
            let size = DVec3::splat(width * 0.2);
            let corner = cloud::Bounds { min: DVec3::splat(-1.0), max: size };
            let clip = scene::Clip::around(scene::ClipShape::Box, corner);
            let inside = PointTest::new([], Vec::new(), vec![clip.volume()]);
            for test in [PointTest::default(), inside] {
                let figures = Figures::of(&cloud, &scene::Color::default(), &test, DVec3::Z);
                assert_eq!(figures.plan.label, label, "{} of {} points", figures.shown, cloud.len());
            }
        }
        // Points without a colour lie elsewhere.
        let mut blank = cloud(10.0, |at| at as u8);
        let color =
            |at: usize| if at < 300 { [at % 20 * 12, at / 20 * 12, 90, 255].map(|part| part as u8) } else { [0; 4] };
        blank.chunks[0].colors = Some(Arc::new((0..400).map(color).collect()));
        let corner = cloud::Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(2.0) };
        let inside = PointTest::new([], Vec::new(), vec![scene::Clip::around(scene::ClipShape::Box, corner).volume()]);
        for test in [PointTest::default(), inside] {
            let plan = Figures::of(&blank, &scene::Color::default(), &test, DVec3::Z).plan;
            assert_eq!(plan.source, render::ColorSource::RgbOr(Some(0)));
        }
    }

    #[test]
    fn whole_numbers_have_bins_of_their_own() {
        let intensities = |most: u16| {
            let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; usize::from(most) + 1]);
            chunk.columns = vec![Some(Arc::new(Column::U16((0..=most).collect())))];
            let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::U16 }];
            let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
            let color = scene::Color { by: scene::ColorBy::Intensity, low: 0.0, high: 1.0, ..scene::Color::default() };
            let figures = Figures::of(&cloud, &color, &PointTest::default(), DVec3::Z);
            let (low, high) = figures.plan.full_range;
            let inside = (0..=most).filter(|value| (low..=high).contains(&f64::from(*value))).count();
            assert_eq!(figures.histogram.iter().sum::<u32>() as usize, inside);
            figures
        };
        let few = intensities(9);
        assert_eq!(few.histogram_range, (few.plan.full_range.0 - 0.5, few.plan.full_range.1 + 0.5));
        assert!(few.histogram.iter().all(|count| *count == 1), "{:?}", few.histogram);
        // Three to a bin, but for the last one.
        let many = intensities(299);
        assert!(many.histogram.len() <= 128 && many.histogram[..99].iter().all(|count| *count == 3));
    }
}
