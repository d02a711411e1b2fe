//! Visibility of every triangle in the training photos since the last pruning.
//!
//! A triangle is pruned only after *complete* passes: every training photo was drawn since the
//! statistics began, and the triangle existed all the time. Photos are counted, not epochs: a
//! counter that resets at the wrong moment deletes whole scenes of many photos (the paper's code
//! does, above some 520 of them).

use trisplat_raster::soft::Importance;

/// Visibility statistics per triangle and per photo.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VisibilityStats {
    /// Largest blending weight alpha·T at any pixel. `[N]`
    pub max_weight: Vec<f32>,
    /// Sum of the blending weights over all pixels of all photos, px of the full photos. `[N]`
    pub sum_weight: Vec<f32>,
    /// Different photos that showed the triangle. `[N]`
    pub views: Vec<u32>,
    /// Largest distance of a corner from the centre, px of the full photo. `[N]`
    pub radius_px: Vec<f32>,
    /// Reciprocal of the least depth in a photo that shows it, 1 / unit of training space; 0
    /// without one. `[N]`
    pub nearness: Vec<f32>,
    /// Squared error of the pixels since the last densification, shared out by weight. `[N]`
    pub error: Vec<u64>,
    /// Triangles younger than the statistics: not pruned by them. `[N]`
    pub exempt: Vec<bool>,
    /// Training photos drawn since the statistics began. `[V]`
    pub drawn: Vec<bool>,
}

impl VisibilityStats {
    /// Nothing drawn yet, of `triangles` and `photos`.
    pub fn new(triangles: usize, photos: usize) -> Self {
        Self {
            max_weight: vec![0.0; triangles],
            sum_weight: vec![0.0; triangles],
            views: vec![0; triangles],
            radius_px: vec![0.0; triangles],
            nearness: vec![0.0; triangles],
            error: vec![0; triangles],
            exempt: vec![false; triangles],
            drawn: vec![false; photos],
        }
    }

    /// Records a drawing of `photo`; true when it is the first since the statistics began.
    pub fn record_photo(&mut self, photo: usize) -> bool {
        match self.drawn.get_mut(photo) {
            Some(drawn) => !std::mem::replace(drawn, true),
            None => false,
        }
    }

    /// True when every photo was drawn since the statistics began.
    pub fn is_complete(&self) -> bool {
        self.drawn.iter().all(|drawn| *drawn)
    }

    /// Merges the importance of triangles in frames; with `is_first`, of photos that are drawn for
    /// the first time. `full_px` is the size of a frame's pixel in pixels of the full photo.
    pub fn merge(&mut self, importance: &Importance, is_first: bool, full_px: f32) {
        for i in 0..self.max_weight.len() {
            self.max_weight[i] = self.max_weight[i].max(importance.max_weight[i]);
            self.radius_px[i] = self.radius_px[i].max(full_px * importance.max_radius_px[i]);
            self.nearness[i] = self.nearness[i].max(importance.nearness[i]);
            if is_first {
                self.sum_weight[i] += full_px * full_px * importance.sum_weight[i];
                self.views[i] += importance.views[i];
            }
        }
    }

    /// Adds errors of the same triangles.
    pub fn add_errors(&mut self, errors: &[u64]) {
        for (sum, error) in self.error.iter_mut().zip(errors) {
            *sum = sum.saturating_add(*error);
        }
    }

    /// Appends triangle `i` of `from`, its error reset.
    pub fn push(&mut self, from: &Self, i: usize) {
        self.max_weight.push(from.max_weight[i]);
        self.sum_weight.push(from.sum_weight[i]);
        self.views.push(from.views[i]);
        self.radius_px.push(from.radius_px[i]);
        self.nearness.push(from.nearness[i]);
        self.error.push(0);
        self.exempt.push(from.exempt[i]);
    }

    /// Appends a triangle younger than the statistics.
    pub fn push_exempt(&mut self) {
        self.max_weight.push(0.0);
        self.sum_weight.push(0.0);
        self.views.push(0);
        self.radius_px.push(0.0);
        self.nearness.push(0.0);
        self.error.push(0);
        self.exempt.push(true);
    }

    /// The same photos drawn, without triangles.
    pub fn without_triangles(&self) -> Self {
        Self { drawn: self.drawn.clone(), ..Self::default() }
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.max_weight.len()
    }

    /// True when there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.max_weight.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_summed_in_pixels_of_the_full_photo() {
        let mut visibility = VisibilityStats::new(1, 2);
        let mut frame = Importance::new(1);
        frame.max_weight = vec![0.5];
        frame.sum_weight = vec![3.0];
        frame.views = vec![1];
        frame.max_radius_px = vec![2.0];
        visibility.merge(&frame, true, 2.0);
        visibility.merge(&frame, false, 2.0);
        visibility.merge(&frame, true, 1.0);
        assert_eq!((visibility.sum_weight[0], visibility.max_weight[0]), (15.0, 0.5));
        assert_eq!((visibility.radius_px[0], visibility.views[0]), (4.0, 2));
    }

    #[test]
    fn five_thousand_photos_are_complete_only_after_all_of_them() {
        let mut visibility = VisibilityStats::new(1, 5000);
        for photo in 0..5000 {
            assert!(!visibility.is_complete());
            assert!(visibility.record_photo(photo));
            assert!(!visibility.record_photo(photo));
        }
        assert!(visibility.is_complete());
    }
}
