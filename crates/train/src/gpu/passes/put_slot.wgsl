// Slots of pairs, spread over several bindings, because a card limits the size of each.

@group(0) @binding(6) var<storage, read_write> slots_0: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> slots_1: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> slots_2: array<vec2<f32>>;
@group(0) @binding(9) var<storage, read_write> slots_3: array<vec2<f32>>;

// Two numbers of a pair's slot.
fn put_slot(pair: u32, vector: u32, numbers: vec2<f32>) {
    let part = slot_part(pair);
    let at = (pair - part * step.parts.w) * SLOT_VECTORS + vector;
    switch part {
        case 0u: {
            slots_0[at] = numbers;
        }
        case 1u: {
            slots_1[at] = numbers;
        }
        case 2u: {
            slots_2[at] = numbers;
        }
        default: {
            slots_3[at] = numbers;
        }
    }
}
