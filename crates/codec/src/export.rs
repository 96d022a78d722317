//! Writes the points of files that are shown to a new file: LAS, LAZ, COPC or PLY, with everything that is known of
//! each of them. Files are streamed through, so they may be larger than memory.

pub(crate) mod columns;
mod common;
pub(crate) mod e57_file;
pub(crate) mod grid;
pub(crate) mod merging;
pub(crate) mod names;
mod ply_file;
pub(crate) mod standard;
mod survey;
pub(crate) mod words;

use std::io::{self, BufWriter, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Attribute, Bounds, Chunk, Column, ColumnType, Progress};
use glam::DVec3;
use param::shown;
use tempfile::NamedTempFile;

use crate::error::{Error, Result, is_for_want_of_room};
use crate::in_order::InOrder;
use crate::las::column_records::RecordFormat;
use crate::las::copc_writer::write_copc;
use crate::las::output_records::{check_items, common_time, have_same_extra_dimensions};
use crate::las::plain_writer::Head;
use crate::las::record_export::{Written, export_records, write_rows_to};
use crate::las::systems::System;
use crate::las::{LasSource, coordinate_decimals};
use crate::ply::RowSource;
use crate::{Format, Info, Source, brief};
pub use columns::{Added, Runs, Wanted};
use columns::{Colors, Field, HAS_COLOR, Meaning, Piece, Reading};
use e57_file::{scale_lengths, scale_of};
use merging::{Merged, Origin};
use names::Names;
pub use names::short_file_name;
use ply_file::{PIECE_POINTS, PlyFile, RowFormat, write_chunks};
use standard::standard;
use words::{Words, few_names};

/// The field of LAS that numbers setups of a scanner.
const STATION: &str = "point_source_id";
/// The number of bytes of a table that are written at once.
const TABLE_BYTES: usize = 1 << 20;

/// The kind of file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    Las,
    Laz,
    Copc,
    Ply,
    E57,
    Csv,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct Exported {
    pub points: u64,
    /// The number of points that the sources announce and that could not be read.
    pub missing: u64,
    /// The bounds of the points as they are in the new file.
    pub bounds: Bounds,
    /// Everything that the new file holds of each point, in its order.
    pub attributes: Vec<Attribute>,
    /// What the new file has otherwise than its files: a few lines.
    pub changes: Vec<String>,
    /// What was wrong with the files, and what the new one lacks of them.
    pub warnings: Vec<String>,
}

impl ExportFormat {
    /// The format that a file's name asks for.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let endings = [
            (".copc.laz", Self::Copc),
            (".laz", Self::Laz),
            (".las", Self::Las),
            (".ply", Self::Ply),
            (".e57", Self::E57),
            (".csv", Self::Csv),
        ];
        endings.into_iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, format)| format)
    }
}

/// Writes the `wanted` points of `sources` to `output`, in their order (COPC: in that of its nodes). A file of
/// one kind keeps records and header, with point format, grid, coordinate system and extra dimensions. `memory` bounds
/// the bytes held at once; temporary files lie in the folder of `output`. The file appears under its name when it is
/// complete. `progress` counts points that are read, and for COPC again those that are written.
///
/// Each point gets the numbers of `added`, too.
///
/// Returns `None` if it was cancelled; nothing is written then.
///
/// # Errors
/// A file of that name is there; no point is shown; the inputs cannot be in one file; the output cannot be written.
pub fn export<'a>(
    sources: &[Arc<Source>],
    wanted: impl Into<Wanted<'a>>,
    added: &[Added],
    output: &Path,
    memory: u64,
    progress: &Progress,
) -> Result<Option<Exported>> {
    let wanted = wanted.into();
    let format = ExportFormat::of(output).unwrap_or(ExportFormat::Laz);
    let unwritten = |error: io::Error| Error::not_written(output, error);
    check_free(output)?;
    let temporary = || temporary(output);
    let all: u64 = sources.iter().map(|source| source.info().points).sum();
    progress.set_total(progress.done() + all);
    let file = temporary()?;
    for source in sources {
        source.check_whole()?;
    }
    let all: Option<Vec<&LasSource>> = sources.iter().map(|source| las(source)).collect();
    let unread = AtomicU64::new(0);
    let bounds = Mutex::new(Bounds::EMPTY);
    let mut job = Job { sources, wanted, added, output, memory, progress, unread, bounds, scale: None };
    // Formats without a place for a coordinate system have one all the same.
    job.crs()?;
    common_time(sources.iter().filter_map(|source| Some((source.info(), source.standard_time()?))))?;
    if format == ExportFormat::E57 {
        job.scale = job.metres()?;
    }
    let written = match (format, &all) {
        (ExportFormat::Ply, _) => job.write_ply(file),
        (ExportFormat::E57, _) => job.write_e57(file),
        (ExportFormat::Csv, _) => job.write_csv(file),
        (_, Some(all)) if !all.is_empty() && have_same_extra_dimensions(all) => {
            let before = progress.done();
            let is_compressed = format != ExportFormat::Las;
            let written = export_records(all, wanted, added, (file, output), is_compressed, memory, progress);
            job.count_unread(job.most_points(), before);
            written
        }
        _ => job.write_las(file, format != ExportFormat::Las),
    };
    if matches!(written, Ok(None)) {
        return Ok(None);
    }
    // A file that was written to meanwhile is at fault, whatever has failed then, but for a full disk.
    if !matches!(&written, Err(Error::NotWritten { reason, .. }) if is_for_want_of_room(reason)) {
        sources.iter().try_for_each(|source| source.bytes().check_as_opened())?;
    }
    let Some(Written { file, points, mut changes, mut warnings }) = written? else { return Ok(None) };
    if points == 0 {
        return Err(Error::unsuitable(output, "not written: no point is shown"));
    }
    if format == ExportFormat::Copc {
        let whole = temporary()?.into_temp_path();
        let inputs = [file.path().to_owned()];
        let made = write_copc(&inputs, &whole, memory, progress);
        let Some(made) = made.map_err(|error| error.renamed(&[file.path(), &whole], output))? else { return Ok(None) };
        // Nobody knows the file without a name.
        let own = format!("{}: ", shown(file.path()));
        let told = |warning: String| match warning.strip_prefix(&own) {
            Some(rest) => format!("{}: {rest}", shown(output)),
            None => warning,
        };
        changes.extend(made.changes.into_iter().map(told));
        warnings.extend(made.warnings.into_iter().map(told));
        drop(file);
        whole.persist_noclobber(output).map_err(|error| unwritten(error.error))?;
    } else {
        file.persist_noclobber(output).map_err(|error| unwritten(error.error))?;
    }
    let attributes = match format {
        ExportFormat::Csv => job.table().0.fields.into_iter().map(|field| field.attribute).collect(),
        _ => {
            let written = crate::open(output)?;
            // The header of a LAS file names them.
            if let Some(bounds) = written.info().bounds {
                job.widen(bounds);
            }
            written.info().properties.clone()
        }
    };
    let missing = job.unread.into_inner().saturating_add(missing_points(sources));
    let bounds = job.bounds.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Some(Exported { points, missing, bounds, attributes, changes, warnings }))
}

/// Writes the places and the colours of points that no file holds to a new PLY file.
///
/// # Errors
/// A file of that name is there, or the output cannot be written.
pub fn export_chunks(chunks: &[Chunk], output: &Path) -> Result<()> {
    let unwritten = |error: io::Error| Error::not_written(output, error);
    check_free(output)?;
    let file = write_chunks(temporary(output)?, chunks).map_err(unwritten)?;
    file.persist_noclobber(output).map(drop).map_err(|error| unwritten(error.error))
}

/// Checks that no file has the name of the output.
fn check_free(output: &Path) -> Result<()> {
    if output.symlink_metadata().is_ok() {
        let taken = io::Error::new(io::ErrorKind::AlreadyExists, "a file of this name is there");
        return Err(Error::not_written(output, taken));
    }
    Ok(())
}

/// A file beside the output, which gets its name when it is whole.
fn temporary(output: &Path) -> Result<NamedTempFile> {
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let prefix = format!(".{}.", short_file_name(&name));
    let made = builder.prefix(&prefix).suffix(".unfinished").tempfile_in(folder);
    made.map_err(|error| Error::not_written(output, error))
}

fn las(source: &Source) -> Option<&LasSource> {
    match source {
        Source::Las(source) => source.whole().ok(),
        Source::Rows(_) | Source::Ept(_) => None,
    }
}

fn rows(source: &Source) -> Option<&RowSource> {
    match source {
        Source::Rows(source) => Some(source),
        Source::Las(_) | Source::Ept(_) => None,
    }
}

/// An export by columns: of files of several kinds, or to a file of another kind.
struct Job<'a> {
    sources: &'a [Arc<Source>],
    wanted: Wanted<'a>,
    added: &'a [Added],
    output: &'a Path,
    memory: u64,
    progress: &'a Progress,
    /// The number of points that could not be read.
    unread: AtomicU64,
    /// The bounds of the points that are written.
    bounds: Mutex<Bounds>,
    /// What x, y and z are multiplied by, where the new file has another unit than its files.
    scale: Option<DVec3>,
}

/// The number of points that the files announce and do not have.
pub fn missing_points<'a>(sources: impl IntoIterator<Item = &'a Arc<Source>>) -> u64 {
    sources.into_iter().fold(0, |all, source| all.saturating_add(source.info().missing))
}

impl Job<'_> {
    fn widen(&self, more: Bounds) {
        let mut bounds = self.bounds.lock().unwrap_or_else(PoisonError::into_inner);
        *bounds = bounds.union(more);
    }

    /// Counts those of so many points that were not read since the progress was at `before`.
    fn count_unread(&self, points: u64, before: u64) {
        self.unread.fetch_add(points.saturating_sub(self.progress.done() - before), Ordering::Relaxed);
    }

    /// Widens the bounds by the places of a piece.
    fn widen_by(&self, own: &OwnFields, piece: &Piece) {
        let axis = |axis: &str| {
            own.fields.iter().position(|field| field.meaning == Meaning::Coordinate && field.name() == axis)
        };
        if let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(axis) {
            let mut bounds = Bounds::EMPTY;
            let place = |index: &u32| [x, y, z].map(|axis| piece.columns[axis].value(*index as usize));
            piece.kept.iter().for_each(|index| bounds.include(DVec3::from(place(index))));
            self.widen(bounds);
        }
    }

    /// The columns of each file, with those that are added. If colours are `marked` and some files have none, a column
    /// says which have.
    fn fields(&self, colors: Colors, is_marked: bool) -> Vec<OwnFields> {
        let fields = |source: &Arc<Source>| {
            let mut fields = match &**source {
                Source::Las(source) => source.column_fields(colors),
                Source::Rows(source) => source.column_fields(colors),
                Source::Ept(source) => source.column_fields(colors),
            };
            let mut names = Names::with_case();
            fields.iter_mut().for_each(|field| field.attribute.name = names.take(field.name(), usize::MAX));
            let added = self.added.iter().map(|added| Field { attribute: added.field(), meaning: Meaning::Other });
            fields.extend(added);
            // Whole numbers of feet are no whole numbers of metres.
            let scaled = |field: &&mut Field| {
                field.column_type().is_whole() && self.scale.is_some_and(|scale| scale_of(field, scale).is_some())
            };
            fields.iter_mut().filter(scaled).for_each(|field| field.attribute.column_type = ColumnType::F64);
            OwnFields { fields, constants: Vec::new() }
        };
        let mut all: Vec<OwnFields> = self.sources.iter().map(fields).collect();
        let colored = self.sources.iter().filter(|source| has_colors(source)).count();
        let is_known = |own: &OwnFields| own.fields.iter().any(|field| field.name() == HAS_COLOR);
        if is_marked && colored > 0 && (colored < self.sources.len() || all.iter().any(is_known)) {
            for (own, source) in all.iter_mut().zip(self.sources).filter(|(own, _)| !is_known(own)) {
                own.fields.push(Field::new(HAS_COLOR, ColumnType::U8, Meaning::Other));
                own.constants.push(u16::from(has_colors(source)));
            }
        }
        all
    }

    /// Numbers scans, and files beside them, from 1 as LAS numbers the setups of a scanner, where no property of a file
    /// does.
    fn number_scans(&self, own: &mut [OwnFields], words: &mut Words) {
        let is_number = |field: &Field| standard(field.name()).is_some_and(|own| own.name == STATION);
        let infos = || self.sources.iter().map(|source| source.info());
        let is_one_of_many = |info: &Info| info.scan.as_ref().is_some_and(|scan| scan.of > 1);
        if own.iter().any(|own| own.fields.iter().any(is_number)) || !infos().any(is_one_of_many) {
            return;
        }
        let count = own.len();
        let mut of_files: Vec<(&Path, [u16; 2])> = Vec::new();
        for ((own, info), number) in own.iter_mut().zip(infos()).zip(1..=u16::MAX) {
            own.fields.push(Field::new(STATION, ColumnType::U16, Meaning::Standard));
            own.constants.push(number);
            match of_files.last_mut().filter(|(path, _)| *path == info.path) {
                Some((_, [_, last])) => *last = number,
                None => of_files.push((&info.path, [number; 2])),
            }
        }
        for (path, [first, last]) in of_files {
            let numbers =
                if first == last { first.to_string() } else { format!("{first} to {last}, one for each scan") };
            words.say(path, format!("its points have {STATION} {numbers}"));
        }
        if count > usize::from(u16::MAX) {
            words.say(self.output, format!("points of the scans after number {} have {STATION} 0", u16::MAX));
        }
    }

    /// Gives the rows of all files to `order`. `rows_of` makes them of a piece of a file by the file's number. Returns
    /// what could not be read.
    fn read(
        &self,
        own: &[OwnFields],
        colors: Colors,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(usize, &Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let mut problems = Vec::new();
        for (number, own) in own.iter().enumerate() {
            let rows_of = |piece: &Piece| {
                self.widen_by(own, piece);
                rows_of(number, piece)
            };
            problems.append(&mut self.read_one(number, own, colors, None, order, &rows_of));
        }
        problems
    }

    /// Gives the rows of one file, of which some columns may not be needed, to `order`. Returns what could not be read.
    fn read_one(
        &self,
        number: usize,
        own: &OwnFields,
        colors: Colors,
        needed: Option<&[bool]>,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(&Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let rows_of = |mut piece: Piece| {
            let left_out = self.wanted.left_out(number, piece.first_point, piece.points);
            piece.kept.retain(|index| !left_out.has(*index as usize));
            let added = |added: &Added| added.of(number, piece.first_point, piece.points);
            let added: Vec<Column> = self.added.iter().map(added).collect();
            piece.columns.extend(added);
            let fields = own.fields.iter().skip(own.fields.len() - own.constants.len());
            piece.columns.extend(fields.zip(&own.constants).map(|(field, value)| match field.column_type() {
                ColumnType::U8 => Column::U8(vec![*value as u8; piece.points]),
                _ => Column::U16(vec![*value; piece.points]),
            }));
            if let Some(scale) = self.scale {
                scale_lengths(&own.fields, &mut piece.columns, scale);
            }
            rows_of(&piece)
        };
        let reading = Reading { test: self.wanted.test, colors, needed };
        let before = self.progress.done();
        let problems = match &*self.sources[number] {
            Source::Las(source) => {
                // A file that cannot be read whole was refused before.
                let whole = source.whole().unwrap_or(source);
                whole.read_columns_in_order(&reading, self.progress, order, &rows_of)
            }
            Source::Rows(source) => source.read_columns_in_order(&reading, self.progress, order, &rows_of),
            Source::Ept(source) => source.read_columns_in_order(&reading, self.progress, order, &rows_of),
        };
        if needed.is_none() {
            self.count_unread(self.sources[number].info().points, before);
        }
        problems
    }

    /// What is wrong with the files, and what no column has of them.
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for source in self.sources {
            let info = source.info();
            let path = shown(&info.path);
            warnings.extend(info.warnings.iter().map(|warning| format!("{path}: {warning}")));
        }
        warnings
    }

    /// What no column has of the files.
    fn say_left_out(&self, words: &mut Words) {
        let is_anywhere = self.sources.iter().any(|source| source.info().crs.is_some());
        for source in self.sources {
            let info = source.info();
            if is_anywhere && info.crs.is_none() {
                words.say(&info.path, "no coordinate system, where others have one: taken to be in theirs");
            }
            if source.is_mesh() {
                words.say(&info.path, format!("its {} faces are left out: points are exported", info.faces));
            }
            if rows(source).is_some_and(RowSource::has_lists) {
                words.say(&info.path, "lists of a vertex are left out");
            }
            match info.images.len() {
                0 => {}
                1 => words.say(&info.path, "its picture is left out: points are exported"),
                many => words.say(&info.path, format!("its {many} pictures are left out: points are exported")),
            }
            let opaque = las(source).map_or(0, LasSource::opaque_bytes);
            if opaque > 0 {
                words.say(&info.path, format!("{opaque} bytes of each point, which have no type, are left out"));
            }
        }
    }

    /// Says which fields files lack that others have, where `none` stands in the new file for them.
    fn say_missing(&self, merged: &Merged, none: &dyn Fn(&Field) -> &'static str, words: &mut Words) {
        for (number, source) in self.sources.iter().enumerate() {
            for meant in ["NaN", "0", "nothing"] {
                // Formats 0 to 5 cannot have what only later ones have.
                let is_meant = |field: &Field| {
                    let is_new = matches!(field.name(), "overlap" | "scanner_channel") && las(source).is_some();
                    none(field) == meant && !is_new
                };
                let names = merged.missing(number, is_meant);
                if !names.is_empty() {
                    words.say(&source.info().path, format!("has no {}: {meant} in the new file", few_names(&names)));
                }
            }
        }
    }

    /// Says which files have no colours, where others have.
    fn say_black(&self, words: &mut Words) {
        if self.sources.iter().any(has_colors) {
            for source in self.sources.iter().filter(|source| !has_colors(source)) {
                let word = format!("has no colours: its points are black in the new file, where {HAS_COLOR} is 0");
                words.say(&source.info().path, word);
            }
        }
    }

    fn most_points(&self) -> u64 {
        self.sources.iter().map(|source| source.info().points).sum()
    }

    /// Whether the colours of all files that have some are of one kind.
    fn has_one_kind_of_colors(&self) -> bool {
        let mut colored = self.sources.iter().filter(|source| has_colors(source));
        let Some(first) = colored.next() else { return true };
        colored.all(|other| match (&**first, &**other) {
            (Source::Las(first), Source::Las(other)) => first.color_depth() == other.color_depth(),
            (Source::Rows(first), Source::Rows(other)) => first.has_colors_like(other),
            _ => false,
        })
    }

    fn write_ply(&self, file: NamedTempFile) -> Result<Option<Written>> {
        let unwritten = |error| Error::not_written(self.output, error);
        let is_ply = self.sources.iter().all(|source| source.info().format == Format::Ply);
        let colors = if is_ply && self.has_one_kind_of_colors() { Colors::Own } else { Colors::Bytes };
        let own = self.fields(colors, true);
        let mut merged = merged_by_name(&own);
        merged.leave_room_for_none();
        let format = RowFormat::new(&merged.fields);
        let crs = self.crs()?;
        let mut words = Words::default();
        for (field, own) in merged.fields.iter().zip(&format.fields).filter(|(field, own)| field.name() != own.name) {
            words.say(self.output, format!("{} became the property {}", field.name(), own.name));
        }
        self.say_left_out(&mut words);
        self.say_missing(&merged, &|field| if field.column_type().is_whole() { "0" } else { "NaN" }, &mut words);
        self.say_black(&mut words);
        for source in self.sources.iter().filter(|_| colors == Colors::Bytes) {
            if source.has_wide_colors() {
                let word = "of the bits of a colour, PLY keeps the upper 8, which programs expect there";
                words.say(&source.info().path, word);
            }
        }
        if crs.is_some() {
            let word = "PLY has no place for a coordinate system: it is in a comment, which few programs read";
            words.say(self.output, word);
        }
        let mut out = PlyFile::start(file, &format, crs, self.most_points()).map_err(unwritten)?;
        let points = Mutex::new(0);
        let encode = |rows: Vec<u8>| {
            *points.lock().unwrap_or_else(PoisonError::into_inner) += (rows.len() / format.length) as u64;
            Ok(rows)
        };
        let mut write = |rows: Vec<u8>| out.push(&rows);
        let is_cancelled = || self.progress.is_cancelled();
        let order = InOrder::new(PIECE_POINTS * format.length, &encode, &mut write, &is_cancelled);
        let rows_of = |file: usize, piece: &Piece| format.rows(piece, &merged.origins[file]);
        let mut warnings = self.warnings();
        warnings.append(&mut self.read(&own, colors, &order, &rows_of));
        order.finish().map_err(unwritten)?;
        if self.progress.is_cancelled() {
            return Ok(None);
        }
        self.say_lost_digits(&format.lost_digits(), &mut words);
        let points = points.into_inner().unwrap_or_else(PoisonError::into_inner);
        let file = out.finish(points).map_err(unwritten)?;
        Ok(Some(Written { file, points, changes: words.lines(), warnings }))
    }

    fn say_lost_digits(&self, names: &[String], words: &mut Words) {
        if !names.is_empty() {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let word = format!("{}: whole numbers beyond 2^53 lost digits as doubles", few_names(&names));
            words.say(self.output, word);
        }
    }

    /// The columns of a table, the columns of each file, and the scale of the colours: the file's own, or one for all.
    fn table(&self) -> (Merged, Vec<OwnFields>, Colors) {
        let colors = if self.has_one_kind_of_colors() { Colors::Own } else { Colors::Words };
        let own = self.fields(colors, false);
        (merged_by_name(&own), own, colors)
    }

    /// A table with a row for each point, and the names of the columns above it.
    fn write_csv(&self, file: NamedTempFile) -> Result<Option<Written>> {
        let unwritten = |error| Error::not_written(self.output, error);
        let (merged, own, colors) = self.table();
        let mut words = Words::default();
        self.say_left_out(&mut words);
        self.say_missing(&merged, &|_| "nothing", &mut words);
        if colors == Colors::Words {
            words.say(self.output, "colours of different scales became numbers from 0 to 65535");
        }
        let mut out = BufWriter::with_capacity(TABLE_BYTES, file);
        let quoted = |name: &str| match name.contains([',', '"', '\n', '\r']) {
            true => format!("\"{}\"", name.replace('"', "\"\"")),
            false => name.to_owned(),
        };
        let names: Vec<String> = merged.fields.iter().map(|field| quoted(field.name())).collect();
        writeln!(out, "{}", names.join(",")).map_err(unwritten)?;
        let points = AtomicU64::new(0);
        let encode = |text: Vec<u8>| Ok(text);
        let mut write = |text: Vec<u8>| out.write_all(&text);
        let is_cancelled = || self.progress.is_cancelled();
        let order = InOrder::new(TABLE_BYTES, &encode, &mut write, &is_cancelled);
        let axis = |field: &Field| ["x", "y", "z"].iter().position(|axis| *axis == field.name());
        let axes: Vec<Option<usize>> = merged.fields.iter().map(axis).collect();
        let rows_of = |file: usize, piece: &Piece| {
            points.fetch_add(piece.kept.len() as u64, Ordering::Relaxed);
            // The rounding of a multiple of a grid's steps is no digit of the file.
            let decimals = self.sources[file].info().grid.as_ref().map(coordinate_decimals);
            let text_of = |column: &Column, axis: Option<usize>, index: usize| match decimals.zip(axis) {
                Some((decimals, axis)) => format!("{:.*}", decimals[axis], column.value(index)),
                None => column.text(index),
            };
            let mut text = String::new();
            for index in &piece.kept {
                for (place, (origin, axis)) in merged.origins[file].iter().zip(&axes).enumerate() {
                    let value = origin.and_then(|Origin { column, .. }| piece.columns.get(column));
                    let value = value.map_or(String::new(), |column| text_of(column, *axis, *index as usize));
                    text += if place == 0 { "" } else { "," };
                    text += &value;
                }
                text += "\n";
            }
            text.into_bytes()
        };
        let mut warnings = self.warnings();
        warnings.append(&mut self.read(&own, colors, &order, &rows_of));
        order.finish().map_err(unwritten)?;
        if self.progress.is_cancelled() {
            return Ok(None);
        }
        let file = out.into_inner().map_err(|error| unwritten(error.into_error()))?;
        file.as_file().sync_data().map_err(unwritten)?;
        Ok(Some(Written { file, points: points.into_inner(), changes: words.lines(), warnings }))
    }

    fn write_las(&self, file: NamedTempFile, is_compressed: bool) -> Result<Option<Written>> {
        let crs = self.crs()?;
        let all: Vec<&LasSource> = self.sources.iter().filter_map(|source| las(source)).collect();
        let mut own = self.fields(Colors::Words, true);
        let mut words = Words::default();
        self.number_scans(&mut own, &mut words);
        let Some(survey) = self.survey(&own)? else { return Ok(None) };
        let has_standard_time = self.time_of_all(&survey.standard_times, &mut words);
        self.say_left_out(&mut words);
        let columns: Vec<Vec<Field>> = own.iter().map(|own| own.fields.clone()).collect();
        let mut say = |file: usize, word: String| words.say(&self.sources[file].info().path, word);
        let mut merged = Merged::for_las(&columns, &survey.values, &mut say);
        merged.leave_room_for_none();
        for source in all.iter().filter(|source| source.has_waves()) {
            words.say(&source.info().path, "wave packets of several files cannot be in one file: left out");
        }
        if self.sources.len() > 1 {
            let none = |field: &Field| if field.meaning == Meaning::Other { "NaN" } else { "0" };
            self.say_missing(&merged, &none, &mut words);
            self.say_black(&mut words);
            if !self.has_one_kind_of_colors() {
                words.say(self.output, "colours of different scales became numbers from 0 to 65535");
            }
        }
        let format = RecordFormat::new(merged.fields.clone(), survey.grid);
        let length = format.target.record_length();
        let items = match is_compressed {
            true => Some(check_items(self.output, format.target, self.memory)?),
            false if length > usize::from(u16::MAX) => {
                let problem = format!("its points take {length} bytes, LAS files can have {} at most", u16::MAX);
                return Err(Error::unsuitable(self.output, problem));
            }
            false => None,
        };
        // The records of a file that has the coordinate system, if one has.
        let first = all.iter().copied().find(|source| crs.is_none() || source.info().crs.as_deref() == crs);
        let unwritten = |error| Error::not_written(self.output, error);
        let system = match (first, crs) {
            (None, Some(text)) => System::of_text(text, &self.units()),
            _ => System::new(first, format.target.format).map_err(unwritten)?,
        };
        system.word.iter().for_each(|word| words.say(self.output, word));
        let head = Head {
            first,
            target: format.target,
            grid: format.grid,
            items,
            descriptors: format.descriptors.clone(),
            most_points: self.most_points(),
            has_standard_time: has_standard_time.or(Some(false)),
            system,
        };
        let mut warnings = self.warnings();
        let mut write_rows = |order: &InOrder<'_>| {
            warnings.append(&mut self.read(&own, Colors::Words, order, &|file, piece| {
                format.rows(piece, &merged.origins[file]).unwrap_or_else(|error| {
                    order.fail(error);
                    Vec::new()
                })
            }));
        };
        let output = (file, self.output);
        let Some((file, points)) = write_rows_to(head, output, self.memory, self.progress, &mut write_rows)? else {
            return Ok(None);
        };
        let losses = format.losses();
        self.say_lost_digits(&losses.digits, &mut words);
        if survey.is_seen(losses.moved) {
            let (steps, moved) = (brief::vector(survey.grid.scale), few_digits(losses.moved.max_element()));
            let word = format!("coordinates are rounded to steps of {steps}, by up to {moved}");
            words.say(self.output, word);
        }
        Ok(Some(Written { file, points, changes: words.lines(), warnings }))
    }
}

/// The columns of a file.
#[derive(Clone)]
struct OwnFields {
    fields: Vec<Field>,
    /// The values of columns at the end that are alike for all points: whether they have colours, and the scan's number.
    constants: Vec<u16>,
}

/// A number in two digits.
fn few_digits(value: f64) -> String {
    brief::number(format!("{value:.1e}").parse().unwrap_or(value))
}

fn merged_by_name(own: &[OwnFields]) -> Merged {
    Merged::by_name(&own.iter().map(|own| own.fields.clone()).collect::<Vec<_>>())
}

fn has_colors(source: &Arc<Source>) -> bool {
    source.info().has_colors
}
