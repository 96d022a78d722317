//! What decides how the pictures of a recording look. All pictures of a folder are of one description, whoever made
//! them.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::Averaging;

/// What the pictures of a folder are of, as `record.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// The version of the program.
    pub version: String,
    /// A checksum of the scene: of what the scene file says, and of samples of its clouds.
    pub scene: String,
    /// The name of the path.
    pub path: String,
    pub size: [u32; 2],
    pub fps: u32,
    pub adapter: Adapter,
    /// The parameters that differ from their defaults.
    pub set: BTreeMap<String, String>,
    /// What each picture is averaged from.
    #[serde(default, skip_serializing_if = "Averaging::is_none")]
    pub averaging: Averaging,
    /// What was chosen for a target of time or error, if one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub auto: Option<serde_json::Value>,
}

/// What draws the pictures: another one rounds otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Adapter {
    pub name: String,
    pub backend: String,
    pub driver: String,
}

impl fmt::Display for Adapter {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, backend, driver } = self;
        write!(formatter, "{name} ({backend}, {driver})")
    }
}

impl Description {
    /// What the file of a frame says that it is of, with the parameters in `set`. All adapters that may add to the folder
    /// say the same.
    pub fn of_frame(&self, frame: u32) -> String {
        let Self { version, scene, path, size, fps, adapter: _, set, averaging, auto: _ } = self;
        let all = serde_json::json!([version, scene, path, size, fps, set, averaging]).to_string();
        format!("{:08x}, frame {frame}", crc32fast::hash(all.as_bytes()))
    }

    /// Returns in words the first thing that makes the pictures of `self` others than those of `wanted`. What was
    /// chosen for a target does not count, nor does the adapter if `is_mixed`.
    pub fn difference(&self, wanted: &Self, is_mixed: bool) -> Option<String> {
        let Self { version, scene, path, size: [width, height], fps, adapter, set, averaging, auto: _ } = self;
        let Averaging { subframes, shutter, supersample } = averaging;
        let differs = [
            (*version != wanted.version, format!("its pictures are of version {version}, this is {}", wanted.version)),
            (*scene != wanted.scene, "its pictures are of another scene, or the scene has changed since".into()),
            (*path != wanted.path, format!("its pictures are of the path `{path}`")),
            (self.size != wanted.size, format!("its pictures have {width}x{height} pixels")),
            (*fps != wanted.fps, format!("its pictures are {fps} a second")),
            (
                *averaging != wanted.averaging,
                format!(
                    "its pictures have {subframes} sub-frames, a shutter of {shutter} and {supersample} samples across a pixel"
                ),
            ),
            (
                *adapter != wanted.adapter && !is_mixed,
                format!("its pictures are drawn by {adapter}, and here {} draws, which --mixed allows", wanted.adapter),
            ),
        ];
        if let Some((_, difference)) = differs.into_iter().find(|(is_other, _)| *is_other) {
            return Some(difference);
        }
        let keys = set.keys().chain(wanted.set.keys());
        let key = keys.into_iter().find(|key| set.get(*key) != wanted.set.get(*key))?;
        let value = set.get(key).map_or("its default", String::as_str);
        Some(format!("its pictures are drawn with {key} = {value}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description() -> Description {
        let adapter = Adapter { name: "card".into(), backend: "Vulkan".into(), driver: "1.2".into() };
        Description {
            version: "0.1.0".into(),
            scene: "aa".into(),
            path: "tour".into(),
            size: [64, 48],
            fps: 30,
            adapter,
            set: [("splat.size".to_owned(), "2".to_owned())].into(),
            averaging: Averaging::NONE,
            auto: None,
        }
    }

    #[test]
    fn each_thing_that_decides_how_pictures_look_is_told_by_name() {
        let made = description();
        assert_eq!(made.difference(&description(), false), None);
        let told = |change: &dyn Fn(&mut Description)| {
            let mut wanted = description();
            change(&mut wanted);
            made.difference(&wanted, false).unwrap_or_default()
        };
        assert!(told(&|wanted| wanted.version = "0.2.0".into()).contains("version 0.1.0, this is 0.2.0"));
        assert!(told(&|wanted| wanted.scene = "bb".into()).contains("another scene"));
        assert!(told(&|wanted| wanted.path = "other".into()).contains("path `tour`"));
        assert!(told(&|wanted| wanted.size = [64, 49]).contains("64x48"));
        assert!(told(&|wanted| wanted.fps = 25).contains("30 a second"));
        assert!(told(&|wanted| wanted.averaging = Averaging::new(4, 0.5, 1)).contains("have 1 sub-frames"));
        assert!(told(&|wanted| wanted.adapter.driver = "1.3".into()).contains("card (Vulkan, 1.2)"));
        assert!(told(&|wanted| drop(wanted.set.remove("splat.size"))).contains("splat.size = 2"));
        assert!(
            told(&|wanted| drop(wanted.set.insert("gi.vpls".into(), "4".into()))).contains("gi.vpls = its default")
        );
        assert_eq!(told(&|wanted| wanted.auto = Some(1.into())), "");
        let mut other = description();
        other.adapter.name = "other card".into();
        assert_eq!(made.difference(&other, true), None);
        other.fps = 25;
        assert!(made.difference(&other, true).is_some_and(|told| told.contains("30 a second")));
    }
}
