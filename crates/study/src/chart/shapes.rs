//! The shapes of a chart once everything is placed, and their output as SVG or PNG.

use std::sync::OnceLock;

use anyhow::anyhow;
use plotters::backend::{BitMapBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea as _};
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontDesc, FontFamily, FontStyle, FontTransform, IntoFont as _, RGBColor, TextStyle};

use crate::picture;

/// A position in pixels from the upper left.
pub type Place = (f64, f64);

/// How a text is aligned to its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
    /// Centred, and read from below.
    Upward,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    Line {
        points: Vec<Place>,
        color: [u8; 3],
        width: u32,
    },
    Area {
        points: Vec<Place>,
        color: [u8; 3],
        opacity: f64,
    },
    Disc {
        center: Place,
        radius: f64,
        color: [u8; 3],
        is_filled: bool,
    },
    /// Vertically centred about its place.
    Words {
        at: Place,
        text: String,
        size: f64,
        color: [u8; 3],
        anchor: Anchor,
    },
}

/// The number of PNG pixels per SVG pixel: sharp on a dense screen.
const PNG_SCALE: f64 = 2.0;
/// plotters takes the height of a line as the size, SVG that of the letter m.
const LINE_HEIGHT: f64 = 1.24;
/// Bitmaps are centred by the whole line, with room for descenders; letters look centred if they are this share of
/// their size lower.
const BITMAP_SINK: f64 = 0.13;
const FAMILY: FontFamily<'static> = FontFamily::SansSerif;

/// The font is in the program, so that charts look the same on every machine. An SVG names any font without serifs.
fn register_font() {
    static IS_REGISTERED: OnceLock<bool> = OnceLock::new();
    IS_REGISTERED.get_or_init(|| {
        let font = epaint_default_fonts::UBUNTU_LIGHT;
        plotters::style::register_font(FAMILY.as_str(), FontStyle::Normal, font).is_ok()
    });
}

/// The width of a text in pixels.
pub fn width(text: &str, size: f64) -> f64 {
    register_font();
    let font = FontDesc::new(FAMILY, size * LINE_HEIGHT * 16.0, FontStyle::Normal);
    // Measured at a larger size, as sizes are rounded to pixels. Other fonts without serifs are a little wider.
    font.box_size(text).map_or(text.chars().count() as f64 * size * 0.6, |(width, _)| f64::from(width) / 16.0 * 1.1)
}

/// Writes the shapes as SVG.
///
/// # Errors
/// None but defects of the drawing.
pub fn svg(shapes: &[Shape], size: [u32; 2]) -> anyhow::Result<String> {
    let mut text = String::new();
    paint(&SVGBackend::with_string(&mut text, (size[0], size[1])).into_drawing_area(), shapes, 1.0, 0.0)?;
    Ok(text)
}

/// Draws the shapes as PNG.
///
/// # Errors
/// None but defects of the drawing.
pub fn png(shapes: &[Shape], size: [u32; 2]) -> anyhow::Result<Vec<u8>> {
    let size = size.map(|side| (f64::from(side) * PNG_SCALE) as u32);
    let mut rgb = vec![u8::MAX; size[0] as usize * size[1] as usize * 3];
    let area = BitMapBackend::with_buffer(&mut rgb, (size[0], size[1])).into_drawing_area();
    paint(&area, shapes, PNG_SCALE, BITMAP_SINK)?;
    drop(area);
    picture::png(size, &rgb)
}

/// Draws the shapes; `sink` is the share of its size by which text is moved down.
fn paint<Backend: DrawingBackend>(
    area: &DrawingArea<Backend, Shift>,
    shapes: &[Shape],
    scale: f64,
    sink: f64,
) -> anyhow::Result<()> {
    register_font();
    let at = |place: &Place| ((place.0 * scale).round() as i32, (place.1 * scale).round() as i32);
    let rgb = |color: &[u8; 3]| RGBColor(color[0], color[1], color[2]);
    area.fill(&RGBColor(255, 255, 255)).map_err(|error| anyhow!("{error}"))?;
    for shape in shapes {
        let drawn = match shape {
            Shape::Line { points, color, width } => {
                let style = rgb(color).stroke_width((f64::from(*width) * scale) as u32);
                area.draw(&PathElement::new(points.iter().map(at).collect::<Vec<_>>(), style))
            }
            Shape::Area { points, color, opacity } => {
                let style = rgb(color).mix(*opacity).filled();
                area.draw(&Polygon::new(points.iter().map(at).collect::<Vec<_>>(), style))
            }
            Shape::Disc { center, radius, color, is_filled } => {
                let style = if *is_filled { rgb(color).filled() } else { rgb(color).stroke_width(scale as u32) };
                area.draw(&Circle::new(at(center), (radius * scale).round() as i32, style))
            }
            Shape::Words { at: place, text, size, color, anchor } => {
                let font = (FAMILY.as_str(), size * LINE_HEIGHT * scale).into_font();
                let (font, across) = match anchor {
                    Anchor::Start => (font, HPos::Left),
                    Anchor::Middle => (font, HPos::Center),
                    Anchor::End => (font, HPos::Right),
                    Anchor::Upward => (font.transform(FontTransform::Rotate270), HPos::Center),
                };
                let color = rgb(color);
                let style = TextStyle::from(font).color(&color).pos(Pos::new(across, VPos::Center));
                area.draw(&Text::new(text.as_str(), at(&(place.0, place.1 + size * sink)), style))
            }
        };
        drawn.map_err(|error| anyhow!("{error}"))?;
    }
    area.present().map_err(|error| anyhow!("{error}"))
}
