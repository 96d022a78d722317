//! Scene files: which clouds, seen from where, with which parameters. TOML, small enough to read and to paste.
//!
//! ```toml
//! clouds = ["office.laz", "five-mirrors/sphere"]
//! [camera]
//! eye = [1.0, 2.0, 3.0]
//! pivot = [0.0, 0.0, 0.0]
//! up = [0.0, 0.0, 1.0]
//! [parameters]
//! "splat.size" = 2.0
//! [visibility]
//! hidden_classes = [7, 18]
//! filters = [{ attribute = "intensity", low = 100.0, high = 4000.0 }]
//! [[clips]]                            # shown: inside at least one, if any keeps its inside; and outside the others
//! shape = "box"                        # or "sphere", "slab", { prism = { points = [...], direction = [0, 0, 1] } }
//! position = [5.0, 5.0, 1.5]
//! size = [4.0, 3.0, 2.0]
//! keep = "inside"                      # or "outside"
//! [[mirrors]]
//! name = "ball"
//! shape = "sphere"                     # or { plane = { height = 0.75 } }, { mesh = "statue.ply" }, ...
//! position = [1.0, 0.0, 0.5]
//! size = 0.5
//! [[lights]]
//! position = [0.0, 0.0, 3.0]
//! target = [0.0, 0.0, 0.0]
//! intensity = [10.0, 10.0, 10.0]
//! inner_degrees = 20.0
//! outer_degrees = 25.0
//! [[mirror_points]]
//! cloud = "office.laz"
//! points = { class = 9 }               # or "all", { box = { min, max } }, { attribute = { name, low, high } }
//! normals = "flatten"                  # or "own", { smooth = { radius } }, { fit = { neighbours } }
//! [[cloud_settings]]                   # what one cloud has of its own
//! cloud = "office.laz"
//! on = true                            # whether it is shown
//! size = 1.5                           # of its points, relative to others
//! columns = "x,y,z,intensity"          # of a table, as `--columns` takes them
//! color = { by = "height", ramp = "viridis" }
//! [[measurements]]                     # of points on the clouds, for `glint measure`
//! kind = "distance"                    # or "point", "polyline", "height", "angle", "area", "plane", ...
//! points = [[0.0, 0.0, 0.0], [1.0, 2.0, 2.0]]
//! [[notes]]
//! text = "a crack"
//! position = [1.0, 2.0, 2.0]
//! [[bookmarks]]                        # kept views
//! name = "door"
//! digit = 1                            # Shift+1 flies there
//! eye = [1.0, 2.0, 1.7]
//! pivot = [4.0, 4.0, 1.5]
//! up = [0.0, 0.0, 1.0]
//! [[paths]]                            # of the camera, for `glint record`
//! name = "tour"
//! [[paths.keyframes]]
//! time = 0.0                           # seconds
//! eye = [1.0, 2.0, 1.7]
//! pivot = [4.0, 4.0, 1.5]
//! up = [0.0, 0.0, 1.0]
//! [[paths.captions]]                   # texts over its pictures
//! text = "by {reflection.method}"
//! [[paths.states]]                     # shown side by side, from left to right: two or three
//! method = "sscr"
//! [[paths.states]]
//! method = "ray_trace"
//! ```
//! The same text without `clouds` is what "copy view" puts on the clipboard and what `--camera` reads. A mirror with the name
//! of one that a built-in scene brings takes its place.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use toml::de::DeTable;

use crate::camera_path::PathProblem;
use crate::parameter_text::{text_of, value_of};
use crate::{
    Bookmark, Camera, CameraPath, Clip, CloudSettings, MOST_BOOKMARKS, MOST_CLIPS, MOST_MEASUREMENTS, MOST_MIRRORS,
    MOST_NOTES, MOST_PROFILES, Measurement, Mirror, MirrorPoints, Note, Object, Profile, Settings, Shape, SpotLight,
    Visibility, shown, whole_file,
};

/// The most filters of a scene: every point is tested against each.
const MOST_FILTERS: usize = 64;

/// The most clouds of a scene: a process may have 1,024 files open. A folder of tiles is one cloud.
const MOST_CLOUDS: usize = 1000;

/// The most entries for reflecting points, each of which is searched for in every cloud.
const MOST_MIRROR_POINTS: usize = 64;

/// A limit above the number of parameters.
const MOST_PARAMETERS: usize = 1000;

/// The most characters of a message about a scene.
const MOST_TOLD: usize = 400;

/// The most camera paths; each is for a recording of its own.
const MOST_PATHS: usize = 64;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A side file cannot be read as a whole. The problem contains the reason, so that is not given as `source` as
    /// well: it would be printed twice.
    #[error("{name}: {problem}")]
    Unreadable { name: String, kind: std::io::ErrorKind, problem: String },
    #[error("not a scene: {problem}")]
    Malformed { problem: String },
    #[error("{problem}")]
    Preferences { problem: String },
}

/// The content of a scene file. Relative cloud paths are relative to the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// The paths of clouds, or names of built-in scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clouds: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// The parameters that differ from their defaults, `group.name` to value.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, toml::Value>,
    /// Which points of the clouds are shown.
    #[serde(default, skip_serializing_if = "Visibility::shows_all")]
    pub visibility: Visibility,
    /// The clip volumes, which say where points are shown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clips: Vec<Clip>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mirrors: Vec<Mirror>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<SpotLight>,
    /// The points of the clouds that reflect.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mirror_points: Vec<MirrorPoints>,
    /// What single clouds have of their own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cloud_settings: Vec<CloudSettings>,
    /// What is measured at points of the clouds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measurements: Vec<Measurement>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<Note>,
    /// Kept views.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bookmarks: Vec<Bookmark>,
    /// Upright slices of the points.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub profiles: Vec<Profile>,
    /// The paths of the camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paths: Vec<CameraPath>,
}

/// A view read from text: camera and parameters, with warnings about unknown parts.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    pub camera: Option<Camera>,
    pub settings: Settings,
    /// Unknown keys and values out of range; everything else was applied.
    pub warnings: Vec<String>,
}

impl SceneFile {
    pub fn new(clouds: Vec<String>, camera: Camera, settings: &Settings) -> Self {
        let parameters = settings.differing().into_iter().map(|(key, text)| {
            let value = value_of(&key, &text);
            (key, value)
        });
        Self { clouds, camera: Some(camera), parameters: parameters.collect(), ..Self::default() }
    }

    /// Parses a scene.
    ///
    /// # Errors
    /// Not TOML, or not of this form: with the line. An invalid mirror or light: with its number and name.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let file: Self =
            whole_file::from_toml(text).map_err(|error| Error::Malformed { problem: problem_of(&error, text) })?;
        if let Some((key, problem)) = file.camera.as_ref().and_then(Camera::problem) {
            return Err(Error::Malformed { problem: format!("the camera's {key} is {problem}") });
        }
        match file.problem().or_else(|| file.odd_path(text)) {
            Some(problem) => Err(Error::Malformed { problem }),
            None => Ok(file),
        }
    }

    /// The first invalid path and the reason, with the line in the text from which the scene was read.
    fn odd_path(&self, text: &str) -> Option<String> {
        for (index, path) in self.paths.iter().enumerate() {
            let is_again = self.paths[..index].iter().any(|before| before.name == path.name);
            let again = || PathProblem { place: None, key: "name", problem: "another path has this name".into() };
            let Some(odd) = path.problem().or_else(|| is_again.then(again)) else { continue };
            let name = param::shortened(&path.name, param::MOST_QUOTED);
            let place = odd.place.map_or(String::new(), |(list, number)| {
                format!(", {} {}", list.strip_suffix('s').unwrap_or(list), number + 1)
            });
            let problem = param::shortened(&odd.problem, MOST_TOLD);
            let problem = format!("path {} (`{name}`){place}: {}: {problem}", index + 1, odd.key);
            return Some(match start_of(text, index, &odd) {
                Some(start) => at_line(text, start, &problem),
                None => problem,
            });
        }
        None
    }

    /// The objects that are drawn over the picture: measurements, notes and profiles.
    pub fn marks(&self) -> impl Iterator<Item = Object> {
        let measurements = self.measurements.iter().cloned().map(Object::Measurement);
        let notes = self.notes.iter().cloned().map(Object::Note);
        let profiles = self.profiles.iter().cloned().map(Object::Profile);
        measurements.chain(notes).chain(profiles)
    }

    /// Adds an object to the list of its kind.
    pub fn add(&mut self, object: Object) {
        match object {
            Object::Mirror(mirror) => self.mirrors.push(mirror),
            Object::Light(light) => self.lights.push(light),
            Object::Clip(clip) => self.clips.push(clip),
            Object::Measurement(measurement) => self.measurements.push(measurement),
            Object::Note(note) => self.notes.push(note),
            Object::Profile(profile) => self.profiles.push(profile),
        }
    }

    /// The first invalid object and the reason; paths are not looked at. A file with one cannot be opened.
    pub fn problem(&self) -> Option<String> {
        let numbered = |kind: &str, index: usize, name: &str, problem: Option<String>| {
            let name = param::shortened(name, param::MOST_QUOTED);
            let name = if name.is_empty() { name } else { format!(" (`{name}`)") };
            problem.map(|problem| format!("{kind} {}{name}: {}", index + 1, param::shortened(&problem, MOST_TOLD)))
        };
        let counts = [
            (self.clouds.len(), MOST_CLOUDS, "clouds"),
            (self.visibility.filters.len(), MOST_FILTERS, "filters"),
            (self.clips.len(), MOST_CLIPS, "clips"),
            (self.mirrors.len(), MOST_MIRRORS, "mirrors"),
            (self.mirror_points.len(), MOST_MIRROR_POINTS, "mirror_points"),
            (self.cloud_settings.len(), MOST_CLOUDS, "cloud_settings"),
            (self.measurements.len(), MOST_MEASUREMENTS, "measurements"),
            (self.notes.len(), MOST_NOTES, "notes"),
            (self.bookmarks.len(), MOST_BOOKMARKS, "bookmarks"),
            (self.profiles.len(), MOST_PROFILES, "profiles"),
            (self.paths.len(), MOST_PATHS, "paths"),
            (self.parameters.len(), MOST_PARAMETERS, "parameters"),
        ];
        if let Some((count, most, what)) = counts.into_iter().find(|(count, most, _)| count > most) {
            return Some(format!("{count} {what}, expected at most {most}"));
        }
        if let Some(index) = self.clouds.iter().position(String::is_empty) {
            return Some(format!("cloud {} has no name, expected a file or a built-in scene", index + 1));
        }
        let filters = self.visibility.filters.iter().enumerate();
        let mut filters = filters.filter_map(|(i, filter)| numbered("filter", i, &filter.attribute, filter.problem()));
        let clips = self.clips.iter().enumerate();
        let mut clips = clips.filter_map(|(i, clip)| numbered("clip", i, &clip.name, clip.problem()));
        let mirrors = self.mirrors.iter().enumerate();
        let mut mirrors = mirrors.filter_map(|(i, mirror)| numbered("mirror", i, &mirror.name, mirror.problem()));
        let lights = self.lights.iter().enumerate();
        let mut lights = lights.filter_map(|(i, light)| numbered("light", i, "", light.problem()));
        let points = self.mirror_points.iter().enumerate();
        let mut points = points.filter_map(|(i, points)| numbered("mirror points", i, &points.cloud, points.problem()));
        let measurements = self.measurements.iter().enumerate();
        let mut measurements = measurements.filter_map(|(i, one)| numbered("measurement", i, &one.name, one.problem()));
        let mut notes = self.notes.iter().enumerate();
        let mut rules = filters.by_ref().chain(clips.by_ref());
        let odd = rules.next().or_else(|| mirrors.next()).or_else(|| lights.next()).or_else(|| points.next());
        let own = self.cloud_settings.iter().enumerate();
        let mut own = own.filter_map(|(i, own)| numbered("cloud settings", i, &own.cloud, self.odd_settings(i, own)));
        let mut profiles = self.profiles.iter().enumerate();
        let odd = odd.or_else(|| own.next()).or_else(|| measurements.next());
        let odd = odd.or_else(|| profiles.find_map(|(i, one)| numbered("profile", i, &one.name, one.problem())));
        let mut bookmarks = self.bookmarks.iter().enumerate();
        let odd = odd.or_else(|| notes.find_map(|(i, note)| numbered("note", i, &note.text, note.problem())));
        odd.or_else(|| bookmarks.find_map(|(i, one)| numbered("bookmark", i, &one.name, one.problem())))
    }

    /// Why settings of a cloud are not valid, in words.
    fn odd_settings(&self, index: usize, own: &CloudSettings) -> Option<String> {
        let is_again = self.cloud_settings[..index].iter().any(|before| before.cloud == own.cloud);
        own.problem().or_else(|| is_again.then(|| "the cloud has settings already".into()))
    }

    /// Reads the scene, and resolves its clouds and meshes: a name is a path beside the scene file if something is
    /// there. The scene's folder may have a name that is not valid text. Meshes are not read.
    ///
    /// # Errors
    /// Not readable, or not a scene; names the file.
    pub fn read(path: &Path) -> Result<(Self, Vec<PathBuf>), Error> {
        Self::of_text(&whole_file::read(path)?, path)
    }

    /// The scene that the text of a file at a path describes, as `read` gives it.
    ///
    /// # Errors
    /// Not a scene; names the file.
    pub fn of_text(text: &str, path: &Path) -> Result<(Self, Vec<PathBuf>), Error> {
        let mut file = Self::parse(text).map_err(|error| Error::Unreadable {
            name: shown(path),
            kind: ErrorKind::InvalidData,
            problem: error.to_string(),
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let named = |cloud: &str| {
            let beside = folder.join(cloud);
            // Without a name it would be the folder itself.
            if !cloud.is_empty() && beside.exists() { beside } else { cloud.into() }
        };
        let clouds: Vec<PathBuf> = file.clouds.iter().map(|cloud| named(cloud)).collect();
        file.clouds = clouds.iter().map(shown).collect();
        for points in &mut file.mirror_points {
            points.cloud = shown(named(&points.cloud));
        }
        for own in &mut file.cloud_settings {
            own.cloud = shown(named(&own.cloud));
        }
        for mirror in &mut file.mirrors {
            if let Shape::Mesh(mesh) = &mut mirror.shape
                && mesh.is_file()
            {
                mesh.name = shown(named(&mesh.name));
            }
        }
        Ok((file, clouds))
    }

    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// The camera and the parameters; unknown parts become warnings, never failures.
    pub fn view(&self) -> View {
        let mut settings = Settings::default();
        let mut warnings = Vec::new();
        for (key, value) in &self.parameters {
            if let Err(error) = settings.set_text(key, &text_of(value)) {
                warnings.push(error.to_string());
            }
        }
        let camera = self.camera.map(|camera| Camera::from_eye(camera.eye, camera.pivot, camera.up));
        View { camera, settings, warnings: param::few(warnings, "parameters that are not understood") }
    }
}

/// The problem with a text that is no scene: where it is, what it is, and the line, in a readable length.
fn problem_of(error: &toml::de::Error, text: &str) -> String {
    let message = without_long_quotes(error.message());
    match error.span() {
        Some(span) => at_line(text, span.start, &message),
        None => message,
    }
}

/// The offset in bytes of the wrong value in the text of a scene.
fn start_of(text: &str, path: usize, odd: &PathProblem) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let path = root.get_ref().get("paths")?.get_ref().get(path)?;
    let of_list = |(list, number): (&str, usize)| path.get_ref().get(list)?.get_ref().get(number);
    let table = odd.place.and_then(of_list).unwrap_or(path);
    Some(table.get_ref().get(odd.key).unwrap_or(table).span().start)
}

/// A message with the line and column of a byte of the text, and a readable part of the line.
fn at_line(text: &str, start: usize, message: &str) -> String {
    let before = text.get(..start).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |end| end + 1);
    let line = text[line_start..].lines().next().unwrap_or_default();
    let column = before[line_start..].chars().count();
    // The part of a long line around the column.
    let shown: String = line.chars().skip(column.saturating_sub(param::MOST_QUOTED / 2)).collect();
    let shown = param::shortened(shown.trim(), param::MOST_QUOTED);
    let number = before.matches('\n').count() + 1;
    let line = if shown.is_empty() { String::new() } else { format!(", in `{shown}`") };
    format!("line {number}, column {}: {message}{line}", column + 1)
}

/// A message of the parser on one line, with shortened quotes.
fn without_long_quotes(message: &str) -> String {
    let shortened = |message: &str, mark: char| {
        let pieces = message.split(mark).map(|piece| param::shortened(piece, 2 * param::MOST_QUOTED));
        pieces.collect::<Vec<_>>().join(&mark.to_string())
    };
    let message = shortened(&message.trim().replace('\n', " "), '"');
    param::shortened(&shortened(&message, '`'), MOST_TOLD)
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::{Keyframe, MirrorMesh, MirrorNormals, PointChoice};

    #[test]
    fn a_view_survives_its_text_to_the_last_digit() {
        let mut settings = Settings::default();
        settings.set_text("splat.size", "0.3").unwrap();
        settings.set_text("splat.quality", "nearest").unwrap();
        settings.set_text("color.attribute", "7").unwrap();
        let camera = Camera::looking(
            DVec3::new(635_619.123_456_7, 848_899.7, 406.59),
            DVec3::new(1.0, -0.7, 0.3),
            123.456,
            DVec3::Z,
        );
        let text = SceneFile::new(vec!["a.laz".into()], camera, &settings).to_text();
        let back = SceneFile::parse(&text).unwrap();
        assert_eq!(back.clouds, ["a.laz"]);
        let view = back.view();
        assert!(view.warnings.is_empty(), "{:?}", view.warnings);
        assert_eq!(view.settings, settings);
        let back = view.camera.unwrap();
        assert!(back.eye.distance(camera.eye) < 1e-9 && back.pivot == camera.pivot, "{text}");
    }

    #[test]
    fn mirrors_lights_marked_points_and_paths_survive_the_text_to_the_last_digit() {
        let rotation = DQuat::from_euler(glam::EulerRot::ZXY, 0.1, 1.2, -2.3);
        let mirrors: Vec<Mirror> = Shape::WITH_FORMULA
            .into_iter()
            .chain([Shape::Mesh(MirrorMesh::hare()), Shape::Mesh("a.ply".to_owned().into())])
            .map(|shape| Mirror {
                rotation,
                specular_intensity: 0.9,
                color: [0.1, 0.2, 0.3],
                refraction: (shape == Shape::Sphere).then_some(1.5),
                as_points: shape == Shape::Blob,
                method: (shape == Shape::Torus { tube: 0.4 }).then_some(crate::Method::EnvironmentMap),
                ..Mirror::standing(shape, DVec3::new(635_619.123_456_7, 0.1, 1.0 / 3.0), DVec3::X, DVec3::Z, 0.7)
            })
            .collect();
        let points = |points, normals| MirrorPoints {
            cloud: "a.laz".into(),
            points,
            specular_intensity: 0.5,
            specular_power: 300.0,
            gloss: normals == MirrorNormals::Own,
            refraction: (normals == MirrorNormals::Flatten).then_some(1.33),
            normals,
        };
        let (min, max) = (DVec3::new(1e6 + 0.1, 0.0, 0.0), DVec3::new(1e6 + 0.3, 1.0, 2.0));
        let by_name = PointChoice::Attribute { name: "Deviation, 2nd".into(), low: -0.1, high: 0.3 };
        let keyframe = |time: f64| Keyframe { time, eye: max * time, pivot: min, up: DVec3::new(0.1, 0.0, 1.0 / 3.0) };
        let path = |name: &str| CameraPath {
            name: name.into(),
            keyframes: [0.0, 0.1, 1.0 / 3.0].map(keyframe).to_vec(),
            ..CameraPath::default()
        };
        let file = SceneFile {
            mirrors,
            lights: vec![crate::five_mirrors::light()],
            mirror_points: vec![
                points(PointChoice::All, MirrorNormals::Own),
                points(PointChoice::Class(9), MirrorNormals::Flatten),
                points(PointChoice::Box { min, max }, MirrorNormals::Smooth { radius: 0.1 }),
                points(by_name, MirrorNormals::Fit { neighbours: 12 }),
            ],
            paths: ["tour", "way back"].map(path).to_vec(),
            ..SceneFile::default()
        };
        let text = file.to_text();
        assert_eq!(SceneFile::parse(&text).unwrap(), file, "{text}");
        assert!(text.contains("specular_intensity = 0.9\n"), "{text}");
    }

    #[test]
    fn a_mirror_needs_no_more_than_shape_place_and_size() {
        let file = SceneFile::parse("[[mirrors]]\nshape = \"sphere\"\nposition = [0, 1.5, 2]\nsize = 0.5\n").unwrap();
        assert_eq!(file.mirrors[0].specular_intensity, 1.0);
        assert_eq!(file.mirrors[0].rotation, DQuat::IDENTITY);
        let file = SceneFile::parse("[[mirror_points]]\ncloud = \"lake.laz\"\npoints = { class = 9 }\n").unwrap();
        assert_eq!(file.mirror_points[0].points, PointChoice::Class(9));
    }

    #[test]
    fn the_example_of_the_documentation_is_a_scene() {
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/scenes.md");
        let page = std::fs::read_to_string(page).unwrap();
        let example = page.split("```toml").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
        let file = SceneFile::parse(example).unwrap();
        assert_eq!((file.mirrors.len(), file.lights.len(), file.mirror_points.len()), (2, 1, 1));
        assert_eq!(file.visibility.hidden_classes, [7, 18].into());
        assert_eq!((file.visibility.filters.len(), file.clips.len()), (1, 1));
        assert_eq!((file.paths.len(), file.paths[0].keyframes.len()), (1, 2));
        assert_eq!((file.measurements.len(), file.notes.len()), (1, 1));
        assert!(file.view().warnings.is_empty());
    }

    #[test]
    fn odd_objects_are_refused_by_number_and_name() {
        let refusal = |text: &str| SceneFile::parse(text).unwrap_err().to_string();
        let sphere = "[[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 1\n";
        let second =
            |line: &str| refusal(&format!("{sphere}{}name = \"ball\"\n{line}\n", sphere.replace("size = 1\n", "")));
        assert_eq!(second("size = 0"), "not a scene: mirror 2 (`ball`): size is 0, expected more than 0");
        assert!(second("size = nan").contains("mirror 2 (`ball`): size is NaN"));
        assert!(second("size = 1\nrotation = [0, 0, 0, 2]").contains("mirror 2 (`ball`): rotation"));
        let unknown = second("size = 1\nmethod = \"mirror\"");
        assert!(
            unknown.contains("`mirror` is no method; expected one of environment_map, mirrored_viewpoint, "),
            "{unknown}"
        );
        assert!(!unknown.contains("auto") && !unknown.contains("none"), "both are refused for one mirror: {unknown}");
        assert!(
            second("size = 1\nspecular_intensity = 1.01").contains("mirror 2 (`ball`): specular_intensity is 1.01")
        );
        assert!(second("size = 1\nrefraction = 0.75").contains("(`ball`): refraction is 0.75, expected 1 to 4"));
        assert!(second("size = 1\ncolour = [1, 1, 1]").contains("colour"));
        assert!(refusal("[[mirrors]]\nshape = \"ball\"\nposition = [0, 0, 0]\nsize = 1\n").contains("line 2"));
        let nameless = refusal("clouds = [\"five-mirrors\", \"\"]\n");
        assert!(nameless.contains("cloud 2 has no name, expected a file or a built-in scene"), "{nameless}");
        let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n";
        assert!(refusal(&format!("{light}inner_degrees = 30\nouter_degrees = 20\n")).contains("light 1: it opens"));
        let points = "[[mirror_points]]\ncloud = \"a.laz\"\n";
        assert!(refusal(&format!("{points}gloss = true")).contains("specular_power is 0"));
        assert!(refusal(&format!("{points}refraction = 5")).contains("refraction is 5, expected 1 to 4"));
        let glossy = "gloss = true\nspecular_power = 10\nrefraction = 1.33";
        assert!(refusal(&format!("{points}{glossy}")).contains("glossy points are none"));
        assert!(refusal(&format!("{points}specular_intensity = -1")).contains("mirror points 1 (`a.laz`)"));
        assert!(refusal(&format!("{points}normals = {{ smooth = {{ radius = 0 }} }}")).contains("radius"));
        assert!(refusal(&format!("{points}normals = {{ fit = {{ neighbours = 2 }} }}")).contains("3 to 64"));
        assert!(refusal(&format!("{points}points = {{ class = 256 }}")).contains("line 3"));
        let empty = "points = { attribute = { name = \"wet\", low = 2, high = 1 } }";
        assert!(refusal(&format!("{points}{empty}")).contains("range of wet"));
    }

    #[test]
    fn odd_paths_are_refused_with_line_and_key() {
        const FIRST: &str = "time = 1.0\neye = [1, 2, 3]\npivot = [4, 4, 1]\nup = [0, 0, 1]\n";
        let refusal = |text: &str| SceneFile::parse(text).unwrap_err().to_string();
        // The second keyframe begins in line 9, after an empty one.
        let second = |keyframe: &str| {
            refusal(&format!(
                "[[paths]]\nname = \"tour\"\n[[paths.keyframes]]\n{FIRST}\n[[paths.keyframes]]\n{keyframe}"
            ))
        };
        let changed = |from: &str, to: &str| second(&FIRST.replace(from, to));
        let late = "time: 1, expected more than the 1 of the keyframe before, in `time = 1.0`";
        assert_eq!(second(FIRST), format!("not a scene: line 10, column 8: path 1 (`tour`), keyframe 2: {late}"));
        for (time, told) in [("nan", "time: NaN"), ("-1", "time: -1, expected seconds from 0 on"), ("inf", "time: inf")]
        {
            let told = format!("line 10, column 8: path 1 (`tour`), keyframe 2: {told}");
            assert!(changed("1.0", time).contains(&told), "{}", changed("1.0", time));
        }
        let later = FIRST.replace("1.0", "2.0");
        let wrong = |from: &str, to: &str| second(&later.replace(from, to));
        assert!(wrong("[1, 2", "[nan, 2").contains("line 11, column 7: path 1 (`tour`), keyframe 2: eye: not finite"));
        assert!(
            wrong("[4, 4", "[1e31, 4").contains("line 12, column 9: path 1 (`tour`), keyframe 2: pivot: not finite")
        );
        assert!(wrong("[0, 0, 1]", "[0, 0, 0]").contains("line 13, column 6: path 1 (`tour`), keyframe 2: up: no dir"));
        assert!(wrong("up =", "roll =").contains("line 13, column 1: unknown field `roll`"));
        assert!(wrong("up = [0, 0, 1]\n", "").contains("missing field `up`"));
        let whole = |name: &str| format!("[[paths]]\nname = \"{name}\"\n[[paths.keyframes]]\n{FIRST}");
        let twice = "line 9, column 8: path 2 (`tour`): name: another path has this name";
        assert!(refusal(&[whole("tour"), whole("tour")].concat()).contains(twice));
        assert!(SceneFile::parse(&[whole("tour"), whole("way back")].concat()).is_ok());
        assert!(refusal(&whole(" ")).contains("line 2, column 8: path 1 (` `): name: a path needs a name"));
        let none = "line 1, column 1: path 1 (`a`): keyframes: a path needs at least one keyframe";
        assert!(refusal("[[paths]]\nname = \"a\"").contains(none));
        assert!(
            refusal("[[paths]]\nname = \"a\"\nkeyframes = []").contains("line 3, column 13: path 1 (`a`): keyframes")
        );
        // Nobody waits so long, and clocks do not go so far.
        for time in ["1.1e7", "1e300"] {
            let long = changed("1.0", time);
            assert!(long.contains("path 1 (`tour`): keyframes: the path lasts 1"), "{long}");
            assert!(long.contains("seconds, expected at most 1e7"), "{long}");
        }
        let slow = FIRST.replace("1.0", "2.0").replace("eye = [1", "eye = [1.5");
        let first = whole("tour").replace("[[paths.keyframes]]", "speed = 1e-9\n[[paths.keyframes]]");
        let slow = refusal(&format!("{first}[[paths.keyframes]]\n{slow}"));
        assert!(slow.contains("speed: the path lasts 5"), "{slow}");
        let many: String = (0..65).map(|index| whole(&format!("tour {index}"))).collect();
        assert!(refusal(&many).contains("65 paths, expected at most 64"));
    }

    #[test]
    fn unknown_parameters_are_warned_of_and_the_rest_is_taken() {
        let view =
            SceneFile::parse("[parameters]\n\"splat.size\" = 2\n\"splat.colour\" = 3\n\"edl.strength\" = 99.0\n")
                .unwrap()
                .view();
        assert_eq!(view.settings.splat.size, 2.0);
        assert_eq!(view.warnings.len(), 2, "{:?}", view.warnings);
    }

    #[test]
    fn messages_about_a_scene_are_short_whatever_it_holds() {
        let long = "x".repeat(1_000_000);
        let refused = [
            format!("clouds = [\"{long}\""),
            format!("clouds = \"{long}\""),
            format!("{long} = 1"),
            format!("clouds = [] {long}"),
            format!("[[mirrors]]\nname = \"{long}\"\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 0"),
            format!("[[mirrors]]\nshape = \"{long}\"\nposition = [0, 0, 0]\nsize = 1"),
            format!("[[mirror_points]]\ncloud = \"{long}\"\nspecular_intensity = 2"),
            format!(
                "[[mirror_points]]\ncloud = \"a\"\npoints = {{ attribute = {{ name = \"{long}\", low = 2, high = 1 }} }}"
            ),
        ];
        for text in refused {
            let error = SceneFile::parse(&text).unwrap_err().to_string();
            assert!(error.len() < 800 && error.lines().count() == 1, "{} bytes: {error}", error.len());
        }
        let many: String = (0..900).map(|index| format!("\"splat.size{index}\" = 1\n")).collect();
        let odd = format!("[parameters]\n\"{long}\" = 1\n\"color.by\" = \"{long}\"\n{many}");
        let warnings = SceneFile::parse(&odd).unwrap().view().warnings;
        assert_eq!(warnings.len(), 4, "{warnings:?}");
        assert_eq!(warnings[3], "and 899 more parameters that are not understood");
        assert!(warnings.iter().all(|warning| warning.len() < 400), "{warnings:?}");
    }

    #[test]
    fn a_scene_of_more_than_can_be_shown_is_refused_with_the_limit() {
        let refusal = |text: &str| SceneFile::parse(text).unwrap_err().to_string();
        let mirror = "[[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 1\n";
        assert_eq!(refusal(&mirror.repeat(8000)), "not a scene: 8000 mirrors, expected at most 64");
        assert!(SceneFile::parse(&mirror.repeat(MOST_MIRRORS)).is_ok());
        assert!(
            refusal(&format!("clouds = [{}]", "\"a.las\", ".repeat(3000)))
                .contains("3000 clouds, expected at most 1000")
        );
        let points = "[[mirror_points]]\ncloud = \"a.las\"\n";
        assert!(refusal(&points.repeat(65)).contains("65 mirror_points, expected at most 64"));
        let parameters: String = (0..20_000).map(|index| format!("\"a{index}\" = 1\n")).collect();
        assert!(refusal(&format!("[parameters]\n{parameters}")).contains("20000 parameters"));
    }

    #[test]
    fn broken_scenes_say_where() {
        let error = SceneFile::parse("clouds = [").unwrap_err().to_string();
        assert!(error.contains("line 1"), "{error}");
        assert!(SceneFile::parse("cluods = []").unwrap_err().to_string().contains("cluods"));
        for (eye, up, problem) in [
            ("nan", "1", "the camera's eye is not finite, or beyond 1e30"),
            ("-inf", "1", "the camera's eye is not finite"),
            ("-1e308", "1", "the camera's eye is not finite"),
            ("1", "nan", "the camera's up is no direction"),
            ("1", "0", "the camera's up is no direction"),
            ("1", "1e200", "the camera's up is no direction"),
        ] {
            let camera = format!("[camera]\neye=[{eye},0,0]\npivot=[0,0,0]\nup=[0,0,{up}]");
            assert!(SceneFile::parse(&camera).unwrap_err().to_string().contains(problem), "{eye}, {up}");
        }
    }
}
