//! Reads back the last frame: its picture, its linear images, the point under a pixel.

use glam::DVec3;
use scene::Settings;

use crate::frame::FrameCamera;
use crate::gpu::{Error, Result};
use crate::handed::PictureRows;
use crate::identities::{ChunkId, CloudId};
use crate::image::{Aov, AovImage};
use crate::layout::SAME_SURFACE;
use crate::quick::{KnownLight, StillImages, StillMirrors};
use crate::reflection::Reflections;
use crate::renderer::{Frame, Renderer, nothing_rendered};
use crate::store::PointStore;
use crate::targets::{Image, Targets};

/// How many pixels beside a closed one a point is searched that it shows.
const CLOSED_REACH: usize = 8;

/// The point under a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    pub cloud: CloudId,
    pub chunk: ChunkId,
    /// The index in the chunk.
    pub index: usize,
    pub linear_depth: f32,
    pub pixel: [u32; 2],
}

impl Renderer {
    /// The last frame's picture, RGBA8 sRGB, rows top to bottom.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read_picture(&self) -> Result<Vec<u8>> {
        Ok(self.picture_rows()?.tight())
    }

    /// The last picture where it lies, with rows that may be filled up to a stride.
    ///
    /// # Errors
    /// Those of `read_picture`.
    pub fn picture_rows(&self) -> Result<PictureRows> {
        self.handed.picture()?.ok_or_else(nothing_rendered)
    }

    /// One of the last frame's linear images.
    ///
    /// # Errors
    /// Nothing was rendered yet, no reflections for an image of them, or the device was lost.
    pub fn read_aov(&self, aov: Aov) -> Result<AovImage> {
        self.read_aov_from(aov, DVec3::ZERO)
    }

    /// An image of the last frame with positions relative to `origin`: 32-bit world coordinates of a survey are no
    /// finer than half a metre.
    ///
    /// # Errors
    /// Those of `read_aov`.
    pub fn read_aov_from(&self, aov: Aov, origin: DVec3) -> Result<AovImage> {
        let targets = self.rendered()?;
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let surface = targets.surface();
        let read = |image: &Image| self.gpu.read_texture(&image.texture);
        let depth = floats32(&read(&surface.depth)?);
        let bounce = self.reflections.as_ref().and_then(Reflections::first);
        if bounce.is_none() && aov.is_of_mirrors() {
            // No mirror could be seen.
            let values = depth.len() * aov.channels().len();
            return Ok(AovImage { size: targets.size, channels: aov.channels(), data: vec![f32::NAN; values] });
        }
        let first = || bounce.ok_or_else(nothing_rendered);
        let per_pixel: Vec<f32> = match aov {
            Aov::Depth => depth.clone(),
            Aov::Normal | Aov::SpecularPower => floats32(&read(&surface.normal)?),
            Aov::Albedo | Aov::Mirror | Aov::SpecularIntensity => floats16(&read(&surface.albedo)?),
            Aov::Color => floats16(&read(&targets.color)?),
            Aov::Direct => floats16(&read(&targets.direct)?),
            Aov::Indirect => match self.gi.radiance(0).filter(|_| self.lit.is_some()) {
                Some(radiance) => floats16(&read(radiance)?),
                None => vec![0.0; depth.len() * 4],
            },
            Aov::Position => Vec::new(),
            Aov::MirrorPosition => floats32(&read(&first()?.seen.position)?),
            Aov::MirrorAlbedo => floats16(&read(&first()?.seen.albedo)?),
            Aov::MirrorNormal => floats32(&read(&first()?.seen.normal)?),
            Aov::Curvature | Aov::Regions => floats32(&read(self.regions()?)?),
            Aov::Uncertain => in_fours(floats32(&read(self.doubt()?)?)),
            Aov::Refraction => match self.reflections.as_ref().and_then(Reflections::refraction) {
                Some(index) => in_fours(floats32(&read(index)?)),
                None => vec![0.0; depth.len() * 4],
            },
        };
        let coverage = match aov {
            Aov::MirrorAlbedo | Aov::MirrorNormal => floats32(&read(&first()?.seen.position)?),
            _ => Vec::new(),
        };
        let mirror = if aov.is_of_mirrors() { floats32(&read(&first()?.mirror.point)?) } else { Vec::new() };
        let is_mirror = |pixel: usize| mirror[pixel * 4 + 3] > 0.0;
        let width = targets.size[0] as usize;
        let channels = aov.channels();
        let mut data = Vec::with_capacity(depth.len() * channels.len());
        for (pixel, &depth) in depth.iter().enumerate() {
            let four = || &per_pixel[pixel * 4..pixel * 4 + 4];
            let is_empty = match aov {
                Aov::MirrorPosition => !is_mirror(pixel) || four()[3] == 0.0,
                Aov::MirrorAlbedo | Aov::MirrorNormal => !is_mirror(pixel) || coverage[pixel * 4 + 3] == 0.0,
                Aov::Curvature | Aov::Regions | Aov::Uncertain => !is_mirror(pixel),
                _ => depth == 0.0,
            };
            if is_empty {
                data.extend(channels.iter().map(|_| f32::NAN));
                continue;
            }
            match aov {
                Aov::Depth => data.push((f64::from(depth) - camera.moved_back) as f32),
                Aov::Mirror => data.push(if four()[3] > 0.0 { 1.0 } else { 0.0 }),
                Aov::SpecularIntensity | Aov::SpecularPower => data.push(four()[3]),
                Aov::Position => {
                    let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                    data.extend((camera.world_from_pixel(x, y, f64::from(depth)) - origin).as_vec3().to_array());
                }
                Aov::MirrorPosition => {
                    let from = camera.eye - origin;
                    let [x, y, z] = [0, 1, 2].map(|axis| (f64::from(four()[axis]) + from[axis]) as f32);
                    data.extend([x, y, z, four()[3]]);
                }
                // Without the bits of views, and the one that only says that there is a mirror.
                Aov::Curvature => data.push((four()[0] as u32 & 63) as f32),
                Aov::Regions => data.push(four()[1]),
                Aov::Uncertain | Aov::Refraction => data.push(four()[0]),
                _ => data.extend(&four()[..3]),
            }
        }
        Ok(AovImage { size: targets.size, channels, data })
    }

    /// The point drawn nearest to a pixel, at most `radius` pixels from it; where a gap was closed, a point beside it.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn pick(&self, store: &PointStore, pixel: [u32; 2], radius: u32) -> Result<Option<Picked>> {
        let targets = self.rendered()?;
        let [width, height] = targets.size;
        if pixel[0] >= width || pixel[1] >= height {
            return Ok(None);
        }
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let radius = radius.max(1);
        let (top, bottom) = (pixel[1].saturating_sub(radius), (pixel[1] + radius).min(height - 1));
        let row_bytes = u64::from(width) * 8;
        let rows = u64::from(bottom - top + 1);
        let bytes = self.gpu.read_buffer(&targets.nearest, u64::from(top) * row_bytes, rows * row_bytes)?;
        let words: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
        let shown = floats32(&self.gpu.read_rows(&targets.surface().depth.texture, top, bottom - top + 1)?);
        let (left, right) = (pixel[0].saturating_sub(radius), (pixel[0] + radius).min(width - 1));
        let mut best: Option<(u32, [u32; 2], [u32; 2])> = None;
        for y in top..=bottom {
            for x in left..=right {
                let place = ((y - top) * width + x) as usize;
                let word = words[place];
                let distance = x.abs_diff(pixel[0]).pow(2) + y.abs_diff(pixel[1]).pow(2);
                let is_seen = is_seen(word, shown[place], &camera);
                if is_seen && best.is_none_or(|(least, ..)| distance < least) {
                    best = Some((distance, [x, y], word));
                }
            }
        }
        let Some((_, pixel, [identity, nearness])) = best else { return Ok(None) };
        let linear_depth = f32::from_bits(u32::MAX - nearness);
        Ok(store.find(identity, &self.drawn).map(|(cloud, chunk, index)| Picked {
            cloud,
            chunk,
            index,
            linear_depth,
            pixel,
        }))
    }

    /// For each pixel of the last frame the point that it shows, as its chunk and its index there, rows top to bottom. Where
    /// a gap was closed, a point at most `CLOSED_REACH` pixels beside it. `None` where nothing is shown, and amid larger
    /// gaps.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn shown_points(&self, store: &PointStore) -> Result<Vec<Option<(ChunkId, usize)>>> {
        let targets = self.rendered()?;
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let [width, height] = targets.size.map(|length| length as usize);
        let bytes = self.gpu.read_buffer(&targets.nearest, 0, (width * height * 8) as u64)?;
        let words: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
        let shown = floats32(&self.gpu.read_texture(&targets.surface().depth.texture)?);
        let is_seen = |pixel: usize| is_seen(words[pixel], shown[pixel], &camera);
        let point = |pixel: usize| store.find(words[pixel][0], &self.drawn).map(|(_, chunk, index)| (chunk, index));
        let beside = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let columns = x.saturating_sub(CLOSED_REACH)..(x + CLOSED_REACH + 1).min(width);
            let rows = y.saturating_sub(CLOSED_REACH)..(y + CLOSED_REACH + 1).min(height);
            let around = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
            let distance = |&(column, row): &(usize, usize)| column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2);
            let nearest = around.filter(|(column, row)| is_seen(row * width + column)).min_by_key(distance);
            nearest.and_then(|(column, row)| point(row * width + column))
        };
        let of_pixel = |pixel: usize| match shown[pixel] > 0.0 {
            true if is_seen(pixel) => point(pixel),
            true => beside(pixel),
            false => None,
        };
        Ok((0..width * height).map(of_pixel).collect())
    }

    /// The curvature and the regions of the mirror pixels of the last frame.
    fn regions(&self) -> Result<&Image> {
        let views = self.reflections.as_ref().and_then(Reflections::views).filter(|views| views.has_regions);
        let image = views.map(|views| views.image);
        image.ok_or_else(|| Error::NotRendered("only the method sscr has a curvature map and regions".into()))
    }

    fn doubt(&self) -> Result<&Image> {
        self.reflections.as_ref().map(|reflections| &reflections.doubt).ok_or_else(nothing_rendered)
    }

    /// The light on the surfaces of the last frame, for quick pictures of other views.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn known_light(&self, settings: &Settings) -> Result<KnownLight> {
        let targets = self.rendered()?;
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let surface = targets.surface();
        let read = |image: &Image| self.gpu.read_texture(&image.texture);
        let mirrors = match self.reflections.as_ref().and_then(Reflections::first) {
            Some(bounce) => Some(StillMirrors {
                normal: floats32(&read(&surface.normal)?),
                seen: floats32(&read(&bounce.seen.position)?),
                refraction: match self.reflections.as_ref().and_then(Reflections::refraction) {
                    Some(index) => floats32(&read(index)?),
                    None => Vec::new(),
                },
            }),
            None => None,
        };
        let images = StillImages {
            depth: floats32(&read(&surface.depth)?),
            albedo: floats16(&read(&surface.albedo)?),
            color: floats16(&read(&targets.color)?),
            mirrors,
        };
        Ok(KnownLight::new(camera, images, self.stops(settings)?, self.is_filmic))
    }

    /// The light in another view from the eye of the last frame, which the same lights and virtual lights shine into; where
    /// `frame` moves, by the shadow map of a sun that shows the whole scene. Nothing of the last frame is lost. `None` if the
    /// view has another eye, a parallel projection, or light by rays, which are traced for each view.
    ///
    /// # Errors
    /// A shader is refused, there is no memory, the frame was given up, or the device was lost.
    pub fn light_around(&mut self, store: &PointStore, frame: &Frame<'_>) -> Result<Option<KnownLight>> {
        let Some((camera, targets, has_indirect)) = self.shade_around(store, frame)? else { return Ok(None) };
        let read = |image: &Image| self.gpu.read_texture(&image.texture);
        let mut color = floats16(&read(&targets.direct)?);
        if let Some(indirect) = self.gi.met().filter(|_| has_indirect) {
            color.iter_mut().zip(floats16(&read(indirect)?)).for_each(|(direct, indirect)| *direct += indirect);
        }
        let surface = targets.surface();
        let images = StillImages {
            depth: floats32(&read(&surface.depth)?),
            albedo: floats16(&read(&surface.albedo)?),
            color,
            mirrors: None,
        };
        Ok(Some(KnownLight::new(camera, images, self.stops(frame.settings)?, self.is_filmic)))
    }

    /// The stops that the last frame's picture was brightened by; it had this `tone.exposure`.
    ///
    /// # Errors
    /// The device was lost.
    fn stops(&self, settings: &Settings) -> Result<f32> {
        let fitted = self.handed.exposure()?.filter(|_| self.exposure.is_used);
        Ok(fitted.map_or(settings.tone.exposure, |fitted| fitted.stops))
    }

    fn rendered(&self) -> Result<&Targets> {
        self.targets.as_ref().ok_or_else(nothing_rendered)
    }
}

/// Whether the nearest point of a pixel is what is shown at this depth: the point behind a closed gap is not visible.
fn is_seen([_, nearness]: [u32; 2], shown: f32, camera: &FrameCamera) -> bool {
    let same = SAME_SURFACE * if camera.orthographic { camera.reference_depth as f32 } else { shown };
    nearness != 0 && f32::from_bits(u32::MAX - nearness) <= shown + same
}

/// One value a pixel as four, which the other images have.
fn in_fours(values: Vec<f32>) -> Vec<f32> {
    values.into_iter().flat_map(|value| [value, 0.0, 0.0, 0.0]).collect()
}

fn floats32(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

fn floats16(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
}
