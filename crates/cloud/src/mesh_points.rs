//! Points spread over the triangles of a mesh, so that it looks like a surface however far apart its vertices are.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::origin::offsets;
use crate::{
    CHUNK_POINTS, Chunk, Column, Surfels, TriangleMesh, normals_from_triangles, pack_normal, pack_radius, unpack_normal,
};

/// Estimated normals of corners are taken for smooth up to this angle from the triangle's own (a cosine): 40 degrees.
const SMOOTH: f64 = 0.766;

/// The radius of points, over that of the disc as large as a point's share of the area. Places that are random within
/// triangles leave wider gaps than those that a scanner leaves: a close view of the Stanford bunny has some holes with
/// 2, and none with this.
const OVERLAP: f64 = 2.5;

/// The points of a mesh beside its vertices, and what its vertices lack as points of the same surface.
pub struct MeshPoints {
    /// Points on the triangles, with colours, normals, radii and the columns that the vertices have. They are numbered
    /// after the vertices, and each names the corner that it is nearest to by its share (`Chunk::corners`).
    pub chunks: Vec<Chunk>,
    /// The normals and radii of the vertices, a list for each of their chunks.
    pub vertices: Vec<Surfels>,
}

/// The place, the packed normal and the colour of a point, and the corner that it is nearest to.
type Spread = (DVec3, u32, Option<[u8; 4]>, u32);

impl MeshPoints {
    /// Spreads `count` points over the triangles, evenly by area; the same seed gives the same points. `vertices` are
    /// all chunks of the file in order; normals that they have are interpolated. `None` if no triangle has an area,
    /// or if most vertices belong to none: they are a cloud beside a mesh.
    pub fn new(vertices: &[Chunk], triangles: &[[u32; 3]], count: usize, seed: u64) -> Option<Self> {
        let positions: Vec<DVec3> =
            vertices.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect();
        let mesh = TriangleMesh::new(&positions, &[], triangles);
        let mut is_corner = vec![false; positions.len()];
        mesh.triangles().iter().flatten().for_each(|corner| is_corner[*corner as usize] = true);
        let corners = is_corner.iter().filter(|is_corner| **is_corner).count();
        if mesh.is_empty() || corners * 2 < positions.len() {
            return None;
        }
        let own: Option<Vec<Vec<u32>>> =
            vertices.iter().map(|chunk| chunk.normals.as_ref().map(|normals| normals.to_vec())).collect();
        let is_estimated = own.is_none();
        let packed = own.unwrap_or_else(|| normals_from_triangles(vertices, mesh.triangles()).normals);
        let normals: Vec<Vec3> =
            packed.iter().flatten().map(|normal| unpack_normal(*normal).unwrap_or(Vec3::ZERO)).collect();
        let sides = |[a, b, c]: [usize; 3]| (positions[b] - positions[a]).cross(positions[c] - positions[a]);
        let area: f64 =
            mesh.triangles().iter().map(|triangle| sides(triangle.map(|corner| corner as usize)).length() / 2.0).sum();
        let radius = OVERLAP * (area / (PI * count.max(1) as f64)).sqrt();
        let radius = pack_radius(radius as f32);
        let has_colors = vertices.iter().all(|chunk| chunk.colors.is_some());
        let colors: Vec<[u8; 4]> = vertices
            .iter()
            .filter(|_| has_colors)
            .flat_map(|chunk| chunk.colors.iter().flat_map(|all| all.iter()))
            .copied()
            .collect();
        let linear: Vec<f32> = (0..=255_u16).map(|value| linear_from_srgb(f32::from(value) / 255.0)).collect();
        let columns = joined_columns(vertices);

        let point = |(triangle, shares): (usize, [f64; 3])| {
            let corners = mesh.triangles()[triangle].map(|corner| corner as usize);
            let position: DVec3 = (0..3).map(|corner| positions[corners[corner]] * shares[corner]).sum();
            let flat = sides(corners).normalize_or(DVec3::Z);
            let at_corners = corners.map(|corner| normals[corner].as_dvec3());
            let is_smooth =
                at_corners.iter().all(|normal| *normal != DVec3::ZERO && (!is_estimated || normal.dot(flat) > SMOOTH));
            let smooth: DVec3 = at_corners.into_iter().zip(shares).map(|(normal, share)| normal * share).sum();
            let normal = if is_smooth { smooth.normalize_or(flat) } else { flat };
            let nearest = (0..3).fold(0, |best, corner| if shares[corner] > shares[best] { corner } else { best });
            let color = has_colors.then(|| {
                let mixed = |channel: usize| {
                    let parts = (0..3)
                        .map(|corner| linear[usize::from(colors[corners[corner]][channel])] * shares[corner] as f32);
                    (srgb_from_linear(parts.sum()) * 255.0).round() as u8
                };
                [mixed(0), mixed(1), mixed(2), colors[corners[nearest]][3]]
            });
            (position, pack_normal(normal.as_vec3()), color, corners[nearest] as u32)
        };
        let first = positions.len() as u64;
        let chunk = |(number, points): (usize, Vec<Spread>)| {
            let corners: Vec<u32> = points.iter().map(|(_, _, _, corner)| *corner).collect();
            let places: Vec<DVec3> = points.iter().map(|(place, ..)| *place).collect();
            let (origin, offsets) = offsets(&places);
            Chunk {
                normals: Some(Arc::new(points.iter().map(|(_, normal, _, _)| *normal).collect())),
                radii: Some(Arc::new(vec![radius; points.len()])),
                colors: points.iter().map(|(_, _, color, _)| *color).collect::<Option<Vec<_>>>().map(Arc::new),
                columns: columns.iter().map(|column| Some(Arc::new(column.as_ref()?.select(&corners)))).collect(),
                corners: Some(Arc::new(corners)),
                ..Chunk::new(first + (number * CHUNK_POINTS) as u64, origin, offsets)
            }
        };
        let chunks = mesh.places(count, seed).map(point).chunks(CHUNK_POINTS).enumerate().map(chunk).collect();
        let vertices =
            packed.into_iter().map(|normals| Surfels { radii: vec![radius; normals.len()], normals }).collect();
        Some(Self { chunks, vertices })
    }
}

/// The columns of consecutive chunks as one; none where a chunk lacks it.
fn joined_columns(chunks: &[Chunk]) -> Vec<Option<Column>> {
    let count = chunks.iter().map(|chunk| chunk.columns.len()).max().unwrap_or(0);
    let joined = |index: usize| {
        let parts: Option<Vec<&Column>> = chunks.iter().map(|chunk| chunk.columns.get(index)?.as_deref()).collect();
        Column::joined(&parts?)
    };
    (0..count).map(joined).collect()
}

/// sRGB to linear (IEC 61966-2-1).
fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn srgb_from_linear(value: f32) -> f32 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use crate::unpack_radius;

    use super::*;

    /// A square of edge 2 at height 1 with a colour at each corner, and a wall that stands on its first edge.
    fn corner() -> (Vec<Chunk>, Vec<[u32; 3]>) {
        let at = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0], [0.0, 0.0, 3.0], [2.0, 0.0, 3.0]];
        let mut chunk = Chunk::new(0, DVec3::new(5e5, 0.0, 0.0), at.to_vec());
        let red = |x: f32| [if x > 1.0 { 255 } else { 0 }, 0, 0, 255];
        chunk.colors = Some(Arc::new(at.iter().map(|at| red(at[0])).collect()));
        chunk.columns = vec![Some(Arc::new(Column::U16(vec![10, 11, 12, 13, 14, 15]))), None];
        (vec![chunk], vec![[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1]])
    }

    #[test]
    fn points_lie_on_the_triangles_with_what_their_corners_have() {
        let (vertices, triangles) = corner();
        let mesh = MeshPoints::new(&vertices, &triangles, 100_000, 1).unwrap();
        assert_eq!(mesh.chunks.iter().map(Chunk::len).collect::<Vec<_>>(), [65_536, 34_464]);
        let (mut on_floor, mut brightest) = (0, 0);
        for (chunk, index) in mesh.chunks.iter().flat_map(|chunk| (0..chunk.len()).map(move |index| (chunk, index))) {
            let at = chunk.position(index) - DVec3::new(5e5, 0.0, 0.0);
            let normal = unpack_normal(chunk.normals.as_ref().unwrap()[index]).unwrap();
            let is_floor = normal.z.abs() > 0.99;
            on_floor += usize::from(is_floor);
            // The edge between both is sharp: the normals of its corners, at 45 degrees, are not taken.
            assert!(if is_floor { (at.z - 1.0).abs() < 1e-6 } else { at.y.abs() < 1e-6 && normal.y.abs() > 0.99 });
            let corner = chunk.corners.as_ref().unwrap()[index] as usize;
            let values = chunk.columns[0].as_ref().unwrap();
            assert_eq!(values.value(index), 10.0 + corner as f64);
            let [red, green, blue, opacity] = chunk.colors.as_ref().unwrap()[index];
            let share = linear_from_srgb(f32::from(red) / 255.0);
            assert!((f64::from(share) - at.x / 2.0).abs() < 0.005, "{red} at {at}");
            assert_eq!([green, blue, opacity], [0, 0, 255]);
            brightest = brightest.max(red);
            assert!(chunk.columns[1].is_none());
        }
        assert_eq!((on_floor, brightest), (50_000, 255));
        // Numbers go on after the vertices'. All points and vertices have the radius of their share of the area.
        assert_eq!(mesh.chunks.iter().map(|chunk| chunk.first_point).collect::<Vec<_>>(), [6, 6 + 65_536]);
        let radius = unpack_radius(mesh.vertices[0].radii[0]).unwrap();
        assert!((f64::from(radius) / (OVERLAP * (8.0 / (1e5 * PI)).sqrt()) - 1.0).abs() < 0.01);
        assert_eq!(mesh.chunks[1].radii.as_ref().unwrap()[7], mesh.vertices[0].radii[5]);
        // Another mesh of the same triangles has the same points.
        let again = MeshPoints::new(&vertices, &triangles, 100_000, 1).unwrap();
        assert!(again.chunks[0].positions == mesh.chunks[0].positions);
    }

    #[test]
    fn normals_of_the_file_are_interpolated_even_over_edges() {
        let (mut vertices, triangles) = corner();
        vertices[0].normals = Some(Arc::new(vec![pack_normal(Vec3::new(0.0, -1.0, 1.0)); 6]));
        let mesh = MeshPoints::new(&vertices, &triangles, 1000, 1).unwrap();
        let normals = mesh.chunks[0].normals.as_ref().unwrap();
        let expected = Vec3::new(0.0, -1.0, 1.0).normalize();
        assert!(normals.iter().all(|normal| unpack_normal(*normal).unwrap().distance(expected) < 0.01));
    }

    #[test]
    fn what_is_no_surface_stays_points() {
        let (mut vertices, mut triangles) = corner();
        assert!(MeshPoints::new(&vertices, &[], 1000, 1).is_none());
        assert!(MeshPoints::new(&vertices, &[[0, 0, 1], [0, 1, 9], [7, 8, 9]], 1000, 1).is_none());
        // Triangles that are none are left out, corners that are not finite too.
        triangles.extend([[0, 1, 77], [3, 3, 3], [u32::MAX, 0, 1]]);
        Arc::make_mut(&mut vertices[0].positions)[4] = [f32::NAN; 3];
        let mesh = MeshPoints::new(&vertices, &triangles, 1000, 1).unwrap();
        let finite = mesh.chunks[0].positions.iter().flatten().all(|part| part.is_finite());
        assert!(finite && mesh.chunks[0].len() == 1000);
        assert!(!mesh.chunks[0].corners.as_ref().unwrap().contains(&4));
        // A cloud of many points beside a few triangles stays a cloud.
        let many = Chunk::new(0, DVec3::ZERO, (0..100).map(|x| [x as f32, (x * x) as f32, 0.0]).collect());
        assert!(MeshPoints::new(&[many], &[[0, 1, 2]], 1000, 1).is_none());
    }
}
