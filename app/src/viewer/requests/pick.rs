//! A point that the user picked, and what is known of it.

use cloud::{Chunk, Cloud};
use glam::DVec3;

use crate::shared::measuring::PointError;
use crate::shared::numbers::coordinate;
use crate::viewer::picture::messages::PickedPoint;

/// A point that the user clicked on.
#[derive(Clone)]
pub struct Pick {
    pub point: PickedPoint,
    /// The number of its record in the file.
    pub number: u64,
    pub cloud: String,
    /// The position in the file's own coordinates.
    pub world: DVec3,
    /// All attributes that the file has of the point; `None` until they have been read.
    pub record: Option<Result<Vec<(String, String)>, String>>,
    /// What comparisons have added to it.
    pub added: Vec<(String, String)>,
    /// How far it may be off the surface, once that is known.
    pub error: Option<PointError>,
    /// Whether the point comes from an index, which keeps neither its number in the file nor its other attributes.
    pub is_streamed: bool,
    /// Whether the cloud is shown elsewhere than where the file has it.
    pub is_moved: bool,
}

/// The attributes of a point that are known without reading its file.
pub fn loaded_attributes(cloud: &Cloud, chunk: &Chunk, index: usize) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    if let Some(colors) = &chunk.colors {
        let [red, green, blue, _] = colors[index];
        attributes.push(("color".into(), format!("{red} {green} {blue}")));
    }
    if let Some(normal) = chunk.normals.as_ref().and_then(|normals| cloud::unpack_normal(normals[index])) {
        attributes.push(("normal".into(), format!("{:.4} {:.4} {:.4}", normal.x, normal.y, normal.z)));
    }
    for (attribute, column) in cloud.attributes.iter().zip(&chunk.columns) {
        if let Some(column) = column {
            attributes.push((attribute.name.clone(), column.text(index)));
        }
    }
    attributes
}

/// Formats coordinates in the file's full precision.
pub fn coordinates(world: DVec3) -> String {
    format!("{}  {}  {}", shortest(world.x), shortest(world.y), shortest(world.z))
}

/// The fewest decimals that give the same number. It may differ by two units in the last place of the f64, which is the
/// rounding error of integer times scale plus offset.
fn shortest(value: f64) -> String {
    let same =
        |text: &String| text.parse().is_ok_and(|back: f64| (back - value).abs() <= value.abs() * 2.0 * f64::EPSILON);
    (0..17).map(|decimals| format!("{value:.decimals$}")).find(same).unwrap_or_else(|| value.to_string())
}

/// By how much of itself a coordinate in single precision may differ from that of the file.
const ROUNDING: f64 = 1e-6;
/// By how much it may differ at most: farther from the origin, rounding would hide that another point is meant.
const MOST_ROUNDING: f64 = 1e-3;

/// The axis whose coordinate an attribute of this name is.
fn axis_of(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| name.eq_ignore_ascii_case(axis))
}

impl Pick {
    /// The coordinates: those of the file's record, where they are the same but for rounding. Single precision and the way
    /// through a chunk would add digits.
    fn place(&self) -> DVec3 {
        let mut place = self.world;
        if self.is_moved {
            return place;
        }
        for (name, value) in self.record.iter().flatten().flatten() {
            let axis = axis_of(name);
            let known: Option<(usize, f64)> = axis.and_then(|axis| Some((axis, value.parse().ok()?)));
            if let Some((axis, value)) = known
                && (value - self.world[axis]).abs() <= (ROUNDING * self.world[axis].abs().max(1.0)).min(MOST_ROUNDING)
            {
                place[axis] = value;
            }
        }
        place
    }

    /// The coordinates as a person reads them: with the digits of the file, but for a cloud that is elsewhere.
    pub fn coordinates(&self) -> String {
        if self.is_moved {
            return self.world.to_array().map(|value| coordinate(value, 7)).join("  ");
        }
        coordinates(self.place())
    }

    /// What the file says of it and comparisons have added, without the coordinates, which stand for themselves.
    pub fn attributes(&self) -> impl Iterator<Item = &(String, String)> {
        let place = self.place();
        let is_place =
            move |(name, value): &&(String, String)| axis_of(name).is_some_and(|axis| value.parse() == Ok(place[axis]));
        self.record.iter().flatten().flatten().filter(move |entry| !is_place(entry)).chain(&self.added)
    }

    /// The text that Copy puts on the clipboard, as tab-separated lines.
    pub fn as_text(&self) -> String {
        // The number of a streamed point means nothing outside of its index.
        let number = if self.is_streamed { String::new() } else { format!("\tpoint {}", self.number) };
        let mut text = format!("{}{number}\t{}\n", self.cloud, self.coordinates().replace("  ", "\t"));
        for (name, value) in self.attributes() {
            text += &format!("{name}\t{value}\n");
        }
        if let Some(PointError { across, sight, is_thinned, .. }) = self.error {
            let by = if is_thinned { "\tby the loaded points" } else { "" };
            text += &format!("± across\t{across}{by}\n± sight\t{sight}{by}\n");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_keep_the_digits_of_the_file_and_no_others() {
        let grid = 63_561_912_345_f64 * 0.001;
        assert_eq!(coordinates(DVec3::new(grid, -0.25, 7.0)), "63561912.345  -0.25  7");
        assert_eq!(coordinates(DVec3::new(0.0, 1e-3, 1_000_000_000.123_456)), "0  0.001  1000000000.123456");
    }
}
