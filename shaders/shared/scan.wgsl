// Prefix sums over the lower invocations of a workgroup of 256 (Hillis, Steele 1986).

var<workgroup> scanned: array<vec2u, 256>;

struct Scan {
    before: vec2u,
    total: vec2u,
}

// All invocations of the workgroup must call it alike.
fn scan(lane: u32, value: vec2u) -> Scan {
    scanned[lane] = value;
    workgroupBarrier();
    for (var offset = 1u; offset < 256u; offset *= 2u) {
        var sum = scanned[lane];
        if lane >= offset {
            sum += scanned[lane - offset];
        }
        workgroupBarrier();
        scanned[lane] = sum;
        workgroupBarrier();
    }
    let found = Scan(scanned[lane] - value, scanned[255]);
    // Before the next call writes.
    workgroupBarrier();
    return found;
}
