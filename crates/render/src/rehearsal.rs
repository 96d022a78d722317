//! Compiles the passes of a frame before it is drawn, on all cores. A rehearsal draws a tiny scene with the frame's
//! settings: first to learn which passes it names, then to run each of them once, because some drivers compile only
//! then (software Vulkan for half a second each). A pass that a rehearsal overlooks is compiled when the frame comes to
//! it.

use std::sync::Arc;

use cloud::{Chunk, PointTest, Progress, pack_radius};
use glam::DVec3;
use param::Kind;
use rayon::prelude::*;
use scene::{Camera, LightClues, Method, Mirror, Quality, Settings, Shape, SpotLight};

use crate::frame::Objects;
use crate::gi::{LightReuse, Region};
use crate::gpu::{Error, Result};
use crate::lighting::MOST_LIGHTS;
use crate::passes::Compiled;
use crate::recorder::{Rehearsal, Variant};
use crate::reflection::{gloss, is_clear, own_methods};
use crate::renderer::{Effort, Frame, FrameStats, Renderer};
use crate::store::{Material, PointStore};

/// What decides which passes a frame has.
#[derive(Clone, PartialEq)]
pub(crate) struct Cast {
    /// Without the numbers that only change what the passes compute.
    pub(crate) settings: Settings,
    pub(crate) lights: usize,
    pub(crate) clues: LightClues,
    /// Whether there are mirrors that are drawn by their formula, mirrors that have one but are drawn as points, and
    /// points without a formula that reflect.
    pub(crate) mirrors: [bool; 3],
    pub(crate) has_highlights: bool,
    /// Whether light goes through mirrors with a formula, and through points.
    pub(crate) clear: [bool; 2],
    /// Whether some points are hidden.
    pub(crate) filters: bool,
    /// The methods that mirrors have for themselves.
    pub(crate) own_methods: Vec<Method>,
    /// Whether the sky has finer maps of what the camera sees.
    pub(crate) has_near: bool,
    /// Whether something moves.
    pub(crate) moves: bool,
    pub(crate) light_reuse: LightReuse,
}

impl Cast {
    fn new(store: &PointStore, frame: &Frame<'_>) -> Self {
        let Frame { camera, settings, objects, size, effort } = frame;
        let is_exact = |mirror: &Mirror| mirror.is_exact(settings.mirror.surface);
        let shows_highlights = |mirror: &Mirror| mirror.specular_intensity > 0.0 && mirror.specular_power > 0.0;
        Self {
            settings: settings.only(|field| !matches!(field.kind, Kind::F32 { .. } | Kind::Color { .. })),
            lights: objects.lights.len().min(MOST_LIGHTS),
            clues: objects.clues,
            has_near: Region::seen(camera, settings, *size, store.bounds()).is_some(),
            moves: effort.is_moving(),
            light_reuse: effort.light_reuse,
            mirrors: [
                objects.mirrors.iter().any(is_exact),
                objects.mirrors.iter().any(|mirror| mirror.shape.has_formula() && !is_exact(mirror)),
                objects.mirrors.iter().all(|mirror| !mirror.shape.has_formula())
                    && store.mirror_spheres(settings).next().is_some(),
            ],
            has_highlights: store.has_highlights() || objects.mirrors.iter().any(shows_highlights),
            clear: [objects.mirrors.iter().any(is_clear), store.has_clear_points(settings)],
            filters: store.hides_points(),
            own_methods: own_methods::all_own(store, settings, objects.mirrors),
        }
    }
}

/// The scene of a rehearsal.
pub(crate) struct Stage {
    store: PointStore,
    settings: Settings,
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    clues: LightClues,
    moves: bool,
    light_reuse: LightReuse,
}

/// The size of the picture of a rehearsal: within a workgroup, and no power of two. Mesa's software Vulkan compiles a pass
/// anew for textures whose width, or height, is a power of two, which those of most pictures are not.
const STAGE_SIZE: [u32; 2] = [7, 7];

/// How many rehearsals are known before all are forgotten; a slider makes one for each number.
const MOST_PREPARED: usize = 32;

fn stage_camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z)
}

impl Renderer {
    /// Compiles the passes that frames like this one need and are not compiled yet, on all cores, and runs each once on
    /// a tiny picture. `progress` counts each pass twice: when it is compiled, and when it has run.
    ///
    /// # Errors
    /// A shader is refused, no more memory, or the device was lost.
    pub fn prepare(&mut self, store: &PointStore, frame: &Frame<'_>, progress: &Arc<Progress>) -> Result<()> {
        let cast = Cast::new(store, frame);
        if self.prepared.contains(&cast) {
            return Ok(());
        }
        let mut stage = Self::bare(self.gpu.clone());
        stage.pipelines = std::mem::take(&mut self.pipelines);
        let outcome = stage.rehearse(&cast, frame.settings, progress);
        self.pipelines = stage.pipelines;
        if let Some(kept) = self.gpu.kept_pipelines.as_ref().filter(|_| progress.done() > 0) {
            kept.save();
        }
        // Whatever went wrong, nobody waits for the rest any more.
        progress.add(progress.total().saturating_sub(progress.done()));
        if self.prepared.len() == MOST_PREPARED {
            self.prepared.clear();
        }
        self.prepared.push(cast);
        self.checked(outcome)
    }

    /// Compiles what every picture needs; the rest is compiled when it is known.
    pub(crate) fn warm_up(&mut self, progress: &Arc<Progress>) -> Result<()> {
        let store = PointStore::new(self.gpu.clone());
        let camera = stage_camera();
        for quality in [Quality::Nearest, Quality::High] {
            let mut settings = Settings::default();
            settings.splat.quality = quality;
            settings.reflection.method = Method::None;
            self.prepare(&store, &Frame::new(&camera, &settings, Objects::default(), STAGE_SIZE), progress)?;
        }
        Ok(())
    }

    /// Compiles what a frame names and is not compiled, and runs it.
    fn rehearse(&mut self, cast: &Cast, settings: &Settings, progress: &Arc<Progress>) -> Result<()> {
        let mut stage = self.stage(cast, settings)?;
        let reuses = stage.light_reuse == LightReuse::Reuse;
        if reuses {
            // Light that a frame takes over comes from a frame that keeps it.
            stage.light_reuse = LightReuse::Keep;
        }
        let is_new = self.compile(&stage, progress)?;
        if is_new || reuses {
            // What was compiled before is not counted.
            let counted = if is_new { progress.clone() } else { Arc::default() };
            self.forget();
            self.draw_stage(&stage, STAGE_SIZE, &mut Rehearsal::Count(counted))?;
        }
        if reuses {
            stage.light_reuse = LightReuse::Reuse;
            if self.compile(&stage, progress)? {
                self.draw_stage(&stage, STAGE_SIZE, &mut Rehearsal::Count(progress.clone()))?;
            }
        }
        Ok(())
    }

    /// Compiles what a frame names and is not compiled. Returns whether that was anything.
    fn compile(&mut self, stage: &Stage, progress: &Arc<Progress>) -> Result<bool> {
        let missing = self.missing(stage)?;
        let is_any = !missing.is_empty();
        progress.set_total(progress.total() + 2 * missing.len() as u64);
        let compile = |(pass, switches): Variant| {
            let compiled = Compiled::new(&self.gpu, pass, &switches).map_err(Error::Shader);
            progress.add(1);
            compiled.map(|compiled| ((pass.name, switches), compiled))
        };
        let compiled: Result<Vec<_>> = missing.into_par_iter().map(compile).collect();
        self.pipelines.extend(compiled?);
        Ok(is_any)
    }

    /// The passes that a frame names and that are not compiled.
    pub(crate) fn missing(&mut self, stage: &Stage) -> Result<Vec<Variant>> {
        self.missing_at(stage, STAGE_SIZE)
    }

    /// The passes that a frame of another size names and that are not compiled.
    pub(crate) fn missing_at(&mut self, stage: &Stage, size: [u32; 2]) -> Result<Vec<Variant>> {
        let mut collect = Rehearsal::Collect(Vec::new());
        match self.draw_stage(stage, size, &mut collect) {
            // A rehearsal that only collects draws no frame.
            Ok(_) | Err(Error::GivenUp) => {}
            Err(error) => return Err(error),
        }
        Ok(if let Rehearsal::Collect(missing) = collect { missing } else { Vec::new() })
    }

    fn draw_stage(&mut self, stage: &Stage, size: [u32; 2], rehearsal: &mut Rehearsal) -> Result<FrameStats> {
        let Stage { store, settings, mirrors, lights, clues, moves, light_reuse } = stage;
        let objects = Objects { mirrors, lights, clues: *clues };
        let most_points = moves.then_some(u64::MAX);
        let effort = Effort { most_points, light_reuse: *light_reuse, ..Effort::FULL };
        self.draw(store, &Frame { camera: &stage_camera(), settings, objects, size, effort }, Some(rehearsal), None)
    }

    /// A tiny scene with what a frame like this one has.
    pub(crate) fn stage(&self, cast: &Cast, settings: &Settings) -> Result<Stage> {
        let mut settings = settings.clone();
        let gi = &mut settings.gi;
        (gi.vpls, gi.sky_lights, gi.shadow_points, gi.shadow_size) = (16, 4, 256, 16);
        // The second sample adds to the first.
        settings.gloss.samples = settings.gloss.samples.min(2);
        settings.reflection.samples = settings.reflection.samples.min(2);
        if cast.own_methods.iter().chain([&settings.reflection.method]).any(|method| gloss::is_refused_by(*method)) {
            // The method draws no frame with glossy mirrors.
            settings.gloss.samples = 0;
        }
        settings.environment_map.size = 16;
        (settings.cubemap_trace.size, settings.cubemap_trace.maps) = (16, 1);
        (settings.light_field.size, settings.light_field.samples) = (16, 1);
        let (store, mirrors) = self.tiny_scene(cast)?;
        let lamp = SpotLight {
            position: DVec3::X * 0.9,
            target: DVec3::ZERO,
            intensity: [1.0; 3],
            inner_degrees: 30.0,
            outer_degrees: 40.0,
        };
        let (clues, moves, light_reuse) = (cast.clues, cast.moves, cast.light_reuse);
        Ok(Stage { store, settings, mirrors, lights: vec![lamp; cast.lights], clues, moves, light_reuse })
    }

    /// A few points, and a mirror of each kind that the frame has.
    fn tiny_scene(&self, cast: &Cast) -> Result<(PointStore, Vec<Mirror>)> {
        let mut store = PointStore::new(self.gpu.clone());
        let [exact, as_points, of_points] = cast.mirrors;
        let specular_power = if cast.has_highlights { 10.0 } else { 0.0 };
        let refraction = if cast.clear[1] { 1.5 } else { 0.0 };
        let reflecting = Material { specular_intensity: 1.0, specular_power, refraction, ..Material::default() };
        // Single pixels and discs have kernels of their own.
        let pixel = Chunk::new(0, DVec3::ZERO, vec![[0.0, 0.4, 0.0]]);
        let disc = |place| {
            let mut disc = Chunk::new(1, DVec3::ZERO, vec![place]);
            disc.radii = Some(Arc::new(vec![pack_radius(0.3)]));
            disc
        };
        let mut add = |material, chunk: &Chunk| {
            let cloud = store.add_cloud(material);
            store.add_chunk(cloud, chunk, None).map(drop)
        };
        add(Material::default(), &pixel)?;
        add(Material::default(), &disc([0.0, -0.4, 0.0]))?;
        if cast.has_near {
            // What the camera sees is small in the scene then.
            add(Material::default(), &disc([0.0, -40.0, 0.0]))?;
        }
        if of_points || as_points {
            add(Material { has_formula: !of_points, as_points, ..reflecting }, &disc([0.0, 0.0, 0.2]))?;
        }
        let mirror = |as_points| Mirror {
            as_points,
            specular_power,
            refraction: cast.clear[0].then_some(1.5),
            ..Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.3)
        };
        let mirrors = [(exact, false), (as_points, true)].into_iter().filter(|(is_there, _)| *is_there);
        let mut mirrors: Vec<Mirror> = mirrors.map(|(_, as_points)| mirror(as_points)).collect();
        for method in cast.own_methods.iter().copied().map(Some) {
            if exact {
                mirrors.push(Mirror { method, ..mirror(false) });
            } else {
                let has_formula = !of_points;
                add(Material { has_formula, as_points, method, ..reflecting }, &disc([0.0, 0.0, 0.2]))?;
            }
        }
        if cast.filters {
            store.set_visibility(&PointTest::hiding([7]));
        }
        Ok((store, mirrors))
    }
}

#[cfg(test)]
mod tests {
    use scene::IndirectBy;

    use super::*;
    use crate::Gpu;

    #[test]
    fn a_frame_that_was_rehearsed_compiles_nothing() {
        let Some(gpu) = Gpu::for_test() else { return };
        let mut renderer = Renderer::bare(gpu.clone());
        let mut store = PointStore::new(gpu);
        let cloud = store.add_cloud(Material::default());
        let wall = |z: i32| (-8..8).flat_map(move |x| (-8..8).map(move |y| [x, y, z].map(|step| step as f32 * 0.1)));
        for (number, z) in [(0, -9), (1, 9)] {
            let mut chunk = Chunk::new(number * 1000, DVec3::ZERO, wall(z).collect());
            chunk.radii = Some(Arc::new(vec![pack_radius(0.02 + number as f32); chunk.len()]));
            store.add_chunk(cloud, &chunk, None).unwrap();
        }
        let camera = Camera::looking(DVec3::ZERO, DVec3::new(1.0, 0.3, 0.2), 3.0, DVec3::Z);
        let mut mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.5);
        let lamp = SpotLight {
            position: DVec3::Z * 3.0,
            target: DVec3::ZERO,
            intensity: [10.0; 3],
            inner_degrees: 50.0,
            outer_degrees: 60.0,
        };
        let by = [IndirectBy::Lights, IndirectBy::Rays];
        let methods = [(Method::SscrHierarchical, 1, false), (Method::Sscr, 0, true)];
        for ((method, lights, as_points), by) in methods.into_iter().zip(by) {
            let samples = store.add_cloud(Material {
                specular_intensity: 1.0,
                // Points of glass, then a formula of it.
                refraction: 1.5,
                has_formula: true,
                as_points,
                ..Material::default()
            });
            (mirror.as_points, mirror.refraction) = (as_points, Some(1.5));
            for chunk in mirror.sample(200, 1) {
                store.add_chunk(samples, &chunk, None).unwrap();
            }
            let mut settings = Settings::default();
            settings.reflection.method = method;
            settings.gi.vpls = 16;
            (settings.gi.by, settings.gi.rays_per_pixel) = (by, 2);
            let (mirrors, lights) = ([mirror.clone()], vec![lamp; lights]);
            let objects = Objects {
                mirrors: &mirrors,
                lights: &lights,
                clues: LightClues { sky_is_open: true, ..LightClues::default() },
            };
            let progress = Arc::default();
            let still = Frame::new(&camera, &settings, objects, [64, 48]);
            let kept = Frame { effort: Effort { light_reuse: LightReuse::Keep, ..Effort::FULL }, ..still };
            let most_points = Some(200);
            let effort = Effort { most_points, light_reuse: LightReuse::Reuse, times_passes: false, ..Effort::FULL };
            let moving = Frame { effort, ..still };
            for frame in [still, kept, moving] {
                renderer.prepare(&store, &frame, &progress).unwrap();
            }
            assert!(progress.total() > 10 && progress.done() >= progress.total());
            let compiled = renderer.pipelines.len();
            for frame in [still, kept, moving] {
                renderer.render(&store, &frame).unwrap();
                let name = method.row().name;
                assert_eq!(
                    renderer.pipelines.len(),
                    compiled,
                    "{name}: the rehearsal overlooks passes of {:?}",
                    frame.effort
                );
            }
            // What is compiled is not compiled again.
            renderer.prepare(&store, &still, &progress).unwrap();
            assert_eq!(renderer.pipelines.len(), compiled);
            store.remove_cloud(samples);
        }
    }
}
