// Reads whether a point is shown. The CPU decides it, chunk by chunk (`ChunkTest` in crates/cloud/src/visibility.rs): a
// bit for each point of the page, 32 in a word. The importing module defines `shown_word(word)`.

// Set while some points are hidden; else there are no bits.
override hides_points: bool = false;

// `index` is that of the point in the page.
fn is_shown(index: u32) -> bool {
    if !hides_points {
        return true;
    }
    return (shown_word(index >> 5u) & (1u << (index & 31u))) != 0u;
}
