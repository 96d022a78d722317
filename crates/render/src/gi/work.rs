//! The passes that place virtual lights and draw their shadow maps.

use glam::{DVec3, Vec4};
use scene::{Gi, VirtualLight};

use super::occluders::Occluders;
use super::plan::LightPlan;
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{
    AIM_COUNTS, AIM_HIT_BYTES, Emitter, OCCLUDER_VECTORS, PARENT_NONE, PhotonLight, Step, VPL_TRIES, Virtual,
};
use crate::lighting::MappedLight;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::{storage, uniform_buffer};

/// The number of points that one pass splats into shadow maps: some 50 ms on two busy cores.
const SPLATS_AT_ONCE: u32 = 1 << 19;

/// The points that block light, and the origin of the lights' positions.
pub(super) struct Ground {
    pub geometry_revision: u64,
    pub per_map: u32,
    pub origin: DVec3,
    pub radius: f64,
    pub occluders: Occluders,
    pub chosen: wgpu::Buffer,
    pub surfaces: wgpu::Buffer,
}

impl Ground {
    pub fn new(gpu: &Gpu, store: &PointStore, per_map: u32) -> Self {
        let bounds = store.bounds();
        let (origin, radius) =
            if bounds.is_empty() { (DVec3::ZERO, 1.0) } else { (bounds.center(), bounds.radius().max(1e-9)) };
        let occluders = Occluders::choose(&store.casting_chunks(), origin, per_map);
        Self::with(gpu, store, per_map, (origin, radius), occluders)
    }

    /// `occluders` are chosen from `store`, with positions relative to the origin.
    pub fn with(
        gpu: &Gpu,
        store: &PointStore,
        per_map: u32,
        (origin, radius): (DVec3, f64),
        occluders: Occluders,
    ) -> Self {
        let chosen = upload(gpu, "occluders", bytemuck::cast_slice(&occluders.points));
        let surfaces =
            storage(&gpu.device, "surfaces of occluders", occluders.points.len() as u64 * OCCLUDER_VECTORS * 16);
        Self { geometry_revision: store.geometry_revision(), per_map, origin, radius, occluders, chosen, surfaces }
    }
}

/// The resources of the passes that make the virtual lights.
pub(super) struct Work<'a> {
    pub constants: &'a wgpu::Buffer,
    pub vpls: &'a wgpu::Buffer,
    pub maps: wgpu::BufferBinding<'a>,
    pub ground: &'a Ground,
    pub levels: &'a [u32],
    pub uniform: &'a Virtual,
}

impl Work<'_> {
    /// Places the lights of a plan, and draws their shadow maps where they are asked for and do not stand yet.
    /// `shadow_maps` are those of `lights`.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(
        &self,
        recorder: &mut Recorder<'_>,
        everywhere: &Inputs,
        gi: &Gi,
        (plan, landed): (&LightPlan, Option<Vec<PhotonLight>>),
        (lights, shadow_maps): (&[MappedLight], &wgpu::Buffer),
        draws_maps: bool,
    ) -> Result<()> {
        let of_sky = plan.sky.len() as u32;
        self.points(recorder, everywhere)?;
        if draws_maps {
            recorder.clear(self.maps.buffer);
            if gi.shadows || plan.has_sky_births {
                self.shadow_maps(recorder, everywhere, 0, of_sky)?;
            }
        }
        if plan.bounces == 0 {
            return Ok(());
        }
        self.first_bounce(recorder, everywhere, lights, plan, shadow_maps)?;
        if let Some(landed) = landed {
            self.photons(recorder, everywhere, landed)?;
        }
        let births = upload(recorder.gpu, "births", bytemuck::cast_slice(&plan.births));
        for bounce in 1..=plan.bounces {
            if bounce > 1 || plan.has_sky_births {
                self.bounce(recorder, everywhere, &births, bounce)?;
            }
            if draws_maps && (gi.shadows || bounce < plan.bounces) {
                self.shadow_maps(recorder, everywhere, of_sky + (bounce - 1) * gi.vpls, gi.vpls)?;
            }
        }
        // Lights of further bounces carry what those before them reflect, whatever their factors are.
        let balanced = if gi.shadows && gi.vpl == VirtualLight::Spherical { plan.bounces } else { 0 };
        for bounce in 0..balanced {
            self.balance(recorder, everywhere, of_sky + bounce * gi.vpls)?;
        }
        Ok(())
    }

    fn maps(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(self.maps.clone())
    }

    pub fn points(&self, recorder: &mut Recorder<'_>, everywhere: &Inputs) -> Result<()> {
        let Ground { chosen, surfaces, .. } = self.ground;
        let bindings = passes::vpl_points {
            lights: self.constants.as_entire_binding(),
            chosen: chosen.as_entire_binding(),
            surfaces: surfaces.as_entire_binding(),
        };
        let groups = [self.uniform.point_count.div_ceil(64).max(1), 1, 1];
        recorder.over_page_pixels(everywhere, bindings, groups)
    }

    /// Places the lights that lamps and the sun give rise to.
    fn first_bounce(
        &self,
        recorder: &mut Recorder<'_>,
        everywhere: &Inputs,
        lights: &[MappedLight],
        plan: &LightPlan,
        shadow_maps: &wgpu::Buffer,
    ) -> Result<()> {
        if plan.flux.is_empty() {
            return Ok(());
        }
        let gpu = recorder.gpu;
        let emitters: Vec<Emitter> =
            lights.iter().zip(&plan.flux).map(|(light, flux)| emitter(light, *flux, self.ground.origin)).collect();
        let aims = upload(gpu, "aims", bytemuck::cast_slice(&plan.aims));
        let emitters = upload(gpu, "emitters", bytemuck::cast_slice(&emitters));
        let hits = storage(&gpu.device, "hits", plan.aims.len() as u64 / u64::from(VPL_TRIES) * AIM_HIT_BYTES);
        let counts = storage(&gpu.device, "hit counts", lights.len() as u64 * AIM_COUNTS * 4);
        recorder.clear(&counts);
        let groups = [self.uniform.lights_per_bounce.div_ceil(64), 1, 1];
        let bindings = passes::vpl_aim {
            lights: self.constants.as_entire_binding(),
            aims: aims.as_entire_binding(),
            shadows: shadow_maps.as_entire_binding(),
            hits: hits.as_entire_binding(),
            counts: counts.as_entire_binding(),
        };
        recorder.over(&[], everywhere, bindings, groups)?;
        let bindings = passes::vpl_place {
            lights: self.constants.as_entire_binding(),
            hits: hits.as_entire_binding(),
            counts: counts.as_entire_binding(),
            shadows: shadow_maps.as_entire_binding(),
            emitters: emitters.as_entire_binding(),
            vpls: self.vpls.as_entire_binding(),
        };
        recorder.over_page_pixels(everywhere, bindings, groups)
    }

    /// Places the lights that stand where photons have landed.
    fn photons(&self, recorder: &mut Recorder<'_>, everywhere: &Inputs, mut landed: Vec<PhotonLight>) -> Result<()> {
        if landed.is_empty() {
            landed.push(PhotonLight { number: PARENT_NONE, ..PhotonLight::default() });
        }
        let thrown = upload(recorder.gpu, "landed photons", bytemuck::cast_slice(&landed));
        let bindings = passes::vpl_photons {
            lights: self.constants.as_entire_binding(),
            thrown: thrown.as_entire_binding(),
            vpls: self.vpls.as_entire_binding(),
        };
        recorder.over(&[], everywhere, bindings, [(landed.len() as u32).div_ceil(64), 1, 1])
    }

    fn bounce(&self, recorder: &mut Recorder<'_>, inputs: &Inputs, births: &wgpu::Buffer, bounce: u32) -> Result<()> {
        let step = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&Step { bounce, ..Step::default() }));
        let bindings = passes::vpl_bounce {
            lights: self.constants.as_entire_binding(),
            births: births.as_entire_binding(),
            shadow_maps: self.maps(),
            surfaces: self.ground.surfaces.as_entire_binding(),
            chosen: self.ground.chosen.as_entire_binding(),
            vpls: self.vpls.as_entire_binding(),
            work: step.as_entire_binding(),
        };
        let groups = [self.uniform.lights_per_bounce.div_ceil(64), 1, 1];
        recorder.over(&[], inputs, bindings, groups)
    }

    /// Sets the factors of the lights of the bounce that begins with `first_light`.
    fn balance(&self, recorder: &mut Recorder<'_>, inputs: &Inputs, first_light: u32) -> Result<()> {
        let step = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&Step { first_light, ..Step::default() }));
        let bindings = passes::vpl_balance {
            lights: self.constants.as_entire_binding(),
            shadow_maps: self.maps(),
            surfaces: self.ground.surfaces.as_entire_binding(),
            vpls: self.vpls.as_entire_binding(),
            work: step.as_entire_binding(),
        };
        recorder.over(&[], inputs, bindings, [self.uniform.lights_per_bounce, 1, 1])
    }

    fn shadow_maps(&self, recorder: &mut Recorder<'_>, inputs: &Inputs, first_light: u32, count: u32) -> Result<()> {
        if count == 0 {
            return Ok(());
        }
        self.splat(recorder, inputs, first_light, count)?;
        self.fill(recorder, inputs, first_light, count)
    }

    /// Splats the points into the maps of `count` lights.
    pub fn splat(&self, recorder: &mut Recorder<'_>, inputs: &Inputs, first_light: u32, count: u32) -> Result<()> {
        let Ground { chosen, surfaces, .. } = self.ground;
        let per_map = self.uniform.point_count.div_ceil(self.uniform.subsets).max(1);
        // Some lights at a time, so that a frame can be given up between them. Each light has a map of its own.
        let run = (SPLATS_AT_ONCE / per_map).max(1);
        for first in (0..count).step_by(run as usize) {
            let step = Step { first_light: first_light + first, ..Step::default() };
            let step = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&step));
            let bindings = passes::vpl_shadow_splat {
                lights: self.constants.as_entire_binding(),
                chosen: chosen.as_entire_binding(),
                surfaces: surfaces.as_entire_binding(),
                vpls: self.vpls.as_entire_binding(),
                shadow_maps: self.maps(),
                work: step.as_entire_binding(),
            };
            recorder.over(&[], inputs, bindings, [per_map.div_ceil(64), run.min(count - first), 1])?;
        }
        Ok(())
    }

    /// Closes the holes between the splats.
    pub fn fill(&self, recorder: &mut Recorder<'_>, inputs: &Inputs, first_light: u32, count: u32) -> Result<()> {
        let starts: Vec<u32> = self
            .levels
            .iter()
            .scan(0, |next, size| {
                let start = *next;
                *next += size * size;
                Some(start)
            })
            .collect();
        let pairs = self.levels.len() - 1;
        let steps = (0..pairs).map(|level| (level, true)).chain((0..pairs).rev().map(|level| (level, false)));
        for (level, is_pull) in steps {
            let (fine_size, coarse_size) = (self.levels[level], self.levels[level + 1]);
            let step = Step {
                first_light,
                fine_size,
                fine_first: starts[level],
                coarse_first: starts[level + 1],
                ..Step::default()
            };
            let step = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&step));
            let [lights, work] = [self.constants, &step].map(|buffer| buffer.as_entire_binding());
            let shadow_maps = self.maps();
            let groups = |size: u32| [(size * size).div_ceil(64), count, 1];
            if is_pull {
                let bindings = passes::vpl_shadow_pull { lights, shadow_maps, work };
                recorder.over(&[], inputs, bindings, groups(coarse_size))?;
            } else {
                let bindings = passes::vpl_shadow_push { lights, shadow_maps, work };
                recorder.over(&[], inputs, bindings, groups(fine_size))?;
            }
        }
        Ok(())
    }
}

fn emitter(light: &MappedLight, flux: f64, origin: DVec3) -> Emitter {
    let row = |index| light.camera.view_from_world.row(index).as_vec3();
    let [red, green, blue] = light.intensity;
    let strength = Vec4::new(red, green, blue, 0.0);
    Emitter {
        position: (light.camera.eye - origin).as_vec3().extend(f32::from(u8::from(light.camera.orthographic))),
        axis_focal: row(2).extend(light.camera.focal_pixels as f32),
        right: row(0).extend(0.0),
        up: row(1).extend(0.0),
        flux: strength * flux as f32,
        strength,
        angles: Vec4::new(light.inner, light.outer, 0.0, 0.0),
    }
}

fn upload(gpu: &Gpu, label: &str, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = storage(&gpu.device, label, bytes.len() as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}
