//! Measurements and notes in the window: their points are clicked one after the other and snap to points of the clouds,
//! and their values are computed on a worker thread whenever the points or what is shown of them have changed.

use std::collections::HashMap;

use cloud::{Placement, PointTest};
use codec::Units;
use glam::DVec3;
use scene::{Camera, Measurement, MeasurementKind, Note, Object, Profile, Strays};
use serde_json::json;
use world::CloudKey;

use crate::shared::language::{text, translated};
use crate::shared::measuring::{Figure, Outcome, are_of_loaded, of_corners};
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::{ObjectId, PlacedMeasurement};
use crate::viewer::picture::messages::PickPurpose;
use crate::viewer::requests::action::Measuring;
use crate::viewer::requests::outside::{Effect, Outside};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

/// The radius around a click, in pixels, of the points that a plane or a cylinder is fitted to.
const REACH_PIXELS: f64 = 16.0;
/// The thickness of a new profile, as a share of its length.
const PROFILE_WIDTH: f64 = 0.02;
/// How much wider than a measurement the picture is after flying to it.
const ROOM: f64 = 1.6;
/// The least width of that picture, as a share of the scene's radius.
const LEAST_ROOM: f64 = 0.02;
/// The colours of new measurements, as on the screen, one after the other.
const COLORS: [[f32; 3]; 6] =
    [[1.0, 0.76, 0.28], [0.35, 0.85, 1.0], [0.6, 0.95, 0.45], [1.0, 0.5, 0.75], [0.75, 0.65, 1.0], [1.0, 0.55, 0.35]];

/// What is being placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    Measurement(MeasurementKind),
    Note,
    Profile,
}

/// A measurement whose points are being clicked, or a note whose place is.
pub struct Placing {
    pub wanted: Wanted,
    pub corners: Vec<DVec3>,
    /// The reach of a fit, known with the first corner.
    pub reach: Option<f64>,
    /// How many clicks the render thread has not answered yet.
    asked: usize,
    /// Whether it ends with the last answer.
    is_ending: bool,
}

/// What decides the values of all measurements, besides themselves: the clouds and how many of their points are loaded,
/// and which points are shown.
#[derive(Clone, Default, PartialEq)]
struct Basis {
    clouds: Vec<(CloudKey, u64, Option<Placement>)>,
    test: PointTest,
}

/// The values of a measurement, and what they are of.
struct Known {
    measurement: Measurement,
    is_current: bool,
    figures: Outcome,
}

#[derive(Default)]
pub struct Measurements {
    pub placing: Option<Placing>,
    pub last_kind: MeasurementKind,
    known: HashMap<ObjectId, Known>,
    basis: Basis,
    /// The measurement whose values are being computed.
    under_way: Option<ObjectId>,
}

impl Wanted {
    pub fn name(self) -> &'static str {
        match self {
            Self::Measurement(kind) => translated(kind.name()),
            Self::Note => text!("note"),
            Self::Profile => text!("profile"),
        }
    }

    /// The kind of measurement as which its corners are drawn.
    pub fn drawn_as(self) -> Option<MeasurementKind> {
        match self {
            Self::Measurement(kind) => Some(kind),
            Self::Profile => Some(MeasurementKind::Polyline),
            Self::Note => None,
        }
    }

    fn counts(self) -> std::ops::RangeInclusive<usize> {
        match self {
            Self::Measurement(kind) => kind.corners(),
            Self::Note => 1..=1,
            Self::Profile => MeasurementKind::Polyline.corners(),
        }
    }
}

impl Placing {
    fn new(wanted: Wanted) -> Self {
        Self { wanted, corners: Vec::new(), reach: None, asked: 0, is_ending: false }
    }

    /// Whether a click has given it a point, or is about to.
    pub fn has_begun(&self) -> bool {
        self.asked > 0 || !self.corners.is_empty()
    }

    /// What all its clicks do, and how to end: the message of its beginning stays while points are clicked.
    fn opening(&self) -> String {
        let (least, most) = self.wanted.counts().into_inner();
        match (self.wanted.name(), least) {
            (name, 1) if most == 1 => text!("{name}: click a point", name),
            (name, count) if most == count => text!("{name}: click {count} points", name, count),
            (name, _) => text!("{name}: click its points; Enter or a double-click ends", name),
        }
    }

    /// What the next click does, and how to end.
    pub fn hint(&self) -> String {
        let (least, most) = self.wanted.counts().into_inner();
        let (name, count) = (self.wanted.name(), self.corners.len());
        let corner = match self.wanted {
            Wanted::Measurement(MeasurementKind::Angle) if count == 1 => text!("the corner of the angle").into(),
            _ if most == 1 => text!("a point").into(),
            _ if most <= 3 => text!("point {count} of {most}", count = count + 1, most),
            _ => text!("point {count}", count = count + 1),
        };
        let end = if most > 3 && count >= least { text!("; Enter or a double-click ends") } else { "" };
        text!("{name}: click {corner}{end}", name, corner, end)
    }

    /// The values with the point under the cursor as the next corner.
    pub fn live(&self, hovered: Option<DVec3>, up: DVec3) -> Vec<Figure> {
        let Some(kind) = self.wanted.drawn_as() else { return Vec::new() };
        let corners: Vec<DVec3> = self.corners.iter().copied().chain(hovered).collect();
        of_corners(kind, &corners, up)
    }
}

/// A measurement without what does not change its values.
fn essence(measurement: &Measurement) -> Measurement {
    Measurement { name: String::new(), on: true, color: [0.0; 3], ..measurement.clone() }
}

/// The units of the clouds' coordinates; none where they differ.
pub fn units(loaded: &Loaded) -> Units {
    Units::in_common(loaded.clouds.iter().map(|entry| entry.units))
}

impl Measurements {
    /// The values of a measurement, once they are known.
    pub fn figures(&self, id: ObjectId) -> Option<&Outcome> {
        self.known.get(&id).map(|known| &known.figures)
    }

    /// Whether a value that is drawn is of loaded points, where the cloud has more.
    pub fn are_of_loaded(&self, scene: &Scene) -> bool {
        let mut drawn = scene.objects.measurements.iter().filter(|placed| placed.measurement.on);
        drawn.any(|placed| matches!(self.figures(placed.id), Some(Ok(figures)) if are_of_loaded(figures)))
    }

    /// Whether the values of all measurements that are drawn are known for what is shown now, after a `sync`.
    pub fn are_known(&self, scene: &Scene) -> bool {
        let mut drawn = scene.objects.measurements.iter().filter(|placed| placed.measurement.on);
        drawn.all(|placed| self.is_known(placed.id, &placed.measurement))
    }

    fn is_known(&self, id: ObjectId, measurement: &Measurement) -> bool {
        self.known.get(&id).is_some_and(|known| known.is_current && known.measurement == essence(measurement))
    }
}

impl Measurements {
    pub fn act(&mut self, measuring: Measuring, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        match measuring {
            Measuring::Begin(kind) => self.begin_placing(Wanted::Measurement(kind), loaded, outside),
            Measuring::Again => {
                let kind = self.last_kind;
                self.begin_placing(Wanted::Measurement(kind), loaded, outside);
            }
            Measuring::BeginNote => self.begin_placing(Wanted::Note, loaded, outside),
            Measuring::BeginProfile => self.begin_placing(Wanted::Profile, loaded, outside),
            Measuring::RemoveCorner => {
                if let Some(placing) = &mut self.placing
                    && placing.corners.pop().is_some()
                {
                    outside.log(json!({ "event": "corner", "corners": placing.corners.len() }));
                }
            }
            Measuring::End => {
                if let Some(placing) = &mut self.placing {
                    placing.is_ending = true;
                    self.end_placing(scene, outside);
                }
            }
            Measuring::FlyTo(id) => fly_to(id, scene, loaded, outside),
            Measuring::StepNote(step) => step_note(step, scene, loaded, outside),
            Measuring::CopyAll => {
                outside.push(Effect::Copy(self.as_text(scene, loaded)));
                outside.note(text!("Measurements copied"));
            }
        }
    }

    fn begin_placing(&mut self, wanted: Wanted, loaded: &Loaded, outside: &mut Outside) {
        let before = self.placing.take();
        if before.is_some_and(|before| before.wanted == wanted) || loaded.clouds.is_empty() {
            return;
        }
        if let Wanted::Measurement(kind) = wanted {
            self.last_kind = kind;
        }
        let placing = Placing::new(wanted);
        outside.note(placing.opening());
        outside.log(json!({ "event": "placing", "kind": wanted.name() }));
        self.placing = Some(placing);
    }

    /// Asks for the point under the cursor, which will be the next corner.
    pub fn ask_corner(&mut self, scene: &Scene, outside: &mut Outside) {
        let Some(placing) = self.placing.as_mut().filter(|_| scene.cursor().is_some()) else { return };
        placing.asked += 1;
        scene.pick_under_cursor(PickPurpose::Corner, outside);
    }

    /// Takes the point that was clicked. `has_mirror` says that a mirror stands in front of it.
    pub fn on_corner(&mut self, found: Option<DVec3>, has_mirror: bool, scene: &mut Scene, outside: &mut Outside) {
        let Some(placing) = &mut self.placing else { return };
        placing.asked = placing.asked.saturating_sub(1);
        let most = *placing.wanted.counts().end();
        match found.filter(|_| !has_mirror) {
            Some(_) if placing.corners.len() >= most => {}
            Some(world) => {
                if matches!(placing.wanted, Wanted::Measurement(kind) if kind.has_reach()) && placing.reach.is_none() {
                    placing.reach = scene.lens().units_per_pixel(world).map(|units| units * REACH_PIXELS);
                }
                placing.corners.push(world);
                outside.log(json!({ "event": "corner", "corners": placing.corners.len(), "world": world.to_array() }));
                placing.is_ending |= placing.corners.len() == most;
            }
            None => {
                let text = if has_mirror {
                    text!("That is a mirror: click on a point of a cloud")
                } else {
                    text!("A gap: there is no point there; click on a point")
                };
                outside.note(text);
                outside.log(json!({ "event": "gap", "mirror": has_mirror }));
            }
        }
        self.end_placing(scene, outside);
    }

    /// Makes what was placed an object of the scene, if it is to end and no click is unanswered.
    fn end_placing(&mut self, scene: &mut Scene, outside: &mut Outside) {
        let Some(placing) = self.placing.as_mut().filter(|one| one.is_ending && one.asked == 0) else {
            return;
        };
        placing.is_ending = false;
        let least = *placing.wanted.counts().start();
        if placing.corners.len() < least {
            let hint = placing.hint();
            return outside.note(match least {
                1 => hint.to_string(),
                _ => text!("{hint}; {least} are needed", hint, least),
            });
        }
        let Some(Placing { wanted, corners, reach, .. }) = self.placing.take() else { return };
        let object = match wanted {
            Wanted::Note => Object::Note(Note::new(String::new(), corners[0], scene.camera)),
            Wanted::Profile => {
                let length: f64 = corners.windows(2).map(|ends| ends[0].distance(ends[1])).sum();
                Object::Profile(Profile::new(corners, (length * PROFILE_WIDTH).max(1e-9)))
            }
            Wanted::Measurement(kind) => Object::Measurement(Measurement {
                name: String::new(),
                kind,
                on: true,
                color: COLORS[scene.objects.measurements.len() % COLORS.len()],
                points: corners,
                reach,
                level: None,
            }),
        };
        let id = scene.next_object_id();
        scene.place(id, object, outside);
    }

    /// Asks for the values of the next measurement whose values are not known for what is shown now.
    pub fn sync(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        let placed = &scene.objects.measurements;
        self.known.retain(|id, _| placed.iter().any(|placed| placed.id == *id));
        if placed.is_empty() || self.under_way.is_some() || loaded.points_come() {
            return;
        }
        let visible = || loaded.clouds.iter().filter(|entry| entry.is_visible);
        let clouds = visible().map(|entry| (entry.key, entry.cloud.len(), entry.placement())).collect();
        let test = scene.objects.test().hiding_strays(scene.settings.splat.strays == Strays::Hidden);
        let basis = Basis { clouds, test };
        if basis != self.basis {
            self.known.values_mut().for_each(|known| known.is_current = false);
            self.basis = basis;
        }
        let is_known = |placed: &&PlacedMeasurement| self.is_known(placed.id, &placed.measurement);
        let Some(next) = placed.iter().find(|placed| !is_known(placed)) else { return };
        self.under_way = Some(next.id);
        let with_parts = |entry: &CloudEntry| (entry.cloud.clone(), entry.loaded_parts());
        outside.work(Work::Measure {
            id: next.id,
            measurement: essence(&next.measurement),
            up: scene.up(&loaded.clouds),
            clouds: visible().map(with_parts).collect(),
            test: self.basis.test.clone(),
        });
    }

    pub fn on_measured(
        &mut self,
        id: ObjectId,
        measurement: Measurement,
        figures: Outcome,
        scene: &Scene,
        outside: &mut Outside,
    ) {
        self.under_way = None;
        let Some(placed) = scene.objects.measurements.iter().find(|placed| placed.id == id) else { return };
        let values: Vec<serde_json::Value> = figures
            .iter()
            .flatten()
            .map(|figure| {
                let Figure { name, value, deviation, .. } = figure;
                json!({ "name": name, "value": value, "uncertainty": deviation, "interval": figure.interval() })
            })
            .collect();
        let Measurement { name, kind, .. } = &placed.measurement;
        outside.log(json!({
            "event": "measured", "name": name, "kind": kind.name(), "values": values, "error": figures.as_ref().err(),
        }));
        self.known.insert(id, Known { measurement, is_current: true, figures });
    }

    /// All values, as tab-separated lines.
    pub fn as_text(&self, scene: &Scene, loaded: &Loaded) -> String {
        let units = units(loaded);
        let line = |id: ObjectId, measurement: &Measurement| {
            let Measurement { name, kind, .. } = measurement;
            let values = match self.figures(id) {
                None => String::new(),
                Some(Err(problem)) => problem.clone(),
                Some(Ok(figures)) => {
                    let value = |figure: &Figure| format!("{}\t{}", translated(figure.name), figure.text(&units));
                    figures.iter().map(value).collect::<Vec<_>>().join("\t")
                }
            };
            format!("{name}\t{}\t{values}\n", kind.name())
        };
        scene.objects.measurements.iter().map(|placed| line(placed.id, &placed.measurement)).collect()
    }
}

/// Moves the camera to a measurement, as far as it is seen as a whole, or to the view of a note.
fn fly_to(id: ObjectId, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
    let Some((_, object)) = scene.objects.get(id) else { return };
    let places = match &object {
        Object::Measurement(measurement) => measurement.points.clone(),
        Object::Note(Note { camera: Some(Camera { eye, pivot, up }), .. }) => {
            let camera = Camera::from_eye(*eye, *pivot, *up);
            scene.jump(outside.now, scene.settings.clone(), camera);
            scene.selected = Some(id);
            return;
        }
        Object::Note(note) => vec![note.position],
        Object::Profile(profile) => profile.line.clone(),
        _ => return,
    };
    let middle = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    let least = scene.bounds(&loaded.clouds).radius() * LEAST_ROOM;
    let radius = places.iter().map(|place| place.distance(middle)).fold(least, f64::max);
    let tangent = (f64::from(scene.settings.view.field_of_view).to_radians() * 0.5).tan();
    let distance = radius * ROOM / (tangent * scene.aspect().min(1.0)).max(1e-6);
    let camera = Camera::looking(middle, -scene.camera.forward(), distance.max(f64::MIN_POSITIVE), scene.camera.up);
    scene.jump(outside.now, scene.settings.clone(), camera);
    scene.selected = Some(id);
}

/// Goes to the next note, or to the one before (-1), in the order of the list.
fn step_note(step: i32, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
    let notes = &scene.objects.notes;
    let Some(last) = notes.len().checked_sub(1) else { return outside.note(text!("There are no notes")) };
    let now = notes.iter().position(|placed| scene.selected == Some(placed.id));
    let next = match now {
        Some(now) if step < 0 => now.checked_sub(1).unwrap_or(last),
        Some(now) => {
            if now == last {
                0
            } else {
                now + 1
            }
        }
        None if step < 0 => last,
        None => 0,
    };
    let id = notes[next].id;
    outside.log(json!({ "event": "note_shown", "text": notes[next].note.text, "number": next + 1 }));
    fly_to(id, scene, loaded, outside);
}
