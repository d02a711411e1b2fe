// Sums of the pixels' gradients for some pairs of a tile, without atomics on floats: first an invocation is a pixel, and puts the
// shares of its layers into workgroup memory; then it is a block of 4 x 4 pixels of a pair, and sums 16 shares; then it is two
// numbers of a pair, and sums the pair's blocks. Every sum has a fixed order. Needs `table`, `pairs`, `owners`, `records`, tile_table.wgsl,
// put_slot.wgsl, splat_sums.wgsl, and `next_share`: the share on a pixel of the pair that is next in its order.

const ROW: u32 = PAIR_BLOCKS + 1u; // longer than needed, so that neighbours are in different banks

var<workgroup> batch: array<array<vec4<f32>, 4>, PAIRS_AT_ONCE>;
var<workgroup> batch_pairs: array<u32, PAIRS_AT_ONCE>;
var<workgroup> batch_splats: array<u32, PAIRS_AT_ONCE>;
var<workgroup> batch_blocks: array<u32, PAIRS_AT_ONCE>;
// The first block of each pair among all, and the pair and the place in the tile of each block.
var<workgroup> block_starts: array<u32, PAIRS_AT_ONCE + 1u>;
var<workgroup> block_owners: array<u32, PAIR_BLOCKS>;
// Pairs that may touch each block of the tile; a bit each.
var<workgroup> queues: array<atomic<u32>, 16>;
var<workgroup> taken_pairs: atomic<u32>;
// By pixel of a block, then by block: weight, negative where nothing is drawn, and gradient by the logarithm of alpha. Later two
// numbers of a slot, then by block.
var<workgroup> shares: array<vec2<f32>, 16u * ROW>;
var<workgroup> d_pixels: array<vec4<f32>, GROUP>;

// Loads pairs; before and after it all invocations must meet.
fn load_pairs(first: u32, end: u32, local: u32) {
    let k = local / 8u;
    let part = local % 8u;
    if part == 0u {
        batch_blocks[k] = 0u;
    }
    if first + k < end && part < 4u {
        let pair = pairs[first + k];
        let owner = owners[pair];
        batch[k][part] = records[4u * owner.x + part];
        if part == 0u {
            batch_pairs[k] = pair;
            batch_splats[k] = owner.x;
            batch_blocks[k] = owner.y;
        }
    }
    if local < 16u {
        atomicStore(&queues[local], 0u);
    }
    if local == 16u {
        atomicStore(&taken_pairs, 0u);
    }
}

// Gives places to the blocks of as many pairs as there is room for; after it all invocations must meet.
fn place_blocks(local: u32) {
    if local < PAIRS_AT_ONCE {
        var next = 0u;
        for (var k = 0u; k < local; k++) {
            next += countOneBits(batch_blocks[k]);
        }
        block_starts[local] = next;
        var blocks = batch_blocks[local];
        let end = next + countOneBits(blocks);
        if local + 1u == PAIRS_AT_ONCE {
            block_starts[PAIRS_AT_ONCE] = end;
        }
        if blocks != 0u && end <= PAIR_BLOCKS {
            atomicMax(&taken_pairs, local + 1u);
            while blocks != 0u {
                block_owners[next] = 16u * local + firstTrailingBit(blocks);
                blocks &= blocks - 1u;
                next += 1u;
            }
        }
    }
    let block = local / 16u;
    let first = local % 16u * 2u;
    let bits = (batch_blocks[first] >> block & 1u) | ((batch_blocks[first + 1u] >> block & 1u) << 1u);
    if bits != 0u {
        atomicOr(&queues[block], bits << first);
    }
}

// Pairs among the `taken` first that may touch the block of an invocation; a bit each.
fn queue_of(local: u32, taken: u32) -> u32 {
    return atomicLoad(&queues[local / 16u]) & (0xffffffffu >> (32u - taken));
}

// Where the share of a pair on the pixel of an invocation is.
fn share_at(k: u32, local: u32) -> u32 {
    let before = batch_blocks[k] & ((1u << (local / 16u)) - 1u);
    return local % 16u * ROW + block_starts[k] + countOneBits(before);
}

// Sums the shares of a block of a pair.
fn sum_block(at: u32, corner: vec2<u32>) -> SplatSums {
    let k = block_owners[at] / 16u;
    let first = block_owners[at] % 16u * 16u;
    let record = record_of(batch[k][0], batch[k][1], batch[k][2], batch[k][3]);
    var sums: SplatSums;
    for (var q = 0u; q < 16u; q++) {
        let share = shares[q * ROW + at];
        if share.x >= 0.0 {
            let pixel = corner + pixel_in_tile(first + q);
            add_share(&sums, record, pixel, d_pixels[first + q], share);
            if GEOMETRY {
                add_plane_share(&sums, batch_splats[k], record, pixel, share.x);
            }
        }
    }
    return sums;
}

// Sums the shares of the `taken` first pairs, and writes their slots; before it all invocations must meet.
fn write_slots(taken: u32, corner: vec2<u32>, local: u32) {
    let blocks = block_starts[taken];
    var sums: SplatSums;
    if local < blocks {
        sums = sum_block(local, corner);
    }
    workgroupBarrier();
    if local < blocks {
        for (var m = 0u; m < SLOT_VECTORS; m++) {
            shares[m * ROW + local] = slot_vector(sums, m);
        }
    }
    workgroupBarrier();
    for (var i = local; i < taken * SLOT_VECTORS; i += GROUP) {
        let k = i / SLOT_VECTORS;
        let m = i % SLOT_VECTORS;
        var total = vec2(0.0);
        for (var at = block_starts[k]; at < block_starts[k + 1u]; at++) {
            let part = shares[m * ROW + at];
            total = vec2(select(total.x + part.x, max(total.x, part.x), 2u * m == MAX_WEIGHT), total.y + part.y);
        }
        put_slot(batch_pairs[k], m, total);
    }
}

// Writes slots of pairs that show nothing.
fn write_nothing(first: u32, end: u32, local: u32) {
    for (var i = local; i < (end - first) * SLOT_VECTORS; i += GROUP) {
        put_slot(pairs[first + i / SLOT_VECTORS], i % SLOT_VECTORS, vec2(0.0));
    }
}

// The tile of a bucket, or NO_TILE.
fn tile_of_bucket(bucket: u32) -> u32 {
    if bucket >= bucket_of(table[tile_total()], tile_total()) {
        return NO_TILE;
    }
    return table[bucket_at(bucket)];
}

// Writes the slots of the pairs from `first` to `end` of the tile that begins at `corner`.
fn sum_pairs(first: u32, end: u32, corner: vec2<u32>, local: u32) {
    let pixel = corner + pixel_in_tile(local);
    for (var next = first; next < end;) {
        workgroupBarrier();
        load_pairs(next, end, local);
        workgroupBarrier();
        place_blocks(local);
        workgroupBarrier();
        let taken = atomicLoad(&taken_pairs);
        var queue = queue_of(local, taken);
        while queue != 0u {
            let k = firstTrailingBit(queue);
            queue &= queue - 1u;
            shares[share_at(k, local)] = next_share(k, next + k, pixel, local);
        }
        workgroupBarrier();
        write_slots(taken, corner, local);
        next += taken;
    }
}
