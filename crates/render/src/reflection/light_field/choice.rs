//! Which samples of a mirror have maps: all, or with `light_field.accuracy` as few as its pixels need.

use std::sync::Arc;

use cloud::Bounds;
use glam::DVec3;

use super::grid::Grid;
use crate::layout::NO_SAMPLE;

/// One pixel in so many may be predicted to be off.
const MOST_OFF: u32 = 20;

/// Some of the samples of a mirror, by their number among all of them.
#[derive(Clone)]
pub struct Choice {
    pub samples: Arc<[usize]>,
    /// The cells hold the numbers of the samples among all of the mirror.
    pub grid: Arc<Grid>,
}

impl Choice {
    /// `places` are those of all samples.
    pub fn new(places: &[DVec3], bounds: &Bounds, samples: Vec<usize>) -> Self {
        let chosen: Vec<DVec3> = samples.iter().map(|sample| places[*sample]).collect();
        let mut grid = Grid::new(&chosen, bounds);
        for number in grid.cells.iter_mut().flatten().filter(|number| **number != NO_SAMPLE) {
            *number = samples[*number as usize] as u32;
        }
        Self { samples: samples.into(), grid: Arc::new(grid) }
    }
}

/// Whether too many pixels are off, of how many there are.
pub fn is_off([pixels, off]: [u32; 2]) -> bool {
    u64::from(off) * u64::from(MOST_OFF) > u64::from(pixels)
}

/// The sum of counts of pixels, and of those that are off.
pub fn sum<'a>(counts: impl IntoIterator<Item = &'a [u32; 2]>) -> [u32; 2] {
    counts.into_iter().fold([0; 2], |sum, count| [sum[0] + count[0], sum[1] + count[1]])
}

/// The samples to add to `chosen`, with the number of pixels that are off about each; none if few enough are.
///
/// `counts` has, for each sample, the pixels to which it is the nearest of all, and how many of these are off. The first
/// samples of a mirror lie farthest from one another, so those are added first: the pixels are divided among the first
/// two, four, eight and so on, until one of these that is not chosen has too many that are off.
pub fn more(places: &[DVec3], counts: &[[u32; 2]], chosen: &[usize]) -> Vec<(u32, usize)> {
    if !is_off(sum(counts)) {
        return Vec::new();
    }
    let mut first = 1;
    loop {
        first = (2 * first).min(places.len());
        let mut sums = vec![[0; 2]; first];
        for (place, count) in places.iter().zip(counts).filter(|(_, count)| count[0] > 0) {
            let away = |sample: &usize| places[*sample].distance_squared(*place);
            let nearest = (0..first).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0);
            sums[nearest] = sum([&sums[nearest], count]);
        }
        let is_new = |(sample, count): &(usize, [u32; 2])| is_off(*count) && !chosen.contains(sample);
        let added: Vec<(u32, usize)> =
            sums.into_iter().enumerate().filter(is_new).map(|(sample, [_, off])| (off, sample)).collect();
        if !added.is_empty() || first == places.len() {
            return added;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples on a line in the order of farthest points: its ends, the middle, the quarters, the eighths.
    fn line() -> Vec<DVec3> {
        [0.0, 1.0, 0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875].map(|x| DVec3::X * x).to_vec()
    }

    #[test]
    fn samples_are_added_where_pixels_are_off_and_the_far_ones_first() {
        let places = line();
        let none = vec![[100, 4]; places.len()];
        assert!(more(&places, &none, &[0]).is_empty(), "four in a hundred may be off");
        let all = vec![[100, 60]; places.len()];
        let mut chosen = vec![0];
        let mut rounds = Vec::new();
        loop {
            let added: Vec<usize> = more(&places, &all, &chosen).into_iter().map(|(_, sample)| sample).collect();
            if added.is_empty() {
                break;
            }
            rounds.push(added.clone());
            chosen.extend(added);
        }
        assert_eq!(rounds, [vec![1], vec![2, 3], vec![4, 5, 6, 7], vec![8]], "until there are no more");
        // Only at the end of the line.
        let mut end = vec![[100, 0]; places.len()];
        end[8] = [100, 100];
        assert_eq!(more(&places, &end, &[0]), [(100, 1)]);
        assert_eq!(more(&places, &end, &[0, 1]), [(100, 8)], "of those between, none is nearer to it than the end");
        assert!(more(&places, &end, &[0, 1, 8]).is_empty(), "nothing is left that would help");
        // Few of all pixels are off, though all of some samples' are.
        end[8] = [100, 40];
        assert!(more(&places, &end, &[0]).is_empty());
    }

    #[test]
    fn cells_of_a_choice_have_the_numbers_of_all_samples() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(1.0, 0.0, 0.0) };
        let choice = Choice::new(&line(), &bounds, vec![1, 4, 8]);
        let mut numbers: Vec<u32> = choice.grid.cells.concat().into_iter().filter(|n| *n != NO_SAMPLE).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers, [1, 4, 8]);
    }
}
