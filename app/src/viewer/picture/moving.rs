//! Moving pictures where the adapter is a processor: `render::QuickPicture` draws them, in the light of the last picture at
//! rest.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::{PointTest, Progress};
use glam::DVec3;
use render::{
    Adaptation, Detail, EarlierLight, FrameStats, Gpu, Known, KnownLight, PictureRows, PointStore, QuickPicture,
    ReflectedShare, Renderer,
};
use scene::{Camera, LightClues, LightView, Lighting, Method, Mirror, Settings, Show, SpotLight, Tone};
use world::{Change, ChunkKey, Part, Resident};

use crate::viewer::picture::frame_request::{FrameRequest, frame_of, hurried};
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::picture::pace::{Spared, adapted_share};

#[derive(Default)]
pub struct MovingPictures {
    quick: QuickPicture,
    /// The light of the last picture at rest.
    light: Option<(LightInputs, Arc<KnownLight>)>,
    /// Its light and that of those before it; `None` if the points have changed since.
    earlier: Option<EarlierLight>,
    coarse: Option<CoarseFrame>,
    /// Whether the last quick picture shows much that no picture at rest has lit.
    is_beyond_rest: bool,
    reflected: ReflectedPace,
    trail: Trail,
    /// The mirrors of the last picture at rest, if there was one, whose points stand where they stood there, its camera,
    /// and its reflections in one another.
    stand: Option<(Vec<Mirror>, Camera, u32)>,
    /// The exposure of the last picture that was drawn for the window, in stops without those of `tone.exposure`, and when
    /// that was begun, if it was fitted.
    exposure: Option<(f32, Instant)>,
    /// When the last coarse frame failed, and why, if none was drawn since.
    failure: Option<(Instant, String)>,
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

/// What mirrors show, and the light on what pictures at rest do not show, depends on, besides points and camera.
#[derive(PartialEq)]
struct CoarseInputs {
    light: LightInputs,
    settings: Settings,
    mirrors: Vec<Mirror>,
    test: PointTest,
}

impl CoarseInputs {
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

/// The way of the camera through the last moving pictures.
#[derive(Default)]
struct Trail(VecDeque<(Instant, Camera)>);

impl Trail {
    /// How long a part of the way says how the camera moves.
    const KNOWN: Duration = Duration::from_millis(150);
    /// Pictures that are further apart are of two movements.
    const REST: Duration = Duration::from_millis(400);
    /// The longest time for which a camera is expected to go on as it goes.
    const AHEAD: Duration = Duration::from_millis(500);

    fn go_to(&mut self, camera: Camera, now: Instant) {
        let is_jump = |(at, before): &(Instant, Camera)| now - *at > Self::REST || !is_near(before, &camera);
        if self.0.back().is_some_and(is_jump) {
            self.0.clear();
        }
        self.0.push_back((now, camera));
        while self.0.get(1).is_some_and(|(at, _)| now - *at >= Self::KNOWN) {
            self.0.pop_front();
        }
    }

    /// Where a camera will be after some time if it goes on as through the last pictures: in the same time it steps and
    /// turns as far, as seen from itself, so that orbits stay orbits.
    fn ahead(&self, camera: Camera, now: Instant, time: Duration) -> Camera {
        let (Some((from, before)), Some((to, last))) = (self.0.front(), self.0.back()) else { return camera };
        if before == last || from == to || now - *to > Self::REST {
            return camera;
        }
        let turn = last.view_from_world().transpose() * before.view_from_world();
        let go_on = |place: DVec3| last.eye + turn * (place - before.eye);
        let steps = time.min(Self::AHEAD).as_secs_f64() / (*to - *from).as_secs_f64();
        let mut there = camera;
        for _ in 0..steps.round() as u32 {
            let next = Camera::from_eye(go_on(there.eye), go_on(there.pivot), there.up);
            // Who flies to something stops before it, and nobody knows the walls beyond.
            if !is_near(&camera, &next) {
                break;
            }
            there = next;
        }
        there
    }
}

/// Whether a camera may have moved from one view to the other: the eye by no more than half of its distance from what it
/// looks at, and the line of sight by less than 45 degrees.
fn is_near(from: &Camera, to: &Camera) -> bool {
    from.eye.distance(to.eye) <= 0.5 * from.distance() && from.forward().dot(to.forward()) > 0.7
}

/// What mirrors show, and the light on the points, in a coarse frame or in the last picture at rest.
struct CoarseFrame {
    /// When the coarse frame was begun, or handed over if a picture waited for it, or when a moving picture first showed
    /// what the one at rest does.
    since: Option<Instant>,
    of: CoarseInputs,
    /// The revision of the points, and whether it is that of the picture at rest. Coarse frames may lag behind theirs.
    points: u64,
    is_rest: bool,
    /// How long the coarse frame took to draw, and until it was done, with the quick pictures that were drawn meanwhile.
    took: Duration,
    lasted: Duration,
    known: Arc<KnownLight>,
    share: ReflectedShare,
}

impl CoarseFrame {
    /// How long after a coarse frame for light alone was begun the next one is: light sticks to the points, other than
    /// what mirrors show.
    fn light_stays(&self) -> Duration {
        self.lasted + (self.took * 10).max(COARSE_STAYS[0] * 2)
    }

    fn is_older_than(&self, time: Duration) -> bool {
        self.since.is_some_and(|since| since.elapsed() >= time)
    }

    /// How long after the coarse frame was begun the next one is.
    fn stays(&self) -> Duration {
        (self.took * 5).clamp(COARSE_STAYS[0], COARSE_STAYS[1])
    }
}

/// The coarse frame, however long ago, that shows what mirrors show in a hurried frame.
fn coarse_for<'a>(known: Option<&'a CoarseFrame>, request: &FrameRequest) -> Option<&'a CoarseFrame> {
    let is_of_points = |known: &CoarseFrame| !known.is_rest || known.points == request.revision;
    known.filter(|known| is_of_points(known) && known.of == CoarseInputs::new(request))
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
const COARSE_STAYS: [Duration; 2] = [Duration::from_millis(300), Duration::from_millis(1200)];
/// The pixels of the screen that each pixel of the coarse frame fills, along each side.
const OF_COARSE: u32 = 5;
/// The share of the lit pixels whose light pictures at rest need not know, so that no coarse frame is drawn for it. A quarter
/// of it remains where coarse frames end again.
const MOST_UNLIT: f32 = 0.1;
/// The most reflections in one another that mirrors show in the coarse frame while the camera moves.
const MOST_BOUNCES: u32 = 2;
/// The pixels of the screen that each pixel of the coarse frame fills where only parameters change.
const OF_STANDING_MIRRORS: u32 = 3;

/// The views of what lies around the eye: squares of so many pixels along each side, which reach a little beyond the sides
/// of a cube.
const EDGE_AROUND: u32 = 256;
const FIELD_AROUND: f32 = 91.0;
/// The most points of each of them, of which fewer would leave holes.
const MOST_AROUND: u64 = 1 << 20;

/// The directions of the sides of a cube around the eye of a camera, from that in which it looks to the opposite one. The cube
/// stands upright, the same way for all views from an eye.
fn around(camera: &Camera) -> [DVec3; 6] {
    let (across, along) = camera.up.any_orthonormal_pair();
    let mut sides = [across, along, camera.up, -across, -along, -camera.up];
    let forward = camera.forward();
    sides.sort_by(|a, b| b.dot(forward).total_cmp(&a.dot(forward)));
    sides
}

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

    /// Whether quick pictures may need coarse frames.
    fn may_need_coarse(&self, store: &PointStore, request: &FrameRequest) -> bool {
        self.reflects(store, request) || !is_unlit(request)
    }

    /// The coarse frame that the renderer must draw, and `keep_coarse` get, before a hurried frame can be a quick
    /// picture; `None` if it needs none, or cannot be one.
    pub fn lacks(&self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<FrameRequest> {
        let reflects = self.reflects(store, request);
        if !reflects || !self.can_draw(gpu, request) || coarse_for(self.coarse.as_ref(), request).is_some() {
            return None;
        }
        Some(self.coarse(request))
    }

    /// The coarse frame that the renderer should draw, and `keep_coarse` get, after a quick picture, because what mirrors
    /// show in it, or light that no picture at rest knows, has stayed for long enough.
    pub fn is_due(&self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<FrameRequest> {
        let reflects = self.reflects(store, request);
        let is_wanted = reflects || self.is_beyond_rest && self.is_shown && !is_unlit(request);
        let is_due = match coarse_for(self.coarse.as_ref(), request) {
            // Mirrors must not go on to show clouds that are gone, but while points arrive half of the time is for pictures.
            Some(known) if reflects && known.points != request.revision => known.is_older_than(known.took * 2),
            Some(known) if reflects => known.is_older_than(known.stays()),
            // Where mirrors reflect, `lacks` has asked for one before. The last one may be of other values.
            known => {
                let failed = self.failure.as_ref().is_some_and(|(at, _)| at.elapsed() < COARSE_STAYS[1]);
                let has_stayed = |known: &CoarseFrame| known.is_older_than(known.light_stays());
                !failed && known.or(self.coarse.as_ref()).is_none_or(has_stayed)
            }
        };
        (is_due && is_wanted && self.can_draw(gpu, request)).then(|| self.coarse(request))
    }

    /// Puts off the coarse frame that is due, because drawing it failed. Whether that is another failure than the last one.
    pub fn put_off(&mut self, failure: &str) -> bool {
        if let Some(coarse) = &mut self.coarse {
            coarse.since = Some(Instant::now());
        }
        let before = self.failure.replace((Instant::now(), failure.to_owned()));
        before.is_none_or(|(_, before)| before != failure)
    }

    /// The coarse frame for a hurried one.
    pub fn coarse(&self, request: &FrameRequest) -> FrameRequest {
        self.coarse_of(request, self.stand.as_ref().is_some_and(|(_, camera, _)| *camera == request.camera))
    }

    /// The coarse frame for a hurried one, where the camera `stands` or moves.
    fn coarse_of(&self, request: &FrameRequest, stands: bool) -> FrameRequest {
        // Where the camera stands, the surface is kept from one frame to the next.
        let divisor = if stands { OF_STANDING_MIRRORS } else { OF_COARSE };
        let pixels = request.size.map(|edge| u64::from(edge / divisor)).iter().product();
        let most_reflected = Some(self.reflected.most(&request.settings));
        let spared = Spared { divisor, most_points: Some(pixels), most_reflected };
        let mut coarse = FrameRequest { spared: Some(spared), ..request.clone() };
        if !stands && request.light_may_lag {
            // It is shown from when it is done until the next one is. It shows what mirrors show in the middle of that time.
            let known = self.coarse.as_ref().filter(|known| !known.is_rest);
            let until = known.map_or(COARSE_STAYS[0] / 2, |known| known.lasted + known.stays() / 2);
            coarse.camera = self.trail.ahead(request.camera, Instant::now(), until);
        }
        // What mirrors show of one another is missed more than finer pixels.
        if let Some((.., bounces)) = self.stand.as_ref().filter(|_| !stands) {
            let own = &mut coarse.settings.reflection.bounces;
            *own = if *own > 0 { (*bounces).min(MOST_BOUNCES).max(*own) } else { 0 };
        }
        coarse
    }

    /// Learns of a change of points, before pictures show it.
    pub fn learn(&mut self, change: &Change) {
        // More or fewer points of a streamed cloud are in the same light.
        let is_streamed = |key: &ChunkKey| matches!(key.part, Part::Node(_) | Part::Tile(..));
        let is_same = match change {
            Change::Put { key, .. } | Change::TakeOut { key } => is_streamed(key),
            Change::Expect { .. } | Change::Bounds { .. } | Change::Tint { .. } => true,
            _ => false,
        };
        if !is_same {
            self.earlier = None;
        }
    }

    /// Draws a hurried frame, if the adapter is a processor, and the light on the points and what mirrors show is known.
    /// Before the first picture at rest, points show their own colours, and mirrors a plain one until they can reflect.
    pub fn draw(&mut self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<(FrameStats, PictureRows)> {
        let FrameRequest { camera, settings, .. } = request;
        let began = Instant::now();
        let reflects = self.reflects(store, request);
        if let Some(coarse) = &mut self.coarse {
            coarse.since.get_or_insert_with(Instant::now);
        }
        let coarse = coarse_for(self.coarse.as_ref(), request);
        if !self.can_draw(gpu, request) || reflects && coarse.is_none() {
            return None;
        }
        // The coarse frame knows the light, too.
        let inputs = LightInputs::new(request);
        // What its exposure is of may be out of sight.
        let coarse = coarse.filter(|_| reflects || self.is_beyond_rest);
        let shown = coarse.map(|coarse| &*coarse.known);
        let of_rest = self.light.as_ref().filter(|(of, _)| *of == inputs).map(|(_, light)| &**light);
        // Pictures before the last one at rest have the same light as that.
        let earlier = self.earlier.as_ref().filter(|_| of_rest.is_some());
        let known = of_rest.or(shown);
        let light = known.filter(|_| !is_unlit(request));
        if light.is_none() && !is_unlit(request) && self.stand.is_some() {
            return None;
        }
        self.trail.go_to(request.camera, began);
        let Spared { divisor, most_points, .. } = request.spared.unwrap_or(Spared::NOTHING);
        let detail = Detail { most_points, coarseness: divisor, most_as_discs: Detail::MOST_AS_DISCS };
        let known = Known { light, earlier, coarse: shown, adaptation: self.adaptation(true) };
        let mut stats = self.quick.draw(store, camera, settings, request.drawn_size(), detail, known);
        let most_unlit = if self.is_beyond_rest { MOST_UNLIT / 4.0 } else { MOST_UNLIT };
        self.is_beyond_rest = self.quick.unlit() > most_unlit;
        stats.reflected = coarse.filter(|_| reflects).map(|coarse| coarse.share);
        self.keep_exposure(request, &stats, began);
        self.is_shown = true;
        Some((stats, self.quick.take_rows()))
    }

    /// How the exposure of the next picture, which may be a hurried one, follows that of the last one.
    pub fn adaptation(&self, hurried: bool) -> Option<Adaptation> {
        self.exposure.map(|(before, at)| Adaptation { before, share: adapted_share(at.elapsed(), hurried) })
    }

    /// Keeps the exposure of a picture that was drawn for the window, and begun at a time.
    pub fn keep_exposure(&mut self, request: &FrameRequest, stats: &FrameStats, began: Instant) {
        let parameter = request.settings.tone.exposure;
        self.exposure = stats.exposure.map(|exposure| (exposure.stops - parameter, began));
    }

    /// Keeps the light and what mirrors show in the coarse frame that the renderer holds, and that took the time of `stats`;
    /// `since` is when it was begun, or when it was done if a picture waited for it.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_coarse(
        &mut self,
        renderer: &Renderer,
        store: &PointStore,
        request: &FrameRequest,
        since: Instant,
        stats: &FrameStats,
    ) -> render::Result<()> {
        self.failure = None;
        if self.reflects(store, request) {
            self.reflected.learn(&request.settings, stats);
        }
        let known = renderer.known_light(&request.settings)?;
        let share =
            ReflectedShare { pixels: share_of_pixels(request), ..stats.reflected.unwrap_or(ReflectedShare::ALL) };
        // Compiling is no part of it.
        let milliseconds = if stats.has_compiled { 0.0 } else { stats.frame_milliseconds };
        let took = Duration::try_from_secs_f64(milliseconds * 1e-3).unwrap_or_default();
        let lasted = since.elapsed().max(took);
        let (since, of, known) = (Some(since), CoarseInputs::new(request), Arc::new(known));
        // What it shows stays lit as the camera goes on.
        let is_in_light = self.light.as_ref().is_some_and(|(light, _)| *light == of.light);
        self.earlier
            .iter_mut()
            .filter(|_| self.is_beyond_rest && is_in_light)
            .for_each(|earlier| earlier.add_coarse(&known));
        let points = request.revision;
        self.coarse = Some(CoarseFrame { since, of, points, is_rest: false, took, lasted, known, share });
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
        let last = self.light.take().map(|(inputs, _)| inputs);
        (self.coarse, self.is_beyond_rest) = (None, false);
        // Mirrors block light, and throw it.
        self.earlier.take_if(|_| self.stand.as_ref().is_some_and(|(mirrors, ..)| *mirrors != request.mirrors));
        self.stand = Some((request.mirrors.clone(), request.camera, request.settings.reflection.bounces));
        let reflects = self.reflects(store, request);
        if gpu.is_processor() && (reflects || !is_unlit(request)) {
            let known = Arc::new(renderer.known_light(&request.settings)?);
            if reflects {
                let (of, points) = (CoarseInputs::new(request), request.revision);
                let share = ReflectedShare { pixels: share_of_pixels(request), ..ReflectedShare::ALL };
                let known = known.clone();
                let (took, lasted) = (Duration::ZERO, Duration::ZERO);
                let (since, is_rest) = (None, true);
                self.coarse = Some(CoarseFrame { since, of, points, is_rest, took, lasted, known, share });
            }
            self.light = Some((LightInputs::new(request), known)).filter(|_| !is_unlit(request));
        }
        if last.as_ref() != self.light.as_ref().map(|(inputs, _)| inputs) {
            self.earlier = None;
        }
        if let Some((_, light)) = &self.light {
            self.earlier.get_or_insert_default().add(light);
        }
        Ok(())
    }

    /// Compiles the passes of the frames that come when something begins to move in a picture at rest, so that the first of
    /// them need not wait for that. Whether quick pictures will take light from other pictures.
    ///
    /// # Errors
    /// A shader is refused, there is no memory, or the device was lost.
    pub fn prepare(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        store: &PointStore,
        still: &FrameRequest,
        shaders: &Arc<Progress>,
    ) -> render::Result<bool> {
        let request = FrameRequest { settings: hurried(&still.settings, false), hurried: true, ..still.clone() };
        if gpu.is_processor() && !self.may_need_coarse(store, &request) {
            // The processor draws all of them.
            return Ok(false);
        }
        let started = Instant::now();
        // Of a moving camera, only coarse frames for quick pictures are other ones.
        let stands: &[bool] = if gpu.is_processor() { &[true, false] } else { &[true] };
        for coarse in stands.iter().map(|stands| self.coarse_of(&request, *stands)) {
            renderer.prepare(store, &frame_of(&coarse), shaders)?;
        }
        tracing::debug!(milliseconds = started.elapsed().as_secs_f64() * 1e3, "passes of moving pictures prepared");
        Ok(gpu.is_processor())
    }

    /// Draws one more view of what lies around the eye of the picture at rest that the renderer holds, for its light, if a
    /// turn of the head would meet light that nobody knows. Whether nothing of that is left to be drawn.
    ///
    /// # Errors
    /// A shader is refused, there is no memory, the view was given up, or the device was lost.
    pub fn look_around(
        &mut self,
        renderer: &mut Renderer,
        store: &PointStore,
        request: &FrameRequest,
    ) -> render::Result<bool> {
        let camera = request.camera;
        // From outside, nothing lies around; and where points arrive, the light on them is soon another one.
        let is_settled = store.bounds().contains(camera.eye) && !request.light_may_lag;
        let Some(earlier) = self.earlier.as_mut().filter(|_| is_settled) else { return Ok(true) };
        let known: Vec<DVec3> = earlier.directions_from(camera.eye).collect();
        let is_unknown = |direction: &DVec3| known.iter().all(|other| other.dot(*direction) < 0.99);
        let Some(direction) = around(&camera).into_iter().find(is_unknown) else { return Ok(true) };
        let up = if direction.dot(camera.up).abs() > 0.5 { camera.up.any_orthonormal_vector() } else { camera.up };
        let camera = Camera { pivot: camera.eye + direction * camera.distance(), up, ..camera };
        let mut settings = hurried(&request.settings, false);
        settings.view.field_of_view = FIELD_AROUND;
        settings.splat.max_pixels = settings.splat.max_pixels.max(settings.splat.rest_pixels);
        let spared = Spared { most_points: Some(MOST_AROUND), ..Spared::NOTHING };
        let size = [EDGE_AROUND; 2];
        let view = FrameRequest { camera, settings, size, spared: Some(spared), ..request.clone() };
        let light = renderer.light_around(store, &frame_of(&view))?;
        light.iter().for_each(|light| earlier.add_coarse(light));
        Ok(light.is_none())
    }

    /// The point near a pixel of the frame in the window, if that is a quick picture.
    pub fn pick(&self, resident: &Resident, shown: Option<&FrameRequest>, pixel: [u32; 2]) -> Option<PickedPoint> {
        let (drawn, radius) = shown.filter(|_| self.is_shown)?.picked(pixel);
        PickedPoint::new(resident, self.quick.pick(&resident.store, drawn, radius)?)
    }
}

#[cfg(test)]
mod tests {
    use world::CloudKey;

    use super::*;

    /// The trail of a camera that moves evenly, at 20 pictures a second, from a start; and when its last picture was.
    fn trail_of(start: Camera, pictures: u32, step: impl Fn(&mut Camera)) -> (Trail, Camera, Instant) {
        let (mut trail, mut camera, mut now) = (Trail::default(), start, Instant::now());
        trail.go_to(camera, now);
        for _ in 0..pictures {
            step(&mut camera);
            now += Duration::from_millis(50);
            trail.go_to(camera, now);
        }
        (trail, camera, now)
    }

    #[test]
    fn a_camera_is_expected_to_go_on_as_it_goes() {
        let start = Camera::from_eye(DVec3::new(4.0, -3.0, 2.0), DVec3::new(0.5, 0.0, 1.0), DVec3::Z);
        let about = DVec3::new(2.0, 1.0, 0.0);
        let movements: [&dyn Fn(&mut Camera); 5] = [
            &|camera| camera.orbit(0.06, 0.0),
            &|camera| camera.orbit_about(about, -0.06, 0.0),
            &|camera| camera.look(0.05, 0.0),
            &|camera| camera.fly(DVec3::new(0.1, 0.05, -0.02)),
            &|_| {},
        ];
        for (number, step) in movements.into_iter().enumerate() {
            let (trail, camera, now) = trail_of(start, 8, step);
            let there = trail.ahead(camera, now, Duration::from_millis(300));
            let mut expected = camera;
            (0..6).for_each(|_| step(&mut expected));
            let apart = [there.eye - expected.eye, there.forward() - expected.forward()].map(DVec3::length);
            assert!(apart[0].max(apart[1]) < 1e-9, "movement {number}: {apart:?}");
            assert_eq!(trail.ahead(camera, now, Duration::ZERO), camera);
        }
    }

    #[test]
    fn earlier_light_is_forgotten_when_points_change_and_not_when_nodes_come_and_go() {
        let cloud = CloudKey(1);
        let knows_after = |change: Change| {
            let mut moving = MovingPictures { earlier: Some(EarlierLight::default()), ..MovingPictures::default() };
            moving.learn(&change);
            moving.earlier.is_some()
        };
        let node = cloud.chunk(Part::Node(stream::NodeId(0)));
        assert!(knows_after(Change::TakeOut { key: node }) && knows_after(Change::Expect { points: 5 }));
        assert!(!knows_after(Change::TakeOut { key: cloud.chunk(Part::Block(0)) }));
        assert!(!knows_after(Change::Show { cloud, is_visible: false }) && !knows_after(Change::Close { cloud }));
        assert!(!knows_after(Change::Visibility { test: PointTest::hiding([2]) }));
    }

    #[test]
    fn a_camera_is_expected_nowhere_far_from_where_it_is() {
        let start = Camera::from_eye(DVec3::new(0.0, -8.0, 0.0), DVec3::ZERO, DVec3::Z);
        // Nobody flies through what they look at, and walls are not far behind anybody.
        for step in [DVec3::Z, -DVec3::Z, DVec3::X] {
            let (trail, camera, now) = trail_of(start, 3, |camera| camera.fly(step));
            let there = trail.ahead(camera, now, Duration::from_secs(9));
            let way = camera.eye.distance(there.eye);
            assert!((0.1..=0.5).contains(&(way / camera.distance())), "{way} of {}", camera.distance());
        }
        // A view of a bookmark is not on the way to another.
        let (mut trail, _, now) = trail_of(start, 3, |camera| camera.orbit(0.01, 0.0));
        let elsewhere = Camera::from_eye(DVec3::new(30.0, 0.0, 2.0), DVec3::ZERO, DVec3::Z);
        trail.go_to(elsewhere, now + Duration::from_millis(50));
        assert_eq!(trail.ahead(elsewhere, now + Duration::from_millis(50), Trail::AHEAD), elsewhere);
        // A hand turns around before long.
        let (trail, camera, now) = trail_of(start, 3, |camera| camera.orbit(0.01, 0.0));
        assert_eq!(trail.ahead(camera, now, Duration::from_secs(9)), trail.ahead(camera, now, Trail::AHEAD));
    }

    #[test]
    fn after_a_rest_another_movement_begins() {
        let start = Camera::from_eye(DVec3::new(4.0, -3.0, 2.0), DVec3::ZERO, DVec3::Z);
        let (mut trail, mut camera, now) = trail_of(start, 5, |camera| camera.orbit(0.06, 0.0));
        assert_ne!(trail.ahead(camera, now, Trail::AHEAD), camera);
        assert_eq!(trail.ahead(camera, now + Duration::from_secs(1), Trail::AHEAD), camera);
        trail.go_to(camera, now + Duration::from_secs(1));
        assert_eq!(trail.ahead(camera, now, Trail::AHEAD), camera);
        // The way before a turn is forgotten soon.
        for picture in 1..=4 {
            camera.orbit(-0.02, 0.0);
            trail.go_to(camera, now + Duration::from_secs(1) + picture * Duration::from_millis(60));
        }
        let mut expected = camera;
        (0..6).for_each(|_| expected.orbit(-0.02, 0.0));
        let apart = trail.ahead(camera, now, Duration::from_millis(360)).eye.distance(expected.eye);
        assert!(apart < 1e-9, "{apart}");
    }

    #[test]
    fn a_coarse_frame_is_drawn_for_where_the_camera_will_be_while_it_moves() {
        let still = FrameRequest { hurried: true, light_may_lag: true, ..FrameRequest::any() };
        let mut moving = MovingPictures { stand: Some((Vec::new(), still.camera, 1)), ..Default::default() };
        let (mut request, now) = (still.clone(), Instant::now());
        for picture in 0..4 {
            request.camera.orbit(0.05, 0.0);
            moving.trail.go_to(request.camera, now + picture * Duration::from_millis(50));
        }
        let turned = |camera: &Camera| camera.eye.distance(still.camera.eye);
        assert!(turned(&moving.coarse(&request).camera) > turned(&request.camera) + 0.01);
        // Where nothing moves any more, it is drawn for what is seen.
        let ended = FrameRequest { light_may_lag: false, ..request.clone() };
        assert_eq!(moving.coarse(&ended).camera, request.camera);
        assert_eq!(moving.coarse(&still).camera, still.camera);
    }

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
            assert!(CoarseInputs::new(&moving(elsewhere).coarse(request)) == CoarseInputs::new(request));
        }
    }
}
