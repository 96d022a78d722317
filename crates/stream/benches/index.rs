//! Makes the index of `GLINT_BENCH_CLOUD` (files, separated by colons) with `GLINT_BENCH_MEMORY` MiB (1024), in a fresh
//! cache folder below `GLINT_BENCH_FOLDER` (the system's temporary folder), and prints time and memory. With
//! `GLINT_BENCH_SURFELS` it also estimates normals and radii. Linux only: the figures are from /proc.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed bench")]

use std::sync::Arc;
use std::time::Instant;

use cloud::Progress;
use stream::{BuildOptions, Cache, build, coarsest, estimate_surfels};

/// The CPU seconds of this process so far; ticks are hundredths of a second.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

fn main() {
    let Ok(paths) = std::env::var("GLINT_BENCH_CLOUD") else {
        println!("GLINT_BENCH_CLOUD names no file: nothing to do");
        return;
    };
    let memory = std::env::var("GLINT_BENCH_MEMORY").map_or(1024, |mib| mib.parse().unwrap()) << 20;
    let parent = std::env::var_os("GLINT_BENCH_FOLDER").map_or_else(std::env::temp_dir, Into::into);
    let folder = tempfile::tempdir_in(parent).unwrap();
    let inputs: Vec<_> = paths.split(':').map(|path| Arc::new(codec::open(path.as_ref()).unwrap())).collect();
    let cache = Cache::new(folder.path().to_owned(), u64::MAX);
    let options = BuildOptions { memory, preview_points: 0 };
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let pages = build(&inputs, &cache, &options, &Progress::default(), &|_| ()).unwrap();
    let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    let octree = pages.octree();
    let points = octree.points() as f64;
    println!(
        "{points} points, {} nodes, {wall:.2} s, {cpu:.2} CPU s: {:.2} M points per CPU second; {:.1} bytes a point; peak {:.0} MiB",
        octree.nodes.len(),
        points / 1e6 / cpu,
        cache.size() as f64 / points,
        peak_mib(),
    );
    let deepest = octree.nodes.iter().map(|node| node.level).max().unwrap_or(0);
    for level in 0..=deepest {
        let mut sizes: Vec<u32> = octree.nodes.iter().filter(|node| node.level == level).map(|n| n.points).collect();
        sizes.sort_unstable();
        let (least, most) = (sizes[0], sizes[sizes.len() - 1]);
        println!("level {level}: {} nodes, {least} to {most} points, median {}", sizes.len(), sizes[sizes.len() / 2]);
    }
    let start = cpu_seconds();
    let read: usize = octree.ids().map(|(id, _)| pages.read(id).unwrap().len()).sum();
    assert_eq!(read as f64, points);
    println!("read back at {:.1} M points per CPU second", points / 1e6 / (cpu_seconds() - start));
    if std::env::var_os("GLINT_BENCH_SURFELS").is_some() {
        // Resets the peak of the memory.
        std::fs::write("/proc/self/clear_refs", "5").unwrap();
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let orientation = cloud::guess_orientation(&coarsest(&pages, 500_000).unwrap(), glam::Vec3::Z);
        let options = cloud::SurfelOptions::new(orientation);
        estimate_surfels(&pages, &options, memory, &Progress::default()).unwrap();
        let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
        println!(
            "surfels ({orientation:?}): {wall:.2} s, {cpu:.2} CPU s: {:.2} M points per CPU second; {:.1} bytes a point in all; peak {:.0} MiB",
            points / 1e6 / cpu,
            cache.size() as f64 / points,
            peak_mib(),
        );
    }
}
