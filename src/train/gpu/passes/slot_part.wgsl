// Which of the bindings of the slots has a pair; the last has all that is left. The twin of SLOT_PARTS in step_buffers.rs. Needs `step`.
fn slot_part(pair: u32) -> u32 {
    return min(pair / step.parts.w, 3u);
}
