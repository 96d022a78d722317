//! Tables of pages that come from the tables of studies.
//!
//! A page holds blocks:
//!
//! ```text
//! <!-- table methods/results.csv
//! where: group=default
//! columns: scene
//! row: `sscr` as published | method=sscr
//! cells: exact_pixel_error_p95:2 exact_delta_e:1
//! -->
//! | | sphere |
//! |---|---|
//! | `sscr` as published | 0.99, 1.9 |
//! <!-- end -->
//! ```
//!
//! A row and a column are conditions on the rows of the CSV; the row that meets both is the cell. `where` is a condition
//! on all. A condition is `COLUMN=VALUE`, several are joined by `&`. `columns: KEY` and `rows: KEY` stand for each value
//! of a column of the CSV; `column: LABEL | CONDITION | FIGURES` and `row:` with the same parts for one. The figures of
//! a row count, else those of its column, else `cells`: names of columns of the CSV, each with its decimals, and a factor
//! before them, as in `coverage*100:1`. A cell without a row is empty, and a figure that was not measured is a dash.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};

const BEGIN: &str = "\n<!-- table ";
const END: &str = "<!-- end -->\n";

/// Writes the tables of a page anew; `folder` is the page's.
///
/// # Errors
/// A block that is not understood, a CSV that cannot be read, a column that it lacks, or several rows for one cell.
pub fn rendered(page: &str, folder: &Path) -> anyhow::Result<String> {
    let mut made = String::new();
    let mut rest = page;
    while let Some((before, after)) = rest.split_once(BEGIN) {
        let (head, after) = after.split_once("-->\n").context("a block has no end of its head")?;
        let (_, after) = after.split_once(END).with_context(|| format!("{head}: the block has no end"))?;
        let table = table(head, folder).with_context(|| head.trim().to_owned())?;
        let _ = write!(made, "{before}{BEGIN}{head}-->\n{table}{END}");
        rest = after;
    }
    made.push_str(rest);
    Ok(made)
}

/// A row or a column of a table.
struct Line<'a> {
    label: String,
    condition: Vec<(&'a str, String)>,
    figures: Vec<Shown<'a>>,
}

/// How a figure is shown.
struct Shown<'a> {
    name: &'a str,
    factor: f64,
    decimals: usize,
}

struct Csv {
    names: Vec<String>,
    rows: Vec<csv::StringRecord>,
}

impl Csv {
    fn read(path: &Path) -> anyhow::Result<Self> {
        let mut reader = csv::Reader::from_path(path).with_context(|| path.display().to_string())?;
        let names = reader.headers()?.iter().map(str::to_owned).collect();
        Ok(Self { names, rows: reader.records().collect::<Result<_, _>>()? })
    }

    fn column(&self, name: &str) -> anyhow::Result<usize> {
        self.names.iter().position(|known| known == name).with_context(|| format!("the CSV has no column `{name}`"))
    }

    fn meets(&self, row: &csv::StringRecord, condition: &[(&str, String)]) -> anyhow::Result<bool> {
        for (name, value) in condition {
            let cell = row.get(self.column(name)?).unwrap_or_default();
            let numbers = cell.parse::<f64>().ok().zip(value.parse::<f64>().ok());
            if cell != value && !numbers.is_some_and(|(cell, value)| cell == value) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The values of a column in the rows that meet a condition, in the order in which they first occur.
    fn values(&self, name: &str, condition: &[(&str, String)]) -> anyhow::Result<Vec<String>> {
        let column = self.column(name)?;
        let mut values: Vec<String> = Vec::new();
        for row in &self.rows {
            let value = row.get(column).unwrap_or_default();
            if !value.is_empty() && self.meets(row, condition)? && !values.iter().any(|known| known == value) {
                values.push(value.to_owned());
            }
        }
        Ok(values)
    }
}

fn condition(text: &str) -> anyhow::Result<Vec<(&str, String)>> {
    let parts = text.split('&').map(str::trim).filter(|part| !part.is_empty());
    let pair = |part: &str| anyhow!("`{part}` is no condition, expected COLUMN=VALUE");
    parts
        .map(|part| part.split_once('=').map(|(name, value)| (name, value.to_owned())).ok_or_else(|| pair(part)))
        .collect()
}

fn shown(text: &str) -> anyhow::Result<Vec<Shown<'_>>> {
    let figure = |word| {
        let (name, decimals) = str::split_once(word, ':').with_context(|| format!("`{word}` has no decimals"))?;
        let (name, factor) = name.split_once('*').map_or(Ok((name, 1.0)), |(name, factor)| {
            factor.parse().map(|factor| (name, factor)).with_context(|| format!("`{word}`: the factor is no number"))
        })?;
        let decimals = decimals.parse().with_context(|| format!("`{word}`: the decimals are no number"))?;
        anyhow::Ok(Shown { name, factor, decimals })
    };
    text.split_whitespace().map(figure).collect()
}

/// The line of a label, a condition and figures, separated by bars.
fn line(text: &str) -> anyhow::Result<Line<'_>> {
    let mut parts = text.splitn(3, '|').map(str::trim);
    let label = parts.next().unwrap_or_default().to_owned();
    let condition = condition(parts.next().unwrap_or_default())?;
    Ok(Line { label, condition, figures: shown(parts.next().unwrap_or_default())? })
}

/// The table of a block's head.
fn table(head: &str, folder: &Path) -> anyhow::Result<String> {
    let mut lines = head.lines();
    let csv = Csv::read(&folder.join(lines.next().unwrap_or_default().trim()))?;
    let (mut all, mut corner) = (Vec::new(), "");
    let (mut columns, mut rows, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    for text in lines {
        let (word, value) = text.split_once(':').with_context(|| format!("`{text}` is no part of a block"))?;
        let value = value.trim();
        match word {
            "where" => all = condition(value)?,
            "corner" => corner = value,
            "column" => columns.push(line(value)?),
            "row" => rows.push(line(value)?),
            "columns" => columns.extend(keyed(&csv, value, &all)?),
            "rows" => rows.extend(keyed(&csv, value, &all)?),
            "cells" => cells = shown(value)?,
            _ => bail!("`{word}` is no part of a block"),
        }
    }
    ensure!(!columns.is_empty() && !rows.is_empty(), "the block has no rows or no columns");
    let mut table = format!("| {corner} |").replace("|  |", "| |");
    columns.iter().for_each(|column| table += &format!(" {} |", column.label));
    table += &format!("\n|{}\n", "---|".repeat(columns.len() + 1));
    for row in &rows {
        let _ = write!(table, "| {} |", row.label);
        for column in &columns {
            let mut found = Vec::new();
            for record in &csv.rows {
                let both = [&all, &row.condition, &column.condition];
                let mut meets = true;
                for condition in both {
                    meets = meets && csv.meets(record, condition)?;
                }
                if meets {
                    found.push(record);
                }
            }
            ensure!(found.len() < 2, "{} rows of the CSV are `{}`, `{}`", found.len(), row.label, column.label);
            let figures = [&row.figures, &column.figures, &cells].into_iter().find(|figures| !figures.is_empty());
            let figures = figures.context("the block names no figures")?;
            let mut texts = Vec::new();
            for Shown { name, factor, decimals } in figures {
                let at = csv.column(name)?;
                let value = found.first().and_then(|record| record.get(at)?.parse::<f64>().ok());
                texts.push(value.map_or("-".to_owned(), |value| format!("{:.*}", decimals, value * factor)));
            }
            let is_empty = found.is_empty() || texts.iter().all(|text| text == "-");
            table += &if is_empty { " |".to_owned() } else { format!(" {} |", texts.join(", ")) };
        }
        table.push('\n');
    }
    Ok(table)
}

/// A line for each value of a column of the CSV.
fn keyed<'a>(csv: &Csv, name: &'a str, all: &[(&str, String)]) -> anyhow::Result<Vec<Line<'a>>> {
    let label = |value: &str| value.rsplit('/').next().unwrap_or_default().to_owned();
    let line = |value: String| Line { label: label(&value), condition: vec![(name, value)], figures: Vec::new() };
    Ok(csv.values(name, all)?.into_iter().map(line).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CSV: &str = "scene,method,error\nroom/a,one,0.1\nroom/b,one,\nroom/a,two,0.25\nroom/b,two,3\nroom/b,two,4\n";

    fn page(block: &str) -> anyhow::Result<String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("t.csv"), CSV).unwrap();
        rendered(&format!("before\n<!-- table t.csv\n{block}-->\nold\n<!-- end -->\nafter\n"), folder.path())
    }

    #[test]
    fn a_block_holds_what_its_table_says_and_the_rest_of_the_page_stays() {
        let block =
            "columns: scene\nrow: 1 | method=one | error*100:0\nrow: 2 | method=two & scene=room/a\ncells: error:2\n";
        let expected = "| | a | b |\n|---|---|---|\n| 1 | 10 | |\n| 2 | 0.25 | |\n";
        assert_eq!(
            page(block).unwrap(),
            format!("before\n<!-- table t.csv\n{block}-->\n{expected}<!-- end -->\nafter\n")
        );
    }

    #[test]
    fn a_block_that_does_not_say_which_row_it_means_is_an_error() {
        let told = |block| format!("{:#}", page(block).unwrap_err());
        assert!(told("columns: scene\nrow: 2 | method=two\ncells: error:2\n").contains("2 rows of the CSV"));
        assert!(told("columns: place\nrow: 2 |\ncells: error:2\n").contains("no column `place`"));
        assert!(told("columns: scene\nrow: 2 |\ncells: error\n").contains("no decimals"));
    }
}
