//! From what a person named to a scene in memory and on the GPU, for pictures without a window.
//!
//! Chunks are put in the order of the file, so that a picture does not depend on which thread was faster.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use anyhow::anyhow;
use cloud::{Chunk, Cloud, Progress};
use glam::DVec3;
use render::{ColorPlan, Gpu, MOST_LIGHTS, PointStore};
use scene::{Camera, Lighting, Mirror, MirrorPoints, Settings, SpotLight, Surroundings};
use serde::Serialize;
use study::{Exact, Part, Subject};
use world::{Event, Input, Job, Paged, Request, Stage, StreamStats, Viewpoint, mirrors};

use crate::failure::usage;
use crate::progress_bar;

/// A scene that was opened.
pub struct Opened {
    pub subject: Subject,
    /// Inputs that could not be read; they have been reported.
    pub failures: usize,
    /// Where clouds are streamed.
    pub stream: Option<StreamReport>,
    /// Of each cloud the file whose points are all in memory, if that is so.
    pub sources: Vec<Option<Arc<codec::Source>>>,
}

/// What was drawn of clouds that are streamed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StreamReport {
    /// All that the view needs was there, as far as the budgets go.
    pub settled: bool,
    pub nodes: usize,
    pub points_resident: u64,
    pub points_total: u64,
    /// Memory of decoded points.
    pub host_bytes: u64,
    /// An index was made and not found.
    pub built_index: bool,
}

/// Reads what is asked for and puts it on the GPU; `camera` is told the outline of it all and which way is up. Of clouds that are
/// streamed it is what a picture of `size` pixels from there needs. `None` if none of the inputs can be read, which has been
/// reported then.
///
/// # Errors
/// Inputs without points, no memory on the GPU.
pub fn open(
    gpu: &Arc<Gpu>,
    mut request: Request,
    settings: &Settings,
    size: [u32; 2],
    camera: impl FnOnce(&[DVec3], DVec3) -> Camera,
) -> anyhow::Result<Option<Opened>> {
    let names: Vec<String> = request.inputs.iter().map(Input::name).collect();
    let exact = request.built_in().map(Exact::five_mirrors);
    request.lights.extend(request.built_in_light());
    if request.lights.len() > MOST_LIGHTS {
        crate::complain(&format!("warning: only the first {MOST_LIGHTS} lights shine"));
    }
    let job = world::start_unseen(std::mem::take(&mut request.inputs), settings);
    let mut loads = Loads::default();
    let is_over = loads.receive(&job, 0)?;
    if loads.is_empty() && loads.failures > 0 {
        return Ok(None);
    }
    let own = loads.mirrors.iter().map(|(mirror, _)| mirror).chain(&request.mirrors);
    let outline = loads.clouds.iter().flat_map(|loaded| cloud::robust_outline(&loaded.cloud.chunks));
    let outline: Vec<DVec3> = outline.chain(own.flat_map(mirrors::outline)).collect();
    let Some(up) = loads.clouds.iter().find(|loaded| !loaded.cloud.is_empty()).map(|loaded| loaded.up) else {
        return Err(usage(format!("{}: no points to show", names.join(", "))));
    };
    let camera = camera(&outline, up);
    if loads.stream.is_some() && !is_over {
        let (view, stream) = (settings.view.clone(), settings.stream.clone());
        let look = job.lookout.look(Viewpoint { camera, size, view, stream, hidden: BTreeSet::new(), share: 1.0 });
        loads.receive(&job, look)?;
    }
    drop(job);
    let Loads { mut clouds, mirrors: mut placed, failures, stream, .. } = loads;
    let area = mirrors::area_per_point(clouds.iter().flat_map(|loaded| &loaded.cloud.chunks));
    placed.extend(request.mirrors.iter().map(|mirror| (mirror.clone(), mirrors::sample(mirror, area))));
    let sky_is_open = find_light(&clouds, up, camera.eye, settings, &mut request.lights);
    let mut store = PointStore::new(gpu.clone());
    store.reserve(clouds.iter().map(|loaded| loaded.cloud.len()).sum());
    let mut parts = Vec::new();
    for loaded in &mut clouds {
        let is_of = |points: &&MirrorPoints| points.is_of(&loaded.input, &loaded.cloud.name);
        let reflecting: Vec<&MirrorPoints> = request.mirror_points.iter().filter(is_of).collect();
        parts.extend(upload(&mut store, loaded, &reflecting, settings)?);
    }
    for points in &request.mirror_points {
        if !clouds.iter().any(|loaded| points.is_of(&loaded.input, &loaded.cloud.name)) {
            crate::complain(&format!("warning: mirror points: no cloud is called `{}`", points.cloud));
        }
    }
    for (mirror, samples) in &placed {
        mirrors::upload(&mut store, mirror, samples)?;
        let samples = Cloud { name: mirror.name.clone(), chunks: samples.clone(), ..Cloud::default() };
        parts.push(Part::of_mirror(mirror, samples));
    }
    let mirrors = placed.into_iter().map(|(mirror, _)| mirror).collect();
    let subject = Subject { parts, store, mirrors, lights: request.lights, sky_is_open, camera, exact };
    let whole = |loaded: &Loaded| loaded.source.clone().filter(|_| loaded.paged.is_none());
    Ok(Some(Opened { subject, failures, stream, sources: clouds.iter().map(whole).collect() }))
}

/// Whether the sky is open above the points, as far as that matters for their light. A room without a light gets a lamp, which
/// of itself shines only while the eye is in the room.
fn find_light(clouds: &[Loaded], up: DVec3, eye: DVec3, settings: &Settings, lights: &mut Vec<SpotLight>) -> bool {
    if !lights.is_empty() || !matches!(settings.light.by, Lighting::Auto | Lighting::Lights) {
        return false;
    }
    let chunks: Vec<Chunk> = clouds.iter().flat_map(|loaded| loaded.cloud.chunks.iter().cloned()).collect();
    match Surroundings::of(cloud::spread_sample(&chunks), up) {
        Surroundings::OpenSky => true,
        Surroundings::Room(room) => {
            lights.extend(room.lamp_shines(settings.light.by, eye).then_some(room.lamp));
            false
        }
    }
}

/// A cloud that is in memory.
struct Loaded {
    cloud: Cloud,
    /// As on the command line or in the scene file.
    input: String,
    source: Option<Arc<codec::Source>>,
    up: DVec3,
    provisional_radius: f32,
    /// Of a streamed cloud: its chunks by their first point, as they come and go.
    paged: Option<BTreeMap<u64, Chunk>>,
}

/// How long the receiver waits before it looks at the progress again.
const INTERVAL: Duration = Duration::from_millis(100);

/// All inputs in memory.
#[derive(Default)]
struct Loads {
    /// Chunks in the order of the file or of the pages, with normals and radii.
    clouds: Vec<Loaded>,
    /// Of built-in scenes, and the points that stand for them.
    mirrors: Vec<(Mirror, Vec<Chunk>)>,
    /// Inputs that failed; they are reported as they fail.
    failures: usize,
    stream: Option<StreamReport>,
    /// What was planned and may not be over yet, the next first.
    stages: VecDeque<Arc<Stage>>,
}

impl Loads {
    fn is_empty(&self) -> bool {
        self.clouds.is_empty() || self.clouds.iter().all(|loaded| loaded.paged.as_ref().is_some_and(BTreeMap::is_empty))
    }

    /// Takes in what comes until all is there: all of what is held in memory, and what that look needs of what is streamed.
    fn receive(&mut self, job: &Job, look: u64) -> anyhow::Result<bool> {
        let mut is_over = false;
        let bar = progress_bar::points("reading");
        let mut waiting = StreamStats::default();
        loop {
            while self.stages.front().is_some_and(|stage| !stage.is_pending()) {
                self.stages.pop_front();
            }
            match self.stages.front() {
                _ if look > 0 => {
                    bar.set_message("pages");
                    bar.set_position(waiting.points_resident);
                }
                Some(stage) => progress_bar::show(&bar, stage, ""),
                None => progress_bar::update(&bar, &job.progress),
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
                    if self.note(stats) && stats.look == look {
                        break;
                    }
                }
                Ok(event) => self.take(event, &bar),
            }
        }
        bar.finish_and_clear();
        for loaded in &mut self.clouds {
            if let Some(paged) = &loaded.paged {
                loaded.cloud.chunks = paged.values().cloned().collect();
            }
        }
        Ok(is_over)
    }

    /// Keeps what is there of what is streamed; whether that is all.
    fn note(&mut self, stats: StreamStats) -> bool {
        let built_index = self.stream.is_some_and(|stream| stream.built_index);
        self.stream = Some(StreamReport {
            settled: stats.is_settled,
            nodes: stats.nodes,
            points_resident: stats.points_resident,
            points_total: stats.points_total,
            host_bytes: stats.host_bytes,
            built_index,
        });
        stats.is_settled
    }

    fn take(&mut self, event: Event, bar: &indicatif::ProgressBar) {
        let warn = |name: &str, warnings: &[String]| {
            for warning in warnings {
                bar.suspend(|| crate::complain(&format!("warning: {name}: {warning}")));
            }
        };
        match event {
            Event::Opened { name, input, source, attributes, grid, up, provisional_radius, warnings, .. } => {
                warn(&name, &warnings);
                let cloud = Cloud { name, attributes, grid, chunks: Vec::new() };
                self.clouds.push(Loaded { cloud, input, source, up, provisional_radius, paged: None });
            }
            Event::Stage { stage, .. } => self.stages.push_back(stage),
            Event::Mirror { mirror, samples, .. } => self.mirrors.push((mirror, samples)),
            Event::Chunk { cloud, chunk } => {
                let Loaded { cloud, paged, .. } = &mut self.clouds[cloud];
                match paged {
                    Some(paged) => drop(paged.insert(chunk.first_point, chunk)),
                    None => cloud.chunks.push(chunk),
                }
            }
            Event::Pages { cloud, pages } => {
                let loaded = &mut self.clouds[cloud];
                loaded.paged.get_or_insert_default();
                if let Paged::Indexed { grid, .. } = &pages {
                    loaded.cloud.grid = *grid;
                }
                if let Paged::Indexed { was_built, .. } = pages {
                    self.stream.get_or_insert_default().built_index |= was_built;
                }
            }
            Event::Dropped { cloud, first_point } => {
                self.clouds[cloud].paged.iter_mut().for_each(|paged| drop(paged.remove(&first_point)));
            }
            Event::Read { cloud, summary } => {
                let Loaded { cloud, source, paged, .. } = &mut self.clouds[cloud];
                let opened = source.as_ref().map(|source| source.info().warnings.clone()).unwrap_or_default();
                let new: Vec<String> =
                    summary.warnings.into_iter().filter(|warning| !opened.contains(warning)).collect();
                if paged.is_none() {
                    cloud.chunks.sort_by_key(|chunk| chunk.first_point);
                }
                warn(&cloud.name, &new);
            }
            Event::Surfels { cloud, surfels } => {
                for (chunk, surfels) in self.clouds[cloud].cloud.chunks.iter_mut().zip(surfels) {
                    chunk.normals = Some(Arc::new(surfels.normals));
                    chunk.radii = Some(Arc::new(surfels.radii));
                }
            }
            Event::Failed { error, .. } => {
                self.failures += 1;
                bar.suspend(|| crate::complain(&error));
            }
            Event::Stream(_) | Event::Finished => {}
        }
    }
}

/// Puts a cloud on the GPU in the colours that the settings ask for, and those of its points that reflect as clouds of their
/// own; gives back what it put there.
fn upload(
    store: &mut PointStore,
    loaded: &mut Loaded,
    reflecting: &[&MirrorPoints],
    settings: &Settings,
) -> anyhow::Result<Vec<Part>> {
    let (plan, warning) = ColorPlan::new(&loaded.cloud, &settings.color, loaded.up);
    if let Some(warning) = warning {
        crate::complain(&format!("warning: {warning}"));
    }
    if let (Some(attribute), Some(source)) = (plan.missing_column(&loaded.cloud), &loaded.source) {
        let progress = Progress::default();
        let mut columns =
            progress_bar::watch("reading", &progress, || world::read_column(source, attribute, &progress))?;
        for chunk in &mut loaded.cloud.chunks {
            chunk.columns[attribute] = columns.remove(&chunk.first_point);
        }
    }
    let mut marked = Vec::new();
    for points in reflecting {
        let progress = Progress::default();
        let mark = || mirrors::mark(&loaded.cloud, loaded.source.as_deref(), points, &progress);
        marked.extend(progress_bar::watch("mirror", &progress, mark).map_err(|error| usage(format!("{error:#}")))?);
    }
    let mut parts: Vec<(render::Material, Vec<Chunk>)> = vec![(render::Material::default(), Vec::new())];
    parts.extend(marked.iter().map(|marked| (marked.material, Vec::new())));
    for (index, chunk) in loaded.cloud.chunks.iter().enumerate() {
        let parted = mirrors::part(chunk, index, &marked);
        let reflecting = parted.reflecting.into_iter().map(|(taken, _)| taken);
        for ((_, chunks), part) in parts.iter_mut().zip(std::iter::once(parted.rest).chain(reflecting)) {
            chunks.push(part);
        }
    }
    let classification = loaded.cloud.attributes.iter().position(|attribute| attribute.name == "classification");
    let mut uploaded = Vec::new();
    for (material, mut chunks) in parts {
        chunks.retain(|chunk| !chunk.is_empty());
        let id = store.add_cloud(material);
        store.set_provisional_radius(id, loaded.provisional_radius);
        let mut ids = Vec::with_capacity(chunks.len());
        for chunk in &chunks {
            let classes = classification.and_then(|index| chunk.columns.get(index)?.as_deref());
            let classes = if let Some(cloud::Column::U8(classes)) = classes { Some(classes.as_slice()) } else { None };
            ids.push(store.add_chunk(id, chunk, classes)?);
        }
        let cloud = Cloud {
            name: loaded.cloud.name.clone(),
            attributes: loaded.cloud.attributes.clone(),
            grid: loaded.cloud.grid,
            chunks,
        };
        store.set_color(id, &cloud, &ids, &plan, loaded.up)?;
        let render::Material { specular_intensity, specular_power, .. } = material;
        uploaded.push(Part { cloud, specular_intensity, specular_power, plan: plan.clone(), up: loaded.up });
    }
    Ok(uploaded)
}

#[cfg(test)]
#[path = "../../tests/src/real_data.rs"]
mod real_data;

#[cfg(test)]
mod tests {
    use super::*;

    /// `None`, with a note, where the real files are not.
    fn real(name: &str) -> Option<Loaded> {
        let input = Input::File(real_data::test_data()?.join(name));
        // Without normals and radii, which do not matter here.
        let job = world::start(vec![input], &Settings::default());
        job.lookout.stop_all();
        let mut loaded: Option<Loaded> = None;
        for event in &job.events {
            match event {
                Event::Opened { name, input, source, attributes, grid, up, provisional_radius, .. } => {
                    let cloud = Cloud { name, attributes, grid, chunks: Vec::new() };
                    loaded = Some(Loaded { cloud, input, source, up, provisional_radius, paged: None });
                }
                Event::Chunk { chunk, .. } => {
                    loaded.iter_mut().for_each(|loaded| loaded.cloud.chunks.push(chunk.clone()))
                }
                Event::Failed { error, .. } => panic!("{error}"),
                _ => {}
            }
        }
        loaded
    }

    #[test]
    fn the_grid_of_an_index_that_was_just_made_is_that_of_its_cloud() {
        let mut loads = Loads::default();
        let bar = indicatif::ProgressBar::hidden();
        let grid = Some(cloud::Grid { scale: DVec3::splat(0.01), offset: DVec3::ZERO });
        let opened = Event::Opened {
            cloud: 0,
            name: "tiles".into(),
            input: "tiles".into(),
            source: None,
            attributes: Vec::new(),
            grid: None,
            expected_points: 1,
            up: DVec3::Z,
            provisional_radius: 0.0,
            warnings: Vec::new(),
        };
        loads.take(opened, &bar);
        let octree = Arc::new(stream::Octree { corner: DVec3::ZERO, width: 1.0, spacing: 0.1, nodes: Vec::new() });
        let pages = Paged::Indexed { octree, grid, was_built: true, has_surfels: false, kept: None };
        loads.take(Event::Pages { cloud: 0, pages }, &bar);
        // Without one the cloud is no survey, and is coloured otherwise than when its index is found.
        assert_eq!(loads.clouds[0].cloud.grid, grid);
    }

    #[test]
    fn landscapes_forests_and_objects_have_a_sky_and_rooms_a_lamp() {
        let settings = Settings::default();
        for (name, is_room) in [
            ("terrestrial/indoor_office_tls_rgb_las14_pf7.laz", true),
            ("terrestrial/indoor_building_norgb_las12_pf3.laz", true),
            ("terrestrial/pine_plot_tls_las12_pf0.laz", false),
            ("terrestrial/mobile_wall_plane_las12_pf3.laz", false),
            ("airborne/autzen_trim_las12_pf3.laz", false),
            ("airborne/megaplot_forest_las12_pf1.laz", false),
            ("ply/stanford_bunny_full_ascii_mesh.ply", false),
            ("ply/armadillo_points_normals_ascii.ply", false),
            // Half a room: there is no ceiling.
            ("ply/office_kinect_rgba_binary_le.ply", false),
        ] {
            let Some(loaded) = real(name) else { return };
            let (up, inside) = (loaded.up, cloud::robust_bounds(&loaded.cloud.chunks).center());
            let clouds = [loaded];
            let mut lights = Vec::new();
            assert_eq!(find_light(&clouds, up, inside, &settings, &mut lights), !is_room, "{name}");
            assert_eq!(lights.len(), usize::from(is_room), "{name}");
            let mut outside = Vec::new();
            find_light(&clouds, up, inside + DVec3::splat(1e4), &settings, &mut outside);
            assert_eq!(outside, []);
        }
    }
}
