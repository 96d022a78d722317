//! Writes the COPC file: header, records, chunks in the order of their arrival, chunk table, hierarchy.

use std::collections::BTreeSet;
use std::io::{self, BufReader, BufWriter, Seek as _, SeekFrom, Write};
use std::ops::Range;

use ::las::raw;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use tempfile::NamedTempFile;

use super::tree::{self, Cube};
use super::{Compressed, OutputFormat};
use crate::las::LasSource;
use crate::las::output_head::{
    HEAD_LENGTH, WAVE_PACKETS, copy_record, is_extra_bytes, is_kept, padded, write_record, write_system,
};
use crate::las::output_records::{Statistics, forget_range, with_time};
use crate::las::systems::WKT;

const HEADER_LENGTH: u16 = 375;
const INFO_LENGTH: usize = 160;
/// The size in bytes of the head of an extended record.
const EXTENDED_HEAD_LENGTH: u64 = 60;
/// The most nodes of a page without pages below it: 128 KiB.
const PAGE_NODES: usize = 4096;
/// The number of levels of a page with pages below it.
const PAGE_LEVELS: u32 = 5;
/// The least number of nodes for a page of their own.
const LEAST_PAGE_NODES: usize = 16;
/// The number of levels that fit in a code.
const CODE_LEVELS: u32 = 21;
/// The number of cells along a node's edge; it keeps a point of each.
const SPACINGS: f64 = (1 << tree::CELL_LEVELS) as f64;

pub struct CopcFile {
    out: BufWriter<NamedTempFile>,
    /// The number of bytes written, which is the offset of the next ones.
    end: u64,
    data_start: u32,
    records: u32,
    table: ChunkTable,
    nodes: Vec<Entry>,
}

#[derive(Clone, Copy)]
struct Entry {
    level: u32,
    code: u64,
    offset: u64,
    bytes: i32,
    points: i32,
}

impl Entry {
    /// The range of the deepest cells that the node contains.
    fn covers(&self) -> Range<u64> {
        let shift = 3 * (CODE_LEVELS - self.level);
        self.code << shift..(self.code + 1) << shift
    }
}

impl CopcFile {
    /// Writes everything before the points. The header and the info record are written last.
    pub fn start(file: NamedTempFile, plan: &OutputFormat, sources: &[&LasSource]) -> io::Result<Self> {
        let mut head = vec![0; usize::from(HEADER_LENGTH) + HEAD_LENGTH + INFO_LENGTH];
        let mut laszip = Vec::new();
        plan.vlr.write_to(&mut laszip).map_err(io::Error::other)?;
        write_record(&mut head, ("laszip encoded", 22204, "http://laszip.org"), &laszip);
        let mut records = 2 + write_system(&mut head, &plan.system);
        let first = sources[0];
        for (extended, place) in &first.records {
            if *extended || !is_kept(first, place.start, &plan.system)? {
                continue;
            }
            let start = head.len();
            copy_record(first, place, &mut head)?;
            if sources.len() > 1 && is_extra_bytes(&head[start..]) {
                // The ranges of the first file's values are not those of all files.
                head[start + HEAD_LENGTH..].chunks_exact_mut(192).for_each(forget_range);
            }
            records += 1;
        }
        let data_start = u32::try_from(head.len()).map_err(io::Error::other)?;
        // The place of the chunk table's offset.
        head.extend([0; 8]);
        let mut out = BufWriter::with_capacity(1 << 20, file);
        out.write_all(&head)?;
        Ok(Self { out, end: head.len() as u64, data_start, records, table: ChunkTable::default(), nodes: Vec::new() })
    }

    /// The number of nodes written.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    pub fn push(&mut self, node: &Compressed) -> io::Result<()> {
        let (offset, length) = (self.end, node.chunk.len());
        let (bytes, points) = (i32::try_from(length), i32::try_from(node.points));
        let (bytes, points) = (bytes.map_err(io::Error::other)?, points.map_err(io::Error::other)?);
        self.out.write_all(&node.chunk)?;
        self.end += length as u64;
        self.table.push(ChunkTableEntry { point_count: u64::from(node.points), byte_count: length as u64 });
        self.nodes.push(Entry { level: node.level, code: node.code, offset, bytes, points });
        Ok(())
    }

    /// Writes the remainder of the file, which is then complete.
    pub fn finish(
        mut self,
        plan: &OutputFormat,
        first: &LasSource,
        cube: &Cube,
        statistics: &Statistics,
    ) -> io::Result<NamedTempFile> {
        let table_start = self.end;
        let mut table = Vec::new();
        self.table.write_to(&mut table, &plan.vlr)?;
        self.out.write_all(&table)?;
        let extended_start = table_start + table.len() as u64;
        let pages_start = extended_start + EXTENDED_HEAD_LENGTH;
        let (pages, root) = self.hierarchy(pages_start)?;
        let mut extended = Vec::new();
        extended.extend([0; 2]);
        extended.extend(padded::<16>("copc"));
        extended.extend(1000_u16.to_le_bytes());
        extended.extend((pages.len() as u64).to_le_bytes());
        extended.extend(padded::<32>("EPT hierarchy"));
        self.out.write_all(&extended)?;
        self.out.write_all(&pages)?;
        let mut extended_records = 1;
        for (_, place) in first.records.iter().filter(|(extended, _)| *extended) {
            if is_kept(first, place.start, &plan.system)? {
                copy_record(first, place, &mut self.out)?;
                extended_records += 1;
            }
        }

        let evlr = raw::header::Evlr { start_of_first_evlr: extended_start, number_of_evlrs: extended_records };
        let header = self.header(plan, first, statistics, evlr)?;
        let info = info(cube, statistics, &root);
        self.out.seek(SeekFrom::Start(0))?;
        header.write_to(&mut self.out).map_err(io::Error::other)?;
        let mut record = Vec::new();
        write_record(&mut record, ("copc", 1, "COPC info VLR"), &info);
        self.out.write_all(&record)?;
        self.out.seek(SeekFrom::Start(u64::from(self.data_start)))?;
        self.out.write_all(&table_start.to_le_bytes())?;
        let file = self.out.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.as_file().sync_data()?;
        Ok(file)
    }

    /// The pages of all nodes, to be written at byte `start` of the file, and the range of the root's page. Nodes that
    /// only have nodes below them are listed without points.
    fn hierarchy(&mut self, start: u64) -> io::Result<(Vec<u8>, Range<u64>)> {
        let mut listed: BTreeSet<(u32, u64)> = self.nodes.iter().map(|node| (node.level, node.code)).collect();
        for index in 0..self.nodes.len() {
            let Entry { mut level, mut code, .. } = self.nodes[index];
            while level > 0 {
                (level, code) = (level - 1, code >> 3);
                if !listed.insert((level, code)) {
                    break;
                }
                self.nodes.push(Entry { level, code, offset: 0, bytes: 0, points: 0 });
            }
        }
        // Each node comes before those below it, and those before the next of its level.
        self.nodes.sort_unstable_by_key(|node| (node.covers().start, node.level));
        let mut pages = Vec::new();
        let root = write_page(&self.nodes, start, &mut pages)?;
        Ok((pages, root))
    }

    /// The first file's header with the values that have changed.
    fn header(
        &self,
        plan: &OutputFormat,
        first: &LasSource,
        statistics: &Statistics,
        evlr: raw::header::Evlr,
    ) -> io::Result<raw::Header> {
        let of_first = raw::Header::read_from(BufReader::new(first.file.section(0, first.file.length())));
        let bounds = statistics.bounds(plan.grid);
        let header = of_first.map_err(io::Error::other)?;
        Ok(raw::Header {
            global_encoding: with_time(header.global_encoding & !WAVE_PACKETS | WKT, plan.has_standard_time),
            version: ::las::Version::new(1, 4),
            generating_software: padded(concat!("glint ", env!("CARGO_PKG_VERSION"))),
            header_size: HEADER_LENGTH,
            offset_to_point_data: self.data_start,
            number_of_variable_length_records: self.records,
            point_data_record_format: plan.target.format | 0x80,
            point_data_record_length: u16::try_from(plan.target.record_length()).map_err(io::Error::other)?,
            number_of_point_records: 0,
            number_of_points_by_return: [0; 5],
            x_scale_factor: plan.grid.scale.x,
            y_scale_factor: plan.grid.scale.y,
            z_scale_factor: plan.grid.scale.z,
            x_offset: plan.grid.offset.x,
            y_offset: plan.grid.offset.y,
            z_offset: plan.grid.offset.z,
            max_x: bounds.max.x,
            min_x: bounds.min.x,
            max_y: bounds.max.y,
            min_y: bounds.min.y,
            max_z: bounds.max.z,
            min_z: bounds.min.z,
            start_of_waveform_data_packet_record: Some(0),
            evlr: Some(evlr),
            large_file: Some(raw::header::LargeFile {
                number_of_point_records: statistics.points,
                number_of_points_by_return: statistics.by_return,
            }),
            padding: Vec::new(),
            ..header
        })
    }
}

/// Writes the page of a node and all nodes below it, then the pages below that one: some readers look for the root's
/// page first.
fn write_page(nodes: &[Entry], start: u64, pages: &mut Vec<u8>) -> io::Result<Range<u64>> {
    let mut listed: Vec<(Entry, Option<&[Entry]>)> = Vec::new();
    let mut rest = nodes;
    while let Some((node, after)) = rest.split_first() {
        let below = after.partition_point(|other| other.covers().start < node.covers().end);
        let is_page =
            nodes.len() > PAGE_NODES && node.level == nodes[0].level + PAGE_LEVELS && below >= LEAST_PAGE_NODES;
        let (page, others) = rest.split_at(if is_page { 1 + below } else { 1 });
        listed.push((*node, is_page.then_some(page)));
        rest = others;
    }
    listed.sort_unstable_by_key(|(node, _)| (node.level, node.code));
    let place = pages.len()..pages.len() + 32 * listed.len();
    pages.resize(place.end, 0);
    let mut entries = Vec::with_capacity(place.len());
    for (mut node, page) in listed {
        if let Some(page) = page {
            let page = write_page(page, start, pages)?;
            let bytes = i32::try_from(page.end - page.start).map_err(io::Error::other)?;
            node = Entry { offset: page.start, bytes, points: -1, ..node };
        }
        let [x, y, z] = tree::cell(node.code);
        for number in [node.level, x, y, z] {
            entries.extend((number as i32).to_le_bytes());
        }
        entries.extend(node.offset.to_le_bytes());
        entries.extend(node.bytes.to_le_bytes());
        entries.extend(node.points.to_le_bytes());
    }
    pages[place.clone()].copy_from_slice(&entries);
    Ok(start + place.start as u64..start + place.end as u64)
}

fn info(cube: &Cube, statistics: &Statistics, root: &Range<u64>) -> Vec<u8> {
    let half = cube.width / 2.0;
    let center = cube.corner + half;
    let mut info = Vec::with_capacity(INFO_LENGTH);
    for number in [center.x, center.y, center.z, half, cube.width / SPACINGS] {
        info.extend(number.to_le_bytes());
    }
    info.extend(root.start.to_le_bytes());
    info.extend((root.end - root.start).to_le_bytes());
    for time in [statistics.first_time, statistics.last_time] {
        info.extend(time.to_le_bytes());
    }
    info.resize(INFO_LENGTH, 0);
    info
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::bytes::Bytes;
    use crate::las::Copc;
    use crate::las::compressed::CompressedChunk;

    /// Four nodes below each, for this many levels; one branch in ten goes no further down.
    fn surface(levels: u32) -> Vec<Entry> {
        let mut nodes = Vec::new();
        let mut codes = vec![0_u64];
        for level in 0..levels {
            let entry = |code: &u64| Entry { level, code: *code, offset: 0, bytes: 100, points: 7 };
            nodes.extend(codes.iter().map(entry));
            let goes_on = |code: &&u64| level < 3 || **code % 10 != 3;
            codes =
                codes.iter().filter(goes_on).flat_map(|code| (0..4).map(move |octant| code << 3 | octant)).collect();
        }
        nodes.sort_unstable_by_key(|node| (node.covers().start, node.level));
        nodes.iter_mut().zip(0..).for_each(|(node, index)| node.offset = 1000 + 100 * index);
        nodes
    }

    #[test]
    fn a_hierarchy_of_many_nodes_is_in_pages_of_some_hundreds_and_comes_back() {
        const START: u64 = 500;
        for (levels, most_entries) in [(1, 1), (6, PAGE_NODES), (9, PAGE_NODES / 2), (11, PAGE_NODES / 2)] {
            let nodes = surface(levels);
            let mut pages = Vec::new();
            let root = write_page(&nodes, START, &mut pages).unwrap();
            let entries = (root.end - root.start) as usize / 32;
            assert_eq!(root.start, START);
            assert!(entries <= most_entries, "{entries}");
            assert!(pages.len() / 32 <= nodes.len() + nodes.len() / 30, "links cost little");
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), [vec![0; START as usize], pages.clone()].concat()).unwrap();
            let file = Bytes::open(file.path()).unwrap();
            let chunk = |node: &Entry| CompressedChunk { first_point: 0, points: 7, offset: node.offset, length: 100 };
            let chunks: Vec<CompressedChunk> = nodes.iter().map(chunk).collect();
            let (found, _) = Copc::read_pages(&file, START..START + pages.len() as u64, root, &chunks).unwrap();
            let expected: HashMap<(u32, [u32; 3]), u64> =
                nodes.iter().map(|node| ((node.level, tree::cell(node.code)), node.offset)).collect();
            assert_eq!(found.len(), expected.len());
            assert!(
                found.iter().all(|(key, node)| node.chunk().map(|chunk| chunk.offset) == expected.get(key).copied())
            );
        }
    }
}
