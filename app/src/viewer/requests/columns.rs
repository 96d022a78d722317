//! What a person says of the columns of a table that nothing names, before it is opened.

use std::path::{Path, PathBuf};

use codec::{SKIP, UnnamedTable};

use crate::shared::language::text;

/// The meanings that are offered for a column, besides an attribute of any name.
pub const MEANINGS: [&str; 11] = ["x", "y", "z", "red", "green", "blue", "intensity", "nx", "ny", "nz", SKIP];

/// A table that waits for its columns.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnsDraft {
    pub path: PathBuf,
    pub table: UnnamedTable,
    /// The names of the columns as `--columns` takes them.
    pub text: String,
    /// Whether its field has the keyboard already.
    pub is_shown: bool,
}

/// A step of naming the columns of the table that waits first.
#[derive(Clone, Debug, PartialEq)]
pub enum Naming {
    Change(Box<ColumnsDraft>),
    /// Opens the table by what is entered.
    Open,
    /// Gives this table up.
    Cancel(PathBuf),
}

impl ColumnsDraft {
    /// `None` where nothing is to be asked: three columns can only be the place.
    pub fn asking(path: &Path, table: UnnamedTable) -> Option<Self> {
        let text = table.names.join(",");
        (text != "x,y,z").then(|| Self { path: path.to_owned(), table, text, is_shown: false })
    }

    /// The names as they were entered.
    pub fn entered(&self) -> Vec<String> {
        self.text.trim().split(',').map(|name| name.trim().to_owned()).collect()
    }

    /// What the columns will be.
    ///
    /// # Errors
    /// In words, if they cannot be that.
    pub fn names(&self) -> Result<Vec<String>, String> {
        let entered = self.entered();
        let (count, most) = (entered.len(), self.table.names.len());
        if count > most {
            return Err(text!("{count} names for {most} columns", count, most));
        }
        if entered.iter().any(String::is_empty) {
            return Err(text!("a column has no name; `{SKIP}` leaves it out", SKIP));
        }
        codec::column_names(&entered)
    }

    /// The name of a column: `skip` beyond the names that were entered.
    pub fn name(&self, column: usize) -> String {
        let name = self.entered().into_iter().nth(column).unwrap_or_else(|| SKIP.into());
        let known = MEANINGS.into_iter().find(|known| name.eq_ignore_ascii_case(known));
        known.map_or(name, str::to_owned)
    }

    /// Gives a column a meaning. A column that had it gets that of this one instead.
    pub fn choose(&mut self, column: usize, meaning: &str) {
        let mut names: Vec<String> = (0..self.table.names.len()).map(|column| self.name(column)).collect();
        let before = names[column].clone();
        if meaning != SKIP
            && let Some(other) = names.iter().position(|name| name == meaning)
        {
            names[other] = before;
        }
        names[column] = meaning.to_owned();
        self.text = names.join(",");
    }
}

/// The name of a column that is an attribute, until a person gives it another one.
pub fn attribute(column: usize) -> String {
    format!("column_{}", column + 1)
}

/// Whether files with this ending are tables whose columns may have no names.
pub fn is_of_table(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    codec::Format::Xyz.endings().contains(&ending.as_str())
}
