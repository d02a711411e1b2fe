// The binding that has a pair's slot; the last one has all the rest. The twin of SLOT_PARTS in
// step_buffers.rs. Needs `step`.
fn slot_part(pair: u32) -> u32 {
    return min(pair / step.parts.w, 3u);
}
