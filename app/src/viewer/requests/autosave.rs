//! Unsaved work on disk: a scene file in a folder of the program, written anew after changes, so that a crash loses
//! seconds. Each running program holds the lock of its own file; a file whose lock nobody holds was left by a program
//! that ended unexpectedly.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use scene::whole_file;

use crate::shared::language::text;
use crate::system::picture_file;

/// The first line of a file has, as JSON, the path of the scene file that was being worked on, and its checksum.
const PLACE: &str = "# of ";
/// How the files are called.
const START: &str = "unsaved-";
const TEXT: &str = "toml";
const LOCK: &str = "lock";
/// The most files that a start looks at.
const MOST: usize = 50;
/// A lock without a file is removed after this time: its program may only just have made it.
const OLD_LOCK: Duration = Duration::from_secs(24 * 3600);

/// The scene file that work belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Home {
    pub path: PathBuf,
    /// Its checksum when the program last read or wrote it.
    pub known: u32,
}

/// Keeps the unsaved work of this program. All functions may be called from any thread.
pub struct Keeper {
    folder: PathBuf,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The file, and its lock that is held.
    own: Option<(PathBuf, File)>,
    /// Nothing is written any more.
    is_over: bool,
}

impl Keeper {
    pub fn new(folder: PathBuf) -> Arc<Self> {
        Arc::new(Self { folder, state: Mutex::default() })
    }

    /// Writes the work as the text of a scene file, with the file that it belongs to; or removes it.
    ///
    /// # Errors
    /// The folder or the file cannot be written; names it.
    pub fn keep(&self, work: Option<(&str, Option<&Home>)>) -> anyhow::Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.is_over {
            return Ok(());
        }
        let Some((text, home)) = work else {
            if let Some((path, _)) = &state.own {
                let _ = std::fs::remove_file(path);
            }
            return Ok(());
        };
        if state.own.is_none() {
            state.own = Some(self.begin()?);
        }
        let first = home.map_or(String::new(), |home| {
            format!("{PLACE}{}\n", serde_json::json!([home.path.display().to_string(), home.known]))
        });
        let Some((path, _)) = &state.own else { return Ok(()) };
        let written = picture_file::write_text(path, &(first + text));
        if written.is_err() && !path.exists() {
            // The folder may be gone; the next time makes it anew.
            state.own.take().into_iter().for_each(|(path, lock)| remove(&path, lock));
        }
        written
    }

    /// Makes the lock of a file that nobody else has.
    fn begin(&self) -> anyhow::Result<(PathBuf, File)> {
        let unwritten = |reason| codec::Error::not_written(&self.folder, reason);
        std::fs::create_dir_all(&self.folder).map_err(unwritten)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let name = format!("{START}{}-{now}", std::process::id());
        let lock = self.folder.join(format!("{name}.{LOCK}"));
        let held = File::create_new(&lock).map_err(unwritten)?;
        held.lock().map_err(unwritten)?;
        Ok((self.folder.join(format!("{name}.{TEXT}")), held))
    }

    /// Ends the program's work: removes the file, unless it `stays` for the next start.
    pub fn end(&self, stays: bool) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.is_over = true;
        if let Some((path, lock)) = state.own.take().filter(|_| !stays) {
            remove(&path, lock);
        }
    }
}

fn remove(path: &Path, lock: File) {
    let _ = std::fs::remove_file(path);
    let _ = std::fs::remove_file(path.with_extension(LOCK));
    drop(lock);
}

/// Work that another run of the program has left. Its lock is held until the value is dropped.
#[derive(Debug)]
pub struct Abandoned {
    pub path: PathBuf,
    /// The scene file that was being worked on.
    pub home: Option<Home>,
    /// When it was written.
    pub written: SystemTime,
    lock: File,
}

impl Abandoned {
    /// Deletes the work.
    pub fn delete(self) {
        remove(&self.path, self.lock);
    }

    /// What was being worked on.
    pub fn name(&self) -> String {
        let name = self.home.as_ref().and_then(|home| home.path.file_name());
        name.map_or(text!("a scene that has no file").into(), |name| name.to_string_lossy().into_owned())
    }

    /// Says how long ago it was written: `3 minutes ago`.
    pub fn age(&self) -> String {
        let seconds = self.written.elapsed().unwrap_or_default().as_secs();
        match seconds {
            0..120 => text!("a minute ago").into(),
            120..7200 => text!("{number} minutes ago", number = seconds / 60),
            7200..172_800 => text!("{number} hours ago", number = seconds / 3600),
            _ => text!("{number} days ago", number = seconds / 86_400),
        }
    }
}

/// Finds the work in a folder whose programs have ended, the newest last, and locks it.
pub fn abandoned(folder: &Path) -> Vec<Abandoned> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_ours = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(START));
    let mut found: Vec<Abandoned> = Vec::new();
    for lock_path in entries.filter(is_ours).filter(|path| path.extension().is_some_and(|kind| kind == LOCK)).take(MOST)
    {
        let Ok(lock) = File::open(&lock_path) else { continue };
        if let Err(TryLockError::WouldBlock | TryLockError::Error(_)) = lock.try_lock() {
            continue;
        }
        let path = lock_path.with_extension(TEXT);
        let (Ok(text), Ok(written)) = (whole_file::read(&path), path.metadata().and_then(|about| about.modified()))
        else {
            let made = lock.metadata().and_then(|about| about.modified());
            if made.is_ok_and(|made| made.elapsed().is_ok_and(|age| age > OLD_LOCK)) {
                remove(&path, lock);
            }
            continue;
        };
        let first = text.lines().next().and_then(|line| line.strip_prefix(PLACE));
        let home = first.and_then(|home| serde_json::from_str::<(PathBuf, u32)>(home).ok());
        let home = home.map(|(path, known)| Home { path, known });
        found.push(Abandoned { path, home, written, lock });
    }
    found.sort_by_key(|abandoned| abandoned.written);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_found_by_another_run_only_when_its_program_has_ended() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = Keeper::new(folder.path().join("unsaved"));
        let home = Home { path: "/scans/the \"hall\".toml".into(), known: 7 };
        keeper.keep(Some(("clouds = [\"a.laz\"]\n", None))).unwrap();
        keeper.keep(Some(("clouds = [\"b.laz\"]\n", Some(&home)))).unwrap();
        assert!(abandoned(&keeper.folder).is_empty(), "its program runs");
        let other = Keeper::new(keeper.folder.clone());
        other.keep(Some(("clouds = []\n", None))).unwrap();
        // A crash drops the lock without removing anything.
        let unsaved = keeper.folder.clone();
        drop(keeper);
        let mut found = abandoned(&unsaved);
        let [one] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!(one.home.as_ref(), Some(&home));
        let (file, _) = scene::SceneFile::read(&one.path).unwrap();
        assert_eq!(file.clouds, ["b.laz"]);
        assert!(abandoned(&unsaved).is_empty(), "another start holds it");
        found.remove(0).delete();
        other.end(false);
        assert_eq!(std::fs::read_dir(&unsaved).unwrap().count(), 0);
    }

    #[test]
    fn work_is_kept_again_once_its_folder_can_be_written_again() {
        let folder = tempfile::tempdir().unwrap();
        let unsaved = folder.path().join("unsaved");
        let keeper = Keeper::new(unsaved.clone());
        keeper.keep(Some(("clouds = [\"a.laz\"]\n", None))).unwrap();
        std::fs::remove_dir_all(&unsaved).unwrap();
        // Something else has its name.
        std::fs::write(&unsaved, "").unwrap();
        assert!(keeper.keep(Some(("clouds = [\"b.laz\"]\n", None))).is_err());
        std::fs::remove_file(&unsaved).unwrap();
        keeper.keep(Some(("clouds = [\"c.laz\"]\n", None))).unwrap();
        drop(keeper);
        let found = abandoned(&unsaved);
        let clouds: Vec<String> =
            found.iter().flat_map(|one| scene::SceneFile::read(&one.path).unwrap().0.clouds).collect();
        assert_eq!(clouds, ["c.laz"]);
    }

    #[test]
    fn nothing_is_written_after_the_end_and_what_stays_is_offered() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = Keeper::new(folder.path().to_owned());
        keeper.keep(Some(("clouds = []\n", None))).unwrap();
        keeper.end(true);
        keeper.keep(Some(("late = 1\n", None))).unwrap();
        let found = abandoned(folder.path());
        assert_eq!(found.len(), 1);
        assert!(!std::fs::read_to_string(&found[0].path).unwrap().contains("late"));
    }

    #[test]
    fn work_that_is_saved_elsewhere_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = Keeper::new(folder.path().to_owned());
        keeper.keep(Some(("clouds = []\n", None))).unwrap();
        keeper.keep(None).unwrap();
        drop(keeper);
        assert!(abandoned(folder.path()).is_empty());
    }
}
