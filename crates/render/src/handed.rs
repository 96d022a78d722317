//! What a frame hands to the CPU: its pass times, its counters, its exposure and its picture. The frame's own commands
//! copy them into one buffer, which stays from frame to frame, so that one wait brings them all and nothing is copied
//! twice. While somebody reads the picture in it, the next frame takes a second one.

use std::sync::Arc;

use crate::allocation;
use crate::gpu::{Clock, Error, Gpu, Result, tight};
use crate::layout::{COUNTERS, FittedExposure};
use crate::targets::Image;

/// The number of passes of a frame that the GPU times, a timestamp pair each. A frame has some twenty, with many
/// bounces of many rounds of SSCR some hundreds. Further passes are not timed.
pub(crate) const MOST_PASSES: u32 = 1024;

const TICK_BYTES: u64 = 8;
const TIMES_BYTES: u64 = MOST_PASSES as u64 * 2 * TICK_BYTES;
const COUNTER_BYTES: u64 = COUNTERS as u64 * 4;
const EXPOSURE_BYTES: u64 = size_of::<FittedExposure>() as u64;
/// Where the exposure is.
const EXPOSURE: u64 = TIMES_BYTES + COUNTER_BYTES;
/// Where the picture begins; its rows follow each other.
const PICTURE: u64 = (EXPOSURE + EXPOSURE_BYTES).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64);

/// The buffers that bring a frame's results to the CPU.
pub(crate) struct Handed {
    /// The timestamps of the passes and where they are resolved to, if the GPU times them.
    times: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    /// The results of the last frame.
    results: Option<Results>,
    /// The results of an earlier frame, if they were read while a later one was drawn.
    earlier: Option<Results>,
}

/// The results of a frame, in a buffer that is mapped until the next one that takes it.
struct Results {
    buffer: wgpu::Buffer,
    /// The size of the picture.
    size: [u32; 2],
    /// Shared with each `PictureRows` of it that somebody reads.
    readers: Arc<()>,
}

/// The picture of a frame, where the GPU's copy lies or where the processor has drawn it. It stays as it is whatever is drawn meanwhile.
pub struct PictureRows {
    rows: Rows,
    /// The bytes from one row to the next.
    pub stride: u32,
    width: u32,
}

enum Rows {
    Mapped { view: wgpu::BufferView, _reader: Arc<()> },
    Own(Vec<[u8; 4]>),
}

impl Handed {
    pub fn new(gpu: &Gpu) -> Self {
        let times = (gpu.clock == Clock::Gpu).then(|| {
            let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST_PASSES * 2,
            });
            let resolved = allocation::buffer(
                &gpu.device,
                &wgpu::BufferDescriptor {
                    label: Some("pass times"),
                    size: TIMES_BYTES,
                    usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                },
            );
            (queries, resolved)
        });
        Self { times, results: None, earlier: None }
    }

    /// The timestamps of the passes, if the GPU times them.
    pub fn queries(&self) -> Option<&wgpu::QuerySet> {
        self.times.as_ref().map(|(queries, _)| queries)
    }

    /// Ends a frame: copies its picture, its counters, its exposure and the times of its first `passes` passes, and waits for them.
    /// Returns the timestamps.
    ///
    /// # Errors
    /// The device was lost, or there was no memory.
    pub fn take(
        &mut self,
        gpu: &Gpu,
        mut encoder: wgpu::CommandEncoder,
        passes: u32,
        [counters, exposure]: [&wgpu::Buffer; 2],
        picture: &Image,
    ) -> Result<Vec<u64>> {
        let size = picture.size();
        // A buffer that somebody reads is left to the reader: a mapped one takes no commands.
        let is_free = |results: &mut Results| Arc::get_mut(&mut results.readers).is_some();
        let mut last = self.results.take().filter(|results| results.size == size);
        let mut earlier = self.earlier.take().filter(|results| results.size == size);
        let free = last.take_if(is_free).or_else(|| earlier.take_if(is_free));
        self.earlier = last.or(earlier);
        let buffer = match free {
            Some(Results { buffer, .. }) => {
                buffer.unmap();
                buffer
            }
            None => allocation::buffer(
                &gpu.device,
                &wgpu::BufferDescriptor {
                    label: Some("results"),
                    size: PICTURE + u64::from(stride(size[0])) * u64::from(size[1]),
                    usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                    mapped_at_creation: false,
                },
            ),
        };
        let tick_bytes = u64::from(passes) * 2 * TICK_BYTES;
        if let Some((queries, resolved)) = self.times.as_ref().filter(|_| passes > 0) {
            encoder.resolve_query_set(queries, 0..passes * 2, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, &buffer, 0, tick_bytes);
        }
        encoder.copy_buffer_to_buffer(counters, 0, &buffer, TIMES_BYTES, COUNTER_BYTES);
        encoder.copy_buffer_to_buffer(exposure, 0, &buffer, EXPOSURE, EXPOSURE_BYTES);
        let layout =
            wgpu::TexelCopyBufferLayout { offset: PICTURE, bytes_per_row: Some(stride(size[0])), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            picture.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            picture.texture.size(),
        );
        gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        gpu.wait()?;
        let ticks =
            if passes > 0 { bytemuck::pod_collect_to_vec(&mapped(&buffer, 0..tick_bytes)?) } else { Vec::new() };
        self.results = Some(Results { buffer, size, readers: Arc::default() });
        Ok(ticks)
    }

    /// The counters of the last frame; `None` if there is none.
    ///
    /// # Errors
    /// The device was lost.
    pub fn counters(&self) -> Result<Option<Vec<u32>>> {
        let Some(Results { buffer, .. }) = &self.results else { return Ok(None) };
        let bytes = mapped(buffer, TIMES_BYTES..TIMES_BYTES + COUNTER_BYTES)?;
        Ok(Some(bytemuck::pod_collect_to_vec(&bytes)))
    }

    /// The exposure of the last frame that was fitted; `None` if there is no frame.
    ///
    /// # Errors
    /// The device was lost.
    pub fn exposure(&self) -> Result<Option<FittedExposure>> {
        let Some(Results { buffer, .. }) = &self.results else { return Ok(None) };
        Ok(Some(bytemuck::pod_read_unaligned(&mapped(buffer, EXPOSURE..EXPOSURE + EXPOSURE_BYTES)?)))
    }

    /// The picture of the last frame; `None` if there is none.
    ///
    /// # Errors
    /// The device was lost.
    pub fn picture(&self) -> Result<Option<PictureRows>> {
        let Some(Results { buffer, size: [width, _], readers }) = &self.results else { return Ok(None) };
        let view = mapped(buffer, PICTURE..buffer.size())?;
        Ok(Some(PictureRows {
            rows: Rows::Mapped { view, _reader: readers.clone() },
            stride: stride(*width),
            width: *width,
        }))
    }

    pub fn bytes(&self) -> u64 {
        [&self.results, &self.earlier].into_iter().flatten().map(|results| results.buffer.size()).sum()
    }
}

impl PictureRows {
    /// A picture that no GPU has made.
    pub(crate) fn own(pixels: Vec<[u8; 4]>, width: u32) -> Self {
        Self { rows: Rows::Own(pixels), stride: width * 4, width }
    }

    /// The rows from top to bottom, `stride` bytes each.
    pub fn bytes(&self) -> &[u8] {
        match &self.rows {
            Rows::Mapped { view, .. } => view,
            Rows::Own(pixels) => pixels.as_flattened(),
        }
    }

    /// The rows without what fills them up to the stride.
    pub fn tight(&self) -> Vec<u8> {
        tight(self.bytes(), self.width as usize * 4, self.stride as usize)
    }
}

/// The bytes of a row of `width` pixels of the picture in the buffer.
fn stride(width: u32) -> u32 {
    (width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn mapped(buffer: &wgpu::Buffer, bytes: std::ops::Range<u64>) -> Result<wgpu::BufferView> {
    buffer.get_mapped_range(bytes).map_err(|error| Error::Lost(error.to_string()))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use scene::{Camera, Settings};

    use super::*;
    use crate::{Frame, Objects, PointStore, Renderer};

    #[test]
    fn a_picture_stays_as_long_as_it_is_read_and_its_buffer_is_taken_again() {
        let Some(gpu) = Gpu::shared() else { return };
        let store = PointStore::new(gpu.clone());
        let mut renderer = Renderer::new(gpu).unwrap();
        let camera = Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z);
        // A frame shows its background alone.
        let draw = |renderer: &mut Renderer, gray: u32, size| {
            let mut settings = Settings::default();
            settings.view.background = param::Color(gray << 24 | gray << 16 | gray << 8 | 0xff);
            renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), size)).unwrap();
            renderer.picture_rows().unwrap()
        };
        let shows =
            |rows: &PictureRows, gray: u8| rows.tight().chunks_exact(4).all(|pixel| pixel == [gray, gray, gray, 255]);
        let [small, large] = [[16, 12], [70, 20]];
        let first = draw(&mut renderer, 10, small);
        let once = renderer.handed.bytes();
        let second = draw(&mut renderer, 20, small);
        let third = draw(&mut renderer, 30, small);
        assert!(shows(&first, 10) && shows(&second, 20) && shows(&third, 30), "a frame is drawn over");
        assert_eq!(renderer.handed.bytes(), 2 * once, "a third buffer stays");
        drop((first, second));
        // One reader behind the renderer takes two buffers in turn.
        let mut before = third;
        for gray in [40, 50, 60] {
            let rows = draw(&mut renderer, gray, small);
            assert!(shows(&before, gray as u8 - 10) && shows(&rows, gray as u8));
            assert_eq!(renderer.handed.bytes(), 2 * once);
            before = rows;
        }
        // Buffers of another size are given up.
        let rows = draw(&mut renderer, 70, large);
        assert!(shows(&before, 60) && shows(&rows, 70));
        drop((before, rows));
        draw(&mut renderer, 80, large);
        assert_eq!(renderer.handed.results.as_ref().unwrap().size, large);
        assert!(renderer.handed.earlier.is_none(), "nobody read, so no other buffer was needed");
    }
}
