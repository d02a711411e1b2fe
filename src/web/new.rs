//! `operator new` and `operator delete` for meshopt's C++, which has no library of its own in
//! WebAssembly.

#![allow(unsafe_code)] // It hands out raw memory.

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};

/// Space for the size in front of each block; it keeps the strictest alignment of C++.
const BEFORE: usize = 16;

fn layout(bytes: usize) -> Layout {
    Layout::from_size_align(bytes.saturating_add(BEFORE), BEFORE)
        .unwrap_or_else(|_| handle_alloc_error(Layout::new::<[u8; BEFORE]>()))
}

/// `operator new(size_t)`.
#[unsafe(no_mangle)]
extern "C" fn _Znwm(bytes: usize) -> *mut u8 {
    let layout = layout(bytes);
    // SAFETY: size > 0; the block is aligned for `usize` and holds the header and `bytes` after it.
    unsafe {
        let place = alloc(layout);
        if place.is_null() {
            handle_alloc_error(layout);
        }
        place.cast::<usize>().write(bytes);
        place.add(BEFORE)
    }
}

/// `operator delete(void*)`.
#[unsafe(no_mangle)]
unsafe extern "C" fn _ZdlPv(given: *mut u8) {
    if given.is_null() {
        return;
    }
    // SAFETY: the caller gives what `_Znwm` gave, so that its size is before it, and gives it once.
    unsafe {
        let place = given.sub(BEFORE);
        dealloc(place, layout(place.cast::<usize>().read()));
    }
}
