//! LAS files made up for tests: point format 3, a millimetre grid.
#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "a file that cannot be made up is a failed test")]

use std::path::Path;

use cloud::Random;

#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    pub at: [i32; 3],
    pub intensity: u16,
    pub class: u8,
    pub color: [u16; 3],
}

pub const SCALE: f64 = 0.001;
pub const OFFSET: [f64; 3] = [600_000.0, 5_000_000.0, 100.0];

/// A hilly square kilometre.
pub fn terrain(count: usize) -> Vec<Point> {
    let mut noise = Random(3);
    let mut coordinate = || noise.below(1_000_000) as i32;
    let height = |x: i32, y: i32| {
        ((f64::from(x) * 3e-5).sin() * 20_000.0 + (f64::from(y) * 5e-5).cos() * 9_000.0) as i32 + 40_000
    };
    let point = |index: usize| {
        let (x, y) = (coordinate(), coordinate());
        Point { at: [x, y, height(x, y)], intensity: index as u16, class: (index % 7) as u8, color: [index as u16; 3] }
    };
    (0..count).map(point).collect()
}

/// The time of a point, which no index keeps unless it is asked to.
pub fn gps_time(point: &Point) -> f64 {
    f64::from(point.intensity) * 0.25
}

/// Writes LAS 1.2 with a truthful header.
pub fn write_las(path: &Path, points: &[Point]) {
    write_las_with(path, points, SCALE, OFFSET, |_, _| ());
}

/// Writes LAS with another grid and a header that may say anything: the closure gets the least and greatest
/// coordinates.
pub fn write_las_with(
    path: &Path,
    points: &[Point],
    scale: f64,
    offset: [f64; 3],
    lie: impl Fn(&mut [f64; 3], &mut [f64; 3]),
) {
    let axis = |axis: usize| points.iter().map(move |point| f64::from(point.at[axis]) * scale + offset[axis]);
    let mut least = [0, 1, 2].map(|a| axis(a).fold(f64::INFINITY, f64::min));
    let mut greatest = [0, 1, 2].map(|a| axis(a).fold(f64::NEG_INFINITY, f64::max));
    lie(&mut least, &mut greatest);
    let mut bytes = vec![0; 227];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, b"LASF");
    put(24, &[1, 2]);
    put(94, &227_u16.to_le_bytes());
    put(96, &227_u32.to_le_bytes());
    put(104, &[3]);
    put(105, &34_u16.to_le_bytes());
    put(107, &(points.len() as u32).to_le_bytes());
    for a in 0..3 {
        put(131 + a * 8, &scale.to_le_bytes());
        put(155 + a * 8, &offset[a].to_le_bytes());
        put(179 + a * 16, &greatest[a].to_le_bytes());
        put(187 + a * 16, &least[a].to_le_bytes());
    }
    for point in points {
        point.at.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.extend(point.intensity.to_le_bytes());
        bytes.extend([0b0000_1001, point.class, 0, 0, 0, 0]);
        bytes.extend(gps_time(point).to_le_bytes());
        point.color.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}
