//! What the window shows when nothing is named: a built-in scene with a ball to take in hand. It makes room for the
//! first file that is opened, and takes its own parameters with it; those that the person changed meanwhile stay.

use scene::{Camera, Settings, pool};
use world::{Input, Request};

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::history::History;
use crate::viewer::scene::Scene;

pub struct FirstLook {
    /// The view that it opened with, to which `Home` goes back.
    pub camera: Camera,
    /// Whether the ball has been selected.
    has_ball: bool,
}

impl FirstLook {
    /// Gives the scene's request its own sun and sky beside the other parameters of the person. `None` if that is not
    /// what is requested.
    pub fn of(request: &mut Request, own: &Settings) -> Option<Self> {
        let names: Vec<String> = request.inputs.iter().map(Input::name).collect();
        let view = request.view.as_mut().filter(|_| names == [world::first_scene()])?;
        view.settings = own.with_changes(&Settings::default(), &view.settings);
        let camera = view.camera?;
        Some(Self { camera, has_ball: false })
    }

    /// Selects the ball when it has come, so that its handles invite a hand.
    pub fn offer_ball(&mut self, scene: &mut Scene) {
        let ball = scene.objects.mirrors.iter().find(|placed| placed.mirror.name == pool::BALL);
        if let Some(ball) = ball.filter(|_| !self.has_ball) {
            self.has_ball = true;
            scene.selected = Some(ball.id);
        }
    }

    /// Closes the scene, and brings the person's own parameters back.
    pub fn leave(loaded: &mut Loaded, beside: &mut Beside<'_>) {
        loaded.close_all(beside);
        (beside.scene.selected, beside.scene.opening) = (None, None);
        beside.scene.take_own_settings();
        // Nobody wants the scene back by undoing.
        beside.scene.history = History::default();
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::outside::{Effect, News};
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::session::Session;

    use super::*;

    /// A session that has read its first look.
    fn session() -> Session {
        let mut session = Session::new(Preferences::default());
        (session.scene.settings.scene.points, session.scene.settings.view.frame_ms) = (3000, 77.0);
        session.open_request(world::resolve(&[world::first_scene()]));
        read(&mut session);
        session
    }

    /// Reads what the session wants to load.
    fn read(session: &mut Session) {
        for effect in std::mem::take(&mut session.outside.effects) {
            let Effect::Load { inputs } = effect else { continue };
            let job = world::start(inputs.clone(), &session.scene.settings, Default::default());
            let id = session.loaded.add_job(&inputs, job.progress.clone(), job.mailbox.clone(), session.outside.now);
            job.events.iter().for_each(|event| session.on_news(News::Loading(id, event, None)));
        }
    }

    #[test]
    fn the_ball_is_selected_and_own_parameters_are_kept() {
        let session = session();
        let selected = session.scene.selected.and_then(|id| session.scene.objects.mirror(id));
        assert_eq!(selected.map(|mirror| mirror.name.as_str()), Some(pool::BALL));
        let settings = &session.scene.settings;
        assert_eq!((settings.view.frame_ms, settings.reflection.bounces), (77.0, 2));
        let own = session.scene.own_settings();
        assert_eq!((own.view.frame_ms, own.reflection.bounces), (77.0, Settings::default().reflection.bounces));
    }

    #[test]
    fn a_file_takes_the_place_of_the_first_look() {
        let mut session = session();
        // A parameter that the scene has brought, and one that it has not, are changed by hand.
        (session.scene.settings.tone.exposure, session.scene.settings.splat.min_pixels) = (-1.0, 2.0);
        let own = session.scene.own_settings();
        assert_eq!((own.tone.exposure, own.splat.min_pixels), (-1.0, 2.0));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("three.ply");
        let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            end_header\n0 0 0\n1 0 0\n0 1 0\n";
        std::fs::write(&path, text).unwrap();
        session.act(Action::Open(path.display().to_string().into()));
        assert!(session.loaded.clouds.is_empty() && session.scene.objects.mirrors.is_empty());
        assert!(!session.scene.camera_is_placed && session.scene.settings == own);
        read(&mut session);
        let names: Vec<&str> = session.loaded.clouds.iter().map(|entry| entry.cloud.name.as_str()).collect();
        assert_eq!(names, ["three.ply"]);
        // A second file comes beside the first, and so does the scene.
        for name in ["five-mirrors/none", "courtyard/pool"] {
            session.act(Action::Open(name.into()));
            assert!(session.loaded.clouds.len() == 1 && session.first_look.is_none(), "{name}");
        }
    }

    #[test]
    fn the_scene_leaves_no_parameters_behind_when_it_is_opened_by_name() {
        let mut session = Session::new(Preferences::default());
        session.act(Action::Open("courtyard/pool".into()));
        read(&mut session);
        assert!(session.scene.settings.view.background != Settings::default().view.background);
        assert_eq!(session.scene.own_settings(), Settings::default());
    }

    #[test]
    fn a_drag_upwards_leaves_the_eye_above_the_floor() {
        let mut session = session();
        for _ in 0..20 {
            session.act(Action::Orbit(DVec2::new(3.0, -40.0)));
        }
        let low = session.scene.camera.eye.y;
        assert!(low > 0.2 && low < 0.4, "{low}");
        session.act(Action::Open("five-mirrors/none".into()));
        assert_eq!(session.scene.confines.ground, None);
    }

    #[test]
    fn home_brings_back_the_view_that_the_scene_opened_with() {
        let mut session = session();
        let opened = session.scene.camera;
        session.act(Action::Orbit(DVec2::new(30.0, 10.0)));
        assert!(session.scene.camera != opened);
        session.act(Action::FrameAll);
        assert_eq!(session.scene.camera, opened);
    }

    #[test]
    fn closing_the_scene_by_hand_brings_the_own_parameters_back() {
        let mut session = session();
        let own = session.scene.own_settings();
        session.act(Action::RemoveCloud(session.loaded.clouds[0].key));
        assert!(session.first_look.is_none() && session.scene.settings == own);
    }
}
