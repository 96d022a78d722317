//! Indirect light in the box of the five mirrors: time and accuracy beside one another, all settings in turn in one run.
//!
//! `cargo bench --profile release -p study --bench indirect -- [SCENE]... [KEY=VALUE]... [--try "KEY=VALUE ..."]... [--rounds N]
//! [--size WxH] [--stride N] [--paths N] [--over-mirrors] [--flicker]`: each `--try` is a setting on top of the others; without
//! any, those of docs/methods/gi.md. The truth is path-traced on exact surfaces at every N-th pixel of every N-th row, once for
//! what it depends on; without `--over-mirrors` its mirrors are black, as virtual lights have it. Prints a table in Markdown.

use render::{Gpu, PassTime, Renderer};
use scene::Settings;
use scene::five_mirrors::Variant;
use study::{FiveMirrors, IndirectTruth, JudgedLight, TracedLight};

const TRIES: [&str; 26] = [
    "gi.vpls=64 gi.interleave=1",
    "gi.vpls=256 gi.interleave=1",
    "gi.vpls=1024 gi.interleave=1",
    "gi.vpls=256 gi.interleave=2",
    "gi.vpls=256 gi.interleave=4",
    "gi.vpls=256 gi.interleave=4 gi.filtered=false",
    "gi.vpls=256 gi.interleave=8",
    "gi.vpls=1024 gi.interleave=2",
    "gi.vpls=1024 gi.interleave=4",
    "gi.vpls=1024 gi.interleave=4 gi.filtered=false",
    "gi.vpls=1024 gi.interleave=8",
    "gi.vpls=256 gi.interleave=1 gi.vpl=point",
    "gi.vpls=256 gi.interleave=1 gi.shadows=false",
    "gi.shadow_size=32",
    "gi.shadow_size=128",
    "gi.shadow_points=2048",
    "gi.shadow_points=32768",
    "gi.bounces=2",
    "gi.bounces=2 gi.vpls=1024",
    "gi.by=rays gi.rays_per_pixel=4",
    "gi.by=rays gi.rays_per_pixel=16",
    "gi.by=rays gi.rays_per_pixel=64",
    "gi.by=rays gi.rays_per_pixel=64 gi.filtered=false",
    "gi.bounces=2 gi.by=rays gi.rays_per_pixel=16",
    "gi.bounces=2 gi.by=rays gi.rays_per_pixel=16 gi.ray_bounces=2",
    "gi.bounces=2 gi.by=rays gi.rays_per_pixel=64 gi.ray_bounces=2",
];

/// Adds up the times of some passes.
fn sum(passes: &[PassTime], is_counted: impl Fn(&str) -> bool) -> f64 {
    passes.iter().filter(|pass| is_counted(pass.name)).map(|pass| pass.milliseconds).sum()
}

/// One setting's figures.
struct Row {
    settings: Settings,
    judged: Option<JudgedLight>,
    noise: f64,
    shading: Vec<f64>,
    placing: Vec<f64>,
}

fn main() -> anyhow::Result<()> {
    let mut settings = Settings::default();
    let mut traced = TracedLight { stride: 7, paths: 4096, over_mirrors: false };
    let (mut variants, mut tries, mut rounds, mut size) = (Vec::new(), Vec::new(), 3, [800, 600]);
    let mut is_flicker_asked = false;
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| anyhow::anyhow!("{argument}: a value is missing"));
        match argument.as_str() {
            "--try" => tries.push(value()?),
            "--rounds" => rounds = value()?.parse()?,
            "--size" => {
                let text = value()?;
                let (width, height) = text.split_once('x').ok_or_else(|| anyhow::anyhow!("{text} is no WxH"))?;
                size = [width.parse()?, height.parse()?];
            }
            "--stride" => traced.stride = value()?.parse()?,
            "--paths" => traced.paths = value()?.parse()?,
            "--over-mirrors" => traced.over_mirrors = true,
            "--flicker" => is_flicker_asked = true,
            _ => match argument.split_once('=') {
                Some((key, value)) => settings.set_text(key, value)?,
                None => variants.extend(Variant::ALL.into_iter().filter(|variant| variant.name() == argument)),
            },
        }
    }
    if variants.is_empty() {
        variants.push(Variant::None);
    }
    if tries.is_empty() {
        tries = TRIES.map(String::from).to_vec();
    }
    let gpu = Gpu::headless(None)?;
    let mut renderer = Renderer::new(gpu.clone())?;
    let [width, height] = size;
    println!(
        "{} ({}), {width} x {height}, {} points, times by {} clock, medians of {rounds}; truth: {} paths at every pixel of {} \
        in both directions",
        gpu.info.name,
        gpu.info.backend,
        settings.scene.points,
        gpu.clock.name(),
        traced.paths,
        traced.stride
    );
    for variant in variants {
        let stage = FiveMirrors::new(&gpu, variant, &settings)?;
        let mut rows: Vec<Row> = tries
            .iter()
            .map(|text| {
                let mut settings = settings.clone();
                for (key, value) in text.split_whitespace().filter_map(|word| word.split_once('=')) {
                    settings.set_text(key, value)?;
                }
                Ok(Row { settings, judged: None, noise: 0.0, shading: Vec::new(), placing: Vec::new() })
            })
            .collect::<anyhow::Result<_>>()?;
        let mut truths: Vec<(Settings, IndirectTruth)> = Vec::new();
        for round in 0..=rounds {
            for row in &mut rows {
                let stats = stage.render(&mut renderer, &row.settings, size)?;
                // The first round compiles, and is judged.
                if round == 0 {
                    let asked = asked_of_truth(&row.settings);
                    let at = match truths.iter().position(|(known, _)| *known == asked) {
                        Some(at) => at,
                        None => {
                            let truth = stage.indirect_truth(&row.settings, size, traced)?;
                            truths.push((asked, truth));
                            truths.len() - 1
                        }
                    };
                    row.judged = Some(stage.judge_indirect(&renderer, &truths[at].1)?);
                    row.noise = truths[at].1.noise;
                } else {
                    row.shading.push(sum(&stats.passes, |name| name.starts_with("indirect") || name == "light_rays"));
                    row.placing.push(sum(&stats.passes, |name| name.starts_with("vpl_")));
                }
            }
        }
        println!("\n{}\n", variant.name());
        println!(
            "| setting | error, % | its mean | p95, % | error, all pixels, % | mean | brightest | shading, ms | placing, ms | noise, % |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|");
        let mut shares = Vec::new();
        for (row, text) in rows.iter_mut().zip(&tries) {
            let Some(JudgedLight { all, same_surface, p95, share }) = row.judged else { continue };
            println!(
                "| `{text}` | {:.2} | {:.3} | {:.2} | {:.2} | {:.3} | {:.2} | {:.0} | {:.0} | {:.2} |",
                same_surface.relative_rmse * 100.0,
                same_surface.mean_ratio,
                p95 * 100.0,
                all.relative_rmse * 100.0,
                all.mean_ratio,
                all.brightest_ratio,
                median(&mut row.shading),
                median(&mut row.placing),
                row.noise * 100.0
            );
            shares.push(share);
        }
        println!(
            "\nthe first errors are over the {:.1} % of the pixels that show the truth's surface",
            median(&mut shares) * 100.0
        );
        if is_flicker_asked {
            println!("\nflicker, grey levels, over 16 steps of a quarter of a pixel:");
            for (row, text) in rows.iter().zip(&tries) {
                let flicker = stage.flicker_of_indirect(&mut renderer, &row.settings, size, 16)?;
                println!("`{text}`: mean {:.3}, most {:.2}", flicker.mean, flicker.max);
            }
        }
    }
    Ok(())
}

/// The settings that the truth depends on, all others as they come.
fn asked_of_truth(settings: &Settings) -> Settings {
    let mut asked = Settings::default();
    (asked.light, asked.sun, asked.mirror) = (settings.light.clone(), settings.sun.clone(), settings.mirror.clone());
    (asked.reflection, asked.view) = (settings.reflection.clone(), settings.view.clone());
    asked.gi.bounces = settings.gi.bounces;
    asked.trace.seed = settings.trace.seed;
    asked
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
