// The reflectance of surfaces, the same for direct and indirect light: highlights, and a mirror's share.
#import params

// The reflected radiance per irradiance of a highlight, for a surface that reflects nothing else; directions are unit
// vectors away from the surface. `kind` is LIGHT_HIGHLIGHT_*. Both are scaled so that no direction of light is
// reflected as more than arrived: Phong 1975 after Lafortune and Willems 1994, Blinn 1977 after the integral over n.h,
// which is exact for light along the normal.
fn highlight(kind: u32, normal: vec3f, to_light: vec3f, to_eye: vec3f, power: f32) -> f32 {
    if kind == LIGHT_HIGHLIGHT_PHONG {
        let cosine = dot(reflect(-to_light, normal), to_eye);
        return (power + 2.0) / 6.2831853 * pow(max(cosine, 0.0), power);
    }
    let middle = to_light + to_eye;
    let cosine = dot(normal, middle) * inverseSqrt(max(dot(middle, middle), 1e-12));
    let scale = (power + 2.0) * (power + 4.0) / (25.132741 * (exp2(-0.5 * power) + power));
    return scale * pow(max(cosine, 0.0), power);
}

// The share of the light that a mirror does not reflect at normal incidence but reflects at this angle (Schlick 1994), or,
// by the published law, that of what it reflects there and not at this angle (Popescu, Sacks and Mei 2006); `cosine` is
// that between its normal and the line of sight.
fn grazing_share(settings: Settings, cosine: f32, is_published: bool) -> f32 {
    let along = clamp(cosine, 0.0, 1.0);
    if is_published {
        return settings.mirror.fresnel * (1.0 - along * along);
    }
    return settings.mirror.fresnel * pow(1.0 - along, 5.0);
}

// The share of a mirror's picture that is reflected; its own diffuse light is the remainder.
fn mirror_share(specular_intensity: f32, grazing: f32, is_published: bool) -> f32 {
    if is_published {
        return specular_intensity * (1.0 - grazing);
    }
    return specular_intensity + (1.0 - specular_intensity) * grazing;
}

// The share of a reflection that is left where its ray meets something so many mirror radii away (Popescu, Sacks and Mei
// 2006), by mirror.fade_distance, which is above 0, and mirror.fade_least.
fn share_left(fade_distance: f32, fade_least: f32, radii: f32) -> f32 {
    let rest = 1.0 - min(radii / fade_distance, 1.0);
    return mix(fade_least, 1.0, rest * rest);
}

// The colour of the light that a surface reflects as a highlight or a mirror.
fn mirror_tint(settings: Settings, albedo: vec3f, grazing: f32) -> vec3f {
    return mix(vec3f(1.0), albedo, settings.mirror.tint * (1.0 - grazing));
}
