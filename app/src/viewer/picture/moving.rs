//! Moving pictures where the adapter is a processor: `render::QuickPicture` draws them, in the light of the last picture at
//! rest.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::PointTest;
use render::{
    Detail, FrameStats, Gpu, Known, KnownLight, PictureRows, PointStore, QuickPicture, ReflectedShare, Renderer,
};
use scene::{Camera, LightClues, LightView, Lighting, Method, Mirror, Settings, Show, SpotLight, Tone};
use world::Resident;

use crate::viewer::picture::frame_request::{FrameRequest, hurried};
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::picture::pace::Spared;

#[derive(Default)]
pub struct MovingPictures {
    quick: QuickPicture,
    /// The light of the last picture at rest.
    light: Option<(LightInputs, Arc<KnownLight>)>,
    mirrors: Option<Reflections>,
    reflected: ReflectedPace,
    /// The mirrors of the last picture at rest, if there was one, whose points stand where they stood there, its camera,
    /// and its reflections in one another.
    stand: Option<(Vec<Mirror>, Camera, u32)>,
    /// Why coarse frames fail, since the last one that did not.
    failure: Option<String>,
    /// Whether the passes of a frame with mirrors are compiled.
    pub can_reflect: bool,
    /// Whether the picture in the window is a quick one.
    pub is_shown: bool,
}

/// What the light of a picture depends on, besides points and camera.
#[derive(PartialEq)]
struct LightInputs {
    /// The settings that affect shading; the others are at their defaults.
    settings: Settings,
    tone: Tone,
    lights: Vec<SpotLight>,
    clues: LightClues,
}

impl LightInputs {
    fn new(request: &FrameRequest) -> Self {
        // A picture at rest and a hurried one of the same values have the same light.
        let settings = hurried(&request.settings, false);
        let tone = settings.tone.clone();
        let settings = settings.only(|field| field.affects.shading);
        Self { settings, tone, lights: request.lights.clone(), clues: request.clues }
    }
}

/// What mirrors show depends on, besides points and camera.
#[derive(PartialEq)]
struct MirrorInputs {
    light: LightInputs,
    settings: Settings,
    mirrors: Vec<Mirror>,
    test: PointTest,
}

impl MirrorInputs {
    fn new(request: &FrameRequest) -> Self {
        // A picture at rest and a hurried one of the same values show the same, as for light.
        let settings = hurried(&request.settings, false).only(|field| field.affects.found);
        let FrameRequest { mirrors, test, .. } = request;
        Self { light: LightInputs::new(request), settings, mirrors: mirrors.clone(), test: test.clone() }
    }
}

/// Chooses how many points mirrors reflect in coarse frames.
#[derive(Default)]
struct ReflectedPace {
    /// The number for frames of a method, after a frame of it.
    learned: Option<(Method, u64)>,
}

impl ReflectedPace {
    /// Two cores search for so many in a tenth of a second, by the method that takes the longest for each.
    const FIRST: u64 = 32_768;
    /// The time that a coarse frame may take, in milliseconds.
    const WANTED: f64 = 120.0;
    const LEAST: f64 = 8192.0;
    const MOST: f64 = 1e9;

    /// The most points that mirrors reflect in the next coarse frame.
    fn most(&self, settings: &Settings) -> u64 {
        let method = settings.reflection.method.chosen();
        self.learned.filter(|(of, _)| *of == method).map_or(Self::FIRST, |(_, most)| most)
    }

    /// Learns from a coarse frame.
    fn learn(&mut self, settings: &Settings, stats: &FrameStats) {
        if !stats.has_compiled {
            // Not all of the time is that of these points.
            let change = (Self::WANTED / stats.frame_milliseconds.max(1.0)).clamp(0.5, 1.5);
            let most = (self.most(settings) as f64 * change).clamp(Self::LEAST, Self::MOST);
            self.learned = Some((settings.reflection.method.chosen(), most as u64));
        }
    }
}

/// What mirrors show in a coarse frame, or in the last picture at rest.
struct Reflections {
    /// When the coarse frame was begun, or handed over if a picture waited for it, or when a moving picture first showed
    /// what the one at rest does.
    since: Option<Instant>,
    of: MirrorInputs,
    /// The revision of the points, and whether it is that of the picture at rest. Coarse frames may lag behind theirs.
    points: u64,
    is_rest: bool,
    /// How long the coarse frame took to draw.
    took: Duration,
    known: Arc<KnownLight>,
    share: ReflectedShare,
}

/// What is known of what mirrors show in a hurried frame, however long ago.
fn reflections<'a>(known: Option<&'a Reflections>, request: &FrameRequest) -> Option<&'a Reflections> {
    let is_of_points = |known: &Reflections| !known.is_rest || known.points == request.revision;
    known.filter(|known| is_of_points(known) && known.of == MirrorInputs::new(request))
}

/// The pixels that a frame draws, as a share of those that it fills on the screen.
fn share_of_pixels(request: &FrameRequest) -> f64 {
    1.0 / f64::from(request.spared.unwrap_or(Spared::NOTHING).divisor).powi(2)
}

/// Whether the points of a picture show their own colours, without light.
fn is_unlit(request: &FrameRequest) -> bool {
    request.settings.resolved_light(!request.lights.is_empty(), request.clues).by == Lighting::Colors
}

/// How long after a coarse frame was begun the next one is, or after it was done if a picture waited for it: five times as
/// long as it took to draw, so that most of the time is left for the pictures themselves, but at least and at most so long.
const MIRRORS_STAY: [Duration; 2] = [Duration::from_millis(300), Duration::from_millis(1200)];
/// The pixels of the screen that each pixel of the coarse frame fills, along each side.
const OF_MIRRORS: u32 = 5;
/// The most reflections in one another that mirrors show in the coarse frame while the camera moves.
const MOST_BOUNCES: u32 = 2;
/// The pixels of the screen that each pixel of the coarse frame fills where only parameters change.
const OF_STANDING_MIRRORS: u32 = 3;

impl MovingPictures {
    /// Whether the processor may draw a frame: where the adapter is one too, the picture is shown and nothing else, and no
    /// mirror moves.
    fn can_draw(&self, gpu: &Gpu, request: &FrameRequest) -> bool {
        let settings = &request.settings;
        let is_picture = settings.light.show == LightView::Picture && settings.reflection.show == Show::Picture;
        let stand = self.stand.as_ref().is_none_or(|(mirrors, ..)| *mirrors == request.mirrors);
        gpu.is_processor() && is_picture && stand
    }

    /// Whether mirrors reflect in quick pictures. The first ones do not wait until the passes for that are compiled.
    pub fn reflects(&self, store: &PointStore, request: &FrameRequest) -> bool {
        self.can_reflect && (!request.mirrors.is_empty() || store.has_mirrors())
    }

    /// The coarse frame that the renderer must draw, and `keep_mirrors` get, before a hurried frame can be a quick
    /// picture; `None` if it needs none, or cannot be one.
    pub fn lacks(&self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<FrameRequest> {
        let reflects = self.reflects(store, request);
        if !reflects || !self.can_draw(gpu, request) || reflections(self.mirrors.as_ref(), request).is_some() {
            return None;
        }
        Some(self.coarse(request))
    }

    /// The coarse frame that the renderer should draw, and `keep_mirrors` get, after a quick picture, because what mirrors
    /// show in it has stayed for long enough.
    pub fn is_due(&self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<FrameRequest> {
        let known = reflections(self.mirrors.as_ref(), request)?;
        let stays = match known.points == request.revision {
            true => (known.took * 5).clamp(MIRRORS_STAY[0], MIRRORS_STAY[1]),
            // Mirrors must not go on to show clouds that are gone, but while points arrive half of the time is for pictures.
            false => known.took * 2,
        };
        let is_due = known.since.is_some_and(|since| since.elapsed() >= stays);
        (is_due && self.reflects(store, request) && self.can_draw(gpu, request)).then(|| self.coarse(request))
    }

    /// Puts off the coarse frame that is due, because drawing it failed. Whether that is another failure than the last one.
    pub fn put_off(&mut self, failure: &str) -> bool {
        if let Some(mirrors) = &mut self.mirrors {
            mirrors.since = Some(Instant::now());
        }
        self.failure.replace(failure.to_owned()).as_deref() != Some(failure)
    }

    /// The coarse frame for a hurried one.
    pub fn coarse(&self, request: &FrameRequest) -> FrameRequest {
        self.coarse_of(request, self.stand.as_ref().is_some_and(|(_, camera, _)| *camera == request.camera))
    }

    /// The coarse frame for a hurried one, where the camera `stands` or moves.
    pub fn coarse_of(&self, request: &FrameRequest, stands: bool) -> FrameRequest {
        // Where the camera stands, the surface is kept from one frame to the next.
        let divisor = if stands { OF_STANDING_MIRRORS } else { OF_MIRRORS };
        let pixels = request.size.map(|edge| u64::from(edge / divisor)).iter().product();
        let most_reflected = Some(self.reflected.most(&request.settings));
        let spared = Spared { divisor, most_points: Some(pixels), most_reflected };
        let mut coarse = FrameRequest { spared: Some(spared), ..request.clone() };
        // What mirrors show of one another is missed more than finer pixels.
        if let Some((.., bounces)) = self.stand.as_ref().filter(|_| !stands) {
            let own = &mut coarse.settings.reflection.bounces;
            *own = if *own > 0 { (*bounces).min(MOST_BOUNCES).max(*own) } else { 0 };
        }
        coarse
    }

    /// Draws a hurried frame, if the adapter is a processor, and the light on the points and what mirrors show is known.
    /// Before the first picture at rest, points show their own colours, and mirrors a plain one until they can reflect.
    pub fn draw(&mut self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<(FrameStats, PictureRows)> {
        let FrameRequest { camera, settings, .. } = request;
        let reflects = self.reflects(store, request);
        if let Some(mirrors) = &mut self.mirrors {
            mirrors.since.get_or_insert_with(Instant::now);
        }
        let mirrors = reflections(self.mirrors.as_ref(), request).filter(|_| reflects);
        if !self.can_draw(gpu, request) || reflects && mirrors.is_none() {
            return None;
        }
        // The coarse frame knows the light, too.
        let inputs = LightInputs::new(request);
        let shown = mirrors.map(|mirrors| &*mirrors.known);
        let known = self.light.as_ref().filter(|(of, _)| *of == inputs).map(|(_, light)| &**light).or(shown);
        let light = known.filter(|_| !is_unlit(request));
        if light.is_none() && !is_unlit(request) && self.stand.is_some() {
            return None;
        }
        let Spared { divisor, most_points, .. } = request.spared.unwrap_or(Spared::NOTHING);
        let detail = Detail { most_points, coarseness: divisor };
        let known = Known { light, mirrors: shown };
        let mut stats = self.quick.draw(store, camera, settings, request.drawn_size(), detail, known);
        stats.reflected = mirrors.map(|mirrors| mirrors.share);
        self.is_shown = true;
        Some((stats, self.quick.take_rows()))
    }

    /// Keeps what mirrors show in the coarse frame that the renderer holds, and that took the time of `stats`; `since` is
    /// when it was begun, or when it was done if a picture waited for it.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_mirrors(
        &mut self,
        renderer: &Renderer,
        request: &FrameRequest,
        since: Instant,
        stats: &FrameStats,
    ) -> render::Result<()> {
        self.failure = None;
        self.reflected.learn(&request.settings, stats);
        let known = renderer.known_light(&request.settings)?;
        let share =
            ReflectedShare { pixels: share_of_pixels(request), ..stats.reflected.unwrap_or(ReflectedShare::ALL) };
        // Compiling is no part of it.
        let milliseconds = if stats.has_compiled { 0.0 } else { stats.frame_milliseconds };
        let took = Duration::try_from_secs_f64(milliseconds * 1e-3).unwrap_or_default();
        let (since, of, known) = (Some(since), MirrorInputs::new(request), Arc::new(known));
        self.mirrors = Some(Reflections { since, of, points: request.revision, is_rest: false, took, known, share });
        Ok(())
    }

    /// Keeps the light of the frame that the renderer holds, which is a picture at rest, for the pictures that follow, and
    /// what mirrors show in it for the first of them.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_light(
        &mut self,
        gpu: &Gpu,
        renderer: &Renderer,
        store: &PointStore,
        request: &FrameRequest,
    ) -> render::Result<()> {
        (self.light, self.mirrors) = (None, None);
        self.stand = Some((request.mirrors.clone(), request.camera, request.settings.reflection.bounces));
        let reflects = self.reflects(store, request);
        if gpu.is_processor() && (reflects || !is_unlit(request)) {
            let known = Arc::new(renderer.known_light(&request.settings)?);
            if reflects {
                let (of, points) = (MirrorInputs::new(request), request.revision);
                let share = ReflectedShare { pixels: share_of_pixels(request), ..ReflectedShare::ALL };
                let known = known.clone();
                let took = Duration::ZERO;
                self.mirrors = Some(Reflections { since: None, of, points, is_rest: true, took, known, share });
            }
            self.light = Some((LightInputs::new(request), known)).filter(|_| !is_unlit(request));
        }
        Ok(())
    }

    /// The point near a pixel of the frame in the window, if that is a quick picture.
    pub fn pick(&self, resident: &Resident, shown: Option<&FrameRequest>, pixel: [u32; 2]) -> Option<PickedPoint> {
        let (drawn, radius) = shown.filter(|_| self.is_shown)?.picked(pixel);
        PickedPoint::new(resident, self.quick.pick(&resident.store, drawn, radius)?)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn mirrors_show_one_another_in_coarse_frames_of_moving_cameras_as_often_as_at_rest_but_twice_at_most() {
        let request = FrameRequest { hurried: true, ..FrameRequest::any() };
        let elsewhere = Camera { eye: request.camera.eye + DVec3::X, ..request.camera };
        for (at_rest, coarse) in [(0, 1), (1, 1), (2, 2), (4, 2)] {
            let moving = |camera| MovingPictures { stand: Some((Vec::new(), camera, at_rest)), ..Default::default() };
            let request = &request;
            assert_eq!(moving(elsewhere).coarse(request).settings.reflection.bounces, coarse);
            // The other values that change a picture need all of its time.
            let own = request.settings.reflection.bounces;
            assert_eq!(moving(request.camera).coarse(request).settings.reflection.bounces, own);
            // It shows what the hurried frame needs, all the same.
            assert!(MirrorInputs::new(&moving(elsewhere).coarse(request)) == MirrorInputs::new(request));
        }
    }
}
