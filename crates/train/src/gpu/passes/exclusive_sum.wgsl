// Prefix sums of one number per invocation of a workgroup: in runs of 16, because a barrier costs more than 16 additions.

const RUNS: u32 = GROUP / 16u;

var<workgroup> running: array<u32, GROUP>;
var<workgroup> runs: array<u32, RUNS>;

// The sum of `value` over the invocations before this one.
fn exclusive_sum(local: u32, value: u32) -> u32 {
    running[local] = value;
    workgroupBarrier();
    if local < RUNS {
        var sum = 0u;
        for (var k = 16u * local; k < 16u * local + 16u; k++) {
            let next = sum + running[k];
            running[k] = sum;
            sum = next;
        }
        runs[local] = sum;
    }
    workgroupBarrier();
    var before = running[local];
    for (var run = 0u; run < local / 16u; run++) {
        before += runs[run];
    }
    workgroupBarrier();
    return before;
}
