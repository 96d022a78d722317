//! What stands in the scene besides clouds, as a person edits it: mirrors, and points that are turned into mirrors. All of it
//! is restored by one step of undo. How it gets to the render thread: `State::sync_objects`.

use scene::{Mirror, MirrorPoints, SceneFile, five_mirrors};

use super::render_thread::CloudKey;
use crate::loading::built_in_name;

/// A mirror, as long as it exists and when it comes back by undo. Never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MirrorId(pub u32);

#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    pub id: MirrorId,
    pub mirror: Mirror,
    /// The built-in scene that brought it.
    pub input: Option<String>,
}

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
}

impl Objects {
    pub fn mirror(&self, id: MirrorId) -> Option<&Mirror> {
        self.mirrors.iter().find(|placed| placed.id == id).map(|placed| &placed.mirror)
    }

    pub fn mirror_mut(&mut self, id: MirrorId) -> Option<&mut Mirror> {
        self.mirrors.iter_mut().find(|placed| placed.id == id).map(|placed| &mut placed.mirror)
    }

    /// `wanted`, or with the first number that makes it the name of no other mirror: names stand for mirrors in scene files.
    pub fn free_name(&self, wanted: &str, except: Option<MirrorId>) -> String {
        let wanted = wanted.trim();
        let wanted = if wanted.is_empty() { "mirror" } else { wanted };
        let is_taken =
            |name: &str| self.mirrors.iter().any(|placed| placed.mirror.name == name && Some(placed.id) != except);
        let numbered = (2..u32::MAX).map(|number| format!("{wanted} {number}"));
        let mut names = std::iter::once(wanted.to_string()).chain(numbered);
        names.find(|name| !is_taken(name)).unwrap_or_default()
    }

    /// A scene of `inputs` with these mirrors. A mirror that is as its built-in scene brings it is left out; a scene that
    /// lacks one of its own becomes the one without mirrors, and what is left of them is written.
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
        SceneFile {
            clouds: inputs.iter().map(written).collect(),
            mirrors: self.mirrors.iter().filter(|placed| !is_brought(placed)).map(|p| p.mirror.clone()).collect(),
            mirror_points: mirror_points.collect(),
            ..SceneFile::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use five_mirrors::Variant;
    use glam::DVec3;
    use scene::Shape;

    use super::*;

    /// As a built-in scene brings them.
    fn brought(variant: Variant) -> (Objects, Vec<String>) {
        let input = built_in_name(variant);
        let place = |(index, mirror)| Placed { id: MirrorId(index as u32), mirror, input: Some(input.clone()) };
        let mirrors = variant.mirrors().into_iter().enumerate().map(place).collect();
        (Objects { mirrors, markings: Vec::new() }, vec![input])
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
    fn names_are_given_once() {
        let (mut objects, _) = brought(Variant::Sphere);
        assert_eq!(objects.free_name("sphere", None), "sphere 2");
        assert_eq!(objects.free_name("sphere", Some(MirrorId(0))), "sphere");
        assert_eq!(objects.free_name("  ", None), "mirror");
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let mirror = Mirror { name: "sphere 2".into(), ..mirror };
        objects.mirrors.push(Placed { id: MirrorId(7), mirror, input: None });
        assert_eq!(objects.free_name("sphere", None), "sphere 3");
    }
}
