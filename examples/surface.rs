//! Photos with poses become one connected surface with a texture: `cargo run --release --example
//! surface [PHOTOS] [OUT.glb] [SECONDS]`, trained for SECONDS of CPU time.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use trisplat::{Dataset, DatasetOptions, MeshJob, MeshOptions, Seconds, TextureWhen};

fn main() -> trisplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let photos = arguments.next().unwrap_or("samples/dataset".into());
    let out = arguments.next().unwrap_or("surface.glb".into());
    let seconds = arguments.next().map(|word| word.parse().expect("SECONDS: a number"));

    let mut options = MeshOptions::default();
    options.surface.max_triangles = Some(2000);
    options.texture.texture = TextureWhen::On;
    let photos = Dataset::load(photos, &DatasetOptions::default())?;
    let mut job = MeshJob::new(None, Some(photos), options);
    job.budget = seconds.map(Seconds).or(job.budget);
    let surface = job.save(&out)?;
    println!("{out}: {} triangles", surface.mesh.face_count());
    Ok(())
}
