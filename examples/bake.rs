//! A trained scene becomes a file for an engine: `cargo run --release --example bake [SCENE]
//! [OUT.glb]`.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use trisplat::BakeOptions;

fn main() -> trisplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let scene = trisplat::read(arguments.next().unwrap_or("samples/soups/trained.ply".into()))?;
    let baked = trisplat::bake(scene, &BakeOptions::small())?;
    let written = baked.write(arguments.next().unwrap_or("scene.glb".into()))?;
    for file in written.files {
        println!(
            "{}: {} triangles, {} bytes",
            file.path,
            baked.asset.mesh.face_count(),
            file.bytes
        );
    }
    Ok(())
}
