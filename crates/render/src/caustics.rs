//! The light that mirrors throw from lamps and the sun onto surfaces (docs/methods/gi.md): photons leave the lights toward
//! the mirrors, are reflected by them, and land on what they meet after the first one, through the tree of discs that
//! `surfel_trace` walks. They are kept while lights, mirrors and points stand. Shading takes what has landed about a place
//! as direct light, and virtual lights stand where some of them have landed.

mod grid;
mod near;
#[cfg(test)]
mod tests;

use bytemuck::Zeroable as _;
use cloud::Bounds;
use glam::{DVec3, Vec3, Vec4};
use scene::{Mirror, MirrorSettings, Settings};

use self::grid::Grid;
use crate::frame::{FrameCamera, Tiles};
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{Landed, POWER_BYTES, PhotonBeam, PhotonLight, PhotonRun};
use crate::lighting::MappedLight;
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::reflection::fading::is_published;
use crate::reflection::gather::Gather;
use crate::reflection::surfel_trace;
use crate::reflection::{self, Bounce, Reflections, Task};
use crate::store::PointStore;
use crate::store::draw_list::Selection;
use crate::targets::{Image, storage, uniform_buffer};

/// The edge of the image whose pixels are photons: as many are traced at once.
const EDGE: u32 = 256;

/// The ball about the points of a mirror is larger than that of their box by this factor, since points do not reach a
/// surface's edge.
const AROUND_POINTS: f64 = 1.02;

/// No photon spreads its light over a radius beyond this share of half the diagonal of all points.
const LARGEST: f64 = 0.125;

/// The inputs of the photons.
#[derive(Clone, PartialEq)]
struct Asked {
    revision: u64,
    /// The settings that affect what photons meet; the others are at their defaults.
    settings: Settings,
    /// How mirrors reflect.
    mirror: MirrorSettings,
    photons: u32,
    lights: Vec<MappedLight>,
    mirrors: Vec<Mirror>,
}

/// The photons of a scene where they have landed.
pub(crate) struct Thrown {
    /// `None` for those of a rehearsal, which are none.
    asked: Option<Asked>,
    /// A number that is different after each change.
    pub generation: u64,
    /// The world position to which all others are relative.
    origin: DVec3,
    grid: Grid,
    /// The photons in an order in which those that lie close together follow each other.
    landed: Vec<Landed>,
    /// In the layout of shaders/photon_light.wgsl.
    pub photons: wgpu::Buffer,
    pub cells: wgpu::Buffer,
    /// The irradiance that the surface has which is shaded.
    pub irradiance: Image,
}

#[derive(Default)]
pub(crate) struct Caustics {
    thrown: Option<Thrown>,
    generations: u64,
    /// Whether photons stay while only the points change.
    pub may_lag: bool,
}

/// The scene whose photons are traced.
pub(crate) struct PhotonScene<'a> {
    pub store: &'a PointStore,
    pub settings: &'a Settings,
    pub mirrors: &'a [Mirror],
    pub lights: &'a [MappedLight],
    pub camera: &'a FrameCamera,
}

impl Caustics {
    /// What mirrors throw, if there are lights and mirrors.
    pub fn thrown(&self) -> Option<&Thrown> {
        self.thrown.as_ref()
    }

    pub fn forget(&mut self) {
        self.thrown = None;
    }

    pub fn bytes(&self) -> u64 {
        self.thrown.as_ref().map_or(0, |thrown| thrown.photons.size() + thrown.cells.size() + thrown.irradiance.bytes())
    }

    /// Traces the photons, if their inputs have changed.
    ///
    /// # Errors
    /// A shader is refused, the frame is given up, or there is no memory.
    pub fn trace(
        &mut self,
        recorder: &mut Recorder<'_>,
        scene: &PhotonScene<'_>,
        reflections: &mut Reflections,
    ) -> Result<()> {
        let PhotonScene { store, settings, mirrors, lights, camera } = *scene;
        let bounces = Reflections::asked(settings) as u32;
        // The sun's finer map, which moves with the view, shines no other light.
        let is_sun = lights.first().is_some_and(|light| light.camera.orthographic);
        let lights = if is_sun { &lights[..1] } else { lights };
        if settings.light.photons == 0 || bounces == 0 || lights.is_empty() {
            self.thrown = None;
            return Ok(());
        }
        let asked = Asked {
            revision: store.revision(),
            settings: met_by(settings),
            mirror: settings.mirror.clone(),
            photons: settings.light.photons,
            lights: lights.to_vec(),
            mirrors: mirrors.to_vec(),
        };
        let may_lag = self.may_lag;
        let is_same = |kept: &Asked| {
            let revision = if may_lag { kept.revision } else { asked.revision };
            Asked { revision, ..asked.clone() } == *kept
        };
        let stands = |thrown: &Thrown| thrown.asked.as_ref().is_some_and(is_same);
        if !self.thrown.as_ref().is_some_and(stands) {
            self.thrown = None;
            let bounds = store.bounds();
            let beams = beams(lights, &mirror_balls(store, settings, mirrors), bounds);
            if beams.is_empty() || bounds.is_empty() {
                return Ok(());
            }
            recorder.time_as(Some(("photons", PassStage::Light)));
            let landed = landed(recorder, scene, reflections, &beams, bounces)?;
            recorder.time_as(None);
            self.generations += 1;
            let asked = landed.is_some().then_some(asked);
            self.thrown = Some(Thrown::new(recorder.gpu, asked, self.generations, bounds, landed.unwrap_or_default()));
        }
        if let Some(thrown) = &mut self.thrown {
            if thrown.irradiance.size() != camera.size {
                thrown.irradiance = irradiance_image(recorder.gpu, camera.size);
            }
            let header = thrown.grid.header((thrown.origin - camera.eye).as_vec3());
            recorder.gpu.queue.write_buffer(&thrown.photons, 0, bytemuck::cast_slice(&header));
        }
        Ok(())
    }
}

impl Thrown {
    fn new(gpu: &Gpu, asked: Option<Asked>, generation: u64, bounds: Bounds, mut landed: Vec<Landed>) -> Self {
        let origin = bounds.center();
        let most = bounds.radius().max(1e-9) * LARGEST;
        let grid = Grid::new(most as f32, &mut landed);
        let words: Vec<Vec4> = grid.header(Vec3::ZERO).into_iter().chain(grid.vectors()).collect();
        let upload = |label, bytes: &[u8]| {
            let buffer = storage(&gpu.device, label, bytes.len() as u64);
            gpu.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let photons = upload("photons", bytemuck::cast_slice(&words));
        let cells = upload("cells of photons", bytemuck::cast_slice(&grid.cells));
        let irradiance = irradiance_image(gpu, [1, 1]);
        Self { asked, generation, origin, grid, landed, photons, cells, irradiance }
    }

    #[cfg(test)]
    fn irradiance(&self, place: DVec3, normal: Vec3) -> Vec3 {
        self.grid.irradiance((place - self.origin).as_vec3(), normal)
    }

    /// The mean over red, green and blue of all power that has landed.
    pub fn flux(&self) -> f64 {
        self.landed.iter().map(|photon| f64::from(brightness(photon.power))).sum()
    }

    /// Virtual lights of equal brightness where photons have landed, for these numbers of lights of a bounce. Positions are
    /// relative to `origin`; none represents a larger surface than a disc of a squared radius of `most_squared`.
    pub fn lights(&self, numbers: &[u32], origin: DVec3, most_squared: f32) -> Vec<PhotonLight> {
        let each = self.flux() / numbers.len().max(1) as f64;
        let mut numbers = numbers.iter();
        // Half a step in: the middle of each light's share.
        let (mut sum, mut next) = (0.0, 0.5 * each);
        let mut lights = Vec::new();
        for photon in &self.landed {
            let own = f64::from(brightness(photon.power));
            sum += own;
            while sum > next && own > 0.0 {
                let Some(&number) = numbers.next() else { return lights };
                next += each;
                let irradiance = self.grid.irradiance(photon.position.truncate(), photon.normal.truncate());
                let area = each as f32 / brightness(irradiance.extend(0.0)).max(1e-20);
                let position = (self.origin - origin).as_vec3() + photon.position.truncate();
                lights.push(PhotonLight {
                    position: position.extend((area / std::f32::consts::PI).min(most_squared)),
                    normal: photon.normal,
                    albedo: photon.albedo,
                    flux: photon.power * (each / own) as f32,
                    toward: -photon.incoming,
                    number,
                    ..PhotonLight::default()
                });
            }
        }
        lights
    }
}

/// The settings that may change what photons meet. Frames in motion differ from others in settings that do not, so that
/// they keep the photons.
fn met_by(settings: &Settings) -> Settings {
    let mut met = settings.only(|field| field.affects.found);
    let usual = Settings::default();
    (met.sscr, met.gloss) = (usual.sscr, usual.gloss);
    (met.splat.quality, met.reflection.samples) = (usual.splat.quality, usual.reflection.samples);
    met
}

fn irradiance_image(gpu: &Gpu, size: [u32; 2]) -> Image {
    Image::new(&gpu.device, size, "irradiance by photons", wgpu::TextureFormat::Rgba16Float)
}

fn brightness(color: Vec4) -> f32 {
    color.truncate().element_sum() / 3.0
}

/// The balls about the mirrors through which light does not go.
fn mirror_balls(store: &PointStore, settings: &Settings, mirrors: &[Mirror]) -> Vec<(DVec3, f64)> {
    let opaque = opaque(mirrors);
    let by_formula = reflection::mirror_spheres(settings, &opaque);
    let of_points = store.mirror_clouds(settings).into_values().filter_map(|chunks| {
        let mut bounds = Bounds::EMPTY;
        let mut reach = 0.0_f64;
        for chunk in chunks.into_iter().filter(|chunk| !store.is_clear(*chunk)) {
            let Some(placed) = store.placed(chunk) else { continue };
            bounds = bounds.union(placed.bounds);
            reach = reach.max(f64::from(placed.largest_radius));
        }
        (!bounds.is_empty()).then(|| (bounds.center(), bounds.radius() * AROUND_POINTS + reach))
    });
    by_formula.chain(of_points).collect()
}

fn opaque(mirrors: &[Mirror]) -> Vec<Mirror> {
    mirrors.iter().filter(|mirror| !reflection::is_clear(mirror)).cloned().collect()
}

/// The beams of all lights that may meet mirrors. `bounds` are those of the points; positions are relative to their middle.
fn beams(lights: &[MappedLight], balls: &[(DVec3, f64)], bounds: Bounds) -> Vec<PhotonBeam> {
    let origin = bounds.center();
    let mut beams: Vec<PhotonBeam> = Vec::new();
    for light in lights.iter().filter(|light| light.intensity.iter().any(|value| *value > 0.0)) {
        let forward = light.camera.view_from_world.row(2);
        let [red, green, blue] = light.intensity;
        let beam = PhotonBeam {
            position_inner: (light.camera.eye - origin).as_vec3().extend(light.inner),
            axis_outer: forward.as_vec3().extend(light.outer),
            strength: Vec4::new(red, green, blue, f32::from(u8::from(light.camera.orthographic))),
            first: beams.len() as u32,
            count: balls.len() as u32,
            ..PhotonBeam::zeroed()
        };
        // All rays of the sun start in the plane before all points and all mirrors.
        let before = |(center, radius): &(DVec3, f64)| (*center - light.camera.eye).dot(forward) - radius;
        let start = balls.iter().map(before).fold(0.0, f64::min);
        beams.extend(balls.iter().map(|(center, radius)| {
            let toward = *center - light.camera.eye;
            if light.camera.orthographic {
                let middle = *center - forward * (toward.dot(forward) - start);
                return PhotonBeam { axis_extent: (middle - origin).as_vec3().extend(*radius as f32), ..beam };
            }
            // One minus the cosine of the angle under which the lamp sees the ball, in which it may stand, and of its own.
            let sine = radius / toward.length();
            let extent = if sine < 1.0 { sine * sine / (1.0 + (1.0 - sine * sine).sqrt()) } else { 2.0 };
            let own = 2.0 * (f64::from(light.outer.max(light.inner)) * 0.5).sin().powi(2);
            let (axis, extent) = if own < extent { (forward, own) } else { (toward.normalize_or(DVec3::Z), extent) };
            PhotonBeam { axis_extent: axis.as_vec3().extend(extent as f32), ..beam }
        }));
    }
    beams
}

/// Traces photons of all beams, and returns them where they have landed; `None` in a rehearsal.
fn landed(
    recorder: &mut Recorder<'_>,
    scene: &PhotonScene<'_>,
    reflections: &mut Reflections,
    beams: &[PhotonBeam],
    bounces: u32,
) -> Result<Option<Vec<Landed>>> {
    let PhotonScene { store, settings, mirrors, .. } = *scene;
    let gpu = recorder.gpu;
    let bounds = store.bounds();
    let each = (settings.light.photons / beams.len() as u32).max(1);
    let total = each * beams.len() as u32;
    let size = [EDGE, total.div_ceil(EDGE).min(EDGE)];
    let formulas = reflection::upload(gpu, settings, &opaque(mirrors), bounds.center());
    let selection = if formulas.is_none() { Selection::EverywhereWithMirrors } else { Selection::Everywhere };
    let camera = FrameCamera {
        scene_radius: bounds.radius(),
        mirror_tiles: Tiles::of(size),
        ..FrameCamera::along(bounds.center(), DVec3::X, 1.0, size)
    };
    let supply = Inputs::new(gpu, camera, settings, &store.draw_list(&camera, settings, selection));
    let mut chunks = supply.chunks.clone();
    chunks.retain(|chunk| !store.is_clear(*chunk));
    let gather = Gather::new(&gpu.device, size);
    let stages: [Bounce; 2] = std::array::from_fn(|_| Bounce::new(&gpu.device, size));
    // Never written, so all zeros.
    let straight = Image::new(&gpu.device, size, "no normals", wgpu::TextureFormat::Rgba32Float);
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let powers = storage(&gpu.device, "powers of photons", pixels * POWER_BYTES);
    let landed = storage(&gpu.device, "landed photons", u64::from(bounces) * pixels * size_of::<Landed>() as u64);
    let beams_buffer = storage(&gpu.device, "beams", size_of_val(beams) as u64);
    gpu.queue.write_buffer(&beams_buffer, 0, bytemuck::cast_slice(beams));
    let mut all = Vec::new();
    for first in (0..total).step_by(pixels as usize) {
        let run = uniform_buffer(gpu, bytemuck::bytes_of(&PhotonRun { first, each, total, unused: 0 }));
        let bindings = passes::photon_start {
            beams: beams_buffer.as_entire_binding(),
            run: run.as_entire_binding(),
            powers: powers.as_entire_binding(),
            point_out: stages[0].mirror.point.bind(),
            eye_out: stages[0].mirror.eye.bind(),
        };
        recorder.over_pixels(&[], &supply, bindings)?;
        for number in 0..=bounces {
            let [this, other] = [number, number + 1].map(|stage| &stages[stage as usize % 2]);
            let task = Task {
                supply: &supply,
                settings,
                store,
                mirrors,
                // Not the first reflection, whose tests are counted where they are shown.
                bounce: 1,
                camera: other.surface(),
                mirror: &this.mirror,
                normal: if number == 0 { &straight } else { &other.seen.normal },
                seen: &this.seen,
                formulas: formulas.as_ref(),
                counters: &reflections.counters,
            };
            surfel_trace::meet(recorder, &mut reflections.methods.index, &gather, task, &chunks, &straight)?;
            let bindings = passes::photon_land {
                albedo_in: this.seen.albedo.bind(),
                normal_in: this.seen.normal.bind(),
                position_in: this.seen.position.bind(),
                point_in: this.mirror.point.bind(),
                eye_in: this.mirror.eye.bind(),
                powers: powers.as_entire_binding(),
                landed: landed.as_entire_binding(),
                point_out: other.mirror.point.bind(),
                eye_out: other.mirror.eye.bind(),
            };
            let switches = [
                ("mirrors", number),
                ("is_last", u32::from(number == bounces)),
                ("is_published", u32::from(is_published(settings))),
            ];
            recorder.over_pixels(&switches, &supply, bindings)?;
        }
        let Some(bytes) = recorder.read(&landed)? else { return Ok(None) };
        let found: Vec<Landed> = bytemuck::pod_collect_to_vec(&bytes);
        all.extend(found.into_iter().filter(|photon| photon.position.w > 0.0 && photon.power.is_finite()));
    }
    Ok(Some(all))
}
