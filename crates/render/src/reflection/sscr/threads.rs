//! A simulation of the passes that label regions, for tests: many threads work at once, and each takes one step of memory in
//! turn. Software Vulkan runs one workgroup after the other, so it cannot show what a GPU's threads cost one another.
//! Steps that threads take in workgroup memory are not counted: they are an order of magnitude cheaper.

use glam::UVec2;

/// The label of a pixel in no region.
pub const OUTSIDE: u32 = u32::MAX;

/// What labelling a picture costs.
#[derive(Debug, PartialEq)]
pub struct Labelling {
    /// The first pixel of each pixel's region.
    pub labels: Vec<u32>,
    /// Reads and atomics of the buffer of parents, by all threads.
    pub loads: u64,
    /// The most parents that a thread has walked up in one go.
    pub longest_way: u32,
    /// The most atomics on one word of the sizes of regions.
    pub most_on_a_word: u64,
}

/// A thread that walks up a tree.
#[derive(Clone, Copy)]
struct Walk {
    at: u32,
    length: u32,
}

/// What a thread does next.
#[derive(Clone, Copy)]
enum Step {
    /// Looks whether the neighbour is in a region.
    Look,
    /// Walks from the pixel.
    FromPixel(Walk),
    /// Walks from the neighbour, the pixel's root being known.
    FromNeighbor(u32, Walk),
    /// Gives the larger root a parent.
    Join(u32, u32),
}

/// Labels the parts of `inside` while `live` threads work at once, in tiles first or by pixels alone.
pub fn label(inside: &[bool], size: UVec2, live: usize, in_tiles: bool) -> Labelling {
    let pixels = (size.x * size.y) as usize;
    let mut parents: Vec<u32> =
        (0..pixels as u32).map(|index| if inside[index as usize] { index } else { OUTSIDE }).collect();
    if in_tiles {
        join_in_tiles(&mut parents, size);
    }
    let order = by_tiles(size);
    let (mut loads, mut longest_way) = (0, 0);
    // The joins of each pixel: to the left and to the upper one.
    let joins = |index: u32| {
        let (x, y) = (index % size.x, index / size.x);
        let is_asked = |place: u32| place > 0 && (!in_tiles || place.is_multiple_of(8));
        [is_asked(x).then(|| index.wrapping_sub(1)), is_asked(y).then(|| index.wrapping_sub(size.x))]
    };
    let works = order.iter().filter(|index| inside[**index as usize]);
    let mut waiting = works.flat_map(|index| joins(*index).into_iter().flatten().map(|other| (*index, other)));
    let mut threads: Vec<(u32, u32, Step)> = Vec::new();
    loop {
        while threads.len() < live {
            let Some((pixel, neighbor)) = waiting.next() else { break };
            threads.push((pixel, neighbor, Step::Look));
        }
        if threads.is_empty() {
            break;
        }
        threads.retain_mut(|(pixel, neighbor, step)| {
            loads += 1;
            let mut walk = |walk: &mut Walk| {
                let parent = parents[walk.at as usize];
                walk.length += 1;
                longest_way = longest_way.max(walk.length);
                let is_root = parent == walk.at;
                walk.at = parent;
                is_root
            };
            let from = |at: u32| Walk { at, length: 0 };
            match step {
                Step::Look if parents[*neighbor as usize] == OUTSIDE => return false,
                Step::Look => *step = Step::FromPixel(from(*pixel)),
                Step::FromPixel(way) => {
                    if walk(way) {
                        *step = Step::FromNeighbor(way.at, from(*neighbor));
                    }
                }
                Step::FromNeighbor(root, way) => {
                    if walk(way) {
                        if *root == way.at {
                            return false;
                        }
                        *step = Step::Join(*root, way.at);
                    }
                }
                Step::Join(a, b) => {
                    let (larger, smaller) = ((*a).max(*b), (*a).min(*b));
                    let before = parents[larger as usize];
                    parents[larger as usize] = before.min(smaller);
                    if before == larger {
                        return false;
                    }
                    (*pixel, *neighbor) = (before, smaller);
                    *step = Step::FromPixel(from(before));
                }
            }
            true
        });
    }
    let labels = flatten(&mut parents, &order, live, &mut loads, &mut longest_way);
    let most_on_a_word = most_on_a_word(&labels, &order, in_tiles);
    Labelling { labels, loads, longest_way, most_on_a_word }
}

/// Gives each pixel its root for a parent.
fn flatten(parents: &mut [u32], order: &[u32], live: usize, loads: &mut u64, longest_way: &mut u32) -> Vec<u32> {
    let mut waiting = order.iter().filter(|index| parents[**index as usize] != OUTSIDE).copied().collect::<Vec<_>>();
    waiting.reverse();
    let mut threads: Vec<(u32, Walk)> = Vec::new();
    loop {
        while threads.len() < live {
            let Some(index) = waiting.pop() else { break };
            threads.push((index, Walk { at: index, length: 0 }));
        }
        if threads.is_empty() {
            break;
        }
        threads.retain_mut(|(index, walk)| {
            *loads += 1;
            walk.length += 1;
            *longest_way = walk.length.max(*longest_way);
            let parent = parents[walk.at as usize];
            if parent == walk.at {
                parents[*index as usize] = parent;
                return false;
            }
            walk.at = parent;
            true
        });
    }
    parents.to_vec()
}

/// The most atomics on the word that counts a region's pixels: one for each pixel, or one for each tile that has pixels
/// of its first root and one for each other pixel.
fn most_on_a_word(labels: &[u32], order: &[u32], in_tiles: bool) -> u64 {
    let mut adds = vec![0; labels.len()];
    for tile in order.chunks(64) {
        let first = tile.iter().map(|index| labels[*index as usize]).filter(|label| *label != OUTSIDE).min();
        let of_tile = tile.iter().map(|index| labels[*index as usize]).filter(|label| *label != OUTSIDE);
        for label in of_tile.filter(|label| !in_tiles || Some(*label) != first) {
            adds[label as usize] += 1;
        }
        if let Some(first) = first.filter(|_| in_tiles) {
            adds[first as usize] += 1;
        }
    }
    adds.into_iter().max().unwrap_or(0)
}

/// The pixels, workgroup by workgroup; a picture is whole tiles.
fn by_tiles(size: UVec2) -> Vec<u32> {
    let tiles = size / 8;
    let pixel = |place: u32| {
        let (tile, lane) = (place / 64, place % 64);
        (tile / tiles.x * 8 + lane / 8) * size.x + tile % tiles.x * 8 + lane % 8
    };
    (0..size.x * size.y).map(pixel).collect()
}

/// Gives each pixel the first pixel of its part in its tile for a parent.
fn join_in_tiles(parents: &mut [u32], size: UVec2) {
    for tile in by_tiles(size).chunks(64) {
        // A label spreads until nothing changes.
        let mut is_changed = true;
        while is_changed {
            is_changed = false;
            for (lane, &index) in tile.iter().enumerate() {
                let before = [(lane % 8 > 0).then_some(1), (lane >= 8).then_some(8)];
                for back in before.into_iter().flatten() {
                    let other = tile[lane - back];
                    let [own, others] = [index, other].map(|index| parents[index as usize]);
                    if own != OUTSIDE && others != OUTSIDE && own != others {
                        (parents[index as usize], parents[other as usize]) = (own.min(others), own.min(others));
                        is_changed = true;
                    }
                }
            }
        }
    }
}

/// A mirror in a picture: a disc with wavy borders between its regions, as of a curved mirror.
pub fn regions(size: UVec2) -> Vec<bool> {
    let middle = size.as_vec2() * 0.5;
    let pixel = |index: u32| {
        let at = UVec2::new(index % size.x, index / size.x).as_vec2() - middle;
        let wave = at.x + 24.0 * (at.y * 0.04).sin();
        at.length() < middle.y * 0.95 && (wave / 200.0).fract().abs() > 0.006
    };
    (0..size.x * size.y).map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflection::sscr::twin::label_by_contours;

    #[test]
    fn labels_do_not_depend_on_how_many_threads_work_at_once() {
        let size = UVec2::new(160, 96);
        let inside = regions(size);
        let numbers = label_by_contours(&inside, size);
        // Regions are numbered in the order of their first pixels.
        let firsts: Vec<u32> = (0..inside.len())
            .filter(|index| numbers[*index] > 0 && !numbers[..*index].contains(&numbers[*index]))
            .map(|index| index as u32)
            .collect();
        let first_of = |number: &u32| if *number == 0 { OUTSIDE } else { firsts[*number as usize - 1] };
        let expected: Vec<u32> = numbers.iter().map(first_of).collect();
        assert!(firsts.len() > 1);
        for (live, in_tiles) in [(1, false), (64, true), (5000, false), (5000, true), (1 << 20, true)] {
            assert!(label(&inside, size, live, in_tiles).labels == expected, "{live} threads, in tiles: {in_tiles}");
        }
    }

    #[test]
    fn tiles_spare_threads_that_work_at_once_most_of_their_loads() {
        let size = UVec2::new(480, 272);
        let inside = regions(size);
        let [by_pixels, in_tiles] = [false, true].map(|in_tiles| label(&inside, size, 27_000, in_tiles));
        assert!(by_pixels.labels == in_tiles.labels);
        assert!(in_tiles.loads * 4 < by_pixels.loads, "{} and {}", by_pixels.loads, in_tiles.loads);
        assert!(in_tiles.most_on_a_word * 4 < by_pixels.most_on_a_word);
    }
}
