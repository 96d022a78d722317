//! Manages the space of a page. Chunks of streamed clouds come and go in any order and size. Adjacent free parts are
//! joined, and the smallest that fits is taken; if none fits though enough is free, `scattered` says which stretch to
//! slide together.

use std::ops::Range;

/// The unused parts of a page, in points.
#[derive(Debug)]
pub(crate) struct PageSpace {
    capacity: u32,
    /// The free ranges: sorted, not empty, not adjacent.
    free: Vec<Range<u32>>,
}

impl PageSpace {
    /// A page that is all free.
    pub fn new(capacity: u32) -> Self {
        let mut room = Self { capacity, free: Vec::new() };
        room.release(0..capacity);
        room
    }

    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    pub fn is_unused(&self) -> bool {
        self.free.first().is_some_and(|free| free.len() == self.capacity as usize)
    }

    /// Takes `room` points of the smallest free part that fits; returns the first of them.
    pub fn take(&mut self, room: u32) -> Option<u32> {
        let fitting = self.free.iter().enumerate().filter(|(_, free)| free.len() as u32 >= room);
        let (index, _) = fitting.min_by_key(|(_, free)| free.len())?;
        let first = self.free[index].start;
        self.free[index].start += room;
        if self.free[index].is_empty() {
            self.free.remove(index);
        }
        Some(first)
    }

    /// Gives a part back that was taken.
    pub fn release(&mut self, part: Range<u32>) {
        if part.is_empty() {
            return;
        }
        let mut index = self.free.partition_point(|free| free.start < part.start);
        self.free.insert(index, part);
        if index > 0 && self.free[index - 1].end == self.free[index].start {
            self.free[index - 1].end = self.free.remove(index).end;
            index -= 1;
        }
        if self.free.get(index + 1).is_some_and(|next| next.start == self.free[index].end) {
            self.free[index].end = self.free.remove(index + 1).end;
        }
    }

    /// The stretch with `room` free points and the fewest taken ones, and the number of these.
    pub fn scattered(&self, room: u32) -> Option<(Range<u32>, u32)> {
        let mut best: Option<(Range<u32>, u32)> = None;
        let (mut first, mut sum) = (0, 0);
        for last in &self.free {
            sum += last.len() as u32;
            while sum - self.free[first].len() as u32 >= room {
                sum -= self.free[first].len() as u32;
                first += 1;
            }
            let stretch = self.free[first].start..last.end;
            let taken = stretch.len() as u32 - sum;
            if sum >= room && best.as_ref().is_none_or(|(_, least)| taken < *least) {
                best = Some((stretch, taken));
            }
        }
        best
    }

    /// Records that the taken points of a stretch from `scattered` now lie at its lower end, without gaps.
    pub fn slid(&mut self, stretch: Range<u32>, taken: u32) {
        self.free.retain(|free| !stretch.contains(&free.start));
        self.release(stretch.start + taken..stretch.end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_touch_are_joined_and_the_smallest_that_fits_is_taken() {
        let mut room = PageSpace::new(100);
        let taken: Vec<u32> = (0..10).filter_map(|_| room.take(10)).collect();
        assert_eq!(taken, (0..10).map(|i| i * 10).collect::<Vec<_>>());
        assert_eq!(room.take(1), None);
        for part in [20..30, 70..80, 30..40, 60..70, 80..90, 0..10] {
            room.release(part);
        }
        assert_eq!(room.free, [0..10, 20..40, 60..90]);
        assert_eq!(room.take(15), Some(20));
        assert_eq!(room.free, [0..10, 35..40, 60..90]);
        [10..20, 20..35, 40..60, 90..100].into_iter().for_each(|part| room.release(part));
        assert!(room.is_unused());
    }

    #[test]
    fn what_is_slid_together_is_the_stretch_with_the_least_in_it() {
        let mut room = PageSpace::new(100);
        room.take(100);
        [5..10, 30..36, 40..45, 90..95].into_iter().for_each(|part| room.release(part));
        assert_eq!(room.take(10), None);
        assert_eq!(room.scattered(10), Some((30..45, 4)));
        assert_eq!(room.scattered(22), None);
        room.slid(30..45, 4);
        assert_eq!(room.free, [5..10, 34..45, 90..95]);
    }

    #[test]
    fn parts_that_come_and_go_for_long_always_find_room_where_so_much_is_free() {
        const CAPACITY: u32 = 100_000;
        let mut room = PageSpace::new(CAPACITY);
        // The parts that are taken, by their first point.
        let mut held: Vec<Range<u32>> = Vec::new();
        let (mut used, mut slid) = (0, 0);
        for step in 0..20_000 {
            let size = 1 + (cloud::hash(step) % 4000) as u32;
            while used + size > CAPACITY {
                let gone = held.swap_remove(cloud::hash(step ^ used as u64) as usize % held.len());
                used -= gone.len() as u32;
                room.release(gone);
            }
            let first = room.take(size).unwrap_or_else(|| {
                let (stretch, taken) = room.scattered(size).expect("so much is free");
                held.sort_by_key(|part| part.start);
                let mut to = stretch.start;
                for part in held.iter_mut().filter(|part| stretch.contains(&part.start)) {
                    *part = to..to + part.len() as u32;
                    to = part.end;
                }
                assert_eq!(to, stretch.start + taken);
                room.slid(stretch, taken);
                slid += 1;
                room.take(size).expect("it was slid together")
            });
            held.push(first..first + size);
            used += size;
        }
        held.sort_by_key(|part| part.start);
        assert!(held.windows(2).all(|pair| pair[0].end <= pair[1].start), "parts overlap");
        assert!(slid > 100, "{slid}: the test would prove nothing");
    }
}
