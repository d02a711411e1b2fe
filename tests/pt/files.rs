//! Small checkpoints, made by hand: a stored zip around a pickle, as `torch.save` writes them.

use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_formats::{ReadOptions, Source, pt};
use trisplat_scene::{ImportedScene, Result, Scene, Soup, mesh::Mesh};

/// One entry of a stored zip: name, bytes, the compression method and size its headers claim.
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) body: Vec<u8>,
    pub(crate) method: u16,
    pub(crate) claims: Option<u64>,
}

pub(crate) fn entry(name: &str, body: &[u8]) -> Entry {
    Entry { name: format!("archive/{name}"), body: body.to_vec(), method: 0, claims: None }
}

/// A zip as `torch.save` writes it. Checksum 0 means "not computed", which torch allows.
pub(crate) fn zip(entries: &[Entry]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut directory = Vec::new();
    for e in entries {
        let size = e.claims.unwrap_or(e.body.len() as u64);
        let small = u32::try_from(size).unwrap_or(u32::MAX);
        let mut common = Vec::new();
        common.extend(45u16.to_le_bytes()); // version needed
        common.extend([0, 0]); // flags
        common.extend(e.method.to_le_bytes());
        common.extend([0; 4]); // time, date
        common.extend([0; 4]); // checksum
        common.extend(small.to_le_bytes());
        common.extend(small.to_le_bytes());
        common.extend((e.name.len() as u16).to_le_bytes());
        let extra: Vec<u8> = if small == u32::MAX {
            [&[1, 0, 16, 0][..], &size.to_le_bytes(), &size.to_le_bytes()].concat()
        } else {
            Vec::new()
        };
        common.extend((extra.len() as u16).to_le_bytes());
        let offset = file.len() as u32;
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(e.name.as_bytes());
        file.extend(&extra);
        file.extend(&e.body);
        directory.extend(b"PK\x01\x02");
        directory.extend(45u16.to_le_bytes()); // made by
        directory.extend(&common);
        directory.extend([0; 10]); // comment length, disk, attributes
        directory.extend(offset.to_le_bytes());
        directory.extend(e.name.as_bytes());
        directory.extend(&extra);
    }
    let start = file.len() as u32;
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend((entries.len() as u16).to_le_bytes());
    file.extend((entries.len() as u16).to_le_bytes());
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(start.to_le_bytes());
    file.extend([0, 0]);
    file
}

/// Writes pickle protocol 2, the few opcodes `torch.save` uses.
#[derive(Default)]
pub(crate) struct Pickle(pub(crate) Vec<u8>);

impl Pickle {
    pub(crate) fn text(&mut self, s: &str) {
        self.0.push(b'X');
        self.0.extend((s.len() as u32).to_le_bytes());
        self.0.extend(s.as_bytes());
    }

    pub(crate) fn int(&mut self, i: i64) {
        match i32::try_from(i) {
            Ok(i) => {
                self.0.push(b'J');
                self.0.extend(i.to_le_bytes());
            }
            Err(_) => {
                self.0.extend([0x8a, 8]);
                self.0.extend(i.to_le_bytes());
            }
        }
    }

    pub(crate) fn tuple(&mut self, items: &[i64]) {
        self.0.push(b'(');
        items.iter().for_each(|&i| self.int(i));
        self.0.push(b't');
    }

    pub(crate) fn global(&mut self, module: &str, name: &str) {
        self.0.extend(format!("c{module}\n{name}\n").as_bytes());
    }

    /// A tensor over storage `key`; wrapped in `nn.Parameter` when asked.
    pub(crate) fn tensor(&mut self, t: &Tensor, key: usize) {
        if t.parameter {
            self.global("torch._utils", "_rebuild_parameter");
        }
        self.global("torch._utils", "_rebuild_tensor_v2");
        self.0.extend(b"((");
        self.text("storage");
        self.global("torch", t.storage);
        self.text(&key.to_string());
        self.text("cuda:0");
        self.int(t.elements);
        self.0.extend(b"tQ");
        self.int(0);
        self.tuple(&t.shape);
        self.tuple(&t.stride.clone().unwrap_or_else(|| row_major(&t.shape)));
        self.0.push(0x89);
        self.global("collections", "OrderedDict");
        self.0.extend(b")RtR");
        if t.parameter {
            self.0.push(0x88);
            self.global("collections", "OrderedDict");
            self.0.extend(b")R\x87R");
        }
    }
}

pub(crate) fn row_major(shape: &[i64]) -> Vec<i64> {
    (0..shape.len()).map(|i| shape[i + 1..].iter().product()).collect()
}

pub(crate) struct Tensor {
    pub(crate) name: &'static str,
    pub(crate) storage: &'static str,
    pub(crate) shape: Vec<i64>,
    pub(crate) stride: Option<Vec<i64>>,
    pub(crate) elements: i64,
    pub(crate) body: Vec<u8>,
    pub(crate) parameter: bool,
}

pub(crate) fn floats(
    name: &'static str,
    shape: &[i64],
    values: impl IntoIterator<Item = f32>,
) -> Tensor {
    let body: Vec<u8> = values.into_iter().flat_map(f32::to_le_bytes).collect();
    let elements = body.len() as i64 / 4;
    Tensor {
        name,
        storage: "FloatStorage",
        shape: shape.to_vec(),
        stride: None,
        elements,
        body,
        parameter: true,
    }
}

pub(crate) fn integers(name: &'static str, shape: &[i64], values: &[i32]) -> Tensor {
    let body: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let elements = values.len() as i64;
    Tensor {
        name,
        storage: "IntStorage",
        shape: shape.to_vec(),
        stride: None,
        elements,
        body,
        parameter: false,
    }
}

/// A checkpoint of these tensors; `more` writes further dictionary items as raw opcodes.
pub(crate) fn checkpoint(tensors: &[Tensor], more: &[u8]) -> Vec<u8> {
    let mut pickle = Pickle(b"\x80\x02}(".to_vec());
    for (key, tensor) in tensors.iter().enumerate() {
        pickle.text(tensor.name);
        pickle.tensor(tensor, key);
    }
    pickle.0.extend(more);
    pickle.0.extend(b"u.");
    let mut entries =
        vec![entry("data.pkl", &pickle.0), entry("byteorder", b"little"), entry("version", b"3\n")];
    entries
        .extend(tensors.iter().enumerate().map(|(key, t)| entry(&format!("data/{key}"), &t.body)));
    zip(&entries)
}

pub(crate) fn int_item(name: &str, value: i64) -> Vec<u8> {
    let mut p = Pickle::default();
    p.text(name);
    p.int(value);
    p.0
}

pub(crate) fn float_item(name: &str, value: f64) -> Vec<u8> {
    let mut p = Pickle::default();
    p.text(name);
    p.0.push(b'G');
    p.0.extend(value.to_be_bytes());
    p.0
}

/// `n` triangles in the authors' layout with `rest` coefficients above degree 0.
pub(crate) fn soup_tensors(n: i64, rest: i64) -> Vec<Tensor> {
    let ramp = |count: i64, scale: f32| (0..count).map(move |i| i as f32 * scale);
    vec![
        floats("triangles_points", &[n, 3, 3], ramp(n * 9, 0.5)),
        floats("sigma", &[n, 1], ramp(n, -1.0)),
        floats("opacity", &[n, 1], ramp(n, 2.0)),
        floats("features_dc", &[n, 1, 3], ramp(n * 3, 0.125)),
        floats("features_rest", &[n, rest, 3], ramp(n * rest * 3, 0.001)),
    ]
}

pub(crate) fn mesh_tensors() -> Vec<Tensor> {
    vec![
        floats("triangles_points", &[4, 3], [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]),
        integers("_triangle_indices", &[2, 3], &[0, 1, 2, 0, 2, 3]),
        floats("vertex_weight", &[4, 1], [9.0; 4]),
        floats("features_dc", &[4, 1, 3], [-9., 0., 9., 0., 0., 0., 1., 1., 1., f32::NAN, 0., 0.]),
        floats("features_rest", &[4, 15, 3], [0.0; 180]),
    ]
}

pub(crate) struct Folder(pub(crate) tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Overwrites in place: truncating first makes ext4 flush, which takes longer than the test.
    pub(crate) fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("scene.pt");
        let mut options = std::fs::OpenOptions::new();
        let mut file =
            options.write(true).create(true).truncate(false).open(&path).expect("writable");
        file.write_all(bytes).expect("written");
        file.set_len(bytes.len() as u64).expect("cut");
        path
    }
}

pub(crate) fn read(path: &Path, sh_degree: u8) -> Result<ImportedScene> {
    pt::read(Source::open(path, &trisplat::Limits::DEFAULT)?, &ReadOptions::with_degree(sh_degree))
}

pub(crate) fn read_bytes(bytes: &[u8], sh_degree: u8) -> Result<ImportedScene> {
    read(&Folder::new().write(bytes), sh_degree)
}

pub(crate) fn soup(loaded: ImportedScene) -> Soup {
    match loaded.scene {
        Scene::Soup(soup) => soup,
        Scene::Mesh(_) => panic!("expected a soup"),
    }
}

pub(crate) fn mesh(loaded: &ImportedScene) -> &Mesh {
    match &loaded.scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("expected a mesh"),
    }
}
