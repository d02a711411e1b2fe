//! Draws a trained scene from a camera stored in its file: soft, as it was trained, and solid, as an engine draws the
//! baked file. `cargo run --release --example draw [SCENE.ply]`.

use trisplat::{Draw, Error};

fn main() -> trisplat::Result<()> {
    let file = std::env::args().nth(1).unwrap_or("samples/soups/trained.ply".into());
    let scene = trisplat::read(&file)?;
    let Some(camera) = scene.cameras.first() else {
        return Err(Error::invalid("scene", file, "a scene that trisplat trained, which knows its cameras"));
    };
    trisplat::draw(&scene, camera, Draw::Soft)?.save_png("soft.png")?;
    trisplat::draw(&scene, camera, Draw::Solid { samples: 4 })?.save_png("solid.png")
}
