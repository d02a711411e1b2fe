//! The files that the file of a scene names: buffers and pictures of a glTF, materials of an OBJ and their
//! pictures, cameras beside Gaussians.

use super::content::holds_splats;
use crate::Format;
use crate::gltf;
use crate::source::{Source, is_packed};
use crate::{obj, splats};
use std::path::{Path, PathBuf};
use trisplat_scene::Limits;

/// The files that the scene at `path` names, whether they exist or not. A file that cannot be read names none: its
/// reader reports the fault.
pub fn named_files(path: &Path, limits: &Limits) -> Vec<PathBuf> {
    let mut files = Vec::from_iter(splats::cameras::beside(path).filter(|_| holds_splats(path, limits)));
    // These hold everything themselves; a compressed one would be unpacked to be recognised.
    let alone = |path: &Path| {
        matches!(Format::by_extension(path), Some(Format::Ply | Format::Pt | Format::Off | Format::Html))
    };
    if path.as_os_str() == "-" || is_packed(path) && alone(&path.with_extension("")) {
        return files;
    }
    let named = Source::open(path, limits).and_then(|mut source| {
        let head = source.head()?;
        match Format::detect(&head, &source.named()) {
            Some(Format::Glb | Format::Gltf) => gltf::named_files(&mut source, limits),
            Some(Format::Obj) => obj::named_files(&source, limits),
            _ => Ok(Vec::new()),
        }
    });
    files.extend(named.unwrap_or_default());
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes `text` as the file `name` and returns the names of the files that it names.
    fn named(name: &str, text: &[u8], beside: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        beside.iter().for_each(|(name, text)| std::fs::write(folder.path().join(name), text).unwrap());
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let files = named_files(&path, &Limits::DEFAULT);
        files.iter().map(|file| file.strip_prefix(&folder).unwrap().display().to_string()).collect()
    }

    #[test]
    fn gaussians_name_the_cameras_beside_them() {
        let splat = [[0u8; 12], [1; 12], [200; 12]].concat()[..32].to_vec();
        let cameras = ("cameras.json", "[]");
        assert_eq!(named("a.splat", &splat, &[cameras]), ["cameras.json"]);
        assert_eq!(named("a.splat", &splat, &[]), [""; 0]);
        assert_eq!(named("a.off", b"OFF", &[cameras]), [""; 0]);
    }

    #[test]
    fn a_gltf_names_its_buffers_and_pictures() {
        let json = br#"{"asset": {"version": "2.0"},
            "buffers": [{"byteLength": 4, "uri": "my%20data.bin"}, {"byteLength": 1, "uri": "data:;base64,AA=="}, {}],
            "images": [{"uri": "a/wall.png"}, {"bufferView": 0}, {"uri": "https://example.org/b.png"}]}"#;
        assert_eq!(named("a.gltf", json, &[]), ["my data.bin", "a/wall.png"]);
        assert_eq!(named("a.txt", &[b"\xef\xbb\xbf", &json[..]].concat(), &[]).len(), 2);
        assert_eq!(named("a.gltf", &json[..90], &[]), [""; 0]);
    }

    #[test]
    fn an_obj_names_its_materials_and_their_pictures() {
        let mtl = "newmtl a\nmap_Kd -clamp on a wall.jpg\nmap_Bump -bm 0.5 bump.png\nnewmtl b\nbump b.png\nKd 1 0 0\n";
        let obj = b"v 0 0 0\nf 1 1 1\nmtllib my scene.mtl\n  mtllib missing.mtl\n";
        let wants = ["my scene.mtl", "a wall.jpg", "bump.png", "b.png", "missing.mtl"];
        assert_eq!(named("a.obj", obj, &[("my scene.mtl", mtl)]), wants);
        assert_eq!(named("a.ply", b"ply\nformat ascii 1.0\n", &[]), [""; 0]);
    }
}
