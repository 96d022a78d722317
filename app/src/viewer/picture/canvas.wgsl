// Draws a picture over the viewport, or black where the interface is drawn anew.

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) place: vec2f,
}

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var stretched: sampler;

// One triangle that covers the viewport.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let place = vec2f(f32(index & 1u), f32(index >> 1u)) * 2.0;
    return Corner(vec4f(place.x * 2.0 - 1.0, 1.0 - place.y * 2.0, 0.0, 1.0), place);
}

@fragment
fn show_picture(corner: Corner) -> @location(0) vec4f {
    return textureSampleLevel(picture, stretched, corner.place, 0.0);
}

@fragment
fn show_black() -> @location(0) vec4f {
    return vec4f(0.0, 0.0, 0.0, 1.0);
}
