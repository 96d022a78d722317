//! `glint profile`: the points of a section as a table, a chart or a file of points. Files are read once, chunk by chunk, and only the points of the
//! section are kept, so a file may be larger than memory.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, ChunkTest, Cloud, PointTest, Progress};
use codec::{ExportFormat, Exported, Info, Selection, Units};
use glam::DVec3;
use measure::{Placed, Section};
use render::ColorPlan;
use scene::{CloudSettings, Profile, Settings, shown};
use world::Request;

use crate::command_line::ProfileArguments;
use crate::failure::{self, FAILED, UNUSABLE, usage};
use crate::profile_chart::{self, Dot, colors_of};
use crate::terminal::{self, Few};
use crate::{export_command, interrupt, picture_file, progress_bar};

/// Points of a chunk that are in the section, in the order of the file.
struct Piece {
    chunk: Chunk,
    places: Vec<Placed>,
}

/// What is kept of a file.
struct Part {
    cloud: Cloud,
    pieces: Vec<Piece>,
    /// The columns of its attributes in the table.
    columns: Vec<usize>,
    up: DVec3,
    units: Units,
}

/// What is read of all files.
#[derive(Default)]
struct Table {
    parts: Vec<Part>,
    /// The names of all attributes of any file, in the order in which they come.
    attributes: Vec<String>,
}

/// What is made of the points of a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Table,
    /// As SVG or PNG.
    Chart,
    Points,
}

impl Kind {
    /// The kind that a file's name asks for.
    fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            "csv" => Some(Self::Table),
            "svg" | "png" => Some(Self::Chart),
            _ => ExportFormat::of(path).map(|_| Self::Points),
        }
    }
}

/// What is asked of a section, wherever it comes from.
struct Asked<'a> {
    line: &'a [DVec3],
    width: f64,
    test: &'a PointTest,
    settings: &'a Settings,
    /// Whether progress is shown in a terminal.
    is_watched: bool,
}

/// Writes the section. Returns exit status 2 if one of several inputs cannot be read, and says so on standard error.
///
/// # Errors
/// Bad usage, no input can be read, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &ProfileArguments) -> anyhow::Result<u8> {
    let mut kind = Kind::Table;
    if let Some(output) = &arguments.output {
        let expected =
            "the name must end in .csv, .svg, .png, .laz, .las, .copc.laz or .ply, which is what will be in it";
        kind = Kind::of(output).ok_or_else(|| usage(format!("{}: {expected}", shown(output))))?;
        picture_file::check_place(output)?;
    }
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    request.leave_out_hidden()?;
    let settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let test = request.test();
    terminal::warn(&request.warnings);
    let (line, width) = (arguments.line.0.as_slice(), arguments.width);
    let asked = Asked { line, width, test: &test, settings: &settings, is_watched: true };
    if let (Kind::Points, Some(output)) = (kind, &arguments.output) {
        return export(&request, &asked, output);
    }
    let (mut table, mut status, mut is_any) = (Table::default(), 0, false);
    let mut failed = Few::of("that cannot be read");
    for input in &request.inputs {
        let files = input.files();
        if files.is_empty() {
            status = UNUSABLE;
            failed.complain(&format!("{}: a profile is made of files", input.name()));
        }
        for file in files {
            if arguments
                .output
                .as_deref()
                .is_some_and(|output| picture_file::place(output) == picture_file::place(file))
            {
                return Err(usage(format!("{}: named for an input and an output", shown(file))));
            }
            match read(file, &asked, &mut table) {
                Ok(warnings) => {
                    is_any = true;
                    terminal::warn(warnings.iter().map(|warning| format!("{}: {warning}", shown(file))));
                }
                Err(error) => {
                    let of_error = failure::exit_status(&error);
                    status = if of_error == UNUSABLE && status != FAILED { UNUSABLE } else { FAILED };
                    failed.complain(&format!("{error:#}"));
                }
            }
            interrupt::check()?;
        }
    }
    failed.end();
    if !is_any {
        return Ok(status);
    }
    if table.parts.iter().all(|part| part.pieces.is_empty()) {
        terminal::warn(["the section holds no points"]);
    }
    match &arguments.output {
        Some(output) if kind == Kind::Chart => table.draw(&settings, &request.cloud_settings, output, "profile")?,
        Some(output) => picture_file::write_text(output, &table.into_csv()?)?,
        None => terminal::print(table.into_csv()?.lines())?,
    }
    Ok(status)
}

/// Writes the points of a section to a new file, with all that is known of each.
fn export(request: &Request, asked: &Asked, output: &Path) -> anyhow::Result<u8> {
    let memory = world::half_of(asked.settings.stream.host_bytes);
    let mut failed = Few::of("that cannot be read");
    let sources = export_command::open(request, memory, &mut failed);
    let status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    let Some(first) = sources.first() else { return Ok(status) };
    let test = asked.test.within(asked.section(first.info())?.volumes());
    let progress = Progress::default();
    let write = || codec::export(&sources, &test, &[], output, memory, &progress);
    let written = progress_bar::watch("exporting", &progress, write)?;
    let Exported { points, warnings } = written.ok_or(stream::Error::Cancelled)?;
    terminal::warn(param::few(warnings, "warnings"));
    terminal::print([format!("{}: {points} points", shown(output))])?;
    Ok(status)
}

/// Writes the points of a profile to a file, for the window: as a table, or as points.
///
/// # Errors
/// A cloud that is no file or cannot be read, or the file cannot be written.
pub fn write(
    inputs: &[String],
    profile: &Profile,
    test: &PointTest,
    settings: &Settings,
    path: &Path,
) -> anyhow::Result<()> {
    let asked = Asked { line: &profile.line, width: profile.width, test, settings, is_watched: false };
    let request = world::resolve(inputs);
    let files: Vec<&PathBuf> = request.inputs.iter().flat_map(|input| input.files()).collect();
    anyhow::ensure!(!files.is_empty(), "a profile is made of files, and none is open");
    if Kind::of(path) == Some(Kind::Points) {
        let memory = world::half_of(settings.stream.host_bytes);
        let open = |file: &&PathBuf| world::open_file(file, memory).map_err(anyhow::Error::msg);
        let sources = files.iter().map(open).collect::<anyhow::Result<Vec<_>>>()?;
        let test = test.within(asked.section(sources[0].info())?.volumes());
        codec::export(&sources, &test, &[], path, memory, &Progress::default())?;
        return Ok(());
    }
    let mut table = Table::default();
    for file in files {
        read(file, &asked, &mut table)?;
    }
    picture_file::write_text(path, &table.into_csv()?)
}

impl Asked<'_> {
    fn section(&self, info: &Info) -> anyhow::Result<Section> {
        let section = Section::new(self.line, self.width, world::up_of(info, self.settings));
        section.map_err(|error| usage(format!("--line, --width: {error}")))
    }
}

/// Adds the points of a file that are shown and in the section. Returns the warnings about the file.
fn read(path: &Path, asked: &Asked, table: &mut Table) -> anyhow::Result<Vec<String>> {
    let source = world::open_file(path, world::half_of(asked.settings.stream.host_bytes)).map_err(usage)?;
    let info = source.info();
    let section = asked.section(info)?;
    let (name, attributes) = (shown(path), info.attributes.clone());
    let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
    let shown_ones = cloud.test(asked.test);
    let found = Mutex::new(Vec::new());
    let keep = |chunk: Chunk| {
        let piece = piece_of(&cloud, &chunk, &section, &shown_ones);
        found.lock().unwrap_or_else(PoisonError::into_inner).extend(piece);
    };
    let progress = Progress::default();
    let attributes = vec![true; info.attributes.len()];
    let selection = Selection { positions: true, colors: true, normals: false, attributes };
    let read = || source.read(&selection, &progress, &keep);
    let summary = if asked.is_watched { progress_bar::watch("reading", &progress, read) } else { read() };
    let summary = summary.with_context(|| shown(path))?;
    let mut pieces = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    pieces.sort_unstable_by_key(|piece| piece.chunk.first_point);
    table.add(cloud, pieces, (world::up_of(info, asked.settings), info.units));
    Ok(summary.warnings)
}

fn piece_of(cloud: &Cloud, chunk: &Chunk, section: &Section, test: &ChunkTest) -> Option<Piece> {
    let placed = |index: usize| {
        let placed = section.place(cloud.world_position(chunk, index))?;
        test.shows(chunk, index).then_some((index as u32, placed))
    };
    let (indices, places): (Vec<u32>, Vec<Placed>) = (0..chunk.len()).filter_map(placed).unzip();
    (!indices.is_empty()).then(|| Piece { chunk: chunk.select(&indices), places })
}

impl Table {
    fn add(&mut self, cloud: Cloud, pieces: Vec<Piece>, (up, units): (DVec3, Units)) {
        let mut columns = Vec::new();
        for attribute in &cloud.attributes {
            let known = self.attributes.iter().position(|known| *known == attribute.name);
            columns.push(known.unwrap_or(self.attributes.len()));
            if known.is_none() {
                self.attributes.push(attribute.name.clone());
            }
        }
        self.parts.push(Part { cloud, pieces, columns, up, units });
    }

    /// Writes the chart of the points. Each file has the colours that the settings, or its own, ask for; ramps go over
    /// its points in the section.
    fn draw(&self, settings: &Settings, own: &[CloudSettings], output: &Path, name: &str) -> anyhow::Result<()> {
        let mut dots = Vec::new();
        for Part { cloud, pieces, up, .. } in &self.parts {
            let chunks = pieces.iter().map(|piece| piece.chunk.clone()).collect();
            let whole = Cloud { attributes: cloud.attributes.clone(), chunks, ..cloud.clone() };
            let name = Path::new(&cloud.name).file_name().map_or(String::new(), |name| shown(Path::new(name)));
            let own = own.iter().find(|own| own.is_of(&cloud.name, &name));
            let color = own.map_or_else(|| settings.color.clone(), |own| own.color_of(&settings.color));
            let (plan, warning) = ColorPlan::new(&whole, &color, *up);
            terminal::warn(warning.filter(|_| !pieces.is_empty()));
            for Piece { chunk, places } in pieces {
                let dot =
                    |(placed, color): (&Placed, [u8; 3])| Dot { along: placed.along, height: placed.height, color };
                dots.extend(places.iter().zip(colors_of(cloud, chunk, &plan, *up)).map(dot));
            }
        }
        let unit = self.parts.first().and_then(|part| part.units.length()).map(|unit| unit.to_string());
        profile_chart::write(output, &dots, dots.len() as u64, name, unit.as_deref())
    }

    /// The rows by distance along the line; of equal ones, in the order of files and points.
    fn into_csv(self) -> anyhow::Result<String> {
        let mut order: Vec<(usize, usize, usize)> = Vec::new();
        for (part, Part { pieces, .. }) in self.parts.iter().enumerate() {
            for (piece, Piece { places, .. }) in pieces.iter().enumerate() {
                order.extend((0..places.len()).map(|index| (part, piece, index)));
            }
        }
        let along =
            |(part, piece, index): &(usize, usize, usize)| self.parts[*part].pieces[*piece].places[*index].along;
        order.sort_by(|a, b| along(a).total_cmp(&along(b)));
        let mut writer = csv::Writer::from_writer(Vec::new());
        let fixed = ["along", "height", "across", "x", "y", "z", "red", "green", "blue"];
        writer.write_record(fixed.into_iter().chain(self.attributes.iter().map(String::as_str)))?;
        for (part, piece, index) in order {
            let Part { cloud, pieces, columns, .. } = &self.parts[part];
            let Piece { chunk, places } = &pieces[piece];
            let (placed, position) = (places[index], cloud.world_position(chunk, index).to_array());
            let lengths = [placed.along, placed.height, placed.across].into_iter().chain(position);
            let color = chunk.colors.as_ref().map(|colors| colors[index]);
            let colors = (0..3).map(|channel| color.map_or(String::new(), |color| color[channel].to_string()));
            let mut own = vec![String::new(); self.attributes.len()];
            for (column, values) in columns.iter().zip(&chunk.columns) {
                own[*column] = values.as_ref().map_or(String::new(), |values| values.text(index));
            }
            writer.write_record(lengths.map(|length| length.to_string()).chain(colors).chain(own))?;
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    }
}
