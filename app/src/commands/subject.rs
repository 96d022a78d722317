//! Opens what the user named as a scene in memory and on the GPU, for pictures without a window.
//!
//! As in the window, `world::Assembly` puts the clouds together and `world::Resident` puts them on the GPU. Unlike the
//! window, this code waits until everything is loaded.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use anyhow::anyhow;
use cloud::{Chunk, Cloud, Placement, PointTest, Progress};
use glam::DVec3;
use render::{ColorPlan, Gpu, MOST_LIGHTS};
use scene::{
    Camera, CloudSettings, ColorBy, Measurement, Mirror, MirrorPoints, MirrorSurface, Object, Settings, Strays,
};
use serde::Serialize;
use study::{Exact, Subject, SubjectPart};
use world::{
    Assembly, AutoLight, Change, CloudKey, CloudTask, Event, Extent, Input, Job, Request, Resident, StreamStats,
    StreamView, mirrors,
};

use crate::commands::recording;
use crate::commands::surface_error::{self, SurfaceErrors};
use crate::overlays::Facts;
use crate::overlays::labels::Mark;
use crate::shared::export;
use crate::shared::measuring::{self, ROUGH_LABELS, are_of_loaded};
use crate::system::failure::{FAILED, UNUSABLE, usage};
use crate::system::interrupt;
use crate::system::progress_bar::{self, Bar};
use crate::system::terminal::{self, Few};

/// Said of a scene whose clouds have points, and which shows none of them.
pub const ALL_HIDDEN: &str = "no cloud is seen, the scene hides all of their points";

/// A scene that has been opened.
pub struct LoadedSubject {
    pub subject: Subject,
    /// The exit status so far: not 0 if inputs failed, which have been reported.
    pub status: u8,
    /// The number of points that the files announce and that cannot be read, as far as that is known.
    pub unread: u64,
    /// Set if clouds are streamed.
    pub stream: Option<StreamReport>,
    /// For each cloud its file, if all points of the file are in memory and shown.
    pub sources: Vec<Option<Arc<codec::Source>>>,
    /// What overlays of the picture show.
    pub facts: Facts,
    /// How sure the surface is, if that was asked for.
    pub errors: Option<SurfaceErrors>,
}

/// What was loaded of streamed clouds for the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StreamReport {
    /// Whether all points that the view needs were loaded, within the budgets.
    pub settled: bool,
    pub nodes: usize,
    /// The nodes that cannot be read, and their points.
    pub nodes_missing: usize,
    pub points_missing: u64,
    pub points_resident: u64,
    pub points_total: u64,
    /// The memory of the decoded points.
    pub host_bytes: u64,
    /// Whether an index was made, because none was found.
    pub built_index: bool,
}

/// Reads the inputs and puts them on the GPU. `camera` gets points around the outline of the scene, its up direction,
/// and a camera in the room if the scene is one, and returns the camera. Of streamed clouds, this loads the points that
/// a picture of `size` pixels from that camera needs. `finds_errors` asks how sure the surface is. If no input can be shown, returns the exit status; the reasons
/// have been reported then.
///
/// # Errors
/// Fails if the inputs have no points, if the GPU has no memory left, if how sure a streamed surface is is asked for, or
/// on Ctrl-C.
pub fn open(
    gpu: &Arc<Gpu>,
    mut request: Request,
    settings: &Settings,
    size: [u32; 2],
    finds_errors: bool,
    camera: impl FnOnce(&[DVec3], DVec3, Option<Camera>) -> Camera,
) -> anyhow::Result<Result<LoadedSubject, u8>> {
    let names: Vec<String> = request.inputs.iter().map(Input::name).collect();
    recording::settings(&mut request).clone_from(settings);
    request.leave_out_hidden(world::half_of(settings.stream.host_bytes))?;
    terminal::warn(request.check_filters(settings)?.into_iter().chain(world::stray_warning(settings)));
    let exact = request.built_in().map(Exact::five_mirrors);
    request.lights.extend(request.built_in_light());
    if request.lights.len() > MOST_LIGHTS {
        terminal::warn([format!("only the first {MOST_LIGHTS} lights shine")]);
    }
    let (own, mirrors) = (&request.cloud_settings, &request.mirror_points);
    let asked = world::asked_attributes(settings, &request.visibility, own, mirrors);
    let job = world::start_unseen(std::mem::take(&mut request.inputs), settings, asked.clone());
    let test = request.test().hiding_strays(settings.splat.strays == Strays::Hidden);
    job.mailbox.set_first_test(test.clone(), request.cloud_settings.clone());
    let mut loads = Loads { own: request.cloud_settings.clone(), ..Loads::default() };
    let is_over = loads.receive(&job, 0)?;
    if loads.is_empty() && !loads.failures.is_empty() {
        return Ok(Err(loads.status()));
    }
    if finds_errors {
        surface_error::check(&loads.clouds)?;
    }
    // Clouds of a folder are distinguished by their names.
    let placed = loads.clouds.iter().enumerate().filter_map(|(index, loaded)| Some((index, loaded.placement()?)));
    let placed: BTreeMap<usize, Placement> = placed.collect();
    let is_shown = |loaded: &Assembly| world::own_settings(&request.cloud_settings, loaded).is_none_or(|own| own.on);
    let hidden = loads.clouds.iter().enumerate().filter(|(_, loaded)| !is_shown(loaded));
    let hidden: BTreeSet<usize> = hidden.map(|(index, _)| index).collect();
    for loaded in &mut loads.clouds {
        read_filtered(loaded, &test)?;
        fit_radii(loaded, settings, &test)?;
    }
    loads.failures.extend(read_meshes(&mut request.mirrors, settings));
    let own = loads.mirrors.iter().map(|(mirror, _)| mirror).chain(&request.mirrors);
    let (outline, warnings) =
        world::first_outline(loads.shown(&hidden).map(|loaded| extent(loaded, &test)).collect(), own);
    terminal::warn(param::few(warnings, "warnings about where clouds lie"));
    let Some(up) = loads.shown(&hidden).find(|loaded| loaded.points > 0).map(|loaded| loaded.up) else {
        return Err(usage(format!("{}: no points to show", names.join(", "))));
    };
    let read: Vec<Chunk> = loads.shown(&hidden).flat_map(|loaded| loaded.cloud.chunks.iter().cloned()).collect();
    let mut light = AutoLight::around(&read, up);
    drop(read);
    let camera = camera(&outline, up, light.camera_inside(up));
    if loads.stream.is_some() && !is_over {
        let (view, stream) = (settings.view.clone(), settings.stream.clone());
        let standing = loads.mirrors.iter().map(|(mirror, _)| mirror).chain(&request.mirrors);
        let (hidden, mirrors) = (hidden.clone(), standing.map(mirrors::bound).collect());
        let test = test.clone();
        let view = StreamView {
            camera,
            size,
            view,
            stream,
            mirrors,
            hidden,
            placed,
            test,
            asked,
            share: 1.0,
            is_alone: false,
        };
        let view_number = job.mailbox.set_view(view);
        loads.receive(&job, view_number)?;
    }
    drop(job);
    let status = export::say_missing(loads.missing + loads.missing_of_view, loads.status());
    let unread = loads.unread.max(loads.missing_of_view);
    let Loads { mut clouds, mirrors: mut placed, stream, .. } = loads;
    let is_of_cloud = |own: &&CloudSettings| clouds.iter().any(|cloud| own.is_of(&cloud.input, &cloud.cloud.name));
    let strange = request.cloud_settings.iter().filter(|own| !is_of_cloud(own)).map(world::no_cloud);
    terminal::warn(param::few(strange.collect(), "cloud settings without a cloud"));
    clouds.retain(|loaded| world::own_settings(&request.cloud_settings, loaded).is_none_or(|own| own.on));
    let area = mirrors::area_per_point(clouds.iter().map(|loaded| &loaded.cloud), &test);
    placed.extend(request.mirrors.iter().map(|mirror| (mirror.clone(), mirrors::sample(mirror, area))));
    let chunks: Vec<Chunk> = clouds.iter().flat_map(|loaded| loaded.cloud.shown(&test).chunks).collect();
    if chunks.is_empty() && clouds.iter().any(|loaded| loaded.points > 0) {
        terminal::warn([ALL_HIDDEN]);
    }
    drop(chunks);
    // Hidden points count, so that the light does not change with them.
    let all: Vec<Chunk> = clouds.iter().flat_map(|loaded| loaded.cloud.chunks.iter().cloned()).collect();
    if stream.is_some() {
        // Other points have come for the view.
        light = AutoLight::around(&all, up);
    }
    let has_lamp = request.lights.is_empty();
    if has_lamp {
        request.lights.extend(light.lamp());
    }
    let lights = world::shining(request.lights.clone(), has_lamp, &light, settings.light.by, camera.eye);
    terminal::warn(world::dark_warning(settings.light.by, &lights));
    drop(all);
    let colored = clouds.iter().flat_map(|loaded| {
        let by = world::own_settings(&request.cloud_settings, loaded).and_then(CloudSettings::color_by);
        loaded.cloud.chunks.iter().map(move |chunk| (chunk, by))
    });
    let clues = light.clues(colored, has_lamp);
    let mut resident = Resident::new(gpu.clone());
    resident.apply(Change::Visibility { test: test.clone() })?;
    resident.apply(Change::Expect { points: clouds.iter().map(|loaded| loaded.points).sum() })?;
    let mut parts = Vec::new();
    let units = codec::Units::in_common(clouds.iter().map(|loaded| loaded.units));
    let mut facts = Facts::new(units, up);
    for loaded in &mut clouds {
        if finds_errors {
            surface_error::find(loaded)?;
        }
        let is_of = |points: &&MirrorPoints| points.is_of(&loaded.input, &loaded.cloud.name);
        let reflecting: Vec<&MirrorPoints> = request.mirror_points.iter().filter(is_of).collect();
        let own = world::own_settings(&request.cloud_settings, loaded);
        let shown = upload(&mut resident, loaded, &reflecting, own, settings, &test)?;
        if let Some(part) = shown.first().filter(|_| settings.overlay.legend) {
            let classes = classes(&loaded.cloud.shown(&test));
            facts.add_legend(&loaded.cloud.name, &loaded.input, &part.plan, &loaded.units, classes);
        }
        parts.extend(shown);
    }
    for points in &request.mirror_points {
        if !clouds.iter().any(|loaded| points.is_of(&loaded.input, &loaded.cloud.name)) {
            terminal::warn([format!("mirror points: no cloud is called `{}`", points.cloud)]);
        }
    }
    let (mut mirrors, mut mirror_samples) = (Vec::new(), Vec::new());
    for (index, (mirror, samples)) in placed.into_iter().enumerate() {
        let cloud = CloudKey((clouds.len() + index) as u32);
        resident.apply(Change::Mirror { cloud, mirror: mirror.clone(), samples: samples.clone() })?;
        mirror_samples.push(samples.clone());
        let samples = Cloud { name: mirror.name.clone(), chunks: samples, ..Cloud::default() };
        parts.push(SubjectPart::of_mirror(&mirror, samples));
        mirrors.push(mirror);
    }
    if settings.overlay.labels {
        facts.marks = marks(&request, &clouds, up, &test, &units);
    }
    let errors = finds_errors.then(|| SurfaceErrors::of(&resident, &clouds, &mirror_samples));
    drop(mirror_samples);
    let store = resident.store;
    let subject = Subject { parts, store, mirrors, lights, clues, camera, exact };
    // If some points of a mesh are hidden, its triangles are not what is drawn.
    let is_whole = |loaded: &Assembly| loaded.pages.is_none() && loaded.cloud.shown(&test).len() == loaded.cloud.len();
    let whole = |loaded: &Assembly| loaded.source.clone().filter(|_| is_whole(loaded));
    let sources = clouds.iter().map(whole).collect();
    Ok(Ok(LoadedSubject { subject, status, unread, stream, sources, facts, errors }))
}

/// Where the points of a cloud lie that are shown.
fn extent<'a>(cloud: &'a Assembly, test: &PointTest) -> Extent<'a> {
    let (bounds, outline) = cloud::robust_extent(&cloud.cloud.shown(test).chunks);
    Extent { cloud, bounds, outline }
}

/// The classes that occur in a cloud, in order.
fn classes(cloud: &Cloud) -> impl Iterator<Item = u8> + use<> {
    let column = cloud.class_column();
    let mut occurs = [false; 256];
    for classes in cloud.chunks.iter().filter_map(|chunk| chunk.classes(column)) {
        for class in classes.iter() {
            occurs[usize::from(*class)] = true;
        }
    }
    (0..=255).zip(occurs).filter(|(_, occurs)| *occurs).map(|(class, _)| class)
}

/// The measurements, notes and profiles that are switched on, measured on the points that are loaded.
fn marks(request: &Request, clouds: &[Assembly], up: DVec3, test: &PointTest, units: &codec::Units) -> Vec<Mark> {
    let with_parts = |loaded: &Assembly| (loaded.cloud.clone(), loaded.loaded_parts());
    let measured: Vec<&Measurement> = request.measurements().filter(|measurement| measurement.on).collect();
    let mut is_rough = false;
    let mark = |measurement: &Measurement| {
        let figures = measuring::of_clouds(measurement, up, clouds.iter().map(with_parts).collect(), test);
        is_rough |= figures.as_ref().is_ok_and(|figures| are_of_loaded(figures));
        Mark::of_measurement(measurement, Some(&figures), units)
    };
    let note = |mark: &Object| if let Object::Note(note) = mark { note.on.then(|| Mark::of_note(note)) } else { None };
    let notes = request.marks.iter().filter_map(note);
    let profiles = request.profiles().filter(|profile| profile.on);
    let profiles = profiles.map(|profile| Mark::of_profile(profile, up));
    let marks = measured.into_iter().map(mark).chain(notes).chain(profiles).collect();
    if is_rough {
        terminal::warn([ROUGH_LABELS]);
    }
    marks
}

/// Reads the columns that filters test and that are not in memory.
fn read_filtered(loaded: &mut Assembly, test: &PointTest) -> anyhow::Result<()> {
    if let Some(source) = loaded.source.clone() {
        for column in loaded.cloud.lacks(test) {
            let progress = Progress::default();
            let read = || world::read_column(&source, column, &progress);
            let columns = progress_bar::watch("reading", &progress, read)?;
            drop(loaded.put_late_column(column, columns));
        }
    }
    Ok(())
}

/// Estimates the radii of the shown points again where classes or filters hide others.
fn fit_radii(loaded: &mut Assembly, settings: &Settings, test: &PointTest) -> anyhow::Result<()> {
    let test = test.of_attributes();
    if test.shows_all() || !loaded.has_estimated_radii() {
        return Ok(());
    }
    let progress = Progress::default();
    let own = loaded.with_full_radii();
    let fit = || world::radii_of_shown(&own, loaded.up, loaded.scanner, settings, &test, &progress);
    let radii = progress_bar::watch("radii", &progress, fit);
    interrupt::check()?;
    drop(loaded.put_radii(radii));
    Ok(())
}

/// Reads the meshes of mirrors. A mirror whose mesh cannot be read is reported and left out: returns what is wrong with
/// them, each with whether the input is at fault.
fn read_meshes(mirrors: &mut Vec<Mirror>, settings: &Settings) -> Vec<(String, bool)> {
    let mut failed = Few::of("mirrors whose mesh cannot be read");
    let mut failures = Vec::new();
    mirrors.retain_mut(|mirror| {
        if settings.mirror.surface == MirrorSurface::Exact && !mirror.shape.has_formula() {
            terminal::warn([format!(
                "mirror `{}`: mirror.surface = exact needs a formula, which a mesh lacks, so it is drawn as points",
                mirror.name
            )]);
        }
        match world::with_mesh(mirror.shape.clone()) {
            Ok(shape) => mirror.shape = shape,
            Err(error) => {
                let problem = format!("mirror `{}`: {error}", mirror.name);
                failed.complain(&problem);
                failures.push((problem, true));
                return false;
            }
        }
        true
    });
    failed.end();
    failures
}

/// How long the receiver waits for an event before it looks at the progress again.
const INTERVAL: Duration = Duration::from_millis(100);

/// The inputs that have been loaded so far.
#[derive(Default)]
struct Loads {
    /// What the scene says of single clouds.
    own: Vec<CloudSettings>,
    /// Indexed by the job's own numbers.
    clouds: Vec<Assembly>,
    /// The mirrors of built-in scenes, each with points sampled on its surface.
    mirrors: Vec<(Mirror, Vec<Chunk>)>,
    /// The number of points that tiles of clouds in memory have, and that cannot be read.
    missing: u64,
    /// The same of streamed clouds, of the nodes that the view needs.
    missing_of_view: u64,
    /// The number of points that files announce and do not have, or that cannot be read.
    unread: u64,
    /// What has failed and not come since, and whether the input is at fault. All is reported as it fails.
    failures: Vec<(String, bool)>,
    stream: Option<StreamReport>,
    /// Tasks that were planned and may not be over yet, the next one first.
    tasks: VecDeque<Arc<CloudTask>>,
}

impl Loads {
    fn is_empty(&self) -> bool {
        self.clouds.is_empty() || self.clouds.iter().all(|loaded| loaded.pages.is_some() && loaded.points == 0)
    }

    /// The exit status for what failed. Failed work (status 1) outranks unusable inputs (status 2).
    fn status(&self) -> u8 {
        match self.failures.iter().all(|(_, is_usage)| *is_usage) {
            _ if self.failures.is_empty() && self.missing + self.missing_of_view == 0 => 0,
            true => UNUSABLE,
            false => FAILED,
        }
    }

    /// The clouds but for those that are switched off.
    fn shown(&self, hidden: &BTreeSet<usize>) -> impl Iterator<Item = &Assembly> {
        self.clouds.iter().enumerate().filter(|(index, _)| !hidden.contains(index)).map(|(_, loaded)| loaded)
    }

    /// Receives events until everything is loaded: all points of clouds held in memory, and the points that the view
    /// `view_number` needs of streamed clouds. Returns whether the job is over.
    fn receive(&mut self, job: &Job, view_number: u64) -> anyhow::Result<bool> {
        let mut is_over = false;
        let bar = Bar::points("reading");
        let mut failed = Few::of("that cannot be read");
        let mut waiting = StreamStats::default();
        loop {
            while self.tasks.front().is_some_and(|task| !task.is_pending()) {
                self.tasks.pop_front();
            }
            match self.tasks.front() {
                _ if view_number > 0 => {
                    bar.set_task("pages");
                    bar.set(waiting.points_resident, waiting.points_total);
                }
                Some(task) => bar.show(task, ""),
                None => bar.update(&job.progress),
            }
            if interrupt::is_wanted() {
                job.stop();
            }
            match job.events.recv_timeout(INTERVAL) {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(anyhow!("loading ended before it was done")),
                Ok(Event::Finished) => {
                    is_over = true;
                    break;
                }
                Ok(Event::Stream(stats)) => {
                    waiting = stats;
                    if self.note(stats) && stats.view_number == view_number && !interrupt::is_wanted() {
                        break;
                    }
                }
                Ok(event) => self.take(event, &bar, &mut failed),
            }
        }
        bar.end();
        failed.end();
        interrupt::check()?;
        Ok(is_over)
    }

    /// Records how much of the streamed clouds is loaded. Returns whether that is all that the view needs.
    fn note(&mut self, stats: StreamStats) -> bool {
        let built_index = self.stream.is_some_and(|stream| stream.built_index);
        self.missing_of_view = stats.points_missing;
        self.stream = Some(StreamReport {
            settled: stats.is_settled && stats.nodes_missing == 0,
            nodes: stats.nodes,
            nodes_missing: stats.nodes_missing,
            points_missing: stats.points_missing,
            points_resident: stats.points_resident,
            points_total: stats.points_total,
            host_bytes: stats.host_bytes,
            built_index,
        });
        stats.is_settled
    }

    fn take(&mut self, event: Event, bar: &Bar, failed: &mut Few) {
        let warn = |name: &str, warnings: Vec<String>| {
            let warnings = param::few(warnings, "warnings");
            bar.suspend(|| terminal::warn(warnings.iter().map(|warning| format!("{name}: {warning}"))));
        };
        match event {
            Event::Opened { opened, .. } => {
                warn(&opened.name, opened.warnings.clone());
                self.unread = self.unread.saturating_add(codec::missing_points(&opened.source));
                let key = CloudKey(self.clouds.len() as u32);
                let mut loaded = Assembly::open(key, opened).0;
                // No points are there yet; those that come are moved as they do.
                let placement = world::own_settings(&self.own, &loaded).and_then(CloudSettings::placement);
                drop(loaded.put_moved(loaded.own().placed(placement)));
                self.clouds.push(loaded);
            }
            Event::Task { task, .. } => self.tasks.push_back(task),
            Event::Mirror { mirror, samples, .. } => self.mirrors.push((mirror, samples)),
            // The GPU is filled later, when everything is loaded.
            Event::Chunk { cloud, part, chunk } => drop(self.clouds[cloud].put(part, chunk)),
            Event::Dropped { cloud, part } => drop(self.clouds[cloud].take_out(part)),
            Event::Pages { cloud, pages } => {
                drop(self.clouds[cloud].page(pages));
                self.stream.get_or_insert_default().built_index |= self.clouds[cloud].was_built();
            }
            Event::Read { cloud, summary } => {
                self.unread = self.unread.saturating_add(summary.missing);
                let is_of_tiles = |source: &Arc<codec::Source>| source.info().format == codec::Format::Ept;
                if self.clouds[cloud].source.as_ref().is_some_and(is_of_tiles) {
                    self.missing += summary.missing;
                }
                let new = self.clouds[cloud].end(&summary);
                warn(&self.clouds[cloud].cloud.name, new);
            }
            Event::Surfels { cloud, surfels } => drop(self.clouds[cloud].put_surfels(surfels)),
            Event::Failed { error, is_usage, .. } => {
                bar.suspend(|| failed.complain(&error));
                self.failures.push((error, is_usage));
            }
            Event::Mended { problem, has_come, .. } => {
                if let Some(place) = self.failures.iter().position(|(error, _)| *error == problem) {
                    self.failures.remove(place);
                }
                if has_come {
                    bar.suspend(|| terminal::complain(&format!("no longer so: {problem}")));
                }
            }
            Event::Stream(_) | Event::Finished => {}
        }
    }
}

/// Puts a cloud on the GPU in the colours that the settings, or its own, ask for. Its points that reflect become clouds
/// of their own. Returns the parts that are shown.
fn upload(
    resident: &mut Resident,
    loaded: &mut Assembly,
    reflecting: &[&MirrorPoints],
    own: Option<&CloudSettings>,
    settings: &Settings,
    test: &PointTest,
) -> anyhow::Result<Vec<SubjectPart>> {
    let color = own.map_or_else(|| settings.color.clone(), |own| own.color_of(&settings.color));
    let size = own.map_or(1.0, |own| own.size);
    if color.by == ColorBy::Certainty {
        surface_error::find(loaded)?;
    }
    let plan_of = |loaded: &Assembly| ColorPlan::of_shown(&loaded.cloud, &loaded.cloud.shown(test), &color, loaded.up);
    let (mut plan, mut warning) = plan_of(loaded);
    if let (Some(attribute), Some(source)) = (plan.missing_column(&loaded.cloud), loaded.source.clone()) {
        let progress = Progress::default();
        let read = || world::read_column(&source, attribute, &progress);
        let columns = progress_bar::watch("reading", &progress, read)?;
        drop(loaded.put_late_column(attribute, columns));
        // The range of the values, and whether they differ at all, is known only now.
        (plan, warning) = plan_of(loaded);
    }
    if let Some(warning) = warning {
        terminal::warn([warning]);
    }
    let mut marked = Vec::new();
    for points in reflecting {
        let progress = Progress::default();
        let mark = || mirrors::mark(&loaded.cloud, loaded.source.as_deref(), points, &progress);
        marked.extend(progress_bar::watch("mirror", &progress, mark)?);
    }
    let (cloud, chunks, up) = (loaded.key, loaded.chunks(), loaded.up);
    for change in loaded.changes() {
        let opens = matches!(change, Change::Open { .. });
        resident.apply(change)?;
        if opens {
            resident.apply(Change::Size { cloud, size })?;
        }
    }
    let marked = Arc::new(marked);
    if !marked.is_empty() {
        let (chunks, layout, marked) = (chunks.clone(), loaded.layout(), marked.clone());
        resident.apply(Change::Mark { cloud, chunks, layout, marked })?;
    }
    resident.apply(Change::Color { cloud, chunks, plan: plan.clone(), up })?;
    let part = |(material, chunks): (render::Material, Vec<Chunk>)| SubjectPart {
        cloud: Cloud { chunks, ..loaded.cloud.clone() }.resized(size),
        specular_intensity: material.specular_intensity,
        specular_power: material.specular_power,
        clear: study::clear_points(&material),
        plan: plan.clone(),
        up,
    };
    Ok(mirrors::parts(&loaded.cloud, &marked, test).into_iter().map(part).collect())
}

#[cfg(test)]
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

#[cfg(test)]
mod tests {
    use world::{IndexState, Opened};

    use super::*;

    /// Loads a real file. Prints a note and returns `None` if the folder of real files is missing.
    fn real(name: &str) -> Option<Assembly> {
        let input = Input::File(real_data::test_data()?.join(name));
        // Skip normals and radii, which do not matter here.
        let job = world::start(vec![input], &Settings::default(), BTreeSet::new());
        job.mailbox.stop_all();
        let (mut loads, bar, mut failed) = (Loads::default(), Bar::points("reading"), Few::of("that fail"));
        job.events.iter().for_each(|event| loads.take(event, &bar, &mut failed));
        assert_eq!(loads.status(), 0, "{name}");
        loads.clouds.pop()
    }

    #[test]
    fn what_has_come_after_all_leaves_the_exit_status_of_what_has_not() {
        let mut loads = Loads::default();
        let (bar, mut failed) = (Bar::points("reading"), Few::of("that fail"));
        let input = String::new();
        for (problem, is_usage) in [("a list", true), ("a disk", false)] {
            let event = Event::Failed { input: input.clone(), error: problem.into(), is_usage };
            loads.take(event, &bar, &mut failed);
        }
        assert_eq!(loads.status(), FAILED);
        for (problem, status) in [("a disk", UNUSABLE), ("a warning", UNUSABLE), ("a list", 0)] {
            let event = Event::Mended { input: input.clone(), problem: problem.into(), has_come: true };
            loads.take(event, &bar, &mut failed);
            assert_eq!(loads.status(), status, "{problem}");
        }
    }

    #[test]
    fn the_grid_of_an_index_that_was_just_made_is_that_of_its_cloud() {
        let mut loads = Loads::default();
        let (bar, mut failed) = (Bar::points("reading"), Few::of("that fail"));
        let grid = Some(cloud::Grid::new(DVec3::splat(0.01), DVec3::ZERO));
        let opened = Opened { name: "tiles".into(), expected_points: 1, up: DVec3::Z, ..Opened::default() };
        loads.take(Event::Opened { cloud: 0, opened }, &bar, &mut failed);
        let octree = Arc::new(stream::Octree::new(DVec3::ZERO, 1.0, 0.1, Vec::new()));
        let attributes = Vec::new();
        let pages = IndexState::Indexed { octree, attributes, grid, was_built: true, has_surfels: false, entry: None };
        loads.take(Event::Pages { cloud: 0, pages }, &bar, &mut failed);
        // Without its grid the cloud would not count as a survey, and would get other colours than when its index is
        // found.
        assert_eq!(loads.clouds[0].cloud.grid, grid);
    }

    #[test]
    fn landscapes_forests_and_objects_have_a_sky_and_rooms_a_lamp() {
        let by = Settings::default().light.by;
        for (name, is_room) in [
            ("terrestrial/indoor_office_tls_rgb_las14_pf7.laz", true),
            ("terrestrial/indoor_building_norgb_las12_pf3.laz", true),
            ("terrestrial/pine_plot_tls_las12_pf0.laz", false),
            ("terrestrial/mobile_wall_plane_las12_pf3.laz", false),
            ("airborne/autzen_trim_las12_pf3.laz", false),
            ("airborne/megaplot_forest_las12_pf1.laz", false),
            ("ply/stanford_bunny_full_ascii_mesh.ply", false),
            ("ply/armadillo_points_normals_ascii.ply", false),
            // The file holds half a room, without a ceiling.
            ("ply/office_kinect_rgba_binary_le.ply", false),
        ] {
            let Some(loaded) = real(name) else { return };
            let (up, inside) = (loaded.up, cloud::robust_bounds(&loaded.cloud.chunks).center());
            let light = AutoLight::around(&loaded.cloud.chunks, up);
            assert_eq!((light.sky_is_open(), light.lamp().is_some()), (!is_room, is_room), "{name}");
            if is_room {
                let far = inside + DVec3::splat(1e4);
                assert_eq!([inside, far].map(|eye| light.lamp_shines(by, eye)), [true, false], "{name}");
            }
        }
    }
}
