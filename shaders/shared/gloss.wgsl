// The gloss of a surface: mirrors, and points that a scene makes glossy (a negative specular intensity), have their own
// specular intensity and power, all other surfaces those of the parameters.
#import params

struct SurfaceGloss {
    share: f32,
    power: f32,
}

fn gloss_of(settings: Settings, specular_intensity: f32, specular_power: f32) -> SurfaceGloss {
    if specular_intensity != 0.0 {
        // A power of 0 means a perfect mirror, which shows no light without size.
        return SurfaceGloss(select(0.0, abs(specular_intensity), specular_power > 0.0), specular_power);
    }
    return SurfaceGloss(settings.light.gloss, settings.light.gloss_power);
}
