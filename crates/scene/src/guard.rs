//! Panics of dependencies: a decoder's panic on a damaged file becomes an error of that file and does not end
//! the program.
//!
//! This needs a program whose profile unwinds. In one that aborts on panic, the checks that readers make beforehand remain.

use crate::error::{Error, Result};
use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// The result of `decode` for the file at `path`; its panic becomes an error of that file.
///
/// Errors: those of `decode`; `Malformed` for a panic.
pub fn guarded<T>(path: &Path, decode: impl FnOnce() -> Result<T>) -> Result<T> {
    let before = GUARDED.replace(true);
    // Nothing that `decode` changes is used after a panic: it is dropped with its closure.
    let decoded = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(before);
    decoded.unwrap_or_else(|payload| Err(failed(path, text(&*payload))))
}

/// The error for a file whose decoder panicked with this message.
pub fn failed(path: &Path, message: &str) -> Error {
    let reason = format!("is damaged in a way that its decoder fails on ({message}); copy it again");
    Error::malformed(path, "content", reason)
}

/// True while this thread decodes under [`guarded`]: its panic becomes an error, so a panic hook need not report it.
pub fn is_guarded() -> bool {
    GUARDED.get()
}

/// The message of a panic.
pub fn text(payload: &(dyn Any + Send)) -> &str {
    let owned = || payload.downcast_ref::<String>().map(String::as_str);
    payload.downcast_ref::<&str>().copied().or_else(owned).unwrap_or("panic without a message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_decoder_is_an_error_of_its_file() {
        let path = Path::new("photo.png");
        let index = std::hint::black_box(3);
        for (decode, wants) in [
            (&(|| Ok([1, 2][index])) as &dyn Fn() -> Result<i32>, "index out of bounds"),
            (&|| panic!("unexpected chunk"), "unexpected chunk"),
        ] {
            let message = guarded(path, decode).unwrap_err().to_string();
            assert!(message.starts_with("photo.png: content: ") && message.contains(wants), "{message}");
            assert!(!is_guarded());
        }
        assert!(guarded(path, || Ok(is_guarded())).unwrap());
        let refused = guarded(path, || Err::<(), _>(Error::malformed(path, "byte 3", "is 7"))).unwrap_err();
        assert_eq!(refused.to_string(), "photo.png: byte 3: is 7");
    }
}
