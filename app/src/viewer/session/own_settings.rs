//! The parameters of the person and those of the scene that is open, which may have brought others.

use scene::Settings;

use crate::viewer::objects::history::History;
use crate::viewer::scene::Scene;
use crate::viewer::scene::scene_parameters::SceneParameters;

impl Scene {
    /// The person's own parameters: those to keep for the next start and for the next file.
    pub fn own_settings(&self) -> Settings {
        let own = |brought: &SceneParameters| brought.own(&self.settings);
        self.brought.as_ref().map_or_else(|| self.settings.clone(), own)
    }

    /// The parameters that are the scene's: those to save in its file.
    pub fn settings_to_save(&self) -> Settings {
        let named = |brought: &SceneParameters| brought.named(&self.settings);
        self.brought.as_ref().map_or_else(|| self.settings.clone(), named)
    }

    /// Brings the person's own parameters back. Undo does not go back behind that.
    pub fn take_own_settings(&mut self) {
        if self.brought.is_some() {
            self.settings = self.own_settings();
            (self.brought, self.history) = (None, History::default());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::session::Session;

    /// The person's own parameters, and a session with them.
    fn session() -> (Settings, Session) {
        let mut own = Settings::default();
        (own.splat.size, own.view.frame_ms, own.overlay.legend) = (3.0, 77.0, true);
        let mut preferences = Preferences::default();
        preferences.remember_settings(&own);
        (own, Session::new(preferences))
    }

    fn open(session: &mut Session, folder: &tempfile::TempDir, parameters: &str) {
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, format!("clouds = [\"five-mirrors/none\"]\n\n[parameters]\n{parameters}")).unwrap();
        session.act(Action::Open(path.display().to_string().into()));
    }

    #[test]
    fn a_scene_that_names_no_parameters_looks_the_same_for_everybody() {
        let folder = tempfile::tempdir().unwrap();
        let (own, mut session) = session();
        open(&mut session, &folder, "");
        let now = &session.scene.settings;
        let default = Settings::default();
        assert_eq!((now.splat.size, now.overlay.legend), (default.splat.size, default.overlay.legend));
        assert_eq!(now.view.frame_ms, 77.0, "a budget is the machine's");
        assert_eq!(session.scene.own_settings(), own);
        assert_eq!(session.scene.settings_to_save(), default, "nothing of the person's is saved with it");
    }

    #[test]
    fn what_a_scene_brings_stays_with_it_and_what_a_person_changes_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (mut own, mut session) = session();
        open(&mut session, &folder, "\"splat.size\" = 6.0\n\"view.frame_ms\" = 20.0\n");
        let now = &mut session.scene.settings;
        assert_eq!((now.splat.size, now.view.frame_ms), (6.0, 20.0));
        now.tone.exposure = -1.0;
        own.tone.exposure = -1.0;
        assert_eq!(session.scene.own_settings(), own);
        assert_eq!(session.scene.settings_to_save(), session.scene.settings);
        open(&mut session, &folder, "");
        assert_eq!(session.scene.settings.splat.size, Settings::default().splat.size);
        assert_eq!(session.scene.own_settings(), own);
        session.scene.take_own_settings();
        session.act(Action::Undo);
        assert_eq!(
            (&session.scene.settings, session.scene.own_settings()),
            (&own, own.clone()),
            "nothing to go back to"
        );
        assert_eq!(session.scene.settings_to_save(), own);
    }
}
