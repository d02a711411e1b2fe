//! Files that appear whole or not at all: made aside, named last, swept by the next run.
//!
//! Bytes go to a temporary file beside the target, `.NAME.trisplat.tmp`, which is locked while this
//! process has it and takes the target's name when all bytes are on the disk. A dropped file leaves
//! nothing behind; the next writer of the same target removes the file of a killed process.
//! Symbolic links are followed: their targets are replaced. Devices and pipes cannot be replaced by
//! renaming, so they (and standard output) are written directly.
//!
//! Among files that belong together one names the others. A few files are a set, [`publish`]. Many
//! files have names with a hash of their bytes, so they replace nothing: [`put`] makes them and
//! ties them to the file that names them, and [`sweep_folder`] removes the files of earlier runs. A
//! whole folder is an [`AtomicFolder`]. A [`FileManifest`] lists the files that later runs may
//! replace or remove in a user's folder.

mod folder;
mod manifest;
mod names;
mod temporary;

pub use folder::{AtomicFolder, FolderLock};
pub use manifest::FileManifest;
pub use names::{
    FileId, folder_of, is_leftover, lies_inside, resolved, safe_name, safe_path, temporary_name,
};
pub use temporary::{MadeFolders, remove_temporaries};

use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use temporary::{BUFFER_BYTES, Temporary};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// A buffered file under construction.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    bytes: u64,
    to: Destination,
}

#[derive(Debug)]
enum Destination {
    Temporary(Temporary),
    Direct(BufWriter<File>),
    Stdout(BufWriter<io::Stdout>),
    Nowhere(io::Sink),
}

impl AtomicFile {
    /// Starts a file that will be called `path`; "-" is standard output.
    ///
    /// # Errors
    ///
    /// Errors of the operating system; another program that is writing the same file; a link
    /// that leads to itself.
    pub fn create(path: &Path) -> Result<Self> {
        let io = |e| Error::io(path, e);
        let target = resolved(path);
        let to = if path.as_os_str() == "-" {
            Destination::Stdout(BufWriter::with_capacity(BUFFER_BYTES, io::stdout()))
        } else if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            let file = File::options().write(true).open(path).map_err(io)?;
            Destination::Direct(BufWriter::with_capacity(BUFFER_BYTES, file))
        } else if target.is_symlink() {
            let reason = "is a link that leads to itself; remove it, or give another name";
            return Err(Error::unsupported(path, reason));
        } else {
            // Folders of the system, such as /proc, are there and take nothing.
            let refused = |e: io::Error| match e.kind() {
                io::ErrorKind::NotFound if folder_of(path).is_dir() => {
                    Error::unsupported(path, "its folder takes no files; write it into another")
                }
                _ => io(e),
            };
            Destination::Temporary(Temporary::create(&target).map_err(refused)?)
        };
        Ok(Self { path: path.to_owned(), bytes: 0, to })
    }

    /// Only counts bytes: a dry run.
    pub fn nowhere(path: &Path) -> Self {
        Self { path: path.to_owned(), bytes: 0, to: Destination::Nowhere(io::sink()) }
    }

    /// True for a file that only counts bytes.
    pub fn is_dry(&self) -> bool {
        matches!(self.to, Destination::Nowhere(_))
    }

    /// The name it will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name when its bytes are on the disk: after a power cut, the old file or
    /// the whole new one exists. Returns its size in bytes.
    ///
    /// # Errors
    ///
    /// Errors of the operating system; a file of that name that appeared after this one was
    /// started.
    pub fn commit(self) -> Result<u64> {
        publish(vec![self]).map(|sizes| sizes.iter().sum())
    }

    /// Writes all of it, and then as [`AtomicFile::commit`].
    ///
    /// # Errors
    ///
    /// As for [`AtomicFile::commit`].
    pub fn commit_with(mut self, bytes: impl AsRef<[u8]>) -> Result<u64> {
        self.write_all(bytes.as_ref()).map_err(|e| Error::io(&self.path, e))?;
        self.commit()
    }

    /// Registers `folder`, which was made for files that this one names: it is removed if it stays
    /// empty.
    pub fn keeps(&mut self, folder: MadeFolders) {
        if let Destination::Temporary(file) = &mut self.to {
            file.folders.push(folder);
        }
    }

    /// Writes the buffer and waits until a file is on its disk.
    fn finish(&mut self) -> Result<()> {
        let finished = match &mut self.to {
            Destination::Temporary(file) => file.sync(),
            other => other.writer().flush(),
        };
        finished.map_err(|e| Error::io(&self.path, e))
    }
}

/// Files that were started and are not yet written, found by their names.
#[derive(Debug, Default)]
pub struct StartedFiles(Vec<AtomicFile>);

impl StartedFiles {
    /// Starts a file for each of `paths`. From here on no other program writes them, and outputs
    /// that cannot be written have failed.
    ///
    /// # Errors
    ///
    /// As for [`AtomicFile::create`].
    pub fn start<'p>(paths: impl IntoIterator<Item = &'p Path>) -> Result<Self> {
        paths.into_iter().map(AtomicFile::create).collect::<Result<_>>().map(Self)
    }

    /// Files that only count bytes.
    pub fn dry_run<'p>(paths: impl IntoIterator<Item = &'p Path>) -> Self {
        Self(paths.into_iter().map(AtomicFile::nowhere).collect())
    }

    /// Starts one more file.
    ///
    /// # Errors
    ///
    /// As for [`AtomicFile::create`].
    pub fn add(&mut self, path: &Path) -> Result<()> {
        self.0.push(AtomicFile::create(path)?);
        Ok(())
    }

    /// The started file of `path`, or a new one if it was not started.
    ///
    /// # Errors
    ///
    /// As for [`AtomicFile::create`].
    pub fn take(&mut self, path: &Path) -> Result<AtomicFile> {
        match self.0.iter().position(|file| file.path() == path) {
            Some(at) => Ok(self.0.swap_remove(at)),
            None => AtomicFile::create(path),
        }
    }
}

/// Gives files that belong together their names, in this order and ending with the one that names
/// the others, when all bytes are on the disk. After an error each name has its old file. Returns
/// the sizes, bytes.
///
/// # Errors
///
/// Errors of the operating system; a file that has appeared under a name since its successor was
/// started.
pub fn publish(mut files: Vec<AtomicFile>) -> Result<Vec<u64>> {
    files.iter_mut().try_for_each(AtomicFile::finish)?;
    let sizes = files.iter().map(|file| file.bytes).collect();
    let temporaries = files.iter_mut().filter_map(|file| match &mut file.to {
        Destination::Temporary(temporary) => Some((file.path.as_path(), temporary)),
        _ => None,
    });
    let mut set: Vec<(&Path, &mut Temporary)> = temporaries.collect();
    // Locked while files get their names: a signal waits.
    let mut list = temporary::list();
    if let Some((path, _)) = set.iter().find(|(_, file)| file.is_new && file.target.exists()) {
        let reason = "was written by another program since this one began; it was left as it is";
        return Err(Error::io(path, io::Error::new(io::ErrorKind::AlreadyExists, reason)));
    }
    let to = |file: &Temporary| Move {
        from: file.path.clone(),
        target: file.target.clone(),
        old: names::aside_name(&file.target),
    };
    let moves: Vec<Move> = set.iter().map(|(_, file)| to(file)).collect();
    replace(&moves).map_err(|(at, e)| Error::io(set[at].0, e))?;
    for (_, file) in &mut set {
        file.published = true;
        temporary::forget(&mut list, &file.path);
        for path in &file.named_files {
            temporary::forget(&mut list, path);
        }
    }
    // Also old files of a killed run. The next run removes the rest.
    for Move { old, .. } in moves.iter().filter(|_| moves.len() > 1) {
        let _ = std::fs::remove_file(old);
    }
    drop(list);
    let folders: BTreeSet<&Path> = moves.iter().map(|one| folder_of(&one.target)).collect();
    folders
        .into_iter()
        .try_for_each(|folder| sync_folder(folder).map_err(|e| Error::io(folder, e)))?;
    Ok(sizes)
}

/// A whole file that is to get the name of its target, and a place for the old one meanwhile.
struct Move {
    from: PathBuf,
    target: PathBuf,
    old: PathBuf,
}

/// Moves old files away, beginning with the last, and then new ones in: no reader finds an old file
/// beside a new one, and one alone is replaced at once. After an error, which comes with its index,
/// each name has its old file.
fn replace(moves: &[Move]) -> std::result::Result<(), (usize, io::Error)> {
    if let [only] = moves {
        return std::fs::rename(&only.from, &only.target).map_err(|e| (0, e));
    }
    let mut done: Vec<(&Path, &Path)> = Vec::new();
    let mut rename = |at, from, to| {
        std::fs::rename(from, to).map_err(|e| (at, e))?;
        done.push((from, to));
        Ok(())
    };
    let moved = (|| {
        for (at, one) in moves.iter().enumerate().rev().filter(|(_, one)| one.target.exists()) {
            if one.target.is_dir() {
                return Err((at, io::ErrorKind::IsADirectory.into()));
            }
            rename(at, &one.target, &one.old)?;
        }
        moves.iter().enumerate().try_for_each(|(at, one)| rename(at, &one.from, &one.target))
    })();
    if moved.is_err() {
        // Best effort.
        for (from, to) in done.iter().rev() {
            let _ = std::fs::rename(to, from);
        }
    }
    moved
}

/// Waits until the names in a folder are on the disk. Only Unix lets a program do so; elsewhere the
/// file system's journal keeps the order.
fn sync_folder(folder: &Path) -> io::Result<()> {
    // A folder that is writable but not readable cannot be opened.
    let Some(open) = cfg!(unix).then(|| File::open(folder).ok()).flatten() else { return Ok(()) };
    match open.sync_all() {
        // Some file systems do not support this for folders.
        Err(e) if !matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => {
            Err(e)
        }
        _ => Ok(()),
    }
}

/// Writes `STEM-HASH.ENDING` into `folder`, with the hash of its bytes (XXH3), unless it is there:
/// it replaces nothing. A new one is removed unless `naming`, the file that names it, gets its
/// name. Returns its path and the hash.
///
/// # Errors
///
/// A file of that name with other bytes; errors of the operating system.
pub fn put(
    folder: &Path,
    (stem, ending): (&str, &str),
    bytes: &[u8],
    naming: Option<&mut AtomicFile>,
) -> Result<(PathBuf, String)> {
    let hash = format!("{:016x}", xxh3_64(bytes));
    let path = folder.join(format!("{stem}-{hash}.{ending}"));
    let io = |e| Error::io(&path, e);
    if naming.as_ref().is_some_and(|naming| naming.is_dry()) {
        return Ok((path, hash));
    }
    match std::fs::read(&path) {
        Ok(old) if old == bytes => return Ok((path, hash)),
        Ok(_) => {
            let reason = "was changed, its name says so; move it to another folder";
            return Err(Error::unsupported(&path, reason));
        }
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(io(e)),
        Err(_) => {}
    }
    let file = AtomicFile::create(&path)?;
    if let Some(Destination::Temporary(naming)) = naming.map(|naming| &mut naming.to) {
        temporary::register(&path);
        naming.named_files.push(path.clone());
    }
    file.commit_with(bytes)?;
    Ok((path, hash))
}

/// Removes files of `folder` whose name `is_stale` and ends with the hash of their bytes, as
/// `start-0001-HASH.ply`, and temporary ones of killed runs. So a file that a user made, changed or
/// renamed stays.
pub fn sweep_folder(folder: &Path, is_stale: impl Fn(&str) -> bool) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        // Left-over files do no harm.
        let _ = match names::target_of_temporary(&name) {
            Some(target) if is_stale(target) => temporary::sweep(&entry.path()),
            None if is_stale(&name) && names_its_bytes(&entry.path()) => {
                std::fs::remove_file(entry.path())
            }
            _ => Ok(()),
        };
    }
}

/// True when a file's name ends with the hash of its bytes (XXH3).
fn names_its_bytes(path: &Path) -> bool {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let Some((_, named)) = stem.rsplit_once('-') else { return false };
    hash_of(path).is_ok_and(|(_, hash)| named == format!("{hash:016x}"))
}

/// Size of a file in bytes, and the hash of its bytes (XXH3).
fn hash_of(path: &Path) -> io::Result<(u64, u64)> {
    let mut hash = Xxh3Default::new();
    let bytes =
        io::copy(&mut BufReader::with_capacity(BUFFER_BYTES, File::open(path)?), &mut hash)?;
    Ok((bytes, hash.digest()))
}

impl Destination {
    fn writer(&mut self) -> &mut dyn Write {
        match self {
            Destination::Temporary(temporary) => &mut temporary.file,
            Destination::Direct(file) => file,
            Destination::Stdout(out) => out,
            Destination::Nowhere(sink) => sink,
        }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let written = self.to.writer().write(buf)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.writer().flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(path: &Path, text: &str) -> AtomicFile {
        let mut file = AtomicFile::create(path).unwrap();
        file.write_all(text.as_bytes()).unwrap();
        file
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_a_committed_one_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        drop(written(&path, "half"));
        assert!(names(folder.path()).is_empty());

        assert_eq!(written(&path, "whole").commit().unwrap(), 5);
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(names(folder.path()), ["a.glb"]);
    }

    #[test]
    fn one_of_two_writers_wins_and_the_other_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let first = written(&path, "first");
        let second = AtomicFile::create(&path).unwrap_err().to_string();
        assert!(
            second.contains("a.glb") && second.contains("another program is writing"),
            "{second}"
        );
        first.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
    }

    #[test]
    fn a_file_that_appeared_meanwhile_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let file = written(&path, "ours");
        std::fs::write(&path, "theirs").unwrap();
        let error = file.commit().unwrap_err().to_string();
        assert!(error.contains("was written by another program"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
        assert_eq!(names(folder.path()), ["a.glb"]);
    }

    #[test]
    fn what_a_killed_process_left_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        std::fs::write(temporary_name(&path), "half").unwrap();
        written(&path, "whole").commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(names(folder.path()), ["a.glb"]);
    }

    #[test]
    fn long_names_have_temporary_files_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n".repeat(251) + ".glb");
        written(&path, "whole").commit().unwrap();
        assert_eq!(names(folder.path()).len(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_are_followed() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link.glb");
        let inner = folder.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        std::os::unix::fs::symlink("inner/real.glb", &link).unwrap();
        for text in ["new", "replaced"] {
            written(&link, text).commit().unwrap();
            assert_eq!(std::fs::read(inner.join("real.glb")).unwrap(), text.as_bytes());
            assert!(link.is_symlink());
        }
        std::os::unix::fs::symlink("round.glb", folder.path().join("round.glb")).unwrap();
        let error = AtomicFile::create(&folder.path().join("round.glb")).unwrap_err().to_string();
        assert!(error.contains("is a link that leads to itself"), "{error}");
        std::fs::remove_file(folder.path().join("round.glb")).unwrap();
        assert_eq!((names(folder.path()).len(), names(&inner).len()), (2, 1));
    }

    #[test]
    fn atomic_files_are_replaced_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let [data, main] = ["a.bin", "a.gltf"].map(|name| folder.path().join(name));
        let both = |text: &str| {
            let mut files = [&data, &main].map(|path| AtomicFile::create(path).unwrap());
            for file in &mut files {
                file.write_all(text.as_bytes()).unwrap();
            }
            Vec::from(files)
        };
        publish(both("old")).unwrap();
        // The second file cannot be published: its temporary file is gone.
        let files = both("new");
        std::fs::remove_file(temporary_name(&main)).unwrap();
        publish(files).unwrap_err();
        let texts = || [&data, &main].map(|path| std::fs::read_to_string(path).unwrap());
        assert_eq!(texts(), ["old", "old"]);
        assert_eq!(names(folder.path()), ["a.bin", "a.gltf"]);
        assert_eq!(publish(both("newer")).unwrap(), [5, 5]);
        assert_eq!(texts(), ["newer", "newer"]);
        assert_eq!(names(folder.path()), ["a.bin", "a.gltf"]);
    }

    #[test]
    fn what_a_killed_publication_left_goes_with_the_next_one() {
        let folder = tempfile::tempdir().unwrap();
        let [data, main] = ["a.bin", "a.gltf"].map(|name| folder.path().join(name));
        // As a kill leaves them between the two renames: the data are new, the file that names them
        // is not there.
        std::fs::write(&data, "new").unwrap();
        std::fs::write(names::aside_name(&data), "old").unwrap();
        std::fs::write(names::aside_name(&main), "old").unwrap();
        std::fs::write(temporary_name(&main), "new").unwrap();
        publish(vec![written(&data, "newer"), written(&main, "newer")]).unwrap();
        let texts = [&data, &main].map(|path| std::fs::read_to_string(path).unwrap());
        assert_eq!(texts, ["newer", "newer"]);
        assert_eq!(names(folder.path()), ["a.bin", "a.gltf"]);
    }

    #[test]
    fn only_files_that_are_named_after_their_bytes_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        let ours = format!("start-0000-{:016x}.ply", xxhash_rust::xxh3::xxh3_64(b"ours"));
        let changed = format!("start-0001-{:016x}.ply", xxhash_rust::xxh3::xxh3_64(b"ours"));
        write(&ours, "ours");
        write(&changed, "changed since");
        write("start-0002.ply", "of the user");
        write(".start-0003.ply.trisplat.tmp", "half");
        sweep_folder(folder.path(), |name| name.starts_with("start-"));
        assert_eq!(names(folder.path()), [changed.as_str(), "start-0002.ply"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_has_the_permissions_of_any_output() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode =
            |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        written(&folder.path().join("a"), "").commit().unwrap();
        std::fs::write(folder.path().join("plain"), b"").unwrap();
        assert_eq!(mode("a"), mode("plain"));
    }
}
