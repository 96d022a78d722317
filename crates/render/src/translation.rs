//! Test: every pass, with every combination of its constants that the renderer uses, translates to the languages of the
//! backends. And docs/gpu.md says what the passes need of an adapter.

mod language;
mod work_tests;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::LazyLock;

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Expression, Literal, Module};
use param::Kind;
use rayon::prelude::*;
use scene::{LightClues, METHODS, Settings};

use crate::gi::LightReuse;
use crate::gpu::{Error, Gpu, NEEDS};
use crate::passes::{ALL, Pass, Slot};
use crate::rehearsal::Cast;
use crate::renderer::Renderer;
use crate::shader::tests::module_of;
use crate::shader::{Values, weave};

use language::{LANGUAGES, has_wide_atomics};

/// The constants of a pass, by name.
type Constants = BTreeMap<String, u32>;

/// What a rehearsal is tried with: nothing special, then each kind of mirror, and all at once.
fn casts(settings: &Settings) -> Vec<Cast> {
    let plain = Cast {
        settings: settings.clone(),
        lights: 1,
        clues: LightClues { sky_is_open: true, ..LightClues::default() },
        mirrors: [true, false, false],
        has_highlights: false,
        clear: [false; 2],
        filters: false,
        own_methods: Vec::new(),
        has_near: false,
        moves: false,
        light_reuse: LightReuse::Never,
    };
    vec![
        Cast { lights: 0, ..plain.clone() },
        Cast { mirrors: [false, false, true], filters: true, clear: [false, true], ..plain.clone() },
        Cast { lights: 2, mirrors: [true; 3], has_highlights: true, clear: [true; 2], ..plain.clone() },
        Cast {
            mirrors: [true, false, true],
            own_methods: METHODS[2..5].iter().map(|row| row.method).collect(),
            ..plain.clone()
        },
        plain,
    ]
}

/// Other values of the parameters, one at a time: every choice, and the ends of every range.
fn others(wanted: impl Fn(&str) -> bool) -> Vec<(String, String)> {
    let mut others = Vec::new();
    for params in Settings::default().groups() {
        let group = params.group();
        for field in group.fields.iter().filter(|_| wanted(group.name)) {
            let values: Vec<String> = match &field.kind {
                Kind::Bool { .. } => vec!["true".into(), "false".into()],
                Kind::Choice { names, .. } => names.iter().map(|name| (*name).to_owned()).collect(),
                Kind::U32 { min, max, .. } => vec![min.to_string(), max.to_string()],
                Kind::F32 { min, max, .. } => vec![min.to_string(), max.to_string()],
                Kind::Color { .. } | Kind::Bytes { .. } | Kind::Text { .. } => Vec::new(),
            };
            others.extend(values.into_iter().map(|value| (format!("{}.{}", group.name, field.name), value)));
        }
    }
    others
}

/// The settings of the frames that are rehearsed: all methods as they are, and with each parameter of theirs changed.
/// Parameters that belong to no method are changed with two methods.
fn all_settings() -> Vec<Settings> {
    let owned: Vec<&str> = METHODS.iter().filter_map(|row| row.group).collect();
    let mut all = Vec::new();
    for (number, row) in METHODS.iter().filter(|row| row.method.chosen() == row.method).enumerate() {
        let mut settings = Settings::default();
        settings.reflection.method = row.method;
        all.push(settings.clone());
        let is_wanted = |group: &str| Some(group) == row.group || number < 2 && !owned.contains(&group);
        let common = ["reflection.bounces=2", "reflection.samples=2", "gloss.samples=2", "reflection.show=steps"];
        let common =
            common.iter().filter_map(|pair| pair.split_once('=')).map(|(key, value)| (key.into(), value.into()));
        for (key, value) in others(is_wanted).into_iter().chain(common) {
            let mut changed = settings.clone();
            changed.set_text(&key, &value).unwrap();
            changed.reflection.method = if key == "reflection.method" { changed.reflection.method } else { row.method };
            // One value of most parameters is the default, and bounds may be the values in use.
            if !all.contains(&changed) {
                all.push(changed);
            }
        }
    }
    all
}

/// The constants with which the renderer compiles each pass, and each switch of each pass alone, by the pass's name.
fn variants(gpu: &std::sync::Arc<Gpu>) -> BTreeMap<&'static str, BTreeSet<Constants>> {
    let rehearse = |renderer: &mut Renderer, settings: Settings| {
        let mut named = Vec::new();
        for cast in casts(&settings) {
            renderer.forget();
            let stage = renderer.stage(&cast, &settings).unwrap();
            match renderer.missing(&stage) {
                Ok(missing) => named.extend(missing),
                Err(Error::PerfectMirrorsOnly { .. } | Error::OneMethodOnly { .. } | Error::NoSecondLayer) => {}
                Err(error) => panic!("{error}"),
            }
        }
        named
    };
    let mut variants: BTreeMap<&'static str, BTreeSet<Constants>> = BTreeMap::new();
    // A renderer keeps its images, which take longer to make than all else that is rehearsed.
    let named = all_settings().into_par_iter().map_init(|| Renderer::bare(gpu.clone()), rehearse);
    for (pass, switches) in named.flatten_iter().collect::<Vec<_>>() {
        let constants = switches.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        variants.entry(pass.name).or_default().insert(constants);
    }
    for pass in ALL {
        let of_pass = variants.entry(pass.name).or_default();
        of_pass.insert(Constants::new());
        let (module, _) = valid_module_of(pass);
        let switches = module.overrides.iter().filter(|(_, constant)| {
            matches!(module.types[constant.ty].inner, naga::TypeInner::Scalar(scalar) if scalar.kind == naga::ScalarKind::Bool)
        });
        for (_, switch) in switches {
            let name = switch.name.clone().unwrap();
            of_pass.extend([0, 1].map(|value| Constants::from([(name.clone(), value)])));
        }
        *of_pass = std::mem::take(of_pass).into_iter().map(|constants| changed(module, constants)).collect();
    }
    variants
}

/// The constants that have another value than the module gives them itself. They make the same module as all do.
fn changed(module: &Module, mut constants: Constants) -> Constants {
    for (_, constant) in module.overrides.iter() {
        let own = match constant.init.map(|init| &module.global_expressions[init]) {
            Some(Expression::Literal(Literal::Bool(value))) => u32::from(*value),
            Some(Expression::Literal(Literal::U32(value))) => *value,
            _ => continue,
        };
        constants.retain(|name, value| constant.name.as_ref() != Some(name) || *value != own);
    }
    constants
}

/// What a pass needs of an adapter, in the order of `NEEDS`, and whether it needs 64-bit atomics.
struct Needed {
    numbers: [u64; NEEDS.len()],
    written: usize,
    wide: bool,
}

impl Needed {
    fn of(pass: &'static Pass) -> Self {
        let (module, _) = valid_module_of(pass);
        let count = |is_kind: fn(&Slot) -> bool| {
            pass.groups().flat_map(|slots| slots.iter()).filter(|(_, slot)| is_kind(slot)).count()
        };
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let workgroup =
            module.global_variables.iter().filter(|(_, variable)| variable.space == AddressSpace::WorkGroup);
        let bytes: u32 = workgroup.map(|(_, variable)| layouter[variable.ty].size).sum();
        let wide = has_wide_atomics(module);
        let numbers = [
            count(|slot| matches!(slot, Slot::Read | Slot::ReadWrite)) as u64,
            count(|slot| matches!(slot, Slot::Uniform)) as u64,
            count(|slot| matches!(slot, Slot::Texture)) as u64,
            count(|slot| matches!(slot, Slot::Write(_))) as u64,
            pass.groups().count() as u64,
            module.entry_points[0].workgroup_size.map(u64::from).iter().product(),
            bytes.into(),
            0,
        ];
        Self { numbers, written: count(|slot| matches!(slot, Slot::ReadWrite)), wide }
    }
}

/// Of each language: whether a pass is given to it, and naga writes it there with some constants.
fn translate(
    pass: &'static Pass,
    (module, info): (&Module, &ModuleInfo),
    constants: &Constants,
) -> [Result<bool, String>; LANGUAGES.len()] {
    let switches: Vec<(&str, u32)> = constants.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let fill = |(module, left): (Module, Values<'_>)| {
        let entry = Some((naga::ShaderStage::Compute, pass.name));
        let left = left.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let info = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module);
        let info = info.map_err(|error| format!("{error:?}"))?;
        let filled = naga::back::pipeline_constants::process_overrides(&module, &info, entry, &left);
        let (module, info) = filled.map_err(|error| error.to_string())?;
        Ok((module.into_owned(), info.into_owned()))
    };
    // What the renderer hands over. Naga judges the module anew where it puts values in, which takes longer than writing
    // it: once for all languages.
    let filled = weave(pass).and_then(|woven| woven.module(&switches)).and_then(fill);
    LANGUAGES.each_ref().map(|language| match &filled {
        _ if !language.is_asked(module, info) => Ok(false),
        Ok((module, info)) => language.write(pass, module, info).map(|()| true),
        Err(error) => Err(error.clone()),
    })
}

/// A pass's module, and what naga knows of it. All tests share them.
fn valid_module_of(pass: &'static Pass) -> &'static (Module, ModuleInfo) {
    static MODULES: LazyLock<BTreeMap<&str, (Module, ModuleInfo)>> = LazyLock::new(|| {
        let valid = |pass: &&'static Pass| {
            let module = module_of(pass);
            let info = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).unwrap();
            (pass.name, (module, info))
        };
        ALL.iter().map(valid).collect()
    });
    &MODULES[pass.name]
}

#[test]
fn every_pass_translates_with_every_combination_of_its_constants_to_every_language() {
    let Some(gpu) = Gpu::for_test() else { return };
    let variants = variants(&gpu);
    let results = ALL.par_iter().flat_map_iter(|pass| {
        let (module, info) = valid_module_of(pass);
        let mut results = Vec::new();
        for constants in &variants[pass.name] {
            let written = translate(pass, (module, info), constants).into_iter();
            results.extend(written.map(|result| result.map_err(|why| format!("{} {constants:?}: {why}", pass.name))));
        }
        results
    });
    let results: Vec<Result<bool, String>> = results.collect();
    let refused: Vec<&String> = results.iter().filter_map(|result| result.as_ref().err()).collect();
    let written = results.iter().filter(|result| **result == Ok(true)).count();
    let never = results.iter().filter(|result| **result == Ok(false)).count();
    println!(
        "{} combinations, {written} translations, {never} that no device asks for, {} refused",
        variants.values().map(BTreeSet::len).sum::<usize>(),
        refused.len()
    );
    assert!(refused.is_empty(), "{refused:#?}");
    if !language::is_judged() {
        println!("skipped: spirv-val (spirv-tools), which judges SPIR-V, is not installed");
    }
}

#[test]
fn passes_are_kept_from_a_language_for_their_64_bit_atomics_only() {
    let mut readers = 0;
    for pass in ALL {
        let (module, info) = valid_module_of(pass);
        let is_kept = |backend: wgpu::Backend| {
            let of_backend = LANGUAGES.iter().filter(|language| language.backend == backend);
            of_backend.map(|language| !language.is_asked(module, info)).collect::<Vec<_>>()
        };
        let [vulkan, directx, metal] = [wgpu::Backend::Vulkan, wgpu::Backend::Dx12, wgpu::Backend::Metal].map(is_kept);
        assert_eq!(vulkan, [false; 2], "{}", pass.name);
        // Nothing, what older versions lack, or what cannot be read.
        let (directx, metal) = (&directx[..], &metal[..]);
        match has_wide_atomics(module) {
            false => assert_eq!((directx, metal), (&[false; 3][..], &[false; 3][..]), "{}", pass.name),
            true if directx[2] => {
                assert_eq!((directx, metal), (&[true; 3][..], &[true; 3][..]), "{}", pass.name);
                readers += 1;
            }
            true => {
                assert_eq!((directx, metal), (&[true, true, false][..], &[true, false, false][..]), "{}", pass.name)
            }
        }
    }
    assert_eq!(readers, 2, "other passes stand in for the two that read them");
}

#[test]
fn every_pass_has_room_in_the_tables_of_directx_and_metal() {
    for pass in ALL {
        let Needed { numbers: [storage, uniform, sampled, textures, ..], written, .. } = Needed::of(pass);
        let name = pass.name;
        // Metal has 31 buffers of all kinds, of which wgpu keeps two: the sizes of the others, and a spare one.
        assert!(storage + uniform <= 29, "{name} has {storage} + {uniform} buffers");
        // DirectX's first tier of binding has 14 constant buffers, of which wgpu takes one, 128 read views and 64 written.
        assert!(uniform <= 13, "{name} has {uniform} constant buffers");
        let written = written as u64;
        assert!(storage - written + sampled <= 128 && written + textures <= 64, "{name}");
    }
}

#[test]
fn the_page_says_what_the_passes_need() {
    let Some(gpu) = Gpu::for_test() else { return };
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/gpu.md");
    let page = page(&gpu);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &page).unwrap();
    }
    let is_kept = std::fs::read_to_string(&path).unwrap_or_default() == page;
    assert!(is_kept, "docs/gpu.md is out of date: UPDATE=1 cargo test --release --workspace --lib translation");
}

#[test]
fn what_is_asked_of_adapters_is_what_the_passes_need() {
    for (index, need) in NEEDS.iter().enumerate().filter(|(_, need)| need.what != "bytes of a bound buffer") {
        let most = ALL.iter().map(|pass| (Needed::of(pass).numbers[index], pass.name)).max().unwrap();
        assert_eq!(need.least, most.0, "{}: {} needs most", need.what, most.1);
    }
}

#[test]
fn an_adapter_with_no_more_than_webgpu_promises_has_what_every_pass_needs() {
    let promised = wgpu::Limits::defaults();
    for need in &NEEDS {
        assert!(need.least <= need.promised(&promised), "{} {}", need.least, need.what);
    }
}

/// The content of docs/gpu.md.
fn page(gpu: &std::sync::Arc<Gpu>) -> String {
    let mut page = String::from(
        "# What the passes need of a GPU\n\n\
         Written by `UPDATE=1 cargo test --release --workspace --lib translation`.\n\n\
         ## An adapter must have\n\n\
         `glint doctor` shows what an adapter has of it. One that lacks something is refused with a sentence, and another is\n\
         taken where there is one.\n\n\
         | what | needed | WebGPU promises |\n|---|---|---|\n",
    );
    let promised = wgpu::Limits::defaults();
    for need in &NEEDS {
        let _ = writeln!(page, "| {} | {} | {} |", need.what, need.least, need.promised(&promised));
    }
    page.push_str(
        "\n## Passes\n\n\
         Storage buffers and, of these, those that are written; uniform buffers; sampled textures; storage textures; bytes\n\
         of workgroup memory; threads in a workgroup. Passes with 64-bit atomics run only where the adapter has them.\n\n\
         | pass | storage | written | uniform | sampled | written textures | workgroup | threads | atomics |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for pass in ALL {
        let Needed { numbers: [storage, uniform, sampled, textures, _, threads, bytes, _], written, wide } =
            Needed::of(pass);
        let atomics = if wide { "64 bits" } else { "" };
        let _ = writeln!(
            page,
            "| `{}` | {storage} | {written} | {uniform} | {sampled} | {textures} | {bytes} | {threads} | {atomics} |",
            pass.name
        );
    }
    page.push_str(&languages());
    page.push_str(&crate::memory::page(gpu));
    page.push_str(
        "\n## Long passes\n\n\
         Systems take a GPU for stuck where a dispatch takes two seconds or more. On a GPU these passes are cut by rows and\n\
         columns of workgroups or by blocks of points, which changes no picture, and what is estimated to take 50 ms is\n\
         submitted at once. Where settings ask for more than those by which a pass was timed, the estimate grows with the loops\n\
         that they make longer (crates/render/src/loads.rs). The times are computed as those of each pass below.\n\
         A test computes them for both ends of each parameter, alone, and fails where a dispatch takes more than 100 ms: in a\n\
         first frame, in later ones, and in the first one after a change from or to the usual settings. Only `splat_behind`\n\
         takes up to 115 ms with discs of 64 pixels, by the loads of a single workgroup, as does `cubemap_trace` with two\n\
         parameters at their ends. What settings do not say is not in it: a disc of thousands of pixels beside the eye\n\
         makes its workgroup longer than any cut.\n\n\
         Software Vulkan (llvmpipe) ends all loops of an invocation after 65,535 turns together, and reports nothing: what was\n\
         left to do is missing in the picture. The same test bounds the turns; only `indirect` with all 17,408 lights would have\n\
         more (87,000), if every light were nearer than its own size. Discs of more than 64 pixels are shared by a workgroup,\n\
         and blocks of points with such discs are smaller (crates/render/src/store/draw_list.rs). What no setting says is not\n\
         bounded: a point that `sample_cameras` takes through thousands of squares, as `cull = none` does.\n\n\
         A dispatch that is estimated to take two seconds all the same is refused. A frame of many pieces is not, however long\n\
         it takes: no system resets a GPU for it. The window submits no more than 200 ms of it ahead, gives it up as soon as\n\
         something moves, and shows the picture before meanwhile; `glint render` and `glint record` end on Ctrl-C.\n\n\
         | pass, at 3840 x 2160 or of 10 million points | settings | whole, ms | longest dispatch in its first frame, ms | later, ms | after the usual settings, ms |\n\
         |---|---|---|---|---|---|\n",
    );
    page.push_str(&work_tests::long_passes());
    page.push_str(&work_tests::table());
    page.push_str(include_str!("translation/states.md"));
    page
}

/// The part of docs/gpu.md about shading languages.
fn languages() -> String {
    let mut part = String::from(
        "\n## Passes and backends\n\n\
         A test translates every pass to the languages of Vulkan (SPIR-V), DirectX 12 (HLSL) and Metal (MSL), as wgpu asks\n\
         naga for it, with every combination of constants that the renderer is known to compile it with: each method, each\n\
         parameter changed alone, each kind of mirror: some 4,000 translations, of which none was\n\
         refused. None may be. Where spirv-val is installed, it judges SPIR-V 1.0;\n\
         no compiler of HLSL or MSL has judged the others. Where a cell says `never`, the renderer takes another pass on such\n\
         devices: HLSL and MSL cannot read 64-bit atomics, and older versions lack them.\n\n| pass |",
    );
    LANGUAGES.iter().for_each(|language| part.extend([" ", language.name, " |"]));
    part.push_str("\n|---|");
    LANGUAGES.iter().for_each(|_| part.push_str("---|"));
    for pass in ALL {
        let (module, info) = valid_module_of(pass);
        let _ = write!(part, "\n| `{}` |", pass.name);
        for result in translate(pass, (module, info), &Constants::new()) {
            part.push_str(match result {
                Ok(true) => " yes |",
                Ok(false) => " never |",
                Err(_) => " refused |",
            });
        }
    }
    part.push('\n');
    part
}
