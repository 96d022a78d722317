//! Points that move in every frame: methods that need trees over the points, against sample-based cameras, which need
//! none. All settings in turn in one run.
//!
//! `cargo bench --profile release -p study --bench moving -- [MIRROR]... [KEY=VALUE]... [--try "KEY=VALUE ..."]...
//! [--rounds N] [--size WxH] [--passes]`: every frame is drawn of new points. A wave of the
//! height of a splat radius runs through the walls; the mirror's own points hold still, and keep their tree. The time
//! of a reflection is that of the whole frame, trees and uploads to them included, less that of a frame without
//! reflections. The first try is what the others are compared with. Without mirrors: the sphere, then the hollow
//! mirror, by their points and by their formula.

use std::sync::Arc;
use std::time::Instant;

use cloud::{Chunk, Cloud, Progress, unpack_radius};
use param::Choice as _;
use rayon::prelude::*;
use render::{ChunkId, ColorPlan, Frame, Gpu, Material, Objects, PassStage, PointStore, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Method, Mirror, Settings};
use study::{SubjectPart, TracedScene, Tracer, Truth, View};

const TRIES: [&str; 4] = [
    "reflection.method=surfel_trace",
    "reflection.method=sample_cameras sample_cameras.rest=none",
    "reflection.method=sample_cameras sample_cameras.rest=none sample_cameras.analytic=false",
    "reflection.method=sample_cameras sample_cameras.rest=none sample_cameras.cells=space",
];

/// The box of the five mirrors with one mirror, whose walls move.
struct Stage {
    store: PointStore,
    still: Vec<Chunk>,
    moving: Vec<ChunkId>,
    part: SubjectPart,
    mirrors: Vec<Mirror>,
    others: Vec<SubjectPart>,
    variant: Variant,
}

impl Stage {
    fn new(gpu: &Arc<Gpu>, variant: Variant, settings: &Settings) -> anyhow::Result<Self> {
        let mut store = PointStore::new(gpu.clone());
        store.reserve(settings.scene.points.into());
        let (mut walls, mut others, mut mirrors) = (None, Vec::new(), Vec::new());
        for part in five_mirrors::sample(variant, settings.scene.points.into(), settings.scene.seed.into()) {
            let material = part.mirror.as_ref().map_or(Material::default(), Material::of_mirror);
            let id = store.add_cloud(material);
            let chunks = part.chunks;
            let ids: Vec<_> =
                chunks.iter().map(|chunk| store.add_chunk(id, chunk, None)).collect::<render::Result<_>>()?;
            let up = variant.camera().up;
            let cloud = Cloud { chunks: chunks.clone(), ..Cloud::default() };
            let plan = ColorPlan::new(&cloud, &settings.color, up).0;
            store.set_color(id, &cloud, &ids, &plan, up)?;
            match part.mirror {
                Some(mirror) => {
                    others.push(SubjectPart::of_mirror(&mirror, cloud));
                    mirrors.push(mirror);
                }
                None => {
                    let part =
                        SubjectPart { cloud, specular_intensity: 0.0, specular_power: 0.0, clear: None, plan, up };
                    walls = Some((chunks, ids, part));
                }
            }
        }
        let (still, moving, part) = walls.ok_or_else(|| anyhow::anyhow!("the scene has no walls"))?;
        Ok(Self { store, still, moving, part, mirrors, others, variant })
    }

    /// Puts the walls' points where they are in a frame, and returns the milliseconds that their upload takes.
    fn swing(&mut self, frame: u32) -> anyhow::Result<f64> {
        let swung = |chunk: &Chunk| {
            let place = |([x, y, z], radius): (&[f32; 3], &u16)| {
                let along = chunk.origin.element_sum() as f32 + x + y + z;
                let wave = (4.0 * along + frame as f32).sin() * unpack_radius(*radius).unwrap_or(0.0);
                [x + wave, y + wave, z + wave]
            };
            let radii = chunk.radii.iter().flat_map(|radii| radii.iter());
            let positions = chunk.positions.iter().zip(radii).map(place).collect();
            Chunk { positions: Arc::new(positions), ..chunk.clone() }
        };
        let chunks: Vec<Chunk> = self.still.par_iter().map(swung).collect();
        let start = Instant::now();
        for (id, chunk) in self.moving.iter().zip(&chunks) {
            self.store.update_chunk(*id, chunk, None)?;
        }
        self.part.cloud.chunks = chunks;
        Ok(start.elapsed().as_secs_f64() * 1000.0)
    }
}

/// What a try took, in milliseconds, frame by frame.
#[derive(Default)]
struct Times {
    frames: Vec<f64>,
    /// The times of the method's passes, by their names.
    passes: Vec<Vec<(&'static str, f64)>>,
}

impl Times {
    /// The median time of the passes of these names together.
    fn of_passes(&self, is_counted: impl Fn(&str) -> bool) -> f64 {
        let sum = |frame: &Vec<(&str, f64)>| frame.iter().filter(|pass| is_counted(pass.0)).map(|pass| pass.1).sum();
        median(&self.passes.iter().map(sum).collect::<Vec<f64>>())
    }
}

/// How frames are drawn.
struct Asked {
    settings: Settings,
    tries: Vec<String>,
    rounds: u32,
    size: [u32; 2],
    all_passes: bool,
}

fn main() -> anyhow::Result<()> {
    let mut settings = Settings::default();
    settings.set_text("gi.bounces", "0")?;
    let (mut variants, mut tries, mut rounds, mut size) = (Vec::new(), Vec::new(), 3, [800, 600]);
    let mut all_passes = false;
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| anyhow::anyhow!("{argument}: a value is missing"));
        match argument.as_str() {
            "--try" => tries.push(value()?),
            "--rounds" => rounds = value()?.parse()?,
            "--passes" => all_passes = true,
            "--size" => {
                let text = value()?;
                let (width, height) = text.split_once('x').ok_or_else(|| anyhow::anyhow!("{text} is no WxH"))?;
                size = [width.parse()?, height.parse()?];
            }
            _ => match argument.split_once('=') {
                Some((key, value)) => settings.set_text(key, value)?,
                None => {
                    let variant = Variant::ALL.into_iter().find(|variant| variant.name() == argument);
                    variants.push(variant.ok_or_else(|| anyhow::anyhow!("{argument} is none of the five mirrors"))?);
                }
            },
        }
    }
    if variants.is_empty() {
        variants = vec![Variant::Sphere, Variant::Parabolic];
    }
    if tries.is_empty() {
        tries = TRIES.map(String::from).to_vec();
    }
    let gpu = Gpu::headless(None)?;
    let mut renderer = Renderer::new(gpu.clone())?;
    println!(
        "{} ({}), {} x {}, {} points that move in every frame, medians of {rounds} frames",
        gpu.info.name, gpu.info.backend, size[0], size[1], settings.scene.points
    );
    for variant in variants {
        for surface in ["points", "exact"] {
            let mut settings = settings.clone();
            settings.set_text("mirror.surface", surface)?;
            let mut stage = Stage::new(&gpu, variant, &settings)?;
            compare(&mut renderer, &mut stage, &Asked { settings, tries: tries.clone(), rounds, size, all_passes })?;
        }
    }
    Ok(())
}

/// Draws frames by each try in turn, and prints what they took and how accurate the last ones are.
fn compare(renderer: &mut Renderer, stage: &mut Stage, asked: &Asked) -> anyhow::Result<()> {
    let Asked { settings, tries, rounds, size, all_passes } = asked;
    let (rounds, size) = (*rounds, *size);
    let without = scene::Reflection { method: Method::None, ..settings.reflection.clone() };
    let none = Settings { reflection: without, ..settings.clone() };
    let mut all = vec![none];
    for text in tries {
        let mut tried = settings.clone();
        for (key, value) in text.split_whitespace().filter_map(|word| word.split_once('=')) {
            tried.set_text(key, value)?;
        }
        all.push(tried);
    }
    let camera = stage.variant.camera();
    let mut times: Vec<Times> = all.iter().map(|_| Times::default()).collect();
    let mut uploads = Vec::new();
    let mut judged = Vec::new();
    let mut frame = 0;
    for round in 0..=rounds {
        for (case, tried) in all.iter().enumerate() {
            frame += 1;
            let upload = stage.swing(frame)?;
            let objects = Objects { mirrors: &stage.mirrors, ..Objects::default() };
            renderer.forget();
            let start = Instant::now();
            let stats = renderer.render(&stage.store, &Frame::new(&camera, tried, objects, size))?;
            let milliseconds = start.elapsed().as_secs_f64() * 1000.0;
            // The first round compiles.
            if round > 0 {
                let method = stats.passes.iter().filter(|pass| pass.stage == PassStage::Method);
                times[case].frames.push(milliseconds);
                times[case].passes.push(method.map(|pass| (pass.name, pass.milliseconds)).collect());
                uploads.push(upload);
            }
            if round == rounds && case > 0 {
                let parts: Vec<SubjectPart> = [&stage.part].into_iter().chain(&stage.others).map(same_part).collect();
                let traced = TracedScene::new(&parts, None, tried.splat.size, &Progress::default())?;
                let tracer = Tracer::new(&traced, View { camera: &camera, settings: tried, objects, size });
                let accuracy = tracer.judge(Truth::SameInput, &tracer.drawn(renderer)?, &Progress::default())?;
                judged.push((stats.reflection, accuracy));
            }
        }
    }
    let without = median(&times[0].frames);
    println!(
        "\n{}, mirror.surface={}: new points {:.0} ms, frame without reflections {without:.0} ms",
        stage.variant.name(),
        settings.mirror.surface.name(),
        median(&uploads)
    );
    let reflections: Vec<f64> = times[1..].iter().map(|times| median(&times.frames) - without).collect();
    for ((text, times), (added, (found, accuracy))) in
        tries.iter().zip(&times[1..]).zip(reflections.iter().zip(&judged))
    {
        let error = accuracy.pixel_error;
        println!(
            "{text}\n    reflections {added:.0} ms, {:.2} of the first; frame {:.0} ms, passes of the method {:.0} ms",
            added / reflections[0],
            median(&times.frames),
            times.of_passes(|_| true)
        );
        println!(
            "    coverage {:.3}, unresolved {}, recall {:.4}, pixel error {:.3} {:.2} {:.2}, occlusion error {:.4}",
            found.as_ref().map_or(f64::NAN, |found| found.coverage),
            found.as_ref().and_then(|found| found.unresolved).map_or("-".into(), |share| format!("{share:.3}")),
            accuracy.recall.unwrap_or(f64::NAN),
            error.median,
            error.p95,
            error.p99,
            accuracy.occlusion_error
        );
        if let Some(first) = times.passes.first().filter(|_| *all_passes) {
            let mut names: Vec<&str> = first.iter().map(|pass| pass.0).collect();
            names.dedup();
            let each = names.iter().map(|name| format!("{name} {:.0}", times.of_passes(|pass| pass == *name)));
            println!("    {}", each.collect::<Vec<_>>().join(", "));
        }
    }
    Ok(())
}

/// The same points; chunks share what they hold.
fn same_part(part: &SubjectPart) -> SubjectPart {
    SubjectPart { cloud: part.cloud.clone(), plan: part.plan.clone(), ..*part }
}

fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
