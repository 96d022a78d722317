//! Writes an airborne scan of any size: `cargo run --release -p stream --example make_scan -- 100000000 scan.las`.
//!
//! Five overlapping flight strips of zig-zag scan lines over fractal terrain with blocks of a town (flat and gabled
//! roofs, facades, streets) and trees with two returns; 10 points a square metre, LAS 1.4, point format 7, millimetres,
//! UTM. The same count and seed give the same file. Memory does not depend on the count. A file whose name ends in
//! `.laz` is compressed.

use std::fs::File;
use std::io::{BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use cloud::hash;
use laz::{LazVlr, LazVlrBuilder, ParLasZipCompressor};
use rayon::prelude::*;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The size of a record of point format 7 in bytes.
const RECORD: usize = 36;
/// The offset of the point format in a header; its highest bit says that points are compressed.
const POINT_FORMAT: usize = 104;
/// The step of the grid in metres.
const SCALE: f64 = 0.001;
const OFFSET: [f64; 3] = [431_000.0, 5_412_000.0, 0.0];
const STRIPS: u64 = 5;
/// Points per square metre where strips overlap as they do on average.
const DENSITY: f64 = 10.0;
/// The width of all strips divided by the width of the area.
const OVERLAP: f64 = 1.25;
/// The tangent of the largest scan angle, 20 degrees.
const STEEPEST: f64 = 0.364;
/// The number of points made before they are written.
const BATCH: usize = 1 << 20;
const WKT: &str = "PROJCS[\"WGS 84 / UTM zone 32N\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",9],PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32632\"]]";

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.as_slice() {
        [points, path] => make(Path::new(path), points.parse()?, 1),
        [points, path, seed] => make(Path::new(path), points.parse()?, seed.parse()?),
        _ => Err("usage: make_scan POINTS OUT.las|OUT.laz [SEED]".into()),
    }
}

/// Writes under a temporary name beside `path` and renames the file when it is complete.
fn make(path: &Path, points: u64, seed: u64) -> Result<()> {
    let mut name = path.file_name().ok_or("no file name")?.to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let compressed = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("laz"));
    let scan = Scan::new(points, seed);
    let vlr = compressed
        .then(|| LazVlrBuilder::default().with_point_format(7, 0).map(|builder| builder.build()))
        .transpose()?;
    let header = header(vlr.as_ref())?;
    let mut file = BufWriter::with_capacity(1 << 20, File::create(&part)?);
    file.write_all(&header)?;
    let mut summary = Summary::default();
    let file = match vlr {
        None => {
            scan.records(&mut |records| {
                summary.add(records);
                Ok(file.write_all(records)?)
            })?;
            file.into_inner()?
        }
        Some(vlr) => {
            let mut compressor = ParLasZipCompressor::new(file, vlr)?;
            scan.records(&mut |records| {
                summary.add(records);
                Ok(compressor.compress_many(records)?)
            })?;
            compressor.done()?;
            compressor.into_inner().into_inner()?
        }
    };
    summary.write(file, &header)?;
    Ok(std::fs::rename(part, PathBuf::from(path))?)
}

/// The header and its records, with empty bounds and counts.
fn header(laz: Option<&LazVlr>) -> Result<Vec<u8>> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(7)?;
    builder.has_wkt_crs = true;
    builder.generating_software = "glint make_scan".into();
    let transform = |offset| las::Transform { scale: SCALE, offset };
    builder.transforms = las::Vector { x: transform(OFFSET[0]), y: transform(OFFSET[1]), z: transform(OFFSET[2]) };
    let mut record = |user_id: &str, record_id, data| {
        let vlr = las::Vlr { user_id: user_id.into(), record_id, description: String::new(), data };
        builder.vlrs.push(vlr);
    };
    record("LASF_Projection", 2112, WKT.as_bytes().to_vec());
    if let Some(laz) = laz {
        let mut data = Vec::new();
        laz.write_to(&mut data)?;
        record(LazVlr::USER_ID, LazVlr::RECORD_ID, data);
    }
    let mut bytes = Vec::new();
    builder.into_header()?.write_to(&mut bytes)?;
    // `las` without its own compressor does not mark the header's points as compressed.
    bytes[POINT_FORMAT] |= u8::from(laz.is_some()) << 7;
    Ok(bytes)
}

/// The values of a header that depend on the points.
#[derive(Default)]
struct Summary {
    /// The lower and upper corner, in steps of the grid; `None` before the first point.
    bounds: Option<([i32; 3], [i32; 3])>,
    by_return: [u64; 2],
}

impl Summary {
    fn of(records: &[u8]) -> Self {
        let mut summary = Self::default();
        for record in records.chunks_exact(RECORD) {
            let place: [i32; 3] = std::array::from_fn(|axis| {
                i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().expect("four bytes"))
            });
            summary.bounds = Some(union(summary.bounds.unwrap_or((place, place)), (place, place)));
            summary.by_return[usize::from(record[14] & 15) - 1] += 1;
        }
        summary
    }

    fn join(self, other: Self) -> Self {
        let bounds = match (self.bounds, other.bounds) {
            (Some(a), Some(b)) => Some(union(a, b)),
            (a, b) => a.or(b),
        };
        Self { bounds, by_return: std::array::from_fn(|i| self.by_return[i] + other.by_return[i]) }
    }

    fn add(&mut self, records: &[u8]) {
        let new = records.par_chunks(RECORD * 65_536).map(Self::of).reduce(Self::default, Self::join);
        *self = std::mem::take(self).join(new);
    }

    /// Writes the header anew, with bounds and counts.
    fn write(&self, mut file: File, header: &[u8]) -> Result<()> {
        let mut raw = las::raw::Header::read_from(header)?;
        let (low, high) = self.bounds.unwrap_or_default();
        let world = |place: [i32; 3], axis: usize| f64::from(place[axis]) * SCALE + OFFSET[axis];
        (raw.min_x, raw.min_y, raw.min_z) = (world(low, 0), world(low, 1), world(low, 2));
        (raw.max_x, raw.max_y, raw.max_z) = (world(high, 0), world(high, 1), world(high, 2));
        let mut large_file = raw.large_file.unwrap_or_default();
        large_file.number_of_point_records = self.by_return.iter().sum();
        large_file.number_of_points_by_return[..2].copy_from_slice(&self.by_return);
        raw.large_file = Some(large_file);
        file.seek(SeekFrom::Start(0))?;
        raw.write_to(&mut file)?;
        Ok(())
    }
}

fn union((low, high): ([i32; 3], [i32; 3]), (l, h): ([i32; 3], [i32; 3])) -> ([i32; 3], [i32; 3]) {
    (std::array::from_fn(|i| low[i].min(l[i])), std::array::from_fn(|i| high[i].max(h[i])))
}

/// The scanner's path, pulse by pulse.
struct Scan {
    points: u64,
    /// The side of the scanned square in metres.
    size: f64,
    /// The distance between pulses along and across a line in metres.
    step: f64,
    strip_width: f64,
    landscape: Landscape,
}

impl Scan {
    fn new(points: u64, seed: u64) -> Self {
        let size = (points.max(1) as f64 / DENSITY).sqrt();
        let strip_width = OVERLAP * size / STRIPS as f64;
        let step = (OVERLAP / DENSITY).sqrt();
        let mut scan = Self { points, size, step, strip_width, landscape: Landscape::new(seed) };
        // Trees give two returns: a sample of the lines tells how much further apart pulses must be.
        let lines = scan.lines();
        let sample: Vec<(u64, u64)> = (0..lines.min(200)).map(|i| (i % STRIPS, i * lines / lines.min(200))).collect();
        let records: usize = sample.par_iter().map(|(strip, line)| scan.line(*strip, *line).len() / RECORD).sum();
        scan.step *= (records as f64 / (sample.len() as f64 * scan.pulses() as f64)).sqrt().max(1.0);
        scan
    }

    /// The number of lines of a strip.
    fn lines(&self) -> u64 {
        ((self.size / self.step) as u64).max(1)
    }

    /// The number of pulses of a line.
    fn pulses(&self) -> u64 {
        ((self.strip_width / self.step) as u64).max(1)
    }

    /// Passes all records to `write` in the order of flight. The last strip is cut or prolonged so that the count is
    /// reached.
    fn records(&self, write: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut left = self.points as usize * RECORD;
        let at_once = (BATCH as u64 / self.pulses()).max(1);
        for strip in 0..STRIPS {
            let lines = if strip + 1 == STRIPS { u64::MAX } else { self.lines() };
            let mut first = 0;
            while first < lines && left > 0 {
                let end = lines.min(first.saturating_add(at_once));
                let made: Vec<Vec<u8>> = (first..end).into_par_iter().map(|line| self.line(strip, line)).collect();
                let mut records = made.concat();
                records.truncate(left);
                left -= records.len();
                write(&records)?;
                first = end;
            }
        }
        Ok(())
    }

    /// The records of one scan line.
    fn line(&self, strip: u64, line: u64) -> Vec<u8> {
        let pulses = self.pulses();
        let middle = self.size * (strip as f64 + 0.5) / STRIPS as f64;
        let mut records = Vec::with_capacity(pulses as usize * RECORD * 5 / 4);
        for pulse in 0..pulses {
            let noise = hash(hash(self.landscape.seed ^ (strip << 56) ^ line) ^ pulse);
            let share = (pulse as f64 + 0.3 * part(noise, 0)) / pulses as f64;
            // Zig-zag: lines go to and fro while the aircraft flies on.
            let across = if line.is_multiple_of(2) { share } else { 1.0 - share } - 0.5;
            let x = middle + across * self.strip_width;
            let y = (line as f64 + share + 0.3 * part(noise, 1)) * self.step;
            let slope = 2.0 * across * STEEPEST;
            let echoes = self.landscape.echoes(x, y, slope, noise);
            let count = echoes.iter().flatten().count() as u8;
            for (number, echo) in echoes.iter().flatten().enumerate() {
                let returns = (number as u8 + 1) | count << 4;
                let time = 3.0e8 + (line as f64 + share) * 0.01 + strip as f64 * 1e6;
                let direction = u8::from(line.is_multiple_of(2)) << 6;
                push(&mut records, echo, [returns, direction], slope, strip as u16 + 1, time);
            }
        }
        records
    }
}

/// One return of a pulse.
struct Echo {
    /// Metres from the area's corner.
    place: [f64; 3],
    /// The class of the LAS specification.
    class: u8,
    intensity: u16,
    color: [u16; 3],
}

fn push(records: &mut Vec<u8>, echo: &Echo, [returns, flags]: [u8; 2], slope: f64, strip: u16, time: f64) {
    echo.place.iter().for_each(|metres| records.extend(((metres / SCALE).round() as i32).to_le_bytes()));
    records.extend(echo.intensity.to_le_bytes());
    records.extend([returns, flags, echo.class, 0]);
    records.extend(((slope.atan().to_degrees() / 0.006) as i16).to_le_bytes());
    records.extend(strip.to_le_bytes());
    records.extend(time.to_le_bytes());
    echo.color.iter().for_each(|channel| records.extend(channel.to_le_bytes()));
}

/// One of four independent numbers in -1 .. 1.
fn part(noise: u64, which: u32) -> f64 {
    f64::from((noise >> (16 * which)) as u16) / 32_768.0 - 1.0
}

/// The number of lattice points of a noise table along an axis.
const TABLE: usize = 256;
/// The distance between streets in metres.
const BLOCK: f64 = 100.0;
const STREET: f64 = 10.0;
/// The width of a building's plot in metres.
const PLOT: f64 = 22.5;
/// The distance between trees in metres.
const TREE: f64 = 7.0;

/// Terrain, town and trees, as functions of the place and the seed.
struct Landscape {
    seed: u64,
    table: Vec<f32>,
}

/// A building that stands at a place.
struct Building {
    /// The height of the roof at the place.
    height: f64,
    /// The x coordinates of the plot's walls.
    walls: [f64; 2],
    hue: u64,
}

impl Landscape {
    fn new(seed: u64) -> Self {
        let value = |i: u64| (hash(hash(seed) ^ i) >> 40) as f32 / (1 << 23) as f32 - 1.0;
        Self { seed, table: (0..(TABLE * TABLE) as u64).map(value).collect() }
    }

    /// Smooth noise in -1 ..= 1 that varies over a length of 1.
    fn noise(&self, x: f64, y: f64) -> f64 {
        let (floor_x, floor_y) = (x.floor(), y.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (smooth(x - floor_x), smooth(y - floor_y));
        let wrap = |floor: f64| (floor as i64).rem_euclid(TABLE as i64) as usize;
        let (column, row) = (wrap(floor_x), wrap(floor_y));
        let (next, below) = ((column + 1) % TABLE, (row + 1) % TABLE);
        let at = |row: usize, column: usize| f64::from(self.table[row * TABLE + column]);
        let top = at(row, column) * (1.0 - u) + at(row, next) * u;
        let bottom = at(below, column) * (1.0 - u) + at(below, next) * u;
        top * (1.0 - v) + bottom * v
    }

    /// The height of the ground in metres.
    fn ground(&self, x: f64, y: f64) -> f64 {
        let (mut height, mut length) = (300.0, 2000.0);
        for octave in 0..8 {
            let shift = f64::from(octave) * 17.3;
            height += 0.04 * length * self.noise(x / length + shift, y / length - shift);
            length *= 0.5;
        }
        height
    }

    /// A pseudorandom number for a cell.
    fn cell(&self, kind: u64, column: i64, row: i64) -> u64 {
        hash(hash(self.seed ^ (kind << 60) ^ column as u64) ^ row as u64)
    }

    fn is_town(&self, x: f64, y: f64) -> bool {
        let (column, row) = ((x / BLOCK).floor(), (y / BLOCK).floor());
        self.noise(column / 9.0 + 40.7, row / 9.0 + 3.1) > 0.2
    }

    fn is_street(x: f64, y: f64) -> bool {
        x.rem_euclid(BLOCK) < STREET || y.rem_euclid(BLOCK) < STREET
    }

    /// The building at a place in a town.
    fn building(&self, x: f64, y: f64) -> Option<Building> {
        if Self::is_street(x, y) {
            return None;
        }
        let plot = |at: f64| {
            let (block, inside) = ((at / BLOCK).floor(), at.rem_euclid(BLOCK) - STREET);
            let number = (inside / PLOT).floor();
            (block as i64 * 8 + number as i64, block * BLOCK + STREET + (number + 0.5) * PLOT)
        };
        let ((column, middle_x), (row, middle_y)) = (plot(x), plot(y));
        let random = self.cell(1, column, row);
        let half = |which| 6.5 + 2.0 * part(random, which);
        let (half_x, half_y) = (half(0), half(1));
        let (aside_x, aside_y) = ((x - middle_x).abs(), (y - middle_y).abs());
        if random.is_multiple_of(5) || aside_x > half_x || aside_y > half_y {
            return None;
        }
        let eaves = 8.0 + 4.0 * part(random, 2);
        let roof = match random % 3 {
            0 => 0.0,
            1 => (half_x - aside_x) * 0.7,
            _ => (half_y - aside_y) * 0.7,
        };
        let height = self.ground(middle_x, middle_y) + eaves + roof;
        Some(Building { height, walls: [middle_x - half_x, middle_x + half_x], hue: random >> 8 })
    }

    /// The returns of a pulse that would meet level ground at (x, y) and whose slope is `slope` metres of x per metre
    /// of height, away from the strip's middle.
    fn echoes(&self, x: f64, y: f64, slope: f64, noise: u64) -> [Option<Echo>; 2] {
        let ground = self.ground(x, y) + 0.02 * part(noise, 2);
        if self.is_town(x, y) {
            return [Some(self.town_echo(x, y, ground, slope, noise)), None];
        }
        let (column, row) = ((x / TREE).floor(), (y / TREE).floor());
        let wooded = 0.7 * self.noise(x / 300.0 + 9.4, y / 300.0) + 0.7 * self.noise(x / 40.0, y / 40.0 + 5.5);
        let random = self.cell(2, column as i64, row as i64);
        if wooded > 0.0 && !random.is_multiple_of(6) {
            let radius = 2.6 + 0.8 * part(random, 0);
            let aside_x = x - (column + 0.5 + 0.1 * part(random, 1)) * TREE;
            let aside_y = y - (row + 0.5 + 0.1 * part(random, 2)) * TREE;
            let inside = 1.0 - (aside_x * aside_x + aside_y * aside_y) / (radius * radius);
            if inside > 0.0 {
                let height = (12.0 + 6.0 * part(random, 3)) * (0.45 + 0.55 * inside.sqrt()) + 0.3 * part(noise, 3);
                let top = self.echo([x - slope * height, y, ground + height], 5, [52, 92, 40], noise);
                let through = noise.is_multiple_of(2);
                return [Some(top), through.then(|| self.echo([x, y, ground], 2, [96, 84, 60], noise >> 3))];
            }
        }
        let grass = [110.0 + 50.0 * wooded, 130.0, 70.0 - 20.0 * wooded].map(|channel: f64| channel as u8);
        [Some(self.echo([x, y, ground], 2, grass, noise)), None]
    }

    fn town_echo(&self, x: f64, y: f64, ground: f64, slope: f64, noise: u64) -> Echo {
        // Goes down the beam: it meets the first building that is higher than the beam.
        for step in (0..8).rev() {
            let at = x - slope * f64::from(step) * 2.5;
            let Some(building) = self.building(at, y) else { continue };
            let roof = x - slope * (building.height - ground);
            if building.walls[0] <= roof && roof <= building.walls[1] {
                let color = [150 + (building.hue % 60) as u8, 80 + (building.hue % 41) as u8, 70];
                return self.echo([roof, y, building.height + 0.02 * part(noise, 3)], 6, color, noise);
            }
            let wall = building.walls[usize::from(slope > 0.0)];
            let height = (x - wall) / slope;
            if height.is_finite() && height > 0.0 && ground + height < building.height {
                return self.echo([wall + 0.02 * part(noise, 3), y, ground + height], 6, [190, 180, 165], noise);
            }
        }
        let (class, color) = if Self::is_street(x, y) { (11, [90, 90, 95]) } else { (2, [105, 120, 75]) };
        self.echo([x, y, ground], class, color, noise)
    }

    fn echo(&self, place: [f64; 3], class: u8, color: [u8; 3], noise: u64) -> Echo {
        // As coarse as a scanner's: values that compress badly would make the file twice as large.
        let shade = 28 + (noise >> 62) as u16;
        let brightness = color.iter().map(|channel| u16::from(*channel)).sum::<u16>();
        let intensity = (brightness / 8 + (noise >> 60) as u16) * 256;
        Echo { place, class, intensity, color: color.map(|channel| u16::from(channel) * shade / 32 * 257) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The header and all chunks, in the order of the file.
    fn read(path: &Path) -> (codec::Info, Vec<cloud::Chunk>) {
        let source = codec::open(path).unwrap();
        let chunks = std::sync::Mutex::new(Vec::new());
        let selection = codec::Selection { positions: true, colors: true, ..Default::default() };
        source.read(&selection, &cloud::Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
        let mut chunks = chunks.into_inner().unwrap();
        chunks.sort_by_key(|chunk| chunk.first_point);
        (source.info().clone(), chunks)
    }

    #[test]
    fn a_scan_has_the_points_asked_for_and_a_header_that_fits_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scan.las");
        make(&path, 100_003, 1).unwrap();
        let mut reader = las::Reader::from_path(&path).unwrap();
        let bounds = reader.header().bounds();
        assert_eq!(reader.header().number_of_points(), 100_003);
        let points = reader.read_all().unwrap();
        let points: Vec<las::Point> = points.points().collect::<std::result::Result<_, _>>().unwrap();
        assert_eq!(points.len(), 100_003);
        let reached = |pick: fn(&las::Point) -> f64| {
            points.iter().map(pick).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)))
        };
        assert_eq!(reached(|point| point.x), (bounds.min.x, bounds.max.x));
        assert_eq!(reached(|point| point.y), (bounds.min.y, bounds.max.y));
        assert_eq!(reached(|point| point.z), (bounds.min.z, bounds.max.z));
        let seconds = points.iter().filter(|point| point.return_number == 2).count() as u64;
        assert_eq!(reader.header().number_of_points_by_return(2), Some(seconds));
        let area = (bounds.max.x - bounds.min.x) * (bounds.max.y - bounds.min.y);
        assert!((area / 10_000.3 - 1.0).abs() < 0.3, "{area} square metres");
    }

    #[test]
    fn a_compressed_scan_is_the_same_scan_and_another_seed_another() {
        let folder = tempfile::tempdir().unwrap();
        let [plain, packed, other] = ["a.las", "b.laz", "c.las"].map(|name| folder.path().join(name));
        make(&plain, 60_000, 7).unwrap();
        make(&packed, 60_000, 7).unwrap();
        make(&other, 60_000, 8).unwrap();
        let ((info, plain), (packed_info, packed), (_, other)) = (read(&plain), read(&packed), read(&other));
        assert_eq!((info.format, packed_info.format), (codec::Format::Las, codec::Format::Laz));
        assert_eq!((info.points, info.bounds), (packed_info.points, packed_info.bounds));
        let world = |chunks: &[cloud::Chunk]| -> Vec<glam::DVec3> {
            chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|i| chunk.position(i))).collect()
        };
        let colors = |chunks: &[cloud::Chunk]| -> Vec<[u8; 4]> {
            chunks.iter().flat_map(|chunk| chunk.colors.as_ref().unwrap().to_vec()).collect()
        };
        let apart = world(&plain).iter().zip(world(&packed)).map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
        assert!(apart < 1e-3, "{apart}");
        assert_eq!(colors(&plain), colors(&packed));
        assert_ne!(colors(&plain), colors(&other));
    }
}
