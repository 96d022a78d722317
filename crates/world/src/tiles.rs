//! The tiles of a catalogue, or of a folder of COPC files, as one cloud: their boxes are known at once, and views decide
//! which tiles are open.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use cloud::{Attribute, Bounds, Chunk, Cloud, Grid, SurfelOptions, attribute_named};
use codec::{CatalogueEntry, Source};
use glam::DVec3;
use scene::{Paging, Settings, shown};
use stream::{Again, Node, NodeId, Octree, Pages};

use crate::budget::half_of;
use crate::chunk_key::Part;
use crate::error::may_come;
use crate::event::{IndexState, Opened};
use crate::input::Input;
use crate::mailbox::{Arrival, Mailbox};
use crate::source::{file_name, surfel_options, up_of};

/// The number of tiles that are opened at once: more than wait for a server, few enough to leave it to others.
const AT_ONCE: usize = 8;
/// The number of tiles that are tried before all are opened to say what is wrong with each.
const TRIED: usize = 4;
/// The most tiles that are open at a time. Each keeps a file open, of which many systems allow a program a thousand.
const MOST_OPEN: usize = 512;
/// The number of tiles that are opened before the first view, from all over the catalogue.
const FIRST_LOOK: usize = 64;
/// The share of the memory for decoders (one in this number) that the list of nodes of a tile is measured by: longer lists
/// are read page by page, so that many tiles have room.
const LIST_SHARE: u64 = 16;
/// The memory of a node in bytes while its tile is open, in all tables.
const NODE_BYTES: u64 = 512;
/// The number of distances between neighbouring points across a tile that is not open.
pub(crate) const SPACINGS: f64 = 128.0;
/// The number of problems with tiles that are said one by one once the cloud is there.
const MOST_TOLD: usize = 10;
/// Places farther away are none.
const FARTHEST: f64 = 1e12;

/// Tiles have numbers of their own among the clouds of a job: that of the catalogue, plus one, in the upper half.
pub(crate) fn number_of(catalogue: usize, tile: usize) -> usize {
    (catalogue + 1) << TILE_BITS | tile
}

/// The cloud that others know, and the tile of it.
pub(crate) fn owner_of(number: usize) -> (usize, Option<usize>) {
    match number >> TILE_BITS {
        0 => (number, None),
        catalogue => (catalogue - 1, Some(number & ((1 << TILE_BITS) - 1))),
    }
}

/// More than a catalogue has tiles, or a job clouds.
const TILE_BITS: u32 = usize::BITS / 2;

/// The part of the cloud that others know which the chunk of a node is, and the cloud.
pub(crate) fn part_of(number: usize, node: NodeId) -> (usize, Part) {
    match owner_of(number) {
        (cloud, None) => (cloud, Part::Node(node)),
        (cloud, Some(tile)) => (cloud, Part::Tile(tile as u32, node)),
    }
}

/// The number of the first point of the chunk of a node in the cloud that others know: those of a tile follow those of the
/// tiles before it. Nodes that leave room for their points (`stream`) have less of it then.
pub(crate) fn first_point_of(number: usize, first_point: u64) -> u64 {
    match owner_of(number) {
        (_, None) => first_point,
        (_, Some(tile)) => (tile as u64) << 47 | first_point >> 16,
    }
}

/// How the chunks of a tile become those of its catalogue.
pub(crate) struct Fit {
    /// For each attribute of the catalogue its column in the tile.
    columns: Vec<Option<usize>>,
    /// The grid of the tile, if it is another one than that of the catalogue.
    pub(crate) grid: Option<Grid>,
}

impl Fit {
    pub(crate) fn apply(&self, mut chunk: Chunk) -> Chunk {
        let mut own = std::mem::take(&mut chunk.columns);
        chunk.columns = self.columns.iter().map(|column| own.get_mut((*column)?)?.take()).collect();
        if self.grid.is_some() && chunk.exact_positions.is_none() {
            let file = Cloud { grid: self.grid, ..Cloud::default() };
            let places = (0..chunk.len()).map(|index| file.world_position(&chunk, index).to_array());
            chunk.exact_positions = Some(Arc::new(places.collect()));
        }
        chunk
    }
}

struct Tile {
    path: PathBuf,
    points: u64,
    bounds: Bounds,
    state: State,
    /// What is wrong with it, if it could not be read, and when it is tried again.
    failed: Option<(String, Again)>,
    /// If it cannot be read: whether it may come later.
    may_come: bool,
}

enum State {
    Closed,
    Opening,
    Open(OpenTile),
    /// Not readable.
    Missing,
    /// There was no room for it beside what the view needs.
    Refused,
}

struct OpenTile {
    source: Arc<Source>,
    estimate: Option<SurfelOptions>,
    /// The number of the last view that needed it.
    used: u64,
}

/// A tile that was opened on a thread of its own.
pub(crate) struct FoundTile {
    source: Arc<Source>,
    estimate: Option<SurfelOptions>,
}

/// What is to be done once a tile was opened.
#[derive(Default)]
pub(crate) struct Put {
    /// The tiles that have gone to make room.
    pub(crate) closed: Vec<usize>,
    pub(crate) arrival: Option<Arrival>,
}

/// The tiles of one cloud.
pub(crate) struct Tiles {
    pub(crate) cloud: usize,
    input: String,
    name: String,
    tiles: Vec<Tile>,
    settings: Settings,
    /// The tile whose attributes and grid stand for those of all.
    model: Arc<Source>,
    /// The names of attributes that are kept besides the usual ones.
    also: BTreeSet<String>,
    attributes: Vec<Attribute>,
    /// The most tiles that are open at a time.
    most_open: usize,
    /// The tiles that the latest view needs, the most needed first, as many as may be open at once.
    needed: Vec<usize>,
    /// The tiles that it needs and that cannot be read.
    missing: Vec<usize>,
    /// The number of tiles that it would need without that limit.
    wished: usize,
    /// Whether that limit was told.
    is_limit_told: bool,
    /// The number of the latest choice of tiles.
    turn: u64,
    /// Whether no more tiles are opened until the view changes.
    is_stopped: bool,
    /// Whether something has changed that others should know.
    is_changed: bool,
    /// What is to be said of tiles, and how much has been said.
    problems: Vec<String>,
    told: usize,
    is_read: bool,
    /// The problems that others know of missing tiles, and those of tiles that have come since.
    told_missing: BTreeSet<String>,
    mended: Vec<String>,
}

impl Tile {
    fn of(CatalogueEntry { path, points, bounds, .. }: CatalogueEntry) -> Option<Self> {
        let is_copc = codec::last_part(&path).to_ascii_lowercase().ends_with(".copc.laz");
        let points = points.filter(|points| *points > 0 && is_copc)?;
        let is_near = |place: DVec3| place.abs().max_element() < FARTHEST;
        let bounds = bounds.filter(|bounds| is_near(bounds.min) && is_near(bounds.max))?;
        Some(Self { path, points, bounds, state: State::Closed, failed: None, may_come: false })
    }

    /// The number of nodes that are in memory at most while it is open.
    fn nodes(&self) -> usize {
        let State::Open(OpenTile { source, .. }) = &self.state else { return 0 };
        let of = |copc: &codec::Copc| if copc.further.is_empty() { copc.nodes.len() } else { copc.most_nodes };
        source.copc().map_or(0, of)
    }
}

/// Why a tile cannot be read, and whether it may come later.
pub(crate) type TileProblem = (String, bool);

/// Opens a tile, which must be a COPC file.
fn open_tile(path: &Path, settings: &Settings) -> Result<Arc<Source>, TileProblem> {
    let told = |error: codec::Error| (error.to_string(), may_come(&error.into()));
    let scans = codec::open_scans(path, half_of(settings.stream.host_bytes) / LIST_SHARE).map_err(told)?;
    let source = scans.into_iter().next().ok_or_else(|| ("a file without scans".to_owned(), false))?;
    if source.copc().is_none() {
        let problem = "no COPC file with an octree that can be used; it can be opened alone";
        return Err((format!("{}: {problem}", shown(path)), false));
    }
    Ok(Arc::new(source))
}

/// Opens a tile, and finds how its normals and radii are estimated.
fn find_tile(path: &Path, settings: &Settings) -> Result<FoundTile, TileProblem> {
    let source = open_tile(path, settings)?;
    let pages = Pages::copc(&source, &BTreeSet::new()).ok_or_else(|| ("a file without a grid".to_owned(), false))?;
    let estimate = match surfel_options(&pages, up_of(source.info(), settings), source.info().scanner(), settings) {
        Ok(estimate) => Some(estimate),
        // The tile is tried again as a whole, so that its radii are those of the file.
        Err(error @ stream::Error::Input(codec::Error::Io { .. })) => {
            return Err((error.to_string(), may_come(&error)));
        }
        Err(error) => {
            tracing::warn!(path = %path.display(), %error, "pages cannot be read");
            None
        }
    };
    Ok(FoundTile { estimate, source })
}

impl Tiles {
    /// The tiles of a catalogue or a folder whose boxes, numbers of points and names of COPC files are known; `None` for all
    /// other inputs, which are opened before anything is shown.
    pub(crate) fn of(input: &Input, cloud: usize, settings: &Settings, also: BTreeSet<String>) -> Option<Self> {
        let (path, tiles, repeated) = Self::listed(input, settings)?;
        // Attributes and units are those of one tile until the others are open.
        let model = tiles.iter().take(TRIED).find_map(|tile| open_tile(&tile.path, settings).ok())?;
        let mut own = Self::new(cloud, path, tiles, model, settings, also);
        own.problems.extend(repeated.map(|repeated| format!("{}: {repeated}", own.input)));
        Some(own)
    }

    /// Whether the files of an input are such tiles.
    pub(crate) fn are_of(input: &Input, settings: &Settings) -> bool {
        Self::listed(input, settings).is_some()
    }

    /// The path of an input, its tiles, and what is to be said of them.
    fn listed<'a>(input: &'a Input, settings: &Settings) -> Option<(&'a Path, Vec<Tile>, Option<String>)> {
        if settings.stream.pages == Paging::Never {
            return None;
        }
        let (path, entries): (&Path, _) = match input {
            // What is wrong with a catalogue is said where it is opened whole.
            Input::File(path) => (path, codec::tiles_of(path).ok()??),
            Input::Tiles { folder, files } => {
                (folder, files.iter().map(|file| codec::entry_of(file)).collect::<Option<Vec<_>>>()?)
            }
            _ => return None,
        };
        let repeated = codec::repeated_tiles(&entries);
        let tiles: Vec<Tile> = entries.into_iter().map(Tile::of).collect::<Option<_>>()?;
        (tiles.len() > 1).then_some((path, tiles, repeated))
    }

    fn new(
        cloud: usize,
        path: &Path,
        tiles: Vec<Tile>,
        model: Arc<Source>,
        settings: &Settings,
        also: BTreeSet<String>,
    ) -> Self {
        let attributes = stream::index_attributes(std::slice::from_ref(&model), &also);
        Self {
            cloud,
            input: shown(path),
            name: file_name(path),
            tiles,
            settings: settings.clone(),
            model,
            also,
            attributes,
            most_open: MOST_OPEN,
            needed: Vec::new(),
            missing: Vec::new(),
            wished: 0,
            is_limit_told: false,
            turn: 0,
            is_stopped: false,
            is_changed: true,
            problems: Vec::new(),
            told: 0,
            is_read: false,
            told_missing: BTreeSet::new(),
            mended: Vec::new(),
        }
    }

    pub(crate) fn opened(&self) -> Opened {
        let info = self.model.info();
        Opened {
            name: self.name.clone(),
            input: self.input.clone(),
            source: None,
            files: Arc::default(),
            attributes: self.attributes.clone(),
            offered: info.attributes.clone(),
            grid: info.grid,
            crs: info.crs.clone(),
            units: info.units,
            expected_points: self.points(),
            up: up_of(info, &self.settings),
            scanner: None,
            provisional_radius: cloud::provisional_radius(self.bounds(), self.points()),
            warnings: Vec::new(),
        }
    }

    /// Whether its points are read from a server.
    pub(crate) fn is_far(&self) -> bool {
        self.tiles.iter().any(|tile| codec::is_address(&tile.path))
    }

    /// For each tile that could not be read, whether it may come later.
    pub(crate) fn missing(&self) -> impl Iterator<Item = bool> {
        self.tiles.iter().filter(|tile| tile.failed.is_some()).map(|tile| tile.may_come)
    }

    pub(crate) fn points(&self) -> u64 {
        self.tiles.iter().map(|tile| tile.points).fold(0, u64::saturating_add)
    }

    fn bounds(&self) -> Bounds {
        self.tiles.iter().fold(Bounds::EMPTY, |all, tile| all.union(tile.bounds))
    }

    /// The input and the name of the cloud.
    pub(crate) fn names(&self) -> (&str, &str) {
        (&self.input, &self.name)
    }

    /// What others know of the cloud; `open` are the octrees of the open tiles.
    pub(crate) fn state(&self, open: BTreeMap<u32, Arc<Octree>>) -> IndexState {
        let bounds = self.bounds();
        let width = bounds.size().max_element().max(f64::MIN_POSITIVE);
        let node = |bounds: Bounds, total: u64| Node {
            level: 0,
            bounds,
            points: 0,
            is_exact: false,
            total,
            first_point: 0,
            parent: None,
            children: [None; 8],
        };
        let with = |nodes: Vec<Node>| Octree::new(bounds.min, width, width / SPACINGS, nodes);
        let mut octree = with(vec![node(bounds, self.points())]);
        let scene = with(self.tiles.iter().map(|tile| node(tile.bounds, tile.points)).collect()).scene_bounds();
        octree.paged.scene = Some(scene);
        let closed = (0_u32..).zip(&self.tiles).filter(|(index, _)| !open.contains_key(index));
        octree.paged.unread = closed.map(|(index, tile)| ((NodeId(index), 0), tile.bounds)).collect();
        octree.paged.tiles = open;
        IndexState::Indexed {
            octree: Arc::new(octree),
            attributes: self.attributes.clone(),
            grid: self.model.info().grid,
            was_built: false,
            has_surfels: false,
            entry: None,
        }
    }

    /// Whether no view has been asked for tiles yet.
    pub(crate) fn is_new(&self) -> bool {
        self.turn == 0
    }

    /// Notes that others should know of a change.
    pub(crate) fn change(&mut self) {
        self.is_changed = true;
    }

    /// Whether something has changed since the last call.
    pub(crate) fn has_changed(&mut self) -> bool {
        std::mem::take(&mut self.is_changed)
    }

    /// Says what a view needs. `rank` gives the urgency of a box, smallest first, or `None` for one that is not needed. Of
    /// those the first look, before any view, needs some from all over the catalogue.
    pub(crate) fn need(&mut self, is_first_look: bool, rank: impl Fn(Bounds) -> Option<(bool, f64)>) {
        let tiles = self.tiles.iter().enumerate();
        let mut ranked: Vec<_> = tiles.filter_map(|(index, tile)| Some((rank(tile.bounds)?, index))).collect();
        if is_first_look {
            let look = self.first_look();
            ranked.retain(|(_, index)| look.contains(index));
        }
        let missing = ranked.extract_if(.., |(_, index)| matches!(self.tiles[*index].state, State::Missing));
        self.missing = missing.map(|(_, index)| index).collect();
        ranked.sort_by(|((behind, far), index), ((other_behind, other_far), other)| {
            behind.cmp(other_behind).then(far.total_cmp(other_far)).then(index.cmp(other))
        });
        let mut wished: Vec<usize> = ranked.into_iter().map(|(_, index)| index).collect();
        self.wished = wished.len();
        if self.wished > self.most_open {
            // Of a survey that is seen from afar one corner alone would be seen. The others are always the same ones.
            let mut rest = wished.split_off(self.most_open / 2);
            rest.sort_by_key(|index| cloud::hash(*index as u64));
            wished.extend(rest.into_iter().take(self.most_open - self.most_open / 2));
            if !std::mem::replace(&mut self.is_limit_told, true) {
                let (wish, most) = (self.wished, self.most_open);
                let limit = format!(
                    "the view shows {wish} tiles; {most} are open, the nearest and some of all others, which is the most at a time"
                );
                self.problems.push(format!("{}: {limit}", self.input));
            }
        }
        self.turn += 1;
        for index in &wished {
            if let State::Open(open) = &mut self.tiles[*index].state {
                open.used = self.turn;
            }
        }
        self.needed = wished;
    }

    /// Some tiles from all over the catalogue, with those at its sides, so that they frame it.
    fn first_look(&self) -> BTreeSet<usize> {
        let count = self.tiles.len();
        let most = FIRST_LOOK.min(count);
        let bounds = self.bounds();
        let at_side = |side: fn(&Bounds) -> DVec3, axis: usize| {
            self.tiles.iter().position(|tile| side(&tile.bounds)[axis] == side(&bounds)[axis])
        };
        let sides = (0..3).flat_map(|axis| [at_side(|own| own.min, axis), at_side(|own| own.max, axis)]);
        (0..most).map(|index| index * count / most).chain(sides.flatten()).collect()
    }

    /// Forgets that there was no room, and that opening was stopped.
    pub(crate) fn try_again(&mut self) {
        self.is_stopped = false;
        for tile in self.tiles.iter_mut().filter(|tile| matches!(tile.state, State::Refused)) {
            tile.state = State::Closed;
        }
    }

    /// Whether tiles that the view needs and that could not be read are to be opened again now.
    pub(crate) fn ask_again(&mut self, now: Instant, is_other_view: bool) -> bool {
        let mut is_any = false;
        for index in self.missing.iter().filter(|_| !self.is_stopped) {
            let tile = &mut self.tiles[*index];
            if tile.failed.as_mut().is_some_and(|(_, again)| again.ask(now, is_other_view)) {
                tile.state = State::Closed;
                is_any = true;
            }
        }
        is_any
    }

    /// Stops opening tiles until the view changes.
    pub(crate) fn stop(&mut self) {
        self.is_stopped = self.waiting() > 0;
    }

    pub(crate) fn is_needed(&self, tile: usize) -> bool {
        self.needed.contains(&tile)
    }

    /// The numbers of tiles that the view needs and that are open, that it needs, and of all.
    pub(crate) fn counts(&self) -> [usize; 3] {
        let open = self.needed.iter().filter(|index| matches!(self.tiles[**index].state, State::Open(_)));
        [open.count(), self.wished, self.tiles.len()]
    }

    /// The number of tiles that are still to be opened for the view.
    pub(crate) fn waiting(&self) -> usize {
        let waits = |index: &&usize| match self.tiles[**index].state {
            State::Closed => !self.is_stopped,
            State::Opening => true,
            _ => false,
        };
        self.needed.iter().filter(waits).count()
    }

    /// Opens tiles that the view needs on threads of their own. Returns those that have gone to make room.
    pub(crate) fn open_needed(&mut self, mailbox: &Arc<Mailbox>) -> Vec<usize> {
        let mut closed = Vec::new();
        let count = |tiles: &Self, is: fn(&State) -> bool| tiles.tiles.iter().filter(|tile| is(&tile.state)).count();
        let is_under_way = |state: &State| matches!(state, State::Opening);
        let next = self.needed.iter().copied().filter(|index| matches!(self.tiles[*index].state, State::Closed));
        for index in next.collect::<Vec<_>>() {
            let under_way = count(self, is_under_way);
            if under_way >= AT_ONCE || self.is_stopped {
                break;
            }
            if count(self, |state| matches!(state, State::Open(_))) + under_way >= self.most_open {
                match self.close_oldest() {
                    Some(oldest) => closed.push(oldest),
                    None => break,
                }
            }
            self.tiles[index].state = State::Opening;
            let (path, settings, cloud) = (self.tiles[index].path.clone(), self.settings.clone(), self.cloud);
            let answer = mailbox.clone();
            let find = move || {
                let found = std::panic::catch_unwind(AssertUnwindSafe(|| find_tile(&path, &settings)));
                let panicked = |_| Err((format!("{}: the reader failed", shown(&path)), false));
                answer.pass_tile(cloud, index, found.unwrap_or_else(panicked));
            };
            if let Err(error) = std::thread::Builder::new().name("tile".into()).spawn(find) {
                mailbox.pass_tile(cloud, index, Err((error.to_string(), true)));
            }
        }
        closed
    }

    /// Closes the tile that was needed the longest time ago, of those that the view does not need.
    fn close_oldest(&mut self) -> Option<usize> {
        let open = self.tiles.iter().enumerate().filter_map(|(index, tile)| match &tile.state {
            State::Open(open) if open.used < self.turn => Some((open.used, index)),
            _ => None,
        });
        let (_, oldest) = open.min()?;
        self.tiles[oldest].state = State::Closed;
        self.is_changed = true;
        Some(oldest)
    }

    /// Takes over a tile that was opened, or says why it cannot be.
    pub(crate) fn put(&mut self, index: usize, found: Result<FoundTile, TileProblem>) -> Put {
        let mut put = Put::default();
        let path = shown(&self.tiles[index].path);
        let FoundTile { source, estimate } = match found {
            Ok(found) => found,
            Err(_) if self.is_stopped => {
                self.tiles[index].state = State::Closed;
                return put;
            }
            Err((error, may_come)) => {
                let tile = &mut self.tiles[index];
                (tile.state, tile.may_come) = (State::Missing, may_come);
                let problem = format!("{}: a tile is missing: {error}", self.input);
                let (problem, before) = match tile.failed.take() {
                    Some((problem, again)) => (problem, Some(again)),
                    None => {
                        self.problems.push(problem.clone());
                        (problem, None)
                    }
                };
                tile.failed = Some((problem, Again::after(before, true, Instant::now())));
                return put;
            }
        };
        if let Some((problem, _)) = self.tiles[index].failed.take() {
            self.problems.retain(|other| *other != problem);
            if self.told_missing.remove(&problem) {
                self.told = self.told.saturating_sub(1);
                self.mended.push(problem);
            }
        }
        self.check(index, &source);
        let used = if self.needed.contains(&index) { self.turn } else { self.turn.saturating_sub(1) };
        self.tiles[index].state = State::Open(OpenTile { source, estimate, used });
        let most = half_of(self.settings.stream.host_bytes) / 8 / NODE_BYTES;
        let nodes = |tiles: &Self| tiles.tiles.iter().map(Tile::nodes).sum::<usize>();
        while nodes(self) as u64 > most {
            match self.close_oldest() {
                Some(oldest) => put.closed.push(oldest),
                None => {
                    self.tiles[index].state = State::Refused;
                    self.problems.push(format!(
                        "{path}: the lists of nodes of the tiles that the view needs are larger than the memory for them: \
                         the tile is left out (stream.host_bytes decides)"
                    ));
                    return put;
                }
            }
        }
        self.is_changed = true;
        put.arrival = self.arrival(index);
        put
    }

    /// Compares a tile with what the catalogue says of it.
    fn check(&mut self, index: usize, source: &Source) {
        let (info, name) = (source.info(), shown(&self.tiles[index].path));
        let tile = &mut self.tiles[index];
        if tile.points != info.points {
            let (told, points) = (tile.points, info.points);
            self.problems.push(format!("the catalogue says {told} points of {name}, which has {points}"));
            tile.points = points;
        }
        if let Some(own) = info.bounds {
            // Catalogues round.
            let margin = own.size().max(tile.bounds.size()).max_element() * 0.01;
            let off = (own.min - tile.bounds.min).abs().max((own.max - tile.bounds.max).abs()).max_element();
            if off > margin {
                self.problems.push(format!("the catalogue gives {name} another place than it has"));
            }
            tile.bounds = own;
        }
        let model = self.model.info();
        if let Some(difference) = info.system_difference(model) {
            let first = shown(&model.path);
            self.problems.push(format!("{name} has {difference} than {first}"));
        }
    }

    /// A tile that is open, as it is streamed.
    fn arrival(&self, index: usize) -> Option<Arrival> {
        let State::Open(OpenTile { source, estimate, .. }) = &self.tiles[index].state else { return None };
        let pages = Pages::copc(source, &self.also)?;
        let columns = self.attributes.iter().map(|attribute| attribute_named(pages.attributes(), &attribute.name));
        let grid = source.info().grid.filter(|grid| {
            let model = self.model.info().grid;
            !model.is_some_and(|model| stream::is_one_grid(grid, &model))
        });
        Some(Arrival {
            cloud: number_of(self.cloud, index),
            input: self.input.clone(),
            name: self.name.clone(),
            fit: Some(Fit { columns: columns.collect(), grid }),
            pages: Arc::new(pages),
            is_own: false,
            missing: 0,
            was_built: false,
            estimate: *estimate,
            previews: HashMap::new(),
        })
    }

    /// Keeps further attributes. Returns the open tiles, which are to be read again, if that changes anything.
    pub(crate) fn keep(&mut self, names: &BTreeSet<String>) -> Vec<Arrival> {
        if names.is_subset(&self.also) {
            return Vec::new();
        }
        self.also.extend(names.iter().cloned());
        let attributes = stream::index_attributes(std::slice::from_ref(&self.model), &self.also);
        if std::mem::replace(&mut self.attributes, attributes) == self.attributes {
            return Vec::new();
        }
        self.is_changed = true;
        (0..self.tiles.len()).filter_map(|index| self.arrival(index)).collect()
    }

    /// Notes warnings about the tile with this number.
    pub(crate) fn warn(&mut self, index: usize, warnings: Vec<String>) {
        let name = shown(&self.tiles[index].path);
        self.problems.extend(warnings.into_iter().map(|warning| format!("{name}: {warning}")));
    }

    /// What is to be said once all that the first view needs is there, and which tiles of those are missing; `None` after that.
    pub(crate) fn summary(&mut self) -> Option<(codec::Summary, Vec<String>)> {
        if std::mem::replace(&mut self.is_read, true) {
            return None;
        }
        let problems = std::mem::take(&mut self.problems);
        self.note_told(&problems);
        let (missing, warnings) = problems.into_iter().partition(|problem| self.told_missing.contains(problem));
        let open = self.tiles.iter().filter_map(|tile| match &tile.state {
            State::Open(OpenTile { source, .. }) => Some(source),
            _ => None,
        });
        let summary = codec::Summary {
            points: self.points(),
            missing: codec::missing_points(open),
            bounds: Some(self.bounds()),
            warnings,
            cancelled: self.is_stopped,
        };
        Some((summary, param::few(missing, "tiles that are missing")))
    }

    /// What is to be said of tiles that were opened later.
    pub(crate) fn news(&mut self) -> Vec<String> {
        if !self.is_read {
            return Vec::new();
        }
        let mut news = std::mem::take(&mut self.problems);
        news.truncate(MOST_TOLD.saturating_sub(self.told));
        self.told += news.len();
        self.note_told(&news);
        news
    }

    /// Notes which of these problems are those of missing tiles.
    fn note_told(&mut self, told: &[String]) {
        if !told.is_empty() {
            let told: BTreeSet<&String> = told.iter().collect();
            let missing = self.tiles.iter().filter_map(|tile| tile.failed.as_ref().map(|(problem, _)| problem));
            self.told_missing.extend(missing.filter(|problem| told.contains(problem)).cloned());
        }
    }

    /// What was told of tiles that have come since.
    pub(crate) fn mended(&mut self) -> Vec<String> {
        std::mem::take(&mut self.mended)
    }
}

#[cfg(test)]
#[path = "tiles_tests.rs"]
mod tests;
