//! What the loading thread works with.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use cloud::Progress;
use scene::Settings;
use stream::Cache;

use crate::event::Event;
use crate::mailbox::Mailbox;
use crate::stage::{Making, Stage};

/// The state of a loading thread. Where a send fails the job was dropped, and the thread ends.
pub(crate) struct Loader {
    pub(crate) sender: SyncSender<Event>,
    pub(crate) progress: Arc<Progress>,
    pub(crate) mailbox: Arc<Mailbox>,
    pub(crate) settings: Settings,
    pub(crate) has_preview: bool,
    /// Or why there is none.
    pub(crate) cache: Result<Cache, String>,
}

impl Loader {
    /// Announces what will be made for a cloud.
    pub(crate) fn plan(&self, cloud: usize, making: Making, points: u64) -> Option<Arc<Stage>> {
        let stage = self.mailbox.plan(cloud, Stage::new(making, points));
        self.send(Event::Stage { cloud, stage: stage.clone() })?;
        Some(stage)
    }

    pub(crate) fn send(&self, event: Event) -> Option<()> {
        self.sender.send(event).ok()
    }
}
