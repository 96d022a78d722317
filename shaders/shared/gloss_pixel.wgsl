// What the passes of glossy mirrors note for each thread of the tiles where mirrors may be seen.
struct GlossPixel {
    // How much the ray of this sample counts.
    weight: f32,
    // Names the ray among those that the thread may have; see gloss_normals.wgsl.
    key: u32,
    // 1 if it is not known what the ray meets.
    is_anew: u32,
    // 1 if the pixel draws from its mirror's own lobe.
    draws_own: u32,
}

// The place of a thread among those of a pass over the tiles.
fn place_of_thread(thread: vec3u, groups: vec3u) -> u32 {
    return thread.y * groups.x * 8u + thread.x;
}

// What a ray meets is kept in three words. First: the second word of its hit. Second: the distance, with the sign set
// where nothing proves that the ray is free up to the hit; the first word of a hit on nothing. Third: the ray's key,
// with the top bit set if it ends in the camera's picture; 0 if nothing was kept.
const KEPT_WORDS: u32 = 3u;
const TOP_BIT: u32 = 0x80000000u;
