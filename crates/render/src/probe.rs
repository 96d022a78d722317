//! Exact answers at random pixels of the last frame, from which the errors of frames are estimated.
//!
//! Chosen mirror pixels are put together into a small picture, and their reflected rays are traced through all points
//! as `surfel_trace` traces them. Chosen visible pixels are lit by many virtual lights, each pixel by all of them. What
//! is found costs as much as the pixels chosen, not as the picture.

use std::collections::HashMap;

use cloud::{Random, hash};
use glam::{DVec3, Vec3};
use scene::{Method, Settings, Show};

use crate::frame::{FrameCamera, Objects, Tiles};
use crate::gi::{GlobalIllumination, Receiver};
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{COUNTERS, PROBE_PIXEL_BYTES, PROBE_VALUE_BYTES};
use crate::passes;
use crate::recorder::{Pipelines, Recorder};
use crate::reflection::fading::ShareLeft;
use crate::reflection::gather::Gather;
use crate::reflection::surfel_trace::Rays;
use crate::reflection::task::{MirrorGBuffer, MirrorSurface, Task};
use crate::reflection::{self, SurfaceImages};
use crate::renderer::{Lit, Renderer, nothing_rendered};
use crate::store::PointStore;
use crate::store::draw_list::{DrawList, Selection};
use crate::targets::{Image, storage};

/// Exact answers at random pixels of a frame. Positions are relative to `eye`.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The size of the picture in pixels.
    pub size: [u32; 2],
    /// The eye in world coordinates.
    pub eye: DVec3,
    /// Random mirror pixels, each at most once; empty if no mirror is seen, or no reflections are looked for.
    pub mirrors: Vec<MirrorProbe>,
    /// Random visible pixels, each at most once; empty without indirect light.
    pub lights: Vec<LightProbe>,
}

/// A mirror pixel and what it truly shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorProbe {
    pub pixel: [u32; 2],
    pub place: SeenMirror,
    /// The mirror at the left, the right, the upper and the lower pixel.
    pub beside: [Option<SeenMirror>; 4],
    /// Where the reflected ray ends, if it ends anywhere.
    pub truth: Option<DVec3>,
}

/// A place of a mirror that a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenMirror {
    pub position: DVec3,
    /// The unit normal towards the eye.
    pub normal: DVec3,
    /// The unit direction of the eye's ray.
    pub incoming: DVec3,
}

/// A visible pixel and its indirect light from many virtual lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightProbe {
    pub pixel: [u32; 2],
    /// The radiance toward the eye, linear red, green and blue.
    pub truth: [f32; 3],
}

/// What a frame shows at the pixels of a probe, in their order.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The position found, relative to the probe's eye, and the coverage: 0 none, 1 found, between: closed from
    /// neighbours.
    pub mirrors: Vec<(DVec3, f64)>,
    /// The indirect light, linear red, green and blue.
    pub lights: Vec<[f32; 3]>,
}

/// The four vectors that `probe_pixels` reads at a pixel.
type Values = [[f32; 4]; 4];

/// The edge in pixels of the small picture's rows.
const ROW: u32 = 64;
/// The least and the most pixels that are tried at a time.
const TRIED: [usize; 2] = [256, 1 << 16];

impl Renderer {
    /// Finds exact answers at up to `count` random mirror pixels and `count` random visible pixels of the last frame,
    /// which was drawn from `store` with these objects: what the pixels would show with `surfel_trace` and the light of
    /// `settings`, without interleaving. The settings that affect the visible surface are the frame's. `seed` decides
    /// which pixels are taken. The frame stays as it is.
    ///
    /// # Errors
    /// Nothing was rendered yet, no memory for the index of points or for the lights, or the device was lost.
    pub fn probe(
        &mut self,
        store: &PointStore,
        settings: &Settings,
        objects: Objects<'_>,
        count: usize,
        seed: u64,
    ) -> Result<Probe> {
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        // What is shown of a method's work, and closing gaps between pixels that are neighbours in the small picture
        // alone, have no place here.
        let mut exact = settings.clone();
        exact.reflection.show = Show::Picture;
        (exact.reflection.method, exact.reflection.own_methods) = (Method::SurfelTrace, false);
        exact.splat.close_gaps = false;
        exact.gi.interleave = 1;
        let settings = &exact;
        let mirrors = self.mirror_probes(camera, store, settings, objects, count, seed)?;
        let lights = self.light_probes(camera, store, settings, count, hash(seed))?;
        Ok(Probe { size: camera.size, eye: camera.eye, mirrors, lights })
    }

    /// Reads what the last frame shows at the pixels of a probe. The frame has the probe's camera, and may have any
    /// size: of a smaller picture, the pixel that covers the middle of the probe's is read.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn shown_at(&mut self, settings: &Settings, probe: &Probe) -> Result<Shown> {
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let Self { gpu, pipelines, targets: Some(targets), reflections: Some(reflections), gi, lit, .. } = self else {
            return Err(nothing_rendered());
        };
        let mut reader = Reader::new(gpu, pipelines, camera, settings);
        let here = |[x, y]: [u32; 2]| {
            let scaled = |at: u32, from: u32, to: u32| {
                ((u64::from(at) * 2 + 1) * u64::from(to) / (u64::from(from) * 2)).min(u64::from(to) - 1) as u32
            };
            [scaled(x, probe.size[0], camera.size[0]), scaled(y, probe.size[1], camera.size[1])]
        };
        let offset = camera.eye - probe.eye;
        let pixels: Vec<[u32; 2]> = probe.mirrors.iter().map(|mirror| here(mirror.pixel)).collect();
        let mirrors = match reflections.first() {
            Some(bounce) => {
                let images = [&bounce.mirror.point, &bounce.seen.position, &bounce.mirror.eye, &bounce.seen.normal];
                let found = |[point, seen, ..]: &Values| {
                    let coverage = if point[3] > 0.0 { f64::from(seen[3]) } else { 0.0 };
                    (vector(seen) + offset, coverage)
                };
                reader.read(&pixels, images)?.iter().map(found).collect()
            }
            None => vec![(DVec3::ZERO, 0.0); pixels.len()],
        };
        let pixels: Vec<[u32; 2]> = probe.lights.iter().map(|light| here(light.pixel)).collect();
        let lights = match gi.radiance(0).filter(|_| lit.is_some()) {
            Some(radiance) => {
                let images = [radiance, &targets.position, &targets.position, &targets.position];
                reader.read(&pixels, images)?.iter().map(|[[red, green, blue, _], ..]| [*red, *green, *blue]).collect()
            }
            None => vec![[0.0; 3]; pixels.len()],
        };
        Ok(Shown { mirrors, lights })
    }

    fn mirror_probes(
        &mut self,
        camera: FrameCamera,
        store: &PointStore,
        settings: &Settings,
        objects: Objects<'_>,
        count: usize,
        seed: u64,
    ) -> Result<Vec<MirrorProbe>> {
        let Self {
            gpu,
            pipelines,
            targets: Some(targets),
            reflections: Some(reflections),
            given_up,
            longest_piece,
            ..
        } = self
        else {
            return Err(nothing_rendered());
        };
        let counters = self.handed.counters()?.ok_or_else(nothing_rendered)?;
        let known = reflections.stats(settings, &counters).mirror_pixels;
        let Some(bounce) = reflections.first().filter(|_| known > 0) else { return Ok(Vec::new()) };
        let normal = &targets.surface().normal;
        let images = [&bounce.mirror.point, normal, &bounce.mirror.eye, &bounce.seen.position];
        let mut reader = Reader::new(gpu, pipelines, camera, settings);
        let mut draws = Draws::new(camera.mirror_tiles, camera.size, seed);
        let share = f64::from(known) / draws.left().max(1) as f64;
        let (chosen, values) = reader.choose(&mut draws, count, share, images, |[point, ..]| point[3] > 0.0)?;
        if chosen.is_empty() {
            return Ok(Vec::new());
        }
        let [width, height] = camera.size;
        let beside = |[x, y]: [u32; 2]| {
            let side = |column: Option<u32>, row: Option<u32>| {
                Some([column.filter(|x| *x < width)?, row.filter(|y| *y < height)?])
            };
            [
                side(x.checked_sub(1), Some(y)),
                side(Some(x + 1), Some(y)),
                side(Some(x), y.checked_sub(1)),
                side(Some(x), Some(y + 1)),
            ]
        };
        let beside: Vec<[Option<[u32; 2]>; 4]> = chosen.iter().map(|pixel| beside(*pixel)).collect();
        let around: Vec<[u32; 2]> = beside.iter().flatten().flatten().copied().collect();
        let mut around = reader.read(&around, images)?.into_iter();
        let place = |[point, normal, eye, _]: &Values| {
            let position = vector(point);
            let incoming = (position - vector(eye)).normalize_or_zero();
            (point[3] > 0.0).then(|| SeenMirror { position, normal: vector(normal), incoming })
        };

        // The small picture.
        let size = [ROW, (chosen.len() as u32).div_ceil(ROW)];
        let small = FrameCamera { size, mirror_tiles: Tiles::of(size), ..camera };
        let device = &gpu.device;
        let image = |index: usize| small_image(gpu, size, values.iter().map(|values| values[index]));
        let mirror = MirrorSurface { point: image(0), eye: image(2) };
        let normal = image(1);
        let seen = MirrorGBuffer::new(device, size);
        let gather = Gather::new(device, size);
        let counters = storage(device, "counters", COUNTERS as u64 * 4);
        let formulas = reflection::upload(gpu, settings, objects.mirrors, camera.eye);
        let list = store.draw_list(&camera, settings, Selection::Everywhere);
        let supply = Inputs::new(gpu, small, settings, &list);
        let task = Task {
            supply: &supply,
            settings,
            store,
            mirrors: objects.mirrors,
            bounce: 0,
            camera: SurfaceImages::of_camera(targets),
            mirror: &mirror,
            normal: &normal,
            seen: &seen,
            formulas: formulas.as_ref(),
            counters: &counters,
        };
        let mut recorder = Recorder::new(gpu, pipelines, settings);
        recorder.give_up_when(given_up.as_deref().map(|asked| asked as _), *longest_piece);
        reflections.methods.trace(&mut recorder, &gather, &task, &task.supply.chunks, Rays::All)?;
        recorder.finish()?;
        let ends: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&gpu.read_texture(&seen.position.texture)?);
        let mut probes = Vec::with_capacity(chosen.len());
        for (((pixel, values), sides), end) in chosen.into_iter().zip(&values).zip(beside).zip(&ends) {
            let beside = sides.map(|side| side.and_then(|_| around.next()).and_then(|values| place(&values)));
            let truth = (end[3] > 0.0).then(|| vector(end));
            probes.extend(place(values).map(|place| MirrorProbe { pixel, place, beside, truth }));
        }
        Ok(probes)
    }

    fn light_probes(
        &mut self,
        camera: FrameCamera,
        store: &PointStore,
        settings: &Settings,
        count: usize,
        seed: u64,
    ) -> Result<Vec<LightProbe>> {
        let Self {
            gpu,
            pipelines,
            targets: Some(targets),
            reflections: Some(reflections),
            given_up,
            longest_piece,
            ..
        } = self
        else {
            return Err(nothing_rendered());
        };
        let Some(Lit { lights, sky, has_highlights, has_gloss }) = &self.lit else { return Ok(Vec::new()) };
        let surface = targets.surface();
        let mean = reflections.mean().filter(|_| self.summed.is_some());
        let fading = ShareLeft::new(mean, reflections.first().and_then(|bounce| bounce.reach.as_ref()));
        let left = fading.image().unwrap_or(&targets.position);
        let images = [&targets.position, &surface.albedo, &surface.normal, left];
        let mut draws = Draws::new(Tiles::of(camera.size), camera.size, seed);
        let mut reader = Reader::new(gpu, pipelines, camera, settings);
        let (chosen, values) = reader.choose(&mut draws, count, 1.0, images, |[position, ..]| position[3] > 0.0)?;
        if chosen.is_empty() {
            return Ok(Vec::new());
        }
        let size = [ROW, (chosen.len() as u32).div_ceil(ROW)];
        let small = FrameCamera { size, mirror_tiles: Tiles::of(size), ..camera };
        let [position, albedo, normal, left] =
            [0, 1, 2, 3].map(|index| small_image(gpu, size, values.iter().map(|values| values[index])));
        let many: &mut GlobalIllumination = &mut self.many_lights;
        let mut recorder = Recorder::new(gpu, pipelines, settings);
        recorder.give_up_when(given_up.as_deref().map(|asked| asked as _), *longest_piece);
        let thrown = self.caustics.thrown();
        many.place(&mut recorder, camera, store, settings, (lights, thrown, *sky), &self.lights.shadows)?;
        many.surfaces_changed(0);
        let receiver = Receiver {
            index: 0,
            surface: SurfaceImages { albedo: &albedo, normal: &normal, position: &position },
            from: &position,
            is_mixed: reflections.count > 0,
            followed: None,
            is_glossy: *has_highlights,
            has_gloss: *has_gloss,
            fading: fading.in_image(&left),
            brought: None,
            most_bounces: None,
        };
        let inputs = Inputs::new(gpu, small, settings, &DrawList::default());
        many.shade(&mut recorder, &inputs, settings, &receiver)?;
        recorder.finish()?;
        let Some(radiance) = many.radiance(0) else { return Ok(Vec::new()) };
        let halves: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(&gpu.read_texture(&radiance.texture)?);
        let probe = |(pixel, [red, green, blue, _]): (&[u32; 2], &[u16; 4])| LightProbe {
            pixel: *pixel,
            truth: [red, green, blue].map(|bits| half::f16::from_bits(*bits).to_f32()),
        };
        Ok(chosen.iter().zip(&halves).map(probe).collect())
    }
}

fn vector([x, y, z, _]: &[f32; 4]) -> DVec3 {
    Vec3::new(*x, *y, *z).as_dvec3()
}

/// An image that holds the texels row by row, and zeros behind them.
fn small_image(gpu: &Gpu, size: [u32; 2], texels: impl Iterator<Item = [f32; 4]>) -> Image {
    let image = Image::new(&gpu.device, size, "probed pixels", wgpu::TextureFormat::Rgba32Float);
    let [width, height] = size;
    let mut texels: Vec<[f32; 4]> = texels.collect();
    texels.resize(width as usize * height as usize, [0.0; 4]);
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 16), rows_per_image: Some(height) };
    let texture = &image.texture;
    gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, texture.size());
    image
}

/// Reads images at single pixels.
struct Reader<'a> {
    gpu: &'a Gpu,
    pipelines: &'a mut Pipelines,
    settings: &'a Settings,
    inputs: Inputs,
}

impl<'a> Reader<'a> {
    fn new(gpu: &'a Gpu, pipelines: &'a mut Pipelines, camera: FrameCamera, settings: &'a Settings) -> Self {
        Self { gpu, pipelines, settings, inputs: Inputs::new(gpu, camera, settings, &DrawList::default()) }
    }

    /// The values of the images at each of the pixels.
    fn read(&mut self, pixels: &[[u32; 2]], images: [&Image; 4]) -> Result<Vec<Values>> {
        if pixels.is_empty() {
            return Ok(Vec::new());
        }
        let gpu = self.gpu;
        let words: Vec<u32> = pixels.iter().map(|[x, y]| x | y << 16).collect();
        let list = storage(&gpu.device, "probed pixels", words.len() as u64 * PROBE_PIXEL_BYTES);
        gpu.queue.write_buffer(&list, 0, bytemuck::cast_slice(&words));
        // The list has room for at least four entries, and each of them is read.
        let entries = list.size() / PROBE_PIXEL_BYTES;
        let values = storage(&gpu.device, "values of pixels", entries * 4 * PROBE_VALUE_BYTES);
        let [first_in, second_in, third_in, fourth_in] = images.map(Image::bind);
        let bindings = passes::probe_pixels {
            pixels: list.as_entire_binding(),
            first_in,
            second_in,
            third_in,
            fourth_in,
            values: values.as_entire_binding(),
        };
        let mut recorder = Recorder::new(gpu, self.pipelines, self.settings);
        recorder.over(&[], &self.inputs, bindings, [(entries as u32).div_ceil(64), 1, 1])?;
        recorder.finish()?;
        let bytes = gpu.read_buffer(&values, 0, words.len() as u64 * 4 * PROBE_VALUE_BYTES)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// Draws pixels until `count` of them are wanted, or all are drawn. About a `share` of them is wanted.
    fn choose(
        &mut self,
        draws: &mut Draws,
        count: usize,
        share: f64,
        images: [&Image; 4],
        is_wanted: impl Fn(&Values) -> bool,
    ) -> Result<(Vec<[u32; 2]>, Vec<Values>)> {
        let (mut chosen, mut values) = (Vec::new(), Vec::new());
        while chosen.len() < count && draws.left() > 0 {
            let missing = (count - chosen.len()) as f64 / share.clamp(1e-3, 1.0) * 1.1;
            let some = (missing as usize).clamp(TRIED[0], TRIED[1]);
            let drawn: Vec<[u32; 2]> = std::iter::from_fn(|| draws.next()).take(some).collect();
            let read = self.read(&drawn, images)?;
            for (pixel, value) in drawn.into_iter().zip(read).filter(|(_, value)| is_wanted(value)) {
                chosen.push(pixel);
                values.push(value);
            }
        }
        chosen.truncate(count);
        values.truncate(count);
        Ok((chosen, values))
    }
}

/// The pixels of some tiles in a random order, each once: the shuffle of Fisher and Yates, of which only the places
/// that changed are kept.
struct Draws {
    random: Random,
    first: [u32; 2],
    width: u32,
    drawn: u64,
    all: u64,
    moved: HashMap<u64, u64>,
}

impl Draws {
    fn new(tiles: Tiles, size: [u32; 2], seed: u64) -> Self {
        let first = tiles.first.map(|tile| tile * 8);
        let [width, height] = [0, 1].map(|axis| (tiles.count[axis] * 8).min(size[axis].saturating_sub(first[axis])));
        let all = u64::from(width) * u64::from(height);
        Self { random: Random(hash(seed)), first, width, drawn: 0, all, moved: HashMap::new() }
    }

    fn left(&self) -> u64 {
        self.all - self.drawn
    }

    fn next(&mut self) -> Option<[u32; 2]> {
        if self.left() == 0 {
            return None;
        }
        let other = self.drawn + self.random.below(self.left());
        let here = self.moved.remove(&self.drawn).unwrap_or(self.drawn);
        let taken = if other == self.drawn { here } else { self.moved.insert(other, here).unwrap_or(other) };
        self.drawn += 1;
        let (x, y) = (taken % u64::from(self.width), taken / u64::from(self.width));
        Some([self.first[0] + x as u32, self.first[1] + y as u32])
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_pixel_is_drawn_once_and_each_is_as_likely_first() {
        let tiles = Tiles { first: [1, 2], count: [3, 2] };
        let all = |seed| {
            let mut draws = Draws::new(tiles, [30, 40], seed);
            std::iter::from_fn(|| draws.next()).collect::<Vec<_>>()
        };
        let drawn = all(3);
        // The tiles' last columns lie outside of the picture.
        assert_eq!(drawn.len(), 22 * 16);
        assert_eq!(drawn.iter().collect::<HashSet<_>>().len(), drawn.len());
        assert!(drawn.iter().all(|[x, y]| (8..30).contains(x) && (16..32).contains(y)));
        assert_eq!(drawn, all(3));
        assert_ne!(drawn, all(4));
        let count = 4000;
        for place in [0, 100] {
            let left = (0..count).filter(|seed| all(*seed)[place][0] < 8 + 11).count() as f64;
            // Four standard deviations.
            assert!((left / count as f64 - 0.5).abs() < 4.0 * 0.5 / (count as f64).sqrt(), "{place}: {left}");
        }
    }
}
