//! Reflection methods on the five mirrors: time of each pass, coverage, and what else a frame reports.
//!
//! `cargo bench --profile release -p render --bench reflections -- [MIRROR]... [KEY=VALUE]... [--method NAME]...
//! [--pictures FOLDER]`: without mirrors all five, without methods all of them, settings in turn in one run. `scene.points` is
//! heeded. Pictures are PPM files.

use std::io::Write as _;
use std::sync::Arc;

use param::Choice as _;
use render::{ColorPlan, Gpu, Material, Objects, PointStore, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Method, Settings};

const SIZE: [u32; 2] = [800, 600];
const ROUNDS: usize = 5;

fn main() {
    let mut settings = Settings::default();
    let (mut variants, mut methods, mut folder) = (Vec::new(), Vec::new(), None);
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        if let Some((key, value)) = argument.split_once('=') {
            settings.set_text(key, value).expect("a parameter");
        } else if argument == "--method" {
            let name = arguments.next().expect("a method");
            methods.push(all_methods().find(|method| method.name() == name).expect("a known method"));
        } else if argument == "--pictures" {
            folder = Some(arguments.next().expect("a folder"));
        } else {
            variants.push(Variant::ALL.into_iter().find(|variant| variant.name() == argument).expect("a known mirror"));
        }
    }
    if variants.is_empty() {
        variants = vec![Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral];
    }
    if methods.is_empty() {
        methods = all_methods().filter(|method| *method != Method::Auto).collect();
    }
    let gpu = Gpu::headless(None).expect("an adapter");
    let mut renderer = Renderer::new(gpu.clone()).expect("passes that compile");
    println!("{} ({}), pass times by {} clock", gpu.info.name, gpu.info.backend, gpu.clock.name());
    for variant in variants {
        let store = store(&gpu, variant, &settings);
        let mirrors = variant.mirrors();
        let lights = [five_mirrors::light()];
        let objects = Objects { mirrors: &mirrors, lights: &lights };
        let mut passes: Vec<Vec<(&str, Vec<f64>)>> = vec![Vec::new(); methods.len()];
        let mut frames: Vec<Vec<f64>> = vec![Vec::new(); methods.len()];
        for round in 0..=ROUNDS {
            for (case, method) in methods.iter().enumerate() {
                settings.reflection.method = *method;
                renderer.forget();
                let stats =
                    renderer.render(&store, &five_mirrors::camera(), &settings, objects, SIZE).expect("a frame");
                // The first round compiles.
                if round == 0 {
                    if let Some(folder) = &folder {
                        write(folder, variant, *method, &renderer.read_picture().expect("a picture"));
                    }
                    println!("{} {}: {:?}", variant.name(), method.name(), stats.reflection);
                    continue;
                }
                frames[case].push(stats.frame_milliseconds);
                for pass in &stats.passes {
                    match passes[case].iter_mut().find(|(name, _)| *name == pass.name) {
                        Some((_, times)) => times.push(pass.milliseconds),
                        None => passes[case].push((pass.name, vec![pass.milliseconds])),
                    }
                }
            }
        }
        for (case, method) in methods.iter().enumerate() {
            println!("{} {}: frame {:.1} ms", variant.name(), method.name(), median(&frames[case]));
            let each = passes[case].iter().map(|(name, times)| format!("{name} {:.1}", median(times)));
            println!("    {}", each.collect::<Vec<_>>().join(", "));
        }
    }
}

fn all_methods() -> impl Iterator<Item = Method> {
    (0..Method::NAMES.len() as u32).filter_map(Method::from_index)
}

fn store(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> PointStore {
    let mut store = PointStore::new(gpu.clone());
    store.reserve(u64::from(settings.scene.points));
    for part in five_mirrors::sample(variant, u64::from(settings.scene.points), u64::from(settings.scene.seed)) {
        let material = part.mirror.as_ref().map_or(Material::default(), |mirror| Material {
            specular_intensity: mirror.specular_intensity,
            specular_power: mirror.specular_power,
            has_formula: true,
            as_points: mirror.as_points,
        });
        let id = store.add_cloud(material);
        let ids: Vec<_> =
            part.chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).expect("room for a chunk")).collect();
        let cloud = cloud::Cloud { chunks: part.chunks, ..Default::default() };
        let (plan, _) = ColorPlan::new(&cloud, &settings.color, glam::DVec3::Y);
        store.set_color(id, &cloud, &ids, &plan, glam::DVec3::Y).expect("colours");
    }
    store
}

fn write(folder: &str, variant: Variant, method: Method, picture: &[u8]) {
    let path = format!("{folder}/{}-{}.ppm", variant.name(), method.name());
    let mut file = std::fs::File::create(path).expect("a file");
    write!(file, "P6 {} {} 255\n", SIZE[0], SIZE[1]).expect("room");
    let rgb: Vec<u8> = picture.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    file.write_all(&rgb).expect("room");
}

fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
