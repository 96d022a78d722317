//! The colour legend: a ramp with its numbers, or the classes that occur, with the name of what is shown.

use std::sync::Arc;

use cloud::is_length;
use codec::Units;
use egui::epaint::Mesh;
use egui::text::{LayoutJob, TextWrapping};
use egui::{Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Shape, Stroke, Vec2, pos2, vec2};
use render::{ColorPlan, ColorSource, STRAY_KINDS, class_color, class_name, ramp_colors};
use scene::Ramp;

use super::ground;
use crate::shared::language::{text, translated};
use crate::shared::steps;

/// The most numbers beside a ramp.
const MOST_TICKS: usize = 6;
/// The most classes that are listed; more would fill the picture.
const MOST_CLASSES: usize = 24;
/// The most letters of a cloud's name in a title.
const MOST_OF_NAME: usize = 40;
/// The length of a ramp, in heights of the text, and that of the shortest which still shows its colours in order.
const RAMP_LENGTH: f32 = 12.0;
const SHORTEST_RAMP: f32 = 2.0;
/// The least width of a legend, in heights of the text: that of a ramp with a number of some digits.
const SMALLEST_WIDTH: f32 = 5.0;
/// The height of a line of text in heights of its letters, and that of the title in lines.
const LINE: f32 = 1.45;
const TITLE: f32 = 1.2;
/// The height of the line that says how many legends are there, with what lies around it.
const LINE_OF_COUNT: f32 = 2.1;
/// The room to the right of a legend and below it, in heights of the text.
const MARGIN: f32 = 0.6;

#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    pub title: String,
    pub scale: Scale,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Scale {
    Ramp { ramp: Ramp, low: f64, high: f64 },
    Classes(Vec<u8>),
    Strays,
}

impl Legend {
    /// The legend of a cloud's colours; `None` if its colours stand for no values. `classes` are those that are shown.
    pub fn of(plan: &ColorPlan, units: &Units, classes: impl Iterator<Item = u8>) -> Option<Self> {
        match plan.source {
            ColorSource::Class => {
                let classes: Vec<u8> = classes.collect();
                (!classes.is_empty()).then(|| Self { title: text!("class").into(), scale: Scale::Classes(classes) })
            }
            ColorSource::Stray => Some(Self { title: plan.label.clone(), scale: Scale::Strays }),
            ColorSource::Height | ColorSource::Column(_) => {
                let title = title(plan, units);
                let (ramp, low, high) = (plan.ramp, plan.low, plan.high);
                Some(Self { title, scale: Scale::Ramp { ramp, low, high } })
            }
            _ => None,
        }
    }

    /// The title and the name of the first of `count` clouds.
    pub fn title_with(&self, first: &str, count: usize) -> String {
        let name = param::shortened(first, MOST_OF_NAME);
        match count {
            0 | 1 => format!("{}, {name}", self.title),
            all => format!("{}, {name} {}", self.title, text!("and {count} more", count = all - 1)),
        }
    }

    /// Lays it out for a height of the text, in a room without its margins: of a ramp a shorter bar, of classes fewer rows,
    /// and the beginnings of texts where the room is smaller than the legend. `None` where even that would say nothing.
    fn lay_out(&self, painter: &Painter, size: f32, room: Vec2) -> Option<LaidOut> {
        let line = size * LINE;
        let body = room.y - line * TITLE;
        let written = |text: &str, width: f32| written(painter, text, size, width);
        if room.x < SMALLEST_WIDTH * size {
            return None;
        }
        let title = written(&self.title, room.x);
        let texts = |rows: Vec<(String, Color32)>| -> Vec<_> {
            rows.into_iter().map(|(text, color)| (written(&text, room.x - size * 2.0), color)).collect()
        };
        let (part, is_whole) = match &self.scale {
            Scale::Ramp { ramp, low, high } => {
                let length = RAMP_LENGTH.min(body / size - 1.0);
                if length < SHORTEST_RAMP {
                    return None;
                }
                let most = MOST_TICKS.min((length / LINE) as usize);
                let number = |(value, text): (f64, String)| (value, written(&text, room.x - size * 2.0));
                let numbers = steps::ticks(*low, *high, most).into_iter().map(number).collect();
                (Part::Ramp { ramp: *ramp, low: *low, high: *high, length, numbers }, length == RAMP_LENGTH)
            }
            Scale::Classes(classes) => {
                let most = MOST_CLASSES.min((body / line + 1e-3) as usize);
                if most < classes.len().min(2) {
                    return None;
                }
                (Part::Rows(texts(class_rows(classes, most))), most >= classes.len().min(MOST_CLASSES))
            }
            Scale::Strays if body < line * STRAY_KINDS.len() as f32 => return None,
            Scale::Strays => {
                let kind = |(name, [r, g, b, _]): (&str, [u8; 4])| (name.to_owned(), Color32::from_rgb(r, g, b));
                (Part::Rows(texts(STRAY_KINDS.map(kind).into())), true)
            }
        };
        let texts: Vec<&Arc<Galley>> = match &part {
            Part::Ramp { numbers, .. } => numbers.iter().map(|(_, text)| text).collect(),
            Part::Rows(rows) => rows.iter().map(|(text, _)| text).collect(),
        };
        let widest = texts.iter().map(|text| text.size().x).fold(0.0, f32::max) + size * 2.0;
        let body = match &part {
            Part::Ramp { length, .. } => length * size + size,
            Part::Rows(rows) => rows.len() as f32 * line,
        };
        let inner = vec2(widest.max(title.size().x), line * TITLE + body);
        Some(LaidOut { title, part, inner, is_whole })
    }
}

/// Where legends may stand: from the lower right corner of an area up, and then in further columns to the left.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    pub area: Rect,
    /// Where columns end at the top, below other overlays.
    pub top: f32,
    /// Where further columns end at the left and at the bottom.
    pub left: f32,
    pub bottom: f32,
}

/// Draws legends where they have room. They are made smaller where that is too small for them, and those that do not fit are
/// left out: a line says how many of `all` are there.
pub fn paint_all(legends: &[Legend], all: usize, painter: &Painter, room: Room, size: f32) {
    let mut placed = arrange(legends, painter, room, size);
    if placed.len() < all {
        let lower = size * LINE_OF_COUNT;
        placed = arrange(legends, painter, Room { top: room.top + lower, ..room }, size);
        let told = match all {
            1 => text!("no room for the legend").into(),
            all => text!("{count} of {all} legends", count = placed.len(), all),
        };
        let told = written(painter, &told, size, room.area.width() - size * MARGIN);
        let corner = pos2(room.area.right() - size * MARGIN - told.size().x, room.top);
        ground::paint(painter, Rect::from_min_size(corner, told.size()), size);
        painter.galley(corner, told, Color32::WHITE);
    }
    for (legend, place) in placed {
        legend.paint(painter, place, size);
    }
}

/// A line of text, of which a mark of omission ends the beginning where it is wider than `width`.
fn written(painter: &Painter, text: &str, size: f32, width: f32) -> Arc<Galley> {
    let mut job = LayoutJob::simple_singleline(text.to_owned(), FontId::proportional(size), Color32::WHITE);
    job.wrap = TextWrapping::truncate_at_width(width);
    painter.layout_job(job)
}

/// The legends that have room, with their places.
fn arrange(legends: &[Legend], painter: &Painter, room: Room, size: f32) -> Vec<(LaidOut, Rect)> {
    let Room { area, top, left, bottom } = room;
    let mut placed: Vec<(LaidOut, Rect)> = Vec::new();
    let margin = vec2(size, size) * MARGIN;
    // Where the next one ends, and the upper left corner of its column.
    let (mut corner, mut end) = (area.max, pos2(area.left(), top));
    for legend in legends {
        let lay_out = |corner: Pos2, end: Pos2| {
            let laid = legend.lay_out(painter, size, corner - end - margin)?;
            let place = Rect::from_min_size(corner - laid.inner - margin, laid.inner);
            Some((laid, place))
        };
        let mut best = lay_out(corner, end);
        if !best.as_ref().is_some_and(|(laid, _)| laid.is_whole) && !placed.is_empty() {
            let edge = placed.iter().map(|(_, place)| place.left()).fold(area.right(), f32::min);
            let (next, beside) = (pos2(edge - size, bottom), pos2(left, top));
            let height = |one: &(LaidOut, Rect)| one.1.height();
            let found = lay_out(next, beside).filter(|one| best.as_ref().is_none_or(|best| height(one) > height(best)));
            if found.is_some() {
                (best, end) = (found, beside);
            }
        }
        if let Some((laid, place)) = best {
            corner = place.right_top() + vec2(size * MARGIN, -size);
            placed.push((laid, place));
        }
    }
    placed
}

/// A legend as it is drawn.
struct LaidOut {
    title: Arc<Galley>,
    part: Part,
    /// Its size without margins.
    inner: Vec2,
    is_whole: bool,
}

enum Part {
    /// `length` is in heights of the text.
    Ramp {
        ramp: Ramp,
        low: f64,
        high: f64,
        length: f32,
        numbers: Vec<(f64, Arc<Galley>)>,
    },
    Rows(Vec<(Arc<Galley>, Color32)>),
}

impl LaidOut {
    fn paint(self, painter: &Painter, area: Rect, size: f32) {
        let line = size * LINE;
        ground::paint(painter, area, size);
        painter.galley(area.left_top(), self.title, Color32::WHITE);
        let top = area.top() + line * TITLE;
        let beside = |text: Arc<Galley>, at: Pos2| {
            let place = Align2::LEFT_CENTER.anchor_size(at, text.size());
            painter.galley(place.min, text, Color32::WHITE);
        };
        match self.part {
            Part::Rows(rows) => {
                for (index, (text, color)) in rows.into_iter().enumerate() {
                    let middle = top + (index as f32 + 0.5) * line;
                    let swatch = Rect::from_center_size(pos2(area.left() + size * 0.5, middle), vec2(size, size) * 0.9);
                    painter.rect_filled(swatch, size * 0.15, color);
                    beside(text, pos2(area.left() + size * 1.5, middle));
                }
            }
            Part::Ramp { ramp, low, high, length, numbers } => {
                let bar = Rect::from_min_max(
                    pos2(area.left(), top + size * 0.5),
                    pos2(area.left() + size, top + size * 0.5 + length * size),
                );
                painter.add(Shape::mesh(ramp_mesh(bar, ramp)));
                for (value, number) in numbers {
                    let share = if high > low { ((value - low) / (high - low)) as f32 } else { 0.5 };
                    let y = bar.bottom() - share * bar.height();
                    let ends = [pos2(bar.right(), y), pos2(bar.right() + size * 0.35, y)];
                    painter.line_segment(ends, Stroke::new(size * 0.08, Color32::WHITE));
                    beside(number, pos2(bar.right() + size * 0.6, y));
                }
            }
        }
    }
}

/// The name of what colours show, with its unit where it is known: of heights, and of columns that are lengths.
pub fn title(plan: &ColorPlan, units: &Units) -> String {
    let unit = match plan.source {
        ColorSource::Height => units.rise(),
        ColorSource::Column(_) => units.length().filter(|_| is_length(&plan.label)),
        _ => None,
    };
    unit.map_or(plan.label.clone(), |unit| format!("{} ({unit})", plan.label))
}

/// The rows of classes, `most` at most.
fn class_rows(classes: &[u8], most: usize) -> Vec<(String, Color32)> {
    let shown = if classes.len() > most { most.saturating_sub(1) } else { classes.len() };
    let row = |class: &u8| {
        let [red, green, blue, _] = class_color(*class);
        (
            format!("{class}  {}", translated(class_name(*class))).trim_end().to_owned(),
            Color32::from_rgb(red, green, blue),
        )
    };
    let mut rows: Vec<(String, Color32)> = classes[..shown].iter().map(row).collect();
    if shown < classes.len() {
        rows.push((text!("and {count} more", count = classes.len() - shown), Color32::TRANSPARENT));
    }
    rows
}

/// A bar in the colours of a ramp, the low end at the bottom.
fn ramp_mesh(bar: Rect, ramp: Ramp) -> Mesh {
    let mut mesh = Mesh::default();
    let colors = ramp_colors(ramp);
    for (index, [red, green, blue, _]) in colors.into_iter().enumerate() {
        let y = bar.bottom() - bar.height() * index as f32 / 255.0;
        let color = Color32::from_rgb(red, green, blue);
        mesh.colored_vertex(pos2(bar.left(), y), color);
        mesh.colored_vertex(pos2(bar.right(), y), color);
    }
    for row in 0..colors.len() as u32 - 1 {
        mesh.add_triangle(row * 2, row * 2 + 1, row * 2 + 2);
        mesh.add_triangle(row * 2 + 1, row * 2 + 2, row * 2 + 3);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use codec::Unit;

    use super::*;
    use crate::overlays::canvas;

    fn plan(source: ColorSource) -> ColorPlan {
        let (low, high) = (10.0, 20.0);
        let label = "height".into();
        ColorPlan { source, label, ramp: Ramp::Viridis, plain: [1; 4], low, high, full_range: (low, high) }
    }

    /// An area without other overlays.
    fn room(area: Rect) -> Room {
        Room { area, top: area.top(), left: area.left(), bottom: area.bottom() }
    }

    #[test]
    fn legends_are_of_ramps_and_classes_and_of_nothing_else() {
        let feet = Units { level: Some(Unit::Metre), height: Some(Unit::Foot) };
        let of = |source| Legend::of(&plan(source), &feet, [2, 6].into_iter());
        assert_eq!(of(ColorSource::Height).unwrap().title, "height (ft)");
        assert_eq!(of(ColorSource::Column(0)).unwrap().title, "height", "the unit of an attribute is not known");
        let distances = ColorPlan { label: "distance_2".into(), ..plan(ColorSource::Column(0)) };
        let metres = Units { level: Some(Unit::Metre), height: None };
        let title = |units| Legend::of(&distances, units, std::iter::empty()).unwrap().title;
        assert_eq!((title(&metres), title(&feet)), ("distance_2 (m)".into(), "distance_2".into()));
        let error = ColorPlan { label: cloud::GHOST_ERROR.into(), ..distances.clone() };
        assert_eq!(Legend::of(&error, &metres, std::iter::empty()).unwrap().title, "ghost_error (m)");
        assert_eq!(of(ColorSource::Class).unwrap().scale, Scale::Classes(vec![2, 6]));
        assert_eq!(of(ColorSource::Stray).unwrap().scale, Scale::Strays);
        for source in [ColorSource::Rgb, ColorSource::RgbOr(Some(0)), ColorSource::Plain, ColorSource::Normal] {
            assert_eq!(of(source), None);
        }
        let named = |count| of(ColorSource::Column(0)).unwrap().title_with("a.laz", count);
        assert_eq!((named(1), named(3)), ("height, a.laz".into(), "height, a.laz and 2 more".into()));
        let all: Vec<u8> = (0..=255).collect();
        let rows = class_rows(&all, MOST_CLASSES);
        assert_eq!((rows.len(), rows[MOST_CLASSES - 1].0.as_str()), (MOST_CLASSES, "and 233 more"));
        assert_eq!(rows[2].0, "2  ground");
    }

    #[test]
    fn the_ramp_of_a_picture_has_the_colour_of_each_value_at_its_number() {
        let legend = Legend::of(&plan(ColorSource::Height), &Units::default(), std::iter::empty()).unwrap();
        let size = [200_u32, 260];
        let mut rgba = vec![0; (size[0] * size[1] * 4) as usize];
        canvas::draw(&mut rgba, size, |painter, rect| {
            paint_all(std::slice::from_ref(&legend), 1, painter, room(rect), 13.0);
        });
        let colors = ramp_colors(Ramp::Viridis);
        // The lower end, the upper end and all in between occur in a column of the picture, in order.
        let column = (0..size[0]).find(|x| {
            let at = |y: u32| ((y * size[0] + x) * 4) as usize;
            (0..size[1]).filter(|y| rgba[at(*y)..at(*y) + 3] == colors[128][..3] || rgba[at(*y) + 1] > 220).count() > 3
        });
        let x = column.unwrap() + 2;
        let seen: Vec<[u8; 3]> = (0..size[1])
            .map(|y| std::array::from_fn(|channel| rgba[((y * size[0] + x) * 4) as usize + channel]))
            .collect();
        let place = |color: [u8; 4]| {
            let distance = |seen: &[u8; 3]| (0..3).map(|c| seen[c].abs_diff(color[c]) as u32).sum::<u32>();
            let nearest = (0..seen.len()).min_by_key(|y| distance(&seen[*y])).unwrap();
            assert!(distance(&seen[nearest]) < 12, "{color:?} is {:?}", seen[nearest]);
            nearest as f32
        };
        let (low, middle, high) = (place(colors[2]), place(colors[128]), place(colors[253]));
        assert!(((low + high) * 0.5 - middle).abs() < 3.0 && (low - high - 156.0).abs() < 6.0, "{low} {middle} {high}");
    }

    /// What of some legends is drawn in an area of this size: the places, and whether each is whole.
    fn drawn(legends: &[Legend], [width, height]: [f32; 2]) -> Vec<(Rect, bool)> {
        let found = std::cell::RefCell::new(Vec::new());
        canvas::draw(&mut [], [0, 0], |painter, _| {
            let area = Rect::from_min_size(pos2(10.0, 10.0), vec2(width, height));
            let placed = arrange(legends, painter, room(area), 13.0);
            found.replace(placed.into_iter().map(|(laid, place)| (place, laid.is_whole)).collect());
        });
        found.into_inner()
    }

    #[test]
    fn legends_stand_in_columns_and_become_smaller_before_they_are_left_out() {
        let ramp = Legend::of(&plan(ColorSource::Height), &Units::default(), std::iter::empty()).unwrap();
        let classes = Legend::of(&plan(ColorSource::Class), &Units::default(), 0..=22).unwrap();
        let all = [ramp.clone(), classes, ramp];
        let mut most = 3;
        for size in [
            [1200.0, 900.0],
            [640.0, 420.0],
            [480.0, 300.0],
            [300.0, 220.0],
            [160.0, 120.0],
            [90.0, 80.0],
            [60.0, 40.0],
        ] {
            let placed = drawn(&all, size);
            let area = Rect::from_min_size(pos2(10.0, 10.0), vec2(size[0], size[1]));
            for (index, (place, _)) in placed.iter().enumerate() {
                assert!(area.contains_rect(*place), "{size:?}: {place:?}");
                let others = placed[..index].iter().map(|(other, _)| other);
                assert!(others.into_iter().all(|other| !other.expand(5.0).intersects(place.expand(5.0))), "{size:?}");
            }
            assert!(placed.len() <= most, "{size:?}");
            most = placed.len();
        }
        let whole = |size| drawn(&all, size).iter().filter(|(_, is_whole)| *is_whole).count();
        assert_eq!((whole([1200.0, 900.0]), whole([640.0, 520.0]), drawn(&all, [640.0, 300.0]).len()), (3, 3, 3));
        assert_eq!((drawn(&all[..1], [160.0, 120.0]).len(), drawn(&all, [60.0, 40.0]).len()), (1, 0));
    }

    #[test]
    fn a_line_says_how_many_legends_are_there() {
        let ramp = Legend::of(&plan(ColorSource::Height), &Units::default(), std::iter::empty()).unwrap();
        let painted = |size: [u32; 2], all: usize| {
            let mut rgba = vec![0; (size[0] * size[1] * 4) as usize];
            canvas::draw(&mut rgba, size, |painter, rect| {
                paint_all(&vec![ramp.clone(); all.min(3)], all, painter, room(rect.shrink(10.0)), 13.0);
            });
            // White letters in the highest lines.
            let top = rgba.chunks_exact(4).take((size[0] * 28) as usize);
            top.filter(|pixel| pixel[..3].iter().all(|byte| *byte > 200)).count()
        };
        let (one, four) = (painted([400, 300], 1), painted([400, 300], 4));
        assert!(four > one + 20, "{four} of four, {one} of one");
        assert!(painted([60, 40], 1) > 20, "that there is no room for it");
    }
}
