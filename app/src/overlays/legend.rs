//! The colour legend: a ramp with its numbers, or the classes that occur, with the name of what is shown.

use cloud::is_length;
use codec::Units;
use egui::epaint::Mesh;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
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
/// The length of a ramp, in heights of the text.
const RAMP_LENGTH: f32 = 12.0;

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

    /// The title and the name of the first of some clouds.
    pub fn title_with(&self, clouds: &[String]) -> String {
        let name = clouds.first().map_or(String::new(), |name| param::shortened(name, MOST_OF_NAME));
        match clouds.len() {
            0 | 1 => format!("{}, {name}", self.title),
            all => format!("{}, {name} {}", self.title, text!("and {count} more", count = all - 1)),
        }
    }

    /// Draws it with its lower right corner at a place; returns its height with its margin.
    pub fn paint(&self, painter: &Painter, corner: Pos2, size: f32) -> f32 {
        let font = FontId::proportional(size);
        let width = |text: &str| painter.layout_no_wrap(text.to_owned(), font.clone(), Color32::WHITE).size().x;
        let line = size * 1.45;
        let rows: Vec<(String, Color32)> = match &self.scale {
            Scale::Ramp { .. } => Vec::new(),
            Scale::Classes(classes) => class_rows(classes),
            Scale::Strays => {
                STRAY_KINDS.map(|(name, [r, g, b, _])| (name.to_owned(), Color32::from_rgb(r, g, b))).into()
            }
        };
        let (ticks, decimals) = match self.scale {
            Scale::Ramp { low, high, .. } => steps::ticks(low, high, MOST_TICKS),
            Scale::Classes(_) | Scale::Strays => (Vec::new(), 0),
        };
        let numbers: Vec<String> = ticks.iter().map(|value| format!("{value:.decimals$}")).collect();
        let texts = rows.iter().map(|(text, _)| text).chain(&numbers);
        let widest = texts.map(|text| width(text)).fold(0.0, f32::max) + size * 2.0;
        let body = if rows.is_empty() { RAMP_LENGTH * size + size } else { rows.len() as f32 * line };
        let inner = vec2(widest.max(width(&self.title)), line * 1.2 + body);
        let margin = size * 0.6;
        let area = Rect::from_min_size(corner - inner - vec2(margin, margin), inner);
        ground::paint(painter, area, size);
        painter.text(area.left_top(), Align2::LEFT_TOP, &self.title, font.clone(), Color32::WHITE);
        let top = area.top() + line * 1.2;
        for (index, (text, color)) in rows.iter().enumerate() {
            let middle = top + (index as f32 + 0.5) * line;
            let swatch = Rect::from_center_size(pos2(area.left() + size * 0.5, middle), vec2(size, size) * 0.9);
            painter.rect_filled(swatch, size * 0.15, *color);
            painter.text(
                pos2(area.left() + size * 1.5, middle),
                Align2::LEFT_CENTER,
                text,
                font.clone(),
                Color32::WHITE,
            );
        }
        if let Scale::Ramp { ramp, low, high } = self.scale {
            let bar = Rect::from_min_max(
                pos2(area.left(), top + size * 0.5),
                pos2(area.left() + size, top + size * 0.5 + RAMP_LENGTH * size),
            );
            painter.add(Shape::mesh(ramp_mesh(bar, ramp)));
            for (value, number) in ticks.iter().zip(numbers) {
                let share = if high > low { ((value - low) / (high - low)) as f32 } else { 0.5 };
                let y = bar.bottom() - share * bar.height();
                let ends = [pos2(bar.right(), y), pos2(bar.right() + size * 0.35, y)];
                painter.line_segment(ends, Stroke::new(size * 0.08, Color32::WHITE));
                let at = pos2(bar.right() + size * 0.6, y);
                painter.text(at, Align2::LEFT_CENTER, number, font.clone(), Color32::WHITE);
            }
        }
        inner.y + size * 1.6
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

fn class_rows(classes: &[u8]) -> Vec<(String, Color32)> {
    let shown = if classes.len() > MOST_CLASSES { MOST_CLASSES - 1 } else { classes.len() };
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
        let named = |clouds: &[&str]| {
            let clouds: Vec<String> = clouds.iter().map(|name| (*name).to_owned()).collect();
            of(ColorSource::Column(0)).unwrap().title_with(&clouds)
        };
        assert_eq!(named(&["a.laz"]), "height, a.laz");
        assert_eq!(named(&["a.laz", "b.laz", "c.laz"]), "height, a.laz and 2 more");
        let all: Vec<u8> = (0..=255).collect();
        let rows = class_rows(&all);
        assert_eq!((rows.len(), rows[MOST_CLASSES - 1].0.as_str()), (MOST_CLASSES, "and 233 more"));
        assert_eq!(rows[2].0, "2  ground");
    }

    #[test]
    fn the_ramp_of_a_picture_has_the_colour_of_each_value_at_its_number() {
        let legend = Legend::of(&plan(ColorSource::Height), &Units::default(), std::iter::empty()).unwrap();
        let size = [200_u32, 260];
        let mut rgba = vec![0; (size[0] * size[1] * 4) as usize];
        canvas::draw(&mut rgba, size, |painter, rect| {
            legend.paint(painter, rect.max, 13.0);
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
}
