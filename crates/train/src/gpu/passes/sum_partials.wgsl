// Sums of all workgroups' partial sums, in a fixed order, to a place in `counts`.

struct Sum {
    place: u32,     // of the first sum
    length_at: u32, // where in `counts` the number of partial sums is
    numbers: u32,   // of four that are kept
}

@group(0) @binding(0) var<uniform> job: Sum;
@group(0) @binding(1) var<storage, read> partial_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

alias Addend = vec4<f32>;

@compute @workgroup_size(GROUP)
fn sum_partials(@builtin(local_invocation_index) local: u32) {
    var sum = vec4(0.0);
    for (var i = local; i < counts[job.length_at]; i += GROUP) {
        sum += partial_sums[i];
    }
    let total = group_sum(local, sum);
    if local == 0u {
        for (var k = 0u; k < job.numbers; k++) {
            counts[job.place + k] = bitcast<u32>(total[k]);
        }
    }
}
