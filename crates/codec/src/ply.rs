//! Reads PLY: ascii and binary of either byte order, any properties in any order, lists anywhere, elements in any
//! order.
//!
//! Opening a file finds the vertex rows that are really in it (`ply/rows.rs`) and decides its conventions from a sample
//! spread over it: the range of the colours, and whether all normals are zero. Reading turns blocks of rows into chunks
//! on all cores (`ply/columns.rs`), in an order that covers the extent of the file early. Text and rows with lists are
//! first made into rows of fixed size, so that one decoder serves every encoding.
//!
//! The `ply-rs` crate is not used to read, only to check this reader in its tests. Its header keeps the properties of
//! an element in a map, so that a repeated name shifts every column after it; it requires UTF-8 in comments and refuses
//! names that CloudCompare writes (`scalar_Illuminance_(PCV)`); its text rows do not accept `nan`, `1.` or `.5`; and it
//! reads a file from its start, on one core.

pub(crate) mod columns;
mod faces;
pub(crate) mod header;
mod lines;
pub(crate) mod maker;
pub(crate) mod number;
mod packed_splats;
pub(crate) mod reader;
mod row_columns;
pub(crate) mod rows;

use std::io::Read as _;
use std::sync::{Arc, Mutex};

use cloud::{Attribute, Bounds, Chunk, Progress};
use glam::DVec3;
use rayon::prelude::*;

use crate::brief::brief;
use crate::bytes::Bytes;
use crate::color_range::ColorSample;
use crate::{Error, Format, Info, Result, Selection, Summary};
use columns::{ChunkBuilder, Roles, RowDecoder, Scalar, Scale};
pub use header::is_ply;
use header::{Element, Encoding, Header, Kind, MAX_HEADER_BYTES};
use maker::RowMaker;
use packed_splats::PackedSplats;
use reader::Reader;
use row_columns::placeless_points;
use rows::{Block, Packing, Rows};

/// Faces are counted on opening if at most this many bytes follow the vertices: a tenth of a second from memory.
const FACE_CHECK_BYTES: u64 = 256 << 20;

/// The number of lists that a warning names.
const NAMED_LISTS: usize = 8;

/// An opened PLY file, or one of another format that has points in rows. It stays open, so that it is read to the end even
/// if it is deleted or replaced.
pub struct RowSource {
    pub(crate) info: Info,
    file: Arc<Bytes>,
    header: Header,
    /// The index of the vertex element.
    vertex: usize,
    rows: Rows,
    /// What makes the rows of compressed splats and of other formats.
    maker: Option<Box<dyn RowMaker>>,
    scalars: Vec<Scalar>,
    roles: Roles,
}

/// A place that lies this many times as far outside of the points as these reach, and that nobody may have written down, is
/// not the scanner's. A window of three degrees is scanned from so far away.
const FARTHEST_SCANNER: f64 = 20.0;
/// Of fewer points it is not said that they are far from the scanner.
const FEWEST_SAMPLED: usize = 16;

/// What another format has found of a cloud whose rows it makes.
pub struct Made {
    pub maker: Box<dyn RowMaker>,
    pub rows: Rows,
    /// Whether a row begins at each line end of the file.
    pub is_text: bool,
    pub newline: u8,
    /// The scales of red, green and blue, where the file gives them.
    pub color_scale: Option<[Scale; 3]>,
    /// Everything that the rows do not say.
    pub info: Info,
}

impl RowSource {
    pub fn open(file: Arc<Bytes>) -> Result<Self> {
        let path = file.path();
        let io_error = |error| Error::io(path, error);
        let mut start = Vec::new();
        file.section(0, file.length().min(MAX_HEADER_BYTES as u64)).read_to_end(&mut start).map_err(io_error)?;
        let mut header = Header::parse(&start)
            .map_err(|error| Error::malformed(path, format!("header line {}", error.line), error.problem))?;
        drop(start);

        let header_error = |problem: String| Error::malformed(path, "header", problem);
        let vertex = header.points_element().ok_or_else(|| header_error("no element vertex".into()))?;
        let mut warnings = header.elements[vertex].tell_apart("property");
        let further = header.further_vertices(vertex);
        if further > 0 {
            let several = "the header has several elements vertex";
            let (points, are) = if further == 1 { ("point", "is") } else { ("points", "are") };
            warnings.push(format!("{several}: {further} {points} of others than the first {are} not read"));
        }
        let splats = PackedSplats::open(&file, &header, vertex).map_err(io_error)?.map_err(header_error)?;
        let element = splats.as_ref().map_or(&header.elements[vertex], RowMaker::element);
        let scalars = scalars(element);
        let mut roles = Roles::find(&scalars).ok_or_else(|| {
            header_error(format!("element {} has no scalar properties x, y and z", brief(&element.name)))
        })?;

        let rows = rows::locate(&file, &header, vertex).map_err(io_error)?;
        if header.encoding == Encoding::Ascii {
            check_length(&rows, element).map_err(header_error)?;
        }
        if rows.count < element.count {
            let reason = rows.problem.as_deref().unwrap_or("the file ends early");
            let (lost, declared) = (element.count - rows.count, element.count);
            warnings.push(format!("{lost} of {declared} vertices are missing: {reason}"));
        }
        warnings.extend(list_warning(element));
        if header.encoding == Encoding::Ascii {
            let position = roles.position.map(|index| scalars[index].property);
            if let Some((line, problem)) =
                lines::unreadable_line(&file, &rows, &header, element, position).map_err(io_error)?
            {
                return Err(Error::malformed(path, format!("line {line}"), problem));
            }
            warnings.extend(lines::check_lines(&file, &rows, &header, element).map_err(io_error)?);
        }
        let maker = splats.as_ref().map(|splats| splats as &dyn RowMaker);
        let packing = Packing::new(&header, element, maker, vec![true; element.properties.len()]);
        decide_conventions(&file, &packing, &rows, &scalars, &mut roles, &mut warnings).map_err(io_error)?;
        warnings.extend(face_warnings(&file, &header, vertex, &rows).map_err(io_error)?);

        let attribute = |scalar: &Scalar| Attribute { name: scalar.name.clone(), column_type: scalar.scalar };
        let polygons = header.elements.iter().filter(|element| faces::is_polygons(element));
        let info = Info {
            points: rows.count,
            missing: element.count.saturating_sub(rows.count),
            properties: scalars.iter().map(attribute).collect(),
            attributes: roles.attributes.iter().map(|&index| attribute(&scalars[index])).collect(),
            has_colors: roles.colors.is_some(),
            has_normals: roles.normals.is_some(),
            faces: polygons.fold(0, |faces, element| faces.saturating_add(element.count)),
            warnings,
            ..Info::of_rows(path, Format::Ply, header.format.clone())
        };
        let maker = splats.map(|splats| Box::new(splats) as Box<dyn RowMaker>);
        Ok(Self { info, file, header, vertex, rows, maker, scalars, roles })
    }

    /// A cloud of another format.
    ///
    /// # Errors
    /// If the file cannot be read; if the rows have no coordinates.
    pub fn made(file: Arc<Bytes>, made: Made) -> Result<Self> {
        let Made { maker, rows, is_text, newline, color_scale, mut info } = made;
        let encoding = if is_text { Encoding::Ascii } else { Encoding::LittleEndian };
        let header = Header { encoding, format: info.version.clone(), elements: Vec::new(), length: 0, newline };
        let element = maker.element();
        let scalars = scalars(element);
        let mut roles = Roles::find(&scalars)
            .ok_or_else(|| Error::malformed(&info.path, "header", "no columns x, y and z among those of a point"))?;
        roles.color_scale = color_scale.filter(|_| roles.colors.is_some());
        let packing = Packing::new(&header, element, Some(maker.as_ref()), vec![true; element.properties.len()]);
        if let Err(error) = decide_conventions(&file, &packing, &rows, &scalars, &mut roles, &mut info.warnings) {
            // The read reports which points are missing.
            info.warnings.push(format!("some points cannot be read: {error}"));
        }
        // The numbers of a sample's rows are not known.
        drop(maker.doubt());
        let attribute = |scalar: &Scalar| Attribute { name: scalar.name.clone(), column_type: scalar.scalar };
        info.points = rows.count;
        info.properties = scalars.iter().map(attribute).collect();
        info.attributes = roles.attributes.iter().map(|&index| attribute(&scalars[index])).collect();
        (info.has_colors, info.has_normals) = (roles.colors.is_some(), roles.normals.is_some());
        Ok(Self { info, file, header, vertex: 0, rows, maker: Some(maker), scalars, roles })
    }

    pub fn info(&self) -> &Info {
        &self.info
    }

    /// Notes what is wrong with other scans of the same file, which cannot be opened.
    pub fn lose(&mut self, lost: Vec<String>) {
        self.info.lost = param::few(lost, "scans that cannot be read");
    }

    /// The same, without a scanner at 0, 0, 0 that lies far outside of its points: whoever exports points in coordinates of
    /// the world often leaves the pose of the scanner empty. Another place has moved the points, or was written down.
    pub fn doubting_scanner(mut self) -> Self {
        let Some(place) = self.info.scanner().filter(|place| *place == DVec3::ZERO) else { return self };
        let reaches = |sample: fn(&Bytes, &Rows, &Packing<'_>) -> std::io::Result<Vec<u8>>| {
            let bounds = self.sampled_bounds(place, sample)?;
            Some([place.distance(place.clamp(bounds.min, bounds.max)), bounds.size().length()])
        };
        let is_far = |[distance, reach]: &[f64; 2]| *distance > FARTHEST_SCANNER * reach;
        // The first rows of blocks may lie side by side, or have no places, so whole blocks decide what these leave in doubt.
        let first = reaches(rows::sample);
        let all = if first.as_ref().is_none_or(is_far) { reaches(rows::thorough_sample) } else { first };
        if let Some([distance, reach]) = all.filter(is_far) {
            self.info.warnings.push(format!(
                "the scanner stood at 0 0 0 by the file, {distance:.0} away from points that reach over {reach:.2}: its \
                 place is taken as unknown"
            ));
            self.info.scan.iter_mut().for_each(|scan| scan.position = None);
        }
        self
    }

    /// Where the points of a sample lie, without those at one place and without strays; `None` if they are too few.
    fn sampled_bounds(
        &self,
        without: DVec3,
        sample: fn(&Bytes, &Rows, &Packing<'_>) -> std::io::Result<Vec<u8>>,
    ) -> Option<Bounds> {
        let mut keep = vec![false; self.element().properties.len()];
        let fields = self.roles.position.map(|index| &self.scalars[index]);
        fields.iter().for_each(|field| keep[field.property] = true);
        let packing = self.packing(keep);
        let sample = sample(&self.file, &self.rows, &packing).ok()?;
        // The numbers of a sample's rows are not known.
        self.maker.iter().for_each(|maker| drop(maker.doubt()));
        let [x, y, z] = fields.map(|field| {
            let mut values = Vec::new();
            columns::sampled(&sample, field, &packing, |value| values.push(value));
            values
        });
        let places = std::iter::zip(x, std::iter::zip(y, z)).map(|(x, (y, z))| DVec3::new(x, y, z));
        let places: Vec<DVec3> = places.filter(|place| place.is_finite() && *place != without).collect();
        if places.len() < FEWEST_SAMPLED {
            return None;
        }
        let strays = places.len() / 50;
        let mut bounds = Bounds::EMPTY;
        for axis in 0..3 {
            let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
            along.sort_unstable_by(f64::total_cmp);
            (bounds.min[axis], bounds.max[axis]) = (along[strays], along[along.len() - 1 - strays]);
        }
        Some(bounds)
    }

    pub fn bytes(&self) -> &Bytes {
        &self.file
    }

    /// The element whose rows are the points, as they are when they are unpacked.
    fn element(&self) -> &Element {
        self.maker.as_ref().map_or_else(|| &self.header.elements[self.vertex], |maker| maker.element())
    }

    /// How rows of the file become packed rows with the properties that `keep` names.
    fn packing(&self, keep: Vec<bool>) -> Packing<'_> {
        Packing::new(&self.header, self.element(), self.maker.as_deref(), keep)
    }

    /// The scales of red, green and blue.
    pub fn color_scale(&self) -> Option<[Scale; 3]> {
        self.roles.color_scale
    }

    /// All points in one chunk, of a file whose rows are one block.
    ///
    /// # Errors
    /// If some of them cannot be read.
    pub fn read_whole(&self, selection: &Selection) -> Result<Chunk> {
        let whole = Mutex::new(None);
        let put = |chunk: Chunk| drop(lock(&whole).replace(chunk));
        let summary = self.read_in_chunks(selection, &Progress::default(), self.rows.count as usize, &put)?;
        let whole = whole.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        match whole {
            Some(chunk) if summary.warnings.is_empty() => Ok(chunk),
            Some(_) => Err(Error::unsuitable(&self.info.path, summary.warnings.join("; "))),
            None => Ok(Chunk::new(0, DVec3::ZERO, Vec::new())),
        }
    }

    pub fn read(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        self.read_in_chunks(selection, progress, rows::chunk_points(self.element()), emit)
    }

    /// Reads chunks of up to `most` points.
    fn read_in_chunks(
        &self,
        selection: &Selection,
        progress: &Progress,
        most: usize,
        emit: &(dyn Fn(Chunk) + Sync),
    ) -> Result<Summary> {
        let needed = self.roles.needed(selection);
        let mut keep = vec![false; self.element().properties.len()];
        for &index in &needed {
            keep[self.scalars[index].property] = true;
        }
        if needed.is_empty() {
            // Only the number of points is needed: one scalar per point gives it.
            keep[self.scalars[self.roles.position[0]].property] = true;
        }
        let packing = self.packing(keep);
        let plan = RowDecoder::new(&self.scalars, &self.roles, selection, &packing);

        progress.set_total(self.rows.count);
        let totals =
            Mutex::new(Totals { points: 0, bounds: Bounds::EMPTY, placeless: 0, damaged: 0, unread: 0, error: None });
        spread_order(self.rows.blocks.len()).into_par_iter().with_max_len(1).for_each(|index| {
            if progress.is_cancelled() {
                return;
            }
            let block = self.rows.blocks[index];
            let read = read_block(&self.file, (block, most), &packing, &plan, |chunk, rows, bounds| {
                let placeless = placeless_points(&chunk);
                emit(chunk);
                progress.add(rows);
                let mut totals = lock(&totals);
                totals.points += rows;
                totals.placeless += placeless;
                totals.bounds = totals.bounds.union(bounds);
            });
            let mut totals = lock(&totals);
            match read {
                Ok((rows, damaged)) => {
                    totals.damaged += damaged;
                    totals.unread += block.rows - rows;
                }
                Err(error) => {
                    totals.unread += block.rows;
                    totals.error.get_or_insert(error);
                }
            }
        });

        let totals = totals.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        let (mut warnings, noun) = (Vec::new(), self.noun());
        if totals.damaged > 0 {
            warnings.push(format!("{} of {} {noun} {}", totals.damaged, totals.points, self.damage()));
        }
        warnings.extend(self.placeless_warning(totals.placeless, totals.damaged));
        match totals.error {
            Some(error) if totals.points == 0 => return Err(Error::io(&self.info.path, error)),
            Some(error) => warnings.push(format!("{} {noun} could not be read: {error}", totals.unread)),
            None if totals.unread > 0 => {
                warnings.push(format!("{} {noun} are gone: the file was changed", totals.unread));
            }
            None => {}
        }
        Ok(Summary {
            points: totals.points,
            missing: 0,
            bounds: (!totals.bounds.is_empty()).then_some(totals.bounds),
            warnings,
            cancelled: progress.is_cancelled(),
        })
    }

    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        let path = &self.info.path;
        let fail = |problem: String| Error::malformed(path, format!("vertex {point}"), problem);
        if point >= self.rows.count {
            return Err(fail(format!("the file has {}", self.rows.count)));
        }
        let io_error = |error| Error::io(path, error);
        let block = self.rows.blocks.partition_point(|block| block.first_row <= point) - 1;
        let block = self.rows.blocks[block];
        let record = match &self.maker {
            Some(maker) => maker.record(&self.file, block, point),
            None => rows::record(&self.file, &self.header, self.element(), block, point),
        };
        record.map_err(io_error)?.ok_or_else(|| fail("the file was changed since it was opened".into()))
    }

    pub fn is_mesh(&self) -> bool {
        self.header.elements.iter().any(|element| faces::is_surface(element) && element.count > 0)
    }

    /// What the file calls a point, for many of them.
    fn noun(&self) -> &'static str {
        if self.info.format == Format::Ply { "vertices" } else { "points" }
    }

    /// What a damaged row is, as the end of a sentence about points.
    fn damage(&self) -> String {
        let of_text = "have text that is not a number, or too few numbers; NaN or 0 stands for it, and points without a \
                       place are left out";
        self.maker.as_ref().map_or_else(|| of_text.to_owned(), |maker| maker.damage().to_owned() + &maker.doubt())
    }

    pub fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        if !self.is_mesh() {
            return Ok(Vec::new());
        }
        let triangles = faces::read(&self.file, &self.header, self.vertex, &self.rows);
        triangles.map_err(|error| match error {
            faces::FaceError::Io(error) => Error::io(&self.info.path, error),
            faces::FaceError::Malformed { place, problem } => Error::malformed(&self.info.path, place, problem),
        })
    }
}

/// The totals to which all threads of a read add.
struct Totals {
    points: u64,
    bounds: Bounds,
    placeless: u64,
    damaged: u64,
    unread: u64,
    error: Option<std::io::Error>,
}

/// Locks the totals. A panic in `emit` poisons the lock, but the counts are still correct.
fn lock<T>(totals: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    totals.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Reads a block and emits its chunks, of `most` rows each, with their rows and bounds. Returns the number of rows read
/// and of damaged rows.
fn read_block(
    file: &Bytes,
    (block, most): (Block, usize),
    packing: &Packing,
    plan: &RowDecoder,
    mut give: impl FnMut(Chunk, u64, Bounds),
) -> std::io::Result<(u64, u64)> {
    let capacity = (block.rows as usize).min(most);
    let mut builder = ChunkBuilder::new(plan, block.first_row, capacity);
    let mut first_row = block.first_row;
    let mut finish = |builder: ChunkBuilder| {
        let rows = builder.rows() as u64;
        let (chunk, bounds) = builder.finish();
        give(chunk, rows, bounds);
    };
    let counts = packing.read(file, block, |mut piece| {
        while !piece.is_empty() {
            let room = (most - builder.rows()) * packing.stride;
            let (now, later) = piece.split_at(room.min(piece.len()));
            builder.push(now);
            piece = later;
            if builder.rows() == most {
                first_row += most as u64;
                let rest = (block.rows - (first_row - block.first_row)) as usize;
                let next = ChunkBuilder::new(plan, first_row, rest.min(most));
                finish(std::mem::replace(&mut builder, next));
            }
        }
    });
    if builder.rows() > 0 {
        finish(builder);
    }
    counts
}

/// The numbers from 0 to `count` with their bits reversed: any prefix is spread evenly over the range.
fn spread_order(count: usize) -> Vec<usize> {
    let bits = count.next_power_of_two().trailing_zeros();
    if bits == 0 {
        return (0..count).collect();
    }
    (0..1_usize << bits).map(|i| i.reverse_bits() >> (usize::BITS - bits)).filter(|&index| index < count).collect()
}

fn scalars(element: &Element) -> Vec<Scalar> {
    let scalar = |(property, definition): (usize, &header::Property)| match definition.kind {
        Kind::Scalar(scalar) => Some(Scalar { property, name: definition.name.clone(), scalar }),
        Kind::List { .. } => None,
    };
    element.properties.iter().enumerate().filter_map(scalar).collect()
}

fn list_warning(element: &Element) -> Option<String> {
    let lists = element.properties.iter().filter(|property| matches!(property.kind, Kind::List { .. }));
    let names: Vec<_> = lists.map(|property| brief(&property.name)).collect();
    let more = match names.len().saturating_sub(NAMED_LISTS) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let named = || names[..names.len().min(NAMED_LISTS)].join(", ");
    (!names.is_empty()).then(|| format!("lists of a vertex are not shown: {}{more}", named()))
}

/// Decides from a sample what the header leaves open: the range of colours, and whether opacity and normals are all
/// zero.
fn decide_conventions(
    file: &Bytes,
    packing: &Packing,
    rows: &Rows,
    scalars: &[Scalar],
    roles: &mut Roles,
    warnings: &mut Vec<String>,
) -> std::io::Result<()> {
    if roles.is_splats {
        warnings.push("Gaussian splats, shown as points".into());
    }
    if rows.count == 0 {
        return Ok(());
    }
    let sample = rows::sample(file, rows, packing)?;
    let values = |index: usize, give: &mut dyn FnMut(f64)| columns::sampled(&sample, &scalars[index], packing, give);
    let is_zero = |index: usize| {
        let mut is_zero = true;
        values(index, &mut |value| is_zero &= value == 0.0 || !value.is_finite());
        is_zero
    };
    if let Some(colors) = roles.colors.filter(|_| packing.is_made())
        && colors.iter().all(|&index| is_zero(index))
    {
        warnings.push("all colours are zero: shown as a cloud without colours".into());
        (roles.colors, roles.color_scale) = (None, None);
    }
    if let Some(colors) = roles.colors
        && roles.color_scale.is_none()
    {
        let mut sample = ColorSample::default();
        colors.iter().for_each(|&index| values(index, &mut |value| sample.add(value)));
        let scales = colors.map(|index| columns::color_scale(scalars[index].scalar, &sample));
        roles.color_scale = Some([0, 1, 2].map(|channel| scales[channel].0));
        warnings.extend(scales.into_iter().find_map(|(_, warning)| warning));
    }
    if let Some((alpha, scale @ None)) = &mut roles.alpha {
        let mut sample = ColorSample::default();
        values(*alpha, &mut |value| sample.add(value));
        *scale = Some(columns::color_scale(scalars[*alpha].scalar, &sample).0);
        if sample.is_black() {
            // Depth cameras leave it unset; nobody saves an invisible cloud.
            warnings.push("opacity is zero everywhere and ignored".into());
            roles.alpha = None;
        }
    }
    if let Some(normals) = roles.normals
        && normals.iter().all(|&index| is_zero(index))
    {
        warnings.push("normals are zero everywhere and count as missing".into());
        roles.normals = None;
    }
    Ok(())
}

/// Checks that lines of text are long enough for the header's properties: each number that is missing at the end of a
/// line costs the time and memory of a number all the same. A few lines may be of any length.
fn check_length(rows: &Rows, element: &Element) -> std::result::Result<(), String> {
    /// A number takes a digit and a separator; at least one number in eight must be in the file.
    const NUMBERS_PER_BYTE: u64 = 4;
    const FEW: u64 = 1 << 20;
    let (properties, bytes) =
        (element.properties.len(), rows.end - rows.blocks.first().map_or(rows.end, |first| first.offset));
    let numbers = rows.count.saturating_mul(properties as u64);
    if numbers <= FEW || numbers / NUMBERS_PER_BYTE <= bytes {
        return Ok(());
    }
    let (name, count) = (brief(&element.name), rows.count);
    Err(format!("element {name} has {properties} properties, but its {count} lines only {bytes} bytes"))
}

/// Warns that faces are not shown as such, and says how much of the data after the vertices is missing.
fn face_warnings(file: &Bytes, header: &Header, vertex: usize, rows: &Rows) -> std::io::Result<Vec<String>> {
    let mut warnings = Vec::new();
    for element in header.elements.iter().filter(|element| faces::is_surface(element) && element.count > 0) {
        let what = if faces::is_polygons(element) { "faces" } else { "triangle strips" };
        warnings.push(format!("{} {what} are shown by points, not as triangles", element.count));
    }
    if rows.count == header.elements[vertex].count && file.length() - rows.end <= FACE_CHECK_BYTES {
        let mut reader = Reader::new(file, rows.end, file.length());
        for element in &header.elements[vertex + 1..] {
            let (found, problem) = rows::skip_elements(&mut reader, header, std::slice::from_ref(element))?;
            if let Some(problem) = problem {
                let (lost, count, name) = (element.count - found, element.count, brief(&element.name));
                warnings.push(format!("{lost} of {count} rows of element {name} are missing: {problem}"));
                break;
            }
        }
    }
    Ok(warnings)
}
