//! The state that the loading thread works with.

use std::collections::BTreeSet;
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::Progress;
use scene::Settings;
use stream::Cache;

use crate::event::Event;
use crate::mailbox::Mailbox;
use crate::task::{CloudTask, TaskKind};

/// The state of a loading thread. If a send fails, the job was dropped and the thread ends.
pub(crate) struct Loader {
    pub(crate) sender: SyncSender<Event>,
    pub(crate) progress: Arc<Progress>,
    pub(crate) mailbox: Arc<Mailbox>,
    pub(crate) settings: Settings,
    pub(crate) has_preview: bool,
    /// The cache of indexes, or why there is none.
    pub(crate) cache: Result<Cache, String>,
    /// The names of attributes that streamed clouds keep besides the usual ones.
    pub(crate) also: Mutex<BTreeSet<String>>,
}

impl Loader {
    /// Plans a task for a cloud and announces it.
    pub(crate) fn plan(&self, cloud: usize, kind: TaskKind, points: u64) -> Option<Arc<CloudTask>> {
        let task = self.mailbox.plan(cloud, CloudTask::new(kind, points));
        self.send(Event::Task { cloud, task: task.clone() })?;
        Some(task)
    }

    /// The names of attributes that streamed clouds keep besides the usual ones.
    pub(crate) fn also(&self) -> BTreeSet<String> {
        self.also.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The cache of the indexes that have these attributes, or why there is none.
    pub(crate) fn index_cache(&self) -> Result<Cache, &str> {
        self.cache.as_ref().map(|cache| cache.keeping(self.also())).map_err(String::as_str)
    }

    pub(crate) fn send(&self, event: Event) -> Option<()> {
        self.sender.send(event).ok()
    }
}
