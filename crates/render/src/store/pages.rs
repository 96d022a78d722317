//! The pages of the store: buffers on the GPU that hold many chunks, and the room in them.

use crate::allocation;
use crate::gpu::{Error, Gpu, Result};
use crate::layout::{ATTRIBUTE_BYTES, BLOCK_POINTS, POINT_BYTES, SCALAR_BYTES};
use crate::page_space::PageSpace;
use crate::store::{PointStore, StoredChunk};

/// The smallest page: 24 MiB and a bit a point, so that small clouds stay small.
const SMALLEST_PAGE: u32 = 1 << 20;
/// The size of pages is a multiple of this: 6 MiB.
const PAGE_GRAIN: u32 = 1 << 18;
/// The room that chunks take beyond their points, since they begin at whole blocks, as a share of the points: half a
/// block for chunks of some ten thousand.
const ROUNDING_SHARE: u32 = 16;

pub(super) struct PageBuffers {
    pub(super) points: wgpu::Buffer,
    /// Colour and normal of each point, a bit for each that says whether it is shown, and the scalars, if any.
    pub(super) attributes: wgpu::Buffer,
    has_scalars: bool,
    /// Whether the bits are those of the points.
    pub(super) knows_shown: bool,
    pub(super) room: PageSpace,
}

impl PageBuffers {
    pub(super) fn capacity(&self) -> u32 {
        self.room.capacity()
    }

    /// Uploads the bits of the points from `first` on, which is the first of a block.
    pub(super) fn mark_shown(&mut self, gpu: &Gpu, first: u32, words: &[u32]) {
        self.knows_shown = true;
        let at = self.shown_bytes().start + u64::from(first / 8);
        gpu.queue.write_buffer(&self.attributes, at, bytemuck::cast_slice(words));
    }

    /// Where the bits that say which points are shown lie in `attributes`.
    pub(super) fn shown_bytes(&self) -> std::ops::Range<u64> {
        let first = u64::from(self.capacity()) * ATTRIBUTE_BYTES;
        first..first + u64::from(self.capacity() / 8)
    }

    /// Uploads the scalars of the points from `first` on. The first of a page make room for all of it.
    pub(super) fn write_scalars(&mut self, gpu: &Gpu, first: u32, scalars: &[f32]) {
        let without = self.shown_bytes().end;
        if !self.has_scalars {
            let attributes = buffer(gpu, "attributes", without + u64::from(self.capacity()) * SCALAR_BYTES);
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.attributes, 0, &attributes, 0, without);
            gpu.queue.submit([encoder.finish()]);
            (self.attributes, self.has_scalars) = (attributes, true);
        }
        gpu.queue.write_buffer(
            &self.attributes,
            without + u64::from(first) * SCALAR_BYTES,
            bytemuck::cast_slice(scalars),
        );
    }
}

/// The room in points that a chunk of `count` takes of a page: whole blocks, since a run of a block has one item.
pub(super) fn room_of(count: u32) -> u32 {
    count.max(1).next_multiple_of(BLOCK_POINTS)
}

impl PointStore {
    /// Finds room for `count` points, starting at a multiple of `BLOCK_POINTS`: a run of that many points has one item.
    /// If enough is free but not in one piece, chunks are slid: no page is added while another has room.
    pub(super) fn allocate(&mut self, count: u32) -> Result<(usize, std::ops::Range<u32>)> {
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
        let shown = self.pages[page].shown_bytes();
        let PageBuffers { points, attributes, has_scalars, knows_shown, room } = &mut self.pages[page];
        // The buffers, where the first point's values begin, the bits that a point takes, and whether there are any.
        let parts = [
            (&*points, 0, POINT_BYTES * 8, true),
            (&*attributes, 0, ATTRIBUTE_BYTES * 8, true),
            (&*attributes, shown.start, 1, *knows_shown),
            (&*attributes, shown.end, SCALAR_BYTES * 8, *has_scalars),
        ];
        for (buffer, from, bits, _) in parts.into_iter().filter(|(.., exists)| *exists) {
            let bytes = |points: u32| u64::from(points) * bits / 8;
            // Copies within one buffer are not allowed.
            let between = self::buffer(&self.gpu, "slid points", bytes(taken));
            let mut to = 0;
            for part in moved.iter().map(|chunk| chunk.room()) {
                let size = bytes(part.len() as u32);
                encoder.copy_buffer_to_buffer(buffer, from + bytes(part.start), &between, to, size);
                to += size;
            }
            encoder.copy_buffer_to_buffer(&between, 0, buffer, from + bytes(stretch.start), to);
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

    /// Adds a page with room for at least `room` points.
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
        // If nothing was announced, half as much again as is resident: few pages, and little of them unused.
        let wanted = if announced > 0 { announced } else { resident / 2 }.max(room);
        let capacity = wanted.min(largest).next_multiple_of(PAGE_GRAIN).clamp(SMALLEST_PAGE, largest);
        // Identities of points have 32 bits.
        if resident.checked_add(capacity).is_none() {
            return Err(self.too_large("identities of all points", 8 << 32, 4 << 32));
        }
        let scope = self.gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let points = buffer(&self.gpu, "points", u64::from(capacity) * POINT_BYTES);
        let room = PageSpace::new(capacity);
        let bytes = u64::from(capacity) * ATTRIBUTE_BYTES + u64::from(capacity / 8);
        let attributes = buffer(&self.gpu, "attributes", bytes);
        if let Some(error) = pollster::block_on(scope.pop()) {
            let problem = format!("for more points: {error}");
            return Err(Error::NoMemory { adapter: self.gpu.info.name.clone(), problem });
        }
        self.pages.push(PageBuffers { points, attributes, has_scalars: false, knows_shown: false, room });
        Ok(self.pages.len() - 1)
    }

    fn largest_page(&self) -> u32 {
        largest_page(&self.gpu.device.limits())
    }
}

/// The most points of a page: shaders reckon with 32 bits where a point of a buffer begins, as HLSL and MSL do in bytes.
const MOST_POINTS: u64 = (1 << 32) / POINT_BYTES;

/// The number of points of the largest page, which fills one binding. A page costs a dispatch a pass, so few large ones are
/// better.
fn largest_page(limits: &wgpu::Limits) -> u32 {
    let points = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / POINT_BYTES;
    // Rounded down to a power of two, so that pages fill their bindings in whole blocks.
    1 << points.clamp(u64::from(SMALLEST_PAGE), MOST_POINTS).ilog2()
}

pub(super) fn buffer(gpu: &Gpu, label: &str, size: u64) -> wgpu::Buffer {
    allocation::buffer(
        &gpu.device,
        &wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::SOLUTION_BYTES;

    fn limits(binding: u64, buffer: u64) -> wgpu::Limits {
        wgpu::Limits { max_storage_buffer_binding_size: binding, max_buffer_size: buffer, ..wgpu::Limits::defaults() }
    }

    #[test]
    fn the_largest_page_fills_a_binding_and_is_reckoned_with_in_32_bits() {
        let gigabyte = 1 << 30;
        // What WebGPU promises; what software Vulkan, common GPUs and the largest ones have.
        assert_eq!(largest_page(&limits(128 << 20, 256 << 20)), 1 << 23);
        assert_eq!(largest_page(&limits(128 << 20, 2 * gigabyte)), 1 << 23);
        assert_eq!(largest_page(&limits(2 * gigabyte - 1, 4 * gigabyte)), 1 << 26);
        assert_eq!(largest_page(&limits(2 * gigabyte - 4, 2 * gigabyte)), 1 << 26);
        assert_eq!(largest_page(&limits(4 * gigabyte - 1, 64 * gigabyte)), 1 << 27);
        assert_eq!(largest_page(&limits(64 * gigabyte, 64 * gigabyte)), 1 << 28);
        for (binding, buffer) in [(2 * gigabyte - 1, 2 * gigabyte), (64 * gigabyte, 64 * gigabyte)] {
            let page = largest_page(&limits(binding, buffer));
            let bytes = u64::from(page) * POINT_BYTES;
            assert!(bytes <= binding && page.is_multiple_of(BLOCK_POINTS) && page.is_multiple_of(PAGE_GRAIN));
            // The last byte of the last point, and the last solution that a binding has room for.
            assert!(u32::try_from(bytes - 1).is_ok());
            let rounds = binding / (u64::from(page) * SOLUTION_BYTES);
            assert!(u32::try_from(u64::from(page) * rounds.min(15) + u64::from(page) - 1).is_ok());
        }
    }

    #[test]
    fn the_end_of_a_page_of_67_million_points_is_taken_slid_and_given_back() {
        let page = 1 << 26;
        let mut room = PageSpace::new(page);
        let chunk = room_of(300_000);
        let mut firsts: Vec<u32> = std::iter::from_fn(|| room.take(chunk)).collect();
        let last = firsts[firsts.len() - 1];
        assert_eq!(firsts.len() as u32, page / chunk);
        assert!(last.is_multiple_of(BLOCK_POINTS) && last + chunk <= page && page - last < 2 * chunk);
        // Two chunks apart near the end, between which others slide down.
        let gone = [firsts.remove(firsts.len() - 4), firsts.remove(firsts.len() - 2)];
        gone.into_iter().for_each(|first| room.release(first..first + chunk));
        let (stretch, taken) = room.scattered(2 * chunk).unwrap();
        assert!(stretch.start == gone[0] && stretch.end <= page && taken == chunk, "{stretch:?} {taken}");
        let bytes = |points: u32, bits: u64| u64::from(points) * bits / 8;
        assert!(bytes(stretch.end, POINT_BYTES * 8) > 1 << 29 && bytes(stretch.start, 1).is_multiple_of(4));
        room.slid(stretch.clone(), taken);
        assert_eq!(room.take(2 * chunk), Some(gone[0] + chunk));
        // Blocks of the whole page, by the numbers that shaders take them by.
        assert_eq!(u64::from(page / BLOCK_POINTS) * u64::from(BLOCK_POINTS), u64::from(page));
    }
}
