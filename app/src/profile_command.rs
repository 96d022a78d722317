//! `glint profile`: the points of a section as a table. Files are read once, chunk by chunk, and only the points of the
//! section are kept, so a file may be larger than memory.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, ChunkTest, Cloud, PointTest, Progress};
use codec::{Selection, Source};
use measure::{Placed, Section};
use scene::{Settings, shown};

use crate::command_line::ProfileArguments;
use crate::failure::{self, FAILED, UNUSABLE, usage};
use crate::terminal::{self, Few};
use crate::{interrupt, picture_file, progress_bar};

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
}

/// What is read of all files.
#[derive(Default)]
struct Table {
    parts: Vec<Part>,
    /// The names of all attributes of any file, in the order in which they come.
    attributes: Vec<String>,
}

/// Writes the section. Returns exit status 2 if one of several inputs cannot be read, and says so on standard error.
///
/// # Errors
/// Bad usage, no input can be read, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &ProfileArguments) -> anyhow::Result<u8> {
    if let Some(output) = &arguments.output {
        if !output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
            return Err(usage(format!("{}: the name must end in .csv, which is what will be in it", shown(output))));
        }
        picture_file::check_place(output)?;
    }
    let request = world::resolve(&arguments.inputs);
    request.check()?;
    let settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let test = request.test();
    terminal::warn(&request.warnings);
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
            match read(file, arguments, &test, &settings, &mut table) {
                Ok(()) => is_any = true,
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
    let text = table.into_csv()?;
    match &arguments.output {
        Some(output) => picture_file::write_text(output, &text)?,
        None => terminal::print(text.lines())?,
    }
    Ok(status)
}

/// Adds the points of a file that are shown and in the section.
fn read(
    path: &Path,
    arguments: &ProfileArguments,
    test: &PointTest,
    settings: &Settings,
    table: &mut Table,
) -> anyhow::Result<()> {
    let source = world::open_file(path, world::half_of(settings.stream.host_bytes)).map_err(usage)?;
    let info = source.info();
    let section = Section::new(&arguments.line.0, arguments.width, world::up_of(info, settings));
    let section = section.map_err(|error| usage(format!("--line, --width: {error}")))?;
    let (name, attributes) = (shown(path), info.attributes.clone());
    let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
    let shown_ones = cloud.test(test);
    let found = Mutex::new(Vec::new());
    let keep = |chunk: Chunk| {
        let piece = piece_of(&cloud, &chunk, &section, &shown_ones);
        found.lock().unwrap_or_else(PoisonError::into_inner).extend(piece);
    };
    let progress = Progress::default();
    let attributes = vec![true; info.attributes.len()];
    let selection = Selection { positions: true, colors: true, normals: false, attributes };
    let summary = read_all(&source, &selection, &progress, &keep).with_context(|| shown(path))?;
    terminal::warn(summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(path))));
    let mut pieces = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    pieces.sort_unstable_by_key(|piece| piece.chunk.first_point);
    table.add(cloud, pieces);
    Ok(())
}

fn read_all(
    source: &Source,
    selection: &Selection,
    progress: &Progress,
    keep: &(dyn Fn(Chunk) + Sync),
) -> codec::Result<codec::Summary> {
    progress_bar::watch("reading", progress, || source.read(selection, progress, keep))
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
    fn add(&mut self, cloud: Cloud, pieces: Vec<Piece>) {
        let mut columns = Vec::new();
        for attribute in &cloud.attributes {
            let known = self.attributes.iter().position(|known| *known == attribute.name);
            columns.push(known.unwrap_or(self.attributes.len()));
            if known.is_none() {
                self.attributes.push(attribute.name.clone());
            }
        }
        self.parts.push(Part { cloud, pieces, columns });
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
            let Part { cloud, pieces, columns } = &self.parts[part];
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
