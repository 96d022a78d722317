// The virtual lights of the first bounce of light that mirrors throw: each stands where a photon has landed. One thread a
// light.
#import frame_group
#import vpl_of_surface

@group(1) @binding(0) var<uniform> lights: Virtual;
@group(1) @binding(1) var<storage, read> thrown: array<PhotonLight>;
@group(1) @binding(2) var<storage, read_write> vpls: array<Vpl>;

// A photon for which a virtual light stands. Declared in crates/render/src/layout.rs. Its position is relative to the
// virtual lights' origin.
struct PhotonLight {
    // w: squared radius of the surface that the light represents.
    position: vec4f,
    normal: vec4f,
    // Of the surface. a: specular intensity.
    albedo: vec4f,
    // rgb: flux that arrives.
    flux: vec4f,
    // xyz: the unit vector to where it comes from.
    toward: vec4f,
    // The number of the light among those of its bounce; PARENT_NONE if there is none.
    number: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}

@compute @workgroup_size(64)
fn vpl_photons(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&thrown) || thrown[id.x].number >= lights.lights_per_bounce {
        return;
    }
    let light = thrown[id.x];
    vpls[lights.sky_lights + light.number] = vpl_of_surface(
        lights, light.position.xyz, light.normal.xyz, light.toward.xyz, light.albedo, light.flux.rgb, light.position.w,
    );
}
