//! Checkpoints: everything a run needs to go on bit for bit, in one safetensors file.
//!
//! ```text
//! u64 LE header length · JSON header {name: {dtype, shape, data_offsets}, __metadata__} · tensors, LE
//! ```
//! Tensors are the raw parameters, both Adam moments and the watch; `__metadata__.trisplat` is a JSON text
//! with the step, the options and what else is not an array.

use super::options::TrainOptions;
use super::params::{Params, State};
use super::progress::Sample;
use super::space::Space;
use super::watch::Watch;
use crate::error::{Error, Result};
use bytemuck::Pod;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// A run at rest between two steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Parameters and moments.
    pub state: State,
    /// What the photos have seen since the last judgement.
    pub watch: Watch,
    /// What is not an array.
    pub meta: Meta,
}

/// What is not an array.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Meta {
    /// Program and version.
    pub generator: String,
    /// Steps made.
    pub step: u64,
    /// The options of the run.
    pub options: TrainOptions,
    /// Centre and scale of training space.
    pub space: ([f32; 3], f32),
    /// Names of the training photos, in order.
    pub photos: Vec<String>,
    /// Gradients dropped because they were not finite.
    pub dropped: u64,
    /// The curve so far.
    pub curve: Vec<Sample>,
    /// CPU seconds used so far.
    pub cpu_secs: f64,
}

impl Meta {
    /// Training space.
    pub fn space(&self) -> Space {
        Space { center: Vec3::from_array(self.space.0), scale: self.space.1 }
    }
}

/// Writes `checkpoint` to a temporary file beside `path` and renames it.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> Result<()> {
    let mut tensors = Tensors::default();
    for (prefix, params) in [
        ("params", &checkpoint.state.params),
        ("first", &checkpoint.state.first),
        ("second", &checkpoint.state.second),
    ] {
        let (n, k) = (params.len(), params.sh_count());
        tensors.add(&format!("{prefix}.vertices"), "F32", &[n, 3, 3], &params.vertices);
        tensors.add(&format!("{prefix}.opacity"), "F32", &[n], &params.opacity);
        tensors.add(&format!("{prefix}.sigma"), "F32", &[n], &params.sigma);
        tensors.add(&format!("{prefix}.sh"), "F32", &[n, k, 3], &params.sh);
    }
    let watch = &checkpoint.watch;
    let n = watch.len();
    let bytes = |flags: &[bool]| flags.iter().map(|f| u8::from(*f)).collect::<Vec<u8>>();
    tensors.add("watch.max_weight", "F32", &[n], &watch.max_weight);
    tensors.add("watch.views", "U32", &[n], &watch.views);
    tensors.add("watch.radius_px", "F32", &[n], &watch.radius_px);
    tensors.add("watch.error", "U64", &[n], &watch.error);
    tensors.add("watch.exempt", "U8", &[n], &bytes(&watch.exempt));
    tensors.add("watch.seen", "U8", &[watch.seen.len()], &bytes(&watch.seen));

    let meta = serde_json::to_string(&checkpoint.meta)
        .map_err(|e| Error::invalid("checkpoint", e, "numbers JSON can hold"))?;
    tensors.header.insert("__metadata__".into(), json!({ "trisplat": meta }));
    tensors.write(path)
}

/// Arrays on their way into a file.
#[derive(Default)]
struct Tensors {
    header: serde_json::Map<String, Value>,
    data: Vec<u8>,
}

impl Tensors {
    fn add<T: bytemuck::NoUninit>(&mut self, name: &str, dtype: &str, shape: &[usize], values: &[T]) {
        let from = self.data.len();
        self.data.extend_from_slice(bytemuck::cast_slice(values));
        let offsets = [from, self.data.len()];
        self.header.insert(name.into(), json!({"dtype": dtype, "shape": shape, "data_offsets": offsets}));
    }

    fn write(&self, path: &Path) -> Result<()> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let io = |e| Error::io(path, e);
        let mut file = tempfile::NamedTempFile::new_in(folder).map_err(io)?;
        let mut header = Value::Object(self.header.clone()).to_string();
        // Tensors start at a multiple of eight bytes.
        header.extend(std::iter::repeat_n(' ', header.len().next_multiple_of(8) - header.len()));
        file.write_all(&(header.len() as u64).to_le_bytes()).map_err(io)?;
        file.write_all(header.as_bytes()).map_err(io)?;
        file.write_all(&self.data).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        file.persist(path).map(drop).map_err(|e| io(e.error))
    }
}

/// Reads a checkpoint and proves that its arrays fit together.
pub fn read(path: &Path) -> Result<Checkpoint> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let file = File::parse(path, &bytes)?;
    let meta = file.header.get("__metadata__").and_then(|m| m.get("trisplat")).and_then(Value::as_str);
    let meta = meta.ok_or_else(|| Error::malformed(path, "__metadata__", "is not a trisplat checkpoint"))?;
    let meta: Meta =
        serde_json::from_str(meta).map_err(|e| Error::malformed(path, "__metadata__", e.to_string()))?;
    let params = file.params("params", None)?;
    let state = State {
        first: file.params("first", Some(&params))?,
        second: file.params("second", Some(&params))?,
        params,
    };
    let watch = Watch {
        max_weight: file.array("watch.max_weight")?,
        views: file.array("watch.views")?,
        radius_px: file.array("watch.radius_px")?,
        error: file.array("watch.error")?,
        exempt: file.array::<u8>("watch.exempt")?.iter().map(|b| *b != 0).collect(),
        seen: file.array::<u8>("watch.seen")?.iter().map(|b| *b != 0).collect(),
    };
    let n = state.params.len();
    let lengths = [
        watch.max_weight.len(),
        watch.views.len(),
        watch.radius_px.len(),
        watch.error.len(),
        watch.exempt.len(),
    ];
    if lengths.iter().any(|l| *l != n) || watch.seen.len() != meta.photos.len() {
        return Err(Error::malformed(path, "watch", format!("wants {n} triangles, holds {lengths:?}")));
    }
    Ok(Checkpoint { state, watch, meta })
}

/// A parsed file; arrays are copied out on demand.
struct File<'a> {
    path: &'a Path,
    header: serde_json::Map<String, Value>,
    data: &'a [u8],
}

impl<'a> File<'a> {
    fn parse(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let broken = |at: &str, reason: &str| Error::malformed(path, at, reason);
        let (length, rest) =
            bytes.split_first_chunk::<8>().ok_or_else(|| broken("byte 0", "ends within the header"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        if length > rest.len() {
            return Err(broken("byte 0", "promises a longer header than the file holds"));
        }
        let (header, data) = rest.split_at(length);
        let header = serde_json::from_slice(header).map_err(|e| broken("header", &e.to_string()))?;
        Ok(Self { path, header, data })
    }

    /// The values of `name`, checked against its shape.
    fn array<T: Pod>(&self, name: &str) -> Result<Vec<T>> {
        let broken = |reason: &str| Error::malformed(self.path, name.to_owned(), reason);
        let entry = self.header.get(name).ok_or_else(|| broken("is missing"))?;
        let offset = |i: usize| {
            let value = entry.get("data_offsets").and_then(|o| o.get(i)).and_then(Value::as_u64);
            value.and_then(|v| usize::try_from(v).ok())
        };
        let range = offset(0).zip(offset(1)).and_then(|(from, to)| self.data.get(from..to));
        let bytes = range.ok_or_else(|| broken("lies outside the file"))?;
        if bytes.len() % size_of::<T>() != 0 {
            return Err(broken("is not a whole number of entries"));
        }
        Ok(bytemuck::pod_collect_to_vec(bytes))
    }

    fn params(&self, prefix: &str, like: Option<&Params>) -> Result<Params> {
        let vertices: Vec<[[f32; 3]; 3]> = self.array(&format!("{prefix}.vertices"))?;
        let params = Params {
            vertices: vertices.into_iter().map(|t| t.map(Vec3::from_array)).collect(),
            opacity: self.array(&format!("{prefix}.opacity"))?,
            sigma: self.array(&format!("{prefix}.sigma"))?,
            sh: self.array(&format!("{prefix}.sh"))?,
            sh_degree: 0,
        };
        let (n, rows) = (params.len(), params.sh.len());
        let degree = match like {
            Some(like) => (like.len() == n && like.sh.len() == rows).then_some(like.sh_degree),
            None => (0..=3u8).find(|d| n * (usize::from(*d) + 1).pow(2) == rows),
        };
        match degree {
            Some(sh_degree) if params.opacity.len() == n && params.sigma.len() == n => {
                Ok(Params { sh_degree, ..params })
            }
            _ => Err(Error::malformed(self.path, prefix.to_owned(), "arrays are not equally long")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soup::Soup;

    fn sample() -> Checkpoint {
        let soup = Soup {
            vertices: vec![[Vec3::X, Vec3::Y, Vec3::new(0.1, f32::MIN_POSITIVE, -3.0)]; 3],
            opacity: vec![0.25; 3],
            sigma: vec![1.16; 3],
            sh: vec![[0.1, -0.2, 0.3]; 3],
            sh_degree: 0,
        };
        let mut watch = Watch::new(3, 2);
        watch.meet(1);
        let meta = Meta {
            generator: "test".into(),
            step: 17,
            options: TrainOptions::default(),
            space: ([1.0, 2.0, 3.5], 0.123),
            photos: vec!["a".into(), "b".into()],
            dropped: 2,
            curve: vec![Sample::default()],
            cpu_secs: 1.5,
        };
        Checkpoint { state: State::new(Params::from_soup(&soup, 2)), watch, meta }
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
}
