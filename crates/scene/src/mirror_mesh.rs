//! The surface of a mirror that is a mesh: the name of its file and, once that is read, its triangles. A mesh that this
//! program makes stands in where there is no file: a hare, closed and bumpy, with hollows between its limbs.

use std::sync::{Arc, LazyLock};

use cloud::TriangleMesh;
use glam::{DVec3, UVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The mesh of a mirror. Two meshes of the same name are equal, whether or not their file is read.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct MirrorMesh {
    /// The path of a mesh file, or [`MirrorMesh::HARE`].
    pub name: String,
    /// Empty until the file is read.
    pub surface: Arc<TriangleMesh>,
}

impl MirrorMesh {
    /// The name of the mesh that this program makes. It sits, looks towards -x, and its ears point to +z.
    pub const HARE: &str = "hare";

    pub fn hare() -> Self {
        static MADE: LazyLock<Arc<TriangleMesh>> = LazyLock::new(|| Arc::new(made()));
        Self { name: Self::HARE.to_owned(), surface: MADE.clone() }
    }

    /// Whether its file is still to be read.
    pub fn is_file(&self) -> bool {
        self.name != Self::HARE
    }
}

impl From<String> for MirrorMesh {
    fn from(name: String) -> Self {
        if name == Self::HARE { Self::hare() } else { Self { name, surface: Arc::default() } }
    }
}

impl From<MirrorMesh> for String {
    fn from(mesh: MirrorMesh) -> Self {
        mesh.name
    }
}

impl PartialEq for MirrorMesh {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// The hare's limbs: the middles and half axes of ellipsoids. Those off y = 0 come in pairs.
const LIMBS: [([f64; 3], [f64; 3]); 10] = [
    // Body, chest, head, muzzle, tail.
    ([0.10, 0.0, 0.0], [0.55, 0.40, 0.42]),
    ([-0.30, 0.0, 0.05], [0.30, 0.28, 0.36]),
    ([-0.55, 0.0, 0.42], [0.27, 0.22, 0.23]),
    ([-0.75, 0.0, 0.36], [0.13, 0.12, 0.11]),
    ([0.68, 0.0, -0.05], [0.14, 0.14, 0.14]),
    // Ears, haunches, hind feet, forelegs, forefeet.
    ([-0.42, 0.13, 0.86], [0.11, 0.07, 0.38]),
    ([0.30, 0.30, -0.12], [0.30, 0.16, 0.30]),
    ([0.18, 0.36, -0.40], [0.32, 0.10, 0.09]),
    ([-0.42, 0.17, -0.20], [0.10, 0.09, 0.26]),
    ([-0.52, 0.17, -0.42], [0.17, 0.09, 0.07]),
];

/// The width over which limbs melt into one another.
const MELT: f64 = 0.07;

/// The height of the bumps of the fur, and their waves per unit along x, y and z, as angles.
const FUR: (f64, [f64; 3]) = (0.006, [29.0, 31.0, 27.0]);

/// The width of a cell of the grid: a seventh of an ear's thickness.
const CELL: f64 = 0.02;

/// The corner of the grid, and its number of cells along each axis.
const CORNER: DVec3 = DVec3::new(-0.96, -0.56, -0.60);
const CELLS: UVec3 = UVec3::new(92, 56, 96);

/// Less than 0 inside the hare; near its surface it grows by about 1 per unit outwards.
fn outside(p: DVec3) -> f64 {
    let distance = |middle: DVec3, half: DVec3| {
        let (one, two) = ((p - middle) / half, (p - middle) / (half * half));
        one.length() * (one.length() - 1.0) / two.length().max(f64::MIN_POSITIVE)
    };
    let mut nearest = f64::INFINITY;
    for (middle, half) in LIMBS {
        let (middle, half) = (DVec3::from(middle), DVec3::from(half));
        let pair = [middle, DVec3::new(middle.x, -middle.y, middle.z)];
        for middle in &pair[..if middle.y == 0.0 { 1 } else { 2 }] {
            // The smooth minimum of Quilez (2013), polynomial of degree 2.
            let own = distance(*middle, half);
            let share = (1.0 - (own - nearest).abs() / MELT).max(0.0);
            nearest = own.min(nearest) - share * share * MELT / 4.0;
        }
    }
    let (height, waves) = FUR;
    let [x, y, z] = (p * DVec3::from(waves)).to_array().map(f64::sin);
    nearest + height * (x * y + y * z + z * x)
}

fn slope(p: DVec3) -> DVec3 {
    // Small against the fur, and large against rounding.
    const STEP: f64 = 1e-5;
    let along = |axis: DVec3| (outside(p + axis * STEP) - outside(p - axis * STEP)) / (2.0 * STEP);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

/// Makes the hare's triangles by surface nets (Gibson 1998): a corner in each cell that the surface crosses, moved onto
/// the surface, and a square around each edge of the grid that it crosses.
fn made() -> TriangleMesh {
    let nodes = CELLS + 1;
    let index_of = |at: UVec3, size: UVec3| ((at.z * size.y + at.y) * size.x + at.x) as usize;
    let place_of = |index: usize, size: UVec3| {
        let (index, row, layer) = (index as u32, size.x, size.x * size.y);
        UVec3::new(index % row, index % layer / row, index / layer)
    };
    let count = |size: UVec3| (size.x * size.y * size.z) as usize;
    let at = |node: UVec3| CORNER + node.as_dvec3() * CELL;
    let values: Vec<f64> = (0..count(nodes)).into_par_iter().map(|index| outside(at(place_of(index, nodes)))).collect();
    let value = |node: UVec3| values[index_of(node, nodes)];
    let corner = |cell: UVec3, number: u32| cell + UVec3::new(number & 1, number >> 1 & 1, number >> 2);

    let mut corner_of = vec![u32::MAX; count(CELLS)];
    let mut starts = Vec::new();
    for (index, corner_of) in corner_of.iter_mut().enumerate() {
        let cell = place_of(index, CELLS);
        let (mut sum, mut crossings) = (DVec3::ZERO, 0.0);
        for number in 0..8_u32 {
            for axis in [1, 2, 4].into_iter().filter(|axis| number & axis == 0) {
                let [from, to] = [number, number | axis].map(|number| corner(cell, number));
                let [low, high] = [value(from), value(to)];
                if (low < 0.0) != (high < 0.0) {
                    sum += at(from).lerp(at(to), low / (low - high));
                    crossings += 1.0;
                }
            }
        }
        if crossings > 0.0 {
            *corner_of = starts.len() as u32;
            starts.push(sum / crossings);
        }
    }
    let settle = |start: &DVec3| {
        let mut p = *start;
        for _ in 0..3 {
            let slope = slope(p);
            p -= slope * (outside(p) / slope.length_squared().max(f64::MIN_POSITIVE));
        }
        // Where limbs meet, the slope jumps and a step may lead too far.
        p = if p.distance(*start) < CELL { p } else { *start };
        (p, slope(p).normalize_or_zero().as_vec3())
    };
    let (positions, normals): (Vec<DVec3>, Vec<Vec3>) = starts.par_iter().map(settle).unzip();

    let mut triangles = Vec::new();
    for index in 0..count(nodes) {
        let node = place_of(index, nodes);
        for axis in 0..3 {
            let [u, v] = [UVec3::AXES[(axis + 1) % 3], UVec3::AXES[(axis + 2) % 3]];
            let next = node + UVec3::AXES[axis];
            let has_cells = next[axis] < nodes[axis] && (node * (u + v)).cmpge(u + v).all();
            if !has_cells || (value(node) < 0.0) == (value(next) < 0.0) {
                continue;
            }
            let [a, b, c, d] = [node - u - v, node - v, node, node - u].map(|cell| corner_of[index_of(cell, CELLS)]);
            // Counter-clockwise about the direction that leads outwards.
            let [a, b, c, d] = if value(node) < 0.0 { [a, b, c, d] } else { [a, d, c, b] };
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriangleMesh::new(&positions, &normals, &triangles)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    #[test]
    fn the_hare_is_closed_and_its_normals_point_outwards() {
        let hare = MirrorMesh::hare().surface;
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for [a, b, c] in hare.triangles() {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((*from.min(to), *from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        assert!(edges.len() > 10_000 && edges.values().all(|turns| *turns == 0), "a hole or a turned triangle");
        let mut volume = 0.0;
        for triangle in hare.triangles() {
            let corners = triangle.map(|corner| corner as usize);
            let [a, b, c] = corners.map(|corner| hare.positions()[corner]);
            volume += a.dot(b.cross(c)) / 6.0;
        }
        assert!((0.2..1.0).contains(&volume), "{volume}");
        let against = hare.triangles().iter().filter(|triangle| {
            let [a, b, c] = triangle.map(|corner| hare.positions()[corner as usize]);
            triangle.iter().any(|corner| hare.normals()[*corner as usize].as_dvec3().dot((b - a).cross(c - a)) < 0.0)
        });
        let share = against.count() as f64 / hare.triangles().len() as f64;
        assert!(share < 0.01, "{share} of the triangles disagree with their corners' normals");
    }

    #[test]
    fn the_hare_has_hollows_and_bumps() {
        // Where two normals of an edge lean towards each other, the surface is hollow along it.
        let hare = MirrorMesh::hare().surface;
        let (mut hollow, mut bulged) = (0, 0);
        for [a, b, _] in hare.triangles() {
            let [from, to] = [a, b].map(|corner| *corner as usize);
            let along = hare.positions()[to] - hare.positions()[from];
            let bend = (hare.normals()[to] - hare.normals()[from]).as_dvec3().dot(along);
            if bend < 0.0 { hollow += 1 } else { bulged += 1 }
        }
        let share = f64::from(hollow) / f64::from(hollow + bulged);
        assert!((0.1..0.5).contains(&share), "{share} of the edges are hollow");
    }
}
