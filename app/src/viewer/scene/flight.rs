//! The camera on its way to another view. Where it is follows from the time, however many pictures are drawn meanwhile.

use std::time::Instant;

use scene::{Camera, CameraPath, Ease, Motion};

pub struct Flight {
    /// The bookmark to which it leads, if it leads to one.
    pub bookmark: Option<usize>,
    motion: Motion,
    since: Instant,
}

impl Flight {
    /// A flight that begins now.
    pub fn new(from: Camera, to: Camera, seconds: f64, bookmark: Option<usize>, now: Instant) -> Option<Self> {
        let mut path = CameraPath { name: "flight".into(), ease: Ease::InOut, ..CameraPath::default() };
        path.set_keyframe(0.0, from);
        path.set_keyframe(seconds, to);
        Some(Self { bookmark, motion: Motion::new(&path)?, since: now })
    }

    /// Where the camera is, and whether it has arrived.
    pub fn camera(&self, now: Instant) -> (Camera, bool) {
        let passed = now.saturating_duration_since(self.since).as_secs_f64();
        (self.motion.camera(passed), passed >= self.motion.duration())
    }
}
