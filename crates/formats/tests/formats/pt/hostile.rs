//! Checkpoints made to hurt: code to run, sizes that are promised, damage.

use proptest::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use trisplat_fixtures::checkpoints::{
    Folder, Pickle, checkpoint, entry, float_item, floats, int_item, mesh_tensors, read,
    read_bytes, soup, soup_tensors, zip,
};
use trisplat_scene::Error;

/// Pickles that would run something in Python. Beside valid tensors they are ignored or refused;
/// the proof is that their file does not appear.
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
        [
            b"csubprocess\nPopen\n(".to_vec(),
            text(&shell),
            b"t\x81}".to_vec(),
            text("a"),
            b"Nsb".to_vec(),
        ]
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
    let pickle =
        |byte: u8, count: usize| [b"\x80\x02".to_vec(), vec![byte; count], b".".to_vec()].concat();
    let valid = checkpoint(&soup_tensors(2, 0), b"");
    let bomb = |method: u16, claims: u64, name: &str| {
        let mut bad = entry(name, b"tiny");
        bad.method = method;
        bad.claims = Some(claims);
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
        ("`limit` triangles=100000000", expanded(vec![100_000_000, 3, 3])),
        ("`limit` triangles=268435456", expanded(vec![1 << 28, 3, 3])),
        ("checkpoint", expanded(vec![1 << 40, 3, 3])),
        ("before PyTorch 1.6", b"\x80\x02}q\x00.".to_vec()),
        ("zip directory", valid[..valid.len() - 22].to_vec()),
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
        matches!(&error, Error::Limit { key: "triangles", value, .. } if *value == rows as u64),
        "{error}"
    );
}

#[test]
fn checkpoint_prefixes_and_flipped_bits_never_panic() {
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
fn a_large_checkpoint_truncated_fails_cleanly() {
    let bytes = checkpoint(&soup_tensors(20_000, 15), &int_item("active_sh_degree", 3));
    let folder = Folder::new();
    // Shrink one file in place; every 997th byte of the directory and the pickle, fewer in the
    // tensors.
    let path = folder.write(&bytes);
    let file = std::fs::OpenOptions::new().write(true).open(&path).expect("writable");
    for cut in (0..bytes.len()).step_by(997).rev() {
        file.set_len(cut as u64).expect("shrinks");
        assert!(read(&path, 0).is_err(), "a prefix of {cut} bytes was read");
    }
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
