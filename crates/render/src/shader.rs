//! WGSL files of `shaders/`, embedded, and the small include that joins them.
//!
//! `#import name` on a line of its own takes in `shaders/shared/name.wgsl` once; an unknown name is an error. Each line of the
//! result remembers its file and line, so that a compiler's complaint points to the source.

use std::collections::HashSet;

macro_rules! embedded {
    ($folder:literal: $($name:ident),*) => {
        &[$((stringify!($name), include_str!(concat!("../../../shaders/", $folder, stringify!($name), ".wgsl")))),*]
    };
}

/// The passes, by name.
pub const PASSES: &[(&str, &str)] = embedded!("": splat_nearest, splat_depth, splat_identity, splat_accumulate, splat_average,
    splat_resolve, close_gaps, mirror_exact, mirror_exact_seen, camera_position, mirror_surface, mirror_doubt, beam_lists, surfel_trace, gather_resolve, gather_close, environment_look_up, mirrored_look_up, curvature, curvature_smooth,
    label_start, label_join, label_flatten, region_count, region_scan, region_number, region_assign, sscr_solve, sscr_views,
    mirror_depth, mirror_visibility, mirror_average, pull, push, vpl_points, vpl_aim, vpl_place,
    vpl_bounce, vpl_shadow_splat, vpl_shadow_pull, vpl_shadow_push, indirect, indirect_filter, shade, blend, show, show_light, show_light_buffer,
    show_virtual_lights, show_shadow_maps, present);

const SHARED: &[(&str, &str)] = embedded!("shared/": frame, packing, params, splat, blocks, nearest_point, color, light, counters, point_surface, surfel_tree, brdf, tone, mirror_ray, mirror_formula, mirror_places, heat, beam,
    mirror_space, mirror_splat, mirror_sums, region, root_finding, scan,
    vpl, vpl_of_surface, gloss, light_view);

/// A shader with its imports taken in.
#[derive(Debug, Default)]
pub struct Woven {
    pub source: String,
    /// File and line (from 1) of each line of `source`.
    lines: Vec<(&'static str, usize)>,
}

impl Woven {
    /// `file:line` of line `line` (from 1) of the woven source.
    fn origin(&self, line: usize) -> String {
        let (file, line) = self.lines.get(line.wrapping_sub(1)).copied().unwrap_or(("?", 0));
        format!("{file}.wgsl:{line}")
    }

    /// A compiler's complaint (`... wgsl:398:9 ...`) with the place in the file that was written before it.
    pub fn explain(&self, complaint: &str) -> String {
        let digits = complaint.split("wgsl:").nth(1).and_then(|rest| rest.split(':').next());
        match digits.and_then(|digits| digits.parse().ok()) {
            Some(line) => format!("{}: {complaint}", self.origin(line)),
            None => complaint.to_string(),
        }
    }
}

/// The pass `name` with everything it imports.
///
/// # Errors
/// An unknown pass or import, with where it was asked for.
pub fn weave(name: &str) -> Result<Woven, String> {
    let mut woven = Woven::default();
    let (name, source) = find(PASSES, name).ok_or_else(|| format!("no shader `{name}`"))?;
    append(&mut woven, name, source, &mut HashSet::new())?;
    Ok(woven)
}

fn find(files: &'static [(&'static str, &'static str)], name: &str) -> Option<(&'static str, &'static str)> {
    files.iter().copied().find(|(known, _)| *known == name)
}

fn append(
    woven: &mut Woven,
    name: &'static str,
    source: &'static str,
    seen: &mut HashSet<&'static str>,
) -> Result<(), String> {
    for (index, line) in source.lines().enumerate() {
        if let Some(import) = line.strip_prefix("#import ") {
            let (import, source) = find(SHARED, import.trim())
                .ok_or_else(|| format!("{name}.wgsl:{}: no shared shader `{import}`", index + 1))?;
            if seen.insert(import) {
                append(woven, import, source, seen)?;
            }
        } else {
            woven.source.push_str(line);
            woven.source.push('\n');
            woven.lines.push((name, index + 1));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    use scene::Settings;

    use super::*;
    use crate::passes::{ALL, Slot};

    fn module_of(name: &str) -> naga::Module {
        let woven = weave(name).unwrap();
        naga::front::wgsl::parse_str(&woven.source).unwrap_or_else(|error| {
            let place = error.location(&woven.source).map_or(String::new(), |at| woven.origin(at.line_number as usize));
            panic!("{place}: {}", error.emit_to_string(&woven.source))
        })
    }

    #[test]
    fn every_shader_is_valid() {
        for (name, _) in PASSES {
            let module = module_of(name);
            let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
            validator.validate(&module).unwrap_or_else(|error| panic!("{name}: {error:?}"));
        }
    }

    #[test]
    fn every_shader_is_a_pass_and_its_entry_point_has_its_name() {
        let passes: Vec<&str> = ALL.iter().map(|pass| pass.name).collect();
        for (name, _) in PASSES {
            assert!(passes.contains(name), "{name}.wgsl is used by no pass");
            assert_eq!(module_of(name).entry_points[0].name, *name);
        }
    }

    #[test]
    fn bindings_of_every_pass_agree_with_its_shader() {
        for pass in ALL {
            let module = module_of(pass.name);
            let mut declared = Vec::new();
            for (_, variable) in module.global_variables.iter() {
                let Some(binding) = variable.binding else { continue };
                let slot = match (variable.space, &module.types[variable.ty].inner) {
                    (naga::AddressSpace::Uniform, _) => Slot::Uniform,
                    (naga::AddressSpace::Storage { access }, _) if access.contains(naga::StorageAccess::STORE) => {
                        Slot::ReadWrite
                    }
                    (naga::AddressSpace::Storage { .. }, _) => Slot::Read,
                    (_, naga::TypeInner::Image { class: naga::ImageClass::Storage { format, .. }, .. }) => match format
                    {
                        naga::StorageFormat::Rgba16Float => Slot::Write(wgpu::TextureFormat::Rgba16Float),
                        naga::StorageFormat::Rgba32Float => Slot::Write(wgpu::TextureFormat::Rgba32Float),
                        naga::StorageFormat::R32Float => Slot::Write(wgpu::TextureFormat::R32Float),
                        naga::StorageFormat::Rgba8Unorm => Slot::Write(wgpu::TextureFormat::Rgba8Unorm),
                        other => panic!("{}: {other:?}", pass.name),
                    },
                    (_, naga::TypeInner::Image { .. }) => Slot::Texture,
                    other => panic!("{}: {other:?}", pass.name),
                };
                declared.push((binding.group, binding.binding, slot));
            }
            declared.sort_by_key(|(group, binding, _)| (*group, *binding));
            let mut expected = Vec::new();
            for (group, slots) in pass.groups.iter().enumerate() {
                expected.extend(slots.iter().enumerate().map(|(binding, slot)| (group as u32, binding as u32, *slot)));
            }
            assert_eq!(declared, expected, "{}", pass.name);
        }
    }

    #[test]
    fn wgsl_parameters_are_those_of_the_table() {
        let expected = params_wgsl();
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders/shared/params.wgsl");
        if std::env::var_os("UPDATE").is_some() {
            std::fs::write(&path, &expected).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected, "run the tests with UPDATE=1 to write it anew");
    }

    /// The parameter groups as WGSL structs, and one struct of them all.
    fn params_wgsl() -> String {
        let settings = Settings::default();
        let mut wgsl = String::from(
            "// Generated from the parameter table (crates/scene/src/settings.rs); a test keeps it so. Do not edit.\n\n",
        );
        let mut all = String::from("// All parameters, in the order of Settings::groups.\nstruct Settings {\n");
        for params in settings.groups() {
            let group = params.group();
            if params.words().is_empty() {
                continue;
            }
            wgsl += &group.wgsl();
            wgsl += "\n";
            // As the group names its struct.
            let type_name: String = group.name.split('_').map(|word| word[..1].to_uppercase() + &word[1..]).collect();
            all += &format!("    {}: {type_name},\n", group.name);
        }
        wgsl + &all + "}\n"
    }

    #[test]
    fn the_words_of_the_settings_fill_the_wgsl_struct_exactly() {
        let module = module_of("shade");
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let (handle, _) = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some("Settings")).unwrap();
        let words: usize = Settings::default().groups().iter().map(|params| params.words().len()).sum();
        assert_eq!(layouter[handle].size as usize, words * 4);
    }

    #[test]
    fn rust_structs_have_the_offsets_that_the_shaders_read() {
        let of_frame = crate::frame::layouts().into_iter().map(|layout| ("splat_nearest", layout));
        let of_light = crate::gi::layouts().into_iter().map(|layout| ("vpl_place", layout));
        for (pass, (name, size, fields)) in of_frame.chain(of_light) {
            let module = module_of(pass);
            let mut layouter = naga::proc::Layouter::default();
            layouter.update(module.to_ctx()).unwrap();
            let (handle, kind) = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(name)).unwrap();
            let naga::TypeInner::Struct { members, .. } = &kind.inner else { panic!("{name} is no struct") };
            let read: Vec<(String, usize)> =
                members.iter().map(|member| (member.name.clone().unwrap(), member.offset as usize)).collect();
            let written: Vec<(String, usize)> =
                fields.iter().map(|(field, offset)| (field.to_string(), *offset)).collect();
            assert_eq!(read, written, "{name}");
            assert_eq!(layouter[handle].size as usize, size, "{name}");
        }
    }

    #[test]
    fn shaders_and_rust_agree_on_the_size_of_lamps_maps_and_on_tries() {
        let size = crate::lighting::SHADOW_SIZE;
        let has = |pass: &str, line: String| assert!(weave(pass).unwrap().source.contains(&line), "{pass}: {line}");
        has("shade", format!("const SHADOW_SIZE: i32 = {size};"));
        has("vpl_place", format!("const LAMP_MAP_SIZE: u32 = {size}u;"));
        has("vpl_aim", format!("const VPL_TRIES: u32 = {}u;", crate::gi::TRIES));
    }

    #[test]
    fn errors_point_to_the_file_that_was_written() {
        let woven = weave("present").unwrap();
        let line = woven.source.lines().position(|line| line.contains("fn pixel_from_view")).unwrap() + 1;
        let (_, frame) = find(SHARED, "frame").unwrap();
        let expected = frame.lines().position(|line| line.contains("fn pixel_from_view")).unwrap() + 1;
        assert_eq!(
            woven.explain(&format!("error wgsl:{line}:9 no")),
            format!("frame.wgsl:{expected}: error wgsl:{line}:9 no")
        );
    }
}
