//! Writes the points of LAS files that are shown to a LAS or LAZ file, record by record: what is in a record stays as
//! it is.

use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Column, ColumnType, Progress};
use tempfile::NamedTempFile;

use super::LasSource;
use super::column_records::descriptor;
use super::layout::Layout;
use super::output_records::{
    Statistics, Target, Upgrade, check_alike, check_items, common_grid, far_outside, leading, leave_out_waves,
    one_at_a_time, say_black, say_rounded_angles, upgrades, warn_of,
};
use super::plain_writer::{CHUNK_POINTS, Head, PlainFile, compress};
use super::systems::System;
use super::whole_records::RecordTest;
use crate::error::{Error, Result};
use crate::export::columns::{Added, HAS_COLOR, LeftOut, Wanted};
use crate::export::names::{EXTRA_LENGTH, Names};
use crate::export::standard::is_reserved;
use crate::export::words::Words;
use crate::in_order::InOrder;

/// The header's bit that says that wave packets are in another file.
const EXTERNAL_WAVES: u16 = 4;

/// A file that is whole and has no name yet.
pub struct Written {
    pub file: NamedTempFile,
    pub points: u64,
    /// What it has otherwise than its files.
    pub changes: Vec<String>,
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
    let first = leading(sources)[0];
    let (mut warnings, mut words) = (Vec::new(), Words::default());
    let has_standard_time = check_alike(&leading(sources), &mut words)?;
    warn_of(sources, &mut warnings);
    let colored = sources.iter().filter(|source| source.has_colors()).count();
    let is_known = first.layout.properties.iter().any(|property| property.name == HAS_COLOR);
    let is_marked = colored > 0 && colored < sources.len() && !is_known;
    say_black(sources, if is_marked { ", where has_color is 0" } else { "" }, &mut words);
    let own = first.layout.record_length - first.base_length();
    let sizes = added.iter().map(|added| added.field().column_type.size());
    let extra = own + sizes.sum::<usize>() + usize::from(is_marked);
    let formats = || sources.iter().filter_map(|source| source.info.point_format);
    let is_one_format = formats().all(|format| Some(format) == first.info.point_format);
    let has_waves = sources.iter().any(|source| source.has_waves());
    let target = match first.info.point_format {
        // Packets of several files would have to be renumbered.
        Some(format) if is_one_format && !(has_waves && sources.len() > 1) => Target { format, extra },
        _ => {
            leave_out_waves(sources, "wave packets of several files cannot be in one file", &mut words);
            Target::new(formats(), extra)
        }
    };
    if first.global_encoding & EXTERNAL_WAVES != 0 && Layout::wave_packet(target.format).is_some() {
        let word = "its wave packets are in a .wdp file of the same name; copy that beside the new file";
        words.say(&first.info.path, word);
    }
    let grid = match sources {
        [one] if one.info.placement.is_none() => one.grid,
        _ => common_grid(sources),
    };
    let upgrades = upgrades(sources, target, grid, &mut words);
    let items = if is_compressed { Some(check_items(&first.info.path, target, memory)?) } else { None };
    let most_points = sources.iter().map(|source| source.info.points).sum();
    let system = System::new(Some(first), target.format).map_err(|error| Error::io(&first.info.path, error))?;
    system.word.iter().for_each(|word| words.say(&first.info.path, word));
    let head = Head {
        first: Some(first),
        target,
        grid,
        items: items.clone(),
        descriptors: descriptors(first, added, is_marked),
        most_points,
        has_standard_time,
        system,
    };
    let mut write_rows = |order: &InOrder<'_>| {
        for (number, (source, upgrade)) in sources.iter().zip(&upgrades).enumerate() {
            let test = source.record_test(wanted.test);
            let mark = is_marked.then_some(source.has_colors());
            let rows_of = |first_point: u64, records: &[u8]| {
                let points = records.len() / upgrade.record_length;
                let values: Vec<Column> = added.iter().map(|added| added.of(number, first_point, points)).collect();
                let left_out = wanted.left_out(number, first_point, points);
                converted(records, upgrade, test.as_ref(), left_out, (&values, mark))
            };
            warnings.append(&mut source.read_records_in_order(progress, order, rows_of));
        }
    };
    let Some((file, points)) = write_rows_to(head, (file, output), memory, progress, &mut write_rows)? else {
        return Ok(None);
    };
    say_rounded_angles(sources, &upgrades, &mut words);
    Ok(Some(Written { file, points, changes: words.lines(), warnings }))
}

/// The descriptors of the extra dimensions of a file and of those that are added. Bytes that none describes get one, so
/// that those after them are in their places.
fn descriptors(first: &LasSource, added: &[Added], is_marked: bool) -> Vec<u8> {
    let mut descriptors = first.descriptors.clone();
    if added.is_empty() && !is_marked {
        return descriptors;
    }
    let mut rest = first.layout.undescribed();
    while rest > 0 {
        let length = rest.min(usize::from(u8::MAX));
        let mut bytes = descriptor(&Attribute { name: "undescribed".into(), column_type: ColumnType::U8 });
        (bytes[2], bytes[3]) = (0, length as u8);
        descriptors.extend(bytes);
        rest -= length;
    }
    let mut names = Names::default();
    first.layout.properties.iter().for_each(|property| drop(names.take(&property.name, usize::MAX)));
    for own in added.iter().map(Added::field) {
        let wanted = if is_reserved(&own.name) { format!("{}_extra", own.name) } else { own.name };
        let name = names.take(&wanted, EXTRA_LENGTH);
        descriptors.extend(descriptor(&Attribute { name, column_type: own.column_type }));
    }
    if is_marked {
        descriptors.extend(descriptor(&Attribute { name: HAS_COLOR.into(), column_type: ColumnType::U8 }));
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
    (added, mark): (&[Column], Option<bool>),
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
        for values in added {
            match values {
                Column::F64(values) => rows.extend(values[index].to_le_bytes()),
                values => rows.extend((values.value(index) as f32).to_le_bytes()),
            }
        }
        rows.extend(mark.map(u8::from));
    }
    Ok(rows)
}
