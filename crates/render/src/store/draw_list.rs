//! Selects what a frame draws of the store: the chunks that may be in the picture, as blocks of points.

use glam::Vec3;
use scene::{Settings, Splat};

use crate::coloring::{ColorSource, palette_start};
use crate::frame::FrameCamera;
use crate::identities::{ChunkId, CloudId};
use crate::layout::{BLOCK_POINTS, Block, Item};
use crate::store::pages::PageBuffers;
use crate::store::{PointStore, StoredChunk, StoredCloud};

/// The chunks that a frame selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Selection {
    /// Chunks that may be in the picture, except mirrors that are drawn by their formula.
    Seen,
    /// Chunks that may be in the picture, except those of one cloud and mirrors that are drawn by their formula.
    SeenBesides(CloudId),
    /// Chunks that may be in the picture and cast shadows, as all but clear ones do.
    Casting,
    /// All visible chunks, wherever the camera looks, except mirrors that are drawn by their formula.
    Everywhere,
    /// All visible chunks, wherever the camera looks.
    EverywhereWithMirrors,
}

/// What a frame draws of one page.
pub(crate) struct PageDraw {
    /// The number of the page in the store.
    pub number: usize,
    pub capacity: u32,
    pub points: wgpu::Buffer,
    pub attributes: wgpu::Buffer,
    pub scalars: wgpu::Buffer,
    /// The bits that say which points are shown, if some are hidden.
    pub shown: wgpu::Buffer,
    /// The blocks of discs, and those of points that cover one pixel: two kernels draw them.
    pub blocks: [Vec<Block>; 2],
    /// The item of each run of `BLOCK_POINTS` points of the page; then, for each run of as many identities of the
    /// store, the run of the page that has them. `u32::MAX` where none is drawn.
    pub items_of_runs: Vec<u32>,
}

/// What a frame draws.
#[derive(Default)]
pub(crate) struct DrawList {
    pub pages: Vec<PageDraw>,
    pub items: Vec<Item>,
    /// The chunk of each item.
    pub chunks: Vec<ChunkId>,
    /// Whether some points are hidden.
    pub hides_points: bool,
    pub points: u64,
    /// One point in so many of each block is drawn; 0 stands for 1.
    pub step: u32,
}

impl DrawList {
    /// Leaves one point in `step` of each block.
    pub fn thin(&mut self, step: u32) {
        self.step = step;
        let points = self.pages.iter().flat_map(|page| &page.blocks).flatten();
        self.points = points.map(|block| u64::from(block.count.div_ceil(step))).sum();
    }
}

impl StoredChunk {
    /// Whether no point of the chunk can cover more than one pixel.
    fn is_of_single_pixels(&self, cloud: &StoredCloud, camera: &FrameCamera, splat: &Splat) -> bool {
        let scale = camera.most_pixels_per_unit(self.shown.bounds.center(), self.shown.bounds.radius());
        let pixels = self.largest_radius(cloud, splat) * scale;
        // The limits are those of disc_of_point in splat.wgsl.
        let (least, most) =
            (f64::from(splat.min_pixels) * 0.5, f64::from(splat.max_pixels.max(splat.min_pixels)) * 0.5);
        pixels.clamp(least, most) <= 0.5
    }
}

impl PointStore {
    /// Selects what a frame draws of the visible clouds.
    pub(crate) fn draw_list(&self, camera: &FrameCamera, settings: &Settings, selection: Selection) -> DrawList {
        let splat = &settings.splat;
        let asks_where_seen = !matches!(selection, Selection::Everywhere | Selection::EverywhereWithMirrors);
        let with_mirrors = matches!(selection, Selection::Casting | Selection::EverywhereWithMirrors);
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
            shown: page.shown.clone().unwrap_or_else(|| self.nothing.clone()),
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
            let is_left_out = selection == Selection::SeenBesides(chunk.cloud)
                || (by_formula && !with_mirrors)
                || (selection == Selection::Casting && cloud.material.is_clear());
            if !cloud.visible || bounds.is_empty() || !is_seen || is_left_out {
                continue;
            }
            let item = items.len() as u32;
            items.push(self.item(chunk, cloud, camera));
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
        DrawList { pages, items, chunks: chunk_ids, hides_points: self.hides_points(), points, step: 1 }
    }

    fn item(&self, chunk: &StoredChunk, cloud: &StoredCloud, camera: &FrameCamera) -> Item {
        let mut height_axis = Vec3::ZERO;
        height_axis[cloud.up_axis] = 1.0;
        // Heights are relative to the ramp's lower end, so that f32 has enough digits for them.
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
            palette: palette_start(cloud.source, cloud.ramp),
            height: (chunk.origin[cloud.up_axis] - reference) as f32,
            height_axis: height_axis.extend(if cloud.material.is_clear() { cloud.material.refraction } else { 0.0 }),
        }
    }
}
