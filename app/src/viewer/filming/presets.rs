//! Paths that begin with something in them.

use glam::DVec3;
use scene::{
    BuiltInPath, Camera, CameraPath, Caption, Ease, Keyframe, METHODS, Method, Object, PathPlace, Place, Track,
};

use crate::viewer::action::PathPreset;
use crate::viewer::filming::Around;
use crate::viewer::objects::numbered;
use crate::viewer::scene::Scene;
use crate::viewer::truth::tuning::Trial;

/// The time between two bookmarks, and that of each method, in seconds.
const STOP_SECONDS: f64 = 2.0;
/// How long a flight along a polyline and the sweep of a mirror take, in seconds.
const WAY_SECONDS: f64 = 10.0;
const SWEEP_SECONDS: f64 = 6.0;
/// How high above a polyline the eye flies, in world units: about a person's height in metres.
const EYE_HEIGHT: f64 = 1.7;
/// How far a mirror sweeps to each side, as a share of the distance of what the camera looks at.
const SWEEP: f64 = 0.25;

/// A path of this kind, under a name that no other has.
///
/// # Errors
/// Something is lacking for it, in words.
pub fn path(preset: PathPreset, scene: &Scene, around: &Around<'_>) -> Result<CameraPath, String> {
    let clouds = &around.loaded.clouds;
    let place = |view: Camera| PathPlace { view, bounds: scene.bounds(clouds), up: scene.up(clouds) };
    let selected = scene.selected.and_then(|id| scene.objects.get(id));
    let mut path = match preset {
        PathPreset::View => still("path", scene.camera),
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
            let middle = middle.ok_or("Select a mirror, a light or a clip to orbit")?;
            let view = Camera::from_eye(scene.camera.eye, middle, scene.camera.up);
            BuiltInPath::Orbit.path(&place(view))
        }
        PathPreset::Polyline => {
            let points = match &selected {
                Some((_, Object::Measurement(measurement))) => measurement.points.as_slice(),
                _ => &[],
            };
            along(points, scene.up(clouds)).ok_or("Select a measurement of two points or more to fly along")?
        }
        PathPreset::MirrorSweep => {
            let name = match &selected {
                Some((name, Object::Mirror(_))) => Some((*name).to_owned()),
                _ => scene.objects.mirrors.first().map(|placed| placed.mirror.name.clone()),
            };
            let name = name.ok_or("Add a mirror to sweep")?;
            let (_, mirror) = scene.objects.named("mirror", &name)?;
            let middle = mirror.places()[0];
            let way = scene.camera.right() * scene.camera.eye.distance(middle) * SWEEP;
            let mut path = still("mirror sweep", scene.camera);
            let key = Track::key_of("mirror", &name, "position").ok_or("A mirror has a position")?;
            let values = [middle - way, middle + way, middle - way].map(|place| value(&place.to_array()));
            let times = [0.0, 0.5, 1.0].map(|share| share * SWEEP_SECONDS);
            path.tracks = vec![Track { key, times: times.to_vec(), values: values.to_vec(), ease: Ease::InOut }];
            path
        }
        PathPreset::MethodTour => method_tour(scene, around),
    };
    path.name = numbered(&path.name, scene.objects.paths.iter().map(|known| known.name.as_str()));
    path.check()?;
    Ok(path)
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

/// A flight at a constant speed above points, which looks ahead.
fn along(points: &[DVec3], up: DVec3) -> Option<CameraPath> {
    let eyes: Vec<DVec3> = points.iter().map(|point| *point + up * EYE_HEIGHT).collect();
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
