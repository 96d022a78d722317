//! Makes a page of a study that needs no network and opens in any browser: charts, bounds, pictures and the table.

use std::fmt::Write as _;

use crate::chart::{Chart, number};
use crate::plan::{Bound, Case, Group, Pictures, Plan, TARGET};
use crate::results::{self, Cell, Row};

const STYLE: &str = "
body { font: 15px/1.45 sans-serif; color: #222; background: #fff; margin: 2em auto; padding: 0 1em; max-width: 72em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.25em; margin-top: 2em; } h3 { font-size: 1em; }
figure { margin: 1em 0 2em; } figcaption { color: #555; }
figure img { max-width: 100%; } img.pixels { image-rendering: pixelated; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; }
th, td { padding: 2px 8px; border-bottom: 1px solid #ddd; text-align: left; white-space: nowrap; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
#results th { cursor: pointer; } .fails { color: #b00020; font-weight: bold; }
";

/// Sorts the table by the column that is clicked, numbers as numbers; another click reverses the order.
const SCRIPT: &str = "
const table = document.getElementById('results');
table.querySelectorAll('th').forEach((head, column) => head.addEventListener('click', () => {
  const up = head.dataset.up !== 'true';
  table.querySelectorAll('th').forEach(other => delete other.dataset.up);
  head.dataset.up = up;
  const value = row => row.cells[column].textContent;
  const rows = [...table.tBodies[0].rows].sort((a, b) => {
    const [x, y] = [value(a), value(b)];
    const order = x !== '' && y !== '' && !isNaN(x) && !isNaN(y) ? x - y : x.localeCompare(y);
    return up ? order : -order;
  });
  table.tBodies[0].append(...rows);
}));
";

/// The page. Charts are beside it as `NAME.svg`; `pictures` are file names relative to the page's folder with the
/// settings that they show.
pub fn html(plan: &Plan, rows: &[Row], charts: &[Chart], pictures: &[(String, &Row)]) -> String {
    let mut page = String::new();
    let title = escaped(&plan.title);
    // Writing to a string cannot fail.
    let _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    );
    for paragraph in plan.about.split("\n\n").filter(|text| !text.trim().is_empty()) {
        let _ = writeln!(page, "<p>{}</p>", escaped(paragraph.trim()));
    }
    let _ = writeln!(page, "<p>{}</p>", escaped(&measured_on(plan, rows)));
    let bounds = bounds(plan, rows);
    contents(&mut page, charts, !bounds.is_empty(), !pictures.is_empty());
    if !bounds.is_empty() {
        page += "<h2 id=\"bounds\">Bounds</h2>\n<div class=\"wide\"><table>\n<tr><th>case</th><th>method</th><th>figure</th>\
                 <th>worst</th><th>at</th><th>bound</th><th>holds</th><th>what would mend it</th></tr>\n";
        bounds.iter().for_each(|bound| page += bound);
        page += "</table></div>\n";
    }
    targets(&mut page, rows);
    if !charts.is_empty() {
        page += "<h2>Charts</h2>\n";
    }
    for chart in charts {
        let (name, title) = (&chart.name, escaped(&chart.title));
        let _ = writeln!(
            page,
            "<figure id=\"{name}\">\n<img src=\"{name}.svg\" alt=\"{title}\">\n<figcaption>{title} (<a href=\"{name}.svg\">SVG</a>, <a href=\"{name}.png\">PNG</a>)</figcaption>\n</figure>"
        );
    }
    if !pictures.is_empty() {
        page += "<h2 id=\"pictures\">Pictures</h2>\n";
        if plan.groups.iter().any(|group| group.pictures == Pictures::Worst) {
            page += "<p>Drawn, traced, and their difference: black where there is none, white from a colour difference (CIEDE2000) \
                     of 25.</p>\n";
        }
    }
    for (name, row) in pictures {
        let values: Vec<String> = row.case.swept.iter().map(|(key, value)| format!("{key} {value}")).collect();
        let caption = format!("{}: {} {} {}", row.group, row.case.scene, row.case.method, values.join(", "));
        let caption = escaped(caption.trim_end());
        let _ = writeln!(
            page,
            "<figure>\n<img class=\"pixels\" src=\"{name}\" alt=\"{caption}\">\n<figcaption>{caption}</figcaption>\n</figure>"
        );
    }
    about_groups(&mut page, plan);
    table(&mut page, plan, rows);
    let _ = write!(page, "<script>{SCRIPT}</script>\n</body>\n</html>\n");
    page
}

fn measured_on(plan: &Plan, rows: &[Row]) -> String {
    let mut adapters: Vec<String> = Vec::new();
    for machine in rows.iter().map(|row| &row.machine) {
        let adapter = format!(
            "{} ({}, {} clock, glint {})",
            machine.adapter, machine.adapter_kind, machine.clock, machine.commit
        );
        if !adapters.contains(&adapter) {
            adapters.push(adapter);
        }
    }
    let failed = rows.iter().filter(|row| row.error.is_some()).count();
    let failures = if failed > 0 { format!(" {failed} of them failed.") } else { String::new() };
    format!(
        "{} settings, times are medians of frames from scratch in {} rounds, with the least and the most, on {}.{failures}",
        rows.len(),
        plan.repeats,
        adapters.join("; ")
    )
}

fn contents(page: &mut String, charts: &[Chart], has_bounds: bool, has_pictures: bool) {
    page.push_str("<ul>\n");
    let mut entry = |id: &str, text: &str| {
        let _ = writeln!(page, "<li><a href=\"#{id}\">{}</a></li>", escaped(text));
    };
    if has_bounds {
        entry("bounds", "Bounds");
    }
    charts.iter().for_each(|chart| entry(&chart.name, &chart.title));
    if has_pictures {
        entry("pictures", "Pictures");
    }
    entry("table", "Table");
    page.push_str("</ul>\n");
}

/// How `auto` did for its targets, if there are any.
fn targets(page: &mut String, rows: &[Row]) {
    let judged = crate::targets::judged(rows);
    if judged.is_empty() {
        return;
    }
    let _ = write!(
        page,
        "<h2 id=\"targets\">Targets</h2>\n<p>{}</p>\n<div class=\"wide\"><table>\n<tr><th>scene</th><th>target</th><th>ms</th>\
         <th>error</th><th>kept</th><th>best setting's</th><th>ratio</th><th>good</th><th>chosen</th></tr>\n",
        escaped(&crate::targets::summary(&judged))
    );
    for judged in &judged {
        let unit = if judged.is_time { " ms" } else { "" };
        let target = judged.row.case.swept_value(TARGET).unwrap_or_default();
        let named = format!("{target} ({}{unit})", number(judged.target));
        let answer = |is_so: bool| if is_so { "yes" } else { "<span class=\"fails\">no</span>" };
        let best = judged.best.map_or("no other keeps to it".to_owned(), number);
        let ratio = judged.ratio().map_or(String::new(), number);
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td>{}</td>\
             <td class=\"number\">{best}</td><td class=\"number\">{ratio}</td><td>{}</td><td>{}</td></tr>",
            escaped(&judged.row.case.scene),
            escaped(if judged.is_time { &named } else { target }),
            number(judged.milliseconds),
            number(judged.error),
            answer(judged.is_kept),
            if judged.best.is_some() { answer(judged.is_good()) } else { "" },
            escaped(&judged.row.set)
        );
    }
    page.push_str("</table></div>\n");
}

fn about_groups(page: &mut String, plan: &Plan) {
    let described: Vec<&Group> = plan.groups.iter().filter(|group| !group.about.is_empty()).collect();
    if !described.is_empty() {
        page.push_str("<h2>Groups</h2>\n<dl>\n");
        for group in described {
            let _ = writeln!(page, "<dt><b>{}</b></dt><dd>{}</dd>", escaped(&group.name), escaped(&group.about));
        }
        page.push_str("</dl>\n");
    }
}

fn table(page: &mut String, plan: &Plan, rows: &[Row]) {
    page.push_str(
        "<h2 id=\"table\">Table</h2>\n<p>Click on a name to sort. The same as results.csv and results.json.</p>\n",
    );
    page.push_str("<div class=\"wide\"><table id=\"results\">\n");
    let all: Vec<Vec<(String, Cell)>> = rows.iter().map(|row| results::cells(plan, row)).collect();
    // Columns that are empty throughout are only in the files.
    let columns = all.first().map_or(0, Vec::len);
    let shown: Vec<usize> =
        (1..columns).filter(|column| all.iter().any(|cells| cells[*column].1 != Cell::Empty)).collect();
    page.push_str("<thead><tr>");
    for column in &shown {
        let _ = write!(page, "<th>{}</th>", escaped(&all[0][*column].0));
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for cells in &all {
        page.push_str("<tr>");
        for column in &shown {
            let _ = match &cells[*column].1 {
                Cell::Number(value) => write!(page, "<td class=\"number\">{}</td>", plain_number(*value)),
                cell => write!(page, "<td>{}</td>", escaped(&cell.text())),
            };
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</tbody>\n</table></div>\n");
}

/// A number with 4 significant digits, whole ones in full.
fn plain_number(value: f64) -> String {
    if value.fract() == 0.0 { value.to_string() } else { format!("{:.3e}", value).parse().unwrap_or(value).to_string() }
}

/// A line of the table of bounds for each group with a bound and each method to which it applies.
fn bounds(plan: &Plan, rows: &[Row]) -> Vec<String> {
    let mut lines = Vec::new();
    let cases = plan.cases();
    for (index, group) in plan.groups.iter().enumerate() {
        let Some(bound) = &group.bound else { continue };
        for method in group.methods.iter().filter(|method| bound.methods.is_empty() || bound.methods.contains(method)) {
            let is_of = |case: &Case| case.group == index && case.method == *method;
            let planned: Vec<&Case> = cases.iter().filter(|case| is_of(case)).collect();
            let of_method: Vec<&Row> = rows.iter().filter(|row| is_of(&row.case)).collect();
            let (worst, at, verdict) = match judge(bound, &planned, &of_method) {
                Verdict::Unknown => (String::new(), String::new(), "<span class=\"fails\">not yet known</span>"),
                Verdict::Holds { worst, at } => (number(worst), at, "yes"),
                Verdict::Fails { worst, at } if worst.is_nan() => {
                    ("not measured".to_owned(), at, "<span class=\"fails\">no</span>")
                }
                Verdict::Fails { worst, at } => (number(worst), at, "<span class=\"fails\">no</span>"),
            };
            let label = plan.figure(&bound.figure).map_or(bound.figure.clone(), |figure| figure.label);
            lines.push(format!(
                "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"number\">{worst}</td><td>{}</td><td>{}</td><td>{verdict}</td>\
                 <td style=\"white-space: normal\">{}</td></tr>\n",
                escaped(&group.name),
                escaped(method),
                escaped(&label),
                escaped(&at),
                escaped(&bound_words(bound)),
                escaped(&group.mends)
            ));
        }
    }
    lines
}

/// Whether a bound holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Some of its settings have not been measured, and none breaks it; or it applies to no setting.
    Unknown,
    /// The value nearest to the bound, and its setting: the scene if there are several, and the swept values.
    Holds {
        worst: f64,
        at: String,
    },
    Fails {
        worst: f64,
        at: String,
    },
}

/// Judges a bound by the rows of the settings `planned` of its group. A setting that failed, or in which the figure
/// could not be measured, breaks it, too: then `worst` is NaN.
pub fn judge(bound: &Bound, planned: &[&Case], rows: &[&Row]) -> Verdict {
    // Times are measured after the picture was judged.
    let is_of_passes = [results::METHOD_MS, results::FRAME_MS].contains(&bound.figure.as_str());
    // The figures of a plan's own are sums of passes.
    let is_of_time = is_of_passes || results::figure(&bound.figure).is_none();
    let is_measured = |row: &Row| !is_of_time || row.repeats > 0 || row.error.is_some();
    let about: Vec<&&Row> = rows.iter().filter(|row| bound.is_about(&row.case) && is_measured(row)).collect();
    let is_complete = about.len() == planned.iter().filter(|case| bound.is_about(case)).count();
    let has_scenes = planned.iter().any(|case| case.scene_pattern != planned[0].scene_pattern);
    let sign = if bound.at_least.is_some() { 1.0 } else { -1.0 };
    let value = |row: &Row| row.value(&bound.figure).filter(|_| row.error.is_none());
    let order = |row: &&&&Row| value(row).map_or(f64::NEG_INFINITY, |value| sign * value);
    let Some(row) = about.iter().min_by(|a, b| order(a).total_cmp(&order(b))) else { return Verdict::Unknown };
    let scene = has_scenes.then(|| row.case.scene.clone()).into_iter();
    let at: Vec<String> = scene.chain(row.case.swept.iter().map(|(key, value)| format!("{key} {value}"))).collect();
    let at = at.join(", ");
    match value(row) {
        Some(worst) if bound.holds(worst) && is_complete => Verdict::Holds { worst, at },
        Some(worst) if bound.holds(worst) => Verdict::Unknown,
        Some(worst) => Verdict::Fails { worst, at },
        None => Verdict::Fails { worst: f64::NAN, at },
    }
}

fn bound_words(bound: &Bound) -> String {
    let least = bound.at_least.map(|least| format!("at least {}", number(least)));
    let most = bound.at_most.map(|most| format!("at most {}", number(most)));
    let from = bound.from.map(|from| format!("from {}", number(from)));
    let up_to = bound.up_to.map(|up_to| format!("up to {}", number(up_to)));
    [least, most, from, up_to].into_iter().flatten().collect::<Vec<_>>().join(" ")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Run;

    const PLAN: &str = "title = \"A <b> & c\"\nabout = \"one\\n\\ntwo\"\n[[group]]\nname = \"tube\"\nmends = \"newton\"\n\
                        scenes = [\"five-mirrors/sphere\"]\nmethods = [\"sscr\"]\nsweep = { \"splat.size\" = [1, 2, 3] }\n\
                        bound = { figure = \"coverage\", at_least = 0.9, up_to = 2 }";

    fn rows(plan: &Plan, coverage: [Option<f64>; 3]) -> Vec<Row> {
        let runs = coverage.iter().enumerate().map(|(case, value)| Run {
            case,
            figures: value.map(|value| ("coverage".to_owned(), value)).into_iter().collect(),
            ..Run::default()
        });
        results::rows(plan, &plan.cases(), &runs.collect::<Vec<_>>())
    }

    #[test]
    fn a_bound_holds_if_its_worst_value_does() {
        let plan = Plan::parse("test", PLAN).unwrap();
        let bound = plan.groups[0].bound.as_ref().unwrap();
        let cases = plan.cases();
        let planned: Vec<&Case> = cases.iter().collect();
        let judged = |coverage| {
            let rows = rows(&plan, coverage);
            judge(bound, &planned, &rows.iter().collect::<Vec<_>>())
        };
        let at = "splat.size 2".to_owned();
        // The third is outside the bound's range.
        assert_eq!(judged([Some(0.99), Some(0.95), Some(0.1)]), Verdict::Holds { worst: 0.95, at: at.clone() });
        assert_eq!(judged([Some(0.99), Some(0.8), Some(1.0)]), Verdict::Fails { worst: 0.8, at: at.clone() });
        assert!(matches!(judged([Some(0.99), None, Some(1.0)]), Verdict::Fails { worst, .. } if worst.is_nan()));
        assert_eq!(judge(bound, &planned, &[]), Verdict::Unknown);
        // Settings that are still to come may break it, but cannot mend it.
        let begun = |coverage| judge(bound, &planned, &[&rows(&plan, [Some(coverage), None, None])[0]]);
        assert_eq!(begun(0.99), Verdict::Unknown);
        assert_eq!(begun(0.5), Verdict::Fails { worst: 0.5, at: "splat.size 1".into() });
    }

    #[test]
    fn a_bound_of_several_scenes_tells_which() {
        let plan = Plan::parse("test", &PLAN.replace("[\"five-mirrors/sphere\"]", "[\"one\", \"two\"]")).unwrap();
        let cases = plan.cases();
        let run = |case: usize| {
            let coverage = if case == 4 { 0.5 } else { 1.0 };
            Run { case, figures: [("coverage".to_owned(), coverage)].into(), ..Run::default() }
        };
        let rows = results::rows(&plan, &cases, &(0..6).map(run).collect::<Vec<_>>());
        let bound = plan.groups[0].bound.as_ref().unwrap();
        let judged = judge(bound, &cases.iter().collect::<Vec<_>>(), &rows.iter().collect::<Vec<_>>());
        assert_eq!(judged, Verdict::Fails { worst: 0.5, at: "two, splat.size 2".into() });
    }

    #[test]
    fn the_page_needs_no_network_and_escapes_what_it_is_told() {
        let plan = Plan::parse("test", PLAN).unwrap();
        let rows = rows(&plan, [Some(0.99), Some(0.8), Some(1.0)]);
        let charts = crate::chart::charts(&plan, &rows);
        assert_eq!(charts.len(), 1);
        let page = html(&plan, &rows, &charts, &[("pictures/tube-1.png".into(), &rows[1])]);
        assert!(page.contains("A &lt;b&gt; &amp; c") && !page.contains("A <b>"), "{page}");
        assert!(page.contains("<p>one</p>") && page.contains("newton") && page.contains(">no</span>"), "{page}");
        assert!(
            page.contains(&format!("src=\"{}.svg\"", charts[0].name)) && page.contains("src=\"pictures/tube-1.png\""),
            "{page}"
        );
        assert!(!page.contains("http:") && !page.contains("https:"), "{page}");
        assert_eq!(page.matches("<tr>").count(), 1 + 1 + 1 + 3, "bounds, results");
    }
}
