//! A CPU twin of shaders/shared/beam.wgsl, with the same local names: the bound by which hierarchical SSCR culls whole
//! nodes. No true root may be culled, so the tests prove the bound by rays and compare the shader with the twin.

use glam::Vec3;

#[derive(Clone, Copy, Debug)]
struct Beam {
    origin_low: Vec3,
    origin_high: Vec3,
    direction_low: Vec3,
    direction_high: Vec3,
}

/// The earliest distance at which a ray of the beam can enter a box; negative if no ray can.
fn beam_entry(beam: &Beam, low: Vec3, high: Vec3) -> f32 {
    let least = low - beam.origin_high;
    let most = high - beam.origin_low;
    let (mut entry, mut exit, mut is_possible): (f32, f32, bool) = (0.0, 3e38, true);
    for axis in 0..3 {
        let up = beam.direction_high[axis];
        let down = beam.direction_low[axis];
        // t up >= least
        if up > 0.0 {
            entry = entry.max(least[axis] / up);
        } else if up < 0.0 {
            exit = exit.min(least[axis] / up);
        } else {
            is_possible &= least[axis] <= 0.0;
        }
        // t down <= most
        if down > 0.0 {
            exit = exit.min(most[axis] / down);
        } else if down < 0.0 {
            entry = entry.max(most[axis] / down);
        } else {
            is_possible &= most[axis] >= 0.0;
        }
    }
    if is_possible && entry <= exit * 1.00001 { entry } else { -1.0 }
}

/// The extent of the beam across at a distance.
fn beam_width(beam: &Beam, distance: f32) -> f32 {
    let across = (beam.origin_high - beam.origin_low) + (beam.direction_high - beam.direction_low) * distance;
    across.max_element()
}

mod tests {
    use proptest::prelude::*;
    use proptest::strategy::ValueTree as _;

    use super::*;
    use crate::Gpu;
    use crate::targets::storage;

    fn vector(range: std::ops::RangeInclusive<f32>) -> impl Strategy<Value = Vec3> + Clone {
        [range.clone(), range.clone(), range].prop_map(Vec3::from)
    }

    /// Widths from zero to that of a tile at a silhouette.
    fn width() -> impl Strategy<Value = Vec3> {
        (vector(0.0..=1.0), prop::sample::select(vec![0.0, 1e-6, 1e-3, 0.1, 1.0])).prop_map(|(v, scale)| v * scale)
    }

    prop_compose! {
        /// Some directions are along an axis, so a component is zero.
        fn beam()(
            origin in vector(-5.0..=5.0),
            origin_width in width(),
            direction in vector(-1.0..=1.0),
            keep in prop::array::uniform3(prop::bool::weighted(0.85)),
            direction_width in width(),
        ) -> Beam {
            let direction = direction * Vec3::from(keep.map(f32::from));
            Beam {
                origin_low: origin,
                origin_high: origin + origin_width,
                direction_low: direction,
                direction_high: direction + direction_width,
            }
        }
    }

    /// A point between two corners; rounding cannot move it outside.
    fn between(low: Vec3, high: Vec3, share: Vec3) -> Vec3 {
        (low + (high - low) * share).clamp(low, high)
    }

    /// A beam, a ray of it, and a box about that ray or a little beside it.
    #[derive(Clone, Copy, Debug)]
    struct Case {
        beam: Beam,
        origin: Vec3,
        direction: Vec3,
        /// The distance along the ray to the box.
        distance: f32,
        low: Vec3,
        high: Vec3,
    }

    prop_compose! {
        fn beam_and_box()(
            beam in beam(),
            shares in [vector(0.0..=1.0), vector(0.0..=1.0)],
            distance in 0.0_f32..8.0,
            aside in vector(-3.0..=3.0),
            extent in width(),
        ) -> Case {
            let origin = between(beam.origin_low, beam.origin_high, shares[0]);
            let direction = between(beam.direction_low, beam.direction_high, shares[1]);
            let center = origin + direction * distance + aside * extent;
            Case { beam, origin, direction, distance, low: center - extent, high: center + extent }
        }
    }

    /// Where a ray truly enters a box, if it does: in doubles, by the slab method.
    fn ray_entry(origin: Vec3, direction: Vec3, low: Vec3, high: Vec3) -> Option<f64> {
        let (mut entry, mut exit) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let [o, d, low, high] = [origin[axis], direction[axis], low[axis], high[axis]].map(f64::from);
            if d == 0.0 {
                if o < low || o > high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - o) / d, (high - o) / d);
            entry = entry.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        (entry <= exit).then_some(entry)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn a_box_that_any_ray_of_the_beam_meets_is_never_culled_nor_entered_too_late(case in beam_and_box()) {
            let Case { beam, origin, direction, low, high, .. } = case;
            if let Some(truth) = ray_entry(origin, direction, low, high) {
                let entry = beam_entry(&beam, low, high);
                prop_assert!(entry >= 0.0, "culled: {:?}", case);
                // Division in single precision is exact to a ten-millionth.
                prop_assert!(f64::from(entry) <= truth * (1.0 + 1e-6), "{} after {}: {:?}", entry, truth, case);
            }
        }

        #[test]
        fn rays_of_a_beam_are_no_farther_apart_than_its_width(
            beam in beam(),
            shares in [vector(0.0..=1.0), vector(0.0..=1.0), vector(0.0..=1.0), vector(0.0..=1.0)],
            distance in 0.0_f32..8.0,
        ) {
            let [a, b, c, d] = shares;
            let at = |origin, direction| {
                between(beam.origin_low, beam.origin_high, origin)
                    + between(beam.direction_low, beam.direction_high, direction) * distance
            };
            let apart = (at(a, b) - at(c, d)).abs().max_element();
            // The rounding of positions up to 20.
            prop_assert!(apart <= beam_width(&beam, distance) + 1e-5, "{} apart", apart);
        }
    }

    #[test]
    fn boxes_that_no_ray_can_reach_are_culled() {
        let beam = Beam {
            origin_low: Vec3::splat(-0.1),
            origin_high: Vec3::splat(0.1),
            direction_low: Vec3::new(-0.1, -0.1, 0.9),
            direction_high: Vec3::new(0.1, 0.1, 1.0),
        };
        let around = |center: Vec3| beam_entry(&beam, center - 0.2, center + 0.2);
        assert!(around(Vec3::ZERO) == 0.0 && (around(Vec3::Z * 5.0) - 4.7).abs() < 1e-5);
        for beside in [Vec3::Z * -1.0, Vec3::X * 1.0, Vec3::new(1.0, 0.0, 5.0), Vec3::new(0.0, -1.0, 5.0)] {
            assert!(around(beside) < 0.0, "{beside}");
        }
        // Along one axis nothing moves.
        let level = Beam { direction_low: Vec3::X, direction_high: Vec3::X, ..beam };
        assert!(beam_entry(&level, Vec3::new(3.0, -1.0, 0.0), Vec3::new(4.0, 1.0, 1.0)) > 2.8);
        assert!(beam_entry(&level, Vec3::new(3.0, 0.2, 0.0), Vec3::new(4.0, 1.0, 1.0)) < 0.0);
    }

    const KERNEL: &str = "
        @group(0) @binding(0) var<storage, read> cases: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> results: array<vec2f>;
        @compute @workgroup_size(64)
        fn check(@builtin(global_invocation_id) id: vec3u) {
            let i = id.x * 6u;
            let beam = Beam(cases[i].xyz, cases[i + 1u].xyz, cases[i + 2u].xyz, cases[i + 3u].xyz);
            let entry = beam_entry(beam, cases[i + 4u].xyz, cases[i + 5u].xyz);
            results[id.x] = vec2f(entry, beam_width(beam, cases[i].w));
        }";

    #[test]
    fn the_shader_bounds_as_its_twin_does() {
        let Some(gpu) = Gpu::shared() else { return };
        const CASES: usize = 4096;
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let strategy = beam_and_box();
        let cases: Vec<_> = (0..CASES).map(|_| strategy.new_tree(&mut runner).unwrap().current()).collect();
        let words: Vec<f32> = cases
            .iter()
            .flat_map(|Case { beam, distance, low, high, .. }| {
                let Beam { origin_low, origin_high, direction_low, direction_high } = *beam;
                [origin_low, origin_high, direction_low, direction_high, *low, *high]
                    .map(|v| v.extend(*distance).to_array())
            })
            .flatten()
            .collect();
        let source = format!("{}{KERNEL}", include_str!("../../../../shaders/shared/beam.wgsl"));
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let [input, output] = [bytes.len(), CASES * 8].map(|bytes| storage(&gpu.device, "beams", bytes as u64));
        gpu.queue.write_buffer(&input, 0, bytes);
        let entry = |(binding, buffer): (u32, _)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::Buffer::as_entire_binding(buffer),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[entry((0, &input)), entry((1, &output))],
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(CASES as u32 / 64, 1, 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        let results: Vec<[f32; 2]> =
            bytemuck::pod_collect_to_vec(&gpu.read_buffer(&output, 0, CASES as u64 * 8).unwrap());
        let mut met = 0;
        for (Case { beam, distance, low, high, .. }, [entry, width]) in cases.iter().zip(results) {
            let expected = (beam_entry(beam, *low, *high), beam_width(beam, *distance));
            // Vulkan allows an error of two and a half units in the last place for a division.
            let is_close = |a: f32, b: f32| (a - b).abs() <= b.abs() * 1e-6;
            assert!(
                is_close(entry, expected.0) && is_close(width, expected.1),
                "{entry} {width}: {expected:?} {beam:?}"
            );
            met += usize::from(entry >= 0.0);
        }
        assert!(met > CASES / 10 && met < CASES * 9 / 10, "{met} of {CASES} met: the comparison would prove little");
    }
}
