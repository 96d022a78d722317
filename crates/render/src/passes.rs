//! The passes: name (shader file, entry point and timer label at once) and what each binds.

/// What a binding is. `bindings_of_every_pass_agree_with_its_shader` compares these with the shaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slot {
    Uniform,
    /// Storage buffer, read only.
    Read,
    ReadWrite,
    /// Float texture, loaded without a sampler.
    Texture,
    /// Storage texture.
    Write(wgpu::TextureFormat),
}

pub struct Pass {
    pub name: &'static str,
    pub groups: &'static [&'static [Slot]],
}

use Slot::{Read, ReadWrite, Texture, Uniform, Write};
use wgpu::TextureFormat::{R32Float, Rgba8Unorm, Rgba16Float, Rgba32Float};

/// Group 0 of every pass: camera and parameters.
const FRAME: &[Slot] = &[Uniform, Read];
/// Group 1 of the passes that walk points: a page of the store.
const PAGE: &[Slot] = &[Uniform, Read, Read, Read, Read, Read, Read, Read];

pub const SPLAT_NEAREST: Pass = Pass { name: "splat_nearest", groups: &[FRAME, PAGE, &[ReadWrite]] };
pub const SPLAT_DEPTH: Pass = Pass { name: "splat_depth", groups: &[FRAME, PAGE, &[ReadWrite]] };
pub const SPLAT_IDENTITY: Pass = Pass { name: "splat_identity", groups: &[FRAME, PAGE, &[ReadWrite]] };
pub const SPLAT_ACCUMULATE: Pass =
    Pass { name: "splat_accumulate", groups: &[FRAME, PAGE, &[Read, ReadWrite, ReadWrite, ReadWrite, ReadWrite]] };
pub const SPLAT_AVERAGE: Pass = Pass {
    name: "splat_average",
    groups: &[FRAME, &[Read, Read, Read, Read, Read, Write(Rgba16Float), Write(Rgba32Float), Write(R32Float)]],
};
pub const SPLAT_RESOLVE: Pass = Pass {
    name: "splat_resolve",
    groups: &[FRAME, PAGE, &[Read, Write(Rgba16Float), Write(Rgba32Float), Write(R32Float)]],
};
pub const CLOSE_GAPS: Pass = Pass {
    name: "close_gaps",
    groups: &[FRAME, &[Texture, Texture, Texture, Write(Rgba16Float), Write(Rgba32Float), Write(R32Float)]],
};
pub const MIRROR_EXACT: Pass = Pass {
    name: "mirror_exact",
    groups: &[FRAME, &[Texture, Read, Write(Rgba16Float), Write(Rgba32Float), Write(R32Float)]],
};
pub const MIRROR_EXACT_SEEN: Pass = Pass {
    name: "mirror_exact_seen",
    groups: &[
        FRAME,
        &[
            Texture,
            Texture,
            Texture,
            Read,
            Texture,
            Texture,
            Texture,
            Write(Rgba16Float),
            Write(Rgba32Float),
            Write(Rgba32Float),
        ],
    ],
};
pub const CAMERA_POSITION: Pass = Pass { name: "camera_position", groups: &[FRAME, &[Texture, Write(Rgba32Float)]] };
pub const MIRROR_SURFACE: Pass = Pass {
    name: "mirror_surface",
    groups: &[FRAME, &[Texture, Texture, Texture, Write(Rgba32Float), Write(Rgba32Float)]],
};
pub const MIRROR_DOUBT: Pass = Pass {
    name: "mirror_doubt",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Texture, Write(R32Float), ReadWrite]],
};
pub const BEAM_LISTS: Pass =
    Pass { name: "beam_lists", groups: &[FRAME, &[Texture, Texture, Texture, Read, Read, Read, ReadWrite]] };
pub const SURFEL_TRACE: Pass = Pass {
    name: "surfel_trace",
    groups: &[
        FRAME,
        &[
            Texture,
            Texture,
            Texture,
            Read,
            Read,
            Read,
            Read,
            Read,
            Read,
            ReadWrite,
            Uniform,
            Read,
            Read,
            Write(Rgba32Float),
            ReadWrite,
        ],
    ],
};
pub const GATHER_RESOLVE: Pass = Pass {
    name: "gather_resolve",
    groups: &[
        FRAME,
        PAGE,
        &[Texture, Texture, Texture, Read, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float)],
    ],
};
pub const ENVIRONMENT_LOOK_UP: Pass = Pass {
    name: "environment_look_up",
    groups: &[
        FRAME,
        PAGE,
        &[
            Texture,
            Texture,
            Texture,
            Read,
            Read,
            Write(Rgba16Float),
            Write(Rgba32Float),
            Write(Rgba32Float),
            Write(Rgba32Float),
        ],
    ],
};
pub const MIRRORED_LOOK_UP: Pass = Pass {
    name: "mirrored_look_up",
    groups: &[
        FRAME,
        PAGE,
        &[Texture, Read, Read, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float), Write(Rgba32Float)],
    ],
};
pub const CURVATURE: Pass = Pass { name: "curvature", groups: &[FRAME, &[Texture, Texture, Texture, ReadWrite]] };
pub const CURVATURE_SMOOTH: Pass = Pass { name: "curvature_smooth", groups: &[FRAME, &[ReadWrite]] };
pub const LABEL_START: Pass = Pass { name: "label_start", groups: &[FRAME, &[Read, ReadWrite, ReadWrite]] };
pub const LABEL_JOIN: Pass = Pass { name: "label_join", groups: &[FRAME, &[ReadWrite]] };
pub const LABEL_FLATTEN: Pass = Pass { name: "label_flatten", groups: &[FRAME, &[ReadWrite, ReadWrite]] };
pub const REGION_COUNT: Pass = Pass { name: "region_count", groups: &[FRAME, &[Read, Read, ReadWrite]] };
pub const REGION_SCAN: Pass = Pass { name: "region_scan", groups: &[FRAME, &[ReadWrite, ReadWrite, ReadWrite]] };
pub const REGION_NUMBER: Pass = Pass { name: "region_number", groups: &[FRAME, &[Read, ReadWrite, Read, ReadWrite]] };
pub const REGION_ASSIGN: Pass =
    Pass { name: "region_assign", groups: &[FRAME, &[Texture, Texture, Texture, Read, Read, ReadWrite, ReadWrite]] };
pub const SSCR_SOLVE: Pass =
    Pass { name: "sscr_solve", groups: &[FRAME, PAGE, &[Uniform, Read, Read, Read, ReadWrite, ReadWrite, ReadWrite]] };
pub const SSCR_VIEWS: Pass = Pass { name: "sscr_views", groups: &[FRAME, &[Read, Read, Read, Write(Rgba32Float)]] };
pub const MIRROR_DEPTH: Pass = Pass { name: "mirror_depth", groups: &[FRAME, PAGE, &[Read, Texture, ReadWrite]] };
pub const MIRROR_VISIBILITY: Pass =
    Pass { name: "mirror_visibility", groups: &[FRAME, PAGE, &[Read, Texture, Read, ReadWrite, ReadWrite]] };
pub const MIRROR_AVERAGE: Pass = Pass {
    name: "mirror_average",
    groups: &[FRAME, &[Texture, Read, Read, Read, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float)]],
};
pub const PULL: Pass = Pass {
    name: "pull",
    groups: &[FRAME, &[Texture, Texture, Texture, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float)]],
};
pub const PUSH: Pass = Pass {
    name: "push",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float)]],
};
pub const GATHER_CLOSE: Pass = Pass {
    name: "gather_close",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Write(Rgba16Float), Write(Rgba32Float), Write(Rgba32Float)]],
};
pub const VPL_POINTS: Pass = Pass { name: "vpl_points", groups: &[FRAME, PAGE, &[Uniform, Read, ReadWrite]] };
pub const VPL_AIM: Pass = Pass { name: "vpl_aim", groups: &[FRAME, &[Uniform, Read, Read, ReadWrite, ReadWrite]] };
pub const VPL_PLACE: Pass =
    Pass { name: "vpl_place", groups: &[FRAME, PAGE, &[Uniform, Read, Read, Read, Read, ReadWrite]] };
pub const VPL_BOUNCE: Pass =
    Pass { name: "vpl_bounce", groups: &[FRAME, &[Uniform, Read, Read, Read, ReadWrite, Uniform]] };
pub const VPL_SHADOW_SPLAT: Pass =
    Pass { name: "vpl_shadow_splat", groups: &[FRAME, &[Uniform, Read, Read, Read, ReadWrite, Uniform]] };
pub const VPL_SHADOW_PULL: Pass = Pass { name: "vpl_shadow_pull", groups: &[FRAME, &[Uniform, ReadWrite, Uniform]] };
pub const VPL_SHADOW_PUSH: Pass = Pass { name: "vpl_shadow_push", groups: &[FRAME, &[Uniform, ReadWrite, Uniform]] };
pub const INDIRECT: Pass = Pass {
    name: "indirect",
    groups: &[
        FRAME,
        &[Texture, Texture, Texture, Texture, Uniform, Read, Read, Write(Rgba16Float), Write(Rgba16Float)],
    ],
};
pub const INDIRECT_FILTER: Pass = Pass {
    name: "indirect_filter",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Texture, Texture, Write(Rgba16Float)]],
};
pub const SHADE: Pass =
    Pass { name: "shade", groups: &[FRAME, &[Texture, Texture, Texture, Texture, Read, Read, Write(Rgba16Float)]] };
pub const BLEND: Pass = Pass {
    name: "blend",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Texture, Texture, Texture, Texture, Write(Rgba16Float)]],
};
pub const SHOW: Pass = Pass {
    name: "show",
    groups: &[FRAME, &[Texture, Texture, Texture, Texture, Texture, Texture, Texture, Write(Rgba8Unorm)]],
};
pub const SHOW_LIGHT: Pass =
    Pass { name: "show_light", groups: &[FRAME, &[Uniform, Texture, Texture, Write(Rgba8Unorm)]] };
pub const SHOW_LIGHT_BUFFER: Pass =
    Pass { name: "show_light_buffer", groups: &[FRAME, &[Uniform, Read, Read, Write(Rgba8Unorm)]] };
pub const SHOW_VIRTUAL_LIGHTS: Pass = Pass {
    name: "show_virtual_lights",
    groups: &[FRAME, &[Uniform, Uniform, Read, Read, Read, Texture, Write(Rgba8Unorm)]],
};
pub const SHOW_SHADOW_MAPS: Pass =
    Pass { name: "show_shadow_maps", groups: &[FRAME, &[Uniform, Uniform, Read, Read, Write(Rgba8Unorm)]] };
pub const PRESENT: Pass = Pass { name: "present", groups: &[FRAME, &[Texture, Texture, Write(Rgba8Unorm)]] };

/// The passes that find the nearest point of each pixel, by the width of the adapter's atomics.
pub fn splat_nearest(atomics64: bool) -> &'static [&'static Pass] {
    if atomics64 { &[&SPLAT_NEAREST] } else { &[&SPLAT_DEPTH, &SPLAT_IDENTITY] }
}

/// Every pass, for the tests that compare them with their shaders.
#[cfg(test)]
pub const ALL: &[&Pass] = &[
    &SPLAT_NEAREST,
    &SPLAT_DEPTH,
    &SPLAT_IDENTITY,
    &SPLAT_ACCUMULATE,
    &SPLAT_AVERAGE,
    &SPLAT_RESOLVE,
    &CLOSE_GAPS,
    &MIRROR_EXACT,
    &MIRROR_EXACT_SEEN,
    &CAMERA_POSITION,
    &MIRROR_SURFACE,
    &MIRROR_DOUBT,
    &BEAM_LISTS,
    &SURFEL_TRACE,
    &GATHER_RESOLVE,
    &ENVIRONMENT_LOOK_UP,
    &MIRRORED_LOOK_UP,
    &CURVATURE,
    &CURVATURE_SMOOTH,
    &LABEL_START,
    &LABEL_JOIN,
    &LABEL_FLATTEN,
    &REGION_COUNT,
    &REGION_SCAN,
    &REGION_NUMBER,
    &REGION_ASSIGN,
    &SSCR_SOLVE,
    &SSCR_VIEWS,
    &MIRROR_DEPTH,
    &MIRROR_VISIBILITY,
    &MIRROR_AVERAGE,
    &PULL,
    &PUSH,
    &GATHER_CLOSE,
    &VPL_POINTS,
    &VPL_AIM,
    &VPL_PLACE,
    &VPL_BOUNCE,
    &VPL_SHADOW_SPLAT,
    &VPL_SHADOW_PULL,
    &VPL_SHADOW_PUSH,
    &INDIRECT,
    &INDIRECT_FILTER,
    &SHADE,
    &BLEND,
    &SHOW,
    &SHOW_LIGHT,
    &SHOW_LIGHT_BUFFER,
    &SHOW_VIRTUAL_LIGHTS,
    &SHOW_SHADOW_MAPS,
    &PRESENT,
];

/// A compiled pass.
pub struct Compiled {
    name: &'static str,
    pub pipeline: wgpu::ComputePipeline,
    layouts: Vec<wgpu::BindGroupLayout>,
}

impl Compiled {
    /// `switches`: values of the shader's `override` constants.
    ///
    /// # Errors
    /// What the shader compiler says, with file and line.
    pub fn new(device: &wgpu::Device, pass: &Pass, switches: &[(&'static str, u32)]) -> Result<Self, String> {
        let woven = crate::shader::weave(pass.name)?;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(pass.name),
            source: wgpu::ShaderSource::Wgsl(woven.source.as_str().into()),
        });
        let layouts: Vec<wgpu::BindGroupLayout> = pass
            .groups
            .iter()
            .map(|slots| {
                let entries: Vec<wgpu::BindGroupLayoutEntry> = slots
                    .iter()
                    .enumerate()
                    .map(|(binding, slot)| wgpu::BindGroupLayoutEntry {
                        binding: binding as u32,
                        visibility: wgpu::ShaderStages::COMPUTE,
                        ty: binding_type(*slot),
                        count: None,
                    })
                    .collect();
                device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(pass.name),
                    entries: &entries,
                })
            })
            .collect();
        let optional: Vec<Option<&wgpu::BindGroupLayout>> = layouts.iter().map(Some).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(pass.name),
            bind_group_layouts: &optional,
            ..Default::default()
        });
        let constants: Vec<(&str, f64)> = switches.iter().map(|(name, value)| (*name, f64::from(*value))).collect();
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(pass.name),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(pass.name),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            cache: None,
        });
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(format!("shader {}: {}", pass.name, woven.explain(&error.to_string())));
        }
        Ok(Self { name: pass.name, pipeline, layouts })
    }

    /// A bind group for group `group` of this pass, resources in slot order.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        group: usize,
        resources: &[wgpu::BindingResource<'_>],
    ) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = resources
            .iter()
            .enumerate()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: binding as u32, resource: resource.clone() })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.layouts[group],
            entries: &entries,
        })
    }
}

fn binding_type(slot: Slot) -> wgpu::BindingType {
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    match slot {
        Slot::Uniform => buffer(wgpu::BufferBindingType::Uniform),
        Slot::Read => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
        Slot::ReadWrite => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
        Slot::Texture => wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        },
        Slot::Write(format) => wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format,
            view_dimension: wgpu::TextureViewDimension::D2,
        },
    }
}
