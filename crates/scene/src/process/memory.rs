//! Out of memory: an unexpected failure to allocate ends the program cleanly instead of aborting.

#![allow(unsafe_code)] // An allocator is.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Ends the process; its argument is the number of bytes that could not be allocated. It may allocate a
/// little.
pub type OutOfMemory = fn(usize) -> !;

static END: OnceLock<OutOfMemory> = OnceLock::new();
static ENDING: AtomicBool = AtomicBool::new(false);

thread_local! {
    static FORESEEN: Cell<bool> = const { Cell::new(false) };
    static ENDS_IT: Cell<bool> = const { Cell::new(false) };
}

/// From now on a failed allocation ends the process with `end`, once, if the program's allocator is an
/// [`Allocator`].
pub fn end_with(end: OutOfMemory) {
    // Who came first stays.
    let _ = END.set(end);
}

/// Makes an allocation that may fail: `request` gets the failure, and the process continues.
pub fn foreseen<T>(request: impl FnOnce() -> T) -> T {
    let before = FORESEEN.replace(true);
    let made = request();
    FORESEEN.set(before);
    made
}

/// The system's allocator; a failed request calls [`end_with`]'s function.
#[derive(Debug)]
pub struct Allocator;

// SAFETY: every call is handed on to the system's allocator as it came, and its answer given back as it is.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are those that the system's allocator asks for; so below.
        given(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        given(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        given(unsafe { System.realloc(place, layout, size) }, size)
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(place, layout) }
    }
}

#[inline]
fn given(place: *mut u8, bytes: usize) -> *mut u8 {
    if place.is_null() {
        end(bytes);
    }
    place
}

/// Ends the process unless the failure was foreseen, or unless it is ending already by this thread: then Rust's own abort follows.
#[cold]
fn end(bytes: usize) {
    // A thread that is ending has no such values any more.
    let is_foreseen = FORESEEN.try_with(Cell::get).unwrap_or(false);
    let Some(end) = END.get().filter(|_| !is_foreseen) else { return };
    if !ENDING.swap(true, Ordering::SeqCst) {
        let _ = ENDS_IT.try_with(|ends| ends.set(true));
        end(bytes);
    }
    while !ENDS_IT.try_with(Cell::get).unwrap_or(false) {
        // Another thread is about to end the process.
        std::thread::park();
    }
}
