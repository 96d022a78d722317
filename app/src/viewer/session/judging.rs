//! The truth, the tuning chart and sweeps as parts of the session: what they read of it, and what follows from answers.

use std::path::PathBuf;
use std::time::Duration;

use crate::viewer::filming::Wiping;
use crate::viewer::jobs::tasks::Answer;
use crate::viewer::look::tab::Tab;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::session::Session;
use crate::viewer::truth::Around;
use crate::viewer::truth::sweep::Sweeps;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::{Taken, TruthView};

impl Session {
    /// Calls `act` with what the truth and a sweep read from the session, and with the parts that they change.
    fn with_truth<R>(
        &mut self,
        act: impl FnOnce(&Around<'_>, &mut TruthView, &mut Tuning, &mut Sweeps, &mut Wiping, &mut Outside) -> R,
    ) -> R {
        let around = Around {
            still: self.still_frame().cloned(),
            clouds: &self.loaded.clouds,
            samples: &self.loaded.samples,
            settings: &self.scene.settings,
            test: self.scene.objects.test(),
            frames: &self.frames,
            raw_colors: self.raw_colors,
            is_taken: self.sweeps.under_way.is_some() || self.filming.timeline.wiping.is_tracing(),
        };
        let wiping = &mut self.filming.timeline.wiping;
        act(&around, &mut self.truth, &mut self.tuning, &mut self.sweeps, wiping, &mut self.outside)
    }

    /// Advances the sweep and the truth by one step. Returns the time after which to call again.
    pub fn sync_truth(&mut self) -> Option<Duration> {
        self.with_truth(|around, truth, _, sweeps, _, outside| sweeps.sync(around, truth, outside));
        // A sweep draws other frames.
        let still = self.still_frame().filter(|_| self.sweeps.under_way.is_none()).cloned();
        let estimate = self.truth.live.sync(still.as_ref(), &mut self.outside);
        self.with_truth(|around, truth, _, _, wiping, outside| wiping.sync(around, truth, outside));
        let truth = self.with_truth(|around, truth, tuning, _, _, outside| truth.sync(around, tuning, outside));
        estimate.into_iter().chain(truth).min()
    }

    pub fn start_sweep(&mut self, key: &str, values: Vec<String>, places: &[PathBuf]) {
        self.with_truth(|around, _, _, sweeps, _, outside| sweeps.start(key, values, places, around, outside));
    }

    /// Shows the tuning chart in its tab, or closes it where it is in view.
    pub fn toggle_chart(&mut self) {
        let preferences = &mut self.preferences;
        let is_in_view = preferences.panel_is_open
            && !self.interface_is_hidden
            && self.search.trim().is_empty()
            && Tab::named(&preferences.tab) == Tab::Tuning;
        self.tuning.is_open = !(self.tuning.is_open && is_in_view);
        if self.tuning.is_open {
            (preferences.panel_is_open, self.interface_is_hidden) = (true, false);
            preferences.tab = Tab::Tuning.name().to_owned();
            self.search.clear();
        }
    }

    /// Stops all work for the truth, the chart and a sweep.
    pub fn stop_truth(&mut self) {
        self.truth.stop();
        self.tuning.is_open = false;
        self.sweeps.stop(&mut self.outside);
    }

    /// Handles a truth that cannot be computed: nothing more is requested, or the current value of a sweep has failed.
    pub(super) fn on_not_judged(&mut self, problem: &str) {
        self.truth.on_not_judged();
        self.tuning.forget_measuring();
        if !self.sweeps.on_failed(problem, &mut self.outside) {
            self.stop_truth();
            self.outside.say(Level::Error, format!("The truth cannot be shown: {problem}"));
        }
    }

    pub fn on_truth(&mut self, answer: Answer) {
        let Some(answer) = self.filming.timeline.wiping.take_answer(answer, &mut self.outside) else { return };
        match self.truth.on_answer(answer, self.frames.revision) {
            Taken::Nothing => {}
            Taken::Log(event) => self.outside.log(event),
            Taken::Swept(swept) => self.sweeps.on_judged(swept, &mut self.tuning),
            Taken::Failed(problem) => self.on_not_judged(&problem),
        }
    }
}
