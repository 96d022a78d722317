//! Finds what the words of a command line or of a scene file name: files, folders of tiles, built-in scenes.

use std::collections::{BTreeMap, HashSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::PointTest;
use cloud::sampling::Surface;
use glam::DVec3;
use scene::{
    Bookmark, CameraPath, Clip, CloudSettings, Measurement, Mirror, MirrorPoints, Object, Profile, SceneFile,
    SpotLight, View, Visibility, five_mirrors, shown,
};

use crate::error::{Error, Result};
use crate::source::{file_name, open_placed};

/// An input that a person named.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    File(PathBuf),
    /// A folder with several files that are one cloud.
    Tiles {
        folder: PathBuf,
        /// The files, in the order of their names.
        files: Vec<PathBuf>,
    },
    BuiltIn {
        variant: five_mirrors::Variant,
        /// The names of its mirrors that are left out because others have taken their places.
        without: Vec<String>,
    },
    /// A word that names nothing, or a scene file that cannot be read. It keeps its place, and fails when it is loaded.
    Unknown {
        name: String,
        error: String,
    },
}

impl Input {
    /// The name as a person would type it.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) | Self::Tiles { folder: path, .. } => shown(path),
            Self::BuiltIn { variant, .. } => built_in_name(*variant),
            Self::Unknown { name, .. } => name.clone(),
        }
    }

    /// The files that are read.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            Self::File(path) => std::slice::from_ref(path),
            Self::Tiles { files, .. } => files,
            Self::BuiltIn { .. } | Self::Unknown { .. } => &[],
        }
    }
}

/// All words of a command line together.
#[derive(Clone, Debug, Default)]
pub struct Request {
    pub inputs: Vec<Input>,
    /// The scene files that were read.
    pub scene_files: Vec<PathBuf>,
    /// The camera and parameters of the scene file, or the camera of a built-in scene that is shown alone.
    pub view: Option<View>,
    /// The mirrors of scene files; built-in scenes bring theirs when they are loaded.
    pub mirrors: Vec<Mirror>,
    pub mirror_points: Vec<MirrorPoints>,
    /// What single clouds have of their own, by scene files. Of settings of the same cloud the last ones count.
    pub cloud_settings: Vec<CloudSettings>,
    /// The lights of scene files.
    pub lights: Vec<SpotLight>,
    /// Which points are shown: what one scene file hides is hidden in all clouds.
    pub visibility: Visibility,
    pub clips: Vec<Clip>,
    /// The objects of scene files that are drawn over the picture: measurements, notes and profiles.
    pub marks: Vec<Object>,
    /// The bookmarks of scene files.
    pub bookmarks: Vec<Bookmark>,
    /// The camera paths of scene files. Of paths with the same name the last one counts.
    pub paths: Vec<CameraPath>,
    pub warnings: Vec<String>,
}

impl Request {
    /// Checks that something can be opened.
    ///
    /// # Errors
    /// If words were given and none of them names anything; it names the first few.
    pub fn check(&self) -> Result<()> {
        let error = |input: &Input| if let Input::Unknown { error, .. } = input { Some(error.clone()) } else { None };
        let errors: Vec<String> = self.inputs.iter().filter_map(error).collect();
        if errors.is_empty() || errors.len() < self.inputs.len() {
            Ok(())
        } else {
            Err(Error::NothingNamed(param::few(errors, "that name nothing").join("; ")))
        }
    }

    /// The measurements of scene files.
    pub fn measurements(&self) -> impl Iterator<Item = &Measurement> {
        self.marks.iter().filter_map(|mark| if let Object::Measurement(one) = mark { Some(one) } else { None })
    }

    /// The profiles of scene files.
    pub fn profiles(&self) -> impl Iterator<Item = &Profile> {
        self.marks.iter().filter_map(|mark| if let Object::Profile(one) = mark { Some(one) } else { None })
    }

    /// All mirrors: those of the scene files, and those that built-in scenes bring.
    pub fn all_mirrors(&self) -> Vec<Mirror> {
        let brought = self.inputs.iter().flat_map(|input| match input {
            Input::BuiltIn { variant, without } => {
                variant.mirrors().into_iter().filter(|mirror| !without.contains(&mirror.name)).collect()
            }
            _ => Vec::new(),
        });
        self.mirrors.iter().cloned().chain(brought).collect()
    }

    /// The built-in scene, if there is nothing else and its mirrors are unchanged.
    pub fn built_in(&self) -> Option<five_mirrors::Variant> {
        let is_changed = !self.mirrors.is_empty() || !self.mirror_points.is_empty() || !self.cloud_settings.is_empty();
        match self.inputs.as_slice() {
            [Input::BuiltIn { variant, without }] if !is_changed && without.is_empty() => Some(*variant),
            _ => None,
        }
    }

    /// The light of a built-in scene; lights of scene files replace it.
    pub fn built_in_light(&self) -> Option<SpotLight> {
        let light = |input: &Input| if let Input::BuiltIn { variant, .. } = input { variant.light() } else { None };
        self.inputs.iter().filter(|_| self.lights.is_empty()).find_map(light)
    }

    /// The height of the ground, if all inputs are built-in scenes and the first one has a ground.
    pub fn ground(&self) -> Option<f64> {
        let variant = |input: &Input| if let Input::BuiltIn { variant, .. } = input { Some(*variant) } else { None };
        let variants: Option<Vec<five_mirrors::Variant>> = self.inputs.iter().map(variant).collect();
        variants?.first()?.ground()
    }

    /// A corner and two edges of each wall of the built-in scenes, if all inputs are built-in scenes.
    pub fn walls(&self) -> Vec<[DVec3; 3]> {
        let walls =
            |input: &Input| if let Input::BuiltIn { variant, .. } = input { Some(variant.walls()) } else { None };
        let all: Option<Vec<_>> = self.inputs.iter().map(walls).collect();
        let rectangle = |surface: Surface| match surface {
            Surface::Rectangle { corner, edges: [u, v] } => Some([corner, u, v]),
            _ => None,
        };
        all.unwrap_or_default().into_iter().flatten().filter_map(|(surface, _)| rectangle(surface)).collect()
    }

    /// What the cloud that came from `input` and has the name `name` has of its own.
    pub fn settings_of(&self, input: &str, name: &str) -> Option<&CloudSettings> {
        self.cloud_settings.iter().find(|own| own.is_of(input, name))
    }

    /// What a file of an input, or one of its scans, has of its own.
    fn own_of(&self, input: &Input, file: &Path, scan: Option<&codec::Info>) -> Option<&CloudSettings> {
        let names = [scan.map(codec::Info::name), Some(input.name()), Some(shown(file)), Some(file_name(file))];
        names.iter().flatten().find_map(|name| self.cloud_settings.iter().find(|own| own.cloud == *name))
    }

    /// Opens the scans of a file of an input, moved as scenes say. Scans that are switched off are left out.
    ///
    /// # Errors
    /// Says why nothing of the file can be shown.
    pub fn open(&self, input: &Input, file: &Path, memory: u64) -> Result<Vec<Arc<codec::Source>>, String> {
        let placement = |info: &codec::Info| self.own_of(input, file, Some(info))?.placement();
        let mut sources = open_placed(file, memory, placement)?;
        if sources.len() > 1 {
            let is_on = |info: &codec::Info| self.own_of(input, file, Some(info)).is_none_or(|own| own.on);
            sources.retain(|source| is_on(source.info()));
        }
        Ok(sources)
    }

    /// All files, each with its input.
    pub fn files(&self) -> Vec<(Input, PathBuf)> {
        let all = self.inputs.iter().flat_map(|input| input.files().iter().map(move |file| (input, file)));
        all.map(|(input, file)| (input.clone(), file.clone())).collect()
    }

    /// Leaves out the inputs whose clouds are switched off.
    ///
    /// # Errors
    /// If none is left; it names the first few.
    pub fn leave_out_hidden(&mut self) -> Result<()> {
        let is_on = |input: &Input| self.cloud_settings.iter().all(|own| own.on || own.cloud != input.name());
        let (on, off): (Vec<Input>, Vec<Input>) = std::mem::take(&mut self.inputs).into_iter().partition(is_on);
        self.inputs = on;
        if self.inputs.is_empty() && !off.is_empty() {
            let names = off.iter().map(Input::name).collect();
            return Err(Error::AllHidden(param::few(names, "clouds").join(", ")));
        }
        Ok(())
    }

    /// Decides which points are shown.
    pub fn test(&self) -> PointTest {
        self.visibility.test(&self.clips)
    }

    /// Applies a view to the scene that it belongs to: the view's lights replace all lights, its visibility and its clips
    /// replace those of the scene, and its mirrors and marked points replace those of the same name.
    pub fn refurnish(&mut self, file: &SceneFile) {
        if !file.lights.is_empty() {
            self.lights.clear();
        }
        if !file.visibility.shows_all() {
            self.visibility = Visibility::default();
        }
        if !file.clips.is_empty() {
            self.clips.clear();
        }
        let is_same = |a: &Mirror, b: &Mirror| a == b || (!a.name.is_empty() && a.name == b.name);
        self.mirrors.retain(|known| !file.mirrors.iter().any(|mirror| is_same(known, mirror)));
        self.mirror_points.retain(|known| !file.mirror_points.contains(known));
        self.furnish(file);
    }

    /// Adds the mirrors, lights, clips, measurements, notes, bookmarks and paths of a scene file, and hides what it hides.
    pub fn furnish(&mut self, file: &SceneFile) {
        self.paths.retain(|known| !file.paths.iter().any(|path| path.name == known.name));
        self.paths.extend(file.paths.iter().cloned());
        self.mirrors.extend(file.mirrors.iter().cloned());
        self.mirror_points.extend(file.mirror_points.iter().cloned());
        self.name_columns(&file.cloud_settings);
        self.cloud_settings.retain(|known| !file.cloud_settings.iter().any(|own| own.cloud == known.cloud));
        self.cloud_settings.extend(file.cloud_settings.iter().cloned());
        self.lights.extend(file.lights.iter().copied());
        self.visibility.hide(&file.visibility);
        self.clips.extend(file.clips.iter().cloned());
        self.marks.extend(file.marks());
        self.bookmarks.extend(file.bookmarks.iter().cloned());
        for input in &mut self.inputs {
            if let Input::BuiltIn { without, .. } = input {
                without.extend(file.mirrors.iter().map(|mirror| mirror.name.clone()));
            }
        }
    }
}

impl Request {
    /// Has tables read with the names that a scene gives to their columns, unless the command line names those of all tables.
    fn name_columns(&mut self, own: &[CloudSettings]) {
        for (own, columns) in own.iter().filter_map(|own| Some((own, own.columns.as_ref()?))) {
            let names: Vec<String> = columns.split(',').map(|name| name.trim().to_owned()).collect();
            if codec::are_columns_named() {
                continue;
            }
            if let Err(problem) = codec::name_columns_of(Path::new(&own.cloud), &names) {
                self.warnings.push(format!("{}: columns are not those of the scene: {problem}", own.cloud));
            }
        }
    }
}

/// Finds what each word names: a scene file (`.toml`, replaced by its clouds), a built-in scene, or else a cloud file.
/// A word that names nothing becomes `Input::Unknown`, with a suggestion of the name that may have been meant; the
/// other words count. An input that is named more than once is opened once.
pub fn resolve<Word: AsRef<OsStr>>(words: &[Word]) -> Request {
    let mut request = Request::default();
    let mut files = Vec::new();
    let mut unknown = 0;
    // Suggestions search a folder, which takes time: only for the first few words.
    let mut named = |word: &OsStr, place: &str| {
        if place.is_empty() {
            codec::trust_address(Path::new(word));
        }
        input(word, unknown < HINTS).unwrap_or_else(|error| {
            unknown += 1;
            Input::Unknown { name: shown(word), error: format!("{place}{error}") }
        })
    };
    for word in words {
        let path = Path::new(word);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            let name = shown(path);
            let (file, clouds) = match SceneFile::read(path) {
                Ok(scene) => scene,
                Err(error) => {
                    let missing = if path.exists() { None } else { input(word.as_ref(), true).err() };
                    request.inputs.push(Input::Unknown { name, error: missing.unwrap_or(error.to_string()) });
                    continue;
                }
            };
            request.inputs.extend(clouds.iter().map(|cloud| named(cloud.as_ref(), &format!("{name}: "))));
            let view = file.view();
            files.push(file);
            request.scene_files.push(path.to_owned());
            request.warnings.extend(view.warnings.iter().map(|warning| format!("{name}: {warning}")));
            if request.view.replace(view).is_some() {
                request
                    .warnings
                    .push(format!("{name}: its camera and parameters replace those of the scene before it"));
            }
        } else {
            request.inputs.push(named(word.as_ref(), ""));
        }
    }
    open_once(&mut request);
    files.iter().for_each(|file| request.furnish(file));
    let variant = |input: &Input| if let Input::BuiltIn { variant, .. } = input { Some(*variant) } else { None };
    let built_in: Option<Vec<five_mirrors::Variant>> = request.inputs.iter().map(variant).collect();
    if let Some(first) = built_in.and_then(|variants| variants.first().copied()) {
        let view =
            request.view.get_or_insert_with(|| View { camera: None, settings: first.settings(), warnings: Vec::new() });
        view.camera.get_or_insert(first.camera());
    }
    request
}

/// The number of unknown words that get a suggestion.
const HINTS: usize = 3;

/// Leaves out inputs that are named again, and warns of them.
fn open_once(request: &mut Request) {
    let mut known = HashSet::new();
    let mut again = Vec::new();
    request.inputs.retain(|input| {
        let Some(place) = place_of(input) else { return true };
        let is_new = known.insert(place);
        if !is_new && !again.contains(&input.name()) {
            again.push(input.name());
        }
        is_new
    });
    let warnings = again.iter().map(|name| format!("{name}: named more than once, and opened once"));
    request.warnings.extend(param::few(warnings.collect(), "that are named more than once"));
}

/// What tells an input from others.
fn place_of(input: &Input) -> Option<PathBuf> {
    match input {
        Input::File(path) | Input::Tiles { folder: path, .. } => Some(whole(path)),
        Input::BuiltIn { variant, .. } => Some(built_in_name(*variant).into()),
        Input::Unknown { .. } => None,
    }
}

fn whole(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

impl Request {
    /// Warns of inputs that are open by these names: their points will be there twice.
    pub fn warn_of_open(&mut self, open: &HashSet<&str>) {
        let open: HashSet<PathBuf> = open.iter().map(|name| whole(Path::new(name))).collect();
        let is_open = |input: &&Input| place_of(input).is_some_and(|place| open.contains(&place));
        let again = self.inputs.iter().filter(is_open);
        let again = again.map(|input| format!("{}: open already, its points are there twice now", input.name()));
        self.warnings.extend(param::few(again.collect(), "that are open already"));
    }
}

/// The file or built-in scene that `word` names, or an error message with a suggestion.
fn input(word: &OsStr, has_hint: bool) -> Result<Input, String> {
    if let Some(mirror) = five_mirrors::Variant::ALL.into_iter().find(|mirror| *built_in_name(*mirror) == *word) {
        return Ok(Input::BuiltIn { variant: mirror, without: Vec::new() });
    }
    let path = Path::new(word);
    let name = shown(path);
    if *word == *codec::Bytes::STANDARD_INPUT {
        return Ok(Input::File(path.to_owned()));
    }
    if codec::is_address(path) {
        let is_folder = name.ends_with('/');
        return Ok(Input::File(if is_folder { codec::beside(path, "ept.json") } else { path.to_owned() }));
    }
    if path.is_dir() {
        return tiles(path).map_err(|problem| format!("{name}: {problem}"));
    }
    if path.exists() {
        return Ok(Input::File(path.to_owned()));
    }
    if let Ok(target) = path.read_link() {
        return Err(format!("{name}: a link to {}, where nothing is", shown(&target)));
    }
    if name.split_once("://").is_some_and(|(scheme, _)| scheme.chars().all(|letter| letter.is_ascii_alphanumeric())) {
        return Err(format!("{name}: not an address of http or https"));
    }
    let hint = if has_hint { hint(path) } else { String::new() };
    Err(format!("{name}: no such file or built-in scene{hint}"))
}

/// A suggestion for a path where nothing is.
fn hint(path: &Path) -> String {
    // Compared by their last part: a typing error in a short name must not drown in a long folder's name.
    let last = |name: &Path| name.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let known: BTreeMap<String, String> =
        files_beside(path).into_iter().chain(built_in_names()).map(|name| (last(Path::new(&name)), name)).collect();
    match param::nearest(&last(path), known.keys().map(String::as_str)).and_then(|near| known.get(near)) {
        Some(near) => format!("; did you mean `{near}`?"),
        None if path.starts_with("five-mirrors") || path.starts_with("tripod") => {
            "; `glint scenes` lists the built-in scenes".into()
        }
        None => String::new(),
    }
}

/// The clouds in a folder, or what is wrong with it. Names that begin with a dot are hidden files, such as those that
/// macOS keeps beside others. A link to nothing stays in the list, so that its tile is missed.
fn tiles(folder: &Path) -> Result<Input, String> {
    let ept = folder.join("ept.json");
    if ept.is_file() {
        return Ok(Input::File(ept));
    }
    let is_cloud = |path: &PathBuf| {
        let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        codec::Format::is_of_cloud(extension) && !is_hidden && (path.is_file() || path.is_symlink() && !path.exists())
    };
    let entries = std::fs::read_dir(folder).map_err(|error| error.to_string())?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_cloud).collect();
    files.sort();
    match files.as_slice() {
        [] => Err("a folder without files of points".into()),
        [one] => Ok(Input::File(one.clone())),
        _ => Ok(Input::Tiles { folder: folder.to_owned(), files }),
    }
}

/// The files in the folder of `path`, written as `path` is.
fn files_beside(path: &Path) -> Vec<String> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(listed).into_iter().flatten().flatten();
    entries.map(|entry| folder.join(entry.file_name()).to_string_lossy().into_owned()).collect()
}

pub fn built_in_name(mirror: five_mirrors::Variant) -> String {
    format!("{}/{}", mirror.family(), mirror.name())
}

/// The scene that opens when nothing is named.
pub fn first_scene() -> String {
    built_in_name(five_mirrors::Variant::Pool)
}

pub fn built_in_names() -> Vec<String> {
    five_mirrors::Variant::ALL.into_iter().map(built_in_name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::job::start;

    const THREE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar intensity\nend_header\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    fn message(word: &str) -> String {
        resolve(&words(&[word])).check().unwrap_err().to_string()
    }

    #[test]
    fn words_name_files_scenes_and_built_in_scenes() {
        let folder = tempfile::tempdir().unwrap();
        let cloud = folder.path().join("cloud.ply");
        let scene = folder.path().join("scene.toml");
        std::fs::write(&cloud, THREE_POINTS).unwrap();
        std::fs::write(
            &scene,
            "clouds = [\"cloud.ply\", \"five-mirrors/torus\"]\n[parameters]\n\"splat.size\" = 2.0\n\"splat.nope\" = 1\n",
        )
        .unwrap();
        let request = resolve(&words(&[scene.to_str().unwrap()]));
        let torus = Input::BuiltIn { variant: five_mirrors::Variant::Torus, without: Vec::new() };
        assert_eq!(request.inputs, [Input::File(cloud), torus.clone()]);
        let view = request.view.unwrap();
        assert_eq!((view.settings.splat.size, view.camera), (2.0, None));
        assert!(request.warnings.len() == 1 && request.warnings[0].contains("splat.nope"), "{:?}", request.warnings);

        let alone = resolve(&words(&["five-mirrors/torus"]));
        assert_eq!(alone.inputs, [torus]);
        assert_eq!(alone.view.unwrap().camera, Some(five_mirrors::camera()));
        let nothing = resolve::<&str>(&[]);
        assert!(nothing.inputs.is_empty() && nothing.check().is_ok());
    }

    #[test]
    fn a_folder_names_the_clouds_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            std::fs::write(folder.path().join(name), THREE_POINTS).unwrap();
            folder.path().join(name)
        };
        let word = words(&[folder.path().to_str().unwrap()]);
        write("notes.txt");
        let last = write("b.LAZ");
        assert_eq!(resolve(&word).inputs, [Input::File(last.clone())]);
        let first = write("a.ply");
        std::fs::create_dir(folder.path().join("c.las")).unwrap();
        let tiles = Input::Tiles { folder: folder.path().to_owned(), files: vec![first, last] };
        assert_eq!(resolve(&word).inputs, [tiles]);
    }

    #[test]
    fn a_view_of_a_scene_brings_none_of_its_objects_twice() {
        let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                     inner_degrees = 20\nouter_degrees = 30\n";
        let mirror =
            |line: &str| format!("[[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 0.2\n{line}\n");
        let points = "[[mirror_points]]\ncloud = \"a.laz\"\n";
        let text = |line: &str| format!("{light}{}{}{points}", mirror(""), mirror(line));
        let mut request = Request::default();
        request.furnish(&SceneFile::parse(&text("name = \"ball\"")).unwrap());
        let view = SceneFile::parse(&text("name = \"ball\"\nas_points = true")).unwrap();
        request.refurnish(&view);
        assert_eq!((request.lights.len(), request.mirror_points.len()), (1, 1));
        assert_eq!(request.mirrors, view.mirrors);
        request.refurnish(&SceneFile::default());
        assert_eq!(request.lights.len(), 1, "a view without lights leaves those that are there");
    }

    #[test]
    fn scene_files_hide_classes_together_and_a_view_hides_its_own() {
        let hiding = |classes: &str| SceneFile::parse(&format!("[visibility]\nhidden_classes = {classes}\n")).unwrap();
        let mut request = Request::default();
        request.furnish(&hiding("[7, 18]"));
        request.furnish(&hiding("[2]"));
        assert_eq!(request.visibility.hidden_classes, [2, 7, 18].into());
        request.refurnish(&hiding("[]"));
        assert_eq!(request.visibility.hidden_classes, [2, 7, 18].into());
        request.refurnish(&hiding("[6]"));
        assert_eq!(request.visibility.hidden_classes, [6].into());
    }

    #[test]
    fn mirrors_and_lights_of_a_scene_file_take_the_place_of_a_built_in_scenes_own() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.toml");
        let text = "clouds = [\"five-mirrors/all\"]\n[[mirrors]]\nname = \"torus\"\nshape = \"sphere\"\n\
                    position = [0, 0, 0]\nsize = 0.2\n";
        std::fs::write(&scene, text).unwrap();
        let request = resolve(&words(&[scene.to_str().unwrap()]));
        assert_eq!((request.mirrors.len(), request.lights.len()), (1, 0));
        assert_eq!(request.built_in_light(), Some(five_mirrors::light()));
        let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                     inner_degrees = 20\nouter_degrees = 30\n";
        std::fs::write(&scene, format!("{text}{light}")).unwrap();
        let lit = resolve(&words(&[scene.to_str().unwrap()]));
        assert_eq!((lit.lights.len(), lit.built_in_light()), (1, None));
        let mut settings = scene::Settings::default();
        settings.scene.points = 10_000;
        let job = start(request.inputs, &settings, Default::default());
        let brought = job.events.iter().filter_map(|event| match event {
            Event::Mirror { mirror, .. } => Some(mirror.name),
            _ => None,
        });
        assert_eq!(brought.collect::<Vec<_>>(), ["sphere", "parabolic", "blob", "coral"]);
    }

    #[test]
    fn a_word_that_names_nothing_leaves_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.toml");
        std::fs::write(&scene, "clouds = [\"gone.ply\", \"five-mirrors/torus\"]\n").unwrap();
        let request = resolve(&words(&["no_such.laz", scene.to_str().unwrap(), "no_such.toml"]));
        assert!(request.check().is_ok());
        let unknown = request.inputs.iter().map(|input| matches!(input, Input::Unknown { .. }));
        assert_eq!(unknown.collect::<Vec<_>>(), [true, true, false, true]);
        let beside = folder.path().join("scenes.toml");
        let missing = resolve(&words(&[beside.to_str().unwrap()])).check().unwrap_err().to_string();
        assert!(missing.contains("no such file or built-in scene; did you mean") && missing.contains("scene.toml"));
        let both = resolve(&words(&["no_such.laz", "no_such.ply"])).check().unwrap_err().to_string();
        assert!(both.contains("no_such.laz") && both.contains("no_such.ply"), "{both}");
    }

    #[test]
    fn the_columns_of_a_table_are_named_as_the_scene_says() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.xyz", "b.xyz", "c.xyz"] {
            std::fs::write(folder.path().join(name), "1 2 3 4\n5 6 7 8\n").unwrap();
        }
        let scene = folder.path().join("scene.toml");
        let own =
            |name: &str, columns: &str| format!("[[cloud_settings]]\ncloud = \"{name}\"\ncolumns = \"{columns}\"\n");
        let (a, b) = (own("a.xyz", "intensity, x,y,z"), own("b.xyz", "x,y,intensity"));
        std::fs::write(&scene, format!("clouds = [\"a.xyz\", \"b.xyz\"]\n{a}{b}")).unwrap();
        let request = resolve(&[&scene]);
        let columns = |file: &str| {
            let source = codec::open(&folder.path().join(file)).unwrap();
            source.info().properties.iter().map(|property| property.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(columns("a.xyz"), ["intensity", "x", "y", "z"]);
        assert_eq!(columns("b.xyz"), columns("c.xyz"), "names without a place are left out");
        assert_eq!(request.warnings.len(), 1);
        assert!(request.warnings[0].contains("b.xyz: columns are not those of the scene: no column z"));
    }

    #[test]
    fn files_are_moved_as_the_scene_says_of_their_path_or_their_name() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ply", "b.ply", "c.ply"] {
            std::fs::write(folder.path().join(name), THREE_POINTS).unwrap();
        }
        let scene = folder.path().join("scene.toml");
        let own = |name: &str, x: u32| format!("[[cloud_settings]]\ncloud = \"{name}\"\nmove = [{x}, 0, 0]\n");
        let (a, b) = (own("a.ply", 1), own("b.ply", 2));
        std::fs::write(&scene, format!("clouds = [\"a.ply\", \"b.ply\", \"c.ply\"]\n{a}{b}")).unwrap();
        let mut request = resolve(&[&scene]);
        let moved = |request: &Request| -> Vec<Option<f64>> {
            let scans =
                request.files().into_iter().flat_map(|(input, file)| request.open(&input, &file, 1 << 30).unwrap());
            scans.map(|scan| Some(scan.info().placement?.point(glam::DVec3::ZERO).x)).collect()
        };
        assert_eq!(moved(&request), [Some(1.0), Some(2.0), None]);
        // The tiles of a folder are told apart by their names.
        request.inputs = vec![Input::Tiles {
            folder: folder.path().to_owned(),
            files: ["b.ply", "c.ply"].map(|name| folder.path().join(name)).into(),
        }];
        request.cloud_settings = vec![CloudSettings { shift: glam::DVec3::X, ..CloudSettings::of("c.ply".into()) }];
        assert_eq!(moved(&request), [None, Some(1.0)]);
        request.cloud_settings[0].cloud = shown(folder.path());
        assert_eq!(moved(&request), [Some(1.0), Some(1.0)]);
    }

    #[test]
    fn what_is_named_again_is_opened_once() {
        let folder = tempfile::tempdir().unwrap();
        let (cloud, scene) = (folder.path().join("cloud.ply"), folder.path().join("scene.toml"));
        std::fs::write(&cloud, THREE_POINTS).unwrap();
        let many = "\"cloud.ply\", \"five-mirrors/torus\", ".repeat(450);
        std::fs::write(&scene, format!("clouds = [{many}]")).unwrap();
        let request = resolve(&[scene.as_os_str(), cloud.as_os_str()]);
        let torus = Input::BuiltIn { variant: five_mirrors::Variant::Torus, without: Vec::new() };
        assert_eq!(request.inputs, [Input::File(cloud), torus]);
        assert_eq!(request.warnings.len(), 2, "{:?}", request.warnings);
        assert!(request.warnings[0].ends_with("cloud.ply: named more than once, and opened once"));
    }

    #[test]
    fn many_words_that_name_nothing_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.toml");
        let missing: String = (0..900).map(|index| format!("\"gone-{index}.laz\", ")).collect();
        std::fs::write(&scene, format!("clouds = [{missing}]")).unwrap();
        let request = resolve(&[&scene]);
        assert_eq!(request.inputs.len(), 900);
        let message = request.check().unwrap_err().to_string();
        assert!(message.contains("gone-0.laz") && message.contains("and 897 more that name nothing"), "{message}");
        assert!(message.len() < 1000, "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_are_opened() {
        use std::os::unix::ffi::OsStrExt as _;
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join(OsStr::from_bytes(b"sc\xe4ns"));
        std::fs::create_dir(&place).unwrap();
        let (cloud, scene) = (place.join(OsStr::from_bytes(b"w\xe4ld.ply")), place.join("scene.toml"));
        std::fs::write(&cloud, THREE_POINTS).unwrap();
        std::fs::write(place.join("plain.ply"), THREE_POINTS).unwrap();
        std::fs::write(&scene, "clouds = [\"plain.ply\"]").unwrap();
        assert_eq!(resolve(&[&cloud]).inputs, [Input::File(cloud)]);
        assert_eq!(resolve(&[&scene]).inputs, [Input::File(place.join("plain.ply"))]);
    }

    #[test]
    fn words_that_name_nothing_are_refused_with_the_nearest_name() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("office.laz"), "").unwrap();
        let typo = folder.path().join("ofice.laz").display().to_string();
        assert!(message(&typo).contains("office.laz`?"), "{}", message(&typo));
        assert!(message("ftp://a/b.laz").ends_with("not an address of http or https"));
        assert!(message("five-mirrors/sphre").contains("did you mean `five-mirrors/sphere`?"));
        assert!(message("sphere").contains("did you mean `five-mirrors/sphere`?"));
        assert!(message("five-mirrors/teapot").contains("glint scenes"));
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        let empty = message(folder.path().join("empty").to_str().unwrap());
        assert!(empty.ends_with("empty: a folder without files of points"), "{empty}");
        assert!(message("no_such_scene.toml").contains("no_such_scene.toml"));
    }
}
