//! Charts of a study: time against error with the Pareto front, and figures over swept values.
//!
//! Times come from at least three rounds, with the least and the most as whiskers, else they are not shown.
//! A chart is first panels of marks (`charts`), then shapes with places (`layout`), then an SVG or PNG (`shapes`).

mod axis;
mod layout;
pub mod shapes;

use std::path::Path;

use scene::{METHODS, RAY_TRACE};

use crate::file_name::file_name;
use crate::plan::{Case, DISTANCE, Group, ORBIT, Plan, SIZE, TARGET};
use crate::results::{self, Figure, METHOD_MS, Row, Spread};
use crate::targets::settings_of;
use axis::Axis;

pub use axis::number;

/// A chart of results.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The file name without extension.
    pub name: String,
    pub title: String,
    panels: Vec<Panel>,
    /// The most panels side by side.
    columns: usize,
    /// What was drawn and where, in lines.
    conditions: Vec<String>,
}

/// One pair of axes.
#[derive(Clone, Debug, PartialEq)]
struct Panel {
    title: String,
    x: Axis,
    y: Axis,
    x_title: String,
    y_title: String,
    curves: Vec<Curve>,
    columns: Vec<Column>,
    /// Values that are constant over the whole width.
    levels: Vec<Level>,
    /// The corners of the Pareto front, by rising time.
    front: Vec<(f64, f64)>,
    more_is_better: bool,
    limit: Option<Limit>,
}

#[derive(Clone, Debug, PartialEq)]
struct Curve {
    /// The name in the legend.
    name: String,
    style: Style,
    is_joined: bool,
    marks: Vec<Mark>,
}

#[derive(Clone, Debug, PartialEq)]
struct Mark {
    x: f64,
    y: f64,
    /// The least and the most of a time, which is x or y.
    whisker: Option<Whisker>,
    label: String,
    /// Whether so little of the mirrors is covered that the error is of a part of them.
    is_sparse: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Whisker {
    Across { low: f64, high: f64 },
    Upward { low: f64, high: f64 },
}

impl Mark {
    /// What it takes of the x axis.
    fn across(&self) -> [f64; 2] {
        match self.whisker {
            Some(Whisker::Across { low, high }) => [low, high],
            _ => [self.x; 2],
        }
    }

    /// What it takes of the y axis.
    fn upward(&self) -> [f64; 2] {
        match self.whisker {
            Some(Whisker::Upward { low, high }) => [low, high],
            _ => [self.y; 2],
        }
    }
}

/// Values on top of one another, the first at the bottom.
#[derive(Clone, Debug, PartialEq)]
struct Column {
    x: f64,
    layers: Vec<Layer>,
}

#[derive(Clone, Debug, PartialEq)]
struct Layer {
    /// The name in the legend.
    name: String,
    style: Style,
    height: f64,
    /// The least and the most of the height.
    ends: (f64, f64),
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    name: String,
    style: Style,
    y: f64,
}

/// The bound of a figure, over a part of the width.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Limit {
    y: f64,
    is_least: bool,
    from: Option<f64>,
    up_to: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Marker {
    Disc,
    Square,
    Triangle,
    Diamond,
    Valley,
    Cross,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Style {
    color: [u8; 3],
    marker: Marker,
}

/// Colours that colour-blind people can distinguish (Okabe and Ito 2008), the yellow darkened for white paper, and a
/// brown and a violet, which are darker than theirs. A method has the same in all charts: they follow the order of
/// `scene::METHODS`, to which methods are only appended.
const METHOD_STYLES: [Style; 11] = [
    Style { color: [120, 120, 120], marker: Marker::Diamond },
    Style { color: [120, 120, 120], marker: Marker::Disc },
    Style { color: [230, 159, 0], marker: Marker::Valley },
    Style { color: [204, 121, 167], marker: Marker::Cross },
    Style { color: [213, 94, 0], marker: Marker::Disc },
    Style { color: [0, 114, 178], marker: Marker::Square },
    Style { color: [0, 158, 115], marker: Marker::Triangle },
    Style { color: [86, 180, 233], marker: Marker::Square },
    Style { color: [190, 175, 30], marker: Marker::Triangle },
    Style { color: [140, 86, 75], marker: Marker::Valley },
    Style { color: [110, 60, 160], marker: Marker::Square },
];
/// The marks that tell combinations of values of one method apart.
const MARKERS: [Marker; 6] =
    [Marker::Disc, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Valley, Marker::Cross];
/// The style of the ray tracer.
const TRUTH_STYLE: Style = Style { color: [0, 0, 0], marker: Marker::Diamond };

/// The colours of scenes and combinations of values.
const OTHER_STYLES: [Style; 8] = [
    Style { color: [0, 114, 178], marker: Marker::Disc },
    Style { color: [213, 94, 0], marker: Marker::Square },
    Style { color: [0, 158, 115], marker: Marker::Triangle },
    Style { color: [204, 121, 167], marker: Marker::Diamond },
    Style { color: [86, 180, 233], marker: Marker::Valley },
    Style { color: [230, 159, 0], marker: Marker::Cross },
    Style { color: [0, 0, 0], marker: Marker::Disc },
    Style { color: [190, 175, 30], marker: Marker::Square },
];

impl Style {
    fn of_method(method: &str) -> Self {
        if method == RAY_TRACE {
            return TRUTH_STYLE;
        }
        let at = METHODS.iter().position(|row| row.name == method).unwrap_or_default();
        METHOD_STYLES[at % METHOD_STYLES.len()]
    }

    /// The style of a combination of values by its number: a mark of its own in the colour of its method, if that must be
    /// told from others.
    fn of_values(index: usize, method: Option<&str>) -> Self {
        let in_color = |method| Self { marker: MARKERS[index % MARKERS.len()], ..Self::of_method(method) };
        method.map_or(OTHER_STYLES[index % OTHER_STYLES.len()], in_color)
    }
}

impl Chart {
    /// The chart as SVG.
    ///
    /// # Errors
    /// None but defects of the drawing.
    pub fn svg(&self) -> anyhow::Result<String> {
        let (shapes, size) = layout::layout(self);
        shapes::svg(&shapes, size)
    }

    /// The chart as PNG.
    ///
    /// # Errors
    /// None but defects of the drawing.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        let (shapes, size) = layout::layout(self);
        shapes::png(&shapes, size)
    }
}

/// The indices of the points that no other one beats in both coordinates, by rising time. Of equal points the first
/// counts.
pub fn pareto(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut best = f64::INFINITY;
    order.retain(|&index| {
        let is_better = points[index].1 < best;
        best = best.min(points[index].1);
        is_better
    });
    order
}

/// The points of [`pareto`], for figures of either direction.
fn front(points: &[(f64, f64)], more_is_better: bool) -> Vec<(f64, f64)> {
    let sign = if more_is_better { -1.0 } else { 1.0 };
    let errors: Vec<(f64, f64)> = points.iter().map(|(time, value)| (*time, sign * value)).collect();
    pareto(&errors).into_iter().map(|index| points[index]).collect()
}

/// A time is shown only if so many rounds measured it: whiskers of fewer say nothing about how far it varies.
const LEAST_ROUNDS: usize = 3;

/// A time of a row, if enough rounds measured it.
fn time_of(row: &Row, time: &str) -> Option<Spread> {
    row.spread(time).filter(|_| row.repeats >= LEAST_ROUNDS)
}

/// A figure's value and whisker; no value of a time that too few rounds measured.
fn value_of(row: &Row, figure: &Figure) -> Option<(f64, Option<Whisker>)> {
    if figure.unit != "ms" {
        return Some((row.value(&figure.name)?, None));
    }
    let Spread { median, low, high } = time_of(row, &figure.name)?;
    Some((median, Some(Whisker::Upward { low, high })))
}

/// All charts of a plan. Settings that failed are left out, times of too few rounds, and charts that
/// would show nothing.
pub fn charts(plan: &Plan, rows: &[Row]) -> Vec<Chart> {
    let rows: Vec<&Row> = rows.iter().filter(|row| row.error.is_none()).collect();
    let figure = |name: &String| plan.figure(name);
    let mut charts: Vec<Chart> =
        plan.errors.iter().filter_map(figure).filter_map(|error| time_chart(plan, &rows, &error)).collect();
    for (index, group) in plan.groups.iter().enumerate() {
        let of_group: Vec<&Row> = rows.iter().copied().filter(|row| row.case.group == index).collect();
        let own = group.bound.iter().map(|bound| &bound.figure).filter(|_| group.figures.is_empty());
        let own: Vec<&String> = group.figures.iter().chain(own).collect();
        let names = if own.is_empty() { plan.figures.iter().collect() } else { own };
        for key in group.sweep.keys() {
            let value = |row: &&Row| row.case.swept_value(key).map(str::to_owned);
            // What stays the same is no axis.
            if distinct(of_group.iter().map(value)).len() == 1 {
                continue;
            }
            let made = names.iter().filter_map(|name| figure(name));
            charts.extend(made.filter_map(|figure| sweep_chart(plan, group, key, &rows, &of_group, &figure)));
        }
        let stacked = group.stacked.iter().enumerate();
        charts.extend(stacked.filter_map(|(number, times)| stacked_chart(plan, group, number, times, &of_group)));
    }
    charts
}

/// A scene's name for people: a file without its folder and extension, a pattern without its variables.
fn short_scene(pattern: &str) -> String {
    let is_file = Path::new(pattern).is_absolute() || pattern.ends_with(".toml");
    let name = if is_file { Path::new(pattern).file_stem().and_then(|stem| stem.to_str()) } else { None };
    let mut short = name.unwrap_or(pattern).to_owned();
    while let Some((before, after)) = short.clone().split_once('{') {
        let rest = after.split_once('}').map_or("", |(_, rest)| rest);
        short = format!("{}{rest}", before.trim_end_matches([':', ',', '=', '-', '_', '/']));
    }
    short
}

/// The names of scenes by `short`, with as many folders before those that would be the same as tell them apart.
fn names_apart(scenes: &[&str], short: impl Fn(&str) -> String) -> Vec<String> {
    let path = |scene: &str| scene.strip_suffix(".toml").unwrap_or(scene).to_owned();
    let name = |scene: &&str| {
        let name = short(scene);
        if scenes.iter().filter(|other| short(other) == name).count() == 1 {
            return name;
        }
        let own = path(scene);
        let is_apart = |end: &&str| {
            let ends = |other: &&&str| path(other) == *end || path(other).ends_with(&format!("/{end}"));
            scenes.iter().filter(ends).count() == 1
        };
        let ends = own.rmatch_indices('/').skip(1).map(|(at, _)| &own[at + 1..]);
        ends.chain([own.as_str()]).find(is_apart).unwrap_or(scene).to_owned()
    };
    scenes.iter().map(name).collect()
}

/// The distinct texts, in the order in which they first occur.
fn distinct<Item: PartialEq>(items: impl Iterator<Item = Item>) -> Vec<Item> {
    let mut found = Vec::new();
    for item in items {
        if !found.contains(&item) {
            found.push(item);
        }
    }
    found
}

/// The swept keys that are no variables of the scene.
fn is_of_setting(key: &str) -> bool {
    key.contains('.') || [SIZE, TARGET, DISTANCE, ORBIT].contains(&key)
}

/// The text that distinguishes settings of one method on one scene: the swept values, else the group if the method
/// occurs in several.
fn label(plan: &Plan, case: &Case) -> String {
    let swept = case.swept.iter().filter(|(key, _)| is_of_setting(key));
    let values: Vec<String> = swept.map(|(_, value)| value.parse().map_or_else(|_| value.clone(), number)).collect();
    let groups = plan.groups.iter().filter(|group| group.methods.contains(&case.method)).count();
    match values.is_empty() {
        true if groups > 1 => plan.groups[case.group].name.clone(),
        _ => values.join(" "),
    }
}

fn time_chart(plan: &Plan, rows: &[&Row], error: &Figure) -> Option<Chart> {
    let (time, more_is_better) = (plan.time.name(), error.more_is_better());
    let mut panels = Vec::new();
    // Different scenes cannot be compared, even those of one variable.
    let scenes = distinct(rows.iter().map(|row| row.case.scene.as_str()));
    for (scene, title) in scenes.iter().zip(names_apart(&scenes, short_scene)) {
        let of_scene = || rows.iter().filter(|row| row.case.scene == *scene);
        let (mut curves, mut levels): (Vec<Curve>, Vec<Level>) = (Vec::new(), Vec::new());
        for row in of_scene() {
            let Some(y) = row.value(&error.name) else { continue };
            let method = &row.case.method;
            let style = Style::of_method(method);
            if method == "none" {
                let level = Level { name: method.clone(), style, y };
                if !levels.contains(&level) {
                    levels.push(level);
                }
                continue;
            }
            let Some(spread) = time_of(row, time).filter(|spread| spread.low > 0.0) else { continue };
            let Spread { median: x, low, high } = spread;
            let swept: Vec<&str> =
                row.case.swept.iter().map(|(key, _)| key.as_str()).filter(|key| is_of_setting(key)).collect();
            let group = &plan.groups[row.case.group];
            let name = if swept.is_empty() { method.clone() } else { format!("{method}: {}", swept.join(", ")) };
            let whisker = Some(Whisker::Across { low, high });
            // Errors of light are those of all surfaces.
            let is_sparse = !error.is_of_light() && is_sparse(row);
            let mark = Mark { x, y, whisker, label: label(plan, &row.case), is_sparse };
            // A sweep of one key is a curve of its own; single settings of a method are joined to one.
            let is_joined = group.sweep.keys().filter(|key| is_of_setting(key)).count() == 1;
            let is_first = swept.first().is_some_and(|key| {
                let first = of_scene().find(|other| other.case.group == row.case.group && other.case.method == *method);
                is_joined && first.is_some_and(|first| first.case.swept_value(key) == row.case.swept_value(key))
            });
            match curves.iter_mut().rev().find(|curve| curve.name == name && curve.is_joined == is_joined && !is_first)
            {
                Some(curve) => curve.marks.push(mark),
                None => curves.push(Curve { name, style, is_joined, marks: vec![mark] }),
            }
        }
        if curves.is_empty() {
            continue;
        }
        let marks = || curves.iter().flat_map(|curve| &curve.marks);
        let times: Vec<f64> = marks().flat_map(Mark::across).collect();
        let errors: Vec<f64> = marks().map(|mark| mark.y).chain(levels.iter().map(|level| level.y)).collect();
        // Pictures of different sizes or numbers of points cannot be compared. Errors but those against the still picture
        // are in the drawn pixels.
        let resolution = |row: &Row| (!error.is_of_still()).then(|| settings_of(row).view.resolution);
        let tasks = distinct(of_scene().map(|row| (row.case.size, row.points, resolution(row))));
        // An error of what is filled says nothing of the rest.
        let is_whole = |mark: &&Mark| !(error.is_of_filled() && mark.is_sparse);
        let whole: Vec<(f64, f64)> = marks().filter(is_whole).map(|mark| (mark.x, mark.y)).collect();
        let front = if tasks.len() > 1 { Vec::new() } else { front(&whole, more_is_better) };
        panels.push(Panel {
            title,
            x: Axis::log(&times),
            y: Axis::of_errors(&errors),
            x_title: results::figure(time).map_or(String::new(), Figure::title),
            y_title: error.title(),
            front,
            more_is_better,
            curves,
            columns: Vec::new(),
            levels,
            limit: None,
        });
    }
    let name = format!("time-{}", file_name(&error.name));
    let direction = if more_is_better { ", upper left is better" } else { "" };
    let title = format!("{}: {} against {}{direction}", plan.title, time_words(time), error.label);
    (!panels.is_empty()).then_some(Chart { name, title, panels, columns: 2, conditions: conditions(rows) })
}

/// A setting that covers less than this share of the mirror pixels has a hollow mark.
const SPARSE: f64 = 0.9;

fn is_sparse(row: &Row) -> bool {
    row.value("closed_coverage").or(row.value("coverage")).is_some_and(|coverage| coverage < SPARSE)
}

/// What the rows of a chart are of: size, points and rounds in one line, adapters and versions in the next.
fn conditions(rows: &[&Row]) -> Vec<String> {
    let range = |numbers: Vec<u64>, unit: &str| {
        let [least, most] = [numbers.iter().min(), numbers.iter().max()].map(|number| number.copied().unwrap_or(0));
        let spaced = |number: u64| {
            let digits = number.to_string();
            let groups: Vec<&str> =
                digits.as_bytes().rchunks(3).rev().filter_map(|part| str::from_utf8(part).ok()).collect();
            groups.join(",")
        };
        let range = if least == most { spaced(most) } else { format!("{} to {}", spaced(least), spaced(most)) };
        (most > 0).then(|| format!("{range} {unit}"))
    };
    let sizes = distinct(rows.iter().map(|row| format!("{}x{}", row.case.size[0], row.case.size[1])));
    let points = range(rows.iter().filter_map(|row| row.points).collect(), "points");
    let rounds = range(rows.iter().map(|row| row.repeats as u64).collect(), "timed rounds");
    let task = [Some(sizes.join(", ")), points, rounds.or(Some("no times".to_owned()))];
    let machines = distinct(rows.iter().map(|row| {
        let machine = &row.machine;
        format!("{}, {} clock, glint {}", machine.adapter, machine.clock, machine.commit)
    }));
    [task.into_iter().flatten().collect::<Vec<_>>().join("; "), machines.join("; ")].into()
}

fn time_words(time: &str) -> &'static str {
    if time == METHOD_MS { "time of the method" } else { "time of the frame" }
}

/// `rows` are those of all groups: groups without a sweep are levels to compare with.
fn sweep_chart(
    plan: &Plan,
    group: &Group,
    key: &str,
    rows: &[&Row],
    of_group: &[&Row],
    figure: &Figure,
) -> Option<Chart> {
    let scenes = distinct(of_group.iter().map(|row| row.case.scene_pattern.as_str()));
    let values = distinct(of_group.iter().filter_map(|row| row.case.swept_value(key)));
    let numbers: Option<Vec<f64>> = values.iter().map(|value| value.parse().ok()).collect();
    let x = match numbers {
        Some(numbers) => Axis::swept(&numbers),
        None => Axis::words(values.iter().map(|value| (*value).to_owned()).collect()),
    };
    let others = |case: &Case| -> Vec<String> {
        let others = case.swept.iter().filter(|(other, _)| other != key);
        others.map(|(other, value)| format!("{other} {value}")).collect()
    };
    let methods = distinct(of_group.iter().map(|row| row.case.method.as_str()));
    let combinations = distinct(of_group.iter().map(|row| others(&row.case)));
    // With one method, scenes are lines of one panel, as in the paper's figures.
    let is_by_scene = methods.len() == 1 && combinations.len() == 1 && scenes.len() > 1 && scenes.len() <= 8;
    let shown: Vec<Vec<&str>> =
        if is_by_scene { vec![scenes.clone()] } else { scenes.iter().map(|scene| vec![*scene]).collect() };
    let names = names_apart(&scenes, short_scene);
    let name_of = |scene: &str| scenes.iter().position(|other| *other == scene).map_or("", |index| &names[index]);
    let mut panels = Vec::new();
    for scenes in &shown {
        let is_level = |row: &&&Row| {
            let is_shown =
                scenes.contains(&row.case.scene_pattern.as_str()) && !methods.contains(&row.case.method.as_str());
            row.case.swept.is_empty() && is_shown && !is_by_scene
        };
        let has_methods = methods.len() > 1 || rows.iter().any(|row| is_level(&row));
        let mut curves: Vec<Curve> = Vec::new();
        for row in of_group.iter().filter(|row| scenes.contains(&row.case.scene_pattern.as_str())) {
            let place = row.case.swept_value(key).and_then(|value| x.value_of(value));
            let Some((x, (y, whisker))) = place.zip(value_of(row, figure)) else { continue };
            let combination = others(&row.case);
            let (name, style) = if is_by_scene {
                let index = scenes.iter().position(|scene| *scene == row.case.scene_pattern).unwrap_or(0);
                (name_of(&row.case.scene_pattern).to_owned(), OTHER_STYLES[index % OTHER_STYLES.len()])
            } else if combinations.len() > 1 {
                let index = combinations.iter().position(|other| *other == combination).unwrap_or(0);
                let in_color = has_methods && combinations.len() <= MARKERS.len();
                let style = Style::of_values(index, in_color.then_some(row.case.method.as_str()));
                (format!("{} {}", row.case.method, combination.join(" ")), style)
            } else {
                (row.case.method.clone(), Style::of_method(&row.case.method))
            };
            let mark = Mark { x, y, whisker, label: String::new(), is_sparse: false };
            match curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) => curve.marks.push(mark),
                None => curves.push(Curve { name, style, is_joined: true, marks: vec![mark] }),
            }
        }
        let level = |row: &&Row| {
            let style = Style::of_method(&row.case.method);
            Some(Level { name: row.case.method.clone(), style, y: value_of(row, figure)?.0 })
        };
        let levels: Vec<Level> = rows.iter().filter(is_level).filter_map(level).collect();
        if curves.is_empty() {
            continue;
        }
        let bound = group.bound.as_ref().filter(|bound| bound.figure == figure.name);
        let limit = bound.and_then(|bound| {
            let (y, is_least) = bound.at_least.map(|y| (y, true)).or(bound.at_most.map(|y| (y, false)))?;
            Some(Limit { y, is_least, from: bound.from, up_to: bound.up_to })
        });
        let marks = curves.iter().flat_map(|curve| &curve.marks);
        let shown =
            marks.flat_map(Mark::upward).chain(levels.iter().map(|level| level.y)).chain(limit.map(|limit| limit.y));
        panels.push(Panel {
            title: if is_by_scene {
                methods.join(", ")
            } else {
                name_of(scenes.first().copied().unwrap_or_default()).to_owned()
            },
            y: Axis::of(&shown.collect::<Vec<_>>()),
            x: x.clone(),
            x_title: key_title(key),
            y_title: figure.title(),
            curves,
            columns: Vec::new(),
            levels,
            front: Vec::new(),
            more_is_better: figure.more_is_better(),
            limit,
        });
    }
    let sharing = plan.groups_sweeping(key).len();
    let prefix = if sharing > 1 { format!("{}-", file_name(&group.name)) } else { String::new() };
    let name = format!("{prefix}{}-{}", file_name(key), file_name(&figure.name));
    let about = if plan.groups.len() > 1 && sharing > 1 { format!("{}: ", group.name) } else { String::new() };
    let title = format!("{about}{} over {}", figure.label, key_words(key));
    let columns = if panels.len() > 4 { 3 } else { 2 };
    (!panels.is_empty()).then_some(Chart { name, title, panels, columns, conditions: conditions(of_group) })
}

/// The times of a group's settings, a column for each setting.
fn stacked_chart(plan: &Plan, group: &Group, number: usize, times: &[String], of_group: &[&Row]) -> Option<Chart> {
    let scenes = distinct(of_group.iter().map(|row| row.case.scene.as_str()));
    let scene_names = names_apart(&scenes, |scene| last_part(scene).to_owned());
    let name_of = |scene: &str| scenes.iter().position(|other| *other == scene).map_or("", |index| &scene_names[index]);
    let has_scenes = scenes.len() > 1;
    let named = |row: &&&Row| {
        let Case { scene, method, swept, .. } = &row.case;
        // A variable is part of the scene.
        let swept = swept.iter().filter(|(key, _)| is_of_setting(key)).map(|(_, value)| value.as_str());
        let own = [has_scenes.then(|| name_of(scene)), (group.methods.len() > 1).then_some(method.as_str())];
        own.into_iter().flatten().chain(swept).collect::<Vec<_>>().join(" ")
    };
    let names: Vec<String> = of_group.iter().map(|row| named(&row)).collect();
    let x = Axis::words(names.clone());
    let figures: Vec<Figure> = times.iter().filter_map(|time| plan.figure(time)).collect();
    let column = |(row, name): (&&Row, &String)| {
        let layer = |(figure, style): (&Figure, &Style)| {
            let Spread { median: height, low, high } = time_of(row, &figure.name)?;
            let name = figure.label.strip_prefix("time of ").unwrap_or(&figure.label).to_owned();
            Some(Layer { name, style: *style, height, ends: (low, high) })
        };
        let layers: Vec<Layer> = figures.iter().zip(OTHER_STYLES.iter().cycle()).filter_map(layer).collect();
        Some(Column { x: x.value_of(name)?, layers }).filter(|column| !column.layers.is_empty())
    };
    let columns: Vec<Column> = of_group.iter().zip(&names).filter_map(column).collect();
    // The whisker of a layer starts where the layers below it end.
    let most_of = |column: &Column| {
        let mut below = 0.0;
        column.layers.iter().fold(0.0, |most: f64, layer| {
            let end = below + layer.ends.1;
            below += layer.height;
            most.max(end)
        })
    };
    let most = columns.iter().map(most_of).fold(0.0, f64::max);
    let panel = Panel {
        title: if has_scenes || group.methods.len() > 1 { String::new() } else { group.name.clone() },
        x,
        y: Axis::of(&[0.0, most]),
        x_title: String::new(),
        y_title: "time [ms]".into(),
        curves: Vec::new(),
        columns,
        levels: Vec::new(),
        front: Vec::new(),
        more_is_better: false,
        limit: None,
    };
    let suffix = if number > 0 { format!("-{}", number + 1) } else { String::new() };
    let name = format!("stacked-{}{suffix}", file_name(&group.name));
    let title = format!("{}: times of the passes", group.name);
    (!panel.columns.is_empty()).then_some(Chart {
        name,
        title,
        panels: vec![panel],
        columns: 2,
        conditions: conditions(of_group),
    })
}

/// The last part of a scene's name or path, without its extension.
fn last_part(scene: &str) -> &str {
    let name = scene.rsplit('/').next().unwrap_or(scene);
    name.strip_suffix(".toml").unwrap_or(name)
}

fn key_words(key: &str) -> &str {
    if key == SIZE { "size of the picture" } else { key }
}

/// The key with the parameter's unit.
fn key_title(key: &str) -> String {
    let settings = scene::Settings::default();
    let groups = settings.groups();
    let unit = key.split_once('.').and_then(|(group, name)| {
        let table = groups.iter().find(|params| params.group().name == group)?.group();
        table.fields.iter().find(|field| field.name == name).map(|field| field.unit)
    });
    match unit.filter(|unit| !unit.is_empty()) {
        Some(unit) => format!("{key} [{unit}]"),
        None if key == SIZE => "size of the picture [pixels]".to_owned(),
        None if key == ORBIT => "turn of the camera [degrees a frame]".to_owned(),
        None if key == DISTANCE => "distance of the camera [share of the scene's]".to_owned(),
        None => key.to_owned(),
    }
}

#[cfg(test)]
mod tests;
