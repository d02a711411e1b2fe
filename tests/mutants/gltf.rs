//! Mutants of GLB files: what is read is baked to a file that breaks no rule of the format, or
//! refused.

use std::path::Path;
use trisplat_bake::{BakeOptions, BakePreset, Lit, LitOptions};
use trisplat_fixtures::edits::mutate;
use trisplat_formats::{
    self as formats, OutputOptions, OutputTarget, ReadOptions,
    check::{Severity, check},
};
use trisplat_scene::Asset;
use trisplat_synthetic::soups;

/// How a mutant is baked and written.
fn bakes() -> [(BakeOptions, OutputOptions); 3] {
    let fast = BakeOptions::preset(BakePreset::Fast);
    let lit = BakeOptions { lit: LitOptions { lit: Lit::Flat }, ..fast.clone() };
    let small =
        OutputOptions { target: OutputTarget::Web, compress: true, ..OutputOptions::default() };
    [(fast.clone(), OutputOptions::default()), (lit, OutputOptions::default()), (fast, small)]
}

fn written(asset: &Asset, path: &Path, options: &OutputOptions) -> trisplat::Result<()> {
    formats::write(asset, path, options).map(drop)
}

/// JSON and buffer of a GLB.
fn parts(glb: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let length =
        |at: usize| u32::from_le_bytes([glb[at], glb[at + 1], glb[at + 2], glb[at + 3]]) as usize;
    let json = length(12);
    (glb[20..20 + json].to_vec(), glb[28 + json..].to_vec())
}

/// A GLB whose lengths fit, whatever is in it: readers look behind those.
fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let json = padded(json, b' ');
    let bin = padded(bin, 0);
    let all = (28 + json.len() + bin.len()) as u32;
    let chunk = |bytes: &[u8], name: &[u8; 4]| {
        [&(bytes.len() as u32).to_le_bytes()[..], name, bytes].concat()
    };
    let head = [&b"glTF"[..], &2u32.to_le_bytes(), &all.to_le_bytes()].concat();
    [head, chunk(&json, b"JSON"), chunk(&bin, b"BIN\0")].concat()
}

#[test]
fn a_viewpoint_that_no_camera_has_is_chosen_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let fast = BakeOptions::preset(BakePreset::Fast);
    let asset = trisplat::bake(soups::studio(16, 1), &fast).unwrap().asset;
    written(&asset, &path, &OutputOptions::default()).unwrap();
    let (json, bin) = parts(&std::fs::read(&path).unwrap());
    for (key, value) in [
        ("eye", "[1e39,0,0]"),
        ("eye", "[1e308,0,0]"),
        ("fov", "0"),
        ("fov", "-5"),
        ("fov", "1e308"),
        ("fov", "1e-300"),
    ] {
        let mut document: serde_json::Value = serde_json::from_slice(&json).unwrap();
        document["asset"]["extras"]["viewpoint"][key] = serde_json::from_str(value).unwrap();
        std::fs::write(&path, glb(document.to_string().as_bytes(), &bin)).unwrap();
        let loaded = formats::read(&path, &ReadOptions::default()).unwrap();
        let again = trisplat::bake(loaded, &fast).unwrap().asset;
        let chosen = again.provenance.viewpoint;
        let first = asset.provenance.viewpoint;
        assert!(
            chosen.is_some() && chosen.map(|v| v.fov) == first.map(|v| v.fov),
            "{key} {value}: {chosen:?}"
        );
        written(&again, &path, &OutputOptions::default()).unwrap();
        let found = check(&path, &ReadOptions::default()).unwrap();
        assert_eq!(found.count(Severity::Error), 0, "{key} {value}: {:?}", found.findings);
    }
}

#[test]
fn mutants_of_a_glb_are_baked_to_valid_files_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mutant = folder.path().join("mutant.glb");
    let out = folder.path().join("out.glb");
    let soup = soups::studio(16, 1);
    for (i, (bake, output)) in bakes().iter().enumerate() {
        let asset = trisplat::bake(soup.clone(), bake).unwrap().asset;
        written(&asset, &mutant, output).unwrap();
        let (json, bin) = parts(&std::fs::read(&mutant).unwrap());
        let survive = |bytes: Vec<u8>| {
            std::fs::write(&mutant, bytes).unwrap();
            let Ok(loaded) = formats::read(&mutant, &ReadOptions::default()) else { return };
            for (bake, output) in bakes() {
                let baked = trisplat::bake(loaded.clone(), &bake);
                let Ok(()) = baked.and_then(|baked| written(&baked.asset, &out, &output)) else {
                    continue;
                };
                let found = check(&out, &ReadOptions::default()).unwrap();
                let errors =
                    found.findings.iter().filter(|finding| finding.severity == Severity::Error);
                assert_eq!(errors.count(), 0, "{:?}", found.findings);
            }
        };
        mutate(&format!("json of {i}"), &json, 200, |json| survive(glb(json, &bin)));
        mutate(&format!("buffer of {i}"), &bin, 100, |bin| survive(glb(&json, bin)));
    }
}
