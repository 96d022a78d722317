//! The points on the GPU: pages of buffers, the chunks in them, and what each frame draws of them.
//!
//! A point takes 16 bytes that every splatting pass reads (position, radius, class), 8 more that are read only for
//! visible points (colour, normal), a bit that says whether it is shown, and 4 bytes for an attribute, once one was
//! shown.

pub(crate) mod draw_list;
mod material;
mod pages;
mod shown;

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, OnceLock};

use cloud::{Bounds, Chunk, Cloud, CloudLayout, Column, NO_NORMAL, PointTest, ShownPoints};
use glam::DVec3;
pub use material::Material;
use pages::{PageBuffers, room_of};
use rayon::prelude::*;
use scene::{Ramp, Settings};
use shown::{Shown, scene_bounds, shown_of};

use crate::coloring::{ColorPlan, ColorSource, up_axis};
use crate::gpu::{Error, Gpu, Result};
use crate::identities::{ChunkId, CloudId, Identities};
use crate::layout::{ATTRIBUTE_BYTES, POINT_BYTES};

/// The largest count in a leaf of a chunk's tree (reflection/surfel_tree.rs); loaded chunks are far smaller.
const MOST_CHUNK_POINTS: usize = 1 << 24;

struct StoredCloud {
    /// The order of clouds: those with a smaller number come first.
    order: u64,
    material: Material,
    /// The bounds of all points that may come, if they are known.
    bounds: Bounds,
    visible: bool,
    provisional_radius: f32,
    source: ColorSource,
    low: f64,
    high: f64,
    /// The value that is subtracted from scalars before they are narrowed to f32 (GPS times, ids).
    scalar_origin: f64,
    plain: [u8; 4],
    ramp: Ramp,
    up_axis: usize,
}

struct StoredChunk {
    cloud: CloudId,
    page: usize,
    range: std::ops::Range<u32>,
    origin: DVec3,
    shown: Shown,
    /// The colour that replaces those of its points.
    tint: Option<[u8; 4]>,
    /// The column in its scalars, and the value that was subtracted from them.
    scalars: Option<(usize, f64)>,
    /// The points themselves, shared with the loader.
    points: Chunk,
    /// The bounds of all its points, shown or not.
    bounds: Bounds,
    /// What its columns hold. No rule hides the points of a chunk without it: they stand for an object.
    layout: Option<Arc<CloudLayout>>,
    /// A number that is different after each change of the points.
    revision: u64,
}

impl StoredChunk {
    /// The range of the page that it takes.
    fn room(&self) -> std::ops::Range<u32> {
        self.range.start..self.range.start + room_of(self.range.len() as u32)
    }
}

/// A chunk and the place of its points in the store.
pub(crate) struct PlacedChunk<'a> {
    pub points: &'a Chunk,
    /// A number that is different after each change of the points.
    pub revision: u64,
    /// The bounds of the points that are shown.
    pub bounds: Bounds,
    pub page: usize,
    /// The first point's index in the page; a multiple of `BLOCK_POINTS`.
    pub first: u32,
    pub first_identity: u32,
    /// The radius of points whose own is not known yet, in world units.
    pub provisional_radius: f32,
    pub largest_radius: f32,
    pub shown: &'a ShownPoints,
}

/// A chunk of a cloud that is shown.
pub(crate) struct VisibleChunk<'a> {
    pub points: &'a Chunk,
    /// The identity of its first point; the others follow.
    pub first_identity: u32,
    /// The radius of points whose own is not known yet, in world units.
    pub provisional_radius: f32,
    pub shown_points: usize,
    pub shown: &'a ShownPoints,
}

fn next_revision() -> u64 {
    static REVISION: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);
    REVISION.fetch_add(1, std::sync::atomic::Ordering::Relaxed)
}

/// The points on the GPU.
pub struct PointStore {
    gpu: Arc<Gpu>,
    pages: Vec<PageBuffers>,
    clouds: HashMap<CloudId, StoredCloud>,
    chunks: HashMap<ChunkId, StoredChunk>,
    next_cloud: u32,
    next_chunk: u32,
    /// Decides which points are shown.
    test: PointTest,
    /// The number of points announced by `reserve`.
    reserved: u32,
    /// See `revision()`.
    revision: u64,
    /// See `geometry_revision()`.
    geometry_revision: u64,
    /// See `uploaded_bytes()`.
    uploaded_bytes: u64,
    /// The identities, made when they are first needed after a change.
    identities: OnceLock<Arc<Identities>>,
    /// See `bounds()`; found when it is first needed after a change.
    scene: OnceLock<Bounds>,
}

impl PointStore {
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self {
            gpu,
            pages: Vec::new(),
            clouds: HashMap::new(),
            chunks: HashMap::new(),
            next_cloud: 0,
            next_chunk: 0,
            test: PointTest::default(),
            reserved: 0,
            revision: next_revision(),
            geometry_revision: next_revision(),
            uploaded_bytes: 0,
            identities: OnceLock::new(),
            scene: OnceLock::new(),
        }
    }

    fn change(&mut self) {
        self.revision = next_revision();
        self.geometry_revision = self.revision;
        (self.identities, self.scene) = (OnceLock::new(), OnceLock::new());
    }

    /// Sets the order of clouds: among points at equal distances, that of the last cloud is seen. Without it, clouds
    /// come in the order in which they were added.
    pub fn set_order(&mut self, cloud: CloudId, order: u64) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.order = order;
        }
    }

    /// The identities of all points: by cloud, then by the first point of the chunk in its file or index.
    pub(crate) fn identities(&self) -> &Arc<Identities> {
        self.identities.get_or_init(|| {
            let known = self.chunks.iter().filter_map(|(id, chunk)| {
                let order = self.clouds.get(&chunk.cloud)?.order;
                Some(((order, chunk.cloud, chunk.points.first_point, *id), chunk.room().len() as u32))
            });
            let mut known: Vec<_> = known.collect();
            known.sort_unstable_by_key(|(order, _)| *order);
            Arc::new(Identities::new(known.into_iter().map(|((.., id), room)| (id, room))))
        })
    }

    /// Announces the total number of points, so that the next page has room for all that are still to come. Nothing is
    /// allocated before points come, and never more than one page ahead of them.
    pub fn reserve(&mut self, points: u64) {
        self.reserved = points.min(u64::from(u32::MAX)) as u32;
    }

    pub fn add_cloud(&mut self, material: Material) -> CloudId {
        self.change();
        let id = CloudId(self.next_cloud);
        self.next_cloud += 1;
        self.clouds.insert(
            id,
            StoredCloud {
                order: u64::from(id.0),
                material,
                bounds: Bounds::EMPTY,
                visible: true,
                provisional_radius: 0.0,
                source: ColorSource::Plain,
                low: 0.0,
                high: 1.0,
                scalar_origin: 0.0,
                plain: scene::Color::default().plain.bytes(),
                ramp: Ramp::Turbo,
                up_axis: 2,
            },
        );
        id
    }

    /// Uploads a chunk. `layout` says what its columns hold; points without one stand for an object, and are shown
    /// whatever the visibility says.
    ///
    /// # Errors
    /// More points than a page holds, or no more memory.
    pub fn add_chunk(&mut self, cloud: CloudId, chunk: &Chunk, layout: Option<&Arc<CloudLayout>>) -> Result<ChunkId> {
        self.check_size(chunk.len())?;
        let (page, range) = self.allocate(chunk.len() as u32)?;
        let id = ChunkId(self.next_chunk);
        self.next_chunk += 1;
        self.chunks.insert(
            id,
            StoredChunk {
                cloud,
                page,
                range,
                origin: chunk.origin,
                shown: Shown::of(&chunk.select(&[]), ShownPoints::None),
                tint: None,
                scalars: None,
                points: Chunk::new(chunk.first_point, chunk.origin, Vec::new()),
                bounds: Bounds::EMPTY,
                layout: None,
                revision: 0,
            },
        );
        self.update_chunk(id, chunk, layout)?;
        Ok(id)
    }

    /// Uploads a chunk's points again, when it has new normals, radii or colours, or another number of points: then it
    /// may get another place, and its attribute must be set again (`set_color`). Colours and normals that it shares
    /// with the chunk before are not uploaded again; positions are, with the radii that lie beside them.
    ///
    /// # Errors
    /// The chunk is not in the store, has more points than a page holds, or there is no more memory: then it is
    /// removed.
    pub fn update_chunk(&mut self, id: ChunkId, chunk: &Chunk, layout: Option<&Arc<CloudLayout>>) -> Result<()> {
        self.fit(id, chunk.len())?;
        self.change();
        let stored = self.chunks.get_mut(&id).ok_or_else(not_stored)?;
        stored.origin = chunk.origin;
        // Equal colours and normals stay where they are.
        let has_same_looks = Arc::ptr_eq(&stored.points.positions, &chunk.positions)
            && is_same(&stored.points.colors, &chunk.colors)
            && is_same(&stored.points.normals, &chunk.normals);
        stored.bounds = chunk.bounds();
        let which = shown_of(&self.test, layout.map(Arc::as_ref), chunk, stored.bounds);
        stored.shown = Shown::of(chunk, which);
        (stored.points, stored.layout, stored.revision) = (chunk.clone(), layout.cloned(), self.revision);
        let classes = chunk.classes(layout.and_then(|layout| layout.class_column()));
        let page = &mut self.pages[stored.page];
        if !self.test.shows_all() {
            page.mark_shown(&self.gpu, stored.range.start, &stored.shown.words(chunk.len()));
        }
        let first = u64::from(stored.range.start);
        let points: Vec<[u32; 4]> = (0..chunk.len())
            .map(|i| {
                let radius = chunk.radii.as_ref().map_or(0, |radii| u32::from(radii[i]));
                let class = classes.as_ref().map_or(0, |classes| u32::from(classes[i]));
                let [x, y, z] = chunk.positions[i].map(f32::to_bits);
                [x, y, z, radius | class << 16]
            })
            .collect();
        self.gpu.queue.write_buffer(&page.points, first * POINT_BYTES, bytemuck::cast_slice(&points));
        self.uploaded_bytes += points.len() as u64 * POINT_BYTES;
        if !has_same_looks {
            let attributes: Vec<[u32; 2]> = (0..chunk.len())
                .map(|i| {
                    let color = chunk.colors.as_ref().map_or(u32::MAX, |colors| u32::from_le_bytes(colors[i]));
                    [color, chunk.normals.as_ref().map_or(NO_NORMAL, |normals| normals[i])]
                })
                .collect();
            self.gpu.queue.write_buffer(&page.attributes, first * ATTRIBUTE_BYTES, bytemuck::cast_slice(&attributes));
            self.uploaded_bytes += attributes.len() as u64 * ATTRIBUTE_BYTES;
        }
        // Writes are staged until the next submit; without one, loading a large cloud would keep it in memory twice.
        self.gpu.queue.submit([]);
        Ok(())
    }

    /// Uploads all points again, to a device that takes the place of a lost one. Points and clouds keep their names.
    ///
    /// # Errors
    /// No more memory: then chunks are missing, as if they had been removed.
    pub fn move_to(&mut self, gpu: Arc<Gpu>) -> Result<()> {
        self.gpu = gpu;
        self.pages.clear();
        let mut ids: Vec<ChunkId> = self.chunks.keys().copied().collect();
        ids.sort_unstable();
        let mut moved: Vec<StoredChunk> = ids.iter().filter_map(|id| self.chunks.remove(id)).collect();
        for (id, mut chunk) in ids.into_iter().zip(moved.drain(..)) {
            (chunk.page, chunk.range) = self.allocate(chunk.range.len() as u32)?;
            let (points, layout, scalars) = (chunk.points.clone(), chunk.layout.clone(), chunk.scalars.take());
            // Nothing of them is uploaded yet.
            chunk.points = Chunk::new(points.first_point, points.origin, Vec::new());
            self.chunks.insert(id, chunk);
            self.update_chunk(id, &points, layout.as_ref())?;
            if let Some((index, origin)) = scalars
                && let Some(column) = points.columns.get(index).and_then(Option::as_ref)
            {
                self.upload_scalars(id, index, column, origin);
            }
        }
        Ok(())
    }

    /// Gives a chunk room for `count` points, in its place or elsewhere.
    fn fit(&mut self, id: ChunkId, count: usize) -> Result<()> {
        self.check_size(count)?;
        let stored = self.chunks.get(&id).ok_or_else(not_stored)?;
        let count = count as u32;
        if stored.range.len() == count as usize {
            return Ok(());
        }
        let (page, old, needs) = (stored.page, stored.room(), room_of(count));
        let place = if needs > old.len() as u32 {
            // The chunk's own room may be part of the next.
            let mut moved = self.chunks.remove(&id).ok_or_else(not_stored)?;
            self.pages[page].room.release(old);
            (moved.page, moved.range) = self.allocate(count)?;
            self.chunks.entry(id).insert_entry(moved).into_mut()
        } else {
            self.pages[page].room.release(old.start + needs..old.end);
            let stored = self.chunks.get_mut(&id).ok_or_else(not_stored)?;
            stored.range.end = stored.range.start + count;
            stored
        };
        place.scalars = None;
        Ok(())
    }

    fn check_size(&self, count: usize) -> Result<()> {
        if count > MOST_CHUNK_POINTS {
            let bytes = |points: usize| points as u64 * POINT_BYTES;
            return Err(self.too_large("a chunk of points", bytes(count), bytes(MOST_CHUNK_POINTS)));
        }
        Ok(())
    }

    /// Sets the radius of the cloud's points whose spacing is not known yet, in world units.
    pub fn set_provisional_radius(&mut self, cloud: CloudId, radius: f32) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.provisional_radius = radius;
        }
    }

    /// Colours a cloud by a plan; `ids` are those of `cloud.chunks`, in order. Chunks without the plan's column keep
    /// the values shown before.
    ///
    /// # Errors
    /// No more memory.
    pub fn set_color(
        &mut self,
        cloud_id: CloudId,
        cloud: &Cloud,
        ids: &[ChunkId],
        plan: &ColorPlan,
        up: DVec3,
    ) -> Result<()> {
        self.revision = next_revision();
        let Some(stored) = self.clouds.get_mut(&cloud_id) else { return Ok(()) };
        stored.ramp = plan.ramp;
        let Some(index) = plan.source.column() else {
            stored.source = plan.source;
            stored.scalar_origin = 0.0;
            (stored.plain, stored.up_axis, stored.low, stored.high) = (plan.plain, up_axis(up), plan.low, plan.high);
            return Ok(());
        };
        // A column keeps its origin while more of it comes in, so that its uploaded values need not be sent again.
        let origin = if stored.source == plan.source { stored.scalar_origin } else { plan.full_range.0 };
        (stored.source, stored.scalar_origin) = (plan.source, origin);
        (stored.plain, stored.up_axis, stored.low, stored.high) = (plan.plain, up_axis(up), plan.low, plan.high);
        for (chunk, id) in cloud.chunks.iter().zip(ids) {
            if let Some(column) = chunk.columns.get(index).and_then(Option::as_ref) {
                self.upload_scalars(*id, index, column, origin);
            }
        }
        self.gpu.queue.submit([]);
        Ok(())
    }

    /// Shows all points of a chunk in one sRGB colour, or in their own again.
    pub fn set_tint(&mut self, id: ChunkId, tint: Option<[u8; 4]>) {
        if let Some(chunk) = self.chunks.get_mut(&id).filter(|chunk| chunk.tint != tint) {
            chunk.tint = tint;
            self.revision = next_revision();
        }
    }

    fn upload_scalars(&mut self, id: ChunkId, index: usize, column: &Column, origin: f64) {
        let held = Some((index, origin));
        let chunk = self.chunks.get_mut(&id).filter(|chunk| chunk.range.len() == column.len() && chunk.scalars != held);
        let Some(chunk) = chunk else { return };
        chunk.scalars = held;
        let page = &mut self.pages[chunk.page];
        let scalars: Vec<f32> = (0..column.len()).map(|i| (column.value(i) - origin) as f32).collect();
        page.write_scalars(&self.gpu, chunk.range.start, &scalars);
    }

    /// Sets how a cloud reflects. Where that changes only how much and how sharply, the points count as they were.
    pub fn set_material(&mut self, cloud: CloudId, material: Material) {
        let Some(before) = self.clouds.get(&cloud).map(|cloud| cloud.material) else { return };
        match before {
            _ if before == material => return,
            _ if before.is_alike(&material) => self.revision = next_revision(),
            _ => self.change(),
        }
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.material = material;
        }
    }

    pub(crate) fn intensities(&self) -> HashMap<CloudId, f32> {
        self.clouds.iter().map(|(id, cloud)| (*id, cloud.material.specular_intensity)).collect()
    }

    pub fn set_visible(&mut self, cloud: CloudId, visible: bool) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.visible = visible;
        }
    }

    /// Sets the bounds, without strays, of a whole cloud of which only some chunks are in the store, so that results that
    /// depend on the scene's bounds do not change with them.
    pub fn set_bounds(&mut self, cloud: CloudId, bounds: Bounds) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.bounds = bounds;
        }
    }

    /// Sets which points of all clouds are shown.
    pub fn set_visibility(&mut self, test: &PointTest) {
        if self.test == *test {
            return;
        }
        self.test = test.clone();
        self.change();
        let changed = self.chunks.par_iter_mut().filter_map(|(_, chunk)| {
            let which = shown_of(test, chunk.layout.as_deref(), &chunk.points, chunk.bounds);
            if which != chunk.shown.which {
                chunk.shown = Shown::of(&chunk.points, which);
                return Some(&*chunk);
            }
            // A page that has no bits yet gets those of all its chunks.
            Some(&*chunk).filter(|chunk| !self.pages[chunk.page].knows_shown)
        });
        let changed: Vec<&StoredChunk> = changed.collect();
        if test.shows_all() {
            self.pages.iter_mut().for_each(|page| page.knows_shown = false);
            return;
        }
        for chunk in changed {
            let words = chunk.shown.words(chunk.points.len());
            self.pages[chunk.page].mark_shown(&self.gpu, chunk.range.start, &words);
        }
        self.gpu.queue.submit([]);
    }

    /// Whether some points are hidden.
    pub(crate) fn hides_points(&self) -> bool {
        !self.test.shows_all()
    }

    pub fn remove_cloud(&mut self, cloud: CloudId) {
        self.change();
        self.clouds.remove(&cloud);
        let gone: Vec<ChunkId> =
            self.chunks.iter().filter(|(_, chunk)| chunk.cloud == cloud).map(|(id, _)| *id).collect();
        gone.into_iter().for_each(|id| self.take_out(id));
        self.free_pages();
    }

    /// Removes a chunk and frees its room; ignores one that is not in the store.
    pub fn remove_chunk(&mut self, id: ChunkId) {
        if self.chunks.contains_key(&id) {
            self.change();
            self.take_out(id);
            self.free_pages();
        }
    }

    fn take_out(&mut self, id: ChunkId) {
        if let Some(chunk) = self.chunks.remove(&id) {
            self.pages[chunk.page].room.release(chunk.room());
        }
    }

    /// Frees empty pages at the end; earlier ones keep the numbers of later ones.
    fn free_pages(&mut self) {
        while self.pages.last().is_some_and(|page| page.room.is_unused()) {
            self.pages.pop();
        }
    }

    /// Spheres that contain all splats that may reflect.
    pub(crate) fn mirror_spheres(&self, settings: &Settings) -> impl Iterator<Item = (DVec3, f64)> {
        self.chunks.values().filter_map(|chunk| {
            let cloud = self.clouds.get(&chunk.cloud)?;
            let reflects = cloud.material.specular_intensity > 0.0;
            let reach = chunk.shown.whole.largest_splat(cloud.provisional_radius, &settings.splat);
            let bounds = chunk.shown.whole.bounds;
            (cloud.visible && reflects && !bounds.is_empty()).then(|| (bounds.center(), bounds.radius() + reach))
        })
    }

    /// The visible clouds that are mirrors, except those that are drawn by their formula, with their chunks, in order.
    pub(crate) fn mirror_clouds(&self, settings: &Settings) -> BTreeMap<CloudId, Vec<ChunkId>> {
        let mut mirrors: BTreeMap<CloudId, Vec<ChunkId>> = BTreeMap::new();
        for (id, chunk) in &self.chunks {
            let Some(cloud) = self.clouds.get(&chunk.cloud) else { continue };
            let by_formula = cloud.material.has_formula && settings.mirror.surface.is_exact(cloud.material.as_points);
            let is_seen = cloud.visible && !chunk.shown.whole.bounds.is_empty();
            if is_seen && cloud.material.specular_intensity > 0.0 && !by_formula {
                mirrors.entry(chunk.cloud).or_default().push(*id);
            }
        }
        mirrors.values_mut().for_each(|chunks| chunks.sort());
        mirrors
    }

    /// Whether a visible cloud is a mirror or clear.
    pub fn has_mirrors(&self) -> bool {
        self.clouds.values().any(|cloud| cloud.visible && cloud.material.specular_intensity > 0.0)
    }

    /// Whether a visible cloud shows highlights of lights, whatever `light.gloss` is.
    pub(crate) fn has_highlights(&self) -> bool {
        let shows_them = |material: &Material| material.specular_intensity != 0.0 && material.specular_power > 0.0;
        self.clouds.values().any(|cloud| cloud.visible && shows_them(&cloud.material))
    }

    /// Whether a visible cloud is a mirror that is not perfect.
    pub(crate) fn has_glossy_mirrors(&self) -> bool {
        let is_glossy = |material: &Material| material.specular_intensity > 0.0 && material.specular_power > 0.0;
        self.clouds.values().any(|cloud| cloud.visible && is_glossy(&cloud.material))
    }

    /// Whether points of a visible cloud are glossy and no mirror, whatever `light.gloss` is.
    pub(crate) fn has_gloss(&self) -> bool {
        let is_glossy = |material: &Material| material.specular_intensity < 0.0 && material.specular_power > 0.0;
        self.clouds.values().any(|cloud| cloud.visible && is_glossy(&cloud.material))
    }

    /// A chunk, for an index over its points.
    pub(crate) fn placed(&self, id: ChunkId) -> Option<PlacedChunk<'_>> {
        let chunk = self.chunks.get(&id)?;
        let cloud = self.clouds.get(&chunk.cloud)?;
        Some(PlacedChunk {
            points: &chunk.points,
            revision: chunk.revision,
            bounds: chunk.shown.whole.bounds,
            page: chunk.page,
            first: chunk.range.start,
            first_identity: self.identities().first_of(id),
            provisional_radius: cloud.provisional_radius,
            largest_radius: if chunk.shown.whole.lacks_radii {
                chunk.shown.whole.largest_radius.max(cloud.provisional_radius)
            } else {
                chunk.shown.whole.largest_radius
            },
            shown: &chunk.shown.which,
        })
    }

    /// The number of points that each page has room for.
    pub(crate) fn page_capacities(&self) -> Vec<u32> {
        self.pages.iter().map(|page| page.capacity()).collect()
    }

    /// A number that is different after each change, and in each store.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// A number that is different after each change of more than colours.
    pub(crate) fn geometry_revision(&self) -> u64 {
        self.geometry_revision
    }

    /// Whether points through which light goes are shown, besides mirrors that are drawn by their formula.
    pub(crate) fn has_clear_points(&self, settings: &Settings) -> bool {
        self.clouds.values().any(|cloud| {
            let Material { has_formula, as_points, .. } = cloud.material;
            cloud.visible && cloud.material.is_clear() && !(has_formula && settings.mirror.surface.is_exact(as_points))
        })
    }

    /// Whether light goes through the points of a chunk.
    pub(crate) fn is_clear(&self, chunk: ChunkId) -> bool {
        let cloud = self.chunks.get(&chunk).and_then(|chunk| self.clouds.get(&chunk.cloud));
        cloud.is_some_and(|cloud| cloud.material.is_clear())
    }

    /// The chunks of all clouds that are shown and cast shadows, in the order of their identities.
    pub(crate) fn casting_chunks(&self) -> Vec<VisibleChunk<'_>> {
        let visible = self.chunks.iter().filter_map(|(id, chunk)| {
            let casts = |cloud: &&StoredCloud| cloud.visible && !cloud.material.is_clear();
            let cloud = self.clouds.get(&chunk.cloud).filter(casts)?;
            let first_identity = self.identities().first_of(*id);
            Some(VisibleChunk {
                points: &chunk.points,
                first_identity,
                provisional_radius: cloud.provisional_radius,
                shown_points: chunk.shown.whole.points as usize,
                shown: &chunk.shown.which,
            })
        });
        let mut visible: Vec<_> = visible.collect();
        visible.sort_by_key(|chunk| chunk.first_identity);
        visible
    }

    pub fn points(&self) -> u64 {
        self.chunks.values().map(|chunk| chunk.range.len() as u64).sum()
    }

    /// The GPU memory of the points in bytes, unused room of pages included.
    pub fn gpu_bytes(&self) -> u64 {
        self.pages.iter().map(|page| page.points.size() + page.attributes.size()).sum()
    }

    /// The bytes of points that were uploaded so far, without scalars.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploaded_bytes
    }

    /// The size of the scene, for light, shadow maps, thicknesses and thresholds: the world bounds of the shown points of
    /// visible clouds, and of those that are still to come, without the strays of each cloud. Points outside are drawn
    /// and cast shadows like others; where something has borders, they count as lying there.
    pub fn bounds(&self) -> Bounds {
        *self.scene.get_or_init(|| {
            let mut chunks: HashMap<CloudId, Vec<(&Chunk, &Shown)>> = HashMap::new();
            for chunk in self.chunks.values() {
                chunks.entry(chunk.cloud).or_default().push((&chunk.points, &chunk.shown));
            }
            let of_cloud = |(id, cloud): (&CloudId, &StoredCloud)| match chunks.get(id) {
                Some(chunks) if cloud.bounds.is_empty() => scene_bounds(chunks),
                // The bounds of a whole index do not depend on the chunks that are there.
                _ => cloud.bounds,
            };
            let visible = self.clouds.iter().filter(|(_, cloud)| cloud.visible);
            visible.map(of_cloud).fold(Bounds::EMPTY, Bounds::union)
        })
    }

    /// The world bounds of all that is shown, with strays unless they make the scene dozens of times as wide: what is
    /// to lie in front of the eye of a parallel projection.
    pub(crate) fn reach(&self) -> Bounds {
        let scene = self.bounds();
        let is_visible = |chunk: &&StoredChunk| self.clouds.get(&chunk.cloud).is_some_and(|cloud| cloud.visible);
        let shown =
            self.chunks.values().filter(is_visible).map(|chunk| chunk.shown.whole.bounds).fold(scene, Bounds::union);
        let [width, own] = [shown, scene].map(|bounds| bounds.size().max_element());
        if own > 0.0 && width > f64::from(shown::FAR) * own { scene } else { shown }
    }

    /// The cloud, the chunk and the index in it of the point that has this identity in the `nearest` buffer of a frame;
    /// `drawn` are the identities of that frame. `None` if the point is gone.
    pub(crate) fn find(&self, identity: u32, drawn: &Identities) -> Option<(CloudId, ChunkId, usize)> {
        let (id, index) = drawn.find(identity)?;
        let chunk = self.chunks.get(&id).filter(|chunk| index < chunk.range.len())?;
        Some((chunk.cloud, id, index))
    }

    fn too_large(&self, what: &'static str, bytes: u64, limit: u64) -> Error {
        Error::TooLarge { what, bytes, limit, adapter: self.gpu.info.name.clone(), advice: "" }
    }
}

/// Whether a column is unchanged.
fn is_same<T>(before: &Option<Arc<Vec<T>>>, now: &Option<Arc<Vec<T>>>) -> bool {
    match (before, now) {
        (Some(before), Some(now)) => Arc::ptr_eq(before, now),
        (before, now) => before.is_none() && now.is_none(),
    }
}

fn not_stored() -> Error {
    Error::NotRendered("a chunk that is not in the point store was updated".into())
}
