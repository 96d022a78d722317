//! `auto` in the window: learns what passes cost from the frames that are shown, says what makes a frame slow, and lets
//! the render thread choose settings for `view.still_ms` once the picture stands still. What was chosen stays until the
//! scene, the light, the parameters or the size change, or another view takes much longer; so it never swings. Where the
//! errors of views before are known, settings are chosen by them at once, and once more when those of this view are
//! measured.

use std::time::{Duration, Instant};

use render::FrameStats;
use scene::Method;
use serde_json::json;
use study::cost::{Costs, Slowest};
use study::{Choice, CostModel, Target};

use crate::shared::language::text;
use crate::system::costs;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::Command;
use crate::viewer::requests::outside::Outside;

/// The time for which the picture stands still before settings are chosen for it: choosing draws many frames.
const REST: Duration = Duration::from_millis(500);

/// Another view may take so many times the target before settings are chosen anew for it.
const MUCH_LONGER: f64 = 1.5;

#[derive(Default)]
pub struct Auto {
    /// Whether the model is kept in a file, beside the preferences.
    pub is_kept: bool,
    /// Whether it was said that the model cannot be kept.
    has_warned: bool,
    /// The name of the adapter, once it is known.
    adapter: Option<String>,
    model: CostModel,
    costs: Costs,
    /// What made the last frame slow that was drawn in full quality.
    pub slowest: Option<Slowest>,
    /// The view that stands still, without what was chosen, and since when.
    still: Option<(FrameRequest, Instant)>,
    /// Whether an answer is awaited.
    is_asked: bool,
    chosen: Option<Chosen>,
}

/// What was chosen, and for which view.
struct Chosen {
    request: FrameRequest,
    target: f64,
    /// The choice, or why there is none.
    choice: Result<Choice, String>,
}

impl Chosen {
    /// Whether the choice holds for a view: nothing but the camera differs.
    fn is_of(&self, request: &FrameRequest, target: f64) -> bool {
        self.target == target && FrameRequest { camera: request.camera, ..self.request.clone() } == *request
    }

    /// Whether its error was not measured yet.
    fn is_first(&self) -> bool {
        self.choice.as_ref().is_ok_and(|choice| choice.errors.is_none())
    }
}

/// The milliseconds that `auto` is to keep to; `None` if nothing is to be chosen.
fn target_of(request: &FrameRequest) -> Option<f64> {
    let settings = &request.settings;
    let target = f64::from(settings.view.still_ms);
    (settings.reflection.method == Method::Auto && target > 0.0).then_some(target)
}

impl Auto {
    /// Takes up what is kept of an adapter.
    pub fn ready(&mut self, adapter: &str, outside: &mut Outside) {
        self.adapter = Some(adapter.to_owned());
        if self.is_kept {
            let (model, problem) = costs::load(adapter);
            problem.into_iter().for_each(|problem| outside.warning(problem));
            self.renew(model);
        }
    }

    /// Keeps what was learned.
    pub fn keep(&mut self, outside: &mut Outside) {
        if let Some(adapter) = self.adapter.as_ref().filter(|_| self.is_kept && !self.model.is_empty()) {
            let saved = costs::save(adapter, &self.model);
            self.on_saved(saved, outside);
        }
    }

    /// Says the first time that what was learned cannot be kept.
    fn on_saved(&mut self, saved: anyhow::Result<()>, outside: &mut Outside) {
        if let Some(error) = saved.err().filter(|_| !self.has_warned) {
            self.has_warned = true;
            outside.warning(text!("times are not kept: {error}", error = format_args!("{error:#}")));
        }
    }

    fn renew(&mut self, model: CostModel) {
        self.costs = model.costs();
        self.model = model;
    }

    /// Learns from a frame that was drawn for the window in full quality.
    pub fn learn(&mut self, request: &FrameRequest, stats: &FrameStats) {
        let (settings, size) = (&request.settings, request.drawn_size());
        if !stats.has_compiled {
            // Work that is kept from the frame before is missing from this one.
            self.model.learn_parts(stats, settings, size);
            self.costs = self.model.costs();
        }
        self.slowest = self.costs.slowest(stats, settings, size);
    }

    /// The request with what was chosen.
    pub fn applied(&self, mut request: FrameRequest) -> FrameRequest {
        let target = target_of(&request);
        let chosen = self.chosen.as_ref().filter(|chosen| Some(chosen.target) == target);
        if let Some(Ok(choice)) = chosen.map(|chosen| &chosen.choice) {
            let mut settings = request.settings.clone();
            // The values come from this program, and are in range.
            if choice.apply(&mut settings).is_ok() {
                request.settings = settings;
            }
        }
        request
    }

    /// What was chosen and why, or why nothing was; `None` if nothing is to be chosen.
    pub fn told(&self, request: &FrameRequest) -> Option<String> {
        let target = target_of(request)?;
        let chosen = self.chosen.as_ref().filter(|chosen| chosen.target == target);
        Some(match chosen.map(|chosen| &chosen.choice) {
            None if self.is_asked => text!("auto is choosing").to_owned(),
            None => text!("auto chooses once the picture stands still").to_owned(),
            Some(Ok(choice)) => told(choice),
            Some(Err(problem)) => text!("auto: {problem}", problem),
        })
    }

    /// Asks for a choice if the view stands still and none holds for it. `request` is the view without what was chosen;
    /// `milliseconds` is the time of its frame if that stands still. Returns the time after which to call again.
    pub fn sync(
        &mut self,
        request: FrameRequest,
        milliseconds: Option<f64>,
        outside: &mut Outside,
    ) -> Option<Duration> {
        let target = target_of(&request);
        let (Some(target), Some(milliseconds)) = (target, milliseconds) else {
            self.still = None;
            return None;
        };
        let holds = |chosen: &Chosen| {
            let is_slow = milliseconds > MUCH_LONGER * target && chosen.request.camera != request.camera;
            chosen.is_of(&request, target) && !is_slow
        };
        let held = self.chosen.as_ref().filter(|chosen| holds(chosen));
        if self.is_asked || held.is_some_and(|chosen| !chosen.is_first()) {
            return None;
        }
        let is_first = held.is_none();
        if self.still.as_ref().is_none_or(|(still, _)| *still != request) {
            self.still = Some((request.clone(), outside.now));
        }
        let since = self.still.as_ref().map_or(outside.now, |(_, since)| *since);
        let left = REST.saturating_sub(outside.now.saturating_duration_since(since));
        if left.is_zero() {
            self.is_asked = true;
            let model = Box::new(self.model.clone());
            let target = Target::Milliseconds(target);
            outside.render(Command::Choose { request: Box::new(request), target, is_first, model });
        }
        (!left.is_zero()).then_some(left)
    }

    /// Takes in an answer of the render thread; no choice if it has turned to another frame.
    pub fn on_chosen(
        &mut self,
        request: FrameRequest,
        choice: Result<Option<Choice>, String>,
        model: CostModel,
        outside: &mut Outside,
    ) {
        (self.is_asked, self.still) = (false, None);
        self.renew(model);
        let Some(choice) = choice.transpose() else { return };
        self.keep(outside);
        let Some(target) = target_of(&request) else { return };
        match &choice {
            Ok(choice) => {
                let is_measured = choice.errors.is_some();
                outside.log(json!({
                    "event": "auto", "set": choice.set, "why": choice.why, "measured": is_measured,
                }));
                outside.note(told(choice));
            }
            Err(problem) => outside.warning(text!("auto: {problem}", problem)),
        }
        self.chosen = Some(Chosen { request, target, choice });
    }
}

fn told(choice: &Choice) -> String {
    let set: Vec<String> = choice.set.iter().map(|(key, value)| format!("{key}={value}")).collect();
    text!("auto: {set}: {why}", set = set.join(" "), why = choice.why)
}

/// What makes a frame slow, for people.
pub fn slowest_text(slowest: &Slowest) -> String {
    let Slowest { pass, share, driver, lever, .. } = slowest;
    let share = text!("{pass} takes {share} % of the frame", pass, share = format_args!("{:.0}", share * 100.0));
    match (driver, lever) {
        (Some(driver), Some(lever)) => {
            text!("{share}, mostly for each {driver}; {lever} shortens it", share, driver = driver.name(), lever)
        }
        (Some(driver), None) => text!("{share}, mostly for each {driver}", share, driver = driver.name()),
        (None, _) => share,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::requests::messages::Messages;

    /// The view for which settings were chosen, and the picture's settings.
    fn chosen(bench: &Bench) -> (FrameRequest, scene::Settings) {
        let chosen = bench.session.auto.chosen.as_ref().expect("a choice");
        assert!(chosen.choice.is_ok(), "{:?}", chosen.choice);
        (chosen.request.clone(), bench.session.still_frame().expect("a still picture").settings.clone())
    }

    /// Whether the error was measured of each choice so far.
    fn choices(bench: &Bench) -> Vec<bool> {
        let choices = bench.log.iter().filter(|event| event["event"] == "auto");
        choices.map(|event| event["measured"].as_bool().expect("a choice")).collect()
    }

    #[test]
    fn times_that_cannot_be_kept_are_told_once() {
        let (mut auto, mut outside) = (Auto::default(), Outside::new(Messages::default()));
        auto.on_saved(Ok(()), &mut outside);
        for choice in 0..3 {
            auto.on_saved(Err(anyhow::anyhow!("costs: its disk can only be read")), &mut outside);
            // So many that the message is none of those on the screen.
            (0..4).for_each(|note| outside.note(format!("choice {choice}, note {note}")));
        }
        let told = outside.messages.all.iter().filter(|message| message.text.starts_with("times are not kept: costs"));
        assert_eq!(told.count(), 1);
    }

    #[test]
    fn settings_are_chosen_once_for_a_view_that_stands_still_and_anew_when_the_scene_changes() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        // Choosing draws a hundred pictures, some with a thousand lights: few pixels and coarse shadows do.
        bench.session.set_view_size([32, 24]);
        let indirect = &mut bench.session.scene.settings.gi;
        (indirect.shadow_points, indirect.shadow_size) = (256, 16);
        bench.settle();
        let Bench { session, .. } = &bench;
        assert!(session.auto.chosen.is_none() && session.auto.told(&session.picture()).is_none(), "nobody asked");
        let slowest = session.auto.slowest.as_ref().map(slowest_text).expect("a frame was shown");
        assert!(slowest.contains("% of the frame"), "{slowest}");
        // So much time that the still picture itself keeps to it.
        bench.session.scene.settings.view.still_ms = 60_000.0;
        bench.settle();
        let (request, settings) = chosen(&bench);
        assert_eq!((settings.reflection.method, settings.gi.vpls), (Method::SurfelTrace, 1024));
        let told = bench.session.auto.told(&bench.session.picture()).expect("it is told");
        assert!(told.contains("gi.vpls=1024") && told.contains("60000ms"), "{told}");
        // The person's own settings stay as they are.
        assert_eq!(bench.session.scene.settings.reflection.method, Method::Auto);
        // Another view of the same scene is drawn with the same choice.
        bench.session.scene.camera.eye.z += 0.1;
        bench.settle();
        let (again, settings) = chosen(&bench);
        assert!(again == request && settings.gi.vpls == 1024, "not chosen anew");
        // What was learned of the first view gives settings at once, which are measured afterwards.
        assert_eq!(choices(&bench), [true], "nothing was known of other views");
        bench.session.scene.settings.mirror.fresnel = 0.5;
        bench.settle();
        assert_eq!(choices(&bench), [true, false, true]);
        let (anew, _) = chosen(&bench);
        assert!(anew.settings.mirror.fresnel == 0.5 && anew.camera != request.camera, "chosen for what is seen now");
        // A method that is named is drawn with the settings as they are.
        bench.session.scene.settings.reflection.method = Method::EnvironmentMap;
        bench.settle();
        let settings = &bench.session.still_frame().expect("a still picture").settings;
        assert_eq!((settings.reflection.method, settings.gi.vpls), (Method::EnvironmentMap, 4));
    }
}
