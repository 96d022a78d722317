// A virtual light on a surface that receives light.
#import frame_group
#import vpl
#import brdf
#import gloss

// `toward` is the unit vector to the origin of the light; `squared` the squared radius of the surface that it
// represents.
fn vpl_of_surface(
    lights: Virtual,
    position: vec3f,
    normal: vec3f,
    toward: vec3f,
    albedo: vec4f,
    flux: vec3f,
    squared: f32,
) -> Vpl {
    // The power of mirrors is not known here, nor is that of glossy points, which are as sharp as the parameters say.
    let gloss = gloss_of(settings, albedo.a, select(0.0, settings.light.gloss_power, albedo.a < 0.0));
    // Where reflections are followed, mirrors give only their diffuse part: the light that they reflect is not followed
    // to other surfaces. Where none is, they are diffuse surfaces, as they are when they receive light.
    let reflected = select(0.0, albedo.a, albedo.a > 0.0 && lights.follows_mirrors != 0u);
    let share = (1.0 - max(gloss.share, reflected)) * settings.light.diffuse;
    let diffuse = albedo.rgb * flux * share / 3.14159265;
    let tint = mirror_tint(settings, albedo.rgb, 0.0);
    // A surface that reflects nothing has its place and shadow map all the same: its colour may change.
    let shines = select(VPL_NONE, VPL_LOCAL, any(normal != vec3f(0.0)));
    return Vpl(
        vec4f(position, squared),
        vec4f(normal, shines),
        vec4f(diffuse, gloss.power),
        vec4f(tint * flux * gloss.share, 0.0),
        vec4f(toward, 0.0),
        vec4f(tangent_of(normal), 1.0),
    );
}
