//! The data that a frame uploads: the camera, the parameters, and the points of each page to draw with each kernel.

use std::num::NonZeroU64;
use std::ops::Range;

use scene::{LargeDiscs, Settings};

use crate::allocation;
use crate::coloring::PALETTE;
use crate::frame::FrameCamera;
use crate::gpu::Gpu;
use crate::identities::ChunkId;
use crate::layout::{Block, Frame, Item, Page};
use crate::store::draw_list::{Cover, DrawList};
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
    /// The palette, the items, and the blocks and runs of all pages, of shaders/shared/page_group.wgsl.
    tables: wgpu::Buffer,
    /// Whether some points are hidden.
    pub hides_points: bool,
    /// Whether some of the points are mirrors or glossy.
    pub has_materials: bool,
    /// One point in so many of each block is drawn.
    pub step: u32,
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
    /// Where the bits that say which points are shown lie in `attributes`, in bytes.
    shown: Range<u64>,
    pub lists: Vec<ListInputs>,
}

impl PageInputs {
    /// The bits that say which points are shown, for passes that read nothing else of the attributes.
    pub fn bind_shown(&self) -> wgpu::BindingResource<'_> {
        let size = NonZeroU64::new(self.shown.end - self.shown.start);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.attributes, offset: self.shown.start, size })
    }
}

/// The blocks of one page that one kernel draws.
pub(crate) struct ListInputs {
    pub page: wgpu::Buffer,
    /// What `page` holds; its runs are the blocks.
    pub values: Page,
    /// The number of workgroups that draw them.
    pub workgroups: u32,
    pub blocks_per_workgroup: u32,
    pub cover: Cover,
    /// Whether workgroups share the large discs of this list, whatever they do in others.
    pub shares: bool,
}

/// The least bytes of a buffer that a frame uploads: a list without elements is bound where one with some may be.
const LEAST_BYTES: usize = 128;

/// What a frame draws, in one buffer; places in it count elements of four words.
struct Tables {
    words: Vec<u32>,
    items_at: u32,
    item_count: u32,
}

impl Tables {
    /// The palette, and the items of a frame.
    fn new(items: &[Item]) -> Self {
        // The shaders take another item where a point of an earlier frame has none any more.
        let another = [Item::default()];
        let items = if items.is_empty() { &another[..] } else { items };
        let mut tables = Self { words: Vec::new(), items_at: 0, item_count: items.len() as u32 };
        tables.add(&PALETTE);
        tables.items_at = tables.add(bytemuck::cast_slice(items));
        tables
    }

    /// Adds words, and returns where they begin.
    fn add(&mut self, words: &[u32]) -> u32 {
        let at = self.words.len() / 4;
        self.words.extend_from_slice(words);
        self.words.resize(self.words.len().next_multiple_of(4), 0);
        at as u32
    }

    /// Adds the runs of a page, or blocks. The count is that of the words.
    fn page(&mut self, runs: &[u32], point_count: u32, step: u32) -> Page {
        let Self { items_at, item_count, .. } = *self;
        let (runs_at, run_count) = (self.add(runs), runs.len() as u32);
        Page { run_count, point_count, is_first: 0, step, runs_at, items_at, item_count, unused: 0 }
    }
}

/// The parameters as the shaders' struct `Settings` has them, each group from a multiple of 16 bytes on, and the byte
/// at which `tone.exposure` begins.
pub(crate) fn words_of(settings: &Settings) -> (Vec<u32>, u64) {
    let (mut words, mut exposure_at) = (Vec::new(), 0);
    for group in settings.groups() {
        if group.group().name == "tone" {
            exposure_at = words.len() as u64 * 4;
        }
        words.extend(group.words());
        words.resize(words.len().next_multiple_of(4), 0);
    }
    (words, exposure_at)
}

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
        let (words, exposure_at) = words_of(settings);
        let step = list.step.max(1);
        let mut tables = Tables::new(&list.items);
        let page = |values: &Page| upload("page", uniform, bytemuck::bytes_of(values));
        let list_of = |values: Page, cover: Cover| ListInputs {
            page: page(&values),
            values,
            workgroups: values.run_count.div_ceil(blocks_per_workgroup(step)),
            blocks_per_workgroup: blocks_per_workgroup(step),
            cover,
            shares: cover == Cover::LargeDiscs && settings.splat.large != LargeDiscs::Alone,
        };
        let mut pages: Vec<PageInputs> = list
            .pages
            .iter()
            .enumerate()
            .map(|(index, draw)| {
                let own =
                    Page { is_first: u32::from(index == 0), ..tables.page(&draw.items_of_runs, draw.capacity, step) };
                let drawn = Cover::ALL.into_iter().zip(&draw.blocks).filter(|(_, blocks)| !blocks.is_empty());
                let lists = drawn.map(|(cover, blocks): (Cover, &Vec<Block>)| {
                    let values = tables.page(bytemuck::cast_slice(blocks), draw.capacity, step);
                    list_of(Page { run_count: blocks.len() as u32, ..values }, cover)
                });
                PageInputs {
                    number: draw.number,
                    lists: lists.collect(),
                    page: page(&own),
                    points: draw.points.clone(),
                    attributes: draw.attributes.clone(),
                    shown: draw.shown.clone(),
                }
            })
            .collect();
        if pages.is_empty() {
            // The passes over pixels still have to write "empty".
            let nothing = upload("nothing", storage, &[]);
            pages.push(PageInputs {
                number: usize::MAX,
                page: page(&Page { is_first: 1, ..tables.page(&[], 0, step) }),
                points: nothing.clone(),
                attributes: nothing,
                shown: 0..LEAST_BYTES as u64,
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
            settings: upload("settings", uniform, bytemuck::cast_slice(&words)),
            tables: upload("tables", storage, bytemuck::cast_slice(&tables.words)),
            hides_points: list.hides_points,
            has_materials: list.items.iter().any(|item| item.specular_intensity != 0.0),
            step,
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

    /// Group 1 of the passes over points, in slot order; `uniform` says which blocks or runs of the tables are meant.
    pub fn page_resources<'a>(
        &'a self,
        page: &'a PageInputs,
        uniform: &'a wgpu::Buffer,
    ) -> [wgpu::BindingResource<'a>; 4] {
        [uniform, &page.points, &page.attributes, &self.tables].map(wgpu::Buffer::as_entire_binding)
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
