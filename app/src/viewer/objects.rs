//! What stands in the scene besides clouds, as a person edits it: mirrors, points that are turned into mirrors, and lights; and
//! which points of the clouds are shown. All of it is restored by one step of undo. How it gets to the render thread:
//! `Loaded::sync_objects` and `Loaded::sync_visibility`; lights go with each frame.

use glam::DVec3;
use scene::{Mirror, MirrorPoints, Object, ObjectKind, SceneFile, SpotLight, Visibility, five_mirrors};
use world::{CloudKey, built_in_name};

/// A mirror or a light, as long as it exists and when it comes back by undo. Never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectId(pub u32);

#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    pub id: ObjectId,
    pub mirror: Mirror,
    /// The built-in scene that brought it.
    pub input: Option<String>,
}

/// Where a light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Somebody put it there, changed it, or wrote it into a scene file.
    Person,
    BuiltIn,
    /// It stands in for the light that a room's scan does not bring: alone, for nobody writes it into a scene file.
    Guess,
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlacedLight {
    pub id: ObjectId,
    /// In the list alone: scene files do not name lights.
    pub name: String,
    pub light: SpotLight,
    pub origin: Origin,
}

/// Name of the lamp that is guessed.
pub const GUESSED_LAMP: &str = "lamp (guessed)";

/// All of a mirror but its name: what can be seen of it.
pub fn unnamed(mirror: &Mirror) -> Mirror {
    Mirror { name: String::new(), ..mirror.clone() }
}

/// Points of a cloud that reflect.
#[derive(Clone, Debug, PartialEq)]
pub struct Marking {
    pub key: CloudKey,
    pub points: MirrorPoints,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objects {
    pub mirrors: Vec<Placed>,
    pub markings: Vec<Marking>,
    /// The first four shine.
    pub lights: Vec<PlacedLight>,
    /// Somebody took the last light away: none is to come of itself.
    pub no_guess: bool,
    /// Which points of the clouds are shown.
    pub visibility: Visibility,
}

impl Objects {
    pub fn mirror(&self, id: ObjectId) -> Option<&Mirror> {
        self.mirrors.iter().find(|placed| placed.id == id).map(|placed| &placed.mirror)
    }

    pub fn light(&self, id: ObjectId) -> Option<&SpotLight> {
        self.lights.iter().find(|placed| placed.id == id).map(|placed| &placed.light)
    }

    /// All objects with their names.
    pub fn all(&self) -> impl Iterator<Item = (ObjectId, &str, Object)> {
        let mirrors = self.mirrors.iter();
        let mirrors = mirrors.map(|p| (p.id, p.mirror.name.as_str(), Object::Mirror(p.mirror.clone())));
        let lights = self.lights.iter().map(|p| (p.id, p.name.as_str(), Object::Light(p.light)));
        mirrors.chain(lights)
    }

    pub fn get(&self, id: ObjectId) -> Option<(&str, Object)> {
        self.all().find(|(known, ..)| *known == id).map(|(_, name, object)| (name, object))
    }

    pub fn count(&self, kind: &ObjectKind) -> usize {
        self.all().filter(|(.., object)| object.kind() == kind).count()
    }

    /// Changes an object, if it is one of its kind then. What somebody changes is theirs.
    pub fn set(&mut self, id: ObjectId, object: Object) {
        if object.problem().is_some() {
            return;
        }
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
        }
    }

    /// Adds an object under a name that is free.
    pub fn add(&mut self, id: ObjectId, object: Object) {
        match object {
            Object::Mirror(mirror) => {
                let mirror = Mirror { name: self.free_name(&mirror.name, None), ..mirror };
                self.mirrors.push(Placed { id, mirror, input: None });
            }
            Object::Light(light) => {
                self.accept_guess();
                let name = self.free_light_name("spot");
                self.lights.push(PlacedLight { id, name, light, origin: Origin::Person });
            }
        }
    }

    pub fn remove(&mut self, id: ObjectId) {
        let lights = self.lights.len();
        self.mirrors.retain(|placed| placed.id != id);
        self.lights.retain(|placed| placed.id != id);
        self.no_guess |= self.lights.len() < lights && self.lights.is_empty();
    }

    /// Hangs the lamp of a room where no other light is, with `id` if there is no such lamp yet; `None`: takes it away.
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

    /// A lamp that is guessed stays, as somebody's own, once lights are put in order.
    fn accept_guess(&mut self) {
        for placed in self.lights.iter_mut().filter(|placed| placed.origin == Origin::Guess) {
            (placed.name, placed.origin) = ("lamp".into(), Origin::Person);
        }
    }

    /// Whether the only light is a guess.
    pub fn has_guess(&self) -> bool {
        matches!(self.lights.as_slice(), [PlacedLight { origin: Origin::Guess, .. }])
    }

    /// `wanted`, or with the first number that makes it the name of no other mirror: names stand for mirrors in scene files.
    pub fn free_name(&self, wanted: &str, except: Option<ObjectId>) -> String {
        let wanted = wanted.trim();
        let wanted = if wanted.is_empty() { "mirror" } else { wanted };
        let others = self.mirrors.iter().filter(|placed| Some(placed.id) != except);
        numbered(wanted, others.map(|placed| placed.mirror.name.as_str()))
    }

    pub fn free_light_name(&self, wanted: &str) -> String {
        numbered(wanted, self.lights.iter().map(|placed| placed.name.as_str()))
    }

    /// A scene of `inputs` with these objects. A mirror that is as its built-in scene brings it is left out; a scene that
    /// lacks one of its own becomes the one without mirrors, and what is left of them is written. Lights are left out if they
    /// come of themselves: those of a file take the place of such.
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
            if is_whole(input) { input.clone() } else { built_in_name(five_mirrors::Variant::None) }
        };
        let markings = self.markings.iter().filter(|marking| inputs.contains(&marking.points.cloud));
        let mirror_points =
            markings.map(|marking| MirrorPoints { cloud: written(&marking.points.cloud), ..marking.points.clone() });
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
            lights: self.lights.iter().filter(|_| !are_brought).map(|placed| placed.light).collect(),
            visibility: self.visibility.clone(),
            ..SceneFile::default()
        }
    }
}

/// A spot light at `eye` that aims at `pivot`: a white surface there that faces it has radiance 1. Its cone is as wide as the picture is high.
pub fn spot(eye: DVec3, pivot: DVec3, field_of_view_degrees: f32) -> SpotLight {
    // A narrow beam through a wide lens shows nothing, a wide one through a narrow lens has no edge to be seen by.
    let outer_degrees = (field_of_view_degrees * 0.5).clamp(25.0, 75.0);
    SpotLight {
        position: eye,
        target: pivot,
        intensity: [(std::f64::consts::PI * eye.distance_squared(pivot)) as f32; 3],
        inner_degrees: outer_degrees * 0.8,
        outer_degrees,
    }
}

/// `wanted`, or with the first number from 2 on that makes it none of `taken`.
fn numbered<'a>(wanted: &str, taken: impl Iterator<Item = &'a str>) -> String {
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

    /// As a built-in scene brings them.
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
        // What is no light is not taken.
        objects.set(id, Object::Light(SpotLight { target: moved.position, ..moved }));
        assert_eq!(objects.light(id), Some(&moved));
    }

    #[test]
    fn names_are_given_once() {
        let (mut objects, _) = brought(Variant::Sphere);
        assert_eq!(objects.free_name("sphere", None), "sphere 2");
        assert_eq!(objects.free_name("sphere", Some(ObjectId(0))), "sphere");
        assert_eq!(objects.free_name("  ", None), "mirror");
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let mirror = Mirror { name: "sphere 2".into(), ..mirror };
        objects.mirrors.push(Placed { id: ObjectId(7), mirror, input: None });
        assert_eq!(objects.free_name("sphere", None), "sphere 3");
    }
}
