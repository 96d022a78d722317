//! Indirect light (SSCR, 2.4 and 4.1): virtual lights where light first meets a surface and after each further bounce,
//! an imperfect shadow map for each, and the light that they give to any visible surface, seen by the camera or in a
//! mirror.
//!
//! Virtual lights do not depend on the camera: they, their shadow maps, and the light that they give to a place are the
//! same from every eye. The passes share `shaders/shared/vpl.wgsl`.

mod kept;
mod near;
mod occluders;
mod plan;
mod region;
mod sequence;
#[cfg(test)]
mod twin;
mod work;

use bytemuck::Zeroable as _;
use glam::Vec3;
use scene::{Gi, Highlight, Light, Occluder, Settings, Splat, VirtualLight};

use crate::caustics::Thrown;
use crate::frame::FrameCamera;
use crate::gpu::{Error, Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{PhotonLight, VIRTUAL_TEXEL_BYTES, Virtual, Vpl};
use crate::lighting::MappedLight;
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::fading::{ShareLeft, is_published};
use crate::reflection::{Reflections, SurfaceImages};
use crate::store::PointStore;
use crate::store::draw_list::Selection;
use crate::targets::{Image, storage, uniform_buffer};
pub use kept::LightReuse;
pub(crate) use kept::camera_before;
use kept::{HURRIED_PARTS, Keeper};
use near::Near;
use plan::LightPlan;
pub(crate) use plan::Sky;
pub(crate) use region::Region;
use work::{Ground, Work};

/// The number of doublings of distance that a shadow map distinguishes, below four scene radii.
const DOUBLINGS: f32 = 18.0;

/// The most of the scene's squared radius that the squared radius of a virtual light is, as in shaders/vpl_place.wgsl: where
/// photons are sparse, it would represent a larger surface than exists.
const MOST_SQUARED: f32 = 0.01;

/// The least number of lights of each bounce that light a pixel in a glossy sample: fewer save little beside what the
/// sample costs otherwise.
const LEAST_LIGHTS: u32 = 4;

/// The inputs that determine where the virtual lights are and what blocks them.
#[derive(Clone, PartialEq)]
struct Places {
    geometry_revision: u64,
    /// The splat settings of the lamps' shadow maps.
    splat: Splat,
    /// The positions, directions and cones of the lights; `plan` has the virtual lights of each.
    cameras: Vec<(FrameCamera, f32, f32)>,
    plan: LightPlan,
    /// The bits of where virtual lights stand because photons have landed there.
    landed: Vec<[u32; 4]>,
    shadow_size: u32,
    shadow_points: u32,
    pull_levels: u32,
    occluders: Occluder,
    shadows: bool,
}

/// All inputs of the virtual lights.
#[derive(Clone, PartialEq)]
struct Asked {
    revision: u64,
    /// The splat settings of the lamps' shadow maps.
    splat: Splat,
    gi: Gi,
    lights: Vec<MappedLight>,
    sky: Option<Sky>,
    /// The generation of the photons.
    thrown: Option<u64>,
    scattering: [f32; 3],
    tint: f32,
    follows_mirrors: bool,
}

impl Asked {
    fn new(
        store: &PointStore,
        settings: &Settings,
        lights: &[MappedLight],
        sky: Option<Sky>,
        thrown: Option<&Thrown>,
    ) -> Self {
        // Parameters that only shading reads are set to their defaults, so that they do not matter here.
        let defaults = Gi::default();
        let gi = Gi {
            by: defaults.by,
            rays_per_pixel: defaults.rays_per_pixel,
            ray_bounces: defaults.ray_bounces,
            ray_seed: defaults.ray_seed,
            vpl: defaults.vpl,
            clamp: defaults.clamp,
            shadow_bias: defaults.shadow_bias,
            interleave: defaults.interleave,
            filtered: defaults.filtered,
            filter_depth: defaults.filter_depth,
            filter_angle: defaults.filter_angle,
            ..settings.gi.clone()
        };
        Self {
            revision: store.revision(),
            splat: crate::lighting::splat_of_maps(settings),
            gi,
            lights: lights.to_vec(),
            // The region is that of the finer maps alone.
            sky: sky.map(|sky| Sky { near: None, ..sky }),
            thrown: thrown.map(|thrown| thrown.generation),
            scattering: scattering(settings),
            tint: settings.mirror.tint,
            follows_mirrors: Reflections::asked(settings) > 0,
        }
    }
}

impl Places {
    fn new(store: &PointStore, gi: &Gi, asked: &Asked, plan: LightPlan, landed: &[PhotonLight]) -> Self {
        let Asked { splat, lights, .. } = asked;
        Self {
            geometry_revision: store.geometry_revision(),
            splat: splat.clone(),
            cameras: lights.iter().map(|light| (light.camera, light.inner, light.outer)).collect(),
            plan,
            landed: landed.iter().map(|light| light.position.to_array().map(f32::to_bits)).collect(),
            shadow_size: gi.shadow_size,
            shadow_points: gi.shadow_points,
            pull_levels: gi.pull_levels,
            occluders: gi.occluders,
            shadows: gi.shadows,
        }
    }
}

/// The virtual lights that currently light frames, on the GPU.
struct LightBuffers {
    asked: Asked,
    places: Places,
    uniform: Virtual,
    constants: wgpu::Buffer,
    vpls: wgpu::Buffer,
    maps: wgpu::Buffer,
    /// The finer maps of the sky's lights, if what the camera sees is small in the scene.
    near: Option<Near>,
    /// A number that is different after each change.
    generation: u64,
}

/// The inputs of the indirect light of a surface, besides the surface itself.
#[derive(Clone, PartialEq)]
struct Shaded {
    generation: u64,
    gi: Gi,
    scattering: [f32; 3],
    highlight: Highlight,
    mirror: scene::MirrorSettings,
    is_mixed: bool,
    is_glossy: bool,
    /// Whether light of earlier frames is taken over, and what mirrors show is lit by fewer lights.
    is_reused: bool,
    /// The state of the rays that brought the light, if rays did.
    rays: Option<u64>,
}

/// The images of the light on one surface.
struct SurfaceLight {
    diffuse: Image,
    glossy: Image,
    radiance: Image,
    /// Bound where a pass has nothing to read.
    nothing: wgpu::Buffer,
    shaded: Option<Shaded>,
}

#[derive(Default)]
pub(crate) struct GlobalIllumination {
    ground: Option<Ground>,
    lights: Option<LightBuffers>,
    surfaces: Vec<SurfaceLight>,
    /// The light on what rays meet.
    met: Option<SurfaceLight>,
    generations: u64,
    /// Whether virtual lights stay unchanged while only the points change.
    pub may_lag: bool,
    /// The light of earlier frames on the surface that the camera sees.
    pub keeper: Keeper,
}

/// A surface on which indirect light falls.
pub(crate) struct Receiver<'a> {
    /// 0 for the surface that the camera sees; from 1 for what the mirrors of each bounce see.
    pub index: usize,
    pub surface: SurfaceImages<'a>,
    /// The mirror points that see it; the camera's positions for index 0.
    pub from: &'a Image,
    /// Whether a reflection is followed from here.
    pub is_mixed: bool,
    /// The rays that are followed, whose w is 0 where none is; `None` if all are.
    pub followed: Option<&'a Image>,
    /// Whether something here may have a highlight.
    pub is_glossy: bool,
    /// Whether something here that is no mirror may.
    pub has_gloss: bool,
    /// How much the reflections of mirrors here fade.
    pub fading: ShareLeft<'a>,
    /// The light that rays have brought here, in place of that of the virtual lights.
    pub brought: Option<Brought<'a>>,
    /// For what rays meet: the most reflections whose virtual lights shine there.
    pub most_bounces: Option<u32>,
}

/// The indirect light that rays bring to the surface that the camera sees.
#[derive(Clone, Copy)]
pub(crate) struct Brought<'a> {
    /// The irradiance over pi.
    pub diffuse: &'a Image,
    /// The radiance of highlights before their tint.
    pub glossy: &'a Image,
    /// The edge in pixels of the window over which the images are averaged.
    pub window: u32,
    /// The edge of the part of the window that counts however near other surfaces are.
    pub narrow: u32,
    /// A number that is different after each change of the images.
    pub state: u64,
}

/// The virtual lights in the layout of shaders/shared/vpl.wgsl.
pub(crate) struct VirtualLights<'a> {
    /// The number of lights: those of the sky, then bounce by bounce.
    pub count: u32,
    pub constants: &'a wgpu::Buffer,
    pub vpls: &'a wgpu::Buffer,
    /// The shadow maps, if they are drawn.
    pub maps: Option<&'a wgpu::Buffer>,
}

impl LightBuffers {
    fn bytes(&self) -> u64 {
        self.vpls.size() + self.maps.size() + self.near.as_ref().map_or(0, |near| near.maps.size())
    }

    /// Sums the light of each pixel's run of the virtual lights on a surface, unfiltered; only in `tiles` if those are
    /// given.
    fn shine(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        gi: &Gi,
        receiver: &Receiver<'_>,
        (target, is_glossy, is_reused): (&SurfaceLight, bool, bool),
        tiles: Option<&wgpu::Buffer>,
    ) -> Result<()> {
        let from_camera = receiver.index == 0;
        let groups = if from_camera { inputs.pixel_groups() } else { inputs.mirror_groups() };
        let sample_runs =
            if from_camera { 1 } else { sample_runs(gi, inputs.sample.map_or(1, |[_, samples, _]| samples)) };
        let interleave = gi.interleave;
        let groups_of_run = [groups[0], groups[1]].map(|groups| (groups * 8).div_ceil(interleave).div_ceil(8));
        let switches = [
            ("from_camera", u32::from(from_camera)),
            ("interleave", interleave),
            ("has_shadows", u32::from(gi.shadows)),
            ("is_glossy", u32::from(is_glossy)),
            ("is_spherical", u32::from(gi.vpl == VirtualLight::Spherical)),
            ("by_tiles", u32::from(tiles.is_some())),
            ("sample_runs", sample_runs),
            ("parts", if is_reused && (tiles.is_some() || !from_camera) { HURRIED_PARTS } else { 1 }),
            ("most_bounces", receiver.most_bounces.unwrap_or(u32::MAX)),
            ("has_near", u32::from(self.near.is_some())),
        ];
        let SurfaceImages { albedo, normal, position } = receiver.surface;
        let bindings = passes::indirect {
            albedo_in: albedo.bind(),
            normal_in: normal.bind(),
            position_in: position.bind(),
            from_in: receiver.from.bind(),
            lights: self.constants.as_entire_binding(),
            vpls: self.vpls.as_entire_binding(),
            shadow_maps: self.maps.as_entire_binding(),
            diffuse_out: target.diffuse.bind(),
            glossy_out: target.glossy.bind(),
            tiles: tiles.unwrap_or(&target.nothing).as_entire_binding(),
            near_lights: self.near.as_ref().map_or(&target.nothing, |near| &near.constants).as_entire_binding(),
            near_maps: self.near.as_ref().map_or(&target.nothing, |near| &near.maps).as_entire_binding(),
        };
        let groups_of_runs = [groups_of_run[0], groups_of_run[1], interleave * interleave];
        recorder.by_rows(&switches, inputs, bindings, groups_of_runs)
    }
}

impl GlobalIllumination {
    /// Whether the settings and lights give any indirect light.
    pub fn is_asked(settings: &Settings, lights: &[MappedLight], sky: Option<Sky>) -> bool {
        let has_light = lights.iter().any(|light| light.intensity.iter().any(|value| *value > 0.0));
        (has_light && settings.gi.bounces > 0) || sky.is_some_and(|sky| sky.irradiance > 0.0)
    }

    /// Forgets everything that is kept from frame to frame.
    pub fn forget(&mut self) {
        (self.ground, self.lights) = (None, None);
        self.keeper.forget();
    }

    /// Places the virtual lights and draws their shadow maps, if their inputs have changed. `shadow_maps` are those of
    /// `lights`, see `crate::lighting::Lights`.
    ///
    /// # Errors
    /// More shadow maps than a binding holds, a shader is refused, or there is no memory.
    pub fn place(
        &mut self,
        recorder: &mut Recorder<'_>,
        camera: FrameCamera,
        store: &PointStore,
        settings: &Settings,
        (lights, thrown, sky): (&[MappedLight], Option<&Thrown>, Option<Sky>),
        shadow_maps: &wgpu::Buffer,
    ) -> Result<()> {
        // The sun's finer map, which moves with the view, is for direct light.
        let is_sun = lights.first().is_some_and(|light| light.camera.orthographic);
        let lights = if is_sun { &lights[..1] } else { lights };
        let asked = Asked::new(store, settings, lights, sky, thrown);
        let is_same = |lights: &LightBuffers| {
            let revision = if self.may_lag { lights.asked.revision } else { asked.revision };
            Asked { revision, ..asked.clone() } == lights.asked
        };
        let regions = sky.and_then(|sky| sky.near).map_or_else(Vec::new, |near| near.balls(store.bounds()));
        if let (Some(ground), Some(lights)) = (&self.ground, self.lights.as_mut().filter(|lights| is_same(lights))) {
            let eye = (camera.eye - ground.origin).as_vec3();
            lights.uniform.eye_radius = eye.extend(lights.uniform.eye_radius.w);
            recorder.gpu.queue.write_buffer(&lights.constants, 0, bytemuck::bytes_of(&lights.uniform));
            let last = lights.near.as_ref().map_or_else(Vec::new, |near| near.regions.clone());
            let regions = if self.may_lag { last } else { regions };
            return self.look_near(recorder, camera, (store, settings), regions);
        }
        let gi = &settings.gi;
        let ground = match self.ground.take() {
            Some(kept) if kept.geometry_revision == store.geometry_revision() && kept.per_map == gi.shadow_points => {
                kept
            }
            _ => Ground::new(recorder.gpu, store, gi.shadow_points),
        };
        let ground = &*self.ground.insert(ground);
        let kept = self.lights.take();
        let flux = thrown.map_or(0.0, Thrown::flux);
        let plan = LightPlan::new(gi, lights, (flux, sky), ground.origin, ground.radius, store.bounds());
        let most = MOST_SQUARED * (ground.radius * ground.radius) as f32;
        let landed = thrown.map(|thrown| thrown.lights(&plan.thrown, ground.origin, most));
        let places = Places::new(store, gi, &asked, plan, landed.as_deref().unwrap_or_default());
        let everywhere_list = store.draw_list(&camera, settings, Selection::EverywhereWithMirrors);
        let everywhere = &Inputs::new(recorder.gpu, camera, settings, &everywhere_list);
        let kept = kept.filter(|lights| lights.places == places);
        let maps_stand = kept.is_some();
        let plan = &places.plan;
        let levels = map_levels(gi);
        let uniform = uniform_of(gi, plan, ground, (camera.eye - ground.origin).as_vec3(), asked.follows_mirrors);
        let needs_maps = gi.shadows || plan.bounces > 1 || plan.has_sky_births;
        let ([constants, vpls, maps], near) = match kept {
            Some(kept) => ([kept.constants, kept.vpls, kept.maps], kept.near),
            None => (buffers(recorder.gpu, &uniform, needs_maps)?, None),
        };
        recorder.gpu.queue.write_buffer(&constants, 0, bytemuck::bytes_of(&uniform));
        let mut start = vec![Vpl::zeroed(); count_of(&uniform) as usize];
        for (vpl, sky) in start.iter_mut().zip(&plan.sky) {
            *vpl = sky.to_gpu(asked.sky.map_or(0.0, |sky| sky.irradiance));
        }
        recorder.gpu.queue.write_buffer(&vpls, 0, bytemuck::cast_slice(&start));
        let all_maps = maps.as_entire_buffer_binding();
        let work =
            Work { constants: &constants, vpls: &vpls, maps: all_maps, ground, levels: &levels, uniform: &uniform };
        work.run(recorder, everywhere, gi, (plan, landed), (lights, shadow_maps), needs_maps && !maps_stand)?;
        self.generations += 1;
        let generation = self.generations;
        self.lights = Some(LightBuffers { asked, places, uniform, constants, vpls, maps, near, generation });
        self.look_near(recorder, camera, (store, settings), regions)
    }

    /// Draws the finer maps of the sky's lights that stand, unless they show the regions already.
    fn look_near(
        &mut self,
        recorder: &mut Recorder<'_>,
        camera: FrameCamera,
        (store, settings): (&PointStore, &Settings),
        mut regions: Vec<Region>,
    ) -> Result<()> {
        let Some(lights) = &mut self.lights else { return Ok(()) };
        let limit = recorder.gpu.device.limits().max_storage_buffer_binding_size;
        // None without a light of the sky.
        let most = limit.checked_div(Near::bytes_of_region(&lights.uniform)).unwrap_or(0);
        regions.truncate(if settings.gi.shadows { most as usize } else { 0 });
        if lights.near.as_ref().map_or(&[][..], |near| &near.regions[..]) != regions {
            lights.near = if regions.is_empty() {
                None
            } else {
                let list = store.draw_list(&camera, settings, Selection::EverywhereWithMirrors);
                let everywhere = Inputs::new(recorder.gpu, camera, settings, &list);
                let maps = (&lights.uniform, &map_levels(&settings.gi)[..], settings.gi.shadow_points);
                let before = lights.near.as_ref();
                Some(Near::draw(recorder, (store, &everywhere), (regions, before), &lights.vpls, maps)?)
            };
            self.generations += 1;
            lights.generation = self.generations;
        }
        if let Some(near) = &mut lights.near {
            near.look_from(recorder, camera.eye);
        }
        Ok(())
    }

    /// The caller reports that the surfaces from number `first` on have changed, in the order of `Receiver::index`.
    pub fn surfaces_changed(&mut self, first: usize) {
        for surface in self.surfaces.iter_mut().skip(first) {
            surface.shaded = None;
        }
    }

    /// Computes the indirect light of a surface, as radiance toward its viewer, unless it is up to date.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn shade(
        &mut self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        receiver: &Receiver<'_>,
    ) -> Result<()> {
        let Some(lights) = &self.lights else { return Ok(()) };
        let device = &recorder.gpu.device;
        let target = if receiver.most_bounces.is_some() {
            let target = self.met.get_or_insert_with(|| SurfaceLight::new(device, inputs.size));
            // Each ray meets something else.
            target.shaded = None;
            target
        } else {
            while self.surfaces.len() <= receiver.index {
                self.surfaces.push(SurfaceLight::new(device, inputs.size));
            }
            &mut self.surfaces[receiver.index]
        };
        if target.radiance.size() != inputs.size {
            *target = SurfaceLight::new(device, inputs.size);
        }
        let gi = &settings.gi;
        let is_glossy = receiver.is_glossy && (receiver.has_gloss || !receiver.is_mixed || receiver.followed.is_some());
        let from_camera = receiver.index == 0;
        let is_reused = self.keeper.reuse == LightReuse::Reuse;
        let shaded = Shaded {
            generation: lights.generation,
            gi: gi.clone(),
            scattering: scattering(settings),
            highlight: settings.light.highlight,
            mirror: settings.mirror.clone(),
            is_mixed: receiver.is_mixed,
            is_glossy,
            is_reused,
            rays: receiver.brought.map(|brought| brought.state),
        };
        if target.shaded.as_ref() == Some(&shaded) {
            return Ok(());
        }
        target.shaded = Some(shaded);
        if is_glossy && target.glossy.size() != inputs.size {
            target.glossy = Image::new(device, inputs.size, "indirect highlights", wgpu::TextureFormat::Rgba16Float);
        }
        let SurfaceImages { albedo, normal, position } = receiver.surface;
        let groups = if from_camera { inputs.pixel_groups() } else { inputs.mirror_groups() };
        let window = receiver.brought.map_or_else(|| tile_of(gi), |brought| brought.window);
        let source = (lights.generation, gi.clone());
        let is_kept = from_camera && receiver.brought.is_none();
        let taken = if is_kept { self.keeper.take(recorder, inputs, receiver.surface, source, window)? } else { None };
        let tiles = taken.as_ref().and_then(|taken| taken.tiles.as_ref());
        if receiver.brought.is_none() {
            lights.shine(recorder, inputs, gi, receiver, (target, is_glossy, is_reused), tiles)?;
        }
        let brought = receiver.brought.map(|brought| [brought.diffuse, brought.glossy]);
        let [diffuse, glossy] = brought.unwrap_or([&target.diffuse, &target.glossy]);
        let switches = [
            ("from_camera", u32::from(from_camera)),
            ("window", window),
            ("narrow", receiver.brought.map_or(window, |brought| brought.narrow)),
            ("is_glossy", u32::from(is_glossy)),
            ("is_mixed", u32::from(receiver.is_mixed)),
            ("stops", u32::from(receiver.followed.is_some())),
            ("keeps", u32::from(taken.is_some())),
            ("reuses", u32::from(tiles.is_some())),
            ("is_published", u32::from(is_published(settings))),
            ("fades", u32::from(receiver.fading.image().is_some())),
            ("is_mean_left", u32::from(receiver.fading.is_mean())),
        ];
        let bindings = passes::indirect_filter {
            albedo_in: albedo.bind(),
            normal_in: normal.bind(),
            position_in: position.bind(),
            from_in: receiver.from.bind(),
            diffuse_in: diffuse.bind(),
            glossy_in: glossy.bind(),
            radiance_out: target.radiance.bind(),
            kept: taken.as_ref().map_or(&target.nothing, |taken| &taken.light).as_entire_binding(),
            left_in: receiver.fading.image().unwrap_or(normal).bind(),
            rays_in: receiver.followed.unwrap_or(normal).bind(),
        };
        recorder.by_rows(&switches, inputs, bindings, groups)
    }

    /// A number that is different after each change of the virtual lights.
    pub fn generation(&self) -> Option<u64> {
        self.lights.as_ref().map(|lights| lights.generation)
    }

    /// The virtual lights that currently light frames, on the GPU.
    pub fn lights(&self) -> Option<VirtualLights<'_>> {
        let LightBuffers { uniform, constants, vpls, maps, .. } = self.lights.as_ref()?;
        let count = count_of(uniform);
        let has_maps =
            count > 0 && maps.size() >= u64::from(count) * u64::from(uniform.map_stride) * VIRTUAL_TEXEL_BYTES;
        Some(VirtualLights { count, constants, vpls, maps: has_maps.then_some(maps) })
    }

    /// The indirect light of what rays met last.
    pub fn met(&self) -> Option<&Image> {
        self.met.as_ref().map(|met| &met.radiance)
    }

    /// The indirect light of a surface that was shaded.
    pub fn radiance(&self, index: usize) -> Option<&Image> {
        self.surfaces.get(index).map(|surface| &surface.radiance)
    }

    #[cfg(test)]
    fn read(&self, gpu: &Gpu) -> Result<Option<twin::Placed>> {
        let Some((lights, ground)) = self.lights.as_ref().zip(self.ground.as_ref()) else { return Ok(None) };
        let vpls = gpu.read_buffer(&lights.vpls, 0, lights.vpls.size())?;
        let maps = gpu.read_buffer(&lights.maps, 0, lights.maps.size())?;
        Ok(Some(twin::Placed {
            lights: lights.uniform,
            origin: ground.origin,
            vpls: bytemuck::pod_collect_to_vec(&vpls),
            maps: bytemuck::pod_collect_to_vec(&maps),
        }))
    }

    pub fn bytes(&self) -> u64 {
        let ground = self.ground.as_ref().map_or(0, |ground| ground.chosen.size() + ground.surfaces.size());
        let lights = self.lights.as_ref().map_or(0, LightBuffers::bytes);
        ground
            + lights
            + self.keeper.bytes()
            + self.surfaces.iter().chain(&self.met).map(SurfaceLight::bytes).sum::<u64>()
    }
}

impl SurfaceLight {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let image = |label, size| Image::new(device, size, label, wgpu::TextureFormat::Rgba16Float);
        Self {
            diffuse: image("indirect irradiance", size),
            // The image gets its size when a highlight is first needed.
            glossy: image("indirect highlights", [1, 1]),
            radiance: image("indirect", size),
            // Arrays of what the passes read have at least one element.
            nothing: storage(device, "nothing", size_of::<Virtual>() as u64),
            shaded: None,
        }
    }

    fn bytes(&self) -> u64 {
        [&self.diffuse, &self.glossy, &self.radiance].map(Image::bytes).iter().sum()
    }
}

/// The edge in pixels of the tile over which the light of virtual lights is averaged.
pub(crate) fn tile_of(gi: &Gi) -> u32 {
    if gi.filtered { gi.interleave } else { 1 }
}

/// The factor of diffuse light, and the share and the power of highlights, of surfaces that are no mirrors.
fn scattering(settings: &Settings) -> [f32; 3] {
    let Light { diffuse, gloss, gloss_power, .. } = settings.light;
    [diffuse, gloss, gloss_power]
}

/// The number of runs of lights that the samples of glossy mirrors share, so that each costs a part of the light: samples
/// are summed, as pixels are averaged over a tile. All runs are in as many samples.
fn sample_runs(gi: &Gi, samples: u32) -> u32 {
    let pixels = gi.interleave * gi.interleave;
    let most = (gi.vpls / pixels / LEAST_LIGHTS).clamp(1, samples.max(1));
    (1..=most).rev().find(|runs| samples.is_multiple_of(*runs)).unwrap_or(1)
}

/// The edges of the levels of a shadow map in texels, finest first.
fn map_levels(gi: &Gi) -> Vec<u32> {
    std::iter::successors(Some(gi.shadow_size), |size| Some(size.div_ceil(2)))
        .take(gi.pull_levels as usize + 1)
        .collect()
}

/// What the passes of virtual lights read; `eye` is relative to the origin of the lights.
fn uniform_of(gi: &Gi, plan: &LightPlan, ground: &Ground, eye: Vec3, follows_mirrors: bool) -> Virtual {
    Virtual {
        eye_radius: eye.extend(ground.radius as f32),
        disc_radius: ground.occluders.radius,
        nearest: ground.radius as f32 * 4.0 * (-DOUBLINGS).exp2(),
        steps: 65534.0 / DOUBLINGS,
        map_size: gi.shadow_size,
        map_stride: map_levels(gi).iter().map(|level| level * level).sum(),
        point_count: ground.occluders.points.len() as u32,
        subsets: ground.occluders.subsets.max(1),
        sky_lights: plan.sky.len() as u32,
        lights_per_bounce: gi.vpls,
        bounces: plan.bounces,
        area_over_pi: (ground.occluders.area / f64::from(gi.vpls) / std::f64::consts::PI) as f32,
        follows_mirrors: u32::from(follows_mirrors),
    }
}

/// The number of virtual lights.
fn count_of(uniform: &Virtual) -> u32 {
    uniform.sky_lights + uniform.lights_per_bounce * uniform.bounces
}

/// Buffers for constants, virtual lights and their shadow maps, if these are needed.
///
/// # Errors
/// More shadow maps than a binding holds.
fn buffers(gpu: &Gpu, uniform: &Virtual, needs_maps: bool) -> Result<[wgpu::Buffer; 3]> {
    let count = u64::from(count_of(uniform));
    let map_bytes = if needs_maps { count * u64::from(uniform.map_stride) * VIRTUAL_TEXEL_BYTES } else { 16 };
    let limit = gpu.device.limits().max_storage_buffer_binding_size;
    if map_bytes > limit {
        return Err(Error::TooLarge {
            what: "the atlas of virtual shadow maps",
            bytes: map_bytes,
            limit,
            adapter: gpu.info.name.clone(),
            advice: "; lower gi.vpls, gi.bounces, gi.sky_lights or gi.shadow_size",
        });
    }
    Ok([
        uniform_buffer(gpu, bytemuck::bytes_of(uniform)),
        storage(&gpu.device, "virtual lights", count.max(1) * size_of::<Vpl>() as u64),
        storage(&gpu.device, "virtual shadow maps", map_bytes),
    ])
}
