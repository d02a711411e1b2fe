// Slots of pairs, spread over several bindings, because a card limits the size of each.

@group(0) @binding(11) var<storage, read_write> slots_0: array<f32>;
@group(0) @binding(12) var<storage, read_write> slots_1: array<f32>;
@group(0) @binding(13) var<storage, read_write> slots_2: array<f32>;
@group(0) @binding(14) var<storage, read_write> slots_3: array<f32>;

fn put_slot(part: u32, at: u32, number: f32) {
    switch part {
        case 0u: {
            slots_0[at] = number;
        }
        case 1u: {
            slots_1[at] = number;
        }
        case 2u: {
            slots_2[at] = number;
        }
        default: {
            slots_3[at] = number;
        }
    }
}
