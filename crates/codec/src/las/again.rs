//! Reads compressed points, and those of servers twice where their bytes are damaged: what was fetched is dropped, from the
//! cache, too, and fetched once more.

use std::ops::Range;

use laz::DecompressionSelection;

use super::columns::{ChunkBuilder, ReadPlan};
use super::compressed::{Compressed, CompressedChunk};
use super::{Block, LasSource, Tally, tile_records};
use crate::error::AS_BEFORE;
use crate::{Error, Result};

/// What is added to the reason where the points before the damage were passed on already.
const ONCE_MORE: &str = " (when it is opened again, that is fetched once more)";

impl LasSource {
    /// Reads a part of the file, and reads it again where bytes from a server were damaged.
    pub(super) fn twice<T>(&self, part: Range<u64>, read: impl Fn() -> Result<T>) -> Result<T> {
        match read() {
            Err(Error::Malformed { .. }) if self.file.fetch_again(part) => read().map_err(Error::same_again),
            read => read,
        }
    }

    /// Drops what was fetched of a compressed chunk that is damaged. Returns what is added to the reason.
    pub(super) fn drop_damaged(&self, chunk: &CompressedChunk) -> &'static str {
        if self.file.fetch_again(place_of(std::slice::from_ref(chunk))) { ONCE_MORE } else { "" }
    }

    /// Reads a block. Damaged bytes from a server are fetched once more, unless points of the block were passed on before.
    pub(super) fn read_compressed(
        &self,
        compressed: &Compressed,
        block: &Block,
        plan: &ReadPlan<'_>,
        layers: DecompressionSelection,
        buffer: &mut Vec<u8>,
        tally: &Tally<'_>,
    ) {
        let place = place_of(&compressed.chunks[block.chunks.clone()]);
        let fetches = |is_begun: bool| match self.file.fetch_again(place.clone()) {
            true if is_begun => Some(ONCE_MORE),
            true => None,
            false => Some(""),
        };
        if !self.decode_block(compressed, block, (plan, layers), buffer, tally, &fetches) {
            let is_again = |_| Some(AS_BEFORE);
            self.decode_block(compressed, block, (plan, layers), buffer, tally, &is_again);
        }
    }

    /// Decodes a block. `failed` is asked about damage, and told whether points were passed on before: it returns what is added
    /// to the reason, or `None` to end the reading of the block, of which nothing was passed on. Returns false then.
    fn decode_block(
        &self,
        compressed: &Compressed,
        block: &Block,
        (plan, layers): (&ReadPlan<'_>, DecompressionSelection),
        buffer: &mut Vec<u8>,
        tally: &Tally<'_>,
        failed: &dyn Fn(bool) -> Option<&'static str>,
    ) -> bool {
        let length = self.layout.record_length;
        let tile = tile_records(length);
        buffer.resize(tile * length, 0);
        let capacity = |left: u64| left.min(block.piece as u64) as usize;
        let mut builder = ChunkBuilder::new(plan, block.first_point, capacity(block.points));
        let mut is_begun = false;
        for chunk in &compressed.chunks[block.chunks.clone()] {
            let mut point = chunk.first_point;
            if point != builder.next_point() {
                // The chunk before came out short: the points that follow start a chunk of their own, so that indices
                // stay right.
                tally.deliver(std::mem::replace(&mut builder, ChunkBuilder::new(plan, point, capacity(chunk.points))));
                is_begun = true;
            }
            let mut stream = match compressed.stream(&self.file, chunk, layers) {
                Ok(stream) => stream,
                Err(reason) => {
                    let Some(more) = failed(is_begun) else { return false };
                    tally.fail(point, reason + more);
                    continue;
                }
            };
            while stream.left() > 0 {
                let wanted = capacity(stream.left()).min(block.piece - builder.len()).min(tile);
                let (decoded, outcome) = stream.decode(&mut buffer[..wanted * length]);
                builder.push(&buffer[..decoded * length]);
                point += decoded as u64;
                if let Err(reason) = outcome {
                    let Some(more) = failed(is_begun) else { return false };
                    tally.fail(point, format!("{reason} (the rest of this compressed chunk is skipped){more}"));
                    break;
                }
                if builder.len() == block.piece {
                    let next = ChunkBuilder::new(plan, point, capacity(stream.left()));
                    tally.deliver(std::mem::replace(&mut builder, next));
                    is_begun = true;
                    if tally.progress.is_cancelled() {
                        return true;
                    }
                }
            }
            if stream.left() == 0 && point < chunk.first_point + chunk.points {
                let Some(more) = failed(is_begun) else { return false };
                tally.fail(point, format!("the compressed chunk holds fewer points than announced{more}"));
            }
        }
        tally.deliver(builder);
        true
    }
}

/// The bytes of compressed chunks, which follow one another.
pub(super) fn place_of(chunks: &[CompressedChunk]) -> Range<u64> {
    let end = |chunk: &CompressedChunk| chunk.offset.saturating_add(chunk.length);
    chunks.first().map_or(0, |chunk| chunk.offset)..chunks.iter().map(end).max().unwrap_or_default()
}
