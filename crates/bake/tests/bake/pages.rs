//! Textures of several pages, and the parts of a texture that tiles, levels and crops have.

use super::texture::{DRAWING, ON, baked, cameras, grey, painted, photos, psnr, read, textured};
use glam::Vec3;
use std::path::Path;
use trisplat_bake::{Bake, BakeOptions, BakePreset, TextureOptions, TextureWhen, UpChoice, merge};
use trisplat_formats::{
    self as formats, OutputOptions, ReadOptions,
    gltf::{GltfOptions, TextureFormat, to_glb_bytes},
};
use trisplat_raster::solid::SolidRasterizer;
use trisplat_scene::{
    Asset, Chunk, ImportedScene, Scene, UpAxis, UpDirection, math::metric, mesh::Mesh,
};

const EXACT: OutputOptions =
    OutputOptions { texture_format: TextureFormat::Png, ..OutputOptions::DEFAULT };

fn pages(mesh: &Mesh) -> usize {
    mesh.texture.as_ref().map_or(0, |texture| texture.pages.len())
}

fn mesh_of(loaded: ImportedScene) -> Mesh {
    match loaded.scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("a mesh"),
    }
}

/// A wall whose quarters are on one page and another in turn, as merged scenes may be.
fn on_two_pages() -> Mesh {
    let [first, second] = [(); 2].map(|()| {
        let mut wall = grey(16);
        textured(&mut wall, &TextureOptions { texture_size: 128, ..ON }).0.unwrap();
        wall
    });
    let mut all = Mesh::default();
    let quarter = first.face_count() as u32 / 4;
    for (i, wall) in (0..).zip([&first, &second, &first, &second]) {
        all.append(wall.part(&(i * quarter..(i + 1) * quarter).collect::<Vec<_>>())).unwrap();
    }
    all
}

#[test]
fn pages_are_primitives_in_files_and_come_back() {
    let mesh = on_two_pages();
    let wants = psnr(&mesh);
    let options = GltfOptions { texture: TextureFormat::Png, ..GltfOptions::default() };
    let back = mesh_of(read(&to_glb_bytes(&Asset::from(mesh.clone()), &options).unwrap()));
    assert_eq!((pages(&mesh), pages(&back)), (2, 2));
    assert_eq!(back.face_count(), mesh.face_count());
    assert!((psnr(&back) - wants).abs() < 0.1, "{} {wants}", psnr(&back));
    // A bake cuts chunks by page.
    let bake = BakeOptions::preset(BakePreset::Fast);
    let asset = Bake::new(&bake).run([ImportedScene::from(Scene::Mesh(back))]).unwrap();
    let texture = asset.mesh.texture.as_ref().unwrap();
    assert_eq!(asset.chunks.len(), texture.pages.len());
    for chunk in &asset.chunks {
        let of_chunk = chunk.first as usize..(chunk.first + chunk.count) as usize;
        assert!(of_chunk.clone().all(|face| texture.page(face) == texture.page(of_chunk.start)));
    }
    // An OBJ names one picture.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.obj");
    formats::write(&Asset::from(mesh), &path, &EXACT).unwrap();
    let back = mesh_of(formats::read(&path, &ReadOptions::default()).unwrap());
    assert!(pages(&back) == 1 && (psnr(&back) - wants).abs() < 0.1, "{} {wants}", psnr(&back));
}

/// The options of a bake that leaves the wall where the cameras see it.
fn upright() -> BakeOptions {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.place.up = UpChoice::Given(UpDirection::Axis(UpAxis::Y));
    options
}

/// The tiles of a tileset's folder, the largest first.
fn tiles(folder: &Path) -> Vec<Mesh> {
    let mut found: Vec<Mesh> = std::fs::read_dir(folder.join("wall.tiles"))
        .unwrap()
        .map(|entry| {
            mesh_of(formats::read(&entry.unwrap().path(), &ReadOptions::default()).unwrap())
        })
        .collect();
    found.sort_by_key(|mesh| std::cmp::Reverse(mesh.face_count()));
    found
}

#[test]
fn tiles_have_pages_of_their_own() {
    let write = |views: bool, input: Mesh| {
        let mut options = BakeOptions { output: EXACT, ..upright() };
        options.tiles.tile_triangles = 1000;
        options.texture.texture = if views { TextureWhen::On } else { TextureWhen::Off };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wall.tileset.json");
        options.plan_output(&path, None).unwrap();
        let mut views = views.then(|| trisplat_bake::Views::drawn(cameras(), photos()));
        let bake = Bake::new(&options);
        let bake = match &mut views {
            Some(views) => bake.photos(views),
            None => bake,
        };
        let asset = bake.run([ImportedScene::from(Scene::Mesh(input))]).unwrap();
        formats::write(&asset, &path, &options.output).unwrap();
        (asset, tiles(folder.path()))
    };
    let texels = |mesh: &Mesh| mesh.texture.as_ref().unwrap().pages[0].size().element_product();
    // From photos, and of an input that has a texture already.
    let (asset, of_photos) = write(true, grey(40));
    let (_, of_input) = write(false, asset.mesh.clone());
    for tiles in [of_photos, of_input] {
        let finest: Vec<&Mesh> = tiles.iter().filter(|tile| tile.face_count() > 600).collect();
        assert!(finest.len() >= 4 && tiles.iter().all(|tile| pages(tile) == 1), "{}", finest.len());
        let mut whole = Mesh::default();
        for tile in finest.iter().filter(|tile| texels(tile) > 0) {
            assert!(
                texels(tile) < texels(&asset.mesh) / 2,
                "{} {}",
                texels(tile),
                texels(&asset.mesh)
            );
            whole.append((*tile).clone()).unwrap();
        }
        assert!(whole.texture.is_some());
    }
}

#[test]
fn levels_and_crops_of_a_textured_input_keep_its_texels() {
    let input = baked(grey(8)).mesh;
    let mut options = upright();
    options.lod.lod = vec![0.25];
    let bake = |options: &BakeOptions| {
        Bake::new(options).run([ImportedScene::from(Scene::Mesh(input.clone()))]).unwrap()
    };
    let texels = |mesh: &Mesh| mesh.texture.as_ref().unwrap().pages[0].size().element_product();
    let asset = bake(&options);
    let level = &asset.levels[0].mesh;
    assert!(asset.mesh.texture.is_some() && level.texture.is_some());
    assert!(texels(level) < texels(&input) / 2, "{} {}", texels(level), texels(&input));
    let mut options = upright();
    options.crop.crop = vec!["-1,-1,-9,0,0,9".parse().unwrap()];
    let part = bake(&options).mesh;
    // About a quarter of the wall, which was placed since it was cut.
    assert!((24..=40).contains(&part.face_count()), "{}", part.face_count());
    assert!(texels(&part) < texels(&input), "{} {}", texels(&part), texels(&input));
}

#[test]
fn a_textured_scene_and_a_coloured_one_keep_both() {
    let mut textured_wall = grey(4);
    textured(&mut textured_wall, &ON).0.unwrap();
    let moved = |mesh: &Mesh, by: f32| {
        let mut mesh = mesh.clone();
        mesh.positions.iter_mut().for_each(|p| p.x += by);
        mesh
    };
    // One with a colour per triangle, one with colours that run from corner to corner, one with
    // indices.
    let flat = moved(&painted(), 5.0);
    let mut smooth = moved(&painted(), 10.0);
    smooth.vertex_colors().iter_mut().enumerate().for_each(|(i, color)| color[i % 3] *= 0.5);
    let mut shared = moved(&smooth, 5.0);
    shared.indices = (0..shared.positions.len() as u32).collect();
    let parts = [textured_wall, flat, smooth, shared];
    let merged =
        merge(parts.iter().map(|part| ImportedScene::from(Scene::Mesh(part.clone()))).collect())
            .unwrap();
    assert_eq!(merged.warnings.len(), 3, "{:?}", merged.warnings);
    let merged = mesh_of(merged);
    merged.validate().unwrap();
    let options = GltfOptions { texture: TextureFormat::Png, ..GltfOptions::default() };
    let back = mesh_of(read(&to_glb_bytes(&Asset::from(merged.clone()), &options).unwrap()));
    assert_eq!((pages(&merged), pages(&back)), (4, 4));
    for (i, part) in parts.iter().enumerate() {
        let middle = Vec3::X * 5.0 * i as f32;
        let camera =
            cameras()[0].with_look_at(middle + Vec3::new(0.2, 0.1, -2.4), middle, Vec3::NEG_Y);
        let draw = |mesh: &Mesh| SolidRasterizer::new().render(mesh, &camera, &DRAWING).rgb;
        for all in [&merged, &back] {
            let psnr = metric::psnr(&draw(all), &draw(part), None);
            assert!(psnr > 40.0, "part {i}: {psnr} dB");
        }
    }
    // Without a texture nothing changes.
    let plain = merge(vec![
        ImportedScene::from(Scene::Mesh(parts[1].clone())),
        ImportedScene::from(Scene::Mesh(parts[2].clone())),
    ]);
    assert!(mesh_of(plain.unwrap()).texture.is_none());
}

#[test]
fn a_backdrop_on_several_pages_has_nodes_of_different_names() {
    let mesh = on_two_pages();
    let faces = mesh.face_count();
    let mut asset = Asset::from(mesh);
    // The last half is the backdrop, on both pages.
    let half = Chunk { first: 0, count: faces as u32 / 2 };
    asset.chunks = vec![half, Chunk { first: half.count, ..half }];
    asset.provenance.backdrop_faces = half.count;
    let options = GltfOptions { texture: TextureFormat::Png, ..GltfOptions::default() };
    let glb = to_glb_bytes(&asset, &options).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let nodes = json["nodes"].as_array().unwrap().iter();
    let mut names: Vec<&str> = nodes.filter_map(|node| node["name"].as_str()).collect();
    assert!(names.contains(&"backdrop") && names.contains(&"backdrop_1"), "{names:?}");
    let all = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), all, "{names:?}");
    assert_eq!(read(&glb).provenance.backdrop_faces, half.count);
}
