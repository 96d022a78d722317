//! Opens a file of points and draws it, without a window:
//! `cargo run --release --example draw -- scan.laz picture.ppm`.

use std::path::Path;

use cloud::Progress;
use glam::DVec3;
use render::{ColorPlan, Frame, Gpu, Material, Objects, PointStore, Renderer};
use scene::{Camera, Settings, StandardView};

const SIZE: [u32; 2] = [1280, 720];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, picture] = arguments.as_slice() else { return Err("usage: draw FILE PICTURE.ppm".into()) };
    let mut settings = Settings::default();
    settings.set_text("light.by", "headlight")?;

    // The points, with normals and radii: a splat is a disc of that radius, at right angles to the normal.
    let source = codec::open(Path::new(file))?;
    let up = world::up_of(source.info(), &settings);
    let (mut cloud, summary) = world::read_cloud(&source, &[], &settings, &Progress::default())?;
    summary.warnings.iter().for_each(|warning| eprintln!("{warning}"));
    let options = world::options_for(&cloud.chunks, up, source.info().scanner(), &settings);
    let surfels = cloud::estimate(&cloud.chunks, &options, &Progress::default()).ok_or("cancelled")?;
    for (chunk, surfels) in cloud.chunks.iter_mut().zip(surfels) {
        chunk.normals.get_or_insert(surfels.normals.into());
        chunk.radii = Some(surfels.radii.into());
    }

    // The points on the GPU, with their colours.
    let gpu = Gpu::headless(None)?;
    let mut store = PointStore::new(gpu.clone());
    let id = store.add_cloud(Material::default());
    let mut chunks = Vec::new();
    for chunk in &cloud.chunks {
        chunks.push(store.add_chunk(id, chunk, None)?);
    }
    let (plan, _) = ColorPlan::new(&cloud, &settings.color, up);
    store.set_color(id, &cloud, &chunks, &plan, up)?;

    // One frame.
    let corners: [DVec3; 8] = cloud::robust_bounds(&cloud.chunks).corners();
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let camera = Camera::framing(&corners, StandardView::Isometric, up, settings.view.field_of_view, aspect);
    let mut renderer = Renderer::new(gpu)?;
    let stats = renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), SIZE))?;
    for pass in &stats.passes {
        println!("{:24} {:8.2} ms", pass.name, pass.milliseconds);
    }

    let mut bytes = format!("P6 {} {} 255\n", SIZE[0], SIZE[1]).into_bytes();
    bytes.extend(
        renderer.read_picture()?.as_chunks::<4>().0.iter().flat_map(|[red, green, blue, _]| [red, green, blue]),
    );
    std::fs::write(picture, bytes)?;
    println!("{picture}: {} of {} points", stats.points_drawn, source.info().points);
    Ok(())
}
