//! Adapters and devices: lists the adapters, chooses one and says why.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use scene::{Atomics, LargeDiscs, Splat};

use crate::allocation;
use crate::kept_pipelines::KeptPipelines;

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(
        "no graphics adapter{wanted}; install a Vulkan driver (Debian, Ubuntu: mesa-vulkan-drivers also runs without a GPU), `glint doctor` lists what is found"
    )]
    NoAdapter { wanted: String },
    #[error("{adapter}: {problem}")]
    Device { adapter: String, problem: String },
    #[error("{0}")]
    Shader(String),
    #[error("{method} shows perfect mirrors only; set gloss.samples to 0, or take another method")]
    PerfectMirrorsOnly { method: &'static str },
    #[error(
        "{because}, and mirrors have several: {methods}; take a method away from mirrors, or set reflection.own_methods to false"
    )]
    OneMethodOnly { because: &'static str, methods: String },
    #[error("screen_trace.criterion = layers needs a second layer: set screen_trace.back to culled or peeled")]
    NoSecondLayer,
    /// A caller asked for an image that the frame does not have.
    #[error("{0}")]
    NotRendered(String),
    /// The frame was given up, as `Renderer::give_up_when` says.
    #[error("the frame was given up")]
    GivenUp,
    #[error("the graphics device was lost: {0}")]
    Lost(String),
    #[error("{adapter} has no memory left; ask for a smaller picture or fewer points ({problem})")]
    NoMemory { adapter: String, problem: String },
    #[error(
        "`{pass}` would keep {adapter} busy for {seconds:.1} s at a time, and systems reset a GPU after two; ask for a smaller picture, fewer points or fewer virtual lights (gi.vpls)"
    )]
    TooLong { pass: &'static str, seconds: f64, adapter: String },
    #[error("{what} needs {bytes} bytes, more than the {limit} that {adapter} allows{advice}")]
    TooLarge { what: &'static str, bytes: u64, limit: u64, adapter: String, advice: &'static str },
}

/// The source of pass times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// Timestamps written by the GPU.
    Gpu,
    /// The host's clock around submits that are waited for: for adapters without timestamps, and for CPU adapters,
    /// whose compute timestamps are wrong (lavapipe 22.3.6 gives 0.05 ms for a dispatch of 450 ms).
    Host,
}

impl Clock {
    pub fn name(self) -> &'static str {
        match self {
            Self::Gpu => "gpu",
            Self::Host => "host",
        }
    }
}

/// The name of a pass, and its switches: the values of the shader's `override` constants.
pub(crate) type PipelineKey = (&'static str, Vec<(&'static str, u32)>);

/// What the compiler makes of a pass.
#[derive(Clone, Debug)]
pub(crate) struct Code {
    pub pipeline: wgpu::ComputePipeline,
    pub layouts: Vec<wgpu::BindGroupLayout>,
}

/// An opened device.
pub struct Gpu {
    pub adapter: wgpu::Adapter,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    pub clock: Clock,
    /// Whether storage buffers have a 64-bit atomic maximum.
    pub atomics64: bool,
    /// Whether 64-bit atomics can be read: only with Vulkan, see splat_nearest_blind.wgsl.
    pub(crate) reads_atomics64: bool,
    /// Whether 64-bit atomics are added to: on processors, where that takes as long as adding to 32 bits.
    adds_atomics64: bool,
    /// Whether the system takes the device away if a dispatch takes long.
    pub(crate) is_watched: bool,
    /// Whether what would take too long there is refused: processors that act like a GPU in tests are slower than any.
    pub(crate) refuses_long: bool,
    /// The passes that are kept from run to run, if the adapter hands them over and `keep_pipelines_in` named a folder.
    pub(crate) kept_pipelines: Option<KeptPipelines>,
    /// The passes that were compiled for the device, by name and switches: all renderers on it share them.
    pub(crate) compiled: Mutex<HashMap<PipelineKey, Code>>,
    /// The first error outside of any error scope: the next wait reports it.
    failure: Arc<Mutex<Option<Failure>>>,
}

/// An error that wgpu reports after the fact.
#[derive(Debug, PartialEq)]
enum Failure {
    Lost(String),
    NoMemory(String),
    Refused(String),
}

impl Failure {
    fn of(error: &wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::NoMemory(error.to_string()),
            error => Self::Refused(error.to_string()),
        }
    }
}

/// The time after which the device is taken for lost: software Vulkan compiles shaders for seconds at the first
/// dispatch, and slower still on a busy machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// A limit of adapters, and what glint's passes need of it.
#[derive(Debug)]
pub struct Need {
    pub what: &'static str,
    pub least: u64,
    of: fn(&wgpu::Limits) -> u64,
}

#[cfg(test)]
impl Need {
    /// What some limits have of it.
    pub(crate) fn promised(&self, limits: &wgpu::Limits) -> u64 {
        (self.of)(limits)
    }
}

/// The needs of all passes; docs/gpu.md says which pass needs how much.
pub(crate) const NEEDS: [Need; 8] = [
    Need {
        what: "storage buffers in a shader",
        least: 8,
        of: |limits| limits.max_storage_buffers_per_shader_stage.into(),
    },
    Need {
        what: "uniform buffers in a shader",
        least: 4,
        of: |limits| limits.max_uniform_buffers_per_shader_stage.into(),
    },
    Need {
        what: "sampled textures in a shader",
        least: 11,
        of: |limits| limits.max_sampled_textures_per_shader_stage.into(),
    },
    Need {
        what: "storage textures in a shader",
        least: 4,
        of: |limits| limits.max_storage_textures_per_shader_stage.into(),
    },
    Need { what: "groups of bindings", least: 3, of: |limits| limits.max_bind_groups.into() },
    Need {
        what: "threads in a workgroup",
        least: 256,
        of: |limits| limits.max_compute_invocations_per_workgroup.into(),
    },
    Need {
        what: "bytes of workgroup memory",
        least: 10_216,
        of: |limits| limits.max_compute_workgroup_storage_size.into(),
    },
    // Pictures and pages of points adapt to it; WebGPU promises this much.
    Need { what: "bytes of a bound buffer", least: 128 << 20, of: |limits| limits.max_storage_buffer_binding_size },
];

/// Says what limits lack, `None` if nothing.
fn lack(limits: &wgpu::Limits) -> Option<String> {
    let lacks = NEEDS.iter().filter(|need| (need.of)(limits) < need.least);
    let lacks: Vec<String> =
        lacks.map(|need| format!("{} {} where {} are needed", (need.of)(limits), need.what, need.least)).collect();
    (!lacks.is_empty()).then(|| format!("it has {}", lacks.join(", ")))
}

/// Lets an adapter act like lesser ones, for tests (`cargo xtask test --modes`): words of the variable GLINT_ACT_LIKE.
struct Acting(String);

impl Acting {
    fn from_environment() -> Self {
        Self(std::env::var("GLINT_ACT_LIKE").unwrap_or_default())
    }

    fn like(&self, word: &str) -> bool {
        self.0.split(',').any(|known| known == word)
    }

    /// The features that are left.
    fn features(&self, features: wgpu::Features) -> wgpu::Features {
        let hidden = if self.like("no-timestamps") { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() };
        let int64 = wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX;
        features - hidden - if self.like("narrow-atomics") { int64 } else { wgpu::Features::empty() }
    }

    /// The limits that are left: those that WebGPU promises, or too few.
    fn limits(&self, limits: wgpu::Limits) -> wgpu::Limits {
        if self.like("few-buffers") {
            return wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..limits };
        }
        if !self.like("low-limits") {
            return limits;
        }
        let least = wgpu::Limits::defaults();
        wgpu::Limits {
            max_storage_buffers_per_shader_stage: least.max_storage_buffers_per_shader_stage,
            max_storage_buffer_binding_size: least.max_storage_buffer_binding_size,
            max_buffer_size: least.max_buffer_size,
            max_texture_dimension_2d: least.max_texture_dimension_2d,
            max_bind_groups: least.max_bind_groups,
            max_sampled_textures_per_shader_stage: least.max_sampled_textures_per_shader_stage,
            max_storage_textures_per_shader_stage: least.max_storage_textures_per_shader_stage,
            max_uniform_buffers_per_shader_stage: least.max_uniform_buffers_per_shader_stage,
            max_uniform_buffer_binding_size: least.max_uniform_buffer_binding_size,
            max_compute_workgroups_per_dimension: least.max_compute_workgroups_per_dimension,
            max_compute_workgroup_storage_size: least.max_compute_workgroup_storage_size,
            max_compute_invocations_per_workgroup: least.max_compute_invocations_per_workgroup,
            min_storage_buffer_offset_alignment: least.min_storage_buffer_offset_alignment,
            min_uniform_buffer_offset_alignment: least.min_uniform_buffer_offset_alignment,
            ..limits
        }
    }
}

/// Whether a test asks the program to act as if something went wrong: a word of the variable GLINT_ACT_LIKE.
pub fn acts_like(word: &str) -> bool {
    Acting::from_environment().like(word)
}

/// Whether 64-bit atomics can be read with a backend: Metal cannot, and naga translates it wrongly for DirectX.
pub(crate) fn reads_atomics64(backend: wgpu::Backend) -> bool {
    backend == wgpu::Backend::Vulkan
}

/// The backends that glint runs on. Not GL: OpenGL ES promises four storage buffers in a shader.
const BACKENDS: wgpu::Backends = wgpu::Backends::PRIMARY;

/// The folder that `keep_pipelines_in` named.
static KEPT_IN: OnceLock<PathBuf> = OnceLock::new();

/// Keeps what drivers compile in a folder from run to run, for all devices that are opened from now on.
pub fn keep_pipelines_in(folder: PathBuf) {
    KEPT_IN.get_or_init(|| folder);
}

impl Gpu {
    /// Opens an adapter without a window. `wanted` is a part of an adapter's name, `cpu`, or a backend's name (`vulkan`, `dx12`,
    /// `metal`); `None` takes the fastest.
    ///
    /// # Errors
    /// No such adapter, or it gives no device.
    pub fn headless(wanted: Option<&str>) -> Result<Arc<Self>> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = BACKENDS;
        let instance = wgpu::Instance::new(descriptor);
        Self::open(best(&instance, None, wanted)?)
    }

    /// Opens the adapter that another device was opened on, with the same backend: of two equal ones, the same one. If it is
    /// gone, one of the same name.
    ///
    /// # Errors
    /// Those of `headless`.
    pub fn on_same_adapter(known: &wgpu::AdapterInfo) -> Result<Arc<Self>> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = BACKENDS;
        let instance = wgpu::Instance::new(descriptor);
        let mut all = pollster::block_on(instance.enumerate_adapters(BACKENDS));
        let infos: Vec<wgpu::AdapterInfo> = all.iter().map(wgpu::Adapter::get_info).collect();
        match most_like(&infos, known) {
            Some(index) => Self::open(all.swap_remove(index)),
            None => Err(Error::NoAdapter { wanted: format!(" is `{}`", known.name) }),
        }
    }

    /// Opens an adapter that can present to `surface`.
    ///
    /// # Errors
    /// Those of `headless`.
    pub fn for_surface(
        instance: &wgpu::Instance,
        surface: &wgpu::Surface<'_>,
        wanted: Option<&str>,
    ) -> Result<Arc<Self>> {
        Self::open(best(instance, Some(surface), wanted)?)
    }

    fn open(adapter: wgpu::Adapter) -> Result<Arc<Self>> {
        let info = adapter.get_info();
        let acting = Acting::from_environment();
        let (features, limits) = (acting.features(adapter.features()), limits_of(&adapter));
        if let Some(problem) = lack(&limits) {
            return Err(Error::Device { adapter: info.name.clone(), problem });
        }
        let timestamps = features & wgpu::Features::TIMESTAMP_QUERY;
        let int64 = wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX;
        let atomics64 = features.contains(int64);
        let adds = wgpu::Features::SHADER_INT64_ATOMIC_ALL_OPS;
        let adds_atomics64 = atomics64 && features.contains(adds) && info.device_type == wgpu::DeviceType::Cpu;
        let adds = if adds_atomics64 { adds } else { wgpu::Features::empty() };
        let int64 = if atomics64 { int64 | adds } else { wgpu::Features::empty() };
        let pipeline_cache = features & wgpu::Features::PIPELINE_CACHE;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("glint"),
            required_features: timestamps | int64 | pipeline_cache,
            required_limits: limits,
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|error| Error::Device { adapter: info.name.clone(), problem: error.to_string() })?;
        let refuses_long = info.device_type != wgpu::DeviceType::Cpu;
        let is_watched = refuses_long || acting.like("gpu-clock");
        let clock = if is_watched && !timestamps.is_empty() { Clock::Gpu } else { Clock::Host };
        let reads_atomics64 = reads_atomics64(info.backend) && !acting.like("blind-atomics");
        let failure = Arc::new(Mutex::new(None));
        let first = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut first = first.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            // Others follow from it.
            first.get_or_insert_with(|| Failure::of(&error));
        }));
        let lost = failure.clone();
        device.set_device_lost_callback(move |reason, why| {
            let mut failure = lost.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            *failure = Some(Failure::Lost(if why.is_empty() { format!("{reason:?}") } else { why }));
        });
        let kept_pipelines = KEPT_IN.get().and_then(|folder| KeptPipelines::open(&device, &info, folder));
        Ok(Arc::new(Self {
            adapter,
            device,
            queue,
            info,
            clock,
            atomics64,
            reads_atomics64,
            adds_atomics64,
            is_watched,
            refuses_long,
            kept_pipelines,
            compiled: Mutex::default(),
            failure,
        }))
    }

    pub(crate) fn pipeline_cache(&self) -> Option<&wgpu::PipelineCache> {
        self.kept_pipelines.as_ref().map(|kept| &kept.cache)
    }

    /// Whether points are splatted with 64-bit atomics.
    pub(crate) fn has_wide_atomics(&self, splat: &Splat) -> bool {
        self.atomics64 && splat.atomics != Atomics::Bits32
    }

    /// Whether sums are added to in pairs, by 64-bit atomics.
    pub(crate) fn sums_pairs(&self, splat: &Splat) -> bool {
        self.adds_atomics64 && self.reads_atomics64 && self.has_wide_atomics(splat)
    }

    /// Whether the invocations of a workgroup share large discs: processors run them one after the other.
    pub(crate) fn shares_large_discs(&self, splat: &Splat) -> bool {
        match splat.large {
            LargeDiscs::Auto => self.info.device_type != wgpu::DeviceType::Cpu,
            LargeDiscs::Alone => false,
            LargeDiscs::Shared => true,
        }
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// The device was lost, took longer than five minutes, or something submitted since the last wait failed.
    pub fn wait(&self) -> Result<()> {
        self.wait_until(None)
    }

    /// Waits until what was submitted up to here is done.
    ///
    /// # Errors
    /// Those of `wait`.
    pub(crate) fn wait_for(&self, submitted: wgpu::SubmissionIndex) -> Result<()> {
        self.wait_until(Some(submitted))
    }

    fn wait_until(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<()> {
        let poll = wgpu::PollType::Wait { submission_index, timeout: Some(PATIENCE) };
        let polled = self.device.poll(poll).map_err(|error| Error::Lost(error.to_string()));
        self.failure()?;
        polled.map(drop)
    }

    /// What has failed since the last call. A lost device stays lost.
    ///
    /// # Errors
    /// The first failure.
    pub(crate) fn failure(&self) -> Result<()> {
        let mut failure = self.failure.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let Some(first) = failure.take() else { return Ok(()) };
        let adapter = self.info.name.clone();
        Err(match first {
            Failure::Lost(why) => {
                *failure = Some(Failure::Lost(why.clone()));
                Error::Lost(why)
            }
            Failure::NoMemory(problem) => Error::NoMemory { adapter, problem },
            Failure::Refused(problem) => Error::Device { adapter, problem },
        })
    }

    /// Copies a buffer that was created with `COPY_SRC` to the CPU.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read_buffer(&self, buffer: &wgpu::Buffer, offset: u64, size: u64) -> Result<Vec<u8>> {
        let staging = allocation::buffer(
            &self.device,
            &wgpu::BufferDescriptor {
                label: Some("read-back"),
                size,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            },
        );
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, size);
        self.queue.submit([encoder.finish()]);
        self.read_mapped(&staging, <[u8]>::to_vec)
    }

    /// Whether the adapter is a processor, on which shaders are slower than native code.
    pub fn is_processor(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Copies a texture to the CPU: rows top to bottom, without padding.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read_texture(&self, texture: &wgpu::Texture) -> Result<Vec<u8>> {
        self.read_rows(texture, 0, texture.height())
    }

    /// Copies `count` rows of a texture from row `first` to the CPU, without padding.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read_rows(&self, texture: &wgpu::Texture, first: u32, count: u32) -> Result<Vec<u8>> {
        let bytes_per_pixel = texture.format().block_copy_size(None).unwrap_or(4);
        let row = texture.width() * bytes_per_pixel;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let staging = allocation::buffer(
            &self.device,
            &wgpu::BufferDescriptor {
                label: Some("read-back"),
                size: u64::from(padded) * u64::from(count),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            },
        );
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let mut source = texture.as_image_copy();
        source.origin.y = first;
        encoder.copy_texture_to_buffer(
            source,
            wgpu::TexelCopyBufferInfo { buffer: &staging, layout },
            wgpu::Extent3d { width: texture.width(), height: count, depth_or_array_layers: 1 },
        );
        self.queue.submit([encoder.finish()]);
        self.read_mapped(&staging, |rows| tight(rows, row as usize, padded as usize))
    }

    fn read_mapped(&self, staging: &wgpu::Buffer, take: impl FnOnce(&[u8]) -> Vec<u8>) -> Result<Vec<u8>> {
        staging.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait()?;
        let view = staging.get_mapped_range(..).map_err(|error| Error::Lost(error.to_string()))?;
        Ok(take(&view))
    }
}

/// Rows of `row` bytes, from rows of `stride` bytes.
pub(crate) fn tight(rows: &[u8], row: usize, stride: usize) -> Vec<u8> {
    if row == stride {
        return rows.to_vec();
    }
    let mut tight = Vec::with_capacity(rows.len() / stride.max(1) * row);
    rows.chunks_exact(stride).for_each(|line| tight.extend_from_slice(&line[..row]));
    tight
}

/// The name and abilities of one adapter.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    pub name: String,
    pub backend: String,
    pub kind: String,
    pub driver: String,
    pub atomics64: bool,
    pub timestamps: bool,
    pub max_binding_bytes: u64,
    pub max_buffer_bytes: u64,
    pub max_texture_size: u32,
    /// What the passes need, and what of it the adapter has.
    pub needs: Vec<(&'static Need, u64)>,
    pub verdict: Verdict,
    /// Why that is so.
    pub why: String,
}

/// What becomes of an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Used,
    /// Another adapter is used, or none.
    Left,
    /// The adapter fits what is asked for, and lacks something or gives no device.
    Unable,
}

/// Every adapter, and which one `wanted` selects.
pub fn adapters(wanted: Option<&str>) -> Vec<AdapterReport> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = BACKENDS;
    let all = pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(BACKENDS));
    let chosen = choose(&candidates(&all), wanted);
    let report = |(index, adapter): (usize, &wgpu::Adapter)| {
        let info = adapter.get_info();
        let limits = limits_of(adapter);
        let features = adapter.features();
        // Only an adapter that was opened is known to be of use.
        let problem = match lack(&limits) {
            None if chosen == Some(index) => match Gpu::open(adapter.clone()) {
                Ok(_) => None,
                Err(Error::Device { problem, .. }) => Some(problem),
                Err(error) => Some(error.to_string()),
            },
            lacks => lacks,
        };
        let (verdict, why) = match (problem, wanted) {
            (_, Some(wanted)) if !fits(&info, wanted) => (Verdict::Left, format!("does not fit `{wanted}`")),
            (Some(problem), _) => (Verdict::Unable, problem),
            (None, _) if chosen != Some(index) => (Verdict::Left, "another is faster, or listed first".into()),
            (None, Some(wanted)) => (Verdict::Used, format!("fits `{wanted}`")),
            (None, None) => (Verdict::Used, "the fastest kind there is".into()),
        };
        AdapterReport {
            name: info.name.clone(),
            backend: info.backend.to_string(),
            kind: kind_name(info.device_type).into(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().into(),
            atomics64: features.contains(wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX),
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            max_buffer_bytes: limits.max_buffer_size,
            max_texture_size: limits.max_texture_dimension_2d,
            needs: NEEDS.iter().map(|need| (need, (need.of)(&limits))).collect(),
            verdict,
            why,
        }
    };
    all.iter().enumerate().map(report).collect()
}

/// `discrete gpu`, `integrated gpu`, `virtual gpu`, `cpu` or `other`.
pub fn kind_name(kind: wgpu::DeviceType) -> &'static str {
    match kind {
        wgpu::DeviceType::DiscreteGpu => "discrete gpu",
        wgpu::DeviceType::IntegratedGpu => "integrated gpu",
        wgpu::DeviceType::VirtualGpu => "virtual gpu",
        wgpu::DeviceType::Cpu => "cpu",
        wgpu::DeviceType::Other => "other",
    }
}

fn best(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>, wanted: Option<&str>) -> Result<wgpu::Adapter> {
    let mut all = pollster::block_on(instance.enumerate_adapters(BACKENDS));
    all.retain(|adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface)));
    match choose(&candidates(&all), wanted) {
        Some(index) => Ok(all.swap_remove(index)),
        None => Err(Error::NoAdapter { wanted: wanted.map_or(String::new(), |wanted| format!(" fits `{wanted}`")) }),
    }
}

/// The limits of an adapter, or those of what it acts like.
fn limits_of(adapter: &wgpu::Adapter) -> wgpu::Limits {
    Acting::from_environment().limits(adapter.limits())
}

/// The adapters to choose from, and whether each lacks something that glint needs.
fn candidates(all: &[wgpu::Adapter]) -> Vec<(wgpu::AdapterInfo, bool)> {
    all.iter().map(|adapter| (adapter.get_info(), lack(&limits_of(adapter)).is_some())).collect()
}

/// Chooses by name what has exactly the wanted one before what has it as a part, then adapters that lack nothing, then
/// discrete before integrated before virtual before software ones, then goes by the system's order.
fn choose(candidates: &[(wgpu::AdapterInfo, bool)], wanted: Option<&str>) -> Option<usize> {
    let rank = |kind| match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    let is_other = |info: &wgpu::AdapterInfo| wanted.is_some_and(|wanted| !info.name.eq_ignore_ascii_case(wanted));
    let fitting = candidates.iter().enumerate().filter(|(_, (info, _))| wanted.is_none_or(|wanted| fits(info, wanted)));
    let order = |(index, (info, lacks)): &(usize, &(wgpu::AdapterInfo, bool))| {
        (is_other(info), *lacks, rank(info.device_type), *index)
    };
    fitting.min_by_key(order).map(|(index, _)| index)
}

/// The adapter of the same name that has most in common with a known one.
fn most_like(all: &[wgpu::AdapterInfo], known: &wgpu::AdapterInfo) -> Option<usize> {
    let same = all.iter().enumerate().filter(|(_, info)| info.name == known.name);
    let differs = |info: &wgpu::AdapterInfo| {
        let is_other_place = info.device_pci_bus_id != known.device_pci_bus_id;
        (info.backend != known.backend, [info.vendor, info.device] != [known.vendor, known.device], is_other_place)
    };
    same.min_by_key(|(_, info)| differs(info)).map(|(index, _)| index)
}

fn fits(info: &wgpu::AdapterInfo, wanted: &str) -> bool {
    (wanted.eq_ignore_ascii_case("cpu") && info.device_type == wgpu::DeviceType::Cpu)
        || wanted.eq_ignore_ascii_case(info.backend.to_str())
        || info.name.to_lowercase().contains(&wanted.to_lowercase())
}

#[cfg(test)]
impl Gpu {
    /// The device that tests share, so that each pass is compiled once for all of them. A test that loses its device, or
    /// is refused something by it, opens one with `for_test`.
    pub(crate) fn shared() -> Option<Arc<Self>> {
        static SHARED: std::sync::LazyLock<Option<Arc<Gpu>>> = std::sync::LazyLock::new(Gpu::for_test);
        SHARED.clone()
    }

    /// A device of a test's own. Without an adapter a test is skipped, or fails where `GLINT_REQUIRE_GPU` is set.
    pub(crate) fn for_test() -> Option<Arc<Self>> {
        match Self::headless(None) {
            Ok(gpu) => Some(gpu),
            Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => {
                println!("skipped: {error}");
                None
            }
        }
    }
}

#[cfg(test)]
#[path = "gpu_tests.rs"]
mod tests;
