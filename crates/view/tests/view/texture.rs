//! Textured triangles on the card, against the solid rasteriser on the CPU.

use super::card::card;
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::sync::Arc;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, Chunk, FaceTexture, Texture,
    camera::Camera,
    image::RgbImage,
    math::metric,
    mesh::{Colors, Mesh},
};
use trisplat_view::FrameParams;

const ACROSS: u32 = 6;

/// Rings and stripes of one hue.
fn page(hue: f32, size: UVec2) -> Arc<Texture> {
    let texel = |i: u32| {
        let at = UVec2::new(i % size.x, i / size.x).as_vec2() / size.as_vec2();
        let ring = 0.5 + 0.4 * (at.distance(Vec2::splat(0.4)) * 30.0).sin();
        let stripe = 0.5 + 0.4 * (at.x * 25.0 + 3.0 * hue).cos();
        [ring, stripe, hue].map(|c| (255.0 * c) as u8)
    };
    let rgb = (0..size.element_product()).map(texel).collect();
    Arc::new(Texture::new(RgbImage { size, rgb, alpha: None }))
}

/// A bent wall whose squares are on one of two pages, in turn.
fn wall() -> Mesh {
    let at = |x: u32, y: u32| {
        let u = 2.0 * x as f32 / ACROSS as f32 - 1.0;
        let v = 2.0 * y as f32 / ACROSS as f32 - 1.0;
        Vec3::new(u, v, 0.4 * u * u)
    };
    let mut positions = Vec::new();
    let mut uvs = Vec::new();
    let mut page_of = Vec::new();
    for (y, x) in (0..ACROSS).flat_map(|y| (0..ACROSS).map(move |x| (y, x))) {
        let place = |x: u32, y: u32| Vec2::new(x as f32, y as f32) / ACROSS as f32;
        for corners in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
            positions.extend(corners.map(|(dx, dy)| at(x + dx, y + dy)));
            uvs.push(corners.map(|(dx, dy)| place(x + dx, y + dy)));
            page_of.push(((x + y) % 2) as u16);
        }
    }
    let pages = vec![page(0.2, UVec2::new(256, 256)), page(0.8, UVec2::new(300, 130))];
    let mut mesh =
        Mesh { positions, texture: Some(FaceTexture { uvs, pages, page_of }), ..Mesh::default() };
    mesh.colors = Colors::Face(vec![[0.2; 3]; 2 * (ACROSS * ACROSS) as usize]);
    mesh
}

fn camera(distance: f32) -> Camera {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(220.0),
        center: Vec2::new(120.0, 90.0),
        size: UVec2::new(240, 180),
    };
    lens.with_look_at(Vec3::new(0.5, -0.4, -2.4) * distance, Vec3::ZERO, Vec3::NEG_Y)
}

fn asset(mesh: Mesh, chunks: u32) -> Asset {
    let count = mesh.face_count() as u32 / chunks;
    let chunks = (0..chunks).map(|i| Chunk { first: i * count, count }).collect();
    Asset { mesh, chunks, ..Asset::default() }
}

#[test]
fn textures_are_drawn_as_render_draws_them() {
    let Some(mut card) = card() else { return };
    let whole = asset(wall(), 4);
    let mut wall = wall();
    let model = card.upload(&whole).unwrap();
    // The card has one picture of all pages.
    wall.texture = wall.texture.map(|texture| texture.joined());
    let texels: usize = wall
        .texture
        .iter()
        .flat_map(|texture| &texture.pages)
        .map(|page| {
            (0..)
                .map(|level| page.level(level).rgb.len())
                .take_while(|texels| *texels > 1)
                .sum::<usize>()
                + 1
        })
        .sum();
    assert_eq!(model.bytes, (60 * wall.face_count() + 4 * texels) as u64);
    // Close, as photos are, and far away, where levels are mixed.
    for distance in [0.6, 1.0, 3.0, 8.0] {
        let camera = camera(distance);
        let (got, _) = card.render(&model, &FrameParams::new(&camera)).unwrap();
        let cpu = SolidRasterOptions { samples: 1, near: 0.01, ..SolidRasterOptions::default() };
        let wants = SolidRasterizer::new().render(&wall, &camera, &cpu);
        let psnr = metric::psnr(&got.rgb, &wants.rgb, None);
        assert!(psnr > 50.0, "{distance}: {psnr} dB");
        let mut flat = wall.clone();
        flat.texture = None;
        let flat = SolidRasterizer::new().render(&flat, &camera, &cpu);
        assert!(
            metric::psnr(&got.rgb, &flat.rgb, None) < psnr - 20.0,
            "it is not the colours that are drawn"
        );
    }
}

#[test]
fn corners_at_one_vertex_have_their_own_places_on_the_picture() {
    let Some(mut card) = card() else { return };
    let whole = asset(wall(), 4);
    let wall = wall();
    let model = card.upload(&whole).unwrap();
    let mut indexed = wall.clone();
    indexed.indices = (0..indexed.positions.len() as u32).collect();
    indexed.colors = Colors::Vertex(vec![[0.2; 3]; indexed.positions.len()]);
    let indexed = card.upload(&asset(indexed, 1)).unwrap();
    let params = FrameParams::new(&camera(1.0));
    assert!(card.render(&indexed, &params).unwrap().0 == card.render(&model, &params).unwrap().0);
}
