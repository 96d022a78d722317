//! A study's folder: the plan that is measured there and the journal of its runs, so that a stopped study can continue,
//! and shards of one plan can be merged.

use std::collections::{BTreeMap, HashSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use crate::plan::{Case, Plan};
use crate::results::{Machine, Run, counted};

const PLAN: &str = "plan.toml";
const JOURNAL: &str = "runs.jsonl";
/// What the scenes were read from when they were measured.
const SCENES: &str = "scenes.json";
/// Locked by the process that writes to the folder. Not the journal itself: Windows lets nobody else read a locked file.
const LOCK: &str = ".lock";

/// The errors of a study's folder.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    #[error("{path}: {reason}")]
    Unread { path: PathBuf, reason: std::io::Error },
    #[error(transparent)]
    Unwritten(codec::Error),
    #[error(transparent)]
    SideFile(#[from] scene::Error),
    #[error("{folder}: holds the results of another plan (`{title}`); name another folder, or delete that one")]
    OtherPlan { folder: PathBuf, title: String },
    #[error("{folder}: no study's folder, there is no plan.toml in it; expected what `glint study PLAN -o DIR` wrote")]
    NoStudy { folder: PathBuf },
    #[error("{folder}: another `glint study` is at work there; wait for it, or name another folder")]
    InUse { folder: PathBuf },
    #[error("{folder}: its plan differs from that of {first}; only shards of one plan can be joined")]
    PlansDiffer { folder: PathBuf, first: PathBuf },
    #[error(
        "{folder}: {file} of the scene {scene} has changed since the scene was measured there; name another folder, or \
         delete that one to begin anew"
    )]
    SceneChanged { folder: PathBuf, scene: String, file: String },
    #[error(
        "{folder}: {file} of the scene {scene} was another one in {other}; only shards of the same scenes can be joined"
    )]
    ScenesDiffer { folder: PathBuf, other: PathBuf, scene: String, file: String },
    #[error("{place}: {problem}; expected what a study of this plan wrote; delete the folder to begin anew")]
    Malformed { place: String, problem: String },
}

/// For each scene the checksums of the files that it is read from, by their names.
pub type SceneFiles = BTreeMap<String, BTreeMap<String, String>>;

/// A plan and its runs so far.
pub struct Folder {
    pub path: PathBuf,
    pub plan: Plan,
    pub cases: Vec<Case>,
    pub runs: Vec<Run>,
    /// The journal; runs are appended after the last whole line.
    journal: File,
    /// Holds the folder's lock until it is closed.
    _lock: File,
}

impl Folder {
    /// Opens a folder for a plan, or continues with the runs in it. `about` is put before the plan as a comment.
    ///
    /// # Errors
    /// A folder that cannot be written, that holds another plan, or that another process writes to.
    pub fn open(path: &Path, plan: Plan, about: &str) -> Result<Self, FolderError> {
        std::fs::create_dir_all(path).map_err(|reason| unwritten(path, reason))?;
        let journal_path = path.join(JOURNAL);
        if let Some(kept) = kept_plan(path)? {
            if kept != plan {
                return Err(FolderError::OtherPlan { folder: path.to_owned(), title: kept.title });
            }
        } else if journal_path.exists() {
            return Err(FolderError::NoStudy { folder: path.to_owned() });
        } else {
            let about: String = about.lines().map(|line| format!("# {line}\n")).collect();
            write_whole(&path.join(PLAN), (about + &plan.to_text()).as_bytes())?;
        }
        let cases = plan.cases();
        let lock = locked(path)?;
        let in_journal = |reason| unwritten(&journal_path, reason);
        check_regular(&journal_path)?;
        // Not to append: Windows gives such a file no right to cut off a torn line.
        let open = OpenOptions::new().create(true).read(true).write(true).truncate(false).open(&journal_path);
        let mut journal = open.map_err(in_journal)?;
        let mut bytes = Vec::new();
        journal.read_to_end(&mut bytes).map_err(in_journal)?;
        let (runs, whole) = whole_runs(&journal_path, &bytes, cases.len())?;
        // A line that was torn when the program ended is dropped.
        journal.set_len(whole).and_then(|()| journal.seek(SeekFrom::End(0))).map_err(in_journal)?;
        Ok(Self { path: path.to_owned(), plan, cases, runs, journal, _lock: lock })
    }

    /// Joins folders of one plan into another one.
    ///
    /// # Errors
    /// Folders of different plans, or that are no study's.
    pub fn merge(folders: &[PathBuf], into: &Path, about: &str) -> Result<Self, FolderError> {
        let mut plan: Option<Plan> = None;
        let mut runs: Vec<Run> = Vec::new();
        let mut scenes: BTreeMap<String, (PathBuf, BTreeMap<String, String>)> = BTreeMap::new();
        for folder in folders {
            for (scene, files) in kept_scenes(folder)? {
                let (other, known) = scenes.entry(scene.clone()).or_insert_with(|| (folder.clone(), files.clone()));
                if let Some(file) = difference(known, &files) {
                    let (folder, other) = (folder.clone(), other.clone());
                    return Err(FolderError::ScenesDiffer { folder, other, scene, file });
                }
            }
            let own = kept_plan(folder)?.ok_or_else(|| FolderError::NoStudy { folder: folder.clone() })?;
            let own_runs = read_journal(&folder.join(JOURNAL), own.cases().len())?;
            match &plan {
                Some(plan) if *plan != own => {
                    return Err(FolderError::PlansDiffer { folder: folder.clone(), first: folders[0].clone() });
                }
                _ => plan = Some(own),
            }
            runs.extend(own_runs);
        }
        let plan = plan.ok_or_else(|| FolderError::NoStudy { folder: into.to_owned() })?;
        let mut joined = Self::open(into, plan, about)?;
        joined.keep_scenes(scenes.into_iter().map(|(scene, (_, files))| (scene, files)).collect())?;
        let key = |run: &Run| (run.case, run.round, run.machine.clone(), run.error.clone());
        let mut known: HashSet<_> = joined.runs.iter().map(key).collect();
        for run in runs {
            if known.insert(key(&run)) {
                joined.add(run)?;
            }
        }
        Ok(joined)
    }

    /// The settings and rounds that `machine` need not run: those that it ran without a failure, and all of settings
    /// that another machine has finished. A setting that another machine or version has begun is measured anew as a
    /// whole.
    pub fn done(&self, machine: &Machine) -> HashSet<(usize, u32)> {
        let own = self.runs.iter().filter(|run| run.machine == *machine && run.error.is_none());
        let mut done: HashSet<(usize, u32)> = own.map(|run| (run.case, run.round)).collect();
        for (case, rounds) in counted(&self.runs) {
            let all = 0..=self.plan.repeats;
            if all.clone().all(|round| rounds.get(&round).is_some_and(|run| run.error.is_none())) {
                done.extend(all.map(|round| (case, round)));
            }
        }
        done
    }

    /// Keeps what the scenes are read from now. A scene that has changed and of which nothing is measured yet is taken
    /// anew.
    ///
    /// # Errors
    /// A scene that was measured has changed; or the folder cannot be read or written.
    pub fn keep_scenes(&self, now: SceneFiles) -> Result<(), FolderError> {
        let mut kept = kept_scenes(&self.path)?;
        let is_measured = |scene: &str| {
            let of_run = |run: &Run| self.cases.get(run.case).is_some_and(|case| case.scene == scene);
            self.runs.iter().any(|run| run.error.is_none() && of_run(run))
        };
        for (scene, files) in now {
            if let Some(file) = kept.get(&scene).and_then(|known| difference(known, &files))
                && is_measured(&scene)
            {
                return Err(FolderError::SceneChanged { folder: self.path.clone(), scene, file });
            }
            // What is known of a file that cannot be read now stays.
            let known = kept.entry(scene).or_default();
            let (unread, read): (BTreeMap<_, _>, _) = files.into_iter().partition(|(_, sum)| sum.is_empty());
            let mut all = read;
            all.extend(unread.into_keys().map(|name| (name.clone(), known.remove(&name).unwrap_or_default())));
            known.retain(|name, _| name.ends_with(OF_TILES) && !all.contains_key(name));
            all.append(known);
            *known = all;
        }
        self.write(SCENES, (serde_json::to_string_pretty(&kept).unwrap_or_default() + "\n").as_bytes())
    }

    /// Appends a run to the journal.
    ///
    /// # Errors
    /// The disk is full, or the folder is gone.
    pub fn add(&mut self, run: Run) -> Result<(), FolderError> {
        let path = self.path.join(JOURNAL);
        let mut line = serde_json::to_string(&run).unwrap_or_default();
        line.push('\n');
        let written = self.journal.write_all(line.as_bytes()).and_then(|()| self.journal.flush());
        written.map_err(|reason| unwritten(&path, reason))?;
        self.runs.push(run);
        Ok(())
    }

    /// Writes a file of results.
    ///
    /// # Errors
    /// The disk is full, or the folder is gone.
    pub fn write(&self, name: &str, content: &[u8]) -> Result<(), FolderError> {
        write_whole(&self.path.join(name), content)
    }
}

/// Locks a folder.
fn locked(folder: &Path) -> Result<File, FolderError> {
    let path = folder.join(LOCK);
    check_regular(&path)?;
    let open = OpenOptions::new().create(true).write(true).truncate(false).open(&path);
    let lock = open.map_err(|reason| unwritten(&path, reason))?;
    // Some file systems of clusters have no locks: there other writers cannot be detected.
    match lock.try_lock() {
        Err(TryLockError::WouldBlock) => Err(FolderError::InUse { folder: folder.to_owned() }),
        _ => Ok(lock),
    }
}

fn kept_plan(folder: &Path) -> Result<Option<Plan>, FolderError> {
    let path = folder.join(PLAN);
    let text = match scene::whole_file::read(&path) {
        Ok(text) => text,
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let plan = Plan::parse(&path.display().to_string(), &text);
    plan.map(Some).map_err(|error| FolderError::Malformed { place: error.place, problem: error.problem })
}

/// What the scenes of a folder were read from; nothing in a folder that an older version has made.
fn kept_scenes(folder: &Path) -> Result<SceneFiles, FolderError> {
    let path = folder.join(SCENES);
    let text = match scene::whole_file::read(&path) {
        Ok(text) => text,
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => return Ok(SceneFiles::new()),
        Err(error) => return Err(error.into()),
    };
    let malformed = |error: serde_json::Error| FolderError::Malformed {
        place: path.display().to_string(),
        problem: error.to_string(),
    };
    serde_json::from_str(&text).map_err(malformed)
}

/// The end of the name under which the tiles of a file have their checksum.
pub const OF_TILES: &str = " (tiles)";

/// The name of the first file that one scene has and another one lacks or has otherwise. Nothing is known of files without
/// a sum, which could not be read, nor of tiles without one: earlier versions did not look at them.
fn difference(known: &BTreeMap<String, String>, now: &BTreeMap<String, String>) -> Option<String> {
    let is_other = |name: &&String| {
        let [known, now] = [known, now].map(|files| files.get(*name));
        let is_known = |sum: Option<&String>| sum.map_or(!name.ends_with(OF_TILES), |sum| !sum.is_empty());
        known != now && is_known(known) && is_known(now)
    };
    known.keys().chain(now.keys()).find(is_other).cloned()
}

fn read_journal(path: &Path, cases: usize) -> Result<Vec<Run>, FolderError> {
    check_regular(path)?;
    match std::fs::read(path) {
        Ok(bytes) => Ok(whole_runs(path, &bytes, cases)?.0),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(reason) => Err(FolderError::Unread { path: path.to_owned(), reason }),
    }
}

/// Checks that a file is a regular one, if it exists: opening anything else of its name could block.
fn check_regular(path: &Path) -> Result<(), FolderError> {
    match std::fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            let reason = std::io::Error::other("not a regular file");
            Err(FolderError::Unread { path: path.to_owned(), reason })
        }
        _ => Ok(()),
    }
}

fn unwritten(path: &Path, reason: std::io::Error) -> FolderError {
    FolderError::Unwritten(codec::Error::not_written(path, reason))
}

/// The runs of a journal's whole lines, and the number of bytes of these lines. A last line without an end, or that is
/// no JSON, was torn.
fn whole_runs(path: &Path, bytes: &[u8], cases: usize) -> Result<(Vec<Run>, u64), FolderError> {
    let text = String::from_utf8_lossy(bytes);
    let (mut runs, mut whole) = (Vec::new(), 0);
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    for (index, line) in lines.iter().enumerate() {
        let problem = match serde_json::from_str::<Run>(line) {
            Ok(run) if line.ends_with('\n') && run.case < cases => {
                runs.push(run);
                whole += line.len() as u64;
                continue;
            }
            Ok(run) if run.case >= cases => format!("setting {} of {cases}", run.case),
            Ok(_) => "the end of the line is missing".into(),
            Err(error) => error.to_string(),
        };
        if index + 1 < lines.len() {
            let place = format!("{}:{}", path.display(), index + 1);
            return Err(FolderError::Malformed { place, problem });
        }
    }
    Ok((runs, whole))
}

/// Writes a file so that it appears whole or not at all.
fn write_whole(path: &Path, content: &[u8]) -> Result<(), FolderError> {
    let io = |reason| unwritten(path, reason);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = path.with_file_name(format!(".{}.{}.partial", codec::short_file_name(&name), std::process::id()));
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    let written = std::fs::write(&partial, content).and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        let _ = std::fs::remove_file(&partial);
    }
    written.map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::TimedPass;

    fn plan(title: &str) -> Plan {
        let group = "[[group]]\nscenes = [\"five-mirrors/sphere\"]\nsweep = { \"splat.size\" = [1, 2, 3] }";
        Plan::parse("test", &format!("title = \"{title}\"\n{group}")).unwrap()
    }

    fn run(case: usize, round: u32) -> Run {
        Run {
            case,
            round,
            frame_ms: Some(0.1 + case as f64),
            passes: vec![TimedPass { name: "sscr_solve".into(), stage: render::PassStage::Method, ms: 2.5 }],
            ..Run::default()
        }
    }

    #[test]
    fn runs_come_back_and_a_torn_last_line_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = Folder::open(folder.path(), plan("one"), "glint study one").unwrap();
        let runs = [run(0, 0), run(1, 0), run(2, 0)];
        runs.iter().for_each(|run| first.add(run.clone()).unwrap());
        drop(first);
        let path = folder.path().join(JOURNAL);
        let whole = std::fs::read(&path).unwrap();
        // Cut anywhere in the last line, its end included.
        let last = whole[..whole.len() - 1].iter().rposition(|byte| *byte == b'\n').unwrap() + 1;
        for cut in [last + 1, last + 20, whole.len() - 1] {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let mut again = Folder::open(folder.path(), plan("one"), "").unwrap();
            assert_eq!(again.runs, runs[..2]);
            again.add(run(2, 0)).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
        let text = std::fs::read_to_string(folder.path().join(PLAN)).unwrap();
        assert!(text.starts_with("# glint study one\n"), "{text}");
    }

    #[test]
    fn a_folder_of_another_plan_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        Folder::open(folder.path(), plan("one"), "").unwrap();
        let error = Folder::open(folder.path(), plan("two"), "").err().unwrap().to_string();
        assert!(error.contains("another plan (`one`)") && error.lines().count() == 1, "{error}");
        std::fs::write(folder.path().join(JOURNAL), "{\"case\":7}\n{\"case\":0}\n").unwrap();
        let error = Folder::open(folder.path(), plan("one"), "").err().unwrap().to_string();
        assert!(error.contains("runs.jsonl:1") && error.contains("setting 7 of 3"), "{error}");
    }

    #[test]
    fn a_scene_that_has_changed_since_it_was_measured_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, all] = ["a", "b", "all"].map(|name| folder.path().join(name));
        let files = |sum: &str| {
            let files = [("a.toml".to_owned(), "1".to_owned()), ("a.laz".to_owned(), sum.to_owned())].into();
            SceneFiles::from([("five-mirrors/sphere".to_owned(), files)])
        };
        let mut study = Folder::open(&a, plan("one"), "").unwrap();
        study.keep_scenes(files("old")).unwrap();
        study.add(Run { error: Some("unread".into()), ..run(0, 0) }).unwrap();
        study.keep_scenes(files("mended")).unwrap();
        study.add(run(0, 0)).unwrap();
        study.keep_scenes(files("mended")).unwrap();
        // Nothing is known of a file that cannot be read, and what was known of it stays.
        study.keep_scenes(files("")).unwrap();
        // Nor of tiles that an earlier version did not look at, or whose catalogue cannot be read.
        let with_tiles = |sum: &str| {
            let mut all = files("mended");
            all.values_mut().for_each(|files| drop(files.insert(format!("all.vpc{OF_TILES}"), sum.to_owned())));
            all
        };
        study.keep_scenes(with_tiles("old")).unwrap();
        study.keep_scenes(files("mended")).unwrap();
        let error = study.keep_scenes(with_tiles("other")).unwrap_err().to_string();
        assert!(error.contains("all.vpc (tiles) of the scene"), "{error}");
        let error = study.keep_scenes(files("other")).unwrap_err().to_string();
        assert!(error.contains("a.laz of the scene five-mirrors/sphere has changed") && error.contains("name another"));
        Folder::open(&b, plan("one"), "").unwrap().keep_scenes(files("other")).unwrap();
        drop(study);
        let error = Folder::merge(&[a.clone(), b], &all, "").err().unwrap().to_string();
        assert!(error.contains("a.laz of the scene five-mirrors/sphere was another one in"), "{error}");
        Folder::merge(&[a], &all, "").unwrap();
        assert_eq!(kept_scenes(&all).unwrap(), with_tiles("old"));
    }

    #[test]
    fn a_folder_is_written_by_one_process_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let first = Folder::open(folder.path(), plan("one"), "").unwrap();
        let error = Folder::open(folder.path(), plan("one"), "").err().unwrap().to_string();
        assert!(error.contains("another `glint study` is at work") && error.lines().count() == 1, "{error}");
        // Meanwhile others may read what is there, on Windows too: the journal itself is not locked.
        assert!(File::open(folder.path().join(JOURNAL)).unwrap().try_lock_shared().is_ok());
        let all = tempfile::tempdir().unwrap();
        assert!(Folder::merge(&[folder.path().to_owned()], &all.path().join("all"), "").is_ok());
        drop(first);
        assert!(Folder::open(folder.path(), plan("one"), "").is_ok());
    }

    #[test]
    fn what_another_version_began_is_made_anew_and_what_it_finished_stays() {
        let folder = tempfile::tempdir().unwrap();
        let mut study = Folder::open(folder.path(), plan("one"), "").unwrap();
        let machine = |commit: &str| Machine { commit: commit.into(), ..Machine::default() };
        let mut made = |case, rounds: &[u32], commit: &str| {
            rounds.iter().for_each(|round| study.add(Run { machine: machine(commit), ..run(case, *round) }).unwrap());
        };
        made(0, &[0, 1, 2, 3], "old");
        made(1, &[0, 1], "old");
        made(1, &[0], "new");
        made(2, &[0, 1, 2], "new");
        let mut done: Vec<(usize, u32)> = study.done(&machine("new")).into_iter().collect();
        done.sort_unstable();
        assert_eq!(done, [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (2, 1), (2, 2)]);
    }

    #[test]
    fn shards_are_joined_once_and_only_of_one_plan() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, c, all] = ["a", "b", "c", "all"].map(|name| folder.path().join(name));
        for (path, title, cases) in [(&a, "one", vec![0, 2]), (&b, "one", vec![1, 2]), (&c, "two", vec![0])] {
            let mut shard = Folder::open(path, plan(title), "").unwrap();
            cases.iter().for_each(|case| shard.add(run(*case, 0)).unwrap());
        }
        for _ in 0..2 {
            let joined = Folder::merge(&[a.clone(), b.clone()], &all, "").unwrap();
            assert_eq!(joined.runs, [run(0, 0), run(2, 0), run(1, 0)]);
        }
        let error = Folder::merge(&[a.clone(), c], &all, "").err().unwrap().to_string();
        assert!(error.contains("differs"), "{error}");
        let nothing = Folder::merge(&[a, folder.path().join("none")], &all, "").err().unwrap().to_string();
        assert!(nothing.contains("no study's folder"), "{nothing}");
    }
}
