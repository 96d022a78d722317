//! The trees of all chunks on the GPU, page by page beside the store's points. A chunk's tree is built and uploaded
//! when the chunk is new or has changed; each frame only builds a small tree over the chunks' boxes.

use std::collections::HashMap;

use rayon::prelude::*;

use super::surfel_tree::{POINTS_PER_NODE, SurfelTree, tree_over_boxes};
use crate::gpu::{Error, Gpu, Result};
use crate::identities::ChunkId;
use crate::inputs::Inputs;
use crate::layout::{LIST_WORDS, Node, ORDER_BYTES, SURFEL_BYTES, TreePlace};
use crate::recorder::Recorder;
use crate::store::{PlacedChunk, PointStore};
use crate::targets::storage;

const NODE_BYTES: u64 = size_of::<Node>() as u64;

/// The trees of one page.
pub(crate) struct IndexPage {
    pub nodes: wgpu::Buffer,
    pub surfels: wgpu::Buffer,
    /// The index in the page of each disc's point.
    pub order: wgpu::Buffer,
    capacity: u32,
}

/// The trees of one page through which a frame's rays are traced.
pub(crate) struct FrameTrees {
    /// The number of the page in the store.
    pub page: usize,
    /// A tree over the boxes of the page's chunks, of which a leaf is the index of a place; then the places.
    pub tops: wgpu::Buffer,
}

#[derive(Default)]
pub(crate) struct SurfelIndex {
    pages: Vec<IndexPage>,
    /// The chunks whose trees are up to date.
    chunks: HashMap<ChunkId, Indexed>,
    /// The nodes at which the rays of each tile start; kept from frame to frame for its room. And one for no tiles.
    lists: [Option<wgpu::Buffer>; 2],
}

/// The inputs of a chunk's tree, and the number of its nodes.
struct Indexed {
    basis: Basis,
    nodes: u32,
}

#[derive(PartialEq)]
struct Basis {
    revision: u64,
    provisional_radius: f32,
    page: usize,
    first: u32,
}

impl Basis {
    fn of(chunk: &PlacedChunk<'_>) -> Self {
        let PlacedChunk { revision, provisional_radius, page, first, .. } = *chunk;
        Self { revision, provisional_radius, page, first }
    }
}

impl SurfelIndex {
    /// The room for the lists of so many tiles. Passes write each list before they read it.
    pub fn lists(&mut self, gpu: &Gpu, tiles: u32) -> wgpu::Buffer {
        let bytes = (u64::from(tiles) * LIST_WORDS * 4).max(16);
        let kept = &mut self.lists[usize::from(tiles > 0)];
        let lists = kept.take().filter(|lists| lists.size() == bytes);
        kept.insert(lists.unwrap_or_else(|| storage(&gpu.device, "lists of nodes", bytes))).clone()
    }

    pub fn page(&self, number: usize) -> Option<&IndexPage> {
        self.pages.get(number)
    }

    /// Updates the index for `chunks` of `supply`, and places them relative to this frame's eye.
    ///
    /// # Errors
    /// No memory for the index, or the frame is given up: the trees that are made stay.
    pub fn update(
        &mut self,
        recorder: &Recorder<'_>,
        store: &PointStore,
        supply: &Inputs,
        chunks: &[ChunkId],
        splat_size: f32,
    ) -> Result<Vec<FrameTrees>> {
        let gpu = recorder.gpu;
        self.make_room(gpu, store)?;
        let place = |id: &ChunkId| Some((*id, store.placed(*id)?));
        let placed: Vec<_> = chunks.iter().filter_map(place).collect();
        // Chunks that have changed, have gone or belong to another store: their room may already belong to others.
        self.chunks.retain(|id, indexed| store.placed(*id).is_some_and(|chunk| Basis::of(&chunk) == indexed.basis));
        let stale: Vec<_> = placed.iter().filter(|(id, _)| !self.chunks.contains_key(id)).collect();
        // In batches: the trees of a whole large cloud would take as much memory as the cloud.
        for batch in stale.chunks(16) {
            recorder.go_on()?;
            let trees: Vec<SurfelTree> =
                batch.par_iter().map(|(_, chunk)| SurfelTree::new(chunk.points, chunk.provisional_radius)).collect();
            for ((id, chunk), tree) in batch.iter().zip(trees) {
                let page = &self.pages[chunk.page];
                let first = u64::from(chunk.first);
                let order: Vec<u32> = tree.order.iter().map(|index| chunk.first + index).collect();
                gpu.queue.write_buffer(
                    &page.nodes,
                    first / POINTS_PER_NODE * NODE_BYTES,
                    bytemuck::cast_slice(&tree.nodes),
                );
                gpu.queue.write_buffer(&page.surfels, first * SURFEL_BYTES, bytemuck::cast_slice(&tree.surfels));
                gpu.queue.write_buffer(&page.order, first * ORDER_BYTES, bytemuck::cast_slice(&order));
                let indexed = Indexed { basis: Basis::of(chunk), nodes: tree.nodes.len() as u32 };
                self.chunks.insert(*id, indexed);
            }
            gpu.queue.submit([]);
        }
        let mut frames = Vec::new();
        for page in supply.pages.iter().map(|page| page.number).filter(|page| *page < self.pages.len()) {
            let (mut boxes, mut places) = (Vec::new(), Vec::new());
            for (id, chunk) in placed.iter().filter(|(_, chunk)| chunk.page == page) {
                let Some(indexed) = self.chunks.get(id).filter(|indexed| indexed.nodes > 0) else { continue };
                let relative = |corner: glam::DVec3| (corner - supply.camera.eye).as_vec3();
                let radius = chunk.largest_radius * splat_size.max(1.0);
                boxes.push((relative(chunk.bounds.min) - radius, relative(chunk.bounds.max) + radius));
                let origin = relative(chunk.points.origin);
                let first_node = (u64::from(chunk.first) / POINTS_PER_NODE) as u32;
                places.push(TreePlace {
                    origin_margin: origin.extend(chunk.largest_radius * (splat_size - 1.0).max(0.0)),
                    first_node,
                    end_node: indexed.nodes,
                    first_surfel: chunk.first,
                    first_identity: chunk.first_identity,
                });
            }
            if boxes.is_empty() {
                continue;
            }
            let nodes: Vec<Node> = tree_over_boxes(&boxes);
            let (nodes, places): (&[u8], &[u8]) = (bytemuck::cast_slice(&nodes), bytemuck::cast_slice(&places));
            let bytes = [nodes, places].concat();
            let tops = storage(&gpu.device, "top nodes", bytes.len() as u64);
            gpu.queue.write_buffer(&tops, 0, &bytes);
            frames.push(FrameTrees { page, tops });
        }
        Ok(frames)
    }

    /// Makes the pages as large as the store's.
    fn make_room(&mut self, gpu: &Gpu, store: &PointStore) -> Result<()> {
        let capacities = store.page_capacities();
        let fit = self.pages.iter().zip(&capacities).take_while(|(page, capacity)| page.capacity == **capacity).count();
        self.pages.truncate(fit);
        self.chunks.retain(|_, indexed| indexed.basis.page < fit);
        for &capacity in &capacities[self.pages.len()..] {
            let points = u64::from(capacity);
            let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
            let page = IndexPage {
                nodes: storage(&gpu.device, "tree nodes", points / POINTS_PER_NODE * NODE_BYTES),
                surfels: storage(&gpu.device, "tree discs", points * SURFEL_BYTES),
                order: storage(&gpu.device, "tree order", points * ORDER_BYTES),
                capacity,
            };
            if let Some(error) = pollster::block_on(scope.pop()) {
                return Err(Error::Device {
                    adapter: gpu.info.name.clone(),
                    problem: format!("no memory for the index of reflected points: {error}"),
                });
            }
            self.pages.push(page);
        }
        Ok(())
    }

    pub fn bytes(&self) -> u64 {
        let pages = self.pages.iter().map(|page| page.nodes.size() + page.surfels.size() + page.order.size());
        pages.sum::<u64>() + self.lists.iter().flatten().map(wgpu::Buffer::size).sum::<u64>()
    }
}
