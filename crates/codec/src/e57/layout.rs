//! What the columns of a scan mean: which numbers of a point are made of them, and how.

use cloud::ColumnType;
use e57::{PointCloud, RecordDataType, RecordName, RecordValue};

use crate::brief::brief;
use crate::export::columns::HAS_COLOR;
use crate::format::E57_OTHERS;
use crate::ply::columns::Scale;
use crate::ply::header::{Element, Kind, Property};

/// The most columns of a point: scans have some ten.
const MOST_COLUMNS: usize = 256;

/// How the values of a stream are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stored {
    Single,
    Double,
    Integer { min: i64, max: i64 },
    Scaled { min: i64, max: i64, scale: f64, offset: f64 },
}

impl Stored {
    fn of(data_type: &RecordDataType) -> Self {
        match *data_type {
            RecordDataType::Single { .. } => Self::Single,
            RecordDataType::Double { .. } => Self::Double,
            RecordDataType::Integer { min, max } => Self::Integer { min, max },
            RecordDataType::ScaledInteger { min, max, scale, offset } => Self::Scaled { min, max, scale, offset },
        }
    }

    /// The number of bits of a value.
    pub fn width(self) -> u32 {
        match self {
            Self::Single => 32,
            Self::Double => 64,
            Self::Integer { min, max } | Self::Scaled { min, max, .. } => 64 - max.wrapping_sub(min).leading_zeros(),
        }
    }

    /// The whole number of some bits.
    #[inline]
    pub fn integer(self, bits: u64) -> i64 {
        match self {
            Self::Integer { min, max } => min.wrapping_add(bits as i64).clamp(min, max),
            _ => self.number(bits) as i64,
        }
    }

    /// The number of some bits.
    #[inline]
    pub fn number(self, bits: u64) -> f64 {
        match self {
            Self::Single => f64::from(f32::from_bits(bits as u32)),
            Self::Double => f64::from_bits(bits),
            Self::Integer { .. } => self.integer(bits) as f64,
            Self::Scaled { min, scale, offset, .. } => min.wrapping_add(bits as i64) as f64 * scale + offset,
        }
    }

    /// The smallest type that holds all values.
    fn column_type(self) -> ColumnType {
        let Self::Integer { min, max } = self else {
            return if self == Self::Single { ColumnType::F32 } else { ColumnType::F64 };
        };
        let fits = |least: i64, most: i64| least <= min && max <= most;
        match () {
            () if fits(0, 0xff) => ColumnType::U8,
            () if fits(0, 0xffff) => ColumnType::U16,
            () if fits(0, 0xffff_ffff) => ColumnType::U32,
            () if fits(-0x80, 0x7f) => ColumnType::I8,
            () if fits(-0x8000, 0x7fff) => ColumnType::I16,
            () if fits(-0x8000_0000, 0x7fff_ffff) => ColumnType::I32,
            () => ColumnType::I64,
        }
    }

    /// A type of floats that holds the values, and NaN.
    fn float_type(self) -> ColumnType {
        match self.column_type() {
            ColumnType::F32 | ColumnType::U8 | ColumnType::I8 | ColumnType::U16 | ColumnType::I16 => ColumnType::F32,
            _ => ColumnType::F64,
        }
    }
}

/// What a number of a point is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin {
    /// A stream, and the stream that is not 0 where the value means nothing, with what stands for it then.
    Stream { stream: usize, invalid: Option<(usize, f64)> },
    /// A stream of numbers that count from 0, where those of points count from 1.
    Number(usize),
    /// 1 where a stream is 0, else 0.
    Without(usize),
    /// An axis of the place.
    Place(usize),
    /// An axis of the normal.
    Normal(usize),
}

/// The columns of a scan by their meaning.
#[derive(Debug)]
pub struct Layout {
    pub stored: Vec<Stored>,
    pub element: Element,
    /// For each property of the element.
    pub origins: Vec<Origin>,
    /// The streams of x, y and z, or of range, azimuth and elevation.
    pub place: [usize; 3],
    pub is_spherical: bool,
    /// The stream that is not 0 where the place means nothing.
    pub invalid: Option<usize>,
    pub normal: Option<[usize; 3]>,
    pub color_scale: Option<[Scale; 3]>,
    /// The range of the intensity.
    pub intensity_limits: Option<[f64; 2]>,
}

impl Layout {
    /// `is_moved` says whether the scan has a pose.
    ///
    /// # Errors
    /// In words, if points have no place.
    pub fn of(scan: &PointCloud, is_moved: bool) -> Result<Self, String> {
        let columns = scan.prototype.len();
        if columns > MOST_COLUMNS {
            return Err(format!("{columns} columns of a point, expected at most {MOST_COLUMNS}"));
        }
        let find = |name: RecordName| scan.prototype.iter().position(|record| record.name == name);
        let triple = |[a, b, c]: [RecordName; 3]| Some([find(a)?, find(b)?, find(c)?]);
        let cartesian = triple([RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]);
        let spherical =
            triple([RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation]);
        let Some(place) = cartesian.or(spherical) else {
            return Err("its points have neither cartesian nor spherical coordinates".into());
        };
        let is_spherical = cartesian.is_none();
        let invalid = find(match is_spherical {
            true => RecordName::SphericalInvalidState,
            false => RecordName::CartesianInvalidState,
        });
        let axis = |axis: &str| {
            let is_named = |record: &e57::Record| match &record.name {
                RecordName::Unknown { name, .. } => name.eq_ignore_ascii_case(&format!("normal{axis}")),
                _ => false,
            };
            scan.prototype.iter().position(is_named)
        };
        let normal = || Some([axis("x")?, axis("y")?, axis("z")?]);
        let normal = normal();
        let colors = triple([RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue]);
        let (scales, color_type) = colors.map_or((None, None), |colors| colors_of(scan, colors));
        let stored: Vec<Stored> = scan.prototype.iter().map(|record| Stored::of(&record.data_type)).collect();
        let is_exact = is_moved || is_spherical || place.iter().any(|stream| stored[*stream] != Stored::Single);
        let place_type = if is_exact { ColumnType::F64 } else { ColumnType::F32 };

        let mut properties = Vec::new();
        let mut origins = Vec::new();
        let mut add = |name: String, column_type: ColumnType, origin: Origin| {
            properties.push(Property { name, kind: Kind::Scalar(column_type) });
            origins.push(origin);
        };
        for (number, name) in ["x", "y", "z"].into_iter().enumerate() {
            add(name.into(), place_type, Origin::Place(number));
        }
        for (stream, record) in scan.prototype.iter().enumerate() {
            let own = stored[stream];
            let plain = Origin::Stream { stream, invalid: None };
            let unless = |name: RecordName, other: f64| Origin::Stream {
                stream,
                invalid: find(name).map(|invalid| (invalid, other)),
            };
            if !is_spherical && place.contains(&stream) {
                continue;
            }
            if let Some(axis) = normal.and_then(|normal| normal.iter().position(|other| *other == stream)) {
                add(["nx", "ny", "nz"][axis].into(), ColumnType::F32, Origin::Normal(axis));
                continue;
            }
            match &record.name {
                RecordName::ColorRed | RecordName::ColorGreen | RecordName::ColorBlue => {
                    let column_type = color_type.unwrap_or(own.column_type());
                    add(
                        snake(record.name_text()).replace("color_", ""),
                        column_type,
                        unless(RecordName::IsColorInvalid, 0.0),
                    );
                }
                RecordName::Intensity => {
                    let origin = unless(RecordName::IsIntensityInvalid, f64::NAN);
                    let is_sure = matches!(origin, Origin::Stream { invalid: None, .. });
                    add("intensity".into(), if is_sure { own.column_type() } else { own.float_type() }, origin);
                }
                RecordName::TimeStamp => {
                    add("time_stamp".into(), ColumnType::F64, unless(RecordName::IsTimeStampInvalid, f64::NAN));
                }
                RecordName::ReturnIndex => add("return_number".into(), ColumnType::U8, Origin::Number(stream)),
                RecordName::ReturnCount => add("number_of_returns".into(), own.column_type(), plain),
                // What other points without a colour have in exported files.
                RecordName::IsColorInvalid => add(HAS_COLOR.into(), ColumnType::U8, Origin::Without(stream)),
                RecordName::Unknown { namespace, name } if !namespace.is_empty() && namespace != E57_OTHERS.0 => {
                    add(format!("{namespace}_{name}"), own.column_type(), plain);
                }
                RecordName::Unknown { name, .. } => add(name.clone(), own.column_type(), plain),
                _ => add(snake(record.name_text()), own.column_type(), plain),
            }
        }
        let element = Element { name: "points".into(), count: scan.records, properties };
        let intensity_limits = intensity_limits(scan);
        let color_scale = scales;
        Ok(Self { stored, element, origins, place, is_spherical, invalid, normal, color_scale, intensity_limits })
    }
}

/// The name of a column in the standard, which the crate keeps to itself.
trait NameText {
    fn name_text(&self) -> &'static str;
}

impl NameText for e57::Record {
    fn name_text(&self) -> &'static str {
        match self.name {
            RecordName::CartesianX => "cartesianX",
            RecordName::CartesianY => "cartesianY",
            RecordName::CartesianZ => "cartesianZ",
            RecordName::CartesianInvalidState => "cartesianInvalidState",
            RecordName::SphericalRange => "sphericalRange",
            RecordName::SphericalAzimuth => "sphericalAzimuth",
            RecordName::SphericalElevation => "sphericalElevation",
            RecordName::SphericalInvalidState => "sphericalInvalidState",
            RecordName::Intensity => "intensity",
            RecordName::IsIntensityInvalid => "isIntensityInvalid",
            RecordName::ColorRed => "colorRed",
            RecordName::ColorGreen => "colorGreen",
            RecordName::ColorBlue => "colorBlue",
            RecordName::IsColorInvalid => "isColorInvalid",
            RecordName::RowIndex => "rowIndex",
            RecordName::ColumnIndex => "columnIndex",
            RecordName::ReturnCount => "returnCount",
            RecordName::ReturnIndex => "returnIndex",
            RecordName::TimeStamp => "timeStamp",
            RecordName::IsTimeStampInvalid => "isTimeStampInvalid",
            RecordName::Unknown { .. } => "unknown",
        }
    }
}

/// `row_index` for `rowIndex`.
fn snake(name: &str) -> String {
    let mut words = String::new();
    for letter in name.chars() {
        if letter.is_ascii_uppercase() {
            words.push('_');
        }
        words.push(letter.to_ascii_lowercase());
    }
    words
}

/// The scales that the limits of a scan's colours give, and the type of a channel if its own one would not do. Without
/// limits, a whole number's own range counts; that of floats is found among the values.
fn colors_of(scan: &PointCloud, colors: [usize; 3]) -> (Option<[Scale; 3]>, Option<ColumnType>) {
    let limits = scan.color_limits.as_ref();
    let own = |channel: usize| {
        let data_type = &scan.prototype[colors[channel]].data_type;
        let told = limits.and_then(|limits| {
            let (least, most) = match channel {
                0 => (&limits.red_min, &limits.red_max),
                1 => (&limits.green_min, &limits.green_max),
                _ => (&limits.blue_min, &limits.blue_max),
            };
            range(least.as_ref()?, most.as_ref()?, data_type)
        });
        told.or(match *data_type {
            RecordDataType::Integer { min, max } if min < max => Some([min as f64, max as f64]),
            _ => None,
        })
    };
    let ranges = [own(0), own(1), own(2)];
    let scale = |[least, most]: [f64; 2]| {
        let is_bits = least == 0.0 && (most + 1.0).log2().fract() == 0.0 && most >= 255.0;
        let (factor, bias) = match is_bits {
            true => (256.0 / (most + 1.0), 0.0),
            false => (255.0 / (most - least), 0.5 - least * 255.0 / (most - least)),
        };
        Scale::Linear { factor: factor as f32, bias: bias as f32 }
    };
    let [Some(red), Some(green), Some(blue)] = ranges else { return (None, None) };
    // Bytes are colours as they are.
    let are_bytes = [red, green, blue].iter().all(|range| *range == [0.0, 255.0]);
    let is_narrow = |stream: &usize| {
        let own = Stored::of(&scan.prototype[*stream].data_type).column_type();
        matches!(own, ColumnType::U8 | ColumnType::I8)
    };
    let wider = colors.iter().any(is_narrow) && !are_bytes;
    (Some([red, green, blue].map(scale)), wider.then_some(ColumnType::I16))
}

fn intensity_limits(scan: &PointCloud) -> Option<[f64; 2]> {
    let limits = scan.intensity_limits.as_ref()?;
    let record = scan.prototype.iter().find(|record| record.name == RecordName::Intensity)?;
    range(limits.intensity_min.as_ref()?, limits.intensity_max.as_ref()?, &record.data_type)
}

fn range(least: &RecordValue, most: &RecordValue, data_type: &RecordDataType) -> Option<[f64; 2]> {
    let range = [least.to_f64(data_type).ok()?, most.to_f64(data_type).ok()?];
    (range[0] < range[1] && range.iter().all(|end| end.is_finite())).then_some(range)
}

/// The name of a scan or picture, or its place among them where it has none.
pub fn name_of(name: Option<&String>, what: &str, number: usize) -> String {
    match name.map(|name| brief(name.trim())).filter(|name| !name.is_empty()) {
        Some(name) => name,
        None => format!("{what} {}", number + 1),
    }
}
