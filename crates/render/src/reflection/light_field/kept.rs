//! The samples of mirrors, which of them are chosen, and the maps that stand.

use std::sync::Arc;

use glam::DVec3;
use scene::{MapFill, MirrorSurface, Splat};

use super::asked::SIDE_TEXELS;
use super::choice::{self, Choice};
use super::grid::Grid;
use super::slots::{Map, Slots};
use crate::gpu::{Gpu, Result};
use crate::identities::Identities;
use crate::layout::{FieldSample, Fields, NEED_BYTES, PREDICTED_BYTES, SampleGrid};
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::cubemap_trace::farthest;
use crate::reflection::cubemaps::{Layout, MapRoom, Pen, radius_of};
use crate::reflection::mirror_places::MirrorPlace;
use crate::reflection::task::Task;
use crate::targets::storage;

/// The least number of maps that a page has room for, if there is room for more.
const LEAST_PAGE: usize = 8;
/// How many choices of samples a mirror remembers: those of a few pictures.
const MOST_KNOWN: usize = 16;

/// What maps are drawn from besides their places.
#[derive(Clone, PartialEq)]
pub struct Drawn {
    pub splat: Splat,
    pub surface: MirrorSurface,
    pub size: u32,
    pub offset: f32,
    pub samples: u32,
    pub fill: MapFill,
    pub is_own_drawn: bool,
    /// The most maps that may be kept.
    pub most: usize,
}

pub struct Kept {
    pub drawn: Drawn,
    pub revision: u64,
    pub fields: Vec<Field>,
    /// The number of the next field.
    pub next: u64,
    pub pages: Vec<Page>,
    pub slots: Slots,
    /// The identities of the points in the maps, and the frame in which the maps were made.
    pub identities: Arc<Identities>,
    pub renumbered: u64,
    pub index: Option<Index>,
}

/// The cells of the samples that were chosen last.
pub struct Index {
    pub cells: wgpu::Buffer,
    chosen: Vec<Arc<[usize]>>,
    /// Whether those of all samples follow.
    has_all: bool,
}

/// A page of maps: a buffer of at most one binding of the adapter.
pub struct Page {
    pub records: wgpu::Buffer,
    /// A bit for each texel that was asked for, where texels are traced on demand.
    pub listed: Option<wgpu::Buffer>,
    pub first: usize,
    pub slots: usize,
}

impl Page {
    /// What a pass over the page gets to know of it.
    pub fn fields(&self, layout: &Layout) -> Fields {
        Fields {
            size: layout.size,
            texels_of_face: layout.texels_of_face,
            first_slot: self.first as u32,
            slots: self.slots as u32,
            ..Fields::default()
        }
    }
}

/// The samples of a mirror.
pub struct Field {
    pub number: u64,
    pub mirror: MirrorPlace,
    /// The samples on the surface, and the two places where the map of each may stand.
    pub samples: Vec<(DVec3, [DVec3; 2])>,
    pub all: Choice,
    /// The samples that the search looks up, and choices of searches before.
    pub chosen: Choice,
    pub known: Vec<Choice>,
}

/// A sample of a field, by their places in `Kept::fields` and in the field.
pub type Sample = (usize, usize);

/// A buffer with these bytes; it must not be empty.
pub fn filled(gpu: &Gpu, label: &'static str, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = storage(&gpu.device, label, bytes.len().max(64) as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

impl Field {
    pub fn new(number: u64, mirror: &MirrorPlace, drawn: &Drawn) -> Self {
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
        let all = Choice::new(&places, &mirror.bounds, (0..samples.len()).collect());
        Self { number, mirror: mirror.clone(), samples, chosen: all.clone(), all, known: Vec::new() }
    }

    /// Begins a search: with all samples, or with the first one, to which others may be added.
    pub fn begin(&mut self, is_choosing: bool) {
        if is_choosing {
            self.choose(vec![0]);
        } else {
            self.chosen = self.all.clone();
        }
    }

    /// Chooses samples, by their number in their order.
    fn choose(&mut self, samples: Vec<usize>) {
        let known = self.known.iter().chain([&self.all]).find(|known| *known.samples == *samples);
        self.chosen = known.cloned().unwrap_or_else(|| {
            let places: Vec<DVec3> = self.samples.iter().map(|(place, _)| *place).collect();
            let choice = Choice::new(&places, &self.mirror.bounds, samples);
            if self.known.len() == MOST_KNOWN {
                self.known.remove(0);
            }
            self.known.push(choice.clone());
            choice
        });
    }
}

/// What a prediction comes to.
pub struct Added {
    /// The share of mirror pixels that are off; `None` without any pixel.
    pub off: Option<f64>,
    /// Whether samples were added, and whether more would be if there were memory.
    pub is_any: bool,
    pub is_short: bool,
}

impl Kept {
    /// The grids of the samples that are chosen, and then those of all if they are asked for, each with the number of
    /// its mirror's first sample.
    fn grids(&self, with_all: bool) -> impl Iterator<Item = (&Grid, u32)> {
        let sets = if with_all { 2 } else { 1 };
        (0..sets).flat_map(|set| {
            self.fields.iter().scan(0, move |first, field| {
                let before = *first;
                *first += field.samples.len() as u32;
                Some((if set == 0 { &*field.chosen.grid } else { &*field.all.grid }, before))
            })
        })
    }

    /// The cells of these grids with the numbers of their samples.
    pub fn index(&mut self, gpu: &Gpu, with_all: bool) -> wgpu::Buffer {
        let chosen = || self.fields.iter().map(|field| &field.chosen.samples);
        if let Some(index) = self.index.as_ref().filter(|index| chosen().eq(&index.chosen) && index.has_all >= with_all)
        {
            return index.cells.clone();
        }
        let mut words: Vec<u32> = Vec::new();
        for (grid, first) in self.grids(with_all) {
            words.extend(grid.cells.iter().flatten().map(|sample| sample.checked_add(first).unwrap_or(*sample)));
        }
        let cells = filled(gpu, "index of samples", bytemuck::cast_slice(&words));
        self.index = Some(Index { cells: cells.clone(), chosen: chosen().cloned().collect(), has_all: with_all });
        cells
    }

    /// The head of a pass, with these grids.
    pub fn head(&self, gpu: &Gpu, fields: Fields, eye: DVec3, with_all: bool) -> wgpu::Buffer {
        let mut first = 0;
        let grid = |(grid, _): (&Grid, u32)| {
            let number = first;
            first += grid.cells.len() as u32;
            grid.to_gpu(eye, number)
        };
        let grids: Vec<SampleGrid> = self.grids(with_all).map(grid).collect();
        let fields = Fields { first_of_all: self.fields.len() as u32, ..fields };
        filled(gpu, "light fields", &[bytemuck::bytes_of(&fields), bytemuck::cast_slice(&grids)].concat())
    }

    /// The samples of all mirrors, with the slots of the maps that a search may look into.
    pub fn samples(&self, gpu: &Gpu, eye: DVec3, search: u64, may_lag: bool) -> wgpu::Buffer {
        let slots = self.slots_of_samples();
        // What a picture shows must not depend on the frames before, which have left other maps.
        let may_use = |slot: usize| self.slots.0[slot].filter(|map| may_lag || map.used == search);
        let sample = |((surface, places), slot): (&(DVec3, [DVec3; 2]), &Option<usize>)| {
            let map = slot.and_then(|slot| may_use(slot).map(|map| (slot, map.place)));
            let (slot, place) = map.map_or((-1.0, places[0]), |(slot, place)| (slot as f32, place));
            let relative = |place: DVec3| (place - eye).as_vec3();
            FieldSample { surface_slot: relative(*surface).extend(slot), middle: relative(place).extend(0.0) }
        };
        let of_field = |(field, slots): (&Field, &Vec<Option<usize>>)| {
            field.samples.iter().zip(slots).map(sample).collect::<Vec<FieldSample>>()
        };
        let samples: Vec<FieldSample> = self.fields.iter().zip(&slots).flat_map(of_field).collect();
        filled(gpu, "samples of mirrors", bytemuck::cast_slice(&samples))
    }

    /// Predicts which mirror pixels are off with the samples that are chosen, and adds some where too many are.
    pub fn predict(
        &mut self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        layout: &Layout,
        places: &wgpu::Buffer,
        search: u64,
        may_lag: bool,
    ) -> Result<Added> {
        let (gpu, eye) = (recorder.gpu, task.supply.camera.eye);
        let count: usize = self.fields.iter().map(|field| field.samples.len()).sum();
        let predicted = storage(&gpu.device, "predicted errors", 2 * PREDICTED_BYTES * count.max(1) as u64);
        recorder.clear(&predicted);
        let samples = self.samples(gpu, eye, search, may_lag);
        let index = self.index(gpu, true);
        let [x, y, z] = task.supply.mirror_groups();
        for page in &self.pages {
            let fields = self.head(gpu, page.fields(layout), eye, true);
            let bindings = passes::light_field_predict {
                point_in: task.mirror.point.bind(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
                mirrors: places.as_entire_binding(),
                fields: fields.as_entire_binding(),
                index: index.as_entire_binding(),
                samples: samples.as_entire_binding(),
                records: page.records.as_entire_binding(),
                predicted: predicted.as_entire_binding(),
            };
            recorder.over(&self.switches(task), task.supply, bindings, [x.div_ceil(2), y.div_ceil(2), z])?;
        }
        let Some(bytes) = recorder.read(&predicted)? else {
            return Ok(Added { off: None, is_any: false, is_short: false });
        };
        let counts: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
        let mut more: Vec<(u32, Sample)> = Vec::new();
        let mut first = 0;
        for (number, field) in self.fields.iter().enumerate() {
            let counts = &counts[first..first + field.samples.len()];
            first += field.samples.len();
            let places: Vec<DVec3> = field.samples.iter().map(|(place, _)| *place).collect();
            let added = choice::more(&places, counts, &field.chosen.samples);
            more.extend(added.into_iter().map(|(off, sample)| (off, (number, sample))));
        }
        // Where there is no room for all, those come first that most pixels miss.
        more.sort_by_key(|(off, _)| std::cmp::Reverse(*off));
        let chosen: usize = self.fields.iter().map(|field| field.chosen.samples.len()).sum();
        let room = self.drawn.most.saturating_sub(chosen);
        let is_short = more.len() > room;
        more.truncate(room);
        for (number, field) in self.fields.iter_mut().enumerate() {
            let added: Vec<usize> =
                more.iter().filter(|(_, of)| of.0 == number).map(|(_, (_, sample))| *sample).collect();
            if !added.is_empty() {
                let mut samples = [&field.chosen.samples[..], &added].concat();
                samples.sort_unstable();
                field.choose(samples);
            }
        }
        let [pixels, off] = choice::sum(&counts);
        let share = (pixels > 0).then(|| f64::from(off) / f64::from(pixels));
        Ok(Added { off: share, is_any: !more.is_empty(), is_short })
    }

    /// The samples that mirror pixels need, each with how much it is asked for, those of most pixels first.
    pub fn needed(
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
        let index = self.index(gpu, false);
        let fields = self.head(gpu, Fields::default(), eye, false);
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
        // Samples that are asked for as much keep their order.
        needed.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        Ok(needed)
    }

    /// Makes room for so many more maps than stand, as far as it goes.
    pub fn make_room(&mut self, gpu: &Gpu, more: usize, layout: &Layout, of_page: usize) {
        let wanted = (self.slots.count() + more).min(self.drawn.most);
        while self.slots.0.len() < wanted {
            let stand = self.slots.0.len();
            // Pages grow, so that there are few.
            let slots = (wanted - stand).max(stand).max(LEAST_PAGE).min(self.drawn.most - stand).min(of_page);
            let records = storage(&gpu.device, "maps of light fields", layout.record_bytes() * slots as u64);
            let bytes = layout.listed_bytes() * slots as u64;
            let is_partial = self.drawn.fill == MapFill::OnDemand;
            let listed = is_partial.then(|| storage(&gpu.device, "texels asked for", bytes));
            self.pages.push(Page { records, listed, first: stand, slots });
            self.slots.0.resize(stand + slots, None);
        }
    }

    /// The parameters that the passes which look into maps get.
    pub fn switches(&self, task: &Task<'_>) -> [(&'static str, u32); 4] {
        let settings = &task.settings.light_field;
        [
            ("rule", settings.rule as u32),
            ("blends", u32::from(settings.rule.blends())),
            ("visible_by", settings.visible_by as u32),
            ("is_partial", u32::from(settings.fill == MapFill::OnDemand)),
        ]
    }

    /// A sample by the number of its field, which it keeps while other fields come and go.
    pub fn number_of(&self, (field, sample): Sample) -> (u64, usize) {
        (self.fields[field].number, sample)
    }

    /// For each sample of each field, the slot of its map.
    pub fn slots_of_samples(&self) -> Vec<Vec<Option<usize>>> {
        let mut slots: Vec<Vec<Option<usize>>> =
            self.fields.iter().map(|field| vec![None; field.samples.len()]).collect();
        for (slot, map) in self.slots.0.iter().enumerate() {
            let Some(map) = map else { continue };
            let field = self.fields.iter().position(|field| field.number == map.of.0);
            if let Some(place) = field.and_then(|field| slots[field].get_mut(map.of.1)) {
                *place = Some(slot);
            }
        }
        slots
    }

    /// Draws the map of a sample in a slot.
    pub fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        pen: &mut Pen<'_>,
        layout: &Layout,
        slot: usize,
        (field, sample): Sample,
        [drawn, used]: [u64; 2],
    ) -> Result<Option<Map>> {
        let field = &self.fields[field];
        let page = self.pages.iter().find(|page| (page.first..page.first + page.slots).contains(&slot));
        let Some(page) = page else { return Ok(None) };
        let (map, (wanted, cloud)) = (slot - page.first, (field.samples[sample].1, field.mirror.cloud));
        // Which side of the mirror it stands on is decided without the mirror, which would hide most of itself from either.
        let place = if let Some(listed) = &page.listed {
            // Nothing is traced yet.
            let clear = |recorder: &mut Recorder<'_>, buffer: &wgpu::Buffer, bytes: u64| {
                recorder.clear_part(buffer, bytes * map as u64..bytes * (map as u64 + 1));
            };
            clear(recorder, &page.records, layout.record_bytes());
            clear(recorder, listed, layout.listed_bytes());
            let small = storage(&recorder.gpu.device, "the side of a map", Layout::new(SIDE_TEXELS).record_bytes());
            pen.draw_map(recorder, MapRoom { records: &small, map: 0 }, wanted, &field.mirror, cloud)?
        } else {
            let room = MapRoom { records: &page.records, map };
            let place = pen.draw_map(recorder, room, wanted, &field.mirror, cloud)?;
            if self.drawn.is_own_drawn && cloud.is_some() {
                (0..6).try_for_each(|face| pen.draw_face(recorder, room, face, place, &field.mirror, None))?;
            }
            place
        };
        Ok(Some(Map { of: (field.number, sample), place, is_stale: false, drawn, used }))
    }
}
