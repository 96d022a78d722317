//! Undo and redo of parameters, objects and camera jumps. A drag of a slider or of the gizmo is one step: a
//! step ends when no button is down and nothing has changed for a moment.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use scene::{Camera, CloudSettings, Object, Settings};

use crate::shared::language::{text, translated};
use crate::viewer::objects::clouds::short_name;
use crate::viewer::objects::{ObjectId, Objects};

/// Which of the states that there were the present one is: parameters and objects are the same where the numbers are.
/// What files bring changes no number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    pub settings: u64,
    pub objects: u64,
    /// The objects without what only says how clouds look (`Objects::made`).
    pub made: u64,
}

/// The state before a step. `camera` is set only if the step made the camera jump (frame all, standard views, paste).
#[derive(Clone, Debug, PartialEq)]
struct Snapshot {
    settings: Settings,
    objects: Objects,
    camera: Option<Camera>,
    marks: Marks,
}

#[derive(Default)]
pub struct History {
    past: Vec<Snapshot>,
    future: Vec<Snapshot>,
    /// The state at the end of the last step.
    settled: Option<(Settings, Objects)>,
    marks: Marks,
    /// The last number that was given to a state.
    last_mark: u64,
    changed: Option<(Settings, Objects, Instant)>,
}

/// The time without changes that ends a step. It is longer than the time between two notches of the wheel, and shorter
/// than the time between two decisions.
const QUIET: Duration = Duration::from_millis(400);
/// The largest number of steps kept. A snapshot takes a few kilobytes.
const STEPS: usize = 500;
/// The most things and the most characters of a name that the message of an undone step has.
const MOST_TOLD: usize = 3;
const MOST_NAMED: usize = 30;

impl History {
    /// Compares the state with that of the last step; the session calls this at every step. `is_held` says that a mouse
    /// button is down or text is being typed. Returns the time after which to call this again.
    pub fn watch(&mut self, settings: &Settings, objects: &Objects, is_held: bool, now: Instant) -> Option<Duration> {
        let Some(settled) = &self.settled else {
            self.settled = Some((settings.clone(), objects.clone()));
            return None;
        };
        if settled.0 == *settings && settled.1 == *objects {
            self.changed = None;
            return None;
        }
        match &mut self.changed {
            Some((changed, moved, since)) if changed == settings && moved == objects => {
                if !is_held && now.saturating_duration_since(*since) >= QUIET {
                    self.settle(settings, objects);
                    return None;
                }
            }
            changed => *changed = Some((settings.clone(), objects.clone(), now)),
        }
        Some(QUIET)
    }

    /// Returns the number of steps that can be undone.
    pub fn steps(&self) -> usize {
        self.past.len()
    }

    /// Which state the present one is, but for a change that has not ended.
    pub fn marks(&self) -> Marks {
        self.marks
    }

    /// Whether something changes just now.
    pub fn is_changing(&self) -> bool {
        self.changed.is_some()
    }

    /// Gives a new state its numbers.
    fn mark(&mut self, before: &(Settings, Objects), settings: &Settings, objects: &Objects) {
        self.last_mark += 1;
        if before.0 != *settings {
            self.marks.settings = self.last_mark;
        }
        if before.1 != *objects {
            self.marks.objects = self.last_mark;
            if before.1.made() != objects.made() {
                self.marks.made = self.last_mark;
            }
        }
    }

    /// Ends the current step, if something has changed since the last one.
    pub fn settle(&mut self, settings: &Settings, objects: &Objects) {
        self.changed = None;
        match self.settled.take() {
            Some(before) if before.0 != *settings || before.1 != *objects => {
                let marks = self.marks;
                self.mark(&before, settings, objects);
                self.push(Snapshot { settings: before.0, objects: before.1, camera: None, marks });
                self.settled = Some((settings.clone(), objects.clone()));
            }
            settled => self.settled = settled,
        }
    }

    fn push(&mut self, before: Snapshot) {
        self.past.push(before);
        self.future.clear();
        if self.past.len() > STEPS {
            self.past.remove(0);
        }
    }

    /// Applies a change to the objects of all steps. What a file brings, or takes away when it is closed, is not a step
    /// of its own.
    pub fn rewrite(&mut self, change: impl Fn(&mut Objects)) {
        let steps = self.past.iter_mut().chain(&mut self.future).map(|step| &mut step.objects);
        steps.chain(self.settled.as_mut().map(|(_, objects)| objects)).for_each(change);
        self.changed = None;
    }

    /// Takes parameters that a file brings, which are no step. Changes before them must be settled.
    pub fn bring_settings(&mut self, settings: &Settings) {
        if let Some((known, _)) = &mut self.settled {
            *known = settings.clone();
        }
    }

    /// Must be called before a jump, which may change the settings, the objects and the camera.
    pub fn before_jump(&mut self, settings: &Settings, objects: &Objects, camera: Camera) {
        self.settle(settings, objects);
        let (settings, objects, marks) = (settings.clone(), objects.clone(), self.marks);
        self.push(Snapshot { settings, objects, camera: Some(camera), marks });
    }

    /// Must be called after a jump.
    pub fn after_jump(&mut self, settings: &Settings, objects: &Objects) {
        if let Some(before) = self.settled.take() {
            self.mark(&before, settings, objects);
        }
        self.changed = None;
        self.settled = Some((settings.clone(), objects.clone()));
    }

    /// Undoes the last step. Returns what it was about, in words; `None` if there is no step.
    pub fn undo(&mut self, settings: &mut Settings, objects: &mut Objects, camera: &mut Camera) -> Option<String> {
        self.settle(settings, objects);
        let step = self.past.pop()?;
        let now = self.apply(step, settings, objects, camera);
        let told = difference(&now, settings, objects);
        self.future.push(now);
        Some(told)
    }

    /// Does the last step again that was undone. Returns what it was about, in words; `None` if there is no step.
    pub fn redo(&mut self, settings: &mut Settings, objects: &mut Objects, camera: &mut Camera) -> Option<String> {
        self.settle(settings, objects);
        let step = self.future.pop()?;
        let now = self.apply(step, settings, objects, camera);
        let told = difference(&now, settings, objects);
        self.past.push(now);
        Some(told)
    }

    /// Restores the state of `step`. Returns the state before that, for the opposite direction.
    fn apply(
        &mut self,
        step: Snapshot,
        settings: &mut Settings,
        objects: &mut Objects,
        camera: &mut Camera,
    ) -> Snapshot {
        let now = Snapshot {
            settings: std::mem::replace(settings, step.settings),
            objects: std::mem::replace(objects, step.objects),
            camera: step.camera.map(|_| *camera),
            marks: std::mem::replace(&mut self.marks, step.marks),
        };
        if let Some(before) = step.camera {
            *camera = before;
        }
        self.settled = Some((settings.clone(), objects.clone()));
        now
    }
}

/// What differs between a snapshot and another state, in words: objects, rules of what is shown, parameters, the view.
fn difference(from: &Snapshot, settings: &Settings, objects: &Objects) -> String {
    let of = |objects: &Objects| -> BTreeMap<ObjectId, (String, Object)> {
        objects.all().map(|(id, name, object)| (id, (name.to_owned(), object))).collect()
    };
    let (before, after) = (of(&from.objects), of(objects));
    let differing = before
        .iter()
        .chain(&after)
        .filter(|(id, object)| before.get(id) != Some(object) || after.get(id) != Some(object));
    let mut told: Vec<String> = Vec::new();
    let mut tell = |text: String| {
        if !told.contains(&text) {
            told.push(text);
        }
    };
    let ids: BTreeSet<ObjectId> = differing.map(|(id, _)| *id).collect();
    for id in ids {
        // A note that is not written yet has no name.
        let all = [&before, &after].into_iter().filter_map(|objects| objects.get(&id));
        let named = all.max_by_key(|(name, _)| !name.is_empty());
        let label = || objects.label(id).or_else(|| from.objects.label(id));
        if let Some((name, object)) = named {
            let label = label().filter(|_| matches!(object, Object::Light(_)));
            tell(quoted(translated(object.kind().name), label.as_deref().unwrap_or(name)));
        }
    }
    for own in differing_of(&from.objects.own_settings, &objects.own_settings) {
        let placement = |objects: &Objects| objects.settings_of(own.key).and_then(CloudSettings::placement);
        let what =
            if placement(&from.objects) == placement(objects) { text!("cloud") } else { text!("the place of cloud") };
        tell(quoted(what, short_name(&own.settings.cloud)));
    }
    if from.objects.markings != objects.markings {
        tell(text!("points that reflect").into());
    }
    if from.objects.visibility != objects.visibility {
        tell(text!("which points are shown").into());
    }
    for path in differing_of(&from.objects.paths, &objects.paths) {
        tell(quoted(text!("path"), &path.name));
    }
    for bookmark in differing_of(&from.objects.bookmarks, &objects.bookmarks) {
        tell(quoted(text!("bookmark"), &bookmark.name));
    }
    let (before, after): (BTreeSet<_>, BTreeSet<_>) =
        (from.settings.differing().into_iter().collect(), settings.differing().into_iter().collect());
    before.symmetric_difference(&after).for_each(|(key, _)| tell(key.clone()));
    if from.camera.is_some() {
        tell(text!("the view").into());
    }
    let rest = told.len().saturating_sub(MOST_TOLD);
    told.truncate(MOST_TOLD);
    if rest > 0 {
        told.push(text!("{rest} more", rest));
    }
    told.join(", ")
}

/// A thing and its name, in a form that commas within the name do not divide.
fn quoted(what: &str, name: &str) -> String {
    match param::shortened(name.lines().next().unwrap_or_default(), MOST_NAMED) {
        name if name.is_empty() => what.to_owned(),
        name => format!("{what} `{name}`"),
    }
}

/// What is in one of two lists and not in the other.
fn differing_of<'a, T: PartialEq>(before: &'a [T], after: &'a [T]) -> impl Iterator<Item = &'a T> {
    let gone = before.iter().filter(|one| !after.contains(one));
    gone.chain(after.iter().filter(|one| !before.contains(one)))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use scene::{Mirror, Shape};

    use super::*;
    use crate::viewer::objects::{ObjectId, Placed};

    fn camera(distance: f64) -> Camera {
        Camera::looking(DVec3::ZERO, DVec3::X, distance, DVec3::Z)
    }

    struct Subject {
        history: History,
        settings: Settings,
        objects: Objects,
        camera: Camera,
        /// What the last undo or redo was about.
        told: Option<String>,
    }

    impl Subject {
        fn new() -> Self {
            let mut subject = Self {
                history: History::default(),
                settings: Settings::default(),
                objects: Objects::default(),
                camera: camera(1.0),
                told: None,
            };
            subject.watch(false);
            subject
        }

        fn watch(&mut self, is_held: bool) {
            self.history.watch(&self.settings, &self.objects, is_held, Instant::now());
        }

        fn undo(&mut self) -> bool {
            self.told = self.history.undo(&mut self.settings, &mut self.objects, &mut self.camera);
            self.told.is_some()
        }

        fn redo(&mut self) -> bool {
            self.told = self.history.redo(&mut self.settings, &mut self.objects, &mut self.camera);
            self.told.is_some()
        }

        fn jump(&mut self, camera: Camera) {
            self.history.before_jump(&self.settings, &self.objects, self.camera);
            self.camera = camera;
            self.history.after_jump(&self.settings, &self.objects);
        }
    }

    fn ball(id: u32) -> Placed {
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        Placed { id: ObjectId(id), mirror, input: None }
    }

    #[test]
    fn a_drag_is_one_step_and_comes_back_by_redo() {
        let mut subject = Subject::new();
        for step in 1..=20 {
            subject.settings.splat.size = step as f32 * 0.1;
            subject.watch(true);
        }
        assert!(subject.undo());
        assert_eq!(subject.settings, Settings::default());
        assert!(!subject.undo());
        assert!(subject.redo());
        assert_eq!(subject.settings.splat.size, 2.0);
        assert!(!subject.redo());
    }

    #[test]
    fn camera_jumps_are_undone_but_turning_by_hand_is_not() {
        let mut subject = Subject::new();
        subject.jump(camera(5.0));
        subject.camera.orbit(0.3, 0.1);
        let turned = subject.camera;
        assert!(subject.undo());
        assert_eq!((subject.camera, subject.told.as_deref()), (camera(1.0), Some("the view")));
        assert!(subject.redo());
        assert_eq!((subject.camera, subject.told.as_deref()), (turned, Some("the view")));
    }

    #[test]
    fn a_parameter_undone_leaves_the_camera_where_it_is() {
        let mut subject = Subject::new();
        subject.settings.edl.strength = 3.0;
        subject.watch(true);
        subject.camera.orbit(1.0, 0.0);
        let turned = subject.camera;
        assert!(subject.undo());
        assert_eq!((&subject.settings, subject.camera), (&Settings::default(), turned));
    }

    #[test]
    fn mirrors_and_parameters_are_undone_in_the_order_they_were_changed() {
        let mut subject = Subject::new();
        subject.objects.mirrors.push(ball(1));
        subject.history.settle(&subject.settings, &subject.objects);
        subject.settings.splat.size = 2.0;
        subject.history.settle(&subject.settings, &subject.objects);
        for step in 1..=10 {
            subject.objects.mirrors[0].mirror.position.x = f64::from(step);
            subject.watch(true);
        }
        assert!(subject.undo());
        assert_eq!(subject.told.as_deref(), Some("mirror `sphere`"));
        assert_eq!((subject.objects.mirrors[0].mirror.position.x, subject.settings.splat.size), (0.0, 2.0));
        assert!(subject.undo());
        assert_eq!(subject.told.as_deref(), Some("splat.size"));
        assert_eq!((subject.objects.mirrors.len(), subject.settings.splat.size), (1, 1.0));
        assert!(subject.undo());
        assert!(subject.objects.mirrors.is_empty());
        assert!(subject.redo() && subject.redo() && subject.redo());
        assert_eq!(subject.objects.mirrors[0].mirror.position.x, 10.0);
    }

    #[test]
    fn a_state_that_is_come_back_to_is_the_same_and_what_a_file_brings_or_a_camera_does_is_no_other_state() {
        let mut subject = Subject::new();
        let first = subject.history.marks();
        subject.jump(camera(5.0));
        let bring = |objects: &mut Objects| objects.mirrors.push(ball(1));
        bring(&mut subject.objects);
        subject.history.rewrite(bring);
        subject.watch(false);
        assert_eq!(subject.history.marks(), first);
        subject.settings.splat.size = 2.0;
        subject.watch(false);
        assert!(subject.history.is_changing());
        subject.history.settle(&subject.settings, &subject.objects);
        let second = subject.history.marks();
        assert!(second.settings != first.settings && second.objects == first.objects);
        subject.objects.mirrors.clear();
        subject.history.settle(&subject.settings, &subject.objects);
        let third = subject.history.marks();
        assert!(third.settings == second.settings && third.objects != first.objects);
        assert!(subject.undo());
        assert_eq!(subject.history.marks(), second);
        assert!(subject.undo());
        assert_eq!(subject.history.marks(), first);
        assert!(subject.redo() && subject.redo());
        assert_eq!(subject.history.marks(), third);
        // Another change after undoing is another state.
        assert!(subject.undo());
        subject.objects.mirrors.clear();
        subject.history.settle(&subject.settings, &subject.objects);
        assert!(![first.objects, third.objects].contains(&subject.history.marks().objects));
    }

    #[test]
    fn what_a_file_brings_is_not_undone() {
        let mut subject = Subject::new();
        subject.settings.splat.size = 2.0;
        subject.history.settle(&subject.settings, &subject.objects);
        let bring = |objects: &mut Objects| objects.mirrors.push(ball(1));
        bring(&mut subject.objects);
        subject.history.rewrite(bring);
        assert!(subject.undo());
        assert_eq!((subject.objects.mirrors.len(), subject.settings.splat.size), (1, 1.0));
        assert!(!subject.undo());
    }
}
