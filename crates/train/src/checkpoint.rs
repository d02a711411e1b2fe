//! Checkpoints: everything a run needs to continue bitwise, in one safetensors file; the last ones
//! of a run are kept.
//!
//! Tensors are the raw parameters, both Adam moments and the visibility statistics, little-endian.
//! `__metadata__` has the format (`trisplat`), a JSON text with all other values (`run`), and the
//! XXH3 hash of both (`xxh3`).

use super::budget::Pace;
use super::eval::TrainSample;
use super::exposure::ExposureEstimates;
use super::identity::RunIdentity;
use super::options::TrainOptions;
use super::params::{Core, OptimizerState, Params};
use super::visibility::VisibilityStats;
use bytemuck::{NoUninit, Pod};
use glam::Vec3;
use safetensors::tensor::{Dtype, Metadata, SafeTensorError, SafeTensors, TensorInfo, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::{AtomicFile, folder_of};
use trisplat_scene::input::{self, guarded};
use trisplat_scene::{Error, Limits, Result, SceneNormalization, sh_count};
use xxhash_rust::xxh3::Xxh3Default;

/// Number of the layout; it changes whenever a key or an array does.
const FORMAT: &str = "22";

/// Maximum length of the header, bytes, as in the crate that reads it.
const MAX_HEADER_BYTES: u64 = 100_000_000;

/// Endings of checkpoints in a folder.
const ENDING: &str = "checkpoint";
/// Precedes the number of steps in the name of one of several checkpoints.
const STEP: &str = ".step-";

/// A run between two steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Parameters and moments.
    pub state: OptimizerState,
    /// Visibility of the triangles since the last pruning.
    pub visibility: VisibilityStats,
    /// Everything except arrays.
    pub meta: CheckpointMeta,
}

/// Everything of a checkpoint except its arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointMeta {
    /// Program and version.
    pub generator: String,
    /// Steps made.
    pub step: u64,
    /// The options of the run.
    pub options: TrainOptions,
    /// Centre and scale of training space.
    pub space: ([f32; 3], f32),
    /// Number of first triangles that are pinned: see [`OptimizerState::pinned`].
    pub pinned: usize,
    /// Number of these that are frozen: see [`OptimizerState::frozen`].
    pub frozen: usize,
    /// The core, when only a part is trained.
    pub core: Option<Core>,
    /// The photos' exposures.
    pub exposure: ExposureEstimates,
    /// The photos, cameras and points of the training.
    pub identity: RunIdentity,
    /// Gradients dropped because they were not finite.
    pub dropped: u64,
    /// The curve so far.
    pub curve: Vec<TrainSample>,
    /// CPU seconds used so far.
    pub cpu_secs: f64,
    /// The pace of a run with a budget.
    pub pace: Option<Pace>,
}

impl CheckpointMeta {
    /// Training space.
    pub fn space(&self) -> SceneNormalization {
        SceneNormalization { center: Vec3::from_array(self.space.0), scale: self.space.1 }
    }
}

/// Writes `checkpoint` as a file that appears whole or not at all, even when the power fails.
///
/// # Errors
///
/// A file that the operating system refuses; numbers that are not finite, because no run can
/// continue from these.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> Result<()> {
    let unwritable =
        |e: &dyn std::fmt::Display| Error::invalid("checkpoint", e, "numbers JSON can hold");
    let visibility = &checkpoint.visibility;
    let bytes = |flags: &[bool]| flags.iter().map(|f| u8::from(*f)).collect::<Vec<u8>>();
    let exempt = bytes(&visibility.exempt);
    let drawn = bytes(&visibility.drawn);
    let tensors = tensors(checkpoint, &exempt, &drawn).map_err(|e| unwritable(&e))?;
    for (name, tensor) in &tensors {
        let numbers =
            if tensor.dtype() == Dtype::F32 { bytemuck::cast_slice(tensor.data()) } else { &[] };
        if !numbers.iter().all(|number: &f32| number.is_finite()) {
            let reason = "holds numbers that are not finite; resume from an earlier checkpoint, or train again";
            return Err(Error::malformed(path, name.clone(), reason));
        }
    }
    let run = serde_json::to_string(&checkpoint.meta).map_err(|e| unwritable(&e))?;
    let sum = checksum(&run, tensors.iter().map(|(name, tensor)| (&**name, tensor.data())));
    let metadata = [("trisplat", FORMAT.to_owned()), ("xxh3", sum), ("run", run)];
    let metadata = metadata.map(|(key, text)| (key.to_owned(), text)).into();
    let bytes = safetensors::serialize(tensors, Some(metadata)).map_err(|e| unwritable(&e))?;
    AtomicFile::create(path)?.commit_with(bytes).map(drop)
}

/// The XXH3 hash of everything in a checkpoint, sixteen hexadecimal digits.
fn checksum<'a>(run: &str, tensors: impl Iterator<Item = (&'a str, &'a [u8])>) -> String {
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_unstable_by_key(|(name, _)| *name);
    let mut hash = Xxh3Default::new();
    hash.update(run.as_bytes());
    for (name, data) in tensors {
        hash.update(name.as_bytes());
        hash.update(data);
    }
    format!("{:016x}", hash.digest())
}

type NamedTensors<'a> = Vec<(String, TensorView<'a>)>;

/// Every array under its name.
fn tensors<'a>(
    checkpoint: &'a Checkpoint,
    exempt: &'a [u8],
    drawn: &'a [u8],
) -> std::result::Result<NamedTensors<'a>, SafeTensorError> {
    let mut tensors = Vec::new();
    let mut add = |name: String, dtype, shape: &[usize], data| {
        TensorView::new(dtype, shape.to_vec(), data).map(|view| tensors.push((name, view)))
    };
    let state = &checkpoint.state;
    for (prefix, params) in
        [("params", &state.params), ("first", &state.first), ("second", &state.second)]
    {
        let n = params.len();
        let k = params.sh_count();
        add(format!("{prefix}.vertices"), Dtype::F32, &[n, 3, 3], raw(&params.vertices))?;
        add(format!("{prefix}.opacity"), Dtype::F32, &[n], raw(&params.opacity))?;
        add(format!("{prefix}.sigma"), Dtype::F32, &[n], raw(&params.sigma))?;
        add(format!("{prefix}.sh"), Dtype::F32, &[n, k, 3], raw(&params.sh))?;
    }
    let visibility = &checkpoint.visibility;
    let n = visibility.len();
    add("visibility.max_weight".into(), Dtype::F32, &[n], raw(&visibility.max_weight))?;
    add("visibility.sum_weight".into(), Dtype::F32, &[n], raw(&visibility.sum_weight))?;
    add("visibility.views".into(), Dtype::U32, &[n], raw(&visibility.views))?;
    add("visibility.radius_px".into(), Dtype::F32, &[n], raw(&visibility.radius_px))?;
    add("visibility.nearness".into(), Dtype::F32, &[n], raw(&visibility.nearness))?;
    add("visibility.error".into(), Dtype::U64, &[n], raw(&visibility.error))?;
    add("visibility.exempt".into(), Dtype::U8, &[n], exempt)?;
    add("visibility.drawn".into(), Dtype::U8, &[drawn.len()], drawn)?;
    Ok(tensors)
}

fn raw<T: NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}

/// Reads a checkpoint and checks that no byte has changed.
///
/// # Errors
///
/// A file that is damaged, not a checkpoint, or of another version of trisplat.
pub fn read(path: &Path) -> Result<Checkpoint> {
    guarded(path, || {
        let bytes =
            input::read_large(path, &Limits::DEFAULT, |file, length| check(path, file, length))?;
        read_bytes(path, &bytes)
    })
}

/// True for a file that begins as checkpoints of this program do; false for one that cannot be
/// read.
pub fn is_checkpoint(path: &Path) -> bool {
    let mut start = Vec::new();
    let is_file = path.is_file();
    let file = is_file.then(|| File::open(path).ok()).flatten();
    file.is_some_and(|file| file.take(START.len() as u64 + 8).read_to_end(&mut start).is_ok())
        && start.get(8..) == Some(START)
}

/// First bytes behind the length of the header.
const START: &[u8] = b"{\"__metadata__\"";

/// Check that every byte is as it was written, before memory is taken for any.
///
/// # Errors
/// A file that is no safetensors, such as a scene of any size; a checkpoint of another version; a
/// changed byte.
fn check(path: &Path, file: &mut File, length: u64) -> Result<()> {
    let io = |e| Error::io(path, e);
    let mut start = Vec::new();
    file.take(9).read_to_end(&mut start).map_err(io)?;
    let Some((size, &first)) =
        start.split_first_chunk().and_then(|(size, rest)| Some((size, rest.first()?)))
    else {
        return Err(damaged(path));
    };
    if first != b'{' {
        let reason =
            "is not a checkpoint of a training run; to start from a scene, give it as `from`";
        return Err(Error::unsupported(path, reason));
    }
    let size = u64::from_le_bytes(*size);
    let body = size.saturating_add(size_of::<u64>() as u64);
    if size > MAX_HEADER_BYTES || body > length {
        return Err(damaged(path));
    }
    let mut header = vec![0; size as usize];
    file.seek(SeekFrom::Start(size_of::<u64>() as u64))
        .and_then(|_| file.read_exact(&mut header))
        .map_err(io)?;
    let metadata: Metadata = serde_json::from_slice(&header).map_err(|_| damaged(path))?;
    check_format(path, &metadata)?;
    let tensors: BTreeMap<String, &TensorInfo> = metadata.tensors().into_iter().collect();
    let bytes =
        |info: &TensorInfo| (info.data_offsets.1 as u64).saturating_sub(info.data_offsets.0 as u64);
    // Arrays that overlap would take any time.
    if tensors.values().map(|info| bytes(info)).fold(0, u64::saturating_add) != length - body {
        return Err(damaged(path));
    }
    let mut hash = Xxh3Default::new();
    hash.update(text(&metadata, "run").unwrap_or_default().as_bytes());
    for (name, info) in &tensors {
        hash.update(name.as_bytes());
        file.seek(SeekFrom::Start(body.saturating_add(info.data_offsets.0 as u64))).map_err(io)?;
        std::io::copy(&mut file.take(bytes(info)), &mut hash).map_err(io)?;
    }
    if text(&metadata, "xxh3") == Some(&format!("{:016x}", hash.digest())) {
        Ok(())
    } else {
        Err(damaged(path))
    }
}

fn check_format(path: &Path, metadata: &Metadata) -> Result<()> {
    match text(metadata, "trisplat") {
        Some(FORMAT) => Ok(()),
        Some(_) => {
            let reason = format!(
                "is a checkpoint of another version, this one reads format {FORMAT}: go on with the version that wrote it, \
                 or train anew"
            );
            Err(Error::unsupported(path, reason))
        }
        None => Err(Error::malformed(path, "__metadata__", "is not a trisplat checkpoint")),
    }
}

fn text<'a>(metadata: &'a Metadata, key: &str) -> Option<&'a str> {
    metadata.metadata().as_ref()?.get(key).map(String::as_str)
}

fn damaged(path: &Path) -> Error {
    let reason =
        "does not fit: the file is damaged; resume from another checkpoint, or train again";
    Error::malformed(path, "checksum", reason)
}

fn read_bytes(path: &Path, bytes: &[u8]) -> Result<Checkpoint> {
    let bad = |reason: String| Error::malformed(path, "__metadata__", reason);
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|_| damaged(path))?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|_| damaged(path))?;
    let run = text(&metadata, "run").unwrap_or_default();
    let meta: CheckpointMeta = serde_json::from_str(run).map_err(|e| bad(e.to_string()))?;
    meta.options.validate().map_err(|error| bad(error.to_string()))?;
    if meta.step > meta.options.steps {
        return Err(bad(format!("is after step {} of {}", meta.step, meta.options.steps)));
    }
    let n =
        tensors.tensor("params.opacity").map_or(0, |tensor| tensor.data().len() / size_of::<f32>());
    if meta.pinned > n || meta.frozen > meta.pinned {
        return Err(bad(format!(
            "{} frozen and {} pinned triangles of {n}",
            meta.frozen, meta.pinned
        )));
    }
    let file = Arrays { path, tensors };
    let params = |prefix: &str| file.params(prefix, n, meta.options.sh_degree);
    let flags = |name: &str, count: usize| -> Result<Vec<bool>> {
        Ok(file.array::<u8>(name, count)?.iter().map(|b| *b != 0).collect())
    };
    let visibility = VisibilityStats {
        max_weight: file.array("visibility.max_weight", n)?,
        sum_weight: file.array("visibility.sum_weight", n)?,
        views: file.array("visibility.views", n)?,
        radius_px: file.array("visibility.radius_px", n)?,
        nearness: file.array("visibility.nearness", n)?,
        error: file.array("visibility.error", n)?,
        exempt: flags("visibility.exempt", n)?,
        drawn: flags("visibility.drawn", meta.identity.photos.len())?,
    };
    let [params, first, second] = [params("params")?, params("first")?, params("second")?];
    let state = OptimizerState { params, first, second, pinned: meta.pinned, frozen: meta.frozen };
    Ok(Checkpoint { state, visibility, meta })
}

/// The arrays of a file; they are copied out on demand.
struct Arrays<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl Arrays<'_> {
    /// The `count` values of `name`.
    fn array<T: Pod>(&self, name: &str, count: usize) -> Result<Vec<T>> {
        let bad = |reason: String| Error::malformed(self.path, name.to_owned(), reason);
        let data = self.tensors.tensor(name).map_err(|e| bad(e.to_string()))?.data();
        let expected = count.saturating_mul(size_of::<T>());
        if data.len() != expected {
            return Err(bad(format!("has {} bytes, expected {expected}", data.len())));
        }
        Ok(bytemuck::pod_collect_to_vec(data))
    }

    /// Parameters of `n` triangles.
    fn params(&self, prefix: &str, n: usize, sh_degree: u8) -> Result<Params> {
        let k = sh_count(sh_degree);
        Ok(Params {
            vertices: self.array(&format!("{prefix}.vertices"), n)?,
            opacity: self.array(&format!("{prefix}.opacity"), n)?,
            sigma: self.array(&format!("{prefix}.sigma"), n)?,
            sh: self.array(&format!("{prefix}.sh"), n * k)?,
            sh_degree,
        })
    }
}

/// Writes `checkpoint` to `path`. With `keep` above 1, it writes files with the number of steps in
/// their names, and keeps the last `keep`. Returns the name of the file.
///
/// # Errors
///
/// A file that the operating system refuses.
pub(crate) fn write_numbered(path: &Path, checkpoint: &Checkpoint, keep: u32) -> Result<PathBuf> {
    if keep <= 1 {
        return write(path, checkpoint).map(|()| path.to_owned());
    }
    let newest = of_step(path, checkpoint.meta.step);
    write(&newest, checkpoint)?;
    // Files of later steps come from before this run resumed at an earlier one, so they are older.
    let mut files = numbered_files(path);
    files.sort_by_key(|(step, _)| (*step <= checkpoint.meta.step, *step));
    let surplus = files.len().saturating_sub(keep as usize);
    for (_, old) in &files[..surplus] {
        std::fs::remove_file(old).map_err(|e| Error::io(old, e))?;
    }
    Ok(newest)
}

/// The file of the checkpoint after `step` steps: `scene.step-00000500.checkpoint`.
fn of_step(path: &Path, step: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or(ENDING.as_ref()).to_string_lossy();
    path.with_file_name(format!("{stem}{STEP}{step:08}.{ending}"))
}

/// Steps and names of the numbered checkpoints of `path`.
pub fn numbered_files(path: &Path) -> Vec<(u64, PathBuf)> {
    let step = |file: PathBuf| {
        let digits = file.file_stem()?.to_str()?.rsplit_once(STEP)?.1.to_owned();
        let step = digits.parse().ok()?;
        (of_step(path, step).file_name() == file.file_name()).then_some((step, file))
    };
    input::entries(folder_of(path)).filter_map(step).collect()
}

/// The newest whole checkpoint of a folder, and the faults of newer ones.
///
/// # Errors
///
/// No checkpoint at all; none that is whole.
pub fn newest(folder: &Path) -> Result<(PathBuf, Checkpoint, Vec<String>)> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut files: Vec<(std::time::SystemTime, PathBuf)> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|ending| ending == ENDING))
        .filter_map(|path| Some((path.metadata().and_then(|meta| meta.modified()).ok()?, path)))
        .collect();
    files.sort();
    let mut broken = Vec::new();
    for (_, path) in files.into_iter().rev() {
        match read(&path) {
            Ok(checkpoint) => return Ok((path, checkpoint, broken)),
            Err(error) => broken.push(error.to_string()),
        }
    }
    let reason = if broken.is_empty() {
        "holds no file that ends with .checkpoint; give the file of a checkpoint".to_owned()
    } else {
        format!("holds no whole checkpoint: {}", broken.join("; "))
    };
    Err(Error::unsupported(folder, reason))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::PhotoIdentity;
    use std::io::Write;
    use trisplat_scene::Soup;

    fn photo(name: &str) -> PhotoIdentity {
        PhotoIdentity { name: name.into(), size: [3, 2], pose: 7, pixels: Some(1 << 63) }
    }

    fn sample() -> Checkpoint {
        let soup = Soup {
            vertices: vec![[Vec3::X, Vec3::Y, Vec3::new(0.1, f32::MIN_POSITIVE, -3.0)]; 3],
            opacity: vec![0.25; 3],
            sigma: vec![1.16; 3],
            sh: vec![[0.1, -0.2, 0.3]; 3],
            sh_degree: 0,
            ..Soup::default()
        };
        let mut visibility = VisibilityStats::new(3, 2);
        visibility.record_photo(1);
        let meta = CheckpointMeta {
            generator: "test".into(),
            step: 17,
            options: TrainOptions::default(),
            space: ([1.0, 2.0, 3.5], 0.123),
            pinned: 2,
            frozen: 1,
            core: Some(Core {
                low: [None, Some(-1.5), None],
                high: [Some(0.1), None, None],
                triangles: 7,
            }),
            exposure: ExposureEstimates::default(),
            identity: RunIdentity {
                background: [0.5, 0.0, 1.0],
                photos: ["a", "b"].map(photo).to_vec(),
                points: u64::MAX,
                from: None,
            },
            dropped: 2,
            curve: vec![TrainSample::default()],
            cpu_secs: 1.5,
            pace: None,
        };
        let params = Params::from_soup(&soup, meta.options.sh_degree);
        let state = OptimizerState { pinned: 2, frozen: 1, ..OptimizerState::new(params) };
        Checkpoint { state, visibility, meta }
    }

    #[test]
    fn comes_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write(&path, &sample()).unwrap();
        assert_eq!(read(&path).unwrap(), sample());
    }

    #[test]
    fn every_prefix_fails_cleanly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write(&path, &sample()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for cut in (0..bytes.len()).step_by(13) {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(read(&path).is_err(), "{cut}");
        }
    }

    #[test]
    fn errors_name_the_version() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write(&path, &sample()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let replaced = |from: &str, to: &str| {
            let at = whole.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let mut bytes = whole.clone();
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            std::fs::write(&path, bytes).unwrap();
            read(&path).unwrap_err().to_string()
        };
        let error = replaced(&format!("\"trisplat\":\"{FORMAT}"), "\"trisplat\":\"18");
        let expected =
            format!("is a checkpoint of another version, this one reads format {FORMAT}");
        assert!(error.contains(&expected), "{error}");
        let other = replaced("\"trisplat\":", "\"somebody\":");
        assert!(other.contains("is not a trisplat checkpoint"), "{other}");
    }

    #[test]
    fn every_corruption_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write(&path, &sample()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(read(&path).unwrap(), sample());
        let rng = trisplat_scene::Rng::new(1, "corruption", 0);
        let random = |i: u64, below: usize| (rng.bits(i) % below as u64) as usize;
        let refused = |what: String, bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            assert!(read(&path).is_err(), "{what}");
        };
        for i in 0..300 {
            let mut bytes = whole.clone();
            let at = random(3 * i, bytes.len());
            bytes[at] ^= 1 << random(3 * i + 1, 8);
            refused(format!("bit of byte {at}"), &bytes);
        }
        for i in 0..100 {
            let mut bytes = whole.clone();
            let at = random(5000 + 2 * i, bytes.len());
            let end = bytes.len().min(at + 1 + random(5001 + 2 * i, 64));
            bytes[at..end].fill(0);
            if bytes != whole {
                refused(format!("zeros from byte {at} to {end}"), &bytes);
            }
        }
        refused("a byte more".into(), &[&whole[..], &[0]].concat());
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused() {
        type Damage = fn(&mut Checkpoint);
        let damages: [(&str, Damage); 5] = [
            ("params.vertices", |c| c.state.params.vertices[1][2].y = f32::NAN),
            ("params.sh", |c| c.state.params.sh[2][0] = f32::INFINITY),
            ("first.opacity", |c| c.state.first.opacity[0] = f32::NAN),
            ("second.sigma", |c| c.state.second.sigma[2] = f32::NAN),
            ("visibility.radius_px", |c| c.visibility.radius_px[0] = f32::NAN),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        for (at, damage) in damages {
            let mut checkpoint = sample();
            damage(&mut checkpoint);
            let error = write(&path, &checkpoint).unwrap_err().to_string();
            assert!(error.contains(&format!("{at}: ")) && !path.exists(), "{error}");
        }
    }

    #[test]
    fn a_scene_is_no_checkpoint_and_says_where_it_belongs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let file = File::create(&path).unwrap();
        (&file).write_all(b"ply\nformat ascii").unwrap();
        // A hole, which no machine has the memory to read.
        file.set_len(200 << 30).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(
            error.contains("is not a checkpoint of a training run; to start from a scene"),
            "{error}"
        );
    }

    #[test]
    fn options_read_from_a_checkpoint_are_validated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let mut checkpoint = sample();
        checkpoint.meta.options.densify.growth = -1.0;
        write(&path, &checkpoint).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("__metadata__: densify.growth is -1"), "{error}");
        checkpoint = sample();
        checkpoint.meta.step = checkpoint.meta.options.steps + 1;
        write(&path, &checkpoint).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("is after step"));
    }

    #[cfg(unix)]
    #[test]
    fn a_checkpoint_has_the_permissions_of_any_output() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode =
            |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        write(&folder.path().join("a.checkpoint"), &sample()).unwrap();
        std::fs::write(folder.path().join("plain"), b"").unwrap();
        assert_eq!(mode("a.checkpoint"), mode("plain"));
    }
}
