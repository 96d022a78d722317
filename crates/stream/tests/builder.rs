//! The number of the builder belongs to the indexes that it makes: the cache knows them by it.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::path::Path;
use std::sync::Arc;

use cloud::{Cloud, Progress, hash};
use stream::{BUILDER, BuildOptions, Cache, Pages, build};

mod made_up;

/// The number of the builder, and the checksum of its indexes of the files below.
const RESULTS: (u32, u64) = (4, 0xd7fe_85a5_555f_3ca2);

const POINTS: usize = 60_000;

/// A LAS file, and a PLY file whose colours are shares of one.
fn indexes(folder: &Path) -> [Pages; 2] {
    let las = folder.join("terrain.las");
    made_up::write_las(&las, &made_up::terrain(POINTS));
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 30000\nproperty double x\nproperty double y\n\
        property double z\nproperty float red\nproperty float green\nproperty float blue\nproperty ushort intensity\n\
        end_header\n";
    let mut bytes = header.as_bytes().to_vec();
    for index in 0..30_000_u64 {
        let number = |which: u64, end: u64| (hash(index * 8 + which) % end) as f64;
        let place = [4e5 + number(0, 1000) * 0.125, 5e6 + number(1, 1000) * 0.125, number(2, 100) * 0.125];
        place.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        (3..6).for_each(|which| bytes.extend((number(which, 256) as f32 / 255.0).to_le_bytes()));
        bytes.extend((number(6, 65536) as u16).to_le_bytes());
    }
    let ply = folder.join("room.ply");
    std::fs::write(&ply, bytes).unwrap();
    let cache = Cache::new(folder.join("cache"), u64::MAX);
    let options = BuildOptions { memory: 1 << 20, preview_points: 0 };
    [las, ply].map(|path| {
        let source = Arc::new(codec::open(&path).unwrap());
        build(&[source], &cache, &options, &Progress::default(), &|_| ()).unwrap()
    })
}

/// A checksum of the tree, and of the points of each node in their order.
fn checksum(pages: &Pages) -> u64 {
    let mut sum = 0;
    let cloud = Cloud { grid: pages.grid(), ..Cloud::default() };
    let mut add = |value: u64| sum = hash(sum ^ value);
    for (id, node) in pages.octree().ids() {
        let chunk = pages.read(id).unwrap();
        add(u64::from(node.level));
        add(u64::from(node.points));
        for index in 0..chunk.len() {
            // In steps that are far below those of the files, and far above those of doubles.
            cloud
                .world_position(&chunk, index)
                .to_array()
                .into_iter()
                .for_each(|value| add((value * 4096.0).round() as i64 as u64));
            add(chunk.colors.as_ref().map_or(0, |colors| u64::from(u32::from_le_bytes(colors[index]))));
            chunk.columns.iter().flatten().for_each(|column| add(column.value(index).to_bits()));
        }
    }
    sum
}

#[test]
fn other_indexes_have_another_number_of_the_builder() {
    let folder = tempfile::tempdir().unwrap();
    let found = indexes(folder.path()).iter().fold(0, |sum, pages| hash(sum ^ checksum(pages)));
    let next = if RESULTS.0 == BUILDER { BUILDER + 1 } else { BUILDER };
    assert_eq!(
        RESULTS,
        (BUILDER, found),
        "indexes differ from those that caches keep: set stream::BUILDER to {next}, and RESULTS here to \
         ({next}, {found:#x})"
    );
}
