// Group 1 of the passes that read points: a page of the point store. Filled by crates/render/src/inputs.rs. Binding 5
// tells to which items the points belong: `blocks` for passes that walk the points (blocks.wgsl), `items_of_runs` for
// passes that look points up (point_surface.wgsl).
#import frame_group
#import splat

@group(1) @binding(0) var<uniform> page: Page;
@group(1) @binding(1) var<storage, read> points: array<vec4u>;
@group(1) @binding(2) var<storage, read> attributes: array<vec2u>;
@group(1) @binding(3) var<storage, read> scalars: array<f32>;
@group(1) @binding(4) var<storage, read> items: array<Item>;
@group(1) @binding(6) var<storage, read> shown: array<u32>;
@group(1) @binding(7) var<storage, read> palette: array<u32>;
