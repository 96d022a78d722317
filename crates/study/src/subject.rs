//! The subject of pictures and figures: a scene in memory and on the GPU, with its camera.

use std::sync::Arc;

use cloud::{Chunk, Cloud, Progress, RadiusRule, SurfelOptions};
use glam::{DVec3, Vec3};
use render::{ColorPlan, ColorSource, Frame, FrameStats, Gpu, Material, Objects, PointStore, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, ColorBy, LightClues, Mirror, Settings, SpotLight};
use trace::{Clear, Exact, Mesh, Vertex, linear_from_srgb};

/// A loaded scene.
pub struct Subject {
    /// The points in memory, as they were uploaded to `store`.
    pub parts: Vec<SubjectPart>,
    pub store: PointStore,
    pub mirrors: Vec<Mirror>,
    pub lights: Vec<SpotLight>,
    /// The clues to automatic light, as in [`Objects`].
    pub clues: LightClues,
    pub camera: Camera,
    /// The surfaces behind the points, if they are known.
    pub exact: Option<Exact>,
}

/// The faces of a mesh file.
pub struct Faces {
    /// The triangles, by the vertices' indices in the file.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the vertices' normals are the file's own.
    pub has_normals: bool,
}

/// Points of one material.
pub struct SubjectPart {
    pub cloud: Cloud,
    pub specular_intensity: f32,
    pub specular_power: f32,
    /// Set if light goes through the points.
    pub clear: Option<Clear>,
    pub plan: ColorPlan,
    /// The up direction, a unit vector.
    pub up: DVec3,
}

impl Subject {
    /// One of the five mirrors; `settings.scene` gives the number of points. Normals and radii of a made scan are
    /// estimated with the default parameters, but for `surface.carve`.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn five_mirrors(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> anyhow::Result<Self> {
        let mut parts = five_mirrors::sample(variant, settings.scene.points.into(), settings.scene.seed.into());
        for part in parts.iter_mut().filter(|part| part.chunks.iter().any(|chunk| chunk.radii.is_none())) {
            let of_scan = SurfelOptions::of_scan(&part.chunks, variant.camera().up.as_vec3(), variant.scanner());
            let seen_from = of_scan.seen_from.filter(|_| settings.surface.carve);
            let options = SurfelOptions { radii: RadiusRule::Spread, seen_from, ..of_scan };
            let estimated = cloud::estimate(&part.chunks, &options, &Progress::default()).unwrap_or_default();
            for (chunk, surfels) in part.chunks.iter_mut().zip(estimated) {
                (chunk.normals, chunk.radii) = (Some(surfels.normals.into()), Some(surfels.radii.into()));
            }
        }
        let exact = Exact::five_mirrors(variant);
        let lights = variant.light().into_iter().collect();
        Self::sampled(gpu, parts, lights, variant.camera(), Some(exact), settings)
    }

    /// A scene that was sampled from formulas. Its mirrors are those of the parts.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn sampled(
        gpu: &Arc<Gpu>,
        parts: Vec<five_mirrors::SampledPart>,
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
        for five_mirrors::SampledPart { chunks, mirror } in parts {
            let material = mirror.as_ref().map_or(Material::default(), Material::of_mirror);
            let id = store.add_cloud(material);
            let ids: Vec<_> =
                chunks.iter().map(|chunk| store.add_chunk(id, chunk, None)).collect::<render::Result<_>>()?;
            let cloud = Cloud { chunks, ..Cloud::default() };
            let part = match mirror {
                Some(mirror) => SubjectPart::of_mirror(&mirror, cloud),
                None => SubjectPart {
                    plan: ColorPlan::new(&cloud, &settings.color, up).0,
                    cloud,
                    specular_intensity: 0.0,
                    specular_power: 0.0,
                    clear: None,
                    up,
                },
            };
            store.set_color(id, &part.cloud, &ids, &part.plan, up)?;
            kept.push(part);
        }
        Ok(Self { parts: kept, store, mirrors, lights, clues: LightClues::default(), camera, exact })
    }

    /// Adds the surfaces behind clouds whose points are the vertices of meshes: their triangles, in the colours in
    /// which the vertices are drawn, and the formulas of the mirrors. `faces` are those of each cloud, in order. `None`
    /// where points of the clouds are mirrors, or if no triangle is visible.
    pub fn surfaces_of_meshes(&self, faces: &[Faces]) -> Option<Exact> {
        if faces.is_empty() || self.parts.len() != faces.len() + self.mirrors.len() {
            return None;
        }
        let meshes: Vec<Mesh> = self.parts.iter().zip(faces).map(|(part, faces)| part.mesh(faces)).collect();
        let is_seen = meshes.iter().any(|mesh| !mesh.is_empty());
        is_seen.then(|| Exact::of_mirrors(&self.mirrors).with_meshes(meshes))
    }

    pub fn objects(&self) -> Objects<'_> {
        Objects { mirrors: &self.mirrors, lights: &self.lights, clues: self.clues }
    }

    /// Renders a frame from scratch.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn render(&self, renderer: &mut Renderer, settings: &Settings, size: [u32; 2]) -> render::Result<FrameStats> {
        renderer.forget();
        self.render_next(renderer, settings, size)
    }

    /// Renders a frame with what the renderer kept of those before.
    ///
    /// # Errors
    /// Those of [`Self::render`].
    pub fn render_next(
        &self,
        renderer: &mut Renderer,
        settings: &Settings,
        size: [u32; 2],
    ) -> render::Result<FrameStats> {
        renderer.render(&self.store, &Frame::new(&self.camera, settings, self.objects(), size))
    }
}

/// Points of a cloud that a scene makes clear, as the ray tracer takes them: what is behind them is seen through one
/// interface.
pub fn clear_points(material: &Material) -> Option<Clear> {
    material.is_clear().then(|| Clear { index: f64::from(material.refraction), is_solid: false })
}

impl SubjectPart {
    /// The points that represent a mirror.
    pub fn of_mirror(mirror: &Mirror, samples: Cloud) -> Self {
        let own = scene::Color { by: ColorBy::Rgb, ..scene::Color::default() };
        let (plan, _) = ColorPlan::new(&samples, &own, DVec3::Z);
        let Mirror { specular_intensity, specular_power, .. } = *mirror;
        let is_solid = mirror.shape.is_closed();
        let clear = mirror.refraction.map(|index| Clear { index: f64::from(index), is_solid });
        Self { cloud: samples, specular_intensity, specular_power, clear, plan, up: DVec3::Z }
    }

    /// The sRGB colour of points without a colour of their own.
    pub(crate) fn plain(&self) -> [u8; 4] {
        match self.plan.source {
            ColorSource::Rgb | ColorSource::RgbOr(_) => [u8::MAX; 4],
            _ => self.plan.plain,
        }
    }

    /// The points of the file as the vertices of these triangles.
    fn mesh(&self, faces: &Faces) -> Mesh {
        let linear = |[red, green, blue, _]: [u8; 4]| {
            let [red, green, blue] = [red, green, blue].map(|value| linear_from_srgb(value) as f32);
            Vec3::new(red, green, blue)
        };
        let plain = linear(self.plain());
        let (mut vertices, mut starts) = (Vec::new(), Vec::new());
        let chunks = self.painted(DVec3::ZERO);
        for chunk in chunks.iter().filter(|chunk| chunk.corners.is_none()) {
            starts.push((chunk.first_point, vertices.len()));
            vertices.extend((0..chunk.len()).map(|point| {
                let normal = chunk.normals.as_ref().filter(|_| faces.has_normals);
                Vertex {
                    position: chunk.position(point),
                    albedo: chunk.colors.as_ref().map_or(plain, |colors| linear(colors[point])),
                    normal: normal.and_then(|normals| cloud::unpack_normal(normals[point])).unwrap_or(Vec3::ZERO),
                }
            }));
        }
        // A part of the file that could not be read has left a gap; a vertex in it does not exist.
        let there = |corner: u32| {
            let next = starts.partition_point(|(first, _)| *first <= u64::from(corner));
            let (first, start) = starts.get(next.checked_sub(1)?)?;
            let end = starts.get(next).map_or(vertices.len(), |(_, start)| *start);
            let index = start + usize::try_from(u64::from(corner) - first).ok()?;
            u32::try_from(index).ok().filter(|_| index < end)
        };
        let triangles: Vec<[u32; 3]> =
            faces.triangles.iter().map(|corners| corners.map(|corner| there(corner).unwrap_or(u32::MAX))).collect();
        Mesh::new(&vertices, &triangles)
    }

    /// The points in the colours in which they are drawn, relative to `origin`.
    pub fn painted(&self, origin: DVec3) -> Vec<Chunk> {
        let ramp = render::ramp_colors(self.plan.ramp);
        let classes = self.cloud.class_column();
        let axis = self.up.abs().max_position();
        let place = |value: f64| {
            let range = self.plan.high - self.plan.low;
            let share = if range > 0.0 { (value - self.plan.low) / range } else { 0.0 };
            // A point without a value has no place on the ramp.
            (!value.is_nan()).then_some((share.clamp(0.0, 1.0) * 255.0).round() as u8)
        };
        let on_ramp = |value: f64| place(value).map_or(self.plan.plain, |place| ramp[usize::from(place)]);
        let paint = |chunk: &Chunk| -> Option<Vec<[u8; 4]>> {
            let each = |color: &dyn Fn(usize) -> [u8; 4]| Some((0..chunk.len()).map(color).collect());
            let column = |index: usize| chunk.columns.get(index)?.as_deref();
            match self.plan.source {
                ColorSource::Rgb => chunk.colors.as_ref().map(|colors| colors.to_vec()),
                ColorSource::RgbOr(grey) => {
                    let (colors, greys) = (chunk.colors.as_ref()?, grey.and_then(column));
                    each(&|point| match greys.and_then(|greys| place(greys.value(point))) {
                        _ if !cloud::is_black(colors[point]) => colors[point],
                        Some(grey) => [grey, grey, grey, u8::MAX],
                        None => self.plan.plain,
                    })
                }
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
                ColorSource::Stray => each(&|point| {
                    let kind = chunk.radii.as_ref().map_or(0, |radii| cloud::stray_kind(radii[point]));
                    render::STRAY_KINDS[usize::from(kind)].1
                }),
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

#[cfg(test)]
mod tests {
    use trace::{Geometry as _, Ray};

    use super::*;

    /// Vertices 0 to 2 and 10 to 12 of a file whose other vertices could not be read.
    fn mesh(triangles: &[[u32; 3]], has_normals: bool) -> Exact {
        let chunk = |first_point: u64, height: f32, color: [u8; 3]| {
            let [red, green, blue] = color;
            let positions = vec![[0.0, 0.0, height], [1.0, 0.0, height], [0.0, 1.0, height]];
            Chunk {
                colors: Some(Arc::new(vec![[red, green, blue, u8::MAX]; 3])),
                normals: Some(Arc::new(vec![cloud::pack_normal(Vec3::new(0.6, 0.0, 0.8)); 3])),
                ..Chunk::new(first_point, DVec3::new(5e5, 5e6, 0.0), positions)
            }
        };
        let chunks = vec![chunk(0, 0.0, [255, 0, 0]), chunk(10, 1.0, [0, 188, 0])];
        let cloud = Cloud { chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &scene::Color::default(), DVec3::Z);
        let part = SubjectPart { cloud, specular_intensity: 0.0, specular_power: 0.0, clear: None, plan, up: DVec3::Z };
        let faces = Faces { triangles: triangles.to_vec(), has_normals };
        Exact::new(Vec::new()).with_meshes(vec![part.mesh(&faces)])
    }

    #[test]
    fn triangles_find_their_vertices_beside_a_gap_in_the_file() {
        let down = Ray::from_eye(DVec3::new(5e5 + 0.25, 5e6 + 0.25, 3.0), DVec3::NEG_Z);
        let upper = mesh(&[[0, 1, 2], [10, 11, 12]], false).nearest(&down).expect("the upper triangle");
        assert_eq!((upper.distance, upper.normal, upper.point), (2.0, DVec3::Z, 1));
        assert!(upper.albedo.distance(DVec3::new(0.0, 0.503, 0.0)) < 0.001, "{upper:?}");
        let lower = mesh(&[[0, 1, 2], [3, 11, 12], [9, 11, 12], [13, 11, 12]], true).nearest(&down);
        let lower = lower.expect("the lower triangle: the others' vertices are not there");
        assert_eq!((lower.distance, lower.albedo), (3.0, DVec3::X));
        assert!(lower.normal.distance(DVec3::new(0.6, 0.0, 0.8)) < 1e-3, "the file's own: {lower:?}");
    }
}
