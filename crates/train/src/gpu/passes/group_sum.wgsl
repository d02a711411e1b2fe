// The sum over a workgroup of GROUP invocations, in a fixed order; for the first invocation. Needs the alias `Addend`.

var<workgroup> addends: array<Addend, GROUP>;

fn group_sum(local: u32, value: Addend) -> Addend {
    addends[local] = value;
    workgroupBarrier();
    if local < 16u {
        var sum = addends[local];
        for (var k = local + 16u; k < GROUP; k += 16u) {
            sum += addends[k];
        }
        addends[local] = sum;
    }
    workgroupBarrier();
    var total = addends[0];
    for (var k = 1u; k < 16u; k++) {
        total += addends[k];
    }
    return total;
}
