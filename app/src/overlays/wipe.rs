//! The lines and the names of a wipe. The name of a state lies on its picture: at the left, in the middle, or at the
//! right, and the lines uncover it with the picture.

use egui::{Align2, Color32, FontId, Painter, Rect, Stroke, pos2};
use scene::WipeMarks;

use super::ground::{self, SHADOW};

/// The height of a name, and the width of a line, as shares of the picture's height.
const NAME: f32 = 0.032;
const LINE: f32 = 0.003;
/// The distance of a name from the picture's edges, in heights of the text.
const APART: f32 = 1.0;

/// Draws the lines and the names of a wipe over a picture that fills `rect`. Returns how far down names reach.
pub fn paint(painter: &Painter, rect: Rect, WipeMarks { lines, names }: &WipeMarks) -> f32 {
    let size = (rect.height() * NAME).max(1.0);
    let x = |line: f64| rect.left() + rect.width() * line as f32;
    let area = rect.shrink(APART * size);
    let last = names.len().saturating_sub(1);
    let mut lowest = rect.top();
    for (state, name) in names.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let from = state.checked_sub(1).and_then(|line| lines.get(line)).map_or(rect.left(), |line| x(*line));
        let to = lines.get(state).map_or(rect.right(), |line| x(*line));
        let (at, align) = match state {
            0 => (area.left_top(), Align2::LEFT_TOP),
            state if state == last => (area.right_top(), Align2::RIGHT_TOP),
            _ => (area.center_top(), Align2::CENTER_TOP),
        };
        let painter = painter.with_clip_rect(Rect::from_x_y_ranges(from..=to.max(from), rect.y_range()));
        let galley = painter.layout_no_wrap(name.clone(), FontId::proportional(size), Color32::WHITE);
        let place = align.anchor_size(at, galley.size());
        ground::paint(&painter, place, size);
        painter.galley(place.min, galley, Color32::WHITE);
        lowest = lowest.max(place.bottom() + size * 0.4);
    }
    // At the edges there is nothing to divide.
    for line in lines.iter().filter(|line| **line > 0.0 && **line < 1.0) {
        let ends = [pos2(x(*line), rect.top()), pos2(x(*line), rect.bottom())];
        let width = (rect.height() * LINE).max(1.0);
        painter.line_segment(ends, Stroke::new(width * 2.5, SHADOW));
        painter.line_segment(ends, Stroke::new(width, Color32::WHITE));
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlays::canvas;

    /// The columns that the marks change, of a picture of 400x200, in its upper quarter and in its lower one.
    fn columns(lines: &[f64], names: &[&str]) -> [Vec<usize>; 2] {
        let mut rgba = vec![120; 400 * 200 * 4];
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        let marks = WipeMarks { lines: lines.to_vec(), names };
        canvas::draw(&mut rgba, [400, 200], |painter, rect| {
            paint(painter, rect, &marks);
        });
        let is_changed = |column: usize, row: usize| rgba[(row * 400 + column) * 4..][..4] != [120; 4];
        [0..50, 150..200]
            .map(|rows| (0..400).filter(|column| rows.clone().any(|row| is_changed(*column, row))).collect())
    }

    #[test]
    fn names_lie_on_their_states_and_lines_stand_between_them() {
        let [above, below] = columns(&[0.5], &["left", "right"]);
        assert!(below.iter().all(|column| (197..203).contains(column)) && !below.is_empty(), "{below:?}");
        assert!(above.iter().any(|column| *column < 40) && above.iter().any(|column| *column > 360));
        // A state that is not in the picture has no name in it, and no line stands at an edge.
        let [above, below] = columns(&[1.0], &["left", "right"]);
        assert!(below.is_empty() && above.iter().all(|column| *column < 100), "{above:?}");
        let [above, below] = columns(&[0.0], &["left", "right"]);
        assert!(below.is_empty() && above.iter().all(|column| *column > 300), "{above:?}");
        let [above, below] = columns(&[0.25, 0.75], &["", "middle", ""]);
        assert!(above.iter().any(|column| (180..220).contains(column)) && below.len() < 12);
    }
}
