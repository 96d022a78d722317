//! Writes the points of LAS files that are shown to a LAS or LAZ file, record by record: what is in a record stays as
//! it is.

use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, ColumnType, Progress};
use param::shown;
use tempfile::NamedTempFile;

use super::LasSource;
use super::column_records::descriptor;
use super::layout::Layout;
use super::output_records::{
    Statistics, Target, Upgrade, check_alike, check_items, common_grid, far_outside, leave_out_waves, one_at_a_time,
    upgrades, warn_of,
};
use super::plain_writer::{CHUNK_POINTS, Head, PlainFile, compress};
use super::whole_records::RecordTest;
use crate::error::{Error, Result};
use crate::export::columns::{Added, LeftOut, Wanted};
use crate::in_order::InOrder;

/// The header's bit that says that wave packets are in another file.
const EXTERNAL_WAVES: u16 = 4;

/// A file that is whole and has no name yet.
pub struct Written {
    pub file: NamedTempFile,
    pub points: u64,
    pub warnings: Vec<String>,
}

/// Writes the wanted points of all files, in their order, to `file`, which becomes `output`. Returns `None` if it was
/// cancelled. `memory` bounds what compressing takes, in bytes.
pub fn export_records(
    sources: &[&LasSource],
    wanted: Wanted<'_>,
    added: &[Added],
    (file, output): (NamedTempFile, &Path),
    is_compressed: bool,
    memory: u64,
    progress: &Progress,
) -> Result<Option<Written>> {
    let first = sources[0];
    let mut warnings = Vec::new();
    check_alike(sources)?;
    warn_of(sources, &mut warnings);
    let extra = first.layout.record_length - first.base_length() + 4 * added.len();
    let formats = || sources.iter().filter_map(|source| source.info.point_format);
    let is_one_format = formats().all(|format| Some(format) == first.info.point_format);
    let has_waves = formats().any(|format| Layout::wave_packet(format).is_some());
    let target = match first.info.point_format {
        // Packets of several files would have to be renumbered.
        Some(format) if is_one_format && !(has_waves && sources.len() > 1) => Target { format, extra },
        _ => {
            leave_out_waves(sources, "wave packets of several files cannot be in one file", &mut warnings);
            Target::new(formats(), extra)
        }
    };
    if first.global_encoding & EXTERNAL_WAVES != 0 && Layout::wave_packet(target.format).is_some() {
        warnings.push(format!(
            "{}: its wave packets are in a .wdp file of the same name; copy that beside the new file",
            shown(&first.info.path)
        ));
    }
    let grid = match sources {
        [one] if one.info.placement.is_none() => one.grid,
        _ => common_grid(sources)?,
    };
    let upgrades = upgrades(sources, target, grid, &mut warnings);
    let items = if is_compressed { Some(check_items(&first.info.path, target, memory)?) } else { None };
    let most_points = sources.iter().map(|source| source.info.points).sum();
    let head = Head {
        first: Some(first),
        target,
        grid,
        items: items.clone(),
        descriptors: descriptors(first, added),
        most_points,
    };
    let mut write_rows = |order: &InOrder<'_>| {
        for (number, (source, upgrade)) in sources.iter().zip(&upgrades).enumerate() {
            let test = source.record_test(wanted.test);
            let rows_of = |first_point: u64, records: &[u8]| {
                let points = records.len() / upgrade.record_length;
                let values: Vec<Vec<f32>> = added.iter().map(|added| added.of(number, first_point, points)).collect();
                let left_out = wanted.left_out(number, first_point, points);
                converted(records, upgrade, test.as_ref(), left_out, &values)
            };
            warnings.append(&mut source.read_records_in_order(progress, order, rows_of));
        }
    };
    let written = write_rows_to(head, (file, output), memory, progress, &mut write_rows)?;
    Ok(written.map(|(file, points)| Written { file, points, warnings }))
}

/// The descriptors of the extra dimensions of a file and of those that are added. Bytes that none describes get one, so
/// that those after them are in their places.
fn descriptors(first: &LasSource, added: &[Added]) -> Vec<u8> {
    let mut descriptors = first.descriptors.clone();
    if !added.is_empty() {
        let mut rest = first.layout.undescribed();
        while rest > 0 {
            let length = rest.min(usize::from(u8::MAX));
            let mut bytes = descriptor(&Attribute { name: "undescribed".into(), column_type: ColumnType::U8 });
            (bytes[2], bytes[3]) = (0, length as u8);
            descriptors.extend(bytes);
            rest -= length;
        }
        descriptors.extend(added.iter().flat_map(|added| descriptor(&added.field())));
    }
    descriptors
}

/// Writes what `write_rows` gives: rows of the head's format, in order. Returns the file and its number of points, or
/// `None` if it was cancelled.
pub fn write_rows_to<'a>(
    head: Head<'a>,
    (file, output): (NamedTempFile, &Path),
    memory: u64,
    progress: &Progress,
    write_rows: &mut dyn FnMut(&InOrder<'_>),
) -> Result<Option<(NamedTempFile, u64)>> {
    let unwritten = |error| Error::not_written(output, error);
    let (items, target, length) = (head.items.clone(), head.target, head.target.record_length());
    let turn = items.as_deref().and_then(|items| one_at_a_time(items, memory));
    let mut out = PlainFile::start(file, head).map_err(unwritten)?;
    let total = Mutex::new(Statistics::default());
    let encode = |records: Vec<u8>| {
        let mut own = Statistics::default();
        records.chunks_exact(length).for_each(|record| own.add(record, target.format));
        total.lock().unwrap_or_else(PoisonError::into_inner).merge(&own);
        let Some(items) = &items else { return Ok(records) };
        let _turn = turn.as_ref().map(|turn| turn.lock().unwrap_or_else(PoisonError::into_inner));
        compress(items, &records, length)
    };
    let is_cancelled = || progress.is_cancelled();
    let mut write = |points: Vec<u8>| out.push(&points);
    let order = InOrder::new(CHUNK_POINTS * length, &encode, &mut write, &is_cancelled);
    write_rows(&order);
    order.finish().map_err(unwritten)?;
    if progress.is_cancelled() {
        return Ok(None);
    }
    let statistics = total.into_inner().unwrap_or_else(PoisonError::into_inner);
    if statistics.points == 0 {
        return Ok(Some((out.abandon(), 0)));
    }
    let points = statistics.points;
    Ok(Some((out.finish(&statistics).map_err(unwritten)?, points)))
}

/// The shown records in the format of the file that is written, with the values that are added to them.
fn converted(
    records: &[u8],
    upgrade: &Upgrade,
    test: Option<&RecordTest<'_>>,
    left_out: LeftOut<'_>,
    added: &[Vec<f32>],
) -> io::Result<Vec<u8>> {
    let length = upgrade.record_length;
    let shown = test.map(|test| test.shown(records));
    let mut rows = Vec::with_capacity(if test.is_none() { records.len() } else { 0 });
    for (index, record) in records.chunks_exact(length).enumerate() {
        if left_out.has(index) || shown.as_ref().is_some_and(|shown| !shown.has(index)) {
            continue;
        }
        if !upgrade.push(record, &mut rows) {
            return Err(far_outside());
        }
        added.iter().for_each(|values| rows.extend(values[index].to_le_bytes()));
    }
    Ok(rows)
}
