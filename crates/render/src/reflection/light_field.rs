//! Offset surface light fields (after a thesis of Ang, 2003): maps of the points stand all over each mirror, a little off
//! its surface, and a reflected ray is looked up in that of a sample near to its mirror point.
//! docs/methods/light_field.md has the rules.
//!
//! Maps do not depend on the camera. Only those are drawn that a frame needs; the longest unused ones make room for
//! others. A texel is the disc of its nearest point, by its identity, so colours may change.

mod asked;
mod choice;
mod grid;
mod kept;
mod slots;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use std::collections::HashSet;

use scene::{MapFill, Method, OwnPoints, SampleRest, Settings};

use super::cubemap_trace::own_chunks;
use super::cubemaps::{Layout, MapCount, Pen, renumber, splat_of_task};
use super::environment_map::EnvironmentMap;
use super::gather::{Gather, rest_list};
use super::mirror_places::{MirrorMap, MirrorPlace, own_places, upload};
use super::surfel_index::SurfelIndex;
use super::surfel_trace::{self, Rays};
use super::task::Task;
use crate::gpu::{Error, Gpu, Result};
use crate::layout::{Fields, TEXELS_TRACED};
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::targets::storage;
use asked::{AskedBuffers, SIDE_TEXELS};
use kept::{Drawn, Field, Kept, Page, Sample};
use slots::Slots;

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
    /// The number of maps that stood before, needed or not.
    pub kept: u32,
    /// The share of what mirror pixels ask for of which no map stood: each asks for its nearest sample most.
    pub missed: f64,
    /// The memory of the maps.
    pub bytes: u64,
    /// What limits the maps, if something does.
    pub limit: Option<MapLimit>,
    /// The share of mirror pixels that are predicted to be off by more than `light_field.accuracy`, if that chooses maps.
    pub off: Option<f64>,
    /// The texels that were traced for it, where that is left until a ray looks at them.
    pub texels: Option<u32>,
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

impl LightField {
    /// What one of how many points the maps show.
    pub fn step(&self) -> Option<u32> {
        self.kept.as_ref().map(|kept| kept.drawn.splat.step)
    }

    pub fn bytes(&self) -> u64 {
        let of_page = |page: &Page| page.records.size() + page.listed.as_ref().map_or(0, wgpu::Buffer::size);
        let pages = self.kept.iter().flat_map(|kept| &kept.pages).map(of_page).sum::<u64>();
        let index = self.kept.as_ref().and_then(|kept| kept.index.as_ref()).map_or(0, |index| index.cells.size());
        pages + index + self.rest.as_ref().map_or(0, wgpu::Buffer::size)
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
            for slot in self.kept.iter_mut().flat_map(|kept| &mut kept.slots.0) {
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
        let mirrors = own_places(task);
        let layout = Layout::new(task.settings.light_field.size);
        let [most, of_page] = most_maps(recorder.gpu, task.settings, &layout)?;
        self.search += 1;
        self.stand(recorder, task, &mirrors, most)?;
        let of_mirror = |map| Some(MirrorMap { map, view: glam::Vec4::ZERO });
        let places = upload(recorder.gpu, &mirrors, task.store.bounds(), task.supply.camera.eye, of_mirror);
        self.draw_needed(recorder, index, task, &layout, &places, of_page)?;
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
            splat: splat_of_task(task, self.kept.as_ref().map(|kept| &kept.drawn.splat)),
            surface: task.settings.mirror.surface,
            size: settings.size,
            offset: settings.offset,
            samples: settings.samples,
            fill: settings.fill,
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
            slots: Slots::default(),
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
        for slot in &mut kept.slots.0 {
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
                kept.slots.0.iter_mut().flatten().for_each(|map| map.is_stale = true);
            } else {
                kept.identities = task.store.identities().clone();
                kept.slots.0.fill(None);
            }
        }
        self.kept = Some(kept);
        Ok(())
    }

    /// Draws the maps that the mirror pixels need; with `light_field.accuracy` those of more and more samples.
    fn draw_needed(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        task: &Task<'_>,
        layout: &Layout,
        places: &wgpu::Buffer,
        of_page: usize,
    ) -> Result<()> {
        let is_choosing = task.settings.light_field.accuracy > 0.0;
        let of_frame = std::mem::take(&mut self.is_new_frame);
        let Some(kept) = &mut self.kept else { return Ok(()) };
        kept.fields.iter_mut().for_each(|field| field.begin(is_choosing));
        let stood: HashSet<(u64, usize)> = kept.slots.0.iter().flatten().map(|map| map.of).collect();
        if of_frame {
            let texels = TEXELS_TRACED as u64 * 4;
            recorder.clear_part(task.counters, texels..texels + 4);
            let kept = stood.len() as u32;
            self.map_use = Some(MapUse { new: 0, kept, missed: 0.0, bytes: 0, limit: None, off: None, texels: None });
        }
        let (mut is_short, mut off) = (false, None);
        let (needs, standing) = loop {
            let Some(kept) = &mut self.kept else { return Ok(()) };
            let needs = kept.needed(recorder, task, places)?;
            let (standing, is_whole) = self.draw(recorder, index, task, layout, of_page, &needs)?;
            self.trace_asked(recorder, index, task, layout, places)?;
            let Some(kept) = self.kept.as_mut().filter(|_| is_choosing && is_whole) else { break (needs, standing) };
            let added = kept.predict(recorder, task, layout, places, self.search, self.may_lag)?;
            off = added.off;
            is_short |= added.is_short;
            if !added.is_any {
                break (needs, standing);
            }
        };
        let Some(kept) = &self.kept else { return Ok(()) };
        if let Some(map_use) = &mut self.map_use {
            map_use.bytes = kept.pages.iter().map(|page| page.records.size()).sum();
            let is_short = of_frame && (is_short || needs.len() > kept.drawn.most);
            let is_cut = kept.pages.iter().any(|page| page.slots == of_page) && kept.drawn.most > of_page;
            let limit = if is_short { Some(MapLimit::Memory) } else { is_cut.then_some(MapLimit::Binding) };
            map_use.limit = if of_frame { limit } else { map_use.limit.or(limit) };
            if of_frame {
                // The sum of nothing is -0.
                let sum = |asked: &mut dyn Iterator<Item = &(u32, Sample)>| {
                    asked.fold(0.0, |sum, (count, _)| sum + f64::from(*count))
                };
                let missing = sum(&mut needs.iter().filter(|(_, sample)| !stood.contains(&kept.number_of(*sample))));
                (map_use.missed, map_use.off) = (missing / sum(&mut needs.iter()).max(1.0), off);
            }
        }
        if task.bounce == 0 {
            self.count = Some(MapCount { drawn: standing, asked: needs.len() as u32 });
        }
        Ok(())
    }

    /// Draws the maps that are needed and do not stand. Returns how many of them stand, and whether these are all that fit.
    fn draw(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        task: &Task<'_>,
        layout: &Layout,
        of_page: usize,
        needs: &[(u32, Sample)],
    ) -> Result<(u32, bool)> {
        let Some(kept) = &mut self.kept else { return Ok((0, true)) };
        let chosen = &needs[..needs.len().min(kept.drawn.most)];
        let numbers: Vec<(u64, usize)> = chosen.iter().map(|(_, sample)| kept.number_of(*sample)).collect();
        let missing = kept.slots.need(&numbers, self.search);
        kept.make_room(recorder.gpu, missing, layout, of_page);
        if self.may_lag && self.left.is_none() {
            self.left = Some(task.settings.light_field.maps_per_frame);
        }
        let is_partial = kept.drawn.fill == MapFill::OnDemand;
        let of_side = Layout::new(SIDE_TEXELS);
        let of_pen = if is_partial { &of_side } else { layout };
        let mut trees = (kept.drawn.fill != MapFill::Draw).then_some(index);
        let mut pen = None;
        let mut is_whole = true;
        let mut slots = std::mem::take(&mut kept.slots);
        let standing = slots.fill(&numbers, self.search, |number, slot| {
            if self.left == Some(0) {
                is_whole = false;
                return Ok(None);
            }
            self.left = self.left.map(|left| left - 1);
            self.map_use.iter_mut().for_each(|map_use| map_use.new += 1);
            recorder.time_as(Some(("cubemaps", PassStage::Method)));
            let pen = pen.get_or_insert_with(|| Pen::new(recorder, task, of_pen, &kept.drawn.splat, trees.take()));
            let map = kept.draw(recorder, pen, layout, slot, chosen[number].1, [self.frame, self.search])?;
            recorder.time_as(None);
            Ok(map)
        });
        kept.slots = slots;
        self.lags |= !is_whole;
        Ok((standing?, is_whole))
    }

    /// Traces the texels at which mirror pixels look, where that is left until they do.
    fn trace_asked(
        &mut self,
        recorder: &mut Recorder<'_>,
        trees: &mut SurfelIndex,
        task: &Task<'_>,
        layout: &Layout,
        places: &wgpu::Buffer,
    ) -> Result<()> {
        let Some(kept) = self.kept.as_mut().filter(|kept| kept.drawn.fill == MapFill::OnDemand) else { return Ok(()) };
        let index = kept.index(recorder.gpu, false);
        let samples = kept.samples(recorder.gpu, task.supply.camera.eye, self.search, self.may_lag);
        recorder.time_as(Some(("cubemaps", PassStage::Method)));
        kept.trace_asked(recorder, trees, task, layout, &AskedBuffers { places, index: &index, samples: &samples })?;
        recorder.time_as(None);
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
        let samples = kept.samples(gpu, eye, self.search, self.may_lag);
        let index = kept.index(gpu, false);
        let nothing = storage(&gpu.device, "no maps", 16);
        let none = Page { records: nothing, listed: None, first: 0, slots: 0 };
        let pages: Vec<&Page> = if kept.pages.is_empty() { vec![&none] } else { kept.pages.iter().collect() };
        let rest = rest_list(recorder, &mut self.rest, task.supply.size);
        let settings = &task.settings.light_field;
        let blends = settings.rule.blends();
        let counts = ("counts", u32::from(task.bounce == 0));
        let switches = [&kept.switches(task)[..], &[counts, ("rest_of_rays", settings.rest as u32)]].concat();
        // Which samples know what a ray meets is known after all pages; then one of them is taken.
        let rounds = if blends { 2 } else { 1 };
        let all = (0..rounds).flat_map(|round| pages.iter().map(move |page| (round, *page)));
        for (number, (round, page)) in all.enumerate() {
            let fields = Fields {
                is_first: u32::from(number == 0),
                is_last: u32::from(number + 1 == rounds * pages.len()),
                picks: u32::from(round > 0),
                ..page.fields(layout)
            };
            let fields = kept.head(gpu, fields, eye, false);
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
