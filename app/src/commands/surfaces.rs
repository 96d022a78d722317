//! `glint surfaces`: measures how far the surface that is drawn is from the scan that it is made of.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Context as _;
use cloud::{PointTest, Progress};
use glam::DVec3;
use render::{Gpu, Renderer};
use scene::five_mirrors::Variant;
use scene::{Settings, Tripod};
use serde::Serialize;
use study::referee::{self, Shares, Verdict};
use study::{HoldOut, Interval, Referee, Ruler, Scan, ScannerFrom, Sightlines};
use world::Input;

use crate::commands::recording;
use crate::commands::scans;
use crate::commands::stats::set_values;
use crate::commands::subject::{self, LoadedSubject};
use crate::shared::command_line::SurfacesArguments;
use crate::shared::export;
use crate::shared::numbers::grouped;
use crate::system::failure::{self, FAILED, UNUSABLE};
use crate::system::terminal::{self, Few, print};
use crate::system::{interrupt, progress_bar};

#[derive(Serialize)]
struct Report {
    inputs: Vec<Entry>,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Entry {
    Judged(Box<Judged>),
    Refereed(Box<Refereed>),
    Failed { path: String, error: String },
}

/// The figures of one scan: those of the picture, or of the ray tracer where no picture can be drawn.
#[derive(Serialize)]
struct Judged {
    path: String,
    scanners: Vec<[f64; 3]>,
    scanner_from: ScannerFrom,
    #[serde(flatten)]
    figures: Sightlines,
    /// What the figures above are of: `picture` or `trace`.
    by: &'static str,
    /// The sightlines by the ray tracer, through the points as discs.
    traced: Sightlines,
    /// How often the intervals held that the discs state for their error.
    intervals: Vec<Interval>,
    points: u64,
    holdout: f64,
    seed: u64,
    set: BTreeMap<String, serde_json::Value>,
}

/// The figures of a made scan, by its exact surfaces.
#[derive(Serialize)]
struct Refereed {
    path: String,
    scanners: Vec<[f64; 3]>,
    scanner_from: ScannerFrom,
    exact: Verdict,
    /// How often the exact surface is within the error that a pixel states, of the pixels that are right.
    picture_held: f64,
    /// How often stated intervals held, by points held out, as of other scans.
    intervals: Vec<Interval>,
    points: u64,
    set: BTreeMap<String, serde_json::Value>,
}

/// Judges all inputs. Returns exit status 2 if one of them cannot be read in full or judged, and says so on standard error.
///
/// # Errors
/// Fails on bad usage, without an adapter, or on Ctrl-C.
pub fn run(arguments: &SurfacesArguments) -> anyhow::Result<u8> {
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    let settings = settings.drawn();
    recording::settings(&mut request).clone_from(&settings);
    terminal::warn(request.check_filters(&settings)?);
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    terminal::warn(&request.warnings);
    terminal::warn(request.settings_without_cloud(world::half_of(settings.stream.host_bytes)));
    if request.cloud_settings.iter().any(|own| own.placement().is_some()) {
        terminal::warn([
            "surfaces are judged where the files have them: the scene's moves and turns do not count here",
        ]);
    }
    let mut renderer = Renderer::new(gpu.clone())?;
    let (mut inputs, mut status, mut missing) = (Vec::new(), 0, 0_u64);
    let mut failed = Few::of("that cannot be judged");
    for input in &request.inputs {
        if let Input::BuiltIn { variant: Variant::Tripod(scan), .. } = input {
            if !arguments.scanner.is_empty() {
                terminal::warn([format!("{}: its stations are known, so --scanner does not count", input.name())]);
            }
            let refereed = referee(input, *scan, arguments, &gpu, &mut renderer)?;
            inputs.push(Entry::Refereed(Box::new(refereed)));
            continue;
        }
        for (path, scan) in scans::of_input(input, &request.test(), &settings) {
            let judged = scan.and_then(|(scan, lacking)| {
                missing = missing.saturating_add(lacking);
                judge(&path, &scan, arguments, &settings, &gpu, &mut renderer)
            });
            interrupt::check()?;
            inputs.push(judged.map_or_else(
                |error| {
                    let of_error = failure::exit_status(&error);
                    status = if of_error == UNUSABLE && status != FAILED { UNUSABLE } else { FAILED };
                    let error = format!("{error:#}");
                    failed.complain(&error);
                    Entry::Failed { path, error }
                },
                |judged| Entry::Judged(Box::new(judged)),
            ));
        }
    }
    failed.end();
    let report = Report { inputs };
    if arguments.json {
        terminal::print_json(&report)?;
        return Ok(export::say_missing(missing, status));
    }
    let mut separator = None;
    for entry in &report.inputs {
        let lines = match entry {
            Entry::Judged(judged) => lines(judged),
            Entry::Refereed(refereed) => exact_lines(refereed),
            Entry::Failed { .. } => continue,
        };
        print(separator.replace(String::new()).into_iter().chain(lines))?;
    }
    Ok(export::say_missing(missing, status))
}

fn judge(
    path: &str,
    scan: &Scan,
    arguments: &SurfacesArguments,
    settings: &Settings,
    gpu: &Arc<Gpu>,
    renderer: &mut Renderer,
) -> anyhow::Result<Judged> {
    let mut ruler = ruler(scan, &arguments.scanner, arguments, settings, gpu).with_context(|| path.to_owned())?;
    let (traced, intervals) = ruler.traced_with_intervals().with_context(|| path.to_owned())?;
    interrupt::check()?;
    let drawn = ruler.drawn(renderer, settings).with_context(|| path.to_owned())?;
    let said: Vec<&str> = arguments.set.iter().map(|(key, _)| key.as_str()).collect();
    Ok(Judged {
        path: path.to_owned(),
        scanners: ruler.scanner.places().into_iter().map(Into::into).collect(),
        scanner_from: ruler.from,
        by: if drawn.is_some() { "picture" } else { "trace" },
        figures: drawn.unwrap_or_else(|| traced.clone()),
        traced,
        intervals,
        points: scan.cloud.len(),
        holdout: arguments.holdout,
        seed: arguments.seed,
        set: set_values(settings, &said),
    })
}

/// Holds out points of a scan and makes a surface of the others.
fn ruler(
    scan: &Scan,
    places: &[DVec3],
    arguments: &SurfacesArguments,
    settings: &Settings,
    gpu: &Arc<Gpu>,
) -> anyhow::Result<Ruler> {
    let hold_out = HoldOut { share: arguments.holdout, seed: arguments.seed };
    let progress = Progress::default();
    let options = |chunks: &[cloud::Chunk]| world::options_for(chunks, scan.up, scan.scanner(), settings);
    let ruler = || Ruler::new(scan, hold_out, places, options, settings, gpu, &progress);
    let ruler = progress_bar::watch("normals", &progress, ruler)?;
    interrupt::check()?;
    Ok(ruler)
}

/// Judges a made scan with all its points, as the program opens it, and its intervals by points held out.
fn referee(
    input: &Input,
    scan: Tripod,
    arguments: &SurfacesArguments,
    gpu: &Arc<Gpu>,
    renderer: &mut Renderer,
) -> anyhow::Result<Refereed> {
    let name = input.name();
    let request = world::resolve(&[&name]);
    let mut settings = scan.settings();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    let camera = scan.camera();
    let opened = subject::open(gpu, request, &settings, referee::JUDGED, true, |_, _, _| camera)?;
    let Ok(LoadedSubject { subject, errors, .. }) = opened else {
        return Err(failure::usage(format!("{name}: no points")));
    };
    let known = Referee::new(scan);
    let exact = known.draw_and_judge(&subject, renderer, &settings)?;
    let half_widths = errors.map(|errors| errors.image(renderer, &subject, &settings)).transpose()?;
    let shown = referee::Shown::read(renderer)?;
    let held = |image: render::AovImage| known.held(&camera, &settings, referee::JUDGED, &shown, &image.data);
    let picture_held = half_widths.map_or(f64::NAN, held);
    let points = subject.parts.iter().filter(|part| part.specular_intensity == 0.0).map(|part| part.cloud.len()).sum();
    drop(subject);
    let mut intervals = Vec::new();
    for (_, scan) in scans::of_input(input, &PointTest::default(), &settings) {
        intervals = ruler(&scan?.0, &[], arguments, &settings, gpu)?.traced_with_intervals()?.1;
    }
    let said: Vec<&str> = arguments.set.iter().map(|(key, _)| key.as_str()).collect();
    Ok(Refereed {
        path: name,
        scanners: scan.stations().into_iter().map(Into::into).collect(),
        scanner_from: ScannerFrom::File,
        exact,
        picture_held,
        intervals,
        points,
        set: set_values(&settings, &said),
    })
}

/// The report on a made scan for people.
fn exact_lines(refereed: &Refereed) -> Vec<String> {
    let Refereed {
        path, scanners, exact: Verdict { camera, mirrors, covered }, points, picture_held, intervals, ..
    } = refereed;
    let place = |[x, y, z]: &[f64; 3]| format!("({x:.2}, {y:.2}, {z:.2})");
    let places: Vec<String> = scanners.iter().map(place).collect();
    let row = |name: &str, shares: &Shares, covered: Option<f64>| {
        let Shares { pixels, right, in_front, behind, empty, unscanned } = shares;
        let shares = [right, in_front, behind, empty].map(|share| format!("{:>7.2} %", share * 100.0)).join(" ");
        let covered = covered.map_or("-".into(), |covered| format!("{:.2} %", covered * 100.0));
        format!("  {name:<13} {shares} {covered:>9} {:>9} {:>9}", grouped(*pixels as u64), grouped(*unscanned as u64))
    };
    let lines = vec![
        path.clone(),
        format!("  {:<13} {}", "scanner", places.join(", ")),
        format!("  {:<13} {}, judged by the exact surfaces", "points", grouped(*points)),
        format!(
            "  {:<13} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
            "", "right", "in front", "behind", "empty", "covered", "pixels", "unscanned"
        ),
        row("camera", camera, None),
        row("mirrors", mirrors, Some(*covered)),
        format!("  {:<13} {:>7.2} % of the pixels that are right", "error held", picture_held * 100.0),
    ];
    lines.into_iter().chain(interval_lines(intervals)).collect()
}

/// How often stated intervals held, for people.
fn interval_lines(intervals: &[Interval]) -> impl Iterator<Item = String> {
    let title = format!("  {:<34} {:>9} {:>9} {:>12} {:>11}", "stated error", "stated", "held", "half width", "rays");
    let row = |Interval { bin, rays, stated, held, half_width }: &Interval| {
        let [stated, held] = [stated, held].map(|share| format!("{:.2} %", share * 100.0));
        format!("    {bin:<32} {stated:>9} {held:>9} {half_width:>12.5} {:>11}", grouped(*rays as u64))
    };
    let title = (!intervals.is_empty()).then_some(title);
    title.into_iter().chain(intervals.iter().map(row)).collect::<Vec<_>>().into_iter()
}

/// The report for people.
fn lines(judged: &Judged) -> Vec<String> {
    let mut lines = vec![judged.path.clone()];
    let mut line = |name: &str, value: String| lines.push(format!("  {name:<13} {value}"));
    let place = |[x, y, z]: &[f64; 3]| format!("({x:.2}, {y:.2}, {z:.2})");
    let count = judged.scanners.len();
    let places: Vec<String> = judged.scanners.iter().take(8).map(place).collect();
    let from = match judged.scanner_from {
        ScannerFrom::File => format!("named by the input: {}", places.join(", ")),
        ScannerFrom::Flag => places.join(", "),
        ScannerFrom::Origin => "the origin, from which each direction meets one surface".into(),
        ScannerFrom::Estimated => format!("estimated, where most points are seen from: {}", places.join(", ")),
        ScannerFrom::Returns => format!("{count} places along a flight, where pulses with several returns meet"),
        ScannerFrom::Above => "above, as far away as the scan is wide, and at most ten times its height".into(),
    };
    line("scanner", from);
    let held = format!("{} of {} points", grouped(judged.figures.rays as u64), grouped(judged.points));
    line("held out", format!("{held}, drawn by the seed {}", judged.seed));
    line(
        "",
        format!("{:>9} {:>9} {:>9} {:>9}   depth error, mm per m      colour", "within", "in front", "behind", "open"),
    );
    line("", format!("{:>39}   median       p95          CIEDE2000", ""));
    let mut row = |name: &str, figures: &Sightlines| {
        let Sightlines { within, in_front, behind, open, depth_error, colour_error, .. } = figures;
        let shares = [within, in_front, behind, open].map(|share| format!("{:>7.2} %", share * 100.0));
        let number = |value: Option<f64>, scale: f64| value.map_or("-".into(), |value| format!("{:.2}", value * scale));
        let [median, p95] = [depth_error.median, depth_error.p95].map(|error| number(error, 1000.0));
        line(name, format!("{}   {median:<12} {p95:<12} {}", shares.join(" "), number(colour_error.median, 1.0)));
    };
    if judged.by == "picture" {
        row("picture", &judged.figures);
    }
    row("ray tracer", &judged.traced);
    lines.extend(interval_lines(&judged.intervals));
    lines
}
