//! Finds what the words of a command line or of a scene file name: files, folders of tiles, built-in scenes.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::PointTest;
use cloud::sampling::Surface;
use glam::DVec3;
use scene::{
    Bookmark, CameraPath, Clip, CloudSettings, Measurement, Mirror, MirrorPoints, Object, Paging, Profile, SceneFile,
    SpotLight, View, Visibility, five_mirrors, shown,
};

use crate::error::{Error, Result};
use crate::source::{file_name, open_file, open_placed, parts};

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

    /// Whether it is an address.
    pub(crate) fn is_far(&self) -> bool {
        matches!(self, Self::File(path) if codec::is_address(path))
    }

    /// Whether its files are one cloud, unless some lie apart: a folder or a catalogue.
    fn has_tiles(&self) -> bool {
        match self {
            Self::File(path) => path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vpc")),
            Self::Tiles { .. } => true,
            Self::BuiltIn { .. } | Self::Unknown { .. } => false,
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
    fn settings_of(&self, input: &str, name: &str) -> Option<&CloudSettings> {
        self.cloud_settings.iter().find(|own| own.is_of(input, name))
    }

    /// What the cloud has of its own that a scan of an input is in.
    fn own_of(&self, input: &Input, scan: &codec::Info, memory: u64) -> Option<&CloudSettings> {
        let alone = self.settings_of(&shown(&scan.path), &scan.name());
        let is_cloud = |_: &&CloudSettings| !input.has_tiles() || self.is_apart(input, &scan.path, memory);
        let whole = || self.settings_of(&input.name(), &file_name(Path::new(&input.name())));
        alone.filter(is_cloud).or_else(whole)
    }

    /// Whether a file of a folder or catalogue is a cloud of its own, as when pictures are made: nothing lies near it, or
    /// the scene streams no clouds.
    fn is_apart(&self, input: &Input, path: &Path, memory: u64) -> bool {
        let settings = self.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
        if settings.stream.pages == Paging::Never {
            return true;
        }
        let files = input.files().iter().flat_map(|file| open_file(file, memory).unwrap_or_default());
        let files: Vec<Arc<codec::Source>> = files.collect();
        // COPC tiles are one cloud wherever they lie.
        let is_copc = |file: &Arc<codec::Source>| codec::last_part(&file.info().path).ends_with(".copc.laz");
        if files.iter().all(is_copc) {
            return false;
        }
        let clouds = parts(files, &BTreeSet::new());
        clouds.iter().any(|(files, _)| matches!(files.as_slice(), [one] if one.info().path == path))
    }

    /// Warns of settings that no cloud has. Files are opened only if some settings are of none of the inputs.
    pub fn settings_without_cloud(&self, memory: u64) -> Vec<String> {
        let names = |input: &Input| (input.name(), file_name(Path::new(&input.name())));
        let inputs: Vec<(String, String)> = self.inputs.iter().map(names).collect();
        let is_of_input = |own: &&CloudSettings| inputs.iter().any(|(input, name)| own.is_of(input, name));
        let mut left: Vec<&CloudSettings> = self.cloud_settings.iter().filter(|own| !is_of_input(own)).collect();
        for (input, file) in self.files() {
            if left.is_empty() {
                break;
            }
            for source in open_file(&file, memory).unwrap_or_default() {
                let (path, name) = (&source.info().path, source.info().name());
                let is_named = left.iter().any(|own| own.is_of(&shown(path), &name));
                if is_named && (!input.has_tiles() || self.is_apart(&input, path, memory)) {
                    left.retain(|own| !own.is_of(&shown(path), &name));
                }
            }
        }
        param::few(left.into_iter().map(no_cloud).collect(), "cloud settings without a cloud")
    }

    /// Opens the scans of a file of an input, moved as scenes say. Scans that are switched off are left out.
    ///
    /// # Errors
    /// Says why nothing of the file can be shown.
    pub fn open(&self, input: &Input, file: &Path, memory: u64) -> Result<Vec<Arc<codec::Source>>, String> {
        let placement = |info: &codec::Info| self.own_of(input, info, memory)?.placement();
        let mut sources = open_placed(file, memory, placement)?;
        if sources.len() > 1 {
            let is_on = |info: &codec::Info| self.own_of(input, info, memory).is_none_or(|own| own.on);
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
        let is_of = |own: &CloudSettings, input: &Input| own.is_of(&input.name(), &file_name(Path::new(&input.name())));
        let is_on = |input: &Input| self.cloud_settings.iter().all(|own| own.on || !is_of(own, input));
        let (on, off): (Vec<Input>, Vec<Input>) = std::mem::take(&mut self.inputs).into_iter().partition(is_on);
        self.inputs = on;
        if self.inputs.is_empty() && !off.is_empty() {
            let names = off.iter().map(Input::name).collect();
            return Err(Error::AllHidden(param::few(names, "clouds").join(", ")));
        }
        self.cloud_settings.retain(|own| off.iter().all(|input| !is_of(own, input)));
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
        let again = self.mirror_points_of(file);
        self.mirror_points.retain(|known| !again.contains(known));
        self.furnish(file);
    }

    /// Adds the mirrors, lights, clips, measurements, notes, bookmarks and paths of a scene file, and hides what it hides.
    pub fn furnish(&mut self, file: &SceneFile) {
        self.paths.retain(|known| !file.paths.iter().any(|path| path.name == known.name));
        self.paths.extend(file.paths.iter().cloned());
        self.mirrors.extend(file.mirrors.iter().cloned());
        self.mirror_points.extend(self.mirror_points_of(file));
        self.take_cloud_settings(&file.cloud_settings);
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
    /// Takes over what a scene file says of single clouds.
    pub fn take_cloud_settings(&mut self, own: &[CloudSettings]) {
        let named = |own: &CloudSettings| CloudSettings { cloud: self.input_called(&own.cloud), ..own.clone() };
        let own: Vec<CloudSettings> = own.iter().map(named).collect();
        self.name_columns(&own);
        self.cloud_settings.retain(|known| !own.iter().any(|own| own.cloud == known.cloud));
        self.cloud_settings.extend(own);
    }

    fn mirror_points_of(&self, file: &SceneFile) -> Vec<MirrorPoints> {
        let named = |of: &MirrorPoints| MirrorPoints { cloud: self.input_called(&of.cloud), ..of.clone() };
        file.mirror_points.iter().map(named).collect()
    }

    /// The name of the input that `cloud` names. It is another word where a folder stands for the one file of it that is
    /// opened.
    fn input_called(&self, cloud: &str) -> String {
        let path = Path::new(cloud);
        let is_folder = path.is_dir() || codec::is_address(path) && cloud.ends_with('/');
        let name = if is_folder { input(cloud.as_ref(), false).ok().map(|input| input.name()) } else { None };
        name.filter(|name| self.inputs.iter().any(|input| input.name() == *name)).unwrap_or_else(|| cloud.to_owned())
    }

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
        [] => Err("a folder without files of points (.csv, .txt and .asc are not taken from folders)".into()),
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

/// Says that settings are of no cloud.
pub fn no_cloud(own: &CloudSettings) -> String {
    format!("cloud settings: no cloud is called `{}`", own.cloud)
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
#[path = "words_tests.rs"]
mod tests;
