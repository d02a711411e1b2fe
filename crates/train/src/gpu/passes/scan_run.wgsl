// Exclusive prefix sums of `length` numbers of `sums` from `begin` on, in place, by one workgroup. Needs `sums` and
// exclusive_sum.wgsl. Gives the last invocation the sum of all.

fn scan_run(begin: u32, length: u32, local: u32) -> u32 {
    let each = (length + GROUP - 1u) / GROUP;
    let first = begin + min(local * each, length);
    let end = begin + min(local * each + each, length);
    var sum = 0u;
    for (var i = first; i < end; i++) {
        sum += sums[i];
    }
    var before = exclusive_sum(local, sum);
    for (var i = first; i < end; i++) {
        let value = sums[i];
        sums[i] = before;
        before += value;
    }
    return before;
}
