//! Opens the tiles of a catalogue: their boxes at once, and the tiles themselves some at a time, those that the view needs
//! most before the others.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use cloud::Bounds;
use codec::{CatalogueEntry, is_address};
use scene::{Camera, Paging, shown};
use stream::{Node, Octree};

use crate::budget::half_of;
use crate::event::{Event, IndexState, Opened};
use crate::indexing::StreamedInput;
use crate::loader::Loader;
use crate::source::{open_file, up_of};

/// The number of tiles that are opened at once: more than wait for a server, few enough to leave it to others.
const AT_ONCE: usize = 8;
/// The number of tiles that are tried before all are opened to say what is wrong with each.
const TRIED: usize = 4;
/// The number of distances between neighbouring points across a tile that is not open yet.
const SPACINGS: f64 = 128.0;

/// A tile that is not open yet.
pub(crate) struct Tile {
    cloud: usize,
    path: PathBuf,
    points: u64,
    bounds: Bounds,
    /// The tile itself, if it was opened for what all have in common.
    source: Option<Arc<codec::Source>>,
}

impl Tile {
    fn of(CatalogueEntry { path, points, bounds }: CatalogueEntry, cloud: usize) -> Option<Self> {
        let is_copc = codec::last_part(&path).to_ascii_lowercase().ends_with(".copc.laz");
        let (points, bounds) = (points.filter(|points| *points > 0 && is_copc)?, bounds?);
        Some(Self { cloud, path, points, bounds, source: None })
    }

    /// Whether its points are read from a server.
    pub(crate) fn is_far(&self) -> bool {
        is_address(&self.path)
    }

    /// How late it is needed: whether it lies behind the eye, and how far away.
    fn lateness(&self, camera: &Camera) -> (bool, f64) {
        let ahead = camera.pivot - camera.eye;
        let Bounds { min, max } = self.bounds;
        // The corner that lies furthest ahead.
        let front = glam::DVec3::select(ahead.cmpge(glam::DVec3::ZERO), max, min);
        let nearest = camera.eye.clamp(min, max);
        ((front - camera.eye).dot(ahead) < 0.0, nearest.distance(camera.eye))
    }

    /// All that is known of the cloud before it is open: a box.
    fn octree(&self) -> Octree {
        let width = self.bounds.size().max_element().max(f64::MIN_POSITIVE);
        let root = Node {
            level: 0,
            bounds: self.bounds,
            points: 0,
            is_exact: false,
            total: self.points,
            first_point: 0,
            parent: None,
            children: [None; 8],
        };
        Octree::new(self.bounds.min, width, width / SPACINGS, vec![root])
    }
}

impl Loader {
    /// Announces the tiles of a catalogue whose boxes, numbers of points and names of COPC files it holds. The inner value is
    /// `None` for all other files, which are opened before anything is shown. `first` is the number of the first cloud.
    pub(crate) fn begin_tiles(&self, path: &Path, first: usize) -> Option<Option<Vec<Tile>>> {
        // What is wrong with a catalogue is said where it is opened whole.
        let Ok(Some(entries)) = codec::tiles_of(path) else { return Some(None) };
        if self.settings.stream.pages == Paging::Never || entries.len() < 2 {
            return Some(None);
        }
        let tiles: Option<Vec<Tile>> =
            entries.into_iter().zip(first..).map(|(entry, cloud)| Tile::of(entry, cloud)).collect();
        let Some(mut tiles) = tiles else { return Some(None) };
        // Attributes and units are those of one tile until the others are open.
        let memory = half_of(self.settings.stream.host_bytes);
        let open = |tile: &Tile| open_file(&tile.path, memory).ok()?.into_iter().next();
        let found = tiles.iter().take(TRIED).enumerate().find_map(|(index, tile)| Some((index, open(tile)?)));
        let Some((index, model)) = found.filter(|(_, model)| model.copc().is_some()) else { return Some(None) };
        tiles[index].source = Some(model.clone());
        let info = model.info();
        let attributes = stream::index_attributes(std::slice::from_ref(&model), &self.also());
        for tile in &tiles {
            let own = codec::Info { path: tile.path.clone(), ..info.clone() };
            let opened = Opened {
                name: own.name(),
                input: shown(&tile.path),
                source: None,
                attributes: attributes.clone(),
                offered: info.attributes.clone(),
                grid: None,
                crs: info.crs.clone(),
                units: info.units,
                expected_points: tile.points,
                up: up_of(info, &self.settings),
                provisional_radius: cloud::provisional_radius(tile.bounds, tile.points),
                warnings: Vec::new(),
            };
            self.send(Event::Opened { cloud: tile.cloud, opened })?;
            let pages = IndexState::Indexed {
                octree: Arc::new(tile.octree()),
                attributes: attributes.clone(),
                grid: None,
                was_built: false,
                has_surfels: false,
                entry: None,
            };
            self.send(Event::Pages { cloud: tile.cloud, pages })?;
        }
        Some(Some(tiles))
    }

    /// Opens tiles and has them streamed. Returns those that can be read, in the order of the catalogue.
    pub(crate) fn open_tiles(&self, tiles: Vec<Tile>) -> Option<Vec<StreamedInput>> {
        let threads = AT_ONCE.min(tiles.len());
        let waiting = Mutex::new(tiles);
        let opened = Mutex::new(Vec::new());
        let next = || {
            let camera = self.mailbox.camera();
            let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
            let lateness = |index: &usize| camera.map(|camera| waiting[*index].lateness(&camera));
            let order = |a: &usize, b: &usize| {
                let ((a_behind, a_far), (b_behind, b_far)) = lateness(a).zip(lateness(b)).unwrap_or_default();
                a_behind.cmp(&b_behind).then(a_far.total_cmp(&b_far))
            };
            let first = (0..waiting.len()).min_by(order)?;
            Some(waiting.remove(first))
        };
        let run = || {
            while !self.mailbox.is_over()
                && !self.progress.is_cancelled()
                && let Some(tile) = next()
            {
                let cloud = tile.cloud;
                if self.mailbox.is_closed(cloud) {
                    continue;
                }
                match self.open_tile(tile) {
                    Ok((streamed, pages)) => {
                        if let Some(pages) = pages {
                            self.stream(&streamed, pages, false, HashMap::new());
                        }
                        opened.lock().unwrap_or_else(PoisonError::into_inner).push((cloud, streamed));
                    }
                    Err(error) => {
                        let warnings = vec![format!("a tile is missing: {error}")];
                        let summary = codec::Summary { warnings, ..Default::default() };
                        // A receiver that is gone ends the job, too.
                        if self.send(Event::Read { cloud, summary }).is_none() {
                            return;
                        }
                        self.mailbox.close(cloud);
                    }
                }
            }
        };
        std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(run))));
        // What was not opened when the loading was stopped.
        for tile in waiting.into_inner().unwrap_or_else(PoisonError::into_inner) {
            let summary = codec::Summary { cancelled: true, ..Default::default() };
            self.send(Event::Read { cloud: tile.cloud, summary })?;
            self.mailbox.close(tile.cloud);
        }
        let mut opened = opened.into_inner().unwrap_or_else(PoisonError::into_inner);
        opened.sort_by_key(|(cloud, _)| *cloud);
        (!self.mailbox.is_over()).then(|| opened.into_iter().map(|(_, streamed)| streamed).collect())
    }

    fn open_tile(&self, tile: Tile) -> Result<(StreamedInput, Option<stream::Pages>), String> {
        let source = match tile.source {
            Some(source) => source,
            None => {
                let scans = open_file(&tile.path, half_of(self.settings.stream.host_bytes))?;
                scans.into_iter().next().ok_or("a file without scans")?
            }
        };
        let (told, points) = (tile.points, source.info().points);
        let warning = (told != points).then(|| {
            let name = shown(&tile.path);
            format!("the catalogue says {told} points of {name}, which has {points}")
        });
        let warnings = warning.into_iter().collect();
        Ok(StreamedInput::of_tile(tile.cloud, source, &self.settings, &self.also(), warnings))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn tiles_that_lie_ahead_of_the_eye_and_near_it_are_opened_first() {
        let tile = |x: f64| {
            let bounds = Bounds { min: DVec3::new(x, 0.0, 0.0), max: DVec3::new(x + 1.0, 1.0, 1.0) };
            Tile { cloud: 0, path: PathBuf::new(), points: 1, bounds, source: None }
        };
        let camera = Camera::from_eye(DVec3::splat(0.5), DVec3::new(9.0, 0.5, 0.5), DVec3::Z);
        let lateness = |x: f64| tile(x).lateness(&camera);
        assert!(lateness(0.0) < lateness(4.0) && lateness(4.0) < lateness(9.0) && lateness(9.0) < lateness(-2.0));
    }
}
