//! Tiles: what each shows, and that together they show everything once.

use glam::Vec3;
use trisplat_bake::{Bake, BakeOptions, BakePreset, TilesDetails, TilesOptions};
use trisplat_fixtures::shapes::loose;
use trisplat_scene::{
    Asset, Tile,
    mesh::{Colors, Mesh},
    report::Report,
};

/// A ground of `side` by `side` squares, two triangles each.
fn ground(side: u32) -> Mesh {
    let at = |x: u32, y: u32| Vec3::new(x as f32, 0.0, y as f32);
    let square = |i: u32| {
        let x = i % side;
        let y = i / side;
        [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)]
    };
    let positions = loose((0..side * side).flat_map(square).collect());
    let colors =
        (0..positions.len() / 3).map(|i| [i as f32 / positions.len() as f32, 0.5, 0.2]).collect();
    Mesh { positions, colors: Colors::Face(colors), ..Mesh::default() }
}

fn cut(mesh: Mesh, preset: BakePreset, tile_triangles: u32) -> (Asset, Report) {
    let mut options = BakeOptions::preset(preset);
    options.tiles = TilesOptions { tiles: true, tile_triangles };
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([mesh]).unwrap();
    (asset, report)
}

fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let corners = (0..mesh.face_count()).flat_map(|face| mesh.corners(face));
    corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

/// Corners and colours of all faces, sorted.
fn sorted(meshes: &[&Mesh]) -> Vec<[u32; 18]> {
    let face = |mesh: &Mesh, f: usize| {
        let corners = mesh.corners(f).map(|v| v.to_array());
        let bits = [corners, mesh.corner_colors(f)].concat().concat();
        std::array::from_fn(|i| bits[i].to_bits())
    };
    let mut faces: Vec<[u32; 18]> =
        meshes.iter().flat_map(|mesh| (0..mesh.face_count()).map(|f| face(mesh, f))).collect();
    faces.sort_unstable();
    faces
}

fn leaves<'a>(tile: &'a Tile, out: &mut Vec<&'a Mesh>) {
    if tile.children.is_empty() {
        out.push(&tile.mesh);
    }
    tile.children.iter().for_each(|child| leaves(child, out));
}

#[test]
fn the_finest_tiles_are_the_scene() {
    for preset in [BakePreset::Fast, BakePreset::Default] {
        let (asset, report) = cut(ground(90), preset, 1500);
        let root = asset.tiles.as_deref().unwrap();
        let mut finest = Vec::new();
        leaves(root, &mut finest);
        assert_eq!(finest.len(), 16);
        assert_eq!(sorted(&finest), sorted(&[&asset.mesh]));
        assert!(finest.iter().all(|mesh| mesh.validate().is_ok() && mesh.face_count() <= 1500));
        assert!(asset.levels.is_empty());
        let details = report.details::<TilesDetails>().unwrap();
        assert_eq!((details.levels, details.tiles), (3, 1 + 4 + 16));
    }
}

#[test]
fn coarser_tiles_hold_as_many_triangles_of_a_larger_piece() {
    let (asset, _) = cut(ground(90), BakePreset::Fast, 1500);
    let root = asset.tiles.as_deref().unwrap();
    let mut below = |tile: &Tile| {
        let (low, high) = bounds(&tile.mesh);
        let mut errors = Vec::new();
        for child in &tile.children {
            errors.push(child.error);
            // A tile may reach out of its parent by the size of a triangle that grew.
            let (inner_low, inner_high) = bounds(&child.mesh);
            assert!(inner_low.cmpge(low - 4.0).all() && inner_high.cmple(high + 4.0).all());
            assert!((inner_high - inner_low).length() < 0.8 * (high - low).length());
        }
        assert!(errors.iter().all(|error| *error < tile.error), "{errors:?} below {}", tile.error);
        assert!(tile.children.is_empty() || (600..=1500).contains(&tile.mesh.face_count()));
    };
    below(root);
    root.children.iter().for_each(&mut below);
}

#[test]
fn a_small_scene_is_one_tile() {
    let (asset, report) = cut(ground(10), BakePreset::Default, 1500);
    let root = asset.tiles.as_deref().unwrap();
    assert!(root.children.is_empty() && root.error == 0.0);
    assert_eq!(sorted(&[&root.mesh]), sorted(&[&asset.mesh]));
    assert_eq!(report.details::<TilesDetails>().unwrap().tiles, 1);
}

#[test]
fn a_backdrop_is_in_no_tile() {
    let sample = trisplat_fixtures::sample("soups/trained.ply");
    let options = BakeOptions {
        tiles: TilesOptions { tiles: true, tile_triangles: 1000 },
        ..BakeOptions::preset(BakePreset::Default)
    };
    let input = trisplat_formats::read(&sample, &Default::default()).unwrap();
    let asset = Bake::new(&options).run([input]).unwrap();
    assert!(asset.provenance.backdrop_faces > 0);
    let root = asset.tiles.as_deref().unwrap();
    let mut finest = Vec::new();
    leaves(root, &mut finest);
    assert_eq!(finest.iter().map(|mesh| mesh.face_count()).sum::<usize>(), asset.scene_faces());
    assert_eq!(root.mesh.face_count(), asset.scene_faces() / 16);
}

#[test]
fn tiles_do_not_depend_on_the_number_of_threads() {
    let cut = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cut(ground(60), BakePreset::Default, 1000).0.tiles)
    };
    assert!(cut(1) == cut(3));
}

#[test]
fn options_out_of_range_are_refused() {
    let mut options = BakeOptions::default();
    options.tiles.tile_triangles = 999;
    assert!(options.validate().unwrap_err().to_string().contains("1000"));
    options.tiles = TilesOptions { tiles: true, ..TilesOptions::DEFAULT };
    options.lod.lod = vec![0.5];
    assert!(options.validate().unwrap_err().to_string().contains("tiles"));
}
