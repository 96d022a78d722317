//! What `glint render --stats` writes beside a picture.

use std::collections::BTreeMap;

use param::Choice as _;
use render::{CameraCount, FrameStats, Gpu, MapCount, MapLimit, MapUse, PassStage};
use scene::Settings;
use serde::Serialize;
use study::Estimate;
use study::results::Spread;

use crate::commands::chosen::AutoStats;
use crate::commands::{listing, subject, truth};
use crate::shared::command_line::RenderArguments;
use crate::system::peak_memory::host_peak_bytes;

/// The content of `--stats`; names and order are fixed. Figures of reflections are about the first bounce, and null if
/// no reflections were looked for.
#[derive(Serialize)]
pub struct Stats {
    adapter: AdapterStats,
    clock: &'static str,
    size: [u32; 2],
    method: &'static str,
    /// The methods of the frame, if mirrors have their own and the frame has several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    methods: Vec<&'static str>,
    /// What `--set` must say for this picture: the parameters that differ from the defaults, and those that were given.
    set: BTreeMap<String, serde_json::Value>,
    points: PointStats,
    /// The times are medians over the frames.
    passes: Vec<PassStats>,
    frame_ms: f64,
    frames: usize,
    /// The stops that were fitted to the picture, with those of `tone.exposure`.
    #[serde(skip_serializing_if = "Option::is_none")]
    exposure: Option<f32>,
    mirror_pixels: usize,
    coverage: Option<f64>,
    closed_coverage: Option<f64>,
    hit_rate: Option<f64>,
    regions: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unresolved: Option<f64>,
    /// The maps around mirrors, of `cubemap_trace` and `light_field`.
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<MapStats>,
    /// The cells of space of `sample_cameras`.
    #[serde(skip_serializing_if = "Option::is_none")]
    cameras: Option<CameraStats>,
    uncertain: Option<f64>,
    /// The method that found what is seen through glass and water, where there is some.
    #[serde(skip_serializing_if = "Option::is_none")]
    seen_through_by: Option<&'static str>,
    bounces: u32,
    memory: MemoryStats,
    /// Null if all clouds are held in memory.
    pub stream: Option<subject::StreamReport>,
    accuracy: Option<study::Accuracy>,
    /// Null if it was not asked for, or there is nothing to estimate.
    pub estimate: Option<Estimate>,
    /// What `--budget` or `--error` let `auto` choose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auto: Option<AutoStats>,
}

#[derive(Serialize)]
struct AdapterStats {
    name: String,
    backend: String,
    kind: &'static str,
}

#[derive(Serialize)]
struct PointStats {
    scene: u64,
    drawn: u64,
}

#[derive(Serialize)]
struct PassStats {
    name: &'static str,
    stage: &'static str,
    ms: f64,
}

#[derive(Serialize)]
struct MapStats {
    drawn: u32,
    /// Fewer are drawn where they do not fit into one binding of the adapter, or into `light_field.memory`.
    asked: u32,
    #[serde(flatten)]
    map_use: Option<MapUseStats>,
}

/// The maps of `light_field`.
#[derive(Serialize)]
struct MapUseStats {
    /// The maps that were drawn for the last frame, and those that stood before.
    new: u32,
    kept: u32,
    /// The share of what mirror pixels ask for of which no map stood.
    missed: f64,
    bytes: u64,
    /// What limits the maps; null if nothing does.
    limit: Option<&'static str>,
    /// The share of mirror pixels that are predicted to be off by more than `light_field.accuracy`; null if that is 0.
    off: Option<f64>,
    /// The texels that were traced for the last frame; null where maps are made as a whole.
    texels: Option<u32>,
}

#[derive(Serialize)]
struct CameraStats {
    pinholes: u32,
    lists: u32,
    /// How many copies of each ray there are in all cells.
    ray_copies: f32,
    bytes: u64,
    /// The time that making them took.
    ms: f32,
    /// The share of the points found that a list projects.
    listed: f32,
}

impl CameraStats {
    fn new(cameras: &CameraCount) -> Self {
        let CameraCount { pinholes, lists, copies, bytes, milliseconds, listed, .. } = *cameras;
        Self { pinholes, lists, ray_copies: copies, bytes, ms: milliseconds, listed }
    }
}

#[derive(Serialize)]
struct MemoryStats {
    gpu_bytes: u64,
    host_peak_bytes: Option<u64>,
}

impl Stats {
    pub fn new(
        arguments: &RenderArguments,
        gpu: &Gpu,
        settings: &Settings,
        frames: &[FrameStats],
        mirror_pixels: usize,
    ) -> Self {
        let mut said: Vec<&str> = arguments.set.iter().map(|(key, _)| key.as_str()).collect();
        said.extend(arguments.seed.map(|_| "scene.seed"));
        let last = frames.last();
        let reflection = last.and_then(|frame| frame.reflection);
        let median = |values: Vec<f64>| Spread::of(values).map_or(0.0, |spread| spread.median);
        let pass_median = |name: &str| {
            let of_name = |frame: &FrameStats| {
                frame.passes.iter().filter(|pass| pass.name == name).map(|pass| pass.milliseconds).sum::<f64>()
            };
            median(frames.iter().map(of_name).collect())
        };
        let mut passes: Vec<PassStats> = Vec::new();
        for pass in last.iter().flat_map(|frame| &frame.passes) {
            if passes.iter().all(|listed| listed.name != pass.name) {
                passes.push(PassStats { name: pass.name, stage: pass.stage.name(), ms: pass_median(pass.name) });
            }
        }
        Self {
            adapter: AdapterStats {
                name: gpu.info.name.clone(),
                backend: gpu.info.backend.to_string(),
                kind: render::kind_name(gpu.info.device_type),
            },
            clock: gpu.clock.name(),
            size: arguments.size,
            method: settings.reflection.method.name(),
            methods: match last.map(|frame| frame.methods.as_slice()) {
                Some(several @ [_, _, ..]) => several.iter().map(|method| method.name()).collect(),
                _ => Vec::new(),
            },
            set: set_values(settings, &said),
            points: PointStats {
                scene: last.map_or(0, |frame| frame.points_resident),
                drawn: last.map_or(0, |frame| frame.points_drawn),
            },
            passes,
            frame_ms: median(frames.iter().map(|frame| frame.frame_milliseconds).collect()),
            frames: frames.len(),
            exposure: frames.last().and_then(|frame| frame.exposure).map(|exposure| exposure.stops),
            mirror_pixels,
            coverage: reflection.map(|stats| stats.coverage),
            closed_coverage: reflection.map(|stats| stats.closed_coverage),
            hit_rate: reflection.and_then(|stats| stats.hit_rate),
            regions: reflection.and_then(|stats| stats.regions),
            unresolved: reflection.and_then(|stats| stats.unresolved),
            maps: reflection.and_then(|stats| {
                let MapCount { drawn, asked } = stats.maps?;
                let map_use = stats.map_use.map(|MapUse { new, kept, missed, bytes, limit, off, texels }| {
                    let limit = limit.map(MapLimit::name);
                    MapUseStats { new, kept, missed, bytes, limit, off, texels }
                });
                Some(MapStats { drawn, asked, map_use })
            }),
            cameras: reflection.and_then(|stats| stats.cameras).map(|cameras| CameraStats::new(&cameras)),
            uncertain: reflection.map(|stats| stats.uncertain),
            seen_through_by: reflection.and_then(|stats| stats.seen_through_by).map(|method| method.row().name),
            bounces: reflection.map_or(0, |stats| stats.bounces),
            memory: MemoryStats {
                gpu_bytes: last.map_or(0, |frame| frame.gpu_bytes),
                host_peak_bytes: host_peak_bytes(),
            },
            stream: None,
            accuracy: None,
            estimate: None,
            auto: None,
        }
    }

    /// Adds what the ray tracer found. If it is the method, its figures replace those of the renderer.
    pub fn with(mut self, traced: truth::Outcome) -> Self {
        self.accuracy = traced.accuracy;
        if let Some(method) = traced.method {
            self.method = truth::RAY_TRACE;
            self.set.remove("reflection.method");
            let (name, stage) = (truth::RAY_TRACE, PassStage::Method.name());
            self.passes.push(PassStats { name, stage, ms: method.milliseconds });
            self.frame_ms += method.milliseconds;
            self.exposure = method.exposure;
            (self.coverage, self.closed_coverage) = (method.coverage, method.coverage);
            self.bounces = method.bounces;
        }
        self
    }
}

/// The parameters that differ from the defaults, and those of `said`, by their keys.
pub fn set_values(settings: &Settings, said: &[&str]) -> BTreeMap<String, serde_json::Value> {
    let mut set = BTreeMap::new();
    for params in settings.groups() {
        let group = params.group();
        for (field, value) in group.fields.iter().zip(params.values()) {
            let key = format!("{}.{}", group.name, field.name);
            if value != field.default() || said.contains(&key.as_str()) {
                set.insert(key, listing::value_json(field, &value));
            }
        }
    }
    set
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stats_name_what_was_set_even_to_its_default() {
        let mut settings = Settings::default();
        settings.set_text("splat.size", "2").unwrap();
        let set = set_values(&settings, &["edl.radius"]);
        assert_eq!(set.keys().collect::<Vec<_>>(), ["edl.radius", "splat.size"]);
        assert_eq!(set["splat.size"], serde_json::json!(2.0));
    }
}
