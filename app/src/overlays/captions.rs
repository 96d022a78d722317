//! The captions of a path, in the middle of the picture's width.

use egui::text::LayoutJob;
use egui::{Align, Color32, FontId, Painter, Rect, pos2};
use scene::{Caption, Place};

use super::ground;

/// The longest line, as a share of the picture's width.
const LONGEST: f32 = 0.9;
/// The distance from the picture's edge, and between two captions, in heights of the text.
const APART: f32 = 1.2;

/// Draws captions over a picture that fills `rect`, those at its top below `top`. Those in one place stand one above the other, the first at the
/// edge; in the middle, each stands below those before it.
pub fn paint(painter: &Painter, rect: Rect, top: f32, captions: &[Caption]) {
    let (mut next, mut below) = ([top, rect.center().y, rect.bottom()], 0.5);
    for caption in captions.iter().filter(|caption| !caption.text.trim().is_empty()) {
        let size = (rect.height() * caption.size).max(1.0);
        let (font, width) = (FontId::proportional(size), rect.width() * LONGEST);
        let mut job = LayoutJob::simple(caption.text.clone(), font, Color32::WHITE, width);
        job.halign = Align::Center;
        let galley = painter.layout_job(job);
        let place = &mut next[caption.place as usize];
        let top = match caption.place {
            Place::Top => *place + APART * size,
            // The first one is centred.
            Place::Middle => *place - std::mem::take(&mut below) * galley.size().y,
            Place::Bottom => *place - APART * size - galley.size().y,
        };
        // Lines are centred on the place at which they are drawn.
        let at = pos2(rect.center().x, top);
        let area = galley.rect.translate(at.to_vec2());
        ground::paint(painter, area, size);
        painter.galley(at, galley, Color32::WHITE);
        *place = if caption.place == Place::Bottom { area.top() } else { area.bottom() + size };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlays::canvas;

    /// The rows that captions change, of a picture of 300x200.
    fn rows(captions: &[Caption]) -> Vec<usize> {
        let mut rgba = vec![120; 300 * 200 * 4];
        canvas::draw(&mut rgba, [300, 200], |painter, rect| paint(painter, rect, rect.top(), captions));
        let is_changed = |row: &[u8]| row.iter().any(|byte| *byte != 120);
        rgba.chunks_exact(300 * 4).enumerate().filter(|(_, row)| is_changed(row)).map(|(index, _)| index).collect()
    }

    #[test]
    fn a_caption_has_its_place_and_its_height_and_leaves_room_for_others() {
        let caption = |place, size| Caption { place, size, ..Caption::new("Sphere".into(), 0.0, None) };
        let ends = |place, size| {
            let rows = rows(&[caption(place, size)]);
            [rows[0], rows[rows.len() - 1]]
        };
        let [top, middle, bottom] = [Place::Top, Place::Middle, Place::Bottom].map(|place| ends(place, 0.05));
        assert!(top[0] > 0 && top[1] < 40 && middle[0] > 80 && middle[1] < 120 && bottom[0] > 160 && bottom[1] < 199);
        let height = |ends: [usize; 2]| (ends[1] - ends[0]) as f32;
        let ratio = height(ends(Place::Top, 0.1)) / height(top);
        assert!((1.7..2.3).contains(&ratio), "{ratio}");
        // Two in one place cover twice as much, because none covers the other.
        let two = rows(&[caption(Place::Bottom, 0.05), caption(Place::Bottom, 0.05)]);
        assert!(two.len() as f32 > 1.9 * height(bottom), "{two:?}");
        assert!(rows(&[Caption::new(" \n".into(), 0.0, None)]).is_empty());
        // A long text is broken into lines that fit.
        let long = rows(&[Caption::new("many words that are ".repeat(9), 0.0, None)]);
        assert!(long.len() > 3 * (bottom[1] - bottom[0]) / 2, "{long:?}");
    }
}
