//! A built-in scene on the GPU and in the ray tracer, and what a setting costs and is worth on it.

use std::sync::Arc;

use cloud::{Cloud, Progress};
use glam::DVec3;
use render::{Aov, ColorPlan, FrameStats, Gpu, Material, Objects, PointStore, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Mirror, Settings, SpotLight};
use trace::{Exact, Part, PixelRays, Surfels};

use crate::accuracy::{MirrorImage, accuracy_exact, accuracy_same_input};
use crate::metrics::Accuracy;

/// One of the five mirrors, loaded.
pub struct Stage {
    pub variant: Variant,
    store: PointStore,
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    surfels: Surfels,
    exact: Exact,
}

impl Stage {
    /// Samples and uploads the scene; `settings.scene` says how many points.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn new(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> anyhow::Result<Self> {
        let parts = five_mirrors::sample(variant, settings.scene.points.into(), settings.scene.seed.into());
        let mut store = PointStore::new(gpu.clone());
        store.reserve(settings.scene.points.into());
        for part in &parts {
            let material = part.mirror.as_ref().map_or(Material::default(), |mirror| Material {
                specular_intensity: mirror.specular_intensity,
                specular_power: mirror.specular_power,
                has_formula: true,
                as_points: mirror.as_points,
            });
            let id = store.add_cloud(material);
            let ids: Vec<_> =
                part.chunks.iter().map(|chunk| store.add_chunk(id, chunk, None)).collect::<render::Result<_>>()?;
            let cloud = Cloud { chunks: part.chunks.clone(), ..Default::default() };
            let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Y);
            store.set_color(id, &cloud, &ids, &plan, DVec3::Y)?;
        }
        let plain = [0.5; 3];
        let traced: Vec<Part<'_>> = parts
            .iter()
            .map(|part| {
                let specular_intensity = part.mirror.as_ref().map_or(0.0, |mirror| mirror.specular_intensity);
                Part { chunks: &part.chunks, specular_intensity, specular_power: 0.0, plain }
            })
            .collect();
        let surfels = Surfels::new(&traced, settings.splat.size, &Progress::default());
        let surfels = surfels.ok_or_else(|| anyhow::anyhow!("the index of the ray tracer was cancelled"))?;
        Ok(Self {
            variant,
            store,
            mirrors: variant.mirrors(),
            lights: vec![five_mirrors::light()],
            surfels,
            exact: Exact::five_mirrors(variant),
        })
    }

    /// Renders a frame from scratch.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn render(&self, renderer: &mut Renderer, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        renderer.forget();
        let objects = Objects { mirrors: &self.mirrors, lights: &self.lights, ..Objects::default() };
        Ok(renderer.render(&self.store, &five_mirrors::camera(), settings, objects, size)?)
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
        // The box's half diagonal, and the eye's distance.
        let rays = PixelRays::new(&five_mirrors::camera(), &settings.view, size, 10.0);
        let read = |aov| renderer.read_aov(aov).map(|image| image.data);
        let (mirror, position, normal, found) =
            (read(Aov::Mirror)?, read(Aov::Position)?, read(Aov::Normal)?, read(Aov::MirrorPosition)?);
        let image = MirrorImage {
            size,
            viewpoint: rays.viewpoint(),
            mirror: &mirror,
            position: &position,
            normal: &normal,
            mirror_position: &found,
        };
        let progress = Progress::default();
        let same_input = accuracy_same_input(&image, &self.surfels, &progress)?;
        Ok((same_input, accuracy_exact(&image, &rays, &self.exact, &progress)?))
    }
}
