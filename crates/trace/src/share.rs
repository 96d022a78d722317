//! The share that a mirror reflects, by the angle at which it is seen. The definition is the renderer's.

use scene::{FresnelLaw, MirrorSettings};

/// The share of what arrives along the reflected ray that a mirror shows whose normal has this cosine with the ray; and the
/// part of it that is not tinted.
pub(crate) fn mirror_share(specular_intensity: f64, cosine: f64, settings: &MirrorSettings) -> (f64, f64) {
    let flatness = (1.0 - cosine).clamp(0.0, 1.0);
    let fresnel = f64::from(settings.fresnel);
    match settings.fresnel_law {
        // Schlick 1994: the flatter the ray, the more is reflected, up to all of it, without a tint.
        FresnelLaw::Schlick => {
            let grazing = fresnel * flatness.powi(5);
            (specular_intensity + (1.0 - specular_intensity) * grazing, grazing)
        }
        // Popescu, Sacks and Mei 2006: the flatter, the less.
        FresnelLaw::Published => (specular_intensity * (1.0 - fresnel * (1.0 - (1.0 - flatness).powi(2))), 0.0),
    }
}
