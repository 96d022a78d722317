//! Kept views: how the camera flies to one, and the small pictures of them.

use scene::{Bookmark, Camera};
use serde_json::json;

use crate::shared::language::text;
use crate::viewer::objects::numbered;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Picture};
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;
use crate::viewer::truth::view;

/// How long a flight to a bookmark takes, in seconds: long enough to see where it leads.
const FLIGHT_SECONDS: f64 = 0.8;
/// The size of the small pictures, in pixels.
const SIZE: [u32; 2] = [128, 80];

/// Keeps the view. A digit takes the place of the bookmark that had it.
pub fn keep(digit: Option<u8>, scene: &mut Scene, outside: &mut Outside) {
    let camera = scene.camera;
    let known = digit.and_then(|digit| scene.objects.bookmarks.iter().position(|known| known.digit == Some(digit)));
    if known.is_some_and(|index| scene.objects.bookmarks[index].camera() == camera) {
        return;
    }
    let names = scene.objects.bookmarks.iter().map(|bookmark| bookmark.name.as_str());
    let name = match known {
        Some(index) => scene.objects.bookmarks[index].name.clone(),
        None => numbered("view", names),
    };
    if known.is_none() && scene.objects.bookmarks.len() >= scene::MOST_BOOKMARKS {
        return outside.note(text!("There are {most} bookmarks, and no room for more", most = scene::MOST_BOOKMARKS));
    }
    outside.log(json!({ "event": "bookmark", "name": name, "digit": digit }));
    outside.note(match digit {
        Some(digit) => text!("View kept as `{name}`: Shift+{digit} flies there", name, digit),
        None => text!("View kept as `{name}`", name),
    });
    scene.edit_objects(outside.now, |objects| match known {
        Some(index) => {
            let note = std::mem::take(&mut objects.bookmarks[index].note);
            objects.bookmarks[index] = Bookmark { note, ..Bookmark::new(name, digit, camera) };
        }
        None => objects.bookmarks.push(Bookmark::new(name, digit, camera)),
    });
}

/// Begins a flight to a bookmark, in one step of undo.
pub fn fly(index: usize, scene: &mut Scene, outside: &mut Outside) {
    let bookmark = scene.objects.bookmarks.get(index).filter(|bookmark| bookmark.camera() != scene.camera);
    let Some(bookmark) = bookmark.cloned() else { return };
    outside.log(json!({ "event": "flight", "name": bookmark.name }));
    scene.fly_to(bookmark.camera(), FLIGHT_SECONDS, Some(index), outside.now);
}

/// Small pictures of the bookmarks. They are made one by one while nothing else is to be drawn.
#[derive(Default)]
pub struct Thumbnails {
    made: Vec<(Camera, view::Picture)>,
    awaited: Option<Camera>,
}

impl Thumbnails {
    /// The picture of a bookmark, if it is made.
    pub fn of(&self, bookmark: &Bookmark) -> Option<&view::Picture> {
        let camera = bookmark.camera();
        self.made.iter().find(|(known, _)| *known == camera).map(|(_, picture)| picture)
    }

    /// Asks for the next picture that lacks.
    pub fn step(&mut self, scene: &Scene, shown: &FrameRequest, outside: &mut Outside) {
        let cameras: Vec<Camera> = scene.objects.bookmarks.iter().map(Bookmark::camera).collect();
        if self.awaited.is_some() {
            return;
        }
        self.made.retain(|(known, _)| cameras.contains(known));
        let lacking = cameras.into_iter().find(|camera| self.made.iter().all(|(known, _)| known != camera));
        if let Some(camera) = lacking {
            self.awaited = Some(camera);
            let request = Box::new(FrameRequest { camera, size: SIZE, ..shown.clone() });
            outside.render(Command::Read { request, images: Vec::new() });
        }
    }

    /// Takes the picture that was asked for; returns any other.
    pub fn take(&mut self, picture: Picture) -> Option<Picture> {
        let is_small = picture.rgba.len() == SIZE.map(|side| side as usize).iter().product::<usize>() * 4;
        if !is_small || self.awaited != Some(picture.camera) {
            return Some(picture);
        }
        self.awaited = None;
        self.made.push((picture.camera, view::Picture::new(SIZE, picture.rgba)));
        None
    }
}
