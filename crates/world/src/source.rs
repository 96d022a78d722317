//! Opens files of points, and decides which columns are read at once and which later.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use cloud::{
    Bounds, Chunk, Cloud, Column, Orientation, Placement, PointTest, Progress, RadiusRule, SurfelOptions,
    attributes_named,
};
use glam::DVec3;
use scene::{CloudSettings, MirrorPoints, Settings, SurfaceOrientation, SurfaceRadii, UpAxis, Visibility};
use stream::Pages;

use crate::apart::groups;
use crate::input::Input;

/// The number of points that are read to guess the kind of cloud.
const KIND_POINTS: u64 = 500_000;
/// The number of points of COPC and EPT that are read for that. They are shown from then on, since they may have to be
/// fetched from a server. A root has some tens of thousands of points from all over its cloud.
const NATIVE_KIND_POINTS: u64 = 100_000;

/// Opens the scans of a file, for reads whose decoders take at most `memory` bytes; the error says why nothing of it can be
/// shown.
pub fn open_file(path: &Path, memory: u64) -> Result<Vec<Arc<codec::Source>>, String> {
    open_placed(path, memory, |_| None)
}

/// Opens a file with its points moved. Indexes and what the cache keeps belong to files as they are, so only what reads
/// points and keeps nothing may ask for this.
pub fn open_placed(
    path: &Path,
    memory: u64,
    placement: impl Fn(&codec::Info) -> Option<Placement>,
) -> Result<Vec<Arc<codec::Source>>, String> {
    let sources = codec::open_scans(path, memory).map_err(|error| error.to_string())?;
    // A file that is empty and says so is no error.
    let is_lost = |source: &codec::Source| source.info().points == 0 && !source.info().warnings.is_empty();
    if sources.iter().all(is_lost) {
        let told = |source: &codec::Source| [source.info().lost.clone(), source.info().warnings.clone()].concat();
        let warnings: Vec<String> = sources.iter().flat_map(told).collect();
        let problem = param::few(warnings, "warnings").join("; ");
        return Err(format!("{}: no points can be read: {problem}", scene::shown(path)));
    }
    let placed = |source: codec::Source| match placement(source.info()) {
        Some(placement) => source.placed(placement),
        None => source,
    };
    Ok(sources.into_iter().map(|source| Arc::new(placed(source))).collect())
}

/// The warnings about a file, each with the file's name.
pub fn file_warnings(info: &codec::Info) -> impl Iterator<Item = String> + '_ {
    info.warnings.iter().map(|warning| format!("{}: {warning}", scene::shown(&info.path)))
}

/// What is wrong with tiles of catalogues, or with scans of a file, that cannot be opened, beside those that can be.
pub fn lost_tiles(sources: &[Arc<codec::Source>]) -> impl Iterator<Item = &String> {
    sources.iter().flat_map(|source| &source.info().lost)
}

/// What a person should know of the coordinate systems of files whose points are measured together: that units are mixed,
/// once for all files with the same ones, and that systems differ.
pub fn system_warnings<'a>(files: impl IntoIterator<Item = &'a codec::Info> + Clone) -> Vec<String> {
    let mut told = BTreeSet::new();
    let mixed = files.clone().into_iter().filter_map(|info| Some((info, info.units.warning()?)));
    let mixed = mixed.filter(|(_, warning)| told.insert(warning.clone()));
    let mut warnings: Vec<String> =
        mixed.map(|(info, warning)| format!("{}: {warning}", scene::shown(&info.path))).collect();
    warnings.append(&mut other_systems(files));
    warnings
}

/// Warns of files in another coordinate system, or other units, than the first one that names its system: their coordinates
/// are taken as they are.
pub fn other_systems<'a>(files: impl IntoIterator<Item = &'a codec::Info>) -> Vec<String> {
    let mut with_system = files.into_iter().filter(|info| info.crs.is_some());
    let Some(first) = with_system.next() else { return Vec::new() };
    let others = with_system.filter_map(|other| {
        let difference = other.system_difference(first)?;
        let [other, first] = [&other.path, &first.path].map(scene::shown);
        Some(format!("{other} has {difference} than {first}; coordinates are taken as they are"))
    });
    others.collect()
}

/// The names of the attributes that a scene's colours and filters, and its mirrors of points, ask for. `own` is what its
/// clouds have of their own.
pub fn asked_attributes<'a>(
    settings: &Settings,
    visibility: &Visibility,
    own: impl IntoIterator<Item = &'a CloudSettings>,
    mirrors: &[MirrorPoints],
) -> BTreeSet<String> {
    let colors = own.into_iter().map(|own| own.color_of(&settings.color)).chain([settings.color.clone()]);
    let of_colors = colors.filter_map(|color| color.asked_attribute().map(str::to_owned));
    let of_filters = visibility.filters.iter().map(|filter| filter.attribute.clone());
    let of_mirrors = mirrors.iter().filter_map(|mirror| mirror.points.attribute().map(str::to_owned));
    of_colors.chain(of_filters).chain(of_mirrors).collect()
}

/// Groups streamed files into clouds: if all of them are COPC, or scans of one file, one cloud each; else one cloud of all
/// that are near each other. The pages of COPC files also have the attributes `also`.
pub fn parts(
    sources: Vec<Arc<codec::Source>>,
    also: &BTreeSet<String>,
) -> Vec<(Vec<Arc<codec::Source>>, Option<Pages>)> {
    let native = |source: &Arc<codec::Source>| Pages::copc(source, also);
    if sources.len() > 1 && is_one_file(&sources) {
        return sources.into_iter().map(|source| (vec![source], None)).collect();
    }
    match sources.iter().map(native).collect::<Option<Vec<Pages>>>() {
        Some(native) => sources.into_iter().zip(native).map(|(source, pages)| (vec![source], Some(pages))).collect(),
        None => {
            let bounds: Vec<Bounds> =
                sources.iter().map(|source| source.info().bounds.unwrap_or(Bounds::EMPTY)).collect();
            let mut parts: BTreeMap<usize, Vec<Arc<codec::Source>>> = BTreeMap::new();
            for (group, source) in groups(&bounds).into_iter().zip(sources) {
                parts.entry(group).or_default().push(source);
            }
            parts.into_values().map(|sources| (sources, None)).collect()
        }
    }
}

/// What pictures call a cloud of an input: the path that it comes from, and its name. It has the points of `sources`;
/// `is_all` says whether the input has no others.
pub(crate) fn called(input: &Input, sources: &[Arc<codec::Source>], is_all: bool) -> (PathBuf, String) {
    let path = match (input, sources) {
        (Input::Tiles { folder, .. }, [_, _, ..]) => folder.clone(),
        // The tiles of a catalogue.
        (Input::File(path), several @ [_, _, ..]) if !is_one_file(several) => path.clone(),
        _ => sources.first().map(|source| source.info().path.clone()).unwrap_or_default(),
    };
    let name = match sources {
        [one] => one.info().name(),
        [first, more @ ..] if !is_all => {
            format!("{}: {} and {} more", file_name(&path), file_name(&first.info().path), more.len())
        }
        _ => file_name(&path),
    };
    (path, name)
}

/// Whether sources are all of one file.
pub(crate) fn is_one_file(sources: &[Arc<codec::Source>]) -> bool {
    sources.windows(2).all(|pair| pair[0].info().path == pair[1].info().path)
}

/// Reads all points of a file at once, with what most pictures need and these attributes, and what is to be said of the
/// read. Chunks are in file order.
///
/// # Errors
/// If nothing can be read.
pub fn read_cloud(
    source: &codec::Source,
    also: &[&str],
    settings: &Settings,
    progress: &Progress,
) -> codec::Result<(Cloud, codec::Summary)> {
    let info = source.info();
    let mut selection = selection(info, settings);
    let asked = attributes_named(&info.attributes, also.iter().copied());
    selection.attributes.iter_mut().zip(asked).for_each(|(is_read, is_asked)| *is_read |= is_asked);
    let chunks = Mutex::new(Vec::new());
    let emit = |chunk: Chunk| chunks.lock().unwrap_or_else(PoisonError::into_inner).push(chunk);
    let summary = source.read(&selection, progress, &emit)?;
    let mut chunks = chunks.into_inner().unwrap_or_else(PoisonError::into_inner);
    chunks.sort_by_key(|chunk| chunk.first_point);
    let (name, attributes) = (info.name(), info.attributes.clone());
    Ok((Cloud { name, attributes, grid: info.grid, chunks }, summary))
}

/// Reads one column of a file whose points are loaded, by `first_point` of the chunks to which the values belong.
///
/// # Errors
/// If the file has gone or changed.
pub fn read_column(
    source: &codec::Source,
    attribute: usize,
    progress: &Progress,
) -> codec::Result<BTreeMap<u64, Arc<Column>>> {
    let mut wanted = vec![false; attribute + 1];
    wanted[attribute] = true;
    let selection = codec::Selection { attributes: wanted, ..Default::default() };
    let columns = Mutex::new(BTreeMap::new());
    source.read(&selection, progress, &|mut chunk| {
        if let Some(column) = chunk.columns.get_mut(attribute).and_then(Option::take) {
            columns.lock().unwrap_or_else(PoisonError::into_inner).insert(chunk.first_point, column);
        }
    })?;
    Ok(columns.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// The values of a chunk's points in a column that was read after them; none if the file has changed since.
pub(crate) fn column_of(chunk: &Chunk, columns: &BTreeMap<u64, Arc<Column>>) -> Option<Arc<Column>> {
    if let Some(corners) = &chunk.corners {
        let parts: Vec<&Column> = columns.values().map(Arc::as_ref).collect();
        let all = Column::joined(&parts)?;
        let is_known = corners.iter().all(|corner| (*corner as usize) < all.len());
        return is_known.then(|| Arc::new(all.select(corners)));
    }
    columns.get(&chunk.first_point).filter(|column| column.len() == chunk.len()).cloned()
}

/// The axis that points up: that of the setting, or the one that fits the data.
pub(crate) fn up(fitting: DVec3, settings: &Settings) -> DVec3 {
    match settings.view.up {
        UpAxis::Auto => fitting,
        UpAxis::Y => DVec3::Y,
        UpAxis::Z => DVec3::Z,
    }
}

/// The axis that points up in a file.
pub fn up_of(info: &codec::Info, settings: &Settings) -> DVec3 {
    // Scanners and surveys have z up; tools that make meshes mostly have y up.
    let is_mesh = info.format == codec::Format::Ply && info.faces > 0;
    up(if is_mesh { DVec3::Y } else { DVec3::Z }, settings)
}

/// The options for estimating the normals and radii of these points, which a scanner at `scanner` measured if that is
/// known; what is known of the places that they were seen from decides `SurfelOptions::of_scan`.
pub fn options_for(chunks: &[Chunk], up: DVec3, scanner: Option<DVec3>, settings: &Settings) -> SurfelOptions {
    let of_scan = SurfelOptions::of_scan(chunks, up.as_vec3(), scanner);
    let center = || cloud::robust_bounds(chunks).center();
    let orientation = match settings.surface.orientation {
        SurfaceOrientation::Auto => of_scan.orientation,
        SurfaceOrientation::Up => Orientation::Up(up.as_vec3()),
        SurfaceOrientation::Inward => Orientation::Toward(center()),
        SurfaceOrientation::Outward => Orientation::AwayFrom(center()),
    };
    let radii = match settings.surface.radii {
        SurfaceRadii::Full => RadiusRule::Full,
        SurfaceRadii::Narrow => RadiusRule::Narrow,
        SurfaceRadii::Spread => RadiusRule::Spread,
    };
    let seen_from = of_scan.seen_from.filter(|_| settings.surface.carve);
    SurfelOptions { neighbours: settings.surface.neighbours as usize, orientation, radii, seen_from }
}

/// The radii of a cloud's points, one list for each chunk, for those that `test` shows as if there were no others.
/// `None` when cancelled.
pub fn radii_of_shown(
    cloud: &Cloud,
    up: DVec3,
    scanner: Option<DVec3>,
    settings: &Settings,
    test: &PointTest,
    progress: &Progress,
) -> Option<Vec<Arc<Vec<u16>>>> {
    cloud::radii_among(cloud, test, &options_for(&cloud.chunks, up, scanner, settings), progress)
}

/// Everything beside the points of a file that decides its normals and radii, in words that differ where one of them does.
pub(crate) fn estimate_description(up: DVec3, scanner: Option<DVec3>, settings: &Settings) -> String {
    // Normals and radii that are kept are those of clouds; points on meshes bring theirs.
    let scene::Surface { mesh_points: _, neighbours, orientation, radii, carve } = &settings.surface;
    let (estimator, up, scanner) = (cloud::ESTIMATOR, up.to_array(), scanner.map(|place| place.to_array()));
    format!(
        "estimator {estimator}, {neighbours} neighbours, {orientation:?}, {radii:?} radii, carve {carve}, up {up:?}, \
         scanner {scanner:?}"
    )
}

/// How the normals and radii of an index are estimated, from its coarse pages. Radii of what is streamed are not carved.
///
/// # Errors
/// If they cannot be read.
pub fn surfel_options(
    pages: &Pages,
    up: DVec3,
    scanner: Option<DVec3>,
    settings: &Settings,
) -> stream::Result<SurfelOptions> {
    let points = if pages.is_copc() { NATIVE_KIND_POINTS } else { KIND_POINTS };
    let options = options_for(&stream::coarsest(pages, points)?, up, scanner, settings);
    Ok(SurfelOptions { seen_from: None, ..options })
}

/// Where the scanner of several sources stood, if it stood at one place for all of them.
pub fn common_scanner(sources: &[Arc<codec::Source>]) -> Option<DVec3> {
    let place = sources.first()?.info().scanner()?;
    sources.iter().all(|source| source.info().scanner() == Some(place)).then_some(place)
}

/// The last part of a path, which is a cloud's name. The query of an address, which may be a key, is no part of it.
pub(crate) fn file_name(path: &Path) -> String {
    let last = codec::last_part(path);
    if last.is_empty() { path.to_string_lossy().into_owned() } else { last }
}

/// The columns that are read at once: all that most pictures need, and the attribute that `color.by` asks for. Others
/// are read on demand (`read_column`).
pub(crate) fn selection(info: &codec::Info, settings: &Settings) -> codec::Selection {
    let wanted = ["intensity", "classification", "return_number"].into_iter().chain(settings.color.asked_attribute());
    let attributes = attributes_named(&info.attributes, wanted);
    codec::Selection { positions: true, colors: true, normals: true, attributes }
}

#[cfg(test)]
mod tests {
    use cloud::SeenFrom;

    use super::*;

    /// The options for points that a scanner at `scanner` measured.
    fn options(chunks: &[Chunk], scanner: Option<DVec3>, carve: bool) -> SurfelOptions {
        let mut settings = Settings::default();
        settings.surface.carve = carve;
        options_for(chunks, DVec3::Z, scanner, &settings)
    }

    #[test]
    fn the_name_of_a_cloud_has_no_key_of_its_address() {
        let names = ["https://host/a/all.vpc?token=secret", "a/all.vpc", "/"].map(|path| file_name(Path::new(path)));
        assert_eq!(names, ["all.vpc", "all.vpc", "/"]);
    }

    #[test]
    fn a_scan_whose_file_names_the_place_of_the_scanner_is_carved_from_there() {
        let room = scene::tripod::Tripod::Room;
        let (mut chunks, station) = (scene::tripod::scan(room, 60_000, 1), room.stations()[0]);
        chunks.iter_mut().for_each(|chunk| chunk.station = None);
        let told = options(&chunks, Some(station), true);
        assert_eq!((told.seen_from, told.orientation), (Some(SeenFrom::Place(station)), Orientation::Toward(station)));
        assert_eq!(options(&chunks, Some(station), false).seen_from, None);
        assert_eq!(options(&chunks, None, true).seen_from, None);
        // A place from which these points cannot all have been seen.
        assert_eq!(options(&chunks, Some(station + DVec3::new(1.5, 1.0, 0.4)), true).seen_from, None);
    }

    #[test]
    fn what_is_kept_for_another_place_of_the_scanner_is_not_taken() {
        let told = |scanner| estimate_description(DVec3::Z, scanner, &Settings::default());
        assert!(told(None) != told(Some(DVec3::ZERO)) && told(Some(DVec3::X)) != told(Some(DVec3::ZERO)));
    }

    #[test]
    fn points_of_several_stations_are_carved_if_each_chunk_has_its_own() {
        let mut chunks = scene::tripod::scan(scene::tripod::Tripod::Mixed, 120_000, 1);
        assert_eq!(options(&chunks, None, true).seen_from, Some(SeenFrom::Stations));
        assert_eq!(options(&chunks, None, false).seen_from, None);
        let last = chunks.len() - 1;
        let other = chunks[last].station.take();
        assert_eq!(options(&chunks, None, true).seen_from, None, "it is not known where these points were seen from");
        chunks.iter_mut().for_each(|chunk| chunk.station = other);
        assert_eq!(options(&chunks, None, true).seen_from, None, "not all were seen from there");
    }
}
