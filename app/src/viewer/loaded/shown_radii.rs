//! The radii of clouds while classes or filters hide some of their points: a worker thread estimates them anew.

use std::sync::Arc;

use cloud::{PointTest, Progress};
use serde_json::json;
use world::CloudKey;

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::requests::work::Work;

impl Loaded {
    /// Requests the radii of clouds of which classes or filters hide other points than before. Called every frame of
    /// the window.
    pub fn renew_radii(&mut self, beside: &mut Beside<'_>) {
        let test = beside.scene.objects.test().of_attributes();
        for entry in self.clouds.iter_mut().filter(|entry| entry.has_estimated_radii()) {
            let is_wanted = entry.fitting.as_ref().map_or(entry.radii_test != test, |(fitted, _)| *fitted != test);
            let is_read = |column: usize| !matches!(entry.column_reads.get(&column), Some(Some(_)));
            // Filters hide nothing by columns that are still being read.
            if !is_wanted || beside.scene.navigation.is_held() || !entry.cloud.lacks(&test).into_iter().all(is_read) {
                continue;
            }
            if let Some((_, progress)) = entry.fitting.take() {
                progress.cancel();
            }
            if entry.radii_test == test {
                continue;
            }
            if test.shows_all() {
                entry.radii_test = test.clone();
                entry.marked = Vec::new();
                entry.surfels += 1;
                entry.put_radii(None).into_iter().for_each(|change| beside.outside.change(change));
                beside.frames.points_changed();
                continue;
            }
            let progress = Arc::<Progress>::default();
            entry.fitting = Some((test.clone(), progress.clone()));
            let (key, cloud, up, scanner) = (entry.key, entry.with_full_radii(), entry.up, entry.scanner);
            let settings = Box::new(beside.scene.settings.clone());
            beside.outside.work(Work::FitRadii { key, cloud, up, scanner, settings, test: test.clone(), progress });
        }
    }

    pub fn on_radii(
        &mut self,
        key: CloudKey,
        test: &PointTest,
        radii: Option<Vec<Arc<Vec<u16>>>>,
        beside: &mut Beside<'_>,
    ) {
        let Some(entry) = self.cloud_mut(key) else { return };
        // Other radii may be wanted meanwhile.
        if entry.fitting.take_if(|(fitted, _)| fitted == test).is_none() {
            return;
        }
        let Some(radii) = radii else { return };
        entry.radii_test = test.clone();
        // Nothing that is hidden now is in this cloud, or was before.
        if entry.cloud.chunks.iter().zip(&radii).all(|(chunk, radii)| chunk.radii.as_ref() == Some(radii)) {
            return;
        }
        // The new radii require that the reflecting points are found again.
        entry.marked = Vec::new();
        entry.surfels += 1;
        let name = entry.cloud.name.clone();
        entry.put_radii(Some(radii)).into_iter().for_each(|change| beside.outside.change(change));
        beside.frames.points_changed();
        beside.outside.log(json!({ "event": "radii", "name": name }));
    }
}

#[cfg(test)]
mod tests {
    use scene::Settings;
    use world::{Event, Opened, Part};

    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::session::Session;

    /// A session with a square of points in a file, every fourth of them along each side in class 2, the others in class
    /// 7. Its radii are there.
    fn session(folder: &tempfile::TempDir) -> Session {
        let path = folder.path().join("square.ply");
        let mut text = "ply\nformat ascii 1.0\nelement vertex 1681\nproperty float x\nproperty float y\n\
            property float z\nproperty uchar classification\nend_header\n"
            .to_owned();
        for (x, y) in (0..41).flat_map(|x| (0..41).map(move |y| (x, y))) {
            let class = if x % 4 == 0 && y % 4 == 0 { 2 } else { 7 };
            text += &format!("{x} {y} 0 {class}\n");
        }
        std::fs::write(&path, text).unwrap();
        let source = Arc::new(codec::open(&path).unwrap());
        let (cloud, _) = world::read_cloud(&source, &[], &Settings::default(), &Progress::default()).unwrap();
        let options = world::options_for(&cloud.chunks, glam::DVec3::Z, None, &Settings::default());
        let surfels = cloud::estimate(&cloud.chunks, &options, &Progress::default()).unwrap();
        let mut session = Session::new(Preferences::default());
        let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let (attributes, source) = (cloud.attributes, Some(source));
        let opened = Opened { attributes, source, expected_points: 1681, up: glam::DVec3::Z, ..Opened::default() };
        let chunks = cloud.chunks.into_iter().map(|chunk| {
            let part = Part::Block(chunk.first_point);
            Event::Chunk { cloud: 0, part, chunk }
        });
        let events = std::iter::once(Event::Opened { cloud: 0, opened }).chain(chunks);
        for event in events.chain([Event::Surfels { cloud: 0, surfels }, Event::Finished]) {
            session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
        }
        session
    }

    /// Runs the work that is asked for now, and returns the number of clouds whose radii were estimated.
    fn work(session: &mut Session) -> usize {
        session.with_loaded(Loaded::renew_radii);
        let mut fitted = 0;
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(work @ Work::FitRadii { .. }) = effect {
                let found = std::cell::RefCell::new(Vec::new());
                work.run(&Default::default(), |answer| found.borrow_mut().push(answer));
                assert!(session.loaded.clouds[0].is_busy());
                found.into_inner().into_iter().for_each(|answer| session.on_found(answer));
                fitted += 1;
            }
        }
        fitted
    }

    #[test]
    fn strays_are_counted_by_the_radii_that_came_last() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(&folder);
        let figures = |session: &mut Session| {
            session.with_loaded(Loaded::renew_figures);
            let of_figures = |effect: Effect| match effect {
                Effect::Work(work @ Work::FindFigures { .. }) => Some(work),
                _ => None,
            };
            std::mem::take(&mut session.outside.effects).into_iter().find_map(of_figures)
        };
        let answer = |session: &mut Session, work: Work| {
            let found = std::cell::RefCell::new(Vec::new());
            work.run(&Default::default(), |answer| found.borrow_mut().push(answer));
            found.into_inner().into_iter().for_each(|answer| session.on_found(answer));
            session.loaded.clouds[0].figures.as_ref().unwrap().strays
        };
        session.act(Action::ShowClasses(vec![7], false));
        let early = figures(&mut session).unwrap();
        // Other radii come while the figures are being found.
        let (key, strays) = (session.loaded.clouds[0].key, vec![Arc::new(vec![cloud::STRAY_RADIUS; 1681])]);
        let (test, _) = session.loaded.clouds[0].fitting.clone().unwrap();
        session.with_loaded(|loaded, beside| loaded.on_radii(key, &test, Some(strays), beside));
        assert_eq!(answer(&mut session, early), Some([0, 0]));
        let late = figures(&mut session).unwrap();
        assert_eq!(answer(&mut session, late), Some([1681, 0]));
        assert!(figures(&mut session).is_none());
    }

    #[test]
    fn radii_are_estimated_anew_when_a_class_is_hidden_and_are_the_first_again_when_it_is_shown() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(&folder);
        // The point in the middle, of class 2.
        let middle = |session: &Session| session.loaded.clouds[0].cloud.chunks[0].radii.as_ref().unwrap()[20 * 41 + 20];
        let first = middle(&session);
        assert_eq!(work(&mut session), 0, "nothing is hidden");
        session.act(Action::ShowClasses(vec![7], false));
        assert_eq!((work(&mut session), work(&mut session)), (1, 0));
        let growth = cloud::unpack_radius(middle(&session)).unwrap() / cloud::unpack_radius(first).unwrap();
        assert!((growth - 4.0).abs() < 0.05, "{growth}");
        session.act(Action::ShowClasses(vec![7], true));
        assert_eq!((work(&mut session), middle(&session)), (0, first), "these are still there");
        // What is found too late is left.
        session.act(Action::ShowClasses(vec![7], false));
        session.with_loaded(Loaded::renew_radii);
        let key = session.loaded.clouds[0].key;
        let (test, _) = session.loaded.clouds[0].fitting.clone().unwrap();
        session.act(Action::ShowClasses(vec![7], true));
        session.with_loaded(Loaded::renew_radii);
        session.with_loaded(|loaded, beside| loaded.on_radii(key, &test, Some(vec![Arc::new(vec![9; 1681])]), beside));
        assert_eq!((middle(&session), session.loaded.clouds[0].is_busy()), (first, false));
    }
}
