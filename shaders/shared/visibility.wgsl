// Tests whether a point is shown. The CPU does the same test in `PointTest` (crates/cloud/src/visibility.rs). The
// importing pass binds `class_masks`.

// Set while a class is hidden.
override filter_classes: bool = false;

// `class_mask` is the first of the eight words of the class masks to test. `point` has its class in the third byte of
// w.
fn is_shown(class_mask: u32, point: vec4u) -> bool {
    if !filter_classes {
        return true;
    }
    let class_code = (point.w >> 16u) & 0xffu;
    return (class_masks[class_mask + (class_code >> 5u)] & (1u << (class_code & 31u))) != 0u;
}
