//! Decodes the extra bytes of layered points (LASzip items `BYTE14`): one layer of compressed bytes for each byte of a
//! record.
//!
//! The decoder of `laz` builds the models of all bytes for four scanner channels at once: 640 MB for the longest
//! possible record. This one builds a model when the first value is decoded with it, so its memory grows with the
//! layers that are not empty. It decodes the same values.

use std::io::{self, Read, Seek};

use laz::DecompressionSelection;
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::LayeredFieldDecompressor;

use super::point_layers::{self, CHANNELS, read_layer};

/// The number of values of a byte.
const VALUES: u32 = 256;

/// Decodes the extra bytes of the records of one chunk.
pub struct ExtraLayers {
    /// Version 4 of the item continues with the last value of the scanner channel, version 3 with that of the point
    /// before.
    keeps_channels_apart: bool,
    is_wanted: bool,
    layers: Vec<Layer>,
    /// The last bytes of each channel; empty until the channel has a point.
    last: [Vec<u8>; CHANNELS],
    channel: usize,
}

/// One byte of all records.
#[derive(Default)]
struct Layer {
    /// The number of compressed bytes.
    length: u32,
    /// `None` if the byte never changes or is not wanted.
    content: Option<Box<Content>>,
}

struct Content {
    decoder: point_layers::Layer,
    models: [Option<ArithmeticModel>; CHANNELS],
}

impl ExtraLayers {
    /// The memory in bytes for each byte of a record, wanted or not: its layer and its last values.
    pub const LAYER_BYTES: u64 = (size_of::<Layer>() + CHANNELS) as u64;
    /// The most memory in bytes for each byte of a record that is wanted and whose layer is not empty: the models of
    /// all channels, each two tables of 256 words and one of 66.
    pub const CONTENT_BYTES: u64 = (size_of::<Content>() + CHANNELS * (2 * 256 + 66) * 4) as u64;

    /// A decoder of `count` bytes for `version` 3 or 4 of the item.
    pub fn new(count: usize, version: u16) -> Self {
        Self {
            keeps_channels_apart: version == 4,
            is_wanted: true,
            layers: (0..count).map(|_| Layer::default()).collect(),
            last: Default::default(),
            channel: 0,
        }
    }
}

impl<R: Read + Seek> LayeredFieldDecompressor<R> for ExtraLayers {
    fn size_of_field(&self) -> usize {
        self.layers.len()
    }

    fn set_selection(&mut self, selection: DecompressionSelection) {
        self.is_wanted = selection.should_decompress_extra_bytes();
    }

    fn init_first_point(&mut self, source: &mut R, point: &mut [u8], channel: &mut usize) -> io::Result<()> {
        source.read_exact(point)?;
        self.last = Default::default();
        self.last[*channel] = point.to_vec();
        self.channel = *channel;
        Ok(())
    }

    fn read_layers_sizes(&mut self, source: &mut R) -> io::Result<()> {
        for layer in &mut self.layers {
            let mut length = [0; 4];
            source.read_exact(&mut length)?;
            layer.length = u32::from_le_bytes(length);
        }
        Ok(())
    }

    fn read_layers(&mut self, source: &mut R) -> io::Result<()> {
        for layer in &mut self.layers {
            let decoder = read_layer(source, layer.length, self.is_wanted)?;
            layer.content = decoder.map(|decoder| Box::new(Content { decoder, models: Default::default() }));
        }
        Ok(())
    }

    fn decompress_field_with(&mut self, point: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let mut from = self.channel;
        if *channel != from {
            let is_new = self.last[*channel].is_empty();
            if is_new {
                self.last[*channel] = self.last[from].clone();
            }
            if is_new || self.keeps_channels_apart {
                from = *channel;
            }
            self.channel = *channel;
        }
        let last = &mut self.last[from];
        for (value, layer) in last.iter_mut().zip(&mut self.layers) {
            if let Some(content) = &mut layer.content {
                let model = content.models[*channel].get_or_insert_with(|| ArithmeticModelBuilder::new(VALUES).build());
                *value = value.wrapping_add(content.decoder.decode_symbol(model)? as u8);
            }
        }
        point.copy_from_slice(last);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use cloud::Random;
    use laz::las::Point6;
    use laz::laszip::LazItemRecordBuilder;
    use laz::record::{
        LayeredPointRecordCompressor, LayeredPointRecordDecompressor, RecordCompressor as _, RecordDecompressor as _,
    };

    use super::super::items;
    use super::*;

    const EXTRA: usize = 5;

    /// The records of points of four scanner channels that change at random; the last extra byte is always the same.
    fn records(count: usize) -> Vec<u8> {
        let mut noise = Random(5);
        let mut records = Vec::new();
        let mut channel = 0;
        for index in 0..count {
            if noise.below(3) == 0 {
                channel = noise.below(4) as u8;
            }
            let mut record = [0; 30 + EXTRA];
            record[0..4].copy_from_slice(&(index as u32).to_le_bytes());
            (record[14], record[15]) = (0x11, channel << 4);
            record[30..].fill_with(|| noise.below(40) as u8);
            record[30 + EXTRA - 1] = 7;
            records.extend(record);
        }
        records
    }

    #[test]
    fn extra_bytes_come_as_the_decoder_of_laz_gives_them_in_both_versions() {
        let builders = [LazItemRecordBuilder::version_3_of::<Point6>, LazItemRecordBuilder::version_4_of::<Point6>];
        for items in builders.map(|items| items(EXTRA as u16)) {
            let records = records(2_000);
            let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
            encoder.set_fields_from(&items).unwrap();
            records.chunks_exact(30 + EXTRA).for_each(|record| encoder.compress_next(record).unwrap());
            encoder.done().unwrap();
            let chunk = encoder.into_inner();
            assert_eq!(items::check(&items, 30 + EXTRA), Ok(true));
            for (layers, is_wanted) in [(DecompressionSelection::all(), true), (DecompressionSelection::base(), false)]
            {
                let mut own = items::decoder(&items, true, Cursor::new(&chunk), layers).unwrap();
                let mut other = LayeredPointRecordDecompressor::new(Cursor::new(&chunk));
                other.set_fields_from(&items).unwrap();
                other.set_selection(layers);
                for record in records.chunks_exact(30 + EXTRA) {
                    let (mut mine, mut theirs) = ([0; 30 + EXTRA], [0; 30 + EXTRA]);
                    own.decode_next(&mut mine).unwrap();
                    other.decompress_next(&mut theirs).unwrap();
                    assert_eq!(mine, theirs);
                    assert!(!is_wanted || mine == record);
                }
            }
        }
    }
}
