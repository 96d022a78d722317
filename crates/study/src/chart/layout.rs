//! Computes where everything in a chart is placed.

use super::shapes::{Anchor, Place, Shape, width};
use super::{Chart, Column, Curve, Limit, Marker, Panel, Style, Whisker};

/// The width at which charts are read.
const WIDTH: f64 = 900.0;
/// The margin left and right of everything.
const EDGE: f64 = 12.0;
const TITLE_SIZE: f64 = 17.0;
const TEXT_SIZE: f64 = 12.5;
const LABEL_SIZE: f64 = 11.0;
const BLACK: [u8; 3] = [20, 20, 20];
const GRID: [u8; 3] = [228, 228, 228];
const FRAME: [u8; 3] = [90, 90, 90];
const FRONT: [u8; 3] = [170, 170, 170];
const FORBIDDEN: [u8; 3] = [200, 40, 40];
const MARKER_RADIUS: f64 = 4.5;
/// The distance between the lines of a legend.
const LEGEND_LINE: f64 = 20.0;
/// The distance between the lines of conditions.
const LABEL_LINE: f64 = 15.0;
/// The length of a dash and of the gap behind it.
const DASHES: (f64, f64) = (6.0, 4.0);

/// A rectangle, measured from the upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rect {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Rect {
    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    fn contains(&self, other: &Self) -> bool {
        self.left <= other.left && other.right <= self.right && self.top <= other.top && other.bottom <= self.bottom
    }

    fn around((x, y): Place, half_width: f64, half_height: f64) -> Self {
        Self { left: x - half_width, right: x + half_width, top: y - half_height, bottom: y + half_height }
    }

    fn at(&self, x: f64, y: f64) -> Place {
        (self.left + x * (self.right - self.left), self.bottom - y * (self.bottom - self.top))
    }
}

fn words(at: Place, text: impl Into<String>, size: f64, anchor: Anchor) -> Shape {
    Shape::Words { at, text: text.into(), size, color: BLACK, anchor }
}

/// The shapes of a chart and its size in pixels.
pub fn layout(chart: &Chart) -> (Vec<Shape>, [u32; 2]) {
    let mut shapes = vec![words((EDGE, 20.0), chart.title.as_str(), TITLE_SIZE, Anchor::Start)];
    let top = legend(chart, 46.0, &mut shapes);
    let columns = chart.panels.len().min(chart.columns).max(1);
    let panel_width = (WIDTH - 2.0 * EDGE) / columns as f64;
    let panel_height = match columns {
        1 => 440.0,
        2 => 330.0,
        _ => 270.0,
    };
    for (index, panel) in chart.panels.iter().enumerate() {
        let (left, upper) =
            ((index % columns) as f64 * panel_width + EDGE, (index / columns) as f64 * panel_height + top);
        let area = Rect { left, top: upper, right: left + panel_width, bottom: upper + panel_height };
        draw_panel(panel, area, &mut shapes);
    }
    let rows = chart.panels.len().div_ceil(columns);
    let mut bottom = top + rows as f64 * panel_height;
    for line in &chart.conditions {
        bottom += LABEL_LINE;
        let color = [110, 110, 110];
        let (at, text, size) = ((EDGE, bottom - 4.0), line.clone(), LABEL_SIZE);
        shapes.push(Shape::Words { at, text, size, color, anchor: Anchor::Start });
    }
    (shapes, [WIDTH as u32, (bottom + 8.0) as u32])
}

/// Places the names of curves and levels, once each, in lines from `top`; returns where the panels begin.
fn legend(chart: &Chart, top: f64, shapes: &mut Vec<Shape>) -> f64 {
    let mut entries: Vec<(&str, Option<Style>, Style)> = Vec::new();
    for panel in &chart.panels {
        let curves = panel.curves.iter().map(|curve| (curve.name.as_str(), Some(curve.style), curve.style));
        let levels = panel.levels.iter().map(|level| (level.name.as_str(), None, level.style));
        // From the top, as the layers lie.
        let layers = panel.columns.iter().flat_map(|column| column.layers.iter().rev());
        let layers = layers.map(|layer| {
            let style = Style { marker: Marker::Square, ..layer.style };
            (layer.name.as_str(), Some(style), style)
        });
        for entry in curves.chain(levels).chain(layers) {
            if !entries.contains(&entry) {
                entries.push(entry);
            }
        }
    }
    let (mut x, mut y) = (EDGE, top);
    let mut place = |needed: f64| {
        if x + needed > WIDTH - EDGE && x > EDGE {
            (x, y) = (EDGE, y + LEGEND_LINE);
        }
        let at = (x, y);
        x += needed;
        at
    };
    for (name, marker, style) in entries {
        let (left, y) = place(width(name, TEXT_SIZE) + 50.0);
        match marker {
            Some(style) => marker_shapes(style, (left + 10.0, y), false, shapes),
            None => dashed((left, y), (left + 22.0, y), style.color, 1, shapes),
        }
        shapes.push(words((left + 27.0, y), name, TEXT_SIZE, Anchor::Start));
    }
    let mut explained = |is_there: bool, text: &str, draw: &dyn Fn(Place, &mut Vec<Shape>)| {
        if is_there {
            let (left, y) = place(width(text, TEXT_SIZE) + 50.0);
            draw((left, y), shapes);
            shapes.push(words((left + 27.0, y), text, TEXT_SIZE, Anchor::Start));
        }
    };
    let has_front = chart.panels.iter().any(|panel| !panel.front.is_empty());
    explained(has_front, "Pareto front", &|(x, y), shapes| {
        shapes.push(Shape::Line { points: vec![(x, y), (x + 22.0, y)], color: FRONT, width: 2 });
    });
    let mut marks = chart.panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| &curve.marks);
    explained(marks.any(|mark| mark.is_sparse), "hollow: a tenth of the mirror or more is empty", &|at, shapes| {
        let style = Style { color: BLACK, marker: Marker::Square };
        marker_shapes(style, (at.0 + 10.0, at.1), true, shapes);
    });
    let has_limit = chart.panels.iter().any(|panel| panel.limit.is_some());
    explained(has_limit, "bound, the forbidden side shaded", &|(x, y), shapes| {
        dashed((x, y), (x + 22.0, y), FORBIDDEN, 1, shapes);
    });
    y + LEGEND_LINE
}

fn draw_panel(panel: &Panel, area: Rect, shapes: &mut Vec<Shape>) {
    // Titles and labels take 76 pixels of the height.
    let ticks_y = panel.y.ticks(((area.bottom - area.top - 76.0) / 40.0) as usize);
    let tick_width = ticks_y.iter().map(|tick| width(&tick.label, LABEL_SIZE)).fold(0.0, f64::max);
    let plot = Rect {
        left: area.left + 24.0 + tick_width,
        top: area.top + 26.0,
        right: area.right - 16.0,
        bottom: area.bottom - 50.0,
    };
    shapes.push(words(
        ((plot.left + plot.right) / 2.0, area.top + 13.0),
        panel.title.as_str(),
        TEXT_SIZE,
        Anchor::Middle,
    ));
    for tick in &ticks_y {
        let line = vec![plot.at(0.0, tick.share), plot.at(1.0, tick.share)];
        shapes.push(Shape::Line { points: line, color: GRID, width: 1 });
        let (_, y) = plot.at(0.0, tick.share);
        shapes.push(words((plot.left - 5.0, y), tick.label.as_str(), LABEL_SIZE, Anchor::End));
    }
    // As many as there is room for.
    let mut free_from = f64::NEG_INFINITY;
    for tick in panel.x.ticks(((plot.right - plot.left) / 60.0) as usize) {
        let line = vec![plot.at(tick.share, 0.0), plot.at(tick.share, 1.0)];
        shapes.push(Shape::Line { points: line, color: GRID, width: 1 });
        let ((x, _), half) = (plot.at(tick.share, 0.0), width(&tick.label, LABEL_SIZE) / 2.0);
        if x - half > free_from {
            shapes.push(words((x, plot.bottom + 12.0), tick.label.as_str(), LABEL_SIZE, Anchor::Middle));
            free_from = x + half + 4.0;
        }
    }
    let middle = ((plot.left + plot.right) / 2.0, (plot.top + plot.bottom) / 2.0);
    shapes.push(words((middle.0, plot.bottom + 30.0), panel.x_title.as_str(), TEXT_SIZE, Anchor::Middle));
    shapes.push(words((area.left + 8.0, middle.1), panel.y_title.as_str(), TEXT_SIZE, Anchor::Upward));
    if let Some(limit) = &panel.limit {
        draw_limit(limit, panel, plot, shapes);
    }
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
    let frame = corners.iter().map(|(x, y)| plot.at(*x, *y)).collect();
    shapes.push(Shape::Line { points: frame, color: FRAME, width: 1 });
    draw_front(panel, plot, shapes);
    for level in &panel.levels {
        let y = panel.y.share(level.y);
        dashed(plot.at(0.0, y), plot.at(1.0, y), level.style.color, 1, shapes);
    }
    for column in &panel.columns {
        draw_column(column, panel, plot, shapes);
    }
    for curve in &panel.curves {
        draw_curve(curve, panel, plot, shapes);
    }
    draw_labels(panel, plot, shapes);
}

fn place(panel: &Panel, plot: Rect, x: f64, y: f64) -> Place {
    // Words are places themselves.
    plot.at(panel.x.share(x), panel.y.share(y))
}

fn draw_limit(limit: &Limit, panel: &Panel, plot: Rect, shapes: &mut Vec<Shape>) {
    let inside = |value: Option<f64>, none: f64| value.map_or(none, |value| panel.x.share(value).clamp(0.0, 1.0));
    let (left, right) = (inside(limit.from, 0.0), inside(limit.up_to, 1.0));
    let y = panel.y.share(limit.y).clamp(0.0, 1.0);
    let end = if limit.is_least { 0.0 } else { 1.0 };
    let corners = [(left, y), (right, y), (right, end), (left, end)];
    let points = corners.iter().map(|(x, y)| plot.at(*x, *y)).collect();
    shapes.push(Shape::Area { points, color: FORBIDDEN, opacity: 0.08 });
    dashed(plot.at(left, y), plot.at(right, y), FORBIDDEN, 1, shapes);
}

/// The front: level until the next better setting, then down, or up where more is better.
fn draw_front(panel: &Panel, plot: Rect, shapes: &mut Vec<Shape>) {
    let mut points: Vec<Place> = Vec::new();
    let start = if panel.more_is_better { plot.bottom } else { plot.top };
    for (time, error) in &panel.front {
        let corner = place(panel, plot, *time, *error);
        let (_, before) = points.last().copied().unwrap_or((0.0, start));
        points.extend([(corner.0, before), corner]);
    }
    if let Some((_, y)) = points.last().copied() {
        points.push((plot.right, y));
        shapes.push(Shape::Line { points, color: FRONT, width: 2 });
    }
}

fn draw_curve(curve: &Curve, panel: &Panel, plot: Rect, shapes: &mut Vec<Shape>) {
    let color = curve.style.color;
    let points: Vec<Place> = curve.marks.iter().map(|mark| place(panel, plot, mark.x, mark.y)).collect();
    if curve.is_joined && points.len() > 1 {
        shapes.push(Shape::Line { points: points.clone(), color, width: 1 });
    }
    for (mark, at) in curve.marks.iter().zip(points) {
        let ends = match mark.whisker {
            Some(Whisker::Across { low, high }) => Some([(low, mark.y), (high, mark.y)]),
            Some(Whisker::Upward { low, high }) => Some([(mark.x, low), (mark.x, high)]),
            None => None,
        };
        if let Some(ends) = ends {
            draw_whisker(ends.map(|(x, y)| place(panel, plot, x, y)), color, shapes);
        }
        marker_shapes(curve.style, at, mark.is_sparse || panel.y.is_on_floor(mark.y), shapes);
    }
}

/// A line between two places, with a bar at each end.
fn draw_whisker([low, high]: [Place; 2], color: [u8; 3], shapes: &mut Vec<Shape>) {
    shapes.push(Shape::Line { points: vec![low, high], color, width: 1 });
    let is_across = low.1 == high.1 && low.0 != high.0;
    let (right, down) = if is_across { (0.0, 4.0) } else { (4.0, 0.0) };
    for (x, y) in [low, high] {
        shapes.push(Shape::Line { points: vec![(x - right, y - down), (x + right, y + down)], color, width: 1 });
    }
}

/// The share of the room of a column that it fills.
const COLUMN_WIDTH: f64 = 0.6;

fn draw_column(column: &Column, panel: &Panel, plot: Rect, shapes: &mut Vec<Shape>) {
    let half = COLUMN_WIDTH / 2.0 / panel.columns.len() as f64;
    let mut low = 0.0;
    let mut whiskers = Vec::new();
    let count = column.layers.len() as f64;
    for (index, layer) in column.layers.iter().enumerate() {
        let high = low + layer.height;
        // Side by side, as those of neighbouring layers overlap.
        let x = column.x + half * ((2 * index + 1) as f64 / count - 1.0);
        let (least, most) = layer.ends;
        whiskers.push([low + least, low + most].map(|end| place(panel, plot, x, end)));
        let corners =
            [(column.x - half, low), (column.x + half, low), (column.x + half, high), (column.x - half, high)];
        let points = corners.iter().map(|(x, y)| place(panel, plot, *x, *y)).collect();
        shapes.push(Shape::Area { points, color: layer.style.color, opacity: 1.0 });
        low = high;
    }
    whiskers.into_iter().for_each(|ends| draw_whisker(ends, FRAME, shapes));
}

/// Hollow marks are on the floor of a logarithmic axis, as their value is zero, or leave much of the mirrors empty.
fn marker_shapes(style: Style, (x, y): Place, is_hollow: bool, shapes: &mut Vec<Shape>) {
    let radius = MARKER_RADIUS;
    let corners: &[(f64, f64)] = match style.marker {
        Marker::Disc => {
            shapes.push(Shape::Disc { center: (x, y), radius, color: style.color, is_filled: !is_hollow });
            return;
        }
        Marker::Cross => &[
            (-0.4, -1.1),
            (0.4, -1.1),
            (0.4, -0.4),
            (1.1, -0.4),
            (1.1, 0.4),
            (0.4, 0.4),
            (0.4, 1.1),
            (-0.4, 1.1),
            (-0.4, 0.4),
            (-1.1, 0.4),
            (-1.1, -0.4),
            (-0.4, -0.4),
        ],
        Marker::Square => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
        Marker::Triangle => &[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)],
        Marker::Diamond => &[(0.0, -1.3), (1.1, 0.0), (0.0, 1.3), (-1.1, 0.0)],
        Marker::Valley => &[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)],
    };
    let mut points: Vec<Place> = corners.iter().map(|(right, down)| (x + right * radius, y + down * radius)).collect();
    if is_hollow {
        points.push(points[0]);
        shapes.push(Shape::Line { points, color: style.color, width: 1 });
    } else {
        shapes.push(Shape::Area { points, color: style.color, opacity: 1.0 });
    }
}

/// Places labels beside their marks, where they hide neither marks nor one another; a label without a place is left
/// out.
fn draw_labels(panel: &Panel, plot: Rect, shapes: &mut Vec<Shape>) {
    let marks = || panel.curves.iter().flat_map(|curve| curve.marks.iter().map(move |mark| (mark, curve.style)));
    let at = |x: f64, y: f64| place(panel, plot, x, y);
    let mut taken: Vec<Rect> =
        marks().map(|(mark, _)| Rect::around(at(mark.x, mark.y), MARKER_RADIUS, MARKER_RADIUS)).collect();
    for (mark, style) in marks().filter(|(mark, _)| !mark.label.is_empty()) {
        let (x, y) = at(mark.x, mark.y);
        let (half_width, half_height) = (width(&mark.label, LABEL_SIZE) / 2.0, LABEL_SIZE * 0.6);
        let (across, down) = (half_width + MARKER_RADIUS + 2.5, half_height + MARKER_RADIUS + 1.5);
        let directions = [
            (1.0, 0.0),
            (-1.0, 0.0),
            (0.0, -1.0),
            (0.0, 1.0),
            (0.9, -0.8),
            (0.9, 0.8),
            (-0.9, -0.8),
            (-0.9, 0.8),
            // A second ring, farther off.
            (0.0, -1.9),
            (0.0, 1.9),
            (1.0, -1.7),
            (1.0, 1.7),
            (-1.0, -1.7),
            (-1.0, 1.7),
        ];
        let boxes = directions
            .map(|(right, below)| Rect::around((x + right * across, y + below * down), half_width, half_height));
        let is_free = |label: &&Rect| plot.contains(label) && !taken.iter().any(|other| other.overlaps(label));
        let free = boxes.iter().find(is_free).copied();
        if let Some(label) = free {
            let center = ((label.left + label.right) / 2.0, (label.top + label.bottom) / 2.0);
            let color = style.color.map(|value| (f64::from(value) * 0.75) as u8);
            // A line connects a label that is far off with its mark.
            let (right, below) = (center.0 - x, center.1 - y);
            if below.abs() > 1.5 * down {
                let end = (x + right * 0.6, y + below - below.signum() * half_height);
                shapes.push(Shape::Line { points: vec![(x, y), end], color: FRONT, width: 1 });
            }
            let (text, anchor) = (mark.label.clone(), Anchor::Middle);
            shapes.push(Shape::Words { at: center, text, size: LABEL_SIZE, color, anchor });
            taken.push(label);
        }
    }
}

fn dashed(from: Place, to: Place, color: [u8; 3], width: u32, shapes: &mut Vec<Shape>) {
    let (right, down) = (to.0 - from.0, to.1 - from.1);
    let length = right.hypot(down);
    let at = |way: f64| (from.0 + right * way / length, from.1 + down * way / length);
    let (dash, gap) = DASHES;
    let mut start = 0.0;
    while start < length {
        let end = f64::min(start + dash, length);
        shapes.push(Shape::Line { points: vec![at(start), at(end)], color, width });
        start = end + gap;
    }
}
