//! The back end of forward methods: turns points with known mirror pixels into a Mirror G-Buffer (Preiner 2010,
//! sections 3.6, 3.7, 4.5 and 4.6). Its passes are the depth pass, the visibility pass with accumulation, the average,
//! and pull-push closing.
//!
//! A method solves for the points of each page and writes its results to `Forward::solutions`; everything else happens
//! here.

use std::collections::HashMap;

use super::task::Task;
use crate::allocation;
use crate::gpu::{Error, Gpu, Result};
use crate::inputs::PageInputs;
use crate::layout::{CARRY_ALIGNMENT, MIRROR_CARRIES, MIRROR_SUMS, NEAREST_REFLECTION_BYTES, SOLUTION_BYTES};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::storage;

/// The longest edge in pixels that `pack_place` in shaders/shared/mirror_splat.wgsl supports.
const LONGEST_EDGE: u32 = 16_384;
/// The size of a pixel of positions in bytes.
const POSITION_BYTES: u64 = 16;
/// The number of levels above the picture itself, as published.
const PULL_LEVELS: u32 = 4;

/// Identifies the solutions of the points of one page: a page is solved several times if its points are tried in
/// several regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct SolutionKey {
    /// The number of the page in the store.
    pub page: usize,
    pub round: u32,
    /// The bounce, if solutions outlive their bounce; else 0.
    pub bounce: usize,
}

/// How a method's solutions are splatted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splats {
    /// The number of solutions of each point in a buffer; they are a page apart, and the first ones are used.
    pub rounds: u32,
    /// Whether each solution keeps the side of its splat, and the point is taken for a piece of its plane.
    pub own_sides: bool,
}

impl Splats {
    /// One solution a buffer; the sides of splats fall with the distance.
    pub const PUBLISHED: Self = Self { rounds: 1, own_sides: false };

    fn switches(self) -> [(&'static str, u32); 2] {
        [("rounds", self.rounds), ("own_sides", u32::from(self.own_sides))]
    }
}

/// The state of the back end that is kept from frame to frame.
pub(crate) struct Forward {
    size: [u32; 2],
    pub solutions: HashMap<SolutionKey, wgpu::Buffer>,
    /// The sums of albedos, normals and positions, and whether they are lent (`lend`).
    sums: [wgpu::Buffer; 3],
    are_lent: bool,
    /// The carries of the sums, then the nearness of the nearest reflected point of each pixel.
    carries: wgpu::Buffer,
    /// Albedo, normal and position; level 0 is the Mirror G-Buffer before it is closed.
    pyramids: [Pyramid; 3],
}

/// A texture with all the levels that pull makes.
struct Pyramid {
    all: wgpu::TextureView,
    levels: Vec<wgpu::TextureView>,
}

impl Pyramid {
    fn bytes(&self) -> u64 {
        let texture = self.all.texture();
        let texels = |level: u32| {
            let size = texture.size().mip_level_size(level, wgpu::TextureDimension::D2);
            u64::from(size.width) * u64::from(size.height)
        };
        let texel = u64::from(texture.format().block_copy_size(None).unwrap_or(0));
        (0..texture.mip_level_count()).map(texels).sum::<u64>() * texel
    }

    fn new(device: &wgpu::Device, size: [u32; 2], label: &str, format: wgpu::TextureFormat) -> Self {
        let mip_level_count = (PULL_LEVELS + 1).min(size[0].max(size[1]).ilog2() + 1);
        let texture = allocation::texture(
            device,
            &wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        );
        let view = |base_mip_level, mip_level_count| {
            texture.create_view(&wgpu::TextureViewDescriptor { base_mip_level, mip_level_count, ..Default::default() })
        };
        Self { all: view(0, None), levels: (0..mip_level_count).map(|level| view(level, Some(1))).collect() }
    }
}

impl Forward {
    pub fn bytes(&self) -> u64 {
        let sums = self.sums.iter().filter(|_| !self.are_lent);
        let buffers = self.solutions.values().chain([&self.carries]).chain(sums);
        let buffers = buffers.map(wgpu::Buffer::size).sum::<u64>();
        buffers + self.pyramids.iter().map(Pyramid::bytes).sum::<u64>()
    }

    /// Makes the buffers for pictures of `size`; `lent` as for `lend`.
    ///
    /// # Errors
    /// A picture too large for the adapter, or with an edge longer than `LONGEST_EDGE`.
    pub fn new(gpu: &Gpu, size: [u32; 2], lent: Option<[wgpu::Buffer; 3]>) -> Result<Self> {
        let row = |edge: u32| u64::from(edge) * POSITION_BYTES;
        check_size(gpu, "a row of reflections", row(size[0].max(size[1])), row(LONGEST_EDGE))?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let are_lent = lent.is_some();
        let own = || -> Result<_> {
            let sums = || picture_buffer(gpu, "sums of reflections", pixels * MIRROR_SUMS / 3 * 4);
            Ok([sums()?, sums()?, sums()?])
        };
        let pyramid = |label, format| Pyramid::new(&gpu.device, size, label, format);
        Ok(Self {
            size,
            solutions: HashMap::new(),
            sums: lent.map_or_else(own, Ok)?,
            are_lent,
            carries: picture_buffer(
                gpu,
                "carries of reflections",
                carry_bytes(size).next_multiple_of(CARRY_ALIGNMENT * 4) + pixels * NEAREST_REFLECTION_BYTES,
            )?,
            pyramids: [
                pyramid("found albedo", wgpu::TextureFormat::Rgba16Float),
                pyramid("found normal", wgpu::TextureFormat::Rgba32Float),
                pyramid("found position", wgpu::TextureFormat::Rgba32Float),
            ],
        })
    }

    /// Takes buffers of four words a pixel for the sums, which something else uses at other times of a frame.
    pub fn lend(&mut self, sums: [wgpu::Buffer; 3]) {
        (self.sums, self.are_lent) = (sums, true);
    }

    /// Forgets where points were reflected.
    pub fn forget(&mut self) {
        self.solutions.clear();
    }

    /// Makes room for the solutions of each page's points, `together` of them in a buffer, and drops those of pages,
    /// rounds and bounces that no longer exist. `bounces` is the number of bounces whose solutions are kept apart.
    ///
    /// # Errors
    /// No more memory.
    pub fn reserve(
        &mut self,
        gpu: &Gpu,
        task: &Task<'_>,
        rounds: u32,
        together: u32,
        [bounce, bounces]: [usize; 2],
    ) -> Result<()> {
        let capacities = task.store.page_capacities();
        let solution_bytes = SOLUTION_BYTES * u64::from(together);
        let bytes = |page: usize| capacities.get(page).map(|capacity| u64::from(*capacity) * solution_bytes);
        self.solutions
            .retain(|key, buffer| key.round < rounds && key.bounce < bounces && bytes(key.page) == Some(buffer.size()));
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        for page in task.supply.pages.iter().map(|page| page.number) {
            let Some(bytes) = bytes(page) else { continue };
            for round in 0..rounds {
                let key = SolutionKey { page, round, bounce };
                self.solutions.entry(key).or_insert_with(|| storage(&gpu.device, "solutions", bytes));
            }
        }
        pollster::block_on(scope.pop()).map_or(Ok(()), |error| {
            let problem = format!("no memory for where points are reflected: {error}");
            Err(Error::Device { adapter: gpu.info.name.clone(), problem })
        })
    }

    /// The binding of the solutions of a page's points.
    pub fn bind_solutions(&self, page: &PageInputs, round: u32, bounce: usize) -> Option<wgpu::BindingResource<'_>> {
        let key = SolutionKey { page: page.number, round, bounce };
        self.solutions.get(&key).map(wgpu::Buffer::as_entire_binding)
    }

    /// The binding of the nearest points, for passes that bind no carries with them.
    fn bind_nearest(&self) -> wgpu::BindingResource<'_> {
        let offset = carry_bytes(self.size).next_multiple_of(CARRY_ALIGNMENT * 4);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.carries, offset, size: None })
    }

    /// Prepares the buffers for the first depth pass of a bounce.
    pub fn clear(&self, recorder: &mut Recorder<'_>) {
        [&self.carries].into_iter().chain(&self.sums).for_each(|buffer| recorder.clear(buffer));
    }

    /// Splats the distances of one round's solutions.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn depth(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        splats: Splats,
        [round, bounce]: [usize; 2],
    ) -> Result<()> {
        recorder.over_points_by_page(&splats.switches(), task.supply, |page| {
            Some(passes::mirror_depth {
                solutions: self.bind_solutions(page, round as u32, bounce)?,
                point_in: task.mirror.point.bind(),
                nearest: self.bind_nearest(),
            })
        })
    }

    /// Accumulates the solutions of one round that are near enough to the nearest; runs after the depth passes of all
    /// rounds.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn visibility(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        splats: Splats,
        [round, bounce]: [usize; 2],
    ) -> Result<()> {
        recorder.over_points_by_page(&splats.switches(), task.supply, |page| {
            let [albedo_sums, normal_sums, position_sums] = self.sums.each_ref().map(|sums| sums.as_entire_binding());
            Some(passes::mirror_visibility {
                solutions: self.bind_solutions(page, round as u32, bounce)?,
                point_in: task.mirror.point.bind(),
                albedo_sums,
                normal_sums,
                position_sums,
                carries: self.carries.as_entire_binding(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
            })
        })
    }

    /// Averages the sums and closes open pixels, into the task's Mirror G-Buffer. Between the two, `fill` writes albedo,
    /// normal and position of pixels that were found in another way.
    ///
    /// # Errors
    /// A shader is refused, or the error of `fill`.
    pub fn close(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        fill: impl FnOnce(&mut Recorder<'_>, [wgpu::BindingResource<'_>; 3]) -> Result<()>,
    ) -> Result<()> {
        let level = |level: usize| {
            self.pyramids.each_ref().map(|pyramid| wgpu::BindingResource::TextureView(&pyramid.levels[level]))
        };
        let [albedo_out, normal_out, position_out] = level(0);
        let [albedo_sums, normal_sums, position_sums] = self.sums.each_ref().map(|sums| sums.as_entire_binding());
        let bindings = passes::mirror_average {
            point_in: task.mirror.point.bind(),
            nearest: self.bind_nearest(),
            albedo_sums,
            normal_sums,
            position_sums,
            carries: self.carries.as_entire_binding(),
            albedo_out,
            normal_out,
            position_out,
        };
        recorder.over_pixels(&[], task.supply, bindings)?;
        fill(recorder, level(0))?;
        let made = self.pyramids[0].levels.len();
        for above in 1..made.min(task.settings.sscr.pull_levels as usize + 1) {
            let [albedo_in, normal_in, position_in] = level(above - 1);
            let [albedo_out, normal_out, position_out] = level(above);
            let bindings = passes::pull { albedo_in, normal_in, position_in, albedo_out, normal_out, position_out };
            let [width, height] = self.size.map(|edge| (edge >> above).max(1).div_ceil(8));
            recorder.over(&[], task.supply, bindings, [width, height, 1])?;
        }
        let [albedo_in, normal_in, position_in] =
            self.pyramids.each_ref().map(|pyramid| wgpu::BindingResource::TextureView(&pyramid.all));
        let [albedo_out, normal_out, position_out] = task.seen.bind();
        let bindings = passes::push {
            point_in: task.mirror.point.bind(),
            albedo_in,
            normal_in,
            position_in,
            albedo_out,
            normal_out,
            position_out,
        };
        recorder.over_pixels(&[], task.supply, bindings)
    }
}

/// The bytes of the carries of the sums of a picture of `size`.
fn carry_bytes(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1]) * MIRROR_CARRIES * 4
}

/// Makes a storage buffer that a method needs for a picture.
///
/// # Errors
/// More than the adapter can bind.
pub(crate) fn picture_buffer(gpu: &Gpu, what: &'static str, bytes: u64) -> Result<wgpu::Buffer> {
    check_size(gpu, what, bytes, gpu.device.limits().max_storage_buffer_binding_size)?;
    Ok(storage(&gpu.device, what, bytes))
}

/// Checks the size of a resource of a picture.
///
/// # Errors
/// `bytes` exceeds `limit`.
pub(crate) fn check_size(gpu: &Gpu, what: &'static str, bytes: u64, limit: u64) -> Result<()> {
    if bytes > limit {
        let adapter = gpu.info.name.clone();
        return Err(Error::TooLarge { what, bytes, limit, adapter, advice: "; ask for a smaller picture" });
    }
    Ok(())
}
