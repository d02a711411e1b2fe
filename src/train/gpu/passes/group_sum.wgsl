// The sum over a workgroup of GROUP invocations, in a fixed order; for the first invocation. Needs the alias `Addend`.

var<workgroup> addends: array<Addend, GROUP>;

fn group_sum(local: u32, value: Addend) -> Addend {
    addends[local] = value;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            addends[local] += addends[local + half];
        }
    }
    return addends[0];
}
