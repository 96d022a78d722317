//! Every buffer and texture is made here, so that a test can refuse each of them in turn. One that there is no memory for is
//! an invalid one: wgpu calls the device's handler of errors, and the frame ends with what `Gpu::failure` says.

/// Makes a buffer.
pub(crate) fn buffer(device: &wgpu::Device, descriptor: &wgpu::BufferDescriptor<'_>) -> wgpu::Buffer {
    #[cfg(test)]
    tests::note(descriptor.label, descriptor.size);
    #[cfg(test)]
    if tests::is_refused() {
        return device.create_buffer(&wgpu::BufferDescriptor { size: 1 << 60, ..descriptor.clone() });
    }
    device.create_buffer(descriptor)
}

/// Makes a texture.
pub(crate) fn texture(device: &wgpu::Device, descriptor: &wgpu::TextureDescriptor<'_>) -> wgpu::Texture {
    #[cfg(test)]
    tests::note(descriptor.label, bytes_of(descriptor));
    #[cfg(test)]
    if tests::is_refused() {
        let size = wgpu::Extent3d { width: 1 << 30, ..descriptor.size };
        return device.create_texture(&wgpu::TextureDescriptor { size, ..descriptor.clone() });
    }
    device.create_texture(descriptor)
}

#[cfg(test)]
fn bytes_of(descriptor: &wgpu::TextureDescriptor<'_>) -> u64 {
    let wgpu::Extent3d { width, height, .. } = descriptor.size;
    u64::from(width) * u64::from(height) * u64::from(descriptor.format.block_copy_size(None).unwrap_or(0))
}

#[cfg(test)]
pub(crate) mod tests {
    use std::cell::{Cell, RefCell};
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use cloud::{Chunk, pack_radius};
    use glam::DVec3;
    use scene::{Camera, LightClues, LightView, Method, Mirror, Settings, Shape, Show, SpotLight};

    use crate::{Error, Frame, Gpu, Material, Objects, PointStore, Renderer};

    thread_local! {
        /// How many more buffers and textures are made before one is refused.
        static LEFT: Cell<Option<u32>> = const { Cell::new(None) };
        /// The bytes of what this thread has made, by its label.
        static MADE: RefCell<BTreeMap<String, u64>> = const { RefCell::new(BTreeMap::new()) };
    }

    pub(super) fn note(label: Option<&str>, bytes: u64) {
        MADE.with_borrow_mut(|made| *made.entry(label.unwrap_or("?").to_owned()).or_default() += bytes);
    }

    /// The bytes of what this thread has made since it was asked last, by label.
    pub(crate) fn made() -> BTreeMap<String, u64> {
        MADE.take()
    }

    pub(super) fn is_refused() -> bool {
        let left = LEFT.get();
        LEFT.set(left.and_then(|left| left.checked_sub(1)));
        left == Some(0)
    }

    /// A wall behind a mirror, a lamp, and what is seen of them.
    pub(crate) struct Room {
        pub store: PointStore,
        pub camera: Camera,
        pub mirrors: [Mirror; 1],
        pub lights: [SpotLight; 1],
    }

    impl Room {
        pub fn new(gpu: &Arc<Gpu>) -> Self {
            let mut store = PointStore::new(gpu.clone());
            let cloud = store.add_cloud(Material::default());
            let wall = (-4..4).flat_map(|x| (-4..4).map(move |y| [x as f32 * 0.2, y as f32 * 0.2, -0.9]));
            let mut chunk = Chunk::new(0, DVec3::ZERO, wall.collect());
            chunk.radii = Some(Arc::new(vec![pack_radius(0.2); chunk.len()]));
            store.add_chunk(cloud, &chunk, None).unwrap();
            let lamp = SpotLight {
                position: DVec3::Z * 3.0,
                target: DVec3::ZERO,
                intensity: [10.0; 3],
                inner_degrees: 50.0,
                outer_degrees: 60.0,
            };
            Self {
                store,
                camera: Camera::looking(DVec3::ZERO, DVec3::new(1.0, 0.3, 0.2), 3.0, DVec3::Z),
                mirrors: [Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.5)],
                lights: [lamp],
            }
        }

        pub fn objects(&self) -> Objects<'_> {
            Objects { mirrors: &self.mirrors, lights: &self.lights, clues: LightClues::default() }
        }

        /// A method's settings, with little work for each of its parts.
        pub fn settings(method: Method) -> Settings {
            let mut settings = Settings::default();
            settings.reflection.method = method;
            (settings.gi.vpls, settings.gi.shadow_points, settings.gi.shadow_size) = (4, 64, 16);
            settings.environment_map.size = 16;
            (settings.cubemap_trace.size, settings.cubemap_trace.maps) = (16, 1);
            (settings.light_field.size, settings.light_field.samples) = (16, 1);
            settings
        }
    }

    #[test]
    fn a_frame_that_is_refused_memory_anywhere_ends_with_an_error_and_the_next_one_is_whole() {
        let Some(gpu) = Gpu::for_test() else { return };
        type Change = fn(&mut Settings, &mut Room);
        let cases: [(Method, Change); 5] = [
            (Method::Sscr, |settings, _| settings.light.show = LightView::VirtualLights),
            (Method::SurfelTrace, |settings, room| {
                (settings.gloss.samples, settings.reflection.show) = (2, Show::Error);
                room.mirrors[0].specular_power = 50.0;
            }),
            (Method::CubemapTrace, |_, _| ()),
            (Method::LightField, |_, _| ()),
            (Method::SampleCameras, |_, _| ()),
        ];
        for (number, (method, change)) in cases.into_iter().enumerate() {
            let (mut room, mut settings) = (Room::new(&gpu), Room::settings(method));
            change(&mut settings, &mut room);
            let mut renderer = Renderer::bare(gpu.clone());
            let mut draw = |left: Option<u32>| {
                LEFT.set(left);
                let outcome =
                    renderer.render(&room.store, &Frame::new(&room.camera, &settings, room.objects(), [16, 12]));
                let was_refused = LEFT.replace(None).is_none() && left.is_some();
                let picture = outcome.and_then(|_| renderer.read_picture());
                if picture.is_ok() {
                    renderer.release();
                }
                (picture, was_refused)
            };
            let whole = draw(None).0.unwrap();
            let mut refused = 0;
            for left in 0.. {
                let (picture, was_refused) = draw(Some(left));
                if !was_refused {
                    assert!(picture.unwrap() == whole, "case {number}");
                    break;
                }
                refused += 1;
                let error = picture.expect_err("a frame without one of its images");
                let is_told = matches!(error, Error::Device { .. } | Error::NoMemory { .. });
                assert!(is_told, "case {number}, {left}: {error}");
                // Every frame after a refusal would double the time of the test.
                if left % 8 == 0 {
                    let is_whole = draw(None).0.unwrap() == whole;
                    assert!(is_whole, "case {number}, {left}: something of the refused frame was kept");
                }
            }
            println!("{}: {refused} places", method.row().name);
            assert!(refused > 30, "case {number}: {refused}");
        }
    }
}
