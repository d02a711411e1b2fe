// The table of tiles: where each begins in the sorted pairs, and the end of the last; from which pair on nothing of it shows; and
// the tiles of the buckets. Needs `step`.
//
// A bucket is a run of BUCKET pairs of one tile. Numbers of buckets leave gaps, so that no sum over tiles is needed.

const NO_TILE: u32 = 0xffffffffu;

fn tile_total() -> u32 {
    return step.frame.z * step.frame.w;
}

// Where the table has the end of a tile.
fn shown_at(tile: u32) -> u32 {
    return tile_total() + 1u + tile;
}

// Where the table has the tile of a bucket.
fn bucket_at(bucket: u32) -> u32 {
    return 2u * tile_total() + 1u + bucket;
}

// The first bucket of a tile that begins at `start`.
fn bucket_of(start: u32, tile: u32) -> u32 {
    return start / BUCKET + tile;
}

// Where the frame has the colour and the light of a tile's first pixel in front of a bucket that is not the tile's first; `number`
// counts the tile's buckets.
fn checkpoint_at(start: u32, number: u32) -> u32 {
    return step.frame.x * step.frame.y + (start / BUCKET + number - 1u) * GROUP;
}

// The pixel of an invocation in its tile: 16 invocations are a block.
fn pixel_in_tile(local: u32) -> vec2<u32> {
    let block = vec2(local / 16u % 4u, local / 64u);
    return 4u * block + vec2(local % 4u, local / 4u % 4u);
}
