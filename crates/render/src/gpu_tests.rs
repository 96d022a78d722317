//! Tests of the choice of adapters and of what they must promise.

use super::*;

fn adapter(name: &str, kind: wgpu::DeviceType, lacks: bool) -> (wgpu::AdapterInfo, bool) {
    (wgpu::AdapterInfo { name: name.into(), ..wgpu::AdapterInfo::new(kind, wgpu::Backend::Vulkan) }, lacks)
}

#[test]
fn an_adapter_is_chosen_by_its_whole_name_first_and_then_by_what_it_can_do() {
    use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu};
    let all = [
        adapter("Software", Cpu, false),
        adapter("RTX 3060 Ti", DiscreteGpu, false),
        adapter("RTX 3060", DiscreteGpu, false),
        adapter("Old Radeon", DiscreteGpu, true),
        adapter("Iris", IntegratedGpu, false),
    ];
    assert_eq!(choose(&all, None), Some(1));
    assert_eq!(choose(&all, Some("rtx")), Some(1));
    assert_eq!(choose(&all, Some("rtx 3060")), Some(2), "not the first that has it as a part");
    assert_eq!(choose(&all, Some("radeon")), Some(3), "what is asked for is refused with a reason");
    assert_eq!(choose(&all[3..], None), Some(1), "an integrated one that can, not a discrete one that cannot");
    assert_eq!(choose(&all[..1], Some("cpu")), Some(0));
    assert_eq!(choose(&all, Some("Arc")), None);
    assert_eq!(choose(&all, Some("dx12")), None);
    let mut twice = all.to_vec();
    twice.push(adapter("RTX 3060", DiscreteGpu, false));
    twice[5].0.backend = wgpu::Backend::Dx12;
    assert_eq!(choose(&twice, Some("DX12")), Some(5), "the same adapter by another backend");
    assert_eq!(choose(&twice, Some("rtx 3060")), Some(2), "the system's order");
}

#[test]
fn of_equal_adapters_the_one_in_the_same_place_is_opened_again_with_its_backend() {
    let named = |name: &str, backend, place: &str| wgpu::AdapterInfo {
        name: name.into(),
        device_pci_bus_id: place.into(),
        ..wgpu::AdapterInfo::new(wgpu::DeviceType::DiscreteGpu, backend)
    };
    use wgpu::Backend::{Dx12, Vulkan};
    let all = [
        named("RTX 3060", Vulkan, "0000:01:00.0"),
        named("RTX 3060", Vulkan, "0000:02:00.0"),
        named("RTX 3060", Dx12, "0000:02:00.0"),
        named("RTX 3060 Ti", Vulkan, "0000:03:00.0"),
    ];
    for (index, known) in all.iter().enumerate() {
        assert_eq!(most_like(&all, known), Some(index));
    }
    assert_eq!(most_like(&all[..1], &all[2]), Some(0), "one of the same name");
    assert_eq!(most_like(&all[..3], &all[3]), None);
}

#[test]
fn memory_that_ran_out_is_told_from_what_was_refused() {
    let source = || Box::new(std::io::Error::other("create_texture")) as wgpu::ErrorSource;
    assert!(matches!(Failure::of(&wgpu::Error::OutOfMemory { source: source() }), Failure::NoMemory(_)));
    let refused = wgpu::Error::Validation { source: source(), description: "a size".into() };
    assert!(matches!(Failure::of(&refused), Failure::Refused(_)));
}

#[test]
fn what_an_adapter_lacks_is_said_in_a_sentence() {
    let mut limits = wgpu::Limits::unlimited();
    assert_eq!(lack(&limits), None);
    limits.max_storage_buffers_per_shader_stage = 7;
    limits.max_bind_groups = 2;
    let buffers = NEEDS[0].least;
    assert_eq!(
        lack(&limits).unwrap(),
        format!(
            "it has 7 storage buffers in a shader where {buffers} are needed, 2 groups of bindings where 3 are needed"
        )
    );
}
