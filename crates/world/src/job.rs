//! Loads in the background: a thread reads the inputs and sends events, first every header, then chunks, and after all
//! clouds the normals and radii that were missing. The channel is bounded, so a slow receiver holds the readers back
//! and the memory stays at what the receiver keeps.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex};

use cloud::Progress;
use scene::Settings;
use stream::Cache;

use crate::cache::cache;
use crate::director::Director;
use crate::error::Result;
use crate::event::Event;
use crate::indexing::StreamedInput;
use crate::input::Input;
use crate::loader::Loader;
use crate::mailbox::Mailbox;
use crate::reading::Loading;
use crate::source::parts;
use crate::tiles::Tiles;

/// The number of chunks on their way from the readers to the receiver: enough that neither waits for the other, and at
/// 65 thousand points of some 30 bytes each no more than 32 MB.
const CHUNKS_UNDER_WAY: usize = 16;

/// A loading job. Dropping it stops it.
pub struct Job {
    pub events: Receiver<Event>,
    /// The points read, of all inputs that are held in memory. Cancelling it ends the reading; chunks that were sent
    /// stay and get normals and radii.
    pub progress: Arc<Progress>,
    /// Gives the threads the view to stream for, and requests.
    pub mailbox: Arc<Mailbox>,
}

impl Job {
    /// Ends everything in progress; when its remains have been cleared away, `Event::Finished` is sent.
    pub fn stop(&self) {
        self.mailbox.end();
        self.progress.cancel();
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Loads `inputs` on a background thread. It uses the groups `view` (up axis, point budget), `color` (which attribute
/// to read), `stream`, `surface` and `scene` of `settings`. Streamed clouds keep the attributes that are `asked` for,
/// besides the usual ones (`asked_attributes`).
pub fn start(inputs: Vec<Input>, settings: &Settings, asked: BTreeSet<String>) -> Job {
    start_with(inputs, settings, asked, true, cache(&settings.stream))
}

/// Starts a job without previews of clouds whose index is being made, for callers that would not show them.
pub fn start_unseen(inputs: Vec<Input>, settings: &Settings, asked: BTreeSet<String>) -> Job {
    start_with(inputs, settings, asked, false, cache(&settings.stream))
}

/// Starts a job with a cache of indexes.
fn start_with(
    inputs: Vec<Input>,
    settings: &Settings,
    asked: BTreeSet<String>,
    has_preview: bool,
    cache: Result<Cache>,
) -> Job {
    let (sender, events) = sync_channel(CHUNKS_UNDER_WAY);
    let progress = Arc::new(Progress::default());
    let mailbox = Arc::new(Mailbox::default());
    let job = Job { events, progress: progress.clone(), mailbox: mailbox.clone() };
    let (sender_of_loader, settings) = (sender.clone(), settings.clone());
    let cache = cache.map_err(|error| error.to_string());
    let loader =
        Loader { sender: sender_of_loader, progress, mailbox, settings, has_preview, cache, also: Mutex::new(asked) };
    // A pool of its own: readers that wait for room in the channel must not delay the receiver's parallel work.
    let started = rayon::ThreadPoolBuilder::new()
        .thread_name(|index| format!("loader {index}"))
        .build()
        .map_err(|error| error.to_string())
        .and_then(|pool| {
            let work = move || pool.install(|| loader.load(&inputs));
            std::thread::Builder::new().name("loading".into()).spawn(work).map_err(|error| error.to_string())
        });
    if let Err(error) = started {
        // There is room for both: nothing else has been sent.
        let _ = sender.try_send(Event::Failed { input: "loading".into(), error, is_usage: false });
        let _ = sender.try_send(Event::Finished);
    }
    job
}

impl Loader {
    fn load(&self, inputs: &[Input]) {
        let _ = self.load_all(inputs);
        let _ = self.sender.send(Event::Finished);
    }

    /// Sets the total of the progress to that of the files that are not read yet, besides the points that are there.
    fn expect(&self, opened: &[Loading]) {
        let left = opened.iter().filter(|loading| !loading.is_read).map(|loading| loading.source.info().points);
        self.progress.set_total(self.progress.done() + left.sum::<u64>());
    }

    fn load_all(&self, inputs: &[Input]) -> Option<()> {
        let (mut opened, mut streamed, mut tiles) = (Vec::new(), Vec::new(), Vec::new());
        // The number of clouds so far, and the memory in bytes of those that are to be held in memory.
        let (mut clouds, mut held) = (0, 0);
        // A server may be silent for a long time: what is on this machine is shown before.
        let (near, far): (Vec<&Input>, Vec<&Input>) = inputs.iter().partition(|input| !input.is_far());
        let reads_first = !far.is_empty();
        for (place, input) in near.iter().chain(&far).enumerate() {
            if reads_first && place == near.len() {
                self.expect(&opened);
                opened.iter_mut().try_for_each(|loading| self.read(loading))?;
            }
            match input {
                Input::File(_) | Input::Tiles { .. }
                    if let Some(found) = Tiles::of(input, clouds, &self.settings, self.also()) =>
                {
                    self.send(Event::Opened { cloud: clouds, opened: found.opened() })?;
                    self.send(Event::Pages { cloud: clouds, pages: found.state(BTreeMap::new()) })?;
                    tiles.push(found);
                    clouds += 1;
                }
                Input::File(_) | Input::Tiles { .. } => {
                    let sources = self.open(input)?;
                    if self.is_streamed(&sources, &mut held) {
                        let parts = parts(sources, &self.also());
                        let is_all = parts.len() == 1;
                        for part in parts {
                            streamed.push(self.begin_streamed(input, part, is_all, clouds)?);
                            clouds += 1;
                        }
                    } else {
                        for source in sources {
                            opened.push(self.begin(source, clouds)?);
                            clouds += 1;
                        }
                    }
                }
                Input::BuiltIn { variant, without } => self.sample(*variant, without, &mut clouds)?,
                Input::Unknown { name, error } => {
                    self.send(Event::Failed { input: name.clone(), error: error.clone(), is_usage: true })?;
                }
            }
        }
        self.expect(&opened);
        if streamed.is_empty() && tiles.is_empty() {
            return self.read_all(opened);
        }
        let stopped = |error: std::io::Error| {
            let (input, error) = ("streaming".into(), error.to_string());
            Event::Failed { input, error, is_usage: false }
        };
        let is_far = streamed.iter().any(StreamedInput::is_far) || tiles.iter().any(Tiles::is_far);
        let has_tiles = !tiles.is_empty();
        let director = match Director::new(self.mailbox.clone(), self.sender.clone(), &self.settings, is_far) {
            Ok(director) => director.with_tiles(tiles),
            Err(error) => return self.send(stopped(error)),
        };
        std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name("streaming".into());
            if let Err(error) = thread.spawn_scoped(scope, || director.run()) {
                return self.send(stopped(error));
            }
            let done = self.stream_all(streamed, has_tiles, opened);
            self.mailbox.end();
            done
        })
    }
}

#[cfg(test)]
#[path = "job_streamed_tests.rs"]
mod streamed_tests;

#[cfg(test)]
#[path = "job_kept_tests.rs"]
mod kept_tests;

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use cloud::Chunk;
    use glam::DVec3;
    use scene::five_mirrors;

    use super::*;
    use crate::chunk_key::Part;
    use crate::task::TaskKind;

    const THREE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar intensity\nend_header\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";

    #[test]
    fn a_file_comes_in_as_header_chunks_and_the_surfels_it_lacks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        std::fs::write(&path, THREE_POINTS).unwrap();
        let missing = Input::File(folder.path().join("gone.ply"));
        let job = start(vec![missing, Input::File(path)], &Settings::default(), BTreeSet::new());
        let mut seen = Vec::new();
        for event in &job.events {
            seen.push(match event {
                Event::Failed { input, .. } => {
                    assert!(input.ends_with("gone.ply"));
                    "failed"
                }
                Event::Opened { cloud, opened } => {
                    assert_eq!((cloud, opened.expected_points, opened.up), (0, 3, DVec3::Z));
                    "opened"
                }
                Event::Chunk { chunk, .. } => {
                    assert_eq!(chunk.len(), 3);
                    assert!(chunk.columns[0].is_some(), "intensity is read without being asked for");
                    "chunk"
                }
                Event::Read { summary, .. } => {
                    assert_eq!(summary.points, 3);
                    "read"
                }
                Event::Mirror { .. } => panic!("there is none"),
                Event::Surfels { surfels, .. } => {
                    assert_eq!(surfels.iter().map(|surfels| surfels.normals.len()).collect::<Vec<_>>(), [3]);
                    "surfels"
                }
                Event::Task { cloud, task } => {
                    assert_eq!((cloud, task.kind, task.points()), (0, TaskKind::Surfels, 3));
                    "task"
                }
                Event::Pages { .. } | Event::Dropped { .. } | Event::Stream(_) | Event::Mended { .. } => "streamed",
                Event::Finished => "finished",
            });
        }
        assert_eq!(seen, ["failed", "opened", "chunk", "read", "task", "surfels", "finished"]);
        assert_eq!((job.progress.done(), job.progress.total()), (3, 3));
    }

    #[test]
    fn a_mesh_comes_in_with_points_between_its_vertices() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("square.ply");
        let chunks_of = |face: &str, mesh_points: u32| {
            let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                property uchar intensity\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
            std::fs::write(&path, format!("{header}0 0 0 7\n3 0 0 8\n3 1 0 9\n0 1 0 9\n{face}\n")).unwrap();
            let mut settings = Settings::default();
            settings.surface.mesh_points = mesh_points;
            let job = start(vec![Input::File(path.clone())], &settings, BTreeSet::new());
            let (mut chunks, mut seen) = (Vec::new(), Vec::new());
            for event in &job.events {
                match event {
                    Event::Chunk { part, chunk, .. } => {
                        assert_eq!(part, Part::Block(chunk.first_point));
                        chunks.push(chunk);
                    }
                    Event::Read { summary, .. } => assert_eq!(summary.points, 4),
                    Event::Surfels { surfels, .. } => {
                        assert_eq!(surfels.iter().map(|surfels| surfels.radii.len()).collect::<Vec<_>>(), [4]);
                        seen.push("surfels");
                    }
                    Event::Task { .. } => seen.push("task"),
                    _ => {}
                }
            }
            (chunks, seen)
        };
        let (chunks, seen) = chunks_of("4 0 1 2 3", 1000);
        assert_eq!((chunks.iter().map(Chunk::len).collect::<Vec<_>>(), seen), (vec![4, 1000], vec!["surfels"]));
        assert_eq!((chunks[1].first_point, chunks[1].corners.is_some()), (4, true));
        let intensity = |index| chunks[1].columns[0].as_ref().unwrap().value(index);
        let x = |index: usize| chunks[1].origin.x + f64::from(chunks[1].positions[index][0]);
        let right = (0..1000).filter(|index| x(*index) > 1.6 && intensity(*index) > 7.0).count();
        assert!((400..540).contains(&right), "{right} of 1000 points lie right of the middle");
        // A mesh may show its vertices alone: nothing is asked for beyond them, or its faces are not known.
        for (face, mesh_points) in [("4 0 1 2 3", 0), ("4 0 1 2 3", 4), ("4 0 1 2 9", 1000), ("2 0 1", 1000)] {
            let (chunks, seen) = chunks_of(face, mesh_points);
            assert_eq!((chunks.len(), chunks[0].len(), seen), (1, 4, vec!["task", "surfels"]), "{face}, {mesh_points}");
        }
    }

    #[test]
    fn a_built_in_scene_has_as_many_points_as_asked_for() {
        let mut settings = Settings::default();
        settings.scene.points = 200_000;
        let input = Input::BuiltIn { variant: five_mirrors::Variant::Sphere, without: Vec::new() };
        let job = start(vec![input], &settings, BTreeSet::new());
        let (mut points, mut mirrors) = (0, 0);
        for event in &job.events {
            match event {
                Event::Opened { .. } => {}
                Event::Mirror { mirror, samples, .. } => {
                    assert_eq!((mirror.name.as_str(), mirror.specular_intensity), ("sphere", 1.0));
                    mirrors += 1;
                    points += samples.iter().map(Chunk::len).sum::<usize>();
                }
                Event::Chunk { chunk, .. } => points += chunk.len(),
                Event::Task { .. } | Event::Surfels { .. } | Event::Failed { .. } => {
                    panic!("its points are complete")
                }
                Event::Read { .. } | Event::Finished => {}
                Event::Pages { .. } | Event::Dropped { .. } | Event::Stream(_) | Event::Mended { .. } => {
                    panic!("nothing is streamed")
                }
            }
        }
        assert_eq!((points, mirrors), (200_000, 1));
    }

    #[test]
    fn a_made_scan_comes_without_normals_and_radii_and_gets_them() {
        let mut settings = Settings::default();
        settings.scene.points = 5000;
        let variant = five_mirrors::Variant::Tripod(scene::Tripod::Room);
        let job = start(vec![Input::BuiltIn { variant, without: Vec::new() }], &settings, BTreeSet::new());
        let (mut points, mut estimated, mut mirrors) = (0, 0, 0);
        for event in &job.events {
            match event {
                Event::Opened { opened, .. } => {
                    assert_eq!((opened.up, opened.name.as_str()), (DVec3::Z, "tripod/room, walls"));
                    assert!(opened.provisional_radius > 0.0);
                }
                Event::Chunk { chunk, .. } => {
                    assert!(chunk.radii.is_none() && chunk.colors.is_some());
                    points += chunk.len();
                }
                Event::Surfels { surfels, .. } => {
                    estimated += surfels.iter().map(|surfels| surfels.radii.len()).sum::<usize>();
                }
                Event::Mirror { .. } => mirrors += 1,
                Event::Failed { error, .. } => panic!("{error}"),
                _ => {}
            }
        }
        assert!(points > 4500 && estimated == points && mirrors == 3, "{points}, {estimated}, {mirrors}");
    }

    #[test]
    fn a_dropped_job_ends_its_thread() {
        let mut settings = Settings::default();
        // More chunks than the channel holds, so that the thread waits for room when the job is dropped.
        settings.scene.points = 2_000_000;
        let input = Input::BuiltIn { variant: five_mirrors::Variant::Sphere, without: Vec::new() };
        let job = start(vec![input], &settings, BTreeSet::new());
        let progress = job.progress.clone();
        assert!(job.events.recv().is_ok());
        drop(job);
        assert!(progress.is_cancelled());
        let deadline = Instant::now() + Duration::from_secs(60);
        while Arc::strong_count(&progress) > 1 {
            assert!(Instant::now() < deadline, "the thread is still there");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
