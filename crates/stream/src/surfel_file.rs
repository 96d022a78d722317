//! The file `surfels` of an index holds six bytes a point, node after node: packed normals, then packed radii, in the
//! page's order. Its head has the checksums, and is written last (`surfels`).

use std::path::Path;

use cloud::{Orientation, RadiusRule, SurfelOptions, Surfels};
use glam::DVec3;

use crate::storage::Storage;
use crate::{Error, NodeId, Octree, Result};

pub(crate) const SURFELS: &str = "surfels";
pub(crate) const UNFINISHED: &str = "surfels.unfinished";
pub(crate) const DONE: &str = "surfels.done";
pub(crate) const LOCK: &str = "surfels.lock";
/// The names of all files that are made here.
pub(crate) const NAMES: [&str; 4] = [SURFELS, UNFINISHED, DONE, LOCK];
pub(crate) const MAGIC: [u8; 8] = *b"glintsrf";
/// The number grows with each change of the form of the file, and of how points are put into groups.
pub(crate) const VERSION: u32 = 4;
/// The size in bytes of the head before the checksums: magic, version, checksum of the remainder, identity.
pub(crate) const HEAD_BYTES: usize = 16 + IDENTITY_BYTES;
/// Key of the index, nodes, points, neighbours, orientation, estimator.
const IDENTITY_BYTES: usize = 16 + 4 + 8 + 4 + 1 + 24 + 4;
/// The size in bytes of a packed normal and a packed radius.
pub(crate) const POINT_BYTES: u64 = 6;

/// The complete file of an index.
pub(crate) struct SurfelFile {
    storage: Storage,
    options: SurfelOptions,
    checksums: Vec<u32>,
}

impl SurfelFile {
    /// Opens the file of an index; `Damaged` if it belongs to another one.
    pub fn open(folder: &Path, key: u128, octree: &Octree) -> Result<Self> {
        let storage = Storage::open(&folder.join(SURFELS))?;
        let damaged = |problem: &str| Error::damaged(storage.path(), problem);
        let nodes = octree.nodes.len();
        // The expected size is checked against the file before anything is allocated.
        if storage.length() != data_start(nodes) + POINT_BYTES * octree.points() {
            return Err(damaged("not as large as the index says"));
        }
        let mut head = vec![0; data_start(nodes) as usize];
        storage.read(0, &mut head)?;
        let body = &head[16..];
        if head[..8] != MAGIC
            || head[8..12] != VERSION.to_le_bytes()
            || head[12..16] != crc32fast::hash(body).to_le_bytes()
        {
            return Err(damaged("not complete, or has changed"));
        }
        let options =
            read_options(&body[28..IDENTITY_BYTES]).filter(|options| body.starts_with(&identity(key, octree, options)));
        let options = options.ok_or_else(|| damaged("of another index"))?;
        let checksums =
            body[IDENTITY_BYTES..].as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        Ok(Self { storage, options, checksums })
    }

    /// The options of the estimate.
    pub fn options(&self) -> &SurfelOptions {
        &self.options
    }

    /// The packed normals and radii of a node, in the order of its page.
    pub fn read(&self, octree: &Octree, node: NodeId) -> Result<Surfels> {
        let bytes = read_block(&self.storage, octree, node)?;
        if crc32fast::hash(&bytes) != self.checksums[node.0 as usize] {
            return Err(Error::damaged(self.storage.path(), format!("the surfels of node {} have changed", node.0)));
        }
        Ok(unpack(&bytes))
    }
}

/// The offset in bytes of the first node's normals and radii.
pub(crate) fn data_start(nodes: usize) -> u64 {
    HEAD_BYTES as u64 + 4 * nodes as u64
}

pub(crate) fn block_start(octree: &Octree, node: NodeId) -> u64 {
    data_start(octree.nodes.len()) + POINT_BYTES * octree.node(node).first_point
}

pub(crate) fn read_block(storage: &Storage, octree: &Octree, node: NodeId) -> Result<Vec<u8>> {
    let mut bytes = vec![0; POINT_BYTES as usize * octree.node(node).points as usize];
    storage.read(block_start(octree, node), &mut bytes)?;
    Ok(bytes)
}

pub(crate) fn unpack(bytes: &[u8]) -> Surfels {
    let (normals, radii) = bytes.split_at(bytes.len() / POINT_BYTES as usize * 4);
    Surfels {
        normals: normals.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect(),
        radii: radii.as_chunks::<2>().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect(),
    }
}

pub(crate) fn pack(surfels: &Surfels) -> Vec<u8> {
    let normals = surfels.normals.iter().flat_map(|normal| normal.to_le_bytes());
    normals.chain(surfels.radii.iter().flat_map(|radius| radius.to_le_bytes())).collect()
}

/// The bits of the orientation's kind that say which rule the radii follow.
const NARROW: u8 = 0x80;
const SPREAD: u8 = 0x40;

/// The bytes that identify the estimate and its input.
pub(crate) fn identity(key: u128, octree: &Octree, options: &SurfelOptions) -> Vec<u8> {
    let (kind, direction) = match options.orientation {
        Orientation::Up(up) => (0, up.as_dvec3()),
        Orientation::Toward(viewer) => (1, viewer),
        Orientation::AwayFrom(centre) => (2, centre),
    };
    let mut bytes = key.to_le_bytes().to_vec();
    bytes.extend((octree.nodes.len() as u32).to_le_bytes());
    bytes.extend(octree.points().to_le_bytes());
    bytes.extend((options.neighbours as u32).to_le_bytes());
    bytes.push(
        kind | match options.radii {
            RadiusRule::Full => 0,
            RadiusRule::Narrow => NARROW,
            RadiusRule::Spread => SPREAD,
        },
    );
    direction.to_array().into_iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes.extend(cloud::ESTIMATOR.to_le_bytes());
    bytes
}

/// Reads neighbours, orientation and the rule of the radii as `identity` writes them.
fn read_options(bytes: &[u8]) -> Option<SurfelOptions> {
    let (neighbours, rest) = bytes.split_first_chunk::<4>()?;
    let (kind, rest) = rest.split_first()?;
    let numbers: Vec<f64> = rest.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let direction = DVec3::from_slice(numbers.get(..3)?);
    let orientation = match kind & !(NARROW | SPREAD) {
        0 => Orientation::Up(direction.as_vec3()),
        1 => Orientation::Toward(direction),
        2 => Orientation::AwayFrom(direction),
        _ => return None,
    };
    let radii = match kind & (NARROW | SPREAD) {
        0 => RadiusRule::Full,
        NARROW => RadiusRule::Narrow,
        SPREAD => RadiusRule::Spread,
        _ => return None,
    };
    let neighbours = u32::from_le_bytes(*neighbours) as usize;
    Some(SurfelOptions { neighbours, orientation, radii, seen_from: None })
}
