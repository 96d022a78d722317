//! What opening decides, once for the window, pictures without it, and studies: what a cloud has of its own, which clouds
//! are looked at first, where the camera stands, and which lights shine.

use cloud::Bounds;
use glam::DVec3;
use scene::{Camera, CloudSettings, Lighting, Mirror, SpotLight, StandardView, Start, ViewSettings};

use crate::apart::Apart;
use crate::assembly::Assembly;
use crate::light::AutoLight;
use crate::mirrors;

/// A cloud that is shown, for the first look at it.
pub struct Extent<'a> {
    pub cloud: &'a Assembly,
    /// The bounds of the points that are shown, without stray points.
    pub bounds: Bounds,
    /// The outermost points of those that are shown.
    pub outline: Vec<DVec3>,
}

/// What a scene says of one cloud.
pub fn own_settings<'a>(all: &'a [CloudSettings], cloud: &Assembly) -> Option<&'a CloudSettings> {
    all.iter().find(|own| own.is_of(&cloud.input, &cloud.cloud.name))
}

/// The points that the first view frames: the outlines of the clouds and of the mirrors. Of clouds that lie far apart, it
/// frames those beside the largest. The warnings say which do, and which have other coordinate systems.
pub fn first_outline<'a>(
    clouds: Vec<Extent<'_>>,
    mirrors: impl Iterator<Item = &'a Mirror>,
) -> (Vec<DVec3>, Vec<String>) {
    let places: Vec<_> = clouds.iter().map(|extent| extent.cloud.place(extent.bounds)).collect();
    let Apart { is_near, warnings } = Apart::of(&places);
    let near = clouds.into_iter().zip(is_near).filter(|(_, is_near)| *is_near);
    let outline = near.flat_map(|(extent, _)| extent.outline).chain(mirrors.flat_map(mirrors::outline));
    (outline.collect(), warnings)
}

/// Where the camera stands when a scene is opened that has none: in the room or at the place of a depth image, if there
/// is one and no `side` is asked for, else where it sees the outline. `aspect` is the picture's width over its height.
pub fn first_camera(
    side: Option<StandardView>,
    room: Option<Camera>,
    outline: &[DVec3],
    up: DVec3,
    view: &ViewSettings,
    aspect: f64,
) -> Camera {
    let room = room.filter(|_| side.is_none() && view.start == Start::Auto);
    let side = side.unwrap_or(StandardView::Isometric);
    room.unwrap_or_else(|| Camera::framing(outline, side, up, view.field_of_view, aspect))
}

/// The lights that shine. The lamp of a room, which is its only light then, is left out while the eye is outside of the
/// room: it would light nothing that is visible.
pub fn shining(lights: Vec<SpotLight>, is_lamp: bool, light: &AutoLight, by: Lighting, eye: DVec3) -> Vec<SpotLight> {
    if is_lamp && !light.lamp_shines(by, eye) { Vec::new() } else { lights }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_that_is_asked_for_and_a_start_outside_leave_the_room() {
        let room = Camera::looking(DVec3::ZERO, DVec3::X, 3.0, DVec3::Z);
        let outline = [DVec3::splat(-1.0), DVec3::splat(1.0)];
        let mut view = ViewSettings::default();
        let first = |side, view: &ViewSettings| first_camera(side, Some(room), &outline, DVec3::Z, view, 1.0);
        assert_eq!(first(None, &view), room);
        let top = first(Some(StandardView::Top), &view);
        assert_eq!(top, Camera::framing(&outline, StandardView::Top, DVec3::Z, view.field_of_view, 1.0));
        view.start = Start::Outside;
        assert_ne!(first(None, &view), room);
    }
}
