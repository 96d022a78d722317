//! Catalogues of tiles (VPC, virtual point clouds): STAC item collections, as QGIS, PDAL and `glint index --catalogue` write
//! them. Each item has a box, a number of points, and a reference to a file or an address.

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::io::Write as _;
use std::path::{Component, Path, PathBuf};

use cloud::{Bounds, ColumnType};
use glam::DVec3;
use serde::de::{Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::{Value, json};

use crate::address::{Address, decoded, is_address, last_part};
use crate::brief;
use crate::bytes::Bytes;
use crate::info::{Info, are_other_systems};
use crate::las::systems;
use crate::units::globe::Globe;
use crate::units::wkt;
use crate::{Error, Result, las};

/// The longest catalogue, and the most tiles.
const MOST_BYTES: u64 = 256 << 20;
const MOST_TILES: usize = 100_000;

/// A tile as a catalogue describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub path: PathBuf,
    /// The number of points, if it is given.
    pub points: Option<u64>,
    /// The box of its points in the coordinates of the file, if it is given and believable.
    pub bounds: Option<Bounds>,
    /// Whether further items name the same file.
    pub is_repeated: bool,
}

#[derive(Deserialize)]
struct Collection {
    #[serde(rename = "type")]
    kind: String,
    features: Items,
}

/// The items of a collection: at most as many as a catalogue may have tiles, each with no more than is used of it.
struct Items(Vec<Item>);

#[derive(Deserialize)]
struct Item {
    #[serde(default)]
    properties: Properties,
    #[serde(default)]
    assets: Assets,
}

#[derive(Default, Deserialize)]
struct Properties {
    #[serde(rename = "pc:count", default)]
    count: Numbers,
    #[serde(rename = "proj:bbox", default)]
    bounds: Numbers,
}

/// The reference of the asset `data`, or else of the first asset.
#[derive(Default)]
struct Assets(Option<String>);

#[derive(Deserialize)]
struct Asset {
    href: Option<String>,
}

/// A number, or the first numbers of a list, one more than are used; none where something else stands.
#[derive(Default)]
struct Numbers(Vec<f64>);

const MOST_NUMBERS: usize = 7;

impl<'de> Deserialize<'de> for Items {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Items;

            fn expecting(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
                to.write_str("a list of items")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<Items, A::Error> {
                let mut items = Vec::new();
                while let Some(item) = list.next_element()? {
                    if items.len() == MOST_TILES {
                        return Err(A::Error::custom(format!("more than {MOST_TILES} tiles")));
                    }
                    items.push(item);
                }
                Ok(Items(items))
            }
        }
        from.deserialize_seq(Reader)
    }
}

impl<'de> Deserialize<'de> for Assets {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Assets;

            fn expecting(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
                to.write_str("assets by their names")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Assets, A::Error> {
                let mut found = None;
                while let Some((name, Asset { href })) = map.next_entry::<String, Asset>()? {
                    found = if name == "data" { href } else { found.or(href) };
                    if name == "data" {
                        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                    }
                }
                Ok(Assets(found))
            }
        }
        from.deserialize_map(Reader)
    }
}

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Numbers;

            fn expecting(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
                to.write_str("numbers")
            }

            fn visit_u64<E>(self, number: u64) -> std::result::Result<Numbers, E> {
                Ok(Numbers(vec![number as f64]))
            }

            fn visit_i64<E>(self, number: i64) -> std::result::Result<Numbers, E> {
                Ok(Numbers(vec![number as f64]))
            }

            fn visit_f64<E>(self, number: f64) -> std::result::Result<Numbers, E> {
                Ok(Numbers(vec![number]))
            }

            fn visit_bool<E>(self, _: bool) -> std::result::Result<Numbers, E> {
                Ok(Numbers::default())
            }

            fn visit_unit<E>(self) -> std::result::Result<Numbers, E> {
                Ok(Numbers::default())
            }

            fn visit_str<E>(self, _: &str) -> std::result::Result<Numbers, E> {
                Ok(Numbers::default())
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Numbers, A::Error> {
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Numbers::default())
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<Numbers, A::Error> {
                let mut numbers = Vec::new();
                while numbers.len() < MOST_NUMBERS
                    && let Some(number) = list.next_element::<Option<f64>>()?
                {
                    numbers.push(number.unwrap_or(f64::NAN));
                }
                while list.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Numbers(numbers))
            }
        }
        from.deserialize_any(Reader)
    }
}

/// Whether a file is a catalogue, by its start and its name.
pub fn is_catalogue(start: &[u8], path: &Path) -> bool {
    start.trim_ascii_start().starts_with(b"{") && last_part(path).to_ascii_lowercase().ends_with(".vpc")
}

/// The tiles of a catalogue, each once.
///
/// # Errors
/// If it cannot be read, or names what is no tile.
pub fn read(file: &Bytes) -> Result<Vec<Entry>> {
    let path = file.path();
    let fail = |place: String, problem: String| Error::malformed(path, place, problem);
    let text = file.all(MOST_BYTES)?;
    let told: Collection = serde_json::from_slice(&text)
        .map_err(|error| fail("catalogue".into(), format!("not a collection of items: {}", brief::message(&error))))?;
    if told.kind != "FeatureCollection" {
        let kind = brief::brief(&told.kind);
        return Err(fail("catalogue".into(), format!("a `{kind}`, expected a FeatureCollection")));
    }
    let references = told.features.0.iter().filter_map(|item| item.assets.0.as_deref());
    let has_escapes = !is_address(file.base()) && are_escaped(file.base(), references);
    let mut known = HashMap::new();
    let mut entries: Vec<Entry> = Vec::new();
    for (number, item) in told.features.0.into_iter().enumerate() {
        let place = format!("item {number}");
        let reference =
            item.assets.0.ok_or_else(|| fail(place.clone(), "no reference to a file (assets, data, href)".into()))?;
        let own = resolved(file.base(), &reference, has_escapes).map_err(|problem| fail(place, problem))?;
        let place = *known.entry(own.clone()).or_insert(entries.len());
        if let Some(entry) = entries.get_mut(place) {
            entry.is_repeated = true;
            continue;
        }
        let Properties { count, bounds: Numbers(ends) } = item.properties;
        // A number of points that is none is 0, which no tile is believed to have.
        let points = count.0.first().map(|count| *count as u64);
        entries.push(Entry { path: own, points, bounds: bounds(ends), is_repeated: false });
    }
    if entries.is_empty() {
        return Err(Error::unsuitable(path, "a catalogue without tiles"));
    }
    Ok(entries)
}

/// What is to be said of the files that several items of a catalogue name.
pub fn repeated(entries: &[Entry]) -> Option<String> {
    let mut repeated = entries.iter().filter(|entry| entry.is_repeated);
    let (first, more) = (last_part(&repeated.next()?.path), repeated.count());
    let more = if more == 0 { String::new() } else { format!(" and {more} other tiles") };
    Some(format!("the catalogue names {first}{more} more than once; each is shown once"))
}

/// A box of six numbers.
fn bounds(told: Vec<f64>) -> Option<Bounds> {
    let [x, y, z, far_x, far_y, far_z] = told.try_into().ok()?;
    let bounds = Bounds { min: DVec3::new(x, y, z), max: DVec3::new(far_x, far_y, far_z) };
    is_believable(&bounds).then_some(bounds)
}

/// The tiles of the catalogue at a path or address; `None` where another file is.
///
/// # Errors
/// Those of `open_scans`, before any tile is opened.
pub fn tiles_of(path: &Path) -> Result<Option<Vec<Entry>>> {
    if !is_catalogue(b"{", path) {
        return Ok(None);
    }
    let file = Bytes::open_small(path)?;
    let mut start = [0; 64];
    let count = file.read_at(0, &mut start).map_err(|error| Error::io(path, error))?;
    if is_catalogue(&start[..count], path) { read(&file).map(Some) } else { Ok(None) }
}

/// What the head of a COPC file says, as a catalogue would; `None` for all other files.
pub fn entry_of(path: &Path) -> Option<Entry> {
    /// The length of a header of LAS 1.4, and the offsets of the greatest and least x, y and z and of the number of points.
    const HEAD: usize = 375;
    const GREATEST: usize = 179;
    const POINTS: usize = 247;
    let file = Bytes::open(path).ok().filter(las::is_copc)?;
    let mut head = [0; HEAD];
    file.read_at(0, &mut head).ok().filter(|count| *count == HEAD)?;
    let eight = |at: usize| head[at..].first_chunk().copied().unwrap_or_default();
    let corner = |start: usize| DVec3::from([0, 16, 32].map(|axis| f64::from_le_bytes(eight(start + axis))));
    let bounds = Bounds { min: corner(GREATEST + 8), max: corner(GREATEST) };
    let points = Some(u64::from_le_bytes(eight(POINTS)));
    Some(Entry { path: path.to_owned(), points, bounds: is_believable(&bounds).then_some(bounds), is_repeated: false })
}

fn is_believable(bounds: &Bounds) -> bool {
    bounds.min.is_finite() && bounds.max.is_finite() && !bounds.is_empty()
}

/// The file on disk of a name in a catalogue.
fn own(catalogue: &Path, name: &str) -> PathBuf {
    catalogue.parent().unwrap_or(Path::new("")).join(name.strip_prefix("./").unwrap_or(name))
}

/// Whether the references of a catalogue on disk are parts of addresses, as STAC has them, beyond doubt: nothing stands there
/// that would be escaped, and taken so they are as many files as taken as they are, none of which is there only then.
fn are_escaped<'a>(catalogue: &Path, references: impl Iterator<Item = &'a str>) -> bool {
    let (mut plain_files, mut files) = (HashSet::new(), HashSet::new());
    for reference in references.filter(|reference| !is_address(Path::new(reference))) {
        let is_hex = |part: &str| part.len() >= 2 && part.bytes().take(2).all(|byte| byte.is_ascii_hexdigit());
        if reference.contains(['#', '?']) || !reference.split('%').skip(1).all(is_hex) {
            return false;
        }
        let plain = own(catalogue, reference);
        let file = decoded(reference).map_or_else(|| plain.clone(), |decoded| own(catalogue, &decoded));
        if file != plain && !file.exists() && plain.exists() {
            return false;
        }
        plain_files.insert(plain);
        files.insert(file);
    }
    plain_files.len() == files.len()
}

/// The file that a reference in a catalogue stands for, of which it may be certain that it `has_escapes` on disk.
fn resolved(catalogue: &Path, reference: &str, has_escapes: bool) -> std::result::Result<PathBuf, String> {
    if is_address(catalogue) {
        let base = Address::parse(&catalogue.to_string_lossy())?;
        let own = base.joined(reference).map_err(|problem| format!("`{}`: {problem}", brief::brief(reference)))?;
        return Ok(own.text().into());
    }
    if is_address(Path::new(reference)) {
        return Ok(reference.into());
    }
    let plain = own(catalogue, reference);
    // Many programs write names as they are.
    let decoded = decoded(reference).map(|decoded| own(catalogue, &decoded));
    Ok(decoded.filter(|decoded| has_escapes || (!plain.exists() && decoded.exists())).unwrap_or(plain))
}

/// What is written of a tile.
pub struct Tile<'a> {
    pub info: &'a Info,
    pub points: u64,
    pub bounds: Bounds,
}

/// Writes a catalogue of tiles. References are relative to its folder. Returns what is wrong with the tiles together.
///
/// # Errors
/// If a file of that name is there, or it cannot be written.
pub fn write_catalogue(tiles: &[Tile<'_>], output: &Path) -> Result<Vec<String>> {
    let unwritten = |error| Error::not_written(output, error);
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = folder.canonicalize().map_err(unwritten)?;
    let (mut ids, mut unplaced) = (HashSet::new(), 0);
    let mut items: Vec<Value> = Vec::new();
    for tile in tiles {
        let name = last_part(&tile.info.path);
        let stem = name.split('.').next().unwrap_or(&name).to_owned();
        let numbered = (2..=tiles.len()).map(|number| format!("{name} {number}"));
        let id = [stem, name.clone()].into_iter().chain(numbered).find(|id| !ids.contains(id)).unwrap_or_default();
        let globe = tile.info.epsg.and_then(Globe::of);
        let footprint = globe.and_then(|globe| footprint(&tile.bounds, |place| globe.degrees(place)));
        unplaced += usize::from(footprint.is_none());
        items.push(item(tile, &folder, &id, footprint));
        ids.insert(id);
    }
    let mut warnings = Vec::new();
    let mut systems: Vec<&str> = Vec::new();
    for system in tiles.iter().filter_map(|tile| tile.info.crs.as_deref()) {
        if systems.iter().all(|known| are_other_systems(known, system)) {
            systems.push(system);
        }
    }
    if systems.len() > 1 {
        let count = systems.len();
        warnings.push(format!("its tiles have {count} coordinate systems; coordinates are taken as they are"));
    }
    if unplaced > 0 {
        warnings.push(format!(
            "tiles without a coordinate system that can be placed on the globe: {unplaced} of {}; their boxes, which \
             other programs expect in degrees, are in their own coordinates",
            tiles.len()
        ));
    }
    let collection = json!({ "type": "FeatureCollection", "features": items });
    let mut text = serde_json::to_vec(&collection).map_err(|error| unwritten(error.into()))?;
    text.push(b'\n');
    let mut file = std::fs::File::create_new(output).map_err(unwritten)?;
    file.write_all(&text).map_err(unwritten)?;
    Ok(warnings)
}

/// The number of parts into which a side is cut to place it.
const SIDE_STEPS: u32 = 8;

/// The polygon and the box of a tile, as JSON.
type Footprint = (Value, Value);

/// The footprint of a box whose corners on the map are placed elsewhere; heights stay.
fn footprint(bounds: &Bounds, place: impl Fn([f64; 2]) -> Option<[f64; 2]>) -> Option<Footprint> {
    let Bounds { min, max } = *bounds;
    let corners = [[min.x, min.y], [min.x, max.y], [max.x, max.y], [max.x, min.y]];
    let places = corners.into_iter().map(&place).collect::<Option<Vec<_>>>()?;
    let mut reach = Bounds::EMPTY;
    // Sides may be bent.
    for step in 0..=SIDE_STEPS {
        let across = min.lerp(max, f64::from(step) / f64::from(SIDE_STEPS));
        for side in [[across.x, min.y], [across.x, max.y], [min.x, across.y], [max.x, across.y]] {
            let [x, y] = place(side)?;
            reach.include(DVec3::new(x, y, min.z));
        }
    }
    let heights = [min.z, min.z, max.z, max.z, min.z];
    let ring = places.iter().cycle().zip(heights).map(|([x, y], z)| json!([x, y, z]));
    let polygon = json!({ "type": "Polygon", "coordinates": [ring.collect::<Vec<Value>>()] });
    Some((polygon, json!([reach.min.x, reach.min.y, min.z, reach.max.x, reach.max.y, max.z])))
}

/// An item of a tile with its footprint on the globe, if that is known.
fn item(Tile { info, points, bounds }: &Tile<'_>, folder: &Path, id: &str, on_globe: Option<Footprint>) -> Value {
    let (own_polygon, own_box) = footprint(bounds, Some).unwrap_or_default();
    let (polygon, flat) = on_globe.unwrap_or_else(|| (own_polygon.clone(), own_box.clone()));
    let kind = |column_type: ColumnType| match column_type {
        ColumnType::F32 | ColumnType::F64 => "floating",
        ColumnType::I8 | ColumnType::I16 | ColumnType::I32 | ColumnType::I64 => "signed",
        _ => "unsigned",
    };
    let schema = info.properties.iter().map(|property| {
        json!({ "name": property.name, "size": property.column_type.size(), "type": kind(property.column_type) })
    });
    let mut item = json!({
        "type": "Feature",
        "stac_version": "1.0.0",
        "stac_extensions": [
            "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
            "https://stac-extensions.github.io/projection/v1.1.0/schema.json"
        ],
        "id": id,
        "geometry": polygon,
        "bbox": flat,
        "properties": {
            // The time of the survey is not in a file's head.
            "datetime": "0000-01-01T00:00:00Z",
            "pc:count": points,
            "pc:encoding": "?",
            "pc:type": "lidar",
            "pc:schemas": schema.collect::<Vec<Value>>(),
            "proj:bbox": own_box,
            "proj:geometry": own_polygon
        },
        "links": [],
        "assets": { "data": { "href": reference(&info.path, folder), "roles": ["data"] } }
    });
    let text = info.crs.as_deref().filter(|crs| wkt::is_text(crs));
    let of_code = || systems::text_of(info.epsg?.try_into().ok()?);
    if let Some(text) = text.or_else(of_code) {
        item["properties"]["proj:wkt2"] = text.into();
    }
    item
}

/// How a catalogue in `folder` names a file.
fn reference(path: &Path, folder: &Path) -> String {
    let Some(path) = path.canonicalize().ok().filter(|_| !is_address(path)) else {
        return path.to_string_lossy().into_owned();
    };
    let common = path.components().zip(folder.components()).take_while(|(own, other)| own == other).count();
    if common == 0 {
        return path.to_string_lossy().into_owned();
    }
    let up = folder.components().skip(common).map(|_| "..");
    let down: Vec<String> = path
        .components()
        .skip(common)
        .map(Component::as_os_str)
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    let parts: Vec<&str> = up.chain(down.iter().map(String::as_str)).collect();
    // What would end the name in an address, or begin an escape there. Other programs read the rest as it is.
    let path = parts.join("/").replace('%', "%25").replace('#', "%23").replace('?', "%3F");
    format!("./{path}")
}
