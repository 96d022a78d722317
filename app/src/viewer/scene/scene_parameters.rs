//! The parameters that a scene brings in the place of the person's own. They belong to the scene, and are kept for no
//! other file. What a person changes meanwhile is kept.

use scene::{Settings, Stream, View};

/// What a scene has brought.
pub struct SceneParameters {
    /// The person's own parameters.
    own: Settings,
    /// The parameters that the scene names, all others at their defaults.
    named: Settings,
    /// The parameters that the scene opened with: beside those that it names, the person's budgets.
    given: Settings,
}

impl SceneParameters {
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
