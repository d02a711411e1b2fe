//! Panics: a fault of the program itself is one error like any other, and unwinding removes its temporary files.

use super::messages;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::sync::{Mutex, PoisonError};
use trisplat_scene::{
    Error, Result,
    input::{is_guarded, text},
};

/// Place of the last panic for [`caught`] to report.
static PLACE: Mutex<Option<String>> = Mutex::new(None);

/// From now on panics of this thread and its workers print nothing, because they become errors of files or of
/// [`caught`]. Panics of other threads print one line. Must be called from the main thread.
pub(super) fn report_once() {
    let main = std::thread::current().id();
    // A requested backtrace is still printed.
    let whole = std::env::var_os("RUST_BACKTRACE").map(|_| std::panic::take_hook());
    std::panic::set_hook(Box::new(move |info| {
        if is_guarded() {
            return;
        }
        whole.iter().for_each(|print| print(info));
        let place = info.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        if std::thread::current().id() == main || rayon::current_thread_index().is_some() {
            *PLACE.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
        } else {
            messages::print(&format!("warning: {}", fault(message_of(info), &place)));
        }
    }));
}

fn message_of<'a>(info: &'a PanicHookInfo<'_>) -> &'a str {
    text(info.payload())
}

/// The result of `run`; a panic becomes an error.
pub(super) fn caught<T>(run: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|payload| {
        let place = PLACE.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default();
        Err(Error::Incomplete(fault(text(&*payload), &place)))
    })
}

fn fault(message: &str, place: &str) -> String {
    format!("trisplat has a fault: {message}{place}; please report it with the command and its files")
}
