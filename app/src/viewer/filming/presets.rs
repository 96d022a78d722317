//! Paths that begin with something in them.

use codec::{Unit, Units};
use glam::DVec3;
use scene::{
    BuiltInPath, Camera, CameraPath, Caption, Ease, Keyframe, METHODS, Method, Object, PathPlace, Place, RAY_TRACE,
    Settings, Track, WIPE, WipeState,
};

use crate::shared::language::text;
use crate::viewer::filming::Around;
use crate::viewer::objects::numbered;
use crate::viewer::requests::action::PathPreset;
use crate::viewer::scene::Scene;
use crate::viewer::truth::tuning::Trial;

/// The time between two bookmarks, and that of each method, in seconds.
const STOP_SECONDS: f64 = 2.0;
/// How long a flight along a polyline and the sweep of a mirror take, in seconds.
const WAY_SECONDS: f64 = 10.0;
const SWEEP_SECONDS: f64 = 6.0;
/// How long the line of a wipe takes to cross the picture, in seconds.
const WIPE_SECONDS: f64 = 4.0;
/// The parameter that states have as their method.
const METHOD_KEY: &str = "reflection.method";
/// How high above a polyline the eye flies where no other height is chosen, in metres: about that of a person.
const EYE_METRES: f64 = 1.7;
/// How far a mirror sweeps to each side, as a share of the distance of what the camera looks at.
const SWEEP: f64 = 0.25;

/// The height of a person's eyes in the units of the heights; in metres where these are not known.
pub fn eye_height(units: &Units) -> f64 {
    EYE_METRES / units.height.or(units.level).and_then(Unit::metres).unwrap_or(1.0)
}

/// A path of this kind, under a name that no other has. A flight along a measurement is `height` above it, in world
/// units.
///
/// # Errors
/// Something is lacking for it, in words.
pub fn path(preset: PathPreset, height: f64, scene: &Scene, around: &Around<'_>) -> Result<CameraPath, String> {
    let clouds = &around.loaded.clouds;
    let place = |view: Camera| PathPlace { view, bounds: scene.bounds(clouds), up: scene.up(clouds) };
    let selected = scene.selected.and_then(|id| scene.objects.get(id));
    let mut path = match preset {
        PathPreset::View => still("path", scene.camera),
        PathPreset::Bookmarks if scene.objects.bookmarks.is_empty() => {
            return Err(text!("Keep the view as a bookmark first").to_owned());
        }
        PathPreset::Bookmarks => {
            let mut path = CameraPath { name: "tour".into(), ..CameraPath::default() };
            for (index, bookmark) in scene.objects.bookmarks.iter().enumerate() {
                path.set_keyframe(index as f64 * STOP_SECONDS, bookmark.camera());
            }
            path
        }
        PathPreset::Turntable => BuiltInPath::Turntable.path(&place(scene.camera)),
        PathPreset::Orbit => {
            let middle = selected.and_then(|(_, object)| object.places().first().copied());
            let middle = middle.ok_or(text!("Select a mirror, a light or a clip to orbit"))?;
            let view = Camera::from_eye(scene.camera.eye, middle, scene.camera.up);
            BuiltInPath::Orbit.path(&place(view))
        }
        PathPreset::Polyline => {
            let points = match &selected {
                Some((_, Object::Measurement(measurement))) => measurement.points.as_slice(),
                _ => &[],
            };
            along(points, scene.up(clouds), height)
                .ok_or(text!("Select a measurement of two points or more to fly along"))?
        }
        PathPreset::MirrorSweep => {
            let name = match &selected {
                Some((name, Object::Mirror(_))) => Some((*name).to_owned()),
                _ => scene.objects.mirrors.first().map(|placed| placed.mirror.name.clone()),
            };
            let name = name.ok_or(text!("Add a mirror to sweep"))?;
            let (_, mirror) = scene.objects.named("mirror", &name)?;
            let middle = mirror.places()[0];
            let way = scene.camera.right() * scene.camera.eye.distance(middle) * SWEEP;
            let mut path = still("mirror sweep", scene.camera);
            let key = Track::key_of("mirror", &name, "position").ok_or(text!("A mirror has a position"))?;
            let values = [middle - way, middle + way, middle - way].map(|place| value(&place.to_array()));
            let times = [0.0, 0.5, 1.0].map(|share| share * SWEEP_SECONDS);
            path.tracks = vec![Track { key, times: times.to_vec(), values: values.to_vec(), ease: Ease::InOut }];
            path
        }
        PathPreset::MethodTour => method_tour(scene, around),
        PathPreset::WipeToTruth => wiped("wipe to the truth", scene, to_truth(scene)),
        PathPreset::WipeFromKept => {
            let kept = around.kept.ok_or(text!("Keep a state of the picture first"))?;
            wiped(
                "wipe",
                scene,
                between(kept, &scene.settings).ok_or(text!("The kept state has the present parameters"))?,
            )
        }
    };
    path.name = numbered(&path.name, scene.objects.paths.iter().map(|known| known.name.as_str()));
    path.check()?;
    Ok(path)
}

/// The present method, and what the ray tracer finds.
pub fn to_truth(scene: &Scene) -> [WipeState; 2] {
    let truth = WipeState { name: "truth".into(), ..WipeState::of_method(RAY_TRACE) };
    [WipeState::of_method(scene.settings.reflection.method.chosen().row().name), truth]
}

/// Two states that differ as two settings do, in parameters that states can have; `None` if none differs.
pub fn between(left: &Settings, right: &Settings) -> Option<[WipeState; 2]> {
    let names = ["kept", "now"].map(str::to_owned);
    let mut states = names.map(|name| WipeState { name, ..WipeState::default() });
    if left.reflection.method != right.reflection.method {
        for (state, settings) in states.iter_mut().zip([left, right]) {
            let method = settings.reflection.method.chosen().row().name;
            (state.name, state.method) = (method.into(), Some(method.into()));
        }
    }
    for params in left.groups() {
        for field in params.group().fields.iter().filter(|field| !field.affects.points) {
            let key = format!("{}.{}", params.group().name, field.name);
            let values = [left, right].map(|settings| Track::value_of_parameter(&key, settings));
            let [Some(from), Some(to)] = values else { continue };
            if from != to && key != METHOD_KEY {
                states[0].parameters.insert(key.clone(), from);
                states[1].parameters.insert(key, to);
            }
        }
    }
    let differ = states[0].method != states[1].method || !states[0].parameters.is_empty();
    differ.then_some(states)
}

/// The view, in which a line goes from the right to the left, with a second before it and after it.
fn wiped(name: &str, scene: &Scene, states: [WipeState; 2]) -> CameraPath {
    let mut path = still(name, scene.camera);
    path.set_states(states.to_vec());
    let times = [0.0, 1.0, 1.0 + WIPE_SECONDS, 2.0 + WIPE_SECONDS];
    let values = [1.0, 1.0, 0.0, 0.0].map(toml::Value::Float);
    path.tracks = vec![Track { key: WIPE.into(), times: times.to_vec(), values: values.to_vec(), ease: Ease::InOut }];
    path
}

/// Every reflection method, each with its name and with what was measured of it in this view so far. Times that were
/// measured anew for each picture would differ from run to run, and so would the pictures.
fn method_tour(scene: &Scene, around: &Around<'_>) -> CameraPath {
    let mut path = still("method tour", scene.camera);
    let methods = METHODS.iter().map(|row| row.method).filter(|method| !matches!(method, Method::Auto | Method::None));
    let methods: Vec<Method> = methods.collect();
    let name = |method: Method| toml::Value::String(method.row().name.into());
    // The last method lasts as long as the others.
    let values: Vec<toml::Value> = methods.iter().chain(methods.last()).map(|method| name(*method)).collect();
    let times = (0..values.len()).map(|index| index as f64 * STOP_SECONDS).collect();
    path.tracks = vec![Track { key: "reflection.method".into(), times, values, ease: Ease::Hold }];
    let measured = measured(scene, around);
    for (index, method) in methods.into_iter().enumerate() {
        let start = index as f64 * STOP_SECONDS;
        let figures =
            measured.iter().find(|trial| trial.settings.reflection.method == method).and_then(|trial| told(trial));
        let text = figures.map_or("{reflection.method}".into(), |figures| format!("{{reflection.method}}\n{figures}"));
        path.captions.push(Caption::new(text, start, Some(start + STOP_SECONDS)));
    }
    if let Some(trial) = measured.first() {
        let [width, height] = trial.request.size;
        let on = around.adapter.map_or(String::new(), |adapter| format!(" on {adapter}"));
        let text = format!("measured at {width}x{height}{on}");
        path.captions.push(Caption { place: Place::Top, size: 0.03, ..Caption::new(text, 0.0, None) });
    }
    path
}

/// What the tuning chart has of this view with other methods and else the same settings, for pictures of one size: the
/// one that was measured last.
fn measured<'a>(scene: &Scene, around: &Around<'a>) -> Vec<&'a Trial> {
    let Some(view) = around.view else { return Vec::new() };
    let is_alike = |trial: &&Trial| {
        let mut settings = trial.settings.clone();
        settings.reflection.method = scene.settings.reflection.method;
        settings == scene.settings
    };
    let alike: Vec<&Trial> = around.tuning.of_view(view).filter(is_alike).collect();
    let size = alike.first().map(|trial| trial.request.size);
    alike.into_iter().filter(|trial| Some(trial.request.size) == size).collect()
}

/// The time and the error of a method, for people.
fn told(trial: &Trial) -> Option<String> {
    let (time, frame) = (trial.time(false)?, trial.time(true)?);
    let pixels = trial.figures.as_ref().map(|figures| figures.pixel_error.p95).filter(|pixels| pixels.is_finite());
    let error = pixels.map_or(String::new(), |pixels| format!(", 95 % within {pixels:.2} pixels"));
    Some(format!("{time:.1} ms of {frame:.1} ms{error}"))
}

fn still(name: &str, camera: Camera) -> CameraPath {
    let mut path = CameraPath { name: name.into(), ..CameraPath::default() };
    path.set_keyframe(0.0, camera);
    path
}

/// A flight at a constant speed and height above points, which looks ahead.
fn along(points: &[DVec3], up: DVec3, height: f64) -> Option<CameraPath> {
    let eyes: Vec<DVec3> = points.iter().map(|point| *point + up * height).collect();
    let length: f64 = eyes.windows(2).map(|ends| ends[0].distance(ends[1])).sum();
    if eyes.len() < 2 || length == 0.0 {
        return None;
    }
    let mut gone = 0.0;
    let keyframe = |index: usize| {
        let eye = eyes[index];
        let before = index.checked_sub(1).map_or(eye, |before| eyes[before]);
        gone += before.distance(eye);
        let ahead = eyes.get(index + 1).map_or(eye - before, |next| *next - eye);
        // Each is later than the one before, even where two points are one.
        Keyframe { time: WAY_SECONDS * gone / length + index as f64 * 1e-6, eye, pivot: eye + ahead, up }
    };
    let keyframes = (0..eyes.len()).map(keyframe).collect();
    let mut path = CameraPath { name: "flight".into(), keyframes, ..CameraPath::default() };
    path.set_speed(Some(length / WAY_SECONDS));
    Some(path)
}

fn value(numbers: &[f64]) -> toml::Value {
    toml::Value::Array(numbers.iter().copied().map(toml::Value::Float).collect())
}

#[cfg(test)]
mod tests {
    use scene::Motion;

    use super::*;

    #[test]
    fn a_flight_along_points_keeps_its_height_and_speed_and_looks_ahead() {
        let up = DVec3::Z;
        // Two points are one.
        let points = [[0.0, 0.0, 1.0], [40.0, 0.0, 1.0], [40.0, 0.0, 1.0], [70.0, 15.0, 4.0], [60.0, 60.0, 1.0]];
        let points = points.map(DVec3::from_array);
        for height in [1.7, 25.0] {
            let path = along(&points, up, height).unwrap();
            assert_eq!(path.check(), Ok(()));
            let motion = Motion::new(&path).unwrap();
            for (keyframe, point) in path.keyframes.iter().zip(points) {
                assert!((keyframe.eye - point - up * height).length() < 1e-9, "{keyframe:?}");
            }
            let (duration, step) = (motion.duration(), 0.01);
            assert!((WAY_SECONDS..1.2 * WAY_SECONDS).contains(&duration), "{duration}");
            let eye = |time: f64| motion.camera(time).eye;
            // The eye stays at the point that is there twice for the time between the two.
            let times = (1..200).map(|index| duration * f64::from(index) / 200.0);
            let speeds: Vec<f64> = times.clone().map(|time| eye(time).distance(eye(time + step)) / step).collect();
            let wanted = path.speed.unwrap();
            let off = speeds.iter().filter(|speed| (**speed / wanted - 1.0).abs() > 0.02).count();
            assert!(off <= 2, "{off} of {} speeds differ from {wanted}: {speeds:?}", speeds.len());
            let ahead = |time: f64| (eye(time + step) - eye(time)).normalize().dot(motion.camera(time).forward());
            // At a corner it looks where it will go, before it goes there.
            let cosines: Vec<f64> = times.map(ahead).collect();
            let mean = cosines.iter().sum::<f64>() / cosines.len() as f64;
            assert!(mean > 0.8 && cosines.iter().all(|cosine| *cosine > 0.3), "{mean}: {cosines:?}");
        }
        assert_eq!(along(&points[1..3], up, 1.7), None, "there is no way to go");
    }

    #[test]
    fn the_eyes_of_a_person_are_as_high_in_feet() {
        let of = |height, level| eye_height(&Units { height, level });
        assert_eq!(of(None, None), 1.7);
        assert_eq!(of(None, Some(Unit::Metre)), 1.7);
        assert!((of(Some(Unit::Foot), Some(Unit::Metre)) - 5.577).abs() < 1e-3);
        assert_eq!(of(None, Some(Unit::Degree)), 1.7, "heights beside degrees are in metres");
    }
}
