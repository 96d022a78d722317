use super::*;

fn points(chunks: &[Chunk]) -> Vec<DVec3> {
    chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect()
}

#[test]
fn each_scan_has_the_rays_that_were_asked_for_and_the_same_seed_gives_the_same_points() {
    for tripod in Tripod::ALL {
        let one = points(&scan(tripod, 20_000, 1));
        let is_open = tripod == Tripod::Street;
        let least = if is_open { 8_000 } else { 19_500 };
        assert!((least..=20_500).contains(&one.len()), "{tripod:?}: {}", one.len());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(one == pool.install(|| points(&scan(tripod, 20_000, 1))), "{tripod:?} differs with the threads");
        assert!(tripod == Tripod::Room || one != points(&scan(tripod, 20_000, 2)), "{tripod:?} has no seed");
    }
}
