//! Pictures of a path that show several states side by side. Each state is drawn as the whole picture would be, and
//! gives its columns to it.

use std::cell::Cell;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, anyhow};
use cloud::{PointTest, Progress};
use scene::{Camera, Mirror, Profile, RAY_TRACE, Settings, SpotLight, WipeState};
use study::TracedScene;

use super::{Headless, Over, PictureStats, lock};
use crate::overlays;
use crate::system::interrupt;
use crate::system::progress_bar::{self, Bar};
use crate::viewer::jobs::tasks::{Answer, SceneKey, Source, Task};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Picture, Report};
use crate::viewer::session::Session;
use crate::viewer::truth::traced_points;
use crate::viewer::truth::view::{MOST_POINTS, too_many_points};

/// The parameter that says whether an exposure is fitted.
const FIT_KEY: &str = "tone.fit";

impl Headless {
    /// Returns the picture in which each state has its columns, with the overlays of each state in its part, and the
    /// captions, lines and names that are to be drawn over all. States differ from the settings that the scene has now,
    /// and share an exposure that is locked, unless they have a `tone.fit` of their own.
    /// `camera`, `now` and `bar` have the meaning of those of `picture`.
    ///
    /// # Errors
    /// Somebody pressed Ctrl-C, the picture cannot be drawn, or there are more points than can be traced.
    pub fn wiped(
        &mut self,
        states: &[WipeState],
        parts: &[(usize, Range<u32>)],
        camera: Camera,
        now: Instant,
        bar: &Bar,
    ) -> anyhow::Result<Option<(Picture, Over)>> {
        self.states.clear();
        let own = self.session.scene.settings.clone();
        let [width, height] = self.session.scene.view_size;
        let mut rgba = vec![0; width as usize * height as usize * 4];
        let (mut revision, mut made) = (0, Vec::new());
        for (index, columns) in parts {
            let (state, settings) = (&states[*index], &mut self.session.scene.settings);
            settings.clone_from(&own);
            settings.tone.clone_from(&self.tone);
            state.apply(settings)?;
            if let Some(stops) = self.locked.filter(|_| !state.parameters.contains_key(FIT_KEY)) {
                lock(&mut settings.tone, stops);
            }
            let Some(state) = self.state(state, camera, now, bar)? else { return Ok(None) };
            copy_columns(&mut rgba, &state.picture.rgba, columns, width);
            revision = state.picture.revision;
            self.states.push(state.stats.clone());
            made.push(state);
        }
        // Where only the line moves, the next picture shows the same states.
        self.made = made;
        self.session.scene.settings = own;
        // Overlays that are switched on lie in the states' pictures already.
        let over = Over { camera, settings: Settings::default(), facts: self.facts().take_titles() };
        Ok(Some((Picture { camera, revision, rgba, images: Vec::new() }, over)))
    }

    /// Returns the picture of a state with its overlays, whose settings the scene has: drawn anew unless the last
    /// picture shows it as well.
    fn state(
        &mut self,
        state: &WipeState,
        camera: Camera,
        now: Instant,
        bar: &Bar,
    ) -> anyhow::Result<Option<StatePicture>> {
        let Session { scene, .. } = &self.session;
        let view = StateView {
            is_traced: state.is_traced(),
            settings: scene.settings.clone(),
            camera,
            mirrors: scene.objects.mirrors.iter().map(|placed| placed.mirror.clone()).collect(),
            lights: scene.objects.lights.iter().map(|placed| placed.light).collect(),
            profiles: scene.objects.profiles.iter().map(|placed| placed.profile.clone()).collect(),
            test: scene.objects.test(),
        };
        if let Some(known) = self.made.iter().position(|known| known.view == view) {
            return Ok(Some(self.made.swap_remove(known)));
        }
        let drawn = if state.is_traced() { self.traced(camera, now, bar)? } else { self.drawn(camera, now, &[], bar)? };
        let Some(mut picture) = drawn else { return Ok(None) };
        let mut facts = self.facts();
        drop(facts.take_titles());
        let (scene, mut settings) = (&self.session.scene, view.settings.clone());
        settings.overlay.text *= self.supersample as f32;
        overlays::draw(&mut picture.rgba, scene.view_size, &scene.camera, &settings, &facts);
        let mut stats = self.stats_of_drawn(0.0);
        if state.is_traced() {
            stats.method = RAY_TRACE.into();
        }
        Ok(Some(StatePicture { view, picture, stats }))
    }

    /// Returns the picture without overlays whose mirrors show what the ray tracer finds.
    fn traced(&mut self, camera: Camera, now: Instant, bar: &Bar) -> anyhow::Result<Option<Picture>> {
        let Some(request) = self.settle(Some(camera), now, bar)? else { return Ok(None) };
        let scene = self.traced_scene(&request)?;
        let revision = request.revision;
        let capture = Command::Capture { request: Box::new(request.clone()), origin: scene.origin };
        let take = |report| if let Report::Captured(captured) = report { Ok(captured.drawn) } else { Err(report) };
        let drawn = self.answer(capture, take)?;
        let progress = Progress::default();
        let colors = progress_bar::watch_unseen(&progress, || request.ray_traced(&scene, drawn, &progress));
        interrupt::check()?;
        let (request, colors) = (Box::new(request), Arc::new(colors?));
        let present = Command::Present { request, colors, pass: 0, fits_exposure: true };
        let take = |report| if let Report::Presented { rgba, .. } = report { Ok(rgba) } else { Err(report) };
        let rgba = self.answer(present, take)?;
        Ok(Some(Picture { camera, revision, rgba, images: Vec::new() }))
    }

    /// The points of a frame for the ray tracer, prepared again only if they have changed.
    fn traced_scene(&mut self, request: &FrameRequest) -> anyhow::Result<Arc<TracedScene>> {
        let wanted = SceneKey::of(request);
        if let Some((_, scene)) = self.traced.as_ref().filter(|(key, _)| *key == wanted) {
            return Ok(scene.clone());
        }
        // Two of them need not fit into memory.
        self.traced = None;
        let loaded = &self.session.loaded;
        if traced_points(&loaded.clouds, &loaded.samples) > MOST_POINTS {
            return Err(anyhow!(too_many_points()));
        }
        let test = self.session.scene.objects.test();
        let sources = Source::all(&loaded.clouds, &loaded.samples, &self.session.scene.settings, &test);
        let progress = Arc::<Progress>::default();
        let build = Task::Build { key: wanted, sources, progress: progress.clone() };
        let built = Cell::new(None);
        let take = |answer| {
            if let Answer::Built { scene, .. } = answer {
                built.set(scene);
            }
        };
        progress_bar::watch_unseen(&progress, || build.run(take));
        interrupt::check()?;
        let scene = built.into_inner().context("the points cannot be prepared for the ray tracer")?;
        self.traced = Some((wanted, scene.clone()));
        Ok(scene)
    }
}

/// The picture of a state of a wipe.
pub(super) struct StatePicture {
    view: StateView,
    /// With the overlays of the state.
    picture: Picture,
    stats: PictureStats,
}

/// What the picture of a state follows from, besides the points.
#[derive(PartialEq)]
struct StateView {
    is_traced: bool,
    settings: Settings,
    camera: Camera,
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    /// Overlays draw them.
    profiles: Vec<Profile>,
    test: PointTest,
}

/// Copies columns of a picture with rows of `width` pixels into another of the same size.
fn copy_columns(into: &mut [u8], from: &[u8], columns: &Range<u32>, width: u32) {
    let bytes = columns.start as usize * 4..columns.end as usize * 4;
    let rows = into.chunks_exact_mut(width as usize * 4).zip(from.chunks_exact(width as usize * 4));
    rows.for_each(|(into, from)| into[bytes.clone()].copy_from_slice(&from[bytes.clone()]));
}
