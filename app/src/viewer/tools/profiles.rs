//! Profiles in the window: the selected one is shown from the side, and follows its handles and the points live.

use std::path::Path;
use std::sync::Arc;

use cloud::{Placement, PointTest};
use render::ColorPlan;
use scene::{Object, Profile, Strays};
use serde_json::json;
use world::CloudKey;

use crate::shared::language::text;
use crate::shared::measuring::PointError;
use crate::shared::profile_chart::axis_units;
use crate::viewer::jobs::slices::{Cuttable, ProfileFound, ProfileWork, Slice};
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::ObjectId;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::requests::action::Profiling;
use crate::viewer::requests::file_names::free_path;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;
use crate::viewer::tools::measurements::units;

/// The most copies that are stacked at once.
pub const MOST_STACKED: u32 = 100;

/// What decides the points of a profile, besides itself: the clouds, how many of their points are loaded and their
/// colours, and which points are shown.
#[derive(Clone, Default, PartialEq)]
struct Basis {
    clouds: Vec<(CloudKey, u64, Option<Placement>, ColorPlan)>,
    test: PointTest,
}

/// An end of what is measured in a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RulerEnd {
    /// The distance along the line, and the height.
    pub at: [f64; 2],
    /// The point that it snapped to.
    pub point: Option<PickedPoint>,
    /// How far that may be off the surface, once it is known.
    pub error: Option<PointError>,
}

#[derive(Default)]
pub struct Profiles {
    /// The profile that is shown from the side.
    pub in_view: Option<ObjectId>,
    /// The points of the profile in view, once they are found, or why there are none.
    pub slice: Option<Result<Arc<Slice>, String>>,
    /// Whether the points of the other profiles that are switched on are shown behind its own.
    pub is_together: bool,
    /// The points of other profiles, with the names of these.
    pub others: Arc<Vec<(String, Slice)>>,
    /// The point of the profile under the cursor.
    pub hovered: Option<PickedPoint>,
    /// The ends of what is measured in the profile, while its ruler is out.
    pub ruler: Option<Vec<RulerEnd>>,
    /// Whether a file of it is being written.
    pub is_writing: bool,
    is_cutting: bool,
    /// What the points were last asked for.
    asked: Option<(ObjectId, Vec<Profile>, Basis)>,
    selected: Option<ObjectId>,
}

/// The profile without what does not change its points.
fn essence(profile: &Profile) -> Profile {
    Profile { name: String::new(), on: true, color: [0.0; 3], ..profile.clone() }
}

impl Profiles {
    pub fn act(&mut self, step: Profiling, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        match step {
            Profiling::Look(id) => {
                self.look_at(id);
                outside.log(json!({ "event": "profile_in_view", "is_shown": id.is_some() }));
            }
            Profiling::Hover(point) => self.hovered = point,
            // `Tools` picks the point, and asks how certain the ends of the ruler are.
            Profiling::Pick(_) | Profiling::Rule(..) => {}
            Profiling::Ruler(is_out) => self.ruler = is_out.then(Vec::new),
            Profiling::Together(is_on) => self.is_together = is_on,
            Profiling::Stack(count, spacing) => self.stack(count, spacing, scene, loaded, outside),
            Profiling::Save(ending) => self.save(ending, scene, loaded, outside),
        }
    }

    /// Sets an end of what is measured; a third one begins anew.
    pub fn rule(&mut self, at: [f64; 2], point: Option<PickedPoint>) {
        if let Some(ends) = &mut self.ruler {
            if ends.len() == 2 {
                ends.clear();
            }
            ends.push(RulerEnd { at, point, error: None });
        }
    }

    /// Takes in how far a point may be off the surface.
    pub fn on_point_error(&mut self, picked: PickedPoint, error: Option<PointError>) {
        let ends = self.ruler.iter_mut().flatten().filter(|end| end.point == Some(picked));
        ends.for_each(|end| end.error = error);
    }

    fn look_at(&mut self, id: Option<ObjectId>) {
        if self.in_view != id {
            *self = Self {
                in_view: id,
                selected: self.selected,
                is_cutting: self.is_cutting,
                is_writing: self.is_writing,
                is_together: self.is_together,
                ruler: self.ruler.as_ref().map(|_| Vec::new()),
                ..Self::default()
            };
        }
    }

    /// The profile that is shown from the side.
    pub fn profile<'a>(&self, scene: &'a Scene) -> Option<&'a Profile> {
        let id = self.in_view?;
        scene.objects.profiles.iter().find(|placed| placed.id == id).map(|placed| &placed.profile)
    }

    /// Adds copies of the profile in view, each farther to the left, in one step of undo.
    fn stack(&mut self, count: u32, spacing: f64, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let Some(profile) = self.profile(scene).cloned() else { return };
        let (up, selected) = (scene.up(&loaded.clouds), scene.selected);
        let most = Object::Profile(profile.clone()).kind().most;
        let room = most.saturating_sub(scene.objects.profiles.len()) as u32;
        scene.history.settle(&scene.settings, &scene.objects);
        for step in 1..=count.min(MOST_STACKED).min(room) {
            let id = scene.next_object_id();
            scene.objects.add(id, Object::Profile(profile.beside(up, spacing * f64::from(step))));
        }
        scene.history.settle(&scene.settings, &scene.objects);
        scene.selected = selected;
        outside.log(json!({ "event": "profiles_stacked", "profiles": scene.objects.profiles.len() }));
        outside.note(text!("There are {profiles} profiles now", profiles = scene.objects.profiles.len()));
    }

    /// The other profiles whose points are shown behind those of the one in view.
    fn behind<'a>(&self, scene: &'a Scene) -> impl Iterator<Item = &'a Profile> {
        let (in_view, is_together) = (self.in_view, self.is_together);
        let placed = scene.objects.profiles.iter();
        placed.filter(move |one| is_together && Some(one.id) != in_view && one.profile.on).map(|one| &one.profile)
    }

    /// Writes the profile in view beside other saved files, and those behind it.
    fn save(&mut self, ending: &str, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        let (Some(profile), false) = (self.profile(scene).cloned(), self.is_writing) else { return };
        let name: String =
            profile.name.chars().map(|sign| if sign.is_alphanumeric() { sign } else { '-' }).take(60).collect();
        let path = free_path(Path::new(""), &name, ending);
        let work = if matches!(ending, "svg" | "png") {
            let Some(Ok(slice)) = &self.slice else {
                return outside.note(text!("The points of the profile are not found yet"));
            };
            let (slice, others) = (slice.clone(), self.others.clone());
            let units = axis_units(&units(loaded), scene.up(&loaded.clouds));
            let is_thinned = loaded.clouds.iter().any(|entry| entry.is_visible && entry.is_partly_loaded());
            ProfileWork::Draw { path, name: profile.name, slice, others, units, is_thinned }
        } else {
            let (inputs, own, test) = (loaded.inputs(), scene.objects.all_own(), scene.objects.test());
            let profiles = std::iter::once(profile).chain(self.behind(scene).cloned()).collect();
            ProfileWork::Write { path, inputs, own, profiles, test, settings: Box::new(scene.settings.clone()) }
        };
        self.is_writing = true;
        outside.work(Work::Profile(Box::new(work)));
    }

    /// Shows a profile from the side that has just been selected, and asks for its points whenever they are not known
    /// for what is shown now.
    pub fn sync(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        if self.selected != scene.selected {
            self.selected = scene.selected;
            let is_profile = |id: &ObjectId| scene.objects.profiles.iter().any(|placed| placed.id == *id);
            if let Some(id) = scene.selected.filter(is_profile) {
                self.look_at(Some(id));
            }
        }
        let Some(id) = self.in_view else { return };
        let Some(profile) = self.profile(scene).map(essence) else { return self.look_at(None) };
        if self.is_cutting {
            return;
        }
        // Names are shown with the points.
        let named = |profile: &Profile| Profile { name: profile.name.clone(), ..essence(profile) };
        let others: Vec<Profile> = self.behind(scene).map(named).collect();
        let all: Vec<Profile> = std::iter::once(profile.clone()).chain(others.iter().cloned()).collect();
        let is_same = self.asked.as_ref().is_some_and(|(of, known, _)| (*of, known) == (id, &all));
        // While points come, those of a profile that stands still can wait.
        if is_same && loaded.points_come() {
            return;
        }
        let visible = || loaded.clouds.iter().filter(|entry| entry.is_visible && entry.figures.is_some());
        let with_plan = |entry: &CloudEntry| {
            Some((entry.key, entry.cloud.len(), entry.placement(), entry.figures.as_ref()?.plan.clone()))
        };
        let test = scene.objects.test().hiding_strays(scene.settings.splat.strays == Strays::Hidden);
        let basis = Basis { clouds: visible().filter_map(with_plan).collect(), test };
        if is_same && self.asked.as_ref().is_some_and(|(.., known)| *known == basis) {
            return;
        }
        let cuttable = |entry: &CloudEntry| {
            let (cloud, parts) = (entry.cloud.clone(), entry.chunk_bounds().collect());
            Some(Cuttable { key: entry.key, cloud, parts, plan: entry.figures.as_ref()?.plan.clone() })
        };
        let clouds = visible().filter_map(cuttable).collect();
        let (up, test) = (scene.up(&loaded.clouds), basis.test.clone());
        self.asked = Some((id, all, basis));
        self.is_cutting = true;
        outside.work(Work::Profile(Box::new(ProfileWork::Cut { id, profile, others, up, clouds, test })));
    }

    pub fn on_found(&mut self, found: ProfileFound, outside: &mut Outside) {
        match found {
            ProfileFound::Cut { id, slice, others } => {
                self.is_cutting = false;
                if self.in_view == Some(id) {
                    let points = slice.as_ref().map(|slice| slice.total).unwrap_or_default();
                    outside.log(json!({ "event": "profile_cut", "points": points }));
                    self.slice = Some(slice.map(Arc::new));
                    self.others = Arc::new(others);
                }
            }
            ProfileFound::Saved { path, result } => {
                self.is_writing = false;
                match result {
                    Ok(warnings) => {
                        outside.note(text!("Saved {path}", path = path.display()));
                        warnings.into_iter().for_each(|warning| outside.warning(warning));
                        outside.log(json!({ "event": "profile_saved", "path": path.display().to_string() }));
                    }
                    Err(error) => outside.error(error),
                }
            }
        }
    }
}
