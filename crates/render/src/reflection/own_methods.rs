//! Mirrors with methods of their own. The mirror that the camera sees at a pixel decides which method finds all bounces
//! of that pixel. So a picture of several methods is, mirror by mirror, the picture of each of them.
//!
//! A frame whose visible mirrors have one method is drawn as if that were `reflection.method`. In others, each method
//! runs on the mirror points of its own pixels (shaders/mirror_share.wgsl), one after the other in each bounce.

use glam::DVec3;
use scene::{Method, Mirror, Settings};

use super::bounce::{Parts, Search};
use super::formula;
use super::task::MirrorSurface;
use crate::frame::FrameCamera;
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::FormulaMirror;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::{Image, storage};

/// The images that share the mirror pixels out among methods.
pub(crate) struct OwnMethods {
    /// The number of the method of each mirror pixel.
    methods: Image,
    /// The mirror points of one method.
    points: Image,
}

/// The methods other than that of the settings that mirrors have for themselves, in the order of the menu.
pub(crate) fn all_own(store: &PointStore, settings: &Settings, mirrors: &[Mirror]) -> Vec<Method> {
    let of_clouds = store.mirror_clouds(settings).into_keys().map(|cloud| store.own_method(cloud));
    let of_formulas = formula::exact(settings, mirrors).map(|mirror| mirror.method);
    let usual = settings.reflection.method_of(None);
    let mut methods: Vec<Method> = of_formulas.chain(of_clouds).map(|own| settings.reflection.method_of(own)).collect();
    methods.retain(|method| *method != usual && usual != Method::None);
    in_order(methods)
}

/// Each method once, in the order of the menu.
fn in_order(mut methods: Vec<Method>) -> Vec<Method> {
    methods.sort_by_key(|method| *method as u32);
    methods.dedup();
    methods
}

/// The methods of the mirrors that the camera may see, in the order of the menu; that of the settings if there are none.
pub(crate) fn methods_of(
    store: &PointStore,
    settings: &Settings,
    mirrors: &[Mirror],
    camera: &FrameCamera,
) -> Vec<Method> {
    let usual = settings.reflection.method_of(None);
    if usual == Method::None || !settings.reflection.own_methods {
        return vec![usual];
    }
    let is_seen = |(center, radius): (DVec3, f64)| camera.sees(center, radius, 0.0);
    let of_formulas = formula::exact(settings, mirrors)
        .filter(|mirror| mirror.specular_intensity > 0.0 && is_seen((mirror.position, formula::reach(mirror).into())))
        .map(|mirror| mirror.method);
    let splat_size = f64::from(settings.splat.size);
    let of_clouds = store.mirror_clouds(settings).into_iter().filter_map(|(cloud, chunks)| {
        let mut placed = chunks.iter().filter_map(|id| store.placed(*id));
        let is_any_seen = placed.any(|chunk| {
            let reach = f64::from(chunk.largest_radius) * splat_size;
            is_seen((chunk.bounds.center(), chunk.bounds.radius() + reach))
        });
        is_any_seen.then(|| store.own_method(cloud))
    });
    let methods = in_order(of_formulas.chain(of_clouds).map(|own| settings.reflection.method_of(own)).collect());
    if methods.is_empty() { vec![usual] } else { methods }
}

impl OwnMethods {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        Self {
            methods: Image::new(&gpu.device, size, "methods of mirrors", wgpu::TextureFormat::R32Float),
            points: Image::new(&gpu.device, size, "mirror points of a method", wgpu::TextureFormat::Rgba32Float),
        }
    }

    pub fn bytes(&self) -> u64 {
        self.methods.bytes() + self.points.bytes()
    }

    /// Finds the method of each mirror pixel of the camera.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn find(&self, recorder: &mut Recorder<'_>, search: &Search<'_>, parts: &Parts<'_>) -> Result<()> {
        let Search { supply, settings, store, mirrors, camera, .. } = search;
        let mut runs: Vec<[u32; 4]> = Vec::new();
        for (cloud, chunks) in store.mirror_clouds(settings) {
            let number = parts.number_of(settings, store.own_method(cloud));
            let placed = chunks.iter().filter_map(|id| store.placed(*id));
            runs.extend(
                placed.map(|chunk| [chunk.first_identity, chunk.first_identity + chunk.points.len() as u32, number, 0]),
            );
        }
        let exact = formula::exact(settings, mirrors).filter_map(|mirror| {
            let part = parts.number_of(settings, mirror.method);
            Some(FormulaMirror { part, ..formula::formula(mirror, settings, supply.camera.eye)? })
        });
        let mut formulas: Vec<FormulaMirror> = exact.collect();
        // Bindings hold at least one: a run without points, and a mirror that reaches nowhere.
        runs.resize(runs.len().max(1), [0; 4]);
        formulas.resize(formulas.len().max(1), FormulaMirror::default());
        let upload = |label, bytes: &[u8]| {
            let buffer = storage(&recorder.gpu.device, label, bytes.len() as u64);
            recorder.gpu.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let runs = upload("points of mirrors", bytemuck::cast_slice(&runs));
        let formulas = upload("mirrors with methods", bytemuck::cast_slice(&formulas));
        let bindings = passes::mirror_methods {
            position_in: camera.position.bind(),
            nearest: parts.nearest.as_entire_binding(),
            runs: runs.as_entire_binding(),
            mirrors: formulas.as_entire_binding(),
            method_out: self.methods.bind(),
        };
        let usual = parts.number_of(settings, None);
        recorder.by_rows(&[("usual", usual)], supply, bindings, supply.mirror_groups())
    }

    /// The mirror points of a bounce, as far as they are those of a part.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn share(
        &self,
        recorder: &mut Recorder<'_>,
        supply: &Inputs,
        mirror: &MirrorSurface,
        part: usize,
    ) -> Result<MirrorSurface> {
        let bindings = passes::mirror_share {
            point_in: mirror.point.bind(),
            method_in: self.methods.bind(),
            point_out: self.points.bind(),
        };
        recorder.over_pixels(&[("part", part as u32)], supply, bindings)?;
        Ok(MirrorSurface { point: self.points.clone(), eye: mirror.eye.clone() })
    }
}
