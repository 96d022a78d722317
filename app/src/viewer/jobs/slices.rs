//! Finds the points of a profile among those that are loaded, and writes profiles to files: on worker threads.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Bounds, Chunk, Cloud, Cover, PointTest};
use glam::DVec3;
use measure::Section;
use rayon::prelude::*;
use render::ColorPlan;
use scene::{CloudSettings, Profile, Settings};
use world::{CloudKey, Part};

use crate::shared::profile_chart::{self, AxisUnits, Dot, Series, colors_of};
use crate::shared::profiles;
use crate::viewer::objects::ObjectId;
use crate::viewer::picture::messages::PickedPoint;

/// The most points of a profile that are kept: 56 MB. Of more, evenly many are left out.
pub const MOST_KEPT: usize = 1_000_000;

/// The most points that are kept of all profiles behind the one in view.
const MOST_BEHIND: usize = 200_000;

/// Work on a profile.
pub enum ProfileWork {
    Cut {
        id: ObjectId,
        profile: Profile,
        /// The profiles whose points are shown behind it.
        others: Vec<Profile>,
        up: DVec3,
        clouds: Vec<Cuttable>,
        test: PointTest,
    },
    /// Writes the chart of the points that were found: those of the profile of this name, and of others behind it.
    Draw {
        path: PathBuf,
        name: String,
        slice: Arc<Slice>,
        others: Arc<Vec<(String, Slice)>>,
        units: AxisUnits,
        /// Whether there are points that are not loaded.
        is_thinned: bool,
    },
    /// Writes the points of the files themselves.
    Write {
        path: PathBuf,
        inputs: Vec<String>,
        /// Where clouds stand.
        own: Vec<CloudSettings>,
        profiles: Vec<Profile>,
        test: PointTest,
        settings: Box<Settings>,
    },
}

/// A cloud whose points may be in a profile.
pub struct Cuttable {
    pub key: CloudKey,
    pub cloud: Cloud,
    pub parts: Vec<(Part, Bounds)>,
    pub plan: ColorPlan,
}

/// The points of a profile.
#[derive(Debug, Default)]
pub struct Slice {
    /// So mixed that any number of the first is an even choice.
    pub points: Vec<SlicePoint>,
    /// How many there are among those that are loaded.
    pub total: u64,
    /// The level length of the line.
    pub length: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlicePoint {
    pub dot: Dot,
    pub point: PickedPoint,
}

/// What came of work on a profile.
pub enum ProfileFound {
    Cut { id: ObjectId, slice: Result<Slice, String>, others: Vec<(String, Slice)> },
    Saved { path: PathBuf, result: Result<Vec<String>, String> },
}

impl ProfileWork {
    pub fn run(self) -> ProfileFound {
        match self {
            Self::Cut { id, profile, others, up, clouds, test } => {
                let slice = cut(&profile, up, &clouds, &test, MOST_KEPT);
                let most = MOST_BEHIND / others.len().max(1);
                let behind = |other: Profile| Some((other.name.clone(), cut(&other, up, &clouds, &test, most).ok()?));
                ProfileFound::Cut { id, slice, others: others.into_iter().filter_map(behind).collect() }
            }
            Self::Draw { path, name, slice, others, units, is_thinned } => {
                let series = |name: &str, slice: &Slice| {
                    let dots = slice.points.iter().map(|point| point.dot).collect();
                    Series { name: name.to_owned(), dots, total: slice.total, is_thinned }
                };
                let behind = others.iter().map(|(name, slice)| series(name, slice));
                let all: Vec<Series> = std::iter::once(series(&name, &slice)).chain(behind).collect();
                let result = profile_chart::write(&path, &all, units);
                let result = result.map(|()| Vec::new());
                ProfileFound::Saved { path, result: result.map_err(|error| format!("{error:#}")) }
            }
            Self::Write { path, inputs, own, profiles, test, settings } => {
                let result = profiles::write(&inputs, own, &profiles, &test, &settings, &path);
                ProfileFound::Saved { path, result: result.map_err(|error| format!("{error:#}")) }
            }
        }
    }
}

/// What is kept of the points that are found, while they come from all threads.
#[derive(Default)]
struct Kept {
    points: Vec<(u32, SlicePoint)>,
    total: u64,
}

impl Kept {
    fn add(&mut self, found: Vec<(u32, SlicePoint)>, most: usize) {
        self.total += found.len() as u64;
        self.points.extend(found);
        if self.points.len() > most * 2 {
            self.shrink(most);
        }
    }

    /// Keeps those with the smallest numbers, which are random: an even choice.
    fn shrink(&mut self, most: usize) {
        if self.points.len() > most {
            self.points.select_nth_unstable_by_key(most, |(number, _)| *number);
            self.points.truncate(most);
        }
    }
}

/// A number that looks random but depends only on a point's place in its cloud.
fn mixed(number: u64) -> u32 {
    let mixed = (number ^ (number >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 32) as u32
}

/// The points of a profile that are loaded and shown, in the colours of the view without light.
fn cut(profile: &Profile, up: DVec3, clouds: &[Cuttable], test: &PointTest, most: usize) -> Result<Slice, String> {
    let section = Section::new(&profile.line, profile.width, up).map_err(|error| error.to_string())?;
    let kept = Mutex::new(Kept::default());
    let narrow = test.within(section.volumes());
    for Cuttable { key, cloud, parts, plan } in clouds {
        let shown = cloud.test(test);
        let of_chunk = |(chunk, (part, bounds)): (&Chunk, &(Part, Bounds))| {
            if narrow.cover(*bounds) == Cover::Outside {
                return;
            }
            let placed = |index: usize| {
                let placed = section.place(cloud.world_position(chunk, index))?;
                shown.shows(chunk, index).then_some((index as u32, placed))
            };
            let (indices, places): (Vec<u32>, Vec<_>) = (0..chunk.len()).filter_map(placed).unzip();
            if indices.is_empty() {
                return;
            }
            let colors = colors_of(cloud, &chunk.select(&indices), plan, up);
            let point = |((index, placed), color): ((u32, measure::Placed), [u8; 3])| {
                let number = chunk.first_point + u64::from(index) + (u64::from(key.0) << 48);
                let dot = Dot { along: placed.along, height: placed.height, color };
                let point = PickedPoint { chunk: key.chunk(*part), index: index as usize };
                (mixed(number), SlicePoint { dot, point })
            };
            let found = indices.into_iter().zip(places).zip(colors).map(point).collect();
            kept.lock().unwrap_or_else(PoisonError::into_inner).add(found, most);
        };
        cloud.chunks.par_iter().zip(parts).for_each(of_chunk);
    }
    let mut kept = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    kept.shrink(most);
    kept.points.sort_unstable_by_key(|(number, _)| *number);
    let points = kept.points.into_iter().map(|(_, point)| point).collect();
    Ok(Slice { points, total: kept.total, length: section.length() })
}

#[cfg(test)]
mod tests {
    use scene::{Color, ColorBy};

    use super::*;

    /// A slope of 1 in 2 along x, of 100 x 100 points at distances of 0.1.
    fn slope(key: u32) -> Cuttable {
        let place =
            |index: usize| [(index % 100) as f32 * 0.1, (index / 100) as f32 * 0.1, (index % 100) as f32 * 0.05];
        let chunk = Chunk::new(0, DVec3::new(5e5, 4e6, 100.0), (0..10_000).map(place).collect());
        let bounds = chunk.bounds();
        let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
        let color = Color { by: ColorBy::Height, low: 0.0, high: 1.0, ..Color::default() };
        let (plan, _) = ColorPlan::new(&cloud, &color, DVec3::Z);
        Cuttable { key: CloudKey(key), cloud, parts: vec![(Part::Block(0), bounds)], plan }
    }

    fn profile(width: f64) -> Profile {
        let corner = |x: f64| DVec3::new(5e5 + x, 4e6 + 5.0, 0.0);
        Profile::new(vec![corner(-1.0), corner(20.0)], width)
    }

    #[test]
    fn the_profile_of_a_slope_is_its_line_in_the_colours_of_the_view() {
        let slice = cut(&profile(0.25), DVec3::Z, &[slope(3)], &PointTest::default(), MOST_KEPT).unwrap();
        // Three rows of a hundred points are within 0.125 of the line.
        assert_eq!((slice.total, slice.points.len(), slice.length), (300, 300, 21.0));
        for SlicePoint { dot, point } in &slice.points {
            assert!((dot.height - (100.0 + (dot.along - 1.0) * 0.5)).abs() < 1e-4, "{dot:?}");
            assert_eq!(point.chunk.cloud, CloudKey(3));
            let expected =
                render::ramp_colors(scene::Ramp::Turbo)[((dot.height - 100.0) / 4.95 * 255.0).round() as usize];
            let difference: i32 = (0..3).map(|c| (i32::from(dot.color[c]) - i32::from(expected[c])).abs()).sum();
            assert!(difference < 12, "{dot:?} {expected:?}");
        }
        let nothing = cut(&profile(0.25), DVec3::Z, &[], &PointTest::default(), MOST_KEPT).unwrap();
        assert_eq!((nothing.total, nothing.points.len()), (0, 0));
        let upright = Profile::new(vec![DVec3::ZERO, DVec3::Z], 1.0);
        let refused = cut(&upright, DVec3::Z, &[slope(0)], &PointTest::default(), MOST_KEPT);
        assert!(refused.unwrap_err().contains("corners 1 and 2"));
    }

    #[test]
    fn of_too_many_points_an_even_choice_is_kept_and_the_same_each_time() {
        let of = || cut(&profile(30.0), DVec3::Z, &[slope(0), slope(1)], &PointTest::default(), 1000).unwrap();
        let slice = of();
        assert_eq!((slice.total, slice.points.len()), (20_000, 1000));
        let left = slice.points.iter().filter(|point| point.dot.along < 6.0).count();
        assert!((430..570).contains(&left), "{left}");
        // A part of them is an even choice, too.
        let left = slice.points[..200].iter().filter(|point| point.dot.along < 6.0).count();
        assert!((70..130).contains(&left), "{left}");
        let places = |slice: &Slice| -> Vec<PickedPoint> { slice.points.iter().map(|point| point.point).collect() };
        assert_eq!(places(&slice), places(&of()));
    }
}
