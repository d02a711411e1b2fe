//! Training checkpoints written by `torch.save` (read only).
//!
//! Two families share the key `triangles_points` and are distinguished by its rank:
//!
//! ```text
//! Held et al. 2025       triangles_points [N, 3, 3]   a soup
//!                        sigma [N, 1]                 raw; σ = 0.01 + exp(x)
//!                        opacity [N, 1]               raw; o = 1 / (1 + exp(-x))
//!                        features_dc [N, 1, 3]        SH degree 0
//!                        features_rest [N, K-1, 3]    coefficient-major, rgb innermost
//!                        active_sh_degree             int
//! Triangle Splatting+,   triangles_points [V, 3]      shared vertices
//! MeshSplatting          _triangle_indices [T, 3]     integers
//!                        features_dc [V, 1, 3]        SH degree 0 of every vertex
//!                        sigma                        float; ln σ of the whole scene
//!                        vertex_weight [V, 1]         opacity logit over a floor that the file does not hold
//! ```
//!
//! A successor's mesh is read as solid: the floor under `vertex_weight` rises to 0.9999 during
//! training, so every face of a finished run is opaque. For an unfinished run, recognised by its σ,
//! the floor is unknown, and a warning says so.
//!
//! Unpickling executes nothing: `pytorch-reader` interprets the calls that rebuild tensors and
//! keeps every other one as an opaque name. `check_archive` checks the rest.

use crate::finish::finish;
use crate::source::is_packed;
use crate::splats::sog::names;
use crate::{ReadOptions, Source, format};
use bytemuck::Pod;
use glam::{DVec3, Vec3};
use pytorch_reader::{DType, PickleValue, PytorchError, PytorchReader};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, Scene, Soup, input, rgb_from_sh0, sh_count,
};

/// Largest `data.pkl` to parse. Real ones hold a few names and shapes (under 2 KiB). Every byte can
/// cost the parser about 100 bytes of stack, and a deflated file can claim any size.
const MAX_PICKLE_BYTES: u64 = 1 << 20;

/// Maximum σ of a finished run: Triangle Splatting+ and MeshSplatting end at 1e-4.
const MAX_FINISHED_SIGMA: f64 = 0.01;

const RESAVE: &str = "load it in PyTorch 1.6 or later and torch.save it again";

/// The scene in a checkpoint: a soup, or a mesh from one of the successors.
///
/// SH above `options.sh_degree` stays on disk.
///
/// # Errors
/// `Unsupported` for other files than zip checkpoints, or without triangles; `Malformed` for shapes
/// and sizes that do not match each other or the file.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    check_archive(&mut source)?;
    let file = TorchFile::open(&mut source, options.limits)?;
    let loaded = match file.shape("triangles_points")? {
        &[n, 3, 3] => read_soup(&file, n, options)?,
        &[v, 3] => read_mesh(&file, v)?,
        other => {
            return Err(file.malformed(
                "triangles_points",
                format!("has shape {other:?}; expected [N, 3, 3] for a soup or [V, 3] for a mesh"),
            ));
        }
    };
    finish(&source.path, loaded, DVec3::ZERO)
}

fn read_soup(file: &TorchFile, n: usize, options: &ReadOptions) -> Result<ImportedScene> {
    file.limits.triangles(file.label.display(), n as u64)?;
    let vertices: Vec<[Vec3; 3]> = file.values("triangles_points", DType::F32, &[&[n, 3, 3]])?;
    let mut sigma: Vec<f32> = file.values("sigma", DType::F32, &[&[n, 1], &[n]])?;
    let mut opacity: Vec<f32> = file.values("opacity", DType::F32, &[&[n, 1], &[n]])?;
    // In f64 and rounded once, so that the result does not depend on the platform's expf.
    parallel::for_each_mut(&mut sigma, GRAIN, |_, x| *x = (0.01 + f64::from(*x).exp()) as f32);
    parallel::for_each_mut(&mut opacity, GRAIN, |_, x| {
        *x = (1.0 / (1.0 + (-f64::from(*x)).exp())) as f32
    });
    let (sh, sh_degree) = read_sh(file, n, options.sh_degree)?;
    let soup = Soup { vertices, opacity, sigma, sh, sh_degree, ..Soup::default() };
    let provenance = Provenance {
        trainer: Some("triangle-splatting (Held et al. 2025)".into()),
        ..Provenance::default()
    };
    Ok(ImportedScene {
        scene: Scene::Soup(soup),
        provenance,
        warnings: Vec::new(),
        cameras: Vec::new(),
    })
}

/// Coefficients of every triangle, degree 0 first, and the degree: the lowest of the requested one,
/// the one reached by training, and the file's.
fn read_sh(file: &TorchFile, n: usize, max_degree: u8) -> Result<(Vec<[f32; 3]>, u8)> {
    let dc: Vec<[f32; 3]> = file.values("features_dc", DType::F32, &[&[n, 1, 3], &[n, 3]])?;
    if max_degree == 0 || file.shape("features_rest").is_err() {
        return Ok((dc, 0));
    }
    let stored = match file.shape("features_rest")? {
        &[rows, k, 3] if rows == n && matches!(k, 0 | 3 | 8 | 15) => k,
        other => {
            return Err(file.malformed(
                "features_rest",
                format!("has shape {other:?}; expected [{n}, K - 1, 3] with K = 1, 4, 9 or 16"),
            ));
        }
    };
    let active = match file.scalar("active_sh_degree")? {
        Some(PickleValue::Int(degree @ 0..=3)) => degree as u8,
        Some(PickleValue::Int(other)) => {
            return Err(
                file.malformed("active_sh_degree", format!("is {other}; expected 0, 1, 2 or 3"))
            );
        }
        _ => 3,
    };
    let degree = max_degree.min(active).min(((stored + 1) as f64).sqrt() as u8 - 1);
    if degree == 0 {
        return Ok((dc, 0));
    }
    let rest: Vec<[f32; 3]> = file.values("features_rest", DType::F32, &[&[n, stored, 3]])?;
    let used = sh_count(degree) - 1;
    let mut sh = Vec::new();
    file.limits.reserve(file.label.display(), &mut sh, n * (used + 1))?;
    for (dc, rest) in dc.iter().zip(rest.chunks_exact(stored)) {
        sh.push(*dc);
        sh.extend_from_slice(&rest[..used]);
    }
    Ok((sh, degree))
}

fn read_mesh(file: &TorchFile, v: usize) -> Result<ImportedScene> {
    file.limits.vertices(file.label.display(), v as u64)?;
    let positions: Vec<Vec3> = file.values("triangles_points", DType::F32, &[&[v, 3]])?;
    let dc: Vec<[f32; 3]> = file.values("features_dc", DType::F32, &[&[v, 1, 3], &[v, 3]])?;
    let mut warnings = Vec::new();
    let black = dc.iter().filter(|c| !c.iter().all(|x| x.is_finite())).count();
    if black > 0 {
        warnings.push(format!("vertices with non-finite colours became black ({black})"));
    }
    // `max` turns NaN into 0.
    let linear = |c: f32| linear_from_srgb(rgb_from_sh0(c).max(0.0));
    let colors = parallel::collect(dc.len(), GRAIN, |i| dc[i].map(linear));
    let mesh = Mesh {
        positions,
        colors: Colors::Vertex(colors),
        indices: read_indices(file, v)?,
        ..Mesh::default()
    };
    if let Some(PickleValue::Float(ln_sigma)) = file.scalar("sigma")?
        && ln_sigma.exp() > MAX_FINISHED_SIGMA
    {
        warnings.push(format!(
            "training had not finished (sigma is {:.3}): faces that were still translucent become solid",
            ln_sigma.exp()
        ));
    }
    let provenance = Provenance {
        trainer: Some("triangle-splatting2 or mesh-splatting".into()),
        ..Provenance::default()
    };
    Ok(ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() })
}

/// Vertex numbers, three per face, each below `v`.
fn read_indices(file: &TorchFile, v: usize) -> Result<Vec<u32>> {
    let key = "_triangle_indices";
    let &[faces, 3] = file.shape(key)? else {
        return Err(
            file.malformed(key, format!("has shape {:?}; expected [T, 3]", file.shape(key)?))
        );
    };
    file.limits.triangles(file.label.display(), faces as u64)?;
    let shape: &[usize] = &[faces, 3];
    let wide: Vec<i64> = match file.tensor(key)?.dtype() {
        DType::I64 => file.values(key, DType::I64, &[shape])?,
        _ => file.values::<i32>(key, DType::I32, &[shape])?.into_iter().map(i64::from).collect(),
    };
    if let Some(at) = wide.iter().position(|&i| i < 0 || i >= v as i64) {
        return Err(file.malformed(
            key,
            format!("face {} names vertex {}, but there are {v} vertices", at / 3, wide[at]),
        ));
    }
    Ok(wide.into_iter().map(|i| i as u32).collect())
}

/// An opened checkpoint: tensors by name, their bytes still on disk.
struct TorchFile {
    /// The name that the user gave.
    label: PathBuf,
    /// Path on disk; a temporary copy of standard input, and of an unpacked file.
    file: PathBuf,
    /// Keeps that copy alive.
    _copy: Option<NamedTempFile>,
    bytes: u64,
    tensors: PytorchReader,
    limits: Limits,
}

impl TorchFile {
    fn open(source: &mut Source, limits: Limits) -> Result<Self> {
        let label = source.path.clone();
        let (file, copy) = if label.as_os_str() == "-" || is_packed(&label) {
            let copy = spool(&label, &source.file)?;
            (copy.path().to_owned(), Some(copy))
        } else {
            (label.clone(), None)
        };
        let tensors =
            PytorchReader::new(&file).map_err(|e| {
                match PytorchReader::read_pickle_data(&file, None) {
                    Ok(PickleValue::Dict(_)) | Err(_) => torch_error(&label, e),
                    Ok(_) => unnamed_state(&label, &file),
                }
            })?;
        Ok(Self { label, file, _copy: copy, bytes: source.len, tensors, limits })
    }

    fn malformed(&self, key: &str, reason: String) -> Error {
        Error::malformed(&self.label, format!("tensor {key}"), reason)
    }

    fn tensor(&self, key: &str) -> Result<&pytorch_reader::Tensor> {
        self.tensors.get(key).ok_or_else(|| {
            let mut keys = self.tensors.keys();
            keys.sort();
            if format::are_parameters(&keys) {
                return format::gaussian_checkpoint(&self.label);
            }
            keys.truncate(12);
            Error::unsupported(
                &self.label,
                format!(
                    "is a checkpoint without {key} (it holds {keys:?}); give point_cloud_state_dict.pt of a \
                     triangle splatting run"
                ),
            )
        })
    }

    fn shape(&self, key: &str) -> Result<&[usize]> {
        Ok(self.tensor(key)?.shape())
    }

    /// The numbers of a tensor in row-major order, when it has one of `shapes`.
    fn values<T: Pod>(&self, key: &str, dtype: DType, shapes: &[&[usize]]) -> Result<Vec<T>> {
        let tensor = self.tensor(key)?;
        if tensor.dtype() != dtype || !shapes.contains(&tensor.shape()) {
            return Err(self.malformed(
                key,
                format!(
                    "is {:?} of shape {:?}; expected {dtype:?} of shape {:?}",
                    tensor.dtype(),
                    tensor.shape(),
                    shapes[0]
                ),
            ));
        }
        // A view with stride 0 or a missing storage can claim any size.
        if tensor.byte_len() as u64 > self.bytes {
            return Err(self.malformed(
                key,
                format!(
                    "promises {} bytes, but the whole file has {}",
                    tensor.byte_len(),
                    self.bytes
                ),
            ));
        }
        let bytes = tensor.read().map_err(|e| match e.raw_os_error() {
            Some(_) => Error::io(&self.label, e),
            None => self.malformed(key, e.to_string()),
        })?;
        if bytes.len() % size_of::<T>() != 0 {
            return Err(
                self.malformed(key, format!("has {} bytes, which is no whole row", bytes.len()))
            );
        }
        let mut values =
            self.limits.zeroed::<T>(self.label.display(), bytes.len() / size_of::<T>())?;
        bytemuck::cast_slice_mut(&mut values).copy_from_slice(&bytes);
        Ok(values)
    }

    /// A plain Python value stored with the tensors.
    fn scalar(&self, key: &str) -> Result<Option<PickleValue>> {
        match PytorchReader::read_pickle_data(&self.file, None)
            .map_err(|e| torch_error(&self.label, e))?
        {
            PickleValue::Dict(mut dict) => Ok(dict.remove(key)),
            _ => Ok(None),
        }
    }
}

/// Refuses files that would make the parser allocate more than their size: entries that claim more
/// bytes than the file has (deflated bombs, sparse files) and an oversized `data.pkl`. `torch.save`
/// compresses nothing.
fn check_archive(source: &mut Source) -> Result<()> {
    let path = source.path.clone();
    let head = source.head()?;
    if !head.starts_with(b"PK") {
        return Err(Error::unsupported(
            &path,
            format!("is a checkpoint from before PyTorch 1.6 or a bare pickle; {RESAVE}"),
        ));
    }
    let zip_error =
        |e: zip::result::ZipError| Error::malformed(&path, "zip directory", e.to_string());
    let mut archive = zip::ZipArchive::new(io::BufReader::new(&*source.file)).map_err(zip_error)?;
    let names = names(&archive);
    if format::is_sog(&names) {
        return Err(format::refusal(&path, "SOG"));
    }
    if !names.iter().any(|name| name.ends_with("data.pkl")) {
        return Err(Error::unsupported(&path, other_archive(&names)));
    }
    for index in 0..archive.len() {
        let entry = archive.by_index_raw(index).map_err(zip_error)?;
        let at = || format!("zip entry {index}");
        if entry.compression() != zip::CompressionMethod::Stored {
            return Err(Error::unsupported(&path, format!("holds compressed entries; {RESAVE}")));
        }
        if entry.size() > source.len || entry.compressed_size() != entry.size() {
            return Err(Error::malformed(
                &path,
                at(),
                format!("promises {} bytes, but the whole file has {}", entry.size(), source.len),
            ));
        }
        let is_pickle = entry.name().is_ok_and(|name| name.ends_with("data.pkl"));
        if is_pickle && entry.size() > MAX_PICKLE_BYTES {
            return Err(Error::TooLarge {
                what: format!("{}: data.pkl", path.display()),
                bytes: entry.size(),
                limit: MAX_PICKLE_BYTES,
                remedy: "save the model's tensors alone".into(),
            });
        }
    }
    source.rewind()
}

/// The error of a checkpoint without names at `file`: 3DGS and its successors save the state of a
/// training as a tuple of tensors (`chkpnt30000.pth`). `label` is its name for the user.
fn unnamed_state(label: &Path, file: &Path) -> Error {
    let pickle = pickle_bytes(file).unwrap_or_default();
    let has = |codes: &[u8]| pickle.windows(codes.len()).any(|window| window == codes);
    if has(QUATERNIONS) {
        return format::gaussian_checkpoint(label);
    }
    let reason = if has(TRIANGLES) {
        "is the state of a training; give point_cloud_state_dict.pt of the same run"
    } else {
        "is a checkpoint without names, such as the state of a training; give point_cloud_state_dict.pt of a triangle splatting run"
    };
    Error::unsupported(label, reason)
}

/// The bytes of `data.pkl` in the checkpoint at `file`, which the parser has read before.
fn pickle_bytes(file: &Path) -> Option<Vec<u8>> {
    let mut archive = zip::ZipArchive::new(File::open(file).ok()?).ok()?;
    let names: Vec<String> = archive.file_names().flatten().map(Cow::into_owned).collect();
    let name = names.iter().find(|name| name.ends_with("data.pkl"))?;
    let mut bytes = Vec::new();
    // PyTorch may write no checksum: what was read is enough for a message.
    let _ = archive.by_name(name).ok()?.take(MAX_PICKLE_BYTES).read_to_end(&mut bytes);
    Some(bytes)
}

/// Codes of a pickle for the end of the shape [N, 4].
const QUATERNIONS: &[u8] = b"K\x04\x86";
/// Codes of a pickle for the end of the shape [N, 3, 3].
const TRIANGLES: &[u8] = b"K\x03K\x03\x87";

/// Kind of an archive with entries of these names, if it is no checkpoint.
fn other_archive(names: &[String]) -> &'static str {
    let has = |ending: &str| names.iter().any(|name| name.to_ascii_lowercase().ends_with(ending));
    let photos = ["jpg", "jpeg", "png", "heic", "tif", "tiff"];
    if has(".npy") {
        "is a NumPy archive, as research codes store compressed Gaussians; export plain Gaussians (a PLY as 3DGS writes it)"
    } else if photos.into_iter().any(has)
        && !["ply", "obj", "glb", "gltf", "usdc", "usda"].into_iter().any(has)
    {
        "is a zip archive of photos; unpack it: `trisplat make` makes a scene of the folder"
    } else {
        "is a zip archive, and neither a checkpoint nor SOG; unpack it and give the file inside"
    }
}

/// A named copy of an open file, because the checkpoint parser opens by name.
fn spool(label: &Path, mut file: &File) -> Result<NamedTempFile> {
    let unread = |e| Error::io(label, e);
    file.seek(SeekFrom::Start(0)).map_err(unread)?;
    let mut copy = NamedTempFile::new().map_err(Error::temporary)?;
    input::copy_stream(&mut file, &mut copy, unread, Error::temporary)?;
    Ok(copy)
}

fn torch_error(path: &Path, error: PytorchError) -> Error {
    match error {
        PytorchError::Io(e) if e.raw_os_error().is_some() => Error::io(path, e),
        e => Error::malformed(path, "checkpoint", e.to_string()),
    }
}
