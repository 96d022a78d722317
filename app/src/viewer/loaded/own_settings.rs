//! What single clouds have of their own: whether they are shown, where they stand, their colours, the size of their
//! points. It is part of the objects, so undo and scene files have it; here it reaches the points, and the render thread.

use cloud::{Chunk, Placement};
use scene::CloudSettings;
use serde_json::json;
use world::{Change, CloudKey, Moved, Request};

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::OwnSettings;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::requests::columns::ColumnsDraft;
use crate::viewer::requests::work::Work;

impl CloudEntry {
    /// The changes that give its points `size` times their radii and show them where `placement` has them.
    pub fn drawn(&self, size: f32, placement: Option<Placement>) -> impl Iterator<Item = Change> {
        let (cloud, marked) = (self.key, self.marks.clone());
        let (chunks, layout) = self.standing(placement);
        let put = |(part, chunk): &_| Change::Put {
            key: cloud.chunk(*part),
            chunk: Chunk::clone(chunk),
            layout: layout.clone(),
        };
        let puts: Vec<Change> = chunks.iter().map(put).collect();
        let mark = (!marked.is_empty()).then_some(Change::Mark { cloud, chunks, layout, marked });
        std::iter::once(Change::Size { cloud, size }).chain(puts).chain(mark)
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

    /// Remembers the names that a person gave to the columns of a table that is opened next, so that scene files keep them.
    pub fn await_columns(&mut self, draft: &ColumnsDraft) {
        let cloud = scene::shown(&draft.path);
        self.awaited_settings.retain(|known| known.cloud != cloud);
        let columns = Some(draft.entered().join(","));
        self.awaited_settings.push(CloudSettings { columns, ..CloudSettings::of(cloud) });
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
        self.sync_placements(beside);
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
                entry.drawn(size, entry.placement()).for_each(|change| beside.outside.change(change));
                beside.frames.points_changed();
            }
        }
        if is_changed {
            beside.frames.points_changed();
            self.samples.area_per_point = None;
            self.ask_surroundings(beside);
        }
    }

    /// Has clouds moved to where their own settings have them. A worker thread moves points that are there; one that
    /// begins while another is under way would only delay it, so it waits.
    fn sync_placements(&mut self, beside: &mut Beside<'_>) {
        for entry in self.clouds.iter_mut().filter(|entry| !entry.is_placing) {
            let settings = beside.scene.objects.settings_of(entry.key);
            let placement = settings.and_then(CloudSettings::placement);
            if entry.placement() == placement {
                continue;
            }
            let (key, own) = (entry.key, entry.own());
            if entry.points == 0 {
                let changes = entry.put_moved(own.placed(placement));
                changes.into_iter().for_each(|change| beside.outside.change(change));
                continue;
            }
            entry.is_placing = true;
            beside.outside.work(Work::Place { key, own, placement });
        }
    }

    /// Takes over the points of a cloud that was moved.
    pub fn on_placed(&mut self, key: CloudKey, moved: Moved, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.is_placing = false;
        let changes = entry.put_moved(moved);
        // Points that reflect are found again where they are now, and so are colours that depend on places.
        entry.marked = Vec::new();
        entry.surfels += 1;
        entry.figures_basis = None;
        let name = entry.cloud.name.clone();
        changes.into_iter().for_each(|change| beside.outside.change(change));
        beside.frames.points_changed();
        beside.outside.log(json!({ "event": "placed", "name": name }));
        self.ask_surroundings(beside);
    }
}
