//! The files that a sweep writes: a contact sheet and a table, in a new folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use study::results::{self, FRAME_MS, Figure, METHOD_MS, Measured};
use study::{Accuracy, Truth};

use crate::system::picture_file;
use crate::viewer::jobs::contact_sheet;
use crate::viewer::jobs::contact_sheet::Tile;

/// The results of a sweep so far.
pub struct SweepResult {
    /// The key of the parameter.
    pub key: String,
    /// The size of the view in pixels.
    pub size: [u32; 2],
    pub rows: Vec<Row>,
    /// The folder that the sweep created at its start and is saved in.
    pub folder: PathBuf,
}

/// One value and its result; a value that failed has none.
pub struct Row {
    pub value: String,
    pub outcome: Option<Outcome>,
}

pub struct Outcome {
    /// Milliseconds for the frame and for the method.
    pub times: [f64; 2],
    pub figures: Accuracy,
    /// RGBA pixels in the tile's size.
    pub picture: Vec<u8>,
}

/// Creates a new folder for a sweep in the first of `places` that allows it; returns its absolute path.
pub fn make_folder(places: &[PathBuf], key: &str) -> std::io::Result<PathBuf> {
    let mut result = Err(std::io::ErrorKind::NotFound.into());
    for place in places {
        let name = |number: u32| place.join(format!("sweep-{}-{number}", key.replace('.', "-")));
        let is_taken = |error: &std::io::Error| error.kind() == std::io::ErrorKind::AlreadyExists;
        let tried = (1..).map(name).map(|path| std::fs::create_dir(&path).map(|()| path));
        result = tried.into_iter().find(|made| !made.as_ref().is_err_and(is_taken)).unwrap_or(result);
        if result.is_ok() {
            break;
        }
    }
    result.and_then(std::path::absolute)
}

impl SweepResult {
    /// Writes the sheet and the table of all rows so far. Returns the folder, and the error if writing failed. If the
    /// sweep's folder can no longer be written, another is created.
    pub fn save(self) -> (PathBuf, anyhow::Result<()>) {
        let Err(error) = self.write(&self.folder) else { return (self.folder, Ok(())) };
        match make_folder(&[std::env::temp_dir()], &self.key) {
            Ok(other) if self.write(&other).is_ok() => (other, Ok(())),
            _ => (self.folder, Err(error)),
        }
    }

    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        picture_file::write_text(&folder.join("sweep.csv"), &self.table()?)?;
        let picture = |row: &'_ Row| row.outcome.as_ref().map_or(Vec::new(), |outcome| outcome.picture.clone());
        let tiles = self.rows.iter().map(|row| Tile { rgba: picture(row), lines: self.label(row) }).collect();
        let (size, rgba) = contact_sheet::draw(contact_sheet::tile_size(self.size), tiles);
        picture_file::write_png(&folder.join("sheet.png"), size, &rgba, None)
    }

    fn label(&self, row: &Row) -> Vec<String> {
        let name = format!("{} = {}", self.key, row.value);
        let Some(Outcome { times: [frame, method], figures, .. }) = &row.outcome else {
            return vec![name, "failed".into()];
        };
        let color = figures.image.map_or(f64::NAN, |image| image.delta_e);
        // Nothing is filled by the method `none`.
        let within = Some(figures.pixel_error.p95).filter(|p95| p95.is_finite());
        let within = within.map_or(String::new(), |p95| format!("95 of 100 filled within {p95:.2} pixels · "));
        vec![
            name,
            format!("{method:.1} ms of {frame:.1} ms · {:.1} % filled", figures.closed_coverage * 100.0),
            format!("{within}{color:.2} ΔE"),
        ]
    }

    /// The table as CSV: a row for each value, and the figures' names as in studies. A cell without a measurement is
    /// empty.
    fn table(&self) -> anyhow::Result<String> {
        let names = || results::figures().iter().filter(|figure| is_listed(figure)).map(|figure| figure.name.as_str());
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(["key", "value"].into_iter().chain(names()))?;
        for Row { value, outcome } in &self.rows {
            let figures = outcome.as_ref().map_or(BTreeMap::new(), Outcome::named);
            let cells = names().map(|name| figures.get(name).map_or(String::new(), f64::to_string));
            writer.write_record([self.key.clone(), value.clone()].into_iter().chain(cells))?;
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    }
}

/// Whether the table of a sweep contains a figure: times, how much of the mirrors is filled, and all comparisons with
/// the traced truth but those of indirect light, which a sweep does not measure.
fn is_listed(figure: &Figure) -> bool {
    const ALWAYS: [&str; 5] = [FRAME_MS, METHOD_MS, "mirror_pixels", "coverage", "closed_coverage"];
    let is_judged = figure.truth().is_some_and(|(truth, _)| truth == Truth::SameInput) && !figure.is_of_light();
    ALWAYS.contains(&figure.name.as_str()) || is_judged
}

impl Outcome {
    /// The figures by their names in studies, without those that could not be measured.
    fn named(&self) -> BTreeMap<String, f64> {
        let measured = Measured {
            mirror_pixels: self.figures.mirror_pixels as f64,
            coverage: Some(self.figures.coverage),
            closed_coverage: Some(self.figures.closed_coverage),
            judged: vec![self.figures.clone()],
            ..Measured::default()
        };
        let times = [FRAME_MS, METHOD_MS].map(str::to_owned).into_iter().zip(self.times);
        measured.figures().into_iter().chain(times).collect()
    }
}
