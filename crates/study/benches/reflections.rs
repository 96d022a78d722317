//! Reflection methods on the five mirrors: time and accuracy beside one another, all settings in turn in one run.
//!
//! `cargo bench --profile release -p study --bench reflections -- [MIRROR]... [KEY=VALUE]... [--try "KEY=VALUE ..."]...
//! [--rounds N] [--passes] [--pictures FOLDER]`: each `--try` is a setting on top of the others, with reflections;
//! without any, each method is one. Without mirrors all five. Pictures are PPM files.

use std::io::Write as _;

use param::Choice as _;
use render::{Gpu, PassStage, PassTime, Renderer};
use scene::five_mirrors::Variant;
use scene::{Method, Settings};
use study::{Accuracy, FiveMirrors};

const SIZE: [u32; 2] = [800, 600];

fn main() -> anyhow::Result<()> {
    let mut settings = Settings::default();
    let (mut variants, mut tries, mut folder, mut rounds) = (Vec::new(), Vec::new(), None, 5);
    let mut all_passes = false;
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| anyhow::anyhow!("{argument}: a value is missing"));
        match argument.as_str() {
            "--try" => tries.push(value()?),
            "--rounds" => rounds = value()?.parse()?,
            "--pictures" => folder = Some(value()?),
            "--passes" => all_passes = true,
            _ => match argument.split_once('=') {
                Some((key, value)) => settings.set_text(key, value)?,
                None => variants.extend(Variant::ALL.into_iter().filter(|variant| variant.name() == argument)),
            },
        }
    }
    if variants.is_empty() {
        variants = vec![Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral];
    }
    if tries.is_empty() {
        let methods = (0..Method::NAMES.len() as u32).filter_map(Method::from_index);
        let methods = methods.filter(|method| !matches!(method, Method::Auto | Method::None));
        tries = methods.map(|method| format!("reflection.method={}", method.name())).collect();
    }
    let gpu = Gpu::headless(None)?;
    let mut renderer = Renderer::new(gpu.clone())?;
    println!(
        "{} ({}), {} x {}, {} points, times by {} clock",
        gpu.info.name,
        gpu.info.backend,
        SIZE[0],
        SIZE[1],
        settings.scene.points,
        gpu.clock.name()
    );
    println!(
        "reflections: ms of all passes that find what is seen (median of {rounds}); pixel error by the same points (and by \
        exact surfaces): median, p95, p99"
    );
    for variant in variants {
        let stage = FiveMirrors::new(&gpu, variant, &settings)?;
        let tried: Vec<Settings> = tries
            .iter()
            .map(|text| {
                let mut tried = settings.clone();
                for (key, value) in text.split_whitespace().filter_map(|word| word.split_once('=')) {
                    tried.set_text(key, value)?;
                }
                Ok(tried)
            })
            .collect::<anyhow::Result<_>>()?;
        let mut times: Vec<Vec<Vec<PassTime>>> = vec![Vec::new(); tries.len()];
        let mut frames: Vec<Vec<f64>> = vec![Vec::new(); tries.len()];
        let mut judged = Vec::new();
        for round in 0..=rounds {
            for (case, tried) in tried.iter().enumerate() {
                let stats = stage.render(&mut renderer, tried, SIZE)?;
                // The first round compiles.
                if round == 0 {
                    if let Some(folder) = &folder {
                        write(&format!("{folder}/{}-{case}.ppm", variant.name()), &renderer.read_picture()?)?;
                    }
                    judged.push((stats.reflection, stage.judge(&renderer, tried, SIZE)?));
                } else {
                    times[case].push(stats.passes);
                    frames[case].push(stats.frame_milliseconds);
                }
            }
        }
        for (case, text) in tries.iter().enumerate() {
            let sum = |is_counted: &dyn Fn(&PassTime) -> bool| {
                let sums = times[case]
                    .iter()
                    .map(|passes| passes.iter().filter(|pass| is_counted(pass)).map(|pass| pass.milliseconds).sum());
                median(sums.collect())
            };
            let reflections = sum(&|pass| pass.stage == PassStage::Method);
            let (found, (same, exact)) = &judged[case];
            println!(
                "{} {text}: reflections {reflections:.0} ms, all passes {:.0} ms, frame {:.0} ms",
                variant.name(),
                sum(&|_| true),
                median(frames[case].clone())
            );
            if let Some(found) = found {
                println!(
                    "    coverage {:.4}, closed {:.4}, false fill {:.4}, recall {:.4}, hit rate {}, regions {}",
                    found.coverage,
                    found.closed_coverage,
                    same.false_fill,
                    same.recall.unwrap_or(f64::NAN),
                    found.hit_rate.map_or("-".into(), |rate| format!("{rate:.3}")),
                    found.regions.map_or("-".into(), |regions| regions.to_string()),
                );
            }
            if let Some([nodes, discs]) = found.and_then(|found| found.tests_per_ray) {
                println!("    nodes tested {nodes:.1}, discs tested {discs:.1} a ray");
            }
            println!(
                "    pixel error {} ({}), occlusion error {:.4} ({:.4})",
                pixels(same),
                pixels(exact),
                same.occlusion_error,
                exact.occlusion_error
            );
            if all_passes && let Some(first) = times[case].first() {
                let each =
                    first.iter().map(|pass| format!("{} {:.1}", pass.name, sum(&|timed| timed.name == pass.name)));
                println!("    {}", each.collect::<Vec<_>>().join(", "));
            }
        }
    }
    Ok(())
}

fn pixels(accuracy: &Accuracy) -> String {
    let error = accuracy.pixel_error;
    format!("{:.3} {:.2} {:.2}", error.median, error.p95, error.p99)
}

fn write(path: &str, picture: &[u8]) -> anyhow::Result<()> {
    let mut file = std::fs::File::create(path)?;
    writeln!(file, "P6 {} {} 255", SIZE[0], SIZE[1])?;
    let rgb: Vec<u8> = picture.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    Ok(file.write_all(&rgb)?)
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
