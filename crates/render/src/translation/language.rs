//! The shading languages of the backends, each written by naga with what wgpu-hal 30 asks it for: the bindings of a
//! pipeline layout, checked indices, loops with a bound, and workgroup memory that begins as zeros.

use naga::back::{hlsl, msl, spv};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy, TypeResolution};
use naga::valid::{FunctionInfo, ModuleInfo};
use naga::{Expression, Function, Module, ResourceBinding, TypeInner};

use crate::gpu::reads_atomics64;
use crate::passes::{Pass, Slot};

/// A shading language in one version.
pub(super) struct Language {
    pub name: &'static str,
    pub backend: wgpu::Backend,
    /// Whether devices that take this version may have a 64-bit atomic maximum.
    has_wide_atomics: bool,
    version: Version,
}

enum Version {
    /// SPIR-V: its version, and whether the driver checks places in buffers and images itself.
    Spirv((u8, u8), bool),
    Hlsl(hlsl::ShaderModel),
    Msl((u8, u8)),
}

/// The oldest and the newest version that wgpu-hal asks for on systems that glint runs on, and those between at which
/// the 64-bit atomics of a device appear.
pub(super) const LANGUAGES: [Language; 8] = [
    Language {
        name: "SPIR-V 1.0",
        backend: wgpu::Backend::Vulkan,
        has_wide_atomics: true,
        version: Version::Spirv((1, 0), false),
    },
    Language {
        name: "SPIR-V 1.6",
        backend: wgpu::Backend::Vulkan,
        has_wide_atomics: true,
        version: Version::Spirv((1, 6), true),
    },
    // Without DXC beside the program, the compiler is Windows's own, FXC.
    Language {
        name: "HLSL 5.1",
        backend: wgpu::Backend::Dx12,
        has_wide_atomics: false,
        version: Version::Hlsl(hlsl::ShaderModel::V5_1),
    },
    Language {
        name: "HLSL 6.0",
        backend: wgpu::Backend::Dx12,
        has_wide_atomics: false,
        version: Version::Hlsl(hlsl::ShaderModel::V6_0),
    },
    Language {
        name: "HLSL 6.6",
        backend: wgpu::Backend::Dx12,
        has_wide_atomics: true,
        version: Version::Hlsl(hlsl::ShaderModel::V6_6),
    },
    // macOS 11, 12 and 26.
    Language { name: "MSL 2.3", backend: wgpu::Backend::Metal, has_wide_atomics: false, version: Version::Msl((2, 3)) },
    Language { name: "MSL 2.4", backend: wgpu::Backend::Metal, has_wide_atomics: true, version: Version::Msl((2, 4)) },
    Language { name: "MSL 4.0", backend: wgpu::Backend::Metal, has_wide_atomics: true, version: Version::Msl((4, 0)) },
];

impl Language {
    /// Whether the renderer compiles a pass for devices of this language. `Recorder::nearest_points` chooses by the same.
    pub(super) fn is_asked(&self, module: &Module, info: &ModuleInfo) -> bool {
        (self.has_wide_atomics || !has_wide_atomics(module))
            && (reads_atomics64(self.backend) || !loads_wide_atomics(module, info))
    }

    /// Writes a module, whose constants have values, in the language. `pass` says what is bound where.
    ///
    /// # Errors
    /// What naga or spirv-val refuses.
    pub(super) fn write(&self, pass: &Pass, module: &Module, info: &ModuleInfo) -> Result<(), String> {
        // Naga translates both of these without a word, wrongly: the word of 32 bits is read, or the result does not compile.
        if !reads_atomics64(self.backend) && loads_wide_atomics(module, info) {
            return Err(format!("{} cannot read a 64-bit atomic", self.name));
        }
        if !self.has_wide_atomics && has_wide_atomics(module) {
            return Err(format!("{} has no 64-bit atomics", self.name));
        }
        let entry = (naga::ShaderStage::Compute, module.entry_points[0].name.clone());
        let refused = |why: String| format!("{}: {why}", self.name);
        match self.version {
            Version::Spirv(version, driver_checks) => {
                let policy = if driver_checks { BoundsCheckPolicy::Unchecked } else { BoundsCheckPolicy::Restrict };
                let zeros = match driver_checks {
                    true => spv::ZeroInitializeWorkgroupMemoryMode::Native,
                    false => spv::ZeroInitializeWorkgroupMemoryMode::Polyfill,
                };
                let options = spv::Options {
                    lang_version: version,
                    bounds_check_policies: BoundsCheckPolicies { buffer: policy, image_load: policy, ..RESTRICT },
                    zero_initialize_workgroup_memory: zeros,
                    ..spv::Options::default()
                };
                let stage = spv::PipelineOptions { shader_stage: entry.0, entry_point: entry.1 };
                let words = spv::write_vec(module, info, &options, Some(&stage));
                let words = words.map_err(|error| refused(error.to_string()))?;
                // Software Vulkan takes the other in all tests.
                if driver_checks { Ok(()) } else { validated(&words).map_err(refused) }
            }
            Version::Hlsl(shader_model) => {
                let options = hlsl_options(pass, shader_model);
                let stage = hlsl::PipelineOptions { entry_point: Some(entry) };
                let mut text = String::new();
                let written = hlsl::Writer::new(&mut text, &options, &stage).write(module, info, None);
                let names = written.map_err(|error| refused(error.to_string()))?.entry_point_names;
                names.into_iter().try_for_each(|name| name.map(drop).map_err(|error| refused(error.to_string())))
            }
            Version::Msl(version) => {
                let options = msl_options(pass, version, &entry.1);
                let stage = msl::PipelineOptions {
                    entry_point: Some(entry),
                    vertex_pulling_transform: true,
                    ..msl::PipelineOptions::default()
                };
                let (_, written) =
                    msl::write_string(module, info, &options, &stage).map_err(|error| refused(error.to_string()))?;
                let names = written.entry_point_names;
                names.into_iter().try_for_each(|name| name.map(drop).map_err(|error| refused(error.to_string())))
            }
        }
    }
}

const RESTRICT: BoundsCheckPolicies = BoundsCheckPolicies {
    index: BoundsCheckPolicy::Restrict,
    buffer: BoundsCheckPolicy::Restrict,
    image_load: BoundsCheckPolicy::Restrict,
    binding_array: BoundsCheckPolicy::Unchecked,
};

/// The bindings of a pass and their slots.
fn bindings(pass: &Pass) -> impl Iterator<Item = (ResourceBinding, Slot)> {
    pass.groups().enumerate().flat_map(|(group, slots)| {
        let binding = move |number: usize| ResourceBinding { group: group as u32, binding: number as u32 };
        slots.iter().enumerate().map(move |(number, (_, slot))| (binding(number), *slot))
    })
}

/// As wgpu-hal's `dx12::Device::create_pipeline_layout` counts registers.
fn hlsl_options(pass: &Pass, shader_model: hlsl::ShaderModel) -> hlsl::Options {
    let [mut constants, mut read, mut written] = [hlsl::BindTarget::default(); 3];
    let mut binding_map = hlsl::BindingMap::default();
    for (binding, slot) in bindings(pass) {
        let target = match slot {
            Slot::Uniform => &mut constants,
            Slot::Read | Slot::Texture => &mut read,
            Slot::ReadWrite | Slot::Write(_) => &mut written,
        };
        binding_map.insert(binding, *target);
        target.register += 1;
    }
    hlsl::Options {
        shader_model,
        binding_map,
        fake_missing_bindings: false,
        // The number of workgroups.
        special_constants_binding: Some(constants),
        ..hlsl::Options::default()
    }
}

/// As wgpu-hal's `metal::Device::create_pipeline_layout` counts them.
fn msl_options(pass: &Pass, lang_version: (u8, u8), entry: &str) -> msl::Options {
    let [mut buffers, mut textures] = [0; 2];
    let mut resources = msl::BindingMap::default();
    for (binding, slot) in bindings(pass) {
        let is_texture = matches!(slot, Slot::Texture | Slot::Write(_));
        let counter = if is_texture { &mut textures } else { &mut buffers };
        let target = msl::BindTarget {
            buffer: (!is_texture).then_some(*counter),
            texture: is_texture.then_some(*counter),
            mutable: matches!(slot, Slot::ReadWrite | Slot::Write(_)),
            ..msl::BindTarget::default()
        };
        resources.insert(binding, target);
        *counter += 1;
    }
    let resources = msl::EntryPointResources { resources, sizes_buffer: Some(buffers), ..Default::default() };
    msl::Options {
        lang_version,
        per_entry_point_map: [(entry.to_owned(), resources)].into(),
        fake_missing_bindings: false,
        bounds_check_policies: RESTRICT,
        ..msl::Options::default()
    }
}

/// Whether a module declares 64-bit atomics.
pub(super) fn has_wide_atomics(module: &Module) -> bool {
    module.types.iter().any(|(_, kind)| is_wide_atomic(&kind.inner))
}

fn is_wide_atomic(inner: &TypeInner) -> bool {
    matches!(inner, TypeInner::Atomic(scalar) if scalar.width == 8)
}

/// Whether a module reads a 64-bit atomic, or what it was before an operation.
fn loads_wide_atomics(module: &Module, info: &ModuleInfo) -> bool {
    let loads = |function: &Function, info: &FunctionInfo| {
        function.expressions.iter().any(|(_, expression)| {
            let pointer = match expression {
                Expression::Load { pointer } => pointer,
                Expression::AtomicResult { ty, .. } => {
                    return module.types[*ty].inner.scalar_width() == Some(8);
                }
                _ => return false,
            };
            let pointed = match &info[*pointer].ty {
                TypeResolution::Handle(handle) => &module.types[*handle].inner,
                TypeResolution::Value(inner) => inner,
            };
            matches!(pointed, TypeInner::Pointer { base, .. } if is_wide_atomic(&module.types[*base].inner))
        })
    };
    module.functions.iter().any(|(handle, function)| loads(function, &info[handle]))
        || module
            .entry_points
            .iter()
            .enumerate()
            .any(|(index, entry)| loads(&entry.function, info.get_entry_point(index)))
}

/// Whether spirv-val is installed.
pub(super) fn is_judged() -> bool {
    static IS_INSTALLED: std::sync::LazyLock<bool> =
        std::sync::LazyLock::new(|| std::process::Command::new("spirv-val").arg("--version").output().is_ok());
    *IS_INSTALLED
}

/// Lets spirv-val judge a module, where it is installed.
fn validated(words: &[u32]) -> Result<(), String> {
    if !is_judged() {
        assert!(std::env::var_os("CI").is_none(), "spirv-val (spirv-tools) is not installed, and CI is set");
        return Ok(());
    }
    let file = tempfile::NamedTempFile::new().map_err(|error| error.to_string())?;
    std::fs::write(file.path(), bytemuck::cast_slice(words)).map_err(|error| error.to_string())?;
    let judge = std::process::Command::new("spirv-val").args(["--target-env", "vulkan1.1"]).arg(file.path()).output();
    let judge = judge.map_err(|error| error.to_string())?;
    if judge.status.success() { Ok(()) } else { Err(format!("spirv-val: {}", String::from_utf8_lossy(&judge.stderr))) }
}
