//! Draws egui's shapes and text into a picture in memory, so that a picture file gets the same overlays as the window.
//! egui lays out the text and cuts all shapes into triangles; the triangles are filled here, pixel by pixel, as the GPU
//! does it for the window.

use egui::epaint::{ImageDelta, Mesh, Primitive, Vertex};
use egui::{ColorImage, Context, ImageData, Painter, RawInput, Rect, TextureId, pos2, vec2};

/// The textures that shapes refer to. Text is in the first one.
type Textures = std::collections::HashMap<TextureId, ColorImage>;

/// Has `paint` draw over a picture, whose pixels are points. `rgba` holds rows of sRGB red, green, blue and opacity,
/// the top row first.
pub fn draw(rgba: &mut [u8], size: [u32; 2], paint: impl Fn(&Painter, Rect)) {
    let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(size[0] as f32, size[1] as f32));
    let context = Context::default();
    let input = RawInput { screen_rect: Some(rect), ..RawInput::default() };
    let mut output = context.run_ui(input, |ui| paint(&ui.painter().with_clip_rect(rect), rect));
    let mut textures = Textures::new();
    for (id, deltas) in std::mem::take(&mut output.textures_delta.set) {
        deltas.into_iter().for_each(|delta| update(&mut textures, id, delta));
    }
    output.textures_delta.clear();
    for clipped in context.tessellate(output.shapes, 1.0) {
        let Primitive::Mesh(mesh) = clipped.primitive else { continue };
        if let Some(texture) = textures.get(&mesh.texture_id) {
            fill(rgba, size, clipped.clip_rect, &mesh, texture);
        }
    }
}

/// Puts a change into a texture: a new one, or a part of one.
fn update(textures: &mut Textures, id: TextureId, delta: ImageDelta) {
    let ImageData::Color(image) = delta.image;
    match (delta.pos, textures.get_mut(&id)) {
        (Some([left, top]), Some(known)) => {
            let [width, height] = image.size;
            for row in 0..height {
                let to = (top + row) * known.size[0] + left;
                if let Some(into) = known.pixels.get_mut(to..to + width) {
                    into.copy_from_slice(&image.pixels[row * width..(row + 1) * width]);
                }
            }
        }
        _ => drop(textures.insert(id, (*image).clone())),
    }
}

fn fill(rgba: &mut [u8], size: [u32; 2], clip: Rect, mesh: &Mesh, texture: &ColorImage) {
    for corners in mesh.indices.chunks_exact(3) {
        let vertex = |index: usize| mesh.vertices.get(corners[index] as usize);
        if let (Some(a), Some(b), Some(c)) = (vertex(0), vertex(1), vertex(2)) {
            triangle(rgba, size, clip, [a, b, c], texture);
        }
    }
}

/// Twice the area of the triangle from an edge to a place, with a sign. In f64 it is exact enough for two triangles
/// that share an edge to agree about every pixel.
fn side(from: &Vertex, to: &Vertex, [x, y]: [f64; 2]) -> f64 {
    let (ax, ay, bx, by) = (f64::from(from.pos.x), f64::from(from.pos.y), f64::from(to.pos.x), f64::from(to.pos.y));
    (bx - ax) * (y - ay) - (by - ay) * (x - ax)
}

/// Fills the pixels whose centres lie in a triangle. A centre on an edge counts as inside of the triangle on its right
/// or below, so that of two triangles with a common edge one gets it.
fn triangle(rgba: &mut [u8], size: [u32; 2], clip: Rect, [a, mut b, mut c]: [&Vertex; 3], texture: &ColorImage) {
    let place = |vertex: &Vertex| [f64::from(vertex.pos.x), f64::from(vertex.pos.y)];
    if side(a, b, place(c)) < 0.0 {
        std::mem::swap(&mut b, &mut c);
    }
    let area = side(a, b, place(c));
    if area.is_nan() || area <= 0.0 {
        return;
    }
    let edges = [(b, c), (c, a), (a, b)];
    // With y down and the corners clockwise, a left edge goes up, and an upper edge is level and goes right.
    let owns = edges.map(|(from, to)| {
        let (dx, dy) = (to.pos.x - from.pos.x, to.pos.y - from.pos.y);
        dy < 0.0 || dy == 0.0 && dx > 0.0
    });
    let corners = [a, b, c];
    let range = |low: f32, high: f32, clip_low: f32, clip_high: f32, most: u32| {
        let (low, high) = (low.max(clip_low.round()), high.min(clip_high.round()));
        let cut = |value: f32| value.clamp(0.0, most as f32) as u32;
        (cut(low.floor()), cut(high.ceil()))
    };
    let least = |of: fn(&Vertex) -> f32| corners.iter().map(|corner| of(corner)).fold(f32::INFINITY, f32::min);
    let most = |of: fn(&Vertex) -> f32| corners.iter().map(|corner| of(corner)).fold(f32::NEG_INFINITY, f32::max);
    let (left, right) = range(least(|one| one.pos.x), most(|one| one.pos.x), clip.left(), clip.right(), size[0]);
    let (top, bottom) = range(least(|one| one.pos.y), most(|one| one.pos.y), clip.top(), clip.bottom(), size[1]);
    for y in top..bottom {
        for x in left..right {
            let center = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let sides = edges.map(|(from, to)| side(from, to, center));
            if !sides.iter().zip(owns).all(|(side, owns)| *side > 0.0 || *side == 0.0 && owns) {
                continue;
            }
            let weights = sides.map(|side| (side / area) as f32);
            let mixed = |of: &dyn Fn(&Vertex) -> f32| -> f32 {
                corners.iter().zip(weights).map(|(corner, weight)| of(corner) * weight).sum()
            };
            let texel = sample(texture, mixed(&|one| one.uv.x), mixed(&|one| one.uv.y));
            let color: [f32; 4] = std::array::from_fn(|channel| {
                mixed(&|one| f32::from(one.color.to_array()[channel])) * texel[channel] / 255.0
            });
            let at = ((y * size[0] + x) * 4) as usize;
            let Some(pixel) = rgba.get_mut(at..at + 3) else { continue };
            // Colours come multiplied with their opacity, and are mixed as the screen has them, as in the window.
            let rest = 1.0 - color[3] / 255.0;
            for (channel, value) in pixel.iter_mut().enumerate() {
                *value = (color[channel] + f32::from(*value) * rest).round().clamp(0.0, 255.0) as u8;
            }
        }
    }
}

/// The colour of a texture at a place from 0 to 1, mixed from the four texels around it.
fn sample(texture: &ColorImage, u: f32, v: f32) -> [f32; 4] {
    let [width, height] = texture.size;
    let (x, y) = (u * width as f32 - 0.5, v * height as f32 - 0.5);
    let texel = |x: f32, y: f32| {
        let x = x.clamp(0.0, width.saturating_sub(1) as f32) as usize;
        let y = y.clamp(0.0, height.saturating_sub(1) as f32) as usize;
        texture.pixels.get(y * width + x).map_or([0.0; 4], |texel| texel.to_array().map(f32::from))
    };
    let (left, top) = (x.floor(), y.floor());
    let (along, down) = (x - left, y - top);
    let (upper, lower) =
        ([texel(left, top), texel(left + 1.0, top)], [texel(left, top + 1.0), texel(left + 1.0, top + 1.0)]);
    std::array::from_fn(|channel| {
        let mix = |pair: [[f32; 4]; 2]| pair[0][channel] * (1.0 - along) + pair[1][channel] * along;
        mix(upper) * (1.0 - down) + mix(lower) * down
    })
}

#[cfg(test)]
mod tests {
    use egui::{Align2, Color32, FontId, Shape, Stroke};

    use super::*;

    const SIZE: [u32; 2] = [40, 30];

    fn drawn(paint: impl Fn(&Painter, Rect)) -> Vec<[u8; 3]> {
        let mut rgba = vec![100; (SIZE[0] * SIZE[1] * 4) as usize];
        draw(&mut rgba, SIZE, paint);
        rgba.chunks_exact(4).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    }

    #[test]
    fn triangles_that_share_an_edge_cover_each_pixel_once() {
        // Half-transparent white over grey: a pixel that is covered twice, or not at all, has another colour.
        let fan = |painter: &Painter, _: Rect| {
            let mut mesh = Mesh::default();
            let color = Color32::from_white_alpha(128);
            mesh.colored_vertex(pos2(17.25, 11.5), color);
            for corner in [pos2(0.0, 0.0), pos2(40.0, 0.0), pos2(40.0, 30.0), pos2(12.5, 30.0), pos2(0.0, 30.0)] {
                mesh.colored_vertex(corner, color);
            }
            (1..=5).for_each(|corner| mesh.add_triangle(0, corner, corner % 5 + 1));
            painter.add(Shape::mesh(mesh));
        };
        let pixels = drawn(fan);
        let expected = (128.0 + 100.0 * (1.0 - 128.0 / 255.0_f32)).round() as u8;
        assert!(pixels.iter().all(|pixel| *pixel == [expected; 3]), "{:?}", pixels.iter().find(|p| p[0] != expected));
    }

    #[test]
    fn shapes_cover_their_area_and_nothing_else() {
        let filled = |painter: &Painter, _: Rect| {
            painter.rect_filled(Rect::from_min_max(pos2(10.0, 5.0), pos2(30.0, 20.0)), 0.0, Color32::RED);
        };
        let pixels = drawn(filled);
        for (index, pixel) in pixels.iter().enumerate() {
            let (x, y) = (index as u32 % SIZE[0], index as u32 / SIZE[0]);
            let is_inside = (10..30).contains(&x) && (5..20).contains(&y);
            assert_eq!(*pixel, if is_inside { [255, 0, 0] } else { [100; 3] }, "{x} {y}");
        }
        // The brightness of a line of 2 points that goes askew is that of its area, on black.
        let mut rgba = vec![0; (SIZE[0] * SIZE[1] * 4) as usize];
        let ends = [pos2(5.3, 4.7), pos2(33.1, 22.9)];
        draw(&mut rgba, SIZE, |painter, _| {
            painter.line_segment(ends, Stroke::new(2.0, Color32::WHITE));
        });
        let sum: f32 = rgba.chunks_exact(4).map(|pixel| f32::from(pixel[0]) / 255.0).sum();
        let area = 2.0 * ends[0].distance(ends[1]);
        assert!((sum / area - 1.0).abs() < 0.1, "{sum} of {area}");
    }

    #[test]
    fn text_is_drawn_inside_of_its_rectangle_alike_each_time_and_not_outside_of_the_picture() {
        let text = |painter: &Painter, rect: Rect| {
            painter.text(rect.center(), Align2::CENTER_CENTER, "12", FontId::proportional(14.0), Color32::WHITE);
            painter.text(rect.right_top(), Align2::CENTER_CENTER, "outside", FontId::proportional(9.0), Color32::WHITE);
        };
        let pixels = drawn(text);
        let bright = |x: std::ops::Range<u32>, y: std::ops::Range<u32>| {
            let of = |(x, y): (u32, u32)| f32::from(pixels[(y * SIZE[0] + x) as usize][0]) - 100.0;
            y.flat_map(|y| x.clone().map(move |x| (x, y))).map(of).sum::<f32>() / 155.0
        };
        assert!((20.0..90.0).contains(&bright(10..30, 6..24)), "{}", bright(10..30, 6..24));
        assert_eq!(bright(0..8, 10..30), 0.0);
        assert_eq!(pixels, drawn(text));
    }
}
