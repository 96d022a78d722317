//! The identities of points on the GPU: among points at equal distances the identity decides, and random draws depend
//! on it. It encodes the cloud, the chunk and the point's index, so a picture does not depend on where in the store a
//! point is, which follows from the order of arrival.

use std::collections::HashMap;

use crate::layout::BLOCK_POINTS;

/// A cloud in the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudId(pub u32);

/// A chunk in the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChunkId(pub u32);

/// The numbers of all points.
#[derive(Default)]
pub(crate) struct Identities {
    /// The first identity of each chunk, in order.
    chunks: Vec<(u32, ChunkId)>,
    first: HashMap<ChunkId, u32>,
    /// One more than the last identity.
    end: u32,
}

impl Identities {
    /// Numbers the points of chunks in this order; with each chunk comes the number of identities that it takes.
    pub fn new(order: impl Iterator<Item = (ChunkId, u32)>) -> Self {
        let mut identities = Self::default();
        for (chunk, room) in order {
            identities.chunks.push((identities.end, chunk));
            identities.first.insert(chunk, identities.end);
            identities.end += room;
        }
        identities
    }

    /// The identity of a chunk's first point; the others follow.
    pub fn first_of(&self, chunk: ChunkId) -> u32 {
        self.first.get(&chunk).copied().unwrap_or_default()
    }

    pub fn end(&self) -> u32 {
        self.end
    }

    /// The chunk that contains an identity, and the index of the point in it, which may be beyond its last one.
    pub fn find(&self, identity: u32) -> Option<(ChunkId, usize)> {
        let after = self.chunks.partition_point(|(first, _)| *first <= identity);
        let (first, chunk) = self.chunks.get(after.checked_sub(1)?)?;
        (identity < self.end).then_some((*chunk, (identity - first) as usize))
    }

    /// For each run of `BLOCK_POINTS` identities, the run in which `now` has its points; `u32::MAX` if they have gone.
    pub fn runs_in(&self, now: &Self) -> Vec<u32> {
        let ends = self.chunks.iter().skip(1).map(|(first, _)| *first).chain([self.end]);
        let runs_of = |(&(first, chunk), end): (&(u32, ChunkId), u32)| {
            let new = now.first.get(&chunk).map(|new| new / BLOCK_POINTS);
            (0..(end - first) / BLOCK_POINTS).map(move |run| new.map_or(u32::MAX, |new| new + run))
        };
        self.chunks.iter().zip(ends).flat_map(runs_of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_found_by_its_number_and_no_other_number_is_anyones() {
        let identities = Identities::new([(ChunkId(7), 1024), (ChunkId(3), 2048)].into_iter());
        assert_eq!([7, 3].map(|chunk| identities.first_of(ChunkId(chunk))), [0, 1024]);
        assert_eq!(identities.find(1023), Some((ChunkId(7), 1023)));
        assert_eq!(identities.find(1024), Some((ChunkId(3), 0)));
        assert_eq!(identities.find(identities.end()), None);
        assert_eq!(Identities::default().find(0), None);
    }

    #[test]
    fn runs_of_identities_follow_their_chunks() {
        let of = |chunks: &[(u32, u32)]| {
            Identities::new(chunks.iter().map(|(chunk, runs)| (ChunkId(*chunk), runs * BLOCK_POINTS)))
        };
        let before = of(&[(7, 1), (3, 2), (5, 1)]);
        assert_eq!(before.runs_in(&of(&[(9, 4), (3, 2), (5, 1), (7, 1)])), [7, 4, 5, 6]);
        assert_eq!(before.runs_in(&of(&[(5, 1), (7, 1)])), [1, u32::MAX, u32::MAX, 0]);
        assert_eq!(before.runs_in(&before), [0, 1, 2, 3]);
        assert!(of(&[]).runs_in(&before).is_empty());
    }
}
