//! Selects what a frame draws of the store: the chunks that may be in the picture, and of these the runs of points that
//! may be, as blocks.

use std::ops::Range;

use cloud::{Chunk, CloudLayout, ShownPoints};
use glam::Vec3;
use scene::{Method, Mirror, Ramp, Settings, Splat};

use crate::coloring::{ColorSource, palette_start};
use crate::frame::FrameCamera;
use crate::identities::{ChunkId, CloudId};
use crate::layout::{BLOCK_POINTS, Block, Item};
use crate::store::pages::PageBuffers;
use crate::store::shown::Extent;
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

/// What the points of a block cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cover {
    Discs,
    /// No point covers more than one pixel.
    Pixels,
    /// Some discs may be larger than `LARGEST_ALONE`.
    LargeDiscs,
}

impl Cover {
    pub const ALL: [Self; 3] = [Self::Discs, Self::Pixels, Self::LargeDiscs];
}

/// The radius in pixels of the largest disc that one invocation covers alone. Software Vulkan (llvmpipe) ends all loops
/// of an invocation after 65,535 turns together, without a word, and an invocation has eight points: half of those turns
/// cover eight discs of this radius.
const LARGEST_ALONE: f64 = 32.0;
/// The invocations of a workgroup (large_discs.wgsl).
const LANES: u32 = 128;
/// The turns of its loops in which an invocation covers its share of the large discs of a block: half of 65,535.
const TURNS: f64 = 32_768.0;
/// How many times the discs of a surface cover it, where they have the radii of `cloud`'s estimate: four or five times.
const OVERLAP: f64 = 6.0;

/// What a frame draws of one page.
pub(crate) struct PageDraw {
    /// The number of the page in the store.
    pub number: usize,
    pub capacity: u32,
    pub points: wgpu::Buffer,
    pub attributes: wgpu::Buffer,
    /// Where the bits that say which points are shown lie in `attributes`, in bytes.
    pub shown: Range<u64>,
    /// The blocks of each kind: different kernels draw them.
    pub blocks: [Vec<Block>; 3],
    /// The item of each run of `BLOCK_POINTS` points of the page; then, for each run of as many identities of the
    /// store, the run of the page that has them. `u32::MAX` where no chunk of the list has them.
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

/// A chunk that may be in the picture, for what draws it without a GPU.
pub(crate) struct SeenChunk<'a> {
    pub points: &'a Chunk,
    pub shown: &'a ShownPoints,
    pub layout: Option<&'a CloudLayout>,
    /// The identity of its first point; the others follow.
    pub first_identity: u32,
    /// The radius of points whose own is not known yet, in world units.
    pub provisional_radius: f32,
    pub is_mirror: bool,
    /// Whether it is a mirror with a formula, whose points are random samples.
    pub is_sampled: bool,
    pub colors: PointColors,
}

/// What colours the points of a chunk.
pub(crate) struct PointColors {
    /// The colour that replaces those of its points.
    pub tint: Option<[u8; 4]>,
    pub source: ColorSource,
    pub plain: [u8; 4],
    pub ramp: Ramp,
    /// The values at the ends of the ramp.
    pub low: f64,
    pub high: f64,
    /// The axis along which heights are measured.
    pub up_axis: usize,
}

impl StoredCloud {
    /// Whether it is a mirror that is drawn by its formula.
    fn is_by_formula(&self, settings: &Settings) -> bool {
        self.material.has_formula && settings.mirror.surface.is_exact(self.material.as_points)
    }
}

impl Extent {
    /// Whether the splats may be in the picture.
    fn is_seen(&self, cloud: &StoredCloud, camera: &FrameCamera, splat: &Splat) -> bool {
        // Splats reach beyond their points. To the sides, the further pixel is far more than what a GPU rounds places by.
        let margin = f64::from(splat.min_pixels) * 0.5 + 1.0;
        !self.bounds.is_empty()
            && camera.sees_box(self.bounds, self.largest_splat(cloud.provisional_radius, splat), margin)
    }

    /// The radius in pixels of the largest disc: at most this.
    fn largest_disc(&self, cloud: &StoredCloud, camera: &FrameCamera, splat: &Splat) -> f64 {
        let scale = camera.most_pixels_per_unit(self.bounds.center(), self.bounds.radius());
        let pixels = self.largest_splat(cloud.provisional_radius, splat) * scale;
        // The limits are those of disc_of_point in splat.wgsl.
        let (least, most) =
            (f64::from(splat.min_pixels) * 0.5, f64::from(splat.max_pixels.max(splat.min_pixels)) * 0.5);
        pixels.clamp(least, most)
    }
}

/// The number of points of a block whose discs have at most the given radius in pixels, and are shared by a workgroup: so
/// few that it covers all of them within `TURNS`, or that it does where the points lie as on a surface. The larger of
/// the two: of a room about the camera, few discs are as large as the nearest might be, and small blocks take long.
fn points_of_shared_block(largest: f64, size: [u32; 2], splat: &Splat) -> u32 {
    let picture = size.map(f64::from).iter().product::<f64>().max(1.0);
    let pixels = TURNS * f64::from(LANES);
    let all_as_large = pixels / (2.0 * largest + 1.0).powi(2).min(picture);
    let on_a_surface = f64::from(BLOCK_POINTS) * pixels / (OVERLAP * picture * f64::from(splat.size).powi(2).max(1.0));
    (all_as_large.max(on_a_surface) as u32).clamp(1, BLOCK_POINTS)
}

impl PointStore {
    /// Whether one of these mirrors, or of the clouds that are mirrors, has a method of its own.
    pub(crate) fn has_own_methods(&self, mirrors: &[Mirror]) -> bool {
        let clouds = self.clouds.values().map(|cloud| cloud.material.method);
        mirrors.iter().map(|mirror| mirror.method).chain(clouds).any(|own| own.is_some())
    }

    /// The method that a cloud's mirror has for itself.
    pub(crate) fn own_method(&self, cloud: CloudId) -> Option<Method> {
        self.clouds.get(&cloud)?.material.method
    }

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
            shown: page.shown_bytes(),
            blocks: Default::default(),
            items_of_runs: vec![u32::MAX; runs_of(page.capacity()) + runs_of(identities.end())],
        };
        let mut pages: Vec<PageDraw> = self.pages.iter().enumerate().map(draw).collect();
        let mut points = 0;
        for (id, chunk) in chunks {
            let cloud = &self.clouds[&chunk.cloud];
            let is_left_out = selection == Selection::SeenBesides(chunk.cloud)
                || (cloud.is_by_formula(settings) && !with_mirrors)
                || (selection == Selection::Casting && cloud.material.is_clear());
            let is_seen = if asks_where_seen {
                chunk.shown.whole.is_seen(cloud, camera, splat)
            } else {
                !chunk.shown.whole.bounds.is_empty()
            };
            if !cloud.visible || !is_seen || is_left_out {
                continue;
            }
            let item = items.len() as u32;
            items.push(self.item(chunk, cloud, camera));
            chunk_ids.push(*id);
            let page = &mut pages[chunk.page];
            let first_identity = |first: u32| identities.first_of(*id) + first - chunk.range.start;
            for (first, run) in chunk.range.clone().step_by(BLOCK_POINTS as usize).zip(&chunk.shown.runs) {
                page.items_of_runs[runs_of(first)] = item;
                page.items_of_runs[runs_of(page.capacity) + runs_of(first_identity(first))] = first / BLOCK_POINTS;
                if asks_where_seen && !run.is_seen(cloud, camera, splat) {
                    continue;
                }
                points += u64::from(run.points);
                let largest = if asks_where_seen { run.largest_disc(cloud, camera, splat) } else { LARGEST_ALONE };
                let (cover, most) = match largest {
                    ..=0.5 => (Cover::Pixels, BLOCK_POINTS),
                    ..=LARGEST_ALONE => (Cover::Discs, BLOCK_POINTS),
                    _ => (Cover::LargeDiscs, points_of_shared_block(largest, camera.size, splat)),
                };
                let end = chunk.range.end.min(first + BLOCK_POINTS);
                let size = (end - first).div_ceil((end - first).div_ceil(most));
                let blocks = (first..end).step_by(size as usize).map(|first| {
                    let count = size.min(end - first);
                    Block { item, first, count, first_identity: first_identity(first) }
                });
                page.blocks[cover as usize].extend(blocks);
            }
        }
        pages.retain(|page| page.blocks.iter().any(|blocks| !blocks.is_empty()));
        DrawList { pages, items, chunks: chunk_ids, hides_points: self.hides_points(), points, step: 1 }
    }

    /// The chunks that may be in the picture, mirrors that are drawn by their formula among them, in the order of their
    /// identities.
    pub(crate) fn seen_chunks(&self, camera: &FrameCamera, settings: &Settings) -> Vec<SeenChunk<'_>> {
        let identities = self.identities();
        let seen = self.chunks.iter().filter_map(|(id, chunk)| {
            let cloud = self.clouds.get(&chunk.cloud)?;
            let is_seen = cloud.visible && chunk.shown.whole.is_seen(cloud, camera, &settings.splat);
            is_seen.then(|| SeenChunk {
                points: &chunk.points,
                shown: &chunk.shown.which,
                layout: chunk.layout.as_deref(),
                first_identity: identities.first_of(*id),
                provisional_radius: cloud.provisional_radius,
                is_mirror: cloud.material.specular_intensity > 0.0,
                is_sampled: cloud.material.has_formula,
                colors: PointColors {
                    tint: chunk.tint,
                    source: cloud.source,
                    plain: cloud.plain,
                    ramp: cloud.ramp,
                    low: cloud.low,
                    high: cloud.high,
                    up_axis: cloud.up_axis,
                },
            })
        });
        let mut seen: Vec<_> = seen.collect();
        seen.sort_by_key(|chunk| chunk.first_identity);
        seen
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use scene::{Camera, ViewSettings};

    use super::*;
    use crate::gpu::Gpu;
    use crate::store::Material;

    #[test]
    fn runs_of_a_chunk_beside_the_picture_are_left_out() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut store = PointStore::new(gpu);
        let cloud = store.add_cloud(Material::default());
        // Five heaps from left to right, a run each; the camera sees the third.
        let place = |i: u32| [-3.0, f32::from((i / BLOCK_POINTS) as u8) * 10.0 - 20.0, (i % 7) as f32 * 0.01];
        let chunk = Chunk::new(0, DVec3::ZERO, (0..BLOCK_POINTS * 5).map(place).collect());
        store.add_chunk(cloud, &chunk, None).unwrap();
        let camera = Camera::looking(DVec3::ZERO, -DVec3::X, 4.0, DVec3::Z);
        let camera = FrameCamera::new(&camera, &ViewSettings::default(), [64, 64], DVec3::ZERO, 25.0);
        let drawn = |selection| {
            let list = store.draw_list(&camera, &Settings::default(), selection);
            let firsts: Vec<u32> = list.pages[0].blocks.iter().flatten().map(|block| block.first).collect();
            (list.points, firsts)
        };
        assert_eq!(drawn(Selection::Seen), (BLOCK_POINTS.into(), vec![2 * BLOCK_POINTS]));
        assert_eq!(drawn(Selection::Everywhere).0, u64::from(BLOCK_POINTS) * 5);
    }

    #[test]
    fn workgroups_that_share_discs_have_few_turns() {
        for size in [[64, 48], [800, 600], [1920, 1080], [3840, 2160]] {
            let picture = size.map(f64::from).iter().product::<f64>();
            for splat_size in [0.05_f32, 1.0, 3.0, 20.0] {
                for largest in [33.0, 64.0, 256.0, 2048.0] {
                    let splat = Splat { size: splat_size, ..Splat::default() };
                    let points = f64::from(points_of_shared_block(largest, size, &splat));
                    let one = (2.0 * largest + 1.0).powi(2).min(picture);
                    // A surface that fills the picture, in one block.
                    let cover = OVERLAP * picture * f64::from(splat_size).powi(2).max(1.0);
                    let on_a_surface = cover * points / f64::from(BLOCK_POINTS);
                    let turns = (points * one).min(on_a_surface.max(one)) / f64::from(LANES);
                    let what = format!("{points} points of {largest} pixels, {splat_size} in {size:?}: {turns}");
                    assert!(turns <= 65_535.0, "{what}");
                    // A block is no smaller than it must be.
                    assert!(
                        points == f64::from(BLOCK_POINTS)
                            || turns > TURNS / 4.0
                            || one * 2.0 > TURNS * f64::from(LANES),
                        "{what}"
                    );
                }
            }
        }
    }
}
