//! The table of passes, a row each in `passes!`. The name of a pass is also that of the shader's file, of its entry
//! point, of its pipeline, and of the type by which the pass is called; its slots are the shader's bindings, by name,
//! in order.

use std::borrow::Cow;
use std::sync::PoisonError;

use param::choices;
use scene::Settings;
use wgpu::TextureFormat::{R32Float, Rgba8Unorm, Rgba16Float, Rgba32Float};

use crate::gpu::{Code, Gpu};
use crate::loads;

choices! {
    /// What of a frame a pass works for: the surface that the camera sees, what the reflection method finds, light and shading, or
    /// what is shown of it all.
    pub enum PassStage { Surface = "surface", Method = "method", Light = "light", View = "view" }
}

/// The kind of a binding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slot {
    Uniform,
    /// A storage buffer that is only read.
    Read,
    ReadWrite,
    /// A float texture, loaded without a sampler.
    Texture,
    /// A storage texture.
    Write(wgpu::TextureFormat),
}

use Slot::{Read, ReadWrite, Texture, Uniform, Write};

/// The bindings of a group, by name.
pub type Slots = &'static [(&'static str, Slot)];

/// A row of the table.
#[derive(Debug)]
pub struct Pass {
    pub name: &'static str,
    pub stage: PassStage,
    /// The slots of a page of the store, if the pass reads points.
    pub page: Option<Slots>,
    /// Whether the pass goes through the points of the pages, so that its time grows with their number.
    pub is_over_points: bool,
    /// The pass's own slots.
    pub slots: Slots,
    /// How much more a thread of the pass may do by some settings than by those that docs/gpu.md computes its time
    /// with.
    pub load: fn(&Settings) -> f64,
    /// The source of the shader, without its imports.
    pub source: &'static str,
}

impl Pass {
    /// The slots of each group: camera and parameters; a page of the store, if the pass reads points; the pass's own.
    pub fn groups(&self) -> impl Iterator<Item = Slots> {
        [Some(FRAME), self.page, Some(self.slots)].into_iter().flatten()
    }

    /// Whether a workgroup of the pass can share large discs (large_discs.wgsl).
    pub fn has_large_discs(&self) -> bool {
        self.source.contains("splat_discs(")
    }
}

/// The bindings of a pass's own slots: a type for each pass, with a field for each slot.
pub trait Bindings<'r>: Clone {
    const PASS: &'static Pass;
    /// What the pass runs over: `Pixels`, `Blocks` or `Pages`.
    type Over;

    /// The resources in slot order.
    fn resources(self) -> Vec<wgpu::BindingResource<'r>>;
}

/// What a pass runs over.
pub trait Over {
    /// The slots of group 1, if the pass reads points.
    const PAGE: Option<Slots>;
    const IS_OVER_POINTS: bool = false;
}

/// The pass runs over anything but points, mostly over pixels.
pub enum Pixels {}
/// The pass runs over the points of each page, block by block.
pub enum Blocks {}
/// The pass runs over anything but points, once for each page, and looks up the page's points.
pub enum Pages {}

impl Over for Pixels {
    const PAGE: Option<Slots> = None;
}
impl Over for Blocks {
    const PAGE: Option<Slots> = Some(PAGE);
    const IS_OVER_POINTS: bool = true;
}
impl Over for Pages {
    const PAGE: Option<Slots> = Some(PAGE);
}

/// Group 0, declared in shaders/shared/frame_group.wgsl.
const FRAME: Slots = &[("frame", Uniform), ("settings", Uniform)];

/// Group 1 of passes that read points, declared in shaders/shared/page_group.wgsl.
const PAGE: Slots = &[("page", Uniform), ("points", Read), ("attributes", Read), ("tables", Read)];

/// The load of a row: the function that the row names, or one for passes that do about the same by all settings.
macro_rules! load {
    () => {
        |_| 1.0
    };
    ($load:path) => {
        $load
    };
}

/// Declares the passes: `name: PassStage over What { slot: kind, ... }`, with `load function` after `What` where a
/// thread does more by some settings. Generates a type for each, the list of all, and their shaders.
macro_rules! passes {
    ($($name:ident: $stage:ident over $over:ident $(load $load:path)? { $($slot:ident: $kind:expr),* $(,)? })*) => {
        $(
            #[allow(non_camel_case_types, reason = "the name of a pass is that of its shader")]
            #[derive(Clone)]
            pub struct $name<'r> { $(pub $slot: wgpu::BindingResource<'r>),* }

            impl<'r> Bindings<'r> for $name<'r> {
                const PASS: &'static Pass = &Pass {
                    name: stringify!($name),
                    stage: PassStage::$stage,
                    page: <$over as Over>::PAGE,
                    is_over_points: <$over as Over>::IS_OVER_POINTS,
                    slots: &[$((stringify!($slot), $kind)),*],
                    load: load!($($load)?),
                    source: include_str!(concat!("../../../shaders/", stringify!($name), ".wgsl")),
                };
                type Over = $over;

                fn resources(self) -> Vec<wgpu::BindingResource<'r>> {
                    vec![$(self.$slot),*]
                }
            }
        )*

        /// Every pass.
        #[cfg(test)]
        pub const ALL: &[&Pass] = &[$(<$name<'static> as Bindings<'static>>::PASS),*];
    };
}

passes! {
    splat_nearest: Surface over Blocks load loads::discs { nearest: ReadWrite }
    splat_nearest_blind: Surface over Blocks load loads::discs { nearest: ReadWrite }
    splat_narrow: Surface over Blocks load loads::discs { nearest: ReadWrite, run: Uniform }
    splat_accumulate: Surface over Blocks load loads::discs {
        nearest: Read, color_sums: ReadWrite, surface_sums: ReadWrite, specular_sums: ReadWrite, carries: ReadWrite,
    }
    splat_accumulate_pairs: Surface over Blocks load loads::discs {
        nearest: Read, color_sums: ReadWrite, surface_sums: ReadWrite, specular_sums: ReadWrite, carries: ReadWrite,
    }
    splat_average: Surface over Pixels {
        nearest: Read, color_sums: Read, surface_sums: Read, specular_sums: Read, carries: Read,
        albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), depth_out: Write(R32Float),
    }
    splat_resolve: Surface over Pages {
        nearest: Read, albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), depth_out: Write(R32Float),
    }
    splat_radii: Surface over Pages { nearest: Read, radius_out: Write(R32Float) }
    close_gaps: Surface over Pixels {
        albedo_in: Texture, normal_in: Texture, depth_in: Texture, albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), depth_out: Write(R32Float),
    }
    close_holes: Surface over Pixels {
        albedo_in: Texture, normal_in: Texture, depth_in: Texture, radius_in: Texture, albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), depth_out: Write(R32Float),
    }
    mirror_exact: Surface over Pixels {
        depth_in: Texture, mirrors: Read, albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float),
        depth_out: Write(R32Float),
    }
    mirror_exact_seen: Method over Pixels {
        point_in: Texture, mirror_normal_in: Texture, eye_in: Texture, mirrors: Read, albedo_in: Texture,
        normal_in: Texture, position_in: Texture, albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float),
        position_out: Write(Rgba32Float),
    }
    clear_points: Surface over Pages { nearest: Read, index_out: Write(R32Float) }
    camera_position: Surface over Pixels { depth_in: Texture, position_out: Write(Rgba32Float) }
    mirror_surface: Method over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, point_out: Write(Rgba32Float),
        eye_out: Write(Rgba32Float), weight_in: Texture,
    }
    mirror_methods: Method over Pixels {
        position_in: Texture, nearest: Read, runs: Read, mirrors: Read, method_out: Write(R32Float),
    }
    mirror_share: Method over Pixels { point_in: Texture, method_in: Texture, point_out: Write(Rgba32Float) }
    mirror_weight: Method over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, weight_in: Texture,
        left_in: Texture, reflectance_in: Texture, weight_out: Write(R32Float),
    }
    mirror_move: Method over Pixels {
        point_in: Texture, normal_in: Texture, mirrors: Read, point_out: Write(Rgba32Float),
        eye_out: Write(Rgba32Float), normal_out: Write(Rgba32Float),
    }
    gloss_trust: Method over Pixels { point_in: Texture, normal_in: Texture, eye_in: Texture, pixels: ReadWrite }
    gloss_normals: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, kept: Read, pixels: ReadWrite,
        normal_out: Write(Rgba32Float), rays_out: Write(Rgba32Float),
    }
    gloss_reflectance: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, drawn_in: Texture, reflectance_out: Write(R32Float),
    }
    gloss_keep: Method over Pixels { point_in: Texture, pixels: Read, kept: ReadWrite, hits: ReadWrite, counters: ReadWrite }
    gloss_sum: Light over Pixels {
        point_in: Texture, seen_in: Texture, reflected_in: Texture, pixels: Read, sums: ReadWrite, distances: ReadWrite,
        received_out: Write(Rgba16Float), looks_in: Texture, left_in: Texture, shares_left: ReadWrite,
        reflectance_in: Texture,
    }
    gloss_blur: Light over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, distances: Read, received_in: Texture,
        received_out: Write(Rgba16Float),
    }
    clear_surface: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, points_in: Texture, mirrors: Read,
        point_out: Write(Rgba32Float), eye_out: Write(Rgba32Float), normal_out: Write(Rgba32Float),
        index_out: Write(R32Float),
    }
    clear_inside: Method over Pixels {
        point_in: Texture, eye_in: Texture, albedo_in: Texture, normal_in: Texture, position_in: Texture,
        albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
        from_out: Write(Rgba32Float),
    }
    clear_hits: Method over Pages { hits: Read, index_out: Write(R32Float) }
    clear_depth: Method over Pixels {
        point_in: Texture, direction_in: Texture, index_in: Texture, own_albedo_in: Texture, own_normal_in: Texture,
        albedo_in: Texture, normal_in: Texture, position_in: Texture, albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float), from_out: Write(Rgba32Float),
    }
    mirror_reach: Method over Pixels {
        point_in: Texture, seen_in: Texture, index_in: Texture, mirrors: Read, reach_out: Write(R32Float),
    }
    mirror_doubt: View over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, seen_in: Texture, seen_normal_in: Texture,
        doubt_out: Write(R32Float), counters: ReadWrite, hits: Read,
    }
    beam_lists: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, tops: Read, nodes: Read, lists: ReadWrite,
    }
    surfel_trace: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, tops: Read, nodes: Read, surfels: Read, order: Read,
        lists: Read, hits: ReadWrite, shown: Read, views_out: Write(Rgba32Float), counters: ReadWrite,
    }
    gather_resolve: Method over Pages {
        point_in: Texture, normal_in: Texture, eye_in: Texture, hits: Read, albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
    }
    environment_look_up: Method over Pages {
        point_in: Texture, normal_in: Texture, eye_in: Texture, maps: Read, mirrors: Read, hits: Read,
        albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
        views_out: Write(Rgba32Float),
    }
    cube_planes: Method over Pages { nearest: Read, records: ReadWrite }
    cube_renumber: Method over Pixels { runs: Read, records: ReadWrite }
    cube_bounds: Method over Pixels { cubes: Read, records: Read, bounds: ReadWrite, work: Read }
    cubemap_trace: Method over Pixels load loads::maps {
        point_in: Texture, normal_in: Texture, eye_in: Texture, mirrors: Read, cubes: Read, records: Read, bounds: Read,
        hits: ReadWrite, rest: ReadWrite, views_out: Write(Rgba32Float), counters: ReadWrite, listed: Read,
    }
    light_field_need: Method over Pixels {
        point_in: Texture, mirrors: Read, fields: Read, index: Read, samples: Read, needs: ReadWrite,
    }
    light_field_predict: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, mirrors: Read, fields: Read, index: Read, samples: Read,
        records: Read, predicted: ReadWrite,
    }
    light_field_trace: Method over Pixels {
        tops: Read, nodes: Read, surfels: Read, order: Read, shown: Read, nearest_points: ReadWrite,
    }
    light_field_ask: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, mirrors: Read, fields: Read, index: Read, samples: Read,
        records: Read, listed: ReadWrite, asked: ReadWrite, counters: ReadWrite,
    }
    light_field_asked_trace: Method over Pixels {
        tops: Read, nodes: Read, surfels: Read, order: Read, shown: Read, maps: Read, asked: Read, found: ReadWrite,
    }
    light_field_asked_planes: Method over Pages { maps: Read, asked: Read, found: Read, records: ReadWrite }
    light_field_look_up: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, mirrors: Read, fields: Read, index: Read, samples: Read,
        records: Read, hits: ReadWrite, rest: ReadWrite, views_out: Write(Rgba32Float), counters: ReadWrite,
    }
    screen_planes: Method over Pixels {
        normal_in: Texture, position_in: Texture, records: ReadWrite, albedo_in: Texture,
    }
    splat_behind: Method over Blocks load loads::discs { records: Read, nearest: ReadWrite, run: Uniform }
    screen_bounds: Method over Pixels { screen: Read, records: Read, bounds: ReadWrite }
    screen_trace: Method over Pixels load loads::layers {
        point_in: Texture, normal_in: Texture, eye_in: Texture, screen: Read, records: Read, bounds: Read,
        hits: ReadWrite, rest: ReadWrite, views_out: Write(Rgba32Float), counters: ReadWrite, walls: Read,
    }
    screen_box_pixels: Method over Pixels {
        normal_in: Texture, position_in: Texture, screen: Read, texels: ReadWrite,
    }
    screen_box_edges: Method over Pixels {
        screen: Read, picture_albedo_in: Texture, texels: Read, edges: ReadWrite, periods: ReadWrite,
    }
    screen_box_scores: Method over Pixels load loads::walls { screen: Read, edges: Read, scores: ReadWrite }
    screen_box_periods: Method over Pixels { screen: Read, scores: Read, periods: ReadWrite }
    screen_box_fill: Method over Pixels load loads::texels_of_walls { screen: Read, texels: ReadWrite, periods: Read }
    screen_resolve: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, hits: Read, picture_albedo_in: Texture,
        picture_normal_in: Texture, albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float),
        position_out: Write(Rgba32Float),
    }
    mirrored_look_up: Method over Pages {
        point_in: Texture, maps: Read, mirrors: Read, albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float),
        position_out: Write(Rgba32Float), views_out: Write(Rgba32Float),
    }
    normal_filter: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, normal_out: Write(Rgba32Float),
    }
    curvature: Method over Pixels { point_in: Texture, normal_in: Texture, eye_in: Texture, curvature_map: ReadWrite }
    curvature_smooth: Method over Pixels { curvature_map: ReadWrite }
    label_start: Method over Pixels { curvature_map: Read, parents: ReadWrite, sizes: ReadWrite }
    label_join: Method over Pixels { parents: ReadWrite }
    label_flatten: Method over Pixels { parents: ReadWrite, sizes: ReadWrite }
    region_count: Method over Pixels { parents: Read, sizes: Read, runs: ReadWrite }
    region_scan: Method over Pixels { runs: ReadWrite, regions: ReadWrite, counters: ReadWrite }
    region_number: Method over Pixels { parents: Read, sizes: ReadWrite, runs: Read, regions: ReadWrite }
    region_assign: Method over Pixels {
        point_in: Texture, normal_in: Texture, eye_in: Texture, parents: Read, sizes: Read, regions: ReadWrite,
        mirror_pixels: ReadWrite,
    }
    sscr_cull: Method over Pixels { regions: Read, spheres: Read, chunks_reached: ReadWrite }
    sscr_solve: Method over Blocks load loads::searches {
        round: Uniform, mirror_pixels: Read, regions: Read, solutions: ReadWrite, counters: ReadWrite,
        endings: ReadWrite,
    }
    sscr_views: Method over Pixels {
        curvature_map: Read, mirror_pixels: Read, endings: Read, parents: Read, views_out: Write(Rgba32Float),
    }
    bundle_fit: Method over Pixels {
        grid: Uniform, point_in: Texture, normal_in: Texture, eye_in: Texture, nodes: ReadWrite, bundles: ReadWrite,
        counters: ReadWrite, hits: ReadWrite, rest: ReadWrite, analytic: Read,
    }
    bundle_prune: Method over Pixels { grid: Uniform, nodes: ReadWrite }
    sample_cameras_project: Method over Blocks load loads::points_of_a_square {
        grid: Uniform, nodes: Read, bundles: Read, point_in: Texture, normal_in: Texture, eye_in: Texture,
        solutions: ReadWrite, counters: ReadWrite, analytic: Read,
    }
    sample_cameras_rays: Method over Pixels {
        trees: Uniform, point_in: Texture, normal_in: Texture, eye_in: Texture, rays: ReadWrite,
    }
    sample_cameras_mark: Method over Pixels {
        trees: Uniform, standing: Read, point_in: Texture, hits: ReadWrite, rest: ReadWrite, counters: ReadWrite,
    }
    sample_cameras_space: Method over Blocks load loads::cells {
        trees: Uniform, nodes: Read, leaves: Read, rays: Read, point_in: Texture, normal_in: Texture, eye_in: Texture,
        solutions: ReadWrite, counters: ReadWrite,
    }
    mirror_depth: Method over Blocks load loads::mirror_splats {
        solutions: Read, point_in: Texture, nearest: ReadWrite,
    }
    mirror_visibility: Method over Blocks load loads::mirror_splats {
        solutions: Read, point_in: Texture, albedo_sums: ReadWrite, normal_sums: ReadWrite, position_sums: ReadWrite,
        carries: ReadWrite, normal_in: Texture, eye_in: Texture,
    }
    mirror_average: Method over Pixels {
        point_in: Texture, nearest: Read, albedo_sums: Read, normal_sums: Read, position_sums: Read, carries: Read,
        albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
    }
    pull: Method over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, albedo_out: Write(Rgba16Float),
        normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
    }
    push: Method over Pixels {
        point_in: Texture, albedo_in: Texture, normal_in: Texture, position_in: Texture,
        albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
    }
    gather_close: Method over Pixels {
        point_in: Texture, albedo_in: Texture, normal_in: Texture, position_in: Texture,
        albedo_out: Write(Rgba16Float), normal_out: Write(Rgba32Float), position_out: Write(Rgba32Float),
    }
    vpl_points: Light over Pages { lights: Uniform, chosen: Read, surfaces: ReadWrite }
    vpl_aim: Light over Pixels { lights: Uniform, aims: Read, shadows: Read, hits: ReadWrite, counts: ReadWrite }
    vpl_place: Light over Pages {
        lights: Uniform, hits: Read, counts: Read, shadows: Read, emitters: Read, vpls: ReadWrite,
    }
    vpl_bounce: Light over Pixels {
        lights: Uniform, births: Read, shadow_maps: Read, surfaces: Read, chosen: Read, vpls: ReadWrite,
        work: Uniform,
    }
    vpl_shadow_splat: Light over Pixels {
        lights: Uniform, chosen: Read, surfaces: Read, vpls: Read, shadow_maps: ReadWrite, work: Uniform,
    }
    vpl_shadow_pull: Light over Pixels { lights: Uniform, shadow_maps: ReadWrite, work: Uniform }
    vpl_shadow_push: Light over Pixels { lights: Uniform, shadow_maps: ReadWrite, work: Uniform }
    vpl_balance: Light over Pixels {
        lights: Uniform, shadow_maps: Read, surfaces: Read, vpls: ReadWrite, work: Uniform,
    }
    indirect_reuse: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, before: Uniform, kept: Read, light_out: ReadWrite,
        tiles: ReadWrite,
    }
    indirect: Light over Pixels load loads::lights_of_a_pixel {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, lights: Uniform, vpls: Read,
        shadow_maps: Read, diffuse_out: Write(Rgba16Float), glossy_out: Write(Rgba16Float), tiles: Read, near_lights: Read,
        near_maps: Read,
    }
    indirect_filter: Light over Pixels load loads::neighbours {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, diffuse_in: Texture,
        glossy_in: Texture, radiance_out: Write(Rgba16Float), kept: ReadWrite, left_in: Texture, rays_in: Texture,
    }
    light_ray_draw: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, paths: ReadWrite,
        point_out: Write(Rgba32Float), eye_out: Write(Rgba32Float),
    }
    light_ray_sum: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, point_in: Texture, eye_in: Texture,
        direct_in: Texture, indirect_in: Texture, paths: ReadWrite, diffuse_out: Write(Rgba16Float),
        glossy_out: Write(Rgba16Float),
    }
    light_ray_reuse: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, before: Uniform, kept: Read, kept_light: Read,
        paths: ReadWrite,
    }
    light_ray_keep: Light over Pixels { position_in: Texture, paths: Read, kept: ReadWrite, kept_light: ReadWrite }
    photon_start: Light over Pixels {
        beams: Read, run: Uniform, powers: ReadWrite, point_out: Write(Rgba32Float), eye_out: Write(Rgba32Float),
    }
    photon_land: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, point_in: Texture, eye_in: Texture,
        powers: ReadWrite, landed: ReadWrite, point_out: Write(Rgba32Float), eye_out: Write(Rgba32Float),
    }
    vpl_photons: Light over Pixels { lights: Uniform, thrown: Read, vpls: ReadWrite }
    photon_light: Light over Pixels {
        position_in: Texture, normal_in: Texture, from_in: Texture, photons: Read, cells: Read,
        irradiance_out: Write(Rgba16Float),
    }
    shade: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, lights: Read, shadows: Read,
        radiance_out: Write(Rgba16Float), left_in: Texture, rays_in: Texture, thrown_in: Texture,
    }
    blend: Light over Pixels {
        albedo_in: Texture, normal_in: Texture, position_in: Texture, from_in: Texture, radiance_in: Texture,
        seen_in: Texture, reflected_in: Texture, indirect_in: Texture, color_out: Write(Rgba16Float),
        left_in: Texture, reflectance_in: Texture, rays_in: Texture,
    }
    clear_blend: Light over Pixels {
        seen_in: Texture, reflected_in: Texture, point_in: Texture, direction_in: Texture, beyond_in: Texture,
        transmitted_in: Texture, received_out: Write(Rgba16Float), left_in: Texture,
    }
    show: View over Pixels {
        color_in: Texture, point_in: Texture, albedo_in: Texture, normal_in: Texture, position_in: Texture,
        views_in: Texture, doubt_in: Texture, picture_out: Write(Rgba8Unorm),
    }
    show_error: View over Pixels {
        shown: Uniform, color_in: Texture, point_in: Texture, normal_in: Texture, eye_in: Texture,
        picture_out: Write(Rgba8Unorm),
    }
    show_light: View over Pixels {
        views: Uniform, image_in: Texture, depth_in: Texture, picture_out: Write(Rgba8Unorm),
    }
    show_light_buffer: View over Pixels {
        views: Uniform, lights: Read, shadows: Read, picture_out: Write(Rgba8Unorm),
    }
    show_virtual_lights: View over Pixels load loads::all_lights {
        views: Uniform, virtual_lights: Uniform, vpls: Read, lights: Read, shadows: Read, depth_in: Texture,
        picture_out: Write(Rgba8Unorm),
    }
    show_shadow_maps: View over Pixels {
        views: Uniform, virtual_lights: Uniform, vpls: Read, shadow_maps: Read, picture_out: Write(Rgba8Unorm),
    }
    exposure_histogram: View over Pixels { color_in: Texture, depth_in: Texture, histogram: ReadWrite }
    exposure_fit: View over Pixels { adaptation: Uniform, histogram: Read, fitted: ReadWrite }
    present: View over Pixels {
        color_in: Texture, depth_in: Texture, radius_in: Texture, normal_in: Texture, picture_out: Write(Rgba8Unorm),
    }
    probe_pixels: View over Pixels {
        pixels: Read, first_in: Texture, second_in: Texture, third_in: Texture, fourth_in: Texture, values: ReadWrite,
    }
}

/// A compiled pass, and what a renderer knows of its times.
pub struct Compiled {
    pass: &'static Pass,
    code: Code,
    /// How long a workgroup took in the last dispatch; `None` before the second one, because drivers compile at the first.
    pub group_milliseconds: Option<f64>,
    /// The load of the pass at which it took so long.
    load: f64,
    /// Whether the pass has run.
    pub has_run: bool,
}

impl Compiled {
    fn compile(gpu: &Gpu, pass: &'static Pass, switches: &[(&'static str, u32)]) -> Result<Code, String> {
        let device = &gpu.device;
        let woven = crate::shader::weave(pass)?;
        let (shader, constants) = woven.module(switches).map_err(|fault| format!("shader {}: {fault}", pass.name))?;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(pass.name),
            source: wgpu::ShaderSource::Naga(Cow::Owned(shader)),
        });
        let layouts: Vec<wgpu::BindGroupLayout> = pass
            .groups()
            .map(|slots| {
                let entries: Vec<wgpu::BindGroupLayoutEntry> = slots
                    .iter()
                    .enumerate()
                    .map(|(binding, (_, slot))| wgpu::BindGroupLayoutEntry {
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
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(pass.name),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(pass.name),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            cache: gpu.pipeline_cache(),
        });
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(format!("shader {}: {}", pass.name, woven.explain(&error.to_string())));
        }
        Ok(Code { pipeline, layouts })
    }

    /// Compiles a pass, unless the device has it already. `switches` are the values of the shader's `override` constants.
    ///
    /// # Errors
    /// The shader compiler's message, with file and line.
    pub fn new(gpu: &Gpu, pass: &'static Pass, switches: &[(&'static str, u32)]) -> Result<Self, String> {
        let key = (pass.name, switches.to_vec());
        let compiled = || gpu.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        let known = compiled().get(&key).cloned();
        let code = match known {
            Some(code) => code,
            None => {
                let code = Self::compile(gpu, pass, switches)?;
                compiled().insert(key, code.clone());
                code
            }
        };
        Ok(Self { pass, code, group_milliseconds: None, load: 1.0, has_run: false })
    }

    pub fn pipeline(&self) -> &wgpu::ComputePipeline {
        &self.code.pipeline
    }

    /// The most milliseconds that a workgroup is known to take by some settings; `None` if nobody has timed the pass. A
    /// larger load than that it was timed at may take longer in proportion; a smaller one may take as long.
    pub fn estimate(&self, settings: &Settings) -> Option<f64> {
        let load = (self.pass.load)(settings);
        self.group_milliseconds.map(|known| known * (load / self.load).max(1.0))
    }

    /// Notes how long a dispatch of so many workgroups took by some settings, if that counts.
    pub fn learn(&mut self, milliseconds: f64, groups: f64, settings: &Settings, counts: bool) {
        let load = (self.pass.load)(settings);
        let is_known = self.has_run && counts && groups > 0.0;
        // Parts of a picture differ. The slowest of the last ones counts, of those at the same load.
        let before = self.group_milliseconds.filter(|_| load == self.load).map_or(0.0, |known| 0.97 * known);
        self.group_milliseconds = is_known.then_some(before.max(milliseconds / groups));
        self.load = load;
        self.has_run = true;
    }

    /// Halves what is known.
    pub fn doubt(&mut self) {
        self.group_milliseconds = self.group_milliseconds.map(|known| known * 0.5);
    }

    /// Corrects what is known after the pass and others took `factor` times as long together as was estimated by the
    /// settings. As in `learn`, the slowest of the last times at the same load counts.
    pub fn correct(&mut self, factor: f64, settings: &Settings) {
        let load = (self.pass.load)(settings);
        let least = if load == self.load { 0.97 } else { 0.0 };
        self.group_milliseconds = self.estimate(settings).map(|known| known * factor.max(least));
        self.load = load;
    }

    /// Makes a bind group for group `group` of this pass from resources in slot order.
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
            label: Some(self.pass.name),
            layout: &self.code.layouts[group],
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
