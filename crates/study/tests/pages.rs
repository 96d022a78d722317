//! Pages and charts in docs are what the tables beside them say. `UPDATE=1` writes them anew.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use study::chart::{self, Chart};
use study::{Plan, pages, report, table, targets};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

fn updates() -> bool {
    std::env::var_os("UPDATE").is_some()
}

/// The files of a folder, and whether each is a folder, in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Writes what differs if that is asked for; else returns the file's name.
fn compare(path: &Path, made: &str) -> Option<String> {
    let known = std::fs::read_to_string(path).unwrap();
    if known == made {
        return None;
    }
    if updates() {
        std::fs::write(path, made).unwrap();
        return None;
    }
    let line = known.lines().zip(made.lines()).find(|(known, made)| known != made);
    Some(format!("{}: {line:?}", path.display()))
}

#[test]
fn tables_in_pages_are_those_of_the_csv_that_they_name() {
    let folders = [docs().join(".."), docs(), docs().join("methods"), docs().join("study")];
    let pages =
        folders.iter().flat_map(|folder| files(folder)).filter(|path| path.extension().is_some_and(|ext| ext == "md"));
    let (mut wrong, mut blocks) = (Vec::new(), 0);
    for path in pages {
        let page = std::fs::read_to_string(&path).unwrap();
        let made = pages::rendered(&page, path.parent().unwrap())
            .unwrap_or_else(|error| panic!("{}: {error:#}", path.display()));
        blocks += page.matches("\n<!-- table ").count();
        wrong.extend(compare(&path, &made));
    }
    assert!(blocks > 0 && wrong.is_empty(), "differ from their CSV, UPDATE=1 writes them anew: {wrong:#?}");
}

#[test]
fn charts_and_reports_are_those_of_the_csv_beside_them() {
    let (mut wrong, mut known) = (Vec::new(), 0);
    for folder in files(&docs().join("study")).into_iter().filter(|path| path.join("results.csv").exists()) {
        let plan = Plan::read(&folder.join("plan.toml")).unwrap_or_else(|error| panic!("{error}"));
        let text = std::fs::read_to_string(folder.join("results.csv")).unwrap();
        let rows = table::read(&plan, &text).unwrap_or_else(|error| panic!("{}: {error:#}", folder.display()));
        let file = |chart: &Chart| folder.join(format!("{}.svg", chart.name));
        let shown: Vec<Chart> = chart::charts(&plan, &rows).into_iter().filter(|chart| file(chart).exists()).collect();
        let is_chart = |path: &PathBuf| shown.iter().any(|chart| file(chart) == *path);
        let drawn = files(&folder).into_iter().filter(|path| path.extension().is_some_and(|ext| ext == "svg"));
        let others = drawn.filter(|path| !is_chart(path));
        wrong.extend(others.map(|path| format!("{}: the table has no such chart", path.display())));
        for chart in &shown {
            known += 1;
            wrong.extend(compare(&file(chart), &chart.svg().unwrap()));
        }
        let report = folder.join("index.html");
        if report.exists() {
            wrong.extend(compare(&report, &report::html(&plan, &rows, &shown, &[])));
        }
    }
    assert!(known > 20 && wrong.is_empty(), "differ from their CSV, UPDATE=1 draws them anew: {wrong:#?}");
}

#[test]
fn what_an_oracle_would_choose_follows_from_all_settings_of_the_plan() {
    let folder = docs().join("study/oracle");
    let plan = Plan::read(&folder.join("plan.toml")).unwrap_or_else(|error| panic!("{error}"));
    let text = std::fs::read_to_string(folder.join("results.csv")).unwrap();
    let rows = table::read(&plan, &text).unwrap();
    let made = targets::oracle_table(&targets::judged(&rows));
    assert_eq!(compare(&folder.join("targets.csv"), &made), None, "UPDATE=1 writes it anew");
}
