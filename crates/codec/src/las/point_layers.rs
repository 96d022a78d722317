//! Decodes the base of layered points (LASzip item `POINT14`, versions 3 and 4): what all points of formats 6 to 10
//! have, in nine layers.
//!
//! The decoder of `laz` uses up the stack on damaged times, see `gps_times.rs`. This one decodes the same values.
//! Models of a scanner channel are built when its first point comes. The coding is that of LASzip (Isenburg 2013,
//! "LASzip: lossless compression of LiDAR data"), and the code follows laz-rs (Apache-2.0).

use std::array;
use std::io::{self, Cursor, Read, Seek};

use laz::DecompressionSelection;
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::LayeredFieldDecompressor;

use super::gps_times::GpsTimes;

/// The number of scanner channels, each of which has models of its own.
pub const CHANNELS: usize = 4;
/// The bits of the flags that have the scanner channel.
const CHANNEL_BITS: u8 = 0b0011_0000;
/// The length in bytes of the item.
const LENGTH: usize = 30;
/// The number of layers.
const LAYERS: usize = 9;

/// The compressed bytes of a layer.
pub type Layer = ArithmeticDecoder<Cursor<Vec<u8>>>;

/// Reads a layer of `length` bytes, or skips it. Returns `None` where there is nothing to decode.
pub fn read_layer<R: Read + Seek>(source: &mut R, length: u32, is_wanted: bool) -> io::Result<Option<Layer>> {
    if length == 0 {
        return Ok(None);
    }
    if !is_wanted {
        source.seek_relative(i64::from(length))?;
        return Ok(None);
    }
    let mut bytes = vec![0; length as usize];
    source.read_exact(&mut bytes)?;
    let mut layer = ArithmeticDecoder::new(Cursor::new(bytes));
    layer.read_init_bytes()?;
    Ok(Some(layer))
}

/// Decodes the base of the records of one chunk.
pub struct PointLayers {
    /// Version 4 passes the items after this one the channel of every point, version 3 only where it changes.
    tells_every_channel: bool,
    wanted: DecompressionSelection,
    lengths: [u32; LAYERS],
    layers: Option<Layers>,
    /// `None` until the channel has a point.
    channels: [Option<Box<Channel>>; CHANNELS],
    channel: usize,
}

/// The layers of a chunk. Those that never change or are not wanted are `None`.
struct Layers {
    returns_xy: Layer,
    z: Option<Layer>,
    classification: Option<Layer>,
    flags: Option<Layer>,
    intensity: Option<Layer>,
    scan_angle: Option<Layer>,
    user_data: Option<Layer>,
    source: Option<Layer>,
    time: Option<Layer>,
}

impl PointLayers {
    /// A decoder for `version` 3 or 4 of the item.
    pub fn new(version: u16) -> Self {
        Self {
            tells_every_channel: version == 4,
            wanted: DecompressionSelection::all(),
            lengths: [0; LAYERS],
            layers: None,
            channels: Default::default(),
            channel: 0,
        }
    }
}

impl<R: Read + Seek> LayeredFieldDecompressor<R> for PointLayers {
    fn size_of_field(&self) -> usize {
        LENGTH
    }

    fn set_selection(&mut self, selection: DecompressionSelection) {
        self.wanted = selection;
    }

    fn init_first_point(&mut self, source: &mut R, point: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let mut bytes = [0; LENGTH];
        source.read_exact(&mut bytes)?;
        point.copy_from_slice(&bytes);
        let first = Point::read(&bytes);
        self.channel = usize::from((first.flags & CHANNEL_BITS) >> 4);
        self.channels = Default::default();
        self.channels[self.channel] = Some(Box::new(Channel::after(&first)));
        *channel = self.channel;
        Ok(())
    }

    fn read_layers_sizes(&mut self, source: &mut R) -> io::Result<()> {
        for length in &mut self.lengths {
            let mut bytes = [0; 4];
            source.read_exact(&mut bytes)?;
            *length = u32::from_le_bytes(bytes);
        }
        Ok(())
    }

    fn read_layers(&mut self, source: &mut R) -> io::Result<()> {
        let wanted = self.wanted;
        let [returns_xy, z, classification, flags, intensity, scan_angle, user_data, source_id, time] = self.lengths;
        // The fields are read in the order in which they stand here, which is that of the file.
        self.layers = Some(Layers {
            returns_xy: read_layer(source, returns_xy, true)?
                .unwrap_or_else(|| ArithmeticDecoder::new(Cursor::new(Vec::new()))),
            z: read_layer(source, z, wanted.should_decompress_z())?,
            classification: read_layer(source, classification, wanted.should_decompress_classification())?,
            flags: read_layer(source, flags, wanted.should_decompress_flags())?,
            intensity: read_layer(source, intensity, wanted.should_decompress_intensity())?,
            scan_angle: read_layer(source, scan_angle, wanted.should_decompress_scan_angle())?,
            user_data: read_layer(source, user_data, wanted.should_decompress_user_data())?,
            source: read_layer(source, source_id, wanted.should_decompress_point_source_id())?,
            time: read_layer(source, time, wanted.should_decompress_gps_time())?,
        });
        Ok(())
    }

    fn decompress_field_with(&mut self, point: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let (Some(layers), Some(before)) = (&mut self.layers, &mut self.channels[self.channel]) else {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a point before the first"));
        };
        let changes = layers.returns_xy.decode_symbol(&mut before.changes[before.last.context()])?;
        let mut current = before;
        if changes & 1 << 6 != 0 {
            let step = layers.returns_xy.decode_symbol(&mut current.channel_steps)?;
            let last = current.last;
            self.channel = (self.channel + step as usize + 1) % CHANNELS;
            current = self.channels[self.channel].get_or_insert_with(|| Box::new(Channel::after(&last)));
            current.last.flags = current.last.flags & !CHANNEL_BITS | (self.channel as u8) << 4;
            *channel = self.channel;
        }
        if self.tells_every_channel {
            *channel = self.channel;
        }
        current.decode(layers, changes)?;
        current.last.write(point)
    }
}

/// The last point of a scanner channel.
#[derive(Clone, Copy)]
struct Point {
    x: i32,
    y: i32,
    z: i32,
    intensity: u16,
    return_number: u8,
    return_count: u8,
    /// Four flags of the class, the scanner channel, the scan direction, the edge of the flight line.
    flags: u8,
    classification: u8,
    user_data: u8,
    scan_angle: u16,
    source: u16,
    /// The bits of the time.
    time: i64,
    has_new_time: bool,
}

impl Point {
    fn read(bytes: &[u8; LENGTH]) -> Self {
        let short = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let word = |at: usize| i32::from_le_bytes(array::from_fn(|index| bytes[at + index]));
        Self {
            x: word(0),
            y: word(4),
            z: word(8),
            intensity: short(12),
            return_number: bytes[14] & 15,
            return_count: bytes[14] >> 4,
            flags: bytes[15],
            classification: bytes[16],
            user_data: bytes[17],
            scan_angle: short(18),
            source: short(20),
            time: i64::from_le_bytes(array::from_fn(|index| bytes[22 + index])),
            has_new_time: false,
        }
    }

    #[inline]
    fn write(&self, record: &mut [u8]) -> io::Result<()> {
        let Some(record) = record.first_chunk_mut::<LENGTH>() else {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a record that is too short"));
        };
        // One store of an array: `copy_from_slice` is called for each field, which takes 5 % of reading.
        let [x0, x1, x2, x3] = self.x.to_le_bytes();
        let [y0, y1, y2, y3] = self.y.to_le_bytes();
        let [z0, z1, z2, z3] = self.z.to_le_bytes();
        let [i0, i1] = self.intensity.to_le_bytes();
        let returns = self.return_count << 4 | self.return_number;
        let [a0, a1] = self.scan_angle.to_le_bytes();
        let [s0, s1] = self.source.to_le_bytes();
        let [t0, t1, t2, t3, t4, t5, t6, t7] = self.time.to_le_bytes();
        #[rustfmt::skip]
        let bytes = [
            x0, x1, x2, x3, y0, y1, y2, y3, z0, z1, z2, z3, i0, i1,
            returns, self.flags, self.classification, self.user_data, a0, a1, s0, s1,
            t0, t1, t2, t3, t4, t5, t6, t7,
        ];
        *record = bytes;
        Ok(())
    }

    /// The context in which is decoded what changes after this point: whether it is the first return, whether the last,
    /// and whether it has another time than the point before.
    #[inline]
    fn context(&self) -> usize {
        usize::from(self.return_number == 1)
            + 2 * usize::from(self.return_number >= self.return_count)
            + 4 * usize::from(self.has_new_time)
    }
}

/// Models that are built when a value is first decoded with them.
struct Models<const COUNT: usize> {
    symbols: u32,
    models: [Option<ArithmeticModel>; COUNT],
}

impl<const COUNT: usize> Models<COUNT> {
    fn new(symbols: u32) -> Self {
        Self { symbols, models: [const { None }; COUNT] }
    }

    #[inline]
    fn decode(&mut self, layer: &mut Layer, context: u8) -> io::Result<u8> {
        let model =
            self.models[usize::from(context)].get_or_insert_with(|| ArithmeticModelBuilder::new(self.symbols).build());
        Ok(layer.decode_symbol(model)? as u8)
    }
}

/// What a scanner channel has for itself.
struct Channel {
    last: Point,
    /// The last values of several contexts.
    intensities: [u16; 8],
    x_differences: [Median; 12],
    y_differences: [Median; 12],
    heights: [i32; 8],

    changes: [ArithmeticModel; 8],
    channel_steps: ArithmeticModel,
    return_counts: Models<16>,
    return_numbers: Models<16>,
    return_steps: ArithmeticModel,
    classifications: Models<64>,
    flags: Models<64>,
    user_data: Models<64>,
    x: IntegerDecompressor,
    y: IntegerDecompressor,
    z: IntegerDecompressor,
    intensity: IntegerDecompressor,
    scan_angle: IntegerDecompressor,
    source: IntegerDecompressor,
    times: GpsTimes,
}

impl Channel {
    /// A channel whose first point comes after `last`.
    fn after(last: &Point) -> Self {
        let model = |symbols: u32| ArithmeticModelBuilder::new(symbols).build();
        let integers = |bits: u32, contexts: u32| {
            IntegerDecompressorBuilder::new().bits(bits).contexts(contexts).build_initialized()
        };
        Self {
            last: Point { has_new_time: false, ..*last },
            intensities: [last.intensity; 8],
            x_differences: [Median::default(); 12],
            y_differences: [Median::default(); 12],
            heights: [last.z; 8],
            changes: array::from_fn(|_| model(128)),
            channel_steps: model(CHANNELS as u32 - 1),
            return_counts: Models::new(16),
            return_numbers: Models::new(16),
            return_steps: model(13),
            classifications: Models::new(256),
            flags: Models::new(64),
            user_data: Models::new(256),
            x: integers(32, 2),
            y: integers(32, 22),
            z: integers(32, 20),
            intensity: integers(16, 4),
            scan_angle: integers(16, 2),
            source: integers(16, 1),
            times: GpsTimes::of_layers(last.time),
        }
    }

    /// Decodes the next point of the channel into `last`. The bits of `changes` say what changes.
    #[inline]
    fn decode(&mut self, layers: &mut Layers, changes: u32) -> io::Result<()> {
        let last = &mut self.last;
        let has_new_source = changes & 1 << 5 != 0;
        let has_new_time = changes & 1 << 4 != 0;
        let has_new_scan_angle = changes & 1 << 3 != 0;
        let xy = &mut layers.returns_xy;

        let number_before = last.return_number;
        if changes & 1 << 2 != 0 {
            last.return_count = self.return_counts.decode(xy, last.return_count)?;
        }
        last.return_number = match changes & 3 {
            0 => number_before,
            1 => (number_before + 1) % 16,
            2 => (number_before + 15) % 16,
            _ if has_new_time => self.return_numbers.decode(xy, number_before)?,
            _ => ((u32::from(number_before) + xy.decode_symbol(&mut self.return_steps)? + 2) % 16) as u8,
        };
        let (number, count) = (last.return_number, last.return_count);
        // A single return has the context 3, a first one 2, a last one 1, one between 0.
        let place = 2 * u32::from(number == 1) + u32::from(number >= count);
        let is_only = u32::from(count == 1);

        let group = usize::from(RETURN_GROUPS[usize::from(count)][usize::from(number)]) * 2 + usize::from(has_new_time);
        let differences = &mut self.x_differences[group];
        let difference = self.x.decompress(xy, differences.value(), is_only)?;
        last.x = last.x.wrapping_add(difference);
        differences.add(difference);

        let differences = &mut self.y_differences[group];
        let difference = self.y.decompress(xy, differences.value(), is_only + even(self.x.k()).min(20))?;
        last.y = last.y.wrapping_add(difference);
        differences.add(difference);

        if let Some(layer) = &mut layers.z {
            let height = &mut self.heights[usize::from(count.abs_diff(number).min(7))];
            let context = is_only + even(u32::midpoint(self.x.k(), self.y.k())).min(18);
            last.z = self.z.decompress(layer, *height, context)?;
            *height = last.z;
        }
        if let Some(layer) = &mut layers.classification {
            let context = (last.classification & 31) << 1 | u8::from(place == 3);
            last.classification = self.classifications.decode(layer, context)?;
        }
        if let Some(layer) = &mut layers.flags {
            // The scanner channel lies between the flags, which are coded without it.
            let flags = self.flags.decode(layer, last.flags >> 2 & 0b11_0000 | last.flags & 15)?;
            last.flags = (flags & 0b11_0000) << 2 | last.flags & CHANNEL_BITS | flags & 15;
        }
        if let Some(layer) = &mut layers.intensity {
            let intensity = &mut self.intensities[(place << 1) as usize + usize::from(has_new_time)];
            last.intensity = self.intensity.decompress(layer, i32::from(*intensity), place)? as u16;
            *intensity = last.intensity;
        }
        if let Some(layer) = layers.scan_angle.as_mut().filter(|_| has_new_scan_angle) {
            let expected = i32::from(last.scan_angle as i16);
            last.scan_angle = self.scan_angle.decompress(layer, expected, u32::from(has_new_time))? as u16;
        }
        if let Some(layer) = &mut layers.user_data {
            last.user_data = self.user_data.decode(layer, last.user_data / 4)?;
        }
        if let Some(layer) = layers.source.as_mut().filter(|_| has_new_source) {
            last.source = self.source.decompress(layer, i32::from(last.source), 0)? as u16;
        }
        if let Some(layer) = layers.time.as_mut().filter(|_| has_new_time) {
            last.time = self.times.decode(layer)?;
        }
        last.has_new_time = has_new_time;
        Ok(())
    }
}

/// The greatest even number up to `value`.
#[inline]
fn even(value: u32) -> u32 {
    value & !1
}

/// A running estimate of the median of what was added.
#[derive(Clone, Copy)]
struct Median {
    /// In ascending order.
    values: [i32; 5],
    /// Whether the greatest value is the next to be left out.
    drops_greatest: bool,
}

impl Default for Median {
    fn default() -> Self {
        Self { values: [0; 5], drops_greatest: true }
    }
}

impl Median {
    #[inline]
    fn value(&self) -> i32 {
        self.values[2]
    }

    #[inline]
    fn add(&mut self, value: i32) {
        let [a, b, c, d, e] = self.values;
        self.values = if self.drops_greatest {
            self.drops_greatest = value < c;
            match value {
                _ if value < a => [value, a, b, c, d],
                _ if value < b => [a, value, b, c, d],
                _ if value < c => [a, b, value, c, d],
                _ if value < d => [a, b, c, value, d],
                _ => [a, b, c, d, value],
            }
        } else {
            self.drops_greatest = value <= c;
            match value {
                _ if value > e => [b, c, d, e, value],
                _ if value > d => [b, c, d, value, e],
                _ if value > c => [b, c, value, d, e],
                _ if value > b => [b, value, c, d, e],
                _ => [value, b, c, d, e],
            }
        };
    }
}

/// The group of a return, by the number of returns of its pulse and its own.
const RETURN_GROUPS: [[u8; 16]; 16] = [
    [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5],
    [1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3],
    [2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3],
    [3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5],
];

#[cfg(test)]
mod tests {
    use cloud::Random;
    use laz::LazItem;
    use laz::las::{Point0, Point1, Point3, Point4, Point5, Point6, Point7, Point8, Point9, Point10};
    use laz::laszip::LazItemRecordBuilder;
    use laz::record::{
        LayeredPointRecordCompressor, LayeredPointRecordDecompressor, RecordCompressor, RecordDecompressor,
        SequentialPointRecordCompressor, SequentialPointRecordDecompressor,
    };

    use super::super::gps_times::tests::times;
    use super::super::items;
    use super::*;

    const POINTS: usize = 6_000;

    /// Records that change at random in every byte, some of them seldom; layered ones in four scanner channels.
    fn records(length: usize, is_layered: bool, times: &[i64], seed: u64) -> Vec<u8> {
        let mut noise = Random(seed);
        let mut records: Vec<u8> = Vec::with_capacity(POINTS * length);
        let mut record = vec![0; length];
        for time in times {
            for axis in 0..3 {
                let range = 1 << (3 + 7 * axis);
                let at = axis * 4..axis * 4 + 4;
                let value = i32::from_le_bytes(record[at.clone()].try_into().unwrap());
                let step = if noise.below(50) == 0 { noise.draw() as i32 } else { noise.below(range) as i32 };
                record[at].copy_from_slice(&value.wrapping_add(step - range as i32 / 3).to_le_bytes());
            }
            for at in 12..length {
                if noise.below(4) == 0 {
                    record[at] = if noise.below(3) == 0 { noise.draw() as u8 } else { noise.below(4) as u8 };
                }
            }
            if is_layered && noise.below(4) == 0 {
                let returns = 1 + noise.below(4) as u8;
                record[14] = returns << 4 | (1 + noise.below(u64::from(returns)) as u8);
            }
            if let Some(at) = if is_layered { Some(22) } else { (length >= 28).then_some(20) } {
                record[at..at + 8].copy_from_slice(&time.to_le_bytes());
            }
            records.extend(&record);
        }
        records
    }

    /// Decodes with `decoder` as many records as there are in `records`.
    fn decode(records: &[u8], length: usize, mut decode_next: impl FnMut(&mut [u8])) -> Vec<u8> {
        let mut decoded = vec![0; records.len()];
        decoded.chunks_exact_mut(length).for_each(&mut decode_next);
        decoded
    }

    fn length(items: &[LazItem]) -> usize {
        items.iter().map(|item| usize::from(item.size())).sum()
    }

    #[test]
    fn layered_points_come_as_the_decoder_of_laz_gives_them_whatever_is_selected() {
        let all_items = [
            LazItemRecordBuilder::version_3_of::<Point6>(0),
            LazItemRecordBuilder::version_4_of::<Point6>(2),
            LazItemRecordBuilder::version_3_of::<Point7>(1),
            LazItemRecordBuilder::version_4_of::<Point7>(0),
            LazItemRecordBuilder::version_3_of::<Point8>(0),
            LazItemRecordBuilder::version_4_of::<Point8>(0),
            LazItemRecordBuilder::version_3_of::<Point9>(0),
            LazItemRecordBuilder::version_4_of::<Point9>(0),
            LazItemRecordBuilder::version_3_of::<Point10>(0),
            LazItemRecordBuilder::version_4_of::<Point10>(0),
        ];
        for (seed, items) in all_items.iter().enumerate() {
            let length = length(items);
            assert_eq!(items::check(items, length), Ok(true));
            let records = records(length, true, &times(POINTS, seed as u64), seed as u64);
            let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
            encoder.set_fields_from(items).unwrap();
            encoder.compress_many(&records).unwrap();
            encoder.done().unwrap();
            let chunk = encoder.into_inner();
            let selections = [DecompressionSelection::ALL, 0].into_iter().chain((0..12).map(|bit| 1 << bit));
            for layers in selections.map(DecompressionSelection) {
                let mut own = items::decoder(items, true, Cursor::new(&chunk), layers).unwrap();
                let mut other = LayeredPointRecordDecompressor::new(Cursor::new(&chunk));
                other.set_fields_from(items).unwrap();
                other.set_selection(layers);
                let mine = decode(&records, length, |record| own.decode_next(record).unwrap());
                let theirs = decode(&records, length, |record| other.decompress_next(record).unwrap());
                assert!(mine == theirs, "items {seed}, {layers:?}");
                assert!(layers != DecompressionSelection::all() || mine == records, "items {seed}");
            }
        }
    }

    #[test]
    fn points_one_by_one_come_as_the_decoder_of_laz_gives_them_and_from_the_start_again() {
        let all_items = [
            LazItemRecordBuilder::version_1_of::<Point0>(0),
            LazItemRecordBuilder::version_1_of::<Point1>(2),
            LazItemRecordBuilder::version_2_of::<Point1>(0),
            LazItemRecordBuilder::version_2_of::<Point3>(3),
            LazItemRecordBuilder::version_2_of::<Point4>(0),
            LazItemRecordBuilder::version_2_of::<Point5>(0),
        ];
        for (seed, items) in all_items.iter().enumerate() {
            let length = length(items);
            assert_eq!(items::check(items, length), Ok(false));
            let records = records(length, false, &times(POINTS, seed as u64), seed as u64);
            let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
            encoder.set_fields_from(items).unwrap();
            encoder.compress_many(&records).unwrap();
            encoder.done().unwrap();
            let chunk = encoder.into_inner();
            let mut other = SequentialPointRecordDecompressor::new(Cursor::new(&chunk));
            other.set_fields_from(items).unwrap();
            let theirs = decode(&records, length, |record| other.decompress_next(record).unwrap());
            let two = chunk.repeat(2);
            let mut own = items::decoder(items, false, Cursor::new(&two), DecompressionSelection::all()).unwrap();
            for pass in 0..2 {
                let mine = decode(&records, length, |record| own.decode_next(record).unwrap());
                assert!(mine == theirs && mine == records, "items {seed}, pass {pass}");
                own.restart(items).unwrap();
            }
        }
    }
}
