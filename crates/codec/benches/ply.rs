//! PLY readers beside their limits: a bare loop of positioned reads that decodes the same bytes on all cores, once for
//! binary rows of 15 bytes and once for text without exponents, and `ply-rs` on one core. Each drops every chunk.
//!
//! `GLINT_BENCH_POINTS` sets the number of points (2 million: 30 MB binary, 66 MB text).

#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed bench")]

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex};

use cloud::{CHUNK_POINTS, Progress};
use codec::{Bytes, Selection};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use ply_rs::parser::{Parser, Reader};
use ply_rs::ply::{PropertyAccess, PropertyAccessResult};
use rayon::prelude::*;

fn main() {
    LazyLock::force(&FILES);
    divan::main();
    // A static is never dropped.
    std::fs::remove_dir_all(FILES.folder.path()).unwrap();
}

fn points() -> usize {
    std::env::var("GLINT_BENCH_POINTS").ok().and_then(|count| count.parse().ok()).unwrap_or(2_000_000)
}

struct Files {
    folder: tempfile::TempDir,
    binary: PathBuf,
    text: PathBuf,
    /// The size in bytes of the header of either file.
    binary_start: u64,
    text_start: u64,
}

/// A terrain of centimetres over a kilometre, as in scanners' exports.
static FILES: LazyLock<Files> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let (binary, text) = (folder.path().join("binary.ply"), folder.path().join("text.ply"));
    let header = |format: &str| {
        let mut header = format!("ply\nformat {format} 1.0\nelement vertex {}\n", points());
        for name in ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"] {
            writeln!(header, "property {name}").unwrap();
        }
        header + "end_header\n"
    };
    let (binary_header, text_header) = (header("binary_little_endian"), header("ascii"));
    let mut binary_file = BufWriter::new(File::create(&binary).unwrap());
    let mut text_file = BufWriter::new(File::create(&text).unwrap());
    binary_file.write_all(binary_header.as_bytes()).unwrap();
    text_file.write_all(text_header.as_bytes()).unwrap();
    let mut state = 0x9e37_79b9_u32;
    for index in 0..points() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let x = (index % 100_000) as f32 * 0.01;
        let y = (state >> 12) as f32 * 0.001;
        let z = 120.0 + (x * 0.02).sin() * 15.0 + (y * 0.03).cos() * 9.0;
        let color = [(state >> 24) as u8, (z * 1.5) as u8, (state >> 8) as u8];
        let xyz = [x, y, z].map(|value| (value * 1000.0).round() / 1000.0);
        xyz.iter().for_each(|value| binary_file.write_all(&value.to_le_bytes()).unwrap());
        binary_file.write_all(&color).unwrap();
        let [x, y, z] = xyz;
        writeln!(text_file, "{x:.3} {y:.3} {z:.3} {} {} {}", color[0], color[1], color[2]).unwrap();
    }
    binary_file.flush().unwrap();
    text_file.flush().unwrap();
    let (binary_start, text_start) = (binary_header.len() as u64, text_header.len() as u64);
    Files { folder, binary, text, binary_start, text_start }
});

/// The columns of the bare loops.
type Columns = (Vec<[f32; 3]>, Vec<[u8; 4]>);

/// Reads with `glint`'s reader, opening included.
fn read(path: &Path) {
    let source = codec::open(path).unwrap();
    let selection = Selection { positions: true, colors: true, ..Selection::default() };
    let kept = Mutex::new(Vec::new());
    let summary = source.read(&selection, &Progress::default(), &|chunk| kept.lock().unwrap().push(chunk)).unwrap();
    assert_eq!(summary.points as usize, points());
    black_box(kept);
}

#[divan::bench]
fn binary_ours(bencher: Bencher) {
    let path = &FILES.binary;
    bencher.counter(ItemsCount::new(points())).bench(|| read(path));
}

#[divan::bench]
fn binary_bare(bencher: Bencher) {
    const STRIDE: usize = 15;
    bencher.counter(ItemsCount::new(points())).bench(|| {
        let file = Bytes::open(&FILES.binary).unwrap();
        let kept = Mutex::new(Vec::new());
        (0..points().div_ceil(CHUNK_POINTS)).into_par_iter().for_each(|chunk| {
            let rows = CHUNK_POINTS.min(points() - chunk * CHUNK_POINTS);
            let mut bytes = vec![0; rows * STRIDE];
            let offset = FILES.binary_start + (chunk * CHUNK_POINTS * STRIDE) as u64;
            file.read_at(offset, &mut bytes).unwrap();
            let (mut positions, mut colors) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
            for row in bytes.chunks_exact(STRIDE) {
                let float = |at: usize| f32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]]);
                positions.push([float(0), float(4), float(8)]);
                colors.push([row[12], row[13], row[14], 255]);
            }
            kept.lock().unwrap().push((positions, colors));
        });
        black_box(kept);
    });
}

#[divan::bench]
fn text_ours(bencher: Bencher) {
    let path = &FILES.text;
    bencher.counter(ItemsCount::new(points())).bench(|| read(path));
}

/// Parses digits and a point, correct to an f32 rounding or two, in blocks of 2 MiB cut at line ends.
#[divan::bench]
fn text_bare(bencher: Bencher) {
    const BLOCK: u64 = 2 << 20;
    bencher.counter(ItemsCount::new(points())).bench(|| {
        let file = Bytes::open(&FILES.text).unwrap();
        let length = file.length();
        let kept = Mutex::new(Vec::new());
        (0..(length - FILES.text_start).div_ceil(BLOCK)).into_par_iter().for_each(|block| {
            let start = FILES.text_start + block * BLOCK;
            // A block owns the lines that begin in it: 256 bytes more hold the end of its last.
            let mut bytes = vec![0; ((BLOCK + 256).min(length + 1 - start)) as usize];
            file.read_at(start - 1, &mut bytes).unwrap();
            let mut at = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
            let (mut positions, mut colors): Columns = Default::default();
            while at <= BLOCK as usize && at < bytes.len() {
                positions.push([number(&bytes, &mut at), number(&bytes, &mut at), number(&bytes, &mut at)]);
                let mut byte = || number(&bytes, &mut at) as u8;
                colors.push([byte(), byte(), byte(), 255]);
            }
            kept.lock().unwrap().push((positions, colors));
        });
        let read: usize = kept.lock().unwrap().iter().map(|(positions, _)| positions.len()).sum();
        assert_eq!(read, points());
        black_box(kept);
    });
}

#[inline]
fn number(bytes: &[u8], at: &mut usize) -> f32 {
    const POWERS: [f32; 8] = [1e0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
    let negative = bytes[*at] == b'-';
    *at += usize::from(negative);
    let (mut value, mut decimals, mut counts) = (0_u32, 0_usize, 0);
    loop {
        let byte = bytes[*at];
        *at += 1;
        match byte {
            b'0'..=b'9' => {
                value = value * 10 + u32::from(byte - b'0');
                decimals += counts;
            }
            b'.' => counts = 1,
            _ => break,
        }
    }
    let value = value as f32 * POWERS[decimals];
    if negative { -value } else { value }
}

/// Typed access of `ply-rs`, its fastest.
#[derive(Default)]
struct Vertex {
    position: [f32; 3],
    color: [u8; 3],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        match name {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        match name {
            "red" => self.color[0] = value,
            "green" => self.color[1] = value,
            "blue" => self.color[2] = value,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

fn read_by_ply_rs(path: &Path) {
    let mut reader = Reader::new(BufReader::with_capacity(1 << 20, File::open(path).unwrap()));
    let parser = Parser::<Vertex>::new();
    let header = parser.read_header(&mut reader).unwrap();
    let vertices = parser.read_payload_for_element(&mut reader, &header.elements["vertex"], &header).unwrap();
    assert_eq!(vertices.len(), points());
    black_box(vertices.iter().map(|vertex| vertex.position[0] + f32::from(vertex.color[0])).sum::<f32>());
}

#[divan::bench]
fn binary_ply_rs(bencher: Bencher) {
    bencher.counter(ItemsCount::new(points())).bench(|| read_by_ply_rs(&FILES.binary));
}

#[divan::bench]
fn text_ply_rs(bencher: Bencher) {
    bencher.counter(ItemsCount::new(points())).bench(|| read_by_ply_rs(&FILES.text));
}
