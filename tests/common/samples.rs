//! Samples on the disk, as `trisplat-bench sample` writes them.

use std::path::Path;
use trisplat_formats::ply;
use trisplat_synthetic::SyntheticOptions;

/// A soup of the studio.
pub(crate) fn studio(path: impl AsRef<Path>, triangles: usize) {
    let soup = trisplat_bench::scenes::studio(triangles, 1);
    let mut bytes = Vec::new();
    let recipe = trisplat_bench::scenes::studio_recipe(triangles, 1);
    ply::write_soup(&mut bytes, &soup, &trisplat_bench::scenes::provenance(&recipe), &[]).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Posed photos: their number and width, the points of the cloud, the seed.
pub(crate) fn photos(folder: impl AsRef<Path>, [views, width, points]: [u32; 3], seed: u64) {
    let options = SyntheticOptions { views, width, points, seed, ..SyntheticOptions::default() };
    trisplat_synthetic::write(folder.as_ref(), &options).unwrap();
}
