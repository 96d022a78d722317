//! Splatting compared with its limit: the bare 64-bit atomic splat of 16-byte points (clear, one atomic maximum a
//! point, resolve), with the same points, camera and picture, alternately on one adapter. `cargo bench -p render`.
//!
//! GLINT_BENCH_POINTS sets the number of points (10 million), GLINT_BENCH_GPU the adapter.

use std::sync::Arc;
use std::time::Instant;

use cloud::{CHUNK_POINTS, Chunk, pack_normal, pack_radius};
use glam::{DVec3, Vec3};
use render::{Clock, Frame, Gpu, Material, Objects, PassTime, PointStore, Renderer};
use scene::{Camera, Settings};

const SIZE: [u32; 2] = [1280, 720];
const ROUNDS: usize = 9;

/// The paper's loop and nothing else: no chunks, radii, classes, normals, attributes or culling.
const BARE: &str = "
struct Camera { x: vec4f, y: vec4f, z: vec4f, focal: f32, width: u32, height: u32, count: u32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> points: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> nearest: array<atomic<u64>>;
@group(0) @binding(3) var picture: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(128)
fn splat(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * 128u;
    if index >= camera.count { return; }
    let point = points[index];
    let world = vec4f(bitcast<vec3f>(point.xyz), 1.0);
    let view = vec3f(dot(camera.x, world), dot(camera.y, world), dot(camera.z, world));
    if view.z <= 0.0 { return; }
    let pixel = vec2i(floor(vec2f(f32(camera.width), f32(camera.height)) * 0.5 + vec2f(view.x, -view.y) * camera.focal / view.z));
    if pixel.x < 0 || pixel.y < 0 || pixel.x >= i32(camera.width) || pixel.y >= i32(camera.height) { return; }
    let key = (u64(0xffffffffu - bitcast<u32>(view.z)) << 32u) | u64(point.w);
    let place = u32(pixel.y) * camera.width + u32(pixel.x);
    if atomicLoad(&nearest[place]) < key { atomicMax(&nearest[place], key); }
}

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= camera.width || id.y >= camera.height { return; }
    let key = atomicLoad(&nearest[id.y * camera.width + id.x]);
    textureStore(picture, id.xy, unpack4x8unorm(u32(key & 0xfffffffflu)));
}
";

struct Bare {
    gpu: Arc<Gpu>,
    splat: wgpu::ComputePipeline,
    resolve: wgpu::ComputePipeline,
    /// One for each buffer of points.
    bindings: Vec<(wgpu::BindGroup, u32)>,
    nearest: wgpu::Buffer,
}

/// The number of points in a buffer: half of the smallest binding limit met.
const BUFFER_POINTS: usize = 1 << 22;

impl Bare {
    fn new(gpu: &Arc<Gpu>, positions: &[Vec3], camera: &Camera) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(BARE.into()),
        });
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        };
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let storage = |read_only| buffer(wgpu::BufferBindingType::Storage { read_only });
        let picture = wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: wgpu::TextureFormat::Rgba8Unorm,
            view_dimension: wgpu::TextureViewDimension::D2,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[
                entry(0, buffer(wgpu::BufferBindingType::Uniform)),
                entry(1, storage(true)),
                entry(2, storage(false)),
                entry(3, picture),
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        let pipeline = |entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: None,
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let make = |size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let nearest = make(u64::from(SIZE[0] * SIZE[1]) * 8, wgpu::BufferUsages::STORAGE);
        let picture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let rows = camera.view_from_world();
        let focal = f64::from(SIZE[1]) * 0.5 / 30_f64.to_radians().tan();
        let bind = |part: &[Vec3]| {
            let points: Vec<[u32; 4]> =
                part.iter().enumerate().map(|(i, p)| [p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), i as u32]).collect();
            let point_buffer = make(points.len() as u64 * 16, wgpu::BufferUsages::STORAGE);
            gpu.queue.write_buffer(&point_buffer, 0, bytemuck::cast_slice(&points));
            let mut words: Vec<u32> = Vec::new();
            for row in 0..3 {
                let axis = rows.row(row);
                words.extend(axis.as_vec3().extend(-axis.dot(camera.eye) as f32).to_array().map(f32::to_bits));
            }
            words.extend([(focal as f32).to_bits(), SIZE[0], SIZE[1], part.len() as u32]);
            let uniform = make(64, wgpu::BufferUsages::UNIFORM);
            gpu.queue.write_buffer(&uniform, 0, bytemuck::cast_slice(&words));
            let view = picture.create_view(&Default::default());
            let resources = [
                uniform.as_entire_binding(),
                point_buffer.as_entire_binding(),
                nearest.as_entire_binding(),
                wgpu::BindingResource::TextureView(&view),
            ];
            let entries: Vec<_> = resources
                .into_iter()
                .enumerate()
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding: binding as u32, resource })
                .collect();
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &layout,
                entries: &entries,
            });
            gpu.queue.submit([]);
            (group, part.len() as u32)
        };
        let bindings = positions.chunks(BUFFER_POINTS).map(bind).collect();
        Self { gpu: gpu.clone(), splat: pipeline("splat"), resolve: pipeline("resolve"), bindings, nearest }
    }

    /// Clear, splat and resolve: milliseconds by the host's clock around one submit.
    fn run(&self) -> f64 {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.nearest, 0, None);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.splat);
        for (group, count) in &self.bindings {
            let groups = count.div_ceil(128);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(groups.min(32_768), groups.div_ceil(32_768), 1);
        }
        pass.set_pipeline(&self.resolve);
        pass.dispatch_workgroups(SIZE[0] / 8, SIZE[1] / 8, 1);
        drop(pass);
        let start = Instant::now();
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait().expect("the device lives");
        start.elapsed().as_secs_f64() * 1000.0
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    let count =
        std::env::var("GLINT_BENCH_POINTS").ok().and_then(|count| count.parse().ok()).unwrap_or(10_000_000_usize);
    let wanted = std::env::var("GLINT_BENCH_GPU").ok();
    let gpu = match Gpu::headless(wanted.as_deref()) {
        Ok(gpu) => gpu,
        Err(error) => return println!("skipped: {error}"),
    };
    // The points of the figures in docs/performance.md: uniform in a cube, in random order.
    let unit = |i: u64| (cloud::hash(i) >> 40) as f32 / (1 << 24) as f32;
    let positions: Vec<Vec3> =
        (0..count as u64).map(|i| Vec3::new(unit(i * 3), unit(i * 3 + 1), unit(i * 3 + 2)) - 0.5).collect();
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.5, -1.0, 0.4), 1.6, DVec3::Z);
    let bare = Bare::new(&gpu, &positions, &camera);

    let mut store = PointStore::new(gpu.clone());
    store.reserve(count as u64);
    let cloud = store.add_cloud(Material::default());
    for part in positions.chunks(CHUNK_POINTS) {
        let mut chunk = Chunk::new(0, DVec3::ZERO, part.iter().map(|p| p.to_array()).collect());
        chunk.colors = Some(Arc::new(vec![[200, 150, 100, 255]; part.len()]));
        chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::Z); part.len()]));
        chunk.radii = Some(Arc::new(vec![pack_radius(1e-4); part.len()]));
        store.add_chunk(cloud, &chunk, None).expect("room for the points");
    }
    let mut renderer = Renderer::new(gpu.clone()).expect("every pass compiles");
    let settings = |pairs: &[(&str, &str)]| {
        let mut settings = Settings::default();
        pairs.iter().for_each(|(key, value)| settings.set_text(key, value).expect("known keys"));
        settings
    };
    let cases = [
        ("nearest, a pixel a point", settings(&[("splat.quality", "nearest"), ("splat.max_pixels", "1")])),
        (
            "nearest, 32-bit atomics",
            settings(&[("splat.quality", "nearest"), ("splat.max_pixels", "1"), ("splat.atomics", "32")]),
        ),
        ("high, a pixel a point", settings(&[("splat.quality", "high"), ("splat.max_pixels", "1")])),
        (
            "high, splats of 3 pixels",
            settings(&[("splat.quality", "high"), ("splat.min_pixels", "3"), ("splat.max_pixels", "3")]),
        ),
    ];
    println!(
        "{} points, {}x{}, {} ({}), pass times by {} clock",
        count,
        SIZE[0],
        SIZE[1],
        gpu.info.name,
        gpu.info.backend,
        gpu.clock.name()
    );
    let is_splatting = |pass: &PassTime| pass.name.starts_with("splat_") || pass.name == "clear";
    let mut passes: Vec<Vec<(&str, Vec<f64>)>> = vec![Vec::new(); cases.len()];
    let mut bare_times = Vec::new();
    let mut times: Vec<Vec<f64>> = vec![Vec::new(); cases.len()];
    let mut frames: Vec<Vec<f64>> = vec![Vec::new(); cases.len()];
    for round in 0..=ROUNDS {
        let bare_time = bare.run();
        let runs: Vec<(f64, f64)> = cases
            .iter()
            .zip(&mut passes)
            .map(|((_, settings), passes)| {
                renderer.forget();
                let start = Instant::now();
                let stats =
                    renderer.render(&store, &Frame::new(&camera, settings, Objects::default(), SIZE)).expect("a frame");
                let wall = start.elapsed().as_secs_f64() * 1000.0;
                for pass in stats.passes.iter().filter(|_| round > 0) {
                    match passes.iter_mut().find(|(name, _)| *name == pass.name) {
                        Some((_, times)) => times.push(pass.milliseconds),
                        None => passes.push((pass.name, vec![pass.milliseconds])),
                    }
                }
                let splat: f64 =
                    stats.passes.iter().filter(|pass| is_splatting(pass)).map(|pass| pass.milliseconds).sum();
                // With GPU timestamps the clear is not a pass: then it is the frame's time less that of the passes
                // after splatting.
                let after: f64 =
                    stats.passes.iter().filter(|pass| !is_splatting(pass)).map(|pass| pass.milliseconds).sum();
                (if gpu.clock == Clock::Gpu { stats.frame_milliseconds - after } else { splat }, wall)
            })
            .collect();
        // The first round compiles.
        if round > 0 {
            bare_times.push(bare_time);
            for (case, (splat, wall)) in runs.into_iter().enumerate() {
                times[case].push(splat);
                frames[case].push(wall);
            }
        }
    }
    let bare_time = median(bare_times);
    println!("{:<28} {:>9.1} ms   1.00   (host clock)", "bare atomic splat", bare_time);
    for (case, (name, _)) in cases.iter().enumerate() {
        let splat = median(times[case].clone());
        println!(
            "{name:<28} {splat:>9.1} ms {:>6.2}   whole frame {:.1} ms",
            splat / bare_time,
            median(frames[case].clone())
        );
        let each = passes[case].iter().map(|(name, times)| format!("{name} {:.1}", median(times.clone())));
        println!("    {}", each.collect::<Vec<_>>().join(", "));
    }
}
