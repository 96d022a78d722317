//! Makes the index of a file and chooses the nodes that a view needs, within a budget:
//! `cargo run --release --example cut_index -- scan.laz FOLDER POINTS`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::Progress;
use glam::{DMat3, DVec2, DVec3};
use stream::{Budget, BuildOptions, Cache, Tree, ViewMeasure, build, choose};

/// The cache takes this many bytes of the disk.
const CACHE: u64 = 100 << 30;
/// The height of the picture in pixels, and the distance of its points there that is fine enough.
const HEIGHT: f64 = 1080.0;
const FINEST_PIXELS: f64 = 1.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, folder, points] = arguments.as_slice() else { return Err("usage: cut_index FILE FOLDER POINTS".into()) };
    let source = Arc::new(codec::open(Path::new(file))?);
    let cache = Cache::new(PathBuf::from(folder), CACHE);
    let pages = build(&[source], &cache, &BuildOptions::default(), &Progress::default(), &|_| ())?;
    let octree = pages.octree();
    println!("{} nodes, {} points", octree.nodes.len(), octree.points());

    // From the south, an eighth of the cloud's size away from its southern edge, to the north.
    let bounds = octree.scene_bounds();
    let eye = bounds.center() - DVec3::Y * (0.5 * bounds.size().y + bounds.size().max_element() / 8.0);
    let view_from_world = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y).transpose();
    let tangents = DVec2::new(0.7, 0.4);
    let view = ViewMeasure::perspective(eye, view_from_world, tangents, HEIGHT, 0.0);
    let trees = [Tree { cloud: 0, octree, point_bytes: 32 }];
    let budget = Budget { points: points.parse()?, bytes: u64::MAX };
    let cut = choose(&trees, |_, octree, node| view.pixels(octree, node), budget, FINEST_PIXELS);
    let mut drawn = 0;
    for wanted in &cut.wanted {
        // The batches of a node are even shares of its points: the last node of the cut may give only some.
        drawn += stream::prefix(pages.read(wanted.node)?.len(), wanted.batches);
    }
    println!("the view needs {} nodes with {drawn} points", cut.wanted.len());
    Ok(())
}
