// Sums each splat's slots over its tiles, which follow each other in the order of emission; an invocation
// handles one number of a splat.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> pair_starts: array<u32>;
@group(0) @binding(4) var<storage, read> slots_0: array<f32>;
@group(0) @binding(5) var<storage, read> slots_1: array<f32>;
@group(0) @binding(6) var<storage, read> slots_2: array<f32>;
@group(0) @binding(7) var<storage, read> slots_3: array<f32>;
@group(0) @binding(8) var<storage, read_write> sums: array<f32>;

fn slot(part: u32, at: u32) -> f32 {
    switch part {
        case 0u: {
            return slots_0[at];
        }
        case 1u: {
            return slots_1[at];
        }
        case 2u: {
            return slots_2[at];
        }
        default: {
            return slots_3[at];
        }
    }
}

@compute @workgroup_size(GROUP)
fn gather(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = workgroup_index(workgroup, workgroups) * GROUP + local;
    let numbers = step.modes.w;
    let rank = i / numbers;
    let number = i % numbers;
    if rank >= counts[SPLATS] {
        return;
    }
    var sum = 0.0;
    let end = min(pair_starts[rank + 1u], counts[PAIRS]);
    for (var pair = pair_starts[rank]; pair < end; pair++) {
        let part = slot_part(pair);
        let value = slot(part, (pair - part * step.parts.w) * numbers + number);
        sum = select(sum + value, max(sum, value), number == MAX_WEIGHT);
    }
    sums[order[rank] * numbers + number] = sum;
}
