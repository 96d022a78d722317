//! Compares a frame with what the ray tracer sees in its place.
//!
//! [`TracedScene`] is the points as discs, and the exact surfaces behind them; making it is the costly part, and it
//! serves all pictures of a scene. [`Tracer`] looks at it as one frame does. With [`Truth::SameInput`] everything
//! starts from the frame's own surface (positions, normals, colours of its pixels), with [`Truth::Exact`] from the rays
//! through the pixels' centres.

use std::sync::OnceLock;
use std::time::Instant;

use cloud::{Bounds, Chunk, Progress};
use glam::DVec3;
use rayon::prelude::*;
use render::{Aov, AovImage, Frame, MOST_LIGHTS, Objects, Renderer};
use scene::{Camera, GlossLobe, Highlight, Lighting, Method, Settings, SpotLight};
use trace::{
    Caustics, Exact, Fill, Geometry, Gloss, HalfLobe, Hit, Illuminant, Illumination, Indirect, Lobe, Medium,
    MirrorPoint, Photons, PixelRays, Side, Sunlight, Surfels, indirect_picture, linear_from_srgb, primary, radiance,
    reflected,
};

use crate::accuracy::{Error, MirrorImage, Result, accuracy_exact, accuracy_same_input, pixel_errors_same_input};
use crate::metrics::{Accuracy, ImageError, PixelError, Truth, image_error};
use crate::subject::SubjectPart;

/// A scene in the form for the ray tracer.
pub struct TracedScene {
    pub surfels: Surfels,
    /// The exact surfaces, for rays in coordinates relative to `origin`.
    pub exact: Option<Exact>,
    /// The origin of all positions: near the scene, so that images of 32-bit positions are precise.
    pub origin: DVec3,
    /// The bounds in world coordinates.
    bounds: Bounds,
    /// The boxes about the points of each mirror, relative to `origin`.
    pub(crate) mirror_boxes: Vec<Bounds>,
}

impl TracedScene {
    /// Builds the scene; `splat_size` is `splat.size`.
    ///
    /// # Errors
    /// Cancelled.
    pub fn new(parts: &[SubjectPart], exact: Option<Exact>, splat_size: f32, progress: &Progress) -> Result<Self> {
        let chunks = parts.iter().flat_map(|part| &part.cloud.chunks);
        let bounds = chunks.fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
        let origin = if bounds.is_empty() { DVec3::ZERO } else { bounds.center().round() };
        let mirrors = parts.iter().filter(|part| part.specular_intensity > 0.0).map(|part| &part.cloud.chunks);
        let box_of = |chunks: &Vec<Chunk>| {
            let Bounds { min, max } = chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
            Bounds { min: min - origin, max: max - origin }
        };
        let mirror_boxes = mirrors.map(box_of).collect();
        let painted: Vec<Vec<Chunk>> = parts.iter().map(|part| part.painted(origin)).collect();
        let parts = parts.iter().zip(&painted).map(|(part, chunks)| {
            let [red, green, blue, _] = part.plain().map(|value| linear_from_srgb(value) as f32);
            let SubjectPart { specular_intensity, specular_power, clear, .. } = *part;
            trace::MaterialPoints { chunks, specular_intensity, specular_power, clear, plain: [red, green, blue] }
        });
        let surfels = Surfels::new(&parts.collect::<Vec<_>>(), splat_size, progress).ok_or(Error::Cancelled)?;
        Ok(Self { surfels, exact: exact.map(|exact| exact.seen_from(origin)), origin, bounds, mirror_boxes })
    }
}

/// The settings with which a frame was drawn.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub objects: Objects<'a>,
    pub size: [u32; 2],
}

impl<'a> View<'a> {
    /// The request for the picture of the view, in full effort.
    pub fn frame(self) -> Frame<'a> {
        Frame::new(self.camera, self.settings, self.objects, self.size)
    }
}

/// For each pixel the hit that it sees and the direction of the ray; `None` if it sees nothing.
pub type Seen = Vec<Option<(Hit, DVec3)>>;

/// The hits of the pixels that see a mirror.
pub fn mirrors_of(seen: &[Option<(Hit, DVec3)>]) -> Seen {
    seen.iter().map(|seen| seen.filter(|(hit, _)| hit.specular_intensity > 0.0)).collect()
}

/// The images of a frame. Rows top to bottom; positions relative to the traced scene's origin.
pub struct Drawn {
    pub surface: Surface,
    /// The positions seen in the mirrors, and coverage: four values a pixel.
    pub found: Vec<f32>,
    /// The linear red, green and blue before tone mapping.
    pub color: Vec<[f32; 3]>,
}

impl Drawn {
    /// The frame that was rendered last, with these settings; positions relative to `origin`.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read(renderer: &Renderer, settings: &Settings, origin: DVec3) -> render::Result<Self> {
        let surface = Surface::read(renderer, origin)?;
        let found = match has_reflections(settings) {
            true => renderer.read_aov_from(Aov::MirrorPosition, origin)?.data,
            false => vec![f32::NAN; surface.len() * 4],
        };
        let color = renderer.read_aov(Aov::Color)?.data.as_chunks::<3>().0.to_vec();
        Ok(Self { surface, found, color })
    }
}

/// Whether the renderer follows reflections.
fn has_reflections(settings: &Settings) -> bool {
    settings.reflection.method != Method::None && settings.reflection.bounces > 0
}

/// The surfaces that the camera sees of the points.
pub struct Surface {
    pub mirror: Vec<f32>,
    pub position: Vec<f32>,
    pub normal: Vec<f32>,
    albedo: Vec<f32>,
    specular_intensity: Vec<f32>,
    specular_power: Vec<f32>,
    refraction: Vec<f32>,
}

impl Surface {
    /// The surface of the frame that was rendered last, with positions relative to `origin`.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read(renderer: &Renderer, origin: DVec3) -> render::Result<Self> {
        let read = |aov| renderer.read_aov_from(aov, origin).map(|image| image.data);
        Ok(Self {
            mirror: read(Aov::Mirror)?,
            position: read(Aov::Position)?,
            normal: read(Aov::Normal)?,
            albedo: read(Aov::Albedo)?,
            specular_intensity: read(Aov::SpecularIntensity)?,
            specular_power: read(Aov::SpecularPower)?,
            refraction: read(Aov::Refraction)?,
        })
    }

    /// All images of the surface.
    pub(crate) fn images(&self) -> [&[f32]; 7] {
        let Self { mirror, position, normal, albedo, specular_intensity, specular_power, refraction } = self;
        [mirror, position, normal, albedo, specular_intensity, specular_power, refraction]
    }

    /// A frame that saw these hits without any error of its own.
    #[cfg(test)]
    pub(crate) fn of_hits(hits: &[Option<Hit>]) -> Self {
        let vectors = |vector: fn(&Hit) -> DVec3| -> Vec<f32> {
            hits.iter().flat_map(|hit| hit.as_ref().map_or(DVec3::NAN, vector).as_vec3().to_array()).collect()
        };
        let numbers = |number: fn(&Hit) -> f64| -> Vec<f32> {
            hits.iter().map(|hit| hit.as_ref().map_or(0.0, number) as f32).collect()
        };
        Self {
            mirror: numbers(|hit| f64::from(u8::from(hit.specular_intensity > 0.0))),
            position: vectors(|hit| hit.position),
            normal: vectors(|hit| hit.normal),
            albedo: vectors(|hit| hit.albedo),
            specular_intensity: numbers(|hit| hit.specular_intensity),
            specular_power: numbers(|hit| hit.specular_power),
            refraction: numbers(|hit| match hit.medium {
                Some(Medium { ratio, side: Side::Beneath }) => -ratio,
                medium => medium.map_or(0.0, |medium| medium.ratio),
            }),
        }
    }

    /// The width and height in pixels.
    pub fn len(&self) -> usize {
        self.mirror.len()
    }

    pub fn is_empty(&self) -> bool {
        self.mirror.is_empty()
    }

    pub fn is_mirror(&self, pixel: usize) -> bool {
        self.mirror[pixel] > 0.0
    }

    /// What lies behind the surface that a pixel sees; an eye is outside of all solids.
    fn medium(&self, pixel: usize) -> Option<Medium> {
        let index = f64::from(self.refraction[pixel]);
        let side = if index > 0.0 { Side::IntoSolid } else { Side::Beneath };
        (index.abs() > 0.0).then(|| Medium { ratio: index.abs(), side })
    }

    /// The surface that a pixel sees, as the hit of the eye's ray.
    fn hit(&self, pixel: usize, rays: &PixelRays) -> Option<Hit> {
        let [position, normal, albedo] = [&self.position, &self.normal, &self.albedo].map(|image| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(image[pixel * 3 + axis]));
            DVec3::new(x, y, z)
        });
        position.is_finite().then(|| Hit {
            distance: rays.viewpoint().distance(position),
            position,
            normal: normal.normalize_or_zero(),
            albedo,
            specular_intensity: f64::from(self.specular_intensity[pixel]),
            specular_power: f64::from(self.specular_power[pixel]),
            medium: self.medium(pixel),
            surface: 0,
            point: 0,
        })
    }
}

/// The result of the method `ray_trace` for a frame.
pub struct RayTraced {
    /// The time of tracing and lighting what the mirror pixels show, all bounces, on all cores, by the host's clock.
    pub milliseconds: f64,
    /// The first hit of each mirror pixel's ray.
    pub first: Vec<Option<Hit>>,
}

/// Looks at a scene as one frame does.
pub struct Tracer<'a> {
    scene: &'a TracedScene,
    rays: PixelRays,
    lights: Vec<SpotLight>,
    view: View<'a>,
    /// What mirrors throw in the points, and on exact surfaces, once it was traced.
    caustics: [OnceLock<Caustics>; 2],
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a TracedScene, view: View<'a>) -> Self {
        let View { camera, settings, objects, size } = view;
        let TracedScene { origin, bounds, .. } = *scene;
        let lights = objects.lights.iter().take(MOST_LIGHTS).map(|light| SpotLight {
            position: light.position - origin,
            target: light.target - origin,
            ..*light
        });
        let seen = Camera { eye: camera.eye - origin, pivot: camera.pivot - origin, up: camera.up };
        let reach = if bounds.is_empty() { 0.0 } else { 2.0 * bounds.radius() + camera.eye.distance(bounds.center()) };
        let rays = PixelRays::new(&seen, &settings.view, size, reach);
        Self { scene, rays, lights: lights.collect(), view, caustics: Default::default() }
    }

    /// The frame that was rendered last, with the view of this tracer.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn drawn(&self, renderer: &Renderer) -> render::Result<Drawn> {
        Drawn::read(renderer, self.view.settings, self.scene.origin)
    }

    /// What is seen at the frame's own surface.
    pub fn seen(&self, surface: &Surface) -> Seen {
        let seen =
            |pixel: usize| surface.hit(pixel, &self.rays).map(|hit| (hit, self.rays.viewpoint().toward(hit.position)));
        (0..surface.len()).map(seen).collect()
    }

    /// The hits of the rays through the pixels' centres on exact surfaces.
    ///
    /// # Errors
    /// No exact surfaces, or cancelled.
    pub fn exactly_seen(&self, progress: &Progress) -> Result<Seen> {
        let seen = primary(self.exact()?, &self.rays, progress).ok_or(Error::Cancelled)?.into_iter().enumerate();
        Ok(seen.map(|(pixel, hit)| Some((hit?, self.rays.ray(pixel).direction))).collect())
    }

    fn exact(&self) -> Result<&Exact> {
        self.scene.exact.as_ref().ok_or(Error::NoSurfaces)
    }

    /// Replaces the content of the frame's mirrors by what the ray tracer sees in them: the method `ray_trace`.
    ///
    /// # Errors
    /// Cancelled.
    pub fn ray_trace(&self, drawn: &mut Drawn, progress: &Progress) -> Result<RayTraced> {
        let mirrors = mirrors_of(&self.seen(&drawn.surface));
        let first = self.first_hits(&mirrors, progress)?;
        let start = Instant::now();
        let colors = self.colors(Truth::SameInput, &mirrors, progress)?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let traced = drawn.color.iter_mut().zip(colors).enumerate();
        for (_, (texel, color)) in traced.filter(|(pixel, _)| drawn.surface.mirror[*pixel] > 0.0) {
            *texel = color;
        }
        if self.view.settings.reflection.bounces > 0 {
            drawn.found = self.positions(&first, DVec3::ZERO);
        }
        Ok(RayTraced { milliseconds, first })
    }

    /// The world positions and the coverage of hits whose coordinates are relative to `origin`, which is zero for the
    /// frame's own images.
    fn positions(&self, hits: &[Option<Hit>], origin: DVec3) -> Vec<f32> {
        let texel = |hit: &Option<Hit>| {
            hit.map_or([f32::NAN; 4], |hit| (hit.position + origin).as_vec3().extend(1.0).to_array())
        };
        hits.iter().flat_map(texel).collect()
    }

    /// The images of the first bounce that a method leaves behind, in the form of the renderer's images of the same
    /// names, with positions relative to `origin`.
    pub fn mirror_image(&self, aov: Aov, first: &[Option<Hit>], origin: DVec3) -> Option<AovImage> {
        let vectors = |vector: fn(&Hit) -> DVec3| -> Vec<f32> {
            first.iter().flat_map(|hit| hit.as_ref().map_or(DVec3::NAN, vector).as_vec3().to_array()).collect()
        };
        let data = match aov {
            Aov::MirrorPosition => self.positions(first, self.scene.origin - origin),
            Aov::MirrorAlbedo => vectors(|hit| hit.albedo),
            Aov::MirrorNormal => vectors(|hit| hit.normal),
            _ => return None,
        };
        Some(AovImage { size: self.view.size, channels: aov.channels(), data })
    }

    /// The hits of the reflected ray of each mirror pixel.
    ///
    /// # Errors
    /// Cancelled.
    pub fn first_hits(&self, seen: &[Option<(Hit, DVec3)>], progress: &Progress) -> Result<Vec<Option<Hit>>> {
        let point = |seen: &Option<(Hit, DVec3)>| {
            let (hit, incoming) = seen.filter(|(hit, _)| hit.specular_intensity > 0.0)?;
            Some(MirrorPoint { position: hit.position, normal: hit.normal, incoming })
        };
        let points: Vec<Option<MirrorPoint>> = seen.iter().map(point).collect();
        let mirrors: Vec<MirrorPoint> = points.iter().copied().flatten().collect();
        let reflections = reflected(&self.scene.surfels, &mirrors, 1, progress).ok_or(Error::Cancelled)?;
        let mut reflections = reflections.into_iter();
        Ok(points.iter().map(|point| point.and_then(|_| reflections.next()?.first)).collect())
    }

    /// The frame's lighting, in the form for the ray tracer.
    pub fn illumination(&self) -> Illumination<'_> {
        let Settings { light, sun, gi, trace, mirror, reflection, gloss, view, .. } = self.view.settings;
        let resolved = self.view.settings.resolved_light(!self.lights.is_empty(), self.view.objects.clues);
        let source = match resolved.by {
            Lighting::Lights => Illuminant::Lights(&self.lights),
            Lighting::Sun => Illuminant::Sun(Sunlight::new(sun, self.view.camera.up)),
            Lighting::Auto | Lighting::Surroundings | Lighting::Headlight => {
                Illuminant::Headlight(f64::from(light.headlight))
            }
            Lighting::Colors => Illuminant::Headlight(0.0),
        };
        let [red, green, blue, _] = view.background.bytes().map(linear_from_srgb);
        let (share, power) = (f64::from(light.gloss), f64::from(light.gloss_power));
        let lobe = match gloss.lobe {
            GlossLobe::Phong => Lobe::Even(Highlight::Phong),
            GlossLobe::Blinn => Lobe::Even(Highlight::Blinn),
            GlossLobe::AshikhminShirley => {
                Lobe::Half(HalfLobe { across: f64::from(gloss.across), up: self.view.camera.up.normalize_or(DVec3::Z) })
            }
        };
        Illumination {
            gloss: Gloss { share, power, shape: light.highlight },
            diffuse: f64::from(light.diffuse),
            fill: Fill { radiance: f64::from(resolved.fill), share: f64::from(light.headlight) },
            bounces: reflection.bounces,
            mirror_boxes: &self.scene.mirror_boxes,
            lobe: (gloss.samples > 0).then_some(lobe),
            background: DVec3::new(red, green, blue),
            indirect: Indirect { bounces: gi.bounces, samples: trace.samples, seed: trace.seed },
            ..Illumination::new(source, mirror)
        }
    }

    /// The frame's lighting with what mirrors throw in a truth, if that is asked for.
    ///
    /// # Errors
    /// No exact surfaces, or cancelled.
    fn lit(&self, truth: Truth, progress: &Progress) -> Result<Illumination<'_>> {
        let illumination = self.illumination();
        let count = self.view.settings.trace.photons;
        if count == 0 {
            return Ok(illumination);
        }
        let kept = &self.caustics[truth as usize];
        if kept.get().is_none() {
            // With more photons both noise and blur vanish.
            let radius = self.scene.bounds.radius() / f64::from(count).cbrt();
            let photons = Photons { count, radius, seed: self.seed() };
            let traced = match truth {
                Truth::SameInput => Caustics::traced(&self.scene.surfels, &illumination, photons, progress),
                Truth::Exact => Caustics::traced(self.exact()?, &illumination, photons, progress),
            };
            let traced = traced.ok_or(Error::Cancelled)?;
            kept.get_or_init(|| traced);
        }
        Ok(Illumination { caustics: kept.get(), ..illumination })
    }

    /// The radiance of what is seen, linear red, green and blue; NaN if nothing is seen.
    ///
    /// # Errors
    /// No exact surfaces, or cancelled.
    pub fn colors(&self, truth: Truth, seen: &[Option<(Hit, DVec3)>], progress: &Progress) -> Result<Vec<[f32; 3]>> {
        let illumination = self.lit(truth, progress)?;
        match truth {
            Truth::SameInput => colors_in(&self.scene.surfels, seen, &illumination, progress),
            Truth::Exact if self.view.settings.trace.rays > 1 => {
                self.footprint_colors(self.exact()?, seen, &illumination, progress)
            }
            Truth::Exact => colors_in(self.exact()?, seen, &illumination, progress),
        }
    }

    /// The colours of exact surfaces, those of mirrors as the mean over `trace.rays` rays through the pixel, as far as
    /// these meet the mirror that its centre shows.
    fn footprint_colors(
        &self,
        exact: &Exact,
        seen: &[Option<(Hit, DVec3)>],
        illumination: &Illumination,
        progress: &Progress,
    ) -> Result<Vec<[f32; 3]>> {
        let rays = self.view.settings.trace.rays;
        let color = |(pixel, seen): (usize, &Option<(Hit, DVec3)>)| {
            if progress.is_cancelled() {
                return None;
            }
            progress.add(1);
            let Some((center, direction)) = seen else { return Some([f32::NAN; 3]) };
            if center.specular_intensity <= 0.0 {
                let light = radiance(exact, center, *direction, pixel, illumination);
                return Some(light.as_vec3().to_array());
            }
            let (mut sum, mut count) = (DVec3::ZERO, 0);
            for index in 0..rays {
                let ray = self.rays.ray_of(pixel, index, rays);
                let Some(hit) = exact.nearest(&ray).filter(|hit| hit.surface == center.surface) else { continue };
                sum += radiance(exact, &hit, ray.direction, pixel, illumination);
                count += 1;
            }
            if count == 0 {
                (sum, count) = (radiance(exact, center, *direction, pixel, illumination), 1);
            }
            Some((sum / f64::from(count)).as_vec3().to_array())
        };
        progress.set_total(progress.done() + seen.len() as u64);
        seen.par_iter().enumerate().map(color).collect::<Option<_>>().ok_or(Error::Cancelled)
    }

    /// [`Tracer::colors`] with the same input, but with this number of paths of indirect light and another seed than
    /// the settings'.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn sampled_colors(
        &self,
        seen: &[Option<(Hit, DVec3)>],
        samples: u32,
        seed: u32,
        progress: &Progress,
    ) -> Result<Vec<[f32; 3]>> {
        let illumination = self.lit(Truth::SameInput, progress)?;
        let indirect = Indirect { samples, seed, ..illumination.indirect };
        colors_in(&self.scene.surfels, seen, &Illumination { indirect, ..illumination }, progress)
    }

    /// The number of paths of indirect light, and of rays of glossy mirrors, that the settings ask for; 0 if there is
    /// neither.
    pub(crate) fn samples(&self) -> u32 {
        let Illumination { source, indirect, lobe, .. } = self.illumination();
        let has_light = match source {
            Illuminant::Lights(_) => indirect.bounces > 0,
            Illuminant::Sun(sun) => sun.sky > 0.0 || indirect.bounces > 0,
            Illuminant::Headlight(_) => false,
        };
        if has_light || lobe.is_some() { indirect.samples } else { 0 }
    }

    pub(crate) fn seed(&self) -> u32 {
        self.view.settings.trace.seed
    }

    pub(crate) fn width(&self) -> usize {
        self.view.size[0] as usize
    }

    /// The indirect light that each pixel's own surface sends out, without its mirror reflection, linear red, green and
    /// blue; NaN where nothing is seen.
    ///
    /// # Errors
    /// No exact surfaces, or cancelled.
    pub fn indirect(&self, truth: Truth, seen: &[Option<(Hit, DVec3)>], progress: &Progress) -> Result<Vec<[f32; 3]>> {
        // As in the renderer, a mirror is diffuse if reflections are not followed.
        let bounces = if has_reflections(self.view.settings) { self.view.settings.reflection.bounces } else { 0 };
        let illumination = Illumination { bounces, ..self.lit(truth, progress)? };
        let light = match truth {
            Truth::SameInput => indirect_picture(&self.scene.surfels, seen, &illumination, progress),
            Truth::Exact => indirect_picture(self.exact()?, seen, &illumination, progress),
        };
        let light = light.ok_or(Error::Cancelled)?.into_iter();
        Ok(light.map(|light| light.unwrap_or(DVec3::NAN).as_vec3().to_array()).collect())
    }

    /// Judges the positions found in the mirrors; [`Tracer::image_error`] judges the colours.
    ///
    /// # Errors
    /// No exact surfaces, or cancelled.
    pub fn judge(&self, truth: Truth, drawn: &Drawn, progress: &Progress) -> Result<Accuracy> {
        let image = self.image_of(drawn);
        match truth {
            Truth::SameInput => accuracy_same_input(&image, &self.scene.surfels, progress),
            Truth::Exact => accuracy_exact(&image, &self.rays, self.exact()?, progress),
        }
    }

    /// The error of each filled mirror pixel, with the same input.
    ///
    /// # Errors
    /// Cancelled.
    pub fn pixel_errors(&self, drawn: &Drawn, progress: &Progress) -> Result<Vec<Option<PixelError>>> {
        pixel_errors_same_input(&self.image_of(drawn), &self.scene.surfels, progress)
    }

    fn image_of<'d>(&self, drawn: &'d Drawn) -> MirrorImage<'d> {
        let Drawn { surface: Surface { mirror, position, normal, .. }, found, .. } = drawn;
        let viewpoint = self.rays.viewpoint();
        MirrorImage { size: self.view.size, viewpoint, mirror, position, normal, mirror_position: found }
    }

    /// Compares the frame with traced colours, over the pixels that are mirrors in both.
    pub fn image_error(&self, drawn: &Drawn, seen: &[Option<(Hit, DVec3)>], reference: &[[f32; 3]]) -> ImageError {
        let is_true_mirror = |seen: &Option<(Hit, DVec3)>| seen.is_some_and(|(hit, _)| hit.specular_intensity > 0.0);
        let mirror: Vec<bool> =
            seen.iter().zip(&drawn.surface.mirror).map(|(seen, drawn)| is_true_mirror(seen) && *drawn > 0.0).collect();
        image_error(self.view.size[0] as usize, &mirror, &drawn.color, reference)
    }
}

fn colors_in(
    geometry: &impl Geometry,
    seen: &[Option<(Hit, DVec3)>],
    illumination: &Illumination,
    progress: &Progress,
) -> Result<Vec<[f32; 3]>> {
    progress.set_total(progress.done() + seen.len() as u64);
    let color = |(pixel, seen): (usize, &Option<(Hit, DVec3)>)| {
        if progress.is_cancelled() {
            return None;
        }
        progress.add(1);
        let light = seen.map(|(hit, direction)| radiance(geometry, &hit, direction, pixel, illumination));
        Some(light.unwrap_or(DVec3::NAN).as_vec3().to_array())
    };
    seen.par_iter().enumerate().map(color).collect::<Option<_>>().ok_or(Error::Cancelled)
}

#[cfg(test)]
mod tests;
