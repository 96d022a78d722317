//! The progressive order of a page's points: every sixteenth rank along a Morton curve belongs to the same batch, and
//! the batches are ordered so that the gaps halve. So any prefix of batches is an even subset of the page.

/// The number of batches of a page.
pub const BATCHES: usize = 16;

/// The remainder modulo [`BATCHES`] of the Morton ranks in the batch: its four bits reversed.
pub fn rank_of_batch(batch: usize) -> usize {
    (batch & 1) << 3 | (batch & 2) << 1 | (batch & 4) >> 1 | (batch & 8) >> 3
}

/// The number of points in the first `batches` batches of a page of `points`; all of them for [`BATCHES`] and more.
pub fn prefix(points: usize, batches: usize) -> usize {
    (0..batches.min(BATCHES)).map(|batch| (points + BATCHES - 1 - rank_of_batch(batch)) / BATCHES).sum()
}

/// The Morton ranks of a page's points in the order in which the page keeps them.
pub(crate) fn order(points: usize) -> impl Iterator<Item = usize> {
    (0..BATCHES).flat_map(move |batch| (rank_of_batch(batch)..points).step_by(BATCHES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_count_the_points_of_their_batches() {
        for points in 0..200 {
            for batches in 0..=BATCHES {
                let counted =
                    (0..points).filter(|rank| (0..batches).any(|batch| rank_of_batch(batch) == rank % BATCHES)).count();
                assert_eq!(prefix(points, batches), counted, "{points} points, {batches} batches");
            }
            assert_eq!((prefix(points, BATCHES), prefix(points, BATCHES + 1)), (points, points));
        }
    }

    #[test]
    fn each_doubling_of_the_batches_halves_the_gaps() {
        for (batches, gap) in [(1, 16), (2, 8), (4, 4), (8, 2), (16, 1)] {
            let mut ranks: Vec<usize> = (0..batches).map(rank_of_batch).collect();
            ranks.sort_unstable();
            assert!(ranks.iter().enumerate().all(|(index, rank)| *rank == index * gap), "{batches} batches");
        }
    }

    #[test]
    fn the_order_has_every_rank_once_batch_by_batch() {
        for points in [0, 1, 15, 16, 17, 1000, 65_536] {
            let order: Vec<usize> = order(points).collect();
            for batches in 0..BATCHES {
                let batch = &order[prefix(points, batches)..prefix(points, batches + 1)];
                assert!(batch.iter().all(|rank| rank % BATCHES == rank_of_batch(batches)));
            }
            let mut sorted = order;
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..points));
        }
    }
}
