//! Looks for mirrors and ghosts in the background. The verdicts become attributes of clouds in memory; mirrors that a person
//! accepts become objects of the scene, and their ghosts are put back in a new file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use codec::ExportFormat;
use ghost::{Found, Kind, Suspect};
use scene::{Filter, Mirror, Object, shown};
use serde_json::json;

use crate::shared::ghosts::{KIND, MIRROR, PROBABILITY, run_ends, runs};
use crate::shared::language::text;
use crate::shared::numbers::{grouped, parse_place};
use crate::viewer::jobs::ghosts::{Decision, GaugeWork, Gauged, GhostOutcome, GhostTask, GhostWork, Seen};
use crate::viewer::loaded::comparing::color_by;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::{ObjectId, Objects, unnamed};
use crate::viewer::requests::action::Ghosting;
use crate::viewer::requests::file_names::{free_path, picture_name};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Effect, whole};
use crate::viewer::requests::work::Work;

/// Just below the probability from which on points are ghosts.
const BELOW_GHOSTS: f64 = ghost::GHOST_FROM - 1e-4;

impl Loaded {
    pub fn ghost(&mut self, step: Ghosting, beside: &mut Beside<'_>) {
        let prepared = match step {
            Ghosting::Change(draft) => {
                self.ghosts.draft = *draft;
                return;
            }
            Ghosting::Stop => return self.ghosts.under_way.iter().for_each(|progress| progress.cancel()),
            Ghosting::Accept(mirror) => return self.accept(mirror, beside),
            Ghosting::Refuse(mirror) => {
                if let Some(decision) = self.ghosts.seen.as_mut().and_then(|seen| seen.decisions.get_mut(mirror)) {
                    *decision = Decision::Refused;
                    self.put_verdicts(beside);
                }
                return;
            }
            Ghosting::Hide(hides) => return hide(hides, beside),
            Ghosting::Fit(id) => return self.fit(id, beside),
            Ghosting::Look | Ghosting::PutBack if self.ghosts.under_way.is_some() => {
                return beside.outside.note(text!("Ghosts are being looked for or put back already"));
            }
            Ghosting::Look => self.looking(beside),
            Ghosting::PutBack => self.putting_back(beside),
        };
        match prepared {
            Ok(task) => {
                let settings = Box::new(beside.scene.settings.clone());
                let work = GhostWork { task, settings, progress: Arc::default() };
                self.ghosts.under_way = Some(work.progress.clone());
                beside.outside.work(Work::Ghosts(Box::new(work)));
            }
            Err(problem) => beside.outside.say(Level::Error, problem),
        }
    }

    fn looking(&self, beside: &Beside<'_>) -> Result<GhostTask, String> {
        self.check_unchanged()?;
        let mut inputs: Vec<String> = Vec::new();
        for entry in self.clouds.iter().filter(|entry| entry.is_visible) {
            if entry.is_built_in() {
                return Err(text!("{cloud}: not a file; ghosts are looked for in files", cloud = entry.cloud.name));
            }
            if !inputs.contains(&entry.input) {
                inputs.push(entry.input.clone());
            }
        }
        if inputs.is_empty() {
            return Err(text!("There are no points to look for ghosts in yet").into());
        }
        let draft = &self.ghosts.draft;
        let station = match draft.station.trim() {
            "" => None,
            text => Some(parse_place(text).map_err(|problem| text!("Place of the scanner: {problem}", problem))?),
        };
        let objects = &beside.scene.objects;
        // What is known of a mirror that was found stays known as long as nobody moves it.
        let known = |mirror: &Mirror| {
            let found = self.ghosts.seen.iter().flat_map(|seen| &seen.looked.found);
            let is_one = |found: &&Found| {
                let own = &found.reflector.mirror;
                (own.position, own.rotation, own.size) == (mirror.position, mirror.rotation, mirror.size)
            };
            found.into_iter().find(is_one).cloned()
        };
        let given = objects.mirrors.iter().map(|placed| {
            let found = known(&placed.mirror);
            (placed.id, found.unwrap_or_else(|| Found::given(placed.mirror.clone())))
        });
        let (given, finds): (Vec<_>, _) = (given.collect(), draft.finds);
        if given.is_empty() && !finds {
            return Err(text!("The scene has no mirrors; add one, or look for planes, balls and columns").into());
        }
        Ok(GhostTask::Look { inputs, own: objects.all_own(), station, given, finds })
    }

    fn accept(&mut self, mirror: usize, beside: &mut Beside<'_>) {
        let Some(seen) = &mut self.ghosts.seen else { return };
        let Some(reflector) = seen.looked.found.get(mirror).map(|found| &found.reflector) else { return };
        let shape = reflector.mirror.shape.name();
        let name = format!("found {}", if reflector.is_open { "pane" } else { shape });
        let mut object = Mirror { name, ..reflector.mirror.clone() };
        if reflector.is_open {
            object.refraction = Some(1.0);
        }
        let id = beside.scene.next_object_id();
        beside.scene.place(id, Object::Mirror(object), beside.outside);
        // There may be no room for more mirrors.
        if beside.scene.objects.mirror(id).is_some() {
            let before = std::mem::replace(&mut seen.decisions[mirror], Decision::Accepted(id));
            if before == Decision::Refused {
                self.put_verdicts(beside);
            }
        }
    }

    /// Whether a cloud that is shown is streamed, as what is written of it is to be.
    pub fn shows_streamed(&self) -> bool {
        self.clouds.iter().any(|entry| entry.is_visible && entry.streamed.is_some())
    }

    fn putting_back(&self, beside: &Beside<'_>) -> Result<GhostTask, String> {
        let seen = self.ghosts.seen.as_ref().ok_or(text!("Look for ghosts first"))?;
        let verdicts = seen.looked.verdicts.of_mirrors(|mirror| is_accepted(seen, mirror, &beside.scene.objects));
        if verdicts.count(Kind::Ghost) == 0 {
            return Err(text!("There are no ghosts of accepted mirrors to put back; accept a mirror first").into());
        }
        let output = match self.ghosts.draft.output.trim() {
            "" => {
                let name = self.clouds.first().map_or_else(String::new, |entry| picture_name(&entry.input));
                let ending = if self.shows_streamed() { "copc.laz" } else { "laz" };
                free_path(Path::new(""), &format!("{name}-put-back"), ending)
            }
            path => PathBuf::from(path),
        };
        if ExportFormat::of(&output).is_none() {
            return Err(text!(
                "{output}: the new file's name must end in .copc.laz, .laz, .las or .ply",
                output = shown(&output)
            ));
        }
        if output.symlink_metadata().is_ok() {
            return Err(text!("{output}: a file of this name is there; it is not replaced", output = shown(&output)));
        }
        Ok(GhostTask::PutBack { sources: seen.sources.clone(), verdicts, output })
    }

    pub fn on_ghosts(&mut self, outcome: GhostOutcome, beside: &mut Beside<'_>) {
        if !matches!(outcome, GhostOutcome::Gauged(_)) {
            self.ghosts.under_way = None;
        }
        match outcome {
            GhostOutcome::Looked(Ok(Some(seen))) => {
                let [ghosts, undecided] = seen.counts;
                let mirrors = seen.looked.found.len();
                param::few(seen.looked.warnings.iter().cloned().collect(), "warnings")
                    .into_iter()
                    .for_each(|warning| beside.outside.warning(warning));
                beside.outside.log(json!({
                    "event": "ghosts", "mirrors": mirrors, "ghosts": ghosts, "undecided": undecided,
                }));
                beside.outside.note(match mirrors {
                    1 => text!("1 mirror, {ghosts} ghosts", ghosts = grouped(ghosts)),
                    _ => text!("{mirrors} mirrors, {ghosts} ghosts", mirrors, ghosts = grouped(ghosts)),
                });
                self.ghosts.seen = Some(*seen);
                self.ghosts.live = Default::default();
                self.put_verdicts(beside);
            }
            GhostOutcome::Gauged(gauged) => self.on_gauged(*gauged, beside),
            GhostOutcome::Looked(Ok(None)) => beside.outside.note(text!("Ghosts are not looked for any more")),
            GhostOutcome::PutBack { output, result: Ok(Some(warnings)) } => {
                warnings.into_iter().for_each(|warning| beside.outside.warning(warning));
                let request = world::resolve(&[&output]);
                if let Err(error) = request.check() {
                    return beside.outside.say(Level::Error, error.to_string());
                }
                beside.outside.log(json!({ "event": "put_back", "path": output }));
                beside.outside.note(text!("Ghosts put back: {output}", output = whole(&output)));
                beside.outside.push(Effect::Load { inputs: request.inputs });
                let shown: Vec<_> =
                    self.clouds.iter().filter(|entry| entry.is_visible).map(|entry| entry.key).collect();
                shown.into_iter().for_each(|key| self.set_visible(key, false, beside));
                // A ghost that was put back is not shown behind its mirror, too.
                hide(true, beside);
            }
            GhostOutcome::PutBack { output, result: Ok(None), .. } => {
                beside.outside.note(text!("Not put back: {output}", output = shown(&output)));
            }
            GhostOutcome::Looked(Err(error)) | GhostOutcome::PutBack { result: Err(error), .. } => {
                beside.outside.say(Level::Error, error);
            }
        }
    }

    /// Measures the mirror of the scene that has changed since it was measured. Called every frame of the window.
    pub fn sync_ghosts(&mut self, beside: &mut Beside<'_>) {
        let Some(seen) = &self.ghosts.seen else { return };
        let live = &mut self.ghosts.live;
        live.measured.retain(|id, _| beside.scene.objects.mirror(*id).is_some());
        let is_known = |id: ObjectId, mirror: &Mirror| {
            live.measured.get(&id).is_some_and(|(known, _)| unnamed(known) == unnamed(mirror))
        };
        let stale = beside.scene.objects.mirrors.iter().find(|placed| !is_known(placed.id, &placed.mirror));
        if let Some(placed) = stale.filter(|_| !live.is_measuring) {
            live.is_measuring = true;
            let gauge = seen.looked.gauge.clone();
            let work = GaugeWork { gauge, id: placed.id, mirror: placed.mirror.clone(), fits: false };
            beside.outside.work(Work::Gauge(Box::new(work)));
        }
    }

    fn fit(&mut self, id: ObjectId, beside: &mut Beside<'_>) {
        let Some(seen) = &self.ghosts.seen else { return beside.outside.note(text!("Look for ghosts first")) };
        let Some(mirror) = beside.scene.objects.mirror(id).filter(|_| self.ghosts.live.fitting.is_none()) else {
            return;
        };
        self.ghosts.live.fitting = Some(id);
        let work = GaugeWork { gauge: seen.looked.gauge.clone(), id, mirror: mirror.clone(), fits: true };
        beside.outside.work(Work::Gauge(Box::new(work)));
    }

    fn on_gauged(&mut self, gauged: Gauged, beside: &mut Beside<'_>) {
        let Gauged { gauge, id, before, fitted, residual } = gauged;
        // What was measured by a search before the last one says nothing any more.
        if self.ghosts.seen.as_ref().is_none_or(|seen| !Arc::ptr_eq(&seen.looked.gauge, &gauge)) {
            return;
        }
        let live = &mut self.ghosts.live;
        let Some(fitted) = fitted else {
            live.is_measuring = false;
            live.measured.insert(id, (before, residual));
            return;
        };
        live.fitting = None;
        let Some(now) = beside.scene.objects.mirror(id) else { return };
        let name = now.name.clone();
        match fitted {
            None => beside.outside.note(text!("{name}: too few points were seen in it to say where it is", name)),
            Some(_) if unnamed(now) != unnamed(&before) => {
                beside.outside.note(text!("{name} was moved while it was fitted; it stays where it is now", name));
            }
            Some(mirror) => {
                let mirror = Mirror { name: name.clone(), ..mirror };
                let moved = mirror.position.distance(before.position);
                let object = Object::Mirror(mirror.clone());
                beside.scene.edit_objects(beside.outside.now, |objects| objects.set(id, object));
                live.measured.insert(id, (mirror, residual));
                beside.outside.note(text!("{name} fitted: moved by {moved}", name, moved = format_args!("{moved:.4}")));
            }
        }
    }

    /// Makes the verdicts by all mirrors that are not refused attributes of the clouds in memory, and colours by it.
    fn put_verdicts(&mut self, beside: &mut Beside<'_>) {
        let Some(seen) = &mut self.ghosts.seen else { return };
        let verdicts = seen.verdicts();
        seen.counts = [Kind::Ghost, Kind::Undecided].map(|kind| verdicts.count(kind));
        let values: [&dyn Fn(&Suspect) -> f32; 3] =
            [&|suspect| f32::from(suspect.kind.number()), &|suspect| f32::from(suspect.mirror()), &|suspect| {
                suspect.probability
            }];
        let mut lists = Vec::new();
        for (file, place) in seen.places().enumerate() {
            let is_own =
                |source: &Arc<codec::Source>| (&source.info().path, source.info().scan_number()) == (&place.0, place.1);
            let entry = self.clouds.iter().find(|entry| entry.source.as_ref().is_some_and(is_own));
            let Some(entry) = entry.filter(|entry| entry.streamed.is_none()) else { continue };
            let chunks = &entry.cloud.chunks;
            let ends = || -> Box<dyn Iterator<Item = (u64, u64)>> {
                if chunks.iter().any(|chunk| chunk.corners.is_some()) {
                    return Box::new(run_ends(seen.sources[file].info().points));
                }
                Box::new(chunks.iter().map(|chunk| (chunk.first_point, chunk.first_point + chunk.len() as u64)))
            };
            lists.push((entry.key, values.map(|value| runs(&verdicts, file, ends(), value))));
        }
        for (key, lists) in lists {
            if let Some(name) = self.put_values(key, &[KIND, MIRROR, PROBABILITY], lists.into(), beside) {
                color_by(&name, beside);
            }
        }
    }
}

/// Whether the scene has a mirror that was accepted.
pub fn is_accepted(seen: &Seen, mirror: usize, objects: &Objects) -> bool {
    matches!(seen.decisions[mirror], Decision::Accepted(id) if objects.mirror(id).is_some())
}

/// Whether the filter of `hide` is there.
pub fn are_hidden(filters: &[Filter]) -> bool {
    filters.iter().any(is_hiding)
}

fn is_hiding(filter: &Filter) -> bool {
    filter.attribute == PROBABILITY
}

/// Hides ghosts by a filter, or shows them again. What is undecided stays.
fn hide(hides: bool, beside: &mut Beside<'_>) {
    let filters = &mut beside.scene.objects.visibility.filters;
    filters.retain(|filter| !is_hiding(filter));
    if hides {
        filters.push(Filter { attribute: PROBABILITY.to_owned(), low: f64::NEG_INFINITY, high: BELOW_GHOSTS });
    }
    beside.scene.navigation.camera_moved(beside.outside.now);
}

#[cfg(test)]
mod tests {
    use cloud::Chunk;
    use glam::DVec3;
    use scene::tripod::Disturbance;
    use scene::{ColorBy, Shape, Tripod};
    use trace::{Exact, scan};
    use world::{Event, Opened, Part};

    use super::*;
    use crate::viewer::jobs::ghosts::GhostsDraft;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::Found as WorkFound;
    use crate::viewer::session::Session;

    const STATION: DVec3 = DVec3::new(2.9, 2.6, 1.55);

    fn wall_mirror() -> Mirror {
        let place = DVec3::new(3.4, 5.96, 1.6);
        let mirror = Mirror::standing(Shape::Plane { height: 0.8 }, place, DVec3::NEG_Y, DVec3::Z, 0.9);
        Mirror { position: place, name: "wall mirror".into(), ..mirror }
    }

    /// The made room with a mirror on its wall, scanned into a file that is open in two chunks. Returns the number of ghosts.
    fn session(path: &Path) -> (Session, u64) {
        let exact = Exact::of_mirrors(&[wall_mirror()]).with_solids(Tripod::Room.solids());
        let points = scan::scan(&exact, &Disturbance::default(), STATION, 30_000.0, 1, 0);
        let places: Vec<DVec3> = points.iter().map(|point| STATION + point.direction * point.range).collect();
        let rows: String = places.iter().map(|place| format!("{} {} {}\n", place.x, place.y, place.z)).collect();
        let count = places.len();
        let axes = "property double x\nproperty double y\nproperty double z\n";
        let header = format!("ply\nformat ascii 1.0\nelement vertex {count}\n{axes}end_header\n");
        std::fs::write(path, header + &rows).unwrap();
        let mut session = Session::new(Preferences::default());
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        let input = path.to_str().unwrap().to_owned();
        let source = Some(Arc::new(codec::open(path).unwrap()));
        let expected_points = count as u64;
        let opened = Opened { name: "room".into(), input, source, expected_points, up: DVec3::Z, ..Opened::default() };
        let mut send = |event| session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
        send(Event::Opened { cloud: 0, opened });
        for (block, part) in places.chunks(count / 2 + 1).enumerate() {
            let positions = part.iter().map(|place| place.as_vec3().to_array()).collect();
            let first = (block * (count / 2 + 1)) as u64;
            let chunk = Chunk::new(first, DVec3::ZERO, positions);
            send(Event::Chunk { cloud: 0, part: Part::Block(block as u64), chunk });
        }
        send(Event::Read { cloud: 0, summary: codec::Summary::default() });
        send(Event::Finished);
        session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
        (session, points.iter().filter(|point| point.met.is_ghost()).count() as u64)
    }

    fn step(session: &mut Session, step: Ghosting) -> Option<GhostWork> {
        session.outside.effects.clear();
        session.act(Action::Ghosts(step));
        session.outside.effects.drain(..).find_map(|effect| match effect {
            Effect::Work(Work::Ghosts(work)) => Some(*work),
            _ => None,
        })
    }

    fn values(session: &Session, which: usize) -> Vec<f64> {
        let chunks = &session.loaded.clouds[0].cloud.chunks;
        let values = |chunk: &Chunk| {
            let column = chunk.columns[which].clone().unwrap();
            (0..chunk.len()).map(|index| column.value(index)).collect::<Vec<_>>()
        };
        chunks.iter().flat_map(values).collect()
    }

    fn said(session: &Session) -> String {
        session.outside.messages.all.iter().map(|message| message.text.as_str()).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn ghosts_colour_points_are_hidden_and_put_back_and_an_accepted_mirror_is_undone() {
        let folder = tempfile::tempdir().unwrap();
        let (mut session, ghosts) = session(&folder.path().join("room.ply"));
        let id = session.scene.next_object_id();
        session.scene.place(id, Object::Mirror(wall_mirror()), &mut session.outside);
        let draft = GhostsDraft {
            station: "2.9,2.6,1.55".into(),
            finds: false,
            output: folder.path().join("back.laz").to_str().unwrap().to_owned(),
        };
        session.act(Action::Ghosts(Ghosting::Change(Box::new(draft))));
        let work = step(&mut session, Ghosting::Look).unwrap();
        assert!(step(&mut session, Ghosting::Look).is_none(), "one at a time");
        session.on_found(WorkFound::Ghosts(work.run()));
        assert!(ghosts > 300 && said(&session).contains(&format!("1 mirror, {ghosts} ghosts")), "{}", said(&session));
        let color = &session.scene.settings.color;
        assert_eq!((color.by, color.attribute.as_str()), (ColorBy::Attribute, "ghost"));
        let count = |session: &Session| values(session, 0).iter().filter(|kind| **kind == 1.0).count() as u64;
        assert_eq!(count(&session), ghosts);
        assert!(values(&session, 0).iter().zip(values(&session, 1)).all(|(kind, mirror)| *kind == mirror));

        step(&mut session, Ghosting::Hide(true));
        let cloud = &session.loaded.clouds[0].cloud;
        let test = cloud.test(&session.scene.objects.test());
        let shown = |chunk: &Chunk| test.shown(chunk, chunk.bounds()).indices(chunk.len()).count() as u64;
        let all: u64 = cloud.chunks.iter().map(|chunk| chunk.len() as u64).sum();
        assert_eq!(cloud.chunks.iter().map(shown).sum::<u64>(), all - ghosts);
        step(&mut session, Ghosting::Hide(false));
        assert!(session.scene.objects.visibility.filters.is_empty());

        // Without its object the mirror is open again, and nothing is put back.
        session.scene.selected = Some(id);
        session.act(Action::Delete);
        assert!(step(&mut session, Ghosting::PutBack).is_none() && said(&session).contains("accept a mirror first"));
        step(&mut session, Ghosting::Refuse(0));
        assert_eq!(count(&session), 0);
        step(&mut session, Ghosting::Accept(0));
        assert!(count(&session) == ghosts && session.scene.objects.mirrors.len() == 1);
        session.act(Action::Undo);
        assert!(session.scene.objects.mirrors.is_empty() && step(&mut session, Ghosting::PutBack).is_none());
        session.act(Action::Redo);
        let mut work = step(&mut session, Ghosting::PutBack).unwrap();
        let lost = "room.e57: scan attic: its pose has numbers that are not finite";
        if let GhostTask::PutBack { sources, .. } = &mut work.task {
            let mut source = codec::open(&folder.path().join("room.ply")).unwrap();
            source.lose(vec![lost.into()]);
            *sources = vec![Arc::new(source)];
        }
        session.on_found(WorkFound::Ghosts(work.run()));
        assert!(said(&session).contains(lost), "the new file has no points of that scan: {}", said(&session));
        let opens = |effect: &Effect| matches!(effect, Effect::Load { .. });
        assert!(session.outside.effects.iter().any(opens), "{}", said(&session));
        let written = codec::open(&folder.path().join("back.laz")).unwrap();
        assert_eq!(written.info().points, all + ghosts);
        assert!(!session.loaded.clouds[0].is_visible, "the new file is shown in place of the scan");
        assert!(are_hidden(&session.scene.objects.visibility.filters), "a ghost is shown once, where it is");
        assert!(step(&mut session, Ghosting::PutBack).is_none(), "a file that is there is not replaced");
    }

    /// The work on mirrors that a step of the window asks for.
    fn gauge_work(session: &mut Session) -> Option<GaugeWork> {
        session.outside.effects.clear();
        session.with_loaded(Loaded::sync_ghosts);
        asked(session)
    }

    fn asked(session: &mut Session) -> Option<GaugeWork> {
        session.outside.effects.drain(..).find_map(|effect| match effect {
            Effect::Work(Work::Gauge(work)) => Some(*work),
            _ => None,
        })
    }

    fn gauged(session: &mut Session, work: GaugeWork) {
        session.on_found(WorkFound::Ghosts(GhostOutcome::Gauged(Box::new(work.run()))));
    }

    #[test]
    fn a_mirror_that_is_moved_is_measured_as_it_stands_and_fitted_in_one_step_of_undo() {
        let folder = tempfile::tempdir().unwrap();
        let (mut session, ghosts) = session(&folder.path().join("room.ply"));
        let id = session.scene.next_object_id();
        session.scene.place(id, Object::Mirror(wall_mirror()), &mut session.outside);
        let draft = GhostsDraft { station: "2.9,2.6,1.55".into(), finds: false, ..GhostsDraft::default() };
        session.act(Action::Ghosts(Ghosting::Change(Box::new(draft))));
        assert!(gauge_work(&mut session).is_none(), "nothing was searched yet");
        let work = step(&mut session, Ghosting::Look).unwrap();
        session.on_found(WorkFound::Ghosts(work.run()));
        let residual = |session: &Session| session.loaded.ghosts.live.measured[&id].1;
        let work = gauge_work(&mut session).unwrap();
        assert!(gauge_work(&mut session).is_none(), "one at a time");
        gauged(&mut session, work);
        assert!(gauge_work(&mut session).is_none(), "as it stands, it was measured");
        let right = residual(&session);
        assert!(right.points > ghosts / 2 && right.median.is_some_and(|median| median < 0.001), "{right:?}");

        // A drag of a handle: the last place is measured, whatever became of those on the way.
        let moved = |by: f64| Mirror { position: wall_mirror().position - DVec3::Y * by, ..wall_mirror() };
        session.act(Action::ChangeObject(id, Box::new(Object::Mirror(moved(0.01)))));
        let work = gauge_work(&mut session).unwrap();
        session.act(Action::ChangeObject(id, Box::new(Object::Mirror(moved(0.03)))));
        gauged(&mut session, work);
        assert!(residual(&session).median.is_some_and(|median| median > 0.005));
        let work = gauge_work(&mut session).unwrap();
        gauged(&mut session, work);
        let off = residual(&session);
        assert!(off.median.is_some_and(|median| median > 0.02), "{off:?}");

        session.outside.effects.clear();
        session.act(Action::Ghosts(Ghosting::Fit(id)));
        let work = asked(&mut session).unwrap();
        session.act(Action::Ghosts(Ghosting::Fit(id)));
        assert!(asked(&mut session).is_none(), "one fit at a time");
        gauged(&mut session, work);
        let off = (session.scene.objects.mirror(id).unwrap().position - wall_mirror().position).dot(DVec3::Y);
        assert!(off.abs() < 0.002, "{off}: {}", said(&session));
        assert!(residual(&session).median.is_some_and(|median| median < 0.002) && gauge_work(&mut session).is_none());
        session.act(Action::Undo);
        assert_eq!(session.scene.objects.mirror(id), Some(&moved(0.03)));

        // A fit that ends after a person has moved the mirror on leaves it there.
        session.outside.effects.clear();
        session.act(Action::Ghosts(Ghosting::Fit(id)));
        let work = asked(&mut session).unwrap();
        session.act(Action::ChangeObject(id, Box::new(Object::Mirror(moved(0.05)))));
        gauged(&mut session, work);
        assert_eq!(session.scene.objects.mirror(id), Some(&moved(0.05)));
        assert!(said(&session).contains("was moved while it was fitted"), "{}", said(&session));
    }

    #[test]
    fn what_is_missing_is_said_and_a_search_is_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let (mut session, _) = session(&folder.path().join("room.ply"));
        let work = step(&mut session, Ghosting::Look).unwrap();
        session.on_found(WorkFound::Ghosts(work.run()));
        assert!(said(&session).contains("it is not known where the scanner stood"), "{}", said(&session));
        let draft = |station: &str, finds| GhostsDraft { station: station.into(), finds, ..GhostsDraft::default() };
        for (draft, expected) in [(draft("here", true), "Place of the scanner"), (draft("1,2,3", false), "no mirrors")]
        {
            session.act(Action::Ghosts(Ghosting::Change(Box::new(draft))));
            assert!(step(&mut session, Ghosting::Look).is_none() && said(&session).contains(expected));
        }
        session.act(Action::Ghosts(Ghosting::Change(Box::new(draft("2.9,2.6,1.55", true)))));
        let work = step(&mut session, Ghosting::Look).unwrap();
        session.act(Action::Ghosts(Ghosting::Stop));
        session.on_found(WorkFound::Ghosts(work.run()));
        let ghosts = &session.loaded.ghosts;
        assert!(ghosts.seen.is_none() && ghosts.under_way.is_none() && session.loaded.clouds[0].added.is_empty());
    }
}
