//! The scene's own values while tracks of a path have changed it (`posing.rs`).

use scene::{Caption, Mirror, Settings, WipeMarks};

use crate::viewer::objects::{ObjectId, Objects};

/// What the scene has of its own where tracks have changed it.
pub struct Posed {
    pub settings: Settings,
    pub objects: Objects,
    /// The objects that tracks have changed.
    pub touched: Vec<ObjectId>,
    /// The captions that the picture shows, with the values of parameters in them.
    pub captions: Vec<Caption>,
    pub wipe: Option<WipeMarks>,
    /// Whether the window draws one of several states that the picture shows.
    pub is_wiped: bool,
    /// The settings along the path, without those of a state.
    pub of_path: Settings,
}

impl Objects {
    /// Gives an object all values that it has in `before`, but leaves a mesh that was read meanwhile.
    pub fn restore(&mut self, id: ObjectId, before: &Self) {
        let mirror = self.mirrors.iter_mut().find(|placed| placed.id == id);
        if let (Some(placed), Some(known)) = (mirror, before.mirror(id)) {
            placed.mirror = Mirror { shape: placed.mirror.shape.clone(), ..known.clone() };
        }
        let light = self.lights.iter_mut().find(|placed| placed.id == id);
        if let (Some(placed), Some(known)) = (light, before.lights.iter().find(|known| known.id == id)) {
            *placed = known.clone();
        }
        let profile = self.profiles.iter_mut().find(|placed| placed.id == id);
        if let (Some(placed), Some(known)) = (profile, before.profiles.iter().find(|known| known.id == id)) {
            *placed = known.clone();
        }
        let clip = self.clips.iter_mut().find(|placed| placed.id == id);
        if let (Some(placed), Some(known)) = (clip, before.clips.iter().find(|known| known.id == id)) {
            *placed = known.clone();
        }
    }
}
