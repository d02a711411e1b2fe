//! Draws a trained scene from a camera stored in its file: soft, as it was trained, and solid, as
//! an engine draws the baked file. `cargo run --release --example draw [SCENE.ply]`.

use trisplat::{Error, Renderer};

fn main() -> trisplat::Result<()> {
    let file = std::env::args().nth(1).unwrap_or("samples/soups/trained.ply".into());
    let scene = trisplat::read(&file)?;
    let cameras = scene.cameras();
    let Some(camera) = cameras.first() else {
        return Err(Error::invalid(
            "scene",
            file,
            "a scene that trisplat trained, which knows its cameras",
        ));
    };
    Renderer::soft(&scene)?.draw(camera)?.save_png("soft.png")?;
    Renderer::new(&scene)?.draw(camera)?.save_png("solid.png")
}
