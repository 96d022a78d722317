//! A built-in scene on the GPU and in the ray tracer, to measure the cost and the accuracy of settings.

use std::sync::Arc;

use cloud::Progress;
use glam::DVec3;
use render::{Aov, Frame, FrameStats, Gpu, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, Method, Settings};
use trace::{
    Exact, Geometry, Gloss, Hit, Illuminant, Illumination, Indirect, PixelRays, Ray, Sunlight, indirect_picture,
};

use crate::flicker::{Flicker, Followed, FrameImages, Steps, flicker, follow};
use crate::light::{LightError, is_same_surface, light_error, p95_error};
use crate::metrics::{Accuracy, Truth};
use crate::subject::Subject;
use crate::truth::{TracedScene, Tracer, View};

/// One of the five mirrors, loaded.
pub struct FiveMirrors {
    subject: Subject,
    traced: TracedScene,
    exact: Exact,
}

/// How the indirect light of exact surfaces is traced, for [`FiveMirrors::indirect_truth`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TracedLight {
    /// One pixel in each square of this width is traced, anywhere in it: edges of the scene and shares of interleaved
    /// lights have their periods, too.
    pub stride: usize,
    /// The number of paths of each of these pixels.
    pub paths: u32,
    /// Whether light that reaches a surface by way of mirrors counts, which virtual lights do not give; else mirrors
    /// are black. Where no reflection is followed, they are diffuse surfaces then, and their own light counts, too.
    pub over_mirrors: bool,
}

/// The indirect light of the scene's exact surfaces at some pixels.
pub struct IndirectTruth {
    /// The hits at the pixels that count, row by row, without mirrors whose reflections are followed.
    seen: Vec<Option<(Hit, DVec3)>>,
    /// The light of all pixels, linear red, green and blue.
    light: Vec<[f32; 3]>,
    /// The standard deviation of the truth's own noise relative to its mean.
    pub noise: f64,
}

/// The error of a picture's indirect light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JudgedLight {
    /// The error over all pixels that were traced: pixels on edges and seams show a mean of two surfaces, and the truth
    /// one of them.
    pub all: LightError,
    /// The error over the pixels whose normal and albedo are the truth's: the error of the light alone.
    pub same_surface: LightError,
    /// The difference in luminance that 95 of 100 of those pixels do not exceed, relative to the mean of the truth there.
    pub p95: f64,
    /// The share of those pixels among all.
    pub share: f64,
}

impl IndirectTruth {
    /// Judges an image of indirect light, linear red, green and blue, of the size that was traced.
    pub fn judge(&self, image: &[[f32; 3]]) -> LightError {
        let mask: Vec<bool> = self.seen.iter().map(Option::is_some).collect();
        light_error(&mask, image, &self.light)
    }

    /// The truth of mirrors alone, or of all other surfaces.
    pub fn of_mirrors(&self, are_mirrors: bool) -> Self {
        let counts = |seen: &(Hit, DVec3)| (seen.0.specular_intensity > 0.0) == are_mirrors;
        let seen = self.seen.iter().map(|seen| seen.filter(counts)).collect();
        Self { seen, light: self.light.clone(), noise: self.noise }
    }
}

/// Exact surfaces whose mirrors reflect nothing.
struct WithBlackMirrors<'a>(&'a Exact);

impl Geometry for WithBlackMirrors<'_> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.0.nearest(ray)?;
        let is_mirror = hit.specular_intensity > 0.0;
        Some(if is_mirror { Hit { albedo: DVec3::ZERO, specular_intensity: 0.0, ..hit } } else { hit })
    }

    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool {
        self.0.is_blocked(ray, distance)
    }
}

impl FiveMirrors {
    /// Samples and uploads the scene; `settings.scene` gives the number of points.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn new(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> anyhow::Result<Self> {
        let subject = Subject::five_mirrors(gpu, variant, settings)?;
        let exact = Exact::five_mirrors(variant);
        let progress = Progress::default();
        let traced = TracedScene::new(&subject.parts, Some(exact.clone()), settings.splat.size, &progress)?;
        Ok(Self { subject, traced, exact })
    }

    /// Renders a frame from scratch.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn render(&self, renderer: &mut Renderer, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        Ok(self.subject.render(renderer, settings, size)?)
    }

    /// Judges the frame that was rendered last, by both truths.
    ///
    /// # Errors
    /// No reflections were rendered.
    pub fn judge(
        &self,
        renderer: &Renderer,
        settings: &Settings,
        size: [u32; 2],
    ) -> anyhow::Result<(Accuracy, Accuracy)> {
        let Subject { camera, .. } = &self.subject;
        let tracer = Tracer::new(&self.traced, View { camera, settings, objects: self.subject.objects(), size });
        let drawn = tracer.drawn(renderer)?;
        let progress = Progress::default();
        Ok((tracer.judge(Truth::SameInput, &drawn, &progress)?, tracer.judge(Truth::Exact, &drawn, &progress)?))
    }

    /// The indirect light at the pixels of a picture of `size`, path-traced on exact surfaces. Two runs of half the
    /// paths each show how noisy it is.
    ///
    /// # Errors
    /// Tracing was cancelled.
    pub fn indirect_truth(
        &self,
        settings: &Settings,
        size: [u32; 2],
        traced: TracedLight,
    ) -> anyhow::Result<IndirectTruth> {
        let Settings { light, sun, gi, mirror, reflection, view, .. } = settings;
        let camera = five_mirrors::camera();
        // The reach is for parallel rays: the box's half diagonal, and the eye's distance.
        let rays = PixelRays::new(&camera, view, size, 10.0);
        let width = size[0] as usize;
        let is_traced = |pixel: usize| {
            let cell = [pixel % width / traced.stride, pixel / width / traced.stride];
            let place = [pixel % width % traced.stride, pixel / width % traced.stride];
            // A multiplicative hash of the cell (Knuth), whose upper bits are evenly distributed.
            let hash =
                (cell[1] as u32).wrapping_mul(0x9e37_79b9).wrapping_add(cell[0] as u32).wrapping_mul(0x85eb_ca6b);
            let pick = (hash >> 12) as usize % (traced.stride * traced.stride);
            place == [pick % traced.stride, pick / traced.stride]
        };
        let bounces = if reflection.method == Method::None { 0 } else { reflection.bounces };
        let mirrors_count = traced.over_mirrors && bounces == 0;
        let counts = |hit: &Hit| mirrors_count || hit.specular_intensity == 0.0;
        let seen = |pixel: usize| {
            let ray = rays.ray(pixel);
            let hit = self.exact.nearest(&ray).filter(|hit| is_traced(pixel) && counts(hit));
            Some((hit?, ray.direction))
        };
        let seen: Vec<Option<(Hit, DVec3)>> = (0..rays.pixel_count()).map(seen).collect();
        let source = match light.by {
            scene::Lighting::Sun => Illuminant::Sun(Sunlight::new(sun, camera.up)),
            _ => Illuminant::Lights(&self.subject.lights),
        };
        let (share, power) = (f64::from(light.gloss), f64::from(light.gloss_power));
        let gloss = Gloss { share, power, shape: light.highlight };
        let run = |seed| {
            let indirect = Indirect { bounces: gi.bounces, samples: traced.paths.div_ceil(2), seed };
            let mirror_boxes = &self.traced.mirror_boxes;
            let illumination =
                Illumination { gloss, bounces, indirect, mirror_boxes, ..Illumination::new(source, mirror) };
            let progress = Progress::default();
            let light = if traced.over_mirrors {
                indirect_picture(&self.exact, &seen, &illumination, &progress)
            } else {
                indirect_picture(&WithBlackMirrors(&self.exact), &seen, &illumination, &progress)
            };
            light.ok_or_else(|| anyhow::anyhow!("tracing was cancelled"))
        };
        let seed = settings.trace.seed;
        let (one, other) = (run(seed)?, run(seed.wrapping_add(1))?);
        let (mut squares, mut sum) = (0.0, DVec3::ZERO);
        let mean = |(one, other): (&Option<DVec3>, &Option<DVec3>)| {
            let Some((one, other)) = one.zip(*other) else { return [f32::NAN; 3] };
            let mean = (one + other) / 2.0;
            // The mean of two has half the standard deviation of their difference.
            squares += ((one - other) / 2.0).length_squared();
            sum += mean;
            mean.as_vec3().to_array()
        };
        let light: Vec<[f32; 3]> = one.iter().zip(&other).map(mean).collect();
        let values = 3.0 * seen.iter().flatten().count() as f64;
        Ok(IndirectTruth { seen, light, noise: (squares / values).sqrt() / (sum.element_sum() / values) })
    }

    /// Judges the indirect light of the frame that was rendered last.
    ///
    /// # Errors
    /// Nothing was rendered.
    pub fn judge_indirect(&self, renderer: &Renderer, truth: &IndirectTruth) -> anyhow::Result<JudgedLight> {
        let read = |aov| renderer.read_aov(aov).map(|image| image.data);
        let (image, normal, albedo) = (read(Aov::Indirect)?, read(Aov::Normal)?, read(Aov::Albedo)?);
        let image = image.as_chunks::<3>().0;
        let vector = |data: &[f32], pixel: usize| DVec3::from_slice(&[0, 1, 2].map(|i| f64::from(data[3 * pixel + i])));
        let is_same = |(pixel, seen): (usize, &Option<(Hit, DVec3)>)| {
            seen.is_some_and(|(hit, _)| is_same_surface(vector(&normal, pixel), vector(&albedo, pixel), &hit))
        };
        let same: Vec<bool> = truth.seen.iter().enumerate().map(is_same).collect();
        let share = same.iter().filter(|is_same| **is_same).count() as f64 / truth.seen.iter().flatten().count() as f64;
        let p95 = p95_error(&same, image, &truth.light);
        Ok(JudgedLight { all: truth.judge(image), same_surface: light_error(&same, image, &truth.light), p95, share })
    }

    /// Measures how much the indirect light of places on the walls flickers while the camera moves sideways, `frames`
    /// times by a quarter of a pixel at the distance of the box's middle. The places are those of the first frame's
    /// pixels; the other frames show them at the nearest pixel. The floor, whose colours change from place to place, is
    /// left out, and so are edges.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn flicker_of_indirect(
        &self,
        renderer: &mut Renderer,
        settings: &Settings,
        size: [u32; 2],
        frames: u32,
    ) -> anyhow::Result<Flicker> {
        let draw = |camera: &Camera| -> anyhow::Result<FrameImages> {
            renderer.render(&self.subject.store, &Frame::new(camera, settings, self.subject.objects(), size))?;
            let read =
                |aov| -> anyhow::Result<Vec<[f32; 3]>> { Ok(renderer.read_aov(aov)?.data.as_chunks::<3>().0.to_vec()) };
            Ok(FrameImages { positions: read(Aov::Position)?, colors: read(Aov::Indirect)? })
        };
        let steps = Steps { frames, pixels: 0.25 };
        let Followed { places, frames: shown } = follow(&five_mirrors::camera(), &settings.view, size, steps, draw)?;
        let is_on_wall = |place: &DVec3| {
            let gaps = (DVec3::new(1.0, 1.0, 2.0) - place.abs()).to_array();
            // Near one wall only, and more than a tenth away from every other one.
            let is_beside_one = gaps.iter().filter(|gap| **gap < 0.1).count() == 1;
            is_beside_one && place.y > -0.9
        };
        Ok(flicker(&places.iter().map(is_on_wall).collect::<Vec<_>>(), &shown))
    }
}
