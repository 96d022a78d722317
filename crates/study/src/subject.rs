//! What pictures are made of and judged by: a scene in memory and on the GPU, and what looks at it.

use std::sync::Arc;

use cloud::{Chunk, Cloud};
use glam::{DVec3, Vec3};
use render::{ColorPlan, ColorSource, FrameStats, Gpu, Material, Objects, PointStore, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, ColorBy, Mirror, Settings, SpotLight};
use trace::Exact;

/// A scene that is loaded.
pub struct Subject {
    /// The points in memory, as they were uploaded to `store`.
    pub parts: Vec<Part>,
    pub store: PointStore,
    pub mirrors: Vec<Mirror>,
    pub lights: Vec<SpotLight>,
    /// As in [`Objects`].
    pub sky_is_open: bool,
    pub camera: Camera,
    /// The formulas behind the points, if there are any.
    pub exact: Option<Exact>,
}

/// Points of one material.
pub struct Part {
    pub cloud: Cloud,
    pub specular_intensity: f32,
    pub specular_power: f32,
    pub plan: ColorPlan,
    /// Unit vector.
    pub up: DVec3,
}

impl Subject {
    /// One of the five mirrors; `settings.scene` says how many points.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn five_mirrors(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> anyhow::Result<Self> {
        let parts = five_mirrors::sample(variant, settings.scene.points.into(), settings.scene.seed.into());
        let exact = Exact::five_mirrors(variant);
        Self::sampled(gpu, parts, vec![five_mirrors::light()], five_mirrors::camera(), Some(exact), settings)
    }

    /// A scene that was sampled from formulas. Its mirrors are those of the parts.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn sampled(
        gpu: &Arc<Gpu>,
        parts: Vec<five_mirrors::Part>,
        lights: Vec<SpotLight>,
        camera: Camera,
        exact: Option<Exact>,
        settings: &Settings,
    ) -> anyhow::Result<Self> {
        let up = camera.up;
        let mut store = PointStore::new(gpu.clone());
        store.reserve(parts.iter().flat_map(|part| &part.chunks).map(|chunk| chunk.len() as u64).sum());
        let mirrors = parts.iter().filter_map(|part| part.mirror.clone()).collect();
        let mut kept = Vec::new();
        for five_mirrors::Part { chunks, mirror } in parts {
            let material = mirror.as_ref().map_or(Material::default(), |mirror| Material {
                specular_intensity: mirror.specular_intensity,
                specular_power: mirror.specular_power,
                has_formula: true,
                as_points: mirror.as_points,
            });
            let id = store.add_cloud(material);
            let ids: Vec<_> =
                chunks.iter().map(|chunk| store.add_chunk(id, chunk, None)).collect::<render::Result<_>>()?;
            let cloud = Cloud { chunks, ..Cloud::default() };
            let part = match mirror {
                Some(mirror) => Part::of_mirror(&mirror, cloud),
                None => Part {
                    plan: ColorPlan::new(&cloud, &settings.color, up).0,
                    cloud,
                    specular_intensity: 0.0,
                    specular_power: 0.0,
                    up,
                },
            };
            store.set_color(id, &part.cloud, &ids, &part.plan, up)?;
            kept.push(part);
        }
        Ok(Self { parts: kept, store, mirrors, lights, sky_is_open: false, camera, exact })
    }

    pub fn objects(&self) -> Objects<'_> {
        Objects { mirrors: &self.mirrors, lights: &self.lights, sky_is_open: self.sky_is_open }
    }

    /// Renders a frame from scratch.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn render(&self, renderer: &mut Renderer, settings: &Settings, size: [u32; 2]) -> render::Result<FrameStats> {
        renderer.forget();
        renderer.render(&self.store, &self.camera, settings, self.objects(), size)
    }
}

impl Part {
    /// The points that stand for a mirror.
    pub fn of_mirror(mirror: &Mirror, samples: Cloud) -> Self {
        let own = scene::Color { by: ColorBy::Rgb, ..scene::Color::default() };
        let (plan, _) = ColorPlan::new(&samples, &own, DVec3::Z);
        let Mirror { specular_intensity, specular_power, .. } = *mirror;
        Self { cloud: samples, specular_intensity, specular_power, plan, up: DVec3::Z }
    }

    /// The colour of points that have none of their own, sRGB.
    pub(crate) fn plain(&self) -> [u8; 4] {
        if self.plan.source == ColorSource::Rgb { [u8::MAX; 4] } else { self.plan.plain }
    }

    /// The points in the colours that they are drawn in, with places from `origin`.
    pub(crate) fn painted(&self, origin: DVec3) -> Vec<Chunk> {
        let ramp = render::ramp_colors(self.plan.ramp);
        let classes = self.cloud.attributes.iter().position(|attribute| attribute.name == "classification");
        let axis = self.up.abs().max_position();
        let on_ramp = |value: f64| {
            let range = self.plan.high - self.plan.low;
            let share = if range > 0.0 { (value - self.plan.low) / range } else { 0.0 };
            ramp[(share.clamp(0.0, 1.0) * 255.0).round() as usize]
        };
        let paint = |chunk: &Chunk| -> Option<Vec<[u8; 4]>> {
            let each = |color: &dyn Fn(usize) -> [u8; 4]| Some((0..chunk.len()).map(color).collect());
            let column = |index: usize| chunk.columns.get(index)?.as_deref();
            match self.plan.source {
                ColorSource::Rgb => chunk.colors.as_ref().map(|colors| colors.to_vec()),
                ColorSource::Plain => None,
                ColorSource::Height => each(&|point| on_ramp(chunk.position(point)[axis])),
                ColorSource::Column(index) => {
                    let values = column(index)?;
                    each(&|point| on_ramp(values.value(point)))
                }
                ColorSource::Class => {
                    let values = column(classes?)?;
                    each(&|point| render::class_color(values.value(point) as u8))
                }
                ColorSource::Normal => {
                    let normals = chunk.normals.as_ref()?;
                    each(&|point| {
                        let normal = cloud::unpack_normal(normals[point]).unwrap_or(Vec3::ZERO);
                        let [red, green, blue] =
                            (normal * 0.5 + 0.5).to_array().map(|share| (share * 255.0).round() as u8);
                        [red, green, blue, u8::MAX]
                    })
                }
            }
        };
        let chunks = self.cloud.chunks.iter();
        chunks
            .map(|chunk| {
                let colors = paint(chunk).map(Arc::new);
                Chunk { origin: chunk.origin - origin, colors, columns: Vec::new(), ..chunk.clone() }
            })
            .collect()
    }
}
