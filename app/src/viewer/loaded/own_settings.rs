//! What single clouds have of their own: whether they are shown, their colours, the size of their points. It is part of
//! the objects, so undo and scene files have it; here it reaches the render thread.

use scene::CloudSettings;
use world::{Change, CloudKey, Request};

use crate::viewer::loaded::clouds::CloudEntry;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::OwnSettings;

impl CloudEntry {
    /// The changes that give its points `size` times their radii.
    pub fn in_size(&self, size: f32) -> impl Iterator<Item = Change> {
        let (cloud, chunks, layout, marked) = (self.key, self.chunks(), self.layout(), self.marks.clone());
        let mark = (!marked.is_empty()).then_some(Change::Mark { cloud, chunks, layout, marked });
        std::iter::once(Change::Size { cloud, size }).chain(self.puts()).chain(mark)
    }
}

impl Loaded {
    /// Remembers what a request says of clouds that are still to be opened.
    pub fn await_settings(&mut self, request: &mut Request) {
        self.awaited_markings.append(&mut request.mirror_points);
        let wanted = std::mem::take(&mut request.cloud_settings);
        self.awaited_settings.retain(|known| !wanted.iter().any(|own| own.cloud == known.cloud));
        self.awaited_settings.extend(wanted);
    }

    /// Gives a cloud that was just opened what its scene file says of it. That is no step of undo.
    pub fn place_awaited_settings(&mut self, key: CloudKey, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud(key) else { return };
        let (input, name) = (entry.input.clone(), entry.cloud.name.clone());
        let Some(settings) = self.awaited_settings.iter().find(|own| own.is_of(&input, &name)).cloned() else { return };
        let own = OwnSettings { key, input, settings };
        beside.scene.rewrite_objects(|objects| objects.set_own(own.clone()));
        self.sync_own_settings(beside);
    }

    /// The settings for clouds that are not open.
    pub fn settings_of_absent(&self) -> impl Iterator<Item = &CloudSettings> {
        let is_open = |own: &CloudSettings| self.clouds.iter().any(|entry| own.is_of(&entry.input, &entry.cloud.name));
        self.awaited_settings.iter().filter(move |own| !is_open(own))
    }

    /// Forgets what was said of clouds that are open now: until a job has opened all of a folder's clouds, each of
    /// them may need it.
    pub fn end_awaiting(&mut self) {
        self.awaited_settings = self.settings_of_absent().cloned().collect();
    }

    /// What a cloud has of its own, or settings that leave everything open.
    pub fn own_settings(&self, key: CloudKey, known: Option<&CloudSettings>) -> CloudSettings {
        let name = || {
            let Some(entry) = self.cloud(key) else { return String::new() };
            // The clouds of a folder have their names to tell them apart.
            let is_alone = self.clouds.iter().filter(|other| other.input == entry.input).count() == 1;
            if is_alone { entry.input.clone() } else { entry.cloud.name.clone() }
        };
        known.cloned().unwrap_or_else(|| CloudSettings::of(name()))
    }

    /// Sets what a cloud has of its own. Changes that follow each other, as while a slider is dragged, are one step of
    /// undo.
    pub fn set_own(&mut self, key: CloudKey, settings: CloudSettings, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud(key) else { return };
        let own = OwnSettings { key, input: entry.input.clone(), settings };
        beside.scene.objects.set_own(own);
        beside.scene.navigation.camera_moved(beside.outside.now);
    }

    /// Shows or hides a cloud, in one step of undo.
    pub fn set_visible(&mut self, key: CloudKey, on: bool, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud(key) else { return };
        let settings = CloudSettings { on, ..self.own_settings(key, beside.scene.objects.settings_of(key)) };
        let own = OwnSettings { key, input: entry.input.clone(), settings };
        beside.scene.edit_objects(beside.outside.now, |objects| objects.set_own(own));
        self.sync_own_settings(beside);
    }

    /// Updates the render thread to what clouds have of their own, except colours, which come with their figures.
    pub fn sync_own_settings(&mut self, beside: &mut Beside<'_>) {
        let mut is_changed = false;
        for entry in &mut self.clouds {
            let own = beside.scene.objects.settings_of(entry.key);
            let (is_visible, size) = own.map_or((true, 1.0), |own| (own.on, own.size));
            if entry.is_visible != is_visible {
                entry.is_visible = is_visible;
                beside.outside.change(Change::Show { cloud: entry.key, is_visible });
                is_changed = true;
            }
            if entry.size != size {
                entry.size = size;
                entry.in_size(size).for_each(|change| beside.outside.change(change));
                beside.frames.points_changed();
            }
        }
        if is_changed {
            beside.frames.points_changed();
            self.samples.area_per_point = None;
            self.ask_surroundings(beside);
        }
    }
}
