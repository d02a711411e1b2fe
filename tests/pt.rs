//! Checkpoints: the authors' layout, the successors', and files made to hurt.
#![allow(clippy::print_stderr)]

use glam::Vec3;
use proptest::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use trisplat::error::{Error, Result};
use trisplat::formats::{ReadOptions, Source, pt};
use trisplat::mesh::{Colors, Mesh};
use trisplat::scene::{Loaded, Scene};
use trisplat::soup::Soup;

/// One entry of a stored zip: name, bytes, the compression method and size its headers claim.
struct Entry {
    name: String,
    body: Vec<u8>,
    method: u16,
    claims: Option<u64>,
}

fn entry(name: &str, body: &[u8]) -> Entry {
    Entry { name: format!("archive/{name}"), body: body.to_vec(), method: 0, claims: None }
}

/// A zip as `torch.save` writes it. Checksum 0 means "not computed", which torch allows.
fn zip(entries: &[Entry]) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
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
struct Pickle(Vec<u8>);

impl Pickle {
    fn text(&mut self, s: &str) {
        self.0.push(b'X');
        self.0.extend((s.len() as u32).to_le_bytes());
        self.0.extend(s.as_bytes());
    }

    fn int(&mut self, i: i64) {
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

    fn tuple(&mut self, items: &[i64]) {
        self.0.push(b'(');
        items.iter().for_each(|&i| self.int(i));
        self.0.push(b't');
    }

    fn global(&mut self, module: &str, name: &str) {
        self.0.extend(format!("c{module}\n{name}\n").as_bytes());
    }

    /// A tensor over storage `key`; wrapped in `nn.Parameter` when asked.
    fn tensor(&mut self, t: &Tensor, key: usize) {
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

fn row_major(shape: &[i64]) -> Vec<i64> {
    (0..shape.len()).map(|i| shape[i + 1..].iter().product()).collect()
}

struct Tensor {
    name: &'static str,
    storage: &'static str,
    shape: Vec<i64>,
    stride: Option<Vec<i64>>,
    elements: i64,
    body: Vec<u8>,
    parameter: bool,
}

fn floats(name: &'static str, shape: &[i64], values: impl IntoIterator<Item = f32>) -> Tensor {
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

fn integers(name: &'static str, shape: &[i64], values: &[i32]) -> Tensor {
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
fn checkpoint(tensors: &[Tensor], more: &[u8]) -> Vec<u8> {
    let mut pickle = Pickle(b"\x80\x02}(".to_vec());
    for (key, tensor) in tensors.iter().enumerate() {
        pickle.text(tensor.name);
        pickle.tensor(tensor, key);
    }
    pickle.0.extend(more);
    pickle.0.extend(b"u.");
    let mut entries =
        vec![entry("data.pkl", &pickle.0), entry("byteorder", b"little"), entry("version", b"3\n")];
    entries.extend(tensors.iter().enumerate().map(|(key, t)| entry(&format!("data/{key}"), &t.body)));
    zip(&entries)
}

fn int_item(name: &str, value: i64) -> Vec<u8> {
    let mut p = Pickle::default();
    p.text(name);
    p.int(value);
    p.0
}

fn float_item(name: &str, value: f64) -> Vec<u8> {
    let mut p = Pickle::default();
    p.text(name);
    p.0.push(b'G');
    p.0.extend(value.to_be_bytes());
    p.0
}

/// `n` triangles in the authors' layout with `rest` coefficients above degree 0.
fn soup_tensors(n: i64, rest: i64) -> Vec<Tensor> {
    let ramp = |count: i64, scale: f32| (0..count).map(move |i| i as f32 * scale);
    vec![
        floats("triangles_points", &[n, 3, 3], ramp(n * 9, 0.5)),
        floats("sigma", &[n, 1], ramp(n, -1.0)),
        floats("opacity", &[n, 1], ramp(n, 2.0)),
        floats("features_dc", &[n, 1, 3], ramp(n * 3, 0.125)),
        floats("features_rest", &[n, rest, 3], ramp(n * rest * 3, 0.001)),
    ]
}

fn mesh_tensors() -> Vec<Tensor> {
    vec![
        floats("triangles_points", &[4, 3], [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]),
        integers("_triangle_indices", &[2, 3], &[0, 1, 2, 0, 2, 3]),
        floats("vertex_weight", &[4, 1], [9.0; 4]),
        floats("features_dc", &[4, 1, 3], [-9., 0., 9., 0., 0., 0., 1., 1., 1., f32::NAN, 0., 0.]),
        floats("features_rest", &[4, 15, 3], [0.0; 180]),
    ]
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Overwrites in place: truncating first makes ext4 flush, which takes longer than the test.
    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("scene.pt");
        let mut options = std::fs::OpenOptions::new();
        let mut file = options.write(true).create(true).truncate(false).open(&path).expect("writable");
        file.write_all(bytes).expect("written");
        file.set_len(bytes.len() as u64).expect("cut");
        path
    }
}

fn read(path: &Path, sh_degree: u8) -> Result<Loaded> {
    pt::read(Source::open(path)?, &ReadOptions { sh_degree })
}

fn read_bytes(bytes: &[u8], sh_degree: u8) -> Result<Loaded> {
    read(&Folder::new().write(bytes), sh_degree)
}

fn soup(loaded: Loaded) -> Soup {
    match loaded.scene {
        Scene::Soup(soup) => soup,
        Scene::Mesh(_) => panic!("wants a soup"),
    }
}

fn mesh(loaded: &Loaded) -> &Mesh {
    match &loaded.scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("wants a mesh"),
    }
}

#[test]
fn the_authors_layout_is_a_soup_at_any_degree() {
    let bytes = checkpoint(&soup_tensors(5, 15), &int_item("active_sh_degree", 3));
    for degree in 0..=3u8 {
        let soup = soup(read_bytes(&bytes, degree).expect("sound"));
        assert_eq!((soup.len(), soup.sh_degree), (5, degree));
        assert_eq!(soup.vertices[1][2], Vec3::new(7.5, 8.0, 8.5));
        for i in 0..5 {
            let x = i as f64;
            assert_eq!(soup.sigma[i], (0.01 + (-x).exp()) as f32);
            assert_eq!(soup.opacity[i], (1.0 / (1.0 + (-2.0 * x).exp())) as f32);
            let k = soup.sh_count();
            assert_eq!(soup.sh[i * k], [0, 1, 2].map(|c| (3 * i + c) as f32 * 0.125));
            for j in 1..k {
                let first = (i * 15 + j - 1) * 3;
                assert_eq!(soup.sh[i * k + j], [0, 1, 2].map(|c| (first + c) as f32 * 0.001), "{i} {j}");
            }
        }
    }
}

#[test]
fn the_degree_is_the_lowest_of_asked_reached_and_stored() {
    let degree = |rest, active: &[u8]| {
        soup(read_bytes(&checkpoint(&soup_tensors(2, rest), active), 3).expect("sound")).sh_degree
    };
    assert_eq!(degree(15, &int_item("active_sh_degree", 1)), 1);
    assert_eq!(degree(8, &int_item("active_sh_degree", 3)), 2);
    assert_eq!(degree(0, &int_item("active_sh_degree", 0)), 0);
    assert_eq!(degree(3, b""), 1);
}

#[test]
fn higher_coefficients_are_not_touched_unless_asked_for() {
    let mut tensors = soup_tensors(3, 15);
    tensors[4].body.truncate(8);
    let bytes = checkpoint(&tensors, b"");
    assert_eq!(soup(read_bytes(&bytes, 0).expect("degree 0 is whole")).sh.len(), 3);
    let message = read_bytes(&bytes, 1).expect_err("the rest is cut off").to_string();
    assert!(message.contains("features_rest"), "{message}");
}

#[test]
fn a_successors_layout_is_a_connected_mesh() {
    let loaded =
        read_bytes(&checkpoint(&mesh_tensors(), &float_item("sigma", 1e-4f64.ln())), 3).expect("sound");
    let mesh = mesh(&loaded);
    assert_eq!(mesh.indices, [0, 1, 2, 0, 2, 3]);
    assert_eq!(mesh.positions[2], Vec3::new(1.0, 1.0, 0.0));
    assert!(mesh.opacity.is_empty());
    let Colors::Vertex(colors) = &mesh.colors else { panic!("wants vertex colours") };
    let linear = trisplat::math::color::linear_from_srgb;
    assert_eq!(colors[0], [0.0, linear(0.5), 1.0]);
    assert_eq!(colors[3], [0.0, linear(0.5), linear(0.5)]);
    assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
    assert!(loaded.warnings[0].contains("non-finite"));
}

#[test]
fn an_unfinished_run_of_a_successor_is_warned_of() {
    let loaded =
        read_bytes(&checkpoint(&mesh_tensors(), &float_item("sigma", 0.4f64.ln())), 0).expect("sound");
    assert!(loaded.warnings.iter().any(|w| w.contains("sigma is 0.400")), "{:?}", loaded.warnings);
}

#[test]
fn strided_views_are_gathered() {
    let mut tensors = soup_tensors(2, 0);
    tensors[3].stride = Some(vec![1, 1, 2]); // column-major: channel c of row i at i + 2 c
    let soup = soup(read_bytes(&checkpoint(&tensors, b""), 0).expect("sound"));
    assert_eq!(soup.sh, [[0.0, 0.25, 0.5], [0.125, 0.375, 0.625]]);
}

#[test]
fn non_finite_rows_are_dropped_with_a_warning() {
    let mut tensors = soup_tensors(4, 0);
    tensors[1] = floats("sigma", &[4, 1], [0.0, 1e9, f32::NEG_INFINITY, f32::NAN]);
    let loaded = read_bytes(&checkpoint(&tensors, b""), 0).expect("sound");
    assert!(loaded.warnings[0].contains("dropped 2"), "{:?}", loaded.warnings);
    assert_eq!(soup(loaded).sigma, [1.01, 0.01]);
}

/// Shapes, types and sizes that do not fit; each must name the tensor.
#[test]
fn misfits_are_named() {
    let change = |at: usize, edit: &dyn Fn(&mut Tensor)| {
        let mut tensors = soup_tensors(4, 3);
        edit(&mut tensors[at]);
        checkpoint(&tensors, b"")
    };
    let mesh = |at: usize, edit: &dyn Fn(&mut Tensor)| {
        let mut tensors = mesh_tensors();
        edit(&mut tensors[at]);
        checkpoint(&tensors, b"")
    };
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("triangles_points", change(0, &|t| t.shape = vec![4, 9])),
        ("triangles_points", change(0, &|t| t.shape = vec![36])),
        ("triangles_points", change(0, &|t| t.name = "xyz")),
        ("sigma", change(1, &|t| t.shape = vec![3, 1])),
        ("opacity", change(2, &|t| t.storage = "IntStorage")),
        ("opacity", change(2, &|t| t.name = "alpha")),
        ("features_dc", change(3, &|t| t.shape = vec![1, 4, 3])),
        ("features_rest", change(4, &|t| t.shape = vec![4, 1, 9])),
        ("triangles_points", change(0, &|t| t.body.truncate(140))),
        ("checkpoint", change(0, &|t| t.elements = 7)),
        ("checkpoint", change(0, &|t| t.elements = -36)),
        ("checkpoint", change(0, &|t| t.shape = vec![-4, 3, 3])),
        ("checkpoint", change(0, &|t| t.shape = vec![i64::MAX, 3, 3])),
        ("_triangle_indices", mesh(1, &|t| t.body[20] = 4)),
        ("_triangle_indices", mesh(1, &|t| t.body[3] = 0x80)),
        ("_triangle_indices", mesh(1, &|t| t.shape = vec![3, 2])),
        ("_triangle_indices", mesh(1, &|t| t.storage = "FloatStorage")),
        ("_triangle_indices", mesh(1, &|t| t.name = "faces")),
    ];
    for (place, bytes) in cases {
        let error = read_bytes(&bytes, 1).expect_err(place);
        assert!(error.to_string().contains(place), "{place}: {error}");
    }
}

/// Pickles that would run something in Python. Beside sound tensors they are ignored or refused; the
/// proof is that their file does not appear.
#[test]
fn unpickling_runs_nothing() {
    let folder = Folder::new();
    let proof = folder.0.path().join("proof");
    let shell = format!("touch {}", proof.display());
    let line = |text: String| text.into_bytes();
    let text = |s: &str| {
        let mut p = Pickle::default();
        p.text(s);
        p.0
    };
    let attacks: Vec<Vec<u8>> = vec![
        [b"cos\nsystem\n(".to_vec(), text(&shell), b"tR".to_vec()].concat(), // GLOBAL, REDUCE
        line(format!("(S'{shell}'\nios\nsystem\n")),                         // INST
        [b"(cos\nsystem\n".to_vec(), text(&shell), b"o".to_vec()].concat(),  // OBJ
        b"\x82\x01".to_vec(),                                                // EXT1
        b"\x83\x01\x00".to_vec(),                                            // EXT2
        b"\x84\x01\x00\x00\x00".to_vec(),                                    // EXT4
        [b"cos\nsystem\n".to_vec(), text(&shell), b"\x85\x81".to_vec()].concat(), // NEWOBJ
        [text("os"), text("system"), b"\x93(".to_vec(), text(&shell), b"tR".to_vec()].concat(), // STACK_GLOBAL
        [b"cbuiltins\neval\n(".to_vec(), text("1/0"), b"tR".to_vec()].concat(),
        [b"csubprocess\nPopen\n(".to_vec(), text(&shell), b"t\x81}".to_vec(), text("a"), b"Nsb".to_vec()]
            .concat(),
        line("ctorch._utils\n_rebuild_tensor_v2\n(NNNNNNtR".to_owned()),
        line("ctorch._utils\n_rebuild_parameter\n)R".to_owned()),
    ];
    for (i, attack) in attacks.iter().enumerate() {
        // As the value of an item beside good tensors, and as the whole pickle.
        let item = [text("evil"), attack.clone()].concat();
        let beside = checkpoint(&soup_tensors(2, 0), &item);
        if let Ok(loaded) = read(&folder.write(&beside), 0) {
            assert_eq!(soup(loaded).len(), 2, "attack {i}");
        }
        let alone = zip(&[entry("data.pkl", &[b"\x80\x02", &attack[..], b"."].concat())]);
        read(&folder.write(&alone), 0).expect_err("no tensors in it");
        assert!(!proof.exists(), "attack {i} ran");
    }
}

/// Sizes that are promised, not there.
#[test]
fn bombs_are_refused_before_anything_is_allocated() {
    let ten_gib = 10u64 << 30;
    let pickle = |byte: u8, count: usize| [b"\x80\x02".to_vec(), vec![byte; count], b".".to_vec()].concat();
    let sound = checkpoint(&soup_tensors(2, 0), b"");
    let bomb = |method: u16, claims: u64, name: &str| {
        let mut bad = entry(name, b"tiny");
        (bad.method, bad.claims) = (method, Some(claims));
        zip(&[entry("data.pkl", b"\x80\x02}."), bad])
    };
    let expanded = |shape: Vec<i64>| {
        let mut tensors = soup_tensors(2, 0);
        let rank = shape.len();
        tensors[0].shape = shape;
        tensors[0].stride = Some(vec![0; rank]);
        checkpoint(&tensors, b"")
    };
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("data.pkl", zip(&[entry("data.pkl", &pickle(b']', 2 << 20))])),
        ("nesting", zip(&[entry("data.pkl", &[&b"\x80\x02)"[..], &[0x85; 5000], b"."].concat())])),
        ("compressed", bomb(8, ten_gib, "data/0")),
        ("compressed", bomb(8, 4, "data/0")),
        ("promises", bomb(0, ten_gib, "data/0")),
        ("zip directory", bomb(0, u64::MAX - 1, "data/0")),
        ("promises", bomb(0, ten_gib, "data.pkl")),
        ("promises", expanded(vec![100_000_000, 3, 3])),
        ("promises", expanded(vec![1 << 28, 3, 3])),
        ("checkpoint", expanded(vec![1 << 40, 3, 3])),
        ("before PyTorch 1.6", b"\x80\x02}q\x00.".to_vec()),
        ("zip directory", sound[..sound.len() - 22].to_vec()),
    ];
    for (place, bytes) in cases {
        let error = read_bytes(&bytes, 0).expect_err(place);
        assert!(error.to_string().contains(place), "{place}: {error}");
    }
}

/// A sparse file that really has its 5 GiB: refused by count, not read.
#[test]
fn five_gib_of_nothing_are_refused() {
    let folder = Folder::new();
    let path = folder.0.path().join("sparse.pt");
    let body = 5u64 << 30;
    let rows = (body / 36) as i64;
    let mut points = floats("triangles_points", &[rows, 3, 3], []);
    points.elements = rows * 9;
    // The zip of an entry claiming 5 GiB, cut open where the hole goes.
    let mut pickle = Pickle(b"\x80\x02}(".to_vec());
    pickle.text("triangles_points");
    pickle.tensor(&points, 0);
    pickle.0.extend(b"u.");
    let mut hole = entry("data/0", b"");
    hole.claims = Some(body);
    let whole = zip(&[entry("data.pkl", &pickle.0), hole]);
    let directory = whole.windows(4).position(|w| w == b"PK\x01\x02").expect("a directory");
    let mut file = std::fs::File::create(&path).expect("writable");
    file.write_all(&whole[..directory]).expect("written");
    file.seek(SeekFrom::Current(body as i64)).expect("sparse");
    let mut tail = whole[directory..].to_vec();
    let end = tail.len() - 22;
    // The directory starts beyond 4 GiB: say so in a zip64 record, as torch does.
    let start = directory as u64 + body;
    let mut zip64 = b"PK\x06\x06".to_vec();
    zip64.extend(44u64.to_le_bytes());
    zip64.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    zip64.extend(2u64.to_le_bytes());
    zip64.extend(2u64.to_le_bytes());
    zip64.extend((end as u64).to_le_bytes());
    zip64.extend(start.to_le_bytes());
    zip64.extend(b"PK\x06\x07\0\0\0\0");
    zip64.extend((start + end as u64).to_le_bytes());
    zip64.extend(1u32.to_le_bytes());
    tail[end + 16..end + 20].fill(0xff);
    tail.splice(end..end, zip64);
    file.write_all(&tail).expect("written");
    drop(file);
    let error = read(&path, 0).expect_err("too many");
    assert!(
        matches!(&error, Error::Malformed { reason, .. } if reason.contains("the most we take")),
        "{error}"
    );
}

#[test]
fn every_prefix_and_every_flipped_bit_fails_or_reads_but_never_panics() {
    let folder = Folder::new();
    for bytes in [
        checkpoint(&soup_tensors(3, 3), &int_item("active_sh_degree", 1)),
        checkpoint(&mesh_tensors()[..4], &float_item("sigma", -9.0)),
    ] {
        for cut in 0..bytes.len() {
            let path = folder.write(&bytes[..cut]);
            assert!(read(&path, 1).is_err(), "a prefix of {cut} bytes was read");
        }
        for at in 0..bytes.len() {
            let mut bad = bytes.clone();
            bad[at] ^= 1 << (at % 8);
            drop(read(&folder.write(&bad), 1));
        }
    }
}

#[test]
fn pipes_are_read_from_a_copy() {
    let folder = Folder::new();
    let mut source = Source::open(&folder.write(&checkpoint(&soup_tensors(2, 0), b""))).expect("opens");
    source.path = PathBuf::from("-");
    assert_eq!(pt::read(source, &ReadOptions { sh_degree: 0 }).expect("sound").scene.triangle_count(), 2);
}

fn fuzz_cases() -> u32 {
    std::env::var("TRISPLAT_FUZZ_CASES").ok().and_then(|v| v.parse().ok()).unwrap_or(64)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: fuzz_cases(), failure_persistence: None, ..Default::default() })]

    /// Bytes of the pickle and of the directory overwritten at random.
    #[test]
    fn mutated_checkpoints_never_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        mesh in any::<bool>(),
    ) {
        let mut bytes = if mesh {
            checkpoint(&mesh_tensors()[..4], &float_item("sigma", -9.0))
        } else {
            checkpoint(&soup_tensors(2, 3), &int_item("active_sh_degree", 1))
        };
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        drop(read_bytes(&bytes, 1));
    }

    /// Random opcodes where the dictionary's items stand.
    #[test]
    fn random_pickles_never_panic(body in prop::collection::vec(any::<u8>(), 0..200)) {
        drop(read_bytes(&checkpoint(&soup_tensors(1, 0), &body), 0));
        drop(read_bytes(&zip(&[entry("data.pkl", &body)]), 0));
    }
}

/// Bytes of an array in an uncompressed .npz.
fn npz_floats(npz: &[u8], name: &str) -> Vec<f32> {
    let at = npz.windows(name.len()).position(|w| w == name.as_bytes()).expect("the array is there");
    let magic = at + npz[at..].windows(6).position(|w| w == b"\x93NUMPY").expect("a .npy");
    let header = u16::from_le_bytes([npz[magic + 8], npz[magic + 9]]) as usize;
    let text = std::str::from_utf8(&npz[magic + 10..magic + 10 + header]).expect("ascii");
    assert!(text.contains("'<f4'") && text.contains("'fortran_order': False"), "{text}");
    let shape = text.split_once("'shape': (").and_then(|(_, s)| s.split_once(')')).expect("a shape").0;
    let count: usize = shape.split(',').filter_map(|s| s.trim().parse::<usize>().ok()).product();
    let data = magic + 10 + header;
    npz[data..data + 4 * count]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

fn ulps(a: f32, b: f32) -> u32 {
    (a.to_bits() as i64 - b.to_bits() as i64).unsigned_abs() as u32
}

/// The file holds f32 logits of values that were f32 before: log and exp each round, and a logit of
/// magnitude x multiplies the error by x. Measured: 3 ulp for σ, 2 for opacity.
#[test]
fn the_guitar_checkpoint_has_its_known_values() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/soups");
    let Ok(expected) = std::fs::read(format!("{folder}/guitar_20k_expected.npz")) else {
        eprintln!("SKIPPED (no ../shared/soups)");
        return;
    };
    let soup = soup(read(Path::new(&format!("{folder}/guitar_20k.pt")), 3).expect("sound"));
    assert_eq!((soup.len(), soup.sh_degree, soup.sh.len()), (20_000, 3, 320_000));
    let worst = |got: &[f32], name: &str| {
        let wants = npz_floats(&expected, name);
        assert_eq!(got.len(), wants.len());
        got.iter().zip(wants).map(|(a, b)| ulps(*a, b)).max().unwrap_or(0)
    };
    let (sigma, opacity) = (worst(&soup.sigma, "sigma.npy"), worst(&soup.opacity, "opacity.npy"));
    assert!(sigma <= 3 && opacity <= 2, "sigma {sigma} ulp, opacity {opacity} ulp");
    // The same triangles as a mesh: 16 bytes a vertex, x y z f32 and rgba u8.
    let ply = std::fs::read(format!("{folder}/guitar_tri.ply")).expect("beside it");
    let first = ply.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    for (i, triangle) in soup.vertices.iter().enumerate() {
        for (j, vertex) in triangle.iter().enumerate() {
            let row = &ply[first + 16 * (3 * i + j)..][..16];
            assert_eq!(bytemuck::bytes_of(vertex), &row[..12], "triangle {i} corner {j}");
            let codes = soup.rgb(i).map(|c| (c * 255.0).round() as u8);
            assert_eq!(codes, row[12..15], "color of triangle {i}");
        }
    }
}

#[test]
fn the_guitar_checkpoint_truncated_fails_cleanly() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/soups/guitar_20k.pt");
    let Ok(bytes) = std::fs::read(path) else {
        eprintln!("SKIPPED (no ../shared/soups)");
        return;
    };
    let folder = Folder::new();
    // Shrink one file in place; every 997th byte of the directory and the pickle, fewer in the tensors.
    let path = folder.write(&bytes);
    let file = std::fs::OpenOptions::new().write(true).open(&path).expect("writable");
    for cut in (0..bytes.len()).step_by(997).rev() {
        file.set_len(cut as u64).expect("shrinks");
        assert!(read(&path, 0).is_err(), "a prefix of {cut} bytes was read");
    }
}
