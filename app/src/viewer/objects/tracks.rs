//! The names by which tracks of paths know objects: lights are numbered from 1, all others have names. Tracks follow an
//! object that gets another name or number, and go when it goes.

use std::collections::BTreeMap;

use scene::{CameraPath, Handle, Object, Track};

use crate::viewer::objects::{ObjectId, Objects};

impl Objects {
    /// All objects with the names by which tracks know them.
    fn named_for_tracks(&self) -> impl Iterator<Item = (ObjectId, String, Object)> {
        let mut lights = 0;
        self.all().map(move |(id, name, object)| {
            let is_light = matches!(object, Object::Light(_));
            lights += u32::from(is_light);
            (id, if is_light { lights.to_string() } else { name.to_owned() }, object)
        })
    }

    /// Returns the first object of a kind with this name; lights are numbered from 1.
    ///
    /// # Errors
    /// There is none: the names that there are.
    pub fn named(&self, kind: &str, name: &str) -> Result<(ObjectId, Object), String> {
        let of_kind = self.named_for_tracks().filter(|(.., object)| object.kind().name == kind);
        let mut all: Vec<(ObjectId, String, Object)> = of_kind.collect();
        if let Some(index) = all.iter().position(|(_, known, _)| known == name) {
            let (id, _, object) = all.swap_remove(index);
            return Ok((id, object));
        }
        let names: Vec<&str> = all.iter().map(|(_, known, _)| known.as_str()).collect();
        let there = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        Err(format!("no {kind} is called `{name}`; there are: {there}"))
    }

    /// The keys of the tracks that an object can have.
    pub fn keys_of(&self, id: ObjectId) -> Vec<String> {
        let Some((_, name, object)) = self.named_for_tracks().find(|(known, ..)| *known == id) else {
            return Vec::new();
        };
        let kind = object.kind().name;
        let is_there = |value: &&str| Track::value_of_object(value, &object).is_some();
        Track::values_of(kind).filter(is_there).filter_map(|value| Track::key_of(kind, &name, value)).collect()
    }

    /// What the window calls an object: a light by its number and its name.
    pub fn label(&self, id: ObjectId) -> Option<String> {
        let (_, known, object) = self.named_for_tracks().find(|(known, ..)| *known == id)?;
        match object {
            Object::Light(_) => self.get(id).map(|(name, _)| format!("{known}: {name}")),
            _ => Some(known),
        }
    }

    /// How many tracks all paths have.
    pub fn track_count(&self) -> usize {
        self.paths.iter().map(|path| path.tracks.len()).sum()
    }

    /// Whether an object has another name than before, by which tracks know it.
    pub(super) fn is_renamed(&self, id: ObjectId, object: &Object) -> bool {
        let name = match object {
            Object::Mirror(mirror) => &mirror.name,
            Object::Clip(clip) => &clip.name,
            Object::Profile(profile) => &profile.name,
            Object::Light(_) | Object::Measurement(_) | Object::Note(_) => return false,
        };
        self.get(id).is_some_and(|(known, _)| known != name)
    }

    /// Adds the tracks of some objects that paths of the same names had, while the objects had the names that they have now.
    pub fn bring_tracks(&mut self, ids: &[ObjectId], from: &[CameraPath]) {
        let keys: Vec<String> = ids.iter().flat_map(|id| self.keys_of(*id)).collect();
        for path in &mut self.paths {
            let Some(known) = from.iter().find(|known| known.name == path.name) else { continue };
            path.tracks.extend(known.tracks.iter().filter(|track| keys.contains(&track.key)).cloned());
        }
    }

    /// Makes a change after which tracks are of the same objects as before. Those of objects that are gone go as well.
    pub fn keep_tracks(&mut self, change: impl FnOnce(&mut Self)) {
        if self.track_count() == 0 {
            return change(self);
        }
        let mut before: BTreeMap<(&str, String), ObjectId> = BTreeMap::new();
        for (id, name, object) in self.named_for_tracks() {
            before.entry((object.kind().name, name)).or_insert(id);
        }
        change(self);
        let after: BTreeMap<ObjectId, String> = self.named_for_tracks().map(|(id, name, _)| (id, name)).collect();
        let follow = |track: &mut Track| {
            let Ok(Handle::Object { kind, name, value }) = track.handle() else { return true };
            // What named nothing before is left as it is.
            let Some(id) = before.get(&(kind, name.to_owned())) else { return true };
            let Some(key) = after.get(id).and_then(|name| Track::key_of(kind, name, value)) else { return false };
            track.key = key;
            true
        };
        self.paths.iter_mut().for_each(|path| path.tracks.retain_mut(follow));
    }
}
