//! The bake, called by a program.

use crate::background::BackgroundDetails;
use crate::options::BakeOptions;
use crate::recipe::{BakeOutcome, Recipe};
use crate::views::Views;
use std::ops::ControlFlow;
use trisplat_scene::report::{Report, StageObserver};
use trisplat_scene::{Asset, ImportedScene, Result};

/// Bakes a scene for an engine: the whole recipe, without photos. [`Bake`] takes photos, several
/// inputs, a report and an observer.
///
/// ```
/// use glam::Vec3;
/// use trisplat_bake::{BakeOptions, BakePreset, bake};
/// use trisplat_scene::Soup;
///
/// let soup = Soup {
///     vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
///     opacity: vec![1.0],
///     sigma: vec![0.01],
///     sh: vec![[0.5, 0.0, -0.5]],
///     sh_degree: 0,
///     ..Soup::default()
/// };
/// let asset = bake(soup, &BakeOptions::preset(BakePreset::Fast))?;
/// assert_eq!(asset.mesh.face_count(), 1);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
///
/// Options out of range, nothing left to draw.
pub fn bake(scene: impl Into<ImportedScene>, options: &BakeOptions) -> Result<Asset> {
    Bake::new(options).run([scene])
}

/// A bake with all optional inputs.
///
/// ```
/// # use glam::Vec3;
/// use trisplat_bake::{Bake, BakeOptions, PruneDetails};
/// use trisplat_scene::report::Report;
/// # use trisplat_scene::Soup;
/// # let triangle = Soup {
/// #     vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
/// #     opacity: vec![1.0],
/// #     sigma: vec![0.01],
/// #     sh: vec![[0.5, 0.0, -0.5]],
/// #     sh_degree: 0,
/// #     ..Soup::default()
/// # };
/// # let faint = Soup { opacity: vec![0.001], ..triangle.clone() };
///
/// let mut report = Report::new("bake");
/// let asset = Bake::new(&BakeOptions::default()).report(&mut report).run([triangle, faint])?;
/// assert_eq!(asset.mesh.face_count(), 1);
/// assert_eq!(report.details::<PruneDetails>().map(|d| d.faint), Some(1));
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[must_use = "nothing happens before `run`"]
pub struct Bake<'a> {
    options: &'a BakeOptions,
    views: Option<&'a mut Views>,
    report: Option<&'a mut Report>,
    observer: Option<StageObserver<'a>>,
    background: Option<BackgroundDetails>,
}

impl<'a> Bake<'a> {
    /// A bake with these options.
    pub fn new(options: &'a BakeOptions) -> Self {
        Self { options, views: None, report: None, observer: None, background: None }
    }

    /// Photos of the scene. Without them the cameras stored in the scene, if any, decide
    /// visibility. The photos' cameras are left in the frame of the scene.
    pub fn photos(self, views: impl Into<Option<&'a mut Views>>) -> Self {
        Self { views: views.into(), ..self }
    }

    /// Records the result of every stage.
    pub fn report(self, report: &'a mut Report) -> Self {
        Self { report: Some(report), ..self }
    }

    /// Is notified when stages start and end.
    pub fn observer(self, observer: StageObserver<'a>) -> Self {
        Self { observer: Some(observer), ..self }
    }

    /// The background that was found before the bake: it is not looked for again.
    pub fn background(self, details: Option<BackgroundDetails>) -> Self {
        Self { background: details, ..self }
    }

    /// Merges `inputs` and bakes them for an engine.
    ///
    /// # Errors
    ///
    /// Options out of range, inputs that do not merge, nothing left to draw, photos that cannot be
    /// read or do not show the scene.
    pub fn run<S: Into<ImportedScene>>(self, inputs: impl IntoIterator<Item = S>) -> Result<Asset> {
        self.run_with_details(inputs).map(|outcome| outcome.asset)
    }

    /// [`Bake::run`] with the details of the stages that decide about further files.
    ///
    /// # Errors
    ///
    /// As for [`Bake::run`].
    pub fn run_with_details<S: Into<ImportedScene>>(
        self,
        inputs: impl IntoIterator<Item = S>,
    ) -> Result<BakeOutcome> {
        self.options.validate()?;
        let mut own_report = Report::default();
        let observer: StageObserver<'_> = match self.observer {
            Some(observer) => observer,
            None => &mut |_| ControlFlow::Continue(()),
        };
        let report = self.report.unwrap_or(&mut own_report);
        let recipe = Recipe::new(self.options, report, observer);
        recipe.run(inputs.into_iter().map(Into::into).collect(), self.views, self.background)
    }
}
