//! `glint ghosts`: points that a scanner saw in mirrors and panes, found and put back.

use anyhow::Context as _;
use cloud::Progress;
use codec::ExportFormat;
use ghost::{Found, Kind, Verdicts};
use glam::DVec3;
use scene::{Mirror, SceneFile, Shape, shown};
use serde_json::json;
use world::half_of;

use crate::commands::recording;
use crate::shared::export;
use crate::shared::ghost_arguments::GhostsArguments;
use crate::shared::ghosts::{self, Looked};
use crate::shared::numbers::grouped;
use crate::system::failure::{UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{picture_file, progress_bar};

/// Finds the ghosts, prints a report, and writes the points if a file is named. Returns exit status 2 if one of several
/// inputs cannot be read.
///
/// # Errors
/// Bad usage, no station, no input can be read, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &GhostsArguments) -> anyhow::Result<u8> {
    check_output(arguments)?;
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    let mut given = std::mem::take(&mut request.mirrors);
    if let Some(path) = &arguments.scene {
        let (file, _) = SceneFile::read(path)?;
        given.extend(file.mirrors);
    }
    recording::settings(&mut request).clone_from(&settings);
    let memory = half_of(settings.stream.host_bytes);
    request.leave_out_hidden(memory)?;
    terminal::warn(&request.warnings);
    terminal::warn(request.settings_without_cloud(memory));
    let mut failed = Few::of("that cannot be read");
    let sources = export::open(&request, memory, &mut failed).concat();
    let mut status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    if sources.is_empty() {
        return Ok(status);
    }
    let of_files = sources.iter().flat_map(|source| world::file_warnings(source.info()));
    terminal::warn(param::few(of_files.collect(), "warnings"));
    let (progress, finds) = (Progress::default(), given.is_empty());
    let given = given.into_iter().map(Found::given).collect();
    let look = || ghosts::look(&sources, &arguments.station, given, finds, &progress);
    let looked = progress_bar::watch("ghosts", &progress, look)?.ok_or(stream::Error::Cancelled)?;
    let Looked { stations, found, verdicts, warnings, missing, .. } = looked;
    terminal::warn(warnings);
    if missing > 0 {
        terminal::complain(&format!("ghosts are looked for in parts: {} points cannot be read", grouped(missing)));
        status = UNUSABLE;
    }
    let put_back = verdicts.count(Kind::Ghost) * u64::from(arguments.put_back);
    if let Some(output) = &arguments.output {
        let progress = Progress::default();
        let write = || ghosts::write(&sources, &verdicts, output, arguments.put_back, memory, &progress);
        let (warnings, missing) = progress_bar::watch("writing", &progress, write)?.ok_or(stream::Error::Cancelled)?;
        terminal::warn(warnings);
        if let Some(lack) = export::lack(output, missing) {
            terminal::complain(&lack);
            status = UNUSABLE;
        }
    }
    report(arguments, &stations, &found, &verdicts, put_back)?;
    Ok(status)
}

fn check_output(arguments: &GhostsArguments) -> anyhow::Result<()> {
    let Some(output) = &arguments.output else {
        return match arguments.put_back {
            true => Err(usage("--put-back: name the file to write the points to with -o")),
            false => Ok(()),
        };
    };
    if ExportFormat::of(output).is_none() {
        let expected = "the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv, which is what will be in it";
        return Err(usage(format!("{}: {expected}", shown(output))));
    }
    if output.symlink_metadata().is_ok() {
        return Err(usage(format!("{}: a file of this name is there", shown(output))));
    }
    picture_file::check_place(output)
}

/// The shape of a mirror in numbers.
fn parameters(mirror: &Mirror) -> serde_json::Value {
    let Mirror { shape, position, rotation, size, .. } = mirror;
    let mut parameters = json!({
        "position": position.to_array(), "rotation": rotation.to_array(), "size": size, "name": mirror.name,
    });
    match shape {
        Shape::Plane { height } => {
            parameters["normal"] = json!((*rotation * DVec3::Z).to_array());
            parameters["height"] = json!(height);
        }
        Shape::Sphere => parameters["radius"] = json!(size),
        Shape::Cylinder { height } => {
            parameters["axis"] = json!((*rotation * DVec3::Z).to_array());
            parameters["radius"] = json!(size);
            parameters["height"] = json!(height);
        }
        Shape::Paraboloid { focal_length } => parameters["focal_length"] = json!(focal_length),
        Shape::Torus { tube } => parameters["tube"] = json!(tube),
        Shape::Blob | Shape::Coral | Shape::Mesh(_) => {}
    }
    parameters
}

fn report(
    arguments: &GhostsArguments,
    stations: &[DVec3],
    found: &[Found],
    verdicts: &Verdicts,
    put_back: u64,
) -> anyhow::Result<()> {
    let (ghosts, undecided) = (verdicts.count(Kind::Ghost), verdicts.count(Kind::Undecided));
    if arguments.json {
        let mirror = |(index, found): (usize, &Found)| {
            let (points, residual) = verdicts.of_mirror(index);
            let mirror = &found.reflector.mirror;
            json!({
                "kind": mirror.shape.name(), "parameters": parameters(mirror), "points": points, "residual": residual,
                "reason": found.reason,
            })
        };
        let mirrors: Vec<_> = found.iter().enumerate().map(mirror).collect();
        let stations: Vec<[f64; 3]> = stations.iter().map(|station| station.to_array()).collect();
        return terminal::print_json(&json!({
            "stations": stations, "mirrors": mirrors, "ghosts": ghosts, "undecided": undecided, "put_back": put_back,
        }));
    }
    let place = |place: &DVec3| format!("({:.2}, {:.2}, {:.2})", place.x, place.y, place.z);
    let places: Vec<String> = stations.iter().map(place).collect();
    let mut lines = vec![format!("  stations     {}", places.join(", "))];
    for (index, found) in found.iter().enumerate() {
        let (points, residual) = verdicts.of_mirror(index);
        let mirror = &found.reflector.mirror;
        let residual = residual.map_or("-".into(), |residual| format!("{residual:.4}"));
        lines.push(format!(
            "  mirror {:<5} {} at {}, size {:.3}: {} ghosts, {residual} from surfaces; {}",
            index + 1,
            mirror.shape.name(),
            place(&mirror.position),
            mirror.size,
            grouped(points),
            found.reason
        ));
    }
    lines.extend(found.is_empty().then(|| "  mirrors      none found".to_owned()));
    lines.push(format!("  ghosts       {}", grouped(ghosts)));
    lines.push(format!("  undecided    {}", grouped(undecided)));
    lines.extend(arguments.put_back.then(|| format!("  put back     {}", grouped(put_back))));
    terminal::print(lines)
}
