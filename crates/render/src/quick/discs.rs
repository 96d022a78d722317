//! Splats drawn one after the other as discs, where they are few: a pixel shows all that cover it, as in a picture at rest,
//! and not only those that cells keep.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::levels::{EMPTY, depth_of, key_of};
use super::splat::{Disc, MIRROR, Piece, View, slices};

/// The boxes around splats may have so many pixels in all, each counted for each splat: some 40 ms on two cores. If they
/// have more, splats are put into cells.
const MOST_PIXELS: u64 = 5 << 18;
/// One in so many splats may be an ellipse that is much longer than wide. Discs of more would leave gaps, which cells close.
const FEW: usize = 16;
/// The height in pixels of the bands of the picture that one thread draws at once.
pub const BAND: usize = 16;
/// Of discs in one plane, that with the nearest middle is in front: discs are hollow by this share of their radius.
const RIM: f32 = 0.001;
/// The least weight of a splat in the mean of a pixel that it covers; it is 1 more in its middle.
const LEAST_WEIGHT: f32 = 1.0 / 64.0;

/// A splat and the pixels that it may cover.
pub struct Splat {
    disc: Disc,
    radius: f32,
    identity: u32,
    is_long: bool,
    first: [i32; 2],
    last: [i32; 2],
    /// The pixel that contains its middle, if its line of sight misses the disc: small ones, and those that are seen edge-on,
    /// leave no hole.
    missed: Option<[i32; 2]>,
}

impl Splat {
    /// `None` if it covers no pixel of the picture.
    fn new(piece: &Piece<'_>, index: usize, place: Vec3, view: &View, largest: f32) -> Option<Self> {
        let (middle, scale, pixels) = piece.on_screen(index, place, view);
        let pixels = pixels.min(0.5 * largest);
        let radius = pixels / scale;
        let disc = Disc::new(piece, index, place, radius, view);
        let reach = disc.reach(radius, pixels, view);
        let holds = middle.map(|at| at.floor() as i32);
        let size = view.size.map(|edge| edge as i32);
        let first = [0, 1].map(|axis| ((middle[axis] - reach[axis] - 0.5).ceil() as i32).min(holds[axis]).max(0));
        let last =
            [0, 1].map(|axis| ((middle[axis] + reach[axis] - 0.5).floor() as i32).max(holds[axis]).min(size[axis] - 1));
        if !middle.iter().all(|at| at.is_finite()) || first[0] > last[0] || first[1] > last[1] {
            return None;
        }
        let (depth, square) = disc.meet(view.slope(holds[0] as f32 + 0.5, holds[1] as f32 + 0.5), view);
        let is_missed =
            !(square <= 1.0 && depth > view.near) && (0..2).all(|axis| (0..size[axis]).contains(&holds[axis]));
        let identity = piece.first_identity + index as u32;
        let is_long = piece.is_long(index);
        Some(Self { disc, radius, identity, is_long, first, last, missed: is_missed.then_some(holds) })
    }

    fn pixels(&self) -> u64 {
        (0..2).map(|axis| (self.last[axis] - self.first[axis]) as u64 + 1).product()
    }

    /// Calls `draw` for each pixel in a band of rows that the splat may cover: its place in the band, whether it is
    /// covered, the splat's depth there, and the square of the distance from the splat's middle in radii. Branches that
    /// nobody can foresee would take longer than what they spare.
    #[inline(always)]
    fn cover(&self, top: i32, bottom: i32, view: &View, mut draw: impl FnMut(usize, bool, f32, f32)) {
        let width = view.size[0] as usize;
        for y in self.first[1].max(top)..=self.last[1].min(bottom) {
            let row = (y - top) as usize * width;
            let [_, up] = view.slope(0.0, y as f32 + 0.5);
            for x in (self.first[0]..=self.last[0]).step_by(4) {
                let across = (Vec4::new(0.5, 1.5, 2.5, 3.5) + (x as f32 - view.half[0])) / view.focal;
                let (depth, square) = self.disc.meet_four(across, up, view);
                let is_met = (square.cmple(Vec4::ONE) & depth.cmpgt(Vec4::splat(view.near))).bitmask();
                let (depth, square) = (depth.to_array(), square.to_array());
                for lane in 0..(self.last[0] - x + 1).min(4) as usize {
                    draw(row + x as usize + lane, is_met >> lane & 1 != 0, depth[lane], square[lane]);
                }
            }
        }
        if let Some([x, y]) = self.missed
            && (top..=bottom).contains(&y)
        {
            draw((y - top) as usize * width + x as usize, true, self.disc.center.z, 1.0);
        }
    }
}

/// The splats of all points that are drawn, of a diameter of at most `largest` pixels; none if they cover too many pixels
/// to be drawn one after the other, or if they are no discs.
pub fn splats(pieces: &[Piece<'_>], view: &View, largest: f32) -> Vec<Splat> {
    let of_slice = |(piece, range): (&Piece<'_>, _)| {
        let mut splats = Vec::new();
        piece.each(range, view, |index, place| splats.extend(Splat::new(piece, index, place, view, largest)));
        splats
    };
    let splats: Vec<Splat> = slices(pieces, view).into_par_iter().flat_map_iter(of_slice).collect();
    let pixels: u64 = splats.iter().map(Splat::pixels).sum();
    let long = splats.iter().filter(|splat| splat.is_long).count();
    if pixels > MOST_PIXELS || long * FEW > splats.len() { Vec::new() } else { splats }
}

/// What a pixel shows: the mean of the splats that are no farther behind the nearest one than the depth offset, or that
/// one alone.
#[derive(Clone, Copy)]
pub struct Seen {
    /// The key of the nearest one.
    pub key: u64,
    weight: f32,
    depth: f32,
    /// With the weight of all but mirrors, whose colour is not mixed with that of what they stand on.
    color: Vec4,
}

const NOTHING: Seen = Seen { key: EMPTY, weight: 0.0, depth: 0.0, color: Vec4::ZERO };

impl Seen {
    /// Adds a splat, if it is seen here.
    #[inline(always)]
    fn add(&mut self, is_seen: bool, depth: f32, square: f32, color: Vec4) {
        let weight = if is_seen { LEAST_WEIGHT + 1.0 - square } else { 0.0 };
        self.weight += weight;
        self.depth += if is_seen { weight * depth } else { 0.0 };
        self.color += weight * color;
    }

    /// The depth, which is infinite where nothing is seen, and the colour.
    pub fn mean(&self) -> (f32, [u8; 4]) {
        if self.key == EMPTY {
            return (f32::INFINITY, [0; 4]);
        }
        let color = self.color / self.color.w + 0.5;
        let kind = if self.color.w < 0.5 * self.weight { MIRROR } else { u8::MAX };
        (self.depth / self.weight, [color.x as u8, color.y as u8, color.z as u8, kind])
    }
}

/// Draws bands of rows of the picture side by side: calls `put` with what `rows` has for each, and with its pixels.
pub fn draw<Rows: Send>(
    splats: &[Splat],
    view: &View,
    rows: impl IndexedParallelIterator<Item = Rows>,
    put: impl Fn(Rows, &[Seen]) + Sync,
) {
    let [width, height] = view.size.map(|edge| edge as usize);
    let mut bands = vec![Vec::new(); height.div_ceil(BAND)];
    for splat in splats {
        for band in &mut bands[splat.first[1] as usize / BAND..=splat.last[1] as usize / BAND] {
            band.push(splat);
        }
    }
    rows.zip(bands).enumerate().for_each(|(band, (rows, splats))| {
        let top = band * BAND;
        let bottom = height.min(top + BAND) - 1;
        let mut seen = vec![NOTHING; width * (bottom + 1 - top)];
        let (top, bottom) = (top as i32, bottom as i32);
        let key = |splat: &Splat, depth, square| key_of(depth + RIM * splat.radius * square, splat.identity);
        for splat in &splats {
            splat.cover(top, bottom, view, |place, is_covered, depth, square| {
                let nearest = &mut seen[place].key;
                *nearest = (*nearest).min(if is_covered { key(splat, depth, square) } else { EMPTY });
            });
        }
        for splat in &splats {
            let [red, green, blue, kind] = splat.disc.color;
            let color = Vec4::from([red, green, blue, u8::from(kind != MIRROR)].map(f32::from));
            match view.mixed_behind {
                Some(radii) => splat.cover(top, bottom, view, |place, is_covered, depth, square| {
                    let pixel = &mut seen[place];
                    let is_near = depth <= depth_of(pixel.key) + radii * splat.radius;
                    pixel.add(is_covered & is_near, depth, square, color);
                }),
                None => splat.cover(top, bottom, view, |place, is_covered, depth, square| {
                    let pixel = &mut seen[place];
                    let is_nearest = key(splat, depth, square) == pixel.key;
                    pixel.add(is_covered & is_nearest, depth, square, color);
                }),
            }
        }
        put(rows, &seen);
    });
}
