//! Writes the points of files that are shown to a new file: LAS, LAZ, COPC or PLY, with everything that is known of
//! each of them. Files are streamed through, so they may be larger than memory.

pub(crate) mod columns;
mod ply_file;

use std::io::{self, BufWriter, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Attribute, Bounds, Column, Grid, Progress};
use glam::DVec3;
use param::shown;
use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::in_order::InOrder;
use crate::las::column_records::RecordFormat;
use crate::las::output_records::check_items;
use crate::las::plain_writer::Head;
use crate::las::record_export::{Written, export_records, write_rows_to};
use crate::las::{LasSource, coordinate_decimals, write_copc};
use crate::ply::PlySource;
use crate::{Selection, Source};
pub use columns::{Added, Runs, Wanted};
use columns::{Piece, all_fields, columns_of};
use ply_file::{PIECE_POINTS, PlyFile, RowFormat};

/// The number of bytes of a table that are written at once.
const TABLE_BYTES: usize = 1 << 20;

/// The kind of file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    Las,
    Laz,
    Copc,
    Ply,
    Csv,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct Exported {
    pub points: u64,
    /// Those of the points as they are in the new file.
    pub bounds: Bounds,
    /// Everything that the new file holds of each point, in its order.
    pub attributes: Vec<Attribute>,
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
    if output.symlink_metadata().is_ok() {
        return Err(unwritten(io::Error::new(io::ErrorKind::AlreadyExists, "a file of this name is there")));
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let temporary = || {
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder.prefix(&format!(".{name}.")).suffix(".unfinished").tempfile_in(folder).map_err(unwritten)
    };
    let all: u64 = sources.iter().map(|source| source.info().points).sum();
    progress.set_total(progress.done() + all);
    let file = temporary()?;
    let all: Option<Vec<&LasSource>> = sources.iter().map(|source| las(source)).collect();
    let job = Job { sources, wanted, added, output, memory, progress, bounds: Mutex::new(Bounds::EMPTY) };
    let written = match (format, &all) {
        (ExportFormat::Ply, _) => job.write_ply(file)?,
        (ExportFormat::Csv, _) => job.write_csv(file)?,
        (_, Some(all)) if !all.is_empty() => {
            export_records(all, wanted, added, (file, output), format != ExportFormat::Las, memory, progress)?
        }
        _ => job.write_las(file, format != ExportFormat::Las)?,
    };
    let Some(Written { file, points, mut warnings }) = written else { return Ok(None) };
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
        warnings.extend(made.warnings.into_iter().map(told));
        drop(file);
        whole.persist_noclobber(output).map_err(|error| unwritten(error.error))?;
    } else {
        file.persist_noclobber(output).map_err(|error| unwritten(error.error))?;
    }
    let attributes = match format {
        ExportFormat::Csv => all_fields(&job.fields(false)),
        _ => {
            let written = crate::open(output)?;
            // A header of a LAS file tells them.
            if let Some(bounds) = written.info().bounds {
                job.widen(bounds);
            }
            written.info().properties.clone()
        }
    };
    let bounds = job.bounds.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Some(Exported { points, bounds, attributes, warnings }))
}

fn las(source: &Source) -> Option<&LasSource> {
    match source {
        Source::Las(source) => Some(source),
        Source::Ply(_) => None,
    }
}

fn ply(source: &Source) -> Option<&PlySource> {
    match source {
        Source::Ply(source) => Some(source),
        Source::Las(_) => None,
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
    /// Those of the points that are written.
    bounds: Mutex<Bounds>,
}

impl Job<'_> {
    fn widen(&self, more: Bounds) {
        let mut bounds = self.bounds.lock().unwrap_or_else(PoisonError::into_inner);
        *bounds = bounds.union(more);
    }

    fn fields(&self, wide: bool) -> Vec<Vec<Attribute>> {
        let fields = |source: &Arc<Source>| {
            let mut fields = match &**source {
                Source::Las(source) => source.column_fields(wide),
                Source::Ply(source) => source.column_fields(wide),
            };
            fields.extend(self.added.iter().map(Added::field));
            fields
        };
        self.sources.iter().map(fields).collect()
    }

    /// Gives the rows of all files to `order`. `rows_of` makes them of a piece of a file, by the columns that the file has
    /// of `fields`.
    fn read(
        &self,
        fields: &[Attribute],
        wide: bool,
        order: &InOrder<'_>,
        rows_of: impl Fn(&Source, &Piece, &[Option<usize>]) -> Vec<u8> + Sync,
    ) -> Vec<String> {
        let mut problems = Vec::new();
        for (number, (source, own)) in self.sources.iter().zip(self.fields(wide)).enumerate() {
            let columns = columns_of(fields, &own);
            let coordinates = ["x", "y", "z"].map(|axis| own.iter().position(|field| field.name == axis));
            let rows_of = |mut piece: Piece| {
                let left_out = self.wanted.left_out(number, piece.first_point, piece.points);
                piece.kept.retain(|index| !left_out.has(*index as usize));
                let added = |added: &Added| Column::F32(added.of(number, piece.first_point, piece.points));
                let added: Vec<Column> = self.added.iter().map(added).collect();
                piece.columns.extend(added);
                if let [Some(x), Some(y), Some(z)] = coordinates {
                    let mut bounds = Bounds::EMPTY;
                    let place = |index: &u32| [x, y, z].map(|axis| piece.columns[axis].value(*index as usize));
                    piece.kept.iter().for_each(|index| bounds.include(DVec3::from(place(index))));
                    self.widen(bounds);
                }
                rows_of(source, &piece, &columns)
            };
            problems.append(&mut match &**source {
                Source::Las(source) => {
                    source.read_columns_in_order(self.wanted.test, wide, self.progress, order, &rows_of)
                }
                Source::Ply(source) => {
                    source.read_columns_in_order(self.wanted.test, wide, self.progress, order, &rows_of)
                }
            });
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
            if source.is_mesh() {
                warnings.push(format!("{path}: its {} faces are left out: points are exported", info.faces));
            }
        }
        warnings
    }

    /// The coordinate system of all files that have one.
    fn crs(&self) -> Result<Option<&str>> {
        let mut found: Option<(&Path, &str)> = None;
        for info in self.sources.iter().map(|source| source.info()) {
            match (&info.crs, found) {
                (Some(crs), None) => found = Some((&info.path, crs)),
                (Some(crs), Some((path, known))) if crs != known => {
                    let problem = format!("is in another coordinate system than {}", shown(path));
                    return Err(Error::unsuitable(&info.path, problem));
                }
                _ => {}
            }
        }
        Ok(found.map(|(_, crs)| crs))
    }

    fn most_points(&self) -> u64 {
        self.sources.iter().map(|source| source.info().points).sum()
    }

    fn write_ply(&self, file: NamedTempFile) -> Result<Option<Written>> {
        let unwritten = |error| Error::not_written(self.output, error);
        let format = RowFormat::new(all_fields(&self.fields(false)));
        let crs = self.crs()?;
        let mut warnings = self.warnings();
        if crs.is_some() {
            warnings
                .push("PLY has no place for a coordinate system: it is in a comment, which few programs read".into());
        }
        let is_wide = |source: &&LasSource| source.has_wide_colors();
        if let Some(source) = self.sources.iter().filter_map(|source| las(source)).find(is_wide) {
            let path = shown(&source.info().path);
            warnings
                .push(format!("{path}: of 16 bits of a colour, PLY keeps the upper 8, which programs expect there"));
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
        warnings.append(&mut self.read(&format.fields, false, &order, |_, piece, columns| format.rows(piece, columns)));
        order.finish().map_err(unwritten)?;
        if self.progress.is_cancelled() {
            return Ok(None);
        }
        let points = points.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Some(Written { file: out.finish(points).map_err(unwritten)?, points, warnings }))
    }

    /// A table with a row for each point, and the names of the columns above it.
    fn write_csv(&self, file: NamedTempFile) -> Result<Option<Written>> {
        let unwritten = |error| Error::not_written(self.output, error);
        let fields = all_fields(&self.fields(false));
        let mut warnings = self.warnings();
        let mut out = BufWriter::with_capacity(TABLE_BYTES, file);
        let quoted = |name: &str| match name.contains([',', '"', '\n', '\r']) {
            true => format!("\"{}\"", name.replace('"', "\"\"")),
            false => name.to_owned(),
        };
        let names: Vec<String> = fields.iter().map(|field| quoted(&field.name)).collect();
        writeln!(out, "{}", names.join(",")).map_err(unwritten)?;
        let points = AtomicU64::new(0);
        let encode = |text: Vec<u8>| Ok(text);
        let mut write = |text: Vec<u8>| out.write_all(&text);
        let is_cancelled = || self.progress.is_cancelled();
        let order = InOrder::new(TABLE_BYTES, &encode, &mut write, &is_cancelled);
        let axes: Vec<Option<usize>> =
            fields.iter().map(|field| ["x", "y", "z"].iter().position(|axis| *axis == field.name)).collect();
        let rows_of = |source: &Source, piece: &Piece, columns: &[Option<usize>]| {
            points.fetch_add(piece.kept.len() as u64, Ordering::Relaxed);
            // The rounding of a multiple of a grid's steps is no digit of the file.
            let decimals = source.info().grid.as_ref().map(coordinate_decimals);
            let text_of = |column: &Column, axis: Option<usize>, index: usize| match decimals.zip(axis) {
                Some((decimals, axis)) => format!("{:.*}", decimals[axis], column.value(index)),
                None => column.text(index),
            };
            let mut text = String::new();
            for index in &piece.kept {
                for (place, (column, axis)) in columns.iter().zip(&axes).enumerate() {
                    let value = column.and_then(|column| piece.columns.get(column));
                    let value = value.map_or(String::new(), |column| text_of(column, *axis, *index as usize));
                    text += if place == 0 { "" } else { "," };
                    text += &value;
                }
                text += "\n";
            }
            text.into_bytes()
        };
        warnings.append(&mut self.read(&fields, false, &order, rows_of));
        order.finish().map_err(unwritten)?;
        if self.progress.is_cancelled() {
            return Ok(None);
        }
        let file = out.into_inner().map_err(|error| unwritten(error.into_error()))?;
        file.as_file().sync_data().map_err(unwritten)?;
        Ok(Some(Written { file, points: points.into_inner(), warnings }))
    }

    fn write_las(&self, file: NamedTempFile, is_compressed: bool) -> Result<Option<Written>> {
        let mut warnings = self.warnings();
        self.crs()?;
        let format = RecordFormat::new(all_fields(&self.fields(true)), self.grid()?);
        let length = format.target.record_length();
        let first = self.sources.iter().find_map(|source| las(source));
        let items = match is_compressed {
            true => Some(check_items(self.output, format.target, self.memory)?),
            false if length > usize::from(u16::MAX) => {
                let problem = format!("its points take {length} bytes, LAS files can have {} at most", u16::MAX);
                return Err(Error::unsuitable(self.output, problem));
            }
            false => None,
        };
        let head = Head {
            first,
            target: format.target,
            grid: format.grid,
            items,
            descriptors: format.descriptors.clone(),
            most_points: self.most_points(),
        };
        let mut write_rows = |order: &InOrder<'_>| {
            warnings.append(&mut self.read(&format.fields, true, order, |_, piece, columns| {
                format.rows(piece, columns).unwrap_or_else(|error| {
                    order.fail(error);
                    Vec::new()
                })
            }));
        };
        let output = (file, self.output);
        let written = write_rows_to(head, output, self.memory, self.progress, &mut write_rows)?;
        Ok(written.map(|(file, points)| Written { file, points, warnings }))
    }

    /// The grid of the first LAS file with the finest steps of any; without one, a grid of powers of ten, finer than
    /// the numbers of 32 bits of PLY files.
    fn grid(&self) -> Result<Grid> {
        const STEPS: f64 = 1e9;
        let bounds = self.bounds()?;
        let grids: Vec<Grid> = self.sources.iter().filter_map(|source| source.info().grid).collect();
        let decimal = |extent: f64| 10_f64.powf((extent.max(1e-3) / STEPS).log10().ceil());
        let scale = grids.iter().map(|grid| grid.scale.abs()).reduce(DVec3::min);
        let scale = scale.unwrap_or_else(|| DVec3::splat(decimal(bounds.size().max_element())));
        let reach = |offset: DVec3| {
            ((bounds.min - offset) / scale).abs().max(((bounds.max - offset) / scale).abs()).max_element()
        };
        let center = ((bounds.center() / scale).round() * scale).round();
        let offsets = grids.first().map(|grid| grid.offset).into_iter().chain([center]);
        let mut offsets = offsets.filter(|offset| reach(*offset) < f64::from(i32::MAX));
        offsets.next().map(|offset| Grid::new(scale, offset)).ok_or_else(|| {
            Error::unsuitable(
                self.output,
                format!("not written: the inputs are too far apart for steps of {}", scale.x),
            )
        })
    }

    /// The bounds of all points; those of PLY files are read from the points.
    fn bounds(&self) -> Result<Bounds> {
        let mut bounds = Bounds::EMPTY;
        for source in self.sources {
            let own = match (source.info().bounds, ply(source)) {
                (Some(own), None) => Some(own),
                _ => {
                    let own = Progress::default();
                    let pass_on = |_| {
                        if self.progress.is_cancelled() {
                            own.cancel();
                        }
                    };
                    source.read(&Selection { positions: true, ..Selection::default() }, &own, &pass_on)?.bounds
                }
            };
            bounds = bounds.union(own.unwrap_or(Bounds::EMPTY));
        }
        Ok(if bounds.is_empty() { Bounds { min: DVec3::ZERO, max: DVec3::ZERO } } else { bounds })
    }
}
