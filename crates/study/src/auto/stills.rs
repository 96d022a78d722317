//! The still pictures by which changes and combinations are judged.

use scene::{IndirectBy, Settings};

use super::changes::METHOD;
use crate::still::{STILL_LIGHTS, judging_settings};

/// The most pixels of the small pictures by which single changes are judged.
const SMALL_PIXELS: f64 = 320.0 * 240.0;

/// `gi.interleave` of still pictures larger than that: each of 3 x 3 pixels is lit by its own ninth of the lights, for a
/// fraction of the time. Edges, where that shows, are few in large pictures; and settings to choose from have other
/// numbers, whose pixels make other errors. Fewer lights and light that is not averaged keep 1, and light by rays what it has.
const LARGE_INTERLEAVE: u32 = 3;

/// The settings of the still pictures.
pub struct Stills {
    /// Of the picture in its own size.
    pub whole: Settings,
    /// Of the small picture; the same if that is as large.
    pub small: Settings,
}

impl Stills {
    /// For a picture of `size` pixels with the settings `base`, of which those in `fixed` stay.
    pub fn new(base: &Settings, fixed: &[String], size: [u32; 2]) -> Self {
        let small = still_of(base, fixed);
        let mut whole = small.clone();
        let is_free = !fixed.iter().any(|key| key == "gi.interleave") && base.gi.interleave != LARGE_INTERLEAVE;
        let gi = &mut whole.gi;
        let is_smooth = gi.by == IndirectBy::Lights && gi.filtered && gi.vpls >= STILL_LIGHTS;
        if small_size(size) != size && is_free && is_smooth {
            gi.interleave = LARGE_INTERLEAVE;
        }
        Self { whole, small }
    }
}

/// The size of small pictures of a view.
pub fn small_size(size: [u32; 2]) -> [u32; 2] {
    let share = (SMALL_PIXELS / size.map(f64::from).iter().product::<f64>()).sqrt().min(1.0);
    size.map(|side| ((f64::from(side) * share).round() as u32).max(1))
}

/// The settings of the still picture. What is fixed stays, but for the method: the error is that of the fixed one.
fn still_of(base: &Settings, fixed: &[String]) -> Settings {
    let mut still = judging_settings(base);
    let is_kept = |key: &String| fixed.contains(key) && key != METHOD;
    for (before, after) in base.groups().into_iter().zip(still.groups_mut()) {
        let group = before.group();
        let keys = group.fields.iter().map(|field| format!("{}.{}", group.name, field.name));
        let values = keys.zip(before.values()).zip(after.values());
        let values = values.map(|((key, before), after)| if is_kept(&key) { before } else { after });
        let values: Vec<param::Value> = values.collect();
        after.set_values(&values);
    }
    still
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use scene::Method;

    use super::*;

    #[test]
    fn the_still_picture_keeps_what_is_fixed_but_not_the_method() {
        let mut base = Settings::default();
        (base.reflection.method, base.gi.vpls, base.view.resolution) = (Method::None, 64, 0.5);
        let fixed = ["gi.vpls".to_owned(), "reflection.method".to_owned()];
        let still = Stills::new(&base, &fixed, [64, 48]).whole;
        assert_eq!((still.reflection.method, still.gi.vpls), (Method::SurfelTrace, 64));
        assert_eq!(still.mirror.surface, scene::MirrorSurface::Exact);
        base.mirror.surface = scene::MirrorSurface::Points;
        assert_eq!(Stills::new(&base, &fixed, [64, 48]).small.mirror.surface, scene::MirrorSurface::Points);
        assert_eq!((still.view.resolution, still.gi.interleave), (1.0, 1));
        let interleaves = |fixed: &[String], size| {
            let stills = Stills::new(&base, fixed, size);
            [stills.whole, stills.small].map(|settings| settings.gi.interleave)
        };
        assert_eq!((interleaves(&[], [320, 240]), interleaves(&[], [800, 600])), ([1, 1], [3, 1]));
        assert_eq!(interleaves(&["gi.interleave".to_owned()], [800, 600]), [4, 4]);
        assert_eq!(interleaves(&fixed, [800, 600]), [1, 1], "seven lights a pixel are no truth");
        let of_large = |key: &str, value: &str| {
            let mut settings = Settings::default();
            settings.set_text(key, value).unwrap();
            Stills::new(&settings, &[], [800, 600]).whole.gi.interleave
        };
        let kept = [("gi.by", "rays"), ("gi.filtered", "false"), ("gi.interleave", "3")];
        assert_eq!((kept.map(|(key, value)| of_large(key, value)), of_large("gi.interleave", "2")), ([4, 1, 1], 3));
        assert_eq!(small_size([800, 600]), [320, 240]);
        assert_eq!(small_size([64, 48]), [64, 48]);
    }
}
