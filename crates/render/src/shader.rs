//! The WGSL files of `shaders/`, embedded in the program, and the `#import` that joins them.
//!
//! `#import name` on a line of its own includes `shaders/shared/name.wgsl` once; an unknown name is an error. Each line
//! of the result remembers its file and line, so that a compiler's message points to the source.

use std::collections::HashSet;

use crate::dead_branches;
use crate::passes::Pass;

macro_rules! embedded {
    ($($name:ident)*) => {
        &[$((stringify!($name), include_str!(concat!("../../../shaders/shared/", stringify!($name), ".wgsl")))),*]
    };
}

const SHARED: &[(&str, &str)] = embedded! {
    accumulate analytic asked_texels beam blocks brdf bundle camera_root camera_tree color counters cube_faces cubemaps depth_step depth_texel depth_walk direction_step exposure finite frame
    frame_group gloss gloss_pixel hash heat hit kept_light kept_place large_discs light light_path light_field light_field_maps light_view lobe mirror_formula
    mirror_places mirror_ray mirror_space mirror_splat mirror_sums nearest_point ordered packing page_group params photons
    point_surface refraction region root_finding run scan screen screen_box screen_layout splat surfel_rays surfel_tree texel_of_point tile_labels
    tone visibility vpl vpl_of_surface vpl_transfer
};

/// The values of switches, as wgpu takes them.
pub type Values<'s> = Vec<(&'s str, f64)>;

/// A shader with its imports included.
#[derive(Debug, Default)]
pub struct Woven {
    pub source: String,
    /// The file and the line (from 1) of each line of `source`.
    lines: Vec<(&'static str, usize)>,
}

impl Woven {
    /// `file:line` of line `line` (from 1) of the woven source.
    fn origin(&self, line: usize) -> String {
        let (file, line) = self.lines.get(line.wrapping_sub(1)).copied().unwrap_or(("?", 0));
        format!("{file}.wgsl:{line}")
    }

    /// The shader without what these values of its switches rule out, and the values of those that are left.
    ///
    /// # Errors
    /// The shader's first fault with its file and line, or the name of a switch that it lacks.
    pub fn module<'s>(&self, switches: &[(&'s str, u32)]) -> Result<(naga::Module, Values<'s>), String> {
        let fault = |error: naga::front::wgsl::ParseError| self.explain(&error.emit_to_string(&self.source));
        let mut module = naga::front::wgsl::parse_str(&self.source).map_err(fault)?;
        dead_branches::leave_out(&mut module, switches)?;
        let is_left = |name: &str| module.overrides.iter().any(|(_, own)| own.name.as_deref() == Some(name));
        let left = switches.iter().filter(|(name, _)| is_left(name)).map(|(name, value)| (*name, f64::from(*value)));
        let left = left.collect();
        Ok((module, left))
    }

    /// A compiler's message (`... wgsl:398:9 ...`), preceded by the place in the source file.
    pub fn explain(&self, complaint: &str) -> String {
        let digits = complaint.split("wgsl:").nth(1).and_then(|rest| rest.split(':').next());
        match digits.and_then(|digits| digits.parse().ok()) {
            Some(line) => format!("{}: {complaint}", self.origin(line)),
            None => complaint.to_string(),
        }
    }
}

/// The shader of a pass with everything that it imports.
///
/// # Errors
/// An unknown import, with the place of the import.
pub fn weave(pass: &'static Pass) -> Result<Woven, String> {
    let mut woven = Woven::default();
    append(&mut woven, pass.name, pass.source, &mut HashSet::new())?;
    Ok(woven)
}

fn shared(name: &str) -> Option<(&'static str, &'static str)> {
    SHARED.iter().copied().find(|(known, _)| *known == name)
}

fn append(
    woven: &mut Woven,
    name: &'static str,
    source: &'static str,
    seen: &mut HashSet<&'static str>,
) -> Result<(), String> {
    for (index, line) in source.lines().enumerate() {
        if let Some(import) = line.strip_prefix("#import ") {
            let (import, source) = shared(import.trim())
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
pub(crate) mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    use scene::Settings;

    use super::*;
    use crate::passes::{ALL, Slot};

    fn pass(name: &str) -> &'static Pass {
        ALL.iter().find(|pass| pass.name == name).unwrap()
    }

    pub(crate) fn module_of(pass: &'static Pass) -> naga::Module {
        let woven = weave(pass).unwrap();
        naga::front::wgsl::parse_str(&woven.source).unwrap_or_else(|error| {
            let place = error.location(&woven.source).map_or(String::new(), |at| woven.origin(at.line_number as usize));
            panic!("{place}: {}", error.emit_to_string(&woven.source))
        })
    }

    #[test]
    fn every_shader_is_valid_and_its_entry_point_has_its_name() {
        for pass in ALL {
            let module = module_of(pass);
            let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
            validator.validate(&module).unwrap_or_else(|error| panic!("{}: {error:?}", pass.name));
            let names: Vec<&str> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            assert_eq!(names, [pass.name]);
        }
    }

    fn slot_of(module: &naga::Module, variable: &naga::GlobalVariable) -> Slot {
        match (variable.space, &module.types[variable.ty].inner) {
            (naga::AddressSpace::Uniform, _) => Slot::Uniform,
            (naga::AddressSpace::Storage { access }, _) if access.contains(naga::StorageAccess::STORE) => {
                Slot::ReadWrite
            }
            (naga::AddressSpace::Storage { .. }, _) => Slot::Read,
            (_, naga::TypeInner::Image { class: naga::ImageClass::Storage { format, .. }, .. }) => match format {
                naga::StorageFormat::Rgba16Float => Slot::Write(wgpu::TextureFormat::Rgba16Float),
                naga::StorageFormat::Rgba32Float => Slot::Write(wgpu::TextureFormat::Rgba32Float),
                naga::StorageFormat::R32Float => Slot::Write(wgpu::TextureFormat::R32Float),
                naga::StorageFormat::Rgba8Unorm => Slot::Write(wgpu::TextureFormat::Rgba8Unorm),
                other => panic!("{:?}: {other:?}", variable.name),
            },
            (_, naga::TypeInner::Image { .. }) => Slot::Texture,
            other => panic!("{:?}: {other:?}", variable.name),
        }
    }

    #[test]
    fn slots_of_every_pass_have_the_names_and_kinds_of_its_shader() {
        for pass in ALL {
            let module = module_of(pass);
            let mut declared: Vec<(u32, u32, String, Slot)> = Vec::new();
            for (_, variable) in module.global_variables.iter() {
                let Some(binding) = variable.binding else { continue };
                let name = variable.name.clone().unwrap();
                declared.push((binding.group, binding.binding, name, slot_of(&module, variable)));
            }
            declared.sort_by_key(|(group, binding, ..)| (*group, *binding));
            let mut expected = Vec::new();
            for (group, slots) in pass.groups().enumerate() {
                let slot = |(binding, (name, slot)): (usize, &(&str, Slot))| {
                    (group as u32, binding as u32, (*name).to_owned(), *slot)
                };
                expected.extend(slots.iter().enumerate().map(slot));
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
        let mut all = String::from(
            "// All parameters, in the order of Settings::groups. In uniforms, structs begin at every 16th byte.\n\
             struct Settings {\n",
        );
        for params in settings.groups() {
            let group = params.group();
            if params.words().is_empty() {
                continue;
            }
            wgsl += &group.wgsl();
            wgsl += "\n";
            // The name that the group gives its struct.
            let type_name: String = group.name.split('_').map(|word| word[..1].to_uppercase() + &word[1..]).collect();
            all += &format!("    @align(16) {}: {type_name},\n", group.name);
        }
        wgsl + &all + "}\n"
    }

    #[test]
    fn the_words_of_the_settings_fill_the_wgsl_struct_exactly() {
        let module = module_of(pass("shade"));
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let (handle, _) = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some("Settings")).unwrap();
        let (words, _) = crate::inputs::words_of(&Settings::default());
        assert_eq!(layouter[handle].size as usize, words.len() * 4);
    }

    #[test]
    fn errors_point_to_the_file_that_was_written() {
        let woven = weave(pass("present")).unwrap();
        let line = woven.source.lines().position(|line| line.contains("fn pixel_from_view")).unwrap() + 1;
        let (_, frame) = shared("frame").unwrap();
        let expected = frame.lines().position(|line| line.contains("fn pixel_from_view")).unwrap() + 1;
        assert_eq!(
            woven.explain(&format!("error wgsl:{line}:9 no")),
            format!("frame.wgsl:{expected}: error wgsl:{line}:9 no")
        );
    }
}
