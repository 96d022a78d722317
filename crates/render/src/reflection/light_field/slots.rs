//! The room for maps: which maps stand, and which one makes room for another.

use glam::DVec3;

/// A map that stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    /// The number of its field and that of its sample.
    pub of: (u64, usize),
    pub place: DVec3,
    /// Whether it lacks the newest points.
    pub is_stale: bool,
    /// The frame in which it was drawn, and the search that needed it last.
    pub drawn: u64,
    pub used: u64,
}

/// The room for maps in all pages, one after the other.
#[derive(Default)]
pub struct Slots(pub Vec<Option<Map>>);

impl Slots {
    /// The number of maps that stand.
    pub fn count(&self) -> usize {
        self.0.iter().flatten().count()
    }

    /// The slot of a sample's map.
    pub fn slot_of(&self, of: (u64, usize)) -> Option<usize> {
        self.0.iter().position(|slot| slot.is_some_and(|map| map.of == of))
    }

    /// Says that a search needs these samples. Returns the number of those without a map.
    pub fn need(&mut self, samples: &[(u64, usize)], search: u64) -> usize {
        let mut missing = 0;
        for of in samples {
            match self.slot_of(*of).and_then(|slot| self.0[slot].as_mut()) {
                Some(map) => map.used = search,
                None => missing += 1,
            }
        }
        missing
    }

    /// The slot for a sample's map: that of its old one, or a free one, or that of the map that was not needed for
    /// longest, if this search does not need it.
    fn slot_for(&self, of: (u64, usize), search: u64) -> Option<usize> {
        let used = |slot: &usize| self.0[*slot].map_or(0, |map| map.used);
        let least_used = || (0..self.0.len()).min_by_key(used).filter(|slot| used(slot) < search);
        self.slot_of(of).or_else(least_used)
    }

    /// Lets `draw` make the maps of these samples, by their place in the list and their slot, that do not stand or are
    /// stale. What `draw` leaves out stays as it is. Returns how many stand.
    ///
    /// # Errors
    /// That of `draw`, whose slot is then free.
    pub fn fill<E>(
        &mut self,
        samples: &[(u64, usize)],
        search: u64,
        mut draw: impl FnMut(usize, usize) -> Result<Option<Map>, E>,
    ) -> Result<u32, E> {
        let mut standing = 0;
        for (number, of) in samples.iter().enumerate() {
            if self.slot_of(*of).and_then(|slot| self.0[slot]).is_some_and(|map| !map.is_stale) {
                standing += 1;
                continue;
            }
            let Some(slot) = self.slot_for(*of, search) else { continue };
            let before = self.0[slot].take();
            let drawn = draw(number, slot)?;
            standing += u32::from(drawn.is_some());
            self.0[slot] = drawn.or(before);
        }
        Ok(standing)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The samples that a frame needs, those of most pixels first.
    fn frames() -> impl Strategy<Value = Vec<Vec<usize>>> {
        let one = prop::sample::subsequence((0..12_usize).collect::<Vec<_>>(), 0..10).prop_shuffle();
        prop::collection::vec(one, 1..24)
    }

    /// Draws the maps of a frame; returns how many.
    fn draw(slots: &mut Slots, samples: &[usize], search: u64) -> usize {
        let chosen: Vec<(u64, usize)> = samples.iter().take(slots.0.len()).map(|sample| (1, *sample)).collect();
        let missing = slots.need(&chosen, search);
        let mut drawn = 0;
        let draw = |number: usize, _| -> Result<Option<Map>, std::convert::Infallible> {
            drawn += 1;
            let place = DVec3::ZERO;
            Ok(Some(Map { of: chosen[number], place, is_stale: false, drawn: search, used: search }))
        };
        assert_eq!(slots.fill(&chosen, search, draw).unwrap(), chosen.len() as u32, "there is room for all");
        assert_eq!(drawn, missing);
        drawn
    }

    proptest! {
        /// Against a list of samples with the frame that needed each last, which loses the first ones.
        #[test]
        fn the_maps_that_were_not_needed_for_longest_make_room(room in 1_usize..9, frames in frames()) {
            let mut slots = Slots(vec![None; room]);
            let mut list: Vec<(u64, usize)> = Vec::new();
            for (samples, search) in frames.iter().zip(1_u64..) {
                let chosen = &samples[..samples.len().min(room)];
                let missing = chosen.iter().filter(|sample| list.iter().all(|(_, other)| other != *sample)).count();
                prop_assert_eq!(draw(&mut slots, samples, search), missing);
                list.retain(|(_, sample)| !chosen.contains(sample));
                list.extend(chosen.iter().map(|sample| (search, *sample)));
                // Samples that were needed last in the same frame are alike, so only the frames are compared.
                list.sort_unstable();
                let over = list.len().saturating_sub(room);
                let lost: Vec<(u64, usize)> = list.drain(..over).collect();
                let mut used: Vec<u64> = slots.0.iter().flatten().map(|map| map.used).collect();
                used.sort_unstable();
                prop_assert_eq!(&used, &list.iter().map(|(search, _)| *search).collect::<Vec<u64>>());
                prop_assert!(slots.count() <= room);
                prop_assert!(chosen.iter().all(|sample| slots.slot_of((1, *sample)).is_some()));
                list = in_order(&slots);
                // A map that stays was needed no earlier than one that went.
                let stays = |(search, _): &(u64, usize)| used.iter().all(|used| used >= search);
                prop_assert!(lost.iter().all(stays), "{lost:?} went, {used:?} stay");
            }
        }

        #[test]
        fn where_all_maps_fit_none_is_drawn_twice(frames in frames()) {
            let mut slots = Slots(vec![None; 12]);
            let drawn: usize = frames.iter().zip(1..).map(|(samples, search)| draw(&mut slots, samples, search)).sum();
            let mut all: Vec<usize> = frames.concat();
            all.sort_unstable();
            all.dedup();
            prop_assert_eq!(drawn, all.len());
            let last = frames.len() as u64;
            prop_assert_eq!(draw(&mut slots, &frames[frames.len() - 1], last + 1), 0);
        }
    }

    /// The samples of all maps, those that were not needed for longest first.
    fn in_order(slots: &Slots) -> Vec<(u64, usize)> {
        let mut all: Vec<(u64, usize)> = slots.0.iter().flatten().map(|map| (map.used, map.of.1)).collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn an_old_map_is_drawn_anew_in_its_own_slot() {
        let mut slots = Slots(vec![None; 2]);
        draw(&mut slots, &[4, 7], 1);
        slots.0.iter_mut().flatten().for_each(|map| map.is_stale = true);
        slots.need(&[(1, 7)], 2);
        assert_eq!(slots.slot_for((1, 7), 2), Some(1));
        assert_eq!(slots.slot_for((1, 9), 2), Some(0), "what the search needs stays");
        slots.need(&[(1, 4)], 2);
        assert_eq!(slots.slot_for((1, 9), 2), None);
    }

    #[test]
    fn a_map_that_is_left_out_stays_and_one_that_fails_is_gone() {
        let mut slots = Slots(vec![None; 2]);
        draw(&mut slots, &[4, 7], 1);
        slots.0.iter_mut().flatten().for_each(|map| map.is_stale = true);
        let before = slots.0.clone();
        let standing = slots.fill::<()>(&[(1, 4), (1, 7)], 2, |_, _| Ok(None));
        assert!(standing == Ok(0) && slots.0 == before);
        assert_eq!(slots.fill(&[(1, 7), (1, 4)], 2, |_, _| Err("no memory")), Err("no memory"));
        assert!(slots.0[0] == before[0] && slots.0[1].is_none());
    }
}
