//! What the training photos have seen of every triangle since the last judgement.
//!
//! A triangle is judged only by *complete* passes: every training photo was drawn since the watch began
//! and the triangle was there all the time. Photos are counted, not epochs: a counter that resets at the
//! wrong moment deletes whole scenes of many photos (the paper's code does, above some 520 of them).

/// Figures per triangle and per photo.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Watch {
    /// Largest blending weight alpha·T at any pixel. `[N]`
    pub max_weight: Vec<f32>,
    /// Different photos that showed the triangle. `[N]`
    pub views: Vec<u32>,
    /// Largest distance of a corner from the centre, px of the full photo. `[N]`
    pub radius_px: Vec<f32>,
    /// Squared error of the pixels since the last refinement, shared out by weight. `[N]`
    pub error: Vec<u64>,
    /// Triangles younger than the watch: nothing is held against them. `[N]`
    pub exempt: Vec<bool>,
    /// Training photos drawn since the watch began. `[V]`
    pub seen: Vec<bool>,
}

/// What the rasteriser saw of every triangle in a number of frames.
#[derive(Debug, Clone, Copy)]
pub struct Sighting<'a> {
    /// Largest alpha·T. `[N]`
    pub max_weight: &'a [f32],
    /// Photos, each counted once in a watch. `[N]`
    pub views: &'a [u32],
    /// Largest radius, px of the frames. `[N]`
    pub radius_px: &'a [f32],
}

impl Watch {
    /// A fresh watch over `triangles` and `photos`.
    pub fn new(triangles: usize, photos: usize) -> Self {
        Self {
            max_weight: vec![0.0; triangles],
            views: vec![0; triangles],
            radius_px: vec![0.0; triangles],
            error: vec![0; triangles],
            exempt: vec![false; triangles],
            seen: vec![false; photos],
        }
    }

    /// Notes that `photo` is drawn; true when it is the first time in this watch.
    pub fn meet(&mut self, photo: usize) -> bool {
        match self.seen.get_mut(photo) {
            Some(seen) => !std::mem::replace(seen, true),
            None => false,
        }
    }

    /// True when every photo was drawn since the watch began.
    pub fn is_complete(&self) -> bool {
        self.seen.iter().all(|s| *s)
    }

    /// Adds what the rasteriser saw; `full_px` is the size of a frame's pixel in pixels of the full photo.
    pub fn add(&mut self, sighting: &Sighting<'_>, full_px: f32) {
        for i in 0..self.max_weight.len() {
            self.max_weight[i] = self.max_weight[i].max(sighting.max_weight[i]);
            self.views[i] += sighting.views[i];
            self.radius_px[i] = self.radius_px[i].max(full_px * sighting.radius_px[i]);
        }
    }

    /// Adds errors of the same triangles.
    pub fn add_errors(&mut self, errors: &[u64]) {
        self.error.iter_mut().zip(errors).for_each(|(sum, e)| *sum = sum.saturating_add(*e));
    }

    /// Moves triangle `i` of `from` to the end of this watch, its error forgotten.
    pub fn push(&mut self, from: &Watch, i: usize) {
        self.max_weight.push(from.max_weight[i]);
        self.views.push(from.views[i]);
        self.radius_px.push(from.radius_px[i]);
        self.error.push(0);
        self.exempt.push(from.exempt[i]);
    }

    /// Adds a triangle that was not there when the watch began.
    pub fn push_exempt(&mut self) {
        self.max_weight.push(0.0);
        self.views.push(0);
        self.radius_px.push(0.0);
        self.error.push(0);
        self.exempt.push(true);
    }

    /// A watch without triangles that keeps the photos drawn.
    pub fn emptied(&self) -> Self {
        Self { seen: self.seen.clone(), ..Self::default() }
    }

    /// Number of triangles watched.
    pub fn len(&self) -> usize {
        self.max_weight.len()
    }

    /// True when no triangle is watched.
    pub fn is_empty(&self) -> bool {
        self.max_weight.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_thousand_photos_are_complete_only_after_all_of_them() {
        let mut watch = Watch::new(1, 5000);
        for photo in 0..5000 {
            assert!(!watch.is_complete());
            assert!(watch.meet(photo));
            assert!(!watch.meet(photo));
        }
        assert!(watch.is_complete());
    }
}
