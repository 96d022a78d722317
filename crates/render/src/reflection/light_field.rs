//! Offset surface light fields (after a thesis of Ang, 2003): maps of the points stand all over each mirror, a little off
//! its surface, and a reflected ray is looked up in that of a sample near to its mirror point.
//! docs/methods/light_field.md has the rules.
//!
//! Maps do not depend on the camera. Only those are drawn that a frame needs; the longest unused ones make room for
//! others. A texel is the disc of its nearest point, by its identity, so colours may change.

mod grid;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use std::sync::Arc;

use glam::DVec3;
use scene::{Method, MirrorSurface, OwnPoints, SampleRest, Settings, Splat};

use super::cubemap_trace::{farthest, own_chunks};
use super::cubemaps::{Layout, MapCount, MapRoom, Pen, radius_of, renumber, splat_of_maps};
use super::environment_map::EnvironmentMap;
use super::gather::{Gather, rest_list};
use super::mirror_places::{MirrorMap, MirrorPlace, mirror_places, upload};
use super::surfel_index::SurfelIndex;
use super::surfel_trace::{self, Rays};
use super::task::Task;
use crate::gpu::{Error, Gpu, Result};
use crate::identities::{CloudId, Identities};
use crate::layout::{FieldSample, Fields, NEED_BYTES};
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::targets::storage;
use grid::Grid;

/// The least number of maps that a page has room for, if there is room for more.
const LEAST_PAGE: usize = 8;

/// The maps, with the inputs from which they were drawn.
#[derive(Default)]
pub(crate) struct LightField {
    kept: Option<Kept>,
    /// The rays that no sample resolves.
    pub(crate) rest: Option<wgpu::Buffer>,
    /// The numbers of the frame and of the search.
    frame: u64,
    search: u64,
    /// Whether the frame may do with missing and old maps, and how many it may still draw.
    may_lag: bool,
    left: Option<u32>,
    /// Whether the frame lacked maps, or the newest points in some.
    lags: bool,
    count: Option<MapCount>,
    map_use: Option<MapUse>,
    /// Whether the frame has not searched yet.
    is_new_frame: bool,
}

/// What the maps of a picture took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapUse {
    /// The maps that were drawn for it.
    pub new: u32,
    /// Those that stood before, needed or not.
    pub kept: u32,
    /// The share of what mirror pixels ask for of which no map stood: each asks for its nearest sample most.
    pub missed: f64,
    /// The memory of the maps.
    pub bytes: u64,
    /// What limits the maps, if something does.
    pub limit: Option<MapLimit>,
}

/// What limits the maps of light fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapLimit {
    /// `light_field.memory`: fewer maps stand than the picture needs.
    Memory,
    /// One binding of the adapter: maps lie on more pages than they would without.
    Binding,
}

impl MapLimit {
    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Memory => "light_field.memory",
            Self::Binding => "one binding of the adapter",
        }
    }
}

/// The number of looks at each ray that are blended; 1 where one is shown, as with other methods.
pub(crate) fn looks(settings: &Settings) -> u32 {
    let field = &settings.light_field;
    let blends = settings.reflection.method == Method::LightField && field.rule.blends();
    if blends { field.neighbours.min(field.samples) } else { 1 }
}

/// What maps are drawn from besides their places.
#[derive(Clone, PartialEq)]
struct Drawn {
    splat: Splat,
    surface: MirrorSurface,
    size: u32,
    offset: f32,
    samples: u32,
    is_own_drawn: bool,
    /// The most maps that may be kept.
    most: usize,
}

struct Kept {
    drawn: Drawn,
    revision: u64,
    fields: Vec<Field>,
    /// The number of the next field.
    next: u64,
    pages: Vec<Page>,
    /// The room for maps in all pages, one after the other.
    slots: Vec<Option<Map>>,
    /// Those of the points in the maps, and the frame in which they were made.
    identities: Arc<Identities>,
    renumbered: u64,
    index: Option<wgpu::Buffer>,
}

/// A page of maps: a buffer of at most one binding of the adapter.
struct Page {
    records: wgpu::Buffer,
    first: usize,
    slots: usize,
}

/// The samples of a mirror.
struct Field {
    number: u64,
    mirror: MirrorPlace,
    /// The samples on the surface, and the two places where the map of each may stand.
    samples: Vec<(DVec3, [DVec3; 2])>,
    grid: Grid,
}

/// A map that stands.
#[derive(Clone, Copy)]
struct Map {
    /// The number of its field and that of its sample.
    of: (u64, usize),
    place: DVec3,
    /// Whether it lacks the newest points.
    is_stale: bool,
    /// The frame in which it was drawn, and the search that needed it last.
    drawn: u64,
    used: u64,
}

/// A sample of a field, by their places in `Kept::fields` and in the field.
type Sample = (usize, usize);

impl LightField {
    pub fn bytes(&self) -> u64 {
        let kept = self.kept.iter().flat_map(|kept| kept.pages.iter().map(|page| &page.records).chain(&kept.index));
        kept.chain(&self.rest).map(wgpu::Buffer::size).sum()
    }

    /// Makes the next frame draw the maps anew.
    pub fn forget(&mut self) {
        self.kept = None;
    }

    /// Begins a frame. With `may_lag` it draws at most `maps_per_frame` maps. If the one before was given up, what it has
    /// drawn is not kept.
    pub fn begin(&mut self, was_unfinished: bool, may_lag: bool) {
        if was_unfinished {
            self.kept = self.kept.take().filter(|kept| kept.renumbered != self.frame);
            for slot in self.kept.iter_mut().flat_map(|kept| &mut kept.slots) {
                *slot = slot.filter(|map| map.drawn != self.frame);
            }
        }
        self.frame += 1;
        (self.may_lag, self.left, self.lags, self.is_new_frame) = (may_lag, None, false, true);
    }

    /// Whether the frame lacked maps, or the newest points in some.
    pub fn lags(&self) -> bool {
        self.lags
    }

    /// The maps that stand of those that the camera's picture needs.
    pub fn count(&self) -> Option<MapCount> {
        self.count
    }

    /// What the maps of the last frame took that searched.
    pub fn map_use(&self) -> Option<MapUse> {
        self.map_use
    }

    /// Fills the Mirror G-Buffer of one bounce.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory, or not even one map fits.
    pub fn run(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        environment: &mut EnvironmentMap,
        gather: &Gather,
        task: &Task<'_>,
    ) -> Result<()> {
        let mirrors = mirror_places(task);
        let layout = Layout::new(task.settings.light_field.size);
        let [most, of_page] = most_maps(recorder.gpu, task.settings, &layout)?;
        self.search += 1;
        self.stand(recorder, task, &mirrors, most)?;
        let of_mirror = |map| Some(MirrorMap { map, view: glam::Vec4::ZERO });
        let places = upload(recorder.gpu, &mirrors, task.store.bounds(), task.supply.camera.eye, of_mirror);
        self.draw_needed(recorder, task, &layout, &places, of_page)?;
        self.look_up(recorder, gather, task, &layout, &places)?;
        let own = own_chunks(task, &mirrors, task.settings.light_field.own, task.supply.camera.eye);
        if !own.is_empty() {
            surfel_trace::trace(recorder, index, gather, task, &own, Rays::All)?;
        }
        let rest_by = task.settings.light_field.rest;
        if let Some(rest) = self.rest.as_ref().filter(|_| rest_by == SampleRest::SurfelTrace) {
            surfel_trace::trace(recorder, index, gather, task, &task.supply.chunks, Rays::Listed(rest))?;
        }
        gather.complete(recorder, task, |recorder, found| {
            gather.resolve_points(recorder, task, found.bind())?;
            if rest_by == SampleRest::EnvironmentMap {
                environment.fill(recorder, gather, task, found, true)?;
            }
            Ok(())
        })
    }

    /// Makes the samples of the mirrors, and drops the maps that are no longer those of a sample.
    fn stand(
        &mut self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        mirrors: &[MirrorPlace],
        most: usize,
    ) -> Result<()> {
        let settings = &task.settings.light_field;
        let drawn = Drawn {
            splat: splat_of_maps(task.settings),
            surface: task.settings.mirror.surface,
            size: settings.size,
            offset: settings.offset,
            samples: settings.samples,
            is_own_drawn: settings.own == OwnPoints::Drawn,
            most,
        };
        let revision = task.store.geometry_revision();
        let kept = self.kept.take().filter(|kept| kept.drawn == drawn);
        let mut kept = kept.unwrap_or_else(|| Kept {
            drawn,
            revision,
            fields: Vec::new(),
            next: 0,
            pages: Vec::new(),
            slots: Vec::new(),
            identities: task.store.identities().clone(),
            renumbered: 0,
            index: None,
        });
        let mut before = std::mem::take(&mut kept.fields);
        let order: Vec<u64> = before.iter().map(|field| field.number).collect();
        for mirror in mirrors {
            let known = before.iter().position(|field| field.mirror == *mirror);
            let field = known.map(|known| before.swap_remove(known)).unwrap_or_else(|| {
                kept.next += 1;
                Field::new(kept.next, mirror, &kept.drawn)
            });
            kept.fields.push(field);
        }
        let is_field = |number: u64| kept.fields.iter().any(|field| field.number == number);
        for slot in &mut kept.slots {
            *slot = slot.filter(|map| is_field(map.of.0));
        }
        if kept.fields.iter().map(|field| field.number).ne(order) {
            kept.index = None;
        }
        if kept.revision != revision {
            kept.revision = revision;
            if self.may_lag {
                renumber(recorder, task, &mut kept.identities, kept.pages.iter().map(|page| &page.records))?;
                kept.renumbered = self.frame;
                kept.slots.iter_mut().flatten().for_each(|map| map.is_stale = true);
            } else {
                kept.identities = task.store.identities().clone();
                kept.slots.fill(None);
            }
        }
        self.kept = Some(kept);
        Ok(())
    }

    /// Draws the maps that the mirror pixels need.
    fn draw_needed(
        &mut self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        layout: &Layout,
        places: &wgpu::Buffer,
        of_page: usize,
    ) -> Result<()> {
        let Some(kept) = &mut self.kept else { return Ok(()) };
        let needs = kept.needed(recorder, task, places)?;
        let of_frame = std::mem::take(&mut self.is_new_frame);
        if of_frame {
            self.map_use = Some(kept.used_before(&needs));
        }
        let needed: Vec<Sample> = needs.into_iter().map(|(_, sample)| sample).collect();
        let chosen = &needed[..needed.len().min(kept.drawn.most)];
        let mut missing = 0;
        for sample in chosen {
            match kept.slot_of(*sample).and_then(|slot| kept.slots[slot].as_mut()) {
                Some(map) => map.used = self.search,
                None => missing += 1,
            }
        }
        kept.make_room(recorder.gpu, missing, layout, of_page);
        if self.may_lag && self.left.is_none() {
            self.left = Some(task.settings.light_field.maps_per_frame);
        }
        let mut pen = None;
        let mut standing = 0;
        for sample in chosen {
            let slot = kept.slot_of(*sample);
            if slot.and_then(|slot| kept.slots[slot]).is_some_and(|map| !map.is_stale) {
                standing += 1;
                continue;
            }
            if self.left == Some(0) {
                self.lags = true;
                continue;
            }
            self.left = self.left.map(|left| left - 1);
            let Some(slot) = slot.or_else(|| kept.least_used(self.search)) else { continue };
            recorder.time_as(Some(("cubemaps", PassStage::Method)));
            let pen = pen.get_or_insert_with(|| Pen::new(recorder, task, layout));
            kept.draw(recorder, pen, slot, *sample, [self.frame, self.search])?;
            recorder.time_as(None);
            standing += 1;
            self.map_use.iter_mut().for_each(|map_use| map_use.new += 1);
        }
        if let Some(map_use) = &mut self.map_use {
            map_use.bytes = kept.pages.iter().map(|page| page.records.size()).sum();
            let is_short = of_frame && needed.len() > kept.drawn.most;
            let is_cut = kept.pages.iter().any(|page| page.slots == of_page) && kept.drawn.most > of_page;
            let limit = if is_short { Some(MapLimit::Memory) } else { is_cut.then_some(MapLimit::Binding) };
            map_use.limit = if of_frame { limit } else { map_use.limit.or(limit) };
        }
        if task.bounce == 0 {
            self.count = Some(MapCount { drawn: standing, asked: needed.len() as u32 });
        }
        Ok(())
    }

    /// Looks the rays up in the maps that stand.
    fn look_up(
        &mut self,
        recorder: &mut Recorder<'_>,
        gather: &Gather,
        task: &Task<'_>,
        layout: &Layout,
        places: &wgpu::Buffer,
    ) -> Result<()> {
        let Some(kept) = &mut self.kept else { return Ok(()) };
        let (gpu, eye) = (recorder.gpu, task.supply.camera.eye);
        let slots: Vec<Vec<Option<usize>>> = kept.slots_of_samples();
        // What a picture shows must not depend on the frames before, which have left other maps.
        let may_use = |slot: usize| kept.slots[slot].filter(|map| self.may_lag || map.used == self.search);
        let sample = |((surface, places), slot): (&(DVec3, [DVec3; 2]), &Option<usize>)| {
            let map = slot.and_then(|slot| may_use(slot).map(|map| (slot, map.place)));
            let (slot, place) = map.map_or((-1.0, places[0]), |(slot, place)| (slot as f32, place));
            let relative = |place: DVec3| (place - eye).as_vec3();
            FieldSample { surface_slot: relative(*surface).extend(slot), middle: relative(place).extend(0.0) }
        };
        let of_field = |(field, slots): (&Field, &Vec<Option<usize>>)| {
            field.samples.iter().zip(slots).map(sample).collect::<Vec<FieldSample>>()
        };
        let samples: Vec<FieldSample> = kept.fields.iter().zip(&slots).flat_map(of_field).collect();
        let samples = filled(gpu, "samples of mirrors", bytemuck::cast_slice(&samples));
        let index = kept.index(gpu);
        let nothing = storage(&gpu.device, "no maps", 16);
        let none = Page { records: nothing, first: 0, slots: 0 };
        let pages: Vec<&Page> = if kept.pages.is_empty() { vec![&none] } else { kept.pages.iter().collect() };
        let rest = rest_list(recorder, &mut self.rest, task.supply.size);
        let settings = &task.settings.light_field;
        let blends = settings.rule.blends();
        let switches = [
            ("counts", u32::from(task.bounce == 0)),
            ("rule", settings.rule as u32),
            ("blends", u32::from(blends)),
            ("visible_by", settings.visible_by as u32),
            ("rest_of_rays", settings.rest as u32),
        ];
        // Which samples tell what a ray meets is known after all pages; then one of them is taken.
        let rounds = if blends { 2 } else { 1 };
        let all = (0..rounds).flat_map(|round| pages.iter().map(move |page| (round, *page)));
        for (number, (round, page)) in all.enumerate() {
            let fields = Fields {
                size: layout.size,
                texels_of_face: layout.texels_of_face,
                first_slot: page.first as u32,
                slots: page.slots as u32,
                is_first: u32::from(number == 0),
                is_last: u32::from(number + 1 == rounds * pages.len()),
                picks: u32::from(round > 0),
                ..Fields::default()
            };
            let fields = kept.head(gpu, fields, eye);
            let bindings = passes::light_field_look_up {
                point_in: task.mirror.point.bind(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
                mirrors: places.as_entire_binding(),
                fields: fields.as_entire_binding(),
                index: index.as_entire_binding(),
                samples: samples.as_entire_binding(),
                records: page.records.as_entire_binding(),
                hits: gather.hits.as_entire_binding(),
                rest: rest.as_entire_binding(),
                views_out: gather.views.bind(),
                counters: task.counters.as_entire_binding(),
            };
            recorder.by_rows(&switches, task.supply, bindings, task.supply.mirror_groups())?;
        }
        Ok(())
    }
}

/// The most maps that may be kept, and the most that a page has room for.
fn most_maps(gpu: &Gpu, settings: &Settings, layout: &Layout) -> Result<[usize; 2]> {
    let bytes = layout.record_bytes();
    let of_adapter = (gpu.device.limits().max_storage_buffer_binding_size, gpu.info.name.clone());
    let of_settings = (settings.light_field.memory.0, "light_field.memory".to_owned());
    for (limit, adapter) in [&of_adapter, &of_settings] {
        if bytes > *limit {
            let (what, advice) = ("a map of a light field", "; lower light_field.size");
            return Err(Error::TooLarge { what, bytes, limit: *limit, adapter: adapter.clone(), advice });
        }
    }
    Ok([of_settings.0, of_adapter.0].map(|limit| (limit / bytes) as usize))
}

/// A buffer with these bytes; it must not be empty.
fn filled(gpu: &Gpu, label: &'static str, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = storage(&gpu.device, label, bytes.len().max(64) as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

impl Field {
    fn new(number: u64, mirror: &MirrorPlace, drawn: &Drawn) -> Self {
        let offset = f64::from(drawn.offset) * radius_of(&mirror.bounds);
        let beside = |sample: usize| {
            let (place, normal) = mirror.samples[sample];
            (place, [place + normal * offset, place - normal * offset])
        };
        // The first does not depend on the order of the points.
        let mean = mirror.samples.iter().map(|(place, _)| *place).sum::<DVec3>() / mirror.samples.len().max(1) as f64;
        let away = |sample: &usize| mirror.samples[*sample].0.distance_squared(mean);
        let first = (0..mirror.samples.len()).max_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0);
        let chosen = farthest(&mirror.samples, first, drawn.samples as usize);
        let mut samples: Vec<_> = chosen.into_iter().map(beside).collect();
        if samples.is_empty() {
            samples.push((mirror.bounds.center(), [mirror.bounds.center(); 2]));
        }
        let places: Vec<DVec3> = samples.iter().map(|(place, _)| *place).collect();
        let grid = Grid::new(&places, &mirror.bounds);
        Self { number, mirror: mirror.clone(), samples, grid }
    }

    /// The cloud that its maps do not show.
    fn hidden(&self, drawn: &Drawn) -> Option<CloudId> {
        self.mirror.cloud.filter(|_| !drawn.is_own_drawn)
    }
}

impl Kept {
    /// The cells of all mirrors with the numbers of their samples.
    fn index(&mut self, gpu: &Gpu) -> wgpu::Buffer {
        if self.index.is_none() {
            let mut words: Vec<u32> = Vec::new();
            let mut first = 0;
            for field in &self.fields {
                let number = |sample: &u32| sample.checked_add(first).unwrap_or(*sample);
                words.extend(field.grid.cells.iter().flatten().map(number));
                first += field.samples.len() as u32;
            }
            self.index = Some(filled(gpu, "index of samples", bytemuck::cast_slice(&words)));
        }
        self.index.clone().unwrap_or_else(|| filled(gpu, "index of samples", &[]))
    }

    /// The head of a pass, with the grids of the mirrors.
    fn head(&self, gpu: &Gpu, fields: Fields, eye: DVec3) -> wgpu::Buffer {
        let mut first = 0;
        let grid = |field: &Field| {
            let grid = field.grid.to_gpu(eye, first);
            first += field.grid.cells.len() as u32;
            grid
        };
        let grids: Vec<crate::layout::SampleGrid> = self.fields.iter().map(grid).collect();
        filled(gpu, "light fields", &[bytemuck::bytes_of(&fields), bytemuck::cast_slice(&grids)].concat())
    }

    /// What a picture finds that needs these samples, each with how much it is asked for.
    fn used_before(&self, needs: &[(u32, Sample)]) -> MapUse {
        // The sum of nothing is -0.
        let asked = |counts: &[(u32, Sample)]| counts.iter().fold(0.0, |sum, (count, _)| sum + f64::from(*count));
        let missing: Vec<(u32, Sample)> =
            needs.iter().filter(|(_, sample)| self.slot_of(*sample).is_none()).copied().collect();
        let all = asked(needs);
        MapUse {
            new: 0,
            kept: self.slots.iter().flatten().count() as u32,
            missed: if all > 0.0 { asked(&missing) / all } else { 0.0 },
            bytes: 0,
            limit: None,
        }
    }

    /// The samples that mirror pixels need, each with how much it is asked for, those of most pixels first.
    fn needed(
        &mut self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        places: &wgpu::Buffer,
    ) -> Result<Vec<(u32, Sample)>> {
        let (gpu, eye) = (recorder.gpu, task.supply.camera.eye);
        let relative = |place: DVec3| (place - eye).as_vec3();
        let sample = |(surface, _): &(DVec3, [DVec3; 2])| FieldSample {
            surface_slot: relative(*surface).extend(0.0),
            ..FieldSample::default()
        };
        let samples: Vec<FieldSample> = self.fields.iter().flat_map(|field| field.samples.iter().map(sample)).collect();
        let needs = storage(&gpu.device, "maps that are needed", NEED_BYTES * samples.len().max(1) as u64);
        recorder.clear(&needs);
        let index = self.index(gpu);
        let fields = self.head(gpu, Fields::default(), eye);
        let samples = filled(gpu, "samples of mirrors", bytemuck::cast_slice(&samples));
        let bindings = passes::light_field_need {
            point_in: task.mirror.point.bind(),
            mirrors: places.as_entire_binding(),
            fields: fields.as_entire_binding(),
            index: index.as_entire_binding(),
            samples: samples.as_entire_binding(),
            needs: needs.as_entire_binding(),
        };
        recorder.over_mirrors(&[], task.supply, bindings)?;
        let all = self.fields.iter().enumerate();
        let all = all.flat_map(|(field, of)| (0..of.samples.len()).map(move |sample| (field, sample)));
        let Some(bytes) = recorder.read(&needs)? else { return Ok(all.map(|sample| (1, sample)).collect()) };
        let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        let mut needed: Vec<(u32, Sample)> = counts.into_iter().zip(all).filter(|(count, _)| *count > 0).collect();
        // Those that are asked for as much keep their order.
        needed.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        Ok(needed)
    }

    /// Makes room for so many more maps than stand, as far as it goes.
    fn make_room(&mut self, gpu: &Gpu, more: usize, layout: &Layout, of_page: usize) {
        let wanted = (self.slots.iter().flatten().count() + more).min(self.drawn.most);
        while self.slots.len() < wanted {
            let stand = self.slots.len();
            // Pages grow, so that there are few.
            let slots = (wanted - stand).max(stand).max(LEAST_PAGE).min(self.drawn.most - stand).min(of_page);
            let records = storage(&gpu.device, "maps of light fields", layout.record_bytes() * slots as u64);
            self.pages.push(Page { records, first: stand, slots });
            self.slots.resize(stand + slots, None);
        }
    }

    fn slot_of(&self, (field, sample): Sample) -> Option<usize> {
        let of = (self.fields[field].number, sample);
        self.slots.iter().position(|slot| slot.is_some_and(|map| map.of == of))
    }

    /// For each sample of each field, the slot of its map.
    fn slots_of_samples(&self) -> Vec<Vec<Option<usize>>> {
        let mut slots: Vec<Vec<Option<usize>>> =
            self.fields.iter().map(|field| vec![None; field.samples.len()]).collect();
        for (slot, map) in self.slots.iter().enumerate() {
            let Some(map) = map else { continue };
            let field = self.fields.iter().position(|field| field.number == map.of.0);
            if let Some(place) = field.and_then(|field| slots[field].get_mut(map.of.1)) {
                *place = Some(slot);
            }
        }
        slots
    }

    /// A free slot, or that of the map that was not needed for longest, if this search does not need it.
    fn least_used(&self, search: u64) -> Option<usize> {
        let used = |slot: &usize| self.slots[*slot].map_or(0, |map| map.used);
        (0..self.slots.len()).min_by_key(used).filter(|slot| used(slot) < search)
    }

    /// Draws the map of a sample in a slot.
    fn draw(
        &mut self,
        recorder: &mut Recorder<'_>,
        pen: &Pen<'_>,
        slot: usize,
        (field, sample): Sample,
        [drawn, used]: [u64; 2],
    ) -> Result<()> {
        let field = &self.fields[field];
        self.slots[slot] = None;
        let page = self.pages.iter().find(|page| (page.first..page.first + page.slots).contains(&slot));
        let Some(page) = page else { return Ok(()) };
        let room = MapRoom { records: &page.records, map: slot - page.first };
        let place = pen.draw_map(recorder, room, field.samples[sample].1, &field.mirror, field.hidden(&self.drawn))?;
        self.slots[slot] = Some(Map { of: (field.number, sample), place, is_stale: false, drawn, used });
        Ok(())
    }
}
