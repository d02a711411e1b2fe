//! A real scene in two formats, against each other and against what is known of it.

use super::files::{face, loaded_mesh, shared};
use trisplat_formats::{ReadOptions, off, ply};
use trisplat_scene::math::color::srgb_from_linear;

const OPTIONS: ReadOptions = ReadOptions::with_degree(0);

#[test]
fn ply_and_off_of_the_guitar_agree() {
    let (Some(from), Some(twin)) = (shared("guitar_tri.ply"), shared("guitar_tri.off")) else {
        return;
    };
    let (mesh, _, warnings) = loaded_mesh(ply::read(from, &OPTIONS));
    let (twin, _, twin_warnings) = loaded_mesh(off::read(twin, &OPTIONS));
    assert_eq!((mesh.face_count(), twin.face_count()), (75_057, 75_057));
    assert_eq!(warnings, [""; 0]);
    // The checkpoint of another training lies beside it, so the hint says `if`.
    let [hint] = &twin_warnings[..] else { panic!("{twin_warnings:?}") };
    assert!(hint.contains("if guitar_20k.pt beside it is of the same training"), "{hint}");
    assert_eq!((mesh.indices.len(), mesh.opacity.len(), twin.opacity.len()), (0, 75_057, 0));
    for i in 0..mesh.face_count() {
        let (a, colors, _) = face(&mesh, i);
        let (b, twin_colors, _) = face(&twin, i);
        for (a, b) in a.iter().zip(b) {
            assert!((*a - b).length() <= 1e-6 * b.length().max(1.0), "face {i}: {a} and {b}");
        }
        // The OFF was truncated to 8 bits, the PLY rounded.
        for (a, b) in colors.concat().into_iter().zip(twin_colors.concat()) {
            let codes = (255.0 * (srgb_from_linear(a) - srgb_from_linear(b))).abs();
            assert!(codes <= 1.001, "face {i}: {codes} codes apart");
        }
    }
}
