//! Reads rows back from a table that a study wrote, so that charts can be drawn again without a measurement.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context as _, anyhow};

use crate::plan::{Case, Plan};
use crate::results::{FRAME_MS, METHOD_MS, Machine, Row, Spread, figures, is_variable};

/// Reads the rows of `results.csv`, the settings of `plan` among them. Times of passes and of stages are not in a
/// table. Columns that the program does not know are left out.
///
/// # Errors
/// The text is no table, or a row is no setting of the plan.
pub fn read(plan: &Plan, text: &str) -> anyhow::Result<Vec<Row>> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names: HashMap<String, usize> =
        reader.headers()?.iter().enumerate().map(|(index, name)| (name.to_owned(), index)).collect();
    let cases = plan.cases();
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record?;
        let cell = |name: &str| {
            let text = names.get(name).and_then(|index| record.get(*index));
            text.filter(|text| !text.is_empty())
        };
        let number = |name: &str| cell(name).and_then(|text| text.parse::<f64>().ok());
        let is_case = |case: &&Case| {
            let is_scene = cell("scene").is_some_and(|scene| is_same_scene(&case.scene, scene));
            let is_value = |(key, value): &(String, String)| {
                let column = if is_variable(key) { format!("{{{key}}}") } else { key.clone() };
                cell(&column).is_some_and(|text| is_same_value(value, text))
            };
            let is_group = cell("group") == Some(plan.groups[case.group].name.as_str());
            is_group && is_scene && cell("method") == Some(&case.method) && case.swept.iter().all(is_value)
        };
        let line = record.position().map_or(0, csv::Position::line);
        let case = cases.iter().find(is_case).with_context(|| format!("line {line} is no setting of the plan"))?;
        let spread = |name: &str| {
            let [median, low, high] = ["", "_low", "_high"].map(|suffix| number(&format!("{name}{suffix}")));
            Some(Spread { median: median?, low: low?, high: high? })
        };
        let part = |name: &String| Some((name.clone(), spread(name)?));
        let known = figures().iter().filter(|figure| ![FRAME_MS, METHOD_MS].contains(&figure.name.as_str()));
        let text = |name: &str| cell(name).unwrap_or_default().to_owned();
        let repeats = number("repeats").ok_or_else(|| anyhow!("line {line} has no number of rounds"))?;
        rows.push(Row {
            // The name of a file is the table's: the plan has its full path.
            case: Case { scene: text("scene"), ..case.clone() },
            group: plan.groups[case.group].name.clone(),
            set: text("set"),
            points: number("points").map(|points| points as u64),
            repeats: repeats as usize,
            frame_ms: spread(FRAME_MS),
            method_ms: spread(METHOD_MS),
            parts: plan.parts.iter().filter_map(|of| part(&of.name)).collect(),
            passes: Vec::new(),
            stages: Vec::new(),
            figures: known
                .filter_map(|figure| Some((figure.name.clone(), number(&figure.name)?)))
                .collect::<BTreeMap<_, _>>(),
            machine: Machine {
                adapter: text("adapter"),
                adapter_kind: text("adapter_kind"),
                clock: text("clock"),
                commit: text("commit"),
            },
            error: cell("error").map(str::to_owned),
        });
    }
    Ok(rows)
}

/// Whether a scene of a plan is that of a table: files by their names, because a table may come from another folder.
fn is_same_scene(planned: &str, told: &str) -> bool {
    let name = |scene: &str| std::path::Path::new(scene).file_name().map(std::ffi::OsStr::to_owned);
    planned == told || (planned.ends_with(".toml") && told.ends_with(".toml") && name(planned) == name(told))
}

fn is_same_value(planned: &str, told: &str) -> bool {
    let numbers = planned.parse::<f64>().ok().zip(told.parse::<f64>().ok());
    planned == told || numbers.is_some_and(|(planned, told)| planned == told)
}
