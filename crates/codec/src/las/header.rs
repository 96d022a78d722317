//! Reads the header of a LAS or LAZ file and the relevant variable length records, checked against the file's size.
//!
//! Fixed fields go through `las::raw::Header`, which reads them unchanged; the record lists are walked here, because a
//! count or length from the file must be checked before it bounds a loop or an allocation.

use std::io::BufReader;
use std::ops::Range;

use ::las::raw;
use cloud::{Bounds, Grid};
use glam::DVec3;

use super::layout::{Layout, bytes, text};
use crate::brief::vector;
use crate::bytes::Bytes;
use crate::units::geotiff::GeoTiff;
use crate::units::wkt;
use crate::{Error, Result, Units};

/// The most records: files have a handful, so a larger count is damage.
const MOST_RECORDS: u64 = 10_000;
/// The bit of the global encoding for a coordinate system in well-known text (LAS 1.4; zero before).
const WKT_BIT: u16 = 16;
/// The longest extended record that is loaded: a coordinate system or a list of extra dimensions has some kilobytes.
const LONGEST_EXTENDED_RECORD: u64 = 16 << 20;

pub struct Header {
    /// Major, minor.
    pub version: (u8, u8),
    pub point_format: u8,
    pub compressed: bool,
    pub record_length: usize,
    /// The offset in bytes of the first point; in LAZ of the chunk table's offset.
    pub data_start: u64,
    /// The number of points that the header promises.
    pub points: u64,
    /// Whether no extended record or waveform follows the points.
    pub points_are_last: bool,
    pub grid: Grid,
    pub bounds: Option<Bounds>,
    pub crs: Option<String>,
    pub epsg: Option<u32>,
    pub units: Units,
    /// The Extra Bytes descriptors, one after the other.
    pub descriptors: Vec<u8>,
    /// The content of the LASzip record.
    pub laszip: Option<Vec<u8>>,
    /// The offset in the file of the COPC info record's data, and the data.
    pub copc_info: Option<(u64, Vec<u8>)>,
    /// Whether GPS time is standard time instead of seconds of a week.
    pub standard_time: bool,
    pub global_encoding: u16,
    /// For each variable length record, whether it is extended, and its bytes in the file, head included.
    pub records: Vec<(bool, Range<u64>)>,
    /// The bytes of the file that contain the pages of the COPC hierarchy.
    pub copc_pages: Option<Range<u64>>,
}

impl Header {
    pub fn read(file: &Bytes, warnings: &mut Vec<String>) -> Result<Self> {
        let malformed = |place: &str, problem: String| Error::malformed(file.path(), place, problem);
        let raw = raw::Header::read_from(BufReader::new(file.section(0, file.length()))).map_err(|error| {
            let length = file.length();
            malformed("header", format!("{error} (the file has {length} bytes; a LAS header has 227 to 393)"))
        })?;

        let version = (raw.version.major, raw.version.minor);
        match version {
            (1, 0..=4) => {}
            (1, 5) => warnings.push("LAS 1.5 is read as LAS 1.4: what is new in it is not shown".into()),
            (major, minor) => {
                return Err(malformed("byte 24", format!("LAS version {major}.{minor}, expected 1.0 to 1.5")));
            }
        }
        // Bits 6 and 7 of the format mark LAZ.
        let point_format = raw.point_data_record_format & 0x3f;
        let compressed = raw.point_data_record_format & 0xc0 != 0;
        let Some(base_length) = Layout::base_length(point_format) else {
            return Err(malformed("byte 104", format!("point format {point_format}, expected 0 to 10")));
        };
        let record_length = usize::from(raw.point_data_record_length);
        if record_length < base_length {
            return Err(malformed(
                "byte 105",
                format!(
                    "point records of {record_length} bytes, but point format {point_format} has at least {base_length}"
                ),
            ));
        }

        let grid = Grid::new(
            DVec3::new(raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor),
            DVec3::new(raw.x_offset, raw.y_offset, raw.z_offset),
        );
        // Offsets within a chunk are f32, so the widest step between two 32-bit coordinates must fit.
        let widest = grid.scale.abs() * f64::from(u32::MAX);
        // Comparisons that a NaN fails.
        let usable = |axis: usize| {
            let most = f64::from(f32::MAX);
            grid.scale[axis] != 0.0 && widest[axis] < most && grid.offset[axis].abs() < most
        };
        if !(0..3).all(usable) {
            return Err(malformed(
                "bytes 131 to 179",
                format!(
                    "scale {} and offset {} give no coordinates; expected finite numbers and no scale of 0",
                    vector(grid.scale),
                    vector(grid.offset)
                ),
            ));
        }

        let standard_size = raw.version.header_size();
        let header_size = if raw.header_size < standard_size {
            warnings.push(format!(
                "byte 94: a header of {} bytes, expected {standard_size} or more: read as {standard_size}",
                raw.header_size
            ));
            standard_size
        } else {
            raw.header_size
        };

        let mut records = Records::default();
        let vlr_count = u64::from(raw.number_of_variable_length_records);
        // A writer that was stopped leaves 0 here; the points then follow the records.
        let unfinished = raw.offset_to_point_data == 0;
        let vlr_end = if unfinished { file.length() } else { u64::from(raw.offset_to_point_data) };
        let after_vlrs = records.walk(file, u64::from(header_size), vlr_end, vlr_count, false, warnings)?;
        let data_start = if unfinished {
            warnings.push(format!(
                "byte 96: no offset to the points: taken to follow the header's records, at byte {after_vlrs}"
            ));
            after_vlrs
        } else {
            vlr_end
        };
        if data_start < u64::from(header_size) || data_start > file.length() {
            return Err(malformed(
                "byte 96",
                format!(
                    "points start at byte {data_start}, expected {header_size} to {} (the file's length)",
                    file.length()
                ),
            ));
        }
        if let Some(evlr) = &raw.evlr {
            let (start, count) = (evlr.start_of_first_evlr, u64::from(evlr.number_of_evlrs));
            if start < data_start || start >= file.length() {
                warnings.push(format!(
                    "byte 235: {count} extended records announced at byte {start}, outside the file's {} bytes: skipped",
                    file.length()
                ));
            } else {
                records.walk(file, start, file.length(), count, true, warnings)?;
            }
        }

        // LAS 1.4 has a 64-bit count and may leave the old one 0 (or the other way round, from careless writers).
        let legacy = u64::from(raw.number_of_point_records);
        let points = raw.large_file.map_or(0, |large| large.number_of_point_records);
        let points = if points == 0 { legacy } else { points };

        let (crs, units) = records.system(version >= (1, 4), raw.global_encoding & WKT_BIT != 0, warnings);
        // A name that is no text is that of the keys.
        let is_text = crs.as_deref().is_some_and(wkt::is_text);
        let epsg = if is_text { crs.as_deref().and_then(wkt::level_code) } else { records.geotiff().code() };
        let bounds = Bounds {
            min: DVec3::new(raw.min_x, raw.min_y, raw.min_z),
            max: DVec3::new(raw.max_x, raw.max_y, raw.max_z),
        };
        let bounds = believable(bounds, &grid).then_some(bounds);
        if bounds.is_none() && points > 0 {
            warnings.push("the header's bounds are not those of a cloud: ignored".into());
        }

        Ok(Self {
            version,
            point_format,
            compressed,
            record_length,
            data_start,
            points,
            points_are_last: raw.evlr.is_none() && raw.start_of_waveform_data_packet_record.is_none(),
            grid,
            bounds,
            crs,
            epsg,
            units,
            descriptors: records.descriptors,
            laszip: records.laszip,
            copc_info: records.copc_info,
            copc_pages: records.copc_pages,
            standard_time: raw.global_encoding & 1 != 0,
            global_encoding: raw.global_encoding,
            records: records.places,
        })
    }
}

/// Whether bounds are ordered, finite, and within reach of 32-bit coordinates on the grid (with a step to spare for
/// rounding).
fn believable(bounds: Bounds, grid: &Grid) -> bool {
    let reach = grid.scale.abs() * (f64::from(i32::MAX) + 2.0);
    let limits = Bounds { min: grid.offset - reach, max: grid.offset + reach };
    !bounds.is_empty() && limits.contains(bounds.min) && limits.contains(bounds.max)
}

/// The relevant records.
#[derive(Default)]
struct Records {
    wkt: Option<String>,
    /// Well-known text of version 2, which has a record of its own.
    wkt_2: Option<String>,
    geotiff_keys: Vec<u8>,
    geotiff_doubles: Vec<u8>,
    geotiff_text: Vec<u8>,
    descriptors: Vec<u8>,
    laszip: Option<Vec<u8>>,
    copc_info: Option<(u64, Vec<u8>)>,
    copc_pages: Option<Range<u64>>,
    /// For each record, whether it is extended, and its bytes in the file.
    places: Vec<(bool, Range<u64>)>,
}

impl Records {
    /// Walks `count` records from byte `start`, none beyond `end`; returns where it stopped.
    fn walk(
        &mut self,
        file: &Bytes,
        start: u64,
        end: u64,
        count: u64,
        extended: bool,
        warnings: &mut Vec<String>,
    ) -> Result<u64> {
        let io = |error| Error::io(file.path(), error);
        // Reserved 2, user 16, identifier 2, length 2 or 8, description 32.
        let (kind, head_length) = if extended { ("extended record", 60) } else { ("variable length record", 54) };
        let mut position = start;
        for index in 0..count.min(MOST_RECORDS) {
            let head = if position + head_length <= end { file.bytes_at::<28>(position).map_err(io)? } else { None };
            let length = head.map(|head| {
                if extended {
                    u64::from_le_bytes(bytes(&head, 20))
                } else {
                    u64::from(u16::from_le_bytes(bytes(&head, 20)))
                }
            });
            let (Some(head), Some(next)) = (
                head,
                length.and_then(|length| (position + head_length).checked_add(length)).filter(|&next| next <= end),
            ) else {
                warnings.push(format!(
                    "byte {position}: {kind} {} of {count} does not end before byte {end}: it and the rest are skipped",
                    index + 1
                ));
                return Ok(position);
            };
            let identifier = u16::from_le_bytes(bytes(&head, 18));
            let user = text(&head[2..18]);
            if (user.as_str(), identifier) == ("copc", 1000) {
                // The pages are read one by one when they are needed.
                self.copc_pages = Some(position + head_length..next);
            } else if is_wanted(&user, identifier) && next - position <= LONGEST_EXTENDED_RECORD {
                let section = BufReader::new(file.section(position, next));
                match raw::Vlr::read_from(section, extended) {
                    Ok(record) => self.keep(&user, identifier, position + head_length, record.data),
                    Err(error) => warnings.push(format!("byte {position}: {kind} {}: {error}", index + 1)),
                }
            }
            self.places.push((extended, position..next));
            position = next;
        }
        if count > MOST_RECORDS {
            warnings.push(format!("{count} {kind}s announced: only the first {MOST_RECORDS} were looked at"));
        }
        Ok(position)
    }

    /// Keeps `data` of a record, which starts at byte `start` of the file.
    fn keep(&mut self, user: &str, identifier: u16, start: u64, mut data: Vec<u8>) {
        match (user, identifier) {
            ("LASF_Projection", 2112 | 4224) => {
                let wkt = text(&data);
                let place = if identifier == 2112 { &mut self.wkt } else { &mut self.wkt_2 };
                if !wkt.is_empty() {
                    *place = Some(wkt);
                }
            }
            ("LASF_Projection", 34735) => self.geotiff_keys = data,
            ("LASF_Projection", 34736) => self.geotiff_doubles = data,
            ("LASF_Projection", 34737) => self.geotiff_text = data,
            // The descriptors may come in several records; a part of one at the end of a record is dropped.
            ("LASF_Spec", 4) => {
                data.truncate(data.len() - data.len() % 192);
                self.descriptors.append(&mut data);
            }
            ("copc", _) => self.copc_info = Some((start, data)),
            _ => self.laszip = Some(data),
        }
    }

    /// The coordinate system and its units: well-known text, or else the keys of GeoTIFF. Of a file with both, the bit of
    /// the global encoding says which counts, and a warning says so, unless both are the same. Where codes do not say
    /// that, keys beside text that counts are taken for the same if their units are. Before LAS 1.4 there was no such bit.
    fn system(&self, has_bit: bool, is_bit_set: bool, warnings: &mut Vec<String>) -> (Option<String>, Units) {
        let keys = self.geotiff();
        let mut of_keys = Vec::new();
        let (name, units) = (keys.name(), keys.units(&mut of_keys));
        let Some(text) = self.wkt.as_ref().or(self.wkt_2.as_ref()) else {
            warnings.append(&mut of_keys);
            return (name, units);
        };
        let own = wkt::units(text);
        if let Some(other) = self.wkt_2.as_ref().map(|other| wkt::units(other)).filter(|other| other.contradict(&own)) {
            let [own, other] = [own, other].map(|units| units.text());
            warnings.push(format!("record 2112 has units {own}, and record 4224 has {other}: record 2112 counts"));
        }
        if name.is_none() && units == Units::default() {
            return (Some(text.clone()), own);
        }
        let is_one_code = keys.code().zip(wkt::code(text)).map(|(of_keys, of_text)| of_keys == of_text);
        if is_one_code.unwrap_or(!has_bit || is_bit_set) && !own.contradict(&units) {
            return (Some(text.clone()), own.or(units));
        }
        let (bit, counts) = if is_bit_set { ("set", "WKT counts") } else { ("clear", "GeoTIFF counts") };
        warnings.push(format!(
            "byte 6: the file has a coordinate system as WKT and one as GeoTIFF, and the WKT bit is {bit}: {counts}"
        ));
        if is_bit_set {
            return (Some(text.clone()), own);
        }
        warnings.append(&mut of_keys);
        (name, units)
    }

    fn geotiff(&self) -> GeoTiff<'_> {
        // The directory's own entry comes first.
        let entries = self.geotiff_keys.chunks_exact(8).skip(1);
        GeoTiff {
            keys: entries.map(|entry| std::array::from_fn(|i| u16::from_le_bytes(bytes(entry, 2 * i)))).collect(),
            doubles: self.geotiff_doubles.chunks_exact(8).map(|number| f64::from_le_bytes(bytes(number, 0))).collect(),
            text: &self.geotiff_text,
        }
    }
}

fn is_wanted(user: &str, identifier: u16) -> bool {
    matches!(
        (user, identifier),
        ("LASF_Projection", 2112 | 4224 | 34735..=34737) | ("LASF_Spec", 4) | ("laszip encoded", 22204) | ("copc", 1)
    )
}
