//! Knows where in a LAS point record each property lies: point formats 0 to 10 and Extra Bytes (LAS 1.4 R15, tables 7
//! to 26).

use std::collections::HashMap;

use cloud::{Attribute, Column, ColumnType, Grid};
use laz::DecompressionSelection;

/// The size in bytes of a record of point formats 0 to 10 without extra bytes.
const BASE_LENGTHS: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
/// The offsets of GPS time, colours, near infrared and wave packet in records of each format.
const GPS_TIME: [Option<usize>; 11] = {
    let (old, new) = (Some(20), Some(22));
    [None, old, None, old, old, old, new, new, new, new, new]
};
const RED: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];
const NEAR_INFRARED: [Option<usize>; 11] = [None, None, None, None, None, None, None, None, Some(36), None, Some(36)];
const WAVE_PACKET: [Option<usize>; 11] =
    [None, None, None, None, Some(28), Some(34), None, None, None, Some(30), Some(38)];
/// The size in bytes of a wave packet in a record.
const WAVE_PACKET_LENGTH: usize = 29;
/// The size in bytes of one descriptor in an Extra Bytes record.
const DESCRIPTOR_LENGTH: usize = 192;

/// The name of bytes that no descriptor describes.
const UNDESCRIBED: &str = "ExtraBytes";

/// How to read a value from a record; `at` is its first byte.
#[derive(Clone, Debug, PartialEq)]
pub enum Reading {
    /// A scaled coordinate, axis 0 to 2.
    Coordinate {
        axis: usize,
    },
    Bits {
        at: usize,
        shift: u8,
        mask: u8,
    },
    Value {
        at: usize,
        file_type: ColumnType,
    },
    /// An angle in steps of `step` degrees.
    Degrees {
        at: usize,
        file_type: ColumnType,
        step: f64,
    },
    /// An extra dimension with a scale or an offset.
    Scaled {
        at: usize,
        file_type: ColumnType,
        scale: f64,
        offset: f64,
    },
    /// An extra dimension of which one number means that a point has no value. Its column has NaN there. `scaling` is
    /// its scale and its offset, if it has any.
    Sparse {
        at: usize,
        file_type: ColumnType,
        no_data: NoData,
        scaling: Option<(f64, f64)>,
    },
    /// Bytes that no record describes.
    Opaque {
        at: usize,
        length: usize,
    },
}

/// The number that means "no value" in an extra dimension, as the file has it: before scale and offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoData {
    /// The bytes of a whole number; those beyond its type's size do not count.
    Whole([u8; 8]),
    Float(f64),
}

impl NoData {
    /// Reads the field of a descriptor (LAS 1.4 R15, table 24: a 64-bit number of the kind of the type). Some writers
    /// put the number in its own type there, and zeros behind it. `None` if the type has no such number.
    fn new(field: [u8; 8], file_type: ColumnType) -> Option<Self> {
        let size = file_type.size();
        let (own, rest) = field.split_at(size);
        match file_type {
            ColumnType::F64 => Some(Self::Float(f64::from_le_bytes(field))),
            ColumnType::F32 if rest == [0; 4] => Some(Self::Float(f32::from_le_bytes(bytes(own, 0)).into())),
            ColumnType::F32 => Some(Self::Float(f64::from_le_bytes(field))),
            _ => {
                let is_signed = matches!(file_type, ColumnType::I8 | ColumnType::I16 | ColumnType::I32);
                let is_negative = is_signed && own[size - 1] & 0x80 != 0;
                let is_extended =
                    rest.iter().all(|byte| *byte == 0) || is_negative && rest.iter().all(|byte| *byte == 255);
                is_extended.then_some(Self::Whole(field))
            }
        }
    }

    /// Whether the number at byte `at` of a record is this one.
    pub fn is_at(&self, record: &[u8], at: usize, file_type: ColumnType) -> bool {
        match *self {
            Self::Whole(number) => {
                let size = file_type.size();
                record[at..at + size] == number[..size]
            }
            // The file may have rounded its own number to 32 bits.
            Self::Float(number) if file_type == ColumnType::F32 => {
                f32::from_le_bytes(bytes(record, at)) == number as f32
            }
            Self::Float(number) => f64::from_le_bytes(bytes(record, at)) == number,
        }
    }
}

impl Reading {
    pub fn at(&self) -> usize {
        match *self {
            Self::Coordinate { axis } => axis * 4,
            Self::Bits { at, .. }
            | Self::Value { at, .. }
            | Self::Degrees { at, .. }
            | Self::Scaled { at, .. }
            | Self::Sparse { at, .. }
            | Self::Opaque { at, .. } => at,
        }
    }

    /// The type in the file.
    fn file_type(&self) -> ColumnType {
        match *self {
            Self::Coordinate { .. } => ColumnType::I32,
            Self::Bits { .. } | Self::Opaque { .. } => ColumnType::U8,
            Self::Value { file_type, .. }
            | Self::Degrees { file_type, .. }
            | Self::Scaled { file_type, .. }
            | Self::Sparse { file_type, .. } => file_type,
        }
    }

    /// The type of the column to which it is decoded.
    pub fn column_type(&self) -> ColumnType {
        match self {
            Self::Degrees { .. } => ColumnType::F32,
            Self::Coordinate { .. } | Self::Scaled { .. } | Self::Sparse { scaling: Some(_), .. } => ColumnType::F64,
            Self::Sparse { file_type, .. } => file_type.with_none(),
            _ => self.file_type(),
        }
    }

    /// Appends the value of each of `records` to `column`, which is of `column_type`.
    pub fn append(&self, column: &mut Column, records: &[u8], record_length: usize, grid: &Grid) {
        let records = records.chunks_exact(record_length);
        match (self, column) {
            (&Self::Bits { at, shift, mask }, Column::U8(values)) => {
                values.extend(records.map(|record| (record[at] >> shift) & mask));
            }
            (&Self::Degrees { at, file_type, step }, Column::F32(values)) => {
                // Rounded once, so that -17.88 is written so.
                values.extend(records.map(|record| (number(record, at, file_type) * step) as f32));
            }
            (&Self::Scaled { at, file_type, scale, offset }, Column::F64(values)) => {
                values.extend(records.map(|record| number(record, at, file_type) * scale + offset));
            }
            (&Self::Sparse { at, file_type, no_data, scaling }, Column::F64(values)) => {
                let (scale, offset) = scaling.unwrap_or((1.0, 0.0));
                values.extend(records.map(|record| match no_data.is_at(record, at, file_type) {
                    true => f64::NAN,
                    false => number(record, at, file_type) * scale + offset,
                }));
            }
            (&Self::Sparse { at, file_type, no_data, .. }, Column::F32(values)) => {
                values.extend(records.map(|record| match no_data.is_at(record, at, file_type) {
                    true => f32::NAN,
                    false => number(record, at, file_type) as f32,
                }));
            }
            (&Self::Coordinate { axis }, Column::F64(values)) => values.extend(records.map(|record| {
                f64::from(i32::from_le_bytes(bytes(record, axis * 4))) * grid.scale[axis] + grid.offset[axis]
            })),
            (&Self::Value { at, .. } | &Self::Opaque { at, .. }, column) => match column {
                Column::U8(values) => values.extend(records.map(|record| record[at])),
                Column::I8(values) => values.extend(records.map(|record| i8::from_le_bytes(bytes(record, at)))),
                Column::U16(values) => values.extend(records.map(|record| u16::from_le_bytes(bytes(record, at)))),
                Column::I16(values) => values.extend(records.map(|record| i16::from_le_bytes(bytes(record, at)))),
                Column::U32(values) => values.extend(records.map(|record| u32::from_le_bytes(bytes(record, at)))),
                Column::I32(values) => values.extend(records.map(|record| i32::from_le_bytes(bytes(record, at)))),
                Column::U64(values) => values.extend(records.map(|record| u64::from_le_bytes(bytes(record, at)))),
                Column::I64(values) => values.extend(records.map(|record| i64::from_le_bytes(bytes(record, at)))),
                Column::F32(values) => values.extend(records.map(|record| f32::from_le_bytes(bytes(record, at)))),
                Column::F64(values) => values.extend(records.map(|record| f64::from_le_bytes(bytes(record, at)))),
            },
            // Columns are made by `column_type`, so no other pair exists.
            _ => debug_assert!(false, "{self:?} decoded to a column of another type"),
        }
    }
}

/// The `N` bytes of a record from `at` on; the layout has checked that they exist.
#[inline]
pub fn bytes<const N: usize>(record: &[u8], at: usize) -> [u8; N] {
    let mut bytes = [0; N];
    bytes.copy_from_slice(&record[at..at + N]);
    bytes
}

/// A number of any type as f64.
fn number(record: &[u8], at: usize, file_type: ColumnType) -> f64 {
    match file_type {
        ColumnType::U8 => f64::from(record[at]),
        ColumnType::I8 => f64::from(i8::from_le_bytes(bytes(record, at))),
        ColumnType::U16 => f64::from(u16::from_le_bytes(bytes(record, at))),
        ColumnType::I16 => f64::from(i16::from_le_bytes(bytes(record, at))),
        ColumnType::U32 => f64::from(u32::from_le_bytes(bytes(record, at))),
        ColumnType::I32 => f64::from(i32::from_le_bytes(bytes(record, at))),
        ColumnType::U64 => u64::from_le_bytes(bytes(record, at)) as f64,
        ColumnType::I64 => i64::from_le_bytes(bytes(record, at)) as f64,
        ColumnType::F32 => f64::from(f32::from_le_bytes(bytes(record, at))),
        ColumnType::F64 => f64::from_le_bytes(bytes(record, at)),
    }
}

/// One property of a point.
#[derive(Clone, Debug)]
pub struct Property {
    pub name: String,
    pub reading: Reading,
}

/// The layout of a file's records.
#[derive(Clone, Debug)]
pub struct Layout {
    pub record_length: usize,
    /// All properties, in file order.
    pub properties: Vec<Property>,
    /// The scalar attributes that a selection may name.
    pub attributes: Vec<Property>,
    /// The offset of the 16-bit red, green and blue.
    pub red: Option<usize>,
    near_infrared: Option<usize>,
    /// The offset of the wave packet.
    wave_packet: Option<usize>,
    /// Whether the point format is 6 to 10, which LAZ stores in layers.
    extended: bool,
}

impl Layout {
    /// The offset of GPS time in records of a format.
    pub fn gps_time(point_format: u8) -> Option<usize> {
        *GPS_TIME.get(usize::from(point_format))?
    }

    /// The offset of the colours in records of a format.
    pub fn red_of(point_format: u8) -> Option<usize> {
        *RED.get(usize::from(point_format))?
    }

    /// The offset of the wave packet in records of a format.
    pub fn wave_packet(point_format: u8) -> Option<usize> {
        *WAVE_PACKET.get(usize::from(point_format))?
    }

    /// The offset of near infrared in records of a format.
    pub fn near_infrared(point_format: u8) -> Option<usize> {
        *NEAR_INFRARED.get(usize::from(point_format))?
    }

    /// The least size in bytes of a record of `point_format`; `None` for a format that does not exist.
    pub fn base_length(point_format: u8) -> Option<usize> {
        BASE_LENGTHS.get(usize::from(point_format)).copied()
    }

    /// `point_format` is 0 to 10 and `record_length` at least its `base_length`. `descriptors` are the Extra Bytes
    /// records of the file, one after the other.
    pub fn new(point_format: u8, record_length: usize, descriptors: &[u8], warnings: &mut Vec<String>) -> Self {
        let format = usize::from(point_format);
        let extended = format >= 6;
        let mut properties = Vec::new();
        let mut add = |name: &str, reading: Reading| properties.push(Property { name: name.into(), reading });
        let bit = |at, shift| Reading::Bits { at, shift, mask: 1 };
        let value = |at, file_type| Reading::Value { at, file_type };

        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            add(name, Reading::Coordinate { axis });
        }
        add("intensity", value(12, ColumnType::U16));
        if extended {
            add("return_number", Reading::Bits { at: 14, shift: 0, mask: 15 });
            add("number_of_returns", Reading::Bits { at: 14, shift: 4, mask: 15 });
            for (shift, name) in (0..).zip(["synthetic", "key_point", "withheld", "overlap"]) {
                add(name, bit(15, shift));
            }
            add("scanner_channel", Reading::Bits { at: 15, shift: 4, mask: 3 });
            add("scan_direction_flag", bit(15, 6));
            add("edge_of_flight_line", bit(15, 7));
            add("classification", value(16, ColumnType::U8));
            add("user_data", value(17, ColumnType::U8));
            // LAS 1.4 R15, 2.6.7: one count is 0.006 degrees.
            add("scan_angle", Reading::Degrees { at: 18, file_type: ColumnType::I16, step: 0.006 });
            add("point_source_id", value(20, ColumnType::U16));
        } else {
            add("return_number", Reading::Bits { at: 14, shift: 0, mask: 7 });
            add("number_of_returns", Reading::Bits { at: 14, shift: 3, mask: 7 });
            add("scan_direction_flag", bit(14, 6));
            add("edge_of_flight_line", bit(14, 7));
            add("classification", Reading::Bits { at: 15, shift: 0, mask: 31 });
            for (shift, name) in (5..).zip(["synthetic", "key_point", "withheld"]) {
                add(name, bit(15, shift));
            }
            add("scan_angle", Reading::Degrees { at: 16, file_type: ColumnType::I8, step: 1.0 });
            add("user_data", value(17, ColumnType::U8));
            add("point_source_id", value(18, ColumnType::U16));
        }
        if let Some(at) = GPS_TIME[format] {
            add("gps_time", value(at, ColumnType::F64));
        }
        let red = RED[format];
        if let Some(at) = red {
            add("red", value(at, ColumnType::U16));
            add("green", value(at + 2, ColumnType::U16));
            add("blue", value(at + 4, ColumnType::U16));
        }
        if let Some(at) = NEAR_INFRARED[format] {
            add("nir", value(at, ColumnType::U16));
        }
        if let Some(at) = WAVE_PACKET[format] {
            add("wavepacket_index", value(at, ColumnType::U8));
            add("wavepacket_offset", value(at + 1, ColumnType::U64));
            add("wavepacket_size", value(at + 9, ColumnType::U32));
            for (place, name) in (13..).step_by(4).zip(["return_point_wave_location", "x_t", "y_t", "z_t"]) {
                add(name, value(at + place, ColumnType::F32));
            }
        }

        // The attributes that are asked for most come first.
        let first = [
            "intensity",
            "return_number",
            "number_of_returns",
            "classification",
            "scan_angle",
            "user_data",
            "point_source_id",
            "gps_time",
            "nir",
        ];
        let mut attributes: Vec<Property> = first
            .iter()
            .filter_map(|name| properties.iter().find(|property| property.name == *name).cloned())
            .collect();
        // Synthetic 1, key point 2, withheld 4, overlap 8, in both families of formats.
        let (shift, mask) = if extended { (0, 15) } else { (5, 7) };
        attributes
            .push(Property { name: "classification_flags".into(), reading: Reading::Bits { at: 15, shift, mask } });
        let further = properties.iter().filter(|property| !first.contains(&property.name.as_str()));
        attributes.extend(further.cloned());

        // The number of dimensions that have this name, or had it before a number was added.
        let mut names: HashMap<String, usize> = HashMap::new();
        names.extend(properties.iter().chain(&attributes).map(|property| (property.name.clone(), 1)));
        for extra in extra_dimensions(BASE_LENGTHS[format], record_length, descriptors, warnings) {
            let mut name = extra.name.clone();
            while let Some(count) = names.get_mut(&name) {
                name = match *count {
                    1 => format!("{} (extra)", extra.name),
                    count => format!("{} (extra {count})", extra.name),
                };
                *count += 1;
            }
            names.insert(name.clone(), 1);
            let property = Property { name, reading: extra.reading };
            if !matches!(property.reading, Reading::Opaque { .. }) {
                attributes.push(property.clone());
            }
            properties.push(property);
        }
        let (near_infrared, wave_packet) = (NEAR_INFRARED[format], WAVE_PACKET[format]);
        Self { record_length, properties, attributes, red, near_infrared, wave_packet, extended }
    }

    /// The number of bytes at the end of a record that no descriptor describes.
    pub fn undescribed(&self) -> usize {
        match self.properties.last() {
            Some(Property { name, reading: Reading::Opaque { length, .. } }) if name.starts_with(UNDESCRIBED) => {
                *length
            }
            _ => 0,
        }
    }

    /// The properties with their types in the file.
    pub fn property_attributes(&self) -> Vec<Attribute> {
        let attribute = |p: &Property| Attribute { name: p.name.clone(), column_type: p.reading.file_type() };
        self.properties.iter().map(attribute).collect()
    }

    /// The selectable attributes with the types to which they are decoded.
    pub fn column_attributes(&self) -> Vec<Attribute> {
        let attribute = |p: &Property| Attribute { name: p.name.clone(), column_type: p.reading.column_type() };
        self.attributes.iter().map(attribute).collect()
    }

    /// The compressed layers that hold the selected properties. Older formats are not layered and ignore the result.
    pub fn layers(&self, positions: bool, colors: bool, attributes: &[bool]) -> DecompressionSelection {
        let mut layers = DecompressionSelection::XY_RETURNS_CHANNEL;
        if positions {
            layers |= DecompressionSelection::Z;
        }
        if colors {
            layers |= DecompressionSelection::RGB;
        }
        for (property, _) in self.attributes.iter().zip(attributes).filter(|&(_, &wanted)| wanted) {
            layers |= self.layer_of(property.reading.at());
        }
        DecompressionSelection(layers)
    }

    /// The layer that contains byte `at` of an extended record.
    fn layer_of(&self, at: usize) -> u32 {
        if !self.extended {
            return DecompressionSelection::ALL;
        }
        match at {
            0..8 | 14 => DecompressionSelection::XY_RETURNS_CHANNEL,
            8..12 => DecompressionSelection::Z,
            12 | 13 => DecompressionSelection::INTENSITY,
            15 => DecompressionSelection::FLAGS,
            16 => DecompressionSelection::CLASSIFICATION,
            17 => DecompressionSelection::USER_DATA,
            18 | 19 => DecompressionSelection::SCAN_ANGLE,
            20 | 21 => DecompressionSelection::POINT_SOURCE_ID,
            22..30 => DecompressionSelection::GPS_TIME,
            _ if self.red.is_some_and(|red| (red..red + 6).contains(&at)) => DecompressionSelection::RGB,
            _ if self.near_infrared == Some(at) => DecompressionSelection::NIR,
            _ if self.wave_packet.is_some_and(|first| (first..first + WAVE_PACKET_LENGTH).contains(&at)) => {
                DecompressionSelection::WAVEPACKET
            }
            _ => DecompressionSelection::ALL_EXTRA_BYTES,
        }
    }
}

/// The dimensions that the Extra Bytes records describe in bytes `at..record_length`; the remaining bytes are one
/// opaque property.
fn extra_dimensions(
    mut at: usize,
    record_length: usize,
    descriptors: &[u8],
    warnings: &mut Vec<String>,
) -> Vec<Property> {
    let mut dimensions = Vec::new();
    let mut undocumented = 0;
    for (index, descriptor) in descriptors.chunks_exact(DESCRIPTOR_LENGTH).enumerate() {
        let (data_type, options) = (descriptor[2], descriptor[3]);
        let mut name = text(&descriptor[4..36]);
        if name.is_empty() {
            name = format!("extra {index}");
        }
        // Types 11 to 20 are pairs and 21 to 30 triples of types 1 to 10 (deprecated since LAS 1.4 R14, still written).
        let (file_type, elements) = match data_type {
            0 => (None, 1),
            1..=30 => (element_type((data_type - 1) % 10 + 1), usize::from((data_type - 1) / 10) + 1),
            _ => {
                warnings.push(format!(
                    "extra dimension \"{name}\" has the unknown type {data_type} (expected 0 to 30): it and what follows it are skipped"
                ));
                break;
            }
        };
        // An undocumented block keeps its length in the options.
        let size = file_type.map_or(usize::from(options), |file_type| file_type.size() * elements);
        if at + size > record_length {
            warnings.push(format!(
                "extra dimension \"{name}\" needs bytes {at} to {} of a record of {record_length}: skipped",
                at + size
            ));
            break;
        }
        match file_type {
            // A field without bytes describes nothing.
            None if size == 0 => {}
            None => {
                if undocumented == 0 {
                    warnings.push(format!(
                        "extra dimension \"{name}\" is {size} bytes of no documented type: listed, not decoded"
                    ));
                }
                undocumented += 1;
                dimensions.push(Property { name, reading: Reading::Opaque { at, length: size } });
            }
            Some(file_type) => {
                for element in 0..elements {
                    let name = if elements == 1 { name.clone() } else { format!("{name}[{element}]") };
                    let at = at + element * file_type.size();
                    let number = |base: usize| f64::from_le_bytes(bytes(descriptor, base + 8 * element));
                    let scale = if options & 8 != 0 { number(112) } else { 1.0 };
                    let offset = if options & 16 != 0 { number(136) } else { 0.0 };
                    let scaling = (options & 24 != 0).then_some((scale, offset));
                    let field = bytes(descriptor, 40 + 8 * element);
                    let no_data = if options & 1 != 0 { NoData::new(field, file_type) } else { None };
                    let reading = match (no_data, scaling) {
                        (Some(no_data), _) => Reading::Sparse { at, file_type, no_data, scaling },
                        (None, Some((scale, offset))) => Reading::Scaled { at, file_type, scale, offset },
                        (None, None) => Reading::Value { at, file_type },
                    };
                    let is_wide = matches!(file_type, ColumnType::U64 | ColumnType::I64);
                    if no_data.is_some() && scaling.is_none() && is_wide {
                        warnings.push(format!(
                            "extra dimension \"{name}\" is {} and has a number for \"no value\": it is read as f64, and numbers \
                             beyond 9,007,199,254,740,992 are rounded",
                            file_type.name()
                        ));
                    }
                    dimensions.push(Property { name, reading });
                }
            }
        }
        at += size;
    }
    if undocumented > 1 {
        warnings.push(format!("{} more extra dimensions are of no documented type", undocumented - 1));
    }
    if at < record_length {
        let length = record_length - at;
        warnings
            .push(format!("{length} bytes of each point are described by no Extra Bytes record: listed, not decoded"));
        dimensions.push(Property { name: UNDESCRIBED.into(), reading: Reading::Opaque { at, length } });
    }
    dimensions
}

fn element_type(data_type: u8) -> Option<ColumnType> {
    Some(match data_type {
        1 => ColumnType::U8,
        2 => ColumnType::I8,
        3 => ColumnType::U16,
        4 => ColumnType::I16,
        5 => ColumnType::U32,
        6 => ColumnType::I32,
        7 => ColumnType::U64,
        8 => ColumnType::I64,
        9 => ColumnType::F32,
        10 => ColumnType::F64,
        _ => return None,
    })
}

/// The text of a fixed field: up to the first NUL, without surrounding blanks.
pub fn text(field: &[u8]) -> String {
    let end = field.iter().position(|&byte| byte == 0).unwrap_or(field.len());
    String::from_utf8_lossy(&field[..end]).trim().to_owned()
}
