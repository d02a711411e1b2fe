//! The triangle limit of a bake, divided between the scene and its surroundings.

/// Limits on triangles; `None` is unlimited.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TriangleBudget {
    /// All triangles that are written: `max_triangles`.
    pub total: Option<u64>,
    /// The scene, without the backdrop of its input.
    pub scene: Option<u64>,
    /// Surroundings.
    pub surroundings: Option<u64>,
    /// Triangles of the input's backdrop, as far as they count towards the total.
    pub input_backdrop: usize,
}

impl TriangleBudget {
    /// A `total` for the scene and its surroundings.
    pub(crate) fn new(total: Option<u64>) -> Self {
        Self {
            total,
            scene: total.map(|total| total.max(1)),
            surroundings: total.map(surroundings_share),
            input_backdrop: 0,
        }
    }

    /// The rest of the budget beside an input's backdrop of this many triangles.
    pub(crate) fn with_input_backdrop(self, triangles: usize) -> Self {
        let rest = |total: u64| total.saturating_sub(triangles as u64).max(1);
        Self { scene: self.total.map(rest), input_backdrop: triangles, ..self }
    }

    /// Limit on surroundings that are among `all` triangles; `None` where all of them fit.
    pub(crate) fn surroundings_among(&self, all: usize) -> Option<u64> {
        self.surroundings.filter(|_| self.total.is_some_and(|total| total < all as u64))
    }

    /// Triangles that the scene and the input's backdrop leave of the total.
    pub(crate) fn rest_beside(&self, scene_faces: usize) -> u64 {
        let used = (scene_faces + self.input_backdrop) as u64;
        self.total.map_or(u64::MAX, |total| total.saturating_sub(used))
    }
}

/// Triangles of a limit that surroundings may take: an eighth, because small budgets are for the
/// subject.
fn surroundings_share(total: u64) -> u64 {
    total / 8
}
