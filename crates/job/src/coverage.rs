//! Coverage: the pixels of a view whose surface training photos see. Elsewhere a scene can only guess.
//!
//! The surface at a pixel comes from the scene's depth there. A training photo sees it if it lies within the
//! photo and the scene, drawn from there, has nothing clearly in front of it.

use glam::{Vec2, Vec3};
use trisplat_dataset::View;
use trisplat_scene::camera::Camera;
use trisplat_scene::parallel;

/// Least training photos for a covered pixel: with fewer, its depth is a guess.
const LEAST_PHOTOS: u8 = 2;
/// A surface in front of a point hides it only if nearer by more than this share of the depth.
const DEPTH_TOLERANCE: f32 = 0.02;
/// A depth and a count.
const BYTES_PER_PIXEL: u64 = 5;

/// True for the pixels of each of `views` whose surface at least [`LEAST_PHOTOS`] of `training` see; a photo
/// does not count for itself. `[views][H * W]`
///
/// `depth` draws the scene for a camera: the depth z of its surface at every pixel, 0 where there is none.
/// `[H * W]` The depths of the views take at most `max_bytes`, or those of one view. If all take more, the
/// photos are drawn once per group of views.
pub(super) fn covered(
    views: &[&View],
    training: &[&View],
    max_bytes: u64,
    mut depth: impl FnMut(&Camera) -> Vec<f32>,
) -> Vec<Vec<bool>> {
    let mut all = Vec::with_capacity(views.len());
    while all.len() < views.len() {
        let left = &views[all.len()..];
        let group = &left[..fitting(left, max_bytes)];
        all.extend(covered_together(group, training, &mut depth));
    }
    all
}

/// How many of `views` fit together, at least one.
fn fitting(views: &[&View], max_bytes: u64) -> usize {
    let mut bytes = 0;
    let fits = |view: &&&View| {
        bytes += BYTES_PER_PIXEL * u64::from(view.camera.size.x) * u64::from(view.camera.size.y);
        bytes <= max_bytes
    };
    views.iter().take_while(fits).count().max(1)
}

fn covered_together(
    views: &[&View],
    training: &[&View],
    depth: &mut impl FnMut(&Camera) -> Vec<f32>,
) -> Vec<Vec<bool>> {
    let depths: Vec<Vec<f32>> = views.iter().map(|view| depth(&view.camera)).collect();
    let mut seen_by: Vec<Vec<u8>> = depths.iter().map(|depths| vec![0; depths.len()]).collect();
    for photo in training {
        let drawn = DepthPicture { camera: photo.camera, depths: depth(&photo.camera) };
        for ((view, depths), counts) in views.iter().zip(&depths).zip(&mut seen_by) {
            if view.name != photo.name {
                count(&drawn, &view.camera, depths, counts);
            }
        }
    }
    seen_by.iter().map(|counts| counts.iter().map(|count| *count >= LEAST_PHOTOS).collect()).collect()
}

/// Adds one to the pixels of `camera` whose surface `photo` sees, up to [`LEAST_PHOTOS`].
fn count(photo: &DepthPicture, camera: &Camera, depths: &[f32], counts: &mut [u8]) {
    let width = camera.size.x as usize;
    let to_world = camera.rotation.transpose();
    parallel::for_each(counts.chunks_mut(width).zip(depths.chunks(width)), |y, (counts, depths)| {
        for (x, (count, depth)) in counts.iter_mut().zip(depths).enumerate() {
            if *count < LEAST_PHOTOS && *depth > 0.0 {
                let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let seen = ((pixel - camera.center) / camera.focal * *depth).extend(*depth);
                *count += u8::from(photo.sees(to_world * (seen - camera.translation)));
            }
        }
    });
}

/// The depth picture of a training photo's camera.
struct DepthPicture {
    camera: Camera,
    /// Depth z at every pixel, 0 for empty ones. `[H * W]`
    depths: Vec<f32>,
}

impl DepthPicture {
    fn sees(&self, point: Vec3) -> bool {
        self.camera.shows(point).is_some_and(|(at, z)| {
            let depth = self.depths[at.y as usize * self.camera.size.x as usize + at.x as usize];
            depth <= 0.0 || z <= depth * (1.0 + DEPTH_TOLERANCE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3, Mat3, UVec2};
    use trisplat_dataset::{Photo, View};
    use trisplat_scene::image::RgbImage;
    use trisplat_synthetic::SyntheticOptions;
    use trisplat_synthetic::{Ray, trace, visible};

    fn view(name: &str, camera: Camera) -> View {
        let photo = Photo::drawn(RgbImage { size: camera.size, rgb: Vec::new(), alpha: None });
        View { name: name.to_owned(), camera, photo, test: false }
    }

    /// 100 px wide, 2 world units wide at depth 1.
    fn camera(position: Vec3) -> Camera {
        Camera {
            rotation: Mat3::IDENTITY,
            translation: -position,
            focal: Vec2::splat(50.0),
            center: Vec2::new(50.0, 5.0),
            size: UVec2::new(100, 10),
        }
    }

    fn share(covered: &[bool]) -> f64 {
        covered.iter().filter(|c| **c).count() as f64 / covered.len() as f64
    }

    /// A wall at z = 1, and a screen at z = 0.5 for x below `screen`.
    fn wall(screen: f32) -> impl FnMut(&Camera) -> Vec<f32> {
        move |camera| {
            let pixel = |i: u32| {
                let ray = ((i % 100) as f32 + 0.5 - camera.center.x) / camera.focal.x;
                let at_screen = camera.position().x + ray * 0.5;
                if at_screen < screen { 0.5 } else { 1.0 }
            };
            (0..camera.size.x * camera.size.y).map(pixel).collect()
        }
    }

    #[test]
    fn pixels_count_that_two_photos_see() {
        let held_out = [view("held out", camera(Vec3::ZERO))];
        let held_out: Vec<&View> = held_out.iter().collect();
        let photos = [view("a", camera(Vec3::X)), view("b", camera(Vec3::X * 0.5))];
        let photos: Vec<&View> = photos.iter().collect();
        // The held-out view shows x from -1 to 1, photo a from 0 to 2, photo b from -0.5 to 1.5.
        let seen = covered(&held_out, &photos, u64::MAX, wall(f32::NEG_INFINITY));
        assert_eq!(share(&seen[0]), 0.5);
        assert!(seen[0].iter().enumerate().all(|(i, c)| *c == (i % 100 >= 50)));
        assert_eq!(
            share(&covered(&held_out, &photos[..1], u64::MAX, wall(f32::NEG_INFINITY))[0]),
            0.0,
            "one only"
        );
        // The held-out view shows a screen that ends at x = 0.1 on the left of its column 60. Photo a has
        // none of it in view, photo b only the end.
        let seen = covered(&held_out, &photos, u64::MAX, wall(0.1));
        let columns: Vec<usize> = (0..100).filter(|x| seen[0][*x]).collect();
        assert_eq!(columns, (60..100).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_hidden_is_not_seen() {
        // From the left the screen's end at x = 0.1 hides the wall left of x = 0.7; from 0 left of 0.2.
        let held_out = [view("held out", camera(Vec3::X))];
        let photos = [view("a", camera(Vec3::ZERO)), view("b", camera(Vec3::NEG_X * 0.5))];
        let [held_out, photos] = [held_out.iter().collect::<Vec<_>>(), photos.iter().collect::<Vec<_>>()];
        let seen = covered(&held_out, &photos, u64::MAX, wall(0.1));
        // Photo b shows the wall up to x = 0.5, all of it behind the screen's end.
        assert_eq!(share(&seen[0]), 0.0);
        let same = [photos[0], photos[0]];
        let columns: Vec<usize> =
            (0..100).filter(|x| covered(&held_out, &same, u64::MAX, wall(0.1))[0][*x]).collect();
        // x from 0.2 to 1 in columns of 0.02; the first column is at x = 0.
        assert_eq!(columns, (10..50).collect::<Vec<_>>());
    }

    #[test]
    fn a_photo_does_not_count_for_itself() {
        let photos = [view("a", camera(Vec3::ZERO)), view("b", camera(Vec3::ZERO))];
        let photos: Vec<&View> = photos.iter().collect();
        // In groups of one view the pixels are the same.
        for bytes in [0, 5000, 9999] {
            assert_eq!(
                covered(&photos, &photos, bytes, wall(0.1)),
                covered(&photos, &photos, u64::MAX, wall(0.1))
            );
        }
        let seen = covered(&photos, &photos, u64::MAX, wall(f32::NEG_INFINITY));
        assert_eq!(share(&seen[0]), 0.0);
    }

    #[test]
    fn the_synthetic_scene_is_covered_as_its_rays_say() {
        let options = SyntheticOptions { views: 12, width: 160, ..SyntheticOptions::default() };
        let all: Vec<View> =
            (0..12).map(|i| view(&i.to_string(), trisplat_synthetic::camera(&options, i))).collect();
        let (held_out, training): (Vec<&View>, Vec<&View>) = all.iter().partition(|v| v.name == "5");
        let ray = |camera: &Camera, x: u32, y: u32| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let seen = ((pixel - camera.center.as_dvec2()) / camera.focal.as_dvec2()).extend(1.0);
            let direction = camera.rotation.as_dmat3().transpose() * seen;
            // Depth 1 per length of the direction.
            trace(Ray { origin: camera.position().as_dvec3(), direction }).expect("ground or sky")
        };
        let pixels = |camera: &Camera| {
            let size = camera.size;
            (0..size.x * size.y).map(move |i| (i % size.x, i / size.x)).collect::<Vec<_>>()
        };
        let depth = |camera: &Camera| -> Vec<f32> {
            pixels(camera).into_iter().map(|(x, y)| ray(camera, x, y).distance as f32).collect()
        };
        let seen = covered(&held_out, &training, u64::MAX, depth);
        let sees = |camera: &Camera, point: DVec3| {
            let q = camera.rotation.as_dmat3() * point + camera.translation.as_dvec3();
            let at = q.truncate() / q.z * camera.focal.as_dvec2() + camera.center.as_dvec2();
            let inside = at.cmpge(DVec2::ZERO).all() && at.cmplt(camera.size.as_dvec2()).all();
            q.z > 0.0 && inside && visible(point, camera.position().as_dvec3())
        };
        let camera = &held_out[0].camera;
        let truth: Vec<bool> = pixels(camera)
            .into_iter()
            .map(|(x, y)| {
                let point = ray(camera, x, y).position;
                training.iter().filter(|v| sees(&v.camera, point)).count() >= 2
            })
            .collect();
        let wrong = truth.iter().zip(&seen[0]).filter(|(a, b)| a != b).count();
        let exact = share(&truth);
        assert!((0.2..0.98).contains(&exact), "{exact}: the scene must have both kinds of pixels");
        // Where an outline passes through a pixel of a training photo, its middle does not represent the
        // whole pixel.
        assert!(wrong * 50 < truth.len(), "{wrong} of {} pixels", truth.len());
        assert!((share(&seen[0]) - exact).abs() < 0.01, "{} against {exact}", share(&seen[0]));
    }
}
