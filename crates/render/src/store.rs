//! Points resident on the GPU: pages of buffers, chunks within them, and what each frame draws of them.
//!
//! A point takes 16 bytes that every splatting pass reads (position, radius, class), 8 more that only visible points are
//! asked for (colour, normal), and 4 for the attribute shown, while one is shown.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, OnceLock};

use cloud::{Bounds, Chunk, Cloud, Column, NO_NORMAL, NO_RADIUS, PointTest, unpack_radius};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use scene::{Ramp, Settings, Splat, Visibility};

use crate::coloring::{ColorPlan, ColorSource, class_color, ramp_colors, up_axis};
use crate::frame::FrameCamera;
use crate::gpu::{Error, Gpu, Result};
use crate::identities::Identities;
use crate::layout::{ATTRIBUTE_BYTES, BLOCK_POINTS, Block, Item, POINT_BYTES, SCALAR_BYTES};
use crate::room::Room;

/// Smallest page: 24 MiB, so that small clouds stay small.
const SMALLEST_PAGE: u32 = 1 << 20;
/// Pages are multiples of this: 6 MiB.
const PAGE_GRAIN: u32 = 1 << 18;
/// What chunks take more than their points, since they begin at whole blocks, as a share of these: half a block of chunks of
/// some ten thousand.
const ROUNDING_SHARE: u32 = 16;

/// What a leaf of a chunk's tree can count (reflection/surfel_tree.rs); loaded chunks are far smaller.
const MOST_CHUNK_POINTS: usize = 1 << 24;

/// A cloud in the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudId(pub u32);

/// A chunk in the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChunkId(pub u32);

/// How a cloud reflects: a specular intensity above 0 makes it a mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Material {
    /// 0 to 1.
    pub specular_intensity: f32,
    pub specular_power: f32,
    /// Samples of a mirror that the renderer may also draw by its formula.
    pub has_formula: bool,
    /// Drawn as these samples unless `mirror.surface` asks for the formula.
    pub as_points: bool,
}

/// Which chunks a frame takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Selection {
    /// What may be in the picture, but for mirrors that are drawn by their formula.
    Seen,
    /// What may be in the picture, but for one cloud and mirrors that are drawn by their formula.
    SeenBesides(CloudId),
    /// What may be in the picture.
    SeenWithMirrors,
    /// All that is visible, wherever the camera looks, but for mirrors that are drawn by their formula.
    Everywhere,
    /// All that is visible, wherever the camera looks.
    EverywhereWithMirrors,
}

struct PageBuffers {
    points: wgpu::Buffer,
    attributes: wgpu::Buffer,
    /// Made when the first chunk of the page shows an attribute.
    scalars: Option<wgpu::Buffer>,
    room: Room,
}

impl PageBuffers {
    fn capacity(&self) -> u32 {
        self.room.capacity()
    }
}

struct StoredCloud {
    /// Clouds with a smaller number come first.
    order: u64,
    material: Material,
    /// Of all that may come of it, as far as that is known.
    bounds: Bounds,
    visible: bool,
    provisional_radius: f32,
    source: ColorSource,
    low: f64,
    high: f64,
    /// What is taken off scalars before they are narrowed to f32 (GPS times, ids).
    scalar_origin: f64,
    plain: [u8; 4],
    up_axis: usize,
}

struct StoredChunk {
    cloud: CloudId,
    page: usize,
    range: std::ops::Range<u32>,
    origin: DVec3,
    shown: Shown,
    /// In place of the colours of its points.
    tint: Option<[u8; 4]>,
    /// Which column its scalars hold, and what was taken off them.
    scalars: Option<(usize, f64)>,
    /// The points themselves, shared with whoever loaded them; of the columns there is only that of the classes.
    points: Chunk,
    /// Another number after each change of the points.
    revision: u64,
}

/// What is known of the points of a chunk that are shown.
struct Shown {
    points: u32,
    bounds: Bounds,
    /// Largest known splat radius, world units.
    largest_radius: f32,
    lacks_radii: bool,
}

impl Shown {
    fn of(points: &Chunk, test: &PointTest) -> Self {
        // What else the points have need not be copied.
        let chunk = Chunk { exact_positions: None, colors: None, normals: None, ..points.clone() };
        let chunk = chunk.shown(CLASSES, test);
        // Packed radii grow with the radius.
        let largest = chunk.radii.as_ref().and_then(|radii| radii.iter().max());
        Self {
            points: chunk.len() as u32,
            bounds: chunk.bounds(),
            largest_radius: largest.and_then(|packed| unpack_radius(*packed)).unwrap_or(0.0),
            lacks_radii: chunk.radii.as_ref().is_none_or(|radii| radii.contains(&NO_RADIUS)),
        }
    }
}

/// Where chunks of the store have the classes of their points.
const CLASSES: Option<usize> = Some(0);

/// Words of the class masks: those of points without a class come first, then those of all others.
const UNCLASSED: [u32; 8] = [u32::MAX; 8];

impl StoredChunk {
    /// All that it takes of its page.
    fn room(&self) -> std::ops::Range<u32> {
        self.range.start..self.range.start + room_of(self.range.len() as u32)
    }

    /// Of any of its splats, world units.
    fn largest_radius(&self, cloud: &StoredCloud, splat: &Splat) -> f64 {
        let provisional = if self.shown.lacks_radii { cloud.provisional_radius } else { 0.0 };
        f64::from(self.shown.largest_radius.max(provisional)) * f64::from(splat.size)
    }

    /// Whether no point of the chunk can cover more than one pixel.
    fn is_of_single_pixels(&self, cloud: &StoredCloud, camera: &FrameCamera, splat: &Splat) -> bool {
        let scale = camera.most_pixels_per_unit(self.shown.bounds.center(), self.shown.bounds.radius());
        let pixels = self.largest_radius(cloud, splat) * scale;
        // The limits as disc_of_point in splat.wgsl has them.
        let (least, most) =
            (f64::from(splat.min_pixels) * 0.5, f64::from(splat.max_pixels.max(splat.min_pixels)) * 0.5);
        pixels.clamp(least, most) <= 0.5
    }
}

/// What a frame draws of one page.
pub(crate) struct PageDraw {
    /// Number of the page in the store.
    pub number: usize,
    pub capacity: u32,
    pub points: wgpu::Buffer,
    pub attributes: wgpu::Buffer,
    pub scalars: wgpu::Buffer,
    /// Of discs, and of points that cover one pixel: two kernels draw them.
    pub blocks: [Vec<Block>; 2],
    /// Which item each run of `BLOCK_POINTS` points of the page belongs to; then, for each run of as many identities of the store,
    /// which run of the page has them. `u32::MAX` where none is drawn.
    pub items_of_runs: Vec<u32>,
}

/// A chunk and where its points lie in the store.
pub(crate) struct PlacedChunk<'a> {
    pub points: &'a Chunk,
    /// Another number after each change of the points.
    pub revision: u64,
    /// Of the points that are shown.
    pub bounds: Bounds,
    pub page: usize,
    /// In the page; a multiple of `BLOCK_POINTS`.
    pub first: u32,
    pub first_identity: u32,
    /// Radius of its points whose own is not known yet, world units.
    pub provisional_radius: f32,
    pub largest_radius: f32,
    pub shown: ShownPoints<'a>,
}

/// A chunk of a cloud that is shown.
pub(crate) struct VisibleChunk<'a> {
    pub points: &'a Chunk,
    /// Of its first point; the others follow.
    pub first_identity: u32,
    /// Radius of its points whose own is not known yet, world units.
    pub provisional_radius: f32,
    pub shown_points: usize,
    pub shown: ShownPoints<'a>,
}

/// Which points of a chunk are shown.
#[derive(Clone, Copy, Default)]
pub(crate) struct ShownPoints<'a> {
    /// The classes of the points and the test of them, if the points have classes and the test hides any.
    tested: Option<(&'a [u8], PointTest)>,
}

impl<'a> ShownPoints<'a> {
    pub fn of(points: &'a Chunk, test: &PointTest) -> Self {
        let classes = points.classes(CLASSES).filter(|_| !test.shows_all());
        Self { tested: classes.map(|classes| (classes, *test)) }
    }

    pub fn has(&self, index: usize) -> bool {
        self.tested.is_none_or(|(classes, test)| test.shows(Some(classes[index])))
    }
}

/// What a frame draws.
#[derive(Default)]
pub(crate) struct DrawList {
    pub pages: Vec<PageDraw>,
    pub items: Vec<Item>,
    /// Of each item.
    pub chunks: Vec<ChunkId>,
    pub class_masks: Vec<u32>,
    pub filter_classes: bool,
    pub points: u64,
}

/// Points that a chunk of `count` takes of a page: whole blocks, since a run of a block has one item.
fn room_of(count: u32) -> u32 {
    count.max(1).next_multiple_of(BLOCK_POINTS)
}

fn next_revision() -> u64 {
    static REVISION: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);
    REVISION.fetch_add(1, std::sync::atomic::Ordering::Relaxed)
}

/// Points resident on the GPU.
pub struct PointStore {
    gpu: Arc<Gpu>,
    pages: Vec<PageBuffers>,
    clouds: HashMap<CloudId, StoredCloud>,
    chunks: HashMap<ChunkId, StoredChunk>,
    next_cloud: u32,
    next_chunk: u32,
    ramp: Ramp,
    /// Which points are shown.
    test: PointTest,
    /// Points announced by `reserve`.
    reserved: u32,
    /// Stands in for buffers a page does not have.
    nothing: wgpu::Buffer,
    /// See `revision()`.
    revision: u64,
    /// See `geometry_revision()`.
    geometry_revision: u64,
    /// See `uploaded_bytes()`.
    uploaded_bytes: u64,
    /// Made anew when it is asked for after a change.
    identities: OnceLock<Arc<Identities>>,
}

impl PointStore {
    pub fn new(gpu: Arc<Gpu>) -> Self {
        let nothing = buffer(&gpu, "nothing", 16);
        Self {
            gpu,
            pages: Vec::new(),
            clouds: HashMap::new(),
            chunks: HashMap::new(),
            next_cloud: 0,
            next_chunk: 0,
            ramp: Ramp::Turbo,
            test: PointTest::default(),
            reserved: 0,
            nothing,
            revision: next_revision(),
            geometry_revision: next_revision(),
            uploaded_bytes: 0,
            identities: OnceLock::new(),
        }
    }

    fn change(&mut self) {
        self.revision = next_revision();
        self.geometry_revision = self.revision;
        self.identities = OnceLock::new();
    }

    /// Says which clouds come first: of points that are equally near, the one of the last cloud is seen. Without it, clouds come
    /// in the order in which they were added.
    pub fn set_order(&mut self, cloud: CloudId, order: u64) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.order = order;
        }
    }

    /// The numbers of all points: by cloud, then by the first point of the chunk in its file or index.
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

    /// Announces how many points there will be at once, so that the next page is as large as those take that are still to come.
    /// Nothing is allocated before points come, and never more than one page ahead of them.
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
                up_axis: 2,
            },
        );
        id
    }

    /// Uploads a chunk. `classes`: the column that holds the classes of its points, if it has them.
    ///
    /// # Errors
    /// More points than a page holds, or no more memory.
    pub fn add_chunk(&mut self, cloud: CloudId, chunk: &Chunk, classes: Option<usize>) -> Result<ChunkId> {
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
                shown: Shown { points: 0, bounds: Bounds::EMPTY, largest_radius: 0.0, lacks_radii: true },
                tint: None,
                scalars: None,
                points: Chunk::new(chunk.first_point, chunk.origin, Vec::new()),
                revision: 0,
            },
        );
        self.update_chunk(id, chunk, classes)?;
        Ok(id)
    }

    /// Uploads a chunk's points again, when normals, radii or colours have come, or more or fewer of its points are wanted: then
    /// it may find another place, and what it shows of an attribute is to be given anew (`set_color`). Colours and normals that it
    /// shares with the chunk before are not sent again; positions are, with the radii that lie beside them.
    ///
    /// # Errors
    /// The chunk is not in the store, has more points than a page holds, or there is no more memory: then it is taken out.
    pub fn update_chunk(&mut self, id: ChunkId, chunk: &Chunk, classes: Option<usize>) -> Result<()> {
        self.fit(id, chunk.len())?;
        self.change();
        let stored = self.chunks.get_mut(&id).ok_or_else(not_stored)?;
        stored.origin = chunk.origin;
        // Those that are the same lie where they lay.
        let has_same_looks = Arc::ptr_eq(&stored.points.positions, &chunk.positions)
            && is_same(&stored.points.colors, &chunk.colors)
            && is_same(&stored.points.normals, &chunk.normals);
        let column = classes.and_then(|index| chunk.columns.get(index));
        stored.points = Chunk { columns: column.cloned().into_iter().collect(), ..chunk.clone() };
        stored.shown = Shown::of(&stored.points, &self.test);
        stored.revision = self.revision;
        let classes = chunk.classes(classes);
        let page = &self.pages[stored.page];
        let first = u64::from(stored.range.start);
        let points: Vec<[u32; 4]> = (0..chunk.len())
            .map(|i| {
                let radius = chunk.radii.as_ref().map_or(0, |radii| u32::from(radii[i]));
                let class = classes.map_or(0, |classes| u32::from(classes[i]));
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
        // Writes are staged until the next submit; without one, loading a large cloud would hold it twice.
        self.gpu.queue.submit([]);
        Ok(())
    }

    /// Gives a chunk room for `count` points, where it lies or elsewhere.
    fn fit(&mut self, id: ChunkId, count: usize) -> Result<()> {
        self.check_size(count)?;
        let stored = self.chunks.get(&id).ok_or_else(not_stored)?;
        let count = count as u32;
        if stored.range.len() == count as usize {
            return Ok(());
        }
        let (page, old, needs) = (stored.page, stored.room(), room_of(count));
        let place = if needs > old.len() as u32 {
            // Its own room may be part of the next.
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

    /// Radius of the cloud's points whose spacing is not known yet, world units.
    pub fn set_provisional_radius(&mut self, cloud: CloudId, radius: f32) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.provisional_radius = radius;
        }
    }

    /// Colours a cloud by a plan; `ids` are those of `cloud.chunks`, in order. Chunks without the plan's column keep what they
    /// show of it.
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
        self.ramp = plan.ramp;
        let ColorSource::Column(index) = plan.source else {
            stored.source = plan.source;
            stored.scalar_origin = 0.0;
            (stored.plain, stored.up_axis, stored.low, stored.high) = (plan.plain, up_axis(up), plan.low, plan.high);
            return Ok(());
        };
        // The same column keeps its origin while more of it comes in, so that what is there need not be sent again.
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

    /// Shows all points of a chunk in one sRGB colour, or again in their own.
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
        let capacity = u64::from(page.capacity());
        let buffer = page.scalars.get_or_insert_with(|| buffer(&self.gpu, "scalars", capacity * SCALAR_BYTES));
        self.gpu.queue.write_buffer(
            buffer,
            u64::from(chunk.range.start) * SCALAR_BYTES,
            bytemuck::cast_slice(&scalars),
        );
    }

    pub fn set_visible(&mut self, cloud: CloudId, visible: bool) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.visible = visible;
        }
    }

    /// Tells where all of a cloud lies of which only some chunks are here, so that what follows from the scene's bounds does not
    /// change with them.
    pub fn set_bounds(&mut self, cloud: CloudId, bounds: Bounds) {
        self.change();
        if let Some(cloud) = self.clouds.get_mut(&cloud) {
            cloud.bounds = bounds;
        }
    }

    /// Says which points of all clouds are shown.
    pub fn set_visibility(&mut self, visibility: &Visibility) {
        let test = visibility.test();
        if self.test != test {
            self.test = test;
            self.change();
            self.chunks.par_iter_mut().for_each(|(_, chunk)| chunk.shown = Shown::of(&chunk.points, &test));
        }
    }

    pub fn remove_cloud(&mut self, cloud: CloudId) {
        self.change();
        self.clouds.remove(&cloud);
        let gone: Vec<ChunkId> =
            self.chunks.iter().filter(|(_, chunk)| chunk.cloud == cloud).map(|(id, _)| *id).collect();
        gone.into_iter().for_each(|id| self.take_out(id));
        self.free_pages();
    }

    /// Takes a chunk out; its room is for others. One that is not there is none.
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

    /// Empty pages at the end give their memory back; earlier ones keep the numbers of later ones.
    fn free_pages(&mut self) {
        while self.pages.last().is_some_and(|page| page.room.is_unused()) {
            self.pages.pop();
        }
    }

    /// Spheres that hold all splats that may reflect.
    pub(crate) fn mirror_spheres(&self, settings: &Settings) -> impl Iterator<Item = (DVec3, f64)> {
        self.chunks.values().filter_map(|chunk| {
            let cloud = self.clouds.get(&chunk.cloud)?;
            let reflects = cloud.material.specular_intensity > 0.0;
            let reach = chunk.largest_radius(cloud, &settings.splat);
            let bounds = chunk.shown.bounds;
            (cloud.visible && reflects && !bounds.is_empty()).then(|| (bounds.center(), bounds.radius() + reach))
        })
    }

    /// The visible clouds that are mirrors, but for those that are drawn by their formula, with the numbers of their chunks, in
    /// order.
    pub(crate) fn mirror_clouds(&self, settings: &Settings) -> BTreeMap<CloudId, Vec<ChunkId>> {
        let mut mirrors: BTreeMap<CloudId, Vec<ChunkId>> = BTreeMap::new();
        for (id, chunk) in &self.chunks {
            let Some(cloud) = self.clouds.get(&chunk.cloud) else { continue };
            let by_formula = cloud.material.has_formula && settings.mirror.surface.is_exact(cloud.material.as_points);
            let is_seen = cloud.visible && !chunk.shown.bounds.is_empty();
            if is_seen && cloud.material.specular_intensity > 0.0 && !by_formula {
                mirrors.entry(chunk.cloud).or_default().push(*id);
            }
        }
        mirrors.values_mut().for_each(|chunks| chunks.sort());
        mirrors
    }

    /// Whether a visible cloud shows lights as highlights, whatever `light.gloss` is.
    pub(crate) fn has_highlights(&self) -> bool {
        let shows_them = |material: &Material| material.specular_intensity > 0.0 && material.specular_power > 0.0;
        self.clouds.values().any(|cloud| cloud.visible && shows_them(&cloud.material))
    }

    /// A chunk, for an index over its points.
    pub(crate) fn placed(&self, id: ChunkId) -> Option<PlacedChunk<'_>> {
        let chunk = self.chunks.get(&id)?;
        let cloud = self.clouds.get(&chunk.cloud)?;
        Some(PlacedChunk {
            points: &chunk.points,
            revision: chunk.revision,
            bounds: chunk.shown.bounds,
            page: chunk.page,
            first: chunk.range.start,
            first_identity: self.identities().first_of(id),
            provisional_radius: cloud.provisional_radius,
            largest_radius: if chunk.shown.lacks_radii {
                chunk.shown.largest_radius.max(cloud.provisional_radius)
            } else {
                chunk.shown.largest_radius
            },
            shown: ShownPoints::of(&chunk.points, &self.test),
        })
    }

    /// Points that each page has room for.
    pub(crate) fn page_capacities(&self) -> Vec<u32> {
        self.pages.iter().map(|page| page.capacity()).collect()
    }

    /// Another number after each change, and in each store.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// Another number after each change of more than colours.
    pub(crate) fn geometry_revision(&self) -> u64 {
        self.geometry_revision
    }

    /// The chunks of all clouds that are shown, in the order of their identities.
    pub(crate) fn visible_chunks(&self) -> Vec<VisibleChunk<'_>> {
        let visible = self.chunks.iter().filter_map(|(id, chunk)| {
            let cloud = self.clouds.get(&chunk.cloud).filter(|cloud| cloud.visible)?;
            let first_identity = self.identities().first_of(*id);
            Some(VisibleChunk {
                points: &chunk.points,
                first_identity,
                provisional_radius: cloud.provisional_radius,
                shown_points: chunk.shown.points as usize,
                shown: ShownPoints::of(&chunk.points, &self.test),
            })
        });
        let mut visible: Vec<_> = visible.collect();
        visible.sort_by_key(|chunk| chunk.first_identity);
        visible
    }

    pub fn points(&self) -> u64 {
        self.chunks.values().map(|chunk| chunk.range.len() as u64).sum()
    }

    /// Bytes of GPU memory the points take, unused room of pages included.
    pub fn gpu_bytes(&self) -> u64 {
        let bytes = |page: &PageBuffers| {
            let scalars = if page.scalars.is_some() { SCALAR_BYTES } else { 0 };
            u64::from(page.capacity()) * (POINT_BYTES + ATTRIBUTE_BYTES + scalars)
        };
        self.pages.iter().map(bytes).sum()
    }

    /// Bytes of points that were sent to the GPU so far, scalars left out.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploaded_bytes
    }

    /// World bounds of what is shown of the visible clouds, and of what is still to come of them.
    pub fn bounds(&self) -> Bounds {
        let shown =
            self.chunks.values().filter(|chunk| self.clouds.get(&chunk.cloud).is_some_and(|cloud| cloud.visible));
        let told = self.clouds.values().filter(|cloud| cloud.visible).map(|cloud| cloud.bounds);
        told.chain(shown.map(|chunk| chunk.shown.bounds)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// The ramp's colours, then those of the classes.
    pub(crate) fn palette(&self) -> Vec<u32> {
        let classes = (0..=255).map(class_color);
        ramp_colors(self.ramp).into_iter().chain(classes).map(u32::from_le_bytes).collect()
    }

    /// What a frame draws of the visible clouds.
    pub(crate) fn draw_list(&self, camera: &FrameCamera, settings: &Settings, selection: Selection) -> DrawList {
        let splat = &settings.splat;
        let asks_where_seen = !matches!(selection, Selection::Everywhere | Selection::EverywhereWithMirrors);
        let with_mirrors = matches!(selection, Selection::SeenWithMirrors | Selection::EverywhereWithMirrors);
        let mut chunks: Vec<(&ChunkId, &StoredChunk)> = self.chunks.iter().collect();
        chunks.sort_by_key(|(_, chunk)| (chunk.page, chunk.range.start));
        let mut items = Vec::new();
        let mut chunk_ids = Vec::new();
        let identities = self.identities();
        let runs_of = |points: u32| (points / BLOCK_POINTS) as usize;
        let draw = |(number, page): (usize, &PageBuffers)| PageDraw {
            number,
            capacity: page.capacity(),
            points: page.points.clone(),
            attributes: page.attributes.clone(),
            scalars: page.scalars.clone().unwrap_or_else(|| self.nothing.clone()),
            blocks: Default::default(),
            items_of_runs: vec![u32::MAX; runs_of(page.capacity()) + runs_of(identities.end())],
        };
        let mut pages: Vec<PageDraw> = self.pages.iter().enumerate().map(draw).collect();
        let mut points = 0;
        for (id, chunk) in chunks {
            let cloud = &self.clouds[&chunk.cloud];
            let bounds = chunk.shown.bounds;
            // Splats reach beyond their points.
            let reach = chunk.largest_radius(cloud, splat);
            let margin = f64::from(splat.min_pixels) * 0.5;
            let is_seen = !asks_where_seen || camera.sees(bounds.center(), bounds.radius() + reach, margin);
            let by_formula = cloud.material.has_formula && settings.mirror.surface.is_exact(cloud.material.as_points);
            let is_left_out = selection == Selection::SeenBesides(chunk.cloud) || (by_formula && !with_mirrors);
            if !cloud.visible || bounds.is_empty() || !is_seen || is_left_out {
                continue;
            }
            let mask = chunk.points.classes(CLASSES).map_or(0, |_| UNCLASSED.len() as u32);
            let item = items.len() as u32;
            items.push(self.item(chunk, cloud, camera, mask));
            chunk_ids.push(*id);
            points += u64::from(chunk.shown.points);
            let kind = usize::from(asks_where_seen && chunk.is_of_single_pixels(cloud, camera, splat));
            for first in chunk.range.clone().step_by(BLOCK_POINTS as usize) {
                let count = BLOCK_POINTS.min(chunk.range.end - first);
                let first_identity = identities.first_of(*id) + first - chunk.range.start;
                let page = &mut pages[chunk.page];
                page.items_of_runs[runs_of(first)] = item;
                page.items_of_runs[runs_of(page.capacity) + runs_of(first_identity)] = first / BLOCK_POINTS;
                page.blocks[kind].push(Block { item, first, count, first_identity });
            }
        }
        pages.retain(|page| page.blocks.iter().any(|blocks| !blocks.is_empty()));
        let class_masks = [UNCLASSED, self.test.class_words()].concat();
        let filter_classes = !self.test.shows_all();
        DrawList { pages, items, chunks: chunk_ids, class_masks, filter_classes, points }
    }

    fn item(&self, chunk: &StoredChunk, cloud: &StoredCloud, camera: &FrameCamera, class_mask: u32) -> Item {
        let mut height_axis = Vec3::ZERO;
        height_axis[cloud.up_axis] = 1.0;
        // Heights are told relative to the ramp's lower end, so that f32 has digits left for them.
        let (low, reference) =
            if cloud.source == ColorSource::Height { (0.0, cloud.low) } else { (cloud.low - cloud.scalar_origin, 0.0) };
        let range = cloud.high - cloud.low;
        Item {
            origin_radius: (chunk.origin - camera.eye).as_vec3().extend(cloud.provisional_radius),
            low: low as f32,
            inverse_range: if range > 0.0 { (1.0 / range) as f32 } else { 0.0 },
            color_source: chunk.tint.map_or(cloud.source, |_| ColorSource::Plain).code(),
            plain: u32::from_le_bytes(chunk.tint.unwrap_or(cloud.plain)),
            specular_intensity: cloud.material.specular_intensity,
            specular_power: cloud.material.specular_power,
            class_mask,
            height: (chunk.origin[cloud.up_axis] - reference) as f32,
            height_axis: height_axis.extend(0.0),
        }
    }

    /// The chunk, its cloud and the index in it of the point with an identity from the `nearest` buffer of a frame, by the numbers
    /// that points had when it was drawn. `None` where that point is gone.
    pub(crate) fn find(&self, identity: u32, drawn: &Identities) -> Option<(CloudId, ChunkId, usize)> {
        let (id, index) = drawn.find(identity)?;
        let chunk = self.chunks.get(&id).filter(|chunk| index < chunk.range.len())?;
        Some((chunk.cloud, id, index))
    }

    /// Room for `count` points, from a multiple of `BLOCK_POINTS` on: a run of that many points has one item. Where enough is free
    /// but nowhere together, chunks are slid: there is never a further page while a page has room.
    fn allocate(&mut self, count: u32) -> Result<(usize, std::ops::Range<u32>)> {
        let room = room_of(count);
        let range = |first: u32| first..first + count;
        for (index, page) in self.pages.iter_mut().enumerate() {
            if let Some(first) = page.room.take(room) {
                return Ok((index, range(first)));
            }
        }
        let scattered =
            self.pages.iter().enumerate().filter_map(|(index, page)| Some((index, page.room.scattered(room)?)));
        if let Some((index, (stretch, taken))) = scattered.min_by_key(|(_, (_, taken))| *taken) {
            self.slide(index, stretch, taken);
            if let Some(first) = self.pages[index].room.take(room) {
                return Ok((index, range(first)));
            }
        }
        let page = self.add_page(room)?;
        let first = self.pages[page].room.take(room).unwrap_or_default();
        Ok((page, range(first)))
    }

    /// Moves the chunks of a stretch of a page, `taken` points in all, to its lower end.
    fn slide(&mut self, page: usize, stretch: std::ops::Range<u32>, taken: u32) {
        let lies_there = |chunk: &&mut StoredChunk| chunk.page == page && stretch.contains(&chunk.range.start);
        let mut moved: Vec<&mut StoredChunk> = self.chunks.values_mut().filter(lies_there).collect();
        moved.sort_by_key(|chunk| chunk.range.start);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let PageBuffers { points, attributes, scalars, room, .. } = &mut self.pages[page];
        let buffers =
            [(Some(points), POINT_BYTES), (Some(attributes), ATTRIBUTE_BYTES), (scalars.as_mut(), SCALAR_BYTES)];
        for (buffer, bytes) in buffers.into_iter().filter_map(|(buffer, bytes)| Some((buffer?, bytes))) {
            // Copies within one buffer are not allowed.
            let between = self::buffer(&self.gpu, "slid points", u64::from(taken) * bytes);
            let mut to = 0;
            for part in moved.iter().map(|chunk| chunk.room()) {
                let size = part.len() as u64 * bytes;
                encoder.copy_buffer_to_buffer(buffer, u64::from(part.start) * bytes, &between, to, size);
                to += size;
            }
            encoder.copy_buffer_to_buffer(&between, 0, buffer, u64::from(stretch.start) * bytes, to);
        }
        self.gpu.queue.submit([encoder.finish()]);
        let mut to = stretch.start;
        for chunk in moved {
            let (count, size) = (chunk.range.len() as u32, chunk.room().len() as u32);
            chunk.range = to..to + count;
            to += size;
        }
        room.slid(stretch, taken);
    }

    /// A further page, with room for at least `room` points.
    fn add_page(&mut self, room: u32) -> Result<usize> {
        let largest = self.largest_page();
        if room > largest {
            return Err(self.too_large(
                "a chunk of points",
                u64::from(room) * POINT_BYTES,
                u64::from(largest) * POINT_BYTES,
            ));
        }
        let resident: u32 = self.pages.iter().map(|page| page.capacity()).sum();
        let announced = self.reserved.saturating_sub(resident);
        let announced = announced.saturating_add(announced / ROUNDING_SHARE);
        // Half as much again as there is, where nothing is known: few pages, little of them in vain.
        let wanted = if announced > 0 { announced } else { resident / 2 }.max(room);
        let capacity = wanted.min(largest).next_multiple_of(PAGE_GRAIN).clamp(SMALLEST_PAGE, largest);
        // Points have numbers of 32 bits.
        if resident.checked_add(capacity).is_none() {
            return Err(self.too_large("identities of all points", 8 << 32, 4 << 32));
        }
        let scope = self.gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let points = buffer(&self.gpu, "points", u64::from(capacity) * POINT_BYTES);
        let attributes = buffer(&self.gpu, "attributes", u64::from(capacity) * ATTRIBUTE_BYTES);
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(Error::Device {
                adapter: self.gpu.info.name.clone(),
                problem: format!("no memory for more points: {error}"),
            });
        }
        self.pages.push(PageBuffers { points, attributes, scalars: None, room: Room::new(capacity) });
        Ok(self.pages.len() - 1)
    }

    /// Points of the largest page: what one binding takes. A page costs a dispatch a pass, so few large ones are better.
    fn largest_page(&self) -> u32 {
        let limits = self.gpu.device.limits();
        let points = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / POINT_BYTES;
        // Rounded down to a power of two, so that pages fill their bindings in whole blocks.
        1 << points.clamp(u64::from(SMALLEST_PAGE), 1 << 30).ilog2()
    }

    fn too_large(&self, what: &'static str, bytes: u64, limit: u64) -> Error {
        Error::TooLarge { what, bytes, limit, adapter: self.gpu.info.name.clone(), advice: "" }
    }
}

/// Whether a column is still the one that it was.
fn is_same<T>(before: &Option<Arc<Vec<T>>>, now: &Option<Arc<Vec<T>>>) -> bool {
    match (before, now) {
        (Some(before), Some(now)) => Arc::ptr_eq(before, now),
        (before, now) => before.is_none() && now.is_none(),
    }
}

fn not_stored() -> Error {
    Error::NotRendered("a chunk that is not in the point store was updated".into())
}

fn buffer(gpu: &Gpu, label: &str, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
