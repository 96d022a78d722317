//! Looks at some of the colours of a file, to decide their range.

use laz::DecompressionSelection;
use rayon::iter::{IndexedParallelIterator as _, IntoParallelIterator as _, ParallelIterator as _};

use super::compressed::{CompressedChunk, Stream};
use super::copc::CopcNode;
use super::{LasSource, tile_records};
use crate::Result;
use crate::color_range::ColorSample;

/// The number of places of a LAS file that are sampled, and of records at each, to decide whether colours have 8 or 16
/// bits.
const COLOR_SAMPLES: (u64, usize) = (64, 64);
/// The number of compressed chunks that are sampled for that, and of points in all of them: some 10 ms.
const COMPRESSED_COLOR_SAMPLES: (usize, u64) = (8, 32_768);

impl LasSource {
    /// The colours of a sample that spreads over the file.
    ///
    /// # Errors
    /// If the sample cannot be fetched from a server. What is damaged is left out: the read of the points reports it.
    pub(super) fn color_sample(&self, red: usize) -> Result<ColorSample> {
        let length = self.layout.record_length;
        let add = |sample: &mut ColorSample, records: &[u8]| {
            let fields = records.chunks_exact(length).flat_map(|record| record[red..red + 6].chunks_exact(2));
            fields.for_each(|field| sample.add(f64::from(u16::from_le_bytes([field[0], field[1]]))));
        };
        match &self.compressed {
            None => {
                let (places, records) = COLOR_SAMPLES;
                let mut buffer = vec![0; records * length];
                let mut sample = ColorSample::default();
                let last = self.info.points.saturating_sub(records as u64);
                for place in 0..places {
                    let point = (u128::from(last) * u128::from(place) / u128::from(places - 1)) as u64;
                    let read = self.file.read_at(self.data_start + point * length as u64, &mut buffer).unwrap_or(0);
                    add(&mut sample, &buffer[..read]);
                }
                Ok(sample)
            }
            Some(compressed) => {
                // A chunk can only be decoded from its start, so fewer chunks mean more points of each.
                let layers = DecompressionSelection(DecompressionSelection::RGB);
                let (most_chunks, points) = COMPRESSED_COLOR_SAMPLES;
                let last = compressed.chunks.len().saturating_sub(1);
                let place = |place: usize| compressed.chunks.get(last * place / (most_chunks - 1)).copied();
                let mut chunks: Vec<CompressedChunk> = match &self.copc {
                    // The coarsest nodes have points from all over the file, and every view needs them.
                    Some(copc) => {
                        let mut left = points as i64;
                        let needed = |node: &&CopcNode| {
                            let is_needed = left > 0;
                            left -= i64::from(node.points);
                            is_needed
                        };
                        let first = copc.nodes[..copc.first].iter().take_while(needed);
                        first.filter_map(CopcNode::chunk).take(most_chunks).collect()
                    }
                    None => (0..most_chunks).filter_map(place).collect(),
                };
                chunks.dedup_by_key(|chunk| chunk.offset);
                let points_each = points / chunks.len().max(1) as u64;
                let decode = |mut stream: Stream<'_>| {
                    let mut sample = ColorSample::default();
                    let mut buffer = vec![0; tile_records(length) * length];
                    let mut left = stream.left().min(points_each);
                    while left > 0 {
                        let wanted = left.min(tile_records(length) as u64);
                        let (decoded, outcome) = stream.decode(&mut buffer[..wanted as usize * length]);
                        add(&mut sample, &buffer[..decoded * length]);
                        if outcome.is_err() {
                            return (sample, false);
                        }
                        left -= wanted;
                    }
                    (sample, true)
                };
                let sample_of = |chunk: CompressedChunk| {
                    self.fetch(&chunk)?;
                    let beginning = compressed.beginning_of_colors(&self.file, &chunk, points_each).and_then(|file| {
                        let chunk = CompressedChunk { offset: 0, length: file.length(), ..chunk };
                        Some(decode(compressed.stream(&file, &chunk, layers).ok()?))
                    });
                    let whole = || Some(decode(compressed.stream(&self.file, &chunk, layers).ok()?));
                    let (sample, _) = beginning.filter(|(_, is_whole)| *is_whole).or_else(whole).unwrap_or_default();
                    Ok(sample)
                };
                let each = chunks.len().div_ceil(compressed.decoders(layers));
                let samples = chunks.into_par_iter().with_min_len(each).map(sample_of);
                samples.try_reduce(ColorSample::default, |one, other| Ok(one.merge(other)))
            }
        }
    }
}
