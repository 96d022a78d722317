//! The person's own parameters, while a scene shows those of its file. What a scene brings belongs to the scene: it is
//! kept for no other file, and what a person changes meanwhile is kept.

use param::{Affects, Field};
use scene::{Settings, View};

use crate::viewer::session::Session;

/// What a scene has brought.
pub struct Lent {
    /// The person's own parameters.
    pub own: Settings,
    /// The parameters that the scene opened with.
    pub given: Settings,
}

impl Lent {
    /// The person's own parameters, with what has been changed since.
    pub fn own(&self, now: &Settings) -> Settings {
        self.own.with_changes(&self.given, now)
    }
}

/// The parameters of a scene file: where it names none, those that change no picture are the person's, and all others
/// the defaults, so that the scene looks the same for everybody.
pub fn of_scene(view: &View, own: &Settings) -> Settings {
    let is_budget = |field: &Field| field.affects == Affects::default() && field.uses.kept;
    own.only(is_budget).with_changes(&Settings::default(), &view.settings)
}

/// The parameters to keep for the next start and for the next file.
pub fn own_settings(session: &Session) -> Settings {
    let now = &session.scene.settings;
    session.lent.as_ref().map_or_else(|| now.clone(), |lent| lent.own(now))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::preferences::Preferences;

    #[test]
    fn what_a_scene_brings_stays_with_it_and_what_a_person_changes_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, parameters: &str| {
            let path = folder.path().join(name);
            let clouds = "clouds = [\"five-mirrors/none\"]\n";
            std::fs::write(&path, format!("{clouds}\n[parameters]\n{parameters}")).unwrap();
            Action::Open(path.display().to_string().into())
        };
        let mut preferences = Preferences::default();
        let mut own = Settings::default();
        (own.splat.size, own.view.frame_ms) = (3.0, 77.0);
        preferences.remember_settings(&own);

        let mut session = Session::new(preferences.clone());
        session.act(file("plain.toml", ""));
        let now = &session.scene.settings;
        let default = Settings::default().splat.size;
        assert_eq!((now.splat.size, now.view.frame_ms), (default, 77.0), "as on any other machine");
        assert_eq!(own_settings(&session), own);

        let mut session = Session::new(preferences);
        session.act(file("large.toml", "\"splat.size\" = 6.0\n\"view.frame_ms\" = 20.0\n"));
        let now = &mut session.scene.settings;
        assert_eq!((now.splat.size, now.view.frame_ms), (6.0, 20.0));
        now.tone.exposure = -1.0;
        own.tone.exposure = -1.0;
        assert_eq!(own_settings(&session), own);
        session.act(file("plain.toml", ""));
        assert_eq!(session.scene.settings.splat.size, default);
        assert_eq!(own_settings(&session), own);
    }
}
