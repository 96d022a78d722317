//! Reads the meshes of mirrors.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{Chunk, Progress, TriangleMesh, unpack_normal};
use codec::Selection;
use glam::{DVec3, Vec3};
use scene::{Shape, shown};

use crate::error::{Error, Result};

/// The shape with the triangles of its mesh, which are read where they have not been. Other shapes stay as they are.
///
/// # Errors
/// The file cannot be read, or holds no triangle that has an area.
pub fn with_mesh(mut shape: Shape) -> Result<Shape> {
    if let Shape::Mesh(mesh) = &mut shape
        && mesh.is_file()
        && mesh.surface.is_empty()
    {
        mesh.surface = Arc::new(read(Path::new(&mesh.name))?);
    }
    Ok(shape)
}

/// Reads the triangles of a file. Its corners have the file's normals or else the mean normals of their triangles,
/// weighted by area. A file that is cut short gives the triangles whose corners it has.
fn read(path: &Path) -> Result<TriangleMesh> {
    let source = codec::open(path)?;
    let none = |problem| Error::NoMesh { path: shown(path), problem };
    if !source.is_mesh() {
        let problem = "has no faces, so it is no mesh; `mirror_points` turns the points of a cloud into a mirror";
        return Err(none(problem));
    }
    let selection = Selection { positions: true, normals: source.info().has_normals, ..Selection::default() };
    let chunks = Mutex::new(Vec::new());
    let keep = |chunk: Chunk| chunks.lock().unwrap_or_else(PoisonError::into_inner).push(chunk);
    source.read(&selection, &Progress::default(), &keep)?;
    let mut chunks = chunks.into_inner().unwrap_or_else(PoisonError::into_inner);
    chunks.sort_by_key(|chunk| chunk.first_point);
    // Corners are counted from the start of the file, so none behind a gap can be identified.
    let mut next = 0;
    let is_next =
        |chunk: &Chunk| chunk.first_point == std::mem::replace(&mut next, chunk.first_point + chunk.len() as u64);
    let there = chunks.iter().map(is_next).take_while(|is_next| *is_next).count();
    chunks.truncate(there);
    let triangles = source.triangles()?;
    let positions: Vec<DVec3> =
        chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect();
    let own = |chunk: &Chunk| chunk.normals.as_ref().map(|normals| normals.to_vec());
    let normals = match chunks.iter().map(own).collect() {
        Some(normals) => normals,
        None => cloud::normals_from_triangles(&chunks, &triangles).normals,
    };
    let normals: Vec<Vec3> =
        normals.into_iter().flatten().map(|normal| unpack_normal(normal).unwrap_or(Vec3::ZERO)).collect();
    let mesh = TriangleMesh::new(&positions, &normals, &triangles);
    if mesh.is_empty() { Err(none("no face has an area and all its corners in the file")) } else { Ok(mesh) }
}

#[cfg(test)]
mod tests {
    use scene::{Mirror, MirrorMesh};

    use super::*;

    fn of(path: &Path) -> Result<MirrorMesh> {
        match with_mesh(Shape::Mesh(path.display().to_string().into()))? {
            Shape::Mesh(mesh) => Ok(mesh),
            other => panic!("{other:?}"),
        }
    }

    fn reading(text: &str) -> Result<MirrorMesh> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        std::fs::write(&path, text).unwrap();
        of(&path)
    }

    const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
        property double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn a_mirror_gets_the_triangles_of_its_file() {
        let mesh = reading(&format!("{HEADER}5e5 0 7\n500002 0 7\n500002 2 7\n5e5 2 7\n4 0 1 2 3\n")).unwrap();
        assert_eq!(mesh.surface.triangles(), [[0, 1, 2], [0, 2, 3]]);
        // What has been read is not read again: the file is gone by now.
        let shape = with_mesh(Shape::Mesh(mesh)).unwrap();
        let chunks = Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Z, 2.0).sample(1000, 1);
        for (chunk, index) in chunks.iter().flat_map(|chunk| (0..chunk.len()).map(move |index| (chunk, index))) {
            let at = chunk.position(index);
            assert!(at.z.abs() < 1e-6 && at.truncate().abs().max_element() <= 2.0_f64.sqrt() + 1e-6, "{at}");
            assert_eq!(unpack_normal(chunk.normals.as_ref().unwrap()[index]), Some(Vec3::Z));
        }
        assert_eq!(chunks.iter().map(Chunk::len).sum::<usize>(), 1000);
    }

    #[test]
    fn what_is_no_mesh_is_named_with_the_reason() {
        let told = |text: &str| reading(text).unwrap_err().to_string();
        let flat = told(&format!("{HEADER}0 0 0\n1 0 0\n2 0 0\n3 0 0\n4 0 1 2 3\n"));
        assert!(flat.contains("mesh.ply") && flat.contains("no face has an area"), "{flat}");
        let points = HEADER.replace("element face 1\nproperty list uchar int vertex_indices\n", "");
        assert!(told(&format!("{points}0 0 0\n1 0 0\n0 1 0\n0 0 1\n")).contains("has no faces"));
        assert!(told(&format!("{HEADER}0 0 0\n1 0 0\n0 1 0\n0 0 1\n4 0 1 2 9\n")).contains("vertex 9 of 4"));
        let error = of(Path::new("gone.ply")).unwrap_err();
        assert!(error.is_usage() && error.to_string().contains("gone.ply"), "{error}");
    }

    #[test]
    fn a_header_that_claims_more_than_the_file_holds_gives_the_triangles_that_are_there() {
        let claim = HEADER.replace("element face 1\n", "element face 4000000000000\n");
        let mesh = reading(&format!("{claim}0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n")).unwrap();
        assert_eq!(mesh.surface.triangles(), [[0, 1, 2]]);
    }
}
