//! A method for each mirror against one method for all of them: time and accuracy, all in one run.
//!
//! `cargo bench --profile release -p study --bench own_methods -- [SCENE]... [KEY=VALUE]... [--rounds N] [--size WxH]
//! [--csv FILE]`: without scenes, five-mirrors/all and a made scan of a room with a ball, a plane and a ring, which is
//! shown in its own colours. No light goes between surfaces.
//!
//! Mirrors are drawn by their formulas. Errors are the CIEDE2000 differences of their pixels to rays traced through the
//! exact surfaces. Each method is drawn for all mirrors, then for each mirror alone while the others are traced. What a
//! mirror shows does not depend on the methods of the others, so the error of every combination follows, and its time is
//! predicted. For the time and for the error of each single method, the combination that promises most is drawn, too.

use std::collections::BTreeSet;
use std::io::Write as _;

use cloud::Progress;
use param::Choice as _;
use render::{Aov, Frame, Gpu, PassStage, Renderer};
use scene::five_mirrors::Variant;
use scene::{Method, MirrorSurface, Settings, Tripod};
use study::{Subject, TracedScene, Tracer, Truth, View, delta_e, drawn_size};

/// The methods with their parameters; the first one is that of the other mirrors. `light_field` is not among them: its
/// maps take half a minute, and it is made for them to stand.
const WAYS: [&str; 12] = [
    "sscr_hierarchical",
    "environment_map",
    "environment_map environment_map.proxy=box",
    "mirrored_viewpoint",
    "cubemap_trace",
    "cubemap_trace cubemap_trace.rest=none cubemap_trace.size=128 cubemap_trace.maps=1",
    "screen_trace",
    "screen_trace screen_trace.rest=none",
    "surfel_trace",
    "none",
    "sscr_hierarchical view.resolution=0.75",
    "sscr_hierarchical view.resolution=0.5",
];

/// The number of ways that single mirrors may have: `surfel_trace` finds what the first one does, and the others are for
/// the whole picture.
const MIXED: usize = 8;

/// The way of each mirror.
type Ways = Vec<usize>;

/// The milliseconds of a frame from scratch, and of one that keeps maps and trees: of all passes, and of those that find
/// reflections.
type Times = [f64; 4];

/// The names of [`Times`] in the table.
const TIMES: [&str; 4] = ["scratch_ms", "scratch_method_ms", "moving_ms", "moving_method_ms"];

/// The times of passes that find reflections, by which combinations are chosen: the others are the same for all.
const OF_METHODS: [usize; 2] = [1, 3];

/// The colour differences of the pixels of some mirrors.
#[derive(Clone, Copy, Debug)]
struct Error {
    mean: f64,
    p95: f64,
    pixels: usize,
}

/// The times and the errors of a picture.
type Drawn = (Times, Vec<Error>);

struct Stage {
    subject: Subject,
    settings: Settings,
    size: [u32; 2],
    /// The mirror that each pixel shows, by its place among the mirrors.
    mirror_at: Vec<Option<usize>>,
    truth: Vec<[f32; 3]>,
    names: Vec<String>,
}

impl Stage {
    fn new(gpu: &std::sync::Arc<Gpu>, variant: Variant, settings: &Settings, size: [u32; 2]) -> anyhow::Result<Self> {
        let mut settings = settings.clone();
        settings.mirror.surface = MirrorSurface::Exact;
        let subject = Subject::five_mirrors(gpu, variant, &settings)?;
        let progress = Progress::default();
        let traced = TracedScene::new(&subject.parts, subject.exact.clone(), settings.splat.size, &progress)?;
        let view = View { camera: &subject.camera, settings: &settings, objects: subject.objects(), size };
        let tracer = Tracer::new(&traced, view);
        let seen = tracer.exactly_seen(&progress)?;
        let truth = tracer.colors(Truth::Exact, &seen, &progress)?;
        let of_mirrors = |seen: &Option<(trace::Hit, glam::DVec3)>| {
            seen.filter(|(hit, _)| hit.specular_intensity > 0.0).map(|(hit, _)| hit.surface)
        };
        // The surfaces of mirrors follow those of walls, in the order of the mirrors.
        let surfaces: BTreeSet<u32> = seen.iter().filter_map(of_mirrors).collect();
        anyhow::ensure!(surfaces.len() == subject.mirrors.len(), "not every mirror is seen");
        let surfaces: Vec<u32> = surfaces.into_iter().collect();
        let place = |seen| surfaces.iter().position(|surface| Some(*surface) == of_mirrors(seen));
        let mirror_at = seen.iter().map(place).collect();
        let names = subject.mirrors.iter().map(|mirror| mirror.name.clone()).collect();
        Ok(Self { mirror_at, truth, names, subject, settings, size })
    }

    /// Sets the methods of the mirrors. Returns the settings, or `None` if two mirrors need other parameters of one method.
    fn set(&mut self, ways: &[usize]) -> anyhow::Result<Option<Settings>> {
        let mut settings = self.settings.clone();
        let mut used: Vec<(Method, usize)> = Vec::new();
        for (mirror, way) in self.subject.mirrors.iter_mut().zip(ways) {
            let mut words = WAYS[*way].split_whitespace();
            let method = words.next().and_then(Method::from_name).unwrap_or(Method::Auto);
            for (key, value) in words.filter_map(|word| word.split_once('=')) {
                settings.set_text(key, value)?;
            }
            if used.iter().any(|(other, with)| *other == method && with != way) {
                return Ok(None);
            }
            used.push((method, *way));
            mirror.method = Some(method);
        }
        let is_one = ways.iter().all(|way| *way == ways[0]);
        settings.reflection.method = if is_one { used[0].0 } else { Method::SscrHierarchical };
        if is_one {
            self.subject.mirrors.iter_mut().for_each(|mirror| mirror.method = None);
        }
        Ok(Some(settings))
    }

    /// Draws a frame from scratch, which is judged, and one of a camera that has moved by a hair. `None` if the picture is
    /// refused.
    fn draw(&mut self, renderer: &mut Renderer, ways: &[usize]) -> anyhow::Result<Option<Drawn>> {
        let Some(settings) = self.set(ways)? else { return Ok(None) };
        let size = drawn_size(self.size, &settings);
        let (mut times, mut errors) = (Vec::new(), Vec::new());
        let mut camera = self.subject.camera;
        for is_moved in [false, true] {
            loop {
                if is_moved {
                    camera.eye += camera.up * 1e-4;
                } else {
                    renderer.forget();
                }
                let frame = Frame::new(&camera, &settings, self.subject.objects(), size);
                let stats = match renderer.render(&self.subject.store, &frame) {
                    Ok(stats) => stats,
                    Err(render::Error::OneMethodOnly { .. }) => return Ok(None),
                    Err(error) => return Err(error.into()),
                };
                if !stats.has_compiled {
                    let method = stats.passes.iter().filter(|pass| pass.stage == PassStage::Method);
                    times.extend([stats.frame_milliseconds, method.map(|pass| pass.milliseconds).sum()]);
                    break;
                }
            }
            if !is_moved {
                errors = self.errors(&renderer.read_aov(Aov::Color)?.data, size);
            }
        }
        Ok(times.try_into().ok().map(|times| (times, errors)))
    }

    /// The error of each mirror, of all of them, and of the rest, in a picture of `size`.
    fn errors(&self, drawn: &[f32], size: [u32; 2]) -> Vec<Error> {
        // A pixel shows the drawn pixel that it lies in.
        let [width, height] = self.size.map(|side| side as usize);
        let along = |at: usize, axis: usize| at * size[axis] as usize / self.size[axis] as usize;
        let place = |index: usize| (along(index / width, 1) * size[0] as usize + along(index % width, 0)) * 3;
        let color = |index: usize| [0, 1, 2].map(|channel| drawn[place(index) + channel]);
        let shown: Vec<[f32; 3]> = (0..width * height).map(color).collect();
        let differences = delta_e(&shown, &self.truth);
        let of = |counts: &dyn Fn(Option<usize>) -> bool| {
            let pixels = self.mirror_at.iter().zip(&differences);
            let own = pixels.filter(|(mirror, _)| counts(**mirror)).map(|(_, error)| f64::from(*error));
            let mut own: Vec<f64> = own.collect();
            own.sort_by(f64::total_cmp);
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            Error { mean, p95: own[(own.len() * 95).div_ceil(100) - 1], pixels: own.len() }
        };
        let each = (0..self.names.len()).map(|mirror| of(&|other| other == Some(mirror)));
        each.chain([of(&|mirror| mirror.is_some()), of(&|mirror| mirror.is_none())]).collect()
    }

    /// The medians of the times of these ways in some rounds, and their errors; `None` where the picture is refused.
    fn measured(&mut self, renderer: &mut Renderer, all: &[Ways], rounds: usize) -> anyhow::Result<Vec<Option<Drawn>>> {
        let mut measured: Vec<(Vec<Times>, Vec<Error>)> = vec![Default::default(); all.len()];
        for _ in 0..rounds {
            for (ways, (times, errors)) in all.iter().zip(&mut measured) {
                if let Some((one, own)) = self.draw(renderer, ways)? {
                    times.push(one);
                    *errors = own;
                }
            }
        }
        let median = |(times, errors): (Vec<Times>, Vec<Error>)| {
            let of_kind = |kind| median(times.iter().map(|times| times[kind]).collect());
            (!times.is_empty()).then(|| (std::array::from_fn(of_kind), errors))
        };
        Ok(measured.into_iter().map(median).collect())
    }

    /// The mirrors whose way is not that of the others, and their ways, as in the table.
    fn told(&self, ways: &[usize]) -> [String; 2] {
        let others: Vec<(&str, &str)> = self
            .names
            .iter()
            .zip(ways)
            .filter(|(_, way)| **way > 0)
            .map(|(name, way)| (name.as_str(), WAYS[*way]))
            .collect();
        match others[..] {
            _ if ways.iter().all(|way| *way == ways[0]) => ["all".to_owned(), WAYS[ways[0]].to_owned()],
            [(name, way)] => [name.to_owned(), way.to_owned()],
            _ => {
                let each = others.iter().map(|(name, way)| format!("{name}: {way}"));
                ["several".to_owned(), each.collect::<Vec<_>>().join("; ")]
            }
        }
    }
}

/// The combinations of several changes that promise most for the time and for the error of each single method that no
/// other one beats, in frames from scratch and in others. `single` are the methods, and `changed` those of one mirror each,
/// by way and mirror.
fn promising(stage: &mut Stage, single: &[Option<Drawn>], changed: &[Option<Drawn>]) -> anyhow::Result<BTreeSet<Ways>> {
    let mirrors = stage.names.len();
    let Some((base, errors)) = &single[0] else { return Ok(BTreeSet::new()) };
    let share = |mirror: usize| errors[mirror].pixels as f64 / errors[mirrors].pixels as f64;
    let mut known: Vec<(Ways, Times, f64)> = Vec::new();
    for number in 0..MIXED.pow(mirrors as u32) {
        let ways: Ways = (0..mirrors as u32).map(|mirror| number / MIXED.pow(mirror) % MIXED).collect();
        let (mut times, mut error) = (*base, 0.0);
        let all_known = ways.iter().enumerate().all(|(mirror, way)| {
            let Some((_, errors)) = &single[*way] else { return false };
            error += errors[mirror].mean * share(mirror);
            let Some(change) = way.checked_sub(1) else { return true };
            let Some((own, _)) = &changed[change * mirrors + mirror] else { return false };
            times.iter_mut().zip(own).zip(base).for_each(|((time, own), base)| *time += own - base);
            true
        });
        if all_known && ways.iter().filter(|way| **way > 0).count() > 1 {
            known.push((ways, times, error));
        }
    }
    let mut chosen = BTreeSet::new();
    for kind in OF_METHODS {
        let figures = single.iter().flatten().map(|(times, errors)| [times[kind], errors[mirrors].mean]);
        let figures: Vec<[f64; 2]> = figures.collect();
        let is_beaten = |own: &[f64; 2]| figures.iter().any(|other| other[0] < own[0] && other[1] <= own[1]);
        for [most, worst] in figures.iter().filter(|own| !is_beaten(own)) {
            let fast = known.iter().filter(|(_, times, _)| times[kind] <= *most);
            chosen.extend(best(stage, fast.collect(), |(_, times, error)| [*error, times[kind]])?);
            let good = known.iter().filter(|(_, _, error)| *error <= worst + 0.005);
            chosen.extend(best(stage, good.collect(), |(_, times, error)| [times[kind], *error])?);
        }
    }
    Ok(chosen)
}

/// The first combination by an order that can be drawn.
fn best<T>(
    stage: &mut Stage,
    mut all: Vec<&(Ways, T, f64)>,
    order: impl Fn(&(Ways, T, f64)) -> [f64; 2],
) -> anyhow::Result<Option<Ways>> {
    all.sort_by(|a, b| order(a).partial_cmp(&order(b)).unwrap_or(std::cmp::Ordering::Equal));
    for (ways, ..) in all {
        if stage.set(ways)?.is_some() {
            return Ok(Some(ways.clone()));
        }
    }
    Ok(None)
}

fn main() -> anyhow::Result<()> {
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.scene.points) = (0, 400_000);
    let (mut variants, mut rounds, mut size, mut file) = (Vec::new(), 3, [320, 240], None);
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| anyhow::anyhow!("{argument}: a value is missing"));
        match argument.as_str() {
            "--rounds" => rounds = value()?.parse()?,
            "--csv" => file = Some(value()?),
            "--size" => {
                let text = value()?;
                let (width, height) = text.split_once('x').ok_or_else(|| anyhow::anyhow!("{text} is no WxH"))?;
                size = [width.parse()?, height.parse()?];
            }
            _ => match argument.split_once('=') {
                Some((key, value)) => settings.set_text(key, value)?,
                None => variants.extend(Variant::ALL.into_iter().filter(|variant| variant.name() == argument)),
            },
        }
    }
    if variants.is_empty() {
        variants = vec![Variant::All, Variant::Tripod(Tripod::Four)];
    }
    let gpu = Gpu::headless(None)?;
    let mut renderer = Renderer::new(gpu.clone())?;
    let mut table = String::from("scene,changed,ways");
    TIMES.iter().for_each(|name| table += &format!(",{name}"));
    table += ",delta_e,delta_e_p95,delta_e_worst_mirror,delta_e_of_mirrors,pixels,delta_e_rest\n";
    for variant in variants {
        let mut settings = settings.clone();
        if let Variant::Tripod(_) = variant {
            settings.light.by = scene::Lighting::Colors;
        }
        let mut stage = Stage::new(&gpu, variant, &settings, size)?;
        let mirrors = stage.names.len();
        let mut all: Vec<Ways> = (0..WAYS.len()).map(|way| vec![way; mirrors]).collect();
        let change =
            |way: usize, changed: usize| (0..mirrors).map(|mirror| if mirror == changed { way } else { 0 }).collect();
        all.extend((1..MIXED).flat_map(|way| (0..mirrors).map(move |mirror| change(way, mirror))));
        let mut measured = stage.measured(&mut renderer, &all, rounds)?;
        let (single, changed) = measured.split_at(WAYS.len());
        let combined: Vec<Ways> = promising(&mut stage, single, changed)?.into_iter().collect();
        measured.extend(stage.measured(&mut renderer, &combined, rounds)?);
        all.extend(combined);
        for (ways, (times, errors)) in all.iter().zip(measured).filter_map(|(ways, drawn)| Some((ways, drawn?))) {
            let (each, others) = errors.split_at(mirrors);
            let [changed, ways] = stage.told(ways);
            table += &format!("{}/{},{changed},{ways}", variant.family(), variant.name());
            times.iter().for_each(|time| table += &format!(",{time:.1}"));
            let worst = each.iter().map(|error| error.mean).fold(0.0, f64::max);
            let own: Vec<String> = each.iter().map(|error| format!("{:.2}", error.mean)).collect();
            let Error { mean, p95, pixels } = others[0];
            table += &format!(",{mean:.3},{p95:.2},{worst:.2},{},{pixels},{:.2}\n", own.join(" "), others[1].mean);
        }
    }
    println!("{} ({}), {} x {}", gpu.info.name, gpu.info.backend, size[0], size[1]);
    print!("{table}");
    if let Some(file) = file {
        std::fs::File::create(file)?.write_all(table.as_bytes())?;
    }
    Ok(())
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
