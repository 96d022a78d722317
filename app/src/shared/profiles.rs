//! The points of sections as a table, a chart or a file of points. Files are read once, chunk by chunk, and only the
//! points of the sections are kept, so a file may be larger than memory.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, PointTest, Progress, Volume};
use codec::{ExportFormat, Exported, Info, Selection, Source, Unit, Units, Wanted};
use glam::DVec3;
use measure::{Placed, PointTree, Section};
use render::ColorPlan;
use scene::{CloudSettings, Profile, Settings, shown};
use serde_json::json;

use crate::shared::export::{self, lack};
use crate::shared::numbers::grouped;
use crate::shared::profile_chart::{self, AxisUnits, Dot, Series, axis_units, colors_of};
use crate::shared::profile_intervals::{Around, Intervals, intervals};
use crate::system::failure::usage;
use crate::system::{picture_file, progress_bar, terminal};

/// The columns that every table has.
const FIXED: [&str; 9] = ["along", "height", "across", "x", "y", "z", "red", "green", "blue"];

/// The last columns of every table: the half widths of intervals of 95 %, and nothing where they are not known.
const INTERVALS: [&str; 2] = ["along_interval", "height_interval"];
/// The bytes that a point around a profile takes while intervals are found.
const BYTES_AROUND: u64 = 64;

/// Whether an attribute of a file is a column that every table has: its coordinates and its colours.
fn is_fixed(name: &str) -> bool {
    FIXED[3..].iter().any(|fixed| fixed.eq_ignore_ascii_case(name))
}

/// Points of a chunk that are in a section, in the order of the file.
struct Piece {
    /// The number of the section.
    section: usize,
    chunk: Chunk,
    places: Vec<Placed>,
    /// How certain these places are, for a table; else empty.
    intervals: Vec<Option<Intervals>>,
}

/// What is kept of a file.
struct Part {
    cloud: Cloud,
    pieces: Vec<Piece>,
    /// The columns of its attributes in the table, but for those that every table has.
    columns: Vec<Option<usize>>,
    up: DVec3,
    units: Units,
}

/// What is read of all files.
pub struct Table {
    /// The names of the sections.
    pub sections: Vec<String>,
    /// What the points of each section amount to.
    pub extents: Vec<Extent>,
    parts: Vec<Part>,
    /// The names of all attributes of any file, in the order in which they come.
    attributes: Vec<String>,
    /// Whether colours of any of the points have more than 8 bits in their file.
    has_wide_colors: bool,
}

/// The points of a section, and the least and the largest of their distances along its line and of their heights.
#[derive(Clone, Copy)]
pub struct Extent {
    pub points: u64,
    along: [f64; 2],
    height: [f64; 2],
}

/// What is made of the points of sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Table,
    /// As SVG or PNG.
    Chart,
    Points,
}

impl Kind {
    /// The kind that a file's name asks for.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            "csv" => Some(Self::Table),
            "svg" | "png" => Some(Self::Chart),
            _ => ExportFormat::of(path).map(|_| Self::Points),
        }
    }
}

/// What is asked for, wherever it comes from.
pub struct Asked<'a> {
    /// The sections. One without a name comes from the command line.
    pub profiles: &'a [Profile],
    /// How many parallel copies each of them has, and how far each is to the left of the one before.
    pub stack: (u32, f64),
    pub test: &'a PointTest,
    pub settings: &'a Settings,
    /// Whether progress is shown in a terminal.
    pub is_watched: bool,
    /// Whether the points of the sections are kept, not only counted.
    pub keeps_points: bool,
    /// Whether it is found out how certain the places of the points are, which takes a second reading of the files.
    pub has_intervals: bool,
}

/// Writes the points of profiles to a file, for the window: as a table, or as points.
///
/// # Errors
/// A cloud that is no file or cannot be read, or the file cannot be written.
pub fn write(
    inputs: &[String],
    own: Vec<CloudSettings>,
    profiles: &[Profile],
    test: &PointTest,
    settings: &Settings,
    path: &Path,
) -> anyhow::Result<Vec<String>> {
    let (stack, is_watched, keeps_points) = ((0, 0.0), false, true);
    let asked = Asked { profiles, stack, test, settings, is_watched, keeps_points, has_intervals: true };
    let request = world::resolve_open(inputs, own, settings);
    let memory = world::half_of(settings.stream.host_bytes);
    let (mut sources, mut left_out, mut lost) = (Vec::new(), Vec::new(), Vec::new());
    for input in &request.inputs {
        let open = |file: &PathBuf| request.open(input, file, memory).map_err(anyhow::Error::msg);
        let own = input.files().iter().map(open).collect::<anyhow::Result<Vec<_>>>()?.concat();
        left_out.extend(asked.strays(&own)?);
        lost.extend(world::lost_tiles(&own).cloned());
        sources.extend(own);
    }
    anyhow::ensure!(!sources.is_empty(), "a profile is made of files, and none is open");
    if Kind::of(path) == Some(Kind::Points) {
        let test = test.within(asked.volumes(sources[0].info())?);
        let wanted = Wanted { test: &test, left_out: &left_out };
        let written = codec::export(&sources, wanted, &[], path, memory, &Progress::default())?;
        return Ok(written.map_or_else(Vec::new, |Exported { changes, warnings, missing, .. }| {
            changes.into_iter().chain(warnings).chain(lost).chain(lack(path, missing)).collect()
        }));
    }
    let (mut table, mut missing) = (Table::new(&asked), 0);
    for (number, source) in sources.iter().enumerate() {
        missing += read(source, &left_out[number..=number], &asked, &mut table)?.1;
    }
    lost.extend(table.of_colors().map(str::to_owned));
    picture_file::write_text(path, &table.into_csv()?)?;
    lost.extend(lack(path, missing));
    Ok(lost)
}

impl Asked<'_> {
    /// The names of the sections, in their order.
    fn names(&self) -> Vec<String> {
        let name = |profile: &Profile| if profile.name.is_empty() { "profile".into() } else { profile.name.clone() };
        let numbered = |name: String| {
            (0..=self.stack.0).map(move |copy| if copy == 0 { name.clone() } else { format!("{name} {}", copy + 1) })
        };
        self.profiles.iter().map(name).flat_map(numbered).collect()
    }

    /// The sections in a cloud, in the same order.
    fn sections(&self, info: &Info) -> anyhow::Result<Vec<Section>> {
        let (up, (copies, spacing)) = (world::up_of(info, self.settings), self.stack);
        let copied = |profile: &Profile| -> Vec<Profile> {
            (0..=copies).map(|copy| profile.beside(up, spacing * f64::from(copy))).collect()
        };
        let section = |profile: Profile| {
            let what = if profile.name.is_empty() { "--line, --width".into() } else { format!("`{}`", profile.name) };
            Section::new(&profile.line, profile.width, up).map_err(|error| usage(format!("{what}: {error}")))
        };
        self.profiles.iter().flat_map(copied).map(section).collect()
    }

    /// The parts of space that the sections are.
    pub fn volumes(&self, info: &Info) -> anyhow::Result<Vec<Volume>> {
        Ok(self.sections(info)?.iter().flat_map(Section::volumes).collect())
    }

    /// The points of the files of one cloud that are stray, if the settings hide these.
    pub fn strays(&self, sources: &[Arc<Source>]) -> anyhow::Result<Vec<Vec<u64>>> {
        let progress = Progress::default();
        let find = || export::strays(sources, self.test, self.settings, &progress);
        let found = if self.is_watched { progress_bar::watch("strays", &progress, find) } else { find() };
        Ok(found.map_err(usage)?.ok_or(stream::Error::Cancelled)?)
    }
}

/// Adds the points of a file that are shown and in the sections; `left_out` holds the indices of those of its points
/// that are left out besides. Returns the warnings about the file, and how many of its points cannot be read.
pub fn read(
    source: &Source,
    left_out: &[Vec<u64>],
    asked: &Asked,
    table: &mut Table,
) -> anyhow::Result<(Vec<String>, u64)> {
    let info = source.info();
    let sections = asked.sections(info)?;
    let (name, attributes) = (shown(&info.path), info.attributes.clone());
    let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
    let (shown_ones, wanted) = (cloud.test(asked.test), Wanted { test: asked.test, left_out });
    let found = Mutex::new((Vec::new(), vec![Extent::NONE; sections.len()]));
    let keep = |chunk: Chunk| {
        let left_out = wanted.left_out(0, chunk.first_point, chunk.len());
        let shows = |index: usize| shown_ones.shows(&chunk, index) && !left_out.has(index);
        for (number, section) in sections.iter().enumerate() {
            let Some(piece) = piece_of(&cloud, &chunk, (number, section), &shows) else { continue };
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            let (pieces, extents) = &mut *found;
            extents[number].add(Extent::of(&piece.places));
            if asked.keeps_points {
                pieces.push(piece);
            }
        }
    };
    let progress = Progress::default();
    let tested = info.attributes.iter().zip(asked.test.reads(&info.attributes));
    let attributes = tested.map(|(attribute, is_tested)| is_tested || !is_fixed(&attribute.name)).collect();
    let selection = Selection { positions: true, colors: true, normals: false, attributes };
    let read = || source.read(&selection, &progress, &keep);
    let summary = if asked.is_watched { progress_bar::watch("reading", &progress, read) } else { read() };
    let summary = summary.with_context(|| shown(&info.path))?;
    let (mut pieces, extents) = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    pieces.sort_unstable_by_key(|piece: &Piece| (piece.section, piece.chunk.first_point));
    let mut warnings = summary.warnings;
    if asked.has_intervals {
        table.has_wide_colors |= source.has_wide_colors() && !pieces.is_empty();
        warnings.extend(find_intervals(source, left_out, asked, (&cloud, &sections), &mut pieces)?);
    }
    table.add(cloud, pieces, (world::up_of(info, asked.settings), info.units));
    table.extents.iter_mut().zip(extents).for_each(|(known, own)| known.add(own));
    Ok((warnings, info.missing.saturating_add(summary.missing)))
}

/// Finds how certain the places of pieces of a file are, by all of its points that are shown, whatever section they are
/// in. Returns a warning where that would take too much memory, and where most places have none.
fn find_intervals(
    source: &Source,
    left_out: &[Vec<u64>],
    asked: &Asked,
    (cloud, sections): (&Cloud, &[Section]),
    pieces: &mut [Piece],
) -> anyhow::Result<Option<String>> {
    let places = |piece: &Piece| -> Vec<DVec3> {
        (0..piece.chunk.len()).map(|index| cloud.world_position(&piece.chunk, index)).collect()
    };
    let mut of_sections: Vec<Vec<DVec3>> = vec![Vec::new(); sections.len()];
    pieces.iter().for_each(|piece| of_sections[piece.section].extend(places(piece)));
    let around = Around::new(&of_sections);
    let (shown_ones, wanted) = (cloud.test(asked.test), Wanted { test: asked.test, left_out });
    let most = world::half_of(asked.settings.stream.host_bytes) / BYTES_AROUND;
    let found = Mutex::new(Vec::new());
    let keep = |chunk: Chunk| {
        let left_out = wanted.left_out(0, chunk.first_point, chunk.len());
        let near = |index: usize| {
            let point = cloud.world_position(&chunk, index);
            (around.has(point) && shown_ones.shows(&chunk, index) && !left_out.has(index)).then_some(point)
        };
        let near: Vec<DVec3> = (0..chunk.len()).filter_map(near).collect();
        let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
        if found.len() as u64 <= most {
            found.extend(near);
        }
    };
    let attributes = asked.test.reads(&cloud.attributes);
    let selection = Selection { positions: true, colors: false, normals: false, attributes };
    let progress = Progress::default();
    let read = || source.read(&selection, &progress, &keep);
    let read = if asked.is_watched { progress_bar::watch("reading what is around", &progress, read) } else { read() };
    read.with_context(|| shown(&source.info().path))?;
    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    if found.len() as u64 > most {
        let warning =
            "the points around the profile do not fit into stream.host_bytes, so the table states no intervals";
        return Ok(Some(warning.into()));
    }
    let tree = PointTree::new(found);
    let (mut count, mut without) = (0, 0);
    for piece in pieces {
        piece.intervals = intervals(&sections[piece.section], &places(piece), &tree);
        count += piece.intervals.len();
        without += piece.intervals.iter().filter(|interval| interval.is_none()).count();
    }
    let warning = format!(
        "{} of {} points have no intervals: the profile is thinner than half of the distance between them, or they form no \
         surface",
        grouped(without as u64),
        grouped(count as u64),
    );
    Ok((2 * without > count).then_some(warning))
}

fn piece_of(
    cloud: &Cloud,
    chunk: &Chunk,
    (number, section): (usize, &Section),
    shows: &impl Fn(usize) -> bool,
) -> Option<Piece> {
    let placed = |index: usize| {
        let placed = section.place(cloud.world_position(chunk, index))?;
        shows(index).then_some((index as u32, placed))
    };
    let (indices, places): (Vec<u32>, Vec<Placed>) = (0..chunk.len()).filter_map(placed).unzip();
    let chunk = (!indices.is_empty()).then(|| chunk.select(&indices))?;
    Some(Piece { section: number, chunk, places, intervals: Vec::new() })
}

impl Extent {
    const NONE: Self =
        Self { points: 0, along: [f64::INFINITY, f64::NEG_INFINITY], height: [f64::INFINITY, f64::NEG_INFINITY] };

    fn of(places: &[Placed]) -> Self {
        let one = |placed: &Placed| Self { points: 1, along: [placed.along; 2], height: [placed.height; 2] };
        places.iter().map(one).fold(Self::NONE, |mut extent, one| {
            extent.add(one);
            extent
        })
    }

    fn add(&mut self, other: Self) {
        let wider = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.points += other.points;
        (self.along, self.height) = (wider(self.along, other.along), wider(self.height, other.height));
    }
}

impl Table {
    pub fn new(asked: &Asked) -> Self {
        let sections = asked.names();
        let (extents, parts, attributes) = (vec![Extent::NONE; sections.len()], Vec::new(), Vec::new());
        Self { sections, extents, parts, attributes, has_wide_colors: false }
    }

    /// What a table of the points loses of their colours, in words.
    pub fn of_colors(&self) -> Option<&'static str> {
        let words = "colours of more than 8 bits are rounded to bytes in the table; LAS and LAZ files keep them";
        self.has_wide_colors.then_some(words)
    }

    /// What the sections hold, as JSON. `path` is the file that is written.
    pub fn report(&self, path: Option<&Path>) -> serde_json::Value {
        let section = |(number, (name, extent)): (usize, (&String, &Extent))| {
            let range = |range: [f64; 2]| (extent.points > 0).then_some(range);
            let Extent { points, along, height } = *extent;
            let [along_interval, height_interval] = self.median_intervals(number);
            json!({
                "name": name, "points": points, "along": range(along), "height": range(height),
                "along_interval": along_interval, "height_interval": height_interval,
            })
        };
        let text = |unit: Option<Unit>| unit.map(|unit| unit.to_string());
        let unit = text(self.units().length());
        let [along_unit, height_unit] = self.axis_units().map(text);
        let sections: Vec<serde_json::Value> =
            self.sections.iter().zip(&self.extents).enumerate().map(section).collect();
        json!({
            "path": path.map(shown), "unit": unit, "along_unit": along_unit, "height_unit": height_unit,
            "profiles": sections,
        })
    }

    /// The median half widths of the intervals of a section's points, where they were found.
    fn median_intervals(&self, section: usize) -> [Option<f64>; 2] {
        let pieces = self.parts.iter().flat_map(|part| &part.pieces).filter(|piece| piece.section == section);
        let known: Vec<Intervals> = pieces.flat_map(|piece| piece.intervals.iter().flatten().copied()).collect();
        [0, 1].map(|axis| {
            let mut of_axis: Vec<f64> = known.iter().map(|half_widths| half_widths[axis]).collect();
            let middle = of_axis.len() / 2;
            (!of_axis.is_empty()).then(|| *of_axis.select_nth_unstable_by(middle, f64::total_cmp).1)
        })
    }

    fn units(&self) -> Units {
        Units::in_common(self.parts.iter().map(|part| part.units))
    }

    fn axis_units(&self) -> AxisUnits {
        self.parts.first().map_or([None; 2], |part| axis_units(&self.units(), part.up))
    }

    fn add(&mut self, cloud: Cloud, pieces: Vec<Piece>, (up, units): (DVec3, Units)) {
        let mut columns = Vec::new();
        for attribute in &cloud.attributes {
            let known = self.attributes.iter().position(|known| *known == attribute.name);
            let is_fixed = is_fixed(&attribute.name);
            columns.push((!is_fixed).then(|| known.unwrap_or(self.attributes.len())));
            if known.is_none() && !is_fixed {
                self.attributes.push(attribute.name.clone());
            }
        }
        self.parts.push(Part { cloud, pieces, columns, up, units });
    }

    /// Writes the chart of the points. Those of the first section have the colours that the settings, or the file's own,
    /// ask for, whose ramps go over its points in all sections; the others lie behind it, each in a colour of its own.
    pub fn draw(&self, settings: &Settings, own: &[CloudSettings], output: &Path) -> anyhow::Result<()> {
        let mut dots: Vec<Vec<Dot>> = vec![Vec::new(); self.sections.len()];
        for Part { cloud, pieces, up, .. } in &self.parts {
            let chunks = pieces.iter().map(|piece| piece.chunk.clone()).collect();
            let whole = Cloud { attributes: cloud.attributes.clone(), chunks, ..cloud.clone() };
            let name = Path::new(&cloud.name).file_name().map_or(String::new(), |name| shown(Path::new(name)));
            let own = own.iter().find(|own| own.is_of(&cloud.name, &name));
            let color = own.map_or_else(|| settings.color.clone(), |own| own.color_of(&settings.color));
            let (plan, warning) = ColorPlan::new(&whole, &color, *up);
            terminal::warn(warning.filter(|_| !pieces.is_empty()));
            for Piece { section, chunk, places, .. } in pieces {
                let dot =
                    |(placed, color): (&Placed, [u8; 3])| Dot { along: placed.along, height: placed.height, color };
                dots[*section].extend(places.iter().zip(colors_of(cloud, chunk, &plan, *up)).map(dot));
            }
        }
        let series = |(name, dots): (&String, Vec<Dot>)| Series {
            name: name.clone(),
            total: dots.len() as u64,
            dots,
            is_thinned: false,
        };
        let series: Vec<Series> = self.sections.iter().zip(dots).map(series).collect();
        profile_chart::write(output, &series, self.axis_units())
    }

    /// The rows by section and by distance along its line; of equal ones, in the order of files and points. Of several
    /// sections, the first column has the name.
    pub fn into_csv(self) -> anyhow::Result<String> {
        let mut order: Vec<(usize, usize, usize)> = Vec::new();
        for (part, Part { pieces, .. }) in self.parts.iter().enumerate() {
            for (piece, Piece { places, .. }) in pieces.iter().enumerate() {
                order.extend((0..places.len()).map(|index| (part, piece, index)));
            }
        }
        let place = |(part, piece, index): &(usize, usize, usize)| {
            let Piece { section, places, .. } = &self.parts[*part].pieces[*piece];
            (*section, places[*index].along)
        };
        order.sort_by(|a, b| place(a).0.cmp(&place(b).0).then(place(a).1.total_cmp(&place(b).1)));
        let mut writer = csv::Writer::from_writer(Vec::new());
        let has_names = self.sections.len() > 1;
        let first = has_names.then_some("profile");
        let attributes = self.attributes.iter().map(String::as_str);
        writer.write_record(first.into_iter().chain(FIXED).chain(attributes).chain(INTERVALS))?;
        for (part, piece, index) in order {
            let Part { cloud, pieces, columns, .. } = &self.parts[part];
            let Piece { section, chunk, places, intervals } = &pieces[piece];
            let (placed, position) = (places[index], cloud.world_position(chunk, index).to_array());
            let lengths = [placed.along, placed.height, placed.across].into_iter().chain(position);
            let color = chunk.colors.as_ref().map(|colors| colors[index]);
            let colors = (0..3).map(|channel| color.map_or(String::new(), |color| color[channel].to_string()));
            let mut own = vec![String::new(); self.attributes.len()];
            for (column, values) in columns.iter().zip(&chunk.columns) {
                if let (Some(column), Some(values)) = (column, values) {
                    own[*column] = values.text(index);
                }
            }
            let name = has_names.then(|| self.sections[*section].clone());
            let lengths = lengths.map(cloud::number);
            let interval = intervals.get(index).copied().flatten();
            let half_widths =
                [0, 1].map(|axis| interval.map_or(String::new(), |interval| cloud::number(interval[axis])));
            writer.write_record(name.into_iter().chain(lengths).chain(colors).chain(own).chain(half_widths))?;
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    }
}
