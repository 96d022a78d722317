//! LAS and LAZ files made up for tests and benches.
#![allow(dead_code, reason = "each test and bench binary uses its part")]
#![allow(clippy::unwrap_used, reason = "a file that cannot be made up is a failed test")]

use std::io::{Cursor, Seek as _, SeekFrom};

use cloud::Random;
use las::point::{Classification, Format, ScanDirection};
use las::raw::point::Waveform;
use las::{Builder, Color, Point, Transform, Vector, Vlr, Writer};
use laz::laszip::LazItemRecordBuilder;
use laz::{LazVlr, LazVlrBuilder, ParLasZipCompressor};

pub const SCALE: f64 = 0.001;
pub const OFFSETS: [f64; 3] = [600_000.0, 5_000_000.0, 100.0];

fn builder(version: (u8, u8), format: Format) -> Builder {
    let mut builder = Builder::from(version);
    builder.point_format = format;
    builder.has_wkt_crs = format.is_extended;
    let transform = |axis: usize| Transform { scale: SCALE, offset: OFFSETS[axis] };
    builder.transforms = Vector { x: transform(0), y: transform(1), z: transform(2) };
    builder
}

/// Points with a distinctive value in every field that `format` keeps.
pub fn points(format: u8, count: usize) -> Vec<Point> {
    let format = Format::new(format).unwrap();
    let mut noise = Random(7);
    let point = |index: usize| {
        let mut coordinate = |axis: usize, range: u64| OFFSETS[axis] + noise.below(range) as f64 * SCALE;
        let (x, y, z) = (coordinate(0, 900_000), coordinate(1, 900_000), coordinate(2, 40_000));
        let returns = 1 + (index % 5) as u8;
        Point {
            x,
            y,
            z,
            intensity: noise.draw() as u16,
            return_number: 1 + (index as u8 % returns),
            number_of_returns: returns,
            scan_direction: if index.is_multiple_of(2) {
                ScanDirection::LeftToRight
            } else {
                ScanDirection::RightToLeft
            },
            is_edge_of_flight_line: index.is_multiple_of(3),
            classification: Classification::new(1 + (index % 9) as u8).unwrap(),
            is_synthetic: index.is_multiple_of(4),
            is_key_point: index.is_multiple_of(5),
            is_withheld: index.is_multiple_of(7),
            is_overlap: format.is_extended && index.is_multiple_of(6),
            scanner_channel: if format.is_extended { (index / 100 % 4) as u8 } else { 0 },
            scan_angle: if format.is_extended { (index % 100) as f32 * 0.006 } else { (index % 40) as f32 - 20.0 },
            user_data: noise.draw() as u8,
            point_source_id: noise.draw() as u16,
            gps_time: format.has_gps_time.then_some(index as f64 * 0.25),
            color: format.has_color.then(|| Color::new(noise.draw() as u16, noise.draw() as u16, noise.draw() as u16)),
            waveform: format.has_waveform.then_some(Waveform {
                wave_packet_descriptor_index: 1,
                byte_offset_to_waveform_data: index as u64,
                waveform_packet_size_in_bytes: 256,
                return_point_waveform_location: 0.5,
                x_t: 1.0,
                y_t: 2.0,
                z_t: 3.0,
            }),
            nir: format.has_nir.then(|| noise.draw() as u16),
            extra_bytes: Vec::new(),
        }
    };
    (0..count).map(point).collect()
}

/// A LAS file of `points`; `vlrs` as (user, identifier, data).
pub fn las_file(version: (u8, u8), format: u8, points: &[Point], vlrs: &[(&str, u16, Vec<u8>)]) -> Vec<u8> {
    let mut format = Format::new(format).unwrap();
    format.extra_bytes = points.first().map_or(0, |point| point.extra_bytes.len() as u16);
    let mut builder = builder(version, format);
    builder.vlrs = vlrs
        .iter()
        .map(|(user, identifier, data)| Vlr {
            user_id: (*user).into(),
            record_id: *identifier,
            description: String::new(),
            data: data.clone(),
        })
        .collect();
    let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for point in points {
        writer.write_point(point.clone()).unwrap();
    }
    writer.close().unwrap();
    writer.into_inner().unwrap().into_inner()
}

/// One descriptor of an Extra Bytes record.
pub fn descriptor(name: &str, data_type: u8, scale_and_offset: Option<(f64, f64)>) -> Vec<u8> {
    let mut bytes = vec![0; 192];
    bytes[2] = data_type;
    bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
    if let Some((scale, offset)) = scale_and_offset {
        bytes[3] = 8 | 16;
        bytes[112..120].copy_from_slice(&scale.to_le_bytes());
        bytes[136..144].copy_from_slice(&offset.to_le_bytes());
    }
    bytes
}

/// The number of points per chunk of a LAZ file.
pub enum Chunks<'a> {
    Fixed(u32),
    Variable(&'a [usize]),
}

/// The LAZ file of an uncompressed LAS file that ends with its points.
pub fn compress(las: &[u8], chunks: &Chunks<'_>) -> Vec<u8> {
    let header = las::raw::Header::read_from(las).unwrap();
    let start = header.offset_to_point_data as usize;
    let format = header.point_data_record_format;
    let length = header.point_data_record_length;
    let base: u16 =
        LazItemRecordBuilder::default_for_point_format_id(format, 0).unwrap().iter().map(|item| item.size()).sum();
    let items = LazItemRecordBuilder::default_for_point_format_id(format, length - base).unwrap();
    let vlr = LazVlrBuilder::new(items);
    let vlr = match chunks {
        Chunks::Fixed(points) => vlr.with_fixed_chunk_size(*points),
        Chunks::Variable(_) => vlr.with_variable_chunk_size(),
    }
    .build();
    let mut record = Vec::new();
    vlr.write_to(&mut record).unwrap();

    let mut file = las[..start].to_vec();
    file.extend([0; 2]);
    file.extend(LazVlr::USER_ID.bytes().chain([0; 16]).take(16));
    file.extend(LazVlr::RECORD_ID.to_le_bytes());
    file.extend((record.len() as u16).to_le_bytes());
    file.extend([0; 32]);
    file.extend(record);
    file[104] |= 0x80;
    let start_now = file.len() as u32;
    file[96..100].copy_from_slice(&start_now.to_le_bytes());
    let vlrs = header.number_of_variable_length_records + 1;
    file[100..104].copy_from_slice(&vlrs.to_le_bytes());

    let mut cursor = Cursor::new(file);
    cursor.seek(SeekFrom::End(0)).unwrap();
    let mut compressor = ParLasZipCompressor::new(cursor, vlr).unwrap();
    let records = &las[start..];
    match chunks {
        Chunks::Fixed(_) => compressor.compress_many(records).unwrap(),
        Chunks::Variable(counts) => {
            let mut rest = records;
            let pieces: Vec<&[u8]> = counts
                .iter()
                .map(|&count| {
                    let (piece, after) = rest.split_at(count * usize::from(length));
                    rest = after;
                    piece
                })
                .collect();
            compressor.compress_chunks(pieces).unwrap();
        }
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

/// A LAS 1.4 file of point format 7 as an airborne scanner writes it: strips of a hilly terrain in zigzag lines, with
/// intensity, returns, classes, time and 16-bit colours.
pub fn terrain(points: usize) -> Vec<u8> {
    let mut file = las_file((1, 4), 7, &[], &[]);
    let start = file.len();
    let record_length = 36;
    file.reserve(points * record_length);
    let mut noise = Random(1);
    /// The number of points per scan line and of lines per strip.
    const LINE: usize = 1_000;
    const STRIP: usize = 2_000;
    for index in 0..points {
        let (line, column) = (index / LINE, index % LINE);
        let column = if line.is_multiple_of(2) { column } else { LINE - 1 - column };
        let x = (line / STRIP * LINE + column) as f64 * 0.3 + noise.below(100) as f64 * 0.001;
        let y = (line % STRIP) as f64 * 0.3 + noise.below(100) as f64 * 0.001;
        let ground = 40.0 + 20.0 * (x * 0.011).sin() * (y * 0.007).cos() + 3.0 * (x * 0.13).cos() * (y * 0.09).sin();
        let tree = (x * 0.05).sin() + (y * 0.06).sin() > 1.0;
        let z = ground + noise.below(60) as f64 * 0.001 + if tree { noise.below(9_000) as f64 * 0.001 } else { 0.0 };
        let mut record = [0; 36];
        for (axis, value) in [x, y, z].into_iter().enumerate() {
            record[axis * 4..axis * 4 + 4].copy_from_slice(&((value / SCALE).round() as i32).to_le_bytes());
        }
        let intensity = (2_000 + (ground * 40.0) as u16 + noise.below(300) as u16) & 0xfff8;
        record[12..14].copy_from_slice(&intensity.to_le_bytes());
        record[14] = if tree { 0x21 } else { 0x11 };
        record[16] = if tree { 5 } else { 2 };
        record[18..20].copy_from_slice(&((column as i16 - 500) * 6).to_le_bytes());
        record[20..22].copy_from_slice(&(line as u16 / STRIP as u16 + 1).to_le_bytes());
        record[22..30].copy_from_slice(&(2.0e8 + index as f64 * 2.5e-6).to_le_bytes());
        let shade = (ground as u64 + noise.below(12)) as u16;
        let color = if tree { [shade, shade + 40, shade / 2] } else { [shade + 60, shade + 50, shade + 30] };
        for (channel, value) in color.into_iter().enumerate() {
            record[30 + channel * 2..32 + channel * 2].copy_from_slice(&(value << 8).to_le_bytes());
        }
        file.extend(record);
    }
    // The writer knew no points: the counts, old and new.
    file[107..111].copy_from_slice(&0_u32.to_le_bytes());
    file[247..255].copy_from_slice(&(points as u64).to_le_bytes());
    debug_assert_eq!(file.len(), start + points * record_length);
    file
}
