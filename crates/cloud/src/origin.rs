//! Where the origin of a chunk lies: one rule for all readers, for pages of an index and for points that are spread
//! over a mesh.
//!
//! An offset in f32 has 24 bits. So an origin lies amid the points: a point within a kilometre of it is exact to
//! 0.03 mm, one that is 500 km away to 16 mm. A point far from the others of its chunk costs its own digits alone,
//! wherever in the file it stands.

use glam::{DVec3, Vec3};

use crate::hash;

/// The number of points that decide where most are.
const SAMPLE: usize = 99;
/// With fewer different places than this in the sample, all points are looked at.
const FEWEST: usize = 9;
/// The share of the sampled places that are within the reach.
const WITHIN: f64 = 0.9;

/// A point amid the others of a chunk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amid {
    pub index: usize,
    /// The distance along any axis within which nine tenths of the places lie.
    pub reach: f64,
}

/// The point amid `count` others: of a sample that is spread over them, the one nearest to the median of each
/// coordinate. Points at one place, such as pulses without an echo at 0, 0, 0, count once. `None` if no place is finite.
pub fn amid(count: usize, place: impl Fn(usize) -> DVec3) -> Option<Amid> {
    let different = |sampled: usize| {
        let start = |part: usize| (count as u128 * part as u128 / sampled as u128) as usize;
        // At places drawn by hash: strays may come at regular distances.
        let index = |part| start(part) + (hash(part as u64) % (start(part + 1) - start(part)) as u64) as usize;
        let mut places: Vec<(DVec3, usize)> = (0..sampled).map(index).map(|index| (place(index), index)).collect();
        places.retain(|(place, _)| place.is_finite());
        let key = |place: &DVec3| place.to_array().map(|value| value + 0.0);
        places.sort_unstable_by(|(a, _), (b, _)| {
            let (a, b) = (key(a), key(b));
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]))
        });
        places.dedup_by(|(a, _), (b, _)| a == b);
        places
    };
    let mut places = different(count.min(SAMPLE));
    if places.len() < FEWEST && count > SAMPLE {
        places = different(count);
    }
    let rank_of = |values: &mut [f64], share: f64| {
        let rank = ((values.len() as f64 * share) as usize).min(values.len().checked_sub(1)?);
        Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
    };
    let mut median = DVec3::ZERO;
    for axis in 0..3 {
        median[axis] = rank_of(&mut places.iter().map(|(place, _)| place[axis]).collect::<Vec<_>>(), 0.5)?;
    }
    let apart = |a: &DVec3, b: &DVec3| (*a - *b).abs().max_element();
    let (nearest, index) = *places.iter().min_by(|(a, _), (b, _)| apart(a, &median).total_cmp(&apart(b, &median)))?;
    let reach = rank_of(&mut places.iter().map(|(place, _)| apart(place, &nearest)).collect::<Vec<_>>(), WITHIN)?;
    Some(Amid { index, reach })
}

/// An origin amid some places and their offsets from it.
pub(crate) fn offsets(places: &[DVec3]) -> (DVec3, Vec<[f32; 3]>) {
    let origin = amid(places.len(), |index| places[index]).map_or(DVec3::ZERO, |amid| places[amid.index]);
    (origin, places.iter().map(|place| offset_from(origin, *place)).collect())
}

/// The offset from `origin`; NaN for a place that is not finite or too far for f32.
#[inline]
pub fn offset_from(origin: DVec3, place: DVec3) -> [f32; 3] {
    let offset = (place - origin).as_vec3();
    if offset.is_finite() { offset.to_array() } else { Vec3::NAN.to_array() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Random;

    const SITE: DVec3 = DVec3::new(455_000.0, 5_482_000.0, 110.0);

    /// A room of 8 m at coordinates of seven digits, of which every `share`-th point is elsewhere, in a random order.
    fn room(count: usize, elsewhere: impl Fn(usize) -> Option<DVec3>) -> Vec<DVec3> {
        let mut random = Random(3);
        let mut places: Vec<DVec3> = (0..count)
            .map(|index| {
                let mut unit = || random.below(1 << 20) as f64 / f64::from(1 << 20);
                let place = SITE + DVec3::new(unit(), unit(), unit()) * 8.0;
                elsewhere(index).unwrap_or(place)
            })
            .collect();
        for index in (1..count).rev() {
            places.swap(index, random.below(index as u64 + 1) as usize);
        }
        places
    }

    fn is_in_room(places: &[DVec3]) -> bool {
        let amid = amid(places.len(), |index| places[index]).unwrap();
        let off = places[amid.index] - SITE;
        off.cmpge(DVec3::ZERO).all() && off.cmple(DVec3::splat(8.0)).all()
    }

    #[test]
    fn the_origin_lies_where_most_points_are_whatever_else_is_among_them_and_in_any_order() {
        for count in [20, 99, 1000, 65_536] {
            let first = |share: usize| move |index: usize| (index * 100 < count * share).then_some(DVec3::ZERO);
            for share in [0, 1, 5, 30, 60, 90] {
                let mut places = room(count, first(share));
                assert!(is_in_room(&places), "{share} % of {count} at 0, 0, 0");
                for sorted in [false, true] {
                    places.sort_by(|a, b| a.x.total_cmp(&b.x));
                    if sorted {
                        places.reverse();
                    }
                    assert!(is_in_room(&places), "{share} % of {count} at 0, 0, 0, sorted");
                }
            }
            // Strays that are all apart, and two more sites of which neither has most points.
            let strays = |index: usize| (index % 4 == 1).then(|| DVec3::splat(index as f64 * 1e5));
            assert!(is_in_room(&room(count, strays)), "{count}");
        }
        let sites = [DVec3::ZERO, DVec3::new(9e5, 0.0, 0.0), DVec3::new(0.0, 9e6, 0.0)];
        let mut random = Random(9);
        let places: Vec<DVec3> =
            (0..999).map(|index| sites[index % 3] + DVec3::splat(random.below(1 << 20) as f64 * 1e-5)).collect();
        let found = places[amid(999, |index| places[index]).unwrap().index];
        assert!(sites.iter().any(|site| (found - *site).abs().max_element() <= 11.0), "{found} is at no site");
    }

    #[test]
    fn the_reach_holds_nine_tenths_and_places_that_are_nowhere_count_for_nothing() {
        let line: Vec<DVec3> = (0..1000).map(|index| SITE + DVec3::X * f64::from(index) * 0.01).collect();
        let found = amid(line.len(), |index| line[index]).unwrap();
        assert!((line[found.index].x - SITE.x - 5.0).abs() < 1.5 && (4.0..6.0).contains(&found.reach), "{found:?}");
        let mut nowhere = vec![DVec3::NAN; 5000];
        assert_eq!(amid(5000, |index| nowhere[index]), None);
        assert_eq!(amid(0, |_| DVec3::ZERO), None);
        nowhere[4321] = SITE;
        assert_eq!(amid(5000, |index| nowhere[index]), Some(Amid { index: 4321, reach: 0.0 }));
        let (origin, offsets) = offsets(&nowhere);
        assert!(origin == SITE && offsets[4321] == [0.0; 3] && offsets[0][0].is_nan());
    }
}
