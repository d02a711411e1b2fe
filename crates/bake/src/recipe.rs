//! The recipe: the stages in their order, with reasons.

mod colors;
mod fit;
mod levels;
mod load;
mod package;
mod solid;
mod surroundings;
mod trained_scene;
mod values;
mod visibility;

use super::background::BackgroundDetails;
use super::budget::TriangleBudget;
use super::crop::CropDetails;
use super::options::BakeOptions;
use super::place::PlaceOptions;
use super::place::evidence::Evidence;
use super::surroundings::Sky;
use super::tiles::tiles;
use super::viewpoint::ViewpointDetails;
use super::views::Views;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Counts, Outcome, Report, StageDetails, StageObserver, StageProgress};
use trisplat_scene::{Asset, ImportedScene, Placement, Result, Scene, UpAxis};
use values::{FileFrame, FrameSource, LevelContext, LoadedScene, NormalSources, SceneCameras};

/// A bake that is running: its options, and where it reports.
pub(super) struct Recipe<'a> {
    options: &'a BakeOptions,
    budget: TriangleBudget,
    /// True if the input is a soup: its triangles are not connected, even where they touch.
    is_soup: bool,
    report: &'a mut Report,
    observer: StageObserver<'a>,
}

/// The asset of a bake, and the details of two stages that decide about further files.
#[derive(Debug, Clone)]
pub struct BakeOutcome {
    /// The baked scene, for an engine.
    pub asset: Asset,
    /// Triangles removed by cropping, and the size of the subject.
    pub crop: CropDetails,
    /// The first viewpoint.
    pub viewpoint: ViewpointDetails,
}

impl<'a> Recipe<'a> {
    pub(super) fn new(
        options: &'a BakeOptions,
        report: &'a mut Report,
        observer: StageObserver<'a>,
    ) -> Self {
        let budget = TriangleBudget::new(options.prune.max_triangles);
        Self { options, budget, is_soup: false, report, observer }
    }

    /// Bakes inputs, merged. `photos` are left in the frame of the scene. `background` is given
    /// where an earlier stage found the colour behind the scene; else the bake finds it.
    pub(super) fn run(
        mut self,
        inputs: Vec<ImportedScene>,
        photos: Option<&mut Views>,
        background: Option<BackgroundDetails>,
    ) -> Result<BakeOutcome> {
        // Load and cut.
        let is_merged = inputs.len() > 1;
        let LoadedScene { scene, input_backdrop, mut pictures, assumed_up } =
            self.load(inputs, photos)?;
        self.is_soup = matches!(scene.scene, Scene::Soup(_));
        let (scene, background) = self.background(scene, background, &pictures)?;
        let (scene, crop) = self.crop(scene, &pictures)?;
        let scene = self.simplify(scene, input_backdrop.as_ref(), &pictures)?;

        // Pictures and surfaces of the scene as it was trained.
        let (scene, viewpoint_cameras) =
            self.viewpoint_cameras(scene, input_backdrop.as_ref(), &pictures);
        let input_backdrop =
            self.simplify_input_backdrop(input_backdrop, &scene.scene, &viewpoint_cameras)?;
        let backdrop = input_backdrop.as_ref();
        self.budget = self.budget.with_input_backdrop(self.counted_triangles(backdrop));
        pictures.drawn_views =
            self.teacher(&scene, backdrop, &background, &pictures, &viewpoint_cameras)?;
        let mut scene = self.arrange(scene, &pictures)?;
        let traits = self.traits(&scene, &pictures);
        let collision = self.collision(&scene, &pictures)?;
        let normal_surface = self.normal_surface(&scene, &pictures)?;
        let stored_cameras = std::mem::take(&mut scene.cameras);
        let cameras = SceneCameras::new(stored_cameras, &pictures, viewpoint_cameras);

        // Solid and visible triangles, fitted to the pictures.
        let has_pictures = pictures.any().is_some();
        let (mesh, mut provenance) = self.solid_mesh(scene, &cameras.visibility, has_pictures)?;
        let mesh = self.unseen(mesh, backdrop, pictures.any(), &cameras, traits.is_soft)?;
        let exposure = provenance.exposure;
        let mesh = self.fit(mesh, backdrop, exposure, &mut pictures, traits, &cameras.photos)?;

        // Surroundings, outside the levels of detail.
        let (mesh, mut surroundings) =
            self.surroundings(mesh, input_backdrop, is_merged, pictures.any(), &cameras)?;
        let mesh = self.erase(mesh, surroundings.mesh.as_mut(), &provenance)?;
        let scene_faces = mesh.face_count();
        let mut level_plan = self.level_plan(&mesh);
        let mesh = self.backdrop(mesh, surroundings.mesh, pictures.any())?;

        // Colours.
        let (mesh, unseen_colors) = self.refit(mesh, scene_faces, pictures.any())?;
        let mesh = self.sh(mesh, scene_faces, pictures.any())?;
        level_plan.keep_backdrop(&mesh, scene_faces);
        provenance.backdrop_faces = (mesh.face_count() - scene_faces) as u32;
        let mesh = self.texture(mesh, unseen_colors, pictures.any())?;

        // Package, levels of detail and tiles.
        cameras.store_in(&mut provenance);
        let normals =
            NormalSources { cameras: &cameras.visibility, surface: normal_surface.as_ref() };
        let are_chosen = pictures.photo_views.as_deref().is_some_and(|views| views.are_chosen);
        let evidence = Evidence { cameras: &cameras.photos, points: pictures.points(), are_chosen };
        let (asset, frame, viewpoint) =
            self.package(mesh, provenance.clone(), normals, FrameSource::Evidence(evidence))?;
        self.warn_of_assumed_up(assumed_up.filter(|_| cameras.photos.is_empty()));
        let context = LevelContext { provenance, normals, frame };
        let levels = self.levels(&level_plan, &context, &cameras, pictures.any())?;
        let asset = self.finish(Asset { levels, ..asset }, collision, surroundings.sky, &frame)?;
        Ok(BakeOutcome { asset, crop, viewpoint })
    }

    /// Runs a stage and reports it; its details are used nowhere else.
    fn stage<T, D: StageDetails>(
        &mut self,
        input: T,
        measure: impl Fn(&T) -> Counts,
        run: impl FnOnce(&mut T, &mut D) -> Result<Outcome<()>>,
    ) -> Result<T> {
        Ok(self.report.stage(self.observer, input, measure, run)?.0)
    }

    /// [`Recipe::stage`] for one that reports its progress.
    fn long_stage<T, D: StageDetails>(
        &mut self,
        input: T,
        measure: impl Fn(&T) -> Counts,
        run: impl FnOnce(&mut T, &mut D, &mut StageProgress<'_>) -> Result<Outcome<()>>,
    ) -> Result<T> {
        Ok(self.report.long_stage(self.observer, input, measure, run)?.0)
    }

    /// The up axis of a mesh is a guess if neither its file nor an option nor photos give it.
    fn warn_of_assumed_up(&mut self, assumed: Option<UpAxis>) {
        let Some(up) = assumed.filter(|_| self.options.place.up == PlaceOptions::DEFAULT.up) else {
            return;
        };
        let [taken, head] = if up == UpAxis::Y { ["y", "-y"] } else { ["−y", "y"] };
        self.report.warnings.push(format!(
            "the file does not say what is up, taken as {taken}: `up` {head} if it lies on its head, z if it lies on its side"
        ));
    }

    /// Adds the collider and the surroundings to the packaged scene, placed like it, and cuts it
    /// into tiles, which hold final triangles.
    fn finish(
        &mut self,
        asset: Asset,
        collision: Option<Mesh>,
        sky: Sky,
        frame: &FileFrame,
    ) -> Result<Asset> {
        let collision = collision.map(|mesh| place_mesh(mesh, &frame.placement));
        let mut asset = Asset { collision, ..asset };
        self.store_surroundings(&mut asset, sky, &frame.placement);
        let options = &self.options.tiles;
        self.stage(asset, Asset::counts, |asset, details| tiles(asset, options, details))
    }
}

/// Moves `mesh`, in the frame of the input, to the frame of the file.
fn place_mesh(mut mesh: Mesh, placement: &Placement) -> Mesh {
    let transform = placement.transform();
    for position in &mut mesh.positions {
        *position = transform(*position);
    }
    mesh
}
