//! Pictures along a camera path, as `glint record` and `glint render --path` make them. Each is the picture that the
//! window shows when the camera rests there: all points that the view needs are loaded, and the quality is full. It
//! depends on its own time alone, and not on which pictures were made before it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use glam::DVec3;
use record::{Average, Averaging};
use render::{Aov, Gpu};
use scene::{BuiltInPath, Camera, CameraPath, ExposureFit, Motion, PathPlace, SceneFile, Settings, Shape, View};
use world::{Input, Request};

use crate::system::failure::usage;
use crate::system::progress_bar::Bar;
use crate::system::{interrupt, picture_file, terminal};
use crate::viewer::{Headless, Over, Picture, PictureStats};

/// The time between opening a scene, which moves the camera, and the beginning of the path. By then the camera rests.
const REST: Duration = Duration::from_secs(1);
/// The bytes of a sample of a cloud's file, and the number of samples: together they tell a changed scan from another.
const SAMPLE_BYTES: usize = 64 << 10;
const SAMPLES: u64 = 16;

/// The path of a recording.
#[derive(Clone, Debug)]
pub enum PathChoice {
    /// A path of a scene file.
    Own(CameraPath),
    /// A path that follows from what is shown.
    BuiltIn(BuiltInPath),
}

impl PathChoice {
    /// The path of this name, or the scene's only one. `scene` is the word that names the scene.
    ///
    /// # Errors
    /// No path has the name; or none is named, and the scene has none or several.
    pub fn new(wanted: Option<&str>, request: &Request, scene: &Path) -> anyhow::Result<Self> {
        let built_in = BuiltInPath::ALL.map(BuiltInPath::name);
        let names: Vec<&str> = request.paths.iter().map(|path| path.name.as_str()).chain(built_in).collect();
        let available = names.join(", ");
        match (wanted, request.paths.as_slice()) {
            (Some(wanted), paths) => {
                let own = paths.iter().find(|path| path.name == wanted).cloned().map(Self::Own);
                own.or_else(|| BuiltInPath::named(wanted).map(Self::BuiltIn))
                    .ok_or_else(|| usage(format!("--path: `{wanted}` is unknown; available: {available}")))
            }
            (None, [only]) => Ok(Self::Own(only.clone())),
            (None, []) => Err(usage(format!(
                "{}: it has no camera path; name a built-in one with --path ({available}), or add one to a scene file \
                 under [[paths]] (docs/scenes.md)",
                scene::shown(scene)
            ))),
            (None, _) => Err(usage(format!("--path: there are several, name one of them: {available}"))),
        }
    }

    pub fn name(&self) -> &str {
        match self {
            Self::Own(path) => &path.name,
            Self::BuiltIn(path) => path.name(),
        }
    }

    /// How long the path lasts in seconds.
    pub fn duration(&self) -> f64 {
        match self {
            Self::Own(path) => path.duration(),
            Self::BuiltIn(_) => BuiltInPath::SECONDS,
        }
    }

    /// Refuses float images of a path whose pictures show several states.
    ///
    /// # Errors
    /// There are such images: bad usage.
    pub fn check_images(&self, count: usize) -> anyhow::Result<()> {
        match self {
            Self::Own(path) if count > 0 && !path.states.is_empty() => Err(usage(format!(
                "--aov: float images are of one state, and path `{}` wipes between several",
                path.name
            ))),
            _ => Ok(()),
        }
    }

    /// The path over a place.
    fn over(&self, place: &PathPlace) -> CameraPath {
        match self {
            Self::Own(path) => path.clone(),
            Self::BuiltIn(path) => path.path(place),
        }
    }

    /// The camera at the beginning of the path over a place.
    pub fn first(&self, place: &PathPlace) -> Camera {
        Motion::new(&self.over(place)).map_or(place.view, |motion| motion.camera(0.0))
    }

    /// A checksum of the scene that the path leads through: of what scene files say, and of samples of the clouds and
    /// meshes. It does not depend on the folders in which they lie.
    pub fn checksum(&self, request: &Request) -> String {
        let name = |path: &str| Path::new(path).file_name().map_or(path.to_owned(), scene::shown);
        // Bookmarks and other paths are in no picture.
        let Request {
            inputs,
            scene_files: _,
            view,
            mirrors,
            mirror_points,
            cloud_settings,
            lights,
            visibility,
            clips,
            marks,
            bookmarks: _,
            paths: _,
            warnings: _,
            names: _,
        } = request.clone();
        let camera = view.and_then(|view| view.camera);
        let mut file = SceneFile {
            camera,
            visibility,
            clips,
            mirrors,
            lights,
            mirror_points,
            cloud_settings,
            ..SceneFile::default()
        };
        marks.into_iter().for_each(|mark| file.add(mark));
        if let Self::Own(path) = self {
            file.paths = vec![path.clone()];
        }
        let mut meshes = Vec::new();
        for mirror in &mut file.mirrors {
            if let Shape::Mesh(mesh) = &mut mirror.shape {
                meshes.extend(mesh.is_file().then(|| mesh.name.clone()));
                mesh.name = name(&mesh.name);
            }
        }
        file.mirror_points.iter_mut().for_each(|points| points.cloud = name(&points.cloud));
        file.cloud_settings.iter_mut().for_each(|own| own.cloud = name(&own.cloud));
        let mut sum = crc32fast::Hasher::new();
        sum.update(file.to_text().as_bytes());
        for mesh in &meshes {
            add_samples(&mut sum, Path::new(mesh));
        }
        for input in &inputs {
            sum.update(name(&input.name()).as_bytes());
            for path in input.files() {
                add_samples(&mut sum, path);
            }
        }
        format!("{:08x}", sum.finalize())
    }
}

/// Checksums of the files that a scene is read from, by their names without folders: of scene files, and of samples of
/// clouds and meshes. The tiles of a catalogue have one of their own, as do the names and lengths of those of EPT. Checksums
/// of files that cannot be read now are empty. Tiles on servers are not looked at.
///
/// # Errors
/// Ctrl-C.
pub fn checksums(request: &Request) -> anyhow::Result<BTreeMap<String, String>> {
    let mut sums = BTreeMap::<String, Option<crc32fast::Hasher>>::new();
    let name = |path: &Path| path.file_name().map_or_else(|| scene::shown(path), scene::shown);
    for (path, text) in &request.scene_files {
        let sum = sums.entry(name(path)).or_insert_with(|| Some(crc32fast::Hasher::new()));
        sum.iter_mut().for_each(|sum| sum.update(text.as_bytes()));
    }
    let meshes = request.mirrors.iter().filter_map(|mirror| match &mirror.shape {
        Shape::Mesh(mesh) if mesh.is_file() => Some(Path::new(&mesh.name)),
        _ => None,
    });
    let mut add = |name: String, add_to: &dyn Fn(&mut crc32fast::Hasher) -> bool| {
        let sum = sums.entry(name).or_insert_with(|| Some(crc32fast::Hasher::new()));
        if !sum.as_mut().is_some_and(add_to) {
            *sum = None;
        }
        interrupt::check()
    };
    for path in request.inputs.iter().flat_map(Input::files).map(PathBuf::as_path).chain(meshes) {
        add(name(path), &|sum| add_samples(sum, path))?;
        let of_tiles = name(path) + study::OF_TILES;
        for tile in codec::tiles_of(path).ok().flatten().unwrap_or_default() {
            if !codec::is_address(&tile.path) {
                add(of_tiles.clone(), &|sum| add_samples(sum, &tile.path))?;
            }
        }
        if path.file_name().is_some_and(|name| name == "ept.json") && !codec::is_address(path) {
            add(of_tiles, &|sum| {
                add_ept_tiles(sum, path);
                true
            })?;
        }
    }
    let text = |sum: Option<crc32fast::Hasher>| sum.map_or_else(String::new, |sum| format!("{:08x}", sum.finalize()));
    Ok(sums.into_iter().map(|(name, sum)| (name, text(sum))).collect())
}

/// Adds the length of a file and samples of it. Returns whether it can be read; of one that cannot, nothing is drawn.
fn add_samples(sum: &mut crc32fast::Hasher, path: &Path) -> bool {
    let Ok(bytes) = codec::Bytes::open(path) else { return false };
    sum.update(&bytes.length().to_le_bytes());
    let last = bytes.length().saturating_sub(SAMPLE_BYTES as u64);
    let mut sample = vec![0; SAMPLE_BYTES];
    for index in 0..SAMPLES {
        let start = (u128::from(last) * u128::from(index) / u128::from(SAMPLES - 1)) as u64;
        let Ok(count) = bytes.read_at(start, &mut sample) else { return false };
        sum.update(&sample[..count]);
    }
    true
}

/// Adds the names and lengths of the tiles of an EPT, and of the lists of them, from beside its `ept.json`.
fn add_ept_tiles(sum: &mut crc32fast::Hasher, path: &Path) {
    for folder in ["ept-data", "ept-hierarchy"] {
        let entries = std::fs::read_dir(path.with_file_name(folder)).into_iter().flatten().flatten();
        let mut files: Vec<_> =
            entries.map(|entry| (entry.file_name(), entry.metadata().map_or(0, |of| of.len()))).collect();
        files.sort_unstable();
        for (name, length) in files {
            sum.update(name.as_encoded_bytes());
            sum.update(&length.to_le_bytes());
        }
    }
}

/// The settings of a request, which may be changed before it is opened.
pub fn settings(request: &mut Request) -> &mut Settings {
    let (settings, warnings) = (Settings::default(), Vec::new());
    &mut request.view.get_or_insert(View { camera: None, settings, warnings }).settings
}

/// Makes the pictures of a path.
pub struct Recorder {
    viewer: Headless,
    path: CameraPath,
    /// The width and height of the pictures that are drawn, in pixels.
    size: [u32; 2],
    motion: Motion,
    /// The time of the path's beginning on the clock that the viewer is given. The clock advances with the path and
    /// not with real time.
    start: Instant,
    /// The stops that are fitted to the keyframes, as far as they are known.
    fitted: BTreeMap<usize, f32>,
}

impl Recorder {
    /// Opens a scene at the beginning of the path, from which automatic light and ranges of colours follow. `wanted` is
    /// as in `Gpu::headless`. Returns the exit status if no input can be shown; the reasons have been reported then.
    ///
    /// # Errors
    /// There are no points, or nothing can be drawn; or somebody pressed Ctrl-C.
    pub fn open(
        gpu: Arc<Gpu>,
        wanted: Option<String>,
        size: [u32; 2],
        mut request: Request,
        path: &PathChoice,
    ) -> anyhow::Result<Result<Self, u8>> {
        let names = request.inputs.iter().map(Input::name).collect::<Vec<_>>().join(", ");
        let own = if let PathChoice::Own(path) = path { Motion::new(path) } else { None };
        let first = own.map(|motion| motion.camera(0.0));
        settings(&mut request);
        if let (Some(view), Some(first)) = (&mut request.view, first) {
            view.camera = Some(first);
        }
        let opened = Instant::now();
        let mut viewer = Headless::open(gpu, wanted, size, request, opened)?;
        let reading = Bar::points("reading");
        let is_there = viewer.settle(first, opened + REST, &reading)?.is_some();
        reading.end();
        match viewer.status() {
            0 if !is_there => Err(usage(format!("{names}: no points to show"))),
            status if !is_there => Ok(Err(status)),
            _ => {
                let path = path.over(&viewer.place());
                let motion = Motion::new(&path).ok_or_else(|| anyhow!("path `{}` has no keyframes", path.name))?;
                let mut recorder = Self { viewer, path, size, motion, start: opened + REST, fitted: BTreeMap::new() };
                // Tracks and captions that name nothing are reported before the first picture.
                recorder.pose(0.0)?;
                terminal::warn(recorder.path.warnings());
                Ok(Ok(recorder))
            }
        }
    }

    /// What the float images of positions of all frames are relative to.
    pub fn origin(&self) -> DVec3 {
        picture_file::origin(&self.motion.camera(0.0))
    }

    /// The exit status for inputs that failed; 0 if none did.
    pub fn status(&self) -> u8 {
        self.viewer.status()
    }

    /// The picture at a time of the path, in seconds, and float images of it: none of a path that wipes.
    ///
    /// # Errors
    /// It cannot be drawn, or somebody pressed Ctrl-C.
    pub fn picture(&mut self, time: f64, images: &[Aov], bar: &Bar) -> anyhow::Result<Picture> {
        let (mut picture, over) = self.bare(time, images, bar)?;
        over.draw(&mut picture.rgba, self.size);
        Ok(picture)
    }

    /// The picture at a time of the path without what is to be drawn over it, and that.
    fn bare(&mut self, time: f64, images: &[Aov], bar: &Bar) -> anyhow::Result<(Picture, Over)> {
        self.expose(time, bar)?;
        let (camera, now) = (self.motion.camera(time), self.now(time));
        let parts = self.path.parts(time, self.size[0]);
        let picture = match parts.is_empty() {
            true => self.viewer.picture(camera, now, images, bar)?,
            false => self.viewer.wiped(&self.path.states, &parts, camera, now, bar)?,
        };
        picture.ok_or_else(|| anyhow!("the points are gone"))
    }

    /// The picture of a frame at a time of the path, averaged from those that are drawn, of which each has
    /// `averaging.supersample` times as many pixels in each direction as `size`. The float images and what is drawn over
    /// the average are those of the first.
    ///
    /// # Errors
    /// Those of `picture`.
    pub fn frame(
        &mut self,
        time: f64,
        fps: u32,
        size: [u32; 2],
        averaging: Averaging,
        images: &[Aov],
        bar: &Bar,
    ) -> anyhow::Result<Picture> {
        if averaging.is_none() {
            return self.picture(time, images, bar);
        }
        self.viewer.supersample = averaging.supersample;
        let (first, over) = self.bare(time, images, bar)?;
        let mut average = Average::new(size, averaging.supersample);
        average.add(&first.rgba);
        for time in averaging.times(time, fps).skip(1) {
            average.add(&self.bare(time, &[], bar)?.0.rgba);
        }
        let mut rgba = average.end();
        over.draw(&mut rgba, size);
        Ok(Picture { rgba, ..first })
    }

    /// What the picture that was made last was drawn from; `time` is that of its frame. With sub-frames, it is the
    /// last.
    pub fn stats(&self, time: f64) -> PictureStats {
        self.viewer.stats(time)
    }

    /// Whether pictures lack points, since the opening, that could not be read and may come later.
    pub fn is_cut_off(&self) -> bool {
        self.viewer.is_cut_off
    }

    /// Whether the picture that was made last is empty.
    pub fn is_empty(&self) -> bool {
        self.viewer.points_drawn() == 0
    }

    /// Whether the scene hides all points of its clouds.
    pub fn hides_all(&self) -> bool {
        self.viewer.hides_all()
    }

    /// Sets parameters and objects as the tracks of the path have them at a time.
    fn pose(&mut self, time: f64) -> anyhow::Result<()> {
        let name = &self.path.name;
        let posed = self.viewer.pose(&self.path, time);
        posed.map_err(|(track, problem)| usage(format!("path `{name}`, track {}: {problem}", track + 1)))
    }

    fn now(&self, time: f64) -> Instant {
        self.start + Duration::from_secs_f64(time)
    }

    /// Gives the picture at a time the stops that are fitted to the keyframes before and after it, mixed by time, so that
    /// the exposure does not jump with what comes into view. Those of `tone.exposure` are added.
    fn expose(&mut self, time: f64, bar: &Bar) -> anyhow::Result<()> {
        self.pose(time)?;
        if self.viewer.tone.fit == ExposureFit::Locked {
            return Ok(());
        }
        let times = self.motion.times().to_vec();
        let next = times.partition_point(|keyframe| *keyframe <= time);
        let around = [next.saturating_sub(1), next.min(times.len().saturating_sub(1))];
        let mut stops = [0.0; 2];
        for (stops, index) in stops.iter_mut().zip(around) {
            *stops = match self.fitted.get(&index) {
                Some(known) => *known,
                None => {
                    self.pose(times[index])?;
                    self.viewer.fitted_stops(self.motion.camera(times[index]), self.now(time), bar)?
                }
            };
            self.fitted.insert(index, *stops);
        }
        self.pose(time)?;
        let [from, to] = around.map(|index| times[index]);
        let share = if to > from { ((time - from) / (to - from)).clamp(0.0, 1.0) as f32 } else { 0.0 };
        self.viewer.lock_exposure(stops[0] + (stops[1] - stops[0]) * share);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_mesh_of_the_same_name_is_another_scene_and_another_folder_is_not() {
        let checksum = |width: u32| {
            let folder = tempfile::tempdir().unwrap();
            let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                          property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
            std::fs::write(folder.path().join("a.ply"), format!("{header}0 0 0\n{width} 0 0\n0 1 0\n3 0 1 2\n"))
                .unwrap();
            let scene = folder.path().join("a.toml");
            let text = "clouds = [\"five-mirrors/none\"]\n[[mirrors]]\nname = \"a\"\nshape = { mesh = \"a.ply\" }\n\
                        position = [0, 0, 0]\nrotation = [0, 0, 0, 1]\nsize = 1\n";
            std::fs::write(&scene, text).unwrap();
            let request = world::resolve(&[scene]);
            request.check().unwrap();
            assert_eq!(request.mirrors.len(), 1);
            PathChoice::BuiltIn(BuiltInPath::Orbit).checksum(&request)
        };
        assert_eq!(checksum(1), checksum(1));
        assert_ne!(checksum(1), checksum(2));
    }

    #[test]
    fn tiles_of_catalogues_and_of_ept_belong_to_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        std::fs::create_dir_all(folder.path().join("ept/ept-data")).unwrap();
        let item = |tile: &str| format!(r#"{{"properties":{{}},"assets":{{"data":{{"href":"{tile}"}}}}}}"#);
        let items = [item("a.laz"), item("http://127.0.0.1:1/b.laz")].join(",");
        write("all.vpc", &format!(r#"{{"type":"FeatureCollection","features":[{items}]}}"#));
        write("a.laz", "as it was");
        write("ept/ept.json", "{}");
        write("ept/ept-data/0-0-0-0.laz", "as it was");
        write("scene.toml", "clouds = [\"all.vpc\", \"ept\"]\n");
        let sums = || checksums(&world::resolve(&[folder.path().join("scene.toml")])).unwrap();
        let changed = |before: &BTreeMap<String, String>| -> Vec<String> {
            let now = sums();
            assert!(now.keys().eq(before.keys()), "{now:?}");
            before.keys().filter(|name| now[*name] != before[*name]).cloned().collect()
        };
        let before = sums();
        assert_eq!(
            before.keys().collect::<Vec<_>>(),
            ["all.vpc", "all.vpc (tiles)", "ept.json", "ept.json (tiles)", "scene.toml"]
        );
        assert!(changed(&before).is_empty());
        write("a.laz", "another 1");
        assert_eq!(changed(&before), ["all.vpc (tiles)"]);
        write("ept/ept-data/0-0-0-0.laz", "another length");
        assert_eq!(changed(&before), ["all.vpc (tiles)", "ept.json (tiles)"]);
    }

    #[test]
    fn whatever_is_drawn_over_the_pictures_belongs_to_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let checksum = |objects: &str| {
            let scene = folder.path().join("a.toml");
            std::fs::write(&scene, format!("clouds = [\"five-mirrors/none\"]\n{objects}")).unwrap();
            PathChoice::BuiltIn(BuiltInPath::Orbit).checksum(&world::resolve(&[scene]))
        };
        let note = |text: &str| format!("[[notes]]\ntext = \"{text}\"\nposition = [0, 0, 0]\n");
        let length = |x: u32| format!("[[measurements]]\nkind = \"distance\"\npoints = [[0, 0, 0], [{x}, 0, 0]]\n");
        let profile = |x: u32| format!("[[profiles]]\nname = \"a\"\nline = [[0, 0, 0], [{x}, 0, 0]]\nwidth = 0.1\n");
        let all = [checksum(""), checksum(&note("a")), checksum(&note("b"))];
        let all = all.into_iter().chain([1, 2].into_iter().flat_map(|x| [checksum(&length(x)), checksum(&profile(x))]));
        let all: Vec<String> = all.collect();
        assert!(all.iter().enumerate().all(|(index, sum)| !all[..index].contains(sum)), "{all:?}");
        assert_eq!(checksum(&note("b")), all[2]);
    }
}
