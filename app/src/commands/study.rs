//! `glint study`: measures the settings of a plan against one another. The crate `study` has the plans, runs and
//! charts; this file adds the command line, the scenes and the progress.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use anyhow::anyhow;
use cloud::Progress;
use render::Gpu;
use scene::{Camera, Preset, Settings, StandardView};
use study::runner::{self, State};
use study::{Folder, HoldOut, Plan, Ruler, SceneFiles, Scenes, Shard, Subject, stability};

use crate::commands::subject::{self, LoadedSubject};
use crate::commands::{made_scan, recording, scans, truth};
use crate::shared::command_line::{MergeArguments, StudyArguments, StudyCommand, quoted};
use crate::shared::numbers::grouped;
use crate::system::failure::usage;
use crate::system::interrupt;
use crate::system::progress_bar::Bar;
use crate::system::terminal::{complain, print, warn};

/// Runs what the command line asks for. Returns exit status 1 if settings failed; the table of results names them.
///
/// # Errors
/// Fails on bad usage, on a wrong plan, on scenes that do not exist, on the folder of another study, or without an
/// adapter.
pub fn run(arguments: &StudyArguments) -> anyhow::Result<u8> {
    match &arguments.command {
        Some(StudyCommand::Merge(arguments)) => return merge(arguments),
        Some(StudyCommand::Scan(arguments)) => return made_scan::run(arguments),
        None => {}
    }
    if arguments.list {
        return list();
    }
    let (Some(name), Some(output)) = (&arguments.plan, &arguments.output) else {
        return Err(usage("study: a plan and -o DIR are missing; `glint study --list` lists the built-in plans"));
    };
    let plan = changed(plan(name)?, arguments)?;
    runner::check_scenes(&plan, &Inputs)?;
    let about = format!("To measure this again: {}", command(name, arguments));
    let mut folder = Folder::open(output, plan, &about)?;
    folder.keep_scenes(scene_files(&folder.plan)?)?;
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    let bar = Bar::counted();
    let mut show = |state: State<'_>| {
        bar.set(state.done as u64, state.total as u64);
        let next = state.next.map(|case| {
            let values: Vec<String> = case.swept.iter().map(|(key, value)| format!("{key} {value}")).collect();
            format!("{} {} {}", case.scene, case.method, values.join(", "))
        });
        bar.set_task(&next.unwrap_or_default());
        if interrupt::is_wanted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let shard = arguments.shard.unwrap_or(Shard::WHOLE);
    let outcome = runner::run(&mut folder, shard, &gpu, &Inputs, env!("GLINT_VERSION"), &mut show)?;
    bar.end();
    interrupt::check()?;
    if outcome.redone > 0 {
        warn([format!("{} settings were begun by another version or clock, and were measured anew", outcome.redone)]);
    }
    let page = output.join("index.html");
    let made = if outcome.runs == 0 { ", nothing was left to do" } else { "" };
    print([format!("{} settings in {}{made}", outcome.settings, scene::shown(page))])?;
    Ok(status(&folder, outcome.failed))
}

/// The checksums of the files that the scenes of a plan are read from.
///
/// # Errors
/// Ctrl-C.
fn scene_files(plan: &Plan) -> anyhow::Result<SceneFiles> {
    let scenes: BTreeSet<String> = plan.cases().into_iter().map(|case| case.scene).collect();
    let of_files = scenes.into_iter().filter(|scene| !stability::is_case(scene));
    let files = of_files.map(|scene| {
        let files = recording::checksums(&world::resolve_written(std::slice::from_ref(&scene)))?;
        Ok((scene, files))
    });
    files.filter(|found| !found.as_ref().is_ok_and(|(_, files)| files.is_empty())).collect()
}

/// Reports settings that failed, and returns the exit status.
fn status(folder: &Folder, failed: usize) -> u8 {
    if failed > 0 {
        let table = folder.path.join("results.csv");
        let table = scene::shown(table);
        complain(&format!("settings that failed: {failed}; {table} says why; run it again to try them again"));
    }
    u8::from(failed > 0)
}

fn merge(arguments: &MergeArguments) -> anyhow::Result<u8> {
    let count = arguments.folders.len();
    let about = format!("Joined from {count} folder{}", if count == 1 { "" } else { "s" });
    let joined = Folder::merge(&arguments.folders, &arguments.output, &about)?;
    runner::copy_pictures(&arguments.folders, &joined)?;
    runner::write(&joined)?;
    let rows = study::results::rows(&joined.plan, &joined.cases, &joined.runs);
    let complete = rows.iter().filter(|row| row.repeats == joined.plan.repeats as usize || row.error.is_some()).count();
    let missing = joined.cases.len() - complete;
    if missing > 0 {
        warn([format!("{missing} of {} settings are missing or not finished", joined.cases.len())]);
    }
    print([format!("{} settings in {}", rows.len(), scene::shown(arguments.output.join("index.html")))])?;
    Ok(status(&joined, rows.iter().filter(|row| row.error.is_some()).count()))
}

fn list() -> anyhow::Result<u8> {
    let mut lines = Vec::new();
    for name in study::plan_names() {
        if let Some(plan) = study::built_in_plan(name) {
            let plan = plan?;
            lines.push(format!("{name:<16}{}, {} settings", plan.title, plan.cases().len()));
        }
    }
    print(lines)?;
    Ok(0)
}

/// Returns a built-in plan, or reads one from a file.
fn plan(name: &OsStr) -> anyhow::Result<Plan> {
    if let Some(plan) = name.to_str().and_then(study::built_in_plan) {
        return Ok(plan?);
    }
    let path = Path::new(name);
    if path.exists() || path.extension().is_some() {
        return Ok(Plan::read(path)?);
    }
    let names: Vec<&str> = study::plan_names().collect();
    let name = scene::shown(path);
    let near = param::nearest(&name, names.iter().copied());
    let hint = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
    Err(usage(format!("{name}: no such file or built-in plan{hint}; built-in plans: {}", names.join(", "))))
}

/// Returns the plan with the values that the command line gives in place of its own.
fn changed(mut plan: Plan, arguments: &StudyArguments) -> anyhow::Result<Plan> {
    let kept = |groups: &[&str], what: &str| {
        if !groups.is_empty() {
            warn([format!("{what}: swept by the plan's group {}, and stays so", groups.join(", "))]);
        }
    };
    if let Some(size) = arguments.size {
        kept(&plan.groups_sweeping(study::plan::SIZE), "--size");
        plan.size = study::plan::Size(size);
    }
    for word in &arguments.input {
        codec::trust_address(Path::new(word));
    }
    plan.add_scenes(&arguments.input.iter().map(|word| scene_word(word)).collect::<Vec<_>>());
    plan.repeats = arguments.repeats.unwrap_or(plan.repeats);
    if let Some(preset) = arguments.preset {
        plan.replace_preset(preset);
    }
    for (key, value) in &arguments.set {
        if key == "reflection.method" {
            return Err(usage("--set reflection.method: the plan's groups name their methods"));
        }
        let groups = plan.replace(key, value).map_err(|error| usage(format!("--set {key}={value}: {error}")))?;
        kept(&groups, &format!("--set {key}"));
    }
    Ok(plan)
}

/// An input as plans name it: a file by its full path, so that the plan beside the results finds it, too.
fn scene_word(word: &OsStr) -> String {
    let path = Path::new(word);
    path.canonicalize().map_or_else(|_| word.to_string_lossy().into_owned(), |path| path.to_string_lossy().into_owned())
}

/// The command that was typed, with `DIR` in place of the output folder.
fn command(name: &OsStr, arguments: &StudyArguments) -> String {
    let mut words = vec!["glint study".to_owned(), quoted(&scene::shown(name)), "-o DIR".to_owned()];
    words.extend(arguments.size.map(|[width, height]| format!("--size {width}x{height}")));
    words.extend(arguments.repeats.map(|repeats| format!("--repeats {repeats}")));
    words.extend(arguments.preset.map(|preset| format!("--preset {}", preset.name)));
    words.extend(arguments.set.iter().map(|(key, value)| format!("--set {}", quoted(&format!("{key}={value}")))));
    let inputs = arguments.input.iter().map(|word| quoted(&scene::shown(word)));
    words.extend(arguments.input.first().map(|_| "--input".to_owned()).into_iter().chain(inputs));
    words.extend(arguments.shard.map(|shard| format!("--shard {}/{}", shard.number, shard.count)));
    words.extend(arguments.gpu.gpu.iter().map(|gpu| format!("--gpu {}", quoted(gpu))));
    words.join(" ")
}

/// The scenes of studies: those that `glint render` knows, and those that provoke failures.
struct Inputs;

/// Clouds without a camera are framed for a picture of this aspect ratio, whatever its size: the view must not change
/// with the parameter that is swept.
const ASPECT: f64 = 4.0 / 3.0;

/// Streamed clouds are loaded as finely as a picture of this size, in pixels, needs.
const STREAMED_FOR: [u32; 2] = [1600, 1200];

impl Scenes for Inputs {
    fn settings(&self, scene: &str, preset: Option<&Preset>) -> anyhow::Result<Settings> {
        let (settings, mirrors) = if stability::is_case(scene) {
            (stability::settings(scene)?, stability::mirrors(scene)?)
        } else {
            let request = world::resolve_written(&[scene.to_owned()]);
            request.check()?;
            let mirrors = request.all_mirrors();
            (request.view.map(|view| view.settings).unwrap_or_default(), mirrors)
        };
        Ok(preset.map_or(settings.clone(), |preset| preset.applied(&settings, mirrors.iter())))
    }

    fn load(&self, gpu: &Arc<Gpu>, scene: &str, settings: &Settings) -> anyhow::Result<Subject> {
        if stability::is_case(scene) {
            return stability::subject(gpu, scene, settings);
        }
        let request = world::resolve_written(&[scene.to_owned()]);
        request.check()?;
        let own = request.view.as_ref().and_then(|view| view.camera);
        let field_of_view = settings.view.field_of_view;
        let framing =
            |outline: &[glam::DVec3], up| Camera::framing(outline, StandardView::Isometric, up, field_of_view, ASPECT);
        let camera = |outline: &[glam::DVec3], up, _| own.unwrap_or_else(|| framing(outline, up));
        let opened = subject::open(gpu, request, settings, STREAMED_FOR, false, camera)?;
        match opened {
            Ok(LoadedSubject { mut subject, status: 0, unread, sources, .. }) => {
                check_whole(scene, unread)?;
                if let Err(error) = truth::find_surfaces(&mut subject, &sources) {
                    warn([format!("{scene}: no exact truth: {error:#}")]);
                }
                Ok(subject)
            }
            _ => Err(anyhow!("{scene}: cannot be read in full")),
        }
    }

    fn ruler(&self, gpu: &Arc<Gpu>, scene: &str, settings: &Settings) -> anyhow::Result<Ruler> {
        let request = world::resolve_written(&[scene.to_owned()]);
        request.check()?;
        warn(request.check_filters(settings)?);
        let read = |input| scans::of_input(input, &request.test(), settings);
        let mut scans: Vec<_> = request.inputs.iter().flat_map(read).collect();
        match (scans.pop(), scans.is_empty()) {
            (Some((_, scan)), true) => {
                let ((scan, unread), progress) = (scan?, Progress::default());
                check_whole(scene, unread)?;
                let options = |chunks: &[cloud::Chunk]| world::options_for(chunks, scan.up, scan.scanner(), settings);
                Ruler::new(&scan, HoldOut::default(), &[], options, settings, gpu, &progress)
            }
            _ => Err(anyhow!("{scene}: sightlines judge the surface of one cloud, not of several")),
        }
    }
}

/// Fails where points of a scene cannot be read: figures of the others would be those of another scene.
fn check_whole(scene: &str, unread: u64) -> anyhow::Result<()> {
    let points = grouped(unread);
    if unread == 0 { Ok(()) } else { Err(anyhow!("{scene}: {points} points cannot be read, so nothing is measured")) }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::shared::command_line::{Command, CommandLine};
    use crate::system::failure::exit_status;

    fn arguments(words: &[&str]) -> StudyArguments {
        let all = ["glint", "study"].iter().chain(words);
        match CommandLine::try_parse_from(all).unwrap().command {
            Some(Command::Study(arguments)) => arguments,
            _ => panic!("not a study"),
        }
    }

    /// Runs `glint study` with bad words and returns its message. It must refuse them before it looks for an adapter.
    fn refusal(words: &[&str]) -> String {
        let error = run(&arguments(words)).unwrap_err();
        assert_eq!(exit_status(&error), 2, "{error:#}");
        let text = format!("{error:#}");
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    }

    #[test]
    fn bad_words_are_refused_by_name_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("study").display().to_string();
        let refused = |words: &[&str]| refusal(&[words, &["-o", &output]].concat());
        assert!(refused(&["seed-attempt"]).contains("did you mean `seed-attempts`?"));
        assert!(refused(&["nonsense"]).contains("built-in plans: methods, published"));
        assert!(refused(&["nowhere.toml"]).contains("nowhere.toml: No such file"));
        assert!(refused(&["methods", "--set", "sscr.sead=1"]).contains("--set sscr.sead=1"));
        assert!(refused(&["methods", "--set", "reflection.method=sscr"]).contains("groups name their methods"));
        let path = folder.path().join("plan.toml");
        let plan = |scene: &str| format!("title = \"x\"\n[[group]]\nscenes = [\"{scene}\"]\n");
        std::fs::write(&path, plan("five-mirrors/sphre")).unwrap();
        let missing = refused(&[&path.display().to_string()]);
        assert!(missing.contains("group-1") && missing.contains("did you mean `five-mirrors/sphere`?"), "{missing}");
        std::fs::write(&path, "title = 1\n").unwrap();
        assert!(refused(&[&path.display().to_string()]).contains("plan.toml:1: "));
        assert!(!folder.path().join("study").exists(), "nothing was begun");
        let nothing = refusal(&["merge", &folder.path().join("none").display().to_string(), "-o", &output]);
        assert!(nothing.contains("no study's folder"), "{nothing}");
    }

    #[test]
    fn words_of_the_command_line_take_the_place_of_the_plans() {
        let words = ["auto", "-o", "x", "--input", "five-mirrors/all", "stability/fence:0.2"];
        let with = changed(plan("auto".as_ref()).unwrap(), &arguments(&words)).unwrap();
        let has =
            |scene: &str| with.groups.iter().filter(|group| group.scenes.iter().any(|known| known == scene)).count();
        assert_eq!([has("five-mirrors/all"), has("stability/fence:0.2")], [with.groups.len(); 2]);
        assert!(with.groups.iter().all(|group| group.scenes.len() == 11), "what a group has is not there twice");
        let words = ["viewport", "-o", "x", "--size", "64x48", "--preset", "fast", "--set", "scene.points=5000"];
        let arguments = arguments(&words);
        let plan = changed(plan("viewport".as_ref()).unwrap(), &arguments).unwrap();
        let cases = plan.cases();
        assert_eq!(cases[0].size, [640, 480], "a swept size stays");
        assert!(cases.iter().all(|case| case.preset.is_some_and(|preset| preset.name == "Fast")));
        assert!(cases.iter().all(|case| case.set.contains(&("scene.points".into(), "5000".into()))));
        let typed = "glint study viewport -o DIR --size 64x48 --preset Fast --set scene.points=5000";
        assert_eq!(command("viewport".as_ref(), &arguments), typed);
    }

    #[test]
    fn the_command_that_is_kept_can_be_typed_again() {
        let words =
            ["a plan.toml", "-o", "x", "--set", "color.attribute=the dog's", "--shard", "2/8", "--gpu", "RTX 4090"];
        let typed =
            "glint study 'a plan.toml' -o DIR --set 'color.attribute=the dog'\\''s' --shard 2/8 --gpu 'RTX 4090'";
        assert_eq!(command("a plan.toml".as_ref(), &arguments(&words)), typed);
    }

    #[test]
    fn a_preset_takes_its_values_from_the_mirrors_of_the_scene() {
        let published = Preset::named("published").ok();
        let levels = |scene: &str| Inputs.settings(scene, published).unwrap().sscr.pull_levels;
        assert_eq!(["five-mirrors/sphere", "five-mirrors/torus", "stability/thin-tube"].map(levels), [4, 3, 3]);
        assert_eq!(Inputs.settings("five-mirrors/torus", None).unwrap(), Settings::default());
    }

    #[test]
    fn every_built_in_plan_names_scenes_that_there_are() {
        for name in study::plan_names() {
            runner::check_scenes(&plan(name.as_ref()).unwrap(), &Inputs).unwrap();
        }
        assert!(Inputs.settings("stability/nonsense:1", None).is_err());
    }
}
