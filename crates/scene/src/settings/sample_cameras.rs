//! The parameters of sample-based cameras.

use param::{choices, params};

choices! {
    /// What a camera of reflected rays stands for.
    pub enum CameraCells { Image = "image", Space = "space" }
}
choices! {
    /// What finds the rays that no bundle stands for.
    pub enum BundleRest { None = "none", SurfelTrace = "surfel_trace" }
}
choices! {
    /// By what the error of a bundle of reflected rays is judged.
    pub enum JudgedBy { Solve = "solve", Ray = "ray" }
}
choices! {
    /// What descends into the squares of the mirror's picture.
    pub enum BundleCull { None = "none", Blocks = "blocks" }
}
choices! {
    /// How large the splat of a reflected point is.
    pub enum BundleSplat { Published = "published", Footprint = "footprint" }
}

params! {
    /// Sample-based cameras (after Popescu, Sacks and Mei 2006): bundles of the mirror's rays project points.
    pub struct SampleCameras = "sample_cameras" in "Reflections" => affects(found) {
        /// What a camera stands for: a square of the mirror's picture, fitted anew each frame, or as published a cell of space with a pinhole or a list of rays, kept while camera and mirrors stand.
        cells: CameraCells = CameraCells::Image;
        /// Largest error of a bundle or a pinhole on the rays that it stands for; those with a larger one are divided.
        accuracy: f32 = 1.0, 0.25..=16.0, "pixels";
        /// Cameras are fitted to every ray at 1, to every second one along a row at 2, to every fourth at 4. 0 is 1 for squares, which are at least twice as wide, and 4 for cells of space.
        down_sampling: u32 = 0, 0..=32, "pixels";
        /// Degree of a bundle's polynomials: with a higher one fewer squares are divided, but single ones take longer. For squares.
        degree: u32 = 2, 1..=3, "";
        /// Edge of the smallest squares, rounded down to a power of two. Large ones average the noise of normals.
        least_square: u32 = 4, 2..=64, "pixels";
        /// Edge of the largest squares, rounded down to a power of two.
        largest_square: u32 = 64, 16..=128, "pixels";
        /// By what the error of a bundle is judged: how far the place is off that it finds for a point of a ray, or how far its ray is beside that point, which stays finite where rays meet. For squares.
        judged_by: JudgedBy = JudgedBy::Solve;
        /// Points nearer to the mirror than this do not count in a camera's error.
        near: f32 = 0.0, 0.0..=1.0, "scene radii";
        /// Cells of space are divided as long as the larger part has no more than this share of the rays, which may lie in both; beyond it, a list of rays stands for the cell. 1 is the letter of the paper.
        split_gain: f32 = 0.8, 0.5..=1.0, "share";
        /// Longest list of rays that projects points: rays of longer ones are left to `rest`. Counts the gaps between four rays. For cells of space.
        longest_list: u32 = 64, 4..=4096, "gaps";
        /// Places of the mirror that each point may be reflected in; further ones are dropped and counted.
        roots: u32 = 4, 1..=16, "places";
        /// Find points in perfect planes and spheres by the formula of the mirror instead of squares; beyond 16 mirrors, and after the first reflection, squares stand for these, too.
        analytic: bool = true;
        /// Let whole blocks of points descend into the squares before their points, or each point alone; the picture is the same. For squares.
        cull: BundleCull = BundleCull::Blocks;
        /// Newton steps on the mirror's own pixels after a camera has found a place.
        polish: u32 = 0, 0..=2, "steps";
        /// Points that are kept for each mirror pixel on average, by how large their reflections are; 0 keeps all.
        points_per_pixel: f32 = 2.0, 0.0..=16.0, "points";
        /// What the rays show that no camera stands for: of the smallest squares, what their bundle finds as far as each pixel's own ray agrees, and of cells of space nothing; or what surfel_trace finds, for which the points need trees.
        rest: BundleRest = BundleRest::SurfelTrace;
        /// Splats as large as the reflections of discs, on whose planes rays end, or squares that shrink with the distance, as sscr has them (sscr.max_splat_size).
        splat: BundleSplat = BundleSplat::Footprint;
    }
}
