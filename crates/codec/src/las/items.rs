//! The items of a LASzip record, which describe a compressed point: checks them before a decoder is made, computes the
//! memory of the decoder, and makes it.

use std::io::{self, Read, Seek};

use laz::las::{v1, v2, v3, v4};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItem, LazItemType};

use super::byte_colors::ByteColors;
use super::extra_layers::ExtraLayers;
use super::gps_times::GpsTimes;
use super::point_layers::PointLayers;

/// The memory in bytes of a decoder of points without extra bytes. Measured: 2.6 MB of point format 5, 3.3 MB of 10.
/// Such points are decoded however little memory there is.
pub const BASE_BYTES: u64 = 3_500_000;
/// The memory in bytes of a decoder for each extra byte of a point that is not layered: a model of two tables of 256
/// words and one of 66, what holds it, the byte twice.
const SEQUENTIAL_BYTES: u64 = 2_500;

/// The memory in bytes of the encoder of layered points for each extra byte: models of three tables for four scanner
/// channels, and output that is not yet passed on. Measured: 17,900.
const ENCODER_BYTES: u64 = 18_000;

/// Checks that these items can be decoded, to records of `record_length` bytes; returns whether they are layered.
pub fn check(items: &[LazItem], record_length: usize) -> Result<bool, String> {
    let Some(first) = items.first() else { return Err("no items, expected what a point is made of".into()) };
    let is_layered = first.version() >= 3;
    let decoded: usize = items.iter().map(|item| usize::from(item.size())).sum();
    if decoded != record_length {
        return Err(format!("items of {decoded} bytes in all, expected the {record_length} of a record"));
    }
    for (index, item) in items.iter().enumerate() {
        let (is_known, size) = match item.item_type() {
            LazItemType::Point10 => (!is_layered, 20),
            LazItemType::GpsTime => (!is_layered, 8),
            LazItemType::RGB12 => (!is_layered, 6),
            LazItemType::WavePacket13 => (!is_layered, 29),
            LazItemType::Byte(size) => (!is_layered, size),
            LazItemType::Point14 => (is_layered, 30),
            LazItemType::RGB14 => (is_layered, 6),
            LazItemType::RGBNIR14 => (is_layered, 8),
            LazItemType::WavePacket14 => (is_layered, 29),
            LazItemType::Byte14(size) => (is_layered, size),
        };
        let versions = if is_layered { 3..=4 } else { 1..=2 };
        let (number, kind, version) = (index + 1, u16::from(item.item_type()), item.version());
        if !is_known || !versions.contains(&version) {
            return Err(format!(
                "item {number} is of kind {kind}, version {version}, which does not go with the first"
            ));
        }
        if item.size() != size {
            return Err(format!("item {number} is of kind {kind} and {} bytes, expected {size}", item.size()));
        }
        let same = |other: &LazItem| u16::from(other.item_type()) == kind;
        if items[..index].iter().any(same) {
            return Err(format!("item {number} is of kind {kind}, which is there twice"));
        }
    }
    Ok(is_layered)
}

/// The number of extra bytes of a point.
fn extra_bytes(items: &[LazItem]) -> u64 {
    let extra = |item: &LazItem| match item.item_type() {
        LazItemType::Byte(size) | LazItemType::Byte14(size) => u64::from(size),
        _ => 0,
    };
    items.iter().map(extra).sum()
}

/// The most memory in bytes of a decoder of these items. `filled` is the number of the chunk's layers that are not
/// empty, if it is known.
pub fn decoder_bytes(items: &[LazItem], is_layered: bool, layers: DecompressionSelection, filled: Option<u64>) -> u64 {
    let extra = extra_bytes(items);
    let of_extra = match (is_layered, layers.should_decompress_extra_bytes()) {
        (false, _) => extra * SEQUENTIAL_BYTES,
        (true, false) => extra * ExtraLayers::LAYER_BYTES,
        (true, true) => {
            extra * ExtraLayers::LAYER_BYTES + filled.unwrap_or(extra).min(extra) * ExtraLayers::CONTENT_BYTES
        }
    };
    BASE_BYTES + of_extra
}

/// The most memory in bytes that compressing a chunk of layered points takes, besides its output.
pub fn encoder_bytes(items: &[LazItem]) -> u64 {
    BASE_BYTES + extra_bytes(items) * ENCODER_BYTES
}

/// The number of layers of a chunk: nine for the base of a point, one per colour set, wave packet and extra byte.
pub fn layer_count(items: &[LazItem]) -> u64 {
    items.iter().map(layers_of).sum()
}

fn layers_of(item: &LazItem) -> u64 {
    match item.item_type() {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => u64::from(count),
        _ => 1,
    }
}

/// The layers of a chunk that decide the colours of its points: the first one, which has the scanner channel, and that of
/// the colours.
pub fn layers_of_colors(items: &[LazItem]) -> Option<[u64; 2]> {
    let is_colors = |item: &LazItem| matches!(item.item_type(), LazItemType::RGB14 | LazItemType::RGBNIR14);
    let before = items.iter().position(is_colors)?;
    Some([0, layer_count(&items[..before])])
}

/// Decodes the records of a chunk.
pub enum Decoder<'a, R: Read + Seek> {
    Sequential(SequentialPointRecordDecompressor<'a, R>),
    Layered(LayeredPointRecordDecompressor<'a, R>),
}

impl<R: Read + Seek> Decoder<'_, R> {
    pub fn decode_next(&mut self, record: &mut [u8]) -> io::Result<()> {
        match self {
            Self::Sequential(decoder) => decoder.decompress_next(record),
            Self::Layered(decoder) => decoder.decompress_next(record),
        }
    }

    /// Starts anew with the next chunk, where points are decoded one by one: the source stands at its start.
    pub fn restart(&mut self, items: &[LazItem]) -> Result<(), String> {
        let Self::Sequential(decoder) = self else { return Err("layered chunks end where their sizes say".into()) };
        decoder.reset();
        add_sequential(decoder, items)
    }
}

/// Makes a decoder of one chunk; of a layered one only for `layers`. The items have been checked.
pub fn decoder<'a, R: Read + Seek + Send + Sync + 'a>(
    items: &[LazItem],
    is_layered: bool,
    source: R,
    layers: DecompressionSelection,
) -> Result<Decoder<'a, R>, String> {
    if is_layered {
        let mut decoder = LayeredPointRecordDecompressor::new(source);
        add_layered(&mut decoder, items)?;
        decoder.set_selection(layers);
        Ok(Decoder::Layered(decoder))
    } else {
        let mut decoder = SequentialPointRecordDecompressor::new(source);
        add_sequential(&mut decoder, items)?;
        Ok(Decoder::Sequential(decoder))
    }
}

fn add_sequential<R: Read>(
    decoder: &mut SequentialPointRecordDecompressor<'_, R>,
    items: &[LazItem],
) -> Result<(), String> {
    for item in items {
        let is_last_version = item.version() == 2;
        match (item.item_type(), is_last_version) {
            (LazItemType::Point10, false) => decoder.add_field_decompressor(v1::LasPoint0Decompressor::default()),
            (LazItemType::Point10, true) => decoder.add_field_decompressor(v2::LasPoint0Decompressor::default()),
            (LazItemType::GpsTime, false) => decoder.add_field_decompressor(v1::LasGpsTimeDecompressor::default()),
            (LazItemType::GpsTime, true) => decoder.add_field_decompressor(GpsTimes::of_records()),
            (LazItemType::RGB12, false) => decoder.add_field_decompressor(ByteColors::default()),
            (LazItemType::RGB12, true) => decoder.add_field_decompressor(v2::LasRGBDecompressor::default()),
            (LazItemType::Byte(count), false) => {
                decoder.add_field_decompressor(v1::LasExtraByteDecompressor::new(usize::from(count)));
            }
            (LazItemType::Byte(count), true) => {
                decoder.add_field_decompressor(v2::LasExtraByteDecompressor::new(usize::from(count)));
            }
            // Version 2 was never made different from version 1.
            (LazItemType::WavePacket13, _) => decoder.add_field_decompressor(v1::LasWavepacketDecompressor::default()),
            // `check` refuses these.
            _ => return Err("items that are layered among those that are not".into()),
        }
    }
    Ok(())
}

fn add_layered<R: Read + Seek>(
    decoder: &mut LayeredPointRecordDecompressor<'_, R>,
    items: &[LazItem],
) -> Result<(), String> {
    for item in items {
        let is_last_version = item.version() == 4;
        match (item.item_type(), is_last_version) {
            (LazItemType::Point14, _) => decoder.add_field_decompressor(PointLayers::new(item.version())),
            (LazItemType::RGB14, false) => decoder.add_field_decompressor(v3::LasRGBDecompressor::default()),
            (LazItemType::RGB14, true) => decoder.add_field_decompressor(v4::LasRGBDecompressor::default()),
            (LazItemType::RGBNIR14, false) => {
                decoder.add_field_decompressor(v3::LasRGBDecompressor::default());
                decoder.add_field_decompressor(v3::LasNIRDecompressor::default());
            }
            (LazItemType::RGBNIR14, true) => {
                decoder.add_field_decompressor(v4::LasRGBDecompressor::default());
                decoder.add_field_decompressor(v4::LasNIRDecompressor::default());
            }
            (LazItemType::WavePacket14, false) => {
                decoder.add_field_decompressor(v3::LasWavepacketDecompressor::default());
            }
            (LazItemType::WavePacket14, true) => {
                decoder.add_field_decompressor(v4::LasWavepacketDecompressor::default());
            }
            (LazItemType::Byte14(count), _) => {
                decoder.add_field_decompressor(ExtraLayers::new(usize::from(count), item.version()));
            }
            // `check` refuses these.
            _ => return Err("items that are not layered among those that are".into()),
        }
    }
    Ok(())
}
