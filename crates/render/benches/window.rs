//! The way of a picture to the window: from the end of a frame on the renderer's device to a texture of the window's
//! device. `cargo bench -p render --bench window`. GLINT_BENCH_GPU chooses the adapter.
//!
//! "Rows" is what the program does: the frame's own commands copy the picture into a buffer that stays, and the window's
//! texture is written straight from it. "Bytes" is what it did before: a new buffer for each picture, a copy of it, and
//! another one byte by byte without the padding of its rows. Last come whole frames of an empty scene, one after the
//! other, each with its way to the window: "in turn", and "beside", as the program does, where another thread writes a
//! picture while the next frame is drawn.

use std::sync::mpsc::sync_channel;
use std::time::Instant;

use glam::DVec3;
use render::{Frame, Gpu, Objects, PictureRows, PointStore, Renderer};
use scene::{Camera, Method, Settings};

const ROUNDS: usize = 9;
const FRAMES: u32 = 8;
const SIZES: [[u32; 2]; 3] = [[1280, 720], [1920, 1080], [3840, 2160]];

fn main() {
    if std::env::args().any(|word| word == "--test") {
        return;
    }
    let wanted = std::env::var("GLINT_BENCH_GPU").ok();
    let [gpu, window] = [0, 1].map(|_| Gpu::headless(wanted.as_deref()).expect("an adapter"));
    println!("{} ({}), milliseconds, least and median of {ROUNDS}", gpu.info.name, gpu.clock.name());
    let store = PointStore::new(gpu.clone());
    let mut renderer = Renderer::new(gpu.clone()).expect("a renderer");
    let mut settings = Settings::default();
    settings.reflection.method = Method::None;
    let camera = Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z);
    for size in SIZES {
        let [width, height] = size;
        renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), size)).expect("a frame");
        let texture = window.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let write = |bytes: &[u8], stride: u32| {
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: Some(height) };
            window.queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
            window.queue.submit([]);
            window.wait().expect("the window's device");
        };
        let kept = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(width) * u64::from(height) * 4,
            usage: wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let picture = renderer.picture().expect("a picture");
        // Of the frame's own commands.
        let copied = timed(|| {
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 4), rows_per_image: None };
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let into = wgpu::TexelCopyBufferInfo { buffer: &kept, layout };
            encoder.copy_texture_to_buffer(picture.as_image_copy(), into, picture.size());
            gpu.queue.submit([encoder.finish()]);
            gpu.wait().expect("the renderer's device");
        });
        let rows = timed(|| {
            let rows = renderer.picture_rows().expect("rows");
            write(rows.bytes(), rows.stride);
        });
        let bytes = timed(|| {
            let bytes = gpu.read_texture(picture).expect("bytes");
            let tight: Vec<u8> = bytes.chunks_exact(width as usize * 4).flat_map(|row| row.iter().copied()).collect();
            write(&tight, width * 4);
        });
        println!("{width} x {height}: rows {} with the copy {}; bytes {}", shown(&rows), shown(&copied), shown(&bytes));
        let mut draw = || {
            renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), size)).expect("a frame");
            renderer.picture_rows().expect("rows")
        };
        let in_turn = timed(|| {
            for _ in 0..FRAMES {
                let rows = draw();
                write(rows.bytes(), rows.stride);
            }
        });
        let beside = timed(|| {
            std::thread::scope(|scope| {
                let (sender, pictures) = sync_channel::<PictureRows>(0);
                scope.spawn(|| pictures.into_iter().for_each(|rows| write(rows.bytes(), rows.stride)));
                (0..FRAMES).for_each(|_| sender.send(draw()).expect("the other thread"));
                drop(sender);
            });
        });
        let each = |times: &[f64]| shown(&times.iter().map(|time| time / f64::from(FRAMES)).collect::<Vec<_>>());
        println!("{width} x {height}: a frame in turn {}; beside {}", each(&in_turn), each(&beside));
    }
}

/// The milliseconds of each of some rounds, in order.
fn timed(mut work: impl FnMut()) -> Vec<f64> {
    work();
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1000.0
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times
}

fn shown(times: &[f64]) -> String {
    format!("{:.1}, {:.1}", times[0], times[times.len() / 2])
}
