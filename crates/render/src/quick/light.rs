//! The light of a picture at rest, as quick pictures of other views take it over.

use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::earlier::EarlierLight;
use super::splat::{MIRROR, View};
use crate::exposure::{self, Adaptation};
use crate::frame::FrameCamera;
use crate::layout::EXPOSURE_BINS;

/// What a picture at rest knows of the light on the surfaces that it shows, and of what its mirrors show.
pub struct KnownLight {
    pub(super) seen: Arc<SeenLight>,
    /// How far behind a mirror the image of what it shows stands, along the line of sight; empty without mirrors.
    behind: Vec<f32>,
    /// The picture in sRGB, without eye-dome lighting.
    shown: Vec<[u8; 4]>,
    curve: Box<[u8; CURVE]>,
}

/// The light on the surfaces that a picture at rest shows.
pub(super) struct SeenLight {
    pub camera: FrameCamera,
    pub size: [usize; 2],
    /// The linear depth in world units; 0 where nothing is seen.
    pub depth: Vec<f32>,
    /// The light that leaves each surface over its albedo, coded by `code`. The fourth byte says whether it is known, and
    /// whether the pixel is a mirror's; of a mirror, the first one is its specular intensity.
    pub light: Vec<[u8; 4]>,
    /// How much the light is brightened.
    stops: f32,
}

/// What quick pictures take over from pictures of the renderer.
#[derive(Clone, Copy, Default)]
pub struct Known<'a> {
    /// The light on the points; without it they show their own colours.
    pub light: Option<&'a KnownLight>,
    /// The light on points of which `light` knows none.
    pub earlier: Option<&'a EarlierLight>,
    /// A coarser picture of a view that may be nearer to this one: the light on points of which the others know none, and
    /// what mirrors show.
    pub coarse: Option<&'a KnownLight>,
    /// How the exposure follows that of the picture before; `None` where it is that of `light`.
    pub adaptation: Option<Adaptation>,
}

/// The images of a picture at rest: rows of linear values.
pub(crate) struct StillImages {
    pub depth: Vec<f32>,
    /// Four values a pixel: albedo, specular intensity.
    pub albedo: Vec<f32>,
    /// Four values a pixel.
    pub color: Vec<f32>,
    pub mirrors: Option<StillMirrors>,
}

/// What the pixels of mirrors show: four values a pixel.
pub(crate) struct StillMirrors {
    /// The normals of all surfaces, in world axes.
    pub normal: Vec<f32>,
    /// The places that mirrors show, relative to the eye; the fourth value is 0 where they show none.
    pub seen: Vec<f32>,
    /// The index of refraction, one value a pixel: not 0 where light goes through; empty if it goes through nothing.
    pub refraction: Vec<f32>,
}

/// The light that the code 255 stands for, as a multiple of what makes a white surface white without a curve.
const MOST: f32 = 16.0;
/// Albedos below this do not show how much light falls on them.
const LEAST_ALBEDO: f32 = 0.004;
/// Colours in sRGB up to this have such albedos.
const DARK: u8 = 13;
/// The entries of the table of screen colours.
const CURVE: usize = 4096;
/// The linear light in the middle of that table.
const MIDDLE: f32 = 0.25;
/// Depths that differ by this share or less are of the surface whose light is known.
const SAME_SURFACE: f32 = 0.03;
/// The distance of what mirrors show where they show no point, in world units.
const FAR: f32 = 1e6;
/// The curvature of mirrors is that between pixels which are apart by the width of the picture over this.
const CURVATURE_STEPS: usize = 100;
/// The pixels from one to those around it that say how its surface lies.
const SIDE_STEP: usize = 2;
/// How often the place of an image behind a mirror is looked for.
const LOOKS: usize = 4;
/// The width in pixels of the tiles whose mean light stands for what is not known in them.
const TILE: usize = 16;

/// A tile has light if that of one pixel in so many, of those that need it, is known.
const LEAST_KNOWN: u64 = 8;
/// The most pictures before the last one in which a pixel is looked for.
const MOST_LOOKED_UP: usize = 4;

/// The fourth bytes of what is known of a pixel.
const NOTHING: u8 = 0;
pub const LIGHT: u8 = 1;
const REFLECTION: u8 = 2;
/// The fourth byte of the light of pixels of a view that need none: they show a mirror, or nothing.
pub const NEEDS_NONE: u8 = 3;

fn code(light: f32) -> u8 {
    // Eyes tell apart shares of dark light, not its amounts.
    ((light / MOST).clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8
}

impl KnownLight {
    /// `stops` brighten the picture before the curve.
    pub(crate) fn new(camera: FrameCamera, images: StillImages, stops: f32, is_filmic: bool) -> Self {
        let StillImages { depth, albedo, color, mirrors } = images;
        let exposed = stops.exp2();
        let screen = |entry: usize| {
            let share = (entry as f32 + 0.5) / CURVE as f32;
            let mut shown = MIDDLE * share / (1.0 - share);
            if is_filmic {
                // The curve of shaders/shared/tone.wgsl.
                shown = shown * (2.51 * shown + 0.03) / (shown * (2.43 * shown + 0.59) + 0.14);
            }
            let shown = shown.clamp(0.0, 1.0);
            let srgb = if shown <= 0.003_130_8 { shown * 12.92 } else { 1.055 * shown.powf(1.0 / 2.4) - 0.055 };
            (srgb * 255.0 + 0.5) as u8
        };
        let curve: Box<[u8; CURVE]> = Box::new(std::array::from_fn(screen));
        let of_pixel = |(albedo, color): (&[f32], &[f32])| {
            // What a mirror shows is no light on it.
            if albedo[3] > 0.0 {
                return [(albedo[3].min(1.0) * 255.0) as u8, 0, 0, REFLECTION];
            }
            if albedo[..3].iter().all(|part| *part < LEAST_ALBEDO) {
                return [0, 0, 0, NOTHING];
            }
            let [red, green, blue] = [0, 1, 2].map(|part| code(color[part] * exposed / albedo[part].max(LEAST_ALBEDO)));
            [red, green, blue, LIGHT]
        };
        let light: Vec<_> = albedo.par_chunks_exact(4).zip(color.par_chunks_exact(4)).map(of_pixel).collect();
        let behind = mirrors.map_or_else(Vec::new, |mirrors| behind_mirrors(&camera, &depth, &light, &mirrors));
        let screen = |color: &[f32]| {
            let [red, green, blue] = [0, 1, 2].map(|part| on_screen(&curve, (color[part] * exposed).max(0.0)));
            [red, green, blue, REFLECTION]
        };
        let shown = color.par_chunks_exact(4).map(screen).collect();
        let size = camera.size.map(|edge| edge as usize);
        Self { seen: Arc::new(SeenLight { camera, size, depth, light, stops }), behind, shown, curve }
    }
}

impl KnownLight {
    /// The stops that the picture was brightened by.
    pub(super) fn stops(&self) -> f32 {
        self.seen.stops
    }

    /// What each part of a colour on the screen is where the picture is brightened by `stops`.
    pub(super) fn exposed(&self, stops: f32) -> [u8; 256] {
        let factor = (stops - self.seen.stops).exp2();
        let mut entry = 0;
        std::array::from_fn(|part| {
            if factor == 1.0 {
                return part as u8;
            }
            let first = entry;
            while entry + 1 < CURVE && usize::from(self.curve[entry]) <= part {
                entry += 1;
            }
            // The middle of those with this colour; white may be brighter by any amount.
            let middle = if part == 255 { first } else { (first + entry) / 2 };
            let share = (middle as f32 + 0.5) / CURVE as f32;
            on_screen(&self.curve, MIDDLE * share / (1.0 - share) * factor)
        })
    }
}

impl SeenLight {
    /// Whether two pixels are of the same mirror, as far as that is known.
    #[inline(always)]
    fn is_same_mirror(&self, one: usize, other: usize) -> bool {
        self.light[one] == self.light[other] && self.light[one][3] == REFLECTION
    }

    /// The light at a place of the picture, in pixels, if it shows a surface of this depth; and the pixel's index.
    #[inline(always)]
    fn light_at(&self, (x, y, depth): (f32, f32, f32)) -> Option<(usize, [u8; 4])> {
        let at = y as usize * self.size[0] + x as usize;
        let is_same = (self.depth[at] - depth).abs() <= SAME_SURFACE * depth;
        Some((at, self.light[at])).filter(|(_, light)| is_same && light[3] == LIGHT)
    }

    /// The normals of the surfaces, toward the eye, in axes of the view, of no certain length; zero where they are not known.
    /// Each follows from the depths of the pixels around.
    pub fn normals(&self) -> Vec<[i8; 4]> {
        let [width, height] = self.size;
        let sight = Sight::new(&self.camera);
        let place = |x: usize, y: usize| {
            let depth = self.depth[y * width + x];
            (depth > 0.0).then(|| sight.place((x as f32 + 0.5, y as f32 + 0.5, depth)))
        };
        let around = |at: usize, edge: usize| [at.saturating_sub(SIDE_STEP), (at + SIDE_STEP).min(edge - 1)];
        let of_pixel = |x: usize, y: usize| {
            let ([left, right], [above, below]) = (around(x, width), around(y, height));
            let across = place(right, y)? - place(left, y)?;
            let normal = across.cross(place(x, below)? - place(x, above)?).normalize_or_zero();
            let toward = if sight.is_parallel { -Vec3::Z } else { -place(x, y)? };
            let [x, y, z] = (normal * 127.0 * normal.dot(toward).signum()).to_array().map(|part| part as i8);
            Some([x, y, z, 0])
        };
        let rows = (0..height).into_par_iter();
        rows.flat_map_iter(|y| (0..width).map(move |x| of_pixel(x, y).unwrap_or([0; 4]))).collect()
    }

    /// By how much codes of this light grow where a picture that is brightened by `stops` takes them over: codes are roots of
    /// light that is brightened as its picture was.
    fn gain(&self, stops: f32) -> f32 {
        ((stops - self.stops) * 0.5).exp2()
    }
}

/// For each pixel of a mirror, how far behind it along the line of sight the image of what it shows stands: as far as that
/// is before it if the mirror is a plane, and nearer the more it is curved, by the equation of spherical mirrors. What is
/// seen through clear mirrors outweighs what they reflect, and sticks to them.
fn behind_mirrors(camera: &FrameCamera, depth: &[f32], light: &[[u8; 4]], mirrors: &StillMirrors) -> Vec<f32> {
    let [width, height] = camera.size.map(|edge| edge as usize);
    // Normals that are nearer together tell the curvature less well.
    let step = (width / CURVATURE_STEPS).max(1);
    let three = |image: &[f32], pixel: usize| Vec3::new(image[pixel * 4], image[pixel * 4 + 1], image[pixel * 4 + 2]);
    let place = |pixel: usize| {
        let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        (camera.world_from_pixel(x, y, f64::from(depth[pixel])) - camera.eye).as_vec3()
    };
    let of_pixel = |pixel: usize| {
        let is_clear = mirrors.refraction.get(pixel).is_some_and(|index| *index != 0.0);
        if light[pixel][3] != REFLECTION || is_clear {
            return 0.0;
        }
        let (x, y, here) = (pixel % width, pixel / width, place(pixel));
        let (mut curvature, mut count) = (0.0, 0.0);
        let beside = [
            (x >= step).then(|| pixel - step),
            (x + step < width).then(|| pixel + step),
            (y >= step).then(|| pixel - step * width),
            (y + step < height).then(|| pixel + step * width),
        ];
        for other in beside.into_iter().flatten().filter(|other| light[*other] == light[pixel]) {
            let turned = three(&mirrors.normal, other) - three(&mirrors.normal, pixel);
            curvature += turned.length() / (place(other) - here).length().max(f32::MIN_POSITIVE);
            count += 1.0;
        }
        if count == 0.0 {
            return 0.0;
        }
        let shown = if mirrors.seen[pixel * 4 + 3] > 0.0 { (three(&mirrors.seen, pixel) - here).length() } else { FAR };
        1.0 / (1.0 / shown.clamp(f32::MIN_POSITIVE, FAR) + 2.0 * curvature / count)
    };
    (0..depth.len()).into_par_iter().map(of_pixel).collect()
}

/// The colour of linear light on the screen.
#[inline(always)]
fn on_screen(curve: &[u8; CURVE], light: f32) -> u8 {
    curve[(((light / (light + MIDDLE)) * CURVE as f32) as usize).min(CURVE - 1)]
}

/// The colour on the screen of albedos in light.
pub struct Lit<'a> {
    curve: &'a [u8; CURVE],
    linear: [f32; 256],
    /// The light that each code stands for.
    lights: [f32; 256],
}

/// One pixel in so many along each side counts for the exposure.
const COUNTED: usize = 4;

impl<'a> Lit<'a> {
    pub fn new(known: &'a KnownLight) -> Self {
        let linear = |srgb: f32| if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) };
        Self {
            curve: &known.curve,
            linear: std::array::from_fn(|code| linear(code as f32 / 255.0)),
            lights: std::array::from_fn(|code| (code as f32 / 255.0).powi(2) * MOST),
        }
    }

    /// Brightens all light by so many stops more.
    pub fn brighten(&mut self, stops: f32) {
        self.lights.iter_mut().for_each(|light| *light *= stops.exp2());
    }

    /// The stops that fit a picture of this width, by the rules of exposure.rs, if its lights are brightened by `coded`;
    /// `None` where nothing is lit. Mirrors do not count.
    pub fn fitting(&self, (albedo, lights): (&[[u8; 4]], &[[u8; 4]]), width: usize, coded: f32) -> Option<f32> {
        let mut histogram = [0; EXPOSURE_BINS as usize];
        let rows = albedo.chunks(width).zip(lights.chunks(width)).step_by(COUNTED);
        for (albedo, light) in rows.flat_map(|(albedo, lights)| albedo.iter().zip(lights).step_by(COUNTED)) {
            if light[3] != NEEDS_NONE {
                let part = |part: usize| self.linear[usize::from(albedo[part])] * self.lights[usize::from(light[part])];
                let luminance = 0.2126 * part(0) + 0.7152 * part(1) + 0.0722 * part(2);
                exposure::bin_of(luminance * (-coded).exp2()).into_iter().for_each(|bin| histogram[bin] += 1);
            }
        }
        histogram.iter().any(|count| *count > 0).then(|| exposure::stops_of(&histogram) as f32)
    }

    /// The colour of a surface with an albedo in sRGB and a coded light.
    pub fn color(&self, albedo: [u8; 4], light: [u8; 4]) -> [u8; 4] {
        let part = |part: usize| {
            on_screen(self.curve, self.linear[usize::from(albedo[part])] * self.lights[usize::from(light[part])])
        };
        [part(0), part(1), part(2), u8::MAX]
    }
}

/// The lines of sight of a view.
#[derive(Clone, Copy)]
struct Sight {
    half: [f32; 2],
    focal: f32,
    is_parallel: bool,
}

impl Sight {
    fn new(camera: &FrameCamera) -> Self {
        let half = camera.size.map(|edge| edge as f32 * 0.5);
        Self { half, focal: camera.focal_pixels as f32, is_parallel: camera.orthographic }
    }

    /// How far right and up the line of sight through a place of the picture, in pixels, goes while it goes forward by one;
    /// in a parallel projection, where it begins.
    #[inline(always)]
    fn slope(&self, x: f32, y: f32) -> [f32; 2] {
        [(x - self.half[0]) / self.focal, (self.half[1] - y) / self.focal]
    }

    /// What a place of the picture shows at a depth, in axes of the view.
    #[inline(always)]
    fn place(&self, (x, y, depth): (f32, f32, f32)) -> Vec3 {
        let [right, up] = self.slope(x, y);
        let across = if self.is_parallel { 1.0 } else { depth };
        Vec3::new(right * across, up * across, depth)
    }

    /// The place of the picture that shows a place before the eye, in axes of the view.
    #[inline(always)]
    fn pixel(&self, place: Vec3) -> (f32, f32) {
        let scale = self.focal / if self.is_parallel { 1.0 } else { place.z };
        (self.half[0] + place.x * scale, self.half[1] - place.y * scale)
    }
}

/// A view and that of the picture before it.
pub(super) struct Before<'a> {
    known: &'a SeenLight,
    /// Of the view, and of the picture before it.
    sight: Sight,
    seen: Sight,
    turn: Mat3,
    offset: Vec3,
}

impl<'a> Before<'a> {
    pub fn new(known: &'a SeenLight, frame: &FrameCamera) -> Self {
        let before = &known.camera;
        let turn: DMat3 = before.view_from_world * frame.view_from_world.transpose();
        let offset: DVec3 = before.view_from_world * (frame.eye - before.eye);
        let [sight, seen] = [frame, before].map(Sight::new);
        Self { known, sight, seen, turn: turn.as_mat3(), offset: offset.as_vec3() }
    }

    /// Where in the picture before it is what a pixel shows at a depth: its place in pixels, and its depth there.
    #[inline(always)]
    pub fn place(&self, x: usize, y: usize, depth: f32) -> Option<(f32, f32, f32)> {
        let place = self.turn * self.sight.place((x as f32 + 0.5, y as f32 + 0.5, depth)) + self.offset;
        let (x, y) = self.seen.pixel(place);
        let [width, height] = self.known.size;
        (place.z > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32).then_some((x, y, place.z))
    }

    /// Where in the picture before a mirror showed the image that a pixel of it shows. The image stands `behind` the mirror,
    /// so it moves across it as the eye moves. `at` is where the pixel's place on the mirror is there.
    #[inline(always)]
    fn place_of_image(&self, behind: &[f32], (x, y, depth): (usize, usize, f32), at: (f32, f32)) -> (f32, f32) {
        let texel = |(x, y): (f32, f32)| y as usize * self.known.size[0] + x as usize;
        let own = texel(at);
        if behind.is_empty() || self.known.light[own][3] != REFLECTION {
            return at;
        }
        let slope = self.sight.slope(x as f32 + 0.5, y as f32 + 0.5);
        let along = if self.sight.is_parallel { 1.0 } else { (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt() };
        let (mut found, mut farthest, mut distance) = (at, 0.0, behind[own]);
        for _ in 0..LOOKS {
            // Where the mirror did not reach as far, what was at the same place of it stands in.
            let Some((x, y, _)) = self.place(x, y, depth + distance / along) else { break };
            let seen = texel((x, y));
            if !self.known.is_same_mirror(own, seen) {
                break;
            }
            let next = behind[seen];
            // Images of one surface differ by little.
            if (next - distance).abs() <= SAME_SURFACE * distance {
                return (x, y);
            }
            // What was hidden in the picture before is behind what hid it.
            if next > farthest {
                (found, farthest) = ((x, y), next);
            }
            distance = next;
        }
        found
    }

    /// The light of what a pixel shows at a depth, if the picture before knows it.
    #[inline(always)]
    pub fn light(&self, x: usize, y: usize, depth: f32) -> Option<[u8; 4]> {
        self.known.light_at(self.place(x, y, depth)?).map(|(_, light)| light)
    }

    /// The same, if both eyes are on one side of the surface: its other side has other light. `normals` are those of the
    /// picture before, see `SeenLight::normals`.
    #[inline(always)]
    pub fn light_of_side(&self, normals: &[[i8; 4]], x: usize, y: usize, depth: f32) -> Option<[u8; 4]> {
        let place = self.place(x, y, depth)?;
        let (at, light) = self.known.light_at(place)?;
        let toward = match self.sight.is_parallel {
            true => -(self.turn * Vec3::Z),
            false => self.offset - self.seen.place(place),
        };
        let [x, y, z, _] = normals[at].map(f32::from);
        (Vec3::new(x, y, z).dot(toward) > 0.0).then_some(light)
    }
}

/// Gives the pixels of mirrors the mean colour of all others, for as long as nobody knows what they show.
pub fn stand_in(view: &View, depth: &[f32], color: &mut [[u8; 4]]) {
    let width = view.size[0] as usize;
    let of_row = |(y, color): (usize, &[[u8; 4]])| {
        let depths = &depth[(y + 1) * (width + 2) + 1..];
        color.iter().zip(depths).filter(|(_, depth)| **depth != f32::INFINITY).fold([0_u64; 5], |sum, (color, _)| {
            let [red, green, blue, kind] = *color;
            match kind {
                MIRROR => [sum[0], sum[1], sum[2], sum[3], sum[4] + 1],
                _ => [sum[0] + u64::from(red), sum[1] + u64::from(green), sum[2] + u64::from(blue), sum[3] + 1, sum[4]],
            }
        })
    };
    let rows = color.par_chunks(width).with_min_len(8).enumerate().map(of_row);
    let [red, green, blue, others, mirrors] =
        rows.reduce(|| [0; 5], |a, b| std::array::from_fn(|part| a[part] + b[part]));
    if mirrors > 0 && others > 0 {
        let [red, green, blue] = [red, green, blue].map(|sum| (sum / others) as u8);
        color.par_iter_mut().with_min_len(1 << 13).filter(|color| color[3] == MIRROR).for_each(|color| {
            *color = [red, green, blue, MIRROR];
        });
    }
}

/// Gives the pixels of mirrors what they show, as far as it is known, brightened by `stops`.
pub fn reflect(
    (known, stops): (&KnownLight, f32),
    frame: &FrameCamera,
    view: &View,
    depth: &[f32],
    color: &mut [[u8; 4]],
) {
    let exposed = known.exposed(stops);
    let width = view.size[0] as usize;
    let stride = width + 2;
    let seen = &*known.seen;
    let before = Before::new(seen, frame);
    let [last_x, last_y] = seen.size.map(|edge| edge - 1);
    let row = |(y, color): (usize, &mut [[u8; 4]])| {
        let depths = &depth[(y + 1) * stride + 1..(y + 2) * stride - 1];
        for (x, (color, depth)) in color.iter_mut().zip(depths).enumerate() {
            if color[3] != MIRROR || *depth == f32::INFINITY {
                continue;
            }
            let Some((at_x, at_y, _)) = before.place(x, y, *depth) else { continue };
            let (at_x, at_y) = before.place_of_image(&known.behind, (x, y, *depth), (at_x, at_y));
            let (at_x, at_y) = (at_x - 0.5, at_y - 0.5);
            let (left, top) = (at_x.floor(), at_y.floor());
            let at = |x: f32, y: f32| {
                y.clamp(0.0, last_y as f32) as usize * seen.size[0] + x.clamp(0.0, last_x as f32) as usize
            };
            let shown = |texel: usize| {
                let [red, green, blue, _] = known.shown[texel].map(|part| exposed[usize::from(part)]);
                Vec3::new(f32::from(red), f32::from(green), f32::from(blue))
            };
            let square = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| at(left + x, top + y));
            if square.iter().all(|texel| seen.light[*texel][3] == REFLECTION) {
                let [a, b, c, d] = square.map(shown);
                let (along, down) = (at_x - left, at_y - top);
                let mean = a.lerp(b, along).lerp(c.lerp(d, along), down) + 0.5;
                *color = [mean.x as u8, mean.y as u8, mean.z as u8, MIRROR];
                continue;
            }
            // The picture before may be a coarse one: its pixels are mixed, and it may have lost the border of a mirror.
            let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
            for (x, y) in (0..4).flat_map(|y| (0..4).map(move |x| (left + x as f32 - 1.0, top + y as f32 - 1.0))) {
                let texel = at(x, y);
                // Beside a mirror, what stands before it there is better than nothing.
                let share = if seen.light[texel][3] == REFLECTION { 1.0 } else { 1e-6 };
                let weight = share * (1.0 - (x - at_x).abs()).max(1e-3) * (1.0 - (y - at_y).abs()).max(1e-3);
                sum += weight * shown(texel);
                weights += weight;
            }
            let mean = sum / weights + 0.5;
            *color = [mean.x as u8, mean.y as u8, mean.z as u8, MIRROR];
        }
    };
    color.par_chunks_mut(width).with_min_len(8).enumerate().for_each(row);
}

/// Finds the coded light of each pixel of a view with these colours: what `known.light` knows of it, or else what the pictures
/// before that knew, or else what `known.coarse` knows. `depth` has a border of one pixel; depths are infinite where nothing
/// is seen. Light that is not known is that around it. Mirrors get none. All light is brightened by `stops`. Returns the share
/// of the pixels that need light and lie in tiles of which pictures at rest know nearly none.
pub fn spread(
    (light, known, stops): (&KnownLight, Known<'_>, f32),
    frame: &FrameCamera,
    size: [u32; 2],
    (depth, color): (&[f32], &[[u8; 4]]),
    lights: &mut Vec<[u8; 4]>,
) -> f32 {
    let [width, height] = size.map(|edge| edge as usize);
    let stride = width + 2;
    lights.resize(width * height, [0; 4]);
    let coarse = known.coarse.filter(|coarse| !std::ptr::eq(*coarse, light));
    let shown_as = |gain: f32, [red, green, blue, kind]: [u8; 4]| {
        let [red, green, blue] = [red, green, blue].map(|code| (f32::from(code) * gain + 0.5) as u8);
        [red, green, blue, kind]
    };
    let other = |seen| (Before::new(seen, frame), SeenLight::gain(seen, stops));
    let (before, gain) = other(&*light.seen);
    let coarse = coarse.map(|coarse| other(&*coarse.seen));
    // Each picture before is looked up where all others know nothing, so only those are that know most of what others do not:
    // the rest show other places.
    let tiles = (0..height).step_by(TILE).flat_map(|y| (0..width).step_by(TILE).map(move |x| (x, y)));
    let sampled = tiles.map(|(x, y)| (x, y, depth[(y + 1) * stride + 1 + x]));
    let sampled: Vec<_> = sampled.filter(|(x, y, depth)| before.light(*x, *y, *depth).is_none()).collect();
    let known_of = |view: &Before<'_>, normals: &[[i8; 4]]| -> Vec<bool> {
        sampled.iter().map(|(x, y, depth)| view.light_of_side(normals, *x, *y, *depth).is_some()).collect()
    };
    let views = known.earlier.into_iter().flat_map(EarlierLight::views).map(|(seen, normals)| (other(seen), normals));
    let mut views: Vec<_> =
        views.map(|((view, gain), normals)| (known_of(&view, normals), ((view, gain), normals))).collect();
    let (mut earlier, mut missing) = (Vec::new(), vec![true; sampled.len()]);
    while earlier.len() < MOST_LOOKED_UP && !views.is_empty() {
        let found = |known: &[bool]| known.iter().zip(&missing).filter(|(known, missing)| **known && **missing).count();
        // Of those that know as much, the first one, which is the finer or the latest.
        let best = (0..views.len())
            .rev()
            .max_by_key(|number| found(&views[*number].0))
            .filter(|number| found(&views[*number].0) > 0);
        let Some(best) = best else { break };
        let (known, view) = views.swap_remove(best);
        missing.iter_mut().zip(known).for_each(|(missing, known)| *missing &= !known);
        earlier.push(view);
    }
    let light_of = |x: usize, y: usize, depth: f32| {
        let of_earlier = |((before, gain), normals): &((Before<'_>, f32), &[[i8; 4]])| {
            before.light_of_side(normals, x, y, depth).map(|light| shown_as(*gain, light))
        };
        let found = before.light(x, y, depth).map(|light| shown_as(gain, light));
        found.or_else(|| earlier.iter().find_map(of_earlier))
    };
    // The pixels that need light, and those in tiles without it.
    let tiles = |row: usize, lights: &mut [[u8; 4]], color: &[[u8; 4]]| {
        let mut counts = vec![[0; 2]; width.div_ceil(TILE)];
        for (down, (lights, color)) in lights.chunks_mut(width).zip(color.chunks(width)).enumerate() {
            let y = row * TILE + down;
            let depths = &depth[(y + 1) * stride + 1..(y + 2) * stride - 1];
            for (x, ((light, color), depth)) in lights.iter_mut().zip(color).zip(depths).enumerate() {
                if *depth == f32::INFINITY || color[3] == MIRROR {
                    *light = [0, 0, 0, NEEDS_NONE];
                    continue;
                }
                let found = light_of(x, y, *depth);
                if color[..3].iter().any(|part| *part > DARK) {
                    let [lit, known] = &mut counts[x / TILE];
                    (*lit, *known) = (*lit + 1, *known + u64::from(found.is_some()));
                }
                let of_coarse =
                    |(coarse, gain): &(Before<'_>, f32)| coarse.light(x, y, *depth).map(|light| shown_as(*gain, light));
                let found = found.or_else(|| coarse.as_ref().and_then(of_coarse));
                *light = found.unwrap_or([0, 0, 0, NOTHING]);
            }
        }
        counts.into_iter().fold([0; 2], |[lit, unlit], [here, known]| {
            [lit + here, if known * LEAST_KNOWN < here { unlit + here } else { unlit }]
        })
    };
    let rows = lights.par_chunks_mut(width * TILE).zip(color.par_chunks(width * TILE)).enumerate();
    let counts = rows.map(|(row, (lights, color))| tiles(row, lights, color));
    let [lit, unlit] = counts.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    fill((light, gain), [width, height], lights);
    unlit as f32 / lit.max(1) as f32
}

/// Gives pixels without light the mean of their tile and of those beside it, or else the mean of what is known, whose codes
/// grow by `gain`.
fn fill((known, gain): (&KnownLight, f32), [width, height]: [usize; 2], lights: &mut [[u8; 4]]) {
    let tiles = [width, height].map(|edge| edge.div_ceil(TILE));
    let mean = |row: usize| {
        let lights = &lights;
        (0..tiles[0]).map(move |column| {
            let (mut sum, mut count) = ([0u32; 3], 0);
            for y in row * TILE..((row + 1) * TILE).min(height) {
                let from = y * width + column * TILE;
                for light in &lights[from..from + TILE.min(width - column * TILE)] {
                    // Without light, all three are zero.
                    let [red, green, blue, _] = light.map(u32::from);
                    sum = [sum[0] + red, sum[1] + green, sum[2] + blue];
                    count += u32::from(light[3] == LIGHT);
                }
            }
            [sum[0] as f32, sum[1] as f32, sum[2] as f32, count as f32]
        })
    };
    let mut means: Vec<[f32; 4]> = (0..tiles[1]).into_par_iter().flat_map_iter(mean).collect();
    // Tiles without light take that of the tiles around them, until there are none.
    let lit = known.seen.light.iter().step_by(97).filter(|light| light[3] == LIGHT);
    let all = lit
        .fold([0.0; 4], |sum: [f32; 4], light| std::array::from_fn(|part| sum[part] + gain * f32::from(light[part])));
    while means.iter().any(|mean| mean[3] == 0.0) {
        if means.iter().all(|mean| mean[3] == 0.0) {
            let all = if all[3] > 0.0 { all } else { [64.0, 64.0, 64.0, 1.0] };
            means.fill(all);
            break;
        }
        let around = |tile: usize| {
            let (x, y) = (tile % tiles[0], tile / tiles[0]);
            let mut sum = means[tile];
            if sum[3] == 0.0 {
                for y in y.saturating_sub(1)..(y + 2).min(tiles[1]) {
                    for x in x.saturating_sub(1)..(x + 2).min(tiles[0]) {
                        let near = means[y * tiles[0] + x];
                        sum = std::array::from_fn(|part| sum[part] + near[part]);
                    }
                }
            }
            sum
        };
        means = (0..means.len()).map(around).collect();
    }
    let means: Vec<Vec3> =
        means.iter().map(|[red, green, blue, count]| Vec3::new(*red, *green, *blue) / *count).collect();
    // The place between the middles of tiles: the tiles before and after it, and how far it is along the way.
    let place = |at: usize, tiles: usize| {
        let at = ((at as f32 + 0.5) / TILE as f32 - 0.5).clamp(0.0, (tiles - 1) as f32);
        (at as usize, (at as usize + 1).min(tiles - 1), at.fract())
    };
    let columns: Vec<_> = (0..width).map(|x| place(x, tiles[0])).collect();
    let row = |(y, lights): (usize, &mut [[u8; 4]])| {
        let (top, bottom, down) = place(y, tiles[1]);
        let of_tile = |x: usize| means[top * tiles[0] + x].lerp(means[bottom * tiles[0] + x], down);
        for (light, (left, right, along)) in lights.iter_mut().zip(&columns) {
            if light[3] == NOTHING {
                let mean = of_tile(*left).lerp(of_tile(*right), *along) + 0.5;
                *light = [mean.x as u8, mean.y as u8, mean.z as u8, NOTHING];
            }
        }
    };
    lights.par_chunks_mut(width).with_min_len(8).enumerate().for_each(row);
}
