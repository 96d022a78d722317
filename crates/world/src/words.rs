//! Finds what the words of a command line or of a scene file name: files, folders of tiles, built-in scenes.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use cloud::PointTest;
use cloud::sampling::Surface;
use glam::DVec3;
use scene::{
    Bookmark, CameraPath, Clip, CloudSettings, Measurement, Mirror, MirrorPoints, Object, Paging, Profile, SceneFile,
    Settings, SpotLight, View, Visibility, five_mirrors, shown, whole_file,
};

use crate::error::{Error, Result};
use crate::input::{Input, built_in_name, walls_name};
use crate::source::{called, file_name, lost_tiles, open_file, open_placed, parts};
use crate::tiles::Tiles;

/// All words of a command line together.
#[derive(Clone, Debug, Default)]
pub struct Request {
    pub inputs: Vec<Input>,
    /// The scene files that were read, with their texts.
    pub scene_files: Vec<(PathBuf, Arc<str>)>,
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
    /// What the clouds of its inputs are called, as far as somebody has asked for it.
    pub names: KnownNames,
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

    /// What the cloud has of its own that a scan of an input is in.
    fn own_of(&self, input: &Input, scan: &codec::Info, memory: u64) -> Option<&CloudSettings> {
        if self.cloud_settings.is_empty() {
            return None;
        }
        let alone = [shown(&scan.path), scan.name()];
        let [path, name] = if input.has_tiles() {
            let whole = [input.name(), file_name(Path::new(&input.name()))];
            let begins = |own: &CloudSettings| whole.iter().any(|whole| own.cloud.starts_with(whole));
            if !self.cloud_settings.iter().any(|own| own.is_of(&alone[0], &alone[1]) || begins(own)) {
                return None;
            }
            self.names_of(input, memory).of(scan).cloned().unwrap_or(alone)
        } else {
            alone
        };
        self.cloud_settings.iter().find(|own| own.is_of(&path, &name))
    }

    /// What pictures call the clouds of an input. Opens all of its files, once.
    fn names_of(&self, input: &Input, memory: u64) -> Arc<CloudNames> {
        let settings = self.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
        let key = (input.name(), input.files().first().cloned(), settings.stream.pages == Paging::Never);
        let mut known = self.names.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, names)) = known.iter().find(|(of, _)| *of == key) {
            return names.clone();
        }
        let names = Arc::new(cloud_names(input, &settings, memory));
        known.push((key, names.clone()));
        names
    }

    /// Warns of settings that no cloud has. Files are opened only if some settings do not name a file as it was given.
    pub fn settings_without_cloud(&self, memory: u64) -> Vec<String> {
        let mut left: Vec<&CloudSettings> = self.cloud_settings.iter().collect();
        for input in &self.inputs {
            let given = input.name();
            left.retain(|own| input.has_tiles() || own.cloud != given);
            if left.is_empty() {
                break;
            }
            match input {
                Input::BuiltIn { variant, .. } => left.retain(|own| own.cloud != walls_name(*variant)),
                _ => left.retain(|own| !self.is_of_cloud(own, input, memory)),
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
        if sources.len() > 1 || input.has_tiles() {
            let is_on = |info: &codec::Info| self.own_of(input, info, memory).is_none_or(|own| own.on);
            let lost: Vec<String> = lost_tiles(&sources).cloned().collect();
            sources.retain(|source| is_on(source.info()));
            // What one that is switched off has noted is still to be told.
            if let Some(first) = sources.first_mut().and_then(Arc::get_mut) {
                first.lose(lost);
            }
        }
        Ok(sources)
    }

    /// All files, each with its input.
    pub fn files(&self) -> Vec<(Input, PathBuf)> {
        let all = self.inputs.iter().flat_map(|input| input.files().iter().map(move |file| (input, file)));
        all.map(|(input, file)| (input.clone(), file.clone())).collect()
    }

    /// Leaves out the inputs whose clouds are all switched off. Of the others, `open` leaves out those that are.
    ///
    /// # Errors
    /// If none is left; it names the first few.
    pub fn leave_out_hidden(&mut self, memory: u64) -> Result<()> {
        let is_off = |input: &Input| self.is_off(input, memory);
        let (off, on): (Vec<Input>, Vec<Input>) = self.inputs.iter().cloned().partition(is_off);
        if on.is_empty() && !off.is_empty() {
            let names = off.iter().map(Input::name).collect();
            return Err(Error::AllHidden(param::few(names, "clouds").join(", ")));
        }
        let has = |inputs: &[Input], own: &CloudSettings| {
            inputs.iter().any(|input| is_named(own, input) || self.is_of_cloud(own, input, memory))
        };
        let is_kept = |own: &&CloudSettings| !has(&off, own) || has(&on, own);
        self.cloud_settings = self.cloud_settings.iter().filter(is_kept).cloned().collect();
        self.inputs = on;
        Ok(())
    }

    /// Whether all clouds of an input are switched off. Its files are opened if their names have to be known for that.
    fn is_off(&self, input: &Input, memory: u64) -> bool {
        let mut off = self.cloud_settings.iter().filter(|own| !own.on);
        if off.clone().any(|own| is_named(own, input)) {
            return true;
        }
        if !off.any(|own| may_be_of_cloud(own, input)) {
            return false;
        }
        let names = self.names_of(input, memory);
        let own = |[path, name]: &[String; 2]| self.cloud_settings.iter().find(|own| own.is_of(path, name));
        names.all().next().is_some() && names.all().all(|names| own(names).is_some_and(|own| !own.on))
    }

    /// Whether settings are those of a cloud of an input. Its files are opened if that is not sure without them.
    fn is_of_cloud(&self, own: &CloudSettings, input: &Input, memory: u64) -> bool {
        may_be_of_cloud(own, input) && self.names_of(input, memory).all().any(|[path, name]| own.is_of(path, name))
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
/// other words count. An input that is named more than once is opened once. Servers of addresses are those that a person
/// has typed.
pub fn resolve<Word: AsRef<OsStr>>(words: &[Word]) -> Request {
    for word in words {
        codec::trust_address(Path::new(word));
    }
    resolve_written(words)
}

/// Finds what words of a file name, as those of a plan of a study: no person has typed their addresses.
pub fn resolve_written<Word: AsRef<OsStr>>(words: &[Word]) -> Request {
    let mut request = Request::default();
    let mut files = Vec::new();
    let mut unknown = 0;
    // Suggestions search a folder, which takes time: only for the first few words.
    let mut named = |word: &OsStr, place: &str| {
        input(word, unknown < HINTS).unwrap_or_else(|error| {
            unknown += 1;
            Input::Unknown { name: shown(word), error: format!("{place}{error}") }
        })
    };
    for word in words {
        let path = Path::new(word);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            let name = shown(path);
            let read = whole_file::read(path).and_then(|text| Ok((SceneFile::of_text(&text, path)?, text)));
            let ((file, clouds), text) = match read {
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
            request.scene_files.push((path.to_owned(), text.into()));
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

/// The inputs that words name, whose clouds are open in the window and have this of their own: `settings` decide what
/// they are called.
pub fn resolve_open(words: &[String], own: Vec<CloudSettings>, settings: &Settings) -> Request {
    // What a person has typed was trusted when it was opened; a scene may have named the others.
    let mut request = resolve_written(words);
    request.cloud_settings.extend(own);
    request.view = Some(View { camera: None, settings: settings.clone(), warnings: Vec::new() });
    request
}

/// The number of unknown words that get a suggestion.
const HINTS: usize = 3;

/// Leaves out inputs that are named again, also files of folders that are named, and warns of them.
fn open_once(request: &mut Request) {
    let is_file = |input: &Input| matches!(input, Input::File(_));
    let has_files = request.inputs.iter().any(is_file);
    let folders = request.inputs.iter().filter(|input| has_files && matches!(input, Input::Tiles { .. }));
    let tiles: HashSet<PathBuf> = folders.flat_map(Input::files).map(|file| whole(file)).collect();
    let mut known = HashSet::new();
    let mut again = Vec::new();
    request.inputs.retain(|input| {
        let Some(place) = place_of(input) else { return true };
        let is_new = !(is_file(input) && tiles.contains(&place)) && known.insert(place);
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
        return Err(format!("{name}: a link to {}, which leads to nothing", shown(&target)));
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

/// Whether settings name a whole input whose clouds need not be known for that.
fn is_named(own: &CloudSettings, input: &Input) -> bool {
    match input {
        Input::File(_) if !input.has_tiles() => own.cloud == input.name(),
        Input::BuiltIn { .. } | Input::Unknown { .. } => {
            let name = input.name();
            own.is_of(&name, &file_name(Path::new(&name)))
        }
        Input::File(_) | Input::Tiles { .. } => false,
    }
}

/// Whether settings may be those of a cloud of an input, as far as that can be said without opening its files.
fn may_be_of_cloud(own: &CloudSettings, input: &Input) -> bool {
    let has_name = |path: &Path| {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        own.cloud.starts_with(name.as_ref())
    };
    let begins = |path: &Path| own.cloud.starts_with(&shown(path)) || has_name(path);
    match input {
        // The names of the tiles of a catalogue are in it.
        Input::File(_) if input.has_tiles() => true,
        Input::File(path) => begins(path) || path.ends_with("ept.json") && path.parent().is_some_and(begins),
        Input::Tiles { folder, files } => begins(folder) || files.iter().any(|file| has_name(file)),
        Input::BuiltIn { .. } | Input::Unknown { .. } => false,
    }
}

/// What pictures call the clouds of an input: the path that a cloud comes from, and its name.
#[derive(Debug, Default)]
struct CloudNames {
    /// Those of the only cloud, if they are known without opening its files.
    only: Option<[String; 2]>,
    /// Those of the cloud that each scan is in, by its file and its number there.
    of_scans: BTreeMap<(PathBuf, usize), [String; 2]>,
}

impl CloudNames {
    fn of(&self, scan: &codec::Info) -> Option<&[String; 2]> {
        self.only.as_ref().or_else(|| self.of_scans.get(&(scan.path.clone(), scan.scan_number())))
    }

    fn all(&self) -> impl Iterator<Item = &[String; 2]> {
        self.only.iter().chain(self.of_scans.values())
    }
}

/// An input by its name and its first file, whether it is opened without streaming, and the names of its clouds.
type NamesOfInput = ((String, Option<PathBuf>, bool), Arc<CloudNames>);

/// The names of the clouds of those inputs that were asked for.
#[derive(Clone, Debug, Default)]
pub struct KnownNames(Arc<Mutex<Vec<NamesOfInput>>>);

/// Finds which clouds the files of an input become. What cannot be opened is in none.
fn cloud_names(input: &Input, settings: &Settings, memory: u64) -> CloudNames {
    if Tiles::are_of(input, settings) {
        let path = input.name();
        let name = file_name(Path::new(&path));
        return CloudNames { only: Some([path, name]), ..CloudNames::default() };
    }
    let files = input.files().iter().flat_map(|file| open_file(file, memory).unwrap_or_default());
    let sources: Vec<Arc<codec::Source>> = files.collect();
    let is_empty = sources.iter().all(|source| source.info().points == 0);
    let clouds: Vec<Vec<Arc<codec::Source>>> = if settings.stream.pages == Paging::Never || is_empty {
        sources.into_iter().map(|source| vec![source]).collect()
    } else {
        parts(sources, &BTreeSet::new()).into_iter().map(|(sources, _)| sources).collect()
    };
    let is_all = clouds.len() == 1;
    let names = clouds.iter().flat_map(|sources| {
        let (path, name) = called(input, sources, is_all);
        let scans = sources.iter().map(|source| (source.info().path.clone(), source.info().scan_number()));
        scans.map(move |scan| (scan, [shown(&path), name.clone()])).collect::<Vec<_>>()
    });
    CloudNames { only: None, of_scans: names.collect() }
}

/// Says that settings are of no cloud.
pub fn no_cloud(own: &CloudSettings) -> String {
    format!("cloud settings: no cloud is called `{}`", own.cloud)
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
