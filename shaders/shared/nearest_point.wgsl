// Offers every fragment of a point to its pixel. The importing pass defines `put(pixel, depth, identity)`, which keeps
// the nearest. Among discs in one plane the one whose middle is nearest should win, or colours would spread beyond
// their edges: so discs are hollow, by RIM of their radius, which is far below the precision of the points' positions.
#import large_discs

const RIM: f32 = 0.001;

// Set if points behind the plane of the frame are hidden.
override clips: bool = false;

fn splat_point(item: Item, index: u32) {
    let point = points[index];
    if !is_shown(index) {
        return;
    }
    if clips && dot(frame.clip.xyz, bitcast<vec3f>(point.xyz) + item.origin_radius.xyz) < frame.clip.w {
        return;
    }
    if hides_backs && is_turned_away(item, point, index) {
        return;
    }
    let identity = identities_from + index;
    if pixels_only {
        let single = single_of_point(frame, item, point);
        if single.is_drawn {
            put(single.pixel, single.center.z, identity);
        }
        return;
    }
    var disc = disc_of_point(frame, settings.splat, item, point);
    if disc.radius_pixels == 0.0 {
        return;
    }
    if is_shared(disc) {
        put_off(index);
        return;
    }
    if !disc.is_single {
        disc = oriented_disc(frame, disc, point.w, attributes[index].y);
    }
    if covers_nothing(disc) {
        return;
    }
    var at = disc.first;
    loop {
        offer(disc, at, identity);
        at = next_pixel(disc, at);
        if at.y > disc.last.y {
            break;
        }
    }
}

fn splat_large(item: Item, index: u32, lane: u32) {
    let point = points[index];
    let disc = oriented_disc(frame, disc_of_point(frame, settings.splat, item, point), point.w, attributes[index].y);
    for (var i = lane; i < pixels_of_disc(disc); i += LANES) {
        offer(disc, pixel_of_disc(disc, i), identities_from + index);
    }
}

fn offer(disc: Disc, pixel: vec2i, identity: u32) {
    let fragment = fragment_of_disc(frame, disc, pixel);
    if disc.is_single || fragment.depth > 0.0 {
        let beside = fragment.depth + RIM * disc.radius * (1.0 - fragment.weight);
        let depth = select(beside, disc.center.z, disc.is_single);
        put(u32(pixel.y) * frame.width + u32(pixel.x), depth, identity);
    }
}
