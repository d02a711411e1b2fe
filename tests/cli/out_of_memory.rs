//! Memory that ends at any point of a command: the whole output, or an end that leaves everything
//! as it was, but for temporary files that the next run removes. And what reading takes of it,
//! against what a file holds.

use super::{sample, stderr};
use glam::Vec3;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use trisplat_formats::OutputOptions;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Asset, Rng};

/// Bakes the studio to `out` with so much address space, MB.
fn bake_within(megabytes: u32, out: &Path) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {} && exec \"$0\" \"$@\"", megabytes * 1024)]);
    command
        .args([env!("CARGO_BIN_EXE_trisplat"), "bake"])
        .arg(sample("studio.ply"))
        .arg("-o")
        .arg(out);
    command.args(["--force", "--preset", "fast", "--lod", "0.5", "--threads", "2"]);
    // To print where a panic was takes memory, and Rust's library waits for itself for ever where
    // there is none.
    command.env("RUST_BACKTRACE", "0").stdin(Stdio::null()).output().unwrap()
}

#[test]
fn whatever_memory_there_is_files_are_whole_or_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let left = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.contains(".trisplat.")).collect::<Vec<_>>()
    };
    let mut ended = 0;
    // From too little to load the program to more than enough.
    for megabytes in 16..400 {
        std::fs::write(&out, "an earlier scene").unwrap();
        let output = bake_within(megabytes, &out);
        let text = stderr(&output);
        if output.status.success() {
            assert!(std::fs::read(&out).unwrap().starts_with(b"glTF"));
            assert!(left().is_empty(), "{:?}", left());
            assert!(ended > 2, "ended {ended} times for want of memory");
            return;
        }
        assert_eq!(std::fs::read(&out).unwrap(), b"an earlier scene", "{megabytes} MB: {text}");
        assert!(text.lines().filter(|l| l.starts_with("error: ")).count() <= 1, "{text}");
        if output.status.code().is_some() {
            assert!(left().is_empty(), "{megabytes} MB: {:?} after {text}", left());
        }
        ended += usize::from(text.contains("memory allocation of"));
    }
    panic!("it never succeeded");
}

// ---- Memory of reading --------------------------------------------------------------------------

/// Output of `trisplat info FILE`, and the most memory that it had, bytes.
fn info_of(file: &Path) -> (u64, Output) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    peak_of(command.args(["info", "--threads", "2"]).arg(file))
}

/// Output of a command, and the most memory that it had, bytes: the system's own mark, asked for
/// until the program is gone.
fn peak_of(command: &mut Command) -> (u64, Output) {
    command.stdin(Stdio::null());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let mark =
            text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
        peak =
            mark.and_then(|kib| kib.parse::<u64>().ok()).map_or(peak, |kib| peak.max(1024 * kib));
        std::thread::sleep(Duration::from_micros(200));
    }
    (peak, child.wait_with_output().unwrap())
}

/// What the program takes for an empty scene.
fn base(folder: &Path) -> u64 {
    let file = folder.join("one.obj");
    std::fs::write(&file, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    info_of(&file).0
}

const COUNT: usize = 300_000;

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

fn noise(count: usize, seed: u64) -> impl Iterator<Item = u8> {
    let rng = Rng::new(seed, "noise", 0);
    (0..count as u64).map(move |i| (256.0 * rng.uniform(i)) as u8)
}

/// Triangles as files of every format, with the bytes of their scene in memory.
fn meshes(folder: &Path) -> Vec<(&'static str, u64)> {
    let rng = Rng::new(1, "corners", 0);
    let corner =
        |i: u64| Vec3::new(rng.uniform(3 * i), rng.uniform(3 * i + 1), rng.uniform(3 * i + 2));
    let positions: Vec<Vec3> = (0..3 * COUNT as u64).map(corner).collect();
    let colors = positions.iter().map(|p| p.to_array()).collect();
    let mesh = Mesh { positions, colors: Colors::Vertex(colors), ..Mesh::default() };
    let asset = Asset::from(mesh);
    for name in ["a.ply", "a.glb", "a.obj"] {
        trisplat_formats::write(&asset, &folder.join(name), &OutputOptions::DEFAULT).unwrap();
    }
    let mut off = format!("OFF\n{} {COUNT} 0\n", 3 * COUNT);
    asset.mesh.positions.iter().for_each(|p| off += &format!("{} {} {}\n", p.x, p.y, p.z));
    (0..COUNT).for_each(|i| off += &format!("3 {} {} {} 9 8 7\n", 3 * i, 3 * i + 1, 3 * i + 2));
    std::fs::write(folder.join("a.off"), off).unwrap();
    // Positions, and colours of vertices or faces.
    let at = 36 * COUNT as u64;
    let vertices = 36 * COUNT as u64;
    let faces = 12 * COUNT as u64;
    vec![
        ("a.ply", at + vertices),
        ("a.glb", at + vertices),
        ("a.obj", at + vertices),
        ("a.off", at + faces),
    ]
}

/// The same of Gaussians.
fn splats(folder: &Path) -> Vec<(&'static str, u64)> {
    let rng = Rng::new(2, "numbers", 0);
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String =
        names.split(' ').map(|name| format!("property float {name}\n")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {COUNT}\n{properties}end_header\n"
    );
    let rows = (0..14 * COUNT as u64).flat_map(|i| (2.0 * rng.uniform(i) - 1.0).to_le_bytes());
    std::fs::write(
        folder.join("g.ply"),
        header.into_bytes().into_iter().chain(rows).collect::<Vec<u8>>(),
    )
    .unwrap();
    let float = |i: u64| (rng.uniform(i) + 0.1).to_le_bytes();
    let row = |i: u64| {
        (0..6).flat_map(move |k| float(6 * i + k)).chain([i as u8, 9, 8, 200, 255, 128, 128, 128])
    };
    std::fs::write(folder.join("a.splat"), (0..COUNT as u64).flat_map(row).collect::<Vec<u8>>())
        .unwrap();
    let spz = [&b"NGSP\x03\0\0\0"[..], &(COUNT as u32).to_le_bytes(), &[0, 12, 0, 0]].concat();
    let spz: Vec<u8> = spz.into_iter().chain(noise(20 * COUNT, 4)).collect();
    std::fs::write(folder.join("a.spz"), gzipped(&spz)).unwrap();
    let side = (COUNT as f64).sqrt().ceil() as u32;
    let codes: Vec<f64> = (0..256).map(|code| f64::from(code) / 100.0 - 2.0).collect();
    let meta = serde_json::json!({
        "version": 2, "count": COUNT,
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": codes, "files": ["scales.webp"]}, "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": codes, "files": ["sh0.webp"]},
    });
    let mut archive = zip::ZipWriter::new(std::fs::File::create(folder.join("a.sog")).unwrap());
    let stored = zip::write::SimpleFileOptions::default();
    archive.start_file("meta.json", stored).unwrap();
    archive.write_all(meta.to_string().as_bytes()).unwrap();
    for (seed, name) in
        ["means_l.webp", "means_u.webp", "scales.webp", "quats.webp", "sh0.webp"].iter().enumerate()
    {
        let tag = |(i, byte)| if i % 4 == 3 { 252 } else { byte };
        let pixels: Vec<u8> =
            noise(4 * (side * side) as usize, seed as u64).enumerate().map(tag).collect();
        archive.start_file(*name, stored).unwrap();
        image::codecs::webp::WebPEncoder::new_lossless(&mut archive)
            .encode(&pixels, side, side, image::ExtendedColorType::Rgba8)
            .unwrap();
    }
    archive.finish().unwrap();
    // Position, scales, rotation, opacity, colour.
    ["g.ply", "a.splat", "a.spz", "a.sog"]
        .map(|name| (name, (12 + 12 + 16 + 4 + 12) * COUNT as u64))
        .into()
}

#[test]
#[expect(clippy::print_stderr, reason = "the figures of docs/reliability.md")]
fn reading_takes_at_most_four_times_file_and_scene() {
    let folder = tempfile::tempdir().unwrap();
    let base = base(folder.path());
    for (name, scene) in [meshes(folder.path()), splats(folder.path())].concat() {
        let file = folder.path().join(name);
        let (peak, output) = info_of(&file);
        assert!(output.status.success(), "{name}: {}", stderr(&output));
        let bytes = std::fs::metadata(&file).unwrap().len();
        let took = peak.saturating_sub(base);
        let times = took as f64 / (bytes + scene) as f64;
        eprintln!(
            "{name:8} {bytes:>10} B, scene {scene:>10} B, memory {took:>10} B: {times:.2} times"
        );
        assert!(peak > base && times < 4.0, "{name}: {times:.2} times {bytes} + {scene} bytes");
    }
}

/// Files whose bytes or claims would fill any memory.
#[test]
#[expect(clippy::print_stderr, reason = "the figures of docs/reliability.md")]
fn a_bomb_takes_no_more_memory_than_a_file_of_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let base = base(folder.path());
    let zeros = vec![0; 1 << 28];
    let spz = |version: u32, count: u32| {
        [&b"NGSP"[..], &version.to_le_bytes(), &count.to_le_bytes(), &[0, 8, 0, 6]].concat()
    };
    // A block of zstd repeats one byte 2^17 times in four bytes: 2 GB.
    let frame = [
        &[0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58][..],
        &[2, 0, 0x10, 0].repeat(16_000),
        &[3, 0, 0x10, 0],
    ]
    .concat();
    let table: Vec<u8> = [frame.len() as u64, 9, 0, 1, 0, 3, 0, 3, 0, 4, 0, 0]
        .iter()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let sog = |side: u32, list: usize| {
        let mut out = std::io::Cursor::new(Vec::new());
        let mut archive = zip::ZipWriter::new(&mut out);
        let mut add = |name: &str, bytes: &[u8]| {
            archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
        };
        let codes = vec![0; 256];
        let meta = serde_json::json!({
            "version": 2, "count": 1, "list": vec![0; list],
            "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_l.webp"]},
            "scales": {"codebook": codes, "files": ["means_l.webp"]}, "quats": {"files": ["means_l.webp"]},
            "sh0": {"codebook": codes, "files": ["means_l.webp"]},
        });
        add("meta.json", meta.to_string().as_bytes());
        let mut webp = Vec::new();
        let picture = &zeros[..4 * (side * side) as usize];
        image::codecs::webp::WebPEncoder::new_lossless(&mut webp)
            .encode(picture, side, side, image::ExtendedColorType::Rgba8)
            .unwrap();
        add("means_l.webp", &webp);
        archive.finish().unwrap();
        out.into_inner()
    };
    let bombs: [(&str, Vec<u8>, bool); 6] = [
        ("gzip.spz", gzipped(&[&spz(3, 1), &zeros[..]].concat()), true),
        ("many.spz", gzipped(&[&spz(3, 1 << 28), &zeros[..]].concat()), false),
        (
            "zstd.spz",
            [spz(4, 1), 32u32.to_le_bytes().to_vec(), vec![0; 12], table, frame].concat(),
            false,
        ),
        ("webp.sog", sog(8000, 0), false),
        ("meta.sog", sog(1, 1 << 24), false),
        ("a.ply.gz", gzipped(&[ply.as_bytes(), &zeros[..]].concat()), false),
    ];
    for (name, bytes, is_read) in bombs {
        let file = folder.path().join(name);
        std::fs::write(&file, &bytes).unwrap();
        let began = std::time::Instant::now();
        let (peak, output) = info_of(&file);
        let text = stderr(&output);
        let took = peak.saturating_sub(base);
        assert_eq!(output.status.success(), is_read, "{name}: {text}");
        assert!(is_read || text.starts_with("error: ") && text.contains(name), "{name}: {text}");
        eprintln!(
            "{name:8} {:>10} B, memory {took:>10} B, {:?}: {text}",
            bytes.len(),
            began.elapsed()
        );
        // The window of zstd is 8 MiB.
        let most = 4 * bytes.len() as u64 + (12 << 20);
        assert!(took < most, "{name}: {took} bytes for {}", bytes.len());
        assert!(began.elapsed() < Duration::from_secs(5), "{name}: {:?}", began.elapsed());
    }
}

/// A checkpoint with a good head and a damaged body.
#[test]
fn a_damaged_checkpoint_is_refused_before_it_takes_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.checkpoint");
    let body = 1u64 << 30;
    let refused = |format: &str| {
        let head = serde_json::json!({ "__metadata__": { "trisplat": format, "run": "{}", "xxh3": "0" },
            "a": { "dtype": "U8", "shape": [body], "data_offsets": [0, body] } });
        let head = head.to_string();
        std::fs::write(&path, [&(head.len() as u64).to_le_bytes()[..], head.as_bytes()].concat())
            .unwrap();
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(8 + head.len() as u64 + body).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let (peak, output) = peak_of(
            command
                .arg("train")
                .arg(super::train::dataset())
                .args(["-o", "a.ply", "--resume"])
                .arg(&path),
        );
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert!(peak < 256 << 20, "{peak} bytes");
        stderr(&output)
    };
    let other = refused("0");
    let (_, ours) = other.split_once("this one reads format ").unwrap_or_else(|| panic!("{other}"));
    let ours: String = ours.chars().take_while(char::is_ascii_digit).collect();
    let damaged = refused(&ours);
    assert!(damaged.contains("a.checkpoint: checksum: does not fit"), "{damaged}");
}

/// An OBJ whose materials share a picture.
#[test]
fn a_picture_of_many_materials_takes_memory_once() {
    let folder = tempfile::tempdir().unwrap();
    let base = base(folder.path());
    let side = 2000;
    image::GrayImage::new(side, side).save(folder.path().join("a.png")).unwrap();
    let mut texts = [
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n".to_owned(),
        String::new(),
    ];
    for i in 0..40 {
        texts[0] += &format!("usemtl m{i}\nf 1/1 2/2 3/3\n");
        texts[1] += &format!("newmtl m{i}\nmap_Kd a.png\n");
    }
    std::fs::write(folder.path().join("a.obj"), &texts[0]).unwrap();
    std::fs::write(folder.path().join("a.mtl"), &texts[1]).unwrap();
    let (peak, output) = info_of(&folder.path().join("a.obj"));
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(peak - base < 20 * u64::from(side * side), "{} bytes", peak - base);
}
