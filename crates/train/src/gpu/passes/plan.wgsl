// Plans the work from the counts: lengths and numbers of workgroups for the following passes. If the buffers
// are too small, this step and all steps recorded after it do nothing: `halted` stays set until the host, a
// few steps later, enlarges the buffers and repeats them all.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> job: Job;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> groups: array<u32>;
@group(0) @binding(5) var<storage, read> room: array<u32>;
@group(0) @binding(6) var<storage, read_write> halted: array<u32>;

const MAX_ACROSS: u32 = 65535u;

fn set_groups(at: u32, items: u32, each: u32) {
    let wanted = (items + each - 1u) / each;
    let down = max((wanted + MAX_ACROSS - 1u) / MAX_ACROSS, 1u);
    groups[3u * at] = (wanted + down - 1u) / down;
    groups[3u * at + 1u] = down;
    groups[3u * at + 2u] = 1u;
}

fn plan_splats() {
    let wanted = starts[step.scene.x];
    var splats = wanted;
    counts[WANTED_SPLATS] = 0u;
    if halted[0] == 1u {
        splats = 0u;
    } else if wanted > room[0] {
        counts[WANTED_SPLATS] = wanted;
        halted[0] = 1u;
        splats = 0u;
    }
    counts[SPLATS] = splats;
    counts[SPLATS_1] = splats + 1u;
    set_groups(0u, splats + 1u, GROUP);
    set_groups(1u, splats, GROUP * SORT_ITEMS);
    set_groups(2u, splats + 1u, GROUP * SCAN_ITEMS);
    set_groups(3u, splats * step.modes.w, GROUP);
}

fn plan_pairs() {
    let wanted = starts[counts[SPLATS]];
    var pairs = wanted;
    counts[WANTED_PAIRS] = 0u;
    if wanted > room[1] {
        counts[WANTED_PAIRS] = wanted;
        halted[0] = 1u;
        pairs = 0u;
    }
    counts[PAIRS] = pairs;
    set_groups(4u, pairs, GROUP * SORT_ITEMS);
    set_groups(5u, bucket_of(pairs, tile_total()), 1u);
    set_groups(6u, select(step.parts.z, 0u, halted[0] == 1u), UPDATE_GROUP);
}

fn plan_layers() {
    let wanted = starts[counts[PIXELS_1] - 1u];
    counts[WANTED_LAYERS] = 0u;
    counts[LAYERS] = wanted;
    if wanted > room[2] {
        counts[WANTED_LAYERS] = wanted;
        counts[LAYERS] = 0u;
        halted[0] = 1u;
        set_groups(6u, 0u, UPDATE_GROUP);
    }
}

@compute @workgroup_size(1)
fn plan() {
    switch job.writes {
        case 0u: {
            plan_splats();
        }
        case 1u: {
            plan_pairs();
        }
        default: {
            plan_layers();
        }
    }
}
