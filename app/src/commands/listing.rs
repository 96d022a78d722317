//! `glint methods`, `glint scenes` and `glint doctor`: list what there is to choose from, for people or as JSON. The
//! page of the documentation that lists the parameters is made here, too.

use std::fmt::Write as _;

use param::{Field, Group, Kind, Value};
use render::Verdict;
use scene::{METHODS, Settings, five_mirrors};
use serde_json::json;

use crate::commands::truth;
use crate::shared::numbers::grouped;
use crate::system::environment;
use crate::system::terminal::{print, print_json};

/// All methods that `glint render --method` takes. The ray tracer is not one of the renderer's methods, and the viewer
/// does not offer it.
fn methods_with_help() -> impl Iterator<Item = (&'static str, &'static str)> {
    let of_renderer = METHODS.iter().map(|row| (row.name, row.help));
    of_renderer
        .chain([(truth::RAY_TRACE, "Reflected rays traced through the points on the CPU: the truth (glint render)")])
}

/// All parameters: the key of each, and its row in the table of parameters.
fn parameters() -> Vec<(String, Field)> {
    let settings = Settings::default();
    let groups = settings.groups();
    let keyed = |group: &'static Group| {
        group.fields.iter().map(|field| (format!("{}.{}", group.name, field.name), field.clone()))
    };
    groups.iter().flat_map(|params| keyed(params.group())).collect()
}

/// # Errors
/// If standard output cannot be written.
pub fn methods(as_json: bool) -> anyhow::Result<()> {
    if as_json {
        let methods: Vec<_> = methods_with_help().map(|(name, help)| json!({"name": name, "help": help})).collect();
        let parameters: Vec<_> = parameters().iter().map(|(key, field)| parameter_json(key, field)).collect();
        let listing = json!({"methods": methods, "parameters": parameters});
        return print_json(&listing);
    }
    let mut text = String::from("Reflection methods (--method NAME)\n");
    for (name, help) in methods_with_help() {
        let _ = writeln!(text, "  {name:<32}{help}");
    }
    text.push_str("\nParameters (--set KEY=VALUE)\n");
    for (key, field) in parameters() {
        let default = field.format(&field.default());
        let default = if default.is_empty() { "none".to_owned() } else { default };
        let _ = writeln!(text, "  {key:<32}{}; default {default}\n      {}", field.range_text(), field.help);
    }
    print(text.lines())
}

fn parameter_json(key: &str, field: &Field) -> serde_json::Value {
    let mut parameter = json!({
        "key": key,
        "type": kind_name(&field.kind),
        "unit": field.unit,
        "range": field.range_text(),
        "default": value_json(field, &field.default()),
        "help": field.help,
    });
    match &field.kind {
        Kind::U32 { min, max, .. } => {
            parameter["min"] = json!(min);
            parameter["max"] = json!(max);
        }
        Kind::F32 { min, max, .. } => {
            parameter["min"] = shortest(*min);
            parameter["max"] = shortest(*max);
        }
        Kind::Choice { names, .. } => parameter["choices"] = json!(names),
        Kind::Bytes { min, max, .. } => {
            parameter["min"] = json!(min.to_string());
            parameter["max"] = json!(max.to_string());
        }
        Kind::Bool { .. } | Kind::Color { .. } | Kind::Text { .. } => {}
    }
    parameter
}

fn kind_name(kind: &Kind) -> &'static str {
    match kind {
        Kind::Bool { .. } => "switch",
        Kind::U32 { .. } => "whole number",
        Kind::F32 { .. } => "number",
        Kind::Choice { .. } => "choice",
        Kind::Color { .. } => "colour",
        Kind::Bytes { .. } => "amount of memory",
        Kind::Text { .. } => "text",
    }
}

/// Converts a value to JSON: numbers and switches as such, all else as the text that `--set` takes.
pub fn value_json(field: &Field, value: &Value) -> serde_json::Value {
    match value {
        Value::Bool(value) => json!(value),
        Value::U32(value) => json!(value),
        Value::F32(value) => shortest(*value),
        Value::Choice(_) | Value::Color(_) | Value::Bytes(_) | Value::Text(_) => json!(field.format(value)),
    }
}

/// The shortest decimal that parses to the same f32: 0.1, not 0.10000000149011612.
fn shortest(value: f32) -> serde_json::Value {
    json!(value.to_string().parse::<f64>().unwrap_or(f64::from(value)))
}

/// # Errors
/// If standard output cannot be written.
pub fn scenes(as_json: bool) -> anyhow::Result<()> {
    let scenes: Vec<(String, &str)> =
        five_mirrors::Variant::ALL.into_iter().map(|mirror| (world::built_in_name(mirror), mirror.help())).collect();
    if as_json {
        let listing: Vec<_> = scenes.iter().map(|(name, help)| json!({"name": name, "help": help})).collect();
        return print_json(&json!({"scenes": listing}));
    }
    let mut text = String::new();
    for (name, help) in scenes {
        let _ = writeln!(text, "{name:<26}{help}");
    }
    text.push_str(
        "\nOpen one like a file: glint five-mirrors/sphere, or glint render five-mirrors/sphere -o sphere.png\n",
    );
    print(text.lines())
}

/// # Errors
/// If standard output cannot be written.
pub fn doctor(as_json: bool, wanted: Option<&str>) -> anyhow::Result<()> {
    let adapters = render::adapters(wanted);
    let is_one = |verdict| adapters.iter().any(|report| report.verdict == verdict);
    let display = ["WAYLAND_DISPLAY", "DISPLAY"]
        .into_iter()
        .find_map(|name| Some((name, std::env::var(name).ok().filter(|value| !value.is_empty())?)));
    let folder = environment::settings_folder().map(|folder| folder.display().to_string());
    if as_json {
        let adapter = |report: &render::AdapterReport| {
            json!({
                "name": report.name, "backend": report.backend, "kind": report.kind, "driver": report.driver,
                "features": {"atomics64": report.atomics64, "timestamps": report.timestamps},
                "limits": {"binding_bytes": report.max_binding_bytes, "buffer_bytes": report.max_buffer_bytes,
                    "texture_size": report.max_texture_size},
                "needs": report.needs.iter().map(|(need, has)| {
                    json!({"what": need.what, "least": need.least, "has": has})
                }).collect::<Vec<_>>(),
                "chosen": report.verdict == Verdict::Used, "why": report.why,
            })
        };
        let report = json!({
            "version": env!("GLINT_VERSION"),
            "threads": threads(),
            "adapters": adapters.iter().map(adapter).collect::<Vec<_>>(),
            "display": display.as_ref().map(|(name, value)| json!({"variable": name, "value": value})),
            "can_open_window": environment::has_display() && is_one(Verdict::Used),
            "settings_folder": folder,
        });
        return print_json(&report);
    }
    let mut lines = vec![format!("glint {}, {} threads", env!("GLINT_VERSION"), threads())];
    if adapters.is_empty() {
        lines.push(String::new());
        lines.push("No graphics adapter. Install a Vulkan driver; on Debian and Ubuntu mesa-vulkan-drivers runs without a GPU too.".into());
    } else if is_one(Verdict::Unable) && !is_one(Verdict::Used) {
        lines.extend([String::new(), "No adapter can be used.".into()]);
    } else if !is_one(Verdict::Used) {
        lines.extend([String::new(), format!("No adapter fits `{}`.", wanted.unwrap_or_default())]);
    }
    for report in &adapters {
        lines.extend([String::new(), format!("{} ({}, {})", report.name, report.backend, report.kind)]);
        let mut fact = |name: &str, value: &str| lines.push(format!("  {name:<14}{value}"));
        let mark = match report.verdict {
            Verdict::Used => "will be used",
            Verdict::Left => "not used",
            Verdict::Unable => "cannot be used",
        };
        fact("choice", &format!("{mark}: {}", report.why));
        fact("driver", &report.driver);
        fact("splatting", if report.atomics64 { "one pass, 64-bit atomics" } else { "two passes, 32-bit atomics" });
        let clock = match (report.timestamps, report.kind.as_str()) {
            (true, kind) if kind != "cpu" => "the GPU's timestamps",
            (false, kind) if kind != "cpu" => "the host's clock around each pass, in the window only at rest",
            _ => "the host's clock around each pass",
        };
        fact("pass times", clock);
        let (binding, buffer) = (mebibytes(report.max_binding_bytes), mebibytes(report.max_buffer_bytes));
        let size = report.max_texture_size;
        fact("limits", &format!("binding {binding} MiB, buffer {buffer} MiB, picture {size} x {size}"));
        for (index, (need, has)) in report.needs.iter().enumerate() {
            let name = if index == 0 { "needs" } else { "" };
            let (least, has) = (grouped(need.least), grouped(*has));
            fact(name, &format!("{least} {}, has {has}", need.what));
        }
    }
    let display = match display {
        Some((name, value)) => format!("{name}={value}"),
        None if environment::has_display() => "the desktop".into(),
        None => "none (neither DISPLAY nor WAYLAND_DISPLAY is set): `glint render` writes pictures instead".into(),
    };
    let folder = folder.unwrap_or_else(|| "none (no home folder)".into());
    lines.extend([String::new(), format!("{:<16}{display}", "display"), format!("{:<16}{folder}", "settings")]);
    print(lines)
}

fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

fn mebibytes(bytes: u64) -> String {
    grouped(bytes >> 20)
}

/// The content of docs/parameters.md, made from the table of parameters.
#[cfg(test)]
fn parameters_page() -> String {
    let mut page = String::from(
        "# Parameters\n\n\
         Written from the parameter table (`crates/scene/src/settings.rs`) by `UPDATE=1 cargo test --release -p glint parameters`. \
         A parameter is set by `--set KEY=VALUE` on the command line, by its control in the viewer's panel, and under \
         `[parameters]` in a scene file; a view copied from the viewer names those that differ from their defaults.\n",
    );
    for params in Settings::default().groups() {
        let group = params.group();
        let _ = writeln!(page, "\n## {}\n\n{}\n", group.name, group.help);
        page.push_str("| key | values | default | meaning |\n|---|---|---|---|\n");
        for field in &group.fields {
            let default = field.format(&field.default());
            let default = if default.is_empty() { "none".into() } else { format!("`{default}`") };
            let _ = writeln!(
                page,
                "| `{}.{}` | {} | {default} | {} |",
                group.name,
                field.name,
                field.range_text(),
                field.help
            );
        }
    }
    page
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use scene::Supply;

    use super::*;

    #[test]
    fn parameters_page_is_what_the_table_says() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/parameters.md");
        if std::env::var_os("UPDATE").is_some() {
            std::fs::write(&path, parameters_page()).unwrap();
        }
        let page = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            page == parameters_page(),
            "docs/parameters.md is out of date: UPDATE=1 cargo test --release -p glint parameters"
        );
    }

    #[test]
    fn every_parameter_is_listed_with_its_bounds() {
        let size = Settings::default().splat;
        let (key, field) = parameters().into_iter().find(|(key, _)| key == "splat.size").unwrap();
        let listed = parameter_json(&key, &field);
        assert_eq!(listed["default"], json!(f64::from(size.size)));
        assert_eq!(listed["min"], json!(0.05), "not 0.05000000074505806");
        assert_eq!(listed["unit"], "x spacing");
        assert_eq!(parameters().len(), Settings::default().all().len());
    }

    #[test]
    fn every_method_has_a_page_that_the_index_leads_to() {
        let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/methods");
        let index = std::fs::read_to_string(pages.join("README.md")).unwrap();
        let real = METHODS.iter().filter(|row| row.method.chosen() == row.method && row.supply != Supply::Nothing);
        for row in real {
            assert!(pages.join(format!("{}.md", row.name)).exists(), "{} has no page", row.name);
            assert!(index.contains(&format!("[{0}]({0}.md)", row.name)), "the index does not lead to {}", row.name);
        }
    }
}
