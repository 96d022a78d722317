//! The figures of a frame's reflections, and what they were in the last frames.

use std::collections::VecDeque;

use render::{FrameStats, ReflectedShare, ReflectionStats};

use crate::shared::language::{english, text};
use crate::viewer::look::theme::{bytes, grouped};

/// How many frames the plots show.
pub const REMEMBERED: usize = 120;

/// A name, how a value is written, and how the value is read. A method that has no such figure gives `None`.
pub type Figure = (&'static str, fn(f64) -> String, fn(&ReflectionStats) -> Option<f64>);

pub const FIGURES: [Figure; 14] = [
    (english!("Mirror pixels"), |pixels| grouped(pixels as u64), |stats| Some(f64::from(stats.mirror_pixels))),
    (english!("Coverage"), percent, |stats| Some(stats.coverage)),
    (english!("Closed coverage"), percent, |stats| Some(stats.closed_coverage)),
    (english!("Uncertain"), percent, |stats| Some(stats.uncertain)),
    (english!("Hit rate"), percent, |stats| stats.hit_rate),
    (english!("Unconverged"), percent, |stats| stats.unconverged),
    (english!("Regions"), |regions| grouped(regions as u64), |stats| stats.regions.map(f64::from)),
    (english!("Unresolved rays"), percent, |stats| stats.unresolved),
    (english!("Maps needed"), |maps| grouped(maps as u64), |stats| Some(f64::from(stats.maps?.asked))),
    (english!("Maps drawn anew"), |maps| grouped(maps as u64), |stats| Some(f64::from(stats.map_use?.new))),
    (english!("Maps missed"), percent, |stats| Some(stats.map_use?.missed)),
    (english!("Predicted to be off"), percent, |stats| stats.map_use?.off),
    (english!("Texels traced"), |texels| grouped(texels as u64), |stats| stats.map_use?.texels.map(f64::from)),
    (english!("Memory of maps"), |size| bytes(size as u64), |stats| Some(stats.map_use?.bytes as f64)),
];

fn percent(share: f64) -> String {
    format!("{:.2} %", share * 100.0)
}

/// What mirrors of a hurried frame reflect of all that they could, for people.
pub fn reflected_text(share: &ReflectedShare) -> String {
    let points = match share.points * 100.0 {
        percent if percent < 10.0 => text!("{percent} % of points", percent = format_args!("{percent:.1}")),
        percent => text!("{percent} % of points", percent = format_args!("{percent:.0}")),
    };
    let part = |share: f64, of: &str| text!("1/{share} of {of}", share = format_args!("{:.0}", share.recip()), of);
    let texels = part(share.texels, text!("texels"));
    let pixels = part(share.pixels, text!("mirror pixels"));
    let parts = [(share.points, points), (share.texels, texels), (share.pixels, pixels)];
    let parts: Vec<String> = parts.into_iter().filter(|(share, _)| *share < 1.0).map(|(_, text)| text).collect();
    parts.join(", ")
}

/// The figures of the last frames.
#[derive(Default)]
pub struct FigureHistory {
    /// The values of each frame in the order of `FIGURES`; NaN where the method has no such figure.
    frames: VecDeque<[f64; FIGURES.len()]>,
}

impl FigureHistory {
    pub fn push(&mut self, stats: &FrameStats) {
        let Some(reflection) = &stats.reflection else { return };
        if self.frames.len() == REMEMBERED {
            self.frames.pop_front();
        }
        self.frames.push_back(FIGURES.map(|(_, _, figure)| figure(reflection).unwrap_or(f64::NAN)));
    }

    /// The values of one figure, oldest first.
    pub fn of(&self, figure: usize) -> impl Iterator<Item = f64> {
        self.frames.iter().map(move |frame| frame[figure])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_what_mirrors_reflect_are_named_where_they_are_less_than_all() {
        let share = ReflectedShare { points: 1.0 / 83.0, texels: 1.0 / 16.0, pixels: 1.0 / 9.0 };
        assert_eq!(reflected_text(&share), "1.2 % of points, 1/16 of texels, 1/9 of mirror pixels");
        let share = ReflectedShare { points: 0.5, pixels: 0.04, ..ReflectedShare::ALL };
        assert_eq!(reflected_text(&share), "50 % of points, 1/25 of mirror pixels");
    }
}
