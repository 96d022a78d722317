//! One more point anywhere changes next to nothing of the picture that a cloud first shows, with the eye, the light and the
//! colours that the program chooses.

use tests::{Folder, test_data};

/// The positions of a room of 8 by 6 by 3 as a scanner sees it that stands in it: near points lie close together, far ones
/// apart.
fn scanned_room(points: u32) -> Vec<[f32; 3]> {
    let (eye, size) = ([2.9, 2.6, 1.55], [8.0, 6.0, 3.0]);
    let table = ([5.0, 2.0, 0.0], [6.4, 3.0, 0.75]);
    let point = |index: u32| {
        // Steps of the golden ratio and of the plastic number fill the sphere evenly.
        let [u, v] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract());
        let (z, turn) = (2.0 * u - 1.0, v * std::f64::consts::TAU);
        let across = (1.0 - z * z).sqrt();
        let direction = [across * turn.cos(), across * turn.sin(), z];
        let ends = |low: [f64; 3], high: [f64; 3]| {
            let along = |axis: usize, end: f64| (end - eye[axis]) / direction[axis];
            let near = (0..3).map(|axis| along(axis, low[axis]).min(along(axis, high[axis]))).fold(f64::MIN, f64::max);
            let far = (0..3).map(|axis| along(axis, low[axis]).max(along(axis, high[axis]))).fold(f64::MAX, f64::min);
            (near, far)
        };
        let (near, far) = ends(table.0, table.1);
        let wall = ends([0.0; 3], size).1;
        let distance = if near > 0.0 && near < far { near } else { wall };
        std::array::from_fn(|axis| (eye[axis] + direction[axis] * distance) as f32)
    };
    (0..points).map(point).collect()
}

fn ply(positions: &[[f32; 3]]) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n",
        positions.len()
    )
    .into_bytes();
    file.extend(positions.iter().flatten().flat_map(|value| value.to_le_bytes()));
    file
}

/// The red, green and blue of each pixel of the picture that a file first shows.
fn picture(folder: &Folder, file: &[u8]) -> Vec<u8> {
    folder.write("cloud.ply", file);
    let outcome = folder.glint(["render", "cloud.ply", "-o", "picture.png", "--size", "192x144"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    image::open(folder.path("picture.png")).expect("the picture").into_rgb8().into_raw()
}

/// Checks that at most a thousandth of the pixels differ by more than two levels.
fn check(picture: &[u8], other: &[u8], what: &str) {
    let pixels = picture.chunks_exact(3).zip(other.chunks_exact(3));
    let differing = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    assert!(differing * 1000 <= picture.len() / 3, "{what}: {differing} of {} pixels differ", picture.len() / 3);
}

/// A point far away in the direction in which a light of the sky may be.
fn far(sizes: f32) -> [f32; 3] {
    [0.6, -0.5, 0.62].map(|part| part * 8.0 * sizes)
}

#[test]
fn one_point_more_changes_at_most_a_thousandth_of_the_pixels_of_a_scanned_room() {
    let folder = Folder::new();
    let room = scanned_room(130_000);
    let before = picture(&folder, &ply(&room));
    assert!(before.iter().collect::<std::collections::HashSet<_>>().len() > 50, "nothing is to be seen");
    let near = room[room.len() / 3];
    let beside = [near[0] + 0.003, near[1], near[2]];
    for (place, what) in
        [(near, "a duplicate"), (beside, "3 mm"), (far(10.0), "10"), (far(100.0), "100"), (far(1000.0), "1000 sizes")]
    {
        let more: Vec<[f32; 3]> = room.iter().copied().chain([place]).collect();
        check(&picture(&folder, &ply(&more)), &before, what);
    }
    let first: Vec<[f32; 3]> = [beside].into_iter().chain(room).collect();
    check(&picture(&folder, &ply(&first)), &before, "a point before all others");
}

#[test]
fn one_point_more_changes_at_most_a_thousandth_of_the_pixels_of_a_scanned_office() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let file = std::fs::read(data.join("ply/indoor_office_tls_rgb_third_binary_le.ply")).expect("the office");
    let before = picture(&folder, &file);
    let (count, more) = ("element vertex 1078042", "element vertex 1078043");
    let place = file.windows(count.len()).position(|window| window == count.as_bytes()).expect("its count");
    let start = 11 + file.windows(11).position(|window| window == b"end_header\n").expect("its header");
    // Three floats and three bytes of colour.
    let point = |index: usize| &file[start + 15 * index..][..15];
    let with = |shift: [f32; 3], is_first: bool| {
        let mut record = point(359_347).to_vec();
        for (bytes, shift) in record.chunks_exact_mut(4).zip(shift) {
            let value = f32::from_le_bytes(bytes.try_into().expect("four bytes")) + shift;
            bytes.copy_from_slice(&value.to_le_bytes());
        }
        let mut head = file[..start].to_vec();
        head[place..place + count.len()].copy_from_slice(more.as_bytes());
        let [first, last]: [&[u8]; 2] = if is_first { [&record, &file[start..]] } else { [&file[start..], &record] };
        [&head, first, last].concat()
    };
    check(&picture(&folder, &with(far(100.0), false)), &before, "100 sizes");
    check(&picture(&folder, &with([0.003, 0.0, 0.0], true)), &before, "a point before all others");
}
