//! Finds what the properties of a vertex mean, and turns packed rows into the columns of a chunk.

use std::sync::Arc;

use cloud::{Bounds, Chunk, Column, ColumnType, NO_NORMAL, amid, offset_from, pack_normal};
use glam::{DVec3, Vec3};

use super::packed_splats::SH_C0;
use super::rows::Packing;
use crate::Selection;
use crate::color_range::ColorSample;

/// A scalar property of the vertex: its index among the properties of the element, name and type.
#[derive(Clone, Debug)]
pub struct Scalar {
    pub property: usize,
    pub name: String,
    pub scalar: ColumnType,
}

/// The conversion of a file's colour value to a byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// `value * factor + bias`, clamped to 0 ..= 255.
    Linear { factor: f32, bias: f32 },
    /// The logistic function of the value (opacity of Gaussian splats).
    Logistic,
}

/// The indices of the scalars by their meaning.
#[derive(Clone, Debug, Default)]
pub struct Roles {
    pub position: [usize; 3],
    pub colors: Option<[usize; 3]>,
    /// The scales of red, green and blue; unknown before values have been sampled.
    pub color_scale: Option<[Scale; 3]>,
    pub alpha: Option<(usize, Option<Scale>)>,
    pub normals: Option<[usize; 3]>,
    /// All scalars: first those without another meaning.
    pub attributes: Vec<usize>,
    pub is_splats: bool,
}

/// The names of the colour channels and of their opacity; a set counts only if it is complete.
const COLOR_NAMES: [[&str; 4]; 3] = [
    ["red", "green", "blue", "alpha"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
    ["r", "g", "b", "a"],
];
const NORMAL_NAMES: [[&str; 3]; 3] =
    [["nx", "ny", "nz"], ["normal_x", "normal_y", "normal_z"], ["normalx", "normaly", "normalz"]];

impl Roles {
    /// Finds the roles by name, in upper or lower case; `None` without x, y and z.
    pub fn find(scalars: &[Scalar]) -> Option<Self> {
        let index = |name: &str| scalars.iter().position(|scalar| scalar.name.eq_ignore_ascii_case(name));
        let triple = |names: [&str; 3]| Some([index(names[0])?, index(names[1])?, index(names[2])?]);
        let mut roles = Self { position: triple(["x", "y", "z"])?, ..Self::default() };
        roles.normals = NORMAL_NAMES.into_iter().find_map(triple);
        for [red, green, blue, alpha] in COLOR_NAMES {
            roles.colors = triple([red, green, blue]);
            if roles.colors.is_some() {
                roles.alpha = index(alpha).map(|alpha| (alpha, None));
                break;
            }
        }
        let splat_colors = triple(["f_dc_0", "f_dc_1", "f_dc_2"]);
        roles.is_splats = splat_colors.is_some() && index("scale_0").is_some() && index("rot_0").is_some();
        if roles.is_splats && roles.colors.is_none() {
            roles.colors = splat_colors;
            roles.color_scale = Some([Scale::Linear { factor: SH_C0 * 255.0, bias: 0.5 * 255.0 + 0.5 }; 3]);
            roles.alpha = index("opacity").map(|opacity| (opacity, Some(Scale::Logistic)));
        }
        let mut taken = roles.position.to_vec();
        taken.extend(roles.colors.into_iter().chain(roles.normals).flatten());
        taken.extend(roles.alpha.map(|(alpha, _)| alpha));
        let (others, taken): (Vec<usize>, _) = (0..scalars.len()).partition(|index| !taken.contains(index));
        roles.attributes = [others, taken].concat();
        Some(roles)
    }

    /// The scalars that a selection needs.
    pub fn needed(&self, selection: &Selection) -> Vec<usize> {
        let mut needed = Vec::new();
        if selection.positions {
            needed.extend(self.position);
        }
        if selection.colors {
            needed.extend(self.colors.into_iter().flatten());
            needed.extend(self.alpha.map(|(alpha, _)| alpha));
        }
        if selection.normals {
            needed.extend(self.normals.into_iter().flatten());
        }
        let wanted = std::iter::zip(&self.attributes, &selection.attributes).filter(|&(_, &wanted)| wanted);
        needed.extend(wanted.map(|(&index, _)| index));
        needed
    }
}

/// The scale of colours of type `scalar`, and what is worth a word about it: bytes are unchanged; of wider integers the
/// upper eight bits of their range are taken.
pub fn color_scale(scalar: ColumnType, sample: &ColorSample) -> (Scale, Option<String>) {
    let linear = |factor: f64, bias: f32| Scale::Linear { factor: factor as f32, bias };
    match scalar {
        ColumnType::U8 | ColumnType::I8 => (linear(1.0, 0.0), None),
        ColumnType::F32 | ColumnType::F64 => {
            let range = sample.of_floats();
            // 0.5 rounds to the nearest byte; 65535 / 257 = 255.
            (linear(255.0 / range.full, 0.5), range.warning)
        }
        _ => {
            let range = sample.of_integers();
            (linear(256.0 / (range.full + 1.0), 0.0), range.warning)
        }
    }
}

impl Scale {
    #[inline]
    fn apply(self, value: f64) -> u8 {
        // `as` clamps, and turns NaN into 0.
        match self {
            Self::Linear { factor, bias } => (value as f32 * factor + bias) as u8,
            Self::Logistic => (255.0 / (1.0 + (-value as f32).exp()) + 0.5) as u8,
        }
    }

    /// A value as a channel of colour of 16 bits.
    fn apply_wide(self, value: f64) -> u16 {
        match self {
            // Of integers, a byte is the upper bits of the range: `factor` is 256 / (full + 1).
            Self::Linear { factor, bias: 0.0 } => {
                let full = 256.0 / f64::from(factor) - 1.0;
                (value * (65_535.0 / full) + 0.5) as u16
            }
            Self::Linear { factor, bias } => {
                (value * (f64::from(factor) * 257.0) + (f64::from(bias) - 0.5) * 257.0 + 0.5) as u16
            }
            Self::Logistic => u16::from(self.apply(value)) * 257,
        }
    }
}

/// A scalar's place in a packed row.
#[derive(Clone, Copy, Debug)]
struct Field {
    offset: usize,
    scalar: ColumnType,
}

/// Decodes the selected columns of packed rows.
#[derive(Clone, Debug)]
pub struct RowDecoder {
    stride: usize,
    big_endian: bool,
    position: Option<[Field; 3]>,
    colors: Option<([Field; 3], [Scale; 3])>,
    alpha: Option<(Field, Scale)>,
    normals: Option<[Field; 3]>,
    columns: Vec<Option<Field>>,
}

impl RowDecoder {
    pub fn new(scalars: &[Scalar], roles: &Roles, selection: &Selection, packing: &Packing) -> Self {
        let field = |index: usize| {
            let Scalar { property, scalar, .. } = scalars[index];
            packing.offsets[property].map(|offset| Field { offset, scalar })
        };
        let triple = |indices: [usize; 3]| Some([field(indices[0])?, field(indices[1])?, field(indices[2])?]);
        let identity = Scale::Linear { factor: 1.0, bias: 0.0 };
        let colors = roles.colors.filter(|_| selection.colors).and_then(triple);
        let alpha = roles.alpha.filter(|_| selection.colors);
        let wants = |column: usize| selection.attributes.get(column) == Some(&true);
        Self {
            stride: packing.stride,
            big_endian: packing.big_endian,
            position: triple(roles.position).filter(|_| selection.positions),
            colors: colors.map(|fields| (fields, roles.color_scale.unwrap_or([identity; 3]))),
            alpha: alpha.and_then(|(index, scale)| Some((field(index)?, scale.unwrap_or(identity)))),
            normals: roles.normals.filter(|_| selection.normals).and_then(triple),
            columns: std::iter::zip(0.., &roles.attributes)
                .map(|(column, &index)| if wants(column) { field(index) } else { None })
                .collect(),
        }
    }
}

/// A number type as stored in a row.
trait Number: Copy {
    fn read<const BIG: bool>(row: &[u8], offset: usize) -> Self;
    fn to_f64(self) -> f64;
}

macro_rules! numbers {
    ($($number:ty)*) => {$(
        impl Number for $number {
            #[inline(always)]
            fn read<const BIG: bool>(row: &[u8], offset: usize) -> Self {
                let mut bytes = [0; size_of::<Self>()];
                bytes.copy_from_slice(&row[offset..offset + size_of::<Self>()]);
                if BIG { Self::from_be_bytes(bytes) } else { Self::from_le_bytes(bytes) }
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
        }
    )*};
}
numbers!(u8 i8 u16 i16 u32 i32 u64 i64 f32 f64);

/// Runs `$body` with the type that `$scalar` names as `$number`.
macro_rules! with_type {
    ($scalar:expr, $number:ident => $body:expr) => {
        match $scalar {
            ColumnType::U8 => {
                type $number = u8;
                $body
            }
            ColumnType::I8 => {
                type $number = i8;
                $body
            }
            ColumnType::U16 => {
                type $number = u16;
                $body
            }
            ColumnType::I16 => {
                type $number = i16;
                $body
            }
            ColumnType::U32 => {
                type $number = u32;
                $body
            }
            ColumnType::I32 => {
                type $number = i32;
                $body
            }
            ColumnType::U64 => {
                type $number = u64;
                $body
            }
            ColumnType::I64 => {
                type $number = i64;
                $body
            }
            ColumnType::F32 => {
                type $number = f32;
                $body
            }
            ColumnType::F64 => {
                type $number = f64;
                $body
            }
        }
    };
}

/// Calls `give` with every value of one field, as f64 (which holds all PLY types but 64-bit integers exactly).
fn each_value<const BIG: bool>(rows: &[u8], stride: usize, field: Field, mut give: impl FnMut(usize, f64)) {
    with_type!(field.scalar, T => {
        for (index, row) in rows.chunks_exact(stride).enumerate() {
            give(index, T::read::<BIG>(row, field.offset).to_f64());
        }
    });
}

/// Calls `give` with every value of a scalar among packed rows that hold all scalars.
pub fn sampled(rows: &[u8], scalar: &Scalar, packing: &Packing, mut give: impl FnMut(f64)) {
    let Some(offset) = packing.offsets[scalar.property] else { return };
    let field = Field { offset, scalar: scalar.scalar };
    if packing.big_endian {
        each_value::<true>(rows, packing.stride, field, |_, value| give(value));
    } else {
        each_value::<false>(rows, packing.stride, field, |_, value| give(value));
    }
}

/// Appends triples of numbers as f32.
fn extend_triples<const BIG: bool>(triples: &mut Vec<[f32; 3]>, rows: &[u8], stride: usize, fields: [Field; 3]) {
    if fields.iter().all(|field| field.scalar == ColumnType::F32) {
        let [x, y, z] = fields.map(|field| field.offset);
        triples.extend(
            rows.chunks_exact(stride)
                .map(|row| [f32::read::<BIG>(row, x), f32::read::<BIG>(row, y), f32::read::<BIG>(row, z)]),
        );
        return;
    }
    let start = triples.len();
    triples.resize(start + rows.len() / stride, [0.0; 3]);
    for (axis, field) in fields.into_iter().enumerate() {
        each_value::<BIG>(rows, stride, field, |index, value| triples[start + index][axis] = value as f32);
    }
}

/// A chunk that is built from packed rows.
pub struct ChunkBuilder<'a> {
    plan: &'a RowDecoder,
    first_point: u64,
    rows: usize,
    /// Coordinates of a type that f32 holds exactly; `doubles` has those of wider types.
    floats: Vec<[f32; 3]>,
    extent: Extent,
    doubles: Vec<[f64; 3]>,
    colors: Vec<[u8; 4]>,
    normals: Vec<u32>,
    columns: Vec<Option<Column>>,
}

impl<'a> ChunkBuilder<'a> {
    /// `capacity` is a number of rows that are known to be in the file.
    pub fn new(plan: &'a RowDecoder, first_point: u64, capacity: usize) -> Self {
        let fits_f32 = plan.position.is_some_and(fit_f32);
        let capacity_if = |wanted: bool| if wanted { capacity } else { 0 };
        Self {
            plan,
            first_point,
            rows: 0,
            floats: Vec::with_capacity(capacity_if(plan.position.is_some() && fits_f32)),
            extent: Extent::EMPTY,
            doubles: Vec::with_capacity(capacity_if(plan.position.is_some() && !fits_f32)),
            colors: Vec::with_capacity(capacity_if(plan.colors.is_some())),
            normals: Vec::with_capacity(capacity_if(plan.normals.is_some())),
            columns: (plan.columns.iter())
                .map(|field| field.map(|field| Column::with_capacity(field.scalar, capacity)))
                .collect(),
        }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn push(&mut self, rows: &[u8]) {
        if self.plan.big_endian { self.push_rows::<true>(rows) } else { self.push_rows::<false>(rows) }
    }

    fn push_rows<const BIG: bool>(&mut self, rows: &[u8]) {
        let (plan, stride) = (self.plan, self.plan.stride);
        let (start, count) = (self.rows, rows.len() / stride);
        self.rows += count;
        if let Some(fields) = plan.position {
            if fit_f32(fields) {
                extend_triples::<BIG>(&mut self.floats, rows, stride, fields);
                self.extent.include(&mut self.floats[start..]);
            } else {
                self.doubles.resize(start + count, [0.0; 3]);
                for (axis, field) in fields.into_iter().enumerate() {
                    let doubles = &mut self.doubles[start..];
                    each_value::<BIG>(rows, stride, field, |index, value| doubles[index][axis] = value);
                }
            }
        }
        if let Some((fields, scales)) = plan.colors {
            let [red, green, blue] = fields.map(|field| field.offset);
            if fields.iter().all(|field| matches!(field.scalar, ColumnType::U8 | ColumnType::I8)) {
                self.colors.extend(rows.chunks_exact(stride).map(|row| [row[red], row[green], row[blue], 255]));
            } else {
                self.colors.resize(start + count, [0, 0, 0, 255]);
                for (channel, field) in fields.into_iter().enumerate() {
                    let colors = &mut self.colors[start..];
                    each_byte::<BIG>(rows, stride, field, scales[channel], |index, byte| colors[index][channel] = byte);
                }
            }
            if let Some((field, scale)) = plan.alpha {
                let colors = &mut self.colors[start..];
                each_byte::<BIG>(rows, stride, field, scale, |index, byte| colors[index][3] = byte);
            }
        }
        if let Some(fields) = plan.normals {
            let mut normals = Vec::with_capacity(count);
            extend_triples::<BIG>(&mut normals, rows, stride, fields);
            self.normals.extend(normals.into_iter().map(|normal| {
                let normal = Vec3::from(normal);
                if normal.is_finite() { pack_normal(normal) } else { NO_NORMAL }
            }));
        }
        for (column, field) in std::iter::zip(&mut self.columns, &plan.columns) {
            if let (Some(column), Some(field)) = (column, field) {
                extend_column::<BIG>(column, rows, stride, field.offset);
            }
        }
    }

    /// The chunk, and the bounds of its finite points.
    pub fn finish(self) -> (Chunk, Bounds) {
        let (mut chunk, bounds) = if self.plan.position.is_some_and(|fields| !fit_f32(fields)) {
            doubles_to_chunk(self.first_point, self.doubles)
        } else {
            floats_to_chunk(self.first_point, self.floats, self.extent)
        };
        chunk.colors = self.plan.colors.is_some().then(|| Arc::new(self.colors));
        chunk.normals = self.plan.normals.is_some().then(|| Arc::new(self.normals));
        chunk.columns = self.columns.into_iter().map(|column| column.map(Arc::new)).collect();
        (chunk, bounds)
    }
}

/// Whether f32 holds every value of these types.
fn fit_f32(fields: [Field; 3]) -> bool {
    fields.iter().all(|field| {
        matches!(field.scalar, ColumnType::F32 | ColumnType::U8 | ColumnType::I8 | ColumnType::U16 | ColumnType::I16)
    })
}

#[inline(always)]
fn each_byte<const BIG: bool>(rows: &[u8], stride: usize, field: Field, scale: Scale, mut give: impl FnMut(usize, u8)) {
    if matches!(field.scalar, ColumnType::U8 | ColumnType::I8) {
        // A signed byte is an unsigned one under the wrong name.
        rows.chunks_exact(stride).enumerate().for_each(|(index, row)| give(index, row[field.offset]));
    } else {
        each_value::<BIG>(rows, stride, field, |index, value| give(index, scale.apply(value)));
    }
}

fn extend_column<const BIG: bool>(column: &mut Column, rows: &[u8], stride: usize, offset: usize) {
    macro_rules! extend {
        ($values:expr, $number:ty) => {
            $values.extend(rows.chunks_exact(stride).map(|row| <$number>::read::<BIG>(row, offset)))
        };
    }
    match column {
        Column::U8(values) => extend!(values, u8),
        Column::I8(values) => extend!(values, i8),
        Column::U16(values) => extend!(values, u16),
        Column::I16(values) => extend!(values, i16),
        Column::U32(values) => extend!(values, u32),
        Column::I32(values) => extend!(values, i32),
        Column::U64(values) => extend!(values, u64),
        Column::I64(values) => extend!(values, i64),
        Column::F32(values) => extend!(values, f32),
        Column::F64(values) => extend!(values, f64),
    }
}

/// The least and greatest coordinates in f32.
#[derive(Clone, Copy)]
struct Extent {
    least: [f32; 3],
    greatest: [f32; 3],
}

impl Extent {
    const EMPTY: Self = Self { least: [f32::INFINITY; 3], greatest: [f32::NEG_INFINITY; 3] };

    /// Includes points; points that are not finite become NaN.
    fn include(&mut self, points: &mut [[f32; 3]]) {
        for point in points {
            // The sum is 0 for finite numbers and NaN for all others.
            let [x, y, z] = *point;
            if x * 0.0 + y * 0.0 + z * 0.0 == 0.0 {
                for axis in 0..3 {
                    let value = point[axis];
                    self.least[axis] = if value < self.least[axis] { value } else { self.least[axis] };
                    self.greatest[axis] = if value > self.greatest[axis] { value } else { self.greatest[axis] };
                }
            } else {
                *point = [f32::NAN; 3];
            }
        }
    }

    fn bounds(&self) -> Bounds {
        let [min, max] = [self.least, self.greatest].map(|corner| Vec3::from(corner).as_dvec3());
        if min.cmple(max).all() { Bounds { min, max } } else { Bounds::EMPTY }
    }
}

/// Makes a chunk of coordinates wider than f32, and its bounds. It keeps the doubles only if offsets cannot represent
/// them.
fn doubles_to_chunk(first_point: u64, doubles: Vec<[f64; 3]>) -> (Chunk, Bounds) {
    let amid = amid(doubles.len(), |index| DVec3::from(doubles[index]));
    let origin = amid.map_or(DVec3::ZERO, |amid| {
        let own = DVec3::from(doubles[amid.index]);
        // Whole units keep origins short; in a cloud smaller than a unit they would use up the digits of offsets.
        if amid.reach >= 1.0 { own.round() } else { own }
    });
    let mut positions = Vec::with_capacity(doubles.len());
    let (mut bounds, mut is_exact) = (Bounds::EMPTY, true);
    for &exact in &doubles {
        let exact = DVec3::from(exact);
        let offset = offset_from(origin, exact);
        is_exact &= origin + Vec3::from(offset).as_dvec3() == exact;
        if !offset[0].is_nan() {
            bounds.include(exact);
        }
        positions.push(offset);
    }
    let mut chunk = Chunk::new(first_point, origin, positions);
    chunk.exact_positions = (!is_exact).then(|| Arc::new(doubles));
    (chunk, bounds)
}

/// How many times as far as the points of a chunk reach they are from 0 where some bits of their f32 are equal in most
/// of them.
const FAR: f64 = 16.0;
/// The least number of points among which one may be a stray that offsets cannot represent.
const FEW: usize = 10;

/// Makes a chunk of f32 coordinates. Along each axis its origin is 0, which is exact; or amid the points, if those are
/// far away (map coordinates) and stay exact: then the renderer works with small numbers. If only strays do not stay
/// exact, the chunk keeps the file's coordinates for them.
fn floats_to_chunk(first_point: u64, floats: Vec<[f32; 3]>, extent: Extent) -> (Chunk, Bounds) {
    let bounds = extent.bounds();
    let place = |index: usize| Vec3::from(floats[index]).as_dvec3();
    let origin = amid(floats.len(), place).map_or(DVec3::ZERO, |amid| {
        let own = place(amid.index);
        DVec3::select(own.abs().cmpgt(DVec3::splat(FAR * amid.reach)), own.round(), DVec3::ZERO)
    });
    if origin != DVec3::ZERO {
        let mut rounded = 0;
        let offset = |position: &[f32; 3]| {
            let place = Vec3::from(*position).as_dvec3();
            let offset = offset_from(origin, place);
            rounded += usize::from(!position[0].is_nan() && origin + Vec3::from(offset).as_dvec3() != place);
            offset
        };
        let offsets: Vec<_> = floats.iter().map(offset).collect();
        if rounded * FEW <= floats.len() {
            let mut chunk = Chunk::new(first_point, origin, offsets);
            let exact = || Arc::new(floats.iter().map(|position| position.map(f64::from)).collect());
            chunk.exact_positions = (rounded > 0).then(exact);
            return (chunk, bounds);
        }
    }
    (Chunk::new(first_point, DVec3::ZERO, floats), bounds)
}

/// All values of a scalar among packed rows that hold all scalars.
pub fn column(rows: &[u8], scalar: &Scalar, packing: &Packing) -> Column {
    let mut column = Column::with_capacity(scalar.scalar, rows.len() / packing.stride);
    if let Some(offset) = packing.offsets[scalar.property] {
        if packing.big_endian {
            extend_column::<true>(&mut column, rows, packing.stride, offset);
        } else {
            extend_column::<false>(&mut column, rows, packing.stride, offset);
        }
    }
    column
}

/// All values of a channel of colour among packed rows, with 16 bits.
pub fn color_column(rows: &[u8], scalar: &Scalar, packing: &Packing, scale: Scale) -> Column {
    let values = column(rows, scalar, packing);
    Column::U16((0..values.len()).map(|index| scale.apply_wide(values.value(index))).collect())
}
