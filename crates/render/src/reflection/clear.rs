//! Clear surfaces: glass and water. They split what a mirror reflects between its reflection and what is seen through
//! it (Fresnel). A ray that goes through is one more ray of its pixel: it starts where it leaves the surface or the
//! solid (shaders/clear_surface.wgsl), and every method that traces reflected rays finds what it meets, as
//! docs/methods/glass.md says. The camera's clear surfaces have both rays; of those that are seen in mirrors or
//! through others, only the stronger one is followed.

use scene::{Mirror, Settings, Shape};

use super::bounce::{Bounce, Search};
use super::fading::Fading;
use super::formula;
use super::gather::Gather;
use super::surfel_trace::Rays;
use super::task::{MirrorGBuffer, MirrorSurface, SurfaceImages, Task};
use super::weight;
use crate::gpu::{Gpu, Result};
use crate::identities::ChunkId;
use crate::inputs::Inputs;
use crate::layout::{COUNTERS, FormulaMirror};
use crate::method::{self, Methods};
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::{Image, storage};

/// One more than the most total reflections inside a solid (shaders/clear_surface.wgsl).
const MOST_WAYS: u32 = 9;

/// The rays that go on from a surface.
pub(crate) struct Onward {
    pub rays: MirrorSurface,
    /// The normals by which the rays are reflections. Of the camera's surface, w is the share that is reflected.
    pub normal: Image,
    /// The index of refraction; see shaders/clear_surface.wgsl.
    index: Image,
}

/// Makes the rays that go on from clear surfaces, and has those of the camera's.
pub(crate) struct ClearSurface {
    /// The mirror pixels of a surface, by which rays arrive.
    arriving: MirrorSurface,
    /// The rays that go through what the camera sees.
    through: Onward,
    /// Bound where there are no mirrors with a formula.
    no_mirrors: wgpu::Buffer,
}

/// The ways of rays inside solids that something else lies in.
struct Inside {
    /// The chunks whose points may lie in solids.
    chunks: Vec<ChunkId>,
    /// The number of ways that a ray may have in a solid.
    ways: u32,
    onward: Onward,
    gather: Gather,
}

/// What is seen through clear surfaces, bounce by bounce.
pub(crate) struct Clear {
    surface: ClearSurface,
    /// The rays that go on from what a bounce has found.
    later: Onward,
    /// `None` if solids are empty.
    inside: Option<Inside>,
    /// The index of refraction of the points that a bounce has found.
    points: Image,
    /// Whether `points` is that of the bounce before.
    pub knows_points: bool,
    /// The first has what the rays through the camera's surface meet, and from where that is seen; the others are
    /// reflections there.
    pub bounces: Vec<Bounce>,
    /// What rays meet, before deep water gets its own colour.
    pub found: MirrorGBuffer,
    /// What each mirror pixel of the camera receives by reflection and through its surface.
    pub received: Image,
    /// Counts what these rays find, which no statistics report.
    counters: wgpu::Buffer,
}

/// Whether light goes through something in the scene.
pub(crate) fn is_there(settings: &Settings, store: &PointStore, mirrors: &[Mirror]) -> bool {
    formula::exact(settings, mirrors).any(formula::is_clear) || store.has_clear_points(settings)
}

/// The chunks whose points may lie in clear solids, and the number of ways from one interface to the next that rays may
/// have in those solids which may not be empty.
fn contents(search: &Search<'_>, supply: &Inputs) -> (Vec<ChunkId>, u32) {
    let Search { settings, store, mirrors, .. } = search;
    let solids: Vec<&Mirror> =
        mirrors.iter().filter(|mirror| formula::is_clear(mirror) && mirror.shape.is_closed()).collect();
    let reach = |mirror: &Mirror| mirror.shape.reach() * mirror.size;
    let mut filled: Vec<&Mirror> = Vec::new();
    let mut chunks = Vec::new();
    for id in supply.chunks.iter().filter(|chunk| !solids.is_empty() && !store.is_clear(**chunk)) {
        let Some(chunk) = store.placed(*id) else { continue };
        let radius = f64::from(chunk.largest_radius * settings.splat.size);
        let is_near = |solid: &&&Mirror| {
            let nearest = solid.position.clamp(chunk.bounds.min, chunk.bounds.max);
            !chunk.bounds.is_empty() && nearest.distance(solid.position) <= reach(solid) + radius
        };
        let before = filled.len();
        filled.extend(solids.iter().filter(is_near));
        if filled.len() > before {
            chunks.push(*id);
        }
    }
    for other in formula::exact(settings, mirrors) {
        let is_near = |solid: &&&Mirror| {
            !std::ptr::eq(**solid, other) && solid.position.distance(other.position) <= reach(solid) + reach(other)
        };
        filled.extend(solids.iter().filter(is_near));
    }
    let ways = match filled.iter().all(|solid| solid.shape == Shape::Sphere) {
        _ if filled.is_empty() => 0,
        // What comes into a sphere may leave it at the next interface.
        true => 1,
        false => MOST_WAYS,
    };
    (chunks, ways)
}

impl Onward {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            rays: MirrorSurface::new(device, size),
            normal: Image::new(device, size, "onward normal", wgpu::TextureFormat::Rgba32Float),
            index: Image::new(device, size, "index of refraction", wgpu::TextureFormat::R32Float),
        }
    }

    fn bytes(&self) -> u64 {
        self.rays.bytes() + self.normal.bytes() + self.index.bytes()
    }
}

impl ClearSurface {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self {
            arriving: MirrorSurface::new(device, size),
            through: Onward::new(device, size),
            // A mirror that reaches nowhere.
            no_mirrors: storage(device, "no mirrors", size_of::<FormulaMirror>() as u64),
        }
    }

    pub fn bytes(&self) -> u64 {
        self.arriving.bytes() + self.through.bytes() + self.no_mirrors.size()
    }

    /// The indices of refraction of the surfaces that the camera sees.
    pub fn index(&self) -> &Image {
        &self.through.index
    }

    /// Makes the rays that go through the camera's surface. `points` as in `Clear::find`.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn go_through(
        &self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        search: &Search<'_>,
        points: Option<&Image>,
    ) -> Result<&Onward> {
        self.start(recorder, supply, search, search.camera, None, points, &self.through)?;
        Ok(&self.through)
    }

    /// Makes rays; those of a bounce, which leave a surface that is seen from mirror points, are the only ones of their
    /// pixels.
    fn start(
        &self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        search: &Search<'_>,
        surface: SurfaceImages<'_>,
        later: Option<(&Image, &Bounce)>,
        points: Option<&Image>,
        onward: &Onward,
    ) -> Result<()> {
        let weight = later.and_then(|(_, bounce)| bounce.weight.as_ref());
        let bindings = passes::mirror_surface {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: later.map_or(surface.position, |(from, _)| from).bind(),
            point_out: self.arriving.point.bind(),
            eye_out: self.arriving.eye.bind(),
            weight_in: weight.unwrap_or(surface.normal).bind(),
        };
        let switches = [("from_camera", u32::from(later.is_none())), ("stops", u32::from(weight.is_some()))];
        recorder.over_pixels(&switches, supply, bindings)?;
        self.leave(recorder, supply, search, surface.normal, points, later.is_some(), 0, onward)
    }

    /// Makes the rays that go on from where rays arrive: those behind surfaces and solids, or those of a way inside a
    /// solid, from 1 on. They are the only ones of their pixels if they arrive alone.
    fn leave(
        &self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        search: &Search<'_>,
        normal: &Image,
        points: Option<&Image>,
        is_only: bool,
        way: u32,
        onward: &Onward,
    ) -> Result<()> {
        let eye = supply.camera.eye;
        let clear = formula::upload_with_clear(recorder.gpu, search.settings, search.mirrors, eye);
        let bindings = passes::clear_surface {
            point_in: self.arriving.point.bind(),
            normal_in: normal.bind(),
            eye_in: self.arriving.eye.bind(),
            points_in: points.unwrap_or(normal).bind(),
            mirrors: clear.as_ref().unwrap_or(&self.no_mirrors).as_entire_binding(),
            point_out: onward.rays.point.bind(),
            eye_out: onward.rays.eye.bind(),
            normal_out: onward.normal.bind(),
            index_out: onward.index.bind(),
        };
        let switches =
            [("has_points", u32::from(points.is_some())), ("is_only", u32::from(is_only)), ("inner_way", way)];
        recorder.by_rows(&switches, supply, bindings, supply.pixel_groups())
    }
}

impl Clear {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let device = &gpu.device;
        Self {
            surface: ClearSurface::new(device, size),
            later: Onward::new(device, size),
            inside: None,
            points: Image::new(device, size, "clear points found", wgpu::TextureFormat::R32Float),
            knows_points: false,
            bounces: Vec::new(),
            found: MirrorGBuffer::new(device, size),
            received: Image::new(device, size, "received", wgpu::TextureFormat::Rgba16Float),
            counters: storage(device, "counters of clear surfaces", COUNTERS as u64 * 4),
        }
    }

    pub fn bytes(&self) -> u64 {
        let images = self.points.bytes() + self.received.bytes() + self.found.bytes() + self.counters.size();
        let surfaces = self.surface.bytes() + self.later.bytes();
        let inside = self.inside.as_ref().map_or(0, |inside| inside.onward.bytes() + inside.gather.bytes());
        images + surfaces + inside + self.bounces.iter().map(Bounce::bytes).sum::<u64>()
    }

    /// The indices of refraction of the surfaces that the camera sees.
    pub fn index(&self) -> &Image {
        self.surface.index()
    }

    /// The indices of refraction of the surfaces from which the rays of `go_on` leave.
    pub fn later_index(&self) -> &Image {
        &self.later.index
    }

    /// Finds what is seen through clear surfaces. `points` has the index of refraction of the points that the camera
    /// sees, if light goes through some.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn find(
        &mut self,
        recorder: &mut Recorder<'_>,
        methods: &mut Methods,
        search: &Search<'_>,
        points: Option<&Image>,
    ) -> Result<()> {
        let Search { settings, store, mirrors, formulas, camera, .. } = search;
        let method = method::behind_clear(settings);
        let count = settings.reflection.bounces as usize;
        let mut bounces = std::mem::take(&mut self.bounces);
        while bounces.len() < count {
            bounces.push(Bounce::new(&recorder.gpu.device, self.received.size()));
        }
        bounces.truncate(count);
        let fading = Fading::new(recorder.gpu, search);
        let asked = [fading.is_some(), false, weight::weighing(settings).is_some()];
        bounces.iter_mut().for_each(|bounce| bounce.provide(&recorder.gpu.device, asked));
        let eye = search.supply.camera;
        let everything = store.draw_list(&eye, settings, method::supply_of(method));
        let mut supply = Inputs::new(recorder.gpu, eye, settings, &everything);
        // Rays beneath the water meet none of its points. Where there are solids, water is seen through them, and only
        // the points near to the start of a ray are passed.
        if !formula::exact(settings, mirrors).any(|mirror| formula::is_clear(mirror) && mirror.shape.is_closed()) {
            supply.chunks.retain(|chunk| !store.is_clear(*chunk));
        }
        let (chunks, ways) = contents(search, &search.supply);
        let kept = self.inside.take().filter(|_| ways > 0);
        self.inside = kept.map(|kept| Inside { chunks: chunks.clone(), ways, ..kept }).or_else(|| {
            let device = &recorder.gpu.device;
            let size = self.received.size();
            (ways > 0).then(|| Inside {
                chunks,
                ways,
                onward: Onward::new(device, size),
                gather: Gather::new(device, size),
            })
        });
        for index in 0..count {
            let (before, rest) = bounces.split_at(index);
            let (before, bounce) = (before.last(), &rest[0]);
            let surface = before.map_or(*camera, Bounce::surface);
            let from = before.map_or(camera.position, |before| &before.mirror.point);
            weight::weigh(recorder, &supply, settings, (surface, from), before, bounce)?;
            let onward = match index {
                0 => self.surface.go_through(recorder, &supply, search, points)?,
                _ => self.go_on(recorder, &supply, search, (surface, from), bounce)?,
            };
            let task = Task {
                supply: &supply,
                settings,
                store,
                mirrors,
                bounce: index,
                camera: *camera,
                mirror: &onward.rays,
                normal: &onward.normal,
                seen: &self.found,
                formulas: formulas.as_ref(),
                counters: &self.counters,
            };
            methods.run(recorder, method, &task, None)?;
            self.take(recorder, &task, surface, index == 0, bounce)?;
            let points = if index == 0 { points } else { self.known_points() };
            self.look_inside(recorder, methods, search, &task, surface.normal, points, index > 0, bounce)?;
            // What is seen through the camera's surfaces does not fade.
            if let Some(fading) = fading.as_ref().filter(|_| index > 0) {
                fading.measure(recorder, &supply, &onward.rays, Some(&onward.index), bounce)?;
            }
            self.knows_points = self.learn_points(recorder, methods, &task)?;
        }
        self.bounces = bounces;
        Ok(())
    }

    /// Makes the rays of `bounce`, which go on from the surface that the one before has found, seen from the points `from`.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn go_on(
        &self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        search: &Search<'_>,
        (surface, from): (SurfaceImages<'_>, &Image),
        bounce: &Bounce,
    ) -> Result<&Onward> {
        let (later, points) = (Some((from, bounce)), self.known_points());
        self.surface.start(recorder, supply, search, surface, later, points, &self.later)?;
        Ok(&self.later)
    }

    /// The index of refraction of the points that the bounce before has found, if it reports one.
    pub fn known_points(&self) -> Option<&Image> {
        self.knows_points.then_some(&self.points)
    }

    /// Puts what rays meet inside solids, on their way to where `task` has followed them from, before what they meet
    /// there. `points` and `is_only` are those of these rays.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn look_inside(
        &self,
        recorder: &mut Recorder<'_>,
        methods: &mut Methods,
        search: &Search<'_>,
        task: &Task<'_>,
        normal: &Image,
        points: Option<&Image>,
        is_only: bool,
        bounce: &Bounce,
    ) -> Result<()> {
        let Some(Inside { chunks, ways, onward, gather }) = &self.inside else { return Ok(()) };
        // The first is the last that is put before others.
        for way in (1..=*ways).rev() {
            self.surface.leave(recorder, task.supply, search, normal, points, is_only, way, onward)?;
            let task = Task {
                mirror: &onward.rays,
                normal: &onward.normal,
                seen: &self.found,
                counters: &self.counters,
                ..*task
            };
            methods.trace(recorder, gather, &task, chunks, Rays::WithEnds)?;
            let [albedo_in, normal_in, position_in] = self.found.bind();
            let [albedo_out, normal_out, position_out] = bounce.seen.bind();
            let bindings = passes::clear_inside {
                point_in: onward.rays.point.bind(),
                eye_in: onward.rays.eye.bind(),
                albedo_in,
                normal_in,
                position_in,
                albedo_out,
                normal_out,
                position_out,
                from_out: bounce.mirror.point.bind(),
            };
            recorder.over_pixels(&[], task.supply, bindings)?;
        }
        Ok(())
    }

    /// Takes what a task has found into its bounce: with the own colour of deep water, which is part of `surface`.
    /// `is_through` says whose rays the task has followed.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn take(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        surface: SurfaceImages<'_>,
        is_through: bool,
        bounce: &Bounce,
    ) -> Result<()> {
        let onward = if is_through { &self.surface.through } else { &self.later };
        let [albedo_in, normal_in, position_in] = self.found.bind();
        let [albedo_out, normal_out, position_out] = bounce.seen.bind();
        let bindings = passes::clear_depth {
            point_in: onward.rays.point.bind(),
            direction_in: onward.normal.bind(),
            index_in: onward.index.bind(),
            own_albedo_in: surface.albedo.bind(),
            own_normal_in: surface.normal.bind(),
            albedo_in,
            normal_in,
            position_in,
            albedo_out,
            normal_out,
            position_out,
            from_out: bounce.mirror.point.bind(),
        };
        recorder.over_pixels(&[], task.supply, bindings)
    }

    /// Looks up the index of refraction of the points that a task has found, for the next bounce; `knows_points` is
    /// then to be set to the result. Methods that keep no hits report nothing.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn learn_points(&self, recorder: &mut Recorder<'_>, methods: &Methods, task: &Task<'_>) -> Result<bool> {
        let goes_on = task.bounce + 1 < task.settings.reflection.bounces as usize;
        let hits = methods.hits().filter(|_| goes_on && task.store.has_clear_points(task.settings));
        let Some(hits) = hits else { return Ok(false) };
        let bindings = passes::clear_hits { hits: hits.as_entire_binding(), index_out: self.points.bind() };
        recorder.over_page_pixels(task.supply, bindings, task.supply.pixel_groups())?;
        Ok(true)
    }

    /// Adds up what each mirror pixel of the camera receives: by reflection, whose bounces are these unless it is
    /// `received`, and through its surface.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn blend(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        bounces: &[Bounce],
        received: Option<&Image>,
    ) -> Result<()> {
        let (Some(first), Some(beyond)) = (bounces.first(), self.bounces.first()) else { return Ok(()) };
        let reach = first.reach.as_ref().filter(|_| received.is_none());
        let bindings = passes::clear_blend {
            seen_in: first.seen.position.bind(),
            reflected_in: received.unwrap_or(&first.blended).bind(),
            point_in: beyond.mirror.point.bind(),
            direction_in: self.surface.through.normal.bind(),
            beyond_in: beyond.seen.position.bind(),
            transmitted_in: beyond.blended.bind(),
            received_out: self.received.bind(),
            left_in: reach.unwrap_or(&first.blended).bind(),
        };
        let switches = [("is_received", u32::from(received.is_some())), ("fades", u32::from(reach.is_some()))];
        recorder.over_mirrors(&switches, inputs, bindings)
    }
}
