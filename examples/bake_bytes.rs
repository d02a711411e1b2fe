//! A soup in memory becomes the bytes of a GLB: what a server or a plug-in needs, without a file.
//!
//! `cargo run --release --example bake_bytes` prints what the bake did.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use glam::Vec3;
use trisplat::{Bake, BakeOptions, BakePreset, Report, Result, Soup};
use trisplat_formats::gltf::{GltfOptions, to_glb_bytes};

fn main() -> Result<()> {
    let options = BakeOptions::preset(BakePreset::Small);
    let mut report = Report::new("bake_bytes");
    let asset = Bake::new(&options).report(&mut report).run([fan(64)])?;
    for stage in &report.stages {
        match &stage.unneeded {
            Some(why) => println!("{:<9} not needed: {why}", stage.name),
            None => println!(
                "{:<9} {} -> {} triangles",
                stage.name, stage.before.triangles, stage.after.triangles
            ),
        }
    }

    let glb = to_glb_bytes(&asset, &GltfOptions::default())?;
    println!("{} triangles in {} bytes of GLB", asset.mesh.face_count(), glb.len());
    Ok(())
}

/// A fan of `count` triangles around the z axis, from opaque to faint, in the colours of the rainbow.
fn fan(count: usize) -> Soup {
    let mut soup = Soup { sh_degree: 0, ..Soup::default() };
    for i in 0..count {
        let at = |i: usize| {
            let angle = std::f32::consts::TAU * i as f32 / count as f32;
            Vec3::new(angle.cos(), angle.sin(), 0.1 * angle)
        };
        soup.vertices.push([Vec3::ZERO, at(i), at(i + 1)]);
        soup.opacity.push(1.0 - i as f32 / count as f32);
        soup.sigma.push(0.01);
        let hue = i as f32 / count as f32;
        // rgb = 0.5 + 0.282 sh, sRGB-encoded
        soup.sh.push(
            [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|shift| 1.7 * (std::f32::consts::TAU * (hue - shift)).cos()),
        );
    }
    soup
}
