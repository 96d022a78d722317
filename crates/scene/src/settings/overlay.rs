//! The parameters of what is drawn over the picture to read it by.

use param::params;

params! {
    /// Overlays: what is drawn over the picture to read it by, in the window, in pictures and in films.
    pub struct Overlay = "overlay" in "Overlays" => affects() not(swept) {
        /// A scale bar in the unit of the coordinate system; in perspective it is true at the depth of the pivot, the middle of the picture.
        scale_bar: bool = false;
        /// The numbers of the colour ramp with the attribute's name, or the names of the classes that are shown.
        legend: bool = false;
        /// An arrow to grid north, where a file names a coordinate system with one.
        north: bool = false;
        /// The directions of the axes of the coordinates.
        axes: bool = false;
        /// Measurements, notes and profiles in pictures and films, too; the window always shows them.
        labels: bool = false;
        /// Height of the text: in points of the window, in pixels of a picture.
        text: f32 = 13.0, 6.0..=200.0, "points";
    }
}
