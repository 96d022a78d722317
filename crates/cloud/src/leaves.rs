//! Points of leaves and twigs: no disc closes what lies between them, so their discs are small.

use glam::{DMat3, DVec3};

use crate::neighbours::Points;
use crate::shape::thickness;
use crate::strays::{Look, median_radius};
use crate::{MIXED_RADIUS, pack_radius};

/// The number of bricks next to one another in a search tile that are looked at together, some 500 points.
const BRICKS: u32 = 16;
/// The fewest points that are looked at together: fewer would be thick by chance.
const FEWEST: usize = 64;
/// The least share of points among leaves that have rough neighbours. Points about an edge have them, but not those
/// farther from it.
const LEAST_ROUGH: f32 = 0.7;
/// The least thickness of points among leaves as a share of their width. Those of a surface are thinner, however large the
/// noise is.
const THICK: f32 = 0.25;
/// Neighbours are rough if they are as thick as this share of their width.
pub(crate) const ROUGH: f32 = 0.2;
/// The radius of a leaf relative to the distance of its fourth neighbour. Larger ones stand before what is behind the
/// leaves, smaller ones show it through them.
const SIZE: f32 = 0.6;
/// The largest radius of a disc among leaves relative to the median one of the rough points there.
const LARGEST: f32 = 1.5;

/// The points of a tile that are among leaves, with their packed radii. `looks` are in the order of the search.
pub(crate) fn leaves_of<'a>(points: &Points, looks: &'a [Look]) -> Vec<(&'a Look, u16)> {
    let mut leaves = Vec::new();
    for group in looks.chunk_by(|a, b| a.brick / BRICKS == b.brick / BRICKS).filter(|group| group.len() >= FEWEST) {
        let rough = group.iter().filter(|look| look.near.is_some()).count();
        let is_rough = rough as f32 >= LEAST_ROUGH * group.len() as f32;
        if !(is_rough && thickness_of(points, group) >= THICK) {
            continue;
        }
        let on_surface = || group.iter().filter(|look| look.radius > MIXED_RADIUS);
        // Neighbours at one place with a point say nothing.
        let near = |look: &Look| look.near.filter(|near| *near > 0.0);
        let own = |look: &Look| near(look).map_or(look.radius, |near| look.radius.min(pack_radius(SIZE * near)));
        let mut radii: Vec<u16> = on_surface().filter(|look| near(look).is_some()).map(own).collect();
        let Some(usual) = median_radius(&mut radii) else { continue };
        let largest = pack_radius(LARGEST * usual);
        leaves.extend(on_surface().map(|look| (look, own(look).min(largest))));
    }
    leaves
}

/// How thick some points are relative to their width.
fn thickness_of(points: &Points, looks: &[Look]) -> f32 {
    let middle = looks.first().map_or(DVec3::ZERO, |look| points.position(look.index));
    let (mut sum, mut squares) = (DVec3::ZERO, DMat3::ZERO);
    for look in looks {
        let offset = points.position(look.index) - middle;
        sum += offset;
        squares += outer(offset);
    }
    let share = 1.0 / looks.len() as f64;
    thickness(squares * share - outer(sum * share))
}

fn outer(offset: DVec3) -> DMat3 {
    DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z)
}
