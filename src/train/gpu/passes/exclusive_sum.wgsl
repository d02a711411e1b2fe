// Prefix sums of one number per invocation of a workgroup.

var<workgroup> running: array<u32, GROUP>;

// The sum of `value` over the invocations before this one.
fn exclusive_sum(local: u32, value: u32) -> u32 {
    running[local] = value;
    workgroupBarrier();
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        var sum = running[local];
        if local >= reach {
            sum += running[local - reach];
        }
        workgroupBarrier();
        running[local] = sum;
        workgroupBarrier();
    }
    let before = running[local] - value;
    workgroupBarrier();
    return before;
}
