//! The image `surface_error`: how far the surface that each pixel shows may be off along the pixel's ray.
//!
//! The renderer knows which point a pixel shows, and the cloud how sure the disc of that point is
//! (`cloud::surface_errors`).

use std::collections::HashMap;
use std::sync::Arc;

use cloud::{Chunk, Progress, error_along, unpack_normal};
use glam::DVec3;
use render::{Aov, AovImage, ChunkId, Renderer};
use scene::{Projection, Settings};
use study::Subject;
use world::{Assembly, Resident};

use crate::system::failure::usage;
use crate::system::{interrupt, progress_bar};

/// The name of the image.
pub const NAME: &str = cloud::SURFACE_ERROR;

/// What each point of the store states: the half width of the interval for its error along its normal.
pub struct SurfaceErrors {
    /// The half widths and the packed normals of the chunks of the store.
    chunks: HashMap<ChunkId, (Vec<f32>, Arc<Vec<u32>>)>,
}

/// Finds out how sure the surface of a cloud in memory is, unless that is known.
///
/// # Errors
/// On Ctrl-C.
pub fn find(loaded: &mut Assembly) -> anyhow::Result<()> {
    if !loaded.lacks_errors() {
        return Ok(());
    }
    let progress = Progress::default();
    let errors = progress_bar::watch("certainty", &progress, || world::surface_errors(&loaded.cloud, &progress));
    interrupt::check()?;
    drop(errors.map(|errors| loaded.put_errors(errors)));
    Ok(())
}

/// Refuses clouds that are streamed: what is in memory of them depends on the view.
///
/// # Errors
/// If one is: bad usage.
pub fn check(clouds: &[Assembly]) -> anyhow::Result<()> {
    match clouds.iter().find(|loaded| loaded.pages.is_some()) {
        Some(streamed) => Err(usage(format!(
            "--aov: `{NAME}` needs all points in memory, and {} is streamed; set stream.pages to never, or take a part \
             of it",
            streamed.cloud.name
        ))),
        None => Ok(()),
    }
}

impl SurfaceErrors {
    /// What was found of the clouds, and what points on the formulas of mirrors state (`mirrors`, by their clouds).
    pub fn of(resident: &Resident, clouds: &[Assembly], mirrors: &[Vec<Chunk>]) -> Self {
        let mut chunks = HashMap::new();
        for loaded in clouds {
            for (part, chunk) in loaded.chunks() {
                let column = loaded.error_column().and_then(|column| chunk.columns.get(column)?.clone());
                let (Some(column), Some(normals)) = (column, &chunk.normals) else { continue };
                let errors: Vec<f32> = (0..chunk.len()).map(|point| column.value(point) as f32).collect();
                for (id, indices) in resident.places_of(loaded.key.chunk(part)) {
                    let own = match indices {
                        Some(indices) => (
                            indices.iter().map(|index| errors[*index as usize]).collect(),
                            Arc::new(indices.iter().map(|index| normals[*index as usize]).collect()),
                        ),
                        None => (errors.clone(), normals.clone()),
                    };
                    chunks.insert(id, own);
                }
            }
        }
        for (index, samples) in mirrors.iter().enumerate() {
            let key = world::CloudKey((clouds.len() + index) as u32);
            let errors = cloud::surface_errors(samples, &Progress::default()).unwrap_or_default();
            for (chunk, errors) in samples.iter().zip(errors) {
                let Some(normals) = &chunk.normals else { continue };
                for (id, _) in resident.places_of(key.chunk(world::Part::Block(chunk.first_point))) {
                    chunks.insert(id, (errors.clone(), normals.clone()));
                }
            }
        }
        Self { chunks }
    }

    /// The image of the frame that was rendered last: half widths along the rays of the pixels, in world units. Not a
    /// number where nothing is shown, and where a point states nothing.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn image(&self, renderer: &Renderer, subject: &Subject, settings: &Settings) -> render::Result<AovImage> {
        let camera = &subject.camera;
        let AovImage { size, data: positions, .. } = renderer.read_aov_from(Aov::Position, camera.eye)?;
        let shown = renderer.shown_points(&subject.store)?;
        let error = |(pixel, shown): (usize, &Option<(ChunkId, usize)>)| {
            let (chunk, point) = (*shown)?;
            let (errors, normals) = self.chunks.get(&chunk)?;
            let normal = unpack_normal(*normals.get(point)?)?.as_dvec3();
            let way = DVec3::from([0, 1, 2].map(|axis| f64::from(positions[3 * pixel + axis])));
            let direction = match settings.view.projection {
                Projection::Orthographic => camera.forward(),
                Projection::Perspective => way.try_normalize()?,
            };
            Some(error_along(errors[point].into(), normal, direction) as f32)
        };
        let data = shown.iter().enumerate().map(|pixel| error(pixel).unwrap_or(f32::NAN)).collect();
        Ok(AovImage { size, channels: &["Y"], data })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use scene::Tripod;

    use super::*;
    use crate::commands::subject::{self, LoadedSubject};
    use crate::viewer::bench::devices;

    const SIZE: [u32; 2] = [80, 60];

    #[test]
    fn each_pixel_states_what_its_point_does_along_its_ray() {
        let Some([_, gpu]) = devices() else { return };
        let mut settings = Tripod::Mixed.settings();
        settings.scene.points = 60_000;
        settings.reflection.method = scene::Method::None;
        let camera = Tripod::Mixed.camera();
        let request = world::resolve(&["tripod/mixed"]);
        let opened = subject::open(&gpu, request, &settings, SIZE, true, |_, _, _| camera).unwrap();
        let LoadedSubject { subject, errors, .. } = opened.unwrap();
        // The chunks of the store are those of the parts, in their order.
        let stated = subject.parts.iter().flat_map(|part| {
            let errors = cloud::surface_errors(&part.cloud.chunks, &Progress::default()).unwrap();
            part.cloud.chunks.iter().cloned().zip(errors).collect::<Vec<_>>()
        });
        let stated: Vec<(Chunk, Vec<f32>)> = stated.collect();
        let mut renderer = Renderer::new(gpu).unwrap();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            settings.view.projection = projection;
            subject.render(&mut renderer, &settings, SIZE).unwrap();
            let image = errors.as_ref().unwrap().image(&renderer, &subject, &settings).unwrap();
            let depth = renderer.read_aov(Aov::Depth).unwrap().data;
            let mut ids: Vec<ChunkId> = Vec::new();
            let pick = |pixel: [u32; 2]| renderer.pick(&subject.store, pixel, 1).unwrap();
            let pixels = || (0..SIZE[0] * SIZE[1]).map(|pixel| [pixel % SIZE[0], pixel / SIZE[0]]);
            ids.extend(errors.as_ref().unwrap().chunks.keys());
            ids.sort();
            assert_eq!(ids.len(), stated.len());
            let mut compared = 0;
            for pixel in pixels() {
                let at = (pixel[1] * SIZE[0] + pixel[0]) as usize;
                let found = image.data[at];
                assert!(found.is_nan() || !depth[at].is_nan(), "{pixel:?}: nothing is shown, and {found} stated");
                // Where a gap was closed, the point is another pixel's.
                let Some(picked) = pick(pixel).filter(|picked| picked.pixel == pixel) else { continue };
                let (chunk, errors) = &stated[ids.binary_search(&picked.chunk).unwrap()];
                let normal = unpack_normal(chunk.normals.as_ref().unwrap()[picked.index]).unwrap().as_dvec3();
                let half = DVec2::from(SIZE.map(f64::from)) / 2.0;
                let place = DVec2::new(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5) - half;
                let slope = (f64::from(settings.view.field_of_view).to_radians() / 2.0).tan() / half.y;
                let across = if projection == Projection::Perspective { place * slope } else { DVec2::ZERO };
                let way = DVec3::new(across.x, -across.y, 1.0).normalize();
                let cosine = (camera.view_from_world() * normal).dot(way).abs();
                let expected = f64::from(errors[picked.index]) / cosine;
                assert!((f64::from(found) / expected - 1.0).abs() < 1e-3, "{pixel:?}: {found}, expected {expected}");
                compared += 1;
            }
            assert!(compared > SIZE[0] * SIZE[1] / 2, "{compared} pixels");
        }
    }
}
