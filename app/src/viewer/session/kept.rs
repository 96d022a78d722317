//! A kept state of the picture, to look at beside the present one from the same place: a key shows it while it is held,
//! a line divides the picture between the two, or each has a half of the window. It holds parameters, lights, colours,
//! which clouds and points are shown, and where clouds stand; camera and mirrors are those of now.

use cloud::PointTest;
use render::ColorPlan;
use scene::{CloudSettings, Settings};
use serde_json::json;
use world::{Change, CloudKey};

use crate::shared::language::text;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::{ObjectId, Objects};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::Command;
use crate::viewer::requests::action::KeptStep;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;
use crate::viewer::truth::view::Picture;

/// Numbers of points with this bit belong to the kept state: its frames must not be taken for those of the present one.
const OTHER_POINTS: u64 = 1 << 63;

#[derive(Default)]
pub struct Kept {
    state: Option<State>,
    /// True while the key is down.
    pub is_held: bool,
    pub is_split: bool,
    is_beside: bool,
    /// The position of the split, from 0 at the left to 1.
    pub split: f32,
    /// The frame that the render thread was asked for.
    asked: Option<FrameRequest>,
    drawn: Option<(FrameRequest, Picture)>,
}

struct State {
    /// The parameters as a person has set them.
    settings: Settings,
    /// The frame at that time, with the parameters that it was drawn with.
    request: FrameRequest,
    test: PointTest,
    clouds: Vec<(CloudKey, bool, Option<ColorPlan>)>,
    /// The objects of the scene. The state holds the lights, what clouds have of their own, and what says which points
    /// are shown.
    objects: Objects,
}

impl State {
    fn of(scene: &Scene, request: FrameRequest, loaded: &Loaded) -> Self {
        let plan = |entry: &CloudEntry| entry.figures.as_ref().map(|figures| figures.plan.clone());
        let clouds = loaded.clouds.iter().map(|entry| (entry.key, entry.is_visible, plan(entry))).collect();
        let (settings, objects) = (scene.settings.clone(), scene.objects.clone());
        Self { settings, request, test: loaded.drawn_test.clone(), clouds, objects }
    }

    /// The frame of this state that shows what a frame of the present one shows.
    fn frame(&self, present: &FrameRequest) -> FrameRequest {
        FrameRequest {
            settings: self.request.settings.clone(),
            lights: self.request.lights.clone(),
            clues: self.request.clues,
            test: self.test.clone(),
            revision: present.revision | OTHER_POINTS,
            ..present.clone()
        }
    }

    /// What changes the points of the present state into those of this one, and back.
    fn changes(&self, loaded: &Loaded) -> [Vec<Change>; 2] {
        let (mut there, mut back) = (Vec::new(), Vec::new());
        if self.test != loaded.drawn_test {
            there.push(Change::Visibility { test: self.test.clone() });
            back.push(Change::Visibility { test: loaded.drawn_test.clone() });
        }
        for entry in &loaded.clouds {
            let cloud = entry.key;
            let known = self.clouds.iter().find(|(key, ..)| *key == cloud);
            let (is_visible, plan) = known.map_or((false, None), |(_, is_visible, plan)| (*is_visible, plan.clone()));
            if is_visible != entry.is_visible {
                there.push(Change::Show { cloud, is_visible });
                back.push(Change::Show { cloud, is_visible: entry.is_visible });
            }
            let own = self.objects.settings_of(cloud);
            let size = own.map_or(1.0, |own| own.size);
            let placement = own.and_then(CloudSettings::placement);
            if (size != entry.size || placement != entry.placement()) && is_visible {
                there.extend(entry.drawn(size, placement));
                back.extend(entry.drawn(entry.size, entry.placement()));
            }
            let present = entry.figures.as_ref().map(|figures| figures.plan.clone());
            if let Some((old, new)) = plan.zip(present).filter(|(old, new)| is_visible && old != new) {
                let color = |plan| Change::Color { cloud, chunks: entry.chunks(), plan, up: entry.up };
                there.push(color(old));
                back.push(color(new));
            }
        }
        [there, back]
    }
}

impl Kept {
    pub fn new() -> Self {
        Self { split: 0.5, ..Self::default() }
    }

    pub fn is_there(&self) -> bool {
        self.state.is_some()
    }

    /// The parameters of the kept state, as a person had set them.
    pub fn settings(&self) -> Option<&Settings> {
        self.state.as_ref().map(|state| &state.settings)
    }

    /// Whether the picture shall show the kept state.
    pub fn is_asked_for(&self) -> bool {
        self.is_there() && (self.is_held || self.is_split || self.is_beside)
    }

    /// Whether the kept state has a half of the window.
    pub fn is_beside(&self) -> bool {
        self.is_there() && self.is_beside
    }

    /// Carries out a step; `request` is the frame that is wanted now.
    pub fn act(&mut self, step: KeptStep, request: FrameRequest, loaded: &mut Loaded, beside: &mut Beside<'_>) {
        let present = |loaded: &Loaded, beside: &Beside<'_>| State::of(beside.scene, request, loaded);
        match step {
            KeptStep::Keep if loaded.clouds.is_empty() => beside.outside.note(text!("There is nothing to keep yet")),
            KeptStep::Keep => {
                self.state = Some(present(loaded, beside));
                self.drawn = None;
                beside.outside.note(text!("This state of the picture is kept"));
            }
            KeptStep::LetGo => *self = Self { asked: self.asked.take(), ..Self::new() },
            KeptStep::ToggleSplit | KeptStep::ToggleBeside | KeptStep::Swap if self.state.is_none() => {
                beside.outside.note(text!("Keep a state of the picture first"));
            }
            KeptStep::ToggleSplit => (self.is_split, self.is_beside) = (!self.is_split, false),
            KeptStep::ToggleBeside => (self.is_split, self.is_beside) = (false, !self.is_beside),
            KeptStep::SplitAt(share) => self.split = share,
            KeptStep::Swap => {
                let now = present(loaded, beside);
                let Some(state) = self.state.replace(now) else { return };
                self.drawn = None;
                let scene = &mut *beside.scene;
                scene.edit(beside.outside.now, |settings, objects| {
                    *settings = state.settings;
                    let Objects { lights, no_guess, own_settings, clips, visibility, paths, .. } = state.objects;
                    let ids = lights.iter().map(|placed| placed.id).chain(clips.iter().map(|placed| placed.id));
                    let back: Vec<ObjectId> = ids.filter(|id| objects.get(*id).is_none()).collect();
                    objects.keep_tracks(|objects| (objects.lights, objects.clips) = (lights, clips));
                    // What the other state lacks went with its tracks, and both come back.
                    objects.bring_tracks(&back, &paths);
                    (objects.no_guess, objects.visibility) = (no_guess, visibility);
                    objects.own_settings = own_settings;
                    objects.own_settings.retain(|own| loaded.cloud(own.key).is_some());
                });
                scene.selected = scene.selected.filter(|id| scene.objects.get(*id).is_some());
                loaded.sync_own_settings(beside);
            }
        }
    }

    /// Asks for the picture of the kept state once the present one stands still. Called every frame of the window.
    pub fn sync(&mut self, still: Option<&FrameRequest>, loaded: &Loaded, outside: &mut Outside) {
        let (Some(state), Some(still)) = (self.state.as_ref().filter(|_| self.is_asked_for()), still) else { return };
        let wanted = state.frame(still);
        if self.asked.is_some() || self.drawn.as_ref().is_some_and(|(known, _)| *known == wanted) {
            return;
        }
        // Commands are carried out in order, so no picture of the present state comes in between.
        let [there, back] = state.changes(loaded);
        there.into_iter().for_each(|change| outside.change(change));
        outside.render(Command::Read { request: Box::new(wanted.clone()), images: Vec::new() });
        back.into_iter().for_each(|change| outside.change(change));
        self.asked = Some(wanted);
    }

    /// Takes in the picture.
    pub fn on_read(&mut self, rgba: Vec<u8>, outside: &mut Outside) {
        if let Some(request) = self.asked.take() {
            outside.log(json!({ "event": "kept_state" }));
            self.drawn = Some((request.clone(), Picture::new(request.size, rgba)));
        }
    }

    /// Lets go of a state whose picture cannot be drawn, which a message has said.
    pub fn on_problem(&mut self) {
        if self.asked.is_some() {
            *self = Self::new();
        }
    }

    /// The picture of the kept state that belongs to a frame of the present one.
    pub fn picture(&self, present: &FrameRequest) -> Option<&Picture> {
        let wanted = self.state.as_ref()?.frame(present);
        self.drawn.as_ref().filter(|(known, _)| *known == wanted).map(|(_, picture)| picture)
    }

    /// The picture of the kept state that was drawn last, perhaps from elsewhere.
    pub fn last_picture(&self) -> Option<&Picture> {
        self.drawn.as_ref().map(|(_, picture)| picture)
    }
}

#[cfg(test)]
mod tests {
    use scene::{ClipShape, ColorBy, Filter, Lighting, Shape};

    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::requests::action::{Action, Clipping, Film, PathPreset, SavePicture};
    use crate::viewer::session::Session;

    fn act(session: &mut Session, step: KeptStep) {
        session.act(Action::Kept(step));
    }

    /// The picture of the kept state for the frame on the screen.
    fn picture(session: &Session) -> Option<&[u8]> {
        Some(&session.kept.picture(&session.frames.shown.as_ref()?.request)?.rgba)
    }

    #[test]
    fn swapping_exchanges_clips_filters_and_lights_in_one_step_of_undo() {
        let mut session = Session::with_two_points();
        let shown = |session: &Session| {
            let Objects { clips, lights, visibility, own_settings, .. } = &session.scene.objects;
            let clouds: Vec<bool> = own_settings.iter().map(|own| own.settings.on).collect();
            (session.scene.settings.splat.size, clips.clone(), lights.clone(), visibility.clone(), clouds)
        };
        session.act(Action::AddMirror(Shape::Sphere));
        act(&mut session, KeptStep::Keep);
        let first = shown(&session);
        session.act(Action::Clip(Clipping::AroundAll(ClipShape::Box)));
        let filter = Filter { attribute: "intensity".into(), low: 1.0, high: 2.0 };
        session.act(Action::Clip(Clipping::Filter(vec![filter])));
        session.act(Action::ShowClasses(vec![7], false));
        session.act(Action::AddSpot);
        let key = session.loaded.clouds[0].key;
        session.act(Action::ShowCloud(key, false));
        session.scene.settings.splat.size = 3.0;
        session.act(Action::Select(Some(session.scene.objects.clips[0].id)));
        let second = shown(&session);
        assert!(second.1.len() == 1 && second.2.len() == 1 && second.4 == [false]);
        act(&mut session, KeptStep::Swap);
        assert_eq!(shown(&session), first);
        assert!(session.scene.selected.is_none() && session.loaded.clouds[0].is_visible);
        assert_eq!(session.scene.objects.mirrors.len(), 1, "mirrors are those of now");
        session.act(Action::Undo);
        assert_eq!(shown(&session), second);
        session.act(Action::Redo);
        assert_eq!(shown(&session), first);
        act(&mut session, KeptStep::Swap);
        assert_eq!(shown(&session), second, "and back");
    }

    #[test]
    fn tracks_stay_with_their_lights_when_the_kept_state_has_others() {
        let mut session = Session::with_two_points();
        for _ in 0..3 {
            session.act(Action::AddSpot);
        }
        session.act(Action::Film(Film::Add(PathPreset::View)));
        session.act(Action::Film(Film::Key("lights.3.intensity".into())));
        act(&mut session, KeptStep::Keep);
        session.act(Action::Select(Some(session.scene.objects.lights[0].id)));
        session.act(Action::Delete);
        for (count, key) in [(2, "lights.2.intensity"), (3, "lights.3.intensity"), (2, "lights.2.intensity")] {
            let objects = &session.scene.objects;
            assert_eq!((objects.lights.len(), objects.paths[0].tracks[0].key.as_str()), (count, key));
            act(&mut session, KeptStep::Swap);
        }
        // A light that only one of the states has takes its track along.
        session.act(Action::AddSpot);
        let count = session.scene.objects.lights.len();
        session.act(Action::Film(Film::Key(format!("lights.{count}.intensity"))));
        let tracks = |session: &Session| session.scene.objects.paths[0].tracks.clone();
        let (before, lights) = (tracks(&session), session.scene.objects.lights.clone());
        assert_eq!(before.len(), 2);
        act(&mut session, KeptStep::Swap);
        assert_eq!(tracks(&session).len(), 1);
        act(&mut session, KeptStep::Swap);
        assert_eq!((session.scene.objects.lights.clone(), tracks(&session)), (lights, before));
    }

    #[test]
    fn the_kept_state_is_drawn_from_where_one_looks_now_and_leaves_the_present_one_as_it_is() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.session.scene.settings.light.by = Lighting::Colors;
        bench.settle();
        let read = |bench: &mut Bench| {
            bench.settle();
            bench.read()
        };
        let before = read(&mut bench);
        act(&mut bench.session, KeptStep::ToggleSplit);
        assert!(!bench.session.kept.is_split, "there is nothing to split yet");
        act(&mut bench.session, KeptStep::Keep);
        // In another colour, the points themselves change.
        bench.session.act(Action::ColorBy(ColorBy::Plain));
        let after = read(&mut bench);
        assert_ne!(before, after);
        assert!(picture(&bench.session).is_none(), "nobody has asked for it");
        act(&mut bench.session, KeptStep::ToggleSplit);
        bench.settle();
        let kept = picture(&bench.session).expect("its picture");
        assert!(kept == before, "the kept state looks as it did");
        bench.session.act(Action::SavePicture(SavePicture::AtOnce));
        let told = bench.session.outside.messages.all.last().map(|message| message.text.as_str());
        assert!(told.is_some_and(|told| told.contains("is saved alone")), "{told:?}");
        bench.session.outside.effects.clear();
        assert!(read(&mut bench) == after, "and the present one as it does");
        // From elsewhere it is drawn anew.
        bench.session.act(Action::Orbit(glam::DVec2::new(60.0, 0.0)));
        bench.settle();
        let turned = picture(&bench.session).expect("its picture").to_vec();
        assert!(turned != before);
        act(&mut bench.session, KeptStep::ToggleBeside);
        assert!(bench.session.kept.is_beside() && !bench.session.kept.is_split && picture(&bench.session).is_some());
        act(&mut bench.session, KeptStep::ToggleSplit);
        assert!(bench.session.kept.is_split && !bench.session.kept.is_beside());
        act(&mut bench.session, KeptStep::Swap);
        assert!(read(&mut bench) == turned, "swapped, it is the present one");
        act(&mut bench.session, KeptStep::LetGo);
        assert!(!bench.session.kept.is_there() && !bench.session.kept.is_asked_for());
    }
}
