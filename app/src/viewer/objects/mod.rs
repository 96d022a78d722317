//! The user's side of the scene apart from the clouds: mirrors, points that are turned into mirrors, lights, clip
//! volumes, the other rules that say which points are shown, measurements and notes. Undo restores all of them in one
//! step. `Loaded::sync_objects` and `Loaded::sync_visibility` send them to the render thread; lights go with each frame
//! request.

pub mod clouds;
pub mod figures;
pub mod history;
pub mod inspection;
pub mod posed;
pub mod tracks;

use cloud::PointTest;
use glam::DVec3;
use scene::{
    Bookmark, CameraPath, Clip, CloudSettings, Measurement, Mirror, MirrorPoints, Note, Object, ObjectKind, Profile,
    SceneFile, Shape, SpotLight, Visibility, five_mirrors,
};
use world::{CloudKey, built_in_name};

/// Identifies an object. An object that comes back by undo has its old number; no other object ever gets it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectId(pub u32);

#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    pub id: ObjectId,
    pub mirror: Mirror,
    /// The name of the built-in scene that brought the mirror.
    pub input: Option<String>,
}

/// Where a light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A person added or changed it, or a scene file brought it.
    Person,
    BuiltIn,
    /// A guessed lamp replaces the light that the scan of a room lacks. It is always the only light, and scene files
    /// leave it out.
    Guess,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedLight {
    pub id: ObjectId,
    /// What the list of lights calls it beside its number. Scene files do not keep it.
    pub name: String,
    pub light: SpotLight,
    pub origin: Origin,
}

/// The name of a light that was not guessed.
pub const SPOT: &str = "spot";
/// The name of the guessed lamp.
pub const GUESSED_LAMP: &str = "lamp (guessed)";

/// Returns the mirror without its name, which no picture shows.
pub fn unnamed(mirror: &Mirror) -> Mirror {
    Mirror { name: String::new(), ..mirror.clone() }
}

/// Points of a cloud that are marked as a mirror.
#[derive(Clone, Debug, PartialEq)]
pub struct Marking {
    pub key: CloudKey,
    pub points: MirrorPoints,
}

/// What an open cloud has of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnSettings {
    pub key: CloudKey,
    /// The words that opened the cloud; the clouds of a folder have the same.
    pub input: String,
    pub settings: CloudSettings,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objects {
    pub mirrors: Vec<Placed>,
    pub markings: Vec<Marking>,
    /// In no order; clouds that have nothing of their own are left out.
    pub own_settings: Vec<OwnSettings>,
    /// All lights; only the first four shine.
    pub lights: Vec<PlacedLight>,
    /// True after a person removed the last light: then no lamp is guessed.
    pub no_guess: bool,
    /// The clip volumes: with the visibility they say which points of the clouds are shown.
    pub clips: Vec<PlacedClip>,
    pub visibility: Visibility,
    pub measurements: Vec<PlacedMeasurement>,
    pub notes: Vec<PlacedNote>,
    pub profiles: Vec<PlacedProfile>,
    pub bookmarks: Vec<Bookmark>,
    /// The camera paths; no two have one name.
    pub paths: Vec<CameraPath>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMeasurement {
    pub id: ObjectId,
    pub measurement: Measurement,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedNote {
    pub id: ObjectId,
    pub note: Note,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedProfile {
    pub id: ObjectId,
    pub profile: Profile,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedClip {
    pub id: ObjectId,
    pub clip: Clip,
}

impl Objects {
    pub fn mirror(&self, id: ObjectId) -> Option<&Mirror> {
        self.mirrors.iter().find(|placed| placed.id == id).map(|placed| &placed.mirror)
    }

    /// What a cloud has of its own, if it has anything.
    pub fn settings_of(&self, key: CloudKey) -> Option<&CloudSettings> {
        self.own_settings.iter().find(|own| own.key == key).map(|own| &own.settings)
    }

    /// What all clouds have of their own.
    pub fn all_own(&self) -> Vec<CloudSettings> {
        self.own_settings.iter().map(|own| own.settings.clone()).collect()
    }

    /// The colour parameters of a cloud, where the view has `all`.
    pub fn color_of(&self, key: CloudKey, all: &scene::Color) -> scene::Color {
        self.settings_of(key).map_or_else(|| all.clone(), |own| own.color_of(all))
    }

    /// Sets what a cloud has of its own, if that is valid.
    pub fn set_own(&mut self, own: OwnSettings) {
        if own.settings.problem().is_some() {
            return;
        }
        match self.own_settings.iter().position(|known| known.key == own.key) {
            Some(index) if own.settings.say_nothing() => drop(self.own_settings.remove(index)),
            Some(index) => self.own_settings[index] = own,
            None if own.settings.say_nothing() => {}
            None => self.own_settings.push(own),
        }
    }

    /// The objects without what only says how clouds look, which is quickly chosen again: what they have of their own,
    /// and hidden classes.
    pub fn made(&self) -> Self {
        let visibility = Visibility { filters: self.visibility.filters.clone(), ..Visibility::default() };
        Self { own_settings: Vec::new(), visibility, ..self.clone() }
    }

    /// Whether there is anything that `inputs` do not bring by themselves and that is more than the look of a cloud.
    pub fn has_more_than(&self, inputs: &[String]) -> bool {
        let SceneFile { mirrors, mirror_points, lights, visibility, .. } = self.scene_file(inputs);
        let has_more = !(mirrors.is_empty() && mirror_points.is_empty() && lights.is_empty());
        // Inputs bring mirrors and lights, and no object of another kind.
        let is_own = |object: &Object| !matches!(object, Object::Mirror(_) | Object::Light(_));
        let has_own = self.all().any(|(.., object)| is_own(&object));
        let has_views = !(self.bookmarks.is_empty() && self.paths.is_empty());
        has_more || has_own || has_views || !visibility.filters.is_empty()
    }

    /// Decides which points of the clouds are shown.
    pub fn test(&self) -> PointTest {
        self.visibility.test(self.clips.iter().map(|placed| &placed.clip))
    }

    pub fn light(&self, id: ObjectId) -> Option<&SpotLight> {
        self.lights.iter().find(|placed| placed.id == id).map(|placed| &placed.light)
    }

    /// Returns all objects with their names.
    pub fn all(&self) -> impl Iterator<Item = (ObjectId, &str, Object)> {
        let mirrors = self.mirrors.iter();
        let mirrors = mirrors.map(|p| (p.id, p.mirror.name.as_str(), Object::Mirror(p.mirror.clone())));
        let lights = self.lights.iter().map(|p| (p.id, p.name.as_str(), Object::Light(p.light)));
        let clips = self.clips.iter().map(|p| (p.id, p.clip.name.as_str(), Object::Clip(p.clip.clone())));
        let measurements = self.measurements.iter();
        let measurements =
            measurements.map(|p| (p.id, p.measurement.name.as_str(), Object::Measurement(p.measurement.clone())));
        let notes = self.notes.iter().map(|p| (p.id, p.note.text.as_str(), Object::Note(p.note.clone())));
        let profiles = self.profiles.iter();
        let profiles = profiles.map(|p| (p.id, p.profile.name.as_str(), Object::Profile(p.profile.clone())));
        mirrors.chain(lights).chain(clips).chain(measurements).chain(notes).chain(profiles)
    }

    pub fn get(&self, id: ObjectId) -> Option<(&str, Object)> {
        self.all().find(|(known, ..)| *known == id).map(|(_, name, object)| (name, object))
    }

    pub fn count(&self, kind: &ObjectKind) -> usize {
        self.all().filter(|(.., object)| object.kind().name == kind.name).count()
    }

    /// Changes an object, if the new value is valid and there is an object of its kind with this number. A light that a
    /// person changes becomes that person's. A new name of what tracks know by name is a free one, and theirs as well.
    pub fn set(&mut self, id: ObjectId, mut object: Object) {
        if object.problem().is_some() {
            return;
        }
        if self.is_renamed(id, &object) {
            self.name_freely(&mut object, Some(id));
            self.keep_tracks(|objects| objects.put(id, object));
        } else {
            self.put(id, object);
        }
    }

    fn put(&mut self, id: ObjectId, object: Object) {
        match object {
            Object::Mirror(mirror) => {
                if let Some(placed) = self.mirrors.iter_mut().find(|placed| placed.id == id) {
                    placed.mirror = mirror;
                }
            }
            Object::Light(light) => {
                let is_other = |placed: &PlacedLight| placed.id == id && placed.light != light;
                if let Some(index) = self.lights.iter().position(is_other) {
                    self.accept_guess();
                    (self.lights[index].light, self.lights[index].origin) = (light, Origin::Person);
                }
            }
            Object::Clip(clip) => {
                if let Some(placed) = self.clips.iter_mut().find(|placed| placed.id == id) {
                    placed.clip = clip;
                }
            }
            Object::Measurement(measurement) => {
                if let Some(placed) = self.measurements.iter_mut().find(|placed| placed.id == id) {
                    placed.measurement = measurement;
                }
            }
            Object::Note(note) => {
                if let Some(placed) = self.notes.iter_mut().find(|placed| placed.id == id) {
                    placed.note = note;
                }
            }
            Object::Profile(profile) => {
                if let Some(placed) = self.profiles.iter_mut().find(|placed| placed.id == id) {
                    placed.profile = profile;
                }
            }
        }
    }

    /// Adds an object under a free name.
    pub fn add(&mut self, id: ObjectId, mut object: Object) {
        self.name_freely(&mut object, None);
        self.push(id, object);
    }

    /// Adds an object as it is.
    pub fn push(&mut self, id: ObjectId, object: Object) {
        match object {
            Object::Mirror(mirror) => self.mirrors.push(Placed { id, mirror, input: None }),
            Object::Light(light) => {
                self.accept_guess();
                self.lights.push(PlacedLight { id, name: SPOT.into(), light, origin: Origin::Person });
            }
            Object::Clip(clip) => self.clips.push(PlacedClip { id, clip }),
            Object::Measurement(measurement) => self.measurements.push(PlacedMeasurement { id, measurement }),
            Object::Note(note) => self.notes.push(PlacedNote { id, note }),
            Object::Profile(profile) => self.profiles.push(PlacedProfile { id, profile }),
        }
    }

    /// Gives the mirrors of this mesh its triangles.
    pub fn learn_mesh(&mut self, shape: &Shape) {
        self.mirrors.iter_mut().filter(|placed| placed.mirror.shape == *shape).for_each(|placed| {
            placed.mirror.shape = shape.clone();
        });
    }

    pub fn remove(&mut self, id: ObjectId) {
        let lights = self.lights.len();
        self.keep(|known| known != id);
        self.no_guess |= self.lights.len() < lights && self.lights.is_empty();
    }

    /// Removes all objects but those of these numbers, and the tracks of those that go.
    pub fn keep(&mut self, is_kept: impl Fn(ObjectId) -> bool) {
        self.keep_tracks(|objects| {
            objects.mirrors.retain(|placed| is_kept(placed.id));
            objects.lights.retain(|placed| is_kept(placed.id));
            objects.clips.retain(|placed| is_kept(placed.id));
            objects.measurements.retain(|placed| is_kept(placed.id));
            objects.notes.retain(|placed| is_kept(placed.id));
            objects.profiles.retain(|placed| is_kept(placed.id));
        });
    }

    /// Sets the guessed lamp of a room if the scene has no other light; a new one gets `id`. `None` removes the lamp.
    pub fn guess(&mut self, id: ObjectId, lamp: Option<SpotLight>) {
        match (lamp, self.has_guess()) {
            (Some(light), true) => self.lights[0].light = light,
            (Some(light), false) if self.lights.is_empty() && !self.no_guess => {
                self.lights.push(PlacedLight { id, name: GUESSED_LAMP.into(), light, origin: Origin::Guess });
            }
            (Some(_), false) => {}
            (None, _) => self.lights.retain(|placed| placed.origin != Origin::Guess),
        }
    }

    /// Turns a guessed lamp into a person's light, because lights are now edited.
    fn accept_guess(&mut self) {
        for placed in self.lights.iter_mut().filter(|placed| placed.origin == Origin::Guess) {
            (placed.name, placed.origin) = ("lamp".into(), Origin::Person);
        }
    }

    /// Returns true if the only light is a guess.
    pub fn has_guess(&self) -> bool {
        matches!(self.lights.as_slice(), [PlacedLight { origin: Origin::Guess, .. }])
    }

    /// Returns `wanted`, with a number if another object of the kind has that name: scene files and tracks identify
    /// objects by name.
    pub fn free_name(&self, kind: &str, wanted: &str, except: Option<ObjectId>) -> String {
        let wanted = if wanted.trim().is_empty() { kind } else { wanted.trim() };
        let others = self.all().filter(|(id, _, other)| Some(*id) != except && other.kind().name == kind);
        numbered(wanted, others.map(|(_, name, _)| name))
    }

    /// Gives an object a free name, if objects of its kind have names.
    fn name_freely(&self, object: &mut Object, except: Option<ObjectId>) {
        let kind = object.kind().name;
        let (name, unnamed) = match object {
            Object::Mirror(mirror) => (&mut mirror.name, kind),
            Object::Clip(clip) => (&mut clip.name, clip.shape.name()),
            Object::Measurement(measurement) => (&mut measurement.name, measurement.kind.name()),
            Object::Profile(profile) => (&mut profile.name, kind),
            Object::Light(_) | Object::Note(_) => return,
        };
        let wanted = if name.trim().is_empty() { unnamed } else { name.as_str() };
        *name = self.free_name(kind, wanted, except);
    }

    /// Returns a scene file of `inputs` with these objects. Mirrors that are as their built-in scene brings them are
    /// left out. If a scene of five-mirrors lacks one of its own mirrors, the file names the box without mirrors
    /// and lists those that are left. The lights are left out if all of them come without the file, because lights in a file
    /// replace those.
    pub fn scene_file(&self, inputs: &[String]) -> SceneFile {
        let variant = |input: &str| five_mirrors::Variant::ALL.into_iter().find(|known| built_in_name(*known) == input);
        let own_mirrors = |input: &str| variant(input).map(five_mirrors::Variant::mirrors).unwrap_or_default();
        let of_input = |input: &str, name: &str| {
            self.mirrors.iter().any(|placed| placed.input.as_deref() == Some(input) && placed.mirror.name == name)
        };
        let is_whole = |input: &str| own_mirrors(input).iter().all(|own| of_input(input, &own.name));
        let is_brought = |placed: &Placed| {
            let input = placed.input.as_deref().filter(|input| inputs.iter().any(|known| known == input));
            input.is_some_and(|input| is_whole(input) && own_mirrors(input).contains(&placed.mirror))
        };
        let written = |input: &String| {
            // Only the box has a scene without mirrors. The others bring theirs again.
            let is_box = variant(input).is_some_and(|variant| variant.family() == five_mirrors::BOX);
            if is_whole(input) || !is_box { input.clone() } else { built_in_name(five_mirrors::Variant::None) }
        };
        let markings = self.markings.iter().filter(|marking| inputs.contains(&marking.points.cloud));
        let mirror_points =
            markings.map(|marking| MirrorPoints { cloud: written(&marking.points.cloud), ..marking.points.clone() });
        let own = self.own_settings.iter().filter(|own| inputs.contains(&own.input));
        let own = own.map(|OwnSettings { input, settings, .. }| {
            let cloud = if settings.cloud == *input { written(input) } else { settings.cloud.clone() };
            CloudSettings { cloud, ..settings.clone() }
        });
        let has_built_in = inputs.iter().any(|input| variant(input).is_some());
        let is_brought_light = |placed: &PlacedLight| match placed.origin {
            Origin::Person => false,
            Origin::BuiltIn => has_built_in,
            Origin::Guess => true,
        };
        let are_brought = self.lights.iter().all(is_brought_light);
        SceneFile {
            clouds: inputs.iter().map(written).collect(),
            mirrors: self.mirrors.iter().filter(|placed| !is_brought(placed)).map(|p| p.mirror.clone()).collect(),
            mirror_points: mirror_points.collect(),
            cloud_settings: own.collect(),
            lights: self.lights.iter().filter(|_| !are_brought).map(|placed| placed.light).collect(),
            visibility: self.visibility.clone(),
            clips: self.clips.iter().map(|placed| placed.clip.clone()).collect(),
            ..SceneFile::default()
        }
    }
}

/// Returns a spot light at `eye` that aims at `pivot`. A white surface at the pivot that faces the light has radiance
/// 1. The cone is as wide as the picture is high.
pub fn spot(eye: DVec3, pivot: DVec3, field_of_view_degrees: f32) -> SpotLight {
    // With a wide lens a narrower beam would light too little. With a narrow lens a wider one would have no visible
    // edge.
    let outer_degrees = (field_of_view_degrees * 0.5).clamp(25.0, 75.0);
    SpotLight {
        position: eye,
        target: pivot,
        intensity: [(std::f64::consts::PI * eye.distance_squared(pivot)) as f32; 3],
        inner_degrees: outer_degrees * 0.8,
        outer_degrees,
    }
}

/// Returns `wanted`, or `wanted` with the first number from 2 on, whichever is not in `taken`.
pub fn numbered<'a>(wanted: &str, taken: impl Iterator<Item = &'a str>) -> String {
    let taken: Vec<&str> = taken.collect();
    let numbered = (2..u32::MAX).map(|number| format!("{wanted} {number}"));
    let mut names = std::iter::once(wanted.to_string()).chain(numbered);
    names.find(|name| !taken.contains(&name.as_str())).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use five_mirrors::Variant;
    use scene::Shape;

    use super::*;

    /// Returns the objects that a built-in scene brings, and its name.
    fn brought(variant: Variant) -> (Objects, Vec<String>) {
        let input = built_in_name(variant);
        let place = |(index, mirror)| Placed { id: ObjectId(index as u32), mirror, input: Some(input.clone()) };
        let mirrors = variant.mirrors().into_iter().enumerate().map(place).collect();
        (Objects { mirrors, ..Objects::default() }, vec![input])
    }

    #[test]
    fn a_scene_file_names_only_what_differs_from_the_built_in_scene() {
        let (mut objects, inputs) = brought(Variant::All);
        let file = objects.scene_file(&inputs);
        assert_eq!((file.clouds, file.mirrors), (inputs.clone(), Vec::new()));
        objects.mirrors[3].mirror.position.y += 0.1;
        let file = objects.scene_file(&inputs);
        assert_eq!((file.clouds.as_slice(), file.mirrors.len()), (inputs.as_slice(), 1));
        assert_eq!(file.mirrors[0].name, "torus");
        objects.mirrors.remove(0);
        let marking = |key, cloud: &str| Marking { key: CloudKey(key), points: MirrorPoints::whole(cloud.into()) };
        objects.markings = vec![marking(0, &inputs[0]), marking(1, "hidden.laz")];
        let file = objects.scene_file(&inputs);
        assert_eq!((file.clouds, file.mirrors.len()), (vec!["five-mirrors/none".to_string()], 4));
        assert_eq!(file.mirror_points, [MirrorPoints::whole("five-mirrors/none".into())]);
    }

    #[test]
    fn a_scene_file_names_the_lights_unless_the_built_in_scene_brings_just_them() {
        let (mut objects, inputs) = brought(Variant::Sphere);
        let light = five_mirrors::light();
        let id = ObjectId(8);
        objects.lights.push(PlacedLight { id, name: "spot".into(), light, origin: Origin::BuiltIn });
        assert_eq!(objects.scene_file(&inputs).lights, []);
        assert_eq!(objects.scene_file(&["office.laz".into()]).lights, [light]);
        let moved = SpotLight { position: light.position * 0.5, ..light };
        objects.set(id, Object::Light(moved));
        assert_eq!(objects.scene_file(&inputs).lights, [moved]);
        let guess = PlacedLight { id, name: GUESSED_LAMP.into(), light, origin: Origin::Guess };
        let mut room = Objects { lights: vec![guess], ..Objects::default() };
        assert_eq!(room.scene_file(&["office.laz".into()]).lights, []);
        room.add(ObjectId(9), Object::Light(moved));
        assert_eq!(room.scene_file(&["office.laz".into()]).lights, [light, moved]);
        // A light without a direction is refused.
        objects.set(id, Object::Light(SpotLight { target: moved.position, ..moved }));
        assert_eq!(objects.light(id), Some(&moved));
    }

    #[test]
    fn names_are_given_once() {
        let (mut objects, _) = brought(Variant::Sphere);
        assert_eq!(objects.free_name("mirror", "sphere", None), "sphere 2");
        assert_eq!(objects.free_name("mirror", "sphere", Some(ObjectId(0))), "sphere");
        assert_eq!(objects.free_name("mirror", "  ", None), "mirror");
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let mirror = Mirror { name: "sphere 2".into(), ..mirror };
        objects.mirrors.push(Placed { id: ObjectId(7), mirror, input: None });
        assert_eq!(objects.free_name("mirror", "sphere", None), "sphere 3");
    }
}
