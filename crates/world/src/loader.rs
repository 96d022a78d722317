//! The state that the loading thread works with.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

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
}

impl Loader {
    /// Plans a task for a cloud and announces it.
    pub(crate) fn plan(&self, cloud: usize, kind: TaskKind, points: u64) -> Option<Arc<CloudTask>> {
        let task = self.mailbox.plan(cloud, CloudTask::new(kind, points));
        self.send(Event::Task { cloud, task: task.clone() })?;
        Some(task)
    }

    pub(crate) fn send(&self, event: Event) -> Option<()> {
        self.sender.send(event).ok()
    }
}
