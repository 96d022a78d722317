//! Finds mirrors without help: planes, then balls (`spheres.rs`) and columns (`columns.rs`).
//!
//! A plane mirror makes the surfaces behind it mirror images of those before it. So each pair of planes in the scan
//! suggests two mirrors, the planes that mirror one to the other, and each plane itself suggests one, since mirrors hang
//! on walls and panes stand in frames. A suggestion is tried by unfolding points that lie behind it; the best are moved
//! until the unfolded points fit the surfaces of the scan (weighted least squares, with weights that fall with the
//! distance). Then the station's sightlines are looked at where they cross the plane: a mirror is a patch of it in which
//! they end behind it and fit unfolded, and around which they end at it. Walls and frames close that border. Where rooms
//! are symmetric by themselves, sightlines cross the plane freely all around, and there is no mirror.

use std::collections::{BTreeMap, BTreeSet};

use cloud::{Progress, hash};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use scene::{Mirror, Shape};

use crate::columns::{Part, columns, extend};
use crate::found::Found;
use crate::gauge::{BEHIND, Gauge, Sample};
use crate::planes::{Plane, planes};
use crate::refine::{Seen, distances, moved, some_of};
use crate::spheres::suggested;
use crate::surface_map::SurfaceMap;
use crate::unfold::{Mirrors, Reflector};

/// The most mirrors that are found.
const MOST_FOUND: usize = 16;
/// The points behind a suggested mirror by which it is tried, and the suggestions that are looked at closely.
const TRIED: usize = 500;
const CLOSELY: usize = 60;
/// The fewest of the tried points that fit.
const FEWEST_FITS: usize = 12;
/// The fewest points that make a mirror.
const FEWEST_POINTS: usize = 60;
/// The least distance of a station from a mirror, in edges of the finest cells.
const BEFORE: f64 = 5.0;
/// How far from the plane of a mirror its wall and its frame may be, in edges of the finest cells.
const MOUNTED: f64 = 2.5;
/// The cosine between the mirrored normal at a point and the normal of the surface that it fits.
const AGREES: f64 = 0.95;
/// A surface that is mirrored onto itself says nothing of the mirror: the cosine between its normal and that of the mirror is below.
const TELLS: f64 = 0.3;
/// The share of the points behind a mirror that fit at least, in a cell of its plane and in all.
const LEAST_FIT: f64 = 0.15;
/// The share of the points behind a mirror whose surfaces are not mirrored onto themselves that fit at least.
const LEAST_TELLING: f64 = 0.2;
/// The cosine between the normals of a mirror and of the wall or the frame about it.
const PARALLEL: f64 = 0.9;
/// The share of the border at which sightlines end at the plane.
const LEAST_CLOSED: f64 = 0.6;
/// That share while the plane is refined, which changes it by some hundredths.
const MAY_CLOSE: f64 = 0.5 * LEAST_CLOSED;
/// The fewest cells of the border at which sightlines end at the plane.
const FEWEST_CLOSED: f64 = 8.0;
/// The sightlines that fit in a cell of a plane, in the mean, and the number of widths of cells that are tried for that.
const FULL: f64 = 6.0;
const WIDENED: i32 = 6;
/// A mirror through which nothing is seen: at least this share of the distinctive points fits.
const OPAQUE: f64 = 0.85;

/// The balls that are looked at closely.
const BALLS: usize = 16;
/// The share of the points within the outline of a ball that fit at least.
const LEAST_IN_BALL: f64 = 0.5;
/// A fit of a plane is nearer than so many of the finest edges.
const NEAR_PLANE: f64 = 2.0;

/// Everything that mirrors are looked for in.
struct Search<'a> {
    stations: &'a [DVec3],
    map: &'a SurfaceMap,
    /// The planes of the scan, largest first.
    walls: Vec<Plane>,
    samples: Vec<Sample>,
}

/// Looks for plane mirrors, those that explain most points first, then for balls and columns. `None` when cancelled.
pub fn find(gauge: &Gauge, progress: &Progress) -> Option<Vec<Found>> {
    let Gauge { stations, map, samples } = gauge;
    let mut search = Search { stations, map, walls: planes(&map.wide_patches()), samples: samples.clone() };
    let mut found: Vec<Found> = Vec::new();
    let mut suggestions = search.suggestions();
    while found.len() < MOST_FOUND && !progress.is_cancelled() {
        let tried: Vec<_> = suggestions.par_iter().filter_map(|suggestion| search.look(suggestion)).collect();
        let Some((mirror, plane, explained)) = tried.into_iter().max_by_key(|(_, _, explained)| explained.len()) else {
            break;
        };
        search.take(&explained);
        suggestions.retain(|suggestion| !is_same(&suggestion.plane, &plane, search.map.edge()));
        found.push(mirror);
    }
    for station in 0..stations.len() {
        for curved in [Search::balls, Search::columns] {
            if progress.is_cancelled() {
                return None;
            }
            for mirror in curved(&search, station) {
                // Another station may see it, too.
                if !found.iter().any(|known| known.is_at(&mirror)) {
                    let explained = search.seen_in(&mirror);
                    search.take(&explained);
                    found.push(mirror);
                }
            }
        }
    }
    (!progress.is_cancelled()).then_some(found)
}

fn is_same(one: &Plane, other: &Plane, edge: f64) -> bool {
    one.normal.dot(other.normal).abs() > 0.9999 && (one.offset.abs() - other.offset.abs()).abs() < edge
}

/// A plane that may be a mirror, seen from a station, which its normal points to.
#[derive(Clone, Copy, Debug)]
struct Suggestion {
    station: usize,
    plane: Plane,
}

/// What a sightline does at a plane.
#[derive(Clone, Copy)]
enum Does {
    /// It ends there, on a surface that is parallel to the plane or on another one, such as the floor below a mirror.
    EndOn,
    EndAcross,
    /// It ends behind it, and unfolded fits a surface or not.
    Fit,
    Other,
}

/// A sample, where its sightline crosses a plane, and what that does there.
type Crossed = (usize, [f64; 2], Does);

/// What the sightlines through a cell of a plane do.
#[derive(Clone, Copy, Default)]
struct Crossing {
    on: u32,
    across: u32,
    fit: u32,
    other: u32,
}

impl Crossing {
    fn add(&mut self, does: Does) {
        *match does {
            Does::EndOn => &mut self.on,
            Does::EndAcross => &mut self.across,
            Does::Fit => &mut self.fit,
            Does::Other => &mut self.other,
        } += 1;
    }
}

impl Search<'_> {
    /// The samples that a station may have seen.
    fn of_station(&self, station: usize) -> impl Iterator<Item = (usize, &Sample)> {
        let is_own = move |(_, sample): &(usize, &Sample)| sample.station.is_none_or(|own| own == station);
        self.samples.iter().enumerate().filter(is_own)
    }

    /// Whether a point behind a plane fits a surface when it is unfolded, by place and normal: how far it is from it, and
    /// whether anything of the plane follows from that.
    fn fit(&self, sample: &Sample, plane: &Plane) -> Option<(f64, DVec3, bool)> {
        let fit = self.map.nearest(plane.mirrored(sample.place))?;
        if fit.distance.abs() > NEAR_PLANE * self.map.edge() {
            return None;
        }
        let surface = fit.patch.normal.as_dvec3();
        let turned = |normal: DVec3| normal - plane.normal * (2.0 * normal.dot(plane.normal));
        // Ghosts in a sparse scan have no normals; place alone says whether they fit.
        let is_alike = sample.normal.is_none_or(|normal| turned(normal).dot(surface).abs() > AGREES);
        is_alike.then(|| (fit.distance, surface, surface.dot(plane.normal).abs() > TELLS))
    }

    /// The suggestions that most of the tried points speak for.
    fn suggestions(&self) -> Vec<Suggestion> {
        let (edge, walls) = (self.map.edge(), &self.walls);
        let mut all = Vec::new();
        for (index, wall) in walls.iter().enumerate() {
            // A mirror hangs before its wall, a pane stands in the middle of its frame.
            all.extend([-2.0, -1.0, 0.0, 1.0, 2.0].map(|step| Plane { offset: wall.offset + step * edge, ..*wall }));
            all.extend(walls[..index].iter().flat_map(|other| wall.bisectors(other)));
        }
        let facing = |station: usize| {
            let place = self.stations[station];
            all.iter().map(move |plane| Suggestion { station, plane: plane.facing(place) })
        };
        let suggestions: Vec<Suggestion> = (0..self.stations.len()).flat_map(facing).collect();
        let tried: Vec<Vec<&Sample>> = (0..self.stations.len())
            .map(|station| {
                let known = self.of_station(station).map(|(_, sample)| sample);
                let mut known: Vec<&Sample> = known.filter(|sample| sample.normal.is_some()).collect();
                known.sort_by_key(|sample| hash(sample.place.x.to_bits() ^ hash(sample.place.y.to_bits())));
                known
            })
            .collect();
        let score = |suggestion: &Suggestion| {
            let Suggestion { station, plane } = suggestion;
            if plane.height(self.stations[*station]) < BEFORE * edge {
                return 0;
            }
            let is_behind = |sample: &&&Sample| plane.height(sample.place) < -BEHIND * edge;
            let behind = tried[*station].iter().take(16 * TRIED).filter(is_behind).take(TRIED);
            behind.filter(|sample| self.fit(sample, plane).is_some_and(|(_, _, tells)| tells)).count()
        };
        let mut scored: Vec<(usize, Suggestion)> =
            suggestions.into_par_iter().map(|suggestion| (score(&suggestion), suggestion)).collect();
        scored.retain(|(score, _)| *score >= FEWEST_FITS);
        scored.sort_by_key(|(score, _)| usize::MAX - score);
        let mut kept: Vec<Suggestion> = Vec::new();
        for (_, suggestion) in scored {
            let is_near = |known: &Suggestion| {
                known.station == suggestion.station && is_same(&known.plane, &suggestion.plane, 0.5 * edge)
            };
            if kept.len() < CLOSELY && !kept.iter().any(is_near) {
                kept.push(suggestion);
            }
        }
        kept
    }

    /// Refines a suggestion and looks for a mirror in its plane: the mirror, its plane, and the samples that it explains.
    fn look(&self, suggestion: &Suggestion) -> Option<(Found, Plane, Vec<usize>)> {
        let edge = self.map.edge();
        let station = self.stations[suggestion.station];
        let mut plane = suggestion.plane;
        let behind = |plane: &Plane| {
            let is_behind = |(_, sample): &(usize, &Sample)| plane.height(sample.place) < -BEHIND * edge;
            self.of_station(suggestion.station).filter(is_behind).map(|(index, _)| index).collect::<Vec<_>>()
        };
        let mut own = behind(&plane);
        let mut patch = None;
        // All points behind it at first, then those of the patch that they make.
        for scale in [2.0, 1.0, 0.5, 0.25, 0.15, 0.1] {
            plane = self.refined(plane, station, &own, scale * edge)?;
            if plane.height(station) < BEFORE * edge {
                return None;
            }
            let reach = (2.0 * scale * edge).max(5.0 * self.map.noise());
            let area = self.patch(suggestion.station, &plane, reach)?;
            if area.closed < MAY_CLOSE {
                return None;
            }
            own = area.inside.clone();
            patch = Some(area);
        }
        let area = patch?;
        let near = (5.0 * self.map.noise()).max(0.2 * edge);
        let is_telling = |sample: &Sample| sample.normal.is_some_and(|normal| normal.dot(plane.normal).abs() > TELLS);
        let (mut distances, mut telling, mut telling_fits) = (Vec::new(), 0, 0);
        for sample in own.iter().map(|index| &self.samples[*index]) {
            let fit = self.fit(sample, &plane).filter(|(distance, ..)| distance.abs() < near);
            distances.extend(fit.map(|(distance, ..)| distance.abs()));
            if is_telling(sample) {
                telling += 1;
                telling_fits += usize::from(fit.is_some_and(|(.., tells)| tells));
            }
        }
        let is_explained = telling_fits as f64 > LEAST_TELLING * telling as f64;
        if telling_fits < FEWEST_POINTS || !is_explained || area.closed < LEAST_CLOSED {
            return None;
        }
        let share = distances.len() as f64 / own.len() as f64;
        let count = (distances.len() as f64).max(1.0);
        let middle = distances.len() / 2;
        let residual = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        let reason = format!(
            "found: {:.0} % of the points behind it fit surfaces when unfolded, by {:.4} in the middle, and {:.0} % of its \
             border is closed",
            share * 100.0,
            residual,
            area.closed * 100.0
        );
        let reflector = Reflector {
            mirror: area.mirror,
            is_open: (telling_fits as f64) < OPAQUE * telling as f64,
            // Neighbouring points do not err alone: a tenth of them does.
            place_error: residual * 1.5 / (count / 10.0).sqrt(),
            angle_error: residual * 1.5 / (count / 10.0).sqrt() / area.reach,
        };
        Some((Found { reflector, reason }, plane, own))
    }

    /// The plane moved so that unfolded points fit, by Gauss and Newton over two turns and a shift. Distances beyond
    /// `scale` count little.
    fn refined(&self, plane: Plane, station: DVec3, own: &[usize], scale: f64) -> Option<Plane> {
        const MOST: usize = 6000;
        let step = own.len().div_ceil(MOST).max(1);
        let mut plane = plane;
        for _ in 0..4 {
            let first = plane.normal.any_orthonormal_vector();
            let second = plane.normal.cross(first);
            let foot = station - plane.normal * plane.height(station);
            let (mut matrix, mut side, mut count) = (DMat3::ZERO, DVec3::ZERO, 0);
            for index in own.iter().step_by(step) {
                let sample = &self.samples[*index];
                let Some((distance, surface, _)) = self.fit(sample, &plane) else { continue };
                let height = plane.height(sample.place);
                // With the normal turned by t about the foot f of the station, and the plane shifted by o, the height changes
                // by t . (p - f) - o, and the place by -2 (n (t . (p - f) - o) + t h).
                let cosine = surface.dot(plane.normal);
                let by_turn =
                    |axis: DVec3| -2.0 * (cosine * axis.dot(sample.place - foot) + surface.dot(axis) * height);
                let row = DVec3::new(by_turn(first), by_turn(second), 2.0 * cosine);
                let weight = 1.0 / (1.0 + (distance / scale).powi(2)).powi(2);
                matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
                side += row * (distance * weight);
                count += 1;
            }
            if count < FEWEST_FITS {
                return None;
            }
            let damped = matrix
                + DMat3::from_diagonal(DVec3::new(
                    matrix.x_axis.x.max(1e-12),
                    matrix.y_axis.y.max(1e-12),
                    matrix.z_axis.z.max(1e-12),
                )) * 1e-6;
            let change = -(damped.inverse() * side);
            if !change.is_finite() || change.truncate().length() > 0.2 {
                return None;
            }
            let normal = (plane.normal + first * change.x + second * change.y).normalize();
            plane = Plane { normal, offset: normal.dot(foot) + change.z };
        }
        Some(plane)
    }

    /// The part of a plane in which the sightlines of a station end behind it and fit unfolded.
    fn patch(&self, station: usize, plane: &Plane, reach: f64) -> Option<Area> {
        let (edge, from) = (self.map.edge(), self.stations[station]);
        // Level and upright on a wall, along the axes on a floor.
        let across = DVec3::Z.cross(plane.normal).normalize_or(DVec3::X.cross(plane.normal).normalize_or(DVec3::Y));
        let up = plane.normal.cross(across);
        let start = plane.height(from);
        let mut crossed: Vec<Crossed> = Vec::new();
        for (index, sample) in self.of_station(station) {
            let height = plane.height(sample.place);
            let is_on = height.abs() <= MOUNTED * edge;
            if height > MOUNTED * edge {
                continue;
            }
            // Where the sightline meets the plane.
            let share = start / (start - height);
            let at = if is_on { sample.place } else { from + (sample.place - from) * share };
            let at = [at.dot(across), at.dot(up)];
            let does = if is_on {
                let is_parallel = sample.normal.is_some_and(|normal| normal.dot(plane.normal).abs() > PARALLEL);
                if is_parallel { Does::EndOn } else { Does::EndAcross }
            } else if self.fit(sample, plane).is_some_and(|(distance, ..)| distance.abs() < reach) {
                Does::Fit
            } else {
                Does::Other
            };
            crossed.push((index, at, does));
        }
        let width = cell_width(&crossed, 2.0 * edge);
        let cell_of = |at: &[f64; 2]| at.map(|along| (along / width).floor() as i64);
        let mut cells: BTreeMap<[i64; 2], Crossing> = BTreeMap::new();
        for (_, at, does) in &crossed {
            cells.entry(cell_of(at)).or_default().add(*does);
        }
        let is_mirror = |crossing: &Crossing| {
            let behind = crossing.fit + crossing.other;
            crossing.fit >= 2
                && f64::from(crossing.fit) >= LEAST_FIT * f64::from(behind)
                && behind > crossing.on + crossing.across
        };
        let mirror: BTreeSet<[i64; 2]> =
            cells.iter().filter(|(_, crossing)| is_mirror(crossing)).map(|(cell, _)| *cell).collect();
        let parts = connected(&mirror);
        let weight = |part: &&BTreeSet<[i64; 2]>| part.iter().map(|cell| cells[cell].fit).sum::<u32>();
        let largest = parts.iter().max_by_key(weight)?;
        let is_behind = |does: Does| matches!(does, Does::Fit | Does::Other);
        let is_inside = |(_, at, does): &&Crossed| is_behind(*does) && largest.contains(&cell_of(at));
        let inside: Vec<&Crossed> = crossed.iter().filter(is_inside).collect();
        if inside.len() < FEWEST_FITS {
            return None;
        }
        let ends = |axis: usize| {
            let mut values: Vec<f64> = inside.iter().map(|(_, at, _)| at[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
            [at(0.002), at(0.998)]
        };
        let [[left, right], [low, high]] = [ends(0), ends(1)];
        let margin = 0.25 * edge;
        let [half_width, half_height] = [right - left, high - low].map(|size| 0.5 * size + margin);
        let position = across * (0.5 * (left + right)) + up * (0.5 * (low + high)) + plane.normal * plane.offset;
        let mirror = Mirror {
            position,
            rotation: DQuat::from_mat3(&DMat3::from_cols(across, up, plane.normal)),
            ..Mirror::standing(
                Shape::Plane { height: half_height / half_width },
                position,
                plane.normal,
                DVec3::Z,
                half_width,
            )
        };
        Some(Area {
            closed: closed_share(largest, &cells),
            inside: inside.into_iter().map(|(index, ..)| *index).collect(),
            mirror,
            reach: half_width.min(half_height),
        })
    }

    /// The distance from a surface up to which an unfolded point fits it.
    fn near(&self) -> f64 {
        (5.0 * self.map.noise()).max(0.2 * self.map.edge())
    }

    /// The columns that a station sees, as long as all stations see them.
    fn columns(&self, station: usize) -> Vec<Found> {
        let others: Vec<(DVec3, Vec<DVec3>)> = (0..self.stations.len())
            .filter(|other| *other != station)
            .map(|other| (self.stations[other], self.places_of(other).collect()))
            .collect();
        let found = |mut part: Part| {
            others.iter().for_each(|(place, seen)| extend(&mut part, *place, seen, self.map, self.near()));
            let Part { mirror, share, residual, fits, .. } = part;
            let reason = format!(
                "found: {:.0} % of the points between its straight outlines that can say so fit surfaces when unfolded, by \
                 {residual:.4} in the middle",
                share * 100.0
            );
            let place_error = residual * 1.5 / (fits as f64 / 10.0).sqrt();
            // What is seen through a curved pane is not on the straight line.
            let reflector = Reflector { mirror, is_open: false, place_error, angle_error: 0.0 };
            Found { reflector, reason }
        };
        let own = self.of_station(station).map(|(_, sample)| sample).filter(|sample| sample.place.is_finite());
        let own: Vec<&Sample> = own.collect();
        columns(self.stations[station], &own, &self.walls, self.map, self.near()).into_iter().map(found).collect()
    }

    /// The places that a station may have seen and that no mirror explains.
    fn places_of(&self, station: usize) -> impl Iterator<Item = DVec3> {
        self.of_station(station).map(|(_, sample)| sample.place).filter(|place| place.is_finite())
    }

    /// The balls that a station sees. A ball is a mirror if most points within its outline fit when they are unfolded.
    fn balls(&self, station: usize) -> Vec<Found> {
        let near = self.near();
        let points: Vec<DVec3> = self.places_of(station).collect();
        let refined = |(ball, seen): &(Mirror, Vec<Seen>)| {
            let mirror = moved(ball, &some_of(seen), self.map);
            let fits = distances(&mirror, seen, self.map).into_iter().flatten().map(f64::abs);
            let mut fits: Vec<f64> = fits.filter(|distance| *distance < near).collect();
            fits.sort_unstable_by(f64::total_cmp);
            let share = fits.len() as f64 / seen.len() as f64;
            let residual = *fits.get(fits.len() / 2)?;
            (fits.len() >= FEWEST_POINTS && share > LEAST_IN_BALL).then_some((share, residual, fits.len(), mirror))
        };
        let suggested = suggested(self.stations[station], &points, self.map);
        let mut tried: Vec<_> = suggested.par_iter().take(BALLS).filter_map(refined).collect();
        tried.sort_by_key(|(_, _, count, _)| std::cmp::Reverse(*count));
        let mut found: Vec<(Found, usize)> = Vec::new();
        for (share, residual, count, mirror) in tried {
            let is_known = |(known, _): &(Found, usize)| {
                let Mirror { position, size, .. } = known.reflector.mirror;
                position.distance(mirror.position) < size + mirror.size
            };
            if found.iter().any(is_known) {
                continue;
            }
            let reason = format!(
                "found: {:.0} % of the points within its round outline fit surfaces when unfolded, by {residual:.4} in the \
                 middle",
                share * 100.0
            );
            let error = residual * 1.5 / (count as f64 / 10.0).sqrt();
            let is_open = share < OPAQUE;
            let reflector = Reflector { mirror, is_open, place_error: error, angle_error: 0.0 };
            found.push((Found { reflector, reason }, count));
        }
        found.into_iter().map(|(found, _)| found).collect()
    }

    /// The samples that were seen in a mirror.
    fn seen_in(&self, found: &Found) -> Vec<usize> {
        let mirrors = Mirrors::new(vec![found.reflector.clone()]);
        let is_seen = |(_, sample): &(usize, &Sample)| {
            let own = sample.station.map_or(0..self.stations.len(), |station| station..station + 1);
            let is_from = |station: usize| {
                !mirrors.ways(self.stations[station], sample.place, BEHIND * self.map.edge()).is_empty()
            };
            sample.place.is_finite() && own.into_iter().any(is_from)
        };
        self.samples.iter().enumerate().filter(is_seen).map(|(index, _)| index).collect()
    }

    /// Leaves out samples that a mirror explains.
    fn take(&mut self, explained: &[usize]) {
        for index in explained {
            self.samples[*index].place = DVec3::NAN;
            self.samples[*index].normal = None;
        }
    }
}

/// A mirror in a plane.
struct Area {
    mirror: Mirror,
    /// The samples whose sightlines pass through it.
    inside: Vec<usize>,
    /// The share of its border at which sightlines end at the plane.
    closed: f64,
    /// Half its lesser side.
    reach: f64,
}

/// The cells about one.
fn about(cell: [i64; 2], reach: i64) -> impl Iterator<Item = [i64; 2]> {
    (-reach..=reach).flat_map(move |x| (-reach..=reach).map(move |y| [cell[0] + x, cell[1] + y]))
}

/// The width of cells in which enough sightlines fit, so that none is empty by chance: of a sparse scan it is large.
fn cell_width(crossed: &[Crossed], least: f64) -> f64 {
    let mut widths = (0..WIDENED).map(|step| least * 2.0_f64.powf(0.5 * f64::from(step)));
    let is_full = |width: &f64| {
        let mut cells: BTreeMap<[i64; 2], u64> = BTreeMap::new();
        for (_, at, _) in crossed.iter().filter(|(.., does)| matches!(does, Does::Fit)) {
            *cells.entry(at.map(|along| (along / width).floor() as i64)).or_default() += 1;
        }
        // The mean over the sightlines, not over the cells: a few that fit by chance, far apart, say nothing.
        let all = cells.values().sum::<u64>() as f64;
        cells.values().map(|count| count * count).sum::<u64>() as f64 >= FULL * all
    };
    widths.clone().find(is_full).or(widths.next_back()).unwrap_or(least)
}

fn connected(cells: &BTreeSet<[i64; 2]>) -> Vec<BTreeSet<[i64; 2]>> {
    let (mut left, mut parts) = (cells.clone(), Vec::new());
    while let Some(first) = left.pop_first() {
        let (mut part, mut open) = (BTreeSet::from([first]), vec![first]);
        while let Some(cell) = open.pop() {
            for other in about(cell, 1) {
                if left.remove(&other) {
                    part.insert(other);
                    open.push(other);
                }
            }
        }
        parts.push(part);
    }
    parts
}

/// The share of the cells beside a part of a plane at which sightlines end, of those that sightlines meet or pass.
fn closed_share(part: &BTreeSet<[i64; 2]>, cells: &BTreeMap<[i64; 2], Crossing>) -> f64 {
    let border: BTreeSet<[i64; 2]> =
        part.iter().flat_map(|cell| about(*cell, 2)).filter(|cell| !part.contains(cell)).collect();
    let (mut closed, mut open) = (0.0, 0.0);
    for crossing in border.iter().filter_map(|cell| cells.get(cell)) {
        let behind = crossing.fit + crossing.other;
        if crossing.on > behind {
            closed += 1.0;
        } else if behind > crossing.across {
            open += 1.0;
        }
    }
    if closed >= FEWEST_CLOSED { closed / (closed + open) } else { 0.0 }
}
