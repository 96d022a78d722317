//! What a scene has brought over the person's own parameters. It belongs to the scene: it is kept for no other file, and
//! what a person changes meanwhile is kept.

use scene::{Settings, Stream, View};

pub struct Lent {
    /// The person's own parameters.
    own: Settings,
    /// The parameters that the scene names, all others at their defaults.
    named: Settings,
    /// The parameters that the scene opened with: beside those that it names, the person's budgets.
    given: Settings,
}

impl Lent {
    /// What a scene file or another view brings to a person with these parameters. Budgets change no picture, and are the
    /// person's where the scene does not name them.
    pub fn new(view: &View, own: Settings) -> Self {
        let mut budgets = Settings::default();
        budgets.view.frame_ms = own.view.frame_ms;
        let Stream { host_bytes, gpu_bytes, cache_bytes, .. } = own.stream;
        budgets.stream = Stream { host_bytes, gpu_bytes, cache_bytes, ..budgets.stream };
        let given = budgets.with_changes(&Settings::default(), &view.settings);
        Self { own, named: view.settings.clone(), given }
    }

    pub fn given(&self) -> &Settings {
        &self.given
    }

    /// The person's own parameters, with what has been changed since.
    pub fn own(&self, now: &Settings) -> Settings {
        self.own.with_changes(&self.given, now)
    }

    /// What the scene named, with what has been changed since.
    pub fn named(&self, now: &Settings) -> Settings {
        self.named.with_changes(&self.given, now)
    }
}
