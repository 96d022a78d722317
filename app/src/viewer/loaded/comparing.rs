//! Compares two clouds in the background. The distances of a cloud in memory become an attribute of it; those of a
//! streamed cloud go to a new file with all of its points, which is opened in its place.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::{Attribute, COMPARED, Cloud, ColumnType};
use codec::{ExportFormat, Runs};
use scene::{ColorBy, shown};
use serde_json::json;
use world::CloudKey;

use crate::shared::comparing::{Measured, Method};
use crate::shared::export::Place;
use crate::shared::language::text;
use crate::system::picture_file;
use crate::viewer::jobs::comparisons::{CompareDraft, Compared, Comparing, Comparison, Ends, Outcome, Second, Written};
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::requests::action::Compare;
use crate::viewer::requests::file_names::{free_path, picture_name};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Effect, whole};
use crate::viewer::requests::work::Work;

impl Loaded {
    pub fn compare(&mut self, step: Compare, beside: &mut Beside<'_>) {
        match step {
            Compare::Change(draft) => self.comparisons.draft = *draft,
            Compare::Stop => self.comparisons.under_way.iter().for_each(|(_, progress)| progress.cancel()),
            Compare::Start if self.comparisons.under_way.is_some() => {
                beside.outside.note(text!("Clouds are being compared already"));
            }
            Compare::Start => match self.comparing(beside) {
                Ok(comparing) => {
                    let second = match self.compared_second() {
                        Second::Cloud(key) => self.cloud(key),
                        _ => None,
                    };
                    let ends = [(self.compared_first(), &comparing.first), (second, &comparing.second)];
                    // Files are read as a whole.
                    let ends = ends.into_iter().filter(|(_, end)| matches!(end, Ends::Memory { .. }));
                    for entry in ends.filter_map(|(entry, _)| entry.filter(|entry| entry.is_cut)) {
                        let name = &entry.cloud.name;
                        beside
                            .outside
                            .warning(text!("{name}: not all points are loaded: distances are those of parts", name));
                    }
                    self.comparisons.under_way = Some((comparing.what.clone(), comparing.progress.clone()));
                    beside.outside.work(Work::Compare(Box::new(comparing)));
                }
                Err(problem) => beside.outside.say(Level::Error, problem),
            },
        }
    }

    /// The cloud whose points would be measured.
    pub fn compared_first(&self) -> Option<&CloudEntry> {
        let chosen = self.comparisons.draft.first.and_then(|key| self.cloud(key));
        chosen.or(self.clouds.first())
    }

    /// What the distances would be measured to.
    pub fn compared_second(&self) -> Second {
        let first = self.compared_first().map(|entry| entry.key);
        let other = || self.clouds.iter().find(|entry| Some(entry.key) != first);
        match &self.comparisons.draft.second {
            Second::Other => other().map_or(Second::File(String::new()), |entry| Second::Cloud(entry.key)),
            chosen => chosen.clone(),
        }
    }

    fn comparing(&self, beside: &Beside<'_>) -> Result<Comparing, String> {
        let CompareDraft { is_m3c2, scales, core, output, .. } = &self.comparisons.draft;
        let first = self.compared_first().ok_or(text!("There is no cloud to compare yet"))?;
        let (second, to) = match &self.compared_second() {
            Second::Cloud(key) => {
                let entry =
                    self.cloud(*key).ok_or(text!("Choose a second cloud, or a file, to measure the distances to"))?;
                if entry.key == first.key {
                    return Err(text!(
                        "{cloud}: a cloud has no distance to itself; choose another",
                        cloud = first.cloud.name
                    ));
                }
                let end = match entry.source.as_ref().filter(|source| source.is_mesh() && !is_m3c2) {
                    // The faces of a mesh are in its file.
                    Some(source) => {
                        entry.check_unchanged().map_err(|error| error.to_string())?;
                        Ends::Files(vec![source.info().path.display().to_string()])
                    }
                    None => ends(entry)?,
                };
                (end, entry.cloud.name.clone())
            }
            Second::Other => return Err(text!("Choose a second cloud, or a file, to measure the distances to").into()),
            Second::File(path) if path.trim().is_empty() => {
                return Err(text!("Choose a second cloud, or a file, to measure the distances to").into());
            }
            Second::File(path) => (Ends::Files(vec![path.trim().to_owned()]), shown(path.trim()).to_string()),
        };
        let output = first.streamed.is_some().then(|| match output.trim() {
            "" => free_path(Path::new(""), &format!("{}-distances", picture_name(&first.input)), "copc.laz"),
            path => PathBuf::from(path),
        });
        if let Some(path) = &output {
            if ExportFormat::of(path).is_none() {
                let name = shown(path);
                return Err(text!("{name}: the new file's name must end in .copc.laz, .laz, .las or .ply", name));
            }
            if path.symlink_metadata().is_ok() {
                return Err(text!("{path}: a file of this name is there; it is not replaced", path = shown(path)));
            }
            // Better than after minutes of work.
            picture_file::check_place(path).map_err(|error| format!("{error:#}"))?;
        }
        let settings = Box::new(beside.scene.settings.clone());
        let objects = &beside.scene.objects;
        let how = if *is_m3c2 { "M3C2" } else { text!("nearest points") };
        Ok(Comparing {
            key: first.key,
            what: text!("{first} to {second}, {how}", first = first.cloud.name, second = to, how),
            first: ends(first)?,
            second,
            method: if *is_m3c2 { Method::M3c2(*scales) } else { Method::Nearest },
            core: *core,
            // Where a clip volume cuts both clouds, the points at its border would seem to have moved.
            tests: [objects.test(), objects.visibility.test([])],
            settings,
            own: objects.all_own(),
            output,
            progress: Arc::default(),
        })
    }

    pub fn on_compared(&mut self, comparison: Comparison, beside: &mut Beside<'_>) {
        self.comparisons.under_way = None;
        let Comparison { key, what, result } = comparison;
        let Outcome { measured, output, warnings } = match result {
            Ok(Some(outcome)) => outcome,
            Ok(None) => return beside.outside.note(text!("Not compared: {what}", what)),
            Err(error) => return beside.outside.say(Level::Error, error),
        };
        param::few(warnings, "warnings").into_iter().for_each(|warning| beside.outside.warning(warning));
        let Measured { distances, levels, figures, significant, unread: _, interval } = measured;
        beside.outside.log(json!({
            "event": "compared", "what": what, "points": figures.points, "mean": figures.mean, "p95": figures.p95,
            "significant": significant, "interval": interval,
        }));
        beside.outside.note(text!("Compared: {what}", what));
        self.comparisons.last = Some(Compared { what, figures, significant, interval });
        match output {
            Some(Ok(Written { path, attribute })) => self.open_compared(key, &path, &attribute, beside),
            Some(Err(error)) => beside.outside.say(Level::Error, error),
            None => {
                let lists = std::iter::once(distances).chain(levels).map(|mut lists| lists.pop().unwrap_or_default());
                let lists: Vec<Runs> = lists.collect();
                if let Some(entry) = self.cloud_mut(key) {
                    let gone = &COMPARED[lists.len()..];
                    entry.added.retain(|(name, _)| !gone.iter().any(|wanted| is_numbered(name, wanted)));
                }
                if let Some(name) = self.put_values(key, &COMPARED, lists, beside) {
                    color_by(&name, beside);
                }
            }
        }
    }

    /// Opens the file that the distances of a streamed cloud were written to, as an attribute, in its place.
    fn open_compared(&mut self, key: CloudKey, path: &Path, attribute: &str, beside: &mut Beside<'_>) {
        let request = world::resolve(&[path]);
        if let Err(error) = request.check() {
            return beside.outside.say(Level::Error, error.to_string());
        }
        beside.outside.note(text!("Distances written: {path}", path = whole(path)));
        beside.outside.push(Effect::Load { inputs: request.inputs });
        self.set_visible(key, false, beside);
        color_by(attribute, beside);
    }

    /// Adds values of the file's points to a cloud in memory, or replaces those from before. Returns the name of the first
    /// attribute, which is the first of `wanted` if it is free.
    pub fn put_values(
        &mut self,
        key: CloudKey,
        wanted: &[&str],
        lists: Vec<Runs>,
        beside: &mut Beside<'_>,
    ) -> Option<String> {
        let entry = self.cloud_mut(key)?;
        let (mut changes, mut first) = (Vec::new(), None);
        for (wanted, list) in wanted.iter().zip(lists) {
            let known = entry.added.iter().position(|(name, _)| is_numbered(name, wanted));
            let name = known.map(|index| entry.added[index].0.clone());
            let name = name.unwrap_or_else(|| unused_name(&entry.cloud, wanted));
            let place = entry.cloud.attributes.iter().position(|attribute| attribute.name == name);
            let is_double = list.values().any(|run| run.column_type() == ColumnType::F64);
            let column_type = if is_double { ColumnType::F64 } else { ColumnType::F32 };
            let attribute = place.unwrap_or_else(|| {
                entry.cloud.attributes.push(Attribute { name: name.clone(), column_type });
                entry.cloud.attributes.len() - 1
            });
            entry.cloud.attributes[attribute].column_type = column_type;
            changes = entry.put_late_column(attribute, list.clone());
            first.get_or_insert_with(|| name.clone());
            let list = Arc::new(list);
            match known {
                Some(index) => entry.added[index].1 = list,
                None => entry.added.push((name, list)),
            }
        }
        // The figures are those of the values before.
        entry.figures_basis = None;
        entry.marked = Vec::new();
        changes.into_iter().for_each(|change| beside.outside.change(change));
        first
    }

    /// The values that comparisons and ghosts have added to clouds of files, for the files of these clouds.
    pub fn added_values(&self) -> Vec<(Place, String, Arc<Runs>)> {
        let of_entry = |entry: &CloudEntry| {
            let place = entry.source.as_ref().map(|source| (source.info().path.clone(), source.info().scan_number()));
            let values = entry.added.clone().into_iter();
            place.into_iter().flat_map(move |place| values.clone().map(move |(name, list)| (place.clone(), name, list)))
        };
        self.clouds.iter().filter(|entry| entry.is_visible).flat_map(of_entry).collect()
    }
}

/// Where the points of an open cloud come from.
fn ends(entry: &CloudEntry) -> Result<Ends, String> {
    if entry.streamed.is_some() {
        entry.check_unchanged().map_err(|error| error.to_string())?;
        return Ok(Ends::Files(vec![entry.input.clone()]));
    }
    if !entry.is_read {
        return Err(text!("{cloud}: wait until it is loaded", cloud = entry.cloud.name));
    }
    Ok(Ends::Memory { cloud: entry.cloud.clone(), up: entry.up, units: entry.units })
}

/// Whether a name is the wanted one, with a number or without.
fn is_numbered(name: &str, wanted: &str) -> bool {
    let rest = name.strip_prefix(wanted).map(|rest| rest.strip_prefix('_').map_or(rest.is_empty(), is_number));
    rest.unwrap_or(false)
}

fn is_number(text: &str) -> bool {
    text.parse::<u32>().is_ok()
}

/// A name that no attribute of the cloud has.
fn unused_name(cloud: &Cloud, name: &str) -> String {
    let is_taken = |name: &String| cloud.attributes.iter().any(|attribute| attribute.name == *name);
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|name| !is_taken(name)).unwrap_or_default()
}

pub fn color_by(attribute: &str, beside: &mut Beside<'_>) {
    let color = &mut beside.scene.settings.color;
    (color.by, color.attribute) = (ColorBy::Attribute, attribute.to_owned());
}

#[cfg(test)]
mod tests {
    use cloud::Chunk;
    use glam::DVec3;
    use world::{Event, Opened, Part};

    use super::*;
    use crate::shared::comparing::Scales;
    use crate::viewer::loaded::Writing;
    use crate::viewer::objects::clouds::Streamed;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::Found;
    use crate::viewer::session::Session;

    /// Two plates, of which the second is 0.25 higher on one half.
    fn session() -> Session {
        let mut session = Session::new(Preferences::default());
        let outside = &session.outside;
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), outside.now);
        for (cloud, rise) in [(0, 0.0), (1, 0.25)] {
            let name = format!("{cloud}.ply");
            let opened =
                Opened { name: name.clone(), input: name, expected_points: 800, up: DVec3::Z, ..Default::default() };
            let point = |index: usize| {
                let place = [(index % 40) as f32 * 0.1, (index / 40) as f32 * 0.1];
                [place[0], place[1], if place[0] > 2.0 { rise } else { 0.0 }]
            };
            session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud, opened }, beside));
            for block in 0..2 {
                let points = (block * 400..(block + 1) * 400).map(point).collect();
                let chunk = Chunk::new(block as u64 * 400, DVec3::ZERO, points);
                let event = Event::Chunk { cloud, part: Part::Block(block as u64), chunk };
                session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
            }
            let event = Event::Read { cloud, summary: codec::Summary::default() };
            session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
        }
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Finished, beside));
        session
    }

    fn start(session: &mut Session, change: impl FnOnce(&mut CompareDraft)) -> Option<Comparing> {
        session.outside.effects.clear();
        let mut draft = session.loaded.comparisons.draft.clone();
        change(&mut draft);
        session.act(Action::Compare(Compare::Change(Box::new(draft))));
        session.act(Action::Compare(Compare::Start));
        session.outside.effects.drain(..).find_map(|effect| match effect {
            Effect::Work(Work::Compare(comparing)) => Some(*comparing),
            _ => None,
        })
    }

    fn finish(session: &mut Session, comparing: Comparing) {
        session.on_found(Found::Compared(Box::new(comparing.run())));
    }

    #[test]
    fn distances_become_an_attribute_that_colours_the_points_and_a_second_run_replaces_it() {
        let mut session = session();
        let second = session.loaded.clouds[1].key;
        let comparing = start(&mut session, |draft| draft.second = Second::Cloud(second)).unwrap();
        assert!(session.loaded.comparisons.under_way.is_some());
        finish(&mut session, comparing);
        assert!(session.loaded.comparisons.under_way.is_none());
        let last = session.loaded.comparisons.last.as_ref().unwrap();
        assert!(
            last.figures.points == 800 && last.significant.is_none() && last.figures.max > 0.1,
            "{:?}",
            last.figures
        );
        let names = |session: &Session| {
            let attributes = &session.loaded.clouds[0].cloud.attributes;
            attributes.iter().map(|attribute| attribute.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(&session), ["distance"]);
        // They are in no file until the points are saved.
        let asks = |session: &mut Session| {
            session.act(Action::Quit);
            let asks = session.document.asked.take().is_some();
            assert!(asks != std::mem::take(&mut session.wants_to_quit));
            asks
        };
        assert!(asks(&mut session));
        let saved = Arc::downgrade(&session.loaded.clouds[0].added[0].1);
        session.loaded.writing = Some(Writing { path: "a.laz".into(), progress: Arc::default(), added: vec![saved] });
        let exported = codec::Exported {
            points: 800,
            missing: 0,
            bounds: cloud::Bounds::EMPTY,
            attributes: Vec::new(),
            changes: Vec::new(),
            warnings: Vec::new(),
        };
        session.on_found(Found::Exported { path: "a.laz".into(), result: Ok(Some(exported)) });
        assert!(!asks(&mut session));
        let color = &session.scene.settings.color;
        assert_eq!((color.by, color.attribute.as_str()), (ColorBy::Attribute, "distance"));
        let value = |session: &Session, which: usize, point: usize| {
            let chunk = &session.loaded.clouds[0].cloud.chunks[point / 400];
            chunk.columns[which].as_ref().unwrap().value(point % 400)
        };
        assert!(value(&session, 0, 405) == 0.0 && value(&session, 0, 435) > 0.1);
        let m3c2 = |draft: &mut CompareDraft| {
            draft.is_m3c2 = true;
            draft.scales = Scales { normal: Some(0.5), cylinder: Some(0.4), reach: Some(1.0), registration: 0.0 };
        };
        let comparing = start(&mut session, m3c2).unwrap();
        finish(&mut session, comparing);
        assert_eq!(names(&session), ["distance", "level_of_detection"]);
        assert!((value(&session, 0, 435) - 0.25).abs() < 1e-6 && value(&session, 1, 435) < 0.01);
        assert!(session.loaded.comparisons.last.as_ref().unwrap().significant.is_some());
    }

    #[test]
    fn a_comparison_says_nothing_of_the_clouds_that_it_did_not_compare() {
        let mut session = session();
        session.set_view_size([64, 48]);
        let second = session.loaded.clouds[1].key;
        let comparing = start(&mut session, |draft| draft.second = Second::Cloud(second)).unwrap();
        finish(&mut session, comparing);
        let said = |session: &mut Session| {
            session.step(std::time::Instant::now(), false);
            for effect in std::mem::take(&mut session.outside.effects) {
                let Effect::Work(work) = effect else { continue };
                let found = std::cell::RefCell::new(Vec::new());
                work.run(&Default::default(), |news| found.borrow_mut().push(news));
                found.into_inner().into_iter().for_each(|news| session.on_found(news));
            }
            session.outside.messages.all.iter().map(|message| message.text.clone()).collect::<Vec<_>>()
        };
        assert_eq!(said(&mut session), ["Compared: 0.ply to 1.ply, nearest points"]);
        let lacks = |session: &Session, index: usize| {
            session.loaded.clouds[index].figures.as_ref().is_some_and(|figures| figures.warning.is_some())
        };
        assert_eq!([0, 1].map(|index| lacks(&session, index)), [false, true]);
        // What neither of them has is another matter.
        session.scene.settings.color.attribute = "amplitude".into();
        assert_eq!(said(&mut session).len(), 3);
    }

    #[test]
    fn the_distances_of_a_streamed_cloud_go_to_a_new_file_that_is_opened_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let header = "ply\nformat ascii 1.0\nelement vertex 400\nproperty double x\nproperty double y\n";
        for (name, height) in [("a.ply", 0.0), ("b.ply", 0.25)] {
            let row = |at: i32| format!("{} {} {height}\n", f64::from(at % 20) * 0.1, f64::from(at / 20) * 0.1);
            let rows: String = (0..400).map(row).collect();
            std::fs::write(place(name), format!("{header}property double z\nend_header\n{rows}")).unwrap();
        }
        let mut session = session();
        let entry = &mut session.loaded.clouds[0];
        (entry.input, entry.streamed) = (place("a.ply"), Some(Streamed::new(None, 1)));
        let output = place("distances.copc.laz");
        let choose = |draft: &mut CompareDraft| {
            (draft.second, draft.is_m3c2, draft.output) = (Second::File(place("b.ply")), true, output.clone());
        };
        let comparing = start(&mut session, choose).unwrap();
        finish(&mut session, comparing);
        let figures = session.loaded.comparisons.last.as_ref().unwrap().figures;
        assert!(figures.points == 400 && (figures.mean - 0.25).abs() < 1e-6, "{figures:?}");
        let written = codec::open(Path::new(&output)).unwrap();
        let has = |name: &str| written.info().properties.iter().any(|own| own.name == name);
        assert!(written.info().points == 400 && has("distance") && has("level_of_detection"));
        let opened = session.outside.effects.iter().find_map(|effect| match effect {
            Effect::Load { inputs } => Some(inputs.iter().map(world::Input::name).collect::<Vec<_>>()),
            _ => None,
        });
        assert!(opened.is_some_and(|opened| opened == [output.clone()]));
        assert!(!session.loaded.clouds[0].is_visible, "the new file takes its place");
        let color = &session.scene.settings.color;
        assert_eq!((color.by, color.attribute.as_str()), (ColorBy::Attribute, "distance"));
        assert!(start(&mut session, |_| {}).is_none(), "a file that is there is not replaced");
        // A place that cannot be written is refused before the work, and one that is gone after it loses no figures.
        let nowhere = place("nowhere/distances.laz");
        assert!(start(&mut session, |draft| draft.output = nowhere.clone()).is_none(), "its folder is missing");
        let said = |session: &Session| {
            session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default()
        };
        assert!(said(&session).contains("nowhere"), "{}", said(&session));
        session.loaded.comparisons.last = None;
        std::fs::create_dir(place("nowhere")).unwrap();
        let comparing = start(&mut session, |draft| draft.output = nowhere.clone()).unwrap();
        std::fs::remove_dir(place("nowhere")).unwrap();
        finish(&mut session, comparing);
        assert!(session.loaded.comparisons.last.as_ref().is_some_and(|last| last.figures.points == 400));
        assert!(said(&session).contains("nowhere"), "{}", said(&session));
        assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Load { .. })));
        // Without room for the points nothing is written.
        session.scene.settings.stream.host_bytes.0 = 2 * 400 * 70 - 2;
        let second = place("second.laz");
        let refused = start(&mut session, |draft| draft.output = second.clone()).unwrap();
        finish(&mut session, refused);
        let said = session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default();
        assert!(
            said.starts_with("to compare 400 points with 400 takes up to") && !Path::new(&second).exists(),
            "{said}"
        );
    }

    #[test]
    fn what_cannot_be_compared_is_said_and_a_comparison_is_stopped() {
        let mut session = session();
        let [first, second] = [0, 1].map(|index| session.loaded.clouds[index].key);
        let problems = |session: &Session| {
            session.outside.messages.all.iter().map(|message| message.text.as_str()).collect::<Vec<_>>().join("\n")
        };
        for (chosen, mentioned) in [
            (Second::File("  ".into()), "Choose a second cloud"),
            (Second::Cloud(first), "no distance to itself"),
            (Second::Cloud(CloudKey(99)), "Choose a second cloud"),
        ] {
            assert!(start(&mut session, |draft| draft.second = chosen).is_none());
            assert!(problems(&session).contains(mentioned), "{mentioned}: {}", problems(&session));
        }
        let gone = start(&mut session, |draft| draft.second = Second::File("/gone.laz".into())).unwrap();
        finish(&mut session, gone);
        assert!(problems(&session).contains("/gone.laz"), "{}", problems(&session));
        let comparing = start(&mut session, |draft| draft.second = Second::Cloud(second)).unwrap();
        assert!(start(&mut session, |_| {}).is_none(), "one at a time");
        session.act(Action::Compare(Compare::Stop));
        finish(&mut session, comparing);
        assert!(session.loaded.comparisons.last.is_none() && session.loaded.clouds[0].cloud.attributes.is_empty());
    }
}
