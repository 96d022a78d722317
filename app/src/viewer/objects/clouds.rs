//! The clouds that are open in the window, and the jobs that load them.

use std::collections::{BTreeMap, HashMap};
use std::ops::{Deref, DerefMut};
use std::sync::Arc;
use std::time::Instant;

use cloud::{Bounds, Chunk, PointTest, Progress};
use scene::{CloudSettings, ColorBy, Mirror, MirrorPoints, Ramp};
use stream::{Node, NodeId, Octree};
use world::mirrors::Marked;
use world::{Apart, Assembly, CloudKey, Extent, Input, Mailbox, Part, StreamStats};

use crate::viewer::objects::figures::{Basis, Figures};
use crate::viewer::objects::{ObjectId, Objects};

/// The points that represent a mirror, and what they were made for.
pub struct Sample {
    pub key: CloudKey,
    pub mirror: Mirror,
    /// The area that each point of the clouds represents, in squared world units; `None` if a built-in scene brought
    /// these points.
    pub area_per_point: Option<f64>,
    pub chunks: Vec<(Chunk, Bounds)>,
}

/// The points that represent mirrors with a formula.
#[derive(Default)]
pub struct Samples {
    pub of: HashMap<ObjectId, Sample>,
    /// The mirror whose points are being made now.
    pub under_way: Option<ObjectId>,
    /// The area that each point of the clouds represents, in squared world units, once it is known.
    pub area_per_point: Option<f64>,
}

impl Samples {
    pub fn points(&self) -> u64 {
        self.of.values().flat_map(|sample| &sample.chunks).map(|(chunk, _)| chunk.len() as u64).sum()
    }
}

/// An open cloud, and what the window knows about it.
pub struct CloudEntry {
    assembly: Assembly,
    /// Whether the render thread shows it, and how large it has the points: see `Objects::own_settings`.
    pub is_visible: bool,
    pub size: f32,
    /// Whether a worker thread is moving its points.
    pub is_placing: bool,
    pub figures: Option<Figures>,
    pub figures_basis: Option<Basis>,
    pub figures_under_way: bool,
    pub noise_under_way: bool,
    /// How often normals and radii have come.
    pub surfels: u32,
    /// Which points the radii are for: a test of classes and filters.
    pub radii_test: PointTest,
    /// The test and the progress of the radii that a worker thread is estimating now.
    pub fitting: Option<(PointTest, Arc<Progress>)>,
    /// The attributes whose columns are being read. `None` marks a column that could not be read and is not tried
    /// again.
    pub column_reads: HashMap<usize, Option<Arc<Progress>>>,
    /// Whether a worker thread finds out how sure its surface is.
    pub is_finding_errors: bool,
    /// The marked points that the render thread shows as a mirror.
    pub marked: Vec<MirrorPoints>,
    /// The numbers of these points.
    pub marks: Arc<Vec<Marked>>,
    /// The marked points that a worker thread is looking up now.
    pub marking: Option<(Vec<MirrorPoints>, Arc<Progress>)>,
    /// The attributes that comparisons have added: their names and values.
    pub added: Vec<(String, Arc<codec::Runs>)>,
    /// The state of streaming, if the cloud is streamed.
    pub streamed: Option<Streamed>,
    /// The attributes that are asked for and that its files have, but not yet its index.
    pub awaited: Vec<String>,
}

/// An entry dereferences to its cloud: `entry.points` is the number of points of the assembly.
impl Deref for CloudEntry {
    type Target = Assembly;

    fn deref(&self) -> &Assembly {
        &self.assembly
    }
}

impl DerefMut for CloudEntry {
    fn deref_mut(&mut self) -> &mut Assembly {
        &mut self.assembly
    }
}

/// The chunks of the clouds that are shown, each with what its cloud is coloured by if it has that of its own.
pub fn colored_chunks<'a>(
    clouds: &'a [CloudEntry],
    objects: &'a Objects,
) -> impl Iterator<Item = (&'a Chunk, Option<ColorBy>)> + Clone {
    clouds.iter().filter(|entry| entry.is_visible).flat_map(|entry| {
        let by = objects.settings_of(entry.key).and_then(CloudSettings::color_by);
        entry.cloud.chunks.iter().map(move |chunk| (chunk, by))
    })
}

impl CloudEntry {
    /// Whether work is under way that changes how the cloud looks.
    pub fn is_busy(&self) -> bool {
        let is_searched = self.marking.is_some() || self.fitting.is_some() || self.is_finding_errors;
        is_searched || self.figures_under_way || self.is_placing
    }

    pub fn new(assembly: Assembly) -> Self {
        Self {
            assembly,
            is_visible: true,
            size: 1.0,
            is_placing: false,
            figures: None,
            figures_basis: None,
            figures_under_way: false,
            noise_under_way: false,
            surfels: 0,
            radii_test: PointTest::default(),
            fitting: None,
            column_reads: HashMap::new(),
            is_finding_errors: false,
            marked: Vec::new(),
            marks: Arc::default(),
            marking: None,
            added: Vec::new(),
            streamed: None,
            awaited: Vec::new(),
        }
    }

    /// The number of attributes that all loaded points have, if the cloud is streamed; else 0.
    pub fn paged_columns(&self) -> usize {
        let of_chunk = |chunk: &Chunk| chunk.columns.iter().filter(|column| column.is_some()).count();
        if self.is_indexed() { self.cloud.chunks.iter().map(of_chunk).min().unwrap_or(0) } else { 0 }
    }

    /// Where the shown points lie, as far as it is known.
    pub fn extent(&self) -> Extent<'_> {
        let (bounds, outline) = match &self.figures {
            Some(figures) => (figures.bounds, figures.outline.clone()),
            None if self.bounds.is_empty() => (self.bounds, Vec::new()),
            None => (self.bounds, self.bounds.corners().to_vec()),
        };
        Extent { cloud: &self.assembly, bounds, outline }
    }

    /// True if the program made the cloud, so that there is no file.
    pub fn is_built_in(&self) -> bool {
        self.source.is_none() && self.streamed.is_none()
    }

    /// True if the cloud is streamed and its index exists.
    pub fn is_indexed(&self) -> bool {
        self.octree().is_some()
    }

    /// True if the cloud has points that are not loaded, because it is streamed or cut: figures of its points are of those
    /// that are.
    pub fn is_partly_loaded(&self) -> bool {
        (self.streamed.is_some() || self.is_cut) && self.points < self.total()
    }

    /// True if the tiles of a streamed cloud are opened as they are needed.
    pub fn is_catalogue(&self) -> bool {
        self.octree().is_some_and(|octree| octree.is_of_tiles())
    }

    /// The column that the cloud's colours still lack, and the file to read it from.
    pub fn column_to_read(&self, figures: &Figures) -> Option<(usize, Arc<codec::Source>)> {
        let source = self.source.clone().filter(|_| self.streamed.is_none())?;
        Some((figures.plan.missing_column(&self.cloud)?, source))
    }

    /// The sRGB colour of the level of one of its chunks.
    pub fn level_color(&self, part: Part) -> Option<[u8; 4]> {
        let node = node_of(self.octree()?, part)?;
        Some(self.streamed.as_ref()?.level_color(node.level))
    }

    /// The boxes of the loaded nodes without loaded nodes below them, each with the colour of its level.
    pub fn shown_boxes(&self) -> Vec<(Bounds, [u8; 4])> {
        let (Some(streamed), Some(octree)) = (&self.streamed, self.octree()) else { return Vec::new() };
        let is_there =
            |part: Part| node_of(octree, part).is_some_and(|node| node.points > 0) && self.bounds_of(part).is_some();
        let child = |part: Part, id: NodeId| match part {
            Part::Tile(tile, _) => Part::Tile(tile, id),
            _ => Part::Node(id),
        };
        let there = self.chunk_bounds().filter_map(|(part, bounds)| Some((part, node_of(octree, part)?, bounds)));
        let last =
            there.filter(|(part, node, _)| !node.children.iter().flatten().any(|below| is_there(child(*part, *below))));
        last.map(|(_, node, bounds)| (bounds, streamed.level_color(node.level))).collect()
    }
}

/// The node whose points a chunk holds.
fn node_of(octree: &Octree, part: Part) -> Option<&Node> {
    match part {
        Part::Node(id) => octree.get(id),
        Part::Tile(tile, id) => octree.paged.tiles.get(&tile)?.get(id),
        Part::Preview(_) | Part::Block(_) => None,
    }
}

/// The state of a streamed cloud. Its chunks hold the points that the last view needs.
#[derive(Default)]
pub struct Streamed {
    /// How often a view has been fully loaded, or loaded further.
    pub rests: u32,
    deepest_level: u8,
}

impl Streamed {
    pub fn new(octree: Option<&Octree>, rests: u32) -> Self {
        let trees = octree
            .into_iter()
            .flat_map(|octree| std::iter::once(octree).chain(octree.paged.tiles.values().map(AsRef::as_ref)));
        let levels = trees.flat_map(Octree::ids).map(|(_, node)| node.level).max();
        Self { rests, deepest_level: levels.unwrap_or(0) }
    }

    /// The levels with their colours, starting with the coarsest.
    pub fn levels(&self) -> impl Iterator<Item = (u8, [u8; 4])> {
        (0..=self.deepest_level).map(|level| (level, self.level_color(level)))
    }

    /// The sRGB colour of a level: the ramp runs from the root to the deepest level.
    fn level_color(&self, level: u8) -> [u8; 4] {
        // The ends of the ramp are too dark to tell levels apart.
        let place = 24 + usize::from(level) * 207 / usize::from(self.deepest_level.max(1));
        render::ramp_colors(Ramp::Turbo)[place.min(255)]
    }
}

/// One command to open files, and its state.
pub struct JobEntry {
    pub id: u32,
    pub name: String,
    pub progress: Arc<Progress>,
    pub started: Instant,
    /// The clouds of this job, by the job's own cloud numbers.
    pub clouds: BTreeMap<usize, CloudKey>,
    /// What is loaded of its streamed clouds. The mailbox sends views to the job.
    pub stream: StreamStats,
    /// What was there when that last came to rest: the number of the view, and those of nodes and points.
    pub rested: Option<(u64, usize, u64)>,
    pub mailbox: Arc<Mailbox>,
    /// The number of the last view that was sent, 0 before the first one, and the share of the budgets that it had.
    pub look: u64,
    pub share: f64,
    pub has_streamed: bool,
    /// True when all that the job opens is shown. Streamed clouds count as loaded once the points for the first view
    /// are loaded; their job stays under way.
    pub is_loaded: bool,
}

impl JobEntry {
    pub fn new(id: u32, inputs: &[Input], progress: Arc<Progress>, mailbox: Arc<Mailbox>, started: Instant) -> Self {
        let name = match inputs {
            [one] => short_name(&one.name()).to_string(),
            several => format!("{} inputs", several.len()),
        };
        Self {
            id,
            name,
            progress,
            started,
            clouds: BTreeMap::new(),
            stream: StreamStats::default(),
            rested: None,
            mailbox,
            look: 0,
            share: 1.0,
            has_streamed: false,
            is_loaded: false,
        }
    }

    pub fn owns(&self, key: CloudKey) -> bool {
        self.clouds.values().any(|cloud| *cloud == key)
    }

    /// True while points are being loaded that the last view needs.
    pub fn is_fetching(&self) -> bool {
        self.has_streamed && (self.stream.view_number != self.look || self.stream.nodes_waiting > 0)
    }

    /// True while points for the last view are missing, or an index of the job is not complete.
    pub fn is_streaming(&self) -> bool {
        self.has_streamed && !(self.stream.is_settled && self.stream.view_number == self.look)
    }
}

/// The last part of a path; other names are returned whole.
pub fn short_name(input: &str) -> &str {
    if world::built_in_names().iter().any(|name| name == input) {
        return input;
    }
    std::path::Path::new(input).file_name().and_then(|name| name.to_str()).unwrap_or(input)
}

/// Whether clouds can be seen together.
pub fn apart(clouds: &[&CloudEntry]) -> Apart {
    Apart::of(&clouds.iter().map(|entry| entry.place(entry.extent().bounds)).collect::<Vec<_>>())
}
