//! What each pixel shows of the points in the cells of a pyramid.

use glam::Vec3;
use rayon::prelude::*;
use scene::Settings;

use super::discs::{self, Splat};
use super::levels::{EMPTY, IN_FRONT, LEVELS, Levels, NEARER, Sides, depth_of, identity_of};
use super::light::{self, Known, KnownLight, Lit};
use super::splat::{Disc, NO_DISC, Piece, View};
use crate::exposure::Exposure;
use crate::frame::FrameCamera;
use crate::layout::BLOCK_POINTS;

/// The images of a quick picture.
#[derive(Default)]
pub struct Pixels {
    /// The discs of the cells of all levels but the finest.
    discs: Vec<Disc>,
    size: [u32; 2],
    /// The linear depth in world units; infinite where nothing is seen, and in a border of one pixel.
    depth: Vec<f32>,
    /// sRGB red, green, blue and opacity: of the points, and then in light.
    color: Vec<[u8; 4]>,
    /// The key of the nearest splat of each pixel, where splats were drawn one after the other; else empty.
    pub keys: Vec<u64>,
    /// The light on each pixel, as light.rs codes it.
    lights: Vec<[u8; 4]>,
    /// The share of the lit pixels whose light no picture at rest knows.
    pub unlit: f32,
    /// The exposure, if it was fitted.
    pub exposure: Option<Exposure>,
    pub picture: Vec<[u8; 4]>,
}

/// Splats up to this share of the depth behind the nearest one are of the same surface, and their colours are averaged.
const SAME_SURFACE: f32 = 1.01;
/// How far beyond the rim of a splat, in radii, a pixel counts as a gap in its surface, if it is covered by none.
const GAP: f32 = 1.5;
/// How far beyond the rim it does where nothing lies behind.
const WIDE_GAP: f32 = 4.0;

/// The points by their identities.
struct Found<'a> {
    pieces: &'a [Piece<'a>],
    /// The piece of each run of `BLOCK_POINTS` identities.
    owners: Vec<u32>,
}

impl<'a> Found<'a> {
    fn new(pieces: &'a [Piece<'a>]) -> Self {
        let run = |identity: u32| (identity / BLOCK_POINTS) as usize;
        let end = pieces.iter().map(|piece| piece.first_identity as usize + piece.positions.len()).max().unwrap_or(0);
        let mut owners = vec![0; end.div_ceil(BLOCK_POINTS as usize)];
        for (number, piece) in pieces.iter().enumerate() {
            let first = run(piece.first_identity);
            let count = piece.positions.len().div_ceil(BLOCK_POINTS as usize);
            owners[first..first + count].fill(number as u32);
        }
        Self { pieces, owners }
    }

    #[inline(always)]
    fn point(&self, key: u64) -> (&'a Piece<'a>, usize) {
        let identity = identity_of(key);
        let piece = &self.pieces[self.owners[(identity / BLOCK_POINTS) as usize] as usize];
        (piece, (identity - piece.first_identity) as usize)
    }
}

/// What pixels look at.
struct Scene<'a> {
    found: Found<'a>,
    view: &'a View,
    levels: &'a Levels,
    /// The discs of the cells of all levels but the finest.
    discs: &'a [Disc],
}

/// The width of the tiles in which pixels are looked up.
const TILE: usize = 8;
/// The level whose cells are as wide as a tile.
const TILE_LEVEL: usize = 3;

impl Scene<'_> {
    /// Finds the depths and the colours of the pixels of a tile.
    #[inline(always)]
    fn tile(&self, left: usize, top: usize, mut put: impl FnMut(usize, usize, f32, [u8; 4])) {
        let [width, height] = self.view.size.map(|edge| edge as usize);
        let mut whole = (EMPTY, 0);
        for level in (TILE_LEVEL..LEVELS).rev() {
            whole = Levels::nearer(whole, self.levels.key(level, left, top), level);
        }
        let mut around_all = Sides::EMPTY;
        for level in TILE_LEVEL + 1..LEVELS {
            around_all = self.levels.look_around(level, left, top, around_all);
        }
        for (y, x) in (0..TILE).step_by(4).flat_map(|y| [(y, 0), (y, 4)]) {
            let (x, y) = (left + x, top + y);
            if x >= width || y >= height {
                continue;
            }
            let quarter = Levels::nearer(whole, self.levels.key(2, x, y), 2);
            let around_quarter = self.levels.look_around(TILE_LEVEL, x, y, around_all);
            for (y, x) in [(y, x), (y, x + 2), (y + 2, x), (y + 2, x + 2)] {
                if x >= width || y >= height {
                    continue;
                }
                let four = Levels::nearer(quarter, self.levels.key(1, x, y), 1);
                let around = self.levels.look_around(2, x, y, around_quarter).surrounding_depth();
                for (y, x) in [(y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)] {
                    if x < width && y < height {
                        let (key, level) = Levels::nearer(four, self.levels.key(0, x, y), 0);
                        let mut seen = self.pixel(x, y, key, level);
                        // The depth is no number where nothing is around.
                        if around < seen.0 * NEARER {
                            seen = self.before(x, y, seen);
                        }
                        put(x, y, seen.0, seen.1);
                    }
                }
            }
        }
    }

    /// What a pixel shows of splats before what was found at first. Near the border of two levels each has half of the
    /// splats of a surface, and the four cells around the pixel may have none of those that cover it.
    fn before(&self, x: usize, y: usize, mut seen: (f32, [u8; 4])) -> (f32, [u8; 4]) {
        let slope = self.view.slope(x as f32 + 0.5, y as f32 + 0.5);
        for level in 1..LEVELS {
            let nearer = seen.0 * NEARER;
            let [first, width] = self.levels.reaching(level, x, y);
            let covers = |place: usize| {
                let (depth, square) = self.discs[place].meet(slope, self.view);
                square <= 1.0 && depth > self.view.near && depth < nearer
            };
            let mut is_covered = false;
            for row in 0..4 {
                let start = first + row * width;
                for place in start..start + 4 {
                    is_covered |= self.levels.coarse_depth(place) < nearer && covers(place);
                }
            }
            if is_covered {
                let mut places = [first; 16];
                for (number, place) in places.iter_mut().enumerate() {
                    *place += number / 4 * width + number % 4;
                }
                seen = self.blend(places, x, y, 1.0).unwrap_or(seen);
            }
        }
        seen
    }

    /// The depth and the colour of a pixel with this nearest key; an infinite depth where nothing is seen.
    #[inline(always)]
    fn pixel(&self, x: usize, y: usize, key: u64, level: usize) -> (f32, [u8; 4]) {
        if key == EMPTY {
            return (f32::INFINITY, [0; 4]);
        }
        if level == 0 {
            let (piece, index) = self.found.point(key);
            return (depth_of(key), piece.color(index));
        }
        if let Some(seen) = self.blend(self.levels.around(level, x, y), x, y, GAP) {
            return seen;
        }
        let seen = self.behind(x, y, 1 << level);
        if seen.0 < f32::INFINITY {
            return seen;
        }
        // Of a surface that is seen along its plane, a cell keeps the point at its near end.
        self.blend(self.levels.around(level, x, y), x, y, WIDE_GAP).unwrap_or_else(|| {
            let (piece, index) = self.found.point(key);
            (depth_of(key), piece.color(index))
        })
    }

    /// What a pixel shows beside the levels with a bit in `skipped`, whose splats do not cover it.
    fn behind(&self, x: usize, y: usize, mut skipped: u32) -> (f32, [u8; 4]) {
        loop {
            let mut nearest = (EMPTY, 0);
            for level in (0..LEVELS).rev().filter(|level| skipped & (1 << level) == 0) {
                nearest = Levels::nearer(nearest, self.levels.key(level, x, y), level);
            }
            let (key, level) = nearest;
            if level == 0 || key == EMPTY {
                return self.pixel(x, y, key, 0);
            }
            if let Some(seen) = self.blend(self.levels.around(level, x, y), x, y, GAP) {
                return seen;
            }
            skipped |= 1 << level;
        }
    }

    /// The mean of the splats at these places that cover a pixel, or the nearest one if the pixel is at most `gap` radii
    /// from its middle; `None` if there is none.
    #[inline(always)]
    fn blend<const PLACES: usize>(
        &self,
        places: [usize; PLACES],
        x: usize,
        y: usize,
        gap: f32,
    ) -> Option<(f32, [u8; 4])> {
        let slope = self.view.slope(x as f32 + 0.5, y as f32 + 0.5);
        let disc = |place: usize| &self.discs[places[place]];
        let mut met = [(f32::INFINITY, f32::INFINITY); PLACES];
        let mut front = f32::INFINITY;
        let mut nearest = (f32::INFINITY, 0);
        for place in 0..PLACES {
            let (depth, square) = disc(place).meet(slope, self.view);
            // A plane through the eye meets no line of sight. Neither does the disc of an empty cell.
            if !(square < f32::INFINITY && depth > self.view.near) {
                continue;
            }
            met[place] = (depth, square);
            if square < nearest.0 {
                nearest = (square, place);
            }
            if square <= 1.0 {
                front = if depth < front { depth } else { front };
            }
        }
        if front == f32::INFINITY {
            let is_gap = nearest.0 <= gap * gap;
            return is_gap.then(|| (met[nearest.1].0, disc(nearest.1).color));
        }
        let (mut sum, mut weights, mut depths) = (Vec3::ZERO, 0.0, 0.0);
        // A mirror's colour is not mixed with that of what it stands on.
        let kind = disc(nearest.1).color[3];
        for place in 0..PLACES {
            let (depth, square) = met[place];
            let is_alike = disc(place).color[3] == kind;
            if square <= 1.0 && depth <= front * SAME_SURFACE && is_alike {
                let weight = 1.001 - square;
                let [red, green, blue, _] = disc(place).color;
                sum += weight * Vec3::new(f32::from(red), f32::from(green), f32::from(blue));
                weights += weight;
                depths += weight * depth;
            }
        }
        if weights == 0.0 {
            return Some((met[nearest.1].0, disc(nearest.1).color));
        }
        let inverse = 1.0 / weights;
        let color = sum * inverse + 0.5;
        Some((depths * inverse, [color.x as u8, color.y as u8, color.z as u8, kind]))
    }
}

impl Pixels {
    /// Makes room for a picture. Returns its rows, so many together: their depths, with a border, and their colours.
    fn rows(
        &mut self,
        view: &View,
        height: usize,
    ) -> impl IndexedParallelIterator<Item = (&mut [f32], &mut [[u8; 4]])> {
        let [width, all] = view.size.map(|edge| edge as usize);
        let stride = width + 2;
        if self.size != view.size {
            self.size = view.size;
            self.depth = vec![f32::INFINITY; stride * (all + 2)];
        }
        self.color.resize(width * all, [0; 4]);
        let inner = stride..stride * (all + 1);
        self.depth[inner].par_chunks_mut(stride * height).zip(self.color.par_chunks_mut(width * height))
    }

    /// Draws splats one after the other.
    pub fn draw(&mut self, splats: &[Splat], view: &View) {
        let width = view.size[0] as usize;
        let mut keys = std::mem::take(&mut self.keys);
        keys.resize(width * view.size[1] as usize, EMPTY);
        let rows = self.rows(view, discs::BAND).zip(keys.par_chunks_mut(width * discs::BAND));
        discs::draw(splats, view, rows, |((depths, colors), keys), seen| {
            for (place, seen) in seen.iter().enumerate() {
                keys[place] = seen.key;
                (depths[place / width * (width + 2) + place % width + 1], colors[place]) = seen.mean();
            }
        });
        self.keys = keys;
    }

    /// Finds the depth and the colour of each pixel.
    pub fn look_up(&mut self, pieces: &[Piece<'_>], view: &View, levels: &Levels) {
        let width = view.size[0] as usize;
        self.keys.clear();
        let found = Found::new(pieces);
        let coarse = levels.coarse();
        self.discs.resize(coarse.len(), NO_DISC);
        let make = |(disc, key): (&mut Disc, u64)| {
            if key != EMPTY {
                let (piece, index) = found.point(key);
                *disc = Disc::new(piece, index, piece.place(index, view), piece.radius(index) * view.scale, view);
            } else {
                disc.inverse_square = f32::INFINITY;
            }
        };
        self.discs.par_iter_mut().with_min_len(1 << 12).zip(coarse).for_each(make);
        let discs = std::mem::take(&mut self.discs);
        let scene = Scene { found, view, levels, discs: &discs };
        let stride = width + 2;
        self.rows(view, TILE).enumerate().for_each(|(band, (depths, colors))| {
            let top = band * TILE;
            for left in (0..width).step_by(TILE) {
                scene.tile(left, top, |x, y, depth, color| {
                    depths[(y - top) * stride + x + 1] = depth;
                    colors[(y - top) * width + x] = color;
                });
            }
        });
        self.discs = discs;
    }

    /// Makes the picture: closes gaps of single pixels, and draws eye-dome lighting.
    /// `coarseness` is the width of its pixels on the screen: wide lines are drawn weaker.
    pub fn shade(&mut self, view: &View, frame: &FrameCamera, settings: &Settings, known: Known<'_>, coarseness: f32) {
        let width = view.size[0] as usize;
        let pixels = width * view.size[1] as usize;
        self.picture.resize(pixels, [0; 4]);
        (self.unlit, self.exposure) = (0.0, None);
        // The stops that the picture is brightened by.
        let mut stops = known.coarse.map_or(0.0, KnownLight::stops);
        if let Some(light) = known.light {
            let parameter = settings.tone.exposure;
            let coded = known.adaptation.map_or(light.stops(), |adaptation| adaptation.before + parameter);
            let images = (&self.depth[..], &self.color[..]);
            self.unlit = light::spread((light, known, coded), frame, view.size, images, &mut self.lights);
            let mut lit = Lit::new(light);
            self.exposure = known.adaptation.map(|adaptation| {
                let fitting = lit.fitting((&self.color, &self.lights), width, coded);
                adaptation.go_to(fitting.unwrap_or(adaptation.before), parameter)
            });
            stops = self.exposure.map_or(coded, |exposure| exposure.stops);
            lit.brighten(stops - coded);
            let color = |(color, of_pixel): (&mut [u8; 4], &[u8; 4])| {
                if of_pixel[3] != light::NEEDS_NONE {
                    *color = lit.color(*color, *of_pixel);
                }
            };
            self.color.par_iter_mut().with_min_len(1 << 13).zip(&self.lights).for_each(color);
        }
        light::stand_in(view, &self.depth, &mut self.color);
        if let Some(coarse) = known.coarse {
            light::reflect((coarse, stops), frame, view, &self.depth, &mut self.color);
        }
        let background = settings.view.background.bytes();
        let (depth, color) = (&self.depth, &self.color);
        // At strength 0.4 a step of one percent of the depth on one side darkens by about a fifth (present.wgsl). sRGB
        // is a power of linear light, but for an offset and the dark end.
        let strength = OF_STILL / coarseness * 300.0 * settings.edl.strength / 8.0 * std::f32::consts::LOG2_E / GAMMA;
        let row = |(y, picture): (usize, &mut [[u8; 4]])| {
            // Rows of depths have a pixel more at both ends, and there is a row more above and below.
            let stride = width + 2;
            let [above, here, below] = [y, y + 1, y + 2].map(|row| &depth[row * stride..(row + 1) * stride]);
            let (mut lights, mut counts) = (vec![0.0; width], vec![0; width]);
            steps(view, strength, [above, here, below], &mut lights, &mut counts);
            for x in 0..width {
                picture[x] = if counts[x] >= ENOUGH {
                    mean_of_nearer(depth, color, y * width + x, (y + 1) * stride + x + 1, width)
                } else if here[x + 1] == f32::INFINITY {
                    background
                } else {
                    let [red, green, blue, _] = color[y * width + x];
                    let light = lights[x];
                    let lit = |part: u8| ((f32::from(part) + OFFSET) * light - OFFSET).max(0.0) as u8;
                    [lit(red), lit(green), lit(blue), u8::MAX]
                };
            }
        };
        self.picture.par_chunks_mut(width).with_min_len(8).enumerate().for_each(row);
    }

    /// Whether a pixel of a picture with this width shows a splat whose middle is at a depth.
    pub fn shows(&self, width: u32, [x, y]: [u32; 2], depth: f32) -> bool {
        let shown = self.depth[(y as usize + 1) * (width as usize + 2) + x as usize + 1];
        (shown / depth - 1.0).abs() < ALONG_PLANE
    }
}

/// sRGB above its dark end: (1 + offset) times a power of linear light, less the offset, in steps of 1/255.
const GAMMA: f32 = 2.4;
const OFFSET: f32 = 0.055 * 255.0;
/// How far a splat that is seen along its plane reaches before and behind its middle, as a share of the depth.
const ALONG_PLANE: f32 = 0.3;
/// The strength of eye-dome lighting over that in a picture at rest, which has smoother depths: the means of many points.
const OF_STILL: f32 = 0.8;
/// So many of the eight neighbours in front make a pixel a gap in their surface.
const ENOUGH: u32 = 5;

/// Computes the eye-dome lighting of a row of pixels, and how many of the neighbours of each are in front of it. The depths
/// are those of the rows above, of the pixels, and below, a pixel wider at both ends.
fn steps(view: &View, strength: f32, depths: [&[f32]; 3], lights: &mut [f32], counts: &mut [u32]) {
    let count = lights.len();
    let [above, here, below] = depths.map(|row| &row[..count + 2]);
    let counts = &mut counts[..count];
    let greater = |a: f32, b: f32| if a > b { a } else { b };
    // Steps below the depth that a pixel covers at 45 degrees are noise of single points.
    let ignored = 1.0 / view.focal;
    let parallel = if view.orthographic { 1.0 / view.reference_depth } else { 0.0 };
    for x in 0..count {
        let own = here[x + 1];
        let unit = if parallel > 0.0 { parallel } else { 1.0 / own };
        let nearer = own * IN_FRONT;
        let mut sum = 0.0;
        let mut in_front = 0;
        for [first, second] in
            [[above[x], below[x + 2]], [above[x + 1], below[x + 1]], [above[x + 2], below[x]], [here[x], here[x + 2]]]
        {
            in_front += u32::from(first < nearer) + u32::from(second < nearer);
            let (first, second) = ((own - first) * unit, (own - second) * unit);
            // What rises on one side as it falls on the other is a plane.
            sum += greater(first - ignored - greater(-second, 0.0), 0.0);
            sum += greater(second - ignored - greater(-first, 0.0), 0.0);
        }
        counts[x] = in_front;
        // The logarithm of 1 + x, in units of x, for steps that are short of the background's.
        let dark = strength * sum / (1.0 + 0.5 * sum);
        // The exponential function.
        lights[x] = 1.0 / (1.0 + dark * (1.0 + dark * (0.5 + dark * (1.0 / 6.0 + dark * (1.0 / 24.0)))));
    }
}

/// The mean colour of the neighbours in front of a pixel at these places in the images.
fn mean_of_nearer(depth: &[f32], color: &[[u8; 4]], place: usize, padded: usize, width: usize) -> [u8; 4] {
    let nearer = depth[padded] * IN_FRONT;
    let (mut sum, mut count) = ([0u32; 3], 0);
    for (down, along) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)] {
        // Pixels beyond the border are infinitely far.
        if depth[padded + down * (width + 2) + along - (width + 3)] < nearer {
            let [red, green, blue, _] = color[place + down * width + along - (width + 1)].map(u32::from);
            sum = [sum[0] + red, sum[1] + green, sum[2] + blue];
            count += 1;
        }
    }
    let [red, green, blue] = sum.map(|sum| (sum / count.max(1)) as u8);
    [red, green, blue, u8::MAX]
}
