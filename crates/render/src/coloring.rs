//! Interprets the `color.*` parameters for a cloud: the source of the colour, the range of values, and the ramps.

use std::sync::{Arc, LazyLock};

use cloud::{
    Chunk, Cloud, ColorCount, Column, STRAY, SURFACE_ERROR, Scalar, constant, histogram, percentile_range, value_range,
};
use glam::DVec3;
use param::Choice as _;

use scene::{Blank, Color, ColorBy, Ramp};

use crate::layout;

/// The source of a point's colour. The shaders know it as `COLOR_*`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorSource {
    Plain,
    Rgb,
    /// RGB where a point has it; else the grey of a column of `Cloud::attributes`, or the plain colour.
    RgbOr(Option<usize>),
    Normal,
    Class,
    /// What keeps a point from being on a surface (`cloud::stray_kind`).
    Stray,
    /// The coordinate along the axis that points up.
    Height,
    /// The index in `Cloud::attributes`.
    Column(usize),
}

impl ColorSource {
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Plain => layout::COLOR_PLAIN,
            Self::Rgb => layout::COLOR_RGB,
            Self::RgbOr(None) => layout::COLOR_RGB_OR_PLAIN,
            Self::RgbOr(Some(_)) => layout::COLOR_RGB_OR_GREY,
            Self::Normal => layout::COLOR_NORMAL,
            Self::Class => layout::COLOR_CLASS,
            Self::Stray => layout::COLOR_STRAY,
            Self::Height => layout::COLOR_HEIGHT,
            Self::Column(_) => layout::COLOR_SCALAR,
        }
    }

    /// The column whose values are needed to colour points.
    pub fn column(self) -> Option<usize> {
        match self {
            Self::Column(index) => Some(index),
            Self::RgbOr(grey) => grey,
            _ => None,
        }
    }
}

/// How one cloud is coloured.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorPlan {
    pub source: ColorSource,
    /// The name of the source for people: `RGB`, `height`, `intensity`, an attribute's name.
    pub label: String,
    pub ramp: Ramp,
    /// The sRGB colour of points without another.
    pub plain: [u8; 4],
    /// The values at the ramp's ends (for heights: the world coordinate along the up axis).
    pub low: f64,
    pub high: f64,
    /// The range of all values but the most extreme thousandth at each end, which a histogram should span.
    pub full_range: (f64, f64),
}

impl ColorPlan {
    /// Resolves `auto`, and falls back to it, with a warning, if a cloud lacks what the setting asks for. `up` decides
    /// along which axis heights are measured.
    pub fn new(cloud: &Cloud, color: &Color, up: DVec3) -> (Self, Option<String>) {
        Self::of_shown(cloud, cloud, color, up)
    }

    /// The same where only a part of a cloud is shown. The whole decides about the source of the colour, so that it stays
    /// whatever is hidden; the ends of the ramp go by what is shown.
    pub fn of_shown(cloud: &Cloud, shown: &Cloud, color: &Color, up: DVec3) -> (Self, Option<String>) {
        let has_colors = cloud.chunks.iter().any(|chunk| chunk.colors.is_some());
        let mut warning = None;
        let mut lacks = |what: String| {
            warning = Some(format!("{}: no {what}; colouring is automatic", cloud.name));
            None
        };
        let wanted = match color.by {
            ColorBy::Auto => None,
            ColorBy::Plain => Some(ColorSource::Plain),
            ColorBy::Normal => Some(ColorSource::Normal),
            ColorBy::Height => Some(ColorSource::Height),
            ColorBy::Stray => Some(ColorSource::Stray),
            ColorBy::Rgb if has_colors => Some(ColorSource::Rgb),
            ColorBy::Rgb => lacks("RGB colours".into()),
            ColorBy::Class => {
                cloud.class_column().map_or_else(|| lacks("classification".into()), |_| Some(ColorSource::Class))
            }
            ColorBy::Attribute => cloud.column_of(&color.attribute).map_or_else(
                || {
                    if color.attribute == STRAY {
                        return Some(ColorSource::Stray);
                    }
                    let known = cloud.attributes.iter().map(|attribute| attribute.name.as_str());
                    let hint = param::nearest(&color.attribute, known).map(|near| format!(" (did you mean `{near}`?)"));
                    lacks(format!("attribute `{}`{}", color.attribute, hint.unwrap_or_default()))
                },
                |index| Some(ColorSource::Column(index)),
            ),
            // A file may have an attribute of that name, which stands before the program's own.
            ColorBy::Certainty => cloud.attributes.iter().rposition(|known| known.name == SURFACE_ERROR).map_or_else(
                || lacks("certainty, which only clouds in memory have".into()),
                |index| Some(ColorSource::Column(index)),
            ),
            ColorBy::Intensity | ColorBy::ReturnNumber | ColorBy::GpsTime => {
                let name = color.asked_attribute().unwrap_or_default();
                cloud.column_of(name).map_or_else(|| lacks(name.into()), |index| Some(ColorSource::Column(index)))
            }
        };
        let wanted = wanted.filter(|source| {
            let constant = constant_of(cloud, *source, up);
            if let Some((what, value)) = constant {
                warning = Some(format!("{}: {what} is {value} everywhere; colouring is automatic", cloud.name));
            }
            let is_empty = is_empty(cloud, *source);
            if is_empty {
                let name = source.column().map_or("", |index| cloud.attributes[index].name.as_str());
                warning = Some(format!("{}: no point has a value of {name}; colouring is automatic", cloud.name));
            }
            constant.is_none() && !is_empty
        });
        let intensity = cloud.column_of("intensity");
        let source = match wanted.unwrap_or_else(|| automatic(cloud, has_colors, intensity, up)) {
            ColorSource::Rgb if color.blank == Blank::Auto && has_blanks(cloud) => {
                // The floats that meshes and reconstructions call intensity are rarely brightness.
                let is_brightness = |index: &usize| cloud.grid.is_some() && varies(cloud, *index);
                ColorSource::RgbOr(intensity.filter(is_brightness))
            }
            source => source,
        };
        let range =
            |low, high| scalar_of(source, up).and_then(|scalar| percentile_range(&shown.chunks, scalar, low, high));
        let is_wide = |(low, high): &(f64, f64)| low < high;
        // Where few points differ from all others, the percentiles are one value, and the ramp would show none of them.
        let all_of = |cloud: &Cloud| scalar_of(source, up).and_then(|scalar| value_range(&cloud.chunks, scalar));
        let all = || all_of(shown).filter(is_wide).or_else(|| all_of(cloud)).unwrap_or((0.0, 1.0));
        let full_range = range(0.001, 0.999).filter(is_wide).unwrap_or_else(all);
        let [least, most] = [color.low.min(color.high), color.low.max(color.high)].map(f64::from);
        let (low, high) = range(least, most).filter(is_wide).unwrap_or(full_range);
        let is_verdict = source.column().is_some_and(|index| is_verdict(&cloud.attributes[index].name));
        let (ramp, low, high) = if is_verdict { (Ramp::Marks, 0.0, 2.0) } else { (color.ramp, low, high) };
        let label = match source {
            ColorSource::Plain => "plain".into(),
            ColorSource::Rgb | ColorSource::RgbOr(_) => "RGB".into(),
            ColorSource::Normal => "normal".into(),
            ColorSource::Class => "class".into(),
            ColorSource::Stray => STRAY.into(),
            ColorSource::Height => "height".into(),
            ColorSource::Column(index) => cloud.attributes[index].name.clone(),
        };
        (Self { source, label, ramp, plain: color.plain.bytes(), low, high, full_range }, warning)
    }

    /// The column that must be read before the plan can be shown, if any chunk lacks it.
    pub fn missing_column(&self, cloud: &Cloud) -> Option<usize> {
        let index = match self.source {
            ColorSource::Class => cloud.class_column()?,
            source => source.column()?,
        };
        let lacking = cloud.chunks.iter().any(|chunk| chunk.columns.get(index).is_none_or(Option::is_none));
        lacking.then_some(index)
    }

    /// The number of points in each of at most `bins` equal parts of a range, and that range; empty for colours without
    /// a ramp. The range is the full one. Of whole numbers, each part holds as many as every other, and the range is
    /// half a step wider at both ends.
    pub fn histogram(&self, cloud: &Cloud, up: DVec3, bins: usize) -> (Vec<u32>, (f64, f64)) {
        let on_ramp = scalar_of(self.source, up).filter(|_| !matches!(self.source, ColorSource::RgbOr(_)));
        let Some(scalar) = on_ramp else { return (Vec::new(), self.full_range) };
        let (low, high) = self.full_range;
        let is_whole = match self.source {
            ColorSource::Column(index) => cloud.attributes.get(index).is_some_and(|known| known.column_type.is_whole()),
            _ => false,
        };
        let (range, bins) = if is_whole && high >= low {
            let numbers = high - low + 1.0;
            let step = (numbers / bins.max(1) as f64).ceil().max(1.0);
            let bins = (numbers / step).ceil();
            ((low - 0.5, low - 0.5 + bins * step), bins as usize)
        } else {
            (self.full_range, bins)
        };
        (histogram(&cloud.chunks, scalar, range, bins), range)
    }
}

/// The attribute that says what a point is: 0 real, 1 a ghost that was seen in a mirror, 2 undecided. Its values are
/// kinds, each of which has its colour on the ramp of marks.
pub const VERDICT: &str = "ghost";

/// Whether an attribute is the verdict, or one with a number that a file has beside another.
fn is_verdict(name: &str) -> bool {
    let number = name.strip_prefix(VERDICT).map(|rest| rest.strip_prefix('_').unwrap_or(rest));
    number.is_some_and(|number| number.chars().all(|digit| digit.is_ascii_digit()))
}

/// The name and the value of what would colour all points alike. `None` if it varies, or is not loaded.
fn constant_of(cloud: &Cloud, source: ColorSource, up: DVec3) -> Option<(&str, f64)> {
    let (scalar, name) = match source {
        ColorSource::Class => (Scalar::Column(cloud.class_column()?), "classification"),
        ColorSource::Column(index) => (Scalar::Column(index), cloud.attributes[index].name.as_str()),
        ColorSource::Height => (Scalar::Axis(up_axis(up)), "height"),
        _ => return None,
    };
    Some((name, constant(&cloud.chunks, scalar)?))
}

/// Whether a column is loaded and none of the points has a value in it.
fn is_empty(cloud: &Cloud, source: ColorSource) -> bool {
    let ColorSource::Column(index) = source else { return false };
    let column = |chunk: &Chunk| chunk.columns.get(index).cloned().flatten();
    let mut chunks = cloud.chunks.iter().filter(|chunk| !chunk.is_empty()).peekable();
    let has_none = |column: Arc<Column>| (0..column.len()).all(|point| column.value(point).is_nan());
    chunks.peek().is_some() && chunks.all(|chunk| column(chunk).is_some_and(has_none))
}

/// RGB if the cloud has it. A survey (scaled integer coordinates) without RGB shows its height if it is a landscape,
/// else its intensity, if that varies. Where all of its points have one height, height is no choice. Any other cloud is
/// plain: the floats that meshes and reconstructions call intensity are rarely brightness.
fn automatic(cloud: &Cloud, has_colors: bool, intensity: Option<usize>, up: DVec3) -> ColorSource {
    if has_colors {
        return ColorSource::Rgb;
    }
    if cloud.grid.is_none() {
        return ColorSource::Plain;
    }
    let is_level = constant_of(cloud, ColorSource::Height, up).is_some();
    if !is_level && is_landscape(cloud, up) {
        return ColorSource::Height;
    }
    let otherwise = if is_level { ColorSource::Plain } else { ColorSource::Height };
    intensity.filter(|index| varies(cloud, *index)).map_or(otherwise, ColorSource::Column)
}

/// Whether the values of a column differ, but for a few points.
fn varies(cloud: &Cloud, column: usize) -> bool {
    percentile_range(&cloud.chunks, Scalar::Column(column), 0.01, 0.99).is_some_and(|(low, high)| high > low)
}

/// Whether some points of a cloud with colours have none.
fn has_blanks(cloud: &Cloud) -> bool {
    let mut count = ColorCount::default();
    cloud.chunks.iter().filter_map(|chunk| chunk.colors.as_ref()).for_each(|colors| count.add(colors));
    count.blanks() > 0
}

/// The width in file units, mostly metres or feet, above which a cloud is no building.
const WIDER_THAN_BUILDINGS: f64 = 100.0;
/// How many times as wide as high a landscape is at least.
const FLATNESS: f64 = 3.0;

/// Whether a scan was most likely taken from the air: it is wide, and much wider than high. Stray points do not count.
fn is_landscape(cloud: &Cloud, up: DVec3) -> bool {
    let up = up_axis(up);
    let extent = |axis: usize| {
        percentile_range(&cloud.chunks, Scalar::Axis(axis), 0.01, 0.99).map_or(0.0, |(low, high)| high - low)
    };
    let width = [0, 1, 2].into_iter().filter(|axis| *axis != up).map(extent).fold(f64::INFINITY, f64::min);
    width > WIDER_THAN_BUILDINGS && width > FLATNESS * extent(up)
}

pub(crate) fn up_axis(up: DVec3) -> usize {
    up.abs().max_position()
}

fn scalar_of(source: ColorSource, up: DVec3) -> Option<Scalar> {
    match source {
        ColorSource::Height => Some(Scalar::Axis(up_axis(up))),
        source => source.column().map(Scalar::Column),
    }
}

/// The control points of the ramps, evenly spaced, sRGB: nine samples of the published tables (turbo: Mikhailov 2019;
/// viridis and magma: van der Walt and Smith 2015; spectral: ColorBrewer), linear in between.
fn control_points(ramp: Ramp) -> &'static [[u8; 3]] {
    match ramp {
        Ramp::Turbo => &[
            [48, 18, 59],
            [70, 107, 227],
            [40, 187, 236],
            [49, 242, 153],
            [162, 252, 60],
            [237, 208, 58],
            [251, 128, 34],
            [210, 49, 5],
            [122, 4, 3],
        ],
        Ramp::Viridis => &[
            [68, 1, 84],
            [71, 44, 122],
            [59, 81, 139],
            [44, 113, 142],
            [33, 144, 141],
            [39, 173, 129],
            [92, 200, 99],
            [170, 220, 50],
            [253, 231, 37],
        ],
        Ramp::Magma => &[
            [0, 0, 4],
            [28, 16, 68],
            [79, 18, 123],
            [129, 37, 129],
            [181, 54, 122],
            [229, 80, 100],
            [251, 135, 97],
            [254, 194, 135],
            [252, 253, 191],
        ],
        Ramp::Gray => &[[0, 0, 0], [255, 255, 255]],
        Ramp::Spectral => &[
            [94, 79, 162],
            [50, 136, 189],
            [102, 194, 165],
            [171, 221, 164],
            [230, 245, 152],
            [254, 224, 139],
            [253, 174, 97],
            [244, 109, 67],
            [213, 62, 79],
        ],
        Ramp::Marks => &[[165, 165, 165], [225, 25, 25], [255, 215, 0]],
    }
}

/// The 256 colours of a ramp in sRGB, low to high.
pub fn ramp_colors(ramp: Ramp) -> [[u8; 4]; 256] {
    let points = control_points(ramp);
    std::array::from_fn(|i| {
        let at = i as f32 / 255.0 * (points.len() - 1) as f32;
        let segment = (at as usize).min(points.len() - 2);
        let mix = |channel: usize| {
            let (from, to) = (f32::from(points[segment][channel]), f32::from(points[segment + 1][channel]));
            (from + (to - from) * (at - segment as f32)).round() as u8
        };
        [mix(0), mix(1), mix(2), 255]
    })
}

/// The names and the sRGB colours of points on a surface, of lone strays and of mixed pixels.
pub const STRAY_KINDS: [(&str, [u8; 4]); 3] =
    [("on a surface", [170, 170, 170, 255]), ("lone stray", [255, 60, 200, 255]), ("mixed pixel", [255, 150, 0, 255])];

/// The colours of all ramps, 256 each, then those of the classes, and of strays.
pub(crate) static PALETTE: LazyLock<Vec<u32>> = LazyLock::new(|| {
    let ramps = (0..Ramp::NAMES.len() as u32).filter_map(Ramp::from_index).flat_map(ramp_colors);
    let strays = STRAY_KINDS.map(|(_, color)| color);
    ramps.chain((0..=255).map(class_color)).chain(strays).map(u32::from_le_bytes).collect()
});

/// Where the colours begin in the palette that a cloud is shown in.
pub(crate) fn palette_start(source: ColorSource, ramp: Ramp) -> u32 {
    let ramps = Ramp::NAMES.len() as u32;
    256 * match source {
        ColorSource::Class => ramps,
        ColorSource::Stray => ramps + 1,
        _ => ramp.index(),
    }
}

/// The names of the ASPRS classes (LAS 1.4 R15, table 17); empty for reserved and user-defined codes.
pub fn class_name(class: u8) -> &'static str {
    match class {
        0 => "never classified",
        1 => "unclassified",
        2 => "ground",
        3 => "low vegetation",
        4 => "medium vegetation",
        5 => "high vegetation",
        6 => "building",
        7 => "low point (noise)",
        8 => "model key-point",
        9 => "water",
        10 => "rail",
        11 => "road surface",
        12 => "overlap",
        13 => "wire guard (shield)",
        14 => "wire conductor (phase)",
        15 => "transmission tower",
        16 => "wire-structure connector",
        17 => "bridge deck",
        18 => "high noise",
        19 => "overhead structure",
        20 => "ignored ground",
        21 => "snow",
        22 => "temporal exclusion",
        _ => "",
    }
}

/// The sRGB colour of a class: the customary one for an ASPRS class, a hue spread by the golden ratio for others.
pub fn class_color(class: u8) -> [u8; 4] {
    let [red, green, blue] = match class {
        0 => [210, 205, 190],
        1 => [170, 170, 170],
        2 => [161, 122, 75],
        3 => [140, 200, 90],
        4 => [80, 165, 60],
        5 => [30, 115, 40],
        6 => [226, 98, 72],
        7 => [255, 60, 200],
        8 => [240, 220, 80],
        9 => [60, 130, 220],
        10 => [120, 90, 140],
        11 => [95, 95, 105],
        12 => [240, 240, 240],
        13 => [255, 225, 120],
        14 => [255, 190, 40],
        15 => [190, 160, 220],
        16 => [220, 130, 240],
        17 => [120, 190, 200],
        18 => [200, 20, 120],
        21 => [225, 240, 255],
        _ => {
            let hue = (f32::from(class) * 0.618_034).fract() * 6.0;
            let channel = |shift: f32| {
                let distance = (hue + shift).rem_euclid(6.0);
                let rise = (distance - 3.0).abs() - 1.0;
                (90.0 + 150.0 * rise.clamp(0.0, 1.0)) as u8
            };
            [channel(0.0), channel(4.0), channel(2.0)]
        }
    };
    [red, green, blue, 255]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use cloud::{Attribute, Chunk, Column, ColumnType};

    fn cloud(intensity: Vec<u16>) -> Cloud {
        let positions = (0..intensity.len()).map(|i| [i as f32, 0.0, (i * i) as f32]).collect();
        let mut chunk = Chunk::new(0, DVec3::new(0.0, 0.0, 100.0), positions);
        chunk.columns = vec![Some(Arc::new(Column::U16(intensity))), None];
        let attribute = |name: &str, column_type| Attribute { name: name.into(), column_type };
        Cloud {
            name: "test".into(),
            attributes: vec![attribute("intensity", ColumnType::U16), attribute("gps_time", ColumnType::F64)],
            grid: Some(cloud::Grid::new(DVec3::splat(0.01), DVec3::ZERO)),
            chunks: vec![chunk],
        }
    }

    #[test]
    fn auto_takes_intensity_only_if_it_varies() {
        let color = Color::default();
        let (plan, warning) = ColorPlan::new(&cloud((0..1000).collect()), &color, DVec3::Z);
        assert_eq!((plan.source, warning), (ColorSource::Column(0), None));
        let (plan, _) = ColorPlan::new(&cloud(vec![0; 1000]), &color, DVec3::Z);
        assert_eq!(plan.source, ColorSource::Height);
        let mesh = Cloud { grid: None, ..cloud((0..1000).collect()) };
        assert_eq!(ColorPlan::new(&mesh, &color, DVec3::Z).0.source, ColorSource::Plain);
    }

    #[test]
    fn named_classes_have_colours_that_differ() {
        let named: Vec<u8> = (0..=255).filter(|class| !class_name(*class).is_empty()).collect();
        for (index, class) in named.iter().enumerate() {
            for other in &named[..index] {
                let channels = std::iter::zip(class_color(*class), class_color(*other));
                let apart: i32 = channels.map(|(a, b)| (i32::from(a) - i32::from(b)).pow(2)).sum();
                assert!(apart >= 20 * 20, "{other} and {class}: {}", f64::from(apart).sqrt());
            }
        }
    }

    #[test]
    fn heights_are_world_coordinates_along_the_up_axis() {
        let color = Color { by: ColorBy::Height, low: 0.0, high: 1.0, ..Color::default() };
        let (plan, _) = ColorPlan::new(&cloud(vec![1; 100]), &color, DVec3::Z);
        assert_eq!((plan.low, plan.high), (100.0, 100.0 + 99.0 * 99.0));
        assert_eq!(plan.histogram(&cloud(vec![1; 100]), DVec3::Z, 10).0.iter().sum::<u32>(), 100);
    }

    #[test]
    fn what_a_cloud_lacks_is_said_and_replaced() {
        let color = Color { by: ColorBy::Attribute, attribute: "treeID".into(), ..Color::default() };
        let (plan, warning) = ColorPlan::new(&cloud(vec![1; 100]), &color, DVec3::Z);
        assert_eq!(plan.source, ColorSource::Height);
        assert_eq!(warning.unwrap(), "test: no attribute `treeID`; colouring is automatic");
    }

    #[test]
    fn scalars_of_cloudcompare_are_the_attributes_that_they_mean() {
        let mut cloud = cloud((0..1000).collect());
        cloud.attributes[0].name = "scalar_Intensity".into();
        let intensity = Color { by: ColorBy::Intensity, ..Color::default() };
        let own = Color { by: ColorBy::Attribute, attribute: "scalar_Intensity".into(), ..Color::default() };
        for color in [intensity, own] {
            let (plan, warning) = ColorPlan::new(&cloud, &color, DVec3::Z);
            assert_eq!((plan.source, plan.label.as_str(), warning), (ColorSource::Column(0), "scalar_Intensity", None));
        }
        cloud.attributes[0].name = "scalar_Classification".into();
        let (plan, _) = ColorPlan::new(&cloud, &Color { by: ColorBy::Class, ..Color::default() }, DVec3::Z);
        assert_eq!(plan.source, ColorSource::Class);
    }

    #[test]
    fn values_that_are_none_are_out_of_the_range_and_an_attribute_of_nothing_else_is_said() {
        let mut cloud = cloud(vec![0; 100]);
        let mut of = |values: Vec<f32>| {
            cloud.attributes[0] = Attribute { name: "height".into(), column_type: ColumnType::F32 };
            cloud.chunks[0].columns[0] = Some(Arc::new(Column::F32(values)));
            let color = Color { by: ColorBy::Attribute, attribute: "height".into(), ..Color::default() };
            let (plan, warning) = ColorPlan::new(&cloud, &color, DVec3::Z);
            let counted: u32 = plan.histogram(&cloud, DVec3::Z, 10).0.iter().sum();
            (plan.label, plan.full_range, counted, warning)
        };
        let some = |i: usize| if i.is_multiple_of(4) { f32::NAN } else { i as f32 };
        assert_eq!(of((0..100).map(some).collect()), ("height".into(), (1.0, 99.0), 75, None));
        let (_, _, _, warning) = of(vec![f32::NAN; 100]);
        assert_eq!(warning.unwrap(), "test: no point has a value of height; colouring is automatic");
    }

    #[test]
    fn an_attribute_that_is_the_same_everywhere_is_said_and_not_shown() {
        let color = Color { by: ColorBy::Intensity, ..Color::default() };
        let (plan, warning) = ColorPlan::new(&cloud(vec![7; 100]), &color, DVec3::Z);
        assert_eq!(plan.source, ColorSource::Height);
        assert_eq!(warning.unwrap(), "test: intensity is 7 everywhere; colouring is automatic");
        let mut values = vec![7; 100];
        values[50] = 8;
        let (plan, warning) = ColorPlan::new(&cloud(values), &color, DVec3::Z);
        assert_eq!((plan.label.as_str(), warning), ("intensity", None));
        // Nearly all values are one, and the ramp has room for the other.
        assert_eq!((plan.low, plan.high, plan.full_range), (7.0, 8.0, (7.0, 8.0)));
    }

    #[test]
    fn the_ends_of_the_ramp_may_be_given_the_wrong_way_round() {
        let ends = |low, high| {
            let color = Color { by: ColorBy::Intensity, low, high, ..Color::default() };
            let (plan, _) = ColorPlan::new(&cloud((0..1000).collect()), &color, DVec3::Z);
            (plan.low, plan.high)
        };
        assert_eq!(ends(0.9, 0.1), ends(0.1, 0.9));
    }

    #[test]
    fn points_without_a_colour_are_told_and_shown_by_their_intensity() {
        // A thousand shades, and two hundred points that are exactly black.
        let shade =
            |i: usize| if i < 1000 { [8 + (i % 30) as u8 * 8, 200, (i / 30) as u8 * 7, 255] } else { [0, 0, 0, 255] };
        let of = |intensity: Vec<u16>, blank: Blank| {
            let mut cloud = cloud(intensity);
            cloud.chunks[0].colors = Some(Arc::new((0..cloud.chunks[0].len()).map(shade).collect()));
            ColorPlan::new(&cloud, &Color { blank, ..Color::default() }, DVec3::Z).0
        };
        let plan = of((0..1200).collect(), Blank::Auto);
        assert_eq!((plan.source, plan.label.as_str()), (ColorSource::RgbOr(Some(0)), "RGB"));
        assert_eq!((plan.low, plan.high), (12.0, 1187.0));
        assert_eq!(of(vec![7; 1200], Blank::Auto).source, ColorSource::RgbOr(None), "its intensity tells nothing");
        assert_eq!(of((0..1200).collect(), Blank::Black).source, ColorSource::Rgb);
        assert_eq!(of((0..1000).collect(), Blank::Auto).source, ColorSource::Rgb, "all points have a colour");
    }

    #[test]
    fn real_points_are_grey_ghosts_red_and_undecided_points_yellow_however_few_there_are() {
        let color = Color { by: ColorBy::Attribute, attribute: "ghost".into(), ..Color::default() };
        for kinds in [vec![0, 1], vec![0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2], vec![1, 2]] {
            let mut cloud = cloud(kinds);
            cloud.attributes[0].name = "ghost".into();
            let (plan, warning) = ColorPlan::new(&cloud, &color, DVec3::Z);
            assert_eq!((plan.source, plan.low, plan.high, warning), (ColorSource::Column(0), 0.0, 2.0, None));
            let [real, ghost, undecided] = [0, 128, 255].map(|place| ramp_colors(plan.ramp)[place]);
            assert!(real[0] == real[1] && real[1] == real[2] && ghost[0] > 4 * ghost[1].max(ghost[2]), "{ghost:?}");
            assert!(undecided[0] > 200 && undecided[1] > 200 && undecided[2] < 50, "{undecided:?}");
            cloud.attributes[0].name = "ghost_mirror".into();
            let other = Color { attribute: "ghost_mirror".into(), ..color.clone() };
            assert_eq!(ColorPlan::new(&cloud, &other, DVec3::Z).0.ramp, Ramp::Turbo);
        }
    }

    #[test]
    fn columns_that_are_not_read_yet_are_asked_for() {
        let color = Color { by: ColorBy::GpsTime, ..Color::default() };
        let cloud = cloud(vec![1; 100]);
        let (plan, _) = ColorPlan::new(&cloud, &color, DVec3::Z);
        assert_eq!(plan.missing_column(&cloud), Some(1));
    }

    #[test]
    fn ramps_begin_and_end_with_their_control_points() {
        for index in 0..Ramp::NAMES.len() as u32 {
            let ramp = Ramp::from_index(index).unwrap();
            let (colors, points) = (ramp_colors(ramp), control_points(ramp));
            assert_eq!(colors[0][..3], points[0]);
            assert_eq!(colors[255][..3], points[points.len() - 1]);
        }
    }
}
