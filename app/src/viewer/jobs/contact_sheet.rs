//! A picture that shows several pictures side by side, with lines of text below each.

use egui::epaint::text::{FontDefinitions, Fonts, TextOptions};
use egui::{Color32, FontId};
use image::imageops::{FilterType, resize};
use image::{Rgba, RgbaImage};

/// One picture of the sheet.
pub struct Tile {
    /// Rows of sRGB red, green, blue and opacity, in the sheet's tile size; empty if there is no picture.
    pub rgba: Vec<u8>,
    pub lines: Vec<String>,
}

/// Wider pictures are shrunk to this width in pixels: four of them fill a wide screen side by side.
const WIDEST: u32 = 480;
/// The least width of a tile in pixels, so that the text fits: a narrower picture has free space on its right.
const NARROWEST: u32 = 260;
const GAP: u32 = 12;
const LINE: u32 = 18;
const BACKGROUND: Rgba<u8> = Rgba([0x1a, 0x1c, 0x20, 0xff]);
const TEXT: [u8; 3] = [0xd6, 0xd9, 0xde];

/// The size in pixels of the tiles for pictures of `size`.
pub fn tile_size(size: [u32; 2]) -> [u32; 2] {
    let width = size[0].clamp(1, WIDEST);
    [width, (u64::from(size[1]) * u64::from(width)).div_ceil(u64::from(size[0].max(1))) as u32]
}

/// Shrinks a picture to the tile size; both are rows of sRGB red, green, blue and opacity.
pub fn shrunk(size: [u32; 2], rgba: Vec<u8>) -> Vec<u8> {
    let [width, height] = tile_size(size);
    match RgbaImage::from_raw(size[0], size[1], rgba) {
        Some(picture) if width != size[0] => resize(&picture, width, height, FilterType::Triangle).into_raw(),
        picture => picture.map(RgbaImage::into_raw).unwrap_or_default(),
    }
}

/// Draws a sheet of tiles of one size, row by row, with about as many columns as rows. Returns the sheet's size in
/// pixels and its pixels.
pub fn draw([width, height]: [u32; 2], tiles: Vec<Tile>) -> ([u32; 2], Vec<u8>) {
    let columns = (tiles.len() as f64).sqrt().ceil().max(1.0) as u32;
    let rows = (tiles.len() as u32).div_ceil(columns);
    let most_lines = tiles.iter().map(|tile| tile.lines.len() as u32).max().unwrap_or(0);
    let step = [width.max(NARROWEST) + GAP, height + most_lines * LINE + GAP];
    let mut sheet = RgbaImage::from_pixel(columns * step[0] + GAP, rows * step[1] + GAP, BACKGROUND);
    let mut fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
    for (index, tile) in (0..).zip(tiles) {
        let corner = [GAP + index % columns * step[0], GAP + index / columns * step[1]];
        if let Some(picture) = RgbaImage::from_raw(width, height, tile.rgba) {
            image::imageops::replace(&mut sheet, &picture, corner[0].into(), corner[1].into());
        }
        for (line, text) in (0..).zip(&tile.lines) {
            write(&mut sheet, &mut fonts, text, [corner[0], corner[1] + height + 2 + line * LINE]);
        }
    }
    ([sheet.width(), sheet.height()], sheet.into_raw())
}

/// Writes a line of text with its upper left corner at `corner`.
fn write(sheet: &mut RgbaImage, fonts: &mut Fonts, text: &str, corner: [u32; 2]) {
    let mut view = fonts.with_pixels_per_point(1.0);
    let galley = view.layout_no_wrap(text.into(), FontId::proportional(13.0), Color32::WHITE);
    let atlas = view.image();
    for row in &galley.rows {
        for glyph in &row.row.glyphs {
            let place = row.pos + glyph.pos.to_vec2() + glyph.uv_rect.offset;
            let [left, top] = glyph.uv_rect.min.map(usize::from);
            let [right, bottom] = glyph.uv_rect.max.map(usize::from);
            for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y))) {
                let coverage = u32::from(atlas[(x, y)].a());
                let at = [place.x.round() as i64 + (x - left) as i64, place.y.round() as i64 + (y - top) as i64];
                let at = [0, 1].map(|axis| i64::from(corner[axis]) + at[axis]);
                let [Ok(column), Ok(line)] = at.map(u32::try_from) else { continue };
                if let Some(pixel) = sheet.get_pixel_mut_checked(column, line) {
                    for (channel, ink) in pixel.0.iter_mut().zip(TEXT) {
                        *channel = ((u32::from(*channel) * (255 - coverage) + u32::from(ink) * coverage) / 255) as u8;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_picture_is_on_the_sheet_with_its_text_below() {
        let size = [40, 30];
        let shades = [[200, 0, 0, 255], [0, 200, 0, 255], [0, 0, 200, 255]];
        let tile = |(line, shade): (&str, [u8; 4])| Tile { rgba: shade.repeat(40 * 30), lines: vec![line.into()] };
        let tiles: Vec<Tile> = ["a = 1", "", "a = 3"].into_iter().zip(shades).map(tile).collect();
        let (sheet_size, rgba) = draw(size, tiles);
        let sheet = RgbaImage::from_raw(sheet_size[0], sheet_size[1], rgba).unwrap();
        for shade in shades {
            assert_eq!(sheet.pixels().filter(|pixel| pixel.0 == shade).count(), 40 * 30);
        }
        let step = [NARROWEST + GAP, 30 + LINE + GAP];
        let ink = |index: u32| {
            let (left, top) = (GAP + index % 2 * step[0], GAP + index / 2 * step[1] + 30);
            let text = image::imageops::crop_imm(&sheet, left, top, NARROWEST, LINE).to_image();
            text.pixels().filter(|pixel| **pixel != BACKGROUND).count()
        };
        assert!(ink(0) > 20 && ink(2) > 20, "{} {}", ink(0), ink(2));
        assert_eq!(ink(1), 0);
    }

    #[test]
    fn wide_pictures_are_shrunk_to_tiles_and_others_stay() {
        assert_eq!((tile_size([960, 540]), tile_size([64, 48])), ([480, 270], [64, 48]));
        assert_eq!(shrunk([960, 2], vec![7; 960 * 2 * 4]), vec![7; 480 * 4]);
        assert_eq!(shrunk([2, 1], (0..8).collect()), (0..8).collect::<Vec<u8>>());
    }
}
