//! Draws a trained soup from the cameras stored in its file: soft, as it was trained, and solid, as an engine draws
//! the baked file.
//!
//! ```text
//! cargo run --release --example render_views -- samples/soups/trained.ply views
//! ```

use glam::DVec3;
use std::path::PathBuf;
use trisplat_eval::render::baked_scene::BakedScene;
use trisplat_eval::render::scene_renderer::SceneRenderer;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_scene::asset::Placement;
use trisplat_scene::placed;
use trisplat_scene::scene::Scene;

/// Every so many cameras of the file are drawn.
const EVERY: usize = 10;
const BACKGROUND: [f32; 3] = [0.0; 3];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(file), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: render_views SOUP.ply FOLDER".into());
    };
    std::fs::create_dir_all(&folder)?;
    let loaded = formats::read(&file, &ReadOptions::with_degree(3))?;
    let cameras: Vec<_> = loaded.cameras.iter().copied().step_by(EVERY).collect();
    let Scene::Soup(soup) = loaded.scene.clone() else { return Err("a mesh has no cameras".into()) };

    // The cameras are in the file's own frame, as is the soup; the baked mesh is placed Y up.
    let mut soft = SceneRenderer::soft(soup, &Placement::IDENTITY, None, BACKGROUND);
    let baked = BakedScene::new(loaded)?;
    let samples = 4;
    let mut solid = SceneRenderer::solid(baked.asset.mesh, &Placement::IDENTITY, None, BACKGROUND, samples);
    for (i, camera) in cameras.iter().enumerate() {
        soft.color(camera).save_png(&folder.join(format!("{i:03}_soft.png")))?;
        let placed = placed::to_file(camera, &baked.bake_placement, DVec3::ZERO);
        solid.color(&placed).save_png(&folder.join(format!("{i:03}_solid.png")))?;
    }
    Ok(())
}
