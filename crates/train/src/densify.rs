//! Adding and removing triangles (Held et al. 2025, section 3.2), every few hundred steps.
//!
//! Useless triangles are pruned. Then weighted sampling, by opacity and by 1/σ alternately, picks
//! triangles to grow: a large one is split into the four of its midpoint subdivision, a small one
//! is cloned within its plane. The scene keeps its look: four children cover their parent's area
//! with the same mean window 2/((σ+1)(σ+2)), and both triangles of a clone get 1 - sqrt(1 - o),
//! whose blend is o again.

mod growth;
mod plan;
mod prune;

pub use plan::Densified;
pub(crate) use plan::DensifyPlan;

use super::initial::even_subset;
use super::params::OptimizerState;
use super::visibility::VisibilityStats;
use growth::{bisect, clone, is_large, sample_growth, split};
use prune::{prune, relocate, repair};
use trisplat_scene::Rng;

/// Densifies `state` and `visibility` together; complete statistics are reset. The most important
/// triangle always stays.
pub(crate) fn densify(
    state: &mut OptimizerState,
    visibility: &mut VisibilityStats,
    plan: &DensifyPlan<'_>,
) -> Densified {
    let mut done = Densified::default();
    let complete = visibility.is_complete();
    let mut alive = prune(state, visibility, complete, plan, &mut done);
    let holes = repair(state, visibility, &mut alive, plan, &mut done);
    if complete && plan.grow && plan.bisect && plan.core.is_none() {
        done.relocated = relocate(state, visibility, &mut alive, plan);
    }
    let count = alive.iter().skip(state.frozen).filter(|alive| **alive).count();
    let holes = even_subset(&holes, plan.max_triangles.saturating_sub(count));
    let plan = &DensifyPlan { max_triangles: plan.max_triangles - holes.len(), ..*plan };
    let grown = if plan.grow {
        sample_growth(state, &alive, visibility, plan)
    } else {
        vec![false; alive.len()]
    };

    let mut next = state.empty_like();
    let mut next_visibility = visibility.without_triangles();
    for i in (0..alive.len()).filter(|&i| alive[i] && !grown[i]) {
        next.push(state, i);
        next_visibility.push(visibility, i);
    }
    let rng = Rng::new(plan.seed, "clone", plan.step);
    for i in (0..alive.len()).filter(|&i| grown[i]) {
        let children = if plan.bisect {
            done.split += 1;
            bisect(&state.params, i)
        } else if is_large(visibility, i, plan) {
            done.split += 1;
            split(&state.params, i)
        } else {
            done.cloned += 1;
            clone(&state.params, i, plan, rng)
        };
        for child in 0..children.len() {
            next.push_fresh(&children, child);
            next_visibility.push_exempt();
        }
    }
    if let Some(anchors) = plan.anchors {
        // The purpose's name is part of the random numbers.
        let rng = Rng::new(plan.seed, "known", plan.step);
        let filled = anchors.fill_triangles(&holes, next.params.sh_degree, rng);
        done.filled = filled.len();
        for i in 0..filled.len() {
            next.push_fresh(&filled, i);
            next_visibility.push_exempt();
        }
    }
    done.triangles = next.params.len();
    if complete {
        next_visibility = VisibilityStats::new(done.triangles, visibility.drawn.len());
    }
    *state = next;
    *visibility = next_visibility;
    done
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{DensifyOptions, SampleWeight};
    use crate::params::{Anneal, Core, Params, logit};
    use glam::Vec3;
    use trisplat_scene::Soup;

    fn state(n: usize) -> OptimizerState {
        let rng = Rng::new(5, "soup", 0);
        let corner = |i: usize, c: usize| {
            let at = |k: usize| rng.uniform((9 * i + 3 * c + k) as u64);
            Vec3::new(at(0), at(1), at(2)) + Vec3::X * i as f32
        };
        let soup = Soup {
            vertices: (0..n).map(|i| std::array::from_fn(|c| corner(i, c))).collect(),
            opacity: vec![0.5; n],
            sigma: vec![1.0; n],
            sh: vec![[0.1, 0.2, 0.3]; n],
            sh_degree: 0,
            ..Soup::default()
        };
        OptimizerState::new(Params::from_soup(&soup, 1))
    }

    /// Statistics in which every triangle was visible in all `photos` photos.
    fn visible(n: usize, photos: usize) -> VisibilityStats {
        let mut visibility = VisibilityStats::new(n, photos);
        visibility.max_weight.fill(0.5);
        visibility.views.fill(photos as u32);
        visibility.radius_px.fill(10.0);
        visibility.drawn.fill(true);
        visibility
    }

    fn plan(options: &DensifyOptions) -> DensifyPlan<'_> {
        DensifyPlan {
            options,
            eyes: &[],
            anchors: None,
            max_triangles: 1000,
            core: None,
            grow: true,
            pull: true,
            prune_weight: 0.022,
            prune_opacity: 0.014,
            densification: 1,
            bisect: false,
            anneal: Anneal::NONE,
            seed: 1,
            step: 500,
        }
    }

    #[test]
    fn grows_by_thirty_per_cent_and_never_above_the_limit() {
        let options = DensifyOptions::default();
        let mut s = state(100);
        let mut w = visible(100, 3);
        let done = densify(&mut s, &mut w, &plan(&options));
        assert_eq!((done.cloned, done.split, s.params.len(), w.len()), (30, 0, 130, 130));
        let mut s = state(100);
        let mut w = visible(100, 3);
        densify(&mut s, &mut w, &DensifyPlan { max_triangles: 111, ..plan(&options) });
        assert_eq!(s.params.len(), 111);
        let mut s = state(100);
        let mut w = visible(100, 3);
        w.radius_px.fill(100.0);
        let done = densify(&mut s, &mut w, &plan(&options));
        assert_eq!((done.cloned, done.split, s.params.len()), (0, 10, 130));
    }

    #[test]
    fn a_core_that_is_full_ends_the_growth_around_it_too() {
        let options = DensifyOptions { growth: 5.0, ..DensifyOptions::default() };
        // The middles of the first ten of twenty are below 10.5.
        let core =
            |triangles| Some(Core { low: [None; 3], high: [Some(10.5), None, None], triangles });
        let grown = |triangles| {
            let mut s = state(20);
            let mut w = visible(20, 3);
            densify(&mut s, &mut w, &DensifyPlan { core: core(triangles), ..plan(&options) });
            let held = core(0).map_or(0, |core| {
                (0..s.params.len()).filter(|&i| core.holds(&s.params, i)).count()
            });
            (held, s.params.len())
        };
        let (before, _) = grown(0);
        assert_eq!(grown(0), (before, 20));
        assert_eq!(grown(before as u64), (before, 20));
        let (held, all) = grown(before as u64 + 4);
        assert!(held.abs_diff(before + 4) <= 1 && all > 24, "{held} and {all}");
    }

    #[test]
    fn triangles_are_sampled_by_their_weight() {
        let grown_opaque = |densification: u64| {
            let options = DensifyOptions {
                sample_by: SampleWeight::Alternating,
                ..DensifyOptions::default()
            };
            let mut s = state(1000);
            s.params.opacity[..500].fill(logit(0.9));
            s.params.opacity[500..].fill(logit(0.03));
            let grown = sample_growth(
                &s,
                &[true; 1000],
                &visible(1000, 3),
                &DensifyPlan { densification, max_triangles: 5000, ..plan(&options) },
            );
            assert_eq!(grown.iter().filter(|g| **g).count(), 300);
            grown[..500].iter().filter(|g| **g).count()
        };
        assert!(grown_opaque(1) > 270, "by opacity");
        let opaque = grown_opaque(2);
        assert!((110..190).contains(&opaque), "by 1/σ, the same for all: {opaque}");
    }

    #[test]
    fn a_split_keeps_area_and_a_clone_keeps_plane_and_opacity() {
        let s = state(7);
        let area = |v: &[Vec3; 3]| (v[1] - v[0]).cross(v[2] - v[0]).length();
        for i in 0..7 {
            let parent = s.params.vertices[i];
            let children = split(&s.params, i);
            let total: f32 = children.vertices.iter().map(area).sum();
            assert!((total / area(&parent) - 1.0).abs() < 1e-4);
            let options = DensifyOptions::default();
            let cloned = clone(&s.params, i, &plan(&options), Rng::new(1, "clone", 0));
            let normal = (parent[1] - parent[0]).cross(parent[2] - parent[0]).normalize();
            assert!(cloned.vertices[1].iter().all(|v| normal.dot(*v - parent[0]).abs() < 1e-4));
            let o = Anneal::NONE.opacity(cloned.opacity[0]);
            assert!((1.0 - (1.0 - o) * (1.0 - o) - 0.5).abs() < 1e-5);
        }
    }

    #[test]
    fn a_solid_scene_is_cut_in_two_where_it_is_wrong() {
        let options = DensifyOptions::default();
        let mut s = state(10);
        let mut w = visible(10, 3);
        let parent = s.params.vertices[3];
        w.error[3] = 7;
        let solid = DensifyPlan { bisect: true, anneal: Anneal::SOLID, ..plan(&options) };
        let done = densify(&mut s, &mut w, &solid);
        assert_eq!((done.split, done.cloned, s.params.len()), (1, 0, 11));
        let area = |v: &[Vec3; 3]| (v[1] - v[0]).cross(v[2] - v[0]);
        for half in &s.params.vertices[9..] {
            // The same plane and winding, and half the area.
            assert!(
                (2.0 * area(half) - area(&parent)).length()
                    < 1e-5 * area(&parent).length().max(1.0)
            );
        }
    }

    #[test]
    fn a_full_scene_moves_the_least_seen_to_where_it_is_wrong() {
        let options = DensifyOptions { relocate: 0.1, ..DensifyOptions::default() };
        let full = DensifyPlan {
            max_triangles: 100,
            bisect: true,
            anneal: Anneal::SOLID,
            ..plan(&options)
        };
        let core = Some(Core { low: [None; 3], high: [None; 3], triangles: 100 });
        // Nothing is removed if nothing may grow, if some photos were not drawn, if only a part of
        // the scene is trained, or if it is soft.
        for (drawn, grow, core, moved) in [
            (true, true, None, 10),
            (true, false, None, 0),
            (false, true, None, 0),
            (true, true, core, 0),
        ] {
            let mut s = state(100);
            let mut w = visible(100, 3);
            w.sum_weight = (0..100).map(|i| 200.0 - i as f32).collect();
            w.error[50..60].fill(7);
            w.drawn[1] = drawn;
            let before = s.params.clone();
            let done = densify(&mut s, &mut w, &DensifyPlan { grow, core, ..full });
            assert_eq!((done.relocated, done.split, s.params.len()), (moved, moved, 100));
            let gone = (90..100).all(|i| !s.params.vertices.contains(&before.vertices[i]));
            assert_eq!(gone, moved > 0, "the least seen");
        }
        let mut s = state(100);
        let mut w = visible(100, 3);
        let done =
            densify(&mut s, &mut w, &DensifyPlan { bisect: false, anneal: Anneal::NONE, ..full });
        assert_eq!((done.relocated, s.params.len()), (0, 100));
    }

    #[test]
    fn pinned_triangles_stay_as_they_are() {
        let options = DensifyOptions { growth: 5.0, ..DensifyOptions::default() };
        let mut s = state(10);
        let mut w = visible(10, 3);
        s.pinned = 4;
        let before = s.params.clone();
        w.max_weight.fill(0.0);
        w.max_weight[9] = 0.5;
        let done = densify(&mut s, &mut w, &plan(&options));
        assert_eq!((done.unimportant, done.cloned), (5, 1));
        assert_eq!((s.params.len(), s.pinned), (6, 4));
        assert_eq!(s.params.vertices[..4], before.vertices[..4]);
    }

    #[test]
    fn rules_count_what_they_remove() {
        let options = DensifyOptions::default();
        let mut s = state(10);
        let mut w = visible(10, 5);
        s.params.vertices[0][1].x = f32::NAN;
        s.params.opacity[1] = logit(0.001);
        w.max_weight[2] = 0.01;
        w.views[3] = 1;
        let done = densify(&mut s, &mut w, &DensifyPlan { grow: false, ..plan(&options) });
        assert_eq!((done.broken, done.faint, done.unimportant, done.unseen), (1, 1, 1, 1));
        assert_eq!((done.triangles, w.len()), (6, 6));
        assert!(!w.is_complete(), "complete statistics are reset");
    }

    #[test]
    fn training_drops_triangles_before_a_camera_once_solid() {
        let options = DensifyOptions::default();
        let removed = |bisect: bool, views: u32, depth: f32| {
            let mut s = state(10);
            let mut w = visible(10, 8);
            w.nearness.fill(1.0);
            let eye = s.params.vertices[3].iter().sum::<Vec3>() / 3.0 + Vec3::new(0.0, 0.0, -0.3);
            w.views[3] = views;
            w.nearness[3] = 1.0 / depth;
            let plan = DensifyPlan {
                grow: false,
                bisect,
                eyes: &[eye, eye - 9.0 * Vec3::Z],
                ..plan(&options)
            };
            densify(&mut s, &mut w, &plan).unsupported
        };
        assert_eq!(removed(true, 5, 0.76), 1, "0.3 from a camera, 0.76 from a photo");
        assert_eq!(
            [removed(true, 5, 0.74), removed(true, 6, 0.76), removed(false, 5, 0.76)],
            [0; 3]
        );
    }

    #[test]
    fn prune_waits_for_a_whole_pass_of_the_photos() {
        let options = DensifyOptions::default();
        let mut s = state(50);
        let mut w = VisibilityStats::new(50, 5000);
        for photo in 0..500 {
            w.record_photo(photo);
        }
        let done = densify(&mut s, &mut w, &plan(&options));
        assert_eq!((done.unimportant, done.unseen, s.params.len()), (0, 0, 65));
        for photo in 500..5000 {
            w.record_photo(photo);
        }
        // The 15 clones and their 15 originals are younger than the statistics; the other 35 were
        // visible in no photo.
        let done = densify(&mut s, &mut w, &DensifyPlan { grow: false, ..plan(&options) });
        assert_eq!((done.unimportant, s.params.len()), (35, 30));
    }

    #[test]
    fn one_photo_and_scenes_of_useless_triangles_keep_something() {
        let options = DensifyOptions::default();
        let mut s = state(4);
        let mut w = visible(4, 1);
        densify(&mut s, &mut w, &DensifyPlan { grow: false, ..plan(&options) });
        assert_eq!(s.params.len(), 4, "one photo shows every triangle at most once");
        let mut s = state(4);
        let mut w = VisibilityStats::new(4, 2);
        w.drawn.fill(true);
        w.max_weight[2] = 0.001;
        densify(&mut s, &mut w, &DensifyPlan { grow: false, ..plan(&options) });
        assert_eq!(s.params.len(), 1);
    }
}
