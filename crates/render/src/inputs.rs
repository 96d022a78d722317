//! The data that a frame uploads: the camera, the parameters, and the points of each page to draw with each kernel.

use scene::{LargeDiscs, Settings};

use crate::allocation;
use crate::coloring::palette;
use crate::frame::FrameCamera;
use crate::gpu::Gpu;
use crate::identities::ChunkId;
use crate::layout::{Block, Frame, Page};
use crate::store::draw_list::{Cover, DrawList, PageDraw};
use crate::targets::uniform_buffer;

/// The data that a frame uploads.
pub(crate) struct Inputs {
    pub camera: FrameCamera,
    pub size: [u32; 2],
    /// The number of the glossy sample that passes work for, that of all samples, and that of the look; `None` for
    /// perfect mirrors.
    pub sample: Option<[u32; 3]>,
    frame: wgpu::Buffer,
    settings: wgpu::Buffer,
    exposure_at: u64,
    items: wgpu::Buffer,
    palette: wgpu::Buffer,
    /// Whether some points are hidden.
    pub hides_points: bool,
    pub pages: Vec<PageInputs>,
    /// The chunks that are drawn.
    pub chunks: Vec<ChunkId>,
}

pub(crate) struct PageInputs {
    /// The number of the page in the store.
    pub number: usize,
    pub page: wgpu::Buffer,
    pub points: wgpu::Buffer,
    attributes: wgpu::Buffer,
    scalars: wgpu::Buffer,
    /// The bits that say which points are shown, if some are hidden.
    pub shown: wgpu::Buffer,
    pub items_of_runs: wgpu::Buffer,
    pub lists: Vec<ListInputs>,
}

/// The blocks of one page that one kernel draws.
pub(crate) struct ListInputs {
    pub page: wgpu::Buffer,
    pub blocks: wgpu::Buffer,
    pub block_count: u32,
    /// The number of workgroups that draw them.
    pub workgroups: u32,
    pub blocks_per_workgroup: u32,
    pub cover: Cover,
    /// Whether workgroups share the large discs of this list, whatever they do in others.
    pub shares: bool,
}

/// The least bytes of a buffer that a frame uploads: a list without elements is bound where one with some may be.
const LEAST_BYTES: usize = 128;

/// The number of blocks that a workgroup draws where one point in `step` is drawn (shaders/shared/blocks.wgsl).
fn blocks_per_workgroup(step: u32) -> u32 {
    1 << (step / 8).max(1).ilog2().min(7)
}

impl Inputs {
    pub fn new(gpu: &Gpu, camera: FrameCamera, settings: &Settings, list: &DrawList) -> Self {
        let upload = |label, usage, bytes: &[u8]| {
            let buffer = allocation::buffer(
                &gpu.device,
                &wgpu::BufferDescriptor {
                    label: Some(label),
                    size: (bytes.len() as u64).max(LEAST_BYTES as u64),
                    usage: usage | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                },
            );
            if bytes.len() < LEAST_BYTES {
                // All of it is written: wgpu clears what is not, by a command for each buffer.
                let mut whole = [0; LEAST_BYTES];
                whole[..bytes.len()].copy_from_slice(bytes);
                gpu.queue.write_buffer(&buffer, 0, &whole);
            } else {
                gpu.queue.write_buffer(&buffer, 0, bytes);
            }
            buffer
        };
        let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
        let words: Vec<u32> = settings.groups().iter().flat_map(|group| group.words()).collect();
        let before_tone = settings.groups().into_iter().take_while(|group| group.group().name != "tone");
        let exposure_at = before_tone.map(|group| group.words().len() as u64 * 4).sum();
        let step = list.step.max(1);
        let page = |point_count, is_first, block_count: usize| {
            let page = Page { block_count: block_count as u32, point_count, is_first: u32::from(is_first), step };
            upload("page", uniform, bytemuck::bytes_of(&page))
        };
        let lists = |draw: &PageDraw| {
            let list = |(cover, blocks): (Cover, &Vec<Block>)| ListInputs {
                page: page(draw.capacity, false, blocks.len()),
                blocks: upload("blocks", storage, bytemuck::cast_slice(blocks)),
                block_count: blocks.len() as u32,
                workgroups: (blocks.len() as u32).div_ceil(blocks_per_workgroup(step)),
                blocks_per_workgroup: blocks_per_workgroup(step),
                cover,
                shares: cover == Cover::LargeDiscs && settings.splat.large != LargeDiscs::Alone,
            };
            Cover::ALL.into_iter().zip(&draw.blocks).filter(|(_, blocks)| !blocks.is_empty()).map(list).collect()
        };
        let mut pages: Vec<PageInputs> = list
            .pages
            .iter()
            .enumerate()
            .map(|(index, draw)| PageInputs {
                number: draw.number,
                page: page(draw.capacity, index == 0, 0),
                points: draw.points.clone(),
                attributes: draw.attributes.clone(),
                scalars: draw.scalars.clone(),
                shown: draw.shown.clone(),
                items_of_runs: upload("items of runs", storage, bytemuck::cast_slice(&draw.items_of_runs)),
                lists: lists(draw),
            })
            .collect();
        if pages.is_empty() {
            // The passes over pixels still have to write "empty".
            let nothing = upload("nothing", storage, &[]);
            pages.push(PageInputs {
                number: usize::MAX,
                page: page(0, true, 0),
                points: nothing.clone(),
                attributes: nothing.clone(),
                scalars: nothing.clone(),
                shown: nothing.clone(),
                items_of_runs: nothing,
                lists: Vec::new(),
            });
        }
        Self {
            camera,
            chunks: list.chunks.clone(),
            size: camera.size,
            sample: None,
            frame: upload("frame", uniform, bytemuck::bytes_of(&camera.to_gpu())),
            exposure_at,
            settings: upload("settings", storage, bytemuck::cast_slice(&words)),
            items: upload("items", storage, bytemuck::cast_slice(&list.items)),
            palette: upload("palette", storage, bytemuck::cast_slice(&palette())),
            hides_points: list.hides_points,
            pages,
        }
    }

    /// Lets the passes that are recorded from now on work for a glossy sample, given as in `sample`, or for perfect
    /// mirrors.
    pub fn set_sample(&mut self, gpu: &Gpu, sample: Option<[u32; 3]>) {
        if self.sample != sample {
            self.sample = sample;
            self.frame = self.frame_from(gpu, [0, 0], 0);
        }
    }

    /// The camera in group 0 of a dispatch that begins at this column and row of workgroups, where a pass of so many
    /// `columns` is cut.
    pub fn frame_from(&self, gpu: &Gpu, [first_column, first_row]: [u32; 2], columns: u32) -> wgpu::Buffer {
        let [sample, samples, look] = self.sample.unwrap_or_default();
        let frame = self.camera.to_gpu();
        uniform_buffer(
            gpu,
            bytemuck::bytes_of(&Frame { first_row, first_column, columns, sample, samples, look, ..frame }),
        )
    }

    /// The buffer with the parameters, and the byte in it at which `tone.exposure` begins.
    pub fn exposure(&self) -> (&wgpu::Buffer, u64) {
        (&self.settings, self.exposure_at)
    }

    pub fn frame_resources(&self) -> [wgpu::BindingResource<'_>; 2] {
        [self.frame.as_entire_binding(), self.settings.as_entire_binding()]
    }

    /// Group 1 of the passes over points, in slot order; `runs` is the list of blocks, or that of the items of runs.
    pub fn page_resources<'a>(
        &'a self,
        page: &'a PageInputs,
        uniform: &'a wgpu::Buffer,
        runs: wgpu::BindingResource<'a>,
    ) -> [wgpu::BindingResource<'a>; 8] {
        let [uniform, points, attributes, scalars, items, shown, palette] =
            [uniform, &page.points, &page.attributes, &page.scalars, &self.items, &page.shown, &self.palette]
                .map(|buffer| buffer.as_entire_binding());
        [uniform, points, attributes, scalars, items, runs, shown, palette]
    }

    /// The number of workgroups of a pass over the pixels where mirrors may be seen.
    pub fn mirror_groups(&self) -> [u32; 3] {
        let [x, y] = self.camera.mirror_tiles.count;
        [x, y, 1]
    }

    /// The number of workgroups of a pass over all pixels.
    pub fn pixel_groups(&self) -> [u32; 3] {
        [self.size[0].div_ceil(8), self.size[1].div_ceil(8), 1]
    }
}
