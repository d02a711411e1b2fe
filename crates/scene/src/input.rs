//! Input files: regular ones, with a known size that is checked against the limits before reading.
//!
//! A pipe or a device may have any length or never end, so neither is read by its name. A shell's
//! `/dev/fd/63` (`<(...)`) is spooled into a temporary file, like standard input.

use crate::error::{Error, Result};
use crate::limits::Limits;
use std::any::Any;
use std::cell::Cell;
use std::collections::HashSet;
use std::fs::{File, Metadata};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Component, Path, PathBuf};

/// The byte-order mark that some editors put before a text in UTF-8.
pub const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Bytes that a copy moves at once.
const BLOCK: usize = 1 << 16;

/// An open file at byte 0, and its length.
///
/// # Errors
///
/// Not a regular file; larger than `file_bytes`.
pub fn open(path: &Path, limits: &Limits) -> Result<(File, u64)> {
    let io = |e| Error::unread(path, e);
    // Before it is opened: opening a pipe waits for its writer.
    let meta = std::fs::metadata(path).map_err(io)?;
    if is_handed_over(path, &meta) {
        return spool(path, &mut File::open(path).map_err(io)?, limits);
    }
    check_regular(path, &meta)?;
    let file = File::open(path).map_err(io)?;
    let meta = file.metadata().map_err(io)?;
    check_regular(path, &meta)?;
    limits.file(path, meta.len())?;
    Ok((file, meta.len()))
}

/// Beginning of the text that git leaves in place of a file of a clone without git-lfs.
const LFS_POINTER: &[u8] = b"version https://git-lfs";

/// True when a file that begins with `head` is a pointer of git-lfs.
pub fn is_lfs_pointer(head: &[u8]) -> bool {
    head.starts_with(LFS_POINTER)
}

/// Copies a stream to a temporary file; returns it at byte 0, and its length. `path` is for
/// messages.
pub fn spool(path: &Path, from: &mut dyn Read, limits: &Limits) -> Result<(File, u64)> {
    let mut file = tempfile::tempfile().map_err(Error::temporary)?;
    let mut limited = from.take(limits.file_bytes.saturating_add(1));
    let len = copy_stream(&mut limited, &mut file, |e| Error::io(path, e), Error::temporary)?;
    limits.file(path, len)?;
    file.seek(SeekFrom::Start(0)).map_err(Error::temporary)?;
    Ok((file, len))
}

/// Copies a file. An error names the file that could not be read or written.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    let unread = |e| Error::io(from, e);
    let unwritten = |e| Error::io(to, e);
    let mut source = File::open(from).map_err(unread)?;
    let mut target = File::create(to).map_err(unwritten)?;
    copy_stream(&mut source, &mut target, unread, unwritten).map(drop)
}

/// Copies a stream to its end; returns the number of bytes. `unread` and `unwritten` make the
/// errors of the two sides.
pub fn copy_stream(
    from: &mut dyn Read,
    to: &mut dyn Write,
    unread: impl Fn(std::io::Error) -> Error,
    unwritten: impl Fn(std::io::Error) -> Error,
) -> Result<u64> {
    let mut buffer = vec![0; BLOCK];
    let mut len = 0;
    loop {
        let count = match from.read(&mut buffer) {
            Err(e) if e.kind() == ErrorKind::Interrupted => continue,
            read => read.map_err(&unread)?,
        };
        if count == 0 {
            return Ok(len);
        }
        to.write_all(&buffer[..count]).map_err(&unwritten)?;
        len += count as u64;
    }
}

/// All bytes of a file.
///
/// # Errors
///
/// As for [`open`]; larger than `document_bytes`.
pub fn read(path: &Path, limits: &Limits) -> Result<Vec<u8>> {
    let (file, len) = open(path, limits)?;
    limits.document(path.display(), len)?;
    let bytes = read_all(path, file, len, limits.document_bytes, limits)?;
    limits.document(path.display(), bytes.len() as u64)?;
    Ok(bytes)
}

/// All bytes of a file that this program wrote, which may be as large as memory. `check` gets the
/// open file and its length first and may refuse it.
///
/// # Errors
///
/// As for [`open`]; errors of `check`.
pub fn read_large(
    path: &Path,
    limits: &Limits,
    check: impl FnOnce(&mut File, u64) -> Result<()>,
) -> Result<Vec<u8>> {
    let (mut file, len) = open(path, limits)?;
    check(&mut file, len)?;
    file.rewind().map_err(|e| Error::io(path, e))?;
    read_all(path, file, len, limits.file_bytes, limits)
}

/// Read the `len` bytes of an open file, or more if it grows, up to one above `max_bytes`.
pub(crate) fn read_all(
    path: &Path,
    file: impl Read,
    len: u64,
    max_bytes: u64,
    limits: &Limits,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    limits.reserve(path.display(), &mut bytes, len as usize)?;
    // The file may grow during reading.
    file.take(max_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    Ok(bytes)
}

/// A text in UTF-8, without its byte-order mark.
///
/// # Errors
///
/// As for [`read`]; other encodings.
pub fn read_text(path: &Path, limits: &Limits) -> Result<String> {
    let mut bytes = read(path, limits)?;
    if bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.drain(..BYTE_ORDER_MARK.len());
    }
    String::from_utf8(bytes).map_err(|e| {
        let place = format!("byte {}", e.utf8_error().valid_up_to());
        Error::malformed(path, place, "is not text in UTF-8; save it as such")
    })
}

/// True for a relative path that leads out of its folder.
pub fn leaves_folder(relative: &Path) -> bool {
    let mut depth = 0i64;
    relative.components().any(|component| {
        match component {
            Component::Normal(_) => depth += 1,
            Component::ParentDir => depth -= 1,
            _ => {}
        }
        depth < 0
    })
}

/// The paths in `folder`, none if it cannot be listed; the empty path is the working folder.
pub fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    std::fs::read_dir(here)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| folder.join(entry.file_name()))
}

/// All files below `folder`, also through links; each folder once. A folder that cannot be listed
/// is left out.
pub fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut visited = HashSet::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        // Links may lead in a circle.
        let is_new = std::fs::canonicalize(&folder).is_ok_and(|full| visited.insert(full));
        for path in is_new.then(|| entries(&folder)).into_iter().flatten() {
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files
}

fn check_regular(path: &Path, meta: &Metadata) -> Result<()> {
    if meta.is_dir() {
        return Err(Error::unsupported(path, "is a folder; give a file"));
    }
    // A file of /proc looks empty, and its reader may wait for ever.
    let is_virtual =
        meta.len() == 0 && std::fs::canonicalize(path).is_ok_and(|full| full.starts_with("/proc"));
    if !meta.is_file() || is_virtual {
        let reason = "is a device or a pipe; give a file, or - where standard input may be given";
        return Err(Error::unsupported(path, reason));
    }
    Ok(())
}

/// True for a pipe that this program was started with: it has a writer and an end.
#[cfg(unix)]
fn is_handed_over(path: &Path, meta: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    let named = path.starts_with("/dev/fd")
        || path.starts_with("/proc/self/fd")
        || path == Path::new("/dev/stdin");
    named && (meta.file_type().is_fifo() || meta.file_type().is_socket())
}

#[cfg(not(unix))]
fn is_handed_over(_path: &Path, _meta: &Metadata) -> bool {
    false
}

// ---- A decoder's panic on a damaged file becomes an error of that file --------------------------

// This needs a program whose profile unwinds. In one that aborts on panic, the checks that readers
// make beforehand remain.

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// The result of `decode` for the file at `path`; its panic becomes an error of that file.
///
/// # Errors
///
/// Errors of `decode`; `Malformed` for a panic.
pub fn guarded<T>(path: &Path, decode: impl FnOnce() -> Result<T>) -> Result<T> {
    let before = GUARDED.replace(true);
    // Nothing that `decode` changes is used after a panic: it is dropped with its closure.
    let decoded = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(before);
    decoded.unwrap_or_else(|payload| Err(decoder_panic(path, panic_message(&*payload))))
}

/// The error for a file whose decoder panicked with this message.
pub fn decoder_panic(path: &Path, message: &str) -> Error {
    let reason =
        format!("is damaged in a way that its decoder fails on ({message}); copy it again");
    Error::malformed(path, "content", reason)
}

/// True while this thread decodes under [`guarded`]: its panic becomes an error, so a panic hook
/// need not report it.
pub fn is_guarded() -> bool {
    GUARDED.get()
}

/// The message of a panic.
pub fn panic_message(payload: &(dyn Any + Send)) -> &str {
    let owned = || payload.downcast_ref::<String>().map(String::as_str);
    payload.downcast_ref::<&str>().copied().or_else(owned).unwrap_or("panic without a message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_leave_a_folder_are_known() {
        for inside in ["a", "a/b", "./a", "a/../b", "a/b/../../c", "", "a/.."] {
            assert!(!leaves_folder(Path::new(inside)), "{inside}");
        }
        for outside in ["..", "../a", "a/../../b", "./../a", "a/../../a/b"] {
            assert!(leaves_folder(Path::new(outside)), "{outside}");
        }
    }

    #[test]
    fn a_text_loses_its_mark_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for (bytes, text) in [("\u{feff}a\n", "a\n"), ("a\u{feff}", "a\u{feff}"), ("", "")] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read_text(&path, &Limits::DEFAULT).unwrap(), text);
        }
        std::fs::write(&path, b"ab\xff").unwrap();
        assert!(read_text(&path, &Limits::DEFAULT).unwrap_err().to_string().contains("byte 2"));
    }

    #[test]
    fn sizes_are_limited() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "0123456789").unwrap();
        let message = |limits: Limits| read(&path, &limits).unwrap_err().to_string();
        assert!(message(Limits { file_bytes: 9, ..Limits::DEFAULT }).contains("file_bytes=10"));
        assert!(
            message(Limits { document_bytes: 9, ..Limits::DEFAULT }).contains("document_bytes=10")
        );
        assert_eq!(
            read(&path, &Limits { document_bytes: 10, ..Limits::DEFAULT }).unwrap().len(),
            10
        );
        let limits = Limits { file_bytes: 3, ..Limits::DEFAULT };
        assert!(spool(&path, &mut std::io::repeat(0), &limits).is_err(), "a stream without end");
        assert!(
            open(folder.path(), &Limits::DEFAULT).unwrap_err().to_string().contains("is a folder")
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn an_error_of_a_copy_names_the_file_that_is_at_fault() {
        let folder = tempfile::tempdir().unwrap();
        let from = folder.path().join("a.jpg");
        let to = folder.path().join("b.jpg");
        std::fs::write(&from, vec![7; 3 * BLOCK + 1]).unwrap();
        copy(&from, &to).unwrap();
        assert!(std::fs::read(&from).unwrap() == std::fs::read(&to).unwrap());
        // A disk that is full.
        let message = copy(&from, Path::new("/dev/full")).unwrap_err().to_string();
        assert!(message.starts_with("/dev/full: No space left"), "{message}");
        let message = copy(&folder.path().join("none"), &to).unwrap_err().to_string();
        assert!(message.contains("none: No such file"), "{message}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_are_refused_and_pipes_of_a_shell_are_read() {
        use std::io::Write;
        use std::os::fd::AsRawFd;
        for device in ["/dev/zero", "/dev/null", "/dev/full", "/proc/kmsg", "/proc/self/environ"] {
            let message = read(Path::new(device), &Limits::DEFAULT).unwrap_err().to_string();
            assert!(message.contains("device"), "{message}");
        }
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        if std::process::Command::new("mkfifo")
            .arg(&fifo)
            .status()
            .is_ok_and(|status| status.success())
        {
            assert!(open(&fifo, &Limits::DEFAULT).unwrap_err().to_string().contains("a pipe"));
        }
        let (reader, mut writer) = std::io::pipe().unwrap();
        writer.write_all(b"handed over").unwrap();
        drop(writer);
        let path = format!("/dev/fd/{}", reader.as_raw_fd());
        assert_eq!(read(Path::new(&path), &Limits::DEFAULT).unwrap(), b"handed over");
    }
}

#[cfg(test)]
mod guard_tests {
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
            assert!(
                message.starts_with("photo.png: content: ") && message.contains(wants),
                "{message}"
            );
            assert!(!is_guarded());
        }
        assert!(guarded(path, || Ok(is_guarded())).unwrap());
        let refused =
            guarded(path, || Err::<(), _>(Error::malformed(path, "byte 3", "is 7"))).unwrap_err();
        assert_eq!(refused.to_string(), "photo.png: byte 3: is 7");
    }
}
