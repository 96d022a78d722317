//! What is drawn over the picture to read it by: a scale bar, the colour legend, an arrow to the north, the axes, and
//! the labels of measurements and notes, and the captions and the wipe of a path. One code draws them in the window, in saved
//! pictures and in films.

pub mod canvas;
mod captions;
mod directions;
pub mod ground;
pub mod labels;
pub mod legend;
pub mod lens;
mod scale_bar;
mod wipe;

use std::path::{Component, Path};

use codec::Units;
use egui::{Painter, Pos2, Rect, pos2, vec2};
use glam::DVec3;
use render::ColorPlan;
use scene::{Camera, Caption, Overlay, Projection, Settings, WipeMarks};

use crate::overlays::lens::Lens;
use crate::shared::language::text;
use directions::{axes, north, north_arrow};
use labels::Mark;
use legend::{Legend, Room};
use scale_bar::ScaleBar;

/// The longest scale bar, as a share of the picture's width, and in heights of the text.
const LONGEST_BAR: [f32; 2] = [0.3, 18.0];
/// The length of the axes and half that of the arrow to the north, in heights of the text.
const REACH: f32 = 2.6;
/// The height of the corner that the arrow to the north takes, and the width of that of the axes, in lengths of the axes.
const ARROW: f32 = 2.4;
const AXES: f32 = 2.8;
/// The most legends side by side: of clouds that are coloured in different ways.
const MOST_LEGENDS: usize = 3;

/// What overlays tell, besides what follows from the camera.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// The units that all clouds have in common.
    pub units: Units,
    pub up: DVec3,
    /// Each with the clouds whose colours it explains.
    legends: Vec<(Legend, Vec<Named>)>,
    pub marks: Vec<Mark>,
    pub captions: Vec<Caption>,
    pub wipe: Option<WipeMarks>,
}

/// The name of a cloud, and the input that it comes from.
#[derive(Clone, Debug, PartialEq)]
struct Named {
    name: String,
    input: String,
}

impl Named {
    /// The name, behind as many folders of the input as tell it from clouds of the same name.
    fn apart_from<'a>(&self, others: impl Iterator<Item = &'a Self>) -> String {
        let folders = |input: &str| -> Vec<String> {
            // EPT is named like the folder of its file.
            let parent = Path::new(input).parent();
            let is_of_file = parent.and_then(Path::file_name) != Some(self.name.as_ref());
            let parent = if is_of_file { parent } else { parent.and_then(Path::parent) };
            let parts = parent.into_iter().flat_map(Path::components);
            let folders = parts.filter(|part| matches!(part, Component::Normal(_) | Component::ParentDir));
            let mut folders: Vec<String> =
                folders.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect();
            folders.reverse();
            folders
        };
        let own = folders(&self.input);
        let in_common = |other: &Self| {
            let both = own.iter().zip(folders(&other.input));
            both.take_while(|(own, other)| *own == other).count()
        };
        let namesakes = others.filter(|other| other.name == self.name && other.input != self.input);
        let count = namesakes.map(|other| in_common(other) + 1).max().unwrap_or(0).min(own.len());
        let mut parts: Vec<&str> = own[..count].iter().map(String::as_str).collect();
        parts.reverse();
        parts.push(&self.name);
        parts.join("/")
    }
}

impl Facts {
    pub fn new(units: Units, up: DVec3) -> Self {
        Self { units, up, legends: Vec::new(), marks: Vec::new(), captions: Vec::new(), wipe: None }
    }

    /// Takes out what lies over all states of a wipe: its captions, lines and names.
    pub fn take_titles(&mut self) -> Self {
        let (captions, wipe) = (std::mem::take(&mut self.captions), self.wipe.take());
        Self { captions, wipe, ..Self::new(self.units, self.up) }
    }

    /// Adds the legend of the colours of a cloud of an input, unless another cloud has the same. `classes` are those that
    /// are shown.
    pub fn add_legend(
        &mut self,
        cloud: &str,
        input: &str,
        plan: &ColorPlan,
        units: &Units,
        classes: impl Iterator<Item = u8>,
    ) {
        let Some(legend) = Legend::of(plan, units, classes) else { return };
        let cloud = Named { name: cloud.to_owned(), input: input.to_owned() };
        match self.legends.iter_mut().find(|(known, _)| *known == legend) {
            Some((_, clouds)) => clouds.push(cloud),
            None => self.legends.push((legend, vec![cloud])),
        }
    }

    /// The legends that are drawn. Those of one title say whose they are: equal colours have different values there.
    fn shown_legends(&self) -> impl Iterator<Item = Legend> {
        self.legends.iter().take(MOST_LEGENDS).map(|(legend, clouds)| {
            let namesakes = self.legends.iter().filter(|(other, _)| other.title == legend.title);
            let is_alone = namesakes.count() <= 1;
            let all = self.legends.iter().flat_map(|(_, clouds)| clouds);
            let title = match clouds.first().filter(|_| !is_alone) {
                Some(first) => legend.title_with(&first.apart_from(all), clouds.len()),
                None => legend.title.clone(),
            };
            Legend { title, ..legend.clone() }
        })
    }
}

/// Whether a parameter asks for anything over a picture that is saved.
fn are_any(overlay: &Overlay) -> bool {
    overlay.scale_bar || overlay.legend || overlay.north || overlay.axes || overlay.labels
}

/// Draws all that is switched on, and the captions and the wipe, over a picture in memory: rows of sRGB red, green, blue and
/// opacity.
pub fn draw(rgba: &mut [u8], size: [u32; 2], camera: &Camera, settings: &Settings, facts: &Facts) {
    if !are_any(&settings.overlay) && facts.captions.is_empty() && facts.wipe.is_none() {
        return;
    }
    let lens = Lens::new(camera, &settings.view, size);
    canvas::draw(rgba, size, |painter, rect| {
        if settings.overlay.labels {
            let place = |world: DVec3| lens.project(world).map(|pixel| pos2(pixel.x as f32, pixel.y as f32));
            paint_marks(painter, &place, settings, facts);
        }
        paint(painter, rect, camera, size, settings, facts);
    });
}

/// Draws the measurements and notes.
pub fn paint_marks(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, settings: &Settings, facts: &Facts) {
    labels::paint_all(&facts.marks, painter, place, settings.overlay.text);
}

/// Draws scale bar, legend, arrow, axes, captions and a wipe's marks over a picture of `pixels` that fills `rect`.
pub fn paint(painter: &Painter, rect: Rect, camera: &Camera, pixels: [u32; 2], settings: &Settings, facts: &Facts) {
    let (overlay, size) = (&settings.overlay, settings.overlay.text);
    let rows = camera.view_from_world();
    let area = rect.shrink(size * 0.8);
    let mut corner = area.left_bottom();
    if overlay.scale_bar {
        let (bar, text) = bar(rect, camera, pixels, settings, facts);
        scale_bar::paint(painter, corner, bar, &text, size);
        corner.y -= size * 3.6;
    }
    if overlay.axes {
        let reach = REACH * size;
        axes(painter, corner + vec2(reach * 1.3, -reach * 1.3), reach, &rows, size);
    }
    let mut top = area.top();
    if let (true, Some(north)) = (overlay.north, north(&facts.units, facts.up)) {
        let reach = REACH * size * 0.7;
        north_arrow(painter, area.right_top() + vec2(-reach * 1.6, reach * 1.6), reach, &rows, north, size);
        top += REACH * size * ARROW;
    }
    // Levels of pages have a legend of their own in the window's panel.
    if overlay.legend && !settings.stream.overlay {
        // Further columns stand above the scale bar and beside the axes.
        let left = area.left() + if overlay.axes { REACH * size * AXES } else { 0.0 };
        let legends: Vec<Legend> = facts.shown_legends().collect();
        let room = Room { area, top, left, bottom: corner.y };
        legend::paint_all(&legends, facts.legends.len(), painter, room, size);
    }
    let top = facts.wipe.as_ref().map_or(rect.top(), |marks| wipe::paint(painter, rect, marks));
    captions::paint(painter, rect, top, &facts.captions);
}

/// The scale bar and its text. Where coordinates have no unit in common, the text says so, and there is no bar.
fn bar(
    rect: Rect,
    camera: &Camera,
    pixels: [u32; 2],
    settings: &Settings,
    facts: &Facts,
) -> (Option<ScaleBar>, String) {
    if facts.units.are_mixed() {
        return (None, text!("no scale: the coordinates have no unit of length in common").into());
    }
    let lens = Lens::new(camera, &settings.view, pixels);
    let pixels_per_point = f64::from(pixels[0]) / f64::from(rect.width().max(1.0));
    let scale = lens.units_per_pixel(camera.pivot).map(|units| units * pixels_per_point);
    let most = (rect.width() * LONGEST_BAR[0]).min(settings.overlay.text * LONGEST_BAR[1]);
    let bar = scale.and_then(|scale| ScaleBar::fitting(scale, f64::from(most)));
    let is_parallel = settings.view.projection == Projection::Orthographic;
    (bar, bar.map_or(text!("no scale").into(), |bar| bar.text(&facts.units, is_parallel)))
}

#[cfg(test)]
mod tests {
    use codec::Unit;
    use render::ColorSource;
    use scene::StandardView;

    use super::*;

    const SIZE: [u32; 2] = [400, 300];

    fn picture(change: impl Fn(&mut Overlay)) -> Vec<u8> {
        let mut settings = Settings::default();
        change(&mut settings.overlay);
        let camera = Camera::framing(&[DVec3::ZERO, DVec3::ONE], StandardView::Top, DVec3::Z, 60.0, 4.0 / 3.0);
        let facts =
            Facts { units: Units { level: Some(Unit::Metre), height: None }, ..Facts::new(Units::default(), DVec3::Z) };
        let mut rgba = vec![90; (SIZE[0] * SIZE[1] * 4) as usize];
        draw(&mut rgba, SIZE, &camera, &settings, &facts);
        rgba
    }

    #[test]
    fn legends_of_one_title_name_their_clouds() {
        let titles = |ranges: &[(&str, f64)]| {
            let mut facts = Facts::new(Units::default(), DVec3::Z);
            for (input, high) in ranges {
                let cloud = input.trim_end_matches("/ept.json").rsplit('/').next().unwrap();
                let (source, label, ramp) = (ColorSource::Height, "height".into(), scene::Ramp::Viridis);
                let (low, high, full_range) = (0.0, *high, (0.0, *high));
                let plan = ColorPlan { source, label, ramp, plain: [1; 4], low, high, full_range };
                facts.add_legend(cloud, input, &plan, &Units::default(), std::iter::empty());
            }
            facts.shown_legends().map(|legend| legend.title).collect::<Vec<_>>()
        };
        assert_eq!(titles(&[("a.laz", 5.0), ("b.laz", 5.0)]), ["height"]);
        let several = titles(&[("a.laz", 5.0), ("b.laz", 7.0), ("c.laz", 5.0)]);
        assert_eq!(several, ["height, a.laz and 1 more", "height, b.laz"]);
        // Clouds of one name are told apart by their folders.
        let namesakes = titles(&[("/scans/may/a.laz", 5.0), ("/scans/june/a.laz", 7.0), ("/scans/june/b.laz", 8.0)]);
        assert_eq!(namesakes, ["height, may/a.laz", "height, june/a.laz", "height, b.laz"]);
        let namesakes = titles(&[("may/1/a.laz", 5.0), ("june/1/a.laz", 7.0), ("a.laz", 8.0)]);
        assert_eq!(namesakes, ["height, may/1/a.laz", "height, june/1/a.laz", "height, a.laz"]);
        let namesakes = titles(&[("a/x.laz", 5.0), ("../a/x.laz", 7.0)]);
        assert_eq!(namesakes, ["height, a/x.laz", "height, ../a/x.laz"]);
        let namesakes = titles(&[("e1/f/ept.json", 5.0), ("e2/f/ept.json", 7.0)]);
        assert_eq!(namesakes, ["height, e1/f", "height, e2/f"]);
    }

    #[test]
    fn a_picture_without_overlays_stays_as_it_is_and_each_overlay_has_a_place_of_its_own() {
        let plain = picture(|_| {});
        assert!(plain.iter().all(|byte| *byte == 90), "off by default");
        let changed = |picture: &[u8]| -> Vec<bool> {
            picture.chunks_exact(4).map(|pixel| pixel[..3].iter().any(|byte| *byte != 90)).collect()
        };
        let parts =
            [changed(&picture(|overlay| overlay.axes = true)), changed(&picture(|overlay| overlay.north = true))];
        assert!(parts.iter().all(|part| part.iter().filter(|changed| **changed).count() > 100));
        assert!(!parts[0].iter().zip(&parts[1]).any(|(a, b)| *a && *b));
        let both = picture(|overlay| (overlay.axes, overlay.north) = (true, true));
        let joined: Vec<bool> = parts[0].iter().zip(&parts[1]).map(|(a, b)| *a || *b).collect();
        assert_eq!(changed(&both), joined);
        assert!(changed(&picture(|overlay| overlay.scale_bar = true)).iter().filter(|changed| **changed).count() > 500);
        // Larger text makes all of it larger.
        let large = changed(&picture(|overlay| (overlay.axes, overlay.text) = (true, 26.0)));
        let count = |part: &[bool]| part.iter().filter(|changed| **changed).count() as f32;
        assert!((2.5..5.0).contains(&(count(&large) / count(&parts[0]))), "{}", count(&large) / count(&parts[0]));
    }
}
