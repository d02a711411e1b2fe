//! Checkpoints: everything a run needs to continue bitwise, in one safetensors file.
//!
//! Tensors are the raw parameters, both Adam moments and the visibility statistics, little-endian;
//! `__metadata__.trisplat` is a JSON text with the step, the options and all other values that are not
//! arrays. It begins with the format and the XXH3 checksum of the whole file: sixteen hexadecimal digits,
//! computed with zeros in their place.

mod checksum;
mod header;

use super::budget::BudgetController;
use super::core::Core;
use super::exposure::ExposureEstimates;
use super::identity::RunIdentity;
use super::options::TrainOptions;
use super::params::{Params, TrainState};
use super::prepared_run::PreparedRun;
use super::progress::TrainSample;
use super::visibility::VisibilityStats;
use bytemuck::{NoUninit, Pod};
use glam::Vec3;
use safetensors::tensor::{Dtype, SafeTensorError, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;
use trisplat_scene::{Error, Limits, Result, SceneNormalization, atomic::AtomicFile, guard::guarded, input};

/// Number of the layout; it changes whenever a key or an array does.
const FORMAT: u32 = 16;

/// Larger numbers have no finite f32 exponential.
const MOST_RAW_SIGMA: f32 = 88.0;

/// A run between two steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Parameters and moments.
    pub state: TrainState,
    /// Visibility of the triangles since the last pruning.
    pub visibility: VisibilityStats,
    /// What is not an array.
    pub meta: CheckpointMeta,
}

/// What is not an array.
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
    /// Number of first triangles that are pinned: see [`TrainState::pinned`].
    pub pinned: usize,
    /// Number of these that are frozen: see [`TrainState::frozen`].
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
    /// The known costs of a run with a budget.
    pub pace: Option<BudgetController>,
    /// The run that this training prepares, if it is not the run itself.
    pub prepares: Option<PreparedRun>,
}

impl CheckpointMeta {
    /// Training space.
    pub fn space(&self) -> SceneNormalization {
        SceneNormalization { center: Vec3::from_array(self.space.0), scale: self.space.1 }
    }

    /// Fails unless a run can have this state.
    fn validate(&self, path: &Path) -> Result<()> {
        let bad = |reason: String| Error::malformed(path, "__metadata__", reason);
        self.options.validate().map_err(|error| bad(error.to_string()))?;
        if self.step > self.options.steps {
            return Err(bad(format!("is after step {} of {}", self.step, self.options.steps)));
        }
        let (center, scale) = self.space;
        // Files store world coordinates, those of this space divided by its scale.
        if !(all_finite(&center) && scale.is_finite() && scale > 0.0 && scale.recip().is_finite()) {
            return Err(bad(format!("has a scene of centre {center:?} and scale {scale}")));
        }
        Ok(())
    }
}

/// The text of `__metadata__.trisplat`.
#[derive(Serialize, Deserialize)]
struct MetaText<T> {
    format: u32,
    checksum: String,
    run: T,
}

/// The field that every format has, except the first, which has no number.
#[derive(Deserialize)]
struct FormatText {
    format: Option<u32>,
}

/// Writes `checkpoint` as a file that appears whole or not at all, even when the power fails.
///
/// Errors: those of the operating system; numbers that are not finite, because no run can continue from
/// these.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> Result<()> {
    checkpoint.check_finite(path)?;
    write_unchecked(path, checkpoint)
}

fn write_unchecked(path: &Path, checkpoint: &Checkpoint) -> Result<()> {
    let io = |e| Error::io(path, e);
    let unwritable = |e: &dyn std::fmt::Display| Error::invalid("checkpoint", e, "numbers JSON can hold");
    let visibility = &checkpoint.visibility;
    let bytes = |flags: &[bool]| flags.iter().map(|f| u8::from(*f)).collect::<Vec<u8>>();
    let (exempt, drawn) = (bytes(&visibility.exempt), bytes(&visibility.drawn));
    let tensors = tensors(checkpoint, &exempt, &drawn).map_err(|e| unwritable(&e))?;
    let meta = MetaText { format: FORMAT, checksum: checksum::NONE.into(), run: &checkpoint.meta };
    let meta = serde_json::to_string(&meta).map_err(|e| unwritable(&e))?;
    let metadata = HashMap::from([("trisplat".to_owned(), meta)]);
    let mut bytes = safetensors::serialize(tensors, Some(metadata)).map_err(|e| unwritable(&e))?;
    checksum::fill_in(&mut bytes, FORMAT).ok_or_else(|| unwritable(&"no place for its checksum"))?;
    let mut file = AtomicFile::create(path)?;
    file.write_all(&bytes).map_err(io)?;
    file.commit().map(drop)
}

type Named<'a> = Vec<(String, TensorView<'a>)>;

/// Every array under its name.
fn tensors<'a>(
    checkpoint: &'a Checkpoint,
    exempt: &'a [u8],
    drawn: &'a [u8],
) -> std::result::Result<Named<'a>, SafeTensorError> {
    let mut tensors = Vec::new();
    let mut add = |name: String, dtype, shape: &[usize], data| {
        TensorView::new(dtype, shape.to_vec(), data).map(|view| tensors.push((name, view)))
    };
    let state = &checkpoint.state;
    for (prefix, params) in [("params", &state.params), ("first", &state.first), ("second", &state.second)] {
        let (n, k) = (params.len(), params.sh_count());
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
    add("visibility.error".into(), Dtype::U64, &[n], raw(&visibility.error))?;
    add("visibility.exempt".into(), Dtype::U8, &[n], exempt)?;
    add("visibility.drawn".into(), Dtype::U8, &[drawn.len()], drawn)?;
    Ok(tensors)
}

fn raw<T: NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}

/// Reads a checkpoint and checks that no byte has changed, that its options are valid and that its arrays
/// match.
///
/// Errors: a file that is broken, not a checkpoint, or of another version of trisplat.
pub fn read(path: &Path) -> Result<Checkpoint> {
    guarded(path, || read_unguarded(path))
}

fn read_unguarded(path: &Path) -> Result<Checkpoint> {
    let mut bytes = input::read_large(path, &Limits::DEFAULT, |file, len| header::check(path, file, len))?;
    // Before the content is read; files of other formats have no checksum here.
    let fits = checksum::fits(&mut bytes, FORMAT);
    if fits == Some(false) {
        return Err(header::damaged(path));
    }
    let meta = read_meta(path, &bytes)?;
    if fits.is_none() {
        return Err(header::damaged(path));
    }
    meta.validate(path)?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(|e| broken(path, &e))?;
    let file = Arrays { path, tensors };
    let params = file.params("params", None)?;
    let state = TrainState {
        first: file.params("first", Some(&params))?,
        second: file.params("second", Some(&params))?,
        pinned: meta.pinned,
        frozen: meta.frozen,
        params,
    };
    let n = state.params.len();
    if state.pinned > n || state.frozen > state.pinned {
        let reason = format!("{} frozen and {} pinned triangles of {n}", state.frozen, state.pinned);
        return Err(Error::malformed(path, "__metadata__", reason));
    }
    let flags = |name: &str, count: usize| -> Result<Vec<bool>> {
        Ok(file.array::<u8>(name, Dtype::U8, &[count])?.iter().map(|b| *b != 0).collect())
    };
    let visibility = VisibilityStats {
        max_weight: file.array("visibility.max_weight", Dtype::F32, &[n])?,
        sum_weight: file.array("visibility.sum_weight", Dtype::F32, &[n])?,
        views: file.array("visibility.views", Dtype::U32, &[n])?,
        radius_px: file.array("visibility.radius_px", Dtype::F32, &[n])?,
        error: file.array("visibility.error", Dtype::U64, &[n])?,
        exempt: flags("visibility.exempt", n)?,
        drawn: flags("visibility.drawn", meta.identity.photos.len())?,
    };
    let checkpoint = Checkpoint { state, visibility, meta };
    checkpoint.check_finite(path)?;
    Ok(checkpoint)
}

impl Checkpoint {
    /// Refuses numbers that would spoil every later step.
    fn check_finite(&self, path: &Path) -> Result<()> {
        let TrainState { params, first, second, .. } = &self.state;
        for (prefix, params) in [("params", params), ("first", first), ("second", second)] {
            let corners = params.vertices.iter().all(|t| t.iter().all(|corner| corner.is_finite()));
            let others = [&params.opacity[..], &params.sigma, params.sh.as_flattened()];
            if !corners || !others.iter().all(|values| all_finite(values)) {
                return Err(not_finite(path, prefix));
            }
        }
        let sides = self.meta.core.iter().flat_map(|core| core.low.into_iter().chain(core.high)).flatten();
        if !sides.into_iter().all(f32::is_finite) || !all_finite(&self.meta.identity.background) {
            return Err(not_finite(path, "__metadata__"));
        }
        // The derived values must be finite, too: corners in the world, σ = exp(raw).
        let space = self.meta.space();
        let is_far = |corner: &Vec3| !(*corner / space.scale + space.center).is_finite();
        if params.vertices.iter().flatten().any(is_far)
            || params.sigma.iter().any(|raw| *raw > MOST_RAW_SIGMA)
        {
            return Err(not_finite(path, "params"));
        }
        let squares = [&second.opacity[..], &second.sigma, second.sh.as_flattened()];
        let corners = second.vertices.iter().flatten().all(|corner| corner.min_element() >= 0.0);
        if !corners || !squares.iter().all(|values| values.iter().all(|value| *value >= 0.0)) {
            let reason = "means of squares below 0; resume from an earlier checkpoint, or train again";
            return Err(Error::malformed(path, "second", format!("holds {reason}")));
        }
        let VisibilityStats { max_weight, sum_weight, radius_px, .. } = &self.visibility;
        let visibility = [max_weight, sum_weight, radius_px];
        match visibility.iter().all(|values| all_finite(values)) {
            true => Ok(()),
            false => Err(not_finite(path, "visibility")),
        }
    }
}

fn all_finite(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

fn not_finite(path: &Path, at: &str) -> Error {
    Error::malformed(
        path,
        at,
        "holds numbers that are not finite; resume from an earlier checkpoint, or train again",
    )
}

/// The values that are not arrays, in a checkpoint of this format.
fn read_meta(path: &Path, bytes: &[u8]) -> Result<CheckpointMeta> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| broken(path, &e))?;
    let bad = |reason: String| Error::malformed(path, "__metadata__", reason);
    let text = metadata.metadata().as_ref().and_then(|map| map.get("trisplat"));
    let text = text.ok_or_else(|| bad("is not a trisplat checkpoint".into()))?;
    let json = |e: serde_json::Error| bad(e.to_string());
    let format = serde_json::from_str::<FormatText>(text).map_err(json)?.format.unwrap_or(1);
    if format != FORMAT {
        let reason = format!(
            "is a checkpoint of format {format}, this version reads {FORMAT}: go on with the version that wrote it, \
             or train anew"
        );
        return Err(Error::unsupported(path, reason));
    }
    serde_json::from_str::<MetaText<CheckpointMeta>>(text).map(|meta| meta.run).map_err(json)
}

/// An error of the container, and its place.
fn broken(path: &Path, error: &SafeTensorError) -> Error {
    let at = match error {
        SafeTensorError::HeaderTooSmall
        | SafeTensorError::HeaderTooLarge
        | SafeTensorError::InvalidHeaderLength => "byte 0".into(),
        SafeTensorError::TensorNotFound(name) | SafeTensorError::InvalidOffset(name) => name.clone(),
        _ => "header".into(),
    };
    Error::malformed(path, at, error.to_string())
}

/// The arrays of a file; they are copied out on demand.
struct Arrays<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl Arrays<'_> {
    /// The values of `name`, which must have this type and shape.
    fn array<T: Pod>(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<Vec<T>> {
        let view = self.tensors.tensor(name).map_err(|e| broken(self.path, &e))?;
        if view.dtype() != dtype || view.shape() != shape {
            let reason = format!("is {} {:?}, expected {dtype} {shape:?}", view.dtype(), view.shape());
            return Err(Error::malformed(self.path, name.to_owned(), reason));
        }
        Ok(bytemuck::pod_collect_to_vec(view.data()))
    }

    /// The size of `name` along each axis.
    fn shape(&self, name: &str) -> Result<Vec<usize>> {
        Ok(self.tensors.tensor(name).map_err(|e| broken(self.path, &e))?.shape().to_vec())
    }

    /// Parameters as large as `like`, or of any size.
    fn params(&self, prefix: &str, like: Option<&Params>) -> Result<Params> {
        let sh = format!("{prefix}.sh");
        let (n, k) = match (like, &self.shape(&sh)?[..]) {
            (Some(like), _) => (like.len(), like.sh_count()),
            (None, &[n, k, _]) => (n, k),
            (None, shape) => {
                return Err(Error::malformed(self.path, sh, format!("is {shape:?}, expected three axes")));
            }
        };
        let degree = (0..=3u8).find(|degree| (usize::from(*degree) + 1).pow(2) == k);
        let sh_degree = degree.ok_or_else(|| {
            Error::malformed(self.path, sh.clone(), format!("has {k} coefficients, expected 1, 4, 9 or 16"))
        })?;
        let vertices: Vec<[[f32; 3]; 3]> =
            self.array(&format!("{prefix}.vertices"), Dtype::F32, &[n, 3, 3])?;
        Ok(Params {
            vertices: vertices.into_iter().map(|t| t.map(Vec3::from_array)).collect(),
            opacity: self.array(&format!("{prefix}.opacity"), Dtype::F32, &[n])?,
            sigma: self.array(&format!("{prefix}.sigma"), Dtype::F32, &[n])?,
            sh: self.array(&sh, Dtype::F32, &[n, k, 3])?,
            sh_degree,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::PhotoIdentity;
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
            core: Some(Core { low: [None, Some(-1.5), None], high: [Some(0.1), None, None], triangles: 7 }),
            exposure: ExposureEstimates { passed: 3, ..ExposureEstimates::default() },
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
            prepares: Some(PreparedRun { state: serde_json::json!({ "psnr": 21.3 }), spent_secs: 0.1 }),
        };
        let state = TrainState { pinned: 2, frozen: 1, ..TrainState::new(Params::from_soup(&soup, 2)) };
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
        // With the same number of digits, so that the file keeps its length.
        let other = FORMAT + 1;
        let error = replaced(&format!("format\\\":{FORMAT}"), &format!("format\\\":{other}"));
        let expected = format!("is a checkpoint of format {other}, this version reads {FORMAT}");
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
        let damages: [(&str, Damage); 11] = [
            ("params", |c| c.state.params.vertices[1][2].y = f32::NAN),
            ("params", |c| c.state.params.sh[2][0] = f32::INFINITY),
            ("first", |c| c.state.first.opacity[0] = f32::NAN),
            ("second", |c| c.state.second.sigma[2] = f32::NAN),
            ("visibility", |c| c.visibility.radius_px[0] = f32::NAN),
            ("__metadata__", |c| c.meta.space.1 = 0.0),
            // Finite themselves, unlike the values that a file would hold.
            ("__metadata__", |c| c.meta.space.1 = 1e-40),
            ("__metadata__", |c| c.meta.identity.background[1] = f32::INFINITY),
            ("params", |c| c.state.params.vertices[1][2].y = 3e38),
            ("params", |c| c.state.params.sigma[0] = 89.0),
            ("second", |c| c.state.second.vertices[1][0].z = -1e-9),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        for (at, damage) in damages {
            let mut checkpoint = sample();
            damage(&mut checkpoint);
            write_unchecked(&path, &checkpoint).unwrap();
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains(&format!("{at}: ")), "{error}");
            assert!(at == "__metadata__" || write(&path, &checkpoint).is_err(), "{error}");
        }
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
        let mode = |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        write(&folder.path().join("a.checkpoint"), &sample()).unwrap();
        std::fs::write(folder.path().join("plain"), b"").unwrap();
        assert_eq!(mode("a.checkpoint"), mode("plain"));
    }
}
