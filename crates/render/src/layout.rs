//! The layouts that Rust and the shaders share, in one table: structs, the sizes of structs that only shaders access,
//! and constants. The tests below compare every line with the shaders.

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};

/// Declares the structs that fill buffers. They hold scalars and vec4 only: the padding of vec3 is a silent corruption.
macro_rules! structs {
    ($($(#[$doc:meta])* $Struct:ident { $($(#[$field_doc:meta])* $field:ident: $Type:ident),* $(,)? })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
            pub struct $Struct { $($(#[$field_doc])* pub $field: $Type),* }
        )*

        #[cfg(test)]
        fn structs() -> Vec<Struct> {
            vec![$(Struct {
                name: stringify!($Struct),
                bytes: size_of::<$Struct>(),
                fields: vec![$(Member {
                    name: stringify!($field).to_owned(),
                    kind: stringify!($Type),
                    offset: std::mem::offset_of!($Struct, $field),
                    bytes: size_of::<$Type>(),
                }),*],
            }),*]
        }
    };
}

structs! {
    /// The camera and the screen, of shaders/shared/frame.wgsl.
    Frame {
        right: Vec4, up: Vec4, forward: Vec4, clip: Vec4, world_up: Vec4,
        focal_pixels: f32, orthographic: u32, width: u32, height: u32,
        near: f32, reference_depth: f32, scene_radius: f32, mirror_tile: u32,
        first_row: u32, sample: u32, samples: u32, look: u32,
        first_column: u32, columns: u32, unused_0: u32, unused_1: u32,
    }
    /// A run of points with one origin and one material, of shaders/shared/splat.wgsl.
    Item {
        origin_radius: Vec4,
        low: f32, inverse_range: f32, color_source: u32, plain: u32,
        specular_intensity: f32, specular_power: f32, palette: u32, height: f32,
        height_axis: Vec4,
    }
    /// The points that one workgroup splats, of shaders/shared/splat.wgsl.
    Block { item: u32, first: u32, count: u32, first_identity: u32 }
    /// The values of one page of the store, of shaders/shared/splat.wgsl.
    Page {
        run_count: u32, point_count: u32, is_first: u32, step: u32,
        runs_at: u32, items_at: u32, item_count: u32, unused: u32,
    }
    /// Which of its two runs over the points a pass makes, of shaders/shared/run.wgsl.
    Run { finds_identity: u32, unused_0: u32, unused_1: u32, unused_2: u32 }
    /// A light with a shadow map, of shaders/shared/light.wgsl.
    LightSource { position_inner: Vec4, axis_outer: Vec4, intensity_focal: Vec4, right: Vec4, up: Vec4 }
    /// How fast the exposure changes, of shaders/shared/exposure.wgsl.
    Adaptation { before: f32, share: f32, unused_0: u32, unused_1: u32 }
    /// The exposure that was fitted to a picture, of shaders/shared/exposure.wgsl.
    FittedExposure { stops: f32, adapts: u32, unused_0: u32, unused_1: u32 }
    /// The point whose error is shown, of shaders/show_error.wgsl.
    ShownPoint { position: Vec4 }
    /// The layout of the views of the light, of shaders/shared/light_view.wgsl.
    LightViews { columns: u32, edge: u32, count: u32, unused: u32, nearest: Vec4, farthest: Vec4 }
    /// The values that all virtual lights share, of shaders/shared/vpl.wgsl.
    Virtual {
        eye_radius: Vec4,
        disc_radius: f32, nearest: f32, steps: f32, map_size: u32,
        map_stride: u32, point_count: u32, subsets: u32, sky_lights: u32,
        lights_per_bounce: u32, bounces: u32, area_over_pi: f32, follows_mirrors: u32,
    }
    /// A virtual light, of shaders/shared/vpl.wgsl.
    Vpl { position: Vec4, normal: Vec4, intensity: Vec4, glossy: Vec4, incoming: Vec4, tangent: Vec4 }
    /// The virtual lights and maps that a pass works on, of shaders/shared/vpl.wgsl.
    Step {
        first_light: u32, bounce: u32, fine_size: u32, fine_first: u32,
        coarse_first: u32, unused_0: u32, unused_1: u32, unused_2: u32,
    }
    /// A lamp or the sun, from which virtual lights come, of shaders/vpl_place.wgsl.
    Emitter { position: Vec4, axis_focal: Vec4, right: Vec4, up: Vec4, flux: Vec4, strength: Vec4, angles: Vec4 }
    /// Light that may meet one mirror, of shaders/photon_start.wgsl.
    PhotonBeam {
        axis_extent: Vec4, position_inner: Vec4, axis_outer: Vec4, strength: Vec4,
        first: u32, count: u32, unused_0: u32, unused_1: u32,
    }
    /// Which photons a pass works on, of shaders/photon_start.wgsl.
    PhotonRun { first: u32, each: u32, total: u32, unused: u32 }
    /// A photon where it has landed, of shaders/shared/photons.wgsl.
    Landed { position: Vec4, normal: Vec4, albedo: Vec4, power: Vec4, incoming: Vec4 }
    /// A photon for which a virtual light stands, of shaders/vpl_photons.wgsl.
    PhotonLight {
        position: Vec4, normal: Vec4, albedo: Vec4, flux: Vec4, toward: Vec4,
        number: u32, unused_0: u32, unused_1: u32, unused_2: u32,
    }
    /// A mirror that is drawn by its formula, of shaders/shared/mirror_formula.wgsl.
    FormulaMirror {
        x_kind: Vec4, y_parameter: Vec4, z_size: Vec4, position_reach: Vec4, color_intensity: Vec4,
        specular_power: f32, refraction: f32, as_points: u32, part: u32,
    }
    /// The box about all points; it precedes the mirrors with maps in their buffer, of
    /// shaders/shared/mirror_places.wgsl.
    MappedMirrors { scene_low: Vec4, scene_high: Vec4 }
    /// A mirror with the map of its surroundings, of shaders/shared/mirror_places.wgsl.
    MappedMirror { low_map: Vec4, high: Vec4, view: Vec4 }
    /// A node of a tree of discs, of shaders/shared/surfel_tree.wgsl. Positions are relative to the chunk's origin; nodes and discs
    /// count from the chunk's first.
    Node {
        /// The lower corner of the discs' box.
        low: Vec3,
        /// The node that follows when a ray misses this one.
        skip: u32,
        high: Vec3,
        /// The first disc and the count of a leaf; `INNER` for other nodes.
        leaf: u32,
    }
    /// A chunk's tree among those of its page, of shaders/shared/surfel_tree.wgsl.
    TreePlace {
        origin_margin: Vec4, first_node: u32, end_node: u32, first_surfel: u32, first_identity: u32,
    }
    /// The maps of `cubemap_trace`; their middles follow. Of shaders/shared/cubemaps.wgsl.
    Cubes {
        size: u32, padded_size: u32, texels_of_face: u32, levels: u32, maps: u32, lag: u32, unused_1: u32, unused_2: u32,
    }
    /// The maps of `light_field` in a page; the grids of the mirrors follow. Of shaders/shared/light_field.wgsl.
    Fields {
        size: u32, texels_of_face: u32, first_slot: u32, slots: u32, is_first: u32, is_last: u32, picks: u32,
        first_of_all: u32,
    }
    /// The cells of a mirror's box, each with its samples, of shaders/shared/light_field.wgsl.
    SampleGrid { low_scale: Vec4, columns: u32, rows: u32, layers: u32, first: u32 }
    /// The maps of a page whose texels are traced on demand; the middles of its slots follow. Of
    /// shaders/shared/asked_texels.wgsl.
    AskedMaps { size: u32, texels_of_face: u32, mirror: u32, unused: u32 }
    /// A sample of a mirror, of shaders/shared/light_field.wgsl.
    FieldSample { surface_slot: Vec4, middle: Vec4 }
    /// The level of bounds that a pass makes, of shaders/cube_bounds.wgsl.
    CubeLevel { level: u32, unused_1: u32, unused_2: u32, unused_3: u32 }
    /// The camera's picture in `screen_trace`; the first cells of its levels follow. Of shaders/shared/screen.wgsl.
    Screen {
        levels: u32, level: u32, mirror_radius: f32, texels_of_layer: u32,
        box_low: Vec4, box_high: Vec4,
    }
    /// The squares of `sample_cameras`, and the level that a pass makes, of shaders/shared/bundle.wgsl.
    BundleGrid {
        first_x: u32, first_y: u32, columns: u32, rows: u32, last_level: u32, level: u32, largest: u32, stride: u32,
        scene_low: Vec4, scene_high: Vec4,
    }
    /// The trees of reflected rays of `sample_cameras` with cells of space, of shaders/shared/camera_tree.wgsl.
    CameraTrees {
        first_x: u32, first_y: u32, columns: u32, rows: u32, stride: u32, trees: u32, nodes: u32, unused: u32,
        shift: Vec4,
    }
    /// A plane of such a tree, of shaders/shared/camera_tree.wgsl.
    CameraNode { plane: Vec4, above: u32, below: u32, unused_1: u32, unused_2: u32 }
    /// A leaf of such a tree, of shaders/shared/camera_tree.wgsl.
    CameraLeaf {
        kind: u32, first: u32, count: u32, next: u32,
        middle: Vec4, axis: Vec4, by_u: Vec4, by_v: Vec4, depth: Vec4, factors_0: Vec4, factors_1: Vec4,
        factors_2: Vec4,
    }
    /// A reflected ray, of shaders/shared/camera_tree.wgsl.
    CameraRay { point: Vec4, direction: Vec4 }
    /// The draw of a region that a search is for, of shaders/sscr_solve.wgsl.
    Round { draw: u32, seed: u32 }
}

/// Declares the sizes in bytes of structs that only shaders access.
macro_rules! sizes {
    ($($Struct:ident: $BYTES:ident = $bytes:literal;)*) => {
        $(pub const $BYTES: u64 = $bytes;)*
        #[cfg(test)]
        const SIZES: &[(&str, u64)] = &[$((stringify!($Struct), $BYTES)),*];
    };
}

sizes! {
    Region: REGION_BYTES = 80;
    MirrorPixel: MIRROR_PIXEL_BYTES = 32;
    Solution: SOLUTION_BYTES = 8;
    GlossPixel: GLOSS_PIXEL_BYTES = 16;
    LightPath: LIGHT_PATH_BYTES = 64;
    BundleNode: BUNDLE_NODE_BYTES = 64;
    Bundle: BUNDLE_BYTES = 208;
}

/// Declares the size in bytes of an element of a buffer without structs, and a pass and slot to which it is bound.
macro_rules! elements {
    ($($pass:ident.$slot:ident: $BYTES:ident = $bytes:literal;)*) => {
        $(pub const $BYTES: u64 = $bytes;)*
        #[cfg(test)]
        const ELEMENTS: &[(&str, &str, u64)] = &[$((stringify!($pass), stringify!($slot), $BYTES)),*];
    };
}

elements! {
    splat_resolve.points: POINT_BYTES = 16;
    splat_resolve.attributes: ATTRIBUTE_BYTES = 8;
    splat_resolve.nearest: NEAREST_BYTES = 8;
    splat_average.color_sums: COLOR_SUM_BYTES = 16;
    splat_average.surface_sums: SURFACE_SUM_BYTES = 16;
    splat_average.carries: CARRY_BYTES = 16;
    surfel_trace.surfels: SURFEL_BYTES = 8;
    surfel_trace.order: ORDER_BYTES = 4;
    surfel_trace.hits: HIT_BYTES = 16;
    cubemap_trace.records: CUBE_TEXEL_BYTES = 16;
    cubemap_trace.bounds: CUBE_CELL_BYTES = 8;
    light_field_need.needs: NEED_BYTES = 4;
    light_field_predict.predicted: PREDICTED_BYTES = 4;
    light_field_ask.asked: ASKED_BYTES = 4;
    light_field_asked_trace.found: ASKED_FOUND_BYTES = 8;
    screen_trace.records: SCREEN_TEXEL_BYTES = 16;
    screen_trace.bounds: SCREEN_CELL_BYTES = 8;
    screen_trace.rest: REST_WORD_BYTES = 4;
    screen_box_edges.edges: BOX_EDGE_BYTES = 4;
    screen_box_scores.scores: BOX_SCORE_BYTES = 4;
    screen_box_periods.periods: BOX_WORD_BYTES = 4;
    label_start.curvature_map: CURVATURE_BYTES = 4;
    label_start.parents: PARENT_BYTES = 4;
    label_start.sizes: LABEL_BYTES = 4;
    region_scan.runs: RUN_BYTES = 8;
    photon_land.powers: POWER_BYTES = 16;
    gloss_sum.sums: GLOSS_SUM_BYTES = 16;
    gloss_sum.distances: GLOSS_DISTANCE_BYTES = 8;
    gloss_sum.shares_left: GLOSS_SHARE_BYTES = 4;
    gloss_keep.kept: KEPT_WORD_BYTES = 4;
    mirror_average.nearest: NEAREST_REFLECTION_BYTES = 4;
    shade.shadows: SHADOW_TEXEL_BYTES = 8;
    indirect_reuse.kept: KEPT_LIGHT_BYTES = 16;
    light_ray_reuse.kept: KEPT_PLACE_BYTES = 16;
    light_ray_reuse.kept_light: KEPT_MEAN_BYTES = 16;
    vpl_aim.hits: AIM_HIT_BYTES = 4;
    vpl_shadow_splat.shadow_maps: VIRTUAL_TEXEL_BYTES = 4;
    exposure_histogram.histogram: EXPOSURE_COUNT_BYTES = 4;
    probe_pixels.pixels: PROBE_PIXEL_BYTES = 4;
    probe_pixels.values: PROBE_VALUE_BYTES = 16;
}

/// Declares constants that the shaders have under the same name.
macro_rules! constants {
    ($($(#[$doc:meta])* $NAME:ident: $Type:ident = $value:expr;)*) => {
        $($(#[$doc])* pub const $NAME: $Type = $value;)*
        #[cfg(test)]
        const CONSTANTS: &[(&str, f64)] = &[$((stringify!($NAME), $NAME as f64)),*];
    };
}

constants! {
    /// The number of points that one workgroup of 128 splats: eight rounds, which hides the cost of starting it.
    BLOCK_POINTS: u32 = 1024;
    /// The number of words per pixel for the sums of the highlights of a splatted surface.
    SPECULAR_WORDS: u64 = 4;
    /// The number of bins of the histogram of a picture's brightness.
    EXPOSURE_BINS: u32 = 256;
    /// Depths belong to one surface if they differ by this share or less.
    SAME_SURFACE: f32 = 0.02;
    /// Points and pixels this near to a wall of the box about all points lie on it, in scene radii: scans of a wall are
    /// thinner than that.
    WALL_DEPTH: f32 = 0.02;
    /// The number of texels along an edge of a shadow map: two to a pixel of a usual picture, so that a texel is about
    /// as fine as a splat.
    SHADOW_SIZE: u32 = 1024;
    /// The number of texels along an edge of a map from which virtual lights are placed.
    LAMP_MAP_SIZE: u32 = SHADOW_SIZE;
    /// The number of directions that are tried for a virtual light.
    VPL_TRIES: u32 = 8;
    /// There is no texel to try.
    AIM_NONE: u32 = u32::MAX;
    /// A virtual light without a parent.
    PARENT_NONE: u32 = u32::MAX;
    /// The kind of a virtual light of the sky.
    VPL_SKY: f32 = 2.0;
    /// The number of vectors kept for a point that casts indirect shadows.
    OCCLUDER_VECTORS: u64 = 2;
    /// The number of counters of a layer of shadow maps.
    AIM_COUNTS: u64 = 2;
    /// Marks an inner node of a tree of discs.
    INNER: u32 = u32::MAX;
    /// The number of samples that a cell of a mirror's box has room for, and its mark of none.
    CELL_SAMPLES: usize = 16;
    NO_SAMPLE: u32 = u32::MAX;
    /// The number of words of a tile's list of nodes.
    LIST_WORDS: u64 = 97;
    /// The smallest region in pixels that a bracket fits in.
    LEAST_REGION: u64 = 4;
    /// The number of pixels in which one workgroup numbers the regions.
    RUN_PIXELS: u32 = 1024;
    /// The number of words per pixel for where searches ended.
    ENDING_WORDS: u64 = 3;
    /// What follows these words in their buffer begins at a multiple of so many: where a binding may.
    ENDING_ALIGNMENT: u64 = 64;
    /// The number of words of the sums of a mirror pixel, and of their carries, which take half a word each.
    MIRROR_SUMS: u64 = 12;
    MIRROR_CARRIES: u64 = 6;
    /// What follows the carries in their buffer begins at a multiple of so many words: where a binding may.
    CARRY_ALIGNMENT: u64 = 64;
    /// The indices of the counters of a frame's reflections.
    MIRROR_PIXELS: usize = 0;
    FOUND_PIXELS: usize = 1;
    CLOSED_PIXELS: usize = 2;
    POINTS_TRIED: usize = 3;
    POINTS_FOUND: usize = 4;
    REGIONS: usize = 5;
    POINTS_UNCONVERGED: usize = 6;
    NODES_TESTED: usize = 7;
    DISCS_TESTED: usize = 8;
    DOUBTED_PIXELS: usize = 9;
    RAYS_LEFT: usize = 10;
    RAYS_TRACED: usize = 11;
    RAYS_KEPT: usize = 13;
    POINTS_LISTED: usize = 15;
    TEXELS_TRACED: usize = 16;
    /// The sources of a point's colour.
    COLOR_PLAIN: u32 = 0;
    COLOR_RGB: u32 = 1;
    COLOR_NORMAL: u32 = 2;
    COLOR_CLASS: u32 = 3;
    COLOR_HEIGHT: u32 = 4;
    COLOR_SCALAR: u32 = 5;
    COLOR_STRAY: u32 = 6;
    COLOR_RGB_OR_PLAIN: u32 = 7;
    COLOR_RGB_OR_GREY: u32 = 8;
    /// Marks a leaf among the nodes of a tree of rays, and the kinds of leaves.
    CAMERA_LEAF: u32 = 1 << 31;
    CAMERA_OPEN: u32 = 0;
    CAMERA_PINHOLE: u32 = 1;
    CAMERA_LIST: u32 = 2;
    /// The shapes of mirrors with a formula.
    PLANE: f32 = 0.0;
    SPHERE: f32 = 1.0;
    PARABOLOID: f32 = 2.0;
    CYLINDER: f32 = 3.0;
    TORUS: f32 = 4.0;
    BLOB: f32 = 5.0;
    CORAL: f32 = 6.0;
}

/// The size of a point's scalar in the attributes of a page, of shaders/shared/page_group.wgsl.
pub const SCALAR_BYTES: u64 = 4;

/// The number of counters that the buffer has room for: an even one, so that what follows them is aligned.
pub const COUNTERS: usize = 18;
const _: () = assert!(TEXELS_TRACED < COUNTERS);

/// The name, the size and the fields of a struct.
#[cfg(test)]
struct Struct {
    name: &'static str,
    bytes: usize,
    fields: Vec<Member>,
}

#[cfg(test)]
struct Member {
    name: String,
    kind: &'static str,
    offset: usize,
    bytes: usize,
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use naga::{ScalarKind, TypeInner};

    use super::*;
    use crate::passes::ALL;
    use crate::shader::tests::module_of;

    /// The size of a struct in bytes, and the name, offset, bytes and kind of each member.
    type Layout = (usize, Vec<(String, usize, usize, &'static str)>);

    /// The declarations in the shaders of all passes, by name.
    #[derive(Default)]
    struct Said {
        /// All layouts of one struct in the passes.
        structs: BTreeMap<String, BTreeSet<Layout>>,
        constants: BTreeMap<String, BTreeSet<String>>,
        /// The size of an element in bytes, by pass and slot.
        elements: BTreeMap<(String, String), usize>,
        /// The structs that a buffer holds or is.
        bound: BTreeSet<String>,
    }

    fn kind_of(inner: &TypeInner) -> &'static str {
        match inner {
            TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Float => "f32",
            TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Uint => "u32",
            TypeInner::Vector { size: naga::VectorSize::Quad, scalar } if scalar.kind == ScalarKind::Float => "Vec4",
            _ => "other",
        }
    }

    fn said() -> Said {
        let mut said = Said::default();
        for pass in ALL {
            let module = module_of(pass);
            let mut layouter = naga::proc::Layouter::default();
            layouter.update(module.to_ctx()).unwrap();
            for (handle, kind) in module.types.iter() {
                let (Some(name), TypeInner::Struct { members, .. }) = (&kind.name, &kind.inner) else { continue };
                let member = |member: &naga::StructMember| {
                    let inner = &module.types[member.ty].inner;
                    let bytes = if matches!(inner, TypeInner::Array { size: naga::ArraySize::Dynamic, .. }) {
                        0
                    } else {
                        layouter[member.ty].size as usize
                    };
                    (member.name.clone().unwrap(), member.offset as usize, bytes, kind_of(inner))
                };
                let layout = (layouter[handle].size as usize, members.iter().map(member).collect());
                said.structs.entry(name.clone()).or_default().insert(layout);
            }
            for (_, constant) in module.constants.iter() {
                let Some(name) = &constant.name else { continue };
                let naga::Expression::Literal(literal) = module.global_expressions[constant.init] else { continue };
                let value = match literal {
                    naga::Literal::U32(value) => f64::from(value),
                    naga::Literal::I32(value) => f64::from(value),
                    naga::Literal::F32(value) => f64::from(value),
                    _ => continue,
                };
                said.constants.entry(name.clone()).or_default().insert(value.to_string());
            }
            for (_, variable) in module.global_variables.iter().filter(|(_, variable)| variable.binding.is_some()) {
                let held = match module.types[variable.ty].inner {
                    TypeInner::Array { base, stride, .. } => {
                        let slot = (pass.name.to_owned(), variable.name.clone().unwrap());
                        said.elements.insert(slot, stride as usize);
                        base
                    }
                    _ => variable.ty,
                };
                if let (Some(name), TypeInner::Struct { members, .. }) =
                    (&module.types[held].name, &module.types[held].inner)
                {
                    said.bound.insert(name.clone());
                    for member in members {
                        if let TypeInner::Array { base, .. } = module.types[member.ty].inner {
                            said.bound.extend(module.types[base].name.clone());
                        }
                    }
                }
            }
        }
        said
    }

    /// The fields of a struct with the shaders' names: some are joined in one vec4 there, whose name consists of both.
    fn joined(fields: &[Member], names: &[String]) -> Vec<(String, usize, usize)> {
        let mut fields = fields.iter().peekable();
        let mut joined: Vec<(String, usize, usize)> = Vec::new();
        for name in names {
            let Some(first) = fields.next() else { break };
            let mut whole = (first.name.clone(), first.offset, first.bytes);
            while whole.0 != *name && name.starts_with(&format!("{}_", whole.0)) {
                let Some(next) = fields.next() else { break };
                whole = (format!("{}_{}", whole.0, next.name), whole.1, whole.2 + next.bytes);
            }
            joined.push(whole);
        }
        joined.extend(fields.map(|field| (field.name.clone(), field.offset, field.bytes)));
        joined
    }

    #[test]
    fn structs_have_the_fields_offsets_and_bytes_that_the_shaders_have() {
        let said = said();
        for Struct { name, bytes, fields } in structs() {
            let layouts = said.structs.get(name).unwrap_or_else(|| panic!("no shader has a struct {name}"));
            assert_eq!(layouts.len(), 1, "shaders have several structs {name}");
            let (said_bytes, mut members) = layouts.first().unwrap().clone();
            // The struct after a header in the same buffer is compared on its own.
            let is_header = members.last().is_some_and(|(_, _, bytes, _)| *bytes == 0);
            if is_header {
                assert_eq!(members.pop().unwrap().1, bytes, "{name}");
            } else {
                assert_eq!(said_bytes, bytes, "{name}");
            }
            let names: Vec<String> = members.iter().map(|(name, ..)| name.clone()).collect();
            let of_shader: Vec<_> = members.iter().map(|(name, at, bytes, _)| (name.clone(), *at, *bytes)).collect();
            assert_eq!(joined(&fields, &names), of_shader, "{name}");
            for (member, _, _, kind) in &members {
                let own = fields.iter().find(|field| field.name == *member);
                assert!(own.is_none_or(|field| field.kind == *kind), "{name}.{member} is {kind} in the shader");
            }
        }
    }

    #[test]
    fn bytes_of_what_only_shaders_look_into_are_theirs() {
        let said = said();
        for (name, bytes) in SIZES {
            let layouts = said.structs.get(*name).unwrap_or_else(|| panic!("no shader has a struct {name}"));
            let sizes: BTreeSet<u64> = layouts.iter().map(|(bytes, _)| *bytes as u64).collect();
            assert_eq!(sizes, BTreeSet::from([*bytes]), "{name}");
        }
        for (pass, slot, bytes) in ELEMENTS {
            let stride = said.elements.get(&((*pass).to_owned(), (*slot).to_owned()));
            assert_eq!(stride, Some(&(*bytes as usize)), "{pass}.{slot}");
        }
    }

    #[test]
    fn every_struct_in_a_buffer_is_in_the_table() {
        let mut known: BTreeSet<&str> = SIZES.iter().map(|(name, _)| *name).collect();
        let structs = structs();
        known.extend(structs.iter().map(|layout| layout.name));
        // The parameters are compared word by word in the tests of the shaders.
        known.insert("Settings");
        let said = said();
        let unknown: Vec<&String> = said.bound.iter().filter(|name| !known.contains(name.as_str())).collect();
        assert!(unknown.is_empty(), "{unknown:?}");
        assert!(said.bound.len() > 15, "{:?}", said.bound);
    }

    #[test]
    fn constants_have_the_values_that_the_shaders_have() {
        let said = said();
        for (name, value) in CONSTANTS {
            let values = said.constants.get(*name).unwrap_or_else(|| panic!("no shader has a constant {name}"));
            assert_eq!(*values, BTreeSet::from([value.to_string()]), "{name}");
        }
    }

    /// Passes that fill regions by atomics use constants for the words of a region.
    #[test]
    fn words_of_a_region_are_where_its_fields_are() {
        let said = said();
        let (bytes, members) = said.structs["Region"].first().unwrap();
        assert_eq!(said.constants["REGION_WORDS"], BTreeSet::from([(bytes / 4).to_string()]));
        let word = |field: &str| members.iter().find(|(name, ..)| name == field).unwrap().1 / 4;
        for (constant, field) in [
            ("REGION_FIRST", "first_x"),
            ("REGION_LAST", "last_x"),
            ("REGION_PIXELS", "pixels"),
            ("REGION_ACCUMULATED", "accumulated"),
            ("REGION_POINT_LOW", "point_low"),
            ("REGION_POINT_HIGH", "point_high"),
            ("REGION_DIRECTION_LOW", "direction_low"),
            ("REGION_DIRECTION_HIGH", "direction_high"),
        ] {
            assert_eq!(said.constants[constant], BTreeSet::from([word(field).to_string()]), "{constant}");
        }
    }

    /// A struct that fills buffers belongs in the table above, where it is compared.
    #[test]
    fn no_other_file_lays_out_structs_for_the_shaders() {
        let sources = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let mut folders = vec![sources];
        let mut found = Vec::new();
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else if std::fs::read_to_string(&path).unwrap().contains("#[repr(C)]") {
                    found.push(path.file_name().unwrap().to_owned());
                }
            }
        }
        assert_eq!(found, ["layout.rs"]);
    }
}
