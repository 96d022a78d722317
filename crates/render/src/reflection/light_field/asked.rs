//! Maps whose texels are traced when a mirror pixel first looks at them.

use std::collections::HashSet;

use glam::Vec4;
use scene::{OwnPoints, Settings};

use super::kept::{Field, Kept, Page, filled};
use crate::gpu::{Gpu, Result};
use crate::identities::ChunkId;
use crate::inputs::Inputs;
use crate::layout::{ASKED_BYTES, ASKED_FOUND_BYTES, AskedMaps};
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::cubemaps::{Layout, radius_of, splat_of_maps};
use crate::reflection::environment_map::face_camera;
use crate::reflection::surfel_index::SurfelIndex;
use crate::reflection::task::Task;
use crate::store::draw_list::Selection;
use crate::targets::storage;

/// Of a mirror's maps that are traced on demand, one of so many texels is drawn first to see on which side it stands.
pub const SIDE_TEXELS: u32 = 16;

/// The most texels that a mirror pixel lists of a map at once: that towards the mirror point and that of the ray.
const LISTED_AT_ONCE: u64 = 2;

/// The most texels in a list: some 50 MB.
const MOST_LISTED: u64 = 1 << 22;

impl Kept {
    /// Traces the texels at which mirror pixels look and that are not traced yet: those of rays, and then of each
    /// correction.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory for the index.
    pub fn trace_asked(
        &self,
        recorder: &mut Recorder<'_>,
        trees: &mut SurfelIndex,
        task: &Task<'_>,
        layout: &Layout,
        buffers: &AskedBuffers<'_>,
    ) -> Result<()> {
        let settings = &task.settings.light_field;
        let (gpu, eye) = (recorder.gpu, task.supply.camera.eye);
        let [columns, rows, _] = task.supply.mirror_groups();
        let samples = if settings.rule.blends() { u64::from(settings.neighbours) } else { 1 };
        let most = (u64::from(columns) * u64::from(rows) * 64 * LISTED_AT_ONCE * samples).max(1);
        let room = most.min(MOST_LISTED);
        let asked = storage(&gpu.device, "texels that are asked for", ASKED_BYTES * (1 + room));
        let found = storage(&gpu.device, "points in texels", ASKED_FOUND_BYTES * room);
        let groups = [columns.max(1), room.div_ceil(64).div_ceil(u64::from(columns.max(1))) as u32, 1];
        let sights: Vec<Inputs> = self.fields.iter().map(|field| sight_of(recorder, task, layout, field)).collect();
        let chunks: Vec<Vec<ChunkId>> =
            self.fields.iter().zip(&sights).map(|(field, sight)| shown_in(task, sight, field)).collect();
        // A list that is too short for all is filled again.
        for _ in 0..u64::from(1 + settings.corrections) * most.div_ceil(room) {
            for page in &self.pages {
                let Some(listed) = &page.listed else { continue };
                recorder.clear_part(&asked, 0..ASKED_BYTES);
                recorder.clear(&found);
                let fields = self.head(gpu, page.fields(layout), eye, false);
                let bindings = passes::light_field_ask {
                    point_in: task.mirror.point.bind(),
                    normal_in: task.normal.bind(),
                    eye_in: task.mirror.eye.bind(),
                    mirrors: buffers.places.as_entire_binding(),
                    fields: fields.as_entire_binding(),
                    index: buffers.index.as_entire_binding(),
                    samples: buffers.samples.as_entire_binding(),
                    records: page.records.as_entire_binding(),
                    listed: listed.as_entire_binding(),
                    asked: asked.as_entire_binding(),
                    counters: task.counters.as_entire_binding(),
                };
                recorder.over_mirrors(&self.switches(task), task.supply, bindings)?;
                for (mirror, (sight, chunks)) in sights.iter().zip(&chunks).enumerate() {
                    let maps = self.maps_of(gpu, page, layout, mirror, sight);
                    let of_sight = trees.update(recorder, task.store, sight, chunks, task.settings.splat.size)?;
                    for tree in &of_sight {
                        let Some(index) = trees.page(tree.page) else { continue };
                        let Some(inputs) = sight.pages.iter().find(|inputs| inputs.number == tree.page) else {
                            continue;
                        };
                        let bindings = passes::light_field_asked_trace {
                            tops: tree.tops.as_entire_binding(),
                            nodes: index.nodes.as_entire_binding(),
                            surfels: index.surfels.as_entire_binding(),
                            order: index.order.as_entire_binding(),
                            shown: inputs.bind_shown(),
                            maps: maps.as_entire_binding(),
                            asked: asked.as_entire_binding(),
                            found: found.as_entire_binding(),
                        };
                        let switches = [("hides_points", u32::from(sight.hides_points))];
                        recorder.by_rows(&switches, sight, bindings, groups)?;
                    }
                    let bindings = passes::light_field_asked_planes {
                        maps: maps.as_entire_binding(),
                        asked: asked.as_entire_binding(),
                        found: found.as_entire_binding(),
                        records: page.records.as_entire_binding(),
                    };
                    recorder.over_page_pixels(sight, bindings, groups)?;
                }
            }
        }
        Ok(())
    }

    /// The maps of a page, as seen from the middle of a mirror.
    fn maps_of(&self, gpu: &Gpu, page: &Page, layout: &Layout, mirror: usize, sight: &Inputs) -> wgpu::Buffer {
        let head = AskedMaps {
            size: layout.size,
            texels_of_face: layout.texels_of_face,
            mirror: mirror as u32,
            ..AskedMaps::default()
        };
        let middle = |slot: usize| {
            let map = self.slots.0.get(slot).copied().flatten();
            let mirror = map.and_then(|map| self.fields.iter().position(|field| field.number == map.of.0));
            let place = map.map_or(Vec4::ZERO, |map| (map.place - sight.camera.eye).as_vec3().extend(0.0));
            place.with_w(mirror.map_or(-1.0, |mirror| mirror as f32))
        };
        let middles: Vec<Vec4> = (page.first..page.first + page.slots).map(middle).collect();
        filled(gpu, "maps of a page", &[bytemuck::bytes_of(&head), bytemuck::cast_slice(&middles)].concat())
    }
}

/// All points as seen from the middle of a mirror, so that what texels hold does not depend on the camera.
fn sight_of(recorder: &Recorder<'_>, task: &Task<'_>, layout: &Layout, field: &Field) -> Inputs {
    let bounds = &field.mirror.bounds;
    let camera = face_camera(bounds.center(), radius_of(bounds), 0, layout.size);
    let settings = Settings { splat: splat_of_maps(task.settings, 1), ..task.settings.clone() };
    let list = task.store.draw_list(&camera, &settings, Selection::Everywhere);
    Inputs::new(recorder.gpu, camera, &settings, &list)
}

/// The chunks that a mirror's maps show.
fn shown_in(task: &Task<'_>, sight: &Inputs, field: &Field) -> Vec<ChunkId> {
    let is_left_out = task.settings.light_field.own != OwnPoints::Drawn;
    let of_mirrors = task.store.mirror_clouds(task.settings);
    let own = of_mirrors.into_iter().filter(|(cloud, _)| is_left_out && field.mirror.cloud == Some(*cloud));
    let own: HashSet<ChunkId> = own.flat_map(|(_, chunks)| chunks).collect();
    sight.chunks.iter().filter(|chunk| !own.contains(chunk)).copied().collect()
}

/// What shaders know of the samples.
pub struct AskedBuffers<'a> {
    pub places: &'a wgpu::Buffer,
    pub index: &'a wgpu::Buffer,
    pub samples: &'a wgpu::Buffer,
}
