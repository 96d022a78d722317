//! Writes LAS and LAZ files: the header and the records of a file that is there, with other points; or a header of
//! their own.

use std::io::{self, BufReader, BufWriter, Seek as _, SeekFrom, Write as _};

use ::las::raw;
use cloud::Grid;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::record::{LayeredPointRecordCompressor, RecordCompressor, SequentialPointRecordCompressor};
use laz::{LazItem, LazVlr, LazVlrBuilder};
use tempfile::NamedTempFile;

use super::LasSource;
use super::layout::Layout;
use super::output_head::{WAVE_PACKETS, copy_record, is_extra_bytes, is_kept, padded, write_record, write_system};
use super::output_records::{Statistics, Target, forget_range, with_time};
use super::systems::{System, WKT};

/// The number of points of a compressed chunk, as LASzip has it.
pub const CHUNK_POINTS: usize = 50_000;
/// The size in bytes of the head of an extended record.
const EXTENDED_HEAD_LENGTH: u64 = 60;
/// The most descriptors of extra dimensions that fit in a record.
const MOST_DESCRIPTORS: usize = u16::MAX as usize / 192;

/// What a file is to be.
pub struct Head<'a> {
    /// The file whose header and records it keeps.
    pub first: Option<&'a LasSource>,
    pub target: Target,
    pub grid: Grid,
    /// The items of compressed points; `None` for LAS.
    pub items: Option<Vec<LazItem>>,
    /// The descriptors of extra dimensions, one after the other.
    pub descriptors: Vec<u8>,
    /// The most points that it may have.
    pub most_points: u64,
    /// Whether GPS time is standard time; `None` if there is none.
    pub has_standard_time: Option<bool>,
    /// What it says of the coordinate system.
    pub system: System,
}

/// A file that is being written.
pub struct PlainFile<'a> {
    head: Head<'a>,
    vlr: Option<LazVlr>,
    version: (u8, u8),
    out: BufWriter<NamedTempFile>,
    /// The number of bytes written.
    end: u64,
    data_start: u32,
    records: u32,
    table: ChunkTable,
}

impl Head<'_> {
    fn version(&self) -> (u8, u8) {
        let of_first = self.first.map_or((1, 4), |first| first.version);
        // Older headers have no room for more points, for newer formats or for wave packets.
        let least = match self.target.format {
            6.. => (1, 4),
            _ if self.most_points > u64::from(u32::MAX) => (1, 4),
            4 | 5 => (1, 3),
            _ => (1, 2),
        };
        of_first.clamp(least, (1, 4))
    }

    /// The byte of the first file at which its wave packets are kept, if it has them within and they are kept.
    fn waves(&self, header: &raw::Header) -> Option<u64> {
        Layout::wave_packet(self.target.format)?;
        header.start_of_waveform_data_packet_record.filter(|start| *start > 0)
    }
}

impl<'a> PlainFile<'a> {
    /// Writes everything before the points. The header is written last.
    pub fn start(file: NamedTempFile, head: Head<'a>) -> io::Result<Self> {
        let version = head.version();
        let mut bytes = vec![0; usize::from(::las::Version::new(version.0, version.1).header_size())];
        let mut records = 0;
        let mut add = |bytes: &mut Vec<u8>, name: (&str, u16, &str), data: &[u8]| {
            write_record(bytes, name, data);
            records += 1;
        };
        let vlr = head
            .items
            .clone()
            .map(|items| LazVlrBuilder::new(items).with_fixed_chunk_size(CHUNK_POINTS as u32).build());
        if let Some(vlr) = &vlr {
            let mut laszip = Vec::new();
            vlr.write_to(&mut laszip).map_err(io::Error::other)?;
            add(&mut bytes, ("laszip encoded", 22204, "http://laszip.org"), &laszip);
        }
        // Clipped points have other ranges of values.
        let mut descriptors = head.descriptors.clone();
        descriptors.chunks_exact_mut(192).for_each(forget_range);
        for part in descriptors.chunks(192 * MOST_DESCRIPTORS) {
            add(&mut bytes, ("LASF_Spec", 4, "extra dimensions"), part);
        }
        records += write_system(&mut bytes, &head.system);
        for (extended, place) in head.first.iter().flat_map(|first| &first.records) {
            let Some(first) = head.first else { break };
            if *extended || !is_kept(first, place.start, &head.system)? {
                continue;
            }
            let start = bytes.len();
            copy_record(first, place, &mut bytes)?;
            if is_extra_bytes(&bytes[start..]) {
                bytes.truncate(start);
            } else {
                records += 1;
            }
        }
        let data_start = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        if vlr.is_some() {
            // The place of the chunk table's offset.
            bytes.extend([0; 8]);
        }
        let mut out = BufWriter::with_capacity(1 << 20, file);
        out.write_all(&bytes)?;
        let end = bytes.len() as u64;
        Ok(Self { head, vlr, version, out, end, data_start, records, table: ChunkTable::default() })
    }

    /// Writes encoded points. All but the last of several times have `CHUNK_POINTS`.
    pub fn push(&mut self, points: &[u8]) -> io::Result<()> {
        self.out.write_all(points)?;
        self.end += points.len() as u64;
        self.table.push(ChunkTableEntry { point_count: CHUNK_POINTS as u64, byte_count: points.len() as u64 });
        Ok(())
    }

    /// Writes the remainder of the file, which is then complete.
    pub fn finish(mut self, statistics: &Statistics) -> io::Result<NamedTempFile> {
        let table_start = self.end;
        if let Some(vlr) = &self.vlr {
            let mut table = Vec::new();
            self.table.write_to(&mut table, vlr)?;
            self.write(&table)?;
        }
        let header = match self.head.first {
            Some(first) => raw::Header::read_from(BufReader::new(first.file.section(0, first.file.length())))
                .map_err(io::Error::other)?,
            None => raw::Header::default(),
        };
        let (evlr, waves) = self.extended(&header)?;
        let header = self.header(header, statistics, evlr, waves)?;
        self.out.seek(SeekFrom::Start(0))?;
        header.write_to(&mut self.out).map_err(io::Error::other)?;
        if self.vlr.is_some() {
            self.out.seek(SeekFrom::Start(u64::from(self.data_start)))?;
            self.out.write_all(&table_start.to_le_bytes())?;
        }
        let file = self.out.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.as_file().sync_data()?;
        Ok(file)
    }

    /// Gives the unfinished file back.
    pub fn abandon(self) -> NamedTempFile {
        self.out.into_parts().0
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// Copies the extended records that are kept; returns where they are, and where the wave packets are.
    fn extended(&mut self, header: &raw::Header) -> io::Result<(Option<raw::header::Evlr>, u64)> {
        let Some(first) = self.head.first else { return Ok((None, 0)) };
        let start = self.end;
        let mut count = 0;
        for (_, place) in first.records.iter().filter(|(extended, _)| *extended) {
            let head: [u8; 20] = first.file.bytes_at(place.start)?.unwrap_or([0; 20]);
            if is_kept(first, place.start, &self.head.system)? && !is_extra_bytes(&head) {
                self.end += copy_record(first, place, &mut self.out)?;
                count += 1;
            }
        }
        let mut waves = 0;
        if let Some(place) = self.head.waves(header) {
            let length = first.file.bytes_at(place + 20)?.map_or(0, u64::from_le_bytes);
            let end = place.saturating_add(EXTENDED_HEAD_LENGTH).saturating_add(length).min(first.file.length());
            waves = self.end;
            self.end += io::copy(&mut first.file.section(place, end), &mut self.out)?;
            count += 1;
        }
        let evlr = raw::header::Evlr { start_of_first_evlr: start, number_of_evlrs: count };
        Ok(((count > 0).then_some(evlr), waves))
    }

    /// The first file's header with the values that have changed.
    fn header(
        &self,
        header: raw::Header,
        statistics: &Statistics,
        evlr: Option<raw::header::Evlr>,
        waves: u64,
    ) -> io::Result<raw::Header> {
        let Head { target, grid, has_standard_time, .. } = &self.head;
        let version = ::las::Version::new(self.version.0, self.version.1);
        let bounds = statistics.bounds(*grid);
        let mut global_encoding = header.global_encoding;
        if Layout::wave_packet(target.format).is_none() {
            global_encoding &= !WAVE_PACKETS;
        }
        if target.format >= 6 {
            global_encoding |= WKT;
        }
        global_encoding = with_time(global_encoding, *has_standard_time);
        // The old counts are those of the old formats.
        let is_old = target.format < 6;
        let old = |count: u64| u32::try_from(count).unwrap_or(0);
        let by_return = std::array::from_fn(|number| if is_old { old(statistics.by_return[number]) } else { 0 });
        Ok(raw::Header {
            global_encoding,
            version,
            generating_software: padded(concat!("glint ", env!("CARGO_PKG_VERSION"))),
            header_size: version.header_size(),
            offset_to_point_data: self.data_start,
            number_of_variable_length_records: self.records,
            point_data_record_format: target.format | if self.vlr.is_some() { 0x80 } else { 0 },
            point_data_record_length: u16::try_from(target.record_length()).map_err(io::Error::other)?,
            number_of_point_records: if is_old { old(statistics.points) } else { 0 },
            number_of_points_by_return: by_return,
            x_scale_factor: grid.scale.x,
            y_scale_factor: grid.scale.y,
            z_scale_factor: grid.scale.z,
            x_offset: grid.offset.x,
            y_offset: grid.offset.y,
            z_offset: grid.offset.z,
            max_x: bounds.max.x,
            min_x: bounds.min.x,
            max_y: bounds.max.y,
            min_y: bounds.min.y,
            max_z: bounds.max.z,
            min_z: bounds.min.z,
            start_of_waveform_data_packet_record: Some(waves),
            evlr,
            large_file: Some(raw::header::LargeFile {
                number_of_point_records: statistics.points,
                number_of_points_by_return: statistics.by_return,
            }),
            padding: Vec::new(),
            ..header
        })
    }
}

/// Compresses the records of one chunk.
pub fn compress(items: &Vec<LazItem>, records: &[u8], length: usize) -> io::Result<Vec<u8>> {
    fn all<C: RecordCompressor<Vec<u8>>>(
        mut compressor: C,
        items: &Vec<LazItem>,
        records: &[u8],
        length: usize,
    ) -> io::Result<Vec<u8>> {
        compressor.set_fields_from(items).map_err(io::Error::other)?;
        records.chunks_exact(length).try_for_each(|record| compressor.compress_next(record))?;
        compressor.done()?;
        Ok(compressor.into_inner())
    }
    if items.first().is_some_and(|item| item.version() >= 3) {
        all(LayeredPointRecordCompressor::new(Vec::new()), items, records, length)
    } else {
        // The sequential compressor seeks nowhere, and writes one stream.
        all(SequentialPointRecordCompressor::new(Vec::new()), items, records, length)
    }
}
