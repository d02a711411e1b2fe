// The splats of a tile, BATCH at a time, in workgroup memory, with a queue for every block of those that may touch it. Needs
// `pairs`, `owners`, `records` and `planes`.

var<workgroup> batch: array<array<vec4<f32>, 4>, BATCH>;
var<workgroup> batch_planes: array<array<vec4<f32>, 2>, BATCH>;
var<workgroup> batch_blocks: array<u32, BATCH>;
var<workgroup> queues: array<array<atomic<u32>, 2>, 16>;

// Loads the pairs from `first` on; before and after it all invocations must meet.
fn load_batch(first: u32, end: u32, local: u32) {
    let k = local / 4u;
    let part = local % 4u;
    if first + k < end {
        let owner = owners[pairs[first + k]];
        batch[k][part] = records[4u * owner.x + part];
        if part == 0u {
            batch_blocks[k] = owner.y;
        }
        if NEEDS_PLANES && part < 2u {
            batch_planes[k][part] = planes[2u * owner.x + part];
        }
    } else if part == 0u {
        batch_blocks[k] = 0u;
    }
    if local < 32u {
        atomicStore(&queues[local / 2u][local % 2u], 0u);
    }
}

// Puts the splats into the queues; after it all invocations must meet.
fn fill_queues(local: u32) {
    let block = local / 16u;
    let first = local % 16u * 4u;
    var bits = 0u;
    for (var k = 0u; k < 4u; k++) {
        bits |= (batch_blocks[first + k] >> block & 1u) << k;
    }
    if bits != 0u {
        atomicOr(&queues[block][first / 32u], bits << (first % 32u));
    }
}
